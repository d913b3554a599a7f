//! Which values of the model are wrong: groups of parameters that the evidence wants free.

use nalgebra::DVector;
use rivet_dynamics::Parameter;

use crate::effect::Effect;
use crate::evidence::Solved;
use crate::form::Form;
use crate::search::Search;

/// A group may be fixed at its nominal value when that costs less log evidence than this.
pub(crate) const WORTH: f64 = 4.0;
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

impl Group {
    /// The form that has the same torque, as far as one has.
    pub(crate) fn form(&self) -> Option<Form> {
        let joint = self.joint;
        match self.effect {
            Effect::LinkInertia => Some(Form::LinkScale { link: joint }),
            Effect::RotorInertia => Some(Form::RotorInertia { joint }),
            Effect::CoulombFriction => Some(Form::Coulomb { joint }),
            Effect::ViscousFriction => Some(Form::Viscous { joint }),
            Effect::LoadDependentFriction => Some(Form::Load { joint }),
            Effect::ViscousNonlinearity => Some(Form::ViscousNonlinearity { joint }),
            _ => None,
        }
    }
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

/// Which values are wrong, and how all of them are believed then.
#[derive(Clone)]
pub(crate) struct Wrong {
    /// Those that are.
    pub(crate) groups: Vec<Group>,
    /// The others, held near their nominal values.
    pub(crate) held: Vec<Group>,
    widths: Widths,
}

/// Prior standard deviations before any group was freed or held.
#[derive(Clone)]
struct Widths {
    usual: DVector<f64>,
    scaled: Vec<bool>,
    scale: f64,
}

impl Widths {
    fn with(&self, free: &[Group], held: &[Group]) -> DVector<f64> {
        let mut std = self.usual.clone();
        for (groups, width) in [(free, FREE.max(self.scale)), (held, FIXED)] {
            // The solver multiplies by the scale where it applies; the width here is whole.
            let each = groups.iter().flat_map(|g| &g.columns);
            each.for_each(|c| std[*c] *= if self.scaled[*c] { width / self.scale } else { width.min(1.0) });
        }
        std
    }
}

impl Wrong {
    /// The background solved with the wrong groups free, but for those at `dropped`, which are held as the others.
    pub(crate) fn without(&self, search: &mut Search<'_>, dropped: &[usize]) -> Option<Solved> {
        let split = |wanted: bool| {
            let own = self.groups.iter().enumerate().filter(move |(at, _)| dropped.contains(at) == wanted);
            own.map(|(_, g)| g.clone()).collect::<Vec<_>>()
        };
        let held: Vec<Group> = self.held.iter().cloned().chain(split(true)).collect();
        let kept = std::mem::replace(&mut search.design.background.std, self.widths.with(&split(false), &held));
        let solved = search.solved(self.widths.scale);
        search.design.background.std = kept;
        solved
    }

    /// Gives the design its beliefs from before back.
    pub(crate) fn undo(&self, search: &mut Search<'_>) {
        search.design.background.std.clone_from(&self.widths.usual);
    }
}

/// Groups whose values are wrong. All others are held near their nominal values from now on.
pub(crate) fn wrong(search: &mut Search<'_>) -> Option<Wrong> {
    let scale = search.best()?.0;
    let background = &search.design.background;
    let widths = Widths { usual: background.std.clone(), scaled: background.scaled.clone(), scale };
    let mut free = groups(search);
    let mut held: Vec<Group> = Vec::new();
    let evidence = |search: &mut Search<'_>, free: &[Group], held: &[Group]| {
        search.design.background.std = widths.with(free, held);
        Some(search.solved(scale)?.log_evidence)
    };
    let mut now = evidence(search, &free, &held)?;
    while !free.is_empty() {
        let mut best: Option<(f64, usize)> = None;
        for at in 0..free.len() {
            let group = free.remove(at);
            held.push(group);
            let without = evidence(search, &free, &held)?;
            free.insert(at, held.pop()?);
            if best.is_none_or(|(e, _)| without > e) {
                best = Some((without, at));
            }
        }
        let (without, at) = best?;
        if without < now - WORTH {
            break;
        }
        now = now.max(without);
        held.push(free.remove(at));
    }
    search.design.background.std = widths.with(&free, &held);
    search.scale = scale;
    Some(Wrong { groups: free, held, widths })
}
