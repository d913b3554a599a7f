//! Which values of the model are wrong: groups of parameters that the evidence wants free.

use nalgebra::DVector;
use rivet_dynamics::Parameter;

use crate::effect::Effect;
use crate::search::Search;

/// A group may be fixed at its nominal value when that costs less log evidence than this.
const WORTH: f64 = 4.0;
/// What is left to a group that is fixed, as a share of its usual error.
const FIXED: f64 = 0.03;
/// What a free group may be wrong by, at least, as a share of its usual error: where most values are right their common
/// scale is small, and the one that is not would look impossible by it.
const FREE: f64 = 1.0;

/// Parameters that stand or fall together.
#[derive(Clone, Debug)]
pub(crate) struct Group {
    pub(crate) effect: Effect,
    pub(crate) joint: usize,
    pub(crate) columns: Vec<usize>,
}

fn groups(search: &Search<'_>) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    for (at, parameter) in search.nominal.model.parameters.iter().enumerate() {
        let (effect, joint) = match *parameter {
            Parameter::Link { link, .. } => (Effect::LinkInertia, link),
            Parameter::RotorInertia(j) => (Effect::RotorInertia, j),
            Parameter::Viscous(j) => (Effect::ViscousFriction, j),
            Parameter::Coulomb(j) => (Effect::CoulombFriction, j),
            // Effects in general, but values of a model that has them.
            Parameter::LoadFriction(j) => (Effect::LoadDependentFriction, j),
            Parameter::ViscousQuadratic(j) => (Effect::ViscousNonlinearity, j),
            _ => continue,
        };
        match groups.iter_mut().find(|g| g.effect == effect && g.joint == joint) {
            Some(group) => group.columns.push(at),
            None => groups.push(Group { effect, joint, columns: vec![at] }),
        }
    }
    groups
}

/// Groups whose values are wrong. All others are held near their nominal values from now on.
pub(crate) fn wrong(search: &mut Search<'_>) -> Option<Vec<Group>> {
    let scale = search.best()?.0;
    let usual = search.design.background.std.clone();
    let scaled = search.design.background.scaled.clone();
    let with = |free: &[Group], fixed: &[Group]| -> DVector<f64> {
        let mut std = usual.clone();
        for (groups, width) in [(free, FREE.max(scale)), (fixed, FIXED)] {
            // The solver multiplies by the scale where it applies; the width here is whole.
            let each = groups.iter().flat_map(|g| &g.columns);
            each.for_each(|c| std[*c] *= if scaled[*c] { width / scale } else { width.min(1.0) });
        }
        std
    };
    let mut free = groups(search);
    let mut fixed: Vec<Group> = Vec::new();
    let evidence = |search: &mut Search<'_>, free: &[Group], fixed: &[Group]| {
        search.design.background.std = with(free, fixed);
        let blocks = search.design.background.blocks();
        Some(search.design.background.solve(&search.weights, scale, 0..blocks)?.log_evidence)
    };
    let mut now = evidence(search, &free, &fixed)?;
    while !free.is_empty() {
        let mut best: Option<(f64, usize)> = None;
        for at in 0..free.len() {
            let group = free.remove(at);
            fixed.push(group);
            let without = evidence(search, &free, &fixed)?;
            free.insert(at, fixed.pop()?);
            if best.is_none_or(|(e, _)| without > e) {
                best = Some((without, at));
            }
        }
        let (without, at) = best?;
        if without < now - WORTH {
            break;
        }
        now = now.max(without);
        fixed.push(free.remove(at));
    }
    search.design.background.std = with(&free, &fixed);
    search.scale = scale;
    Some(free)
}
