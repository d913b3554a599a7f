//! Units in which information can be judged: every parameter measured by the torque it makes.
//!
//! Thresholds and condition numbers of the information mean something only if all coordinates have one unit. Here the
//! unit is the torque residual's sigma, and the yardstick a reference workload: random states within the limits of the
//! arm at moderate speed. It comes from the model, never from the data: else poor excitation would measure itself.

use crate::kernels::{Lanes, lower_solve, lower_solve_four, lower_times};
use crate::linear::{axpy, axpy_short, dot, packed};
use crate::settings::ReferenceWorkload;
use rivet_dynamics::{BaseSet, JointKind, LINK_PARAMETERS, Model, Parameter, Workspace};

/// States of the reference workload.
const STATES: usize = 300;
/// Share of the joint's speed limit that the workload uses, and the limit where none is given \[rad/s\].
const SPEED_SHARE: f64 = 0.5;
const WORKLOAD_SPEED_LIMIT_RAD_S: f64 = 2.0;
/// Time in which a joint of the workload reaches its speed \[s\].
const RISE_TIME: f64 = 0.3;
/// First guess of the torque residual, as a share of the workload's torque.
const NOISE_SHARE: f64 = 0.02;
/// Where the nominal parameters know no friction of a joint, the workload's torque is taken for at least this share of the
/// drive's limit, which was chosen with friction in mind: wrists of geared arms would be expected to be ten times as quiet as
/// they are, and what they tell would never be good enough. Arms whose friction was measured are at 0.096 and more.
const LIMIT_SHARE: f64 = 0.08;
/// What a column leaves when those before it are taken out counts as at least this share of the mean: the whitening
/// amplifies nothing beyond that.
const WHITENING_FLOOR: f64 = 1e-6;

/// Scales of columns and rows.
#[derive(Clone, Debug, PartialEq)]
pub struct Scales {
    /// Rms over the workload of each column, all joints' rows together, in torque-noise sigmas a unit of the parameter.
    pub column: Vec<f64>,
    /// First guess of the standard deviation of each row's torque residual \[N·m\].
    pub torque_noise: Vec<f64>,
    /// Rms of the torque that is expected on the workload, all rows together \[torque-noise sigma\].
    pub torque: f64,
    /// Mean information of one workload state in scaled columns, n x n row-major: unit diagonal.
    pub workload: Vec<f64>,
    /// What each of the ten numbers of a load at the last link adds to the parameters; empty for equations that are not an
    /// arm's.
    pub payload: Vec<Vec<f64>>,
    /// Standard deviations of the nominal parameters that are a guess, in each one's unit, 0 of what is known; empty where none is.
    pub unknown: Vec<f64>,
}

impl Scales {
    /// No scaling: columns, rows and torque count as they are. For equations that are not an arm's.
    #[must_use]
    pub fn unit(rows: usize, columns: usize) -> Scales {
        let mut workload = vec![0.0; columns * columns];
        for i in 0..columns {
            workload[i * columns + i] = 1.0;
        }
        Scales {
            column: vec![1.0; columns],
            torque_noise: vec![1.0; rows],
            torque: 1.0,
            workload,
            payload: Vec::new(),
            unknown: Vec::new(),
        }
    }

    /// Scales of `model` in `base` parameters, from seeded states. `torque_noise`: where it is known.
    #[must_use]
    pub fn of_model(model: &Model, base: &BaseSet, nominal_base: &[f64], torque_noise: Option<&[f64]>) -> Scales {
        Scales::of_workload(model, base, nominal_base, torque_noise, ReferenceWorkload::OneWay)
    }

