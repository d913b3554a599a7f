//! The cases of the golden set: files, drawn cases, measured arms.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Result, bail};

use super::Places;
use super::digest::short_hash;
use super::measured::{self, Edit};

/// Folders of ready cases below the shared data.
const READY_SETS: [&str; 4] = ["practice", "practice-wrong-nominal", "sealed", "sealed-wrong-nominal"];
/// Seed of both drawn sets.
const DRAW_SEED: &str = "50";
/// Cases that are drawn by this workspace's simulation.
const DRAWN_CASES: &str = "60";
/// Cases of the independent simulator, by kind: 60 in all.
const BRISTLE_KINDS: [(&str, &str); 4] = [("--null", "9"), ("--single", "33"), ("--double", "12"), ("--outside", "6")];

/// A robot file before anything is identified.
#[derive(Clone, Debug)]
pub(crate) enum Source {
    /// As it is.
    File(PathBuf),
    /// A copy with other values.
    Changed { robot: PathBuf, edits: Vec<Edit> },
}

/// A model that `rivet identify` makes before the diagnosis.
#[derive(Clone, Debug)]
pub(crate) struct Identify {
    pub(crate) logs: Vec<PathBuf>,
    pub(crate) flags: Vec<String>,
    /// What is changed in the identified model.
    pub(crate) edits: Vec<Edit>,
}

/// One diagnosis.
#[derive(Clone, Debug)]
pub(crate) struct Case {
    /// `set/case`.
    pub(crate) name: String,
    pub(crate) source: Source,
    pub(crate) identify: Option<Identify>,
    /// Logs; the last is held out.
    pub(crate) logs: Vec<PathBuf>,
}

impl Case {
    fn set(&self) -> &str {
        self.name.split_once('/').map_or("", |(set, _)| set)
    }

    /// Files that decide the result, but for the program.
    pub(crate) fn inputs(&self, robot: &Path) -> Vec<PathBuf> {
        // What is identified is a result of the program: its inputs are the file and the logs that it is made from.
        let (robot, more) = match (&self.identify, &self.source) {
            (Some(identify), Source::File(path) | Source::Changed { robot: path, .. }) => {
                (path.clone(), identify.logs.clone())
            }
            (None, _) => (robot.to_owned(), Vec::new()),
        };
        let urdf = robot.with_file_name("robot.urdf");
        let urdf = Some(urdf).filter(|urdf| urdf.is_file());
        [robot].into_iter().chain(urdf).chain(more).chain(self.logs.iter().cloned()).collect()
    }
}

/// All cases that can be run here, and one line for each set or case whose data are absent. Sets in which `filter` takes nothing are not
/// drawn.
pub(crate) fn all(places: &Places, python: &Path, filter: &[String]) -> Result<(Vec<Case>, Vec<String>)> {
    let mut cases = Vec::new();
    let mut absent = Vec::new();
    for set in READY_SETS {
        let found = in_folder(set, &places.shared.join("data").join(set));
        if found.is_empty() {
            absent.push(format!("{set}: no case in {}", places.shared.join("data").join(set).display()));
        }
        cases.extend(found);
    }
    let (measured, without) = measured::cases(&places.root, &places.shared.join("data"));
    cases.extend(measured);
    absent.extend(without);
    let draw = places.shared.join("simulators/bristle/draw.py");
    if may_match("bristle", filter) {
        match drawn(places, "bristle", |folder, answers| {
            let mut command = Command::new(python);
            command.arg(&draw).arg(folder).arg(answers).args(["--seed", DRAW_SEED]);
            command.args(BRISTLE_KINDS.iter().flat_map(|(flag, count)| [*flag, *count]));
            command
        }) {
            Ok(found) => cases.extend(found),
            Err(why) => absent.push(format!("bristle: {why:#}")),
        }
    }
    if may_match("drawn", filter) {
        cases.extend(drawn(places, "drawn", |folder, answers| {
            let mut command = Command::new(&places.program);
            command.args(["blind", "make", "--seed", DRAW_SEED, "--count", DRAWN_CASES, "--out"]).arg(folder);
            command.arg("--answers").arg(answers);
            command
        })?);
    }
    Ok((cases, absent))
}

/// Whether `filter` may take cases of `set`, which are named `set/case-NN`.
fn may_match(set: &str, filter: &[String]) -> bool {
    let name = format!("{set}/case-");
    filter.is_empty() || filter.iter().any(|text| name.contains(text.as_str()) || text.starts_with(&name))
}

