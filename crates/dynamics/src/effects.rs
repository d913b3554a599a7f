//! Effects of known size beside rigid links and plain drives: what `[effects.<name>]` of a robot file holds.
//!
//! Those that follow from position, speed and acceleration of one instant are evaluated here, without allocating, for
//! estimator, controller and prediction. The others keep a memory or act on time; whoever meets one says so.

use crate::Joints;

macro_rules! kinds {
    ($($variant:ident $name:literal $sizes:literal [$($key:ident)*] $doc:literal,)*) => {
        /// What an effect is. Names are those of diagnoses.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum EffectKind { $(#[doc = $doc] $variant,)* }

        impl EffectKind {
            /// All of them, in the order in which files list them.
            pub const ALL: &'static [EffectKind] = &[$(EffectKind::$variant,)*];

            /// The name in files and reports.
            pub fn name(self) -> &'static str {
                match self { $(EffectKind::$variant => $name,)* }
            }

            /// Names of its values, in the order of [`KnownEffect::values`].
            pub fn keys(self) -> &'static [&'static str] {
                match self { $(EffectKind::$variant => &[$(stringify!($key)),*],)* }
            }

            /// How many values, from the first, are sizes: with all of them zero there is no effect.
            pub fn sizes(self) -> usize {
                match self { $(EffectKind::$variant => $sizes,)* }
            }
        }
    };
}

// Symbols: s is the direction of friction, q, v and a the joint's position, speed and acceleration.
kinds! {
    FrictionAsymmetry "friction_asymmetry" 2 [coulomb viscous] "`coulomb·|s| + viscous·|v|`",
    StribeckFriction "stribeck_friction" 1 [excess velocity] "`excess·s·exp(−(v/velocity)²)`",
    ViscousNonlinearity "viscous_nonlinearity" 2 [quadratic cubic] "`quadratic·v·|v| + cubic·v³`",
    LoadDependentFriction "load_dependent_friction" 1 [ratio] "`ratio·s·|torque of the links|`",
    TemperatureDependentFriction "temperature_dependent_friction" 2 [viscous coulomb reference time_constant]
        "`(viscous·v + coulomb·s)·(T − reference)`, T measured, or friction power through a lag where there is a time constant",
    PreslidingFriction "presliding_friction" 1 [level length] "`level·(z − s)`, z a Dahl spring of this length",
    PositionDependentFriction "position_dependent_friction" 2 [cosine sine order]
        "`s·(cosine·cos(order·q) + sine·sin(order·q))`",
    TorqueConstant "torque_constant" 1 [excess] "measured torque is `1 + excess` times that of the drive",
    TorqueRipple "torque_ripple" 2 [cosine sine order] "`cosine·cos(order·q) + sine·sin(order·q)`",
    TransmissionError "transmission_error" 2 [cosine sine order]
        "the link is at `q + cosine·cos(order·q) + sine·sin(order·q)`",
    Backlash "backlash" 1 [gap stiffness damping share] "play and a spring between motor and link",
    JointElasticity "joint_elasticity" 1 [stiffness damping share] "a spring between motor and link",
    JointSpring "joint_spring" 1 [stiffness] "`stiffness·q`",
    Counterbalance "counterbalance" 2 [lever free_length arm phase]
        "`lever·arm·sin(q + phase) + free_length·arm·sin(q + phase)/√(1 + arm² − 2·arm·cos(q + phase))`",
    JointCoupling "joint_coupling" 3 [coulomb viscous rotor_inertia]
        "a motor that turns with the joint and the one before it, v their speeds' sum: `coulomb·s(v) + viscous·v` on both, \
         `rotor_inertia` times the other's acceleration on each",
    TransportDelay "transport_delay" 1 [delay] "torque acts so much later than it is reported",
    CurrentLoopLag "current_loop_lag" 1 [time_constant] "torque follows the reported one as a first-order lag",
    TorqueSaturation "torque_saturation" 1 [limit] "reported torque beyond the limit is not delivered",
    EncoderOffset "encoder_offset" 1 [offset] "the link is at `q + offset`",
    EncoderEccentricity "encoder_eccentricity" 2 [cosine sine] "motor and link are at `q + cosine·cos q + sine·sin q`",
    BaseFlexibility "base_flexibility" 1 [compliance inertia damping heading] "the base turns on a spring about a horizontal axis",
}

impl EffectKind {
    /// Whether it belongs to no joint.
    pub fn is_global(self) -> bool {
        matches!(self, EffectKind::TransportDelay | EffectKind::CurrentLoopLag | EffectKind::BaseFlexibility)
    }

    /// Whether its torque at an instant is friction: it opposes the joint's motion and turns round with it.
    pub(crate) fn is_friction(self) -> bool {
        matches!(
            self,
            EffectKind::FrictionAsymmetry
                | EffectKind::StribeckFriction
                | EffectKind::ViscousNonlinearity
                | EffectKind::LoadDependentFriction
                | EffectKind::PositionDependentFriction
        )
    }