    /// The same from the states of `reference`.
    #[must_use]
    pub fn of_workload(
        model: &Model,
        base: &BaseSet,
        nominal_base: &[f64],
        torque_noise: Option<&[f64]>,
        reference: ReferenceWorkload,
    ) -> Scales {
        let (dof, n, full) = (model.arm.dof(), base.len(), model.len());
        let mut ws = Workspace::new(&model.arm);
        let (mut y, mut d) = (vec![0.0; dof * full], vec![0.0; dof * n]);
        let both = reference == ReferenceWorkload::BothWays;
        let states = if both { 2 * STATES } else { STATES };
        let mut rows = Vec::with_capacity(states * dof * n);
        let mut back = vec![0.0; dof];
        workload(model, |q, qd, qdd| {
            let mut add = |qd: &[f64]| {
                model.regressor(&mut ws, q, qd, qdd, &mut y);
                base.select(&y, full, &mut d);
                rows.extend_from_slice(&d);
            };
            add(qd);
            if both {
                back.iter_mut().zip(qd).for_each(|(back, qd)| *back = -qd);
                add(&back);
            }
        });
        let mut square = vec![0.0; dof];
        for (k, row) in rows.chunks_exact(n).enumerate() {
            square[k % dof] += dot(row, nominal_base).powi(2) / states as f64;
        }
        let largest = square.iter().fold(0.0_f64, |m, s| m.max(*s)).sqrt();
        let least = if largest > 0.0 { 1e-3 * largest } else { 1.0 };
        let expected = |j: usize| {
            let limit = model.arm.joints[j].effort;
            let friction_unknown = unknown(model, base, nominal_base, &[Parameter::Viscous(j), Parameter::Coulomb(j)]);
            let limit = if friction_unknown && limit.is_finite() { LIMIT_SHARE * limit } else { 0.0 };
            square[j].sqrt().max(limit).max(least)
        };
        let expected: Vec<f64> = (0..dof).map(expected).collect();
        let noise: Vec<f64> = match torque_noise {
            Some(noise) => noise.to_vec(),
            None => expected.iter().map(|torque| NOISE_SHARE * torque).collect(),
        };
        let torque = expected.iter().zip(&noise).map(|(t, noise)| (t / noise).powi(2)).sum::<f64>().sqrt();
        let mut workload = vec![0.0; n * n];
        for (k, row) in rows.chunks_exact(n).enumerate() {
            let weight = 1.0 / (noise[k % dof].powi(2) * states as f64);
            for i in 0..n {
                if row[i] != 0.0 {
                    axpy(weight * row[i], row, &mut workload[i * n..(i + 1) * n]);
                }
            }
        }
        let column: Vec<f64> = (0..n)
            .map(|i| {
                let rms = workload[i * n + i].sqrt();
                if rms > 0.0 { rms } else { 1.0 }
            })
            .collect();
        for i in 0..n {
            for j in 0..n {
                workload[i * n + j] /= column[i] * column[j];
            }
        }
        let load = |k: usize| {
            let mut standard = vec![0.0; full];
            standard[k] = 1.0;
            base.from_standard(&standard)
        };
        let last = LINK_PARAMETERS * (dof - 1);
        let payload = (last..last + LINK_PARAMETERS).map(load).collect();
        let unknown =
            if model.unknown_bodies().is_empty() { Vec::new() } else { base.std_from_standard(model.unknown_bodies()) };
        Scales { column, torque_noise: noise, torque, workload, payload, unknown }
    }

    /// The same columns for energy rows, of which there is one: torque noise at the workload's speeds for `span` \[s\]
    /// is the first guess of its noise \[J\].
    #[must_use]
    pub(crate) fn of_energy(mut self, model: &Model, span: f64) -> Scales {
        // Uniform speeds have an rms of their limit over sqrt 3.
        let power =
            |(noise, joint): (&f64, &rivet_dynamics::Joint)| noise * SPEED_SHARE * speed_limit(joint) / 3.0_f64.sqrt();
        let square: f64 = self.torque_noise.iter().zip(&model.arm.joints).map(power).map(|p| p * p).sum();
        self.torque_noise = vec![square.sqrt() * span];
        // A row is a whole span of motion: too few come in the time that a load is given.
        self.payload.clear();
        self
    }

    /// Coordinates in which the workload's information is the identity: `x̃ = Lᵀx`, with L from the scaled workload.
    pub(crate) fn whitening(&self) -> Whitening {
        let n = self.column.len();
        let floor = WHITENING_FLOOR * (0..n).map(|i| self.workload[i * n + i]).sum::<f64>() / n as f64;
        let mut l = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..=i {
                let (row_i, row_j) = (&l[i * n..i * n + j], &l[j * n..j * n + j]);
                let rest = self.workload[i * n + j] - dot(row_i, row_j);
                l[i * n + j] = if i == j { rest.max(floor).sqrt() } else { rest / l[j * n + j] };
            }
        }
        // Rows of T = L⁻¹ by forward substitution on unit vectors.
        let mut t = vec![0.0; n * n];
        for column in 0..n {
            for i in column..n {
                let sum: f64 = (column..i).map(|k| l[i * n + k] * t[k * n + column]).sum();
                t[i * n + column] = (f64::from(u8::from(i == column)) - sum) / l[i * n + i];
            }
        }
        Whitening { n, t: (0..n).flat_map(|i| t[i * n..=i * n + i].iter().map(|t| *t as f32)).collect() }
    }
}

