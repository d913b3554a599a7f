//! The gap by joint and regime: rest, reversal, slow, accelerating, cruise.

use crate::fit::stages::Stages;
use crate::model::standstill::is_moved;
use crate::policy::POLICY;
use crate::screen::prepared::Prepared;

/// What a joint does at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Regime {
    /// It stands.
    Rest,
    /// Its direction changes within a moment.
    Reversal,
    /// It creeps.
    Slow,
    /// It speeds up or brakes.
    Accelerating,
    /// It moves evenly.
    Cruise,
}

impl Regime {
    /// All of them.
    pub const ALL: [Regime; 5] = [Regime::Rest, Regime::Reversal, Regime::Slow, Regime::Accelerating, Regime::Cruise];

    /// The name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Regime::Rest => "rest",
            Regime::Reversal => "reversal",
            Regime::Slow => "slow",
            Regime::Accelerating => "accelerating",
            Regime::Cruise => "cruise",
        }
    }
}

/// Share of a joint's top speed below which it is slow, and below which it rests.
const SLOW: [f64; 2] = [0.1, 0.005];

/// The regime of every row of one joint. What its position does where it never moves for a while is its sensor's noise: it rests.
pub(crate) fn classify(run: &Prepared, joint: usize) -> Vec<Regime> {
    if !is_moved(&run.motion, &run.chain, joint) {
        return vec![Regime::Rest; run.rows()];
    }
    let speed = run.chain.sample(&run.motion.qd[joint]);
    let accel = run.chain.sample(&run.motion.qdd[joint]);
    let rms = |x: &[f64]| (x.iter().map(|v| v * v).sum::<f64>() / x.len().max(1) as f64).sqrt();
    let top = speed.iter().fold(0.0_f64, |m, v| m.max(v.abs())).max(1e-9);
    let usual = rms(&accel);
    let near = (POLICY.views.reversal_window_s / run.chain.row_period_s).round().max(1.0) as usize;
    let mut regimes: Vec<Regime> = speed
        .iter()
        .zip(&accel)
        .map(|(v, a)| match v.abs() / top {
            share if share < SLOW[1] => Regime::Rest,
            share if share < SLOW[0] => Regime::Slow,
            _ if a.abs() > usual => Regime::Accelerating,
            _ => Regime::Cruise,
        })
        .collect();
    let mut direction = 0.0;
    for k in 0..speed.len() {
        if speed[k].abs() < SLOW[1] * top {
            continue;
        }
        if direction != 0.0 && speed[k].signum() != direction {
            let last = regimes.len();
            regimes[k.saturating_sub(near)..(k + near).min(last)].fill(Regime::Reversal);
        }
        direction = speed[k].signum();
    }
    regimes
}

/// Share of the gap in one regime of one joint.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// The joint's name.
    pub joint: String,
    /// What it does.
    pub regime: Regime,
    /// Of the squared gap of all joints.
    pub share: f64,
    /// How long it did so \[s\].
    pub seconds: f64,
    /// Root mean square of the residual of the nominal model there \[N·m\].
    pub before_nm: f64,
    /// The same with all causes.
    pub after_nm: f64,
}

impl Cell {
    /// Less time in a regime than this \[s\] says nothing about it.
    pub const MIN_REGIME_TIME_S: f64 = 0.3;

    /// Whether there are data enough to say anything.
    pub fn is_known(&self) -> bool {
        self.seconds >= Cell::MIN_REGIME_TIME_S
    }
}

/// Shares of the squared gap of the nominal model, each joint's torque scaled to rms 1, by joint and regime.
pub(crate) fn cells(sealed: &Prepared, measured: &Stages, names: &[String]) -> Vec<Cell> {
    let mut cells = Vec::new();
    let mut total = 0.0;
    for (j, name) in names.iter().enumerate() {
        let regimes = classify(sealed, j);
        let (tau, model) = (&measured.tau[j], &measured.models[0][j]);
        let full = &measured.models[measured.models.len() - 1][j];
        let scale: f64 = tau.iter().map(|t| t * t).sum::<f64>().max(f64::MIN_POSITIVE);
        let counts = sealed.silent[j].is_none();
        for regime in Regime::ALL {
            let inside = (0..tau.len()).filter(|k| counts && regimes[*k] == regime);
            let (error, left, rows) = inside.fold((0.0, 0.0, 0usize), |(e, l, n), k| {
                (e + (tau[k] - model[k]).powi(2), l + (tau[k] - full[k]).powi(2), n + 1)
            });
            total += error / scale;
            let rms = |square: f64| (square / rows.max(1) as f64).sqrt();
            cells.push(Cell {
                joint: name.clone(),
                regime,
                share: error / scale,
                seconds: rows as f64 * sealed.chain.row_period_s,
                before_nm: rms(error),
                after_nm: rms(left),
            });
        }
    }
    for cell in &mut cells {
        cell.share /= f64::max(total, f64::MIN_POSITIVE);
    }
    cells.sort_by(|a, b| b.share.total_cmp(&a.share));
    cells
}
