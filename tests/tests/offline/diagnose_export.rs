//! `rivet diagnose --export`: the files that it writes say what the diagnosis found, and how far they do not.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use rivet_config::{Robot, load};
use rivet_dynamics::{Arm, Mjcf, Model, Workspace, smallest_eigenvalue};
use rivet_estimation::offline::{Trajectory, ZeroPhase, predict};
use rivet_logs::{ReadOptions, read};
use rivet_tests::{rivet, shared};
use serde_json::Value;

struct Exported {
    model: Robot,
    mjcf: Mjcf,
    place: PathBuf,
    facts: Value,
}

/// A case with its files, exported once.
fn exported(set: &str, case: &str) -> Option<(PathBuf, &'static Exported)> {
    static DONE: [(&str, &str, OnceLock<Exported>); 3] = [
        ("practice", "case-16", OnceLock::new()),
        ("practice-wrong-nominal", "case-03", OnceLock::new()),
        ("practice-wrong-nominal", "case-13", OnceLock::new()),
    ];
    let case_folder = shared(&format!("data/{set}"))?.join(case);
    let (_, _, cell) = DONE.iter().find(|(s, c, _)| (*s, *c) == (set, case)).expect("one of the cases");
    Some((case_folder.clone(), cell.get_or_init(|| export(set, case, &case_folder))))
}

fn export(set: &str, name: &str, case: &Path) -> Exported {
    // Beside what cargo makes: tests share it until the program ends, when nothing is dropped any more.
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("exported-{set}-{name}"));
    std::fs::create_dir_all(&folder).expect("a folder");
    let (json, place) = (folder.join("diagnosis.json"), folder.join("out"));
    if place.exists() {
        std::fs::remove_dir_all(&place).expect("what an earlier run wrote goes");
    }
    let mut command = rivet();
    command.arg("diagnose").arg(case.join("robot.toml"));
    command.arg(case.join("log-a.parquet")).arg(case.join("log-b.parquet"));
    command.arg("--json").arg(&json).arg("--export").arg(&place);
    let output = command.output().expect("the program starts");
    assert_eq!(output.status.code(), Some(1), "{}", String::from_utf8_lossy(&output.stderr));
    let facts = serde_json::from_str(&std::fs::read_to_string(&json).expect("facts")).expect("JSON");
    let text = std::fs::read_to_string(place.join("robot.xml")).expect("MJCF");
    let mjcf = Mjcf::read(&text).expect("our own MJCF reads back");
    Exported { model: load(place.join("model.toml")).unwrap_or_else(|e| panic!("{e}")), mjcf, place, facts }
}

/// Torque that a file misses by what was declared, joint by joint \[N m\].
fn declared(facts: &Value, file: &str) -> Vec<f64> {
    figures(facts, file, "missed_nm")
}

fn figures(facts: &Value, file: &str, which: &str) -> Vec<f64> {
    let formats = facts["export"].as_array().expect("formats");
    let format = formats.iter().find(|f| f["file"] == file).expect("a report for each file");
    format[which].as_array().expect("figures").iter().map(|m| m.as_f64().expect("a number")).collect()
}

/// Root mean squares over joints: the torque that model.toml predicts along a log, and how far another one is from it.
fn apart(model: &Robot, log: &Path, other: impl Fn(&[f64], &[f64], &[f64], &mut [f64])) -> (Vec<f64>, Vec<f64>) {
    let n = model.dof();
    let options = ReadOptions::new(n);
    let log = read(log, &options).expect("a log");
    let period = log.median_step_s();
    let motion = Trajectory::from_positions(&log.q, period);
    let smooth = ZeroPhase::new(20.0, 4, period);
    let expected = predict(&model.model, &model.base, model.base_parameters(), &motion, &smooth).expect("a motion");
    let mut tau = vec![vec![0.0; log.len()]; n];
    let mut at = vec![0.0; n];
    for k in 0..log.len() {
        let of = |signal: &[Vec<f64>]| -> Vec<f64> { signal.iter().map(|s| s[k]).collect() };
        other(&of(&motion.q), &of(&motion.qd), &of(&motion.qdd), &mut at);
        tau.iter_mut().zip(&at).for_each(|(to, v)| to[k] = *v);
    }
    let inner = 200..log.len() - 200;
    let rms = |f: &dyn Fn(usize) -> f64| (inner.clone().map(|k| f(k).powi(2)).sum::<f64>() / inner.len() as f64).sqrt();
    let mut found = (Vec::new(), Vec::new());
    for (tau, expected) in tau.iter_mut().zip(&expected) {
        smooth.apply(tau);
        found.0.push(rms(&|k| expected[k]));
        found.1.push(rms(&|k| expected[k] - tau[k]));
    }
    found
}

