//! Friction of each joint over its speed, with a band of two standard deviations.

use rivet_config::Robot;
use rivet_dynamics::{EffectKind, KnownEffect, Parameter, friction_sign, own_torque};
use rivet_ipc_schema::Parameters;
use schemars::JsonSchema;
use serde::Serialize;

/// Standard deviations from a value to the edge of its band.
pub(crate) const BAND_SIGMAS: f64 = 2.0;
/// Points of a curve on each side of standstill.
const POINTS_A_SIDE: i32 = 30;
/// Largest speed of a curve where the URDF has no limit \[rad/s, m/s\].
const USUAL_SPEED: f64 = 3.0;

/// Friction of each joint over its speed, by the estimated parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, JsonSchema)]
pub struct FrictionCurves {
    /// Epoch of the parameters.
    pub epoch: u64,
    /// Stamp of the parameters, `CLOCK_MONOTONIC` [ns].
    pub stamp_ns: u64,
    /// One curve a joint, base to flange.
    pub joints: Vec<FrictionCurve>,
}

/// Friction of one joint without load: Coulomb, viscous and quadratic, with the known friction effects of the robot file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, JsonSchema)]
pub struct FrictionCurve {
    /// Name of the joint.
    pub name: String,
    /// Speeds, from minus to plus the speed limit, closest at standstill [rad/s, or m/s].
    pub speed: Vec<f64>,
    /// Friction torque of the drive at each speed [N m, or N].
    pub torque: Vec<f64>,
    /// The same minus two standard deviations, parameters taken as uncorrelated [N m, or N].
    pub lower: Vec<f64>,
    /// The same plus two standard deviations [N m, or N].
    pub upper: Vec<f64>,
    /// The same by the robot file's parameters [N m, or N].
    pub nominal: Vec<f64>,
}

/// Which parameters make the friction of a joint, and at which speeds it is evaluated.
#[derive(Clone, Debug)]
struct Joint {
    name: String,
    /// Base parameters with what they are multiplied by.
    terms: Vec<(usize, Term)>,
    effects: Vec<KnownEffect>,
    speed: Vec<f64>,
}

/// What a friction parameter is multiplied by.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Term {
    Coulomb,
    Viscous,
    Quadratic,
}

impl Term {
    /// `direction`: s(v) of the friction law.
    fn factor(self, speed: f64, direction: f64) -> f64 {
        match self {
            Term::Coulomb => direction,
            Term::Viscous => speed,
            Term::Quadratic => speed * speed.abs(),
        }
    }
}

/// Makes curves of the parameters of one robot.
#[derive(Clone, Debug)]
pub(crate) struct Friction {
    joints: Vec<Joint>,
    nominal: Vec<f64>,
    /// v0 of the friction law \[rad/s\].
    sign_velocity: f64,
}

impl Friction {
    pub(crate) fn new(robot: &Robot) -> Friction {
        let (model, base) = (&robot.model, &robot.base);
        let terms = |joint: usize| {
            let term = |i: usize| match base.parameter(model, i) {
                Parameter::Coulomb(j) if j == joint => Some((i, Term::Coulomb)),
                Parameter::Viscous(j) if j == joint => Some((i, Term::Viscous)),
                Parameter::ViscousQuadratic(j) if j == joint => Some((i, Term::Quadratic)),
                _ => None,
            };
            (0..base.len()).filter_map(term).collect()
        };
        let depends_on_speed = |kind| {
            use EffectKind::{FrictionAsymmetry, StribeckFriction, ViscousNonlinearity};
            matches!(kind, FrictionAsymmetry | StribeckFriction | ViscousNonlinearity)
        };
        let joints = model.arm.joints.iter().enumerate().map(|(j, joint)| {
            let effects = model.effects().list().iter().filter(|e| e.joint == j && depends_on_speed(e.kind));
            let limit = if joint.velocity.is_finite() { joint.velocity } else { USUAL_SPEED };
            Joint {
                name: joint.name.clone(),
                terms: terms(j),
                effects: effects.copied().collect(),
                speed: speeds(limit),
            }
        });
        Friction {
            joints: joints.collect(),
            nominal: robot.nominal_base.clone(),
            sign_velocity: model.structure.sign_velocity,
        }
    }

