//! The two-link arm `dd2` on a bus: what tests of neighbours send when it does not matter what.

use crate::process::Process;
use rivet_ipc_schema::{Bus, BusConfig, JointState, RobotName};
use std::process::Command;

/// Its name.
pub fn name() -> RobotName {
    RobotName::new("dd2").expect("a sound name")
}

/// A party on its bus.
pub fn bus(config: &BusConfig, role: &str) -> Bus {
    Bus::open(config, &name(), role).expect("the bus opens")
}

/// Its `rivetd`.
pub fn daemon(config: &BusConfig) -> Command {
    crate::process::daemon(&crate::robot("dd2"), config)
}

/// The same, running.
pub fn running(config: &BusConfig) -> Process {
    Process::start(&mut daemon(config))
}

/// Sample `seq`, 1 ms after the one before: sines that no dynamics are in.
pub fn sample(seq: u64) -> JointState {
    let t = seq as f64 * 0.001;
    let mut state = JointState { seq, stamp_ns: seq * 1_000_000, joints: 2, ..JointState::default() };
    for j in 0..2 {
        state.q[j] = 0.5 * ((5.0 + j as f64) * t).sin();
        state.tau[j] = 3.0 * ((5.0 + j as f64) * t).cos();
    }
    state
}
