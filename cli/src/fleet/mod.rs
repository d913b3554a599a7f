//! `rivet diagnose --table`: many robots and logs, a process each, into one table that can be continued.

mod columns;
mod fingerprint;
mod journal;
mod pairs;
mod progress;
mod row;
mod summary;
mod table;
mod worker;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use anyhow::{Context, Result};
use rayon::prelude::*;
use rivet_analysis::fault::Fault;
use rivet_realtime::Shutdown;
use walkdir::WalkDir;

use crate::map::MapArgs;
use crate::outputs::Outputs;
use crate::table::show;
use fingerprint::{Common, Digests, RobotDigest};
use journal::Journal;
use pairs::{GroupBy, Pair};
use progress::{Line, Work};
use row::{ErrorKind, Key, Row, Status};
use summary::{State, Summary, states_text};
use table::Known;
use worker::Outcome;

/// Time between two looks at the workers and at the signals.
const LOOK: Duration = Duration::from_millis(100);
/// Shortest time between two writings of the table while diagnoses are made.
const MIN_MERGE_INTERVAL: Duration = Duration::from_secs(30);
/// A writing of the table is followed by so many times its duration without one.
const MERGE_PAUSE: u32 = 20;
/// Most diagnoses at a time.
const MAX_JOBS: i64 = 1024;

/// Arguments of a table of diagnoses.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Table of diagnoses (docs/fleet.md)")]
pub(crate) struct FleetArgs {
    /// Robots of a fleet: a folder with FOLDER/robot.toml for each robot, at any depth, or with NAME.toml.
    #[arg(long, value_name = "DIR", requires_all = ["table", "patterns"], conflicts_with = "robot")]
    robots: Option<PathBuf>,
    /// Logs of the fleet: a pattern in quotes (`logs/**/*.parquet`), or paths. A log belongs to the robot that its path names.
    #[arg(long = "logs", value_name = "GLOB", num_args = 1.., requires = "robots")]
    patterns: Vec<String>,
    /// Write one row for each diagnosis into this Parquet table, and continue one that is there: only what is missing or changed is
    /// diagnosed.
    #[arg(long, value_name = "OUT.parquet", conflicts_with_all = ["live", "html", "export", "self_check", "verbose"])]
    pub(crate) table: Option<PathBuf>,
    /// Logs of one diagnosis.
    #[arg(long, value_name = "UNIT", value_enum, default_value_t, requires = "robots")]
    group: GroupBy,
    /// Diagnoses at a time; each takes its share of the processors [default: number of processors]
    #[arg(long, value_name = "N", requires = "table", value_parser = clap::value_parser!(i64).range(1..=MAX_JOBS))]
    jobs: Option<i64>,
    /// Diagnose failed pairs again; else only those that crashed or had a file that could not be read.
    #[arg(long, requires = "table")]
    retry_failed: bool,
    /// List the pairs of robot and logs with what would be done, and diagnose nothing.
    #[arg(long, requires = "table")]
    dry_run: bool,
    /// End when the process that started this one ends.
    #[arg(long, hide = true)]
    pub(crate) die_with_parent: bool,
}

/// A pair with what its diagnosis needs.
struct Job {
    pair: Pair,
    key: Key,
    /// Place of its robot's digest.
    robot: usize,
    /// Size of its logs.
    bytes: u64,
}

/// What a worker reports of a job, by its place.
enum Event {
    /// The table has its row.
    UpToDate(usize),
    /// A new row, and how long its diagnosis took.
    Finished(usize, Box<Row>, Duration),
    /// Nothing more can be diagnosed.
    Broken(anyhow::Error),
}

/// What all workers share.
struct Fleet<'a> {
    jobs: &'a [Job],
    /// Jobs without a row; they come first.
    missing: usize,
    known: &'a BTreeMap<Key, Known>,
    robots: Vec<OnceLock<RobotDigest>>,
    common: Common,
    workers: usize,
    retry_failed: bool,
    shutdown: Shutdown,
    next: AtomicUsize,
    /// Starts of the diagnoses that are being made.
    running: Mutex<BTreeMap<usize, Instant>>,
}

