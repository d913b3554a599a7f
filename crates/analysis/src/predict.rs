//! The torque a model expects along a log, on the log's own rows.

use std::ops::Range;
use std::path::Path;

use anyhow::{Context, Result};
use rayon::prelude::*;
use rivet_config::Robot;
use rivet_diagnosis::{Run, memory_torque, unseen};
use rivet_estimation::offline::{Smoothing, Trajectory, ZeroPhase, position_noise, position_step, predict_smoothed};
use rivet_logs::{Log, interpolate, write_table};
use serde_json::{Value, json};

use crate::coarse::coarse;
use crate::evidence::Distrust;
use crate::glitches::bridged;
use crate::gravity_free::GravityFree;
use crate::reading;
use crate::runs::{self, Piece};
use crate::session;
use crate::sound::Sound;
use crate::table::{Table, number, paragraph};

/// The prediction is smoothed at this many times the cut-off of the model filter or above. Second differences of noisy positions are noise
/// there, and dry friction has harmonics: the noise decides ([`Smoothing`]).
const SMOOTH: f64 = 2.0;

/// Lengths of a filter's edge (half a period of its cut-off) within which the ends of a record colour what it filters.
const TRANSIENT_EDGES: usize = 4;

/// A log is faster than the robot file's samples from this ratio of periods on.
const FASTER: f64 = 1.5;
/// Cut-off of positions then, in parts of the rate of samples.
const BAND: f64 = 0.35;

/// Torque of a robot's parameters along a log, on the rows of its file.
pub struct Prediction {
    /// Name of the robot.
    pub robot: String,
    /// Joints, base to flange.
    pub joints: Vec<String>,
    /// Name of the log.
    pub log: String,
    /// Whether the parameters are identified ones; else they are those of the robot file.
    pub is_identified: bool,
    /// Cut-off of the model filter \[Hz\].
    pub filter_hz: f64,
    /// Time of the rows \[s\].
    pub t: Vec<f64>,
    /// Predicted torque \[N m\], joint side of the gear, `[joint][row]`.
    pub tau: Vec<Vec<f64>>,
    /// Measured torque \[N m\], `[joint][row]`, where the log has it; NaN on rows that were not used.
    pub measured: Option<Vec<Vec<f64>>>,
    /// How the log was resampled.
    resampling: Option<String>,
    /// Sums of squares per joint, of a log with torque.
    sums: Option<Vec<Sums>>,
}

/// Predicts the torque of the identified parameters of `robot` along a log, else of its nominal ones.
///
/// # Errors
/// The log cannot be read or does not fit the robot.
pub fn predict(robot: &Robot, file: &Path) -> Result<Prediction> {
    if !robot.not_excited.is_empty() {
        session::note(format_args!("rivet predict: not excited by the training logs: {}", robot.not_excited));
    }
    let gravity_free = GravityFree::find(robot, [&file.to_owned()])?;
    let robot = gravity_free.as_ref().map_or(robot, |found| {
        found.finding.warn();
        &found.robot
    });
    let (log, mended) = bridged(robot, runs::read_log(robot, file)?)?;
    mended.iter().for_each(Distrust::warn);
    reading::warn(robot, &log);
    let Positions { pieces, noise } = smoothed(robot, &log, pieces_of(&log)?);
    let mut all = OnRows::new(robot.dof());
    let mut sums = log.tau.as_ref().map(|_| vec![Sums::default(); robot.dof()]);
    for (k, (piece, motion)) in pieces.iter().zip(runs::motions(&pieces)).enumerate() {
        session::checkpoint("predicting", k as f64 / pieces.len() as f64);
        let predicted = predict_piece(robot, piece, &motion, &noise)?;
        if let Some(sums) = &mut sums {
            compare(robot, piece, &predicted, sums)?;
        }
        all.add(piece, &predicted);
    }
    let (mut tau, alone) = all.finish(&log);
    if alone > 0 {
        session::note(format_args!(
            "rivet predict: {}: {alone} rows stand alone between holes; their torque is interpolated and counts in no error",
            log.path.display()
        ));
    }
    for warning in excessive(robot, &log, &tau) {
        warning.warn();
    }
    let t = every_row(robot, file, &log, &mut tau)?;
    for left in unseen(&robot.model, log.temperature.is_some()) {
        session::note(format_args!("rivet predict: left out: {left}"));
    }
    Ok(Prediction {
        robot: robot.config.name.clone(),
        joints: runs::joint_names(robot),
        log: runs::short_name(file),
        is_identified: robot.identified.is_some(),
        filter_hz: robot.config.signal.model_filter_hz,
        measured: log.tau.as_ref().map(|(_, tau)| on_rows(log.logged_t(), tau, &t)),
        resampling: pieces.first().map(|piece| piece.report.to_string()),
        t,
        tau,
        sums,
    })
}

