//! The links and joints of a URDF as written, read in one pass without recursion.
//!
//! Meshes, colours, transmissions and what else dynamics do not need are not looked at.

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use super::UrdfError;

/// Content of a URDF.
#[derive(Debug, Default)]
pub(super) struct Robot {
    pub(super) name: String,
    pub(super) links: Vec<Link>,
    pub(super) joints: Vec<Joint>,
}

/// A `<link>`. Without an `<inertial>` all its values are 0.
#[derive(Debug)]
pub(super) struct Link {
    pub(super) name: String,
    pub(super) inertial: Inertial,
}

/// An `<inertial>`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Inertial {
    pub(super) origin: Pose,
    /// \[kg\]
    pub(super) mass: f64,
    /// `ixx ixy ixz iyy iyz izz` about the centre of mass \[kg·m²\].
    pub(super) inertia: [f64; 6],
}

/// An `<origin>`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pose {
    /// \[m\]
    pub(super) xyz: [f64; 3],
    /// Roll, pitch, yaw \[rad\].
    pub(super) rpy: [f64; 3],
}

/// Kinds of joints that URDF has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum JointType {
    Revolute,
    Continuous,
    Prismatic,
    Fixed,
    Floating,
    Planar,
    Spherical,
}

/// A `<limit>`: 0, or an infinity since URDF 1.2, where it is not written.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Limit {
    pub(super) lower: f64,
    pub(super) upper: f64,
    pub(super) effort: f64,
    pub(super) velocity: f64,
}

/// A `<joint>`.
#[derive(Debug)]
pub(super) struct Joint {
    pub(super) name: String,
    pub(super) joint_type: JointType,
    pub(super) origin: Pose,
    pub(super) parent: String,
    pub(super) child: String,
    pub(super) axis: [f64; 3],
    pub(super) limit: Limit,
    /// The joint it follows.
    pub(super) mimic: Option<String>,
}

/// Version of the format in `<robot version>`: 1.1 has `quat_xyzw`, 1.2 infinite limits.
type Version = (u32, u32);

/// Reads a text that [`ensure_bounded`](crate::xml_limits::ensure_bounded) accepts.
///
/// # Errors
/// The first thing that is no XML or no URDF, with its line.
pub(super) fn read(text: &str) -> Result<Robot, UrdfError> {
    let root = Element::root(text)?;
    let number = |text: &str| text.parse::<u32>().ok();
    let version = root.attribute("version").and_then(|v| v.trim().split_once('.'));
    let version = version.and_then(|(major, minor)| Some((number(major)?, number(minor)?))).unwrap_or((1, 0));
    let mut robot = Robot { name: root.attribute("name").unwrap_or_default().to_owned(), ..Robot::default() };
    for element in &root.parts {
        match element.name.as_str() {
            "link" => robot.links.push(link(element, version)?),
            "joint" => robot.joints.push(joint(element, version)?),
            name if name.starts_with("xacro:") => {
                return Err(element.wrong("it is a xacro file: `xacro FILE > robot.urdf` makes a URDF of it"));
            }
            _ => {}
        }
    }
    Ok(robot)
}

fn link(element: &Element, version: Version) -> Result<Link, UrdfError> {
    let name = element.required("name")?.to_owned();
    let Some(inertial) = element.part("inertial")? else { return Ok(Link { name, inertial: Inertial::default() }) };
    let part = |part: &str| {
        inertial.part(part)?.ok_or_else(|| inertial.wrong(&format!("<inertial> of link \"{name}\" has no <{part}>")))
    };
    let (mass, inertia) = (part("mass")?, part("inertia")?);
    let mut values = [0.0; 6];
    for (value, key) in values.iter_mut().zip(["ixx", "ixy", "ixz", "iyy", "iyz", "izz"]) {
        inertia.required(key)?;
        *value = inertia.number(key, 0.0)?;
    }
    mass.required("value")?;
    let (origin, mass) = (pose(inertial, version)?, mass.number("value", 0.0)?);
    Ok(Link { name, inertial: Inertial { origin, mass, inertia: values } })
}

