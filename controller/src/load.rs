//! The load that the model does not know, from torque that it missed: what a stop has to carry on.
//!
//! Missed torque of a period is `r = Y·θ + c + noise`. `Y` are the columns of mass and first moments of the last body in the regressor, `θ`
//! is what hangs there \[kg, kg·m\], and `c` is a constant torque of each joint. Both are estimated by Bayesian linear regression with
//! exponential forgetting. Gravity and inertia of a load then change as they have to when the arm brakes.

use crate::inertia::cholesky_succeeds;
use rivet_dynamics::{LINK_PARAMETERS, MAX_JOINTS};

/// Mass and first moments are estimated.
const MOMENTS: usize = 4;
/// Unknowns: the load's, then one constant torque a joint.
const UNKNOWNS: usize = MOMENTS + MAX_JOINTS;
/// Memory \[s\]: about one swing of an arm.
const MEMORY_S: f64 = 1.0;
/// Independent samples in that memory: what friction and inertia miss is the same for most of a swing.
const INDEPENDENT: f64 = 10.0;
/// Standard deviation of what else a model misses in motion, as a share of the torque limit.
const NOISE_SHARE: f64 = 0.05;
/// Standard deviation, before any sample, of constant torques, as a share of the torque limit; and the largest that is carried on.
const CONSTANT_SHARE: f64 = 0.1;
/// Weight of the prior of the load beside the samples (Zellner's g-prior): it decides only between loads that they do not tell apart.
const PRIOR_WEIGHT: f64 = 0.01;
/// Least precision, so that unknowns without a sample stay zero.
const LEAST_PRECISION: f64 = 1e-9;
/// Largest torque that is taken for a load, as a share of the torque limit.
const LARGEST_SHARE: f64 = 0.5;
/// A fault is found at the latest this long after its first wrong sample \[s\]; younger samples are not used.
const DOUBTED_S: f64 = 0.04;
/// Most samples in that time: at 2 kHz and below.
const MOST_WAITING: usize = 80;
/// Below this speed friction holds a part of the torque \[rad/s\].
const RESTING: f64 = 0.02;

/// A load at the last body, and constant torques.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Load {
    /// Mass \[kg\], first moments \[kg·m\] and moments of inertia \[kg·m²\] in the last body's frame.
    body: [f64; LINK_PARAMETERS],
    /// \[N·m\].
    constant: [f64; MAX_JOINTS],
    /// Largest torque of each joint \[N·m\].
    most: [f64; MAX_JOINTS],
}

impl Load {
    /// The same without constant torques: an obstacle may be what they come from.
    pub(crate) fn of_mass(self) -> Load {
        Load { constant: [0.0; MAX_JOINTS], ..self }
    }

    /// Torque on joint `j` \[N·m\], with that row of the last body's columns.
    pub(crate) fn torque(&self, j: usize, columns: &[f64]) -> f64 {
        let torque: f64 = columns.iter().zip(&self.body).map(|(y, x)| y * x).sum();
        (torque + self.constant[j]).clamp(-self.most[j], self.most[j])
    }
}

/// One period: rows of the last body's columns, missed torque \[N·m\], and the joints that rested, bit 0 the base's.
#[derive(Clone, Copy, Debug, Default)]
struct Sample {
    columns: [[f64; MOMENTS]; MAX_JOINTS],
    missed: [f64; MAX_JOINTS],
    resting: u32,
}

/// Sufficient statistics of the regression. Nothing allocates.
#[derive(Clone, Debug)]
pub(crate) struct LoadEstimate {
    dof: usize,
    torque_limit: [f64; MAX_JOINTS],
    /// Torque that friction may hold at rest \[N·m\].
    breakaway: [f64; MAX_JOINTS],
    /// Share of a sample in the mean.
    share: f64,
    /// Mean of `YᵀWY`, the lower triangle, and of `YᵀWr`.
    information: [[f64; UNKNOWNS]; UNKNOWNS],
    projection: [f64; UNKNOWNS],
    /// Samples that are too young to be taken in: what is wrong with them may not have been found yet.
    waiting: [Sample; MOST_WAITING],
    /// How many of them there are at the most, how many there are, and the place of the next.
    delay: usize,
    filled: usize,
    next: usize,
}

