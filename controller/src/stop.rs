//! What the arm gets when joint states stop: torque from what was known last, for nothing newer is known.

use crate::law::ControlLaw;
use rivet_config::StopReaction;
use rivet_dynamics::MAX_JOINTS;

/// The last moment at which the arm was seen.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub(crate) struct LastSeen {
    /// Positions \[rad\].
    pub(crate) q: [f64; MAX_JOINTS],
    /// Velocities \[rad/s\].
    pub(crate) qd: [f64; MAX_JOINTS],
}

/// The configured reaction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Stop {
    pub(crate) reaction: StopReaction,
    /// How long it takes \[s\].
    pub(crate) time_s: f64,
}

/// `damp` slows down as e^(−t/T) with T this share of the stop time: 2 % of the speed is left at its end.
const DECAY_SHARE: f64 = 0.25;

impl Stop {
    /// Torque \[N·m\] `since_s` after the arm was last seen, and `stopping_s` after the reaction began with the torque
    /// `last`.
    ///
    /// * hold: what holds the last pose against gravity;
    /// * ramp: `last`, going to zero in a straight line;
    /// * damp: the motion `q̇ = q̇₀·e^(−t/T)` from the last state, whose torque the model knows; it ends as `hold` does.
    pub(crate) fn torque(
        self,
        law: &mut ControlLaw,
        x: &[f64],
        seen: &LastSeen,
        last: &[f64],
        since_s: f64,
        stopping_s: f64,
        tau: &mut [f64],
    ) {
        let n = tau.len();
        let zero = [0.0; MAX_JOINTS];
        match self.reaction {
            StopReaction::Hold => law.model_torque(&seen.q[..n], &zero[..n], &zero[..n], x, tau),
            StopReaction::Ramp => {
                let share = (1.0 - stopping_s / self.time_s).max(0.0);
                for (tau, last) in tau.iter_mut().zip(last) {
                    *tau = share * last;
                }
            }
            StopReaction::Damp => {
                let time = DECAY_SHARE * self.time_s;
                let left = if stopping_s >= self.time_s { 0.0 } else { (-since_s / time).exp() };
                let (mut q, mut qd, mut qdd) = (seen.q, zero, zero);
                for j in 0..n {
                    q[j] += seen.qd[j] * time * (1.0 - left);
                    qd[j] = seen.qd[j] * left;
                    qdd[j] = -qd[j] / time;
                }
                law.model_torque(&q[..n], &qd[..n], &qdd[..n], x, tau);
            }
        }
    }
}
