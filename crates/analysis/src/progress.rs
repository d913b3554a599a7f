//! Progress of long work: to the session, else as a line on a terminal's standard error.

use std::time::{Duration, Instant};

use rivet_files::StatusLine;

use crate::session;
use crate::steps::Steps;

/// Time between two pictures of the line.
const BETWEEN_PICTURES: Duration = Duration::from_millis(150);
/// Work that has taken less says nothing of what is left.
const LEAST_ELAPSED: Duration = Duration::from_secs(1);

/// How far a long piece of work is that consists of parts like each other.
pub struct Progress {
    what: &'static str,
    total: usize,
    begin: Instant,
    shown: Option<Instant>,
    line: StatusLine,
}

impl Progress {
    /// None of `total` parts is done of the work that `what` names.
    pub fn new(what: &'static str, total: usize) -> Progress {
        Progress { what, total: total.max(1), begin: Instant::now(), shown: None, line: StatusLine::new(true) }
    }

    /// `done` of the total: passed to the session, else drawn a few times a second.
    pub fn set(&mut self, done: usize) {
        if session::progress(self.what, (done as f64 / self.total as f64).min(1.0)) {
            return;
        }
        let due = self.shown.is_none_or(|at| at.elapsed() > BETWEEN_PICTURES);
        if due && self.line.is_shown() {
            self.shown = Some(Instant::now());
            self.line.draw(&counted(self.what, done, self.total, self.begin.elapsed()));
        }
    }

    /// As [`set`](Self::set), where the total is known only now.
    pub fn set_of(&mut self, done: usize, total: usize) {
        self.total = total.max(1);
        self.set(done);
    }

    /// Removes the line.
    pub fn done(&mut self) {
        self.line.remove();
    }
}

/// Parts done, with the time that the others take if they are like these.
fn counted(what: &str, done: usize, total: usize, elapsed: Duration) -> String {
    let remaining = total.saturating_sub(done);
    if done == 0 || remaining == 0 || elapsed < LEAST_ELAPSED {
        return format!("{what}: {done} of {total}");
    }
    let seconds = elapsed.as_secs_f64() * remaining as f64 / done as f64;
    format!("{what}: {done} of {total}, about {} left", rounded(seconds))
}

/// A duration \[s\] as `9 s` or `3 min`.
fn rounded(seconds: f64) -> String {
    if seconds < 99.5 { format!("{:.0} s", seconds.ceil()) } else { format!("{:.0} min", (seconds / 60.0).ceil()) }
}

/// How far a diagnosis is, from what it says.
pub struct DiagnosisProgress {
    what: &'static str,
    steps: Steps,
    begin: Instant,
    /// When counts were shown last.
    counted: Option<Instant>,
    line: StatusLine,
}

impl DiagnosisProgress {
    /// Of a diagnosis that begins now; `what` names it.
    pub fn new(what: &'static str) -> DiagnosisProgress {
        let line = StatusLine::new(true);
        DiagnosisProgress { what, steps: Steps::default(), begin: Instant::now(), counted: None, line }
    }

    /// Takes a line of the diagnosis: passed to the session, else drawn.
    pub fn say(&mut self, text: &str) {
        self.steps.take(text, self.begin.elapsed().as_secs_f64());
        self.show();
    }

    /// Takes how many of the present round's candidates are done, a few times a second.
    pub fn count(&mut self, done: usize, total: usize) {
        if self.counted.is_none_or(|at| at.elapsed() > BETWEEN_PICTURES) {
            self.counted = Some(Instant::now());
            self.steps.count(done, total);
            self.show();
        }
    }

    fn show(&mut self) {
        if !session::progress(self.what, self.steps.share()) {
            self.draw();
        }
    }

    /// Draws how far it is by now.
    pub fn draw(&mut self) {
        let elapsed_s = self.begin.elapsed().as_secs_f64();
        let remaining = self.steps.remaining_s(elapsed_s).map_or(String::new(), |(seconds, is_least)| {
            let word = if is_least { "at least" } else { "about" };
            format!(", {word} {} left", rounded(seconds))
        });
        self.line.draw(&format!("{}: {}{remaining}", self.what, self.steps.name()));
    }

    /// Removes the line.
    pub fn done(&mut self) {
        self.line.remove();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_parts_and_the_time_of_the_others() {
        let text = |done, seconds| counted("fit effects", done, 380, Duration::from_secs(seconds));
        assert_eq!(text(212, 11), "fit effects: 212 of 380, about 9 s left");
        assert_eq!(text(1, 2), "fit effects: 1 of 380, about 13 min left");
        // Nothing is known of the rest at the beginning, and nothing is left at the end.
        assert_eq!(
            [text(0, 20), text(3, 0), text(380, 9)],
            ["0", "3", "380"].map(|k| format!("fit effects: {k} of 380"))
        );
    }
}
