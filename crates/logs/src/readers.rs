//! The table of readers: one line a format.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use rivet_files::Content;

use crate::columns::{Table, Wanted};
use crate::error::{LogError, LogFault};
use crate::listing::{Column, Listing};
use crate::{csv_file, hdf5_file, lerobot, mcap_file, npz_file, parquet_file, rosbag2};

/// What decides which reader takes a path.
pub(crate) struct Head<'a> {
    path: &'a Path,
    is_folder: bool,
    /// First bytes of a file.
    bytes: &'a [u8],
}

/// A format that can be read.
pub(crate) struct Reader {
    /// Name of the format.
    pub(crate) name: &'static str,
    /// What the recording begins with.
    is_format: fn(&Head<'_>) -> bool,
    /// What a recording holds.
    pub(crate) list: fn(&Path) -> Result<Listing, LogError>,
    /// The columns that are picked by name.
    pub(crate) read: fn(&Path, Wanted<'_>) -> Result<Table, LogError>,
}

const PARQUET_MAGIC: &[u8] = b"PAR1";

/// Name of the format that has no magic.
const TEXT: &str = "CSV";

/// Every format, in the order in which they are tried. Text is the last: it has no magic.
const READERS: [Reader; 7] = [
    Reader {
        name: "rosbag2",
        is_format: |head| head.is_folder && head.path.join(rosbag2::METADATA).is_file(),
        list: rosbag2::list,
        read: rosbag2::read,
    },
    Reader {
        name: "LeRobot",
        is_format: |head| head.is_folder && head.path.join(lerobot::INFO).is_file(),
        list: lerobot::list,
        read: lerobot::read,
    },
    Reader {
        name: "Parquet",
        is_format: |head| head.bytes.starts_with(PARQUET_MAGIC),
        list: parquet_file::list,
        read: parquet_file::read,
    },
    Reader {
        name: "MCAP",
        is_format: |head| head.bytes.starts_with(mcap::MAGIC) || head.bytes.starts_with(mcap_file::ZSTD_MAGIC),
        list: mcap_file::list,
        read: mcap_file::read,
    },
    Reader {
        name: "NPZ",
        is_format: |head| head.bytes.starts_with(npz_file::MAGIC),
        list: npz_file::list,
        read: npz_file::read,
    },
    Reader {
        name: "HDF5",
        is_format: |head| !head.is_folder && hdf5_file::is_format(head.path),
        list: hdf5_file::list,
        read: hdf5_file::read,
    },
    Reader {
        name: TEXT,
        is_format: |head| !head.is_folder && !head.bytes.contains(&0),
        list: csv_file::list,
        read: csv_file::read,
    },
];

/// Bytes of a file that decide its format.
const HEAD_BYTES: usize = 8;

/// The reader of a recording.
///
/// # Errors
/// It cannot be opened, or no reader takes it.
pub(crate) fn find(path: &Path) -> Result<&'static Reader, LogError> {
    let meta = std::fs::metadata(path).map_err(|e| LogFault::Io(e).at(path))?;
    let is_folder = meta.is_dir();
    if !is_folder && !meta.is_file() {
        return Err(LogFault::OtherFile { content: Content::Device }.at(path));
    }
    let mut magic = [0_u8; HEAD_BYTES];
    let length = if is_folder {
        0
    } else {
        File::open(path).and_then(|mut f| f.read(&mut magic)).map_err(|e| LogFault::Io(e).at(path))?
    };
    if !is_folder && length == 0 {
        return Err(LogFault::Empty { what: "0 bytes" }.at(path));
    }
    let head = Head { path, is_folder, bytes: &magic[..length] };
    let is_parquet = path.extension().is_some_and(|ext| ext.eq_ignore_ascii_case("parquet"));
    match READERS.iter().find(|reader| (reader.is_format)(&head)) {
        Some(reader) if reader.name == TEXT && is_parquet => {
            let why = "it does not begin with PAR1: it is damaged, or something else under that name".to_owned();
            Err(LogFault::Format { format: "Parquet", why }.at(path))
        }
        Some(reader) => Ok(reader),
        None if is_folder => {
            let why = format!(
                "the folder has neither {} (rosbag2) nor {} (LeRobot); give a file or such a folder",
                rosbag2::METADATA,
                lerobot::INFO
            );
            Err(LogFault::Format { format: "a log", why }.at(path))
        }
        None if Content::of(path).is_ok_and(|content| content == Content::Binary) => {
            Err(LogFault::OtherFile { content: Content::Binary }.at(path))
        }
        None => {
            let names: Vec<&str> = READERS.iter().map(|reader| reader.name).collect();
            let why = format!("it is neither Parquet nor text, nor another of {}", names.join(", "));
            Err(LogFault::Format { format: "a log", why }.at(path))
        }
    }
}

/// What a recording holds: topics, columns, and what is wrong with it.
///
/// # Errors
/// It cannot be opened, no reader takes it, it is empty, or it is damaged at its beginning.
pub fn list(path: impl AsRef<Path>) -> Result<Listing, LogError> {
    let path = path.as_ref();
    let reader = find(path)?;
    let listing = (reader.list)(path).map_err(|why| other_file(reader, path, &[]).unwrap_or(why))?;
    if let Some(why) = other_file(reader, path, &listing.columns) {
        return Err(why);
    }
    if listing.columns.is_empty() && listing.topics.iter().all(|topic| topic.is_read) {
        return Err(LogFault::Empty { what: "it has no columns" }.at(path));
    }
    Ok(Listing { format: reader.name, ..listing })
}

/// That a file which is read as text is one of another kind. Values that are set before a table look like TOML; its columns decide.
fn other_file(reader: &Reader, path: &Path, columns: &[Column]) -> Option<LogError> {
    if reader.name != TEXT {
        return None;
    }
    let content = Content::of(path).ok()?;
    let is_other = match content {
        Content::Urdf
        | Content::Xacro
        | Content::Mjcf
        | Content::Sdf
        | Content::Xml
        | Content::Json
        | Content::Binary => true,
        Content::Toml => !is_table_of_numbers(columns),
        _ => false,
    };
    is_other.then(|| LogFault::OtherFile { content }.at(path))
}

/// Most cells of the first row are numbers, and the table is no list of `key = value`.
fn is_table_of_numbers(columns: &[Column]) -> bool {
    let numbers = columns.iter().filter(|column| column.text.is_none()).count();
    columns.len() > 1 && 2 * numbers > columns.len() && columns.iter().all(|column| column.name != "=")
}

/// Name of the format of a file or folder that is a recording, for a message about a file in the wrong place. Of text the numbers
/// decide: most cells of its first row are some.
pub fn recognized_format(path: &Path) -> Option<&'static str> {
    let reader = find(path).ok()?;
    if reader.name != TEXT {
        return Some(reader.name);
    }
    is_table_of_numbers(&list(path).ok()?.columns).then_some(TEXT)
}

/// Whether a folder is one recording (rosbag2, LeRobot), and not a folder with recordings in it.
pub fn is_recording_folder(folder: &Path) -> bool {
    let head = Head { path: folder, is_folder: folder.is_dir(), bytes: &[] };
    head.is_folder && READERS.iter().any(|reader| (reader.is_format)(&head))
}
