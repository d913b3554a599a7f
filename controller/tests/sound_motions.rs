//! Arms that were not met before, in motions that were recorded on them: nothing is wrong, and nothing is stopped.

mod common;

use common::rig::{Motion, Recorded, Rig, Swing, Wrong};
use rivet_config::Robot;
use rivet_dynamics::Joint;
use std::io::Write as _;
use std::path::Path;

/// Half of the triangle by which recorded positions are smoothed \[s\]: planners do not plan encoder steps.
const SMOOTHING_S: f64 = 0.04;
/// Longest part of a record \[s\].
const LONGEST_S: f64 = 4.0;

/// Largest planned speed, in parts of the joints' limits.
const SHARE: f64 = 0.8;
/// Motions are slower by this, at least: the arms of the records had drives without limits.
const SLOWER: f64 = 2.5;

/// Positions of a record up to its first break, smoothed twice by a moving average, and slowed down until every joint keeps its speed
/// limit.
fn recorded(log: &Path, robot: &Robot) -> Recorded {
    let names: Vec<String> = (1..=robot.dof()).map(|j| format!("q{j}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let (period_s, joints) = (robot.config.sample_period_s, &robot.model.arm.joints);
    let q = rivet_logs::read_columns(log, &names).expect("a log with positions");
    let breaks = |(q, joint): (&Vec<f64>, &Joint)| {
        q.windows(2).position(|two| (two[1] - two[0]).abs() > 10.0 * joint.velocity * period_s)
    };
    let whole = q.iter().zip(joints).filter_map(breaks).min().unwrap_or(usize::MAX);
    let rows = whole.min((LONGEST_S / period_s) as usize);
    let half = (0.5 * SMOOTHING_S / period_s).round() as usize;
    let smooth = |q: &[f64]| -> Vec<f64> {
        q.windows(2 * half + 1).map(|part| part.iter().sum::<f64>() / part.len() as f64).collect()
    };
    let q: Vec<Vec<f64>> = q.iter().map(|q| smooth(&smooth(&q[..q.len().min(rows)]))).collect();
    let speed = |(q, joint): (&Vec<f64>, &Joint)| {
        q.windows(2).map(|two| (two[1] - two[0]).abs() / period_s / joint.velocity).fold(0.0, f64::max)
    };
    let slower = q.iter().zip(joints).map(speed).fold(0.0, f64::max) / SHARE;
    Recorded { q, period_s: slower.max(SLOWER) * period_s }
}

/// Follows the recorded motions of every third case in a folder of `../shared/data`, with friction of half to 1.6 times the file's.
fn follows(folder: &str) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data").join(folder);
    let Ok(entries) = std::fs::read_dir(&root) else {
        let _ = writeln!(std::io::stderr(), "SKIPPED: ../shared/data/{folder} is not on this machine");
        return;
    };
    let mut cases: Vec<_> = entries.flatten().map(|entry| entry.path()).filter(|path| path.is_dir()).collect();
    cases.sort();
    let mut stopped = Vec::new();
    for (case, factor) in cases.iter().step_by(3).zip([0.5, 1.0, 1.6].into_iter().cycle()) {
        let robot = rivet_config::load(case.join("robot.toml")).expect("a valid robot file");
        let motion = recorded(&case.join("log-a.parquet"), &robot);
        let span_s = motion.q[0].len() as f64 * motion.period_s;
        let rig = Rig::of(robot, Motion::Recorded(motion));
        let mut rig = rig.differing(|physics| {
            for joint in &mut physics.joints {
                joint.dry.coulomb *= factor;
                joint.dry.stribeck = [0.25 * joint.dry.coulomb, 0.02];
            }
        });
        let o = rig.run(0.0, Wrong::Nothing, span_s, |_, _| ());
        let refused = rig.core.counts().setpoints_refused;
        println!("{} x{factor}: {:?} {refused} refused", case.display(), o.stop);
        if o.stops > 0 || refused > 0 {
            stopped.push(format!("{} x{factor}: {o:?}, {refused} refused", case.display()));
        }
    }
    assert!(cases.len() >= 10, "{} cases", cases.len());
    assert!(stopped.is_empty(), "{stopped:#?}");
}

#[test]
fn recorded_motions_are_followed() {
    follows("practice");
}

#[test]
fn recorded_motions_are_followed_with_wrong_files() {
    follows("practice-wrong-nominal");
}

/// A step of an encoder of 14 bits \[rad\].
const STEP: f64 = 4e-4;

/// Gears whose friction takes a good part of the drive's torque, on arms whose file has less of it or none: what a joint at its turning point
/// holds before it goes back is friction, not an encoder that is frozen.
#[test]
fn joints_with_more_friction_than_their_file_has_are_not_stopped() {
    let mut stopped = Vec::new();
    for arm in ["manutec-r3", "staubli-tx40", "ur10e", "dd2"] {
        for is_known in [true, false] {
            for factor in [1.5, 2.0, 2.5] {
                for share in [0.1, 0.4] {
                    let mut robot = Rig::new(arm, 0.001, "", share).robot;
                    let coulomb = robot.config.friction.coulomb.clone();
                    if !is_known {
                        robot.config.friction.coulomb.fill(0.0);
                    }
                    // What a joint yields before it slides is less than a step of this encoder: its readings repeat.
                    robot.config.drive.encoder_resolution.fill(STEP);
                    let motion = Motion::Swing(Swing::new(&robot, share));
                    let limits = robot.config.drive.torque_limit.clone();
                    let mut rig = Rig::of(robot, motion).differing(|physics| {
                        for (j, joint) in physics.joints.iter_mut().enumerate() {
                            // Half of the limit is left for everything else.
                            joint.dry.coulomb = (factor * coulomb[j]).min(0.4 * limits[j]);
                            joint.dry.stribeck = [0.25 * joint.dry.coulomb, 0.02];
                        }
                    });
                    let o = rig.run(0.0, Wrong::Nothing, 8.0, |_, _| ());
                    let known = if is_known { "known" } else { "0 in the file" };
                    println!("{arm}, friction times {factor}, {known}, {share} of the speed: {:?}", o.stop);
                    if o.stops > 0 {
                        stopped.push(format!("{arm} x{factor}, {known}, {share} of the speed: {o:?}"));
                    }
                }
            }
        }
    }
    assert!(stopped.is_empty(), "{stopped:#?}");
}

/// Parts of each drive's torque limit: Coulomb friction, and what Stribeck friction adds at standstill.
const DRY: [f64; 2] = [0.25, 0.1];
/// Velocity of that Stribeck friction \[rad/s\].
const STRIBECK_VELOCITY: f64 = 0.05;

/// The robot of a file with this friction.
fn with_friction(arm: &str, has_stribeck: bool) -> Robot {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots").join(arm).join("robot.toml");
    let text = std::fs::read_to_string(&file).expect("the robot file");
    let limits = &rivet_config::parse(&file, &text).expect("a sound file").config.drive.torque_limit;
    let of_limit = |share: f64| limits.iter().map(|limit| share * limit).collect::<Vec<f64>>();
    let coulomb = format!("coulomb = {:?}", of_limit(DRY[0]));
    let line = |line: &str| if line.starts_with("coulomb = [") { coulomb.clone() } else { line.to_owned() };
    let mut lines: Vec<String> = text.lines().map(line).collect();
    if has_stribeck {
        let velocity = vec![STRIBECK_VELOCITY; limits.len()];
        lines.push("[effects.stribeck_friction]".to_owned());
        lines.push(format!("excess = {:?}\nvelocity = {velocity:?}", of_limit(DRY[1])));
    }
    let text = lines.join("\n");
    rivet_config::parse(&file, &text).expect("the changed file is sound")
}

/// Friction that turns round with a joint is not what the rate limit takes from the joint's acceleration: the joint stands until the
/// torque has turned round, and is then where the plan was. Its reference does not run away meanwhile.
#[test]
fn friction_that_the_file_has_moves_no_reference() {
    /// Part of the torque limit by which commands may change, a sample.
    const RATE: f64 = 0.01;
    /// Times the way of the plan that an arm may be off: feedback catches up, and friction is not that of the file in the first millimetre.
    const CATCHING_UP: f64 = 3.0;
    for arm in ["manutec-r3", "ur10e"] {
        for has_stribeck in [false, true] {
            let robot = with_friction(arm, has_stribeck);
            let swing = Swing::new(&robot, 0.4);
            let turns_by = 2.0 * (DRY[0] + if has_stribeck { DRY[1] } else { 0.0 });
            let stands_s = turns_by / RATE * robot.config.sample_period_s;
            let hardest = swing.amplitude.iter().zip(&swing.omega).map(|(a, w)| a * w * w).fold(0.0, f64::max);
            let missed = 0.5 * hardest * stands_s.powi(2);
            let limits = robot.config.drive.torque_limit.clone();
            let mut rig = Rig::of(robot, Motion::Swing(swing)).differing(|physics| {
                for (joint, limit) in physics.joints.iter_mut().zip(&limits).filter(|_| has_stribeck) {
                    joint.dry.stribeck = [DRY[1] * limit, STRIBECK_VELOCITY];
                }
            });
            let o = rig.run(0.0, Wrong::Nothing, 8.0, |_, _| ());
            println!(
                "{arm}, Stribeck {has_stribeck}: {:.4} rad off, the plan moves {missed:.4} rad, {:?}",
                o.away, o.stop
            );
            assert!(o.stops == 0 && o.away < CATCHING_UP * missed, "{arm}, Stribeck {has_stribeck}: {o:?}");
        }
    }
}
