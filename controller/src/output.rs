//! The one way out: law -> saturation -> rate limit -> finite check.

use rivet_dynamics::MAX_JOINTS;

/// Torque by which the rate limit holds a command back that swings an arm, in parts of the torque limit: less is the chatter of feedback.
const LACKING_SHARE: f64 = 0.25;
/// Time over which that torque is smoothed \[s\]: encoder steps of 1.5 mrad
/// make feedback chatter faster, an arm swings more slowly. With 10 ms the first are followed badly, with 30 ms the second.
const LACKING_S: f64 = 0.015;

/// What no command may exceed, joint by joint.
#[derive(Clone, Debug, PartialEq)]
pub struct Limits {
    /// Largest torque \[N·m\].
    pub torque: Vec<f64>,
    /// Largest change of torque from one command to the next \[N·m\].
    pub step: Vec<f64>,
}

/// What was done to a torque on its way out.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Applied {
    /// Joints that did not get what the law wanted.
    pub limited: [bool; MAX_JOINTS],
    /// A joint was at its torque limit.
    pub saturated: bool,
    /// A joint was held back by its rate limit.
    pub rate_limited: bool,
    /// A joint's torque was not a number.
    pub broken: bool,
    /// What the rate limit takes from each joint's torque, given less wanted, smoothed and beyond the chatter of feedback \[N·m\].
    /// What it takes from friction is left out: the joint stands meanwhile, it is not accelerated.
    pub lacking: [f64; MAX_JOINTS],
}

/// Turns what the law wants into what the robot gets.
#[derive(Clone, Debug)]
pub struct Output {
    limits: Limits,
    last: [f64; MAX_JOINTS],
    largest_step: [f64; MAX_JOINTS],
    /// Commands that the rate limit held back by much, less those that it did not, from zero on.
    held_back: [u32; MAX_JOINTS],
    /// What the rate limit takes, smoothed \[N·m\], and the weight of one command in it.
    lacking: [f64; MAX_JOINTS],
    weight: f64,
    /// Friction behind a rate limit of its own \[N·m\].
    friction: [f64; MAX_JOINTS],
    /// Largest permitted value of that count.
    most_held_back: [u32; MAX_JOINTS],
}

impl Output {
    /// Starts from zero torque: the first commands rise at the permitted rate. `longest` is the most commands that may be at a limit.
    pub fn new(limits: Limits, longest: u32, period_s: f64) -> Output {
        let mut most_held_back = [longest; MAX_JOINTS];
        for (most, (torque, step)) in most_held_back.iter_mut().zip(limits.torque.iter().zip(&limits.step)) {
            let swing = 2.0 * torque / step;
            // A cast saturates: without a limit of the rate nothing is held back.
            *most = (*most).max(swing.ceil() as u32);
        }
        let zero = [0.0; MAX_JOINTS];
        let weight = 1.0 - (-period_s / LACKING_S).exp();
        Output {
            limits,
            last: zero,
            largest_step: zero,
            held_back: [0; MAX_JOINTS],
            lacking: zero,
            weight,
            friction: zero,
            most_held_back,
        }
    }

    /// Joints, bit 0 the base's, whose torque, friction left out, the rate limit has held back by a quarter of its limit and more for longer than it may be at a limit and longer than
    /// the drive takes from one limit to the other: feedback that comes so late swings the joint further with each turn.
    pub fn held_back(&self) -> u32 {
        let too_long = |j: &usize| self.held_back[*j] > self.most_held_back[*j];
        (0..MAX_JOINTS).filter(too_long).fold(0, |bits, j| bits | 1 << j)
    }

    /// Forgets for how long torques have been held back.
    pub fn restart(&mut self) {
        self.held_back = [0; MAX_JOINTS];
        self.lacking = [0.0; MAX_JOINTS];
    }

    /// Limits `wanted` in place; `friction` is the part of it that turns round with the joint \[N·m\]. A joint whose torque is not a
    /// number keeps its last command. Real-time safe.
    pub fn apply(&mut self, wanted: &mut [f64], friction: &[f64; MAX_JOINTS]) -> Applied {
        let mut applied = Applied::default();
        for (j, tau) in wanted.iter_mut().enumerate() {
            let (last, limit, step) = (self.last[j], self.limits.torque[j], self.limits.step[j]);
            if tau.is_finite() {
                applied.saturated |= tau.abs() > limit;
                let within = tau.clamp(-limit, limit);
                applied.rate_limited |= (within - last).abs() > step;
                // Saturating last as well as first: a step may not lead out of the limits.
                let given = within.clamp(last - step, last + step).clamp(-limit, limit);
                let chatter = LACKING_SHARE * limit;
                let lacking = given - within;
                let turning = friction[j] - self.friction[j];
                self.friction[j] += turning.clamp(-step, step);
                // What friction lacks is left out, as far as the whole torque lacks it.
                let of_friction = self.friction[j] - friction[j];
                let lacking = lacking - of_friction.clamp(lacking.min(0.0), lacking.max(0.0));
                self.lacking[j] += self.weight * (lacking - self.lacking[j]);
                applied.lacking[j] = self.lacking[j] - self.lacking[j].clamp(-chatter, chatter);
                let (lacking, before) = (lacking.abs() > chatter, self.held_back[j]);
                self.held_back[j] = if lacking { before.saturating_add(1) } else { before.saturating_sub(1) };
                applied.limited[j] = given != *tau;
                *tau = given;
            } else {
                applied.broken = true;
                applied.limited[j] = true;
                *tau = last;
            }
            self.largest_step[j] = self.largest_step[j].max((*tau - last).abs());
            self.last[j] = *tau;
        }
        applied
    }

