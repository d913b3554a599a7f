//! Where links, joints and their parts stand in the text of a URDF: one pass over the events of the XML, no recursion.

use std::ops::Range;

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use super::error::{UrdfError, UrdfMistake};

/// Start of each line of a text.
pub(super) struct Lines(Vec<usize>);

impl Lines {
    pub(super) fn new(text: &str) -> Lines {
        Lines(text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n').map(|(at, _)| at + 1).collect())
    }

    /// The line (from 1) of a byte.
    pub(super) fn of(&self, byte: usize) -> usize {
        self.0.partition_point(|start| *start <= byte) + 1
    }
}

/// An element of the XML with its place in the text.
#[derive(Debug)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) attributes: Vec<(String, String)>,
    /// From the start tag to the end tag \[bytes\].
    pub(super) place: Range<usize>,
    /// Its start tag.
    pub(super) tag: Range<usize>,
    /// The start tag ends in `/>`.
    pub(super) empty: bool,
    /// Elements inside it, down to three levels below `<robot>`.
    pub(super) parts: Vec<Element>,
}

impl Element {
    pub(super) fn attribute(&self, key: &str) -> Option<&str> {
        self.attributes.iter().find(|(name, _)| name == key).map(|(_, value)| value.as_str())
    }

    /// The first part of this name.
    pub(super) fn part(&self, name: &str) -> Option<&Element> {
        self.parts.iter().find(|part| part.name == name)
    }

    /// The byte behind the name of the element in its start tag: attributes can be put there.
    pub(super) fn behind_name(&self) -> usize {
        self.tag.start + 1 + self.name.len()
    }
}

/// Parts are kept of elements so deep below `<robot>`: `<link>`, `<inertial>`, `<mass>`.
const DEPTH: usize = 3;

/// The elements below `<robot>`, in the order of the text. Places count from the start of `text`, a byte order mark included.
///
/// # Errors
/// When the text is no XML, or has no `<robot>`.
pub(super) fn elements(text: &str) -> Result<Vec<Element>, UrdfMistake> {
    let lines = Lines::new(text);
    // A byte order mark is no part of the file.
    let body = text.strip_prefix('\u{feff}').unwrap_or(text);
    let before = text.len() - body.len();
    let mut reader = Reader::from_str(body);
    let mut scan = Scan::default();
    loop {
        let start = before + reader.buffer_position() as usize;
        let unreadable = |why: String| UrdfMistake { line: lines.of(start), error: UrdfError::Unreadable(why) };
        let event = reader.read_event().map_err(|why| unreadable(why.to_string()))?;
        let place = start..before + reader.buffer_position() as usize;
        match &event {
            Event::Eof if scan.depth > 0 => return Err(unreadable("it ends inside an element".to_owned())),
            Event::Eof if !scan.begun => return Err(unreadable("it has no <robot> element".to_owned())),
            Event::Eof => return Ok(scan.found),
            Event::Start(tag) => scan.start(tag, place, false).map_err(unreadable)?,
            Event::Empty(tag) => scan.start(tag, place, true).map_err(unreadable)?,
            Event::End(_) => scan.end(place.end),
            _ => {}
        }
    }
}

#[derive(Default)]
struct Scan {
    found: Vec<Element>,
    /// Elements that are open below `<robot>`, outermost first.
    open: Vec<Element>,
    /// Elements that are open, `<robot>` included.
    depth: usize,
    begun: bool,
}

impl Scan {
    fn start(&mut self, tag: &BytesStart<'_>, place: Range<usize>, empty: bool) -> Result<(), String> {
        if self.depth == 0 {
            let name = tag.name().as_ref().to_owned();
            if name != "robot" || self.begun {
                return Err(format!("its root is <{name}>, not <robot>"));
            }
            self.begun = true;
        } else if self.depth <= DEPTH {
            self.open.push(element(tag, place.clone(), empty)?);
        }
        self.depth += 1;
        if empty {
            self.end(place.end);
        }
        Ok(())
    }

    fn end(&mut self, at: usize) {
        self.depth = self.depth.saturating_sub(1);
        if self.depth == 0 || self.depth > DEPTH {
            return;
        }
        let Some(mut element) = self.open.pop() else { return };
        element.place.end = at;
        match self.open.last_mut() {
            Some(outer) => outer.parts.push(element),
            None => self.found.push(element),
        }
    }
}

fn element(tag: &BytesStart<'_>, place: Range<usize>, empty: bool) -> Result<Element, String> {
    let mut attributes = Vec::new();
    for attribute in tag.attributes() {
        let attribute = attribute.map_err(|why| why.to_string())?;
        let value = quick_xml::escape::unescape(&attribute.value).map_err(|why| why.to_string())?.into_owned();
        attributes.push((attribute.key.as_ref().to_owned(), value));
    }
    let name = tag.name().as_ref().to_owned();
    Ok(Element { name, attributes, place: place.clone(), tag: place, empty, parts: Vec::new() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_count_from_one() {
        let lines = Lines::new("a\nbc\n\nd");
        assert_eq!([0, 1, 2, 4, 5, 6].map(|byte| lines.of(byte)), [1, 1, 2, 2, 3, 4]);
    }

    #[test]
    fn places_cut_elements_out_of_the_text() {
        for mark in ["", "\u{feff}"] {
            let text = format!(
                "{mark}<robot name=\"r\"><link name='a'><inertial><mass value=\"1\"/></inertial></link><x/></robot>"
            );
            let found = elements(&text).expect("XML");
            assert_eq!(found.len(), 2);
            assert_eq!(&text[found[1].place.clone()], "<x/>");
            let inertial = found[0].part("inertial").expect("an inertial");
            assert_eq!(&text[inertial.place.clone()], "<inertial><mass value=\"1\"/></inertial>");
            assert_eq!(&text[inertial.tag.clone()], "<inertial>");
            let mass = inertial.part("mass").expect("a mass");
            assert_eq!(
                (mass.attribute("value"), &text[mass.behind_name()..mass.tag.end]),
                (Some("1"), " value=\"1\"/>")
            );
        }
    }
}
