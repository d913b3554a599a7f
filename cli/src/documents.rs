//! Reads the JSON that other commands wrote.

use std::path::Path;

use anyhow::{Context as _, Result};
use rivet_analysis::fault::Fault;
use rivet_files::Content;
use serde::de::DeserializeOwned;

/// Longest document \[B\]. A diagnosis of eight joints with all its series has some 2 MB, a drawn case 5 kB. (`serde_json` refuses what is
/// nested more than 128 deep.)
const MAX_DOCUMENT_BYTES: u64 = 64 << 20;

/// A document of a kind (`a diagnosis`) that a command writes.
///
/// # Errors
/// It cannot be read, or is another file.
pub(crate) fn read_document<T: DeserializeOwned>(path: &Path, kind: &str, command: &str) -> Result<T> {
    let bytes = rivet_files::read_whole(path, MAX_DOCUMENT_BYTES).with_context(|| path.display().to_string())?;
    let mend = format!("give a file that `{command}` wrote");
    let content = Content::of_bytes(&bytes);
    if content != Content::Json {
        return Err(Fault::Data(format!("{}: is {content}, not {kind}; {mend}", path.display())).into());
    }
    serde_json::from_slice(&bytes).with_context(|| format!("{}: is not {kind}; {mend}", path.display()))
}
