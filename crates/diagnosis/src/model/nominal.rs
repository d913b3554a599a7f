//! The nominal model: its standard columns, and priors of how wrong its values usually are.

use rivet_dynamics::{Model, Parameter, Places, Structure, Workspace, com_from_body};

use crate::model::rows::{Chain, Column};
use crate::model::run::{Motion, Run};
use crate::numerics::parallel::{self, chunks, joined};
use crate::policy::POLICY;

/// What each joint's signals typically are (root mean squares).
pub(crate) struct Typical {
    /// \[N·m\]
    torque: Vec<f64>,
    /// \[rad/s\]
    speed: Vec<f64>,
    /// \[rad/s²\]
    accel: Vec<f64>,
}

impl Typical {
    /// \[N·m\]
    pub(crate) fn torque(&self, joint: usize) -> f64 {
        self.torque[joint]
    }

    /// \[rad/s\]
    pub(crate) fn speed(&self, joint: usize) -> f64 {
        self.speed[joint]
    }

    pub(crate) fn from_runs(runs: &[Run], joints: usize) -> Typical {
        let motions: Vec<Motion> = runs.iter().map(Motion::from_run).collect();
        let rms = |signals: &mut dyn Iterator<Item = &Vec<f64>>| {
            let (square, rows) = signals.flatten().fold((0.0, 0.0), |(s, n), t| (s + t * t, n + 1.0));
            f64::sqrt(square / f64::max(rows, 1.0)).max(1e-9)
        };
        Typical {
            torque: (0..joints).map(|j| rms(&mut runs.iter().map(|r| &r.tau[j]))).collect(),
            speed: (0..joints).map(|j| rms(&mut motions.iter().map(|m| &m.qd[j]))).collect(),
            accel: (0..joints).map(|j| rms(&mut motions.iter().map(|m| &m.qdd[j]))).collect(),
        }
    }
}

/// The model with offsets, its nominal values and their usual errors.
pub(crate) struct Nominal {
    /// The robot's model, with a constant torque each joint.
    pub(crate) model: Model,
    /// Standard vector.
    pub(crate) x: Vec<f64>,
    /// Standard deviation of each entry's error.
    pub(crate) std: Vec<f64>,
    /// Standard vector by which it is told what a log cannot show: as `x`, but for friction that a first fit has more of, and for
    /// rotors that the file does not know (`first_fit`).
    pub(crate) near: Vec<f64>,
}

impl Nominal {
    /// `typical`: of the joints' signals, for parameters that the file says nothing about.
    pub(crate) fn new(model: &Model, nominal: &[f64], typical: &Typical) -> Nominal {
        let structure = Structure { offset: true, ..model.structure };
        let with_offset = Model::new(model.arm.clone(), structure)
            .with_load(model.load().to_vec())
            .with_effects(model.effects().clone());
        let value = |p: &Parameter| model.parameters.iter().position(|q| q == p).map_or(0.0, |i| nominal[i]);
        let x: Vec<f64> = with_offset.parameters.iter().map(value).collect();
        let std = with_offset.parameters.iter().map(|p| usual_error(*p, &with_offset, &x, typical)).collect();
        Nominal { model: with_offset, near: x.clone(), x, std }
    }

    /// A model whose values are not in doubt.
    pub(crate) fn exact(model: &Model, x: &[f64]) -> Nominal {
        Nominal { model: model.clone(), x: x.to_vec(), std: vec![0.0; x.len()], near: x.to_vec() }
    }
}

fn usual_error(parameter: Parameter, model: &Model, x: &[f64], typical: &Typical) -> f64 {
    let torque = &typical.torque;
    let nominal_size = |p: Parameter| model.parameters.iter().position(|q| *q == p).map_or(0.0, |i| x[i].abs());
    let missing = nominal_size(parameter) == 0.0;
    match parameter {
        Parameter::RotorInertia(j) if missing => POLICY.priors.missing_torque_share * torque[j] / typical.accel[j],
        Parameter::Viscous(j) if missing => POLICY.priors.missing_torque_share * torque[j] / typical.speed[j],
        Parameter::Coulomb(j) if missing => POLICY.priors.missing_torque_share * torque[j],
        Parameter::Link { link, entry } => {
            let body: [f64; 10] = std::array::from_fn(|e| x[Places::link(link).start + e]);
            let (mass, com, inertia) = com_from_body(&body);
            let trace = inertia[0][0] + inertia[1][1] + inertia[2][2];
            // Radius of gyration: the length by which a body's centre may be off without looking absurd.
            let size = if mass > 0.0 { (trace / (2.0 * mass)).max(1e-6).sqrt() } else { 0.01 };
            let arm = com.iter().map(|c| c * c).sum::<f64>().sqrt();
            let mass = mass.max(1e-3);
            match entry {
                0 => POLICY.priors.body * mass,
                1..=3 => POLICY.priors.body * mass * (arm * arm + size * size).sqrt(),
                _ => 1.5 * POLICY.priors.body * mass * (arm * arm + size * size).max(1e-6),
            }
        }
        // Without unit or scale of their own: as far off as themselves, or a hundredth of the torque.
        Parameter::LoadFriction(_) => nominal_size(parameter).max(0.05),
        Parameter::ViscousQuadratic(j) => nominal_size(parameter).max(0.01 * torque[j]),
        Parameter::RotorInertia(j) => POLICY.priors.rotor * nominal_size(parameter).max(1e-4 * torque[j]),
        Parameter::Viscous(j) | Parameter::Coulomb(j) => {
            POLICY.priors.friction * nominal_size(parameter).max(0.05 * torque[j])
        }
        Parameter::Offset(j) => {
            let friction = nominal_size(Parameter::Coulomb(j));
            if friction == 0.0 {
                POLICY.priors.offset_unmeasured * POLICY.priors.missing_torque_share * torque[j]
            } else {
                POLICY.priors.offset * friction.max(0.05 * torque[j])
            }
        }
        Parameter::CouplingInertia | Parameter::CouplingViscous | Parameter::CouplingCoulomb => {
            POLICY.priors.friction * nominal_size(parameter).max(1e-3)
        }
    }
}

/// Rows of every standard column along a motion.
pub(crate) fn standard_columns(model: &Model, motion: &Motion, chain: &Chain) -> Vec<Column> {
    let (n, width) = (motion.joints(), model.len());
    let average = chain.average();
    let groups = motion.len() / average;
    // Only means are kept: all full-rate columns at once would not fit into memory for a long log.
    let chunk = |(from, to): &(usize, usize)| {
        let mut ws = Workspace::new(&model.arm);
        let (mut q, mut qd, mut qdd) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        let mut y = vec![0.0; n * width];
        let mut means = vec![Vec::with_capacity(to - from); n * width];
        for group in *from..*to {
            for mean in &mut means {
                mean.push(0.0);
            }
            for k in group * average..(group + 1) * average {
                motion.state(k, &mut q, &mut qd, &mut qdd);
                model.regressor(&mut ws, &q, &qd, &qdd, &mut y);
                for (mean, value) in means.iter_mut().zip(&y) {
                    mean[group - from] += value;
                }
            }
            for mean in &mut means {
                mean[group - from] /= average as f64;
            }
        }
        means
    };
    let means = joined(parallel::map(&chunks(groups), chunk), n * width);
    let rows = parallel::map(&means, |mean| mean.iter().any(|v| *v != 0.0).then(|| chain.filtered(mean.clone())));
    (0..width).map(|c| (0..n).map(|j| rows[j * width + c].clone()).collect()).collect()
}
