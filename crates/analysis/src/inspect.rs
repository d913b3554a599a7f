//! What a recording holds, and how it would be read.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Result;
use rivet_config::Robot;
use rivet_logs::{
    ChannelMap, Listing, Log, LogFault, Naming, ReadOptions, ResampleReport, channels_by_name, clocks, list,
    numbered_joints, read_as, read_columns, recorded_joints,
};
use rivet_screening::{ArmState, Fault as LogReading, Reading, Screening};
use serde_json::json;

use crate::fault::Fault;
use crate::gravity_free;
use crate::map;
use crate::table::{number, paragraph_within};
use crate::{reading, robot_file, runs};

/// Columns of a terminal that the text fits.
const WIDTH: usize = 80;
/// Topics that are listed by name.
const MOST_TOPICS: usize = 3;
/// Why a recording without positions is refused.
pub(crate) const NO_POSITIONS: &str =
    "no group of columns looks like joint positions; give the URDF and --map q=PATTERN";
/// A reading with less than this is not sure.
const SURE: f64 = 0.95;

/// What a recording holds, and how it would be read.
pub struct Inspection {
    recording: PathBuf,
    listing: Listing,
    joints: Vec<String>,
    channels: Vec<(&'static str, String)>,
    /// Why it cannot be read as it is.
    refused: Option<String>,
    log: Option<Log>,
    time: Option<ResampleReport>,
    clocks: Vec<Clock>,
    readings: Vec<ChannelReading>,
    /// Whether the torque is surely without that of gravity.
    is_gravity_free: bool,
    doubts: Vec<String>,
}

/// A second clock of the recording.
struct Clock {
    column: String,
    /// Mean and root mean square deviation of this clock minus the one that is used, from its first row \[s\].
    behind_s: f64,
    jitter_s: f64,
}

/// The most probable reading of a channel.
struct ChannelReading {
    channel: &'static str,
    text: String,
    probability: f64,
}

/// Reads a recording as an analysis would.
///
/// * `robot`: URDF or robot file of the arm; joints are then matched by name, and the readings of the log are compared
/// * `map`: channels that are stated, as [`map::apply`] takes them
///
/// # Errors
/// The recording or the robot cannot be read. A recording that is read and does not fit is reported by the inspection.
pub fn inspect(recording: &Path, robot: Option<&Path>, map: &[String]) -> Result<Inspection> {
    let (robot_path, entries) = (robot, map);
    let listing = list(recording)?;
    let arm = Arm::find(&listing, robot_path, entries)?;
    let (naming, count) = (arm.naming(), arm.count);
    let mut doubts = listing.warnings.clone();
    let (mut channels, mut refused, mut log) = (Vec::new(), None, None);
    match channels_by_name(&listing, &naming, count) {
        Ok(named) => channels = named,
        Err(why) => refused = Some(why.to_string()),
    }
    if refused.is_none() && count == 0 {
        refused = Some(NO_POSITIONS.to_owned());
    }
    if refused.is_none() {
        match read_as(recording, &arm.options(), &naming) {
            Ok(read) => match runs::check_time(&read) {
                Ok(()) => log = Some(read),
                Err(why) => refused = Some(why.fault.to_string()),
            },
            Err(why) if matches!(why.fault, LogFault::Io(_)) => return Err(why.into()),
            Err(why) => refused = Some(why.fault.to_string()),
        }
    }
    let mut time = None;
    let mut others = Vec::new();
    if let Some(log) = &log {
        for note in log.notes.iter().filter(|note| !note.starts_with("read as")) {
            // What is wrong with a file shows twice: where it is listed and where it is read.
            if !doubts.contains(note) {
                doubts.push(note.clone());
            }
        }
        time = log.resample(log.median_step_s()).ok().map(|(_, report)| report);
        others = other_clocks(recording, &listing, &channels);
        if log.torque().is_err() && log.current.is_none() {
            doubts.push("no torque and no current: it can be predicted, but nothing is identified from it".to_owned());
        } else if log.torque().is_err() {
            doubts.push("currents and no torque: give [drive] drive_gain (N m/A) in the robot file".to_owned());
        }
    }
    let (readings, is_gravity_free) = match (robot_path, &log) {
        (Some(path), Some(log)) => readings(path, log, entries)?,
        _ => (Vec::new(), false),
    };
    Ok(Inspection {
        recording: recording.to_owned(),
        listing,
        joints: arm.joint_names(),
        channels,
        refused,
        log,
        time,
        clocks: others,
        readings,
        is_gravity_free,
        doubts,
    })
}

/// The arm of a recording: that of a URDF or a robot file, else what the recording itself names.
pub(crate) struct Arm {
    robot: Option<Robot>,
    /// Names of the joints; empty where neither states them.
    joints: Vec<String>,
    /// Number of joints; 0 where it is unknown.
    pub(crate) count: usize,
    stated: ChannelMap,
}

impl Arm {
    /// * `robot`: URDF or robot file
    /// * `entries`: channels that are stated, as [`map::apply`] takes them
    ///
    /// # Errors
    /// The robot cannot be read, or channels are stated without one.
    pub(crate) fn find(listing: &Listing, robot: Option<&Path>, entries: &[String]) -> Result<Arm> {
        if robot.is_none() && !entries.is_empty() {
            let why = "--map needs the URDF or the robot file: give it after the recording";
            return Err(Fault::Usage(why.to_owned()).into());
        }
        let robot = robot.map(|path| robot_of(path, None)).transpose()?;
        let robot = robot.map(|robot| map::apply(robot, entries)).transpose()?;
        let joints = robot.as_ref().map_or_else(|| recorded_joints(listing), runs::joint_names);
        let count = if joints.is_empty() { numbered_joints(listing) } else { joints.len() };
        let stated = robot.as_ref().map(map::channels).transpose()?.unwrap_or_default();
        Ok(Arm { robot, joints, count, stated })
    }

