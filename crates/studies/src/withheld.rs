//! Measured arms from whose identified model one known part is taken away: is it named, where it was?
//!
//! The arm is real, the part is one that its own identification found (or a reading that is known to be right and is made
//! wrong), so the answer is known without any simulator.

use std::fmt::Write as _;
use std::path::Path;

use rivet_config::Robot;
use rivet_diagnosis::{Diagnosis, Effect, Run, Silent, diagnose};
use rivet_dynamics::{LINK_PARAMETERS, Model, Parameter, Places};
use rivet_logs::Log;
use rivet_simulation::Payload;
use serde_json::{Value, json};

/// An arm as identified: what its simulator would know.
pub struct Known {
    /// The model with the law of friction that its logs chose.
    pub model: Model,
    /// Physically consistent standard parameters.
    pub standard: Vec<f64>,
}

/// A robot as its logs identify it.
pub type Identify<'a> = dyn Fn(&Robot, &[Log]) -> Result<Known, String> + 'a;
/// Stretches of a log on a uniform grid.
pub type Runs<'a> = dyn Fn(&Robot, &Log) -> Result<Vec<Run>, String> + 'a;

/// What `rivet identify --refine` and `rivet diagnose` do with files, handed in by the program that has them.
pub struct Engine<'a> {
    /// Reads a log of a robot.
    pub read: &'a dyn Fn(&Robot, &Path) -> Result<Log, String>,
    /// Identifies a robot from logs.
    pub identify: &'a Identify<'a>,
    /// Stretches of a log on a uniform grid.
    pub runs: &'a Runs<'a>,
    /// Told of every diagnosis: done, of how many.
    pub progress: &'a dyn Fn(usize, usize),
}

/// A measured arm.
struct Set {
    name: &'static str,
    /// Robot file below the root of the checkout.
    robot: &'static str,
    /// Logs that its model is identified from, below the data folder.
    known: &'static [&'static str],
    /// Logs that are diagnosed; the last, or the end of a single one, is sealed.
    diagnosed: &'static [&'static str],
}

const SETS: &[Set] = &[
    Set {
        name: "UR10e",
        robot: "robots/ur10e/robot.toml",
        known: &["ur10e_innopolis/20_02_10-30sec_12harm.parquet", "ur10e_innopolis/20_02_12-50sec_12harm.parquet"],
        diagnosed: &["ur10e_innopolis/20_02_06-20sec_10harm.parquet", "ur10e_innopolis/20_02_05-20sec_12harm.parquet"],
    },
    Set {
        name: "KUKA KR300",
        robot: "robots/kuka-kr300-r2500/robot.toml",
        known: &["kuka_kr300/traj_A_10s.parquet", "kuka_kr300/traj_B_10s.parquet"],
        diagnosed: &["kuka_kr300/traj_A_10s.parquet", "kuka_kr300/traj_B_10s.parquet"],
    },
    Set {
        name: "TX40",
        robot: "robots/staubli-tx40/robot.toml",
        known: &["staubli_tx40/exciting_0.0-5.5s.parquet"],
        diagnosed: &["staubli_tx40/exciting_0.0-5.5s.parquet"],
    },
    Set {
        name: "UR10",
        robot: "robots/ur10/robot.toml",
        known: &["ur10_salerno/exciting_0.0-18.4s.parquet"],
        diagnosed: &["ur10_salerno/exciting_0.0-18.4s.parquet"],
    },
    Set {
        name: "AIRBOT Play",
        robot: "tests/robots/airbot-play/robot.toml",
        known: &["airbot_play/chirp_motion_real.parquet"],
        diagnosed: &["airbot_play/chirp_motion_real.parquet"],
    },
];

