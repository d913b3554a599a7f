//! What the user reads about a stop.

use rivet_ipc_schema::StopCause;

/// Cause and joints of a stop or of a refused plan; `joints` has bit 0 for the base's.
pub fn stop_text(cause: u32, joints: u32) -> String {
    let Ok(cause) = StopCause::try_from(cause) else { return format!("cause {cause}") };
    let what = match cause {
        StopCause::None => "nothing",
        StopCause::Silence => "no joint state for [controller] stale_periods",
        StopCause::OldSamples => "joint states whose sequence numbers do not go forward",
        StopCause::RobotFault => "the robot controller set fault bits",
        StopCause::WrongShape => "joint states of another number of joints",
        StopCause::NotFinite => "a position or torque is not finite",
        StopCause::Implausible => "a position or torque is beyond all that an arm can have",
        StopCause::WrongPeriod => "joint states at another rate than sample_period_s",
        StopCause::Frozen => "the position repeats although the joint moves or its plan has left it",
        StopCause::EncoderJump => "the position changed faster than a drive moves the joint",
        StopCause::TooFast => "beyond the joint's speed limit",
        StopCause::NoResponse => {
            "the joint does not move as the commanded torque moves it, by more than [controller] unmodelled_torque"
        }
        StopCause::SignFlipped => "measured torque opposite to the commanded one",
        StopCause::TorqueStuck => "measured torque does not follow the commanded one",
        StopCause::Saturated => {
            "commanded torque at its limit, or at that of its rate, for longer than [controller] saturation_ms"
        }
        StopCause::TrackingError => "further from the plan than [controller] tracking_error",
        StopCause::PlanNotFinite => "the plan has a number that is not finite, or another number of joints",
        StopCause::PlanImplausible => "the plan has a number beyond all that an arm can do",
        StopCause::PlanJump => "the plan jumps further than the joint can follow",
        StopCause::PlanAcceleration => "the plan needs more torque, or a faster change of torque, than the drives have",
    };
    let named: Vec<String> = (0..u32::BITS).filter(|j| joints >> j & 1 == 1).map(|j| (j + 1).to_string()).collect();
    match named.len() {
        0 => what.to_owned(),
        1 => format!("{what} (joint {})", named[0]),
        _ => format!("{what} (joints {})", named.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cause_and_joints() {
        let fast = u32::from(StopCause::TooFast);
        assert_eq!(stop_text(fast, 0), "beyond the joint's speed limit");
        assert_eq!(stop_text(fast, 0b10), "beyond the joint's speed limit (joint 2)");
        assert_eq!(stop_text(fast, 0b101), "beyond the joint's speed limit (joints 1, 3)");
        assert_eq!(stop_text(77, 0), "cause 77");
    }
}
