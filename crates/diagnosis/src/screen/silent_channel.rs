//! Torque channels without information although their joints move: dead ones, and those that hold only noise.

use crate::model::log_fault::LogFault;
use crate::model::rows::Chain;
use crate::model::run::{Motion, Run};
use crate::model::standstill::{is_moved, is_still};
use crate::policy::POLICY;
use crate::screen::signal_faults;
use rivet_dynamics::Places;

const AS_DUE: std::ops::Range<f64> = 0.2..5.0;

impl LogFault {
    /// Of a joint in motion whose torque varies by `carries` \[N·m\] and follows the direction of motion with the correlation
    /// `follows`, where friction and rotor take `due` by the file.
    pub fn of_silence(carries: f64, due: f64, follows: f64) -> Option<LogFault> {
        (carries < POLICY.screening.max_silent_share * due && follows.abs() <= POLICY.screening.max_silent_correlation)
            .then_some(LogFault::Silent { carries, due })
    }

    /// The same of one that varies by `noise` \[N·m\], all but nothing else, where that is far less than is due.
    fn of_noise(carries: f64, noise: f64, due: f64, follows: f64) -> Option<LogFault> {
        let alone = carries < POLICY.screening.max_silent_noise_ratio * noise
            && carries < POLICY.screening.max_noise_share * due
            && follows.abs() <= POLICY.screening.max_silent_correlation;
        alone.then_some(LogFault::Silent { carries, due })
    }
}

/// The fault of joint `j`'s torque rows if they say nothing although the joint moves: neither as much as the least that its
/// drive takes, nor in the direction of its motion. What bodies take may cancel, so it does not count.
pub(crate) fn detect(tau: &[f64], noise: f64, motion: &Motion, chain: &Chain, x: &[f64], j: usize) -> Option<LogFault> {
    let (n, speed, accel) = (motion.joints(), chain.sample(&motion.qd[j]), chain.sample(&motion.qdd[j]));
    if !is_moved(motion, chain, j) {
        return None;
    }
    let moving: Vec<usize> =
        (0..tau.len()).filter(|k| speed[*k].abs() > POLICY.signal_faults.max_still_speed_rad_s).collect();
    let rows = moving.len() as f64;
    let mean = |f: &dyn Fn(usize) -> f64| moving.iter().map(|k| f(*k)).sum::<f64>() / rows;
    let drive = |k: usize| {
        x[Places::new(n).coulomb(j)].abs() * speed[k].signum()
            + x[Places::new(n).viscous(j)].abs() * speed[k]
            + x[Places::new(n).rotor_inertia(j)].abs() * accel[k]
    };
    let [carries, due] = [mean(&|k| tau[k].powi(2)), mean(&|k| drive(k).powi(2))].map(f64::sqrt);
    let (level, turn) = (mean(&|k| tau[k]), mean(&|k| speed[k].signum()));
    let product = mean(&|k| (tau[k] - level) * (speed[k].signum() - turn));
    // A channel that stands still at some level says nothing either.
    let varies = mean(&|k| (tau[k] - level).powi(2)).sqrt();
    let stuck = varies <= 1e-9 * carries;
    // A joint that turns one way at an even speed has a drive that takes an even torque: a level of about that size is heard.
    let expected = mean(&drive);
    let one_way = turn.abs() > POLICY.screening.min_one_way_share && expected != 0.0;
    if !stuck && one_way && AS_DUE.contains(&(level / expected)) {
        return None;
    }
    let most = varies * (1.0 - turn.powi(2)).max(0.0).sqrt();
    let follows = if stuck { 0.0 } else { product / most.max(f64::MIN_POSITIVE) };
    LogFault::of_silence(varies, due, follows).or_else(|| LogFault::of_noise(varies, noise, due, follows))
}

