//! What is fed, and what must hold whatever comes.

use crate::bytes::{Bytes, signature};
use rivet_config::Robot;
use rivet_dynamics::{Arm, flange_pose};
use rivet_ipc_schema::{
    Command, ControlCommand, ControlReply, ControllerHealth, Health, JointState, LinkState, Parameters, Setpoint,
};
use rivet_logs::ReadOptions;
use rivet_simulation::motion::{Governor, Standstill};
use rivet_simulation::process::nominal_joints;
use rivet_simulation::{Disturbances, Plant, PlantSettings, Sensors, StandIn, Truth};
use rivet_store::Store;
use std::path::{Path, PathBuf};

/// Takes an input, panics where something is broken, and returns the signature of what happened.
pub type Run = Box<dyn FnMut(&[u8]) -> u64>;

/// Something that reads bytes of strangers.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// Its name, and its folder in the corpus.
    pub name: &'static str,
    /// Folders of the workspace whose files are seeds as well.
    pub also: &'static [&'static str],
    /// Only files of those folders with this suffix are.
    pub suffix: &'static str,
    /// Words that are put in.
    pub words: &'static [&'static str],
    /// Makes what runs it.
    pub make: fn() -> Run,
}

const TOML: &[&str] =
    &["nan", "inf", "-", "1e308", "[", "]", "[drive]\n", "\"\"", "= ", "0x", "true", "9223372036854775807", "\u{fc}"];
const XML: &[&str] = &[
    "<joint ",
    "/>",
    "</link>",
    "<origin xyz=\"0 0 nan\"/>",
    "type=\"floating\"",
    "&#0;",
    "<!--",
    "1e999",
    "<mimic joint=\"\"/>",
];
const JSON: &[&str] = &["null", "-1", "1e308", "1e-320", "[]", "{}", "\"\"", "true", "\\ud800", ",", "<script>"];
const CSV: &[&str] = &["nan", ",", ",,", "\n", "1e400", "t,q1,tau1\n", "-0", "\"", "inf"];

/// Everything.
pub const TARGETS: [Target; 13] = [
    Target { name: "samples", also: &[], suffix: "", words: &[], make: samples },
    Target { name: "parameters", also: &[], suffix: "", words: &[], make: parameters },
    Target { name: "command", also: &[], suffix: "", words: &[], make: command },
    Target { name: "control", also: &[], suffix: "", words: &[], make: control },
    Target { name: "config", also: &["robots", "config/tests/bad"], suffix: "toml", words: TOML, make: config },
    Target { name: "urdf", also: &["robots"], suffix: "urdf", words: XML, make: urdf },
    Target { name: "log-csv", also: &[], suffix: "csv", words: CSV, make: log_csv },
    Target { name: "log-parquet", also: &[], suffix: "parquet", words: &[], make: log_parquet },
    Target { name: "store", also: &[], suffix: "state", words: &["PARA", "HEAD", "SUPV", "MEMO"], make: store },
    Target {
        name: "store-resealed",
        also: &[],
        suffix: "state",
        words: &["PARA", "HEAD", "SUPV", "MEMO"],
        make: store_resealed,
    },
    Target { name: "memory", also: &[], suffix: "", words: &[], make: memory },
    Target { name: "reports", also: &[], suffix: "", words: &[], make: crate::shown::reports },
    Target { name: "document", also: &[], suffix: "json", words: JSON, make: crate::shown::document },
];

pub(crate) fn robot(arm: &str) -> Robot {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../robots").join(arm).join("robot.toml");
    rivet_config::load(file).expect("the arm is there")
}

fn joint_state(bytes: &mut Bytes<'_>) -> JointState {
    let mut state = JointState { seq: bytes.u64(), stamp_ns: bytes.u64(), ..JointState::default() };
    state.q = bytes.array();
    state.tau = bytes.array();
    state.temperature = bytes.array();
    state.joints = bytes.u32();
    state.faults = bytes.u32();
    state
}

fn setpoint(bytes: &mut Bytes<'_>) -> Setpoint {
    let mut plan = Setpoint { seq: bytes.u64(), stamp_ns: bytes.u64(), ..Setpoint::default() };
    plan.q = bytes.array();
    plan.qd = bytes.array();
    plan.qdd = bytes.array();
    plan.joints = bytes.u32();
    plan
}

fn link_state(bytes: &mut Bytes<'_>) -> LinkState {
    let mut link = LinkState { seq: bytes.u64(), stamp_ns: bytes.u64(), ..LinkState::default() };
    link.q = bytes.array();
    link.joints = bytes.u32();
    link
}

