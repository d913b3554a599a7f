//! How a text table is written: separator, decimal mark, comments, header.

use crate::listing::Conventions;

/// Bytes at the beginning of a file that decide.
pub(crate) const SNIFFED_BYTES: u64 = 256 << 10;
/// Lines that are looked at for a decimal comma.
const SNIFFED_LINES: usize = 20;

/// What stands between two cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Separator {
    /// One byte.
    Byte(u8),
    /// Any number of blanks and tabs.
    Blanks,
}

/// How a text table is written.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Dialect {
    pub(crate) separator: Separator,
    /// Whether numbers have a comma before their decimals.
    pub(crate) decimal_comma: bool,
    /// Whether the first line without a comment is the header.
    pub(crate) has_header: bool,
    /// Names of the columns where the header is a comment line, or where there is none.
    pub(crate) names: Option<Vec<String>>,
    /// First cells of the table, below the header.
    pub(crate) first: Vec<String>,
    /// Whose conventions the comments above it state.
    pub(crate) conventions: Conventions,
}

/// Whether a line is a comment.
pub(crate) fn is_comment(line: &[u8]) -> bool {
    let line = line.trim_ascii_start();
    matches!(line.first(), Some(b'#' | b'%')) || line.starts_with(b"//")
}

impl Dialect {
    /// The dialect of a file that begins with `text`.
    pub(crate) fn of(text: &str) -> Dialect {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let lines: Vec<&str> = text.lines().filter(|line| !line.trim().is_empty()).collect();
        let content: Vec<&str> =
            lines.iter().copied().filter(|line| !is_comment(line.as_bytes())).take(SNIFFED_LINES).collect();
        let is_comment_line = |line: &&&str| is_comment(line.trim_start_matches('"').as_bytes());
        let above: Vec<&str> = lines.iter().take_while(is_comment_line).copied().collect();
        let conventions = Conventions::stated(&above.join("\n"));
        let Some(first) = content.first().copied() else {
            let empty = Vec::new();
            return Dialect {
                separator: Separator::Byte(b','),
                decimal_comma: false,
                has_header: true,
                names: None,
                first: empty,
                conventions,
            };
        };
        let separator = separator(first, content.get(1).copied());
        let decimal_comma =
            separator != Separator::Byte(b',') && content.iter().any(|line| has_decimal_comma(&cells(line, separator)));
        let numeric = |cell: &String| is_number(cell, decimal_comma);
        let top = cells(first, separator);
        // The comment line right above the table may be its header.
        let place = lines.iter().position(|line| *line == first).unwrap_or(0);
        let comment = place.checked_sub(1).map(|above| header_of_comment(lines[above], separator));
        let comment = comment.filter(|names| {
            names.len() == top.len() && top.len() > 1 && top.iter().any(numeric) && !names.iter().any(numeric)
        });
        let is_data = |cell: &String| numeric(cell) || cell.is_empty();
        let has_header = comment.is_none() && !top.iter().all(is_data);
        let names = comment.or_else(|| (!has_header).then(|| (1..=top.len()).map(|k| format!("column{k}")).collect()));
        let first = if has_header { content.get(1).map_or_else(Vec::new, |line| cells(line, separator)) } else { top };
        Dialect { separator, decimal_comma, has_header, names, first, conventions }
    }
}

/// The separator of a table whose first lines these are.
fn separator(first: &str, second: Option<&str>) -> Separator {
    let outside = outside_quotes(first);
    let blank = |c: char| c == ' ' || c == '\t';
    let blanks_make_numbers = |line: &str| {
        let words: Vec<&str> = line.split(blank).filter(|word| !word.is_empty()).collect();
        words.len() > 1 && words.iter().all(|word| is_number(word.trim_matches('"'), true)) && line.contains(',')
    };
    if outside.contains(';') {
        Separator::Byte(b';')
    } else if outside.contains('\t') && second.is_none_or(|line| line.contains('\t')) {
        Separator::Byte(b'\t')
    } else if outside.contains('|') {
        Separator::Byte(b'|')
    } else if outside.contains(',') && !blanks_make_numbers(first) {
        Separator::Byte(b',')
    } else if outside.trim().contains(blank)
        && second.is_none_or(|line| !line.contains(',') || blanks_make_numbers(line))
    {
        Separator::Blanks
    } else {
        Separator::Byte(b',')
    }
}

