//! How far rows beside a stop are believed.
//!
//! A joint that stands carries any torque up to breakaway, and the model filter spreads it over the rows before and after:
//! torque that no column of the regressor has. Where friction sticks, such rows pull the parameters, and more than any
//! standard deviation says; where it does not, or the law of friction has a travel, they are as good as others and may be all
//! that a slow log has. So they are neither left out nor taken for granted: they count by what the fit leaves of them.
//!
//! ```text
//! s_o² = Σ_o e² / n_o,  s_b² = Σ_b e² / n_b      residuals of the ordinary rows and of those beside a stop, joint by joint
//! t = s_o² / s_b²                               weight of a row beside a stop, that of an ordinary one being 1
//! d = √(2 / m_o + 2 / m_b)                      standard deviation of ln t by chance, with m independent rows of a kind
//! ```
//!
//! Where `ln t > -2 d`, chance explains the difference, and all rows count alike.
//!
//! The residuals are those of the fit in which all rows count alike. A law of friction that remembers its direction over some
//! travel knows what happens beside a stop: there all rows count.

use rayon::prelude::*;
use rivet_dynamics::Model;

use super::record::Record;
use super::rows::{JointRows, OfflineSettings};
use super::zero_phase::ZeroPhase;
use crate::dead_zone::slides;

/// A row is beside a stop if more than this share of what the filter mixes into it is of a joint that stands. With a share
/// of 0.03 three hundredths of the breakaway torque are in rows that count as ordinary, and of eight simulated arms that stick 83 % of
/// the values lie within two standard deviations, with this 92 %.
const STUCK: f64 = 0.003;
/// Speeds are smoothed up to this many times the cut-off of the model filter to see a joint stand: the model filter itself
/// hides a short stop.
const STOPS: f64 = 4.0;
/// Independent rows of either kind, per parameter of the joint, that the comparison needs: with fewer, the fit bends to the rows
/// of one kind, and how little it leaves there proves nothing against the other. (Kinova's joint 7 has 14 parameters and six such
/// rows beside stops: doubting those spoils the whole arm, 497 instead of 43 %.)
const INDEPENDENT_ROWS: f64 = 1.0;
/// Standard deviations of the logarithm of the ratio that chance may explain. Without this bound, rows of joints that do not
/// stick lose weight in every second log.
const CHANCE_DEVIATIONS: f64 = 2.0;

/// Whether the filter mixes standstill of a joint into a sample, `[joint][sample]`.
pub(super) fn beside_stop(
    model: &Model,
    settings: &OfflineSettings,
    record: &Record,
    filter: &ZeroPhase,
) -> Vec<Vec<bool>> {
    let (n, samples) = (model.arm.dof(), record.measured.len());
    if model.structure.presliding_travel > 0.0 {
        return vec![vec![false; samples]; n];
    }
    let light = ZeroPhase::new((STOPS * settings.filter_hz).min(0.2 / record.period_s), 2, record.period_s);
    let speed = light.of_all(&record.measured.qd);
    let stands = |j: usize, k: usize| !slides(&model.structure, &settings.dead_zone, |j| speed[j][k], j);
    let share = |j: usize| (0..samples).map(|k| f64::from(u8::from(stands(j, k)))).collect();
    let shares: Vec<Vec<f64>> = (0..n).into_par_iter().map(share).collect();
    // The filter rings: a little less than none is as much of a stop as a little more.
    let is_beside = |shares: &Vec<f64>| shares.iter().map(|share| share.abs() > STUCK).collect();
    filter.of_all(&shares).iter().map(is_beside).collect()
}

/// Weight of a joint's rows beside a stop, its ordinary rows having 1.
///
/// * `records`: the joint's rows in every record, and `residuals` of a fit in which all count alike
/// * `correlation`: rows that make one independent row
pub(super) fn trust<'a>(records: impl Iterator<Item = &'a JointRows>, residuals: &[Vec<f64>], correlation: f64) -> f64 {
    let (mut count, mut square, mut columns) = ([0.0_f64; 2], [0.0_f64; 2], 0);
    for (rows, residuals) in records.zip(residuals) {
        columns = rows.columns.len();
        for (e, beside) in residuals.iter().zip(&rows.beside) {
            count[usize::from(*beside)] += 1.0;
            square[usize::from(*beside)] += e * e;
        }
    }
    let [ordinary, beside] = count.map(|count| count / correlation);
    if ordinary.min(beside) < INDEPENDENT_ROWS * columns as f64 {
        return 1.0;
    }
    let chance = (2.0 / ordinary + 2.0 / beside).sqrt();
    let [ordinary, beside] = [0, 1].map(|k| square[k] / count[k]);
    // A perfect fit decides nothing.
    if ordinary > 0.0 && (beside / ordinary).ln() > CHANCE_DEVIATIONS * chance { ordinary / beside } else { 1.0 }
}