fn parameter_set(bytes: &mut Bytes<'_>, like: &Parameters) -> Parameters {
    let mut set = *like;
    // Half of what comes is a sound set with some hostile entries: else nothing would pass the first look.
    match bytes.u8() % 4 {
        0 => {
            set.model_hash = bytes.u64();
            set.count = bytes.u32();
            set.joints = bytes.u32();
            set.flags = bytes.u32();
            set.instruments = bytes.u32();
        }
        1 => {
            for value in &mut set.values {
                *value = bytes.f64();
            }
        }
        2 => set.sample_period_s = bytes.f64(),
        _ => {
            for _ in 0..4 {
                let at = usize::from(bytes.u8()) % set.values.len();
                set.values[at] = bytes.f64();
            }
        }
    }
    set.epoch = bytes.u64();
    set.seq = bytes.u64();
    set.stamp_ns = bytes.u64();
    set
}

/// Messages of the robot controller into the daemon.
fn samples() -> Run {
    let robot = robot("dd2");
    Box::new(move |input| {
        let mut core = rivet_daemon::Core::new(&robot).expect("sound settings");
        let mut bytes = Bytes::new(input);
        let (mut out, mut health) = (Parameters::default(), Health::default());
        let mut published = 0_u64;
        while !bytes.is_empty() {
            let with = bytes.u8();
            let state = joint_state(&mut bytes);
            let plan = (with & 1 != 0).then(|| setpoint(&mut bytes));
            let link = (with & 2 != 0).then(|| link_state(&mut bytes));
            // One sample of bytes is a stretch of samples that go on from it; one that stands for none is a request.
            if with >> 2 == 0
                && let Ok(command) = ControlCommand::try_from(state.joints)
            {
                core.control(command);
            }
            for k in 0..u64::from(with >> 2) {
                let mut state = state;
                state.seq = state.seq.wrapping_add(k);
                state.stamp_ns = state.stamp_ns.wrapping_add(k.wrapping_mul(1_000_000));
                state.q[0] += 1e-3 * k as f64;
                published += u64::from(core.tick_with_link(&state, plan.as_ref(), link.as_ref()).publish);
            }
        }
        core.write_parameters(&mut out);
        core.write_health(&mut health);
        assert!(out.values.iter().chain(&out.std).all(|x| x.is_finite()), "a parameter is not finite");
        let counts = core.counts();
        let moved = [counts.samples, counts.lost, counts.stale, counts.invalid, counts.faults, counts.gaps];
        let more = [counts.wrong_period, counts.restarts, counts.setpoints_missing, published, u64::from(health.mode)];
        // The order of magnitude of every counter.
        moved.iter().chain(&more).fold(0, |hash, n| hash * 67 + u64::from(64 - n.leading_zeros()))
    })
}

/// Messages of everybody into the controller.
fn parameters() -> Run {
    let robot = robot("dd2");
    let limit = robot.config.drive.torque_limit.clone();
    let mut like = Parameters { joints: 2, model_hash: robot.hash, ..Parameters::default() };
    like.sample_period_s = robot.config.sample_period_s;
    like.count = robot.nominal_base.len() as u32;
    like.values[..robot.nominal_base.len()].copy_from_slice(&robot.nominal_base);
    Box::new(move |input| {
        let mut core = rivet_controller::Core::new(&robot, 0).expect("sound settings");
        let mut bytes = Bytes::new(input);
        let mut seen = 0_u64;
        while !bytes.is_empty() {
            let with = bytes.u8();
            let mut state = joint_state(&mut bytes);
            if with & 1 != 0 {
                core.offer_setpoint(&setpoint(&mut bytes));
            }
            if with & 2 != 0 {
                let set = parameter_set(&mut bytes, &like);
                seen |= 1 << (core.offer_parameters(&set, &state) as u64 % 32);
            }
            for _ in 0..=u64::from(with >> 4) {
                state.seq = state.seq.wrapping_add(1);
                let commands = [core.tick(&state).ok(), (with & 4 != 0).then(|| core.missing(30)).flatten()];
                for command in commands.into_iter().flatten() {
                    for (j, (tau, limit)) in command.tau.iter().zip(&limit).enumerate() {
                        assert!(tau.abs() <= *limit, "joint {j}: {tau} N m, its limit is {limit}");
                    }
                    seen |= 1 << (32 + u64::from(command.mode) % 8);
                }
            }
        }
        let mut health = ControllerHealth::default();
        core.write_health(&mut health);
        seen | u64::from(health.state % 8) << 42 | u64::from(health.source % 8) << 45
    })
}

