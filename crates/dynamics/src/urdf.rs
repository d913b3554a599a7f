//! From a URDF file to an [`Arm`]: chooses the chain, checks that its bodies are physical, and merges what is fixed.

mod bodies;
mod error;
mod options;
mod scan;
mod text;
mod tree;
mod write;

use std::collections::HashMap;
use std::fmt;

use crate::arm::{Arm, Joint, JointKind};
use crate::link::{LINK_PARAMETERS, LinkParameters, body_in_frame};
use crate::spatial::{IDENTITY, Mat3, Vec3, add, dot, multiply, rotate, scale};

pub use bodies::guess_bodies;
use bodies::{body_of, check_moving_body, finite, pose};
pub use error::{UrdfError, UrdfKey, UrdfMistake, UrdfMistakes};
pub use options::{Proposal, UrdfOptions, toml_key};
use tree::{Chain, Tree};
pub use write::{WrittenUrdf, write_efforts, write_urdf};

/// What a user should know of a URDF that is an arm.
#[derive(Clone, Debug, PartialEq)]
pub enum UrdfNote {
    /// A joint that nobody gave a place is welded, or one that follows a joint that moves.
    Welded {
        /// The joint.
        joint: String,
        /// Where \[rad or m\].
        at: f64,
        /// The joint that it follows, if that one moves.
        follows: Option<String>,
    },
    /// A moving link, everything fixed to it included, has no mass in the file.
    Unknown {
        /// The link.
        link: String,
    },
    /// An inertia that cannot be was projected.
    Projected {
        /// Line of the URDF.
        line: usize,
        /// What was wrong.
        error: UrdfError,
    },
}

impl fmt::Display for UrdfNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            UrdfNote::Welded { joint, at, follows: None } => {
                write!(
                    f,
                    "joint \"{joint}\" is welded at {at}: it is not part of the chain. [model] fixed sets another position"
                )
            }
            UrdfNote::Welded { joint, at, follows: Some(of) } => write!(
                f,
                "joint \"{joint}\" follows \"{of}\" and is welded at {at}: its motion is not modelled. Set its mean position in \
                 [model] fixed"
            ),
            UrdfNote::Unknown { link } => {
                write!(f, "link \"{link}\" has no <inertial>: its body is unknown and has a wide prior")
            }
            UrdfNote::Projected { line, error: error @ UrdfError::BadMass { .. } } => {
                write!(f, "line {line}: {error}. The link is treated as one without body")
            }
            UrdfNote::Projected { line, error } => {
                write!(f, "line {line}: {error}. The nearest feasible inertia is used instead")
            }
        }
    }
}

/// A URDF read as an arm.
#[derive(Clone, Debug, PartialEq)]
pub struct UrdfArm {
    /// The chain, with bodies of everything that moves with each joint. A body that is unknown is zero: see [`guess_bodies`].
    pub arm: Arm,
    /// Whether the body that each joint moves is unknown.
    pub unknown: Vec<bool>,
    /// `[damping, friction]` of each joint's `<dynamics>`: viscous \[N·m·s/rad\] and Coulomb friction \[N·m\].
    pub friction: Vec<Option<[f64; 2]>>,
    /// Distance of the tip from the last joint \[m\]; 0 where nothing is fixed to the last link.
    pub tip_length: f64,
    /// Tip and welded joints as they came out.
    pub chosen: Proposal,
    /// What a user should know.
    pub notes: Vec<UrdfNote>,
    /// The joint that moves each link, of those that move.
    pub(crate) carriers: HashMap<String, usize>,
}

impl UrdfArm {
    /// Reads a URDF. `gravity` \[m/s²\] is given in the frame of the file's root link.
    ///
    /// Links on fixed and welded joints are merged into the link that carries them; what is fixed to the root does not move, is not checked
    /// and is dropped. A `continuous` joint, and one whose limits are absent or both 0, has no position limit; a speed or effort limit
    /// that is absent or 0 is none.
    ///
    /// # Errors
    /// Everything found that keeps the file from being a chain of physical bodies.
    pub fn read(text: &str, gravity: [f64; 3], options: &UrdfOptions) -> Result<UrdfArm, UrdfMistakes> {
        let file = text::read(text)?;
        let mut mistakes = Vec::new();
        let tree = Tree::new(&file, &mut mistakes);
        let chain = tree.as_ref().and_then(|tree| tree.chain(options, &mut mistakes));
        for joint in &file.joints {
            mistakes.extend(joint.unreadable.iter().cloned());
        }
        let (Some(tree), Some(chain)) = (tree, chain) else { return Err(UrdfMistakes::new(mistakes)) };
        let mut reading = Reading { tree: &tree, chain: &chain, project: options.project, mistakes, notes: Vec::new() };
        let read = reading.arm(gravity);
        let Reading { mistakes, .. } = reading;
        if mistakes.is_empty() { Ok(read) } else { Err(UrdfMistakes::new(mistakes)) }
    }
}