/// Diagnoses a fleet, or one pair that is `given`, into a table.
///
/// Exit codes: 0 every pair has its diagnosis, 1 at least one failed.
///
/// # Errors
/// The pairs are ambiguous, the table cannot be continued or written, or the user ended the command.
pub(crate) fn run(
    args: &FleetArgs,
    table: &Path,
    given: Option<(&Path, &[PathBuf])>,
    map: &MapArgs,
    json: Option<&PathBuf>,
) -> Result<ExitCode> {
    let started = Instant::now();
    let table_path = table.to_owned();
    let pairs = match given {
        Some((robot, logs)) => vec![Pair::of_files(robot, logs)],
        None => fleet_pairs(args, table)?,
    };
    let robot_files = pairs.iter().filter_map(|pair| pair.robot.as_ref().map(|robot| robot.file.as_path()));
    let inputs = robot_files.chain(pairs.iter().flat_map(|pair| pair.logs.iter().map(PathBuf::as_path))).collect();
    let outputs = Outputs::given(inputs).file("--json", json);
    if args.dry_run { outputs } else { outputs.file("--table", Some(&table_path)) }.check()?;
    let mut known = table::index(table)?;
    // A list of pairs changes nothing and waits for nobody.
    let mut journal = None;
    if !args.dry_run {
        let (opened, rows) = Journal::open(table)?;
        known.extend(rows.iter().map(|row| (row.key(), Known::from(row))));
        journal = Some(opened);
    }
    let obsolete: BTreeSet<Key> = pairs.iter().filter(|pair| pair.robot.is_some()).flat_map(unpaired_keys).collect();
    let (jobs, robots) = jobs(pairs, &known);
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    let fleet = Fleet {
        missing: jobs.iter().filter(|job| !known.contains_key(&job.key)).count(),
        jobs: &jobs,
        known: &known,
        robots: (0..robots).map(|_| OnceLock::new()).collect(),
        common: Common::new(&map.entries)?,
        workers: args.jobs.and_then(|jobs| usize::try_from(jobs).ok()).unwrap_or(processors).min(jobs.len()).max(1),
        retry_failed: args.retry_failed,
        shutdown: Shutdown::on_signals().context("signal handlers")?,
        next: AtomicUsize::new(0),
        running: Mutex::new(BTreeMap::new()),
    };
    let Some(mut journal) = journal else { return fleet.list(json) };
    let has_obsolete = known.keys().any(|key| obsolete.contains(key));
    let mut summary = Summary::new(table);
    let done = fleet.diagnose(&mut journal, table, &obsolete, &mut summary);
    // What was finished is kept, whatever ended the work.
    if journal.len() > 0 || has_obsolete {
        merge(&mut journal, table, &obsolete)?;
    }
    journal.close();
    done?;
    if fleet.shutdown.is_requested() && summary.pairs() < jobs.len() {
        let (kept, of) = (summary.pairs(), jobs.len());
        rivet_files::note(format_args!(
            "rivet: {kept} of {of} pairs are in {}; the same command continues",
            table.display()
        ));
        return Err(Fault::Interrupted.into());
    }
    summary.duration_s = started.elapsed().as_secs_f64();
    if let Some(path) = json {
        rivet_files::write_whole(path, summary.json()?).with_context(|| path.display().to_string())?;
    }
    show(&summary.text())?;
    Ok(ExitCode::from(u8::from(summary.has_failures())))
}

fn fleet_pairs(args: &FleetArgs, table: &Path) -> Result<Vec<Pair>> {
    let folder = args.robots.as_deref().context("no folder of robots")?;
    let robots = pairs::robots(folder)?;
    let mut excluded: Vec<&Path> = robots.iter().map(|robot| robot.file.as_path()).collect();
    excluded.push(table);
    let logs = pairs::recordings(&args.patterns, &excluded)?;
    pairs::pairs(&robots, &logs, args.group)
}

/// Keys of the rows that its logs had while they named no robot.
fn unpaired_keys(pair: &Pair) -> impl Iterator<Item = Key> {
    pair.logs.iter().map(|log| (None, GroupBy::Log.name().to_owned(), log.to_string_lossy().into_owned()))
}

