//! Rows that bear witness for or against values: some of the window's, as they were measured.
//!
//! A stated variance holds for errors that the instruments do not see. With poor instruments (delayed by a good part of the
//! motion's period, say) what the model lacks does correlate with them, and a solution may be off by hundreds of the
//! deviations that it states. The measured regressor then tells: such a solution leaves more of the torque than the
//! nominal values do.
//!
//! ```text
//! c_j(x) = Σ over witnesses of (w(τ − dᵀx))²,   joint j by joint j
//! moved to:    c_j(new) ≤ slack·min(max(c_j(now), σ²) + promised, max(c_j(nominal), σ²))    for every j, or
//!              c_j(new) ≤ slack·max(c_j(now), σ²) for every j, and in the mean of all joints c_j(new) ≤ c_j(now)
//! taken back:  c_j(x) > refuted·max(c_j(nominal), σ²)   for a j, and in the mean of all joints c_j(x) > c_j(nominal)
//! ```
//!
//! promised is what directions that move may err by according to their tolerance, σ² what noise alone leaves: a difference below
//! it is chance. Rows that come in while a solution is being made are its witnesses already; a row that counts nothing (its joint
//! stands) says nothing. Least squares is not asked: where the regressor is noisy it leaves less than the truth. Witnesses do not weigh by
//! their age: with the weights of the window, bursts of instruments of long ago were refuted later.

use crate::kernels::{Lanes, times_three};
use crate::memory::{Carry, MANY};
use rivet_dynamics::MAX_JOINTS;

/// Instants that are kept.
const WITNESSES: usize = 24;
/// Instants before values that are in use can be refuted: neighbours are alike, so a few say as little as one.
const LEAST: usize = WITNESSES / 2;
/// New values may leave this many times the squares, at most. Residuals of the better of two models of a measured arm vary by as
/// much between motions.
const SLACK: f64 = 1.5;
/// Values that leave this many times the squares of the nominal ones are refuted. At twice, values that are right but for friction
/// that changed meanwhile were (manutec, staged workload: a seventh of the oracle's efficiency); bursts leave thousands of times.
const REFUTED: f64 = 9.0;
/// Entries are kept in single precision.
const MAX_STORED_ENTRY: f64 = 1e18;
/// Rows that recent residuals are the mean of.
const RECENT: f64 = 30.0;

/// Whose residuals are compared.
#[derive(Clone, Copy, Debug)]
enum Whose {
    Nominal,
    Now,
    New,
}

/// Witnesses, and what they have said so far. Nothing allocates after `new`.
#[derive(Clone, Debug)]
pub(super) struct Witnesses {
    n: usize,
    joints: usize,
    /// Scaled, weighted rows and torques of one instant after the other; zeros where there is none.
    rows: Vec<f32>,
    tau: Vec<f32>,
    kept: usize,
    /// Where the next one goes.
    next: usize,
    /// Updates from one to the next, now and at most, and how many have passed.
    stride: u64,
    longest: u64,
    passed: u64,
    squares: [Lanes; 3],
    /// Means of the squares of the last rows: nominal values, values of the time.
    recent: [Lanes; 2],
    /// Scaled parameters: the nominal ones, those of now and those in question.
    pub(super) nominal: Vec<f64>,
    pub(super) now: Vec<f64>,
    pub(super) new: Vec<f64>,
}

impl Witnesses {
    /// For `window` rows, of which as many witnesses as there are shall be spread over one time constant; the shortest window, where
    /// its length varies.
    pub(super) fn new(joints: usize, n: usize, window: f64) -> Witnesses {
        let zeros = || vec![0.0; n];
        Witnesses {
            n,
            joints,
            rows: vec![0.0; WITNESSES * joints * n],
            tau: vec![0.0; WITNESSES * joints],
            kept: 0,
            next: 0,
            stride: 1,
            longest: longest(window),
            passed: 0,
            squares: [[0.0; MAX_JOINTS]; 3],
            recent: [[0.0; MAX_JOINTS]; 2],
            nominal: zeros(),
            now: zeros(),
            new: zeros(),
        }
    }

    /// Goes on with the window of `fresh`.
    pub(super) fn reconfigure(&mut self, fresh: &Witnesses) {
        self.longest = fresh.longest;
        self.stride = self.stride.min(self.longest);
    }

    pub(super) fn carry(&mut self, carry: &mut Carry<'_>) {
        for single in self.rows.iter_mut().chain(&mut self.tau) {
            let mut value = f64::from(*single);
            carry.number(&mut value);
            *single = value as f32;
        }
        carry.place(&mut self.kept, WITNESSES + 1);
        carry.place(&mut self.next, WITNESSES);
        carry.whole(&mut self.stride, MANY);
        carry.whole(&mut self.passed, MANY);
        for squares in &mut self.recent {
            carry.sizes(squares);
        }
        self.stride = self.stride.max(1);
    }

    /// Nobody has seen anything: the arm may be another one.
    pub(super) fn restart(&mut self) {
        self.rows.fill(0.0);
        self.tau.fill(0.0);
        (self.kept, self.next, self.stride, self.passed) = (0, 0, 1, 0);
        self.recent = [[0.0; MAX_JOINTS]; 2];
    }

