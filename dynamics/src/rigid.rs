//! Rigid-body dynamics of the chain: torques, mass matrix, and the regressor that is linear in the link parameters.
//!
//! All recursions run in body frames (Luh, Walker & Paul 1980; Featherstone 2008). With, in the frame of link i,
//! ω, ω̇ its angular velocity and acceleration and d = p̈ − g the acceleration of its origin less gravity, the wrench
//! that moves the body `[m, h, I]` is
//!
//! ```text
//! f = m·d + ω̇×h + ω×(ω×h)
//! n = I·ω̇ + ω×(I·ω) + h×d                      Atkeson, An & Hollerbach 1986, IJRR 5(3)
//! ```
//!
//! Arguments of every function: `q` \[rad\], `qd` \[rad/s\], `qdd` \[rad/s²\] (m instead of rad for a prismatic
//! joint), one entry a joint. The work is bounded and nothing allocates.

use crate::arm::{Arm, JointMotion, MAX_JOINTS};
use crate::parameters::{LINK_PARAMETERS, LinkParameters, body_in_frame, inertia_matrix};
use crate::spatial::{IDENTITY, Mat3, Vec3, add, cross, dot, rotate, rotate_back, scale};

/// Scratch space of the recursions and the joint constants of the arm it was made for.
#[derive(Clone, Debug)]
pub struct Workspace {
    dof: usize,
    motions: [JointMotion; MAX_JOINTS],
    /// Rotation and origin of each joint frame in its parent at the last `q`.
    r: [Mat3; MAX_JOINTS],
    p: [Vec3; MAX_JOINTS],
    /// Wrench on each link \[N, N·m\], about its joint frame's origin.
    f: [Vec3; MAX_JOINTS],
    n: [Vec3; MAX_JOINTS],
    /// Motion of the current link's origin per unit speed of each joint: angular and linear part.
    turn: [Vec3; MAX_JOINTS],
    slide: [Vec3; MAX_JOINTS],
    /// Bodies with all that they carry.
    composite: [LinkParameters; MAX_JOINTS],
}

impl Workspace {
    /// Makes the workspace of `arm`. It holds that arm's geometry: make another when the arm changes.
    pub fn new(arm: &Arm) -> Workspace {
        let mut motions = [JointMotion::UNUSED; MAX_JOINTS];
        for (motion, joint) in motions.iter_mut().zip(&arm.joints) {
            *motion = JointMotion::new(joint);
        }
        Workspace {
            dof: arm.dof(),
            motions,
            r: [IDENTITY; MAX_JOINTS],
            p: [[0.0; 3]; MAX_JOINTS],
            f: [[0.0; 3]; MAX_JOINTS],
            n: [[0.0; 3]; MAX_JOINTS],
            turn: [[0.0; 3]; MAX_JOINTS],
            slide: [[0.0; 3]; MAX_JOINTS],
            composite: [[0.0; LINK_PARAMETERS]; MAX_JOINTS],
        }
    }

    fn check(&self, arm: &Arm) {
        debug_assert_eq!(self.dof, arm.dof(), "workspace of another arm");
    }
}

/// Motion of one link's frame, in that frame.
#[derive(Clone, Copy)]
struct Motion {
    /// ω \[rad/s\].
    w: Vec3,
    /// ω̇ \[rad/s²\].
    dw: Vec3,
    /// p̈ − g of the origin \[m/s²\].
    d: Vec3,
}

impl Motion {
    /// The root link at rest: standing still in gravity is accelerating upwards.
    #[inline(always)]
    fn root(gravity: &Vec3) -> Motion {
        Motion { w: [0.0; 3], dw: [0.0; 3], d: scale(gravity, -1.0) }
    }

    /// Motion of the next link, whose frame stands at (`r`, `p`) in this one.
    #[inline(always)]
    fn next(&self, joint: &JointMotion, r: &Mat3, p: &Vec3, qd: f64, qdd: f64) -> Motion {
        let at_p = add(&add(&self.d, &cross(&self.dw, p)), &cross(&self.w, &cross(&self.w, p)));
        let (w, dw, d) = (rotate_back(r, &self.w), rotate_back(r, &self.dw), rotate_back(r, &at_p));
        let (rate, speed) = (scale(&joint.turn, qd), scale(&joint.slide, qd));
        let turning = add(&scale(&joint.turn, qdd), &cross(&w, &rate));
        let sliding = add(&scale(&joint.slide, qdd), &scale(&cross(&w, &speed), 2.0));
        Motion { w: add(&w, &rate), dw: add(&dw, &turning), d: add(&d, &sliding) }
    }
}