/// Signals on the rows of `t` that are rows of `own` (both ascending); NaN elsewhere.
fn on_rows(own: &[f64], signals: &[Vec<f64>], t: &[f64]) -> Vec<Vec<f64>> {
    let at: Vec<Option<usize>> = t.iter().map(|t| own.binary_search_by(|own| own.total_cmp(t)).ok()).collect();
    signals.iter().map(|signal| at.iter().map(|k| k.map_or(f64::NAN, |k| signal[k])).collect()).collect()
}

impl Prediction {
    /// `100*|tau - tau_pred|/|tau|` per joint \[%\], as logged and below the cut-off of the model filter; none of a log without torque.
    /// Rows from the first to the last motion count, without the ends that filters colour.
    pub fn errors_percent(&self) -> Option<Vec<[f64; 2]>> {
        Some(self.sums.as_ref()?.iter().map(|sums| [percent(sums.raw), percent(sums.filtered)]).collect())
    }

    /// Writes the columns t and tau_pred1..N as Parquet or CSV, by the ending of the name.
    ///
    /// # Errors
    /// The name has another ending, or the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let names: Vec<String> = (1..=self.tau.len()).map(|j| format!("tau_pred{j}")).collect();
        let mut columns: Vec<(&str, &[f64])> = vec![("t", &self.t)];
        columns.extend(names.iter().map(String::as_str).zip(self.tau.iter().map(Vec::as_slice)));
        Ok(write_table(path, &columns)?)
    }

    /// The report as JSON: errors of each joint \[%\] as of [`errors_percent`](Self::errors_percent), null of a log without torque.
    pub fn to_json(&self) -> Value {
        let errors = self.errors_percent();
        let joints = self.joints.iter().enumerate().map(|(j, joint)| {
            let of = |k: usize| errors.as_ref().map(|errors| errors[j][k]);
            json!({ "joint": joint, "error_percent": of(0), "filtered_error_percent": of(1) })
        });
        json!({
            "robot": self.robot, "log": self.log, "is_identified": self.is_identified, "rows": self.t.len(),
            "filter_hz": self.filter_hz, "resampling": self.resampling, "joints": joints.collect::<Vec<_>>(),
        })
    }

    /// The report as text.
    pub fn text(&self) -> String {
        let kind = if self.is_identified { "identified" } else { "nominal (the file has no [identified])" };
        let mut out = paragraph("", &format!("predict {}: {kind} parameters along {}", self.robot, self.log));
        if let Some(resampling) = &self.resampling {
            out += &paragraph("  ", resampling);
        }
        let Some(errors) = self.errors_percent() else {
            out += "  no torque in the log: nothing to compare with\n";
            return out;
        };
        let hz = self.filter_hz;
        let mut table = Table::new(["100*|tau-pred|/|tau| [%]", "as logged", &format!("below {hz} Hz")]);
        for (name, [raw, filtered]) in self.joints.iter().zip(errors) {
            table.row([name.clone(), format!("{raw:.1}"), format!("{filtered:.1}")]);
        }
        let rows = "errors are of rows from the first to the last motion, without the ends that filters colour; what is written has every row";
        out + &table.text() + &paragraph("  ", rows)
    }
}

/// Sums of squares of one joint: error and torque, as measured and through the model filter.
#[derive(Clone, Copy, Default)]
struct Sums {
    raw: [f64; 2],
    filtered: [f64; 2],
}

/// Torque of the file's best parameters along a log, on the log's own rows, `[joint][row]`.
pub fn along(robot: &Robot, log: &Log) -> Result<Vec<Vec<f64>>> {
    let Positions { pieces, noise } = smoothed(robot, log, pieces_of(log)?);
    let mut all = OnRows::new(robot.dof());
    for (piece, motion) in pieces.iter().zip(runs::motions(&pieces)) {
        all.add(piece, &predict_piece(robot, piece, &motion, &noise)?);
    }
    Ok(all.finish(log).0)
}

/// Torque on the rows of a log, piece after piece.
struct OnRows {
    t: Vec<f64>,
    tau: Vec<Vec<f64>>,
}

impl OnRows {
    fn new(joints: usize) -> OnRows {
        OnRows { t: Vec::new(), tau: vec![Vec::new(); joints] }
    }

    fn add(&mut self, piece: &Piece, predicted: &[Vec<f64>]) {
        self.t.extend_from_slice(&piece.logged_t);
        for (tau, grid) in self.tau.iter_mut().zip(predicted) {
            tau.extend(interpolate(&piece.grid.t, grid, &piece.logged_t));
        }
    }

