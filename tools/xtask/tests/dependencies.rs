//! Crates that stand in the workspace in several versions are those that `deny.toml` accepts (`cargo deny check bans`), also where
//! cargo-deny is not installed.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

/// Versions of each crate that Linux needs in more than one, from `cargo tree`.
fn duplicates(workspace: &Path) -> BTreeMap<String, Vec<String>> {
    let mut tree = Command::new(env!("CARGO"));
    tree.args(["tree", "--workspace", "--locked", "--duplicates", "--depth", "0", "--prefix", "none"]);
    tree.args(["--target", "x86_64-unknown-linux-gnu"]).current_dir(workspace);
    let output = tree.output().expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).expect("UTF-8");
    let mut versions: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for line in text.lines() {
        let mut words = line.split_whitespace();
        let (Some(name), Some(version)) = (words.next(), words.next()) else { continue };
        versions.entry(name.to_owned()).or_default().insert(version.trim_start_matches('v').to_owned());
    }
    let several = versions.into_iter().filter(|(_, versions)| versions.len() > 1);
    several.map(|(name, versions)| (name, versions.into_iter().collect())).collect()
}

#[test]
fn crates_in_several_versions_are_those_of_deny_toml() {
    let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let text = std::fs::read_to_string(workspace.join("deny.toml")).expect("deny.toml");
    let rules: toml::Table = text.parse().expect("TOML");
    let skipped = rules["bans"]["skip"].as_array().expect("a list of crates");
    let skipped: Vec<(&str, &str)> = skipped
        .iter()
        .map(|entry| entry["crate"].as_str().expect("a crate").split_once('@').expect("name@version"))
        .collect();
    let found = duplicates(&workspace);
    let is_version = |version: &str, of: &str| version == of || version.starts_with(&format!("{of}."));
    let is_skipped =
        |name: &str, version: &str| skipped.iter().any(|(other, of)| *other == name && is_version(version, of));
    for (name, versions) in &found {
        let rest: Vec<&String> = versions.iter().filter(|version| !is_skipped(name, version)).collect();
        assert!(
            rest.len() < 2,
            "{name} is there as {rest:?}: add the older one to `skip` of deny.toml, with the reason"
        );
    }
    for (name, of) in &skipped {
        let versions = found.get(*name).map_or(&[][..], Vec::as_slice);
        assert!(
            versions.iter().any(|version| is_version(version, of)),
            "`skip` of deny.toml: {name}@{of} is not needed"
        );
    }
}
