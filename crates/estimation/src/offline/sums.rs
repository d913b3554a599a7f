//! The rows of all records as sums, stretch by stretch: read once, solved many times.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::fit::Method;
use super::rows::{JointRows, Range as KnownRange, Rows};
use crate::consistency::Reference;
use crate::kernels::{Part, add_products};
use crate::linear::{axpy, dot};

/// Length of a stretch \[s\] where the records have enough of them.
const STRETCH_S: f64 = 2.5;
/// Fewer stretches than this say too little about a variance: they are made shorter.
const LEAST_STRETCHES: f64 = 16.0;

/// A joint that moves for less than this share of the time for which the one does that moves longest; of 1.9 s in 20 a measured arm's was
/// learnt well.
const BRIEF: f64 = 0.05;

/// Joints (from 0) that move so briefly beside others that their rows, fewer than the parameters which they hang on, would be fitted
/// exactly whatever they are: their noise would be told as nothing, and what they count as without bound. They are left out, as if the
/// joints stood.
#[must_use]
pub fn brief(rows: &[Rows]) -> Vec<usize> {
    let n = rows.iter().map(|r| r.joints.len()).min().unwrap_or(0);
    let seconds = |j: usize| rows.iter().map(|r| r.seconds_of(j)).sum::<f64>();
    let longest = (0..n).map(seconds).fold(0.0, f64::max);
    let is_brief = |j: &usize| {
        let columns = rows.iter().map(|r| r.joints[*j].columns.len()).max().unwrap_or(0);
        let independent: f64 = rows.iter().map(|r| r.independent(*j)).sum();
        seconds(*j) > 0.0 && seconds(*j) < BRIEF * longest && independent < columns as f64
    };
    (0..n).filter(is_brief).collect()
}

/// Sums over the rows of one joint in one stretch of time, over the joint's own columns; matrices row-major.
#[derive(Clone, Debug)]
pub(super) struct Stretch {
    pub(super) dd: Vec<f64>,
    pub(super) zd: Vec<f64>,
    pub(super) zz: Vec<f64>,
    pub(super) dt: Vec<f64>,
    pub(super) zt: Vec<f64>,
    /// Σ τ².
    pub(super) tt: f64,
    pub(super) count: f64,
}

/// Sums of one joint.
#[derive(Clone, Debug)]
pub(super) struct JointSums {
    /// Those of its rows.
    pub(super) columns: Vec<usize>,
    /// As many for every joint: the same stretches of time.
    pub(super) stretches: Vec<Stretch>,
}

impl JointSums {
    /// Adds one of the sums over some stretches to a matrix over all `k` columns.
    pub(super) fn spread(&self, part: &[f64], weight: f64, all: &mut DMatrix<f64>) {
        for (row, i) in part.chunks_exact(self.columns.len().max(1)).zip(&self.columns) {
            for (x, j) in row.iter().zip(&self.columns) {
                all[(*i, *j)] += weight * x;
            }
        }
    }

    /// One of the sums over all stretches, as a matrix or vector over the joint's columns.
    pub(super) fn total(&self, which: impl Fn(&Stretch) -> &[f64]) -> Vec<f64> {
        let mut sum = vec![0.0; self.stretches.first().map_or(0, |s| which(s).len())];
        self.stretches.iter().for_each(|s| axpy(1.0, which(s), &mut sum));
        sum
    }

    pub(super) fn torque_square(&self) -> f64 {
        self.stretches.iter().map(|s| s.tt).sum()
    }

    pub(super) fn count(&self) -> f64 {
        self.stretches.iter().map(|s| s.count).sum()
    }
}

/// The rows of several records, ready to be solved.
#[derive(Debug)]
pub struct Equations<'a> {
    pub(super) rows: &'a [Rows],
    pub(super) joints: Vec<JointSums>,
    /// The same over the rows beside a stop alone; without stretches where a joint has no such row.
    beside: Vec<JointSums>,
    /// Of a stretch \[s\].
    length: f64,
}

