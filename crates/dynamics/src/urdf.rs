//! From a URDF file to an [`Arm`]: checks that it is a serial chain of physical bodies, and merges fixed joints.

mod description;
mod write;

use std::collections::{HashMap, HashSet};

use nalgebra::Matrix3;

use crate::arm::{Arm, Joint, JointKind, MAX_JOINTS};
use crate::parameters::{LINK_PARAMETERS, LinkParameters, assemble, body_in_frame, inertia_matrix};
use crate::pseudo_inertia::com_from_body;
use crate::spatial::{IDENTITY, Mat3, Vec3, add, dot, from_roll_pitch_yaw, multiply, rotate, scale};

use description::{JointType, Pose};
pub use write::{WrittenUrdf, write_urdf};

/// By how much of the largest principal moment the triangle inequality may be missed: a plate's moments rounded to
/// three digits miss it by about this much.
const TRIANGLE_ROUNDING: f64 = 1e-3;

/// Why a URDF is not an arm that can be modelled. Names are those of the file.
#[derive(Debug, thiserror::Error)]
pub enum UrdfError {
    /// Not XML, or not a URDF.
    #[error("cannot be read as a URDF: {0}")]
    Unreadable(String),
    /// Too deep, too many or too long for any arm.
    #[error("cannot be read as a URDF: {0}")]
    Excess(#[from] crate::xml_limits::XmlExcess),
    /// Nothing moves.
    #[error("has no revolute, continuous or prismatic joint")]
    NoJoints,
    /// More joints than the messages have room for.
    #[error("has {count} moving joints; at most {MAX_JOINTS} are supported")]
    TooManyJoints {
        /// Moving joints found.
        count: usize,
    },
    /// Two links or two joints have one name.
    #[error("{what} \"{name}\" is defined twice")]
    Duplicate {
        /// "link" or "joint".
        what: &'static str,
        /// The name.
        name: String,
    },
    /// A joint names a link that is not there.
    #[error("joint \"{joint}\" refers to link \"{link}\", which is not defined")]
    UnknownLink {
        /// The joint.
        joint: String,
        /// The missing link.
        link: String,
    },
    /// A tree where a chain is needed.
    #[error(
        "link \"{link}\" carries two moving joints, \"{first}\" and \"{second}\"; only serial chains are supported"
    )]
    Branches {
        /// The link, after merging those fixed to it.
        link: String,
        /// One moving child joint.
        first: String,
        /// The other.
        second: String,
    },
    /// A closed loop.
    #[error("link \"{link}\" is the child of two joints, \"{first}\" and \"{second}\"; loops are not supported")]
    SecondParent {
        /// The child.
        link: String,
        /// One joint.
        first: String,
        /// The other.
        second: String,
    },
    /// Links that are each other's parents.
    #[error("link \"{link}\" hangs on itself through its parents; loops are not supported")]
    Loop {
        /// A link of the loop.
        link: String,
    },
    /// More than one link without a parent.
    #[error("links \"{first}\" and \"{second}\" both have no parent; one root is needed")]
    SeveralRoots {
        /// One root.
        first: String,
        /// Another.
        second: String,
    },
    /// A joint that follows another.
    #[error("joint \"{joint}\" mimics \"{of}\"; mimic joints are not supported")]
    Mimic {
        /// The follower.
        joint: String,
        /// The joint it follows.
        of: String,
    },
    /// Floating, planar or spherical.
    #[error("joint \"{joint}\" is {kind}; only revolute, continuous, prismatic and fixed joints are supported")]
    UnsupportedJoint {
        /// The joint.
        joint: String,
        /// Its type.
        kind: &'static str,
    },
    /// A NaN or an infinity.
    #[error("{what} \"{name}\": {quantity} is {value}, which is not a finite number")]
    NotFinite {
        /// "link" or "joint".
        what: &'static str,
        /// Its name.
        name: String,
        /// Which number.
        quantity: &'static str,
        /// What it is.
        value: f64,
    },
    /// An axis without direction.
    #[error("joint \"{joint}\" has axis 0 0 0, which has no direction")]
    ZeroAxis {
        /// The joint.
        joint: String,
    },
    /// Limits the wrong way round.
    #[error("joint \"{joint}\" has lower limit {lower} above upper limit {upper}")]
    Limits {
        /// The joint.
        joint: String,
        /// Its lower limit.
        lower: f64,
        /// Its upper limit.
        upper: f64,
    },
    /// A speed or effort limit below zero.
    #[error("joint \"{joint}\" has {quantity} limit {value}, which is negative")]
    NegativeLimit {
        /// The joint.
        joint: String,
        /// "velocity" or "effort".
        quantity: &'static str,
        /// What it is.
        value: f64,
    },
    /// A moving link without mass, itself and on its fixed joints.
    #[error(
        "link \"{link}\" is moved by a joint but has no mass: it needs an <inertial> with mass > 0, \
         or a link with mass fixed to it"
    )]
    NoMass {
        /// The moving link.
        link: String,
    },
    /// An `<inertial>` whose mass cannot be.
    #[error("link \"{link}\" has mass {mass} kg with an inertial that needs a positive one")]
    BadMass {
        /// The link.
        link: String,
        /// Its mass.
        mass: f64,
    },
    /// An inertia that no mass distribution has.
    #[error(
        "link \"{link}\": inertia about the centre of mass is not positive definite: smallest principal moment {moment:e} kg m^2"
    )]
    NotPositiveDefinite {
        /// The link.
        link: String,
        /// Smallest principal moment \[kg·m²\].
        moment: f64,
    },
    /// An inertia that no mass distribution has.
    #[error(
        "link \"{link}\": principal moments {0:e}, {1:e}, {2:e} kg m^2 violate the triangle inequality: \
         the largest exceeds the sum of the others", moments[0], moments[1], moments[2]
    )]
    TriangleInequality {
        /// The link.
        link: String,
        /// Principal moments \[kg·m²\], ascending.
        moments: [f64; 3],
    },
}

