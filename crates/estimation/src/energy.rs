//! The energy (integral) model: one row a sample, without acceleration, of the same base parameters (paper, 3.1.3).
//!
//! ```text
//! [e(q, q̇) − e(q₀, q̇₀) + ∫ p dt]ᵀ·x = ∫ τᵀq̇ dt            eq. 17
//! ```
//!
//! Friction's work and the drives' are integrated by one rule, so that friction is exact whatever the rule. Rows are
//! either counted from the start, as in the paper, or over a span: the difference of two such rows.

use crate::filter::{Bank, Butterworth};
use crate::linear::dot;
use crate::report::{Estimate, Motion};
use crate::residuals::{CLEAR, Residuals};
use crate::signals::Past;
use rivet_dynamics::{BaseSet, Model, Workspace};

/// Energies and work of one motion, measured or desired.
#[derive(Clone, Debug)]
struct EnergyRow {
    n: usize,
    period: f64,
    bank: Option<Bank>,
    /// Scratch: one standard row.
    standard: Vec<f64>,
    /// Energies at the start, base columns.
    start: Vec<f64>,
    /// Integrand of the last three samples, newest first: dissipation of each base column, then the drives' power.
    power: [Vec<f64>; 3],
    work: Vec<f64>,
    /// The row, filtered: base columns, then the work.
    row: Vec<f64>,
    past: Past,
    age: u64,
}

impl EnergyRow {
    /// `filter`: the model filter, where there is one; `span`: rows that a row covers, 0 for all since the start.
    fn new(model: &Model, base: &BaseSet, filter: Option<&Butterworth>, period: f64, span: usize) -> EnergyRow {
        let n = base.len();
        let zeros = || vec![0.0; n + 1];
        EnergyRow {
            n,
            period,
            bank: filter.map(|filter| Bank::new(filter.clone(), n + 1)),
            standard: vec![0.0; model.len()],
            start: vec![0.0; n],
            power: [zeros(), zeros(), zeros()],
            work: zeros(),
            row: zeros(),
            past: Past::new(n + 1, span),
            age: 0,
        }
    }

    fn restart(&mut self) {
        self.age = 0;
        self.work.fill(0.0);
        self.past.restart();
        if let Some(bank) = &mut self.bank {
            bank.restart();
        }
    }

    /// Takes in a sample; `tau` is empty for a desired motion, whose work nobody asks for.
    fn step(&mut self, model: &Model, base: &BaseSet, ws: &Workspace, motion: Motion<'_>, tau: &[f64]) {
        let n = self.n;
        self.power.rotate_right(1);
        model.dissipation(motion.qd, &mut self.standard);
        base.select(&self.standard, model.len(), &mut self.power[0][..n]);
        self.power[0][n] = tau.iter().zip(motion.qd).map(|(tau, qd)| tau * qd).sum();
        model.energy(ws, motion.q, motion.qd, &mut self.standard);
        base.select(&self.standard, model.len(), &mut self.row[..n]);
        if self.age == 0 {
            self.start.copy_from_slice(&self.row[..n]);
        }
        // Adams-Moulton: third order from the third sample on, and no sample of delay.
        let [a, b, c] = match self.age {
            0 => [0.0; 3],
            1 => [0.5, 0.5, 0.0],
            _ => [5.0 / 12.0, 8.0 / 12.0, -1.0 / 12.0],
        };
        for (k, work) in self.work.iter_mut().enumerate() {
            *work += self.period * (a * self.power[0][k] + b * self.power[1][k] + c * self.power[2][k]);
        }
        for (row, start) in self.row.iter_mut().zip(&self.start) {
            *row -= start;
        }
        self.row[n] = 0.0;
        for (row, work) in self.row.iter_mut().zip(&self.work) {
            *row += work;
        }
        if let Some(bank) = &mut self.bank {
            bank.step(&mut self.row);
        }
        self.age += 1;
    }

    /// Writes the row of the span that ends now and returns its work \[J\]. Called once a row period.
    fn take(&mut self, out: &mut [f64]) -> f64 {
        let before = self.past.oldest();
        for (k, out) in out.iter_mut().enumerate() {
            *out = self.row[k] - before.map_or(0.0, |row| row[k]);
        }
        let work = self.row[self.n] - before.map_or(0.0, |row| row[self.n]);
        self.past.store(&self.row);
        work
    }
}

/// What the identifier needs beside its own parts when it learns from energy rows.
#[derive(Clone, Debug)]
pub(crate) struct Energy {
    measured: EnergyRow,
    desired: EnergyRow,
    d: Vec<f64>,
    z: Vec<f64>,
    ws: Workspace,
    nominal: Vec<f64>,
    /// Torque residuals each joint: an energy has none, and reports are in N·m.
    watch: Residuals,
}

impl Energy {
    /// `memory`: of the reported torque residuals \[rows\]; others as for [`EnergyRow::new`].
    pub(crate) fn new(
        model: &Model,
        base: &BaseSet,
        nominal: &[f64],
        filter: Option<&Butterworth>,
        period: f64,
        span: usize,
        memory: f64,
    ) -> Energy {
        let row = || EnergyRow::new(model, base, filter, period, span);
        Energy {
            measured: row(),
            desired: row(),
            d: vec![0.0; base.len()],
            z: vec![0.0; base.len()],
            ws: Workspace::new(&model.arm),
            nominal: nominal.to_vec(),
            watch: Residuals::new(model.arm.dof(), memory),
        }
    }

    /// Takes in a sample.
    pub(crate) fn step(
        &mut self,
        model: &Model,
        base: &BaseSet,
        motion: Motion<'_>,
        tau: &[f64],
        setpoint: Option<Motion<'_>>,
    ) {
        self.measured.step(model, base, &self.ws, motion, tau);
        match setpoint {
            Some(setpoint) => self.desired.step(model, base, &self.ws, setpoint, &[]),
            None => self.desired.restart(),
        }
    }

    /// The row that is due: columns, work \[J\], and the planned motion's row once that has run for `settled` samples.
    pub(crate) fn take(&mut self, settled: u64) -> (&[f64], f64, Option<&[f64]>) {
        let work = self.measured.take(&mut self.d);
        let planned = self.desired.age >= settled;
        if planned {
            // Its work is nobody's: the plan knows no torque.
            self.desired.take(&mut self.z);
        }
        (&self.d, work, planned.then_some(&self.z[..]))
    }

    pub(crate) fn restart_signals(&mut self) {
        self.measured.restart();
        self.desired.restart();
    }

    pub(crate) fn reset(&mut self) {
        self.watch.reset();
    }

    /// Torque residuals of the torque rows `d` with `values`, for the report alone.
    pub(crate) fn watch(&mut self, d: &[f64], tau: &[f64], share: &[f64], values: &[f64]) {
        self.watch.count(share);
        for (j, row) in d.chunks_exact(values.len()).enumerate().filter(|(j, _)| share[*j] >= CLEAR) {
            self.watch.add(j, [tau[j] - dot(row, values), tau[j] - dot(row, &self.nominal), tau[j]]);
        }
    }

    /// The estimate with what is said of joints put in torque units.
    pub(crate) fn report<'a>(&'a self, estimate: &Estimate<'a>) -> Estimate<'a> {
        let [residual_rms, nominal_residual_rms, torque_rms] = &self.watch.rms;
        Estimate {
            torque_noise: residual_rms,
            residual_rms,
            nominal_residual_rms,
            torque_rms,
            rows_used: &self.watch.used,
            rows_left_out: &self.watch.left_out,
            ..*estimate
        }
    }
}
