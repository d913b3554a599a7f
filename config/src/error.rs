//! What is wrong with a robot file, said once, to the person who can change it.

use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

use rivet_files::is_unsafe;

/// Longest value or source line shown in a message \[characters\].
const LONGEST_VALUE: usize = 48;
const LONGEST_LINE: usize = 96;
/// Most mistakes shown of one file: of text that is no robot file every line is one.
const MOST_SHOWN: usize = 200;

/// Most mistakes kept of one file: the time that each takes grows with the length of the file.
pub(crate) const MOST_KEPT: usize = 400;
/// Longest word that is compared with known names \[bytes\].
const LONGEST_WORD: usize = 64;

/// The text of a file with the start of each of its lines: a place is found without counting the lines before it.
pub(crate) struct Source<'a> {
    pub(crate) file: &'a Path,
    pub(crate) text: &'a str,
    starts: Vec<usize>,
}

impl<'a> Source<'a> {
    pub(crate) fn new(file: &'a Path, text: &'a str) -> Source<'a> {
        let starts = std::iter::once(0).chain(text.match_indices('\n').map(|(at, _)| at + 1)).collect();
        Source { file, text, starts }
    }

    /// The line (from 1) of a byte.
    pub(crate) fn line(&self, byte: usize) -> usize {
        self.starts.partition_point(|start| *start <= byte).max(1)
    }
}

/// One mistake, at one place of one file.
///
/// `Display` gives `file:line:column: key = value: rule; hint`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConfigError {
    /// The file the place is in, as the caller named it.
    pub file: PathBuf,
    /// Line, from 1; 0 where it is the file as a whole.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    /// The key with its section, for example `drive.gear_ratio[3]` (joint 3); empty where the text is no TOML at all.
    pub key: String,
    /// The value as written, shortened; `(missing)` for a key that is not there.
    pub value: String,
    /// The rule it breaks.
    pub rule: String,
    /// What to do about it.
    pub hint: String,
    /// The source line and the marked part of it, in characters.
    snippet: Option<(String, Range<usize>)>,
}

impl ConfigError {
    /// An error at bytes `span` of a file's text.
    pub(crate) fn at(
        source: &Source<'_>,
        span: &Range<usize>,
        key: impl Into<String>,
        value: &str,
        rule: impl Into<String>,
        hint: impl Into<String>,
    ) -> ConfigError {
        let text = source.text;
        let start = floor_boundary(text, span.start);
        let end = floor_boundary(text, span.end.max(start));
        let line = source.line(start);
        let line_start = source.starts[line - 1];
        let line_end = text[start..].find('\n').map_or(text.len(), |i| start + i);
        let column = text[line_start..start].chars().count() + 1;
        let marked = text[start..end.min(line_end).max(start)].chars().count().max(1);
        ConfigError {
            file: source.file.to_path_buf(),
            line,
            column,
            key: key.into(),
            value: shorten(value),
            rule: rule.into(),
            hint: hint.into(),
            snippet: Some(window(text[line_start..line_end].trim_end_matches('\r'), column - 1..column - 1 + marked)),
        }
    }

    /// An error without a place of its own: what should be there is not. Reported at the start of the file.
    pub(crate) fn nowhere(
        file: &Path,
        key: impl Into<String>,
        value: &str,
        rule: impl Into<String>,
        hint: impl Into<String>,
    ) -> ConfigError {
        ConfigError {
            file: file.to_path_buf(),
            line: 1,
            column: 1,
            key: key.into(),
            value: shorten(value),
            rule: rule.into(),
            hint: hint.into(),
            snippet: None,
        }
    }

    /// An error of the file as a whole: it cannot be read.
    pub(crate) fn of_file(file: &Path, rule: impl Into<String>, hint: impl Into<String>) -> ConfigError {
        ConfigError { line: 0, column: 0, ..ConfigError::nowhere(file, "", "", rule, hint) }
    }
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let escape = rivet_files::printable;
        write!(f, "{}", escape(&self.file.to_string_lossy()))?;
        match self.line {
            0 => f.write_str(": ")?,
            line => write!(f, ":{line}:{}: ", self.column)?,
        }
        match (self.key.is_empty(), self.value.is_empty()) {
            (false, false) => write!(f, "{} = {}: ", escape(&self.key), escape(&self.value))?,
            (false, true) => write!(f, "{}: ", escape(&self.key))?,
            (true, false) => write!(f, "{}: ", escape(&self.value))?,
            (true, true) => {}
        }
        // Lines to paste into a file stay lines.
        write!(f, "{}; {}", escape(&self.rule), rivet_files::Printable(&self.hint))
    }
}

