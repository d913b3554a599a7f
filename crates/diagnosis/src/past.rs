//! What joints did before a run began, as far as logs tell: how warm a gear is hangs on the minutes before.

use std::sync::Arc;

use crate::run::Run;

/// Motion is told over this \[s\]: long enough for coarse encoders, short enough for reversals.
const WINDOW_S: f64 = 0.02;
/// Longest time between two runs that is remembered \[s\]. What comes later is a run of its own: nobody saw what the arm did
/// meanwhile, nor whether somebody changed it.
const LONGEST_PAUSE_S: f64 = 60.0;

/// Mean size of the speed \[rad/s\] and mean of its square \[rad²/s²\] over a second.
type Work = [f64; 2];

/// Second by second before a run. Nothing where nothing is known. Runs of one clock share what they have in common: each its
/// own copy would be as much as the square of their number.
#[derive(Clone, Debug, Default)]
pub struct Past {
    /// `[joint][second]`, the oldest first.
    clock: Arc<Vec<Vec<Work>>>,
    /// How many of these were before the run.
    seconds: usize,
}

impl Past {
    /// Of whoever comes `pause_s` after the end of `run`.
    pub(crate) fn after(run: &Run, pause_s: f64) -> Past {
        if pause_s > LONGEST_PAUSE_S {
            return Past::default();
        }
        let mut clock = run.past.known(run.joints());
        let seconds = proceed(&mut clock, run, pause_s);
        Past { clock: Arc::new(clock), seconds }
    }

    /// One joint's seconds, the oldest first.
    pub(crate) fn of(&self, joint: usize) -> &[Work] {
        self.clock.get(joint).map_or(&[], |seconds| &seconds[..self.seconds])
    }

    /// How long it reaches back \[s\].
    pub(crate) fn seconds(&self) -> f64 {
        self.of(0).len() as f64
    }

    fn known(&self, joints: usize) -> Vec<Vec<Work>> {
        (0..joints).map(|j| self.of(j).to_vec()).collect()
    }
}

impl PartialEq for Past {
    fn eq(&self, other: &Past) -> bool {
        let joints = self.clock.len().max(other.clock.len());
        (0..joints).all(|j| self.of(j) == other.of(j))
    }
}

/// Lets a clock go on over a run and the pause behind it; how many seconds it then knows.
fn proceed(clock: &mut [Vec<Work>], run: &Run, pause_s: f64) -> usize {
    let pause = pause_s.max(0.0).round() as usize;
    for (seconds, q) in clock.iter_mut().zip(&run.q) {
        seconds.extend(work(q, run.period_s));
        seconds.resize(seconds.len() + pause, [0.0; 2]);
    }
    clock.iter().map(Vec::len).min().unwrap_or(0)
}

/// Mean |q̇| and q̇² of each second; a last part counts as one from half a second on.
fn work(q: &[f64], period_s: f64) -> Vec<Work> {
    let window = ((WINDOW_S / period_s).round() as usize).max(1);
    let second = ((1.0 / period_s).round() as usize).max(window);
    let mut out = Vec::new();
    let mut from = 0;
    while from + second / 2 < q.len() {
        let part = &q[from..q.len().min(from + second + 1)];
        let ends = part.iter().step_by(window);
        let speeds: Vec<f64> =
            ends.clone().zip(ends.skip(1)).map(|(a, b)| (b - a).abs() / (window as f64 * period_s)).collect();
        let mean = |f: &dyn Fn(f64) -> f64| speeds.iter().map(|v| f(*v)).sum::<f64>() / speeds.len().max(1) as f64;
        out.push([mean(&|v| v), mean(&|v| v * v)]);
        from += second;
    }
    out
}

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
        let known: Vec<usize> =
            own.windows(2).map(|w| proceed(&mut clock, &runs[w[0]], pause(runs, w[0], w[1]))).collect();
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
        let past = runs[2].past.of(0);
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
        assert!((0..5).all(|k| runs[k].past.of(0).len() == 2 * k));
        assert!(runs[2..].iter().all(|r| Arc::ptr_eq(&r.past.clock, &runs[1].past.clock)));
        // What one knows is what it would know alone.
        assert_eq!(runs[3].past, Past::after(&runs[2], 0.0));
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
