//! The daemon's decisions, on the two-link arm.

use rivet_config::Robot;
use rivet_daemon::{Core, Output, Refused};
use rivet_dynamics::Workspace;
use rivet_ipc_schema::{
    ControlCommand, DaemonMode, Health, JointState, LoadLevel, ParameterState, Parameters, Setpoint, faults,
    parameter_flags,
};
use std::path::Path;

fn robot() -> Robot {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/dd2/robot.toml");
    rivet_config::load(file).expect("the robot file is sound")
}

/// Sinusoids at 0.8 and 1.1 Hz with the torque of the nominal model, sampled every millisecond.
struct Motion {
    robot: Robot,
    workspace: Workspace,
    rows: Vec<f64>,
}

impl Motion {
    fn new() -> Motion {
        let robot = robot();
        let workspace = Workspace::new(&robot.model.arm);
        let rows = vec![0.0; 2 * robot.model.len()];
        Motion { robot, workspace, rows }
    }

    fn at(&mut self, seq: u64) -> (JointState, Setpoint) {
        let t = seq as f64 * 0.001;
        let wave = |a: f64, f: f64| {
            let w = std::f64::consts::TAU * f;
            [a * (w * t).sin(), a * w * (w * t).cos(), -a * w * w * (w * t).sin()]
        };
        let (one, two) = (wave(0.5, 0.8), wave(0.8, 1.1));
        let motion = |d: usize| [one[d], two[d]];
        let n = self.robot.model.len();
        self.robot.model.regressor(&mut self.workspace, &motion(0), &motion(1), &motion(2), &mut self.rows);
        let mut state = JointState { seq, stamp_ns: seq * 1_000_000, joints: 2, ..JointState::default() };
        let mut setpoint = Setpoint { seq, stamp_ns: state.stamp_ns, joints: 2, ..Setpoint::default() };
        state.q[..2].copy_from_slice(&motion(0));
        for j in 0..2 {
            state.tau[j] = self.rows[j * n..(j + 1) * n].iter().zip(&self.robot.nominal).map(|(y, x)| y * x).sum();
        }
        setpoint.q[..2].copy_from_slice(&motion(0));
        setpoint.qd[..2].copy_from_slice(&motion(1));
        setpoint.qdd[..2].copy_from_slice(&motion(2));
        (state, setpoint)
    }
}

fn run(core: &mut Core, motion: &mut Motion, seqs: impl Iterator<Item = u64>) -> Vec<Output> {
    seqs.map(|seq| {
        let (state, setpoint) = motion.at(seq);
        core.tick(&state, Some(&setpoint))
    })
    .collect()
}

fn parameters(core: &Core) -> Parameters {
    let mut parameters = Parameters::default();
    core.write_parameters(&mut parameters);
    parameters
}

fn health(core: &Core) -> Health {
    let mut health = Health::default();
    core.write_health(&mut health);
    health
}

#[test]
fn every_so_many_samples_parameters_are_published_with_the_next_epoch() {
    let mut motion = Motion::new();
    let mut core = Core::new(&motion.robot).expect("sound settings");
    let every = motion.robot.config.publish.every;
    let outputs = run(&mut core, &mut motion, 1..=3 * every as u64);
    let published: Vec<usize> = (0..outputs.len()).filter(|&k| outputs[k].publish).collect();
    assert_eq!(published, [every - 1, 2 * every - 1, 3 * every - 1]);
    let set = parameters(&core);
    assert_eq!((set.epoch, set.seq, set.stamp_ns), (3, 3 * every as u64, 3 * every as u64 * 1_000_000));
    assert_eq!(set.model_hash, motion.robot.hash);
    assert_ne!(set.flags & parameter_flags::PROVISIONAL, 0, "three tenths of a second are not enough to act on");
}

