//! Which parameters may act: every published set has to earn it.

use crate::law::ComputedTorque;
use rivet_dynamics::{Model, Parameter};
use rivet_ipc_schema::{MAX_PARAMETERS, Parameters, parameter_flags};

/// Why a published set was not adopted. `Copy` and without text: it is made inside the control period.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum Refusal {
    /// Nothing was refused.
    #[default]
    None,
    /// It was made for another model: kinematics, gravity, structure or base columns differ.
    OtherModel,
    /// Its number of parameters is not the model's.
    WrongCount,
    /// Made from samples not newer than those of the set in use: a repeated or replayed message.
    Old,
    /// The daemon itself says that it has too little data.
    Provisional,
    /// A value is not finite.
    NotFinite,
    /// A viscous or Coulomb coefficient is negative: friction would drive the joint.
    DrivingFriction,
    /// The inertia matrix at the present pose is not positive definite.
    InertiaNotPositive,
}

impl Refusal {
    /// What the user reads.
    pub fn text(self) -> &'static str {
        match self {
            Refusal::None => "adopted",
            Refusal::OtherModel => "made for another model (hash differs): start both from the same robot.toml",
            Refusal::WrongCount => "number of parameters differs from the model's",
            Refusal::Old => "not newer than the set in use",
            Refusal::Provisional => "the daemon marks it provisional: too little data so far",
            Refusal::NotFinite => "a value is not finite",
            Refusal::DrivingFriction => "a friction coefficient is negative",
            Refusal::InertiaNotPositive => "the inertia matrix is not positive definite at the present pose",
        }
    }
}

/// Holds what the checks need: which base columns are friction coefficients.
pub struct Gate {
    hash: u64,
    friction: Vec<usize>,
    count: usize,
}

impl Gate {
    /// `independent` lists the standard column of each base parameter.
    pub fn new(model: &Model, independent: &[usize], hash: u64) -> Gate {
        let is_friction = |column: &usize| {
            matches!(model.parameters.get(*column), Some(Parameter::Viscous(_) | Parameter::Coulomb(_)))
        };
        let friction = (0..independent.len()).filter(|&i| is_friction(&independent[i])).collect();
        Gate { hash, friction, count: independent.len().min(MAX_PARAMETERS) }
    }

    /// Whether `set` may act at pose `q`; `newest` is the sample number of the set in use (its epoch would not do: a
    /// restarted daemon counts those anew). Real-time safe.
    pub fn check(&self, set: &Parameters, newest: u64, q: &[f64], law: &mut ComputedTorque) -> Refusal {
        if set.model_hash != self.hash {
            return Refusal::OtherModel;
        }
        if set.len() != self.count {
            return Refusal::WrongCount;
        }
        if set.seq <= newest {
            return Refusal::Old;
        }
        if set.flags & parameter_flags::PROVISIONAL != 0 {
            return Refusal::Provisional;
        }
        let values = &set.values[..self.count];
        if !values.iter().all(|x| x.is_finite()) {
            return Refusal::NotFinite;
        }
        // An identified coefficient that is zero within its own uncertainty may come out slightly negative.
        if self.friction.iter().any(|&i| values[i] < -2.0 * set.std[i].max(0.0)) {
            return Refusal::DrivingFriction;
        }
        if !law.inertia_is_positive(q, values) {
            return Refusal::InertiaNotPositive;
        }
        Refusal::None
    }
}
