//! Drawn recordings: a log of a measured or drawn arm, written in a drawn format with channels of a drawn meaning; and whether the
//! meaning is found.

mod formats;
mod meanings;
mod shown;

use std::fmt::Write as _;
use std::path::Path;

use rivet_config::Robot;
use rivet_logs::Log;
use rivet_simulation::Random;
use serde_json::{Value, json};

use crate::blind;
use crate::real::{self, Engine};
use crate::strangers::{drawn, without_tuned_keys};
use formats::FORMATS;
use meanings::{Draw, MEANINGS, below};
use shown::Arm;

/// Name of the reading of channels that are as the contract says.
const AS_RECORDED: &str = "as_it_is";
/// A meaning is used from this probability on.
pub const SURE: f64 = 0.95;
/// A meaning other than the true one is wrong from this probability on; below it a question is asked.
pub const WRONG: f64 = 0.9;
/// Shortest and longest recording \[s\].
const LENGTH_S: [f64; 2] = [15.0, 40.0];
/// Effects of drawn arms that are themselves a meaning of channels: such arms are not used.
const EFFECTS_OF_CHANNELS: [&str; 4] = ["transport_delay", "current_loop_lag", "encoder_offset", "gravity_direction"];
/// Folders of measured logs whose own channels are wrong, as their README states: torque of three axes runs against their velocity.
const FAULTY_CHANNELS: [&str; 1] = ["shanghai_electric_6dof/"];
/// Draws of an arm until one is usable.
const TRIES: u64 = 50;

/// The most probable meaning of the channels of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// Name of the reading, `as_it_is` where the channels are as recorded.
    pub name: String,
    /// Joints (from 0) that it is about; none where it is all.
    pub joints: Vec<usize>,
    /// Probability of all readings with these faults.
    pub probability: f64,
}

/// What a recording of a robot means; none where it is not usable.
pub type Judge<'a> = dyn Fn(&Robot, &Path) -> Result<Option<Found>, String> + 'a;

/// What came of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The true meaning, with a probability from which it is used.
    Right,
    /// No meaning from which it is used.
    Asked,
    /// Another meaning, with a probability of 0.9 and more.
    Wrong,
}

/// A recording that was drawn.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Seed.
    pub seed: u64,
    /// Arm and kind of file.
    pub arm: String,
    /// Whether the log is measured.
    pub is_measured: bool,
    /// Format.
    pub format: &'static str,
    /// True meaning, and its joints.
    pub truth: (&'static str, Vec<usize>),
    /// Whether the recording shows the change: read as recorded, it contradicts the arm that made it.
    pub is_shown: bool,
    /// What was found; none where the recording was refused.
    pub found: Option<Found>,
}

impl Outcome {
    /// What came of it. A change that the recording does not show is asked, not wrong, where it is read as recorded.
    #[must_use]
    pub fn verdict(&self) -> Verdict {
        let Some(found) = &self.found else { return Verdict::Asked };
        let is_true = found.name == self.truth.0 && found.joints == self.truth.1;
        if !is_true && !self.is_shown && found.name == AS_RECORDED {
            return Verdict::Asked;
        }
        match is_true {
            true if found.probability >= SURE => Verdict::Right,
            false if found.probability >= WRONG => Verdict::Wrong,
            _ => Verdict::Asked,
        }
    }
}

/// A log with the robot file of its reader.
struct Source {
    arm: String,
    robot: Robot,
    log: Log,
}

/// Draws `count` recordings and judges each; those that failed with the reason.
///
/// * `root`: the checkout, with `robots/`
/// * `data`: folder of measured sets; half of the recordings are of those that are there
/// * `folder`: where recordings are written, one at a time
pub fn run(
    [root, data, folder]: [&Path; 3],
    count: usize,
    seed: u64,
    engine: &Engine<'_>,
    judge: &Judge<'_>,
    progress: &mut dyn FnMut(usize),
) -> (Vec<Outcome>, Vec<String>) {
    let (mut outcomes, mut failed) = (Vec::new(), Vec::new());
    for k in 0..count {
        let seed = seed.wrapping_add(k as u64);
        match case([root, data, folder], seed, engine, judge) {
            Ok(outcome) => outcomes.push(outcome),
            Err(why) => failed.push(format!("seed {seed}: {why}")),
        }
        progress(k + 1);
    }
    (outcomes, failed)
}