/// Commands of a controller into the simulated robot.
fn command() -> Run {
    let robot = robot("dd2");
    let limit = robot.config.drive.torque_limit.clone();
    let period_s = robot.config.sample_period_s;
    let truth = Truth::new(&robot.model, &nominal_joints(&robot), &Disturbances::default());
    Box::new(move |input| {
        let plant = Plant::new(&truth, &Sensors::perfect(2), &PlantSettings::new(period_s, &limit), 1);
        let mut arm = StandIn::new(plant, Governor::new(Box::new(Standstill { pose: vec![0.3; 2] })), period_s, 4, 1);
        let mut bytes = Bytes::new(input);
        let mut open = 0_u64;
        while !bytes.is_empty() {
            let (with, joints, mode) = (bytes.u8(), bytes.u8(), bytes.u8());
            let (behind, tau) = (bytes.u8(), bytes.array());
            for _ in 0..=with {
                let sample = arm.latch();
                let finite = sample.q.iter().chain(&sample.tau).all(|x| x.is_finite());
                assert!(finite, "a measurement that is no number: {sample:?}");
                let most = sample.tau.iter().zip(&limit).all(|(tau, limit)| tau.abs() <= *limit);
                assert!(most, "a drive beyond its limit: {sample:?}");
                open += u64::from(!sample.braked);
                // Numbers that are a little behind, as they are in life, or anything.
                let seq = if behind < 8 { sample.seq.wrapping_sub(u64::from(behind)) } else { u64::from(behind) << 56 };
                let (joints, mode) = (u32::from(joints), u32::from(mode));
                arm.advance(Some(&Command { seq, tau, joints, mode, ..Command::default() }));
            }
        }
        let counts = arm.counts();
        let happened = [open, counts.late_commands, counts.brake_engagements, counts.refused_commands];
        happened.iter().fold(0, |hash, n| hash * 67 + u64::from(64 - n.leading_zeros()))
    })
}

/// Requests and replies of the control service.
fn control() -> Run {
    Box::new(|input| {
        let mut bytes = Bytes::new(input);
        let command = ControlCommand::try_from(bytes.u32());
        let mut reply = ControlReply { status: bytes.u32(), length: bytes.u32(), ..ControlReply::default() };
        for byte in &mut reply.text {
            *byte = bytes.u8();
        }
        let text = reply.text().into_owned();
        assert!(text.len() <= 3 * reply.text.len());
        let again = ControlReply::new(rivet_ipc_schema::ControlStatus::Done, 1, &text);
        assert!(text.starts_with(again.text().as_ref()), "what was cut is no beginning");
        u64::from(command.map_or(99, u32::from)) * 1000 + text.len() as u64 / 16
    })
}

fn config() -> Run {
    // Beside a real URDF, so that the file's own mistakes are what is found.
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../robots/dd2/robot.toml");
    Box::new(move |input| match rivet_config::parse(&path, &String::from_utf8_lossy(input)) {
        Ok(robot) => {
            // Whatever is taken for sound must start, or say why it does not.
            let started = rivet_daemon::Core::new(&robot).is_ok();
            u64::from(started)
        }
        // Which rules are broken at once; the text with its source lines would be new every time.
        Err(why) => {
            let rules: std::collections::BTreeSet<u64> = why.errors().iter().map(|e| signature(&e.rule)).collect();
            rules.iter().take(3).fold(2, |hash: u64, rule| hash.wrapping_mul(0x0100_0000_01b3) ^ rule)
        }
    })
}

fn urdf() -> Run {
    Box::new(|input| match Arm::from_urdf(&String::from_utf8_lossy(input), [0.0, 0.0, -9.81]) {
        Ok(arm) => {
            // What is taken for sound has a pose.
            let (rotation, position) = flange_pose(&arm, &vec![0.3; arm.dof()]);
            assert!(rotation.iter().flatten().chain(&position).all(|x| x.is_finite()), "a pose that is no number");
            arm.dof() as u64
        }
        Err(why) => signature(&why.to_string()),
    })
}

/// A file in memory that is written anew for each input.
fn file(name: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = if Path::new("/dev/shm").is_dir() { tempfile::tempdir_in("/dev/shm") } else { tempfile::tempdir() };
    let folder = folder.expect("a folder");
    let path = folder.path().join(name);
    (folder, path)
}

