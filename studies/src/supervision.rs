//! Supervision schemes side by side on the staged workload (paper, 3.2.1 to 3.2.4).
//!
//! The reference is `eigen`, decided and solved anew with every row. Errors are torques in standard deviations of the
//! filtered torque noise: global on the reference workload (is what is held still right?), local on the motion of now.

pub mod bank;
pub mod sift;
pub mod workload;

use rivet_config::Robot;
use rivet_estimation::{
    ColumnsSettings, EigenSettings, Estimator, EstimatorKind, EstimatorSettings, Instrument, Prior, Supervision,
    TrackedSettings,
};
use sift::Sift;
use workload::{DECIMATION, PHASES, Rows, Workload};

/// Window \[s\] and time between rows \[s\].
const WINDOW: f64 = 5.0;
const ROW: f64 = 0.01;
/// Rows until the study looks, and from look to look.
const FIRST: f64 = 5.0;
const EVERY: usize = 5;
/// Periods in which the reference ends a decision and a solution.
const WHOLE: usize = 80;

/// What one scheme did.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Name of the scheme.
    pub name: &'static str,
    /// Rms torque error each phase: global, local \[noise sigma\].
    pub phases: Vec<[f64; 2]>,
    /// Mean squared error of the reference over that of this scheme: global, local.
    pub efficiency: [f64; 2],
    /// Share of the reference's directions on which both decide alike, over all looks; NaN without directions.
    pub agreement: f64,
    /// Largest movement of the estimate along a direction that was held in that step, over the estimate's size.
    pub held: f64,
    /// Time a row over the reference's; NaN without a clock.
    pub time: f64,
}

/// How the study is to be run.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Number of seeds.
    pub seeds: u64,
    /// Factor on all durations.
    pub length: f64,
    /// The tracked scheme as tried.
    pub tracked: TrackedSettings,
}

impl Default for Options {
    fn default() -> Self {
        Options { seeds: 3, length: 1.0, tracked: TrackedSettings::default() }
    }
}

enum Scheme {
    Estimator { estimator: Box<Estimator>, steps: usize },
    Sift { sift: Sift, values: Vec<f64> },
}

struct Entry {
    name: &'static str,
    scheme: Scheme,
    /// Sums each phase: looks, global and local squares.
    sums: Vec<[f64; 3]>,
    same: [f64; 2],
    held: f64,
    seconds: f64,
    before: Vec<f64>,
}

impl Entry {
    fn values(&self) -> &[f64] {
        match &self.scheme {
            Scheme::Estimator { estimator, .. } => estimator.estimate().values,
            Scheme::Sift { values, .. } => values,
        }
    }

    fn take(&mut self, workload: &Workload, rows: &Rows) {
        match &mut self.scheme {
            Scheme::Estimator { estimator, steps } => {
                let whole = vec![1.0; rows.tau.len()];
                // Rows of a seeded workload are sound.
                let taken = estimator.update(&rows.d, Some((&rows.z, Instrument::Setpoint)), &rows.tau, &whole);
                debug_assert!(taken.is_ok());
                for _ in 0..*steps {
                    estimator.work();
                }
            }
            Scheme::Sift { sift, values } => {
                let n = values.len();
                let mut phi = rows.d.clone();
                let mut tau = rows.tau.clone();
                for (j, row) in phi.chunks_exact_mut(n).enumerate() {
                    let weight = 1.0 / workload.noise[j];
                    tau[j] *= weight;
                    row.iter_mut().zip(&workload.scales.column).for_each(|(x, c)| *x *= weight / c);
                }
                sift.update(&phi, &tau);
                for ((value, x), c) in values.iter_mut().zip(&sift.x).zip(&workload.scales.column) {
                    *value = x / c;
                }
            }
        }
    }

