//! Faults of a log's channels: torque sign, unit, limits and resolution, swapped columns, joints at rest, position noise.

use std::ops::Range;

use rivet_dynamics::{Model, Places};

use crate::model::log_fault::{LogFault, LogFinding};
use crate::model::nominal::Nominal;
use crate::model::run::Run;
use crate::model::standstill::{is_still, top_speed};
use crate::policy::POLICY;
use crate::screen::computed_torque;
use crate::screen::prepared::Prepared;
use crate::screen::signal_faults;
use crate::screen::swapped_torque;

/// Joints of a run whose torque was computed, not measured; none of a sound run.
pub(crate) fn computed(model: &Model, run: &Run) -> Vec<LogFinding> {
    let finding = |misses: &computed_torque::Misses| LogFinding {
        run: run.name.clone(),
        joint: model.arm.joints[misses.joint].name.clone(),
        fault: LogFault::Computed(misses.desired),
    };
    computed_torque::joints(&model.arm, run).iter().map(finding).collect()
}

/// Torque that cannot be believed counts nowhere.
pub(crate) fn distrust(run: &mut Prepared, nominal: &Nominal) {
    for (a, b) in swapped_torque::pairs(run, nominal) {
        run.silent[a] = Some(LogFault::Swapped(b));
        run.silent[b] = Some(LogFault::Swapped(a));
    }
    for finding in check(run, nominal).into_iter().filter(|f| f.fault.spoils()) {
        if let Some(j) = nominal.model.arm.joints.iter().position(|joint| joint.name == finding.joint) {
            run.silent[j] = Some(finding.fault);
        }
    }
}

/// Joints that stand throughout the sealed run count nowhere on it where friction alone may hold all of their torque: whatever is missed
/// there tells of no model. (Of a motion of one joint, which a diagnosis had asked for, the arm was told to miss 352 % of its torque with the
/// right spring, and that joint 3 %.)
pub(crate) fn leave_out_held(run: &mut Prepared, nominal: &Nominal) {
    let joints = run.tau.len();
    for j in (0..joints).filter(|j| is_still(&run.motion, *j)) {
        let rms = (dot(&run.tau[j], &run.tau[j]) / run.rows().max(1) as f64).sqrt();
        if run.silent[j].is_none() && rms < nominal.x[Places::new(joints).coulomb(j)].abs() {
            run.silent[j] = Some(LogFault::Still(top_speed(&run.motion, j)));
        }
    }
}

/// A channel that says nothing whenever its joint moves says nothing where it stands either.
pub(crate) fn silence_dead(runs: &mut [&mut Prepared], mute: &[Prepared]) {
    for j in 0..runs.first().map_or(0, |run| run.silent.len()) {
        let all = || runs.iter().map(|run| &**run).chain(mute);
        let fault = all().find_map(|run| run.silent[j]);
        if fault.is_some() && all().all(|run| run.silent[j].is_some() || is_still(&run.motion, j)) {
            for run in runs.iter_mut() {
                run.silent[j] = fault;
            }
        }
    }
}

/// Whether no joint that moves is left of which the torque can be believed.
pub(crate) fn is_unheard(runs: &[Prepared]) -> bool {
    !runs.iter().any(|run| (0..run.silent.len()).any(|j| run.silent[j].is_none() && !is_still(&run.motion, j)))
}