/// What is taken away, or made wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Part {
    /// A friction or inertia parameter of a drive becomes 0.
    Drive(Effect, usize),
    /// A link keeps 0.7 of its body.
    Link(usize),
    /// The motor that turns with two joints is forgotten: driving and driven joint.
    Coupling(usize, usize),
    /// The simulator's drive is 1/1.15 as strong.
    Gain(usize),
    /// The simulator's joint zero is 0.04 rad away.
    Zero(usize),
    /// The simulator's base is level, or tilted by 0.05 rad where the real one is not.
    Tilt,
    /// The simulator's flange carries less, by 4 % of what moves.
    Load,
}

const LINK_KEPT: f64 = 0.7;
const GAIN: f64 = 1.15;
const ZERO_RAD: f64 = 0.04;
const TILT_RAD: f64 = 0.05;
const LOAD_SHARE: f64 = 0.04;

impl Part {
    /// Every part of an arm that can be taken away.
    fn of(known: &Known) -> Vec<Part> {
        let mut parts = Vec::new();
        let joints = known.model.arm.dof();
        for (parameter, value) in known.model.parameters.iter().zip(&known.standard) {
            let part = match *parameter {
                Parameter::RotorInertia(j) => Part::Drive(Effect::RotorInertia, j),
                Parameter::Viscous(j) => Part::Drive(Effect::ViscousFriction, j),
                Parameter::Coulomb(j) => Part::Drive(Effect::CoulombFriction, j),
                Parameter::LoadFriction(j) => Part::Drive(Effect::LoadDependentFriction, j),
                Parameter::ViscousQuadratic(j) => Part::Drive(Effect::ViscousNonlinearity, j),
                _ => continue,
            };
            // What identification found to be nothing cannot be missed.
            parts.extend((*value != 0.0).then_some(part));
        }
        parts.extend((1..joints).map(Part::Link));
        parts.extend(known.model.structure.coupling.map(|c| Part::Coupling(c.driving, c.driven)));
        parts.extend((0..joints).map(Part::Gain));
        parts.extend((1..joints).map(Part::Zero));
        parts.extend([Part::Tilt, Part::Load]);
        parts
    }

    /// The name that is right, and the joints it belongs on; none for an effect of the arm.
    fn truth(self) -> (Effect, Vec<usize>) {
        match self {
            Part::Drive(effect, j) => (effect, vec![j]),
            Part::Link(j) => (Effect::LinkInertia, vec![j]),
            Part::Coupling(a, b) => (Effect::JointCoupling, vec![a, b]),
            Part::Gain(j) => (Effect::TorqueConstant, vec![j]),
            Part::Zero(j) => (Effect::EncoderOffset, vec![j]),
            Part::Tilt => (Effect::GravityDirection, Vec::new()),
            Part::Load => (Effect::Payload, Vec::new()),
        }
    }

    /// What the simulator knows without it, and the runs as it would read them.
    fn withheld(self, known: &Known, runs: &[Run]) -> (Model, Vec<f64>, Vec<Run>) {
        let (mut model, mut standard, mut runs) = (known.model.clone(), known.standard.clone(), runs.to_vec());
        let index = |wanted: Parameter| known.model.parameters.iter().position(|p| *p == wanted);
        match self {
            Part::Drive(effect, j) => {
                let parameter = match effect {
                    Effect::RotorInertia => Parameter::RotorInertia(j),
                    Effect::ViscousFriction => Parameter::Viscous(j),
                    Effect::CoulombFriction => Parameter::Coulomb(j),
                    Effect::LoadDependentFriction => Parameter::LoadFriction(j),
                    _ => Parameter::ViscousQuadratic(j),
                };
                if let Some(at) = index(parameter) {
                    standard[at] = 0.0;
                }
            }
            Part::Link(j) => {
                for entry in &mut standard[Places::link(j)] {
                    *entry *= LINK_KEPT;
                }
            }
            Part::Coupling(..) => {
                let mut structure = model.structure;
                structure.coupling = None;
                let without = Model::new(model.arm.clone(), structure)
                    .with_load(model.load().to_vec())
                    .with_effects(model.effects().clone());
                standard = without.parameters.iter().filter_map(|p| index(*p)).map(|at| standard[at]).collect();
                model = without;
            }
            Part::Gain(j) => {
                for run in &mut runs {
                    run.tau[j].iter_mut().for_each(|tau| *tau /= GAIN);
                }
            }
            Part::Zero(j) => {
                for run in &mut runs {
                    run.q[j].iter_mut().for_each(|q| *q += ZERO_RAD);
                }
            }
            Part::Tilt => {
                let [x, y, z] = model.arm.gravity;
                let (sin, cos) = TILT_RAD.sin_cos();
                model.arm.gravity = [x, cos * y - sin * z, sin * y + cos * z];
            }
            Part::Load => {
                let moving: f64 = standard.chunks(LINK_PARAMETERS).take(model.arm.dof()).skip(1).map(|b| b[0]).sum();
                let ball = Payload { mass: LOAD_SHARE * moving, com: [0.0, 0.0, 0.05] }.body();
                let last = (model.arm.dof() - 1) * LINK_PARAMETERS;
                for (entry, less) in standard[last..last + LINK_PARAMETERS].iter_mut().zip(ball) {
                    *entry -= less;
                }
            }
        }
        (model, standard, runs)
    }
}