/// The pairs as jobs, and the number of robots. Pairs without a row come first, then large logs: the last diagnosis is a short one.
fn jobs(pairs: Vec<Pair>, known: &BTreeMap<Key, Known>) -> (Vec<Job>, usize) {
    let mut robots: BTreeMap<Option<PathBuf>, usize> = BTreeMap::new();
    let mut jobs = Vec::with_capacity(pairs.len());
    for pair in pairs {
        let count = robots.len();
        let robot = *robots.entry(pair.robot.as_ref().map(|robot| robot.file.clone())).or_insert(count);
        let bytes = pair.logs.iter().map(|log| size(log)).sum();
        jobs.push(Job { key: pair.key(), pair, robot, bytes });
    }
    jobs.sort_by_key(|job| (known.contains_key(&job.key), std::cmp::Reverse(job.bytes)));
    (jobs, robots.len())
}

/// Bytes of a file or recording folder; 0 where it cannot be read.
fn size(path: &Path) -> u64 {
    let files = WalkDir::new(path).into_iter().flatten().filter_map(|entry| entry.metadata().ok());
    files.filter(std::fs::Metadata::is_file).map(|file| file.len()).sum()
}

fn merge(journal: &mut Journal, table: &Path, obsolete: &BTreeSet<Key>) -> Result<()> {
    let is_added = |key: &Key| journal.has(key);
    let at = || table.display().to_string();
    table::merge(table, journal.rows(), obsolete, is_added).with_context(at)?;
    journal.clear();
    Ok(())
}

