//! The values that files get: physically consistent, and nearer to the runs than the nominal ones on every trusted joint.
//!
//! On one joint they may be a little further where they are much nearer on the others.
//!
//! Base parameters that fit are free, so bodies and drives behind them are sought; where the model lacks something they may be
//! nowhere near. A file that is worse than the one it was made from helps nobody: then drives, and at last all of it, stay as given.

use rivet_dynamics::{BaseSet, KnownEffect, Model, Parameter};
use rivet_estimation::consistency::{ConsistencyError, Projection, Reference, project, project_torque};

use crate::export::torque_parts::Told;
use crate::model::nominal::Nominal;
use crate::model::rows::Column;
use crate::policy::POLICY;
use crate::report::details::Unsure;
use crate::screen::prepared::Prepared;
use crate::select::adopted::Adopted;

/// Groups of drive values of a joint in the standard vector: rotor inertia, viscous, Coulomb, offset.
const DRIVE: std::ops::Range<usize> = 10..14;

/// Which values stay as given whatever was found, by place.
#[derive(Clone, Debug, Default)]
pub(crate) struct Kept {
    /// Of joints whose torque is not believed.
    pub(crate) unbelieved: Vec<usize>,
    /// That the runs do not pin.
    pub(crate) unpinned: Vec<usize>,
    /// The joints whose torque is not believed.
    pub(crate) unheard: Vec<usize>,
}

impl Kept {
    /// Values of drives that a file keeps as they are: of joints whose torque is not believed, and those that runs do not pin and
    /// no cause `named`.
    pub(crate) fn new(nominal: &Nominal, unheard: Vec<usize>, unsure: &Unsure, named: &[usize]) -> Kept {
        let parameters = nominal.model.parameters.iter().enumerate();
        let drive = parameters.filter(|(_, p)| !matches!(p, Parameter::Link { .. }));
        let (unbelieved, rest): (Vec<_>, Vec<_>) =
            drive.partition(|(_, p)| p.joint().is_some_and(|j| unheard.contains(&j)));
        let open = |(c, p): &(usize, &Parameter)| {
            !matches!(p, Parameter::Offset(_))
                && unsure.share[*c] >= POLICY.plausibility.max_pinned_share
                && !named.contains(c)
        };
        let places = |of: Vec<(usize, &Parameter)>| of.into_iter().map(|(c, _)| c).collect();
        Kept { unpinned: places(rest.into_iter().filter(open).collect()), unbelieved: places(unbelieved), unheard }
    }

    pub(crate) fn columns(&self) -> impl Iterator<Item = usize> + '_ {
        self.unbelieved.iter().chain(&self.unpinned).copied()
    }

    fn put_back(&self, values: &mut [f64], standard: &[f64]) {
        self.columns().for_each(|c| values[c] = standard[c]);
    }
}

/// A model to be written, before its values are those of an arm that can be built.
pub(crate) struct Draft<'a> {
    pub(crate) nominal: &'a Nominal,
    pub(crate) runs: &'a [&'a Prepared],
    /// Under the gravity that holds.
    pub(crate) model: &'a Model,
    pub(crate) columns: Vec<&'a Vec<Column>>,
    /// Values as the data gave them, those that stay as given with what effects add to them.
    pub(crate) standard: &'a [f64],
    /// The file's own effects, then those found.
    pub(crate) effects: &'a [KnownEffect],
    pub(crate) adopted: &'a [Adopted],
    pub(crate) kept: &'a Kept,
}

/// What is written.
#[derive(Clone)]
pub(crate) struct Written {
    pub(crate) values: Vec<f64>,
    pub(crate) effects: Vec<KnownEffect>,
    /// The nearest arm that can be built.
    pub(crate) consistent: Result<Projection, ConsistencyError>,
    /// Joints whose drive values stay as given, since the file would be worse there.
    pub(crate) stayed: Vec<usize>,
    /// Whether bodies do as well.
    pub(crate) bodies_stay: bool,
    /// Whether nothing found is nearer to the runs than the model as given.
    pub(crate) as_given: bool,
}

