//! Every link and every file path of the documents leads somewhere.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Where documents without a path of their own look for sources of the diagnosis.
const RULES: &str = "crates/diagnosis/src";

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    entries.map(|entry| entry.expect("a readable folder").path()).collect()
}

/// All files below a folder.
fn files_below(folder: &Path) -> Vec<PathBuf> {
    let (folders, mut found): (Vec<_>, Vec<_>) = files(folder).into_iter().partition(|path| path.is_dir());
    found.extend(folders.iter().flat_map(|folder| files_below(folder)));
    found
}

/// README, ARCHITECTURE and CHANGELOG, all of `docs/`, and the README of every robot.
fn documents() -> Vec<PathBuf> {
    let root = root();
    let mut documents: Vec<PathBuf> = ["README.md", "ARCHITECTURE.md", "CHANGELOG.md"].map(|d| root.join(d)).to_vec();
    documents.extend(files_below(&root.join("docs")));
    // Tables are shown on pages.
    documents.retain(|document| !document.starts_with(root.join("docs/tables")));
    documents.extend(files(&root.join("robots")).iter().map(|robot| robot.join("README.md")));
    documents.retain(|d| d.extension().is_some_and(|e| e == "md") && d.exists());
    documents
}

/// Text without fenced blocks: what they show are commands and equations.
fn without_fences(text: &str) -> String {
    text.split("```").step_by(2).collect()
}

/// `target` of every `[text](target)`.
fn links(text: &str) -> impl Iterator<Item = &str> {
    text.split("](").skip(1).filter_map(|rest| rest.split(')').next())
}

/// What stands between backticks.
fn code(text: &str) -> impl Iterator<Item = &str> {
    text.lines().flat_map(|line| line.split('`').skip(1).step_by(2))
}

/// Fragment by which a heading is linked.
fn fragment(heading: &str) -> String {
    let kept = heading.trim_start_matches('#').trim().to_lowercase();
    kept.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c)).map(|c| if c == ' ' { '-' } else { c }).collect()
}

/// Whether a word names a file or a folder of the workspace: from the root on, without placeholders.
fn is_path(word: &str) -> bool {
    const TOP: [&str; 14] = [
        "crates",
        "tools",
        "docs",
        "config",
        "daemon",
        "controller",
        "ipc-schema",
        "cli",
        "tests",
        "robots",
        "systemd",
        "examples",
        "librivet",
        "python",
    ];
    let plain = word.chars().all(|c| c.is_ascii_alphanumeric() || "./_-".contains(c));
    plain && word.split_once('/').is_some_and(|(first, _)| TOP.contains(&first))
}

/// What is wrong with a link of the document at `path`.
fn broken_link(path: &Path, link: &str) -> Option<String> {
    if link.starts_with("http") {
        return None;
    }
    let (file, wanted) = link.split_once('#').map_or((link, None), |(file, wanted)| (file, Some(wanted)));
    let target = if file.is_empty() { path.to_path_buf() } else { path.parent()?.join(file) };
    if !target.exists() {
        return Some(format!("{}: no {link}", path.display()));
    }
    let headings = wanted.map(|wanted| (wanted, read(&target)));
    let missing = headings.filter(|(wanted, text)| {
        !without_fences(text).lines().filter(|l| l.starts_with('#')).any(|heading| fragment(heading) == *wanted)
    });
    missing.map(|_| format!("{}: no heading {link}", path.display()))
}

#[test]
fn every_link_of_a_document_leads_to_a_file_and_a_heading() {
    let (mut seen, mut broken) = (0, Vec::new());
    for document in documents() {
        let text = without_fences(&read(&document));
        seen += links(&text).count();
        broken.extend(links(&text).filter_map(|link| broken_link(&document, link)));
    }
    assert!(broken.is_empty(), "{}", broken.join("\n"));
    assert!(seen > 20, "only {seen} links were found");
}

#[test]
fn every_path_that_a_document_names_exists() {
    let root = root();
    let (mut seen, mut missing) = (0, Vec::new());
    for document in documents() {
        // Other people's repositories have `config` and `examples` as well.
        let is_robot = document.starts_with(root.join("robots"));
        let text = without_fences(&read(&document));
        let is_foreign = |word: &str| is_robot && ["config/", "examples/"].iter().any(|top| word.starts_with(top));
        for word in code(&text).filter(|word| is_path(word) && !is_foreign(word)) {
            seen += 1;
            if !root.join(word).exists() {
                missing.push(format!("{}: no {word}", document.display()));
            }
        }
    }
    assert!(missing.is_empty(), "{}", missing.join("\n"));
    assert!(seen > 50, "only {seen} paths were found");
}

