//! What `rivet identify` says of its own result: what was not used, held, not explained, or is late.

use std::path::Path;

use rivet_logs::{Log, ReadOptions, read};
use rivet_tests::altered::{Random, changed, result, robot_with, said, sound, written};
use rivet_tests::{rivet, robot, shared};
use serde_json::Value;

#[test]
fn a_robot_file_that_asks_for_instruments_the_log_has_not_is_told_that_nothing_is_learnt() {
    let Some(log) = shared("data/real/staubli_tx40/exciting_0.0-5.5s.parquet") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let source = robot("staubli-tx40");
    let text = std::fs::read_to_string(&source).expect("readable");
    for entry in std::fs::read_dir(source.parent().expect("a folder")).expect("readable") {
        let path = entry.expect("an entry").path();
        std::fs::copy(&path, folder.path().join(path.file_name().expect("a name"))).expect("copied");
    }
    let file = folder.path().join("robot.toml");
    for (instruments, needs) in [("setpoint", "needs q_des of"), ("second-encoder", "needs q_link of"), ("auto", "")] {
        let asked = text.replace("[estimator]", &format!("[estimator]\ninstruments = \"{instruments}\""));
        assert_ne!(asked, text);
        std::fs::write(&file, asked).expect("written");
        let (code, said) = said(rivet().args(["identify", "--online"]).arg(&file).arg(&log));
        assert_eq!(code, Some(0), "{said}");
        if needs.is_empty() {
            assert!(!said.contains("nothing is learnt") && said.contains("instruments: delayed"), "{said}");
        } else {
            assert!(said.contains("none: nothing is learnt from this log"), "{said}");
            assert!(said.contains(needs) && said.contains("\"auto\""), "{said}");
        }
    }
}

/// Columns of a setpoint that was not recorded are no instrument; what is left of the test of bias when they are forced on it is
/// not taken for its word.
#[test]
fn a_desired_motion_that_was_not_recorded_is_no_instrument() {
    let Some(path) = shared("data/real/ur10e_innopolis/20_02_10-30sec_12harm.parquet") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let json = folder.path().join("result.json");
    let mut log = sound("ur10e", &path);
    log.q_des = Some(vec![vec![0.0; log.len()]; 6]);
    let tau = log.torque().expect("torque").clone();
    let zero = written(&log, &tau, folder.path());
    let result = |file: &Path| -> (String, serde_json::Value) {
        let (code, text) = said(rivet().arg("identify").arg(file).arg(&zero).arg("--json").arg(&json));
        assert_eq!(code, Some(0), "{text}");
        let result = serde_json::from_slice(&std::fs::read(&json).expect("a result")).expect("sound JSON");
        (text, result)
    };
    let (text, found) = result(&robot("ur10e"));
    assert!(text.contains("q does not follow q_des") && text.contains("not followed: delayed instruments"), "{text}");
    assert_eq!(found["logs"][0]["instruments"]["kind"], "delayed");
    let warnings = found["warnings"].as_array().expect("a list");
    assert_eq!(warnings.len(), 6, "{warnings:?}");
    assert!(warnings.iter().all(|w| w["fault"] == "desired_motion_not_followed"), "{warnings:?}");
    assert_eq!(found["bias"]["cannot_tell"], false);
    println!("delayed: IV {} times as uncertain as LS", found["bias"]["deviation_ratio"]);

    let file = robot_with("ur10e", folder.path(), "[estimator]", "[estimator]\ninstruments = \"setpoint\"");
    let (text, found) = result(&file);
    println!("zeros: IV {} times as uncertain as LS", found["bias"]["deviation_ratio"]);
    assert!(text.contains("as the robot file asks") && text.contains("cannot tell: IV is"), "{text}");
    assert!(!text.contains("no sign of bias"), "{text}");
    assert_eq!(found["bias"]["cannot_tell"], true);
}

