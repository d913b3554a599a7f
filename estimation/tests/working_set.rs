//! What an estimator of a six-axis arm holds in memory: less is what a cold cache costs less for.
#![allow(unsafe_code, reason = "a global allocator that counts is an unsafe trait")]

mod common;

use common::Bench;
use rivet_estimation::{EigenSettings, Identifier, Instruments, Settings, Supervision, TrackedSettings};
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

struct Counting;

static LIVE: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call is the system allocator's; the counter beside touches no memory of it.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        LIVE.fetch_add(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        LIVE.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promises are passed on.
        unsafe { System.dealloc(memory, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// Everything that an identifier owns, filters and scratch included; the shared model is beside.
#[test]
fn working_set() {
    let Some(bench) = Bench::new("staubli-tx40") else { return };
    let n = bench.len();
    for (name, supervision, most) in [
        ("eigen", Supervision::Eigen(EigenSettings::default()), 327.0),
        ("tracked", Supervision::Tracked(TrackedSettings::default()), 352.0),
        ("off", Supervision::Off, 297.0),
    ] {
        let settings =
            Settings { supervision, instruments: Instruments::Setpoint, ..Settings::new(bench.dof(), 0.001) };
        let before = LIVE.load(Ordering::Relaxed);
        let identifier = Identifier::new(bench.model.clone(), bench.base.clone(), &bench.nominal, &settings);
        let identifier = identifier.expect("sound settings");
        let held = (LIVE.load(Ordering::Relaxed) - before) as f64 / 1024.0;
        println!("{name}, {n} parameters: {held:.0} KiB, {:.2} of a square matrix", held * 1024.0 / (8 * n * n) as f64);
        assert!(held <= most, "{name}: {held} KiB");
        drop(identifier);
    }
}
