//! Lines of the live view: words are wrapped and columns left out, never cut.

use std::ops::Range;

use ratatui::style::{Modifier, Style};
use ratatui::text::{Line, Span};

/// Style of labels and titles.
pub(crate) const STRONG: Style = Style::new().add_modifier(Modifier::BOLD);

/// Columns of the labels in front of a text.
const LABEL_COLUMNS: usize = 12;

/// A label and a text behind it, in as many lines as `columns` make necessary. Only a word that is longer than a line is cut.
pub(crate) fn wrapped(label: &'static str, text: &str, style: Style, columns: usize) -> Vec<Line<'static>> {
    let room = columns.saturating_sub(LABEL_COLUMNS).max(1);
    let mut rows = vec![String::new()];
    for word in text.split(' ') {
        let mut word: Vec<char> = word.chars().collect();
        let last = rows.last().map_or(0, |row| row.chars().count());
        let space = usize::from(last > 0);
        if last + space + word.len() <= room {
            if let Some(row) = rows.last_mut() {
                row.extend(std::iter::repeat_n(' ', space).chain(word));
            }
            continue;
        }
        if last == 0 {
            rows.pop();
        }
        while word.len() > room {
            rows.push(word.drain(..room).collect());
        }
        rows.push(word.into_iter().collect());
    }
    let label = |k: usize| if k == 0 { label } else { "" };
    let line = |(k, row): (usize, String)| {
        Line::from(vec![Span::styled(format!("{:<LABEL_COLUMNS$}", label(k)), STRONG), Span::styled(row, style)])
    };
    rows.into_iter().enumerate().map(line).collect()
}

/// A title with a line behind it to the right edge, with as many of its words as there is room for.
pub(crate) fn rule(title: &str, columns: usize) -> Line<'static> {
    let mut title = format!("── {title} ");
    while title.chars().count() > columns && title.trim_end().contains(' ') {
        title.truncate(title.trim_end().rfind(' ').map_or(0, |end| end + 1));
    }
    let rest = columns.saturating_sub(title.chars().count());
    Line::styled(title + &"─".repeat(rest), STRONG)
}

/// A column of a table behind the names.
pub(crate) struct Column {
    pub(crate) head: &'static str,
    /// With the gap in front of it.
    pub(crate) width: usize,
}

/// The width of the column of names, and the columns behind it that a terminal has room for, from `first` on; from the last
/// that shows all columns behind it where `first` is beyond that.
pub(crate) fn columns_that_fit<'a>(
    names: impl Iterator<Item = &'a String>,
    table: &[Column],
    columns: usize,
    first: usize,
) -> (usize, Range<usize>) {
    let names = names.map(|name| name.chars().count()).max().unwrap_or(0);
    let room = columns.saturating_sub(names);
    let end = |first: usize| {
        let mut used = 0;
        let fits = |column: &&Column| {
            used += column.width;
            used <= room
        };
        first + table.iter().skip(first).take_while(fits).count()
    };
    let last = (0..table.len()).find(|k| end(*k) == table.len()).unwrap_or(table.len() - 1);
    let first = first.min(last);
    (names, first..end(first))
}

/// A row of a table: the name, then the texts of the columns shown, each at the right edge of its column.
pub(crate) fn cells(
    name: &str,
    names: usize,
    table: &[Column],
    texts: &[String],
    styles: &[Style],
    shown: &Range<usize>,
) -> Line<'static> {
    let mut spans = vec![Span::raw(format!("{name:<names$}"))];
    for k in shown.clone() {
        spans.push(Span::styled(format!("{:>1$}", texts[k], table[k].width), styles[k]));
    }
    Line::from(spans)
}

/// A table with its title, of which a part is shown.
pub(crate) struct Section {
    /// From the numbers of the first and the last row shown, from 1.
    pub(crate) title: Box<dyn Fn(usize, usize) -> String>,
    pub(crate) head: Line<'static>,
    pub(crate) rows: Vec<Line<'static>>,
    /// Of the terminal.
    pub(crate) columns: usize,
    /// First column of numbers that is shown.
    pub(crate) first_column: usize,
}

impl Section {
    /// Rows of title and head.
    pub(crate) const HEAD_ROWS: usize = 2;

    /// Rows of the whole.
    pub(crate) fn len(&self) -> usize {
        Self::HEAD_ROWS + self.rows.len()
    }
}

/// Sections one below the other in so many rows, from their row `first` on (titles and heads do not count). A section keeps title and
/// head while one of its rows is shown. `first` becomes the last row from which all others are shown where it is beyond that.
pub(crate) fn window(sections: &[Section], first: &mut usize, rows: usize) -> Vec<Line<'static>> {
    let all: usize = sections.iter().map(|section| section.rows.len()).sum();
    let needed = |first: usize| {
        let mut before = 0;
        let mut needed = 0;
        for section in sections {
            let skipped = first.saturating_sub(before).min(section.rows.len());
            before += section.rows.len();
            if skipped < section.rows.len() || section.rows.is_empty() {
                needed += Section::HEAD_ROWS + section.rows.len() - skipped;
            }
        }
        needed
    };
    let last = (0..all).find(|k| needed(*k) <= rows).unwrap_or(all.saturating_sub(1));
    *first = (*first).min(last);
    let (mut lines, mut before) = (Vec::new(), 0);
    for section in sections {
        let skipped = first.saturating_sub(before).min(section.rows.len());
        before += section.rows.len();
        let room = rows.saturating_sub(lines.len() + Section::HEAD_ROWS);
        // A title without a row below it is of no use, but where there are none.
        if !section.rows.is_empty() && (skipped == section.rows.len() || room == 0) {
            continue;
        }
        let shown = section.rows.iter().skip(skipped).take(room);
        lines.push(rule(&(section.title)(skipped + 1, skipped + shown.len()), section.columns));
        lines.push(section.head.clone());
        lines.extend(shown.cloned());
    }
    lines.truncate(rows);
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(lines: &[Line<'_>]) -> Vec<String> {
        lines.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn wraps_at_blanks_and_keeps_every_word() {
        let lines = wrapped("load", "decimate since sample 777; 2 changes", Style::new(), 30);
        assert_eq!(text(&lines), ["load        decimate since", "            sample 777; 2", "            changes"]);
        assert_eq!(text(&wrapped("a", "", Style::new(), 3)), ["a           "]);
    }

    #[test]
    fn columns_without_room_are_reached_by_scrolling() {
        let table = [Column { head: "a", width: 10 }, Column { head: "b", width: 10 }, Column { head: "c", width: 10 }];
        let names = ["name".to_owned()];
        let shown = |first| columns_that_fit(names.iter(), &table, 25, first).1;
        assert_eq!([shown(0), shown(1), shown(9)], [0..2, 1..3, 1..3]);
    }

    #[test]
    fn window_shows_every_row_of_every_section_somewhere() {
        let section = |name: &'static str, rows: usize| Section {
            title: Box::new(move |first, last| format!("{name} {first}-{last}")),
            head: Line::raw("head"),
            rows: (0..rows).map(|k| Line::raw(format!("{name}{k}"))).collect(),
            columns: 20,
            first_column: 0,
        };
        let sections = [section("a", 4), section("b", 30)];
        let mut seen = std::collections::BTreeSet::new();
        for first in 0..40 {
            let mut at = first;
            let lines = text(&window(&sections, &mut at, 9));
            assert!(lines.len() <= 9 && lines[1] == "head", "{lines:?}");
            seen.extend(lines.into_iter().filter(|line| line.starts_with(['a', 'b'])));
            assert!(at <= 27, "{at}");
        }
        assert_eq!(seen.len(), 34);
    }
}
