//! rosbag2: a folder with `metadata.yaml`, which names the storage and its files.

use std::path::{Component, Path, PathBuf};

use crate::columns::{Table, Wanted};
use crate::error::{LogError, LogFault};
use crate::listing::Listing;
use crate::mcap_file;

/// What makes a folder a bag.
pub(crate) const METADATA: &str = "metadata.yaml";
/// Longest metadata \[bytes\]: some 100 bytes a topic.
const MAX_METADATA_BYTES: u64 = 16 << 20;
/// Most files of a bag.
const MAX_FILES: usize = 100_000;

/// What a bag holds.
pub(crate) fn list(path: &Path) -> Result<Listing, LogError> {
    match storage(path)? {
        Storage::Mcap(files) => mcap_file::list_files(path, &files),
        Storage::Sqlite(files) => sqlite::list(path, &files),
    }
}

/// The wanted channels of a bag.
pub(crate) fn read(path: &Path, wanted: Wanted<'_>) -> Result<Table, LogError> {
    match storage(path)? {
        Storage::Mcap(files) => mcap_file::read_files(path, &files, wanted),
        Storage::Sqlite(files) => sqlite::read(path, &files, wanted),
    }
}

enum Storage {
    Mcap(Vec<PathBuf>),
    Sqlite(Vec<PathBuf>),
}

fn storage(path: &Path) -> Result<Storage, LogError> {
    let text = rivet_files::read_text(&path.join(METADATA), MAX_METADATA_BYTES);
    let metadata = Metadata::parse(&text.map_err(|e| LogFault::Io(e).at(&path.join(METADATA)))?);
    let refuse = |why: String| Err(LogFault::Format { format: "rosbag2", why }.at(&path.join(METADATA)));
    if metadata.files.is_empty() {
        return refuse("relative_file_paths names no file; write the bag anew by `ros2 bag reindex`".to_owned());
    }
    // A bag is what is in its folder.
    let is_inside = |file: &&String| Path::new(file).components().all(|part| matches!(part, Component::Normal(_)));
    if let Some(file) = metadata.files.iter().find(|file| !is_inside(file)) {
        return refuse(format!("file \"{file}\" is not inside the folder; every file of a bag is"));
    }
    let files: Vec<PathBuf> = metadata.files.iter().map(|file| path.join(file)).collect();
    // What is not read is refused for its storage.
    let is_read = metadata.storage == "mcap" || (metadata.storage == "sqlite3" && cfg!(feature = "sqlite"));
    for file in files.iter().filter(|_| is_read) {
        rivet_files::ensure_regular(file).map_err(|e| LogFault::Io(e).at(file))?;
    }
    match metadata.storage.as_str() {
        "mcap" => Ok(Storage::Mcap(files)),
        "sqlite3" => Ok(Storage::Sqlite(files)),
        other => refuse(format!("storage_identifier is \"{other}\"; mcap and sqlite3 are read")),
    }
}

/// The two entries of the metadata that are needed. `ros2 bag` writes one entry a line; a YAML library would follow aliases, which
/// makes much of little.
#[derive(Debug, Default, PartialEq)]
struct Metadata {
    storage: String,
    files: Vec<String>,
}

impl Metadata {
    fn parse(text: &str) -> Metadata {
        let mut metadata = Metadata::default();
        let mut in_files = false;
        for line in text.lines().map(str::trim) {
            if let Some(entry) = line.strip_prefix("- ").filter(|_| in_files) {
                if metadata.files.len() < MAX_FILES {
                    metadata.files.push(unquoted(entry));
                }
                continue;
            }
            in_files = false;
            match line.split_once(':') {
                Some(("storage_identifier", value)) => metadata.storage = unquoted(value),
                Some(("relative_file_paths", value)) => {
                    in_files = true;
                    let list = value.trim().strip_prefix('[').and_then(|list| list.strip_suffix(']'));
                    let entries = list.into_iter().flat_map(|list| list.split(','));
                    metadata.files.extend(entries.map(unquoted).filter(|entry| !entry.is_empty()).take(MAX_FILES));
                }
                _ => {}
            }
        }
        metadata
    }
}

fn unquoted(value: &str) -> String {
    let value = value.trim();
    let inside = ['"', '\''].iter().find_map(|quote| value.strip_prefix(*quote)?.strip_suffix(*quote));
    inside.unwrap_or(value).to_owned()
}

#[cfg(not(feature = "sqlite"))]
mod sqlite {
    use super::{Listing, LogError, LogFault, Path, PathBuf, Table, Wanted};

    fn refused(path: &Path) -> LogError {
        let why = "its storage is sqlite3, which this build leaves out: it needs a C compiler. Convert the bag to MCAP by `ros2 bag \
                   convert`, or build rivet with `--features sqlite`";
        LogFault::Format { format: "rosbag2", why: why.to_owned() }.at(path)
    }

