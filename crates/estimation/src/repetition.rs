//! Repetitive work: how long one cycle takes, and where the arm was at the same phase of the one before.
//!
//! Noise of two cycles has nothing in common, so the motion of the previous one is an instrument where no setpoint is
//! published. The cycle is the first lag at which the positions repeat, `D(l) = Σ |q(t) − q(t − l)|²` against their
//! variance; a parabola through D places it between the lags. Memory and work per sample are fixed.

use crate::report::Motion;

/// Shortest cycle, and the resolution of lags \[s\].
const SHORTEST_S: f64 = 0.5;
const RESOLUTION_S: f64 = 0.05;
/// Positions repeat when their mean square difference is below this share of twice their variance: at a lag that is up to
/// half the resolution off, and at the lag itself.
const NEARLY: f64 = 0.02;
const EXACTLY: f64 = 2e-3;
/// Memory of what is summed at a lag, as a share of the lag: what came before the cycles began (a move to their start) must not hide them.
const MEMORY: f64 = 0.5;
/// Memory of the check that the cycle still goes on \[s\].
const CHECK_S: f64 = 0.5;

/// What is kept of the sums at lag `lag` from one term to the next: asked for hundreds of lags in one period, so no exponential.
fn keep(lag: usize) -> f64 {
    let terms = MEMORY * lag as f64;
    terms / (terms + 1.0)
}

/// The recent motion of an arm, and its cycle.
#[derive(Clone, Debug)]
pub(crate) struct Repetition {
    dof: usize,
    /// Samples between stored motions; stored motions between lags.
    stride: usize,
    per_lag: usize,
    period_s: f64,
    /// Stored positions, and velocities and accelerations: single precision is far below what two cycles differ by. Those a
    /// lag apart lie side by side: they are compared at once.
    positions: Vec<f32>,
    rates: Vec<f32>,
    /// How many motions there is room for, a multiple of those in a lag.
    depth: usize,
    head: usize,
    filled: usize,
    since: usize,
    since_lag: usize,
    /// Mean position; sums of D and of the variance, and how many terms they have, lag by lag.
    mean: Vec<f64>,
    means: f64,
    difference: Vec<f64>,
    variance: Vec<f64>,
    terms: Vec<f64>,
    keep: f64,
    shortest: usize,
    /// The cycle \[samples\]; twice the variance of one sample; the running mean square of what does not repeat.
    cycle: Option<f64>,
    spread: f64,
    mismatch: f64,
    forget: f64,
    motion: Vec<f64>,
}

impl Repetition {
    /// Keeps `longest_s` seconds, one motion every `stride` samples of `period_s`.
    pub(crate) fn new(dof: usize, longest_s: f64, period_s: f64, stride: usize) -> Repetition {
        let row = period_s * stride as f64;
        let per_lag = (RESOLUTION_S / row).round().max(1.0) as usize;
        let lag = row * per_lag as f64;
        let lags = (longest_s / lag).ceil() as usize + 2;
        // Two more than the longest lag: interpolation takes the motion on either side.
        let depth = (lags * per_lag + 2).next_multiple_of(per_lag);
        Repetition {
            dof,
            stride,
            per_lag,
            period_s,
            positions: vec![0.0; depth * dof],
            rates: vec![0.0; depth * 2 * dof],
            depth,
            head: 0,
            filled: 0,
            since: 0,
            since_lag: 0,
            mean: vec![0.0; dof],
            means: 0.0,
            difference: vec![0.0; lags],
            variance: vec![0.0; lags],
            terms: vec![0.0; lags],
            keep: (-lag / longest_s).exp(),
            shortest: (SHORTEST_S / lag).ceil().max(2.0) as usize,
            cycle: None,
            spread: 0.0,
            mismatch: 0.0,
            forget: (period_s / CHECK_S).min(1.0),
            motion: vec![0.0; 3 * dof],
        }
    }

    /// Forgets everything: after a hole, lags have no meaning.
    pub(crate) fn restart(&mut self) {
        self.since = 0;
        if self.filled == 0 {
            // Asked for every sample while something better is there: nothing to forget.
            return;
        }
        self.filled = 0;
        self.since_lag = 0;
        self.forget_lags();
    }

    fn forget_lags(&mut self) {
        self.cycle = None;
        self.means = 0.0;
        self.difference.fill(0.0);
        self.variance.fill(0.0);
        self.terms.fill(0.0);
    }

    /// Length of the cycle \[s\], while the motion repeats.
    pub(crate) fn cycle_s(&self) -> Option<f64> {
        self.cycle.map(|samples| samples * self.period_s)
    }

    /// Takes in one sample's motion, and whether any joint moves; true while the same phase of the previous cycle is
    /// known.
    pub(crate) fn step(&mut self, now: Motion<'_>, moves: bool) -> bool {
        self.since += 1;
        if self.since >= self.stride {
            self.since = 0;
            self.store(now);
            self.since_lag += 1;
            if self.since_lag >= self.per_lag {
                self.since_lag = 0;
                // A standing arm repeats itself at every lag.
                if moves {
                    self.compare(now.q);
                    if self.cycle.is_none() {
                        self.find();
                    }
                }
            }
        }
        let Some(cycle) = self.cycle else { return false };
        self.interpolate((cycle - self.since as f64) / self.stride as f64);
        let off: f64 = now.q.iter().zip(&self.motion).map(|(q, before)| (q - before).powi(2)).sum();
        self.mismatch += self.forget * (off - self.mismatch);
        if self.mismatch > EXACTLY * self.spread {
            self.forget_lags();
            return false;
        }
        true
    }