fn joint(element: &Element, version: Version) -> Result<Joint, UrdfError> {
    let name = element.required("name")?.to_owned();
    let joint_type = match element.required("type")? {
        "revolute" => JointType::Revolute,
        "continuous" => JointType::Continuous,
        "prismatic" => JointType::Prismatic,
        "fixed" => JointType::Fixed,
        "floating" => JointType::Floating,
        "planar" => JointType::Planar,
        "spherical" => JointType::Spherical,
        other => {
            let rule = "it has to be revolute, continuous, prismatic, fixed, floating, planar or spherical";
            return Err(element.wrong(&format!("joint \"{name}\" has type \"{other}\"; {rule}")));
        }
    };
    let end = |part: &str| {
        let link = element.part(part)?.and_then(|part| part.attribute("link"));
        let missing = || element.wrong(&format!("joint \"{name}\" has no <{part} link=\"...\"/>"));
        link.map(str::to_owned).ok_or_else(missing)
    };
    let (parent, child, origin) = (end("parent")?, end("child")?, pose(element, version)?);
    let axis = match element.part("axis")? {
        None => [1.0, 0.0, 0.0],
        Some(axis) => {
            axis.required("xyz")?;
            axis.numbers("xyz", [0.0; 3])?
        }
    };
    let limit = match element.part("limit")? {
        None => Limit::default(),
        Some(limit) => {
            let absent = if version >= (1, 2) { f64::INFINITY } else { 0.0 };
            Limit {
                lower: limit.number("lower", -absent)?,
                upper: limit.number("upper", absent)?,
                effort: limit.number("effort", absent)?,
                velocity: limit.number("velocity", absent)?,
            }
        }
    };
    let mimic = element.part("mimic")?.map(|mimic| mimic.required("joint").map(str::to_owned)).transpose()?;
    Ok(Joint { name, joint_type, origin, parent, child, axis, limit, mimic })
}

fn pose(element: &Element, version: Version) -> Result<Pose, UrdfError> {
    let Some(origin) = element.part("origin")? else { return Ok(Pose::default()) };
    let xyz = origin.numbers("xyz", [0.0; 3])?;
    if version < (1, 1) || origin.attribute("quat_xyzw").is_none() {
        return Ok(Pose { xyz, rpy: origin.numbers("rpy", [0.0; 3])? });
    }
    if origin.attribute("rpy").is_some() {
        return Err(origin.wrong("<origin> has both rpy and quat_xyzw; keep one of them"));
    }
    Ok(Pose { xyz, rpy: roll_pitch_yaw(origin.numbers("quat_xyzw", [0.0, 0.0, 0.0, 1.0])?) })
}

/// Sine of the pitch from which roll and yaw turn about one axis; as in `urdf::Rotation::getRPY` of urdfdom_headers.
const GIMBAL_LOCK_SINE: f64 = 0.99999;

/// Roll, pitch and yaw of a quaternion `x y z w` of any length; none of length 0.
fn roll_pitch_yaw(quaternion: [f64; 4]) -> [f64; 3] {
    let norm = quaternion.iter().map(|x| x * x).sum::<f64>().sqrt();
    if norm == 0.0 {
        return [0.0; 3];
    }
    let [x, y, z, w] = quaternion.map(|x| x / norm);
    let sine = 2.0 * (w * y - x * z);
    let quarter = std::f64::consts::FRAC_PI_2;
    if sine <= -GIMBAL_LOCK_SINE {
        return [0.0, -quarter, 2.0 * x.atan2(-y)];
    }
    if sine >= GIMBAL_LOCK_SINE {
        return [0.0, quarter, 2.0 * (-x).atan2(y)];
    }
    let (xx, yy, zz, ww) = (x * x, y * y, z * z, w * w);
    let roll = (2.0 * (y * z + w * x)).atan2(ww - xx - yy + zz);
    [roll, sine.asin(), (2.0 * (x * y + w * z)).atan2(ww + xx - yy - zz)]
}

/// Elements are kept down to so many levels: `<robot>`, `<link>`, `<inertial>`, `<mass>`.
const LEVELS: usize = 4;

/// An element of the XML.
struct Element {
    name: String,
    /// From 1.
    line: usize,
    attributes: Vec<(String, String)>,
    parts: Vec<Element>,
}

