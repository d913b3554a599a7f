//! What a robot controller publishes in one control period.

use rivet_ipc_schema::{JointState, MAX_JOINTS, Setpoint};

/// Bits of [`Sample::flags`].
pub mod sample_flags {
    /// `q_des`, `qd_des` and `qdd_des` are valid.
    pub const SETPOINT: u32 = 1 << 0;
    /// `temperature` is valid.
    pub const TEMPERATURE: u32 = 1 << 1;
}

/// One control period of the robot: what was measured, and what was planned.
///
/// Joints run from base to flange. All quantities are on the output side of the gear, about the joint's URDF axis.
/// Entries beyond the joint count are ignored. A sample of zeros is valid.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct Sample {
    /// When the encoders were latched, CLOCK_MONOTONIC [ns]; 0: at the call.
    pub stamp_ns: u64,
    /// Measured joint positions [rad, or m for a prismatic joint].
    pub q: [f64; MAX_JOINTS],
    /// Measured torque of each drive on its joint [N m, or N].
    pub tau: [f64; MAX_JOINTS],
    /// Planned joint positions of this period [rad, or m].
    pub q_des: [f64; MAX_JOINTS],
    /// Planned joint velocities [rad/s, or m/s].
    pub qd_des: [f64; MAX_JOINTS],
    /// Planned joint accelerations [rad/s^2, or m/s^2].
    pub qdd_des: [f64; MAX_JOINTS],
    /// Temperature of each drive [degC]; NaN where none is measured.
    pub temperature: [f64; MAX_JOINTS],
    /// RIVET_SAMPLE_SETPOINT, RIVET_SAMPLE_TEMPERATURE: which optional fields are valid.
    pub flags: u32,
    /// RIVET_FAULT_... bits of rivet.h; 0: every field may be used.
    pub faults: u32,
}

impl Sample {
    /// The first `joints` entries; the rest is `rest`.
    fn used(values: &[f64; MAX_JOINTS], joints: u32, rest: f64) -> [f64; MAX_JOINTS] {
        std::array::from_fn(|j| if j < joints as usize { values[j] } else { rest })
    }

    pub(crate) fn joint_state(&self, seq: u64, stamp_ns: u64, joints: u32) -> JointState {
        let measured = if self.flags & sample_flags::TEMPERATURE == 0 { 0 } else { joints };
        JointState {
            seq,
            stamp_ns,
            q: Self::used(&self.q, joints, 0.0),
            tau: Self::used(&self.tau, joints, 0.0),
            temperature: Self::used(&self.temperature, measured, f64::NAN),
            joints,
            faults: self.faults,
        }
    }

    pub(crate) fn setpoint(&self, seq: u64, stamp_ns: u64, joints: u32) -> Option<Setpoint> {
        (self.flags & sample_flags::SETPOINT != 0).then(|| Setpoint {
            seq,
            stamp_ns,
            q: Self::used(&self.q_des, joints, 0.0),
            qd: Self::used(&self.qd_des, joints, 0.0),
            qdd: Self::used(&self.qdd_des, joints, 0.0),
            joints,
            flags: 0,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fills_messages_from_the_fields_that_are_valid() {
        let ones = [1.0; MAX_JOINTS];
        let mut sample = Sample { q: ones, tau: ones, q_des: ones, temperature: ones, ..Sample::default() };
        let state = sample.joint_state(7, 9, 2);
        assert_eq!((state.seq, state.stamp_ns, state.joints), (7, 9, 2));
        assert_eq!(state.q, [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert!(state.temperature.iter().all(|value| value.is_nan()), "none is measured");
        assert_eq!(sample.setpoint(7, 9, 2), None);
        sample.flags = sample_flags::SETPOINT | sample_flags::TEMPERATURE;
        assert_eq!(sample.joint_state(7, 9, 2).temperature[..2], [1.0, 1.0]);
        let setpoint = sample.setpoint(7, 9, 2).expect("valid");
        assert_eq!((setpoint.seq, setpoint.q[1], setpoint.q[2]), (7, 1.0, 0.0));
    }
}
