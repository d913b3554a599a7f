//! Which values of the model are wrong: groups of parameters that the evidence wants free.

use nalgebra::DVector;
use rivet_dynamics::Parameter;

use crate::effect::Effect;
use crate::search::Search;

/// A group may be fixed at its nominal value when that costs less log evidence than this.
const WORTH: f64 = 4.0;
/// What is left to a group that is fixed, as a share of its usual error.
const FIXED: f64 = 0.03;

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
    let with = |fixed: &[Group]| -> DVector<f64> {
        let mut std = usual.clone();
        for group in fixed {
            group.columns.iter().for_each(|c| std[*c] *= FIXED / scale);
        }
        std
    };
    let mut free = groups(search);
    let mut fixed: Vec<Group> = Vec::new();
    if scale <= FIXED {
        fixed = std::mem::take(&mut free);
    }
    let evidence = |search: &mut Search<'_>, fixed: &[Group]| {
        search.design.background.std = with(fixed);
        let blocks = search.design.background.blocks();
        Some(search.design.background.solve(&search.weights, scale, 0..blocks)?.log_evidence)
    };
    let mut now = evidence(search, &fixed)?;
    while !free.is_empty() {
        let mut best: Option<(f64, usize)> = None;
        for at in 0..free.len() {
            fixed.push(free[at].clone());
            let without = evidence(search, &fixed)?;
            fixed.pop();
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
    search.design.background.std = with(&fixed);
    search.scale = scale;
    Some(free)
}
