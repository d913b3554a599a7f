//! From sampled positions to motion: finite impulse responses over one delay line that all signals share, or a state
//! filter that all signals pass.
//!
//! This is the one place that knows about the delay of differentiation: whatever leaves `Aligned` (positions,
//! velocities, accelerations, torques, setpoints) belongs to the same instant, `delay` samples (or three time constants of
//! the state filter) ago.

use crate::plan::Plan;
use crate::report::{Motion, Setpoint};
use crate::settings::Differentiator;
use crate::state_filter::StateFilter;

/// Weights over a window of `2m + 1` samples, oldest first.
#[derive(Clone, Debug, PartialEq)]
pub struct Weights {
    /// Position \[1\].
    pub position: Vec<f64>,
    /// Velocity \[1/s\].
    pub velocity: Vec<f64>,
    /// Acceleration \[1/s²\].
    pub acceleration: Vec<f64>,
}

impl Weights {
    /// Weights for samples `period` \[s\] apart.
    ///
    /// ```text
    /// central:  q̇ = (q₊ − q₋)/2T,  q̈ = (q₊ − 2q₀ + q₋)/T²
    /// cubic over i = −m..m, with Sₖ = Σ iᵏ and N = 2m + 1 (Savitzky & Golay 1964, Anal. Chem. 36(8)):
    ///   q ← Σ (S₄ − S₂i²)/(N·S₄ − S₂²)·qᵢ
    ///   q̇ ← Σ (S₆i − S₄i³)/(S₂·S₆ − S₄²)·qᵢ/T
    ///   q̈ ← Σ 2(N·i² − S₂)/(N·S₄ − S₂²)·qᵢ/T²
    /// ```
    ///
    /// The state filter has no window: its weights let the sample pass, for it differentiates by itself.
    #[must_use]
    pub fn new(differentiator: Differentiator, period: f64) -> Weights {
        if let Differentiator::StateFilter { .. } = differentiator {
            return Weights { position: vec![1.0], velocity: vec![0.0], acceleration: vec![0.0] };
        }
        let half = differentiator.delay();
        if differentiator == Differentiator::Central {
            let (v, a) = (0.5 / period, 1.0 / (period * period));
            return Weights {
                position: vec![0.0, 1.0, 0.0],
                velocity: vec![-v, 0.0, v],
                acceleration: vec![a, -2.0 * a, a],
            };
        }
        let places: Vec<f64> = (0..=2 * half).map(|i| i as f64 - half as f64).collect();
        let sum = |k: i32| places.iter().map(|i| i.powi(k)).sum::<f64>();
        let (n, s2, s4, s6) = (places.len() as f64, sum(2), sum(4), sum(6));
        let (even, odd) = (n * s4 - s2 * s2, s2 * s6 - s4 * s4);
        Weights {
            position: places.iter().map(|i| (s4 - s2 * i * i) / even).collect(),
            velocity: places.iter().map(|i| (s6 * i - s4 * i.powi(3)) / (odd * period)).collect(),
            acceleration: places.iter().map(|i| 2.0 * (n * i * i - s2) / (even * period * period)).collect(),
        }
    }
}

/// Delay line of several channels; each channel's samples lie contiguous, oldest first.
#[derive(Clone, Debug)]
struct Line {
    length: usize,
    /// Each sample is written twice, `length` apart, so that a whole window is always one slice.
    data: Vec<f64>,
    /// Where the next sample goes, below `length`.
    head: usize,
}

impl Line {
    fn new(channels: usize, length: usize) -> Line {
        Line { length, data: vec![0.0; channels * 2 * length], head: 0 }
    }

    fn write(&mut self, channel: usize, value: f64) {
        let at = channel * 2 * self.length + self.head;
        self.data[at] = value;
        self.data[at + self.length] = value;
    }

    fn advance(&mut self) {
        self.head += 1;
        if self.head == self.length {
            self.head = 0;
        }
    }

    fn window(&self, channel: usize) -> &[f64] {
        let start = channel * 2 * self.length + self.head;
        &self.data[start..start + self.length]
    }
}

/// What is only delayed: the samples of the last instants, one row each.
#[derive(Clone, Debug)]
struct Late {
    width: usize,
    data: Vec<f64>,
    /// Where the next row goes.
    head: usize,
}

impl Late {
    /// For so many channels and instants of delay.
    fn new(width: usize, delay: usize) -> Late {
        Late { width, data: vec![0.0; width * (delay + 1)], head: 0 }
    }

    /// Place for the row of now.
    fn next(&mut self) -> &mut [f64] {
        let at = self.head;
        self.head = if at + self.width == self.data.len() { 0 } else { at + self.width };
        &mut self.data[at..at + self.width]
    }

