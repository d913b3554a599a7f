//! What is drawn: which effects, where, how strong, and how wrong the robot file is beside them.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

use rivet_config::Robot;
use rivet_dynamics::{MAX_JOINTS, Workspace, inverse_dynamics, mass_matrix};
use rivet_simulation::motion::Trajectory;
use rivet_simulation::two_mass::{CoupledMotor, DryFriction, Gear, Joint, Outside, Physics, Push};
use rivet_simulation::{Payload, Random};

/// A true effect.
#[derive(Clone, Debug, PartialEq)]
pub struct True {
    /// Its name, or `outside`.
    pub effect: &'static str,
    /// Joints, from 0; none for an effect of the arm.
    pub joints: Vec<usize>,
    /// Sizes by name with unit, SI.
    pub magnitude: BTreeMap<&'static str, f64>,
}

/// What came out.
#[derive(Clone, Debug)]
pub struct Drawn {
    /// The arm with its effects.
    pub physics: Physics,
    /// The same without them, then with the first, with the first two: one fewer than there are effects, at least one.
    pub before: Vec<Physics>,
    /// They.
    pub effects: Vec<True>,
    /// Standard deviation of the logarithm of the bodies' values, where all values are off.
    pub nominal_error: Option<f64>,
}

/// Wrong values, which are not drawn where all values are wrong already.
const VALUES: [&str; 4] = ["link_inertia", "rotor_inertia", "coulomb_friction", "viscous_friction"];
/// Effects that are drawn, each as likely as the others.
const EFFECTS: [&str; 27] = [
    "link_inertia",
    "payload",
    "gravity_direction",
    "rotor_inertia",
    "coulomb_friction",
    "viscous_friction",
    "friction_asymmetry",
    "stribeck_friction",
    "viscous_nonlinearity",
    "load_dependent_friction",
    "temperature_dependent_friction",
    "presliding_friction",
    "position_dependent_friction",
    "torque_constant",
    "torque_ripple",
    "transmission_error",
    "backlash",
    "joint_elasticity",
    "joint_spring",
    "counterbalance",
    "joint_coupling",
    "transport_delay",
    "current_loop_lag",
    "torque_saturation",
    "encoder_offset",
    "encoder_eccentricity",
    "external_force",
];
/// Standard deviations of the logarithms where the robot file is wrong throughout: bodies, rotors, friction; and of torque
/// offsets, in parts of Coulomb friction.
const WRONG: [f64; 4] = [0.06, 0.09, 0.18, 0.05];
/// Natural frequency \[Hz\] and damping ratio of a gear that is there only to carry an error or play.
const STIFF_HZ: f64 = 80.0;
const DAMPING: f64 = 0.08;
const SECONDS: f64 = 18.0;

/// What strengths are measured by: the robot and what its motion demands.
pub(super) struct Draw<'a> {
    robot: &'a Robot,
    /// Root mean square of the rigid torque, and its largest value with friction \[N·m\].
    torque: Vec<f64>,
    peak: Vec<f64>,
    /// Fastest and furthest of the motion \[rad/s, rad\].
    speed: Vec<f64>,
    reach: Vec<f64>,
    home: Vec<f64>,
    /// Inertia of the links about each joint at home \[kg·m²\].
    inertia: Vec<f64>,
}

