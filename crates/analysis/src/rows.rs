//! The stretches of a log, screened, and the rows that are learnt from.

use std::collections::BTreeSet;

use anyhow::{Context, Result};
use rivet_config::{Instruments, Robot};
use rivet_estimation::Settings;
use rivet_estimation::offline::{InstrumentSource, Method, OfflineError, OfflineSettings, Rows, unfollowed};
use rivet_logs::Log;

use crate::channels;
use crate::clock;
use crate::coarse::{TorqueSteps, coarse, slow};
use crate::evidence::{self, Distrust};
use crate::fault::Fault;
use crate::fit::method;
use crate::glitches::{JUMP_NAME, screen};
use crate::jitter;
use crate::runs::{self, Piece};

/// What is taken of logs.
#[derive(Default)]
pub(crate) struct Taken {
    /// Stretches, and the rows of each.
    pub(crate) runs: Vec<Run>,
    pub(crate) rows: Vec<Rows>,
    /// What stands for the contents of each log.
    pub(crate) contents: Vec<u64>,
    /// Readings that were not taken.
    pub(crate) distrusts: Vec<Distrust>,
    /// Torques in steps.
    pub(crate) torque_steps: Vec<TorqueSteps>,
}

/// One stretch of a log.
pub(crate) struct Run {
    pub(crate) piece: Piece,
    pub(crate) source: InstrumentSource,
    /// Joints (from 0) that do not follow the log's desired motion.
    pub(crate) unfollowed: Vec<usize>,
}

/// The stretches of a log and their rows.
pub(crate) fn rows_of(robot: &Robot, log: &Log) -> Result<Taken> {
    rows_with(robot, log, &runs::settings(robot, log.q_des.is_some()))
}

/// The same with the rows at standstill.
pub(crate) fn rows_everywhere(robot: &Robot, log: &Log) -> Result<Taken> {
    let mut settings = runs::settings(robot, log.q_des.is_some());
    settings.dead_zone.fill(0.0);
    rows_with(robot, log, &settings)
}

/// The same where the log need not have what instruments are made of: torque and measured motion are all that is asked.
pub(crate) fn rows_without_plan(robot: &Robot, log: &Log) -> Result<Taken> {
    let usual = || Settings::new(robot.dof(), robot.config.sample_period_s).instruments.delay_s();
    let delay_s = robot.config.estimator.instruments.delay_s().or_else(usual);
    let instrument = InstrumentSource::Delayed(delay_s.unwrap_or(robot.config.sample_period_s));
    rows_with(robot, log, &OfflineSettings { instrument, ..runs::settings(robot, false) })
}

fn rows_with(robot: &Robot, log: &Log, settings: &OfflineSettings) -> Result<Taken> {
    log.torque()?;
    let without_desired = settings.instrument == InstrumentSource::Desired && log.q_des.is_none();
    let without_second =
        settings.instrument == InstrumentSource::SecondEncoder && log.q_link.iter().any(Option::is_none);
    // Least squares do not ask for them; what is compared with them is made of the measured motion.
    if (without_desired || without_second) && method(robot) == Method::LeastSquares {
        return rows_without_plan(robot, log);
    }
    if without_desired {
        return Err(Fault::Data(format!(
            "{}: no q_des columns, but [estimator] instruments in {} ask for them; \"auto\" takes delayed ones",
            log.path.display(),
            robot.config.path.display()
        ))
        .into());
    }
    if without_second {
        return Err(Fault::Data(format!(
            "{}: q_link columns are missing, but [estimator] instruments = \"second-encoder\" in {}; it needs one of every \
             joint",
            log.path.display(),
            robot.config.path.display()
        ))
        .into());
    }
    channels::varies(robot, log)?;
    let mut sound = screen(robot, log)?;
    let jumps = sound.found.iter().any(|d| d.name == JUMP_NAME);
    if let Some(order) = jitter::out_of_order(log, jumps) {
        sound.found.insert(0, order);
    }
    // A plan that is held comes late by its stairs; drawn anew it tells the clock.
    sound.found.extend(clock::off(robot, &sound.log));
    // Where it stood it is not at its limit.
    let stood: Vec<Option<String>> =
        sound.found.iter().filter(|d| d.name == evidence::TORQUE_STOOD_NAME).map(|d| d.joint.clone()).collect();
    let clipped = channels::clipped(robot, log)?.into_iter().filter(|d| !stood.contains(&d.joint));
    sound.found.extend(clipped);
    sound.found.extend(slow(robot, log));
    let coarse = coarse(robot, &sound.log);
    sound.found.extend(coarse.iter().flat_map(|coarse| coarse.distrusts(robot)));
    let (mut found, mut all_rows, mut still, mut underived) = (Vec::new(), Vec::new(), None, BTreeSet::new());
    let why = || {
        sound.reason().map_or_else(|| log.path.display().to_string(), |why| format!("{}: {why}", log.path.display()))
    };
    for mut piece in
        runs::pieces_without(&sound.left_out, &sound.log, robot.config.sample_period_s).with_context(why)?
    {
        if let Some(repeated) = &sound.repeated {
            piece.report.repeated.clone_from(repeated);
        }
        if settings.instrument == InstrumentSource::Desired {
            underived.extend(runs::not_derived(&piece.grid, piece.report.period_s));
        }
        let mut record = runs::record(&mut piece)?;
        if let Some(coarse) = &coarse {
            coarse.smooth(robot, &mut record);
        }
        let mut settings = settings.clone();
        let seen_as = match settings.instrument {
            InstrumentSource::Desired => record.desired.as_ref(),
            InstrumentSource::SecondEncoder => record.second.as_ref(),
            InstrumentSource::Delayed(_) => None,
        };
        let unfollowed = seen_as.map_or_else(Vec::new, |motion| unfollowed(&record.measured, motion, record.period_s));
        if let (false, Instruments::Auto { delay_s, .. }) = (unfollowed.is_empty(), robot.config.estimator.instruments)
        {
            settings.instrument = InstrumentSource::Delayed(delay_s);
        }
        match Rows::new(&robot.model, &robot.base, &settings, &record) {
            Ok(rows) => {
                found.push(Run { piece, source: settings.instrument, unfollowed });
                all_rows.push(rows);
            }
            Err(why @ OfflineError::NoMotion { .. }) => still = Some(why),
            Err(why) => return Err(why).with_context(|| log.path.display().to_string()),
        }
    }
    let short = runs::short_name(&log.path);
    match still.filter(|_| found.is_empty()) {
        Some(still) => return Err(still).with_context(why),
        None => sound.found.extend(evidence::underived(robot, &short, &underived)),
    }
    Ok(Taken { runs: found, rows: all_rows, distrusts: sound.found, ..Taken::default() })
}
