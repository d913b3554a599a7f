//! What a failed command tells the shell (the numbers of sysexits.h).

use std::error::Error;
use std::path::PathBuf;

use rivet_analysis::fault::{Kind, kind};
// Below it a code is an answer (`rivet diagnose`: 0 to 3), never a failure.
use rivet_service::USAGE;

/// Two diagnoses that were made by different rules; a list of them.
#[derive(Debug, thiserror::Error)]
#[error("{} and {} do not compare: {}", .a.display(), .b.display(), .rules.join("; "))]
pub(crate) struct Mismatch {
    pub(crate) a: PathBuf,
    pub(crate) b: PathBuf,
    pub(crate) rules: Vec<String>,
}

/// Bad input data.
const DATA: u8 = 65;
/// A file that cannot be read or written.
const INPUT_OUTPUT: u8 = 74;
/// Ended by Ctrl-C or SIGTERM, as a shell counts SIGINT.
const INTERRUPTED: u8 = 130;
/// Whatever has no code of its own.
const OTHER: u8 = 70;
/// Bad configuration; systemd does not restart on it.
const CONFIG: u8 = 78;

/// The exit code of a failure: 64 for the command line, 78 for a robot file, 65 for a log, runs that cannot be
/// diagnosed or identified or files that are no diagnoses or do not compare, 74 for a file
/// that cannot be read or written, 130 for the user's Ctrl-C, 70 for the rest.
pub(crate) fn code(error: &anyhow::Error) -> u8 {
    match kind(error) {
        Kind::Usage => USAGE,
        Kind::Data => DATA,
        Kind::Config => CONFIG,
        Kind::InputOutput => INPUT_OUTPUT,
        Kind::Interrupted => INTERRUPTED,
        Kind::Other if error.chain().any(<dyn Error>::is::<Mismatch>) => DATA,
        Kind::Other => OTHER,
    }
}

/// The kind of failure that a code of [`code`] stands for.
pub(crate) fn kind_of_code(code: i32) -> Kind {
    match u8::try_from(code) {
        Ok(USAGE) => Kind::Usage,
        Ok(DATA) => Kind::Data,
        Ok(CONFIG) => Kind::Config,
        Ok(INPUT_OUTPUT) => Kind::InputOutput,
        Ok(INTERRUPTED) => Kind::Interrupted,
        _ => Kind::Other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rivet_analysis::fault::Fault;

    #[test]
    fn a_code_leads_back_to_its_kind() {
        let faults: [fn(String) -> Fault; 4] = [Fault::Usage, Fault::Data, Fault::Config, |_| Fault::Interrupted];
        for fault in faults {
            let error = anyhow::Error::new(fault("why".to_owned()));
            assert_eq!(kind_of_code(i32::from(code(&error))), kind(&error), "{error}");
        }
        let missing = anyhow::Error::new(std::io::Error::from(std::io::ErrorKind::NotFound));
        assert_eq!(kind_of_code(i32::from(code(&missing))), Kind::InputOutput);
        assert_eq!(kind_of_code(i32::from(code(&anyhow::anyhow!("why")))), Kind::Other);
    }
}
