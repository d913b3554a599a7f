//! Logs and words with which nothing good can be learnt: what the commands say, and how they end.

use std::path::{Path, PathBuf};

use rivet_logs::{Log, ReadOptions, read, write_columns};
use rivet_tests::altered::{changed, result, said, sound, with_torque_times, written};
use rivet_tests::{rivet, robot, shared};

#[test]
fn positions_in_degrees_are_refused_wherever_a_log_is_read() {
    let Some(log) = shared("data/real/staubli_tx40/exciting_0.0-5.5s.parquet") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let degrees =
        changed("staubli-tx40", &log, folder.path(), |_, _, q| q.iter_mut().for_each(|q| *q = q.to_degrees()));
    for command in ["identify", "replay", "diagnose"] {
        let (code, text) =
            said(rivet().arg(command).arg(robot("staubli-tx40")).arg(&degrees).current_dir(folder.path()));
        assert_eq!(code, Some(65), "{command}: {text}");
        assert!(
            text.contains("changed.parquet: column q1: runs from") && text.contains("degrees?"),
            "{command}: {text}"
        );
    }
    // A reading that jumps in a few rows is no unit.
    let jumps =
        changed("staubli-tx40", &log, folder.path(), |row, _, q| q[0] += if row % 400 == 7 { 60.0 } else { 0.0 });
    let (_, text) = said(rivet().arg("identify").arg(robot("staubli-tx40")).arg(&jumps));
    assert!(!text.contains("degrees?"), "{text}");
}

#[test]
fn failures_end_with_the_code_of_whose_fault_it_is() {
    let (code, text) = said(rivet().args(["figures", "4"]));
    assert!(code == Some(64) && text.contains("figure 4 is not computed"), "{code:?} {text}");
    for command in ["identify", "replay", "diagnose"] {
        let (code, text) = said(rivet().arg(command).arg(robot("ur10e")).arg("of-yesterday.parquet"));
        assert!(code == Some(74) && text.contains("of-yesterday.parquet: "), "{command}: {code:?} {text}");
    }
    let Some(log) = shared("data/real/staubli_tx40/exciting_0.0-5.5s.parquet") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let tx40 = robot("staubli-tx40");
    let still = changed("staubli-tx40", &log, folder.path(), |_, _, q| q.fill(0.1));
    let (code, text) = said(rivet().arg("identify").arg(&tx40).arg(&still));
    assert!(code == Some(65) && text.contains("no motion is left"), "{code:?} {text}");
    let (code, text) = said(rivet().args(["identify", "--compare"]).arg(&tx40).arg(&log));
    assert!(code == Some(64) && text.contains("at least two logs"), "{code:?} {text}");
    // In milliseconds this log of 5 kHz looks like a slow one in seconds.
    for (unit, factor) in [("us", 1e6), ("ns", 1e9)] {
        let scaled = changed("staubli-tx40", &log, folder.path(), |_, t, _| *t *= factor);
        for command in ["identify", "diagnose", "replay"] {
            let (code, text) = said(rivet().arg(command).arg(&tx40).arg(&scaled));
            assert!(code == Some(65) && text.contains(&format!("--map time_unit={unit}")), "{command} {code:?} {text}");
        }
    }
    for command in ["identify", "diagnose", "replay"] {
        let (code, text) = said(rivet().arg(command).arg(&log).arg(&tx40));
        assert!(code == Some(64) && text.contains("the order is ROBOT.toml LOG"), "{command}: {code:?} {text}");
    }
}

/// Positions that cannot be true are refused and counted as such: every row of the log is accounted for.
#[test]
fn a_replay_with_refused_samples_counts() {
    let Some(log) = shared("data/real/kinova_gen3/RunTrajectory1.parquet") else { return };
    let file = rivet_tests::root().join("tests/robots/kinova-gen3/robot.toml");
    let (code, text) = said(rivet().arg("replay").arg(file).arg(log));
    assert!(text.contains("EncoderJump"), "{text}");
    assert!(code == Some(0) && !text.contains("does not count"), "{code:?} {text}");
}

