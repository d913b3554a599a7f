//! One line about a fleet that is being diagnosed.

use std::io::{IsTerminal as _, Write as _};
use std::time::{Duration, Instant};

/// Time between two drawings.
const REDRAW: Duration = Duration::from_millis(200);
/// A shorter run prints no lines where standard error is no terminal.
const SILENT: Duration = Duration::from_secs(2);
/// Columns of a terminal that does not report them.
const USUAL_COLUMNS: u16 = 80;
/// Where standard error is no terminal, one line for each so manieth part of the pairs.
const PARTS: usize = 10;

/// Work of a fleet in bytes of logs, from which the time that is left follows.
#[derive(Clone, Debug, Default)]
pub(crate) struct Work {
    pub(crate) pairs: usize,
    pub(crate) finished: usize,
    pub(crate) failed: usize,
    pub(crate) workers: usize,
    /// Bytes of the pairs that are not finished.
    pub(crate) bytes_left: u64,
    /// Bytes and time of the diagnoses that were made.
    pub(crate) bytes_diagnosed: u64,
    pub(crate) diagnosing: Duration,
    /// Time for which the diagnoses that are being made have run.
    pub(crate) running: Duration,
}

impl Work {
    /// Time until all pairs are finished, from the time per byte of the diagnoses that were made; none before the first one.
    pub(crate) fn time_left(&self) -> Option<Duration> {
        if self.bytes_diagnosed == 0 || self.workers == 0 {
            return None;
        }
        let per_byte = self.diagnosing.as_secs_f64() / self.bytes_diagnosed as f64;
        let work_s = (self.bytes_left as f64 * per_byte - self.running.as_secs_f64()).max(0.0);
        Some(Duration::from_secs_f64(work_s / self.workers as f64))
    }

    fn line(&self) -> String {
        let Work { pairs, finished, failed, .. } = self;
        let percent = 100 * finished / (*pairs).max(1);
        let failed = if *failed > 0 { format!(", {failed} failed") } else { String::new() };
        let left = match self.time_left() {
            _ if finished == pairs => String::new(),
            Some(left) => format!(", {} left", rounded(left)),
            None => ", time left unknown".to_owned(),
        };
        format!("diagnosing {finished} of {pairs} ({percent} %){failed}{left}")
    }
}

/// A duration in its two largest units.
pub(crate) fn rounded(time: Duration) -> String {
    let s = time.as_secs();
    match s {
        0..60 => format!("{s} s"),
        60..3600 => format!("{} min {} s", s / 60, s % 60),
        3600..86_400 => format!("{} h {} min", s / 3600, s / 60 % 60),
        _ => format!("{} d {} h", s / 86_400, s / 3600 % 24),
    }
}

/// The line on standard error: redrawn on a terminal, else printed ten times.
pub(crate) struct Line {
    is_terminal: bool,
    begin: Instant,
    drawn: Option<Instant>,
    /// Tenths that were printed.
    parts: usize,
}

impl Line {
    pub(crate) fn new() -> Line {
        let is_dumb = std::env::var_os("TERM").is_some_and(|term| term == "dumb");
        Line { is_terminal: std::io::stderr().is_terminal() && !is_dumb, begin: Instant::now(), drawn: None, parts: 0 }
    }

    pub(crate) fn show(&mut self, work: &Work) {
        if self.is_terminal {
            if self.drawn.is_none_or(|at| at.elapsed() >= REDRAW) {
                self.drawn = Some(Instant::now());
                let columns = ratatui::crossterm::terminal::size().map_or(USUAL_COLUMNS, |(columns, _)| columns);
                let line: String = work.line().chars().take(usize::from(columns).saturating_sub(1)).collect();
                // A terminal that is gone is no reason to stop working.
                let _ = write!(std::io::stderr(), "\r{line}\x1b[K");
            }
            return;
        }
        let parts = PARTS * work.finished / work.pairs.max(1);
        if parts > self.parts && self.begin.elapsed() >= SILENT {
            self.parts = parts;
            rivet_files::note(work.line());
        }
    }

    /// Removes the line from a terminal.
    pub(crate) fn clear(&mut self) {
        if self.drawn.take().is_some() {
            let _ = write!(std::io::stderr(), "\r\x1b[K");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_left_follows_the_bytes_and_what_runs() {
        let mut work = Work { pairs: 10, workers: 2, bytes_left: 6000, ..Work::default() };
        assert_eq!(work.time_left(), None);
        assert_eq!(work.line(), "diagnosing 0 of 10 (0 %), time left unknown");
        // 10 ms a byte: 60 s of work, of which 20 s are done, on two workers.
        work = Work { finished: 4, failed: 1, bytes_diagnosed: 3000, diagnosing: Duration::from_secs(30), ..work };
        work.running = Duration::from_secs(20);
        assert_eq!(work.time_left(), Some(Duration::from_secs(20)));
        assert_eq!(work.line(), "diagnosing 4 of 10 (40 %), 1 failed, 20 s left");
        work.running = Duration::from_secs(100);
        assert_eq!(work.time_left(), Some(Duration::ZERO));
    }

    #[test]
    fn durations_have_their_two_largest_units() {
        let of = |s| rounded(Duration::from_secs(s));
        assert_eq!([of(59), of(61), of(7260), of(90_000)], ["59 s", "1 min 1 s", "2 h 1 min", "1 d 1 h"]);
    }
}
