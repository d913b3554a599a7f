//! The setpoint as the arm will follow it: through a model of each joint's position loop, fitted while running.
//!
//! The raw setpoint is a valid instrument, but it runs ahead of the arm, and the variance of the estimates grows with that
//! distance (IDIM-RIV passes the reference through the closed-loop transfer function). Per joint the loop is taken as
//!
//! ```text
//! L(s) = 1 + Σₖ gₖ·(1/(1 + sT)ᵏ − 1),  k = 1..4
//! ```
//!
//! of unit gain at rest and stable whatever g is; it stands for a pure delay or a second-order loop of a few times T
//! equally well. g solves least squares on filtered velocities, with a prior at g = 0 (the raw setpoint): the regressor is the
//! plan, free of noise, so g is not biased, and what noise g carries is that of thousands of rows.

use crate::filter::{Bank, Butterworth};
use crate::memory::{Carry, MANY};
use crate::report::Motion;

/// Low-passes in series.
const STAGES: usize = 4;
/// T over the inverse of the model filter's cut-off: 20 ms at 20 Hz.
const TIME_SHARE: f64 = 0.4;
/// Memory of the fit \[s of motion\].
const MEMORY_S: f64 = 20.0;
/// Motion of a joint before its loop counts as identified \[s\].
const LEAST_S: f64 = 2.0;
/// Prior standard deviation of g.
const PRIOR: f64 = 1.0;

/// What is known of one joint's loop.
#[derive(Clone, Copy, Debug)]
struct Fit {
    /// Σ f·fᵀ, Σ f·e and Σ e² of the velocities: f the low-passed plan less the plan, e the arm less the plan.
    normal: [[f64; STAGES]; STAGES],
    right: [f64; STAGES],
    square: f64,
    /// Rows in the sums, forgotten likewise, and in all.
    rows: f64,
    seen: u64,
    gain: [f64; STAGES],
}

impl Fit {
    const NOTHING: Fit = Fit {
        normal: [[0.0; STAGES]; STAGES],
        right: [0.0; STAGES],
        square: 0.0,
        rows: 0.0,
        seen: 0,
        gain: [0.0; STAGES],
    };

    fn add(&mut self, f: [f64; STAGES], e: f64, keep: f64) {
        for (i, row) in self.normal.iter_mut().enumerate() {
            for (k, sum) in row.iter_mut().enumerate() {
                *sum = keep * *sum + f[i] * f[k];
            }
            self.right[i] = keep * self.right[i] + f[i] * e;
        }
        self.square = keep * self.square + e * e;
        self.rows = keep * self.rows + 1.0;
        self.seen += 1;
    }

    /// Gains by Gaussian elimination; the prior makes every pivot positive.
    fn solve(&mut self) {
        let mut error = self.square;
        for i in 0..STAGES {
            let row: f64 = (0..STAGES).map(|k| self.normal[i][k] * self.gain[k]).sum();
            error += self.gain[i] * (row - 2.0 * self.right[i]);
        }
        let weight = (error.max(0.0) / self.rows.max(1.0)) / (PRIOR * PRIOR);
        let (mut a, mut b) = (self.normal, self.right);
        let trace: f64 = (0..STAGES).map(|i| a[i][i]).sum();
        for (i, row) in a.iter_mut().enumerate() {
            row[i] += weight + 1e-12 * trace;
        }
        for i in 0..STAGES {
            if a[i][i] <= 0.0 {
                return;
            }
            for r in i + 1..STAGES {
                let factor = a[r][i] / a[i][i];
                for k in i..STAGES {
                    a[r][k] -= factor * a[i][k];
                }
                b[r] -= factor * b[i];
            }
        }
        let mut gain = [0.0; STAGES];
        for i in (0..STAGES).rev() {
            let rest: f64 = (i + 1..STAGES).map(|k| a[i][k] * gain[k]).sum();
            gain[i] = (b[i] - rest) / a[i][i];
        }
        if gain.iter().all(|g| g.is_finite()) {
            self.gain = gain;
        }
    }
}

