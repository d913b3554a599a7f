//! Measured arms with robot files as a new user writes them, compared with a plain batch least squares.
//!
//! A robot file is made in memory: kinematics, bodies and limits of the URDF, gear ratios and encoder steps of the data sheet,
//! sample period of the logs. Friction and rotor inertia are 0, and every other key is left out.

pub mod drawn;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use nalgebra::DVector;
use rivet_config::{FrictionLaw, Robot};
use rivet_dynamics::Model;
use rivet_logs::{Log, ReadOptions, read};
use serde_json::{Value, json};

use crate::batch::{self, Grid, LowPass, four_points, least_squares, rows};
use crate::real::{self, Engine, Found, Part, law_text};

/// A step of time this long is a hole of a log \[s\]; baseline and errors do not reach across it.
const GAP_S: f64 = 0.1;
/// A hole is also longer than this many usual steps.
const GAP_STEPS: f64 = 10.0;
/// Time between rows of the baseline \[s\].
const BASELINE_ROW_S: f64 = 0.012;
/// A stretch between holes is used from this many lengths of the baseline's filter on.
const MIN_STRETCH_FILTERS: usize = 2;

/// An arm that no robot file of the checkout describes.
struct Arm {
    /// URDF below the folder of data.
    urdf: &'static str,
    /// Motor angle over joint angle, of every joint.
    gear_ratio: f64,
    /// Encoder step \[rad\], of every joint; 0 is unknown.
    encoder_step: f64,
}

/// Training logs and test logs of one arm.
struct Split {
    name: &'static str,
    arm: Arm,
    train: &'static [Part],
    test: &'static [Part],
    /// Time between samples of the errors \[s\].
    period_s: f64,
    /// Cut-off of the errors and of the baseline \[Hz\].
    cutoff_hz: f64,
}

const DFKI_A0: Arm = Arm { urdf: "dfki_double_pendulum/A0.urdf", gear_ratio: 6.0, encoder_step: 3.8e-4 };
const DFKI_C1: Arm = Arm { urdf: "dfki_double_pendulum/C1.urdf", gear_ratio: 6.0, encoder_step: 3.8e-4 };
const GEN3: Arm = Arm { urdf: "kinova_gen3_motor/kinova.urdf", gear_ratio: 1.0, encoder_step: 0.0 };

const SPLITS: &[Split] = &[
    Split {
        name: "DFKI A0, 75 s",
        arm: DFKI_A0,
        train: &[("dfki_double_pendulum/A0_75s_train.parquet", 0.0, 1.0)],
        test: &[("dfki_double_pendulum/A0_75s_test.parquet", 0.0, 1.0)],
        period_s: 0.005,
        cutoff_hz: 10.0,
    },
    Split {
        name: "DFKI A0, four runs to 75 s",
        arm: DFKI_A0,
        train: &[
            ("dfki_double_pendulum/A0_run_060143.parquet", 0.0, 1.0),
            ("dfki_double_pendulum/A0_run_060245.parquet", 0.0, 1.0),
            ("dfki_double_pendulum/A0_run_060329.parquet", 0.0, 1.0),
            ("dfki_double_pendulum/A0_run_060440.parquet", 0.0, 1.0),
        ],
        test: &[
            ("dfki_double_pendulum/A0_75s_train.parquet", 0.0, 1.0),
            ("dfki_double_pendulum/A0_75s_test.parquet", 0.0, 1.0),
        ],
        period_s: 0.005,
        cutoff_hz: 10.0,
    },
    Split {
        name: "DFKI C1",
        arm: DFKI_C1,
        train: &[
            ("dfki_double_pendulum/C1_143339.parquet", 0.0, 1.0),
            ("dfki_double_pendulum/C1_143524.parquet", 0.0, 1.0),
            ("dfki_double_pendulum/C1_143704.parquet", 0.0, 1.0),
        ],
        test: &[("dfki_double_pendulum/C1_143601.parquet", 0.0, 1.0)],
        period_s: 0.005,
        cutoff_hz: 10.0,
    },
    Split {
        name: "Gen3 motor, runs 1, 2, 4 to 3",
        arm: GEN3,
        train: &[
            ("kinova_gen3_motor/a1.parquet", 0.0, 1.0),
            ("kinova_gen3_motor/a2.parquet", 0.0, 1.0),
            ("kinova_gen3_motor/a4.parquet", 0.0, 1.0),
        ],
        test: &[("kinova_gen3_motor/a3.parquet", 0.0, 1.0)],
        period_s: 0.01,
        cutoff_hz: 8.0,
    },
];

