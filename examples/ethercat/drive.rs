//! A CiA-402 drive as its master sees it: process data, states of the status word, control words.

use rivet::faults;

/// Cyclic synchronous position and torque: values of 0x6060 and 0x6061.
pub(crate) const POSITION_MODE: i8 = 8;
pub(crate) const TORQUE_MODE: i8 = 10;

/// Control words *disable voltage*, *shutdown*, *enable operation*, and the rising edge that resets a fault.
pub(crate) const DISABLE_VOLTAGE: u16 = 0x00;
pub(crate) const SHUTDOWN: u16 = 0x06;
pub(crate) const ENABLE_OPERATION: u16 = 0x0F;
pub(crate) const FAULT_RESET: u16 = 0x80;

/// Process data of one drive: what it sends and what it receives in a cycle.
pub(crate) type Received = [u8; 19];
pub(crate) type Sent = [u8; 9];

/// What a drive sends in a cycle (TxPDO), little-endian in this order.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Inputs {
    /// 0x6041 status word.
    pub(crate) status: u16,
    /// 0x6061 mode of operation display.
    pub(crate) mode: i8,
    /// 0x6064 position actual value \[increments\].
    pub(crate) position: i32,
    /// 0x606C velocity actual value; its unit is the drive's.
    pub(crate) velocity: i32,
    /// 0x6077 torque actual value \[per mille of 0x6076\].
    pub(crate) torque: i16,
    /// 0x60E4:01 additional position actual value \[increments\].
    pub(crate) link_position: i32,
    /// 0x603F error code.
    pub(crate) error: u16,
}

/// What a drive receives in a cycle (RxPDO), little-endian in this order.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Outputs {
    /// 0x6040 control word.
    pub(crate) control: u16,
    /// 0x6060 mode of operation.
    pub(crate) mode: i8,
    /// 0x607A target position \[increments\].
    pub(crate) position: i32,
    /// 0x6071 target torque \[per mille of 0x6076\].
    pub(crate) torque: i16,
}

impl Inputs {
    /// From the process data of one drive.
    pub(crate) fn from_bytes(b: &Received) -> Inputs {
        let long = |i: usize| i32::from_le_bytes([b[i], b[i + 1], b[i + 2], b[i + 3]]);
        Inputs {
            status: u16::from_le_bytes([b[0], b[1]]),
            mode: i8::from_le_bytes([b[2]]),
            position: long(3),
            velocity: long(7),
            torque: i16::from_le_bytes([b[11], b[12]]),
            link_position: long(13),
            error: u16::from_le_bytes([b[17], b[18]]),
        }
    }
}

impl Outputs {
    /// To the process data of one drive.
    pub(crate) fn to_bytes(self) -> Sent {
        let ([c0, c1], [p0, p1, p2, p3]) = (self.control.to_le_bytes(), self.position.to_le_bytes());
        let ([t0, t1], [mode]) = (self.torque.to_le_bytes(), self.mode.to_le_bytes());
        [c0, c1, mode, p0, p1, p2, p3, t0, t1]
    }
}

/// State of a drive, in the words of CiA 402.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum State {
    NotReadyToSwitchOn,
    SwitchOnDisabled,
    ReadyToSwitchOn,
    SwitchedOn,
    OperationEnabled,
    QuickStopActive,
    FaultReactionActive,
    Fault,
}

impl State {
    /// From bits 0 to 3, 5 and 6 of the status word.
    pub(crate) fn of_status(status: u16) -> State {
        match (status & 0x4F, status & 0x6F) {
            (0x0F, _) => State::FaultReactionActive,
            (0x08, _) => State::Fault,
            (0x40, _) => State::SwitchOnDisabled,
            (_, 0x21) => State::ReadyToSwitchOn,
            (_, 0x23) => State::SwitchedOn,
            (_, 0x27) => State::OperationEnabled,
            (_, 0x07) => State::QuickStopActive,
            _ => State::NotReadyToSwitchOn,
        }
    }

