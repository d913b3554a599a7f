//! What is wrong with a log before anything is compared with a model: faults that would be sold as effects.

use rivet_dynamics::Model;

use crate::background::Nominal;
use crate::computed;
use crate::design::Prepared;
use crate::run::Run;

/// Correlation of torque with speed below which a joint would make energy: over a motion that comes back, what bodies
/// and gravity take they give again, and friction only takes.
const MAKES_ENERGY: f64 = -0.3;
/// Unless torque and model correlate by more.
const LIKE_THE_MODEL: f64 = 0.5;
/// A torque this many times the model's (or one over it) is in another unit ...
const OTHER_UNIT: f64 = 3.0;
/// ... if it is the model's torque but for the factor.
const SAME_SHAPE: f64 = 0.9;
/// Speed below which a joint stands still \[rad/s\].
const STILL: f64 = 0.02;
/// Samples in a row at the largest torque that are a limit, and the share of all samples that such stretches make up.
const FLAT: usize = 5;
const FLAT_SHARE: f64 = 0.005;

/// A fault of one joint's signals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LogFault {
    /// The joint's torque runs against its motion: friction would give energy. Correlation of torque and speed.
    Sign(f64),
    /// The torque is the model's times this.
    Scale(f64),
    /// The torque stands at its largest value \[N·m\] for stretches of time.
    Limit(f64),
    /// Bodies alone along the desired motion miss this share of the torque: it was computed, not measured.
    Computed(f64),
    /// The joint moves no faster than this \[rad/s\].
    Still(f64),
}

impl LogFault {
    /// The name in reports.
    pub fn name(self) -> &'static str {
        match self {
            LogFault::Sign(_) => "torque_sign",
            LogFault::Scale(_) => "torque_scale",
            LogFault::Limit(_) => "torque_limit",
            LogFault::Computed(_) => "torque_computed",
            LogFault::Still(_) => "too_little_motion",
        }
    }

    /// Its figure: see the variants.
    pub fn value(self) -> f64 {
        match self {
            LogFault::Sign(v) | LogFault::Scale(v) | LogFault::Limit(v) => v,
            LogFault::Computed(v) | LogFault::Still(v) => v,
        }
    }

    /// Whether the torque of the joint cannot be believed.
    pub fn spoils(self) -> bool {
        matches!(self, LogFault::Sign(_) | LogFault::Scale(_))
    }

    /// What a person would say.
    pub fn text(self) -> String {
        match self {
            LogFault::Sign(v) => format!(
                "torque runs against motion (correlation {v:.2}): its friction would give energy, so the sign or the \
                 scale of this channel is wrong"
            ),
            LogFault::Scale(v) => format!("torque is {v:.2} times the model's: another unit or gear ratio?"),
            LogFault::Limit(v) => format!("torque stands at its limit of {v:.3} N m for stretches of time"),
            LogFault::Computed(v) => format!(
                "torque was computed along the desired motion, not measured: bodies alone miss {:.2} % of it there; is \
                 there a motor current (torque_from in robot.toml)?",
                100.0 * v
            ),
            LogFault::Still(v) => format!("moves no faster than {v:.4} rad/s: nothing can be said of its friction"),
        }
    }
}

/// A fault and where it is.
#[derive(Clone, Debug, PartialEq)]
pub struct LogFinding {
    /// The run's name.
    pub run: String,
    /// The joint's name.
    pub joint: String,
    /// What is wrong.
    pub fault: LogFault,
}

/// Runs whose torque was measured, and what is wrong with the others.
pub(crate) fn measured(model: &Model, runs: Vec<Run>) -> (Vec<Run>, Vec<LogFinding>) {
    let (mut kept, mut found) = (Vec::new(), Vec::new());
    for run in runs {
        let computed = computed::joints(&model.arm, &run);
        if computed.is_empty() {
            kept.push(run);
            continue;
        }
        found.extend(computed.iter().map(|misses| LogFinding {
            run: run.name.clone(),
            joint: model.arm.joints[misses.joint].name.clone(),
            fault: LogFault::Computed(misses.desired),
        }));
    }
    (kept, found)
}

/// Faults of one run, joint by joint.
pub(crate) fn check(run: &Prepared, nominal: &Nominal) -> Vec<LogFinding> {
    let mut found = Vec::new();
    for (j, joint) in nominal.model.arm.joints.iter().enumerate() {
        let mut say = |fault| found.push(LogFinding { run: run.run.name.clone(), joint: joint.name.clone(), fault });
        let top = run.motion.qd[j].iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        if top < STILL {
            say(LogFault::Still(top));
            continue;
        }
        let mut modelled = vec![0.0; run.rows()];
        for (x, column) in nominal.x.iter().zip(&run.standard) {
            if let Some(values) = &column[j] {
                modelled.iter_mut().zip(values).for_each(|(m, v)| *m += v * x);
            }
        }
        if let Some(known) = run.known_rows.get(j) {
            modelled.iter_mut().zip(known).for_each(|(m, k)| *m += k);
        }
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let (tau, speed) = (&run.tau[j], run.chain.sample(&run.motion.qd[j]));
        let cosine = |a: &[f64], b: &[f64]| dot(a, b) / (dot(a, a) * dot(b, b)).sqrt().max(f64::MIN_POSITIVE);
        let dissipates = cosine(tau, &speed);
        let scale = dot(tau, &modelled) / dot(&modelled, &modelled).max(f64::MIN_POSITIVE);
        // A motion that does not come back may give more energy to gravity than friction takes; the model knows of that.
        if dissipates < MAKES_ENERGY && cosine(tau, &modelled) < LIKE_THE_MODEL {
            say(LogFault::Sign(dissipates));
        } else if cosine(tau, &modelled) > SAME_SHAPE && !(1.0 / OTHER_UNIT..OTHER_UNIT).contains(&scale) {
            say(LogFault::Scale(scale));
        }
        if let Some(limit) = limit(&run.run.tau[j]) {
            say(LogFault::Limit(limit));
        }
    }
    found
}

/// The largest torque, if it is held for stretches.
fn limit(signal: &[f64]) -> Option<f64> {
    let top = signal.iter().fold(0.0_f64, |m, t| m.max(t.abs()));
    let held = signal.chunk_by(|a, b| a == b).filter(|c| c.len() >= FLAT && c[0].abs() >= top * (1.0 - 1e-9));
    let flat: usize = held.map(<[f64]>::len).sum();
    (top > 0.0 && flat as f64 > FLAT_SHARE * signal.len() as f64).then_some(top)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_torque_that_is_held_at_its_top_is_a_limit_and_a_standstill_is_not() {
        let wave: Vec<f64> = (0..1000).map(|k| (0.02 * f64::from(k)).sin()).collect();
        assert_eq!(limit(&wave), None);
        let cut: Vec<f64> = wave.iter().map(|t| t.clamp(-0.8, 0.8)).collect();
        assert_eq!(limit(&cut), Some(0.8));
        let rest: Vec<f64> = wave.iter().map(|t| t.clamp(-0.1, 0.1) + if *t > 0.999 { 0.5 } else { 0.0 }).collect();
        assert_eq!(limit(&rest), None, "a stretch below the top is no limit");
    }
}