/// What a split gave. Errors are `100 |tau - predicted|/|tau|` per judged joint on the test logs \[%\].
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The split.
    pub name: String,
    /// Plain batch least squares.
    pub plain: Vec<f64>,
    /// Largest measured torque over the joint's limit, all joints and rows of the test logs.
    pub measured_over_limit: f64,
    /// `rivet identify`.
    pub default: Way,
    /// `rivet identify --refine`.
    pub refined: Way,
}

/// One way to identify.
#[derive(Clone, Debug)]
pub struct Way {
    /// Errors \[%\].
    pub errors: Vec<f64>,
    /// Errors of the set that is not exported: consistent or free \[%\].
    pub other_errors: Vec<f64>,
    /// Largest predicted torque over the joint's limit, all joints and rows of the test logs.
    pub torque_over_limit: f64,
    /// Whether the physically consistent parameters are exported.
    pub consistent: bool,
    /// Cut-off of the model filter \[Hz\].
    pub filter_hz: f64,
    /// Friction.
    pub law: FrictionLaw,
    /// Whether instruments are used, not least squares.
    pub instruments: bool,
}

impl Outcome {
    /// Mean over joints of the error over that of plain least squares.
    #[must_use]
    pub fn mean_ratio(&self, way: &Way) -> f64 {
        mean_ratio(&way.errors, &self.plain)
    }
}

fn mean_ratio(errors: &[f64], plain: &[f64]) -> f64 {
    errors.iter().zip(plain).map(|(ours, plain)| ours / plain).sum::<f64>() / plain.len().max(1) as f64
}

/// Everything that a split needs, whatever it was made from.
struct Task {
    name: String,
    robot: Robot,
    train: Vec<Log>,
    test: Vec<Log>,
    period_s: f64,
    cutoff_hz: f64,
    judged: Vec<usize>,
}

/// All splits whose data are below `data`; names of those without data; those that failed, with the reason.
///
/// * `root`: the checkout, with `robots/` and `tests/robots/`
/// * `only`: splits whose name contains this
pub fn run(
    root: &Path,
    data: &Path,
    only: &str,
    engine: &Engine<'_>,
) -> (Vec<Outcome>, Vec<&'static str>, Vec<String>) {
    let (mut outcomes, mut skipped, mut failed) = (Vec::new(), Vec::new(), Vec::new());
    let mut add = |name: &'static str, files: Vec<PathBuf>, task: &dyn Fn() -> Result<Task, String>| {
        if !files.iter().all(|file| file.is_file()) {
            return skipped.push(name);
        }
        match task().and_then(|task| outcome(&task, engine)) {
            Ok(outcome) => outcomes.push(outcome),
            Err(why) => failed.push(format!("{name}: {why}")),
        }
    };
    let paths = |parts: &mut dyn Iterator<Item = &Part>| parts.map(|part| data.join(part.0)).collect();
    for split in SPLITS.iter().filter(|split| split.name.contains(only)) {
        let files = paths(&mut split.train.iter().chain(split.test));
        add(split.name, files, &|| new_arm(split, root, data, engine));
    }
    for split in real::SPLITS.iter().filter(|split| split.name.contains(only)) {
        let files = paths(&mut split.train.iter().chain(std::iter::once(&split.test)));
        add(split.name, files, &|| known_arm(split, root, data, engine));
    }
    (outcomes, skipped, failed)
}

fn read_part(robot: &Robot, data: &Path, part: &Part, engine: &Engine<'_>) -> Result<Log, String> {
    let log = (engine.read)(robot, &data.join(part.0))?;
    let row = |share: f64| (share * log.len() as f64) as usize;
    Ok(log.slice(row(part.1)..row(part.2)))
}

