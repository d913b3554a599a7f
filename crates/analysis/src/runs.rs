//! Logs of a robot as uniform records for off-line work.

use std::f64::consts::TAU;
use std::path::Path;

use anyhow::Result;
use rivet_config::{Instruments, Robot};
use rivet_diagnosis::{Past, Run, of_one_clock};
use rivet_dynamics::{Joint, JointKind};
use rivet_estimation::offline::{InstrumentSource, OfflineSettings, Record, Trajectory, ZeroPhase, underived};
use rivet_logs::{
    Log, LogError, LogFault, Naming, OtherClock, ReadOptions, ResampleReport, Signals, read_as, recognized_format,
    time_unit_fault,
};

use crate::fault::Fault;
use crate::map;
use crate::publishers;
use crate::session;

/// A step of time this long is a hole: nothing is made up across it.
const HOLE_S: f64 = 0.1;
/// Rows this many sample periods apart show no motion: their time is in another unit.
const SLOWEST: f64 = 500.0;
/// Rows so far apart show no motion of any arm \[s\].
const SLOWEST_S: f64 = 0.5;
/// A joint does not run through so many times its range, nor through so many turns: its positions are in another unit.
const BEYOND: f64 = 2.0;
/// A hole is also longer than this many usual steps.
const HOLE_STEPS: f64 = 10.0;

/// Reads a log of the robot: its joints, its zero, its drive gain, and the clock of its positions.
pub fn read_log(robot: &Robot, path: &Path) -> Result<Log> {
    let config = &robot.config;
    let log = recorded(robot, path)?;
    check_time(&log)?;
    publishers::note_reading(&log, &short_name(path));
    let log = publishers::without_second_publisher(log, short_name(path));
    let log = log.by_its_positions().without_crowds();
    let (step, period) = (log.median_step_s(), config.sample_period_s);
    let file = path.display();
    if step >= SLOWEST * period {
        return Err(Fault::Data(format!(
            "{file}: its rows are {step} s apart, the samples of {} {period} s: is column t in seconds?",
            config.name
        ))
        .into());
    }
    let why = strange_unit(&robot.model.arm.joints, &log.q, &config.log.joint_zero)
        .or_else(|| strange_plan(&robot.model.arm.joints, &log));
    match why.or_else(|| log.other_clock().as_ref().map(wrong_clock)) {
        Some(why) => Err(Fault::Data(format!("{file}: {why}")).into()),
        None => Ok(log),
    }
}

/// That the times of a log may be in seconds.
///
/// # Errors
/// Rows are so far apart that they show no motion, and they would not be in ms, us or ns.
pub(crate) fn check_time(log: &Log) -> Result<(), LogError> {
    let fault = (log.median_step_s() >= SLOWEST_S).then(|| time_unit_fault(&log.t)).flatten();
    fault.map_or(Ok(()), |fault| Err(LogError { path: log.path.clone(), fault }))
}

/// Reads the robot file that a command takes in front of logs, with the channels of `entries` in the place of its own.
///
/// # Errors
/// Every mistake in the file; where it is a recording, the order of the arguments instead. As of [`map::apply`].
pub fn load_robot(path: &Path, entries: &[String]) -> Result<Robot> {
    let robot = rivet_config::load(path);
    let robot = robot.map_err(|why| wrong_order(path, "ROBOT.toml LOG...").unwrap_or_else(|| why.into()))?;
    map::apply(robot, entries)
}

/// That a recording stands where a description of the arm has to; none where `path` is no recording.
pub(crate) fn wrong_order(path: &Path, order: &str) -> Option<anyhow::Error> {
    let format = recognized_format(path)?;
    let why = format!("{}: is a log ({format}), where the arm is expected; the order is {order}", path.display());
    Some(Fault::Usage(why).into())
}

/// Time of every row of a recording \[s\], those with damaged cells included.
pub(crate) fn recorded_times(robot: &Robot, path: &Path) -> Result<Vec<f64>> {
    let log = recorded(robot, path)?;
    let mut t = log.t;
    t.extend(log.damaged_t);
    t.sort_unstable_by(f64::total_cmp);
    Ok(t)
}