impl Fleet<'_> {
    /// Digests of a job, and whether it has to be done.
    fn state(&self, job: &Job) -> (Digests, State) {
        let robot = &self.robots[job.robot];
        let digests = Digests::of(&job.pair, &self.common, robot);
        let state = match self.known.get(&job.key) {
            None => State::Missing,
            Some(known) if known.fingerprint != digests.fingerprint => State::Changed,
            Some(known) if known.error_kind.is_some_and(|kind| self.retry_failed || kind.is_transient()) => {
                State::Failed
            }
            Some(_) => State::UpToDate,
        };
        (digests, state)
    }

    /// Lists the pairs and does nothing.
    fn list(&self, json: Option<&PathBuf>) -> Result<ExitCode> {
        let mut states: Vec<(&Pair, State)> = self.jobs.par_iter().map(|job| (&job.pair, self.state(job).1)).collect();
        states.sort_by_key(|(pair, _)| (pair.robot.as_ref().map(|robot| robot.id.clone()), pair.log_group.clone()));
        if let Some(path) = json {
            rivet_files::write_whole(path, summary::states_json(&states)?)
                .with_context(|| path.display().to_string())?;
        }
        show(&states_text(&states))?;
        Ok(ExitCode::SUCCESS)
    }

    /// Diagnoses what is missing; finished rows are in the journal or the table.
    fn diagnose(
        &self,
        journal: &mut Journal,
        table: &Path,
        obsolete: &BTreeSet<Key>,
        summary: &mut Summary,
    ) -> Result<()> {
        let scratches: Vec<PathBuf> = self.jobs.iter().map(|job| journal.scratch(&job.key)).collect();
        let (events, reports) = sync_channel(self.workers);
        let mut line = Line::new();
        let bytes_left = self.jobs.iter().map(|job| job.bytes).sum();
        let mut work = Work { pairs: self.jobs.len(), workers: self.workers, bytes_left, ..Work::default() };
        std::thread::scope(|scope| {
            for _ in 0..self.workers {
                let (events, scratches) = (events.clone(), &scratches);
                scope.spawn(move || self.work(scratches, &events));
            }
            drop(events);
            let (mut merged, mut pause) = (Instant::now(), MIN_MERGE_INTERVAL);
            let mut take = |event, work: &mut Work| -> Result<()> {
                let is_up_to_date = matches!(event, Event::UpToDate(_));
                let (place, known) = match event {
                    Event::Broken(why) => return Err(why),
                    Event::UpToDate(place) => {
                        (place, self.known.get(&self.jobs[place].key).cloned().context("a row that was known")?)
                    }
                    Event::Finished(place, row, duration) => {
                        journal.keep(&row)?;
                        if row.status == Status::Diagnosed {
                            work.bytes_diagnosed += self.jobs[place].bytes;
                            work.diagnosing += duration;
                        }
                        (place, Known::from(&*row))
                    }
                };
                work.bytes_left -= self.jobs[place].bytes;
                work.finished += 1;
                work.failed += usize::from(known.status == Status::Failed);
                summary.add(&self.jobs[place].key, known, is_up_to_date);
                if journal.len() > 0 && merged.elapsed() > pause {
                    let begin = Instant::now();
                    merge(journal, table, obsolete)?;
                    merged = Instant::now();
                    pause = MIN_MERGE_INTERVAL.max(MERGE_PAUSE * begin.elapsed());
                }
                Ok(())
            };
            let mut result = Ok(());
            loop {
                match reports.recv_timeout(LOOK) {
                    // After a failure the workers end; what they still report is not kept.
                    Ok(_) if result.is_err() => {}
                    Ok(event) => {
                        result = take(event, &mut work);
                        if result.is_err() {
                            self.shutdown.request();
                        }
                    }
                    Err(RecvTimeoutError::Timeout) => {}
                    Err(RecvTimeoutError::Disconnected) => break,
                }
                let running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
                work.running = running.values().map(Instant::elapsed).sum();
                drop(running);
                line.show(&work);
            }
            line.clear();
            result
        })
    }

    /// Takes job after job until none is left or the user ends the command.
    fn work(&self, scratches: &[PathBuf], events: &SyncSender<Event>) {
        while !self.shutdown.is_requested() {
            let place = self.next.fetch_add(1, Ordering::Relaxed);
            let Some(job) = self.jobs.get(place) else { break };
            let (digests, state) = self.state(job);
            let event = match state {
                State::UpToDate => Event::UpToDate(place),
                State::Missing | State::Changed | State::Failed => {
                    // Jobs that surely are done beside this one: the others may be up to date.
                    let remaining = if place < self.missing { self.missing } else { self.jobs.len() } - place;
                    let beside = self.workers.min(remaining);
                    if let Some(share) = worker::processors(place, beside) {
                        worker::limit_to(&share);
                    }
                    let begin = Instant::now();
                    self.running.lock().unwrap_or_else(PoisonError::into_inner).insert(place, begin);
                    let row = self.row(job, digests, &scratches[place]);
                    self.running.lock().unwrap_or_else(PoisonError::into_inner).remove(&place);
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

    /// The row of a job; none where the user ended the command.
    fn row(&self, job: &Job, digests: Digests, scratch: &Path) -> Result<Option<Row>> {
        let begin = Instant::now();
        let text = |path: &PathBuf| path.to_string_lossy().into_owned();
        let mut row = Row {
            robot: job.key.0.clone(),
            group_by: job.key.1.clone(),
            log_group: job.key.2.clone(),
            robot_file: job.pair.robot.as_ref().map(|robot| text(&robot.file)),
            logs: job.pair.logs.iter().map(text).collect(),
            channel_map: self.common.map.clone(),
            rivet_version: env!("CARGO_PKG_VERSION").to_owned(),
            program_sha256: self.common.program_sha256.clone(),
            robot_sha256: digests.robot,
            log_sha256: digests.logs,
            fingerprint: digests.fingerprint,
            ..Row::default()
        };
        if let Some(robot) = &job.pair.robot {
            let filled = |text: String| (!text.is_empty()).then_some(text);
            row = match worker::diagnose(&self.common, &robot.file, &job.pair.logs, scratch, &self.shutdown)? {
                Outcome::Interrupted => return Ok(None),
                Outcome::Diagnosed { document, exit_code, notes: warnings } => {
                    let program = document.passport.as_ref().map(|passport| &passport.tool.sha256);
                    if program.is_some_and(|sha256| *sha256 != self.common.program_sha256) {
                        let why = "the program was replaced while it ran; run the command again";
                        return Err(Fault::Usage(why.to_owned()).into());
                    }
                    Row { exit_code: Some(exit_code), notes: filled(warnings), ..row.with_diagnosis(*document)? }
                }
                Outcome::Failed { kind, error, exit_code, notes: warnings } => {
                    Row { exit_code, notes: filled(warnings), ..row.with_error(kind, error) }
                }
            };
            row.duration_s = Some(begin.elapsed().as_secs_f64());
        } else {
            let why = "no robot has the name of a folder in its path or of a part of its file name".to_owned();
            row = row.with_error(ErrorKind::NoRobot, why);
        }
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        row.finished_at = i64::try_from(now.as_micros()).unwrap_or(i64::MAX);
        Ok(Some(row))
    }
}
