//! The drives of an arm as one: enabled together, switched off together, in joint quantities.

use crate::bus::Bus;
use crate::drive::{
    DISABLE_VOLTAGE, ENABLE_OPERATION, FAULT_RESET, Inputs, Outputs, Received, Sent, State, fault_bits,
};
use crate::scaling::{Encoder, Table};
use rivet::Sample;

/// Cycles that drives may take to be enabled.
const MAX_ENABLING_CYCLES: u32 = 5000;

/// A fault is reset at most so often, and only at the start. Between two resets are so many cycles.
const MAX_RESETS: u32 = 3;
const CYCLES_PER_RESET: u32 = 100;

/// Cycles without torque before the drives are switched off, cycles that their ramps of *shutdown* may take, cycles of *disable
/// voltage*: more than one, as frames are lost.
const REST_CYCLES: u32 = 10;
const MAX_SHUTDOWN_CYCLES: u32 = 500;
const OFF_CYCLES: u32 = 10;

/// Joints of a sample.
const MAX_JOINTS: usize = 8;

/// All drives of an arm, by a scaling table. They are switched off when it is dropped.
pub(crate) struct Arm<B: Bus, W: FnMut() -> u64> {
    bus: B,
    /// Waits for the next cycle, and returns its stamp \[ns\].
    wait: W,
    table: Table,
    inputs: Vec<Inputs>,
    outputs: Vec<Outputs>,
    encoders: Vec<Encoder>,
    /// What is added to each joint's target position \[increments\]: the drive counts from its own position at the start, whatever
    /// the zero of a second encoder is.
    offsets: Vec<i32>,
    /// No drive has failed since all were enabled.
    enabled: bool,
}

impl<B: Bus, W: FnMut() -> u64> Arm<B, W> {
    /// Enables all drives without torque and at the position that they have. `wait` waits for the next cycle, and returns its stamp
    /// \[ns\].
    ///
    /// # Errors
    /// The first drive whose fault stays after `MAX_RESETS`, or that is not enabled in time: joint, slave, state, error code.
    pub(crate) fn enable(bus: B, table: Table, wait: W) -> Result<Arm<B, W>, String> {
        let inputs = vec![Inputs::default(); table.joints.len()];
        let (outputs, encoders, offsets) = (Vec::new(), Vec::new(), Vec::new());
        let mut arm = Arm { bus, wait, table, inputs, outputs, encoders, offsets, enabled: false };
        let mut resets = vec![0; arm.inputs.len()];
        for cycle in 1..=MAX_ENABLING_CYCLES {
            if arm.cycle().is_none() {
                continue;
            }
            // What has been sent fits the states that were read: the first cycle reads, and sends nothing.
            let at_work = |(output, input): (&Outputs, &Inputs)| {
                output.control == ENABLE_OPERATION && fault_bits(input, arm.table.mode) == 0
            };
            if !arm.outputs.is_empty() && arm.outputs.iter().zip(&arm.inputs).all(at_work) {
                let joints = arm.table.joints.iter().zip(&arm.inputs);
                let pairs = joints.map(|(joint, input)| {
                    let mut encoder = Encoder::new(joint, input);
                    let target = joint.target_position(encoder.position(joint, input));
                    (encoder, input.position.wrapping_sub(target))
                });
                (arm.encoders, arm.offsets) = pairs.unzip();
                arm.enabled = true;
                return Ok(arm);
            }
            arm.outputs.resize(arm.inputs.len(), Outputs { mode: arm.table.mode, ..Outputs::default() });
            for (j, (output, input)) in arm.outputs.iter_mut().zip(&arm.inputs).enumerate() {
                let state = State::of_status(input.status);
                if state != State::OperationEnabled || output.control != ENABLE_OPERATION {
                    output.position = input.position; // an enabled drive holds the position that it had then
                }
                output.control = state.enabling_word();
                if state == State::Fault && cycle.is_multiple_of(CYCLES_PER_RESET) {
                    if resets[j] == MAX_RESETS {
                        return Err(format!("{} after {MAX_RESETS} resets", arm.describe(j)));
                    }
                    (output.control, resets[j]) = (FAULT_RESET, resets[j] + 1);
                }
            }
        }
        if arm.outputs.is_empty() {
            return Err(format!("no frame came back in {MAX_ENABLING_CYCLES} cycles; look at cable and master"));
        }
        let off = arm.inputs.iter().position(|input| fault_bits(input, arm.table.mode) != 0).unwrap_or_default();
        Err(format!("{} after {MAX_ENABLING_CYCLES} cycles", arm.describe(off)))
    }

