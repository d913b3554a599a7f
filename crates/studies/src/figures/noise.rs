//! Figures 5 to 9 and 15: what encoder noise does to estimates, and three remedies.

use super::bench::{
    BOTH, Bench, PERIOD_S, POSITION_NOISE, Source, Swing, Trace, mean_and_spread, regressor_of, repeat, rms, run,
};
use super::{Check, Figure, Series, Stroke, Unit, dashes, line, panel};
use rivet_dynamics::Workspace;
use rivet_estimation::differentiate::Weights;
use rivet_estimation::filter::{Bank, Butterworth};
use rivet_estimation::{Differentiator, EstimatorKind, Filtering, Settings};

/// Encoder step of figures 5 to 15 \[rad\]: 2π over 157 000 counts.
const QUANTUM: f64 = 4e-5;
const SECONDS: f64 = 10.0;
/// Cut-off and order of the low-pass \[Hz\].
const CUTOFF_HZ: f64 = 10.0;
const ORDER: usize = 4;
/// The parameters that are drawn: joint 1's.
const DRAWN: [(&str, &str); 3] =
    [("j1.rotor_inertia", "inertia"), ("j1.viscous", "viscous"), ("j1.coulomb", "Coulomb")];

/// Six repetitions with `settings`, the reference on exact data, and what to draw of them.
struct Experiment {
    bench: Bench,
    traces: Vec<Trace>,
    reference: Trace,
}

impl Experiment {
    fn new(repetitions: u64, change: impl Fn(Settings) -> Settings + Sync, kind: EstimatorKind) -> Experiment {
        let bench = Bench::direct_drive();
        let start = bench.nothing();
        let settings = change(bench.paper(kind));
        let traces = repeat(repetitions, |seed| {
            run(&bench, &settings, &start, &mut Source::new(&bench, &BOTH, QUANTUM, seed), SECONDS, 20)
        });
        // The reference sees the motion and the torque exactly; central differences are then all that errs.
        let exact = bench.paper(EstimatorKind::Riv);
        let reference = run(&bench, &exact, &start, &mut Source::new(&bench, &BOTH, 0.0, 0), SECONDS, 20);
        Experiment { bench, traces, reference }
    }

    /// Mean error and spread of a drawn parameter at the end, relative to the truth.
    fn end(&self, name: &str) -> (f64, f64) {
        let at = self.bench.place(name);
        let values: Vec<f64> = self.traces.iter().map(|t| t.last(at) / self.bench.truth[at]).collect();
        let (mean, spread) = mean_and_spread(&values);
        (mean - 1.0, spread)
    }

    fn series(&self, traces: &[Trace]) -> Vec<Series> {
        let mut out = Vec::new();
        for (colour, (name, label)) in DRAWN.iter().enumerate() {
            let at = self.bench.place(name);
            out.extend(traces.iter().map(|t| line(label, colour, t.points(at, self.bench.truth[at]))));
        }
        out.push(dashes("true value", 5, vec![[0.0, 1.0], [SECONDS, 1.0]]));
        out
    }

    fn figure(&self, number: u32, left: &str, title: &str, caption: &str, checks: Vec<Check>) -> Figure {
        let (x, y, range) = ("time [s]", "estimate / true value", Some([-0.5, 2.5]));
        let reference = std::slice::from_ref(&self.reference);
        Figure {
            number,
            title: title.into(),
            caption: caption.into(),
            panels: vec![
                panel(left, x, y, range, self.series(&self.traces)),
                panel("reference: exact data", x, y, range, self.series(reference)),
            ],
            checks,
        }
    }

    /// Mean departure of the repetitions from their own end in the first second, relative to the truth.
    fn wobble(&self, name: &str) -> f64 {
        let at = self.bench.place(name);
        rms(self.traces.iter().flat_map(|trace| {
            let early = trace.t.iter().zip(&trace.values[at]).filter(|(t, _)| (0.1..1.0).contains(*t));
            early.map(move |(_, v)| (v - trace.last(at)) / self.bench.truth[at])
        }))
    }
}

/// Position, true acceleration and its numerical derivative of joint 1.
struct Signals {
    t: Vec<f64>,
    position: Vec<f64>,
    position_error: Vec<f64>,
    truth: Vec<f64>,
    derived: Vec<f64>,
}

