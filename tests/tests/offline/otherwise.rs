//! Logs of sound arms with one thing of all joints wrong: a joint's zero, gravity taken out of the torque, joints in each other's place, channels
//! of noise, torque that is held. Each was called by the name of an effect that looks like it, most with 0.95 and more.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};
use std::path::Path;

use rivet_dynamics::{Arm, Workspace, inverse_dynamics};
use rivet_logs::{Log, ReadOptions, read, write_columns};
use rivet_tests::altered::{Random, answer, written};
use rivet_tests::{rivet, robot, shared};
use serde_json::Value;

/// What is said of a case with both logs changed, positions and torques: exit code, text, document.
pub(crate) fn told(case: &Path, change: impl Fn(&mut Log, &mut [Vec<f64>])) -> (Option<i32>, String, Value) {
    told_by_file(case, str::to_owned, change)
}

/// The same with another robot file beside the case's URDF.
pub(crate) fn told_by_file(
    case: &Path,
    file: impl Fn(&str) -> String,
    change: impl Fn(&mut Log, &mut [Vec<f64>]),
) -> (Option<i32>, String, Value) {
    let folder = tempfile::tempdir().expect("a folder");
    let given = std::fs::read_to_string(case.join("robot.toml")).expect("a robot file");
    let robot = folder.path().join("robot.toml");
    std::fs::write(&robot, file(&given)).expect("a file");
    std::fs::copy(case.join("robot.urdf"), folder.path().join("robot.urdf")).expect("the URDF beside it");
    let mut command = rivet();
    command.arg("diagnose").arg(robot);
    for name in ["log-a", "log-b"] {
        let mut log = read(case.join(name).with_extension("parquet"), &ReadOptions::new(6)).expect("a sound log");
        let mut tau = log.torque().expect("torque").clone();
        change(&mut log, &mut tau);
        let own = folder.path().join(name);
        std::fs::create_dir(&own).expect("a folder");
        command.arg(written(&log, &tau, &own));
    }
    answer(&mut command, folder.path())
}

pub(crate) fn causes(found: &Value) -> Vec<(&str, f64)> {
    let cause = |c: &'_ Value| c["confidence"].as_f64().expect("a number");
    let list = found["causes"].as_array().expect("causes").iter();
    list.map(|c| (c["effect"].as_str().expect("a name"), cause(c))).collect()
}

/// Joints with this fault, in order.
fn joints_with<'a>(found: &'a Value, fault: &str) -> Vec<&'a str> {
    let list = found["log"].as_array().expect("findings").iter().filter(|f| f["fault"] == fault);
    let mut joints: Vec<&str> = Vec::new();
    for joint in list.map(|f| f["joint"].as_str().expect("a name")) {
        if !joints.contains(&joint) {
            joints.push(joint);
        }
    }
    joints
}

fn turn(joint: usize, by: f64) -> impl Fn(&mut Log, &mut [Vec<f64>]) {
    move |log, _| log.q[joint].iter_mut().for_each(|q| *q += by)
}

/// Turned by a quarter, an eighth and half a turn: gravity upside down (0.97), two counterbalances (0.97), contact (0.95).
#[test]
fn a_zero_that_is_another_is_told_with_its_angle() {
    for (case, joint, by) in [("case-18", 1, FRAC_PI_2), ("case-24", 1, PI), ("case-24", 2, FRAC_PI_4)] {
        let Some(sound) = shared("data/practice").map(|folder| folder.join(case)) else { return };
        let (_, text, found) = told(&sound, turn(joint, by));
        assert_eq!(causes(&found), [("encoder_offset", 0.97)], "{text}");
        let offset = found["causes"][0]["magnitude"]["offset_rad"].as_f64().expect("a number");
        // Half a turn on is half a turn back.
        let off = (offset + by + PI).rem_euclid(2.0 * PI) - PI;
        assert!(off.abs() < 0.01, "{case}: {offset} for {by}");
        let [before, after] = ["before", "after"].map(|key| found["gap"][key].as_f64().expect("a gap"));
        assert!(after < 0.1 * before, "{before} {after}");
        assert!(text.contains("to joint_zero of"), "{text}");
    }
}

