//! One diagnosis in a process of its own.
//!
//! A process and not a thread: an abort, a stack overflow or a lack of memory ends one diagnosis and not all, and its memory returns to
//! the system. It is the command that a user or a cluster runs for one pair.

use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use rivet_analysis::fault::Kind;
use rivet_realtime::Shutdown;
use rivet_report::Document;
use rustix::process::{Pid, Signal, kill_process};
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

use crate::fingerprint::Common;
use crate::row::ErrorKind;

/// Time between two looks at a running diagnosis.
const PROCESS_POLL: Duration = Duration::from_millis(20);
/// Time that a diagnosis has to end after SIGTERM.
const PATIENCE: Duration = Duration::from_secs(2);
/// Most of its messages that is kept \[bytes\].
const KEPT_BYTES: u64 = 16 << 10;
/// Exit code of a panic.
const PANICKED: i32 = 101;

/// The kind of failure that an exit code of `rivet diagnose` stands for.
pub(crate) type KindOfExit = fn(i32) -> Kind;

/// What became of a diagnosis.
#[derive(Debug)]
pub(crate) enum Outcome {
    /// It ended; its warnings.
    Diagnosed { document: Box<Document>, exit_code: i64, notes: String },
    /// It failed; its exit code unless a signal ended it, and its warnings.
    Failed { kind: ErrorKind, error: String, exit_code: Option<i64>, notes: String },
    /// The user ended the command.
    Interrupted,
}

/// Runs `rivet diagnose` for one pair to its end; its result is written to `scratch`, which is gone afterwards. A process that cannot be
/// started is a failed diagnosis.
pub(crate) fn diagnose(
    common: &Common,
    robot: &Path,
    logs: &[PathBuf],
    scratch: &Path,
    kind_of_exit: KindOfExit,
    shutdown: &Shutdown,
) -> Outcome {
    run(common, robot, logs, scratch, kind_of_exit, shutdown).unwrap_or_else(|why| Outcome::Failed {
        kind: ErrorKind::InputOutput,
        error: format!("{why:#}"),
        exit_code: None,
        notes: String::new(),
    })
}

fn run(
    common: &Common,
    robot: &Path,
    logs: &[PathBuf],
    scratch: &Path,
    kind_of_exit: KindOfExit,
    shutdown: &Shutdown,
) -> Result<Outcome> {
    let mut messages = tempfile::tempfile().context("a file for the messages of a diagnosis")?;
    let mut command = Command::new(&common.program);
    command.args(["diagnose", "--die-with-parent", "--json"]).arg(scratch);
    command.args(common.map.iter().flat_map(|entry| ["--map", entry]));
    command.arg("--").arg(robot).args(logs);
    // In a group of its own it does not get the Ctrl-C of the terminal: this program ends it, and knows that it did.
    command.process_group(0).env(rivet_realtime::PARENT_VARIABLE, std::process::id().to_string());
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(messages.try_clone()?);
    let mut child = command.spawn().context("the diagnosis cannot be started")?;
    let ended = wait(&mut child, shutdown);
    let result = std::fs::read(scratch);
    // A diagnosis that failed has written nothing.
    let _ = std::fs::remove_file(scratch);
    let Some(status) = ended? else { return Ok(Outcome::Interrupted) };
    let text = tail(&mut messages)?;
    Ok(match (status.code(), result) {
        (Some(code @ 0..=3), Ok(json)) => match serde_json::from_slice(&json) {
            Ok(document) => Outcome::Diagnosed {
                document: Box::new(document),
                exit_code: i64::from(code),
                notes: text.trim().to_owned(),
            },
            Err(why) => failed(status, &format!("{text}rivet: its JSON cannot be read: {why}"), kind_of_exit),
        },
        _ => failed(status, &text, kind_of_exit),
    })
}

/// Waits for the end of a diagnosis; none where the user ended it.
fn wait(child: &mut Child, shutdown: &Shutdown) -> std::io::Result<Option<ExitStatus>> {
    loop {
        if shutdown.is_requested() {
            end(child);
            return Ok(None);
        }
        if let Some(status) = child.try_wait()? {
            return Ok(Some(status));
        }
        std::thread::sleep(PROCESS_POLL);
    }
}

/// Ends a diagnosis: SIGTERM, then SIGKILL.
fn end(child: &mut Child) {
    if let Some(pid) = i32::try_from(child.id()).ok().and_then(Pid::from_raw) {
        // Fails only for a process that has ended.
        let _ = kill_process(pid, Signal::TERM);
    }
    let deadline = Instant::now() + PATIENCE;
    while matches!(child.try_wait(), Ok(None)) && Instant::now() < deadline {
        std::thread::sleep(PROCESS_POLL);
    }
    let _ = child.kill();
    let _ = child.wait();
}