    /// One cycle: sends what was commanded last, returns what the drives have measured; `None` if the frame was lost. The sample has
    /// the stamp of the cycle.
    pub(crate) fn exchange(&mut self) -> Option<Sample> {
        let mut sample = Sample { stamp_ns: self.cycle()?, ..Sample::default() };
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
    /// Once a drive is not enabled, or shows another mode, all are switched off and stay so.
    pub(crate) fn command(&mut self, positions: &[f64], torques: &[f64]) {
        self.enabled &= self.inputs.iter().all(|input| fault_bits(input, self.table.mode) == 0);
        let moves = self.enabled;
        for (j, (joint, output)) in self.table.joints.iter().zip(&mut self.outputs).enumerate() {
            let input = &self.inputs[j];
            output.control = if moves { ENABLE_OPERATION } else { State::of_status(input.status).disabling_word() };
            let target = joint.target_position(positions[j]).wrapping_add(self.offsets[j]);
            output.position = if moves { target } else { input.position };
            output.torque = if moves { joint.target_torque(torques[j]) } else { 0 };
        }
    }

    /// Waits, and exchanges the process data of all drives; the cycle's stamp \[ns\], `None` if the frame was lost.
    fn cycle(&mut self) -> Option<u64> {
        let stamp_ns = (self.wait)();
        let (mut sent, mut received) = ([Sent::default(); MAX_JOINTS], [Received::default(); MAX_JOINTS]);
        for (bytes, output) in sent.iter_mut().zip(&self.outputs) {
            *bytes = output.to_bytes();
        }
        if !self.bus.exchange(&sent[..self.outputs.len()], &mut received[..self.inputs.len()]) {
            return None;
        }
        for (bytes, input) in received.iter().zip(&mut self.inputs) {
            *input = Inputs::from_bytes(bytes);
        }
        Some(stamp_ns)
    }

    fn describe(&self, j: usize) -> String {
        let (slave, Inputs { status, mode, error, .. }) = (self.table.joints[j].slave, self.inputs[j]);
        let state = State::of_status(status);
        format!(
            "joint {}, slave {slave}: {state:?}, status word {status:#06x}, mode {mode}, error {error:#06x} (0x603F)",
            j + 1
        )
    }
}

/// Switches the drives off, whichever way the program ends: some cycles without torque at the last target position, *shutdown* until
/// none is enabled, *disable voltage*.
impl<B: Bus, W: FnMut() -> u64> Drop for Arm<B, W> {
    fn drop(&mut self) {
        for cycle in 0..REST_CYCLES + MAX_SHUTDOWN_CYCLES {
            let mut enabled = false;
            for (output, input) in self.outputs.iter_mut().zip(&self.inputs) {
                let (state, fits) = (State::of_status(input.status), fault_bits(input, self.table.mode) == 0);
                enabled |= state == State::OperationEnabled;
                let rests = cycle < REST_CYCLES && fits && output.control == ENABLE_OPERATION;
                output.control = if rests { ENABLE_OPERATION } else { state.disabling_word() };
                output.position = if fits { output.position } else { input.position };
                output.torque = 0;
            }
            if cycle > REST_CYCLES && !enabled {
                break;
            }
            self.cycle();
        }
        self.outputs.iter_mut().for_each(|output| output.control = DISABLE_VOLTAGE);
        for _ in 0..OFF_CYCLES {
            self.cycle();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::{LINK_COUNTS_PER_REV, LINK_ZERO, SimulatedBus};
    use crate::drive::{POSITION_MODE, SHUTDOWN, TORQUE_MODE};
    use crate::scaling::read;
    use rivet::faults;
    use std::f64::consts::TAU;
    use std::path::Path;

    fn table() -> Table {
        read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/ethercat/arm.toml")).expect("a table")
    }

    /// The simulated bus, and what was sent on it: a position, once the drive takes outputs.
    struct Recorder {
        bus: SimulatedBus,
        sent: Vec<Outputs>,
    }

    impl Recorder {
        fn new(status: u16) -> Recorder {
            let mut bus = SimulatedBus::new(&[0]).expect("a bus");
            bus.set_status(status);
            Recorder { bus, sent: Vec::new() }
        }

        /// Control words without repetitions.
        fn words(&self) -> Vec<u16> {
            let mut words: Vec<u16> = self.sent.iter().map(|sent| sent.control).collect();
            words.dedup();
            words
        }

        fn state(&self) -> State {
            State::of_status(self.bus.status)
        }
    }

    impl Bus for &mut Recorder {
        fn exchange(&mut self, sent: &[Sent], received: &mut [Received]) -> bool {
            self.sent.extend(sent.iter().map(|[c0, c1, mode, p0, p1, p2, p3, t0, t1]| Outputs {
                control: u16::from_le_bytes([*c0, *c1]),
                mode: i8::from_le_bytes([*mode]),
                position: i32::from_le_bytes([*p0, *p1, *p2, *p3]),
                torque: i16::from_le_bytes([*t0, *t1]),
            }));
            self.bus.exchange(sent, received)
        }
    }

    const FAULT: u16 = 0x0218;
    const ENABLED: u16 = 0x1237;
    const QUICK_STOP: u16 = 0x0217;

    fn arm(recorder: &mut Recorder, table: Table) -> Arm<&mut Recorder, impl FnMut() -> u64> {
        Arm::enable(recorder, table, || 0).expect("enabled")
    }

    fn position_table() -> Table {
        Table { mode: POSITION_MODE, ..table() }
    }

    #[test]
    fn resets_a_fault_and_enables_at_rest() {
        let mut recorder = Recorder::new(FAULT);
        let mut arm = arm(&mut recorder, table());
        let sample = arm.exchange().expect("a frame");
        assert_eq!((sample.faults, sample.tau[0]), (0, 0.0));
        assert!(sample.q[0].abs() < 1e-7, "{}", sample.q[0]);
        assert_eq!(arm.bus.words(), [0x00, 0x80, 0x00, 0x06, 0x07, 0x0F]);
        assert!(arm.bus.sent.iter().all(|sent| sent.torque == 0));
    }

    /// An enabled drive is not switched off by the start, and the arm is at work afterwards; also if its mode was another.
    #[test]
    fn drive_that_is_enabled_already_stays_so() {
        for table in [table(), position_table()] {
            let mut recorder = Recorder::new(ENABLED);
            let mut arm = arm(&mut recorder, table);
            let start = arm.inputs[0].position;
            for _ in 0..50 {
                assert_eq!(arm.exchange().expect("a frame").faults, 0);
                arm.command(&[0.0], &[0.0]);
            }
            assert_eq!(arm.bus.words(), [ENABLE_OPERATION]);
            assert_eq!((arm.bus.sent[0].position, arm.bus.sent[0].torque), (start, 0));
        }
    }

    /// Whatever state a drive is in at the start, it is enabled after, and off once the arm is dropped.
    #[test]
    fn drive_of_every_state_is_enabled_and_switched_off_again() {
        for status in [FAULT, QUICK_STOP, 0x0250, 0x0231, 0x0233, ENABLED] {
            for table in [table(), position_table()] {
                let mut recorder = Recorder::new(status);
                let mode = table.mode;
                let mut arm = arm(&mut recorder, table);
                assert_eq!(arm.bus.state(), State::OperationEnabled, "{status:#06x}");
                for _ in 0..100 {
                    assert_eq!(arm.exchange().expect("a frame").faults, 0);
                    arm.command(&[0.1], &[20.0]);
                }
                let (before, target) = (arm.bus.sent.len(), arm.outputs[0].position);
                drop(arm);
                assert_eq!(recorder.state(), State::SwitchOnDisabled);
                let last = &recorder.sent[before..];
                let rest = last.iter().take_while(|sent| sent.control == ENABLE_OPERATION).count();
                assert!(rest >= 5 && last.iter().all(|sent| sent.torque == 0), "{rest} cycles of rest");
                assert!(mode == TORQUE_MODE || last[..rest].iter().all(|sent| sent.position == target));
                let words = recorder.words();
                assert_eq!(words[words.len() - 3..], [ENABLE_OPERATION, SHUTDOWN, DISABLE_VOLTAGE]);
            }
        }
    }

    #[test]
    fn drives_are_switched_off_though_frames_are_lost() {
        for lost_every in [2, 3, 7] {
            let mut recorder = Recorder::new(ENABLED);
            recorder.bus.lost_every = lost_every;
            drop(arm(&mut recorder, table()));
            assert_eq!(recorder.state(), State::SwitchOnDisabled);
        }
    }

    #[test]
    fn fault_that_stays_is_reset_three_times_and_named() {
        let mut recorder = Recorder::new(FAULT);
        recorder.bus.resets_to_clear = 4;
        let why = Arm::enable(&mut recorder, table(), || 0).err().expect("the fault stays");
        assert_eq!(why, "joint 1, slave 0: Fault, status word 0x0218, mode 10, error 0x7305 (0x603F) after 3 resets");
        let resets: Vec<usize> =
            (0..recorder.sent.len()).filter(|i| recorder.sent[*i].control == FAULT_RESET).collect();
        assert_eq!(resets.len(), 3);
        assert!(resets.windows(2).all(|two| two[1] - two[0] >= 50), "{resets:?}");
    }

    #[test]
    fn start_that_fails_says_why_and_leaves_no_drive_enabled() {
        let mut recorder = Recorder::new(ENABLED);
        recorder.bus.forced_mode = Some(POSITION_MODE);
        let why = Arm::enable(&mut recorder, table(), || 0).err().expect("the mode is another");
        assert!(why.contains("slave 0: OperationEnabled, status word 0x1237, mode 8,"), "{why}");
        assert_eq!(recorder.state(), State::SwitchOnDisabled);
        let mut recorder = Recorder::new(ENABLED);
        recorder.bus.lost_every = 1;
        let why = Arm::enable(&mut recorder, table(), || 0).err().expect("no frame");
        assert!(why.starts_with("no frame came back"), "{why}");
    }

    /// 20 N m lift the arm from the lowest point to beyond 1 rad; the counter wraps on the way.
    #[test]
    fn torque_moves_the_arm_across_the_wrap_of_its_counter() {
        let mut recorder = Recorder::new(FAULT);
        let mut arm = arm(&mut recorder, table());
        let (mut last, mut wraps) = (arm.inputs[0].position, 0);
        for _ in 0..2000 {
            let sample = arm.exchange().expect("a frame");
            wraps += u32::from((last > 0) != (arm.inputs[0].position > 0));
            last = arm.inputs[0].position;
            let position = arm.bus.bus.position();
            assert!((sample.q[0] - position).abs() < 0.03, "{} of {position}", sample.q[0]);
            arm.command(&[0.0], &[-20.0]);
        }
        assert!(wraps > 0 && arm.bus.bus.position() < -1.0, "{wraps}, {}", arm.bus.bus.position());
    }

    #[test]
    fn drive_in_position_mode_follows_the_plan() {
        let mut recorder = Recorder::new(FAULT);
        let mut arm = arm(&mut recorder, position_table());
        for k in 0..3000 {
            let sample = arm.exchange().expect("a frame");
            assert_eq!(sample.faults, 0);
            arm.command(&[0.5 * (1.0 - (0.002 * f64::from(k)).cos())], &[0.0]);
        }
        let (planned, position) = (0.5 * (1.0 - 6.0_f64.cos()), arm.bus.bus.position());
        assert!((position - planned).abs() < 0.1, "{position} of {planned}");
    }

    /// The zeros of the two encoders disagree by 0.3 rad: no target jumps, and the arm follows the plan from where it is.
    #[test]
    fn first_target_is_the_position_of_the_drive_whatever_the_second_encoder_shows() {
        let mut table = position_table();
        let counts_per_rad = LINK_COUNTS_PER_REV / TAU;
        table.joints[0].link = Some((counts_per_rad, LINK_ZERO + (0.3 * counts_per_rad) as i32));
        let mut recorder = Recorder::new(FAULT);
        let mut arm = arm(&mut recorder, table);
        let start = arm.exchange().expect("a frame").q[0];
        assert!((start + 0.3).abs() < 1e-4, "the second encoder gives the position: {start}");
        let actual = arm.inputs[0].position;
        arm.command(&[start], &[0.0]);
        // An increment of the second encoder is 200 of the motor's.
        assert!(arm.outputs[0].position.abs_diff(actual) <= 200, "{} of {actual}", arm.outputs[0].position);
        for k in 0..3000 {
            assert_eq!(arm.exchange().expect("a frame").faults, 0);
            arm.command(&[start + 0.5 * (1.0 - (0.002 * f64::from(k)).cos())], &[0.0]);
        }
        let (planned, position) = (0.5 * (1.0 - 6.0_f64.cos()), arm.bus.bus.position());
        assert!((position - planned).abs() < 0.1, "{position} of {planned}");
        let targets: Vec<i32> =
            arm.bus.sent.iter().filter(|sent| sent.control == ENABLE_OPERATION).map(|sent| sent.position).collect();
        let step = targets.windows(2).map(|two| two[1].wrapping_sub(two[0]).unsigned_abs()).max();
        // At 1 rad/s a period of 1 ms has 16 689 increments.
        assert!(step.is_some_and(|step| step < 20_000), "{step:?}");
    }

    #[test]
    fn lost_frames_give_no_sample_and_the_motion_goes_on() {
        let mut recorder = Recorder::new(FAULT);
        let mut arm = arm(&mut recorder, table());
        arm.bus.bus.lost_every = 10;
        let samples = (0..100).filter_map(|_| arm.exchange()).count();
        assert_eq!(samples, 90);
    }

    /// A fault, a quick stop, another mode: off, and off though the drive is well again. No fault is reset.
    #[test]
    fn failed_drive_is_switched_off_and_stays_off() {
        let cases = [
            (FAULT, None, faults::OTHER | faults::STOPPED, State::Fault),
            (QUICK_STOP, None, faults::STOPPED, State::ReadyToSwitchOn),
            (ENABLED, Some(POSITION_MODE), faults::STOPPED, State::ReadyToSwitchOn),
        ];
        for (status, mode, bits, after) in cases {
            let mut recorder = Recorder::new(ENABLED);
            let mut arm = arm(&mut recorder, table());
            arm.bus.bus.forced_mode = mode;
            arm.bus.bus.set_status(status);
            for cycle in 0..100 {
                let sample = arm.exchange().expect("a frame");
                arm.command(&[1.0], &[20.0]);
                assert!(cycle > 1 || sample.faults == bits, "{status:#06x}, {cycle}: {}", sample.faults);
                assert_ne!(arm.outputs[0].control, ENABLE_OPERATION);
                assert_eq!((arm.outputs[0].position, arm.outputs[0].torque), (arm.inputs[0].position, 0));
            }
            assert_eq!(arm.bus.state(), after);
            assert!(arm.bus.sent.iter().all(|sent| sent.control & FAULT_RESET == 0));
            arm.bus.bus.forced_mode = None;
            arm.bus.bus.set_status(ENABLED);
            for _ in 0..3 {
                arm.exchange();
                arm.command(&[1.0], &[20.0]);
                assert_ne!(arm.outputs[0].control, ENABLE_OPERATION);
            }
        }
    }

    /// A drive that shows another mode only as the program ends: its target is where it is, not where the plan was.
    #[test]
    fn drive_in_another_mode_does_not_jump_as_the_program_ends() {
        let mut recorder = Recorder::new(ENABLED);
        let mut arm = arm(&mut recorder, table());
        arm.exchange();
        arm.command(&[1.0], &[0.0]);
        arm.bus.bus.forced_mode = Some(POSITION_MODE);
        assert!(arm.exchange().is_some() && arm.exchange().is_some());
        let (before, position) = (arm.bus.sent.len(), arm.inputs[0].position);
        drop(arm);
        assert!(recorder.sent[before..].iter().all(|sent| sent.control & 0x08 == 0));
        assert!(recorder.sent[before..].iter().all(|sent| sent.position.abs_diff(position) < 1000));
    }

    /// Two drives whose status words are given, a pair for each cycle; their positions drift by an increment a cycle.
    struct Script {
        statuses: Vec<[u16; 2]>,
        sent: Vec<Vec<Sent>>,
    }

    impl Bus for &mut Script {
        fn exchange(&mut self, sent: &[Sent], received: &mut [Received]) -> bool {
            let cycle = self.sent.len();
            let statuses = self.statuses[cycle.min(self.statuses.len() - 1)];
            self.sent.push(sent.to_vec());
            for (bytes, status) in received.iter_mut().zip(statuses) {
                bytes[..2].copy_from_slice(&status.to_le_bytes());
                bytes[2] = TORQUE_MODE as u8;
                bytes[3] = cycle as u8;
            }
            true
        }
    }

    fn two_joints() -> Table {
        let one = table();
        let other = crate::scaling::Joint { slave: 1, ..one.joints[0].clone() };
        Table { mode: one.mode, joints: vec![one.joints[0].clone(), other] }
    }

    /// The first drive is enabled and waits for the second at the position that it had. The second shows *operation enabled*
    /// before 0x0F was sent, which is not enough. Later it fails, and the first is switched off too.
    #[test]
    fn drives_are_enabled_together_and_switched_off_together() {
        let (on, off, fault) = (ENABLED, 0x0250, FAULT);
        let mut statuses = vec![[on, off], [on, off], [on, off], [on, on], [on, on], [on, on], [on, fault]];
        statuses.extend([[0x0231, fault]; 3]);
        let mut script = Script { statuses, sent: Vec::new() };
        let mut arm = Arm::enable(&mut script, two_joints(), || 0).expect("enabled");
        let sent = |arm: &Arm<&mut Script, _>, joint: usize| -> Vec<[u8; 2]> {
            arm.bus.sent.iter().skip(1).map(|frame| [frame[joint][0], frame[joint][3]]).collect()
        };
        assert!(arm.bus.sent[0].is_empty());
        assert_eq!(sent(&arm, 0), [[0x0F, 0]; 4], "control word and position");
        assert_eq!(sent(&arm, 1), [[0x06, 0], [0x06, 1], [0x06, 2], [0x0F, 3]]);
        for control in [0x0F, 0x06] {
            arm.exchange();
            arm.command(&[0.0; 2], &[1.0; 2]);
            assert_eq!(arm.outputs.iter().map(|output| output.control).collect::<Vec<_>>(), [control; 2]);
        }
        drop(arm);
        assert!(script.sent[7..].iter().flatten().all(|sent| sent[0] & 0x08 == 0 && sent[7..] == [0, 0]));
    }
}