impl std::error::Error for ConfigError {}

/// All mistakes of a file, in the order of the text. Never empty.
///
/// `Display` gives each of the first 200 with its source line and a caret below the place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConfigErrors {
    errors: Vec<ConfigError>,
}

impl ConfigErrors {
    pub(crate) fn new(mut errors: Vec<ConfigError>) -> ConfigErrors {
        errors.sort_by(|a, b| (&a.file, a.line, a.column).cmp(&(&b.file, b.line, b.column)));
        errors.dedup();
        ConfigErrors { errors }
    }

    /// The mistakes, in the order of the text.
    pub fn errors(&self) -> &[ConfigError] {
        &self.errors
    }
}

impl fmt::Display for ConfigErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let [whole] = &self.errors[..]
            && whole.line == 0
        {
            return write!(f, "{whole}");
        }
        for error in self.errors.iter().take(MOST_SHOWN) {
            writeln!(f, "{error}")?;
            let Some((line, marked)) = &error.snippet else { continue };
            let shown: String = line.chars().map(|c| if is_unsafe(c) { ' ' } else { c }).collect();
            let number = error.line.to_string();
            let carets = marked.len().min(LONGEST_LINE.saturating_sub(marked.start)).max(1);
            writeln!(f, " {number} | {shown}")?;
            writeln!(f, " {:1$} | {2:3$}{4}", "", number.len(), "", marked.start, "^".repeat(carets))?;
        }
        match self.errors.len() {
            1 => write!(f, "1 mistake"),
            n if n >= MOST_KEPT => write!(f, "{n} mistakes or more, of which the first {MOST_SHOWN} are shown"),
            n if n > MOST_SHOWN => write!(f, "{n} mistakes, of which the first {MOST_SHOWN} are shown"),
            n => write!(f, "{n} mistakes"),
        }
    }
}

impl std::error::Error for ConfigErrors {}

/// What is shown of a line: a long array is shown around the marked entry only.
fn window(line: &str, marked: Range<usize>) -> (String, Range<usize>) {
    let first = if marked.end > LONGEST_LINE { marked.start.saturating_sub(LONGEST_LINE / 2) } else { 0 };
    let shown = line.chars().skip(first).take(LONGEST_LINE).collect();
    (shown, marked.start - first..marked.end - first)
}

/// The last character boundary at or before byte `i`.
fn floor_boundary(text: &str, i: usize) -> usize {
    let mut i = i.min(text.len());
    while !text.is_char_boundary(i) {
        i -= 1;
    }
    i
}

/// One line, at most [`LONGEST_VALUE`] characters.
fn shorten(value: &str) -> String {
    let line = value.split_whitespace().collect::<Vec<_>>().join(" ");
    if line.chars().count() <= LONGEST_VALUE {
        return line;
    }
    line.chars().take(LONGEST_VALUE - 3).chain("...".chars()).collect()
}

/// The candidate nearest to `word`, if it is near enough to be what was meant.
pub(crate) fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    if word.len() > LONGEST_WORD {
        return None;
    }
    candidates
        .into_iter()
        .map(|c| (edit_distance(&word.to_lowercase(), &c.to_lowercase()), c))
        .min()
        .filter(|(d, c)| *d <= (c.len().max(word.len()) / 3).max(1))
        .map(|(_, c)| c)
}

/// Levenshtein distance: insertions, deletions and replacements that turn `a` into `b`.
fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, ca) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, cb) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(ca != *cb);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distance_and_nearest_word() {
        assert_eq!(edit_distance("kitten", "sitting"), 3);
        assert_eq!(nearest("gear_ration", ["gear_ratio", "rotor_inertia"]), Some("gear_ratio"));
        assert_eq!(nearest("colour", ["gear_ratio", "rotor_inertia"]), None);
    }

    #[test]
    fn place_counts_characters_not_bytes() {
        let text = "a = 1\n\"ü\" = -2\n";
        let start = text.find("-2").expect("in the text");
        let error = ConfigError::at(
            &Source::new(Path::new("r.toml"), text),
            &(start..start + 2),
            "ü",
            "-2",
            "must be > 0",
            "try 2",
        );
        assert_eq!((error.line, error.column), (2, 7));
        assert_eq!(error.to_string(), "r.toml:2:7: ü = -2: must be > 0; try 2");
    }
}
