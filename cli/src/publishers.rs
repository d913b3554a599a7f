//! Rows that a second publisher sent, left out wherever a log is read.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Mutex;

use rivet_logs::Log;
use rivet_screening::second_publisher;

use crate::evidence::Distrust;
use crate::table::number;

/// Name of rows that another publisher sent.
const PUBLISHER_NAME: &str = "second_publisher";

/// The log without the rows of a second publisher, which is reported under `name` the first time that the file is read.
pub(crate) fn without_second_publisher(log: Log, name: String) -> Log {
    let rows = second_publisher(&log.q);
    let Some(first) = rows.first() else { return log };
    let text = format!(
        "{} of {} rows (first at {} s) hold one and the same position, far from the rows around: a second publisher; they are excluded. \
         Record one publisher",
        rows.len(),
        log.len(),
        number(log.t[*first], 5)
    );
    if is_first_read(&log) {
        Distrust { log: Some(name), joint: None, name: PUBLISHER_NAME, text }.warn();
    }
    log.without(&rows)
}

/// Reports how the channels of a log were found and what is wrong with its file, the first time that it is read.
pub(crate) fn note_reading(log: &Log, name: &str) {
    static READ: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    if is_first(&READ, log) {
        log.notes.iter().for_each(|text| rivet_files::note(format_args!("rivet: {name}: {text}")));
    }
}

/// Some commands read a file again.
fn is_first_read(log: &Log) -> bool {
    static READ: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    is_first(&READ, log)
}

fn is_first(read: &Mutex<BTreeSet<PathBuf>>, log: &Log) -> bool {
    read.lock().map_or(true, |mut files| files.insert(log.path.clone()))
}