    /// How its channels are found.
    pub(crate) fn naming(&self) -> Naming<'_> {
        Naming { joints: &self.joints, map: &self.stated }
    }

    /// How its recordings are read.
    pub(crate) fn options(&self) -> ReadOptions<'_> {
        self.robot.as_ref().map_or_else(|| ReadOptions::new(self.count), runs::read_options)
    }

    /// Names of the joints, by number where none is known.
    pub(crate) fn joint_names(&self) -> Vec<String> {
        let numbered = || (1..=self.count).map(|joint| format!("joint {joint}")).collect();
        if self.joints.is_empty() { numbered() } else { self.joints.clone() }
    }
}

/// A robot file, or what `rivet new` would make of a URDF.
fn robot_of(path: &Path, log: Option<&Log>) -> Result<Robot> {
    if path.extension().is_some_and(|ext| ext.eq_ignore_ascii_case("toml")) {
        return Ok(rivet_config::load(path)?);
    }
    robot_file::of_urdf(path, log)
        .map_err(|why| runs::wrong_order(path, "RECORDING ROBOT.toml, or RECORDING URDF").unwrap_or(why))
}

/// The most probable reading of positions and torques.
fn readings(path: &Path, log: &Log, entries: &[String]) -> Result<(Vec<ChannelReading>, bool)> {
    let robot = map::apply(robot_of(path, Some(log))?, entries)?;
    let names = runs::joint_names(&robot);
    let log = log.clone().by_its_positions().without_crowds();
    let Some(found) = reading::compare(&robot, &log) else { return Ok((Vec::new(), false)) };
    let channels = [("q", true), ("tau", false)].into_iter();
    let readings = channels.map(|(channel, of_q)| of_channel(&found, channel, of_q, &names)).collect();
    Ok((readings, gravity_free::probability(&found).is_some()))
}

/// The most probable meaning of the channels of a recording: name of the reading (`as_it_is` where the channels are as recorded),
/// joints (from 0; none where it is all), and the probability of all readings with these faults. None where it cannot be compared.
///
/// # Errors
/// The recording cannot be read as one of this robot.
pub fn meaning(robot: &Robot, recording: &Path) -> Result<Option<(&'static str, Vec<usize>, f64)>> {
    let (joints, stated) = (runs::joint_names(robot), map::channels(robot)?);
    let log = read_as(recording, &runs::read_options(robot), &Naming { joints: &joints, map: &stated })?;
    let log = log.by_its_positions().without_crowds();
    let Some(found) = reading::compare(robot, &log) else { return Ok(None) };
    let best = most_probable(&found, |reading| {
        let faults = reading.faults.iter().filter(|fault| !fault.is_slight()).cloned().collect();
        Reading { faults, state: state_of_torque(reading), probability: 0.0, residual: Vec::new() }
    });
    Ok(best.map(|(reading, probability)| {
        let mut joints: Vec<usize> = reading.faults.iter().flat_map(LogReading::joints).collect();
        joints.sort_unstable();
        let name = if reading.faults.len() > 1 { "several_faults" } else { reading.name() };
        (name, joints, probability)
    }))
}

/// The state of the arm where it says what the torque is; the others are of the file.
fn state_of_torque(reading: &Reading) -> ArmState {
    match reading.state {
        ArmState::Computed | ArmState::Commanded => ArmState::Computed,
        ArmState::LinkSide => ArmState::LinkSide,
        _ => ArmState::Nominal,
    }
}

