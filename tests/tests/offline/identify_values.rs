//! What `rivet identify` finds of a sound arm where it is easily led astray: a file that says zero, a short record, noisy positions. And
//! what it says of logs that it compares, and of a choice.

use std::path::{Path, PathBuf};
use std::process::Command;

use rivet_logs::{Log, ReadOptions, read};
use rivet_tests::altered::{Random, result, said, with_torque_times, written};
use rivet_tests::{rivet, robot, shared};
use serde_json::Value;

/// A sound arm of another program, whose robot file has the true values, and its first log.
fn sound() -> Option<(PathBuf, Log)> {
    let case = shared("data/practice/case-24")?;
    let log = read(case.join("log-a.parquet"), &ReadOptions::new(6)).expect("a log");
    Some((case, log))
}

/// The folder of the same arm with another line of Coulomb friction and something more in its file.
fn arm_with(case: &Path, coulomb: &str, more: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let text = std::fs::read_to_string(case.join("robot.toml")).expect("a robot file");
    let friction = text.lines().find(|line| line.starts_with("coulomb")).expect("it has friction");
    let text = text.replace(friction, if coulomb.is_empty() { friction } else { coulomb });
    std::fs::write(folder.path().join("robot.toml"), text + more).expect("written");
    std::fs::copy(case.join("robot.urdf"), folder.path().join("robot.urdf")).expect("copied");
    folder
}

const WITHOUT: &str = "coulomb = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]";

fn identify(robot: &Path, log: &Log, folder: &Path) -> Command {
    let mut command = rivet();
    let log = written(log, log.torque().expect("torque"), folder);
    command.arg("identify").arg(robot.join("robot.toml")).arg(log);
    command
}

/// Coulomb friction that `log` tells of an arm whose file has none, `[value, std, truth]`.
fn friction_found(case: &Path, log: &Log) -> Vec<[f64; 3]> {
    let without = arm_with(case, WITHOUT, "");
    let [truth, found] = [case, without.path()].map(|robot| {
        let (_, found) = result(&mut identify(robot, log, without.path()), without.path());
        parameters(&found, ".coulomb")
    });
    let both = found.into_iter().zip(truth).map(|([value, std, _], [_, _, truth])| [value, std, truth]);
    both.inspect(|[value, std, truth]| println!("Coulomb friction {value} +- {std} for {truth}")).collect()
}

/// What identification leaves of the torque of the other log \[%\], nominal and exported set, joint by joint.
fn held_out(found: &Value) -> Vec<[f64; 2]> {
    let held = &found["held_out"][0];
    let exported = if found["exported"] == "consistent" { "consistent_percent" } else { "identified_percent" };
    let [nominal, identified] = ["nominal_percent", exported].map(|of| held[of].as_array().expect("a list"));
    let number = |x: &Value| x.as_f64().expect("a number");
    nominal.iter().zip(identified).map(|(a, b)| [number(a), number(b)]).collect()
}

/// `[value, std, truth]` of the parameters whose names end so.
fn parameters(found: &Value, end: &str) -> Vec<[f64; 3]> {
    let number = |p: &Value, of: &str| p[of].as_f64().expect("a number");
    let all = found["parameters"].as_array().expect("a list").iter();
    let these = all.filter(|p| p["name"].as_str().is_some_and(|name| name.ends_with(end)));
    these.map(|p| [number(p, "value"), number(p, "std"), number(p, "nominal")]).collect()
}

fn names(found: &Value) -> impl Iterator<Item = &str> {
    found["parameters"].as_array().expect("a list").iter().filter_map(|p| p["name"].as_str())
}

