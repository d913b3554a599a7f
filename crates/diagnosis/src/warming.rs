//! Friction of joints that warm up, from logs without a thermometer.
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

use rivet_dynamics::{EffectKind, KnownEffect};

use crate::form::Form;
use crate::physics::Physics;
use crate::run::{Motion, Run};

/// Time constants \[s\].
const TIMES_S: [f64; 5] = [60.0, 150.0, 375.0, 940.0, 2350.0];
/// What refinement may make of them \[s\], ...
const SHORTEST_S: f64 = 20.0;
const LONGEST_S: f64 = 7200.0;
/// ... and how much longer than what was looked at: of more the log only shows a straight line.
const BEYOND: f64 = 2.0;
/// States at the beginning: a cold joint, and one that comes from harder work.
const STARTS: [f64; 2] = [0.0, 2.0];
/// The most that refinement may make of them.
const HOTTEST: f64 = 4.0;
/// With less than this to look at on one clock nothing has warmed up \[s\].
const LEAST_S: f64 = 90.0;
/// A joint that moves less than this on average warms up by nothing of its own \[rad/s\].
const LEAST_SPEED: f64 = 0.01;
/// Change of the friction's power over what was looked at, least and most of the larger end: less is not worth a name, and
/// no lubricant does more.
const CHANGES: (f64, f64) = (0.05, 0.9);

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
        falls > 0.0 && high > 0.0 && (CHANGES.0..CHANGES.1).contains(&(1.0 - low / high))
    }

    /// The same with time constant and start changed, within bounds.
    pub(crate) fn moved(self, factor: f64, step: f64) -> Warmth {
        let time_s = (self.time_s * factor).clamp(SHORTEST_S, LONGEST_S.min(BEYOND * self.span_s));
        Warmth { time_s, start: (self.start + step).clamp(0.0, HOTTEST), ..self }
    }
}

fn power(x: &[f64], joints: usize, joint: usize, [speed, square]: [f64; 2]) -> f64 {
    x[12 * joints + joint].max(0.0) * speed + x[11 * joints + joint].max(0.0) * square
}

/// Friction power by the standard vector `x` through a lag of `time_s` along a run \[W\], `from` \[W\] where its past begins.
pub(crate) fn lagged(run: &Run, motion: &Motion, x: &[f64], joint: usize, [time_s, from]: [f64; 2]) -> Vec<f64> {
    let n = motion.joints();
    let mut w = from;
    let second = (-1.0 / time_s).exp();
    for work in run.past.of(joint) {
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

/// Puts effects that were made with the friction power of the values `fitted` into watts of those `written` beside them.
pub(crate) fn in_watts_of(form: &Form, effects: &mut [KnownEffect], joints: usize, fitted: &[f64], written: &[f64]) {
    let Form::Warming { joint, warmth } = *form else { return };
    let [was, is] = [fitted, written].map(|x| warmth.mean_power(x, joints, joint));
    let own = |e: &&mut KnownEffect| e.kind == EffectKind::TemperatureDependentFriction && e.joint == joint;
    if was > 0.0 && is > 0.0 {
        for effect in effects.iter_mut().filter(own) {
            let [viscous, coulomb, reference, time_s] = effect.values;
            effect.values = [viscous * was / is, coulomb * was / is, reference * is / was, time_s];
        }
    }
}

/// Candidates where runs without temperatures are among those looked at, one of which is long enough by itself for something
/// to warm up: a joint that is not what it was in another short log has been changed as likely as warmed. Gears of runs with
/// temperatures warm up by their work as well, so they are judged by it too.
pub(crate) fn forms(physics: &[Physics<'_>]) -> Vec<Form> {
    let Some(first) = physics.first() else { return Vec::new() };
    let unmeasured = physics.iter().filter(|p| p.run.temperature.is_none());
    let longest_s = unmeasured.map(|p| p.run.seconds()).fold(0.0, f64::max);
    let span_s = physics.iter().map(|p| p.run.past.seconds() + p.run.seconds()).fold(0.0, f64::max);
    if longest_s < LEAST_S {
        return Vec::new();
    }
    let n = first.joints();
    let of = |joint: usize| -> Vec<Form> {
        let speeds = || physics.iter().flat_map(|p| &p.motion.qd[joint]);
        let rows = speeds().count().max(1) as f64;
        let work = [speeds().map(|v| v.abs()).sum::<f64>() / rows, speeds().map(|v| v * v).sum::<f64>() / rows];
        let power = power(&first.x, n, joint, work);
        if work[0] < LEAST_SPEED || power <= 0.0 {
            return Vec::new();
        }
        let times = TIMES_S.into_iter().filter(|time_s| *time_s <= BEYOND * span_s);
        let warmth = move |time_s: f64| {
            let cold = move |start: f64| Warmth { time_s, start, at_work: false, work, power, span_s };
            STARTS.into_iter().map(cold).flat_map(|cold| [cold, Warmth { at_work: true, ..cold }])
        };
        times.flat_map(warmth).map(|warmth| Form::Warming { joint, warmth }).collect()
    };
    (0..n).flat_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::background::Nominal;
    use rivet_dynamics::{Arm, Model, Structure};

    /// Whether runs of (length \[s\], with a thermometer) have candidates.
    fn considered(runs: &[(f64, bool)]) -> bool {
        let arm =
            Arm::from_urdf(include_str!("../../../robots/manutec-r3/robot.urdf"), [0.0, 0.0, -9.81]).expect("an arm");
        let n = arm.dof();
        let model = Model::new(arm, Structure { offset: true, ..Structure::default() });
        let mut x = model.arm.links.concat();
        x.extend((0..4 * n).map(|_| 1.0));
        let nominal = Nominal::exact(&model, &x);
        let run = |(seconds, measured): &(f64, bool)| {
            let rows = (seconds / 0.05) as usize;
            let signal = |f: fn(f64) -> f64| vec![(0..rows).map(|k| f(0.05 * k as f64)).collect::<Vec<f64>>(); n];
            let (q, tau) = (signal(f64::sin), signal(|_| 0.0));
            let temperature = measured.then(|| signal(|_| 30.0));
            Run { name: String::new(), period_s: 0.05, q, tau, temperature, ..Run::default() }
        };
        let runs: Vec<Run> = runs.iter().map(run).collect();
        let motions: Vec<Motion> = runs.iter().map(Motion::of).collect();
        let physics: Vec<Physics<'_>> =
            runs.iter().zip(&motions).map(|(run, motion)| Physics::new(run, motion, &nominal, &x)).collect();
        !forms(&physics).is_empty()
    }

    #[test]
    fn a_thermometer_in_one_log_does_not_hide_warming_in_another() {
        assert!(considered(&[(100.0, false)]));
        assert!(considered(&[(100.0, false), (10.0, true)]) && considered(&[(200.0, true), (100.0, false)]));
        // Whose logs all have one is judged by it, and a short one without is too short.
        assert!(!considered(&[(100.0, true)]) && !considered(&[(200.0, true), (10.0, false)]));
    }
}
