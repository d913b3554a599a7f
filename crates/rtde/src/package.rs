//! Frames of the protocol: two bytes of length, one byte of type, the payload. All numbers are big-endian.

use std::fmt;
use std::io;

/// Bytes of the length and the type in front of each payload.
pub const HEADER: usize = 3;
/// Largest package that is accepted \[bytes\]. The names of a recipe take at most 2048 bytes, so its types do too.
pub const MAX_SIZE: usize = 4096;
/// Version of the protocol that is spoken here.
pub const PROTOCOL: u16 = 2;

/// Types of packages that this crate sends or understands.
pub mod kind {
    /// Asks for a version of the protocol.
    pub const PROTOCOL_VERSION: u8 = b'V';
    /// Asks for the version of the controller's software.
    pub const CONTROLLER_VERSION: u8 = b'v';
    /// A text of the controller.
    pub const TEXT_MESSAGE: u8 = b'M';
    /// Values of the recipe.
    pub const DATA: u8 = b'U';
    /// Asks for a recipe of outputs.
    pub const SETUP_OUTPUTS: u8 = b'O';
    /// Starts the data packages.
    pub const START: u8 = b'S';
    /// Pauses the data packages.
    pub const PAUSE: u8 = b'P';
}

/// Name of a type of packages, for messages.
pub fn kind_name(kind: u8) -> &'static str {
    match kind {
        kind::PROTOCOL_VERSION => "REQUEST_PROTOCOL_VERSION",
        kind::CONTROLLER_VERSION => "GET_URCONTROL_VERSION",
        kind::TEXT_MESSAGE => "TEXT_MESSAGE",
        kind::DATA => "DATA_PACKAGE",
        kind::SETUP_OUTPUTS => "CONTROL_PACKAGE_SETUP_OUTPUTS",
        kind::START => "CONTROL_PACKAGE_START",
        kind::PAUSE => "CONTROL_PACKAGE_PAUSE",
        _ => "package of an unknown type",
    }
}

/// Why a conversation cannot go on. The connection has to be closed: the stream has lost its frames or its peer.
#[derive(Debug, thiserror::Error)]
pub enum RtdeError {
    /// The stream failed.
    #[error("the connection failed: {0}")]
    Stream(#[from] io::Error),
    /// The peer has closed the connection.
    #[error("the controller closed the connection")]
    Closed,
    /// A package longer than is accepted, or shorter than its header.
    #[error("{} of {size} bytes; {HEADER} to {MAX_SIZE} are accepted", kind_name(*kind))]
    Size {
        /// Type of the package.
        kind: u8,
        /// The stated size \[bytes\].
        size: usize,
    },
    /// A payload that is not what its type promises.
    #[error("{}: {why}", kind_name(*kind))]
    Malformed {
        /// Type of the package.
        kind: u8,
        /// What does not fit.
        why: String,
    },
    /// The controller does not speak this version of the protocol.
    #[error("the controller does not accept protocol version {PROTOCOL} of RTDE; update its software to 3.5 or later")]
    Protocol,
    /// The controller does not start or take the recipe.
    #[error("the controller refused {}", kind_name(*kind))]
    Refused {
        /// Type of the request.
        kind: u8,
    },
    /// No answer came before the caller lost patience.
    #[error("no answer to {}", kind_name(*kind))]
    NoAnswer {
        /// Type of the request.
        kind: u8,
    },
}

impl RtdeError {
    pub(crate) fn malformed(kind: u8, why: impl Into<String>) -> RtdeError {
        RtdeError::Malformed { kind, why: why.into() }
    }
}

/// Version of the controller's software (PolyScope).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct ControllerVersion {
    /// 3: CB3. 5: e-Series and UR-Series. 10: PolyScope X.
    pub major: u32,
    /// Minor version.
    pub minor: u32,
    /// Bug fix.
    pub bugfix: u32,
    /// Build.
    pub build: u32,
}

impl ControllerVersion {
    /// Rate of the controller's own loop \[Hz\]: 125 on CB3 and before, 500 since.
    pub fn control_rate_hz(&self) -> f64 {
        if self.major < 5 { 125.0 } else { 500.0 }
    }

    pub(crate) fn decode(payload: &[u8]) -> Result<ControllerVersion, RtdeError> {
        let numbers: Option<[u32; 4]> = (payload.len() == 16).then(|| {
            std::array::from_fn(|i| {
                payload[4 * i..4 * i + 4].iter().fold(0, |number, byte| number << 8 | u32::from(*byte))
            })
        });
        let Some([major, minor, bugfix, build]) = numbers else {
            let why = format!("{} bytes instead of 16", payload.len());
            return Err(RtdeError::malformed(kind::CONTROLLER_VERSION, why));
        };
        Ok(ControllerVersion { major, minor, bugfix, build })
    }
}

impl fmt::Display for ControllerVersion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ControllerVersion { major, minor, bugfix, build } = self;
        write!(f, "{major}.{minor}.{bugfix}.{build}")
    }
}

/// How serious a text of the controller is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// An exception.
    Exception,
    /// An error.
    Error,
    /// A warning.
    Warning,
    /// Information.
    Info,
    /// A number that the description does not have.
    Other(u8),
}

impl fmt::Display for Level {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Level::Exception => f.write_str("exception"),
            Level::Error => f.write_str("error"),
            Level::Warning => f.write_str("warning"),
            Level::Info => f.write_str("information"),
            Level::Other(number) => write!(f, "level {number}"),
        }
    }
}

/// A text of the controller. It may hold any characters: whoever shows it escapes them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TextMessage {
    /// The text; bytes that are no UTF-8 are replaced.
    pub text: String,
    /// Which part of the controller says it.
    pub source: String,
    /// How serious it is.
    pub level: Level,
}

