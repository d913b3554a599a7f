//! Rows in, parameters out: recursive instrumental variables in information form, recursive least squares beside them.
//!
//! ```text
//! M = Σ λ^(N−i) w z dᵀ,   S = Σ λ^(N−i) w z zᵀ,   y = Σ λ^(N−i) w z τ      w ~ 1/σⱼ² of the row's joint
//! held coordinates enter as known:   M_aa·δ_a = (y − M·x)_a,   x_a ← x_a + δ_a
//! cov(x_a) = v·M_aa⁻¹·S_aa·M_aa⁻ᵀ,  v = κ·σₑ²·Σλ^2(N−i)/Σλ^(N−i)          (after Söderström & Stoica 1983)
//! ```
//!
//! The prior is not part of M: noise-free data give exact parameters. Rows are taken in at once; everything of order n³
//! (judging the information, solving, standard deviations) runs in a cycle of bounded steps, see [`Estimator::work`].

mod comparison;
mod cycle;
mod long_run;
#[cfg(test)]
mod nees;
mod payload;
mod state;
mod witnesses;

pub use comparison::Hausman;

use crate::change::{Change, Changed};
use crate::kernels::{Part, add_products, times, times_three};
use crate::linear::{axpy, packed};
use crate::noise::Noise;
use crate::report::{Estimate, Instrument, ParameterState, Skip, Verdict};
use crate::residuals::{CLEAR, Residuals};
use crate::scales::{LaneScratch, Scales, Whitening};
use crate::settings::{EstimatorKind, Prior, Supervision};
use crate::supervision::{self, Columns, Judge, Tracked};
use crate::ud::UdFilter;
use comparison::Comparison;
use cycle::Cycle;
use long_run::LongRun;
use payload::Payload;
use rivet_dynamics::MAX_JOINTS;
use witnesses::Witnesses;

/// A parameter whose nominal value makes less than this share of the workload's torque has a prior as if it made it:
/// zero is not known exactly.
const MIN_PRIOR_WORKLOAD_SHARE: f64 = 0.05;
/// What is not identified yet moves when the window knows it better than this share of the prior's width. Far from 1: a
/// direction mixes many parameters, and if each were let in as soon as it beats the prior, their errors would add up
/// to a torque as uncertain as the prior's. 0.3 lets the first second of a real log (6R, delayed instruments) spoil the
/// rest; 0.03 to 0.1 do not.
const PRIOR_CAUTION: f64 = 0.05;
/// Coloured residuals count for at most this many times fewer rows than white ones.
const MOST_COLOUR: f64 = 4.0;
/// Beyond this condition number of the covariance a window of constant trace forgets nothing: it is then one badly known
/// direction that fills the trace.
const WORST_CONDITION: f64 = 1e10;
/// Squares of rows larger than this would spoil the sums.
const LARGEST_ROW: f64 = 1e60;

/// What an [`Estimator`] is told about its work.
#[derive(Clone, Debug, PartialEq)]
pub struct EstimatorSettings {
    /// Which estimator makes the values.
    pub kind: EstimatorKind,
    /// λ: weight of the past at each update, in (0, 1]; the least there is with a `deviation`.
    pub forgetting: f64,
    /// Forgetting varies and keeps the trace of the covariance: rms of the parameters' standard deviations, in units of the
    /// scales and for white residuals.
    pub deviation: Option<f64>,
    /// Which parameters or directions may move.
    pub supervision: Supervision,
    /// How well the nominal parameters are known.
    pub prior: Prior,
    /// Whether `Scales::torque_noise` is the truth (else a first guess).
    pub noise_known: bool,
    /// Memory of the running estimate of noise \[rows\].
    pub noise_memory: f64,
    /// Rows whose residual is beyond this many sigmas lose weight; infinite weighs all alike.
    pub outlier: f64,
    /// Memory of the reported residuals \[rows\].
    pub residual_memory: f64,
    /// How rows of white noise are correlated.
    pub correlation: Correlation,
    /// Time between rows \[s\], if a changed arm is to be noticed: its load forgotten, or the window begun anew; needs
    /// forgetting.
    pub change_row_s: Option<f64>,
    /// Updates that make a block of scores: longer than residuals stay correlated, and several in the window.
    pub block: usize,
}