impl<'a> Equations<'a> {
    /// Adds up the rows. Records must have the same columns and joints.
    pub fn new(rows: &'a [Rows]) -> Equations<'a> {
        let n = rows.iter().map(|r| r.joints.len()).min().unwrap_or(0);
        let seconds: f64 = rows.iter().map(Rows::seconds).sum();
        let length = STRETCH_S.min(seconds / LEAST_STRETCHES);
        let columns = |j: usize| rows.first().map_or_else(Vec::new, |r| r.joints[j].columns.clone());
        let all = |j: usize| {
            let stretch = |r: &'a Rows| ranges(r, j, length).map(|range| Stretch::new(&r.joints[j], range));
            JointSums { columns: columns(j), stretches: rows.iter().flat_map(stretch).collect() }
        };
        let stop_sums = |j: usize| {
            let stretch = |r: &'a Rows| ranges(r, j, length).map(|range| Stretch::beside_stops(&r.joints[j], range));
            let any = rows.iter().any(|r| r.joints[j].beside.contains(&true));
            let stretches = if any { rows.iter().flat_map(stretch).collect() } else { Vec::new() };
            JointSums { columns: columns(j), stretches }
        };
        let brief = brief(rows);
        let none = |j: usize| {
            let empty_stretch = |r: &'a Rows| ranges(r, j, length).map(|_| Stretch::new(&r.joints[j], 0..0));
            JointSums { columns: columns(j), stretches: rows.iter().flat_map(empty_stretch).collect() }
        };
        let sums_of_joint = |j: usize| if brief.contains(&j) { (none(j), none(j)) } else { (all(j), stop_sums(j)) };
        let (joints, stop_sums) = (0..n).into_par_iter().map(sums_of_joint).unzip();
        Equations { rows, joints, beside: stop_sums, length }
    }

    /// The sums with rows beside a stop counting by `trust`, joint by joint. Counts stay: a row that counts less has a
    /// residual that is larger by as much, so that weighed it varies like any other.
    pub(super) fn trusting(&self, trust: &[f64]) -> Vec<JointSums> {
        let weighted = |((all, beside), trust): ((&JointSums, &JointSums), &f64)| {
            let mut sums = all.clone();
            if *trust < 1.0 {
                sums.stretches.iter_mut().zip(&beside.stretches).for_each(|(sums, part)| sums.add(*trust - 1.0, part));
            }
            sums
        };
        self.joints.iter().zip(&self.beside).zip(trust).map(weighted).collect()
    }

    /// Share of a joint's rows that are beside a stop.
    pub(super) fn share_beside(&self, j: usize) -> f64 {
        self.beside[j].count() / self.joints[j].count().max(1.0)
    }

    /// Rows of joint `j` of a record in each of its stretches.
    pub(super) fn ranges<'r>(&self, record: &'r Rows, j: usize) -> impl Iterator<Item = Range<usize>> + 'r {
        ranges(record, j, self.length)
    }

    /// Residuals of parameters `x` over the rows of joint `j`, record by record, times the root of what a row counts.
    pub(super) fn weighed_residuals(&self, j: usize, x: &[f64], trust: f64) -> Vec<Vec<f64>> {
        let weighed = |rows: &JointRows| -> Vec<f64> {
            let weighed = |(row, e): (usize, f64)| rows.weight(row, trust).sqrt() * e;
            rows.residual(x).into_iter().enumerate().map(weighed).collect()
        };
        self.rows.iter().map(|record| weighed(&record.joints[j])).collect()
    }

    /// Residual of parameters `x` over all rows, per joint: `100 ‖τ - D x‖ / ‖τ‖` \[%\], to about 1e-4 %.
    pub fn residual_percent(&self, x: &[f64]) -> Vec<f64> {
        let percent = |joint: &JointSums| {
            let values: Vec<f64> = joint.columns.iter().map(|c| x[*c]).collect();
            let (dd, dt, tt) = (joint.total(|s| &s.dd), joint.total(|s| &s.dt), joint.torque_square());
            let bent: f64 =
                dd.chunks_exact(values.len().max(1)).zip(&values).map(|(row, x)| x * dot(row, &values)).sum();
            100.0 * ((tt - 2.0 * dot(&dt, &values) + bent).max(0.0) / tt.max(f64::MIN_POSITIVE)).sqrt()
        };
        self.joints.iter().map(percent).collect()
    }

    /// What is known of each parameter before any row.
    pub(super) fn most(&self) -> &[KnownRange] {
        self.rows.first().map_or(&[], |rows| &rows.most)
    }

    /// The rows as sums to judge parameters by.
    pub fn reference(&self) -> Reference {
        let k = self.rows.first().map_or(0, |r| r.columns);
        let mut reference = Reference::new(self.joints.len(), k);
        for (j, joint) in self.joints.iter().enumerate() {
            let mut gram = DMatrix::zeros(k, k);
            joint.spread(&joint.total(|s| &s.dd), 1.0, &mut gram);
            reference.add_sums(j, &gram, joint.torque_square(), joint.count());
        }
        reference
    }
}

