//! Warnings of a robot file that loads: values that no arm is likely to have, mostly in another unit or at the other side of the gear.
//!
//! Every rule is a ratio that the unit drops out of: a length against the arm's reach, an inertia or a friction against the torque limit.

use rivet_dynamics::{
    Arm, EffectKind, Joint, JointKind, KnownEffect, UrdfNote, Workspace, com_from_body, inverse_dynamics,
};
use rivet_estimation::Differentiator;

use crate::load::Robot;
use crate::number_text::{number_text, short};

/// Window of the differentiator \[s\] from which on values are off by more than their standard deviations say: with 0.1 s 88 to 94 % of
/// simulated values are within two, with 0.2 s 59 to 64.
const LONG_WINDOW_S: f64 = 0.12;
/// A body whose radius of gyration, or whose centre from its joint, is more than so many reaches of the arm is in another unit.
const MAX_GYRATION_OVER_REACH: f64 = 1.0;
const MAX_CENTRE_OVER_REACH: f64 = 2.0;
/// Factors by which inertias are too large in other units, and the units.
const INERTIA_UNITS: [(f64, &str); 6] =
    [(1e3, "g m^2"), (1e4, "kg cm^2"), (1e6, "kg mm^2"), (1e7, "g cm^2"), (1e9, "g mm^2"), (1e12, "mg mm^2")];
/// A link's radius of gyration as a share of the reach: 0.02 to 0.16 on the arms of `robots/`.
const USUAL_GYRATION_OVER_REACH: f64 = 0.1;
/// A unit fits where it leaves at most a factor of 10 of the usual size \[ln\].
const MAX_UNIT_DOUBT: f64 = 2.3;
/// Gravity takes at most so many times the torque limit: balanced arms take more than one.
const MAX_GRAVITY_OVER_LIMIT: f64 = 5.0;
/// Poses at which it is looked for.
const POSES: usize = 64;
/// Free fall \[m/s²\], and by which share it may differ.
const FREE_FALL: f64 = 9.81;
const FREE_FALL_SHARE: f64 = 0.02;
/// A gear that much has two sides.
const LEAST_GEAR: f64 = 10.0;
/// Acceleration \[rad/s²\] of a drive's rotor alone, at the joint, by its torque limit: 13 to 2700 on arms of 4 to 2500 kg.
const MAX_ROTOR_ACCELERATION: f64 = 2e4;
/// Coulomb friction over torque limit of a gear: 0.9 to 16 % on measured arms.
const LEAST_FRICTION_OVER_LIMIT: f64 = 1e-3;
/// A position limit beyond this is in degrees \[rad\]: three turns ...
const MAX_POSITION_LIMIT: f64 = 20.0;
/// ... or stands for none.
const NO_POSITION_LIMIT: f64 = 3600.0;
/// Torque limit over the URDF's effort limit, or the inverse.
const MAX_EFFORT_RATIO: f64 = 4.0;

impl Robot {
    /// What is probably wrong with the file and how to correct it, one or two sentences each. Empty for a sound file.
    pub fn warnings(&self) -> Vec<String> {
        let arm = &self.model.arm;
        let known: Vec<usize> = (0..self.dof()).filter(|j| !self.description.unknown_bodies.contains(j)).collect();
        let reach = arm.reach(0);
        let bodies = units_of_bodies(arm, &known, reach);
        let mut warnings = self.of_notes();
        warnings.extend(self.gravity_warning());
        // Bodies in another unit are too heavy as well.
        if bodies.is_empty() && !known.is_empty() {
            warnings.extend(self.holding_warning());
        }
        warnings.extend(bodies);
        warnings.extend(arm.joints.iter().filter_map(degrees));
        let drives =
            (0..self.dof()).flat_map(|j| [self.rotor_warning(j), self.effort_warning(j), self.friction_warning(j)]);
        warnings.extend(drives.flatten());
        warnings.extend(self.speed_warning());
        warnings.extend(self.long_window());
        warnings
    }