impl LoadEstimate {
    pub(crate) fn new(torque_limit: &[f64], breakaway: impl Fn(usize) -> f64, period_s: f64) -> LoadEstimate {
        let dof = torque_limit.len().min(MAX_JOINTS);
        let mut all = [0.0; MAX_JOINTS];
        all[..dof].copy_from_slice(&torque_limit[..dof]);
        LoadEstimate {
            dof,
            torque_limit: all,
            breakaway: core::array::from_fn(|j| if j < dof { breakaway(j) } else { 0.0 }),
            share: 1.0 - (-period_s / MEMORY_S).exp(),
            information: [[0.0; UNKNOWNS]; UNKNOWNS],
            projection: [0.0; UNKNOWNS],
            waiting: [Sample::default(); MOST_WAITING],
            delay: ((DOUBTED_S / period_s).ceil() as usize).clamp(1, MOST_WAITING),
            filled: 0,
            next: 0,
        }
    }

    /// Forgets the samples that have not been taken in.
    pub(crate) fn restart(&mut self) {
        (self.filled, self.next) = (0, 0);
    }

    /// Takes in, after a while, what the model `missed` \[N·m\] at velocities `qd`; `columns` are the rows of the last body's mass and
    /// first moments.
    ///
    /// Real-time safe.
    pub(crate) fn take<'a>(&mut self, columns: impl Iterator<Item = &'a [f64]>, qd: &[f64], missed: &[f64]) {
        let mut sample = Sample::default();
        for (to, row) in sample.columns.iter_mut().zip(columns) {
            to.iter_mut().zip(row).for_each(|(to, y)| *to = *y);
        }
        sample.missed.iter_mut().zip(missed).for_each(|(to, missed)| *to = *missed);
        sample.resting =
            qd.iter().enumerate().filter(|(_, qd)| qd.abs() < RESTING).fold(0, |bits, (j, _)| bits | 1 << j);
        let due = core::mem::replace(&mut self.waiting[self.next], sample);
        self.next = (self.next + 1) % self.delay;
        if self.filled < self.delay {
            self.filled += 1;
        } else {
            self.take_in(&due);
        }
    }

    fn take_in(&mut self, sample: &Sample) {
        let keep = 1.0 - self.share;
        self.information.iter_mut().flatten().for_each(|entry| *entry *= keep);
        self.projection.iter_mut().for_each(|entry| *entry *= keep);
        for (j, (row, missed)) in sample.columns.iter().zip(&sample.missed).enumerate().take(self.dof) {
            let resting = sample.resting >> j & 1 == 1;
            let noise = NOISE_SHARE * self.torque_limit[j] + if resting { self.breakaway[j] } else { 0.0 };
            let weight = self.share / noise.powi(2);
            for (i, yi) in row.iter().enumerate() {
                for (k, yk) in row.iter().enumerate().take(i + 1) {
                    self.information[i][k] += weight * yi * yk;
                }
                self.information[MOMENTS + j][i] += weight * yi;
                self.projection[i] += weight * yi * missed;
            }
            self.information[MOMENTS + j][MOMENTS + j] += weight;
            self.projection[MOMENTS + j] += weight * missed;
        }
    }

    /// Posterior mean. Real-time safe: bounded work.
    pub(crate) fn load(&self) -> Load {
        let n = MOMENTS + self.dof;
        let mut a = [0.0; UNKNOWNS * UNKNOWNS];
        let mut x = [0.0; UNKNOWNS];
        for i in 0..n {
            for k in 0..=i {
                a[i * n + k] = INDEPENDENT * self.information[i][k];
            }
            let prior = if i < MOMENTS {
                PRIOR_WEIGHT * a[i * n + i]
            } else {
                (CONSTANT_SHARE * self.torque_limit[i - MOMENTS]).powi(-2)
            };
            a[i * n + i] += prior.max(LEAST_PRECISION);
            x[i] = INDEPENDENT * self.projection[i];
        }
        let mut load = Load::default();
        for (most, limit) in load.most.iter_mut().zip(&self.torque_limit) {
            *most = LARGEST_SHARE * limit;
        }
        if !cholesky_succeeds(&mut a[..n * n], n) {
            return load;
        }
        for i in 0..n {
            let sum: f64 = (0..i).map(|k| a[i * n + k] * x[k]).sum();
            x[i] = (x[i] - sum) / a[i * n + i];
        }
        for i in (0..n).rev() {
            let sum: f64 = (i + 1..n).map(|k| a[k * n + i] * x[k]).sum();
            x[i] = (x[i] - sum) / a[i * n + i];
        }
        if x.iter().all(|x| x.is_finite()) {
            load.body = point_mass(x[0], [x[1], x[2], x[3]]);
            for ((constant, x), limit) in load.constant.iter_mut().zip(&x[MOMENTS..n]).zip(&self.torque_limit) {
                let most = CONSTANT_SHARE * limit;
                *constant = x.clamp(-most, most);
            }
        }
        load
    }
}

