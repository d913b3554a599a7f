//! Small inputs that failed in the field, and others of their kinds: each command reports what is right. Where `../shared` is absent
//! they are skipped, visibly.

use std::path::{Path, PathBuf};
use std::process::Command;

use rivet_logs::{Log, ReadOptions, Signals, read};
use rivet_tests::altered::{Random, written};
use rivet_tests::{rivet, shared};

/// Runs a command: exit code and everything it said, on one line.
fn said(command: &mut Command) -> (Option<i32>, String) {
    let output = command.output().expect("rivet starts");
    let text = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
    (output.status.code(), text.split_whitespace().collect::<Vec<_>>().join(" "))
}

const COMMANDS: [&str; 4] = ["identify", "predict", "replay", "diagnose"];

/// What a command says of the logs of a case: `predict` and `replay` take one.
fn of_case(command: &str, case: &Path, scratch: &Path) -> (Option<i32>, String) {
    let mut run = rivet();
    run.arg(command).arg(case.join("robot.toml")).arg(case.join("log1.parquet"));
    match command {
        "predict" => run.arg("--out").arg(scratch.join("predicted.parquet")),
        "replay" => &mut run,
        _ => run.arg(case.join("log2.parquet")),
    };
    said(&mut run)
}

fn each_command(case: &str, check: impl Fn(&str, &str)) {
    let Some(case) = shared(&format!("data/field/{case}")) else { return };
    let scratch = tempfile::tempdir().expect("a folder");
    for command in COMMANDS {
        let (_, text) = of_case(command, &case, scratch.path());
        check(command, &text);
    }
}

#[test]
fn positions_in_turns_are_named_by_every_command() {
    each_command("07-positions-in-turns", |command, text| {
        assert!(text.contains("q1..6 in turns") && text.contains("multiply q1..6 by 6.283"), "{command}: {text}");
        if command == "diagnose" {
            assert!(text.contains("diagnose ur5e: not evaluated"), "{text}");
        }
    });
}

#[test]
fn inertias_in_another_unit_are_named_by_every_command() {
    each_command("12-inertia-g-mm2", |command, text| {
        assert!(text.contains("inertias of the URDF in g mm^2"), "{command}: {text}");
    });
}

#[test]
fn torque_behind_the_gears_is_named_by_every_command() {
    each_command("11-link-side-sensor", |command, text| {
        assert!(text.contains("behind the gears") && !text.contains("is this the robot's file"), "{command}: {text}");
    });
}

#[test]
fn friction_that_drifts_is_named_and_is_no_limit_of_torque() {
    each_command("09-warming-false-saturation", |command, text| {
        assert!(text.contains("friction changes while it is logged"), "{command}: {text}");
        if command == "diagnose" {
            assert!(!text.contains("torque_saturation") && !text.contains("limit 1.3"), "{text}");
        }
    });
}

#[test]
fn single_rows_that_jump_spoil_no_command() {
    let Some(case) = shared("data/field/02-glitch-rows-diagnose-predict") else { return };
    let scratch = tempfile::tempdir().expect("a folder");
    for command in ["identify", "predict", "diagnose"] {
        let (_, text) = of_case(command, &case, scratch.path());
        assert!(text.contains("position jumps by up to") && text.contains("2 of 3000 rows"), "{command}: {text}");
        if command == "diagnose" {
            assert!(
                text.starts_with("diagnose ur5e: wrong values") || text.contains("diagnose ur5e: wrong values"),
                "{text}"
            );
        }
    }
}