    /// Control word that brings a drive one step nearer to `OperationEnabled`. It resets no fault.
    pub(crate) fn enabling_word(self) -> u16 {
        match self {
            State::SwitchOnDisabled => SHUTDOWN,
            State::ReadyToSwitchOn => 0x07,
            State::SwitchedOn | State::OperationEnabled => ENABLE_OPERATION,
            State::Fault | State::FaultReactionActive | State::QuickStopActive | State::NotReadyToSwitchOn => {
                DISABLE_VOLTAGE
            }
        }
    }

    /// Control word that switches a drive off: *shutdown*, which does not leave `QuickStopActive`; *disable voltage* does.
    pub(crate) fn disabling_word(self) -> u16 {
        if self == State::QuickStopActive { DISABLE_VOLTAGE } else { SHUTDOWN }
    }
}

/// Fault bits of a joint's sample: rivet learns nothing from samples of a drive that is off, in a fault or in another mode.
pub(crate) fn fault_bits(inputs: &Inputs, mode: i8) -> u32 {
    match State::of_status(inputs.status) {
        State::OperationEnabled if inputs.mode == mode => 0,
        State::Fault | State::FaultReactionActive => faults::OTHER | faults::STOPPED,
        _ => faults::STOPPED,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decodes_status_words_whatever_their_other_bits_are() {
        // Bits 6 to 0 by CiA 402, x is either: state, fixed bits, free bits.
        let table = [
            (State::NotReadyToSwitchOn, 0b000_0000, 0b010_0000),
            (State::SwitchOnDisabled, 0b100_0000, 0b010_0000),
            (State::ReadyToSwitchOn, 0b010_0001, 0),
            (State::SwitchedOn, 0b010_0011, 0),
            (State::OperationEnabled, 0b010_0111, 0),
            (State::QuickStopActive, 0b000_0111, 0),
            (State::FaultReactionActive, 0b000_1111, 0b010_0000),
            (State::Fault, 0b000_1000, 0b010_0000),
        ];
        for (state, fixed, free) in table {
            for rest in 0..=u16::MAX {
                let others = rest & !0x6F; // voltage enabled (4), warning (7), and bits 8 to 15
                assert_eq!(State::of_status(fixed | others), state, "{:#06x}", fixed | others);
                assert_eq!(State::of_status(fixed | free | others), state, "{:#06x}", fixed | free | others);
            }
        }
    }

    #[test]
    fn only_an_enabled_drive_in_its_mode_has_no_fault_bits() {
        let inputs = |status, mode| Inputs { status, mode, ..Inputs::default() };
        assert_eq!(fault_bits(&inputs(0x0237, TORQUE_MODE), TORQUE_MODE), 0);
        assert_eq!(fault_bits(&inputs(0x0237, POSITION_MODE), TORQUE_MODE), faults::STOPPED);
        assert_eq!(fault_bits(&inputs(0x0233, TORQUE_MODE), TORQUE_MODE), faults::STOPPED);
        assert_eq!(fault_bits(&inputs(0x0218, TORQUE_MODE), TORQUE_MODE), faults::STOPPED | faults::OTHER);
    }

    #[test]
    fn process_data_is_little_endian_in_the_order_of_the_fields() {
        let bytes = [0x37, 0x02, 10, 0xFE, 0xFF, 0xFF, 0xFF, 1, 0, 0, 0, 0x18, 0xFC, 4, 3, 2, 1, 0x11, 0x75];
        let inputs = Inputs::from_bytes(&bytes);
        let (link_position, error) = (0x0102_0304, 0x7511);
        let expected =
            Inputs { status: 0x0237, mode: 10, position: -2, velocity: 1, torque: -1000, link_position, error };
        assert_eq!(inputs, expected);
        let outputs = Outputs { control: 0x000F, mode: 10, position: i32::MIN, torque: -2 };
        assert_eq!(outputs.to_bytes(), [0x0F, 0, 10, 0, 0, 0, 0x80, 0xFE, 0xFF]);
    }
}
