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
use crate::lanes::{Lanes, Pair};
use crate::link::{LINK_PARAMETERS, LinkParameters, body_in_frame, inertia_matrix};
use crate::spatial::{IDENTITY, Mat3, Vec3, add, cross, dot, rotate, rotate_back, scale, splat};

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
    screws: [Screw<Pair>; MAX_JOINTS],
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
            screws: [Screw::ZERO; MAX_JOINTS],
            composite: [[0.0; LINK_PARAMETERS]; MAX_JOINTS],
        }
    }

    /// Constants of joint `j`.
    #[inline(always)]
    pub(crate) fn joint(&self, j: usize) -> &JointMotion {
        &self.motions[j]
    }

    fn check(&self, arm: &Arm) {
        debug_assert_eq!(self.dof, arm.dof(), "workspace of another arm");
    }
}

/// Motion of one link's frame, in that frame.
#[derive(Clone, Copy)]
struct Motion<T> {
    /// ω \[rad/s\].
    w: Vec3<T>,
    /// ω̇ \[rad/s²\].
    dw: Vec3<T>,
    /// p̈ − g of the origin \[m/s²\].
    d: Vec3<T>,
}

impl<T: Lanes> Motion<T> {
    /// The root link at rest: standing still in gravity is accelerating upwards.
    #[inline(always)]
    fn root(gravity: &Vec3) -> Motion<T> {
        Motion { w: splat(&[0.0; 3]), dw: splat(&[0.0; 3]), d: splat(&scale(gravity, -1.0)) }
    }

    /// Motion of the next link, whose frame stands at (`r`, `p`) in this one.
    #[inline(always)]
    fn next(&self, joint: &JointMotion, r: &Mat3<T>, p: &Vec3<T>, qd: T, qdd: T) -> Motion<T> {
        let at_p = add(&add(&self.d, &cross(&self.dw, p)), &cross(&self.w, &cross(&self.w, p)));
        let (w, dw, d) = (rotate_back(r, &self.w), rotate_back(r, &self.dw), rotate_back(r, &at_p));
        let (turn, slide) = (splat(&joint.turn), splat(&joint.slide));
        let (rate, speed) = (scale(&turn, qd), scale(&slide, qd));
        let turning = add(&scale(&turn, qdd), &cross(&w, &rate));
        let sliding = add(&scale(&slide, qdd), &scale(&cross(&w, &speed), T::splat(2.0)));
        Motion { w: add(&w, &rate), dw: add(&dw, &turning), d: add(&d, &sliding) }
    }
}

/// Motion of a link's origin per unit speed of a joint, in the link's frame: angular and linear part.
#[derive(Clone, Copy, Debug)]
struct Screw<T> {
    turn: Vec3<T>,
    slide: Vec3<T>,
}

impl Screw<Pair> {
    const ZERO: Screw<Pair> = Screw { turn: [Pair::ZERO; 3], slide: [Pair::ZERO; 3] };

    /// Puts the screw of a joint into one lane.
    #[inline(always)]
    fn set_lane(&mut self, lane: usize, joint: &JointMotion) {
        let put = |to: &mut Vec3<Pair>, from: &Vec3| {
            for (to, from) in to.iter_mut().zip(from) {
                to.as_mut_array()[lane] = *from;
            }
        };
        put(&mut self.turn, &joint.turn);
        put(&mut self.slide, &joint.slide);
    }
}

