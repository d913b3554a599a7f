//! Bodies of a URDF: checked, projected where that is asked for, guessed where there are none.

use nalgebra::Matrix3;

use super::error::UrdfError;
use urdf_rs::Pose;

use super::text::Link;
use crate::arm::{Arm, JointKind};
use crate::link::{LINK_PARAMETERS, LinkParameters, assemble, body_from_com, body_in_frame, inertia_matrix};
use crate::pseudo_inertia::com_from_body;
use crate::spatial::{Mat3, Vec3, dot, from_roll_pitch_yaw};

/// By how much of the largest principal moment the triangle inequality may be missed: a plate's moments rounded to
/// three digits miss it by about this much.
const TRIANGLE_ROUNDING: f64 = 1e-3;
/// A body that is projected extends over at least this in every direction, as standard deviation of its mass \[m\]: less than any link.
const LEAST_EXTENT_M: f64 = 1e-3;

/// Share of a joint's torque limit that holds the arm's own mass at half its reach: 0.2 to 0.5 on the arms of `robots/`.
const HOLDING_SHARE: f64 = 0.3;
/// At least this share of the mass that a joint carries is in the link next to it.
const LEAST_SHARE: f64 = 0.15;
/// Radius of gyration of a link about its centre, as a share of its length: that of a rod, 1/sqrt(12).
const GYRATION_SHARE: f64 = 0.3;
/// A link is at least this share of the arm's reach long: where axes meet, the housing between them is.
const LEAST_LENGTH: f64 = 0.08;
/// \[m/s²\]
const FREE_FALL: f64 = 9.81;

/// Angles within so much of quarter turns are quarter turns \[rad\]: 1.5708 and 3.1416 are π/2 and π, written short.
const QUARTER_TURN: f64 = 1e-5;

pub(super) fn finite(values: &[f64], what: &'static str, name: &str, quantity: &'static str) -> Result<(), UrdfError> {
    match values.iter().find(|v| !v.is_finite()) {
        Some(&value) => Err(UrdfError::NotFinite { what, name: name.to_owned(), quantity, value }),
        None => Ok(()),
    }
}

pub(super) fn pose(origin: &Pose, what: &'static str, name: &str) -> Result<(Mat3, Vec3), UrdfError> {
    finite(&origin.xyz.0, what, name, "origin xyz")?;
    finite(&origin.rpy.0, what, name, "origin rpy")?;
    Ok((from_roll_pitch_yaw(&origin.rpy.0.map(quarter_turns)), origin.xyz.0))
}

/// Axes that are parallel but for a rounded angle would each make base parameters of their own, which no data can tell.
fn quarter_turns(angle: f64) -> f64 {
    let quarter = std::f64::consts::FRAC_PI_2;
    let turns = (angle / quarter).round() * quarter;
    if (angle - turns).abs() <= QUARTER_TURN { turns } else { angle }
}

/// A body as the file has it, and what was wrong with it where it was projected.
pub(super) struct Checked {
    pub(super) body: LinkParameters,
    pub(super) projected: Option<UrdfError>,
}

/// A link's own body in the link frame; zero when it has no `<inertial>`.
///
/// With `project`, a body that cannot be becomes the nearest that can; one without mass but with an inertia is none.
pub(super) fn body_of(link: &Link, project: bool) -> Result<Checked, UrdfError> {
    let none = || Checked { body: [0.0; LINK_PARAMETERS], projected: None };
    let Some(inertial) = &link.inertial else { return Ok(none()) };
    let (mass, i) = (inertial.values.mass.value, &inertial.values.inertia);
    let name = &link.name;
    let entries = [i.ixx, i.ixy, i.iyy, i.ixz, i.iyz, i.izz];
    finite(&[mass], "link", name, "mass")?;
    finite(&entries, "link", name, "inertia")?;
    let (r, com) = pose(&inertial.values.origin, "link", name)?;
    if mass < 0.0 || (mass == 0.0 && entries.iter().any(|&e| e != 0.0)) {
        let error = UrdfError::BadMass { link: name.clone(), mass };
        return if project { Ok(Checked { projected: Some(error), ..none() }) } else { Err(error) };
    }
    let about_com = assemble(mass, &[0.0; 3], &[[i.ixx, i.ixy, i.ixz], [i.ixy, i.iyy, i.iyz], [i.ixz, i.iyz, i.izz]]);
    // A point mass or a thin rod is a good part of a link, so zero moments pass here; see `check_moving_body`.
    let moments = principal_moments(&inertia_matrix(&about_com));
    let impossible = if moments[0] < -f64::EPSILON * 8.0 * moments[2].abs() {
        Some(UrdfError::NotPositiveDefinite { link: name.clone(), moment: moments[0] })
    } else {
        triangle(name, moments)
    };
    match impossible {
        None => Ok(Checked { body: body_in_frame(&about_com, &r, &com), projected: None }),
        Some(error) if project => {
            Ok(Checked { body: body_in_frame(&nearest(&about_com), &r, &com), projected: Some(error) })
        }
        Some(error) => Err(error),
    }
}

