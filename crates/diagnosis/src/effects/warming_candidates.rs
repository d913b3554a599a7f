//! Candidates of joints that warm up, and the conversion of their sizes to the friction power of other values.

use rivet_dynamics::{EffectKind, KnownEffect};

use crate::effects::form::Form;
use crate::effects::physics::Physics;
use crate::effects::warming::{Warmth, power};
use crate::policy::POLICY;

/// Time constants \[s\].
const WARMING_TIMES_S: [f64; 5] = [60.0, 150.0, 375.0, 940.0, 2350.0];
/// States at the beginning: a cold joint, and one that comes from harder work.
const START_WARMTHS: [f64; 2] = [0.0, 2.0];

/// Puts effects that were made with the friction power of the values `fitted` into watts of those `written` with them.
pub(crate) fn in_watts_of(form: &Form, effects: &mut [KnownEffect], joints: usize, fitted: &[f64], written: &[f64]) {
    let Form::Warming { joint, warmth } = *form else { return };
    let [was, is] = [fitted, written].map(|x| warmth.mean_power(x, joints, joint));
    let is_of_joint = |e: &&mut KnownEffect| e.kind == EffectKind::TemperatureDependentFriction && e.joint == joint;
    if was > 0.0 && is > 0.0 {
        for effect in effects.iter_mut().filter(is_of_joint) {
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
    if longest_s < POLICY.plausibility.min_warming_record_s {
        return Vec::new();
    }
    let n = first.joints();
    let forms_of_joint = |joint: usize| -> Vec<Form> {
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
        times.flat_map(warmth).map(|warmth| Form::Warming { joint, warmth }).collect()
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
