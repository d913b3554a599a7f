//! Which logs belong to which robot, and which of them make up one diagnosis.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

use anyhow::{Context, Result};
use rivet_analysis::fault::Fault;
use walkdir::WalkDir;

use crate::row::Key;

/// Name of a robot file in a folder of its own.
const ROBOT_FILE: &str = "robot.toml";
/// Ambiguous logs that an error lists.
const MAX_LISTED_LOGS: usize = 5;

/// Logs of one diagnosis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum GroupBy {
    /// Every log on its own, cut at 60 %
    #[default]
    Log,
    /// The logs of a robot in one folder; the last by name is held out
    Folder,
    /// All logs of a robot; the last by path is held out
    Robot,
}

impl GroupBy {
    pub(crate) fn name(self) -> &'static str {
        match self {
            GroupBy::Log => "log",
            GroupBy::Folder => "folder",
            GroupBy::Robot => "robot",
        }
    }
}

/// A robot of the fleet.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FleetRobot {
    /// Its folder below the folder of robots, or its file without extension.
    pub id: String,
    /// Path of its robot file.
    pub file: PathBuf,
}

impl FleetRobot {
    /// The robot of one file: named by its folder where it is `robot.toml`, else by its own name.
    pub(crate) fn of_file(file: &Path) -> FleetRobot {
        let folder = || file.canonicalize().ok().and_then(|file| Some(file.parent()?.file_name()?.to_owned()));
        let stem = || file.file_stem().map(ToOwned::to_owned);
        let is_in_folder = file.file_name().is_some_and(|name| name == ROBOT_FILE);
        let id = if is_in_folder { folder().or_else(stem) } else { stem() }.unwrap_or_default();
        FleetRobot { id: id.to_string_lossy().into_owned(), file: file.to_owned() }
    }

    /// The last part of its name.
    fn short_id(&self) -> &str {
        self.id.rsplit('/').next().unwrap_or(&self.id)
    }
}

/// A diagnosis to make: logs with their robot, if there is one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pair {
    /// None where the path of the log names no robot.
    pub robot: Option<FleetRobot>,
    /// What makes up one diagnosis.
    pub group_by: GroupBy,
    /// Path of the log, folder of the logs, or robot.
    pub log_group: String,
    /// In the order of their paths.
    pub logs: Vec<PathBuf>,
}

impl Pair {
    /// What its row is found by.
    pub(crate) fn key(&self) -> Key {
        let robot = self.robot.as_ref().map(|robot| robot.id.clone());
        (robot, self.group_by.name().to_owned(), self.log_group.clone())
    }

    /// One pair of a command line that names the files.
    pub fn of_files(robot: &Path, logs: &[PathBuf]) -> Pair {
        let robot = FleetRobot::of_file(robot);
        let folder = logs.first().and_then(|log| log.parent());
        let (group_by, log_group) = match (logs, folder) {
            ([log], _) => (GroupBy::Log, log.to_string_lossy().into_owned()),
            (_, Some(folder)) if logs.iter().all(|log| log.parent() == Some(folder)) => {
                (GroupBy::Folder, folder.to_string_lossy().into_owned())
            }
            _ => (GroupBy::Robot, robot.id.clone()),
        };
        Pair { robot: Some(robot), group_by, log_group, logs: logs.to_vec() }
    }
}

/// The robots of a folder: every `robot.toml` below it, and every `NAME.toml` in it unless it is the folder of a robot itself.
///
/// # Errors
/// The folder cannot be read or has no robot.
pub fn robots(folder: &Path) -> Result<Vec<FleetRobot>> {
    let is_robot_itself = folder.join(ROBOT_FILE).is_file();
    let mut found = Vec::new();
    let is_hidden =
        |entry: &walkdir::DirEntry| entry.depth() > 0 && entry.file_name().as_encoded_bytes().starts_with(b".");
    for entry in WalkDir::new(folder).follow_links(true).sort_by_file_name().into_iter().filter_entry(|e| !is_hidden(e))
    {
        let entry = entry.map_err(std::io::Error::from).with_context(|| format!("--robots {}", folder.display()))?;
        let is_named = entry.depth() == 1 && !is_robot_itself && entry.path().extension().is_some_and(|e| e == "toml");
        if !entry.file_type().is_file() || !(entry.file_name() == ROBOT_FILE || is_named) {
            continue;
        }
        let file = entry.path().to_owned();
        let below = file.parent().and_then(|parent| parent.strip_prefix(folder).ok()).unwrap_or(Path::new(""));
        let robot = match below.to_string_lossy().into_owned() {
            id if id.is_empty() => FleetRobot::of_file(&file),
            id => FleetRobot { id, file },
        };
        found.push(robot);
    }
    if found.is_empty() {
        let folder = folder.display();
        return Err(Fault::Usage(format!(
            "--robots {folder} has neither a {ROBOT_FILE} below it nor a NAME.toml in it"
        ))
        .into());
    }
    Ok(found)
}

