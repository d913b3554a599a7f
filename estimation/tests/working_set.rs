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

/// What an identifier owns \[KiB\], filters and scratch included; the shared model is beside.
fn held(bench: &Bench, settings: &Settings) -> f64 {
    let before = LIVE.load(Ordering::Relaxed);
    let identifier = Identifier::new(bench.model.clone(), bench.base.clone(), &bench.nominal, settings);
    let identifier = identifier.expect("sound settings");
    let held = (LIVE.load(Ordering::Relaxed) - before) as f64 / 1024.0;
    drop(identifier);
    held
}

/// With a setpoint as the only source of instruments, and with every source at the ready as the robot files have it (`auto`): the
/// motion of 20 s in which a cycle is looked for, delayed rows, the closed loop and a second encoder's motion. Bounds are what is
/// measured and a twentieth: growth is to be seen.
#[test]
fn working_set() {
    let auto = Instruments::Auto { delay_s: 0.02, longest_cycle_s: 20.0 };
    for (arm, decimation, filter_hz, most) in [
        ("staubli-tx40", 8, 25.0, [[257.0, 469.0], [294.0, 506.0], [273.0, 484.0]]),
        ("ur10e", 20, 6.0, [[239.0, 332.0], [280.0, 373.0], [252.0, 344.0]]),
        ("manutec-r3", 10, 20.0, [[239.0, 411.0], [280.0, 452.0], [252.0, 423.0]]),
    ] {
        let Some(bench) = Bench::new(arm) else { continue };
        let n = bench.len();
        let schemes = [
            ("eigen", Supervision::Eigen(EigenSettings::default())),
            ("tracked", Supervision::Tracked(TrackedSettings::default())),
            ("off", Supervision::Off),
        ];
        for ((name, supervision), most) in schemes.into_iter().zip(most) {
            for (instruments, most) in [Instruments::Setpoint, auto].into_iter().zip(most) {
                let settings =
                    Settings { supervision, instruments, decimation, filter_hz, ..Settings::new(bench.dof(), 0.001) };
                let held = held(&bench, &settings);
                let squares = held * 1024.0 / (8 * n * n) as f64;
                println!(
                    "{arm}, {n} parameters, {name}, {instruments:?}: {held:.0} KiB, {squares:.2} of a square matrix"
                );
                assert!(held <= most, "{arm} {name} {instruments:?}: {held} KiB");
            }
        }
    }
}
