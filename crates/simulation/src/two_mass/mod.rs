//! An arm of motors and links with everything that can be wrong with one: what blind cases are drawn from.
//!
//! A joint may be a rigid gear, or two masses with a spring, play and a gear error between them; friction acts on the
//! motor's side and follows laws of its own (a Gaussian Stribeck curve, bristles, warming motors), not the curves a
//! diagnosis fits. Units are SI at the joint side of the gear; speeds and angles of friction are the motor's.

mod plant;
mod run;

pub use plant::TwoMassArm;
pub use run::{Recording, Tracking, record};

use rivet_dynamics::Arm;

/// Speed within which friction without bristles turns over \[rad/s\].
const TURNS: f64 = 0.008;
/// Temperature at which friction has its nominal level, and of the room \[°C\].
const ROOM: f64 = 25.0;

/// Bristles, a Stribeck curve and so on: how dry friction of one joint behaves. Zero is absent.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DryFriction {
    /// Level while sliding \[N·m\].
    pub coulomb: f64,
    /// Added to the level in positive motion \[N·m\].
    pub forwards: f64,
    /// Added at rest, falling as `exp(-(v/velocity)²)`: torque \[N·m\] and velocity \[rad/s\].
    pub stribeck: [f64; 2],
    /// Level per torque that the gear carries \[-\].
    pub load: f64,
    /// `amplitude·sin(q + phase)` added to the level \[N·m, rad\].
    pub position: [f64; 2],
    /// Deflection at which bristles slide \[rad\].
    pub bristle: f64,
}

/// A spring between motor and link.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gear {
    /// \[N·m/rad\].
    pub stiffness: f64,
    /// \[N·m·s/rad\].
    pub damping: f64,
    /// Angle in which nothing is carried \[rad\].
    pub play: f64,
    /// `amplitude·sin(order·θ + phase)` by which the link is ahead of the motor \[rad, cycles per turn, rad\].
    pub error: [f64; 3],
}

/// Structure that no library of effects has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outside {
    /// A magnet beside the way: pulls towards `centre` within about `width` \[rad\], at most by `torque` \[N·m\].
    Magnet {
        /// \[rad\].
        centre: f64,
        /// \[rad\].
        width: f64,
        /// \[N·m\].
        torque: f64,
    },
    /// A cable that is slack before `from` \[rad\] and pulls with the square of the way beyond \[N·m/rad²\].
    Cable {
        /// \[rad\].
        from: f64,
        /// \[N·m/rad²\].
        stiffness: f64,
    },
    /// Friction whose level follows the angle of another joint \[N·m\].
    Entangled {
        /// The other joint.
        with: usize,
        /// \[N·m\].
        torque: f64,
    },
}

/// One joint with its drive and encoder. Zero is absent unless said otherwise.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// \[kg·m²\].
    pub rotor_inertia: f64,
    /// \[N·m·s/rad\].
    pub viscous: f64,
    /// Friction with the cube of speed \[N·m·s³/rad³\].
    pub cubic: f64,
    /// \[N·m\].
    pub offset: f64,
    /// Dry friction.
    pub dry: DryFriction,
    /// Change of all friction per kelvin \[1/K\], and kelvins of warming per watt of friction \[K/W\].
    pub warming: [f64; 2],
    /// None: rigid.
    pub gear: Option<Gear>,
    /// Spring on the link \[N·m/rad\] and where it is slack \[rad\].
    pub spring: [f64; 2],
    /// `amplitude·sin(q + phase)` on the link \[N·m, rad\].
    pub counterbalance: [f64; 2],
    /// `amplitude·sin(order·θ + phase)` from the motor \[N·m, cycles per turn, rad\].
    pub ripple: [f64; 3],
    /// Torque given per torque reported, less one.
    pub gain: f64,
    /// Most torque that is given \[N·m\]; infinite for a drive as strong as it says.
    pub saturation: f64,
    /// What the encoder adds to the angle \[rad\].
    pub encoder_offset: f64,
    /// `amplitude·sin(θ + phase)` that the encoder adds \[rad\].
    pub eccentricity: [f64; 2],
    /// What no library has.
    pub outside: Option<Outside>,
}

impl Default for Joint {
    fn default() -> Joint {
        Joint {
            rotor_inertia: 0.0,
            viscous: 0.0,
            cubic: 0.0,
            offset: 0.0,
            dry: DryFriction::default(),
            warming: [0.0; 2],
            gear: None,
            spring: [0.0; 2],
            counterbalance: [0.0; 2],
            ripple: [0.0; 3],
            gain: 0.0,
            saturation: f64::INFINITY,
            encoder_offset: 0.0,
            eccentricity: [0.0; 2],
            outside: None,
        }
    }
}

/// A motor that turns with the sum of two joints. Both have rigid gears.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoupledMotor {
    /// The joints.
    pub joints: [usize; 2],
    /// Shared inertia \[kg·m²\].
    pub inertia: f64,
    /// Friction of the sum of speeds, beside what each joint has of its own: viscous \[N·m·s/rad\].
    pub viscous: f64,
    /// Coulomb \[N·m\].
    pub coulomb: f64,
}

/// Somebody leans on the flange.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Push {
    /// When it begins \[s\].
    pub from_s: f64,
    /// How long it lasts \[s\].
    pub length_s: f64,
    /// Force in the base's frame \[N\].
    pub force: [f64; 3],
}

/// The whole arm.
#[derive(Clone, Debug)]
pub struct Physics {
    /// Kinematics, bodies and gravity as they are.
    pub arm: Arm,
    /// One a joint.
    pub joints: Vec<Joint>,
    /// Motors that turn with two joints.
    pub coupled: Vec<CoupledMotor>,
    /// From the controller's torque to the current loop \[s\].
    pub delay_s: f64,
    /// Time constant of the current loop \[s\].
    pub lag_s: f64,
    /// Forces at the flange.
    pub pushes: Vec<Push>,
}
