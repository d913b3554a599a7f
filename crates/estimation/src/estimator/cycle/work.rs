//! The turns of the slow work, and what its end publishes.

use super::super::Estimator;
use super::super::witnesses::Witnesses;
use super::{Cycle, Stage, TRACKED_DEVIATIONS, Weighed};
use crate::linear::{Budget, items_per_step, packed};
use crate::report::ParameterState;
use crate::supervision::{Judge, Known};

/// A parameter counts as identified when what is held leaves it at most this share of its prior's width (or the
/// tolerance, or less than the uncertainty of what moves).
const HELD_SHARE: f64 = 0.25;
/// A parameter counts as better known from now on only where what is held adds at most this times the variance of what moves. The
/// error of a held direction stays in its parameters: counted by what was last said of them it would fade with every cycle, although nobody
/// has learnt anything of it. (A slow motion stated a quarter of the deviation that the same rows give unsupervised.) At 1 a deviation is too
/// small by the root of 2 at most.
const MOST_HELD: f64 = 1.0;
/// Decisions about directions in a time constant of the window, at most. Sooner, the first rows of a window decide one by one
/// what may move, and what they let in explains the errors of all that is held: on a measured arm (TX40, no desired motion) the
/// residual of its wrist then rose to eight times that of the nominal parameters.
const MOST_DECISIONS: f64 = 300.0;
/// Rows that a decision waits for, at most, however long the window.
const MAX_DECISION_ROWS: f64 = 25.0;

impl Estimator {
    /// Does one step of the slow work: about 10⁵ multiply-adds. Call it once a period. Real-time safe.
    ///
    /// A cycle (judge, solve, a part of the standard deviations) takes up to 25 steps with 60 parameters, the fewer the fewer
    /// of them move.
    pub fn work(&mut self) {
        if self.unloading() {
            self.unload();
            return;
        }
        if self.plain_rls() {
            self.follow_ud();
            return;
        }
        if self.cycle.tracked().is_some() {
            self.work_tracked();
            return;
        }
        let mut budget = Budget::step();
        while !budget.is_spent() {
            if self.cycle.stage == Stage::Idle && !self.is_due() {
                return;
            }
            self.advance(&mut budget);
            if self.cycle.stage == Stage::Idle {
                // The next cycle begins with a step of its own.
                return;
            }
        }
    }

    /// Whether there is something new to decide by.
    fn is_due(&self) -> bool {
        // With nothing forgotten this is the limit; where forgetting varies, that of now counts.
        let forgotten = (1.0 - self.lambda).max(0.0);
        let least = match self.cycle.judge {
            Judge::Directions(_) => (1.0 / (forgotten * MOST_DECISIONS)).min(MAX_DECISION_ROWS),
            _ => 0.0,
        };
        self.cycle.fresh && f64::from(self.cycle.rows) >= least
    }

    /// Goes on with the cycle while `budget` lasts, at most to the end of a stage.
    fn advance(&mut self, budget: &mut Budget) {
        let n = self.n;
        let next = match self.cycle.stage {
            Stage::Idle => {
                self.begin();
                budget.charge(n * n);
                Stage::Judge
            }
            Stage::Judge => {
                if self.judge(budget) {
                    Stage::Map { row: 0 }
                } else {
                    Stage::Judge
                }
            }
            Stage::Map { row } => {
                self.cycle.rounds = 0;
                let next = self.cycle.map(row, budget);
                if next < n { Stage::Map { row: next } } else { Stage::Reduce { row: 0 } }
            }
            Stage::Reduce { row } => {
                let next = self.cycle.reduce(row, budget);
                if next < self.cycle.index.len() { Stage::Reduce { row: next } } else { Stage::Factor }
            }
            Stage::Factor => {
                if self.cycle.lu.advance_within(budget) {
                    self.cycle.excess = false;
                    Stage::Verify { row: 0 }
                } else {
                    Stage::Factor
                }
            }
            Stage::Verify { row } => {
                let next = self.cycle.verify(row, budget);
                if next < self.cycle.index.len() {
                    Stage::Verify { row: next }
                } else if self.cycle.excess {
                    self.cycle.rounds += 1;
                    Stage::Reduce { row: 0 }
                } else {
                    Stage::Move
                }
            }
            Stage::Move => {
                self.propose();
                budget.charge(3 * n * n);
                Stage::Ask { at: 0 }
            }
            Stage::Ask { at } => {
                let mut at = at;
                while at < Witnesses::count() && !budget.is_spent() {
                    self.witnesses.ask(at);
                    budget.charge(self.witnesses.cost());
                    at += 1;
                }
                if at < Witnesses::count() {
                    Stage::Ask { at }
                } else {
                    self.conclude();
                    budget.charge(2 * n * n);
                    Stage::Deviations { done: 0 }
                }
            }
            Stage::Deviations { done } => {
                let (cost, mut done) = (self.deviation_cost(), done);
                let all = items_per_step(6 * n * n).min(n);
                while done < all && !budget.is_spent() {
                    self.deviations(1);
                    budget.charge(cost);
                    done += 1;
                }
                if done < all { Stage::Deviations { done } } else { Stage::Idle }
            }
        };
        self.cycle.stage = next;
    }

