//! The class of a cause: effects that are not distinguishable from it on any of its joints.

use crate::effects::Effect;
use crate::select::adopted::Adopted;

/// Each effect once, and the angle to it \[rad\]: the smallest where it is so on several joints.
pub(crate) fn effects(adopted: &[Adopted]) -> Vec<(Effect, f64)> {
    let mut class: Vec<(Effect, f64)> = Vec::new();
    for (effect, angle) in adopted.iter().flat_map(Adopted::class) {
        match class.iter_mut().find(|(before, _)| *before == effect) {
            Some((_, least)) => *least = least.min(angle),
            None => class.push((effect, angle)),
        }
    }
    class
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Form;
    use crate::effects::angle_law::Pull;
    use crate::effects::counterbalance;
    use crate::effects::friction_asymmetry::Asymmetry;
    use crate::effects::rotor_inertia::RotorInertia;
    use crate::select::adopted::Rival;

    /// On each of two joints the same two effects explain as much, one of which has nothing in common with it.
    #[test]
    fn a_class_names_each_effect_once_and_none_that_is_across() {
        let adopted = |joint: usize, cosine: f64| {
            let rivals =
                [(Pull { joint, from: 0.0, above: true }.into(), cosine), (Form::from(Asymmetry { joint }), 0.02)];
            Adopted {
                rivals: rivals.iter().filter_map(|(form, cosine)| Rival::if_confounded(form, *cosine)).collect(),
                ..Adopted::alone(RotorInertia { joint }.into())
            }
        };
        let class = effects(&[adopted(0, 0.96), adopted(1, 0.98)]);
        assert!(class.len() == 1 && class[0].0 == counterbalance::EFFECT, "{class:?}");
        assert!((class[0].1 - 0.98_f64.acos()).abs() < 1e-12, "{class:?}");
    }
}
