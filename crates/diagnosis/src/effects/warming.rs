//! Temperature-dependent friction without a thermometer: friction power through a first-order lag.
//!
//! What friction takes heats the gear, and a warm gear takes less. Without a temperature the state is the friction power of
//! the log's own motion through a first-order lag, in units of its mean:
//!
//! ```text
//! dw/dt = (P/P̄ − w)/T,   P = F_c |q̇| + F_v q̇²          w: 0 in a cold joint, 1 in one that has long done this work
//! τ = (a q̇ + b s)·(w − r)                                r: how warm the joint was that the values of friction are of
//! ```
//!
//! r is that of the beginning or 1: a file's friction may be that of a cold joint or of one at work. P is that of the friction before: that it falls as well makes T a little
//! shorter than the gear's own.

use crate::effects::physics::Physics;
use crate::model::run::{Motion, Run};
use crate::policy::POLICY;
use rivet_dynamics::Places;

/// Change of the friction's power over what was looked at, least and most of the larger end: less is not worth a name, and
/// no lubricant does more.
const FRICTION_CHANGE_RANGE: (f64, f64) = (0.05, 0.9);

/// How a joint warms up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Warmth {
    /// T \[s\].
    pub(crate) time_s: f64,
    /// w where a log begins of which no past is known.
    pub(crate) start: f64,
    /// Whether the values of friction are those of a joint at work.
    pub(crate) at_work: bool,
    /// Mean |q̇| \[rad/s\] and q̇² \[rad²/s²\] of the runs looked at: what P̄ is made of.
    pub(crate) work: [f64; 2],
    /// P̄ with the values of friction before \[W\].
    pub(crate) power: f64,
    /// Longest time on one clock that was looked at \[s\].
    pub(crate) span_s: f64,
}

impl Warmth {
    /// P̄ \[W\] by the standard vector `x`; values below 0 take nothing.
    pub(crate) fn mean_power(&self, x: &[f64], joints: usize, joint: usize) -> f64 {
        power(x, joints, joint, self.work)
    }

    /// r.
    pub(crate) fn reference(&self) -> f64 {
        if self.at_work { 1.0 } else { self.start }
    }

    /// By how much w changes over the span, were the work even.
    pub(crate) fn change(&self) -> f64 {
        (1.0 - self.start) * (1.0 - (-self.span_s / self.time_s).exp())
    }

    /// w − r along a run.
    pub(crate) fn state(&self, p: &Physics<'_>, joint: usize) -> Vec<f64> {
        let whole = self.mean_power(&p.x, p.joints(), joint);
        if whole <= 0.0 {
            return vec![0.0; p.samples()];
        }
        let watts = lagged(p.run, p.motion, &p.x, joint, [self.time_s, self.start * whole]);
        watts.into_iter().map(|w| w / whole - self.reference()).collect()
    }

    /// Friction \[viscous, Coulomb\] at the beginning and at the end of the span, from the coefficients and from that beside
    /// the effect.
    pub(crate) fn ends(&self, c: &[f64], beside: [f64; 2]) -> [[f64; 2]; 2] {
        let at = |w: f64| [0, 1].map(|i| beside[i] + c[i] * (w - self.reference()));
        [at(self.start), at(self.start + self.change())]
    }

    /// Whether friction falls as the joint warms up, by what gears do.
    pub(crate) fn plausible(&self, c: &[f64]) -> bool {
        let falls = -(c[1] * self.work[0] + c[0] * self.work[1]);
        let at = |w: f64| self.power - falls * (w - self.reference());
        let ends = [at(self.start), at(self.start + self.change())];
        let (low, high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        falls > 0.0 && high > 0.0 && (FRICTION_CHANGE_RANGE.0..FRICTION_CHANGE_RANGE.1).contains(&(1.0 - low / high))
    }

    /// The same with time constant and start changed, within bounds.
    pub(crate) fn moved(self, factor: f64, step: f64) -> Warmth {
        let time_s = (self.time_s * factor).clamp(
            POLICY.plausibility.min_warming_time_s,
            POLICY.plausibility.max_warming_time_s.min(POLICY.plausibility.max_warming_time_over_span * self.span_s),
        );
        Warmth { time_s, start: (self.start + step).clamp(0.0, POLICY.plausibility.max_start_warmth), ..self }
    }
}

pub(crate) fn power(x: &[f64], joints: usize, joint: usize, [speed, square]: [f64; 2]) -> f64 {
    x[Places::new(joints).coulomb(joint)].max(0.0) * speed + x[Places::new(joints).viscous(joint)].max(0.0) * square
}

/// Friction power by the standard vector `x` through a lag of `time_s` along a run \[W\], `from` \[W\] where its past begins.
pub(crate) fn lagged(run: &Run, motion: &Motion, x: &[f64], joint: usize, [time_s, from]: [f64; 2]) -> Vec<f64> {
    let n = motion.joints();
    let mut w = from;
    let second = (-1.0 / time_s).exp();
    for work in run.past.of_joint(joint) {
        w = power(x, n, joint, *work) * (1.0 - second) + w * second;
    }
    let step = (-motion.period_s / time_s).exp();
    motion.qd[joint]
        .iter()
        .map(|v| {
            let at = w;
            w = power(x, n, joint, [v.abs(), v * v]) * (1.0 - step) + w * step;
            at
        })
        .collect()
}
