//! A uniform record, its derivatives, and the torque a model predicts for it.

use rayon::prelude::*;
use rivet_dynamics::{BaseSet, Model, Slip, Workspace};

use super::zero_phase::ZeroPhase;

/// Why a record cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum OfflineError {
    /// Signals of the wrong shape.
    #[error("{what} of the record: {found}, expected {expected}")]
    Shape {
        /// Which signal.
        what: &'static str,
        /// Length found.
        found: usize,
        /// Length expected.
        expected: usize,
    },
    /// Nothing left after filter edges and standstill.
    #[error("no motion is left: {rows} rows, of which the ends ({edge} each) and standstill are not used")]
    NoMotion {
        /// Rows of the record.
        rows: usize,
        /// Rows at either end that the filter still colours.
        edge: usize,
    },
    /// No joint has a single usable row.
    #[error("no joint moves faster than its dead zone in any record")]
    AllStill,
    /// A joint whose torque is zero throughout: its rows would count without limit, and say that nothing weighs anything.
    #[error("torque of joint {} is 0 in all rows in which it moves: the channel is dead or was not recorded", joint + 1)]
    NoTorque {
        /// Joint, from 0.
        joint: usize,
    },
    /// The equations have no solution in floating point.
    #[error("the {method} equations are singular; a stronger prior settles what the motion leaves open")]
    Singular {
        /// Which equations.
        method: &'static str,
    },
}

/// Positions with first and second derivative, `[joint][sample]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    /// \[rad\]
    pub q: Vec<Vec<f64>>,
    /// \[rad/s\]
    pub qd: Vec<Vec<f64>>,
    /// \[rad/s²\]
    pub qdd: Vec<Vec<f64>>,
}

impl Trajectory {
    /// Central differences of positions: `(q₊ - q₋)/2h` and `(q₊ - 2q + q₋)/h²`, the latter noisy and meant to be
    /// filtered in the model's columns. The end samples repeat their neighbours.
    pub fn from_positions(q: &[Vec<f64>], period_s: f64) -> Trajectory {
        let (h, hh) = (2.0 * period_s, period_s * period_s);
        Trajectory {
            q: q.to_vec(),
            qd: differences(q, |before, _, after| (after - before) / h),
            qdd: differences(q, |before, at, after| (after - 2.0 * at + before) / hh),
        }
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.q.first().map_or(0, Vec::len)
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// State at sample `k`, written to three slices of one entry a joint.
    pub(super) fn state(&self, k: usize, q: &mut [f64], qd: &mut [f64], qdd: &mut [f64]) {
        for (to, from) in [(q, &self.q), (qd, &self.qd), (qdd, &self.qdd)] {
            to.iter_mut().zip(from).for_each(|(to, from)| *to = from[k]);
        }
    }

    pub(super) fn check(&self, joints: usize, rows: usize) -> Result<(), OfflineError> {
        for (what, signals) in [("position", &self.q), ("velocity", &self.qd), ("acceleration", &self.qdd)] {
            check(what, signals, joints, rows)?;
        }
        Ok(())
    }
}

/// `f` of every sample with those before and after it; at the ends, of their neighbours.
fn differences(signals: &[Vec<f64>], f: impl Fn(f64, f64, f64) -> f64 + Sync) -> Vec<Vec<f64>> {
    let filtered = |q: &Vec<f64>| {
        if q.len() < 3 {
            return vec![0.0; q.len()];
        }
        let mut all = Vec::with_capacity(q.len());
        all.push(0.0);
        all.extend(q.windows(3).map(|w| f(w[0], w[1], w[2])));
        all[0] = all[1];
        all.push(all[all.len() - 1]);
        all
    };
    signals.par_iter().map(filtered).collect()
}

pub(super) fn check(what: &'static str, signals: &[Vec<f64>], joints: usize, rows: usize) -> Result<(), OfflineError> {
    if signals.len() != joints {
        return Err(OfflineError::Shape { what, found: signals.len(), expected: joints });
    }
    match signals.iter().find(|s| s.len() != rows) {
        Some(short) => Err(OfflineError::Shape { what, found: short.len(), expected: rows }),
        None => Ok(()),
    }
}

/// One run, sampled uniformly.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// Time between samples \[s\].
    pub period_s: f64,
    /// Measured motion.
    pub measured: Trajectory,
    /// Measured torque \[N m\], `[joint][sample]`.
    pub tau: Vec<Vec<f64>>,
    /// Commanded motion, free of the noise of the measured one.
    pub desired: Option<Trajectory>,
    /// Motion that second encoders saw, whose noise is their own.
    pub second: Option<Trajectory>,
}

impl Record {
    /// Takes out what `filter` does: of the positions that were measured, before they are differentiated anew, and of the torque, so that
    /// neither comes after the other and what is linear stays equal.
    pub fn smooth(&mut self, filter: &ZeroPhase) {
        let smooth = |signals: &mut [Vec<f64>]| signals.par_iter_mut().for_each(|signal| filter.apply(signal));
        for motion in std::iter::once(&mut self.measured).chain(&mut self.second) {
            smooth(&mut motion.q);
            *motion = Trajectory::from_positions(&motion.q, self.period_s);
        }
        smooth(&mut self.tau);
    }
}

/// Torque of the model with base parameters `x` along a motion \[N m\], `[joint][sample]`, its instant effects included
/// ([`Model::add_effects`]), low-passed by `smooth`: the second differences of quantised positions are noise without it.
pub fn predict(
    model: &Model,
    base: &BaseSet,
    x: &[f64],
    motion: &Trajectory,
    smooth: &ZeroPhase,
) -> Result<Vec<Vec<f64>>, OfflineError> {
    let mut tau = unfiltered_torque(model, base, x, motion)?;
    tau.par_iter_mut().for_each(|tau| smooth.apply(tau));
    Ok(tau)
}

/// The same torque before the low-pass.
pub(super) fn unfiltered_torque(
    model: &Model,
    base: &BaseSet,
    x: &[f64],
    motion: &Trajectory,
) -> Result<Vec<Vec<f64>>, OfflineError> {
    let (n, full, k) = (model.arm.dof(), model.len(), base.len());
    let rows = motion.len();
    motion.check(n, rows)?;
    if x.len() != k {
        return Err(OfflineError::Shape { what: "base parameters", found: x.len(), expected: k });
    }
    let (mut ws, mut slip) = (Workspace::new(&model.arm), Slip::new(model));
    let (mut q, mut qd, mut qdd) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let (mut y, mut d) = (vec![0.0; n * full], vec![0.0; n * k]);
    let mut tau = vec![vec![0.0; rows]; n];
    let mut at = vec![0.0; n];
    for row in 0..rows {
        motion.state(row, &mut q, &mut qd, &mut qdd);
        model.regressor_sliding(&mut ws, &mut slip, &q, &qd, &qdd, &mut y);
        base.select(&y, full, &mut d);
        for (j, tau) in tau.iter_mut().enumerate() {
            tau[row] = d[j * k..(j + 1) * k].iter().zip(x).map(|(d, x)| d * x).sum();
        }
        if !model.effects().is_empty() {
            at.iter_mut().zip(&tau).for_each(|(at, tau)| *at = tau[row]);
            model.add_effects(&mut ws, &q, &qd, &qdd, &mut at);
            tau.iter_mut().zip(&at).for_each(|(tau, at)| tau[row] = *at);
        }
    }
    Ok(tau)
}
