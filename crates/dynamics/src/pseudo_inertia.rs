//! The pseudo-inertia of a body: positive definite exactly when some distribution of mass has these parameters
//! (Wensing, Kim & Slotine 2018).

use nalgebra::Matrix4;

use crate::link::{LinkParameters, inertia_matrix};
use crate::spatial::{Vec3, dot};

/// `P = [[Σ, h], [hᵀ, m]]` with `Σ = ½·tr(I)·1 − I = ∫ x·xᵀ dm` \[kg·m²\], first moment h \[kg·m\] and mass m \[kg\],
/// about the origin of the joint frame. Linear in the parameters.
///
/// P > 0 says: positive mass, positive principal moments, and the triangle inequality among them.
#[must_use]
pub fn pseudo_inertia(body: &LinkParameters) -> [[f64; 4]; 4] {
    let i = inertia_matrix(body);
    let half_trace = 0.5 * (i[0][0] + i[1][1] + i[2][2]);
    let mut p = [[0.0; 4]; 4];
    for a in 0..3 {
        for b in 0..3 {
            p[a][b] = if a == b { half_trace - i[a][a] } else { -i[a][b] };
        }
        (p[a][3], p[3][a]) = (body[1 + a], body[1 + a]);
    }
    p[3][3] = body[0];
    p
}

/// The body with pseudo-inertia `p`: `I = tr(Σ)·1 − Σ`. Inverse of [`pseudo_inertia`].
#[must_use]
pub fn body_from_pseudo_inertia(p: &[[f64; 4]; 4]) -> LinkParameters {
    let trace = p[0][0] + p[1][1] + p[2][2];
    [
        p[3][3],
        p[0][3],
        p[1][3],
        p[2][3],
        trace - p[0][0],
        -p[0][1],
        trace - p[1][1],
        -p[0][2],
        -p[1][2],
        trace - p[2][2],
    ]
}

/// Smallest eigenvalue of the pseudo-inertia; its unit mixes kg and kg·m², its sign is what counts.
#[must_use]
pub fn smallest_eigenvalue(body: &LinkParameters) -> f64 {
    let p = pseudo_inertia(body);
    Matrix4::from_fn(|i, k| p[i][k]).symmetric_eigenvalues().min()
}

/// Mass \[kg\], centre of mass \[m\] and inertia about the CENTRE OF MASS \[kg·m²\] of a body, in its frame: the inverse
/// of [`body_from_com`](crate::body_from_com). The mass must not be zero.
#[must_use]
pub fn com_from_body(body: &LinkParameters) -> (f64, [f64; 3], [[f64; 3]; 3]) {
    let m = body[0];
    let com: Vec3 = [body[1] / m, body[2] / m, body[3] / m];
    let mut about_com = inertia_matrix(body);
    for a in 0..3 {
        about_com[a][a] -= m * dot(&com, &com);
        for b in 0..3 {
            about_com[a][b] += m * com[a] * com[b];
        }
    }
    (m, com, about_com)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::body_from_com;

    /// A sum of mass points has Σ, h and m by definition.
    #[test]
    fn mass_points_give_their_moments() {
        let points =
            [(0.5, [0.1, -0.2, 0.3]), (1.5, [0.0, 0.4, -0.1]), (0.7, [-0.3, 0.1, 0.2]), (0.2, [0.5, 0.5, 0.1])];
        let mut body = [0.0; 10];
        let mut by_hand = [[0.0; 4]; 4];
        for (m, x) in points {
            let point = body_from_com(m, &x, &[[0.0; 3]; 3]);
            body.iter_mut().zip(point).for_each(|(sum, part)| *sum += part);
            let y = [x[0], x[1], x[2], 1.0];
            for a in 0..4 {
                for b in 0..4 {
                    by_hand[a][b] += m * y[a] * y[b];
                }
            }
        }
        let p = pseudo_inertia(&body);
        for a in 0..4 {
            for b in 0..4 {
                // A handful of additions of numbers near one.
                assert!((p[a][b] - by_hand[a][b]).abs() < 1e-15, "{a} {b}: {p:?}");
            }
        }
        assert!(smallest_eigenvalue(&body) > 0.0, "four points off one plane fill space");
        let back = body_from_pseudo_inertia(&p);
        assert!(back.iter().zip(&body).all(|(a, b)| (a - b).abs() < 1e-15));
        let (m, com, inertia) = com_from_body(&body);
        let again = body_from_com(m, &com, &inertia);
        assert!(again.iter().zip(&body).all(|(a, b)| (a - b).abs() < 1e-15));
    }

    #[test]
    fn impossible_bodies_show() {
        let with = |diagonal: [f64; 3]| {
            body_from_com(1.0, &[0.0; 3], &[[diagonal[0], 0.0, 0.0], [0.0, diagonal[1], 0.0], [0.0, 0.0, diagonal[2]]])
        };
        assert!(smallest_eigenvalue(&with([0.1, 0.1, 0.1])) > 0.0);
        assert!(smallest_eigenvalue(&with([0.1, 0.1, 0.3])) < 0.0, "triangle inequality");
        assert!(smallest_eigenvalue(&with([0.1, 0.1, -0.01])) < 0.0, "negative moment");
    }
}