/// Whether `parameters` are in the model and all 0: nobody has said anything of them.
fn unknown(model: &Model, base: &BaseSet, nominal_base: &[f64], parameters: &[Parameter]) -> bool {
    let value = |wanted: &Parameter| {
        let standard = model.parameters.iter().position(|p| p == wanted)?;
        base.independent.iter().position(|column| *column == standard).map(|i| nominal_base[i])
    };
    parameters.iter().all(|p| value(p) == Some(0.0))
}

/// The inverse T of the Cholesky factor L of the scaled workload: a lower triangle, packed. L is applied by substitution, so that
/// there and back is the identity whatever T is: rounded to single precision it whitens as well.
#[derive(Clone, Debug)]
pub(crate) struct Whitening {
    n: usize,
    t: Vec<f32>,
}

/// Room for a product of [`Whitening::rows`]: one lane a row.
#[derive(Clone, Debug)]
pub(crate) struct LaneScratch(Vec<Lanes>);

impl LaneScratch {
    pub(crate) fn new(n: usize) -> LaneScratch {
        LaneScratch(vec![Lanes::default(); n])
    }
}

impl Whitening {
    /// Rows of a regressor (n entries each, at most as many as there are lanes) in these coordinates: `row ← T·row`.
    pub(crate) fn rows(&self, rows: &mut [f64], scratch: &mut LaneScratch) {
        let LaneScratch(room) = scratch;
        for (lane, row) in rows.chunks_exact(self.n).enumerate() {
            room.iter_mut().zip(row).for_each(|(lanes, x)| lanes[lane] = *x);
        }
        lower_times(&self.t, room);
        for (lane, row) in rows.chunks_exact_mut(self.n).enumerate() {
            row.iter_mut().zip(&*room).for_each(|(x, lanes)| *x = lanes[lane]);
        }
    }

    /// Parameters in these coordinates: `Lᵀ·x`.
    pub(crate) fn coordinates(&self, x: &[f64], out: &mut [f64]) {
        out.copy_from_slice(x);
        for k in (0..self.n).rev() {
            let (row, pivot) = self.row(k);
            out[k] /= pivot;
            let x = out[k];
            axpy_short(-x, row, &mut out[..k]);
        }
    }

    /// Parameters back: `Tᵀ·x̃`.
    pub(crate) fn parameters(&self, coordinates: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        for (k, &x) in coordinates.iter().enumerate() {
            axpy_short(x, &self.t[packed(k)], &mut out[..=k]);
        }
    }

    /// A direction of these coordinates expressed as a covector on parameters: `L·v`, so that `v·x̃ = (L·v)·x`.
    pub(crate) fn covector(&self, v: &[f64], out: &mut [f64]) {
        lower_solve(&self.t, v, out);
    }

    /// The same of four directions, side by side and in place.
    pub(crate) fn covectors(&self, v: &mut [[f64; 4]]) {
        lower_solve_four(&self.t, v);
    }

    /// Row k of T left of its diagonal, and that.
    fn row(&self, k: usize) -> (&[f32], f64) {
        let row = &self.t[packed(k)];
        (&row[..k], f64::from(row[k]))
    }

    /// How coordinate k enters parameter i: `T[k][i]`.
    pub(crate) fn share(&self, i: usize, k: usize) -> f64 {
        f64::from(self.t[packed(k)][i])
    }
}

fn speed_limit(joint: &rivet_dynamics::Joint) -> f64 {
    if joint.velocity.is_finite() && joint.velocity > 0.0 { joint.velocity } else { WORKLOAD_SPEED_LIMIT_RAD_S }
}

/// The states of the reference workload: positions, speeds, accelerations.
pub(crate) fn workload(model: &Model, mut each: impl FnMut(&[f64], &[f64], &[f64])) {
    let dof = model.arm.dof();
    let (mut q, mut qd, mut qdd) = (vec![0.0; dof], vec![0.0; dof], vec![0.0; dof]);
    let mut seed = 0x7269_7665_7465_7374;
    for _ in 0..STATES {
        for (j, joint) in model.arm.joints.iter().enumerate() {
            let reach = if joint.kind == JointKind::Revolute { std::f64::consts::PI } else { 1.0 };
            let (low, high) = (joint.lower.clamp(-reach, reach), joint.upper.clamp(-reach, reach));
            q[j] = low + (high - low) * unit(&mut seed);
            let speed = SPEED_SHARE * speed_limit(joint);
            qd[j] = speed * (2.0 * unit(&mut seed) - 1.0);
            qdd[j] = speed / RISE_TIME * (2.0 * unit(&mut seed) - 1.0);
        }
        each(&q, &qd, &qdd);
    }
}

/// SplitMix64 (Steele, Lea & Flood 2014) on [0, 1): the same workload on every machine.
fn unit(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}