/// The prior holds a zero near zero, that leaves a slow residual, which counts for little: the prior had the last word, with small
/// deviations (j5.coulomb 0.27 +- 0.34 for 3.1, an offset of 1.5 N m as 0.17 +- 0.32).
#[test]
fn what_the_file_has_as_zero_is_found() {
    let Some((case, mut log)) = sound() else { return };
    for [value, std, truth] in friction_found(&case, &log) {
        assert!((value - truth).abs() < (4.0 * std).max(0.01 * truth) && std < 0.02 * truth, "{value} {std} {truth}");
    }
    let with_offsets = arm_with(&case, "", "\n[estimator]\noffsets = true\n");
    if let Some((_, tau)) = &mut log.tau {
        tau[5].iter_mut().for_each(|tau| *tau += 1.5);
    }
    let folder = with_offsets.path();
    let (_, found) = result(&mut identify(folder, &log, folder), folder);
    let [value, std, _] = parameters(&found, "j6.offset")[0];
    assert!((value - 1.5).abs() < 4.0 * std && std < 0.05, "{value} {std}");
}

/// On a few seconds the prior of a zero was stronger than they are (1.6 +- 1.7 for 30.1).
#[test]
fn a_short_record_tells_friction_that_the_file_has_not() {
    let Some(case) = shared("data/practice/case-18") else { return };
    let log = read(case.join("log-a.parquet"), &ReadOptions::new(6)).expect("a log").slice(3000..7000);
    for [value, std, truth] in friction_found(&case, &log) {
        assert!((value - truth).abs() < (4.0 * std).max(0.01 * truth) && std < 0.03 * truth, "{value} {std} {truth}");
    }
}

/// What half a second holds a fit of all values follows: residuals of next to nothing and deviations that are far too small.
#[test]
fn a_motion_shorter_than_its_values_need_is_said() {
    let Some((case, log)) = sound() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    for (rows, little) in [(400, true), (4000, false)] {
        let (text, _) = result(&mut identify(&case, &log.slice(3000..3000 + rows), folder.path()), folder.path());
        assert_eq!(text.contains("independent equations"), little, "{text}");
    }
}

/// A short record has slow stretches beside fast ones: the lag was where the fast ones are (up to 218 ms for 1).
#[test]
fn the_lag_of_a_short_record_is_no_louder_stretch() {
    let Some((case, log)) = sound() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let short = log.slice(3000..6000);
    let mut command = identify(&case, &short, folder.path());
    let (text, found) = result(command.arg("--hold-out").arg(case.join("log-b.parquet")), folder.path());
    let lags = found["logs"][0]["instruments"]["lag_s"].as_array().expect("a list");
    assert!(lags.iter().all(|lag| lag.as_f64().is_some_and(|lag| lag.abs() < 2e-3)), "{lags:?}");
    assert!(held_out(&found).iter().all(|[nominal, identified]| identified < &(nominal + 2.0)), "{found}");
    let rms = |key: &str| {
        let of = found["held_out"][0][key].as_array().expect("one a joint").iter();
        (of.map(|p| p.as_f64().expect("a number").powi(2)).sum::<f64>() / 6.0).sqrt()
    };
    let cost = found["held_out"][0]["consistent_cost_points"].as_f64().expect("a number");
    assert!((rms("consistent_percent") - rms("identified_percent") - cost).abs() < 1e-9 && cost != 0.0, "{found}");
    assert!(text.contains("what can be built misses"), "{text}");
    // Three seconds say of no delay whether it is one.
    assert!(text.contains("too short a motion") && !text.contains("warning: torque is"), "{text}");
    // One second, of which each joint makes a part of one move.
    for first in [1000, 3000, 5000, 7000, 9000] {
        let (text, found) = result(&mut identify(&case, &log.slice(first..first + 1000), folder.path()), folder.path());
        let lags = found["logs"][0]["instruments"]["lag_s"].as_array().expect("a list");
        assert!(lags.iter().all(|lag| lag.as_f64().is_some_and(|lag| lag.abs() < 5e-3)), "{first}: {lags:?}");
        let untold = text.contains("this motion does not determine it")
            || text.contains("this motion determines it for no joint");
        assert!(untold, "{text}");
        assert!(!text.contains("q does not follow q_des") && !text.contains("warning: torque is"), "{text}");
    }
}

