//! What a file holds by its first bytes, for an error about a file in another's place.

use std::fmt;
use std::fs::{self, File};
use std::io::{self, Read as _};
use std::path::Path;

/// What a path holds. `Display` gives it with its article: `a URDF`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content {
    /// No byte, or only blanks and byte order marks.
    Empty,
    /// A folder.
    Folder,
    /// A pipe or a device: reading it may wait for ever.
    Device,
    /// XML with `<robot>`.
    Urdf,
    /// XML with `<robot>` and elements of xacro.
    Xacro,
    /// XML with `<mujoco>`.
    Mjcf,
    /// XML with `<sdf>`.
    Sdf,
    /// Other XML.
    Xml,
    /// JSON.
    Json,
    /// TOML.
    Toml,
    /// Lines of cells.
    Table,
    /// A recording of robots in a format with a magic.
    Recording(&'static str),
    /// Bytes that are no text, of none of these.
    Binary,
    /// Text of none of these.
    Unknown,
}

/// Bytes that are read of a file \[B\]: an XML file may begin with a long comment.
const HEAD_BYTES: u64 = 64 << 10;

/// Formats with a magic.
const MAGIC: [(&[u8], &str); 6] = [
    (b"PAR1", "Parquet"),
    (b"\x89MCAP0\r\n", "MCAP"),
    (b"\x28\xb5\x2f\xfd", "MCAP, compressed with zstd"),
    (b"\x89HDF\r\n\x1a\n", "HDF5"),
    (b"SQLite format 3\0", "SQLite"),
    (b"PK\x03\x04", "NPZ"),
];

/// Byte order marks of UTF-16, whose text holds zeros.
const UTF_16_MARKS: [&[u8]; 2] = [b"\xff\xfe", b"\xfe\xff"];

/// What an element of xacro begins with. The files that xacro makes keep its namespace and have no such element.
const XACRO_ELEMENT: &str = "<xacro:";

impl Content {
    /// What is at a path. Links are followed; no more than the first 64 KiB are read, of a pipe or a device nothing.
    ///
    /// # Errors
    /// It is not there, or cannot be read.
    pub fn of(path: &Path) -> io::Result<Content> {
        let what = fs::metadata(path)?;
        if what.is_dir() {
            return Ok(Content::Folder);
        }
        if !what.is_file() {
            return Ok(Content::Device);
        }
        let mut head = Vec::new();
        File::open(path)?.take(HEAD_BYTES).read_to_end(&mut head)?;
        Ok(Content::of_bytes(&head))
    }

    /// What bytes are the beginning of.
    pub fn of_bytes(head: &[u8]) -> Content {
        if let Some((_, format)) = MAGIC.iter().find(|(magic, _)| head.starts_with(magic)) {
            return Content::Recording(format);
        }
        let head = &head[..head.len().min(HEAD_BYTES as usize)];
        let is_utf_16 = UTF_16_MARKS.iter().any(|mark| head.starts_with(mark));
        if head.contains(&0) && !is_utf_16 {
            return Content::Binary;
        }
        // A character that is cut at the end of the head is no sign of other content.
        let text = match std::str::from_utf8(head) {
            Ok(text) => text,
            Err(e) if e.error_len().is_none() => std::str::from_utf8(&head[..e.valid_up_to()]).unwrap_or_default(),
            Err(_) => return Content::Unknown,
        };
        let text = text.trim_start_matches('\u{feff}').trim_start();
        match text.chars().next() {
            None => Content::Empty,
            Some('<') => of_xml(text),
            Some('{') => Content::Json,
            // A section of TOML begins with a letter.
            Some('[') if text[1..].trim_start().starts_with(|c: char| matches!(c, '{' | ']' | '-' | '0'..='9')) => {
                Content::Json
            }
            Some(_) => of_lines(text),
        }
    }
}

/// By the first element.
fn of_xml(mut text: &str) -> Content {
    let after = |text: &str, end: &str| text.find(end).map(|at| at + end.len());
    // Prolog, comments and document types stand before it.
    while let Some(end) = match text {
        t if t.starts_with("<!--") => after(t, "-->"),
        t if t.starts_with("<?") => after(t, "?>"),
        t if t.starts_with("<!") => after(t, ">"),
        _ => None,
    } {
        text = text[end..].trim_start();
    }
    let name = text.strip_prefix('<').unwrap_or_default();
    match name.split(|c: char| c.is_whitespace() || matches!(c, '>' | '/')).next() {
        Some("robot") if text.contains(XACRO_ELEMENT) => Content::Xacro,
        Some("robot") => Content::Urdf,
        Some("mujoco") => Content::Mjcf,
        Some("sdf") => Content::Sdf,
        _ => Content::Xml,
    }
}

