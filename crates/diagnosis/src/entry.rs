//! Entry points: shapes and faults of the runs given, the held-out run, and the procedure on the sound ones.

use rivet_dynamics::Model;

use crate::experiment::separating_motion::MotionBounds;
use crate::export::patch::Patch;
use crate::fit::initial_friction;
use crate::judge::mounting;
use crate::judge::procedure::Procedure;
use crate::model::listener::Listener;
use crate::model::log_fault::LogFinding;
use crate::model::nominal::{Nominal, Typical};
use crate::model::run::{Run, split};
use crate::model::standstill;
use crate::policy::POLICY;
use crate::report::diagnosis::{DataUse, Diagnosis};
use crate::screen::arm_signals;
use crate::screen::computed_torque;
use crate::screen::input::{DiagnosisError, check};
use crate::screen::log_check;
use crate::screen::position_sign;
use crate::screen::prepared::Prepared;
use crate::screen::signal_faults;
use crate::screen::silent_channel;
use crate::screen::torque_timing;
use crate::screen::torque_unit;

/// Compares runs with what the simulator knows: `model` with the standard vector `nominal`.
///
/// With several runs the last is held out: it is predicted before its torque is read. A single run is cut. The
/// listener gets every step and decision.
///
/// # Errors
/// [`DiagnosisError`].
pub fn diagnose(
    model: &Model,
    nominal: &[f64],
    runs: Vec<Run>,
    listener: &mut dyn Listener,
) -> Result<Diagnosis, DiagnosisError> {
    Ok(run_all(model, nominal, runs, None, listener)?.0)
}

/// As [`diagnose`], and the model with what was found; none where nothing could be evaluated. `bounds` are those of the
/// motions that tell causes apart.
///
/// # Errors
/// [`DiagnosisError`].
pub fn diagnose_and_patch(
    model: &Model,
    nominal: &[f64],
    runs: Vec<Run>,
    bounds: &MotionBounds,
    listener: &mut dyn Listener,
) -> Result<(Diagnosis, Option<Patch>), DiagnosisError> {
    run_all(model, nominal, runs, Some(bounds), listener)
}

fn run_all(
    model: &Model,
    nominal: &[f64],
    runs: Vec<Run>,
    patch: Option<&MotionBounds>,
    listener: &mut dyn Listener,
) -> Result<(Diagnosis, Option<Patch>), DiagnosisError> {
    let joints = model.arm.dof();
    for run in &runs {
        check(run, joints)?;
    }
    let names: Vec<String> = runs.iter().map(|run| run.name.clone()).collect();
    let unused = |used: &[usize]| -> Vec<String> {
        names.iter().enumerate().filter(|(at, _)| !used.contains(at)).map(|(_, name)| name.clone()).collect()
    };
    let mut log: Vec<LogFinding> = Vec::new();
    let runs: Vec<(usize, Run)> = runs.into_iter().map(|run| mended(model, run, &mut log)).enumerate().collect();
    let (computed, runs): (Vec<_>, Vec<_>) = runs.into_iter().partition(|(_, run)| {
        let found = log_check::computed(model, run);
        log.extend(found.iter().cloned());
        !found.is_empty()
    });
    if runs.is_empty() {
        let why = computed_reason(model, computed.iter().map(|(_, run)| run));
        return if names.is_empty() { Err(DiagnosisError::NoRun) } else { Ok((Diagnosis::unheard(log, &why), None)) };
    }
    let (places, runs): (Vec<usize>, Vec<Run>) = runs.into_iter().unzip();
    let all = Nominal::new(model, nominal, &Typical::from_runs(&runs, joints));
    let is_mute = |(_, run): &(usize, Run)| silent_channel::is_mute(run, &all.x);
    let (mute, telling): (Vec<_>, Vec<_>) = places.into_iter().zip(runs).partition(is_mute);
    // Nothing can be sealed, or learnt, of channels that say nothing; they are said.
    let mute: Vec<Prepared> = mute.into_iter().map(|(_, run)| Prepared::new(run, &all)).collect();
    log.extend(mute.iter().flat_map(|run| log_check::check(run, &all)));
    let (used, telling): (Vec<usize>, Vec<Run>) = telling.into_iter().unzip();
    let cut = telling.len() == 1;
    let Some((look, sealed)) = split(telling) else {
        return Ok((Diagnosis::unheard(log, "the torque channels of all joints that move carry no information"), None));
    };
    let data = DataUse {
        runs: look.len() + 1,
        cut,
        fit_seconds: look.iter().map(Run::seconds).sum(),
        sealed_seconds: sealed.seconds(),
        of_another_kind: None,
    };
    // A diagnosis that ends before the procedure.
    let not_evaluated = |log: Vec<LogFinding>, why: &str| {
        let found = Diagnosis { log, data, unused: unused(&used), ..Diagnosis::not_evaluated(data, why) };
        Ok((Diagnosis { used: used.clone(), ..found }, None))
    };
    if let Some(why) = too_little_motion(&look, data.fit_seconds) {
        return not_evaluated(log, &why);
    }
    listener.line("motion, regressors");
    let mut nominal = Nominal::new(model, nominal, &Typical::from_runs(&look, joints));
    let mut look: Vec<Prepared> = look.into_iter().map(|run| Prepared::new(run, &nominal)).collect();
    let mut sealed = Prepared::new(sealed, &nominal);
    if let Err(end) = screen((&mut look, &mut sealed), &nominal, &mute, &mut log, listener) {
        return match end {
            End::NotEvaluated(why) => not_evaluated(log, &why),
            End::Unheard(why) => Ok((Diagnosis::unheard(log, why), None)),
        };
    }
    let given = Procedure { nominal: &nominal, look: &look, sealed: &sealed, data, mute: log };
    if let Some(found) = mounting::check(&given, listener) {
        return Ok((Diagnosis { unused: unused(&used), used, ..found }, None));
    }
    let log = given.mute;
    log_check::leave_out_held(&mut sealed, &nominal);
    let looked_at = look.len();
    let mut all: Vec<&mut Prepared> = look.iter_mut().chain([&mut sealed]).collect();
    initial_friction::know(&mut nominal, looked_at, &mut all).ok_or(DiagnosisError::Singular)?;
    let done = Procedure { nominal: &nominal, look: &look, sealed: &sealed, data, mute: log }.run(patch, listener);
    let (mut found, patch) = done.ok_or(DiagnosisError::Singular)?;
    found.know_repeats(&sealed.tau);
    Ok((Diagnosis { unused: unused(&used), used, ..found }, patch))
}