/// A tenth of a milliradian at 1 kHz leaves speeds without a direction: held-out errors of 13 to 35 % for 2 to 7, Coulomb friction of
/// 185 +- 19 for 105.
#[test]
fn noisy_positions_are_smoothed_and_said() {
    let Some((_, log)) = sound() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let mut random = Random(1);
    for case in ["case-24", "case-18"] {
        let Some(case) = shared("data/practice").map(|folder| folder.join(case)) else { return };
        let mut noisy = read(case.join("log-a.parquet"), &ReadOptions::new(6)).expect("a log");
        for q in noisy.q.iter_mut().flatten() {
            *q += 1e-4 * random.normal();
        }
        let mut command = identify(&case, &noisy, folder.path());
        let (text, found) = result(command.arg("--hold-out").arg(case.join("log-b.parquet")), folder.path());
        assert!(text.contains("positions are noisy by 1e-4 rad (one std)"), "{text}");
        assert!(held_out(&found).iter().all(|[nominal, identified]| identified < &(1.2 * nominal + 0.2)), "{found}");
        for [value, std, truth] in parameters(&found, ".coulomb") {
            assert!((value - truth).abs() < (3.0 * std).max(0.01 * truth), "{value} {std} {truth}");
        }
    }
    let (_, text) = said(&mut identify(&shared("data/practice/case-24").expect("as above"), &log, folder.path()));
    assert!(!text.contains("noisy"), "{text}");
}

/// Every 50th row of 1 kHz leaves 10 to 33 % where all rows leave 1: the model filter lets through what the rows cannot tell.
#[test]
fn rows_too_far_apart_for_the_filter_are_said() {
    let Some((case, log)) = sound() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    // Without the key the filter follows the rate.
    let case = arm_with(&case, "", "\n[signal]\nmodel_filter_hz = 20.0\n");
    let case = case.path();
    for (every, told) in [(50, true), (10, false)] {
        let thin = |x: &[f64]| x.iter().step_by(every).copied().collect::<Vec<f64>>();
        let mut thinned = Log { t: thin(&log.t), q_des: None, qd_des: None, ..log.slice(0..1) };
        thinned.q = log.q.iter().map(|q| thin(q)).collect();
        thinned.tau = log.tau.as_ref().map(|(of, tau)| (*of, tau.iter().map(|tau| thin(tau)).collect()));
        let (_, text) = said(&mut identify(case, &thinned, folder.path()));
        assert_eq!(text.contains("differences of theirs are wrong by a third"), told, "{text}");
    }
}

/// Two logs agree in what is wrong with both: that is told as it is of one.
#[test]
fn logs_that_are_compared_are_looked_at_as_one_would_be() {
    let Some([first, second]) = ["20_02_10-20sec_7harm", "20_02_10-30sec_12harm"]
        .map(|name| shared(&format!("data/real/ur10e_innopolis/{name}.parquet")))
        .into_iter()
        .collect::<Option<Vec<PathBuf>>>()
        .map(|logs| <[PathBuf; 2]>::try_from(logs).expect("two"))
    else {
        return;
    };
    let folders = [(); 2].map(|()| tempfile::tempdir().expect("a folder"));
    let turned =
        |log: &Path, folder: &Path| with_torque_times("ur10e", log, folder, |j| if j == 2 { -1.0 } else { 1.0 });
    let [a, b] = [turned(&first, folders[0].path()), turned(&second, folders[1].path())];
    let compare = |logs: [&PathBuf; 2]| {
        let mut command = rivet();
        command.args(["identify", "--compare"]).arg(robot("ur10e")).args(logs);
        result(&mut command, folders[0].path())
    };
    let (text, found) = compare([&a, &b]);
    assert_eq!(text.matches("elbow_joint: torque").count(), 2, "{text}");
    for run in found["runs"].as_array().expect("a list") {
        let warnings = run["warnings"].as_array().expect("a list");
        assert_eq!(warnings.iter().filter(|w| w["fault"] == "torque_sign").count(), 1, "{run}");
    }
    let (text, _) = compare([&first, &second]);
    assert!(!text.contains("warning: "), "{text}");
}

