//! How late the arm follows its torque, fitted as a delay and as a lag.
//!
//! The two differ in that a lag smears. In rows in which joints turn the torque as it was measured is fitted by all values of the model, all
//! joints at once, and by what the delay or the lag makes of the model's own torque,
//!
//! ```text
//! delay: τ(t) = m(t + d)      lag: τ(t) = m(t) + T ṁ(t)
//! ```
//!
//! with m of the values that the fit before came to. Which of the two it is says slow motion far from reversals alone: torque that is itself put
//! through a lag has less noise, the rate of a model's torque has more, and a reversal that reaches a row through the filters has a pulse that no
//! controller made. Below some ten milliseconds half a minute seldom tells.

use nalgebra::{Cholesky, DMatrix, DVector};

use super::{Early, Part};
use crate::effects::Form;
use crate::effects::current_loop_lag::Lag;
use crate::effects::physics::Physics;
use crate::effects::transport_delay::Delay;
use crate::model::nominal::Nominal;
use crate::model::rows::Column;
use crate::screen::prepared::Prepared;

/// Fits, each with the model's torque of the one before.
const TORQUE_REFITS: usize = 5;
/// Delay and lag are told apart below this \[Hz\]: further up is the noise of accelerations, of which a lag wants the rate.
pub(crate) const SLOW_HZ: f64 = 8.0;

/// By how much the arm follows its torque late.
pub(crate) struct Behind {
    /// The delay that leaves least \[s\], and the time constant of the lag that does.
    pub(crate) delay: f64,
    pub(crate) lag: f64,
    /// Log likelihood by which the delay is ahead of the lag.
    pub(crate) ahead: f64,
}

impl Behind {
    /// None where not all runs are sure that all of the arm is, or where neither makes sense.
    pub(crate) fn fit(runs: &[&Prepared], nominal: &Nominal, early: &Early) -> Option<Behind> {
        let start = early.sure?;
        let fits = |runs: &[&Prepared], parts: &[Part]| {
            let rows = Rows::new(runs, nominal, parts);
            let values = rows.with_torque_moved(-start)?;
            let delay = rows.fitted(Delay { seconds: start }.into(), values.clone())?;
            Some((delay, rows.fitted(Lag { stands: false }.into(), values)?))
        };
        let ((delay, _), (lag, _)) = fits(runs, &early.parts)?;
        // A reversal that is yet to come through the filters looks like a delay: a lag would need a pulse there, which no controller makes.
        let slow: Vec<Prepared> = runs.iter().map(|run| run.up_to(SLOW_HZ, nominal)).collect();
        let slow: Vec<&Prepared> = slow.iter().collect();
        let ahead =
            fits(&slow, &super::clear(&slow)).map_or(0.0, |((_, by_delay), (_, by_lag))| 0.5 * (by_lag - by_delay));
        Some(Behind { delay, lag, ahead })
    }
}

/// Equations of all values of the model.
struct Rows<'a> {
    runs: &'a [&'a Prepared],
    nominal: &'a Nominal,
    parts: &'a [Part],
    /// Of the columns with each other.
    gram: DMatrix<f64>,
}

