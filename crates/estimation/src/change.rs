//! Notices that the arm has become another one: a payload grasped or let go of while moving.
//!
//! A window that holds rows of two arms fits neither, and its parameters are wrong by far more than their deviations say
//! until the old rows are forgotten (the paper's footnote 6: the window must be as short as parameters change). A change is
//! seen long before that: the residuals of all joints rise at once and stay.

use crate::memory::{Carry, MANY};

/// Memory of the short-term mean \[s\]: longer than a collision's peak, short beside a window.
const SHORT_S: f64 = 0.3;
/// The baseline counts a row at most as this many times its own level: a change must not become the baseline at once.
const BASELINE_CAP: f64 = 4.0;
/// A row counts at most as this many times the baseline, so that one joint's peak is no change.
const ROW_CAP: f64 = 25.0;
/// Ratio of the short-term mean square to the baseline that is a change: three times the usual residual, in the mean of
/// all joints that move. Payloads that matter to a controller give more than ten times; the residuals of measured arms
/// vary by up to twice between motions.
const CHANGE: f64 = 9.0;
/// Rows of a joint before its baseline is believed, as a share of the window.
const SETTLE_SHARE: f64 = 0.25;

/// Time that values have to fit an arm that carries something else before its residuals are looked at again \[s\].
const LEARN_S: f64 = 5.0;

/// Residuals that have been usual for so many times the short-term memory say that this time is over, and so do those that
/// stay unusual for as long though the load is known: it was none.
const CALM: f64 = 3.0;

/// What [`Change::add`] saw.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Changed {
    /// Nothing.
    No,
    /// The arm is another one.
    Yes,
    /// It still is, though its load is known, or after the time that was given to learn it.
    Still,
}

/// Compares recent residuals with those of the window, joint by joint.
#[derive(Clone, Debug)]
pub(crate) struct Change {
    short: f64,
    memory: f64,
    settle: f64,
    learn: f64,
    /// Instants until residuals are looked at again; 0 when they are.
    given: f64,
    /// Instants since residuals were last unusual, while there is such a time.
    calm: f64,
    /// Instants since the load is known and residuals are unusual all the same.
    odd: f64,
    baseline: Vec<f64>,
    rows: Vec<f64>,
    recent: f64,
    seen: u64,
}

impl Change {
    /// `row_s`: time between rows \[s\]; `window`: rows of the window.
    pub(crate) fn new(joints: usize, row_s: f64, window: f64) -> Change {
        Change {
            short: (SHORT_S / row_s).max(5.0),
            memory: (0.5 * window).max(20.0),
            settle: (SETTLE_SHARE * window).max(20.0),
            learn: (LEARN_S / row_s).ceil(),
            given: 0.0,
            calm: 0.0,
            odd: 0.0,
            baseline: vec![0.0; joints],
            rows: vec![0.0; joints],
            recent: 1.0,
            seen: 0,
        }
    }

    /// Goes on with the memories of `fresh`.
    pub(crate) fn reconfigure(&mut self, fresh: &Change) {
        (self.short, self.memory, self.settle, self.learn) = (fresh.short, fresh.memory, fresh.settle, fresh.learn);
        self.given = self.given.min(self.learn);
    }

    pub(crate) fn carry(&mut self, carry: &mut Carry<'_>) {
        carry.sizes(&mut self.baseline);
        carry.sizes(&mut self.rows);
        carry.number(&mut self.recent);
        carry.sizes(std::slice::from_mut(&mut self.given));
        carry.sizes(std::slice::from_mut(&mut self.calm));
        carry.sizes(std::slice::from_mut(&mut self.odd));
        self.given = self.given.min(self.learn);
        carry.whole(&mut self.seen, MANY);
    }

    /// Forgets what residuals were like; counts on.
    pub(crate) fn restart(&mut self) {
        self.baseline.fill(0.0);
        self.rows.fill(0.0);
        self.recent = 1.0;
        (self.given, self.calm, self.odd) = (0.0, 0.0, 0.0);
    }