/// The recordings that patterns or paths match, in the order of their paths, without those that are `excluded`. A folder is a recording or passed over; files inside of a recording
/// are not recordings.
///
/// # Errors
/// A pattern is invalid or matches no recording, or a folder cannot be read.
pub fn recordings(patterns: &[String], excluded: &[&Path]) -> Result<Vec<PathBuf>> {
    let options =
        glob::MatchOptions { case_sensitive: true, require_literal_separator: true, require_literal_leading_dot: true };
    let excluded: Vec<PathBuf> = excluded.iter().filter_map(|path| path.canonicalize().ok()).collect();
    let is_excluded = |path: &Path| path.canonicalize().is_ok_and(|path| excluded.contains(&path));
    let is_recording = |path: &PathBuf| (!path.is_dir() || rivet_logs::is_recording_folder(path)) && !is_excluded(path);
    let mut all = Vec::new();
    for pattern in patterns {
        let matched: Vec<PathBuf> = if Path::new(pattern).exists() {
            vec![PathBuf::from(pattern)]
        } else {
            let paths =
                glob::glob_with(pattern, options).map_err(|why| Fault::Usage(format!("--logs {pattern}: {why}")))?;
            paths.collect::<Result<_, _>>().map_err(std::io::Error::from).context("--logs")?
        };
        let before = all.len();
        all.extend(matched.into_iter().filter(is_recording));
        if all.len() == before {
            let hint = "quote a pattern with *, and ** goes through folders";
            return Err(Fault::Usage(format!("--logs {pattern} matches no recording; {hint}")).into());
        }
    }
    all.sort();
    all.dedup();
    let folders: Vec<PathBuf> = all.iter().filter(|path| path.is_dir()).cloned().collect();
    all.retain(|path| !folders.iter().any(|folder| path != folder && path.starts_with(folder)));
    Ok(all)
}

/// Pairs logs with robots. A log belongs to the robot that a part of its path names: a folder of its name, or its name in the file name
/// between characters that are neither letters nor digits. Where there is one robot, all logs are its. A log that names no robot becomes a
/// pair without one.
///
/// # Errors
/// A log names several robots, or no log names one.
pub fn pairs(robots: &[FleetRobot], logs: &[PathBuf], group_by: GroupBy) -> Result<Vec<Pair>> {
    let mut groups: BTreeMap<(Option<usize>, String), Vec<PathBuf>> = BTreeMap::new();
    let mut ambiguous = Vec::new();
    for log in logs {
        let robot = match named(robots, log)[..] {
            [robot] => Some(robot),
            [] => (robots.len() == 1).then_some(0),
            ref several => {
                let names: Vec<&str> = several.iter().map(|k| robots[*k].id.as_str()).collect();
                ambiguous.push(format!("{} names the robots {}", log.display(), names.join(" and ")));
                continue;
            }
        };
        let group = match (group_by, robot) {
            (GroupBy::Robot, Some(robot)) => robots[robot].id.clone(),
            (GroupBy::Folder, Some(_)) => log.parent().unwrap_or(Path::new("")).to_string_lossy().into_owned(),
            _ => log.to_string_lossy().into_owned(),
        };
        groups.entry((robot, group)).or_default().push(log.clone());
    }
    if !ambiguous.is_empty() {
        let others = ambiguous.len().saturating_sub(MAX_LISTED_LOGS);
        let more = if others > 0 { format!("\nand {others} more") } else { String::new() };
        let listed = ambiguous[..ambiguous.len() - others].join("\n");
        let hint = "Each log must name one robot; move these, or run the command for one robot at a time (--robots FOLDER/ROBOT)";
        return Err(Fault::Usage(format!("logs that name several robots:\n{listed}{more}\n{hint}")).into());
    }
    if groups.keys().all(|(robot, _)| robot.is_none()) {
        let names: Vec<&str> = robots.iter().take(MAX_LISTED_LOGS).map(|robot| robot.id.as_str()).collect();
        let first = logs.first().map(|log| log.display().to_string()).unwrap_or_default();
        let why = format!(
            "no log names a robot: a folder or the file name must contain one of {}, as {first} does not",
            names.join(", ")
        );
        return Err(Fault::Usage(why).into());
    }
    let pair = |((robot, log_group), logs): ((Option<usize>, String), Vec<PathBuf>)| {
        let group_by = if robot.is_some() { group_by } else { GroupBy::Log };
        Pair { robot: robot.map(|k| robots[k].clone()), group_by, log_group, logs }
    };
    Ok(groups.into_iter().map(pair).collect())
}

