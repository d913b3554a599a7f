//! What the cross-crate tests share: the program under test, the folder of measured data, the robots.

pub use rivet_studies::batch;
pub mod altered;
pub mod closed;
pub mod process;
pub mod side;
pub mod sines;
pub mod stage;
pub mod stretch;
pub mod two_link;
pub mod ur_controller;

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

/// Root of the checkout.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("this crate lies in the workspace")
}

/// `robots/<arm>/robot.toml`.
///
/// ```
/// let text = std::fs::read_to_string(rivet_tests::robot("ur10e")).expect("the arm is there");
/// assert!(text.contains("sample_period_s"));
/// ```
pub fn robot(arm: &str) -> PathBuf {
    root().join("robots").join(arm).join("robot.toml")
}

/// `../shared/<path>`, where measured data and reference arms lie; `None`, said aloud, where they do not. A test that
/// gets `None` returns: it was skipped.
pub fn shared(path: &str) -> Option<PathBuf> {
    let found = root().join("../shared").join(path);
    if found.exists() {
        return Some(found);
    }
    // Past the test harness, which keeps what a passing test says through the macros to itself.
    let _ = writeln!(std::io::stderr(), "SKIPPED: ../shared/{path} is not on this machine");
    None
}

/// The `rivet` program of the profile these tests were built with. A test run of this package alone does not build another package's
/// program, so it is built on first use unless the run has built it: other packages' features would build most of it once more.
pub fn rivet() -> Command {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    Command::new(PROGRAM.get_or_init(|| built("rivet")))
}

/// The optional program `rivet-view`, likewise.
pub fn rivet_view() -> Command {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    Command::new(PROGRAM.get_or_init(|| built("rivet-view")))
}

/// The program of a package of the same name.
fn built(package: &str) -> PathBuf {
    let this = std::env::current_exe().expect("a running test has a file");
    // target/<profile>/deps/<test>
    let folder = this.ancestors().nth(2).expect("tests lie in target/<profile>/deps").to_owned();
    let program = folder.join(package);
    if is_newer_than_its_sources(&program) {
        return program;
    }
    let mut build = Command::new(env!("CARGO"));
    build.args(["build", "--quiet", "--package", package]).current_dir(root());
    build.arg("--target-dir").arg(folder.parent().expect("profiles lie in the target folder"));
    if !cfg!(debug_assertions) {
        build.arg("--release");
    }
    assert!(build.status().expect("cargo runs").success(), "{package} builds");
    program
}

/// Whether a program was built after every file of the workspace that it may have been made of. (Cargo writes down which ones those were
/// of what it was asked to build, and not of a program that a test needs.)
fn is_newer_than_its_sources(program: &Path) -> bool {
    let changed = |path: &Path| path.metadata().and_then(|file| file.modified()).ok();
    let Some(built) = changed(program) else { return false };
    let mut folders = vec![root().to_owned()];
    while let Some(folder) = folders.pop() {
        let Ok(entries) = std::fs::read_dir(&folder) else { return false };
        for path in entries.flatten().map(|entry| entry.path()) {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            // What cargo makes, what git keeps, and what no program is made of; of files beside the crates only Cargo's are looked at.
            if name.starts_with('.') || ["target", "tests", "docs"].contains(&&*name) {
                continue;
            }
            if path.is_dir() {
                folders.push(path);
            } else if (folder != root() || name.starts_with("Cargo."))
                && changed(&path).is_none_or(|changed| changed > built)
            {
                return false;
            }
        }
    }
    true
}

/// Runs a command to its end and returns what it printed; a failure is the test's, with everything that was said.
pub fn succeed(command: &mut Command) -> Output {
    let output = command.output().expect("the program starts");
    assert!(
        output.status.success(),
        "{command:?} ended with {}\n--- stdout\n{}\n--- stderr\n{}",
        output.status,
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    output
}