fn case(
    [root, data, folder]: [&Path; 3],
    seed: u64,
    engine: &Engine<'_>,
    judge: &Judge<'_>,
) -> Result<Outcome, String> {
    let mut random = Random::stream(seed, 0x5ec);
    let is_measured = seed.is_multiple_of(2);
    let measured = if is_measured { measured(root, data, &mut random, engine)? } else { None };
    let is_measured = measured.is_some();
    let Source { arm, robot, mut log } = match measured {
        Some(source) => source,
        None => simulated(root, &mut random)?,
    };
    log.torque().map_err(|why| format!("{arm}: {why}"))?;
    let known = Arm::of(&robot, &log);
    let meaning = &MEANINGS[below(&mut random, MEANINGS.len())];
    let joints = (meaning.change)(&mut Draw { robot: &robot, random: &mut random, log: &mut log });
    let is_shown = meaning.name == AS_RECORDED || known.is_some_and(|known| known.contradicts(&log));
    let format = &FORMATS[below(&mut random, FORMATS.len())];
    let names: Vec<String> = robot.model.arm.joints.iter().map(|joint| joint.name.clone()).collect();
    let path = (format.write)(&folder.join(format!("drawn-{seed}")), &log, &names, &mut random)?;
    let found = judge(&robot, &path);
    std::fs::remove_file(&path).map_err(|why| why.to_string())?;
    let truth = (meaning.name, joints);
    Ok(Outcome { seed, arm, is_measured, format: format.name, truth, is_shown, found: found? })
}

/// A stretch of a measured log, with the tuned robot file or with that of a new user; none where no set is there.
fn measured(root: &Path, data: &Path, random: &mut Random, engine: &Engine<'_>) -> Result<Option<Source>, String> {
    let parts = real::SPLITS.iter().flat_map(|split| {
        let parts = split.train.iter().chain(std::iter::once(&split.test));
        parts.map(move |part| (split.robot, part.0)).filter(|(_, file)| data.join(file).is_file())
    });
    let is_sound = |file: &str| !FAULTY_CHANNELS.iter().any(|folder| file.starts_with(folder));
    let mut parts: Vec<(&str, &str)> = parts.filter(|(_, file)| is_sound(file)).collect();
    parts.sort_unstable();
    parts.dedup();
    // Arms first: some have many logs.
    let mut arms: Vec<&str> = parts.iter().map(|(robot, _)| *robot).collect();
    arms.dedup();
    if arms.is_empty() {
        return Ok(None);
    }
    let arm = arms[below(random, arms.len())];
    parts.retain(|(robot, _)| *robot == arm);
    let (_, file) = parts[below(random, parts.len())];
    let tuned = rivet_config::load(root.join(arm)).map_err(|why| why.to_string())?;
    let log = (engine.read)(&tuned, &data.join(file))?;
    let robot = file_of(&tuned, random, root)?;
    Ok(Some(Source { arm: format!("{file}, {}", robot.1), robot: robot.0, log: stretch(&log, random) }))
}

/// A log of a drawn arm that differs from its file.
fn simulated(root: &Path, random: &mut Random) -> Result<Source, String> {
    let arm = drawn::ARMS[below(random, drawn::ARMS.len())];
    let tuned = rivet_config::load(root.join("robots").join(arm).join("robot.toml")).map_err(|why| why.to_string())?;
    let case = (0..TRIES).find_map(|_| {
        let case = blind::case(&tuned, random.bits())?;
        let is_of_channels = case.effects.iter().any(|effect| EFFECTS_OF_CHANNELS.contains(&effect.effect));
        (!is_of_channels).then_some(case)
    });
    let case = case.ok_or("no drawn arm follows its motion")?;
    let rate_hz = drawn::RATES_HZ[below(random, drawn::RATES_HZ.len())];
    let step = (1.0 / (rate_hz * blind::PERIOD_S)).round().max(1.0) as usize;
    let log = drawn::log(&case.runs[below(random, 2)], step);
    let robot = file_of(&tuned, random, root)?;
    Ok(Source { arm: format!("{arm} at {rate_hz} Hz, {}", robot.1), robot: robot.0, log: stretch(&log, random) })
}