/// What the robot file states of its recordings, without their channels.
pub(crate) fn read_options(robot: &Robot) -> ReadOptions<'_> {
    ReadOptions {
        joints: robot.dof(),
        drive_gain: robot.config.drive.drive_gain.as_deref(),
        torque_from_current: robot.config.log.torque_from_current,
        joint_zero: Some(&robot.config.log.joint_zero),
    }
}

/// A recording as it is, with its channels as the robot file and the command line state them.
fn recorded(robot: &Robot, path: &Path) -> Result<Log> {
    let config = &robot.config;
    let (names, channels) = (joint_names(robot), map::channels(robot)?);
    read_as(path, &read_options(robot), &Naming { joints: &names, map: &channels }).map_err(|why| {
        let asked = matches!(why.fault, LogFault::NoCurrent { .. });
        let why = anyhow::Error::new(why);
        // What asks for these columns stands in another file.
        if asked { why.context(format!("{}: [log] torque_from = \"current\"", config.path.display())) } else { why }
    })
}

/// Two columns are of one motion from this correlation on ...
const SAME_MOTION: f64 = 0.98;
/// ... where it is more than so much, in the larger unit \[rad\], root mean square ...
const LEAST_MOTION: f64 = 0.1;
/// ... and one is in degrees by so large a share.
const DEGREES: f64 = 0.05;

/// Every speed, and every acceleration twice, would be wrong by the factor: rotors and friction that no arm has.
fn wrong_clock(clock: &OtherClock) -> String {
    let pairs: Vec<String> = clock.columns.iter().map(|[q, qd]| format!("{q} with {qd}")).collect();
    if (clock.factor.to_radians() - 1.0).abs() < DEGREES {
        return format!(
            "positions change {:.3} times as fast as the log's speeds, on all {} joints that move ({}); both must be \
             in radians: are these positions in degrees?",
            clock.factor,
            clock.joints,
            pairs.join(", ")
        );
    }
    format!(
        "by column t positions change {:.3} times as fast as the log's speeds, on all {} joints that move ({}): is t \
         in seconds, from the clock of these columns? If the speeds are wrong, log without them",
        clock.factor,
        clock.joints,
        pairs.join(", ")
    )
}

/// Logs of which no two hold the same samples: what was looked at is no unseen motion, and what counts twice is not known better.
pub(crate) fn check_distinct<'a>(logs: impl Iterator<Item = (&'a Path, &'a Log)>) -> Result<()> {
    let mut before: Vec<(&Path, &Log)> = Vec::new();
    for (path, log) in logs {
        for (other, one) in &before {
            let shared = log.shared_s(one);
            if shared > 0.0 {
                let (all, other, path) = (log.duration_s(), other.display(), path.display());
                return Err(Fault::Data(format!(
                    "{other} and {path} hold the same samples: {shared:.2} s of the {all:.2} s of the latter. A run that was looked \
                     at cannot be sealed; give every recording once, and cuts of it that do not overlap"
                ))
                .into());
            }
        }
        before.push((path, log));
    }
    Ok(())
}