#[test]
fn lost_samples_are_counted_by_sequence_number_and_restart_the_signals() {
    let mut motion = Motion::new();
    let mut core = Core::new(&motion.robot).expect("sound settings");
    run(&mut core, &mut motion, 1..=2000);
    let before = parameters(&core);
    run(&mut core, &mut motion, 2010..=2020);
    let counts = core.counts();
    assert_eq!((counts.lost, counts.gaps, counts.samples), (9, 1, 2011));
    // While the differentiator and the filters fill again nothing new is learnt; a solution that was under way, spread
    // over several samples, is finished.
    let settled = parameters(&core);
    for i in 0..before.len() {
        let scale = motion.robot.nominal_base[i].abs().max(0.05);
        assert!((settled.values[i] - before.values[i]).abs() < 1e-4 * scale, "parameter {i}");
    }
    run(&mut core, &mut motion, 2021..=2040);
    assert_eq!(parameters(&core).values, settled.values);
    run(&mut core, &mut motion, 2041..=6000);
    assert_eq!(core.counts().lost, 9);
}

/// A hole in the samples must not look like a jump of the arm: the estimate after it is as good as without.
#[test]
fn holes_in_the_stream_do_not_spoil_the_estimate() {
    let mut motion = Motion::new();
    let (mut whole, mut holed) = (Core::new(&motion.robot).expect("sound"), Core::new(&motion.robot).expect("sound"));
    run(&mut whole, &mut motion, 1..=20_000);
    run(&mut holed, &mut motion, (1..=20_000).filter(|seq| seq % 1500 > 3));
    let (a, b) = (parameters(&whole), parameters(&holed));
    for i in 0..a.len() {
        let scale = motion.robot.nominal_base[i].abs().max(0.05);
        assert!((a.values[i] - b.values[i]).abs() < 0.02 * scale, "parameter {i}: {} and {}", a.values[i], b.values[i]);
    }
}

