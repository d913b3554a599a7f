//! Encoders that show a part of the motion: what can be known of them, and from which part on they are found.
//!
//! A joint whose encoder shows the part `f` of its way needs, at each reading, the torque `τ(q₀ + (q − q₀)/f) − τ(q)` more than its reading
//! does. That is what a load or a contact adds. It is found where it exceeds what those may be.

mod common;

use common::rig::{Motion, Rig, Swing, Wrong};
use rivet_config::Robot;
use rivet_controller::law::{ControlLaw, Gains};
use rivet_dynamics::{MAX_JOINTS, Workspace, mass_matrix};
use std::sync::Arc;

/// Largest planned speed, in parts of the joints' limits.
const SHARE: f64 = 0.4;
/// Time of a run \[s\]: every joint turns round at least once.
const RUN_S: f64 = 4.0;

/// An encoder that shows 0.3 of the motion and a sound one on a joint with 1/0.3 of the inertia and viscous friction: the readings are the
/// same, and so are the commands. No check of readings and torques can find the one and pass the other.
#[test]
fn readings_of_a_wrong_scale_are_those_of_a_heavier_joint() {
    const PART: f64 = 0.3;
    let joint = 5;
    let end = |is_wrong: bool| {
        let rig = Rig::new("ur10e", 0.001, "", SHARE);
        let centre = Motion::Swing(Swing::new(&rig.robot, SHARE)).centre();
        let (arm, n) = (rig.robot.model.arm.clone(), rig.robot.dof());
        let mut mass = vec![0.0; n * n];
        mass_matrix(&arm, &arm.links, &mut Workspace::new(&arm), &centre, &mut mass);
        let link = mass[joint * n + joint];
        let mut rig = rig.differing(|physics| {
            let joint = &mut physics.joints[joint];
            if !is_wrong {
                joint.rotor_inertia = (joint.rotor_inertia + link) / PART - link;
                joint.viscous /= PART;
            }
        });
        let wrong = if is_wrong { Wrong::Scaled(joint, PART) } else { Wrong::Nothing };
        let o = rig.run(0.0, wrong, 0.6 * RUN_S, |_, _| ());
        assert_eq!(o.stops, 0, "{o:?}");
        rig.position()[joint] - centre[joint]
    };
    let [way, heavy] = [end(true), end(false)];
    println!("ways of {way:.4} and {heavy:.4} rad, readings of {:.4} and {heavy:.4} rad", PART * way);
    assert!(way.abs() > 0.5, "{way} rad");
    assert!((PART * way - heavy).abs() < 0.004, "{} and {heavy} rad", PART * way);
}

fn law(robot: &Robot) -> ControlLaw {
    let settings = &robot.config.controller;
    let gains = Gains::from_bandwidth(&settings.bandwidth_hz, settings.damping, settings.integral_hz);
    let (model, base) = (Arc::clone(&robot.model), Arc::clone(&robot.base));
    ControlLaw::new(settings.law, model, base, robot.base_parameters(), gains, robot.config.sample_period_s)
}

/// The time after six seconds of motion at which `joint` turns round \[s\]: nothing jumps where its encoder goes wrong.
fn turning_s(motion: &Motion, joint: usize) -> f64 {
    let speed = |k: &u32| (1e6 * motion.at(f64::from(*k) * 0.004)[1][joint].abs()) as u64;
    f64::from((1500..2500).min_by_key(speed).expect("times")) * 0.004
}

/// Largest torque that is missed on `joint` where its encoder shows `part` of the plan from `begin_s` on, beyond the mean of a second \[N·m\].
fn missed(robot: &Robot, motion: &Motion, joint: usize, begin_s: f64, part: f64) -> f64 {
    const STEP_S: f64 = 0.002;
    let (n, x, mut law) = (robot.dof(), robot.base_parameters(), law(robot));
    let (begin, mut mean, mut most) = (motion.at(begin_s)[0], 0.0, 0.0_f64);
    for k in 0..(RUN_S / STEP_S) as usize {
        let plan = motion.at(begin_s + k as f64 * STEP_S);
        let mut moved = plan;
        moved[0][joint] = begin[joint] + (plan[0][joint] - begin[joint]) / part;
        for values in &mut moved[1..] {
            values[joint] /= part;
        }
        let [mut seen, mut needed] = [[0.0; MAX_JOINTS]; 2];
        law.model_torque(&plan[0][..n], &plan[1][..n], &plan[2][..n], x, &mut seen[..n]);
        law.model_torque(&moved[0][..n], &moved[1][..n], &moved[2][..n], x, &mut needed[..n]);
        let beyond = needed[joint] - seen[joint] - mean;
        mean += STEP_S * beyond;
        most = most.max(beyond.abs());
    }
    most
}

/// The largest of `parts` between 0.02 and 1 for which `is_found`, by bisection.
fn largest_part(is_found: impl Fn(f64) -> bool) -> f64 {
    let (mut found, mut missed) = (0.02, 1.0);
    for _ in 0..9 {
        let part = f64::sqrt(found * missed);
        if is_found(part) {
            found = part;
        } else {
            missed = part;
        }
    }
    found
}

/// The part from which on an encoder is found is the one at which its torque exceeds what loads and contacts may be: neither the check nor
/// the bound can do better without stopping arms that are loaded.
#[test]
fn a_wrong_scale_is_found_where_loads_and_contacts_end() {
    for (arm, joint) in [("ur10e", 0), ("ur10e", 5), ("dd2", 0)] {
        for share in [0.2, 0.5] {
            let words = format!("unmodelled_torque = {share}\ntracking_error = 10\nsaturation_ms = 10000\n");
            let rig = || Rig::new(arm, 0.004, &words, SHARE);
            let robot = rig().robot;
            let motion = Motion::Swing(Swing::new(&robot, SHARE));
            let begin_s = turning_s(&motion, joint);
            let most = share * robot.config.drive.torque_limit[joint];
            let derived = largest_part(|part| missed(&robot, &motion, joint, begin_s, part) > most);
            let measured =
                largest_part(|part| rig().run(begin_s, Wrong::Scaled(joint, part), RUN_S, |_, _| ()).stop.is_some());
            println!("{arm}, joint {}, {share} of the torque: from {measured:.3} on, derived {derived:.3}", joint + 1);
            assert!((measured / derived).ln().abs() < f64::ln(1.3), "{arm}, joint {}, {share}", joint + 1);
        }
    }
}
