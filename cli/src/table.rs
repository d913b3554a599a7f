//! Text on standard output, in the columns of its terminal.

use std::io::{IsTerminal as _, Write as _};

use anyhow::Result;
use ratatui::crossterm::terminal;
pub(crate) use rivet_analysis::table::{Table, number, paragraph, paragraph_within};

/// Takes the columns of the terminal for all texts; does nothing where standard output is no terminal.
pub(crate) fn fit_terminal() {
    if let Some((columns, _)) = std::io::stdout().is_terminal().then(|| terminal::size().ok()).flatten() {
        rivet_analysis::table::set_columns(usize::from(columns));
    }
}

/// Writes to standard output, with unsafe characters escaped. A reader that has seen enough (`| head`) is no failure.
pub(crate) fn show(text: &str) -> std::io::Result<()> {
    rivet_files::print(&rivet_files::Printable(text).to_string())
}

/// Columns of the words at the left of a verdict's lines.
const HEAD: std::ops::Range<usize> = 2..14;

/// The same for a verdict: the words at its left are bold where standard output is a terminal that has styles and `NO_COLOR` is not set.
///
/// # Errors
/// As of [`show`].
pub(crate) fn show_verdict(text: &str) -> std::io::Result<()> {
    let printable = rivet_files::Printable(text).to_string();
    if anstream::AutoStream::choice(&std::io::stdout()) == anstream::ColorChoice::Never {
        return rivet_files::print(&printable);
    }
    rivet_files::print(&with_bold_heads(&printable))
}

/// The first line and the words at the left of the lines after it in bold, until something else follows: names of joints may look the
/// same.
fn with_bold_heads(text: &str) -> String {
    let bold = anstyle::Style::new().bold();
    let (first, mut rest) = text.split_at(text.find('\n').unwrap_or(text.len()));
    let mut out = format!("{bold}{first}{bold:#}");
    for line in rest.split_inclusive('\n') {
        let is_head = line.starts_with("  ") && line[2..].starts_with(|c: char| c.is_ascii_uppercase());
        match (line.get(HEAD), line.get(HEAD.end..)) {
            (Some(head), Some(after)) if is_head => {
                out.push_str(&["  ", &bold.to_string(), head, &bold.render_reset().to_string(), after].concat());
            }
            _ if line == "\n" || line.starts_with("               ") => out.push_str(line),
            _ => break,
        }
        rest = &rest[line.len()..];
    }
    out + rest
}

/// The same where a reader that has seen enough ends the command.
///
/// # Errors
/// `BrokenPipe` among others.
pub(crate) fn show_to_reader(text: &str) -> std::io::Result<()> {
    let mut out = std::io::stdout().lock();
    out.write_all(rivet_files::Printable(text).to_string().as_bytes()).and_then(|()| out.flush())
}

/// The same for a picture that moves the terminal's cursor: its lines were made printable before.
pub(crate) use rivet_files::print as show_picture;

/// Writes a value as JSON to standard output: what `--json` of a command without a file is for.
pub(crate) fn show_json(value: &impl serde::Serialize) -> Result<()> {
    Ok(show(&rivet_files::printable_json(serde_json::to_string_pretty(value)? + "\n"))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heads_of_a_verdict_are_bold_and_its_tables_are_plain() {
        let text = "diagnose a: no gap\n  Do           Set it\n               and more\n  gap by joint\n  Joint1             0.1\n";
        let bold = "\u{1b}[1mdiagnose a: no gap\u{1b}[0m\n  \u{1b}[1mDo          \u{1b}[0m Set it\n               and more\n  gap by joint\n  Joint1             0.1\n";
        assert_eq!(with_bold_heads(text), bold);
    }
}