/// A gear ratio or an encoder's counts: over a part of a turn they look like an encoder that is mounted badly, which it was (0.97).
#[test]
fn a_position_of_another_scale_is_told_with_it() {
    for (case, joint, by) in [("case-18", 1, 1.05), ("case-18", 2, 1.05), ("case-24", 2, 1.05)] {
        let Some(sound) = shared("data/practice").map(|folder| folder.join(case)) else { return };
        let (code, text, found) =
            told(&sound, |log: &mut Log, _: &mut [Vec<f64>]| log.q[joint].iter_mut().for_each(|q| *q *= by));
        assert_eq!((code, causes(&found)), (Some(2), Vec::new()), "{text}");
        let mut hints = found["hints"].as_array().expect("hints").iter();
        let gain = hints.find_map(|hint| hint["magnitude"]["position_gain"].as_f64()).expect("a scale");
        assert!((gain * by - 1.0).abs() < 0.006, "{gain} for {by}");
        assert!(text.contains("torques fit best with"), "{text}");
    }
}

/// A torque signal whose zero is off is a constant, at rest as in motion: it was a counterbalance (0.87) or, where most rows move, an
/// asymmetry of friction that was sure of itself (0.97).
#[test]
fn a_zero_of_the_torque_is_told_or_is_not_told_from_an_asymmetry() {
    let Some(sound) = shared("data/practice/case-24") else { return };
    let of = |joint: usize, off: f64| {
        told(&sound, move |_: &mut Log, tau: &mut [Vec<f64>]| tau[joint].iter_mut().for_each(|tau| *tau += off))
    };
    let (code, text, found) = of(2, 3.0);
    assert_eq!((code, causes(&found)), (Some(2), Vec::new()), "{text}");
    let mut hints = found["hints"].as_array().expect("hints").iter();
    let constant = hints.find_map(|hint| hint["magnitude"]["constant_Nm"].as_f64()).expect("a constant");
    assert!((constant - 3.0).abs() < 0.1, "{constant}");
    assert!(text.contains("Record the torque signal of elbow_joint with the drive off"), "{text}");
    assert!(text.contains("Not in the list of effects: a constant torque on elbow_joint"), "{text}");
    let (_, text, found) = of(4, 1.0);
    assert!(causes(&found).iter().all(|(_, confidence)| *confidence < 0.8), "{text}");
    assert!(text.contains("with the drive off"), "{text}");
}

/// A zero that is off is the signal's: what the arm has on the same joint keeps its name, and both are told.
#[test]
fn a_zero_of_the_torque_hides_no_effect_of_its_joint() {
    let Some(sound) = shared("data/practice/case-24") else { return };
    let (code, text, found) = told(&sound, |log: &mut Log, tau: &mut [Vec<f64>]| {
        tau[2].iter_mut().zip(&log.q[2]).for_each(|(tau, q)| *tau += 3.0 + 4.0 * (25.0 * q).sin());
    });
    let named = causes(&found).into_iter().find(|(effect, _)| *effect == "torque_ripple");
    assert!(code == Some(1) && named.is_some_and(|(_, confidence)| confidence > 0.9), "{text}");
    assert!(text.contains("with the drive off"), "{text}");
}

/// A brake that drags now and then is in no list. Values took a little of it and were the answer (`parameter`), with a joint 16 times its noise.
#[test]
fn one_joint_that_keeps_a_gap_is_unexplained() {
    let Some(sound) = shared("data/practice-wrong-nominal/case-15") else { return };
    let (code, text, found) = told(&sound, |log: &mut Log, tau: &mut [Vec<f64>]| {
        let (drag, period) = (0.12 * tau[1].iter().map(|tau| tau.abs()).fold(0.0, f64::max), log.median_step_s());
        for (row, tau) in tau[1].iter_mut().enumerate() {
            let [before, after] = [row.saturating_sub(8), (row + 8).min(log.len() - 1)].map(|row| log.q[1][row]);
            let direction = ((after - before) / (16.0 * period) / 0.02).tanh();
            let on = (row as f64 * period) % 1.7 < 0.5;
            *tau += if on { drag * direction } else { 0.0 };
        }
    });
    assert_eq!((code, &found["verdict"]), (Some(2), &Value::from("unexplained")), "{text}");
    assert!(causes(&found).iter().all(|(_, confidence)| *confidence < 0.6), "{text}");
}