/// What came of one part.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The arm.
    pub arm: &'static str,
    /// What was taken away.
    pub effect: Effect,
    /// Where, from 0; none for what belongs to the arm.
    pub joints: Vec<usize>,
    /// What it adds to the gap of its joint, over the gap of the whole model: `√(with² − without²)/without`.
    pub strength: f64,
    /// Whether the whole model's diagnosis names it already, so that nothing can be learnt.
    pub named_before: bool,
    /// Named, or in a class with what is named.
    pub named: bool,
    /// On its joints.
    pub right_joint: bool,
    /// The cause's shrink, predicted and measured.
    pub shrink: Option<(f64, f64)>,
    /// Names that the whole model's diagnosis has not, and that are not the part.
    pub beside: Vec<String>,
    /// In one word.
    pub verdict: &'static str,
}

impl Outcome {
    /// Whether it counts: it can be seen, and is news.
    pub fn counts(&self) -> bool {
        self.strength > VISIBLE && !self.named_before
    }
}

/// A part below this strength cannot be told from what the whole model leaves.
const VISIBLE: f64 = 0.5;

/// What came of one arm.
#[derive(Clone, Debug)]
pub struct Arm {
    /// Its name.
    pub name: &'static str,
    /// What its whole, identified model is said to lack.
    pub whole: Vec<String>,
    /// Gap of the whole model on the sealed motion.
    pub gap: f64,
    /// Each part.
    pub outcomes: Vec<Outcome>,
}

/// All sets whose data are below `data`; the others by name, and those that failed with the reason.
pub fn run(root: &Path, data: &Path, engine: &Engine<'_>) -> (Vec<Arm>, Vec<&'static str>, Vec<String>) {
    let (mut arms, mut skipped, mut failed) = (Vec::new(), Vec::new(), Vec::new());
    for set in SETS {
        if set.known.iter().chain(set.diagnosed).any(|log| !data.join(log).is_file()) {
            skipped.push(set.name);
            continue;
        }
        match one(set, root, data, engine) {
            Ok(arm) => arms.push(arm),
            Err(why) => failed.push(format!("{}: {why}", set.name)),
        }
    }
    (arms, skipped, failed)
}

fn one(set: &Set, root: &Path, data: &Path, engine: &Engine<'_>) -> Result<Arm, String> {
    let robot = rivet_config::load(root.join(set.robot)).map_err(|e| e.to_string())?;
    let read = |log: &&str| (engine.read)(&robot, &data.join(log));
    let logs: Vec<Log> = set.known.iter().map(read).collect::<Result<_, _>>()?;
    let known = (engine.identify)(&robot, &logs)?;
    let mut runs = Vec::new();
    for log in set.diagnosed {
        runs.extend((engine.runs)(&robot, &read(log)?)?);
    }
    let said = |model: &Model, standard: &[f64], runs: Vec<Run>| {
        diagnose(model, standard, runs, &mut Silent).map_err(|e| e.to_string())
    };
    let whole = said(&known.model, &known.standard, runs.clone())?;
    let parts = Part::of(&known);
    let mut outcomes = Vec::new();
    for (k, part) in parts.iter().enumerate() {
        (engine.progress)(k, parts.len());
        let (model, standard, runs) = part.withheld(&known, &runs);
        let found = said(&model, &standard, runs)?;
        outcomes.push(judge(set.name, *part, &known.model, &whole, &found));
    }
    let names = whole.causes.iter().map(|cause| text(cause.effect, &cause.joints)).collect();
    Ok(Arm { name: set.name, whole: names, gap: whole.before, outcomes })
}

