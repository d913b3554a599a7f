//! `cargo xtask fuzz`: the fuzz targets under libFuzzer, steered by coverage.

use anyhow::{Context as _, Result, bail, ensure};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// What makes a compiler count which branches are taken and which comparisons are made; those of `cargo fuzz`, without a
/// sanitizer: the workspace has no unsafe code to speak of, and so a stable compiler does.
const COUNTED: &str = "-Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
                       -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table \
                       -Cllvm-args=-sanitizer-coverage-trace-compares -Ccodegen-units=1";

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Targets: folders of tools/fuzz/corpus; all, one after the other, without any.
    targets: Vec<String>,
    /// Time of the processor for each [s].
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u64).range(1..))]
    seconds: u64,
    /// Memory that a target may have [MB].
    #[arg(long, default_value_t = 2048)]
    memory: u32,
    /// Takes what this and earlier searches found into tools/fuzz/corpus, as few and small files as have the same coverage.
    #[arg(long)]
    keep: bool,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).context("xtask lies in the workspace")?;
    let committed = source.join("tools/fuzz/corpus");
    let mut known = crate::install::listed(&committed)?;
    known.retain(|folder| folder.is_dir());
    let mut names: Vec<String> =
        known.iter().filter_map(|folder| folder.file_name()).map(|name| name.to_string_lossy().into_owned()).collect();
    if let Some(unknown) = args.targets.iter().find(|name| !names.contains(name)) {
        bail!("{unknown}: no such target; there are {}", names.join(", "));
    }
    if !args.targets.is_empty() {
        names.clone_from(&args.targets);
    }
    let target = target_folder()?.join("fuzzing");
    let program = build(source, &target)?;
    let mut broken = Vec::new();
    for name in names {
        let fuzz = Fuzz { program: &program, name: &name, target: &target, memory: args.memory };
        let found = emptied_or_made(&target.join("corpus").join(&name), false)?;
        let mut search = fuzz.command(&found);
        search.arg(&found).env("RIVET_FUZZ_SECONDS", args.seconds.to_string());
        search.args(["-print_final_stats=1", "-use_value_profile=1", &format!("-artifact_prefix=broken-{name}-")]);
        let status = search.status().context("the search cannot be started")?;
        if !status.success() {
            broken.push(format!("{name} ({status}, {}/broken-{name}-*)", target.display()));
        } else if args.keep {
            fuzz.keep(&found, &committed.join(&name))?;
        }
    }
    ensure!(broken.is_empty(), "something broke: {}", broken.join(", "));
    Ok(())
}

/// A target's program and where it works.
struct Fuzz<'a> {
    program: &'a Path,
    name: &'a str,
    target: &'a Path,
    memory: u32,
}

impl Fuzz<'_> {
    /// The program, with the seeds of the target put into `seeded`.
    fn command(&self, seeded: &Path) -> Command {
        let mut command = Command::new(self.program);
        command.env("RIVET_FUZZ", self.name).env("RIVET_FUZZ_SEEDS", seeded).current_dir(self.target);
        command.args(["-max_len=65536", "-timeout=60", &format!("-rss_limit_mb={}", self.memory)]);
        command
    }

    /// Copies of `found` into `own` what takes a branch that the seeds do not.
    fn keep(&self, found: &Path, own: &Path) -> Result<()> {
        let merged = emptied_or_made(&self.target.join("merged").join(self.name), true)?;
        // Branches alone count: how often one is taken makes thousands of inputs.
        let mut merge = self.command(&merged);
        merge.args(["-merge=1", "-use_counters=0"]).args([&merged, found]);
        let status = merge.status().context("merging cannot be started")?;
        ensure!(status.success(), "{}: what was found cannot be merged: {status}", self.name);
        for path in crate::install::listed(&merged)? {
            let name = path.file_name().context("a listed file has a name")?;
            if !name.to_string_lossy().starts_with("seed-") {
                fs::copy(&path, own.join(name)).with_context(|| path.display().to_string())?;
            }
        }
        Ok(())
    }
}

/// A folder that is there, without what it held before if `emptied`.
fn emptied_or_made(folder: &Path, emptied: bool) -> Result<PathBuf> {
    if emptied && folder.is_dir() {
        fs::remove_dir_all(folder).with_context(|| folder.display().to_string())?;
    }
    fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    Ok(folder.to_owned())
}

/// Where this workspace is built: this program was.
fn target_folder() -> Result<PathBuf> {
    let this = std::env::current_exe().context("this program cannot find itself")?;
    Ok(this.ancestors().nth(2).context("a program lies in its profile's folder")?.to_owned())
}

/// Builds the targets in a folder of their own, so that nothing else is compiled anew for other flags.
fn build(source: &Path, target: &Path) -> Result<PathBuf> {
    // With a target named, the flags are for the program and not for what runs while it is built.
    let triple = format!("{}-unknown-linux-gnu", std::env::consts::ARCH);
    let mut cargo = Command::new(env!("CARGO"));
    cargo.current_dir(source).env("RUSTFLAGS", COUNTED).env("CARGO_TARGET_DIR", target);
    cargo.args(["build", "--locked", "--profile", "fuzz", "--target", &triple, "--package", "rivet-fuzz"]);
    cargo.args(["--features", "coverage", "--bin", "coverage"]);
    ensure!(cargo.status().context("cargo cannot be started")?.success(), "the targets do not build");
    Ok(target.join(triple).join("fuzz/coverage"))
}
