//! Arms simple enough to be worked out by hand, and one whose authors worked it out in 1988.

use crate::common::{GRAVITY, reference_arm, robots, times};
use nalgebra::{DMatrix, DVector};
use rivet_dynamics::{Arm, JointKind, Workspace, body_from_com, inverse_dynamics, mass_matrix};

fn torque(arm: &Arm, q: &[f64], qd: &[f64], qdd: &[f64]) -> Vec<f64> {
    let mut tau = vec![0.0; arm.dof()];
    inverse_dynamics(arm, &arm.links, &mut Workspace::new(arm), q, qd, qdd, &mut tau);
    tau
}

/// One link on one joint, 3 kg at (0.3, 0, 0) with 0.02 kg·m² about its centre of mass.
fn one_link(joint: &str) -> String {
    format!(
        r#"<robot name="one"><link name="base"/>
        <link name="arm"><inertial><origin xyz="0.3 0 0"/><mass value="3"/>
          <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
        <joint name="j" {joint}<parent link="base"/><child link="arm"/></joint></robot>"#
    )
}

/// Level axis along −y, so that q > 0 lifts the link: τ = (m·l² + I)·q̈ + m·g·l·cos q (Lagrange, by hand).
#[test]
fn pendulum_matches_its_closed_form() {
    let urdf = one_link(r#"type="continuous"><origin xyz="0 0 1"/><axis xyz="0 -2 0"/>"#);
    let arm = Arm::from_urdf(&urdf, GRAVITY).expect("an arm");
    assert_eq!(arm.joints[0].axis, [0.0, -1.0, 0.0]);
    for (q, qd, qdd) in [(0.7_f64, 1.3, -2.1), (-2.4, 0.0, 0.0), (1.6, -8.0, 30.0)] {
        let expected = (3.0 * 0.09 + 0.02) * qdd + 3.0 * 9.81 * 0.3 * q.cos();
        let tau = torque(&arm, &[q], &[qd], &[qdd])[0];
        // A handful of roundings, each of the size of a term.
        assert!((tau - expected).abs() <= 1e-14 * (1.0 + qdd.abs() + 9.0), "{tau} vs {expected}");
    }
}

/// A slide tilted by 30° against the vertical lifts its mass: F = m·(q̈ + g·cos 30°), whatever its speed.
#[test]
fn slide_matches_its_closed_form() {
    let urdf = one_link(r#"type="prismatic"><origin xyz="1 2 3" rpy="0.5235987755982988 0 0"/><axis xyz="0 0 1"/>"#);
    let arm = Arm::from_urdf(&urdf, GRAVITY).expect("an arm");
    assert_eq!(arm.joints[0].kind, JointKind::Prismatic);
    let force = torque(&arm, &[0.4], &[-2.0], &[1.7])[0];
    let expected = 3.0 * (1.7 + 9.81 * 0.75_f64.sqrt());
    assert!((force - expected).abs() <= 1e-14 * expected, "{force} vs {expected}");
}

/// Two links in a vertical plane; closed form and its five parameters as published for this arm.
#[test]
fn two_link_arm_matches_its_closed_form() {
    let (t1, t2, t3) =
        (1.266 + 23.902 * 0.091 * 0.091 + 0.093 + 3.88 * (0.2025 + 0.048 * 0.048), 0.45 * 3.88 * 0.048, {
            0.093 + 3.88 * 0.048 * 0.048
        });
    let (t4, t5) = (9.81 * (23.902 * 0.091 + 3.88 * 0.45), 9.81 * 3.88 * 0.048);
    for (file, with_gravity) in [("dd2/dd2.urdf", 1.0), ("dd2/dd2-horizontal.urdf", 0.0)] {
        let Some(arm) = reference_arm(file) else { return };
        for (q, qd, qdd) in
            [([0.3_f64, -1.2_f64], [2.0, -3.0], [10.0, -4.0]), ([-2.9, 2.2], [-5.0, 6.0], [-30.0, 55.0])]
        {
            let (s2, c2) = q[1].sin_cos();
            let expected = [
                (t1 + 2.0 * t2 * c2) * qdd[0] + (t3 + t2 * c2) * qdd[1]
                    - t2 * s2 * (2.0 * qd[0] * qd[1] + qd[1] * qd[1])
                    + with_gravity * (t4 * q[0].sin() + t5 * (q[0] + q[1]).sin()),
                (t3 + t2 * c2) * qdd[0]
                    + t3 * qdd[1]
                    + t2 * s2 * qd[0] * qd[0]
                    + with_gravity * t5 * (q[0] + q[1]).sin(),
            ];
            let tau = torque(&arm, &q, &qd, &qdd);
            // The URDF's right angles have 15 digits: 5e-15 of gravity leaks into the plane.
            assert!(
                crate::common::distance(&tau, &expected) <= 1e-12 * crate::common::largest(&expected),
                "{tau:?} vs {expected:?}"
            );
        }
    }
}

/// The Manutec r3 with braked wrist: accelerations from its authors' own equations, with their rotor inertias
/// diag(14.3325, 57.33, 4.68) kg·m² and the 0.078 kg·m² of the rotor that sits in arm 2, and a payload 0.98 m out.
#[test]
fn manutec_accelerates_as_its_authors_computed() {
    let Some(arm) = reference_arm("manutec-r3-model2/manutec-r3-model2.urdf") else { return };
    let file = robots().expect("it was there").join("manutec-r3-model2/reference-forward-dynamics.json");
    let reference: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(file).expect("text")).expect("json");
    let states = reference["states"].as_array().expect("list");
    assert_eq!(states.len(), 40);
    for state in states {
        let list = |name: &str| -> Vec<f64> {
            state[name].as_array().expect("list").iter().map(|v| v.as_f64().expect("number")).collect()
        };
        let [q, qd, torque_in, qdd] = ["q", "qd", "torque", "qdd"].map(list);
        let mut loaded = arm.clone();
        let payload = body_from_com(state["payload_kg"].as_f64().expect("number"), &[0.0, 0.0, 0.98], &[[0.0; 3]; 3]);
        loaded.links[2].iter_mut().zip(payload).for_each(|(sum, part)| *sum += part);

        let mut m = vec![0.0; 9];
        mass_matrix(&loaded, &loaded.links, &mut Workspace::new(&loaded), &q, &mut m);
        let rotors = [14.3325, 0.0, 0.0, 0.0, 57.33, 0.078, 0.0, 0.078, 4.68];
        m.iter_mut().zip(rotors).for_each(|(sum, rotor)| *sum += rotor);
        let bias = torque(&loaded, &q, &qd, &[0.0; 3]);
        let left = DVector::from_iterator(3, torque_in.iter().zip(&bias).map(|(a, b)| a - b));
        let ours = DMatrix::from_row_slice(3, 3, &m).lu().solve(&left).expect("M is regular");
        assert!(
            crate::common::distance(ours.as_slice(), &qdd) <= 1e-12 * crate::common::largest(&qdd),
            "{ours} vs {qdd:?}"
        );
        // And backwards: the reference accelerations need the reference torques.
        let mut again = times(&m, &qdd);
        again.iter_mut().zip(&bias).for_each(|(sum, part)| *sum += part);
        assert!(crate::common::distance(&again, &torque_in) <= 1e-12 * crate::common::largest(&torque_in));
    }
}
