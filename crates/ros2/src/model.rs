//! The consistent model on the graph: the URDF with identified values, and the payload.

use rivet_config::Robot;
use rivet_dynamics::{LinkParameters, Parameter, UrdfArm, UrdfError, flange_pose, write_urdf};
use rivet_ipc_schema::ConsistentParameters;

use crate::joints::{listed, one_line, shown};
use crate::messages::{Vector3, Wrench};

/// Longest part of an error that is shown \[characters\].
const MOST_CHARACTERS: usize = 240;
/// Numbers of a body.
const BODY: usize = 10;
/// Bodies and frames that differ by a smaller share, or by less than this in m, kg and their products, are the same.
const SAME: f64 = 1e-6;

fn body(set: &ConsistentParameters, joint: usize) -> LinkParameters {
    std::array::from_fn(|k| set.bodies.get(BODY * joint + k).copied().unwrap_or(0.0))
}

/// The URDF `text` of the robot file with the bodies and the friction of `set`.
///
/// # Errors
/// The text is no arm, or a body has no mass.
pub fn consistent_urdf(robot: &Robot, text: &str, set: &ConsistentParameters) -> Result<String, UrdfError> {
    let bodies: Vec<LinkParameters> = (0..robot.model.arm.dof()).map(|j| body(set, j)).collect();
    let mut drives = robot.config.nominal_joints();
    for (i, &value) in set.values.iter().enumerate().take(robot.base.len().min(set.count as usize)) {
        match robot.base.parameter(&robot.model, i) {
            Parameter::Viscous(j) => drives.viscous[j] = value,
            Parameter::Coulomb(j) => drives.coulomb[j] = value,
            _ => {}
        }
    }
    Ok(write_urdf(text, &robot.config.urdf_options, &bodies, &drives.viscous, &drives.coulomb)?.text)
}

/// The weight of what the last link carries beyond the robot file, as force \[N\] and torque about its frame's origin \[N m\] in the axes
/// of the last link, at the joint positions `q` \[rad, or m\].
///
/// The payload is the last link's identified body less the nominal one.
pub fn payload(robot: &Robot, set: &ConsistentParameters, q: &[f64]) -> Wrench {
    let arm = &robot.model.arm;
    let last = arm.dof() - 1;
    let (found, nominal) = (body(set, last), arm.links[last]);
    let [mass, x, y, z] = std::array::from_fn(|k| found[k] - nominal[k]);
    let (rotation, _) = flange_pose(arm, q);
    // The rotation maps to the root: its columns give components in the link.
    let g: [f64; 3] = std::array::from_fn(|k| (0..3).map(|i| rotation[i][k] * arm.gravity[i]).sum());
    let torque = [y * g[2] - z * g[1], z * g[0] - x * g[2], x * g[1] - y * g[0]];
    Wrench { force: Vector3::from(g.map(|g| mass * g)), torque: Vector3::from(torque) }
}

