//! How wrong a parameter set is, in torque, where the true values are known.

use rivet_config::Robot;
use rivet_dynamics::{ParameterGroup, Workspace};

/// Groups in the order they are shown.
pub const GROUPS: [(ParameterGroup, &str); 5] = [
    (ParameterGroup::Inertial, "link inertia"),
    (ParameterGroup::RotorInertia, "rotor inertia"),
    (ParameterGroup::Friction, "friction"),
    (ParameterGroup::Offset, "torque offset"),
    (ParameterGroup::Coupling, "wrist coupling"),
];

/// Weighs parameter errors by the torque they cause over typical motion.
#[derive(Clone, Debug)]
pub struct Reference {
    /// True base parameters, in the order of the robot's base set.
    pub truth: Vec<f64>,
    /// Members of each group of [`GROUPS`].
    members: Vec<Vec<usize>>,
    /// Rows of the regressor over the reference motion, each divided by its joint's torque limit.
    rows: Vec<Vec<f64>>,
}

/// States of the reference motion.
const STATES: usize = 64;

impl Reference {
    /// `truth`: true base parameters of `robot`.
    #[must_use]
    pub fn new(robot: &Robot, truth: Vec<f64>) -> Reference {
        let (model, base) = (&robot.model, &robot.base);
        let members_of = |group| (0..base.len()).filter(|&i| base.parameter(model, i).group() == group).collect();
        let members: Vec<Vec<usize>> = GROUPS.iter().map(|(group, _)| members_of(*group)).collect();
        let dof = model.arm.dof();
        let mut workspace = Workspace::new(&model.arm);
        let (mut full, mut selected) = (vec![0.0; dof * model.len()], vec![0.0; dof * base.len()]);
        let mut rows = Vec::with_capacity(STATES * dof);
        for state in 0..STATES {
            // A Halton-like lattice: spread evenly, the same every time.
            let at =
                |axis: usize| ((state + 1) as f64 * (0.618_033_988_749_895 + axis as f64 * 0.137)).fract() * 2.0 - 1.0;
            let (mut q, mut qd, mut qdd) = (vec![0.0; dof], vec![0.0; dof], vec![0.0; dof]);
            for (j, joint) in model.arm.joints.iter().enumerate() {
                let (low, high) = (joint.lower.max(-3.0), joint.upper.min(3.0));
                let speed = if joint.velocity > 0.0 { joint.velocity.min(5.0) } else { 2.0 };
                q[j] = 0.5 * (low + high) + 0.4 * (high - low) * at(3 * j);
                qd[j] = 0.5 * speed * at(3 * j + 1);
                qdd[j] = 2.0 * speed * at(3 * j + 2);
            }
            model.regressor(&mut workspace, &q, &qd, &qdd, &mut full);
            base.select(&full, model.len(), &mut selected);
            for (j, row) in selected.chunks_exact(base.len()).enumerate() {
                let limit = robot.config.drive.torque_limit[j];
                rows.push(row.iter().map(|y| y / limit).collect());
            }
        }
        Reference { truth, members, rows }
    }

    /// Torque error that the errors of each group cause by themselves, rms over the reference motion, in percent of the
    /// torque limits; then that of all together.
    #[must_use]
    pub fn errors(&self, x: &[f64]) -> Vec<f64> {
        let mut errors: Vec<f64> = self.members.iter().map(|members| self.rms(x, members)).collect();
        let all: Vec<usize> = (0..self.truth.len()).collect();
        errors.push(self.rms(x, &all));
        errors
    }

    /// Whether the model has any parameter of group `g`.
    #[must_use]
    pub fn has(&self, g: usize) -> bool {
        !self.members[g].is_empty()
    }

    fn rms(&self, x: &[f64], members: &[usize]) -> f64 {
        let square: f64 = self
            .rows
            .iter()
            .map(|row| members.iter().map(|&i| row[i] * (x[i] - self.truth[i])).sum::<f64>().powi(2))
            .sum();
        100.0 * (square / self.rows.len() as f64).sqrt()
    }
}
