//! A checked log.

use std::borrow::Cow;
use std::ops::Range;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use crate::channel_map::ChannelMap;
use crate::columns::{Group, Table};
use crate::damaged;
use crate::error::{LogError, LogFault};
use crate::guess;
use crate::listing::Conventions;
use crate::plan::{Naming, Plan};
use crate::readers;
use crate::time_unit::time_unit_fault;

/// One signal a joint: `signals[joint][row]`.
pub type Signals = Vec<Vec<f64>>;

/// Rows below which a file is a mistake and not a log.
pub(crate) const LEAST_ROWS: usize = 10;

/// What the robot file says about its logs.
#[derive(Clone, Copy, Debug)]
pub struct ReadOptions<'a> {
    /// Number of joints; a log with other columns is refused.
    pub joints: usize,
    /// Torque at the joint per motor current \[N m/A\], for logs with current and without torque.
    pub drive_gain: Option<&'a [f64]>,
    /// Whether torque is taken from current even where the log has torque columns.
    pub torque_from_current: bool,
    /// Added to every logged position \[rad\]: the model's position where the log says zero.
    pub joint_zero: Option<&'a [f64]>,
}

impl ReadOptions<'_> {
    /// A log of `joints` joints in the model's own zero, with torque.
    pub fn new(joints: usize) -> Self {
        ReadOptions { joints, drive_gain: None, torque_from_current: false, joint_zero: None }
    }
}

/// Where the torque of a log comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TorqueSource {
    /// The log's `tau` columns.
    Logged,
    /// Drive gain times the log's `current` columns.
    Current,
}

/// A log whose every number was checked: finite, time increasing, columns of one length, the robot's joints.
#[derive(Clone, Debug, PartialEq)]
pub struct Log {
    /// The file it was read from.
    pub path: PathBuf,
    /// Time \[s\], as in the file if `stamps` are none.
    pub t: Vec<f64>,
    /// Measured positions \[rad\], in the model's zero.
    pub q: Signals,
    /// Measured torque \[N m\], joint side, and where it comes from.
    pub tau: Option<(TorqueSource, Signals)>,
    /// Measured velocities \[rad/s\].
    pub qd: Option<Signals>,
    /// Commanded positions \[rad\], in the model's zero.
    pub q_des: Option<Signals>,
    /// Commanded velocities \[rad/s\].
    pub qd_des: Option<Signals>,
    /// Commanded accelerations \[rad/s²\].
    pub qdd_des: Option<Signals>,
    /// Motor temperatures \[degC\].
    pub temperature: Option<Signals>,
    /// Motor currents \[A\].
    pub current: Option<Signals>,
    /// Load-side encoders \[rad\], in the model's zero; joints may lack one.
    pub q_link: Vec<Option<Vec<f64>>>,
    /// Columns of the file that were not read.
    pub unused: Vec<String>,
    /// Time stamps as in the file \[s\], where `t` is the even clock of the positions instead ([`Log::by_its_positions`]).
    pub stamps: Option<Vec<f64>>,
    /// What is left of jitter in `t` \[s\], root mean square, and at most, by what positions say; 0 where they follow `t`.
    pub off_s: f64,
    /// Rows of the file that came right after another and were taken together with it ([`Log::without_crowds`]).
    pub crowded: usize,
    /// Times \[s\] of rows of the file that were left out because a value was not finite.
    pub damaged_t: Vec<f64>,
    /// How its channels were found, and what is wrong with the file although it was read.
    pub notes: Vec<String>,
}

/// Reads a log; what it begins with decides its format, not its name. Joints are found by number.
///
/// # Errors
/// As [`read_as`].
pub fn read(path: impl AsRef<Path>, options: &ReadOptions<'_>) -> Result<Log, LogError> {
    read_as(path, options, &Naming { joints: &[], map: &ChannelMap::default() })
}

