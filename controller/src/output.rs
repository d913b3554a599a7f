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

/// Turns what the law wants into what the robot gets.
#[derive(Clone, Debug)]
pub struct Output {
    limits: Limits,
    last: [f64; MAX_JOINTS],
}

impl Output {
    /// Starts from zero torque: the first commands rise at the permitted rate.
    pub fn new(limits: Limits) -> Output {
        Output { limits, last: [0.0; MAX_JOINTS] }
    }

    /// Limits `wanted` in place. A joint whose torque is not a number keeps its last command; returns whether that
    /// happened. Real-time safe.
    pub fn apply(&mut self, wanted: &mut [f64]) -> bool {
        let mut broken = false;
        for (j, tau) in wanted.iter_mut().enumerate() {
            let last = self.last[j];
            if tau.is_finite() {
                let limit = self.limits.torque[j];
                let step = self.limits.step[j];
                // Saturating last as well as first: a step may not lead out of the limits.
                *tau = tau.clamp(-limit, limit).clamp(last - step, last + step).clamp(-limit, limit);
            } else {
                broken = true;
                *tau = last;
            }
            self.last[j] = *tau;
        }
        broken
    }

    /// Starts again from zero torque.
    pub fn restart(&mut self) {
        self.last = [0.0; MAX_JOINTS];
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
            assert!(!out.apply(&mut tau));
            seen.push(tau);
        }
        assert_eq!(seen, [[4.0, -10.0], [8.0, -10.0], [10.0, -10.0], [10.0, -10.0]]);
    }

    #[test]
    fn a_torque_that_is_no_number_keeps_the_last_command() {
        let mut out = output();
        let mut tau = [3.0, 5.0];
        out.apply(&mut tau);
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut tau = [bad, 6.0];
            assert!(out.apply(&mut tau));
            assert_eq!(tau, [3.0, 6.0]);
        }
    }
}
