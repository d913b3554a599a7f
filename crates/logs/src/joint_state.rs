//! `sensor_msgs/JointState` of ROS 2, in CDR.

/// Names of the message's type in ROS 2.
pub(crate) const TYPES: [&str; 2] = ["sensor_msgs/msg/JointState", "sensor_msgs/JointState"];
/// Most joints of a message.
const MAX_MESSAGE_JOINTS: usize = 1024;
/// Longest joint name \[bytes\].
const MAX_NAME_BYTES: usize = 256;
/// Bytes before the message: representation and options.
const ENCAPSULATION: usize = 4;

/// Arrays of a message, by the names of their channels.
pub(crate) const FIELDS: [&str; 3] = ["position", "velocity", "effort"];

/// One message. Arrays may be empty.
pub(crate) struct JointState<'a> {
    /// Time of measurement \[ns\]; 0 where the publisher does not set it.
    pub(crate) stamp_ns: i64,
    pub(crate) names: Vec<&'a str>,
    /// Arrays in the order of [`FIELDS`].
    pub(crate) arrays: [Vec<f64>; 3],
}

/// Decodes a message.
///
/// # Errors
/// What is wrong with its bytes.
pub(crate) fn decode(bytes: &[u8]) -> Result<JointState<'_>, String> {
    let mut cdr = Cdr::new(bytes)?;
    let (seconds, nanoseconds) = (cdr.u32()?.cast_signed(), cdr.u32()?);
    let stamp_ns = i64::from(seconds) * 1_000_000_000 + i64::from(nanoseconds);
    cdr.text(MAX_NAME_BYTES)?;
    let count = cdr.count(ENCAPSULATION)?;
    let names = (0..count).map(|_| cdr.text(MAX_NAME_BYTES)).collect::<Result<Vec<_>, _>>()?;
    let arrays = [cdr.doubles()?, cdr.doubles()?, cdr.doubles()?];
    if let Some((array, field)) = arrays.iter().zip(FIELDS).find(|(a, _)| !a.is_empty() && a.len() != names.len()) {
        return Err(format!("a message has {} joints and {} entries of {field}", names.len(), array.len()));
    }
    Ok(JointState { stamp_ns, names, arrays })
}

/// Definition of the message and of what it contains, as MCAP stores it for ROS 2 (`ros2msg`).
pub(crate) const DEFINITION: &str = "\
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
";

/// Encodes a message, little endian. Arrays are in the order of [`FIELDS`]; an empty one is a field that is not measured.
pub(crate) fn encode(stamp_ns: u64, names: &[String], arrays: [&[f64]; 3]) -> Vec<u8> {
    let mut out = vec![0, 1, 0, 0];
    let align = |out: &mut Vec<u8>, size: usize| {
        out.resize(ENCAPSULATION + (out.len() - ENCAPSULATION).next_multiple_of(size), 0);
    };
    let put_u32 = |out: &mut Vec<u8>, value: u32| {
        align(out, size_of::<u32>());
        out.extend(value.to_le_bytes());
    };
    let put_text = |out: &mut Vec<u8>, text: &str| {
        put_u32(out, text.len() as u32 + 1);
        out.extend(text.as_bytes());
        out.push(0);
    };
    put_u32(&mut out, (stamp_ns / 1_000_000_000) as u32);
    put_u32(&mut out, (stamp_ns % 1_000_000_000) as u32);
    put_text(&mut out, "");
    put_u32(&mut out, names.len() as u32);
    for name in names {
        put_text(&mut out, name);
    }
    for array in arrays {
        put_u32(&mut out, array.len() as u32);
        if !array.is_empty() {
            align(&mut out, size_of::<f64>());
            out.extend(array.iter().flat_map(|value| value.to_le_bytes()));
        }
    }
    out
}

/// Common data representation, plain encoding (OMG DDS-XTypes 1.3, 7.4.1): values are aligned to their size.
struct Cdr<'a> {
    bytes: &'a [u8],
    at: usize,
    little: bool,
}

impl<'a> Cdr<'a> {
    fn new(bytes: &'a [u8]) -> Result<Cdr<'a>, String> {
        match bytes {
            [0, order @ (0 | 1), _, _, ..] => Ok(Cdr { bytes, at: ENCAPSULATION, little: *order == 1 }),
            [a, b, ..] => Err(format!("a message is encoded as {a:02x}{b:02x}; plain CDR (0000, 0001) is read")),
            _ => Err("a message is empty".to_owned()),
        }
    }

    fn take(&mut self, size: usize, count: usize) -> Result<&'a [u8], String> {
        let from = ENCAPSULATION + (self.at - ENCAPSULATION).next_multiple_of(size);
        let end = size.checked_mul(count).and_then(|bytes| from.checked_add(bytes));
        let taken = end.and_then(|end| self.bytes.get(from..end));
        let taken = taken.ok_or_else(|| format!("a message of {} bytes ends too early", self.bytes.len()))?;
        self.at = from + taken.len();
        Ok(taken)
    }