#[test]
fn samples_that_cannot_be_used_are_refused_and_counted() {
    let mut motion = Motion::new();
    let mut core = Core::new(&motion.robot).expect("sound settings");
    run(&mut core, &mut motion, 1..=500);
    let (state, _) = motion.at(500);
    assert_eq!(core.tick(&state, None).taken, Err(Refused::Stale));
    let spoilt = |seq: u64, motion: &mut Motion, spoil: &dyn Fn(&mut JointState)| {
        let (mut state, _) = motion.at(seq);
        spoil(&mut state);
        state
    };
    type Spoil<'a> = &'a dyn Fn(&mut JointState);
    let cases: [(Spoil<'_>, Refused); 5] = [
        (&|s| s.q[1] = f64::NAN, Refused::Invalid),
        (&|s| s.tau[0] = f64::INFINITY, Refused::Invalid),
        (&|s| s.joints = 3, Refused::Invalid),
        (&|s| s.joints = u32::MAX, Refused::Invalid),
        (&|s| s.faults = faults::ENCODER, Refused::Fault),
    ];
    for (k, (spoil, why)) in cases.into_iter().enumerate() {
        let state = spoilt(501 + k as u64, &mut motion, spoil);
        assert_eq!(core.tick(&state, None), Output { publish: false, taken: Err(why) });
    }
    let counts = core.counts();
    assert_eq!((counts.stale, counts.invalid, counts.faults, counts.lost), (1, 4, 1, 0));
    assert_eq!(run(&mut core, &mut motion, 506..=506)[0].taken, Ok(()));
}

#[test]
fn a_robot_controller_that_starts_anew_is_followed() {
    let mut motion = Motion::new();
    let mut core = Core::new(&motion.robot).expect("sound settings");
    run(&mut core, &mut motion, 1..=1000);
    let taken = run(&mut core, &mut motion, 1..=500).iter().filter(|output| output.taken.is_ok()).count();
    assert_eq!(taken, 401, "from the hundredth old sample on");
    assert_eq!((core.counts().restarts, core.counts().lost), (1, 0));
}

#[test]
fn a_setpoint_of_another_period_is_not_used() {
    let mut motion = Motion::new();
    let mut core = Core::new(&motion.robot).expect("sound settings");
    for seq in 1..=100 {
        let ((state, setpoint), (_, other)) = (motion.at(seq), motion.at(seq + 1));
        core.tick(&state, Some(if seq <= 50 { &setpoint } else { &other }));
    }
    assert_eq!(core.counts().setpoints_missing, 50);
}

#[test]
fn frozen_it_keeps_its_values_and_says_so() {
    let mut motion = Motion::new();
    let mut core = Core::new(&motion.robot).expect("sound settings");
    run(&mut core, &mut motion, 1..=3000);
    assert!(core.control(ControlCommand::Freeze));
    // A solution that was under way, spread over several samples, is finished.
    run(&mut core, &mut motion, 3001..=3050);
    let before = parameters(&core);
    run(&mut core, &mut motion, 3051..=5000);
    let after = parameters(&core);
    assert_eq!(after.values, before.values);
    assert_ne!(after.flags & parameter_flags::FROZEN, 0);
    assert_eq!(health(&core).mode, u32::from(DaemonMode::Frozen));
    assert!(core.control(ControlCommand::Resume));
    run(&mut core, &mut motion, 5001..=8000);
    assert_ne!(parameters(&core).values, before.values);
    assert!(core.control(ControlCommand::Reset));
    assert_eq!(parameters(&core).values[..motion.robot.base.len()], motion.robot.nominal_base);
    assert!(!core.control(ControlCommand::Save), "nothing is stored yet");
}

/// Velocities reckoned with half the true period are twice too large: nothing is learnt from such samples, nothing is
/// published, and health says why; at the stated rate it goes on.
#[test]
fn samples_at_another_rate_than_the_robot_files_are_refused_by_name() {
    let mut motion = Motion::new();
    let mut core = Core::new(&motion.robot).expect("sound settings");
    let mut at = |core: &mut Core, seq: u64, period_ns: u64| {
        let (mut state, setpoint) = motion.at(seq);
        state.stamp_ns = 1 + seq * period_ns;
        core.tick(&state, Some(&setpoint))
    };
    let outputs: Vec<Output> = (1..=2000).map(|seq| at(&mut core, seq, 2_000_000)).collect();
    assert!(outputs[128..].iter().all(|o| o.taken == Err(Refused::Period) && !o.publish));
    assert_eq!(DaemonMode::try_from(health(&core).mode), Ok(DaemonMode::WrongPeriod));
    assert!((core.wrong_period_s().expect("it differs") - 0.002).abs() < 1e-9);
    assert_eq!(core.counts().wrong_period, 2000 - 127);
    // Two looks: the first still has stamps of the other rate in it.
    let outputs: Vec<Output> = (2001..=3000).map(|seq| at(&mut core, seq, 10_000_000)).collect();
    assert!(outputs[256..].iter().all(|o| o.taken == Err(Refused::Period)), "ten times as slow is no better");
    let begin = 3000 * 10_000_000 - 3000 * 1_000_000;
    for seq in 3001..=4000 {
        let (mut state, setpoint) = motion.at(seq);
        state.stamp_ns = begin + seq * 1_000_000;
        let output = core.tick(&state, Some(&setpoint));
        assert!(seq < 3257 || output.taken.is_ok(), "sample {seq} at the stated rate");
    }
    assert_ne!(DaemonMode::try_from(health(&core).mode), Ok(DaemonMode::WrongPeriod));
    assert_eq!(core.wrong_period_s(), None);
}

/// The same arm with another line in its file.
fn changed(from: &str, to: &str) -> Core {
    let folder = tempfile::tempdir().expect("a folder");
    let arm = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/dd2");
    let text = std::fs::read_to_string(arm.join("robot.toml")).expect("the arm is there");
    assert!(text.contains(from), "{from}");
    std::fs::write(folder.path().join("robot.toml"), text.replace(from, to)).expect("written");
    std::fs::copy(arm.join("robot.urdf"), folder.path().join("robot.urdf")).expect("copied");
    Core::new(&rivet_config::load(folder.path().join("robot.toml")).expect("a sound file")).expect("sound settings")
}

/// A reload that changes nothing is not to be seen: bit for bit the stream of a core that was left alone.
#[test]
fn an_unchanged_file_changes_no_bit() {
    let (mut alone, mut reloaded) = (Core::new(&robot()).expect("settings"), Core::new(&robot()).expect("settings"));
    let mut motion = Motion::new();
    run(&mut alone, &mut motion, 1..=6000);
    for part in [1..=1999, 2000..=4321, 4322..=6000] {
        run(&mut reloaded, &mut motion, part);
        let kept = reloaded.reconfigure(&mut Core::new(&robot()).expect("settings"));
        assert!(kept.signals && kept.window);
    }
    assert_eq!(parameters(&alone), parameters(&reloaded));
}

/// Whatever changes: values and standard deviations are what they were, the samples go on, and twice the same is the same.
#[test]
fn a_changed_file_moves_no_parameter_and_loses_no_sample() {
    for (from, to, signals, window) in [
        ("window_s = 5.0", "window_s = 2.0", true, true),
        ("decimation = 20 ", "decimation = 10 ", false, true),
        ("model_filter_hz = 10.0 ", "model_filter_hz = 6.0 ", false, true),
        ("[controller]", "[supervision]\nkind = \"eigen\"\ntolerance = 0.1\n[controller]", true, true),
        ("[controller]", "[supervision]\nkind = \"columns\"\n[controller]", true, false),
        ("window_s = 5.0", "window_s = 5.0\nkind = \"rls\"", true, false),
    ] {
        let twice = [0, 1].map(|_| {
            let (mut core, mut motion) = (Core::new(&robot()).expect("settings"), Motion::new());
            run(&mut core, &mut motion, 1..=5000);
            let before = parameters(&core);
            let mut fresh = changed(from, to);
            let kept = core.reconfigure(&mut fresh);
            assert_eq!((kept.signals, kept.window), (signals, window), "{to}");
            let after = parameters(&core);
            assert_eq!((before.values, before.seq, before.epoch), (after.values, after.seq, after.epoch), "{to}");
            // A window that begins anew says so: nobody is to act on it, or store it, before it has seen some motion.
            let provisional = after.flags & parameter_flags::PROVISIONAL != 0;
            assert_eq!(provisional, !window, "{to}");
            for i in 0..before.len() {
                let (known, now) = ((before.std[i], before.state[i]), (after.std[i], after.state[i]));
                if window {
                    assert_eq!(known, now, "{to}: {i}");
                } else if known.1 != u8::from(ParameterState::Unidentified) {
                    assert!((now.0 / known.0 - 1.0).abs() < 1e-12, "{to}: {i}: {known:?} {now:?}");
                    assert_eq!(now.1, u8::from(ParameterState::Held), "{to}: {i}");
                }
            }
            let taken = run(&mut core, &mut motion, 5001..=8000).iter().filter(|out| out.taken.is_ok()).count();
            assert_eq!((taken, core.counts().gaps, core.counts().samples), (3000, 0, 8000), "{to}");
            let later = parameters(&core);
            // The stream is the nominal model's own: every part of the estimate stays near it.
            let std = later.std[..later.len()].iter().copied().fold(0.0, f64::max);
            assert!(std.is_finite(), "{to}");
            for (i, (value, nominal)) in later.values[..later.len()].iter().zip(&robot().nominal_base).enumerate() {
                assert!((value - nominal).abs() < 0.02 * nominal.abs().max(0.1), "{to}: {i}: {value} {nominal}");
            }
            later
        });
        assert_eq!(twice[0], twice[1], "{to}: deterministic");
    }
}

/// What a killed daemon had stored is what its successor knows: values, how well, and which were identified.
#[test]
fn a_successor_knows_what_was_stored() {
    let (mut first, mut motion) = (Core::new(&robot()).expect("settings"), Motion::new());
    run(&mut first, &mut motion, 1..=5000);
    let stored = parameters(&first);
    let n = stored.len();
    let open = u8::from(ParameterState::Unidentified);
    let identified: Vec<bool> = stored.state[..n].iter().map(|s| *s != open).collect();
    assert!(identified.iter().filter(|identified| **identified).count() > n / 2);
    let mut second = Core::new(&robot()).expect("settings");
    let before = parameters(&second);
    for (values, std) in [(&stored.values[..n - 1], &stored.std[..n]), (&stored.values[..n], &[f64::NAN; 128][..n])] {
        assert!(!second.recall(values, std, &identified));
        assert_eq!(parameters(&second), before, "nothing changed");
    }
    assert!(second.recall(&stored.values[..n], &stored.std[..n], &identified));
    let known = parameters(&second);
    assert_eq!(known.values, stored.values);
    for i in 0..n {
        if identified[i] {
            let (a, b) = (known.std[i], stored.std[i]);
            assert!((a - b).abs() <= 1e-12 * b, "{i}: {a} {b}");
            assert_eq!(known.state[i], u8::from(ParameterState::Held), "{i}");
        } else {
            assert_eq!(known.state[i], open, "{i}");
        }
    }
    run(&mut second, &mut motion, 6000..=12000);
    let later = parameters(&second);
    let active = later.state[..n].iter().map(|s| usize::from(*s == u8::from(ParameterState::Active))).sum::<usize>();
    assert!(active > n / 2, "{active} of {n} move again");
    for (value, nominal) in later.values[..n].iter().zip(&robot().nominal_base) {
        assert!((value - nominal).abs() < 0.02 * nominal.abs().max(0.1), "{value} {nominal}");
    }
}

/// Kinds of supervision, by a line of the robot file, and whether the judgement of a cycle that is under way may be lost.
const KINDS: [(&str, &str, bool); 4] = [
    ("window_s = 5.0", "window_s = 5.0", true),
    ("window_s = 5.0", "window_s = 5.0\ninstruments = \"setpoint\"", true),
    ("[controller]", "[supervision]\nkind = \"eigen\"\n[controller]", false),
    ("[controller]", "[supervision]\nkind = \"columns\"\n[controller]", false),
];

/// Whoever goes on from the memory of a daemon that was killed does what that one would have done, had it lost the same
/// samples: bit for bit where supervision works sample by sample; else, where a judgement that was under way begins anew, to
/// a small part of the standard deviations.
#[test]
fn from_its_memory_a_successor_goes_on_as_if_nothing_had_been() {
    for (from, line, exact) in KINDS {
        let (mut first, mut motion) = (changed(from, line), Motion::new());
        run(&mut first, &mut motion, 1..=5000);
        let mut memory = vec![0.0; first.memory_len()];
        assert!(first.write_memory(&mut memory), "{line}");
        assert!(!first.write_memory(&mut memory.clone()[1..]), "another length");
        let mut second = changed(from, line);
        assert_eq!(second.memory_fingerprint(), first.memory_fingerprint());
        assert!(second.resume(&memory), "{line}");
        let (a, b) = (parameters(&first), parameters(&second));
        assert_eq!((a.values, a.std, a.state, a.reference), (b.values, b.std, b.state, b.reference), "{line}");
        assert_eq!(b.flags & parameter_flags::PROVISIONAL, 0, "{line}");
        for core in [&mut first, &mut second] {
            run(core, &mut motion, 5100..=9000);
        }
        let (a, b) = (parameters(&first), parameters(&second));
        if exact {
            assert_eq!((a.values, a.std, a.state, a.reference), (b.values, b.std, b.state, b.reference), "{line}");
        }
        for i in 0..a.len() {
            assert!(
                (a.values[i] - b.values[i]).abs() <= 0.05 * a.std[i],
                "{line}: {i}: {} {}",
                a.values[i],
                b.values[i]
            );
            assert!((a.std[i] / b.std[i] - 1.0).abs() <= 0.05, "{line}: {i}: {} {}", a.std[i], b.std[i]);
        }
    }
}

/// A memory of another daemon, or one that was damaged, is not taken up, and nothing changes.
#[test]
fn a_memory_that_cannot_be_is_not_taken_up() {
    let (mut first, mut motion) = (Core::new(&robot()).expect("settings"), Motion::new());
    run(&mut first, &mut motion, 1..=3000);
    let mut memory = vec![0.0; first.memory_len()];
    assert!(first.write_memory(&mut memory));
    let mut second = Core::new(&robot()).expect("settings");
    let before = parameters(&second);
    for at in (0..memory.len()).step_by(7) {
        let kept = std::mem::replace(&mut memory[at], f64::NEG_INFINITY);
        // Not everything is finite by nature.
        if second.resume(&memory) {
            second = Core::new(&robot()).expect("settings");
        } else {
            assert_eq!(parameters(&second), before, "{at}");
        }
        memory[at] = kept;
    }
    assert!(!second.resume(&memory[1..]) && !second.resume(&[]));
    assert_eq!(parameters(&second), before);
    for line in ["window_s = 6.0", "window_s = 5.0\nkind = \"rls\""] {
        assert_ne!(changed("window_s = 5.0", line).memory_fingerprint(), second.memory_fingerprint(), "{line}");
    }
    assert!(second.resume(&memory));
    run(&mut second, &mut motion, 4000..=5000);
}

/// Levels that change at any sample, up and down, with a fault under each: what the published messages say of them is enough to
/// do it all again, bit for bit.
#[test]
fn a_recorded_sequence_of_load_levels_replays_bit_for_bit() {
    const LEVELS: [LoadLevel; 4] = [LoadLevel::Normal, LoadLevel::PublishLess, LoadLevel::Decimate, LoadLevel::Hold];
    let mut motion = Motion::new();
    let mut spoilt = |seq: u64| {
        let (mut state, setpoint) = motion.at(seq);
        if seq.is_multiple_of(1900) {
            state.tau[0] = f64::NAN;
        }
        (state, setpoint)
    };
    let mut live = Core::new(&robot()).expect("settings");
    let (mut sets, mut told) = (Vec::new(), Vec::<(u64, u32)>::new());
    let mut random = 88_172_645_463_325_252_u64;
    for seq in 1..=20_000 {
        let (state, setpoint) = spoilt(seq);
        if live.tick(&state, Some(&setpoint)).publish {
            sets.push(parameters(&live));
        }
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        if random.is_multiple_of(400) {
            live.set_load(LEVELS[(random >> 32) as usize % 4]);
            let said = health(&live);
            told.extend(
                (told.last() != Some(&(said.load_seq, said.load_level))).then_some((said.load_seq, said.load_level)),
            );
        }
    }
    assert!(told.len() > 20 && sets.len() > 50, "{} levels, {} sets", told.len(), sets.len());
    assert_eq!(health(&live).load_changes, told.len() as u64);
    let mut again = Core::new(&robot()).expect("settings");
    let mut replayed = Vec::new();
    for seq in 1..=20_000 {
        for (_, level) in told.iter().filter(|(from, _)| *from == seq) {
            again.set_load(LoadLevel::try_from(*level).expect("a level"));
        }
        let (state, setpoint) = spoilt(seq);
        if again.tick(&state, Some(&setpoint)).publish {
            replayed.push(parameters(&again));
        }
    }
    assert_eq!(replayed, sets);
}

/// While nothing is learnt a fault is over with the first sound sample, and sound samples are counted as left aside.
#[test]
fn held_it_tells_sound_samples_from_faults() {
    let (mut core, mut motion) = (Core::new(&robot()).expect("settings"), Motion::new());
    run(&mut core, &mut motion, 1..=3000);
    let before = parameters(&core);
    core.set_load(LoadLevel::Hold);
    let (mut bad, _) = motion.at(3001);
    bad.q[0] = f64::NAN;
    core.tick(&bad, None);
    assert_eq!(DaemonMode::try_from(health(&core).mode), Ok(DaemonMode::BadInput));
    run(&mut core, &mut motion, 3002..=3500);
    let held = health(&core);
    assert_eq!(DaemonMode::try_from(held.mode), Ok(DaemonMode::Suspended));
    assert_eq!((held.input_fault, held.samples, held.samples_held), (0, 3000, 499));
    assert_eq!(parameters(&core).flags & parameter_flags::BAD_INPUT, 0);
    assert_eq!(parameters(&core).values, before.values);
    core.set_load(LoadLevel::Normal);
    run(&mut core, &mut motion, 3501..=6000);
    assert_eq!(DaemonMode::try_from(health(&core).mode), Ok(DaemonMode::Estimating));
    assert_ne!(parameters(&core).values, before.values);
}
