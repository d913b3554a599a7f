//! The motion that separates two effects, in words.

use crate::effects::Effect;

/// The motion that separates an effect from its rivals; none when it has no rival and nothing outside the library looks like it.
pub(crate) fn motion(effect: Effect, rivals: &[Effect]) -> Option<String> {
    if rivals.is_empty() {
        let zero = "the torque signal with the drive off (a zero that is off by as much looks the same in motion)";
        return effect.about().is_like_torque_zero.then(|| zero.to_owned());
    }
    let both = |a: Effect, b: Effect| effect == a && rivals == [b] || effect == b && rivals == [a];
    if both(Effect::Counterbalance, Effect::LinkInertia) {
        // At rest they pull alike in every pose.
        let fast =
            "fast moves of the joint while those before it turn: a body has inertia where it pulls, a spring has none";
        return Some(fast.to_owned());
    }
    // What tells them is above the frequencies at which torque can be trusted to tell: see `torque_timing::SLOW_HZ`.
    if both(Effect::TransportDelay, Effect::CurrentLoopLag) {
        return None;
    }
    if both(Effect::Payload, Effect::LinkInertia) {
        return Some(
            "the same motion with nothing at the flange: what it carries and the last link are one body".to_owned(),
        );
    }
    let mut motions: Vec<&str> = vec![effect.about().motion];
    for rival in rivals {
        if !motions.contains(&rival.about().motion) {
            motions.push(rival.about().motion);
        }
    }
    Some(motions.join("; "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_load_is_told_from_the_last_link_by_taking_it_off() {
        for (effect, rival) in [(Effect::LinkInertia, Effect::Payload), (Effect::Payload, Effect::LinkInertia)] {
            assert!(motion(effect, &[rival]).is_some_and(|text| text.contains("nothing at the flange")));
        }
    }

    #[test]
    fn what_has_no_rival_needs_no_motion_but_a_constant_torque() {
        assert_eq!(motion(Effect::TorqueRipple, &[]), None);
        assert!(motion(Effect::FrictionAsymmetry, &[]).is_some_and(|m| m.contains("drive off")));
    }

    #[test]
    fn no_motion_is_said_to_tell_a_delay_from_a_lag() {
        assert_eq!(motion(Effect::TransportDelay, &[Effect::CurrentLoopLag]), None);
        assert!(motion(Effect::TransportDelay, &[Effect::JointElasticity]).is_some_and(|m| m.contains("chirp")));
    }

    /// Static poses, which each of them by itself asks for, do not tell a body from a counterbalance.
    #[test]
    fn a_body_is_told_from_a_counterbalance_by_its_inertia() {
        let told = motion(Effect::Counterbalance, &[Effect::LinkInertia]).expect("a rival");
        assert!(told.contains("inertia") && !told.contains("static"), "{told}");
    }

    #[test]
    fn motions_of_one_class_are_told_once() {
        let told = motion(Effect::JointSpring, &[Effect::Counterbalance]).expect("a rival");
        assert_eq!(told, motion(Effect::JointSpring, &[Effect::JointSpring]).expect("a rival"));
    }
}
