//! Every direction of the parameter space judged at recursive cost: the paper's open question (3.2.4).
//!
//! The information of the instruments lives in a basis that follows it ([`Rotations`]); its diagonal then stands for the
//! eigenvalues, and any direction can be held. What moves is solved for in one elimination in the order of falling
//! information: a pivot says what a direction adds to those before it, so promises that M does not keep (instruments that
//! describe another motion, delayed ones above all) are found out in the same pass. Directions are known by their place
//! in the basis: it turns by small angles, so they keep their history. Nothing here shares code with the decomposition of
//! [`Directions`](super::Directions), the reference.
//!
//! No operation of order n³ beyond the elimination (n³/3), no iteration, no branch that changes the number of operations.

use super::Known;
use super::rotations::{Rotations, destination};
use crate::linear::{axpy, dot};
use crate::report::Verdict;
use crate::scales::Whitening;
use crate::settings::TrackedSettings;
use multiversion::multiversion;

/// Information below this share of the largest is rounding of sums that have been rotated many times.
const ROUNDING: f64 = 1e-12;
/// A direction that moves may be this much more uncertain than its threshold says.
const VARIANCE_SLACK: f64 = 2.0;
/// A step in which a direction is this much more uncertain than it may be is not taken at all.
const CANCEL: f64 = 8.0;
/// Each time a direction breaks its promise it rests twice as long as before, at most 2 to this power times the dwell.
const MOST_STRIKES: u32 = 6;
/// A direction that has moved for this many dwells is trusted again.
const TRUST: u32 = 8;
/// How many directions a period weighs against what is known already.
const WEIGHED: usize = 12;
/// Periods that a step waits for at most, from its rows on.
const LONGEST_WAIT: u32 = 64;
/// Sweeps that bring any basis to the information, for use off the real-time path.
const SWEEPS: usize = 8;

/// What is remembered of one direction while the basis turns.
#[derive(Clone, Copy, Debug)]
struct Direction {
    active: bool,
    /// Variance of what is known along it, at least the tolerance's \[torque-noise sigma²\].
    allowed: f64,
    /// Rows it must rest before it may move again.
    rest: u32,
    /// Rows it has moved.
    moved: u32,
    strikes: u32,
}

/// State of the scheme. Arrays have an entry for each place of the basis.
#[derive(Clone, Debug)]
pub(crate) struct Tracked {
    settings: TrackedSettings,
    basis: Rotations,
    directions: Vec<Direction>,
    moving: Vec<Direction>,
    /// Information of each direction, less what stronger ones may share of it.
    deflated: Vec<f64>,
    /// Places in the order of falling information, and where each stands in it.
    order: Vec<usize>,
    active: Vec<bool>,
    /// The elimination: U with pivots on the diagonal, L below, in `order`.
    lu: Vec<f64>,
    step: Vec<f64>,
    variance: Vec<f64>,
    x: Vec<f64>,
    scratch: Vec<f64>,
    unseen: Vec<f64>,
    next: usize,
    /// Rows came in that no step has used; periods since they did, and usually from rows to rows.
    pending: bool,
    since: u32,
    interval: u32,
}

impl Tracked {
    /// For n parameters and p rows.
    pub(crate) fn new(n: usize, p: usize, settings: TrackedSettings) -> Tracked {
        let basis = Rotations::new(n, p);
        let width = basis.width();
        let zeros = || vec![0.0; width];
        let still = Direction { active: false, allowed: settings.tolerance.powi(2), rest: 0, moved: 0, strikes: 0 };
        Tracked {
            settings,
            basis,
            directions: vec![still; width],
            moving: vec![still; width],
            deflated: zeros(),
            order: vec![0; width],
            active: vec![false; width],
            lu: vec![0.0; width * width],
            step: zeros(),
            variance: zeros(),
            x: zeros(),
            scratch: zeros(),
            unseen: vec![0.0; n],
            next: 0,
            pending: false,
            since: 0,
            interval: LONGEST_WAIT,
        }
    }

    pub(crate) fn settings(&self) -> TrackedSettings {
        self.settings
    }

    /// Nothing in the window, nothing remembered of directions; the basis stays.
    pub(crate) fn restart(&mut self) {
        self.basis.forget();
        self.lu.fill(0.0);
        for direction in &mut self.directions {
            (direction.active, direction.rest, direction.moved, direction.strikes) = (false, 0, 0, 0);
            // Weighed anew by the next periods; until then nothing is allowed to move by what was known before.
            direction.allowed = self.settings.tolerance.powi(2);
        }
        self.next = 0;
        self.pending = false;
    }

