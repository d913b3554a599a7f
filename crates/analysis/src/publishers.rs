//! Rows that a second publisher sent, left out wherever a log is read.

use rivet_logs::Log;
use rivet_screening::second_publisher;

use crate::evidence::Distrust;
use crate::session;
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
    // Some analyses read a file again.
    if session::is_first(PUBLISHER_NAME, &log.path) {
        Distrust { log: Some(name), joint: None, name: PUBLISHER_NAME, text }.warn();
    }
    log.without(&rows)
}

/// Reports how the channels of a log were found and what is wrong with its file, the first time that it is read.
pub(crate) fn note_reading(log: &Log, name: &str) {
    if session::is_first("reading", &log.path) {
        log.notes.iter().for_each(|text| session::note(format_args!("rivet: {name}: {text}")));
    }
}