impl Arm {
    /// Reads a URDF that is a chain of bodies as it is, as [`UrdfArm::read`] does.
    ///
    /// # Errors
    /// The first thing found that keeps the file from being a chain of 1 to [`MAX_JOINTS`](crate::MAX_JOINTS) physical bodies; a body
    /// without mass is one.
    pub fn from_urdf(text: &str, gravity: [f64; 3]) -> Result<Arm, UrdfError> {
        let read = UrdfArm::read(text, gravity, &UrdfOptions::default()).map_err(UrdfMistakes::into_first)?;
        match read.unknown.iter().position(|unknown| *unknown) {
            Some(j) => Err(UrdfError::NoMass { link: read.arm.joints[j].link.clone() }),
            None => Ok(read.arm),
        }
    }
}

/// A file on its way to an arm.
struct Reading<'a> {
    tree: &'a Tree<'a>,
    chain: &'a Chain,
    project: bool,
    mistakes: Vec<UrdfMistake>,
    notes: Vec<UrdfNote>,
}

/// What moves as one with a link.
struct Rigid {
    /// All bodies together, in the frame of the link.
    body: LinkParameters,
    /// Links of it.
    links: Vec<usize>,
    /// Origin of the next joint of the chain in the frame of the link.
    next: Option<(Mat3, Vec3)>,
    /// The largest distance of a link of it from the origin.
    extent: f64,
}