/// A torque of the wrong sign or unit is identified as it is, and said to be one; the log as it was measured has no such word. A
/// torque of zero is refused off line, and warned of sample by sample.
#[test]
fn torques_that_cannot_be_believed_are_told_by_identify() {
    let Some(log) = shared("data/real/ur10e_innopolis/20_02_10-20sec_7harm.parquet") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let json = folder.path().join("result.json");
    let faults = |factor: &dyn Fn(usize) -> f64| -> Vec<(String, String)> {
        let path = with_torque_times("ur10e", &log, folder.path(), factor);
        let (code, text) = said(rivet().arg("identify").arg(robot("ur10e")).arg(path).arg("--json").arg(&json));
        assert_eq!(code, Some(0), "{text}");
        let result: serde_json::Value =
            serde_json::from_slice(&std::fs::read(&json).expect("a result")).expect("sound JSON");
        let warnings = result["warnings"].as_array().expect("a list").clone();
        assert_eq!(text.matches("warning: ").count(), warnings.len(), "{text}");
        warnings
            .iter()
            .map(|w| (w["joint"].as_str().unwrap_or("").to_owned(), w["fault"].as_str().expect("a name").to_owned()))
            .collect()
    };
    assert_eq!(faults(&|_| 1.0), []);
    let joints = &rivet_config::load(robot("ur10e")).expect("a sound robot file").model.arm.joints;
    let all = |fault: &str| -> Vec<(String, String)> {
        joints.iter().map(|joint| (joint.name.clone(), fault.to_owned())).collect()
    };
    // One fault of all joints is reported once.
    let whole = [(String::new(), "log_reading".to_owned())];
    assert_eq!(faults(&|_| -1.0), whole);
    assert_eq!(faults(&|_| 1e3), whole);
    assert_eq!(faults(&|j| if j == 0 { -1.0 } else { 1.0 }), [all("torque_sign")[0].clone()]);

    let dead = with_torque_times("ur10e", &log, folder.path(), |j| if j == 2 { 0.0 } else { 1.0 });
    let (code, text) = said(rivet().arg("identify").arg(robot("ur10e")).arg(&dead));
    assert!(code == Some(65) && text.contains(".parquet: torque of joint 3 is 0 in all rows"), "{text}");
    let (code, text) = said(rivet().args(["identify", "--online"]).arg(robot("ur10e")).arg(&dead));
    assert!(code == Some(0) && text.contains(&format!("warning: {}: torque is 0 while", joints[2].name)), "{text}");
}

/// Samples that are all refused are not "too few": it is said what was wrong with them.
#[test]
fn a_log_of_which_every_sample_is_refused_says_why() {
    let Some(log) = shared("data/real/ur10e_innopolis/20_02_10-20sec_7harm.parquet") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let path = with_torque_times("ur10e", &log, folder.path(), |_| 1e9);
    for command in [&["identify", "--online"][..], &["replay"]] {
        let (code, text) = said(rivet().args(command).arg(robot("ur10e")).arg(&path).current_dir(folder.path()));
        assert_eq!(code, Some(65), "{text}");
        let all = text.split("nothing was identified: ").nth(1).expect("a reason").to_owned();
        let words: Vec<&str> = all.split_whitespace().collect();
        assert!(words[0] == words[2] && all.contains("samples were refused; met: implausible"), "{text}");
    }
}

/// A log that is given twice, or held out from itself, is known by its samples whatever it is called.
#[test]
fn the_same_log_twice_is_told() {
    let Some(log) = shared("data/real/ur10e_innopolis/20_02_10-20sec_7harm.parquet") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let tau = sound("ur10e", &log).torque().expect("torque").clone();
    let (again, json) = (written(&sound("ur10e", &log), &tau, folder.path()), folder.path().join("result.json"));
    let faults = |words: &[&Path]| -> Vec<String> {
        let (code, text) = said(rivet().arg("identify").arg(robot("ur10e")).args(words).arg("--json").arg(&json));
        assert_eq!(code, Some(0), "{text}");
        let result: serde_json::Value =
            serde_json::from_slice(&std::fs::read(&json).expect("a result")).expect("sound JSON");
        let warnings = result["warnings"].as_array().expect("a list");
        assert_eq!(text.matches("the same samples as").count(), warnings.len(), "{text}");
        warnings.iter().map(|w| w["fault"].as_str().expect("a name").to_owned()).collect()
    };
    assert_eq!(faults(&[&log]), Vec::<String>::new());
    assert_eq!(faults(&[&log, &again]), ["log_given_twice"]);
    assert_eq!(faults(&[&log, Path::new("--hold-out"), &again]), ["hold_out_was_learnt_from"]);
}

