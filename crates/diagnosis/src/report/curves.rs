//! Curves of the held-out residual with and without a cause, and excerpts of measured and modelled torque.

use std::f64::consts::TAU;

use rivet_dynamics::Parameter;

use crate::effects::Effect;
use crate::effects::Form;
use crate::effects::variable::Variable;
use crate::fit::stages::Stages;
use crate::model::nominal::Nominal;
use crate::model::run::derivative;
use crate::policy::POLICY;
use crate::screen::prepared::Prepared;

/// Points of a curve.
const CURVE_POINTS: usize = 24;
/// Length of an excerpt \[s\], time between its points \[s\], joints that are shown.
const EXCERPT_S: f64 = 6.0;
const EXCERPT_STEP_S: f64 = 0.02;
const EXCERPTS: usize = 3;

/// Rows whose variable is about the same.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Mean of the variable.
    pub at: f64,
    /// Mean residual with all causes but this one \[N·m\].
    pub without: f64,
    /// Quartiles of the same.
    pub spread: [f64; 2],
    /// Mean residual with all causes \[N·m\].
    pub with: f64,
    /// Mean torque of the cause itself \[N·m\].
    pub cause: f64,
    /// How many rows.
    pub rows: usize,
}

/// One joint of the sealed run without and with a cause.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// The joint's name.
    pub joint: String,
    /// What it is drawn against.
    pub variable: Variable,
    /// Root mean square of the cause's torque on this joint \[N·m\].
    pub rms_nm: f64,
    /// From the smallest value of the variable to the largest.
    pub points: Vec<Point>,
}

/// A stretch of one joint's torque in the sealed run.
#[derive(Clone, Debug, PartialEq)]
pub struct Excerpt {
    /// The joint's name.
    pub joint: String,
    /// Time of the first point since the run began \[s\].
    pub from_s: f64,
    /// Time between points \[s\].
    pub step_s: f64,
    /// Measured \[N·m\].
    pub measured: Vec<f64>,
    /// Of the model as given \[N·m\].
    pub given: Vec<f64>,
    /// Of the model with all causes \[N·m\].
    pub with_causes: Vec<f64>,
    /// Where the direction of friction is in doubt, from and to \[s\]: at standstill and at reversals stiction holds what no model predicts.
    pub standstill_s: Vec<[f64; 2]>,
}

/// Torque of the bodies alone on every joint, of a run's rows.
pub(crate) fn load(run: &Prepared, nominal: &Nominal, values: &[f64]) -> Vec<Vec<f64>> {
    let mut load = vec![vec![0.0; run.rows()]; run.tau.len()];
    for ((parameter, column), x) in nominal.model.parameters.iter().zip(&run.standard).zip(values) {
        if !matches!(parameter, Parameter::Link { .. }) {
            continue;
        }
        for (to, values) in load.iter_mut().zip(column) {
            if let Some(values) = values {
                to.iter_mut().zip(values).for_each(|(t, v)| *t += x * v);
            }
        }
    }
    load
}

/// What a cause is to be shown with.
pub(crate) struct Shown<'a> {
    pub(crate) effect: Effect,
    pub(crate) joints: &'a [usize],
    /// Forms of the effects adopted; none for values of the model.
    pub(crate) forms: Vec<&'a Form>,
    /// Stage before it.
    pub(crate) stage: usize,
}

/// Curves of a cause on the joints that it changes most.
pub(crate) fn curves(
    run: &Prepared,
    stages: &Stages,
    load: &[Vec<f64>],
    names: &[String],
    shown: &Shown<'_>,
) -> Vec<Curve> {
    let full = &stages.models[stages.models.len() - 1];
    let (before, after) = (&stages.models[shown.stage], &stages.models[shown.stage + 1]);
    let cause = |j: usize| -> Vec<f64> { after[j].iter().zip(&before[j]).map(|(a, b)| a - b).collect() };
    let rms = |x: &[f64]| (x.iter().map(|v| v * v).sum::<f64>() / x.len().max(1) as f64).sqrt();
    // A cause on one joint may move its neighbours; it is shown where it is said to be.
    let candidates: Vec<usize> =
        if shown.joints.is_empty() { (0..names.len()).collect() } else { shown.joints.to_vec() };
    let mut sizes: Vec<(usize, f64, f64)> = candidates
        .into_iter()
        .map(|j| {
            let size = rms(&cause(j));
            (j, size, size / run.floor[j].max(1e-9))
        })
        .collect();
    sizes.sort_by(|a, b| b.2.total_cmp(&a.2));
    let most = sizes.first().map_or(0.0, |s| s.2);
    sizes.retain(|s| s.1 > 0.0 && s.2 >= POLICY.views.min_shown_share * most);
    sizes.truncate(POLICY.views.max_joints_shown);
    sizes
        .into_iter()
        .map(|(j, size, _)| {
            let cause_torque = cause(j);
            let variable = shown.effect.variable(run.run.temperature.is_some());
            let at = signal(variable, run, load, full, (j, &cause_torque), shown);
            let speed = run.chain.sample(&run.motion.qd[j]);
            let turned = |k: usize| if variable.along_motion() { speed[k].signum() } else { 1.0 };
            let rows: Vec<Row> = (0..at.len())
                .map(|k| {
                    let residual = (stages.tau[j][k] - full[j][k]) * turned(k);
                    let torque = cause_torque[k] * turned(k);
                    Row { at: at[k], without: residual + torque, with: residual, cause: torque }
                })
                .collect();
            let even_bins = matches!(variable, Variable::Phase | Variable::Time | Variable::WarmingTime);
            let points = if even_bins { even(rows) } else { crowded(rows) };
            Curve { joint: names[j].clone(), variable, rms_nm: size, points }
        })
        .collect()
}

