//! The slow part of the estimator, cut into steps: judge the information, solve, refresh standard deviations.
//!
//! A cycle works on a copy of the sums; what comes in meanwhile is for the next one. Its number of steps is bounded, and
//! each step is bounded by `STEP_WORK` and what it began last, so no period of the loop pays for more than one of them.

#[cfg(test)]
mod tests;
mod work;

use super::{Directions, PRIOR_CAUTION};
use crate::kernels::times_chosen;
use crate::linear::{Budget, axpy, compress, dot};
use crate::lu::Lu;
use crate::memory::Carry;
use crate::report::Verdict;
use crate::scales::Whitening;
use crate::supervision::{Judge, Tracked};

/// How often a cycle may find that it promised too much; then it holds everything.
const MAX_SELECTION_ROUNDS: usize = 4;
/// A direction that moves may be this much more uncertain than its threshold says: the hysteresis of the verification.
const VARIANCE_SLACK: f64 = 2.0;

/// Standard deviations that the tracked scheme refreshes with each of its steps.
const TRACKED_DEVIATIONS: usize = 4;

/// Variances of one scaled parameter: of what moves (for white residuals, and with their long-run variance), of what is held, and of
/// what is held as decisions count it.
#[derive(Clone, Copy, Debug)]
struct Weighed {
    moving: f64,
    long_run: f64,
    held: f64,
    taken: f64,
}

impl Weighed {
    /// Without a solution.
    const NONE: Weighed = Weighed { moving: 0.0, long_run: 0.0, held: f64::INFINITY, taken: f64::INFINITY };
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// Waiting for rows.
    Idle,
    Judge,
    /// Rows of `M·Vᵀ`.
    Map {
        row: usize,
    },
    /// The reduced matrix, column by column, and which directions the instruments are relevant for.
    Reduce {
        row: usize,
    },
    Factor,
    /// Whether what is to move would be known as well as promised, direction by direction.
    Verify {
        row: usize,
    },
    Move,
    /// What the measured rows say of the new values, instant by instant.
    Ask {
        at: usize,
    },
    Deviations {
        done: usize,
    },
}

#[derive(Clone, Debug)]
pub(super) struct Cycle {
    stage: Stage,
    fresh: bool,
    /// Rows since the last cycle began.
    rows: u32,
    judge: Judge,
    /// Copies of the sums. M is mapped and reduced in place and becomes the memory of `lu` where the judge has directions; S, in
    /// full, is empty where the judge keeps its own. The tracked scheme needs neither.
    m: Vec<f64>,
    s: Vec<f64>,
    y: Vec<f64>,
    /// The estimate in working coordinates.
    x: Vec<f64>,
    active: Vec<bool>,
    index: Vec<usize>,
    lu: Lu,
    /// `y − M·x`: held coordinates enter as known.
    rest: Vec<f64>,
    solved: bool,
    /// A solution of the tracked scheme waits for what the witnesses say of it, with what the next parameters' deviations then are.
    proposed: bool,
    weighed: [Weighed; TRACKED_DEVIATIONS],
    /// Verification took something out, and how often it has done so in this cycle.
    excess: bool,
    rounds: usize,
    step: Vec<f64>,
    scratch: Vec<f64>,
    unseen: Vec<f64>,
    verdict: Verdict,
    /// Standard deviation of what is known of each scaled parameter, as thresholds count it.
    belief: Vec<f64>,
    /// The same without that caution: the prior's width, or the last standard deviation.
    width: Vec<f64>,
    /// The prior's width, or the last standard deviation that was learnt: what is stated counts what is held by it. The other two, by
    /// which is decided, take a deviation for learnt whatever it consists of, so that what is held soon counts as known: nothing is let in
    /// before the tolerance is reached.
    stated: Vec<f64>,
    /// κσₑ² of the cycle.
    variance: f64,
    /// Covector of a parameter's variance, in working coordinates.
    covector: Vec<f64>,
    next: usize,
}