/// An arm that only its URDF describes.
fn new_arm(split: &Split, root: &Path, data: &Path, engine: &Engine<'_>) -> Result<Task, String> {
    let text = |e: &dyn std::fmt::Display| e.to_string();
    let urdf = data.join(split.arm.urdf).canonicalize().map_err(|e| text(&e))?;
    let file = |joints: usize, period_s: f64, limits: &[f64]| {
        robot_file(&Facts {
            name: "stranger",
            urdf: &urdf,
            period_s,
            gravity: [0.0, 0.0, -9.81],
            gear_ratio: &vec![split.arm.gear_ratio; joints],
            torque_limit: limits,
            encoder_step: &vec![split.arm.encoder_step; joints],
            more: "",
        })
    };
    let place = root.join("stranger.toml");
    let described = std::fs::read_to_string(&urdf).map_err(|e| text(&e))?;
    let arm = rivet_dynamics::UrdfArm::read(&described, [0.0; 3], &rivet_dynamics::UrdfOptions::default())
        .map_err(|e| format!("{e:?}"))?
        .arm;
    let joints = arm.dof();
    let limits = limits(&arm.joints.iter().map(|joint| joint.effort).collect::<Vec<_>>());
    let first = data.join(split.train[0].0);
    let period_s = read(&first, &ReadOptions::new(joints)).map_err(|e| text(&e))?.median_step_s();
    let period_s = (period_s * 1e4).round().max(1.0) * 1e-4;
    let robot = rivet_config::parse(&place, &file(joints, period_s, &limits)).map_err(|e| text(&e))?;
    let logs = |parts: &[Part]| -> Result<Vec<Log>, String> {
        parts.iter().map(|part| read_part(&robot, data, part, engine)).collect()
    };
    let (train, test) = (logs(split.train)?, logs(split.test)?);
    let (period_s, cutoff_hz) = (split.period_s, split.cutoff_hz);
    Ok(Task { name: split.name.to_owned(), robot, train, test, period_s, cutoff_hz, judged: (0..joints).collect() })
}

/// An arm of `rivet study real`, with the tuned keys of its robot file taken out.
fn known_arm(split: &real::Split, root: &Path, data: &Path, engine: &Engine<'_>) -> Result<Task, String> {
    let tuned = rivet_config::load(root.join(split.robot)).map_err(|e| e.to_string())?;
    let robot = without_tuned_keys(&tuned, tuned.config.sample_period_s, root)?;
    let train = split.train.iter().map(|part| read_part(&robot, data, part, engine)).collect::<Result<_, _>>()?;
    let test = vec![read_part(&robot, data, &split.test, engine)?];
    let (period_s, cutoff_hz) = (split.period_s, tuned.config.signal.model_filter_hz);
    Ok(Task { name: split.name.to_owned(), robot, train, test, period_s, cutoff_hz, judged: split.judged.to_vec() })
}

/// The robot by a file that has what a data sheet has: friction and rotor inertia are 0.
///
/// * `period_s`: of the logs \[s\]
/// * `root`: the checkout, as the place of the file
pub(crate) fn without_tuned_keys(tuned: &Robot, period_s: f64, root: &Path) -> Result<Robot, String> {
    let config = &tuned.config;
    let mut more = String::new();
    if let Some(gain) = &config.drive.drive_gain {
        let _ = writeln!(more, "drive_gain = {gain:?}");
    }
    let _ = writeln!(more, "[log]\njoint_zero = {:?}", config.log.joint_zero);
    if config.log.torque_from_current {
        more += "torque_from = \"current\"\n";
    }
    if let Some(coupling) = &config.coupling {
        let (driving, driven) = (coupling.driving + 1, coupling.driven + 1);
        let zeros = "rotor_inertia = 0.0\nviscous = 0.0\ncoulomb = 0.0";
        let _ = writeln!(more, "[coupling]\ndriving = {driving}\ndriven = {driven}\n{zeros}");
    }
    let text = robot_file(&Facts {
        name: &config.name,
        urdf: &config.urdf.canonicalize().map_err(|e| e.to_string())?,
        period_s,
        gravity: config.gravity,
        gear_ratio: &config.drive.gear_ratio,
        torque_limit: &limits(&tuned.description.effort),
        encoder_step: &config.drive.encoder_resolution,
        more: &more,
    });
    rivet_config::parse(&root.join("stranger.toml"), &text).map_err(|e| e.to_string())
}