/// Nor do two runs that are one agree because the deviations are right.
#[test]
fn a_log_compared_with_itself_is_told() {
    let Some(log) = shared("data/real/ur10e_innopolis/20_02_10-20sec_7harm.parquet") else { return };
    let (code, text) = said(rivet().arg("identify").arg("--compare").arg(robot("ur10e")).args([&log, &log]));
    assert_eq!(code, Some(0), "{text}");
    assert!(
        text.contains("the same samples as 20_02_10-20sec_7harm.parquet; a log always agrees with itself"),
        "{text}"
    );
}

/// What a torque channel says whatever the arm does is refused; what it cannot say is told.
#[test]
fn torque_that_is_one_number_is_refused_and_torque_that_is_cut_off_is_told() {
    let Some(path) = shared("data/real/ur10e_innopolis/20_02_10-20sec_7harm.parquet") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let log = sound("ur10e", &path);
    let changed = |change: &dyn Fn(f64) -> f64| {
        let mut tau = log.torque().expect("torque").clone();
        tau[1].iter_mut().for_each(|tau| *tau = change(*tau));
        said(rivet().arg("identify").arg(robot("ur10e")).arg(written(&log, &tau, folder.path())))
    };
    let (code, text) = changed(&|_| 5.0);
    let says = "changed.parquet: column tau2 is 5 in every row although shoulder_lift_joint moves by";
    assert!(code == Some(65) && text.contains(says), "{code:?} {text}");
    let mut sorted = log.torque().expect("torque")[1].clone();
    sorted.sort_unstable_by(f64::total_cmp);
    // In a twentieth of the rows it would have been more.
    let limit = sorted[sorted.len() * 19 / 20];
    let (code, text) = changed(&|tau| tau.min(limit));
    assert!(code == Some(0) && text.contains("shoulder_lift_joint: column tau2 stands at"), "{code:?} {text}");
    assert_eq!(text.matches("warning: ").count(), 1, "{text}");
    let (_, text) = changed(&|tau| tau);
    assert!(!text.contains("warning: "), "{text}");
}

#[test]
fn nothing_is_judged_by_a_log_in_which_the_arm_stands() {
    let Some(log) = shared("data/real/ur10e_innopolis/20_02_10-20sec_7harm.parquet") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let still = changed("ur10e", &log, folder.path(), |_, _, q| q.fill(0.1));
    let (code, text) = said(rivet().arg("identify").arg(robot("ur10e")).arg(&log).arg("--hold-out").arg(still));
    let says = "changed.parquet: no joint moves faster than its dead zone";
    assert!(code == Some(0) && text.contains(says) && !text.contains("held out, "), "{code:?} {text}");
}

/// A practice case whose two logs went through `change` (0 the first, 1 the second), with their desired motion.
fn case_with(case: &Path, folder: &Path, change: impl Fn(usize, &mut Log)) -> [PathBuf; 2] {
    [("log-a.parquet", 0), ("log-b.parquet", 1)].map(|(name, which)| {
        let mut log = read(case.join(name), &ReadOptions::new(6)).expect("a log");
        change(which, &mut log);
        let groups = [
            ("q", Some(&log.q)),
            ("tau", log.tau.as_ref().map(|(_, tau)| tau)),
            ("q_des", log.q_des.as_ref()),
            ("qd_des", log.qd_des.as_ref()),
            ("qdd_des", log.qdd_des.as_ref()),
        ];
        let mut columns = vec![("t".to_owned(), &log.t[..])];
        for (group, signals) in groups {
            let named = signals.into_iter().flatten().enumerate().map(|(j, s)| (format!("{group}{}", j + 1), &s[..]));
            columns.extend(named);
        }
        let path = folder.join(name);
        write_columns(&path, &columns).expect("written");
        path
    })
}

/// The verdict as JSON, and what was said.
fn judged(robot: &Path, logs: &[PathBuf], folder: &Path) -> (serde_json::Value, String) {
    let json = folder.join("verdict.json");
    let (_, text) = said(rivet().arg("diagnose").arg(robot).args(logs).arg("--json").arg(&json));
    let found = std::fs::read(&json).unwrap_or_else(|_| panic!("{text}"));
    (serde_json::from_slice(&found).expect("JSON"), text)
}

