//! The bus as the program sees it, and a simulated one. An EtherCAT master is a second implementation of [`Bus`].

use crate::drive::{POSITION_MODE, Received, Sent, State};
use std::f64::consts::TAU;

/// Cyclic exchange with the drives of an arm.
///
/// For a master: `exchange` copies `sent` into its process image, sends the frame, and copies what came back into `received`. In
/// ethercrab 0.7 these are `outputs_raw_mut`, `tx_rx` and `inputs_raw`. The caller waits for the next period, so that the master's
/// distributed clocks have to be aligned with CLOCK_MONOTONIC.
pub(crate) trait Bus {
    /// Exchanges the process data of the drives in the order of the joints. `sent` is empty until status words have been read: a
    /// master stays in SAFE-OP so long, where drives measure and take no outputs. `false`: the frame was lost or its working counter
    /// was wrong, and `received` is as it was.
    fn exchange(&mut self, sent: &[Sent], received: &mut [Received]) -> bool;
}

/// Second encoder of the simulated joint: increments per turn, and its value at joint zero.
pub(crate) const LINK_COUNTS_PER_REV: f64 = 524_288.0;
pub(crate) const LINK_ZERO: i32 = 98_765;

/// One drive and the arm of one joint of the other examples. It has numbers of its own: a mistake in the scaling shows.
pub(crate) struct SimulatedBus {
    /// Position \[rad\], velocity \[rad/s\] and torque \[N m\] of the joint.
    q: f64,
    qd: f64,
    tau: f64,
    pub(crate) status: u16,
    /// Mode that the drive shows, whatever is asked for.
    pub(crate) forced_mode: Option<i8>,
    /// Edges of reset that the drive takes until it leaves its fault.
    pub(crate) resets_to_clear: u32,
    sent: Sent,
    received: Received,
    cycles: u64,
    /// Every so many frames one is lost; 0: none.
    pub(crate) lost_every: u64,
}

impl SimulatedBus {
    /// The arm is at rest, its drive in a fault that a reset clears. `slaves` are the positions of the joints' drives.
    pub(crate) fn new(slaves: &[usize]) -> Result<SimulatedBus, String> {
        if slaves != [0] {
            return Err(format!(
                "slaves {slaves:?}: the simulated bus has one drive, at position 0; take one [[joint]] with slave = 0"
            ));
        }
        let (q, qd, tau, sent, received) = (0.0, 0.0, 0.0, [0; 9], [0; 19]);
        let (status, forced_mode, resets_to_clear) = (0x0218, None, 1);
        let (cycles, lost_every) = (0, 0);
        let mut bus =
            SimulatedBus { q, qd, tau, status, forced_mode, resets_to_clear, sent, received, cycles, lost_every };
        bus.measure();
        Ok(bus)
    }

    /// Puts the drive into a state by its status word.
    #[cfg(test)]
    pub(crate) fn set_status(&mut self, status: u16) {
        self.status = status;
        self.measure();
    }

    /// True position of the joint \[rad\].
    #[cfg(test)]
    pub(crate) fn position(&self) -> f64 {
        self.q
    }

    fn received_position(&self) -> [u8; 4] {
        let [_, _, _, a, b, c, d, ..] = self.received;
        [a, b, c, d]
    }

    fn measure(&mut self) {
        // 100 motor turns of 2^20 increments a joint turn, counted backwards from an offset near the end of 32 bits.
        let motor = |joint: f64| -joint * 100.0 / TAU * 1_048_576.0;
        let position = (2_147_400_000.0 + motor(self.q).floor()) as i64 as i32;
        // 1000 per mille are 0.2 N m at the motor, 20 N m at the joint.
        let torque = (-self.tau / 20.0 * 1000.0).round() as i16;
        let velocity = motor(self.qd) as i32;
        let mut bytes = Vec::from(self.status.to_le_bytes());
        bytes.extend(self.forced_mode.unwrap_or(i8::from_le_bytes([self.sent[2]])).to_le_bytes());
        bytes.extend(position.to_le_bytes());
        bytes.extend(velocity.to_le_bytes());
        bytes.extend(torque.to_le_bytes());
        let link = f64::from(LINK_ZERO) + (self.q * LINK_COUNTS_PER_REV / TAU).floor();
        bytes.extend((link as i32).to_le_bytes());
        let error: u16 = if State::of_status(self.status) == State::Fault { 0x7305 } else { 0 }; // of an encoder
        bytes.extend(error.to_le_bytes());
        self.received.copy_from_slice(&bytes);
    }

    /// Transitions of CiA 402 that a control word causes.
    fn transition(&mut self, control: u8) {
        let (state, reset) = (State::of_status(self.status), control & 0x80 != 0 && self.sent[0] & 0x80 == 0);
        self.resets_to_clear -= u32::from(state == State::Fault && reset && self.resets_to_clear > 0);
        self.status = match state {
            State::Fault if reset && self.resets_to_clear == 0 => 0x0250,
            State::Fault => self.status,
            _ if control & 0x02 == 0 => 0x0250, // disable voltage
            State::QuickStopActive => self.status,
            State::OperationEnabled if control & 0x04 == 0 => 0x0217, // quick stop
            _ if control & 0x04 == 0 => 0x0250,
            State::SwitchOnDisabled | State::SwitchedOn | State::OperationEnabled if control & 0x01 == 0 => 0x0231,
            State::ReadyToSwitchOn if control & 0x0F == 0x07 => 0x0233,
            State::SwitchedOn if control & 0x0F == 0x0F => 0x1237,
            State::OperationEnabled if control & 0x08 == 0 => 0x0233,
            _ => self.status,
        };
    }
}

impl Bus for SimulatedBus {
    fn exchange(&mut self, sent: &[Sent], received: &mut [Received]) -> bool {
        self.cycles += 1;
        let arrives = self.lost_every == 0 || !self.cycles.is_multiple_of(self.lost_every);
        if arrives {
            received[0] = self.received;
            if let Some(sent) = sent.first() {
                self.transition(sent[0]);
                self.sent = *sent;
            }
        }
        // The motion of 1 ms. Without power the brake holds.
        let enabled = State::of_status(self.status) == State::OperationEnabled;
        let [_, _, mode, position @ .., low, high] = self.sent;
        let per_mille = if i8::from_le_bytes([mode]) == POSITION_MODE {
            // The drive's own controller: increments of the counter from its target, and motor speed.
            let error = i32::from_le_bytes(position).wrapping_sub(i32::from_le_bytes(self.received_position()));
            (f64::from(error) / 600.0 + self.qd * 3000.0).clamp(-3000.0, 3000.0)
        } else {
            f64::from(i16::from_le_bytes([low, high]))
        };
        let target = if enabled { -per_mille / 1000.0 * 20.0 } else { 0.0 };
        for i in (0..10).take_while(|_| enabled) {
            let torque = self.tau + (target - self.tau) * (f64::from(i) + 0.5) / 10.0;
            let friction = 1.5 * self.qd + 2.0 * (self.qd / 0.1).tanh();
            self.qd += 1e-4 * (torque - 1.5 * 9.81 * self.q.sin() - friction) / 0.9;
            self.q += 1e-4 * self.qd;
        }
        self.tau = target;
        self.qd = if enabled { self.qd } else { 0.0 };
        self.measure();
        arrives
    }
}
