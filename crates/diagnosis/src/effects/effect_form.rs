//! The questions that every form of an effect answers, with the answers of one that has nothing special.

use rivet_dynamics::{KnownEffect, Parameter};

use crate::effects::carried::Carried;
use crate::effects::columns::Full;
use crate::effects::physical_bounds::{Impossible, of_value};
use crate::effects::physics::Physics;
use crate::effects::{Effect, Kind};
use crate::model::nominal::Nominal;
use crate::policy::POLICY;

/// Standard vector that sizes are told by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SizeReference {
    /// As in the file.
    Nominal,
    /// As fitted with the effect.
    Fitted,
    /// By which its column was made.
    Column,
}

/// A form of an effect on its joints, with its inner values; its coefficients are found by the fit.
pub(crate) trait EffectForm: Clone {
    /// The effect it belongs to, or would be taken for.
    fn effect(&self) -> Effect;

    /// The joints it is reported on; empty when it belongs to all or to none.
    fn joints(&self) -> Vec<usize>;

    /// How many columns it has; contact has as many as its time needs, here 0.
    fn coefficients(&self) -> usize {
        1
    }

    /// How many inner values were searched for.
    fn inner_values(&self) -> usize {
        0
    }

    /// Columns at the rate of the log; none when the run lacks a signal the form needs.
    fn columns(&self, p: &Physics<'_>) -> Vec<Full>;

    /// The form with coefficients `c` as part of a robot file. `x` is the standard vector that its columns were made with;
    /// `reference_c` the motors' temperature at the start \[°C\]. Values beside the effect come second.
    fn carried(&self, c: &[f64], x: &[f64], joints: usize, reference_c: Option<&[f64]>)
    -> (Carried, Vec<(usize, f64)>);

    /// Size by name with unit, from the coefficients `c` of its columns; `reference`: see [`EffectForm::size_reference`].
    fn magnitude(&self, c: &[f64], joints: usize, reference: &[f64]) -> Vec<(String, f64)>;

    /// The standard vector that sizes are told by.
    fn size_reference(&self) -> SizeReference {
        SizeReference::Nominal
    }

    /// Standard vector that the columns of the form are made with.
    fn made_with<'a>(&self, physics: &'a Physics<'_>) -> &'a [f64] {
        &physics.x
    }

    /// Whether coefficients make sense for the effect.
    fn plausible(&self, c: &[f64]) -> bool {
        c.iter().all(|c| c.is_finite())
    }

    /// The standard parameter that it changes, where that is one.
    fn place(&self, _joints: usize) -> Option<usize> {
        None
    }

    /// The value of it that no arm has, if one is.
    fn impossible(&self, _c: &[f64], nominal: &Nominal, standard: &[f64]) -> Option<Impossible> {
        self.place(nominal.model.arm.dof()).and_then(|at| of_value(at, nominal, standard))
    }

    /// Whether it has a column of its own of a standard parameter.
    fn shares(&self, _parameter: Parameter, _joints: usize) -> bool {
        false
    }

    /// Whether all of it is a change of standard parameters.
    fn changes_values(&self) -> bool {
        false
    }

    /// With inner values multiplied by `factors`; angles move by the factor's logarithm.
    fn scaled(&self, _factors: [f64; 3]) -> Self {
        self.clone()
    }

    /// First step of each inner value as a factor, with its place; none for forms without.
    fn steps(&self) -> Vec<(usize, f64)> {
        Vec::new()
    }

    /// With what the fitted coefficient says of an inner value, where the two belong together.
    fn settled(&self, _c: f64) -> Option<Self> {
        None
    }

    /// Cycles per turn of the joint, of forms that have such.
    fn order(&self) -> Option<f64> {
        None
    }

    /// Whether the size of the effect is in its inner values, so that the coefficient is 1.
    fn has_fixed_gain(&self) -> bool {
        false
    }

    /// Whether it is simulated: such forms are never exact, and what they miss is not another effect.
    fn is_simulated(&self) -> bool {
        self.has_fixed_gain()
    }

    /// Whether its columns change smoothly with its inner values; a simulated gear's do not.
    fn is_smooth(&self) -> bool {
        !self.is_simulated()
    }

    /// Least coefficient: one that is wanted at a part of its size imitates what another form leaves.
    fn least_coefficient(&self) -> Option<f64> {
        None
    }

    /// Standard deviation that is believed of its coefficients, where that is no matter of the torque.
    fn prior_std(&self) -> Option<f64> {
        None
    }

    /// Whether some of its columns may be in no joint's torque.
    fn has_unfelt_columns(&self) -> bool {
        false
    }

    /// Whether the runs show what the form is about.
    fn is_observed(&self, _runs: &[Physics<'_>]) -> bool {
        true
    }

    /// Whether its columns lie in stretches of time that are solved for by themselves.
    fn has_stretches(&self) -> bool {
        false
    }

    /// Whether its torque depends on the angle alone: nothing of how friction changes sign spoils it.
    fn of_angle_alone(&self) -> bool {
        false
    }

    /// Whether it follows the angle, no faster than a few times over the joint's `range` \[rad\].
    fn bends_slowly(&self, _range: &dyn Fn(usize) -> f64) -> bool {
        self.of_angle_alone()
    }

    /// Whether it is the same torque, later.
    fn shifts_time(&self) -> bool {
        false
    }

    /// Whether it comes and goes over minutes, on several joints at once.
    fn is_slow(&self) -> bool {
        false
    }

    /// Whether the smoothing of positions looks like a little of it.
    fn is_like_smoothing(&self) -> bool {
        false
    }

    /// Whether it is no effect of the list, only what is held against one.
    fn is_nameless(&self) -> bool {
        false
    }

    /// Whether half of it is a constant torque.
    fn is_half_constant(&self) -> bool {
        false
    }

    /// Whether it is the zero of the torque signal, which is no part of the arm.
    fn is_torque_zero(&self) -> bool {
        false
    }

    /// Whether it is a factor of the joint's torque.
    fn is_gain(&self) -> bool {
        false
    }

    /// Whether its wave is below this share of the level beside it.
    fn wave_is_below(&self, _c: &[f64], _share: f64) -> bool {
        false
    }

    /// Log evidence by which it has to be ahead of wrong values.
    fn least_replacement_gain(&self) -> f64 {
        POLICY.adoption.min_replacement_gain
    }

    /// Forms of one effect on the same joints that are refined apart from each other.
    fn kind(&self) -> usize {
        0
    }

    /// Whether the motion alone determines what the effect does.
    fn is_predictable(&self) -> bool {
        true
    }

    /// Whether wrong values of the model can look like the effect: then the held-out gain over a refit of all values is
    /// small although the values it takes are absurd, and the evidence alone decides.
    fn hides(&self) -> bool {
        self.effect().kind() == Kind::Value
    }

    /// Puts effects that were made with the values `fitted` in terms of those `written` with them.
    fn convert(&self, _effects: &mut [KnownEffect], _joints: usize, _fitted: &[f64], _written: &[f64]) {}
}
