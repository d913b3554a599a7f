//! Measured arms: trained on one motion, judged on another, beside a plain batch least squares of the same split.
//!
//! Which friction the model has is chosen inside the training runs alone; the test run is read once, at the end.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use rivet_config::{FrictionLaw, Identified, Robot};
use rivet_logs::Log;
use serde_json::{Value, json};

use crate::batch::{Grid, LowPass, four_points, least_squares, percent, percent_of, rows};

/// What identification found of a robot.
#[derive(Clone, Debug)]
pub struct Found {
    /// The robot with the offsets and the model filter that its file leaves to the logs.
    pub robot: Robot,
    /// Base parameters.
    pub values: Vec<f64>,
    /// Physically consistent ones near them.
    pub consistent: Vec<f64>,
    /// Whether the consistent parameters are exported: they predict rows that they were not fitted to better.
    pub exports_consistent: bool,
    /// Condition of the equations.
    pub condition: f64,
}

impl Found {
    /// The robot with the base parameters that are exported.
    #[must_use]
    pub fn exported(&self) -> Robot {
        let values = if self.exports_consistent { &self.consistent } else { &self.values };
        with_values(&self.robot, values)
    }
}

/// The robot with identified base parameters.
pub(crate) fn with_values(robot: &Robot, values: &[f64]) -> Robot {
    let identified = Identified { std: vec![0.0; values.len()], values: values.to_vec() };
    Robot { identified: Some(identified), ..robot.clone() }
}

/// The robot with the law of friction that predicts left-out parts of the logs best.
pub type Refine<'a> = dyn Fn(&Robot, &[Log]) -> Result<Robot, String> + 'a;
/// Base parameters from logs.
pub type Identify<'a> = dyn Fn(&Robot, &[Log]) -> Result<Found, String> + 'a;
/// Torque of a robot's parameters along a log, on its own rows, `[joint][row]`.
pub type Predict<'a> = dyn Fn(&Robot, &Log) -> Result<Vec<Vec<f64>>, String> + 'a;

/// What `rivet identify --refine` and `rivet predict` do, handed in by the program that has them.
pub struct Engine<'a> {
    /// Reads a log of a robot.
    pub read: &'a dyn Fn(&Robot, &Path) -> Result<Log, String>,
    /// Chooses the law of friction.
    pub refine: &'a Refine<'a>,
    /// Base parameters from logs.
    pub identify: &'a Identify<'a>,
    /// Torque of a robot's parameters along a log, on its own rows, `[joint][row]`.
    pub predict: &'a Predict<'a>,
}