/// Efforts of a URDF as torque limits \[N m\]; a joint without one has the largest of the others.
fn limits(effort: &[f64]) -> Vec<f64> {
    let known = |effort: f64| effort.is_finite() && effort > 0.0;
    let largest = effort.iter().copied().filter(|effort| known(*effort)).fold(0.0, f64::max);
    effort.iter().map(|effort| if known(*effort) { *effort } else { largest }).collect()
}

/// What a new user knows of an arm.
struct Facts<'a> {
    name: &'a str,
    urdf: &'a Path,
    period_s: f64,
    gravity: [f64; 3],
    gear_ratio: &'a [f64],
    torque_limit: &'a [f64],
    encoder_step: &'a [f64],
    /// The end of `[drive]` and sections after it.
    more: &'a str,
}

fn robot_file(facts: &Facts<'_>) -> String {
    let zeros = vec![0.0; facts.gear_ratio.len()];
    format!(
        "name = {:?}\nurdf = {:?}\nsample_period_s = {:?}\ngravity = {:?}\n[friction]\ncoulomb = {zeros:?}\nviscous = {zeros:?}\n\
         offset = {zeros:?}\n[drive]\ngear_ratio = {:?}\nrotor_inertia = {zeros:?}\ntorque_limit = {:?}\nencoder_resolution = {:?}\n{}",
        facts.name,
        facts.urdf.display().to_string(),
        facts.period_s,
        facts.gravity,
        facts.gear_ratio,
        facts.torque_limit,
        facts.encoder_step,
        facts.more
    )
}

fn outcome(task: &Task, engine: &Engine<'_>) -> Result<Outcome, String> {
    let judged = |errors: Vec<f64>| -> Vec<f64> { task.judged.iter().map(|j| errors[*j]).collect() };
    let way = |robot: &Robot| -> Result<Way, String> {
        let found = (engine.identify)(robot, &task.train)?;
        let (errors, torque_over_limit) = predicted_errors(task, &found.exported(), engine)?;
        let other = Found { exports_consistent: !found.exports_consistent, ..found.clone() };
        Ok(Way {
            errors: judged(errors),
            other_errors: judged(predicted_errors(task, &other.exported(), engine)?.0),
            torque_over_limit,
            consistent: found.exports_consistent,
            filter_hz: found.robot.config.signal.model_filter_hz,
            law: found.robot.friction_law(),
            instruments: !found.robot.config.estimator.kind.least_squares(),
        })
    };
    let default = way(&task.robot)?;
    let refined = way(&(engine.refine)(&task.robot, &task.train)?)?;
    let mut measured_over_limit = 0.0_f64;
    for log in &task.test {
        let tau = log.torque().map_err(|e| e.to_string())?;
        for (tau, limit) in tau.iter().zip(&task.robot.config.drive.torque_limit) {
            measured_over_limit = tau.iter().fold(measured_over_limit, |most, tau| most.max(tau.abs() / limit));
        }
    }
    Ok(Outcome { name: task.name.clone(), plain: judged(plain(task)?), measured_over_limit, default, refined })
}

/// The stretches of a log between holes as ranges of rows, each long enough for the filter of the errors.
fn stretches(log: &Log, task: &Task) -> Vec<std::ops::Range<usize>> {
    let gap = GAP_S.max(GAP_STEPS * log.median_step_s());
    let filter = LowPass::new(task.cutoff_hz, task.period_s);
    let shortest_s = (MIN_STRETCH_FILTERS * (2 * filter.half() + 1)) as f64 * task.period_s;
    let ends: Vec<usize> = (1..log.len()).filter(|k| log.t[*k] - log.t[k - 1] > gap).collect();
    let starts = std::iter::once(0).chain(ends.iter().copied());
    let ranges = starts.zip(ends.iter().copied().chain(std::iter::once(log.len()))).map(|(from, until)| from..until);
    ranges.filter(|range| log.t[range.end - 1] - log.t[range.start] > shortest_s).collect()
}

