//! Friction that changes as the joint warms up: by a measured temperature, or by friction's own power through a lag.

use rivet_dynamics::{EffectKind, KnownEffect, Places};

use crate::effects::about::About;
use crate::effects::carried::Carried;
use crate::effects::columns::{Full, on};
use crate::effects::effect_form::{EffectForm, SizeReference};
use crate::effects::physics::Physics;
use crate::effects::size::named;
use crate::effects::variable::Variable;
use crate::effects::warming::{Warmth, power};
use crate::effects::{Effect, Kind};
use crate::policy::POLICY;

/// Time constants \[s\].
const WARMING_TIMES_S: [f64; 5] = [60.0, 150.0, 375.0, 940.0, 2350.0];
/// States at the beginning: a cold joint, and one that comes from harder work.
const START_WARMTHS: [f64; 2] = [0.0, 2.0];

pub(super) const ABOUT: About = About {
    variable: [Variable::WarmingTime, Variable::Temperature],
    motion: "one reference move repeated from cold until warm",
    is_inexact: true,
    ..About::new("temperature_dependent_friction", Kind::Structure)
};

/// `q̇·ΔT`, `s·ΔT`
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Temperature {
    pub(crate) joint: usize,
}

impl EffectForm for Temperature {
    fn effect(&self) -> Effect {
        Effect::TemperatureDependentFriction
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn coefficients(&self) -> usize {
        2
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        let Some(temperature) = &p.run.temperature else { return Vec::new() };
        let j = self.joint;
        let t = &temperature[j];
        let warm = |k: usize| t[k] - t[0];
        vec![on(p, j, |k| p.motion.qd[j][k] * warm(k)), on(p, j, |k| p.sign[j][k] * warm(k))]
    }

    fn carried(
        &self,
        c: &[f64],
        _x: &[f64],
        _joints: usize,
        reference_c: Option<&[f64]>,
    ) -> (Carried, Vec<(usize, f64)>) {
        let reference = reference_c.map_or(0.0, |t| t[self.joint]);
        Carried::section(EffectKind::TemperatureDependentFriction, self.joint, &[c[0], c[1], reference])
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("viscous_Nms_rad_K", c[0]), ("coulomb_Nm_K", c[1])])
    }

    fn plausible(&self, c: &[f64]) -> bool {
        c[0] < 0.0 || c[1] < 0.0
    }
}

/// The same without a temperature, from what friction's own power makes of it
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Warming {
    pub(crate) joint: usize,
    pub(crate) warmth: Warmth,
}

