//! Faults on the input, one test each: named in health, got over in a stated time, and no parameter moved by more than its
//! stated standard deviation. Then all of them mixed, a million periods long.

mod bench;
mod soak;

use bench::{Arm, Fault, Spoiler, health, parameters, sigmas};
use rivet_daemon::Core;
use rivet_ipc_schema::{DaemonMode, InputFault};

/// Period at which faults begin: the window is full.
const BEGIN: u64 = 12_000;
/// Periods looked at after a fault.
const AFTER: u64 = 6_000;

/// What became of one fault.
#[derive(Debug)]
struct Outcome {
    /// Times it was met.
    count: u64,
    /// Share of the fault's samples after which health showed it.
    shown: f64,
    /// From the last faulty sample on \[s\].
    recovery_s: f64,
    /// Largest difference to the undisturbed estimate once it was over, and to one that merely lost the samples \[its standard
    /// deviations\].
    worst: f64,
    worst_to_lost: f64,
    mode_after: DaemonMode,
}

fn suffer(fault: Fault, lasting: u64, named: InputFault) -> Outcome {
    let mut arm = Arm::new(7);
    let [mut whole, mut lost, mut core] = [(); 3].map(|()| Core::new(&arm.robot).expect("sound settings"));
    let mut spoiler = Spoiler::new(&arm.robot);
    let (mut shown, mut worst, mut worst_to_lost) = (0_u64, 0.0_f64, 0.0_f64);
    for k in 1..BEGIN + lasting + AFTER {
        let (state, setpoint) = arm.at(k);
        whole.tick(&state, Some(&setpoint));
        let now = (BEGIN..BEGIN + lasting).contains(&k).then_some(fault);
        if now.is_none() {
            lost.tick(&state, Some(&setpoint));
        }
        for (state, setpoint) in spoiler.pass(now, state, setpoint) {
            core.tick(&state, Some(&setpoint));
        }
        let seen = health(&core);
        if now.is_some() {
            let bits = [seen.input_fault, seen.last_input_fault];
            shown += u64::from(bits.contains(&named.into()));
        } else if k > BEGIN && core.input_fault() == InputFault::None && k % 20 == 0 {
            worst = worst.max(sigmas(&parameters(&core), &parameters(&whole)));
            worst_to_lost = worst_to_lost.max(sigmas(&parameters(&core), &parameters(&lost)));
        }
    }
    let outcome = Outcome {
        count: core.fault_count(named),
        shown: shown as f64 / lasting as f64,
        recovery_s: core.recovery_s().unwrap_or(0.0),
        worst,
        worst_to_lost,
        mode_after: DaemonMode::try_from(health(&core).mode).expect("a known mode"),
    };
    println!("{fault:?} for {lasting} ms: {outcome:?}");
    outcome
}

impl Outcome {
    /// The daemon estimates again in the time that differentiator and model filter need, and no parameter is off by more than
    /// its standard deviation. After faults of more than a fifth of the window that is reckoned from the run that lost the
    /// same samples: what is missing then moves estimates by as much as they may be wrong.
    fn is_harmless(&self, recovery_s: f64) {
        assert!(self.count > 0, "never named: {self:?}");
        assert!(self.worst.min(self.worst_to_lost) <= 1.0, "harmed: {self:?}");
        assert!(self.worst <= 1.5, "harmed: {self:?}");
        assert!(self.recovery_s <= recovery_s, "slow: {self:?}");
        assert_eq!(self.mode_after, DaemonMode::Estimating, "{self:?}");
    }
}

/// Time in which differentiator and model filter fill \[s\].
const SETTLED_S: f64 = 0.12;

#[test]
fn dropped() {
    for lasting in [1, 30, 500] {
        let outcome = suffer(Fault::Dropped, lasting, InputFault::Lost);
        outcome.is_harmless(SETTLED_S);
        assert_eq!(outcome.count, lasting);
    }
}

#[test]
fn duplicated() {
    let outcome = suffer(Fault::Duplicated, 500, InputFault::Duplicate);
    outcome.is_harmless(0.0);
    assert_eq!((outcome.count, outcome.shown), (500, 1.0));
    assert_eq!(outcome.worst, 0.0, "bit for bit as without");
}

#[test]
fn reordered() {
    let outcome = suffer(Fault::Reordered, 500, InputFault::Reordered);
    outcome.is_harmless(SETTLED_S);
    assert_eq!(outcome.count, 250);
}

