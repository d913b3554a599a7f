//! The stand-in's decisions without a bus: which commands act, when the brakes close.

use crate::common::{ideal, pendulum, truth};
use rivet_ipc_schema::{Command, CommandMode, MAX_JOINTS};
use rivet_simulation::motion::{Governor, Standstill};
use rivet_simulation::{BUILD_UP_S, Plant, PlantSettings, Sensors, StandIn};

const STALE: u64 = 4;

fn stand_in() -> StandIn {
    let (model, mut joints) = ideal(pendulum());
    joints.coulomb[0] = 20.0; // more than gravity: the arm stands also without torque
    let plant = Plant::new(&truth(&model, &joints), &Sensors::perfect(1), &PlantSettings::new(0.001, &[100.0]), 1);
    StandIn::new(plant, Governor::new(Box::new(Standstill { pose: vec![0.3] })), 0.001, STALE, 1)
}

/// Answers every sample with `tau` until the brakes open; returns in how many periods.
fn build_up(arm: &mut StandIn, tau: f64) -> u64 {
    for periods in 1..1000 {
        let seq = arm.latch().seq;
        arm.advance(Some(&command(seq, tau)));
        if !arm.braked() {
            return periods;
        }
    }
    panic!("the brakes stay closed");
}

fn command(seq: u64, tau: f64) -> Command {
    let mut all = [0.0; MAX_JOINTS];
    all[0] = tau;
    Command { seq, tau: all, joints: 1, mode: CommandMode::Nominal.into(), ..Command::default() }
}

#[test]
fn the_brakes_open_once_commands_have_come_for_a_while() {
    let mut arm = stand_in();
    for seq in 1..=3 {
        let sample = arm.latch();
        assert_eq!((sample.seq, sample.braked, sample.q[0]), (seq, true, 0.3));
        arm.advance(None);
    }
    let while_s = build_up(&mut arm, 7.0) as f64 * 0.001;
    assert!((while_s - BUILD_UP_S).abs() < 0.0015, "opened after {while_s} s");
    assert_eq!(arm.counts().moving, 0, "the period of the release was published as braked");
    let sample = arm.latch();
    assert_eq!((sample.braked, sample.tau[0]), (false, 7.0));
    arm.advance(Some(&command(sample.seq, 8.0)));
    assert_eq!((arm.counts().moving, arm.counts().late_commands), (1, 0));
}

/// An interruption while the torque builds up starts the wait anew.
#[test]
fn commands_must_come_without_a_gap() {
    let mut arm = stand_in();
    for _ in 0..150 {
        let seq = arm.latch().seq;
        arm.advance(Some(&command(seq, 7.0)));
    }
    for _ in 0..STALE {
        arm.latch();
        arm.advance(None);
    }
    assert!(build_up(&mut arm, 7.0) as f64 * 0.001 > BUILD_UP_S - 0.0015);
}

#[test]
fn an_old_command_acts_as_late_until_it_is_stale() {
    let mut arm = stand_in();
    build_up(&mut arm, 5.0);
    let last = arm.latch().seq - 1;
    for late in 1..STALE {
        let sample = arm.latch();
        assert_eq!((sample.braked, sample.tau[0]), (false, 5.0), "{late} periods late");
        arm.advance(Some(&command(last, 5.0)));
    }
    assert_eq!((arm.counts().late_commands, arm.counts().brake_engagements), (STALE - 1, 0));
    assert!(!arm.latch().braked);
    arm.advance(Some(&command(last, 5.0)));
    let sample = arm.latch();
    assert_eq!((sample.braked, sample.tau[0]), (true, 0.0), "the drives of a braked arm are off");
    assert_eq!(arm.counts().brake_engagements, 1);
    build_up(&mut arm, 6.0);
    assert!(!arm.latch().braked, "fresh commands open them again");
}

#[test]
fn unsound_commands_do_not_act() {
    let mut arm = stand_in();
    let seq = arm.latch().seq;
    let mut wrong_count = command(seq, 1.0);
    wrong_count.joints = 6;
    for unsound in [wrong_count, command(seq, f64::NAN), command(seq + 100, 1.0)] {
        arm.advance(Some(&unsound));
        assert!(arm.latch().braked, "{unsound:?}");
    }
    assert_eq!(arm.counts().refused_commands, 3);
    let now = arm.latch().seq;
    arm.advance(Some(&Command { mode: CommandMode::None.into(), ..command(now, 1.0) }));
    assert!(arm.latch().braked, "no torque is asked for: the robot's own control is the brake");
    assert_eq!(arm.counts().refused_commands, 3, "which is no mistake");
}

#[test]
fn tracking_is_summed_in_blocks() {
    let mut arm = stand_in();
    let braked = build_up(&mut arm, 0.0);
    for _ in 0..5301 {
        let seq = arm.latch().seq;
        let identified = seq > braked + 2500;
        let mode = if identified { CommandMode::Identified } else { CommandMode::Nominal };
        arm.advance(Some(&Command { mode: mode.into(), ..command(seq, 0.0) }));
    }
    let (blocks, saturated) = arm.finish();
    let spans: Vec<[f64; 2]> = blocks.iter().map(|b| [b.from_s, b.to_s].map(|t| (t * 1e3).round())).collect();
    assert_eq!(spans, [[0.0, 5000.0], [5000.0, 5301.0]]);
    assert_eq!((blocks[0].identified_share, blocks[1].identified_share), (0.5, 1.0));
    assert_eq!((blocks[0].rms.clone(), saturated), (vec![0.0], vec![0]));
}