/// Faults of one run, joint by joint.
pub(crate) fn check(run: &Prepared, nominal: &Nominal) -> Vec<LogFinding> {
    let mut found = Vec::new();
    for (j, joint) in nominal.model.arm.joints.iter().enumerate() {
        let mut say = |fault| found.push(LogFinding { run: run.run.name.clone(), joint: joint.name.clone(), fault });
        if is_still(&run.motion, j) {
            say(LogFault::Still(top_speed(&run.motion, j)));
            continue;
        }
        let links = nominal.model.places().bodies().end;
        let (bodies, drive) = (of_values(run, nominal, j, 0..links), of_drive(run, nominal, j));
        // Torque of 1 kg at the flange.
        let at_flange = run.standard[Places::link(run.silent.len() - 1).start][j].as_deref();
        let modelled: Vec<f64> = bodies.iter().zip(&drive).map(|(b, d)| b + d).collect();
        let (tau, speed) = (&run.tau[j], run.chain.sample(&run.motion.qd[j]));
        let cosine = |a: &[f64], b: &[f64]| dot(a, b) / (dot(a, a) * dot(b, b)).sqrt().max(f64::MIN_POSITIVE);
        let dissipates = cosine(tau, &speed);
        let whole = dot(tau, &modelled) / dot(&modelled, &modelled).max(f64::MIN_POSITIVE);
        // Friction that is another than the file's is no other unit: what is beside it says so too, where it is felt.
        let friction_shapes = [speed.clone(), speed.iter().map(|v| v.signum()).collect()];
        let (own, due) = (apart(tau, &friction_shapes), apart(&modelled, &friction_shapes));
        let rest = dot(&own, &due) / dot(&due, &due).max(f64::MIN_POSITIVE);
        let felt = dot(&due, &due) > POLICY.screening.min_body_torque_share * dot(&modelled, &modelled);
        let places = nominal.model.places();
        let unknown = [places.viscous(j), places.coulomb(j)].iter().all(|at| nominal.x[*at] == 0.0);
        let least = if !felt {
            POLICY.screening.min_unit_ratio_of_friction
        } else if unknown {
            POLICY.screening.min_unit_ratio_without_friction
        } else {
            POLICY.screening.min_unit_ratio
        };
        let off = |scale: f64| !(1.0 / least..least).contains(&scale);
        let scale = if felt && unknown { rest } else { whole };
        let unit = off(scale) && (!felt || off(rest)) && !is_load(tau, &bodies, at_flange, &drive);
        let scale = if unit { scale } else { 1.0 };
        let turned = run.silent[j].filter(LogFault::is_of_the_whole);
        let joint_fault = turned
            .or_else(|| LogFault::of_torque(dissipates, cosine(tau, &modelled), scale))
            .or_else(|| factor(tau, &bodies, at_flange, &drive).map(LogFault::Scale));
        if let Some(fault) = joint_fault.or(run.silent[j]) {
            say(fault);
        }
        if run.blur[j] > POLICY.screening.min_speed_blur_rad_s {
            say(LogFault::Steps { position: run.position_noise[j], speed: run.blur[j] });
        }
        let step = signal_faults::resolution(&run.run.tau[j]);
        let rms = (dot(tau, tau) / tau.len().max(1) as f64).sqrt();
        if step > POLICY.screening.min_torque_step_share * rms {
            say(LogFault::Coarse(step));
        }
        // In coarse steps every turn stands for a while.
        if let Some(limit) =
            limit(&run.run.tau[j], step).filter(|limit| step < POLICY.screening.min_torque_step_share * limit)
        {
            say(LogFault::Limit(limit));
        }
    }
    found
}

/// Rows of joint `j`'s torque by the file's bodies, drive and known effects.
pub(crate) fn of_file(run: &Prepared, nominal: &Nominal, j: usize) -> Vec<f64> {
    let bodies = of_values(run, nominal, j, nominal.model.places().bodies());
    bodies.iter().zip(of_drive(run, nominal, j)).map(|(body, drive)| body + drive).collect()
}

fn of_drive(run: &Prepared, nominal: &Nominal, j: usize) -> Vec<f64> {
    let mut torque = of_values(run, nominal, j, nominal.model.places().bodies().end..nominal.x.len());
    if let Some(known) = run.known_rows.get(j) {
        torque.iter_mut().zip(known).for_each(|(t, k)| *t += k);
    }
    torque
}