struct Row {
    at: f64,
    without: f64,
    with: f64,
    cause: f64,
}

/// Bins of as many rows each.
fn crowded(mut rows: Vec<Row>) -> Vec<Point> {
    rows.retain(|r| r.at.is_finite());
    rows.sort_by(|a, b| a.at.total_cmp(&b.at));
    let size = rows.len().div_ceil(CURVE_POINTS).max(1);
    rows.chunks_mut(size).map(point).collect()
}

/// Bins of the same width each.
fn even(rows: Vec<Row>) -> Vec<Point> {
    let (low, high) = rows.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), r| (l.min(r.at), h.max(r.at)));
    let mut bins: Vec<Vec<Row>> = (0..CURVE_POINTS).map(|_| Vec::new()).collect();
    for row in rows {
        let place = (row.at - low) / (high - low).max(f64::MIN_POSITIVE) * CURVE_POINTS as f64;
        bins[(place as usize).min(CURVE_POINTS - 1)].push(row);
    }
    bins.iter_mut().filter(|b| !b.is_empty()).map(|b| point(b)).collect()
}

fn point(rows: &mut [Row]) -> Point {
    let n = rows.len().max(1) as f64;
    let mean = |f: &dyn Fn(&Row) -> f64| rows.iter().map(f).sum::<f64>() / n;
    let (at, without, with, cause) = (mean(&|r| r.at), mean(&|r| r.without), mean(&|r| r.with), mean(&|r| r.cause));
    rows.sort_by(|a, b| a.without.total_cmp(&b.without));
    let quarter = |share: f64| rows[((rows.len() - 1) as f64 * share).round() as usize].without;
    Point { at, without, spread: [quarter(0.25), quarter(0.75)], with, cause, rows: rows.len() }
}

fn signal(
    variable: Variable,
    run: &Prepared,
    load: &[Vec<f64>],
    full: &[Vec<f64>],
    (j, own): (usize, &[f64]),
    shown: &Shown<'_>,
) -> Vec<f64> {
    let motion = |of: &Vec<Vec<f64>>| run.chain.sample(&of[j]);
    match variable {
        Variable::Speed => motion(&run.motion.qd),
        Variable::SumOfSpeeds => {
            let mut sum = vec![0.0; run.rows()];
            for other in shown.joints {
                sum.iter_mut().zip(run.chain.sample(&run.motion.qd[*other])).for_each(|(s, v)| *s += v);
            }
            sum
        }
        Variable::TravelSinceReversal => run.chain.sample(&travel(&run.motion.q[j])),
        Variable::Load => load[j].iter().map(|t| t.abs()).collect(),
        Variable::SignedLoad => load[j].clone(),
        Variable::ModelTorque => full[j].clone(),
        Variable::TorqueRate => derivative(&full[j], run.chain.row_period_s),
        Variable::MeasuredTorque => run.tau[j].clone(),
        Variable::OwnTorque => own.to_vec(),
        Variable::Angle => motion(&run.motion.q),
        Variable::Phase => {
            let order = shown.forms.iter().find_map(|f| f.order()).unwrap_or(1.0);
            motion(&run.motion.q).iter().map(|q| (order * q).rem_euclid(TAU)).collect()
        }
        Variable::Acceleration => motion(&run.motion.qdd),
        Variable::Temperature => match &run.run.temperature {
            Some(temperature) => motion(temperature),
            None => vec![f64::NAN; run.rows()],
        },
        Variable::Time | Variable::WarmingTime => {
            (0..run.rows()).map(|k| run.chain.sample_of(k) as f64 * run.run.period_s).collect()
        }
    }
}

/// Way since the last change of direction.
fn travel(q: &[f64]) -> Vec<f64> {
    let mut turned_at = q.first().copied().unwrap_or(0.0);
    let mut direction = 0.0;
    q.iter()
        .enumerate()
        .map(|(k, now)| {
            let step = now - q[k.saturating_sub(1)];
            if step != 0.0 && step.signum() != direction {
                direction = step.signum();
                turned_at = *now - step;
            }
            (now - turned_at).abs()
        })
        .collect()
}