/// Whether the run has a channel that says nothing and no other joint moves: then it says nothing of any joint.
pub(crate) fn is_mute(run: &Run, x: &[f64]) -> bool {
    let (motion, chain) = (Motion::from_run(run), Chain::new(run.period_s));
    let moving: Vec<usize> = (0..run.joints()).filter(|j| !is_still(&motion, *j)).collect();
    let silent = |j: &usize| {
        let noise = signal_faults::white_noise_without(&run.tau[*j], &run.interpolated) * chain.white_gain();
        detect(&chain.apply(&run.tau[*j]), noise, &motion, &chain, x, *j).is_some()
    };
    !moving.is_empty() && moving.iter().all(silent)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One joint that swings at up to 1 rad/s; by its file rotor 0.1 kg m², friction 1 N·m s/rad and 1 N·m: a root mean square
    /// of 1.74 N·m in motion.
    fn heard(tau: impl Fn(f64, f64) -> f64, seconds: f64, friction: f64) -> Option<LogFault> {
        let at =
            |f: fn(f64) -> f64| vec![(0..(1e3 * seconds) as i32).map(|k| f(1e-3 * f64::from(k))).collect::<Vec<f64>>()];
        let motion = Motion { period_s: 1e-3, q: at(|t| 1.0 - t.cos()), qd: at(f64::sin), qdd: at(f64::cos) };
        let chain = Chain::new(1e-3);
        let tau: Vec<f64> = (0..motion.len()).map(|k| tau(1e-3 * k as f64, motion.qd[0][k])).collect();
        let x = [vec![0.0; 10], vec![0.1, friction, friction, 0.0]].concat();
        detect(&chain.apply(&tau), 0.0, &motion, &chain, &x, 0)
    }

    #[test]
    fn a_channel_that_carries_next_to_nothing_of_a_moving_joint_is_silent() {
        let Some(LogFault::Silent { carries, due }) = heard(|t, _| 0.002 * (3.0 * t).cos(), 20.0, 1.0) else {
            panic!("0.0014 N m of 1.7")
        };
        // sqrt(1/2), and of 1 + |sin| and a small part across it sqrt(1 + 4/π + 1/2).
        assert!((carries / 0.00141 - 1.0).abs() < 0.05 && (due / 1.66 - 1.0).abs() < 0.05, "{carries} {due}");
        assert!(heard(|_, _| 0.0, 20.0, 1.0).is_some(), "a dead channel");
        assert!(heard(|_, _| 0.7, 20.0, 1.0).is_some(), "one that is stuck");
    }

    #[test]
    fn a_sound_channel_is_not_silent() {
        assert_eq!(heard(|_, v| v.signum() + v, 20.0, 1.0), None);
        assert_eq!(
            heard(|_, v| 0.05 * v.signum(), 20.0, 1.0),
            None,
            "a twentieth of the file's friction shows all the same"
        );
        assert_eq!(heard(|t, _| 0.5 * t.cos(), 20.0, 1.0), None, "bodies against a friction that is not seen");
        assert_eq!(heard(|_, _| 0.0, 0.6, 1.0), None, "too short a time");
        // One way at an even speed: friction is a level, and not a dead channel where it is about that of the file.
        let even = |level: f64| {
            let n = 3000;
            let motion = Motion {
                period_s: 1e-3,
                q: vec![(0..n).map(|k| 1e-3 * f64::from(k)).collect()],
                qd: vec![vec![1.0; n as usize]],
                qdd: vec![vec![0.0; n as usize]],
            };
            let chain = Chain::new(1e-3);
            let tau: Vec<f64> = (0..n).map(|k| level + 0.01 * (300.0 * 1e-3 * f64::from(k)).sin()).collect();
            detect(&chain.apply(&tau), 0.0, &motion, &chain, &[vec![0.0; 10], vec![0.1, 1.0, 1.0, 0.0]].concat(), 0)
        };
        assert_eq!(even(1.7), None);
        assert!(even(0.0).is_some() && even(-1.7).is_some());
        assert_eq!(heard(|t, _| 0.05 * (3.0 * t).cos(), 20.0, 0.0), None, "a file that expects nothing");
    }
}