    /// Whether held directions moved in the last step: `before` are the coordinates before it.
    fn watch(&mut self) {
        let Scheme::Estimator { estimator, .. } = &self.scheme else { return };
        let Some(view) = estimator.directions() else { return };
        if !self.before.is_empty() {
            let size = view.coordinates.iter().map(|x| x * x).sum::<f64>().sqrt().max(1.0);
            let change: Vec<f64> = view.coordinates.iter().zip(&self.before).map(|(x, y)| x - y).collect();
            for (v, _) in view.directions.iter().filter(|(_, moves)| !moves) {
                let along: f64 = v.iter().zip(&change).map(|(v, x)| v * x).sum();
                self.held = self.held.max(along.abs() / size);
            }
        }
        self.before.clear();
        self.before.extend_from_slice(view.coordinates);
    }
}

fn estimator(workload: &Workload, kind: EstimatorKind, supervision: Supervision) -> Estimator {
    let settings = EstimatorSettings {
        kind,
        forgetting: (-ROW / WINDOW).exp(),
        deviation: None,
        supervision,
        prior: Prior { relative_std: 1.0 },
        noise_known: false,
        noise_memory: 1.25 / ROW,
        outlier: 5.0,
        residual_memory: WINDOW / ROW,
        change_row_s: None,
        correlation: workload.correlation,
        block: 50,
    };
    Estimator::new(&workload.nominal, &workload.scales, &settings)
}

fn entries(workload: &Workload, options: &Options) -> Vec<Entry> {
    let estimator = |kind: EstimatorKind, supervision: Supervision, steps: usize| Scheme::Estimator {
        estimator: Box::new(estimator(workload, kind, supervision)),
        steps,
    };
    let unit = workload.noise[0] / workload.scales.torque_noise[0];
    let scaled: Vec<f64> = workload.nominal.iter().zip(&workload.scales.column).map(|(x, c)| x * c).collect();
    let least = 0.05 * workload.scales.torque;
    let lambda = (-ROW / WINDOW).exp();
    let std: Vec<f64> = scaled.iter().map(|x| x.abs().max(least) / unit).collect();
    let riv = EstimatorKind::Riv;
    let schemes = [
        ("eigen (3.2.2)", estimator(riv, Supervision::Eigen(EigenSettings::default()), WHOLE)),
        ("tracked", estimator(riv, Supervision::Tracked(options.tracked), DECIMATION)),
        ("columns (3.2.3)", estimator(riv, Supervision::Columns(ColumnsSettings::default()), WHOLE)),
        ("SIFt-RLS", Scheme::Sift { sift: Sift::new(scaled, &std, lambda), values: workload.nominal.clone() }),
        ("plain RLS", estimator(EstimatorKind::Rls, Supervision::Off, DECIMATION)),
        ("plain RIV", estimator(riv, Supervision::Off, WHOLE)),
    ];
    schemes
        .into_iter()
        .map(|(name, scheme)| Entry {
            name,
            scheme,
            sums: vec![[0.0; 3]; PHASES.len()],
            same: [0.0; 2],
            held: 0.0,
            seconds: 0.0,
            before: Vec::new(),
        })
        .collect()
}

/// Of the directions of `reference`: how many both decide alike, and how many there are. A direction counts as moving in
/// a scheme if more than half of its square lies in what the scheme moves.
fn agreement(reference: &Estimator, other: &Estimator) -> [f64; 2] {
    let (Some(reference), Some(other)) = (reference.directions(), other.directions()) else { return [0.0; 2] };
    let mut same = 0;
    for (u, moves) in &reference.directions {
        let share: f64 = other
            .directions
            .iter()
            .filter(|(_, moves)| *moves)
            .map(|(v, _)| u.iter().zip(*v).map(|(u, v)| u * v).sum::<f64>().powi(2))
            .sum();
        same += usize::from((share > 0.5) == *moves);
    }
    [same as f64, reference.directions.len() as f64]
}

