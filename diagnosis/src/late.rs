//! Delay or lag: how large, and which of the two.
//!
//! Most of what either leaves is at reversals, where friction's own beginning looks like more or less of it: sizes told from there were off by
//! a third, and a lag of 4 ms was called a delay. Where [the rows in which joints turn](Behind) tell, they decide; where they do not, the
//! two are one class.

use nalgebra::DVector;

use crate::alignment::Behind;
use crate::evidence::Belief;
use crate::form::{Form, HELD};
use crate::physics::Physics;
use crate::search::{Candidate, Search, Standing};
use crate::select::{Adopted, RIVAL_GAP, Rival};

/// How surely it is as large as rows in motion have it, as a share of that.
const SIZED: f64 = 0.02;
/// Times that what was adopted is made anew.
const MADE_AGAIN: usize = 3;

/// A candidate of a size; none where rows in motion rule it out.
pub(crate) type Sized = Option<(Candidate, Standing)>;
/// What else it may be; none where it is told from that.
pub(crate) type Other = Option<Rival>;

impl Behind {
    /// Whether what is there is the other of the two for sure.
    fn rules_out(&self, form: &Form) -> bool {
        match form {
            Form::Delay { .. } => self.ahead < -RIVAL_GAP,
            _ => self.ahead > RIVAL_GAP,
        }
    }
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
        for _ in 0..MADE_AGAIN {
            let Some(mut next) = self.candidate(candidate.form.clone(), &physics) else { break };
            next.belief = candidate.belief.clone();
            let values = candidate.form.made_with(physics.first()?).to_vec();
            self.design.give_up(&adoption.mean);
            physics = self.extend(&next, &adoption.mean)?;
            adoption.values = values;
        }
        Some(physics)
    }

    /// A delay or lag of the size that rows in motion have, where they tell, else refined as any form; nothing where they rule it out, or
    /// where the size makes no sense.
    pub(crate) fn behind(&self, form: &Form, behind: Option<&Behind>, physics: &[Physics<'_>]) -> Option<Sized> {
        match behind {
            None => self.refine(form, physics).map(Some),
            Some(behind) if behind.rules_out(form) => Some(None),
            Some(behind) => Some(self.of_size(form, behind, physics)),
        }
    }

    /// A candidate of the size that `behind` has.
    fn of_size(&self, form: &Form, behind: &Behind, physics: &[Physics<'_>]) -> Option<(Candidate, Standing)> {
        let sized = match form {
            Form::Delay { .. } => Form::Delay { seconds: behind.delay },
            other => other.clone(),
        };
        let mut candidate = self.candidate(sized, physics)?;
        let mean = match candidate.form {
            Form::Lag { stands: true } => behind.lag - HELD * physics.first()?.period_s(),
            Form::Lag { .. } => behind.lag,
            _ => 1.0,
        };
        candidate.belief = Belief { mean: DVector::repeat(1, mean), std: DVector::repeat(1, SIZED * mean.abs()) };
        let standing = self.standing(0, &candidate, &self.scales())?;
        Some((candidate, standing))
    }

    /// The lag beside a delay, or the delay beside a lag, where the runs do not tell the two apart.
    pub(crate) fn other_kind_of_late(
        &self,
        (one, its): (&Candidate, &Standing),
        behind: Option<&Behind>,
        physics: &[Physics<'_>],
    ) -> Option<Other> {
        let other = match one.form {
            Form::Delay { .. } => Form::Lag { stands: true },
            _ => Form::Delay { seconds: its.added.c[0] },
        };
        let made = match behind {
            Some(behind) if behind.rules_out(&other) => return Some(None),
            Some(behind) => self.of_size(&other, behind, physics),
            None => Some(self.refine(&other, physics)?),
        };
        let Some((other, standing)) = made else { return Some(None) };
        let cosine = self.cosine(&self.solved(self.scale)?, (one, &its.added.c), (&other, &standing.added.c))?;
        Some(Rival::of(&other.form, cosine))
    }
}