/// The tuned robot file, or that of a new user; and which. Recordings have their channels by name, so `[log]` states nothing.
fn file_of(tuned: &Robot, random: &mut Random, root: &Path) -> Result<(Robot, &'static str), String> {
    let is_new = random.unit() < 0.5;
    let mut robot = if is_new { without_tuned_keys(tuned, tuned.config.sample_period_s, root)? } else { tuned.clone() };
    robot.config.log = rivet_config::Log {
        joint_zero: vec![0.0; robot.dof()],
        torque_from_current: false,
        torque_is: rivet_config::TorqueMeaning::Auto,
        channels: Vec::new(),
    };
    Ok((robot, if is_new { "file of a new user" } else { "tuned file" }))
}

/// Up to 40 s of a log, from a drawn row on; commanded motion is left out.
fn stretch(log: &Log, random: &mut Random) -> Log {
    let rows = ((random.uniform(LENGTH_S[0], LENGTH_S[1]) / log.median_step_s()) as usize).clamp(1, log.len());
    let first = below(random, log.len() - rows + 1);
    let part = log.slice(first..first + rows);
    let q_link = vec![None; part.q.len()];
    Log { qd: None, q_des: None, qd_des: None, qdd_des: None, temperature: None, current: None, q_link, ..part }
}

/// Counts of right, asked and wrong.
fn counts<'a>(outcomes: impl Iterator<Item = &'a Outcome>) -> [usize; 3] {
    let mut counts = [0; 3];
    for outcome in outcomes {
        counts[outcome.verdict() as usize] += 1;
    }
    counts
}

/// The table: a row a meaning, formats and sources after it.
#[must_use]
pub fn markdown(outcomes: &[Outcome]) -> String {
    let mut out = String::from("| recordings | drawn | right | asked | wrong |\n|---|---:|---:|---:|---:|\n");
    let mut row = |name: &str, of: &dyn Fn(&&Outcome) -> bool| {
        let [right, asked, wrong] = counts(outcomes.iter().filter(of));
        let drawn = right + asked + wrong;
        if drawn > 0 {
            // Writing to a String cannot fail.
            let _ = writeln!(out, "| {name} | {drawn} | {right} | {asked} | {wrong} |");
        }
    };
    row("all", &|_| true);
    row("measured logs", &|o| o.is_measured);
    row("drawn arms", &|o| !o.is_measured);
    row("changes that the recording does not show", &|o| !o.is_shown);
    let mut names: Vec<&str> = MEANINGS.iter().map(|meaning| meaning.name).collect();
    names.dedup();
    for name in names {
        row(&format!("`{name}`"), &|o| o.truth.0 == name);
    }
    for format in &FORMATS {
        row(format.name, &|o| o.format == format.name);
    }
    out
}

/// Every recording, one line each that is not right.
#[must_use]
pub fn others(outcomes: &[Outcome]) -> String {
    let mut out = String::new();
    for outcome in outcomes.iter().filter(|outcome| outcome.verdict() != Verdict::Right) {
        let found = outcome.found.as_ref().map_or_else(
            || "refused".to_owned(),
            |found| format!("{} {:?} with {:.2}", found.name, found.joints, found.probability),
        );
        let (name, joints) = &outcome.truth;
        let Outcome { seed, arm, format, .. } = outcome;
        let verdict = if outcome.verdict() == Verdict::Wrong { "WRONG" } else { "asked" };
        let name = if outcome.is_shown { (*name).to_owned() } else { format!("{name} (not shown)") };
        let _ = writeln!(out, "{verdict}: seed {seed}, {name} {joints:?}, {arm}, {format}: {found}");
    }
    out
}

/// The same for programs.
#[must_use]
pub fn to_json(outcomes: &[Outcome]) -> Value {
    let [right, asked, wrong] = counts(outcomes.iter());
    let each = outcomes.iter().map(|outcome| {
        let found = outcome
            .found
            .as_ref()
            .map(|found| json!({"name": found.name, "joints": found.joints, "probability": found.probability}));
        json!({"seed": outcome.seed, "arm": outcome.arm, "measured": outcome.is_measured, "format": outcome.format,
               "truth": {"name": outcome.truth.0, "joints": outcome.truth.1}, "is_shown": outcome.is_shown, "found": found,
               "verdict": format!("{:?}", outcome.verdict()).to_lowercase()})
    });
    json!({"right": right, "asked": asked, "wrong": wrong, "recordings": each.collect::<Vec<_>>()})
}

