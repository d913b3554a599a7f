//! Finished diagnoses beside the table, each in a file that is whole or missing, until the table holds them.

use std::collections::BTreeMap;
use std::fs::{File, TryLockError};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use rivet_analysis::fault::Fault;
use sha2::{Digest as _, Sha256};

use crate::fingerprint::hex;
use crate::row::{Key, Row};

/// How often the lock is tried for: who ends removes the folder with the lock.
const TRIES: usize = 8;
/// Extension of a finished row, and of the output of a diagnosis.
const ROW: &str = "json";
const OUTPUT: &str = "diagnosis";

/// The folder of the rows that a table does not hold yet, locked by this process.
pub(crate) struct Journal {
    folder: PathBuf,
    _lock: File,
    rows: BTreeMap<Key, PathBuf>,
}

impl Journal {
    /// Opens the journal of a table, with the rows that an interrupted run has left there. Files that it left unfinished are removed.
    ///
    /// # Errors
    /// Another process writes the table, or the folder cannot be written.
    pub(crate) fn open(table: &Path) -> Result<(Journal, Vec<Row>)> {
        let folder = folder(table);
        let at = || folder.display().to_string();
        let mut lock = None;
        for _ in 0..TRIES {
            std::fs::create_dir_all(&folder).with_context(at)?;
            let Ok(file) = rivet_files::open_lock(&folder.join("lock")) else { continue };
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    let why = format!(
                        "--table {} is written by another process; wait for it, or name another place",
                        table.display()
                    );
                    return Err(Fault::Usage(why).into());
                }
                Err(TryLockError::Error(why)) => return Err(why).with_context(at),
            }
            if file.metadata().is_ok_and(|there| there.nlink() > 0) {
                lock = Some(file);
                break;
            }
        }
        let lock = lock.with_context(|| format!("{}: the lock cannot be made", at()))?;
        let mut journal = Journal { folder, _lock: lock, rows: BTreeMap::new() };
        let rows = journal.read()?;
        Ok((journal, rows))
    }

    fn read(&mut self) -> Result<Vec<Row>> {
        rivet_files::sweep(&self.folder);
        let mut rows = Vec::new();
        for entry in std::fs::read_dir(&self.folder).with_context(|| self.folder.display().to_string())? {
            let path = entry?.path();
            if !path.extension().is_some_and(|extension| extension == ROW || extension == OUTPUT) {
                // The lock, and what is not the journal's.
                continue;
            }
            match is_row(&path).then(|| read_row(&path)) {
                Some(Ok(row)) => {
                    self.rows.insert(row.key(), path);
                    rows.push(row);
                }
                // Output of a diagnosis that was interrupted, or a row of another version: done again.
                _ => std::fs::remove_file(&path).with_context(|| path.display().to_string())?,
            }
        }
        Ok(rows)
    }

    /// A file for the output of the diagnosis that becomes a row.
    pub(crate) fn scratch(&self, key: &Key) -> PathBuf {
        self.folder.join(name(key)).with_extension(OUTPUT)
    }

    /// Keeps a finished row.
    ///
    /// # Errors
    /// It cannot be written.
    pub(crate) fn keep(&mut self, row: &Row) -> Result<()> {
        let key = row.key();
        let path = self.folder.join(name(&key)).with_extension(ROW);
        let text = serde_json::to_string(row)?;
        rivet_files::write_whole(&path, text).with_context(|| path.display().to_string())?;
        self.rows.insert(key, path);
        Ok(())
    }

    /// Whether it holds a row.
    pub(crate) fn has(&self, key: &Key) -> bool {
        self.rows.contains_key(key)
    }

    /// Number of rows.
    pub(crate) fn len(&self) -> usize {
        self.rows.len()
    }

    /// The rows in the order of their keys, read one by one.
    pub(crate) fn rows(&self) -> impl Iterator<Item = Result<Row>> {
        self.rows.values().map(|path| read_row(path))
    }

    /// Forgets all rows: the table holds them.
    pub(crate) fn clear(&mut self) {
        for path in std::mem::take(&mut self.rows).into_values() {
            // A row that stays is the same as that of the table.
            let _ = std::fs::remove_file(path);
        }
    }

    /// Removes the folder where nothing is left in it.
    pub(crate) fn close(self) {
        if self.rows.is_empty() {
            // Under its lock nobody else is in it; what cannot be removed hurts nobody.
            let _ = std::fs::remove_file(self.folder.join("lock"));
            let _ = std::fs::remove_dir(&self.folder);
        }
    }
}

/// Rows that wait beside a table; nothing is locked or changed.
pub(crate) fn waiting(table: &Path) -> Vec<Row> {
    let entries = std::fs::read_dir(folder(table)).into_iter().flatten().flatten().map(|entry| entry.path());
    entries.filter(|path| is_row(path)).filter_map(|path| read_row(&path).ok()).collect()
}

fn folder(table: &Path) -> PathBuf {
    let mut name = table.as_os_str().to_owned();
    name.push(".parts");
    PathBuf::from(name)
}

fn is_row(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == ROW)
}

/// Name of a row's files, and of the row in a list of pairs.
pub(crate) fn name(key: &Key) -> String {
    let text = serde_json::to_string(key).unwrap_or_default();
    hex(&Sha256::digest(text)).chars().take(32).collect()
}

fn read_row(path: &Path) -> Result<Row> {
    let at = || path.display().to_string();
    let text = std::fs::read_to_string(path).with_context(at)?;
    serde_json::from_str(&text).with_context(at)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(log: &str) -> Row {
        Row { group_by: "log".to_owned(), log_group: log.to_owned(), ..Row::default() }
    }

    #[test]
    fn keeps_finished_rows_and_removes_unfinished_files() {
        let root = tempfile::tempdir().expect("a folder");
        let table = root.path().join("t.parquet");
        let (mut journal, found) = Journal::open(&table).expect("opened");
        assert!(found.is_empty());
        for log in ["b", "a", "b"] {
            journal.keep(&row(log)).expect("kept");
        }
        let scratch = journal.scratch(&row("c").key());
        std::fs::write(&scratch, "{").expect("written");
        std::fs::write(scratch.with_extension("json"), "{\"robot\":").expect("written");
        let foreign = scratch.with_extension("parquet");
        std::fs::write(&foreign, "somebody's").expect("written");
        assert_eq!(waiting(&table).len(), 2);
        assert!(Journal::open(&table).err().expect("locked").to_string().contains("by another process"));
        drop(journal);
        let (mut journal, found) = Journal::open(&table).expect("opened");
        assert_eq!(found.len(), 2);
        let logs: Vec<String> = journal.rows().map(|row| row.expect("a row").log_group).collect();
        assert_eq!(logs, ["a", "b"]);
        assert!(!scratch.exists() && !scratch.with_extension("json").exists());
        std::fs::remove_file(&foreign).expect("it is left alone");
        journal.clear();
        journal.close();
        assert_eq!(std::fs::read_dir(root.path()).expect("there").count(), 0);
    }
}