    /// Multiply-adds of one standard deviation, at most.
    fn deviation_cost(&self) -> usize {
        let (n, size) = (self.n, self.cycle.index.len());
        5 * n * size + size * size + 2 * n * n + 4 * n
    }

    /// Runs a whole cycle on all rows so far, and refreshes every standard deviation. For use off the real-time path.
    pub fn settle(&mut self) {
        while self.unloading() {
            self.unload();
        }
        if self.plain_rls() {
            for _ in 0..self.n {
                self.follow_ud();
            }
            return;
        }
        if let Judge::Tracked(_) = self.cycle.judge {
            self.cycle.proposed = false;
            for _ in 0..2 {
                let variance = self.row_variance();
                let Cycle { judge, belief, width, .. } = &mut self.cycle;
                if let Judge::Tracked(scheme) = judge {
                    scheme.align(Known { variance, belief, width, whitening: self.whitening.as_ref() });
                }
                self.propose_tracked();
                self.answer_tracked();
                self.deviations(self.n);
            }
            return;
        }
        // Twice: the second solution refines the first, and judges with what the first has taught.
        for _ in 0..2 {
            self.cycle.stage = Stage::Idle;
            self.cycle.fresh = true;
            self.advance(&mut Budget::endless());
            while !matches!(self.cycle.stage, Stage::Deviations { .. }) {
                self.advance(&mut Budget::endless());
            }
            self.deviations(self.n);
            self.cycle.stage = Stage::Idle;
        }
    }

    fn plain_rls(&self) -> bool {
        self.settings.kind.least_squares() && matches!(self.cycle.judge, Judge::Off)
    }

    fn begin(&mut self) {
        let variance = self.row_variance();
        let (n, cycle) = (self.n, &mut self.cycle);
        cycle.variance = variance;
        (cycle.fresh, cycle.rows) = (false, 0);
        if cycle.m.is_empty() {
            cycle.m = cycle.lu.reclaim();
        }
        cycle.m.copy_from_slice(&self.m);
        cycle.y.copy_from_slice(&self.y);
        if !cycle.s.is_empty() {
            for i in 0..n {
                for (j, &value) in self.s[packed(i)].iter().enumerate() {
                    cycle.s[i * n + j] = value;
                    cycle.s[j * n + i] = value;
                }
            }
        }
        cycle.judge.start(&self.s);
        self.excitations();
    }

    fn excitations(&mut self) {
        let cycle = &self.cycle;
        let tolerance = cycle.judge.tolerance();
        for (k, (out, information)) in self.excitation.iter_mut().zip(&self.excited).enumerate() {
            *out = information * tolerance.max(cycle.belief[k]).powi(2) / cycle.variance;
        }
    }

    /// The tracked scheme solves in one period and asks the witnesses in the next, if that comes before rows do.
    fn work_tracked(&mut self) {
        if self.cycle.proposed {
            self.answer_tracked();
        }
        let Some(tracked) = self.cycle.tracked() else { return };
        if tracked.turn() {
            let in_time = tracked.has_another_period();
            self.propose_tracked();
            if !in_time {
                self.answer_tracked();
            }
        }
    }