    /// Why its torque does not follow from position, speed and acceleration of one instant; none if it does.
    pub fn not_instant(self) -> Option<&'static str> {
        match self {
            EffectKind::TemperatureDependentFriction => Some("it needs to know how warm the joint is"),
            EffectKind::PreslidingFriction => Some("it remembers where the motion turned"),
            EffectKind::Backlash | EffectKind::JointElasticity => {
                Some("the link behind the gear has a state of its own")
            }
            EffectKind::TransportDelay | EffectKind::CurrentLoopLag => Some("it shifts torque in time"),
            EffectKind::BaseFlexibility => Some("the base has a state of its own"),
            EffectKind::TorqueSaturation => Some("it depends on the command"),
            _ => None,
        }
    }
}

/// Most values of an effect.
const MOST_VALUES: usize = 4;

/// One effect on one joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownEffect {
    /// What it is.
    pub kind: EffectKind,
    /// Where, from 0; 0 where it belongs to no joint.
    pub joint: usize,
    /// Its values in the order of [`EffectKind::keys`]; further ones are 0.
    pub values: [f64; MOST_VALUES],
}

impl KnownEffect {
    /// An effect with its first values.
    pub fn new(kind: EffectKind, joint: usize, first: &[f64]) -> KnownEffect {
        let mut values = [0.0; MOST_VALUES];
        for (value, given) in values.iter_mut().zip(first) {
            *value = *given;
        }
        KnownEffect { kind, joint, values }
    }

    /// Angle from what the encoder says to the link where it says `q` \[rad\]; none for effects that do not displace.
    pub fn angle_error(&self, q: f64) -> Option<f64> {
        let displaces = matches!(
            self.kind,
            EffectKind::EncoderOffset | EffectKind::EncoderEccentricity | EffectKind::TransmissionError
        );
        displaces.then(|| displacement(self, q, 0.0, 0.0)[0])
    }

    /// By how much the gear's ratio is off where the encoder says `q`: the link turns by `1 + error` per turn of the encoder,
    /// and by virtual work the drive carries `1 + error` of the link's torque. 0 for effects that are not the gear's.
    pub fn ratio_error(&self, q: f64) -> f64 {
        let [a, b, order, _] = self.values;
        if self.kind != EffectKind::TransmissionError {
            return 0.0;
        }
        let (sin, cos) = (order * q).sin_cos();
        order * (b * cos - a * sin)
    }

    /// Whether it does anything.
    pub fn acts(&self) -> bool {
        self.values[..self.kind.sizes()].iter().any(|v| *v != 0.0)
    }
}

/// The effects of an arm, with what of the drives they need.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct KnownEffects {
    pub(crate) list: Vec<KnownEffect>,
    pub(crate) rotor_inertia: Vec<f64>,
    pub(crate) viscous: Vec<f64>,
    /// Whether a link is elsewhere than the encoder says, and whether friction needs the links' torque.
    pub(crate) displaces: bool,
    pub(crate) loads: bool,
}

impl KnownEffects {
    /// `drives` are the arm's nominal ones: an encoder that is off misreads them too.
    pub fn new(list: Vec<KnownEffect>, drives: &Joints) -> KnownEffects {
        use EffectKind::{EncoderEccentricity, EncoderOffset, LoadDependentFriction, TransmissionError};
        let has = |kinds: &[EffectKind]| list.iter().any(|e| kinds.contains(&e.kind));
        KnownEffects {
            displaces: has(&[EncoderEccentricity, EncoderOffset, TransmissionError]),
            loads: has(&[LoadDependentFriction]),
            rotor_inertia: drives.rotor_inertia.clone(),
            viscous: drives.viscous.clone(),
            list,
        }
    }

    /// One by one.
    pub fn list(&self) -> &[KnownEffect] {
        &self.list
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }
}

/// Angle error of a displacing effect and its first two derivatives in time.
pub(crate) fn displacement(effect: &KnownEffect, q: f64, qd: f64, qdd: f64) -> [f64; 3] {
    let [a, b, order, _] = effect.values;
    let order = match effect.kind {
        EffectKind::EncoderOffset => return [a, 0.0, 0.0],
        EffectKind::EncoderEccentricity => 1.0,
        EffectKind::TransmissionError => order,
        _ => return [0.0; 3],
    };
    let (sin, cos) = (order * q).sin_cos();
    let (value, slope) = (a * cos + b * sin, order * (b * cos - a * sin));
    [value, slope * qd, slope * qdd - order * order * value * qd * qd]
}

/// Torque of an effect that needs nothing but the joint's own motion and its direction of friction `s`; `carried` is the
/// torque of the links \[N·m\].
pub fn own_torque(effect: &KnownEffect, s: f64, carried: f64, q: f64, v: f64) -> f64 {
    let [a, b, c, d] = effect.values;
    match effect.kind {
        EffectKind::FrictionAsymmetry => a * s.abs() + b * v.abs(),
        EffectKind::StribeckFriction => a * s * (-(v / b).powi(2)).exp(),
        EffectKind::ViscousNonlinearity => (a * v.abs() + b * v * v) * v,
        EffectKind::LoadDependentFriction => a * s * carried.abs(),
        EffectKind::PositionDependentFriction => s * (a * (c * q).cos() + b * (c * q).sin()),
        EffectKind::TorqueRipple => a * (c * q).cos() + b * (c * q).sin(),
        EffectKind::JointSpring => a * q,
        EffectKind::Counterbalance => {
            let (sin, cos) = (q + d).sin_cos();
            c * sin * (a + b / (1.0 + c * c - 2.0 * c * cos).max(1e-9).sqrt())
        }
        _ => 0.0,
    }
}
