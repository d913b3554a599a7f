//! Quantities in which effects show: the axes of the curves of a cause.

/// The quantity in which an effect shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variable {
    /// Speed of the joint.
    Speed,
    /// Sum of the speeds of two coupled joints.
    SumOfSpeeds,
    /// Way since the joint's last reversal; residuals count along the motion.
    TravelSinceReversal,
    /// Size of the torque that links and payload put on the gear; residuals count along the motion.
    Load,
    /// The same torque with its sign.
    SignedLoad,
    /// Torque that the whole model gives.
    ModelTorque,
    /// Its rate.
    TorqueRate,
    /// Measured torque.
    MeasuredTorque,
    /// Position of the joint.
    Angle,
    /// Place within one cycle of an order of the joint's angle.
    Phase,
    /// Acceleration of the joint.
    Acceleration,
    /// Torque of the effect itself, for one that rings: no quantity of the joint at the same instant shows it.
    OwnTorque,
    /// Temperature of the motor; residuals count along the motion.
    Temperature,
    /// Time since the run began.
    Time,
    /// The same; residuals count along the motion.
    WarmingTime,
}

impl Variable {
    /// Name and unit, for an axis.
    pub fn label(self) -> (&'static str, &'static str) {
        match self {
            Variable::Speed => ("joint speed", "rad/s"),
            Variable::SumOfSpeeds => ("sum of the two joints' speeds", "rad/s"),
            Variable::TravelSinceReversal => ("way since the last reversal", "rad"),
            Variable::Load => ("load on the gear, without sign", "N m"),
            Variable::SignedLoad => ("load on the gear", "N m"),
            Variable::ModelTorque => ("torque of the model", "N m"),
            Variable::TorqueRate => ("rate of the model's torque", "N m/s"),
            Variable::MeasuredTorque => ("measured torque", "N m"),
            Variable::Angle => ("joint angle", "rad"),
            Variable::Phase => ("place in one cycle", "rad"),
            Variable::Acceleration => ("joint acceleration", "rad/s^2"),
            Variable::OwnTorque => ("torque of the effect", "N m"),
            Variable::Temperature => ("motor temperature", "degC"),
            Variable::Time | Variable::WarmingTime => ("time", "s"),
        }
    }

    /// Whether residuals are counted along the motion: positive where they brake.
    pub fn along_motion(self) -> bool {
        use Variable::{Load, Temperature, TravelSinceReversal, WarmingTime};
        matches!(self, TravelSinceReversal | Load | Temperature | WarmingTime)
    }
}
