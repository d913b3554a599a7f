//! Plain tables and paragraphs of at most 100 columns.

use std::fmt::Write as _;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Widest line that is printed.
pub const WIDTH: usize = 100;
/// Fewer columns are taken as these: a word in each line is no text.
const NARROWEST: usize = 60;

/// Rows of text cells; the first column is left-aligned, the others right-aligned.
pub struct Table {
    rows: Vec<Vec<String>>,
}

impl Table {
    /// A table with the cells of its first row.
    pub fn new<S: Into<String>>(head: impl IntoIterator<Item = S>) -> Table {
        Table { rows: vec![head.into_iter().map(Into::into).collect()] }
    }

    /// Adds a row.
    pub fn row(&mut self, cells: impl IntoIterator<Item = String>) {
        self.rows.push(cells.into_iter().collect());
    }

    /// The table, indented by two. Where the lines would be too long, heads are broken at spaces; then the first column is shortened.
    pub fn text(&self) -> String {
        self.text_within(columns())
    }

    /// The same in so many columns.
    fn text_within(&self, width: usize) -> String {
        let Some((head, rows)) = self.rows.split_first() else { return String::new() };
        let count = self.rows.iter().map(Vec::len).max().unwrap_or(0);
        let length = |text: &String| text.chars().count();
        let longest = |rows: &[Vec<String>], c: usize| rows.iter().filter_map(|r| r.get(c)).map(length).max();
        let mut widths: Vec<usize> = (0..count).map(|c| longest(&self.rows, c).unwrap_or(0)).collect();
        let word = |c: usize| head.get(c).into_iter().flat_map(|text| text.split(' ')).map(|w| w.chars().count()).max();
        let least: Vec<usize> = (0..count).map(|c| longest(rows, c).max(word(c)).unwrap_or(0)).collect();
        while 2 * count + widths.iter().sum::<usize>() > width {
            let Some(widest) = (1..count).filter(|c| widths[*c] > least[*c]).max_by_key(|c| widths[*c]) else { break };
            widths[widest] -= 1;
        }
        let others: usize = widths.iter().skip(1).map(|w| w + 2).sum();
        if let Some(first) = widths.first_mut() {
            *first = (*first).min(width.saturating_sub(2 + others)).max(4);
        }
        let broken: Vec<Vec<String>> = head.iter().zip(&widths).map(|(text, width)| lines_of(text, *width)).collect();
        let lines = broken.iter().map(Vec::len).max().unwrap_or(0);
        // The last line of each head stands above its column.
        let line = |k: usize| -> Vec<String> {
            let cell = |cell: &Vec<String>| (k + cell.len()).checked_sub(lines).map(|at| cell[at].clone());
            broken.iter().map(|head| cell(head).unwrap_or_default()).collect()
        };
        let rows: Vec<Vec<String>> = (0..lines).map(line).chain(rows.iter().cloned()).collect();
        let firsts: Vec<&str> = rows.iter().map(|r| r.first().map_or("", String::as_str)).collect();
        let firsts = labels(&firsts, widths.first().copied().unwrap_or(0));
        let mut out = String::new();
        for (row, first) in rows.iter().zip(&firsts) {
            let mut line = String::from(" ");
            for (c, cell) in row.iter().enumerate() {
                // Writing to a String cannot fail, here and below.
                if c == 0 {
                    let _ = write!(line, " {:<1$}", first, widths[0]);
                } else {
                    let _ = write!(line, "  {:>1$}", cell, widths[c]);
                }
            }
            let _ = writeln!(out, "{}", line.trim_end());
        }
        out
    }
}

