//! Plain batch least squares, the yardstick of the identification tests.
//!
//! Written apart from `rivet-estimation` and sharing nothing with it: four-point interpolation to a grid, central
//! differences, a windowed-sinc low-pass, standard (not base) parameters, minimum-norm solution by SVD. Only the regressor
//! is `rivet-dynamics`' own.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};
use rivet_dynamics::{Model, Slip, Workspace};
use rivet_logs::Log;

/// Signals on a uniform grid, `[joint][sample]`.
pub struct Grid {
    /// Time between samples \[s\].
    pub period: f64,
    /// Time \[s\].
    pub t: Vec<f64>,
    /// Positions \[rad\].
    pub q: Vec<Vec<f64>>,
    /// Torques \[N m\].
    pub tau: Vec<Vec<f64>>,
}

/// Lagrange's cubic through the four samples around each point.
pub fn four_points(t: &[f64], x: &[f64], at: &[f64]) -> Vec<f64> {
    let mut k = 0;
    let value = |point: &f64| {
        while k + 2 < t.len() && t[k + 1] <= *point {
            k += 1;
        }
        let first = k.saturating_sub(1).min(t.len() - 4);
        let nodes = first..first + 4;
        let weight =
            |i: usize| -> f64 { nodes.clone().filter(|j| *j != i).map(|j| (point - t[j]) / (t[i] - t[j])).product() };
        nodes.clone().map(|i| weight(i) * x[i]).sum()
    };
    at.iter().map(value).collect()
}

impl Grid {
    /// The log on a grid; of logs that are much faster, neighbouring samples are averaged first.
    pub fn new(log: &Log, period: f64) -> Grid {
        let average = (period / log.median_step_s()).round().max(1.0) as usize;
        let mean = |x: &[f64]| -> Vec<f64> {
            x.chunks_exact(average).map(|c| c.iter().sum::<f64>() / average as f64).collect()
        };
        let times = mean(&log.t);
        let count = ((times[times.len() - 1] - times[0]) / period).floor() as usize;
        let t: Vec<f64> = (0..count).map(|k| times[0] + k as f64 * period).collect();
        let bring = |signals: &[Vec<f64>]| -> Vec<Vec<f64>> {
            signals.iter().map(|x| four_points(&times, &mean(x), &t)).collect()
        };
        let tau = bring(log.torque().expect("a log with torque"));
        Grid { period, q: bring(&log.q), tau, t }
    }

    fn velocity(&self) -> Vec<Vec<f64>> {
        let each = |q: &Vec<f64>| {
            let at = |k: usize| {
                let k = k.clamp(1, q.len() - 2);
                (q[k + 1] - q[k - 1]) / (2.0 * self.period)
            };
            (0..q.len()).map(at).collect()
        };
        self.q.iter().map(each).collect()
    }

    /// Samples from the first to the last motion (any joint faster than 2 % of its top speed), filter ends left out.
    pub fn moving(&self, filter: &LowPass) -> Range<usize> {
        let speed: Vec<Vec<f64>> = self.velocity().iter().map(|v| filter.apply(v)).collect();
        let top: Vec<f64> = speed.iter().map(|v| v.iter().fold(0.0_f64, |m, v| m.max(v.abs()))).collect();
        let moves = |k: &usize| speed.iter().zip(&top).any(|(v, top)| v[*k].abs() > 0.02 * top);
        let inner = filter.half()..self.t.len() - filter.half();
        inner.clone().find(moves).expect("motion")..inner.rev().find(moves).expect("motion") + 1
    }
}

/// A symmetric low-pass: sinc in a Hann window over two periods of the cut-off either side.
pub struct LowPass {
    taps: Vec<f64>,
}