#[test]
fn every_source_that_the_rules_name_exists() {
    let root = root();
    let text = read(&root.join("docs/rules.md"));
    let exists = |name: &str| root.join(RULES).join(name).exists() || root.join(name).exists();
    let sources: Vec<&str> = code(&text).filter(|word| word.ends_with(".rs")).collect();
    let missing: Vec<&str> = sources.iter().copied().filter(|name| !exists(name)).collect();
    assert!(missing.is_empty(), "no {}", missing.join(", "));
    assert!(sources.len() > 50, "only {} sources were found", sources.len());
}

/// Pages of the manual: those that `docs/SUMMARY.md` links.
fn manual_pages() -> Vec<PathBuf> {
    let docs = root().join("docs");
    links(&read(&docs.join("SUMMARY.md"))).map(|link| docs.join(link)).collect()
}

/// Whether a link on a page leads to a file that the built manual lacks. It has its pages, and copies of the files below
/// `docs/` that are not Markdown.
fn leaves_manual(page: &Path, link: &str, pages: &[PathBuf]) -> bool {
    let file = link.split('#').next().unwrap_or(link);
    if link.starts_with("http") || file.is_empty() {
        return false;
    }
    // Without `..`, so that paths can be compared.
    let real = |path: &Path| fs::canonicalize(path).ok().filter(|path| path.is_file());
    let Some(target) = page.parent().and_then(|folder| real(&folder.join(file))) else { return true };
    if target.extension().is_some_and(|e| e == "md") {
        return !pages.iter().any(|page| real(page).is_some_and(|page| page == target));
    }
    !fs::canonicalize(root().join("docs")).is_ok_and(|docs| target.starts_with(docs))
}

#[test]
fn every_link_of_the_manual_leads_to_a_file_of_the_built_manual() {
    let pages = manual_pages();
    let (mut seen, mut dead) = (0, Vec::new());
    for page in &pages {
        let text = without_fences(&read(page));
        seen += links(&text).count();
        let leaving = links(&text).filter(|link| leaves_manual(page, link, &pages));
        dead.extend(leaving.map(|link| format!("{}: {link} is not in the built manual", page.display())));
    }
    assert!(dead.is_empty(), "{}\nName a file of the repository as code.", dead.join("\n"));
    assert!(seen > 100, "only {seen} links were found");
}

#[test]
fn the_manual_contains_every_page_of_docs() {
    let docs = root().join("docs");
    let linked = manual_pages();
    let pages = files_below(&docs).into_iter().filter(|p| p.extension().is_some_and(|e| e == "md"));
    let pages = pages.filter(|page| !page.starts_with(docs.join("tables")));
    let missing: Vec<PathBuf> = pages.filter(|p| !p.ends_with("SUMMARY.md") && !linked.contains(p)).collect();
    assert!(missing.is_empty(), "docs/SUMMARY.md lacks {missing:?}");
    assert!(linked.len() > 50, "only {} pages are linked", linked.len());
}

#[test]
fn every_effect_that_can_be_named_has_a_page() {
    let root = root();
    // Each effect's file has its entry: `About::new("name", kind)`, or `friction` in place of `new`.
    let entries = |text: &str| -> Vec<String> {
        let after = ["About::new(\"", "About::friction(\""].into_iter().flat_map(|start| text.split(start).skip(1));
        after.filter_map(|rest| Some(rest.split_once('"')?.0.to_owned())).collect()
    };
    let sources = files_below(&root.join(RULES).join("effects"));
    let names: Vec<String> = sources.iter().flat_map(|path| entries(&read(path))).collect();
    let has_page = |name: &&String| root.join("docs/effects").join(format!("{name}.md")).exists();
    let missing: Vec<&String> = names.iter().filter(|name| !has_page(name)).collect();
    assert!(missing.is_empty(), "no page for {missing:?}");
    assert!(names.len() > 20, "only {} effects were found", names.len());
}

/// Numbers of pages come from files that commands write.
#[test]
fn pages_show_what_the_files_of_their_tables_hold() {
    let mut check = Command::new(env!("CARGO_BIN_EXE_xtask"));
    let output = check.args(["tables", "--check"]).current_dir(root()).output().expect("xtask");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn broken_links_are_found() {
    let readme = root().join("README.md");
    assert_eq!(broken_link(&readme, "docs/method.md"), None);
    assert!(broken_link(&readme, "docs/none.md").is_some());
    assert!(broken_link(&readme, "docs/method.md#none").is_some());
    assert_eq!(fragment("## `a_b`: what, why?"), "a_b-what-why");
    let (page, pages) = (root().join("docs/effects/payload.md"), manual_pages());
    for link in ["../method.md#payload", "../pictures/effects/payload.svg", "#none", "https://example.org"] {
        assert!(!leaves_manual(&page, link, &pages), "{link}");
    }
    for link in ["../../README.md", "../../examples/robot.c", "../tables/real.md", "../SUMMARY.md", "..", "none.md"] {
        assert!(leaves_manual(&page, link, &pages), "{link}");
    }
    assert!(is_path("docs/method.md") && !is_path("target/x") && !is_path("config/src/*.rs"));
}
