//! The friction ladder: which friction law predicts motion that it was not fitted to.
//!
//! ```text
//! coulomb + viscous (what the model has), then on every joint beside them
//!   s·exp(−(q̇/v)²)   Stribeck           s·|τ_rigid|    with load
//!   |s|, |q̇|         by direction       q̇|q̇|, q̇³       nonlinear viscous
//! ```
//!
//! Torque and position are first brought to one time: shifted by whole samples until Coulomb and viscous friction leave least.
//! Each fold of the runs is left out once; every rung is fitted to the others, all values of the model with it, and judged by
//! the torque of the fold that is left out. A richer law is not better because it fits better: on a motion that does not vary
//! the load, friction with load is only more friction.

use nalgebra::DVector;
use rivet_dynamics::Model;

use crate::effects::Form;
use crate::effects::friction_asymmetry::Asymmetry;
use crate::effects::load_dependent_friction::Load;
use crate::effects::physics::Physics;
use crate::effects::stribeck_friction::Stribeck;
use crate::effects::viscous_nonlinearity::ViscousNonlinearity;
use crate::fit::design::{Block, Design};
use crate::fit::evidence::PRIOR_SCALES;
use crate::model::nominal::{Nominal, Typical};
use crate::model::rows::{Chain, Column};
use crate::model::run::Run;
use crate::policy::POLICY;
use crate::screen::input::{DiagnosisError, check};
use crate::screen::prepared::{Prepared, unknown};

/// Velocities at which Stribeck friction is tried, as shares of a joint's rms speed.
const STRIBECK: [f64; 4] = [0.03, 0.1, 0.3, 1.0];
/// Rounds of fitting: with the weights, and the rigid torque, of the round before.
const LADDER_FIT_ROUNDS: usize = 3;

/// Largest shift between torque and position that is tried \[s\], and in samples.
const LATEST_S: f64 = 0.03;
const MOST_SHIFTS: isize = 12;

/// Parts that a rung has beside Coulomb and viscous friction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Stribeck,
    Load,
    Direction,
    Nonlinear,
}

const RUNGS: &[(&str, &[Part])] = &[
    ("coulomb + viscous", &[]),
    ("with stribeck", &[Part::Stribeck]),
    ("with load", &[Part::Load]),
    ("by direction", &[Part::Direction]),
    ("viscous nonlinear", &[Part::Nonlinear]),
    ("stribeck and load", &[Part::Stribeck, Part::Load]),
    ("all of them", &[Part::Stribeck, Part::Load, Part::Direction, Part::Nonlinear]),
];

/// A law of friction, judged by folds that it was not fitted to.
#[derive(Clone, Debug, PartialEq)]
pub struct Rung {
    /// What it has.
    pub name: &'static str,
    /// Error of each joint over all folds: rms of the torque that is left over rms of the torque.
    pub joints: Vec<f64>,
    /// The same for each fold, all joints: root of the mean square of the joints' own.
    pub folds: Vec<f64>,
    /// The same for all folds.
    pub error: f64,
    /// Change of the mean square against the first rung, as a share of that, and its standard error over blocks of some
    /// seconds: below −2 errors it is better than Coulomb and viscous friction, above 2 worse, else these runs cannot tell.
    pub change: (f64, f64),
}

/// Laws of friction, and what they were judged with.
#[derive(Clone, Debug, PartialEq)]
pub struct Ladder {
    /// Every law, the simplest first.
    pub rungs: Vec<Rung>,
    /// By how much torque comes later than position \[s\].
    pub delay_s: f64,
}

