//! Every command that the manual shows exists, with the flags that it shows.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// README and all pages below `docs/`.
fn pages() -> Vec<PathBuf> {
    let mut pages = vec![root().join("README.md")];
    let mut folders = vec![root().join("docs")];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).expect("a folder").flatten() {
            match entry.path() {
                path if path.is_dir() => folders.push(path),
                path if path.extension().is_some_and(|e| e == "md") => pages.push(path),
                _ => {}
            }
        }
    }
    pages
}

/// Language and text of every fenced block.
fn blocks(text: &str) -> impl Iterator<Item = (&str, &str)> {
    text.split("```").skip(1).step_by(2).map(|block| block.split_once('\n').unwrap_or((block, "")))
}

/// Lines of fenced blocks marked `sh` or `console`, with continued lines joined. Of `console` only what follows a prompt.
fn shell_lines(text: &str) -> Vec<String> {
    let mut lines = Vec::new();
    for (language, body) in blocks(text) {
        let joined = body.replace("\\\n", " ");
        let commands = joined.lines().map(|line| line.split("  #").next().unwrap_or(line).trim());
        match language.trim() {
            "sh" => lines.extend(commands.map(str::to_owned)),
            "console" => lines.extend(commands.filter_map(|line| line.strip_prefix("$ ")).map(str::to_owned)),
            _ => {}
        }
    }
    lines
}

/// Words of every call of one of rivet's programs in a shell line, the first being a command of `rivet`.
fn calls(line: &str) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    for part in line.split(['&', '|', ';', '(', ')']) {
        let words: Vec<&str> = part.split_whitespace().collect();
        let Some(at) = words.iter().position(|word| program(word).is_some()) else { continue };
        let command = program(words[at]).unwrap_or_default();
        found.push(command.iter().chain(&words[at + 1..]).map(|word| (*word).to_owned()).collect());
    }
    found
}

/// The command of `rivet` that is the same as the program which a word names: none of `rivet` itself.
fn program(word: &str) -> Option<&'static [&'static str]> {
    match word.rsplit('/').next()? {
        "rivet" => Some(&[]),
        "rivetd" => Some(&["daemon"]),
        "rivet-controller" => Some(&["controller"]),
        "rivet-sim" => Some(&["sim"]),
        "rivet-ros2" => Some(&["ros2"]),
        "rivet-view" => Some(&["view"]),
        _ => None,
    }
}

/// What `rivet WORDS --help` prints; none where there is no such command.
fn help(words: &[String]) -> Option<String> {
    let output = Command::new(env!("CARGO_BIN_EXE_rivet")).args(words).arg("--help").output().expect("it starts");
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).into_owned())
}

/// Names of the commands that a help text lists.
fn commands(help: &str) -> BTreeSet<String> {
    let listed = help.lines().skip_while(|line| !line.starts_with("Commands:")).skip(1);
    listed
        .take_while(|line| line.starts_with("  "))
        .filter_map(|line| line.split_whitespace().next())
        .map(str::to_owned)
        .collect()
}

/// What is wrong with a call.
fn mistake(call: &[String]) -> Option<String> {
    let (mut depth, mut text) = (0, help(&[])?);
    while let Some(word) = call.get(depth).filter(|word| commands(&text).contains(*word)) {
        depth += 1;
        text = help(&call[..depth]).unwrap_or_else(|| panic!("{word} is listed and has no help"));
    }
    let operand = call.get(depth).filter(|word| !word.starts_with('-'));
    if let (false, Some(word)) = (commands(&text).is_empty(), operand) {
        return Some(format!("no command {word}"));
    }
    let known: BTreeSet<&str> = text
        .split(|c: char| c.is_whitespace() || "[]=,;:.`<>()".contains(c))
        .filter(|word| word.starts_with('-'))
        .collect();
    let flags = call.iter().filter(|word| word.starts_with("--") || is_short(word));
    let unknown = flags.map(|word| word.split('=').next().unwrap_or(word)).find(|flag| !known.contains(flag));
    unknown.map(|flag| format!("no flag {flag}"))
}

/// A flag of one letter; numbers below zero are values.
fn is_short(word: &str) -> bool {
    word.strip_prefix('-').is_some_and(|rest| rest.len() == 1 && rest.chars().all(char::is_alphabetic))
}

#[test]
fn every_command_of_the_manual_exists_with_its_flags() {
    let (mut seen, mut mistakes) = (0, Vec::new());
    for page in pages() {
        let text = fs::read_to_string(&page).expect("a page");
        for call in shell_lines(&text).iter().flat_map(|line| calls(line)) {
            seen += 1;
            mistakes.extend(mistake(&call).map(|why| format!("{}: rivet {}: {why}", page.display(), call.join(" "))));
        }
    }
    assert!(mistakes.is_empty(), "{}", mistakes.join("\n"));
    assert!(seen > 30, "only {seen} calls were found");
}

