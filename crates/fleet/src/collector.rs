//! What becomes of finished rows: kept in the journal at once, and in the table now and then.

use std::collections::BTreeSet;
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};

use crate::journal::Journal;
use crate::plan::Plan;
use crate::progress::Progress;
use crate::row::{Key, Row, Status};
use crate::summary::Summary;
use crate::table::{self, Known};

/// Shortest time between two writings of the table while diagnoses are made.
const MIN_MERGE_INTERVAL: Duration = Duration::from_secs(30);
/// A writing of the table is followed by so many times its duration without one.
const MERGE_PAUSE: u32 = 20;

/// What a worker reports of a job, by its place.
pub(crate) enum Event {
    /// The table has its row.
    UpToDate(usize),
    /// A new row, and how long its diagnosis took.
    Finished(usize, Box<Row>, Duration),
    /// Nothing more can be diagnosed.
    Broken(anyhow::Error),
}

/// Keeps rows and counts them.
pub(crate) struct Collector<'a> {
    plan: &'a Plan,
    table: &'a Path,
    journal: Journal,
    obsolete: BTreeSet<Key>,
    pub(crate) progress: Progress,
    pub(crate) summary: Summary,
    merged: Instant,
    pause: Duration,
}

impl<'a> Collector<'a> {
    pub(crate) fn new(plan: &'a Plan, table: &'a Path, journal: Journal, workers: usize) -> Collector<'a> {
        let bytes_left = plan.jobs.iter().map(|job| job.bytes).sum();
        Collector {
            plan,
            table,
            journal,
            obsolete: plan.obsolete(),
            progress: Progress { pairs: plan.jobs.len(), workers, bytes_left, ..Progress::default() },
            summary: Summary::new(table),
            merged: Instant::now(),
            pause: MIN_MERGE_INTERVAL,
        }
    }

    /// Takes what a worker reports.
    ///
    /// # Errors
    /// That of the worker, or the row cannot be kept.
    pub(crate) fn take(&mut self, event: Event) -> Result<()> {
        let is_up_to_date = matches!(event, Event::UpToDate(_));
        let (job, known) = match event {
            Event::Broken(why) => return Err(why),
            Event::UpToDate(place) => {
                let job = &self.plan.jobs[place];
                (job, self.plan.known(job)?)
            }
            Event::Finished(place, row, duration) => {
                let job = &self.plan.jobs[place];
                self.journal.keep(&row)?;
                if row.status == Status::Diagnosed {
                    self.progress.bytes_diagnosed += job.bytes;
                    self.progress.diagnosing += duration;
                }
                (job, Known::from(&*row))
            }
        };
        self.progress.bytes_left -= job.bytes;
        self.progress.finished += 1;
        self.progress.failed += usize::from(known.status == Status::Failed);
        self.summary.add(&job.key, known, is_up_to_date);
        if self.journal.len() > 0 && self.merged.elapsed() > self.pause {
            let begin = Instant::now();
            self.merge()?;
            self.merged = Instant::now();
            self.pause = MIN_MERGE_INTERVAL.max(MERGE_PAUSE * begin.elapsed());
        }
        Ok(())
    }

    fn merge(&mut self) -> Result<()> {
        let is_added = |key: &Key| self.journal.has(key);
        table::merge(self.table, self.journal.rows(), &self.obsolete, is_added)
            .with_context(|| self.table.display().to_string())?;
        self.journal.clear();
        Ok(())
    }

    /// Brings all rows into the table. Returns the counts.
    ///
    /// # Errors
    /// The table cannot be written; the rows stay beside it.
    pub(crate) fn finish(mut self) -> Result<Summary> {
        if self.journal.len() > 0 || !self.obsolete.is_empty() {
            self.merge()?;
        }
        self.journal.close();
        Ok(self.summary)
    }
}
