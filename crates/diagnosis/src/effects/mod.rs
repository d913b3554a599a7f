//! The effects that can be named: their columns, inner values, grids, bounds, reported sizes and separating motions.
//!
//! One effect is one file and one line of the registration below. A file has the effect's entry in the list ([`About`]) and its forms, each
//! of which answers the questions of [`EffectForm`]; everything else asks [`Effect`] and [`Form`], which hand the question on. Forms
//! without an effect are held against others: what explains a gap has to be better than they are.

mod about;
pub(crate) mod angle_law;
mod backlash;
pub(crate) mod base_flexibility;
pub(crate) mod candidates;
pub(crate) mod carried;
pub(crate) mod columns;
pub(crate) mod coulomb_friction;
pub(crate) mod counterbalance;
pub(crate) mod current_loop_lag;
mod effect_form;
pub(crate) mod encoder_eccentricity;
pub(crate) mod encoder_offset;
pub(crate) mod external_force;
pub(crate) mod friction_asymmetry;
pub(crate) mod gravity_direction;
mod joint_coupling;
pub(crate) mod joint_elasticity;
mod joint_spring;
pub(crate) mod known;
pub(crate) mod link_inertia;
pub(crate) mod load_dependent_friction;
pub(crate) mod motion_advice;
pub(crate) mod payload;
pub(crate) mod physical_bounds;
pub(crate) mod physics;
pub(crate) mod position_dependent_friction;
pub(crate) mod presliding_friction;
pub(crate) mod rotor_inertia;
mod size;
pub(crate) mod stribeck_friction;
pub(crate) mod temperature_dependent_friction;
pub(crate) mod torque_constant;
pub(crate) mod torque_ripple;
pub(crate) mod torque_saturation;
mod transmission_error;
pub(crate) mod transport_delay;
mod two_mass;
pub(crate) mod variable;
pub(crate) mod viscous_friction;
pub(crate) mod viscous_nonlinearity;
mod warming;

use std::fmt;

use rivet_dynamics::{KnownEffect, Parameter};

pub use about::Kind;
pub(crate) use effect_form::SizeReference;

use about::About;
use carried::Carried;
use columns::Full;
use effect_form::EffectForm;
use physical_bounds::Impossible;
use physics::Physics;
use variable::Variable;

use crate::model::nominal::Nominal;

/// Effects in the order of the list, each with its file, its documentation and its forms; then files of forms without an effect.
macro_rules! register {
    (
        $d:tt
        effects { $($effect:ident $module:ident $doc:literal [$($form:ident)*];)* }
        others { $($other:ident [$($law:ident)*];)* }
    ) => {
        /// What makes an arm differ from its simulator. The names are a contract.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum Effect { $(#[doc = $doc] $effect,)* }

        impl Effect {
            /// All of them.
            pub const ALL: &'static [Effect] = &[$(Effect::$effect,)*];

            /// Its entry in the list.
            pub(crate) fn about(self) -> &'static About {
                match self { $(Effect::$effect => &$module::ABOUT,)* }
            }
        }

        /// An effect on a joint with its inner values; its coefficients are found by the fit.
        #[derive(Clone, PartialEq)]
        pub(crate) enum Form {
            $($($form($module::$form),)*)*
            $($($law($other::$law),)*)*
        }

        macro_rules! ask {
            ($d value:expr, $d form:ident => $d answer:expr) => {
                match $d value {
                    $($(Form::$form($d form) => $d answer,)*)*
                    $($(Form::$law($d form) => $d answer,)*)*
                }
            };
        }

        impl fmt::Debug for Form {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                ask!(self, form => fmt::Debug::fmt(form, f))
            }
        }

        $($(register!(form $module::$form, $form);)*)*
        $($(register!(form $other::$law, $law);)*)*
    };
    (form $path:path, $form:ident) => {
        impl From<$path> for Form {
            fn from(form: $path) -> Form {
                Form::$form(form)
            }
        }

        impl OfForm for $path {
            fn of(form: &Form) -> Option<&Self> {
                if let Form::$form(form) = form { Some(form) } else { None }
            }
        }
    };
}

