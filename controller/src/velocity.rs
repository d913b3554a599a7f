//! Joint velocity from encoder positions, for feedback only.

use rivet_dynamics::MAX_JOINTS;

/// Difference quotient behind a first-order low-pass: `q̇ ← q̇ + α·(Δq/Δt − q̇)`. Δt is the time since the position last changed, not a period:
/// coarse encoders, and those that are read less often than samples are sent, repeat readings in motion. While a reading repeats, its joint
/// is no faster than one step in that time.
///
/// Its lag (about `1/(2π·cutoff)`) costs phase in the feedback, not accuracy: desired motion enters the law undelayed.
#[derive(Clone, Debug)]
pub(crate) struct VelocityFilter {
    period_s: f64,
    weight: f64,
    last: Option<[f64; MAX_JOINTS]>,
    velocity: [f64; MAX_JOINTS],
    /// Change of each joint's position when it last changed, and periods since then.
    step: [f64; MAX_JOINTS],
    since: [u64; MAX_JOINTS],
    /// The quotient of that change.
    quotient: [f64; MAX_JOINTS],
    /// Periods after which a position that repeats is that of a joint at rest.
    longest: u64,
    /// Share of the filtered velocity that was none: of the time before the first positions.
    unknown: f64,
}

/// A position that repeats for longer is that of a joint at rest \[s\].
const RESTING_S: f64 = 0.016;

/// Largest share of a velocity that may be of the time before the first positions.
const MOST_UNKNOWN: f64 = 0.05;

impl VelocityFilter {
    /// `period_s` of the samples, `cutoff_hz` of the low-pass.
    pub(crate) fn new(period_s: f64, cutoff_hz: f64) -> VelocityFilter {
        let weight = 1.0 - (-std::f64::consts::TAU * cutoff_hz * period_s).exp();
        let zero = [0.0; MAX_JOINTS];
        VelocityFilter {
            period_s,
            weight,
            last: None,
            velocity: zero,
            step: zero,
            since: [0; MAX_JOINTS],
            quotient: zero,
            longest: ((RESTING_S / period_s) as u64).max(1),
            unknown: 1.0,
        }
    }

    /// Forgets the motion: the next positions are the first.
    pub(crate) fn restart(&mut self) {
        self.last = None;
        let zero = [0.0; MAX_JOINTS];
        (self.velocity, self.step, self.quotient, self.since) = (zero, zero, zero, [0; MAX_JOINTS]);
        self.unknown = 1.0;
    }

    /// Whether the filter has seen enough to know the velocity.
    pub(crate) fn is_known(&self) -> bool {
        self.unknown <= MOST_UNKNOWN
    }

    /// Takes in positions that are `periods` sample periods younger than the last ones (1 without losses).
    pub(crate) fn update(&mut self, q: &[f64], periods: u64) -> &[f64; MAX_JOINTS] {
        let mut now = [0.0; MAX_JOINTS];
        now[..q.len()].copy_from_slice(q);
        if let Some(last) = self.last {
            self.unknown *= 1.0 - self.weight;
            for j in 0..q.len() {
                self.since[j] = self.since[j].saturating_add(periods.max(1));
                let resting = self.since[j] > self.longest.max(periods);
                let elapsed_s = self.period_s * self.since[j] as f64;
                if now[j] != last[j] {
                    self.step[j] = now[j] - last[j];
                    // A joint that has rested moved in the last periods alone.
                    let moved_s = if resting { self.period_s * periods.max(1) as f64 } else { elapsed_s };
                    self.quotient[j] = self.step[j] / moved_s;
                    self.since[j] = 0;
                } else if resting {
                    self.quotient[j] = 0.0;
                } else {
                    let most = self.step[j].abs() / elapsed_s;
                    self.quotient[j] = self.quotient[j].clamp(-most, most);
                }
                self.velocity[j] += self.weight * (self.quotient[j] - self.velocity[j]);
            }
        }
        self.last = Some(now);
        &self.velocity
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest error of the velocity of a ramp of 0.7 rad/s, once it is known; `read` makes the reading of a period.
    fn ripple(read: impl Fn(u64) -> f64) -> f64 {
        let mut filter = VelocityFilter::new(0.001, 80.0);
        let velocity = |k: u64| filter.update(&[read(k)], 1)[0];
        (0..2000).map(velocity).skip(100).map(|v| (v - 0.7).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn encoders_that_are_coarse_or_read_seldom_give_no_ripple() {
        let ramp = |k: u64| 0.7 * 0.001 * k as f64;
        for every in [2, 4, 8] {
            let error = ripple(|k| ramp(k - k % every));
            assert!(error < 1e-9, "read in every {every}th period: {error} rad/s");
        }
        // One step, or two, in two periods: differences alone are off by 0.7 rad/s, or by 0.8.
        let error = ripple(|k| (ramp(k) / 1.5e-3).floor() * 1.5e-3);
        assert!(error < 0.25, "{error} rad/s");
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
