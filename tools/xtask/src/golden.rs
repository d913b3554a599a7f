//! `cargo xtask golden`: hashes of diagnoses and exports, stored once and compared after every change that may change no result.

mod cases;
mod digest;
mod measured;

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use serde_json::{Value, json};

use cases::{Case, Source};
use digest::{Digest, differing_leaves, of_files, without_prose};

/// Leaves of the JSON that are shown per case that differs.
const MAX_LEAVES_SHOWN: usize = 12;

/// Arguments of `cargo xtask golden`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Compare with the stored hashes; ends with 1 where a case differs.
    #[arg(long)]
    check: bool,
    /// Take this many cases, spread over all sets.
    #[arg(long, value_name = "N")]
    cases: Option<usize>,
    /// Take the cases whose name (`set/case`) contains this text; may be repeated.
    #[arg(long, value_name = "TEXT")]
    filter: Vec<String>,
    /// Replace hashes that are stored. Without this only cases without a hash are added.
    #[arg(long, conflicts_with = "check")]
    replace: bool,
    /// Program to run [default: target/release/rivet, which must be up to date].
    #[arg(long, value_name = "FILE")]
    program: Option<PathBuf>,
    /// Folder with the data of the cases [default: ../shared].
    #[arg(long, value_name = "DIR")]
    shared: Option<PathBuf>,
    /// Python with numpy and pyarrow, which draws the cases of the independent simulator.
    #[arg(long, default_value = "python3")]
    python: PathBuf,
    /// Cases in parallel.
    #[arg(long, default_value_t = thread::available_parallelism().map_or(1, usize::from))]
    jobs: usize,
    /// List the cases and stop.
    #[arg(long)]
    list: bool,
}

/// Where the command reads and writes.
struct Places {
    /// Root of the checkout.
    root: PathBuf,
    program: PathBuf,
    /// Data of the cases.
    shared: PathBuf,
    /// Drawn cases, and the JSON behind the stored hashes.
    scratch: PathBuf,
    /// The stored hashes.
    stored: PathBuf,
}

impl Places {
    fn find(args: &Args) -> Result<Places> {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().context("the checkout")?;
        let program = args.program.clone().unwrap_or_else(|| root.join("target/release/rivet"));
        let program = program
            .canonicalize()
            .with_context(|| format!("{}: no program; `cargo build --release -p rivet` makes it", program.display()))?;
        Ok(Places {
            shared: args.shared.clone().unwrap_or_else(|| root.join("../shared")),
            scratch: root.join("target/golden"),
            stored: root.join("tools/xtask/golden.json"),
            program,
            root,
        })
    }

    /// The normalised JSON behind the stored hash of a case, kept on this machine only.
    fn reference(&self, case: &str) -> PathBuf {
        self.scratch.join("reference").join(format!("{}.json", case.replace('/', "-")))
    }
}

/// What became of a case.
enum Outcome {
    /// A hash was added or replaced.
    Stored,
    Equal,
    /// A line for each field that differs.
    Different(Vec<String>),
    /// The data of the case are not those that were hashed.
    OtherData,
    /// No hash is stored for it.
    NotStored,
    /// A hash is stored, and `--replace` was not given.
    Kept,
}

impl Outcome {
    fn word(&self) -> &'static str {
        match self {
            Outcome::Stored => "stored",
            Outcome::Equal => "equal",
            Outcome::Different(_) => "DIFFERENT",
            Outcome::OtherData => "skipped: its data are not those of the stored hash",
            Outcome::NotStored => "skipped: no hash is stored",
            Outcome::Kept => "kept: a hash is stored (--replace)",
        }
    }
}

/// By case: what became of it, and its hashes where they are new.
type Outcomes = BTreeMap<String, Result<(Outcome, Option<Digest>)>>;

