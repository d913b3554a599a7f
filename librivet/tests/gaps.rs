//! Samples that never reached the caller are a gap in the sequence.

mod common;

use common::{Bus, eventually};
use rivet::{Counters, Robot, Sample, Status};

#[test]
fn skipped_periods_are_a_gap_for_the_others_and_not_published() {
    let bus = Bus::new("gaps");
    let states = bus.join().joint_state_subscriber().expect("a port");
    let mut robot = Robot::open(bus.config(), common::ROBOT, 1).expect("the bus opens");
    let mut numbers = Vec::new();
    for missing in [0, 3, 0] {
        robot.skip(missing);
        assert_eq!(robot.publish(&Sample::default()), Status::Ok);
    }
    eventually("three samples", || {
        numbers.extend(std::iter::from_fn(|| states.receive().expect("received")).map(|state| state.seq));
        (numbers.len() == 3).then_some(())
    });
    assert_eq!(numbers, [1, 5, 6]);
    assert_eq!(robot.counters(), Counters { published: 3, sent: 3, ..Counters::default() });
}
