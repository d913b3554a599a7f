//! Which files and which build a diagnosis is of.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use rivet_config::Robot;
use rivet_logs::{Log, TorqueSource};
use rivet_report::{Clock, ClockOff, Input, Passport, Tool};
use sha2::{Digest, Sha256};

use crate::runs::{Piece, short_name};

/// A log and the stretches that it was cut into.
pub(crate) struct Source<'a> {
    pub(crate) path: &'a Path,
    pub(crate) log: Log,
    pub(crate) pieces: Vec<Piece>,
}

/// The passport of a diagnosis.
///
/// * `program`: what made the diagnosis; its digest is stated
/// * `used`: places of the stretches that were used among those of all logs, the sealed one last
pub(crate) fn passport(
    robot: &Robot,
    robot_file: &Path,
    program: &Path,
    sources: &[Source<'_>],
    used: &[usize],
) -> Result<Passport> {
    let sealed = sealed(sources, used);
    let mut inputs = vec![input("robot", robot_file, None)?, input("urdf", &robot.config.urdf, None)?];
    for source in sources {
        inputs.push(input("log", source.path, Some(clock(robot, source)))?);
    }
    let from_current = sources.iter().any(|s| matches!(s.log.tau, Some((TorqueSource::Current, _))));
    let torque = if from_current { "motor current times the drive gain of the robot file" } else { "tau of the log" };
    Ok(Passport {
        tool: Tool { version: env!("CARGO_PKG_VERSION").to_owned(), sha256: sha256(program)? },
        inputs,
        model: format!("{:016x}", robot.hash),
        sealed,
        torque: torque.to_owned(),
        gear_ratio: robot.config.drive.gear_ratio.clone(),
    })
}

/// What was sealed; nothing where nothing was evaluated.
fn sealed(sources: &[Source<'_>], used: &[usize]) -> String {
    let Some(mut place) = used.last().copied() else { return String::new() };
    for source in sources {
        let name = || short_name(source.path);
        match (used.len(), source.pieces.len()) {
            (_, pieces) if place >= pieces => place -= pieces,
            (1, 1) => return format!("the last two fifths of {}", name()),
            (1, _) => return format!("the last two fifths of stretch {} of {}", place + 1, name()),
            (_, 1) => return name(),
            _ => return format!("stretch {} of {}", place + 1, name()),
        }
    }
    String::new()
}

fn input(role: &str, path: &Path, clock: Option<Clock>) -> Result<Input> {
    Ok(Input { role: role.to_owned(), name: short_name(path), sha256: sha256(path)?, clock })
}

/// Folders of a recording in which nothing is read.
const UNREAD_FOLDERS: [&str; 2] = ["videos", "images"];
/// Bytes that are read at a time.
const BLOCK_BYTES: usize = 1 << 16;

/// Digest of a file; of a folder, that of the names and contents of its files in the order of their names.
pub fn sha256(path: &Path) -> Result<String> {
    let mut digest = Sha256::new();
    digest_into(&mut digest, path).with_context(|| path.display().to_string())?;
    Ok(digest.finalize().iter().fold(String::new(), |mut text, byte| {
        // Writing to a String cannot fail.
        let _ = write!(text, "{byte:02x}");
        text
    }))
}

fn digest_into(digest: &mut Sha256, path: &Path) -> io::Result<()> {
    if path.is_dir() {
        let entries = std::fs::read_dir(path)?.map(|entry| Ok(entry?.path())).collect::<io::Result<Vec<PathBuf>>>()?;
        let is_read = |path: &PathBuf| !UNREAD_FOLDERS.iter().any(|unread| path.ends_with(unread));
        let mut entries: Vec<PathBuf> = entries.into_iter().filter(is_read).collect();
        entries.sort();
        for entry in entries {
            digest.update(entry.file_name().unwrap_or_default().as_encoded_bytes());
            digest_into(digest, &entry)?;
        }
        return Ok(());
    }
    rivet_files::ensure_regular(path)?;
    let mut file = File::open(path)?;
    let mut block = vec![0; BLOCK_BYTES];
    loop {
        let count = file.read(&mut block)?;
        if count == 0 {
            return Ok(());
        }
        digest.update(&block[..count]);
    }
}

fn clock(robot: &Robot, source: &Source<'_>) -> Clock {
    let log = &source.log;
    let step_s = log.median_step_s();
    let steps: Vec<f64> = log.logged_t().windows(2).map(|w| w[1] - w[0]).collect();
    // A step of more than two and a half usual ones lacks samples; the others say how even the clock is.
    let (regular, gaps): (Vec<f64>, Vec<f64>) = steps.iter().partition(|s| **s <= 2.5 * step_s);
    let square: f64 = regular.iter().map(|s| (s - step_s).powi(2)).sum();
    let repeated = source.pieces.iter().flat_map(|p| &p.report.repeated).fold(0.0_f64, |m, s| m.max(*s));
    Clock {
        rows: log.len(),
        seconds: log.duration_s(),
        step_s,
        jitter_s: (square / regular.len().max(1) as f64).sqrt(),
        stamps_jitter_s: source.pieces.iter().filter_map(|p| p.report.stamps_jitter_s).reduce(f64::max),
        off: crate::clock::off(robot, log)
            .map(|distrust| ClockOff { sure: distrust.name == crate::clock::OFF_NAME, text: distrust.text }),
        gaps: gaps.len(),
        longest_gap_s: gaps.iter().fold(0.0, |m, s| f64::max(m, *s)),
        pieces: source.pieces.len(),
        repeated,
    }
}
