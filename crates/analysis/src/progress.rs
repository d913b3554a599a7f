//! Progress of long work: to the session, else as a line on a terminal's standard error.

use std::time::{Duration, Instant};

use rivet_files::StatusLine;

use crate::session;

/// How far a long piece of work is.
pub struct Progress {
    what: &'static str,
    total: usize,
    shown: Option<Instant>,
    line: StatusLine,
}

impl Progress {
    /// Nothing of `total` is done of the work that `what` names.
    pub fn new(what: &'static str, total: usize) -> Progress {
        Progress { what, total: total.max(1), shown: None, line: StatusLine::new(true) }
    }

    /// `done` of the total: passed to the session, else drawn a few times a second.
    pub fn set(&mut self, done: usize) {
        if session::progress(self.what, (done as f64 / self.total as f64).min(1.0)) {
            return;
        }
        let due = self.shown.is_none_or(|at| at.elapsed() > Duration::from_millis(150));
        if due && self.line.is_shown() {
            self.shown = Some(Instant::now());
            self.line.draw(&format!("{} {:3} %", self.what, 100 * done / self.total));
        }
    }

    /// Removes the line.
    pub fn done(&mut self) {
        self.line.remove();
    }
}
