//! Contact: a force at the flange in bursts, base axes times hats over time. Each burst is a stretch with columns of its own.

use std::ops::Range;

use nalgebra::DVector;
use rivet_dynamics::{Workspace, inverse_dynamics};

use crate::design::Prepared;
use crate::evidence::{Belief, CandidateSums};
use crate::form::Form;
use crate::local::Stretch;
use crate::physics::Physics;
use crate::rows::Column;
use crate::search::{Bursts, Candidate, Search};

/// Distance between the tops of two hats \[s\].
const HAT_S: f64 = 0.25;
/// Longer bursts are cut into parts \[s\]: the columns of one are solved for together.
const LONGEST_S: f64 = 10.0;
/// Prior standard deviation of a force: it may be this share of the torque of the joint that feels it most.
const FREE: f64 = 0.3;

impl Search<'_> {
    /// The candidate for contact in bursts. Its one column is nothing in the design: it stands for the torque of all
    /// stretches as they are solved for.
    pub(crate) fn contact(&self, windows: &Bursts, physics: &[Physics<'_>]) -> Option<Candidate> {
        let mut local = Vec::new();
        for (at, ((run, physics), own)) in self.runs.iter().zip(physics).zip(windows).enumerate() {
            local.extend(stretches(at, run, physics, own));
        }
        let joints = self.noise.len();
        let torque: Vec<f64> =
            (0..joints).map(|j| self.heard(j).flat_map(|r| &r.tau[j]).map(|t| t * t).sum()).collect();
        for stretch in &mut local {
            let std: Option<Vec<f64>> = stretch.columns.iter().map(|column| free(column, &torque)).collect();
            stretch.std = DVector::from_vec(std?);
            stretch.cells = self.design.stretch(stretch);
        }
        let nothing: Vec<Vec<Column>> = self.runs.iter().map(|_| vec![vec![None; joints]]).collect();
        (!local.is_empty()).then(|| Candidate {
            form: Form::Force { windows: windows.clone() },
            columns: nothing,
            cells: Vec::new(),
            belief: Belief { mean: DVector::repeat(1, 1.0), std: DVector::repeat(1, 1.0) },
            local,
            scores: None,
        })
    }

    /// Torque of a candidate's stretches with coefficients `c`, one behind the other, as one column's products.
    pub(crate) fn contact_sums(&self, candidate: &Candidate, c: &DVector<f64>) -> CandidateSums {
        let mut cd = nalgebra::DMatrix::zeros(1, self.design.background.len());
        let mut from = 0;
        for stretch in &candidate.local {
            let own = c.rows(from, stretch.std.len());
            from += stretch.std.len();
            for cell in &stretch.cells {
                cd.gemm_tr(self.weights[cell.joint], &own, &cell.cd, 1.0);
            }
        }
        cd.into()
    }
}

/// The same as of any free column, over the rows that there are.
fn free(column: &[Vec<f64>], torque: &[f64]) -> Option<f64> {
    let ratio = |(values, torque): (&Vec<f64>, &f64)| {
        let square: f64 = values.iter().map(|v| v * v).sum();
        if square > 0.0 { (torque / square).sqrt() } else { f64::INFINITY }
    };
    let least = column.iter().zip(torque).map(ratio).fold(f64::INFINITY, f64::min);
    least.is_finite().then_some(FREE * least)
}

/// Stretches of one run without beliefs and products. They share no row: where filters reach from one into the next they
/// end amid the two.
fn stretches(at: usize, run: &Prepared, physics: &Physics<'_>, windows: &[(f64, f64)]) -> Vec<Stretch> {
    let parts: Vec<(f64, f64)> = windows
        .iter()
        .flat_map(|(from, to)| {
            let count = ((to - from) / LONGEST_S).ceil().max(1.0);
            let end = move |k: usize| from + (to - from) * k as f64 / count;
            (0..count as usize).map(move |k| (end(k), end(k + 1)))
        })
        .collect();
    let sample = |t: f64| (t / physics.period_s()).round().max(0.0) as usize;
    let amid = |a: usize, b: usize| sample(0.5 * (parts[a].1 + parts[b].0));
    (0..parts.len())
        .filter_map(|k| {
            let first = if k > 0 { amid(k - 1, k) } else { 0 };
            let last = if k + 1 < parts.len() { amid(k, k + 1) } else { physics.samples() };
            let rows = run.chain.rows_of(first..last, physics.samples());
            stretch(at, run, physics, parts[k], &rows)
        })
        .collect()
}

/// The stretch of one part of a burst, as far as its torque reaches within `bounds` \[rows\].
fn stretch(
    at: usize,
    run: &Prepared,
    physics: &Physics<'_>,
    (from, to): (f64, f64),
    bounds: &Range<usize>,
) -> Option<Stretch> {
    let (n, samples, period) = (physics.joints(), physics.samples(), physics.period_s());
    let hats = ((to - from) / HAT_S).ceil().max(1.0);
    let width = (to - from) / hats;
    let sample = |t: f64| ((t / period).max(0.0) as usize).min(samples);
    let (within, felt) = run.chain.around(sample(from - width)..sample(to + width) + 1, samples);
    let rows = felt.start.max(bounds.start)..felt.end.min(bounds.end);
    if rows.is_empty() {
        return None;
    }
    let mut columns = Vec::new();
    let unit: Vec<Vec<Vec<f64>>> = (0..3).map(|axis| flange(physics, axis, &within)).collect();
    for hat in 0..=hats as usize {
        let top = from + width * hat as f64;
        let near = |k: usize| (1.0 - (k as f64 * period - top).abs() / width).max(0.0);
        for unit in &unit {
            let column = |j: usize| {
                let full: Vec<f64> = within.clone().zip(&unit[j]).map(|(k, tau)| near(k) * tau).collect();
                run.chain.part(&full, within.start, &rows)
            };
            columns.push((0..n).map(column).collect());
        }
    }
    Some(Stretch { run: at, rows, columns, std: DVector::zeros(0), cells: Vec::new() })
}

/// Torque of 1 N at the flange along a base axis, `[joint][sample within]`: a unit mass there, standing still, under a unit
/// acceleration is what the joints must hold.
fn flange(p: &Physics<'_>, axis: usize, within: &Range<usize>) -> Vec<Vec<f64>> {
    let n = p.joints();
    let mut arm = p.nominal.model.arm.clone();
    arm.gravity = [0.0; 3];
    arm.gravity[axis] = -1.0;
    let mut links = vec![[0.0; 10]; n];
    links[n - 1][0] = 1.0;
    let mut ws = Workspace::new(&arm);
    let still = vec![0.0; n];
    let (mut q, mut tau) = (vec![0.0; n], vec![0.0; n]);
    let mut signals = vec![Vec::with_capacity(within.len()); n];
    for k in within.clone() {
        q.iter_mut().zip(&p.motion.q).for_each(|(to, from)| *to = from[k]);
        inverse_dynamics(&arm, &links, &mut ws, &q, &still, &still, &mut tau);
        signals.iter_mut().zip(&tau).for_each(|(signal, tau)| signal.push(*tau));
    }
    signals
}