#[test]
fn what_was_looked_at_is_not_sealed() {
    let Some(case) = shared("data/practice/case-16") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let refused = |logs: &[PathBuf]| {
        let (code, text) = said(rivet().arg("diagnose").arg(case.join("robot.toml")).args(logs));
        assert_eq!(code, Some(65), "{text}");
        text
    };
    let whole = case.join("log-a.parquet");
    let text = refused(&[whole.clone(), whole.clone()]);
    assert!(text.contains("log-a.parquet hold the same samples: 13.00 s"), "{text}");
    let cuts = case_with(&case, folder.path(), |which, log| {
        *log = read(&whole, &ReadOptions::new(6)).expect("a log");
        *log = if which == 0 { log.slice(0..9000) } else { log.slice(6000..13000) };
    });
    let text = refused(&cuts);
    assert!(text.contains("log-a.parquet") && text.contains("log-b.parquet hold the same samples: 3.00 s"), "{text}");
}

#[test]
fn a_clock_that_is_not_that_of_the_speeds_is_refused() {
    let Some(case) = shared("data/practice/case-24") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let logs = case_with(&case, folder.path(), |_, log| log.t.iter_mut().for_each(|t| *t *= 1.25));
    for command in ["diagnose", "identify"] {
        let (code, text) = said(rivet().arg(command).arg(case.join("robot.toml")).args(&logs));
        assert!(code == Some(65) && text.contains("0.800 times as fast as the log's speeds,"), "{code:?} {text}");
    }
}

/// A plan in degrees beside positions in radians is no clock, whether its speeds are in degrees as well or not.
#[test]
fn a_plan_in_degrees_is_named() {
    let Some(case) = shared("data/practice/case-24") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let degrees = |signals: &mut Option<Vec<Vec<f64>>>| {
        signals.iter_mut().flatten().flatten().for_each(|x| *x = x.to_degrees());
    };
    for speeds in [false, true] {
        let logs = case_with(&case, folder.path(), |_, log| {
            degrees(&mut log.q_des);
            if speeds {
                degrees(&mut log.qd_des);
                degrees(&mut log.qdd_des);
            }
        });
        for command in [&["identify"][..], &["identify", "--online"]] {
            let (code, text) = said(rivet().args(command).arg(case.join("robot.toml")).arg(&logs[0]));
            assert!(code == Some(65) && text.contains("column q_des1: changes 57.3 times as much as q1"), "{text}");
            assert!(text.contains("are these degrees?"), "{text}");
        }
    }
}

/// On line a reading that is held, or of a coarse encoder, is refused as frozen or as a jump: it is said what it is.
#[test]
fn held_and_coarse_positions_are_called_so_on_line() {
    let Some(case) = shared("data/practice/case-24") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let on_line = |change: &dyn Fn(usize, &mut Log)| {
        let [log, _] = case_with(&case, folder.path(), change);
        said(rivet().args(["identify", "--online"]).arg(case.join("robot.toml")).arg(log)).1
    };
    let held = on_line(&|_, log| {
        let tau = log.tau.as_mut().map(|(_, tau)| tau);
        for signal in [Some(&mut log.q), tau].into_iter().flatten().flatten() {
            (0..signal.len()).for_each(|k| signal[k] = signal[k - k % 6]);
        }
    });
    assert!(held.contains("each position is held for 6 samples of 1.00 ms"), "{held}");
    assert!(!held.contains("no joint has moved"), "{held}");
    let coarse = on_line(&|_, log| {
        log.q.iter_mut().flatten().for_each(|q| *q = (*q / 1e-3).round() * 1e-3);
    });
    assert!(coarse.contains("positions come in larger steps than [drive] encoder_resolution ("), "{coarse}");
    let sound = on_line(&|_, _| ());
    assert!(!sound.contains("encoder_resolution") && !sound.contains("is held for"), "{sound}");
}

