//! The client against scripted and drawn streams.

use std::io::{self, Cursor, Read, Write};

use proptest::prelude::*;
use rivet_rtde::robot::CANDIDATES;
use rivet_rtde::{Client, Event, Fields, Listener, Recipe, RtdeError, TextMessage, Torque};

/// A stream of given bytes in pieces of given sizes, with a read without bytes between them; takes everything that is written.
struct Script {
    incoming: Cursor<Vec<u8>>,
    pieces: Vec<usize>,
    turn: usize,
    sent: Vec<u8>,
}

impl Script {
    fn new(incoming: Vec<u8>, pieces: Vec<usize>) -> Script {
        Script { incoming: Cursor::new(incoming), pieces, turn: 0, sent: Vec::new() }
    }
}

impl Read for Script {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        assert!(buffer.len() >= 4096, "room for a whole package");
        self.turn += 1;
        if self.turn.is_multiple_of(2) {
            return Err(io::ErrorKind::WouldBlock.into());
        }
        let piece = self.pieces.get(self.turn / 2 % self.pieces.len().max(1)).copied().unwrap_or(usize::MAX);
        let most = buffer.len().min(piece);
        self.incoming.read(&mut buffer[..most])
    }
}

impl Write for Script {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        self.sent.extend(buffer);
        Ok(buffer.len())
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Waits for so many looks, and keeps the texts.
struct Patience(usize, Vec<TextMessage>);

impl Listener for Patience {
    fn waits(&mut self) -> bool {
        self.0 = self.0.saturating_sub(1);
        self.0 > 0
    }
    fn text(&mut self, message: &TextMessage) {
        self.1.push(message.clone());
    }
}

fn patience() -> Patience {
    Patience(10_000, Vec::new())
}

/// A package, encoded without the crate.
fn package(kind: u8, payload: &[u8]) -> Vec<u8> {
    let size = payload.len() + 3;
    let mut bytes = vec![(size >> 8) as u8, size as u8, kind];
    bytes.extend(payload);
    bytes
}

const NAMES: [&str; 3] = ["timestamp", "actual_q", "actual_current_as_torque"];

fn handshake() -> Vec<u8> {
    let text = package(b'M', b"\x0cspeed \x1b[31m!\x04RTDE\x03");
    let version = package(b'v', &[0, 0, 0, 5, 0, 0, 0, 23, 0, 0, 0, 0, 0, 0, 0, 9]);
    let recipe = package(b'O', b"\x01DOUBLE,VECTOR6D,VECTOR6D");
    [package(b'V', &[1]), text, version, recipe, package(b'S', &[1])].concat()
}

fn data(k: u32) -> Vec<u8> {
    let mut payload = vec![1];
    payload.extend((f64::from(k) * 0.002).to_be_bytes());
    (0..12).for_each(|i| payload.extend((f64::from(k) + f64::from(i)).to_be_bytes()));
    package(b'U', &payload)
}

/// The whole conversation; the values of the data packages, the texts and the version.
fn converse(stream: Script) -> Result<(Vec<f64>, Patience, String), RtdeError> {
    let mut listener = patience();
    let mut client = Client::connect(stream, &mut listener)?;
    let version = client.version(&mut listener)?.to_string();
    let recipe = client.set_up(500.0, &NAMES, &mut listener)?;
    let Ok(fields) = Fields::new(&recipe, Torque::Converted) else { return Err(RtdeError::Protocol) };
    client.start(&mut listener)?;
    let mut seen = Vec::new();
    loop {
        match client.poll() {
            Ok(Event::Data(values)) => seen.push(fields.read(&values).q[0]),
            Ok(Event::Text(text)) => listener.text(&text),
            Ok(_) => {}
            Err(RtdeError::Closed) => return Ok((seen, listener, version)),
            Err(why) => return Err(why),
        }
    }
}

#[test]
fn requests_have_the_bytes_of_the_description() {
    let mut stream = Script::new(handshake(), Vec::new());
    let mut listener = patience();
    let mut client = Client::connect(&mut stream, &mut listener).expect("accepted");
    client.version(&mut listener).expect("known");
    client.set_up(125.0, &["timestamp", "actual_q", "actual_current"], &mut listener).expect("a recipe");
    client.start(&mut listener).expect("started");
    client.pause().expect("sent");
    let mut expected = vec![0, 5, b'V', 0, 2, 0, 3, b'v', 0, 44, b'O', 0x40, 0x5f, 0x40, 0, 0, 0, 0, 0];
    expected.extend(b"timestamp,actual_q,actual_current");
    expected.extend([0, 3, b'S', 0, 3, b'P']);
    assert_eq!(stream.sent, expected);
}

#[test]
fn refusals_are_told_apart() {
    let refused = |answer: Vec<u8>| Client::connect(Script::new(answer, Vec::new()), &mut patience()).err();
    assert!(matches!(refused(package(b'V', &[0])), Some(RtdeError::Protocol)));
    assert!(matches!(refused(package(b'V', &[])), Some(RtdeError::Malformed { .. })));
    assert!(matches!(refused(vec![0xff, 0xff, b'V']), Some(RtdeError::Size { size: 0xffff, .. })));
    assert!(matches!(refused(vec![0, 2, b'V']), Some(RtdeError::Size { size: 2, .. })));
    assert!(matches!(refused(Vec::new()), Some(RtdeError::Closed)));
    let silent = Client::connect(Script::new(vec![0, 4], vec![1, 1, 0]), &mut Patience(3, Vec::new())).err();
    assert!(matches!(silent, Some(RtdeError::NoAnswer { kind: b'V' })), "{silent:?}");
    let bytes = [package(b'V', &[1]), package(b'S', &[0])].concat();
    let mut client = Client::connect(Script::new(bytes, Vec::new()), &mut patience()).expect("accepted");
    assert!(matches!(client.start(&mut patience()), Err(RtdeError::Refused { kind: b'S' })));
}

/// A talker that never answers does not keep the client for ever.
#[test]
fn texts_without_an_answer_end_with_the_patience() {
    let texts = package(b'M', b"\x02hi\x00\x03").repeat(500);
    let mut listener = Patience(100, Vec::new());
    let ended = Client::connect(Script::new(texts, Vec::new()), &mut listener).err();
    assert!(matches!(ended, Some(RtdeError::NoAnswer { .. })), "{ended:?}");
    assert!(!listener.1.is_empty());
}

proptest! {
    /// However the bytes are cut into reads, every package arrives, in order.
    #[test]
    fn packages_survive_any_fragmentation(pieces in prop::collection::vec(1_usize..300, 1..40)) {
        let packages: Vec<u8> = (0..200).flat_map(data).collect();
        let (seen, listener, version) = converse(Script::new([handshake(), packages].concat(), pieces)).expect("sound");
        prop_assert_eq!(version, "5.23.0.9");
        prop_assert_eq!(seen, (0..200).map(f64::from).collect::<Vec<_>>());
        prop_assert_eq!(listener.1.len(), 1);
        prop_assert_eq!(&listener.1[0].text, "speed \u{1b}[31m!");
    }

    /// No bytes make the client panic or wait without end.
    #[test]
    fn drawn_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..600), begin in 0_usize..5) {
        let begin = handshake()[..[0, 4, 23, 42, 70][begin].min(handshake().len())].to_vec();
        let _ = converse(Script::new([begin, bytes].concat(), vec![7]));
    }

    /// Sound streams with some bytes changed: values, refusals, never a panic.
    #[test]
    fn damaged_streams_never_panic(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
        let packages: Vec<u8> = (0..20).flat_map(data).collect();
        let mut bytes = [handshake(), packages].concat();
        for (place, byte) in changes {
            let at = place.index(bytes.len());
            bytes[at] = byte;
        }
        let _ = converse(Script::new(bytes, vec![61]));
    }

    /// Payloads of each type decode or are refused.
    #[test]
    fn drawn_payloads_never_panic(payload in prop::collection::vec(any::<u8>(), 0..300), word in "[A-Z0-9_,]{0,200}") {
        let _ = TextMessage::decode(&payload);
        let _ = Recipe::decode(&NAMES, &payload);
        if let Ok(recipe) = Recipe::decode(&CANDIDATES, [&[1], word.as_bytes()].concat().as_slice()) {
            let _ = Torque::choose(&recipe, Some([1.0; 6]), true).map(|torque| Fields::names(&recipe, &torque));
        }
    }
}