impl LowPass {
    /// -6 dB at `hz` \[Hz\].
    pub fn new(hz: f64, period: f64) -> LowPass {
        use std::f64::consts::PI;
        let half = (2.0 / (hz * period)).round() as i32;
        let tap = |k: i32| {
            let x = 2.0 * PI * hz * period * f64::from(k);
            let window = 0.5 + 0.5 * (PI * f64::from(k) / f64::from(half + 1)).cos();
            window * if k == 0 { 1.0 } else { x.sin() / x }
        };
        let mut taps: Vec<f64> = (-half..=half).map(tap).collect();
        let sum: f64 = taps.iter().sum();
        for tap in &mut taps {
            *tap /= sum;
        }
        LowPass { taps }
    }

    /// Samples at either end that are not filtered.
    pub fn half(&self) -> usize {
        self.taps.len() / 2
    }

    /// The filtered signal; its ends are left as they were.
    pub fn apply(&self, x: &[f64]) -> Vec<f64> {
        let mut y = x.to_vec();
        for (k, window) in x.windows(self.taps.len()).enumerate() {
            y[k + self.half()] = window.iter().zip(&self.taps).map(|(x, tap)| x * tap).sum();
        }
        y
    }
}

/// Filtered rows of every joint of one record, in standard parameters.
pub struct Rows {
    /// One matrix a joint.
    pub d: Vec<DMatrix<f64>>,
    /// One vector a joint \[N m\].
    pub tau: Vec<DVector<f64>>,
    /// Time of each row \[s\], one list a joint.
    pub t: Vec<Vec<f64>>,
}

impl Rows {
    /// The rows as an exponential window sees them that ends with the record: weight e^(-age/`seconds`).
    #[must_use]
    pub fn windowed(mut self, seconds: f64) -> Rows {
        let end = self.t.iter().flatten().fold(f64::MIN, |end, t| end.max(*t));
        for j in 0..self.t.len() {
            for (row, t) in self.t[j].iter().enumerate() {
                // The square of the row is what counts.
                let root = (-0.5 * (end - t) / seconds).exp();
                self.d[j].row_mut(row).scale_mut(root);
                self.tau[j][row] *= root;
            }
        }
        self
    }
}

/// Rows of a record: regressor columns and torque through the filter, every `every`-th sample of the motion, rows of a
/// joint that is slower than its dead zone left out.
pub fn rows(model: &Model, grid: &Grid, filter: &LowPass, dead_zone: &[f64], every: usize) -> Rows {
    let (n, k, count) = (model.arm.dof(), model.len(), grid.t.len());
    let velocity = grid.velocity();
    let (mut workspace, mut slip) = (Workspace::new(&model.arm), Slip::new(model));
    let mut y = vec![0.0; n * k];
    let mut columns = vec![vec![0.0; count]; n * k];
    for sample in 0..count {
        let i = sample.clamp(1, count - 2);
        let acceleration = |q: &Vec<f64>| (q[i + 1] - 2.0 * q[i] + q[i - 1]) / (grid.period * grid.period);
        let q: Vec<f64> = grid.q.iter().map(|q| q[i]).collect();
        let qd: Vec<f64> = velocity.iter().map(|v| v[i]).collect();
        let qdd: Vec<f64> = grid.q.iter().map(acceleration).collect();
        model.regressor_sliding(&mut workspace, &mut slip, &q, &qd, &qdd, &mut y);
        columns.iter_mut().zip(&y).for_each(|(column, y)| column[sample] = *y);
    }
    let moving = grid.moving(filter);
    let mut rows = Rows { d: Vec::new(), tau: Vec::new(), t: Vec::new() };
    for j in 0..n {
        let speed = filter.apply(&velocity[j]);
        let used: Vec<usize> = moving.clone().step_by(every).filter(|s| speed[*s].abs() >= dead_zone[j]).collect();
        let filtered: Vec<Vec<f64>> = columns[j * k..(j + 1) * k].iter().map(|c| filter.apply(c)).collect();
        let tau = filter.apply(&grid.tau[j]);
        rows.d.push(DMatrix::from_fn(used.len(), k, |r, c| filtered[c][used[r]]));
        rows.tau.push(DVector::from_fn(used.len(), |r, _| tau[used[r]]));
        rows.t.push(used.iter().map(|s| grid.t[*s]).collect());
    }
    rows
}

