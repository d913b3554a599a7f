//! How far a fleet is, and the time that is left.

use std::time::Duration;

/// Progress of a fleet, in pairs and in bytes of logs.
#[derive(Clone, Debug, Default)]
pub struct Progress {
    /// Pairs of the command.
    pub pairs: usize,
    /// Pairs that have a row.
    pub finished: usize,
    /// Of these, failed ones.
    pub failed: usize,
    /// Diagnoses at a time.
    pub workers: usize,
    /// Bytes of the pairs that are not finished.
    pub bytes_left: u64,
    /// Bytes of the diagnoses that were made.
    pub bytes_diagnosed: u64,
    /// Time that they took, summed.
    pub diagnosing: Duration,
    /// Time for which the diagnoses that are being made have run, summed.
    pub running: Duration,
}

impl Progress {
    /// Time until all pairs are finished, from the time per byte of the diagnoses that were made; none before the first one.
    pub fn time_left(&self) -> Option<Duration> {
        if self.bytes_diagnosed == 0 || self.workers == 0 {
            return None;
        }
        let per_byte = self.diagnosing.as_secs_f64() / self.bytes_diagnosed as f64;
        let work_s = (self.bytes_left as f64 * per_byte - self.running.as_secs_f64()).max(0.0);
        Some(Duration::from_secs_f64(work_s / self.workers as f64))
    }

    /// The progress in one line.
    pub fn line(&self) -> String {
        let Progress { pairs, finished, failed, .. } = self;
        let percent = 100 * finished / (*pairs).max(1);
        let failed = if *failed > 0 { format!(", {failed} failed") } else { String::new() };
        let remaining = match self.time_left() {
            _ if finished == pairs => String::new(),
            Some(time) => format!(", {} left", rounded(time)),
            None => ", time left unknown".to_owned(),
        };
        format!("diagnosing {finished} of {pairs} ({percent} %){failed}{remaining}")
    }
}

/// A duration in its two largest units.
fn rounded(time: Duration) -> String {
    let s = time.as_secs();
    match s {
        0..60 => format!("{s} s"),
        60..3600 => format!("{} min {} s", s / 60, s % 60),
        3600..86_400 => format!("{} h {} min", s / 3600, s / 60 % 60),
        _ => format!("{} d {} h", s / 86_400, s / 3600 % 24),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_left_follows_the_bytes_and_what_runs() {
        let mut work = Progress { pairs: 10, workers: 2, bytes_left: 6000, ..Progress::default() };
        assert_eq!(work.time_left(), None);
        assert_eq!(work.line(), "diagnosing 0 of 10 (0 %), time left unknown");
        // 10 ms a byte: 60 s of work, of which 20 s are done, on two workers.
        work = Progress { finished: 4, failed: 1, bytes_diagnosed: 3000, diagnosing: Duration::from_secs(30), ..work };
        work.running = Duration::from_secs(20);
        assert_eq!(work.time_left(), Some(Duration::from_secs(20)));
        assert_eq!(work.line(), "diagnosing 4 of 10 (40 %), 1 failed, 20 s left");
        work.running = Duration::from_secs(100);
        assert_eq!(work.time_left(), Some(Duration::ZERO));
    }

    #[test]
    fn durations_have_their_two_largest_units() {
        let text = |s| rounded(Duration::from_secs(s));
        assert_eq!([text(59), text(61), text(7260), text(90_000)], ["59 s", "1 min 1 s", "2 h 1 min", "1 d 1 h"]);
    }
}