    /// The row that is `delay` older than the last one.
    fn oldest(&self) -> &[f64] {
        &self.data[self.head..self.head + self.width]
    }
}

/// Everything measured at one instant, `delay` samples after it happened.
#[derive(Clone, Debug)]
pub(crate) struct Aligned {
    dof: usize,
    weights: Weights,
    /// Positions.
    line: Line,
    late: Late,
    states: Option<States>,
    filled: usize,
    pub(crate) q: Vec<f64>,
    pub(crate) qd: Vec<f64>,
    pub(crate) qdd: Vec<f64>,
    pub(crate) tau: Vec<f64>,
    desired: Vec<f64>,
    has_setpoint: bool,
    plan: Plan,
    /// Desired positions, for the derivatives that a plan lacks, and the samples that they have been there for.
    planned: Line,
    planned_for: usize,
}

/// The state filter in place of the line: the same channels.
#[derive(Clone, Debug)]
struct States {
    filter: StateFilter,
    settling: usize,
    /// Samples since the setpoints began.
    with_setpoint: usize,
}

impl Aligned {
    pub(crate) fn new(dof: usize, differentiator: Differentiator, period: f64) -> Aligned {
        let half = differentiator.delay();
        let zeros = vec![0.0; dof];
        let states = match differentiator {
            Differentiator::StateFilter { hz } => {
                let filter = StateFilter::new(5 * dof, hz, period);
                Some(States { settling: filter.settling(period), filter, with_setpoint: 0 })
            }
            Differentiator::Central | Differentiator::SavitzkyGolay { .. } => None,
        };
        Aligned {
            states,
            dof,
            weights: Weights::new(differentiator, period),
            line: Line::new(dof, 2 * half + 1),
            // tau, three of the setpoint, and whether there was one
            late: Late::new(4 * dof + 1, half),
            filled: 0,
            q: zeros.clone(),
            qd: zeros.clone(),
            qdd: zeros.clone(),
            tau: zeros,
            desired: vec![0.0; 3 * dof],
            has_setpoint: false,
            plan: Plan::new(dof, period),
            planned: Line::new(dof, 2 * half + 1),
            planned_for: 0,
        }
    }

    /// For positions alone: torques and setpoints are not delayed with them, but left out.
    pub(crate) fn positions(dof: usize, differentiator: Differentiator, period: f64) -> Aligned {
        let aligned = Aligned::new(dof, differentiator, period);
        Aligned { late: Late::new(0, 0), planned: Line::new(0, 1), ..aligned }
    }

    /// Forgets all samples.
    pub(crate) fn restart(&mut self) {
        self.filled = 0;
        self.planned_for = 0;
        self.plan.take(None);
        if let Some(states) = &mut self.states {
            states.filter.restart();
            states.with_setpoint = 0;
        }
    }

    /// Takes in one sample; false until the line is full, or the state filter has forgotten its start.
    pub(crate) fn push(&mut self, q: &[f64], tau: &[f64], setpoint: Option<Setpoint<'_>>) -> bool {
        let n = self.dof;
        if self.states.is_some() {
            return self.filter(q, tau, setpoint);
        }
        for j in 0..n {
            self.line.write(j, q[j]);
        }
        self.line.advance();
        let row = self.late.next();
        if let Some((is_set, row)) = row.split_last_mut() {
            row[..n].copy_from_slice(tau);
            match setpoint {
                Some(s) => {
                    for (part, to) in [s.q, s.qd, s.qdd].iter().zip(row[n..].chunks_exact_mut(n)) {
                        to.copy_from_slice(part);
                    }
                }
                None => row[n..].fill(0.0),
            }
            *is_set = f64::from(u8::from(setpoint.is_some()));
            self.take_plan(setpoint);
        }
        self.filled = (self.filled + 1).min(self.line.length);
        if self.filled < self.line.length {
            return false;
        }
        for j in 0..n {
            let window = self.line.window(j);
            self.q[j] = dot(&self.weights.position, window);
            self.qd[j] = dot(&self.weights.velocity, window);
            self.qdd[j] = dot(&self.weights.acceleration, window);
        }
        if let Some((is_set, row)) = self.late.oldest().split_last() {
            self.tau.copy_from_slice(&row[..n]);
            self.desired.copy_from_slice(&row[n..]);
            self.has_setpoint = *is_set != 0.0 && self.complete_plan();
        }
        true
    }

    fn take_plan(&mut self, setpoint: Option<Setpoint<'_>>) {
        self.plan.take(setpoint);
        match setpoint {
            Some(s) => {
                s.q.iter().enumerate().for_each(|(j, q)| self.planned.write(j, *q));
                self.planned.advance();
                self.planned_for = (self.planned_for + 1).min(self.planned.length);
            }
            None => self.planned_for = 0,
        }
    }