    /// Torque on every row, and how many rows stand alone between holes: those have that of a straight line between the rows around them.
    fn finish(self, log: &Log) -> (Vec<Vec<f64>>, usize) {
        let alone = log.len() - self.t.len();
        if alone == 0 {
            return (self.tau, alone);
        }
        (self.tau.iter().map(|tau| interpolate(&self.t, tau, &log.t)).collect(), alone)
    }
}

/// Errors of the file's best parameters on a log with torque, below the model filter's cut-off: per joint \[%\]; none where no joint
/// moves, because torque at standstill depends on friction more than on the parameters.
pub fn errors(robot: &Robot, sound: &Sound<'_>) -> Result<Option<Vec<f64>>> {
    let mut sums = vec![Sums::default(); robot.dof()];
    let pieces = if sound.left_out.is_empty() {
        pieces_of(&sound.log)?
    } else {
        runs::pieces_without(&sound.left_out, &sound.log, sound.log.median_step_s())?
    };
    let Positions { pieces, noise } = smoothed(robot, &sound.log, pieces);
    if pieces.iter().all(|piece| moving(robot, piece).is_none()) {
        return Ok(None);
    }
    for (piece, motion) in pieces.iter().zip(runs::motions(&pieces)) {
        let predicted = predict_piece(robot, piece, &motion, &noise)?;
        compare(robot, piece, &predicted, &mut sums)?;
    }
    Ok(Some(sums.iter().map(|s| percent(s.filtered)).collect()))
}

/// Pieces of a log whose positions are no coarser than those that are learnt from.
struct Positions {
    pieces: Vec<Piece>,
    /// Standard deviation of white noise of the positions as logged \[rad\], per joint.
    noise: Vec<f64>,
}

/// Positions as of logs that are learnt from: what is noise near standstill has every direction, and would count against any friction.
fn smoothed(robot: &Robot, log: &Log, mut pieces: Vec<Piece>) -> Positions {
    if let Some(coarse) = coarse(robot, log) {
        for piece in &mut pieces {
            coarse.smooth_positions(robot, &mut piece.grid.q, piece.report.period_s);
        }
    }
    let rounding = |q: &[f64]| position_step(q).map_or(0.0, |step| step / 12.0_f64.sqrt());
    let noise = log.q.par_iter().map(|q| position_noise(q).max(rounding(q))).collect();
    Positions { pieces, noise }
}

/// The pieces of a log between holes, at its own rate; rows that stand alone are in none.
fn pieces_of(log: &Log) -> Result<Vec<Piece>> {
    runs::pieces(log, log.median_step_s())
}

fn percent([error, torque]: [f64; 2]) -> f64 {
    100.0 * (error / torque.max(f64::MIN_POSITIVE)).sqrt()
}

/// Time of the rows as in the file, with those that were taken together, and `tau` on them.
fn every_row(robot: &Robot, file: &Path, log: &Log, tau: &mut [Vec<f64>]) -> Result<Vec<f64>> {
    let taken_t = log.logged_t();
    // Rows were taken together, or left out as a second publisher's.
    let t = runs::recorded_times(robot, file)?;
    if t.len() == taken_t.len() {
        return Ok(taken_t.to_vec());
    }
    for tau in tau {
        *tau = interpolate(taken_t, tau, &t);
    }
    Ok(t)
}

fn predict_piece(robot: &Robot, piece: &Piece, run: &Run, noise: &[f64]) -> Result<Vec<Vec<f64>>> {
    let (signal, period) = (&robot.config.signal, piece.report.period_s);
    let smooth = ZeroPhase::new(SMOOTH * signal.model_filter_hz, signal.model_filter_order, period);
    let mut motion = Trajectory::from_positions(&positions(robot, piece), period);
    hold_ends(&mut motion, &smooth);
    let smoothing = Smoothing {
        lowest_hz: SMOOTH * signal.model_filter_hz,
        order: signal.model_filter_order,
        period_s: period,
        position_noise: noise.to_vec(),
    };
    let mut tau = predict_smoothed(&robot.model, &robot.base, robot.base_parameters(), &motion, &smoothing)
        .with_context(|| piece.grid.path.display().to_string())?;
    if let Some(beside) = memory_torque(&robot.model, &robot.nominal, run) {
        for (tau, mut beside) in tau.iter_mut().zip(beside) {
            smooth.apply(&mut beside);
            tau.iter_mut().zip(&beside).for_each(|(tau, v)| *tau += v);
        }
    }
    Ok(tau)
}

/// Holds the acceleration within the transient of `smooth` at either end of a record at its nearest value beyond it: differences of
/// the first and last positions have noise that no row before or after them averages.
fn hold_ends(motion: &mut Trajectory, smooth: &ZeroPhase) {
    let rows = motion.len();
    let transient = TRANSIENT_EDGES * smooth.edge();
    if rows <= 2 * transient {
        return;
    }
    for acceleration in &mut motion.qdd {
        let mut filtered = acceleration.clone();
        smooth.apply(&mut filtered);
        acceleration[..transient].fill(filtered[transient]);
        acceleration[rows - transient..].fill(filtered[rows - 1 - transient]);
    }
}