#[cfg(test)]
impl EstimatorSettings {
    /// Recursive instrumental variables for white rows of unit noise, a hundred in the window.
    pub(crate) fn whitened(supervision: Supervision) -> EstimatorSettings {
        EstimatorSettings {
            kind: EstimatorKind::Riv,
            forgetting: 0.99,
            deviation: None,
            supervision,
            prior: Prior { relative_std: 1.0 },
            noise_known: true,
            noise_memory: 100.0,
            outlier: f64::INFINITY,
            residual_memory: 100.0,
            correlation: Correlation { factor: 1.0, neighbour: 0.0 },
            change_row_s: None,
            block: 20,
        }
    }
}

/// Correlation of the residuals of one joint. Rows of white noise are correlated by the model filter; what real
/// residuals have beyond that is estimated while running and adds to κ, how many rows make one independent row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correlation {
    /// κ of white noise ([`correlation_factor`](crate::filter::correlation_factor)); 1 for rows that are independent.
    pub factor: f64,
    /// Correlation of neighbouring rows of white noise; 0 for rows that are independent.
    pub neighbour: f64,
}

impl Correlation {
    /// κ for residuals whose neighbours correlate by `measured`: as an AR(1) process would have it, relative to white
    /// noise. Between once and [`MOST_COLOUR`] times the factor of white noise: beyond that, everything would be held.
    fn factor(&self, measured: f64) -> f64 {
        let rows = |rho: f64| (1.0 + rho) / (1.0 - rho);
        let colour = rows(measured.clamp(-0.99, 0.99)) / rows(self.neighbour.clamp(-0.99, 0.99));
        self.factor * colour.clamp(1.0, MOST_COLOUR)
    }
}

/// The estimator: p rows (joints) at a time, n parameters.
#[derive(Clone, Debug)]
pub struct Estimator {
    n: usize,
    settings: EstimatorSettings,
    column: Vec<f64>,
    /// 1 / `column`: every row is multiplied by it.
    inverse_column: Vec<f64>,
    whitening: Option<Whitening>,
    nominal: Vec<f64>,
    /// Prior standard deviation of each scaled parameter \[torque-noise sigma\].
    prior: Vec<f64>,
    noise: Noise,
    ud: UdFilter,
    /// M, S (lower triangle, packed) and y in working coordinates; M and S are empty where the tracked scheme has them.
    m: Vec<f64>,
    s: Vec<f64>,
    y: Vec<f64>,
    excited: Vec<f64>,
    /// Σ λ^(N−i) and Σ λ^2(N−i).
    count: [f64; 2],
    long_run: LongRun,
    comparison: Comparison,
    witnesses: Witnesses,
    /// The window holds what the last rows speak against: it begins anew with the next one.
    stale: bool,
    cycle: Cycle,
    /// Scaled, weighted rows, and the same in working coordinates.
    rows: Rows,
    values: Vec<f64>,
    std: Vec<f64>,
    state: Vec<ParameterState>,
    excitation: Vec<f64>,
    rls_values: Vec<f64>,
    residuals: Residuals,
    verdict: Verdict,
    /// `None` when nothing is forgotten: the arm is then taken to be one and the same.
    change: Option<Change>,
    /// What a load changes, where it is known and the sums are at hand.
    payload: Option<Payload>,
    /// λ of the last update.
    lambda: f64,
    updates: u64,
    frozen: bool,
    instrument: Instrument,
}

/// What supervision by directions has decided, in coordinates in which a reference workload excites every direction
/// alike \[torque-noise sigma\].
#[derive(Clone, Debug)]
pub struct Directions<'a> {
    /// The estimate, n.
    pub coordinates: &'a [f64],
    /// Orthonormal directions, and whether each was identified in the last step: then it moved, unless the measured rows refused.
    pub directions: Vec<(&'a [f64], bool)>,
}