/// The robots that the path of a log names.
fn named(robots: &[FleetRobot], log: &Path) -> Vec<usize> {
    let name = |part: Component<'_>| match part {
        Component::Normal(name) => Some(name.to_string_lossy().into_owned()),
        _ => None,
    };
    let parts: Vec<String> = log.components().filter_map(name).collect();
    let Some((file, folders)) = parts.split_last() else { return Vec::new() };
    let is_named = |robot: &FleetRobot| {
        folders.iter().any(|folder| folder == robot.short_id()) || has_word(file, robot.short_id())
    };
    let is_named_in_full = |robot: &FleetRobot| {
        let id: Vec<&str> = robot.id.split('/').collect();
        folders.windows(id.len()).any(|window| window.iter().zip(&id).all(|(part, id)| part == id))
    };
    let all: Vec<usize> = (0..robots.len()).filter(|k| is_named(&robots[*k])).collect();
    // Of robots of one name in several folders, the one whose folders stand in the path as well.
    let is_the_one = |k: &usize| {
        let mut namesakes = all.iter().filter(|other| robots[**other].short_id() == robots[*k].short_id());
        is_named_in_full(&robots[*k]) || !namesakes.any(|other| is_named_in_full(&robots[*other]))
    };
    all.iter().copied().filter(is_the_one).collect()
}