/// A part of a log: file below the data folder, and from where to where, in parts of its rows.
pub(crate) type Part = (&'static str, f64, f64);

/// One training set and one test.
pub(crate) struct Split {
    pub(crate) name: &'static str,
    /// Robot file below the root of the checkout.
    pub(crate) robot: &'static str,
    pub(crate) train: &'static [Part],
    pub(crate) test: Part,
    /// Time between samples on which both sides are judged \[s\].
    pub(crate) period_s: f64,
    /// Joints that are judged, from 0: those that carry torque in the test and whose torque can be trusted.
    pub(crate) judged: &'static [usize],
}

const ALL: &[usize] = &[0, 1, 2, 3, 4, 5];
const UR10E: &str = "robots/ur10e/robot.toml";
const KUKA: &str = "robots/kuka-kr300-r2500/robot.toml";
const FOURIER: &[Part] = &[
    ("ur10e_innopolis/20_02_10-30sec_12harm.parquet", 0.0, 1.0),
    ("ur10e_innopolis/20_02_12-50sec_12harm.parquet", 0.0, 1.0),
];
const RUN_A: Part = ("kuka_kr300/traj_A_10s.parquet", 0.0, 1.0);
const RUN_B: Part = ("kuka_kr300/traj_B_10s.parquet", 0.0, 1.0);

pub(crate) const SPLITS: &[Split] = &[
    Split {
        name: "UR10e, Fourier to Fourier",
        robot: UR10E,
        train: FOURIER,
        test: ("ur10e_innopolis/20_02_19_14harm50sec.parquet", 0.0, 1.0),
        period_s: 0.01,
        judged: ALL,
    },
    Split {
        name: "UR10e, Fourier to point-to-point",
        robot: UR10E,
        train: FOURIER,
        test: ("ur10e_innopolis/20_01_31-unload.parquet", 0.0, 1.0),
        period_s: 0.01,
        judged: ALL,
    },
    Split { name: "KUKA KR300, A to B", robot: KUKA, train: &[RUN_A], test: RUN_B, period_s: 0.004, judged: ALL },
    Split { name: "KUKA KR300, B to A", robot: KUKA, train: &[RUN_B], test: RUN_A, period_s: 0.004, judged: ALL },
    Split {
        name: "TX40, first 3.5 s to last 2 s",
        robot: "robots/staubli-tx40/robot.toml",
        train: &[("staubli_tx40/exciting_0.0-5.5s.parquet", 0.0, 0.636)],
        test: ("staubli_tx40/exciting_0.0-5.5s.parquet", 0.636, 1.0),
        period_s: 0.001,
        judged: ALL,
    },
    Split {
        name: "AIRBOT Play, first 20 s to last 10 s",
        robot: "tests/robots/airbot-play/robot.toml",
        train: &[("airbot_play/chirp_motion_real.parquet", 0.0, 0.667)],
        test: ("airbot_play/chirp_motion_real.parquet", 0.667, 1.0),
        period_s: 0.01,
        judged: ALL,
    },
    Split {
        name: "Shanghai, 1 to 2, joints 1-3",
        robot: "tests/robots/shanghai/robot.toml",
        train: &[("shanghai_electric_6dof/traj_1.parquet", 0.0, 1.0)],
        test: ("shanghai_electric_6dof/traj_2.parquet", 0.0, 1.0),
        period_s: 0.006,
        judged: &[0, 1, 2],
    },
    Split {
        name: "Kinova Gen3, other runs to joint 4 alone, joints 2 4 6",
        robot: "tests/robots/kinova-gen3/robot.toml",
        train: &[
            ("kinova_gen3/RunTrajectory1.parquet", 0.0, 1.0),
            ("kinova_gen3/joint_1_trapez.parquet", 0.0, 1.0),
            ("kinova_gen3/joint_2_trapez.parquet", 0.0, 1.0),
            ("kinova_gen3/joint_5_trapez.parquet", 0.0, 1.0),
            ("kinova_gen3/joint_7_trapez.parquet", 0.0, 1.0),
        ],
        test: ("kinova_gen3/joint_4_trapez.parquet", 0.0, 1.0),
        period_s: 0.002,
        // The others stand still and carry next to nothing.
        judged: &[1, 3, 5],
    },
];

/// What a split gave; errors are `100 |tau - predicted|/|tau|` per joint on the test run \[%\].
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The split.
    pub name: &'static str,
    /// Friction that the training runs chose.
    pub law: FrictionLaw,
    /// Whether they chose instruments, not least squares.
    pub instruments: bool,
    /// Plain batch least squares, friction of the robot file.
    pub plain: Vec<f64>,
    /// Plain batch least squares, friction chosen.
    pub plain_chosen: Vec<f64>,
    /// `rivet identify`, friction of the robot file.
    pub same: Vec<f64>,
    /// `rivet identify --refine`.
    pub refined: Vec<f64>,
    /// The same with its physically consistent parameters.
    pub consistent: Vec<f64>,
    /// Torque between the two on the test run, all joints \[%\].
    pub consistency_cost: f64,
    /// Condition of the refined equations.
    pub condition: f64,
}

fn judged(split: &Split, joints: &[f64]) -> Vec<f64> {
    split.judged.iter().map(|j| joints[*j]).collect()
}

/// Root mean square over joints.
pub fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|x| x * x).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

pub(crate) fn law_text(law: FrictionLaw, instruments: bool) -> String {
    let method = if instruments { "IV" } else { "LS" };
    let mut text = if law.presliding_travel > 0.0 {
        format!("{method}, travel {:.0e} rad", law.presliding_travel)
    } else {
        format!("{method}, tanh, {} rad/s", law.sign_velocity)
    };
    text += if law.viscous_quadratic { ", quadratic" } else { "" };
    text + if law.load_dependent { ", load" } else { "" }
}

/// All splits whose data are below `data`; those without are told by name, those that failed with the reason. `root`: the
/// checkout.
pub fn run(root: &Path, data: &Path, engine: &Engine<'_>) -> (Vec<Outcome>, Vec<&'static str>, Vec<String>) {
    let (mut outcomes, mut skipped, mut failed) = (Vec::new(), Vec::new(), Vec::new());
    for split in SPLITS {
        let all = split.train.iter().chain(std::iter::once(&split.test));
        if all.map(|part| data.join(part.0)).any(|path: PathBuf| !path.is_file()) {
            skipped.push(split.name);
            continue;
        }
        match one(split, root, data, engine) {
            Ok(outcome) => outcomes.push(outcome),
            Err(why) => failed.push(format!("{}: {why}", split.name)),
        }
    }
    (outcomes, skipped, failed)
}

fn one(split: &Split, root: &Path, data: &Path, engine: &Engine<'_>) -> Result<Outcome, String> {
    let robot = rivet_config::load(root.join(split.robot)).map_err(|e| e.to_string())?;
    let read = |part: &Part| -> Result<Log, String> {
        let log = (engine.read)(&robot, &data.join(part.0))?;
        let at = |share: f64| (share * log.len() as f64) as usize;
        Ok(log.slice(at(part.1)..at(part.2)))
    };
    let train: Vec<Log> = split.train.iter().map(read).collect::<Result<_, _>>()?;
    let chosen = (engine.refine)(&robot, &train)?;
    let test = read(&split.test)?;
    let found = (engine.identify)(&robot, &train)?;
    let same = errors(split, &found.robot, &found.values, &test, engine)?;
    let found = (engine.identify)(&chosen, &train)?;
    Ok(Outcome {
        name: split.name,
        law: chosen.friction_law(),
        instruments: !chosen.config.estimator.kind.least_squares(),
        plain: plain(split, &robot, &train, &test),
        plain_chosen: plain(split, &chosen, &train, &test),
        same,
        refined: errors(split, &found.robot, &found.values, &test, engine)?,
        consistent: errors(split, &found.robot, &found.consistent, &test, engine)?,
        consistency_cost: cost(split, &found, &test, engine)?,
        condition: found.condition,
    })
}