#[test]
fn frozen() {
    for lasting in [20, 500] {
        let outcome = suffer(Fault::Frozen, lasting, InputFault::Frozen);
        outcome.is_harmless(SETTLED_S);
        assert!(outcome.shown > 0.75, "{outcome:?}");
        suffer(Fault::FrozenJoint, lasting, InputFault::Frozen).is_harmless(SETTLED_S);
    }
}

#[test]
fn not_finite() {
    let outcome = suffer(Fault::NotFinite, 500, InputFault::NotFinite);
    outcome.is_harmless(SETTLED_S);
    assert_eq!((outcome.count, outcome.shown), (500, 1.0));
}

#[test]
fn saturated() {
    let outcome = suffer(Fault::Saturated, 500, InputFault::Saturated);
    outcome.is_harmless(SETTLED_S);
    assert!(outcome.shown > 0.99);
}

#[test]
fn sign_flipped() {
    for lasting in [300, 2000] {
        let outcome = suffer(Fault::SignFlipped, lasting, InputFault::SignFlipped);
        outcome.is_harmless(SETTLED_S);
    }
}

#[test]
fn time_jumping() {
    let outcome = suffer(Fault::TimeJump, 500, InputFault::TimeJump);
    outcome.is_harmless(0.0);
    assert_eq!((outcome.count, outcome.worst), (1, 0.0), "the signals know only sequence numbers");
}

#[test]
fn encoder_jump() {
    for lasting in [1, 20, 500, 2000] {
        let outcome = suffer(Fault::EncoderJump, lasting, InputFault::EncoderJump);
        outcome.is_harmless(SETTLED_S);
        assert_eq!(outcome.shown, 1.0);
    }
}

#[test]
fn torque_stuck() {
    for lasting in [300, 2000] {
        suffer(Fault::TorqueStuck, lasting, InputFault::TorqueStuck).is_harmless(SETTLED_S);
    }
}

/// Before a model is known nothing can be missed: a torque that stands from the first sample on, or from when the joint has moved for a while.
#[test]
fn torque_stuck_before_anything_is_known() {
    for (from, lasting) in [(1, 300), (1, 2_000), (500, 300)] {
        let mut arm = Arm::new(7);
        let [mut whole, mut core] = [(); 2].map(|()| Core::new(&arm.robot).expect("sound settings"));
        let (mut held, mut worst) = (0.0, 0.0_f64);
        for k in 1..BEGIN {
            let (mut state, setpoint) = arm.at(k);
            whole.tick(&state, Some(&setpoint));
            if k == from {
                held = state.tau[1];
            }
            if (from..from + lasting).contains(&k) {
                state.tau[1] = held;
            }
            core.tick(&state, Some(&setpoint));
            if k > BEGIN - 500 {
                worst = worst.max(sigmas(&parameters(&core), &parameters(&whole)));
            }
        }
        let stuck = core.fault_count(InputFault::TorqueStuck);
        println!("from {from} for {lasting}: stuck {stuck}, {worst:.2} deviations from the run that was not");
        assert!(stuck > 0 && worst <= 1.0, "from {from} for {lasting}: {stuck}, {worst}");
    }
}

/// A channel that stands for a moment again and again is doubted all the time, so nothing is learnt from the arm: that is told after a while,
/// and not before.
#[test]
fn torque_that_stands_again_and_again_is_told() {
    let mut arm = Arm::new(7);
    let mut core = Core::new(&arm.robot).expect("sound settings");
    let (mut held, mut told_at) = (0.0, None);
    let from = BEGIN;
    for k in 1..from + 10_000 {
        let (mut state, setpoint) = arm.at(k);
        if k > from {
            if (k - from) % 100 == 1 {
                held = state.tau[1];
            }
            if (k - from) % 100 <= 30 {
                state.tau[1] = held;
            }
        }
        core.tick(&state, Some(&setpoint));
        if told_at.is_none() && core.fault_count(InputFault::TorqueStuck) > 0 {
            told_at = Some(k);
        }
    }
    let after = told_at.expect("it is told") as f64 - from as f64;
    println!("told after {after} samples of it, {} in all", core.fault_count(InputFault::TorqueStuck));
    assert!((4_000.0..7_000.0).contains(&after), "{after}");
}

