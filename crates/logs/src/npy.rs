//! The header of an array of NumPy (format of `.npy`, versions 1 to 3).

use std::io::{Read, Write};

use crate::numbers::Kind;

/// First bytes of an array.
const MAGIC: &[u8; 6] = b"\x93NUMPY";
/// Longest header \[bytes\].
const MAX_HEADER_BYTES: u32 = 1 << 16;
/// Most dimensions of an array.
const MAX_DIMENSIONS: usize = 32;
/// The numbers begin at a multiple of this many bytes.
const ALIGNMENT: usize = 64;

/// The type of a description such as `<f8` or `<M8[ns]`; none of text, objects and structures.
fn kind_of(description: &str) -> Option<Kind> {
    let (order, rest) = description.split_at_checked(1)?;
    let (class, size) = rest.split_at_checked(1)?;
    let (class, size, unit) = match (class, size.split_once('[')) {
        ("M" | "m", Some((size, unit))) => {
            let unit = unit.strip_suffix(']')?;
            ("i", size, Some(["s", "ms", "us", "ns"].into_iter().find(|known| *known == unit)?))
        }
        _ => (class, size, None),
    };
    let bytes: usize = size.parse().ok()?;
    let is_big_endian = match order {
        "<" | "|" | "=" => false,
        ">" => true,
        _ => return None,
    };
    let kind = match class {
        "f" => Kind::float(bytes, is_big_endian),
        "i" => Kind::integer_of(bytes, true, is_big_endian),
        "u" => Kind::integer_of(bytes, false, is_big_endian),
        "b" if bytes == 1 => Kind::integer_of(bytes, false, is_big_endian),
        _ => None,
    };
    Some(kind?.with_unit(unit))
}

/// What stands before the numbers of an array.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Header {
    /// Type of the numbers; none where they are no numbers.
    pub(crate) kind: Option<Kind>,
    /// Whether the first dimension runs first.
    pub(crate) is_fortran: bool,
    /// Lengths of the dimensions.
    pub(crate) shape: Vec<usize>,
}

impl Header {
    /// Reads a header; what follows are the numbers.
    ///
    /// # Errors
    /// It is no array, or NumPy writes no such header.
    pub(crate) fn read(from: &mut impl Read) -> Result<Header, String> {
        let io = |why: std::io::Error| why.to_string();
        let mut begin = [0_u8; 8];
        from.read_exact(&mut begin).map_err(io)?;
        let Some(version) = begin.strip_prefix(MAGIC) else { return Err("it does not begin as an array".to_owned()) };
        let length = if version[0] == 1 {
            let mut length = [0_u8; 2];
            from.read_exact(&mut length).map_err(io)?;
            u32::from(u16::from_le_bytes(length))
        } else {
            let mut length = [0_u8; 4];
            from.read_exact(&mut length).map_err(io)?;
            u32::from_le_bytes(length)
        };
        if length > MAX_HEADER_BYTES {
            return Err(format!("its header claims {length} bytes; at most {MAX_HEADER_BYTES} are read"));
        }
        let mut text = vec![0_u8; length as usize];
        from.read_exact(&mut text).map_err(io)?;
        Header::parse(&String::from_utf8_lossy(&text)).ok_or_else(|| "NumPy writes no such header".to_owned())
    }

    /// Parses `{'descr': '<f8', 'fortran_order': False, 'shape': (3, 2), }`.
    fn parse(text: &str) -> Option<Header> {
        let value = |key: &str| -> Option<&str> {
            let from = text.find(&format!("'{key}'"))? + key.len() + 2;
            Some(text.get(from..)?.trim_start().strip_prefix(':')?.trim_start())
        };
        let description = value("descr")?;
        // A structure is a list of descriptions.
        let kind = description.strip_prefix('\'').and_then(|rest| kind_of(rest.split('\'').next()?));
        let order = value("fortran_order")?;
        let is_fortran = order.starts_with("True");
        if !is_fortran && !order.starts_with("False") {
            return None;
        }
        let shape = value("shape")?.strip_prefix('(')?.split_once(')')?.0;
        let lengths = shape.split(',').map(str::trim).filter(|length| !length.is_empty());
        let shape: Vec<usize> = lengths.map(|length| length.parse().ok()).collect::<Option<_>>()?;
        (shape.len() <= MAX_DIMENSIONS).then_some(Header { kind, is_fortran, shape })
    }

