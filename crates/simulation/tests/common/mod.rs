//! Arms made by hand, so that these tests depend on no file.
#![allow(dead_code, reason = "each test binary uses its part")]

use rivet_dynamics::{Arm, Joint, JointKind, Joints, Model, Structure, WristCoupling, body_from_com};
use rivet_simulation::{Disturbances, Sensors, Truth};

pub(crate) const GRAVITY: f64 = 9.81;

/// Frame whose z axis is level: turning about it swings in the vertical plane, x level at q = 0.
const LEVEL: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]];
const UPRIGHT: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

fn joint(k: usize, kind: JointKind, rotation: [[f64; 3]; 3], translation: [f64; 3]) -> Joint {
    Joint {
        name: format!("joint_{}", k + 1),
        kind,
        axis: [0.0, 0.0, 1.0],
        rotation,
        translation,
        lower: -3.0,
        upper: 3.0,
        velocity: 3.0,
        effort: 300.0,
        link: format!("link_{}", k + 1),
    }
}

fn arm(name: &str, joints: Vec<Joint>, links: Vec<[f64; 10]>) -> Arm {
    Arm { name: name.to_owned(), joints, links, gravity: [0.0, 0.0, -GRAVITY] }
}

fn sphere(mass: f64, com: [f64; 3], inertia: f64) -> [f64; 10] {
    body_from_com(mass, &com, &[[inertia, 0.0, 0.0], [0.0, inertia, 0.0], [0.0, 0.0, inertia]])
}

/// One joint with a level axis; mass 2 kg at 0.4 m along x, so that gravity needs `m g l cos q`.
pub(crate) fn pendulum() -> Arm {
    arm("pendulum", vec![joint(0, JointKind::Revolute, LEVEL, [0.0; 3])], vec![sphere(2.0, [0.4, 0.0, 0.0], 0.01)])
}

/// One vertical slide with 3 kg.
pub(crate) fn slide() -> Arm {
    arm("slide", vec![joint(0, JointKind::Prismatic, UPRIGHT, [0.0; 3])], vec![sphere(3.0, [0.0; 3], 0.01)])
}

/// Six axes as on an industrial arm: about 40 kg, 1.2 m.
pub(crate) fn six_axes() -> Arm {
    const DOWN: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]];
    let joints = vec![
        joint(0, JointKind::Revolute, UPRIGHT, [0.0, 0.0, 0.3]),
        joint(1, JointKind::Revolute, LEVEL, [0.1, 0.0, 0.1]),
        joint(2, JointKind::Revolute, UPRIGHT, [0.5, 0.0, 0.05]),
        joint(3, JointKind::Revolute, LEVEL, [0.1, 0.02, 0.0]),
        joint(4, JointKind::Revolute, DOWN, [0.0, 0.0, 0.4]),
        joint(5, JointKind::Revolute, LEVEL, [0.0, 0.05, 0.0]),
    ];
    let links = vec![
        sphere(14.0, [0.02, 0.01, -0.05], 0.20),
        sphere(12.0, [0.22, 0.01, 0.04], 0.25),
        sphere(8.0, [0.05, 0.02, 0.03], 0.08),
        sphere(4.0, [0.01, -0.01, 0.15], 0.03),
        sphere(2.0, [0.0, 0.02, 0.01], 0.008),
        sphere(0.8, [0.01, 0.0, 0.04], 0.002),
    ];
    arm("six-axes", joints, links)
}

/// Drive values of `six_axes`, with the wrist coupling of arms such as the TX40.
pub(crate) fn six_drives() -> Joints {
    Joints {
        rotor_inertia: vec![4.0, 4.5, 1.2, 0.3, 0.25, 0.2],
        viscous: vec![12.0, 14.0, 6.0, 2.0, 1.5, 1.2],
        coulomb: vec![9.0, 11.0, 5.0, 2.0, 1.8, 0.6],
        offset: vec![0.3, -0.4, 0.2, 0.0, 0.1, -0.1],
        coupling: [0.02, 0.3, 0.7],
        ..Joints::default()
    }
}

pub(crate) fn six_model(sign_velocity: f64) -> Model {
    let coupling = Some(WristCoupling { driving: 4, driven: 5 });
    Model::new(six_axes(), Structure { offset: true, coupling, sign_velocity, ..Structure::default() })
}

pub(crate) const SIX_LIMITS: [f64; 6] = [300.0, 300.0, 150.0, 60.0, 40.0, 40.0];

/// Drives that do nothing.
pub(crate) fn ideal(arm: Arm) -> (Model, Joints) {
    let n = arm.dof();
    let zero = vec![0.0; n];
    let joints = Joints {
        rotor_inertia: zero.clone(),
        viscous: zero.clone(),
        coulomb: zero.clone(),
        offset: zero,
        coupling: [0.0; 3],
        ..Joints::default()
    };
    (Model::new(arm, Structure::default()), joints)
}

pub(crate) fn truth(model: &Model, joints: &Joints) -> Truth {
    Truth::new(model, joints, &Disturbances::default())
}

/// Six like sensors; torque noise as a share of the limit.
pub(crate) fn six_sensors(resolution: f64, position_noise: f64, torque_noise: f64) -> Sensors {
    Sensors {
        resolution: vec![resolution; 6],
        position_noise: vec![position_noise; 6],
        torque_noise: SIX_LIMITS.iter().map(|limit| torque_noise * limit).collect(),
    }
}