/// A text broken at spaces into lines of at most `width` characters; a longer word has a line of its own.
fn lines_of(text: &str, width: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split(' ') {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// Texts that are too long by beginning and end; by their ends where those are another one's too.
fn labels(texts: &[&str], width: usize) -> Vec<String> {
    let short: Vec<String> = texts.iter().map(|text| without_middle(text, width)).collect();
    let twice = |k: usize| (0..texts.len()).any(|i| texts[i] != texts[k] && short[i] == short[k]);
    (0..texts.len()).map(|k| if twice(k) { shortened(texts[k], width) } else { short[k].clone() }).collect()
}

fn without_middle(text: &str, width: usize) -> String {
    let (count, kept) = (text.chars().count(), width.saturating_sub(2));
    if count <= width {
        return text.to_owned();
    }
    let first = (2 * kept).div_ceil(3);
    let (begin, end): (String, String) =
        (text.chars().take(first).collect(), text.chars().skip(count + first - kept).collect());
    format!("{begin}..{end}")
}

/// The end of a text that is too long, after two dots.
fn shortened(text: &str, width: usize) -> String {
    let count = text.chars().count();
    if count <= width {
        text.to_owned()
    } else {
        format!("..{}", text.chars().skip(count + 2 - width).collect::<String>())
    }
}

/// Breaks a text at spaces; the first line starts with `first`, the others with as many spaces.
pub fn paragraph(first: &str, text: &str) -> String {
    paragraph_within(columns(), first, text)
}

/// Columns of paragraphs.
static COLUMNS: AtomicUsize = AtomicUsize::new(WIDTH);

/// Sets the columns of all texts of this process, such as those of its terminal; [`WIDTH`] at most.
pub fn set_columns(columns: usize) {
    COLUMNS.store(columns.clamp(NARROWEST, WIDTH), Ordering::Relaxed);
}

/// Columns of the texts of this process.
pub(crate) fn columns() -> usize {
    COLUMNS.load(Ordering::Relaxed)
}

/// The same in so many columns.
pub fn paragraph_within(width: usize, first: &str, text: &str) -> String {
    let indent = first.chars().count();
    let mut out = first.to_owned();
    let mut column = indent;
    for (k, word) in text.split_whitespace().enumerate() {
        let length = word.chars().count();
        if k > 0 && column + 1 + length > width {
            let _ = write!(out, "\n{:indent$}", "");
            column = indent;
        } else if k > 0 {
            out.push(' ');
            column += 1;
        }
        out.push_str(word);
        column += length;
    }
    out.push('\n');
    out
}

/// A number with `digits` significant digits, plain between 1e-3 and 1e5.
pub fn number(x: f64, digits: usize) -> String {
    if x == 0.0 || !x.is_finite() {
        return format!("{x}");
    }
    let magnitude = x.abs().log10().floor();
    if (-3.0..5.0).contains(&magnitude) {
        let decimals = (digits as f64 - 1.0 - magnitude).max(0.0) as usize;
        format!("{x:.decimals$}")
    } else {
        format!("{x:.*e}", digits.saturating_sub(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_line_up_and_stay_narrow() {
        let mut table = Table::new(["joint", "a", "bbb"]);
        table.row(["a_very_long_joint_name_".repeat(8), "1".into(), "2".into()]);
        table.row(["short".into(), "100".into(), "3.5".into()]);
        let text = table.text();
        assert!(text.lines().all(|line| line.chars().count() <= WIDTH), "{text}");
        assert!(text.lines().nth(2).is_some_and(|line| line.ends_with("100  3.5")), "{text}");
        let long = paragraph("  log: ", &"word ".repeat(60));
        assert!(long.lines().all(|line| line.chars().count() <= WIDTH), "{long}");
        assert!(long.lines().nth(1).is_some_and(|line| line.starts_with("       word")), "{long}");
    }

    /// Heads wider than their columns are broken where the terminal is narrow, and stay whole where it is not.
    #[test]
    fn heads_are_broken_on_a_narrow_terminal() {
        let mut table = Table::new(["gap by joint [%]", "nominal", "in motion, nominal [x noise]", "with causes"]);
        table.row(["shoulder_pan_joint".into(), "20.8".into(), "22".into(), "0.98".into()]);
        let wide = table.text_within(100);
        assert_eq!(wide.lines().count(), 2, "{wide}");
        let narrow = table.text_within(60);
        assert!(narrow.lines().all(|line| line.chars().count() <= 60), "{narrow}");
        assert!(narrow.lines().count() > wide.lines().count(), "{narrow}");
        assert!(table.text_within(44).lines().all(|line| line.chars().count() <= 44), "{}", table.text_within(44));
    }

    /// Two effects of one ending each keep what tells them apart.
    #[test]
    fn labels_that_are_cut_stay_apart() {
        let labels = labels(&["load_dependent_friction", "position_dependent_friction", "viscous_nonlinearity"], 18);
        assert_eq!(labels, ["load_depend..ction", "position_de..ction", "viscous_non..arity"]);
        assert_eq!(
            super::labels(&["the_left_joint_1_of_it", "the_left_joint_2_of_it"], 10),
            [".._1_of_it", ".._2_of_it"]
        );
        assert_eq!(super::labels(&["a_joint_of_a_long_name", "joint"], 10), ["a_join..me", "joint"]);
    }

    #[test]
    fn numbers_have_the_digits_asked_for() {
        for (x, text) in [(0.0, "0"), (12.3456, "12.3"), (-0.0123456, "-0.0123"), (1234.5, "1234"), (1e-7, "1.00e-7")] {
            assert_eq!(number(x, 3), text);
        }
    }
}
