//! Models from the one given to the one with all causes, and how far each is from the torque.

use nalgebra::DVector;

use crate::design::Prepared;
use crate::rows::Column;

/// Rows of one run's torque under successive models: `models[stage][joint][row]`.
pub(crate) struct Stages {
    /// Measured torque.
    pub(crate) tau: Vec<Vec<f64>>,
    pub(crate) models: Vec<Vec<Vec<f64>>>,
}

/// All columns of one run in the order of the design: the model's own, timing, adopted effects.
pub(crate) struct RunColumns<'a> {
    pub(crate) run: &'a Prepared,
    pub(crate) extra: Vec<Column>,
}

/// What a stage adds: columns and where their coefficients stand.
pub(crate) type Steps = Vec<Vec<usize>>;

impl RunColumns<'_> {
    fn column(&self, c: usize) -> &Column {
        let own = &self.run.standard;
        own.get(c).unwrap_or_else(|| &self.extra[c - own.len()])
    }

    /// Torque of the nominal model, then with each step's columns added. `means` are the prior means that the design took
    /// out of the coefficients.
    pub(crate) fn stages(&self, nominal: &[f64], steps: &Steps, x: &DVector<f64>, means: &[f64]) -> Stages {
        let (joints, rows) = (self.run.tau.len(), self.run.rows());
        let mut model = vec![vec![0.0; rows]; joints];
        let add = |model: &mut Vec<Vec<f64>>, c: usize, factor: f64| {
            for (to, values) in model.iter_mut().zip(self.column(c)) {
                if let Some(values) = values {
                    to.iter_mut().zip(values).for_each(|(to, v)| *to += factor * v);
                }
            }
        };
        for (c, value) in nominal.iter().enumerate() {
            add(&mut model, c, *value);
        }
        for (to, known) in model.iter_mut().zip(&self.run.known_rows) {
            to.iter_mut().zip(known).for_each(|(to, k)| *to += k);
        }
        let mut models = vec![model.clone()];
        for step in steps {
            for c in step {
                add(&mut model, *c, x[*c] + means[*c]);
            }
            models.push(model.clone());
        }
        Stages { tau: self.run.tau.clone(), models }
    }
}

/// Mean squares by joint.
pub(crate) fn mean_square(signals: &[Vec<f64>]) -> Vec<f64> {
    signals.iter().map(|s| s.iter().map(|v| v * v).sum::<f64>() / s.len().max(1) as f64).collect()
}

/// Mean square of what a stage leaves of the torque by joint, rows weighed by how sure the direction of friction is.
pub(crate) fn sure_mean_square(run: &Prepared, stages: &Stages, stage: usize, noise: &[f64]) -> Vec<f64> {
    (0..noise.len())
        .map(|j| {
            let weight = |k: usize| 1.0 / (1.0 + (run.doubt[j][k] / noise[j]).powi(2));
            let (tau, model) = (&stages.tau[j], &stages.models[stage][j]);
            let (error, total) = (0..tau.len()).fold((0.0, 0.0), |(e, n), k| {
                let w = weight(k);
                (e + w * (tau[k] - model[k]).powi(2), n + w)
            });
            error / f64::max(total, f64::MIN_POSITIVE)
        })
        .collect()
}