/// Values of friction belong to a law: the result says to which, and what else was tried.
#[test]
fn a_choice_is_in_the_result() {
    let Some(log) = shared("data/real/ur10e_innopolis/20_02_10-20sec_7harm.parquet") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let command = |refine: bool| {
        let mut command = rivet();
        command.arg("identify").arg(robot("ur10e")).arg(&log).args(refine.then_some("--refine"));
        result(&mut command, folder.path()).1
    };
    let (plain, refined) = (command(false), command(true));
    assert!(plain["refined"].is_null() && plain["friction_law"]["friction_velocity"].is_number(), "{plain}");
    let tried = refined["refined"].as_array().expect("a list");
    let chosen: Vec<&Value> = tried.iter().filter(|tried| tried["chosen"] == true).collect();
    let least = tried.iter().filter_map(|tried| tried["left_out_percent"].as_f64()).fold(f64::INFINITY, f64::min);
    assert!(tried.len() > 10 && !chosen.is_empty(), "{tried:?}");
    for chosen in chosen {
        assert_eq!(chosen["friction_law"], refined["friction_law"]);
        assert_eq!(chosen["estimator"], refined["estimator"]);
        assert!(chosen["left_out_percent"].as_f64().is_some_and(|left| left < 1.03 * least), "{chosen}");
    }
}

/// Six digits are steps of a millionth, finer than the noise that is written with them; and a held-out log may be as noisy.
#[test]
fn noise_is_seen_behind_the_digits_it_is_written_with() {
    let Some((case, mut log)) = sound() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let mut random = Random(1);
    for q in log.q.iter_mut().flatten() {
        *q = ((*q + 1e-4 * random.normal()) * 1e6).round() / 1e6;
    }
    let mut command = identify(&case, &log, folder.path());
    let (text, found) = result(command.arg("--hold-out").arg(case.join("log-b.parquet")), folder.path());
    assert!(text.contains("positions are noisy by 1e-4 rad (one std)"), "{text}");
    assert!(held_out(&found).iter().all(|[nominal, identified]| identified < &(1.2 * nominal + 0.2)), "{found}");
    let mut command = rivet();
    command.arg("identify").arg(case.join("robot.toml")).arg(case.join("log-b.parquet"));
    let (text, found) = result(
        command.arg("--hold-out").arg(written(&log, log.torque().expect("torque"), folder.path())),
        folder.path(),
    );
    assert!(text.contains("changed.parquet, ") && text.contains("positions are noisy"), "{text}");
    // 86 % where noise near standstill counted against the true friction.
    assert!(held_out(&found).iter().all(|[nominal, identified]| nominal.max(*identified) < 12.0), "{found}");
}

/// Rounding to steps that noise does not blur is no noise; to finer steps it is.
#[test]
fn torque_in_steps_that_noise_does_not_blur_is_said() {
    let Some((case, log)) = sound() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let told = |step: f64| -> Vec<String> {
        let mut log = log.clone();
        if let Some((_, tau)) = &mut log.tau {
            tau[3..].iter_mut().flatten().for_each(|tau| *tau = step * (*tau / step).round());
        }
        let (_, found) = result(&mut identify(&case, &log, folder.path()), folder.path());
        let warnings = found["warnings"].as_array().expect("a list").iter();
        let coarse = warnings.filter(|w| w["fault"] == "torque_coarse");
        coarse.map(|w| format!("{} {}", w["joint"].as_str().expect("a joint"), w["text"])).collect()
    };
    assert_eq!([told(1e-3), told(0.1)], [Vec::<String>::new(), Vec::new()]);
    let said = told(4.0);
    let joint = |(said, name): (&String, &str)| said.starts_with(name) && said.contains("steps of 4.0 N m");
    let names = ["wrist_1_joint", "wrist_2_joint", "wrist_3_joint"];
    assert!(said.len() == 3 && said.iter().zip(names).all(joint), "{said:?}");
}

