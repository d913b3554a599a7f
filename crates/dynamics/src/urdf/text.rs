//! The text of a URDF as values with their lines.
//!
//! urdf-rs reads the content. Before it, each element is looked at with its line: a value that is no number, a part that is missing or there
//! twice is a mistake of that line. What holds such a mistake, and what dynamics do not need (meshes, colours, transmissions), is taken out of
//! the text that urdf-rs reads, so that it finds the rest. A mistake of an `<inertial>` is kept with its link: one that never moves has none.

use std::ops::Range;

use super::error::{UrdfError, UrdfMistake, UrdfMistakes};
use super::scan::{Element, Lines, elements};
use crate::xml_limits::ensure_bounded;

/// A URDF as written.
#[derive(Debug, Default)]
pub(super) struct File {
    pub(super) name: String,
    pub(super) links: Vec<Link>,
    pub(super) joints: Vec<Joint>,
}

/// A `<link>`.
#[derive(Debug)]
pub(super) struct Link {
    pub(super) name: String,
    pub(super) line: usize,
    pub(super) inertial: Option<Inertial>,
}

/// An `<inertial>`.
#[derive(Debug)]
pub(super) struct Inertial {
    pub(super) line: usize,
    pub(super) values: urdf_rs::Inertial,
    /// What cannot be read of it; the values are 0 then.
    pub(super) unreadable: Vec<UrdfMistake>,
}

/// `<mimic>`: `multiplier * position of the other joint + offset`.
#[derive(Clone, Debug)]
pub(super) struct Mimic {
    pub(super) joint: String,
    pub(super) multiplier: f64,
    pub(super) offset: f64,
}

/// A `<joint>`.
#[derive(Debug)]
pub(super) struct Joint {
    pub(super) name: String,
    pub(super) line: usize,
    /// Its type as written.
    pub(super) kind: String,
    pub(super) origin: urdf_rs::Pose,
    pub(super) parent: String,
    pub(super) child: String,
    pub(super) axis: [f64; 3],
    pub(super) limit: urdf_rs::JointLimit,
    /// `damping` and `friction`, where there is a `<dynamics>`.
    pub(super) dynamics: Option<[f64; 2]>,
    pub(super) mimic: Option<Mimic>,
    /// What cannot be read of it; those values are as if they were not there.
    pub(super) unreadable: Vec<UrdfMistake>,
}

/// Reads the text of a URDF.
///
/// # Errors
/// When it is no XML, has no `<robot>`, or lacks what makes a link or a joint.
pub(super) fn read(text: &str) -> Result<File, UrdfMistakes> {
    ensure_bounded(text).map_err(|excess| UrdfMistake { line: 0, error: excess.into() })?;
    let elements = elements(text)?;
    let mut looked = Looked { lines: Lines::new(text), edits: Vec::new(), mistakes: Vec::new(), file: File::default() };
    for element in &elements {
        match element.name.as_str() {
            "link" => looked.link(element),
            "joint" => looked.joint(element),
            name if name.starts_with("xacro:") => {
                let why = "it is a xacro file, not yet a URDF: write one with `xacro FILE > robot.urdf`";
                looked.fail(element, UrdfError::Unreadable(why.to_owned()));
                break;
            }
            _ => looked.edits.push((element.place.clone(), String::new())),
        }
    }
    let Looked { mistakes, mut edits, file, .. } = looked;
    if !mistakes.is_empty() {
        return Err(UrdfMistakes::new(mistakes));
    }
    edits.sort_by_key(|(place, _)| place.start);
    let mut needed = String::with_capacity(text.len());
    // A byte order mark is no part of the file.
    let mut from = text.len() - text.strip_prefix('\u{feff}').unwrap_or(text).len();
    for (place, new) in edits {
        needed.push_str(&text[from..place.start]);
        needed.push_str(&new);
        from = place.end;
    }
    needed.push_str(&text[from..]);
    let unreadable = |why: String| UrdfMistake { line: 0, error: UrdfError::Unreadable(why) };
    let robot = urdf_rs::read_from_string(&needed).map_err(|why| unreadable(why.to_string()))?;
    if [robot.links.len(), robot.joints.len()] != [file.links.len(), file.joints.len()] {
        return Err(unreadable("its links and joints cannot be counted".to_owned()).into());
    }
    Ok(filled(file, robot))
}