#[test]
fn first_files_are_read_and_the_channels_are_reported() {
    let Some(case) = shared("data/field/10-first-file-messages") else { return };
    let files: [(&str, &[&str]); 11] = [
        (
            "01-rostopic.csv",
            &["q = \"field.position{i}\"", "tau = \"field.effort{i}\"", "time = \"field.header.stamp\""],
        ),
        ("02-plotjuggler.csv", &["q = \"/joint_states/{joint}/position\"", "time = \"__time\""]),
        ("03-rtde-space.csv", &["q = \"actual_q_{i}\"", "current = \"actual_current_{i}\""]),
        ("03b-space.csv", &[]),
        (
            "04-libfranka.csv",
            &["q = \"robot_state.q[{i}]\"", "tau = \"robot_state.tau_J[{i}]\"", "time = \"duration\""],
        ),
        ("06d-units.csv", &["q = \"q{i}\"", "tau = \"tau{i}\""]),
        ("06e-upper.csv", &["q = \"Q{i}\"", "tau = \"TAU{i}\""]),
        ("06g-percent-comment.csv", &[]),
        ("gzip.parquet", &[]),
        ("brotli.parquet", &[]),
        ("lz4.parquet", &[]),
    ];
    let out: PathBuf = tempfile::tempdir().expect("a folder").keep().join("predicted.parquet");
    for (file, words) in files {
        let mut run = rivet();
        run.arg("predict").arg(case.join("robot.toml")).arg(case.join(file)).arg("--out").arg(&out);
        let (code, text) = said(&mut run);
        assert_eq!(code, Some(0), "{file}: {text}");
        assert!(words.iter().all(|word| text.contains(word)), "{file}: {text}");
    }
    // A list has no names: its order is that of the file.
    let (_, text) = said(rivet().arg("identify").arg(case.join("robot.toml")).arg(case.join("lerobot.parquet")));
    assert!(text.contains("q = \"observation.state[{i}]\"") && text.contains("without torque"), "{text}");
}

/// The same arm with sound logs (friction 12 % above the file's), changed as others of the field are: the answers of each command.
fn varied(change: impl Fn(&mut Log, &mut Signals), check: impl Fn(&str, &str)) {
    let Some(sound) = shared("data/field/12-inertia-g-mm2") else { return };
    let Some(arm) = shared("data/field/02-glitch-rows-diagnose-predict") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    for file in ["robot.toml", "robot.urdf"] {
        std::fs::copy(arm.join(file), folder.path().join(file)).expect("copied");
    }
    for name in ["log1.parquet", "log2.parquet"] {
        let mut log = read(sound.join(name), &ReadOptions::new(6)).expect("a sound log");
        let mut tau = log.torque().expect("torque").clone();
        change(&mut log, &mut tau);
        let path = written(&log, &tau, folder.path());
        std::fs::rename(path, folder.path().join(name)).expect("renamed");
    }
    for command in COMMANDS {
        let (_, text) = of_case(command, folder.path(), folder.path());
        println!("{command}: {text}\n");
        check(command, &text);
    }
}

const READING: &str = "most probable reading";

/// A diagnosis of the arm's own change, whatever was mended in the log.
fn is_parameter(command: &str, text: &str) {
    assert!(!text.contains(READING), "{command}: {text}");
    if command == "diagnose" {
        assert!(text.contains("diagnose ur5e: wrong values") && text.contains("viscous friction"), "{text}");
    }
}

#[test]
fn sound_logs_have_no_other_reading() {
    varied(|_, _| (), is_parameter);
}

#[test]
fn units_of_positions_are_named_by_every_command() {
    let scaled = |q: &mut [f64], factor: f64| q.iter_mut().for_each(|q| *q *= factor);
    varied(
        |log, _| scaled(&mut log.q[3], 1.0 / std::f64::consts::TAU),
        |command, text| assert!(text.contains("q4 (wrist_1_joint) in turns"), "{command}: {text}"),
    );
    varied(
        |log, _| log.q.iter_mut().for_each(|q| scaled(q, 0.5)),
        |command, text| assert!(text.contains("q1..6 at half scale"), "{command}: {text}"),
    );
}

#[test]
fn negated_torque_is_one_fault() {
    varied(
        |_, tau| tau.iter_mut().flatten().for_each(|tau| *tau = -*tau),
        |command, text| {
            assert!(text.contains("tau1..6 with the other sign"), "{command}: {text}");
            assert!(text.matches("warning: ").count() <= 3, "{command}: {text}");
        },
    );
}

