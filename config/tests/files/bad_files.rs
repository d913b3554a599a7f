//! One file per rule in `tests/bad/`: each names, in `# expect:` comments at its end, every message it must give.

use std::fs;
use std::path::{Path, PathBuf};

fn files() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/bad");
    let mut files: Vec<_> = fs::read_dir(folder)
        .expect("tests/bad is part of the crate")
        .filter_map(|e| Some(e.ok()?.path()))
        .filter(|p| p.extension().is_some_and(|e| e == "toml"))
        .collect();
    files.sort();
    files
}

/// `# expect: line:column | key | value | rule | hint`; rule and hint are beginnings.
struct Expected<'a> {
    place: &'a str,
    key: &'a str,
    value: &'a str,
    rule: &'a str,
    hint: &'a str,
}

fn expectations(text: &str) -> Vec<Expected<'_>> {
    text.lines()
        .filter_map(|line| line.strip_prefix("# expect: "))
        .map(|line| {
            let parts: Vec<_> = line.split(" | ").collect();
            let [place, key, value, rule, hint] = parts[..] else { panic!("not five parts: {line}") };
            Expected { place, key, value, rule, hint }
        })
        .collect()
}

#[test]
fn every_rule_names_place_key_value_rule_and_hint() {
    let files = files();
    assert!(files.len() > 70, "only {} files", files.len());
    let mut failures = Vec::new();
    for file in files {
        let text = fs::read_to_string(&file).expect("listed above");
        let expected = expectations(&text);
        let short = file.file_name().and_then(|n| n.to_str()).expect("named in ASCII");
        let Err(errors) = rivet_config::load(&file) else {
            failures.push(format!("{short}: loads"));
            continue;
        };
        let report = errors.to_string();
        let found = errors.errors();
        let fits = expected.len() == found.len()
            && !expected.is_empty()
            && expected.iter().zip(found).all(|(e, f)| {
                format!("{}:{}", f.line, f.column) == e.place
                    && f.key == e.key
                    && f.value == e.value
                    && f.rule.starts_with(e.rule)
                    && f.hint.starts_with(e.hint)
                    && !e.rule.is_empty()
                    && !e.hint.is_empty()
                    && report.contains(&format!("{}:{}: ", file.display(), e.place))
                    && report.contains(&f.rule)
                    && report.contains(&f.hint)
            });
        if !fits {
            let lines: Vec<_> = found
                .iter()
                .map(|f| {
                    format!("# expect: {}:{} | {} | {} | {} | {}", f.line, f.column, f.key, f.value, f.rule, f.hint)
                })
                .collect();
            failures.push(format!("== {short}\n{}", lines.join("\n")));
        }
    }
    assert!(failures.is_empty(), "these files do not give what they expect, but:\n{}", failures.join("\n"));
}

/// Every key but those whose only rule is their type or a meaning beyond this file has a bad file of its own.
#[test]
fn every_key_has_a_bad_file() {
    let expected: Vec<String> = files()
        .iter()
        .map(|f| fs::read_to_string(f).expect("listed"))
        .flat_map(|t| expectations(&t).iter().map(|e| e.key.to_owned()).collect::<Vec<_>>())
        .collect();
    let missing: Vec<_> = rivet_config::keys::KEYS
        .iter()
        .map(rivet_config::keys::Key::path)
        .filter(|path| !expected.iter().any(|e| e == path || e.starts_with(&format!("{path}["))))
        .collect();
    assert!(missing.is_empty(), "no bad file for {missing:?}");
}

/// A robot file with thousands of mistakes is not answered by thousands of lines.
#[test]
fn of_many_mistakes_the_first_are_shown() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("robot.toml");
    let lines: Vec<String> = (0..300).map(|k| format!("unknown_{k:03} = 1\n")).collect();
    fs::write(&file, format!("name = \"arm\"\n{}", lines.concat())).expect("written");
    let Err(errors) = rivet_config::load(&file) else { panic!("it loads") };
    assert!(errors.errors().len() >= 300);
    let report = errors.to_string();
    // Required keys that are missing come first.
    let shown = report.lines().filter(|line| line.contains("robot.toml:")).count();
    assert_eq!((shown, report.contains("unknown_150"), report.contains("unknown_250")), (200, true, false));
    assert!(
        report.ends_with(&format!("{} mistakes, of which the first 200 are shown", errors.errors().len())),
        "{report}"
    );
}
