//! Joint velocity from encoder positions, for feedback only.

use rivet_dynamics::MAX_JOINTS;
use rivet_input_checks::LONGEST_REPEAT_S;

/// Difference quotient behind a first-order low-pass: `q̇ ← q̇ + α·((q − q_last)/T − q̇)`.
///
/// Encoders that are read less often than samples are sent repeat all their readings in between. Those samples are left out, and the next one
/// counts for all of their time.
///
/// Its lag (about `1/(2π·cutoff)`) costs phase in the feedback, not accuracy: desired motion enters the law undelayed.
#[derive(Clone, Debug)]
pub(crate) struct VelocityFilter {
    period_s: f64,
    weight: f64,
    last: Option<[f64; MAX_JOINTS]>,
    velocity: [f64; MAX_JOINTS],
    /// Periods since the last positions that were read.
    since: u64,
    /// Periods after which positions that repeat are those of an arm at rest.
    longest: u64,
    /// Share of the filtered velocity that was none: of the time before the first positions.
    unknown: f64,
}

/// Largest share of a velocity that may be of the time before the first positions.
const MOST_UNKNOWN: f64 = 0.05;

impl VelocityFilter {
    /// `period_s` of the samples, `cutoff_hz` of the low-pass.
    pub(crate) fn new(period_s: f64, cutoff_hz: f64) -> VelocityFilter {
        let weight = 1.0 - (-std::f64::consts::TAU * cutoff_hz * period_s).exp();
        let longest = (LONGEST_REPEAT_S / period_s) as u64;
        VelocityFilter { period_s, weight, last: None, velocity: [0.0; MAX_JOINTS], since: 0, longest, unknown: 1.0 }
    }

    /// Forgets the motion: the next positions are the first.
    pub(crate) fn restart(&mut self) {
        self.last = None;
        self.velocity = [0.0; MAX_JOINTS];
        self.since = 0;
        self.unknown = 1.0;
    }

    /// Whether the filter has seen enough to know the velocity.
    pub(crate) fn is_known(&self) -> bool {
        self.unknown <= MOST_UNKNOWN
    }

    /// The velocity of the last update \[rad/s\].
    pub(crate) fn value(&self) -> &[f64; MAX_JOINTS] {
        &self.velocity
    }

    /// Takes in positions that are `periods` sample periods younger than the last ones (1 without losses).
    pub(crate) fn update(&mut self, q: &[f64], periods: u64) -> &[f64; MAX_JOINTS] {
        let mut now = [0.0; MAX_JOINTS];
        now[..q.len()].copy_from_slice(q);
        if let Some(last) = self.last {
            self.unknown *= 1.0 - self.weight;
            let repeats = self.since;
            if now == last && repeats < self.longest {
                self.since += periods.max(1);
                return &self.velocity;
            }
            self.since = 0;
            let elapsed = self.period_s * (repeats + periods.max(1)) as f64;
            // A sample has its own weight and that of the repeats before it; samples that were lost have none.
            let weight = if repeats == 0 { self.weight } else { 1.0 - (1.0 - self.weight).powf((repeats + 1) as f64) };
            for j in 0..q.len() {
                self.velocity[j] += weight * ((now[j] - last[j]) / elapsed - self.velocity[j]);
            }
        }
        self.last = Some(now);
        &self.velocity
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encoders_that_are_read_seldom_give_no_ripple() {
        for every in [2, 4, 8] {
            let mut filter = VelocityFilter::new(0.001, 80.0);
            let velocity = |k: u64| filter.update(&[0.7 * 0.001 * (k - k % every) as f64], 1)[0];
            let error = (0..2000).map(velocity).skip(100).map(|v| (v - 0.7).abs()).fold(0.0, f64::max);
            assert!(error < 1e-9, "read in every {every}th period: {error} rad/s");
        }
    }

    #[test]
    fn a_joint_that_stops_has_no_velocity() {
        for every in [1, 4] {
            let mut filter = VelocityFilter::new(0.001, 80.0);
            let mut velocity = 0.0;
            for k in 0..300_u64 {
                velocity = filter.update(&[0.7 * 0.001 * (k - k % every).min(200) as f64], 1)[0];
            }
            assert!(velocity.abs() < 1e-6, "{velocity} rad/s");
        }
    }

    #[test]
    fn a_ramp_gives_its_slope_and_lost_samples_do_not_double_it() {
        let mut filter = VelocityFilter::new(0.001, 80.0);
        let mut velocity = 0.0;
        let mut step = 0u64;
        for periods in (0..400u64).map(|k| 1 + k % 3) {
            step += periods;
            velocity = filter.update(&[0.7 * 0.001 * step as f64], periods)[0];
        }
        assert!((velocity - 0.7).abs() < 1e-9, "{velocity}");
    }
}
