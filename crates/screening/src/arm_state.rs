//! What the arm is like under a reading: prior mean and standard deviation of the model's values, and of a few columns more.

use rivet_dynamics::{LINK_PARAMETERS, Model, Parameter, body_from_com};

use crate::priors as p;

/// A unit that a URDF has in the place of SI.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileUnit {
    /// Inertias in g mm².
    InertiaGramMm2,
    /// Inertias in kg mm² or g m².
    InertiaKgMm2,
    /// Masses in g.
    MassGram,
    /// Centres of mass in mm.
    CentreMm,
}

impl FileUnit {
    pub(crate) const ALL: [FileUnit; 4] =
        [FileUnit::InertiaGramMm2, FileUnit::InertiaKgMm2, FileUnit::MassGram, FileUnit::CentreMm];

    /// What it is called, and what to do.
    pub(crate) fn words(self) -> [&'static str; 2] {
        match self {
            FileUnit::InertiaGramMm2 => ["link inertias of the URDF in g mm^2", "divide the URDF's inertias by 1e9"],
            FileUnit::InertiaKgMm2 => [
                "link inertias of the URDF in kg mm^2 (or g m^2)",
                "divide the URDF's inertias (kg mm^2: 1e6, g m^2: 1e3)",
            ],
            FileUnit::MassGram => ["link masses of the URDF in g", "divide the URDF's masses by 1000"],
            FileUnit::CentreMm => ["centres of mass of the URDF in mm", "divide the URDF's centres of mass by 1000"],
        }
    }
}

/// What the arm is like, compared together with how its log is read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ArmState {
    /// The values of the robot file, as wrong as CAD and data sheets are.
    Nominal,
    /// The values of the robot file, identified before.
    Accurate,
    /// Bodies from CAD with estimated friction and rotor inertia.
    RoughDrives,
    /// Estimated masses and friction.
    Rough,
    /// A payload or tool more, or less.
    Payload,
    /// Constant torques.
    Offsets,
    /// A spring or counterbalance about a joint (from 0).
    Counterbalance(usize),
    /// Friction that changes while it is logged.
    Drift,
    /// Torque behind the gear: friction and rotor inertia about 0.
    LinkSide,
    /// Torque computed by a model of the links.
    Computed,
    /// Torque computed by the file's own model, as a controller commands it.
    Commanded,
    /// Bodies of another arm.
    OtherArm,
    /// A unit in the URDF.
    FileUnit(FileUnit),
}

impl ArmState {
    /// All that are compared for the log as it is, with their probabilities.
    pub(crate) fn all(joints: usize) -> Vec<(ArmState, f64)> {
        let mut states = vec![
            (ArmState::Accurate, p::ACCURATE),
            (ArmState::RoughDrives, p::ROUGH_DRIVES),
            (ArmState::Rough, p::ROUGH),
            (ArmState::Payload, p::PAYLOAD),
            (ArmState::Offsets, p::OFFSETS),
            (ArmState::Drift, p::DRIFT),
            (ArmState::LinkSide, p::LINK_SIDE),
            (ArmState::Computed, p::COMPUTED),
            (ArmState::Commanded, p::COMMANDED),
            (ArmState::OtherArm, p::OTHER_ARM),
        ];
        states.extend((0..joints).map(|j| (ArmState::Counterbalance(j), p::COUNTERBALANCE / joints as f64)));
        states.extend(FileUnit::ALL.map(|unit| (ArmState::FileUnit(unit), p::FILE_UNIT)));
        let others: f64 = states.iter().map(|(_, probability)| probability).sum();
        states.insert(0, (ArmState::Nominal, 1.0 - others));
        states
    }

    /// Those that are compared beside a fault of the log; the others are rare twice over.
    pub(crate) fn beside_faults() -> Vec<(ArmState, f64)> {
        let kept = [
            ArmState::Nominal,
            ArmState::Accurate,
            ArmState::RoughDrives,
            ArmState::Rough,
            ArmState::Payload,
            ArmState::Offsets,
            ArmState::LinkSide,
            ArmState::OtherArm,
        ];
        ArmState::all(0).into_iter().filter(|(state, _)| kept.contains(state)).collect()
    }

    /// Whether the log's signals are those that the contract asks for, and the arm is the file's with values that stay.
    pub fn is_sound(self) -> bool {
        !matches!(
            self,
            ArmState::Drift
                | ArmState::LinkSide
                | ArmState::Computed
                | ArmState::Commanded
                | ArmState::OtherArm
                | ArmState::FileUnit(_)
        )
    }
}

/// What of the robot file the priors need.
#[derive(Clone, Copy, Debug)]
pub struct RobotFile<'a> {
    /// Kinematics and the structure of the drives.
    pub model: &'a Model,
    /// Nominal standard parameters, as [`Model::nominal`].
    pub nominal: &'a [f64],
    /// Torque limit of each joint \[N m\]; infinite where there is none.
    pub torque_limit: &'a [f64],
}

