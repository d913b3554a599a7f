//! Log marginal likelihood of a log's torque under one reading: a linear Gaussian model with a prior of its values.
//!
//! With `τ_j = Y_j x + e_j`, `x ~ N(x0, P)`, `e_j ~ N(0, σ_j²)` on `n_j` rows that count as `m_j`:
//! `log p = Σ_j −m_j/2·(log 2πσ_j² + RSS_j/(n_j σ_j²)) − |z|²/2 − log|A|/2`, `z = P^−½ (x̂ − x0)`,
//! `A = 1 + Σ_j m_j/(n_j σ_j²) P^½ Y_jᵀY_j P^½`. The σ_j maximise it under an inverse-chi-squared prior.

use std::sync::Arc;

use nalgebra::{Cholesky, DMatrix, DVector};
use rivet_dynamics::{LINK_PARAMETERS, Model, Parameter, Workspace};

use crate::arm_state::{EXTRA_COLUMNS, RobotFile, ValuePrior};
use crate::fault::{Missing, MotionView, View};
use crate::priors::{
    COARSENING, DELAYS_S, INADEQUACY, INADEQUACY_ROWS, MIN_ROWS, MIN_TORQUE_OVER_LIMIT, SIGNAL_OVER_TORQUE, TOUCH,
};
use crate::samples::{Samples, rms};

/// Steps in which values and residuals are found in turn.
const STEPS: usize = 8;
/// Whose square roots are not in proportion.
const PRIMES: [f64; 8] = [2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0];
/// No step changes a residual by more than this share any more.
const SETTLED: f64 = 0.03;

/// Regressor of the model's rows under one reading of the motion.
pub(crate) struct Design {
    /// `[row]`: joints x columns, row-major.
    rows: Vec<Vec<f64>>,
    /// Torque of effects that the file knows, `[row][joint]`.
    known: Vec<Vec<f64>>,
    /// Torque of the file's bodies at rest, `[row][joint]`.
    gravity: Vec<Vec<f64>>,
    /// Columns that act on each joint.
    active: Vec<Vec<usize>>,
    columns: usize,
    /// Rms of speed and acceleration of each joint as read.
    pub(crate) motion: Vec<[f64; 2]>,
}

impl Design {
    pub(crate) fn new(file: &RobotFile<'_>, samples: &Samples, view: &MotionView) -> Design {
        let (joints, size) = (file.joints(), file.model.len());
        let columns = size + EXTRA_COLUMNS * joints;
        let mut model: Model = file.model.clone();
        if let Some(gravity) = view.gravity {
            model.arm.gravity = gravity;
        }
        let mut workspace = Workspace::new(&model.arm);
        let (mut rows, mut known) = (Vec::with_capacity(samples.rows()), Vec::with_capacity(samples.rows()));
        let mut gravity = Vec::with_capacity(samples.rows());
        let bodies = joints * LINK_PARAMETERS;
        let mut standard = vec![0.0; joints * size];
        let mut squares = vec![[0.0; 2]; joints];
        let read = |row: &[f64], shift: &[f64]| -> Vec<f64> {
            (0..joints).map(|j| view.factor[j] * row[view.column[j]] + shift[j]).collect()
        };
        let none = vec![0.0; joints];
        for k in 0..samples.rows() {
            let (q, qd, qdd) =
                (read(&samples.q[k], &view.shift), read(&samples.qd[k], &none), read(&samples.qdd[k], &none));
            model.regressor(&mut workspace, &q, &none, &none, &mut standard);
            let at_rest = |j: usize| {
                let row = &standard[j * size..j * size + bodies];
                row.iter().zip(file.nominal).map(|(y, x)| y * x).sum()
            };
            gravity.push((0..joints).map(at_rest).collect());
            model.regressor(&mut workspace, &q, &qd, &qdd, &mut standard);
            let mut effects = vec![0.0; joints];
            model.add_effects(&mut workspace, &q, &qd, &qdd, &mut effects);
            let mut row = vec![0.0; joints * columns];
            for j in 0..joints {
                squares[j][0] += qd[j] * qd[j];
                squares[j][1] += qdd[j] * qdd[j];
                let out = &mut row[j * columns..(j + 1) * columns];
                out[..size].copy_from_slice(&standard[j * size..(j + 1) * size]);
                let coulomb =
                    model.parameters.iter().position(|p| *p == Parameter::Coulomb(j)).map_or(0.0, |at| out[at]);
                let extra = [1.0, q[j].sin(), q[j].cos(), qd[j] * samples.elapsed[k], coulomb * samples.elapsed[k]];
                for (column, value) in extra.into_iter().enumerate() {
                    out[size + column * joints + j] = value;
                }
            }
            rows.push(row);
            known.push(effects);
        }
        let active = (0..joints)
            .map(|j| (0..columns).filter(|c| rows.iter().any(|row| row[j * columns + c] != 0.0)).collect())
            .collect();
        let count = samples.rows().max(1) as f64;
        let motion = squares.into_iter().map(|s| s.map(|s: f64| (s / count).sqrt())).collect();
        Design { rows, known, gravity, active, columns, motion }
    }

