//! The arm: a serial chain of one-axis joints and the rigid bodies they carry.

use crate::lanes::Lanes;
use crate::link::LinkParameters;
use crate::spatial::{IDENTITY, Mat3, Vec3, add, multiply, rotate, scale, skew, splat};

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
    /// Effort limit \[N·m\]; +∞ when none is given. Of a robot file: that of the drive, `[drive] torque_limit`.
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

/// A joint as the recursions use it: kinds differ only in numbers, so the inner loops have no branches.
///
/// The pose at position q has rotation `constant + sin q·of_sin + cos q·of_cos`, which is Rodrigues' formula
/// `R₀·(aaᵀ + sin q·[a]ₓ − cos q·[a]ₓ²)` for an axis a in any direction, and origin `translation + q·R₀·slide`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct JointMotion {
    /// Angular velocity at unit joint speed, in the joint frame: the axis, or zero for a prismatic joint.
    pub(crate) turn: Vec3,
    /// Linear velocity at unit joint speed, in the joint frame: zero, or the axis for a prismatic joint.
    pub(crate) slide: Vec3,
    constant: Mat3,
    of_sin: Mat3,
    of_cos: Mat3,
    translation: Vec3,
    /// `R₀·slide`.
    travel: Vec3,
}

impl JointMotion {
    /// Fills the places of an arm with fewer than [`MAX_JOINTS`] joints.
    pub(crate) const UNUSED: JointMotion = JointMotion {
        turn: [0.0; 3],
        slide: [0.0; 3],
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
            return JointMotion { slide: a, constant: *r0, translation, travel, ..JointMotion::UNUSED };
        }
        let k = skew(&a);
        JointMotion {
            turn: a,
            constant: multiply(r0, &a.map(|x| scale(&a, x))),
            of_sin: multiply(r0, &k),
            of_cos: multiply(r0, &multiply(&k, &k).map(|row| scale(&row, -1.0))),
            translation,
            ..JointMotion::UNUSED
        }
    }

    /// Rotation (child to parent components) and origin in the parent frame \[m\] at position `q`.
    #[inline(always)]
    pub(crate) fn pose<T: Lanes>(&self, q: T) -> (Mat3<T>, Vec3<T>) {
        self.pose_turned(q, q.sin_cos())
    }

    /// [`pose`](Self::pose) with the sine and cosine of `q`, which a prismatic joint does not read: its rotation has no
    /// share of them.
    #[inline(always)]
    pub(crate) fn pose_turned<T: Lanes>(&self, q: T, (s, c): (T, T)) -> (Mat3<T>, Vec3<T>) {
        let entry = |i: usize, k: usize| {
            T::splat(self.constant[i][k]) + s * T::splat(self.of_sin[i][k]) + c * T::splat(self.of_cos[i][k])
        };
        let row = |i: usize| [entry(i, 0), entry(i, 1), entry(i, 2)];
        ([row(0), row(1), row(2)], add(&splat(&self.translation), &scale(&splat(&self.travel), q)))
    }
}

/// Cosine from which on an axis is along gravity.
const UPRIGHT: f64 = 0.98;

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

    /// What the arm reaches at most beyond the frame of the joint before `first` (from 0), along its joints \[m\]: origins, and travels of
    /// joints that slide, each at most 1 m.
    pub fn reach(&self, first: usize) -> f64 {
        let travel = |joint: &Joint| match joint.kind {
            JointKind::Prismatic => (joint.upper - joint.lower).min(1.0),
            JointKind::Revolute => 0.0,
        };
        let length = |joint: &Joint| joint.translation.iter().map(|x| x * x).sum::<f64>().sqrt();
        self.joints.iter().skip(first).map(|joint| length(joint) + travel(joint)).sum()
    }

    /// Whether the first axis is along gravity, within some 11 degrees: it then has no torque on it.
    pub fn is_upright(&self) -> bool {
        let Some(first) = self.joints.first() else { return false };
        let along = |row: &[f64; 3]| row.iter().zip(&first.axis).map(|(r, a)| r * a).sum::<f64>();
        let pull: f64 = first.rotation.iter().zip(&self.gravity).map(|(row, g)| along(row) * g).sum();
        let size = self.gravity.iter().map(|g| g * g).sum::<f64>().sqrt();
        size > 0.0 && pull.abs() > UPRIGHT * size
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