/// What is different between the URDF `text` and the arm of the robot file; empty where they are the same arm.
///
/// Joints, frames, axes and masses are compared. Limits and meshes are not.
pub fn differences(robot: &Robot, text: &str) -> Vec<String> {
    let arm = &robot.model.arm;
    let other = match UrdfArm::read(text, robot.config.gravity, &robot.config.urdf_options) {
        Ok(read) => read.arm,
        Err(mistakes) => {
            let why = mistakes.all().first().map_or_else(String::new, |mistake| mistake.error.to_string());
            return vec![format!("it is not read as an arm: {}", one_line(&why, MOST_CHARACTERS))];
        }
    };
    let names = |joints: &[rivet_dynamics::Joint]| joints.iter().map(|joint| joint.name.clone()).collect::<Vec<_>>();
    let (expected, found) = (names(&arm.joints), names(&other.joints));
    if expected != found {
        return vec![format!("its joints are {}, the robot file's {}", listed(&found), listed(&expected))];
    }
    let apart =
        |a: &[f64], b: &[f64]| a.iter().zip(b).any(|(a, b)| (a - b).abs() > SAME * (1.0 + a.abs().max(b.abs())));
    let mut out = Vec::new();
    for (j, (a, b)) in arm.joints.iter().zip(&other.joints).enumerate() {
        if a.kind != b.kind || apart(&a.axis, &b.axis) {
            out.push(format!("joint {}: another axis", shown(&a.name)));
        }
        if apart(&a.translation, &b.translation) || apart(a.rotation.as_flattened(), b.rotation.as_flattened()) {
            out.push(format!("joint {}: another frame", shown(&a.name)));
        }
        let masses = (arm.links[j][0], other.links[j][0]);
        if masses.1 > 0.0 && apart(&arm.links[j], &other.links[j]) {
            out.push(format!("link {}: another body, {} kg instead of {} kg", shown(&a.link), masses.1, masses.0));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn robot() -> (Robot, String) {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/arm/robot.toml");
        let robot = rivet_config::load(file).expect("the robot of the examples");
        let text = std::fs::read_to_string(&robot.config.urdf).expect("its URDF");
        (robot, text)
    }

    /// The nominal model as a set.
    fn nominal(robot: &Robot) -> ConsistentParameters {
        let mut set =
            ConsistentParameters { count: robot.base.len() as u32, joints: 1, ..ConsistentParameters::default() };
        set.bodies[..BODY].copy_from_slice(&robot.model.arm.links[0]);
        set.values[..robot.base.len()].copy_from_slice(&robot.nominal_base);
        set
    }

    #[test]
    fn payload_is_the_weight_of_what_is_more() {
        let (robot, _) = robot();
        let mut set = nominal(&robot);
        assert_eq!(payload(&robot, &set, &[0.3]), Wrench::default());
        // 2 kg at 0.5 m along x of the link, which is down at 0 and level at 90 degrees (URDF: rpy 0 90 0).
        set.bodies[0] += 2.0;
        set.bodies[1] += 1.0;
        let g = 9.81;
        for (q, force, torque) in
            [(0.0, [2.0 * g, 0.0, 0.0], 0.0), (std::f64::consts::FRAC_PI_2, [0.0, -2.0 * g, 0.0], -g)]
        {
            let wrench = payload(&robot, &set, &[q]);
            let found = [wrench.force.x, wrench.force.y, wrench.force.z, wrench.torque.z];
            let expected = [force[0], force[1], force[2], torque];
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?} at {q}");
        }
    }

    #[test]
    fn consistent_urdf_has_bodies_and_friction_of_the_set() {
        let (robot, text) = robot();
        let mut set = nominal(&robot);
        set.bodies[0] = 7.5;
        for i in 0..robot.base.len() {
            match robot.base.parameter(&robot.model, i) {
                Parameter::Viscous(0) => set.values[i] = 1.25,
                Parameter::Coulomb(0) => set.values[i] = 2.5,
                _ => {}
            }
        }
        let written = consistent_urdf(&robot, &text, &set).expect("an arm");
        assert!(written.contains("<mass value=\"7.5\"/>"), "{written}");
        assert!(written.contains("<dynamics damping=\"1.25\" friction=\"2.5\"/>"), "{written}");
        assert!(differences(&robot, &written).iter().all(|text| text.contains("another body, 7.5 kg instead of 4 kg")));
    }

    #[test]
    fn detects_another_arm() {
        let (robot, text) = robot();
        assert_eq!(differences(&robot, &text), [""; 0]);
        let joints = differences(&robot, &text.replace("joint_1", "elbow"));
        assert_eq!(joints, ["its joints are elbow, the robot file's joint_1"]);
        let frame = differences(&robot, &text.replace("1.5707963267949", "0.0"));
        assert_eq!(frame, ["joint joint_1: another frame"]);
        let nonsense = differences(&robot, "<robot>");
        assert!(matches!(&nonsense[..], [text] if text.starts_with("it is not read as an arm")), "{nonsense:?}");
    }
}
