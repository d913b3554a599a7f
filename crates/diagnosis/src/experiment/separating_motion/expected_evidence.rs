//! Expected log evidence of a motion for one member of a class against another.

use nalgebra::{Cholesky, DMatrix, DVector};

use crate::effects::Form;
use crate::effects::candidates;
use crate::effects::physics::Physics;
use crate::fit::refinement::climb;
use crate::model::rows::{Chain, Column};
use crate::numerics::parallel;

use super::Class;

/// Steps of inner values of an imitation, halved so many times.
const IMITATION_HALVINGS: usize = 3;

/// The model's columns along one motion, in units of each joint's noise.
pub(super) struct Record<'a> {
    chain: &'a Chain,
    noise: &'a [f64],
    /// Rows by columns, each joint.
    model: Vec<DMatrix<f64>>,
    gram: DMatrix<f64>,
}

impl<'a> Record<'a> {
    pub(super) fn new(standard: &[Column], chain: &'a Chain, noise: &'a [f64]) -> Record<'a> {
        let model: Vec<DMatrix<f64>> = (0..noise.len()).map(|j| matrix(standard, j, noise)).collect();
        let mut gram = DMatrix::zeros(standard.len(), standard.len());
        for d in &model {
            // Far faster than products of columns.
            gram += d.transpose() * d;
        }
        Record { chain, noise, model, gram }
    }

    fn columns(&self, form: &Form, physics: &Physics<'_>) -> Vec<DMatrix<f64>> {
        let columns: Vec<Column> =
            form.columns(physics).into_iter().map(|full| crate::model::rows::column(self.chain, full)).collect();
        (0..self.noise.len()).map(|j| matrix(&columns, j, self.noise)).collect()
    }

    /// What a form adds with coefficients `c`.
    fn torque(&self, form: &Form, c: &[f64], physics: &Physics<'_>) -> Vec<DVector<f64>> {
        let c = DVector::from_column_slice(c);
        self.columns(form, physics)
            .iter()
            .map(|m| if m.ncols() == c.len() { m * &c } else { DVector::zeros(0) })
            .collect()
    }
}

/// One joint's rows by columns, in units of its noise.
fn matrix(columns: &[Column], joint: usize, noise: &[f64]) -> DMatrix<f64> {
    let rows = columns.iter().find_map(|c| c[joint].as_ref()).map_or(0, Vec::len);
    let mut matrix = DMatrix::zeros(rows, columns.len());
    for (c, column) in columns.iter().enumerate() {
        if let Some(values) = &column[joint] {
            matrix.column_mut(c).iter_mut().zip(values).for_each(|(to, v)| *to = v / noise[joint]);
        }
    }
    matrix
}

/// Normal equations of the model's columns and a form's against a torque.
#[derive(Clone)]
struct Sums {
    gram: DMatrix<f64>,
    product: DVector<f64>,
    square: f64,
}

impl Sums {
    /// `deviations`: of the model's values; a form's coefficients are free, but not without end.
    fn new(deviations: &[f64], form: &Form) -> Sums {
        let (width, columns) = (deviations.len(), form.coefficients());
        let mut gram = DMatrix::zeros(width + columns, width + columns);
        for (i, deviation) in deviations.iter().enumerate() {
            gram[(i, i)] = 1.0 / deviation.max(1e-9).powi(2);
        }
        for c in width..width + columns {
            gram[(c, c)] = 1e-9;
        }
        Sums { gram, product: DVector::zeros(width + columns), square: 0.0 }
    }

    fn add(&mut self, record: &Record<'_>, own: &[DMatrix<f64>], torque: &[DVector<f64>]) {
        let width = record.gram.nrows();
        let columns = self.product.len() - width;
        self.gram.view_mut((0, 0), (width, width)).zip_apply(&record.gram, |s, v| *s += v);
        for ((d, c), y) in record.model.iter().zip(own).zip(torque) {
            if c.nrows() > 0 && c.ncols() == columns {
                let cross = d.tr_mul(c);
                self.gram.view_mut((0, width), (width, columns)).zip_apply(&cross, |s, v| *s += v);
                self.gram.view_mut((width, 0), (columns, width)).zip_apply(&cross.transpose(), |s, v| *s += v);
                self.gram.view_mut((width, width), (columns, columns)).zip_apply(&c.tr_mul(c), |s, v| *s += v);
            }
            if y.is_empty() {
                continue;
            }
            self.product.rows_mut(0, width).zip_apply(&d.tr_mul(y), |s, v| *s += v);
            if c.nrows() > 0 && c.ncols() == columns {
                self.product.rows_mut(width, columns).zip_apply(&c.tr_mul(y), |s, v| *s += v);
            }
            self.square += y.norm_squared();
        }
    }