/// What the robot file says of signals and instruments and what is done off line are told apart.
#[test]
fn off_line_says_what_it_does_not_take_from_the_robot_file() {
    let Some(log) = shared("data/real/ur10e_innopolis/20_02_10-20sec_7harm.parquet") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let words = |to: &str| {
        let file = robot_with("ur10e", folder.path(), "[estimator]", &format!("{to}\n[estimator]"));
        let (code, text) = said(rivet().arg("identify").arg(file).arg(&log));
        assert_eq!(code, Some(0), "{text}");
        text
    };
    let text = words("");
    assert!(text.contains("robot file's half_width = 25 acts on line only"), "{text}");
    // Delayed instruments are in use here, so delay_s is.
    assert!(text.contains("on line only estimator.window_s") && !text.contains("estimator.delay_s"), "{text}");
    let text = words("torque_noise = 1.0\n[supervision]\ntolerance = 0.3\nkind = \"eigen\"");
    for key in ["signal.torque_noise", "estimator.window_s", "supervision.tolerance"] {
        assert!(text.contains(key), "{key}: {text}");
    }
    assert!(!text.contains("supervision.kind"), "the default: {text}");
    let text = words("filtering = \"none\"");
    assert!(text.contains("half_width = 25 and filtering = \"none\" act on line only"), "{text}");
    let file = robot_with("ur10e", folder.path(), "[estimator]", "[estimator]\ninstruments = \"previous-cycle\"");
    let (_, text) = said(rivet().arg("identify").arg(&file).arg(&log));
    assert!(text.contains("off line no cycle is looked for: delayed instruments"), "{text}");
    let (_, text) = said(rivet().args(["identify", "--online"]).arg(&file).arg(&log));
    assert!(text.contains("previous cycle (the motion repeats)") || text.contains("no cycle is found"), "{text}");
}

#[test]
fn a_torque_that_is_late_is_warned_of_with_its_time() {
    let Some(path) = shared("data/real/staubli_tx40/exciting_0.0-5.5s.parquet") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let log = sound("staubli-tx40", &path);
    let late = |rows: usize| {
        let shift = |tau: &Vec<f64>| (0..tau.len()).map(|k| tau[k.saturating_sub(rows)]).collect();
        let tau: Vec<Vec<f64>> = log.torque().expect("torque").iter().map(shift).collect();
        let (code, text) =
            said(rivet().arg("identify").arg(robot("staubli-tx40")).arg(written(&log, &tau, folder.path())));
        assert_eq!(code, Some(0), "{text}");
        text
    };
    // 5 kHz.
    let text = late(50);
    let told = text.split("warning: torque is ").nth(1).expect("a warning");
    let ms: f64 = told.split(' ').next().and_then(|word| word.parse().ok()).expect("its time");
    assert!((8.0..12.0).contains(&ms) && told.contains("ms (one std) behind position on joint_1"), "{told}");
    assert!(!late(0).contains("warning: torque is"), "as it was measured");
}