/// A form's own type.
pub(crate) trait OfForm {
    /// The form where it is one of this type.
    fn of(form: &Form) -> Option<&Self>;
}

register! {
    $
    effects {
        LinkInertia link_inertia "Mass, centre of mass or inertia of a link." [LinkScale];
        Payload payload "A body at the flange." [Payload];
        GravityDirection gravity_direction "The base is not level." [Gravity];
        RotorInertia rotor_inertia "Drive inertia at the joint." [RotorInertia];
        CoulombFriction coulomb_friction "Friction that only knows the direction." [Coulomb];
        ViscousFriction viscous_friction "Friction proportional to speed." [Viscous];
        FrictionAsymmetry friction_asymmetry "Friction differs between the two directions." [Asymmetry OneSided Constant];
        StribeckFriction stribeck_friction "Friction falls with speed at low speed." [Stribeck];
        ViscousNonlinearity viscous_nonlinearity "Friction grows not in proportion to speed." [ViscousNonlinearity];
        LoadDependentFriction load_dependent_friction "Friction grows with the torque that the gear carries." [Load];
        TemperatureDependentFriction temperature_dependent_friction "Friction changes as the joint warms up." [Temperature Warming];
        PreslidingFriction presliding_friction "Friction acts like a spring before it slides." [Presliding Hysteresis];
        PositionDependentFriction position_dependent_friction "Friction varies with the joint's angle." [PositionFriction];
        TorqueConstant torque_constant "Torque per current, or per count, of one drive." [Gain TorqueLaw];
        TorqueRipple torque_ripple "Torque that varies with the angle of motor or gear." [Ripple];
        TransmissionError transmission_error "The gear's output angle varies about its input's." [TransmissionError];
        Backlash backlash "Play between motor and link." [];
        JointElasticity joint_elasticity "The gear is a spring between motor and link." [TwoMass];
        BaseFlexibility base_flexibility "What the arm stands on gives way." [Base];
        JointSpring joint_spring "A torque proportional to the joint's angle, as of a hose." [Spring SpringBetween];
        Counterbalance counterbalance "A balancing spring or cylinder on a lever." [Counterbalance Counterweight];
        JointCoupling joint_coupling "A motor that turns with two joints." [Coupling];
        TransportDelay transport_delay "Torque acts a fixed time after it was commanded." [Delay];
        CurrentLoopLag current_loop_lag "Torque follows its command as a first-order lag." [Lag];
        TorqueSaturation torque_saturation "Torque beyond a limit is not delivered." [Saturation];
        EncoderOffset encoder_offset "The joint's zero is elsewhere." [EncoderOffset];
        EncoderEccentricity encoder_eccentricity "The encoder's reading varies once a turn." [Eccentricity PositionScale];
        ExternalForce external_force "Contact with something." [Force];
    }
    others {
        angle_law [Pull AngleLaw Softening];
    }
}

impl Effect {
    /// The name in reports.
    pub fn name(self) -> &'static str {
        self.about().name
    }

    /// Whether it is a wrong value of something the model has, or something the model lacks.
    pub fn kind(self) -> Kind {
        self.about().kind
    }

    /// The quantity in which it shows.
    pub(crate) fn variable(self, has_temperature: bool) -> Variable {
        self.about().variable[usize::from(has_temperature)]
    }

    /// The effect that a value of the model belongs to, and its joint; none of offsets. Friction with load and nonlinear friction are
    /// effects in general, but values of a model that has them.
    pub(crate) fn of_value(parameter: Parameter, driven: usize) -> Option<(Effect, usize)> {
        Some(match parameter {
            Parameter::Link { link, .. } => (Effect::LinkInertia, link),
            Parameter::RotorInertia(j) => (Effect::RotorInertia, j),
            Parameter::Viscous(j) => (Effect::ViscousFriction, j),
            Parameter::Coulomb(j) => (Effect::CoulombFriction, j),
            Parameter::LoadFriction(j) => (Effect::LoadDependentFriction, j),
            Parameter::ViscousQuadratic(j) => (Effect::ViscousNonlinearity, j),
            // Of the motor that turns with two joints: the one that it belongs to.
            Parameter::CouplingInertia => (Effect::RotorInertia, driven),
            Parameter::CouplingViscous => (Effect::ViscousFriction, driven),
            Parameter::CouplingCoulomb => (Effect::CoulombFriction, driven),
            Parameter::Offset(_) => return None,
        })
    }

    /// The form that has the same torque as its value on a joint, as far as one has.
    pub(crate) fn value_form(self, joint: usize) -> Option<Form> {
        match self {
            Effect::LinkInertia => Some(link_inertia::LinkScale { link: joint }.into()),
            Effect::RotorInertia => Some(rotor_inertia::RotorInertia { joint }.into()),
            Effect::CoulombFriction => Some(coulomb_friction::Coulomb { joint }.into()),
            Effect::ViscousFriction => Some(viscous_friction::Viscous { joint }.into()),
            Effect::LoadDependentFriction => Some(load_dependent_friction::Load { joint }.into()),
            Effect::ViscousNonlinearity => Some(viscous_nonlinearity::ViscousNonlinearity { joint }.into()),
            _ => None,
        }
    }
}

