//! Figures 18 and 19: a parameter, and a combination of two, that the motion does not identify.

use super::bench::{Bench, PERIOD_S, Source, Swing, Trace, largest, repeat, run};
use super::{Check, Figure, Series, Unit, dashes, line, panel};
use rivet_estimation::{
    ColumnsSettings, EigenSettings, EstimatorKind, Filtering, ParameterState, Prior, ReferenceWorkload, Scales,
    Settings, Supervision, TrackedSettings, Window,
};

/// Encoder step \[rad\].
const COUNT: f64 = 9.5874e-6;
/// Joint 2 rests until then, and the experiment ends \[s\].
const REST_S: f64 = 8.0;
const END_S: f64 = 12.0;

pub(super) fn one_parameter(repetitions: u64) -> Figure {
    let bench = Bench::direct_drive();
    let at = bench.place("j2.viscous");
    let truth = bench.truth[at];
    let swings = [Swing { amplitude: 1.2, hz: 0.8, start_s: 0.0 }, Swing { amplitude: 0.9, hz: 1.1, start_s: REST_S }];
    let window = Window::Exponential { seconds: 1.0 };
    let start: Vec<f64> = bench.truth.iter().map(|x| 1.5 * x).collect();
    // The paper's estimator, and the daemon's own settings with the same window.
    let plain = Settings {
        filtering: Filtering::Model,
        filter_hz: 10.0,
        decimation: 20,
        window,
        torque_noise: None,
        prior: Prior { relative_std: 1.0 },
        ..bench.paper(EstimatorKind::Rls)
    };
    let supervised = Settings {
        filter_hz: 10.0,
        decimation: 20,
        window,
        dead_zone: vec![0.02; 2],
        workload: ReferenceWorkload::BothWays,
        ..Settings::new(2, PERIOD_S)
    };
    let by = |supervision: Supervision| Settings { supervision, ..supervised.clone() };
    let go = |settings: &Settings| -> Vec<Trace> {
        repeat(repetitions, |seed| {
            let mut source = Source::new(&bench, &swings, COUNT, seed);
            // A servo that holds still trembles by a count.
            source.position_noise = COUNT;
            run(&bench, settings, &start, &mut source, END_S, 20)
        })
    };
    let loose = go(&plain);
    let held = go(&by(Supervision::Columns(ColumnsSettings::default())));
    let tracked = go(&by(Supervision::Tracked(TrackedSettings::default())));
    // Largest departure from `value` between two instants, relative to it.
    let departure = |traces: &[Trace], value: f64, from: f64, to: f64| {
        let between = traces.iter().flat_map(|trace| trace.t.iter().zip(&trace.values[at]));
        largest(between.filter(|(t, _)| (from..to).contains(*t)).map(|(_, v)| (v / value - 1.0).abs()))
    };
    let drawn = |title: &str, traces: &[Trace]| {
        let mut series: Vec<_> = traces.iter().map(|trace| line("estimate", 0, trace.points(at, 1.0))).collect();
        series.push(dashes("true value", 5, vec![[0.0, truth], [END_S, truth]]));
        panel(title, "time [s]", "x1 [N m s/rad]", Some([-2.0 * truth, 4.0 * truth]), series)
    };
    let function = (0..=1200).map(|k| f64::from(k) * 0.01).map(|t| [t, swings[1].at(t)[1]]).collect();
    Figure {
        number: 18,
        title: "Poor identifiability of one parameter".into(),
        caption: "Joint 2 rests for eight seconds, trembling by a count of its encoder: the function d1 of its viscous friction x1 is zero. \
                  Unsupervised least squares with a window of 1 s drifts on noise until the joint moves. All parameters start half too high. Where coordinates are held, x1 stays \
                  exactly until its joint moves; a change of the arm is noticed then, the window begins anew at the nominal values, here those of the \
                  start, and x1 settles within a second. Where directions are held, x1 stays as well: on the reference workload, which goes both ways, its \
                  friction has nothing in common with what the others find meanwhile. In the first second of motion x1 is loose in all three: it is \
                  released with the first rows that tell of it, and they tell little."
            .into(),
        panels: vec![
            panel("model function d1", "time [s]", "velocity of joint 2 [rad/s]", None, vec![line("", 1, function)]),
            drawn("unsupervised least squares", &loose),
            drawn("coordinates held (3.2.3)", &held),
            drawn("directions held (3.2.4)", &tracked),
        ],
        checks: vec![
            Check::most("coordinates held: x1 moves in the first 8 s by", departure(&held, start[at], 0.0, REST_S), 1e-9, Unit::Plain),
            Check::most(
                "coordinates held: error of x1 from 1 s after the motion begins",
                departure(&held, truth, REST_S + 1.0, END_S),
                0.05,
                Unit::Percent,
            ),
            Check::most(
                "directions held: x1 moves in the first 8 s by",
                departure(&tracked, start[at], 0.0, REST_S),
                1e-9,
                Unit::Percent,
            ),
            Check::most(
                "directions held: error of x1 from 1 s after the motion begins",
                departure(&tracked, truth, REST_S + 1.0, END_S),
                0.05,
                Unit::Percent,
            ),
            Check::least("unsupervised: x1 drifts in the first 8 s by", departure(&loose, start[at], 0.0, REST_S), 0.1, Unit::Percent),
        ],
    }
}

