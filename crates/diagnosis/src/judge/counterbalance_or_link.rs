//! Whether a counterbalance is confounded with the centre of mass of its link, which pulls by the same law of the angle.
//!
//! The values are free beside every effect, but only by as much as files usually are off; a centre that is on the wrong side of its joint is
//! far beyond that, and what is left looks like a spring. So a counterbalance is held against its own link, free as far as the link is
//! long: where that explains as much, the two are one class.

use rivet_dynamics::{Arm, Places};

use crate::effects::Effect;
use crate::effects::Form;
use crate::effects::counterbalance::{self, Counterweight};
use crate::effects::link_inertia::{self, LinkScale};
use crate::effects::motion_advice;
use crate::effects::payload;
use crate::effects::physical_bounds;
use crate::experiment::separating_motion::Class;
use crate::fit::search::Search;
use crate::model::listener::Listener;
use crate::policy::POLICY;
use crate::report::diagnosis::Diagnosis;
use crate::select::adopted::{Adopted, Rival};
use crate::select::flange_body;
use crate::select::forward::Selected;

/// What is left to columns that are held, as a share of what is believed of them; less and the equations lose their digits.
const HELD_COLUMN_ERROR_SHARE: f64 = 1e-4;

/// Adds the link to what a counterbalance is not told from; none where equations have no solution.
pub(crate) fn doubt(search: &mut Search<'_>, adopted: &mut [Adopted]) -> Option<()> {
    for one in adopted.iter_mut().filter(|a| a.form.effect() == counterbalance::EFFECT) {
        let [joint] = one.form.joints()[..] else { continue };
        let named = one.rivals.iter().any(|rival| rival.form.effect() == link_inertia::EFFECT);
        if !named {
            one.rivals.extend(rival(search, one, joint)?);
        }
    }
    Some(())
}

/// What may be in the place of wrong values of links, asked with all values free by as much as files usually are off.
#[derive(Default)]
pub(crate) struct Doubts {
    /// By joint: a counterbalance there, with its coefficients.
    counterbalance: Vec<Option<(Form, Vec<f64>)>>,
    /// One body at the flange.
    payload: bool,
}

impl Doubts {
    /// None where equations have no solution.
    pub(crate) fn find(
        search: &mut Search<'_>,
        selected: &Selected<'_>,
        listener: &mut dyn Listener,
    ) -> Option<Doubts> {
        let free = search.solved(search.scale)?;
        let mut counterbalance = Vec::new();
        for joint in 0..search.noise.len() {
            let form = Form::from(Counterweight { joint });
            let candidate = search.candidate(form.clone(), &selected.physics);
            let added = candidate.and_then(|c| free.add(&c.cells, &c.belief, &search.weights, |_| true));
            let added = added
                .filter(|added| added.log_evidence - free.log_evidence >= POLICY.adoption.min_counterbalance_doubt);
            if let Some(added) = &added {
                let gain = added.log_evidence - free.log_evidence;
                listener.line(&format!(
                    "a counterbalance on joint {} with free parameters: log evidence \
                              {gain:+.0}",
                    joint + 1
                ));
            }
            counterbalance.push(added.map(|added| (form, added.c.as_slice().to_vec())));
        }
        let payload = flange_body::instead_of_links(search, selected, POLICY.adoption.max_flange_rms_ratio)?;
        Some(Doubts { counterbalance, payload })
    }

    fn there(&self, joint: usize) -> Option<&(Form, Vec<f64>)> {
        self.counterbalance.get(joint)?.as_ref()
    }

    /// The counterbalances that values of these links may be, each with its coefficients and what it is told from.
    pub(crate) fn classes(&self, links: &[usize]) -> impl Iterator<Item = Class<'_>> {
        links.iter().filter_map(|link| {
            let (form, coefficients) = self.there(*link)?;
            let rivals = vec![LinkScale { link: *link }.into()];
            Some(Class { form, coefficients: coefficients.clone(), rivals })
        })
    }

    /// What values of these links are not told from.
    pub(crate) fn of_links(&self, links: &[usize]) -> Vec<Effect> {
        let mut found = Vec::new();
        if links.iter().any(|link| self.there(*link).is_some()) {
            found.push(counterbalance::EFFECT);
        }
        if self.payload && links.iter().any(|link| link + 1 == self.counterbalance.len()) {
            found.push(payload::EFFECT);
        }
        found
    }
}

