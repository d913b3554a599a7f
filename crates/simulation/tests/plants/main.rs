//! The simulated arms by themselves, without processes. One program, so that it is linked once and its tests share the processors:
//! `cargo test --release --package rivet-simulation --test plants effects::` runs one file of them.

mod effects;
mod motion;
mod plant;
mod robots;
mod stand_in;
mod two_mass;

#[path = "../common/mod.rs"]
mod common;