/// One per cent is told with what it does, by the plan and by measured speeds; without either the robot file's period may tell it.
#[test]
fn a_clock_that_runs_a_little_fast_is_told() {
    let Some(case) = shared("data/practice/case-24") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let warned = |change: &dyn Fn(&mut Log)| {
        let [log, _] = case_with(&case, folder.path(), |_, log| change(log));
        let (_, found) = result(rivet().arg("identify").arg(case.join("robot.toml")).arg(log), folder.path());
        let clocks = ["clock_off", "period_off"];
        let mut said = found["warnings"].as_array().expect("a list").clone();
        said.retain(|w| clocks.iter().any(|clock| w["fault"] == *clock));
        said.iter().map(|w| format!("{} {}", w["fault"], w["text"])).collect::<Vec<_>>().join(" ")
    };
    let faster = |log: &mut Log| log.t.iter_mut().for_each(|t| *t *= 1.01);
    let text = warned(&faster);
    for says in ["clock_off", "0.99010", "all 6 joints that move: t runs 1", "% fast", "inertias are estimated 1.0201"]
    {
        assert!(text.contains(says), "{says}: {text}");
    }
    let text = warned(&|log| {
        faster(log);
        (log.q_des, log.qd_des, log.qdd_des) = (None, None, None);
    });
    assert!(text.contains("period_off") && text.contains("every 1.0100 ms"), "{text}");
    assert_eq!(warned(&|_| ()), "");
    // What it makes of a sound arm is rotor inertia on five joints.
    for (change, told) in [(&faster as &dyn Fn(&mut Log), true), (&|_: &mut Log| (), false)] {
        let logs = case_with(&case, folder.path(), |_, log| change(log));
        let output = rivet().arg("diagnose").arg(case.join("robot.toml")).args(logs).output().expect("it starts");
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        let (clock, next) =
            (text.contains("the clock is off: by column t"), text.contains("Correct the clock of the logs"));
        assert_eq!((clock, next), (told, told), "{text}");
    }
}

/// A channel that dies or repeats its last value for three seconds ruins no value.
#[test]
fn torque_that_freezes_in_motion_is_named_and_left_out() {
    let Some(path) = shared("data/real/ur10e_innopolis/20_02_19_14harm50sec.parquet") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let log = sound("ur10e", &path);
    let found = |value: Option<f64>| {
        let mut tau = log.torque().expect("torque").clone();
        if let Some(value) = value {
            tau[1][1800..2100].fill(value);
        }
        let path = written(&log, &tau, folder.path());
        result(rivet().arg("identify").arg(robot("ur10e")).arg(path), folder.path()).1
    };
    let sound = found(None);
    for value in [0.0, log.torque().expect("torque")[1][1800]] {
        let frozen = found(Some(value));
        let warnings = frozen["warnings"].as_array().expect("a list");
        let said: Vec<_> = warnings.iter().filter(|w| w["fault"] == "torque_stood").collect();
        assert!(said.len() == 1 && said[0]["joint"] == "shoulder_lift_joint", "{warnings:?}");
        assert!(said[0]["text"].as_str().expect("words").contains("300 of 5375 rows excluded"), "{warnings:?}");
        let number = |p: &serde_json::Value, key: &str| p[key].as_f64().expect("a number");
        let parameters = |of: &serde_json::Value| of["parameters"].as_array().expect("a list").clone();
        for (a, b) in parameters(&sound).iter().zip(&parameters(&frozen)) {
            // With those rows j2.offset is off by 5 and by 9.
            assert!((number(a, "value") - number(b, "value")).abs() < 1.5 * number(a, "std"), "{a} {b}");
        }
    }
    assert!(!sound["warnings"].to_string().contains("torque_stood"), "{}", sound["warnings"]);
}

/// Nothing is wrong with the arm: a position of the wrong sign is told as one, and nothing is named. A torque of the wrong sign is
/// still a torque.
#[test]
fn a_position_of_the_wrong_sign_is_told_from_a_torque_and_spoils_all() {
    let Some(practice) = shared("data/practice") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    // The first also where its torque does not run against its motion: gravity hides friction.
    for (case, j) in [("case-24", 1), ("case-24", 2), ("case-16", 2)] {
        let case = practice.join(case);
        let logs = case_with(&case, folder.path(), |_, log| log.q[j].iter_mut().for_each(|q| *q = -*q));
        let (found, text) = judged(&case.join("robot.toml"), &logs, folder.path());
        assert!(found["verdict"] == "not_evaluated" && text.contains("the position has the wrong sign"), "{text}");
        assert!(found["causes"].as_array().expect("causes").is_empty(), "{found:#}");
        let faults: Vec<_> =
            found["log"].as_array().expect("findings").iter().filter(|f| f["fault"] == "position_sign").collect();
        assert_eq!(faults.len(), 2, "{found:#}");
    }
    let case = practice.join("case-24");
    let logs = case_with(&case, folder.path(), |_, log| {
        if let Some((_, tau)) = &mut log.tau {
            tau[2].iter_mut().for_each(|t| *t = -*t);
        }
    });
    let (found, _) = judged(&case.join("robot.toml"), &logs, folder.path());
    for finding in found["log"].as_array().expect("findings") {
        let text = finding["text"].as_str().expect("words");
        // How the log has to be read stands beside it, and is the same.
        let is_reading = finding["fault"] == "log_reading" && text.contains("tau3 (elbow_joint) with the other sign");
        let is_sign = finding["fault"] == "torque_sign" && text.contains("or of this position");
        assert!(is_reading || is_sign, "{finding:#}");
    }
}

