//! `cargo xtask sbom`: bills of materials of the installed programs and the library (CycloneDX), by cargo-cyclonedx.

use crate::install::{LIBRARY, PROGRAMS, workspace};
use anyhow::{Context as _, Result, ensure};
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Name, without its ending, that cargo-cyclonedx gives to the file beside each `Cargo.toml` of the workspace.
const BESIDE_MANIFEST: &str = "rivet-bill-of-materials";

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Folder of the files [default: target/sbom]
    #[arg(long, value_name = "DIR")]
    output: Option<PathBuf>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let source = workspace()?;
    ensure!(is_installed(), "cargo-cyclonedx is not installed: cargo install cargo-cyclonedx --locked");
    let output = args.output.clone().unwrap_or_else(|| source.join("target/sbom"));
    for (path, components) in write(source, &output)? {
        println!("{}: {components} components", path.display());
    }
    Ok(())
}

pub(crate) fn is_installed() -> bool {
    let mut version = Command::new(env!("CARGO"));
    version.args(["cyclonedx", "--version"]).stdout(Stdio::null()).stderr(Stdio::null());
    version.status().is_ok_and(|status| status.success())
}

/// Writes `NAME.cdx.json` for each program and for the library; returns the paths and their numbers of components.
pub(crate) fn write(source: &Path, output: &Path) -> Result<Vec<(PathBuf, usize)>> {
    let members = members(source)?;
    let mut cyclonedx = Command::new(env!("CARGO"));
    cyclonedx.current_dir(source).args(["cyclonedx", "--quiet", "--format", "json", "--spec-version", "1.5"]);
    cyclonedx.args(["--no-build-deps", "--override-filename", BESIDE_MANIFEST]);
    let written = cyclonedx.status();
    let bills: Vec<PathBuf> =
        members.iter().map(|(_, folder)| folder.join(format!("{BESIDE_MANIFEST}.json"))).collect();
    let mut kept = Vec::new();
    for (name, package, profile) in PROGRAMS.into_iter().chain([(LIBRARY, LIBRARY, "release")]) {
        let bill = members.iter().position(|(member, _)| member == package).map(|i| &bills[i]);
        kept.push(compiled(source, profile).and_then(|crates| {
            keep(
                source,
                bill.with_context(|| format!("{package} is no package of the workspace"))?,
                &crates,
                output,
                name,
            )
        }));
    }
    // Those of the other members too: the source is left as it was.
    for bill in bills {
        let _ = fs::remove_file(bill);
    }
    ensure!(written.context("cargo cyclonedx cannot be started")?.success(), "cargo cyclonedx failed");
    kept.into_iter().collect()
}

/// Copies a bill without what is not compiled and without the place of the checkout; returns its path and number of components.
fn keep(source: &Path, bill: &Path, crates: &BTreeSet<String>, output: &Path, name: &str) -> Result<(PathBuf, usize)> {
    let text = fs::read_to_string(bill).with_context(|| bill.display().to_string())?;
    let text = text.replace(&format!("{}/", source.display()), "");
    let mut content: Value = serde_json::from_str(&text).with_context(|| bill.display().to_string())?;
    let components = prune(&mut content, crates).with_context(|| bill.display().to_string())?;
    fs::create_dir_all(output).with_context(|| output.display().to_string())?;
    let path = output.join(format!("{name}.cdx.json"));
    fs::write(&path, format!("{content:#}\n")).with_context(|| path.display().to_string())?;
    Ok((path, components))
}

/// Leaves only `crates` in a bill: cargo-cyclonedx lists optional crates too that no feature asks for. Returns their number.
fn prune(bill: &mut Value, crates: &BTreeSet<String>) -> Result<usize> {
    let word = |value: &Value, key: &str| value[key].as_str().unwrap_or_default().to_owned();
    let components = bill["components"].as_array_mut().context("a bill of materials has components")?;
    components
        .retain(|component| crates.contains(&format!("{} v{}", word(component, "name"), word(component, "version"))));
    let mut references: BTreeSet<String> = components.iter().map(|component| word(component, "bom-ref")).collect();
    let number = references.len();
    references.insert(word(&bill["metadata"]["component"], "bom-ref"));
    let dependencies = bill["dependencies"].as_array_mut().context("a bill of materials has dependencies")?;
    dependencies.retain(|dependency| references.contains(&word(dependency, "ref")));
    for dependency in dependencies {
        if let Some(needs) = dependency.get_mut("dependsOn").and_then(Value::as_array_mut) {
            needs.retain(|reference| reference.as_str().is_some_and(|reference| references.contains(reference)));
        }
    }
    Ok(number)
}

/// Crates, as `name vVERSION`, that the programs of a profile are compiled of with the features that they are installed with.
/// Procedural macros belong to them, what build scripts need does not.
pub(crate) fn compiled(source: &Path, profile: &str) -> Result<BTreeSet<String>> {
    let mut tree = Command::new(env!("CARGO"));
    tree.current_dir(source).args(["tree", "--locked", "--edges", "normal", "--prefix", "none", "--format", "{p}"]);
    for (_, package, _) in PROGRAMS.iter().filter(|(_, _, its)| *its == profile) {
        tree.args(["--package", package]);
    }
    if profile == "release" {
        tree.args(["--package", LIBRARY]);
    }
    let answer = tree.stderr(Stdio::inherit()).output().context("cargo cannot be started")?;
    ensure!(answer.status.success(), "cargo tree failed");
    let text = String::from_utf8_lossy(&answer.stdout);
    let named = |line: &str| {
        let mut words = line.split_whitespace();
        Some(format!("{} {}", words.next()?, words.next()?))
    };
    Ok(text.lines().filter_map(named).collect())
}

/// Name and folder of every package of the workspace.
fn members(source: &Path) -> Result<Vec<(String, PathBuf)>> {
    let mut metadata = Command::new(env!("CARGO"));
    metadata.current_dir(source).args(["metadata", "--locked", "--no-deps", "--format-version", "1"]);
    let answer = metadata.stderr(Stdio::inherit()).output().context("cargo cannot be started")?;
    let answer: Value = serde_json::from_slice(&answer.stdout).context("cargo metadata failed")?;
    let packages = answer["packages"].as_array().context("cargo metadata lists no packages")?;
    let member = |package: &Value| {
        let manifest = Path::new(package["manifest_path"].as_str()?);
        Some((package["name"].as_str()?.to_owned(), manifest.parent()?.to_owned()))
    };
    packages.iter().map(|package| member(package).context("a package has a name and a manifest")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn crates_that_are_not_compiled_leave_components_and_dependencies() {
        let component = |name| json!({"name": name, "version": "1.0.0", "bom-ref": format!("{name}@1.0.0")});
        let mut bill = json!({
            "metadata": {"component": {"bom-ref": "program"}},
            "components": [component("used"), component("optional")],
            "dependencies": [
                {"ref": "program", "dependsOn": ["used@1.0.0", "optional@1.0.0"]},
                {"ref": "used@1.0.0"},
                {"ref": "optional@1.0.0", "dependsOn": ["used@1.0.0"]},
            ],
        });
        let crates = BTreeSet::from(["used v1.0.0".to_owned(), "optional v2.0.0".to_owned()]);
        assert_eq!(prune(&mut bill, &crates).expect("a bill"), 1);
        assert_eq!(bill["components"], json!([component("used")]));
        assert_eq!(
            bill["dependencies"],
            json!([{"ref": "program", "dependsOn": ["used@1.0.0"]}, {"ref": "used@1.0.0"}])
        );
    }
}