/// The loops of all joints.
#[derive(Clone, Debug)]
pub(crate) struct ClosedLoop {
    dof: usize,
    /// T \[s\], and the weight of a new sample in a low-pass.
    time_s: f64,
    share: f64,
    /// Stage k of position, velocity and acceleration of joint j at `(k·3 + derivative)·dof + j`.
    stages: Vec<f64>,
    primed: bool,
    /// f and e of every joint through the model filter, so that the fit weighs frequencies as the estimator does.
    filter: Bank,
    channels: Vec<f64>,
    fits: Vec<Fit>,
    next: usize,
    keep: f64,
    least: u64,
    lag_s: Vec<f64>,
    motion: Vec<f64>,
}

impl ClosedLoop {
    /// What the fits hold; signals begin anew.
    pub(crate) fn carry(&mut self, carry: &mut Carry<'_>) {
        for fit in &mut self.fits {
            carry.numbers(fit.normal.as_flattened_mut());
            carry.numbers(&mut fit.right);
            carry.sizes(std::slice::from_mut(&mut fit.square));
            carry.sizes(std::slice::from_mut(&mut fit.rows));
            carry.whole(&mut fit.seen, MANY);
            carry.numbers(&mut fit.gain);
        }
        carry.place(&mut self.next, self.dof);
        for lag in &mut self.lag_s {
            // NaN while it is not known.
            carry.any(lag);
        }
    }

    /// `row_s`: time between rows \[s\].
    pub(crate) fn new(dof: usize, filter: &Butterworth, filter_hz: f64, period_s: f64, row_s: f64) -> ClosedLoop {
        let time_s = TIME_SHARE / filter_hz;
        ClosedLoop {
            dof,
            time_s,
            share: 1.0 - (-period_s / time_s).exp(),
            stages: vec![0.0; STAGES * 3 * dof],
            primed: false,
            filter: Bank::new(filter.clone(), (STAGES + 1) * dof),
            channels: vec![0.0; (STAGES + 1) * dof],
            fits: vec![Fit::NOTHING; dof],
            next: 0,
            keep: (-row_s / MEMORY_S).exp(),
            least: (LEAST_S / row_s).ceil() as u64,
            lag_s: vec![f64::NAN; dof],
            motion: vec![0.0; 3 * dof],
        }
    }

    /// The next sample is the first after a hole; what is known of the loops stays.
    pub(crate) fn restart(&mut self) {
        self.primed = false;
        self.filter.restart();
    }

    /// Takes in the plan and the arm's velocity of one instant.
    pub(crate) fn step(&mut self, plan: Motion<'_>, speed: &[f64]) {
        let n = self.dof;
        if !self.primed {
            self.primed = true;
            for stage in self.stages.chunks_exact_mut(3 * n) {
                stage[..n].copy_from_slice(plan.q);
                stage[n..2 * n].copy_from_slice(plan.qd);
                stage[2 * n..].copy_from_slice(plan.qdd);
            }
        }
        for (part, input) in [plan.q, plan.qd, plan.qdd].into_iter().enumerate() {
            for (j, &input) in input.iter().enumerate() {
                let (mut x, mut out) = (input, input);
                for (k, gain) in self.fits[j].gain.iter().enumerate() {
                    let state = &mut self.stages[(3 * k + part) * n + j];
                    *state += self.share * (x - *state);
                    x = *state;
                    out += gain * (x - input);
                }
                self.motion[part * n + j] = out;
            }
        }
        for j in 0..n {
            for k in 0..STAGES {
                self.channels[k * n + j] = self.stages[(3 * k + 1) * n + j] - plan.qd[j];
            }
            self.channels[STAGES * n + j] = speed[j] - plan.qd[j];
        }
        self.filter.step(&mut self.channels);
    }

    /// Learns from the filtered velocities of now, of the joints that move, and solves for one joint.
    pub(crate) fn learn(&mut self, used: &[bool]) {
        let n = self.dof;
        for (j, fit) in self.fits.iter_mut().enumerate().filter(|(j, _)| used[*j]) {
            fit.add(std::array::from_fn(|k| self.channels[k * n + j]), self.channels[STAGES * n + j], self.keep);
        }
        let j = self.next;
        self.next = if j + 1 == n { 0 } else { j + 1 };
        let fit = &mut self.fits[j];
        if fit.seen >= self.least {
            fit.solve();
            self.lag_s[j] = self.time_s * fit.gain.iter().zip(1..).map(|(g, k)| g * f64::from(k)).sum::<f64>();
        }
    }