/// The column of positions that no joint of the arm can have run through, if there is one. Joints in a wrong order, a wrong zero and
/// turns too many are other mistakes: a position has to be out of reach by far, and in reach where it is taken for degrees.
fn strange_unit(joints: &[Joint], q: &[Vec<f64>], zero: &[f64]) -> Option<String> {
    let off = |(j, (joint, q)): (usize, (&Joint, &Vec<f64>))| {
        let range = joint.upper - joint.lower;
        let far = (BEYOND * range).max(BEYOND * TAU);
        let span = |(low, high): (f64, f64), q: &f64| (low.min(*q), high.max(*q));
        let (low, high) = q.iter().fold((f64::INFINITY, f64::NEG_INFINITY), span);
        let bounded = joint.kind == JointKind::Revolute && range.is_finite();
        if !bounded || high - low <= far {
            return None;
        }
        // A few rows that jump are another fault, which is dealt with elsewhere.
        let mut sorted = q.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        let rare = sorted.len() / 20;
        let zero = zero.get(j).copied().unwrap_or(0.0);
        let (low, high) = (sorted[rare] - zero, sorted[sorted.len() - 1 - rare] - zero);
        (high - low > far && (high - low).to_radians() <= range).then(|| {
            format!(
                "column q{}: runs from {low:.1} to {high:.1}, {} can turn by {range:.2} rad; positions are in radians: are these \
                 degrees?",
                j + 1,
                joint.name
            )
        })
    };
    joints.iter().zip(q).enumerate().find_map(off)
}

/// The column of positions that runs through 57.3 times as many numbers as another one of the same motion, if there is one.
fn strange_plan(joints: &[Joint], log: &Log) -> Option<String> {
    let plan = log.q_des.as_ref()?;
    let unit_error = |(j, joint): (usize, &Joint)| {
        if joint.kind != JointKind::Revolute {
            return None;
        }
        let [qq, qp, pp] = squares(&log.q[j], &plan[j]);
        // Of a joint that hardly moves it is noise.
        let is_same_motion =
            qp > SAME_MOTION * (qq * pp).sqrt() && qq.max(pp) > log.len() as f64 * LEAST_MOTION.powi(2);
        let degrees = |times: f64| (times.to_radians() - 1.0).abs() < DEGREES;
        let times = (pp / qq).sqrt();
        let (q, plan) = (format!("q{}", j + 1), format!("q_des{}", j + 1));
        let (wrong, right) = if degrees(times) { (plan, q) } else { (q, plan) };
        (is_same_motion && (degrees(times) || degrees(1.0 / times))).then(|| {
            format!(
                "column {wrong}: changes 57.3 times as much as {right}, which is the same motion; positions are in radians: are these degrees?"
            )
        })
    };
    joints.iter().enumerate().find_map(unit_error)
}

/// Sums of squares and products of two signals about their means.
fn squares(a: &[f64], b: &[f64]) -> [f64; 3] {
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len().max(1) as f64;
    let (of_a, of_b) = (mean(a), mean(b));
    a.iter().zip(b).fold([0.0; 3], |[aa, ab, bb], (a, b)| {
        let (a, b) = (a - of_a, b - of_b);
        [aa + a * a, ab + a * b, bb + b * b]
    })
}

/// Between rows that are more than so many usual steps apart rows are missing.
const LACKS_STEPS: f64 = 1.5;
/// A sample this near to a row has its noise \[usual steps\].
const NEAR_STEPS: f64 = 0.25;

/// A stretch of a log without holes, on a uniform grid.
pub struct Piece {
    /// Time of the rows as logged \[s\].
    pub logged_t: Vec<f64>,
    /// The same stretch on the grid.
    pub grid: Log,
    /// What resampling did.
    pub report: ResampleReport,
}

impl Piece {
    /// Samples of the grid (ascending) that no row is near where rows are missing.
    fn interpolated(&self) -> Vec<usize> {
        let usual = self.report.median_step_s;
        let is_far = |t: f64| {
            let next = self.logged_t.partition_point(|logged| *logged < t);
            let [before, behind] = [next.checked_sub(1), Some(next)].map(|k| self.logged_t.get(k?).copied());
            let (Some(before), Some(behind)) = (before, behind) else { return false };
            behind - before > LACKS_STEPS * usual && (t - before).min(behind - t) > NEAR_STEPS * usual
        };
        (0..self.grid.len()).filter(|k| is_far(self.grid.t[*k])).collect()
    }
}

/// The step of time that is a hole in a log of usual step `usual_s` \[s\].
pub fn hole_s(usual_s: f64) -> f64 {
    HOLE_S.max(HOLE_STEPS * usual_s)
}