/// Errors on the test logs \[%\], and the largest predicted torque over its limit.
fn predicted_errors(task: &Task, robot: &Robot, engine: &Engine<'_>) -> Result<(Vec<f64>, f64), String> {
    let filter = LowPass::new(task.cutoff_hz, task.period_s);
    let mut sums = vec![[0.0; 2]; robot.dof()];
    let mut over = 0.0_f64;
    for log in &task.test {
        let predicted = (engine.predict)(robot, log)?;
        for (tau, limit) in predicted.iter().zip(&robot.config.drive.torque_limit) {
            over = tau.iter().fold(over, |most, tau| most.max(tau.abs() / limit));
        }
        for range in stretches(log, task) {
            let part = log.slice(range.clone());
            let grid = Grid::new(&part, task.period_s);
            let along = |tau: &Vec<f64>| four_points(&part.t, &tau[range.clone()], &grid.t);
            let predicted: Vec<Vec<f64>> = predicted.iter().map(along).collect();
            for (sum, [error, torque]) in sums.iter_mut().zip(batch::squares_of(&grid, &predicted, &filter)) {
                sum[0] += error;
                sum[1] += torque;
            }
        }
    }
    Ok((sums.iter().map(|[error, torque]| 100.0 * (error / torque).sqrt()).collect(), over))
}

/// Errors of plain batch least squares with rotor inertia, viscous and Coulomb friction and offset \[%\].
fn plain(task: &Task) -> Result<Vec<f64>, String> {
    let robot = task.robot.with_offsets().map_err(|e| e.to_string())?;
    let model: &Model = &robot.model;
    let filter = LowPass::new(task.cutoff_hz, task.period_s);
    let every = (BASELINE_ROW_S / task.period_s).round().max(1.0) as usize;
    let all = |logs: &[Log], dead_zone: &[f64], every: usize| -> Vec<batch::Rows> {
        let of = |log: &Log| -> Vec<batch::Rows> {
            let part = |range| rows(model, &Grid::new(&log.slice(range), task.period_s), &filter, dead_zone, every);
            stretches(log, task).into_iter().map(part).collect()
        };
        logs.iter().flat_map(of).collect()
    };
    let x: DVector<f64> = least_squares(&all(&task.train, &robot.config.signal.dead_zone, every));
    Ok(batch::percent(&all(&task.test, &vec![0.0; robot.dof()], 1), &x))
}

/// The table as Markdown.
#[must_use]
pub fn markdown(outcomes: &[Outcome]) -> String {
    let mut out = String::from(
        "| split | plain least squares, joints [%] | method | joints, base to flange [%] | mean ratio | other set | torque over limit (measured) | chosen |\n\
         |---|---|---|---|---:|---:|---:|---|\n",
    );
    for outcome in outcomes {
        let joints = |errors: &[f64]| errors.iter().map(|e| format!("{e:.1}")).collect::<Vec<_>>().join(" ");
        for (name, way) in [("identify", &outcome.default), ("**--refine**", &outcome.refined)] {
            let set = if way.consistent { "consistent" } else { "free" };
            let law = law_text(way.law, way.instruments);
            // Writing to a String cannot fail.
            let _ = writeln!(
                out,
                "| {} | {} | {name} | {} | {:.3} | {:.3} | {:.2} ({:.2}) | {set}, {} Hz, {law} |",
                outcome.name,
                joints(&outcome.plain),
                joints(&way.errors),
                outcome.mean_ratio(way),
                mean_ratio(&way.other_errors, &outcome.plain),
                way.torque_over_limit,
                outcome.measured_over_limit,
                way.filter_hz,
            );
        }
    }
    out
}

/// The table as JSON.
#[must_use]
pub fn to_json(outcomes: &[Outcome]) -> Value {
    let each = |outcome: &Outcome| {
        let way = |way: &Way| {
            json!({
                "error_percent": way.errors,
                "other_set_error_percent": way.other_errors,
                "mean_ratio": outcome.mean_ratio(way),
                "torque_over_limit": way.torque_over_limit,
                "exported": if way.consistent { "consistent" } else { "free" },
                "model_filter_hz": way.filter_hz,
                "instruments": way.instruments,
            })
        };
        json!({
            "split": outcome.name,
            "plain_percent": outcome.plain,
            "measured_over_limit": outcome.measured_over_limit,
            "default": way(&outcome.default),
            "refined": way(&outcome.refined),
        })
    };
    json!({"splits": outcomes.iter().map(each).collect::<Vec<_>>()})
}