/// Runs the cases and stores or compares their hashes.
///
/// # Errors
/// A case that differs, and whatever keeps a case from being run.
pub(crate) fn run(args: &Args) -> Result<()> {
    let places = Places::find(args)?;
    let (all, absent) = cases::all(&places, &args.python, &args.filter)?;
    for reason in &absent {
        note(&format!("skipped: {reason}"));
    }
    let chosen = cases::choose(all, &args.filter, args.cases);
    if args.list {
        for case in &chosen {
            println!("{}", case.name);
        }
        return Ok(());
    }
    let stored = read_stored(&places.stored)?;
    let (next, done, begun) = (AtomicUsize::new(0), AtomicUsize::new(0), Instant::now());
    let outcomes: Mutex<Outcomes> = Mutex::default();
    thread::scope(|scope| {
        for _ in 0..args.jobs.clamp(1, chosen.len().max(1)) {
            scope.spawn(|| {
                while let Some(case) = chosen.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let started = Instant::now();
                    let outcome = judge(&places, case, stored.get(&case.name), args);
                    let word = outcome.as_ref().map_or("FAILED", |(outcome, _)| outcome.word());
                    let count = done.fetch_add(1, Ordering::Relaxed) + 1;
                    let remaining_s = begun.elapsed().as_secs_f64() / count as f64 * (chosen.len() - count) as f64;
                    let spent_s = started.elapsed().as_secs_f64();
                    note(&format!(
                        "{count:>3} of {}, {remaining_s:.0} s to go: {} {spent_s:.1} s {word}",
                        chosen.len(),
                        case.name
                    ));
                    let mut all = outcomes.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
                    all.insert(case.name.clone(), outcome);
                }
            });
        }
    });
    let outcomes = outcomes.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    if args.check
        && !outcomes.values().any(|outcome| matches!(outcome, Err(_) | Ok((Outcome::Equal | Outcome::Different(_), _))))
    {
        bail!("no case was compared: none of those taken has a stored hash and the data behind it");
    }
    finish(&places, stored, outcomes, &absent)
}

/// Writes what is new, prints what differs and the counts.
fn finish(places: &Places, mut stored: BTreeMap<String, Digest>, outcomes: Outcomes, absent: &[String]) -> Result<()> {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    let mut failures = 0;
    let mut is_new = false;
    for (name, outcome) in outcomes {
        match outcome {
            Ok((outcome, digest)) => {
                *counts.entry(outcome.word()).or_default() += 1;
                if let Outcome::Different(lines) = &outcome {
                    failures += 1;
                    println!("{name}:");
                    for line in lines {
                        println!("    {line}");
                    }
                }
                if let (Outcome::Stored, Some(digest)) = (outcome, digest) {
                    is_new = true;
                    stored.insert(name, digest);
                }
            }
            Err(why) => {
                failures += 1;
                *counts.entry("FAILED").or_default() += 1;
                println!("{name}: {why:#}");
            }
        }
    }
    if is_new {
        rivet_files::write_whole(&places.stored, stored_text(&stored)?)
            .with_context(|| places.stored.display().to_string())?;
    }
    let counts: Vec<String> = counts.iter().map(|(word, count)| format!("{count} {word}")).collect();
    println!("{}; {} sets or cases without data", counts.join(", "), absent.len());
    if failures > 0 {
        bail!("{failures} cases differ or failed");
    }
    Ok(())
}

/// Diagnoses one case and compares or prepares its hashes.
fn judge(places: &Places, case: &Case, stored: Option<&Digest>, args: &Args) -> Result<(Outcome, Option<Digest>)> {
    match stored {
        Some(_) if !args.check && !args.replace => return Ok((Outcome::Kept, None)),
        None if args.check => return Ok((Outcome::NotStored, None)),
        _ => {}
    }
    let folder = tempfile::tempdir().context("a folder for the case")?;
    let robot = prepare(places, case, folder.path())?;
    let inputs = of_files(case.inputs(&robot).iter().map(PathBuf::as_path))?;
    if let (true, Some(stored)) = (args.check, stored)
        && stored.inputs != inputs
    {
        return Ok((Outcome::OtherData, None));
    }
    let (json, export) = diagnose(places, &robot, &case.logs, folder.path())?;
    let digest = Digest::new(inputs, &json, &export)?;
    let reference = places.reference(&case.name);
    if let (true, Some(stored)) = (args.check, stored) {
        if *stored == digest {
            return Ok((Outcome::Equal, None));
        }
        let mut lines = stored.differences(&digest);
        // The JSON behind the hash says which values differ, where this machine still has it.
        let kept: Option<Value> = std::fs::read(&reference).ok().and_then(|text| serde_json::from_slice(&text).ok());
        if let Some(kept) = kept.filter(|kept| stored.is_of(kept)) {
            let leaves = differing_leaves(&kept, &json);
            lines.extend(leaves.iter().take(MAX_LEAVES_SHOWN).cloned());
            if leaves.len() > MAX_LEAVES_SHOWN {
                lines.push(format!("and {} more values", leaves.len() - MAX_LEAVES_SHOWN));
            }
        }
        return Ok((Outcome::Different(lines), None));
    }
    if let Some(parent) = reference.parent() {
        std::fs::create_dir_all(parent).with_context(|| parent.display().to_string())?;
    }
    std::fs::write(&reference, serde_json::to_vec(&json)?).with_context(|| reference.display().to_string())?;
    Ok((Outcome::Stored, Some(digest)))
}

