//! Hostile bytes for everything that rivet reads.
//!
//! A target takes any bytes, must not panic, and checks what must hold whatever they are. It returns a signature of what
//! they made the code do (the words of an error, which counters moved): inputs with a new signature are kept and changed
//! further. That steers the search without the instrumentation that only a nightly compiler offers; it sees less than
//! coverage would.

mod bytes;
mod mutate;
mod shown;
mod targets;

pub use bytes::Bytes;
pub use mutate::Mutator;
pub use targets::{Run, STORED, TARGETS, Target};

use std::collections::HashSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// What a search came to.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Found {
    /// Inputs tried.
    pub inputs: u64,
    /// Different signatures seen.
    pub signatures: usize,
    /// The first input that broke something, with what was said.
    pub broken: Option<(Vec<u8>, String)>,
}

/// Seeds of a target: its own folder of the corpus, and files of the workspace that are read in place.
///
/// # Errors
/// A folder that is named and cannot be read.
pub fn seeds(target: &Target) -> std::io::Result<Vec<Vec<u8>>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    for entry in std::fs::read_dir(root.join("corpus").join(target.name))? {
        files.push(entry?.path());
    }
    for folder in target.also.iter().map(|folder| root.join("../..").join(folder)) {
        let mut there: Vec<PathBuf> = Vec::new();
        for entry in std::fs::read_dir(folder)? {
            let path = entry?.path();
            if path.is_dir() {
                there.extend(std::fs::read_dir(path)?.flatten().map(|entry| entry.path()));
            } else {
                there.push(path);
            }
        }
        there.retain(|path| path.extension().is_some_and(|found| found == target.suffix));
        files.extend(there);
    }
    files.sort();
    files.iter().map(std::fs::read).collect()
}

/// Tries the seeds, then changes of them, for about `time`; the same `seed` tries the same. Ends with the first input that
/// breaks something.
pub fn search(target: &Target, seeds: Vec<Vec<u8>>, time: Duration, seed: u64) -> Found {
    let begin = Instant::now();
    let mut run = (target.make)();
    let mut found = Found::default();
    let mut seen = HashSet::new();
    let mut corpus: Vec<Vec<u8>> = Vec::new();
    let mut mutator = Mutator::new(seed, target.words);
    let mut next = seeds.into_iter();
    loop {
        let input = match next.next() {
            Some(seed) => seed,
            None if begin.elapsed() >= time => return found,
            None => mutator.change(&corpus),
        };
        found.inputs += 1;
        if cfg!(panic = "abort") {
            // There will be no other trace of it. A search goes on where this cannot be written.
            let _ = std::fs::write(format!("last-{}.bin", target.name), &input);
        }
        match catch_unwind(AssertUnwindSafe(|| run(&input))) {
            Ok(signature) => {
                if seen.insert(signature) {
                    found.signatures += 1;
                    corpus.push(input);
                } else if corpus.is_empty() {
                    corpus.push(input);
                }
            }
            Err(panic) => {
                let said = panic.downcast_ref::<String>().cloned();
                let said = said.or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned()));
                found.broken = Some((input, said.unwrap_or_default()));
                return found;
            }
        }
    }
}
