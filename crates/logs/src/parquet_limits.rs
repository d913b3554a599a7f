//! What a Parquet file may claim, compared with its bytes before the library reads it.

use std::io::{self, Read};

use parquet::basic::Compression;

use crate::thrift::{Found, walk};

/// Longest footer \[bytes\]. 100 columns in 1000 row groups take 10 MB.
pub(crate) const MAX_FOOTER_BYTES: usize = 16 << 20;
/// Most elements of a schema.
const MAX_SCHEMA_ELEMENTS: i64 = 4096;
/// Most groups inside each other in a schema. A log is flat; pandas and ROS tools nest 3.
const MAX_SCHEMA_DEPTH: usize = 8;
/// Longest name of a column \[bytes\]: the library repeats a group's name in each of its columns.
const MAX_NAME_BYTES: u64 = 256;
/// Most columns of all row groups together. The library takes some 500 bytes for each.
const MAX_CHUNKS: usize = 1 << 17;
/// Bytes that a value of a page may take before compression: 8 of its own, the rest for levels and padding.
const PAGE_BYTES_A_VALUE: u64 = 16;
/// Bytes that any page may take before compression.
const PAGE_BYTES: u64 = 64 << 10;

/// Checks length, schema, names and row groups of the footer. A file without one passes: the library names the fault.
///
/// # Errors
/// The first claim that the file cannot hold.
pub(crate) fn ensure_footer(file: &[u8]) -> Result<(), String> {
    let Some((before, &[a, b, c, d, ..])) = file.split_last_chunk::<8>() else { return Ok(()) };
    let length = u32::from_le_bytes([a, b, c, d]) as usize;
    let Some(start) = before.len().checked_sub(length) else { return Ok(()) };
    if length > MAX_FOOTER_BYTES {
        return Err(format!("its footer has {length} bytes; at most {MAX_FOOTER_BYTES} are read"));
    }
    let mut schema = Schema::default();
    let mut chunks = 0_usize;
    walk(&before[start..], |path, found| match (path, found) {
        ([2], Found::Begin) => {
            schema.children = 0;
            Ok(())
        }
        ([2, 5], Found::Integer(children)) => {
            schema.children = children;
            Ok(())
        }
        ([2, 4], Found::Bytes(count)) if count > MAX_NAME_BYTES => {
            Err(format!("a column's name has {count} bytes; at most {MAX_NAME_BYTES} are read"))
        }
        ([2], Found::End) => schema.element(),
        // Row groups count as well: one without columns takes memory too.
        ([4] | [4, 1], Found::Begin) => {
            chunks += 1;
            if chunks > MAX_CHUNKS {
                Err(format!("it has more than {MAX_CHUNKS} columns in row groups"))
            } else {
                Ok(())
            }
        }
        _ => Ok(()),
    })?;
    Ok(())
}

/// Elements of a schema in file order: each group is followed by its children.
#[derive(Default)]
struct Schema {
    elements: i64,
    /// Children of the element at hand.
    children: i64,
    /// Children to come of each open group.
    open: Vec<i64>,
}

impl Schema {
    fn element(&mut self) -> Result<(), String> {
        self.elements += 1;
        if self.elements > MAX_SCHEMA_ELEMENTS {
            return Err(format!("its schema has more than {MAX_SCHEMA_ELEMENTS} elements"));
        }
        if !(0..=MAX_SCHEMA_ELEMENTS).contains(&self.children) {
            return Err(format!("an element of its schema claims {} children", self.children));
        }
        while self.open.last() == Some(&0) {
            self.open.pop();
        }
        if let Some(left) = self.open.last_mut() {
            *left -= 1;
        }
        if self.children > 0 {
            if self.open.len() >= MAX_SCHEMA_DEPTH {
                return Err(format!("its schema is nested more than {MAX_SCHEMA_DEPTH} deep"));
            }
            self.open.push(self.children);
        }
        Ok(())
    }
}

/// Header of a page.
#[derive(Default)]
struct PageHeader {
    uncompressed: i64,
    compressed: i64,
    data_values: i64,
    dictionary_values: i64,
    /// Bytes of levels that are not compressed.
    levels: i64,
}

/// Checks the headers of all pages of one column in one row group, which are `bytes`, against `(values of the column, most values of
/// the row group)`.
///
/// # Errors
/// The first claim that the column cannot hold.
pub(crate) fn ensure_pages(mut bytes: &[u8], codec: Compression, claims: (i64, i64)) -> Result<(), String> {
    let (values, most) = claims;
    if !(0..=most).contains(&values) {
        return Err(format!("it claims {values} values where {most} have room"));
    }
    let (mut data, mut dictionary) = (0_i64, 0_i64);
    while !bytes.is_empty() && data < values {
        let mut page = PageHeader::default();
        let length = walk(bytes, |path, found| {
            if let Found::Integer(value) = found {
                match path {
                    [2] => page.uncompressed = value,
                    [3] => page.compressed = value,
                    [5 | 8, 1] => page.data_values = value,
                    [8, 5 | 6] => page.levels = page.levels.saturating_add(value.max(0)),
                    [7, 1] => page.dictionary_values = value,
                    _ => {}
                }
            }
            Ok(())
        })?;
        bytes = &bytes[length..];
        let stored = usize::try_from(page.compressed).ok().filter(|stored| *stored <= bytes.len());
        let stored = stored.ok_or_else(|| format!("a page claims {} of {} bytes", page.compressed, bytes.len()))?;
        for (sum, count) in [(&mut data, page.data_values), (&mut dictionary, page.dictionary_values)] {
            *sum = sum.saturating_add(count);
            if count < 0 || *sum > values {
                return Err(format!("a page claims {count} values; the column has {values}"));
            }
        }
        let count = (page.data_values + page.dictionary_values).unsigned_abs();
        let most = count.saturating_mul(PAGE_BYTES_A_VALUE).saturating_add(PAGE_BYTES);
        if u64::try_from(page.uncompressed).map_or(true, |claimed| claimed > most) {
            return Err(format!(
                "a page of {count} values claims {} bytes; at most {most} are read",
                page.uncompressed
            ));
        }
        // Levels of a page of the second kind are not compressed.
        let plain = usize::try_from(page.levels).unwrap_or(usize::MAX).min(stored);
        ensure_inflates(&bytes[plain..stored], codec, page.uncompressed.saturating_sub(page.levels).unsigned_abs())?;
        bytes = &bytes[stored..];
    }
    Ok(())
}

/// The library inflates pages of two codecs to whatever length they have.
fn ensure_inflates(page: &[u8], codec: Compression, claimed: u64) -> Result<(), String> {
    let inflated = |stream: &mut dyn Read| {
        let most = claimed.max(PAGE_BYTES);
        // A stream that breaks off is a fault of its page, which the library names.
        let bytes = io::copy(&mut stream.take(most + 1), &mut io::sink()).unwrap_or(0);
        if bytes > most { Err(format!("a page claims {claimed} bytes and has more than {most}")) } else { Ok(()) }
    };
    match codec {
        Compression::GZIP(_) => inflated(&mut flate2::read::MultiGzDecoder::new(page)),
        Compression::BROTLI(_) => inflated(&mut brotli::Decompressor::new(page, BROTLI_BUFFER_BYTES)),
        _ => Ok(()),
    }
}

/// Buffer of a decoder \[bytes\].
const BROTLI_BUFFER_BYTES: usize = 4096;
