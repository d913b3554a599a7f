//! An effect that an arm has and its robot file lacks, drawn from a seed.

use std::path::PathBuf;

use rivet_config::Robot;
use rivet_dynamics::JointKind;
use rivet_simulation::Random;

/// Stream of the seed that draws effect, joint and size.
const STREAM: u64 = 0x61;
/// Sizes go by the joint's Coulomb friction; by this share of the drive's limit where the robot file has none.
const FRICTION_SHARE: f64 = 0.05;
/// Share of the speed limit at which friction that is not linear in speed has its size.
const SPEED_SHARE: f64 = 0.5;

/// What can be hidden: name of the contract, keys with their sizes, and the words for them.
struct Kind {
    effect: &'static str,
    /// Keys of robot.toml with values, from the joint's scale of torque \[N·m\] and its speed limit \[rad/s\].
    values: fn(f64, f64) -> Vec<(&'static str, f64)>,
    /// Size in parts of the scale, from and to.
    size: (f64, f64),
    words: fn(f64, f64) -> String,
}

const KINDS: [Kind; 4] = [
    Kind {
        effect: "joint_spring",
        values: |torque, _| vec![("stiffness", torque)],
        size: (1.0, 2.0),
        words: |torque, _| format!("{torque:.3} N m/rad"),
    },
    Kind {
        effect: "stribeck_friction",
        values: |torque, speed| vec![("excess", torque), ("velocity", 0.05 * speed)],
        size: (0.5, 1.0),
        words: |torque, speed| format!("{torque:.3} N m more at standstill, falling within {:.3} rad/s", 0.05 * speed),
    },
    Kind {
        effect: "viscous_nonlinearity",
        values: |torque, speed| vec![("quadratic", torque / (SPEED_SHARE * speed).powi(2))],
        size: (0.5, 1.0),
        words: |torque, speed| format!("{torque:.3} N m at {:.3} rad/s", SPEED_SHARE * speed),
    },
    Kind {
        effect: "position_dependent_friction",
        values: |torque, _| vec![("cosine", torque), ("order", 1.0)],
        size: (0.4, 0.8),
        words: |torque, _| format!("{torque:.3} N m, once a turn"),
    },
];

/// An effect of the true arm.
pub struct HiddenEffect {
    kind: &'static Kind,
    joint: usize,
    joint_name: String,
    /// Size \[N·m\], of a spring \[N·m/rad\].
    torque: f64,
    /// Speed limit of the joint \[rad/s\].
    speed: f64,
}

impl HiddenEffect {
    /// Draws one that the robot file does not have.
    ///
    /// # Errors
    /// The robot file has all of them, or no joint turns.
    pub fn draw(robot: &Robot, seed: u64) -> Result<HiddenEffect, &'static str> {
        let known = robot.model.effects();
        let open: Vec<&Kind> =
            KINDS.iter().filter(|kind| known.list().iter().all(|e| e.kind.name() != kind.effect)).collect();
        if open.is_empty() {
            return Err("the robot file has every effect that the demonstration can hide; remove one from [effects]");
        }
        // Sizes are those of a joint that turns.
        let turning: Vec<usize> =
            (0..robot.dof()).filter(|j| robot.model.arm.joints[*j].kind == JointKind::Revolute).collect();
        if turning.is_empty() {
            return Err("no joint of this arm turns: the demonstration hides its effect in one that does");
        }
        let mut random = Random::stream(seed, STREAM);
        let mut pick = |count: usize| (random.uniform(0.0, count as f64) as usize).min(count - 1);
        let (kind, joint) = (open[pick(open.len())], turning[pick(turning.len())]);
        let (coulomb, limit) = (robot.config.friction.coulomb[joint], robot.config.drive.torque_limit[joint]);
        let scale = if coulomb > 0.0 { coulomb } else { FRICTION_SHARE * limit };
        let axis = &robot.model.arm.joints[joint];
        let speed = if axis.velocity.is_finite() && axis.velocity > 0.0 { axis.velocity } else { 1.0 };
        let torque = scale * random.uniform(kind.size.0, kind.size.1);
        Ok(HiddenEffect { kind, joint, joint_name: axis.name.clone(), torque, speed })
    }

    /// Name of the effect, as in `[effects]` and in a diagnosis.
    pub fn effect(&self) -> &'static str {
        self.kind.effect
    }

    /// Name of the joint that has it.
    pub fn joint(&self) -> &str {
        &self.joint_name
    }

    /// Its size in words, with units.
    pub fn size(&self) -> String {
        (self.kind.words)(self.torque, self.speed)
    }

    /// The text of the true arm's robot file, from that of the file that lacks the effect. The URDF is named by its absolute path.
    ///
    /// # Errors
    /// The text is no TOML, or the folder of the process is gone.
    pub fn robot_file(&self, robot: &Robot, text: &str) -> Result<String, String> {
        let mut table: toml::Table = toml::from_str(text).map_err(|why| why.to_string())?;
        let urdf: PathBuf = std::path::absolute(&robot.config.urdf).map_err(|why| why.to_string())?;
        table.insert("urdf".to_owned(), urdf.to_string_lossy().into_owned().into());
        let mut section = toml::Table::new();
        for (key, value) in (self.kind.values)(self.torque, self.speed) {
            let each = (0..robot.dof()).map(|j| if j == self.joint { value } else { 0.0 });
            section.insert(key.to_owned(), toml::Value::Array(each.map(toml::Value::Float).collect()));
        }
        let effects = table.entry("effects").or_insert_with(|| toml::Table::new().into());
        let effects = effects.as_table_mut().ok_or("[effects] is no table")?;
        effects.insert(self.kind.effect.to_owned(), section.into());
        toml::to_string(&table).map_err(|why| why.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    /// Every effect that is drawn is one that a robot file can have.
    #[test]
    fn true_arm_has_the_effect_that_was_drawn() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../robots/manutec-r3/robot.toml");
        let robot = rivet_config::load(&path).expect("the arm is there");
        let text = std::fs::read_to_string(&path).expect("the file");
        let mut drawn = std::collections::BTreeSet::new();
        for seed in 0..20 {
            let hidden = HiddenEffect::draw(&robot, seed).expect("one is open");
            let true_text = hidden.robot_file(&robot, &text).expect("TOML");
            let true_robot = rivet_config::parse(&path, &true_text).expect("a robot file");
            let effects = true_robot.model.effects();
            assert!(effects.list().iter().any(|e| e.kind.name() == hidden.effect()), "{}", hidden.effect());
            assert!(robot.model.arm.joints.iter().any(|joint| joint.name == hidden.joint()));
            drawn.insert(hidden.effect());
        }
        assert_eq!(drawn.len(), KINDS.len());
    }
}