    /// Writes the header of numbers of 64 bits in C order.
    ///
    /// # Errors
    /// The writer's.
    pub(crate) fn write_floats(to: &mut impl Write, shape: &[usize]) -> std::io::Result<()> {
        Header::write(to, "<f8", shape)
    }

    /// Writes a text as an array without a dimension.
    ///
    /// # Errors
    /// The writer's.
    pub(crate) fn write_text(to: &mut impl Write, text: &str) -> std::io::Result<()> {
        Header::write(to, &format!("<U{}", text.chars().count()), &[])?;
        text.chars().try_for_each(|letter| to.write_all(&u32::from(letter).to_le_bytes()))
    }

    fn write(to: &mut impl Write, description: &str, shape: &[usize]) -> std::io::Result<()> {
        let shape = shape.iter().fold(String::new(), |text, length| text + &length.to_string() + ",");
        let mut text = format!("{{'descr': '{description}', 'fortran_order': False, 'shape': ({shape}), }}");
        let before = MAGIC.len() + 2 + 2;
        // The last character is the end of the line.
        let padded = (before + text.len() + 1).next_multiple_of(ALIGNMENT) - before - 1;
        text.extend(std::iter::repeat_n(' ', padded - text.len()));
        text.push('\n');
        to.write_all(MAGIC)?;
        to.write_all(&[1, 0])?;
        to.write_all(&(text.len() as u16).to_le_bytes())?;
        to.write_all(text.as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_of_numpy_are_read() {
        let header =
            Header::parse("{'descr': '<f4', 'fortran_order': True, 'shape': (3, 2), }   \n").expect("a header");
        assert_eq!((header.is_fortran, &header.shape[..]), (true, &[3, 2][..]));
        assert_eq!(header.kind.map(Kind::bytes), Some(4));
        let line = |descr: &str| format!("{{'descr': {descr}, 'fortran_order': False, 'shape': (7,), }}");
        for descr in ["'|O'", "'<U5'", "[('a', '<f8')]", "'<M8[D]'", "'<c16'", "'<f2'"] {
            assert_eq!(Header::parse(&line(descr)).expect("a header").kind, None, "{descr}");
        }
        for text in ["", "{}", "{'descr': '<f8', 'fortran_order': 0, 'shape': (7,)}", "{'descr': '<f8', 'shape': (7"] {
            assert_eq!(Header::parse(text), None, "{text}");
        }
    }

    #[test]
    fn numbers_of_every_type_are_read() {
        let value = |descr: &str, bytes: &[u8]| kind_of(descr).expect("numbers").value(bytes);
        assert_eq!(value("<f8", &(-1.25_f64).to_le_bytes()), -1.25);
        assert_eq!(value(">f4", &2.5_f32.to_be_bytes()), 2.5);
        assert_eq!(value("<i2", &(-3_i16).to_le_bytes()), -3.0);
        assert_eq!(value(">i8", &(-9_i64).to_be_bytes()), -9.0);
        assert_eq!(value("<M8[us]", &7_i64.to_le_bytes()), 7.0);
        assert_eq!(kind_of("<M8[us]").and_then(Kind::unit), Some("us"));
        assert_eq!(value("|u1", &[200]), 200.0);
        assert_eq!(value("|b1", &[1]), 1.0);
        assert_eq!(value("<u8", &u64::MAX.to_le_bytes()), u64::MAX as f64);
        assert_eq!(kind_of("<i8").expect("numbers").integer(&i64::MIN.to_le_bytes()), Some(i64::MIN));
    }

    #[test]
    fn what_is_written_is_read_and_cut_headers_are_refused() {
        let mut bytes = Vec::new();
        Header::write_floats(&mut bytes, &[5, 2]).expect("written");
        assert_eq!(bytes.len() % ALIGNMENT, 0);
        let header = Header::read(&mut &bytes[..]).expect("read");
        assert_eq!((header.kind, header.is_fortran, header.shape), (kind_of("<f8"), false, vec![5, 2]));
        assert!((0..bytes.len()).all(|end| Header::read(&mut &bytes[..end]).is_err()));
    }
}
