//! Refinement of inner values: from the grid to the largest log evidence.

use crate::effects::Form;
use crate::effects::physics::Physics;
use crate::fit::evidence::Solved;
use crate::fit::search::{Candidate, Search, Standing};

/// Steps of each inner value, halved so many times.
const REFINEMENT_HALVINGS: usize = 5;

impl Search<'_> {
    /// The form with the inner values that the evidence prefers, found by coordinate search from those given.
    pub(crate) fn refine(&self, start: &Form, physics: &[Physics<'_>]) -> Option<(Candidate, Standing)> {
        self.refine_over(start, physics, &self.scales())
    }

    /// The same over a background that is solved already.
    pub(crate) fn refine_over(
        &self,
        start: &Form,
        physics: &[Physics<'_>],
        solved: &[(f64, Solved)],
    ) -> Option<(Candidate, Standing)> {
        let judge = |form: Form| -> Option<(Candidate, Standing)> {
            let candidate = self.candidate(form, physics)?;
            let standing = self.standing(0, &candidate, solved)?;
            let again = candidate.form.settled(standing.added.c[0]).and_then(|form| {
                let candidate = self.candidate(form, physics)?;
                let standing = self.standing(0, &candidate, solved)?;
                Some((candidate, standing))
            });
            Some(again.unwrap_or((candidate, standing)))
        };
        let best = judge(start.clone())?;
        Some(climb(best, REFINEMENT_HALVINGS, |(candidate, _)| &candidate.form, |(_, standing)| standing.gain, judge))
    }
}

/// What is best along the inner values of a form, one after another, in steps that are halved so many times; `score` says how good
/// it is, `judge` makes it.
pub(crate) fn climb<T>(
    mut best: T,
    halvings: usize,
    form: impl Fn(&T) -> &Form,
    score: impl Fn(&T) -> f64,
    judge: impl Fn(Form) -> Option<T>,
) -> T {
    let mut sizes = form(&best).steps();
    for _ in 0..halvings {
        for (place, size) in &sizes {
            for direction in [1.0, -1.0] {
                // Along one coordinate as long as it helps, but not without end.
                for _ in 0..4 {
                    let mut factors = [1.0; 3];
                    factors[*place] = size.powf(direction);
                    let Some(next) = judge(form(&best).scaled(factors)) else { break };
                    if score(&next) <= score(&best) + 1e-6 {
                        break;
                    }
                    best = next;
                }
            }
        }
        for (_, size) in &mut sizes {
            *size = size.sqrt();
        }
    }
    best
}
