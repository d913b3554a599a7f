//! Columns that are nothing outside one stretch of time, such as contact: their number grows with the log, so they are
//! solved for stretch by stretch before all others.
//!
//! ```text
//! y = D x + Σ_g C_g c_g + e,   c_g ~ N(0, diag(p²)),   no two stretches share a row
//! M_g = Σ w C_gᵀC_g + diag(1/p²) = L Lᵀ,   V = L⁻¹ Σ w C_gᵀD,   u = L⁻¹ Σ w C_gᵀy
//! A = Σ w DᵀD − Σ_g VᵀV,   b = Σ w Dᵀy − Σ_g Vᵀu,   c_g = L⁻ᵀ(u − V x)
//! ```
//!
//! Exact, and linear in the number of stretches; all of them in one matrix would cost the cube.

use std::ops::Range;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Columns of one stretch of one run.
#[derive(Clone, Debug)]
pub(crate) struct Stretch {
    pub(crate) run: usize,
    /// Rows of the run.
    pub(crate) rows: Range<usize>,
    /// `[column][joint][row of the stretch]`
    pub(crate) columns: Vec<Vec<Vec<f64>>>,
    /// Prior standard deviation of each column.
    pub(crate) std: DVector<f64>,
    pub(crate) cells: Vec<StretchCell>,
}

/// Products of a stretch's columns over one block and one joint.
#[derive(Clone, Debug)]
pub(crate) struct StretchCell {
    pub(crate) block: usize,
    pub(crate) joint: usize,
    /// CᵀD
    pub(crate) cd: DMatrix<f64>,
    /// CᵀC
    pub(crate) cc: DMatrix<f64>,
    /// Cᵀy
    pub(crate) cy: DVector<f64>,
}

/// A stretch that was solved for.
#[derive(Clone, Debug)]
pub(crate) struct Eliminated {
    factor: Cholesky<f64, Dyn>,
    /// V
    pub(crate) v: DMatrix<f64>,
    /// u
    pub(crate) u: DVector<f64>,
    /// ½ log det M + Σ log p
    pub(crate) cost: f64,
}

/// Stretches over blocks that count so many times; none where one cannot be solved. `width`: columns of D.
pub(crate) fn eliminated<'a>(
    stretches: impl Iterator<Item = &'a Stretch>,
    weights: &[f64],
    width: usize,
    times: impl Fn(usize) -> f64,
) -> Option<Vec<Eliminated>> {
    stretches
        .map(|stretch| {
            let c = stretch.std.len();
            let mut m = DMatrix::from_diagonal(&stretch.std.map(|p| 1.0 / (p * p)));
            let (mut v, mut u) = (DMatrix::zeros(c, width), DVector::zeros(c));
            for cell in &stretch.cells {
                let w = weights[cell.joint] * times(cell.block);
                if w > 0.0 {
                    m.zip_apply(&cell.cc, |s, p| *s += w * p);
                    v.zip_apply(&cell.cd, |s, p| *s += w * p);
                    u.axpy(w, &cell.cy, 1.0);
                }
            }
            let factor = Cholesky::new(m)?;
            let half = factor.l_dirty();
            half.solve_lower_triangular_mut(&mut v);
            half.solve_lower_triangular_mut(&mut u);
            let cost = half.diagonal().iter().chain(stretch.std.iter()).map(|l| l.ln()).sum();
            Some(Eliminated { v, u, cost, factor })
        })
        .collect()
}

impl Eliminated {
    /// L⁻¹ of products with the stretch's columns.
    pub(crate) fn halve(&self, products: &mut DMatrix<f64>) {
        self.factor.l_dirty().solve_lower_triangular_mut(products);
    }

    /// Coefficients beside `x`, and beside a candidate whose [halved](Self::halve) products times its coefficients are
    /// `with`.
    pub(crate) fn coefficients(&self, x: &DVector<f64>, with: Option<&DVector<f64>>) -> DVector<f64> {
        let mut c = &self.u - &self.v * x;
        if let Some(with) = with {
            c -= with;
        }
        self.factor.l_dirty().tr_solve_lower_triangular_mut(&mut c);
        c
    }
}

impl Stretch {
    /// Torque of one joint with coefficients `c` \[N·m\], rows of the stretch.
    pub(crate) fn torque(&self, joint: usize, c: &DVector<f64>) -> Vec<f64> {
        let mut sum = vec![0.0; self.rows.len()];
        for (column, c) in self.columns.iter().zip(c.iter()) {
            sum.iter_mut().zip(&column[joint]).for_each(|(s, v)| *s += c * v);
        }
        sum
    }
}