    pub(super) fn list(path: &Path, _: &[PathBuf]) -> Result<Listing, LogError> {
        Err(refused(path))
    }

    pub(super) fn read(path: &Path, _: &[PathBuf], _: Wanted<'_>) -> Result<Table, LogError> {
        Err(refused(path))
    }
}

#[cfg(feature = "sqlite")]
mod sqlite {
    use rusqlite::{Connection, OpenFlags};

    use super::{Listing, LogError, LogFault, Path, PathBuf, Table, Wanted};
    use crate::messages::{Collector, Scout, Sink};

    /// Longest message \[bytes\].
    const MAX_MESSAGE_BYTES: i64 = 64 << 20;

    pub(super) fn list(path: &Path, files: &[PathBuf]) -> Result<Listing, LogError> {
        let mut scout = Scout::default();
        walk(path, files, &mut scout)?;
        Ok(scout.finish(Vec::new()))
    }

    pub(super) fn read(path: &Path, files: &[PathBuf], wanted: Wanted<'_>) -> Result<Table, LogError> {
        let bytes = files.iter().filter_map(|file| std::fs::metadata(file).ok()).map(|meta| meta.len()).sum();
        let mut collector = Collector::new(wanted, bytes);
        walk(path, files, &mut collector)?;
        Ok(collector.finish(Vec::new()))
    }

    fn walk(path: &Path, files: &[PathBuf], sink: &mut dyn Sink) -> Result<(), LogError> {
        for file in files {
            messages(file, sink).map_err(|why| LogFault::Format { format: "rosbag2 (sqlite3)", why }.at(path))?;
        }
        Ok(())
    }

    fn messages(file: &Path, sink: &mut dyn Sink) -> Result<(), String> {
        let fault = |why: rusqlite::Error| format!("{}: {why}", file.display());
        let bag = Connection::open_with_flags(file, OpenFlags::SQLITE_OPEN_READ_ONLY).map_err(fault)?;
        // A view under these names might never end.
        let tables = "SELECT count(*) FROM sqlite_master WHERE type = 'table' AND name IN ('topics', 'messages')";
        let tables: i64 = bag.query_row(tables, [], |row| row.get(0)).map_err(fault)?;
        if tables != 2 {
            return Err(format!("{}: it has no tables topics and messages", file.display()));
        }
        let mut topics = bag.prepare("SELECT id, name, type, serialization_format FROM topics").map_err(fault)?;
        let rows = topics.query_map([], |row| {
            Ok((row.get::<_, i64>(0)?, row.get::<_, String>(1)?, row.get::<_, String>(2)?, row.get::<_, String>(3)?))
        });
        let topics = rows.and_then(Iterator::collect::<Result<Vec<_>, _>>).map_err(fault)?;
        let wanted: Vec<(i64, usize)> = topics
            .iter()
            .filter_map(|(id, name, kind, encoding)| Some((*id, sink.topic(name, kind, encoding)?)))
            .collect();
        let mut query = bag
            .prepare("SELECT topic_id, timestamp, data FROM messages WHERE length(data) <= ?1 ORDER BY id")
            .map_err(fault)?;
        let mut rows = query.query([MAX_MESSAGE_BYTES]).map_err(fault)?;
        while let Some(row) = rows.next().map_err(fault)? {
            let id: i64 = row.get(0).map_err(fault)?;
            if let Some((_, topic)) = wanted.iter().find(|(wanted, _)| *wanted == id) {
                let time: i64 = row.get(1).map_err(fault)?;
                let data = row.get_ref(2).map_err(fault)?;
                let data = data.as_blob().map_err(|why| format!("{}: {why}", file.display()))?;
                sink.message(*topic, u64::try_from(time).unwrap_or(0), data)?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metadata_gives_storage_and_files() {
        let text = "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n  duration:\n    nanoseconds: 1\n  relative_file_paths:\n    - run_0.mcap\n    - \"run 1.mcap\"\n  topics_with_message_count:\n    - topic_metadata:\n        name: /joint_states\n";
        let wanted =
            Metadata { storage: "mcap".to_owned(), files: vec!["run_0.mcap".to_owned(), "run 1.mcap".to_owned()] };
        assert_eq!(Metadata::parse(text), wanted);
        let flow = "storage_identifier: 'sqlite3'\nrelative_file_paths: [a.db3, 'b.db3']\n";
        let wanted = Metadata { storage: "sqlite3".to_owned(), files: vec!["a.db3".to_owned(), "b.db3".to_owned()] };
        assert_eq!(Metadata::parse(flow), wanted);
    }
}