/// A load that one run has and the other has not is no effect that one of them could tell: it is said that something changed.
#[test]
fn what_changed_between_the_runs_is_said_to_have() {
    let Some(case) = shared("data/practice/case-24") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let robot = rivet_config::load(case.join("robot.toml")).expect("a sound robot file");
    let arm = &robot.model.arm;
    // 6 kg at 0.1 m, of the size of a hand.
    let (mass, at) = (6.0, 0.1);
    let mut links = arm.links.clone();
    let flange = links.last_mut().expect("a flange");
    for (parameter, more) in [(0, mass), (3, mass * at), (4, mass * at * at), (7, mass * at * at)] {
        flange[parameter] += more;
    }
    let load = |log: &mut Log| {
        let [q, qd, qdd] = [&log.q_des, &log.qd_des, &log.qdd_des].map(|s| s.clone().expect("a desired motion"));
        let mut ws = rivet_dynamics::Workspace::new(arm);
        let (mut with, mut without) = (vec![0.0; 6], vec![0.0; 6]);
        let (_, tau) = log.tau.as_mut().expect("torque");
        for k in 0..log.t.len() {
            let [q, qd, qdd] = [&q, &qd, &qdd].map(|s| s.iter().map(|s| s[k]).collect::<Vec<f64>>());
            rivet_dynamics::inverse_dynamics(arm, &links, &mut ws, &q, &qd, &qdd, &mut with);
            rivet_dynamics::inverse_dynamics(arm, &arm.links, &mut ws, &q, &qd, &qdd, &mut without);
            tau.iter_mut().zip(with.iter().zip(&without)).for_each(|(tau, (with, without))| tau[k] += with - without);
        }
    };
    for (loaded, between, said) in [
        (1, "sealed_differs", "Something changed between the logs"),
        (0, "sealed_as_given", "The nominal model fits the held-out log to its noise"),
    ] {
        let logs = case_with(&case, folder.path(), |which, log| {
            if which == loaded {
                load(log);
            }
        });
        let (found, text) = judged(&case.join("robot.toml"), &logs, folder.path());
        assert_eq!(found["verdict"], "unexplained", "{text}");
        assert!(found["between_runs"] == between && text.contains(said), "{} {text}", found["between_runs"]);
    }
}

/// N m in one log and mN m in the other, of an arm with a spring: by its shape the torque of that joint is not the model's, but no spring makes
/// it a thousand times what it was. Half of the torque in the sealed run, of an arm with a load, is told once the load is known. Where the file
/// has friction wrong, none of a joint is told that is so in the sealed run, whose torque drives no simulator.
#[test]
fn torque_in_another_unit_than_in_the_other_run_is_told() {
    let Some(data) = shared("data") else { return };
    let [spring, load, friction] =
        ["practice/case-16", "practice/case-09", "practice-wrong-nominal/case-06"].map(|case| data.join(case));
    let folder = tempfile::tempdir().expect("a folder");
    let strange = |found: &serde_json::Value| -> Vec<String> {
        let log = found["log"].as_array().expect("findings").iter();
        log.filter(|f| f["fault"] == "torque_scale").map(|f| format!("{} {}", f["run"], f["joint"])).collect()
    };
    let scaled = |case: &Path, joint: Option<usize>, run: usize, scale: f64| {
        let logs = case_with(case, folder.path(), |which, log| {
            let (_, tau) = log.tau.as_mut().expect("torque");
            let own = tau.iter_mut().enumerate().filter(|(j, _)| which == run && joint.is_none_or(|joint| joint == *j));
            own.flat_map(|(_, tau)| tau).for_each(|t| *t *= scale);
        });
        judged(&case.join("robot.toml"), &logs, folder.path())
    };
    let (found, text) = scaled(&spring, None, 0, 1000.0);
    assert_eq!((&found["verdict"], strange(&found).len()), (&"not_evaluated".into(), 6), "{text}");
    let (found, text) = scaled(&spring, Some(2), 1, 1000.0);
    assert_eq!(strange(&found), ["\"log-b.parquet\" \"joint_3\""], "{text}");
    let (found, text) = scaled(&load, Some(1), 1, 0.5);
    assert_eq!(strange(&found), ["\"log-b.parquet\" \"shoulder_lift_joint\""], "{text}");
    assert_eq!(found["between_runs"], "sealed_differs", "{text}");
    let (found, text) = scaled(&friction, Some(1), 1, 1000.0);
    let causes = found["causes"].as_array().expect("causes").iter();
    let drives: Vec<_> = causes.filter(|c| c["effect"].as_str().is_some_and(|e| e.ends_with("_friction"))).collect();
    assert!(!drives.is_empty(), "{text}");
    for cause in drives {
        let sizes = cause["magnitude"].as_object().expect("sizes").keys();
        assert!(!cause["joints"].as_array().expect("joints").contains(&"joint_2".into()), "{cause:#}");
        assert!(sizes.clone().count() > 0 && sizes.into_iter().all(|name| !name.starts_with("j2.")), "{cause:#}");
    }
    assert_eq!(found["rollout"]["points"], serde_json::json!([]), "{text}");
    assert!(text.contains("the log cannot drive a simulator"), "{text}");
}