/// Friction that builds up over a tenth of a second beside wrong values, which leave it eight times its joint's noise and 2 % of the gap as
/// given: they were the answer (`parameter`), whatever they left.
#[test]
fn what_little_wrong_values_leave_on_one_joint_is_unexplained_too() {
    let Some(wrong) = shared("data/practice-wrong-nominal/case-15") else { return };
    let (code, text, found) = told(&wrong, |log: &mut Log, tau: &mut [Vec<f64>]| {
        let (period, mut built_up) = (log.median_step_s(), 0.0);
        for (row, tau) in tau[2].iter_mut().enumerate() {
            let [before, after] = [row.saturating_sub(8), (row + 8).min(log.len() - 1)];
            let speed = (log.q[2][after] - log.q[2][before]) / ((after - before) as f64 * period);
            built_up += period / 0.1 * ((speed / 0.004).tanh() - built_up);
            *tau += 5.0 * built_up;
        }
    });
    assert_eq!((code, &found["verdict"]), (Some(2), &Value::from("unexplained")), "{text}");
    assert!(text.contains("hysteresis in parallel to friction on elbow_joint"), "{text}");
}

/// Three waves a turn over a part of one: a lever whose terms are some times their sum bends like it, and was a counterbalance for sure (0.97).
#[test]
fn a_few_waves_a_turn_are_no_counterbalance_for_sure() {
    let Some(sound) = shared("data/practice/case-24") else { return };
    let (_, text, found) = told(&sound, |log: &mut Log, tau: &mut [Vec<f64>]| {
        tau[2].iter_mut().zip(&log.q[2]).for_each(|(tau, q)| *tau += 5.0 * (3.0 * q).sin());
    });
    assert!(causes(&found).iter().all(|(_, confidence)| *confidence < 0.5), "{text}");
}

/// A lever whose two terms cancel all but a little bends like it, and left 1.2 times the noise: a counterbalance (0.97) where there is no
/// weight to balance.
#[test]
fn a_law_of_the_angle_about_gravity_is_no_counterbalance_for_sure() {
    let Some(sound) = shared("data/practice/case-24") else { return };
    let (_, text, found) = told(&sound, |log: &mut Log, tau: &mut [Vec<f64>]| {
        tau[0].iter_mut().zip(&log.q[0]).for_each(|(tau, q)| *tau += 12.0 * (3.0 * q).sin());
    });
    assert!(causes(&found).iter().all(|(_, confidence)| *confidence < 0.6), "{:?}: {text}", causes(&found));
    assert_ne!(found["verdict"], "no_gap", "{text}");
}

/// Two zeros at once: gravity upside down (0.97), with which the sealed run was as bad as without.
#[test]
fn gravity_is_not_told_where_it_does_not_help() {
    let Some(sound) = shared("data/practice/case-18") else { return };
    let (_, text, found) = told(&sound, |log, tau| [1, 2].iter().for_each(|j| turn(*j, FRAC_PI_2)(log, tau)));
    let sure: Vec<_> = causes(&found).into_iter().filter(|(_, confidence)| *confidence > 0.6).collect();
    assert!(sure.is_empty(), "{text}");
}

/// Takes the gravity of bodies with these links out of torque, each joint's share of it.
fn without_gravity<'a>(
    arm: &'a Arm,
    links: &'a [[f64; 10]],
    share: &'a [f64],
) -> impl Fn(&mut Log, &mut [Vec<f64>]) + 'a {
    move |log, tau| {
        let still = vec![0.0; arm.dof()];
        let (mut ws, mut weight) = (Workspace::new(arm), still.clone());
        for row in 0..log.len() {
            let q: Vec<f64> = log.q.iter().map(|q| q[row]).collect();
            inverse_dynamics(arm, links, &mut ws, &q, &still, &still, &mut weight);
            let out = weight.iter().zip(share).map(|(weight, share)| share * weight);
            tau.iter_mut().zip(out).for_each(|(tau, out)| tau[row] -= out);
        }
    }
}

