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

/// Folders of a crate in the order in which they may be imported, from the line `//! order: a, b, c` of its `lib.rs`.
fn order(lib: &str) -> Vec<&str> {
    let line = lib.lines().find_map(|line| line.strip_prefix("//! order: "));
    line.map(|line| line.split(',').map(str::trim).collect()).unwrap_or_default()
}

/// Imports of `modules` from a folder that comes later in `order`, and folders without a place in it.
fn against_the_order(modules: &BTreeMap<String, String>, order: &[&str]) -> Vec<String> {
    let place = |path: &str| order.iter().position(|folder| path.split("::").next() == Some(*folder));
    let mut wrong = Vec::new();
    for (name, source) in modules {
        let Some(own) = place(name) else {
            wrong.push(format!("{name} has no place in the order"));
            continue;
        };
        let later = imports(source).into_iter().filter(|path| place(path).is_some_and(|of_import| of_import > own));
        wrong.extend(later.map(|path| format!("{name} imports {path}")));
        if source.contains("super::super::") {
            wrong.push(format!("{name} names a folder by `super::super`, which this test does not follow"));
        }
    }
    wrong
}

#[test]
fn folders_of_the_diagnosis_import_in_one_direction() {
    let source = workspace().join("crates/diagnosis/src");
    let lib = std::fs::read_to_string(source.join("lib.rs")).expect("the crate is there");
    let mut found = BTreeMap::new();
    modules(&source, "", &mut found);
    let order = order(&lib);
    assert!(order.len() >= 10 && found.len() > order.len(), "{order:?}");
    let wrong = against_the_order(&found, &order);
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Lines of sources outside `effects` that name an effect or a form by its variant.
fn named_variants(folder: &Path) -> Vec<String> {
    let is_variant = |line: &str, list: &str| {
        let mut after = line.split(list).skip(1);
        after.any(|rest| rest.starts_with(|c: char| c.is_ascii_uppercase()) && !rest.starts_with("ALL"))
    };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path()) {
        if entry.is_dir() {
            if entry.file_name().is_some_and(|name| name != "effects") {
                found.extend(named_variants(&entry));
            }
            continue;
        }
        let text = std::fs::read_to_string(&entry).expect("a source");
        let named = text.lines().filter(|line| is_variant(line, "Form::") || is_variant(line, "Effect::"));
        found.extend(named.map(|line| format!("{}: {}", entry.display(), line.trim())));
    }
    found
}

#[test]
fn effects_are_named_in_their_own_files_only() {
    let source = workspace().join("crates/diagnosis/src");
    let found = named_variants(&source);
    assert!(found.is_empty(), "{}", found.join("\n"));
    assert!(!named_variants(&source.join("effects")).is_empty(), "the files of the effects name them");
}

#[test]
fn an_import_against_the_order_is_found() {
    let modules = |sources: [(&str, &str); 2]| sources.map(|(name, text)| (name.to_owned(), text.to_owned())).into();
    let order = order("//! A crate.\n//!\n//! order: low, high\n");
    assert_eq!(order, ["low", "high"]);
    let along: BTreeMap<String, String> =
        modules([("low::a", "use crate::low::b::B;"), ("high::c", "use crate::{low::a::A, high::d::D};")]);
    assert!(against_the_order(&along, &order).is_empty());
    let against: BTreeMap<String, String> =
        modules([("low::a", "fn a() { crate::high::c::f() }"), ("other::b", "use crate::low::a::A;")]);
    let wrong = ["low::a imports high::c::f", "other::b has no place in the order"];
    assert_eq!(against_the_order(&against, &order), wrong);
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
