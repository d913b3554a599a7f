//! The LZF compression of `h5py` (HDF5 filter 32000): literal runs and references to what was decoded before.

/// Number of the filter in the registry of HDF5.
pub(crate) const FILTER: u16 = 32000;
/// Control bytes below this begin a literal run.
const LITERALS: u8 = 32;
/// A reference with this length has another byte of length.
const LONG: usize = 7;

/// Decodes a chunk into at most `most` bytes.
///
/// # Errors
/// It is cut off, refers to what is before its beginning, or is longer than `most`.
pub(crate) fn decode(bytes: &[u8], most: usize) -> Result<Vec<u8>, &'static str> {
    const CUT_OFF: &str = "an LZF chunk is cut off";
    let mut rest = bytes.iter().copied();
    let mut out: Vec<u8> = Vec::with_capacity(most.min(bytes.len().saturating_mul(4)));
    while let Some(control) = rest.next() {
        let length = if control < LITERALS {
            let length = usize::from(control) + 1;
            let before = out.len();
            out.extend(rest.by_ref().take(length));
            if out.len() - before < length {
                return Err(CUT_OFF);
            }
            0
        } else {
            let short = usize::from(control >> 5);
            let more = if short == LONG { usize::from(rest.next().ok_or(CUT_OFF)?) } else { 0 };
            short + more + 2
        };
        if out.len() + length > most {
            return Err("an LZF chunk is longer than its data set states");
        }
        if length > 0 {
            let back = (usize::from(control & 0x1f) << 8) + usize::from(rest.next().ok_or(CUT_OFF)?) + 1;
            let from = out.len().checked_sub(back).ok_or("an LZF chunk refers to what is before its beginning")?;
            // A reference may reach into what it writes.
            for at in from..from + length {
                out.push(out[at]);
            }
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_and_references_are_decoded() {
        // "abc", then 5 bytes from 3 back, then 12 from 1 back.
        let bytes = [2, b'a', b'b', b'c', 3 << 5, 2, 7 << 5, 3, 0];
        assert_eq!(decode(&bytes, 100).expect("decoded"), b"abcabcabbbbbbbbbbbbb"[..]);
        assert_eq!(decode(&[], 0).expect("decoded"), b""[..]);
    }

    #[test]
    fn damaged_chunks_are_refused() {
        let bytes = [2, b'a', b'b', b'c', 3 << 5, 2];
        assert!(decode(&bytes, 7).is_err(), "longer than stated");
        assert!(decode(&bytes[..3], 100).is_err() && decode(&bytes[..5], 100).is_err(), "cut off");
        assert!(decode(&[0, b'a', 1 << 5, 9], 100).is_err(), "before its beginning");
    }
}