impl Cycle {
    pub(super) fn new(n: usize, judge: Judge) -> Cycle {
        let (m, s, lu) = match &judge {
            Judge::Off | Judge::Columns(_) => (n * n, n * n, Lu::new(n)),
            Judge::Directions(_) => (n * n, 0, Lu::borrowing(n)),
            Judge::Tracked(_) => (0, 0, Lu::borrowing(n)),
        };
        Cycle {
            stage: Stage::Idle,
            fresh: false,
            rows: 0,
            judge,
            m: vec![0.0; m],
            s: vec![0.0; s],
            y: vec![0.0; n],
            x: vec![0.0; n],
            active: vec![false; n],
            index: Vec::with_capacity(n),
            lu,
            rest: vec![0.0; n],
            solved: false,
            proposed: false,
            weighed: [Weighed::NONE; TRACKED_DEVIATIONS],
            excess: false,
            rounds: 0,
            step: vec![0.0; n],
            scratch: vec![0.0; n],
            unseen: vec![0.0; n],
            verdict: Verdict::NONE,
            belief: vec![0.0; n],
            width: vec![0.0; n],
            stated: vec![0.0; n],
            variance: 1.0,
            covector: vec![0.0; n],
            next: 0,
        }
    }

    /// Goes on with the thresholds of `fresh`; false, and nothing changed, if that judges by another scheme.
    pub(super) fn reconfigure(&mut self, fresh: &Cycle) -> bool {
        self.judge.reconfigure(&fresh.judge)
    }

    /// Scaled parameter `i` is known this well.
    pub(super) fn recall(&mut self, i: usize, std: f64) {
        self.belief[i] = self.belief[i].min(std);
        self.width[i] = std;
        self.stated[i] = std;
    }

    /// Nothing is known of scaled parameter `i` but its prior.
    pub(super) fn forget(&mut self, i: usize, prior: f64) {
        self.belief[i] = PRIOR_CAUTION * prior;
        self.width[i] = prior;
        self.stated[i] = prior;
    }

    /// The cycle that is under way is dropped, and what moved before has no advantage any more.
    pub(super) fn begin_anew(&mut self) {
        (self.stage, self.solved, self.proposed) = (Stage::Idle, false, false);
        self.active.fill(false);
        match &mut self.judge {
            Judge::Directions(scheme) => scheme.forget_history(),
            Judge::Tracked(scheme) => scheme.restart(),
            Judge::Off | Judge::Columns(_) => {}
        }
    }

    /// Four vectors of n that nobody needs between cycles.
    pub(super) fn room(&mut self) -> [&mut [f64]; 4] {
        [&mut self.step, &mut self.scratch, &mut self.unseen, &mut self.covector]
    }

    /// \[torque-noise sigma\]
    pub(super) fn tolerance(&self) -> f64 {
        self.judge.tolerance()
    }

    /// A cycle that is under way begins anew on the other side.
    pub(super) fn carry(&mut self, carry: &mut Carry<'_>) {
        carry.numbers(&mut self.x);
        carry.sizes(&mut self.belief);
        carry.sizes(&mut self.width);
        carry.sizes(&mut self.stated);
        for active in &mut self.active {
            carry.flag(active);
        }
        carry.place(&mut self.next, self.x.len());
        // A cycle that rows are waiting for is as due on the other side.
        carry.small(&mut self.rows, u32::MAX);
        carry.sizes(std::slice::from_mut(&mut self.variance));
        self.judge.carry(carry);
    }

    /// Goes on from what was carried in: with a cycle of its own.
    pub(super) fn resume(&mut self) {
        (self.stage, self.fresh, self.solved, self.proposed) = (Stage::Idle, true, false, false);
    }

    /// New rows came in.
    pub(super) fn fresh(&mut self) {
        self.fresh = true;
        self.rows = self.rows.saturating_add(1);
    }

    /// Begins anew at the scaled parameters `x`.
    pub(super) fn restart(&mut self, x: &[f64], prior: &[f64], whitening: Option<&Whitening>) {
        self.begin_anew();
        (self.fresh, self.rows) = (false, 0);
        self.next = 0;
        self.place(x, prior, whitening);
    }

    /// The scheme that keeps its own sums.
    pub(super) fn tracked(&mut self) -> Option<&mut Tracked> {
        match &mut self.judge {
            Judge::Tracked(scheme) => Some(scheme),
            _ => None,
        }
    }

