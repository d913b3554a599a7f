//! The drives of an arm as one: enabled together, stopped together, in joint quantities.

use crate::bus::Bus;
use crate::drive::{ENABLE_OPERATION, Inputs, Outputs, Received, SHUTDOWN, Sent, State, fault_bits};
use crate::scaling::{Encoder, Table};
use rivet::Sample;

/// Cycles that drives may take to be enabled.
const MAX_ENABLING_CYCLES: u32 = 5000;

/// Joints of a sample.
const MAX_JOINTS: usize = 8;

/// All drives of an arm, by a scaling table.
pub(crate) struct Arm<B> {
    pub(crate) bus: B,
    table: Table,
    inputs: Vec<Inputs>,
    outputs: Vec<Outputs>,
    encoders: Vec<Encoder>,
}

impl<B: Bus> Arm<B> {
    /// Enables all drives without torque and at the position that they have; `wait` waits for the next cycle.
    ///
    /// # Errors
    /// The first drive that is not enabled in time, with its status word.
    pub(crate) fn enable(mut bus: B, table: Table, mut wait: impl FnMut()) -> Result<Arm<B>, String> {
        let mut inputs = vec![Inputs::default(); table.joints.len()];
        let mut outputs = vec![Outputs { mode: table.mode, ..Outputs::default() }; table.joints.len()];
        for _ in 0..MAX_ENABLING_CYCLES {
            wait();
            if !exchange(&mut bus, &outputs, &mut inputs) {
                continue;
            }
            for (output, input) in outputs.iter_mut().zip(&inputs) {
                output.control = State::of_status(input.status).enabling_word(output.control);
                output.position = input.position;
            }
            if inputs.iter().all(|input| fault_bits(input, table.mode) == 0) {
                let encoders =
                    table.joints.iter().zip(&inputs).map(|(joint, input)| Encoder::new(joint, input)).collect();
                return Ok(Arm { bus, table, inputs, outputs, encoders });
            }
        }
        let off = inputs.iter().position(|input| fault_bits(input, table.mode) != 0).unwrap_or_default();
        let (status, slave) = (inputs[off].status, table.joints[off].slave);
        let state = State::of_status(status);
        Err(format!("joint {}, slave {slave}: {state:?}, status word {status:#06x}; read 0x603F of the drive", off + 1))
    }

    /// One cycle: sends what was commanded last, returns what the drives have measured; `None` if the frame was lost.
    pub(crate) fn exchange(&mut self) -> Option<Sample> {
        if !exchange(&mut self.bus, &self.outputs, &mut self.inputs) {
            return None;
        }
        let mut sample = Sample::default();
        for (j, (joint, input)) in self.table.joints.iter().zip(&self.inputs).enumerate() {
            sample.q[j] = self.encoders[j].position(joint, input);
            sample.tau[j] = joint.torque(input.torque);
            sample.faults |= fault_bits(input, self.table.mode);
        }
        Some(sample)
    }

    /// Velocity of a joint as its drive reports it \[rad/s\].
    pub(crate) fn velocity(&self, joint: usize) -> f64 {
        self.table.joints[joint].velocity(self.inputs[joint].velocity)
    }

    /// Sets what the next cycle sends: position \[rad\] for drives in position mode, torque \[N m\] for those in torque mode.
    /// Once a drive is not enabled, all are switched off and stay so.
    pub(crate) fn command(&mut self, positions: &[f64], torques: &[f64]) {
        let moves = self.inputs.iter().all(|input| State::of_status(input.status) == State::OperationEnabled);
        for (j, (joint, output)) in self.table.joints.iter().zip(&mut self.outputs).enumerate() {
            output.control = if moves { ENABLE_OPERATION } else { SHUTDOWN };
            output.position = if moves { joint.target_position(positions[j]) } else { self.inputs[j].position };
            output.torque = if moves { joint.target_torque(torques[j]) } else { 0 };
        }
    }
}

/// Exchanges the process data of all drives; `false` if the frame was lost.
fn exchange(bus: &mut impl Bus, outputs: &[Outputs], inputs: &mut [Inputs]) -> bool {
    let (mut sent, mut received) = ([Sent::default(); MAX_JOINTS], [Received::default(); MAX_JOINTS]);
    for (bytes, output) in sent.iter_mut().zip(outputs) {
        *bytes = output.to_bytes();
    }
    let arrived = bus.exchange(&sent[..outputs.len()], &mut received[..inputs.len()]);
    for (bytes, input) in received.iter().zip(inputs).filter(|_| arrived) {
        *input = Inputs::from_bytes(bytes);
    }
    arrived
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::SimulatedBus;
    use crate::scaling::read;
    use std::path::Path;

    fn table() -> Table {
        read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/ethercat/arm.toml")).expect("a table")
    }

    fn arm() -> Arm<SimulatedBus> {
        Arm::enable(SimulatedBus::new(&[0]).expect("a bus"), table(), || ()).expect("enabled")
    }

    #[test]
    fn resets_a_fault_and_enables_at_rest() {
        let mut arm = arm();
        let sample = arm.exchange().expect("a frame");
        assert_eq!((sample.faults, sample.tau[0]), (0, 0.0));
        assert!(sample.q[0].abs() < 1e-7, "{}", sample.q[0]);
    }

    /// 20 N m lift the arm from the lowest point to beyond 1 rad; the counter wraps on the way.
    #[test]
    fn torque_moves_the_arm_across_the_wrap_of_its_counter() {
        let mut arm = arm();
        let (mut last, mut wraps) = (arm.inputs[0].position, 0);
        for _ in 0..2000 {
            let sample = arm.exchange().expect("a frame");
            wraps += u32::from((last > 0) != (arm.inputs[0].position > 0));
            last = arm.inputs[0].position;
            assert!((sample.q[0] - arm.bus.position()).abs() < 0.03, "{} of {}", sample.q[0], arm.bus.position());
            arm.command(&[0.0], &[-20.0]);
        }
        assert!(wraps > 0 && arm.bus.position() < -1.0, "{wraps}, {}", arm.bus.position());
    }

    #[test]
    fn drive_in_position_mode_follows_the_plan() {
        let mut table = table();
        table.mode = crate::drive::POSITION_MODE;
        let mut arm = Arm::enable(SimulatedBus::new(&[0]).expect("a bus"), table, || ()).expect("enabled");
        for k in 0..3000 {
            let sample = arm.exchange().expect("a frame");
            assert_eq!(sample.faults, 0);
            arm.command(&[0.5 * (1.0 - (0.002 * f64::from(k)).cos())], &[0.0]);
        }
        let planned = 0.5 * (1.0 - 6.0_f64.cos());
        assert!((arm.bus.position() - planned).abs() < 0.1, "{} of {planned}", arm.bus.position());
    }

    #[test]
    fn lost_frames_give_no_sample_and_the_motion_goes_on() {
        let mut arm = arm();
        arm.bus.lost_every = 10;
        let samples = (0..100).filter_map(|_| arm.exchange()).count();
        assert_eq!(samples, 90);
    }

    #[test]
    fn failed_drive_is_switched_off_and_stays_off() {
        let mut arm = arm();
        arm.bus.fail();
        for cycle in 0..100 {
            let sample = arm.exchange().expect("a frame");
            arm.command(&[1.0], &[20.0]);
            if cycle > 1 {
                assert_ne!(sample.faults, 0);
                assert_eq!((arm.outputs[0].control, arm.outputs[0].torque), (0x06, 0));
                assert_eq!(arm.outputs[0].position, arm.inputs[0].position);
            }
        }
    }
}
