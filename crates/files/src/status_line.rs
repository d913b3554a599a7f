//! One line on the terminal's standard error, drawn over again and again.

use std::io::{IsTerminal as _, Write as _};
use std::sync::atomic::{AtomicBool, Ordering};

/// Columns of a terminal that does not report them.
const USUAL_COLUMNS: usize = 80;

/// Returns to the first column and clears the row.
const CLEAR: &str = "\r\x1b[K";
/// Whether a line of this process stands on the terminal.
static IS_DRAWN: AtomicBool = AtomicBool::new(false);

/// What another line has to begin with, so that it does not stand behind a status line. The status line comes again with its next text.
pub(crate) fn cleared() -> &'static str {
    if IS_DRAWN.swap(false, Ordering::Relaxed) { CLEAR } else { "" }
}

/// The line. Nothing is written where standard error is no terminal, or a dumb one (`TERM=dumb`).
#[derive(Debug)]
pub struct StatusLine {
    is_shown: bool,
    is_drawn: bool,
}

impl StatusLine {
    /// `is_wanted`: false where nothing is to be drawn on any terminal.
    pub fn new(is_wanted: bool) -> StatusLine {
        let is_dumb = || std::env::var_os("TERM").is_some_and(|term| term == "dumb");
        StatusLine { is_shown: is_wanted && std::io::stderr().is_terminal() && !is_dumb(), is_drawn: false }
    }

    /// Whether it is shown.
    pub fn is_shown(&self) -> bool {
        self.is_shown
    }

    /// Draws `text`, cut to the width of the terminal, in the place of what was drawn before.
    pub fn draw(&mut self, text: &str) {
        if !self.is_shown {
            return;
        }
        self.is_drawn = true;
        IS_DRAWN.store(true, Ordering::Relaxed);
        let reported = rustix::termios::tcgetwinsize(std::io::stderr()).map_or(0, |size| usize::from(size.ws_col));
        // A terminal that is gone is no reason to stop.
        let _ = write!(std::io::stderr(), "\r{}\x1b[K", cut(text, reported));
    }

    /// Removes it, before another line is printed and at the end.
    pub fn remove(&mut self) {
        if std::mem::take(&mut self.is_drawn) {
            IS_DRAWN.store(false, Ordering::Relaxed);
            let _ = write!(std::io::stderr(), "{CLEAR}");
        }
    }
}

/// As much of a text as a terminal of so many columns has room for without a second row; 0 where they are not known.
fn cut(text: &str, columns: usize) -> &str {
    let columns = if columns == 0 { USUAL_COLUMNS } else { columns };
    let end = text.char_indices().nth(columns.saturating_sub(1)).map_or(text.len(), |(end, _)| end);
    &text[..end]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_never_takes_a_second_row() {
        let text = "ü".repeat(200);
        assert_eq!([0, 80, 100, 1].map(|columns| cut(&text, columns).chars().count()), [79, 79, 99, 0]);
        assert_eq!(cut("short", 80), "short");
    }

    /// A line that is printed over a status line clears it first, once.
    #[test]
    fn another_line_clears_what_is_drawn() {
        let mut line = StatusLine { is_shown: true, is_drawn: false };
        line.draw("17 of 20");
        assert_eq!([cleared(), cleared()], [CLEAR, ""]);
        line.draw("18 of 20");
        line.remove();
        assert_eq!(cleared(), "");
    }

    #[test]
    fn nothing_is_drawn_where_there_is_no_terminal() {
        let mut line = StatusLine { is_shown: false, is_drawn: false };
        line.draw("text");
        assert!(!line.is_shown() && !line.is_drawn);
    }
}
