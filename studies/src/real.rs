//! Measured arms: trained on one motion, judged on another, beside a plain batch least squares of the same split.
//!
//! Which friction the model has is chosen inside the training runs alone, by leaving one of them (or one half of a
//! single one) out in turn; the test run is read once, at the end.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rivet_config::{Identified, Robot};
use rivet_dynamics::{BaseSet, Model, Structure, model_hash};
use rivet_logs::Log;
use serde_json::{Value, json};

use crate::batch::{Grid, LowPass, four_points, least_squares, percent, percent_of, rows};

/// Base parameters from logs, and the condition of their equations.
pub type Identify<'a> = dyn Fn(&Robot, &[Log]) -> Result<(Vec<f64>, f64), String> + 'a;
/// Torque of a robot's parameters along a log, on its own rows, `[joint][row]`.
pub type Predict<'a> = dyn Fn(&Robot, &Log) -> Result<Vec<Vec<f64>>, String> + 'a;

/// What `rivet identify` and `rivet predict` do, handed in by the program that has them.
pub struct Engine<'a> {
    /// Reads a log of a robot.
    pub read: &'a dyn Fn(&Robot, &Path) -> Result<Log, String>,
    /// Base parameters from logs, and the condition of their equations.
    pub identify: &'a Identify<'a>,
    /// Torque of a robot's parameters along a log, on its own rows, `[joint][row]`.
    pub predict: &'a Predict<'a>,
}

/// A part of a log: file below the data folder, and from where to where, in parts of its rows.
type Part = (&'static str, f64, f64);

/// One training set and one test.
struct Split {
    name: &'static str,
    /// Robot file below the root of the checkout.
    robot: &'static str,
    train: &'static [Part],
    test: Part,
    /// Time between samples on which both sides are judged \[s\].
    period_s: f64,
    /// Joints that are judged, from the base.
    joints: usize,
}

const UR10E: &str = "robots/ur10e/robot.toml";
const KUKA: &str = "robots/kuka-kr300-r2500/robot.toml";
const FOURIER: &[Part] = &[
    ("ur10e_innopolis/20_02_10-30sec_12harm.parquet", 0.0, 1.0),
    ("ur10e_innopolis/20_02_12-50sec_12harm.parquet", 0.0, 1.0),
];
const RUN_A: Part = ("kuka_kr300/traj_A_10s.parquet", 0.0, 1.0);
const RUN_B: Part = ("kuka_kr300/traj_B_10s.parquet", 0.0, 1.0);

const SPLITS: &[Split] = &[
    Split {
        name: "UR10e, Fourier to Fourier",
        robot: UR10E,
        train: FOURIER,
        test: ("ur10e_innopolis/20_02_19_14harm50sec.parquet", 0.0, 1.0),
        period_s: 0.01,
        joints: 6,
    },
    Split {
        name: "UR10e, Fourier to point-to-point",
        robot: UR10E,
        train: FOURIER,
        test: ("ur10e_innopolis/20_01_31-unload.parquet", 0.0, 1.0),
        period_s: 0.01,
        joints: 6,
    },
    Split { name: "KUKA KR300, A to B", robot: KUKA, train: &[RUN_A], test: RUN_B, period_s: 0.004, joints: 6 },
    Split { name: "KUKA KR300, B to A", robot: KUKA, train: &[RUN_B], test: RUN_A, period_s: 0.004, joints: 6 },
    Split {
        name: "TX40, first 3.5 s to last 2 s",
        robot: "robots/staubli-tx40/robot.toml",
        train: &[("staubli_tx40/exciting_0.0-5.5s.parquet", 0.0, 0.636)],
        test: ("staubli_tx40/exciting_0.0-5.5s.parquet", 0.636, 1.0),
        period_s: 0.001,
        joints: 6,
    },
    Split {
        name: "AIRBOT Play, first 20 s to last 10 s",
        robot: "tests/robots/airbot-play/robot.toml",
        train: &[("airbot_play/chirp_motion_real.parquet", 0.0, 0.667)],
        test: ("airbot_play/chirp_motion_real.parquet", 0.667, 1.0),
        period_s: 0.01,
        joints: 6,
    },
    Split {
        name: "Shanghai, 1 to 2, joints 1-3",
        robot: "tests/robots/shanghai/robot.toml",
        train: &[("shanghai_electric_6dof/traj_1.parquet", 0.0, 1.0)],
        test: ("shanghai_electric_6dof/traj_2.parquet", 0.0, 1.0),
        period_s: 0.006,
        joints: 3,
    },
    Split {
        name: "Kinova Gen3, all but joint 4 alone",
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
        joints: 7,
    },
];

/// Friction beyond a viscous line and a sign of the speed.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Extra {
    /// `friction.presliding_travel` \[rad\].
    pub travel: f64,
    /// `friction.load_dependent`.
    pub load: bool,
    /// `friction.viscous_quadratic`.
    pub quadratic: bool,
}

