//! A motion from a file: setpoints, sampled evenly.

use super::Trajectory;

/// Setpoints, `[joint][sample]`. Between samples they are linear; after the last the arm stands there.
#[derive(Clone, Debug)]
pub struct Recorded {
    /// Time between samples \[s\].
    pub period_s: f64,
    /// \[rad\]
    pub q: Vec<Vec<f64>>,
    /// \[rad/s\]
    pub qd: Vec<Vec<f64>>,
    /// \[rad/s²\]
    pub qdd: Vec<Vec<f64>>,
}

impl Trajectory for Recorded {
    fn dof(&self) -> usize {
        self.q.len()
    }

    fn sample(&self, t_s: f64, q: &mut [f64], qd: &mut [f64], qdd: &mut [f64]) {
        let last = self.q.first().map_or(0, Vec::len).saturating_sub(1);
        let place = (t_s / self.period_s).clamp(0.0, last as f64);
        let (k, share) = (place as usize, place.fract());
        let over = t_s > last as f64 * self.period_s;
        for (to, from, rests) in [(q, &self.q, false), (qd, &self.qd, true), (qdd, &self.qdd, true)] {
            for (to, from) in to.iter_mut().zip(from) {
                let next = from[(k + 1).min(last)];
                *to = if rests && over { 0.0 } else { from[k] + share * (next - from[k]) };
            }
        }
    }

    fn ends_s(&self) -> Option<f64> {
        Some(self.period_s * self.q.first().map_or(0, Vec::len).saturating_sub(1) as f64)
    }
}