/// Predicted torque of so many times the largest measured one is no prediction.
const MAX_OVER_MEASURED: f64 = 3.0;

/// Joints whose predicted torque \[N m\] exceeds the drive's limit or three times the largest measured one, with a warning each.
///
/// * `tau`: predicted torque on the rows of `log`, `[joint][row]`
pub(crate) fn excessive(robot: &Robot, log: &Log, tau: &[Vec<f64>]) -> Vec<Distrust> {
    let largest = |tau: &[f64]| tau.iter().fold(0.0_f64, |most, tau| most.max(tau.abs()));
    let of_joint = |j: usize| {
        let (predicted, limit) = (largest(&tau[j]), robot.config.drive.torque_limit[j]);
        let measured = log.tau.as_ref().map(|(_, tau)| largest(&tau[j]));
        let over_measured =
            measured.is_some_and(|measured| predicted > MAX_OVER_MEASURED * measured.max(NOISE_SHARE * limit));
        let what = if predicted > limit {
            format!("the torque limit of {} N m", number(limit, 3))
        } else if over_measured {
            format!(
                "{MAX_OVER_MEASURED} times the largest measured torque of {} N m",
                number(measured.unwrap_or(0.0), 3)
            )
        } else {
            return None;
        };
        Some(Distrust {
            log: Some(runs::short_name(&log.path)),
            joint: Some(robot.model.arm.joints[j].name.clone()),
            name: EXCESSIVE_NAME,
            text: format!(
                "predicted torque reaches {} N m, above {what}: the training logs do not determine this motion; add a log in \
                 which this joint moves as here",
                number(predicted, 3)
            ),
        })
    };
    (0..robot.dof()).filter_map(of_joint).collect()
}

/// Name of the warning of predicted torque that no drive gives.
pub(crate) const EXCESSIVE_NAME: &str = "predicted_torque_excessive";
/// A joint that measures less than this share of its limit is compared with that share.
const NOISE_SHARE: f64 = 0.01;

/// The positions of a piece. Where the log is faster than the robot file's samples they are smoothed to the band of those, in which
/// parameters were identified: friction under load has the size of the links' torque, accelerations included, and second
/// differences of quantised positions at five times the rate are noise twenty-five times as large, which no filter takes out of
/// an absolute value.
fn positions(robot: &Robot, piece: &Piece) -> Vec<Vec<f64>> {
    let (own, period) = (robot.config.sample_period_s, piece.report.period_s);
    let mut q = piece.grid.q.clone();
    if FASTER * period < own {
        let band = ZeroPhase::new(BAND / own, robot.config.signal.model_filter_order, period);
        for q in &mut q {
            band.apply(q);
        }
    }
    q
}

/// Adds the squares of a piece, from its first to its last motion and without the ends that the filter colours.
fn compare(robot: &Robot, piece: &Piece, predicted: &[Vec<f64>], sums: &mut [Sums]) -> Result<()> {
    let filter = runs::model_filter(robot, piece.report.period_s);
    // Of a piece at standstill all rows count but those that the filter colours.
    let transient = TRANSIENT_EDGES * filter.edge();
    let inner = transient..piece.grid.len().saturating_sub(transient);
    let range = moving(robot, piece).unwrap_or(inner);
    if range.is_empty() {
        return Ok(());
    }
    let measured = piece.grid.torque()?;
    for (j, sums) in sums.iter_mut().enumerate() {
        let add = |to: &mut [f64; 2], tau: &[f64], predicted: &[f64]| {
            for (tau, predicted) in tau[range.clone()].iter().zip(&predicted[range.clone()]) {
                to[0] += (tau - predicted).powi(2);
                to[1] += tau * tau;
            }
        };
        add(&mut sums.raw, &measured[j], &predicted[j]);
        let (mut tau, mut model) = (measured[j].clone(), predicted[j].clone());
        filter.apply(&mut tau);
        filter.apply(&mut model);
        add(&mut sums.filtered, &tau, &model);
    }
    Ok(())
}

/// Samples of the grid between first and last motion of any joint; none where all stand still.
fn moving(robot: &Robot, piece: &Piece) -> Option<Range<usize>> {
    let filter = runs::model_filter(robot, piece.report.period_s);
    let mut speed = Trajectory::from_positions(&piece.grid.q, piece.report.period_s).qd;
    for speed in &mut speed {
        filter.apply(speed);
    }
    rivet_estimation::offline::moving_range(&speed, &robot.config.signal.dead_zone, TRANSIENT_EDGES * filter.edge())
}
