//! Logs and words with which nothing good can be learnt: what the commands say, and how they end.

use std::path::{Path, PathBuf};
use std::process::Command;

use rivet_logs::{Log, ReadOptions, TorqueSource, interpolate, read, read_columns, write_columns};
use rivet_tests::{rivet, robot, shared};
use serde_json::Value;

/// A measured log with its time and positions changed, row by row.
fn changed(arm: &str, log: &Path, folder: &Path, change: impl Fn(usize, &mut f64, &mut [f64])) -> PathBuf {
    let mut log = sound(arm, log);
    for row in 0..log.len() {
        let mut q: Vec<f64> = log.q.iter().map(|q| q[row]).collect();
        change(row, &mut log.t[row], &mut q);
        log.q.iter_mut().zip(q).for_each(|(signal, q)| signal[row] = q);
    }
    let tau = log.torque().expect("torque").clone();
    written(&log, &tau, folder)
}

/// A measured log with the torque of each joint (from 0) multiplied.
fn with_torque_times(arm: &str, log: &Path, folder: &Path, factor: impl Fn(usize) -> f64) -> PathBuf {
    let log = sound(arm, log);
    let mut tau = log.torque().expect("torque").clone();
    for (j, tau) in tau.iter_mut().enumerate() {
        for tau in tau.iter_mut() {
            *tau *= factor(j);
        }
    }
    written(&log, &tau, folder)
}

fn sound(arm: &str, log: &Path) -> Log {
    let robot = rivet_config::load(robot(arm)).expect("a sound robot file");
    let options = ReadOptions { drive_gain: robot.config.drive.drive_gain.as_deref(), ..ReadOptions::new(robot.dof()) };
    read(log, &options).expect("a sound log")
}

fn written(log: &Log, tau: &[Vec<f64>], folder: &Path) -> PathBuf {
    let mut columns = vec![("t".to_owned(), &log.t[..])];
    for j in 0..tau.len() {
        columns.push((format!("q{}", j + 1), &log.q[j][..]));
        columns.push((format!("tau{}", j + 1), &tau[j][..]));
    }
    for (j, q) in log.q_des.iter().flatten().enumerate() {
        columns.push((format!("q_des{}", j + 1), &q[..]));
    }
    let path = folder.join("changed.parquet");
    write_columns(&path, &columns).expect("written");
    path
}

/// Exit code and everything said, on one line.
fn said(command: &mut Command) -> (Option<i32>, String) {
    let output = command.output().expect("the program starts");
    let text = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
    (output.status.code(), text.split_whitespace().collect::<Vec<_>>().join(" "))
}

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

