//! The log: systemd's journal with fields where standard error is connected to it, else lines of text.

use log::{LevelFilter, Log, Metadata, Record};
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
        rivet_files::note(format_args!("{}: {}", self.program, record.args()));
    }

    fn flush(&self) {}
}

/// Hands entries on with the unsafe characters of their text escaped: names of files reach the journal, and from there a terminal.
struct Escaped(JournalLog);

impl Log for Escaped {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        self.0.enabled(metadata)
    }

    fn log(&self, record: &Record<'_>) {
        self.0.log(&record.to_builder().args(format_args!("{}", rivet_files::Printable(record.args()))).build());
    }

    fn flush(&self) {
        self.0.flush();
    }
}

/// Sends what `log`'s macros say to the journal under the name of `program`, every entry with `fields` (names of upper-case
/// letters and underscores) and with the keys of the macro's own; to standard error where that is not the journal.
///
/// The first call of a process counts.
pub fn log_as(program: &'static str, fields: &[(&str, &str)]) {
    let journal = if connected_to_journal() { JournalLog::new().ok() } else { None };
    let installed = match journal {
        Some(journal) => {
            let fields =
                fields.iter().map(|(name, value)| ((*name).to_owned(), rivet_files::printable(value).into_owned()));
            let journal = journal.with_syslog_identifier(program.to_owned()).with_extra_fields(fields);
            log::set_boxed_logger(Box::new(Escaped(journal)))
        }
        None => log::set_boxed_logger(Box::new(Lines { program })),
    };
    // Libraries speak through the same macros; what they say below a warning is of no use to an operator.
    if installed.is_ok() {
        log::set_max_level(LevelFilter::Info);
    }
}
