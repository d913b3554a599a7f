//! Progress of long work: to the session, else as a line on a terminal's standard error.

use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

use crate::session;

/// How far a long piece of work is.
pub struct Progress {
    what: &'static str,
    total: usize,
    shown: Option<Instant>,
    terminal: bool,
}

impl Progress {
    /// Nothing of `total` is done of the work that `what` names.
    pub fn new(what: &'static str, total: usize) -> Progress {
        Progress { what, total: total.max(1), shown: None, terminal: std::io::stderr().is_terminal() }
    }

    /// `done` of the total: passed to the session, else drawn a few times a second.
    pub fn set(&mut self, done: usize) {
        if session::progress(self.what, (done as f64 / self.total as f64).min(1.0)) {
            return;
        }
        let due = self.shown.is_none_or(|at| at.elapsed() > Duration::from_millis(150));
        if self.terminal && due {
            self.shown = Some(Instant::now());
            // A terminal that is gone is no reason to stop working.
            let _ = write!(std::io::stderr(), "\r{} {:3} %", self.what, 100 * done / self.total);
        }
    }

    /// Removes the line.
    pub fn done(&mut self) {
        if self.terminal && self.shown.is_some() {
            let _ = write!(std::io::stderr(), "\r\x1b[K");
        }
    }
}