/// Numbers of a mean square of one, no row like the one before it.
fn random(row: usize, kind: u64) -> f64 {
    let mut x = (row as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (kind + 1).wrapping_mul(0xD1B5_4A32_D192_ED03);
    for _ in 0..3 {
        x ^= x >> 29;
        x = x.wrapping_mul(0xBF58_476D_1CE4_E5B9);
    }
    3.0_f64.sqrt() * ((x >> 11) as f64 / (1_u64 << 52) as f64 - 1.0)
}

/// A simulated arm's log at a lower rate, sampled at uneven instants and stamped off those (shares of a step), as a file.
fn sampled(log: &Log, every: usize, [uneven, wrong]: [f64; 2], folder: &Path) -> PathBuf {
    let step_s = log.t[every] - log.t[0];
    let inside = (20..log.len() - 20).step_by(every);
    let at: Vec<f64> = inside.enumerate().map(|(row, k)| log.t[k] + uneven * step_s * random(row, 0)).collect();
    let of =
        |signals: &Vec<Vec<f64>>| -> Vec<Vec<f64>> { signals.iter().map(|x| interpolate(&log.t, x, &at)).collect() };
    let tau = of(log.torque().expect("torque"));
    let t = at.iter().enumerate().map(|(row, t)| t + wrong * step_s * random(row, 1)).collect();
    written(&Log { t, q: of(&log.q), q_des: log.q_des.as_ref().map(of), ..log.clone() }, &tau, folder)
}

/// What `identify` found (JSON) and said (text on one line).
fn identified(file: &Path, log: &Path) -> (Value, String) {
    let json = log.with_extension("json");
    let (code, text) = said(rivet().arg("identify").arg(file).arg(log).arg("--json").arg(&json));
    assert_eq!(code, Some(0), "{text}");
    (serde_json::from_str(&std::fs::read_to_string(json).expect("written")).expect("JSON"), text)
}

/// Half a minute of the arm of two joints at 1 kHz, its encoders with steps, its torque the model's with a little noise.
fn simulated(folder: &Path) -> Log {
    let t: Vec<f64> = (0..30_000).map(|k| 1e-3 * f64::from(k)).collect();
    let along = |terms: &[(f64, f64)]| -> Vec<f64> {
        t.iter().map(|t| terms.iter().map(|(size, rate)| size * (1.0 - (rate * t).cos())).sum()).collect()
    };
    let desired = [along(&[(0.5, 2.1), (0.12, 5.7)]), along(&[(0.4, 2.9), (0.1, 7.3)])];
    let [motion, torque] = ["motion.parquet", "torque.parquet"].map(|name| folder.join(name));
    write_columns(&motion, &[("t", &t), ("q1", &desired[0]), ("q2", &desired[1])]).expect("written");
    let (code, text) = said(rivet().arg("predict").arg(robot("dd2")).arg(&motion).arg("--out").arg(&torque));
    assert_eq!(code, Some(0), "{text}");
    let mut tau = read_columns(&torque, &["tau_pred1", "tau_pred2"]).expect("columns");
    for (joint, tau) in tau.iter_mut().enumerate() {
        let size = (tau.iter().map(|tau| tau * tau).sum::<f64>() / tau.len() as f64).sqrt();
        tau.iter_mut().enumerate().for_each(|(row, tau)| *tau += 0.02 * size * random(row, 7 + joint as u64));
    }
    let q = desired.iter().map(|q| q.iter().map(|q| (q / 5e-6).round() * 5e-6).collect()).collect();
    let log = read(&motion, &ReadOptions::new(2)).expect("a log");
    Log { q, tau: Some((TorqueSource::Logged, tau)), q_des: Some(desired.to_vec()), ..log }
}

fn faults(found: &Value) -> Vec<&str> {
    found["warnings"].as_array().expect("warnings").iter().filter_map(|w| w["fault"].as_str()).collect()
}

fn worst_residual(found: &Value) -> f64 {
    let of = |joint: &Value| joint["residual_percent"]["instrumental"].as_f64().expect("a number");
    found["joints"].as_array().expect("joints").iter().map(of).fold(0.0, f64::max)
}

#[test]
fn stamps_that_jitter_about_even_positions_cost_nothing_and_are_said() {
    let folder = tempfile::tempdir().expect("a folder");
    let log = simulated(folder.path());
    for (every, wrong) in [(10, 0.09), (1, 0.1)] {
        let exact = worst_residual(&identified(&robot("dd2"), &sampled(&log, every, [0.0; 2], folder.path())).0);
        let path = sampled(&log, every, [0.0, wrong], folder.path());
        let (found, text) = identified(&robot("dd2"), &path);
        assert!(worst_residual(&found) < 1.05 * exact, "{} of {exact}", worst_residual(&found));
        assert_eq!(found["logs"][0]["taken_as_even"], true, "{found:#}");
        let jitter_s = found["logs"][0]["stamps_jitter_s"].as_f64().expect("told");
        assert!((jitter_s / (wrong * 1e-3 * every as f64) - 1.0).abs() < 0.1, "{jitter_s}");
        assert!(text.contains("positions are even: taken as even"), "{text}");
        assert!(!faults(&found).contains(&"time_stamps_jitter"), "{found:#}");
        // A prediction has the log's own rows and stamps.
        let out = folder.path().join("predicted.parquet");
        let (code, text) = said(rivet().arg("predict").arg(robot("dd2")).arg(&path).arg("--out").arg(&out));
        assert!(code == Some(0) && text.contains("taken as even"), "{text}");
        let [logged, predicted] = [&path, &out].map(|file| read_columns(file, &["t"]).expect("columns"));
        assert_eq!(logged, predicted);
    }
}

/// Samples at uneven instants with stamps that are off these: no clock mends it. With right stamps, nothing is to be said.
#[test]
fn jitter_that_cannot_be_undone_is_warned_of_in_terms_of_torque() {
    let folder = tempfile::tempdir().expect("a folder");
    let log = simulated(folder.path());
    for every in [10, 1] {
        let (found, text) = identified(&robot("dd2"), &sampled(&log, every, [0.15, 0.1], folder.path()));
        assert!(faults(&found).contains(&"time_stamps_jitter"), "{every}: {found:#}");
        assert!(text.contains("rows are off their time stamps by"), "{text}");
        let (found, text) = identified(&robot("dd2"), &sampled(&log, every, [0.15, 0.0], folder.path()));
        assert!(!faults(&found).contains(&"time_stamps_jitter") && !text.contains("off their time stamps"), "{text}");
        assert_eq!(found["logs"][0]["taken_as_even"], false);
    }
}

/// Measured: the rows of the UR10e come unevenly, and its stamps are right.
#[test]
fn no_measured_log_is_taken_as_even() {
    let Some(real) = shared("data/real") else { return };
    for (arm, log) in [
        ("ur10e", "ur10e_innopolis/20_02_10-30sec_12harm"),
        ("ur10e", "ur10e_innopolis/20_02_06-20sec_10harm"),
        ("ur10e", "ur10e_innopolis/20_02_19_14harm50sec"),
        ("kuka-kr300-r2500", "kuka_kr300/traj_A_10s"),
        ("staubli-tx40", "staubli_tx40/exciting_0.0-5.5s"),
    ] {
        let log = sound(arm, &real.join(format!("{log}.parquet")));
        let clocked = log.clone().by_its_positions();
        assert!(clocked.stamps.is_none() && clocked.t == log.t, "{arm}");
    }
}

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
    for (instruments, needs) in [("setpoint", "qdd_des"), ("second-encoder", "q_link"), ("auto", "")] {
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

#[test]
fn failures_end_with_the_code_of_whose_fault_it_is() {
    let (code, text) = said(rivet().args(["figures", "4"]));
    assert!(code == Some(64) && text.contains("figure 4 is not computed"), "{code:?} {text}");
    let Some(log) = shared("data/real/staubli_tx40/exciting_0.0-5.5s.parquet") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let tx40 = robot("staubli-tx40");
    let still = changed("staubli-tx40", &log, folder.path(), |_, _, q| q.fill(0.1));
    let (code, text) = said(rivet().arg("identify").arg(&tx40).arg(&still));
    assert!(code == Some(65) && text.contains("no motion is left"), "{code:?} {text}");
    let (code, text) = said(rivet().args(["identify", "--compare"]).arg(&tx40).arg(&log));
    assert!(code == Some(64) && text.contains("at least two logs"), "{code:?} {text}");
    let minutes = changed("staubli-tx40", &log, folder.path(), |_, t, _| *t *= 1e4);
    let (code, text) = said(rivet().arg("identify").arg(&tx40).arg(&minutes));
    assert!(code == Some(65) && text.contains("is column t in seconds?"), "{code:?} {text}");
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
            .map(|w| (w["joint"].as_str().expect("a name").to_owned(), w["fault"].as_str().expect("a name").to_owned()))
            .collect()
    };
    assert_eq!(faults(&|_| 1.0), []);
    let joints = &rivet_config::load(robot("ur10e")).expect("a sound robot file").model.arm.joints;
    let all = |fault: &str| -> Vec<(String, String)> {
        joints.iter().map(|joint| (joint.name.clone(), fault.to_owned())).collect()
    };
    assert_eq!(faults(&|_| -1.0), all("torque_sign"));
    assert_eq!(faults(&|_| 1e3), all("torque_scale"));
    assert_eq!(faults(&|j| if j == 0 { -1.0 } else { 1.0 }), [all("torque_sign")[0].clone()]);

    let dead = with_torque_times("ur10e", &log, folder.path(), |j| if j == 2 { 0.0 } else { 1.0 });
    let (code, text) = said(rivet().arg("identify").arg(robot("ur10e")).arg(&dead));
    assert!(code == Some(65) && text.contains("torque of joint 3 is 0 in all rows"), "{text}");
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

/// A copy of a robot's folder whose robot file has one word changed; the path of that file.
fn robot_with(arm: &str, folder: &Path, from: &str, to: &str) -> PathBuf {
    let source = robot(arm);
    let text = std::fs::read_to_string(&source).expect("readable");
    assert!(text.contains(from), "{text}");
    std::fs::copy(source.with_file_name("robot.urdf"), folder.join("robot.urdf")).expect("copied");
    let file = folder.join("robot.toml");
    std::fs::write(&file, text.replacen(from, to, 1)).expect("written");
    file
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
    assert!(text.contains("robot file's half_width = 40 acts on line only"), "{text}");
    // Delayed instruments are in use here, so delay_s is.
    assert!(text.contains("on line only estimator.window_s") && !text.contains("estimator.delay_s"), "{text}");
    let text = words("torque_noise = 1.0\n[supervision]\ntolerance = 0.3\nkind = \"eigen\"");
    for key in ["signal.torque_noise", "estimator.window_s", "supervision.tolerance"] {
        assert!(text.contains(key), "{key}: {text}");
    }
    assert!(!text.contains("supervision.kind"), "the default: {text}");
    let text = words("filtering = \"none\"");
    assert!(text.contains("half_width = 40 and filtering = \"none\" act on line only"), "{text}");
    let file = robot_with("ur10e", folder.path(), "[estimator]", "[estimator]\ninstruments = \"previous-cycle\"");
    let (_, text) = said(rivet().arg("identify").arg(&file).arg(&log));
    assert!(text.contains("off line no cycle is looked for: delayed instruments"), "{text}");
    let (_, text) = said(rivet().args(["identify", "--online"]).arg(&file).arg(&log));
    assert!(text.contains("previous cycle (the motion repeats)") || text.contains("no cycle is found"), "{text}");
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
    assert!(text.contains("the same samples as 20_02_10-20sec_7harm.parquet; a run agrees with itself"), "{text}");
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

#[test]
fn nothing_is_judged_by_a_log_in_which_the_arm_stands() {
    let Some(log) = shared("data/real/ur10e_innopolis/20_02_10-20sec_7harm.parquet") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let still = changed("ur10e", &log, folder.path(), |_, _, q| q.fill(0.1));
    let (code, text) = said(rivet().arg("identify").arg(robot("ur10e")).arg(&log).arg("--hold-out").arg(still));
    let says = "changed.parquet: no joint moves faster than its dead zone";
    assert!(code == Some(65) && text.contains(says), "{code:?} {text}");
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
        assert!(code == Some(65) && text.contains("0.800 times as fast as the log's speeds say"), "{code:?} {text}");
    }
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
        assert!(finding["fault"] == "torque_sign" && text.contains("or of this position"), "{finding:#}");
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
        (1, "sealed_differs", "Something changed between them"),
        (0, "sealed_as_given", "The model as given fits the sealed run to its noise"),
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

/// What a program gave, with what it wrote as JSON.
fn result(command: &mut Command, folder: &Path) -> (String, serde_json::Value) {
    let json = folder.join("result.json");
    let (code, text) = said(command.arg("--json").arg(&json));
    assert_eq!(code, Some(0), "{text}");
    (text, serde_json::from_slice(&std::fs::read(&json).expect("a result")).expect("sound JSON"))
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
    assert!(text.contains("wrist_3_joint: friction with load came out as"), "{text}");
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
    let mut state = 1_u64;
    let mut random = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 40) as f64 / f64::from(1_u32 << 24) - 0.5
    };
    let mut tau = log.torque().expect("torque").clone();
    tau[1].iter_mut().for_each(|tau| *tau = 100.0 * random());
    tau[4].iter_mut().for_each(|tau| *tau = 20.0 * random());
    let path = written(&log, &tau, folder.path());
    let (text, found) = result(rivet().arg("identify").arg(robot("ur10e")).arg(&path), folder.path());
    assert!(text.contains("the model explains next to nothing of this torque"), "{text}");
    let warnings = found["warnings"].as_array().expect("a list").iter().filter(|w| w["fault"] == "torque_unexplained");
    let named: Vec<&str> = warnings.filter_map(|w| w["joint"].as_str()).collect();
    // The elbow feels what the shoulder's torque makes of the links; base and other wrist joints are as they were.
    assert!(["shoulder_lift_joint", "wrist_2_joint"].iter().all(|joint| named.contains(joint)), "{named:?}");
    assert!(!["shoulder_pan_joint", "wrist_1_joint", "wrist_3_joint"].iter().any(|j| named.contains(j)), "{named:?}");
    let (text, _) = result(rivet().args(["identify", "--online"]).arg(robot("ur10e")).arg(&path), folder.path());
    assert!(text.contains("the model explains next to nothing"), "{text}");
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

/// What cannot be written or is not there is told before anything is computed.
#[test]
fn what_cannot_end_well_is_refused_at_the_start() {
    let begun = std::time::Instant::now();
    let folder = tempfile::tempdir().expect("a folder");
    let (code, text) = said(rivet().args(["figures", "--out", "/nonexistent/x.html"]));
    assert!(code != Some(0) && text.contains("/nonexistent/x.html") && !text.contains("Figure"), "{code:?} {text}");
    for study in ["real", "withheld"] {
        let (code, text) = said(rivet().args(["study", study]).current_dir(folder.path()));
        assert!(code == Some(64) && text.contains("--root DIR"), "{code:?} {text}");
    }
    assert!(begun.elapsed() < std::time::Duration::from_secs(10), "{:?}", begun.elapsed());
    let page = folder.path().join("figures.html");
    let (code, text) = said(rivet().args(["figures", "12", "12", "--out"]).arg(&page));
    assert!(code == Some(0) && text.matches("Figure 12").count() == 1, "{code:?} {text}");
    assert_eq!(std::fs::read_dir(folder.path()).expect("readable").count(), 1, "the page alone");
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
