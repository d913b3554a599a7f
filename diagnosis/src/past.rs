//! What joints did before a run began, as far as logs tell: how warm a gear is hangs on the minutes before.

use crate::run::Run;

/// Motion is told over this \[s\]: long enough for coarse encoders, short enough for reversals.
const WINDOW_S: f64 = 0.02;
/// Longest time between two runs that is remembered \[s\]. What comes later is a run of its own: nobody saw what the arm did
/// meanwhile, nor whether somebody changed it.
const LONGEST_PAUSE_S: f64 = 60.0;

/// Second by second before a run, `[joint][second]`: mean size of the speed \[rad/s\] and mean of its square \[rad²/s²\].
/// Empty where nothing is known.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Past(Vec<Vec<[f64; 2]>>);

impl Past {
    /// Of whoever comes `pause_s` after the end of `run`.
    pub(crate) fn after(run: &Run, pause_s: f64) -> Past {
        if pause_s > LONGEST_PAUSE_S {
            return Past::default();
        }
        let pause = pause_s.max(0.0).round() as usize;
        let each = |(j, q): (usize, &Vec<f64>)| -> Vec<[f64; 2]> {
            let mut seconds = run.past.0.get(j).cloned().unwrap_or_default();
            seconds.extend(work(q, run.period_s));
            seconds.resize(seconds.len() + pause, [0.0; 2]);
            seconds
        };
        Past(run.q.iter().enumerate().map(each).collect())
    }

    /// One joint's seconds, the oldest first.
    pub(crate) fn of(&self, joint: usize) -> &[[f64; 2]] {
        self.0.get(joint).map_or(&[], Vec::as_slice)
    }

    /// How long it reaches back \[s\].
    pub(crate) fn seconds(&self) -> f64 {
        self.of(0).len() as f64
    }
}

/// Mean |q̇| and q̇² of each second; a last part counts as one from half a second on.
fn work(q: &[f64], period_s: f64) -> Vec<[f64; 2]> {
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
    for w in order.windows(2) {
        runs[w[1]].past = Past::after(&runs[w[0]], pause(runs, w[0], w[1]));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(speed: f64, seconds: usize) -> Run {
        let q = vec![(0..seconds * 1000).map(|k| speed * 1e-3 * k as f64).collect()];
        let tau = vec![vec![0.0; seconds * 1000]];
        Run { name: String::new(), period_s: 1e-3, q, tau, temperature: None, past: Past::default() }
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