fn of_values(run: &Prepared, nominal: &Nominal, j: usize, parameters: Range<usize>) -> Vec<f64> {
    let mut torque = vec![0.0; run.rows()];
    for (x, column) in nominal.x[parameters.clone()].iter().zip(&run.standard[parameters]) {
        if let Some(values) = &column[j] {
            torque.iter_mut().zip(values).for_each(|(t, v)| *t += v * x);
        }
    }
    torque
}

/// What is left of a signal where multiples of others are taken from it, one after the other.
fn apart(signal: &[f64], others: &[Vec<f64>]) -> Vec<f64> {
    let mut remainder = signal.to_vec();
    let mut straight: Vec<Vec<f64>> = Vec::new();
    for other in others {
        let mut other = other.clone();
        for before in &straight {
            take(&mut other, before);
        }
        take(&mut remainder, &other);
        straight.push(other);
    }
    remainder
}

/// Takes the part along `direction` from `signal`.
fn take(signal: &mut [f64], direction: &[f64]) {
    let along = dot(signal, direction) / dot(direction, direction).max(f64::MIN_POSITIVE);
    signal.iter_mut().zip(direction).for_each(|(s, d)| *s -= along * d);
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The factor by which a torque is off if it is by about two. A load makes bodies heavier, wear or cold makes friction larger. Both
/// together look like a factor where all of the joint's bodies turn about its axis as a load at the flange does. There they are the
/// more probable cause, and no factor is returned.
fn factor(tau: &[f64], bodies: &[f64], at_flange: Option<&[f64]>, drive: &[f64]) -> Option<f64> {
    let [bb, bd, dd] = [dot(bodies, bodies), dot(bodies, drive), dot(drive, drive)];
    let (bt, dt, tt) = (dot(bodies, tau), dot(drive, tau), dot(tau, tau));
    let determinant = bb * dd - bd * bd;
    let [body, own] = [(dd * bt - bd * dt) / determinant, (bb * dt - bd * bt) / determinant];
    let factor = (bt + dt) / (bb + 2.0 * bd + dd);
    let felt = |part: f64, square: f64| part.powi(2) * square > POLICY.screening.min_part_share.powi(2) * tt;
    let shape = (bt + dt) / ((bb + 2.0 * bd + dd) * tt).sqrt();
    let same = |part: f64| (part / factor - 1.0).abs() < POLICY.screening.max_factor_difference;
    let off = !(1.0 / POLICY.screening.min_common_factor..POLICY.screening.min_common_factor).contains(&factor);
    let fits_better = || {
        let whole: Vec<f64> = bodies.iter().zip(drive).map(|(body, drive)| body + drive).collect();
        let unit = apart(tau, &[whole]);
        let without_bodies: Vec<f64> = tau.iter().zip(bodies).map(|(tau, body)| tau - body).collect();
        let others: Vec<Vec<f64>> = at_flange.into_iter().chain([drive]).map(<[f64]>::to_vec).collect();
        let load = apart(&without_bodies, &others);
        dot(&unit, &unit) < POLICY.screening.max_load_residual_share * dot(&load, &load)
    };
    (off && shape > POLICY.screening.min_whole_correlation
        && same(body)
        && same(own)
        && felt(body, bb)
        && felt(own, dd)
        && fits_better())
    .then_some(factor)
}

/// Whether heavier bodies, those of the file and one at the flange, explain a torque better beside the drive as it is than another unit of
/// both.
fn is_load(tau: &[f64], bodies: &[f64], at_flange: Option<&[f64]>, drive: &[f64]) -> bool {
    let whole: Vec<f64> = bodies.iter().zip(drive).map(|(body, drive)| body + drive).collect();
    let less: Vec<f64> = tau.iter().zip(drive).map(|(tau, drive)| tau - drive).collect();
    let heavier: Vec<Vec<f64>> = [Some(bodies), at_flange].into_iter().flatten().map(<[f64]>::to_vec).collect();
    let load = apart(&less, &heavier);
    let unit = apart(tau, &[whole]);
    dot(&load, &load) < POLICY.screening.max_load_residual_share * dot(&unit, &unit)
}

/// The largest torque of a signal in steps of `step` (0 without), if it is held for stretches.
fn limit(signal: &[f64], step: f64) -> Option<f64> {
    let top = signal.iter().fold(0.0_f64, |m, t| m.max(t.abs()));
    let plateaus = signal
        .chunk_by(|a, b| a == b)
        .filter(|c| c.len() >= POLICY.signal_faults.min_flat_samples && c[0].abs() >= top * (1.0 - 1e-9));
    let flat: usize = plateaus.map(<[f64]>::len).sum();
    // A quiet torque stands on the step below where it turns as well.
    let below = (top - 1.5 * step)..(top - 0.5 * step);
    let passing = signal.iter().filter(|t| below.contains(&t.abs())).count();
    let enough = (POLICY.signal_faults.min_flat_share * signal.len() as f64)
        .max(POLICY.signal_faults.min_flat_ratio * passing as f64);
    (top > 0.0 && flat as f64 > enough).then_some(top)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gravity and friction of a joint that swings; noise of a twentieth.
    #[test]
    fn a_gain_of_two_is_one_where_bodies_and_drive_have_it() {
        let at = |f: &dyn Fn(f64) -> f64| (0..4000).map(|k| f(0.01 * f64::from(k))).collect::<Vec<f64>>();
        let (bodies, drive) = (at(&|t| 8.0 * t.sin()), at(&|t| 4.0 * t.cos() + 2.0 * t.cos().signum()));
        let turned = at(&|t| 3.0 * (t + 0.5).sin() + (2.0 * t).cos());
        let torque = |b: f64, d: f64| -> Vec<f64> {
            let noise = at(&|t| 0.4 * (57.0 * t).sin());
            bodies.iter().zip(&drive).zip(&noise).map(|((x, y), n)| b * x + d * y + n).collect()
        };
        let found = |b: f64, d: f64| factor(&torque(b, d), &bodies, Some(&turned), &drive);
        let alike = |b: f64, d: f64| factor(&torque(b, d), &bodies, Some(&bodies), &drive);
        assert!(found(2.0, 2.0).is_some_and(|f| (f - 2.0).abs() < 0.02) && found(0.5, 0.5).is_some());
        assert_eq!(found(1.0, 1.0), None);
        assert_eq!(found(1.5, 1.5), None, "a torque constant may be as wrong");
        assert_eq!(found(2.0, 1.0), None, "a load");
        assert_eq!(found(1.0, 2.5), None, "friction of a cold joint");
        assert_eq!(found(2.2, 1.8), None, "wrong values");
        assert_eq!(alike(2.0, 2.0), None, "a load and other friction of a wrist are as near");
    }

    #[test]
    fn a_torque_that_is_held_at_its_top_is_a_limit_and_a_standstill_is_not() {
        let wave: Vec<f64> = (0..1000).map(|k| (0.02 * f64::from(k)).sin()).collect();
        assert_eq!(limit(&wave, 0.0), None);
        let cut: Vec<f64> = wave.iter().map(|t| t.clamp(-0.8, 0.8)).collect();
        assert_eq!(limit(&cut, 0.0), Some(0.8));
        let rest: Vec<f64> = wave.iter().map(|t| t.clamp(-0.1, 0.1) + if *t > 0.999 { 0.5 } else { 0.0 }).collect();
        assert_eq!(limit(&rest, 0.0), None, "a stretch below the top is no limit");
        let rounded = |signal: &[f64]| -> Vec<f64> { signal.iter().map(|t| (t / 0.03).round() * 0.03).collect() };
        assert!(limit(&rounded(&wave), 0.0).is_some(), "without its steps it would be one");
        assert_eq!(limit(&rounded(&wave), 0.03), None, "it turns on its last step");
        let cut = rounded(&cut);
        assert!(limit(&cut, 0.03).is_some_and(|t| (t - 0.81).abs() < 1e-9), "{:?}", limit(&cut, 0.03));
    }
}
