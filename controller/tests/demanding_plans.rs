//! Smooth plans at the edge of the drives: followed, or refused by name, and never faster than the joints may be.

mod common;

use common::rig::{Motion, Outcome, Rig, Swing, Values, Wrong};
use rivet_config::Robot;
use rivet_controller::law::{ControlLaw, Gains};
use rivet_dynamics::MAX_JOINTS;
use rivet_ipc_schema::StopCause;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Sample periods \[s\].
const PERIODS: [f64; 2] = [0.004, 0.001];
/// Largest speed of the swing beneath, in parts of the joints' limits.
const SHARE: f64 = 0.4;
/// Seconds of that swing alone, and of the demanding plan after it.
const SOUND_S: f64 = 1.7;
const DEMANDING_S: f64 = 2.0;
/// Torque that the plans need by the model, in parts of the drives' limits.
const TORQUES: [f64; 7] = [0.4, 0.6, 0.8, 1.0, 1.2, 1.5, 3.0];
const FREQUENCIES_HZ: [f64; 4] = [1.0, 1.6, 2.2, 3.0];
/// Time in which the motion grows to its full size \[s\]; 0 is a step of the acceleration.
const GROWTHS_S: [f64; 2] = [0.0, 1.0];
/// Plans beyond this speed, in parts of the joints' limits, are for other rules.
const MAX_PLANNED_SPEED: f64 = 1.1;
const MAX_SPEED: f64 = 1.2;
const MAX_AWAY: f64 = 0.3;
/// A stop at speed goes on for as long as the drives need (`fast_arms_come_to_rest_too`) \[rad\].
const MAX_STOP_AWAY: f64 = 0.5;

/// `(1 − cos ωt)` rad times a size on one joint, grown as t³(10 − 15t + 6t²).
#[derive(Clone, Copy, Debug)]
struct Wave {
    joint: usize,
    frequency_hz: f64,
    growth_s: f64,
    amplitude: f64,
}

impl Wave {
    fn add(&self, t: f64, plan: &mut [Values; 3]) {
        let (a, w) = (self.amplitude, TAU * self.frequency_hz);
        let [x, xd, xdd] = [a * (1.0 - (w * t).cos()), a * w * (w * t).sin(), a * w * w * (w * t).cos()];
        let (mut g, mut gd, mut gdd) = (1.0, 0.0, 0.0);
        if t < self.growth_s {
            let (s, all) = (t / self.growth_s, self.growth_s);
            g = s * s * s * (10.0 - 15.0 * s + 6.0 * s * s);
            gd = 30.0 * s * s * (1.0 - s) * (1.0 - s) / all;
            gdd = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / (all * all);
        }
        plan[0][self.joint] += g * x;
        plan[1][self.joint] += g * xd + gd * x;
        plan[2][self.joint] += g * xdd + 2.0 * gd * xd + gdd * x;
    }

    /// Largest torque by the model and largest speed, in parts of the limits.
    fn needs(&self, robot: &Robot, law: &mut ControlLaw, motion: &Motion) -> (f64, f64) {
        let (n, mut torque, mut speed) = (robot.dof(), 0.0_f64, 0.0_f64);
        for k in 0..(DEMANDING_S / 0.005) as usize {
            let t = k as f64 * 0.005;
            let mut plan = motion.at(SOUND_S + t);
            self.add(t, &mut plan);
            let mut tau = [0.0; MAX_JOINTS];
            law.model_torque(&plan[0][..n], &plan[1][..n], &plan[2][..n], robot.base_parameters(), &mut tau[..n]);
            for j in 0..n {
                torque = torque.max((tau[j] / robot.config.drive.torque_limit[j]).abs());
                speed = speed.max((plan[1][j] / robot.model.arm.joints[j].velocity).abs());
            }
        }
        (torque, speed)
    }
}