/// The robot file of a case: its own, a changed copy, or one that was identified.
fn prepare(places: &Places, case: &Case, folder: &Path) -> Result<PathBuf> {
    let file = match &case.source {
        Source::File(path) => return Ok(path.clone()),
        Source::Changed { robot, edits } => {
            let text = std::fs::read_to_string(robot).with_context(|| robot.display().to_string())?;
            let mut text = text;
            for edit in edits {
                text = edit.apply(&text)?;
            }
            std::fs::copy(robot.with_file_name("robot.urdf"), folder.join("robot.urdf")).context("a URDF")?;
            let file = folder.join("robot.toml");
            std::fs::write(&file, text).with_context(|| file.display().to_string())?;
            file
        }
    };
    let Some(identify) = &case.identify else { return Ok(file) };
    let identified = folder.join("identified");
    let mut command = Command::new(&places.program);
    command.arg("identify").arg(&file).args(&identify.logs).args(&identify.flags).arg("--export").arg(&identified);
    let output = command.stdout(Stdio::null()).output().context("rivet identify")?;
    let model = identified.join("model.toml");
    if !model.is_file() {
        bail!("rivet identify: {}", String::from_utf8_lossy(&output.stderr).trim().to_owned());
    }
    if !identify.edits.is_empty() {
        let mut text = std::fs::read_to_string(&model)?;
        for edit in &identify.edits {
            text = edit.apply(&text)?;
        }
        std::fs::write(&model, text)?;
    }
    Ok(model)
}

/// The JSON of a diagnosis without sentences, and the files of its export by name.
fn diagnose(
    places: &Places,
    robot: &Path,
    logs: &[PathBuf],
    folder: &Path,
) -> Result<(Value, BTreeMap<String, Vec<u8>>)> {
    let (json, export) = (folder.join("verdict.json"), folder.join("export"));
    let mut command = Command::new(&places.program);
    command.current_dir(&places.root).arg("diagnose").arg(robot).args(logs);
    let output = command
        .arg("--json")
        .arg(&json)
        .arg("--export")
        .arg(&export)
        .stdout(Stdio::null())
        .output()
        .context("rivet diagnose")?;
    let document = match std::fs::read(&json) {
        Ok(text) => without_prose(serde_json::from_slice(&text)?),
        // A log that is refused has no JSON; that it is refused is its result.
        Err(_) => json!({ "refused": output.status.code() }),
    };
    let mut files = BTreeMap::new();
    if export.is_dir() {
        for entry in std::fs::read_dir(&export)? {
            let path = entry?.path();
            let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
            files.insert(name, std::fs::read(&path)?);
        }
    }
    Ok((document, files))
}

fn read_stored(path: &Path) -> Result<BTreeMap<String, Digest>> {
    let Ok(text) = std::fs::read_to_string(path) else { return Ok(BTreeMap::new()) };
    let all: Value = serde_json::from_str(&text).with_context(|| path.display().to_string())?;
    let cases = all["cases"].as_object().with_context(|| format!("{}: no `cases`", path.display()))?;
    cases.iter().map(|(name, digest)| Ok((name.clone(), Digest::read(digest).with_context(|| name.clone())?))).collect()
}

/// One line a case, so that a change of one shows as one line.
fn stored_text(stored: &BTreeMap<String, Digest>) -> Result<String> {
    let lines: Result<Vec<String>> =
        stored.iter().map(|(name, digest)| Ok(format!("{}: {}", json!(name), digest.json()?))).collect();
    let head = json!("cargo build --release -p rivet && cargo xtask golden (compare: cargo xtask golden --check)");
    Ok(format!("{{\n\"command\": {head},\n\"cases\": {{\n{}\n}}}}\n", lines?.join(",\n")))
}

/// A line on standard error; a closed one is no reason to stop.
fn note(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stored_hashes_are_read_as_written() {
        let export = BTreeMap::from([("model.toml".to_owned(), b"a = 1\n".to_vec())]);
        let digest = Digest::new("0".to_owned(), &json!({ "verdict": "no_gap" }), &export).expect("a digest");
        let stored = BTreeMap::from([("set/case".to_owned(), digest)]);
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("golden.json");
        std::fs::write(&path, stored_text(&stored).expect("text")).expect("written");
        assert_eq!(read_stored(&path).expect("read"), stored);
    }
}