    /// Takes in the residuals of one row of joint `j` with the nominal values and with those of the time, weighted.
    pub(super) fn watch(&mut self, j: usize, residuals: [f64; 2]) {
        for (mean, residual) in self.recent.iter_mut().zip(residuals) {
            mean[j] += (residual * residual - mean[j]) / RECENT;
        }
    }

    /// Whether the last rows speak against the values of the time: not the arm is another one, the values were wrong. `noise` is
    /// the variance of a row.
    pub(super) fn recent_refute(&self, noise: f64) -> bool {
        let [nominal, now] = &self.recent;
        refuted(&now[..self.joints], &nominal[..self.joints], noise)
    }

    /// Takes in the rows of an instant, scaled and weighted.
    pub(super) fn add(&mut self, rows: &[f64], tau: &[f64]) {
        self.passed += 1;
        if self.passed < self.stride {
            return;
        }
        self.passed = 0;
        let size = self.joints * self.n;
        let at = self.next;
        copy(&mut self.rows[at * size..(at + 1) * size], rows);
        copy(&mut self.tau[at * self.joints..(at + 1) * self.joints], tau);
        self.kept = (self.kept + 1).min(WITNESSES);
        self.next = at + 1;
        if self.next < WITNESSES {
            return;
        }
        self.next = 0;
        if self.stride < self.longest {
            // Every other one goes: the rest is spread twice as wide, and the next ones come half as often.
            for slot in 0..WITNESSES / 2 {
                let from = 2 * slot + 1;
                self.rows.copy_within(from * size..(from + 1) * size, slot * size);
                self.tau.copy_within(from * self.joints..(from + 1) * self.joints, slot * self.joints);
            }
            self.rows[WITNESSES / 2 * size..].fill(0.0);
            self.tau[WITNESSES / 2 * self.joints..].fill(0.0);
            (self.kept, self.next) = (WITNESSES / 2, WITNESSES / 2);
            self.stride = (2 * self.stride).min(self.longest);
        }
    }

    /// Instants to be asked.
    pub(super) const fn count() -> usize {
        WITNESSES
    }

    /// Multiply-adds of one of them.
    pub(super) fn cost(&self) -> usize {
        3 * self.joints * self.n
    }

    /// Before the first is asked.
    pub(super) fn begin(&mut self) {
        self.squares = [[0.0; MAX_JOINTS]; 3];
    }

    /// What instant `at` says.
    pub(super) fn ask(&mut self, at: usize) {
        let instant = at * self.joints..(at + 1) * self.joints;
        let rows = &self.rows[instant.start * self.n..instant.end * self.n];
        let mut torques = [[0.0; 3]; MAX_JOINTS];
        times_three(rows, [&self.nominal, &self.now, &self.new], &mut torques[..self.joints]);
        for (j, (&tau, torques)) in self.tau[instant].iter().zip(torques).enumerate() {
            for (squares, torque) in self.squares.iter_mut().zip(torques) {
                squares[j] += (f64::from(tau) - torque).powi(2);
            }
        }
    }

    fn squares(&self, whose: Whose) -> &[f64] {
        &self.squares[whose as usize][..self.joints]
    }

    /// Whether the values in question may be moved to. `noise` is the variance of a row, `promised` what errors that are
    /// tolerated may add to it.
    pub(super) fn admit(&self, noise: f64, promised: f64) -> bool {
        let [noise, promised] = [noise, promised].map(|variance| variance * self.kept as f64);
        let [nominal, now, new] = [Whose::Nominal, Whose::Now, Whose::New].map(|whose| self.squares(whose));
        let (mut fits, mut near, mut change) = (true, true, 0.0);
        for ((new, now), nominal) in new.iter().zip(now).zip(nominal) {
            fits &= *new <= SLACK * (now.max(noise) + promised).min(nominal.max(noise));
            near &= *new <= SLACK * now.max(noise);
            change += (new - now) / nominal.max(noise).max(f64::MIN_POSITIVE);
        }
        // What is no number is not admitted.
        fits || near && change <= 0.0
    }

    /// Whether the values of now are refuted, or (`new`) those in question.
    pub(super) fn refute(&self, new: bool, noise: f64) -> bool {
        let whose = if new { Whose::New } else { Whose::Now };
        let noise = noise * self.kept as f64;
        self.kept >= LEAST && refuted(self.squares(whose), self.squares(Whose::Nominal), noise)
    }
}

/// By squares of all joints.
fn refuted(squares: &[f64], nominal: &[f64], noise: f64) -> bool {
    let over = |(x, nominal): (&f64, &f64)| x / nominal.max(noise).max(f64::MIN_POSITIVE);
    let (mut most, mut sum) = (0.0_f64, 0.0);
    for over in squares.iter().zip(nominal).map(over) {
        (most, sum) = (most.max(over), sum + over);
    }
    most > REFUTED && sum > squares.len() as f64
}

/// Updates between witnesses that spread them over `window` rows.
fn longest(window: f64) -> u64 {
    (window / WITNESSES as f64).round().clamp(1.0, 1e12) as u64
}

fn copy(out: &mut [f32], from: &[f64]) {
    for (out, x) in out.iter_mut().zip(from) {
        *out = x.clamp(-MAX_STORED_ENTRY, MAX_STORED_ENTRY) as f32;
    }
}
