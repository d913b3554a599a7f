//! Values into a URDF's text, everything else in it left as it is.

use std::fmt::Write as _;
use std::ops::Range;

use super::scan::{Element, elements};
use super::{UrdfArm, UrdfError, UrdfMistakes, UrdfOptions};
use crate::link::LinkParameters;
use crate::mjcf::escaped;
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

/// Writes bodies and joint friction into the URDF `text`, which must be one that [`UrdfArm::read`] reads with these `options`.
///
/// * `links`: the body each joint moves, everything fixed to it included, about and in the joint frame. It becomes the
///   `<inertial>` of the moving link; links fixed or welded to that one lose theirs. What is fixed to the root does not move and
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
    options: &UrdfOptions,
    links: &[LinkParameters],
    viscous: &[f64],
    coulomb: &[f64],
) -> Result<WrittenUrdf, UrdfError> {
    let read = UrdfArm::read(text, [0.0; 3], options).map_err(UrdfMistakes::into_first)?;
    let (arm, carriers) = (&read.arm, &read.carriers);
    let n = arm.dof();
    assert!([links.len(), viscous.len(), coulomb.len()] == [n; 3], "one body and two friction values a joint");
    if let Some(j) = (0..n).find(|&j| links[j][0] <= 0.0) {
        return Err(UrdfError::NoMass { link: arm.joints[j].link.clone() });
    }
    let mut edits: Vec<(Range<usize>, String)> = Vec::new();
    let mut merged = Vec::new();
    let found = elements(text).map_err(|mistake| mistake.error)?;
    for element in &found {
        let Some(name) = element.attribute("name") else { continue };
        match element.name.as_str() {
            "link" => {
                let Some(&j) = carriers.get(name) else { continue };
                let carrier = &arm.joints[j].link;
                if name == carrier {
                    edits.push(edit(element, "inertial", &inertial_text(&links[j])));
                } else if let Some(part) = element.part("inertial") {
                    // A comment must not hold two hyphens.
                    let by = carrier.replace("--", "- -");
                    edits.push((part.place.clone(), format!("<!-- the mass of this link is part of {by} -->")));
                    merged.push((name.to_owned(), carrier.clone()));
                }
            }
            "joint" => {
                let Some(j) = arm.joints.iter().position(|joint| joint.name == name) else { continue };
                let dynamics = format!("<dynamics damping=\"{:?}\" friction=\"{:?}\"/>", viscous[j], coulomb[j]);
                edits.push(edit(element, "dynamics", &dynamics));
            }
            _ => {}
        }
    }
    edits.sort_by_key(|(place, _)| std::cmp::Reverse(place.start));
    let mut out = text.to_owned();
    for (place, new) in edits {
        out.replace_range(place, &new);
    }
    Ok(WrittenUrdf { text: out, merged })
}

/// Writes `efforts`, \[N·m or N\] by joint, as `<limit effort>` into the URDF `text`, where they are below what stands there. Joints without
/// a `<limit>` stay as they are: one with an effort needs a velocity, too.
///
/// # Errors
/// If the text is no XML, or has no `<robot>`.
pub fn write_efforts(text: &str, efforts: &[(&str, f64)]) -> Result<String, UrdfError> {
    let mut out = text.to_owned();
    // From the end on, so that places stay.
    for element in elements(text).map_err(|mistake| mistake.error)?.iter().rev().filter(|e| e.name == "joint") {
        let effort = efforts.iter().find(|(joint, _)| element.attribute("name") == Some(*joint));
        let (Some((_, effort)), Some(limit)) = (effort, element.part("limit")) else { continue };
        if limit
            .attribute("effort")
            .and_then(|text| text.trim().parse::<f64>().ok())
            .is_some_and(|most| most <= *effort)
        {
            continue;
        }
        let mut tag = "<limit".to_owned();
        for (name, value) in limit.attributes.iter().filter(|(name, _)| name != "effort") {
            // Writing to a String cannot fail.
            let _ = write!(tag, " {name}=\"{}\"", escaped(value));
        }
        let _ = write!(tag, " effort=\"{effort:?}\"{}>", if limit.empty { "/" } else { "" });
        out.replace_range(limit.tag.clone(), &tag);
    }
    Ok(out)
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

/// The edit that puts `new` in the place of `part` of an element, or first into the element.
fn edit(element: &Element, part: &str, new: &str) -> (Range<usize>, String) {
    let tag = &element.tag;
    match (element.part(part), element.empty) {
        (Some(part), _) => (part.place.clone(), new.to_owned()),
        (None, false) => (tag.end..tag.end, format!("\n    {new}")),
        (None, true) => (tag.end - 2..tag.end, format!(">\n    {new}\n  </{}>", element.name)),
    }
}