/// By the first line that is neither blank nor a comment.
fn of_lines(text: &str) -> Content {
    let mut lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    let Some(line) = lines.next() else { return Content::Unknown };
    let is_key = |key: &str| {
        let key = key.trim();
        !key.is_empty() && key.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.' | '"'))
    };
    let is_section = line.starts_with('[') && line.split('#').next().is_some_and(|line| line.trim_end().ends_with(']'));
    if is_section || line.split_once('=').is_some_and(|(key, _)| is_key(key)) {
        return Content::Toml;
    }
    let cells = [',', ';', '\t'].iter().any(|&c| line.contains(c));
    let is_number = |cell: &str| cell.parse::<f64>().is_ok();
    if cells || line.split_whitespace().all(is_number) { Content::Table } else { Content::Unknown }
}

impl fmt::Display for Content {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = match self {
            Content::Empty => "an empty file",
            Content::Folder => "a folder",
            Content::Device => "a pipe or a device",
            Content::Urdf => "a URDF",
            Content::Xacro => "a xacro file",
            Content::Mjcf => "an MJCF",
            Content::Sdf => "an SDF",
            Content::Xml => "an XML file",
            Content::Json => "a JSON file",
            Content::Toml => "a TOML file",
            Content::Table => "a table of text",
            Content::Recording(format) => return write!(f, "a recording ({format})"),
            Content::Binary => "binary data of no known format",
            Content::Unknown => "another file",
        };
        f.write_str(name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_bytes_hold() {
        let cases: [(&[u8], Content); 29] = [
            (b"", Content::Empty),
            (b" \r\n\t", Content::Empty),
            (b"\xef\xbb\xbf\n", Content::Empty),
            (b"<?xml version='1.0'?>\n<!-- a <mujoco> -->\n<robot name='r'>", Content::Urdf),
            (b"<robot>", Content::Urdf),
            (b"\xef\xbb\xbf<robot name='r'/>", Content::Urdf),
            (b"<mujoco model='m'>", Content::Mjcf),
            (b"<!DOCTYPE sdf>\n<sdf version='1.7'>", Content::Sdf),
            (b"<robots>", Content::Xml),
            (b"<!-- never ends", Content::Xml),
            (b"{\"schema\": 4}", Content::Json),
            (b"[\n  {\"case\": 1}]", Content::Json),
            (b"[1, 2]", Content::Json),
            (b"# robot\n\nname = \"ur\"\n", Content::Toml),
            (b"[drive]  # gears\n", Content::Toml),
            (b"[[joint]]", Content::Toml),
            (b"a.\"b\" = 1", Content::Toml),
            (b"t,q1,tau1\n0,0,0\n", Content::Table),
            (b"# q = position\nt;q1\n", Content::Table),
            (b"0.0 1.0 -2e-3\n", Content::Table),
            (b"a sentence of words", Content::Unknown),
            (b"PAR1....", Content::Recording("Parquet")),
            (b"\x89MCAP0\r\n", Content::Recording("MCAP")),
            (b"<robot xmlns:xacro='x'><link/>", Content::Urdf),
            (b"<robot xmlns:xacro='x'><xacro:include/>", Content::Xacro),
            (b"\x7fELF\0\0", Content::Binary),
            (b"\x81\x02\0", Content::Binary),
            (b"\xff\xfe<\0r\0", Content::Unknown),
            (b"name = \"\xc3", Content::Toml),
        ];
        for (bytes, content) in cases {
            assert_eq!(Content::of_bytes(bytes), content, "{}", String::from_utf8_lossy(bytes));
        }
    }

    #[test]
    fn what_paths_hold() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("robot.toml");
        fs::write(&file, "name = 'arm'").expect("written");
        assert_eq!(Content::of(&file).expect("readable"), Content::Toml);
        assert_eq!(Content::of(folder.path()).expect("readable"), Content::Folder);
        assert_eq!(Content::of(Path::new("/dev/zero")).expect("readable"), Content::Device);
        assert!(Content::of(&folder.path().join("none")).is_err());
    }
}
