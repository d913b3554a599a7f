//! `rivet.ControlRequest.v1` and `rivet.ControlReply.v1`

use iceoryx2::prelude::ZeroCopySend;

use super::{message, wire_enum};

/// What anyone may ask of the daemon, on service `rivet/<robot>/control`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ZeroCopySend)]
#[type_name("rivet.ControlRequest.v1")]
#[repr(C)]
pub struct ControlRequest {
    /// A [`ControlCommand`].
    pub command: u32,
    /// Zero. Padding is spelt out, so the layout can be read off the source.
    pub reserved: u32,
}

/// The daemon's answer to a [`ControlRequest`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, ZeroCopySend)]
#[type_name("rivet.ControlReply.v1")]
#[repr(C)]
pub struct ControlReply {
    /// A [`ControlStatus`].
    pub status: u32,
    /// Zero. Padding is spelt out, so the layout can be read off the source.
    pub reserved: u32,
    /// Epoch of the parameters in force when the answer was given.
    pub epoch: u64,
}

wire_enum!(
    /// A wish to the daemon.
    ControlCommand {
        /// Keep the parameters as they are.
        Freeze = 0,
        /// Learn again.
        Resume = 1,
        /// Forget everything: nominal parameters, empty window.
        Reset = 2,
        /// Write the parameters to the store.
        Save = 3,
        /// Take the parameters from the store.
        Load = 4,
    }
);

wire_enum!(
    /// How a [`ControlRequest`] ended.
    ControlStatus {
        /// Done, or handed to the loop that does it within the next period.
        Done = 0,
        /// Not possible in the present state.
        Refused = 1,
        /// The command is not known to this daemon.
        Unknown = 2,
        /// Tried and failed (the store, say); the daemon's log has the reason.
        Failed = 3,
    }
);

message!(ControlRequest v 1, size 8 align 4, empty ControlRequest { command: 0, reserved: 0 },
    { command @ 0, reserved @ 4 });
message!(ControlReply v 1, size 16 align 8, empty ControlReply { status: 0, reserved: 0, epoch: 0 },
    { status @ 0, reserved @ 4, epoch @ 8 });

impl From<ControlCommand> for ControlRequest {
    fn from(command: ControlCommand) -> Self {
        Self { command: command.into(), reserved: 0 }
    }
}

impl ControlReply {
    /// An answer with the epoch of the parameters in force.
    pub fn new(status: ControlStatus, epoch: u64) -> Self {
        Self { status: status.into(), reserved: 0, epoch }
    }
}