/// Friction over torque carried is a share: where a joint carries next to nothing, the column would hold what the model lacks.
#[test]
fn friction_with_load_that_no_gear_has_is_held_at_zero_and_said() {
    let [Some(first), Some(second)] = ["20_02_10-30sec_12harm", "20_02_12-50sec_12harm"]
        .map(|name| shared(&format!("data/real/ur10e_innopolis/{name}.parquet")))
    else {
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let law = "[friction]\nload_dependent = 0.0\nviscous_quadratic = 0.0\npresliding_travel = 1e-4";
    let file = robot_with("ur10e", folder.path(), "[friction]", law);
    let out = folder.path().join("model");
    let (text, found) =
        result(rivet().arg("identify").arg(&file).args([&first, &second]).arg("--export").arg(&out), folder.path());
    let parameter = |name: &str| {
        let all = found["parameters"].as_array().expect("a list").iter();
        all.into_iter().find(|p| p["name"] == name).expect("a parameter").clone()
    };
    for j in 1..=6 {
        let load = parameter(&format!("j{j}.load_friction"));
        let value = load["value"].as_f64().expect("a number");
        println!("{load}");
        assert!((0.0..=1.0).contains(&value), "{load}");
        assert_eq!(load["decided_by"] == "bound", load["std"].is_null(), "{load}");
    }
    let wrist = parameter("j6.load_friction");
    assert!(wrist["value"] == 0.0 && wrist["decided_by"] == "bound", "{wrist}");
    assert!(text.contains("wrist_3_joint: friction with load was estimated as"), "{text}");
    assert!(found["warnings"].as_array().expect("a list").iter().any(|w| w["fault"] == "load_friction_impossible"));
    let exported = rivet_config::load(out.join("model.toml")).expect("the model reads back");
    let load = exported.config.friction.load_dependent.expect("a list");
    assert!(load[5].abs() < 1e-3 && load.iter().all(|share| (-1e-3..=1.0).contains(share)), "{load:?}");
}

/// Without instruments there is nothing to compare with, and nothing that is a copy.
#[test]
fn least_squares_on_line_has_nothing_to_compare() {
    let Some(log) = shared("data/real/ur10e_innopolis/20_02_10-20sec_7harm.parquet") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    for (kind, compares) in [("rls", false), ("riv", true)] {
        let file = robot_with("ur10e", folder.path(), "[estimator]", &format!("[estimator]\nkind = \"{kind}\""));
        let (text, found) = result(rivet().args(["identify", "--online"]).arg(&file).arg(&log), folder.path());
        assert_eq!(found["bias"].is_null(), !compares, "{found}");
        assert_eq!(text.contains("nothing to compare: least squares alone"), !compares, "{text}");
        assert!(!text.contains("is it a copy"), "{text}");
        if compares {
            let largest = &found["bias"]["largest_difference"];
            let size = largest["standard_deviations"].as_f64().expect("a number");
            assert!(text.contains(&format!("largest difference IV - LS: {size:.1} standard deviations")), "{text}");
        }
    }
}

/// Torque that has nothing to do with the motion decides parameters all the same: the fit says that it explains none of it.
#[test]
fn torque_that_the_model_does_not_explain_is_told() {
    let Some(log) = shared("data/real/ur10e_innopolis/20_02_10-20sec_7harm.parquet") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let log = sound("ur10e", &log);
    let mut random = Random(1);
    let mut tau = log.torque().expect("torque").clone();
    tau[1].iter_mut().for_each(|tau| *tau = 100.0 * random.uniform());
    tau[4].iter_mut().for_each(|tau| *tau = 20.0 * random.uniform());
    let path = written(&log, &tau, folder.path());
    let (text, found) = result(rivet().arg("identify").arg(robot("ur10e")).arg(&path), folder.path());
    assert!(text.contains("the model explains hardly anything of this torque"), "{text}");
    let warnings = found["warnings"].as_array().expect("a list").iter().filter(|w| w["fault"] == "torque_unexplained");
    let named: Vec<&str> = warnings.filter_map(|w| w["joint"].as_str()).collect();
    // The elbow feels what the shoulder's torque makes of the links; base and other wrist joints are as they were.
    assert!(["shoulder_lift_joint", "wrist_2_joint"].iter().all(|joint| named.contains(joint)), "{named:?}");
    assert!(!["shoulder_pan_joint", "wrist_1_joint", "wrist_3_joint"].iter().any(|j| named.contains(j)), "{named:?}");
    let (text, _) = result(rivet().args(["identify", "--online"]).arg(robot("ur10e")).arg(&path), folder.path());
    assert!(text.contains("the model explains hardly anything"), "{text}");
}

/// A plan that comes after the motion is one that the joint is ahead of.
#[test]
fn a_negative_lag_is_said_to_be_ahead() {
    let Some(log) = shared("data/real/ur10e_innopolis/20_02_10-20sec_7harm.parquet") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let mut log = sound("ur10e", &log);
    let after = |q: &Vec<f64>| (0..q.len()).map(|k| q[k.saturating_sub(2)]).collect::<Vec<f64>>();
    log.q_des = Some(log.q.iter().map(after).collect());
    let tau = log.torque().expect("torque").clone();
    let path = written(&log, &tau, folder.path());
    let (code, text) = said(rivet().arg("identify").arg(robot("ur10e")).arg(&path));
    assert!(code == Some(0) && text.contains("ms (negative: the joint is ahead of it)"), "{text}");
    assert!(text.contains("estimator.delay_s"), "delayed instruments are not in use: {text}");
}

/// Logs in which a joint stands are learnt from: of its drive nothing is, and that is said. Whatever is made of the result is made.
#[test]
fn a_joint_that_stands_is_told_and_the_others_are_learnt() {
    let Some(log) = shared("data/real/ur10e_innopolis/20_02_10-20sec_7harm.parquet") else { return };
    let Some(other) = shared("data/real/ur10e_innopolis/20_02_10-30sec_12harm.parquet") else { return };
    let folders = [(); 2].map(|()| tempfile::tempdir().expect("a folder"));
    let held = |log: &Path, folder: &Path| changed("ur10e", log, folder, |_, _, q| q[3] = -0.4);
    let [log, other] = [held(&log, folders[0].path()), held(&other, folders[1].path())];
    let folder = folders[0].path();
    let out = folder.join("model");
    let mut command = rivet();
    command.arg("identify").arg(robot("ur10e")).arg(&log).arg("--refine").arg("--hold-out").arg(&other);
    let (text, found) = result(command.arg("--export").arg(&out), folder);
    assert!(text.contains("warning: wrist_1_joint: no motion in these logs"), "{text}");
    let joint = &found["joints"][3];
    let left = &joint["residual_percent"];
    let unknown = [&joint["noise"], &joint["rows_per_free_row"], &left["nominal"], &left["instrumental"]];
    assert!(unknown.iter().all(|x| x.is_null()), "{joint}");
    assert!(found["joints"][2]["residual_percent"]["instrumental"].as_f64().expect("a number") < 20.0, "{found}");
    for p in found["parameters"].as_array().expect("a list") {
        let name = p["name"].as_str().expect("a name");
        if ["j4.rotor_inertia", "j4.viscous", "j4.coulomb"].contains(&name) {
            let (value, nominal) = (p["value"].as_f64().expect("a number"), p["nominal"].as_f64().expect("a number"));
            assert!((value - nominal).abs() < 1e-6 && p["decided_by"] == "prior", "{p}");
        }
    }
    assert!(found["bias"]["hausman"].is_number() && found["consistent"]["torque_percent"].is_number(), "{found}");
    assert!(rivet_config::load(out.join("model.toml")).is_ok());
    let (text, found) =
        result(rivet().args(["identify", "--compare"]).arg(robot("ur10e")).args([&log, &other]), folder);
    assert!(text.contains("wrist_1_joint: no motion in these logs") && found["of"].as_u64() > Some(10), "{text}");
}

/// Least squares that leave little and instruments that leave more than no fit at all: the instruments are those of another motion.
#[test]
fn instruments_of_another_motion_are_said_to_mislead() {
    let Some(log) = shared("data/real/ur10e_innopolis/20_02_10-20sec_7harm.parquet") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let mut log = sound("ur10e", &log);
    let tau = log.torque().expect("torque").clone();
    let file = robot_with("ur10e", folder.path(), "[estimator]", "[estimator]\ninstruments = \"setpoint\"");
    let mut misled = |later: usize| -> Vec<String> {
        let of = |q: &Vec<f64>| (0..q.len()).map(|k| q[(k + later) % q.len()]).collect();
        log.q_des = Some(log.q.iter().map(of).collect());
        let (text, found) =
            result(rivet().arg("identify").arg(&file).arg(written(&log, &tau, folder.path())), folder.path());
        let faults =
            found["warnings"].as_array().expect("a list").iter().filter(|w| w["fault"] == "instruments_mislead");
        let said: Vec<String> = faults.map(|w| w["text"].as_str().expect("words").to_owned()).collect();
        assert_eq!(text.contains("the instruments do not stand for this motion"), !said.is_empty(), "{text}");
        said
    };
    assert_eq!(misled(0), Vec::<String>::new());
    // Ten seconds.
    let said = misled(1000);
    assert!(said.len() == 1 && said[0].contains("wrist_1_joint"), "{said:?}");
}

/// A second encoder of another sign is told off line, where it is taken as the robot file asks; and least squares need none.
#[test]
fn a_second_encoder_is_told_where_it_sees_another_motion_and_missed_where_it_is_asked_for() {
    let Some(log) = shared("data/real/ur10e_innopolis/20_02_10-20sec_7harm.parquet") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let mut log = sound("ur10e", &log);
    let tau = log.torque().expect("torque").clone();
    let second = "[estimator]\ninstruments = \"second-encoder\"";
    let file = robot_with("ur10e", folder.path(), "[estimator]", second);
    for (sign, told) in [(-1.0, true), (1.0, false)] {
        log.q_link = log.q.iter().map(|q| Some(q.iter().map(|q| sign * q).collect())).collect();
        let path = written(&log, &tau, folder.path());
        let (text, found) = result(rivet().arg("identify").arg(&file).arg(path), folder.path());
        let faults = found["warnings"].as_array().expect("a list").iter();
        let faults = faults.filter(|w| w["fault"] == "second_encoder_sees_another_motion").count();
        assert_eq!(faults, if told { 6 } else { 0 }, "{text}");
        assert_eq!(text.contains("q_link is not the motion of q"), told, "{text}");
    }
    log.q_link = vec![None; 6];
    let path = written(&log, &tau, folder.path());
    let (code, text) = said(rivet().arg("identify").arg(&file).arg(&path));
    assert!(code == Some(65) && text.contains("q_link columns are missing"), "{code:?} {text}");
    let file = robot_with("ur10e", folder.path(), "[estimator]", &format!("{second}\nkind = \"rls\""));
    let (text, found) = result(rivet().arg("identify").arg(&file).arg(&path), folder.path());
    assert!(
        text.contains("least squares ask for none")
            && found["joints"][0]["residual_percent"]["least_squares"].is_number(),
        "{text}"
    );
}

/// Coulomb friction and an offset are one value of a joint that turns one way: the offset took it all (3.7 +- 0.5 N m for 0).
#[test]
fn an_offset_of_a_joint_that_turns_one_way_stays_as_in_the_file() {
    let Some(path) = shared("data/real/ur10e_innopolis/20_02_10-20sec_7harm.parquet") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let log = sound("ur10e", &path);
    // Of the elbow, the rows in which it goes forth alone; the rest of the log is cut out, so that nothing else is changed.
    let forth = |k: usize| k + 1 < log.len() && log.q[2][k + 1] > log.q[2][k];
    let longest = (0..log.len()).fold((0..0, 0), |(best, from): (std::ops::Range<usize>, usize), k| match forth(k) {
        true if k + 1 - from > best.len() => (from..k + 1, from),
        true => (best, from),
        false => (best, k + 1),
    });
    let part = log.slice(longest.0);
    let tau = part.torque().expect("torque").clone();
    let (text, found) =
        result(rivet().arg("identify").arg(robot("ur10e")).arg(written(&part, &tau, folder.path())), folder.path());
    let warnings = found["warnings"].as_array().expect("a list").iter();
    let joints: Vec<&str> =
        warnings.filter(|w| w["fault"] == "turns_one_way").filter_map(|w| w["joint"].as_str()).collect();
    assert!(joints.contains(&"elbow_joint"), "{text}");
    let offset = found["parameters"].as_array().expect("a list").iter().find(|p| p["name"] == "j3.offset");
    let offset = offset.expect("the elbow has one");
    assert!(offset["value"] == 0.0 && offset["decided_by"] == "bound" && offset["std"].is_null(), "{offset}");
}

/// A plan that comes every 10 ms, logged at 1 kHz: lags were off by up to 60 ms, and what is left of the torque was five times as much.
#[test]
fn a_plan_that_is_held_is_drawn_anew_and_said() {
    let Some(case) = shared("data/practice/case-24") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let log = read(case.join("log-a.parquet"), &ReadOptions::new(6)).expect("a log");
    let tau = log.torque().expect("torque").clone();
    let lags = |every: usize| -> (Vec<f64>, bool) {
        let mut held = log.clone();
        for plan in held.q_des.as_mut().expect("a plan") {
            *plan = (0..plan.len()).map(|k| plan[k / every * every]).collect();
        }
        let path = written(&held, &tau, folder.path());
        let (text, found) = result(rivet().arg("identify").arg(case.join("robot.toml")).arg(path), folder.path());
        let lags = found["logs"][0]["instruments"]["lag_s"].as_array().expect("lags").iter();
        (
            lags.map(|lag| lag.as_f64().expect("a number")).collect(),
            text.contains("the desired motion is held, 10 rows"),
        )
    };
    let ((exact, no), (held, said)) = (lags(1), lags(10));
    assert!(said && !no);
    for (held, exact) in held.iter().zip(&exact) {
        assert!((held - exact).abs() < 3e-4, "{held} s for {exact}");
    }
}

/// A load is picked up half-way: one fit of both halves is of neither arm, with deviations so large that nothing contradicts it.
#[test]
fn an_arm_that_changes_half_way_is_said() {
    let [Some(without), Some(with)] = ["20_02_19_14harm50sec", "20_02_19_14harm50secLoad"]
        .map(|name| shared(&format!("data/real/ur10e_innopolis/{name}.parquet")))
    else {
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let faults = |logs: &[&Path]| -> Vec<String> {
        let (_, found) = result(rivet().arg("identify").arg(robot("ur10e")).args(logs), folder.path());
        let all = found["warnings"].as_array().expect("a list").iter();
        all.filter_map(|w| w["fault"].as_str().map(str::to_owned)).collect()
    };
    for one in [&without, &with] {
        let found = faults(&[one]);
        assert!(!found.contains(&"arm_changes".to_owned()), "{found:?}");
    }
    let both = faults(&[&without, &with]);
    assert!(both.contains(&"arm_changes".to_owned()), "{both:?}");
}

/// Spikes cut a log into pieces, some of a single row: each by itself was a dead channel or one of the wrong sign.
#[test]
fn pieces_of_a_log_are_judged_together() {
    let Some(case) = shared("data/practice/case-24") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let log = read(case.join("log-a.parquet"), &ReadOptions::new(6)).expect("a log");
    let mut tau = log.torque().expect("torque").clone();
    let mut random = Random(11);
    for _ in 0..50 {
        let row = ((random.uniform() + 0.5) * log.len() as f64) as usize;
        for tau in &mut tau {
            tau[row.min(log.len() - 1)] = 5000.0;
        }
    }
    let path = written(&log, &tau, folder.path());
    let (text, found) = result(rivet().arg("identify").arg(case.join("robot.toml")).arg(path), folder.path());
    let faults = found["warnings"].as_array().expect("a list").iter().filter_map(|w| w["fault"].as_str());
    let other: Vec<&str> = faults.filter(|fault| *fault != "torque_beyond_limit").collect();
    assert!(text.contains("the log is cut there") && other.is_empty(), "{other:?} {text}");
}

/// Half a second of a motion: what one part tells is worth less on the next than the file's values.
#[test]
fn values_that_do_not_carry_over_are_said() {
    let Some(case) = shared("data/practice/case-24") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let log = read(case.join("log-a.parquet"), &ReadOptions::new(6)).expect("a log");
    let said = |log: &Log| -> bool {
        let path = written(log, log.torque().expect("torque"), folder.path());
        let (_, found) = result(rivet().arg("identify").arg(case.join("robot.toml")).arg(path), folder.path());
        let left = found["joints"].as_array().expect("joints").iter().map(|joint| &joint["left_out_percent"]);
        assert!(left.clone().all(Value::is_number), "{:?}", left.collect::<Vec<_>>());
        found["warnings"].as_array().expect("a list").iter().any(|w| w["fault"] == "carries_not_over")
    };
    let rows = |seconds: f64| (seconds / (log.t[1] - log.t[0])) as usize;
    assert!(!said(&log));
    assert!(said(&log.slice(rows(3.0)..rows(3.5))));
}