impl Element {
    /// The `<robot>` of a text with what dynamics need inside it.
    fn root(text: &str) -> Result<Element, UrdfError> {
        let mut reader = Reader::from_str(text);
        // Lines are counted along with the reader: each byte once.
        let (mut line, mut counted) = (1, 0);
        let (mut open, mut root): (Vec<Element>, Option<Element>) = (Vec::new(), None);
        let mut depth = 0_usize;
        loop {
            let start = (reader.buffer_position() as usize).min(text.len());
            line += text.as_bytes()[counted..start].iter().filter(|byte| **byte == b'\n').count();
            counted = start;
            let event = reader.read_event().map_err(|why| unreadable(line, &why.to_string()))?;
            let begun = match &event {
                Event::Start(tag) | Event::Empty(tag) => Some(tag),
                Event::End(_) => None,
                Event::Eof if depth > 0 => return Err(unreadable(line, "the text ends inside an element")),
                Event::Eof => return root.ok_or_else(|| unreadable(line, "there is no <robot> element")),
                _ => continue,
            };
            if let Some(tag) = begun {
                if depth == 0 && (root.is_some() || tag.name().as_ref() != "robot") {
                    return Err(unreadable(line, "a URDF is one <robot> element"));
                }
                if depth < LEVELS {
                    open.push(Element::new(tag, line)?);
                }
                depth += 1;
            }
            if !matches!(event, Event::Start(_)) {
                depth = depth.saturating_sub(1);
                if depth < LEVELS
                    && let Some(done) = open.pop()
                {
                    match open.last_mut() {
                        Some(outer) => outer.parts.push(done),
                        None => root = Some(done),
                    }
                }
            }
        }
    }

    fn new(tag: &BytesStart<'_>, line: usize) -> Result<Element, UrdfError> {
        let mut attributes = Vec::new();
        for attribute in tag.attributes() {
            let attribute = attribute.map_err(|why| unreadable(line, &why.to_string()))?;
            let value = quick_xml::escape::unescape(&attribute.value)
                .map_err(|why| unreadable(line, &why.to_string()))?
                .into_owned();
            attributes.push((attribute.key.as_ref().to_owned(), value));
        }
        Ok(Element { name: tag.name().as_ref().to_owned(), line, attributes, parts: Vec::new() })
    }

    fn wrong(&self, what: &str) -> UrdfError {
        unreadable(self.line, what)
    }

    fn attribute(&self, key: &str) -> Option<&str> {
        self.attributes.iter().find(|(name, _)| name == key).map(|(_, value)| value.as_str())
    }

    fn required(&self, key: &str) -> Result<&str, UrdfError> {
        self.attribute(key).ok_or_else(|| self.wrong(&format!("<{}> has no {key}", self.name)))
    }

    /// The part of this name, if there is one.
    fn part(&self, name: &str) -> Result<Option<&Element>, UrdfError> {
        let mut found = self.parts.iter().filter(|part| part.name == name);
        let first = found.next();
        match found.next() {
            Some(second) => Err(second.wrong(&format!("<{}> has a second <{name}>; keep one of them", self.name))),
            None => Ok(first),
        }
    }

    fn number(&self, key: &str, absent: f64) -> Result<f64, UrdfError> {
        self.numbers(key, [absent]).map(|[number]| number)
    }

    fn numbers<const N: usize>(&self, key: &str, absent: [f64; N]) -> Result<[f64; N], UrdfError> {
        let Some(text) = self.attribute(key) else { return Ok(absent) };
        let numbers: Result<Vec<f64>, _> = text.split_whitespace().map(str::parse).collect();
        numbers.ok().and_then(|numbers| numbers.try_into().ok()).ok_or_else(|| {
            let rule = if N == 1 { "a number".to_owned() } else { format!("{N} numbers with spaces between them") };
            self.wrong(&format!("{key} of <{}> is \"{text}\"; it has to be {rule}", self.name))
        })
    }
}

fn unreadable(line: usize, what: &str) -> UrdfError {
    UrdfError::Unreadable(format!("line {line}: {what}"))
}