/// Standard parameters that fit the rows of all records best, each joint weighted by its own residual.
pub fn least_squares(records: &[Rows]) -> DVector<f64> {
    let n = records[0].d.len();
    let mut sigma: Vec<f64> = vec![1.0; n];
    let mut x = DVector::zeros(records[0].d[0].ncols());
    for _ in 0..4 {
        let weighted = |record: &Rows| -> Vec<(DMatrix<f64>, DVector<f64>)> {
            (0..n).map(|j| (&record.d[j] / sigma[j], &record.tau[j] / sigma[j])).collect()
        };
        let blocks: Vec<(DMatrix<f64>, DVector<f64>)> = records.iter().flat_map(weighted).collect();
        x = minimum_norm(&blocks);
        for (j, sigma) in sigma.iter_mut().enumerate() {
            let square: f64 = records.iter().map(|r| (&r.tau[j] - &r.d[j] * &x).norm_squared()).sum();
            let count: usize = records.iter().map(|r| r.tau[j].len()).sum();
            *sigma = (square / count as f64).sqrt();
        }
    }
    x
}

/// Columns scaled to one, QR, then SVD of R: directions that no motion can show are left at zero.
fn minimum_norm(blocks: &[(DMatrix<f64>, DVector<f64>)]) -> DVector<f64> {
    let k = blocks[0].0.ncols();
    let rows: usize = blocks.iter().map(|(d, _)| d.nrows()).sum();
    let (mut d, mut tau) = (DMatrix::zeros(rows, k), DVector::zeros(rows));
    let mut at = 0;
    for (block, torque) in blocks {
        d.rows_mut(at, block.nrows()).copy_from(block);
        tau.rows_mut(at, torque.len()).copy_from(torque);
        at += block.nrows();
    }
    let scale: Vec<f64> = (0..k).map(|c| d.column(c).norm()).map(|s| if s > 0.0 { s } else { 1.0 }).collect();
    for (c, scale) in scale.iter().enumerate() {
        d.column_mut(c).unscale_mut(*scale);
    }
    let qr = d.qr();
    let right = qr.q().tr_mul(&tau);
    let x = qr.r().svd(true, true).solve(&right, 1e-9).expect("both sides were asked for");
    DVector::from_fn(k, |c, _| x[c] / scale[c])
}

/// `100 |tau - D x| / |tau|` per joint over all records \[%\].
pub fn percent(records: &[Rows], x: &DVector<f64>) -> Vec<f64> {
    let of = |j: usize| {
        let error: f64 = records.iter().map(|r| (&r.tau[j] - &r.d[j] * x).norm_squared()).sum();
        let torque: f64 = records.iter().map(|r| r.tau[j].norm_squared()).sum();
        100.0 * (error / torque).sqrt()
    };
    (0..records[0].d.len()).map(of).collect()
}

/// `100 |tau - predicted| / |tau|` per joint over the motion \[%\], both through the filter; `predicted` on the grid.
pub fn percent_of(grid: &Grid, predicted: &[Vec<f64>], filter: &LowPass) -> Vec<f64> {
    let percent = |[error, torque]: [f64; 2]| 100.0 * (error / torque).sqrt();
    squares_of(grid, predicted, filter).into_iter().map(percent).collect()
}

/// `[|tau - predicted|^2, |tau|^2]` per joint over the motion, both through the filter; `predicted` on the grid.
pub fn squares_of(grid: &Grid, predicted: &[Vec<f64>], filter: &LowPass) -> Vec<[f64; 2]> {
    let moving = grid.moving(filter);
    let squares = |(tau, predicted): (&Vec<f64>, &Vec<f64>)| {
        let (tau, predicted) = (filter.apply(tau), filter.apply(predicted));
        let error: f64 = moving.clone().map(|k| (tau[k] - predicted[k]).powi(2)).sum();
        [error, moving.clone().map(|k| tau[k].powi(2)).sum()]
    };
    grid.tau.iter().zip(predicted).map(squares).collect()
}
