//! Serves what a robot's processes publish to Foxglove, over WebSocket: the program `rivet-view`, which `rivet view` starts.
//!
//! Topics and schemas are those of `rivet record`, so that one layout opens both. Nothing is written to the bus.
//!
//! | part | work |
//! |---|---|
//! | [`protocol`] | messages of the protocol, without a socket |
//! | [`Server`] | listens, and passes messages to the clients that subscribed |
//! | [`layout`] | the layout for a robot |
//! | [`run`] | joins both with the bus |

mod channel;
mod client;
mod error;
pub mod layout;
pub mod protocol;
mod run;
mod server;
mod shared;
mod thinning;

pub use channel::Channel;
pub use error::Failure;
pub use run::run;
pub use server::{Server, ServerError};