/// Whether a name stands in a text with neither letter nor digit before and after it.
fn has_word(text: &str, name: &str) -> bool {
    let is_end = |c: Option<char>| c.is_none_or(|c| !c.is_alphanumeric());
    !name.is_empty()
        && text
            .match_indices(name)
            .any(|(at, _)| is_end(text[..at].chars().next_back()) && is_end(text[at + name.len()..].chars().next()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fleet(ids: &[&str]) -> Vec<FleetRobot> {
        ids.iter().map(|id| FleetRobot { id: (*id).to_owned(), file: Path::new(id).join(ROBOT_FILE) }).collect()
    }

    /// Names of the robots that a path names.
    fn names<'a>(robots: &'a [FleetRobot], log: &str) -> Vec<&'a str> {
        named(robots, Path::new(log)).into_iter().map(|k| robots[k].id.as_str()).collect()
    }

    #[test]
    fn a_folder_or_a_word_of_the_file_name_names_the_robot() {
        let robots = fleet(&["arm-1", "arm-2", "arm-12"]);
        for log in
            ["logs/arm-1/x.csv", "arm-1.csv", "logs/arm-1_night.csv", "2026-11-29_arm-1.parquet", "arm-1/day/bag"]
        {
            assert_eq!(names(&robots, log), ["arm-1"], "{log}");
        }
        assert_eq!(names(&robots, "logs/arm-12/x.csv"), ["arm-12"]);
        for log in ["logs/arm-3/x.csv", "logs/arm-10.csv", "logs/xarm-1.csv", "logs/arm-1-old/x.csv"] {
            assert!(names(&robots, log).is_empty(), "{log}");
        }
        assert_eq!(names(&robots, "logs/arm-1/arm-2_x.csv"), ["arm-1", "arm-2"]);
    }

    #[test]
    fn namesakes_are_told_apart_by_their_folders() {
        let robots = fleet(&["berlin/arm-1", "paris/arm-1", "arm-2"]);
        assert_eq!(names(&robots, "logs/paris/arm-1/x.csv"), ["paris/arm-1"]);
        assert_eq!(names(&robots, "logs/arm-1/x.csv"), ["berlin/arm-1", "paris/arm-1"]);
        assert_eq!(names(&robots, "logs/paris/arm-1/arm-2.csv"), ["paris/arm-1", "arm-2"]);
    }

    #[test]
    fn groups_hold_the_logs_of_one_diagnosis_in_order() {
        let robots = fleet(&["a", "b"]);
        let logs: Vec<PathBuf> = ["l/a/1/x", "l/a/1/y", "l/a/2/x", "l/b/x", "l/c/x"].map(PathBuf::from).to_vec();
        let grouped = |by| -> Vec<(String, usize)> {
            let all = pairs(&robots, &logs, by).expect("pairs");
            all.into_iter().map(|pair| (pair.log_group, pair.logs.len())).collect()
        };
        let owned = |groups: &[(&str, usize)]| groups.iter().map(|(g, n)| ((*g).to_owned(), *n)).collect::<Vec<_>>();
        assert_eq!(grouped(GroupBy::Log).len(), 5);
        assert_eq!(grouped(GroupBy::Folder), owned(&[("l/c/x", 1), ("l/a/1", 2), ("l/a/2", 1), ("l/b", 1)]));
        assert_eq!(grouped(GroupBy::Robot), owned(&[("l/c/x", 1), ("a", 3), ("b", 1)]));
    }

    #[test]
    fn ambiguous_and_foreign_logs_are_refused_by_name() {
        let robots = fleet(&["a", "b"]);
        let refused = |logs: &[&str]| {
            let logs: Vec<PathBuf> = logs.iter().map(PathBuf::from).collect();
            pairs(&robots, &logs, GroupBy::Log).expect_err("refused").to_string()
        };
        let why = refused(&["l/a/x", "l/a/b_1", "l/b/a_1"]);
        assert!(why.contains("l/a/b_1 names the robots a and b\nl/b/a_1 names"), "{why}");
        assert!(refused(&["l/c/x"]).contains("one of a, b"));
        let alone = pairs(&fleet(&["a"]), &[PathBuf::from("l/c/x")], GroupBy::Log).expect("its own");
        assert_eq!(alone[0].robot.as_ref().map(|robot| robot.id.as_str()), Some("a"));
    }

    #[test]
    fn finds_robots_by_folder_and_by_file() {
        let root = tempfile::tempdir().expect("a folder");
        for file in ["s/a/robot.toml", "b/robot.toml", "c.toml", "s/other.toml", ".old/robot.toml"] {
            let path = root.path().join(file);
            std::fs::create_dir_all(path.parent().expect("a folder")).expect("made");
            std::fs::write(path, "").expect("written");
        }
        let ids = |folder: &Path| robots(folder).expect("robots").into_iter().map(|r| r.id).collect::<Vec<_>>();
        assert_eq!(ids(root.path()), ["b", "c", "s/a"]);
        assert_eq!(ids(&root.path().join("b")), ["b"]);
        assert!(robots(&root.path().join("s/a/..").join("..").join(".old/..").join("s/none")).is_err());
    }

    #[test]
    fn patterns_match_recordings_and_not_what_is_inside_of_them() {
        let root = tempfile::tempdir().expect("a folder");
        for file in ["a/bag/metadata.yaml", "a/bag/x_0.mcap", "a/1.csv", "a/[2].csv", "table.parquet"] {
            let path = root.path().join(file);
            std::fs::create_dir_all(path.parent().expect("a folder")).expect("made");
            std::fs::write(path, "").expect("written");
        }
        let table = root.path().join("table.parquet");
        let find = |pattern: &str| {
            let found = recordings(&[root.path().join(pattern).to_string_lossy().into_owned()], &[&table])?;
            let name = |path: PathBuf| path.strip_prefix(root.path()).expect("below").display().to_string();
            anyhow::Ok(found.into_iter().map(name).collect::<Vec<_>>())
        };
        assert_eq!(find("**/*").expect("found"), ["a/1.csv", "a/[2].csv", "a/bag"]);
        assert_eq!(find("a/[2].csv").expect("found"), ["a/[2].csv"]);
        assert!(find("b/*").expect_err("nothing").to_string().contains("matches no recording"));
        assert!(find("a/***").is_err());
    }
}
