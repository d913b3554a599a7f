//! LeRobot data sets (v2 and v3): `meta/info.json` names the entries of list columns, the rows are Parquet files below `data`.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::columns::{Table, Wanted};
use crate::episodes;
use crate::error::{LogError, LogFault};
use crate::listing::Listing;
use crate::parquet_file;

/// What makes a folder a data set.
pub(crate) const INFO: &str = "meta/info.json";
/// Longest description \[bytes\].
const MAX_INFO_BYTES: u64 = 16 << 20;
/// Most data files.
const MAX_FILES: usize = 100_000;
/// Time within an episode, and its number.
const TIMESTAMP: &str = "timestamp";
const EPISODE: &str = "episode_index";
/// Time between two episodes that are read as one log \[s\].
const BETWEEN_EPISODES_S: f64 = 10.0;

/// What a data set holds.
pub(crate) fn list(path: &Path) -> Result<Listing, LogError> {
    let set = DataSet::open(path)?;
    let mut listing = parquet_file::list(&set.files[0]).map_err(|why| why.fault.at(path))?;
    for column in &mut listing.columns {
        if let Some(name) = set.named(&column.name) {
            column.name = name;
        }
        if column.name == TIMESTAMP {
            column.unit = Some("s".to_owned());
        }
    }
    Ok(listing)
}

/// The wanted columns of all episodes, one after the other.
pub(crate) fn read(path: &Path, wanted: Wanted<'_>) -> Result<Table, LogError> {
    let set = DataSet::open(path)?;
    let mut all = Table::default();
    let mut episodes: Vec<f64> = Vec::new();
    for (k, file) in set.files.iter().enumerate() {
        let is_wanted = |name: &str| {
            let needs_episode = name == EPISODE && wanted(TIMESTAMP);
            needs_episode || set.named(name).map_or_else(|| wanted(name), |named| wanted(&named))
        };
        let part = parquet_file::read(file, &is_wanted)?;
        for (name, values) in part.columns {
            if name == EPISODE {
                episodes.extend(&values);
            }
            let name = set.named(&name).unwrap_or(name);
            all.columns.entry(name).or_default().extend(values);
        }
        if k == 0 {
            all.unused = part.unused.into_iter().map(|name| set.named(&name).unwrap_or(name)).collect();
        }
    }
    if !wanted(EPISODE) {
        all.columns.remove(EPISODE);
    }
    if let Some(t) = all.columns.get_mut(TIMESTAMP).filter(|t| t.len() == episodes.len()) {
        let is_start = |row: &usize| *row == 0 || episodes[*row] != episodes[*row - 1];
        let starts: Vec<usize> = (0..episodes.len()).filter(is_start).collect();
        episodes::one_after_the_other(t, &starts, BETWEEN_EPISODES_S);
        if starts.len() > 1 {
            all.warnings.push(episodes::note(starts.len(), &format!("{BETWEEN_EPISODES_S} s")));
        }
    }
    Ok(all)
}

struct DataSet {
    /// Names of the entries of list columns.
    names: Vec<(String, Vec<String>)>,
    files: Vec<PathBuf>,
}

impl DataSet {
    fn open(path: &Path) -> Result<DataSet, LogError> {
        let info = path.join(INFO);
        let text = rivet_files::read_text(&info, MAX_INFO_BYTES).map_err(|e| LogFault::Io(e).at(&info))?;
        let fault = |why: String| LogFault::Format { format: "LeRobot", why }.at(&info);
        let root: Value = serde_json::from_str(&text).map_err(|why| fault(why.to_string()))?;
        let features = root.get("features").and_then(Value::as_object);
        let features =
            features.ok_or_else(|| fault("it has no features; a LeRobot data set describes them".to_owned()))?;
        let names = features.iter().map(|(name, feature)| (name.clone(), names_of(feature))).collect();
        let mut files = Vec::new();
        let data = path.join("data");
        collect(&data, 2, &mut files).map_err(|e| LogFault::Io(e).at(&data))?;
        if files.is_empty() {
            return Err(fault("the data set has no Parquet file below data".to_owned()));
        }
        files.sort();
        Ok(DataSet { names, files })
    }

    /// The name of entry `feature[i]` of a list column; none where it has none.
    fn named(&self, column: &str) -> Option<String> {
        let (feature, index) = column.strip_suffix(']')?.rsplit_once('[')?;
        let (_, names) = self.names.iter().find(|(name, _)| name == feature)?;
        Some(format!("{feature}/{}", names.get(index.parse::<usize>().ok()?)?))
    }
}

/// The names of a feature's entries: a list, or a list by the name of an axis.
fn names_of(feature: &Value) -> Vec<String> {
    let names = feature.get("names");
    let list = match names {
        Some(Value::Object(axes)) if axes.len() == 1 => axes.values().next(),
        other => other,
    };
    let words = list.and_then(Value::as_array).into_iter().flatten();
    words.map(|name| name.as_str().unwrap_or_default().to_owned()).collect()
}

/// Parquet files of a folder, at most `depth` folders down.
fn collect(folder: &Path, depth: usize, files: &mut Vec<PathBuf>) -> std::io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() && depth > 0 {
            collect(&path, depth - 1, files)?;
        } else if path.extension().is_some_and(|ext| ext == "parquet") && files.len() < MAX_FILES {
            rivet_files::ensure_regular(&path)?;
            files.push(path);
        }
    }
    Ok(())
}
