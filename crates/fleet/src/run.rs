//! The pairs of a fleet, diagnosed by as many workers as there are processors.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use anyhow::Result;
use rayon::prelude::*;
use rivet_analysis::fault::{Fault, Kind};
use rivet_realtime::Shutdown;

use crate::collector::{Collector, Event};
use crate::fingerprint::{Common, Digests};
use crate::journal::{self, Journal};
use crate::pairs::Pair;
use crate::plan::{Job, Plan};
use crate::progress::Progress;
use crate::row::{ErrorKind, Row};
use crate::summary::{State, Summary};
use crate::worker::{self, Outcome};

/// Time between two looks at the workers and at the signals.
const WORKERS_POLL: Duration = Duration::from_millis(100);

/// What a fleet is diagnosed with, and where the rows go.
#[derive(Clone, Copy, Debug)]
pub struct Settings<'a> {
    /// The Parquet table; its rows are continued.
    pub table: &'a Path,
    /// The `rivet` program, which makes each diagnosis.
    pub program: &'a Path,
    /// Values of `--map`.
    pub map: &'a [String],
    /// Diagnoses at a time; without it the number of processors.
    pub workers: Option<usize>,
    /// Whether failed pairs are diagnosed again, though nothing has changed.
    pub retry_failed: bool,
    /// The kind of failure that an exit code of `rivet diagnose` stands for.
    pub kind_of_exit: fn(i32) -> Kind,
}

/// What would be done with each pair, in the order of robots and logs. Writes nothing.
///
/// # Errors
/// The table cannot be continued.
pub fn list(pairs: Vec<Pair>, settings: &Settings<'_>) -> Result<Vec<(Pair, State)>> {
    let common = Common::new(settings.program, settings.map)?;
    let waiting = journal::waiting(settings.table);
    let plan = Plan::new(pairs, settings.table, &waiting, common, settings.retry_failed)?;
    let mut jobs: Vec<(&Job, State)> = plan.jobs.par_iter().map(|job| (job, plan.state(job).1)).collect();
    jobs.sort_by_key(|(job, _)| &job.key);
    Ok(jobs.into_iter().map(|(job, state)| (job.pair.clone(), state)).collect())
}

/// Diagnoses the pairs whose rows are missing or no longer valid. `on_progress` is called about ten times a second.
///
/// # Errors
/// The table cannot be continued or written, another process writes it, or `shutdown` was requested before all pairs had their rows.
/// Finished rows are kept in each case.
pub fn diagnose(
    pairs: Vec<Pair>,
    settings: &Settings<'_>,
    shutdown: &Shutdown,
    on_progress: impl FnMut(&Progress),
) -> Result<Summary> {
    let begin = Instant::now();
    // Before anything is written beside it: that the table can be continued.
    crate::table::index(settings.table)?;
    let (journal, waiting) = Journal::open(settings.table)?;
    let common = Common::new(settings.program, settings.map)?;
    let plan = Plan::new(pairs, settings.table, &waiting, common, settings.retry_failed)?;
    drop(waiting);
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    let fleet = Fleet {
        plan: &plan,
        scratches: plan.jobs.iter().map(|job| journal.scratch(&job.key)).collect(),
        workers: settings.workers.unwrap_or(processors).min(plan.jobs.len()).max(1),
        kind_of_exit: settings.kind_of_exit,
        shutdown,
        next: AtomicUsize::new(0),
        running: Mutex::new(BTreeMap::new()),
    };
    let mut collector = Collector::new(&plan, settings.table, journal, fleet.workers);
    let done = fleet.diagnose(&mut collector, on_progress);
    // What was finished is kept, whatever ended the work.
    let mut summary = collector.finish()?;
    done?;
    let (kept, all) = (summary.pairs(), plan.jobs.len());
    if kept < all {
        let table = settings.table.display();
        rivet_files::note(format_args!("rivet: {kept} of {all} pairs are in {table}; the same command continues"));
        return Err(Fault::Interrupted.into());
    }
    summary.duration_s = begin.elapsed().as_secs_f64();
    Ok(summary)
}

/// What all workers share.
struct Fleet<'a> {
    plan: &'a Plan,
    /// A file for the output of each job's diagnosis.
    scratches: Vec<PathBuf>,
    workers: usize,
    kind_of_exit: fn(i32) -> Kind,
    shutdown: &'a Shutdown,
    next: AtomicUsize,
    /// Starts of the diagnoses that are being made.
    running: Mutex<BTreeMap<usize, Instant>>,
}