impl<T: Lanes> Screw<T> {
    /// The same motion at the next link, whose frame stands at (`r`, `p`) in this one.
    #[inline(always)]
    fn next(&self, r: &Mat3<T>, p: &Vec3<T>) -> Screw<T> {
        let at_p = add(&self.slide, &cross(&self.turn, p));
        Screw { turn: rotate_back(r, &self.turn), slide: rotate_back(r, &at_p) }
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
/// no 6x10 blocks to be carried back, and two joints at a time fit the lanes of a [`Pair`].
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
    let mut turned = [(0.0, 1.0); MAX_JOINTS];
    for (turned, q) in turned.chunks_exact_mut(2).zip(q[..dof].chunks(2)) {
        let (s, c) = Lanes::sin_cos(Pair::new([q[0], q[q.len() - 1]]));
        let (s, c) = (s.to_array(), c.to_array());
        turned.copy_from_slice(&[(s[0], c[0]), (s[1], c[1])]);
    }
    for i in 0..dof {
        (ws.r[i], ws.p[i]) = ws.motions[i].pose_turned(q[i], turned[i]);
    }
    let mut motions = [Motion::root(&arm.gravity); MAX_JOINTS + 1];
    for i in 0..dof {
        motions[i + 1] = motions[i].next(&ws.motions[i], &ws.r[i], &ws.p[i], qd[i], qdd[i]);
    }
    for i in 0..dof {
        let (joint, motion) = (&ws.motions[i], &motions[i + 1]);
        let (r, p) = (&ws.r[i], &ws.p[i]);
        let (r, p) = ([splat(&r[0]), splat(&r[1]), splat(&r[2])], splat(p));
        for screw in &mut ws.screws[..i.div_ceil(2)] {
            *screw = screw.next(&r, &p);
        }
        ws.screws[i / 2].set_lane(i % 2, joint);
        let body = BodyRegressor::new(&Motion { w: splat(&motion.w), dw: splat(&motion.dw), d: splat(&motion.d) });
        let columns = LINK_PARAMETERS * i..LINK_PARAMETERS * (i + 1);
        for (screw, rows) in ws.screws[..=i / 2].iter().zip(y.chunks_mut(2 * stride)) {
            let entries = body.row(screw);
            let (first, second) = rows.split_at_mut(stride);
            write_lane(&mut first[columns.clone()], &entries, 0);
            // Beyond link i there are only zeros, which the last row of an odd number of rows has no place for.
            if second.len() >= columns.end {
                write_lane(&mut second[columns.clone()], &entries, 1);
            }
        }
        for row in y[(i + 1) * stride..].chunks_exact_mut(stride).take(dof - i - 1) {
            row[columns.clone()].copy_from_slice(&[0.0; LINK_PARAMETERS]);
        }
    }
}

#[inline(always)]
fn write_lane(to: &mut [f64], entries: &[Pair; LINK_PARAMETERS], lane: usize) {
    for (to, entry) in to.iter_mut().zip(entries) {
        *to = entry.as_array()[lane];
    }
}

/// Rigid-body part of [`Model::regressor_pair`](crate::Model::regressor_pair): two states in the two lanes.
#[inline]
pub(crate) fn regressor_pair_rows(
    arm: &Arm,
    ws: &mut Workspace,
    [a, b]: [State<'_>; 2],
    y: &mut [[f64; 2]],
    stride: usize,
) {
    ws.check(arm);
    let dof = ws.dof;
    let mut poses = [(IDENTITY.map(|row| splat(&row)), [Pair::ZERO; 3]); MAX_JOINTS];
    let mut turned = [(Pair::ZERO, Pair::ZERO); MAX_JOINTS];
    for i in 0..dof {
        turned[i] = Lanes::sin_cos(Pair::new([a.q[i], b.q[i]]));
    }
    for i in 0..dof {
        poses[i] = ws.motions[i].pose_turned(Pair::new([a.q[i], b.q[i]]), turned[i]);
    }
    let mut motions = [Motion::root(&arm.gravity); MAX_JOINTS + 1];
    for i in 0..dof {
        let (qd, qdd) = (Pair::new([a.qd[i], b.qd[i]]), Pair::new([a.qdd[i], b.qdd[i]]));
        motions[i + 1] = motions[i].next(&ws.motions[i], &poses[i].0, &poses[i].1, qd, qdd);
    }
    for i in 0..dof {
        let (joint, (r, p)) = (&ws.motions[i], &poses[i]);
        let body = BodyRegressor::new(&motions[i + 1]);
        for screw in &mut ws.screws[..i] {
            *screw = screw.next(r, p);
        }
        ws.screws[i] = Screw { turn: splat(&joint.turn), slide: splat(&joint.slide) };
        let columns = LINK_PARAMETERS * i..LINK_PARAMETERS * (i + 1);
        for (screw, row) in ws.screws[..=i].iter().zip(y.chunks_exact_mut(stride)) {
            let entries = body.row(screw);
            for (to, entry) in row[columns.clone()].iter_mut().zip(&entries) {
                *to = entry.to_array();
            }
        }
    }
}

/// A state of the arm, one entry a joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State<'a> {
    /// Positions \[rad\].
    pub q: &'a [f64],
    /// Velocities \[rad/s\].
    pub qd: &'a [f64],
    /// Accelerations \[rad/s²\].
    pub qdd: &'a [f64],
}

/// The 6x10 regressor of a body's wrench, by its blocks: `f = d·m + spread·h`, `n = −d×h + moments·I`.
struct BodyRegressor<T> {
    d: Vec3<T>,
    /// `[ω̇]ₓ + [ω]ₓ²`, by columns.
    spread: Mat3<T>,
    /// Columns of `I ↦ I·ω̇ + ω×(I·ω)` for Ixx, Ixy, Iyy, Ixz, Iyz, Izz.
    moments: [Vec3<T>; 6],
}

impl<T: Lanes> BodyRegressor<T> {
    #[inline(always)]
    fn new(motion: &Motion<T>) -> BodyRegressor<T> {
        let ([x, y, z], [ax, ay, az]) = (motion.w, motion.dw);
        let (xx, yy, zz, xy, xz, yz) = (x * x, y * y, z * z, x * y, x * z, y * z);
        let minus = |a: T| T::splat(0.0) - a;
        BodyRegressor {
            d: motion.d,
            spread: [
                [minus(yy + zz), az + xy, xz - ay],
                [xy - az, minus(xx + zz), ax + yz],
                [ay + xz, yz - ax, minus(xx + yy)],
            ],
            moments: [
                [ax, xz, minus(xy)],
                [ay - xz, ax + yz, xx - yy],
                [minus(yz), ay, xy],
                [az + xy, zz - xx, ax - yz],
                [yy - zz, az - xy, ay + xz],
                [yz, minus(xz), az],
            ],
        }
    }

    /// `u·n + v·f` with (u, v) the screw, ten columns.
    #[inline(always)]
    fn row(&self, Screw { turn: u, slide: v }: &Screw<T>) -> [T; LINK_PARAMETERS] {
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