/// Bodies that can be built in every file, and both foreign formats predict what model.toml predicts but for what
/// not-expressible.md says they miss.
#[test]
fn exported_files_say_the_same_but_for_what_is_declared() {
    for (set, case, kind) in [
        ("practice", "case-16", "joint_spring"),
        ("practice-wrong-nominal", "case-03", "joint_spring"),
        ("practice-wrong-nominal", "case-13", "viscous_nonlinearity"),
    ] {
        let Some((data, found)) = exported(set, case) else { return };
        let robot = &found.model;
        assert!(robot.config.effects.iter().any(|e| e.kind.name() == kind), "{:?}", robot.config.effects);
        assert!(robot.identified.is_some());
        // The model found is nearer to the logs than the one given, and MuJoCo holds these effects.
        for file in ["model.toml", "robot.xml"] {
            let [gap, before] = ["gap_nm", "gap_before_nm"].map(|which| figures(&found.facts, file, which));
            println!("{case} {file}: gap {gap:.3?} N m, of the model as given {before:.3?}");
            // Not joint by joint: all are found together, weighed by their noise.
            let square = |of: &[f64]| of.iter().map(|v| v * v).sum::<f64>();
            assert!(square(&gap) < 0.5 * square(&before), "{gap:?} {before:?}");
            assert!(gap.iter().zip(&before).any(|(gap, before)| *gap <= 0.7 * before), "{gap:?} {before:?}");
        }
        for body in robot.model.arm.links.iter().chain(&found.mjcf.arm.links) {
            assert!(smallest_eigenvalue(body) > 0.0, "{body:?}");
        }
        assert_eq!(Mjcf::read(&found.mjcf.text()).as_ref().map(|m| &m.drives), Ok(&found.mjcf.drives));
        let log = data.join("log-b.parquet");
        let v0 = robot.model.structure.sign_velocity;
        let check = |file: &str, (torque, apart): (Vec<f64>, Vec<f64>)| {
            for (j, declared) in declared(&found.facts, file).iter().enumerate() {
                // The declaration is of two logs, this is one; and filters make the rows elsewhere.
                let room = 1.4 * declared + 0.002 * torque[j];
                println!("{case} {file} joint {}: {:.4} of {:.4} declared {declared:.4}", j + 1, apart[j], torque[j]);
                assert!(apart[j] <= room, "{case} {file} joint {}: {} above {room}", j + 1, apart[j]);
            }
        };
        let ws = std::cell::RefCell::new(Workspace::new(&found.mjcf.arm));
        check(
            "robot.xml",
            apart(robot, &log, |q, qd, qdd, tau| found.mjcf.torque(&mut ws.borrow_mut(), v0, q, qd, qdd, tau)),
        );
        // What a reader of the URDF knows: bodies, and friction as `<dynamics>` has it.
        let text = std::fs::read_to_string(found.place.join("robot.urdf")).expect("a URDF");
        let arm = Arm::from_urdf(&text, robot.config.gravity).expect("the URDF reads back");
        let plain = Model::new(arm, robot.model.structure);
        let mut drives = robot.config.nominal_joints();
        drives.rotor_inertia.fill(0.0);
        drives.offset.fill(0.0);
        let x = plain.nominal(&drives);
        let y = std::cell::RefCell::new(vec![0.0; plain.arm.dof() * plain.len()]);
        check(
            "robot.urdf",
            apart(robot, &log, |q, qd, qdd, tau| {
                let mut y = y.borrow_mut();
                plain.regressor(&mut Workspace::new(&plain.arm), q, qd, qdd, &mut y);
                for (tau, row) in tau.iter_mut().zip(y.chunks_exact(plain.len())) {
                    *tau = row.iter().zip(&x).map(|(y, x)| y * x).sum();
                }
            }),
        );
        let notes = std::fs::read_to_string(found.place.join("not-expressible.md")).expect("notes");
        assert!(notes.contains("all that is missing together") && notes.contains("N m"), "{notes}");
    }
}