impl RobotFile<'_> {
    pub(crate) fn joints(&self) -> usize {
        self.model.arm.dof()
    }

    fn size(&self) -> usize {
        self.model.len()
    }
}

/// Columns beside the model's: `[offset, sin q, cos q, drifting viscous, drifting Coulomb]`, one of each a joint.
pub(crate) const EXTRA_COLUMNS: usize = 5;

/// Gaussian prior of the values, and the share of torque that the model misses.
#[derive(Clone, Debug)]
pub(crate) struct ValuePrior {
    pub(crate) mean: Vec<f64>,
    /// 0 where a value is held.
    pub(crate) spread: Vec<f64>,
    /// Values that are never negative.
    pub(crate) positive: Vec<bool>,
    pub(crate) inadequacy: f64,
}

impl ValuePrior {
    /// `limit`: of each joint \[N m\], finite; `speed`, `acceleration`: rms of each joint as read.
    pub(crate) fn new(file: &RobotFile<'_>, state: ArmState, limit: &[f64], motion: &[[f64; 2]]) -> ValuePrior {
        let (joints, size) = (file.joints(), file.size());
        let mut mean = file.nominal.to_vec();
        if let ArmState::FileUnit(unit) = state {
            for body in mean[..joints * LINK_PARAMETERS].chunks_exact_mut(LINK_PARAMETERS) {
                mend_unit(body, unit);
            }
        }
        let [bodies, drives, rotors] = match state {
            ArmState::Rough | ArmState::Offsets => [p::ROUGH_BODY_SPREAD, p::ROUGH_DRIVE_SPREAD, p::ROUGH_DRIVE_SPREAD],
            ArmState::OtherArm => [p::OTHER_BODY_SPREAD, p::ROUGH_DRIVE_SPREAD, p::ROUGH_DRIVE_SPREAD],
            ArmState::RoughDrives => [p::BODY_SPREAD, p::ESTIMATED_DRIVE_SPREAD, p::ESTIMATED_DRIVE_SPREAD],
            ArmState::Accurate => p::ACCURATE_SPREADS,
            _ => [p::BODY_SPREAD, p::FRICTION_SPREAD, p::ROTOR_SPREAD],
        };
        let rough = drives >= p::ROUGH_DRIVE_SPREAD;
        let behind_gear = matches!(state, ArmState::LinkSide | ArmState::Computed);
        let mut spread = vec![0.0; size + EXTRA_COLUMNS * joints];
        for body in 0..joints {
            let place = body * LINK_PARAMETERS..(body + 1) * LINK_PARAMETERS;
            spread[place.clone()].copy_from_slice(&body_spread(&mean[place], bodies));
        }
        // Bodies that the URDF does not have are a guess of known width.
        for (spread, unknown) in spread.iter_mut().zip(file.model.unknown_bodies()) {
            *spread = spread.max(*unknown);
        }
        if state == ArmState::Payload {
            let mass: f64 = (0..joints).map(|j| mean[j * LINK_PARAMETERS]).sum();
            let more = p::PAYLOAD_OVER_MASS * mass;
            let last = &mut spread[(joints - 1) * LINK_PARAMETERS..joints * LINK_PARAMETERS];
            for (entry, spread) in last.iter_mut().enumerate() {
                let lever = [0, 1, 1, 1, 2, 2, 2, 2, 2, 2][entry];
                *spread = spread.hypot(more * p::PAYLOAD_LEVER_M.powi(lever));
            }
        }
        let mut positive = vec![false; spread.len()];
        for (place, parameter) in file.model.parameters.iter().enumerate().skip(joints * LINK_PARAMETERS) {
            let value = file.nominal[place].abs();
            let j = parameter.joint().unwrap_or(0);
            let [speed, acceleration] = motion[j].map(|x| x.max(f64::MIN_POSITIVE));
            // What is not known is worth a share of the limit at the joint's own motion.
            let unknown = if rough || value == 0.0 { p::UNKNOWN_FRICTION_OVER_LIMIT * limit[j] } else { 0.0 };
            positive[place] = matches!(
                parameter,
                Parameter::RotorInertia(_) | Parameter::Viscous(_) | Parameter::Coulomb(_) | Parameter::CouplingInertia
            );
            spread[place] = match parameter {
                Parameter::RotorInertia(_) | Parameter::CouplingInertia => (rotors * value)
                    .max(unknown.min(limit[j]) / acceleration * f64::from(u8::from(value == 0.0 || rough))),
                Parameter::Viscous(_) | Parameter::CouplingViscous => (drives * value).max(unknown / speed),
                Parameter::Coulomb(_) | Parameter::CouplingCoulomb => (drives * value).max(unknown),
                Parameter::ViscousQuadratic(_) => (drives * value).max(unknown / speed.powi(2)),
                Parameter::LoadFriction(_) => (drives * value).max(p::UNKNOWN_FRICTION_OVER_LIMIT),
                Parameter::Offset(_) => value.max(offset_spread(state, limit[j])),
                Parameter::Link { .. } => spread[place],
            };
            let drive = !matches!(parameter, Parameter::Offset(_));
            if behind_gear && drive {
                spread[place] =
                    p::LINK_SIDE_SPREAD * value.max(p::UNKNOWN_FRICTION_OVER_LIMIT * f64::from(u8::from(value > 0.0)));
                mean[place] = 0.0;
            }
        }
        mean.resize(spread.len(), 0.0);
        let mut prior = ValuePrior { mean, spread, positive, inadequacy: p::INADEQUACY };
        prior.extra_columns(file, state, limit, motion);
        if state == ArmState::Computed {
            prior.inadequacy = p::COMPUTED_INADEQUACY;
        }
        if state == ArmState::Commanded {
            prior.inadequacy = p::COMMANDED_INADEQUACY;
            prior.spread = prior.mean.iter().map(|value| p::COMMANDED_INADEQUACY * value.abs()).collect();
        }
        prior
    }

