//! Second encoders, differentiated like the first, and whether they see the same joints.
//!
//! A column that was not recorded, or that of another joint, would be an instrument that has nothing to do with the
//! regressor: worse than none. Gears bend and mesh by thousandths of a radian, so what the encoders of one joint read
//! differs by a constant and by little of the motion.

use crate::differentiate::Aligned;
use crate::report::Motion;
use crate::settings::Settings;

/// What of the motion counts \[s\]: as the mean over so long.
const SECONDS: f64 = 2.0;
/// A joint is judged from this standard deviation of its position on \[rad\].
const MIN_JUDGED_STD_RAD: f64 = 3e-3;
/// The encoders do not see the same joint where their difference, less its mean, is beyond this share of the motion, both as
/// standard deviations. It is 1 where the second sees nothing.
const DIFFERS: f64 = 0.5;

/// Mean and variance with an exponential window; begins with the first value.
#[derive(Clone, Copy, Debug)]
struct Moving {
    mean: Option<f64>,
    variance: f64,
}

impl Moving {
    const NOTHING: Moving = Moving { mean: None, variance: 0.0 };

    fn push(&mut self, value: f64, share: f64) {
        let mean = self.mean.unwrap_or(value);
        let off = value - mean;
        self.mean = Some(mean + share * off);
        self.variance = (1.0 - share) * (self.variance + share * off * off);
    }
}

/// One joint by both encoders.
#[derive(Clone, Copy, Debug)]
struct Pair {
    position: Moving,
    difference: Moving,
    same: Option<bool>,
}

impl Pair {
    fn push(&mut self, own: f64, second: f64, share: f64) {
        self.position.push(own, share);
        self.difference.push(second - own, share);
        let motion = self.position.variance;
        if motion > MIN_JUDGED_STD_RAD * MIN_JUDGED_STD_RAD {
            self.same = Some(self.difference.variance <= DIFFERS * DIFFERS * motion);
        }
    }
}

/// The second encoders of an arm.
#[derive(Clone, Debug)]
pub(crate) struct SecondEncoder {
    aligned: Aligned,
    pairs: Vec<Pair>,
    /// Of a sample in the means.
    share: f64,
    whole: bool,
}

impl SecondEncoder {
    pub(crate) fn new(dof: usize, settings: &Settings) -> SecondEncoder {
        let period = settings.sample_period_s;
        SecondEncoder {
            aligned: Aligned::positions(dof, settings.differentiator, period),
            pairs: vec![Pair { position: Moving::NOTHING, difference: Moving::NOTHING, same: None }; dof],
            share: (period / SECONDS).min(1.0),
            whole: false,
        }
    }

    /// After a hole in the stream, in which encoders may have been set anew; what was judged of them stays.
    pub(crate) fn restart(&mut self) {
        self.aligned.restart();
        self.whole = false;
        for pair in &mut self.pairs {
            (pair.position, pair.difference) = (Moving::NOTHING, Moving::NOTHING);
        }
    }

    /// Takes in a sample of both encoders, one value a joint; torques are the first encoders' business.
    pub(crate) fn push(&mut self, own: &[f64], second: &[f64], tau: &[f64]) {
        for ((pair, own), second) in self.pairs.iter_mut().zip(own).zip(second) {
            pair.push(*own, *second, self.share);
        }
        self.whole = self.aligned.push(second, tau, None);
    }

    /// The motion that they see; `None` while it is not whole, no joint has moved yet, or one has that they do not see.
    pub(crate) fn motion(&self) -> Option<Motion<'_>> {
        let judged = || self.pairs.iter().filter_map(|pair| pair.same);
        let same = judged().next().is_some() && judged().all(|same| same);
        let Aligned { q, qd, qdd, .. } = &self.aligned;
        (self.whole && same).then_some(Motion { q, qd, qdd })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: f64 = 1e-3;

    /// Two joints; what the second encoders read of them, given both positions.
    fn seen(second: impl Fn(f64, f64) -> [f64; 2]) -> bool {
        let mut encoders = SecondEncoder::new(2, &Settings::new(2, PERIOD));
        for k in 0..4000 {
            let t = PERIOD * f64::from(k);
            let [a, b]: [f64; 2] = [0.4 * (2.0 * t).sin(), 0.3 * (3.1 * t).sin() + 0.1];
            encoders.push(&[a, b], &second(a, b), &[0.0; 2]);
        }
        encoders.motion().is_some()
    }

    #[test]
    fn a_gear_that_bends_and_an_offset_are_the_same_joint() {
        assert!(seen(|a, b| [a + 0.004 * a.cos(), b - 1.7]));
    }

    #[test]
    fn columns_of_nothing_of_another_sign_or_joint_are_not() {
        assert!(!seen(|_, _| [0.0; 2]));
        assert!(!seen(|a, b| [a, -b]));
        assert!(!seen(|a, b| [b, a]));
    }

    #[test]
    fn arms_that_stand_say_nothing_of_them() {
        let mut encoders = SecondEncoder::new(1, &Settings::new(1, PERIOD));
        (0..100).for_each(|_| encoders.push(&[0.2], &[0.2], &[0.0]));
        assert!(encoders.motion().is_none());
    }

    #[test]
    fn a_hole_keeps_the_verdict_and_forgets_the_offset() {
        let mut encoders = SecondEncoder::new(1, &Settings::new(1, PERIOD));
        for offset in [0.0, 2.0] {
            for k in 0..3000 {
                let q = 0.4 * (2.0 * PERIOD * f64::from(k)).sin();
                encoders.push(&[q], &[q + offset], &[0.0]);
            }
            assert!(encoders.motion().is_some(), "{offset}");
            encoders.restart();
            assert!(encoders.motion().is_none());
        }
    }
}
