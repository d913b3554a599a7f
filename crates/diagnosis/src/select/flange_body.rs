//! One body at the flange in place of values of many links that explain the same.
//!
//! All values are free beside every effect, and ten columns of a body are columns that the last link has already: on an arm
//! that leaves far more than noise whatever is done, as measured ones do, its links take a payload up among them, each by a
//! little more than it may be wrong. Evidence counts what they take of the model's own errors as well and prefers them. There
//! it is asked how much of what the links take one body takes alone: it loads every joint before it by its weight, so
//! several must lose most of their gap at once.

use nalgebra::DVector;
use rivet_dynamics::Parameter;

use crate::effects::payload::Payload;
use crate::effects::physical_bounds::{self, Impossible};
use crate::fit::evidence::{Belief, FOLDS, Solved};
use crate::fit::search::{Candidate, Search};
use crate::model::listener::Listener;
use crate::policy::POLICY;
use crate::select::adopted::Adopted;
use crate::select::forward::{Found, Selected};
use crate::select::residual::Residue;

/// The body, where it is the simpler explanation; nothing where the equations of the question have no solution.
/// `impossible`: what of a body that would be is none.
pub(crate) fn at_flange(
    search: &mut Search<'_>,
    selected: &Selected<'_>,
    impossible: &mut Option<Impossible>,
    listener: &mut dyn Listener,
) -> Option<Found> {
    // Down at the noise evidence says all there is to say.
    if !Residue::from_search(search).any_noisy() {
        return Some(None);
    }
    let Some(mut candidate) = search.candidate(Payload.into(), &selected.physics) else { return Some(None) };
    let Some(belief) = one_body(search, &candidate) else { return Some(None) };
    candidate.belief = belief;
    let free = search.solved(search.scale)?;
    let with_links_held = links_held(search)?;
    let background = &search.design.background;
    let joints = search.noise.len();
    let added = with_links_held.add(&candidate.cells, &candidate.belief, &search.weights, |_| true)?;
    let sum = |of: &dyn Fn(usize) -> Vec<f64>| -> Vec<f64> {
        let folds: Vec<Vec<f64>> = (0..FOLDS).map(of).collect();
        (0..joints).map(|j| folds.iter().map(|f| f[j]).sum()).collect()
    };
    let before = sum(&|f| background.fold_errors(f, &with_links_held));
    let links = sum(&|f| background.fold_errors(f, &free));
    let body = sum(&|f| background.fold_errors_with(&candidate.cells, &[], f, &added));
    let taken = |left: &[f64]| -> f64 { (0..joints).map(|j| search.weights[j] * (before[j] - left[j])).sum() };
    let share = taken(&body) / taken(&links).max(f64::MIN_POSITIVE);
    let falls: Vec<f64> = (0..joints).map(|j| 1.0 - body[j] / before[j].max(f64::MIN_POSITIVE)).collect();
    let gain = added.log_evidence - with_links_held.log_evidence;
    listener.line(&format!(
        "a body at the flange {:.3?} takes {share:.2} of what all links take; by joint {falls:.2?}",
        added.c.as_slice()
    ));
    // The share tells nothing apart: 0.78 to 0.96 without a load, 0.85 to 1.17 with one. The joints do.
    let stands = candidate.form.plausible(added.c.as_slice())
        && falls.iter().all(|fall| *fall >= -POLICY.adoption.max_body_loss_share)
        && falls.iter().filter(|fall| **fall >= POLICY.adoption.min_body_gap_share).count()
            >= POLICY.plausibility.min_body_joints;
    if !stands {
        return Some(None);
    }
    *impossible = physical_bounds::of_payload(added.c.as_slice(), &search.nominal.model.arm);
    if impossible.is_some() {
        return Some(None);
    }
    let adoption = Adopted::new(search, &candidate, &selected.physics, gain)?;
    Some(Some((candidate, adoption)))
}

/// Whether one body at the flange leaves no joint more than `most` times what values of all links leave (root mean squares), and has the evidence:
/// then the two are not told apart, as where the arm has no link that a load would not be part of.
pub(crate) fn instead_of_links(search: &mut Search<'_>, selected: &Selected<'_>, most: f64) -> Option<bool> {
    let Some(mut candidate) = search.candidate(Payload.into(), &selected.physics) else { return Some(false) };
    let Some(belief) = one_body(search, &candidate) else { return Some(false) };
    candidate.belief = belief;
    let free = search.solved(search.scale)?;
    let with_links_held = links_held(search)?;
    let added = with_links_held.add(&candidate.cells, &candidate.belief, &search.weights, |_| true)?;
    let c = added.c.as_slice();
    let is_one = candidate.form.plausible(c)
        && physical_bounds::of_payload(c, &search.nominal.model.arm).is_none()
        && added.log_evidence > free.log_evidence;
    let background = &search.design.background;
    let alike = |j: usize| {
        let sum = |of: &dyn Fn(usize) -> Vec<f64>| (0..FOLDS).map(|f| of(f)[j]).sum::<f64>();
        let links = sum(&|f| background.fold_errors(f, &free));
        sum(&|f| background.fold_errors_with(&candidate.cells, &[], f, &added)) <= most * most * links
    };
    Some(is_one && (0..search.noise.len()).all(alike))
}

/// Solved with values of links held near the file's.
fn links_held(search: &mut Search<'_>) -> Option<Solved> {
    let usual = search.design.background.std.clone();
    for (at, parameter) in search.nominal.model.parameters.iter().enumerate() {
        if matches!(parameter, Parameter::Link { .. }) {
            search.design.background.std[at] *= POLICY.priors.held_link_share / search.scale;
        }
    }
    let solved = search.solved(search.scale);
    search.design.background.std = usual;
    solved
}

/// What is believed of a body's ten parameters: its mass, and how far its centre is from the origin, which says how large the
/// others may be. Each of them free, they would take up what no body has: a negative mass far away.
fn one_body(search: &Search<'_>, candidate: &Candidate) -> Option<Belief> {
    let far = POLICY.plausibility.body_distance_share * physical_bounds::reach(&search.nominal.model.arm);
    let mass = search.free(&candidate.columns, 0).filter(|_| far > 0.0)?;
    let entry = |c: usize| match c {
        0 => mass,
        1..=3 => mass * far,
        _ => mass * far * far,
    };
    let count = candidate.belief.std.len();
    Some(Belief { mean: DVector::zeros(count), std: DVector::from_iterator(count, (0..count).map(entry)) })
}