/// Judges every law. `folds`: runs that are left out together, two folds at least; `cutoff_hz`: of the model
/// filter, what is faster is not judged. `say` is told how far it is.
///
/// # Errors
/// As [`crate::diagnose`]; [`DiagnosisError::NoRun`] with fewer than two folds.
pub fn friction_ladder(
    model: &Model,
    nominal: &[f64],
    folds: &[Vec<Run>],
    cutoff_hz: f64,
    say: &mut dyn FnMut(usize, usize),
) -> Result<Ladder, DiagnosisError> {
    let joints = model.arm.dof();
    let all: Vec<Run> = folds.iter().flatten().cloned().collect();
    for run in &all {
        check(run, joints)?;
    }
    if folds.len() < 2 || folds.iter().any(Vec::is_empty) {
        return Err(DiagnosisError::NoRun);
    }
    let typical = Typical::from_runs(&all, joints);
    let nominal = Nominal::new(model, nominal, &typical);
    let mut prepared: Vec<Prepared> =
        all.into_iter().map(|run| Prepared::by(Chain::up_to(cutoff_hz, run.period_s), run, &nominal)).collect();
    let delay_s = align(&mut prepared, &nominal, &typical).ok_or(DiagnosisError::Singular)?;
    let fold_of: Vec<usize> = folds.iter().enumerate().flat_map(|(f, runs)| runs.iter().map(move |_| f)).collect();
    let mut found: Vec<Vec<Vec<Left>>> = RUNGS.iter().map(|_| Vec::new()).collect();
    for fold in 0..folds.len() {
        let pick = |inside: bool| {
            prepared.iter().zip(&fold_of).filter(move |(_, f)| (**f == fold) == inside).map(|(run, _)| run).collect()
        };
        let (held, train): (Vec<&Prepared>, Vec<&Prepared>) = (pick(true), pick(false));
        // All laws are judged with the weights of the first.
        let mut noise = None;
        for (r, (_, parts)) in RUNGS.iter().enumerate() {
            say(fold * RUNGS.len() + r, RUNGS.len() * folds.len());
            let (law, values) = fitted(&train, &nominal, &typical, parts).ok_or(DiagnosisError::Singular)?;
            let judge = Law { noise: noise.get_or_insert_with(|| law.noise.clone()).clone(), ..law };
            found[r].push(blocks(&judge.design(&held, &nominal, &typical, parts), &held, &values));
        }
    }
    let plain = &found[0];
    let rungs = RUNGS.iter().zip(&found).map(|((name, _), left)| rung(name, left, plain)).collect();
    Ok(Ladder { rungs, delay_s })
}

/// Shifts the torque of all runs until the plainest law leaves least; by how much it came late \[s\].
fn align(runs: &mut [Prepared], nominal: &Nominal, typical: &Typical) -> Option<f64> {
    let period_s = runs[0].run.period_s;
    let most = ((LATEST_S / period_s) as isize).clamp(1, MOST_SHIFTS);
    let step = ((LATEST_S / period_s) / most as f64).round().max(1.0) as isize;
    let mut best = (f64::INFINITY, 0);
    for shift in (-most..=most).map(|k| k * step) {
        for run in &mut *runs {
            run.shift_torque(shift);
        }
        let train: Vec<&Prepared> = runs.iter().collect();
        let mut law = Law::new(&train, nominal, typical);
        let mut relative_square = 0.0;
        for _ in 0..2 {
            let fit = law.fit(&train, nominal, typical, &[])?;
            relative_square = (0..fit.left.len()).map(|j| (fit.left[j] / typical.torque(j)).powi(2)).sum();
            law.noise = fit.left;
        }
        if relative_square < best.0 {
            best = (relative_square, shift);
        }
    }
    for run in runs {
        run.shift_torque(best.1);
    }
    Some(best.1 as f64 * period_s)
}

/// Squares over one block of one fold, `[joint]`: of what is left, and of the torque \[(N·m)²\].
struct Left {
    left: Vec<f64>,
    torque: Vec<f64>,
}