impl EffectForm for Warming {
    fn effect(&self) -> Effect {
        Effect::TemperatureDependentFriction
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn coefficients(&self) -> usize {
        2
    }

    fn inner_values(&self) -> usize {
        2 + usize::from(self.warmth.at_work)
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        let j = self.joint;
        let warm = self.warmth.state(p, j);
        vec![on(p, j, |k| p.motion.qd[j][k] * warm[k]), on(p, j, |k| p.sign[j][k] * warm[k])]
    }

    fn carried(&self, c: &[f64], x: &[f64], joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        let Warming { joint, warmth } = *self;
        // A file's friction holds at the beginning, and its state is in watts.
        let (power, early) = (warmth.mean_power(x, joints, joint), warmth.start - warmth.reference());
        let values = [c[0] / power, c[1] / power, warmth.start * power, warmth.time_s];
        // By values that take nothing, or next to nothing, it is infinitely much for each watt.
        if !values.iter().all(|v| v.abs() <= POLICY.plausibility.max_friction_per_watt) {
            return Carried::nothing(
                "friction dissipates no power with the parameters found, so it cannot warm the joint",
            );
        }
        let places = Places::new(joints);
        let changes = vec![(places.viscous(joint), c[0] * early), (places.coulomb(joint), c[1] * early)];
        Carried::section_with_values(EffectKind::TemperatureDependentFriction, joint, &values, changes)
    }

    fn magnitude(&self, c: &[f64], joints: usize, reference: &[f64]) -> Vec<(String, f64)> {
        let Warming { joint, warmth } = self;
        let places = Places::new(joints);
        let friction = [places.viscous(*joint), places.coulomb(*joint)].map(|at| reference[at]);
        let [first, last] = warmth.ends(c, friction);
        let change = |first: f64, last: f64| 100.0 * (last - first) / first;
        let all = |at: [f64; 2]| at[0] * warmth.work[1] + at[1] * warmth.work[0];
        let mut size = named(&[
            ("over_s", warmth.span_s),
            ("time_constant_s", warmth.time_s),
            ("friction_change_percent", change(all(first), all(last))),
            ("viscous_change_Nms_rad", last[0] - first[0]),
            ("coulomb_change_Nm", last[1] - first[1]),
        ]);
        for (k, name) in ["viscous_change_percent", "coulomb_change_percent"].into_iter().enumerate() {
            if first[k] > 0.0 {
                size.push((name.to_owned(), change(first[k], last[k])));
            }
        }
        size
    }

    fn size_reference(&self) -> SizeReference {
        SizeReference::Fitted
    }

    fn plausible(&self, c: &[f64]) -> bool {
        self.warmth.plausible(c)
    }

    fn scaled(&self, [a, b, _]: [f64; 3]) -> Warming {
        Warming { warmth: self.warmth.moved(a, b.ln()), ..*self }
    }

    fn steps(&self) -> Vec<(usize, f64)> {
        vec![(0, 1.5), (1, 1.65)]
    }

    fn is_slow(&self) -> bool {
        true
    }

    fn kind(&self) -> usize {
        usize::from(self.warmth.at_work)
    }

    /// Puts effects that were made with the friction power of the values `fitted` into watts of those `written` with them.
    fn convert(&self, effects: &mut [KnownEffect], joints: usize, fitted: &[f64], written: &[f64]) {
        let Warming { joint, warmth } = *self;
        let [was, is] = [fitted, written].map(|x| warmth.mean_power(x, joints, joint));
        let is_of_joint = |e: &&mut KnownEffect| e.kind == EffectKind::TemperatureDependentFriction && e.joint == joint;
        if was > 0.0 && is > 0.0 {
            for effect in effects.iter_mut().filter(is_of_joint) {
                let [viscous, coulomb, reference, time_s] = effect.values;
                effect.values = [viscous * was / is, coulomb * was / is, reference * is / was, time_s];
            }
        }
    }
}

/// Candidates where runs without temperatures are among those looked at, one of which is long enough by itself for something
/// to warm up: a joint that is not what it was in another short log has been changed as likely as warmed. Gears of runs with
/// temperatures warm up by their work as well, so they are judged by it too.
pub(crate) fn candidates(physics: &[Physics<'_>]) -> Vec<Warming> {
    let Some(first) = physics.first() else { return Vec::new() };
    let unmeasured = physics.iter().filter(|p| p.run.temperature.is_none());
    let longest_s = unmeasured.map(|p| p.run.seconds()).fold(0.0, f64::max);
    let span_s = physics.iter().map(|p| p.run.past.seconds() + p.run.seconds()).fold(0.0, f64::max);
    if longest_s < POLICY.plausibility.min_warming_record_s {
        return Vec::new();
    }
    let n = first.joints();
    let forms_of_joint = |joint: usize| -> Vec<Warming> {
        let speeds = || physics.iter().flat_map(|p| &p.motion.qd[joint]);
        let rows = speeds().count().max(1) as f64;
        let work = [speeds().map(|v| v.abs()).sum::<f64>() / rows, speeds().map(|v| v * v).sum::<f64>() / rows];
        let power = power(&first.x, n, joint, work);
        if work[0] < POLICY.plausibility.min_warming_speed_rad_s || power <= 0.0 {
            return Vec::new();
        }
        let times = WARMING_TIMES_S
            .into_iter()
            .filter(|time_s| *time_s <= POLICY.plausibility.max_warming_time_over_span * span_s);
        let warmth = move |time_s: f64| {
            let cold = move |start: f64| Warmth { time_s, start, at_work: false, work, power, span_s };
            START_WARMTHS.into_iter().map(cold).flat_map(|cold| [cold, Warmth { at_work: true, ..cold }])
        };
        times.flat_map(warmth).map(|warmth| Warming { joint, warmth }).collect()
    };
    (0..n).flat_map(forms_of_joint).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::nominal::Nominal;
    use crate::model::run::{Motion, Run};
    use rivet_dynamics::{Arm, Model, Structure};

    /// Whether runs of (length \[s\], with a thermometer) have candidates.
    fn considered(runs: &[(f64, bool)]) -> bool {
        let arm = Arm::from_urdf(include_str!("../../../../robots/manutec-r3/robot.urdf"), [0.0, 0.0, -9.81])
            .expect("an arm");
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
        let motions: Vec<Motion> = runs.iter().map(Motion::from_run).collect();
        let physics: Vec<Physics<'_>> =
            runs.iter().zip(&motions).map(|(run, motion)| Physics::new(run, motion, &nominal, &x)).collect();
        !candidates(&physics).is_empty()
    }

    #[test]
    fn a_thermometer_in_one_log_does_not_hide_warming_in_another() {
        assert!(considered(&[(100.0, false)]));
        assert!(considered(&[(100.0, false), (10.0, true)]) && considered(&[(200.0, true), (100.0, false)]));
        // Whose logs all have one is judged by it, and a short one without is too short.
        assert!(!considered(&[(100.0, true)]) && !considered(&[(200.0, true), (10.0, false)]));
    }
}
