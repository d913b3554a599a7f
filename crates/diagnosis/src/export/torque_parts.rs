//! Torque of a model along the runs, one part at a time: bodies, drives, effects.

use rivet_dynamics::{KnownEffect, Model, ParameterGroup};

use crate::effects::known;
use crate::export::formats::{Part, PartKind};
use crate::model::nominal::Nominal;
use crate::model::rows::Column;
use crate::screen::prepared::Prepared;

/// A model with its values along runs.
pub(crate) struct Told<'a> {
    pub(crate) runs: &'a [&'a Prepared],
    pub(crate) model: &'a Model,
    /// Standard columns of the model, by run.
    pub(crate) columns: Vec<&'a Vec<Column>>,
    /// Standard parameters.
    pub(crate) values: &'a [f64],
}

impl Told<'_> {
    /// Torque of standard parameters `[joint][row]`, rows of all runs behind each other \[N·m\].
    pub(crate) fn torque(&self, value: impl Fn(usize) -> f64) -> Vec<Vec<f64>> {
        let mut torque = vec![Vec::new(); self.model.arm.dof()];
        for (run, columns) in self.runs.iter().zip(&self.columns) {
            for (j, torque) in torque.iter_mut().enumerate() {
                let mut sum = vec![0.0; run.rows()];
                for (c, column) in columns.iter().enumerate() {
                    if let (Some(rows), factor) = (&column[j], value(c))
                        && factor != 0.0
                    {
                        sum.iter_mut().zip(rows).for_each(|(s, v)| *s += factor * v);
                    }
                }
                torque.extend(sum);
            }
        }
        torque
    }

    /// Groups of values that the model has.
    pub(crate) fn groups(&self) -> Vec<Part> {
        const GROUPS: [(&str, PartKind); 8] = [
            ("bodies", PartKind::Group(ParameterGroup::Inertial)),
            ("rotor inertia behind the gear", PartKind::Group(ParameterGroup::RotorInertia)),
            ("viscous friction", PartKind::Group(ParameterGroup::Friction)),
            ("Coulomb friction", PartKind::Coulomb),
            ("friction with the load", PartKind::LoadFriction),
            ("friction with the square of speed", PartKind::ViscousQuadratic),
            ("torque offset", PartKind::Group(ParameterGroup::Offset)),
            ("coupled wrist motor", PartKind::Group(ParameterGroup::Coupling)),
        ];
        let value_of_kind = |kind: PartKind, c: usize| {
            if PartKind::from_parameter(self.model.parameters[c]) == kind { self.values[c] } else { 0.0 }
        };
        GROUPS
            .into_iter()
            .filter(|(_, kind)| (0..self.values.len()).any(|c| value_of_kind(*kind, c) != 0.0))
            .map(|(what, kind)| Part { what: what.to_owned(), kind, torque: self.torque(|c| value_of_kind(kind, c)) })
            .collect()
    }

    /// Effects beside the values.
    pub(crate) fn effects(&self, effects: &[KnownEffect]) -> Vec<Part> {
        let exact = Nominal::exact(self.model, self.values);
        let part = |effect: &KnownEffect| {
            let mut torque = vec![Vec::new(); self.model.arm.dof()];
            for run in self.runs {
                let full = known::torque(&exact, std::slice::from_ref(effect), &run.run, &run.motion);
                torque.iter_mut().zip(&full).for_each(|(to, full)| to.extend(run.chain.apply(full)));
            }
            let joint = if effect.kind.is_global() { "all joints" } else { &self.model.arm.joints[effect.joint].name };
            Part {
                what: format!("{} of {joint}", effect.kind.name().replace('_', " ")),
                kind: PartKind::Effect(*effect),
                torque,
            }
        };
        effects.iter().map(part).collect()
    }
}
