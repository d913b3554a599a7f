//! Torque later than the motion: shifted back, or its channel marked untrusted.

use super::{JointTiming, Timing};
use crate::model::listener::Listener;
use crate::model::log_fault::{LogFault, LogFinding};
use crate::model::nominal::Nominal;
use crate::policy::POLICY;
use crate::screen::prepared::Prepared;

/// What is to be done with the torque of one run.
#[derive(Clone, PartialEq)]
enum Remedy {
    None,
    /// Each joint's is taken so much later \[s\].
    Move(Vec<f64>),
    /// All of it went through a low-pass of this time constant \[s\]: it is not to be believed.
    Filter(f64),
}

/// Moves torque that surely comes after the motion, and says so; torque that a slow filter went over is not believed.
pub(crate) fn align(runs: &mut [&mut Prepared], nominal: &Nominal, listener: &mut dyn Listener) -> Vec<LogFinding> {
    let timings: Vec<Option<Timing>> = runs.iter().map(|run| Timing::from_run(run)).collect();
    for (run, timing) in runs.iter().zip(&timings) {
        let Some(timing) = timing else { continue };
        let [late, sigma] = [timing.late, timing.sigma].map(|s| 1e3 * s);
        listener
            .line(&format!("{}: torque {late:.2} ms after position, standard deviation {sigma:.2} ms", run.run.name));
    }
    let remedies = remedies(runs, &timings, nominal.model.arm.dof());
    let mut found = Vec::new();
    for (run, remedy) in runs.iter_mut().zip(remedies) {
        match remedy {
            Remedy::None => {}
            Remedy::Filter(seconds) => {
                run.silent.iter_mut().for_each(|silent| *silent = silent.or(Some(LogFault::Filtered(seconds))));
            }
            Remedy::Move(late) => {
                let is_moved = |j: &usize| late[*j] > 0.0 && run.silent[*j].is_none();
                found.extend((0..late.len()).filter(is_moved).map(|j| LogFinding {
                    run: run.run.name.clone(),
                    joint: nominal.model.arm.joints[j].name.clone(),
                    fault: LogFault::Late(late[j]),
                }));
                // What is left of a sample is free in every fit.
                let samples = late.iter().map(|s| (s / run.run.period_s).round() as isize);
                **run = run.later(&samples.collect::<Vec<_>>(), nominal);
            }
        }
    }
    found
}

fn remedies(runs: &[&mut Prepared], timings: &[Option<Timing>], joints: usize) -> Vec<Remedy> {
    let least = |run: &Prepared| POLICY.timing.min_delay_s.max(POLICY.timing.free_samples * run.run.period_s);
    let run_remedy = |(run, timing): (&&mut Prepared, &Option<Timing>)| match timing {
        Some(timing) if timing.is_sure(least(run)) => {
            timing.filter().map_or_else(|| Remedy::Move(vec![timing.late; joints]), Remedy::Filter)
        }
        _ => Remedy::None,
    };
    let mut remedies: Vec<Remedy> = runs.iter().zip(timings).map(run_remedy).collect();
    // Several runs of one arm are logged alike: what cannot tell by itself, and is not against it, follows the first that can.
    if let Some(first) = remedies.iter().position(|r| *r != Remedy::None) {
        let (usual, late) = (remedies[first].clone(), timings[first].as_ref().map_or(0.0, |t| t.late));
        for (remedy, timing) in remedies.iter_mut().zip(timings).filter(|(r, _)| **r == Remedy::None) {
            if timing.as_ref().is_none_or(|t| t.prefers(late)) {
                *remedy = usual.clone();
            }
        }
        return remedies;
    }
    let alone: Vec<f64> = (0..joints).map(|j| alone(runs, timings, j, least).unwrap_or(0.0)).collect();
    if alone.iter().all(|late| *late == 0.0) { remedies } else { vec![Remedy::Move(alone); runs.len()] }
}

/// By how much the channel of joint `j` is late by itself \[s\], where a run is sure of it and none is against it.
fn alone<'a>(
    runs: &[&mut Prepared],
    timings: &'a [Option<Timing>],
    j: usize,
    least: impl Fn(&Prepared) -> f64,
) -> Option<f64> {
    let joint_timing = |timing: &'a Option<Timing>| timing.as_ref()?.joints.iter().find(|t| t.joint == j);
    let timed: Vec<(&Prepared, &JointTiming)> =
        runs.iter().zip(timings).filter_map(|(run, timing)| Some((&**run, joint_timing(timing)?))).collect();
    let is_sure = |(run, t): &&(&Prepared, &JointTiming)| {
        t.late - POLICY.timing.min_sigmas * t.sigma > least(run)
            && t.gain(t.late) > POLICY.timing.min_joint_evidence
            && t.share(t.late) > POLICY.timing.min_single_share
            && t.rms < POLICY.timing.max_single_floor_ratio * run.floor[j]
    };
    let sure: Vec<f64> = timed.iter().filter(is_sure).map(|(_, t)| t.late).collect();
    let late = sure.iter().sum::<f64>() / sure.len() as f64;
    let against = |t: &JointTiming| t.gain(late) < -POLICY.timing.min_joint_evidence;
    let alike = !sure.is_empty() && sure.iter().all(|s| (s - late).abs() < POLICY.timing.max_run_difference_s);
    (alike && !timed.iter().any(|(_, t)| against(t))).then_some(late)
}
