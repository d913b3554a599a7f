//! Values into a URDF's text, everything else in it left as it is.

use std::collections::HashMap;
use std::fmt::Write as _;
use std::ops::Range;

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use super::UrdfError;
use super::description::{self, JointType};
use crate::arm::Arm;
use crate::parameters::LinkParameters;
use crate::pseudo_inertia::com_from_body;

/// A URDF with new values.
#[derive(Clone, Debug, PartialEq)]
pub struct WrittenUrdf {
    /// The file's text.
    pub text: String,
    /// Links whose own `<inertial>` is gone because the moving link that carries them has their mass now: link and
    /// moving link.
    pub merged: Vec<(String, String)>,
}

/// Writes bodies and joint friction into the URDF `text`, which must be one that [`Arm::from_urdf`] reads.
///
/// * `links`: the body each joint moves, everything fixed to it included, about and in the joint frame. It becomes the
///   `<inertial>` of the moving link; links fixed to that one lose theirs. What is fixed to the root does not move and
///   stays as it is.
/// * `viscous` \[N·m·s/rad\], `coulomb` \[N·m\]: `<dynamics damping friction>` of each joint
///
/// Comments, meshes, limits and unknown elements are kept letter by letter.
///
/// # Errors
/// If the text is no arm, or a body has no mass.
///
/// # Panics
/// If a list is not one entry a joint.
pub fn write_urdf(
    text: &str,
    links: &[LinkParameters],
    viscous: &[f64],
    coulomb: &[f64],
) -> Result<WrittenUrdf, UrdfError> {
    let arm = Arm::from_urdf(text, [0.0; 3])?;
    let n = arm.dof();
    assert!([links.len(), viscous.len(), coulomb.len()] == [n; 3], "one body and two friction values a joint");
    if let Some(j) = (0..n).find(|&j| links[j][0] <= 0.0) {
        return Err(UrdfError::NoMass { link: arm.joints[j].link.clone() });
    }
    let carriers = carriers(text, &arm)?;
    let mut edits: Vec<(Range<usize>, String)> = Vec::new();
    let mut merged = Vec::new();
    for element in elements(text)? {
        match element.kind {
            Kind::Link => {
                let Some(&j) = carriers.get(&element.name) else { continue };
                let carrier = &arm.joints[j].link;
                if element.name == *carrier {
                    edits.push(element.edit(&inertial_text(&links[j])));
                } else if let Some(place) = element.inner {
                    // A comment must not hold two hyphens.
                    let by = carrier.replace("--", "- -");
                    edits.push((place, format!("<!-- the mass of this link is part of {by} -->")));
                    merged.push((element.name, carrier.clone()));
                }
            }
            Kind::Joint => {
                let Some(j) = arm.joints.iter().position(|joint| joint.name == element.name) else { continue };
                let dynamics = format!("<dynamics damping=\"{:?}\" friction=\"{:?}\"/>", viscous[j], coulomb[j]);
                edits.push(element.edit(&dynamics));
            }
        }
    }
    edits.sort_by_key(|(place, _)| std::cmp::Reverse(place.start));
    let mut out = text.to_owned();
    for (place, new) in edits {
        out.replace_range(place, &new);
    }
    Ok(WrittenUrdf { text: out, merged })
}

/// The joint that moves each link which moves.
fn carriers(text: &str, arm: &Arm) -> Result<HashMap<String, usize>, UrdfError> {
    let robot = description::read(text)?;
    let above: HashMap<&str, &description::Joint> = robot.joints.iter().map(|j| (j.child.as_str(), j)).collect();
    let moved_by = |link: &str| {
        let mut joint = *above.get(link)?;
        // The arm was read: there is no loop.
        while joint.joint_type == JointType::Fixed {
            joint = above.get(joint.parent.as_str())?;
        }
        arm.joints.iter().position(|j| j.name == joint.name)
    };
    Ok(robot.links.iter().filter_map(|l| Some((l.name.clone(), moved_by(&l.name)?))).collect())
}

