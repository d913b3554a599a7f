//! Memory that is freed is kept for whoever asks next: a setting of the whole process, so it has one of its own here.
#![cfg(target_env = "gnu")]

use rivet_realtime::{ThreadUsage, keep_freed_memory};

/// Page faults of sixteen signals of a MiB that live side by side, so many times.
fn faults(times: usize) -> u64 {
    let before = ThreadUsage::now();
    for time in 0..times {
        let signals: Vec<Vec<usize>> = (0..16).map(|k| vec![k + time + 1; 1 << 17]).collect();
        std::hint::black_box(&signals);
    }
    ThreadUsage::now().faults - before.faults
}

#[test]
fn the_next_signals_lie_where_the_last_ones_were() {
    keep_freed_memory();
    let once = faults(1);
    let again = faults(20);
    assert!(4 * again < once, "{once} page faults once, {again} in all of twenty times more");
}