#[derive(Clone, Debug)]
struct Rows {
    d: Vec<f64>,
    z: Vec<f64>,
    tau: Vec<f64>,
    residual: Vec<f64>,
    weight: Vec<f64>,
    scaled: Vec<f64>,
    lanes: LaneScratch,
}

impl Estimator {
    /// Starts at `nominal` (n values) with the given scales, which are those of at most [`MAX_JOINTS`] rows at a time.
    #[must_use]
    pub fn new(nominal: &[f64], scales: &Scales, settings: &EstimatorSettings) -> Estimator {
        let (n, p) = (nominal.len(), scales.torque_noise.len());
        let least = MIN_PRIOR_WORKLOAD_SHARE * scales.torque;
        let relative = settings.prior.relative_std;
        let unknown = |i: usize| scales.unknown.get(i).copied().unwrap_or(0.0);
        let width = |(i, (x, c)): (usize, (&f64, &f64))| relative * (x * c).abs().max(unknown(i) * c).max(least);
        let prior: Vec<f64> = nominal.iter().zip(&scales.column).enumerate().map(width).collect();
        let judge = match settings.supervision {
            Supervision::Off => Judge::Off,
            Supervision::Columns(columns) => Judge::Columns(Columns::new(n, columns)),
            Supervision::Eigen(eigen) => Judge::Directions(supervision::Directions::new(n, eigen)),
            Supervision::Tracked(tracked) => {
                Judge::Tracked(Box::new(Tracked::new(n, p, tracked, settings.forgetting, settings.change_row_s)))
            }
        };
        let tracked = matches!(judge, Judge::Tracked(_));
        let whitening = (tracked || matches!(judge, Judge::Directions(_))).then(|| scales.whitening());
        let scaled: Vec<f64> = nominal.iter().zip(&scales.column).map(|(x, c)| x * c).collect();
        let variance: Vec<f64> = prior.iter().map(|std| std * std).collect();
        let zeros = || vec![0.0; p];
        let mut estimator = Estimator {
            n,
            settings: settings.clone(),
            column: scales.column.clone(),
            inverse_column: scales.column.iter().map(|c| 1.0 / c).collect(),
            whitening,
            nominal: nominal.to_vec(),
            prior,
            noise: Noise::new(&scales.torque_noise, settings.noise_known, settings.noise_memory, settings.outlier),
            ud: UdFilter::new(&scaled, &variance),
            m: vec![0.0; if tracked { 0 } else { n * n }],
            s: vec![0.0; if tracked { 0 } else { packed(n).start }],
            y: vec![0.0; n],
            excited: vec![0.0; n],
            count: [0.0; 2],
            long_run: LongRun::new(n, settings.block.max(1)),
            comparison: Comparison::new(p, n),
            witnesses: Witnesses::new(p, n, 1.0 / (1.0 - settings.forgetting)),
            stale: false,
            cycle: Cycle::new(n, judge),
            rows: Rows {
                d: vec![0.0; p * n],
                z: vec![0.0; p * n],
                tau: zeros(),
                residual: zeros(),
                weight: zeros(),
                scaled: vec![0.0; n],
                lanes: LaneScratch::new(n),
            },
            values: nominal.to_vec(),
            std: vec![0.0; n],
            state: vec![ParameterState::Unidentified; n],
            excitation: vec![0.0; n],
            rls_values: nominal.to_vec(),
            residuals: Residuals::new(p, settings.residual_memory),
            verdict: Verdict::NONE,
            change: settings
                .change_row_s
                .filter(|_| settings.forgetting < 1.0)
                .map(|row_s| Change::new(p, row_s, 1.0 / (1.0 - settings.forgetting))),
            payload: None,
            lambda: settings.forgetting,
            updates: 0,
            frozen: false,
            instrument: Instrument::None,
        };
        if estimator.change.is_some() && !tracked && !settings.kind.least_squares() {
            let scaled = |column: &Vec<f64>| column.iter().zip(&scales.column).map(|(x, c)| x * c).collect();
            let columns: Vec<Vec<f64>> = scales.payload.iter().map(scaled).collect();
            estimator.payload = Some(Payload::new(&columns, estimator.whitening.as_ref()));
        }
        estimator.reset();
        estimator
    }