    /// What a user should know of a sound file.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        let unknown = &self.description.unknown_bodies;
        if !unknown.is_empty() {
            let links: Vec<&str> = unknown.iter().map(|&j| self.model.arm.joints[j].link.as_str()).collect();
            notes.push(format!(
                "the URDF has no <inertial> of {}: these bodies are unknown and have a wide prior. `rivet identify` estimates them; \
                 `rivet diagnose` has nothing to compare them with",
                links.join(", ")
            ));
        }
        let welded =
            self.description.notes.iter().filter(|note| matches!(note, UrdfNote::Welded { follows: None, .. }));
        notes.extend(welded.map(ToString::to_string));
        let from_urdf = self.config.resolved.iter().filter(|r| r.origin == crate::reader::Origin::Urdf);
        let from_urdf: Vec<String> = from_urdf.map(|r| r.key.path()).collect();
        if !from_urdf.is_empty() {
            notes.push(format!(
                "nominal {} are the <dynamics> of the URDF: the robot file has none",
                from_urdf.join(" and ")
            ));
        }
        notes.extend(self.hardly_separated());
        notes
    }

    /// Base parameters that the geometry hardly separates, where it does not say clearly which depend on others.
    fn hardly_separated(&self) -> Option<String> {
        if self.base.is_clear() {
            return None;
        }
        let faint: Vec<usize> = self.base.hardly_separated().collect();
        let least = faint.iter().map(|&i| self.base.residuals[i]).fold(f64::INFINITY, f64::min);
        let names: Vec<String> = faint.iter().map(|&i| self.base.name(&self.model, i)).collect();
        Some(format!(
            "nearly parallel or nearly intersecting axes hardly separate {} base parameters ({}; condition up to {:.0e}). They stay near their \
             nominal values unless data determine them",
            names.len(),
            names.join(", "),
            1.0 / least
        ))
    }

    fn of_notes(&self) -> Vec<String> {
        let doubtful =
            |note: &&UrdfNote| matches!(note, UrdfNote::Projected { .. } | UrdfNote::Welded { follows: Some(_), .. });
        self.description.notes.iter().filter(doubtful).map(ToString::to_string).collect()
    }

    fn gravity_warning(&self) -> Option<String> {
        let g = self.config.gravity;
        let size = g.iter().map(|g| g * g).sum::<f64>().sqrt();
        let written: Vec<String> = g.iter().map(|g| number_text(*g)).collect();
        let written = written.join(", ");
        if size > 0.0 && (size / FREE_FALL - 1.0).abs() > FREE_FALL_SHARE {
            return Some(format!("gravity [{written}] is {} m/s^2 long, not 9.81: give it in m/s^2", short(size)));
        }
        (g[2] > 0.9 * size && size > 0.0).then(|| {
            format!(
                "gravity [{written}] points up in base axes: right for an arm that hangs from the ceiling; one that stands has [0, 0, -9.81]"
            )
        })
    }

    /// Gravity against torque limits: masses in another unit, or limits at the motor.
    fn holding_warning(&self) -> Option<String> {
        let most = gravity_torque(&self.model.arm);
        let over = |j: &usize| most[*j] / self.config.drive.torque_limit[*j];
        let j = (0..self.dof()).max_by(|a, b| over(a).total_cmp(&over(b)))?;
        (over(&j) > MAX_GRAVITY_OVER_LIMIT).then(|| {
            format!(
                "joint {}: gravity takes up to {} N m, its torque_limit is {} N m: are the masses of the URDF in kg, and torque_limit at the \
                 joint side of the gear?",
                self.model.arm.joints[j].name,
                short(most[j]),
                short(self.config.drive.torque_limit[j])
            )
        })
    }

    fn rotor_warning(&self, j: usize) -> Option<String> {
        let drive = &self.config.drive;
        let (rotor, limit, ratio) = (drive.rotor_inertia[j], drive.torque_limit[j], drive.gear_ratio[j].abs());
        let reflected = rotor * ratio * ratio;
        // Seen from the joint it has to be a rotor.
        let of_motor = rotor > 0.0 && ratio >= LEAST_GEAR && limit / rotor > MAX_ROTOR_ACCELERATION;
        (of_motor && limit / reflected < MAX_ROTOR_ACCELERATION).then(|| {
            format!(
                "joint {}: rotor_inertia {} kg m^2 is that of the motor. At the joint it is gear_ratio^2 times as large: {} kg m^2",
                self.model.arm.joints[j].name,
                number_text(rotor),
                short(reflected)
            )
        })
    }

    fn friction_warning(&self, j: usize) -> Option<String> {
        let drive = &self.config.drive;
        let (coulomb, limit) = (self.config.friction.coulomb[j], drive.torque_limit[j]);
        let ratio = drive.gear_ratio[j].abs();
        let of_motor = coulomb > 0.0 && ratio >= LEAST_GEAR && coulomb < LEAST_FRICTION_OVER_LIMIT * limit;
        (of_motor && coulomb * ratio >= LEAST_FRICTION_OVER_LIMIT * limit).then(|| {
            format!(
                "joint {}: friction.coulomb {} N m is that of the motor. At the joint it is gear_ratio times as large: {} N m (viscous: gear_ratio^2 \
                 times)",
                self.model.arm.joints[j].name,
                number_text(coulomb),
                short(coulomb * ratio)
            )
        })
    }

    fn effort_warning(&self, j: usize) -> Option<String> {
        let (limit, effort) = (self.config.drive.torque_limit[j], self.description.effort[j]);
        // An export writes the limit that the joint was found to have into its URDF.
        let saturates =
            |e: &KnownEffect| e.kind == EffectKind::TorqueSaturation && e.joint == j && e.values[0] <= effort;
        if self.model.effects().list().iter().any(saturates) {
            return None;
        }
        let ratio = limit / effort;
        (effort.is_finite() && !(1.0 / MAX_EFFORT_RATIO..=MAX_EFFORT_RATIO).contains(&ratio)).then(|| {
            format!(
                "joint {}: torque_limit is {} N m, the URDF's effort {} N m: which of them is at the joint side of the gear?",
                self.model.arm.joints[j].name,
                short(limit),
                short(effort)
            )
        })
    }

    /// Joints whose speed nothing bounds.
    fn speed_warning(&self) -> Option<String> {
        let unlimited = self.model.arm.joints.iter().filter(|joint| !joint.velocity.is_finite());
        let names: Vec<&str> = unlimited.map(|joint| joint.name.as_str()).collect();
        (!names.is_empty()).then(|| {
            format!(
                "no speed limit of {}: `velocity` is 0 or absent in the description, and `rivet-controller` does not check the speed. Write \
                 `velocity_limit = [...]` in rad/s below `[drive]`",
                names.join(", ")
            )
        })
    }

    /// A window in which friction that reverses is rounded off by more than standard deviations know; the shortest is no choice.
    fn long_window(&self) -> Option<String> {
        let Differentiator::SavitzkyGolay { half_width } = self.config.signal.differentiator else { return None };
        let window_s = (2 * half_width + 1) as f64 * self.config.sample_period_s;
        (half_width > 2 && window_s >= LONG_WINDOW_S).then(|| {
            format!("half_width = {half_width} is a window of {window_s:.2} s: it bends friction where joints reverse")
        })
    }
}