fn signals() -> Signals {
    let bench = Bench::direct_drive();
    let mut source = Source::new(&bench, &BOTH, QUANTUM, 1);
    let weights = Weights::new(Differentiator::Central, PERIOD_S);
    let mut out = Signals { t: vec![], position: vec![], position_error: vec![], truth: vec![], derived: vec![] };
    let mut window = [0.0; 3];
    let mut before = 0.0;
    for k in 0..3000 {
        source.next();
        window.rotate_left(1);
        window[2] = source.q[0];
        if k >= 2 {
            out.t.push(source.t - PERIOD_S);
            out.position.push(window[1]);
            out.truth.push(before);
            out.derived.push(weights.acceleration.iter().zip(&window).map(|(w, q)| w * q).sum());
        }
        out.position_error.push(source.q[0] - source.actual[0][0]);
        before = source.actual[2][0];
    }
    out
}

fn points(t: &[f64], y: &[f64]) -> Vec<[f64; 2]> {
    t.iter().zip(y).map(|(t, y)| [*t, *y]).collect()
}

pub(super) fn acceleration() -> Figure {
    let s = signals();
    let noise = rms(s.truth.iter().zip(&s.derived).map(|(a, b)| b - a)) / rms(s.truth.iter().copied());
    let clean = rms(s.position_error.iter().copied()) / rms(s.position.iter().copied());
    Figure {
        number: 5,
        title: "Acceleration derived numerically from measured positions".into(),
        caption: "Joint 1 at 0.8 Hz, 1 ms, an encoder of 40 µrad: the positions look clean, their second difference does not.".into(),
        panels: vec![
            panel("measured position", "time [s]", "position [rad]", None, vec![line("", 0, points(&s.t, &s.position))]),
            panel(
                "acceleration",
                "time [s]",
                "acceleration [rad/s²]",
                None,
                vec![line("second difference", 0, points(&s.t, &s.derived)), line("true", 1, points(&s.t, &s.truth))],
            ),
        ],
        checks: vec![
            Check::least("acceleration: noise over signal (rms)", noise, 1.0, Unit::Plain),
            Check::most("position: noise over signal (rms)", clean, 1e-3, Unit::Plain),
        ],
    }
}

/// Bias of the inertia of one link when the noise of its acceleration is `r` times the signal (rms).
fn one_regressor(r: f64) -> f64 {
    let bench = Bench::geared_joint();
    let swing = [Swing { amplitude: 1.2, hz: 0.8, start_s: 0.0 }];
    let w = std::f64::consts::TAU * swing[0].hz;
    // White noise of the rounding and before it, through weights of 1, -2, 1 over T^2.
    let sigma = r * swing[0].amplitude * w * w / 2.0_f64.sqrt() / 6.0_f64.sqrt() * PERIOD_S * PERIOD_S;
    let quantum = (12.0 * (sigma * sigma - POSITION_NOISE * POSITION_NOISE)).sqrt();
    let (settings, start) = (bench.paper(EstimatorKind::Rls), bench.nothing());
    let trace = run(&bench, &settings, &start, &mut Source::new(&bench, &swing, quantum, 3), SECONDS, 100);
    let at = bench.place("j1.rotor_inertia");
    trace.last(at) / bench.truth[at] - 1.0
}

/// What eq. 13 says of the inertia of joint 1: `x = (S + N)⁻¹S·x₀` with the information S of the true rows and N of
/// their noise, each joint's row weighted as the estimator did; by Gauss elimination on the sums of one repetition.
fn predicted(experiment: &Experiment) -> f64 {
    let bench = &experiment.bench;
    let (n, dof) = (bench.truth.len(), bench.dof());
    let weight: Vec<f64> = experiment.traces[0].torque_noise.iter().map(|s| 1.0 / (s * s)).collect();
    let mut source = Source::new(bench, &BOTH, QUANTUM, 0);
    let weights = Weights::new(Differentiator::Central, PERIOD_S);
    let mut ws = Workspace::new(&bench.model.arm);
    let (mut full, mut noisy) = (vec![0.0; dof * bench.model.len()], vec![0.0; dof * n]);
    let mut line: Vec<[f64; 3]> = vec![[0.0; 3]; dof];
    let (mut left, mut right) = (vec![0.0; n * n], vec![0.0; n]);
    let mut motion: [Vec<f64>; 3] = std::array::from_fn(|_| vec![0.0; dof]);
    let mut before = vec![0.0; dof * n];
    for k in 0..(SECONDS / PERIOD_S) as usize {
        source.next();
        for (window, q) in line.iter_mut().zip(&source.q) {
            window.rotate_left(1);
            window[2] = *q;
        }
        if k >= 2 {
            for (j, window) in line.iter().enumerate() {
                let parts = [&weights.position, &weights.velocity, &weights.acceleration];
                for (out, w) in motion.iter_mut().zip(parts) {
                    out[j] = w.iter().zip(window).map(|(w, q)| w * q).sum();
                }
            }
            regressor_of(bench, &mut ws, &motion, &mut full, &mut noisy);
            for (j, (d, d0)) in noisy.chunks_exact(n).zip(before.chunks_exact(n)).enumerate() {
                let torque: f64 = d0.iter().zip(&bench.truth).map(|(d, x)| d * x).sum();
                for a in 0..n {
                    right[a] += weight[j] * d0[a] * torque;
                    for b in 0..n {
                        left[a * n + b] += weight[j] * (d0[a] * d0[b] + (d[a] - d0[a]) * (d[b] - d0[b]));
                    }
                }
            }
        }
        before.copy_from_slice(source.true_rows());
    }
    let x = solve(left, right);
    let at = bench.place("j1.rotor_inertia");
    x[at] / bench.truth[at] - 1.0
}