fn log(name: &'static str) -> Run {
    let (folder, path) = file(name);
    Box::new(move |input| {
        let _ = &folder;
        std::fs::write(&path, input).expect("written");
        let options =
            ReadOptions { drive_gain: Some(&[2.0, -3.0]), joint_zero: Some(&[0.1, 0.2]), ..ReadOptions::new(2) };
        match rivet_logs::read(&path, &options) {
            Ok(log) => {
                assert!(
                    log.torque().is_err() || log.torque().is_ok_and(|tau| tau.iter().flatten().all(|x| x.is_finite()))
                );
                let pieces = log.split_at_gaps(2.5 * log.median_step_s());
                let resampled = pieces.iter().map(|piece| match piece.resample(0.01) {
                    Ok((uniform, _)) => {
                        assert!(uniform.q.iter().flatten().all(|x| x.is_finite()), "a position that is no number");
                        1 + u64::from(uniform.len() > 10)
                    }
                    Err(why) => signature(&why.to_string()),
                });
                resampled.take(3).fold(u64::from(log.torque().is_ok()), |hash, next| hash.wrapping_mul(31) ^ next)
            }
            Err(why) => signature(&why.to_string()),
        }
    })
}

fn log_csv() -> Run {
    log("log.csv")
}

fn log_parquet() -> Run {
    log("log.parquet")
}

/// What the seeds of the store were written for.
pub const STORED: (&str, u64) = ("arm", 0x5eed);

fn load(folder: &Path) -> u64 {
    let loaded = Store::reader(folder, STORED.0).load(STORED.1);
    if let Some(knowledge) = &loaded.knowledge {
        let p = &knowledge.parameters;
        assert_eq!(p.values.len(), p.std.len());
        assert!(p.values.iter().chain(&p.std).all(|x| x.is_finite()), "garbage is taken for parameters");
        return 1;
    }
    signature(&loaded.problems.first().map_or_else(String::new, |(_, why)| why.to_string()))
}

fn store() -> Run {
    let (folder, path) = file("arm.0.state");
    Box::new(move |input| {
        std::fs::write(&path, input).expect("written");
        load(folder.path())
    })
}

/// Writes length and checksum as they belong.
fn reseal(input: &[u8]) -> Vec<u8> {
    let mut file = input.to_vec();
    if file.len() >= 24 {
        let (length, end) = (file.len() as u64, file.len() - 4);
        file[12..20].copy_from_slice(&length.to_le_bytes());
        let checksum = crc32fast::hash(&file[..end]);
        file[end..].copy_from_slice(&checksum.to_le_bytes());
    }
    file
}

/// The same with length and checksum put right, so that what comes after them is reached.
fn store_resealed() -> Run {
    let (folder, path) = file("arm.0.state");
    Box::new(move |input| {
        std::fs::write(&path, reseal(input)).expect("written");
        load(folder.path())
    })
}

/// Numbers put over those of a sound memory, as a file with a right checksum might have them: the estimator refuses it, or goes
/// on without a panic, and what it says is finite.
fn memory() -> Run {
    let robot = robot("dd2");
    let motion = |seq: u64| {
        let (t, mut state) =
            (seq as f64 * 0.001, JointState { seq, stamp_ns: seq * 1_000_000, ..JointState::default() });
        state.joints = 2;
        for j in 0..2 {
            state.q[j] = 0.5 * ((5.0 + j as f64) * t).sin();
            state.tau[j] = 3.0 * ((5.0 + j as f64) * t).cos();
        }
        state
    };
    let mut core = rivet_daemon::Core::new(&robot).expect("sound settings");
    for seq in 1..=3000 {
        core.tick(&motion(seq), None);
    }
    let mut sound = vec![0.0; core.memory_len()];
    core.write_memory(&mut sound);
    Box::new(move |input| {
        let mut spoilt = sound.clone();
        let mut bytes = Bytes::new(input);
        while !bytes.is_empty() {
            let place = bytes.u32() as usize % spoilt.len();
            spoilt[place] = f64::from_bits(bytes.u64());
        }
        let mut core = rivet_daemon::Core::new(&robot).expect("sound settings");
        let taken = core.resume(&spoilt);
        for seq in 1..=600 {
            core.tick(&motion(seq), None);
        }
        let mut set = Parameters::default();
        core.write_parameters(&mut set);
        assert!(set.values.iter().all(|x| x.is_finite()), "a parameter is not finite");
        let moving = set.state.iter().map(|state| u64::from(*state == 1)).sum::<u64>();
        u64::from(taken) + 2 * u64::from(set.flags & 7) + 64 * moving
    })
}
