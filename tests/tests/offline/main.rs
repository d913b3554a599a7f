//! What needs neither a bus nor a clock: what `rivet` says of logs, and closed loops without processes. One program, so that
//! it is linked once and its tests share the processors: `cargo test --release --package rivet-tests --test offline diagnose::`
//! runs one file of them.

mod base_flexibility;
mod blind;
mod closed_loop_bias;
mod consistent;
mod delay;
mod diagnose;
mod diagnose_export;
mod dragged;
mod drift;
mod export;
mod friction_ladder;
mod identify_values;
mod identify_words;
mod incomplete;
mod instruments;
mod jitter;
mod kinematics;
mod late_torque;
mod log_mistakes;
mod mounted;
mod one_by_one;
mod otherwise;
mod poisoned;
mod real_diagnose;
mod real_identify;
mod real_study;
mod repeats;
mod report;
mod rounded;
mod self_check;
mod separate;
mod statistics;
mod sticking;
mod strange_torque;
mod strangers;
mod tracking;
mod unseen;
mod value_intervals;
mod warming;