    fn torque(&self, row: usize, j: usize, x: &[f64]) -> f64 {
        let of = &self.rows[row][j * self.columns..(j + 1) * self.columns];
        self.known[row][j] + self.active[j].iter().map(|c| of[*c] * x.get(*c).copied().unwrap_or(0.0)).sum::<f64>()
    }
}

/// Sums over the rows of one joint.
struct JointSums {
    rows: f64,
    gram: Arc<DMatrix<f64>>,
    cross: DVector<f64>,
    square: f64,
    /// Rms of the torque as read.
    size: f64,
    /// Jacobian of the torque as read by the torque as logged.
    factor: f64,
}

/// The rows of a log under one reading, as sums.
pub(crate) struct Sums {
    joints: Vec<Option<JointSums>>,
    /// Log likelihood of the signs as read.
    signs: f64,
}

/// What a reading explains.
#[derive(Clone, Debug)]
pub(crate) struct Evidence {
    pub(crate) log: f64,
    /// Rms residual of each joint over the torque's rms; NaN where the joint says nothing.
    pub(crate) residual: Vec<f64>,
    /// Values of the arm, and of the columns more.
    pub(crate) values: Vec<f64>,
    /// Residual over what the model is known to miss, as the gain that could still be had in `log`.
    pub(crate) possible_gain: f64,
}

impl Sums {
    /// `nominal`: standard values that say the sign of torques without one; `like`: sums of another reading, of which those of the same
    /// rows are taken.
    pub(crate) fn new(
        (design, samples): (&Design, &Samples),
        view: &View,
        nominal: &[f64],
        limit: &[f64],
        like: Option<(&Sums, &View)>,
    ) -> Sums {
        let joints = (0..view.torque_column.len()).map(|j| {
            let rows: Vec<usize> = (0..samples.rows()).filter(|k| samples.moves[*k][view.torque_column[j]]).collect();
            let torque: Vec<f64> = rows.iter().map(|k| torque(design, samples, view, nominal, [*k, j])).collect();
            let size = match view.missing {
                Missing::Nothing => rms(&torque),
                // The noise is that of the signal, and what the model misses that of the whole torque.
                _ => rms(&rows.iter().map(|k| logged(samples, view, [*k, j])).collect::<Vec<f64>>())
                    .max(SIGNAL_OVER_TORQUE * rms(&torque)),
            };
            if rows.len() < MIN_ROWS || size < MIN_TORQUE_OVER_LIMIT * limit[j] * view.torque_factor[j].abs() {
                return None;
            }
            let tau =
                DVector::from_iterator(rows.len(), rows.iter().zip(&torque).map(|(k, tau)| tau - design.known[*k][j]));
            let active = &design.active[j];
            let regressor = DMatrix::from_fn(rows.len(), active.len(), |row, at| {
                design.rows[rows[row]][j * design.columns + active[at]]
            });
            // Of the same rows of the same design it is the same.
            let same = like
                .filter(|(_, other)| other.motion == view.motion && other.torque_column[j] == view.torque_column[j]);
            let gram = match same.and_then(|(sums, _)| sums.joints[j].as_ref()) {
                Some(known) => Arc::clone(&known.gram),
                None => Arc::new(scattered(&regressor.tr_mul(&regressor), active, design.columns)),
            };
            let mut cross = DVector::zeros(design.columns);
            for (at, value) in regressor.tr_mul(&tau).iter().enumerate() {
                cross[active[at]] = *value;
            }
            let sums = JointSums {
                rows: rows.len() as f64,
                gram,
                cross,
                square: tau.norm_squared(),
                size,
                factor: view.torque_factor[j].abs() * clipped(samples, view, &rows, j),
            };
            Some(sums)
        });
        let joints: Vec<Option<JointSums>> = joints.collect();
        let is_signed = |j: &usize| !view.unsigned[*j] && joints[*j].is_some();
        // An absolute value is taken of all torques or of none.
        let are_all = (0..joints.len()).all(|j| joints[j].is_none() || samples.one_signed[view.torque_column[j]]);
        let touches: usize =
            (0..joints.len()).filter(|j| are_all && is_signed(j)).map(|j| samples.touches[view.torque_column[j]]).sum();
        Sums { joints, signs: TOUCH * touches as f64 }
    }

