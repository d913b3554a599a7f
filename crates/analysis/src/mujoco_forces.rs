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

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::process::Command;

    use rivet_dynamics::{friction_sign, own_torque};

    use super::*;

    const EFFECTS: &str = "\n[effects.friction_asymmetry]\ncoulomb = [0.5, 0]\nviscous = [0.1, 0]\n\
        [effects.stribeck_friction]\nexcess = [0, 1.47]\nvelocity = [1, 0.081]\n\
        [effects.position_dependent_friction]\ncosine = [0.3, 0]\nsine = [-0.2, 0]\norder = [2, 1]\n\
        [effects.torque_ripple]\ncosine = [0, 0.6]\nsine = [0, 0.1]\norder = [1, 24]\n\
        [effects.joint_spring]\nstiffness = [-3, 8]\n\
        [effects.counterbalance]\nlever = [20, 0]\nfree_length = [-5, 0]\narm = [0.3, 0]\nphase = [0.2, 0]\n\
        [effects.transport_delay]\ndelay = 0.002\n";

    fn robot(effects: &str) -> Robot {
        let folder = tempfile::tempdir().expect("a folder");
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../robots/dd2");
        std::fs::copy(source.join("robot.urdf"), folder.path().join("robot.urdf")).expect("a description");
        let text = std::fs::read_to_string(source.join("robot.toml")).expect("a robot file");
        let file = folder.path().join("robot.toml");
        std::fs::write(&file, text + effects).expect("a robot file");
        rivet_config::load(&file).expect("a valid robot file")
    }

    #[test]
    fn an_arm_without_such_torques_needs_no_module() {
        assert_eq!(module(&robot("")), None);
        assert_eq!(module(&robot("\n[effects.joint_spring]\nstiffness = [0, 8]\n")), None, "MJCF has stiffness");
    }

    /// What Python computes is what the model computes.
    #[test]
    fn the_module_has_the_torques_of_the_model() {
        let robot = robot(EFFECTS);
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join(FILE), module(&robot).expect("a module")).expect("a file");
        let (q, v, load) = (0.7, -0.05, 12.5);
        let script = format!(
            "import mujoco_forces as m\nfor effect, joint, torque in m.FORCES:\n    \
             print(effect, joint, repr(torque({q}, {v}, m.sign({v}), {load})))\n"
        );
        let python = std::env::var("RIVET_PYTHON").unwrap_or_else(|_| "python3".to_owned());
        let Ok(output) = Command::new(python).args(["-B", "-c", &script]).current_dir(folder.path()).output() else {
            eprintln!("no Python; the module is not run");
            return;
        };
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let text = String::from_utf8(output.stdout).expect("text");
        let s = friction_sign(v, robot.config.signal.friction_velocity);
        let names = runs::joint_names(&robot);
        let mut expected = 0;
        for effect in robot.model.effects().list().iter().filter(|effect| torque(effect).is_some()) {
            let line = text
                .lines()
                .find_map(|line| line.strip_prefix(&format!("{} {} ", effect.kind.name(), names[effect.joint])));
            let found: f64 = line.expect("the effect").parse().expect("a number");
            let own = own_torque(effect, s, load, q, v);
            assert!((found - own).abs() < 1e-9 * own.abs().max(1.0), "{effect:?}: {found} for {own}");
            expected += 1;
        }
        assert_eq!((text.lines().count(), expected), (6, 6), "{text}");
    }
}
