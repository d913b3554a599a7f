//! A bank of models beside the full model on the staged workload (paper, 3.2.4, third proposal).

use super::workload::{DECIMATION, PHASES, Rows, Workload};
use super::{WHOLE, WINDOW, estimator};
use rivet_config::Robot;
use rivet_estimation::bank::{Bank, BankSettings, Member};
use rivet_estimation::{EigenSettings, Estimator, EstimatorKind, Instrument, Scales, Supervision};

/// Rows from solution to solution, and from look to look.
const SOLVE: usize = 5;
const LOOK: usize = 25;

/// How the study is to be run.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Number of seeds, at least 2.
    pub seeds: u64,
    /// The first of them.
    pub first: u64,
    /// Factor on all durations.
    pub length: f64,
    /// Window of the evidence \[s\].
    pub memory_s: f64,
    /// As [`BankSettings::margin`].
    pub margin: f64,
    /// Time from one change of the member to the next, at least \[s\].
    pub dwell_s: f64,
}

impl Default for Options {
    fn default() -> Self {
        Options { seeds: 4, first: 0, length: 1.0, memory_s: 3.0, margin: 0.1, dwell_s: 1.5 }
    }
}

/// What one scheme did.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Name of the scheme.
    pub name: &'static str,
    /// Variance over the seeds of the torque error on the reference workload, and its mean square, each phase
    /// \[torque-noise sigma²\].
    pub phases: Vec<[f64; 2]>,
    /// The same over all looks.
    pub all: [f64; 2],
    /// Variance of each seed about the mean of all, over all looks: their mean is `all[0]`.
    pub seeds: Vec<f64>,
    /// Changes of the chosen member a second.
    pub switches: f64,
    /// The shortest time between two of them \[s\].
    pub soonest: f64,
    /// Share of the looks at which each member was chosen, by name.
    pub chosen: Vec<(String, f64)>,
}

enum Scheme {
    Bank(Box<Bank>),
    Estimator(Box<Estimator>),
}

impl Scheme {
    fn take(&mut self, rows: &Rows, row: usize) {
        match self {
            Scheme::Bank(bank) => {
                let taken = bank.update(&rows.d, &rows.z, &rows.tau);
                debug_assert!(taken, "rows of a seeded workload are sound");
                if row.is_multiple_of(SOLVE) {
                    bank.solve();
                }
            }
            Scheme::Estimator(estimator) => {
                let whole = vec![1.0; rows.tau.len()];
                let taken = estimator.update(&rows.d, Some((&rows.z, Instrument::Setpoint)), &rows.tau, &whole);
                debug_assert!(taken.is_ok(), "rows of a seeded workload are sound");
                (0..WHOLE).for_each(|_| estimator.work());
            }
        }
    }

    fn values(&self) -> &[f64] {
        match self {
            Scheme::Bank(bank) => bank.values(),
            Scheme::Estimator(estimator) => estimator.estimate().values,
        }
    }
}

fn schemes(robot: &Robot, workload: &Workload, options: &Options) -> Vec<(&'static str, Scheme)> {
    let n = workload.nominal.len();
    let unit = workload.noise[0] / workload.scales.torque_noise[0];
    let scales = Scales {
        torque_noise: workload.noise.clone(),
        column: workload.scales.column.iter().map(|c| c / unit).collect(),
        ..workload.scales.clone()
    };
    let mut members: Vec<Member> = (0..robot.dof()).map(|j| Member::drive(&robot.model, &robot.base, j)).collect();
    members.push(Member::gravity(&robot.model, &robot.base, &scales));
    members.push(Member::full(n));
    let full = || vec![Member::full(n)];
    let bank = |members: Vec<Member>, tolerance: f64| {
        let settings = BankSettings {
            forgetting: (-workload.row / WINDOW).exp(),
            correlation: workload.correlation.factor,
            tolerance,
            memory: (options.memory_s / workload.row) as u32,
            margin: options.margin,
            dwell: (options.dwell_s / workload.row).ceil() as u32,
        };
        Scheme::Bank(Box::new(Bank::new(&workload.nominal, &scales, members, settings)))
    };
    let supervised = EigenSettings::default().tolerance;
    let reference = estimator(workload, EstimatorKind::Riv, Supervision::Eigen(EigenSettings::default()));
    vec![
        ("full", bank(full(), f64::INFINITY)),
        ("bank", bank(members.clone(), f64::INFINITY)),
        ("full, supervised", bank(full(), supervised)),
        ("bank, supervised", bank(members, supervised)),
        ("eigen (3.2.2)", Scheme::Estimator(Box::new(reference))),
    ]
}

/// What one scheme's parameters were at the looks of one seed.
struct Record {
    values: Vec<Vec<f64>>,
    switches: u64,
    /// Time of the last change, and the shortest time between two.
    changed: f64,
    soonest: f64,
    chosen: Vec<(String, f64)>,
}

impl Record {
    fn new() -> Record {
        Record { values: Vec::new(), switches: 0, changed: f64::NAN, soonest: f64::INFINITY, chosen: Vec::new() }
    }

    fn watch(&mut self, bank: &Bank, time: f64) {
        if bank.switches() > self.switches {
            // The minimum with NaN, before the first, is the other one.
            self.soonest = self.soonest.min(time - self.changed);
            (self.switches, self.changed) = (bank.switches(), time);
        }
    }
}