    /// Makes the derivatives that are not those of the desired positions; false where these have not been there for long enough.
    fn complete_plan(&mut self) -> bool {
        let n = self.dof;
        if !self.plan.broken().contains(&true) {
            return true;
        }
        for j in (0..n).filter(|j| self.plan.broken()[*j]) {
            let window = self.planned.window(j);
            self.desired[n + j] = dot(&self.weights.velocity, window);
            self.desired[2 * n + j] = dot(&self.weights.acceleration, window);
        }
        self.planned_for == self.planned.length
    }

    /// `push` through the state filter.
    fn filter(&mut self, q: &[f64], tau: &[f64], setpoint: Option<Setpoint<'_>>) -> bool {
        let n = self.dof;
        let Some(States { filter, settling, with_setpoint }) = &mut self.states else { return false };
        let desired = |k: usize| {
            let part = |s: Setpoint<'_>| [s.q, s.qd, s.qdd][k / n][k % n];
            setpoint.map_or(0.0, part)
        };
        filter.step(q.iter().chain(tau).copied().chain((0..3 * n).map(desired)));
        if *with_setpoint == 0 || setpoint.is_none() {
            // Setpoints that come, or come again, do not pass through the zeros before them.
            (0..3 * n).for_each(|k| filter.hold(2 * n + k, desired(k)));
        }
        *with_setpoint = if setpoint.is_some() { (*with_setpoint + 1).min(*settling) } else { 0 };
        for j in 0..n {
            [self.q[j], self.qd[j], self.qdd[j]] = filter.motion(j);
            self.tau[j] = filter.value(n + j);
        }
        for (k, value) in self.desired.iter_mut().enumerate() {
            *value = filter.value(2 * n + k);
        }
        self.plan.take(setpoint);
        for j in (0..n).filter(|j| self.plan.broken()[*j]) {
            [_, self.desired[n + j], self.desired[2 * n + j]] = filter.motion(2 * n + j);
        }
        self.has_setpoint = *with_setpoint >= *settling;
        self.filled = (self.filled + 1).min(*settling);
        self.filled == *settling
    }

    /// Takes in motion that is known already: no delay, no differentiation.
    pub(crate) fn set(&mut self, motion: Motion<'_>, tau: &[f64], setpoint: Option<Setpoint<'_>>) {
        self.q.copy_from_slice(motion.q);
        self.qd.copy_from_slice(motion.qd);
        self.qdd.copy_from_slice(motion.qdd);
        self.tau.copy_from_slice(tau);
        self.has_setpoint = setpoint.is_some();
        if let Some(s) = setpoint {
            for (part, to) in [s.q, s.qd, s.qdd].iter().zip(self.desired.chunks_exact_mut(self.dof)) {
                to.copy_from_slice(part);
            }
        }
    }

    /// Positions, velocities, accelerations of the desired motion one after the other, if there was one.
    pub(crate) fn desired_mut(&mut self) -> Option<&mut [f64]> {
        self.has_setpoint.then_some(&mut self.desired[..])
    }

    /// The desired motion of the instant, if there was one.
    pub(crate) fn setpoint(&self) -> Option<Setpoint<'_>> {
        let n = self.dof;
        let d = &self.desired;
        self.has_setpoint.then(|| Motion { q: &d[..n], qd: &d[n..2 * n], qdd: &d[2 * n..] })
    }
}

