//! The examples of the Python package, where Python, numpy and pytest are at hand.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Modules without which the examples do not run.
const MODULES: [&str; 2] = ["numpy", "pytest"];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
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

/// Why the examples cannot run here; none where they can.
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
        // Past the test harness, which keeps what a passing test prints to itself.
        let _ = writeln!(std::io::stderr(), "SKIPPED: {why}");
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    // Nothing is installed into the Python that runs this: the package lies in a folder of its own, with what cargo built for this test.
    let site = folder.path().join("site");
    let package = site.join("rivet");
    std::fs::create_dir_all(&package).expect("a folder");
    for entry in std::fs::read_dir(root().join("python/rivet")).expect("the package") {
        let file = entry.expect("an entry").path();
        if file.extension().is_some_and(|kind| kind == "py" || kind == "pyi" || kind == "typed") {
            std::fs::copy(&file, package.join(file.file_name().expect("a name"))).expect("copied");
        }
    }
    let this = std::env::current_exe().expect("a running test has a file");
    let native = this.parent().expect("a folder").join("lib_native.so");
    std::os::unix::fs::symlink(&native, package.join("_native.abi3.so")).expect("linked");
    let tested = run(python()
        // Python looks in the present folder first.
        .current_dir(folder.path())
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
