//! Every fault ends in the stop reaction: a true arm, in motion, whose joint states, drives or plan go wrong.
//!
//! The arm has no brakes, and its planner goes on as if nothing had happened: only the controller's torque stops it.

mod common;

use common::rig::{Motion, Outcome, Rig, Swing, Values, Wrong, friction, load, unchecked};
use rivet_ipc_schema::StopCause;

/// Sample periods \[s\].
const PERIODS: [f64; 2] = [0.004, 0.001];
/// Largest speed of the plan, in parts of the joints' limits.
const SHARE: f64 = 0.4;
/// Time for which the arm is observed after a fault \[s\]: rest has to last.
const AFTER_S: f64 = 4.0;
/// Bounds of the issue: speed in parts of the joint's limit, distance from the plan \[rad\], time until the stop reaction \[s\].
const MOST_SPEED: f64 = 1.2;
const MOST_AWAY: f64 = 0.3;
const MOST_DELAY_S: f64 = 0.0201;
/// An arm is at rest below this \[rad/s\]: less than a thousandth of the joints' limits.
const REST: f64 = 0.01;
/// Way that it may still go from a second after the stop on \[rad\].
const MOST_LATER: f64 = 0.05;

/// Arm, its joints that go wrong, and the seconds of sound motion before: several phases of it.
type Arm = (&'static str, &'static [usize], &'static [f64]);
const ARMS: [Arm; 2] = [("dd2", &[0, 1], &[1.3, 1.5, 1.7, 2.0]), ("ur10e", &[0, 1, 3, 5], &[1.8])];

fn is_harmless(o: &Outcome) -> bool {
    o.speed <= MOST_SPEED && o.away <= MOST_AWAY && o.rest <= REST && o.later_way <= MOST_LATER
}

fn holds(name: &str, o: &Outcome, causes: &[StopCause]) {
    let (cause, _, delay_s) = o.stop.unwrap_or_else(|| panic!("{name}: never stopped, {o:?}"));
    println!("{name}: {cause:?} after {:.0} ms, speed {:.2}, away {:.3} rad", 1e3 * delay_s, o.speed, o.away);
    assert!(causes.contains(&cause), "{name}: {o:?}");
    assert!(delay_s <= MOST_DELAY_S, "{name}: {o:?}");
    assert!(is_harmless(o), "{name}: {o:?}");
}

/// Runs a fault on both arms, at both rates, in every phase.
fn check(wrong: &[Wrong], causes: &[StopCause]) {
    for (arm, _, phases) in ARMS {
        for period_s in PERIODS {
            for &wrong in wrong {
                for &sound_s in phases {
                    let o = Rig::new(arm, period_s, "", SHARE).run(sound_s, wrong, AFTER_S, |_, _| ());
                    holds(&format!("{arm} {period_s} s {wrong:?} after {sound_s} s"), &o, causes);
                }
            }
        }
    }
}

/// The same for a fault of each joint.
fn check_joints(wrong: impl Fn(usize) -> Wrong, causes: &[StopCause]) {
    for (arm, joints, phases) in ARMS {
        for period_s in PERIODS {
            for &joint in joints {
                for &sound_s in phases {
                    let wrong = wrong(joint);
                    let o = Rig::new(arm, period_s, "", SHARE).run(sound_s, wrong, AFTER_S, |_, _| ());
                    let name = format!("{arm} {period_s} s {wrong:?} after {sound_s} s");
                    holds(&name, &o, causes);
                    let joints = o.stop.map_or(0, |(_, joints, _)| joints);
                    assert!(joints == 0 || joints >> joint & 1 == 1, "{name}: {o:?}");
                }
            }
        }
    }
}

#[test]
fn a_sound_run_is_not_stopped() {
    for (arm, ..) in ARMS {
        for period_s in PERIODS {
            for share in [0.1, 0.4, 0.6] {
                // The run asserts it while it is sound.
                Rig::new(arm, period_s, "", share).run(5.0, Wrong::Nothing, 0.1, |_, _| ());
            }
        }
    }
}

/// Friction and load of no file: joints that rest longer and go later than planned are sound.
#[test]
fn a_sound_arm_that_is_not_that_of_its_file_is_not_stopped() {
    for (arm, ..) in ARMS {
        let most = if arm == "dd2" { 1.0 } else { 5.0 };
        for period_s in PERIODS {
            for share in [0.02, 0.1, 0.4] {
                for factor in [0.5, 1.0, 2.5] {
                    for mass in [0.0, most] {
                        let rig = Rig::new(arm, period_s, "", share);
                        let mut rig = rig.differing(|physics| {
                            friction(physics, factor);
                            load(physics, mass);
                        });
                        println!("{arm} {period_s} s, {share} of the speed, friction times {factor}, {mass} kg");
                        let o = rig.run(8.0, Wrong::Nothing, 0.1, |_, _| ());
                        assert_eq!(o.stops, 0, "{o:?}");
                    }
                }
            }
        }
    }
}

/// Coarse encoders, steps \[rad\], and ones that are read less often than samples are sent \[s\].
const ENCODERS: [(f64, f64); 6] = [(3e-4, 0.0), (8e-4, 0.0), (1.5e-3, 0.0), (0.0, 0.002), (0.0, 0.004), (0.0, 0.008)];

#[test]
fn coarse_encoders_and_ones_that_are_read_seldom_are_sound() {
    for (arm, ..) in ARMS {
        for period_s in PERIODS {
            for share in [0.02, 0.1, 0.4] {
                for (step, read_s) in ENCODERS {
                    // At 1 kHz steps of 1.5 mrad make this arm's torque chatter at its rate limit (docs/realtime.md).
                    if step > 1e-3 && arm == "ur10e" && period_s < 0.004 && share > 0.02 {
                        continue;
                    }
                    println!("{arm} {period_s} s, {share} of the speed, steps of {step} rad, read every {read_s} s");
                    let mut robot = Rig::new(arm, period_s, "", share).robot;
                    if step > 0.0 {
                        robot.config.drive.encoder_resolution.fill(step);
                    }
                    let motion = Motion::Swing(Swing::new(&robot, share));
                    let mut rig = Rig::of(robot, motion);
                    rig.refresh = (read_s / period_s).round().max(1.0) as u64;
                    let o = rig.run(5.0, Wrong::Nothing, 0.1, |_, _| ());
                    assert!(o.stops == 0 && o.away < 0.05, "{o:?}");
                }
            }
        }
    }
}

/// The law alone, on the same arm with the same faults, does harm: the arm does not stop by itself.
#[test]
fn without_the_checks_faults_do_harm() {
    for (name, wrong) in [
        ("all frozen", Wrong::AllFrozen),
        ("one frozen", Wrong::Frozen(0)),
        ("backwards", Wrong::Backwards(0)),
        ("negative", Wrong::Negative(1)),
        ("late", Wrong::Late(0.1)),
        ("a jump", Wrong::Jump(1, 0.5)),
        ("silence", Wrong::Silence),
    ] {
        let mut rig = Rig::new("dd2", 0.004, "", SHARE);
        let o = unchecked(&mut rig, 2.0, wrong, AFTER_S);
        println!("{name}: speed {:.2}, away {:.2} rad, {:.2} rad/s at the end", o.speed, o.away, o.rest);
        assert!(!is_harmless(&o), "{name}: {o:?}");
    }
}

/// The arm is held where it is; that is no stop.
#[test]
fn without_a_plan_a_moving_arm_comes_to_rest() {
    for (arm, _, phases) in ARMS {
        for period_s in PERIODS {
            for &sound_s in phases {
                let mut rig = Rig::new(arm, period_s, "", SHARE);
                let begun = rig.planned(sound_s);
                let o = rig.run(sound_s, Wrong::Planless, AFTER_S, |_, _| ());
                let away = rig.position().iter().zip(&begun).map(|(q, then)| (q - then).abs()).fold(0.0, f64::max);
                println!("{arm} {period_s} s after {sound_s} s: {o:?}, {away:.3} rad on");
                // Full feedback at 250 Hz keeps the gears of this arm in a small swing.
                let rest = if period_s > 0.001 { 3.0 * REST } else { REST };
                assert!(o.speed <= MOST_SPEED && o.rest <= rest && away <= MOST_AWAY && o.stops == 0, "{o:?}");
            }
        }
    }
}

#[test]
fn silence_is_stopped() {
    check(&[Wrong::Silence], &[StopCause::Silence]);
}

#[test]
fn samples_that_are_repeated_are_stopped() {
    check(&[Wrong::Repeated], &[StopCause::OldSamples]);
}

#[test]
fn joint_states_that_freeze_while_their_number_runs_on_are_stopped() {
    check(&[Wrong::AllFrozen], &[StopCause::Frozen, StopCause::NoResponse, StopCause::TorqueStuck]);
}

#[test]
fn late_positions_are_stopped() {
    // What jumps, turns round or stands depends on the phase of the motion.
    let causes = [StopCause::EncoderJump, StopCause::NoResponse, StopCause::TooFast, StopCause::Frozen];
    check(&[Wrong::Late(0.1), Wrong::Late(0.03)], &causes);
}

#[test]
fn joint_states_that_say_they_are_wrong_are_stopped() {
    check(&[Wrong::Shape], &[StopCause::WrongShape]);
    check(&[Wrong::FaultBits], &[StopCause::RobotFault]);
}

#[test]
fn numbers_of_no_arm_are_stopped() {
    check_joints(Wrong::NotFinite, &[StopCause::NotFinite]);
    check_joints(Wrong::Implausible, &[StopCause::Implausible]);
}

/// At a turning point nothing shows until the joint has moved: time counts from the first reading that is visibly wrong.
fn check_from_visible(wrong: impl Fn(usize) -> Wrong, causes: &[StopCause]) {
    for (arm, joints, phases) in ARMS {
        for period_s in PERIODS {
            for &joint in joints {
                for &sound_s in phases {
                    let wrong = wrong(joint);
                    let mut o = Rig::new(arm, period_s, "", SHARE).run(sound_s, wrong, AFTER_S, |_, _| ());
                    let name =
                        format!("{arm} {period_s} s {wrong:?} after {sound_s} s, wrong at {:.0} ms", 1e3 * o.visible_s);
                    o.stop = o.stop.map(|(cause, joints, delay_s)| (cause, joints, delay_s - o.visible_s));
                    holds(&name, &o, causes);
                }
            }
        }
    }
}

/// Phases of the motion at which encoders go wrong, beside the ones above; `RIVET_PHASES=40` for a sweep.
const FEW_PHASES: usize = 3;
/// Seconds of sound motion before the first of them, and the range that they are drawn from.
const EARLIEST_S: f64 = 1.0;
const RANGE_S: f64 = 5.0;

/// One encoder that goes wrong in any phase of the motion does no harm. In how many the stop comes within 20 ms is printed: where the joint
/// hardly moves, a wrong reading shows in nothing yet (`docs/realtime.md`).
#[test]
fn a_wrong_encoder_does_no_harm_in_any_phase() {
    let count = std::env::var("RIVET_PHASES").ok().and_then(|n| n.parse().ok()).unwrap_or(FEW_PHASES);
    let mut random = rivet_simulation::Random::stream(count as u64, 3);
    let mut delays = Vec::new();
    for (arm, joints, _) in ARMS {
        for period_s in PERIODS {
            for _ in 0..count {
                let sound_s = EARLIEST_S + random.uniform(0.0, RANGE_S);
                for &joint in joints {
                    for wrong in [Wrong::Frozen(joint), Wrong::Backwards(joint), Wrong::Negative(joint)] {
                        let o = Rig::new(arm, period_s, "", SHARE).run(sound_s, wrong, AFTER_S, |_, _| ());
                        let name = format!("{arm} {period_s} s {wrong:?} after {sound_s:.3} s");
                        assert!(is_harmless(&o), "{name}: {o:?}");
                        let Some((cause, _, delay_s)) = o.stop else {
                            assert!(o.visible_s.is_nan(), "{name}: never stopped, {o:?}");
                            continue;
                        };
                        // A stop before a reading is visibly wrong is not late.
                        let late_s = if o.visible_s.is_nan() { 0.0 } else { delay_s - o.visible_s };
                        delays.push((arm, period_s, late_s));
                        if late_s > MOST_DELAY_S {
                            println!("{name}: {cause:?} {:.0} ms after it shows, {o:?}", 1e3 * late_s);
                        }
                    }
                }
            }
        }
    }
    for (arm, ..) in ARMS {
        for period_s in PERIODS {
            let mut of: Vec<f64> = delays
                .iter()
                .filter(|(a, p, _)| *a == arm && *p == period_s)
                .map(|(.., late_s)| 1e3 * late_s)
                .collect();
            of.sort_by(f64::total_cmp);
            let within = of.iter().filter(|late| **late <= 1e3 * MOST_DELAY_S).count();
            let last = of.last().copied().unwrap_or(f64::NAN);
            println!("{arm} {period_s} s: {within} of {} within 20 ms, at most {last:.0} ms", of.len());
        }
    }
}

#[test]
fn one_frozen_encoder_is_stopped() {
    check_from_visible(Wrong::Frozen, &[StopCause::Frozen, StopCause::NoResponse]);
}

#[test]
fn a_frozen_encoder_that_flickers_is_stopped() {
    check_from_visible(Wrong::Flickers, &[StopCause::Frozen, StopCause::NoResponse]);
}

/// A robot controller that sends each sample twice: neither sound motion nor a frozen encoder looks otherwise.
#[test]
fn samples_that_come_twice_hide_nothing() {
    for (arm, joints, phases) in ARMS {
        for period_s in PERIODS {
            let doubled = || {
                let mut rig = Rig::new(arm, period_s, "", SHARE);
                rig.doubled = true;
                rig
            };
            let o = doubled().run(5.0, Wrong::Nothing, 0.1, |_, _| ());
            assert_eq!(o.stops, 0, "{arm} {period_s} s: {o:?}");
            for &joint in joints {
                let once = Rig::new(arm, period_s, "", SHARE).run(phases[0], Wrong::Frozen(joint), AFTER_S, |_, _| ());
                let twice = doubled().run(phases[0], Wrong::Frozen(joint), AFTER_S, |_, _| ());
                assert_eq!(once.stop, twice.stop, "{arm} {period_s} s, joint {joint}");
            }
        }
    }
}

#[test]
fn an_encoder_that_counts_backwards_is_stopped() {
    let causes = [StopCause::NoResponse, StopCause::EncoderJump, StopCause::TooFast];
    check_from_visible(Wrong::Backwards, &causes);
}

#[test]
fn an_encoder_with_the_other_sign_is_stopped() {
    let causes = [StopCause::NoResponse, StopCause::EncoderJump, StopCause::TooFast];
    check_joints(Wrong::Negative, &causes);
}

#[test]
fn an_encoder_that_jumps_is_stopped() {
    check_joints(|joint| Wrong::Jump(joint, 0.5), &[StopCause::EncoderJump]);
    let causes = [StopCause::EncoderJump, StopCause::NoResponse, StopCause::TooFast];
    check_joints(|joint| Wrong::Jump(joint, -0.03), &causes);
}

#[test]
fn measured_torques_that_are_stuck_are_stopped() {
    check_joints(Wrong::TorqueStuck, &[StopCause::TorqueStuck]);
    check_joints(Wrong::TorqueAtLimit, &[StopCause::TorqueStuck, StopCause::SignFlipped]);
}

/// A torque of the other sign shows where it is not about zero.
#[test]
fn measured_torques_of_the_other_sign_are_stopped() {
    for period_s in PERIODS {
        let o = Rig::new("ur10e", period_s, "", SHARE).run(1.8, Wrong::TorqueSign(1), AFTER_S, |_, _| ());
        holds(&format!("ur10e {period_s} s, torque of joint 2"), &o, &[StopCause::SignFlipped]);
    }
}

/// A drive that gives nothing is found as soon as its torque is missed; what stops the arm then is not that drive.
#[test]
fn a_joint_that_does_not_answer_is_stopped() {
    for period_s in PERIODS {
        for (arm, joint, sound_s) in [("dd2", 1, 1.3), ("dd2", 0, 1.3), ("ur10e", 1, 1.8)] {
            let o = Rig::new(arm, period_s, "", SHARE).run(sound_s, Wrong::Drive(joint, 0.0), AFTER_S, |_, _| ());
            let (cause, joints, delay_s) = o.stop.expect("stopped");
            println!("{arm} {period_s} s, drive of joint {}: {cause:?} after {:.0} ms", joint + 1, 1e3 * delay_s);
            assert_eq!((cause, joints), (StopCause::NoResponse, 1 << joint), "{o:?}");
        }
    }
}

/// Samples that are lost now and then neither end the checks nor look like a fault. It takes twice the time to find one.
#[test]
fn lost_samples_hide_no_fault() {
    for (arm, joints, phases) in ARMS {
        for (period_s, every) in [(0.004, 6), (0.001, 16)] {
            let lossy = || {
                let mut rig = Rig::new(arm, period_s, "", SHARE);
                rig.lossy = Some(every);
                rig
            };
            let o = lossy().run(5.0, Wrong::Nothing, 0.1, |_, _| ());
            assert_eq!(o.stops, 0, "{arm} {period_s} s, one of {every} lost: {o:?}");
            for &joint in joints {
                for wrong in [Wrong::Backwards(joint), Wrong::Negative(joint), Wrong::Frozen(joint)] {
                    let o = lossy().run(phases[0], wrong, AFTER_S, |_, _| ());
                    let (_, _, delay_s) = o.stop.expect("stopped");
                    let name = format!("{arm} {period_s} s, one of {every} lost, {wrong:?}");
                    assert!(delay_s - o.visible_s <= 2.0 * MOST_DELAY_S && is_harmless(&o), "{name}: {o:?}");
                }
            }
        }
    }
}

/// Setpoints whose numbers leap cannot be compared with those before: the arm joins them from where it is.
#[test]
fn a_jump_behind_numbers_that_leap_is_joined() {
    for (arm, ..) in ARMS {
        for period_s in PERIODS {
            let mut rig = Rig::new(arm, period_s, "", SHARE);
            rig.leap = rig.robot.config.controller.stale_periods as u64;
            let o = rig.run(1.7, Wrong::Nothing, AFTER_S, |_, plan| plan[0][0] += 0.18);
            println!("{arm} {period_s} s: {o:?}");
            // Joining adds 0.33 rad/s to the plan's speed; an unannounced jump adds 2.
            assert!(o.speed <= SHARE + 0.1 && o.stops == 0, "{arm} {period_s} s: {o:?}");
        }
    }
}

/// A load that the drives cannot hold: the arm sinks with its commands at their limit.
fn overloaded(period_s: f64, words: &str) -> Rig {
    Rig::new("dd2", period_s, words, 0.1).differing(|physics| load(physics, 25.0))
}

#[test]
fn a_command_that_stays_at_its_limit_is_stopped() {
    for period_s in PERIODS {
        let o = overloaded(period_s, "tracking_error = 10\nsaturation_ms = 150\n").run(
            0.0,
            Wrong::Nothing,
            AFTER_S,
            |_, _| (),
        );
        let (cause, joints, delay_s) = o.stop.expect("stopped");
        println!("{period_s} s: joints {joints:b} after {:.0} ms", 1e3 * delay_s);
        assert_eq!(cause, StopCause::Saturated, "{o:?}");
        assert!((0.149 - period_s..0.17).contains(&delay_s), "{o:?}");
    }
}

/// Joints that are made too fast, and the way of a stop from beyond the speed limit \[rad\]: dd2 goes on for 0.7 rad before its drives, at
/// the default rate limit, brake fully.
const TOO_FAST: [(&str, usize, f64); 4] = [("dd2", 0, 0.9), ("ur10e", 0, 0.4), ("ur10e", 1, 0.4), ("ur10e", 4, 0.4)];

/// A plan whose positions run a little faster than its joint may. The encoder is right, and the stop uses it.
#[test]
fn a_joint_beyond_its_speed_limit_is_stopped() {
    for (arm, joint, most) in TOO_FAST {
        for period_s in PERIODS {
            // The first stop is to last: a plan that is sound again would be followed again.
            let robot = Rig::new(arm, period_s, "resume_after = 0\n", SHARE).robot;
            let mut swing = Swing::new(&robot, 0.02);
            let speed = 1.17 * robot.model.arm.joints[joint].velocity;
            swing.amplitude[joint] = if arm == "dd2" { 2.5 } else { 1.3 };
            swing.omega[joint] = speed / swing.amplitude[joint];
            let mut rig = Rig::of(robot, Motion::Swing(swing));
            rig.bend_is_planned = true;
            let o = rig.run(0.0, Wrong::Nothing, 4.0, |_, _| ());
            let name = format!("{arm} {period_s} s, joint {}", joint + 1);
            println!("{name}: {o:?}");
            let (cause, joints, _) = o.stop.expect("stopped");
            assert_eq!((cause, joints), (StopCause::TooFast, 1 << joint), "{name}: {o:?}");
            assert!(o.speed <= MOST_SPEED && o.away <= most && o.rest <= REST, "{name}: {o:?}");
        }
    }
}

#[test]
fn an_arm_that_leaves_its_plan_is_stopped() {
    for period_s in PERIODS {
        let o = overloaded(period_s, "tracking_error = 0.1\nsaturation_ms = 10000\n").run(
            0.0,
            Wrong::Nothing,
            AFTER_S,
            |_, _| (),
        );
        let (cause, joints, _) = o.stop.expect("stopped");
        assert_eq!((cause, joints >> 1 & 1), (StopCause::TrackingError, 1), "{o:?}");
    }
}

/// The rate is known after a look of 128 stamps, of which more than half of 64 slopes have to be wrong.
#[test]
fn samples_at_another_rate_are_stopped() {
    for (arm, _, phases) in ARMS {
        for period_s in PERIODS {
            for rate in [0.5, 2.0] {
                let mut rig = Rig::new(arm, period_s, "", SHARE);
                let o = rig.run(phases[0], Wrong::Rate(rate), 2.0, |_, _| ());
                let (cause, _, delay_s) = o.stop.expect("stopped");
                println!("{arm} {period_s} s, stamps times {rate}: after {:.0} ms", 1e3 * delay_s);
                assert_eq!(cause, StopCause::WrongPeriod, "{o:?}");
                assert!(delay_s <= 200.0 * period_s && is_harmless(&o), "{arm} {period_s} s {rate}: {o:?}");
            }
        }
    }
}

/// A plan with one thing wrong from some time on. The stop reaction follows, and the cause names the rule.
fn check_plan(bend: impl Fn(f64, &mut [Values; 3]), cause: StopCause) {
    for (arm, ..) in ARMS {
        for period_s in PERIODS {
            // The first stop is to last: a plan that is sound again would be followed again.
            let mut rig = Rig::new(arm, period_s, "resume_after = 0\n", SHARE);
            let o = rig.run(1.7, Wrong::Nothing, AFTER_S, &bend);
            holds(&format!("{arm} {period_s} s, plan"), &o, &[cause]);
        }
    }
}

#[test]
fn a_plan_beyond_the_drives_is_refused() {
    check_plan(|_, plan| plan[2][1] = 1e4, StopCause::PlanAcceleration);
    check_plan(|_, plan| plan[2][0] = -300.0, StopCause::PlanAcceleration);
}

#[test]
fn a_plan_that_jumps_is_refused() {
    check_plan(|_, plan| plan[0][0] += 0.1, StopCause::PlanJump);
    check_plan(|_, plan| plan[0][1] += 0.1, StopCause::PlanJump);
}

/// Further and further, faster than joints are, in steps that are no jump by themselves: named once they add up to one.
#[test]
fn a_plan_that_runs_away_in_small_steps_is_refused() {
    for (arm, ..) in ARMS {
        for period_s in PERIODS {
            let mut rig = Rig::new(arm, period_s, "resume_after = 0\n", SHARE);
            let o = rig.run(1.7, Wrong::Nothing, AFTER_S, |t, plan| plan[0][0] += 0.04 * (t / 0.004).floor());
            let (cause, joints, delay_s) = o.stop.expect("stopped");
            println!("{arm} {period_s} s: {cause:?} after {:.0} ms, {o:?}", 1e3 * delay_s);
            assert_eq!((cause, joints), (StopCause::PlanJump, 1), "{o:?}");
            assert!(delay_s <= 2.0 * MOST_DELAY_S && is_harmless(&o), "{o:?}");
        }
    }
}

/// Positions that run away at a share of the speed limit, beside velocities that stay those of the swing.
#[test]
fn a_plan_whose_positions_contradict_its_velocities_is_refused() {
    for (arm, ..) in ARMS {
        for period_s in PERIODS {
            for share in [0.8, 0.95, 1.19] {
                let mut rig = Rig::new(arm, period_s, "resume_after = 0\n", SHARE);
                let speed = share * rig.robot.model.arm.joints[0].velocity;
                let begin = rig.planned(1.7)[0];
                let o = rig.run(1.7, Wrong::Nothing, AFTER_S, |t, plan| plan[0][0] = begin + speed * t);
                let name = format!("{arm} {period_s} s, {share} of the speed");
                println!("{name}: {o:?}");
                let (cause, joints, _) = o.stop.expect("stopped");
                assert_eq!((cause, joints), (StopCause::PlanJump, 1), "{name}: {o:?}");
                assert!(is_harmless(&o), "{name}: {o:?}");
            }
        }
    }
}

#[test]
fn absurd_plans_are_refused() {
    for k in 0..3 {
        check_plan(|_, plan| plan[k][0] = 1e308, StopCause::PlanImplausible);
        check_plan(|_, plan| plan[k][1] = f64::NAN, StopCause::PlanNotFinite);
        check_plan(|_, plan| plan[k][1] = f64::NEG_INFINITY, StopCause::PlanNotFinite);
    }
}

/// Stored parameters with a right checksum that are those of no arm: they pass the gate of live ones, or do not act.
#[test]
fn stored_parameters_times_three_never_act() {
    for (arm, ..) in ARMS {
        for period_s in PERIODS {
            for factor in [3.0, 1e300, -1.0, 0.05] {
                let mut rig = Rig::new(arm, period_s, "", SHARE);
                let nominal = rig.robot.base_parameters().to_vec();
                let stored: Vec<f64> = nominal.iter().map(|x| factor * x).collect();
                let taken = rig.core.recall(&stored);
                assert!(factor == 3.0 || taken.is_err(), "{factor}: {taken:?}");
                let o = rig.run(4.0, Wrong::Nothing, 0.5, |_, _| ());
                let most = rig.core.acting().iter().zip(&nominal).map(|(a, x)| (a - x).abs()).fold(0.0, f64::max);
                assert_eq!((most, o.stops), (0.0, 0), "{arm} {period_s} s, {factor}");
                assert!(o.away < 0.05, "{arm} {period_s} s, {factor}: {o:?}");
                println!("{arm} {period_s} s, times {factor}: {taken:?}, away {:.3} rad", o.away);
            }
        }
    }
}

/// Speed of the plan at which a stop needs all that the drives give, in parts of the joints' limits.
const FAST: f64 = 0.8;
/// Way of such a stop \[rad\]: with the default rate limit dd2 needs 0.1 s to its full torque, in which it goes on for 0.4 rad.
const FAST_AWAY: f64 = 0.5;
/// Speed that is left in the end \[rad/s\]; without a sample only friction takes what the model misses.
const FAST_REST: f64 = 0.3;

#[test]
fn fast_arms_come_to_rest_too() {
    for words in ["", "rate_limit = 1e5\n"] {
        for (arm, joints, phases) in ARMS {
            for period_s in PERIODS {
                for wrong in [Wrong::Silence, Wrong::AllFrozen, Wrong::Repeated, Wrong::Frozen(joints[1])] {
                    for &sound_s in phases {
                        let o = Rig::new(arm, period_s, words, FAST).run(sound_s, wrong, AFTER_S, |_, _| ());
                        let name = format!("{arm} {period_s} s, {words:?}, {wrong:?} after {sound_s} s");
                        println!("{name}: speed {:.2}, away {:.3} rad, rest {:.4} rad/s", o.speed, o.away, o.rest);
                        assert!(o.stop.is_some() && o.speed <= FAST + 0.05, "{name}: {o:?}");
                        assert!(o.away <= FAST_AWAY && o.rest <= FAST_REST, "{name}: {o:?}");
                    }
                }
            }
        }
    }
}