    /// Whether any joint says anything.
    pub(crate) fn is_empty(&self) -> bool {
        self.joints.iter().all(Option::is_none)
    }

    /// Rms residual of each joint with the values `x`, over its torque's rms.
    pub(crate) fn residual(&self, x: &[f64]) -> Vec<f64> {
        let of = |sums: &Option<JointSums>| {
            let Some(sums) = sums else { return f64::NAN };
            let x = padded(x, sums.cross.len());
            let left = sums.square - 2.0 * sums.cross.dot(&x) + x.dot(&(&*sums.gram * &x));
            (left.max(0.0) / sums.rows).sqrt() / sums.size
        };
        self.joints.iter().map(of).collect()
    }

    /// Rms of the torque of the values `x` over each limit \[-\]; 0 where a joint shows nothing.
    pub(crate) fn load(&self, x: &[f64], limit: &[f64]) -> Vec<f64> {
        let ratios = self.size_ratios(x);
        let of = |(j, sums): (usize, &Option<JointSums>)| {
            sums.as_ref().zip(ratios[j]).map_or(0.0, |(s, r)| r * s.size / limit[j])
        };
        self.joints.iter().enumerate().map(of).collect()
    }

    /// Factor that brings each torque nearest to the model's of `x`; none where they are not alike.
    pub(crate) fn factors(&self, x: &[f64]) -> Vec<Option<f64>> {
        /// Correlation of the two from which a factor is one of the unit: with wrong bodies and friction it is lower.
        const ALIKE: f64 = 0.8;
        let of = |sums: &Option<JointSums>| {
            let sums = sums.as_ref()?;
            let x = padded(x, sums.cross.len());
            let (with, square) = (sums.cross.dot(&x), x.dot(&(&*sums.gram * &x)));
            let alike = with / (square * sums.square).sqrt();
            (alike > ALIKE).then(|| with / sums.square)
        };
        self.joints.iter().map(of).collect()
    }

    /// Factor that each torque has with the values `x`; none where the torque shows nothing, or is not one of them. It is the most likely
    /// one where the residual is free: the torque as read is then as large as that of the model.
    pub(crate) fn free_factors(&self, x: &[f64]) -> Vec<Option<f64>> {
        let of = |sums: &Option<JointSums>| {
            let sums = sums.as_ref()?;
            let x = padded(x, sums.cross.len());
            let (common, square) = (sums.cross.dot(&x), x.dot(&(&*sums.gram * &x)));
            (common > 0.0 && square > 0.0).then(|| square / common)
        };
        self.joints.iter().map(of).collect()
    }

    /// Log likelihood ratio of each torque as the arm's of the values `x`, times the most likely factor, over a torque that has nothing of
    /// the arm: a channel of noise.
    pub(crate) fn factor_gains(&self, x: &[f64]) -> Vec<f64> {
        let gain = |sums: &Option<JointSums>| {
            let Some(sums) = sums.as_ref() else { return 0.0 };
            let x = padded(x, sums.cross.len());
            let (common, square) = (sums.cross.dot(&x).max(0.0), x.dot(&(&*sums.gram * &x)));
            let explained = (common * common / (square * sums.square).max(f64::MIN_POSITIVE)).min(1.0);
            -0.5 * counted(sums) * (1.0 - explained).max(f64::EPSILON).ln()
        };
        self.joints.iter().map(gain).collect()
    }

    /// Rms of the torque of the values `x` over that of the torque as read; none where there is none.
    pub(crate) fn size_ratios(&self, x: &[f64]) -> Vec<Option<f64>> {
        let of = |sums: &Option<JointSums>| {
            let sums = sums.as_ref()?;
            let x = padded(x, sums.cross.len());
            Some((x.dot(&(&*sums.gram * &x)).max(0.0) / sums.rows).sqrt() / sums.size)
        };
        self.joints.iter().map(of).collect()
    }

    /// None where the equations have no solution.
    pub(crate) fn evidence(&self, prior: &ValuePrior) -> Option<Evidence> {
        let mut prior = prior.clone();
        let mut found = self.solve(&prior)?;
        // Friction takes energy and inertia stores it: what comes out below 0 is 0.
        for _ in 0..3 {
            let below = |i: &usize| prior.positive[*i] && prior.spread[*i] > 0.0 && found.1[*i] < 0.0;
            let negative: Vec<usize> = (0..prior.mean.len()).filter(below).collect();
            if negative.is_empty() {
                break;
            }
            for i in negative {
                // The distance to 0 is paid once; held there the value no longer has a deviation.
                found.2 += 0.5 * (prior.mean[i] / prior.spread[i]).powi(2);
                (prior.mean[i], prior.spread[i]) = (0.0, 0.0);
            }
            let paid = found.2;
            found = self.solve(&prior)?;
            found.2 += paid;
        }
        found.0.log += self.signs - found.2;
        found.0.values = found.1;
        Some(found.0)
    }