impl Arm {
    /// Reads a URDF. `gravity` \[m/s²\] is given in the frame of the file's root link.
    ///
    /// Links on fixed joints are merged into the link that carries them; what is fixed to the root does not move and
    /// is dropped. A `continuous` joint, and one whose limits are absent or both 0, has no position limit; a speed or
    /// effort limit that is absent or 0 is none.
    ///
    /// # Errors
    /// The first thing found that keeps the file from being a chain of 1 to [`MAX_JOINTS`] physical bodies.
    pub fn from_urdf(text: &str, gravity: [f64; 3]) -> Result<Arm, UrdfError> {
        crate::xml_limits::ensure_bounded(text)?;
        let robot = description::read(text)?;
        let tree = Tree::new(&robot)?;
        let mut joints: Vec<Joint> = Vec::new();
        let mut links = Vec::new();
        let (mut carrier, mut base) = (tree.root, true);
        loop {
            let rigid = tree.gather(carrier)?;
            if !base {
                check_moving_body(&robot.links[carrier].name, &rigid.body)?;
                links.push(rigid.body);
            }
            let Some((next, rotation, translation)) = rigid.next else { break };
            joints.push(moving_joint(next, &rotation, &translation)?);
            (carrier, base) = (tree.index[next.child.as_str()], false);
        }
        match joints.len() {
            0 => Err(UrdfError::NoJoints),
            count if count > MAX_JOINTS => Err(UrdfError::TooManyJoints { count }),
            _ => Ok(Arm { name: robot.name, joints, links, gravity }),
        }
    }
}

/// The file's links and joints, known to hang on one root without loops.
struct Tree<'a> {
    robot: &'a description::Robot,
    index: HashMap<&'a str, usize>,
    /// Joints below each link, in file order.
    children: Vec<Vec<&'a description::Joint>>,
    root: usize,
}

/// What moves as one with a link.
struct Rigid<'a> {
    /// All bodies together, in the frame of the link.
    body: LinkParameters,
    /// The moving joint on it, with the joint's origin in the frame of the link.
    next: Option<(&'a description::Joint, Mat3, Vec3)>,
}