/// Torque that parameters predict along a log, on the grid of the split.
fn predicted(
    split: &Split,
    robot: &Robot,
    values: &[f64],
    test: &Log,
    engine: &Engine<'_>,
) -> Result<(Grid, Vec<Vec<f64>>), String> {
    let predicted = (engine.predict)(&with_values(robot, values), test)?;
    let grid = Grid::new(test, split.period_s);
    let on_grid = predicted.iter().map(|tau| four_points(&test.t, tau, &grid.t)).collect();
    Ok((grid, on_grid))
}

/// Errors of parameters on the test run, below the model filter's cut-off.
fn errors(split: &Split, robot: &Robot, values: &[f64], test: &Log, engine: &Engine<'_>) -> Result<Vec<f64>, String> {
    let (grid, on_grid) = predicted(split, robot, values, test, engine)?;
    let filter = LowPass::new(robot.config.signal.model_filter_hz, split.period_s);
    Ok(judged(split, &percent_of(&grid, &on_grid, &filter)))
}

/// Torque between free and consistent parameters on the test run, each joint in parts of its own \[%\].
fn cost(split: &Split, found: &Found, test: &Log, engine: &Engine<'_>) -> Result<f64, String> {
    let robot = &found.robot;
    let (mut grid, free) = predicted(split, robot, &found.values, test, engine)?;
    let (_, consistent) = predicted(split, robot, &found.consistent, test, engine)?;
    grid.tau = free;
    let filter = LowPass::new(robot.config.signal.model_filter_hz, split.period_s);
    Ok(rms(&judged(split, &percent_of(&grid, &consistent, &filter))))
}

fn plain(split: &Split, robot: &Robot, train: &[Log], test: &Log) -> Vec<f64> {
    let filter = LowPass::new(robot.config.signal.model_filter_hz, split.period_s);
    let every = (0.012 / split.period_s).round().max(1.0) as usize;
    let dead_zone = &robot.config.signal.dead_zone;
    let records: Vec<_> = train
        .iter()
        .map(|log| rows(&robot.model, &Grid::new(log, split.period_s), &filter, dead_zone, every))
        .collect();
    let x = least_squares(&records);
    let everywhere = rows(&robot.model, &Grid::new(test, split.period_s), &filter, &vec![0.0; robot.dof()], 1);
    judged(split, &percent(&[everywhere], &x))
}

/// The table as Markdown.
pub fn markdown(outcomes: &[Outcome]) -> String {
    let mut out = String::from(
        "| split | method | joints, base to flange [%] | rms | chosen | condition |\n|---|---|---|---:|---|---:|\n",
    );
    for o in outcomes {
        // Writing to a String cannot fail.
        let mut row = |method: &str, e: &[f64], law: &str, condition: &str| {
            let joints = e.iter().map(|e| format!("{e:.1}")).collect::<Vec<_>>().join(" ");
            let _ = writeln!(out, "| {} | {method} | {joints} | {:.1} | {law} | {condition} |", o.name, rms(e));
        };
        let law = law_text(o.law, o.instruments);
        row("plain least squares", &o.plain, "robot file", "");
        row("plain least squares", &o.plain_chosen, "chosen", "");
        row("rivet identify", &o.same, "robot file", "");
        row("**rivet identify --refine**", &o.refined, &law, &format!("{:.0}", o.condition));
        let text = format!("consistent set ({:.2} % of torque away)", o.consistency_cost);
        row(&text, &o.consistent, &law, "");
    }
    out
}

/// The table as JSON.
pub fn to_json(outcomes: &[Outcome]) -> Value {
    let each = |o: &Outcome| {
        json!({
            "split": o.name,
            "friction": {"friction_velocity": o.law.sign_velocity, "presliding_travel": o.law.presliding_travel,
                         "load_dependent": o.law.load_dependent, "viscous_quadratic": o.law.viscous_quadratic},
            "instruments": o.instruments,
            "condition": o.condition,
            "error_percent": {"plain": o.plain, "plain_chosen_friction": o.plain_chosen, "same_friction": o.same,
                              "rivet": o.refined, "consistent": o.consistent},
            "consistency_cost_percent": o.consistency_cost,
        })
    };
    json!({"splits": outcomes.iter().map(each).collect::<Vec<_>>()})
}
