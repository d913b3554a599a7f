//! Every direction of the parameter space judged at recursive cost: the paper's open question (3.2.4).
//!
//! The information of the instruments lives in a basis that follows it ([`Rotations`]); its diagonal then stands for the
//! eigenvalues, and any direction can be held. What moves is solved for in one elimination in the order of falling
//! information: a pivot says what a direction adds to those before it, so promises that M does not keep (instruments that
//! describe another motion, delayed ones above all) are found out in the same pass. Directions are known by their place
//! in the basis: it turns by small angles, so they keep their history. Nothing here shares code with the decomposition of
//! [`Directions`](super::Directions).
//!
//! No operation of order n³ beyond the elimination (n³/3), no iteration, no branch that changes the number of operations.

mod elimination;
mod judgement;
#[cfg(test)]
mod tests;

use super::rotations::Rotations;
use super::{Covectors, Known};
use crate::kernels::{add_transposed_times, times};
use crate::memory::Carry;
use crate::report::Verdict;
use crate::scales::Whitening;
use crate::settings::TrackedSettings;
use elimination::Elimination;
use judgement::{Diagonal, Share, share};

/// Information below this share of the largest is rounding of sums that have been rotated many times.
const ROTATED_SUM_ROUNDING: f64 = 1e-12;
/// A direction that moves may be this much more uncertain than its threshold says.
const VARIANCE_SLACK: f64 = 2.0;
/// A step in which a direction is this much more uncertain than it may be is not taken at all.
const CANCEL: f64 = 8.0;
/// While the basis lags, directions that are held leave entries in the rows of those that move, and their error comes in:
/// its variance, over what the direction may have. A compromise: with 2, what the staged workload identifies begins to move
/// too late (local efficiency 0.947); with 10 and without the guard the first seconds of a light arm burst, and 4 does not
/// quite prevent it.
const LAG_SLACK: f64 = 4.0;
/// A direction that moves already may owe this many times more to held ones.
const LAG_HYSTERESIS: f64 = 4.0;
/// Each time a direction breaks its promise it rests twice as long as before, at most 2 to this power times the dwell.
const MOST_STRIKES: u32 = 6;
/// A direction that has moved for this many dwells is trusted again.
const TRUST: u32 = 8;
/// How many directions a step weighs against what is known already.
const WEIGHED: usize = 12;
/// Periods that a step waits for at most, from its rows on.
const LONGEST_WAIT: u32 = 64;
/// Steps in one time constant of the window, if there are as many rows.
const STEPS: f64 = 1000.0;
/// Rows from step to step at most, and where nothing is forgotten. Further apart, rounds of rotations do not follow what comes in:
/// with 64, a window of an hour and a row every 20 ms one parameter of 58 moved in 50 s of motion, with 5 46.
const MAX_STEP_ROWS: f64 = 5.0;
/// Where more come in this time \[s\], as many as do, up to twice as many: with as many rounds a row, five or eight at 1 kHz identify the same.
const MOST_S: f64 = 0.008;
const ROWS_FOR_EVER: f64 = 1.0;
/// Sweeps that bring any basis to the information, for use off the real-time path.
const SWEEPS: usize = 8;

/// What is remembered of one direction while the basis turns.
#[derive(Clone, Copy, Debug)]
struct Direction {
    active: bool,
    /// Variance of what is known along it, at least the tolerance's \[torque-noise sigma²\].
    allowed: f64,
    /// Variance of its value if it is held, without any caution.
    width: f64,
    /// Rows it must rest before it may move again.
    rest: u32,
    /// Rows it has moved.
    moved: u32,
    strikes: u32,
}

impl Direction {
    /// Broke its promise.
    fn strike(&mut self, dwell: u32) {
        self.rest = (dwell << self.strikes) + 1;
        self.strikes = (self.strikes + 1).min(MOST_STRIKES);
    }
}

