//! What happens when joint states stop.

mod common;

use common::rig::{Rig, Wrong};
use common::{Moving, core, largest_step, robot, robot_with};
use rivet_controller::Core;
use rivet_ipc_schema::{Command, ControllerHealth, ControllerState, StopCause};

fn stopping(core: &Core) -> bool {
    let mut health = ControllerHealth::default();
    core.write_health(&mut health);
    ControllerState::try_from(health.state) == Ok(ControllerState::Stopping)
}

/// Two seconds of motion, then nothing for `periods` periods.
fn run_dry(reaction: &str, periods: u64) -> (rivet_config::Robot, Core, Vec<Command>, Vec<Command>) {
    let words = format!("[controller]\nstop_reaction = \"{reaction}\"\nstop_time_s = 0.1\nstale_periods = 5\n");
    let robot = robot_with("manutec-r3", &[("[controller]\n", &words)]);
    let mut core = core(&robot);
    let moved = Moving::new(&robot, &robot.nominal_base).run(&mut core, 2000, |_, _| ());
    let stopped: Vec<Command> = (1..=periods).filter_map(|k| core.missing(k)).collect();
    (robot, core, moved, stopped)
}

#[test]
fn the_reaction_begins_in_the_configured_period_and_steps_no_faster_than_the_rate() {
    for reaction in ["hold", "ramp", "damp"] {
        let (robot, core, moved, stopped) = run_dry(reaction, 400);
        assert_eq!(stopped.len(), 396, "{reaction}: from the fifth missing period on, one command each");
        assert!(stopping(&core));
        assert_eq!(core.counts().stops, 1);
        assert!(stopped.iter().all(|c| c.seq == 2000), "they answer the last sample");
        let all: Vec<_> = [moved[1999]].into_iter().chain(stopped.iter().copied()).collect();
        assert!(largest_step(&robot, &all) <= 1.0 + 1e-9, "{reaction}");
        assert_ne!(stopped[0].tau, moved[1999].tau, "{reaction} acts at once");
        assert_eq!(stopped[395].tau, stopped[394].tau, "{reaction} comes to rest");
    }
}

/// A robot controller that hangs and sends its last sample again and again: nothing new is known of the arm, however often it
/// comes. (Numbers that go forward again are a new run.)
#[test]
fn a_sample_that_is_repeated_is_no_sample() {
    for (reaction, stale_periods) in [("ramp", 5), ("hold", 5), ("damp", 300)] {
        let words = format!(
            "[controller]\nstop_reaction = \"{reaction}\"\nstop_time_s = 0.1\nstale_periods = {stale_periods}\n"
        );
        let robot = robot_with("manutec-r3", &[("[controller]\n", &words)]);
        let mut core = core(&robot);
        let mut moving = Moving::new(&robot, &robot.nominal_base);
        moving.run(&mut core, 2000, |_, _| ());
        moving.seq = 1999;
        let (frozen, plan) = moving.next();
        let mut stopped = Vec::new();
        for k in 1..=1000 {
            core.offer_setpoint(&plan);
            assert!(core.tick(&frozen).is_err(), "{reaction}: repetition {k} is answered");
            stopped.extend(core.missing(k));
        }
        // Samples that are wrong are waited for less than samples that do not come.
        let waited = stale_periods.min(12);
        assert_eq!(stopped.len() as u64, 1001 - waited, "{reaction}");
        assert_eq!((core.counts().stops, stopping(&core)), (1, true), "{reaction}");
        if reaction == "ramp" {
            assert_eq!(stopped.last().expect("commands").tau, [0.0; 8]);
        }
        moving.seq = 0;
        let answered = (0..300).filter(|_| core.tick(&moving.next().0).is_ok()).count();
        assert!(answered >= 200, "a new run is taken up: {answered}");
    }
}

#[test]
fn before_the_first_sample_and_in_short_gaps_nothing_happens() {
    let robot = robot();
    let mut core = core(&robot);
    assert_eq!(core.missing(1000), None);
    let mut moving = Moving::new(&robot, &robot.nominal_base);
    moving.run(&mut core, 100, |_, _| ());
    assert!((1..10).all(|k| core.missing(k).is_none()), "stale_periods is 10");
    assert!(core.missing(10).is_some());
}

