//! Licence texts of the crates in the installed programs: MIT and BSD licences ask for their notices beside the binary.

use crate::sbom::compiled;
use anyhow::{Context as _, Result, ensure};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Name of the file below `share/doc/rivet`.
pub(crate) const FILE: &str = "third-party-licences.txt";

/// How the names of files with a licence or a notice begin, in small letters.
const BEGINNINGS: [&str; 6] = ["license", "licence", "copying", "notice", "copyright", "unlicense"];
/// Endings of files that are not text for people: `license.rs` is a module.
const OTHER_ENDINGS: [&str; 12] = ["rs", "c", "h", "cpp", "hpp", "py", "sh", "js", "json", "toml", "yml", "html"];
/// Folders in which no licence of the compiled code lies.
const OTHER_FOLDERS: [&str; 5] = ["target", "tests", "benches", "examples", "fuzz"];

/// A crate of other authors.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Crate {
    /// Name and version.
    name: String,
    /// SPDX expression of its manifest; empty where it has none.
    expression: String,
    /// As the manifest lists them.
    authors: Vec<String>,
    folder: PathBuf,
}

/// The texts for all installed programs and the library, as one file.
pub(crate) fn text(source: &Path) -> Result<String> {
    let mut names = BTreeSet::new();
    for profile in ["release", "service"] {
        names.extend(compiled(source, profile)?);
    }
    let crates = crates(source, &names)?;
    let mut texts = Vec::new();
    for krate in &crates {
        texts.push(licence_texts(&krate.folder)?);
    }
    Ok(document(&crates, &texts) + &standard_library()?)
}

/// The notices of Rust's standard library, which every program contains, by the toolchain; its licence where it comes without them.
fn standard_library() -> Result<String> {
    let mut rustc = Command::new(std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into()));
    let answer =
        rustc.args(["--print", "sysroot"]).stderr(Stdio::inherit()).output().context("rustc cannot be started")?;
    ensure!(answer.status.success(), "rustc does not name its folder");
    let sysroot = String::from_utf8_lossy(&answer.stdout).trim().to_owned();
    let path = Path::new(&sysroot).join("share/doc/rust/COPYRIGHT-library.html");
    let notices = fs::read_to_string(path).map_or_else(
        |_| "MIT OR Apache-2.0, https://github.com/rust-lang/rust/blob/master/COPYRIGHT".to_owned(),
        |page| plain(&without_markup(&page)),
    );
    Ok(section("Rust's standard library", &notices))
}

/// The text of a page without elements, characters for their references, and one empty line for many.
fn without_markup(page: &str) -> String {
    let mut text = String::with_capacity(page.len());
    for part in page.split('<') {
        text.push_str(part.split_once('>').map_or(part, |(_, behind)| behind));
    }
    for (reference, character) in [
        ("&#60;", "<"),
        ("&#62;", ">"),
        ("&#34;", "\""),
        ("&#39;", "'"),
        ("&#38;", "&"),
        ("&lt;", "<"),
        ("&gt;", ">"),
        ("&quot;", "\""),
        ("&amp;", "&"),
    ] {
        text = text.replace(reference, character);
    }
    let mut lines: Vec<&str> = text.lines().map(str::trim_end).collect();
    lines.dedup_by(|a, b| a.is_empty() && b.is_empty());
    lines.join("\n")
}

/// A text under a rule and the names of what it is for.
fn section(names: &str, text: &str) -> String {
    format!("\n{}\n{names}\n\n{text}\n", "=".repeat(80))
}

