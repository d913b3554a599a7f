//! Supervision schemes side by side on the staged workload (paper, 3.2.1 to 3.2.4).
//!
//! The reference is an [`Oracle`] with code of its own, which decides and solves anew with every row. Errors are torques in
//! standard deviations of the filtered torque noise: global on the reference workload (is what is held still right?), local on
//! the motion of now.

pub mod bank;
pub mod oracle;
pub mod sift;
pub mod workload;

use oracle::Oracle;
use rivet_config::Robot;
use rivet_estimation::{
    ColumnsSettings, EigenSettings, Estimator, EstimatorKind, EstimatorSettings, Instrument, Prior, Supervision,
    TrackedSettings,
};
use sift::Sift;
use workload::{DECIMATION, PHASES, Rows, Workload};

/// Window, memory of noise and block of scores \[s\]: what the daemon makes of such a window.
const WINDOW: f64 = 5.0;
const MEMORY: f64 = 1.25;
const BLOCK: f64 = 0.5;
/// Time until the study looks, and from look to look \[s\].
const FIRST: f64 = 5.0;
const EVERY: f64 = 0.05;
/// Steps in which any scheme ends a decision and a solution.
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
    /// Mean time a tick over the reference's; NaN without a clock.
    pub time: f64,
    /// Ticks from one solution to the next, mean and most, where work is spread over them; else NaN.
    pub ticks: [f64; 2],
}

/// How the study is to be run.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Number of seeds.
    pub seeds: u64,
    /// Factor on all durations.
    pub length: f64,
    /// Ticks (of 1 ms) from row to row.
    pub row: usize,
    /// The tracked scheme as tried.
    pub tracked: TrackedSettings,
}

impl Default for Options {
    fn default() -> Self {
        Options { seeds: 3, length: 1.0, row: DECIMATION, tracked: TrackedSettings::default() }
    }
}

enum Scheme {
    Oracle(Box<Oracle>),
    /// `whole`: a decision and a solution with each row; else one step each tick.
    Estimator {
        estimator: Box<Estimator>,
        whole: bool,
    },
    Sift {
        sift: Sift,
        values: Vec<f64>,
    },
}

/// Ticks between solutions.
#[derive(Default)]
struct Spread {
    values: Vec<f64>,
    since: u32,
    /// Number, sum and largest.
    seen: [f64; 3],
}

impl Spread {
    /// A tick has left these `values`.
    fn tick(&mut self, values: &[f64]) {
        self.since += 1;
        if self.values != values {
            // Before the first there was no solution.
            if !self.values.is_empty() {
                let ticks = f64::from(self.since);
                self.seen = [self.seen[0] + 1.0, self.seen[1] + ticks, self.seen[2].max(ticks)];
            }
            (self.values, self.since) = (values.to_vec(), 0);
        }
    }
}

/// What a scheme has last decided: its directions, one after the other, whether they move, and the estimate along them.
#[derive(Default)]
struct Decision {
    directions: Vec<f64>,
    moves: Vec<bool>,
    coordinates: Vec<f64>,
}

impl Decision {
    fn each(&self) -> impl Iterator<Item = (&[f64], bool)> {
        self.directions.chunks_exact(self.coordinates.len().max(1)).zip(self.moves.iter().copied())
    }
}

struct Entry {
    name: &'static str,
    scheme: Scheme,
    /// Sums each phase: looks, global and local squares.
    sums: Vec<[f64; 3]>,
    same: [f64; 2],
    held: f64,
    seconds: f64,
    decision: Decision,
    spread: Spread,
}

impl Entry {
    fn values(&self) -> &[f64] {
        match &self.scheme {
            Scheme::Oracle(oracle) => &oracle.values,
            Scheme::Estimator { estimator, .. } => estimator.estimate().values,
            Scheme::Sift { values, .. } => values,
        }
    }