fn law(robot: &Robot) -> ControlLaw {
    let settings = &robot.config.controller;
    let gains = Gains::from_bandwidth(&settings.bandwidth_hz, settings.damping, settings.integral_hz);
    let (model, base) = (Arc::clone(&robot.model), Arc::clone(&robot.base));
    ControlLaw::new(settings.law, model, base, robot.base_parameters(), gains, robot.config.sample_period_s)
}

/// The amplitude at which a wave needs `torque`, by bisection.
fn sized(mut wave: Wave, torque: f64, robot: &Robot, motion: &Motion) -> Option<Wave> {
    let (mut law, mut least, mut most) = (law(robot), 0.0, 10.0);
    for _ in 0..14 {
        wave.amplitude = 0.5 * (least + most);
        if wave.needs(robot, &mut law, motion).0 > torque {
            most = wave.amplitude;
        } else {
            least = wave.amplitude;
        }
    }
    let (_, speed) = wave.needs(robot, &mut law, motion);
    (speed <= MAX_PLANNED_SPEED).then_some(wave)
}

/// Plans that begin with a step of the acceleration are not smooth: another named stop may come first.
fn is_within(o: &Outcome, is_smooth: bool) -> bool {
    let is_handled = match o.stop {
        None => o.away <= MAX_AWAY,
        Some((cause, ..)) => {
            let is_named = matches!(cause, StopCause::PlanAcceleration | StopCause::PlanJump);
            o.away <= MAX_STOP_AWAY && (!is_smooth || is_named)
        }
    };
    o.speed <= MAX_SPEED && is_handled
}

/// Runs all plans on some joints of an arm with `words` in its `[controller]` section. At least one is followed and one refused.
fn check(arm: &str, joints: &[usize], words: &str) {
    let (mut wrong, mut followed, mut refused, mut fastest) = (Vec::new(), 0, 0, 0.0_f64);
    for period_s in PERIODS {
        for &joint in joints {
            for frequency_hz in FREQUENCIES_HZ {
                for growth_s in GROWTHS_S {
                    for torque in TORQUES {
                        // A plan that is sound again is followed again, which is not what is looked at here.
                        let mut rig = Rig::new(arm, period_s, &format!("resume_after = 0\n{words}"), SHARE);
                        rig.bend_is_planned = true;
                        let motion = Motion::Swing(Swing::new(&rig.robot, SHARE));
                        let wave = Wave { joint, frequency_hz, growth_s, amplitude: 0.0 };
                        let Some(wave) = sized(wave, torque, &rig.robot, &motion) else { continue };
                        let o = rig.run(SOUND_S, Wrong::Nothing, DEMANDING_S, |t, plan| wave.add(t, plan));
                        let name = format!("{arm} {period_s} s, {torque} of the torque: {wave:?}");
                        println!("{name}: {:?}, speed {:.2}, away {:.3} rad", o.stop, o.speed, o.away);
                        (followed, refused) =
                            (followed + u32::from(o.stop.is_none()), refused + u32::from(o.stop.is_some()));
                        fastest = fastest.max(o.speed);
                        if !is_within(&o, growth_s > 0.0) {
                            wrong.push(format!("{name}: {o:?}"));
                        }
                    }
                }
            }
        }
    }
    println!("{arm}: {followed} followed, {refused} refused, at most {fastest:.2} times the speed limit");
    assert!(followed > 0 && refused > 0, "{followed} followed, {refused} refused");
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// Drives that take any step: only the torque itself bounds the plan.
#[test]
fn plans_at_the_edge_are_followed_or_refused_without_a_rate_limit() {
    check("dd2", &[0, 1], "rate_limit = 1e5\n");
}

/// The default rate limit, full torque in 0.1 s: what changes faster is followed by a reference that falls behind, or refused.
#[test]
fn plans_at_the_edge_are_followed_or_refused_with_the_default_rate_limit() {
    check("dd2", &[0, 1], "");
}

/// The same on six axes.
#[test]
fn plans_at_the_edge_are_followed_or_refused_on_six_axes() {
    check("ur10e", &[1, 4], "");
}
