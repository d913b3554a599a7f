//! An effect that an arm has and its robot file lacks, drawn from a seed.

use std::path::PathBuf;

use nalgebra::{DMatrix, DVector};
use rivet_config::Robot;
use rivet_dynamics::{EffectKind, JointKind, KnownEffect, Workspace, friction_sign, own_torque};
use rivet_simulation::Random;
use rivet_simulation::motion::Trajectory;

/// Stream of the seed that draws effect, joint and size.
const STREAM: u64 = 0x61;
/// Sizes go by the joint's Coulomb friction; by this share of the drive's limit where the robot file has none.
const FRICTION_SHARE: f64 = 0.05;
/// Share of the speed limit at which friction that is not linear in speed has its size.
const SPEED_SHARE: f64 = 0.5;

/// Rms torque after a refit of all parameters of the model, over the joint's noise, from which a recorded run shows an effect. A
/// diagnosis is to name what leaves half of the noise; a demonstration keeps twice of that.
const VISIBLE: f64 = 1.0;
/// Draws until an effect is visible; then the most visible one is made large enough.
const MOST_DRAWS: usize = 50;
/// Motion that visibility is judged by, from its start \[s\], and states on it.
const MOTION_S: f64 = 20.0;
const STATES: usize = 500;
/// Noise of a joint without torque noise, as a share of its drive's limit.
const LEAST_NOISE: f64 = 1e-3;
/// Singular values below this share of the largest are directions that the motion does not move.
const RANK_TOLERANCE: f64 = 1e-9;

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
    /// Draws one that the robot file does not have and that a run along `motion` shows: it leaves at least the joint's noise
    /// after a refit of all parameters of the model.
    ///
    /// # Errors
    /// The robot file has all of them, or no joint turns.
    pub fn draw(robot: &Robot, motion: &dyn Trajectory, seed: u64) -> Result<HiddenEffect, &'static str> {
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
        let motion = States::along(robot, motion);
        let mut random = Random::stream(seed, STREAM);
        let mut best: Option<(f64, HiddenEffect)> = None;
        for _ in 0..MOST_DRAWS {
            let drawn = HiddenEffect::any(robot, &open, &turning, &mut random);
            let visible = motion.remains(robot, &drawn);
            if visible >= VISIBLE {
                return Ok(drawn);
            }
            if best.as_ref().is_none_or(|(most, _)| visible > *most) {
                best = Some((visible, drawn));
            }
        }
        let (visible, drawn) = best.ok_or("nothing was drawn")?;
        // Torque is proportional to the size.
        let larger = if visible > 0.0 { VISIBLE / visible } else { 1.0 };
        Ok(HiddenEffect { torque: larger * drawn.torque, ..drawn })
    }

    fn any(robot: &Robot, open: &[&'static Kind], turning: &[usize], random: &mut Random) -> HiddenEffect {
        let mut pick = |count: usize| (random.uniform(0.0, count as f64) as usize).min(count - 1);
        let (kind, joint) = (open[pick(open.len())], turning[pick(turning.len())]);
        let (coulomb, limit) = (robot.config.friction.coulomb[joint], robot.config.drive.torque_limit[joint]);
        let scale = if coulomb > 0.0 { coulomb } else { FRICTION_SHARE * limit };
        let axis = &robot.model.arm.joints[joint];
        let speed = if axis.velocity.is_finite() && axis.velocity > 0.0 { axis.velocity } else { 1.0 };
        let torque = scale * random.uniform(kind.size.0, kind.size.1);
        HiddenEffect { kind, joint, joint_name: axis.name.clone(), torque, speed }
    }

    /// As the model computes it; none where the model has no such effect.
    fn known(&self) -> Option<KnownEffect> {
        let kind = *EffectKind::ALL.iter().find(|kind| kind.name() == self.kind.effect)?;
        let values = (self.kind.values)(self.torque, self.speed);
        let value = |key: &&str| values.iter().find(|(name, _)| name == key).map_or(0.0, |(_, value)| *value);
        Some(KnownEffect::new(kind, self.joint, &kind.keys().iter().map(value).collect::<Vec<_>>()))
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

/// Joint states along a motion.
struct States {
    q: Vec<Vec<f64>>,
    qd: Vec<Vec<f64>>,
    qdd: Vec<Vec<f64>>,
}

impl States {
    fn along(robot: &Robot, motion: &dyn Trajectory) -> States {
        let mut states = States { q: Vec::new(), qd: Vec::new(), qdd: Vec::new() };
        for k in 1..=STATES {
            let [mut q, mut qd, mut qdd] = [(); 3].map(|()| vec![0.0; robot.dof()]);
            motion.sample(MOTION_S * k as f64 / STATES as f64, &mut q, &mut qd, &mut qdd);
            states.q.push(q);
            states.qd.push(qd);
            states.qdd.push(qdd);
        }
        states
    }

    /// Rms of the effect's torque after a refit of all parameters of the model, over the noise of its joint.
    fn remains(&self, robot: &Robot, effect: &HiddenEffect) -> f64 {
        let Some(known) = effect.known() else { return 0.0 };
        let (model, joint) = (&robot.model, effect.joint);
        let (width, v0) = (model.len(), model.structure.sign_velocity);
        let mut workspace = Workspace::new(&model.arm);
        let mut y = vec![0.0; robot.dof() * width];
        let mut columns = DMatrix::zeros(STATES, width);
        let mut torque = DVector::zeros(STATES);
        for k in 0..STATES {
            model.regressor(&mut workspace, &self.q[k], &self.qd[k], &self.qdd[k], &mut y);
            columns.row_mut(k).copy_from_slice(&y[joint * width..(joint + 1) * width]);
            let (q, v) = (self.q[k][joint], self.qd[k][joint]);
            torque[k] = own_torque(&known, friction_sign(v, v0), 0.0, q, v);
        }
        for mut column in columns.column_iter_mut() {
            let norm = column.norm();
            if norm > 0.0 {
                column /= norm;
            }
        }
        let svd = columns.svd(true, false);
        let Some(u) = &svd.u else { return 0.0 };
        let most = svd.singular_values.max();
        for (direction, size) in u.column_iter().zip(&svd.singular_values) {
            if *size > RANK_TOLERANCE * most {
                let along = direction.dot(&torque);
                torque.axpy(-along, &direction, 1.0);
            }
        }
        let noise =
            robot.config.simulation.torque_noise[joint].max(LEAST_NOISE * robot.config.drive.torque_limit[joint]);
        torque.norm() / (STATES as f64).sqrt() / noise
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rivet_simulation::process::Options;
    use std::path::Path;

    fn motion(robot: &Robot, path: &Path, seed: u64) -> Box<dyn Trajectory> {
        Options { seed: Some(seed), ..Options::new(path) }.trajectory(robot).expect("a motion")
    }

    /// Every effect that is drawn is one that a robot file can have.
    #[test]
    fn true_arm_has_the_effect_that_was_drawn() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../robots/manutec-r3/robot.toml");
        let robot = rivet_config::load(&path).expect("the arm is there");
        let text = std::fs::read_to_string(&path).expect("the file");
        let mut drawn = std::collections::BTreeSet::new();
        for seed in 0..20 {
            let hidden = HiddenEffect::draw(&robot, &*motion(&robot, &path, seed), seed).expect("one is open");
            let true_text = hidden.robot_file(&robot, &text).expect("TOML");
            let true_robot = rivet_config::parse(&path, &true_text).expect("a robot file");
            let effects = true_robot.model.effects();
            assert!(effects.list().iter().any(|e| e.kind.name() == hidden.effect()), "{}", hidden.effect());
            assert!(robot.model.arm.joints.iter().any(|joint| joint.name == hidden.joint()));
            drawn.insert(hidden.effect());
        }
        assert_eq!(drawn.len(), KINDS.len());
    }

    /// A diagnosis cannot name what the noise hides. On the KUKA arm most friction effects of usual size are smaller than its noise.
    #[test]
    fn what_is_hidden_leaves_more_than_the_noise() {
        for arm in ["manutec-r3", "kuka-kr300-r2500", "ur10e", "dd2"] {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../robots/{arm}/robot.toml"));
            let robot = rivet_config::load(&path).expect("the arm is there");
            for seed in 0..6 {
                let motion = motion(&robot, &path, seed);
                let hidden = HiddenEffect::draw(&robot, &*motion, seed).expect("one is open");
                let remains = States::along(&robot, &*motion).remains(&robot, &hidden);
                println!("{arm} {seed}: {} of {}, {}: {remains:.2}", hidden.effect(), hidden.joint(), hidden.size());
                assert!(remains > 0.99 * VISIBLE, "{arm} {seed}: {remains}");
            }
        }
    }
}
