//! `rivet blind run`: every case of a folder, each in a process that is given a robot file and logs and nothing else.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use anyhow::{Context, Result, bail};
use rivet_files::write_whole;
use rivet_report::Document;
use serde_json::{Value, json};

use crate::table::{show, show_json};

/// Arguments of `rivet blind run`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder with one folder per case: robot.toml and logs (.parquet or .csv). The last log by name is held out.
    #[arg(value_name = "DIR")]
    cases: PathBuf,
    /// File for the verdicts: one JSON object from case names to diagnoses.
    #[arg(long, value_name = "VERDICTS.json")]
    out: PathBuf,
    /// Cases in parallel.
    #[arg(long, default_value_t = thread::available_parallelism().map_or(1, usize::from))]
    jobs: usize,
    /// Print the counts as JSON (docs/operating.md).
    #[arg(long)]
    json: bool,
}

/// Runs all cases; a case that fails has its error as its verdict.
pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let cases = cases(&args.cases)?;
    let program = std::env::current_exe().context("the path of this program")?;
    let next = AtomicUsize::new(0);
    let verdicts: Mutex<BTreeMap<String, Value>> = Mutex::new(BTreeMap::new());
    thread::scope(|scope| {
        for _ in 0..args.jobs.clamp(1, 64) {
            scope.spawn(|| {
                while let Some((name, folder)) = cases.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let verdict =
                        diagnose(&program, folder).unwrap_or_else(|why| json!({ "error": format!("{why:#}") }));
                    let word = verdict["verdict"].as_str().unwrap_or("failed").to_owned();
                    let mut all = verdicts.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
                    all.insert(name.clone(), verdict);
                    rivet_files::note(format_args!("{:>3} of {}  {name}  {word}", all.len(), cases.len()));
                }
            });
        }
    });
    let verdicts = verdicts.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    let failed = verdicts.values().filter(|v| v.get("error").is_some()).count();
    write_whole(&args.out, rivet_files::printable_json(serde_json::to_string_pretty(&verdicts)? + "\n"))
        .with_context(|| args.out.display().to_string())?;
    if args.json {
        let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
        for verdict in verdicts.values() {
            *counts.entry(verdict["verdict"].as_str().unwrap_or("failed")).or_default() += 1;
        }
        show_json(
            &json!({ "file": args.out.display().to_string(), "cases": verdicts.len(), "failed": failed, "verdicts": counts }),
        )?;
        return Ok(ExitCode::from(u8::from(failed > 0)));
    }
    show(&format!("{} verdicts written to {}, {failed} failed\n", verdicts.len(), args.out.display()))?;
    Ok(ExitCode::from(u8::from(failed > 0)))
}

/// Name and folder of every case, in the order of names.
fn cases(root: &Path) -> Result<Vec<(String, PathBuf)>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(root).with_context(|| root.display().to_string())? {
        let path = entry?.path();
        if path.join("robot.toml").is_file() {
            let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
            found.push((name, path));
        }
    }
    if found.is_empty() {
        bail!("{}: no folder in it has a robot.toml", root.display());
    }
    found.sort();
    Ok(found)
}

fn logs(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut logs = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.extension().is_some_and(|e| e == "parquet" || e == "csv") {
            logs.push(path);
        }
    }
    if logs.is_empty() {
        bail!("{}: no log (.parquet or .csv)", folder.display());
    }
    logs.sort();
    Ok(logs)
}

fn diagnose(program: &Path, folder: &Path) -> Result<Value> {
    let logs = logs(folder)?;
    let temporary = tempfile::tempdir().context("a folder for the verdict")?;
    let scratch = temporary.path().join("verdict.json");
    let output = Command::new(program)
        .arg("diagnose")
        .arg(folder.join("robot.toml"))
        .args(&logs)
        .arg("--json")
        .arg(&scratch)
        .stdout(Stdio::null())
        .output()
        .context("starting rivet diagnose")?;
    let text = std::fs::read_to_string(&scratch);
    let Ok(text) = text else { bail!("{}", String::from_utf8_lossy(&output.stderr).trim().to_owned()) };
    let document: Document = serde_json::from_str(&text)?;
    Ok(serde_json::to_value(document.brief())?)
}