/// Of a sound log what sets least squares and instruments apart may be surely more than chance and still not matter.
#[test]
fn methods_that_agree_for_use_are_said_to() {
    let Some((case, log)) = sound() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let (text, found) = result(&mut identify(&case, &log, folder.path()), folder.path());
    let bias = &found["bias"];
    assert!(bias["p_value"].as_f64().is_some_and(|p| p < 0.01), "significant, or this shows nothing: {bias}");
    assert!(bias["verdict"] == "agree_for_use" && text.contains("LS and IV agree for use"), "{bias} {text}");
    assert!(!text.contains("the model lacks an effect"), "{text}");
}

/// Bodies take up the zero of a torque signal as far as poses let them, with deviations that say nothing of it.
#[test]
fn a_constant_torque_that_the_model_has_not_is_said() {
    let Some((case, mut log)) = sound() else { return };
    let without = arm_with(&case, "", "\n[estimator]\noffsets = false\n");
    let folder = without.path();
    let told = |log: &Log, robot: &Path| -> Vec<(String, String)> {
        let (_, found) = result(&mut identify(robot, log, folder), folder);
        let warnings = found["warnings"].as_array().expect("a list").iter();
        let constant = warnings.filter(|w| w["fault"] == "constant_torque");
        let text = |x: &Value| x.as_str().expect("words").to_owned();
        constant.map(|w| (text(&w["joint"]), text(&w["text"]))).collect()
    };
    assert_eq!(told(&log, folder), []);
    if let Some((_, tau)) = &mut log.tau {
        tau[2].iter_mut().for_each(|tau| *tau -= 3.0);
    }
    let said = told(&log, folder);
    println!("{said:?}");
    let [(joint, text)] = &said[..] else { panic!("{said:?}") };
    let size: f64 =
        text.split('(').nth(1).and_then(|t| t.split(' ').next()).and_then(|t| t.parse().ok()).expect("its size");
    assert!(joint == "elbow_joint" && (size + 3.0).abs() < 0.3 && text.contains("offsets = true"), "{said:?}");
    let with = arm_with(&case, "", "\n[estimator]\noffsets = true\n");
    assert_eq!(told(&log, with.path()), []);
}

/// A push of an arm at rest: two rows are explained by anything, which came out with values of up to 1e18.
#[test]
fn a_log_in_which_next_to_nothing_moves_is_refused() {
    let Some(log) = shared("data/real/ur10e_innopolis/20_01_22-push_pose_1.parquet") else { return };
    let (code, text) = said(rivet().arg("identify").arg(robot("ur10e")).arg(log));
    assert!(code == Some(65) && text.contains("2 rows of torque in motion for 58 parameters"), "{code:?} {text}");
}

/// Where one joint moves, most columns are next to nothing: the values that make them as large as the torque are those of no body (up to
/// 7e4 kg m2, decided by the data).
#[test]
fn what_one_joint_does_not_tell_is_of_a_body_that_can_be() {
    for joint in [1, 4] {
        let Some(log) = shared(&format!("data/real/ur10e_innopolis/20_01_22-joint_{joint}.parquet")) else { return };
        let folder = tempfile::tempdir().expect("a folder");
        let (_, found) = result(rivet().arg("identify").arg(robot("ur10e")).arg(log), folder.path());
        for (name, [value, std, nominal]) in names(&found).zip(parameters(&found, "")) {
            let of_body = name.starts_with('l');
            assert!(!of_body || (value - nominal).abs() < 1e3 && std < 1e6, "{name} {value} +- {std} for {nominal}");
        }
    }
}