/// The most probable of what `part` makes of the readings, with the sum of the probabilities of all readings that share it.
fn most_probable<T: PartialEq>(found: &Screening, part: impl Fn(&Reading) -> T) -> Option<(T, f64)> {
    let mut sums: Vec<(T, f64)> = Vec::new();
    for reading in &found.readings {
        let of_reading = part(reading);
        match sums.iter_mut().find(|(known, _)| *known == of_reading) {
            Some((_, sum)) => *sum += reading.probability,
            None => sums.push((of_reading, reading.probability)),
        }
    }
    sums.into_iter().max_by(|a, b| a.1.total_cmp(&b.1))
}

/// Whether a fault is one of the positions.
fn is_of_positions(fault: &LogReading) -> bool {
    use LogReading::{BackToFront, Exchanged, JointZero, PositionSign, PositionUnit, Reversed};
    matches!(fault, BackToFront | Exchanged(..) | JointZero(..) | PositionSign(_) | PositionUnit(..) | Reversed(_))
}

/// The reading of one channel with the sum of the probabilities of all readings of the log that share it.
fn of_channel(found: &Screening, channel: &'static str, of_q: bool, names: &[String]) -> ChannelReading {
    let part = |reading: &Reading| -> String {
        let is_of_channel = |fault: &&LogReading| is_of_positions(fault) == of_q && !fault.is_slight();
        let faults: Vec<LogReading> = reading.faults.iter().filter(is_of_channel).cloned().collect();
        let state = if of_q { ArmState::Nominal } else { state_of_torque(reading) };
        if faults.is_empty() && state == ArmState::Nominal {
            return "as recorded".to_owned();
        }
        Reading { faults, state, ..reading.clone() }.text(names)
    };
    let (text, probability) = most_probable(found, part).unwrap_or_default();
    ChannelReading { channel, text, probability }
}

