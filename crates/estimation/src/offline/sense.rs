//! What the torque of each joint has in common with its motion and with the nominal model: a channel with the wrong sign, in
//! another unit or dead shows here, before its parameters are believed.

use rivet_dynamics::{BaseSet, Model, Parameter};

use super::fit::Fit;
use super::rows::{JointRows, Rows};
use crate::linear::dot;

/// A joint's torque beside its motion, over the rows of one log in which it moves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TorqueSense {
    /// Cosine of torque and speed; 0 where the model has no viscous friction to know the speed by.
    pub dissipates: f64,
    /// Cosine of torque and the nominal model's.
    pub alike: f64,
    /// Torque over the nominal model's, least squares.
    pub scale: f64,
    /// Standard deviation of the torque \[N·m\].
    pub varies: f64,
    /// Root mean square of what friction and rotor take by the nominal model \[N·m\].
    pub due: f64,
    /// Correlation of torque with the direction of motion.
    pub follows: f64,
}

/// Per joint of a log, all its pieces together, of base parameters `nominal`; none for a joint without rows. (A piece of one row does not
/// vary, and one of a few has any sign.)
pub fn torque_sense(model: &Model, base: &BaseSet, nominal: &[f64], pieces: &[&Rows]) -> Vec<Option<TorqueSense>> {
    let parameters: Vec<Parameter> = (0..base.len()).map(|i| base.parameter(model, i)).collect();
    let sense_of_joint = |j: usize| {
        if let [whole] = pieces {
            return (whole.count(j) > 0).then(|| sense(j, &whole.joints[j], &parameters, nominal));
        }
        let mut all = JointRows::default();
        for rows in pieces.iter().map(|piece| &piece.joints[j]) {
            all.columns.clone_from(&rows.columns);
            all.d.extend_from_slice(&rows.d);
            all.tau.extend_from_slice(&rows.tau);
        }
        (!all.tau.is_empty()).then(|| sense(j, &all, &parameters, nominal))
    };
    (0..model.arm.dof()).map(sense_of_joint).collect()
}

/// Joints that turn one way only in nearly all of their rows: what a constant torque does there, Coulomb friction does as well.
pub fn one_way(model: &Model, base: &BaseSet, rows: &[Rows]) -> Vec<bool> {
    let turns_one_way = |j: usize| {
        let coulomb = (0..base.len()).find(|i| base.parameter(model, *i) == Parameter::Coulomb(j));
        let mut turns = [0_usize; 2];
        for rows in rows.iter().map(|record| &record.joints[j]) {
            let Some(at) = rows.columns.iter().position(|c| Some(*c) == coulomb) else { continue };
            rows.d.iter().skip(at).step_by(rows.columns.len()).for_each(|sign| turns[usize::from(*sign > 0.0)] += 1);
        }
        let [back, forth] = turns.map(|count| count as f64);
        back + forth > 0.0 && back.min(forth) < ONE_WAY * (back + forth)
    };
    (0..model.arm.dof()).map(turns_one_way).collect()
}

/// Share of the rows the other way below which these are those of a joint that comes to rest.
const ONE_WAY: f64 = 0.03;

fn sense(j: usize, rows: &JointRows, parameters: &[Parameter], nominal: &[f64]) -> TorqueSense {
    let k = rows.columns.len();
    let column = |of: Parameter| -> Vec<f64> {
        let at = rows.columns.iter().position(|c| parameters[*c] == of);
        at.map_or_else(|| vec![0.0; rows.tau.len()], |at| rows.d.iter().skip(at).step_by(k).copied().collect())
    };
    let (tau, speed, direction) = (&rows.tau, column(Parameter::Viscous(j)), column(Parameter::Coulomb(j)));
    let count = tau.len() as f64;
    let cosine = |a: &[f64], b: &[f64]| dot(a, b) / (dot(a, a) * dot(b, b)).sqrt().max(f64::MIN_POSITIVE);
    let modelled = rows.torque(nominal);
    let drive: Vec<f64> = {
        let is_drive =
            |p: Parameter| [Parameter::RotorInertia(j), Parameter::Viscous(j), Parameter::Coulomb(j)].contains(&p);
        let drive_value = |i: usize| if is_drive(parameters[i]) { nominal[i].abs() } else { 0.0 };
        let drive_values: Vec<f64> = rows.columns.iter().map(|c| drive_value(*c)).collect();
        rows.d.chunks_exact(k.max(1)).map(|row| dot(row, &drive_values)).collect()
    };
    let centred = |x: &[f64]| -> Vec<f64> {
        let mean = x.iter().sum::<f64>() / count;
        x.iter().map(|x| x - mean).collect()
    };
    let (level, turns) = (centred(tau), centred(&direction));
    let varies = (dot(&level, &level) / count).sqrt();
    let stuck = varies <= 1e-9 * (dot(tau, tau) / count).sqrt();
    TorqueSense {
        dissipates: cosine(tau, &speed),
        alike: cosine(tau, &modelled),
        scale: dot(tau, &modelled) / dot(&modelled, &modelled).max(f64::MIN_POSITIVE),
        varies,
        due: (dot(&drive, &drive) / count).sqrt(),
        follows: if stuck { 0.0 } else { cosine(&level, &turns) },
    }
}