    /// Evidence, values, and what was paid for values that are held.
    fn solve(&self, prior: &ValuePrior) -> Option<(Evidence, Vec<f64>, f64)> {
        // What no torque shows keeps its prior, and costs nothing.
        let shown = |c: usize| self.joints.iter().flatten().any(|sums| sums.gram[(c, c)] > 0.0);
        let free: Vec<usize> = (0..prior.spread.len()).filter(|c| prior.spread[*c] > 0.0 && shown(*c)).collect();
        let mean = DVector::from_column_slice(&prior.mean);
        let scaled: Vec<Option<Scaled>> =
            self.joints.iter().map(|sums| sums.as_ref().map(|sums| Scaled::new(sums, prior, &mean, &free))).collect();
        let floor = |s: &JointSums| (prior.inadequacy * s.size).powi(2).max(f64::MIN_POSITIVE);
        let pairs = || self.joints.iter().zip(&scaled).filter_map(|(a, b)| a.as_ref().zip(b.as_ref()));
        let mut variance: Vec<f64> =
            pairs().map(|(s, c)| floor(s).max((c.square / s.rows).min(0.1 * s.size * s.size))).collect();
        let mut z = DVector::zeros(free.len());
        let mut log_determinant = 0.0;
        for _ in 0..STEPS {
            let mut a = DMatrix::<f64>::identity(free.len(), free.len());
            let mut b = DVector::<f64>::zeros(free.len());
            for ((sums, scaled), variance) in pairs().zip(&variance) {
                let weight = counted(sums) / (sums.rows * variance);
                a += &scaled.gram * weight;
                b += &scaled.cross * weight;
            }
            let factor = Cholesky::new(a)?;
            z = factor.solve(&b);
            log_determinant = 2.0 * factor.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>();
            let mut change = 0.0_f64;
            for ((sums, scaled), variance) in pairs().zip(&mut variance) {
                let left = scaled.left(&z);
                let n = counted(sums);
                let next = (n * left / sums.rows + INADEQUACY_ROWS * floor(sums)) / (n + INADEQUACY_ROWS);
                change = change.max((next / *variance).ln().abs());
                *variance = next;
            }
            if change < SETTLED {
                break;
            }
        }
        let mut log = -0.5 * (z.norm_squared() + log_determinant);
        let mut possible_gain = 0.5 * z.norm_squared();
        let mut residual = Vec::new();
        let mut at = 0;
        for (sums, scaled) in self.joints.iter().zip(&scaled) {
            let Some((sums, scaled)) = sums.as_ref().zip(scaled.as_ref()) else {
                residual.push(f64::NAN);
                continue;
            };
            let (n, variance, floor) = (counted(sums), variance[at], floor(sums));
            at += 1;
            let left = scaled.left(&z);
            log -= 0.5 * n * ((std::f64::consts::TAU * variance).ln() + left / (sums.rows * variance));
            log -= 0.5 * INADEQUACY_ROWS * (variance.ln() + floor / variance);
            // Densities are of the torque as logged, the prior of the residual as well.
            log += (n + INADEQUACY_ROWS) * sums.factor.ln();
            possible_gain += 0.5 * n * (variance / floor).ln().max(0.0);
            residual.push((left / sums.rows).sqrt() / sums.size);
        }
        let mut x = prior.mean.clone();
        free.iter().zip(z.iter()).for_each(|(c, z)| x[*c] += prior.spread[*c] * z);
        log.is_finite().then_some((Evidence { log, residual, values: Vec::new(), possible_gain }, x, 0.0))
    }
}

/// Independent rows that a joint's likelihood is worth.
fn counted(sums: &JointSums) -> f64 {
    sums.rows * COARSENING / (sums.rows + COARSENING)
}

/// Sums of a joint in units of the prior's deviations, about its mean.
struct Scaled {
    gram: DMatrix<f64>,
    cross: DVector<f64>,
    square: f64,
}