impl Draft<'_> {
    /// The values to write instead of `base`, which is known within `covariance`.
    pub(crate) fn settle(&self, set: &BaseSet, base: &[f64], covariance: &[f64], reference: &Reference) -> Written {
        let given = &self.nominal.x;
        let nearest = project(self.model, set, base, covariance, given, reference);
        let by_torque = || project_torque(self.model, set, base, given, reference);
        let mut best: Option<(f64, Written)> = None;
        let before = self.gaps_as_given();
        let first = nearest.clone();
        for found in std::iter::once(nearest).chain(std::iter::once_with(by_torque)) {
            let Ok(projection) = &found else { continue };
            let mut values = projection.standard.clone();
            self.kept.put_back(&mut values, self.standard);
            let effects = self.effects_with(&values);
            let gaps = self.gaps(&values, &effects);
            let all = relative(&gaps, &before);
            if best.as_ref().is_none_or(|(other, _)| all < *other) {
                let nothing = Vec::new();
                let one = Written {
                    values,
                    effects,
                    consistent: found,
                    stayed: nothing,
                    bodies_stay: false,
                    as_given: false,
                };
                best = Some((all, one));
            }
            if worse(&gaps, &before).is_empty() {
                break;
            }
        }
        let mut written = best.map_or_else(|| self.bodies_as_given(first), |(_, written)| written);
        self.mend(&mut written, &before);
        written
    }

    /// Puts drives back joint by joint where the file would be worse than the one given, then bodies, then everything; unless the file is worth
    /// a joint that is a little worse.
    fn mend(&self, written: &mut Written, before: &[Option<f64>]) {
        let (given, n) = (&self.nominal.x, self.model.arm.dof());
        let found = written.clone();
        for _ in 0..=n {
            let worse = worse(&self.gaps(&written.values, &written.effects), before);
            let new: Vec<usize> = worse.iter().copied().filter(|j| !written.stayed.contains(j)).collect();
            if worse.is_empty() {
                return;
            }
            if new.is_empty() {
                break;
            }
            for j in &new {
                DRIVE.for_each(|group| written.values[group * n + j] = given[group * n + j]);
            }
            written.stayed.extend(new);
            written.effects = self.effects_with(&written.values);
        }
        if is_worth(&self.gaps(&found.values, &found.effects), before) {
            *written = found;
            return;
        }
        let consistent = written.consistent.clone();
        *written = self.bodies_as_given(consistent);
        if worse(&self.gaps(&written.values, &written.effects), before).is_empty() {
            return;
        }
        written.effects = self.nominal.model.effects().list().to_vec();
        written.as_given = true;
    }

    /// Only the effects that were found.
    fn bodies_as_given(&self, consistent: Result<Projection, ConsistencyError>) -> Written {
        let values = self.nominal.x.clone();
        let effects = self.effects_with(&values);
        let stayed = (0..self.model.arm.dof()).collect();
        Written { values, effects, consistent, stayed, bodies_stay: true, as_given: false }
    }

    fn effects_with(&self, values: &[f64]) -> Vec<KnownEffect> {
        let mut effects = self.effects.to_vec();
        let nominal_effects = self.nominal.model.effects().list().len();
        for Adopted { form, values: fitted, .. } in self.adopted {
            form.convert(&mut effects[nominal_effects..], self.model.arm.dof(), fitted, values);
        }
        effects
    }

    /// Root mean square that is left on each joint by `values` and `effects`, where it can be heard \[N·m\].
    pub(crate) fn gaps(&self, values: &[f64], effects: &[KnownEffect]) -> Vec<Option<f64>> {
        let predicted = Told { runs: self.runs, model: self.model, columns: self.columns.clone(), values };
        self.joint_rms(&predicted, effects)
    }

    /// The same of the model as given.
    pub(crate) fn gaps_as_given(&self) -> Vec<Option<f64>> {
        let columns = self.runs.iter().map(|run| &run.standard).collect();
        let nominal = self.nominal;
        let predicted = Told { runs: self.runs, model: &nominal.model, columns, values: &nominal.x };
        self.joint_rms(&predicted, nominal.model.effects().list())
    }

    fn joint_rms(&self, told: &Told<'_>, effects: &[KnownEffect]) -> Vec<Option<f64>> {
        let mut torque = told.torque(|c| told.values[c]);
        for part in told.effects(effects) {
            for (to, part) in torque.iter_mut().zip(&part.torque) {
                to.iter_mut().zip(part).for_each(|(to, v)| *to += v);
            }
        }
        let joint_rms = |(j, torque): (usize, &Vec<f64>)| {
            let (mut square, mut rows, mut from) = (0.0, 0usize, 0);
            for run in self.runs {
                let run_torque = &torque[from..from + run.rows()];
                from += run.rows();
                if run.silent[j].is_none() && !self.kept.unheard.contains(&j) {
                    square += run.tau[j].iter().zip(run_torque).map(|(tau, model)| (tau - model).powi(2)).sum::<f64>();
                    rows += run.rows();
                }
            }
            (rows > 0).then(|| (square / rows as f64).sqrt())
        };
        torque.iter().enumerate().map(joint_rms).collect()
    }
}

/// Joints on which `gaps` are larger than `before`.
pub(crate) fn worse(gaps: &[Option<f64>], before: &[Option<f64>]) -> Vec<usize> {
    let is = |j: &usize| matches!((gaps[*j], before[*j]), (Some(gap), Some(before)) if gap > POLICY.plausibility.max_equal_gap_ratio * before);
    (0..gaps.len()).filter(is).collect()
}

/// Whether gaps are so much smaller than `before` that a joint may have a larger one.
fn is_worth(gaps: &[Option<f64>], before: &[Option<f64>]) -> bool {
    let judged = gaps.iter().zip(before).filter(|(gap, before)| gap.is_some() && before.is_some()).count();
    let spoilt = |j: usize| matches!((gaps[j], before[j]), (Some(gap), Some(before)) if gap > POLICY.plausibility.max_written_joint_ratio * before);
    relative(gaps, before) <= POLICY.plausibility.max_written_gap_share * judged as f64 && !(0..gaps.len()).any(spoilt)
}

/// Sum of the squares of gaps in parts of those before.
pub(crate) fn relative(gaps: &[Option<f64>], before: &[Option<f64>]) -> f64 {
    let each = gaps.iter().zip(before).filter_map(|(gap, before)| Some((*gap)? / (*before)?.max(f64::MIN_POSITIVE)));
    each.map(|share| share * share).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_joint_that_is_a_little_worse_does_not_keep_a_load_from_a_file() {
        let of = |gaps: &[f64]| is_worth(&gaps.iter().map(|g| Some(*g)).collect::<Vec<_>>(), &[Some(1.0); 4]);
        assert!(of(&[1.2, 0.3, 0.3, 0.3]));
        assert!(!of(&[1.3, 0.1, 0.1, 0.1]), "one is spoilt");
        assert!(!of(&[1.2, 0.8, 0.7, 0.6]), "little is gained");
        assert!(!is_worth(&[Some(1.2), None], &[Some(1.0), None]));
    }
}
