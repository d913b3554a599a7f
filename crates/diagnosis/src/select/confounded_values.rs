//! Values of the model and effects that are confounded: which of the two the evidence prefers.
//!
//! Values are free beside every effect, so an effect that they imitate never shows as a gap: an encoder whose zero is off
//! looks like links whose masses are elsewhere. Here it is tried instead of them: the values are held where the file has
//! them, the effect is free, and the evidence decides. What the runs alone cannot tell apart, because the torques lie along
//! each other, is one class: beliefs about values put one first, and a motion of its own would show.

use nalgebra::DVector;

use crate::effects::Effect;
use crate::effects::Form;
use crate::effects::physics::Physics;
use crate::fit::evidence::{CandidateSums, Solved};
use crate::fit::search::{Candidate, Search};
use crate::model::listener::Listener;
use crate::numerics::parallel;
use crate::policy::POLICY;
use crate::select::adopted::{Adopted, Rival, is_full};
use crate::select::forward::{Found, Selected};
use crate::select::residual::Residue;
use crate::select::value_group::Group;
use crate::select::values::Wrong;

/// Values that are behind by more than this need not be listed: it is what an effect needs over all values free, and what
/// sets rivals apart.
const FAR_BEHIND: f64 = POLICY.adoption.min_gain[0] + POLICY.adoption.rival_gap;

/// An effect that takes the place of wrong values.
struct Instead {
    candidate: Candidate,
    /// Its coefficients.
    c: Vec<f64>,
    /// Places of the values among the wrong ones.
    replaces: Vec<usize>,
    /// Log evidence with it over that with the values.
    ahead: f64,
    /// Log evidence that it adds where the values are held.
    gain: f64,
    /// Cosine of the principal angle between it and the values.
    cosine: f64,
}

/// The effect to adopt instead of values that were found wrong, with these and other such effects as its rivals.
pub(crate) fn replace(
    search: &mut Search<'_>,
    wrong: &Wrong,
    selected: &Selected<'_>,
    listener: &mut dyn Listener,
) -> Option<Found> {
    // Where more than noise is left, as on measured arms, what sets two explanations apart may be what neither explains.
    if is_full(&selected.adopted) || Residue::from_search(search).any_noisy() {
        return Some(None);
    }
    let found = find(search, wrong, selected)?;
    let least = |i: &Instead| i.candidate.form.least_replacement_gain();
    let name = |group: &Group| format!("{} {}", group.effect, group.joint + 1);
    for i in &found {
        let values: Vec<String> = i.replaces.iter().map(|at| name(&wrong.groups[*at])).collect();
        listener.line(&format!(
            "  {:?} {:.4?} instead of {}: {:.1} ahead, gain {:.0}, cosine {:.3}",
            i.candidate.form,
            i.c,
            values.join(", "),
            i.ahead,
            i.gain,
            i.cosine
        ));
    }
    let Some((first, others)) = found.split_first().filter(|(first, _)| first.ahead >= least(first)) else {
        return Some(None);
    };
    let (candidate, place) = (&first.candidate, |at: &&usize| first.replaces.contains(at));
    let mut adoption = Adopted::new(search, candidate, &selected.physics, first.gain)?;
    let c = DVector::from_column_slice(&first.c);
    for other in others {
        let (form, near) = (&other.candidate.form, other.ahead >= first.ahead - POLICY.adoption.rival_gap);
        if near && form.effect() != candidate.form.effect() && other.replaces.iter().any(|at| place(&at)) {
            let its = DVector::from_column_slice(&other.c);
            // Values that one of them takes the place of would carry what the two have in common.
            let mut replaced = first.replaces.clone();
            replaced.extend(other.replaces.iter().filter(|at| !first.replaces.contains(at)));
            let solved = wrong.without(search, &replaced)?;
            let cosine = search.cosine(&solved, (candidate, &c), (&other.candidate, &its))?;
            adoption.rivals.extend(Rival::if_confounded(form, cosine));
        }
    }
    if first.ahead < FAR_BEHIND {
        let values = first.replaces.iter().filter_map(|at| wrong.groups[*at].form());
        adoption.rivals.extend(values.map(|form| Rival { form, cosine: first.cosine, is_kept: false }));
    }
    Some(Some((candidate.clone(), adoption)))
}

