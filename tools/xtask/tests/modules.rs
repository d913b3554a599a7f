//! Imports between the modules of a crate go one way.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Every crate of the product, as a folder below the workspace.
fn crates() -> Vec<String> {
    let below = std::fs::read_dir(workspace().join("crates")).expect("the folder is there");
    let names = below.map(|entry| format!("crates/{}", entry.expect("an entry").file_name().to_string_lossy()));
    let top = ["daemon", "controller", "ipc-schema", "librivet", "config", "cli"].map(str::to_owned);
    let mut all: Vec<String> = top.into_iter().chain(names).collect();
    all.retain(|name| workspace().join(name).join("src").is_dir());
    all.sort();
    all
}

/// Modules below `folder`, by their paths (`page::html`), with their sources up to the tests.
fn modules(folder: &Path, parent: &str, found: &mut BTreeMap<String, String>) {
    for entry in std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path()) {
        let stem = entry.file_stem().expect("a name").to_string_lossy().into_owned();
        let name = if parent.is_empty() { stem.clone() } else { format!("{parent}::{stem}") };
        if entry.is_dir() {
            modules(&entry, &name, found);
        } else if entry.extension().is_some_and(|extension| extension == "rs") && stem != "lib" && stem != "main" {
            let text = std::fs::read_to_string(&entry).expect("a source");
            let name = if stem == "mod" { parent.to_owned() } else { name };
            let source = text.split("#[cfg(test)]\nmod ").next().unwrap_or_default();
            found.insert(name, source.to_owned());
        }
    }
}

/// Paths after `crate::` in a source: `a::b::C`, and each of `{a::B, c::D}`.
fn imports(source: &str) -> Vec<String> {
    let is_path = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
    let mut paths = Vec::new();
    for rest in source.split("crate::").skip(1) {
        if let Some(list) = rest.strip_prefix('{') {
            let list = list.split(';').next().unwrap_or_default();
            paths.extend(list.split(',').map(|part| part.trim().chars().take_while(|c| is_path(*c)).collect()));
        } else {
            paths.push(rest.chars().take_while(|c| is_path(*c)).collect());
        }
    }
    paths
}

/// The modules that each one imports; a parent may import its children.
fn edges(modules: &BTreeMap<String, String>) -> BTreeMap<&str, BTreeSet<&str>> {
    let target = |path: &str| {
        let parts: Vec<&str> = path.trim_end_matches(':').split("::").collect();
        let longest = (1..=parts.len()).rev().map(|n| parts[..n].join("::"));
        longest.into_iter().find_map(|name| modules.get_key_value(&name).map(|(key, _)| key.as_str()))
    };
    let imported = |(name, source): (&String, &String)| {
        let to = imports(source).iter().filter_map(|path| target(path)).collect::<BTreeSet<&str>>();
        to.into_iter().filter(|to| to != name && !name.starts_with(&format!("{to}::"))).collect()
    };
    modules.iter().map(|entry| (entry.0.as_str(), imported(entry))).collect()
}

/// Modules that reach each other.
fn circles(edges: &BTreeMap<&str, BTreeSet<&str>>) -> Vec<Vec<String>> {
    let reached = |from: &str| {
        let mut seen = BTreeSet::new();
        let mut next: Vec<&str> = edges[from].iter().copied().collect();
        while let Some(name) = next.pop() {
            if seen.insert(name.to_owned()) {
                next.extend(edges[name].iter().copied());
            }
        }
        seen
    };
    let reach: BTreeMap<&str, BTreeSet<String>> = edges.keys().map(|name| (*name, reached(name))).collect();
    let mut found: Vec<Vec<String>> = Vec::new();
    for (name, reaches) in &reach {
        let ring: Vec<String> = reaches.iter().filter(|other| reach[other.as_str()].contains(*name)).cloned().collect();
        if ring.len() > 1 && !found.contains(&ring) {
            found.push(ring);
        }
    }
    found
}

#[test]
fn no_crate_has_a_circle_of_modules() {
    let mut wrong = Vec::new();
    for name in crates() {
        let mut found = BTreeMap::new();
        modules(&workspace().join(&name).join("src"), "", &mut found);
        let rings = circles(&edges(&found));
        if !rings.is_empty() {
            wrong.push(format!("{name}: {rings:?}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn a_circle_is_found_and_a_chain_is_none() {
    let modules = |sources: [(&str, &str); 3]| sources.map(|(name, text)| (name.to_owned(), text.to_owned())).into();
    let chain: BTreeMap<String, String> =
        modules([("a", "use crate::{b::B, c::d::D};"), ("b", "use crate::c::C;"), ("c", "fn c() {}")]);
    assert!(circles(&edges(&chain)).is_empty());
    let ring: BTreeMap<String, String> =
        modules([("a", "use crate::{b::B, other::X};"), ("b", "fn b() { crate::c::f() }"), ("c", "use crate::a::A;")]);
    assert_eq!(circles(&edges(&ring)), [["a", "b", "c"]]);
}
