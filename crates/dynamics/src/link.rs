//! One rigid body in ten numbers.

use crate::spatial::{Mat3, Vec3, dot, multiply, rotate, scale, transpose};

/// Number of inertial parameters of a link.
pub const LINK_PARAMETERS: usize = 10;

/// `[m, m·cx, m·cy, m·cz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz]`: mass \[kg\], first moment \[kg·m\] and rotational inertia
/// \[kg·m²\] about the ORIGIN of the joint frame (not the centre of mass), in the joint frame. Products are tensor
/// entries, `Ixy = −∫xy dm`. Note the order of the last six.
pub type LinkParameters = [f64; LINK_PARAMETERS];

/// Inertia tensor about the origin, as a matrix.
#[inline(always)]
pub(crate) fn inertia_matrix(body: &LinkParameters) -> Mat3 {
    let [_, _, _, _, xx, xy, yy, xz, yz, zz] = *body;
    [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
}

/// A body from its mass \[kg\], centre of mass \[m\] and inertia about the CENTRE OF MASS \[kg·m²\], all in one frame.
pub fn body_from_com(mass: f64, com: &[f64; 3], inertia: &[[f64; 3]; 3]) -> [f64; 10] {
    let at_com = assemble(mass, &[0.0; 3], inertia);
    body_in_frame(&at_com, &crate::spatial::IDENTITY, com)
}

#[inline(always)]
pub(crate) fn assemble(m: f64, h: &Vec3, i: &Mat3) -> LinkParameters {
    [m, h[0], h[1], h[2], i[0][0], i[0][1], i[1][1], i[0][2], i[1][2], i[2][2]]
}

/// The same body seen from another frame: `r` maps components in the body's present frame to the new one, `p` \[m\] is
/// the present origin in the new frame.
///
/// From `x = R·r + p` for every mass point: `h' = R·h + m·p`,
/// `I' = R·I·Rᵀ + (2p·Rh + m·p·p)·1 − (Rh·pᵀ + p·(Rh)ᵀ + m·p·pᵀ)` (Steiner's theorem, any reference point).
#[inline(always)]
pub fn body_in_frame(body: &[f64; 10], r: &[[f64; 3]; 3], p: &[f64; 3]) -> [f64; 10] {
    let m = body[0];
    let rh = rotate(r, &[body[1], body[2], body[3]]);
    let mut i = multiply(&multiply(r, &inertia_matrix(body)), &transpose(r));
    let spread = 2.0 * dot(p, &rh) + m * dot(p, p);
    for a in 0..3 {
        i[a][a] += spread;
        for b in 0..3 {
            i[a][b] -= rh[a] * p[b] + p[a] * rh[b] + m * p[a] * p[b];
        }
    }
    let shift = scale(p, m);
    assemble(m, &[rh[0] + shift[0], rh[1] + shift[1], rh[2] + shift[2]], &i)
}
