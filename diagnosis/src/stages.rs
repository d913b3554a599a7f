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
        let mut tau = self.run.tau.clone();
        // A channel that says nothing is compared with nothing.
        let silent = (0..joints).filter(|j| self.run.silent[*j].is_some());
        for j in silent {
            for rows in models.iter_mut().chain([&mut tau]) {
                rows[j].fill(0.0);
            }
        }
        Stages { tau, models }
    }
}

/// Mean squares by joint.
pub(crate) fn mean_square(signals: &[Vec<f64>]) -> Vec<f64> {
    signals.iter().map(|s| s.iter().map(|v| v * v).sum::<f64>() / s.len().max(1) as f64).collect()
}
