//! Transport delay or first-order lag: the size of each, and which of the two the evidence supports.
//!
//! Most of what either leaves is at reversals, where friction's own beginning looks like more or less of it: sizes told from there were off by
//! a third. Where [rows in which joints turn](Behind) tell, they decide; where they do not, the two are one class.

use std::cell::OnceCell;

use nalgebra::DVector;

use crate::effects::Form;
use crate::effects::current_loop_lag::Lag;
use crate::effects::physics::Physics;
use crate::effects::transport_delay::Delay;
use crate::fit::evidence::Belief;
use crate::fit::search::{Candidate, Search, Standing};
use crate::policy::POLICY;
use crate::screen::torque_timing::lateness::Behind;
use crate::screen::torque_timing::{Early, Pooled, Size};
use crate::select::adopted::{Adopted, Rival, is_part};
use crate::select::residual::Residue;

/// Times that what was adopted is made anew.
const MADE_AGAIN: usize = 3;

/// A candidate of a size; none where rows in motion rule it out.
pub(crate) type Sized = Option<(Candidate, Standing)>;
/// What else it may be; none where it is told from that.
pub(crate) type Other = Option<Rival>;

/// What rows in motion say; looked up once it is needed.
#[derive(Default)]
pub(crate) struct Clock {
    told: OnceCell<(Option<Pooled>, Option<Behind>)>,
}

impl Clock {
    fn estimates(&self, search: &Search<'_>) -> &(Option<Pooled>, Option<Behind>) {
        self.told.get_or_init(|| {
            let early = Early::from_runs(&search.runs);
            let behind = Behind::fit(&search.runs, search.nominal, &early);
            (early.pooled, behind)
        })
    }
}

impl Behind {
    /// Whether what is there is the other of the two for sure.
    fn rules_out(&self, form: &Form) -> bool {
        if is_delay(form) { self.ahead < -POLICY.adoption.rival_gap } else { self.ahead > POLICY.adoption.rival_gap }
    }

    fn size(&self, form: &Form) -> Size {
        let seconds = if is_delay(form) { self.delay } else { self.lag };
        Size { seconds, std: POLICY.timing.max_size_error * seconds }
    }
}

/// Which of the two it is.
fn is_delay(form: &Form) -> bool {
    form.get::<Delay>().is_some()
}

/// The other of the two, of a size that is still to be found.
fn other(form: &Form) -> Form {
    if is_delay(form) { Lag { stands: true }.into() } else { Delay { seconds: 0.0 }.into() }
}

/// Time by which a command that stands for its sample is late beside a lag \[s\]; a delay has it in its own.
fn hold_delay_s(form: &Form, physics: &[Physics<'_>]) -> Option<f64> {
    Some(match form.get() {
        Some(lag @ Lag { stands: true }) => lag.hold_delay_samples() * physics.first()?.period_s(),
        _ => 0.0,
    })
}

impl<'a> Search<'a> {
    /// What was adopted last, made of the torque that the model has now: it is the model's own torque, moved, and values that were fitted
    /// without it have friction too low and bodies wrong. Signals of the runs with it; none where the equations have no solution.
    pub(crate) fn made_again(
        &mut self,
        candidate: &Candidate,
        adoption: &mut Adopted,
        mut physics: Vec<Physics<'a>>,
    ) -> Option<Vec<Physics<'a>>> {
        let mut last = candidate.clone();
        for _ in 0..MADE_AGAIN {
            let Some(mut next) = self.candidate(candidate.form.clone(), &physics) else { break };
            next.belief = candidate.belief.clone();
            let values = candidate.form.made_with(physics.first()?).to_vec();
            self.design.give_up(&adoption.mean);
            let Some(made) = self.extend(&next, &adoption.mean) else {
                // As it was: there it had a solution.
                let before = self.extend(&last, &adoption.mean);
                return before.map(|_| physics);
            };
            (physics, last) = (made, next);
            adoption.values = values;
        }
        Some(physics)
    }

    /// A delay or lag of the size that rows in motion have, where they tell, and the other where they rule it out; else refined as any form, and
    /// where rows in motion are against that size, or a delay is wanted in part only, of the size that they have, if they are sure of one.
    /// `Some(None)`: no size makes sense; `None`: the equations have no solution.
    pub(crate) fn late(&self, form: &Form, clock: &Clock, physics: &[Physics<'_>]) -> Option<Sized> {
        match clock.estimates(self) {
            (_, Some(behind)) => {
                let form = if behind.rules_out(form) { other(form) } else { form.clone() };
                Some(self.of_size(&form, behind.size(&form), physics))
            }
            (None, None) => Some(Some(self.refine(form, physics)?)),
            (Some(pooled), None) => {
                let (candidate, standing) = self.refine(form, physics)?;
                let c = standing.added.c[0];
                let seconds = match candidate.form.get() {
                    Some(Delay { seconds }) => seconds * c,
                    None => c + hold_delay_s(form, physics)?,
                };
                // A part of a longer delay is a lag's curve, and no size.
                if !pooled.is_against(seconds, Residue::from_search(self).any_noisy())
                    && !is_part(&candidate.form, &standing)
                {
                    return Some(Some((candidate, standing)));
                }
                Some(pooled.size().and_then(|size| self.of_size(form, size, physics)))
            }
        }
    }

    /// A candidate that has the arm so far behind its torque.
    fn of_size(&self, form: &Form, size: Size, physics: &[Physics<'_>]) -> Option<(Candidate, Standing)> {
        let sized = if is_delay(form) { Delay { seconds: size.seconds }.into() } else { form.clone() };
        let mut candidate = self.candidate(sized, physics)?;
        let (mean, unit) = match candidate.form.get() {
            Some(&Delay { seconds }) => (1.0, seconds),
            None => (size.seconds - hold_delay_s(form, physics)?, 1.0),
        };
        candidate.belief = Belief { mean: DVector::repeat(1, mean), std: DVector::repeat(1, size.std / unit) };
        let standing = self.standing(0, &candidate, &self.scales())?;
        Some((candidate, standing))
    }

    /// The lag beside a delay, or the delay beside a lag, where the runs do not tell the two apart.
    pub(crate) fn other_kind_of_late(
        &self,
        (one, its): (&Candidate, &Standing),
        clock: &Clock,
        physics: &[Physics<'_>],
    ) -> Other {
        let other = other(&one.form);
        let other = if is_delay(&other) { Delay { seconds: its.added.c[0] }.into() } else { other };
        let (other, standing) = match &clock.estimates(self).1 {
            Some(behind) if behind.rules_out(&other) => return None,
            // Rows in motion that have no size tell nothing of the kind: the two stay one class.
            _ => match self.late(&other, clock, physics)? {
                Some(sized) => sized,
                None => self.refine(&other, physics)?,
            },
        };
        let cosine = self.cosine(&self.solved(self.scale)?, (one, &its.added.c), (&other, &standing.added.c))?;
        Some(Rival { form: other.form, cosine, is_kept: false })
    }
}
