//! Dynamics by closed forms, identities on random arms and another program's figures. One program, so that it is linked once and its tests share the processors:
//! `cargo test --release --package rivet-dynamics --test dynamics base::` runs one file of them.

mod base;
mod closed_forms;
mod energy;
mod friction;
mod golden;
mod laws;
mod mjcf;
mod trees;
mod urdf;
mod write_urdf;

#[path = "../common/mod.rs"]
mod common;