impl Reading<'_> {
    fn fail(&mut self, line: usize, error: UrdfError) {
        self.mistakes.push(UrdfMistake { line, error });
    }

    fn arm(&mut self, gravity: [f64; 3]) -> UrdfArm {
        let (tree, chain) = (self.tree, self.chain);
        self.welded();
        let (mut joints, mut links, mut unknown) = (Vec::new(), Vec::new(), Vec::new());
        let (mut carriers, mut friction) = (HashMap::new(), Vec::new());
        let mut rigid = self.gather(chain.root, chain.joints.first().copied(), false);
        for (k, &j) in chain.joints.iter().enumerate() {
            let joint = &tree.file.joints[j];
            let (rotation, translation) = rigid.next.unwrap_or((IDENTITY, [0.0; 3]));
            match moving_joint(joint, &rotation, &translation) {
                Ok(joint) => joints.push(joint),
                Err(error) => self.fail(joint.line, error),
            }
            rigid = self.gather(tree.below[j], chain.joints.get(k + 1).copied(), true);
            for &link in &rigid.links {
                carriers.insert(tree.file.links[link].name.clone(), k);
            }
            let link = &tree.file.links[tree.below[j]];
            let nothing = rigid.body[0] == 0.0;
            unknown.push(nothing);
            links.push(self.moving_body(link, &rigid.body));
            friction.push(joint.dynamics);
        }
        let tip = chain.joints.last().map_or(chain.root, |&j| tree.below[j]);
        let mut fixed: Vec<usize> = chain.welds.keys().copied().collect();
        fixed.sort_unstable();
        let fixed = fixed.into_iter().map(|j| (tree.file.joints[j].name.clone(), chain.welds[&j])).collect();
        UrdfArm {
            arm: Arm { name: tree.file.name.clone(), joints, links, gravity },
            unknown,
            friction,
            tip_length: rigid.extent,
            chosen: Proposal { tip: tree.file.links[tip].name.clone(), fixed },
            notes: std::mem::take(&mut self.notes),
            carriers,
        }
    }

    /// Notes of welded joints that the caller did not name, and of all that follow a joint that moves.
    fn welded(&mut self) {
        let file = self.tree.file;
        let mut welds: Vec<(usize, f64)> = self.chain.welds.iter().map(|(j, at)| (*j, *at)).collect();
        welds.sort_unstable_by_key(|(j, _)| *j);
        for (j, at) in welds {
            let joint = &file.joints[j];
            let of = joint.mimic.as_ref().map(|mimic| &mimic.joint);
            let moves = |of: &&String| self.chain.joints.iter().any(|&j| file.joints[j].name == **of);
            let follows = of.filter(moves).cloned();
            if follows.is_some() || self.chain.assumed.contains(&j) {
                self.notes.push(UrdfNote::Welded { joint: joint.name.clone(), at, follows });
            }
        }
    }

    /// The body of a moving link, checked; zero where it is unknown.
    fn moving_body(&mut self, link: &text::Link, body: &LinkParameters) -> LinkParameters {
        if body[0] <= 0.0 {
            self.notes.push(UrdfNote::Unknown { link: link.name.clone() });
            return [0.0; LINK_PARAMETERS];
        }
        let line = link.inertial.as_ref().map_or(link.line, |inertial| inertial.line);
        match check_moving_body(&link.name, body, self.project) {
            Ok(checked) => {
                if let Some(error) = checked.projected {
                    self.notes.push(UrdfNote::Projected { line, error });
                }
                checked.body
            }
            Err(error) => {
                // A link of it may have been refused already, for the same.
                if !self.mistakes.iter().any(|mistake| mistake.line == line) {
                    self.fail(line, error);
                }
                *body
            }
        }
    }

    /// Collects what is fixed to `carrier`, directly or through other fixed or welded joints; `moving`: its bodies count.
    fn gather(&mut self, carrier: usize, next: Option<usize>, moving: bool) -> Rigid {
        let tree = self.tree;
        let mut rigid = Rigid { body: [0.0; LINK_PARAMETERS], links: Vec::new(), next: None, extent: 0.0 };
        let mut open = vec![(carrier, IDENTITY, [0.0; 3])];
        while let Some((link, r, p)) = open.pop() {
            rigid.links.push(link);
            rigid.extent = rigid.extent.max(dot(&p, &p).sqrt());
            if moving {
                let part = body_in_frame(&self.body(&tree.file.links[link]), &r, &p);
                rigid.body.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
            }
            for &j in &tree.children[link] {
                let weld = self.chain.welds.get(&j);
                let joint = &tree.file.joints[j];
                if joint.kind != "fixed" && weld.is_none() && next != Some(j) {
                    continue;
                }
                let (step_r, step_p) = match pose(&joint.origin, "joint", &joint.name) {
                    Ok(step) => step,
                    Err(error) => {
                        self.fail(joint.line, error);
                        continue;
                    }
                };
                let (r, p) = (multiply(&r, &step_r), add(&p, &rotate(&r, &step_p)));
                if next == Some(j) {
                    rigid.next = Some((r, p));
                    continue;
                }
                let (r, p) = match weld.map(|at| self.place(joint, *at)) {
                    Some((turn, shift)) => (multiply(&r, &turn), add(&p, &rotate(&r, &shift))),
                    None => (r, p),
                };
                open.push((tree.below[j], r, p));
            }
        }
        rigid
    }

    /// A link's own body; zero after a mistake.
    fn body(&mut self, link: &text::Link) -> LinkParameters {
        let Some(inertial) = &link.inertial else { return [0.0; LINK_PARAMETERS] };
        if !inertial.unreadable.is_empty() {
            self.mistakes.extend(inertial.unreadable.iter().cloned());
            return [0.0; LINK_PARAMETERS];
        }
        match body_of(link, self.project) {
            Ok(checked) => {
                if let Some(error) = checked.projected {
                    self.notes.push(UrdfNote::Projected { line: inertial.line, error });
                }
                checked.body
            }
            Err(error) => {
                self.fail(inertial.line, error);
                [0.0; LINK_PARAMETERS]
            }
        }
    }

    /// Where a welded joint has its link, from its origin on. One that has no single axis is where its origin is.
    fn place(&mut self, joint: &text::Joint, at: f64) -> (Mat3, Vec3) {
        if !matches!(joint.kind.as_str(), "revolute" | "continuous" | "prismatic") {
            return (IDENTITY, [0.0; 3]);
        }
        match moving_joint(joint, &IDENTITY, &[0.0; 3]) {
            Ok(joint) => joint.pose(at),
            Err(error) => {
                self.fail(joint.line, error);
                (IDENTITY, [0.0; 3])
            }
        }
    }
}

fn moving_joint(joint: &text::Joint, rotation: &Mat3, translation: &Vec3) -> Result<Joint, UrdfError> {
    let name = joint.name.clone();
    let (kind, limited) = match joint.kind.as_str() {
        "revolute" => (JointKind::Revolute, true),
        "continuous" => (JointKind::Revolute, false),
        "prismatic" => (JointKind::Prismatic, true),
        kind => return Err(UrdfError::UnsupportedJoint { joint: name, kind: kind.to_owned() }),
    };
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