impl Extra {
    fn text(self) -> String {
        let mut parts = Vec::new();
        if self.travel > 0.0 {
            parts.push(format!("travel {:.0e} rad", self.travel));
        }
        parts.extend(self.load.then(|| "load".to_owned()));
        parts.extend(self.quadratic.then(|| "quadratic".to_owned()));
        if parts.is_empty() { "none".to_owned() } else { parts.join(", ") }
    }

    /// The robot with this friction in its model, its values as in the file or zero.
    fn of(self, robot: &Robot) -> Result<Robot, String> {
        let structure = Structure {
            presliding_travel: self.travel,
            load_friction: self.load,
            viscous_quadratic: self.quadratic,
            ..robot.model.structure
        };
        let model = Model::new(robot.model.arm.clone(), structure).with_load(robot.model.load().to_vec());
        let base = BaseSet::new(&model).map_err(|e| e.to_string())?;
        let mut joints = robot.config.nominal_joints();
        joints.load_friction.resize(robot.dof(), 0.0);
        joints.viscous_quadratic.resize(robot.dof(), 0.0);
        let nominal = model.nominal(&joints);
        let nominal_base = base.from_standard(&nominal);
        let hash = model_hash(&model, &base);
        let config = robot.config.clone();
        Ok(Robot {
            config,
            model: Arc::new(model),
            base: Arc::new(base),
            hash,
            nominal,
            nominal_base,
            identified: None,
        })
    }
}

/// Travels that are tried \[rad\].
const TRAVELS: [f64; 5] = [3e-5, 1e-4, 2e-4, 4e-4, 1e-3];
/// A term must lower the error of the left-out training data by this share to be taken.
const WORTH: f64 = 0.01;

/// What a split gave; errors are `100 |tau - predicted|/|tau|` per joint on the test run \[%\].
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The split.
    pub name: &'static str,
    /// Friction that the training runs chose.
    pub extra: Extra,
    /// Plain batch least squares.
    pub plain: Vec<f64>,
    /// `rivet identify` with the same friction as the plain one.
    pub same: Vec<f64>,
    /// `rivet identify` with the friction chosen.
    pub chosen: Vec<f64>,
    /// Condition of the last one's equations.
    pub condition: f64,
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// All splits whose data are below `data`; the others are told by name. `root`: the checkout.
///
/// # Errors
/// The first split that fails, by name.
pub fn run(root: &Path, data: &Path, engine: &Engine<'_>) -> Result<(Vec<Outcome>, Vec<&'static str>), String> {
    let (mut outcomes, mut skipped) = (Vec::new(), Vec::new());
    for split in SPLITS {
        let all = split.train.iter().chain(std::iter::once(&split.test));
        if all.map(|part| data.join(part.0)).any(|path: PathBuf| !path.is_file()) {
            skipped.push(split.name);
            continue;
        }
        outcomes.push(one(split, root, data, engine).map_err(|why| format!("{}: {why}", split.name))?);
    }
    Ok((outcomes, skipped))
}

fn one(split: &Split, root: &Path, data: &Path, engine: &Engine<'_>) -> Result<Outcome, String> {
    let robot = rivet_config::load(root.join(split.robot)).map_err(|e| e.to_string())?;
    let read = |part: &Part| -> Result<Log, String> {
        let log = (engine.read)(&robot, &data.join(part.0))?;
        let at = |share: f64| (share * log.len() as f64) as usize;
        Ok(log.slice(at(part.1)..at(part.2)))
    };
    let train: Vec<Log> = split.train.iter().map(read).collect::<Result<_, _>>()?;
    let extra = choose(split, &robot, &train, engine)?;
    let test = read(&split.test)?;
    let (same, _) = errors(split, &Extra::default().of(&robot)?, &train, &test, engine)?;
    let (chosen, condition) = errors(split, &extra.of(&robot)?, &train, &test, engine)?;
    let plain = plain(split, &Extra::default().of(&robot)?, &train, &test);
    Ok(Outcome { name: split.name, extra, plain, same, chosen, condition })
}