    /// Takes in rows (working coordinates).
    pub(crate) fn add(&mut self, lambda: f64, z: &[f64], d: &[f64], tau: &[f64]) {
        self.interval = self.since.clamp(1, LONGEST_WAIT);
        if self.pending {
            // Sooner than expected: the step is due at once.
            self.interval = 1;
        }
        (self.pending, self.since) = (true, 0);
        self.basis.add(lambda, z, d, tau);
    }

    /// Turns the basis after the information, once a period. True when it is time to [`solve`](Self::solve): in the last
    /// period before the next rows, because what has turned furthest sees best.
    pub(crate) fn turn(&mut self) -> bool {
        let width = self.basis.width();
        for _ in 0..self.settings.rounds {
            self.basis.round();
            for (k, direction) in self.directions.iter().enumerate() {
                self.moving[destination(k, width)] = *direction;
            }
            std::mem::swap(&mut self.directions, &mut self.moving);
        }
        self.basis.orthonormalise_one();
        self.since = self.since.saturating_add(1);
        self.pending && self.since >= self.interval
    }

    /// Turns the basis until it stands. Not for the real-time path.
    pub(crate) fn align(&mut self, known: Known<'_>) {
        let rounds = self.basis.width() * SWEEPS;
        for _ in 0..rounds.div_ceil(self.settings.rounds) {
            self.turn();
        }
        self.weigh(known, self.basis.width());
        for direction in &mut self.directions {
            direction.rest = 0;
        }
    }