/// What was found in the text together with the values that urdf-rs read.
fn filled(mut file: File, robot: urdf_rs::Robot) -> File {
    file.name = robot.name;
    for (link, values) in file.links.iter_mut().zip(robot.links) {
        if let Some(inertial) = &mut link.inertial {
            inertial.values = values.inertial;
        }
    }
    for (joint, values) in file.joints.iter_mut().zip(robot.joints) {
        joint.origin = values.origin;
        joint.parent = values.parent.link;
        joint.child = values.child.link;
        joint.axis = values.axis.xyz.0;
        joint.limit = values.limit;
        joint.dynamics = values.dynamics.map(|dynamics| [dynamics.damping, dynamics.friction]);
        joint.mimic = values.mimic.map(|mimic| Mimic {
            joint: mimic.joint,
            multiplier: mimic.multiplier.unwrap_or(1.0),
            offset: mimic.offset.unwrap_or(0.0),
        });
    }
    file
}

/// An attribute that holds numbers: key, how many, what it is.
type Number = (&'static str, usize, &'static str);

/// Parts of a joint that urdf-rs reads, and their attributes that are numbers.
const JOINT_NUMBERS: [(&str, &[Number]); 5] = [
    ("origin", &POSE),
    ("axis", &[("xyz", 3, "axis")]),
    (
        "limit",
        &[
            ("lower", 1, "lower limit"),
            ("upper", 1, "upper limit"),
            ("effort", 1, "effort"),
            ("velocity", 1, "velocity"),
        ],
    ),
    ("dynamics", &[("damping", 1, "damping"), ("friction", 1, "friction")]),
    ("mimic", &[("multiplier", 1, "mimic multiplier"), ("offset", 1, "mimic offset")]),
];
/// The same of an `<inertial>`.
const INERTIAL_NUMBERS: [(&str, &[Number]); 3] = [
    ("origin", &POSE),
    ("mass", &[("value", 1, "mass")]),
    (
        "inertia",
        &[
            ("ixx", 1, "inertia ixx"),
            ("ixy", 1, "inertia ixy"),
            ("ixz", 1, "inertia ixz"),
            ("iyy", 1, "inertia iyy"),
            ("iyz", 1, "inertia iyz"),
            ("izz", 1, "inertia izz"),
        ],
    ),
];
const POSE: [Number; 2] = [("xyz", 3, "origin xyz"), ("rpy", 3, "origin rpy")];
/// Types of joints that urdf-rs knows.
const KINDS: [&str; 7] = ["revolute", "continuous", "prismatic", "fixed", "floating", "planar", "spherical"];

/// A text as far as it has been looked at.
struct Looked {
    lines: Lines,
    /// Changes of the text before urdf-rs reads it.
    edits: Vec<(Range<usize>, String)>,
    /// What ends the reading.
    mistakes: Vec<UrdfMistake>,
    file: File,
}

impl Looked {
    fn fail(&mut self, at: &Element, error: UrdfError) {
        self.mistakes.push(self.mistake(at, error));
    }

    fn mistake(&self, at: &Element, error: UrdfError) -> UrdfMistake {
        UrdfMistake { line: self.lines.of(at.tag.start), error }
    }

    fn remove(&mut self, element: &Element) {
        self.edits.push((element.place.clone(), String::new()));
    }

    fn link(&mut self, element: &Element) {
        let Some(name) = element.attribute("name") else {
            return self.fail(element, UrdfError::Unreadable("a <link> has no name".to_owned()));
        };
        let mut inertial = None;
        for part in &element.parts {
            if part.name != "inertial" {
                self.remove(part);
            } else if inertial.is_some() {
                self.fail(
                    part,
                    UrdfError::Repeated { what: "link", name: name.to_owned(), element: "inertial".to_owned() },
                );
            } else if part.parts.is_empty() {
                // As if it was not there.
                self.remove(part);
            } else {
                inertial = Some(self.inertial(name, part));
            }
        }
        let line = self.lines.of(element.tag.start);
        self.file.links.push(Link { name: name.to_owned(), line, inertial });
    }

    fn inertial(&mut self, link: &str, element: &Element) -> Inertial {
        let (mut unreadable, before) = (Vec::new(), self.edits.len());
        for (part, keys) in INERTIAL_NUMBERS {
            let found = element.parts.iter().filter(|of| of.name == part).collect::<Vec<_>>();
            let missing = |quantity: &'static str| UrdfError::Missing { what: "link", name: link.to_owned(), quantity };
            match found[..] {
                [] if part == "mass" => unreadable.push(self.mistake(element, missing("<mass> in its <inertial>"))),
                [] if part == "inertia" => {
                    unreadable.push(self.mistake(element, missing("<inertia> in its <inertial>")));
                }
                [] => {}
                [one] => {
                    unreadable.extend(self.numbers(("link", link), one, keys));
                    for (key, _, quantity) in keys {
                        if one.attribute(key).is_some() || part == "origin" {
                            continue;
                        }
                        if ["ixy", "ixz", "iyz"].contains(key) {
                            // Principal axes.
                            let at = one.behind_name();
                            self.edits.push((at..at, format!(" {key}=\"0\"")));
                        } else {
                            unreadable.push(self.mistake(one, missing(quantity)));
                        }
                    }
                }
                [_, second, ..] => {
                    let error = UrdfError::Repeated { what: "link", name: link.to_owned(), element: part.to_owned() };
                    unreadable.push(self.mistake(second, error));
                }
            }
        }
        if !unreadable.is_empty() {
            // What was to be put into it goes with it.
            self.edits.truncate(before);
            self.remove(element);
        }
        Inertial { line: self.lines.of(element.tag.start), values: urdf_rs::Inertial::default(), unreadable }
    }

