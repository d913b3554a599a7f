//! Repeatability: the scatter of torque where the logs contain the same motion twice.

use rivet_dynamics::Places;
use std::ops::Range;

use nalgebra::{Cholesky, DMatrix, DVector};

use crate::policy::POLICY;
use crate::report::diagnosis::Scatter;
use crate::screen::prepared::Prepared;

/// Length of the stretches that are looked for again \[s\].
const REPEATED_STRETCH_S: f64 = 3.0;
/// Steps in which the other run is searched, and places of a stretch that are compared first \[rows\].
const COARSE_SEARCH_ROWS: usize = 5;
const PLACES: usize = 8;

/// Rows of one run that come again, and where: rows of the other, as far as they are between two.
struct Again {
    rows: Range<usize>,
    later: f64,
}

/// A run as it is compared.
struct Rows<'a> {
    run: &'a Prepared,
    q: Vec<Vec<f64>>,
    qd: Vec<Vec<f64>>,
    qdd: Vec<Vec<f64>>,
}

impl<'a> Rows<'a> {
    fn from_run(run: &'a Prepared) -> Rows<'a> {
        let rows = |signals: &Vec<Vec<f64>>| signals.iter().map(|s| run.chain.sample(s)).collect();
        Rows { run, q: rows(&run.motion.q), qd: rows(&run.motion.qd), qdd: rows(&run.motion.qdd) }
    }

    fn len(&self) -> usize {
        self.run.rows()
    }
}

/// Each joint's scatter over all motion that runs have in common or repeat; none where that is too little.
pub(crate) fn scatter(runs: &[&Prepared]) -> Vec<Option<Scatter>> {
    let all: Vec<Rows<'_>> = runs.iter().map(|run| Rows::from_run(run)).collect();
    let joints = runs.first().map_or(0, |run| run.silent.len());
    // Sum of squares, rows.
    let mut sums = vec![(0.0, 0.0); joints];
    let Some(period) = runs.first().map(|run| run.chain.row_period_s) else { return Vec::new() };
    for (a, one) in all.iter().enumerate() {
        for (b, other) in all.iter().enumerate().skip(a) {
            if (other.run.chain.row_period_s / period - 1.0).abs() > 0.01 {
                continue;
            }
            let again = pairs(one, other, a == b);
            for (j, sum) in sums.iter_mut().enumerate() {
                if let Some((square, rows)) = differs(one, other, &again, j, a != b) {
                    *sum = (sum.0 + square, sum.1 + rows);
                }
            }
        }
    }
    let scatter = |(square, rows): (f64, f64)| {
        let seconds = rows * period;
        // Both runs have it.
        (seconds >= POLICY.signal_faults.min_repeated_s).then(|| Scatter {
            torque: (0.5 * square / rows).sqrt(),
            seconds,
            decides: false,
        })
    };
    sums.into_iter().map(scatter).collect()
}

/// Stretches of `one` that are in `other`; of one run what comes later.
fn pairs(one: &Rows<'_>, other: &Rows<'_>, same: bool) -> Vec<Again> {
    let length = (REPEATED_STRETCH_S / one.run.chain.row_period_s) as usize;
    let mut found = Vec::new();
    let mut from = 0;
    while from + length < one.len() {
        let rows = from..from + length;
        from += length;
        let span = |q: &Vec<f64>| {
            let (low, high) = q[rows.clone()].iter().fold((f64::MAX, f64::MIN), |(l, h), q| (l.min(*q), h.max(*q)));
            high - low
        };
        let spans: Vec<f64> = one.q.iter().map(span).collect();
        if spans.iter().all(|span| *span < POLICY.signal_faults.min_repeated_span_rad) {
            continue;
        }
        let first = if same { rows.end } else { 0 };
        let mut best: Option<(f64, f64)> = None;
        let last = other.len().saturating_sub(length + 1);
        let mut at = first;
        while at < last {
            if near(one, other, rows.start, at, length) {
                // Rows around it.
                let around: Vec<usize> = (at.saturating_sub(COARSE_SEARCH_ROWS).max(first)
                    ..(at + COARSE_SEARCH_ROWS + 1).min(last))
                    .collect();
                let costs: Vec<f64> = around.iter().map(|at| cost(one, other, &rows, *at)).collect();
                let least = (0..costs.len()).min_by(|a, b| costs[*a].total_cmp(&costs[*b])).unwrap_or(0);
                let part = match (least.checked_sub(1).map(|k| costs[k]), costs.get(least + 1)) {
                    (Some(before), Some(after)) if before + after > 2.0 * costs[least] => {
                        0.5 * (before - after) / (before - 2.0 * costs[least] + after)
                    }
                    _ => 0.0,
                };
                let place = around[least] as f64 + part;
                if best.is_none_or(|(cost, _)| costs[least] < cost) {
                    best = Some((costs[least], place));
                }
            }
            at += COARSE_SEARCH_ROWS;
        }
        let Some((_, place)) = best else { continue };
        let alike = (0..spans.len()).all(|j| {
            let square: f64 = rows
                .clone()
                .map(|k| (one.q[j][k] - between(&other.q[j], place + (k - rows.start) as f64)).powi(2))
                .sum();
            (square / length as f64).sqrt()
                < POLICY.signal_faults.max_repeat_rms_rad + POLICY.signal_faults.max_repeat_rms_share * spans[j]
        });
        if alike {
            found.push(Again { later: place - rows.start as f64, rows });
        }
    }
    found
}

fn near(one: &Rows<'_>, other: &Rows<'_>, from: usize, at: usize, length: usize) -> bool {
    let step = COARSE_SEARCH_ROWS as f64 * one.run.chain.row_period_s;
    (0..=PLACES).all(|p| {
        let k = p * length / PLACES;
        (0..one.q.len()).all(|j| {
            (one.q[j][from + k] - other.q[j][at + k]).abs()
                < POLICY.signal_faults.max_repeat_distance_rad + step * one.qd[j][from + k].abs()
        })
    })
}

fn cost(one: &Rows<'_>, other: &Rows<'_>, rows: &Range<usize>, at: usize) -> f64 {
    let each = rows.clone().step_by(COARSE_SEARCH_ROWS);
    each.map(|k| (0..one.q.len()).map(|j| (one.q[j][k] - other.q[j][at + k - rows.start]).powi(2)).sum::<f64>()).sum()
}

/// Sum of squares of what joint `j`'s torque differs by, and rows, what small differences of the motion and of time make taken out.
/// `load`: a body at the flange as well, that one of two runs may have.
fn differs(one: &Rows<'_>, other: &Rows<'_>, again: &[Again], j: usize, load: bool) -> Option<(f64, f64)> {
    if one.run.silent[j].is_some() || other.run.silent[j].is_some() {
        return None;
    }
    let places: Vec<(usize, f64)> = again
        .iter()
        .flat_map(|a| a.rows.clone().map(|k| (k, k as f64 + a.later)))
        .filter(|(k, _)| one.qd[j][*k].abs() > POLICY.signal_faults.min_repeated_speed_rad_s)
        .collect();
    let tau = &other.run.tau[j];
    let sampled = |of: &dyn Fn(usize, f64) -> f64| places.iter().map(|(k, at)| of(*k, *at)).collect::<Vec<f64>>();
    let difference = sampled(&|k, at| one.run.tau[j][k] - between(tau, at));
    let mut columns = vec![sampled(&|_, at| 0.5 * (between(tau, at + 1.0) - between(tau, at - 1.0)))];
    for (a, b) in [(&one.q, &other.q), (&one.qd, &other.qd), (&one.qdd, &other.qdd)] {
        columns.push(sampled(&|k, at| a[j][k] - between(&b[j], at)));
    }
    if load {
        let last = Places::link(one.q.len() - 1).start;
        let body = one.run.standard[last..last + 10].iter().filter_map(|column| column[j].as_ref());
        columns.extend(body.map(|column| sampled(&|k, _| column[k])));
    }
    columns.retain(|column| column.iter().any(|v| *v != 0.0));
    let (rows, count) = (difference.len(), columns.len());
    if rows < 10 * count.max(1) {
        return None;
    }
    let sizes: Vec<f64> = columns.iter().map(|c| c.iter().map(|v| v * v).sum::<f64>().sqrt()).collect();
    let d = DMatrix::from_fn(rows, count, |r, c| columns[c][r] / sizes[c]);
    let y = DVector::from_vec(difference);
    let mut gram = d.tr_mul(&d);
    (0..count).for_each(|k| gram[(k, k)] += 1e-9);
    let residual = &y - &d * Cholesky::new(gram)?.solve(&d.tr_mul(&y));
    let free = rows as f64 / (rows - count) as f64;
    Some((free * usual(again, &places, residual.as_slice()) * rows as f64, rows as f64))
}

/// Mean square over the half of the stretches that differ least. What changed on the way, a load or wear, is in all pairs of a stretch
/// before it and one after, and no noise.
fn usual(again: &[Again], places: &[(usize, f64)], left: &[f64]) -> f64 {
    let part = |a: &Again| {
        let stretch_residuals = places.iter().zip(left).filter(|((k, _), _)| a.rows.contains(k));
        stretch_residuals.fold((0.0, 0.0), |(square, rows), (_, e)| (square + e * e, rows + 1.0))
    };
    let mut parts: Vec<(f64, f64)> = again.iter().map(part).filter(|(_, rows)| *rows > 0.0).collect();
    parts.sort_by(|a, b| (a.0 / a.1).total_cmp(&(b.0 / b.1)));
    parts.truncate(parts.len().div_ceil(2));
    let (square, rows) = parts.into_iter().fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
    square / f64::max(rows, 1.0)
}

/// Value between rows, by the four around; the ends hold.
fn between(x: &[f64], place: f64) -> f64 {
    let (whole, t) = (place.floor(), place - place.floor());
    let last = x.len().saturating_sub(1) as f64;
    let at = |k: f64| x[(whole + k).clamp(0.0, last) as usize];
    let [a, b, c, d] = [-1.0, 0.0, 1.0, 2.0].map(at);
    let taps = [
        -t * (t - 1.0) * (t - 2.0) / 6.0,
        (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0,
        -(t + 1.0) * t * (t - 2.0) / 2.0,
        (t + 1.0) * t * (t - 1.0) / 6.0,
    ];
    a * taps[0] + b * taps[1] + c * taps[2] + d * taps[3]
}