/// The body whose mass is all in its centre: no other has less inertia. Without a mass it has first moments alone.
fn point_mass(mass: f64, m: [f64; 3]) -> [f64; LINK_PARAMETERS] {
    let [x, y, z] = m;
    let per_mass = if mass > 0.0 { 1.0 / mass } else { 0.0 };
    let inertia = [y * y + z * z, -x * y, -x * z, x * x + z * z, -y * z, x * x + y * y].map(|i| i * per_mass);
    let mut body = [mass, x, y, z, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    body[MOMENTS..].copy_from_slice(&inertia);
    body
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: [f64; 2] = [100.0, 50.0];

    /// Rows of a planar arm's last body: mass, and the first moment along the link, under gravity and acceleration.
    fn rows(t: f64) -> [[f64; MOMENTS]; 2] {
        let (s, c, a) = ((3.0 * t).sin(), (3.0 * t).cos(), 4.0 * (2.0 * t).sin());
        [[9.81 * c + a, 9.81 * s, 0.3 * a, 0.0], [0.0, 9.81 * s, 0.2 * a, 0.0]]
    }

    fn estimate(missed: impl Fn(&[[f64; MOMENTS]; 2]) -> [f64; 2]) -> Load {
        let mut estimate = LoadEstimate::new(&LIMITS, |_| 5.0, 0.001);
        for k in 0..5000 {
            let rows = rows(0.001 * f64::from(k));
            estimate.take(rows.iter().map(|row| &row[..]), &[1.0, 1.0], &missed(&rows));
        }
        estimate.load()
    }

    #[test]
    fn a_load_and_a_constant_torque_are_told_apart() {
        let truth = [2.0, 0.4, 0.1, 0.0];
        let load = estimate(|rows| {
            let of = |j: usize| rows[j].iter().zip(&truth).map(|(y, x)| y * x).sum::<f64>();
            [of(0), of(1) + 3.0]
        });
        for j in 0..2 {
            // Another pose and acceleration than those of the samples.
            let row = &rows(7.7)[j];
            let truth: f64 = row.iter().zip(&truth).map(|(y, x)| y * x).sum::<f64>() + [0.0, 3.0][j];
            let error = load.torque(j, row) - truth;
            assert!(error.abs() < 0.02 * LIMITS[j], "joint {}: {error} of {truth} N m", j + 1);
        }
    }

    #[test]
    fn without_samples_and_with_absurd_ones_the_load_is_bounded() {
        assert_eq!(LoadEstimate::new(&LIMITS, |_| 5.0, 0.001).load().torque(0, &[1.0; MOMENTS]), 0.0);
        let load = estimate(|_| [1e6, -1e6]);
        assert_eq!([load.torque(0, &rows(0.0)[0]), load.torque(1, &rows(0.0)[1])], [50.0, -25.0]);
    }
}
