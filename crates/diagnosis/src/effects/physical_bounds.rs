//! Physical bounds of the values of an arm and of the sizes of effects.
//!
//! A fit knows no bounds: where the model lacks something, a value takes it up and may become an inertia below zero. Such a value is no
//! finding, it stands for something else.

use rivet_dynamics::{Arm, Parameter};

use crate::model::nominal::Nominal;
use crate::policy::POLICY;

/// A value that no arm has.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Impossible {
    /// Its name.
    pub(crate) name: String,
    /// As it came out.
    pub(crate) value: f64,
    pub(crate) unit: &'static str,
}

/// What a person would say of some.
pub(crate) fn text(what: &[Impossible]) -> String {
    let each =
        |Impossible { name, value, unit }: &Impossible| format!("{name} {value:.3} {unit}").trim_end().to_owned();
    let all: Vec<String> = what.iter().map(each).collect();
    match all.as_slice() {
        [one] => format!("{one} is outside of physical bounds: it is the effect of something else"),
        _ => format!("{} are outside of physical bounds: they are the effect of something else", all.join(", ")),
    }
}

/// The size of a form whose sign is wrong. As it was adopted it had the right one; what was fitted beside it since may have turned it.
pub(crate) fn wrong_sign(is_plausible: bool, joint: usize, c: &[f64], nominal: &Nominal) -> Option<Impossible> {
    (!is_plausible).then(|| {
        let name = format!("its size on {}", nominal.model.arm.joints[joint].name);
        Impossible { name, value: c[0], unit: "" }
    })
}

/// A body at the flange of an arm. Where the flange is the model does not say: about as far beyond the last link's centre as that is beyond its
/// joint, or as far as links of this arm are long.
pub(crate) fn of_payload(c: &[f64], arm: &Arm) -> Option<Impossible> {
    let far =
        |body: &[f64]| body[1..4].iter().map(|h| h * h).sum::<f64>().sqrt() / body[0].abs().max(f64::MIN_POSITIVE);
    let named = |name: &str, value, unit| Some(Impossible { name: name.to_owned(), value, unit });
    let reach = reach(arm);
    let flange = arm.links.last().map_or(0.0, |link| 2.0 * far(link));
    let most = (POLICY.adoption.max_payload_distance_share * reach + flange)
        .max(reach / arm.dof().saturating_sub(1).max(1) as f64);
    match () {
        () if c[0] <= 0.0 => named("mass at the flange", c[0], "kg"),
        () if reach > 0.0 && far(c) > most => named("distance of the load from the flange", far(c), "m"),
        () => None,
    }
}

/// Whether a value of a drive is none below zero.
pub(crate) fn is_drive(parameter: Parameter) -> bool {
    matches!(parameter, Parameter::RotorInertia(_) | Parameter::Viscous(_) | Parameter::Coulomb(_))
}

/// Sum of the distances between the arm's joints \[m\].
pub(crate) fn reach(arm: &Arm) -> f64 {
    let length = |t: [f64; 3]| t.iter().map(|t| t * t).sum::<f64>().sqrt();
    arm.joints.iter().skip(1).map(|joint| length(joint.translation)).sum()
}

/// The value at place `at` of a standard vector, if no arm has it.
pub(crate) fn of_value(at: usize, nominal: &Nominal, standard: &[f64]) -> Option<Impossible> {
    let (model, value) = (&nominal.model, standard[at]);
    let parameter = model.parameters[at];
    let impossible = match parameter {
        // Of a body the runs tell sums over links; its own moments one by one mean little.
        Parameter::Link { entry: 0, .. } => value <= 0.0,
        Parameter::Link { entry: 4, .. } => value + standard[at + 2] + standard[at + 5] <= 0.0,
        _ => is_drive(parameter) && value < -POLICY.adoption.max_negative_share * nominal.x[at].abs(),
    };
    impossible.then(|| Impossible { name: parameter.name(&model.arm), value, unit: parameter.unit(&model.arm) })
}