    pub(super) fn directions(&self) -> Option<Directions<'_>> {
        let n = self.x.len();
        let settled = matches!(self.stage, Stage::Idle | Stage::Deviations { .. });
        let directions = match &self.judge {
            // The next ones are in the making where these were.
            Judge::Directions(_) if !settled => return None,
            Judge::Directions(scheme) => scheme.vectors().chunks_exact(n).zip(self.active.iter().copied()).collect(),
            Judge::Tracked(scheme) => scheme.directions().collect(),
            Judge::Off | Judge::Columns(_) => return None,
        };
        Some(Directions { coordinates: &self.x, directions })
    }

    /// What the estimate leaves of y, and rows of `M·Vᵀ` from `row` on in the place of M's. Returns the next row.
    fn map(&mut self, row: usize, budget: &mut Budget) -> usize {
        let n = self.x.len();
        if row == 0 {
            budget.charge(n * n);
            for (out, (m, y)) in self.rest.iter_mut().zip(self.m.chunks_exact(n).zip(&self.y)) {
                *out = y - dot(m, &self.x);
            }
            self.index.clear();
            self.index.extend((0..n).filter(|&k| self.active[k]));
        }
        let Judge::Directions(scheme) = &self.judge else { return n };
        let mapped = &mut self.scratch[..self.index.len()];
        let mut i = row;
        while i < n && !budget.is_spent() {
            let matrix_row = &mut self.m[i * n..(i + 1) * n];
            times_chosen(scheme.vectors(), &self.index, matrix_row, mapped);
            matrix_row[..mapped.len()].copy_from_slice(mapped);
            budget.charge(n * mapped.len() + n);
            i += 1;
        }
        i
    }

    /// The reduced system from `row` on. Returns the next row; all are done when it is no place of `index`.
    fn reduce(&mut self, row: usize, budget: &mut Budget) -> usize {
        match self.judge {
            Judge::Directions(_) if self.rounds == 0 => self.reduce_directions(row, budget),
            Judge::Directions(_) => self.reduce_again(row, budget),
            _ => self.reduce_columns(row, budget),
        }
    }

    /// Of the directions that the judge has chosen, from mapped rows: in their place, column by column. The instruments of a
    /// direction are relevant if `r < vᵀMv/vᵀSv < 1/r`.
    fn reduce_directions(&mut self, column: usize, budget: &mut Budget) -> usize {
        let (n, size) = (self.x.len(), self.index.len());
        let Cycle { judge, index, m, step, scratch, active, .. } = self;
        let Judge::Directions(scheme) = &*judge else { return size };
        let mut a = column;
        while a < size && !budget.is_spent() {
            for (x, row) in scratch.iter_mut().zip(m.chunks_exact(n)) {
                *x = row[a];
            }
            times_chosen(scheme.vectors(), index, scratch, &mut step[..size]);
            for (row, x) in m.chunks_exact_mut(n).zip(&step[..size]) {
                row[a] = *x;
            }
            let (relevance, ratio) = (scheme.settings().relevance, m[a * n + a] / scheme.values()[index[a]]);
            active[index[a]] = ratio > relevance && (relevance == 0.0 || ratio < 1.0 / relevance);
            budget.charge(n * size + n);
            a += 1;
        }
        if a == size {
            compress(m, n, &(0..size).filter(|&a| active[index[a]]));
            self.lu.lend(std::mem::take(&mut self.m));
            self.keep_active();
        }
        a
    }

    /// Without the directions that verification has taken out: the factors are multiplied again, from the last row to the first.
    fn reduce_again(&mut self, row: usize, budget: &mut Budget) -> usize {
        let size = self.index.len();
        let Cycle { lu, index, scratch, active, .. } = self;
        let mut a = row;
        while a < size && !budget.is_spent() {
            lu.multiply_back(size - 1 - a, scratch);
            budget.charge(size * (size - a));
            a += 1;
        }
        if a == size {
            compress(lu.unswap(), size, &(0..size).filter(|&a| active[index[a]]));
            self.keep_active();
        }
        a
    }

    /// The matrix has been reduced to what is active: so are its rows' names and the right-hand side.
    fn keep_active(&mut self) {
        let n = self.x.len();
        let Cycle { judge, index, active, lu, step, rest, .. } = self;
        index.retain(|&k| active[k]);
        lu.start(index.len());
        if let Judge::Directions(scheme) = judge {
            for (step, &k) in step.iter_mut().zip(&*index) {
                *step = dot(&scheme.vectors()[k * n..(k + 1) * n], rest);
            }
        }
    }

    /// Of the coordinates themselves.
    fn reduce_columns(&mut self, row: usize, budget: &mut Budget) -> usize {
        let n = self.x.len();
        let Cycle { lu, index, m, step, rest, active, .. } = self;
        if row == 0 {
            index.retain(|&k| active[k]);
        }
        let size = index.len();
        let matrix = if row == 0 { lu.start(size) } else { lu.matrix() };
        let mut a = row;
        while a < size && !budget.is_spent() {
            // As much as for directions: cycles that follow each other faster would cost the mean period more.
            budget.charge(n * size + n);
            for (out, &k) in matrix[a * size..(a + 1) * size].iter_mut().zip(index.iter()) {
                *out = m[index[a] * n + k];
            }
            step[a] = rest[index[a]];
            a += 1;
        }
        a
    }

    /// Compares the variance of every direction, `κσₑ²·(A⁻¹SA⁻ᵀ)ₖₖ`, with what it may be, from `row` on; takes out what
    /// exceeds it. The information of the instruments bounds this variance only while M ≈ S: with delayed instruments,
    /// or with few rows, M can be nearly singular where S is not. Returns the next row.
    fn verify(&mut self, row: usize, budget: &mut Budget) -> usize {
        let size = self.index.len();
        if matches!(self.judge, Judge::Off) {
            return size;
        }
        if self.lu.is_singular() || self.rounds >= MAX_SELECTION_ROUNDS {
            // Nothing can be promised.
            self.index.clear();
            self.active.fill(false);
            return 0;
        }
        let spread = if matches!(self.judge, Judge::Directions(_)) { size } else { size * size };
        let mut a = row;
        while a < size && !budget.is_spent() {
            budget.charge(usize::midpoint(size * size, (size - a).pow(2)) + spread);
            let mut unit = std::mem::take(&mut self.scratch);
            unit[..size].fill(0.0);
            unit[a] = 1.0;
            let u = &mut unit[..size];
            self.lu.solve_transposed_from(u, a);
            let variance = self.variance * self.spread(u);
            self.scratch = unit;
            let k = self.index[a];
            let allowed = match &self.judge {
                Judge::Directions(scheme) => scheme.belief(k),
                _ => self.judge.tolerance().max(self.belief[k]).powi(2),
            };
            let kept = variance <= VARIANCE_SLACK * allowed;
            if !kept {
                self.active[k] = false;
                self.excess = true;
            }
            a += 1;
        }
        a
    }

    /// `uᵀ·S·u` over the active directions.
    fn spread(&self, u: &[f64]) -> f64 {
        let n = self.x.len();
        if let Judge::Directions(scheme) = &self.judge {
            return u.iter().zip(&self.index).map(|(u, &k)| u * u * scheme.values()[k]).sum();
        }
        let row = |&k: &usize| -> f64 {
            let row = &self.s[k * n..(k + 1) * n];
            if u.len() == n { dot(u, row) } else { u.iter().zip(&self.index).map(|(u, &l)| u * row[l]).sum() }
        };
        u.iter().zip(&self.index).map(|(u, k)| u * row(k)).sum()
    }

    /// Where what is active would move to, left in `scratch`; false if nothing moves.
    fn propose(&mut self) -> bool {
        let n = self.x.len();
        let size = self.index.len();
        self.scratch.copy_from_slice(&self.x);
        self.solved = size > 0 && !self.lu.is_singular();
        if !self.solved {
            self.active.fill(false);
            return false;
        }
        self.lu.solve(&mut self.step[..size]);
        for a in 0..size {
            let k = self.index[a];
            match &self.judge {
                Judge::Directions(scheme) => {
                    axpy(self.step[a], &scheme.vectors()[k * n..(k + 1) * n], &mut self.scratch);
                }
                _ => self.scratch[k] += self.step[a],
            }
        }
        if self.scratch.iter().all(|x| x.is_finite()) {
            return true;
        }
        self.scratch.copy_from_slice(&self.x);
        self.hold();
        false
    }

    /// Nothing moves in this cycle.
    fn hold(&mut self) {
        self.solved = false;
        self.active.fill(false);
    }

    /// Takes back the estimate: the scaled parameters `x`, of which nothing but the prior is known. What moved before has no
    /// advantage any more; rows and what is known from them of the information stay.
    fn take_back(&mut self, x: &[f64], prior: &[f64], whitening: Option<&Whitening>) {
        self.hold();
        self.place(x, prior, whitening);
        if let Judge::Directions(scheme) = &mut self.judge {
            scheme.forget_history();
        }
    }

    fn place(&mut self, x: &[f64], prior: &[f64], whitening: Option<&Whitening>) {
        match whitening {
            Some(whitening) => whitening.coordinates(x, &mut self.x),
            None => self.x.copy_from_slice(x),
        }
        for (belief, prior) in self.belief.iter_mut().zip(prior) {
            *belief = PRIOR_CAUTION * prior;
        }
        self.width.copy_from_slice(prior);
        self.stated.copy_from_slice(prior);
    }

    /// Variances of scaled parameter i: of what moves, of what is held, and of what is held as decisions count it.
    ///
    /// With a the parameter as a covector on working coordinates and V its active directions, these are
    /// `v·|A⁻ᵀVᵀa|²_S` and, what is known being W (diagonal, in parameters), `hᵀ·W·h` with h the part of `a − Mᵀ·c`,
    /// `c = VA⁻ᵀVᵀa`, that V does not see, taken back to parameters: what is held is off by itself, and by what its error is taken for
    /// in what moves. Decisions know of the former alone. Leaves c in `covector`. `m`: M with all rows so far, since that of the
    /// solution is used up.
    fn variance_of(&mut self, i: usize, m: &[f64], whitening: Option<&Whitening>) -> [f64; 3] {
        if let Judge::Tracked(scheme) = &mut self.judge {
            let widths = [&self.stated[..], &self.width];
            return scheme.variance_of(i, self.variance, widths, whitening, &mut self.covector);
        }
        let n = self.x.len();
        let size = self.index.len();
        let Cycle { judge, index, scratch, step, unseen, width, stated, lu, covector, active, .. } = self;
        match whitening {
            Some(whitening) => (0..n).for_each(|k| unseen[k] = if k >= i { whitening.share(i, k) } else { 0.0 }),
            None => (0..n).for_each(|k| unseen[k] = f64::from(u8::from(k == i))),
        }
        // Columns are directions along their axes.
        let vectors = if let Judge::Directions(scheme) = &*judge { Some(scheme.vectors()) } else { None };
        let along = |x: &[f64], k: usize| vectors.map_or(x[k], |v| dot(&v[k * n..(k + 1) * n], x));
        let add = |share: f64, k: usize, x: &mut [f64]| match vectors {
            Some(v) => axpy(share, &v[k * n..(k + 1) * n], x),
            None => x[k] += share,
        };
        // Directions are orthonormal, so what is left of it has the other shares as before.
        for (share, &k) in step.iter_mut().zip(index.iter()) {
            *share = along(unseen, k);
            add(-*share, k, unseen);
        }
        lu.solve_transposed(&mut step[..size]);
        covector.fill(0.0);
        for (share, &k) in step.iter().zip(index.iter()) {
            add(*share, k, covector);
        }
        let mut prior_variance = |unseen: &[f64], widths: &[f64]| -> f64 {
            match whitening {
                Some(whitening) => whitening.covector(unseen, scratch),
                None => scratch.copy_from_slice(unseen),
            }
            scratch.iter().zip(widths).map(|(h, w)| (h * w).powi(2)).sum()
        };
        let [prior_variance, taken] = if vectors.is_some() || active[i] {
            let taken = prior_variance(unseen, width);
            // Where all move, nothing is held.
            if size < n {
                for (c, row) in covector.iter().zip(m.chunks_exact(n)) {
                    axpy(-c, row, unseen);
                }
                for &k in index.iter() {
                    add(-along(unseen, k), k, unseen);
                }
            }
            [prior_variance(unseen, stated), taken]
        } else {
            [f64::INFINITY; 2]
        };
        [self.variance * self.spread(&self.step[..size]), prior_variance, taken]
    }
}