    /// `τ(v) = Σ φᵢ(v)·θᵢ + effects`, with the band `τ ± 2·√(Σ φᵢ²·σᵢ²)`; φ is s(v), v and v·|v|.
    pub(crate) fn curves(&self, set: &Parameters) -> FrictionCurves {
        let curve = |joint: &Joint| {
            let mut curve = FrictionCurve { name: joint.name.clone(), ..FrictionCurve::default() };
            for &speed in &joint.speed {
                let direction = friction_sign(speed, self.sign_velocity);
                let known: f64 =
                    joint.effects.iter().map(|effect| own_torque(effect, direction, 0.0, 0.0, speed)).sum();
                let (mut torque, mut nominal, mut variance) = (known, known, 0.0);
                for &(i, term) in &joint.terms {
                    let factor = term.factor(speed, direction);
                    torque += factor * set.values[i];
                    nominal += factor * self.nominal[i];
                    variance += (factor * set.std[i]).powi(2);
                }
                let width = BAND_SIGMAS * variance.sqrt();
                curve.speed.push(speed);
                curve.torque.push(torque);
                curve.lower.push(torque - width);
                curve.upper.push(torque + width);
                curve.nominal.push(nominal);
            }
            curve
        };
        let joints = self.joints.iter().map(curve).collect();
        FrictionCurves { epoch: set.epoch, stamp_ns: set.stamp_ns, joints }
    }
}

/// Speeds from `-limit` to `limit`, with square spacing: friction changes most at standstill.
fn speeds(limit: f64) -> Vec<f64> {
    let at = |i: i32| {
        let share = f64::from(i) / f64::from(POINTS_A_SIDE);
        limit * share * share.abs()
    };
    (-POINTS_A_SIDE..=POINTS_A_SIDE).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn friction(terms: Vec<(usize, Term)>, effects: Vec<KnownEffect>, sign_velocity: f64) -> Friction {
        let joint = Joint { name: "elbow".to_owned(), terms, effects, speed: speeds(2.0) };
        Friction { joints: vec![joint], nominal: vec![1.0, 0.5, -0.1], sign_velocity }
    }

    fn set() -> Parameters {
        let mut set = Parameters { epoch: 7, stamp_ns: 8, count: 3, joints: 1, ..Parameters::default() };
        set.values[..3].copy_from_slice(&[3.0, 0.7, -0.2]);
        set.std[..3].copy_from_slice(&[0.3, 0.4, 0.05]);
        set
    }

    /// At v = 2 rad/s: 3 + 0.7·2 − 0.2·4 = 3.6 N·m; variance 0.3² + (2·0.4)² + (4·0.05)² = 0.77.
    #[test]
    fn curve_and_band_match_their_closed_form() {
        let terms = vec![(0, Term::Coulomb), (1, Term::Viscous), (2, Term::Quadratic)];
        let curves = friction(terms, Vec::new(), 0.0).curves(&set());
        assert_eq!((curves.epoch, curves.stamp_ns, curves.joints.len()), (7, 8, 1));
        let curve = &curves.joints[0];
        let last = curve.speed.len() - 1;
        assert_eq!((curve.speed[0], curve.speed[last / 2], curve.speed[last]), (-2.0, 0.0, 2.0));
        let width = 2.0 * 0.77_f64.sqrt();
        let expected = [(0, -3.6, -(1.0 + 0.5 * 2.0 - 0.1 * 4.0)), (last, 3.6, 1.0 + 0.5 * 2.0 - 0.1 * 4.0)];
        for (at, torque, nominal) in expected {
            // Four terms of about one: rounding is far below.
            assert!((curve.torque[at] - torque).abs() < 1e-14, "{} vs {torque}", curve.torque[at]);
            assert!((curve.lower[at] - (torque - width)).abs() < 1e-14 && (curve.nominal[at] - nominal).abs() < 1e-14);
            assert!((curve.upper[at] - (torque + width)).abs() < 1e-14);
        }
        // At standstill friction has no direction, and nothing to be uncertain of.
        assert_eq!([curve.torque[last / 2], curve.lower[last / 2], curve.upper[last / 2]], [0.0; 3]);
    }

    /// Stribeck: `excess·exp(−(v/velocity)²)`, 0.8·e⁻¹ at v = velocity; tanh(v/v0) for a regularised sign.
    #[test]
    fn known_effects_and_regularised_sign_are_in_the_curve() {
        let effect = KnownEffect::new(EffectKind::StribeckFriction, 0, &[0.8, 2.0]);
        let curves = friction(vec![(0, Term::Coulomb)], vec![effect], 0.5).curves(&set());
        let last = curves.joints[0].speed.len() - 1;
        let sign = (2.0_f64 / 0.5).tanh();
        let expected = (3.0 + 0.8 * (-1.0_f64).exp()) * sign;
        // The vectorised tanh differs from the library's in the last places.
        assert!((curves.joints[0].torque[last] - expected).abs() < 1e-12, "{}", curves.joints[0].torque[last]);
    }

    #[test]
    fn speeds_are_symmetric_and_closest_at_standstill() {
        let speeds = speeds(3.0);
        assert_eq!(speeds.len(), 61);
        assert!(speeds.iter().zip(speeds.iter().rev()).all(|(a, b)| *a == -b));
        assert!(speeds[31] - speeds[30] < 0.05 * (speeds[60] - speeds[59]), "{speeds:?}");
    }
}
