//! Models from the nominal one to the one with all causes, with their torque and gap along a run.

use std::ops::Range;

use nalgebra::DVector;

use crate::model::gap::Gap;
use crate::model::rows::Column;
use crate::screen::prepared::Prepared;

/// Rows of one run's torque under successive models: `models[stage][joint][row]`.
pub(crate) struct Stages {
    /// Measured torque.
    pub(crate) tau: Vec<Vec<f64>>,
    pub(crate) models: Vec<Vec<Vec<f64>>>,
    /// `[joint][row]`: by how much friction turns over more softly than all of them say, as found; empty where nobody asked.
    pub(crate) turned: Vec<Vec<f64>>,
}

impl Stages {
    /// Gaps of the models, and the same beside how softly friction turns over: a joint that creeps misses most by that, whatever else is
    /// right.
    pub(crate) fn gaps(&self) -> [Vec<Gap>; 2] {
        let gaps = |tau: &[Vec<f64>]| self.models.iter().map(|model| Gap::new(tau, model)).collect();
        let less =
            |(tau, turned): (&Vec<f64>, &Vec<f64>)| tau.iter().zip(turned).map(|(tau, turned)| tau - turned).collect();
        let sliding: Vec<Vec<f64>> = self.tau.iter().zip(&self.turned).map(less).collect();
        let all_rows: Vec<Gap> = gaps(&self.tau);
        let without_turns = if sliding.is_empty() { all_rows.clone() } else { gaps(&sliding) };
        [all_rows, without_turns]
    }
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
        let model_columns = &self.run.standard;
        model_columns.get(c).unwrap_or_else(|| &self.extra[c - model_columns.len()])
    }

    /// Torque of the nominal model, then with each step's columns added. `means` are the prior means that the design took
    /// out of the coefficients.
    pub(crate) fn stages(&self, nominal: &[f64], steps: &Steps, x: &DVector<f64>, means: &[f64]) -> Stages {
        let (joints, rows) = (self.run.tau.len(), self.run.rows());
        let mut model = vec![vec![0.0; rows]; joints];
        for (c, value) in nominal.iter().enumerate() {
            self.add(&mut model, c, *value);
        }
        for (to, known) in model.iter_mut().zip(&self.run.known_rows) {
            to.iter_mut().zip(known).for_each(|(to, k)| *to += k);
        }
        let mut models = vec![model.clone()];
        for step in steps {
            for c in step {
                self.add(&mut model, *c, x[*c] + means[*c]);
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
        Stages { tau, models, turned: Vec::new() }
    }

    /// The same, beside how softly friction turns over, whose columns are `turns`.
    pub(crate) fn stages_turned(
        &self,
        nominal: &[f64],
        steps: &Steps,
        x: &DVector<f64>,
        means: &[f64],
        turns: Range<usize>,
    ) -> Stages {
        let mut turned = vec![vec![0.0; self.run.rows()]; self.run.tau.len()];
        for c in turns {
            self.add(&mut turned, c, x[c] + means[c]);
        }
        for (rows, _) in turned.iter_mut().zip(&self.run.silent).filter(|(_, silent)| silent.is_some()) {
            rows.fill(0.0);
        }
        Stages { turned, ..self.stages(nominal, steps, x, means) }
    }

    fn add(&self, torque: &mut [Vec<f64>], c: usize, factor: f64) {
        for (to, values) in torque.iter_mut().zip(self.column(c)) {
            if let Some(values) = values {
                to.iter_mut().zip(values).for_each(|(to, v)| *to += factor * v);
            }
        }
    }
}

/// Mean squares by joint.
pub(crate) fn mean_square(signals: &[Vec<f64>]) -> Vec<f64> {
    signals.iter().map(|s| s.iter().map(|v| v * v).sum::<f64>() / s.len().max(1) as f64).collect()
}