/// Ramp ends at zero; hold and damp end at the torque that carries the arm: hold at the last pose, damp a little further on.
#[test]
fn each_reaction_ends_where_it_should() {
    let (_, _, _, ramp) = run_dry("ramp", 400);
    assert_eq!(ramp.last().expect("commands").tau, [0.0; 8]);
    let (robot, _, _, hold) = run_dry("hold", 400);
    let (_, _, moved, damp) = run_dry("damp", 400);
    let mut still = core(&robot);
    // The fifth missing period: where the arm is then is reckoned.
    let (sample, _) = Moving { seq: 2004, ..Moving::new(&robot, &robot.nominal_base) }.next();
    let mut gravity = [0.0; 8];
    for seq in 1..=400 {
        gravity = still.tick(&rivet_ipc_schema::JointState { seq, ..sample }).expect("a sound sample").tau;
    }
    for j in 0..6 {
        let held = hold.last().expect("commands").tau[j];
        let limit = robot.config.drive.torque_limit[j];
        assert!((held - gravity[j]).abs() < 2e-3 * limit, "{held} against {}", gravity[j]);
    }
    // The first torque of damp brakes: it is further against the motion than that of the plan.
    let mut speed = sample.q;
    let before = Moving { seq: 1998, ..Moving::new(&robot, &robot.nominal_base) }.next().0;
    for j in 0..6 {
        speed[j] -= before.q[j];
        if speed[j].abs() > 5e-4 {
            assert!((damp[0].tau[j] - moved[1999].tau[j]) * speed[j] < 0.0, "joint {}", j + 1);
        }
    }
}

/// When samples come again the torque goes on from the last command, and a plan that is within reach is followed again after as many samples
/// as are configured, or when somebody asks.
#[test]
fn samples_that_come_again_are_answered_without_a_step() {
    for (resume_after, asked) in [("300", false), ("0", true)] {
        let words = format!("resume_after = {resume_after}\nstale_periods = 5\n");
        let mut rig = Rig::new("dd2", 0.001, &words, 0.2);
        let silent = rig.run(1.5, Wrong::Silence, 0.06, |_, _| ());
        assert_eq!(silent.stop.map(|(cause, ..)| cause), Some(StopCause::Silence));
        let resumed = |rig: &Rig| rig.core.counts().resumed;
        // The planner waits beside the arm.
        let mut beside = rig.position();
        beside[0] += 0.1;
        let wait = |rig: &mut Rig, seconds: f64| {
            rig.run(0.0, Wrong::Nothing, seconds, |_, plan| *plan = [beside, [0.0; 8], [0.0; 8]]);
        };
        wait(&mut rig, 0.299);
        assert_eq!(resumed(&rig), 0, "not before 300 samples");
        wait(&mut rig, 2.0);
        if asked {
            assert_eq!(resumed(&rig), 0, "only on request");
            rig.core.ask_to_follow();
            wait(&mut rig, 2.0);
        }
        assert!((rig.position()[0] - beside[0]).abs() < 0.02, "the arm has come to the plan");
        assert_eq!((resumed(&rig), rig.core.counts().stops), (1, 1), "resume_after = {resume_after}");
        assert!(rig.core.plan().is_some());
        assert!(rig.largest_step() <= 1.0 + 1e-9, "{}", rig.largest_step());
    }
}

/// However often the loop wakes in a period, the torque takes one step.
#[test]
fn a_missing_period_gets_one_command() {
    let robot = robot();
    let mut core = core(&robot);
    Moving::new(&robot, &robot.nominal_base).run(&mut core, 100, |_, _| ());
    let commands = (0..10).filter(|_| core.missing(12).is_some()).count();
    assert_eq!(commands, 1);
    assert!(core.missing(13).is_some());
}

/// The arm is stopped at several moments of a fast motion, with all readings or none.
#[test]
fn a_stop_at_any_moment_makes_no_joint_fast() {
    const MOMENTS: u32 = 6;
    let mut wrong = Vec::new();
    for (arm, period_s) in [("dd2", 0.004), ("dd2", 0.001), ("ur10e", 0.004), ("ur10e", 0.001)] {
        for fault in [Wrong::FaultBits, Wrong::Silence] {
            let (mut fastest, mut furthest) = (0.0_f64, 0.0_f64);
            for k in 0..MOMENTS {
                let mut rig = Rig::new(arm, period_s, "", 0.8);
                let o = rig.run(1.2 + 0.237 * f64::from(k), fault, 1.0, |_, _| ());
                (fastest, furthest) = (fastest.max(o.speed), furthest.max(o.away));
                if o.speed > 1.2 {
                    wrong.push(format!("{arm} {period_s} s, {fault:?}, moment {k}: {o:?}"));
                }
            }
            println!("{arm} {period_s} s, {fault:?}: at most {fastest:.2} times the speed limit, {furthest:.2} rad");
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