/// A moving body, everything fixed to it included, must have mass in all directions: its joint may turn about any axis.
pub(super) fn check_moving_body(name: &str, body: &LinkParameters, project: bool) -> Result<Checked, UrdfError> {
    let link = name.to_owned();
    let m = body[0];
    let (_, com, about_com) = com_from_body(body);
    let moments = principal_moments(&about_com);
    // Below this, what is left of the moment is rounding of the shift to the joint frame and back.
    let rounding = 16.0 * f64::EPSILON * (m * dot(&com, &com) + moments[2].abs());
    let impossible = if moments[0] <= rounding {
        Some(UrdfError::NotPositiveDefinite { link, moment: moments[0] })
    } else {
        triangle(name, moments)
    };
    match impossible {
        None => Ok(Checked { body: *body, projected: None }),
        Some(error) if project => {
            let at_com = nearest(&assemble(m, &[0.0; 3], &about_com));
            Ok(Checked { body: body_from_com(m, &com, &inertia_matrix(&at_com)), projected: Some(error) })
        }
        Some(error) => Err(error),
    }
}

/// The nearest body that can be of one about its centre of mass: second moments of mass `Σ = ½·tr(I)·1 − I` without those below the
/// least extent (Frobenius norm of Σ).
fn nearest(about_com: &LinkParameters) -> LinkParameters {
    let i = inertia_matrix(about_com);
    let half_trace = 0.5 * (i[0][0] + i[1][1] + i[2][2]);
    let second = Matrix3::from_fn(|a, b| if a == b { half_trace - i[a][a] } else { -0.5 * (i[a][b] + i[b][a]) });
    let mut eigen = second.symmetric_eigen();
    let least = about_com[0] * LEAST_EXTENT_M * LEAST_EXTENT_M;
    eigen.eigenvalues.iter_mut().for_each(|value| *value = value.max(least));
    let second = eigen.recompose();
    let trace = second.trace();
    let inertia: Mat3 = std::array::from_fn(|a| {
        std::array::from_fn(|b| if a == b { trace - second[(a, a)] } else { -0.5 * (second[(a, b)] + second[(b, a)]) })
    });
    assemble(about_com[0], &[0.0; 3], &inertia)
}

/// Principal moments, ascending.
fn principal_moments(inertia: &Mat3) -> [f64; 3] {
    let mut moments: [f64; 3] = Matrix3::from_fn(|i, k| inertia[i][k]).symmetric_eigenvalues().into();
    moments.sort_by(f64::total_cmp);
    moments
}

fn triangle(name: &str, moments: [f64; 3]) -> Option<UrdfError> {
    let violated = moments[2] > moments[0] + moments[1] + TRIANGLE_ROUNDING * moments[2];
    violated.then(|| UrdfError::TriangleInequality { link: name.to_owned(), moments })
}

/// Distance from each joint to the next one \[m\], of the last link as given; none shorter than a share of the reach.
fn lengths(arm: &Arm, last: f64) -> Vec<f64> {
    let size = |v: &[f64; 3]| dot(v, v).sqrt();
    let mut lengths: Vec<f64> = arm.joints.iter().skip(1).map(|joint| size(&joint.translation)).collect();
    lengths.push(last);
    // A joint that slides adds its travel.
    for (length, joint) in lengths.iter_mut().zip(&arm.joints) {
        let travel = joint.upper - joint.lower;
        if joint.kind == JointKind::Prismatic && travel.is_finite() {
            *length += 0.5 * travel;
        }
    }
    let reach: f64 = lengths.iter().sum();
    let least = LEAST_LENGTH * if reach > 0.0 { reach } else { 1.0 };
    lengths.into_iter().map(|length| length.max(least)).collect()
}