impl Diagnosis {
    /// Whether values of links stand that are not told from this effect.
    pub(crate) fn links_may_be(&self, effect: Effect) -> bool {
        self.causes.iter().any(|c| c.effect == link_inertia::EFFECT && c.indistinguishable_from.contains(&effect))
    }

    /// Says of wrong values of links what they are not told from.
    pub(crate) fn links_are_not_told_from(&mut self, effects: &[Effect]) {
        let is_not_named = |e: &&Effect| !self.causes.iter().any(|cause| cause.effect == **e);
        let class: Vec<Effect> = effects.iter().filter(is_not_named).copied().collect();
        for cause in self.causes.iter_mut().filter(|cause| cause.effect == link_inertia::EFFECT) {
            if cause.indistinguishable_from.is_empty() {
                cause.separating_motion = motion_advice::motion(cause.effect, &class).filter(|_| !class.is_empty());
                cause.indistinguishable_from.clone_from(&class);
            }
        }
    }
}

/// The body of link `joint` instead of a counterbalance there, where it explains as much and is one that can be; else nothing.
fn rival(search: &mut Search<'_>, one: &Adopted, joint: usize) -> Option<Vec<Rival>> {
    let first_column = Places::link(joint).start;
    let mass = search.nominal.x[first_column];
    let far = length(&search.nominal.model.arm, joint);
    if mass <= 0.0 || far <= 0.0 {
        return Some(Vec::new());
    }
    let usual = search.design.background.std.clone();
    let scale = search.scale;
    let mut solve = |freed: bool, held: bool| {
        let background = &mut search.design.background;
        for entry in (1..10).filter(|_| freed) {
            let width = if entry < 4 { mass * far } else { mass * far * far };
            background.std[first_column + entry] =
                if background.scaled[first_column + entry] { width / scale } else { width };
        }
        for place in (one.place..one.place + one.mean.len()).filter(|_| held) {
            background.std[place] *= HELD_COLUMN_ERROR_SHARE;
        }
        let solved = search.solved(scale);
        let background = &search.design.background;
        let fold_errors = solved.as_ref().map(|solved| {
            let folds: Vec<Vec<f64>> = (0..background.folds.len()).map(|f| background.fold_errors(f, solved)).collect();
            (0..search.noise.len()).map(|j| folds.iter().map(|fold| fold[j]).sum()).collect::<Vec<f64>>()
        });
        search.design.background.std.clone_from(&usual);
        solved.zip(fold_errors)
    };
    let (_, with) = solve(false, false)?;
    let (_, neither) = solve(false, true)?;
    let (_, both) = solve(true, false)?;
    let (body, instead) = solve(true, true)?;
    let all = |left: &[f64]| -> f64 { left.iter().zip(&search.weights).map(|(left, weight)| left * weight).sum() };
    // Of the counterbalance's torque what the body cannot make, as a share.
    let across = (all(&instead) - all(&both)) / (all(&neither) - all(&both)).max(f64::MIN_POSITIVE);
    let alike = instead.iter().zip(&with).all(|(instead, with)| {
        *instead <= POLICY.adoption.max_body_rms_ratio * POLICY.adoption.max_body_rms_ratio * with
    });
    let moment = |entry: usize| search.nominal.x[first_column + entry] + body.x[first_column + entry];
    let centre = (1..4).map(|entry| (moment(entry) / mass).powi(2)).sum::<f64>().sqrt();
    let cosine = (1.0 - across).clamp(0.0, 1.0).sqrt();
    let rival = Rival::if_confounded(&LinkScale { link: joint }.into(), cosine).filter(|_| alike && centre <= far);
    Some(rival.into_iter().collect())
}

/// How far a link reaches from its joint \[m\]: to the next one, or its share of the arm.
fn length(arm: &Arm, link: usize) -> f64 {
    let norm = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
    let next = arm.joints.get(link + 1).map_or(0.0, |joint| norm(&joint.translation));
    next.max(physical_bounds::reach(arm) / arm.dof() as f64)
}