/// The corrected model explains the logs: diagnosed with it, nothing of what was found is found again.
#[test]
fn with_the_exported_model_the_effect_is_gone() {
    let Some((case, found)) = exported("practice", "case-16") else { return };
    let json = found.place.join("again.json");
    let mut command = rivet();
    command.arg("diagnose").arg(found.place.join("model.toml"));
    command.arg(case.join("log-a.parquet")).arg(case.join("log-b.parquet")).arg("--json").arg(&json);
    let output = command.output().expect("the program starts");
    let again: Value = serde_json::from_str(&std::fs::read_to_string(&json).expect("facts")).expect("JSON");
    assert_eq!(again["causes"].as_array().map(Vec::len), Some(0), "{again:#}");
    assert_eq!(output.status.code(), Some(0), "{again:#}");
    let (before, after) = (&again["gap"]["before"], &found.facts["gap"]["after"]);
    let apart = before.as_f64().expect("a gap") - after.as_f64().expect("a gap");
    assert!(apart.abs() < 0.01, "{before} {after}");
}

/// The corrected simulator follows the log.
#[test]
fn the_simulator_comes_closer() {
    let Some((_, found)) = exported("practice", "case-16") else { return };
    let rollout = &found.facts["rollout"];
    assert_eq!(rollout["closer"], true, "{rollout:#}");
    let end = &rollout["points"][4];
    let error = |key: &str| end[key].as_f64().expect("a number");
    assert!(error("position_after_rad") < 0.1 * error("position_before_rad"), "{end}");
    assert!(error("torque_after") < 0.1 * error("torque_before"), "{end}");
    // The log tells the spring from all others, so there is no motion to record.
    assert!(!found.place.join("separating-1.csv").exists());
}

/// Of a spring that may be a counterbalance on its log: within the joints' limits.
#[test]
fn a_motion_is_planned() {
    let Some((_, found)) = exported("practice-wrong-nominal", "case-03") else { return };
    let robot = &found.model;
    let options = ReadOptions { joint_zero: Some(&robot.config.log.joint_zero), ..ReadOptions::new(robot.dof()) };
    let motion = read(found.place.join("separating-1.csv"), &options).expect("setpoints read as a log");
    assert!(motion.qd_des.is_some() && motion.qdd_des.is_some() && motion.len() > 5000);
    for (q, joint) in motion.q_des.as_ref().expect("positions").iter().zip(&robot.model.arm.joints) {
        assert!(q.iter().all(|q| (joint.lower..=joint.upper).contains(q)), "{} leaves its range", joint.name);
    }
}

/// Of a delay of 5 ms that may be a lag: a chirp, by its fast part, was said to tell and did not. Nor has a name that values have all but taken
/// up the chance with which the residual that they leave shows it (0.49).
#[test]
fn no_motion_is_planned_that_does_not_tell() {
    let Some(case) = shared("data/practice/case-22") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let (json, place) = (folder.path().join("found.json"), folder.path().join("out"));
    let mut diagnose = rivet();
    diagnose
        .arg("diagnose")
        .arg(case.join("robot.toml"))
        .args(["log-a.parquet", "log-b.parquet"].map(|l| case.join(l)));
    let output = diagnose.arg("--json").arg(&json).arg("--export").arg(&place).output().expect("the program starts");
    let found: serde_json::Value = serde_json::from_slice(&std::fs::read(json).expect("a verdict")).expect("JSON");
    let late = &found["causes"][0];
    assert_eq!(late["effect"], "transport_delay", "{found:#}");
    assert_eq!(late["indistinguishable_from"], serde_json::json!(["current_loop_lag"]));
    assert!(late["separating_motion"].is_null() && late["p_value"].is_null(), "{late:#}");
    assert!(place.join("model.toml").exists() && !place.join("separating-1.csv").exists());
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(told.contains("no setpoints are written to separate"), "{told}");
}