impl<'a> Tree<'a> {
    fn new(robot: &'a description::Robot) -> Result<Tree<'a>, UrdfError> {
        let mut index = HashMap::new();
        for (i, link) in robot.links.iter().enumerate() {
            if index.insert(link.name.as_str(), i).is_some() {
                return Err(UrdfError::Duplicate { what: "link", name: link.name.clone() });
            }
        }
        let mut names: HashSet<&str> = HashSet::new();
        let mut children = vec![Vec::new(); robot.links.len()];
        let mut parent: Vec<Option<(&description::Joint, usize)>> = vec![None; robot.links.len()];
        for joint in &robot.joints {
            if !names.insert(joint.name.as_str()) {
                return Err(UrdfError::Duplicate { what: "joint", name: joint.name.clone() });
            }
            let find = |link: &String| {
                let unknown = || UrdfError::UnknownLink { joint: joint.name.clone(), link: link.clone() };
                index.get(link.as_str()).copied().ok_or_else(unknown)
            };
            let (above, below) = (find(&joint.parent)?, find(&joint.child)?);
            if let Some((first, _)) = parent[below] {
                let (link, first, second) = (joint.child.clone(), first.name.clone(), joint.name.clone());
                return Err(UrdfError::SecondParent { link, first, second });
            }
            parent[below] = Some((joint, above));
            children[above].push(joint);
        }
        let mut walk: Vec<Option<usize>> = vec![None; robot.links.len()];
        for start in 0..robot.links.len() {
            // No link is passed twice in all: a walk ends where an earlier one has been.
            let mut link = start;
            while walk[link].is_none() {
                walk[link] = Some(start);
                let Some((_, above)) = parent[link] else { break };
                link = above;
            }
            if walk[link] == Some(start) && parent[link].is_some() {
                return Err(UrdfError::Loop { link: robot.links[link].name.clone() });
            }
        }
        let mut roots = (0..robot.links.len()).filter(|&i| parent[i].is_none());
        let root = roots.next().ok_or(UrdfError::NoJoints)?;
        if let Some(other) = roots.next() {
            let (first, second) = (robot.links[root].name.clone(), robot.links[other].name.clone());
            return Err(UrdfError::SeveralRoots { first, second });
        }
        Ok(Tree { robot, index, children, root })
    }

    /// Collects what is fixed to `carrier`, directly or through other fixed links.
    fn gather(&self, carrier: usize) -> Result<Rigid<'a>, UrdfError> {
        let mut rigid = Rigid { body: [0.0; LINK_PARAMETERS], next: None };
        let mut open = vec![(carrier, IDENTITY, [0.0; 3])];
        while let Some((link, r, p)) = open.pop() {
            let part = body_in_frame(&body_of(&self.robot.links[link])?, &r, &p);
            rigid.body.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
            for joint in &self.children[link] {
                let (step_r, step_p) = pose(&joint.origin, "joint", &joint.name)?;
                let (r, p) = (multiply(&r, &step_r), add(&p, &rotate(&r, &step_p)));
                if joint.joint_type == JointType::Fixed {
                    open.push((self.index[joint.child.as_str()], r, p));
                } else if let Some((first, ..)) = rigid.next {
                    let link = self.robot.links[carrier].name.clone();
                    let (first, second) = (first.name.clone(), joint.name.clone());
                    return Err(UrdfError::Branches { link, first, second });
                } else {
                    rigid.next = Some((*joint, r, p));
                }
            }
        }
        Ok(rigid)
    }
}

fn finite(values: &[f64], what: &'static str, name: &str, quantity: &'static str) -> Result<(), UrdfError> {
    match values.iter().find(|v| !v.is_finite()) {
        Some(&value) => Err(UrdfError::NotFinite { what, name: name.to_owned(), quantity, value }),
        None => Ok(()),
    }
}

fn pose(origin: &Pose, what: &'static str, name: &str) -> Result<(Mat3, Vec3), UrdfError> {
    finite(&origin.xyz, what, name, "origin xyz")?;
    finite(&origin.rpy, what, name, "origin rpy")?;
    Ok((from_roll_pitch_yaw(&origin.rpy.map(quarter_turns)), origin.xyz))
}

/// Angles within so much of quarter turns are quarter turns \[rad\]: 1.5708 and 3.1416 are π/2 and π, written short.
const QUARTER_TURN: f64 = 1e-5;

/// Axes that are parallel but for a rounded angle would each make base parameters of their own, which no data can tell.
fn quarter_turns(angle: f64) -> f64 {
    let quarter = std::f64::consts::FRAC_PI_2;
    let turns = (angle / quarter).round() * quarter;
    if (angle - turns).abs() <= QUARTER_TURN { turns } else { angle }
}

/// A link's own body in the link frame; zero when it has no `<inertial>`.
fn body_of(link: &description::Link) -> Result<LinkParameters, UrdfError> {
    let (inertial, name) = (&link.inertial, &link.name);
    let [ixx, ixy, ixz, iyy, iyz, izz] = inertial.inertia;
    let mass = inertial.mass;
    let entries = inertial.inertia;
    finite(&[mass], "link", name, "mass")?;
    finite(&entries, "link", name, "inertia")?;
    let (r, com) = pose(&inertial.origin, "link", name)?;
    if mass < 0.0 || (mass == 0.0 && entries.iter().any(|&e| e != 0.0)) {
        return Err(UrdfError::BadMass { link: name.clone(), mass });
    }
    let about_com = assemble(mass, &[0.0; 3], &[[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]]);
    // A point mass or a thin rod is a good part of a link, so zero moments pass here; see `check_moving_body`.
    let moments = principal_moments(&inertia_matrix(&about_com));
    if moments[0] < -f64::EPSILON * 8.0 * moments[2].abs() {
        return Err(UrdfError::NotPositiveDefinite { link: name.clone(), moment: moments[0] });
    }
    check_triangle(name, moments)?;
    Ok(body_in_frame(&about_com, &r, &com))
}