/// Reads a recording, with joints by their names and channels as they are stated. Columns of the contract (`t`, `q1..N`) are taken as
/// they are; where there are none, names decide, and [`Log::notes`] lists what they decided. A few rows with a value that is not finite are
/// left out, with a note.
///
/// # Errors
/// The recording cannot be read, a stated channel does not fit it, names fit more than one group of columns, a value breaks a rule, or more
/// than a tenth of the rows have a value that is not finite.
pub fn read_as(path: impl AsRef<Path>, options: &ReadOptions<'_>, naming: &Naming<'_>) -> Result<Log, LogError> {
    let path = path.as_ref();
    let reader = readers::find(path)?;
    let listing = readers::list(path)?;
    let plan =
        Plan::find(&listing, naming, options.joints, options.torque_from_current).map_err(|fault| fault.at(path))?;
    let options = match plan.conventions() {
        Conventions::Recorder => *options,
        Conventions::Model => ReadOptions { torque_from_current: false, joint_zero: None, ..*options },
    };
    let mut table = (reader.read)(path, &|name| plan.wants(name))?;
    let warnings = std::mem::take(&mut table.warnings);
    let (mut table, notes) = plan.apply(table).map_err(|fault| fault.at(path))?;
    let damaged = damaged::take_out(&mut table, LARGEST, LEAST_ROWS);
    let log = Log::from_table(path, table, &options).map_err(|fault| fault.at(path))?;
    let notes = warnings.into_iter().chain(notes).chain(damaged.note).collect();
    Ok(Log { notes, damaged_t: damaged.t, ..log })
}

/// Reads columns by name from a recording that need not be a log, such as a prediction. All are there, of one
/// length, and every value is finite.
pub fn read_columns(path: impl AsRef<Path>, names: &[&str]) -> Result<Vec<Vec<f64>>, LogError> {
    let path = path.as_ref();
    let mut table = (readers::find(path)?.read)(path, &|name| names.contains(&name))?;
    let mut columns: Vec<Vec<f64>> = Vec::with_capacity(names.len());
    for name in names {
        let column = table.columns.remove(*name).ok_or_else(|| {
            let rule = format!("{} are asked for", names.join(", "));
            LogFault::MissingColumn { column: (*name).to_owned(), rule }.at(path)
        })?;
        let rows = columns.first().map_or(column.len(), Vec::len);
        check_values(name, &column, rows).map_err(|fault| fault.at(path))?;
        columns.push(column);
    }
    Ok(columns)
}

impl Log {
    /// Number of rows.
    pub fn len(&self) -> usize {
        self.t.len()
    }