/// State of the scheme. Arrays have an entry for each place of the basis, and zeros up to its stride.
#[derive(Clone, Debug)]
pub(crate) struct Tracked {
    settings: TrackedSettings,
    n: usize,
    basis: Rotations,
    directions: Vec<Direction>,
    diagonal: Diagonal,
    /// Places in the order of falling information.
    order: Vec<usize>,
    active: Vec<bool>,
    elimination: Elimination,
    covectors: Covectors,
    x: Vec<f64>,
    /// What directions that move do not see of a parameter, n.
    unseen: Vec<f64>,
    shares: Vec<f64>,
    residual: Vec<f64>,
    scratch: Vec<f64>,
    next: usize,
    /// Rows from step to step, and how many have come in since the last one.
    rows: u32,
    pending: u32,
    /// Periods since the last row, and from row to row.
    since: u32,
    interval: u32,
    /// Rounds since the last step.
    rounds: u32,
}

impl Tracked {
    /// For n parameters, p rows at a time, the weight `lambda` of the past and the time from row to row \[s\], where that is known.
    pub(crate) fn new(n: usize, p: usize, settings: TrackedSettings, lambda: f64, row_s: Option<f64>) -> Tracked {
        let most =
            row_s.map_or(MAX_STEP_ROWS, |row_s| (MOST_S / row_s).round().clamp(MAX_STEP_ROWS, 2.0 * MAX_STEP_ROWS));
        let rows = if lambda < 1.0 { 1.0 / ((1.0 - lambda) * STEPS) } else { ROWS_FOR_EVER };
        let basis = Rotations::new(n, p);
        let stride = basis.stride();
        let zeros = || vec![0.0; stride];
        let still =
            Direction { active: false, allowed: settings.tolerance.powi(2), width: 0.0, rest: 0, moved: 0, strikes: 0 };
        Tracked {
            settings,
            n,
            basis,
            directions: vec![still; n],
            diagonal: Diagonal::new(stride),
            order: vec![0; n],
            active: vec![false; n],
            elimination: Elimination::new(n, stride),
            covectors: Covectors::new(n),
            x: zeros(),
            unseen: vec![0.0; n],
            shares: zeros(),
            residual: zeros(),
            scratch: zeros(),
            next: 0,
            rows: rows.round().clamp(1.0, most) as u32,
            pending: 0,
            since: 0,
            interval: LONGEST_WAIT,
            rounds: 0,
        }
    }

    /// Goes on with other thresholds, and steps as far apart as those of `fresh`.
    pub(crate) fn reconfigure(&mut self, fresh: &Tracked) {
        (self.settings, self.rows) = (fresh.settings, fresh.rows);
    }

    pub(crate) fn carry(&mut self, carry: &mut Carry<'_>) {
        self.basis.carry(carry);
        let many = u32::MAX;
        for direction in &mut self.directions {
            carry.flag(&mut direction.active);
            carry.sizes(std::slice::from_mut(&mut direction.allowed));
            carry.sizes(std::slice::from_mut(&mut direction.width));
            carry.small(&mut direction.rest, many);
            carry.small(&mut direction.moved, many);
            carry.small(&mut direction.strikes, MOST_STRIKES + 1);
        }
        carry.place(&mut self.next, self.n);
        carry.small(&mut self.pending, many);
        carry.small(&mut self.since, many);
        carry.small(&mut self.interval, LONGEST_WAIT + 1);
        carry.small(&mut self.rounds, many);
        // Both divide.
        self.interval = self.interval.max(1);
    }

    pub(crate) fn settings(&self) -> TrackedSettings {
        self.settings
    }

    /// Nothing in the window, nothing remembered of directions; the basis stays.
    pub(crate) fn restart(&mut self) {
        self.basis.forget();
        self.elimination.restart();
        for direction in &mut self.directions {
            (direction.active, direction.rest, direction.moved, direction.strikes) = (false, 0, 0, 0);
            // Weighed anew by the next steps; until then nothing is allowed to move by what was known before.
            (direction.allowed, direction.width) = (self.settings.tolerance.powi(2), 0.0);
        }
        self.next = 0;
        self.pending = 0;
    }