fn inertial_text(body: &LinkParameters) -> String {
    let (mass, c, i) = com_from_body(body);
    let mut out = String::from("<inertial>\n");
    // Writing to a String cannot fail. `{:?}` gives the shortest text that reads back as the same number.
    let _ = writeln!(out, "      <origin xyz=\"{:?} {:?} {:?}\" rpy=\"0 0 0\"/>", c[0], c[1], c[2]);
    let _ = writeln!(out, "      <mass value=\"{mass:?}\"/>");
    let _ = writeln!(
        out,
        "      <inertia ixx=\"{:?}\" ixy=\"{:?}\" ixz=\"{:?}\" iyy=\"{:?}\" iyz=\"{:?}\" izz=\"{:?}\"/>",
        i[0][0], i[0][1], i[0][2], i[1][1], i[1][2], i[2][2]
    );
    out + "    </inertial>"
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Link,
    Joint,
}

/// A `<link>` or `<joint>` directly below `<robot>`.
struct Element {
    kind: Kind,
    name: String,
    /// Its start tag.
    tag: Range<usize>,
    /// The tag ends in `/>`.
    empty: bool,
    /// Where its `<inertial>` or `<dynamics>` stands, if it has one.
    inner: Option<Range<usize>>,
}

impl Element {
    /// The edit that puts `new` in the place of the inner element, or first into the element.
    fn edit(&self, new: &str) -> (Range<usize>, String) {
        match (&self.inner, self.empty) {
            (Some(place), _) => (place.clone(), new.to_owned()),
            (None, false) => (self.tag.end..self.tag.end, format!("\n    {new}")),
            (None, true) => {
                let element = if self.kind == Kind::Link { "link" } else { "joint" };
                (self.tag.end - 2..self.tag.end, format!(">\n    {new}\n  </{element}>"))
            }
        }
    }
}

/// Links and joints of a URDF with the places in its text that hold their values.
fn elements(text: &str) -> Result<Vec<Element>, UrdfError> {
    let unreadable = |why: &dyn std::fmt::Display| UrdfError::Unreadable(why.to_string());
    let mut reader = Reader::from_str(text);
    let mut found: Vec<Element> = Vec::new();
    // Names of the open elements, and where the inner element that is open began.
    let (mut depth, mut inside, mut began) = (0_usize, false, None);
    loop {
        let start = reader.buffer_position() as usize;
        let event = reader.read_event().map_err(|e| unreadable(&e))?;
        let end = reader.buffer_position() as usize;
        match &event {
            Event::Eof => return Ok(found),
            Event::Start(tag) | Event::Empty(tag) => {
                let empty = matches!(event, Event::Empty(_));
                if depth == 1 {
                    let element = element(tag, start..end, empty).map_err(|e| unreadable(&e))?;
                    inside = element.is_some() && !empty;
                    found.extend(element);
                } else if depth == 2
                    && inside
                    && let Some(last) = found.last_mut()
                {
                    let wanted = if last.kind == Kind::Link { "inertial" } else { "dynamics" };
                    if tag.name().as_ref() == wanted {
                        if empty {
                            last.inner = Some(start..end);
                        } else {
                            began = Some(start);
                        }
                    }
                }
                depth += usize::from(!empty);
            }
            Event::End(_) => {
                depth = depth.saturating_sub(1);
                if depth == 2
                    && let (Some(start), Some(last)) = (began.take(), found.last_mut())
                {
                    last.inner = Some(start..end);
                }
                inside &= depth > 1;
            }
            _ => {}
        }
    }
}

fn element(tag: &BytesStart<'_>, place: Range<usize>, empty: bool) -> Result<Option<Element>, quick_xml::Error> {
    let kind = match tag.name().as_ref() {
        "link" => Kind::Link,
        "joint" => Kind::Joint,
        _ => return Ok(None),
    };
    let Some(name) = tag.try_get_attribute("name")? else { return Ok(None) };
    let name = quick_xml::escape::unescape(&name.value)?.into_owned();
    Ok(Some(Element { kind, name, tag: place, empty, inner: None }))
}