fn rung(name: &'static str, left: &[Vec<Left>], plain: &[Vec<Left>]) -> Rung {
    let joints = plain[0].first().map_or(0, |block| block.left.len());
    let torque = |j: usize| left.iter().flatten().map(|b| b.torque[j]).sum::<f64>().max(f64::MIN_POSITIVE);
    let scale: Vec<f64> = (0..joints).map(|j| 1.0 / (joints as f64 * torque(j))).collect();
    let share = |block: &Left| -> f64 { block.left.iter().zip(&scale).map(|(l, s)| l * s).sum() };
    let joint = |j: usize| (left.iter().flatten().map(|b| b.left[j]).sum::<f64>() / torque(j)).sqrt();
    let fold = |blocks: &Vec<Left>| {
        let relative_error = |j: usize| {
            let torque: f64 = blocks.iter().map(|b| b.torque[j]).sum();
            blocks.iter().map(|b| b.left[j]).sum::<f64>() / torque.max(f64::MIN_POSITIVE)
        };
        ((0..joints).map(relative_error).sum::<f64>() / joints as f64).sqrt()
    };
    let whole: f64 = plain.iter().flatten().map(share).sum();
    let differences: Vec<f64> =
        left.iter().flatten().zip(plain.iter().flatten()).map(|(a, b)| (share(a) - share(b)) / whole).collect();
    let (count, sum) = (differences.len() as f64, differences.iter().sum::<f64>());
    let spread: f64 = differences.iter().map(|d| (d - sum / count).powi(2)).sum();
    Rung {
        name,
        joints: (0..joints).map(joint).collect(),
        folds: left.iter().map(fold).collect(),
        error: left.iter().flatten().map(share).sum::<f64>().sqrt(),
        change: (sum, (spread * count / (count - 1.0).max(1.0)).sqrt()),
    }
}

/// A law, and the values that come with it.
fn fitted(train: &[&Prepared], nominal: &Nominal, typical: &Typical, parts: &[Part]) -> Option<(Law, DVector<f64>)> {
    let joints = train[0].tau.len();
    let mut law = Law::new(train, nominal, typical);
    let tried: &[f64] = if parts.contains(&Part::Stribeck) { &STRIBECK } else { &STRIBECK[..1] };
    for _ in 0..LADDER_FIT_ROUNDS {
        let mut best = vec![(f64::INFINITY, tried[0]); joints];
        for share in tried {
            let fit = law.with_stribeck(vec![*share; joints]).fit(train, nominal, typical, parts)?;
            for (best, left) in best.iter_mut().zip(&fit.left) {
                if *left < best.0 {
                    *best = (*left, *share);
                }
            }
        }
        law.stribeck = best.into_iter().map(|(_, share)| share).collect();
        let fit = law.fit(train, nominal, typical, parts)?;
        law.noise = fit.left.iter().zip(&law.noise).map(|(left, floor)| left.max(1e-9 * floor)).collect();
        law.x = nominal.x.iter().zip(fit.values.iter()).map(|(nominal, off)| nominal + off).collect();
    }
    let fit = law.fit(train, nominal, typical, parts)?;
    Some((law, fit.values))
}

/// What `values` leave of `held`, block by block.
fn blocks(design: &Design, held: &[&Prepared], values: &DVector<f64>) -> Vec<Left> {
    let joints = held[0].tau.len();
    let residuals = design.residuals(values, &[]);
    let squares = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>();
    let block = |b: &Block| {
        // Rows near standstill count less: no law says what friction is between its two directions.
        let residual_square = |j: usize| squares(&mut b.rows.clone().map(|k| residuals[b.run][j][k]));
        let weighed = |j: usize, k: usize| held[b.run].tau[j][k] * design.root(b.run, j)[k];
        let torque = |j: usize| squares(&mut b.rows.clone().map(|k| weighed(j, k)));
        Left { left: (0..joints).map(residual_square).collect(), torque: (0..joints).map(torque).collect() }
    };
    design.blocks.iter().map(block).collect()
}

/// A law of friction on its way.
#[derive(Clone)]
struct Law {
    /// Standard vector that rigid torque and direction of friction are made with.
    x: Vec<f64>,
    /// Noise that joints are weighed by \[N·m\].
    noise: Vec<f64>,
    /// Stribeck velocity of each joint over its rms speed.
    stribeck: Vec<f64>,
}