impl Fleet<'_> {
    fn running(&self) -> MutexGuard<'_, BTreeMap<usize, Instant>> {
        self.running.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Runs the workers to their end and collects what they report.
    fn diagnose(&self, collector: &mut Collector<'_>, mut on_progress: impl FnMut(&Progress)) -> Result<()> {
        let (events, reports) = sync_channel(self.workers);
        std::thread::scope(|scope| {
            for _ in 0..self.workers {
                let events = events.clone();
                scope.spawn(move || self.work(&events));
            }
            drop(events);
            let mut result = Ok(());
            loop {
                match reports.recv_timeout(WORKERS_POLL) {
                    // After a failure the workers end; what they still report is not kept.
                    Ok(event) if result.is_ok() => {
                        result = collector.take(event);
                        if result.is_err() {
                            self.shutdown.request();
                        }
                    }
                    Ok(_) | Err(RecvTimeoutError::Timeout) => {}
                    Err(RecvTimeoutError::Disconnected) => break,
                }
                collector.progress.running = self.running().values().map(Instant::elapsed).sum();
                on_progress(&collector.progress);
            }
            result
        })
    }

    /// Takes job after job until none is left or the user ends the command.
    fn work(&self, events: &SyncSender<Event>) {
        while !self.shutdown.is_requested() {
            let place = self.next.fetch_add(1, Ordering::Relaxed);
            let Some(job) = self.plan.jobs.get(place) else { break };
            let event = match self.plan.state(job) {
                (_, State::UpToDate) => Event::UpToDate(place),
                (digests, State::Missing | State::Changed | State::Failed) => {
                    worker::limit_to_share(place, self.workers.min(self.remaining(place)));
                    let begin = Instant::now();
                    self.running().insert(place, begin);
                    let row = self.row(job, digests, &self.scratches[place]);
                    self.running().remove(&place);
                    match row {
                        Ok(None) => break,
                        Ok(Some(row)) => Event::Finished(place, Box::new(row), begin.elapsed()),
                        Err(why) => Event::Broken(why),
                    }
                }
            };
            if events.send(event).is_err() {
                break;
            }
        }
    }

    /// Jobs from `place` on that may be done at the same time: of those with a row most are up to date.
    fn remaining(&self, place: usize) -> usize {
        let end = if place < self.plan.missing { self.plan.missing } else { self.plan.jobs.len() };
        end - place
    }

    /// The row of a job; none where the user ended the command.
    fn row(&self, job: &Job, digests: Digests, scratch: &Path) -> Result<Option<Row>> {
        let (begin, common) = (Instant::now(), &self.plan.common);
        let text = |path: &PathBuf| path.to_string_lossy().into_owned();
        let filled = |text: String| (!text.is_empty()).then_some(text);
        let mut row = Row {
            robot: job.key.0.clone(),
            group_by: job.key.1.clone(),
            log_group: job.key.2.clone(),
            robot_file: job.pair.robot.as_ref().map(|robot| text(&robot.file)),
            logs: job.pair.logs.iter().map(text).collect(),
            channel_map: common.map.clone(),
            rivet_version: env!("CARGO_PKG_VERSION").to_owned(),
            program_sha256: common.program_sha256.clone(),
            robot_sha256: digests.robot,
            log_sha256: digests.logs,
            fingerprint: digests.fingerprint,
            ..Row::default()
        };
        let Some(robot) = &job.pair.robot else {
            let why = "no robot has the name of a folder in its path or of a part of its file name";
            return Ok(Some(row.with_error(ErrorKind::NoRobot, why.to_owned()).finished_now()));
        };
        let logs = &job.pair.logs;
        row = match worker::diagnose(common, &robot.file, logs, scratch, self.kind_of_exit, self.shutdown) {
            Outcome::Interrupted => return Ok(None),
            Outcome::Diagnosed { document, exit_code, notes } => {
                let program = document.passport.as_ref().map(|passport| &passport.tool.sha256);
                if program.is_some_and(|sha256| *sha256 != common.program_sha256) {
                    let why = "the program was replaced while it ran; run the command again";
                    return Err(Fault::Usage(why.to_owned()).into());
                }
                Row { exit_code: Some(exit_code), notes: filled(notes), ..row.with_diagnosis(*document)? }
            }
            Outcome::Failed { kind, error, exit_code, notes } => {
                Row { exit_code, notes: filled(notes), ..row.with_error(kind, error) }
            }
        };
        row.duration_s = Some(begin.elapsed().as_secs_f64());
        Ok(Some(row.finished_now()))
    }
}

impl Row {
    fn finished_now(self) -> Row {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Row { finished_at: i64::try_from(now.as_micros()).unwrap_or(i64::MAX), ..self }
    }
}