/// It was a counterbalance of the second joint, 0.96, then not evaluated. Now it is compared with an arm without gravity: friction is
/// named, and nothing on a sound arm, also where the file's bodies are 15 % too light for what the driver compensates.
#[test]
fn a_torque_without_gravity_is_compared_with_an_arm_without_gravity() {
    let cases = [
        ("case-18", 1.0, None),
        ("case-18", 1.15, None),
        ("case-06", 1.0, Some("stribeck_friction")),
        ("case-08", 1.0, Some("viscous_nonlinearity")),
        ("case-11", 1.15, Some("presliding_friction")),
    ];
    for (name, heavier, effect) in cases {
        let Some(case) = shared(&format!("data/practice/{name}")) else { return };
        let robot = rivet_config::load(case.join("robot.toml")).expect("a sound robot file");
        let arm = &robot.model.arm;
        let mut links = arm.links.clone();
        links.iter_mut().flatten().for_each(|value| *value *= heavier);
        let (code, text, found) = told(&case, |log, tau| {
            with_links(arm, &links)(log, tau);
            without_gravity(arm, &links, &[1.0; 6])(log, tau);
        });
        let findings = found["log"].as_array().expect("findings");
        assert!(findings.iter().any(|finding| finding["fault"] == "gravity_free_torque"), "{name}: {found:#}");
        assert_ne!(code, Some(3), "{name}: {text}");
        let sure: Vec<(&str, f64)> = causes(&found).into_iter().filter(|(_, confidence)| *confidence > 0.6).collect();
        let structure = |(name, _): &&(&str, f64)| !["link_inertia", "rotor_inertia"].contains(name);
        assert!(sure.iter().filter(structure).all(|(named, _)| Some(*named) == effect), "{name}: {text}");
        assert!(effect.is_none_or(|effect| sure.iter().any(|(named, _)| *named == effect)), "{name}: {text}");
    }
}

