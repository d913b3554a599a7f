//! The Python package is built and its examples run, where Python and what the build needs are at hand.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Modules without which neither the build nor the examples run.
const MODULES: [&str; 3] = ["maturin", "numpy", "pytest"];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Python of `RIVET_PYTHON`, else `python3`.
fn python() -> Command {
    Command::new(std::env::var_os("RIVET_PYTHON").unwrap_or_else(|| "python3".into()))
}

fn run(command: &mut Command) -> Output {
    command.output().unwrap_or_else(|why| panic!("{command:?}: {why}"))
}

fn text(output: &Output) -> String {
    [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned()).concat()
}

/// Why the package cannot be built here; none where it can.
fn missing() -> Option<String> {
    let import = format!("import {}", MODULES.join(", "));
    match python().args(["-c", &import]).output() {
        Err(why) => Some(format!("no Python: {why}")),
        Ok(output) if !output.status.success() => Some(format!(
            "Python lacks a module: {}; pip install {}",
            text(&output).lines().last().unwrap_or_default(),
            MODULES.join(" ")
        )),
        Ok(_) => None,
    }
}

#[test]
fn examples_of_the_python_package_pass() {
    if let Some(why) = missing() {
        eprintln!("skipped: {why}");
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    // Nothing is installed into the Python that runs this: the package is unpacked into a folder of its own.
    let wheel = folder.path().join("wheel");
    let built = run(python()
        .args(["-m", "maturin", "build", "--release", "--locked", "--out"])
        .arg(&wheel)
        // Its settings name the folder of the build.
        .current_dir(root().join("python"))
        .env_remove("CARGO_MANIFEST_DIR"));
    assert!(built.status.success(), "{}", text(&built));
    let file = std::fs::read_dir(&wheel).expect("the folder of the wheel").next().expect("a wheel").expect("an entry");
    assert!(file.file_name().to_string_lossy().contains("-abi3-"), "{file:?}");
    let site = folder.path().join("site");
    let unpacked = run(python().args(["-m", "zipfile", "-e"]).arg(file.path()).arg(&site));
    assert!(unpacked.status.success(), "{}", text(&unpacked));
    let tested = run(python()
        .args(["-m", "pytest", "-q", "-rs", "-p", "no:cacheprovider"])
        .arg(root().join("python/tests"))
        .env("PYTHONPATH", &site)
        .env("PYTHONDONTWRITEBYTECODE", "1"));
    let report = text(&tested);
    eprintln!("{report}");
    assert!(tested.status.success(), "{report}");
    let passed =
        report.split_whitespace().zip(report.split_whitespace().skip(1)).find(|(_, word)| word.starts_with("passed"));
    let passed: usize = passed.and_then(|(count, _)| count.parse().ok()).unwrap_or(0);
    assert!(passed >= 20, "20 examples at least: {report}");
}
