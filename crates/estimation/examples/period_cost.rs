//! What one period of the estimation costs on this machine: `cargo run --release -p rivet-estimation --example period_cost`.

#[path = "../tests/common/mod.rs"]
mod common;

use common::{Bench, Random, Wave};
use rivet_estimation::{ColumnsSettings, EigenSettings, EstimatorKind, Identifier, Settings, Supervision};
use std::time::Instant;

fn main() {
    let Some(mut bench) = Bench::new("staubli-tx40") else { return };
    let (n, truth) = (bench.dof(), bench.truth.clone());
    println!("{} base parameters, 1 kHz, setpoints; microseconds a push", bench.len());
    for (name, estimator, supervision) in [
        ("riv, eigen", EstimatorKind::Riv, Supervision::Eigen(EigenSettings::default())),
        ("riv, columns", EstimatorKind::Riv, Supervision::Columns(ColumnsSettings::default())),
        ("riv, off", EstimatorKind::Riv, Supervision::Off),
        ("rls, off", EstimatorKind::Rls, Supervision::Off),
    ] {
        for decimation in [10, 1] {
            let settings = Settings { estimator, supervision, decimation, ..Settings::new(n, 0.001) };
            let mut identifier = Identifier::new(bench.model.clone(), bench.base.clone(), &bench.nominal, &settings)
                .expect("the defaults are sound");
            let mut wave = Wave::new(n, 1.0);
            let mut random = Random(9);
            let mut times = Vec::new();
            for k in 0..30_000 {
                let motion = wave.at(f64::from(k) * 0.001);
                let tau: Vec<f64> = bench.torque(motion, &truth).iter().map(|t| t + 0.1 * random.normal()).collect();
                let start = Instant::now();
                identifier.push(motion.q, &tau, Some(motion));
                times.push(start.elapsed().as_nanos() as f64 * 1e-3);
            }
            times.sort_by(f64::total_cmp);
            let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
            println!(
                "{name:12} rows every {decimation:2}: p50 {:5.1}  p90 {:5.1}  p99 {:5.1}  p99.9 {:5.1}  max {:7.1}",
                at(0.5),
                at(0.9),
                at(0.99),
                at(0.999),
                at(1.0)
            );
        }
    }
}
