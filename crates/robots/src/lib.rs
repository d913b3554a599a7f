//! Robots that are read by their own protocols, and whose samples go to the bus: the sockets, the attempts to connect, and what is
//! counted. What a protocol's bytes mean is in a crate of its own, without socket or clock.

mod backoff;
pub mod ur;