#[test]
fn wrong_commands_are_found() {
    let wrong = |line: &str| calls(line).iter().find_map(|call| mistake(call));
    assert_eq!(wrong("cd x && rivet blind make --seed 1 --out DIR"), None);
    assert_eq!(wrong("rivet diagnos ROBOT.toml LOG").as_deref(), Some("no command diagnos"));
    assert_eq!(wrong("rivet diagnose ROBOT.toml LOG --jason F").as_deref(), Some("no flag --jason"));
    assert_eq!(wrong("rivet-sim ROBOT.toml --payload 1 --paylod 2").as_deref(), Some("no flag --paylod"));
    let text = "```console\n$ rivet check \\\n  R.toml\nrivet says\n```\n```sh\nrivet demo  # shows all\n```\n";
    assert_eq!(shell_lines(text), ["rivet check    R.toml", "rivet demo"]);
}

/// Logs of tutorial 1: its name for each, and the file of the data set.
const TUTORIAL_LOGS: [(&str, &str); 3] = [
    ("train.parquet", "20_02_10-30sec_12harm.parquet"),
    ("held-out.parquet", "20_02_12-50sec_12harm.parquet"),
    ("unseen.parquet", "20_02_06-20sec_10harm.parquet"),
];

/// Puts the lines `key = value` of a page's `toml` block into the robot file, where the key stands or is commented out.
fn edit(robot: &Path, body: &str) {
    let mut text = fs::read_to_string(robot).expect("a robot file");
    for line in body.lines().filter(|line| line.contains(" = ")) {
        let key = line.split(" = ").next().unwrap_or(line);
        let stands = |old: &str| old.trim_start_matches("# ").split(" = ").next() == Some(key);
        assert!(text.lines().any(stands), "{key} is not in {}", robot.display());
        text = text.lines().map(|old| if stands(old) { line } else { old }.to_owned() + "\n").collect();
    }
    fs::write(robot, text).expect("a robot file");
}

/// The first line of a page that is not in the output where the page has it; `...` on the page stands for any lines.
fn difference<'a>(page: &'a str, output: &str) -> Option<&'a str> {
    let mut lines = output.lines().map(str::trim_end);
    let mut after_gap = false;
    for line in page.lines().map(str::trim_end) {
        if line == "..." {
            after_gap = true;
            continue;
        }
        let found = if after_gap { lines.any(|l| l == line) } else { lines.next() == Some(line) };
        if !found {
            return Some(line);
        }
        after_gap = false;
    }
    None
}

/// What tutorial 1 shows is what its commands print, one after the other in one folder.
#[test]
fn tutorial_of_logs_shows_what_its_commands_print() {
    let data = root().join("../shared/data/real/ur10e_innopolis");
    if !data.is_dir() {
        eprintln!("SKIPPED: {} is not on this machine", data.display());
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let place =
        |name: &str, file: &str| fs::copy(data.join(file), folder.path().join(name)).expect("a file of the set");
    place("ur10e.urdf", "ur10e.urdf");
    for (name, file) in TUTORIAL_LOGS {
        place(name, file);
    }
    let page = fs::read_to_string(root().join("docs/tutorial-logs.md")).expect("a page");
    let mut run = 0;
    for (language, body) in blocks(&page) {
        if language == "toml" {
            edit(&folder.path().join("robot.toml"), body);
        }
        for part in body.split("$ rivet ").skip(1).filter(|_| language == "console") {
            let (command, shown) = part.split_once('\n').unwrap_or((part, ""));
            let mut program = Command::new(env!("CARGO_BIN_EXE_rivet"));
            let output =
                program.args(command.split_whitespace()).current_dir(folder.path()).output().expect("it starts");
            let printed = String::from_utf8_lossy(&output.stdout);
            assert!(output.status.code().is_some_and(|code| code < 64), "rivet {command}: {output:?}");
            assert_eq!(difference(shown, &printed), None, "rivet {command} printed\n{printed}");
            run += 1;
        }
    }
    assert!(run >= 6, "only {run} commands were run");
}

#[test]
fn a_page_that_differs_from_the_output_is_found() {
    assert_eq!(difference("a\n...\nc\n", "a\nb\nc\nd\n"), None);
    assert_eq!(difference("a\nc\n", "a\nb\nc\n"), Some("c"));
    assert_eq!(difference("...\nx\n", "a\n"), Some("x"));
}