    /// Takes in the rows of one instant. Real-time safe.
    ///
    /// * `d`: regressor, p x n row-major; `tau`: p torques \[N·m\]
    /// * `z`: instruments, p x n, and which they are; `None` when there are none. Not read by least squares.
    /// * `share`: how much each of the p rows counts, 0 (not at all) to 1 (wholly)
    ///
    /// Returns how many rows counted for a half and more; without one nothing is learnt, and nothing forgotten. Values change
    /// later, by [`work`](Self::work) or [`settle`](Self::settle).
    ///
    /// # Errors
    /// Why nothing was learnt; the information is then as it was before.
    pub fn update(
        &mut self,
        d: &[f64],
        z: Option<(&[f64], Instrument)>,
        tau: &[f64],
        share: &[f64],
    ) -> Result<usize, Skip> {
        let n = self.n;
        let count = share.iter().filter(|share| **share >= CLEAR).count();
        self.residuals.count(share);
        if count == 0 {
            return Err(Skip::Standstill);
        }
        let z = if self.settings.kind.least_squares() { Some((d, Instrument::Regressor)) } else { z };
        if ![d, tau, z.map_or(&[], |(z, _)| z)].into_iter().all(usable) {
            return Err(Skip::NotFinite);
        }
        let changed = self.watch(d, tau, share);
        if self.frozen {
            return Err(Skip::Frozen);
        }
        let stale = std::mem::take(&mut self.stale);
        if changed != Changed::No || stale {
            // Not the arm is another one, if the nominal values fit as before.
            let wrong = self.supervised() && self.witnesses.recent_refute(self.noise.equation_variance());
            // What is heaviest on an arm and changes at once is what it carries; if that was not it, the residuals stay.
            if changed == Changed::Yes && !wrong && self.forget_load() {
                return Err(Skip::Changed);
            }
            if wrong || stale {
                self.values.copy_from_slice(&self.nominal);
            }
            self.begin_window();
        }
        if self.unloading() {
            return Err(Skip::Changed);
        }
        // Least squares leave out the rows that instruments have to leave out: what is compared has seen the same.
        let lambda = if z.is_some() { self.forgetting() } else { self.lambda };
        let rows = &mut self.rows;
        for j in 0..tau.len() {
            rows.tau[j] = tau[j] * rows.weight[j];
            scale_row(&d[j * n..(j + 1) * n], rows.weight[j], &self.inverse_column, &mut rows.d[j * n..(j + 1) * n]);
        }
        self.witnesses.add(&rows.d, &rows.tau);
        let Some((z, instrument)) = z else { return Err(Skip::NoInstrument) };
        self.lambda = lambda;
        self.ud.forget(lambda);
        for (j, row) in rows.d.chunks_exact(n).enumerate().filter(|(j, _)| share[*j] > 0.0) {
            self.ud.update(row, rows.tau[j]);
        }
        for ((out, x), scale) in self.rls_values.iter_mut().zip(self.ud.values()).zip(&self.inverse_column) {
            *out = x * scale;
        }
        self.instrument = instrument;
        for j in 0..tau.len() {
            scale_row(&z[j * n..(j + 1) * n], rows.weight[j], &self.inverse_column, &mut rows.z[j * n..(j + 1) * n]);
        }
        self.compare(d, z, share);
        self.accumulate(share);
        self.count[0] = lambda * self.count[0] + 1.0;
        self.count[1] = lambda * lambda * self.count[1] + 1.0;
        self.updates += 1;
        self.cycle.fresh();
        Ok(count)
    }

