//! Filtered rows of one record: regressor, instruments and torque, joint by joint.

use crate::dead_zone::slides;
use crate::linear::dot;
use rayon::prelude::*;
use rivet_dynamics::{BaseSet, Model, Parameter, Workspace};
use std::borrow::Cow;
use std::sync::Arc;

use super::lag::{Lag, believed, lag};
use super::pass::{Pair, filtered_rows};
use super::record::{OfflineError, Record, Trajectory, check};
use super::trust::beside_stop;
use super::zero_phase::ZeroPhase;

/// Where instruments come from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum InstrumentSource {
    /// The regressor on the commanded motion, each joint delayed by its tracking lag.
    Desired,
    /// The regressor on the motion that second encoders saw.
    SecondEncoder,
    /// The regressor as it was so long ago \[s\]: its noise has nothing to do with that of now.
    Delayed(f64),
}

/// How rows are made.
#[derive(Clone, Debug, PartialEq)]
pub struct OfflineSettings {
    /// Cut-off of the model filter, one pass of two \[Hz\].
    pub filter_hz: f64,
    /// Order of one pass, even.
    pub filter_order: usize,
    /// Time between rows after the filter \[s\].
    pub row_period_s: f64,
    /// A joint's rows are left out while its filtered speed is below this \[rad/s\].
    pub dead_zone: Vec<f64>,
    /// Where instruments come from.
    pub instrument: InstrumentSource,
}

/// Rows of one joint.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct JointRows {
    /// The base columns that have anything to do with the joint, ascending: about half of them.
    pub(super) columns: Vec<usize>,
    /// Regressor, row-major, one row of these columns each.
    pub(super) d: Vec<f64>,
    /// Instruments, likewise.
    pub(super) z: Vec<f64>,
    /// Torque \[N m\].
    pub(super) tau: Vec<f64>,
    /// Which instant each row belongs to, of the [`Rows::kept`] instants of the record.
    pub(super) place: Vec<usize>,
    /// Whether the filter mixes standstill of the joint into the row.
    pub(super) beside: Vec<bool>,
}

impl JointRows {
    /// Values of the joint's columns among all of them.
    fn joint_values(&self, x: &[f64]) -> Vec<f64> {
        self.columns.iter().map(|c| x[*c]).collect()
    }

    /// Torque of the base parameters `x`, row by row \[N m\].
    pub(super) fn torque(&self, x: &[f64]) -> Vec<f64> {
        let values = self.joint_values(x);
        if values.is_empty() {
            return vec![0.0; self.tau.len()];
        }
        self.d.chunks_exact(values.len()).map(|d| dot(d, &values)).collect()
    }

    /// Weight of row `row` if those beside a stop have `trust` and the others 1.
    pub(super) fn weight(&self, row: usize, trust: f64) -> f64 {
        if self.beside[row] { trust } else { 1.0 }
    }

    /// What the base parameters `x` leave of the torque \[N m\].
    pub(super) fn residual(&self, x: &[f64]) -> Vec<f64> {
        self.tau.iter().zip(self.torque(x)).map(|(tau, of)| tau - of).collect()
    }
}

/// Filtered torque of a record at its own rate, `[joint][sample]` \[N m\], and that rate's period \[s\].
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FilteredTorque {
    pub(super) joints: Vec<Vec<f64>>,
    pub(super) period_s: f64,
}

impl FilteredTorque {
    /// Torque of a joint at a time since the first sample \[s\], its rate and the rate of that: the parabola through the
    /// samples around it. None beyond either end.
    fn at(&self, joint: usize, time_s: f64) -> Option<[f64; 3]> {
        let tau = &self.joints[joint];
        let place = time_s / self.period_s;
        if tau.len() < 3 || place < 0.0 || place > (tau.len() - 1) as f64 {
            return None;
        }
        let near = (place.round() as usize).clamp(1, tau.len() - 2);
        let share = place - near as f64;
        let (slope, bend) = (0.5 * (tau[near + 1] - tau[near - 1]), tau[near + 1] - 2.0 * tau[near] + tau[near - 1]);
        let rate = (slope + share * bend) / self.period_s;
        Some([tau[near] + share * (slope + 0.5 * share * bend), rate, bend / self.period_s.powi(2)])
    }
}

/// What instruments are made of.
struct Instruments {
    /// Another motion; without one, the measured one so many samples before.
    motion: Option<Trajectory>,
    delay: usize,
    lags: Vec<Lag>,
}