    fn joint(&mut self, element: &Element) {
        let (Some(name), Some(kind)) = (element.attribute("name"), element.attribute("type")) else {
            let missing = if element.attribute("name").is_none() { "name" } else { "type" };
            return self.fail(element, UrdfError::Unreadable(format!("a <joint> has no {missing}")));
        };
        if !KINDS.contains(&kind) {
            // Of the chain, the type as written is refused.
            let name = quick_xml::escape::escape(name);
            let end = if element.empty { "/>" } else { ">" };
            self.edits.push((element.tag.clone(), format!("<joint name=\"{name}\" type=\"floating\"{end}")));
        }
        for (part, quantity) in [("parent", "<parent link=...>"), ("child", "<child link=...>")] {
            if element.part(part).and_then(|part| part.attribute("link")).is_none() {
                self.fail(element, UrdfError::Missing { what: "joint", name: name.to_owned(), quantity });
            }
        }
        let mut unreadable = Vec::new();
        let mut seen: Vec<&str> = Vec::new();
        for part in &element.parts {
            let keys = JOINT_NUMBERS.iter().find(|(of, _)| *of == part.name).map(|(_, keys)| *keys);
            let needed = keys.is_some() || part.name == "parent" || part.name == "child";
            if !needed {
                self.remove(part);
                continue;
            }
            if seen.contains(&part.name.as_str()) {
                let error = UrdfError::Repeated { what: "joint", name: name.to_owned(), element: part.name.clone() };
                self.fail(part, error);
                continue;
            }
            seen.push(&part.name);
            unreadable.extend(self.joint_part(name, part, keys.unwrap_or(&[])));
        }
        let line = self.lines.of(element.tag.start);
        self.file.joints.push(Joint {
            name: name.to_owned(),
            line,
            kind: kind.to_owned(),
            origin: urdf_rs::Pose::default(),
            parent: String::new(),
            child: String::new(),
            axis: [0.0; 3],
            limit: urdf_rs::JointLimit::default(),
            dynamics: None,
            mimic: None,
            unreadable,
        });
    }

    /// Mistakes of a part of a joint, which is taken out of the text then.
    fn joint_part(&mut self, joint: &str, part: &Element, keys: &[Number]) -> Vec<UrdfMistake> {
        let before = self.edits.len();
        let mut unreadable = self.numbers(("joint", joint), part, keys);
        let missing = |quantity| UrdfError::Missing { what: "joint", name: joint.to_owned(), quantity };
        match part.name.as_str() {
            "mimic" if part.attribute("joint").is_none() => {
                unreadable.push(self.mistake(part, missing("joint=... in its <mimic>")));
            }
            "axis" if part.attribute("xyz").is_none() => {
                unreadable.push(self.mistake(part, missing("xyz=... in its <axis>")));
            }
            // No limit, as one of 0; urdf-rs wants it to be written.
            "limit" if part.attribute("velocity").is_none() => {
                let at = part.behind_name();
                self.edits.push((at..at, " velocity=\"0\"".to_owned()));
            }
            _ => {}
        }
        if !unreadable.is_empty() {
            self.edits.truncate(before);
            self.remove(part);
        }
        unreadable
    }

    /// Attributes that should be so many numbers and are not.
    fn numbers(&self, (what, name): (&'static str, &str), element: &Element, keys: &[Number]) -> Vec<UrdfMistake> {
        let wrong = |(key, count, quantity): &Number| {
            let written = element.attribute(key)?;
            let values: Result<Vec<f64>, _> = written.split_whitespace().map(str::parse).collect();
            if values.is_ok_and(|values| values.len() == *count) {
                return None;
            }
            let expected = if *count == 1 { "a number" } else { "three numbers" };
            let (name, value) = (name.to_owned(), written.to_owned());
            Some(self.mistake(element, UrdfError::NoNumber { what, name, quantity, value, expected }))
        };
        keys.iter().filter_map(wrong).collect()
    }
}