fn ranges(record: &Rows, j: usize, length_s: f64) -> impl Iterator<Item = Range<usize>> + '_ {
    let parts = (record.seconds() / length_s).round().max(1.0) as usize;
    let at = move |part: usize| record.joints[j].place.partition_point(|p| p * parts < part * record.kept);
    (0..parts).map(move |part| at(part)..at(part + 1))
}

impl Stretch {
    fn new(rows: &JointRows, range: Range<usize>) -> Stretch {
        let n = rows.columns.len();
        let entries = range.start * n..range.end * n;
        let (d, z, tau) = (&rows.d[entries.clone()], &rows.z[entries], &rows.tau[range]);
        let mut sums = Stretch {
            dd: vec![0.0; n * n],
            zd: vec![0.0; n * n],
            zz: vec![0.0; n * n],
            dt: vec![0.0; n],
            zt: vec![0.0; n],
            tt: dot(tau, tau),
            count: tau.len() as f64,
        };
        if n == 0 {
            return sums;
        }
        add_products(&mut sums.dd, 1.0, d, d, n, Part::Lower);
        add_products(&mut sums.zd, 1.0, z, d, n, Part::All);
        add_products(&mut sums.zz, 1.0, z, z, n, Part::Lower);
        for m in [&mut sums.dd, &mut sums.zz] {
            for i in 0..n {
                for j in i + 1..n {
                    m[i * n + j] = m[j * n + i];
                }
            }
        }
        for ((d, z), tau) in d.chunks_exact(n).zip(z.chunks_exact(n)).zip(tau) {
            axpy(*tau, d, &mut sums.dt);
            axpy(*tau, z, &mut sums.zt);
        }
        sums
    }

    /// Those of the rows beside a stop alone.
    fn beside_stops(rows: &JointRows, range: Range<usize>) -> Stretch {
        let n = rows.columns.len();
        let mut part = JointRows { columns: rows.columns.clone(), ..JointRows::default() };
        for row in range.filter(|row| rows.beside[*row]) {
            part.d.extend_from_slice(&rows.d[row * n..(row + 1) * n]);
            part.z.extend_from_slice(&rows.z[row * n..(row + 1) * n]);
            part.tau.push(rows.tau[row]);
        }
        let count = part.tau.len();
        Stretch::new(&part, 0..count)
    }

    /// Adds `factor` times the sums over some of the same rows; the count stays.
    fn add(&mut self, factor: f64, part: &Stretch) {
        axpy(factor, &part.dd, &mut self.dd);
        axpy(factor, &part.zd, &mut self.zd);
        axpy(factor, &part.zz, &mut self.zz);
        axpy(factor, &part.dt, &mut self.dt);
        axpy(factor, &part.zt, &mut self.zt);
        self.tt += factor * part.tt;
    }

    /// The side that is multiplied from the left: instruments, or the regressor itself.
    pub(super) fn projection(&self, method: Method) -> (&[f64], &[f64], &[f64]) {
        match method {
            Method::Instrumental => (&self.zd, &self.zz, &self.zt),
            Method::LeastSquares => (&self.dd, &self.dd, &self.dt),
        }
    }
}

/// Sums of one joint over all records, over all columns.
pub(super) struct Normal {
    pub(super) count: f64,
    pub(super) torque_square: f64,
    /// DᵀD
    pub(super) dd: DMatrix<f64>,
    /// ZᵀD, ZᵀZ and Zᵀτ; with least squares Z is D.
    pub(super) zd: DMatrix<f64>,
    pub(super) zz: DMatrix<f64>,
    pub(super) zt: DVector<f64>,
}

impl Normal {
    pub(super) fn new(joint: &JointSums, k: usize, method: Method) -> Normal {
        let matrix = |sum: Vec<f64>| {
            let mut all = DMatrix::zeros(k, k);
            joint.spread(&sum, 1.0, &mut all);
            all
        };
        let mut zt = DVector::zeros(k);
        joint.columns.iter().zip(joint.total(|s| s.projection(method).2)).for_each(|(c, x)| zt[*c] = x);
        Normal {
            count: joint.count(),
            torque_square: joint.torque_square(),
            dd: matrix(joint.total(|s| &s.dd)),
            zd: matrix(joint.total(|s| s.projection(method).0)),
            zz: matrix(joint.total(|s| s.projection(method).1)),
            zt,
        }
    }
}