/// Friction and rotors are identified from a torque without gravity as from the whole one. What gravity alone shows keeps the file's values,
/// and the exported model has its gravity.
#[test]
fn a_torque_without_gravity_identifies_what_gravity_is_not_needed_for() {
    let Some(case) = shared("data/practice/case-18") else { return };
    let file = case.join("robot.toml");
    let robot = rivet_config::load(&file).expect("a sound robot file");
    let arm = &robot.model.arm;
    let folder = tempfile::tempdir().expect("a folder");
    let mut log = read(case.join("log-a.parquet"), &ReadOptions::new(6)).expect("a sound log");
    let mut tau = log.torque().expect("torque").clone();
    without_gravity(arm, &arm.links, &[1.0; 6])(&mut log, &mut tau);
    let logs = [case.join("log-a.parquet"), written(&log, &tau, folder.path())];
    let [whole, without] = [0, 1].map(|k| {
        let (json, export) = (folder.path().join(format!("{k}.json")), folder.path().join(format!("{k}")));
        let mut command = rivet();
        command.arg("identify").args([&file, &logs[k]]).arg("--json").arg(&json).arg("--export").arg(&export);
        let output = command.output().expect("it runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let found: Value = serde_json::from_slice(&std::fs::read(json).expect("read")).expect("JSON");
        (found, rivet_config::load(export.join("model.toml")).expect("a sound model"))
    });
    let warns = |found: &Value| found["warnings"].to_string().contains("gravity_free_torque");
    assert!(!warns(&whole.0) && warns(&without.0), "{:#}", without.0["warnings"]);
    assert_eq!(without.1.model.arm.gravity, robot.model.arm.gravity);
    assert!(without.1.not_excited.contains('m'), "{:?}", without.1.not_excited);
    let values = |model: &rivet_config::Robot| {
        let identified = model.identified.as_ref().expect("identified");
        (identified.values.clone(), identified.std.clone())
    };
    let ((a, std_a), (b, std_b)) = (values(&whole.1), values(&without.1));
    let names: Vec<String> = (0..robot.base.len()).map(|i| robot.base.name(&robot.model, i)).collect();
    let mut compared = 0;
    for (i, name) in names.iter().enumerate().filter(|(_, name)| name.ends_with("coulomb") || name.ends_with("viscous"))
    {
        // Of two logs with the same noise the difference is below what both leave.
        let off = (a[i] - b[i]).abs() / std_a[i].hypot(std_b[i]);
        assert!(off < 4.0, "{name}: {} and {}, {off} standard deviations", a[i], b[i]);
        compared += 1;
    }
    assert_eq!(compared, 12);
}

/// A driver that compensates the gravity of a level base on a tilted one leaves a torque of the pose, as a spring does: a tilt of 0.44 m/s²
/// without gravity was named.
#[test]
fn what_a_driver_compensates_wrongly_is_no_effect_of_the_arm() {
    let Some(case) = shared("data/practice/case-05") else { return };
    let robot = rivet_config::load(case.join("robot.toml")).expect("a sound robot file");
    let arm = &robot.model.arm;
    let (code, text, found) = told(&case, without_gravity(arm, &arm.links, &[1.0; 6]));
    assert_eq!((code, causes(&found)), (Some(3), Vec::new()), "{text}");
    assert!(text.contains("torque is without that of gravity"), "{text}");
}

/// What leaves a fifth of its weight to one joint and takes a fifth more of another's: a driver whose model of gravity is wrong, or a
/// counterbalance. A hose at the flange was named.
#[test]
fn gravity_that_is_not_quite_taken_out_is_no_effect_of_the_arm() {
    let Some(case) = shared("data/practice/case-18") else { return };
    let robot = rivet_config::load(case.join("robot.toml")).expect("a sound robot file");
    let (arm, share) = (&robot.model.arm, [1.0, 0.78, 1.22, 1.0, 1.0, 1.0]);
    let (code, text, found) = told(&case, without_gravity(arm, &arm.links, &share));
    assert_eq!((code, causes(&found)), (Some(3), Vec::new()), "{text}");
    assert!(text.contains("the driver compensates another arm's gravity"), "{text}");
}

/// Of a channel set that holds only noise friction was 0 and a `parameter`.
#[test]
fn channels_of_noise_say_nothing() {
    let Some(sound) = shared("data/practice/case-24") else { return };
    let (code, text, found) = told(&sound, |_, tau| {
        for (j, tau) in tau.iter_mut().enumerate() {
            let mut random = Random(7 + j as u64);
            for tau in tau.iter_mut() {
                *tau = 3.0 * random.uniform();
            }
        }
    });
    assert_eq!((code, &found["verdict"]), (Some(3), &Value::from("not_evaluated")), "{text}");
    assert_eq!(joints_with(&found, "torque_silent").len(), 6, "{text}");
}

/// The floor was ten times too low, and the torque late.
#[test]
fn torque_that_is_held_is_said_and_known_no_better_than_it_comes() {
    let Some(sound) = shared("data/practice/case-24") else { return };
    let (_, as_logged, smooth) = told(&sound, |_, _| ());
    assert_eq!(joints_with(&smooth, "torque_held"), [""; 0], "{as_logged}");
    let (_, text, found) = told(&sound, |_, tau| {
        for tau in tau.iter_mut() {
            (0..tau.len()).for_each(|row| tau[row] = tau[row / 20 * 20]);
        }
    });
    assert_eq!(joints_with(&found, "torque_held").len(), 6, "{text}");
    assert_eq!(joints_with(&found, "torque_late"), [""; 0], "{text}");
    let [floor, of_smooth] = [&found, &smooth].map(|f| f["gap"]["noise_floor"].as_f64().expect("a floor"));
    assert!(floor > 0.9 * of_smooth, "{floor} {of_smooth}");
    assert_eq!(causes(&found), [], "{text}");
}

/// It was `several`, with 35 times the noise left.
#[test]
fn joints_in_each_others_place_are_said_and_not_evaluated() {
    let Some(sound) = shared("data/practice/case-24") else { return };
    let (code, text, found) = told(&sound, |log, tau| {
        log.q.swap(1, 2);
        tau.swap(1, 2);
    });
    assert_eq!((code, &found["verdict"]), (Some(3), &Value::from("not_evaluated")), "{text}");
    assert_eq!(joints_with(&found, "joints_exchanged"), ["shoulder_lift_joint", "elbow_joint"], "{text}");
}

/// A spring that softens: it was a counterbalance, with three times the noise left on the joint.
#[test]
fn a_spring_that_softens_is_no_counterbalance() {
    let Some(sound) = shared("data/practice/case-24") else { return };
    let (_, text, found) = told(&sound, |log, tau| {
        tau[2].iter_mut().zip(&log.q[2]).for_each(|(tau, q)| *tau += 10.0 * (3.0 * (q + 0.3)).tanh());
    });
    assert_eq!(causes(&found), [], "{text}");
    assert_eq!(found["verdict"], "unexplained", "{text}");
}

/// A gripper of 1.4 kg whose centre of mass stands a quarter turn from where its file has it: a zero of the last joint (0.97) would explain it
/// as well, and shift what was right.
#[test]
fn a_tool_that_is_mounted_turned_is_no_zero() {
    let Some(sound) = shared("data/practice/case-24") else { return };
    let urdf = std::fs::read_to_string(sound.join("robot.urdf")).expect("a model");
    let (place, mass) = ("<origin xyz=\"0.0 0.0 -0.026\" rpy=\"0.0 0.0 0.0\"/>\n      <mass", "\"0.615\"");
    assert!(urdf.matches(place).count() == 1 && urdf.matches(mass).count() == 1);
    let with = |tool: &str| {
        let folder = tempfile::tempdir().expect("a folder");
        let place = place.replace("0.0 0.0 -0.026", tool);
        let text = urdf.replace("<origin xyz=\"0.0 0.0 -0.026\" rpy=\"0.0 0.0 0.0\"/>\n      <mass", &place);
        std::fs::write(folder.path().join("robot.urdf"), text.replace(mass, "\"2.0\"")).expect("written");
        for file in ["robot.toml", "log-a.parquet", "log-b.parquet"] {
            std::fs::copy(sound.join(file), folder.path().join(file)).expect("copied");
        }
        folder
    };
    let [file, truth] = ["0.06 0.0 0.05", "0.0 0.06 0.05"].map(with);
    let load =
        |folder: &Path| rivet_config::load(folder.join("robot.toml")).expect("a sound robot file").model.arm.clone();
    let (without, turned) = (load(&sound), load(truth.path()));
    let (_, text, found) = told(file.path(), |log, tau| {
        // Along the plan, which the arm follows within a millisecond: differences of positions are noise.
        let plan = [&log.q_des, &log.qd_des, &log.qdd_des].map(|signals| signals.as_ref().expect("a plan"));
        let mut more = [vec![0.0; tau.len()], vec![0.0; tau.len()]];
        for row in 0..log.len() {
            let [q, qd, qdd] = plan.map(|signals| signals.iter().map(|signal| signal[row]).collect::<Vec<f64>>());
            for (arm, torque) in [&turned, &without].into_iter().zip(&mut more) {
                inverse_dynamics(arm, &arm.links, &mut Workspace::new(arm), &q, &qd, &qdd, torque);
            }
            tau.iter_mut().enumerate().for_each(|(j, tau)| tau[row] += more[0][j] - more[1][j]);
        }
    });
    assert!(causes(&found).iter().all(|(name, _)| *name != "encoder_offset"), "{text}");
    assert!(causes(&found).iter().any(|(name, _)| *name == "link_inertia"), "{text}");
}

/// What is said of a sound case whose arm has other bodies than its file; `change`: links as the file has them.
fn told_with(case: &str, change: impl Fn(&mut [[f64; 10]])) -> Option<(String, Value)> {
    let sound = shared(&format!("data/practice/{case}"))?;
    let robot = rivet_config::load(sound.join("robot.toml")).expect("a sound robot file");
    let mut links = robot.model.arm.links.clone();
    change(&mut links);
    let (_, text, found) = told(&sound, with_links(&robot.model.arm, &links));
    Some((text, found))
}

/// Adds to torque what bodies of `arm` with these links make along a log beside those of its file.
fn with_links(arm: &Arm, links: &[[f64; 10]]) -> impl Fn(&mut Log, &mut [Vec<f64>]) {
    move |log, tau| {
        let rate = |signal: &[f64]| -> Vec<f64> {
            let step = log.t[1] - log.t[0];
            let of = |k: usize| {
                let (before, after) = (k.saturating_sub(1), (k + 1).min(signal.len() - 1));
                (signal[after] - signal[before]) / ((after - before) as f64 * step)
            };
            (0..signal.len()).map(of).collect()
        };
        let speeds: Vec<Vec<f64>> = log.q.iter().map(|q| rate(q)).collect();
        let accelerations: Vec<Vec<f64>> = speeds.iter().map(|qd| rate(qd)).collect();
        let (mut ws, mut torque) = (Workspace::new(arm), vec![0.0; arm.dof()]);
        for row in 0..log.len() {
            let [q, qd, qdd] =
                [&log.q, &speeds, &accelerations].map(|of| of.iter().map(|s| s[row]).collect::<Vec<f64>>());
            for (links, sign) in [(links, 1.0), (&arm.links[..], -1.0)] {
                inverse_dynamics(arm, links, &mut ws, &q, &qd, &qdd, &mut torque);
                tau.iter_mut().zip(&torque).for_each(|(tau, own)| tau[row] += sign * own);
            }
        }
    }
}

/// The upper arm's centre on the other side of the shoulder was a counterbalance with 0.97.
#[test]
fn a_counterbalance_that_may_be_a_body_is_a_class_with_it() {
    let found = told_with("case-24", |links| links[1][1..4].iter_mut().for_each(|moment| *moment *= -1.0));
    let Some((text, found)) = found else { return };
    let holds_it = |cause: &Value| {
        let own = |effect: &Value| effect == "link_inertia";
        let class = cause["indistinguishable_from"].as_array().expect("a list");
        own(&cause["effect"]) || class.iter().any(own)
    };
    let list = found["causes"].as_array().expect("causes");
    assert!(!list.is_empty() && list.iter().all(holds_it), "{text}");
}

/// What a weight of 20 N m pulls is within what values of three links may be off: they alone were told, and nothing else was thought of.
#[test]
fn wrong_values_that_may_be_a_counterbalance_are_a_class_with_it() {
    let Some(sound) = shared("data/practice-wrong-nominal/case-15") else { return };
    let classes = |torque: f64| {
        let (_, text, found) = told(&sound, |log, tau| {
            tau[1].iter_mut().zip(&log.q[1]).for_each(|(tau, q)| *tau += torque * (q - 0.3).sin());
        });
        let list = found["causes"].as_array().expect("causes").iter();
        let links = list.filter(|c| c["effect"] == "link_inertia");
        (links.map(|c| c["indistinguishable_from"].clone()).collect::<Vec<Value>>(), text)
    };
    let (none, text) = classes(0.0);
    assert!(none.iter().all(|class| class == &Value::from(Vec::<Value>::new())), "{text}");
    let (with, text) = classes(20.0);
    assert_eq!(with, [Value::from(vec!["counterbalance"])], "{text}");
}

/// On a planar arm a load at the flange is the last link's, and what it has no column for is not felt: it was not thought of there.
#[test]
fn a_load_on_a_planar_arm_is_a_class_with_its_last_link() {
    let robot = rivet_config::load(robot("dd2")).expect("a sound robot file");
    let (arm, drive) = (&robot.model.arm, &robot.config.friction);
    let mut links = arm.links.clone();
    // 1.5 kg, 0.3 m from the second joint.
    for (at, more) in [1.5, 1.5 * 0.3, 0.0, 0.0, 0.0, 0.0, 1.5 * 0.09, 0.0, 0.0, 1.5 * 0.09].into_iter().enumerate() {
        links[1][at] += more;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let (mut random, mut ws) = (Random(5), Workspace::new(arm));
    let mut command = rivet();
    command.arg("diagnose").arg(&robot.config.path);
    for (name, waves) in [("log-a", [0.31, 0.83]), ("log-b", [0.43, 0.71])] {
        let mut columns: Vec<(String, Vec<f64>)> =
            ["t", "q1", "q2", "tau1", "tau2"].map(|name| (name.to_owned(), Vec::new())).to_vec();
        for k in 0..15_000 {
            let t = 2e-3 * f64::from(k);
            // Angle, speed and acceleration of two sines a joint.
            let of = |j: usize| {
                let (a, b) = (TAU * waves[j], TAU * (waves[j] + 0.37 + 0.2 * j as f64));
                let (x, y) = ((a * t).sin_cos(), (b * t + 1.0).sin_cos());
                [0.7 * x.0 + 0.3 * y.0, 0.7 * a * x.1 + 0.3 * b * y.1, -0.7 * a * a * x.0 - 0.3 * b * b * y.0]
            };
            let [first, second] = [of(0), of(1)];
            let [q, qd, qdd] = [0, 1, 2].map(|of| [first[of], second[of]]);
            let mut tau = [0.0; 2];
            inverse_dynamics(arm, &links, &mut ws, &q, &qd, &qdd, &mut tau);
            columns[0].1.push(t);
            for j in 0..2 {
                let friction = drive.viscous[j] * qd[j] + drive.coulomb[j] * (qd[j] / 0.004).tanh();
                columns[1 + j].1.push(q[j] + 1e-6 * random.normal());
                columns[3 + j].1.push(tau[j] + friction + [0.1, 0.02][j] * random.normal());
            }
        }
        let path = folder.path().join(name).with_extension("parquet");
        let columns: Vec<(String, &[f64])> = columns.iter().map(|(name, of)| (name.clone(), &of[..])).collect();
        write_columns(&path, &columns).expect("written");
        command.arg(path);
    }
    let (_, text, found) = answer(&mut command, folder.path());
    let list = found["causes"].as_array().expect("causes");
    let is = |effect: &Value| effect == "payload";
    let holds = |c: &Value| is(&c["effect"]) || c["indistinguishable_from"].as_array().expect("a list").iter().any(is);
    assert!(list.len() == 1 && holds(&list[0]), "{text}");
}

/// A load of twice what the arm may carry was another unit of torque of the elbow.
#[test]
fn a_heavy_load_is_no_other_unit_of_torque() {
    let found = told_with("case-24", |links| {
        for (at, more) in [25.0, 25.0 * 0.25, 0.0, 25.0 * 0.1].into_iter().enumerate() {
            links[5][at] += more;
        }
    });
    let Some((text, found)) = found else { return };
    assert_eq!(joints_with(&found, "torque_scale"), [""; 0], "{text}");
    assert!(causes(&found).contains(&("payload", 0.97)), "{text}");
    let mass = found["causes"][0]["magnitude"]["mass_kg"].as_f64().expect("a mass");
    assert!((mass - 25.0).abs() < 2.5, "{mass}");
}

/// Bodies of a fifth of the file's mass were a torque that gravity was taken out of.
#[test]
fn bodies_far_lighter_than_the_files_are_no_torque_without_gravity() {
    let found = told_with("case-18", |links| links.iter_mut().flatten().for_each(|value| *value *= 0.2));
    let Some((text, found)) = found else { return };
    assert_eq!(joints_with(&found, "torque_without_gravity"), [""; 0], "{text}");
    let structure = causes(&found).into_iter().filter(|(effect, confidence)| {
        !["link_inertia", "rotor_inertia", "payload"].contains(effect) && *confidence > 0.6
    });
    assert_eq!(structure.count(), 0, "{text}");
}

/// Torque that was repeated for some seconds while the joint went on was a gap that nobody knew.
#[test]
fn torque_that_stands_is_left_out_and_told() {
    let Some(practice) = shared("data/practice") else { return };
    let (code, text, found) = told(&practice.join("case-18"), |log, tau| {
        let rate = 1.0 / log.median_step_s();
        let [from, to] = [2.0, 3.0].map(|t| (t * rate) as usize);
        let last = tau[2][from];
        tau[2][from..to].fill(last);
    });
    assert_eq!((code, &found["verdict"]), (Some(0), &Value::from("no_gap")), "{text}");
    assert_eq!(joints_with(&found, "torque_stood").len(), 1, "{text}");
    assert!(text.contains("torque is constant to the bit while the joint moves: 2.0"), "{text}");
}

/// Over little motion less Coulomb and more viscous friction are nearly one line: each alone made the sealed run worse, so that a Coulomb
/// friction 40 % off was withdrawn.
#[test]
fn drive_values_that_make_up_for_each_other_are_both_told() {
    let Some(sound) = shared("data/practice").map(|folder| folder.join("case-24")) else { return };
    let friction = |line: &str| {
        let times = match line.split(' ').next() {
            Some("coulomb") => 0.6,
            Some("viscous") => 1.4,
            _ => return line.to_owned(),
        };
        let (before, rest) = line.split_once('[').expect("a list");
        let (list, after) = rest.split_once(']').expect("its end");
        let value = |v: &str| (v.trim().parse::<f64>().expect("a number") * times).to_string();
        format!("{before}[{}]{after}", list.split(',').map(value).collect::<Vec<_>>().join(", "))
    };
    let file = |given: &str| given.lines().map(friction).collect::<Vec<_>>().join("\n");
    let (_, text, found) = told_by_file(&sound, file, |_, _| ());
    assert_eq!(found["verdict"], "parameter", "{text}");
    let causes = found["causes"].as_array().expect("causes");
    for value in ["coulomb_friction", "viscous_friction"] {
        let named: Vec<&Value> = causes.iter().filter(|c| c["effect"] == value).collect();
        let joints: usize = named.iter().map(|c| c["joints"].as_array().expect("joints").len()).sum();
        assert_eq!(joints, 6, "{value}: {text}");
    }
}