/// Joint torques \[N·m\] (forces \[N\] of prismatic joints) that produce `qdd`: `τ = M(q)·q̈ + c(q, q̇) + g(q)`, rigid
/// links only, by the recursive Newton-Euler algorithm.
///
/// `links`: parameters of the N bodies; `tau`: N, written.
pub fn inverse_dynamics(
    arm: &Arm,
    links: &[[f64; 10]],
    ws: &mut Workspace,
    q: &[f64],
    qd: &[f64],
    qdd: &[f64],
    tau: &mut [f64],
) {
    ws.check(arm);
    let dof = ws.dof;
    let mut motion = Motion::root(&arm.gravity);
    for i in 0..dof {
        (ws.r[i], ws.p[i]) = ws.motions[i].pose(q[i]);
        motion = motion.next(&ws.motions[i], &ws.r[i], &ws.p[i], qd[i], qdd[i]);
        let Motion { w, dw, d } = motion;
        let (body, h) = (&links[i], [links[i][1], links[i][2], links[i][3]]);
        let inertia = inertia_matrix(body);
        let swing = add(&cross(&dw, &h), &cross(&w, &cross(&w, &h)));
        ws.f[i] = add(&scale(&d, body[0]), &swing);
        let spin = add(&rotate(&inertia, &dw), &cross(&w, &rotate(&inertia, &w)));
        ws.n[i] = add(&spin, &cross(&h, &d));
    }
    for i in (0..dof).rev() {
        let joint = &ws.motions[i];
        tau[i] = dot(&joint.turn, &ws.n[i]) + dot(&joint.slide, &ws.f[i]);
        if i > 0 {
            let (f, n) = wrench_in_parent(&ws.r[i], &ws.p[i], &ws.f[i], &ws.n[i]);
            ws.f[i - 1] = add(&ws.f[i - 1], &f);
            ws.n[i - 1] = add(&ws.n[i - 1], &n);
        }
    }
}

/// A wrench about the child's origin, as one about the parent's.
#[inline(always)]
fn wrench_in_parent(r: &Mat3, p: &Vec3, f: &Vec3, n: &Vec3) -> (Vec3, Vec3) {
    let f = rotate(r, f);
    (f, add(&rotate(r, n), &cross(p, &f)))
}

/// Mass matrix M(q) \[kg·m²\] of the rigid links, by the composite-rigid-body algorithm (Featherstone 2008, ch. 6).
///
/// `links`: parameters of the N bodies; `m`: N x N row-major, written.
pub fn mass_matrix(arm: &Arm, links: &[[f64; 10]], ws: &mut Workspace, q: &[f64], m: &mut [f64]) {
    ws.check(arm);
    let dof = ws.dof;
    for i in 0..dof {
        (ws.r[i], ws.p[i]) = ws.motions[i].pose(q[i]);
        ws.composite[i] = links[i];
    }
    for i in (0..dof).rev() {
        let (joint, body) = (&ws.motions[i], &ws.composite[i]);
        let h = [body[1], body[2], body[3]];
        // The wrench that accelerates joint i alone at unit rate, everything beyond it stiff.
        let mut f = add(&scale(&joint.slide, body[0]), &cross(&joint.turn, &h));
        let mut n = add(&rotate(&inertia_matrix(body), &joint.turn), &cross(&h, &joint.slide));
        m[i * dof + i] = dot(&joint.turn, &n) + dot(&joint.slide, &f);
        for j in (0..i).rev() {
            (f, n) = wrench_in_parent(&ws.r[j + 1], &ws.p[j + 1], &f, &n);
            let carrier = &ws.motions[j];
            let entry = dot(&carrier.turn, &n) + dot(&carrier.slide, &f);
            m[i * dof + j] = entry;
            m[j * dof + i] = entry;
        }
        if i > 0 {
            let carried = body_in_frame(&ws.composite[i], &ws.r[i], &ws.p[i]);
            for (sum, part) in ws.composite[i - 1].iter_mut().zip(carried) {
                *sum += part;
            }
        }
    }
}