    /// The motion at the same phase of the previous cycle.
    pub(crate) fn motion(&self) -> Motion<'_> {
        let n = self.dof;
        Motion { q: &self.motion[..n], qd: &self.motion[n..2 * n], qdd: &self.motion[2 * n..] }
    }

    fn store(&mut self, now: Motion<'_>) {
        let (n, at) = (self.dof, self.place(self.head));
        let single = |(out, x): (&mut f32, &f64)| *out = *x as f32;
        self.positions[at * n..(at + 1) * n].iter_mut().zip(now.q).for_each(single);
        self.rates[2 * at * n..2 * (at + 1) * n].iter_mut().zip(now.qd.iter().chain(now.qdd)).for_each(single);
        self.head = if self.head + 1 == self.depth { 0 } else { self.head + 1 };
        self.filled = (self.filled + 1).min(self.depth);
    }

    /// Where motion `at` of the ring lies.
    fn place(&self, at: usize) -> usize {
        at % self.per_lag * (self.depth / self.per_lag) + at / self.per_lag
    }

    /// Where the motion `age` before the newest lies.
    fn stored(&self, age: usize) -> usize {
        self.place((self.head + self.depth - 1 - age) % self.depth)
    }

    /// Adds the position of now to the sums of every lag that reaches into what is stored.
    fn compare(&mut self, q: &[f64]) {
        self.means = self.keep * self.means + 1.0;
        for (mean, q) in self.mean.iter_mut().zip(q) {
            *mean += (q - *mean) / self.means;
        }
        let variance: f64 = q.iter().zip(&self.mean).map(|(q, mean)| (q - mean).powi(2)).sum();
        for lag in self.shortest..self.difference.len() {
            let age = lag * self.per_lag;
            if age >= self.filled {
                break;
            }
            let at = self.stored(age) * q.len();
            let off: f64 =
                q.iter().zip(&self.positions[at..]).map(|(q, before)| (q - f64::from(*before)).powi(2)).sum();
            let keep = keep(lag);
            self.difference[lag] = keep * self.difference[lag] + off;
            self.variance[lag] = keep * self.variance[lag] + variance;
            self.terms[lag] += 1.0;
        }
    }

    /// The first lag at which a whole cycle of positions repeats.
    fn find(&mut self) {
        for lag in self.shortest + 1..self.difference.len() - 1 {
            // A whole cycle was compared at this lag, and at both beside it.
            if self.terms[lag + 1] < (lag + 1) as f64 {
                return;
            }
            let share = |l: usize| self.difference[l] / (2.0 * self.variance[l]);
            let (before, at, after) = (share(lag - 1), share(lag), share(lag + 1));
            let is_dip = at < NEARLY && at <= before && at < after;
            if !is_dip {
                continue;
            }
            let bend = before - 2.0 * at + after;
            let shift = if bend > 0.0 { 0.5 * (before - after) / bend } else { 0.0 };
            let least = at - 0.25 * (before - after) * shift;
            if least < EXACTLY {
                self.cycle = Some((lag as f64 + shift) * (self.per_lag * self.stride) as f64);
                let keep = keep(lag);
                self.spread = 2.0 * self.variance[lag] * (1.0 - keep) / (1.0 - keep.powf(self.terms[lag]));
                self.mismatch = 0.0;
                return;
            }
        }
    }

    /// Writes the motion `age` stored ones before the newest, by straight lines between them.
    fn interpolate(&mut self, age: f64) {
        let whole = age.floor().max(0.0);
        let (share, index) = (age - whole, (whole as usize).min(self.depth - 2));
        let (late, early) = (self.stored(index), self.stored(index + 1));
        let (q, rates) = self.motion.split_at_mut(self.dof);
        for (out, stored) in [(q, &self.positions), (rates, &self.rates)] {
            let n = out.len();
            for ((out, late), early) in out.iter_mut().zip(&stored[late * n..]).zip(&stored[early * n..]) {
                let (late, early) = (f64::from(*late), f64::from(*early));
                *out = late + share * (early - late);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::tests::Random;
    use std::f64::consts::TAU;

    struct Arm {
        random: Random,
        q: [f64; 2],
        qd: [f64; 2],
        qdd: [f64; 2],
    }

    impl Arm {
        /// Two joints of different shape with one cycle of `cycle` seconds.
        fn at(&mut self, t: f64, cycle: f64) -> Motion<'_> {
            let (w, noise) = (TAU / cycle, 1e-5);
            for (j, (order, a)) in [([1.0, 3.0], 0.6), ([2.0, 5.0], 0.4)].into_iter().enumerate() {
                let (mut q, mut qd, mut qdd) = (noise * self.random.normal(), 0.0, 0.0);
                for k in order {
                    q += a / k * (k * w * t + k).sin();
                    qd += a * w * (k * w * t + k).cos();
                    qdd -= a * k * w * w * (k * w * t + k).sin();
                }
                (self.q[j], self.qd[j], self.qdd[j]) = (q, qd, qdd);
            }
            Motion { q: &self.q, qd: &self.qd, qdd: &self.qdd }
        }
    }

    fn arm() -> Arm {
        Arm { random: Random(2), q: [0.0; 2], qd: [0.0; 2], qdd: [0.0; 2] }
    }

    #[test]
    fn a_cycle_is_found_and_its_previous_pass_given() {
        let mut arm = arm();
        let mut repetition = Repetition::new(2, 20.0, 0.002, 5);
        let cycle = 4.731;
        let mut since = None;
        let mut worst = [0.0_f64; 3];
        for k in 0..10_000 {
            let t = f64::from(k) * 0.002;
            let now = arm.at(t, cycle);
            let (q, qd, qdd) = (now.q.to_vec(), now.qd.to_vec(), now.qdd.to_vec());
            if repetition.step(Motion { q: &q, qd: &qd, qdd: &qdd }, true) {
                since = since.or(Some(t));
                let before = repetition.motion();
                for j in 0..2 {
                    for (worst, (a, b)) in
                        worst.iter_mut().zip([(q[j], before.q[j]), (qd[j], before.qd[j]), (qdd[j], before.qdd[j])])
                    {
                        *worst = worst.max((a - b).abs());
                    }
                }
            }
        }
        let (since, found) = (since.expect("found"), repetition.cycle_s().expect("still going on"));
        println!("{found:.4} s for {cycle} s, from {since:.1} s on; largest differences {worst:.4?}");
        assert!((found - cycle).abs() < 0.005, "{found}");
        // Two cycles: one to look back to, one to compare with it.
        assert!(since < 2.2 * cycle, "{since}");
        assert!(worst[0] < 0.01 && worst[1] < 0.1);
    }

    /// A move to where the cycles begin does not hide them for long.
    #[test]
    fn a_cycle_is_found_behind_another_motion() {
        let mut arm = arm();
        let mut repetition = Repetition::new(2, 20.0, 0.002, 5);
        let mut since = None;
        let mut lost = 0;
        for k in 0..30_000 {
            let t = f64::from(k) * 0.002;
            let now = arm.at(t.max(5.0), 5.0);
            let away = if t < 5.0 { 0.7 * (1.0 + (0.2 * std::f64::consts::PI * t).cos()) } else { 0.0 };
            let q: Vec<f64> = now.q.iter().map(|q| q + away).collect();
            let (qd, qdd) = (now.qd.to_vec(), now.qdd.to_vec());
            if repetition.step(Motion { q: &q, qd: &qd, qdd: &qdd }, true) {
                since = since.or(Some(t));
            } else if since.is_some() {
                lost += 1;
            }
        }
        let since = since.expect("found");
        println!("from {since:.1} s on, lost for {lost} samples");
        // The move, a cycle to look back to and four to forget by.
        assert!(since < 5.0 + 5.0 * 5.0, "{since}");
        assert_eq!(lost, 0);
    }

    #[test]
    fn another_motion_ends_it_and_what_never_repeats_has_none() {
        let mut arm = arm();
        let mut repetition = Repetition::new(2, 20.0, 0.002, 5);
        let mut end = None;
        for k in 0..12_000 {
            let t = f64::from(k) * 0.002;
            // From 14 s on the cycle takes a third longer.
            let phase = if t < 14.0 { t } else { 14.0 + (t - 14.0) * 0.75 };
            let now = arm.at(phase, 4.0);
            let (q, qd, qdd) = (now.q.to_vec(), now.qd.to_vec(), now.qdd.to_vec());
            let repeats = repetition.step(Motion { q: &q, qd: &qd, qdd: &qdd }, true);
            assert!(repeats || !(9.0..14.0).contains(&t), "{t}");
            if t > 14.0 && !repeats {
                end = end.or(Some(t - 14.0));
            }
        }
        let end = end.expect("ended");
        println!("noticed after {end:.2} s");
        assert!(end < 1.0);

        let mut repetition = Repetition::new(1, 10.0, 0.002, 5);
        for k in 0..20_000 {
            let t = f64::from(k) * 0.002;
            // Two tones without a common period below some minutes.
            let (a, b) = (1.3, 1.3 * 2.0_f64.sqrt());
            let q = [0.5 * (a * t).sin() + 0.5 * (b * t).sin()];
            assert!(
                !repetition.step(Motion { q: &q, qd: &[0.0], qdd: &[0.0] }, true),
                "{t}: {:?}",
                repetition.cycle_s()
            );
        }
        // Nor has a standing arm.
        let mut repetition = Repetition::new(1, 10.0, 0.002, 5);
        for _ in 0..20_000 {
            assert!(!repetition.step(Motion { q: &[0.3], qd: &[0.0], qdd: &[0.0] }, false));
        }
    }
}