    /// Judges and solves, and what a few standard deviations would be if the solution is taken.
    fn propose_tracked(&mut self) {
        self.cycle.variance = self.row_variance();
        self.cycle.fresh = false;
        self.excitations();
        let Cycle { judge, variance, belief, width, x, active, verdict, scratch, .. } = &mut self.cycle;
        let Judge::Tracked(scheme) = judge else { return };
        let known = Known { variance: *variance, belief, width, whitening: self.whitening.as_ref() };
        scratch.copy_from_slice(x);
        self.cycle.solved = scheme.solve(known, scratch, active, verdict);
        for k in 0..TRACKED_DEVIATIONS {
            self.cycle.weighed[k] = self.weigh((self.cycle.next + k) % self.n);
        }
        self.cycle.proposed = true;
    }

    /// Asks the witnesses what they say of the solution, and goes by it.
    fn answer_tracked(&mut self) {
        self.cycle.proposed = false;
        self.verdict = self.cycle.verdict;
        self.verdict.suspended = !self.cycle.solved && self.verdict.active > 0;
        match &self.whitening {
            Some(whitening) => whitening.parameters(&self.cycle.scratch, &mut self.witnesses.new),
            None => self.witnesses.new.copy_from_slice(&self.cycle.scratch),
        }
        self.question();
        for at in 0..Witnesses::count() {
            self.witnesses.ask(at);
        }
        self.conclude();
        for k in 0..TRACKED_DEVIATIONS {
            self.deviate(self.cycle.weighed[k]);
        }
    }

    fn judge(&mut self, budget: &mut Budget) -> bool {
        let Cycle { judge, s, variance, belief, width, active, verdict, .. } = &mut self.cycle;
        let known = Known { variance: *variance, belief, width, whitening: self.whitening.as_ref() };
        judge.advance(s, known, active, verdict, budget)
    }

    /// Where the solution would go, and the question whether the rows say that it may.
    fn propose(&mut self) {
        let cycle = &mut self.cycle;
        self.verdict = cycle.verdict;
        let wanted = cycle.active.iter().any(|a| *a);
        let moved = cycle.propose();
        self.verdict.suspended |= wanted && !moved;
        match &self.whitening {
            Some(whitening) => whitening.parameters(&self.cycle.scratch, &mut self.witnesses.new),
            None => self.witnesses.new.copy_from_slice(&self.cycle.scratch),
        }
        self.question();
    }

    /// What was put in `new` is weighed against the values of now and the nominal ones from now on.
    fn question(&mut self) {
        for (i, c) in self.column.iter().enumerate() {
            self.witnesses.nominal[i] = self.nominal[i] * c;
            self.witnesses.now[i] = self.values[i] * c;
        }
        self.witnesses.begin();
    }

    /// Whether anything is judged at all.
    pub(in crate::estimator) fn supervised(&self) -> bool {
        !matches!(self.cycle.judge, Judge::Off)
    }

    /// Moves to where the solution goes, stays, or goes back to the nominal values.
    fn conclude(&mut self) {
        let noise = self.noise.equation_variance();
        let moved = self.cycle.solved;
        let active = self.cycle.active.iter().filter(|active| **active).count();
        let promised = active as f64 * self.cycle.tolerance().powi(2) / self.rows.tau.len() as f64;
        let admitted = !self.supervised() || self.witnesses.admit(noise, promised);
        if moved && admitted {
            let Cycle { x, scratch, .. } = &mut self.cycle;
            std::mem::swap(x, scratch);
        } else {
            // What was refused is identified no less for that; it does not move.
            self.cycle.solved = false;
        }
        self.verdict.suspended |= moved && !admitted;
        if let Judge::Directions(scheme) = &mut self.cycle.judge {
            scheme.remember(&self.cycle.active);
        }
        self.verdict.active = if self.cycle.solved { active } else { 0 };
        if self.supervised() && self.witnesses.refute(moved && admitted, noise) {
            self.take_back();
        } else if moved && admitted {
            self.publish_values();
        }
    }

    /// The nominal values stand again, known as well as before anything was learnt. The window stays, unless the last rows, too, speak
    /// for the nominal values: then it is what was before them that is wrong, and its sums would be refused until they are forgotten.
    fn take_back(&mut self) {
        self.stale = self.witnesses.recent_refute(self.noise.equation_variance());
        self.cycle.take_back(&self.witnesses.nominal, &self.prior, self.whitening.as_ref());
        self.verdict.suspended = true;
        self.verdict.active = 0;
        self.values.copy_from_slice(&self.nominal);
        for ((std, prior), c) in self.std.iter_mut().zip(&self.prior).zip(&self.column) {
            *std = prior / c;
        }
        self.state.fill(ParameterState::Unidentified);
    }