/// The end of what a diagnosis wrote to standard error.
fn tail(messages: &mut File) -> Result<String> {
    let length = messages.seek(SeekFrom::End(0))?;
    messages.seek(SeekFrom::Start(length.saturating_sub(KEPT_BYTES)))?;
    let mut bytes = Vec::new();
    messages.take(KEPT_BYTES).read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// How a diagnosis failed, from how it ended and its messages: the last of them is the error, the others are warnings.
fn failed(status: ExitStatus, text: &str, kind_of_exit: KindOfExit) -> Outcome {
    let (text, code) = (text.trim(), status.code());
    let kind = match code {
        None | Some(PANICKED) => ErrorKind::Crash,
        Some(code) => ErrorKind::from(kind_of_exit(code)),
    };
    let begin = match code {
        Some(PANICKED) => text.find("\nthread '").map_or(0, |at| at + 1),
        _ => text.rfind("\nrivet: ").map_or(0, |at| at + 1),
    };
    let (notes, error) = text.split_at(begin);
    let error = error.strip_prefix("rivet: ").unwrap_or(error);
    let signal = status.signal().map(|signal| format!("ended by signal {signal}{}", reason(signal)));
    let error = match (signal, error) {
        (Some(signal), "") => signal,
        (Some(signal), error) => format!("{signal}: {error}"),
        (None, "") => format!("ended with exit code {}", code.unwrap_or(-1)),
        (None, error) => error.to_owned(),
    };
    Outcome::Failed { kind, error, exit_code: code.map(i64::from), notes: notes.trim().to_owned() }
}

/// What a signal usually means.
fn reason(signal: i32) -> &'static str {
    match Signal::from_named_raw(signal) {
        Some(Signal::KILL) => " (SIGKILL, as where memory is short)",
        Some(Signal::SEGV) => " (SIGSEGV, as where the stack is short)",
        Some(Signal::ABORT) => " (SIGABRT)",
        Some(Signal::TERM) => " (SIGTERM)",
        _ => "",
    }
}

/// The processors of this process, shared out: worker `place` of `workers` gets every `workers`-th, at least one.
fn processors(place: usize, workers: usize) -> Option<CpuSet> {
    let allowed = sched_getaffinity(None).ok()?;
    let all: Vec<usize> = (0..CpuSet::MAX_CPU).filter(|cpu| allowed.is_set(*cpu)).collect();
    let (place, step) = (place % all.len().max(1), workers.clamp(1, all.len().max(1)));
    let mut share = CpuSet::new();
    all.iter().skip(place % step).step_by(step).for_each(|cpu| share.set(*cpu));
    Some(share)
}

/// Limits the processes that this thread starts to its share of the processors: a diagnosis starts as many threads as it has processors.
pub(crate) fn limit_to_share(place: usize, workers: usize) {
    if let Some(share) = processors(place, workers) {
        // Where the system refuses, every diagnosis starts a thread a processor: slower, and the same result.
        let _ = sched_setaffinity(None, &share);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn failed_with(raw: i32, text: &str) -> (ErrorKind, String, Option<i64>, String) {
        let kind_of_exit = |code| if code == 65 { Kind::Data } else { Kind::Other };
        match failed(ExitStatus::from_raw(raw), text, kind_of_exit) {
            Outcome::Failed { kind, error, exit_code, notes } => (kind, error, exit_code, notes),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_panic_and_a_signal_are_crashes_with_their_message() {
        let text = "rivet: two rows were left out\n\nthread 'main' panicked at src/x.rs:1:2:\nindex out of bounds\n";
        let (kind, error, code, notes) = failed_with(101 << 8, text);
        assert_eq!((kind, code, notes.as_str()), (ErrorKind::Crash, Some(101), "rivet: two rows were left out"));
        assert!(error.starts_with("thread 'main' panicked") && error.ends_with("index out of bounds"), "{error}");
        let (kind, error, code, _) = failed_with(9, "");
        assert_eq!((kind, code), (ErrorKind::Crash, None));
        assert!(error.starts_with("ended by signal 9 (SIGKILL"), "{error}");
    }

    #[test]
    fn the_last_message_is_the_error_and_the_exit_code_its_kind() {
        let (kind, error, code, notes) =
            failed_with(65 << 8, "rivet: a note\nrivet: log.csv: no torque\nlines of it\n");
        assert_eq!((kind, code), (ErrorKind::Data, Some(65)));
        assert_eq!((error.as_str(), notes.as_str()), ("log.csv: no torque\nlines of it", "rivet: a note"));
        assert_eq!(failed_with(70 << 8, "rivet: why").0, ErrorKind::Other);
        assert_eq!(failed_with(70 << 8, "").1, "ended with exit code 70");
    }

    #[test]
    fn workers_share_the_processors() {
        let allowed = sched_getaffinity(None).expect("an affinity").count();
        let share = |place, workers| processors(place, workers).expect("a share").count();
        assert_eq!(share(0, 1), allowed);
        let count = allowed as usize;
        assert_eq!((0..count).map(|k| share(k, count)).sum::<u32>(), allowed);
        assert!((0..3 * count).all(|k| share(k, 3 * count) == 1));
    }
}