    fn u32(&mut self) -> Result<u32, String> {
        let four = self.take(4, 1)?.first_chunk().copied().unwrap_or_default();
        Ok(if self.little { u32::from_le_bytes(four) } else { u32::from_be_bytes(four) })
    }

    /// Length of a sequence whose entries take so many bytes at least.
    fn count(&mut self, entry: usize) -> Result<usize, String> {
        let count = self.u32()? as usize;
        if count > MAX_MESSAGE_JOINTS || count.saturating_mul(entry) > self.bytes.len() {
            return Err(format!("a message of {} bytes claims {count} joints", self.bytes.len()));
        }
        Ok(count)
    }

    fn text(&mut self, longest: usize) -> Result<&'a str, String> {
        let length = self.u32()? as usize;
        if length > longest + 1 {
            return Err(format!("a name of {length} bytes; at most {longest} are read"));
        }
        let bytes = self.take(1, length)?;
        let bytes = bytes.strip_suffix(&[0]).unwrap_or(bytes);
        std::str::from_utf8(bytes).map_err(|_| "a name that is no UTF-8 text".to_owned())
    }

    fn doubles(&mut self) -> Result<Vec<f64>, String> {
        let count = self.count(size_of::<f64>())?;
        if count == 0 {
            return Ok(Vec::new());
        }
        let (bytes, little) = (self.take(size_of::<f64>(), count)?, self.little);
        let value = |eight: &[u8; 8]| if little { f64::from_le_bytes(*eight) } else { f64::from_be_bytes(*eight) };
        Ok(bytes.as_chunks().0.iter().map(value).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A message of two joints, by hand: alignment counts from behind the encapsulation.
    fn message(little: bool) -> Vec<u8> {
        let mut out = vec![0, u8::from(little), 0, 0];
        let u32s = |out: &mut Vec<u8>, x: u32| {
            out.resize(4 + (out.len() - 4).next_multiple_of(4), 0);
            out.extend(if little { x.to_le_bytes() } else { x.to_be_bytes() });
        };
        u32s(&mut out, 5);
        u32s(&mut out, 250_000_000);
        u32s(&mut out, 1);
        out.push(0);
        u32s(&mut out, 2);
        for name in ["ab\0", "c\0"] {
            u32s(&mut out, name.len() as u32);
            out.extend(name.as_bytes());
        }
        for array in [&[1.5, -2.0][..], &[], &[3.0, 4.0]] {
            u32s(&mut out, array.len() as u32);
            for x in array {
                let x: f64 = *x;
                out.resize(4 + (out.len() - 4).next_multiple_of(8), 0);
                out.extend(if little { x.to_le_bytes() } else { x.to_be_bytes() });
            }
        }
        out
    }

    #[test]
    fn what_is_encoded_is_what_the_standard_says() {
        let names = ["ab".to_owned(), "c".to_owned()];
        assert_eq!(encode(5_250_000_000, &names, [&[1.5, -2.0], &[], &[3.0, 4.0]]), message(true));
    }

    #[test]
    fn both_byte_orders_are_decoded() {
        for little in [true, false] {
            let bytes = message(little);
            let state = decode(&bytes).expect("sound");
            assert_eq!((state.stamp_ns, &state.names), (5_250_000_000, &vec!["ab", "c"]));
            assert_eq!(state.arrays, [vec![1.5, -2.0], vec![], vec![3.0, 4.0]]);
        }
    }

    #[test]
    fn every_cut_and_every_claim_is_refused_without_memory() {
        let bytes = message(true);
        for end in 0..bytes.len() {
            assert!(decode(&bytes[..end]).is_err(), "{end}");
        }
        for at in 4..bytes.len() - 3 {
            let mut claims = bytes.clone();
            claims[at..at + 4].copy_from_slice(&u32::MAX.to_le_bytes());
            // Whatever it says, it must come back.
            let _ = decode(&claims);
        }
        assert!(decode(&[0, 6, 0, 0, 1]).err().is_some_and(|why| why.contains("0006")));
    }
}
