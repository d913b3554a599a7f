//! Adopted effects with their rivals, and the values of the model with them.

use nalgebra::DVector;

use crate::effects::Effect;
use crate::effects::Form;
use crate::effects::carried::Carried;
use crate::effects::physics::Physics;
use crate::fit::search::{Candidate, Search, Standing};
use crate::model::nominal::Nominal;
use crate::policy::POLICY;

/// An effect that was adopted.
#[derive(Clone, Debug)]
pub(crate) struct Adopted {
    pub(crate) form: Form,
    /// Gain of log evidence over the model without it.
    pub(crate) gain: f64,
    /// Share of each joint's residual variance that it removed, held out; the largest of them.
    pub(crate) shares: Vec<f64>,
    pub(crate) share: f64,
    /// How often chance alone shows one of the candidates as plainly; none where it was not drawn.
    pub(crate) p_value: Option<f64>,
    /// What else explains this about as well.
    pub(crate) rivals: Vec<Rival>,
    /// Where its columns begin in the design.
    pub(crate) place: usize,
    /// Standard vector that its columns were made with.
    pub(crate) values: Vec<f64>,
    /// Joints whose torque it changes.
    pub(crate) acts_on: Vec<bool>,
    /// Prior mean of its coefficients.
    pub(crate) mean: Vec<f64>,
    /// The form with one inner value at an end of its 90 % interval, for each end that is known.
    pub(crate) inner_ends: Vec<Form>,
    /// Whether it is a law of the angle while another one has evidence, too.
    pub(crate) another_law: bool,
}

/// What explains the same as an adopted effect.
#[derive(Clone, Debug)]
pub(crate) struct Rival {
    /// As it was refined.
    pub(crate) form: Form,
    /// Cosine of the principal angle between the two.
    pub(crate) cosine: f64,
    /// Whether it may be ahead with other bodies, so that no evidence with these sets it aside.
    pub(crate) is_kept: bool,
}

impl Rival {
    /// None where the two are so far apart that what explains as much is not the same thing.
    pub(crate) fn if_confounded(form: &Form, cosine: f64) -> Option<Rival> {
        (cosine >= POLICY.adoption.min_confounded_cosine).then(|| Rival { form: form.clone(), cosine, is_kept: false })
    }
}

impl Adopted {
    /// Its coefficients where the background is solved as `x`.
    pub(crate) fn coefficients(&self, x: &DVector<f64>) -> Vec<f64> {
        self.mean.iter().enumerate().map(|(k, mean)| x[self.place + k] + mean).collect()
    }

    /// Effects of the rivals, each once, and the angle between it and this one \[rad\].
    pub(crate) fn class(&self) -> Vec<(Effect, f64)> {
        let mut class: Vec<(Effect, f64)> = Vec::new();
        for rival in &self.rivals {
            if class.iter().all(|(effect, _)| *effect != rival.form.effect()) {
                class.push((rival.form.effect(), rival.cosine.clamp(0.0, 1.0).acos()));
            }
        }
        class
    }

    /// A form by itself.
    #[cfg(test)]
    pub(crate) fn alone(form: Form) -> Adopted {
        Adopted {
            form,
            gain: 100.0,
            shares: Vec::new(),
            share: 0.9,
            p_value: None,
            rivals: Vec::new(),
            place: 0,
            values: Vec::new(),
            acts_on: Vec::new(),
            mean: Vec::new(),
            inner_ends: Vec::new(),
            another_law: false,
        }
    }

    /// A candidate without rivals, before it is added to the model.
    pub(crate) fn new(
        search: &Search<'_>,
        candidate: &Candidate,
        physics: &[Physics<'_>],
        gain: f64,
    ) -> Option<Adopted> {
        let joints = search.noise.len();
        Some(Adopted {
            form: candidate.form.clone(),
            gain,
            shares: vec![0.0; joints],
            share: 0.0,
            p_value: None,
            rivals: Vec::new(),
            place: search.design.background.len(),
            values: candidate.form.made_with(physics.first()?).to_vec(),
            acts_on: (0..joints)
                .map(|j| !candidate.local.is_empty() || candidate.cells.iter().any(|c| c.joint == j))
                .collect(),
            mean: candidate.belief.mean.iter().copied().collect(),
            inner_ends: Vec::new(),
            another_law: false,
        })
    }
}

/// The standard vector with values `x` of the background and values that were adopted as forms of their own.
pub(crate) fn standard<'a>(
    nominal: &Nominal,
    x: &DVector<f64>,
    adopted: impl IntoIterator<Item = &'a Adopted>,
) -> Vec<f64> {
    let mut standard: Vec<f64> = nominal.x.iter().zip(x.iter()).map(|(given, change)| given + change).collect();
    for a in adopted.into_iter().filter(|a| a.form.changes_values()) {
        let c = a.coefficients(x);
        if let (Carried::Values(changes), _) = a.form.carried(&c, &a.values, nominal.model.arm.dof(), None) {
            for (at, change) in changes {
                standard[at] += change;
            }
        }
    }
    standard
}

/// Whether as many effects as may be were adopted.
pub(crate) fn is_full(adopted: &[Adopted]) -> bool {
    let warming = adopted.iter().filter(|a| a.form.is_slow()).count();
    adopted.len() - warming.saturating_sub(1) >= POLICY.adoption.max_effects
}

/// Whether a simulated gear, or a delay, is wanted at a part of its size only: then it imitates what another one leaves.
pub(crate) fn is_part(form: &Form, standing: &Standing) -> bool {
    form.least_coefficient().is_some_and(|least| standing.added.c[0] < least)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::presliding_friction::Presliding;
    use crate::effects::transport_delay::Delay;
    use crate::fit::evidence::Added;

    fn standing(c: f64) -> Standing {
        let none = || DVector::zeros(0);
        let added = Added { c: DVector::repeat(1, c), x: none(), stretches: Vec::new(), log_evidence: 0.0 };
        Standing { at: 0, gain: 50.0, added }
    }

    /// Play that a gear's form leaves is a delay of half its size; bristles have a level that may be anything.
    #[test]
    fn a_delay_is_wanted_in_full() {
        let delay = Delay { seconds: 0.006 }.into();
        assert!(is_part(&delay, &standing(0.56)) && !is_part(&delay, &standing(0.70)));
        assert!(!is_part(&Presliding { joint: 0, length: 0.005 }.into(), &standing(0.56)));
    }
}