/// What the runs cannot tell from some of the wrong values and what is worth a name where these are held; best first, no two
/// of the same effect on the same joints.
fn find(search: &mut Search<'_>, wrong: &Wrong, selected: &Selected<'_>) -> Option<Vec<Instead>> {
    let groups = &wrong.groups;
    let all = wrong.without(search, &[])?;
    let solved: Vec<Solved> =
        (0..groups.len()).map(|at| wrong.without(search, &[at])).collect::<Option<Vec<Solved>>>()?;
    let weights = search.weights.clone();
    let tried: Vec<&Candidate> = selected.candidates.iter().filter(|c| is_rival(&c.form, &selected.adopted)).collect();
    let best = |candidate: &&Candidate| -> Option<(f64, usize)> {
        let sums = all.sums(&candidate.cells, &weights, |_| true)?;
        let one = |at: usize| {
            if !touches(&candidate.form, &groups[at]) {
                return None;
            }
            let added = solved[at].add_sums(&sums, &candidate.belief)?;
            let evidence = added.log_evidence - candidate.price();
            let along = cosine(&all, &solved[at], &sums, &added.c)? >= POLICY.adoption.min_partly_confounded_cosine;
            (along && stands(&candidate.form, added.c.as_slice())).then_some((evidence, at))
        };
        (0..groups.len()).filter_map(one).max_by(|a, b| a.0.total_cmp(&b.0))
    };
    let mut ranked: Vec<(f64, usize, &Candidate)> = parallel::map(&tried, best)
        .into_iter()
        .zip(&tried)
        .filter_map(|(found, c)| found.map(|(evidence, at)| (evidence, at, *c)))
        .collect();
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut seen: Vec<(Effect, Vec<usize>)> = Vec::new();
    let mut found = Vec::new();
    for (_, first, candidate) in ranked {
        let key = (candidate.form.effect(), candidate.form.joints());
        if seen.contains(&key) {
            continue;
        }
        if seen.len() == POLICY.adoption.max_explanations_tried {
            break;
        }
        seen.push(key);
        let instead = whole(search, wrong, candidate, &selected.physics, first)?;
        found
            .extend(instead.filter(|i| {
                i.gain >= POLICY.adoption.min_gain[0] && i.cosine >= POLICY.adoption.min_confounded_cosine
            }));
    }
    found.sort_by(|a: &Instead, b| b.ahead.total_cmp(&a.ahead));
    Some(found)
}

/// None where the effect makes no sense.
type Whole = Option<Instead>;

