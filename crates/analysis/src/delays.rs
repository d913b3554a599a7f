//! What `rivet identify` says of torque that is late against position, or early.

use rivet_estimation::offline::{Delay, DelayDoubt, REACH_S};
use serde_json::{Value, json};

use crate::evidence::Distrust;
use crate::table::paragraph;

/// A joint's delay is the clock's, which all have in common, if it is no further from it than this \[s\], or than so many of its
/// deviations.
const APART_S: f64 = 2e-3;
const APART_STD: f64 = 3.0;
/// What friction at standstill makes of a joint's delay, beside its deviation (one standard deviation) \[s\]: so much of any, and so
/// much more, times the square of its share, where dry friction is all of the torque. Of 25 sound simulated logs with friction that
/// sticks, joints with less than 0.4 were off by 0.8 ms at most, wrists with 0.5 and more by up to 8.5 ms.
const LEAST_S: f64 = 0.5e-3;
const DRY_S: f64 = 6e-3;
/// A common delay is worth a warning from this on \[s\], and beyond so many of its deviations.
const LATE_S: f64 = 2e-3;
const LATE_STD: f64 = 3.0;
/// It is also more than this share of the logs' own step: what a row is off inside of that, slow logs cannot tell.
const LATE_STEPS: f64 = 0.25;
/// One joint's channel is late by itself from this on \[s\], and beyond so many deviations: what the model lacks of a joint, friction or a
/// spring, makes a delay as well, by up to 5 of them and 14 ms on the practice cases.
const ALONE_S: f64 = 5e-3;
const ALONE_STD: f64 = 6.0;

/// What the joints' delays have in common.
struct Common {
    seconds: f64,
    std: f64,
    /// Joints (from 0) that have it, and those that have another.
    joints: Vec<usize>,
    others: Vec<usize>,
}

/// Of a joint's delay, friction at standstill included.
fn variance(delay: &Delay, dry: f64) -> f64 {
    delay.std.powi(2) + (LEAST_S + DRY_S * dry.powi(2)).powi(2)
}

/// The delay that the joints have that tell it best; `dry`: share of friction in their torque.
fn common(delays: &[Delay], dry: &[f64]) -> Option<Common> {
    let variance = |j: &usize| variance(&delays[*j], dry[*j]);
    let mut determined: Vec<usize> = (0..delays.len()).filter(|j| delays[*j].doubt.is_none()).collect();
    determined.sort_by(|a, b| delays[*a].seconds.total_cmp(&delays[*b].seconds));
    let weights = |joints: &[usize]| joints.iter().map(|j| variance(j).recip()).sum::<f64>();
    let half = 0.5 * weights(&determined);
    let middle = (0..determined.len()).find(|k| weights(&determined[..=*k]) >= half)?;
    let median = delays[determined[middle]].seconds;
    let has = |j: &usize| (delays[*j].seconds - median).abs() <= APART_S.max(APART_STD * variance(j).sqrt());
    determined.sort_unstable();
    let (joints, others): (Vec<usize>, Vec<usize>) = determined.into_iter().partition(has);
    let sum = weights(&joints);
    let seconds = joints.iter().map(|j| delays[*j].seconds / variance(j)).sum::<f64>() / sum;
    Some(Common { seconds, std: sum.sqrt().recip(), joints, others })
}

const BY_JOINT: &str =
    "not that of the best determined joints; unmodelled friction and a delay of this channel are confounded";

pub(crate) fn named(names: &[String], joints: &[usize]) -> String {
    joints.iter().map(|j| names[*j].as_str()).collect::<Vec<_>>().join(", ")
}

