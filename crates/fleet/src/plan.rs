//! What is to be diagnosed, and what the table has already.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use anyhow::{Context, Result};
use walkdir::WalkDir;

use crate::fingerprint::{Common, Digests, RobotDigest};
use crate::pairs::{GroupBy, Pair};
use crate::row::{Key, Row};
use crate::summary::State;
use crate::table::{self, Known};

/// A pair with what its diagnosis needs.
pub(crate) struct Job {
    pub(crate) pair: Pair,
    pub(crate) key: Key,
    /// Place of its robot's digest.
    robot: usize,
    /// Size of its logs.
    pub(crate) bytes: u64,
}

/// All pairs of a call.
pub(crate) struct Plan {
    /// Pairs without a row come first, then large logs: the last diagnosis is a short one.
    pub(crate) jobs: Vec<Job>,
    /// Number of jobs without a row.
    pub(crate) missing: usize,
    pub(crate) common: Common,
    known: BTreeMap<Key, Known>,
    robots: Vec<OnceLock<RobotDigest>>,
    retry_failed: bool,
}

impl Plan {
    /// The plan for pairs whose rows are in a table or wait beside it.
    ///
    /// # Errors
    /// The table cannot be continued.
    pub(crate) fn new(
        pairs: Vec<Pair>,
        table: &Path,
        waiting: &[Row],
        common: Common,
        retry_failed: bool,
    ) -> Result<Plan> {
        let mut known = table::index(table)?;
        known.extend(waiting.iter().map(|row| (row.key(), Known::from(row))));
        let mut robots: BTreeMap<Option<PathBuf>, usize> = BTreeMap::new();
        let mut jobs = Vec::with_capacity(pairs.len());
        for pair in pairs {
            let count = robots.len();
            let robot = *robots.entry(pair.robot.as_ref().map(|robot| robot.file.clone())).or_insert(count);
            let bytes = pair.logs.iter().map(|log| size(log)).sum();
            jobs.push(Job { key: pair.key(), pair, robot, bytes });
        }
        jobs.sort_by_key(|job| (known.contains_key(&job.key), Reverse(job.bytes)));
        let missing = jobs.iter().filter(|job| !known.contains_key(&job.key)).count();
        let robots = robots.into_iter().map(|_| OnceLock::new()).collect();
        Ok(Plan { jobs, missing, common, known, robots, retry_failed })
    }

    /// Digests of a job, and what is to be done with it.
    pub(crate) fn state(&self, job: &Job) -> (Digests, State) {
        let digests = Digests::new(&job.pair, &self.common, &self.robots[job.robot]);
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

    /// The row that a job has already.
    ///
    /// # Errors
    /// It has none.
    pub(crate) fn known(&self, job: &Job) -> Result<Known> {
        self.known.get(&job.key).cloned().context("a pair that is up to date has a row")
    }

    /// Keys of rows that logs had while they named no robot.
    pub(crate) fn obsolete(&self) -> BTreeSet<Key> {
        let paired = self.jobs.iter().filter(|job| job.pair.robot.is_some());
        let logs = paired.flat_map(|job| job.pair.logs.iter().map(|log| log.to_string_lossy().into_owned()));
        let keys = logs.map(|log| (None, GroupBy::Log.name().to_owned(), log));
        keys.filter(|key| self.known.contains_key(key)).collect()
    }
}

/// Bytes of a file or recording folder; 0 where it cannot be read.
fn size(path: &Path) -> u64 {
    let files = WalkDir::new(path).into_iter().flatten().filter_map(|entry| entry.metadata().ok());
    files.filter(std::fs::Metadata::is_file).map(|file| file.len()).sum()
}