/// Further clocks of the same rows, which are not used.
fn other_clocks(path: &Path, listing: &Listing, channels: &[(&'static str, String)]) -> Vec<Clock> {
    let Some((_, used)) = channels.iter().find(|(key, _)| *key == "time") else { return Vec::new() };
    let topic = |name: &str| listing.columns.iter().find(|c| c.name == name).map(|c| c.topic.clone());
    let same = clocks(listing).into_iter().filter(|name| name != used && topic(name) == topic(used));
    same.filter_map(|column| {
        // A topic's clock is listed with its rows only together with one of its signals.
        let signal =
            listing.columns.iter().find(|c| Some(&c.topic) == topic(used).as_ref() && c.name.ends_with("position"));
        let mut names = vec![used.as_str(), column.as_str()];
        names.extend(signal.map(|c| c.name.as_str()));
        let columns = read_columns(path, &names).ok()?;
        let first = columns[1].first()? - columns[0].first()?;
        let off: Vec<f64> = columns[1].iter().zip(&columns[0]).map(|(other, t)| other - t - first).collect();
        let mean = off.iter().sum::<f64>() / off.len() as f64;
        let jitter_s = (off.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / off.len() as f64).sqrt();
        // Of columns in another unit the difference is no time.
        (jitter_s < columns[0].last()? - columns[0].first()?).then_some(Clock { column, behind_s: mean, jitter_s })
    })
    .collect()
}

/// Largest minus smallest value.
fn span(signal: &[f64]) -> f64 {
    let (low, high) = signal.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
    if low <= high { high - low } else { 0.0 }
}

impl Inspection {
    /// Why the recording cannot be used as it is.
    pub fn refusal(&self) -> Option<&str> {
        self.refused.as_deref()
    }

    /// The log as it is read; none where it is refused.
    pub fn log(&self) -> Option<&Log> {
        self.log.as_ref()
    }

    /// Whether the user has to check something before the recording is used.
    pub fn is_doubtful(&self) -> bool {
        let time = self.time.as_ref().is_some_and(|time| !time.gaps.is_empty() || time.missing > 0);
        let reading = self.readings.iter().any(|r| r.text != "as recorded" || r.probability < SURE);
        time || reading || !self.doubts.is_empty()
    }

    /// The lines of `[log]` that state what names decided.
    fn section(&self) -> String {
        let mut out = String::from("[log]\n");
        for (key, pattern) in self.channels.iter().filter(|(key, _)| rivet_logs::ChannelMap::KEYS.contains(key)) {
            // Writing to a String cannot fail.
            let _ = writeln!(out, "{key} = {pattern:?}");
        }
        if self.is_gravity_free {
            out += "torque_is = \"gravity_free\"\n";
        }
        out
    }

    /// The report as text.
    pub fn text(&self) -> String {
        let mut out = String::new();
        let mut line = |label: &str, text: &str| out += &paragraph_within(WIDTH, &format!("{label:<10} "), text);
        let (columns, topics) = (self.listing.columns.len(), &self.listing.topics);
        let rows = self
            .log
            .as_ref()
            .map_or(String::new(), |log| format!(", {} rows, {} s", log.len(), number(log.duration_s(), 4)));
        line("recording", &format!("{}: {}, {columns} columns{rows}", self.recording.display(), self.listing.format));
        let unread: Vec<&str> = topics.iter().filter(|t| !t.is_read).map(|t| t.name.as_str()).collect();
        if !unread.is_empty() {
            let more = unread.len().saturating_sub(MOST_TOPICS);
            let more = if more > 0 { format!(" and {more} more") } else { String::new() };
            line("not read", &format!("{}{more}", unread[..unread.len().min(MOST_TOPICS)].join(", ")));
        }
        if let Some(time) = &self.time {
            let longest = time.gaps.iter().map(|gap| gap.length_s).fold(0.0, f64::max);
            let gaps = match time.gaps.len() {
                0 => "no gap".to_owned(),
                n => format!("{n} gaps up to {} s", number(longest, 3)),
            };
            let (rate, jitter) = (number(time.mean_rate_hz, 4), number(1e3 * time.jitter_s, 2));
            line("time", &format!("{rate} Hz, jitter {jitter} ms rms, {} rows missing, {gaps}", time.missing));
        }
        for clock in &self.clocks {
            let (behind, jitter) = (number(1e3 * clock.behind_s, 2), number(1e3 * clock.jitter_s, 2));
            line("clock", &format!("{}: {behind} ms from the one used, jitter {jitter} ms rms", clock.column));
        }
        if let Some(log) = &self.log {
            let motion = self.joints.iter().zip(&log.q).map(|(joint, q)| format!("{joint} {}", number(span(q), 2)));
            line("motion rad", &motion.collect::<Vec<_>>().join(", "));
        }
        for reading in &self.readings {
            line(reading.channel, &format!("{} (probability {:.2})", reading.text, reading.probability));
        }
        for doubt in &self.doubts {
            line("doubt", doubt);
        }
        if let Some(why) = &self.refused {
            line("not usable", why);
        } else if !self.channels.is_empty() {
            out += &self.section();
        }
        out
    }

    /// The report as JSON.
    pub fn to_json(&self) -> serde_json::Value {
        let topics: Vec<_> = self
            .listing
            .topics
            .iter()
            .map(|t| json!({"name": t.name, "type": t.kind, "messages": t.messages, "read": t.is_read}))
            .collect();
        let joints = self.log.iter().flat_map(|log| {
            self.joints.iter().zip(&log.q).enumerate().map(move |(j, (name, q))| {
                let tau = log.tau.as_ref().map(|(_, tau)| span(&tau[j]));
                json!({"name": name, "range_rad": span(q), "torque_range_nm": tau})
            })
        });
        let time = self.time.as_ref().map(|time| {
            let gaps: Vec<_> =
                time.gaps.iter().map(|g| json!({"row": g.row, "from_s": g.from_s, "length_s": g.length_s})).collect();
            json!({"rate_hz": time.mean_rate_hz, "step_s": time.median_step_s, "jitter_s": time.jitter_s,
                   "missing": time.missing, "gaps": gaps})
        });
        let clocks: Vec<_> = self
            .clocks
            .iter()
            .map(|c| json!({"column": c.column, "behind_s": c.behind_s, "jitter_s": c.jitter_s}))
            .collect();
        let readings: Vec<_> = self
            .readings
            .iter()
            .map(|r| json!({"channel": r.channel, "reading": r.text, "probability": r.probability}))
            .collect();
        json!({
            "recording": self.recording.display().to_string(),
            "format": self.listing.format,
            "topics": topics,
            "columns": self.listing.columns.iter().map(|c| &c.name).collect::<Vec<_>>(),
            "rows": self.log.as_ref().map(Log::len),
            "duration_s": self.log.as_ref().map(Log::duration_s),
            "time": time,
            "clocks": clocks,
            "joints": joints.collect::<Vec<_>>(),
            "channels": self.channels.iter().map(|(k, p)| json!({"key": k, "pattern": p})).collect::<Vec<_>>(),
            "readings": readings,
            "doubts": self.doubts,
            "not_usable": self.refused,
        })
    }
}