/// Torque in steps that its noise does not blur stands for tens of samples and is learnt from; where it is stuck, that is seen, and does
/// no more harm than a step is worth.
#[test]
fn torque_in_coarse_steps() {
    let mut arm = Arm::new(7);
    let [mut fine, mut whole, mut core] = [(); 3].map(|()| Core::new(&arm.robot).expect("sound settings"));
    let mut spoiler = Spoiler::new(&arm.robot);
    let (mut longest, mut run, mut before, mut worst) = (0, 0, 0.0, 0.0_f64);
    let (step, lasting) = (0.2, 2_000);
    for k in 1..BEGIN + lasting + AFTER {
        let (mut state, setpoint) = arm.at(k);
        fine.tick(&state, Some(&setpoint));
        state.tau[1] = (state.tau[1] / step).round() * step;
        run = if state.tau[1] == before { run + 1 } else { 0 };
        before = state.tau[1];
        longest = longest.max(run);
        whole.tick(&state, Some(&setpoint));
        let now = (BEGIN..BEGIN + lasting).contains(&k).then_some(Fault::TorqueStuck);
        for (state, setpoint) in spoiler.pass(now, state, setpoint) {
            core.tick(&state, Some(&setpoint));
        }
        if k == BEGIN - 1 {
            let counts = core.counts();
            let doubted = [counts.doubted, fine.counts().doubted];
            println!("{longest} equal torques at most; rows doubted in steps and without: {doubted:?}");
            assert!(longest > 30, "steps that matter: {longest}");
            // A torque of friction alone changes its sign at once where the joint turns.
            assert!(doubted[0] <= doubted[1], "{doubted:?}");
            assert_eq!(core.fault_count(InputFault::TorqueStuck), 0);
        } else if k > BEGIN + lasting && core.input_fault() == InputFault::None && k % 20 == 0 {
            worst = worst.max(sigmas(&parameters(&core), &parameters(&whole)));
        }
    }
    let stuck = core.fault_count(InputFault::TorqueStuck);
    println!("stuck {stuck} of {lasting} samples, {worst:.2} deviations from the run that was not");
    assert!(stuck > lasting / 2 && worst <= 1.5, "{stuck} {worst}");
    assert_eq!(whole.fault_count(InputFault::TorqueStuck), 0);
}

#[test]
fn publisher_restarted() {
    let outcome = suffer(Fault::PublisherRestarted, 500, InputFault::PublisherRestarted);
    outcome.is_harmless(SETTLED_S);
    assert_eq!(outcome.count, 1);
}

/// The machine is suspended for ten seconds: sequence numbers and stamps go on as if nothing had been, the arm is elsewhere.
/// The shell tells the core what the clocks said.
#[test]
fn clock_suspended() {
    let mut arm = Arm::new(7);
    let [mut lost, mut core] = [(); 2].map(|()| Core::new(&arm.robot).expect("sound settings"));
    let mut worst = 0.0_f64;
    for k in 1..BEGIN + 10_000 + AFTER {
        let (mut state, mut setpoint) = arm.at(k);
        if (BEGIN..BEGIN + 10_000).contains(&k) {
            continue;
        }
        lost.tick(&state, Some(&setpoint));
        if k == BEGIN + 10_000 {
            core.note(InputFault::ClockSuspended, 1);
            assert_eq!(core.input_fault(), InputFault::ClockSuspended);
        }
        if k >= BEGIN + 10_000 {
            (state.seq, setpoint.seq) = (k - 10_000, k - 10_000);
            state.stamp_ns -= 10_000_000_000;
        }
        core.tick(&state, Some(&setpoint));
        if k > BEGIN + 10_000 && core.input_fault() == InputFault::None && k % 20 == 0 {
            worst = worst.max(sigmas(&parameters(&core), &parameters(&lost)));
        }
    }
    assert_eq!((core.fault_count(InputFault::ClockSuspended), core.changes()), (1, 0));
    assert!(core.recovery_s().expect("it is over") <= SETTLED_S);
    // Ten seconds are two windows: what they would have told is missing. The other run misses them too, and knows it from the
    // sequence numbers.
    assert!(worst <= 1.0, "{worst}");
}

#[test]
fn robot_fault() {
    let outcome = suffer(Fault::Flagged, 500, InputFault::RobotFault);
    outcome.is_harmless(SETTLED_S);
    assert_eq!((outcome.count, outcome.shown), (500, 1.0));
}