/// Crates of other authors among `names` (`name vVERSION`): what cargo knows of them.
fn crates(source: &Path, names: &BTreeSet<String>) -> Result<Vec<Crate>> {
    let mut metadata = Command::new(env!("CARGO"));
    metadata.current_dir(source).args(["metadata", "--locked", "--format-version", "1"]);
    let answer = metadata.stderr(Stdio::inherit()).output().context("cargo cannot be started")?;
    ensure!(answer.status.success(), "cargo metadata failed");
    let answer: Value = serde_json::from_slice(&answer.stdout).context("cargo metadata gives no JSON")?;
    let packages = answer["packages"].as_array().context("cargo metadata lists no packages")?;
    let members: BTreeSet<&str> =
        answer["workspace_members"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
    let mut found = BTreeSet::new();
    for package in packages {
        let word = |key: &str| package[key].as_str().unwrap_or_default();
        let is_compiled = names.contains(&format!("{} v{}", word("name"), word("version")));
        if is_compiled && !members.contains(word("id")) {
            let manifest = Path::new(word("manifest_path"));
            found.insert(Crate {
                name: format!("{} {}", word("name"), word("version")),
                expression: word("license").to_owned(),
                authors: package["authors"]
                    .as_array()
                    .into_iter()
                    .flatten()
                    .filter_map(Value::as_str)
                    .map(str::to_owned)
                    .collect(),
                folder: manifest.parent().context("a manifest lies in a folder")?.to_owned(),
            });
        }
    }
    Ok(found.into_iter().collect())
}

/// Texts of the licence files in a folder and below it: sources of other languages in a crate have their own.
fn licence_texts(folder: &Path) -> Result<Vec<String>> {
    let mut found = Vec::new();
    let mut paths = crate::install::listed(folder)?;
    paths.sort_by_key(|path| path.is_dir());
    for path in paths.iter().filter(|path| !path.is_symlink() || path.is_file()) {
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        if path.is_dir() {
            if !OTHER_FOLDERS.contains(&name.as_str()) && !name.starts_with('.') {
                found.extend(licence_texts(path)?);
            }
        } else if is_licence(path, &name) {
            let bytes = fs::read(path).with_context(|| path.display().to_string())?;
            found.push(plain(&String::from_utf8_lossy(&bytes)));
        }
    }
    Ok(found)
}

fn is_licence(path: &Path, name: &str) -> bool {
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default();
    let is_in_folder =
        path.parent().and_then(Path::file_name).is_some_and(|name| name.eq_ignore_ascii_case("licenses"));
    let is_named = BEGINNINGS.iter().any(|beginning| name.starts_with(beginning));
    (is_named || is_in_folder) && !OTHER_ENDINGS.contains(&ending.as_str())
}

/// A text without the differences that copies of it have: line ends, spaces before them, empty lines around it.
fn plain(text: &str) -> String {
    let lines: Vec<&str> = text.lines().map(str::trim_end).collect();
    lines.join("\n").trim_matches('\n').to_owned()
}

/// The file: an overview of the crates, then each text once with the crates that use it.
fn document(crates: &[Crate], texts: &[Vec<String>]) -> String {
    let mut users: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for (krate, texts) in crates.iter().zip(texts) {
        for text in texts.iter().filter(|text| !text.is_empty()) {
            users.entry(text).or_default().insert(&krate.name);
        }
    }
    let mut out = String::from(
        "Licences of the crates in the programs and the library of rivet\n\n\
         Each line has a crate, its version and the licence that its manifest states (SPDX).\n\
         The texts follow, as the crates have them, each with the crates that it comes from.\n\n",
    );
    let mut without = Vec::new();
    for (krate, texts) in crates.iter().zip(texts) {
        let expression = if krate.expression.is_empty() { "no expression" } else { &krate.expression };
        let line = format!("{}: {expression}\n", krate.name);
        out.push_str(&line);
        if texts.iter().all(String::is_empty) {
            without.push((krate, line));
        }
    }
    if !without.is_empty() {
        out.push_str(
            "\nThese crates have no text of their own. Their licence is the one stated. The standard text of SPDX is at the end:\n\n",
        );
        out.extend(without.iter().map(|(_, line)| line.as_str()));
    }
    // Texts of many crates first.
    let mut users: Vec<_> = users.into_iter().collect();
    users.sort_by_key(|(text, crates)| (std::cmp::Reverse(crates.len()), *text));
    for (text, crates) in users {
        let crates: Vec<&str> = crates.into_iter().collect();
        out.push_str(&section(&crates.join(", "), text));
    }
    let mut standard: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    for (krate, _) in &without {
        let authors =
            if krate.authors.is_empty() { "authors of the crate".to_owned() } else { krate.authors.join(", ") };
        for name in standard_names(&krate.expression) {
            standard.entry(name).or_default().push(format!("{}, copyright of {authors}", krate.name));
        }
    }
    for (name, crates) in standard {
        let text = spdx::license_id(name).map_or("", |id| id.text());
        out.push_str(&section(&format!("{name}, the standard text, for:\n{}", crates.join("\n")), &plain(text)));
    }
    out
}

/// Licences whose texts an expression asks for: Apache-2.0 where it suffices, as its text holds no names of authors; else all of them.
/// Empty for what is no expression.
fn standard_names(expression: &str) -> BTreeSet<&'static str> {
    let Ok(parsed) = spdx::Expression::parse_mode(expression, spdx::ParseMode::LAX) else { return BTreeSet::new() };
    let name = |licence: &spdx::LicenseReq| licence.license.id().map(|id| id.name);
    if parsed.evaluate(|licence| name(licence) == Some("Apache-2.0") && licence.addition.is_none()) {
        return BTreeSet::from(["Apache-2.0"]);
    }
    parsed.requirements().filter_map(|requirement| name(&requirement.req)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(folder: &Path, files: &[(&str, &str)]) {
        for (name, text) in files {
            let path = folder.join(name);
            fs::create_dir_all(path.parent().expect("a folder")).expect("made");
            fs::write(path, text).expect("written");
        }
    }

    #[test]
    fn each_text_stands_once_with_its_crates_and_crates_without_one_are_listed() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        write(
            &at("a"),
            &[
                ("LICENSE-MIT", "Copyright A\r\n\r\nMIT  \r\n"),
                ("LICENSE-APACHE", "Apache\n"),
                ("src/license.rs", "code"),
            ],
        );
        write(
            &at("b"),
            &[("LICENCE.md", "\nApache"), ("zstd/COPYING", "GPL"), ("NOTICE", "Notice B"), ("tests/LICENSE", "data")],
        );
        write(&at("c"), &[("LICENSES/BSD-3-Clause.txt", "Copyright C")]);
        write(&at("d"), &[("README.md", "no licence")]);
        let krate = |name: &str, expression: &str| Crate {
            name: format!("{name} 1.0.0"),
            expression: expression.to_owned(),
            authors: vec![format!("Author of {name}")],
            folder: at(name),
        };
        let crates =
            [krate("a", "MIT OR Apache-2.0"), krate("b", "Apache-2.0"), krate("c", "BSD-3-Clause"), krate("d", "ISC")];
        let texts: Vec<_> = crates.iter().map(|krate| licence_texts(&krate.folder).expect("read")).collect();
        let text = document(&crates, &texts);
        assert_eq!(text.matches("\nApache\n").count(), 1, "{text}");
        assert!(text.contains("\na 1.0.0, b 1.0.0\n\nApache\n"), "{text}");
        for wanted in [
            "\na 1.0.0\n\nCopyright A\n\nMIT\n",
            "\nb 1.0.0\n\nGPL\n",
            "\nb 1.0.0\n\nNotice B\n",
            "\nc 1.0.0\n\nCopyright C\n",
        ] {
            assert!(text.contains(wanted), "{wanted:?}: {text}");
        }
        let (_, without) = text.split_once("no text of their own").expect("a list");
        assert!(without.contains("\nd 1.0.0: ISC\n") && !without.contains("c 1.0.0: BSD"), "{text}");
        assert!(!text.contains("src/license.rs") && !text.contains("\ncode") && !text.contains("\ndata"), "{text}");
        let (_, standard) = text.split_once("ISC, the standard text, for:\n").expect("a standard text");
        assert!(standard.starts_with("d 1.0.0, copyright of Author of d\n"), "{standard}");
        assert!(standard.contains("Permission to use, copy, modify"), "{standard}");
    }

    #[test]
    fn one_licence_suffices_where_authors_leave_the_choice() {
        assert_eq!(standard_names("MIT OR Apache-2.0"), BTreeSet::from(["Apache-2.0"]));
        assert_eq!(standard_names("MIT/Apache-2.0"), BTreeSet::from(["Apache-2.0"]));
        assert_eq!(standard_names("MIT AND Apache-2.0"), BTreeSet::from(["Apache-2.0", "MIT"]));
        assert_eq!(standard_names("BSD-3-Clause"), BTreeSet::from(["BSD-3-Clause"]));
        assert_eq!(standard_names("no expression"), BTreeSet::new());
    }

    #[test]
    fn pages_become_text() {
        let page = "<html><body>\n<h1>Notices</h1>\n\n\n<pre>A &#60;a@b&#62; &amp; B</pre>\n";
        assert_eq!(plain(&without_markup(page)), "Notices\n\nA <a@b> & B");
        assert!(standard_library().expect("rustc runs").contains("MIT"));
    }

    /// Every crate that a program is compiled of is known to cargo, and has a text, its own or the standard one.
    #[test]
    fn every_crate_of_the_programs_has_a_text() {
        let source = crate::install::workspace().expect("the workspace");
        let mut names = BTreeSet::new();
        for profile in ["release", "service"] {
            names.extend(compiled(source, profile).expect("cargo tree"));
        }
        let found = crates(source, &names).expect("cargo metadata");
        let known: BTreeSet<&str> = found.iter().map(|krate| krate.name.as_str()).collect();
        let own = |name: &&String| {
            let name = name.split(' ').next().unwrap_or_default();
            name.starts_with("rivet") || name == "librivet"
        };
        let unknown: Vec<_> =
            names.iter().filter(|name| !own(name) && !known.contains(name.replacen(" v", " ", 1).as_str())).collect();
        assert!(unknown.is_empty(), "{unknown:?}");
        let has_standard_text = |krate: &Crate| !standard_names(&krate.expression).is_empty();
        let bare: Vec<_> = found
            .iter()
            .filter(|krate| !has_standard_text(krate) && licence_texts(&krate.folder).expect("read").is_empty())
            .collect();
        assert!(found.len() > 100 && bare.is_empty(), "{} crates without a text: {bare:?}", found.len());
    }
}