/// Solves a symmetric positive definite system.
fn solve(mut a: Vec<f64>, mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    for k in 0..n {
        for i in k + 1..n {
            let factor = a[i * n + k] / a[k * n + k];
            for j in k..n {
                a[i * n + j] -= factor * a[k * n + j];
            }
            b[i] -= factor * b[k];
        }
    }
    for k in (0..n).rev() {
        let rest: f64 = (k + 1..n).map(|j| a[k * n + j] * b[j]).sum();
        b[k] = (b[k] - rest) / a[k * n + k];
    }
    b
}

pub(super) fn least_squares(repetitions: u64) -> Figure {
    let experiment = Experiment::new(repetitions, |s| s, EstimatorKind::Rls);
    let (bias, spread) = experiment.end("j1.rotor_inertia");
    let mut checks = vec![
        Check::near("two links: bias of the inertia against eq. 13", bias, predicted(&experiment), 0.06, Unit::Percent),
        Check::most("two links: bias of the inertia", bias, -0.5, Unit::Percent),
        Check::most("two links: spread of the inertia between repetitions", spread, 0.01, Unit::Percent),
    ];
    let closed_form = |r: f64| -r * r / (1.0 + r * r);
    let mut dots = Vec::new();
    for r in [0.23, 0.5, 1.11, 2.0, 5.0] {
        let bias = one_regressor(r);
        let what = format!("one link, noise over signal r = {r:.2}: bias against −r²/(1 + r²)");
        checks.push(Check::near(what, bias, closed_form(r), 0.06, Unit::Percent));
        dots.push([r, 100.0 * bias]);
    }
    let curve = (0..=100).map(|k| 0.055 * f64::from(k)).map(|r| [r, 100.0 * closed_form(r)]).collect();
    let law = vec![
        line("−r²/(1 + r²)", 5, curve),
        Series { label: "least squares".into(), colour: 0, stroke: Stroke::Dots, points: dots },
    ];
    let mut figure = experiment.figure(
        6,
        "RLS (UD filter), six repetitions",
        "Convergence of least-squares estimates",
        "Joint 1 of the two-link arm. Least squares converges steadily and reproducibly, to a wrong inertia: it takes measurement noise \
         for information. Last, one link: the bias by noise over signal.",
        checks,
    );
    figure.panels.push(panel(
        "bias by noise",
        "noise over signal of the acceleration, r",
        "bias of the inertia [%]",
        None,
        law,
    ));
    figure
}

pub(super) fn instruments(repetitions: u64) -> Figure {
    let experiment = Experiment::new(repetitions, |s| s, EstimatorKind::Riv);
    let least_squares = Experiment::new(repetitions, |s| s, EstimatorKind::Rls);
    let name = "j1.rotor_inertia";
    let (bias, _) = experiment.end(name);
    let checks = vec![
        Check::most("bias of the inertia, mean of six", bias.abs(), 0.01, Unit::Percent),
        Check::least(
            "rms departure from the end in 0.1..1 s, over that of RLS",
            experiment.wobble(name) / least_squares.wobble(name),
            1.0,
            Unit::Plain,
        ),
    ];
    experiment.figure(
        7,
        "RIV, six repetitions",
        "The recursive instrumental-variable method",
        "The same data as figure 6, instruments from the desired motion: the noise disturbs the estimates, as noise should, and the bias \
         is gone.",
        checks,
    )
}

