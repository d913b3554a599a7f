//! Wrong values of the model: the groups that the evidence wants free.

use nalgebra::DVector;

use crate::effects::Effect;
use crate::effects::physical_bounds::Impossible;
use crate::fit::evidence::Solved;
use crate::fit::search::Search;
use crate::policy::POLICY;
use crate::select::adopted::{self, Adopted};
use crate::select::value_group::{self, Group};

/// The same of one that is to stay as it is. Less than this and the equations lose their digits.
const FROZEN: f64 = 1e-4;

fn groups(search: &Search<'_>) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    let of_coupling = search.nominal.model.structure.coupling.map_or(0, |coupling| coupling.driven);
    for (at, parameter) in search.nominal.model.parameters.iter().enumerate() {
        let Some((effect, joint)) = Effect::of_value(*parameter, of_coupling) else { continue };
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
    /// Of these, those that would come out as no arm has them.
    pub(crate) impossible: Vec<(Group, Impossible)>,
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
    fn std_with(&self, free: &[Group], held: &[Group]) -> DVector<f64> {
        let mut std = self.usual.clone();
        for (groups, width) in
            [(free, POLICY.priors.min_free_group_share.max(self.scale)), (held, POLICY.priors.fixed_group_share)]
        {
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
        let (free, dropped) = self.split(dropped);
        let held_groups: Vec<Group> = self.held.iter().cloned().chain(dropped).collect();
        self.solved(search, self.widths.std_with(&free, &held_groups))
    }

    /// The same; `frozen`: those at `dropped` and impossible ones exactly as given, however much they would take.
    pub(crate) fn solve_held(&self, search: &mut Search<'_>, dropped: &[usize], frozen: bool) -> Option<Solved> {
        if !frozen {
            return self.without(search, dropped);
        }
        let (free, dropped) = self.split(dropped);
        let mut std = self.widths.std_with(&free, &self.held);
        let impossible = self.impossible.iter().flat_map(|(group, _)| &group.columns);
        for c in dropped.iter().flat_map(|group| &group.columns).chain(impossible) {
            std[*c] = self.widths.usual[*c] * FROZEN;
        }
        self.solved(search, std)
    }

    /// Groups that are not `dropped`, and those that are.
    fn split(&self, dropped: &[usize]) -> (Vec<Group>, Vec<Group>) {
        let (dropped, free): (Vec<_>, Vec<_>) =
            self.groups.iter().cloned().enumerate().partition(|(at, _)| dropped.contains(at));
        let groups = |of: Vec<(usize, Group)>| of.into_iter().map(|(_, group)| group).collect();
        (groups(free), groups(dropped))
    }

    fn solved(&self, search: &mut Search<'_>, std: DVector<f64>) -> Option<Solved> {
        let kept = std::mem::replace(&mut search.design.background.std, std);
        let solved = search.solved(self.widths.scale);
        search.design.background.std = kept;
        solved
    }

    /// Gives the design its beliefs from before back.
    pub(crate) fn undo(&self, search: &mut Search<'_>) {
        search.design.background.std.clone_from(&self.widths.usual);
    }
}

/// Groups whose values are wrong. All others are held near their nominal values from now on, and so are those that would come
/// out impossible: what they would take is left, for a value that can be or for nobody.
pub(crate) fn wrong(search: &mut Search<'_>, adopted: &[Adopted]) -> Option<Wrong> {
    let scale = search.best()?.0;
    let background = &search.design.background;
    let widths = Widths { usual: background.std.clone(), scaled: background.scaled.clone(), scale };
    let mut impossible: Vec<(Group, Impossible)> = Vec::new();
    loop {
        let (free, held) = chosen(search, &widths, &impossible)?;
        search.design.background.std = widths.std_with(&free, &held);
        let solved = search.solved(scale)?;
        let standard = adopted::standard(search.nominal, &solved.x, adopted);
        let impossible_value = |group: &Group| value_group::of_group(group, search.nominal, &standard, adopted);
        let found: Vec<(Group, Impossible)> =
            free.iter().filter_map(|g| Some((g.clone(), impossible_value(g)?))).collect();
        if found.is_empty() {
            search.scale = scale;
            return Some(Wrong { groups: free, held, impossible, widths });
        }
        impossible.extend(found);
    }
}

/// Groups that the evidence wants free, but for those that came out `impossible`, and the others.
fn chosen(
    search: &mut Search<'_>,
    widths: &Widths,
    impossible: &[(Group, Impossible)],
) -> Option<(Vec<Group>, Vec<Group>)> {
    let (mut held, mut free): (Vec<Group>, Vec<Group>) =
        groups(search).into_iter().partition(|g| impossible.iter().any(|(other, _)| other.columns == g.columns));
    let evidence = |search: &mut Search<'_>, free: &[Group], held: &[Group]| {
        search.design.background.std = widths.std_with(free, held);
        Some(search.solved(widths.scale)?.log_evidence)
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
        if without < now - POLICY.adoption.min_group_evidence {
            break;
        }
        now = now.max(without);
        held.push(free.remove(at));
    }
    Some((free, held))
}