impl fmt::Display for Effect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Hands questions on to the form's own answers.
macro_rules! hand_on {
    ($($question:ident($($argument:ident: $type:ty),*) -> $answer:ty;)*) => {
        impl Form {
            $(
                #[doc = concat!("See [`EffectForm::", stringify!($question), "`].")]
                pub(crate) fn $question(&self, $($argument: $type),*) -> $answer {
                    ask!(self, form => form.$question($($argument),*))
                }
            )*
        }
    };
}

hand_on! {
    effect() -> Effect;
    joints() -> Vec<usize>;
    coefficients() -> usize;
    inner_values() -> usize;
    columns(p: &Physics<'_>) -> Vec<Full>;
    carried(c: &[f64], x: &[f64], joints: usize, reference_c: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>);
    magnitude(c: &[f64], joints: usize, reference: &[f64]) -> Vec<(String, f64)>;
    size_reference() -> SizeReference;
    plausible(c: &[f64]) -> bool;
    place(joints: usize) -> Option<usize>;
    impossible(c: &[f64], nominal: &Nominal, standard: &[f64]) -> Option<Impossible>;
    shares(parameter: Parameter, joints: usize) -> bool;
    changes_values() -> bool;
    steps() -> Vec<(usize, f64)>;
    order() -> Option<f64>;
    has_fixed_gain() -> bool;
    is_simulated() -> bool;
    is_smooth() -> bool;
    least_coefficient() -> Option<f64>;
    prior_std() -> Option<f64>;
    has_unfelt_columns() -> bool;
    is_observed(runs: &[Physics<'_>]) -> bool;
    has_stretches() -> bool;
    of_angle_alone() -> bool;
    bends_slowly(range: &dyn Fn(usize) -> f64) -> bool;
    shifts_time() -> bool;
    is_slow() -> bool;
    is_like_smoothing() -> bool;
    is_nameless() -> bool;
    is_half_constant() -> bool;
    is_torque_zero() -> bool;
    is_gain() -> bool;
    wave_is_below(c: &[f64], share: f64) -> bool;
    least_replacement_gain() -> f64;
    kind() -> usize;
    is_predictable() -> bool;
    hides() -> bool;
    convert(effects: &mut [KnownEffect], joints: usize, fitted: &[f64], written: &[f64]) -> ();
}

impl Form {
    /// The form's own type, where it is one of these.
    pub(crate) fn get<T: OfForm>(&self) -> Option<&T> {
        T::of(self)
    }

    /// See [`EffectForm::made_with`].
    pub(crate) fn made_with<'a>(&self, physics: &'a Physics<'_>) -> &'a [f64] {
        ask!(self, form => form.made_with(physics))
    }

    /// See [`EffectForm::scaled`].
    pub(crate) fn scaled(&self, factors: [f64; 3]) -> Form {
        ask!(self, form => form.scaled(factors).into())
    }

    /// See [`EffectForm::settled`].
    pub(crate) fn settled(&self, c: f64) -> Option<Form> {
        ask!(self, form => form.settled(c).map(Form::from))
    }
}
