//! What keeps a URDF from being an arm: every mistake with its line, and what mends it.

use std::fmt;

use super::options::{Proposal, toml_key};
use crate::arm::MAX_JOINTS;

/// Why a URDF is not an arm that can be modelled. Names are those of the file.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum UrdfError {
    /// Not XML, or not a URDF.
    #[error("cannot be read as a URDF: {0}")]
    Unreadable(String),
    /// Too deep, too many or too long for any arm.
    #[error("cannot be read as a URDF: {0}")]
    Excess(#[from] crate::xml_limits::XmlExcess),
    /// A part or an attribute that has to be there.
    #[error("{what} \"{name}\" has no {quantity}")]
    Missing {
        /// "link" or "joint".
        what: &'static str,
        /// Its name.
        name: String,
        /// What is missing.
        quantity: &'static str,
    },
    /// A part that is there more than once.
    #[error("{what} \"{name}\" has more than one <{element}>")]
    Repeated {
        /// "link" or "joint".
        what: &'static str,
        /// Its name.
        name: String,
        /// The part.
        element: String,
    },
    /// A value that should be a number.
    #[error("{what} \"{name}\": {quantity} is \"{value}\", which is not {expected}")]
    NoNumber {
        /// "link" or "joint".
        what: &'static str,
        /// Its name.
        name: String,
        /// Which number.
        quantity: &'static str,
        /// What is written.
        value: String,
        /// "a number" or "three numbers".
        expected: &'static str,
    },
    /// Nothing moves.
    #[error("has no revolute, continuous or prismatic joint")]
    NoJoints,
    /// More joints than the messages have room for.
    #[error("has {count} moving joints; at most {MAX_JOINTS} are supported")]
    TooManyJoints {
        /// Moving joints found.
        count: usize,
        /// Lines that make it an arm.
        proposal: Box<Proposal>,
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
    #[error("link \"{link}\" carries two moving joints, \"{first}\" and \"{second}\"; the model is a serial chain")]
    Branches {
        /// The link, after merging those fixed to it.
        link: String,
        /// One moving child joint.
        first: String,
        /// The other.
        second: String,
        /// Lines that make it an arm.
        proposal: Box<Proposal>,
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
    #[error("link \"{link}\" is its own ancestor; loops are not supported")]
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
        /// Lines that make it an arm.
        proposal: Box<Proposal>,
    },
    /// A joint of the chain that follows another.
    #[error("joint \"{joint}\" mimics \"{of}\"; a joint of the arm that follows another is not supported")]
    Mimic {
        /// The follower.
        joint: String,
        /// The joint it follows.
        of: String,
        /// Lines that make it an arm.
        proposal: Box<Proposal>,
    },
    /// Floating, planar or spherical.
    #[error("joint \"{joint}\" is {kind}; only revolute, continuous, prismatic and fixed joints are supported")]
    UnsupportedJoint {
        /// The joint.
        joint: String,
        /// Its type.
        kind: String,
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
    #[error("link \"{link}\" is moved by a joint but has no mass, nor has a link fixed to it")]
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
    /// [`UrdfOptions::tip`](super::UrdfOptions::tip) is no link.
    #[error("the URDF has no link \"{tip}\"")]
    NoTip {
        /// What was asked for.
        tip: String,
        /// Lines that make it an arm.
        proposal: Box<Proposal>,
    },
    /// A joint of [`UrdfOptions::fixed`](super::UrdfOptions::fixed) does not exist, or cannot be there.
    #[error("the URDF has no joint \"{joint}\"")]
    NoFixed {
        /// What was asked for.
        joint: String,
        /// The joints that there are.
        joints: Vec<String>,
    },
}

/// Which key of a robot file a mistake belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UrdfKey {
    /// The file itself.
    File,
    /// `model.tip`
    Tip,
    /// `model.fixed`
    Fixed,
}

impl UrdfError {
    /// The key of a robot file that the mistake belongs to.
    pub fn key(&self) -> UrdfKey {
        match self {
            UrdfError::NoTip { .. } => UrdfKey::Tip,
            UrdfError::NoFixed { .. } => UrdfKey::Fixed,
            _ => UrdfKey::File,
        }
    }

    /// What to do about it. `file` is the URDF as the user knows it. Lines for the robot file stand alone, ready to paste.
    pub fn mend(&self, file: &str) -> String {
        let model = |line: String| format!("correct it in {file}, or write `{line}` below `[model]`");
        let weld = |joint: &str| model(format!("fixed = {{ {} = 0.0 }}", toml_key(joint)));
        match self {
            UrdfError::Branches { proposal, .. }
            | UrdfError::TooManyJoints { proposal, .. }
            | UrdfError::SeveralRoots { proposal, .. }
            | UrdfError::Mimic { proposal, .. } => proposal.mend(file),
            UrdfError::NoTip { proposal, .. } if proposal.tip.is_empty() => format!("give a link of {file}"),
            UrdfError::NoTip { proposal, .. } => format!("give a link of {file}, such as {:?}", proposal.tip),
            UrdfError::NoFixed { joints, .. } => {
                let names: Vec<String> = joints.iter().map(|name| name.escape_debug().to_string()).collect();
                format!("give a joint of {file}: {}", names.join(", "))
            }
            UrdfError::UnknownLink { link, .. } if link.is_empty() => {
                format!("name its <parent link> and <child link> in {file}")
            }
            UrdfError::UnknownLink { link, .. } => {
                let name = quick_xml::escape::escape(link.as_str()).replace('\n', "&#10;");
                format!("add the line `<link name=\"{name}\"/>` to {file}")
            }
            UrdfError::UnsupportedJoint { joint, .. } => weld(joint),
            UrdfError::BadMass { .. }
            | UrdfError::NotPositiveDefinite { .. }
            | UrdfError::TriangleInequality { .. } => model("impossible_inertia = \"project\"".to_owned()),
            UrdfError::NoMass { .. } => {
                format!("give it an <inertial> with mass > 0 in {file}, or fix a link with mass to it")
            }
            UrdfError::Missing { quantity, .. } => format!("add {quantity} in {file}"),
            UrdfError::Repeated { .. } | UrdfError::Duplicate { .. } => {
                format!("remove or rename one of the two in {file}")
            }
            _ => format!("correct it in {file}"),
        }
    }
}

/// One mistake of a URDF.
#[derive(Clone, Debug, PartialEq)]
pub struct UrdfMistake {
    /// Line of the URDF, from 1; 0 where it belongs to no line.
    pub line: usize,
    /// What is wrong.
    pub error: UrdfError,
}

impl fmt::Display for UrdfMistake {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.line {
            0 => write!(f, "{}", self.error),
            line => write!(f, "line {line}: {}", self.error),
        }
    }
}

/// Every mistake of a URDF, in the order of its lines. Never empty.
#[derive(Clone, Debug, PartialEq)]
pub struct UrdfMistakes(Vec<UrdfMistake>);

impl UrdfMistakes {
    pub(super) fn new(mut mistakes: Vec<UrdfMistake>) -> UrdfMistakes {
        mistakes.sort_by_key(|mistake| mistake.line);
        UrdfMistakes(mistakes)
    }

    /// The mistakes, in the order of the lines.
    pub fn all(&self) -> &[UrdfMistake] {
        &self.0
    }

    pub(super) fn into_first(self) -> UrdfError {
        self.0.into_iter().next().map_or(UrdfError::NoJoints, |mistake| mistake.error)
    }
}

impl From<UrdfMistake> for UrdfMistakes {
    fn from(mistake: UrdfMistake) -> UrdfMistakes {
        UrdfMistakes(vec![mistake])
    }
}

impl fmt::Display for UrdfMistakes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (k, mistake) in self.0.iter().enumerate() {
            write!(f, "{}{mistake}", if k == 0 { "" } else { "\n" })?;
        }
        Ok(())
    }
}

impl std::error::Error for UrdfMistakes {}
