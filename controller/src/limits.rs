//! What the robot file lets a plan ask for: joint ranges and speeds.

use crate::desired::Desired;
use rivet_dynamics::{Arm, MAX_JOINTS};

/// The middle of a joint's range \[rad\]; 0 for a joint without one.
pub(crate) fn middle(lower: f64, upper: f64) -> f64 {
    if bounded(lower, upper) { 0.5 * (lower + upper) } else { 0.0 }
}

fn bounded(lower: f64, upper: f64) -> bool {
    lower.is_finite() && upper.is_finite() && upper > lower
}

/// Ranges and speeds of the joints.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SetpointLimits {
    lower: [f64; MAX_JOINTS],
    upper: [f64; MAX_JOINTS],
    velocity: [f64; MAX_JOINTS],
    dof: usize,
}

impl SetpointLimits {
    /// A joint whose URDF states no range or no speed is not limited in it.
    pub(crate) fn of(arm: &Arm) -> SetpointLimits {
        let mut limits = SetpointLimits {
            lower: [f64::NEG_INFINITY; MAX_JOINTS],
            upper: [f64::INFINITY; MAX_JOINTS],
            velocity: [f64::INFINITY; MAX_JOINTS],
            dof: arm.dof(),
        };
        for (j, joint) in arm.joints.iter().enumerate() {
            if bounded(joint.lower, joint.upper) {
                (limits.lower[j], limits.upper[j]) = (joint.lower, joint.upper);
            }
            if joint.velocity.is_finite() && joint.velocity > 0.0 {
                limits.velocity[j] = joint.velocity;
            }
        }
        limits
    }

    /// Speed limit of joint `j` \[rad/s\]; infinite where there is none.
    pub(crate) fn speed(&self, j: usize) -> f64 {
        self.velocity[j]
    }

    /// Speed limits of all joints \[rad/s\]; infinite without a limit.
    pub(crate) fn speeds(&self) -> &[f64; MAX_JOINTS] {
        &self.velocity
    }

    /// Brings a plan back to the limits; true when it was beyond one. At the end of a range a joint is to stand: what would
    /// carry it further is taken away. At the speed limit it is not to get faster.
    pub(crate) fn apply(&self, desired: &mut Desired) -> bool {
        let mut limited = false;
        for j in 0..self.dof {
            let (q, qd, qdd) = (&mut desired.q[j], &mut desired.qd[j], &mut desired.qdd[j]);
            if qd.abs() > self.velocity[j] {
                limited = true;
                let sign = qd.signum();
                *qd = sign * self.velocity[j];
                *qdd = sign * (sign * *qdd).min(0.0);
            }
            let side = if *q > self.upper[j] {
                1.0
            } else if *q < self.lower[j] {
                -1.0
            } else {
                continue;
            };
            limited = true;
            *q = q.clamp(self.lower[j], self.upper[j]);
            *qd = side * (side * *qd).min(0.0);
            *qdd = side * (side * *qdd).min(0.0);
        }
        limited
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn limits() -> SetpointLimits {
        let mut limits = SetpointLimits {
            lower: [f64::NEG_INFINITY; MAX_JOINTS],
            upper: [f64::INFINITY; MAX_JOINTS],
            velocity: [f64::INFINITY; MAX_JOINTS],
            dof: 2,
        };
        (limits.lower[0], limits.upper[0], limits.velocity[0]) = (-1.0, 2.0, 3.0);
        limits
    }

    fn plan(q: f64, qd: f64, qdd: f64) -> Desired {
        let mut plan = Desired::default();
        for j in 0..2 {
            (plan.q[j], plan.qd[j], plan.qdd[j]) = (q, qd, qdd);
        }
        plan
    }

    #[test]
    fn a_plan_stops_at_the_end_of_the_range_and_may_turn_back() {
        let mut over = plan(2.5, 1.0, 4.0);
        assert!(limits().apply(&mut over));
        assert_eq!((over.q[0], over.qd[0], over.qdd[0]), (2.0, 0.0, 0.0));
        assert_eq!((over.q[1], over.qd[1], over.qdd[1]), (2.5, 1.0, 4.0), "a joint without limits");
        let mut back = plan(-1.5, 1.0, 4.0);
        assert!(limits().apply(&mut back));
        assert_eq!((back.q[0], back.qd[0], back.qdd[0]), (-1.0, 1.0, 4.0), "the way back is open");
    }

    #[test]
    fn a_plan_at_the_speed_limit_may_only_slow_down() {
        let mut fast = plan(0.0, -5.0, -2.0);
        assert!(limits().apply(&mut fast));
        assert_eq!((fast.qd[0], fast.qdd[0]), (-3.0, 0.0));
        let mut slowing = plan(0.0, -5.0, 2.0);
        assert!(limits().apply(&mut slowing));
        assert_eq!((slowing.qd[0], slowing.qdd[0]), (-3.0, 2.0));
        let mut sound = plan(1.0, 2.0, 9.0);
        assert!(!limits().apply(&mut sound));
        assert_eq!(sound, plan(1.0, 2.0, 9.0));
    }
}