/// Why a diagnosis ends before anything is fitted.
enum End {
    NotEvaluated(String),
    /// No channel is left that says something.
    Unheard(&'static str),
}

/// Looks for channels whose torque or position cannot be believed, and brings torque and position together in time. What is found is
/// put down.
///
/// # Errors
/// Why nothing can be evaluated.
fn screen(
    (look, sealed): (&mut [Prepared], &mut Prepared),
    nominal: &Nominal,
    mute: &[Prepared],
    log: &mut Vec<LogFinding>,
    listener: &mut dyn Listener,
) -> Result<(), End> {
    for run in look.iter_mut().chain([&mut *sealed]) {
        log_check::distrust(run, nominal);
    }
    torque_unit::distrust(&mut look.iter_mut().chain([&mut *sealed]).collect::<Vec<_>>(), nominal);
    let turned = position_sign::check(look.iter_mut().chain([&mut *sealed]), nominal);
    if !turned.is_empty() {
        let why =
            format!("{turned} the position has the wrong sign: the torque of the other joints fits another motion");
        log.extend(look.iter().chain([&*sealed]).flat_map(|run| log_check::check(run, nominal)));
        return Err(End::NotEvaluated(why));
    }
    log_check::silence_dead(&mut look.iter_mut().chain([&mut *sealed]).collect::<Vec<_>>(), mute);
    listener.line("torque and position in time");
    log.extend(torque_timing::alignment::align(
        &mut look.iter_mut().chain([&mut *sealed]).collect::<Vec<_>>(),
        nominal,
        listener,
    ));
    if log_check::is_unheard(look) || log_check::is_unheard(std::slice::from_ref(sealed)) {
        log.extend(look.iter().chain([&*sealed]).flat_map(|run| log_check::check(run, nominal)));
        let why = if (0..nominal.model.arm.dof()).all(|j| standstill::is_still(&sealed.motion, j)) {
            "no joint moves in the last part, which is held out: no test is possible on it"
        } else {
            "no joint that moves has a trusted torque"
        };
        return Err(End::Unheard(why));
    }
    if let Some(why) = arm_signals::spoilt(look, sealed, nominal) {
        log.extend(look.iter().chain([&*sealed]).flat_map(|run| log_check::check(run, nominal)));
        return Err(End::NotEvaluated(why));
    }
    Ok(())
}

/// A run whose signals were mended; what was wrong with them is put down.
fn mended(model: &Model, run: Run, log: &mut Vec<LogFinding>) -> Run {
    let name = run.name.clone();
    let (run, found) = signal_faults::mend(run);
    let finding =
        |(j, fault): (usize, _)| LogFinding { run: name.clone(), joint: model.arm.joints[j].name.clone(), fault };
    log.extend(found.into_iter().map(finding));
    run
}

/// Why nothing is evaluated where the torque of all runs was computed.
fn computed_reason<'a>(model: &Model, runs: impl Iterator<Item = &'a Run>) -> String {
    let why = "the torque of every run was computed along the desired motion, not measured".to_owned();
    match computed_torque::flange_body(&model.arm, runs) {
        Some(body) => format!("{why}; the model it was computed with {body}"),
        None => why,
    }
}

/// Why the training runs of that length \[s\] decide nothing, if they do not.
fn too_little_motion(look: &[Run], fit_seconds: f64) -> Option<String> {
    let least_s = POLICY.signal_faults.min_training_s;
    if look.iter().filter(|run| moves(run)).map(Run::seconds).sum::<f64>() >= least_s {
        return None;
    }
    Some(if fit_seconds < least_s {
        format!("{fit_seconds:.1} s of training data are too little: at least {least_s:.0} s are required")
    } else {
        "no joint of the logs moves enough for a decision".to_owned()
    })
}

fn moves(run: &Run) -> bool {
    let fast = |q: &Vec<f64>| {
        q.windows(2).any(|w| (w[1] - w[0]).abs() > POLICY.signal_faults.min_training_speed_rad_s * run.period_s)
    };
    run.q.iter().any(fast)
}