    /// Values from the working coordinates.
    fn publish_values(&mut self) {
        match &self.whitening {
            Some(whitening) => whitening.parameters(&self.cycle.x, &mut self.rows.scaled),
            None => self.rows.scaled.copy_from_slice(&self.cycle.x),
        }
        for ((out, x), c) in self.values.iter_mut().zip(&self.rows.scaled).zip(&self.column) {
            *out = x / c;
        }
        for i in 0..self.n {
            if self.state[i] == ParameterState::Unidentified {
                self.doubt_carried(i);
            }
        }
    }

    /// A parameter that is not identified by itself may be off by as much as identified combinations have carried it away.
    fn doubt_carried(&mut self, i: usize) {
        self.std[i] = self.std[i].max((self.values[i] - self.nominal[i]).abs());
    }

    /// Refreshes standard deviation and state of the next `count` parameters.
    fn deviations(&mut self, count: usize) {
        for _ in 0..count {
            let weighed = if self.cycle.solved { self.weigh(self.cycle.next) } else { Weighed::NONE };
            self.deviate(weighed);
        }
    }

    /// The variance of parameter i by the solution.
    fn weigh(&mut self, i: usize) -> Weighed {
        let [moving, held, taken] = self.cycle.variance_of(i, &self.m, self.whitening.as_ref());
        let share = self.window_share();
        let long_run = share * self.long_run.variance(&self.cycle.covector, self.count[0], moving / share);
        Weighed { moving, long_run, held, taken }
    }

    /// Standard deviation and state of the next parameter: by `weighed`, its own, if the solution was taken.
    fn deviate(&mut self, weighed: Weighed) {
        let i = self.cycle.next;
        self.cycle.next = if i + 1 == self.n { 0 } else { i + 1 };
        let Weighed { moving, held, taken, long_run } = if self.cycle.solved { weighed } else { Weighed::NONE };
        let tolerance = self.cycle.judge.tolerance().powi(2);
        let moves = if moving > 0.0 { long_run } else { 0.0 };
        let (std, width) = ((moves + held).sqrt(), (moves + taken).sqrt());
        let least = moving.max(tolerance).max((HELD_SHARE * self.prior[i]).powi(2));
        if taken <= least && width.is_finite() {
            // Thresholds go by white residuals: with the long-run variance of a few blocks, too much would be held. Only ever downwards: else a
            // window that runs dry would loosen its own threshold.
            self.cycle.belief[i] = self.cycle.belief[i].min((moving + taken).sqrt());
            self.cycle.width[i] = width;
        }
        if held <= least && std.is_finite() {
            self.state[i] = ParameterState::Active;
            if held <= MOST_HELD * moving {
                self.cycle.stated[i] = std;
            }
            self.std[i] = std / self.column[i];
        } else if self.state[i] == ParameterState::Unidentified {
            // Partly seen: better known than before, if not well.
            self.std[i] = std.min(self.prior[i]) / self.column[i];
            self.doubt_carried(i);
        } else {
            self.state[i] = ParameterState::Held;
        }
    }

    /// Unsupervised least squares: the UD filter's values and a few of its deviations.
    fn follow_ud(&mut self) {
        if !self.cycle.fresh && self.updates == 0 {
            return;
        }
        self.values.copy_from_slice(&self.rls_values);
        let variance = self.row_variance();
        for _ in 0..8.min(self.n) {
            let i = self.cycle.next;
            self.cycle.next = if i + 1 == self.n { 0 } else { i + 1 };
            let std = (variance * self.ud.variance(i)).sqrt();
            self.excitation[i] = self.excited[i] * self.prior[i].powi(2) / variance;
            if std < 0.5 * self.prior[i] {
                self.state[i] = ParameterState::Active;
            } else {
                // Nothing is held here: it is as open as at the start.
                self.state[i] = ParameterState::Unidentified;
            }
            self.std[i] = std / self.column[i];
        }
        self.verdict.active = self.state.iter().filter(|s| **s == ParameterState::Active).count();
    }
}
