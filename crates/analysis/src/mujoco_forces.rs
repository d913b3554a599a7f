//! Torques that MJCF has no place for, as passive forces of MuJoCo in a Python module beside `robot.xml`.

use rivet_config::Robot;
use rivet_dynamics::{EffectKind, KnownEffect};

use crate::runs;

/// The module's file.
pub(crate) const FILE: &str = "mujoco_forces.py";

/// The module; none where every torque has a place in MJCF, or follows from more than position and velocity.
///
/// The sign of friction is `tanh(velocity/friction_velocity)`, as in the robot file. The load of friction that grows with it is MuJoCo's
/// bias force: gravity, centrifugal and Coriolis torque, without acceleration.
pub(crate) fn module(robot: &Robot) -> Option<String> {
    let names = runs::joint_names(robot);
    let forces: Vec<String> = robot
        .model
        .effects()
        .list()
        .iter()
        .filter_map(|effect| Some((effect, torque(effect)?)))
        .map(|(effect, torque)| {
            format!("    ({:?}, {:?}, lambda q, v, s, load: {torque}),\n", effect.kind.name(), names[effect.joint])
        })
        .chain(load_friction(robot, &names))
        .collect();
    let speed = robot.config.signal.friction_velocity;
    (!forces.is_empty()).then(|| {
        format!(
            r#""""Torques that robot.xml has no place for, as passive forces of MuJoCo. Written by rivet.

    import mujoco, mujoco_forces
    model = mujoco.MjModel.from_xml_path("robot.xml")
    mujoco_forces.install()     # in every simulation of this process
"""

from math import cos, exp, sin, sqrt, tanh

# Velocity at which friction changes sign [rad/s].
FRICTION_VELOCITY = {speed:?}

# Effect, joint, torque that the drive needs for it [N m] at position q [rad] and velocity v [rad/s]. s: sign of
# friction; load: torque of gravity and velocity [N m].
FORCES = [
{}]


def sign(v):
    """Sign of friction at velocity v [rad/s]."""
    return tanh(v / FRICTION_VELOCITY) if FRICTION_VELOCITY > 0 else (v > 0) - (v < 0)


def passive(model, data):
    """Takes the torques from the joints' passive forces (callback mjcb_passive)."""
    for _, joint, torque in FORCES:
        j = model.joint(joint).id
        dof = model.jnt_dofadr[j]
        q, v = data.qpos[model.jnt_qposadr[j]], data.qvel[dof]
        data.qfrc_passive[dof] -= torque(q, v, sign(v), data.qfrc_bias[dof])


def install():
    """Makes MuJoCo call `passive` in every step of every model of this process."""
    import mujoco

    mujoco.set_mjcb_passive(passive)
"#,
            forces.concat()
        )
    })
}

/// Torque of an effect as a Python expression; none where MJCF has a place for it, or where it follows from more than `q` and `v`.
fn torque(effect: &KnownEffect) -> Option<String> {
    let [a, b, c, d] = effect.values;
    Some(match effect.kind {
        EffectKind::FrictionAsymmetry => format!("{a:?} * abs(s) + {b:?} * abs(v)"),
        EffectKind::StribeckFriction => format!("{a:?} * s * exp(-((v / {b:?}) ** 2))"),
        EffectKind::LoadDependentFriction => format!("{a:?} * s * abs(load)"),
        EffectKind::PositionDependentFriction => format!("s * ({a:?} * cos({c:?} * q) + {b:?} * sin({c:?} * q))"),
        EffectKind::TorqueRipple => format!("{a:?} * cos({c:?} * q) + {b:?} * sin({c:?} * q)"),
        EffectKind::JointSpring if a < 0.0 => format!("{a:?} * q"),
        EffectKind::Counterbalance => format!(
            "{c:?} * sin(q + {d:?}) * ({a:?} + {b:?} / sqrt(max(1.0 + {c:?} ** 2 - 2.0 * {c:?} * cos(q + {d:?}), 1e-9)))"
        ),
        _ => return None,
    })
}

/// Friction with load that is a value of the model, joint by joint.
fn load_friction<'a>(robot: &Robot, names: &'a [String]) -> impl Iterator<Item = String> + use<'a> {
    let ratios = robot.config.nominal_joints().load_friction;
    let used = ratios.into_iter().zip(names).filter(|(ratio, _)| *ratio != 0.0);
    used.map(|(ratio, name)| {
        format!("    (\"load_dependent_friction\", {name:?}, lambda q, v, s, load: {ratio:?} * s * abs(load)),\n")
    })
}
