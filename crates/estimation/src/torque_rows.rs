//! The measured half of the signal chain by itself: rows and torques as the estimator sees them, for whoever wants to
//! compare what parameters predict with what drives gave.

use crate::dead_zone::slides;
use crate::differentiate::Aligned;
use crate::filter::Butterworth;
use crate::identifier::{LARGEST_EFFORT, LARGEST_MOTION, SETTLING};
use crate::report::Motion;
use crate::settings::{Settings, SettingsError};
use crate::signals::{Regressors, RowFilter, Side};
use rivet_dynamics::{BaseSet, MAX_JOINTS, Model, Workspace};
use std::sync::Arc;

/// A row counts if this share of what the filter has let through came from a moving joint.
const MOVED: f64 = 0.95;

/// Differentiates, filters and decimates one stream of positions and torques.
#[derive(Clone, Debug)]
pub struct TorqueRows {
    model: Arc<Model>,
    dof: usize,
    dead_zone: Vec<f64>,
    decimation: usize,
    settled: u64,
    phase: usize,
    aligned: Aligned,
    regressors: Regressors,
    workspace: Workspace,
    measured: RowFilter,
    rows: Vec<f64>,
    used: [bool; MAX_JOINTS],
}

impl TorqueRows {
    /// Allocates everything; only the signal part of `settings` matters.
    ///
    /// # Errors
    /// The first setting that cannot be used with this arm.
    pub fn new(model: Arc<Model>, base: &BaseSet, settings: &Settings) -> Result<TorqueRows, SettingsError> {
        let dof = model.arm.dof();
        settings.check(dof)?;
        let rate = 1.0 / settings.sample_period_s;
        let filter = Butterworth::low_pass(settings.filter_order, settings.filter_hz, rate);
        Ok(TorqueRows {
            dof,
            dead_zone: settings.dead_zone.clone(),
            decimation: settings.decimation,
            settled: (SETTLING * rate / settings.filter_hz).ceil() as u64,
            phase: 0,
            aligned: Aligned::new(dof, settings.differentiator, settings.sample_period_s),
            regressors: Regressors::new(&model),
            workspace: Workspace::new(&model.arm),
            measured: RowFilter::new(&model, base, Some(&filter), 2 * dof),
            rows: vec![0.0; dof * base.len()],
            used: [false; MAX_JOINTS],
            model,
        })
    }

    /// Takes in one sample: positions \[rad\] and torques \[N·m\], one entry a joint. True when new rows are there, which
    /// is every `decimation`-th time. A sample that no arm gives starts everything anew.
    ///
    /// Real-time safe: bounded work; no allocation, lock, system call or panic.
    pub fn push(&mut self, q: &[f64], tau: &[f64]) -> bool {
        let within = |values: &[f64], limit: f64| values.len() == self.dof && values.iter().all(|v| v.abs() <= limit);
        if !within(q, LARGEST_MOTION) || !within(tau, LARGEST_EFFORT) {
            self.restart();
            return false;
        }
        if !self.aligned.push(q, tau, None) {
            return false;
        }
        let TorqueRows { aligned, measured, model, regressors, workspace, dead_zone, .. } = self;
        model.take_effects(workspace, &aligned.q, &aligned.qd, &aligned.qdd, &mut aligned.tau);
        let slide = |j| slides(&model.structure, dead_zone, |j| aligned.qd[j], j);
        let moving = (0..dead_zone.len()).map(|j| f64::from(u8::from(slide(j))));
        let motion = Motion { q: &aligned.q, qd: &aligned.qd, qdd: &aligned.qdd };
        regressors.evaluate(model, motion, None);
        measured.step(regressors, Side::Measured, aligned.tau.iter().copied().chain(moving));
        self.phase += 1;
        if self.phase < self.decimation || self.measured.age() < self.settled {
            return false;
        }
        self.phase = 0;
        self.measured.rows(&mut self.rows);
        for (used, moving) in self.used.iter_mut().zip(&self.measured.extra()[self.dof..]) {
            *used = *moving >= MOVED;
        }
        true
    }

    /// Forgets the samples so far, after lost ones.
    pub fn restart(&mut self) {
        self.aligned.restart();
        self.measured.restart();
        self.phase = 0;
    }

    /// Filtered rows of the regressor, joints x base parameters row-major.
    pub fn rows(&self) -> &[f64] {
        &self.rows
    }

    /// Filtered torques of the same instant \[N·m\].
    pub fn tau(&self) -> &[f64] {
        &self.measured.extra()[..self.dof]
    }

    /// Which joints moved, so that their friction has a direction.
    pub fn used(&self) -> &[bool] {
        &self.used[..self.dof]
    }
}