impl Scaled {
    fn new(sums: &JointSums, prior: &ValuePrior, mean: &DVector<f64>, free: &[usize]) -> Scaled {
        let along = &*sums.gram * mean;
        let square = (sums.square - 2.0 * sums.cross.dot(mean) + along.dot(mean)).max(0.0);
        let size = free.len();
        let gram = DMatrix::from_fn(size, size, |a, b| {
            sums.gram[(free[a], free[b])] * prior.spread[free[a]] * prior.spread[free[b]]
        });
        let cross = DVector::from_fn(size, |a, _| (sums.cross[free[a]] - along[free[a]]) * prior.spread[free[a]]);
        Scaled { gram, cross, square }
    }

    fn left(&self, z: &DVector<f64>) -> f64 {
        (self.square - 2.0 * self.cross.dot(z) + z.dot(&(&self.gram * z))).max(0.0)
    }
}

/// A matrix of some columns in the place of all.
fn scattered(of: &DMatrix<f64>, columns: &[usize], size: usize) -> DMatrix<f64> {
    let mut all = DMatrix::zeros(size, size);
    for (a, to_a) in columns.iter().enumerate() {
        for (b, to_b) in columns.iter().enumerate() {
            all[(*to_b, *to_a)] = of[(b, a)];
        }
    }
    all
}

fn padded(x: &[f64], size: usize) -> DVector<f64> {
    DVector::from_fn(size, |i, _| x.get(i).copied().unwrap_or(0.0))
}

/// Torque of joint `j` at row `k` under a reading.
fn torque(design: &Design, samples: &Samples, view: &View, nominal: &[f64], [k, j]: [usize; 2]) -> f64 {
    let logged = logged(samples, view, [k, j]);
    let of_sign = if view.sign_values.is_empty() { nominal } else { &view.sign_values };
    let signed = if view.unsigned[j] { logged.abs() * design.torque(k, j, of_sign).signum() } else { logged };
    let of_arm = match view.missing {
        Missing::Nothing => 0.0,
        Missing::Gravity => design.gravity[k][j],
        Missing::Model => design.torque(k, j, nominal),
    };
    (signed + of_arm).clamp(-view.ceiling[j], view.ceiling[j])
}

/// Jacobian of a torque that the drive's limit cuts off, as the mean over rows: what is beyond the limit has an exponential density.
fn clipped(samples: &Samples, view: &View, rows: &[usize], j: usize) -> f64 {
    let ceiling = view.ceiling[j];
    let excess: Vec<f64> =
        rows.iter().map(|k| logged(samples, view, [*k, j]).abs() - ceiling).filter(|excess| *excess > 0.0).collect();
    if excess.is_empty() {
        return 1.0;
    }
    let mean = excess.iter().sum::<f64>() / excess.len() as f64;
    let width = INADEQUACY * ceiling * std::f64::consts::TAU.sqrt();
    (excess.len() as f64 / rows.len() as f64 * (width / (mean + width)).ln()).exp()
}

/// The logged torque of joint `j` at row `k` in N m.
fn logged(samples: &Samples, view: &View, [k, j]: [usize; 2]) -> f64 {
    view.torque_factor[j] * samples.tau[delay_place(view.delay_s[j])][k][view.torque_column[j]]
}

/// Place of a delay among those that the samples have, of which the first is 0.
fn delay_place(seconds: f64) -> usize {
    let far = |place: &usize| if *place == 0 { seconds.abs() } else { (DELAYS_S[place - 1] - seconds).abs() };
    (0..=DELAYS_S.len()).min_by(|a, b| far(a).total_cmp(&far(b))).unwrap_or(0)
}

/// Largest torque of gravity that the file's bodies have about any joint \[N m\], over poses spread over all angles.
pub(crate) fn largest_gravity(file: &RobotFile<'_>) -> f64 {
    const POSES: usize = 64;
    let (joints, size) = (file.joints(), file.model.len());
    let bodies = joints * LINK_PARAMETERS;
    let mut workspace = Workspace::new(&file.model.arm);
    let (still, mut regressor) = (vec![0.0; joints], vec![0.0; joints * size]);
    let mut largest = 0.0_f64;
    for pose in 0..POSES {
        // Multiples of square roots of primes fill the angles evenly.
        let angle = |j: usize| std::f64::consts::TAU * (pose as f64 * PRIMES[j % PRIMES.len()].sqrt()).fract();
        let q: Vec<f64> = (0..joints).map(angle).collect();
        file.model.regressor(&mut workspace, &q, &still, &still, &mut regressor);
        for row in regressor.chunks_exact(size) {
            let torque: f64 = row[..bodies].iter().zip(file.nominal).map(|(y, x)| y * x).sum();
            largest = largest.max(torque.abs());
        }
    }
    largest
}