/// Sum of products. Four partial sums: a window of hundreds of samples must not wait for one addition after another.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (fours_a, fours_b) = (a.chunks_exact(4), b.chunks_exact(4));
    let rest: f64 = fours_a.remainder().iter().zip(fours_b.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in fours_a.zip(fours_b) {
        for k in 0..4 {
            sums[k] += x[k] * y[k];
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cubic is its own best cubic: position, velocity and acceleration at the centre are exact.
    #[test]
    fn savitzky_golay_is_exact_on_cubics() {
        let t = 0.002;
        let cubic =
            |x: f64| (0.3 - 1.1 * x + 0.7 * x * x - 2.3 * x.powi(3), -1.1 + 1.4 * x - 6.9 * x * x, 1.4 - 13.8 * x);
        for half_width in [2, 10, 60] {
            let mut line = Aligned::new(1, Differentiator::SavitzkyGolay { half_width }, t);
            for i in 0..300 {
                let full = line.push(&[cubic(f64::from(i) * t).0], &[f64::from(i)], None);
                assert_eq!(full, i as usize >= 2 * half_width);
                if full {
                    let centre = f64::from(i) - half_width as f64;
                    let (q, qd, qdd) = cubic(centre * t);
                    assert!((line.q[0] - q).abs() < 1e-12, "{half_width}: {} vs {q}", line.q[0]);
                    // Rounding of positions is amplified by 1/T and 1/T².
                    assert!((line.qd[0] - qd).abs() < 1e-12 / t, "{half_width}: {} vs {qd}", line.qd[0]);
                    assert!((line.qdd[0] - qdd).abs() < 1e-12 / (t * t), "{half_width}: {} vs {qdd}", line.qdd[0]);
                    // The torque belongs to the same instant.
                    assert_eq!(line.tau[0], centre);
                }
            }
        }
    }

    /// Central difference of a sinusoid: gain sin(ωT)/ωT on velocity, (sin(ωT/2)/(ωT/2))² on acceleration.
    #[test]
    fn central_difference_has_its_known_gain() {
        let (t, w) = (0.004, 25.0_f64);
        let mut line = Aligned::new(1, Differentiator::Central, t);
        for i in 0..200 {
            if line.push(&[(w * f64::from(i) * t).sin()], &[0.0], None) {
                let centre = (f64::from(i) - 1.0) * t;
                let (half, whole) = (w * t / 2.0, w * t);
                let qd = w * (w * centre).cos() * whole.sin() / whole;
                let qdd = -w * w * (w * centre).sin() * (half.sin() / half).powi(2);
                assert!((line.qd[0] - qd).abs() < 1e-9 && (line.qdd[0] - qdd).abs() < 1e-7);
            }
        }
    }

    /// Position, velocity, acceleration, torque and setpoint of sinusoids leave the state filter together: cross-checked by
    /// the phase of each, to a millionth of a sample. Their common delay is three time constants.
    #[test]
    fn state_filter_keeps_all_signals_together() {
        let (t, hz) = (0.001, 60.0);
        let mut line = Aligned::new(1, Differentiator::StateFilter { hz }, t);
        for period in [2000, 500, 160] {
            line.restart();
            // Sine and cosine parts of what leaves, over whole periods.
            let (w, count) = (std::f64::consts::TAU / (f64::from(period) * t), 4 * period as usize);
            let mut parts = [[0.0; 2]; 7];
            let mut used = 0;
            for i in 0..2 * count {
                let (s, c) = (w * i as f64 * t).sin_cos();
                let motion = Motion { q: &[s], qd: &[w * c], qdd: &[-w * w * s] };
                let ready = line.push(&[s], &[s], Some(motion));
                if ready && i >= count {
                    let d = line.setpoint().expect("the setpoints have settled");
                    let values = [line.q[0], line.qd[0], line.qdd[0], line.tau[0], d.q[0], d.qd[0], d.qdd[0]];
                    parts.iter_mut().zip(values).for_each(|(p, v)| {
                        p[0] += v * s;
                        p[1] += v * c;
                    });
                    used += 1;
                }
            }
            assert_eq!(used, count);
            // Phase of a sine; velocity leads by a quarter, acceleration by half a period.
            let late = |k: usize, quarters: i32| {
                let [s, c] = parts[k];
                let (s, c) = (0..quarters).fold((s, c), |(s, c), _| (c, -s));
                -c.atan2(s) / (w * t)
            };
            let delays: Vec<f64> =
                [0, 1, 2, 0, 0, 1, 2].into_iter().enumerate().map(|(k, quarters)| late(k, quarters)).collect();
            println!("{w} rad/s: {delays:.5?} samples");
            let expected = 3.0 * (w / (std::f64::consts::TAU * hz)).atan() / (w * t);
            for delay in &delays {
                assert!((delay - delays[0]).abs() < 1e-6, "{delays:?}");
                assert!((delay - expected).abs() < 0.01, "{delay} {expected}");
            }
        }
    }

    #[test]
    fn setpoints_are_delayed_with_the_rest() {
        let mut line = Aligned::new(2, Differentiator::SavitzkyGolay { half_width: 3 }, 0.001);
        for i in 0..40 {
            let s = f64::from(i);
            let (q, qd, qdd) = ([s, -s], [s + 0.1, 0.0], [0.0, s + 0.2]);
            let setpoint = (i % 5 != 0).then_some(Motion { q: &q, qd: &qd, qdd: &qdd });
            if line.push(&[s, s], &[s, 2.0 * s], setpoint) {
                let centre = s - 3.0;
                assert_eq!(line.tau, [centre, 2.0 * centre]);
                match line.setpoint() {
                    None => assert_eq!((i - 3) % 5, 0),
                    Some(d) => {
                        assert_eq!((d.q, d.qd), (&[centre, -centre][..], &[centre + 0.1, 0.0][..]));
                        assert_eq!(d.qdd, [0.0, centre + 0.2]);
                    }
                }
            }
        }
    }
}