struct Fit {
    /// What the model's values are off by, then sizes of the columns beside them.
    values: DVector<f64>,
    /// Root mean square of weighted rows, by joint \[N·m\].
    left: Vec<f64>,
}

impl Law {
    /// Before anything was fitted.
    fn new(runs: &[&Prepared], nominal: &Nominal, typical: &Typical) -> Law {
        let floor = |(j, floor): (usize, &f64)| floor.max(1e-3 * typical.torque(j));
        let noise: Vec<f64> = runs[0].floor.iter().enumerate().map(floor).collect();
        Law { x: nominal.x.clone(), stribeck: vec![STRIBECK[0]; noise.len()], noise }
    }

    fn with_stribeck(&self, stribeck: Vec<f64>) -> Law {
        Law { stribeck, ..self.clone() }
    }

    fn forms(&self, typical: &Typical, parts: &[Part]) -> Vec<Form> {
        let on = |joint: usize| {
            parts.iter().map(move |part| match part {
                Part::Stribeck => Stribeck { joint, velocity: self.stribeck[joint] * typical.speed(joint) }.into(),
                Part::Load => Load { joint }.into(),
                Part::Direction => Asymmetry { joint }.into(),
                Part::Nonlinear => ViscousNonlinearity { joint }.into(),
            })
        };
        (0..self.noise.len()).flat_map(on).collect()
    }

    fn design(&self, runs: &[&Prepared], nominal: &Nominal, typical: &Typical, parts: &[Part]) -> Design {
        let forms = self.forms(typical, parts);
        let extra: Vec<Vec<Column>> = runs
            .iter()
            .map(|run| {
                let physics = Physics::new(&run.run, &run.motion, nominal, &self.x);
                let mut columns = run.unnamed(nominal, &physics);
                columns.extend(forms.iter().flat_map(|form| run.columns(form, &physics)));
                columns
            })
            .collect();
        let mut std = unknown(nominal, runs[0].run.period_s);
        let columns = extra.first().map_or(0, Vec::len);
        std.extend((std.len()..columns).map(|c| size(extra.iter().map(|run| &run[c]), typical)));
        Design::new(runs, nominal, &self.noise, &extra, &std)
    }

    fn fit(&self, runs: &[&Prepared], nominal: &Nominal, typical: &Typical, parts: &[Part]) -> Option<Fit> {
        let design = self.design(runs, nominal, typical, parts);
        let weights: Vec<f64> = self.noise.iter().map(|noise| 1.0 / (noise * noise)).collect();
        let scales = design.background.solve_scales(&weights, &PRIOR_SCALES, &[]);
        let (_, best) = scales.into_iter().max_by(|a, b| a.1.log_evidence.total_cmp(&b.1.log_evidence))?;
        let residuals = design.residuals(&best.x, &[]);
        let residual_rms = |j: usize| {
            let (square, rows) =
                residuals.iter().fold((0.0, 0.0), |(s, n), run| (s + run[j].norm_squared(), n + run[j].len() as f64));
            f64::sqrt(square / f64::max(rows, 1.0))
        };
        Some(Fit { left: (0..self.noise.len()).map(residual_rms).collect(), values: best.x })
    }
}

/// Standard deviation of a column's coefficient, by what it may make of the torque of the joint that it acts on most.
fn size<'a>(runs: impl Iterator<Item = &'a Column>, typical: &Typical) -> f64 {
    let mut share = 0.0_f64;
    for (j, rows) in runs.flat_map(|column| column.iter().enumerate()) {
        let Some(rows) = rows else { continue };
        let rms = (rows.iter().map(|v| v * v).sum::<f64>() / rows.len().max(1) as f64).sqrt();
        share = share.max(rms / typical.torque(j));
    }
    if share > 0.0 { POLICY.priors.ladder_torque_share / share } else { 1.0 }
}