/// The effect instead of the group at `first` and of all others that it makes needless, its inner values refined.
fn whole(
    search: &mut Search<'_>,
    wrong: &Wrong,
    start: &Candidate,
    physics: &[Physics<'_>],
    first: usize,
) -> Option<Whole> {
    let refined = |search: &Search<'_>, form: &Form, solved: &Solved| {
        Some(search.refine_over(form, physics, &[(search.scale, solved.clone())])?.0)
    };
    let mut candidate = start.clone();
    let mut dropped = vec![first];
    let mut with_replaced_held = wrong.without(search, &dropped)?;
    for _ in 0..=wrong.groups.len() {
        if candidate.form.inner_values() > 0 {
            let Some(better) = refined(search, &candidate.form, &with_replaced_held) else { return Some(None) };
            candidate = better;
        }
        let weights = &search.weights;
        let sums = with_replaced_held.sums(&candidate.cells, weights, |_| true)?;
        let now = with_replaced_held.add_sums(&sums, &candidate.belief)?.log_evidence;
        let mut next: Option<(f64, usize, Solved)> = None;
        for at in 0..wrong.groups.len() {
            if dropped.contains(&at) || !touches(&candidate.form, &wrong.groups[at]) {
                continue;
            }
            let more: Vec<usize> = dropped.iter().copied().chain([at]).collect();
            let solved = wrong.without(search, &more)?;
            let evidence = solved.add_sums(&sums, &candidate.belief)?.log_evidence;
            if evidence >= now - POLICY.adoption.min_group_evidence
                && next.as_ref().is_none_or(|(best, ..)| evidence > *best)
            {
                next = Some((evidence, at, solved));
            }
        }
        let Some((_, at, solved)) = next else { break };
        dropped.push(at);
        with_replaced_held = solved;
    }
    let sums = with_replaced_held.sums(&candidate.cells, &search.weights, |_| true)?;
    let added = with_replaced_held.add_sums(&sums, &candidate.belief)?;
    let evidence = added.log_evidence - candidate.price();
    let all = wrong.without(search, &[])?;
    if candidate.columns.is_empty() {
        candidate = search.candidate(candidate.form, physics)?;
    }
    Some(stands(&candidate.form, added.c.as_slice()).then(|| Instead {
        gain: evidence - with_replaced_held.log_evidence,
        ahead: evidence - all.log_evidence,
        cosine: cosine(&all, &with_replaced_held, &sums, &added.c).unwrap_or(0.0),
        c: added.c.iter().copied().collect(),
        replaces: dropped,
        candidate,
    }))
}

/// Cosine of the angle between an effect's torque and what values can make of it that are free in `free` and held in `held`,
/// beside all else that is free in both.
fn cosine(free: &Solved, held: &Solved, sums: &CandidateSums, c: &DVector<f64>) -> Option<f64> {
    let (left, whole) = (free.remaining_square(sums, c)?, held.remaining_square(sums, c)?);
    Some((1.0 - left / whole.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0).sqrt())
}

/// Whether a form may take the place of values: it is none itself, was not adopted, and is exact. What a simulated gear
/// misses is large beside noise.
fn is_rival(form: &Form, adopted: &[Adopted]) -> bool {
    let about = form.effect().about();
    let value = about.is_drive || about.is_link_body;
    let taken = adopted.iter().any(|a| a.form.effect() == form.effect() && a.form.joints() == form.joints());
    // Values hold throughout; what comes and goes over minutes is left by them.
    !value && !taken && !form.is_slow() && !form.is_simulated() && !form.is_nameless() && form.coefficients() > 0
}

/// Whether a form makes sense in a value's place, and is not itself that value: friction over the angle has a level beside its wave. (A wave of 7
/// mN m about a level that was off by 0.56 N m was ahead by 14, since a level alone has a prior as narrow as files are sure.)
fn stands(form: &Form, c: &[f64]) -> bool {
    !form.wave_is_below(c, 1.0) && form.plausible(c)
}

/// Whether a form and a group have to do with each other: a joint feels its own drive and the links behind it.
fn touches(form: &Form, group: &Group) -> bool {
    let joints = form.joints();
    let near = |j: &usize| if group.effect.about().is_link_body { *j <= group.joint } else { *j == group.joint };
    form.effect() != group.effect && (joints.is_empty() || joints.iter().any(near))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::load_dependent_friction::Load;
    use crate::effects::position_dependent_friction::PositionFriction;

    /// A wave of a hundredth of the level that comes with it is the level; one that is the larger part is friction over the angle.
    #[test]
    fn friction_over_the_angle_is_its_wave() {
        let form = PositionFriction { joint: 5, order: 132.2 }.into();
        assert!(!stands(&form, &[-0.0056, -0.0044, 0.5623]));
        assert!(stands(&form, &[3.0, 1.0, -2.0]));
        assert!(stands(&Load { joint: 1 }.into(), &[0.1]), "one number has nothing beside it");
    }
}