/// Runs all schemes on the same rows. `clock` reads seconds from any start; without it no times are told. The reference
/// comes first in the result.
#[must_use]
pub fn study(robot: &Robot, options: &Options, clock: Option<&dyn Fn() -> f64>) -> Vec<Outcome> {
    let workload = Workload::new(robot);
    let mut sums: Vec<Entry> = Vec::new();
    for seed in 0..options.seeds {
        let mut entries = entries(&workload, options);
        let mut row = 0_usize;
        workload.run(robot, seed, options.length, |rows| {
            row += 1;
            for entry in &mut entries {
                let start = clock.map_or(0.0, |clock| clock());
                entry.take(&workload, rows);
                entry.seconds += clock.map_or(0.0, |clock| clock()) - start;
                entry.watch();
            }
            if rows.time < FIRST * options.length.min(1.0) || !row.is_multiple_of(EVERY) {
                return;
            }
            for entry in &mut entries {
                let (global, local) = {
                    let x = entry.values();
                    (workload.global_error(x, &rows.truth), workload.local_error(x, rows))
                };
                let sums = &mut entry.sums[rows.phase];
                sums[0] += 1.0;
                sums[1] += global * global;
                sums[2] += local * local;
            }
            let (reference, others) = entries.split_at_mut(1);
            if let Scheme::Estimator { estimator: reference, .. } = &reference[0].scheme {
                for other in others {
                    if let Scheme::Estimator { estimator, .. } = &other.scheme {
                        let [same, all] = agreement(reference, estimator);
                        other.same[0] += same;
                        other.same[1] += all;
                    }
                }
            }
        });
        if sums.is_empty() {
            sums = entries;
            continue;
        }
        for (sum, entry) in sums.iter_mut().zip(entries) {
            for (a, b) in sum.sums.iter_mut().zip(&entry.sums) {
                a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
            }
            sum.same.iter_mut().zip(entry.same).for_each(|(a, b)| *a += b);
            sum.held = sum.held.max(entry.held);
            sum.seconds += entry.seconds;
        }
    }
    let mean = |entry: &Entry, k: usize| {
        entry.sums.iter().map(|s| s[k]).sum::<f64>() / entry.sums.iter().map(|s| s[0]).sum::<f64>()
    };
    let reference = [mean(&sums[0], 1), mean(&sums[0], 2)];
    let seconds = sums[0].seconds;
    sums.iter()
        .map(|entry| Outcome {
            name: entry.name,
            phases: entry.sums.iter().map(|s| [(s[1] / s[0]).sqrt(), (s[2] / s[0]).sqrt()]).collect(),
            efficiency: [reference[0] / mean(entry, 1), reference[1] / mean(entry, 2)],
            agreement: if entry.same[1] > 0.0 { entry.same[0] / entry.same[1] } else { f64::NAN },
            held: if entry.before.is_empty() { f64::NAN } else { entry.held },
            time: if clock.is_some() { entry.seconds / seconds } else { f64::NAN },
        })
        .collect()
}

/// The outcomes as a table in Markdown.
#[must_use]
pub fn table(outcomes: &[Outcome]) -> String {
    let number = |x: f64| match x.abs() {
        _ if x.is_nan() => "-".to_owned(),
        s if s >= 1e4 || (s < 1e-3 && s > 0.0) => format!("{x:.1e}"),
        s if s >= 100.0 => format!("{x:.0}"),
        _ => format!("{x:.3}"),
    };
    let mut text = String::from("| scheme |");
    for (_, name, _) in PHASES {
        text.extend([" ", name, " |"]);
    }
    text += " eff. global | eff. local | same decisions | held moved | time |\n|---|";
    text += &"---|".repeat(PHASES.len() + 5);
    for outcome in outcomes {
        text.extend(["\n| ", outcome.name, " |"]);
        for [global, local] in &outcome.phases {
            text.extend([" ", &number(*global), " / ", &number(*local), " |"]);
        }
        let share =
            if outcome.agreement.is_nan() { "-".to_owned() } else { format!("{:.1} %", 100.0 * outcome.agreement) };
        let [global, local] = outcome.efficiency;
        for cell in [number(global), number(local), share, number(outcome.held), number(outcome.time)] {
            text.extend([" ", &cell, " |"]);
        }
    }
    text + "\n"
}