/// Joint-torque regressor Y(q, q̇, q̈) of the rigid links: `τ = Y·π`, π the link parameters one after the other.
///
/// `y`: N x 10N row-major, written; row j of link i < j is zero.
pub fn regressor(arm: &Arm, ws: &mut Workspace, q: &[f64], qd: &[f64], qdd: &[f64], y: &mut [f64]) {
    let stride = LINK_PARAMETERS * arm.dof();
    regressor_rows(arm, ws, q, qd, qdd, y, stride);
}

/// [`regressor`] into the first 10N columns of rows that are `stride` apart.
///
/// Row j of link i is the power of link i's wrench at unit speed of joint j: `u·n + v·f`, with (u, v) the angular and
/// linear velocity that joint j gives to link i's origin. Carrying these two vectors outwards with the motion needs
/// no 6x10 blocks to be carried back.
#[inline]
pub(crate) fn regressor_rows(
    arm: &Arm,
    ws: &mut Workspace,
    q: &[f64],
    qd: &[f64],
    qdd: &[f64],
    y: &mut [f64],
    stride: usize,
) {
    ws.check(arm);
    let dof = ws.dof;
    let mut motion = Motion::root(&arm.gravity);
    for i in 0..dof {
        let joint = &ws.motions[i];
        let (r, p) = joint.pose(q[i]);
        motion = motion.next(joint, &r, &p, qd[i], qdd[i]);
        let body = BodyRegressor::new(&motion);
        let columns = LINK_PARAMETERS * i..LINK_PARAMETERS * (i + 1);
        for ((turn, slide), row) in ws.turn[..i].iter_mut().zip(&mut ws.slide[..i]).zip(y.chunks_exact_mut(stride)) {
            let at_p = add(slide, &cross(turn, &p));
            (*turn, *slide) = (rotate_back(&r, turn), rotate_back(&r, &at_p));
            row[columns.clone()].copy_from_slice(&body.row(turn, slide));
        }
        let row = &mut y[i * stride..(i + 1) * stride];
        row[..columns.start].fill(0.0);
        row[columns].copy_from_slice(&body.row(&joint.turn, &joint.slide));
        (ws.turn[i], ws.slide[i]) = (joint.turn, joint.slide);
    }
}

/// The 6x10 regressor of a body's wrench, by its blocks: `f = d·m + spread·h`, `n = −d×h + moments·I`.
struct BodyRegressor {
    d: Vec3,
    /// `[ω̇]ₓ + [ω]ₓ²`, by columns.
    spread: Mat3,
    /// Columns of `I ↦ I·ω̇ + ω×(I·ω)` for Ixx, Ixy, Iyy, Ixz, Iyz, Izz.
    moments: [Vec3; 6],
}

impl BodyRegressor {
    #[inline(always)]
    fn new(motion: &Motion) -> BodyRegressor {
        let ([x, y, z], [ax, ay, az]) = (motion.w, motion.dw);
        let (xx, yy, zz, xy, xz, yz) = (x * x, y * y, z * z, x * y, x * z, y * z);
        BodyRegressor {
            d: motion.d,
            spread: [[-yy - zz, az + xy, xz - ay], [xy - az, -xx - zz, ax + yz], [ay + xz, yz - ax, -xx - yy]],
            moments: [
                [ax, xz, -xy],
                [ay - xz, ax + yz, xx - yy],
                [-yz, ay, xy],
                [az + xy, zz - xx, ax - yz],
                [yy - zz, az - xy, ay + xz],
                [yz, -xz, az],
            ],
        }
    }

    /// `u·n + v·f`, ten columns.
    #[inline(always)]
    fn row(&self, u: &Vec3, v: &Vec3) -> [f64; LINK_PARAMETERS] {
        let moment = cross(&self.d, u); // u·(h×d) = h·(d×u)
        [
            dot(v, &self.d),
            moment[0] + dot(v, &self.spread[0]),
            moment[1] + dot(v, &self.spread[1]),
            moment[2] + dot(v, &self.spread[2]),
            dot(u, &self.moments[0]),
            dot(u, &self.moments[1]),
            dot(u, &self.moments[2]),
            dot(u, &self.moments[3]),
            dot(u, &self.moments[4]),
            dot(u, &self.moments[5]),
        ]
    }
}
