//! The page of a diagnosis, opened by a browser; what two diagnoses differ in.

use std::path::{Path, PathBuf};
use std::process::Command;

use rivet_tests::{rivet, root, shared};
use serde_json::Value;
use tempfile::TempDir;

/// `rivet diagnose` on a practice case: the folder with `diagnosis.json` and `diagnosis.html`.
fn diagnosed(case: &Path) -> (TempDir, Value, String) {
    let folder = tempfile::tempdir().expect("a folder");
    let (json, html) = (folder.path().join("diagnosis.json"), folder.path().join("diagnosis.html"));
    let mut command = rivet();
    command.arg("diagnose").arg(case.join("robot.toml"));
    command.arg(case.join("log-a.parquet")).arg(case.join("log-b.parquet"));
    let output = command.arg("--json").arg(&json).arg("--html").arg(&html).output().expect("the program starts");
    let read = |path: &PathBuf| {
        std::fs::read_to_string(path).unwrap_or_else(|why| panic!("{why}\n{}", String::from_utf8_lossy(&output.stderr)))
    };
    (folder, serde_json::from_str(&read(&json)).expect("JSON"), read(&html))
}

/// A browser without a screen; `None`, said aloud, where there is none.
fn browser() -> Option<&'static str> {
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let found = names.into_iter().find(|name| Command::new(name).arg("--version").output().is_ok());
    if found.is_none() {
        use std::io::Write as _;
        let _ = writeln!(std::io::stderr(), "SKIPPED: no chromium on this machine");
    }
    found
}

