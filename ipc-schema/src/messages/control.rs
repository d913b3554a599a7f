//! `rivet.ControlRequest.v1` and `rivet.ControlReply.v2`

use iceoryx2::prelude::ZeroCopySend;

use super::{message, wire_enum};

/// What anyone may ask of the daemon, on service `rivet/<robot>/control`, and of the controller, on
/// `rivet/<robot>/controller-control`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ZeroCopySend)]
#[type_name("rivet.ControlRequest.v1")]
#[repr(C)]
pub struct ControlRequest {
    /// A [`ControlCommand`].
    pub command: u32,
    /// Zero. Padding is spelt out, so the layout can be read off the source.
    pub reserved: u32,
}

/// Longest [`ControlReply::text`] \[bytes\].
pub const REPLY_TEXT: usize = 1000;

/// The daemon's answer to a [`ControlRequest`]. Version 2 says why.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ZeroCopySend)]
#[type_name("rivet.ControlReply.v2")]
#[repr(C)]
pub struct ControlReply {
    /// A [`ControlStatus`].
    pub status: u32,
    /// How many bytes of `text` are in use.
    pub length: u32,
    /// Epoch of the parameters in force when the answer was given.
    pub epoch: u64,
    /// What was done, or why it was not, in UTF-8; the rest is zero.
    pub text: [u8; REPLY_TEXT],
}

wire_enum!(
    /// A wish to the daemon or the controller.
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
        /// Read the robot file anew: filters, window and thresholds change between two samples.
        Reload = 5,
        /// Controller: follow the plan again after a stop, once it is within reach.
        Follow = 6,
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
message!(ControlReply v 2, size 1016 align 8, empty ControlReply { status: 0, length: 0, epoch: 0, text: [0; REPLY_TEXT] },
    { status @ 0, length @ 4, epoch @ 8, text @ 16 });

impl From<ControlCommand> for ControlRequest {
    fn from(command: ControlCommand) -> Self {
        Self { command: command.into(), reserved: 0 }
    }
}

impl ControlReply {
    /// An answer with the epoch of the parameters in force; of a text that is too long the beginning.
    pub fn new(status: ControlStatus, epoch: u64, text: &str) -> Self {
        let mut end = text.len().min(REPLY_TEXT);
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        let mut reply = Self { status: status.into(), length: end as u32, epoch, ..Self::default() };
        reply.text[..end].copy_from_slice(&text.as_bytes()[..end]);
        reply
    }

    /// What it says, as far as it is text; no reply, however broken, reads past its own bytes.
    pub fn text(&self) -> std::borrow::Cow<'_, str> {
        String::from_utf8_lossy(&self.text[..(self.length as usize).min(REPLY_TEXT)])
    }
}