/// How late torque is behind position, for people.
pub(crate) fn text(names: &[String], delays: &[Delay], dry: &[f64]) -> String {
    let delay_text = |(d, dry): (&Delay, &f64)| match d.doubt {
        None => format!("{:.1}+-{:.1}", 1e3 * d.seconds, 1e3 * variance(d, *dry).sqrt()),
        Some(doubt) => format!("({doubt})"),
    };
    let each: Vec<String> = delays.iter().zip(dry).map(delay_text).collect();
    let others = common(delays, dry).map_or_else(Vec::new, |common| common.others);
    let caveat = if others.is_empty() {
        String::new()
    } else {
        format!("; differs by joint: {} is {BY_JOINT}", named(names, &others))
    };
    // By these a joint is called late: noise alone would say too much. What else the model lacks they do not hold.
    let text =
        format!("{} ms (one std of noise and of friction at standstill that the model lacks){caveat}", each.join("  "));
    paragraph("torque behind position: ", &text)
}

/// The same joint by joint; a value is null where the data do not tell, and has a doubt where it cannot be the log's clock.
pub(crate) fn json(delays: &[Delay], dry: &[f64]) -> Vec<Value> {
    let others = common(delays, dry).map_or_else(Vec::new, |common| common.others);
    let delay_json = |(j, delay): (usize, &Delay)| match delay.doubt {
        None if others.contains(&j) => {
            json!({"value": delay.seconds, "std": delay.std, "doubt": format!("differs by joint: {BY_JOINT}")})
        }
        None => json!({"value": delay.seconds, "std": delay.std}),
        Some(doubt) => json!({"value": null, "std": null, "doubt": doubt.to_string()}),
    };
    delays.iter().enumerate().map(delay_json).collect()
}

/// Torque that the joints that tell it best have late, or early, by about the same, and joints that have it late by themselves; `step_s`:
/// of the logs.
pub(crate) fn distrust(names: &[String], delays: &[Delay], dry: &[f64], step_s: f64) -> Vec<Distrust> {
    if let Some(far) = beyond_reach(names, delays) {
        return vec![far];
    }
    let Some(common) = common(delays, dry) else { return Vec::new() };
    let alone = common.others.iter().filter_map(|j| of_one(&names[*j], &delays[*j], dry[*j], &common, step_s));
    of_all(names, delays.len(), &common, step_s).into_iter().chain(alone).collect()
}

/// Half of the joints or more fit best at the end of what was looked at: then a torque is not that of this motion.
fn beyond_reach(names: &[String], delays: &[Delay]) -> Option<Distrust> {
    let far: Vec<usize> = (0..delays.len()).filter(|j| delays[*j].doubt == Some(DelayDoubt::OutOfReach)).collect();
    (2 * far.len() >= delays.len() && !far.is_empty()).then(|| Distrust {
        log: None,
        joint: None,
        name: "torque_late",
        text: format!(
            "on {} torque fits the motion better the further it is moved, up to {:.0} ms: it is further off than that, or of another motion. \
             What is found from it means nothing: log torque and position of one instant",
            named(names, &far),
            1e3 * REACH_S
        ),
    })
}

/// The channel of one joint, late or early against those that tell it best.
fn of_one(name: &str, delay: &Delay, dry: f64, common: &Common, step_s: f64) -> Option<Distrust> {
    let std = variance(delay, dry).sqrt().hypot(common.std);
    let by = delay.seconds - common.seconds;
    let late = by.abs() >= ALONE_S && by.abs() > ALONE_STD * std && by.abs() > LATE_STEPS * step_s;
    late.then(|| Distrust {
        log: None,
        joint: Some(name.to_owned()),
        name: "torque_late",
        text: format!(
            "torque is {:.1} +- {:.1} ms (one std) {} position, where the joints that determine it best have {:.1} \
             ms: rotor inertia and viscous friction of the joint are biased by it. Its channel is logged at another \
             time than the others, or it has friction that the model lacks: log torque and position of one instant, \
             or shift the column by that time and check whether the residual falls",
            1e3 * delay.seconds.abs(),
            1e3 * std,
            if delay.seconds > 0.0 { "behind" } else { "ahead of" },
            1e3 * common.seconds
        ),
    })
}

