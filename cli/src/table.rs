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
