//! Whether contact is drag at the tool: a force against its motion at every similar speed.
//!
//! Drag comes in bursts whenever the arm is fast. A hand or an obstacle acts in its bursts alone.

use std::fmt;

use nalgebra::{Matrix2, Vector2};

use crate::fit::contact::Pull;
use crate::model::nominal::Nominal;
use crate::policy::POLICY;
use crate::screen::prepared::Prepared;

/// Speed at which a drag is told \[m/s\].
const TOLD_M_S: f64 = 1.0;

/// A force against the tool's motion, `-(c1 + c2*|v|)*v`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Drag {
    /// At one metre a second \[N\].
    force: f64,
    /// Share of the squares that it explains.
    explained: f64,
}

impl fmt::Display for Drag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "a force against the motion of the flange, {:.0} N at {TOLD_M_S} m/s wherever it moves, explains {:.0} % \
             of the residual: drag or a dragged part, rather than contact",
            self.force,
            100.0 * self.explained
        )
    }
}

/// The drag that explains `missed(joint, row)` \[N·m\] over a whole run, each joint in units of its noise.
pub(crate) fn drag(run: &Prepared, nominal: &Nominal, missed: impl Fn(usize, usize) -> f64) -> Option<Drag> {
    let n = run.tau.len();
    let mut pull = Pull::new(&nominal.model.arm);
    let (mut q, mut torque, mut jacobian) = (vec![0.0; n], vec![0.0; n], vec![[0.0; 3]; n]);
    let (mut dd, mut dr, mut rr) = (Matrix2::zeros(), Vector2::zeros(), 0.0);
    for row in 0..run.rows() {
        let sample = run.chain.sample_of(row);
        q.iter_mut().zip(&run.motion.q).for_each(|(to, from)| *to = from[sample]);
        let mut v = [0.0; 3];
        for (axis, v) in v.iter_mut().enumerate() {
            pull.torque(axis, &q, &mut torque);
            for (j, torque) in torque.iter().enumerate() {
                jacobian[j][axis] = *torque;
                *v += torque * run.motion.qd[j][sample];
            }
        }
        let speed = v.iter().map(|v| v * v).sum::<f64>().sqrt();
        for (j, own) in jacobian.iter().enumerate() {
            let weight = 1.0 / run.floor[j].max(f64::MIN_POSITIVE);
            let along: f64 = own.iter().zip(&v).map(|(own, v)| own * v).sum();
            let d = weight * Vector2::new(along, speed * along);
            let r = weight * missed(j, row);
            dd += d * d.transpose();
            dr += d * r;
            rr += r * r;
        }
    }
    let c = dd.try_inverse()? * dr;
    let (force, explained) = (c[0] * TOLD_M_S + c[1] * TOLD_M_S * TOLD_M_S, dr.dot(&c) / rr);
    (force > 0.0 && explained > POLICY.held_out.min_drag_share).then_some(Drag { force, explained })
}