impl Instruments {
    /// Of a record of an arm with `n` joints whose measured motion is sound.
    fn from_record(settings: &OfflineSettings, record: &Record, n: usize) -> Result<Instruments, OfflineError> {
        let rows = record.measured.len();
        match (settings.instrument, &record.desired) {
            (InstrumentSource::Desired, Some(desired)) => {
                desired.check(n, rows)?;
                let lag_of_joint = |j: usize| lag(&record.measured.qd[j], &desired.qd[j], record.period_s);
                let lags = believed(&(0..n).into_par_iter().map(lag_of_joint).collect::<Vec<_>>(), record.period_s);
                let samples: Vec<f64> = lags.iter().map(|lag| lag.seconds / record.period_s).collect();
                Ok(Instruments { motion: Some(delayed(desired, &samples)), delay: 0, lags })
            }
            (InstrumentSource::Desired, None) => {
                Err(OfflineError::Shape { what: "desired motion", found: 0, expected: rows })
            }
            (InstrumentSource::SecondEncoder, _) => {
                let second = record.second.as_ref().ok_or(OfflineError::Shape {
                    what: "motion by second encoders",
                    found: 0,
                    expected: rows,
                })?;
                second.check(n, rows)?;
                Ok(Instruments { motion: Some(second.clone()), delay: 0, lags: vec![Lag::NONE; n] })
            }
            (InstrumentSource::Delayed(seconds), _) => {
                let delay = (seconds / record.period_s).round().max(1.0) as usize;
                Ok(Instruments { motion: None, delay, lags: Vec::new() })
            }
        }
    }
}

/// Filtered rows of one record.
#[derive(Clone, Debug, PartialEq)]
pub struct Rows {
    pub(super) columns: usize,
    pub(super) joints: Vec<JointRows>,
    /// Instants that rows were taken at, of which a joint's dead zone leaves out some, and the time between them \[s\].
    pub(super) kept: usize,
    pub(super) row_period_s: f64,
    /// Rows that the model filter leaves independent of each other, each second.
    pub(super) independent_hz: f64,
    /// The torque of every sample, for the torque between rows.
    pub(super) torque: Arc<FilteredTorque>,
    /// What is known of each base parameter of an arm like this before any row.
    pub(super) most: Arc<[Range]>,
    /// The sample of the first of those instants.
    pub(super) first: usize,
    /// Share of the rows in motion that a joint's dead zone left out, per joint.
    pub left_out: Vec<f64>,
    /// Samples of the record between the first and the last motion of any joint.
    pub moving: std::ops::Range<usize>,
    /// Tracking lag of the instruments, per joint; empty for delayed instruments.
    pub lags: Vec<Lag>,
}

impl Rows {
    /// Filters a record into rows. Standstill before and after the motion is trimmed, as are the ends that the filter
    /// colours.
    pub fn new(
        model: &Model,
        base: &BaseSet,
        settings: &OfflineSettings,
        record: &Record,
    ) -> Result<Rows, OfflineError> {
        let n = model.arm.dof();
        let rows = record.measured.len();
        record.measured.check(n, rows)?;
        check("torque", &record.tau, n, rows)?;
        if settings.dead_zone.len() != n {
            return Err(OfflineError::Shape { what: "dead zone", found: settings.dead_zone.len(), expected: n });
        }
        let filter = ZeroPhase::new(settings.filter_hz, settings.filter_order, record.period_s);
        let torque = || filter.of_all(&without_effects(model, record));
        let speed = || filter.of_all(&record.measured.qd);
        let stops = || beside_stop(model, settings, record, &filter);
        // What stands still has no tracking lag either, so that is said first.
        let ((torque, stops), (speed, instruments)) = rayon::join(
            || rayon::join(torque, stops),
            || rayon::join(speed, || Instruments::from_record(settings, record, n)),
        );
        let moving = moving_range(&speed, &settings.dead_zone, filter.edge())
            .ok_or(OfflineError::NoMotion { rows, edge: filter.edge() })?;
        let Instruments { motion: instrument, delay, lags } = instruments?;
        let step = (settings.row_period_s / record.period_s).round().max(1.0) as usize;
        let kept: Vec<usize> = moving.clone().filter(|k| *k >= delay).step_by(step).collect();
        let mut result = Rows {
            columns: base.len(),
            joints: Vec::with_capacity(n),
            kept: kept.len(),
            row_period_s: step as f64 * record.period_s,
            independent_hz: 2.0 * settings.filter_hz,
            torque: Arc::new(FilteredTorque { joints: Vec::new(), period_s: record.period_s }),
            most: most(model, base),
            first: kept.first().copied().unwrap_or(0),
            left_out: Vec::with_capacity(n),
            moving,
            lags,
        };
        let slides = |j: usize, k: usize| slides(&model.structure, &settings.dead_zone, |j| speed[j][k], j);
        let mut places: Vec<Vec<usize>> =
            (0..n).map(|j| (0..kept.len()).filter(|at| slides(j, kept[*at])).collect()).collect();
        let used: Vec<Vec<usize>> = places.iter().map(|place| place.iter().map(|at| kept[*at]).collect()).collect();
        let motions = (&record.measured, instrument.as_ref());
        let pairs = filtered_rows(model, base, &filter, motions, delay, &used);
        for (j, (Pair { columns, d, z }, used)) in pairs.into_iter().zip(&used).enumerate() {
            let place = std::mem::take(&mut places[j]);
            result.left_out.push(1.0 - used.len() as f64 / kept.len().max(1) as f64);
            let tau = used.iter().map(|k| torque[j][*k]).collect();
            let beside_stop = used.iter().map(|k| stops[j][*k]).collect();
            result.joints.push(JointRows { columns, d, z, tau, place, beside: beside_stop });
        }
        result.torque = Arc::new(FilteredTorque { joints: torque, period_s: record.period_s });
        Ok(result)
    }