#[cfg(test)]
mod tests {
    use super::*;
    use rivet_logs::{ChannelMap, Naming, ReadOptions, read_as};

    fn source() -> Source {
        let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
        simulated(root, &mut Random::new(5)).expect("a drawn arm")
    }

    /// Whatever the order and the dialect: the joints come back by their names, to the bit.
    #[test]
    fn every_format_reads_back_the_log() {
        let Source { robot, log, .. } = source();
        let names: Vec<String> = robot.model.arm.joints.iter().map(|joint| joint.name.clone()).collect();
        let folder = tempfile::tempdir().expect("a folder");
        let mut random = Random::new(8);
        for (k, format) in FORMATS.iter().cycle().take(3 * FORMATS.len()).enumerate() {
            let path = (format.write)(&folder.path().join(format!("log{k}")), &log, &names, &mut random);
            let path = path.expect("written");
            let naming = Naming { joints: &names, map: &ChannelMap::default() };
            let read = read_as(&path, &ReadOptions::new(robot.dof()), &naming);
            let read = read.unwrap_or_else(|why| panic!("{}: {why}", format.name));
            assert_eq!(read.q, log.q, "{}", format.name);
            assert_eq!(read.torque().expect("torque"), log.torque().expect("torque"), "{}", format.name);
        }
    }

    #[test]
    fn every_meaning_but_the_contract_changes_the_channels_of_its_joints_alone() {
        let source = source();
        for (k, meaning) in MEANINGS.iter().enumerate() {
            let (mut log, mut random) = (source.log.clone(), Random::new(20 + k as u64));
            let mut draw = Draw { robot: &source.robot, random: &mut random, log: &mut log };
            let joints = (meaning.change)(&mut draw);
            let channels = |log: &Log, j: usize| (log.q[j].clone(), log.tau.as_ref().expect("torques").1[j].clone());
            let is_changed = |j: &usize| channels(&log, *j) != channels(&source.log, *j);
            let changed: Vec<usize> = (0..log.joints()).filter(is_changed).collect();
            let expected = match meaning.name {
                "as_it_is" => Vec::new(),
                _ if joints.is_empty() => (0..log.joints()).collect(),
                _ => joints,
            };
            // Gravity does nothing about an upright axis.
            if meaning.name == "torque_without_gravity" {
                assert!(!changed.is_empty());
            } else {
                assert_eq!(changed, expected, "{} {k}", meaning.name);
            }
        }
    }

    /// A sign of all torques contradicts any arm; the same log does not contradict its own.
    #[test]
    fn an_arm_contradicts_a_change_that_its_recording_shows() {
        let Source { robot, mut log, .. } = source();
        let arm = Arm::of(&robot, &log).expect("an arm that moves");
        assert!(!arm.contradicts(&log));
        for tau in log.tau.as_mut().expect("torques").1.iter_mut().flatten() {
            *tau = -*tau;
        }
        assert!(arm.contradicts(&log));
    }

    #[test]
    fn a_meaning_is_right_asked_or_wrong_by_its_probability() {
        let outcome = |name: &str, joints: &[usize], probability: f64, is_shown: bool| {
            let found = Some(Found { name: name.to_owned(), joints: joints.to_vec(), probability });
            let truth = ("torque_sign", vec![2]);
            Outcome { seed: 1, arm: String::new(), is_measured: false, format: "MCAP", truth, is_shown, found }
        };
        let verdict =
            |name: &str, joints: &[usize], probability: f64| outcome(name, joints, probability, true).verdict();
        assert_eq!(verdict("torque_sign", &[2], 0.96), Verdict::Right);
        assert_eq!(verdict("torque_sign", &[2], 0.94), Verdict::Asked);
        assert_eq!(verdict("torque_sign", &[1], 0.91), Verdict::Wrong);
        assert_eq!(verdict("as_it_is", &[], 0.89), Verdict::Asked);
        assert_eq!(verdict("as_it_is", &[], 0.99), Verdict::Wrong);
        assert_eq!(outcome("as_it_is", &[], 0.99, false).verdict(), Verdict::Asked);
        assert_eq!(outcome("torque_sign", &[1], 0.99, false).verdict(), Verdict::Wrong);
    }
}