/// Cuts a log at its holes and puts each piece on a grid of `period_s`, or of the log's own usual step where that is
/// longer: interpolation adds no knowledge. A piece of too few rows for that is left out, which is said, unless all are.
pub fn pieces(log: &Log, period_s: f64) -> Result<Vec<Piece>> {
    pieces_without(&[], log, period_s)
}

/// The same without rows (ascending): nothing is made up across them either.
pub(crate) fn pieces_without(left_out: &[usize], log: &Log, period_s: f64) -> Result<Vec<Piece>> {
    let usual = log.median_step_s();
    let period = if usual > 1.1 * period_s { usual } else { period_s };
    let (mut pieces, mut short) = (Vec::new(), None);
    for logged in log.split_without(left_out, hole_s(usual)) {
        match logged.resample(period) {
            Ok((grid, report)) => pieces.push(Piece { logged_t: logged.t.clone(), grid, report }),
            Err(why @ LogError { fault: LogFault::TooFewRows { .. }, .. }) => {
                let (path, rows, from) = (logged.path.display(), logged.len(), logged.t[0]);
                session::note(format_args!(
                    "rivet: {path}: {rows} rows from {from} s between gaps are too few and excluded"
                ));
                // The first one is the error to report where nothing is left.
                short.get_or_insert(why);
            }
            Err(why) => return Err(why.into()),
        }
    }
    match short {
        Some(why) if pieces.is_empty() => Err(why.into()),
        _ => Ok(pieces),
    }
}

/// The piece as a record with torque, to which its signals go: its grid keeps the time, and which signals there were. Where rows are off
/// their time what that makes of positions and torque is asked later, and the grid keeps all of it.
pub(crate) fn record(piece: &mut Piece) -> Result<Record> {
    let (log, period_s, keeps) = (&mut piece.grid, piece.report.period_s, piece.report.off_s > 0.0);
    log.torque()?;
    let taken = |signals: &mut Signals| -> Signals {
        if keeps { signals.clone() } else { signals.iter_mut().map(std::mem::take).collect() }
    };
    let measured = Trajectory::from_positions(&taken(&mut log.q), period_s);
    let second: Option<Signals> = log.q_link.iter_mut().map(|q| q.as_mut().map(std::mem::take)).collect();
    let second = second.map(|q| Trajectory::from_positions(&q, period_s));
    let [q, qd, qdd] = [&mut log.q_des, &mut log.qd_des, &mut log.qdd_des].map(|s| s.as_mut().map(taken));
    let desired = q.map(|q| planned(q, qd, qdd, period_s));
    let tau = log.tau.as_mut().map(|(_, tau)| taken(tau)).unwrap_or_default();
    Ok(Record { period_s, measured, tau, desired, second })
}

/// Joints (from 0) of a log on a grid whose desired velocities or accelerations are not those of their desired positions; none where the
/// log gives neither.
pub fn not_derived(grid: &Log, period_s: f64) -> Vec<usize> {
    let Some(q) = grid.q_des.as_ref().filter(|_| grid.qd_des.is_some() || grid.qdd_des.is_some()) else {
        return Vec::new();
    };
    if let (Some(qd), Some(qdd)) = (&grid.qd_des, &grid.qdd_des) {
        return underived([q, qd, qdd], period_s);
    }
    let made = Trajectory::from_positions(q, period_s);
    let [qd, qdd] =
        [(&grid.qd_des, &made.qd), (&grid.qdd_des, &made.qdd)].map(|(given, made)| given.as_ref().unwrap_or(made));
    underived([q, qd, qdd], period_s)
}

/// The desired motion.
fn desired(log: &Log, period_s: f64) -> Option<Trajectory> {
    log.q_des.clone().map(|q| planned(q, log.qd_des.clone(), log.qdd_des.clone(), period_s))
}

