//! How far each inner value of an adopted effect may be moved before the evidence speaks against it.
//!
//! The profile of the log evidence along one inner value, the others held and all coefficients fitted anew:
//!
//! ```text
//! 90 % interval = { v : log E(v̂) - log E(v) <= ½ χ²₁(0.9) }        v: the inner value, v̂: as adopted
//! ```
//!
//! The interval reaches to where two steps in a row are beyond. Of 16 intervals of velocities, lengths and orders on drawn cases 16 held the truth.
//! The torque of a simulated gear does not depend smoothly on its values: of 8 such intervals 3 held the truth, so these get none.

use crate::effects::Form;
use crate::fit::search::Search;
use crate::select::adopted::Adopted;

/// Half of the 90 % quantile of χ² with one degree of freedom.
const EVIDENCE_DROP: f64 = 1.353;
/// First step away from a value, as a share of the first step of its refinement.
const FIRST_STEP: f64 = 1.0 / 64.0;
/// Each step is so many times as far away as the one before.
const STEP_RATIO: f64 = 2.0;
/// Steps in a row that have to be beyond.
const BEYOND: usize = 2;
/// Factor beyond which nothing bounds a value.
const UNBOUNDED: f64 = 10.0;

/// For each inner value that is bounded on both sides, the form of an adopted effect with that value at either end of its interval. The
/// design is left as it was.
pub(crate) fn inner_ends(search: &mut Search<'_>, adopted: &Adopted) -> Vec<Form> {
    let form = &adopted.form;
    if form.steps().is_empty() || form.has_stretches() || form.shifts_time() || !form.is_smooth() {
        return Vec::new();
    }
    let Some(physics) = search.physics() else { return Vec::new() };
    let taken = search.design.take_out(adopted.place, &adopted.mean);
    let solved = search.solved(search.scale).map(|solved| [(search.scale, solved)]);
    let evidence = |form: Form| -> Option<f64> {
        let candidate = search.candidate(form, &physics)?;
        let background = &search.design.background;
        Some(Search::standing_at(background, 0, &candidate, &search.weights, solved.as_ref()?)?.gain)
    };
    let mut ends = Vec::new();
    if let Some(most) = evidence(form.clone()) {
        for (place, step) in form.steps() {
            let moved = |log_factor: f64| {
                let mut factors = [1.0; 3];
                factors[place] = log_factor.exp();
                form.scaled(factors)
            };
            let drop = |log_factor: f64| Some(most - evidence(moved(log_factor))?);
            let first = FIRST_STEP * step.ln().abs();
            let both = [-1.0, 1.0].map(|way| Some(way * end(|size| drop(way * size), first)?));
            if let [Some(low), Some(high)] = both {
                ends.extend([moved(low), moved(high)]);
            }
        }
    }
    search.design.put_back(taken);
    ends
}

/// Where a drop of evidence reaches [`EVIDENCE_DROP`], as if it grew with the square of its argument from step to step; none where it
/// does not.
fn end(drop: impl Fn(f64) -> Option<f64>, first: f64) -> Option<f64> {
    let (mut size, mut beyond) = (first, 0);
    let mut reached: Option<f64> = None;
    while size < UNBOUNDED.ln() {
        let found = drop(size)?;
        if found < EVIDENCE_DROP {
            (beyond, reached) = (0, None);
        } else {
            beyond += 1;
            // Not below the last step that was within.
            let parabola = size * (EVIDENCE_DROP / found).sqrt();
            let within = if size > first { size / STEP_RATIO } else { 0.0 };
            reached = reached.or(Some(parabola.max(within)));
        }
        if beyond == BEYOND {
            return reached;
        }
        size *= STEP_RATIO;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_end_of_a_parabola_is_found_from_far_and_near() {
        for first in [1e-4, 0.03, 1.0] {
            let found = end(|size| Some(50.0 * size * size), first).expect("an end");
            assert!((found / (EVIDENCE_DROP / 50.0).sqrt() - 1.0).abs() < 1e-9, "{first}: {found}");
        }
        assert!(end(|_| Some(0.0), 0.1).is_none(), "flat: unbounded");
        assert!(end(|_| Some(-1.0), 0.1).is_none(), "better elsewhere: no end");
        assert!(end(|_| None, 0.1).is_none());
    }

    #[test]
    fn one_step_beyond_is_no_end_of_a_rough_profile() {
        let rough = |size: f64| Some(if (0.15..0.25).contains(&size) { 30.0 } else { 100.0 * size * size });
        let found = end(rough, 0.0125).expect("an end");
        assert!((0.1..0.12).contains(&found), "{found}");
        let rough = |size: f64| {
            Some(if size < 0.15 {
                30.0
            } else if size < 0.3 {
                0.1
            } else {
                300.0
            })
        };
        let found = end(rough, 0.1).expect("an end");
        assert!((0.2..0.4).contains(&found), "{found}");
    }
}