fn size(v: &[f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Links whose bodies are larger than the arm.
fn units_of_bodies(arm: &Arm, known: &[usize], reach: f64) -> Vec<String> {
    if reach <= 0.0 {
        return Vec::new();
    }
    let bodies: Vec<Body> = known.iter().map(|&j| Body::new(arm, j)).collect();
    let large = |body: &&Body| body.gyration > MAX_GYRATION_OVER_REACH * reach;
    let far = |body: &&Body| body.centre > MAX_CENTRE_OVER_REACH * reach;
    let gyrations: Vec<f64> = bodies.iter().filter(large).map(|body| body.gyration).collect();
    let unit = inertia_unit(&gyrations, reach);
    let warning = |body: &Body| {
        let (link, reach) = (body.link, brief(reach));
        if far(&body) {
            let centre = short(body.centre);
            return Some(format!(
                "link {link}: its centre of mass is {centre} m from its joint, the arm reaches {reach} m: is it in mm?"
            ));
        }
        large(&body).then(|| {
            format!(
                "link {link}: inertia {} kg m^2 with {} kg is a radius of gyration of {} m, the arm reaches {reach} m: {unit} A URDF has kg, m, \
                 kg m^2",
                brief(body.moment),
                short(body.mass),
                brief(body.gyration)
            )
        })
    };
    bodies.iter().filter_map(warning).collect()
}

/// Sizes of the body that a joint moves.
struct Body<'a> {
    link: &'a str,
    /// \[kg\]
    mass: f64,
    /// Largest moment about the centre of mass \[kg·m²\].
    moment: f64,
    /// Radius of gyration about the centre of mass \[m\].
    gyration: f64,
    /// Distance of the centre of mass from the joint \[m\].
    centre: f64,
}

impl Body<'_> {
    fn new(arm: &Arm, j: usize) -> Body<'_> {
        let (mass, centre, inertia) = com_from_body(&arm.links[j]);
        let moment = (0..3).map(|k| inertia[k][k]).fold(0.0, f64::max);
        Body { link: &arm.joints[j].link, mass, moment, gyration: (moment / mass).sqrt(), centre: size(&centre) }
    }
}