    /// Torque of joint `joint` so long \[s\] after one of the record's instants, its rate and the rate of that; none where the
    /// record has no such time.
    pub(super) fn torque_after(&self, joint: usize, place: usize, late_s: f64) -> Option<[f64; 3]> {
        let time = self.first as f64 * self.torque.period_s + place as f64 * self.row_period_s + late_s;
        self.torque.at(joint, time)
    }

    /// Stretch `part` (from 0) of `parts` of equal time, one after the other.
    #[must_use]
    pub fn part(&self, part: usize, parts: usize) -> Rows {
        let parts = parts.max(1);
        let (first, end) = (part * self.kept / parts, (part + 1) * self.kept / parts);
        let cut = |rows: &JointRows| {
            let k = rows.columns.len();
            let at = |place: usize| rows.place.partition_point(|p| *p < place);
            let (from, until) = (at(first), at(end));
            JointRows {
                columns: rows.columns.clone(),
                d: rows.d[from * k..until * k].to_vec(),
                z: rows.z[from * k..until * k].to_vec(),
                tau: rows.tau[from..until].to_vec(),
                place: rows.place[from..until].iter().map(|p| p - first).collect(),
                beside: rows.beside[from..until].to_vec(),
            }
        };
        let length = self.moving.len();
        Rows {
            joints: self.joints.iter().map(cut).collect(),
            kept: end - first,
            first: self.first + first * (self.row_period_s / self.torque.period_s).round() as usize,
            moving: self.moving.start + part * length / parts..self.moving.start + (part + 1) * length / parts,
            ..self.without_rows()
        }
    }

    /// Everything but the rows.
    fn without_rows(&self) -> Rows {
        Rows {
            joints: Vec::new(),
            left_out: self.left_out.clone(),
            lags: self.lags.clone(),
            moving: self.moving.clone(),
            torque: Arc::clone(&self.torque),
            most: Arc::clone(&self.most),
            ..*self
        }
    }

    /// Time from the first row to the last \[s\].
    pub(super) fn seconds(&self) -> f64 {
        self.kept as f64 * self.row_period_s
    }

    /// Time that the rows of joint `joint` (from 0) stand for \[s\].
    pub fn seconds_of(&self, joint: usize) -> f64 {
        self.count(joint) as f64 * self.row_period_s
    }

    /// Rows of joint `joint` (from 0) that the filter leaves independent of each other.
    pub(super) fn independent(&self, joint: usize) -> f64 {
        (self.count(joint) as f64).min(self.independent_hz * self.seconds_of(joint))
    }

    /// Number of rows of joint `joint` (from 0).
    pub fn count(&self, joint: usize) -> usize {
        self.joints.get(joint).map_or(0, |j| j.tau.len())
    }
}

/// What is known of a base parameter before any row, in its unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Range {
    /// What it is at most; infinite where nothing bounds it.
    pub(super) most: f64,
    /// Standard deviation of a nominal value that is a guess; 0 where it is known.
    pub(super) unknown: f64,
}