/// Friction changes, and the experiment of figure 19 ends \[s\].
const CHANGE_S: f64 = 12.0;
const LAST_S: f64 = 24.0;
/// By how much dry friction rises then.
const RISE: f64 = 1.15;
/// How much viscous friction is too high at the start.
const WRONG: f64 = 1.4;

/// What a scheme did with the pair in one repetition.
struct Pair {
    trace: Trace,
    /// Parameters of the pair that are held at the end.
    dropped: usize,
    /// The pair's values before the change.
    before: [f64; 2],
    /// All values at the end.
    after: Vec<f64>,
}

/// Joint 1 at one frequency, and the two parameters that it cannot tell apart.
struct Twins {
    bench: Bench,
    place: [usize; 2],
    swings: [Swing; 2],
    /// Work of each over one swing, per unit of the parameter.
    work: [f64; 2],
    start: Vec<f64>,
}

impl Twins {
    fn new() -> Twins {
        let bench = Bench::direct_drive();
        let place = ["j1.viscous", "j1.coulomb"].map(|name| bench.place(name));
        let swings = [Swing { amplitude: 1.2, hz: 0.8, start_s: 0.0 }, Swing { amplitude: 0.9, hz: 1.1, start_s: 1e9 }];
        let samples = (1.0 / (swings[0].hz * PERIOD_S)).round() as usize;
        let work = (0..samples).fold([0.0; 2], |[viscous, dry], k| {
            let [_, v, _] = swings[0].at(k as f64 * PERIOD_S);
            [viscous + v * v * PERIOD_S, dry + v.abs() * PERIOD_S]
        });
        let mut start = bench.truth.clone();
        start[place[0]] *= WRONG;
        Twins { bench, place, swings, work, start }
    }

    /// The energy model over whole swings, at the daemon's settings but for a short window.
    fn go(&self, supervision: Supervision, repetitions: u64) -> Vec<Pair> {
        let span = 1.0 / self.swings[0].hz;
        let settings = Settings {
            estimator: EstimatorKind::RlsEnergy,
            energy_span_s: span,
            filtering: Filtering::Model,
            filter_hz: 10.0,
            decimation: 10,
            window: Window::Exponential { seconds: 2.0 },
            supervision,
            dead_zone: vec![0.02; 2],
            ..Settings::new(2, PERIOD_S)
        };
        repeat(repetitions, |seed| {
            let mut identifier = self.bench.identifier(&settings, &self.start);
            let mut source = Source::new(&self.bench, &self.swings, COUNT, seed);
            let mut trace = Trace::default();
            let mut before = [0.0; 2];
            // Learning begins with whole swings.
            identifier.freeze();
            for k in 0..(LAST_S / PERIOD_S) as usize {
                source.next();
                source.push(&mut identifier);
                if source.t >= 2.0 * span {
                    identifier.resume();
                }
                if source.t < CHANGE_S {
                    before = self.place.map(|i| identifier.estimate().values[i]);
                } else {
                    source.x[self.place[1]] = RISE * self.bench.truth[self.place[1]];
                }
                if (k + 1) % 50 == 0 {
                    trace.add(source.t, &identifier);
                }
            }
            let estimate = identifier.estimate();
            let dropped = self.place.iter().filter(|i| estimate.state[**i] != ParameterState::Active).count();
            Pair { dropped, before, after: estimate.values.to_vec(), trace }
        })
    }

    fn pair_of(&self, x: &[f64]) -> [f64; 2] {
        self.place.map(|i| x[i])
    }

    /// Work of the pair over one swing, relative to the truth, before and after the change.
    fn wrong(&self, pair: &Pair) -> f64 {
        let of = |x: [f64; 2]| x[0] * self.work[0] + x[1] * self.work[1];
        let truth = self.pair_of(&self.bench.truth);
        let off = |x, truth| (of(x) / of(truth) - 1.0).abs();
        off(pair.before, truth).max(off(self.pair_of(&pair.after), [truth[0], RISE * truth[1]]))
    }