/// Runs every scheme on the same rows, seed by seed; they differ in motion and noise, not in the true parameters.
#[must_use]
pub fn study(robot: &Robot, options: &Options) -> Vec<Outcome> {
    let workload = Workload::new(robot, DECIMATION);
    // Phase and true parameters of each look.
    let mut looks: Vec<(usize, Vec<f64>)> = Vec::new();
    let mut records: Vec<(&'static str, Vec<Record>)> = Vec::new();
    let mut seconds = 0.0;
    for seed in options.first..options.first + options.seeds {
        let mut running: Vec<_> = schemes(robot, &workload, options)
            .into_iter()
            .map(|(name, scheme)| (name, scheme, Record::new()))
            .collect();
        let mut row = 0;
        looks.clear();
        workload.run(robot, seed, options.length, |rows| {
            row += 1;
            let look = row % LOOK == 0 && rows.time >= super::FIRST * options.length.min(1.0);
            if look {
                looks.push((rows.phase, rows.truth.clone()));
            }
            for (_, scheme, record) in &mut running {
                scheme.take(rows, row);
                if let Scheme::Bank(bank) = &*scheme {
                    record.watch(bank, rows.time);
                }
                if !look {
                    continue;
                }
                record.values.push(scheme.values().to_vec());
                if let Scheme::Bank(bank) = scheme {
                    let name = &bank.chosen().1.name;
                    match record.chosen.iter_mut().find(|(other, _)| other == name) {
                        Some((_, count)) => *count += 1.0,
                        None => record.chosen.push((name.clone(), 1.0)),
                    }
                }
            }
        });
        seconds += row as f64 * workload.row;
        for (k, (name, _, record)) in running.into_iter().enumerate() {
            match records.get_mut(k) {
                Some((_, seeds)) => seeds.push(record),
                None => records.push((name, vec![record])),
            }
        }
    }
    records.into_iter().map(|(name, seeds)| outcome(name, &workload, &looks, &seeds, seconds)).collect()
}

fn outcome(
    name: &'static str,
    workload: &Workload,
    looks: &[(usize, Vec<f64>)],
    seeds: &[Record],
    seconds: f64,
) -> Outcome {
    let count = seeds.len() as f64;
    let mut phases = vec![[0.0; 3]; PHASES.len()];
    let mut own = vec![0.0; seeds.len()];
    for (at, (phase, truth)) in looks.iter().enumerate() {
        let mean: Vec<f64> =
            (0..truth.len()).map(|i| seeds.iter().map(|seed| seed.values[at][i]).sum::<f64>() / count).collect();
        phases[*phase][2] += 1.0;
        for (own, seed) in own.iter_mut().zip(seeds) {
            // Bessel's correction: the mean is made from the same seeds.
            let spread = workload.global_error(&seed.values[at], &mean).powi(2) * count / (count - 1.0);
            *own += spread / looks.len() as f64;
            phases[*phase][0] += spread / count;
            phases[*phase][1] += workload.global_error(&seed.values[at], truth).powi(2) / count;
        }
    }
    let total = |k: usize| phases.iter().map(|phase| phase[k]).sum::<f64>() / looks.len() as f64;
    let mut chosen: Vec<(String, f64)> = Vec::new();
    for (name, share) in seeds.iter().flat_map(|seed| &seed.chosen) {
        let share = share / (count * looks.len() as f64);
        match chosen.iter_mut().find(|(other, _)| other == name) {
            Some((_, sum)) => *sum += share,
            None => chosen.push((name.clone(), share)),
        }
    }
    Outcome {
        name,
        all: [total(0), total(1)],
        phases: phases.iter().map(|[spread, square, looks]| [spread / looks, square / looks]).collect(),
        seeds: own,
        soonest: seeds.iter().map(|seed| seed.soonest).fold(f64::INFINITY, f64::min),
        switches: seeds.iter().map(|seed| seed.switches as f64).sum::<f64>() / seconds,
        chosen,
    }
}

/// The outcomes as a table in Markdown: standard deviation over the seeds / rms error.
#[must_use]
pub fn table(outcomes: &[Outcome]) -> String {
    let number = |x: f64| if x >= 1e4 { format!("{x:.1e}") } else { format!("{x:.3}") };
    let cell = |[spread, square]: &[f64; 2]| format!(" {} / {} |", number(spread.sqrt()), number(square.sqrt()));
    let mut text = String::from("| scheme |");
    for (_, name, _) in PHASES {
        text.extend([" ", name, " |"]);
    }
    text += " all | switches a second | chosen |\n|---|";
    text += &"---|".repeat(PHASES.len() + 3);
    for outcome in outcomes {
        text.extend(["\n| ", outcome.name, " |"]);
        outcome.phases.iter().chain([&outcome.all]).for_each(|pair| text += &cell(pair));
        let chosen: Vec<String> =
            outcome.chosen.iter().map(|(name, share)| format!("{name} {:.0} %", 100.0 * share)).collect();
        text.extend([&format!(" {:.3} | ", outcome.switches), &chosen.join(", "), " |"]);
    }
    text + "\n"
}