    /// What the regressor has that the instruments have not, beside both.
    fn compare(&mut self, d: &[f64], z: &[f64], share: &[f64]) {
        let (n, rows) = (self.n, &self.rows);
        self.comparison.forget(self.lambda);
        // Equal rows give zero exactly: both products are formed alike.
        let mut torques = [[0.0; MAX_JOINTS]; 2];
        for (torques, rows) in torques.iter_mut().zip([d, z]) {
            times(rows, &self.values, &mut torques[..share.len()]);
        }
        for j in (0..share.len()).filter(|&j| share[j] > 0.0) {
            let joint_row = j * n..(j + 1) * n;
            let off = rows.weight[j] * (torques[0][j] - torques[1][j]);
            self.comparison.add(j, [&rows.d[joint_row.clone()], &rows.z[joint_row]], rows.tau[j], off);
        }
    }

    /// Whether least squares is biased by noise in the regressor, going by the window; `None` without enough rows. Work of
    /// order n² times joints; allocates nothing.
    #[must_use]
    pub fn hausman(&self) -> Option<Hausman> {
        let variance = self.row_variance() / self.window_share();
        self.comparison.hausman(&self.ud, variance, self.count[0])
    }

    /// What noise in the regressor of joint `j` puts on least squares, over what is left of it with instruments
    /// ([`Bias::ratio`](crate::offline::Bias::ratio), along the estimate); near 1 the instruments see the noise as well.
    /// NaN with delayed instruments, which differ from the regressor by motion, and without rows.
    #[must_use]
    pub fn instrument_ratio(&self, j: usize) -> f64 {
        match self.instrument {
            Instrument::None | Instrument::Delayed | Instrument::Regressor => f64::NAN,
            _ => self.comparison.ratio(j, self.values.iter().zip(&self.column).map(|(x, c)| x * c)),
        }
    }

    /// λ of the update that comes: with a `deviation`, what brings the trace of the covariance back to where it is kept, but no
    /// less than the shortest window's and no more than 1.
    fn forgetting(&self) -> f64 {
        let least = self.settings.forgetting;
        let Some(deviation) = self.settings.deviation else { return least };
        if self.ud.least_condition() > WORST_CONDITION {
            return 1.0;
        }
        (self.ud.trace() / (self.n as f64 * deviation * deviation)).clamp(least, 1.0)
    }

    /// Residuals of the rows with the values of the time, before they are learnt from, and the weights they give.
    /// Returns whether the arm has changed.
    fn watch(&mut self, d: &[f64], tau: &[f64], share: &[f64]) -> Changed {
        self.rows.weight.fill(0.0);
        // Of the values of now, of the nominal ones and of least squares.
        let mut torques = [[0.0; 3]; MAX_JOINTS];
        times_three(d, [&self.values, &self.nominal, &self.rls_values], &mut torques[..tau.len()]);
        let residuals = |j: usize| torques[j].map(|torque| tau[j] - torque);
        let clear = (0..tau.len()).filter(|j| share[*j] >= CLEAR);
        // Frozen values do not follow: a change is seen once they learn again.
        let learnt = self.load_is_learnt();
        let change = self.change.as_mut().filter(|_| !self.frozen);
        let changed = change.map_or(Changed::No, |change| change.add(clear.map(|j| (j, residuals(j)[0])), learnt));
        for j in (0..tau.len()).filter(|j| share[*j] > 0.0) {
            let [residual, nominal, beside] = residuals(j);
            // Noise is what the better of the two predictors leaves: values that are wrong (held, or a payload ago) must
            // not pass for noise, or the threshold would rise and hold them for ever.
            let noise = if beside.abs() < residual.abs() { beside } else { residual };
            // By the noise as it was before this row: no row excuses itself.
            self.rows.weight[j] = self.noise.weight(j, noise) * share[j].sqrt();
            self.rows.residual[j] = noise * self.rows.weight[j];
            self.witnesses.watch(j, [nominal, residual].map(|residual| residual * self.rows.weight[j]));
            if share[j] >= CLEAR {
                self.residuals.add(j, [residual, nominal, tau[j]]);
                if !self.frozen {
                    self.noise.add(j, noise);
                }
            }
        }
        self.noise.balance();
        changed
    }

    /// Goes on from the values of now with nothing in the window.
    fn begin_window(&mut self) {
        if let Some(change) = &mut self.change {
            change.restart();
        }
        let values = std::mem::take(&mut self.values);
        self.reload(&values);
        self.values = values;
    }