/// A motion of which some derivatives are known; the others, and those that are none, are differences.
fn planned(q: Signals, qd: Option<Signals>, qdd: Option<Signals>, period_s: f64) -> Trajectory {
    let mut plan = match (qd, qdd) {
        (Some(qd), Some(qdd)) => Trajectory { q, qd, qdd },
        (qd, qdd) => {
            let made = Trajectory::from_positions(&q, period_s);
            Trajectory { q, qd: qd.unwrap_or(made.qd), qdd: qdd.unwrap_or(made.qdd) }
        }
    };
    let broken = underived([&plan.q, &plan.qd, &plan.qdd], period_s);
    if !broken.is_empty() {
        let mut made = Trajectory::from_positions(&plan.q, period_s);
        for j in broken {
            plan.qd[j] = std::mem::take(&mut made.qd[j]);
            plan.qdd[j] = std::mem::take(&mut made.qdd[j]);
        }
    }
    plan
}

/// The pieces of a log as runs of a diagnosis.
pub fn runs(path: &Path, pieces: &[Piece]) -> Result<Vec<Run>> {
    let run = |piece: &Piece| {
        Ok(Run {
            name: short_name(path),
            period_s: piece.report.period_s,
            q: piece.grid.q.clone(),
            tau: piece.grid.torque()?.clone(),
            temperature: piece.grid.temperature.clone(),
            desired: desired(&piece.grid, piece.report.period_s),
            past: Past::default(),
            interpolated: piece.interpolated(),
        })
    };
    let mut runs: Vec<Run> = pieces.iter().map(run).collect::<Result<_>>()?;
    of_one_clock(&mut runs, &starts(pieces));
    Ok(runs)
}

/// When pieces began, by their log's clock \[s\].
pub(crate) fn starts(pieces: &[Piece]) -> Vec<f64> {
    pieces.iter().map(|piece| piece.grid.t.first().copied().unwrap_or(0.0)).collect()
}

/// The pieces of a log as runs without torque.
pub(crate) fn motions(pieces: &[Piece]) -> Vec<Run> {
    let mut runs: Vec<Run> = pieces.iter().map(motion_of).collect();
    of_one_clock(&mut runs, &starts(pieces));
    runs
}

fn motion_of(piece: &Piece) -> Run {
    Run {
        name: piece.grid.path.display().to_string(),
        period_s: piece.report.period_s,
        q: piece.grid.q.clone(),
        tau: vec![vec![0.0; piece.grid.len()]; piece.grid.q.len()],
        temperature: piece.grid.temperature.clone(),
        ..Run::default()
    }
}

/// How rows are made of a log of this robot; instruments as configured, desired motion only where the log has one.
pub(crate) fn settings(robot: &Robot, has_desired: bool) -> OfflineSettings {
    let (config, signal) = (&robot.config, &robot.config.signal);
    let instrument = match config.estimator.instruments {
        // Off-line the tracking lag of the whole record is known: the setpoint always goes through it.
        Instruments::Setpoint | Instruments::SetpointThroughLoop => InstrumentSource::Desired,
        Instruments::Auto { .. } if has_desired => InstrumentSource::Desired,
        Instruments::Auto { delay_s, .. }
        | Instruments::PreviousCycle { delay_s, .. }
        | Instruments::Delayed { delay_s } => InstrumentSource::Delayed(delay_s),
        Instruments::SecondEncoder => InstrumentSource::SecondEncoder,
    };
    OfflineSettings {
        filter_hz: signal.model_filter_hz,
        filter_order: signal.model_filter_order,
        row_period_s: config.sample_period_s * signal.decimation as f64,
        dead_zone: signal.dead_zone.clone(),
        instrument,
    }
}

/// The configured model filter, zero-phase, for records of a period.
pub(crate) fn model_filter(robot: &Robot, period_s: f64) -> ZeroPhase {
    let signal = &robot.config.signal;
    ZeroPhase::new(signal.model_filter_hz, signal.model_filter_order, period_s)
}

/// A path's last part, for messages.
pub fn short_name(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}