/// Mass \[kg\] that each joint carries, by what its torque limit can hold; never more than the joint before it can.
fn carried(arm: &Arm, lengths: &[f64], torque_limit: &[f64]) -> Vec<f64> {
    let mut most = f64::INFINITY;
    let of = |j: usize| {
        let reach: f64 = lengths[j..].iter().sum();
        let hold = HOLDING_SHARE * torque_limit[j] / FREE_FALL;
        let slides = arm.joints[j].kind == JointKind::Prismatic;
        let mass = if slides { hold } else { hold / (0.5 * reach) };
        most = mass.min((1.0 - LEAST_SHARE) * most);
        most
    };
    (0..arm.dof()).map(of).collect()
}

/// Puts bodies where there are none: as heavy as torque limits allow, as long as the links are. They are a guess to start from, of the
/// order of magnitude of the arm's.
///
/// Returns the standard deviation of each entry of the standard vector of the links, 0 of those that are known: the mass that the joint
/// carries, as far away as the arm reaches from there.
///
/// * `unknown`: whether the body of each joint is to be guessed
/// * `torque_limit` \[N·m\], one each joint
/// * `tip` \[m\]: length of the last link
///
/// # Panics
/// If a list is not one entry a joint.
pub fn guess_bodies(arm: &mut Arm, unknown: &[bool], torque_limit: &[f64], tip: f64) -> Vec<f64> {
    let n = arm.dof();
    assert_eq!([unknown.len(), torque_limit.len()], [n; 2], "one value a joint");
    let lengths = lengths(arm, tip);
    let carried = carried(arm, &lengths, torque_limit);
    let mut std = vec![0.0; LINK_PARAMETERS * n];
    for j in (0..n).filter(|&j| unknown[j]) {
        let mass = carried[j] - carried.get(j + 1).copied().unwrap_or(0.0);
        let mass = mass.max(LEAST_SHARE * carried[j]);
        let centre = arm.joints.get(j + 1).map_or([0.0; 3], |next| next.translation.map(|x| 0.5 * x));
        let moment = mass * (GYRATION_SHARE * lengths[j]).powi(2);
        let inertia: Mat3 = std::array::from_fn(|a| std::array::from_fn(|b| if a == b { moment } else { 0.0 }));
        arm.links[j] = body_from_com(mass, &centre, &inertia);
        let reach: f64 = lengths[j..].iter().sum();
        for (entry, std) in std[LINK_PARAMETERS * j..LINK_PARAMETERS * (j + 1)].iter_mut().enumerate() {
            *std = carried[j]
                * match entry {
                    0 => 1.0,
                    1..=3 => reach,
                    _ => reach * reach,
                };
        }
    }
    std
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pseudo_inertia::smallest_eigenvalue;
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

    /// Moments that can be stay; one that cannot is the only one that changes.
    #[test]
    fn projection_changes_what_cannot_be() {
        let about = |moments: [f64; 3]| {
            body_from_com(2.0, &[0.0; 3], &[[moments[0], 0.0, 0.0], [0.0, moments[1], 0.0], [0.0, 0.0, moments[2]]])
        };
        let good = about([0.02, 0.03, 0.04]);
        assert!(nearest(&good).iter().zip(&good).all(|(a, b)| (a - b).abs() < 1e-15));
        for moments in [[0.01, 0.01, 0.05], [0.0, 0.0, 0.0], [-0.01, 0.02, 0.02]] {
            let projected = nearest(&about(moments));
            assert!(smallest_eigenvalue(&projected) > 0.0, "{moments:?}: {projected:?}");
            assert_eq!(projected[0], 2.0, "the mass stays");
        }
        // Σ of the first is diag(0.025, 0.025, -0.015): its negative part goes, and nothing else.
        let projected = nearest(&about([0.01, 0.01, 0.05]));
        let least = 2.0 * LEAST_EXTENT_M * LEAST_EXTENT_M;
        let expected = [0.025 + least, 0.025 + least, 0.05];
        for (entry, expected) in [projected[4], projected[6], projected[9]].iter().zip(expected) {
            assert!((entry - expected).abs() < 1e-15, "{projected:?}");
        }
    }
}