/// Another program reads the MJCF and needs the torque that we read out of it. Runs where a Python with MuJoCo is
/// (`RIVET_MUJOCO_PYTHON`, or `python3`).
#[test]
fn mujoco_reads_the_same_arm() {
    let python = std::env::var("RIVET_MUJOCO_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let has = Command::new(&python).args(["-c", "import mujoco"]).output().is_ok_and(|o| o.status.success());
    if !has {
        use std::io::Write as _;
        let _ = writeln!(std::io::stderr(), "SKIPPED: {python} has no mujoco; RIVET_MUJOCO_PYTHON names one that has");
        return;
    }
    let Some((_, found)) = exported("practice-wrong-nominal", "case-13") else { return };
    let script = r"
import sys, json, mujoco, numpy as np
m = mujoco.MjModel.from_xml_path(sys.argv[1]); d = mujoco.MjData(m)
out = []
r = np.random.default_rng(3)
for _ in range(40):
    d.qpos[:] = r.uniform(-1, 1, m.nv); d.qvel[:] = r.choice([-1, 1], m.nv) * r.uniform(0.5, 1.5, m.nv)
    d.qacc[:] = r.uniform(-3, 3, m.nv)
    q, v, a = d.qpos.copy(), d.qvel.copy(), d.qacc.copy()
    # Friction is a soft constraint there, and its torque is compared by its level.
    mujoco.mj_inverse(m, d)
    tau = d.qfrc_inverse + d.qfrc_constraint + m.dof_frictionloss * np.sign(v)
    bias, gain = m.actuator_biasprm[:, 0], m.actuator_gainprm[:, 0]
    out.append([q.tolist(), v.tolist(), a.tolist(), ((tau - bias) / gain).tolist()])
print(json.dumps(out))
";
    let run = Command::new(&python).arg("-c").arg(script).arg(found.place.join("robot.xml")).output().expect("python");
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let rows: Vec<Vec<Vec<f64>>> = serde_json::from_slice(&run.stdout).expect("rows");
    let mut ws = Workspace::new(&found.mjcf.arm);
    for row in rows {
        let mut tau = vec![0.0; found.mjcf.drives.len()];
        found.mjcf.torque(&mut ws, 0.0, &row[0], &row[1], &row[2], &mut tau);
        for (ours, theirs) in tau.iter().zip(&row[3]) {
            assert!((ours - theirs).abs() < 1e-6 * (1.0 + theirs.abs()), "{tau:?} {:?}", row[3]);
        }
    }
}

/// An arm whose torque channels 4 to 6 are faulty, whose bodies nobody knows and which lacks more than has a name: what is written
/// for it is nearer to the runs than the file it was made from on every joint that can be heard, and says what stayed as given.
#[test]
fn a_file_is_never_further_from_the_runs_than_the_one_given() {
    let Some(logs) = shared("data/real/shanghai_electric_6dof") else { return };
    let given = rivet_tests::root().join("tests/robots/shanghai/robot.toml");
    let folder = tempfile::tempdir().expect("a folder");
    let (json, place) = (folder.path().join("diagnosis.json"), folder.path().join("out"));
    let mut command = rivet();
    command.arg("diagnose").arg(&given).args(["traj_1.parquet", "traj_2.parquet"].map(|run| logs.join(run)));
    command.arg("--json").arg(&json).arg("--export").arg(&place);
    let output = command.output().expect("the program starts");
    let facts: Value = serde_json::from_str(&std::fs::read_to_string(&json).expect("facts")).expect("JSON");
    for file in ["model.toml", "robot.urdf", "robot.xml"] {
        let [gap, before] = ["gap_nm", "gap_before_nm"].map(|which| figures(&facts, file, which));
        println!("{file}: {gap:.2?} of {before:.2?} N m");
        // The others' torque has the wrong sign.
        assert!(gap.iter().zip(&before).take(3).all(|(gap, before)| *gap < 0.6 * before), "{file}: {gap:?} {before:?}");
        assert!(gap.iter().zip(&before).all(|(gap, before)| *gap < 1.1 * before), "{file}: {gap:?} {before:?}");
    }
    let [given, found] = [given, place.join("model.toml")].map(|file| load(file).unwrap_or_else(|e| panic!("{e}")));
    let [given, found] = [given, found].map(|robot| robot.config.nominal_joints());
    for (given, found) in
        [(given.rotor_inertia, found.rotor_inertia), (given.viscous, found.viscous), (given.coulomb, found.coulomb)]
    {
        assert_eq!(given[3..], found[3..], "drives of joints whose torque is not believed");
        // The file's drives are guesses; by `rivet identify` joint 2 has 31 to 40 N m of friction where it says 10.
        assert!(given.iter().zip(&found).all(|(given, found)| (0.3..4.0).contains(&(found / given))), "{found:?}");
    }
    let notes = std::fs::read_to_string(place.join("not-expressible.md")).expect("notes");
    assert!(notes.contains("drive values of joint_4, joint_5, joint_6 stay nominal"), "{notes}");
    assert!(String::from_utf8_lossy(&output.stderr).contains("stay nominal"));
}