    /// Whether there is no row; a log that was read has some.
    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }

    /// Number of joints.
    pub fn joints(&self) -> usize {
        self.q.len()
    }

    /// Time from the first to the last row \[s\].
    pub fn duration_s(&self) -> f64 {
        self.t.last().zip(self.t.first()).map_or(0.0, |(last, first)| last - first)
    }

    /// The torque \[N m\], or the error that the log has none.
    pub fn torque(&self) -> Result<&Signals, LogError> {
        match &self.tau {
            Some((_, tau)) => Ok(tau),
            None if self.current.is_some() => Err(LogFault::NoDriveGain { joints: self.joints() }.at(&self.path)),
            None => Err(LogFault::NoTorque { joints: self.joints() }.at(&self.path)),
        }
    }

    /// The rows of a range.
    #[must_use]
    pub fn slice(&self, rows: Range<usize>) -> Log {
        let stamps = self.stamps.as_ref().map(|stamps| stamps[rows.clone()].to_vec());
        Log { stamps, ..self.map(self.t[rows.clone()].to_vec(), |_, signal| signal[rows.clone()].to_vec()) }
    }

    /// Every `step`-th row, from the first on.
    #[must_use]
    pub fn every(&self, step: usize) -> Log {
        let thinned = |signal: &[f64]| signal.iter().step_by(step.max(1)).copied().collect::<Vec<f64>>();
        let stamps = self.stamps.as_deref().map(thinned);
        Log { stamps, ..self.map(thinned(&self.t), |_, signal| thinned(signal)) }
    }

    /// The log without rows (ascending): their time is a hole of a row each.
    #[must_use]
    pub fn without(&self, rows: &[usize]) -> Log {
        let kept = |signal: &[f64]| {
            let mut rows = rows.iter().peekable();
            let stays = |(k, x): (usize, &f64)| if rows.next_if_eq(&&k).is_some() { None } else { Some(*x) };
            signal.iter().enumerate().filter_map(stays).collect::<Vec<f64>>()
        };
        let stamps = self.stamps.as_deref().map(kept);
        Log { stamps, ..self.map(kept(&self.t), |_, signal| kept(signal)) }
    }

    /// Cuts the log where time jumps by more than `gap_s`, so that nothing is made up across a hole.
    /// Pieces too short to work with are dropped; a log without a hole is its own piece.
    pub fn split_at_gaps(&self, gap_s: f64) -> Vec<Cow<'_, Log>> {
        self.split_without(&[], gap_s)
    }

    /// The same without the rows `left_out` (ascending), at which the log is cut as well.
    pub fn split_without(&self, left_out: &[usize], gap_s: f64) -> Vec<Cow<'_, Log>> {
        let (mut cuts, mut from) = (Vec::new(), 0);
        let mut left_out = left_out.iter().peekable();
        for k in 0..self.len() {
            if k > from && self.t[k] - self.t[k - 1] > gap_s {
                cuts.push(from..k);
                from = k;
            }
            if left_out.next_if_eq(&&k).is_some() {
                cuts.push(from..k);
                from = k + 1;
            }
        }
        cuts.push(from..self.len());
        if cuts.len() == 1 && self.len() >= LEAST_ROWS {
            return vec![Cow::Borrowed(self)];
        }
        let pieces = cuts.into_iter().filter(|c| c.len() >= LEAST_ROWS);
        pieces.map(|c| Cow::Owned(self.slice(c))).collect()
    }

    /// A log with the time `t` and every signal passed through `change`, which is told the group.
    pub(crate) fn map(&self, t: Vec<f64>, change: impl Fn(Group, &[f64]) -> Vec<f64> + Sync) -> Log {
        let all =
            |group, signals: &Signals| -> Signals { signals.par_iter().map(|signal| change(group, signal)).collect() };
        let some = |group, signals: &Option<Signals>| signals.as_ref().map(|s| all(group, s));
        Log {
            path: self.path.clone(),
            t,
            q: all(Group::Position, &self.q),
            tau: self.tau.as_ref().map(|(source, tau)| (*source, all(Group::Torque, tau))),
            qd: some(Group::Velocity, &self.qd),
            q_des: some(Group::DesiredPosition, &self.q_des),
            qd_des: some(Group::DesiredVelocity, &self.qd_des),
            qdd_des: some(Group::DesiredAcceleration, &self.qdd_des),
            temperature: some(Group::Temperature, &self.temperature),
            current: some(Group::Current, &self.current),
            q_link: self.q_link.iter().map(|signal| signal.as_ref().map(|s| change(Group::LinkPosition, s))).collect(),
            unused: self.unused.clone(),
            stamps: None,
            off_s: self.off_s,
            crowded: self.crowded,
            damaged_t: self.damaged_t.clone(),
            notes: self.notes.clone(),
        }
    }

    fn from_table(path: &Path, mut table: Table, options: &ReadOptions<'_>) -> Result<Log, LogFault> {
        let joints = options.joints;
        for (name, list) in [("drive_gain", options.drive_gain), ("joint_zero", options.joint_zero)] {
            if let Some(list) = list.filter(|list| list.len() != joints) {
                return Err(LogFault::SettingLength { name, found: list.len(), joints });
            }
        }
        if let Some(column) = table.beyond(joints) {
            return Err(LogFault::JointCount { column: column.to_owned(), joints });
        }
        let t = table.columns.remove("t").ok_or_else(|| LogFault::MissingColumn {
            column: "t".to_owned(),
            rule: format!("a log has t [s] and q1..N [rad]. {}", guess::sentence(&table.names())),
        })?;
        if t.is_empty() {
            return Err(LogFault::Empty { what: "it has columns and no rows" });
        }
        if t.len() < LEAST_ROWS {
            return Err(LogFault::TooFewRows { rows: t.len(), least: LEAST_ROWS, purpose: "in a log" });
        }
        check_values("t", &t, t.len()).map_err(|fault| match fault {
            // Times since 1970 in a smaller unit.
            LogFault::Beyond { .. } => time_unit_fault(&t).unwrap_or(fault),
            fault => fault,
        })?;
        if let Some(k) = (1..t.len()).find(|k| t[*k] - t[k - 1] < LEAST_STEP_S) {
            return Err(LogFault::Time { row: k + 1, value: t[k], previous: t[k - 1] });
        }
        let rows = t.len();
        let names: Vec<String> = std::iter::once("t".to_owned()).chain(table.names()).collect();
        let mut group = |group: Group| take_group(&mut table, group, joints, rows);
        let mut q = group(Group::Position)?.ok_or_else(|| LogFault::MissingColumn {
            column: Group::Position.column(0),
            rule: format!("a log of this robot has q1..{joints} [rad]. {}", guess::sentence(&names)),
        })?;
        let tau = group(Group::Torque)?;
        let current = group(Group::Current)?;
        let qd = group(Group::Velocity)?;
        let mut q_des = group(Group::DesiredPosition)?;
        let qd_des = group(Group::DesiredVelocity)?;
        let qdd_des = group(Group::DesiredAcceleration)?;
        let temperature = group(Group::Temperature)?;
        let mut q_link = take_link_positions(&mut table, joints, rows)?;
        if let Some(zero) = options.joint_zero {
            let shift = |signal: &mut Vec<f64>, zero: f64| signal.iter_mut().for_each(|q| *q += zero);
            for (joint, zero) in zero.iter().enumerate() {
                shift(&mut q[joint], *zero);
                if let Some(q_des) = &mut q_des {
                    shift(&mut q_des[joint], *zero);
                }
                if let Some(signal) = &mut q_link[joint] {
                    shift(signal, *zero);
                }
            }
        }
        if options.torque_from_current && current.is_none() {
            return Err(LogFault::NoCurrent { joints });
        }
        let tau = match (tau.filter(|_| !options.torque_from_current), &current, options.drive_gain) {
            (Some(tau), _, _) => Some((TorqueSource::Logged, tau)),
            (None, Some(current), Some(gain)) => {
                let scaled = current.iter().zip(gain).map(|(i, k)| i.iter().map(|i| k * i).collect());
                Some((TorqueSource::Current, scaled.collect()))
            }
            _ => None,
        };
        Ok(Log {
            path: path.to_path_buf(),
            t,
            q,
            tau,
            qd,
            q_des,
            qd_des,
            qdd_des,
            temperature,
            current,
            q_link,
            unused: table.unused,
            stamps: None,
            off_s: 0.0,
            crowded: 0,
            damaged_t: Vec::new(),
            notes: Vec::new(),
        })
    }
}

