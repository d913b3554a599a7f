//! The arm: a serial chain of one-axis joints and the rigid bodies they carry.

use crate::parameters::LinkParameters;
use crate::spatial::{IDENTITY, Mat3, Vec3, add, multiply, rotate, scale, skew};

/// The most joints an arm may have. Messages on the bus and all scratch space are sized by it.
pub const MAX_JOINTS: usize = 8;

/// How a joint moves its link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// Turns about its axis; position in rad, effort in N·m.
    Revolute,
    /// Slides along its axis; position in m, effort in N.
    Prismatic,
}

/// One joint with the frame it carries. Units below are for a revolute joint; a prismatic joint has m for rad and
/// N for N·m.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Name in the URDF.
    pub name: String,
    /// Turns or slides.
    pub kind: JointKind,
    /// Unit vector of the axis, in the joint frame (which is the frame of the link it moves).
    pub axis: [f64; 3],
    /// Rotation of the joint frame at q = 0: maps its components to those of the parent joint frame (the first
    /// joint's parent is the root link of the URDF).
    pub rotation: [[f64; 3]; 3],
    /// Origin of the joint frame at q = 0, in the parent joint frame \[m\].
    pub translation: [f64; 3],
    /// Lower position limit \[rad\]; −∞ when there is none.
    pub lower: f64,
    /// Upper position limit \[rad\]; +∞ when there is none.
    pub upper: f64,
    /// Speed limit \[rad/s\]; +∞ when none is given.
    pub velocity: f64,
    /// Effort limit \[N·m\]; +∞ when none is given.
    pub effort: f64,
    /// Name of the link that the joint moves.
    pub link: String,
}

impl Joint {
    /// Pose of the joint frame in its parent joint frame at position `q`.
    pub(crate) fn pose(&self, q: f64) -> (Mat3, Vec3) {
        JointMotion::new(self).pose(q)
    }
}

/// A joint's pose as a function of its position, with the constants taken out:
/// Rodrigues' formula `R(q) = R₀·(aaᵀ + sin q·[a]ₓ − cos q·[a]ₓ²)` for any axis costs 18 multiplications.
#[derive(Clone, Copy, Debug)]
pub(crate) struct JointMotion {
    pub(crate) revolute: bool,
    pub(crate) axis: Vec3,
    /// `R₀·aaᵀ` (revolute) or `R₀` (prismatic).
    constant: Mat3,
    /// `R₀·[a]ₓ`; unused by a prismatic joint.
    of_sin: Mat3,
    /// `−R₀·[a]ₓ²`; unused by a prismatic joint.
    of_cos: Mat3,
    translation: Vec3,
    /// `R₀·a`, the direction of travel in the parent frame; zero for a revolute joint.
    travel: Vec3,
}

impl JointMotion {
    /// Fills the places of an arm with fewer than [`MAX_JOINTS`] joints.
    pub(crate) const UNUSED: JointMotion = JointMotion {
        revolute: false,
        axis: [0.0; 3],
        constant: IDENTITY,
        of_sin: [[0.0; 3]; 3],
        of_cos: [[0.0; 3]; 3],
        translation: [0.0; 3],
        travel: [0.0; 3],
    };

    pub(crate) fn new(joint: &Joint) -> JointMotion {
        let (r0, a, translation) = (&joint.rotation, joint.axis, joint.translation);
        if joint.kind == JointKind::Prismatic {
            let travel = rotate(r0, &a);
            return JointMotion { axis: a, constant: *r0, translation, travel, ..JointMotion::UNUSED };
        }
        let k = skew(&a);
        let k_squared = multiply(&k, &k);
        let outer = a.map(|x| scale(&a, x));
        JointMotion {
            revolute: true,
            axis: a,
            constant: multiply(r0, &outer),
            of_sin: multiply(r0, &k),
            of_cos: multiply(r0, &k_squared.map(|row| scale(&row, -1.0))),
            translation,
            travel: [0.0; 3],
        }
    }

    /// Rotation (child to parent components) and origin in the parent frame \[m\] at position `q`.
    #[inline(always)]
    pub(crate) fn pose(&self, q: f64) -> (Mat3, Vec3) {
        if !self.revolute {
            return (self.constant, add(&self.translation, &scale(&self.travel, q)));
        }
        let (s, c) = q.sin_cos();
        let mut r = self.constant;
        for i in 0..3 {
            for k in 0..3 {
                r[i][k] += s * self.of_sin[i][k] + c * self.of_cos[i][k];
            }
        }
        (r, self.translation)
    }
}

/// A serial arm of 1 to [`MAX_JOINTS`] joints.
#[derive(Clone, Debug, PartialEq)]
pub struct Arm {
    /// Name of the robot in the URDF.
    pub name: String,
    /// The joints, base to tip.
    pub joints: Vec<Joint>,
    /// Nominal inertial parameters of the body each joint moves, about and in its joint frame, in the order of
    /// [`LinkParameters`]. Bodies on fixed joints are merged in.
    pub links: Vec<LinkParameters>,
    /// Gravity \[m/s²\] in the frame of the root link, e.g. `[0, 0, −9.81]`.
    pub gravity: [f64; 3],
}

impl Arm {
    /// Number of joints.
    pub fn dof(&self) -> usize {
        self.joints.len()
    }
}

/// Pose of the last joint frame in the root link: rotation (row-major, maps components in that frame to the root's)
/// and origin \[m\]. A tool frame behind a fixed joint is not part of it.
///
/// `q`: joint positions \[rad or m\], one each joint.
pub fn flange_pose(arm: &Arm, q: &[f64]) -> ([[f64; 3]; 3], [f64; 3]) {
    let start = (IDENTITY, [0.0; 3]);
    arm.joints.iter().zip(q).fold(start, |(r, p), (joint, &q)| {
        let (step_r, step_p) = joint.pose(q);
        (multiply(&r, &step_r), add(&p, &rotate(&r, &step_p)))
    })
}