    fn extra_columns(&mut self, file: &RobotFile<'_>, state: ArmState, limit: &[f64], motion: &[[f64; 2]]) {
        let (joints, size) = (file.joints(), file.size());
        let place = |column: usize, j: usize| size + column * joints + j;
        let value = |of: &dyn Fn(&Parameter) -> bool| {
            file.model.parameters.iter().position(of).map_or(0.0, |at| file.nominal[at].abs())
        };
        for j in 0..joints {
            if !file.model.structure.offset {
                self.spread[place(0, j)] = offset_spread(state, limit[j]);
            }
            if state == ArmState::Counterbalance(j) {
                self.spread[place(1, j)] = p::COUNTERBALANCE_OVER_LIMIT * limit[j];
                self.spread[place(2, j)] = p::COUNTERBALANCE_OVER_LIMIT * limit[j];
            }
            if state == ArmState::Drift {
                let unknown = p::UNKNOWN_FRICTION_OVER_LIMIT * limit[j];
                let known = [
                    value(&|p| *p == Parameter::Viscous(j)).max(unknown / motion[j][0].max(f64::MIN_POSITIVE) * 0.1),
                    value(&|p| *p == Parameter::Coulomb(j)).max(0.1 * unknown),
                ];
                for (column, known) in known.into_iter().enumerate() {
                    self.spread[place(3 + column, j)] = p::DRIFT_SPREAD * known;
                }
            }
        }
    }
}

fn offset_spread(state: ArmState, limit: f64) -> f64 {
    limit * if state == ArmState::Offsets { p::LARGE_OFFSET_OVER_LIMIT } else { p::OFFSET_OVER_LIMIT }
}

/// Standard deviations of a body's ten values, of one size in torque: by its mass and its radius about the joint.
fn body_spread(body: &[f64], share: f64) -> [f64; LINK_PARAMETERS] {
    let mass = body[0].abs();
    let first = (body[1].powi(2) + body[2].powi(2) + body[3].powi(2)).sqrt();
    let inertia = (body[4].abs() + body[6].abs() + body[9].abs()) / 2.0;
    let radius = if mass > 0.0 { (first / mass).max((inertia / mass).sqrt()) } else { 0.0 };
    let [first, inertia] = [first.max(mass * radius), inertia.max(mass * radius * radius)];
    [mass, first, first, first, inertia, inertia, inertia, inertia, inertia, inertia].map(|size| share * size)
}

/// The body with its values read in another unit.
fn mend_unit(body: &mut [f64], unit: FileUnit) {
    let mass = body[0];
    if mass <= 0.0 {
        return;
    }
    let centre = [body[1] / mass, body[2] / mass, body[3] / mass];
    let square: f64 = centre.iter().map(|c| c * c).sum();
    let tensor = [[body[4], body[5], body[7]], [body[5], body[6], body[8]], [body[7], body[8], body[9]]];
    let mut at_centre = [[0.0; 3]; 3];
    for a in 0..3 {
        for b in 0..3 {
            let steiner = mass * (if a == b { square } else { 0.0 } - centre[a] * centre[b]);
            at_centre[a][b] = tensor[a][b] - steiner;
        }
    }
    let [masses, centres, inertias] = match unit {
        FileUnit::InertiaGramMm2 => [1.0, 1.0, 1e-9],
        FileUnit::InertiaKgMm2 => [1.0, 1.0, 1e-6],
        FileUnit::MassGram => [1e-3, 1.0, 1.0],
        FileUnit::CentreMm => [1.0, 1e-3, 1.0],
    };
    let mended =
        body_from_com(masses * mass, &centre.map(|c| centres * c), &at_centre.map(|row| row.map(|i| inertias * i)));
    body.copy_from_slice(&mended);
}