/// What a parameter of a body is at most: of one twenty times as heavy as the arm, as far away as it reaches. No body is, and a bound that is
/// tighter would tell what the rows do not, such as a delay.
fn most(model: &Model, base: &BaseSet) -> Arc<[Range]> {
    let mass = 20.0 * model.arm.links.iter().map(|link| link[0]).sum::<f64>();
    let length = |t: [f64; 3]| t.iter().map(|t| t * t).sum::<f64>().sqrt();
    let far = model.arm.joints.iter().map(|joint| length(joint.translation)).sum::<f64>();
    let known = mass > 0.0 && far > 0.0;
    let bound = |parameter: Parameter| match parameter {
        Parameter::Link { entry: 0, .. } if known => mass,
        Parameter::Link { entry: 1..=3, .. } if known => mass * far,
        Parameter::Link { .. } if known => mass * far * far,
        _ => f64::INFINITY,
    };
    // What was regrouped into it may have a large factor, as where two axes all but meet.
    let base_bound = |i: usize| {
        let more = base.regrouping(i).into_iter().map(|(k, factor)| (model.parameters[k], factor.abs()));
        let more = more.filter(|(_, factor)| *factor > 0.0).map(|(parameter, factor)| factor * bound(parameter));
        bound(base.parameter(model, i)) + more.sum::<f64>()
    };
    let unknown = base.std_from_standard(model.unknown_bodies());
    unknown.into_iter().enumerate().map(|(i, unknown)| Range { most: base_bound(i), unknown }).collect()
}

/// Measured torque less the effects of known size that the model has beside its parameters.
fn without_effects<'a>(model: &Model, record: &'a Record) -> Cow<'a, [Vec<f64>]> {
    if model.effects().is_empty() {
        return Cow::Borrowed(&record.tau);
    }
    let (n, mut ws) = (model.arm.dof(), Workspace::new(&model.arm));
    let (mut q, mut qd, mut qdd, mut at) = (vec![0.0; n], vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let mut torque = record.tau.clone();
    for row in 0..record.measured.len() {
        record.measured.state(row, &mut q, &mut qd, &mut qdd);
        at.iter_mut().zip(&torque).for_each(|(at, tau)| *at = tau[row]);
        model.take_effects(&mut ws, &q, &qd, &qdd, &mut at);
        torque.iter_mut().zip(&at).for_each(|(tau, at)| tau[row] = *at);
    }
    Cow::Owned(torque)
}

/// From the first to the last sample at which any joint moves: faster than its dead zone and than a hundredth of its own
/// top speed.
pub fn moving_range(speed: &[Vec<f64>], dead_zone: &[f64], edge: usize) -> Option<std::ops::Range<usize>> {
    let rows = speed.first()?.len();
    let least: Vec<f64> = speed
        .iter()
        .zip(dead_zone)
        .map(|(speed, dead)| dead.max(0.01 * speed.iter().fold(0.0_f64, |m, v| m.max(v.abs()))))
        .collect();
    let moves = |k: &usize| speed.iter().zip(&least).any(|(speed, least)| speed[*k].abs() > *least);
    let inner = edge..rows.saturating_sub(edge);
    let first = inner.clone().find(moves)?;
    let last = inner.rev().find(moves)?;
    (last > first).then_some(first..last + 1)
}

/// The motion, each joint later by its lag in samples (straight lines between samples; end values hold).
fn delayed(motion: &Trajectory, lags: &[f64]) -> Trajectory {
    let shift = |(x, lag): (&Vec<f64>, &f64)| -> Vec<f64> {
        let (Some(first), Some(last)) = (x.first(), x.last()) else { return Vec::new() };
        // Entry k lies `share` of the way from entry k + whole to the one after it.
        let (whole, share) = ((-lag).floor(), -lag - (-lag).floor());
        let at = |k: isize| usize::try_from(k).map_or(*first, |k| *x.get(k).unwrap_or(last));
        let between = |k: isize| at(k) + share * (at(k + 1) - at(k));
        (0..x.len()).map(|k| between(k.cast_signed() + whole as isize)).collect()
    };
    let shift = |signals: &[Vec<f64>]| signals.par_iter().zip(lags).map(shift).collect();
    Trajectory { q: shift(&motion.q), qd: shift(&motion.qd), qdd: shift(&motion.qdd) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn standstill_at_both_ends_is_trimmed() {
        let speed: Vec<f64> = (0..300).map(|k| if (100..200).contains(&k) { 1.0 } else { 0.0 }).collect();
        assert_eq!(moving_range(&[speed], &[0.01], 5), Some(100..200));
        assert_eq!(moving_range(&[vec![0.0; 300]], &[0.01], 5), None);
        assert_eq!(moving_range(&[vec![1.0; 300]], &[0.01], 5), Some(5..295));
    }
}