    /// `M ← λM + Σ z·dᵀ`, the lower triangle of `S ← λS + Σ z·zᵀ`, `y ← λy + Σ z·τ`.
    fn accumulate(&mut self, share: &[f64]) {
        let n = self.n;
        let lambda = self.lambda;
        let rows = &mut self.rows;
        for v in &mut self.excited {
            *v *= lambda;
        }
        for (j, z) in rows.z.chunks_exact(n).enumerate().filter(|(j, _)| share[*j] > 0.0) {
            debug_assert!(j < rows.tau.len());
            for (sum, z) in self.excited.iter_mut().zip(z) {
                *sum += z * z;
            }
        }
        if let Some(whitening) = &self.whitening {
            for matrix in [&mut rows.d, &mut rows.z] {
                whitening.rows(matrix, &mut rows.lanes);
            }
        }
        // Rows that are not used have weight 0: their products are zeros.
        if let Some(tracked) = self.cycle.tracked() {
            tracked.add(lambda, &rows.z, &rows.d, &rows.tau);
            for (z, residual) in rows.z.chunks_exact(n).zip(&rows.residual) {
                self.long_run.add(z, *residual);
            }
            self.long_run.advance(lambda);
            return;
        }
        add_products(&mut self.m, lambda, &rows.z, &rows.d, n, Part::All);
        add_products(&mut self.s, lambda, &rows.z, &rows.z, n, Part::Packed);
        for y in &mut self.y {
            *y *= lambda;
        }
        for ((z, tau), residual) in rows.z.chunks_exact(n).zip(&rows.tau).zip(&rows.residual) {
            axpy(*tau, z, &mut self.y);
            self.long_run.add(z, *residual);
        }
        self.long_run.advance(lambda);
    }

    /// `Σλ^2(N−i)/Σλ^(N−i)`: a row of weight λᵏ brings noise of weight λ²ᵏ, so an exponential window holds twice as many
    /// rows as its information says.
    fn window_share(&self) -> f64 {
        if self.count[0] > 0.0 { self.count[1] / self.count[0] } else { 1.0 }
    }

    /// Variance that, over the information, is the variance of an estimate: `κσₑ²·Σλ^2(N−i)/Σλ^(N−i)`.
    fn row_variance(&self) -> f64 {
        self.window_share()
            * self.settings.correlation.factor(self.noise.correlation())
            * self.noise.equation_variance()
    }

    /// The directions that the supervision judges, and the estimate in their coordinates; `None` where it judges
    /// parameters, and between two steps of [`work`](Self::work) that decompose or solve.
    #[must_use]
    pub fn directions(&self) -> Option<Directions<'_>> {
        self.cycle.directions()
    }

    /// What is known now.
    #[must_use]
    pub fn estimate(&self) -> Estimate<'_> {
        let [residual_rms, nominal_residual_rms, torque_rms] = &self.residuals.rms;
        Estimate {
            values: &self.values,
            std: &self.std,
            state: &self.state,
            excitation: &self.excitation,
            rls_values: &self.rls_values,
            torque_noise: &self.noise.sigma,
            residual_rms,
            nominal_residual_rms,
            torque_rms,
            rows_used: &self.residuals.used,
            rows_left_out: &self.residuals.left_out,
            instrument: self.instrument,
            loop_lag_s: &[],
            cycle_s: None,
            window_rows: if self.lambda < 1.0 { -1.0 / self.lambda.ln() } else { f64::INFINITY },
            verdict: self.verdict,
            changes: self.change.as_ref().map_or(0, Change::seen),
            updates: self.updates,
            frozen: self.frozen,
        }
    }
}

fn scale_row(row: &[f64], weight: f64, scale: &[f64], out: &mut [f64]) {
    for ((out, x), scale) in out.iter_mut().zip(row).zip(scale) {
        *out = x * weight * scale;
    }
}

/// Whether all entries are numbers of a size that can be squared and summed.
fn usable(row: &[f64]) -> bool {
    row.iter().fold(true, |all, x| all & (x.abs() < LARGEST_ROW))
}
