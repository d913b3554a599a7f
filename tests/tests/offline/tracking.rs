//! What the controller gains from live parameters, on three arms: the table of `rivet study tracking`.

use rivet_config::Law;
use rivet_studies::tracking::{ARMS, tracking};
use rivet_tests::robot;

fn check(arm: &str, seed: u64, law: Law) {
    let mut robot = rivet_config::load(robot(arm)).expect("sound");
    robot.config.controller.law = law;
    let payload = ARMS.iter().find(|(name, _)| *name == arm).expect("an arm of the table").1;
    let table = tracking(&robot, payload, seed).expect("sound settings");
    println!("{table}");
    for errors in &table.phases {
        let (to_nominal, to_truth) = errors.ratios();
        assert!(to_nominal <= 0.25, "{arm}, {} kg: {to_nominal} of the error with nominal parameters", errors.payload);
        assert!(to_truth <= 1.15, "{arm}, {} kg: {to_truth} of the error with true parameters", errors.payload);
    }
    let farther = table.farther();
    assert!(farther <= 1.25, "{arm}: {farther} times as far from the plan as nominal parameters lead, while learning");
    assert_eq!(table.changes, 1, "{arm}: letting go of the payload is the one change");
}

#[test]
fn manutec_r3() {
    check("manutec-r3", 1, Law::ComputedTorque);
}

/// In 15 the first sets that predict well have an inertia matrix that is none at the poses that come next.
#[test]
fn manutec_r3_hard_to_begin_with() {
    check("manutec-r3", 15, Law::ComputedTorque);
}

#[test]
fn staubli_tx40() {
    // In 23 the wrist moves so that its friction is the last to be told apart: had a robot file that knows no friction
    // decided how quiet the joint is, it never would be.
    check("staubli-tx40", 23, Law::ComputedTorque);
}

#[test]
fn ur10e() {
    // Six has the direction that is hardest to learn anew when the payload is let go of.
    check("ur10e", 6, Law::ComputedTorque);
}

/// With the law for drives that close a loop of their own: what the plan needs, and constant gains.
#[test]
fn manutec_r3_with_feed_forward() {
    check("manutec-r3", 1, Law::FeedForwardPd);
}