/// What no arm gives is left out or taken back, and said; what is identified stays as it was.
#[test]
fn glitches_of_a_log_do_not_reach_the_fit() {
    let Some(log) = shared("data/real/ur10e_innopolis/20_02_10-20sec_7harm.parquet") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let json = folder.path().join("result.json");
    let sound = sound("ur10e", &log);
    let joints = &rivet_config::load(robot("ur10e")).expect("a sound robot file").model.arm.joints;
    let glitched = |change: &dyn Fn(&mut Log, &mut [Vec<f64>])| {
        let (mut log, mut tau) = (sound.clone(), sound.torque().expect("torque").clone());
        change(&mut log, &mut tau);
        written(&log, &tau, folder.path())
    };
    let found = |change: &dyn Fn(&mut Log, &mut [Vec<f64>])| {
        let path = glitched(change);
        let (code, text) = said(rivet().arg("identify").arg(robot("ur10e")).arg(path).arg("--json").arg(&json));
        assert_eq!(code, Some(0), "{text}");
        let result: serde_json::Value =
            serde_json::from_slice(&std::fs::read(&json).expect("a result")).expect("sound JSON");
        let warnings = result["warnings"].as_array().expect("a list").clone();
        assert_eq!(text.matches("warning: ").count(), warnings.len(), "{text}");
        let left: Vec<f64> = result["joints"]
            .as_array()
            .expect("a list")
            .iter()
            .map(|joint| joint["residual_percent"]["instrumental"].as_f64().expect("a number"))
            .collect();
        let word = |w: &serde_json::Value, key: &str| w[key].as_str().expect("a word").to_owned();
        let warnings: Vec<[String; 3]> =
            warnings.iter().map(|w| ["joint", "fault", "text"].map(|k| word(w, k))).collect();
        (warnings, left)
    };
    let (none, as_measured) = found(&|_, _| {});
    assert!(none.is_empty(), "{none:?}");
    let half = sound.len() / 2;
    let wrap =
        |log: &mut Log, _: &mut [Vec<f64>]| log.q[2][half..].iter_mut().for_each(|q| *q += std::f64::consts::TAU);
    let spike = |log: &mut Log, _: &mut [Vec<f64>]| log.q[1][half] += 1.0;
    let away = |log: &mut Log, _: &mut [Vec<f64>]| log.q[1][half..half + 20].iter_mut().for_each(|q| *q += 0.6);
    let torque = |_: &mut Log, tau: &mut [Vec<f64>]| tau[1][half] = 1e7;
    let one = format!("1 of {} rows", sound.len());
    let twenty = format!("20 of {} rows", sound.len());
    type Change<'a> = &'a dyn Fn(&mut Log, &mut [Vec<f64>]);
    let cases: [(Change<'_>, usize, &str, &str); 4] = [
        (&wrap, 2, "position_wrapped", "unwrapped"),
        (&spike, 1, "position_jump", &one),
        (&away, 1, "position_jump", &twenty),
        (&torque, 1, "torque_beyond_limit", &one),
    ];
    for (change, j, fault, says) in cases {
        let (warnings, left) = found(change);
        let [[joint, name, text]] = &warnings[..] else { panic!("{fault}: {warnings:?}") };
        assert_eq!((joint, &name[..]), (&joints[j].name, fault));
        assert!(text.contains(says), "{text}");
        for (left, before) in left.iter().zip(&as_measured) {
            assert!((left - before).abs() < 0.5, "{fault}: {left} % left, {before} % of the log as it was measured");
        }
    }
    let path = glitched(&|log, _| log.q[0][half..].iter_mut().for_each(|q| *q += 0.5));
    let (code, text) = said(rivet().arg("identify").arg(robot("ur10e")).arg(path));
    assert!(code == Some(65) && text.contains("cannot be true, more than a tenth"), "{code:?} {text}");
}

/// A source at a fourth of the log's rate: positions are drawn through its samples, and it is said; standstill, other joints and a log
/// without stairs are left as they are.
#[test]
fn positions_that_are_held_over_rows_are_drawn_anew_and_said() {
    let Some(log) = shared("data/real/ur10e_innopolis/20_02_10-30sec_12harm.parquet") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let held = std::cell::RefCell::new(Vec::new());
    let stairs = changed("ur10e", &log, folder.path(), |row, _, q| {
        let mut held = held.borrow_mut();
        if row % 4 == 0 {
            *held = q.to_vec();
        }
        q.copy_from_slice(&held);
    });
    let identified = |log: &Path| {
        let json = folder.path().join("found.json");
        let (code, text) = said(rivet().arg("identify").arg(robot("ur10e")).arg(log).arg("--json").arg(&json));
        assert_eq!(code, Some(0), "{text}");
        let found: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(&json).expect("readable")).expect("json");
        let percent = |joint: &serde_json::Value| joint["residual_percent"]["instrumental"].as_f64().expect("a number");
        let percent: Vec<f64> = found["joints"].as_array().expect("joints").iter().map(percent).collect();
        (percent, text)
    };
    let (sound, text) = identified(&log);
    assert!(!text.contains("are held"), "{text}");
    let (found, text) = identified(&stairs);
    println!("{sound:.1?} {found:.1?}");
    assert!(text.contains("positions are held") && text.contains("stairs are 4 rows long"), "{text}");
    for (found, sound) in found.iter().zip(&sound) {
        assert!(found < &(2.0 * sound), "{found} % after {sound} %");
    }
}

