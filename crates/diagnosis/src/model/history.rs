//! What joints did before a run began, as far as the logs show: the temperature of a gear depends on it.

use std::sync::Arc;

/// Motion is told over this \[s\]: long enough for coarse encoders, short enough for reversals.
const WINDOW_S: f64 = 0.02;
/// Longest time between two runs that is remembered \[s\]. What comes later is a run of its own: nobody saw what the arm did
/// meanwhile, nor whether somebody changed it.
pub(crate) const LONGEST_PAUSE_S: f64 = 60.0;

/// Mean size of the speed \[rad/s\] and mean of its square \[rad²/s²\] over a second.
type Work = [f64; 2];

/// Second by second before a run. Nothing where nothing is known. Runs of one clock share what they have in common: each its
/// own copy would be as much as the square of their number.
#[derive(Clone, Debug, Default)]
pub struct Past {
    /// `[joint][second]`, the oldest first.
    pub(crate) clock: Arc<Vec<Vec<Work>>>,
    /// How many of these were before the run.
    pub(crate) seconds: usize,
}

impl Past {
    /// Of whoever comes `pause_s` after the end of a run with positions `q` \[rad\] whose past is `self`.
    pub(crate) fn followed_by(&self, q: &[Vec<f64>], period_s: f64, pause_s: f64) -> Past {
        if pause_s > LONGEST_PAUSE_S {
            return Past::default();
        }
        let mut clock = self.known(q.len());
        let seconds = proceed(&mut clock, q, period_s, pause_s);
        Past { clock: Arc::new(clock), seconds }
    }

    /// One joint's seconds, the oldest first.
    pub(crate) fn of_joint(&self, joint: usize) -> &[Work] {
        self.clock.get(joint).map_or(&[], |seconds| &seconds[..self.seconds])
    }

    /// How long it reaches back \[s\].
    pub(crate) fn seconds(&self) -> f64 {
        self.of_joint(0).len() as f64
    }

    pub(crate) fn known(&self, joints: usize) -> Vec<Vec<Work>> {
        (0..joints).map(|j| self.of_joint(j).to_vec()).collect()
    }
}

impl PartialEq for Past {
    fn eq(&self, other: &Past) -> bool {
        let joints = self.clock.len().max(other.clock.len());
        (0..joints).all(|j| self.of_joint(j) == other.of_joint(j))
    }
}

/// Lets a clock go on over a run and the pause behind it; how many seconds it then knows.
pub(crate) fn proceed(clock: &mut [Vec<Work>], q: &[Vec<f64>], period_s: f64, pause_s: f64) -> usize {
    let pause = pause_s.max(0.0).round() as usize;
    for (seconds, q) in clock.iter_mut().zip(q) {
        seconds.extend(work(q, period_s));
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
