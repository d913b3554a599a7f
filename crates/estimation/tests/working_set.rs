//! What an estimator of a six-axis arm holds in memory: less is what a cold cache costs less for.

mod common;

use allocation_counter::measure;
use common::Bench;
use rivet_estimation::{EigenSettings, Identifier, Instruments, Settings, Supervision, TrackedSettings};

/// What an identifier owns \[KiB\], filters and scratch included; the shared model is beside.
fn held(bench: &Bench, settings: &Settings) -> f64 {
    let mut made = None;
    let seen =
        measure(|| made = Some(Identifier::new(bench.model.clone(), bench.base.clone(), &bench.nominal, settings)));
    made.expect("it ran").expect("sound settings");
    seen.bytes_current as f64 / 1024.0
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