/// The columns of a group: all joints, or none. An optional signal of which no cell is filled was not recorded: its columns are left
/// alone like those of other names.
fn take_group(table: &mut Table, group: Group, joints: usize, rows: usize) -> Result<Option<Signals>, LogFault> {
    let names: Vec<String> = (0..joints).map(|joint| group.column(joint)).collect();
    let Some(present) = names.iter().find(|name| table.columns.contains_key(*name)) else {
        return Ok(None);
    };
    if let Some(column) = names.iter().find(|name| !table.columns.contains_key(*name)) {
        let rule = format!("{present} is there, and a group of columns has all {joints} joints");
        return Err(LogFault::MissingColumn { column: column.clone(), rule });
    }
    let is_empty = |name: &String| table.columns.get(name).is_some_and(|column| column.iter().all(|v| v.is_nan()));
    if !matches!(group, Group::Position | Group::Torque) && names.iter().all(is_empty) {
        for name in &names {
            table.columns.remove(name);
        }
        table.unused.extend(names);
        return Ok(None);
    }
    let mut signals = Vec::with_capacity(joints);
    for name in &names {
        let signal = table.columns.remove(name).unwrap_or_default();
        check_values(name, &signal, rows)?;
        signals.push(signal);
    }
    Ok(Some(signals))
}

/// Second encoders, of the joints that have one.
fn take_link_positions(table: &mut Table, joints: usize, rows: usize) -> Result<Vec<Option<Vec<f64>>>, LogFault> {
    let mut q_link = Vec::with_capacity(joints);
    for joint in 0..joints {
        let name = Group::LinkPosition.column(joint);
        let mut signal = table.columns.remove(&name);
        if signal.take_if(|signal| signal.iter().all(|v| v.is_nan())).is_some() {
            table.unused.push(name.clone());
        }
        if let Some(signal) = &signal {
            check_values(&name, signal, rows)?;
        }
        q_link.push(signal);
    }
    Ok(q_link)
}

/// Least step of time that is one \[s\]: slopes over less would be none.
const LEAST_STEP_S: f64 = 1e-9;
/// Largest number that is taken for a time, position, torque or current.
pub(crate) const LARGEST: f64 = 1e12;

fn check_values(name: &str, values: &[f64], rows: usize) -> Result<(), LogFault> {
    let column = || name.to_owned();
    if values.len() != rows {
        return Err(LogFault::Length { column: column(), rows: values.len(), expected: rows });
    }
    match values.iter().position(|v| v.is_nan() || v.abs() > LARGEST) {
        None => Ok(()),
        Some(k) if values[k].is_finite() => {
            Err(LogFault::Beyond { column: column(), row: k + 1, value: values[k], limit: LARGEST })
        }
        Some(k) => {
            let value = if values[k].is_nan() {
                "the cell is empty or not a number (null, NaN)".to_owned()
            } else {
                format!("{}", values[k])
            };
            Err(LogFault::Value { column: column(), row: k + 1, value })
        }
    }
}