/// Joints on which friction as found gives energy over these rows, with its power over the torque's and speed's rms (negative)
/// and the standard deviation of that.
pub fn giving_friction(model: &Model, base: &BaseSet, fit: &Fit, rows: &[Rows]) -> Vec<(usize, f64, f64)> {
    let k = base.len();
    let place = |of: Parameter| (0..k).find(|i| base.parameter(model, *i) == of);
    let mut found = Vec::new();
    for j in 0..model.arm.dof() {
        let Some(viscous) = place(Parameter::Viscous(j)) else { continue };
        // Power of each base parameter of friction per unit: its column times speed.
        let mut power = vec![0.0; k];
        let (mut torque, mut speed) = (0.0, 0.0);
        for rows in rows.iter().map(|r| &r.joints[j]) {
            let Some(at) = rows.columns.iter().position(|c| *c == viscous) else { continue };
            for (row, tau) in rows.d.chunks_exact(rows.columns.len()).zip(&rows.tau) {
                for (c, d) in rows.columns.iter().zip(row) {
                    let parameter = base.parameter(model, *c);
                    if [Parameter::Viscous(j), Parameter::Coulomb(j), Parameter::ViscousQuadratic(j)]
                        .contains(&parameter)
                    {
                        power[*c] += d * row[at];
                    }
                }
                torque += tau * tau;
                speed += row[at] * row[at];
            }
        }
        let whole = (torque * speed).sqrt();
        if whole == 0.0 {
            continue;
        }
        for p in &mut power {
            *p /= whole;
        }
        let spread: f64 = power.iter().zip(fit.covariance.chunks_exact(k)).map(|(p, row)| p * dot(row, &power)).sum();
        let (value, std) = (dot(&power, &fit.values), spread.max(0.0).sqrt());
        if value < -SURELY * std {
            found.push((j, value, std));
        }
    }
    found
}

/// Dry friction as found over torque, joint by joint (root mean squares, at most 1; 1 for a joint without torque): how much of a
/// joint's torque is of a kind whose law near standstill is known least.
pub fn friction_share(model: &Model, base: &BaseSet, fit: &Fit, rows: &[Rows]) -> Vec<f64> {
    let share = |j: usize| {
        let dry = [Parameter::Coulomb(j), Parameter::CouplingCoulomb, Parameter::LoadFriction(j)];
        let (mut rubs, mut all) = (0.0, 0.0);
        for rows in rows.iter().map(|r| &r.joints[j]) {
            let dry_value = |c: &usize| if dry.contains(&base.parameter(model, *c)) { fit.values[*c] } else { 0.0 };
            let values: Vec<f64> = rows.columns.iter().map(dry_value).collect();
            if values.is_empty() {
                continue;
            }
            for (row, tau) in rows.d.chunks_exact(values.len()).zip(&rows.tau) {
                rubs += dot(row, &values).powi(2);
                all += tau * tau;
            }
        }
        if all > 0.0 { (rubs / all).sqrt().min(1.0) } else { 1.0 }
    };
    (0..model.arm.dof()).map(share).collect()
}

/// Friction gives energy surely from so many standard deviations below zero.
const SURELY: f64 = 3.0;