    /// Takes in rows (working coordinates).
    pub(crate) fn add(&mut self, lambda: f64, z: &[f64], d: &[f64], tau: &[f64]) {
        self.interval = self.since.clamp(1, LONGEST_WAIT);
        if self.pending >= self.rows {
            // Sooner than expected: the step is due at once.
            self.interval = 1;
        }
        if self.pending == 0 {
            self.rounds = 0;
        }
        (self.pending, self.since) = (self.pending.saturating_add(1), 0);
        self.basis.add(lambda, z, d, tau);
    }

    /// Turns the basis after the information, once a period: the rounds of a step are spread over the periods until it. True
    /// when it is time to [`solve`](Self::solve): as late as another period before the next rows allows, because what has turned furthest
    /// sees best.
    pub(crate) fn turn(&mut self) -> bool {
        self.since = self.since.saturating_add(1);
        if self.pending == 0 {
            return false;
        }
        let periods = if self.has_another_period() { self.interval - 1 } else { 1 };
        let [rows, pending, since, periods] = [self.rows, self.pending, self.since, periods].map(u64::from);
        // Further apart, as many turns a row.
        let most = self.settings.rounds as u64 * rows.max(MAX_STEP_ROWS as u64) / MAX_STEP_ROWS as u64;
        let due = (most * ((pending - 1) * periods + since.min(periods))).div_ceil(rows * periods).min(most);
        while u64::from(self.rounds) < due {
            self.round();
            self.rounds += 1;
        }
        let last = pending >= rows && since >= periods;
        if last {
            self.basis.orthonormalise_one();
        }
        last
    }

    /// Whether rows leave a period free for what comes after a solution.
    pub(crate) fn has_another_period(&self) -> bool {
        self.interval > 1
    }

    fn round(&mut self) {
        for k in self.basis.round() {
            self.directions.swap(k, k + 1);
        }
    }

    /// Turns the basis until it stands. Not for the real-time path.
    pub(crate) fn align(&mut self, known: Known<'_>) {
        for _ in 0..SWEEPS * self.n {
            self.round();
            self.basis.orthonormalise_one();
        }
        self.weigh(known, self.n);
        for direction in &mut self.directions {
            direction.rest = 0;
        }
    }