pub(super) fn filtered_acceleration() -> Figure {
    let s = signals();
    let rate = 1.0 / PERIOD_S;
    let filter = Butterworth::low_pass(ORDER, CUTOFF_HZ, rate);
    let mut bank = Bank::new(filter, 2);
    let (mut filtered, mut expected) = (Vec::new(), Vec::new());
    for (noisy, truth) in s.derived.iter().zip(&s.truth) {
        let mut x = [*noisy, *truth];
        bank.step(&mut x);
        filtered.push(x[0]);
        expected.push(x[1]);
    }
    // After the transient of the first sample.
    let settled = 500..filtered.len();
    let noise = rms(settled.clone().map(|k| filtered[k] - expected[k])) / rms(settled.clone().map(|k| expected[k]));
    let unlike = |lag: usize| rms(settled.clone().map(|k| filtered[k] - s.truth[k - lag]));
    let lag = (0..200).min_by(|a, b| unlike(*a).total_cmp(&unlike(*b))).unwrap_or(0);
    Figure {
        number: 8,
        title: "Unfiltered and filtered acceleration".into(),
        caption: "The signal of figure 5 through a Butterworth low-pass of 4th order at 10 Hz: clean, and late.".into(),
        panels: vec![
            panel("unfiltered", "time [s]", "acceleration [rad/s²]", None, vec![line("", 0, points(&s.t, &s.derived))]),
            panel(
                "filtered",
                "time [s]",
                "acceleration [rad/s²]",
                None,
                vec![dashes("true", 1, points(&s.t, &s.truth)), line("filtered", 0, points(&s.t, &filtered))],
            ),
        ],
        checks: vec![
            Check::most("noise over signal after the filter (rms)", noise, 0.05, Unit::Plain),
            Check::least("delay", lag as f64 * PERIOD_S, 0.02, Unit::Milliseconds),
        ],
    }
}

fn model_filter(settings: Settings) -> Settings {
    Settings { filtering: Filtering::Model, filter_hz: CUTOFF_HZ, filter_order: ORDER, ..settings }
}

pub(super) fn filtered(repetitions: u64) -> Figure {
    let rls = Experiment::new(repetitions, model_filter, EstimatorKind::Rls);
    let riv = Experiment::new(repetitions, model_filter, EstimatorKind::Riv);
    let mut checks = Vec::new();
    for (experiment, kind) in [(&rls, "RLS"), (&riv, "RIV")] {
        for ((name, label), limit) in DRAWN.iter().zip([0.01, 0.02, 0.02]) {
            let (bias, _) = experiment.end(name);
            checks.push(Check::most(format!("{kind}: bias of {label}, mean of six"), bias.abs(), limit, Unit::Percent));
        }
    }
    let mut figure = rls.figure(
        9,
        "RLS with model filter",
        "Estimation with filtered acceleration",
        "The data of figure 6 with a low-pass of 10 Hz over every column of the model and over the torque.",
        checks,
    );
    let middle =
        panel("RIV with model filter", "time [s]", "estimate / true value", Some([-0.5, 2.5]), riv.series(&riv.traces));
    figure.panels.insert(1, middle);
    figure
}

pub(super) fn energy(repetitions: u64) -> Figure {
    let experiment = Experiment::new(repetitions, |s| s, EstimatorKind::RlsEnergy);
    let least_squares = Experiment::new(repetitions, |s| s, EstimatorKind::Rls);
    let filtered = Experiment::new(repetitions, model_filter, EstimatorKind::Rls);
    let (bias, _) = experiment.end("j1.rotor_inertia");
    let (differential, _) = least_squares.end("j1.rotor_inertia");
    let spread = |e: &Experiment| e.end("j1.viscous").1.max(e.end("j1.coulomb").1);
    let checks = vec![
        Check::most("bias of the inertia, mean of six", bias.abs(), 0.01, Unit::Percent),
        Check::most("bias of the inertia over that of figure 6", (bias / differential).abs(), 0.1, Unit::Plain),
        Check::least(
            "spread of friction over that of figure 9",
            spread(&experiment) / spread(&filtered),
            1.0,
            Unit::Plain,
        ),
    ];
    experiment.figure(
        15,
        "RLS on the integral model",
        "Estimation based on the integral model",
        "The data of figure 6: work and energy since the start instead of torques, no filter. No acceleration is needed, and the bias of \
         figure 6 does not appear; friction is less well known.",
        checks,
    )
}
