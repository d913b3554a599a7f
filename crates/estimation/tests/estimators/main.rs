//! What estimators find, off line and on, and how sure they say they are. One program, so that it is linked once and its tests share the processors:
//! `cargo test --release --package rivet-estimation --test estimators bank::` runs one file of them.

mod bank;
mod bias;
mod descriptions;
mod encoders;
mod exact;
mod failure_modes;
mod moving;
mod offline;
mod statistics;
mod supervision;
mod windows;

#[path = "../common/mod.rs"]
mod common;
