//! Digests of what a diagnosis depends on: with another one it is made again.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use anyhow::Result;
use rivet_analysis::passport::sha256;
use sha2::{Digest as _, Sha256};

use crate::pairs::Pair;
use crate::table::SCHEMA;

/// What all diagnoses of a run depend on.
pub(crate) struct Common {
    pub(crate) program: PathBuf,
    pub(crate) program_sha256: String,
    /// Values of `--map`.
    pub(crate) map: Vec<String>,
}

impl Common {
    /// Of the program that diagnoses and the values of `--map`.
    ///
    /// # Errors
    /// The program cannot be read.
    pub(crate) fn new(program: &Path, map: &[String]) -> Result<Common> {
        Ok(Common { program: program.to_owned(), program_sha256: sha256(program)?, map: map.to_vec() })
    }
}

/// Digests of one robot's files.
#[derive(Clone, Debug)]
pub(crate) struct RobotDigest {
    /// Of the robot file.
    pub(crate) file: Option<String>,
    /// Of the URDFs that it names, or the reason why it names none.
    urdfs: Vec<String>,
}

impl RobotDigest {
    fn new(file: &Path) -> RobotDigest {
        let urdfs = match rivet_config::load(file) {
            Ok(robot) => {
                let named =
                    std::iter::once(robot.config.urdf.as_path()).chain(robot.config.friction.load_urdf.as_deref());
                named.map(digest).collect()
            }
            Err(why) => vec![why.to_string()],
        };
        RobotDigest { file: sha256(file).ok(), urdfs }
    }
}

/// Digests of a pair.
#[derive(Clone, Debug)]
pub(crate) struct Digests {
    pub(crate) robot: Option<String>,
    pub(crate) logs: Vec<String>,
    /// Of everything that the diagnosis depends on.
    pub(crate) fingerprint: String,
}

impl Digests {
    /// Reads the files of a pair; `robot` keeps the digest of its robot for the next pair.
    pub(crate) fn new(pair: &Pair, common: &Common, robot: &OnceLock<RobotDigest>) -> Digests {
        if pair.robot.is_none() {
            // Nothing is read of it.
            return Digests { robot: None, logs: Vec::new(), fingerprint: SCHEMA.to_owned() };
        }
        let robot = pair.robot.as_ref().map(|named| robot.get_or_init(|| RobotDigest::new(&named.file)).clone());
        let logs: Vec<String> = pair.logs.iter().map(|log| digest(log)).collect();
        let files = robot.as_ref().map(|robot| (&robot.file, &robot.urdfs));
        // As JSON no two lists of texts are the same text.
        let text = serde_json::json!([SCHEMA, common.program_sha256, common.map, files, logs]).to_string();
        let fingerprint = hex(&Sha256::digest(text));
        Digests { robot: robot.and_then(|robot| robot.file), logs, fingerprint }
    }
}

/// The digest of a file or recording folder, or the reason why there is none.
fn digest(path: &Path) -> String {
    sha256(path).unwrap_or_else(|why| format!("{why:#}"))
}

/// Bytes as hexadecimal digits.
pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        // Writing to a String cannot fail.
        let _ = write!(text, "{byte:02x}");
        text
    })
}
