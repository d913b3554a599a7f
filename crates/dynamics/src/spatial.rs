//! Vectors and rotations of the inner loops: plain arrays, so that nothing here can allocate.
//!
//! A rotation `r` is row-major and maps components in the child frame to components in the parent frame.

use crate::lanes::Lanes;

/// Three components in one frame.
pub(crate) type Vec3<T = f64> = [T; 3];
/// Row-major 3x3 matrix.
pub(crate) type Mat3<T = f64> = [[T; 3]; 3];

pub(crate) const IDENTITY: Mat3 = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// The same vector in every lane.
#[inline(always)]
pub(crate) fn splat<T: Lanes>(a: &Vec3) -> Vec3<T> {
    [T::splat(a[0]), T::splat(a[1]), T::splat(a[2])]
}

#[inline(always)]
pub(crate) fn dot<T: Lanes>(a: &Vec3<T>, b: &Vec3<T>) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
pub(crate) fn cross<T: Lanes>(a: &Vec3<T>, b: &Vec3<T>) -> Vec3<T> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
pub(crate) fn add<T: Lanes>(a: &Vec3<T>, b: &Vec3<T>) -> Vec3<T> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
pub(crate) fn scale<T: Lanes>(a: &Vec3<T>, k: T) -> Vec3<T> {
    [a[0] * k, a[1] * k, a[2] * k]
}

/// `r·a`: from child to parent components.
#[inline(always)]
pub(crate) fn rotate<T: Lanes>(r: &Mat3<T>, a: &Vec3<T>) -> Vec3<T> {
    [dot(&r[0], a), dot(&r[1], a), dot(&r[2], a)]
}

/// `rᵀ·a`: from parent to child components.
#[inline(always)]
pub(crate) fn rotate_back<T: Lanes>(r: &Mat3<T>, a: &Vec3<T>) -> Vec3<T> {
    [
        r[0][0] * a[0] + r[1][0] * a[1] + r[2][0] * a[2],
        r[0][1] * a[0] + r[1][1] * a[1] + r[2][1] * a[2],
        r[0][2] * a[0] + r[1][2] * a[1] + r[2][2] * a[2],
    ]
}

pub(crate) fn multiply(a: &Mat3, b: &Mat3) -> Mat3 {
    // Row i of a·b is bᵀ applied to row i of a.
    a.map(|row| rotate_back(b, &row))
}

pub(crate) fn transpose(a: &Mat3) -> Mat3 {
    [[a[0][0], a[1][0], a[2][0]], [a[0][1], a[1][1], a[2][1]], [a[0][2], a[1][2], a[2][2]]]
}

/// `[k]ₓ`, with `[k]ₓ·a = k×a`.
pub(crate) fn skew(k: &Vec3) -> Mat3 {
    [[0.0, -k[2], k[1]], [k[2], 0.0, -k[0]], [-k[1], k[0], 0.0]]
}

/// Roll, pitch, yaw \[rad\] of a URDF origin: turns about fixed x, then y, then z, `Rz(y)·Ry(p)·Rx(r)`.
pub(crate) fn from_roll_pitch_yaw(rpy: &Vec3) -> Mat3 {
    let ((sr, cr), (sp, cp), (sy, cy)) = (rpy[0].sin_cos(), rpy[1].sin_cos(), rpy[2].sin_cos());
    [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
}
