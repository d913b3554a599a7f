//! The studies, shortened. One program, so that it is linked once and its tests share the processors:
//! `cargo test --release --package rivet-studies --test studies bank::` runs one file of them.

mod bank;
mod blind;
mod figures;
mod supervision;