/// Friction that predicts left-out training data best; the test run has no part in it.
fn choose(split: &Split, robot: &Robot, train: &[Log], engine: &Engine<'_>) -> Result<Extra, String> {
    let pieces: Vec<Log> = match train {
        [single] => {
            let middle = single.len() / 2;
            vec![single.slice(0..middle), single.slice(middle..single.len())]
        }
        several => several.to_vec(),
    };
    let score = |extra: Extra| -> Result<f64, String> {
        let robot = extra.of(robot)?;
        let mut found = Vec::new();
        for out in 0..pieces.len() {
            let rest: Vec<Log> = (0..pieces.len()).filter(|k| *k != out).map(|k| pieces[k].clone()).collect();
            // A joint that only one run moves cannot be left out.
            if let Ok((errors, _)) = errors(split, &robot, &rest, &pieces[out], engine) {
                found.extend(errors.into_iter().filter(|e| e.is_finite()));
            }
        }
        if found.is_empty() { Ok(f64::INFINITY) } else { Ok(mean(&found)) }
    };
    let mut best = (Extra::default(), score(Extra::default())?);
    let steps: [&dyn Fn(Extra) -> Vec<Extra>; 3] = [
        &|e| TRAVELS.iter().map(|&travel| Extra { travel, ..e }).collect(),
        &|e| vec![Extra { load: true, ..e }],
        &|e| vec![Extra { quadratic: true, ..e }],
    ];
    for step in steps {
        let from = best;
        for candidate in step(from.0) {
            let found = score(candidate)?;
            if found < best.1 && found < (1.0 - WORTH) * from.1 {
                best = (candidate, found);
            }
        }
    }
    Ok(best.0)
}

/// Trains, predicts, compares below the model filter's cut-off.
fn errors(
    split: &Split,
    robot: &Robot,
    train: &[Log],
    test: &Log,
    engine: &Engine<'_>,
) -> Result<(Vec<f64>, f64), String> {
    let (values, condition) = (engine.identify)(robot, train)?;
    let mut trained = robot.clone();
    trained.identified = Some(Identified { std: vec![0.0; values.len()], values });
    let predicted = (engine.predict)(&trained, test)?;
    let grid = Grid::new(test, split.period_s);
    let on_grid: Vec<Vec<f64>> = predicted.iter().map(|tau| four_points(&test.t, tau, &grid.t)).collect();
    let filter = LowPass::new(robot.config.signal.model_filter_hz, split.period_s);
    Ok((percent_of(&grid, &on_grid, &filter)[..split.joints].to_vec(), condition))
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
    percent(&[everywhere], &x)[..split.joints].to_vec()
}

/// The table as Markdown.
pub fn markdown(outcomes: &[Outcome]) -> String {
    let mut out = String::from(
        "| split | method | joints, base to flange [%] | mean | friction chosen in training | condition |\n\
         |---|---|---|---:|---|---:|\n",
    );
    for o in outcomes {
        let figures = |e: &[f64]| e.iter().map(|e| format!("{e:.1}")).collect::<Vec<_>>().join(" ");
        // Writing to a String cannot fail.
        let mut row = |method: &str, e: &[f64], extra: &str, condition: &str| {
            let (joints, mean) = (figures(e), mean(e));
            let _ = writeln!(out, "| {} | {method} | {joints} | {mean:.1} | {extra} | {condition} |", o.name);
        };
        row("plain least squares", &o.plain, "", "");
        row("rivet, same friction", &o.same, "", "");
        row("rivet", &o.chosen, &o.extra.text(), &format!("{:.0}", o.condition));
    }
    out
}

/// The table as JSON.
pub fn to_json(outcomes: &[Outcome]) -> Value {
    let each = |o: &Outcome| {
        json!({
            "split": o.name,
            "friction": {"presliding_travel": o.extra.travel, "load_dependent": o.extra.load,
                         "viscous_quadratic": o.extra.quadratic},
            "condition": o.condition,
            "error_percent": {"plain": o.plain, "same_friction": o.same, "rivet": o.chosen},
        })
    };
    json!({"splits": outcomes.iter().map(each).collect::<Vec<_>>()})
}