    /// The plan as the arm will follow it. Joints whose loop is not known yet have the plan itself.
    pub(crate) fn motion(&self) -> Motion<'_> {
        let n = self.dof;
        Motion { q: &self.motion[..n], qd: &self.motion[n..2 * n], qdd: &self.motion[2 * n..] }
    }

    /// Whether the loop of any joint is known.
    pub(crate) fn identified(&self) -> bool {
        self.lag_s.iter().any(|lag| !lag.is_nan())
    }

    /// Delay of each joint behind its plan in slow motion \[s\]; NaN until it is identified.
    pub(crate) fn lag_s(&self) -> &[f64] {
        &self.lag_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::tests::Random;
    use std::f64::consts::TAU;

    /// A critically damped loop, a pure delay and an arm that follows exactly: the model follows each of them, in
    /// position, velocity and acceleration, from noisy velocities.
    #[test]
    fn loops_are_identified() {
        let (period, rows) = (1e-3, 10);
        let filter = Butterworth::low_pass(4, 20.0, 1000.0);
        let mut closed = ClosedLoop::new(3, &filter, 20.0, period, 0.01);
        let mut random = Random(5);
        let tones = [(0.23, 0.5), (0.61, 0.3), (1.13, 0.2)];
        // Gain and delay \[s\] of each joint's loop at w.
        let follows = |joint: usize, w: f64| match joint {
            0 => (1.0 / (1.0 + (w / 31.4).powi(2)), 2.0 * (w / 31.4).atan() / w),
            1 => (1.0, 0.035),
            _ => (1.0, 0.0),
        };
        let at = |joint: usize, t: f64| {
            tones.iter().fold([0.0; 3], |sum, (hz, a)| {
                let w = TAU * hz * (1.0 + 0.1 * joint as f64);
                let (gain, late) = follows(joint, w);
                let phase = w * (t - late);
                [
                    sum[0] + a * gain * phase.sin(),
                    sum[1] + a * gain * w * phase.cos(),
                    sum[2] - a * gain * w * w * phase.sin(),
                ]
            })
        };
        let plan = |joint: usize, t: f64| {
            tones.iter().fold([0.0; 3], |sum, (hz, a)| {
                let w = TAU * hz * (1.0 + 0.1 * joint as f64);
                [sum[0] + a * (w * t).sin(), sum[1] + a * w * (w * t).cos(), sum[2] - a * w * w * (w * t).sin()]
            })
        };
        let (mut off, mut raw) = ([[0.0; 3]; 3], [[0.0; 3]; 3]);
        for k in 0..30_000 {
            let t = f64::from(k) * period;
            let plans: Vec<[f64; 3]> = (0..3).map(|j| plan(j, t)).collect();
            let column = |i: usize| plans.iter().map(|p| p[i]).collect::<Vec<f64>>();
            let (q, qd, qdd) = (column(0), column(1), column(2));
            let speed: Vec<f64> = (0..3).map(|j| at(j, t)[1] + 0.02 * random.normal()).collect();
            closed.step(Motion { q: &q, qd: &qd, qdd: &qdd }, &speed);
            if k % rows == 0 {
                closed.learn(&[true; 3]);
            }
            assert_eq!(closed.identified(), k >= 1990, "{k}");
            if k > 20_000 {
                for j in 0..3 {
                    let (truth, motion) = (at(j, t), closed.motion());
                    for (i, found) in [motion.q[j], motion.qd[j], motion.qdd[j]].into_iter().enumerate() {
                        off[j][i] += (found - truth[i]).powi(2);
                        raw[j][i] += (plans[j][i] - truth[i]).powi(2);
                    }
                }
            }
        }
        println!("lags {:.4?} s", closed.lag_s());
        for (lag, expected) in closed.lag_s().iter().zip([2.0 / 31.4, 0.035, 0.0]) {
            assert!((lag - expected).abs() < 0.003, "{lag} vs {expected}");
        }
        for j in 0..2 {
            for i in 0..3 {
                let share = (off[j][i] / raw[j][i]).sqrt();
                println!("joint {j} derivative {i}: distance to the arm {share:.3} of the plan's");
                assert!(share < 0.1);
            }
        }
        // Noise of the fit itself, where there was nothing to find: far below the noise of the encoder.
        assert!(off[2][1] / 10_000.0 < 0.005_f64.powi(2), "{:?}", off[2]);
    }
}