fn text(effect: Effect, joints: &[String]) -> String {
    if joints.is_empty() { effect.to_string() } else { format!("{effect} {}", joints.join(" ")) }
}

fn judge(arm: &'static str, part: Part, model: &Model, whole: &Diagnosis, found: &Diagnosis) -> Outcome {
    let (effect, joints) = part.truth();
    let name = |j: &usize| model.arm.joints[*j].name.clone();
    let wanted: Vec<String> = joints.iter().map(name).collect();
    let is = |c: &rivet_diagnosis::Cause| c.effect == effect || c.indistinguishable_from.contains(&effect);
    // An effect of the whole arm needs no joint.
    let there = |c: &rivet_diagnosis::Cause| wanted.iter().all(|j| c.joints.is_empty() || c.joints.contains(j));
    let cause = found.causes.iter().find(|c| is(c) && there(c)).or_else(|| found.causes.iter().find(|c| is(c)));
    let old = |c: &rivet_diagnosis::Cause| {
        whole.causes.iter().any(|w| w.effect == c.effect && c.joints.iter().all(|j| w.joints.contains(j)))
    };
    let beside = found.causes.iter().filter(|c| !is(c) && !old(c)).map(|c| text(c.effect, &c.joints)).collect();
    let gaps = whole.per_joint.iter().zip(&found.per_joint).enumerate();
    let strength = gaps
        .filter(|(j, _)| joints.is_empty() || joints.contains(j))
        .map(|(_, (w, f))| (f.before.powi(2) - w.before.powi(2)).max(0.0).sqrt() / w.before.max(1e-12));
    Outcome {
        arm,
        effect,
        strength: strength.fold(0.0, f64::max),
        named_before: whole.causes.iter().any(|c| is(c) && there(c)),
        named: cause.is_some(),
        right_joint: cause.is_some_and(there),
        shrink: cause.map(|c| (c.shrink.predicted, c.shrink.measured)),
        beside,
        joints,
        verdict: found.verdict.name(),
    }
}

/// The table as Markdown: a summary by effect, then every part that counts.
pub fn markdown(arms: &[Arm]) -> String {
    let all: Vec<&Outcome> = arms.iter().flat_map(|arm| &arm.outcomes).collect();
    let counted: Vec<&&Outcome> = all.iter().filter(|o| o.counts()).collect();
    let mut out = String::new();
    // Writing to a String cannot fail, here and below.
    for arm in arms {
        let whole = if arm.whole.is_empty() { "nothing".to_owned() } else { arm.whole.join(", ") };
        let _ = writeln!(
            out,
            "* {}: residual of the whole model {:.1} %; effects named: {whole}",
            arm.name,
            100.0 * arm.gap
        );
    }
    let named = counted.iter().filter(|o| o.named).count();
    let placed = counted.iter().filter(|o| o.right_joint).count();
    let _ = writeln!(
        out,
        "\nOf {} parts {} are visible above the residual of the whole model and new: {named} named, {placed} of them \
         on the right joint.\n\n| removed | visible | named | right joint | false positives |\n|---|---:|---:|---:|---:|",
        all.len(),
        counted.len()
    );
    for effect in Effect::ALL {
        let of: Vec<&&&Outcome> = counted.iter().filter(|o| o.effect == *effect).collect();
        if !of.is_empty() {
            let count = |f: &dyn Fn(&Outcome) -> bool| of.iter().filter(|o| f(o)).count();
            let beside: usize = of.iter().map(|o| o.beside.len()).sum();
            let _ = writeln!(
                out,
                "| {effect} | {} | {} | {} | {beside} |",
                of.len(),
                count(&|o| o.named),
                count(&|o| o.right_joint)
            );
        }
    }
    out += "\n| arm | removed | joint | strength | reported | shrink predicted, measured | false positives \
            |\n|---|---|---|---:|---|---|---|\n";
    for o in counted {
        let joints: Vec<String> = o.joints.iter().map(|j| (j + 1).to_string()).collect();
        let said = match (o.named, o.right_joint) {
            (true, true) => "its name",
            (true, false) => "its name, another joint",
            (false, _) => o.verdict,
        };
        let shrink = o.shrink.map_or_else(String::new, |(p, m)| format!("{p:.2}, {m:.2}"));
        let _ = writeln!(
            out,
            "| {} | {} | {} | {:.1} | {said} | {shrink} | {} |",
            o.arm,
            o.effect,
            joints.join(" "),
            o.strength,
            o.beside.join(", ")
        );
    }
    out
}

