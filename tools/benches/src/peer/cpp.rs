//! Finds Pinocchio and Eigen and builds the C++ peer.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};

/// How to get what is missing.
const HINT: &str =
    "`python3 -m venv V && V/bin/pip install pin numpy scipy` and Eigen (Debian: libeigen3-dev), then --venv V";

/// Builds `peer/peer.cpp`, optimised for this machine, beside this program, unless that has been done already.
pub(crate) fn build(venv: Option<&Path>, eigen: &Path) -> Result<PathBuf> {
    let pinocchio = pinocchio(venv)?;
    if !eigen.join("Eigen/Dense").is_file() {
        bail!("no Eigen headers in {} ({HINT})", eigen.display());
    }
    let peer = std::env::current_exe().context("path of this program")?.with_file_name("rivet-peer-cpp");
    let source = rivet_benches::workload::project().join("tools/benches/peer/peer.cpp");
    let changed = |path: &Path| std::fs::metadata(path).and_then(|about| about.modified()).ok();
    if changed(&peer) > changed(&source) {
        return Ok(peer);
    }
    println!("building the C++ peer (about a minute) ...");
    let output = Command::new("c++")
        .args(["-std=c++17", "-O3", "-march=native", "-DNDEBUG", "-DEIGEN_DONT_PARALLELIZE"])
        // What Pinocchio's own package configuration asks for.
        .args(["-DBOOST_MPL_LIMIT_LIST_SIZE=30", "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS"])
        .args(["-DBOOST_MPL_LIMIT_VECTOR_SIZE=30", "-DBOOST_FUSION_INVOKE_MAX_ARITY=12"])
        .arg("-I")
        .arg(&pinocchio)
        .arg("-I")
        .arg(eigen)
        .arg(&source)
        .arg("-o")
        .arg(&peer)
        .output()
        .with_context(|| format!("no C++ compiler `c++` ({HINT})"))?;
    if !output.status.success() {
        bail!("the C++ compiler refuses {}:\n{}", source.display(), String::from_utf8_lossy(&output.stderr));
    }
    Ok(peer)
}

/// Python of the virtual environment, or of the path.
pub(crate) fn python(venv: Option<&Path>) -> PathBuf {
    venv.map_or_else(|| PathBuf::from("python3"), |venv| venv.join("bin/python"))
}

/// Folder of Pinocchio's headers: beside the Python package, else where distributions put them.
fn pinocchio(venv: Option<&Path>) -> Result<PathBuf> {
    let code = "import cmeel.config, sys; sys.stdout.write(str(cmeel.config.cmeel_config.prefix))";
    let plain = "import pinocchio, os; print(os.path.join(os.path.dirname(pinocchio.__file__), '../../../..'), end='')";
    let mut places = Vec::new();
    for code in [plain, code] {
        if let Ok(output) = Command::new(python(venv)).args(["-c", code]).output()
            && output.status.success()
        {
            places.push(PathBuf::from(String::from_utf8_lossy(&output.stdout).into_owned()));
        }
    }
    places.extend(["/opt/openrobots", "/usr/local", "/usr"].map(PathBuf::from));
    places
        .iter()
        .map(|place| place.join("include"))
        .find(|include| include.join("pinocchio/algorithm/regressor.hpp").is_file())
        .with_context(|| format!("no Pinocchio headers found ({HINT})"))
}