/// Every folder with a robot file and logs, by name.
fn in_folder(set: &str, folder: &Path) -> Vec<Case> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let case = |path: PathBuf| {
        let robot = path.join("robot.toml");
        let logs = logs(&path);
        let name = format!("{set}/{}", path.file_name()?.to_string_lossy());
        let is_case = robot.is_file() && !logs.is_empty();
        is_case.then_some(Case { name, source: Source::File(robot), identify: None, logs })
    };
    let mut found: Vec<Case> = entries.flatten().filter_map(|entry| case(entry.path())).collect();
    found.sort_by(|a, b| a.name.cmp(&b.name));
    found
}

/// The logs of a folder, by name.
fn logs(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let is_log = |path: &PathBuf| path.extension().is_some_and(|e| e == "parquet" || e == "csv");
    let mut logs: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).filter(is_log).collect();
    logs.sort();
    logs
}

/// Cases that a program draws, once: they stay in the scratch folder.
fn drawn(places: &Places, set: &str, command: impl Fn(&Path, &Path) -> Command) -> Result<Vec<Case>> {
    let folder = places.scratch.join(set);
    if !folder.is_dir() {
        let unfinished = places.scratch.join(format!("{set}-unfinished"));
        let _ = std::fs::remove_dir_all(&unfinished);
        let answers = places.scratch.join(format!("{set}-answers.json"));
        let _ = std::fs::remove_file(&answers);
        std::fs::create_dir_all(&places.scratch)?;
        super::note(&format!("drawing the cases of {set}"));
        let output = command(&unfinished, &answers).current_dir(&places.root).stdout(Stdio::null()).output()?;
        if !output.status.success() {
            let text = String::from_utf8_lossy(&output.stderr);
            bail!("{}", text.trim().lines().last().unwrap_or("drawing them failed").to_owned());
        }
        std::fs::rename(&unfinished, &folder)?;
    }
    Ok(in_folder(set, &folder))
}

/// Cases whose name contains one of `filter` (all where it is empty), at most `count`, spread over the sets.
pub(crate) fn choose(mut all: Vec<Case>, filter: &[String], count: Option<usize>) -> Vec<Case> {
    all.retain(|case| filter.is_empty() || filter.iter().any(|text| case.name.contains(text.as_str())));
    let Some(count) = count else { return all };
    // Within a set by hash: names are sorted by kind in some sets.
    all.sort_by_key(|case| (case.set().to_owned(), short_hash(case.name.as_bytes())));
    let mut ranked = Vec::new();
    for set in all.chunk_by(|a, b| a.set() == b.set()) {
        let size = set.len() as f64;
        ranked.extend(set.iter().enumerate().map(|(rank, case)| ((rank as f64 + 0.5) / size, case.clone())));
    }
    ranked.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    ranked.into_iter().take(count).map(|(_, case)| case).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn case(name: String) -> Case {
        Case { name, source: Source::File(PathBuf::new()), identify: None, logs: Vec::new() }
    }

    #[test]
    fn subset_is_spread_over_the_sets() {
        let all: Vec<Case> = [("a", 20), ("b", 60), ("c", 40)]
            .into_iter()
            .flat_map(|(set, count)| (0..count).map(move |k| case(format!("{set}/{k:02}"))))
            .collect();
        let chosen = choose(all, &[], Some(12));
        let count = |set: &str| chosen.iter().filter(|case| case.set() == set).count();
        assert_eq!([count("a"), count("b"), count("c")], [2, 6, 4]);
    }

    #[test]
    fn a_set_is_drawn_where_the_filter_takes_some_of_it() {
        let filter = |texts: &[&str]| texts.iter().map(|text| (*text).to_owned()).collect::<Vec<_>>();
        assert!(may_match("bristle", &[]));
        assert!(may_match("bristle", &filter(&["sealed", "bristle/case-0"])));
        assert!(may_match("drawn", &filter(&["case-"])));
        assert!(!may_match("drawn", &filter(&["sealed", "bristle/"])));
    }

    #[test]
    fn filter_takes_the_cases_that_contain_it() {
        let all = ["sealed/case-01", "sealed/case-02", "drawn/case-01"].map(str::to_owned).map(case).to_vec();
        let chosen = choose(all, &["sealed".to_owned()], None);
        assert_eq!(
            chosen.iter().map(|case| case.name.as_str()).collect::<Vec<_>>(),
            ["sealed/case-01", "sealed/case-02"]
        );
    }
}