impl<'a> Draw<'a> {
    pub(super) fn new(robot: &'a Robot, motion: &dyn Trajectory) -> Draw<'a> {
        let n = robot.dof();
        let arm = &robot.model.arm;
        let joints = robot.config.nominal_joints();
        let mut ws = Workspace::new(arm);
        let (mut q, mut qd, mut qdd, mut tau) =
            ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS], [0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
        let mut home = vec![0.0; n];
        motion.sample(0.0, &mut home, &mut qd[..n], &mut qdd[..n]);
        let mut mass = vec![0.0; n * n];
        mass_matrix(arm, &arm.links, &mut ws, &home, &mut mass);
        let inertia = (0..n).map(|j| mass[j * n + j]).collect();
        let mut draw = Draw {
            robot,
            torque: vec![0.0; n],
            peak: vec![0.0; n],
            speed: vec![0.0; n],
            reach: vec![0.0; n],
            inertia,
            home,
        };
        const STEPS: usize = 1800;
        for k in 0..STEPS {
            motion.sample(SECONDS * k as f64 / STEPS as f64, &mut q[..n], &mut qd[..n], &mut qdd[..n]);
            inverse_dynamics(arm, &arm.links, &mut ws, &q[..n], &qd[..n], &qdd[..n], &mut tau[..n]);
            for j in 0..n {
                let rigid = tau[j] + joints.rotor_inertia[j] * qdd[j];
                let whole = rigid + joints.viscous[j] * qd[j] + joints.coulomb[j] * qd[j].signum();
                draw.torque[j] += rigid * rigid / STEPS as f64;
                draw.peak[j] = draw.peak[j].max(whole.abs());
                draw.speed[j] = draw.speed[j].max(qd[j].abs());
                draw.reach[j] = draw.reach[j].max((q[j] - draw.home[j]).abs());
            }
        }
        draw.torque.iter_mut().for_each(|t| *t = t.sqrt());
        draw
    }

    /// Half of the cases have a robot file that is wrong throughout. Of all, 15 % have nothing else, 50 % one effect, 15 % two,
    /// 8 % three, and 12 % something that no library has.
    pub(super) fn case(&self, random: &mut Random) -> Drawn {
        let wrong = random.unit() < 0.5;
        let mut physics = self.arm(wrong, random);
        let mut before = vec![physics.clone()];
        let mut effects = Vec::new();
        let lot = random.unit();
        if lot >= 0.88 {
            effects.push(self.outside(&mut physics, random));
        } else {
            let count = [(0.15, 0), (0.65, 1), (0.80, 2), (0.88, 3)];
            let count = count.iter().find(|(below, _)| lot < *below).map_or(0, |(_, count)| *count);
            while effects.len() < count {
                let effect = EFFECTS[random.bits() as usize % EFFECTS.len()];
                let taken = effects.iter().any(|e: &True| e.effect == effect) || (wrong && VALUES.contains(&effect));
                if let (false, Some(found)) = (taken, self.place(effect, &effects)) {
                    let so_far = physics.clone();
                    let added = self.apply(effect, &found, &mut physics, random);
                    if added.is_some() && !effects.is_empty() {
                        before.push(so_far);
                    }
                    effects.extend(added);
                }
            }
        }
        Drawn { physics, before, effects, nominal_error: wrong.then_some(WRONG[0]) }
    }

    /// The robot file's arm; with `wrong`, what it would be if the file had been made from CAD and data sheets.
    fn arm(&self, wrong: bool, random: &mut Random) -> Physics {
        let (n, robot) = (self.robot.dof(), self.robot);
        let nominal = robot.config.nominal_joints();
        let mut factor = |spread: f64| if wrong { (spread * random.normal()).exp() } else { 1.0 };
        let mut arm = robot.model.arm.clone();
        for body in &mut arm.links {
            let f = factor(WRONG[0]);
            for entry in body {
                *entry *= f;
            }
        }
        let pair = robot.model.structure.coupling.map(|c| [c.driving, c.driven]);
        let joints = (0..n)
            .map(|j| {
                // The coupled motor has the friction of both joints that the model lists for each.
                let shared = if pair.is_some_and(|pair| pair.contains(&j)) { nominal.coupling[1] } else { 0.0 };
                let coulomb = nominal.coulomb[j] * factor(WRONG[2]);
                Joint {
                    rotor_inertia: nominal.rotor_inertia[j] * factor(WRONG[1]),
                    viscous: (nominal.viscous[j] - shared) * factor(WRONG[2]),
                    dry: DryFriction { coulomb, ..DryFriction::default() },
                    offset: nominal.offset[j] + if wrong { WRONG[3] * coulomb * factor(1.0).ln() } else { 0.0 },
                    ..Joint::default()
                }
            })
            .collect();
        let [inertia, viscous, coulomb] = nominal.coupling;
        let coupled = pair.map(|joints| CoupledMotor { joints, inertia, viscous, coulomb });
        Physics { arm, joints, coupled: coupled.into_iter().collect(), delay_s: 0.0, lag_s: 0.0, pushes: Vec::new() }
    }

    /// Joints that may have `effect`; None where this arm can have it nowhere. A joint has one effect.
    fn place(&self, effect: &str, taken: &[True]) -> Option<Vec<usize>> {
        let n = self.robot.dof();
        let pair = self.robot.model.structure.coupling.map(|c| [c.driving, c.driven]);
        let alone = |j: &usize| !pair.is_some_and(|pair| pair.contains(j));
        let free = |j: &usize| !taken.iter().any(|t| t.joints.contains(j));
        let all = (0..n).filter(free);
        let found: Vec<usize> = match effect {
            "payload" | "gravity_direction" | "transport_delay" | "current_loop_lag" | "external_force" => {
                return Some(Vec::new());
            }
            // Gears with two masses and the coupled motor do not go together.
            "transmission_error" | "backlash" | "joint_elasticity" => all.filter(alone).collect(),
            // What turns about the vertical, or is light, has no weight to show it.
            "link_inertia" | "encoder_offset" => all.filter(|j| (1..n - 1).contains(j)).collect(),
            "counterbalance" => all.filter(|j| *j == 1).collect(),
            "joint_coupling" if pair.is_some() || n < 2 => Vec::new(),
            "joint_coupling" => all.filter(|j| *j == n - 1 && free(&(n - 2))).collect(),
            _ => all.collect(),
        };
        (!found.is_empty()).then_some(found)
    }

    fn apply(
        &self,
        effect: &'static str,
        places: &[usize],
        physics: &mut Physics,
        random: &mut Random,
    ) -> Option<True> {
        let mut u = |low: f64, high: f64| random.uniform(low, high);
        let j = if places.is_empty() { 0 } else { places[(u(0.0, 1.0) * places.len() as f64) as usize] };
        let (dry, phase) = (physics.joints[j].dry.coulomb, u(0.0, TAU));
        let either = if u(0.0, 1.0) < 0.5 { -1.0 } else { 1.0 };
        let turns = self.robot.config.drive.gear_ratio[j].abs();
        let total = self.inertia[j] + physics.joints[j].rotor_inertia;
        let stiff = |hz: f64, play: f64, error: [f64; 3]| {
            // Motor and link against each other.
            let (link, motor) = (self.inertia[j], physics.joints[j].rotor_inertia);
            let stiffness = (TAU * hz).powi(2) * link * motor / (link + motor);
            let damping = 2.0 * DAMPING * stiffness / (TAU * hz);
            Some(Gear { stiffness, damping, play, error })
        };
        let joint = &mut physics.joints[j].clone();
        let mut size: Vec<(&'static str, f64)> = Vec::new();
        let mut joints = if places.is_empty() { Vec::new() } else { vec![j] };
        match effect {
            "link_inertia" => {
                let f = 1.0 + either * u(0.2, 0.4);
                for entry in &mut physics.arm.links[j] {
                    *entry *= f;
                }
                size.push(("factor", f));
            }
            "payload" => {
                // A part of what the arm itself weighs beyond its base joint.
                let moving: f64 = physics.arm.links.iter().skip(1).map(|body| body[0]).sum();
                let mass = moving * u(0.03, 0.12);
                let com = [u(-0.05, 0.05), u(-0.05, 0.05), u(0.03, 0.12)];
                let ball = Payload { mass, com }.body();
                let last = physics.arm.links.last_mut()?;
                last.iter_mut().zip(ball).for_each(|(entry, more)| *entry += more);
                size.push(("mass_kg", mass));
            }
            "gravity_direction" => {
                let (tilt, towards) = (u(0.02, 0.07), phase);
                let [x, y, z] = physics.arm.gravity;
                let g = (x * x + y * y + z * z).sqrt();
                physics.arm.gravity = [g * tilt.sin() * towards.cos(), g * tilt.sin() * towards.sin(), z * tilt.cos()];
                size.push(("tilt_rad", tilt));
            }
            "rotor_inertia" => {
                let f = 1.0 + either * u(0.25, 0.6);
                joint.rotor_inertia *= f;
                size.push(("factor", f));
            }
            "coulomb_friction" => {
                let f = 1.0 + either * u(0.3, 0.6);
                joint.dry.coulomb *= f;
                size.push(("factor", f));
            }
            "viscous_friction" => {
                let f = 1.0 + either * u(0.3, 0.6);
                joint.viscous *= f;
                size.push(("factor", f));
            }
            "friction_asymmetry" => {
                joint.dry.forwards = u(0.25, 0.6) * dry;
                size.push(("torque_nm", joint.dry.forwards));
            }
            "stribeck_friction" => {
                joint.dry.stribeck = [u(0.4, 1.0) * dry, u(0.04, 0.15)];
                size.extend([("torque_nm", joint.dry.stribeck[0]), ("velocity_rad_s", joint.dry.stribeck[1])]);
            }
            "viscous_nonlinearity" => {
                let (v, part) = (self.speed[j], u(0.3, 0.8));
                // More or less than in proportion at the motion's largest speed, the other way at a half of it.
                joint.cubic = either * part * joint.viscous / (v * v);
                joint.viscous *= 1.0 - 0.5 * either * part;
                size.push(("cubic_nm_s3", joint.cubic));
            }
            "load_dependent_friction" => {
                joint.dry.load = u(0.06, 0.18);
                size.push(("ratio", joint.dry.load));
            }
            "temperature_dependent_friction" => {
                // About 15 K while the joint works.
                let watts = 0.3 * self.speed[j] * (dry + 0.3 * joint.viscous * self.speed[j]);
                joint.warming = [-u(0.012, 0.03), u(12.0, 20.0) / watts.max(1e-9)];
                size.push(("per_kelvin", joint.warming[0]));
            }
            "presliding_friction" => {
                joint.dry.bristle = u(2e-3, 8e-3);
                size.push(("length_rad", joint.dry.bristle));
            }
            "position_dependent_friction" => {
                joint.dry.position = [u(0.3, 0.7) * dry, phase];
                size.push(("torque_nm", joint.dry.position[0]));
            }
            "torque_constant" => {
                joint.gain = either * u(0.08, 0.2);
                size.push(("factor", 1.0 + joint.gain));
            }
            "torque_ripple" => {
                let order = turns * f64::from(1 + u8::from(u(0.0, 1.0) < 0.5));
                joint.ripple = [u(0.15, 0.45) * dry, order, phase];
                size.extend([("torque_nm", joint.ripple[0]), ("order", order)]);
            }
            "transmission_error" => {
                let error = [u(5e-5, 2e-4), 2.0 * turns, phase];
                joint.gear = stiff(STIFF_HZ, 0.0, error);
                size.push(("rad", error[0]));
            }
            "backlash" => {
                let play = u(1.5e-3, 6e-3);
                joint.gear = stiff(STIFF_HZ, play, [0.0; 3]);
                size.push(("rad", play));
            }
            "joint_elasticity" => {
                let hz = u(5.0, 12.0);
                joint.gear = stiff(hz, 0.0, [0.0; 3]);
                size.extend([("hz", hz), ("stiffness_nm_rad", joint.gear.as_ref().map_or(0.0, |g| g.stiffness))]);
            }
            "joint_spring" => {
                let stiffness = u(0.25, 0.6) * self.torque[j].max(dry) / self.reach[j].max(0.1);
                joint.spring = [stiffness, self.home[j] + u(-0.2, 0.2)];
                size.push(("stiffness_nm_rad", stiffness));
            }
            "counterbalance" => {
                let torque = u(0.25, 0.6) * self.torque[j].max(dry);
                joint.counterbalance = [torque, u(-0.3, 0.3)];
                size.push(("torque_nm", torque));
            }
            "joint_coupling" => {
                joints = vec![j - 1, j];
                let inertia = u(0.1, 0.25) * total;
                let (viscous, coulomb) = (u(0.3, 0.6) * joint.viscous, u(0.3, 0.6) * dry);
                // The motor turns with the sum: each joint carries all of its inertia.
                joint.rotor_inertia += inertia;
                physics.joints[j - 1].rotor_inertia += inertia;
                physics.coupled.push(CoupledMotor { joints: [j - 1, j], inertia, viscous, coulomb });
                size.extend([("coulomb_nm", coulomb), ("viscous_nms_rad", viscous), ("inertia_kgm2", inertia)]);
            }
            "transport_delay" => {
                physics.delay_s = u(0.002, 0.006);
                size.push(("seconds", physics.delay_s));
            }
            "current_loop_lag" => {
                physics.lag_s = u(0.002, 0.006);
                size.push(("seconds", physics.lag_s));
            }
            "torque_saturation" => {
                joint.saturation = u(0.6, 0.85) * self.peak[j];
                size.push(("torque_nm", joint.saturation));
            }
            "encoder_offset" => {
                joint.encoder_offset = either * u(0.02, 0.06);
                size.push(("rad", joint.encoder_offset));
            }
            "encoder_eccentricity" => {
                joint.eccentricity = [u(1.5e-3, 6e-3), phase];
                size.push(("rad", joint.eccentricity[0]));
            }
            "external_force" => {
                let newton = u(0.1, 0.25) * self.robot.config.drive.torque_limit.get(1).copied().unwrap_or(100.0);
                for part in 0..3 {
                    let (azimuth, height) = (u(0.0, TAU), u(-0.4, 0.4) * PI);
                    let force = [azimuth.cos() * height.cos(), azimuth.sin() * height.cos(), height.sin()];
                    physics.pushes.push(Push {
                        from_s: 2.0 + (f64::from(part) + u(0.0, 0.6)) * SECONDS / 3.5,
                        length_s: u(0.4, 1.2),
                        force: force.map(|f| newton * f),
                    });
                }
                size.push(("newton", newton));
            }
            _ => return None,
        }
        physics.joints[j] = joint.clone();
        Some(True { effect, joints, magnitude: size.into_iter().collect() })
    }

    /// Structure that no library of effects has.
    fn outside(&self, physics: &mut Physics, random: &mut Random) -> True {
        let n = self.robot.dof();
        let j = random.bits() as usize % n;
        let size = self.torque[j].max(physics.joints[j].dry.coulomb);
        let (part, side) = (random.uniform(0.4, 0.8), random.uniform(-0.5, 0.5));
        let (outside, kind) = match random.bits() % 3 {
            0 => {
                let centre = self.home[j] + side * self.reach[j];
                (Outside::Magnet { centre, width: 0.1 * self.reach[j].max(0.1), torque: part * size }, "magnet_nm")
            }
            1 => {
                let from = self.home[j] + 0.2 * side * self.reach[j];
                (
                    Outside::Cable { from, stiffness: 2.0 * part * size / self.reach[j].max(0.1).powi(2) },
                    "cable_nm_rad2",
                )
            }
            _ => {
                let torque = part * physics.joints[j].dry.coulomb;
                (Outside::Entangled { with: (j + 1) % n, torque }, "entangled_nm")
            }
        };
        physics.joints[j].outside = Some(outside);
        let value = match outside {
            Outside::Magnet { torque, .. } | Outside::Entangled { torque, .. } => torque,
            Outside::Cable { stiffness, .. } => stiffness,
        };
        True { effect: "outside", joints: vec![j], magnitude: BTreeMap::from([(kind, value)]) }
    }
}