/// A moving body, everything fixed to it included, must have mass in all directions: its joint may turn about any axis.
fn check_moving_body(name: &str, body: &LinkParameters) -> Result<(), UrdfError> {
    let link = name.to_owned();
    let m = body[0];
    if m <= 0.0 {
        return Err(UrdfError::NoMass { link });
    }
    let (_, com, about_com) = com_from_body(body);
    let moments = principal_moments(&about_com);
    // Below this, what is left of the moment is rounding of the shift to the joint frame and back.
    let rounding = 16.0 * f64::EPSILON * (m * dot(&com, &com) + moments[2].abs());
    if moments[0] <= rounding {
        return Err(UrdfError::NotPositiveDefinite { link, moment: moments[0] });
    }
    check_triangle(name, moments)
}

/// Principal moments, ascending.
fn principal_moments(inertia: &Mat3) -> [f64; 3] {
    let mut moments: [f64; 3] = Matrix3::from_fn(|i, k| inertia[i][k]).symmetric_eigenvalues().into();
    moments.sort_by(f64::total_cmp);
    moments
}

fn check_triangle(name: &str, moments: [f64; 3]) -> Result<(), UrdfError> {
    if moments[2] > moments[0] + moments[1] + TRIANGLE_ROUNDING * moments[2] {
        return Err(UrdfError::TriangleInequality { link: name.to_owned(), moments });
    }
    Ok(())
}

fn moving_joint(joint: &description::Joint, rotation: &Mat3, translation: &Vec3) -> Result<Joint, UrdfError> {
    let name = joint.name.clone();
    let unsupported = |kind| Err(UrdfError::UnsupportedJoint { joint: name.clone(), kind });
    let (kind, limited) = match joint.joint_type {
        JointType::Revolute => (JointKind::Revolute, true),
        JointType::Continuous => (JointKind::Revolute, false),
        JointType::Prismatic => (JointKind::Prismatic, true),
        JointType::Floating => return unsupported("floating"),
        JointType::Planar => return unsupported("planar"),
        JointType::Spherical => return unsupported("spherical"),
        JointType::Fixed => return unsupported("fixed where a moving joint was expected"),
    };
    if let Some(mimic) = &joint.mimic {
        return Err(UrdfError::Mimic { joint: name, of: mimic.clone() });
    }
    finite(&joint.axis, "joint", &name, "axis")?;
    // Scaled first, so that squaring neither overflows nor vanishes.
    let largest = joint.axis.iter().fold(0.0_f64, |a, x| a.max(x.abs()));
    if largest == 0.0 {
        return Err(UrdfError::ZeroAxis { joint: name });
    }
    let scaled = joint.axis.map(|x| x / largest);
    let axis = scale(&scaled, 1.0 / dot(&scaled, &scaled).sqrt());

    let limit = &joint.limit;
    let (mut lower, mut upper) = (limit.lower, limit.upper);
    for (value, quantity) in [(lower, "lower limit"), (upper, "upper limit")] {
        if value.is_nan() {
            return Err(UrdfError::NotFinite { what: "joint", name, quantity, value });
        }
    }
    if !limited || (lower == 0.0 && upper == 0.0) {
        (lower, upper) = (f64::NEG_INFINITY, f64::INFINITY);
    }
    if lower > upper {
        return Err(UrdfError::Limits { joint: name, lower, upper });
    }
    let bound = |value: f64, quantity: &'static str| {
        if value.is_nan() {
            Err(UrdfError::NotFinite { what: "joint", name: name.clone(), quantity, value })
        } else if value < 0.0 {
            Err(UrdfError::NegativeLimit { joint: name.clone(), quantity, value })
        } else {
            Ok(if value == 0.0 { f64::INFINITY } else { value })
        }
    };
    let (velocity, effort) = (bound(limit.velocity, "velocity")?, bound(limit.effort, "effort")?);
    let link = joint.child.clone();
    Ok(Joint { name, kind, axis, rotation: *rotation, translation: *translation, lower, upper, velocity, effort, link })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    #[test]
    fn quarter_turns_written_short_are_quarter_turns() {
        // As text, which is what a file has.
        let cases = [("1.5708", FRAC_PI_2), ("-1.5708", -FRAC_PI_2), ("3.1416", PI), ("0", 0.0), ("1.9575", 1.9575)];
        for (written, meant) in cases {
            let written: f64 = written.parse().expect("a number");
            assert_eq!(quarter_turns(written), meant);
        }
        assert_eq!(quarter_turns(1.571), 1.571, "a millimetre at five metres is no rounding");
    }
}
