//! The log: systemd's journal with fields where standard error is connected to it, else lines of text.

use log::{LevelFilter, Log, Metadata, Record};
use std::io::Write as _;
use systemd_journal_logger::{JournalLog, connected_to_journal};

/// Lines as a person reads them: `rivetd: samples are flowing`.
struct Lines {
    program: &'static str,
}

impl Log for Lines {
    fn enabled(&self, _: &Metadata<'_>) -> bool {
        true
    }

    fn log(&self, record: &Record<'_>) {
        // One write a line: lines of several processes on one terminal do not mix. A closed standard error loses the line.
        let line = format!("{}: {}\n", self.program, record.args());
        let _ = std::io::stderr().write_all(line.as_bytes());
    }

    fn flush(&self) {}
}

/// Sends what `log`'s macros say to the journal under the name of `program`, every entry with `fields` (names of upper-case
/// letters and underscores) and with the keys of the macro's own; to standard error where that is not the journal.
///
/// The first call of a process counts.
pub fn log_as(program: &'static str, fields: &[(&str, &str)]) {
    let journal = if connected_to_journal() { JournalLog::new().ok() } else { None };
    let installed = match journal {
        Some(journal) => {
            let fields = fields.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned()));
            journal.with_syslog_identifier(program.to_owned()).with_extra_fields(fields).install()
        }
        None => log::set_boxed_logger(Box::new(Lines { program })),
    };
    // Libraries speak through the same macros; what they say below a warning is of no use to an operator.
    if installed.is_ok() {
        log::set_max_level(LevelFilter::Info);
    }
}