/// The page's elements after loading at a width, and what its console said.
fn opened(browser: &str, page: &Path, width: u32) -> (String, Vec<String>) {
    let profile = tempfile::tempdir().expect("a folder");
    let output = Command::new(browser)
        .args(["--headless=new", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--dump-dom"])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("--window-size={width},900"))
        .arg(format!("file://{}", page.display()))
        .output()
        .expect("the browser starts");
    let said = String::from_utf8_lossy(&output.stderr);
    let console = said.lines().filter(|line| line.contains("CONSOLE")).map(str::to_owned).collect();
    (String::from_utf8_lossy(&output.stdout).into_owned(), console)
}

fn percent(value: &Value) -> String {
    format!("{:.1}", 100.0 * value.as_f64().expect("a share"))
}

/// One file that loads nothing and logs nothing, shows the figures of the JSON, and is no wider than a telephone.
#[test]
fn the_page_opens_without_a_word_and_shows_the_figures_of_the_json() {
    let Some(practice) = shared("data/practice") else { return };
    let (folder, found, html) = diagnosed(&practice.join("case-16"));
    for loads in ["src=", "url(", "@import", "<link rel=\"stylesheet\"", "http://", "https://"] {
        assert!(!html.contains(loads), "the page would load something: {loads}");
    }
    let embedded =
        html.split("id=\"diagnosis\">").nth(1).and_then(|rest| rest.split("</script>").next()).expect("data");
    assert_eq!(serde_json::from_str::<Value>(embedded).expect("JSON"), found);

    let Some(browser) = browser() else { return };
    let (page, console) = opened(browser, &folder.path().join("diagnosis.html"), 1280);
    assert!(console.is_empty(), "{console:?}");
    let cause = &found["causes"][0];
    assert_eq!(cause["effect"], "joint_spring", "{cause:#}");
    let gap = &found["gap"];
    let mut figures = vec![percent(&gap["before"]), percent(&gap["after"]), percent(&cause["shrink"]["predicted"])];
    figures.extend(gap["per_joint"].as_array().expect("joints").iter().map(|j| percent(&j["after"])));
    for figure in figures {
        assert!(page.contains(&figure), "{figure} is not on the page");
    }
    for section in ["ledger", "where", "which", "how-far", "left", "parameters", "patch", "trust", "passport"] {
        assert!(page.contains(&format!("<section id=\"{section}\"")), "no section {section}");
    }
    assert_eq!(page.matches("<svg").count(), page.matches("role=\"img\" aria-label").count(), "charts without words");
    assert_eq!(page.matches("<table").count(), page.matches("<thead>").count(), "tables without heads");

    // The page itself has no script that runs; a copy is asked for its width.
    let probe = folder.path().join("probe.html");
    let ask = "<script>console.log('overflow '+(document.documentElement.scrollWidth-innerWidth))</script></body>";
    std::fs::write(&probe, html.replace("</body>", ask)).expect("a writable folder");
    for width in [390, 1280] {
        let (_, console) = opened(browser, &probe, width);
        assert!(
            console.iter().any(|line| line.contains("overflow 0") || line.contains("overflow -")),
            "{width}: {console:?}"
        );
    }
}

/// The scores that the page shows are those of whole sets, made by `rivet blind score --json`.
#[test]
fn the_scores_of_the_page_count_every_case_of_every_set() {
    let text = std::fs::read_to_string(root().join("crates/analysis/src/scores.json")).expect("scores");
    let scores: Value = serde_json::from_str(&text).expect("JSON");
    for (score, set) in scores.as_array().expect("sets").iter().zip(["practice", "practice-wrong-nominal"]) {
        assert_eq!(score["set"], set);
        let Some(answers) = shared(&format!("data/{set}/answers.json")) else { return };
        let answers: Value = serde_json::from_str(&std::fs::read_to_string(answers).expect("answers")).expect("JSON");
        assert_eq!(score["cases"].as_u64(), Some(answers.as_object().expect("cases").len() as u64));
        let counted: u64 =
            score["outcomes"].as_array().expect("outcomes").iter().filter_map(|o| o["cases"].as_u64()).sum();
        // One effect a case in these sets.
        assert_eq!(Some(counted + score["invisible"].as_u64().expect("a count")), score["cases"].as_u64());
    }
    // The third are drawn cases that nobody had looked at, two hundred at least, with several effects in some.
    let [_, _, drawn, independent, ..] = scores.as_array().expect("sets").as_slice() else { panic!("four sets") };
    assert!(independent["cases"].as_u64() >= Some(90) && independent["set"] == "independent simulator, never seen");
    assert!(drawn["cases"].as_u64() >= Some(200) && drawn["set"] == "drawn, never seen", "{}", drawn["cases"]);
    let groups: u64 = drawn["groups"].as_array().expect("groups").iter().filter_map(|g| g["cases"].as_u64()).sum();
    let outcomes = drawn["outcomes"].as_array().expect("outcomes");
    let outside = outcomes.iter().find(|o| o["truth"] == "outside").and_then(|o| o["cases"].as_u64());
    assert_eq!(Some(groups + outside.expect("some")), drawn["cases"].as_u64());
}

/// A diagnosis compared with itself has not changed; compared with that of another arm it is refused.
#[test]
fn diagnoses_compare_with_their_like_only() {
    let Some(practice) = shared("data/practice") else { return };
    let (one, found, _) = diagnosed(&practice.join("case-24"));
    let mut other = found.clone();
    other["causes"] = serde_json::json!([{
        "effect": "joint_spring", "joints": [found["gap"]["per_joint"][0]["joint"]], "magnitude": {},
        "shrink": {"predicted": 0.5, "low": 0.4, "high": 0.6, "measured": 0.5}, "confidence": 0.9,
        "indistinguishable_from": [], "separating_motion": null,
    }]);
    other["verdict"] = "effect".into();
    let mut foreign = found;
    foreign["passport"]["model"] = "0".into();
    foreign["gap"]["per_joint"][0]["joint"] = "elbow".into();
    let compare = |b: Option<&Value>| {
        let a = one.path().join("diagnosis.json");
        let file = one.path().join("b.json");
        if let Some(b) = b {
            std::fs::write(&file, b.to_string()).expect("a writable folder");
        }
        let output =
            rivet().arg("compare").arg(&a).arg(if b.is_some() { &file } else { &a }).output().expect("it starts");
        let text = [output.stdout, output.stderr].map(|t| String::from_utf8_lossy(&t).into_owned()).concat();
        (output.status.code(), text)
    };
    assert_eq!(compare(None).0, Some(0));
    let (code, text) = compare(Some(&other));
    assert!(code == Some(1) && text.contains("named now: joint spring"), "{code:?} {text}");
    let (code, text) = compare(Some(&foreign));
    assert!(code == Some(65) && text.contains("joints") && text.contains("kinematics"), "{code:?} {text}");
}

/// What is not understood is no verdict.
#[test]
fn a_mistyped_command_ends_above_the_codes_of_verdicts() {
    let output = rivet().args(["diagnose", "--no-such-word"]).output().expect("the program starts");
    assert_eq!(output.status.code(), Some(64), "{output:?}");
    assert_eq!(rivet().arg("--version").output().expect("the program starts").status.code(), Some(0));
}