fn of_all(names: &[String], all: usize, common: &Common, step_s: f64) -> Option<Distrust> {
    let Common { seconds, std, joints, .. } = common;
    let late = seconds.abs() >= LATE_S && seconds.abs() > LATE_STD * std && seconds.abs() > LATE_STEPS * step_s;
    if joints.len() < all.min(2) || !late {
        return None;
    }
    let ms = 1e3 * seconds.abs();
    let which = if *seconds > 0.0 { "behind" } else { "ahead of" };
    Some(Distrust {
        log: None,
        joint: None,
        name: "torque_late",
        text: format!(
            "torque is {ms:.1} +- {:.1} ms (one std) {which} position on {}: rotors and viscous friction trade by it. No key of the robot \
             file moves it: log torque and position of one instant, or move the torque columns by so much; `rivet diagnose` does so by \
             itself where torque is late",
            1e3 * std,
            named(names, joints)
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn delays(ms: &[(f64, f64)]) -> Vec<Delay> {
        ms.iter().map(|(ms, std)| Delay { seconds: 1e-3 * ms, std: 1e-3 * std, doubt: None }).collect()
    }

    /// Shoulder and elbow carry links, the wrist mostly rubs.
    const DRY: [f64; 6] = [0.3, 0.2, 0.2, 0.4, 0.5, 0.5];

    fn told(delays: &[Delay], dry: &[f64], step_s: f64) -> Vec<(Option<String>, String)> {
        distrust(&names(), delays, dry, step_s).into_iter().map(|d| (d.joint, d.text)).collect()
    }

    fn names() -> Vec<String> {
        (1..=6).map(|j| format!("j{j}")).collect()
    }

    #[test]
    fn a_delay_of_one_joint_is_no_clock() {
        let friction = delays(&[(0.1, 0.2), (-7.5, 0.4), (0.3, 0.2)]);
        assert!(text(&names(), &friction, &DRY).contains("differs by joint: j2 is"));
        assert!(json(&friction, &DRY).iter().all(|d| d["value"].is_number()));
        assert_eq!(
            json(&friction, &DRY).iter().map(|d| d["doubt"].is_string()).collect::<Vec<_>>(),
            [false, true, false]
        );
        for clock in [&[(6.1, 0.3), (5.8, 0.4), (6.6, 0.2)][..], &[(3.8, 3.4), (-10.0, 7.1), (17.9, 5.2)]] {
            let text = text(&names(), &delays(clock), &DRY).split_whitespace().collect::<Vec<_>>().join(" ");
            assert!(!text.contains("differs by joint") && text.contains("friction at standstill"), "{text}");
            assert!(json(&delays(clock), &DRY).iter().all(|d| d.get("doubt").is_none()));
        }
    }

    /// Two joints on either side of what all have agree with it, if not with each other.
    #[test]
    fn joints_are_compared_with_what_they_have_in_common() {
        let sides = delays(&[(2.3, 0.1), (4.0, 0.2), (4.1, 0.2), (5.9, 0.1)]);
        assert!(!text(&names(), &sides, &DRY).contains("differs by joint"));
        assert!((common(&sides, &[0.2; 4]).expect("one").seconds - 4.075e-3).abs() < 1e-4);
    }

    #[test]
    fn torque_further_off_than_was_looked_is_warned_of_most() {
        let mut far = delays(&[(0.0, 0.2); 6]);
        let beyond = |delays: &mut [Delay]| delays.iter_mut().for_each(|d| d.doubt = Some(DelayDoubt::OutOfReach));
        beyond(&mut far[..2]);
        assert_eq!(told(&far, &DRY, 1e-3), []);
        beyond(&mut far[..3]);
        let (joint, text) = told(&far, &DRY, 1e-3).pop().expect("a warning");
        assert!(joint.is_none() && text.contains("j1, j2, j3") && text.contains("120 ms"), "{text}");
    }

    #[test]
    fn a_delay_that_most_joints_have_is_told_and_uncertain_ones_are_none() {
        let of = |ms: &[(f64, f64)]| told(&delays(ms), &DRY, 1e-3).pop().map(|(_, text)| text);
        let late = of(&[(4.0, 0.3), (4.0, 0.4), (3.0, 0.3), (3.2, 0.2), (2.0, 0.3), (-0.4, 0.2)]).expect("late");
        assert!(late.contains("behind position on j1, j2, j3, j4, j5, j6:"), "{late}");
        let early = of(&[(-5.0, 0.3), (-5.2, 0.2)]).expect("early");
        assert!(early.contains("5.1 +- 0.6 ms (one std) ahead of position"), "{early}");
        assert_eq!(of(&[(0.5, 0.1), (-0.4, 0.2), (4.2, 0.6)]), None);
        // As the UR10e was measured.
        assert_eq!(of(&[(3.8, 3.2), (-7.6, 7.7), (-9.9, 6.8), (6.1, 5.1), (17.0, 8.4), (13.3, 8.2)]), None);
        assert_eq!(of(&[]), None);
    }

    /// As a sound Manutec was read at 50 Hz, and one whose joint 2 was 20 ms late at 1 kHz.
    #[test]
    fn a_part_of_a_step_is_no_delay_and_one_late_channel_is_warned_of() {
        let slow = delays(&[(-2.6, 0.4), (-3.2, 0.4), (-3.5, 0.6), (2.1, 0.9), (-1.0, 0.5), (-1.5, 4.5)]);
        assert!(told(&slow, &DRY, 0.02).is_empty());
        assert_eq!(told(&slow, &DRY, 1e-3).len(), 1, "at 1 kHz it would be one");
        let channel = delays(&[(0.0, 0.2), (20.1, 0.9), (-0.3, 0.2), (-5.4, 2.0), (-1.5, 1.7), (4.6, 3.0)]);
        let found = told(&channel, &DRY, 1e-3);
        let [(Some(joint), text)] = found.as_slice() else { panic!("{found:?}") };
        assert!(joint == "j2" && text.contains("behind position, where"), "{joint}: {text}");
        assert!(told(&channel, &DRY, 0.1).is_empty(), "a fifth of a step");
        let lacking = delays(&[(-1.6, 1.2), (-14.2, 2.1), (-8.6, 7.3), (-0.4, 2.5), (-0.5, 0.2), (-0.4, 0.3)]);
        assert!(told(&lacking, &DRY, 1e-3).is_empty(), "as a practice case was read");
    }

    /// As simulated arms with friction that sticks were read: sound, and 3 and 6 ms late. Their wrists are not to be blamed.
    #[test]
    fn wrists_that_stick_neither_hide_a_clock_nor_make_one() {
        let dry = [0.41, 0.28, 0.69, 0.60, 1.0, 0.91];
        let sound = [(-0.1, 0.05), (-0.1, 0.05), (0.3, 0.1), (3.3, 0.5), (7.2, 0.7), (5.4, 0.3)];
        let late3 = [(2.8, 0.2), (2.5, 0.2), (3.3, 0.4), (6.5, 0.4), (9.7, 0.6), (8.4, 0.3)];
        let late6 = [(5.8, 0.3), (5.7, 0.3), (6.3, 0.4), (9.4, 0.4), (13.4, 0.7), (11.9, 0.3)];
        assert!(told(&delays(&sound), &dry, 1e-3).is_empty());
        for (ms, late) in [(3.0, &late3), (6.0, &late6)] {
            let found = common(&delays(late), &dry).expect("one");
            assert!((1e3 * found.seconds - ms).abs() < 1.0 && found.others.is_empty(), "{}", found.seconds);
            assert_eq!(told(&delays(late), &dry, 1e-3).len(), 1);
        }
    }
}