#[test]
fn exchanged_torques_are_named_and_are_no_delay() {
    varied(
        |_, tau| tau.swap(1, 2),
        |command, text| {
            assert!(text.contains("torques of shoulder_lift_joint and elbow_joint in each other's place"), "{text}");
            assert!(!text.contains("torque_delay"), "{command}: {text}");
        },
    );
}

#[test]
fn rows_of_a_second_publisher_spoil_no_command() {
    for (seed, share) in [(11, 0.03), (4, 0.03), (1, 0.06)] {
        let mut random = Random(seed);
        let foreign: Vec<usize> = (0..5000).filter(|_| random.uniform() + 0.5 < share).collect();
        varied(
            |log, tau| {
                let rows = log.len();
                for k in foreign.iter().filter(|k| **k < rows) {
                    log.q.iter_mut().chain(tau.iter_mut()).for_each(|signal| signal[*k] = 0.0);
                }
            },
            |command, text| {
                assert!(text.contains("a second publisher"), "{command}: {text}");
                is_parameter(command, text);
                assert!(!text.contains("joint_elasticity"), "{seed}, {share}: {text}");
            },
        );
    }
}

/// The other publisher's rows come beside the arm's, none of which is missing.
#[test]
fn rows_of_a_second_publisher_between_those_of_the_arm_spoil_no_command() {
    varied(
        |log, tau| {
            let with = |signal: &[f64], other: &dyn Fn(usize) -> f64| -> Vec<f64> {
                let rows = signal.iter().enumerate();
                rows.flat_map(|(k, x)| [Some(*x), (k % 3 == 1).then(|| other(k))]).flatten().collect()
            };
            let t = log.t.clone();
            let step = t[1] - t[0];
            log.t = with(&t, &|k| t[k] + 0.4 * step);
            log.q.iter_mut().chain(tau.iter_mut()).for_each(|signal| *signal = with(signal, &|_| 0.0));
        },
        |command, text| {
            assert!(text.contains("a second publisher"), "{command}: {text}");
            is_parameter(command, text);
        },
    );
}

#[test]
fn glitches_and_wraps_spoil_no_command() {
    let pi = std::f64::consts::PI;
    varied(
        |log, _| {
            let mut random = Random(5);
            for j in [0, 4] {
                log.q[j].iter_mut().for_each(|q| *q -= if random.uniform() < -0.495 { 1.3 } else { 0.0 });
            }
            log.q[2].iter_mut().for_each(|q| *q = (*q + 1.0 + pi).rem_euclid(2.0 * pi) - pi - 1.0);
        },
        |command, text| {
            if command != "replay" {
                assert!(text.contains("position jumps by up to 1.3"), "{command}: {text}");
            }
            is_parameter(command, text);
        },
    );
}

#[test]
fn late_torque_has_no_false_causes() {
    for rows in [2, 6, 11] {
        varied(
            |_, tau| {
                for tau in tau.iter_mut() {
                    let first = tau[0];
                    tau.rotate_right(rows);
                    tau[..rows].fill(first);
                }
            },
            |command, text| {
                if command == "diagnose" {
                    let is_void = text.contains("diagnose ur5e: not evaluated");
                    let causes =
                        ["presliding", "elasticity", "saturation", "payload", "gravity_direction", "link_inertia"];
                    let false_cause = causes.iter().find(|cause| text.contains(*cause));
                    assert!(is_void || false_cause.is_none(), "{rows} rows: {false_cause:?}: {text}");
                }
                if [6, 11].contains(&rows) {
                    let late = text.contains("later than") || text.contains("behind position") || text.contains("late");
                    assert!(late, "{command}, {rows} rows: {text}");
                }
            },
        );
    }
}

#[test]
fn offsets_of_torque_are_no_fault_of_a_channel() {
    varied(
        |_, tau| {
            let offsets = [2.5, -2.5, 2.0, -1.0, 0.8, -0.6];
            tau.iter_mut().zip(offsets).for_each(|(tau, offset)| tau.iter_mut().for_each(|tau| *tau += offset));
        },
        |command, text| {
            assert!(!text.contains(READING) && !text.contains("in each other's place"), "{command}: {text}");
        },
    );
}