/// A line without what stands in quotes.
fn outside_quotes(line: &str) -> String {
    line.split('"').step_by(2).collect()
}

/// The cells of a line, without quotes.
fn cells(line: &str, separator: Separator) -> Vec<String> {
    let mut cells = vec![String::new()];
    let (mut quoted, mut gap) = (false, false);
    for c in line.trim_matches(|c| c == ' ' || c == '\r').chars() {
        let ends = match separator {
            Separator::Byte(byte) => c == char::from(byte),
            Separator::Blanks => c == ' ' || c == '\t',
        };
        if c == '"' {
            quoted = !quoted;
        } else if ends && !quoted {
            if separator != Separator::Blanks || !gap {
                cells.push(String::new());
            }
            gap = true;
            continue;
        } else if let Some(cell) = cells.last_mut() {
            cell.push(c);
        }
        gap = false;
    }
    cells.iter().map(|cell| cell.trim().to_owned()).collect()
}

/// The names in a comment line: `# t q1`, `%time,q1`. A `%` without a blank behind it belongs to the name.
fn header_of_comment(line: &str, separator: Separator) -> Vec<String> {
    if !is_comment(line.as_bytes()) {
        return Vec::new();
    }
    let line = line.trim();
    let bare = line.trim_start_matches(['#', '/']);
    let bare = bare.strip_prefix("% ").unwrap_or(bare);
    cells(bare, separator)
}

/// Whether a cell is a number.
pub(crate) fn is_number(cell: &str, decimal_comma: bool) -> bool {
    parse(cell.as_bytes(), decimal_comma).is_some()
}

/// A cell as a number.
pub(crate) fn parse(cell: &[u8], decimal_comma: bool) -> Option<f64> {
    let cell = std::str::from_utf8(cell).ok()?.trim();
    if decimal_comma && cell.contains(',') { cell.replacen(',', ".", 1).parse().ok() } else { cell.parse().ok() }
}

fn has_decimal_comma(cells: &[String]) -> bool {
    cells.iter().any(|cell| cell.contains(',') && !cell.contains('.') && is_number(cell, true))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(text: &str) -> Vec<String> {
        Dialect::of(text).names.unwrap_or_default()
    }

    #[test]
    fn separators_and_decimal_marks_are_found() {
        let of = |text: &str| {
            let dialect = Dialect::of(text);
            (dialect.separator, dialect.decimal_comma, dialect.has_header)
        };
        assert_eq!(of("t,q1\n0,1\n"), (Separator::Byte(b','), false, true));
        assert_eq!(of("t;q1\n0;1,5\n"), (Separator::Byte(b';'), true, true));
        assert_eq!(of("t\tq1\n0\t1.5\n"), (Separator::Byte(b'\t'), false, true));
        assert_eq!(of("t  q1 \n0 1.5\n"), (Separator::Blanks, false, true));
        assert_eq!(of("0,00 1,5\n0,01 1,6\n"), (Separator::Blanks, true, false));
        assert_eq!(of("t [s],q1 [rad]\n0,1\n"), (Separator::Byte(b','), false, true));
        assert_eq!(of("\"a;b\",q1\n0,1\n"), (Separator::Byte(b','), false, true));
        assert_eq!(of(""), (Separator::Byte(b','), false, true));
    }

    #[test]
    fn header_may_be_a_comment_or_missing() {
        assert_eq!(names("%time,q1\n0,1\n"), ["%time", "q1"]);
        assert_eq!(names("# t q1 tau1\n0 1 2\n"), ["t", "q1", "tau1"]);
        assert_eq!(names("0,1,2\n"), ["column1", "column2", "column3"]);
        assert_eq!(Dialect::of("% recorded by x\nt,q1\n0,1\n").names, None);
        assert_eq!(
            Dialect::of("%time,name,q1\n0,elbow,1\n").names,
            Some(vec!["%time".into(), "name".into(), "q1".into()])
        );
    }
}