    /// Angle between the null vector of the scheme, which is what its movement was orthogonal to, and the true one.
    /// Orthogonality and angle are those of the scheme: in units of torque on the reference workload.
    fn null_angle(&self, pair: &Pair) -> f64 {
        let (bench, n) = (&self.bench, self.bench.truth.len());
        let scales = Scales::of_model(&bench.model, &bench.base, &self.start, None);
        let ends = pair.after.iter().zip(&self.start).zip(&scales.column);
        let moved: Vec<f64> = ends.map(|((after, start), column)| (after - start) * column).collect();
        // The movement as a covector: its null vector is the scheme's.
        let seen = self
            .place
            .map(|i| scales.workload[i * n..(i + 1) * n].iter().zip(&moved).map(|(w, moved)| w * moved).sum::<f64>());
        let row = [0, 1].map(|k| self.work[k] / scales.column[self.place[k]]);
        let cos = (seen[0] * row[0] + seen[1] * row[1]) / (seen[0].hypot(seen[1]) * row[0].hypot(row[1]));
        cos.abs().min(1.0).acos()
    }
}

pub(super) fn a_combination(repetitions: u64) -> Figure {
    let twins = Twins::new();
    let directions = twins.go(Supervision::Tracked(TrackedSettings::default()), repetitions);
    let oracle = twins.go(Supervision::Eigen(EigenSettings::default()), repetitions);
    let columns = twins.go(Supervision::Columns(ColumnsSettings::default()), repetitions);
    let loose = twins.go(Supervision::Off, repetitions);
    let truth = twins.pair_of(&twins.bench.truth);
    let worst = |pairs: &[Pair], of: &dyn Fn(&Pair) -> f64| largest(pairs.iter().map(of));
    let (wrong, angle) = (|pair: &Pair| twins.wrong(pair), |pair: &Pair| twins.null_angle(pair));
    let drawn = |title: &str, pairs: &[Pair]| {
        let mut series = Vec::new();
        for (colour, label) in ["x6, viscous", "x8, Coulomb"].into_iter().enumerate() {
            let traces = pairs.iter().map(|pair| pair.trace.points(twins.place[colour], truth[colour]));
            series.extend(traces.map(|points| line(label, colour, points)));
        }
        let step = vec![[0.0, 1.0], [CHANGE_S, 1.0], [CHANGE_S, RISE], [LAST_S, RISE]];
        series.push(dashes("true x6", 5, vec![[0.0, 1.0], [LAST_S, 1.0]]));
        series.push(dashes("true x8", 1, step));
        panel(title, "time [s]", "estimate / true value", Some([0.2, 1.8]), series)
    };
    // The plane of the pair: the same work is done along a line.
    let alike = |label: &str, rise: f64| {
        let total = truth[0] * twins.work[0] + rise * truth[1] * twins.work[1];
        let x8 = |x6: f64| (total - x6 * truth[0] * twins.work[0]) / (truth[1] * twins.work[1]);
        dashes(label, 5, [0.4, 1.8].map(|x6| [x6, x8(x6)]).to_vec())
    };
    let path = |label: &str, colour: usize, pairs: &[Pair]| -> Vec<Series> {
        let points = |trace: &Trace| {
            let both = trace.values[twins.place[0]].iter().zip(&trace.values[twins.place[1]]);
            both.map(|(x6, x8)| [x6 / truth[0], x8 / truth[1]]).collect()
        };
        pairs.iter().map(|pair| line(label, colour, points(&pair.trace))).collect()
    };
    let mut plane = vec![alike("same work as the truth", 1.0), alike("same work as the truth", RISE)];
    plane.extend(path("directions held", 2, &directions));
    plane.extend(path("coordinates held", 3, &columns));
    let degrees = 5.0_f64.to_radians();
    Figure {
        number: 19,
        title: "Poor identifiability of a combination of two parameters".into(),
        caption: "Joint 1 alone at one frequency, the integral model over whole swings: the work of viscous (x6) and of dry friction (x8) is \
                  proportional, so a change of one makes up for a change of the other. x6 starts 40 % too high; at 12 s dry friction rises by \
                  15 %. Where directions are held, the pair moves straight to the line of the right work and never along it; where coordinates \
                  are held (3.2.3), one of the two is dropped and the other has to make up for everything."
            .into(),
        panels: vec![
            drawn("unsupervised least squares", &loose),
            drawn("directions held", &directions),
            drawn("coordinates held", &columns),
            panel("the pair", "x6 / true value", "x8 / true value at the start", Some([0.2, 1.8]), plane),
        ],
        checks: vec![
            Check::most("directions: work of the pair is off by", worst(&directions, &wrong), 0.01, Unit::Percent),
            Check::most("directions: null vector against the true one", worst(&directions, &angle), degrees, Unit::Degrees),
            Check::most("eigenvectors of 3.2.2: work of the pair is off by", worst(&oracle, &wrong), 0.01, Unit::Percent),
            Check::most("eigenvectors of 3.2.2: null vector against the true one", worst(&oracle, &angle), degrees, Unit::Degrees),
            Check::least(
                "coordinates: parameters of the pair that are held at the end",
                columns.iter().map(|pair| pair.dropped).min().unwrap_or(0) as f64,
                1.0,
                Unit::Plain,
            ),
            Check::least("coordinates: null vector against the true one (the loss)", worst(&columns, &angle), degrees, Unit::Degrees),
        ],
    }
}
