//! Parquet's own headers (Thrift, compact protocol), walked without recursion and without setting memory aside.
//!
//! The library believes what these headers claim. Here every claim is compared with the bytes that there are, before it sees them.

/// Most structures inside each other. Footers and page headers nest 6.
const MAX_DEPTH: usize = 16;

/// Where a walk stands: field numbers from the outermost structure to the value. Entries of a list have the list's path.
pub(crate) type Path<'a> = &'a [i16];

/// What a walk comes by.
pub(crate) enum Found {
    /// An integer of any width.
    Integer(i64),
    /// Bytes, of this number.
    Bytes(u64),
    /// A structure begins.
    Begin,
    /// A structure ends.
    End,
}

/// A structure or list that is not at its end.
enum Open {
    Struct { last: i16 },
    List { kind: u8, left: u64 },
    Map { key: u8, value: u8, left: u64, at_value: bool },
}

const STOP: u8 = 0;
const TRUE: u8 = 1;
const FALSE: u8 = 2;
const BYTE: u8 = 3;
const DOUBLE: u8 = 7;
const BINARY: u8 = 8;
const LIST: u8 = 9;
const SET: u8 = 10;
const MAP: u8 = 11;
const STRUCT: u8 = 12;

/// Walks the structure at the beginning of `bytes`; returns its length. `visit` sees every integer and structure with its path.
///
/// # Errors
/// What is not Thrift, lies beyond the bytes, is nested too deep, or what `visit` refuses.
pub(crate) fn walk(
    bytes: &[u8],
    mut visit: impl FnMut(Path<'_>, Found) -> Result<(), String>,
) -> Result<usize, String> {
    let mut input = Input { bytes, at: 0 };
    let mut path: Vec<i16> = Vec::new();
    let mut open = vec![Open::Struct { last: 0 }];
    visit(&path, Found::Begin)?;
    while let Some(top) = open.last_mut() {
        let kind = match top {
            Open::Struct { last } => {
                let header = input.byte()?;
                let kind = header & 0x0f;
                if kind == STOP {
                    visit(&path, Found::End)?;
                    open.pop();
                    // The outermost structure is no field; nor is an entry of a list the end of its field.
                    if matches!(open.last(), Some(Open::Struct { .. })) {
                        path.pop();
                    }
                    continue;
                }
                let step = i16::from(header >> 4);
                let id = if step == 0 { input.integer()? as i16 } else { last.wrapping_add(step) };
                *last = id;
                path.push(id);
                kind
            }
            Open::List { left: 0, .. } | Open::Map { left: 0, .. } => {
                open.pop();
                if matches!(open.last(), Some(Open::Struct { .. })) {
                    path.pop();
                }
                continue;
            }
            Open::List { kind, left } => {
                *left -= 1;
                // In lists a boolean is a byte of its own.
                if matches!(*kind, TRUE | FALSE) { BYTE } else { *kind }
            }
            Open::Map { key, value, left, at_value } => {
                let kind = if *at_value { *value } else { *key };
                *left -= u64::from(*at_value);
                *at_value = !*at_value;
                if matches!(kind, TRUE | FALSE) { BYTE } else { kind }
            }
        };
        let inner = match kind {
            STRUCT => {
                visit(&path, Found::Begin)?;
                Some(Open::Struct { last: 0 })
            }
            LIST | SET => Some(input.list()?),
            MAP => Some(input.map()?),
            _ => {
                if let Some(found) = input.scalar(kind)? {
                    visit(&path, found)?;
                }
                None
            }
        };
        if let Some(inner) = inner {
            if open.len() >= MAX_DEPTH {
                return Err(format!("its headers are nested more than {MAX_DEPTH} deep"));
            }
            open.push(inner);
        } else if matches!(open.last(), Some(Open::Struct { .. })) {
            path.pop();
        }
    }
    Ok(input.at)
}

struct Input<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Input<'_> {
    fn left(&self) -> u64 {
        (self.bytes.len() - self.at) as u64
    }

    fn byte(&mut self) -> Result<u8, String> {
        let byte = *self.bytes.get(self.at).ok_or("its headers end too early")?;
        self.at += 1;
        Ok(byte)
    }

    fn skip(&mut self, count: u64) -> Result<(), String> {
        if count > self.left() {
            return Err(format!("its headers claim {count} bytes where {} are left", self.left()));
        }
        self.at += count as usize;
        Ok(())
    }

    fn unsigned(&mut self) -> Result<u64, String> {
        let mut value = 0_u64;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            value |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return Ok(value);
            }
        }
        Err("a number of its headers has more than 64 bits".to_owned())
    }

    /// Zigzag.
    fn integer(&mut self) -> Result<i64, String> {
        let value = self.unsigned()?;
        Ok((value >> 1).cast_signed() ^ -(value & 1).cast_signed())
    }

    /// A list's entries take a byte each at least.
    fn list(&mut self) -> Result<Open, String> {
        let header = self.byte()?;
        let short = u64::from(header >> 4);
        let left = if short == 15 { self.unsigned()? } else { short };
        self.plausible(left)?;
        Ok(Open::List { kind: header & 0x0f, left })
    }

    fn map(&mut self) -> Result<Open, String> {
        let left = self.unsigned()?;
        self.plausible(left)?;
        let kinds = if left == 0 { 0 } else { self.byte()? };
        Ok(Open::Map { key: kinds >> 4, value: kinds & 0x0f, left, at_value: false })
    }

    fn plausible(&self, entries: u64) -> Result<(), String> {
        if entries > self.left() {
            return Err(format!("its headers claim a list of {entries} entries where {} bytes are left", self.left()));
        }
        Ok(())
    }

    fn scalar(&mut self, kind: u8) -> Result<Option<Found>, String> {
        match kind {
            TRUE | FALSE => Ok(None),
            BYTE => self.byte().map(|b| Some(Found::Integer(i64::from(b)))),
            4..=6 => self.integer().map(|i| Some(Found::Integer(i))),
            DOUBLE => self.skip(8).map(|()| None),
            BINARY => {
                let count = self.unsigned()?;
                self.skip(count).map(|()| Some(Found::Bytes(count)))
            }
            13 => self.skip(16).map(|()| None),
            _ => Err(format!("its headers have a field of unknown type {kind}")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn integers(bytes: &[u8]) -> Result<Vec<(Vec<i16>, i64)>, String> {
        let mut found = Vec::new();
        walk(bytes, |path, what| {
            if let Found::Integer(value) = what {
                found.push((path.to_vec(), value));
            }
            Ok(())
        })
        .map(|_| found)
    }

    #[test]
    fn integers_come_with_their_path() {
        // Field 1: 3; field 2: list of two structures {1: -1}, {1: 2}; field 3: 5.
        let bytes = [0x15, 6, 0x19, 0x2c, 0x15, 1, 0, 0x15, 4, 0, 0x15, 10, 0];
        let expected = vec![(vec![1], 3), (vec![2, 1], -1), (vec![2, 1], 2), (vec![3], 5)];
        assert_eq!(integers(&bytes), Ok(expected));
    }

    #[test]
    fn claims_beyond_the_bytes_are_refused() {
        for bytes in [
            &[0x19, 0xfc, 0xff, 0xff, 0xff, 0xff, 0x07][..], // a list of 2³¹ − 1
            &[0x18, 0xff, 0x7f, 1],                          // text of 16 kB
            &[0x1b, 0xff, 0x7f, 0x55],                       // a map of 16 k
            &[0x15],
            &[0x15, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff],
            &[0x1e, 0],
            &[],
        ] {
            assert!(integers(bytes).is_err(), "{bytes:?}");
        }
        assert!(integers(&[0x1c; 10_000]).expect_err("deep").contains("nested"));
        assert!(integers(&[0x19; 10_000]).is_err());
    }
}