impl<'a> Rows<'a> {
    fn new(runs: &'a [&'a Prepared], nominal: &'a Nominal, parts: &'a [Part]) -> Rows<'a> {
        let count = runs.first().map_or(0, |run| run.standard.len());
        let mut gram = DMatrix::zeros(count, count);
        for part in parts {
            let columns = columns_of(runs[part.run], part);
            for (a, x) in &columns {
                for (b, y) in columns.iter().filter(|(b, _)| b <= a) {
                    gram[(*a, *b)] += part.product(x, y);
                }
            }
        }
        gram.fill_upper_triangle_with_lower_triangle();
        Rows { runs, nominal, parts, gram }
    }

    /// Products of the columns with a signal, which is `[part][row]`.
    fn products(&self, signal: &[Vec<f64>]) -> DVector<f64> {
        let mut products = DVector::zeros(self.gram.nrows());
        for (part, signal) in self.parts.iter().zip(signal) {
            for (c, x) in columns_of(self.runs[part.run], part) {
                products[c] += part.product(x, signal);
            }
        }
        products
    }

    fn dot(&self, a: &[Vec<f64>], b: &[Vec<f64>]) -> f64 {
        self.parts.iter().zip(a.iter().zip(b)).map(|(part, (a, b))| part.product(a, b)).sum()
    }

    /// Measured torque less that of known effects, as rows of it `seconds` later.
    fn torque(&self, seconds: f64) -> Vec<Vec<f64>> {
        let torque_of_part = |part: &Part| {
            let run = self.runs[part.run];
            let mut tau = run.chain.apply_later(&run.run.tau[part.joint], &[seconds]).remove(0);
            if let Some(known) = run.known_rows.get(part.joint) {
                tau.iter_mut().zip(known).for_each(|(tau, known)| *tau -= known);
            }
            tau
        };
        self.parts.iter().map(torque_of_part).collect()
    }

    /// Standard vector by torque that is moved in time.
    fn with_torque_moved(&self, seconds: f64) -> Option<Vec<f64>> {
        let (x, _) = solved(&self.gram, &self.products(&self.torque(seconds)))?;
        Some(x.iter().copied().collect())
    }

    /// Size of a delay or lag beside all values, and the weighted sum of squares that is left.
    fn fitted(&self, mut form: Form, mut values: Vec<f64>) -> Option<(f64, f64)> {
        let tau = self.torque(0.0);
        let (products, square) = (self.products(&tau), self.dot(&tau, &tau));
        let count = self.gram.nrows();
        let mut found = None;
        for _ in 0..TORQUE_REFITS {
            let made = |run: &&Prepared| -> Option<Column> {
                run.columns(&form, &Physics::new(&run.run, &run.motion, self.nominal, &values)).pop()
            };
            let columns: Vec<Column> = self.runs.iter().map(made).collect::<Option<_>>()?;
            let candidate: Vec<Vec<f64>> =
                self.parts.iter().map(|part| columns[part.run][part.joint].clone()).collect::<Option<_>>()?;
            let mut gram = self.gram.clone().resize(count + 1, count + 1, 0.0);
            let cross = self.products(&candidate);
            gram.view_mut((count, 0), (1, count)).copy_from(&cross.transpose());
            gram.view_mut((0, count), (count, 1)).copy_from(&cross);
            gram[(count, count)] = self.dot(&candidate, &candidate);
            let right = products.clone().push(self.dot(&candidate, &tau));
            let (x, explained) = solved(&gram, &right)?;
            let c = x[count];
            if !(c > 0.0 && c.is_finite()) {
                return None;
            }
            values = x.iter().take(count).copied().collect();
            let size = match form.get() {
                Some(&Delay { seconds }) => {
                    let longer = Delay { seconds: seconds * c };
                    form = longer.clone().into();
                    longer.seconds
                }
                None => c,
            };
            found = Some((size, square - explained));
        }
        found
    }
}

impl Part {
    fn product(&self, x: &[f64], y: &[f64]) -> f64 {
        self.weight * self.rows.iter().map(|k| x[*k] * y[*k]).sum::<f64>()
    }
}

/// Columns that a joint feels, with their places.
fn columns_of<'a>(run: &'a Prepared, part: &Part) -> Vec<(usize, &'a Vec<f64>)> {
    run.standard.iter().enumerate().filter_map(|(c, column)| Some((c, column[part.joint].as_ref()?))).collect()
}

/// Least squares by products, columns scaled to size 1, and what it explains.
fn solved(gram: &DMatrix<f64>, right: &DVector<f64>) -> Option<(DVector<f64>, f64)> {
    let scale = gram.diagonal().map(|square| if square > 0.0 { square.sqrt().recip() } else { 0.0 });
    let mut scaled = DMatrix::from_fn(gram.nrows(), gram.ncols(), |a, b| gram[(a, b)] * scale[a] * scale[b]);
    (0..scaled.nrows()).for_each(|k| scaled[(k, k)] += if scale[k] > 0.0 { super::RIDGE } else { 1.0 });
    let right = right.component_mul(&scale);
    let x = Cholesky::new(scaled)?.solve(&right);
    let explained = x.dot(&right);
    Some((x.component_mul(&scale), explained))
}