impl TextMessage {
    /// Decodes length and text, length and source, and the level.
    ///
    /// # Errors
    /// A length that leads beyond the payload, or bytes behind the level.
    pub fn decode(payload: &[u8]) -> Result<TextMessage, RtdeError> {
        let decoded = (|| {
            let (text, rest) = counted(payload)?;
            let (source, rest) = counted(rest)?;
            let [level] = *rest else { return None };
            let level = match level {
                0 => Level::Exception,
                1 => Level::Error,
                2 => Level::Warning,
                3 => Level::Info,
                other => Level::Other(other),
            };
            let [text, source] = [text, source].map(|bytes| String::from_utf8_lossy(bytes).into_owned());
            Some(TextMessage { text, source, level })
        })();
        decoded.ok_or_else(|| RtdeError::malformed(kind::TEXT_MESSAGE, "its lengths do not fit its size"))
    }
}

/// Bytes behind their own count, and the rest.
fn counted(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (count, rest) = bytes.split_first()?;
    rest.split_at_checked(usize::from(*count))
}

/// A package to send.
///
/// # Errors
/// A payload that makes the package longer than [`MAX_SIZE`].
pub fn encode(kind: u8, payload: &[u8]) -> Result<Vec<u8>, RtdeError> {
    let size = HEADER + payload.len();
    match u16::try_from(size) {
        Ok(length) if size <= MAX_SIZE => Ok([&length.to_be_bytes()[..], &[kind], payload].concat()),
        _ => Err(RtdeError::Size { kind, size }),
    }
}

/// Payload that asks for output fields at `rate_hz`.
pub(crate) fn outputs(rate_hz: f64, names: &[&str]) -> Vec<u8> {
    [&rate_hz.to_be_bytes()[..], names.join(",").as_bytes()].concat()
}

/// Splits a stream into packages, in a buffer of fixed size.
#[derive(Debug)]
pub(crate) struct Frames {
    buffer: Box<[u8]>,
    begin: usize,
    end: usize,
}

impl Frames {
    pub(crate) fn new() -> Frames {
        Frames { buffer: vec![0; 2 * MAX_SIZE].into_boxed_slice(), begin: 0, end: 0 }
    }

    /// Room for what is read next; at least [`MAX_SIZE`] bytes while no whole package waits.
    pub(crate) fn room(&mut self) -> &mut [u8] {
        if self.begin > 0 {
            self.buffer.copy_within(self.begin..self.end, 0);
            (self.begin, self.end) = (0, self.end - self.begin);
        }
        &mut self.buffer[self.end..]
    }

    /// Takes in `count` bytes that were read into the room.
    pub(crate) fn filled(&mut self, count: usize) {
        self.end = (self.end + count).min(self.buffer.len());
    }

    /// Size of the package at the front, if it is there as a whole.
    ///
    /// # Errors
    /// A size that no package may have.
    pub(crate) fn ready(&self) -> Result<Option<usize>, RtdeError> {
        let [high, low, kind, ..] = self.buffer[self.begin..self.end] else { return Ok(None) };
        let size = usize::from(u16::from_be_bytes([high, low]));
        if !(HEADER..=MAX_SIZE).contains(&size) {
            return Err(RtdeError::Size { kind, size });
        }
        Ok((self.end - self.begin >= size).then_some(size))
    }

    /// Takes the package of `size` bytes off the front: its type and payload.
    pub(crate) fn take(&mut self, size: usize) -> (u8, &[u8]) {
        let package = &self.buffer[self.begin..self.begin + size];
        self.begin += size;
        (package[2], &package[HEADER..])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand from the description: version 2 is asked for with 00 05 56 00 02.
    #[test]
    fn a_request_has_the_bytes_of_the_description() {
        assert_eq!(encode(kind::PROTOCOL_VERSION, &PROTOCOL.to_be_bytes()).expect("short"), [0, 5, 86, 0, 2]);
        assert_eq!(encode(kind::START, &[]).expect("short"), [0, 3, 83]);
        let names = outputs(500.0, &["timestamp", "actual_q"]);
        assert_eq!(names[..8], [0x40, 0x7f, 0x40, 0, 0, 0, 0, 0]);
        assert_eq!(&names[8..], b"timestamp,actual_q");
        assert!(matches!(encode(kind::DATA, &[0; MAX_SIZE]), Err(RtdeError::Size { .. })));
    }

    #[test]
    fn a_text_message_is_decoded_or_refused() {
        let message = TextMessage::decode(b"\x05hello\x04RTDE\x02").expect("sound");
        assert_eq!((message.text.as_str(), message.source.as_str(), message.level), ("hello", "RTDE", Level::Warning));
        for broken in [&b""[..], b"\x05hell", b"\x05hello\x04RTDE", b"\x05hello\x04RTDE\x02\x00", b"\xff"] {
            assert!(TextMessage::decode(broken).is_err(), "{broken:?}");
        }
    }

    #[test]
    fn versions_name_the_control_rate() {
        let version = |major| ControllerVersion { major, ..ControllerVersion::default() };
        assert_eq!([3, 5, 10].map(|major| version(major).control_rate_hz()), [125.0, 500.0, 500.0]);
        let decoded = ControllerVersion::decode(&[0, 0, 0, 5, 0, 0, 0, 23, 0, 0, 0, 1, 0, 1, 0, 0]).expect("sound");
        assert_eq!(decoded.to_string(), "5.23.1.65536");
        assert!(ControllerVersion::decode(&[0; 15]).is_err());
    }
}