/// Everything as JSON.
pub fn to_json(arms: &[Arm]) -> Value {
    let outcome = |o: &Outcome| {
        json!({
            "effect": o.effect.name(), "joints": o.joints, "strength": o.strength, "named_before": o.named_before,
            "named": o.named, "right_joint": o.right_joint, "shrink": o.shrink, "beside": o.beside, "verdict": o.verdict,
        })
    };
    let arm = |arm: &Arm| {
        let outcomes: Vec<Value> = arm.outcomes.iter().map(outcome).collect();
        json!({ "arm": arm.name, "gap": arm.gap, "whole": arm.whole, "parts": outcomes })
    };
    json!({ "arms": arms.iter().map(arm).collect::<Vec<_>>() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rivet_dynamics::Workspace;

    /// The TX40 with a rotor, friction and a coupled wrist, and one run.
    fn known() -> (Known, Vec<Run>) {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../robots/staubli-tx40/robot.toml");
        let robot = rivet_config::load(file).expect("a sound robot file");
        let n = robot.dof();
        let mut standard = robot.nominal.clone();
        for (parameter, value) in robot.model.parameters.iter().zip(&mut standard) {
            let drive = matches!(parameter, Parameter::RotorInertia(_) | Parameter::Viscous(_) | Parameter::Coulomb(_));
            *value = if drive && *value == 0.0 { 0.3 } else { *value };
        }
        let rows = |scale: f64| (0..n).map(|j| vec![scale * (j + 1) as f64; 3]).collect();
        let run = Run { name: "r".into(), period_s: 1e-3, q: rows(0.1), tau: rows(2.0), ..Run::default() };
        (Known { model: (*robot.model).clone(), standard }, vec![run])
    }

    /// Torque at a state at which every joint is bent, turns and is accelerated.
    fn torque(model: &Model, standard: &[f64]) -> Vec<f64> {
        let n = model.arm.dof();
        let state = |scale: f64| (0..n).map(|j| scale * (1.0 + 0.3 * j as f64)).collect::<Vec<f64>>();
        let mut y = vec![0.0; n * standard.len()];
        model.regressor(&mut Workspace::new(&model.arm), &state(0.4), &state(0.7), &state(-1.1), &mut y);
        y.chunks(standard.len()).map(|row| row.iter().zip(standard).map(|(y, x)| y * x).sum()).collect()
    }

    /// What is taken away shows on the joints that are said to lack it, and what is not taken away stays.
    #[test]
    fn each_part_changes_what_it_says() {
        let (known, runs) = known();
        let whole = torque(&known.model, &known.standard);
        let parts = Part::of(&known);
        for part in &parts {
            let (model, standard, changed) = part.withheld(&known, &runs);
            let now = torque(&model, &standard);
            let differ: Vec<usize> = (0..6).filter(|&j| (now[j] - whole[j]).abs() > 1e-9).collect();
            match *part {
                Part::Drive(_, j) => {
                    // A rotor or a friction of the coupled motor acts on both its joints.
                    assert!(differ.contains(&j) && differ.iter().all(|k| *k == j || *k >= 4), "{part:?}: {differ:?}");
                }
                Part::Coupling(a, b) => assert_eq!(differ, [a, b], "{part:?}"),
                Part::Link(j) => {
                    assert!(!differ.is_empty() && differ.iter().all(|k| *k <= j), "{part:?}: {differ:?}");
                    let mass = j * LINK_PARAMETERS;
                    assert!((standard[mass] - LINK_KEPT * known.standard[mass]).abs() < 1e-12);
                }
                Part::Load => {
                    let mass = |x: &[f64]| x.chunks(LINK_PARAMETERS).take(6).skip(1).map(|b| b[0]).sum::<f64>();
                    let kept = mass(&standard) / mass(&known.standard);
                    assert!((kept - (1.0 - LOAD_SHARE)).abs() < 1e-9, "{kept}");
                }
                Part::Tilt => {
                    let length = |g: [f64; 3]| g.iter().map(|v| v * v).sum::<f64>().sqrt();
                    assert!((length(model.arm.gravity) - length(known.model.arm.gravity)).abs() < 1e-9);
                    assert!(!differ.is_empty());
                }
                Part::Gain(j) => {
                    assert!((changed[0].tau[j][0] * GAIN - runs[0].tau[j][0]).abs() < 1e-12);
                    assert!((0..6).all(|k| k == j || changed[0].tau[k] == runs[0].tau[k]), "{part:?}");
                }
                Part::Zero(j) => {
                    assert!((changed[0].q[j][0] - runs[0].q[j][0] - ZERO_RAD).abs() < 1e-12);
                    assert!((0..6).all(|k| k == j || changed[0].q[k] == runs[0].q[k]), "{part:?}");
                }
            }
            if !matches!(part, Part::Gain(_) | Part::Zero(_)) {
                assert_eq!(changed, runs, "{part:?} is no matter of the log");
            }
        }
        for part in
            [Part::Drive(Effect::RotorInertia, 0), Part::Coupling(4, 5), Part::Gain(0), Part::Link(5), Part::Tilt]
        {
            assert!(parts.contains(&part), "{part:?} is among {parts:?}");
        }
        assert!(
            !parts.contains(&Part::Gain(6)) && !parts.contains(&Part::Link(0)),
            "link 1 is seen by its rotor alone"
        );
    }

    /// What was not there cannot be taken away, and what does not show need not be found.
    #[test]
    fn what_is_nothing_is_no_part_and_what_is_faint_or_old_does_not_count() {
        let (mut known, _) = known();
        let at = known.model.parameters.iter().position(|p| *p == Parameter::Viscous(2)).expect("a drive parameter");
        known.standard[at] = 0.0;
        assert!(!Part::of(&known).contains(&Part::Drive(Effect::ViscousFriction, 2)));
        let outcome = |strength: f64, named_before: bool| Outcome {
            arm: "a",
            effect: Effect::Payload,
            joints: Vec::new(),
            strength,
            named_before,
            named: true,
            right_joint: true,
            shrink: Some((0.4, 0.5)),
            beside: Vec::new(),
            verdict: "gap",
        };
        assert!(outcome(0.6, false).counts() && !outcome(0.4, false).counts() && !outcome(0.6, true).counts());
        let arm = Arm {
            name: "a",
            whole: Vec::new(),
            gap: 0.1,
            outcomes: vec![outcome(0.6, false), outcome(0.4, false), outcome(0.6, true)],
        };
        let text = markdown(&[arm]);
        assert!(text.contains("Of 3 parts 1 are visible") && text.contains("1 named, 1 of them on"), "{text}");
        assert!(text.contains("| payload | 1 | 1 | 1 | 0 |") && text.contains("0.40, 0.50"), "{text}");
    }
}