/// The stretches of the held-out run where the nominal model is furthest off: of the joint of `named` that it misses most in motion, of
/// the one that it misses most of all, and of the one that keeps most with all causes. `noise`: of the joints' torque \[N·m\].
pub(crate) fn excerpts(
    run: &Prepared,
    stages: &Stages,
    names: &[String],
    named: &[String],
    noise: &[f64],
) -> Vec<Excerpt> {
    let (given, full) = (&stages.models[0], &stages.models[stages.models.len() - 1]);
    let missed = |model: &[Vec<f64>], j: usize| {
        if run.silent[j].is_some() {
            return 0.0;
        }
        let moving = (0..run.rows()).filter(|row| run.doubt[j][*row] <= noise[j]);
        let (sum, count) = moving
            .fold((0.0, 0.0), |(sum, count), row| (sum + (stages.tau[j][row] - model[j][row]).powi(2), count + 1.0));
        sum / (f64::max(count, 1.0) * run.floor[j].powi(2)).max(f64::MIN_POSITIVE)
    };
    let by = |model: &[Vec<f64>]| {
        let mut joints: Vec<(f64, usize)> = (0..names.len()).map(|j| (missed(model, j), j)).collect();
        joints.sort_by(|a, b| b.0.total_cmp(&a.0));
        joints.into_iter().map(|(_, j)| j).collect::<Vec<_>>()
    };
    let first = by(given);
    let mut joints: Vec<usize> = first.iter().copied().find(|j| named.contains(&names[*j])).into_iter().collect();
    for j in [&first[..1], &by(full)[..1], &first[..]].concat() {
        if !joints.contains(&j) {
            joints.push(j);
        }
    }
    let rows = run.rows();
    let length = ((EXCERPT_S / run.chain.row_period_s).round() as usize).min(rows);
    let step = (EXCERPT_STEP_S / run.chain.row_period_s).round().max(1.0) as usize;
    joints
        .iter()
        .take(EXCERPTS)
        .filter(|_| length > 0)
        .map(|j| {
            // In motion: at standstill stiction holds what no model predicts.
            let moving = run.doubt[*j].iter().map(|doubt| f64::from(u8::from(*doubt <= noise[*j])));
            let squares = stages.tau[*j].iter().zip(&given[*j]).map(|(t, m)| (t - m).powi(2));
            let error: Vec<f64> = squares.zip(moving).map(|(square, moving)| square * moving).collect();
            let best = (0..=rows - length)
                .step_by(length.div_ceil(4))
                .max_by(|a, b| {
                    let window_error = |from: usize| error[from..from + length].iter().sum::<f64>();
                    window_error(*a).total_cmp(&window_error(*b))
                })
                .unwrap_or(0);
            let cut = |x: &[f64]| x[best..best + length].iter().step_by(step).copied().collect();
            let from_s = run.chain.sample_of(best) as f64 * run.run.period_s;
            let step_s = step as f64 * run.chain.row_period_s;
            let doubtful = run.doubt[*j][best..best + length].iter().step_by(step).map(|doubt| *doubt > noise[*j]);
            Excerpt {
                joint: names[*j].clone(),
                from_s,
                step_s,
                measured: cut(&stages.tau[*j]),
                given: cut(&given[*j]),
                with_causes: cut(&full[*j]),
                standstill_s: spans(doubtful, from_s, step_s),
            }
        })
        .collect()
}

/// Stretches of time in which `is` holds, of samples from `from_s` on.
fn spans(is: impl Iterator<Item = bool>, from_s: f64, step_s: f64) -> Vec<[f64; 2]> {
    let mut spans: Vec<[f64; 2]> = Vec::new();
    let mut before = false;
    for (k, now) in is.enumerate() {
        let [start, end] = [k, k + 1].map(|k| from_s + step_s * k as f64);
        match spans.last_mut() {
            Some(last) if now && before => last[1] = end,
            _ if now => spans.push([start, end]),
            _ => {}
        }
        before = now;
    }
    spans
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_are_of_neighbours_that_hold() {
        let is = [true, false, true, true, false, true];
        assert_eq!(spans(is.into_iter(), 1.0, 0.5), [[1.0, 1.5], [2.0, 3.0], [3.5, 4.0]]);
        assert!(spans([false].into_iter(), 0.0, 1.0).is_empty());
    }

    #[test]
    fn bins_hold_every_row_once_and_in_order() {
        let rows = |n: usize| -> Vec<Row> {
            let at = |k: usize| ((k * 37) % n) as f64;
            (0..n).map(|k| Row { at: at(k), without: 2.0 * at(k), with: 1.0, cause: 0.0 }).collect()
        };
        for points in [crowded(rows(101)), even(rows(101))] {
            assert_eq!(points.iter().map(|p| p.rows).sum::<usize>(), 101);
            assert!(points.windows(2).all(|w| w[0].at < w[1].at));
            // Of a straight line the bins' means lie on the line, between their quartiles.
            assert!(points.iter().all(|p| (p.without - 2.0 * p.at).abs() < 1e-12));
            assert!(points.iter().all(|p| p.spread[0] <= p.without && p.without <= p.spread[1]));
        }
    }

    #[test]
    fn travel_begins_anew_at_each_reversal() {
        assert_eq!(travel(&[0.0, 1.0, 3.0, 2.0, 2.0, 0.0, 0.5]), [0.0, 1.0, 3.0, 1.0, 1.0, 3.0, 0.5]);
    }
}
