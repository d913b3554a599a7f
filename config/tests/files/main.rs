//! Robot files, good and bad. One program, so that it is linked once:
//! `cargo test --release --package rivet-config --test files bad_files::` runs one file of it.

mod bad_files;
mod effects;
mod identified;
mod joint_zero;
mod linear;
mod reference;
mod robots;
