//! What a fleet command reports: counts, verdicts and failures; or the pairs that it would diagnose.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use rivet_analysis::table::{Table, paragraph};
use serde::Serialize;

use crate::journal::name;
use crate::pairs::Pair;
use crate::row::{ErrorKind, Key, Status};
use crate::table::Known;

/// Name and version of the JSON.
const SUMMARY_SCHEMA: &str = "rivet.fleet-summary.v1";
/// Failures that are printed; the JSON and the table have all.
const MAX_LISTED_FAILURES: usize = 10;

/// What is to be done with a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum State {
    /// It has no row.
    Missing,
    /// A file, `--map` or the program has changed.
    Changed,
    /// It failed and is tried again.
    Failed,
    /// Its row stays.
    UpToDate,
}

#[derive(Serialize)]
struct Failure {
    robot: Option<String>,
    log_group: String,
    error_kind: Option<ErrorKind>,
    error: Option<String>,
}

/// Counts of a run.
#[derive(Serialize)]
pub struct Summary {
    schema: &'static str,
    table: String,
    diagnosed: usize,
    failed: usize,
    /// Of both, rows that were there before.
    up_to_date: usize,
    verdicts: BTreeMap<String, usize>,
    failures: Vec<Failure>,
    /// Wall-clock time \[s\].
    pub(crate) duration_s: f64,
}

impl Summary {
    pub(crate) fn new(table: &Path) -> Summary {
        Summary {
            schema: SUMMARY_SCHEMA,
            table: table.to_string_lossy().into_owned(),
            diagnosed: 0,
            failed: 0,
            up_to_date: 0,
            verdicts: BTreeMap::new(),
            failures: Vec::new(),
            duration_s: 0.0,
        }
    }

    /// Adds a pair with its row.
    pub(crate) fn add(&mut self, key: &Key, known: Known, is_up_to_date: bool) {
        self.up_to_date += usize::from(is_up_to_date);
        match known.status {
            Status::Diagnosed => {
                self.diagnosed += 1;
                *self.verdicts.entry(known.verdict.unwrap_or_default()).or_default() += 1;
            }
            Status::Failed => {
                self.failed += 1;
                let (robot, log_group) = (key.0.clone(), key.2.clone());
                self.failures.push(Failure { robot, log_group, error_kind: known.error_kind, error: known.error });
            }
        }
    }

    /// Pairs with a row.
    pub(crate) fn pairs(&self) -> usize {
        self.diagnosed + self.failed
    }

    /// Whether a pair has no diagnosis.
    pub fn has_failures(&self) -> bool {
        self.failed > 0
    }

    /// The summary as JSON.
    ///
    /// # Errors
    /// A number that JSON does not have.
    pub fn json(&self) -> Result<String> {
        Ok(rivet_files::printable_json(serde_json::to_string_pretty(self)? + "\n"))
    }

    /// The summary in a few lines.
    pub fn text(&self) -> String {
        let Summary { diagnosed, failed, up_to_date, .. } = self;
        let mut out = paragraph(
            "",
            &format!("{} pairs: {diagnosed} diagnosed, {failed} failed; {up_to_date} were up to date", self.pairs()),
        );
        let verdicts: Vec<String> = self.verdicts.iter().map(|(verdict, count)| format!("{verdict} {count}")).collect();
        if !verdicts.is_empty() {
            out += &paragraph("  verdicts  ", &verdicts.join(", "));
        }
        let mut failures: Vec<&Failure> = self.failures.iter().collect();
        failures.sort_by_key(|failure| (&failure.robot, &failure.log_group));
        for failure in failures.iter().take(MAX_LISTED_FAILURES) {
            let error = failure.error.as_deref().and_then(|error| error.lines().next()).unwrap_or_default();
            let error = error.strip_prefix(&format!("{}: ", failure.log_group)).unwrap_or(error);
            out += &paragraph("  failed    ", &format!("{}: {error}", failure.log_group));
        }
        if failures.len() > MAX_LISTED_FAILURES {
            out += &paragraph("            ", &format!("and {} more", failures.len() - MAX_LISTED_FAILURES));
        }
        out + &paragraph("  table     ", &self.table)
    }
}

/// Pairs and their states as JSON.
///
/// # Errors
/// A number that JSON does not have.
pub fn states_json(states: &[(Pair, State)]) -> Result<String> {
    let pair = |(pair, state): &(Pair, State)| {
        let path = |path: &Path| path.to_string_lossy().into_owned();
        serde_json::json!({
            "id": name(&pair.key()),
            "robot": pair.robot.as_ref().map(|robot| &robot.id),
            "robot_file": pair.robot.as_ref().map(|robot| path(&robot.file)),
            "group_by": pair.group_by.name(),
            "log_group": pair.log_group,
            "logs": pair.logs.iter().map(|log| path(log)).collect::<Vec<_>>(),
            "state": state,
        })
    };
    let json = serde_json::json!({ "schema": SUMMARY_SCHEMA, "pairs": states.iter().map(pair).collect::<Vec<_>>() });
    Ok(rivet_files::printable_json(serde_json::to_string_pretty(&json)? + "\n"))
}

/// Pairs and their states, one a line.
pub fn states_text(states: &[(Pair, State)]) -> String {
    let mut table = Table::new(["logs", "robot", "number of logs", "state"]);
    for (pair, state) in states {
        let robot = pair.robot.as_ref().map_or("none", |robot| robot.id.as_str());
        let state = match state {
            State::Missing => "missing",
            State::Changed => "changed",
            State::Failed => "failed",
            State::UpToDate => "up to date",
        };
        table.row([pair.log_group.clone(), robot.to_owned(), pair.logs.len().to_string(), state.to_owned()]);
    }
    table.text()
}
