//! Services on private buses: what is sent arrives, processes that are killed leave nothing, versions that differ are told. One program, so
//! that it is linked once: `cargo test --release --package rivet-ipc-schema --test buses bus::` runs one file of it.

mod bus;
mod recovery;
mod versions;