    /// One tick; with the first of a row the row comes in.
    fn tick(&mut self, workload: &Workload, rows: &Rows, first: bool) {
        match &mut self.scheme {
            Scheme::Oracle(oracle) if first => oracle.update(rows),
            Scheme::Estimator { estimator, whole } => {
                if first {
                    let share = vec![1.0; rows.tau.len()];
                    // Rows of a seeded workload are sound.
                    let taken = estimator.update(&rows.d, Some((&rows.z, Instrument::Setpoint)), &rows.tau, &share);
                    debug_assert!(taken.is_ok());
                }
                let steps = match (*whole, first) {
                    (true, true) => WHOLE,
                    (true, false) => 0,
                    (false, _) => 1,
                };
                (0..steps).for_each(|_| estimator.work());
            }
            Scheme::Sift { sift, values } if first => {
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
            Scheme::Oracle(_) | Scheme::Sift { .. } => {}
        }
    }

    /// Looks at what the tick has done: whether held directions moved, and when something did.
    fn watch(&mut self) {
        let view = match &self.scheme {
            Scheme::Oracle(oracle) => Some(oracle.directions()),
            Scheme::Estimator { estimator, .. } => estimator.directions(),
            Scheme::Sift { .. } => None,
        };
        if let Some(view) = view {
            let Decision { directions, moves, coordinates } = &mut self.decision;
            if !coordinates.is_empty() {
                let size = view.coordinates.iter().map(|x| x * x).sum::<f64>().sqrt().max(1.0);
                let change: Vec<f64> = view.coordinates.iter().zip(&*coordinates).map(|(x, y)| x - y).collect();
                for (v, _) in view.directions.iter().filter(|(_, moves)| !moves) {
                    let along: f64 = v.iter().zip(&change).map(|(v, x)| v * x).sum();
                    self.held = self.held.max(along.abs() / size);
                }
            }
            directions.clear();
            view.directions.iter().for_each(|(v, _)| directions.extend_from_slice(v));
            moves.clear();
            moves.extend(view.directions.iter().map(|(_, moves)| moves));
            coordinates.clear();
            coordinates.extend_from_slice(view.coordinates);
        }
        if let Scheme::Estimator { estimator, whole: false } = &self.scheme {
            self.spread.tick(estimator.estimate().values);
        }
    }
}

fn estimator(workload: &Workload, kind: EstimatorKind, supervision: Supervision) -> Estimator {
    let settings = EstimatorSettings {
        kind,
        forgetting: (-workload.row / WINDOW).exp(),
        deviation: None,
        supervision,
        prior: Prior { relative_std: 1.0 },
        noise_known: false,
        noise_memory: MEMORY / workload.row,
        outlier: 5.0,
        residual_memory: WINDOW / workload.row,
        change_row_s: None,
        correlation: workload.correlation,
        block: (BLOCK / workload.row).round() as usize,
    };
    Estimator::new(&workload.nominal, &workload.scales, &settings)
}

fn entries(workload: &Workload, options: &Options) -> Vec<Entry> {
    let with = |kind: EstimatorKind, supervision: Supervision, whole: bool| Scheme::Estimator {
        estimator: Box::new(estimator(workload, kind, supervision)),
        whole,
    };
    let sliced = |kind: EstimatorKind, supervision: Supervision| with(kind, supervision, false);
    let unit = workload.noise[0] / workload.scales.torque_noise[0];
    let scaled: Vec<f64> = workload.nominal.iter().zip(&workload.scales.column).map(|(x, c)| x * c).collect();
    let least = 0.05 * workload.scales.torque;
    let lambda = (-workload.row / WINDOW).exp();
    let std: Vec<f64> = scaled.iter().map(|x| x.abs().max(least) / unit).collect();
    let riv = EstimatorKind::Riv;
    let eigen = Supervision::Eigen(EigenSettings::default());
    let schemes = [
        ("oracle (3.2.2)", Scheme::Oracle(Box::new(Oracle::new(workload, WINDOW, MEMORY)))),
        ("eigen, whole", with(riv, eigen, true)),
        ("eigen in slices", sliced(riv, eigen)),
        ("tracked", sliced(riv, Supervision::Tracked(options.tracked))),
        ("columns (3.2.3)", sliced(riv, Supervision::Columns(ColumnsSettings::default()))),
        ("SIFt-RLS", Scheme::Sift { sift: Sift::new(scaled, &std, lambda), values: workload.nominal.clone() }),
        ("plain RLS", sliced(EstimatorKind::Rls, Supervision::Off)),
        ("plain RIV", sliced(riv, Supervision::Off)),
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
            decision: Decision::default(),
            spread: Spread::default(),
        })
        .collect()
}

