//! Text on standard output, in the columns of its terminal.

use std::io::{IsTerminal as _, Write as _};

use anstyle::{AnsiColor, Style};
use anyhow::Result;
use ratatui::crossterm::terminal;
pub(crate) use rivet_analysis::table::{Table, number, paragraph, paragraph_within};

/// Takes the columns of the terminal for all texts; does nothing where standard output is no terminal.
pub(crate) fn fit_terminal() {
    if let Some((columns, _)) = std::io::stdout().is_terminal().then(|| terminal::size().ok()).flatten() {
        rivet_analysis::table::set_columns(usize::from(columns));
    }
}

/// Writes to standard output, with unsafe characters escaped; the word "warning" is yellow where [`has_styles`]. A reader that has
/// seen enough (`| head`) is no failure.
pub(crate) fn show(text: &str) -> std::io::Result<()> {
    let printable = rivet_files::Printable(text).to_string();
    rivet_files::print(&if has_styles() { with_yellow_warnings(&printable) } else { printable })
}

/// Whether standard output is a terminal that has styles and `NO_COLOR` is not set.
fn has_styles() -> bool {
    anstream::AutoStream::choice(&std::io::stdout()) != anstream::ColorChoice::Never
}

/// Writes why a command failed to standard error; the name of the program is red where that has styles.
pub(crate) fn show_failure(why: &anyhow::Error) {
    let plain = anstream::AutoStream::choice(&std::io::stderr()) == anstream::ColorChoice::Never;
    let style = if plain { Style::new() } else { RED };
    rivet_files::note_after(&format!("{style}rivet:{style:#} "), format_args!("{why:#}"));
}

const GREEN: Style = AnsiColor::Green.on_default().bold();
const YELLOW: Style = AnsiColor::Yellow.on_default().bold();
const RED: Style = AnsiColor::Red.on_default().bold();

/// Before the text of a warning.
const WARNING: &str = "warning:";

fn with_yellow_warnings(text: &str) -> String {
    let line = |line: &str| match line.strip_prefix(WARNING) {
        Some(rest) => format!("{YELLOW}{WARNING}{YELLOW:#}{rest}"),
        None => line.to_owned(),
    };
    text.split_inclusive('\n').map(line).collect()
}

/// What stands in a verdict's lines where a model makes the simulator worse.
const WORSE: &str = "(worse)";

/// Columns of the words at the left of a verdict's lines.
const HEAD: std::ops::Range<usize> = 2..14;

/// The same for a verdict: where [`has_styles`], the words at its left are bold, and the verdict has the colour of its kind.
///
/// # Errors
/// As of [`show`].
pub(crate) fn show_verdict(text: &str) -> std::io::Result<()> {
    let printable = rivet_files::Printable(text).to_string();
    rivet_files::print(&if has_styles() { with_heads(&printable) } else { printable })
}

/// Green: nothing to do; yellow: a model to correct; red: no answer.
fn colour_of(verdict: &str) -> Style {
    match verdict {
        "no gap" => GREEN,
        "unexplained" | "not evaluated" => RED,
        _ => YELLOW,
    }
}

/// The first line and the words at the left of the lines after it in bold, until something else follows: names of joints may look the
/// same.
fn with_heads(text: &str) -> String {
    let bold = Style::new().bold();
    let (first, mut rest) = text.split_at(text.find('\n').unwrap_or(text.len()));
    let (of, verdict) = first.rsplit_once(": ").unwrap_or((first, ""));
    let colour = colour_of(verdict);
    let between = if verdict.is_empty() { "" } else { ": " };
    let mut out = format!("{bold}{of}{between}{bold:#}{colour}{verdict}{colour:#}");
    for line in rest.split_inclusive('\n') {
        let is_head = line.starts_with("  ") && line[2..].starts_with(|c: char| c.is_ascii_uppercase());
        let worse = |text: &str| text.replace(WORSE, &format!("{RED}{WORSE}{RED:#}"));
        match (line.get(HEAD), line.get(HEAD.end..)) {
            (Some(head), Some(after)) if is_head => {
                out.extend(["  ", &bold.to_string(), head, &format!("{bold:#}"), &worse(after)]);
            }
            _ if line == "\n" || line.starts_with("               ") => out.push_str(&worse(line)),
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
        let text = "diagnose a: no gap\n  Do           Set it\n               and (worse) more\n  gap by joint\n  Joint1             0.1\n";
        let [bold, off] = ["\u{1b}[1m", "\u{1b}[0m"];
        let shown = format!(
            "{bold}diagnose a: {off}{GREEN}no gap{off}\n  {bold}Do          {off} Set it\n               and {RED}(worse){off} more\n  \
             gap by joint\n  Joint1             0.1\n"
        );
        assert_eq!(with_heads(text), shown);
        assert_eq!(["missing effect", "not evaluated"].map(colour_of), [YELLOW, RED]);
    }

    #[test]
    fn only_the_word_of_a_warning_is_yellow() {
        let text = "a warning: none\nwarning: far off\n         and more\n";
        let shown = format!("a warning: none\n{YELLOW}warning:{YELLOW:#} far off\n         and more\n");
        assert_eq!(with_yellow_warnings(text), shown);
    }
}