    /// What is left of the torque when values and form do their best, and the form's coefficients.
    fn solve(&self, columns: usize) -> Option<(f64, Vec<f64>)> {
        let x = Cholesky::new(self.gram.clone())?.solve(&self.product);
        let residual_square = self.square - self.product.dot(&x);
        Some((residual_square, x.rows(x.len() - columns, columns).iter().copied().collect()))
    }
}

/// One member of a class as the truth, and another, with any inner values, that imitates it.
pub(super) struct Duel<'a> {
    logs: &'a [(&'a Record<'a>, &'a Physics<'a>)],
    deviations: &'a [f64],
    truth: (Form, Vec<f64>),
    /// What the truth adds to the logs.
    torques: Vec<Vec<DVector<f64>>>,
    /// The imitator's forms with their equations over the logs.
    imitations: Vec<(Form, Sums)>,
    /// What the best of them leaves of the logs.
    left: f64,
}

/// Every member of the class against every other; a rival is as large as it has to be to look like what was chosen.
pub(super) fn duels<'a>(
    class: &Class<'_>,
    logs: &'a [(&'a Record<'a>, &'a Physics<'a>)],
    deviations: &'a [f64],
) -> Option<Vec<Duel<'a>>> {
    let chosen = (class.form.clone(), class.coefficients.clone());
    let mut duels = Vec::new();
    for rival in &class.rivals {
        let (duel, best) = Duel::new(chosen.clone(), rival, logs, deviations)?;
        let (back, _) = Duel::new(best, class.form, logs, deviations)?;
        duels.extend([duel, back]);
    }
    Some(duels)
}

impl<'a> Duel<'a> {
    /// The truth against all forms of a rival's effect, and the best of these on the logs with its coefficients.
    fn new(
        truth: (Form, Vec<f64>),
        rival: &Form,
        logs: &'a [(&'a Record<'a>, &'a Physics<'a>)],
        deviations: &'a [f64],
    ) -> Option<(Duel<'a>, (Form, Vec<f64>))> {
        let torques =
            logs.iter().map(|(record, physics)| record.torque(&truth.0, &truth.1, physics)).collect::<Vec<_>>();
        let forms = candidates::alike(rival, logs.first()?.1);
        let mut duel = Duel { logs, deviations, truth, torques, imitations: Vec::new(), left: 0.0 };
        duel.imitations = parallel::map(&forms, |form| (form.clone(), duel.over_logs(form)));
        let solved =
            duel.imitations.iter().filter_map(|(form, sums)| Some((sums.solve(form.coefficients())?, form.clone())));
        let ((left, c), form) = solved.min_by(|a, b| a.0.0.total_cmp(&b.0.0))?;
        duel.left = left;
        Some((duel, (form, c)))
    }

    /// A form's equations over the logs.
    fn over_logs(&self, form: &Form) -> Sums {
        let mut sums = Sums::new(self.deviations, form);
        for ((record, physics), torque) in self.logs.iter().zip(&self.torques) {
            sums.add(record, &record.columns(form, physics), torque);
        }
        sums
    }

    /// Twice the log evidence that a motion is expected to give against every imitation as it stands in the library, and which does best.
    pub(super) fn separation(&self, record: &Record<'_>, physics: &Physics<'_>) -> Option<(f64, Form)> {
        let torque = record.torque(&self.truth.0, &self.truth.1, physics);
        let residual_squares = parallel::map(&self.imitations, |(form, sums)| {
            let mut sums = sums.clone();
            sums.add(record, &record.columns(form, physics), &torque);
            Some((sums.solve(form.coefficients())?.0, form.clone()))
        });
        let (residual_squares, form) = residual_squares.into_iter().flatten().min_by(|a, b| a.0.total_cmp(&b.0))?;
        Some((residual_squares - self.left, form))
    }

    /// The same against `form` with the inner values at which it imitates best.
    pub(super) fn at_best(&self, form: Form, record: &Record<'_>, physics: &Physics<'_>) -> Option<f64> {
        let torque = record.torque(&self.truth.0, &self.truth.1, physics);
        let judge = |form: Form| {
            let mut sums = self.over_logs(&form);
            sums.add(record, &record.columns(&form, physics), &torque);
            let residual_square = sums.solve(form.coefficients())?.0;
            Some((form, residual_square))
        };
        let best = climb(judge(form)?, IMITATION_HALVINGS, |(form, _)| form, |(_, left)| -left, judge);
        Some(best.1 - self.left)
    }
}