    /// Directions (n entries each) and which of them moved in the last step.
    pub(crate) fn directions(&self) -> impl Iterator<Item = (&[f64], bool)> + '_ {
        self.directions.iter().enumerate().map(|(k, direction)| (self.basis.direction(k), direction.active))
    }

    /// Judges, solves, and moves `x` (working coordinates, n). `active` and `verdict` say what moved; false if nothing.
    pub(crate) fn solve(
        &mut self,
        known: Known<'_>,
        x: &mut [f64],
        active: &mut [bool],
        verdict: &mut Verdict,
    ) -> bool {
        let n = self.n;
        let rows = std::mem::take(&mut self.pending);
        self.weigh(known, WEIGHED);
        self.judge(known.variance, rows);
        self.x[..n].copy_from_slice(x);
        self.eliminate(known.variance);
        let sound = self.back_substitute(known.variance);
        for direction in &mut self.directions {
            direction.moved = if direction.active { direction.moved.saturating_add(rows) } else { 0 };
            if direction.moved > TRUST * self.settings.dwell {
                direction.strikes = 0;
            }
        }
        for (active, direction) in self.active.iter_mut().zip(&self.directions) {
            *active = direction.active;
        }
        // `x ← x + Σ δ_k·v_k` over what is active: held directions do not move, to rounding. A step that is not taken costs as
        // much.
        self.shares.fill(0.0);
        for (place, &k) in self.order.iter().enumerate() {
            self.shares[k] = if self.active[k] { self.elimination.step[place] } else { 0.0 };
        }
        add_transposed_times(self.basis.directions(), &self.shares, &mut self.x);
        let taken = sound && self.x.iter().all(|x| x.is_finite());
        if taken {
            x.copy_from_slice(&self.x[..n]);
        }
        let moved = taken && self.active.iter().any(|active| *active);
        self.report(active, verdict);
        // After a step that was not taken, the next one knows better what to leave out.
        self.strike();
        moved
    }

    /// What is known along the next `count` directions.
    fn weigh(&mut self, known: Known<'_>, count: usize) {
        let (n, least) = (self.n, self.settings.tolerance.powi(2));
        let mut remaining = count.min(n);
        while remaining > 0 {
            let some = remaining.min(4);
            let places: [usize; 4] = std::array::from_fn(|i| (self.next + i) % n);
            let directions = places.map(|k| self.basis.direction(k));
            let known_by = [known.belief, known.width];
            let [belief, width] = self.covectors.variances(&directions[..some], known.whitening, known_by);
            for (&k, (belief, width)) in places[..some].iter().zip(belief.into_iter().zip(width)) {
                (self.directions[k].allowed, self.directions[k].width) = (belief.max(least), width);
            }
            self.next = (self.next + some) % n;
            remaining -= some;
        }
    }

    /// Which directions the instruments identify. While the basis lags, the diagonal counts information of strong
    /// directions for weak ones (what the entries between them allow is taken off: second-order perturbation), and the
    /// errors of held directions enter those that move.
    fn judge(&mut self, variance: f64, rows: u32) {
        let n = self.n;
        self.basis.mirror();
        let diagonal = |k: usize| self.basis.diagonal(k);
        let resting_width = |k: usize| if self.directions[k].active { 0.0 } else { self.directions[k].width };
        let largest = self.diagonal.set(n, diagonal, resting_width);
        for k in 0..n {
            let marginal = self.diagonal.value(k);
            let Share { place, stronger, held } = share(self.basis.information(k), &self.diagonal, k, n);
            self.order[place] = k;
            let information = if self.settings.deflation { marginal - stronger } else { marginal };
            let ratio = self.basis.cross(k)[k] / marginal;
            let relevance = self.settings.relevance;
            let relevant = ratio > relevance && (relevance == 0.0 || ratio < 1.0 / relevance);
            let direction = &mut self.directions[k];
            let (threshold, owed) = if direction.active {
                (self.settings.hysteresis * variance / direction.allowed, LAG_HYSTERESIS * LAG_SLACK)
            } else {
                (variance / direction.allowed, LAG_SLACK)
            };
            direction.rest = direction.rest.saturating_sub(rows);
            let identified = information > threshold && marginal > ROTATED_SUM_ROUNDING * largest;
            let apart = !self.settings.deflation || held <= owed * direction.allowed * marginal * marginal;
            let active = identified && apart && relevant && direction.rest == 0;
            if direction.active && !active {
                direction.rest = self.settings.dwell;
            }
            direction.active = active;
        }
    }

    /// `A_aa = L·U` and `L⁻¹·(b − A·x)_a` in falling order of information. A direction whose pivot, what it adds to those
    /// before it, does not keep the promise is left out on the way.
    fn eliminate(&mut self, variance: f64) {
        let n = self.n;
        self.basis.shares(&self.x, &mut self.shares);
        times(self.basis.all_cross(), &self.shares, &mut self.residual);
        for (residual, b) in self.residual.iter_mut().zip(self.basis.right_hand_side()) {
            *residual = b - *residual;
        }
        for (active, direction) in self.active.iter_mut().zip(&self.directions) {
            *active = direction.active;
        }
        self.elimination.load(&self.order, &self.active, self.basis.all_cross(), &self.residual);
        for place in 0..n {
            let k = self.order[place];
            let solo_variance = variance * self.diagonal.value(k);
            let direction = &mut self.directions[k];
            let pivot = self.elimination.pivot(place);
            let kept = pivot > 0.0 && solo_variance <= VARIANCE_SLACK * direction.allowed * pivot * pivot;
            if direction.active && !kept {
                direction.active = false;
                direction.strike(self.settings.dwell);
            }
            self.elimination.advance(place, direction.active);
        }
    }

    /// `δ = U⁻¹·…`, and with it the variance of each direction, those of the weaker ones counted as independent. False if
    /// one is so uncertain that the step is better not taken.
    fn back_substitute(&mut self, variance: f64) -> bool {
        let mut sound = true;
        for place in (0..self.n).rev() {
            let k = self.order[place];
            let direction = &self.directions[k];
            let solo_variance = if direction.active { variance * self.diagonal.value(k) } else { 0.0 };
            let total = self.elimination.back_substitute(place, solo_variance);
            sound &= !direction.active || total <= CANCEL * direction.allowed;
        }
        sound
    }

    /// Directions that turned out more uncertain than promised rest.
    fn strike(&mut self) {
        for (place, &k) in self.order.iter().enumerate() {
            let direction = &mut self.directions[k];
            if direction.active && self.elimination.variance[place] > VARIANCE_SLACK * direction.allowed {
                direction.strike(self.settings.dwell);
            }
        }
    }

    fn report(&self, active: &mut [bool], verdict: &mut Verdict) {
        let (mut trace, mut largest, mut smallest, mut count) = (0.0, 0.0_f64, f64::INFINITY, 0);
        for (k, out) in active.iter_mut().enumerate() {
            let information = self.diagonal.value(k);
            *out = self.active[k];
            trace += information;
            largest = largest.max(information);
            if self.active[k] {
                smallest = smallest.min(information);
                count += 1;
            }
        }
        *verdict = Verdict {
            active: count,
            of: self.n,
            suspended: false,
            trace,
            log_determinant: judgement::log_product((0..self.n).map(|k| self.diagonal.value(k))),
            condition: if count > 0 { largest / smallest } else { f64::NAN },
        };
    }

    /// Variances of scaled parameter i: of what moves, of what is held (standard deviations `stated`) and of what is held as decisions
    /// count it (`width`). As the estimator's other schemes have them, `VA⁻ᵀVᵀa` left in `covector`; asks for the elimination of the same
    /// period.
    pub(crate) fn variance_of(
        &mut self,
        i: usize,
        variance: f64,
        [stated, width]: [&[f64]; 2],
        whitening: Option<&Whitening>,
        covector: &mut [f64],
    ) -> [f64; 3] {
        let n = self.n;
        self.x.fill(0.0);
        match whitening {
            Some(whitening) => (i..n).for_each(|k| self.x[k] = whitening.share(i, k)),
            None => self.x[i] = 1.0,
        }
        // Shares of what moves; what is left in x is held.
        self.basis.shares(&self.x, &mut self.shares);
        for (share, active) in self.shares.iter_mut().zip(&self.active) {
            *share = if *active { *share } else { 0.0 };
        }
        for (place, &k) in self.order.iter().enumerate() {
            self.residual[place] = self.shares[k];
        }
        for share in &mut self.shares {
            *share = -*share;
        }
        add_transposed_times(self.basis.directions(), &self.shares, &mut self.x);
        self.elimination.solve_transposed(&mut self.residual);
        for (place, &k) in self.order.iter().enumerate() {
            self.shares[k] = self.residual[place];
        }
        self.unseen.copy_from_slice(&self.x[..n]);
        self.scratch.fill(0.0);
        add_transposed_times(self.basis.directions(), &self.shares, &mut self.scratch);
        covector.copy_from_slice(&self.scratch[..n]);
        // What the error of held directions is taken for in what moves.
        self.residual.fill(0.0);
        add_transposed_times(self.basis.all_cross(), &self.shares, &mut self.residual);
        for (taken, active) in self.residual.iter_mut().zip(&self.active) {
            *taken = if *active { 0.0 } else { -*taken };
        }
        add_transposed_times(self.basis.directions(), &self.residual, &mut self.x);
        times(self.basis.all_information(), &self.shares, &mut self.residual);
        let moving: f64 = self.shares[..n].iter().zip(&self.residual).map(|(u, e)| u * e).sum();
        let unseen = [&self.x[..n], &self.unseen];
        let [held, taken] = self.covectors.variances(&unseen, whitening, [stated, width]);
        [variance * moving, held[0], taken[1]]
    }
}
