//! A progress line on a terminal's standard error; silence elsewhere.

use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

/// How far a long piece of work is.
pub(crate) struct Progress {
    what: &'static str,
    total: usize,
    shown: Option<Instant>,
    terminal: bool,
}

impl Progress {
    pub(crate) fn new(what: &'static str, total: usize) -> Progress {
        Progress { what, total: total.max(1), shown: None, terminal: std::io::stderr().is_terminal() }
    }

    /// `done` of the total; drawn a few times a second.
    pub(crate) fn set(&mut self, done: usize) {
        let due = self.shown.is_none_or(|at| at.elapsed() > Duration::from_millis(150));
        if self.terminal && due {
            self.shown = Some(Instant::now());
            // A terminal that is gone is no reason to stop working.
            let _ = write!(std::io::stderr(), "\r{} {:3} %", self.what, 100 * done / self.total);
        }
    }

    /// Removes the line.
    pub(crate) fn done(&mut self) {
        if self.terminal && self.shown.is_some() {
            let _ = write!(std::io::stderr(), "\r\x1b[K");
        }
    }
}
