//! Logs as they are read and put on an even clock. One program, so that it is linked once:
//! `cargo test --release --package rivet-logs --test logs read::` runs one file of it.

mod arrays;
mod converted;
mod data_sets;
mod formats;
mod mapping;
mod other_writers;
mod read;
mod recordings;
mod resample;
mod stamps;