/// What cannot be written or is not there is told before anything is computed.
#[test]
fn what_cannot_end_well_is_refused_at_the_start() {
    let folder = tempfile::tempdir().expect("a folder");
    let (code, text) = said(rivet().args(["figures", "--out", "/nonexistent/x.html"]));
    assert!(code != Some(0) && text.contains("/nonexistent/x.html") && !text.contains("Figure"), "{code:?} {text}");
    for study in ["real", "withheld"] {
        let (code, text) = said(rivet().args(["study", study]).current_dir(folder.path()));
        assert!(code == Some(64) && text.contains("--root DIR") && !text.contains(" % "), "{code:?} {text}");
    }
    let page = folder.path().join("figures.html");
    let Some(log) = shared("data/real/kuka_kr300/traj_A_10s.parquet") else { return };
    for option in ["--json", "--stream"] {
        let mut command = rivet();
        command.arg("identify").arg(robot("kuka-kr300-r2500")).arg(&log).args([option, "/nonexistent/x"]);
        let (code, text) = said(if option == "--stream" { command.arg("--online") } else { &mut command });
        assert!(code == Some(74) && text.contains("/nonexistent/x: ") && !text.contains("joints"), "{code:?} {text}");
    }
    // A disk that is full is one that cannot be written to, whatever is meant to be in the file.
    let mut command = rivet();
    let (code, text) =
        said(command.arg("predict").arg(robot("kuka-kr300-r2500")).arg(&log).args(["--out", "/dev/full"]));
    assert!(
        code == Some(74) && text.contains("/dev/full: No space left") && !text.contains("Parquet"),
        "{code:?} {text}"
    );
    let (code, text) = said(rivet().args(["figures", "12", "12", "--out"]).arg(&page));
    assert!(code == Some(0) && text.matches("Figure 12").count() == 1, "{code:?} {text}");
    assert_eq!(std::fs::read_dir(folder.path()).expect("readable").count(), 1, "the page alone");
}