/// Of the directions of `reference`: how many both decide alike, and how many there are. A direction counts as moving in
/// a scheme if more than half of its square lies in what the scheme moves.
fn agreement(reference: &Decision, other: &Decision) -> [f64; 2] {
    if other.moves.is_empty() {
        return [0.0; 2];
    }
    let mut same = 0;
    for (u, moves) in reference.each() {
        let along = |v: &[f64]| u.iter().zip(v).map(|(u, v)| u * v).sum::<f64>();
        let share: f64 = other.each().filter(|(_, moves)| *moves).map(|(v, _)| along(v).powi(2)).sum();
        same += usize::from((share > 0.5) == moves);
    }
    [same as f64, reference.moves.len() as f64]
}

/// Runs all schemes on the same rows. `clock` reads seconds from any start; without it no times are told. The reference
/// comes first in the result.
#[must_use]
pub fn study(robot: &Robot, options: &Options, clock: Option<&dyn Fn() -> f64>) -> Vec<Outcome> {
    let workload = Workload::new(robot, options.row);
    let every = (EVERY / workload.row).round() as usize;
    let mut sums: Vec<Entry> = Vec::new();
    for seed in 0..options.seeds {
        let mut entries = entries(&workload, options);
        let mut row = 0_usize;
        workload.run(robot, seed, options.length, |rows| {
            row += 1;
            for entry in &mut entries {
                for tick in 0..options.row {
                    let start = clock.map_or(0.0, |clock| clock());
                    entry.tick(&workload, rows, tick == 0);
                    entry.seconds += clock.map_or(0.0, |clock| clock()) - start;
                    entry.watch();
                }
            }
            if rows.time < FIRST * options.length.min(1.0) || !row.is_multiple_of(every) {
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
            for other in others {
                let [same, all] = agreement(&reference[0].decision, &other.decision);
                other.same[0] += same;
                other.same[1] += all;
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
            let (seen, more) = (&mut sum.spread.seen, entry.spread.seen);
            *seen = [seen[0] + more[0], seen[1] + more[1], seen[2].max(more[2])];
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
            held: if entry.decision.moves.is_empty() { f64::NAN } else { entry.held },
            time: if clock.is_some() { entry.seconds / seconds } else { f64::NAN },
            ticks: match entry.spread.seen {
                [count, sum, most] if count > 0.0 => [sum / count, most],
                _ => [f64::NAN; 2],
            },
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
    text += " eff. global | eff. local | same decisions | held moved | time | ticks |\n|---|";
    text += &"---|".repeat(PHASES.len() + 6);
    for outcome in outcomes {
        text.extend(["\n| ", outcome.name, " |"]);
        for [global, local] in &outcome.phases {
            text.extend([" ", &number(*global), " / ", &number(*local), " |"]);
        }
        let share =
            if outcome.agreement.is_nan() { "-".to_owned() } else { format!("{:.1} %", 100.0 * outcome.agreement) };
        let [global, local] = outcome.efficiency;
        let [mean, most] = outcome.ticks;
        let ticks = if mean.is_nan() { "-".to_owned() } else { format!("{mean:.1}, at most {most}") };
        for cell in [number(global), number(local), share, number(outcome.held), number(outcome.time), ticks] {
            text.extend([" ", &cell, " |"]);
        }
    }
    text + "\n"
}
