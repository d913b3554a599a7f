//! The one way out: law -> saturation -> rate limit -> finite check.

use rivet_dynamics::MAX_JOINTS;

/// What no command may exceed, joint by joint.
#[derive(Clone, Debug, PartialEq)]
pub struct Limits {
    /// Largest torque \[N·m\].
    pub torque: Vec<f64>,
    /// Largest change of torque from one command to the next \[N·m\].
    pub step: Vec<f64>,
}

/// What was done to a torque on its way out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Applied {
    /// Joints that did not get what the law wanted.
    pub limited: [bool; MAX_JOINTS],
    /// A joint was at its torque limit.
    pub saturated: bool,
    /// A joint was held back by its rate limit.
    pub rate_limited: bool,
    /// A joint's torque was not a number.
    pub broken: bool,
}

/// Turns what the law wants into what the robot gets.
#[derive(Clone, Debug)]
pub struct Output {
    limits: Limits,
    last: [f64; MAX_JOINTS],
    largest_step: [f64; MAX_JOINTS],
}

impl Output {
    /// Starts from zero torque: the first commands rise at the permitted rate.
    pub fn new(limits: Limits) -> Output {
        Output { limits, last: [0.0; MAX_JOINTS], largest_step: [0.0; MAX_JOINTS] }
    }

    /// Limits `wanted` in place. A joint whose torque is not a number keeps its last command. Real-time safe.
    pub fn apply(&mut self, wanted: &mut [f64]) -> Applied {
        let mut applied = Applied::default();
        for (j, tau) in wanted.iter_mut().enumerate() {
            let (last, limit, step) = (self.last[j], self.limits.torque[j], self.limits.step[j]);
            if tau.is_finite() {
                applied.saturated |= tau.abs() > limit;
                let within = tau.clamp(-limit, limit);
                applied.rate_limited |= (within - last).abs() > step;
                // Saturating last as well as first: a step may not lead out of the limits.
                let given = within.clamp(last - step, last + step).clamp(-limit, limit);
                applied.limited[j] = given != *tau;
                *tau = given;
            } else {
                applied.broken = true;
                applied.limited[j] = true;
                *tau = last;
            }
            self.largest_step[j] = self.largest_step[j].max((*tau - last).abs());
            self.last[j] = *tau;
        }
        applied
    }

    /// The last torque that went out \[N·m\].
    pub fn last(&self) -> &[f64; MAX_JOINTS] {
        &self.last
    }

    /// Largest step from one command to the next so far \[N·m\].
    pub fn largest_step(&self) -> &[f64; MAX_JOINTS] {
        &self.largest_step
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn output() -> Output {
        Output::new(Limits { torque: vec![10.0, 10.0], step: vec![4.0, 100.0] })
    }

    #[test]
    fn a_step_is_spread_over_the_permitted_rate() {
        let mut out = output();
        let mut seen = Vec::new();
        for _ in 0..4 {
            let mut tau = [50.0, -50.0];
            let applied = out.apply(&mut tau);
            assert!(applied.saturated && !applied.broken);
            assert_eq!(applied.limited[..2], [true, true]);
            seen.push(tau);
        }
        assert_eq!(seen, [[4.0, -10.0], [8.0, -10.0], [10.0, -10.0], [10.0, -10.0]]);
        assert_eq!(out.largest_step()[..2], [4.0, 10.0]);
    }

    #[test]
    fn a_torque_that_is_no_number_keeps_the_last_command() {
        let mut out = output();
        let mut tau = [3.0, 5.0];
        assert_eq!(out.apply(&mut tau), Applied::default());
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut tau = [bad, 6.0];
            assert!(out.apply(&mut tau).broken);
            assert_eq!(tau, [3.0, 6.0]);
        }
    }
}