/// The joints' names in the URDF.
pub fn joint_names(robot: &Robot) -> Vec<String> {
    robot.model.arm.joints.iter().map(|joint| joint.name.clone()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A log at 5 kHz for a robot at 1 kHz, of pieces with so many rows and a second between them.
    fn log(pieces: &[usize]) -> Log {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("log.csv");
        let row = |t: f64| format!("{t},{},0.5\n", t.sin());
        let rows =
            pieces.iter().enumerate().flat_map(|(k, rows)| (0..*rows).map(move |r| 2.0 * k as f64 + 2e-4 * r as f64));
        std::fs::write(&path, rows.map(row).fold("t,q1,tau1\n".to_owned(), |text, row| text + &row)).expect("written");
        rivet_logs::read(&path, &ReadOptions::new(1)).expect("a log")
    }

    #[test]
    fn names_the_unit_of_times_that_are_not_in_seconds() {
        let robot = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../robots/dd2/robot.toml");
        let robot = rivet_config::load(robot).expect("the arm is there");
        let folder = tempfile::tempdir().expect("a folder");
        // At 1 kHz and at 100 Hz.
        for step_s in [1e-3, 1e-2] {
            for (unit, factor) in [("ms", 1e3), ("us", 1e6), ("ns", 1e9)] {
                for start_s in [0.0, 1.7e9] {
                    let path = folder.path().join("log.csv");
                    let row = |k: u32| {
                        let t = f64::from(k) * step_s;
                        format!("{:.1},{},{},0.5,0.5\n", factor * (start_s + t), t.sin(), t.cos())
                    };
                    let text = (0..400).map(row).fold("t,q1,q2,tau1,tau2\n".to_owned(), |text, row| text + &row);
                    std::fs::write(&path, text).expect("written");
                    let why = read_log(&robot, &path).expect_err("another unit").to_string();
                    assert!(why.contains(&format!("--map time_unit={unit}")), "{step_s} s, {start_s} s, {unit}: {why}");
                    let read = map::apply(robot.clone(), &[format!("time_unit={unit}")]).expect("a key");
                    read_log(&read, &path).expect("in seconds then");
                }
            }
        }
    }

    #[test]
    fn tells_the_order_where_a_log_is_in_the_place_of_the_robot_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let csv = folder.path().join("log.csv");
        std::fs::write(&csv, "t,q1,tau1\n0,1,2\n0.1,1,2\n").expect("written");
        let parquet = folder.path().join("log.parquet");
        rivet_logs::write_columns(&parquet, &[("t".to_owned(), &[0.0, 0.1])]).expect("written");
        for (path, format) in [(csv, "CSV"), (parquet, "Parquet")] {
            let why = load_robot(&path, &[]).expect_err("no robot file");
            assert_eq!(crate::fault::kind(&why), crate::fault::Kind::Usage);
            assert!(why.to_string().contains(&format!("is a log ({format})")), "{why}");
            assert!(why.to_string().contains("the order is ROBOT.toml LOG"), "{why}");
        }
        // What is a robot file with mistakes is told its mistakes.
        for text in
            ["name = \"x\"\n", "name = 1\nurdf = 2\nsample_period_s = 3\n", "a\n", "[drive]\ntorque_limit = [1, 2]\n"]
        {
            let path = folder.path().join("robot.toml");
            std::fs::write(&path, text).expect("written");
            let why = load_robot(&path, &[]).expect_err("mistakes");
            assert_eq!(crate::fault::kind(&why), crate::fault::Kind::Config, "{why}");
        }
    }

    #[test]
    fn a_piece_too_short_to_be_decimated_is_left_out_unless_all_are() {
        let rows =
            |log: &Log| pieces(log, 1e-3).map(|pieces| pieces.iter().map(|p| p.logged_t.len()).collect::<Vec<_>>());
        assert_eq!(rows(&log(&[500, 50, 300])).expect("two pieces"), [500, 300]);
        let why = rows(&log(&[90, 60])).expect_err("nothing is left").to_string();
        assert!(why.contains("90") && why.contains("91"), "{why}");
    }
}
