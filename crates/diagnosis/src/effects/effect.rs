//! The list of effects that can be named, with their names in reports and their kinds.

use std::fmt;

macro_rules! effects {
    ($($variant:ident $name:literal $kind:ident $doc:literal,)*) => {
        /// What makes an arm differ from its simulator. The names are a contract.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum Effect { $(#[doc = $doc] $variant,)* }

        impl Effect {
            /// All of them.
            pub const ALL: &'static [Effect] = &[$(Effect::$variant,)*];

            /// The name in reports.
            pub fn name(self) -> &'static str {
                match self { $(Effect::$variant => $name,)* }
            }

            /// Whether it is a wrong value of something the model has, or something the model lacks.
            pub fn kind(self) -> Kind {
                match self { $(Effect::$variant => Kind::$kind,)* }
            }
        }
    };
}

/// A wrong value, or a missing effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A wrong value of something the model has: verdict `parameter`.
    Value,
    /// Something the model lacks: verdict `effect`.
    Structure,
}

effects! {
    LinkInertia "link_inertia" Value "Mass, centre of mass or inertia of a link.",
    Payload "payload" Value "A body at the flange.",
    GravityDirection "gravity_direction" Value "The base is not level.",
    RotorInertia "rotor_inertia" Value "Drive inertia at the joint.",
    CoulombFriction "coulomb_friction" Value "Friction that only knows the direction.",
    ViscousFriction "viscous_friction" Value "Friction proportional to speed.",
    FrictionAsymmetry "friction_asymmetry" Structure "Friction differs between the two directions.",
    StribeckFriction "stribeck_friction" Structure "Friction falls with speed at low speed.",
    ViscousNonlinearity "viscous_nonlinearity" Structure "Friction grows not in proportion to speed.",
    LoadDependentFriction "load_dependent_friction" Structure "Friction grows with the torque that the gear carries.",
    TemperatureDependentFriction "temperature_dependent_friction" Structure "Friction changes as the joint warms up.",
    PreslidingFriction "presliding_friction" Structure "Friction acts like a spring before it slides.",
    PositionDependentFriction "position_dependent_friction" Structure "Friction varies with the joint's angle.",
    TorqueConstant "torque_constant" Value "Torque per current, or per count, of one drive.",
    TorqueRipple "torque_ripple" Structure "Torque that varies with the angle of motor or gear.",
    TransmissionError "transmission_error" Structure "The gear's output angle varies about its input's.",
    Backlash "backlash" Structure "Play between motor and link.",
    JointElasticity "joint_elasticity" Structure "The gear is a spring between motor and link.",
    BaseFlexibility "base_flexibility" Structure "What the arm stands on gives way.",
    JointSpring "joint_spring" Structure "A torque proportional to the joint's angle, as of a hose.",
    Counterbalance "counterbalance" Structure "A balancing spring or cylinder on a lever.",
    JointCoupling "joint_coupling" Structure "A motor that turns with two joints.",
    TransportDelay "transport_delay" Structure "Torque acts a fixed time after it was commanded.",
    CurrentLoopLag "current_loop_lag" Structure "Torque follows its command as a first-order lag.",
    TorqueSaturation "torque_saturation" Structure "Torque beyond a limit is not delivered.",
    EncoderOffset "encoder_offset" Value "The joint's zero is elsewhere.",
    EncoderEccentricity "encoder_eccentricity" Structure "The encoder's reading varies once a turn.",
    ExternalForce "external_force" Structure "Contact with something.",
}

impl fmt::Display for Effect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
