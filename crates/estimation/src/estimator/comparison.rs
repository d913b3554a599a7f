//! Least squares and instrumental variables side by side, window by window: is least squares biased?
//!
//! Noise in the regressor pulls least squares but not instrumental variables; where there is none, only torque noise sets
//! the two apart (Durbin 1954, Wu 1973, Hausman 1978). Wu's form of the test adds to the regression what the regressor has
//! that the instruments have not; here it is what that makes of the torque of each joint, with the values x of the time:
//!
//! ```text
//! r = (d − z)ᵀ·x,   R = Σ λ^(N−i) w r²,   B = Σ λ^(N−i) w d·r,   T = Σ λ^(N−i) w r·τ            of each joint j
//! t = T − Bᵀ·x_LS,   C = diag(R) − Bᵀ·P·B,   P = (Σ λ^(N−i) w d·dᵀ)⁻¹
//! uⱼ = tⱼ·(Rⱼ/Σ λ^2(N−i) w r²)^½,   H = uᵀ·C⁻¹·u/(κσₑ²)  ~  χ²(joints)
//! ```
//!
//! `−tⱼ = Σ (zᵀx)·e_LS`: the moments of the instruments that least squares would have to make zero, along the parameters,
//! which is where noise pulls: `E{Σ d·e} = −E{n·nᵀ}·x`. As many degrees of freedom as joints keep the test sharp (the full
//! one, off line, has as many as parameters), and P and x_LS are at hand in the UD filter.

use crate::kernels::Lanes;
use crate::linear::{axpy, dot};
use crate::memory::Carry;
use crate::ud::UdFilter;
use rivet_dynamics::MAX_JOINTS;

/// A joint whose regressor differs from its instruments by less than this share of itself, once least squares has explained
/// what it can, says nothing.
const SAME: f64 = 1e-6;
/// Equivalent rows before anything is said.
const LEAST_ROWS: f64 = 100.0;

/// What sets least squares and instrumental variables apart in the window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hausman {
    /// H.
    pub statistic: f64,
    /// Joints whose regressor and instruments differ.
    pub degrees: usize,
}

impl Hausman {
    /// Probability of an H as large as this if the regressor has no noise and the model is complete.
    #[must_use]
    pub fn p_value(&self) -> f64 {
        crate::chi_square::above(self.statistic, self.degrees)
    }
}

/// Running sums, one of each kind a joint. Nothing allocates after `new`.
#[derive(Clone, Debug)]
pub(super) struct Comparison {
    n: usize,
    /// B and Σ w z·r, n entries a joint.
    regressor: Vec<f64>,
    instruments: Vec<f64>,
    /// R, the same with λ² (what the noise of a forgotten row weighs), and T.
    square: Lanes,
    noise: Lanes,
    torque: Lanes,
}

impl Comparison {
    pub(super) fn new(joints: usize, n: usize) -> Comparison {
        let sums = || vec![0.0; joints * n];
        let lanes = [0.0; MAX_JOINTS];
        Comparison { n, regressor: sums(), instruments: sums(), square: lanes, noise: lanes, torque: lanes }
    }

    pub(super) fn restart(&mut self) {
        for sums in
            [&mut self.regressor[..], &mut self.instruments, &mut self.square, &mut self.noise, &mut self.torque]
        {
            sums.fill(0.0);
        }
    }

    pub(super) fn carry(&mut self, carry: &mut Carry<'_>) {
        for sums in
            [&mut self.regressor[..], &mut self.instruments, &mut self.square, &mut self.noise, &mut self.torque]
        {
            carry.numbers(sums);
        }
    }

    /// Gives the past the weight `lambda`.
    pub(super) fn forget(&mut self, lambda: f64) {
        for sums in [&mut self.regressor[..], &mut self.instruments, &mut self.square, &mut self.torque] {
            for sum in sums {
                *sum *= lambda;
            }
        }
        for sum in &mut self.noise {
            *sum *= lambda * lambda;
        }
    }

    /// Takes in the row of joint `j`, weighted: regressor and instruments as the UD filter has them, and its torque. `off`
    /// is r, weighted.
    pub(super) fn add(&mut self, j: usize, [d, z]: [&[f64]; 2], tau: f64, off: f64) {
        let joint_row = j * self.n..(j + 1) * self.n;
        axpy(off, d, &mut self.regressor[joint_row.clone()]);
        axpy(off, z, &mut self.instruments[joint_row]);
        self.square[j] += off * off;
        self.noise[j] += off * off;
        self.torque[j] += off * tau;
    }

    /// H, given the least squares on the same rows; `variance` of an equation (κσₑ²), of which the window has `rows`.
    pub(super) fn hausman(&self, least_squares: &UdFilter, variance: f64, rows: f64) -> Option<Hausman> {
        if rows < LEAST_ROWS {
            return None;
        }
        let joints = self.regressor.len() / self.n.max(1);
        let rows = |j: usize| &self.regressor[j * self.n..(j + 1) * self.n];
        let mut c = [[0.0; MAX_JOINTS]; MAX_JOINTS];
        for (i, row) in c.iter_mut().enumerate().take(joints) {
            row[i] = self.square[i];
        }
        // P = U·D·Uᵀ: one column of U after the other.
        for (column, d) in least_squares.factors() {
            let mut f = [0.0; MAX_JOINTS];
            for (j, f) in f.iter_mut().enumerate().take(joints) {
                *f = dot(column, &rows(j)[..column.len()]);
            }
            for i in 0..joints {
                for j in 0..=i {
                    c[i][j] -= d * f[i] * f[j];
                }
            }
        }
        let mut t = [0.0; MAX_JOINTS];
        let (mut statistic, mut degrees) = (0.0, 0);
        for i in 0..joints {
            // A joint may have differed from its instruments for a part of the window only.
            let share = (self.square[i] / self.noise[i].max(f64::MIN_POSITIVE)).sqrt();
            t[i] = share * (self.torque[i] - dot(rows(i), least_squares.values()));
            for j in 0..i {
                let (done, row) = c.split_at_mut(i);
                // A joint that says nothing has a zero on its diagonal.
                let pivot = done[j][j];
                let sum: f64 = (0..j).map(|k| row[0][k] * done[j][k]).sum();
                row[0][j] = if pivot > 0.0 { (row[0][j] - sum) / pivot } else { 0.0 };
                t[i] -= row[0][j] * t[j];
            }
            let pivot = c[i][i] - (0..i).map(|k| c[i][k] * c[i][k]).sum::<f64>();
            if pivot > SAME * self.square[i] {
                c[i][i] = pivot.sqrt();
                t[i] /= c[i][i];
                statistic += t[i] * t[i];
                degrees += 1;
            } else {
                (c[i][i], t[i]) = (0.0, 0.0);
            }
        }
        let statistic = statistic / variance;
        statistic.is_finite().then_some(Hausman { statistic, degrees })
    }

    /// What noise in the regressor of joint `j` puts on least squares, `xᵀ·E{(d−d*)(d−d*)ᵀ}·x`, over the dominant element of
    /// what is left of it with instruments, `xᵀ·E{(d−d*)·d*ᵀ}`, columns times the scaled parameters `x`. NaN without rows,
    /// infinite where nothing is left.
    pub(super) fn ratio(&self, j: usize, x: impl Iterator<Item = f64>) -> f64 {
        let mean_instruments = &self.instruments[j * self.n..(j + 1) * self.n];
        self.square[j] / mean_instruments.iter().zip(x).map(|(z, x)| (z * x).abs()).fold(0.0, f64::max)
    }
}