    /// Takes in the residual of every joint whose row counts, as `(joint, residual)`. What residuals were like stays known
    /// after a change, for the time that values have to come back to it. `learnt`: what the arm carries is known.
    pub(crate) fn add(&mut self, residuals: impl Iterator<Item = (usize, f64)>, learnt: bool) -> Changed {
        let (mut sum, mut count) = (0.0, 0.0);
        for (j, residual) in residuals {
            let square = residual * residual;
            if self.rows[j] >= self.settle && self.baseline[j] > 0.0 {
                sum += (square / self.baseline[j]).min(ROW_CAP);
                count += 1.0;
            }
            if self.given > 0.0 {
                continue;
            }
            self.rows[j] += 1.0;
            let known = self.rows[j] > 0.5 * self.settle;
            let square = if known { square.min(BASELINE_CAP * self.baseline[j]) } else { square };
            self.baseline[j] += (square - self.baseline[j]) / self.rows[j].min(self.memory);
        }
        if count == 0.0 {
            return Changed::No;
        }
        self.recent += (sum / count - self.recent) / self.short;
        if self.given > 1.0 {
            self.given -= 1.0;
            self.calm = if self.recent < 0.5 * CHANGE { self.calm + 1.0 } else { 0.0 };
            self.odd = if learnt && self.recent > CHANGE { self.odd + 1.0 } else { 0.0 };
            if self.calm > CALM * self.short {
                (self.given, self.calm) = (0.0, 0.0);
            }
            if self.odd <= CALM * self.short {
                return Changed::No;
            }
        }
        (self.calm, self.odd) = (0.0, 0.0);
        let still = self.given > 0.0;
        self.given = 0.0;
        if self.recent <= CHANGE {
            return Changed::No;
        }
        self.seen += 1;
        if still {
            return Changed::Still;
        }
        self.given = self.learn;
        Changed::Yes
    }

    /// How many changes were seen.
    pub(crate) fn seen(&self) -> u64 {
        self.seen
    }
}

#[cfg(test)]
mod tests {
    use super::{Change, Changed};

    /// Reproducible noise, roughly normal.
    fn noise(state: &mut u64) -> f64 {
        let mut uniform = || {
            *state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (*state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        (0..12).map(|_| uniform()).sum()
    }

    /// The first of `rows` instants at which `change` saw something, and what.
    fn run(
        change: &mut Change,
        rows: usize,
        scale: impl Fn(usize) -> f64,
        state: &mut u64,
    ) -> Option<(usize, Changed)> {
        let mut add = |k: usize| {
            let residuals = [0, 1, 2, 3, 4, 5].map(|j| (j, scale(k) * noise(state)));
            (k, change.add(residuals.into_iter(), false))
        };
        (0..rows).map(&mut add).find(|(_, changed)| *changed != Changed::No)
    }

    #[test]
    fn a_lasting_rise_is_a_change_and_a_peak_or_busier_motion_is_none() {
        let mut state = 7;
        let mut change = Change::new(6, 0.01, 1000.0);
        assert_eq!(run(&mut change, 3000, |_| 0.3, &mut state), None, "steady");
        assert_eq!(run(&mut change, 500, |k| if k % 100 < 5 { 30.0 } else { 0.3 }, &mut state), None, "peaks of 50 ms");
        assert_eq!(run(&mut change, 500, |k| if k % 200 < 100 { 0.6 } else { 0.3 }, &mut state), None, "twice as busy");
        let (found, changed) = run(&mut change, 500, |_| 3.0, &mut state).expect("ten times the residual");
        assert!(found < 50, "after {found} rows");
        assert_eq!((change.seen(), changed), (1, Changed::Yes));

        // Values that fit again within the time given: nothing more was wrong, and what is usual is still known.
        let mut learnt = change.clone();
        assert_eq!(run(&mut learnt, 2000, |k| if k < 300 { 3.0 } else { 0.3 }, &mut state), None, "a load is learnt");
        let again = run(&mut learnt, 500, |_| 3.0, &mut state);
        assert!(matches!(again, Some((0..50, Changed::Yes))), "{again:?}");
        // Grasped, learnt within a second, and let go of again a second and a half later: two loads.
        assert_eq!(run(&mut learnt, 250, |k| if k < 100 { 3.0 } else { 0.3 }, &mut state), None);
        let soon = run(&mut learnt, 500, |_| 3.0, &mut state);
        assert!(matches!(soon, Some((0..50, Changed::Yes))), "{soon:?}");

        // Values that still do not fit: once the window has begun anew, the new level is the usual one.
        assert_eq!(run(&mut change, 600, |_| 3.0, &mut state), Some((499, Changed::Still)));
        change.restart();
        assert_eq!(run(&mut change, 2000, |_| 3.0, &mut state), None);
        assert_eq!(change.seen(), 2);
    }
}
