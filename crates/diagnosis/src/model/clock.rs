//! Runs on one clock: the history of each from those before it.

use std::sync::Arc;

use crate::model::history::{LONGEST_PAUSE_S, Past, proceed};
use crate::model::run::Run;

/// Runs of one clock: each learns what the joints did in those before it. `starts` say when each began \[s\]. Runs that
/// overlap are not of one clock and stay as they are.
pub fn of_one_clock(runs: &mut [Run], starts: &[f64]) {
    let mut order: Vec<usize> = (0..runs.len().min(starts.len())).collect();
    order.sort_by(|a, b| starts[*a].total_cmp(&starts[*b]));
    let pause = |runs: &[Run], a: usize, b: usize| starts[b] - starts[a] - runs[a].seconds();
    // A step of time may be counted with either run.
    if order.windows(2).any(|w| pause(runs, w[0], w[1]) < -2.0 * runs[w[0]].period_s) {
        return;
    }
    let clocks: Vec<&[usize]> = order.chunk_by(|a, b| pause(runs, *a, *b) <= LONGEST_PAUSE_S).collect();
    for (at, own) in clocks.into_iter().enumerate() {
        if at > 0 {
            runs[own[0]].past = Past::default();
        }
        let mut clock = runs[own[0]].past.known(runs[own[0]].joints());
        let known: Vec<usize> = own
            .windows(2)
            .map(|w| proceed(&mut clock, &runs[w[0]].q, runs[w[0]].period_s, pause(runs, w[0], w[1])))
            .collect();
        let clock = Arc::new(clock);
        for (run, seconds) in own[1..].iter().zip(known) {
            runs[*run].past = Past { clock: Arc::clone(&clock), seconds };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(speed: f64, seconds: usize) -> Run {
        let q = vec![(0..seconds * 1000).map(|k| speed * 1e-3 * k as f64).collect()];
        let tau = vec![vec![0.0; seconds * 1000]];
        Run { name: String::new(), period_s: 1e-3, q, tau, ..Run::default() }
    }

    #[test]
    fn a_run_knows_what_came_before_it_and_how_long_the_pause_was() {
        let mut runs = [run(2.0, 3), run(-0.5, 4), run(1.0, 2)];
        of_one_clock(&mut runs, &[100.0, 105.0, 109.0]);
        assert_eq!(runs[0].past, Past::default());
        let past = runs[2].past.of_joint(0);
        let expected = [[2.0, 4.0]; 3].into_iter().chain([[0.0; 2]; 2]).chain([[0.5, 0.25]; 4]);
        assert_eq!(past.len(), 9);
        for (is, due) in past.iter().zip(expected) {
            assert!(is.iter().zip(due).all(|(a, b)| (a - b).abs() < 1e-9), "{is:?} {due:?}");
        }
    }

    /// A log of many holes is many runs, and each knows all that was before it.
    #[test]
    fn runs_of_one_clock_share_it() {
        let mut runs: Vec<Run> = (0..5).map(|_| run(1.0, 2)).collect();
        of_one_clock(&mut runs, &[0.0, 2.0, 4.0, 6.0, 8.0]);
        assert!((0..5).all(|k| runs[k].past.of_joint(0).len() == 2 * k));
        assert!(runs[2..].iter().all(|r| Arc::ptr_eq(&r.past.clock, &runs[1].past.clock)));
        // What one knows is what it would know alone.
        assert_eq!(runs[3].past, runs[2].past.followed_by(&runs[2].q, runs[2].period_s, 0.0));
        assert_ne!(runs[3].past, runs[2].past);
    }

    #[test]
    fn after_a_long_pause_nothing_is_known() {
        let mut runs = [run(2.0, 3), run(-0.5, 4)];
        of_one_clock(&mut runs, &[0.0, 3.0 + 2.0 * LONGEST_PAUSE_S]);
        assert!(runs.iter().all(|r| r.past == Past::default()));
    }

    /// Two logs that both begin at 0 say nothing about which was first.
    #[test]
    fn runs_that_overlap_are_not_of_one_clock() {
        let mut runs = [run(2.0, 3), run(-0.5, 4)];
        of_one_clock(&mut runs, &[0.0, 0.0]);
        assert!(runs.iter().all(|r| r.past == Past::default()));
    }
}