    /// Directions (n entries each) and which of them moved in the last step.
    pub(crate) fn directions(&self) -> impl Iterator<Item = (&[f64], bool)> + '_ {
        (0..self.basis.width())
            .filter(|&k| self.is_real(k))
            .map(|k| (self.basis.direction(k), self.directions[k].active))
    }

    /// Whether place k is a direction of the parameters: with an odd number of them, one place is not.
    fn is_real(&self, k: usize) -> bool {
        self.basis.direction(k).iter().any(|x| *x != 0.0)
    }

    /// Judges, solves, and moves `x` (working coordinates, n). `active` and `verdict` say what moved; false if nothing.
    pub(crate) fn solve(
        &mut self,
        known: Known<'_>,
        x: &mut [f64],
        active: &mut [bool],
        verdict: &mut Verdict,
    ) -> bool {
        let n = x.len();
        self.pending = false;
        self.weigh(known, WEIGHED);
        self.judge(known.variance);
        self.eliminate(known.variance, x);
        let sound = self.back_substitute(known.variance);
        for (k, direction) in self.directions.iter_mut().enumerate() {
            self.active[k] = direction.active;
            direction.moved = if direction.active { direction.moved.saturating_add(1) } else { 0 };
            if direction.moved > TRUST * self.settings.dwell {
                direction.strikes = 0;
            }
        }
        let mut moved = false;
        if sound {
            // `x ← x + Σ δ_k·v_k` over what is active: held directions do not move, to rounding.
            self.scratch[..n].copy_from_slice(x);
            for (place, &k) in self.order.iter().enumerate() {
                let step = if self.active[k] { self.step[place] } else { 0.0 };
                axpy(step, self.basis.direction(k), &mut self.scratch[..n]);
            }
            if self.scratch[..n].iter().all(|x| x.is_finite()) {
                x.copy_from_slice(&self.scratch[..n]);
                moved = self.active.iter().any(|active| *active);
            }
        }
        self.report(active, verdict);
        // After a step that was not taken, the next one knows better what to leave out.
        self.strike();
        moved
    }

    /// What is known along the next `count` directions.
    fn weigh(&mut self, known: Known<'_>, count: usize) {
        let width = self.basis.width();
        let least = self.settings.tolerance.powi(2);
        for _ in 0..count.min(width) {
            let k = self.next;
            self.next = if k + 1 == width { 0 } else { k + 1 };
            let v = self.basis.direction(k);
            let n = v.len();
            match known.whitening {
                Some(whitening) => whitening.covector(v, &mut self.scratch[..n]),
                None => self.scratch[..n].copy_from_slice(v),
            }
            let variance: f64 = self.scratch.iter().zip(known.belief).map(|(c, b)| (c * b).powi(2)).sum();
            self.directions[k].allowed = variance.max(least);
        }
    }

    /// Which directions the instruments identify. While the basis lags, the diagonal counts information of strong
    /// directions for weak ones: what the entries between them allow is taken off (second-order perturbation).
    fn judge(&mut self, variance: f64) {
        let width = self.basis.width();
        let mut largest = 0.0_f64;
        for k in 0..width {
            largest = largest.max(self.basis.diagonal(k));
        }
        for k in 0..width {
            let own = self.basis.diagonal(k);
            let (mut shared, mut place) = (0.0, 0_usize);
            for (j, e) in self.basis.information(k).iter().enumerate() {
                let other = self.basis.diagonal(j);
                let stronger = other > own || (other == own && j < k);
                place += usize::from(stronger);
                shared += if stronger { e * e / other.max(f64::MIN_POSITIVE) } else { 0.0 };
            }
            self.deflated[k] = if self.settings.deflation { own - shared } else { own };
            self.order[place] = k;
            let ratio = self.basis.cross(k)[k] / own;
            let relevance = self.settings.relevance;
            let relevant = ratio > relevance && (relevance == 0.0 || ratio < 1.0 / relevance);
            let direction = &mut self.directions[k];
            let threshold = variance / direction.allowed;
            let threshold = if direction.active { self.settings.hysteresis * threshold } else { threshold };
            direction.rest = direction.rest.saturating_sub(1);
            let identified = self.deflated[k] > threshold && own > ROUNDING * largest;
            let active = identified && relevant && direction.rest == 0;
            if direction.active && !active {
                direction.rest = self.settings.dwell;
            }
            direction.active = active;
        }
    }

    /// `A_aa = L·U` and `L⁻¹·(b − A·x)_a` in falling order of information. A direction whose pivot, what it adds to those
    /// before it, does not keep the promise is left out on the way; those left out are rows and columns of the identity.
    fn eliminate(&mut self, variance: f64, x: &[f64]) {
        let width = self.basis.width();
        self.basis.shares(x, &mut self.x);
        for (place, &k) in self.order.iter().enumerate() {
            let row = self.basis.cross(k);
            let active = self.directions[k].active;
            let residual = self.basis.right_hand_side()[k] - dot(row, &self.x);
            self.step[place] = if active { residual } else { 0.0 };
            let out = &mut self.lu[place * width..(place + 1) * width];
            for (j, (out, &l)) in out.iter_mut().zip(&self.order).enumerate() {
                let both = active && self.directions[l].active;
                *out = if both { row[l] } else { f64::from(u8::from(j == place)) };
            }
        }
        for place in 0..width {
            let k = self.order[place];
            let own = self.basis.diagonal(k);
            let direction = &mut self.directions[k];
            let pivot = self.lu[place * width + place];
            let kept = pivot > 0.0 && variance * own <= VARIANCE_SLACK * direction.allowed * pivot * pivot;
            if direction.active && !kept {
                direction.active = false;
                direction.rest = self.settings.dwell << direction.strikes;
                direction.strikes = (direction.strikes + 1).min(MOST_STRIKES);
            }
            if !direction.active {
                self.lu[place * width..(place + 1) * width].fill(0.0);
                self.lu[place * width + place] = 1.0;
                self.step[place] = 0.0;
            }
            eliminate_below(&mut self.lu, &mut self.step, place, direction.active);
        }
    }

    /// `δ = U⁻¹·…`, and with it the variance of each direction, those of the weaker ones counted as independent. False if
    /// one is so uncertain that the step is better not taken.
    fn back_substitute(&mut self, variance: f64) -> bool {
        let width = self.basis.width();
        let mut sound = true;
        for place in (0..width).rev() {
            let k = self.order[place];
            let row = &self.lu[place * width..(place + 1) * width];
            let pivot = row[place];
            self.step[place] = (self.step[place] - dot(&row[place + 1..], &self.step[place + 1..])) / pivot;
            let weaker: f64 = row[place + 1..].iter().zip(&self.variance[place + 1..]).map(|(u, v)| u * u * v).sum();
            let own = variance * self.basis.diagonal(k);
            let direction = &self.directions[k];
            self.variance[place] = if direction.active { (own + weaker) / (pivot * pivot) } else { 0.0 };
            sound &= !direction.active || self.variance[place] <= CANCEL * direction.allowed;
        }
        sound
    }

    /// Directions that turned out more uncertain than promised rest.
    fn strike(&mut self) {
        for (place, &k) in self.order.iter().enumerate() {
            let direction = &mut self.directions[k];
            if direction.active && self.variance[place] > VARIANCE_SLACK * direction.allowed {
                direction.rest = (self.settings.dwell << direction.strikes) + 1;
                direction.strikes = (direction.strikes + 1).min(MOST_STRIKES);
            }
        }
    }

    fn report(&self, active: &mut [bool], verdict: &mut Verdict) {
        let n = active.len();
        let (mut trace, mut log, mut largest, mut smallest, mut count) = (0.0, 0.0, 0.0_f64, f64::INFINITY, 0);
        for (out, k) in active.iter_mut().zip((0..self.basis.width()).filter(|&k| self.is_real(k))) {
            let own = self.basis.diagonal(k);
            *out = self.active[k];
            trace += own;
            log += own.max(f64::MIN_POSITIVE).ln();
            largest = largest.max(own);
            if self.active[k] {
                smallest = smallest.min(own);
                count += 1;
            }
        }
        *verdict = Verdict {
            active: count,
            of: n,
            suspended: false,
            trace,
            log_determinant: log,
            condition: if count > 0 { largest / smallest } else { f64::NAN },
        };
    }

    /// Variances of scaled parameter i: of what moves, and of what is held (standard deviations `width`). As the
    /// estimator's other schemes have them, `VA⁻ᵀVᵀa` left in `covector`; asks for the elimination of the same period.
    pub(crate) fn variance_of(
        &mut self,
        i: usize,
        variance: f64,
        width_of: &[f64],
        whitening: Option<&Whitening>,
        covector: &mut [f64],
    ) -> (f64, f64) {
        let n = self.unseen.len();
        let width = self.basis.width();
        match whitening {
            Some(whitening) => (0..n).for_each(|k| self.unseen[k] = if k >= i { whitening.share(i, k) } else { 0.0 }),
            None => (0..n).for_each(|k| self.unseen[k] = f64::from(u8::from(k == i))),
        }
        self.basis.shares(&self.unseen, &mut self.x);
        for (place, &k) in self.order.iter().enumerate() {
            let share = if self.active[k] { self.x[k] } else { 0.0 };
            self.step[place] = share;
            axpy(-share, self.basis.direction(k), &mut self.unseen);
        }
        // A⁻ᵀ: first Uᵀ, then Lᵀ.
        for place in 0..width {
            let row = &self.lu[place * width..(place + 1) * width];
            let value = self.step[place] / row[place];
            self.step[place] = value;
            axpy(-value, &row[place + 1..], &mut self.step[place + 1..]);
        }
        for place in (1..width).rev() {
            let value = self.step[place];
            axpy(-value, &self.lu[place * width..place * width + place], &mut self.step[..place]);
        }
        for (place, &k) in self.order.iter().enumerate() {
            self.scratch[k] = self.step[place];
        }
        covector.fill(0.0);
        for (k, u) in self.scratch.iter().enumerate() {
            axpy(*u, self.basis.direction(k), covector);
        }
        let mut moving = 0.0;
        for (k, u) in self.scratch.iter().enumerate() {
            moving += u * dot(self.basis.information(k), &self.scratch);
        }
        match whitening {
            Some(whitening) => whitening.covector(&self.unseen, &mut self.scratch[..n]),
            None => self.scratch[..n].copy_from_slice(&self.unseen),
        }
        let held = self.scratch.iter().zip(width_of).map(|(h, w)| (h * w).powi(2)).sum();
        (variance * moving, held)
    }
}

/// Subtracts row `place` from those below so that its column vanishes there; with `active` false it only counts.
#[multiversion(targets("x86_64+avx+avx2"))]
fn eliminate_below(lu: &mut [f64], step: &mut [f64], place: usize, active: bool) {
    let width = step.len();
    let (above, below) = lu.split_at_mut((place + 1) * width);
    let row = &above[place * width..];
    let scale = if active { 1.0 / row[place] } else { 0.0 };
    let from = step[place];
    for (row_below, step) in below.chunks_exact_mut(width).zip(&mut step[place + 1..]) {
        let factor = row_below[place] * scale;
        row_below[place] = factor;
        for (x, y) in row_below[place + 1..].iter_mut().zip(&row[place + 1..]) {
            *x -= factor * y;
        }
        *step -= factor * from;
    }
}