    /// Lowest and highest torque that the next command may have \[N·m\]: within the limits, and a step of the last one.
    pub(crate) fn reach(&self) -> [[f64; MAX_JOINTS]; 2] {
        let mut reach = [[0.0; MAX_JOINTS]; 2];
        for (j, (limit, step)) in self.limits.torque.iter().zip(&self.limits.step).enumerate() {
            let last = self.last[j];
            reach[0][j] = (last - step).clamp(-limit, *limit);
            reach[1][j] = (last + step).clamp(-limit, *limit);
        }
        reach
    }

    /// The last torque that went out \[N·m\].
    pub fn last(&self) -> &[f64; MAX_JOINTS] {
        &self.last
    }

    /// Largest step from one command to the next so far \[N·m\].
    pub fn largest_step(&self) -> &[f64; MAX_JOINTS] {
        &self.largest_step
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn output() -> Output {
        Output::new(Limits { torque: vec![10.0, 10.0], step: vec![4.0, 100.0] }, 4, 0.001)
    }

    /// A torque that asks for more than the rate limit with every command, this way and that; joint 2 may step as it likes.
    #[test]
    fn a_torque_that_is_held_back_for_too_long_is_named() {
        let mut out = output();
        let found = (1..20).find(|k| {
            let wanted = if k % 4 < 2 { 10.0 } else { -10.0 };
            let _ = out.apply(&mut [3.0 * wanted, wanted], &[0.0; MAX_JOINTS]);
            out.held_back() != 0
        });
        // From one limit to the other takes five commands.
        assert_eq!((found, out.held_back()), (Some(6), 1));
        out.restart();
        assert_eq!(out.held_back(), 0);
        let mut out = output();
        for _ in 0..20 {
            let _ = out.apply(&mut [10.0, 10.0], &[0.0; MAX_JOINTS]);
            assert_eq!(out.held_back(), 0, "it arrives");
        }
    }

    #[test]
    fn a_step_is_spread_over_the_permitted_rate() {
        let mut out = output();
        let mut seen = Vec::new();
        for _ in 0..4 {
            let mut tau = [50.0, -50.0];
            let applied = out.apply(&mut tau, &[0.0; MAX_JOINTS]);
            assert!(applied.saturated && !applied.broken);
            assert_eq!(applied.limited[..2], [true, true]);
            seen.push(tau);
        }
        assert_eq!(seen, [[4.0, -10.0], [8.0, -10.0], [10.0, -10.0], [10.0, -10.0]]);
        assert_eq!(out.largest_step()[..2], [4.0, 10.0]);
    }

    /// Friction that turns round takes the rate limit 16 commands. The joint stands meanwhile: nothing lacks that would accelerate it.
    #[test]
    fn friction_that_turns_round_is_not_lacking() {
        let lacking = |friction: f64| {
            let limits = Limits { torque: vec![10.0, 10.0], step: vec![1.0, 1.0] };
            let mut out = Output::new(limits, 4, 0.001);
            let mut give = |sign: f64| out.apply(&mut [sign * 8.0, 0.0], &[sign * friction; MAX_JOINTS]).lacking[0];
            for _ in 0..40 {
                give(1.0);
            }
            (0..40).map(|_| give(-1.0).abs()).fold(0.0, f64::max)
        };
        assert_eq!(lacking(8.0), 0.0);
        assert!(lacking(0.0) > 1.0, "{}", lacking(0.0));
    }

    #[test]
    fn a_torque_that_is_no_number_keeps_the_last_command() {
        let mut out = output();
        let mut tau = [3.0, 5.0];
        assert_eq!(out.apply(&mut tau, &[0.0; MAX_JOINTS]), Applied::default());
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut tau = [bad, 6.0];
            assert!(out.apply(&mut tau, &[0.0; MAX_JOINTS]).broken);
            assert_eq!(tau, [3.0, 6.0]);
        }
    }
}
