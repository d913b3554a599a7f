//! The last samples of an arm with the torque that was commanded between them.

use rivet_dynamics::MAX_JOINTS;

/// One value a joint.
pub(crate) type Values = [f64; MAX_JOINTS];

/// Half of the time over which accelerations are taken \[s\]: the whole, with one sample more, is within 20 ms at 250 Hz and above.
const HALF_S: f64 = 0.008;
/// Most samples in that half: sample rates up to 2 kHz keep its length.
const MOST_HALF: usize = 16;
/// Samples kept.
const LENGTH: usize = 2 * MOST_HALF + 1;

/// Motion in the middle of the window, and the torque that was commanded meanwhile.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MeanMotion {
    /// Positions \[rad\].
    pub q: [f64; MAX_JOINTS],
    /// Velocities \[rad/s\].
    pub qd: [f64; MAX_JOINTS],
    /// Accelerations, weighted by a triangle over the window \[rad/s²\].
    pub qdd: [f64; MAX_JOINTS],
    /// Commanded torques, weighted alike \[N·m\].
    pub tau: [f64; MAX_JOINTS],
}

/// A ring of samples without gaps. Nothing allocates.
#[derive(Clone, Debug)]
pub(crate) struct Window {
    period_s: f64,
    half: usize,
    q: [Values; LENGTH],
    /// Commands of the two halves of the period between the sample before and this one.
    tau: [[Values; 2]; LENGTH],
    /// The command before the last one.
    before: Option<Values>,
    filled: usize,
    next: usize,
}

impl Window {
    pub(crate) fn new(period_s: f64) -> Window {
        Window {
            period_s,
            half: ((HALF_S / period_s).round() as usize).clamp(1, MOST_HALF),
            q: [[0.0; MAX_JOINTS]; LENGTH],
            tau: [[[0.0; MAX_JOINTS]; 2]; LENGTH],
            before: None,
            filled: 0,
            next: 0,
        }
    }

    /// Forgets every sample.
    pub(crate) fn restart(&mut self) {
        (self.filled, self.next, self.before) = (0, 0, None);
    }

    /// Takes in the positions of the next sample and the last `command` before it.
    ///
    /// A command acts from about half a period after the sample that it answers: between two samples the one before acts first.
    pub(crate) fn push(&mut self, q: &[f64], command: &[f64]) {
        let (mut now, mut last) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
        now[..q.len()].copy_from_slice(q);
        last[..command.len()].copy_from_slice(command);
        let before = self.before.replace(last).unwrap_or(last);
        self.q[self.next] = now;
        self.tau[self.next] = [before, last];
        self.next = (self.next + 1) % LENGTH;
        self.filled = (self.filled + 1).min(LENGTH);
    }

    /// The slot of the sample `age` samples before the last.
    fn slot(&self, age: usize) -> usize {
        (self.next + LENGTH - 1 - age) % LENGTH
    }

    /// The `repeats` samples before the last were none: the arm moved evenly from the one before them.
    pub(crate) fn interpolate(&mut self, repeats: usize) {
        let repeats = repeats.min(self.filled.saturating_sub(2));
        let (now, old) = (self.q[self.slot(0)], self.q[self.slot(repeats + 1)]);
        for age in 1..=repeats {
            let part = age as f64 / (repeats + 1) as f64;
            let slot = self.slot(age);
            self.q[slot] = core::array::from_fn(|j| now[j] + part * (old[j] - now[j]));
        }
    }

    /// Velocity over the later half of the window \[rad/s\].
    pub(crate) fn speed(&self, j: usize) -> Option<f64> {
        (self.filled > self.half).then(|| {
            let way = self.q[self.slot(0)][j] - self.q[self.slot(self.half)][j];
            way / (self.half as f64 * self.period_s)
        })
    }

    /// Acceleration over the whole window \[rad/s²\].
    pub(crate) fn acceleration(&self, j: usize) -> Option<f64> {
        (self.filled > 2 * self.half).then(|| {
            let [now, middle, old] = [0, self.half, 2 * self.half].map(|age| self.q[self.slot(age)][j]);
            (now - 2.0 * middle + old) / self.half_s().powi(2)
        })
    }

    /// Time over which [`speed`](Self::speed) is taken \[s\].
    pub(crate) fn half_s(&self) -> f64 {
        self.half as f64 * self.period_s
    }

    /// Periods from the first sample of the whole window to its last.
    pub(crate) fn samples(&self) -> u32 {
        2 * self.half as u32
    }

    /// Motion and torque of the whole window, once it is filled.
    pub(crate) fn motion(&self) -> Option<MeanMotion> {
        let half = self.half;
        if self.filled <= 2 * half {
            return None;
        }
        let (now, middle, old) = (self.slot(0), self.slot(half), self.slot(2 * half));
        let mut mean = MeanMotion { q: self.q[middle], ..MeanMotion::default() };
        let span = self.half_s();
        for j in 0..MAX_JOINTS {
            let (now, middle, old) = (self.q[now][j], self.q[middle][j], self.q[old][j]);
            mean.qd[j] = (now - old) / (2.0 * span);
            mean.qdd[j] = (now - 2.0 * middle + old) / (span * span);
        }
        for age in 0..2 * half {
            // The torques of this slot acted in the period that ends with its sample, which is in the rising half of the triangle or in
            // the falling one.
            let rises = age >= half;
            let near_end = (if rises { 2 * half - 1 - age } else { age }) as f64;
            for (part, tau) in self.tau[self.slot(age)].iter().enumerate() {
                let from_end = near_end + if rises == (part == 0) { 0.25 } else { 0.75 };
                let weight = 0.5 * from_end / (half * half) as f64;
                for (sum, tau) in mean.tau.iter_mut().zip(tau) {
                    *sum += weight * tau;
                }
            }
        }
        Some(mean)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A joint under a torque that grows evenly, `q̈ = τ`, as a plant integrates it.
    #[test]
    fn acceleration_and_torque_of_the_same_motion_agree() {
        for period_s in [0.004, 0.001] {
            let mut window = Window::new(period_s);
            let (mut q, mut qd) = (0.0, 0.0);
            let mut last = 0.0;
            let mut seen = 0;
            for k in 0..100 {
                window.push(&[q], &[last]);
                if let Some(mean) = window.motion() {
                    assert!((mean.qdd[0] - mean.tau[0]).abs() < 1e-9 * (1.0 + mean.tau[0].abs()), "{mean:?}");
                    seen += 1;
                }
                let command = (0.3 * f64::from(k)).sin();
                let before = last;
                last = command;
                for tau in [before, last] {
                    // Half a period each, exactly.
                    let h = 0.5 * period_s;
                    q += qd * h + 0.5 * tau * h * h;
                    qd += tau * h;
                }
            }
            assert!(seen > 60, "{seen}");
        }
    }
}