/// The unit with which links have the usual size: one for all of them, since a file has one.
fn inertia_unit(gyrations: &[f64], reach: f64) -> String {
    let usual = |factor: f64| {
        let off = |gyration: &f64| (gyration / factor.sqrt() / (USUAL_GYRATION_OVER_REACH * reach)).ln();
        (gyrations.iter().map(off).sum::<f64>() / gyrations.len().max(1) as f64).abs()
    };
    let nearest = INERTIA_UNITS.into_iter().min_by(|a, b| usual(a.0).total_cmp(&usual(b.0)));
    let known = nearest.filter(|(factor, _)| usual(*factor) < MAX_UNIT_DOUBT);
    known.map_or_else(|| "another unit?".to_owned(), |(_, unit)| format!("is it in {unit}?"))
}

/// Three digits.
fn brief(x: f64) -> String {
    if (1e-2..1e5).contains(&x) { short((x * 1e3).round() / 1e3) } else { format!("{x:.2e}") }
}

/// The largest torque of gravity on each joint over seeded poses within the limits \[N m\].
fn gravity_torque(arm: &Arm) -> Vec<f64> {
    let n = arm.dof();
    let (mut ws, zero, mut torque) = (Workspace::new(arm), vec![0.0; n], vec![0.0; n]);
    let mut most = vec![0.0_f64; n];
    for k in 0..POSES {
        // Halton points: joint j in the base of the j-th prime.
        let pose = |(j, joint): (usize, &Joint)| {
            let half = if joint.kind == JointKind::Revolute { std::f64::consts::PI } else { 0.5 };
            let (low, high) = (joint.lower.clamp(-half, half), joint.upper.clamp(-half, half));
            low + (high - low) * halton(k + 1, [2, 3, 5, 7, 11, 13, 17, 19][j % 8])
        };
        let q: Vec<f64> = arm.joints.iter().enumerate().map(pose).collect();
        inverse_dynamics(arm, &arm.links, &mut ws, &q, &zero, &zero, &mut torque);
        most.iter_mut().zip(&torque).for_each(|(most, torque)| *most = most.max(torque.abs()));
    }
    most
}

/// The `k`-th point of van der Corput's sequence in a base.
fn halton(mut k: usize, base: usize) -> f64 {
    let (mut value, mut part) = (0.0, 1.0);
    while k > 0 {
        part /= base as f64;
        value += part * (k % base) as f64;
        k /= base;
    }
    value
}

fn degrees(joint: &Joint) -> Option<String> {
    let far = |limit: f64| limit.abs() > MAX_POSITION_LIMIT && limit.abs() <= NO_POSITION_LIMIT;
    let limits = [joint.lower, joint.upper];
    (joint.kind == JointKind::Revolute && limits.into_iter().any(far)).then(|| {
        format!(
            "joint {}: its limits {} to {} rad are up to {:.0} turns: are they in degrees? A URDF has rad",
            joint.name,
            short(joint.lower),
            short(joint.upper),
            limits.into_iter().map(f64::abs).fold(0.0, f64::max) / std::f64::consts::TAU
        )
    })
}
