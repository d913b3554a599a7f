//! Figures 3 and 16: what changes over minutes, a joint's temperature and a slow disturbance.

use super::bench::{Bench, PERIOD_S, Source, Swing, Trace, repeat, rms};
use super::{Check, Figure, Series, Stroke, Unit, dashes, line, panel};
use rivet_estimation::{EstimatorKind, Filtering, Motion, Settings, Window};
use std::f64::consts::TAU;

/// Ambient temperature \[degC\], thermal resistance \[K/W\] and time constant \[s\] of the joint.
const AMBIENT: f64 = 25.0;
const RESISTANCE: f64 = 0.58;
const TIME_CONSTANT: f64 = 600.0;
/// Friction over that at ambient temperature: viscous as e^-dT/50 K, Coulomb as 1 - dT/120 K.
const VISCOUS_K: f64 = 50.0;
const COULOMB_K: f64 = 120.0;
/// Observation window of the daemon \[s\].
const WINDOW_S: f64 = 10.0;
/// Twenty minutes at work, then slow, then at work again, half an hour more \[s\].
const SLOW_FROM: f64 = 1200.0;
const SLOW_UNTIL: f64 = 2400.0;
const END: f64 = 3000.0;
/// Speed of slow operation over that at work.
const SLOW: f64 = 0.5;
/// Amplitude \[rad\] and frequency at work \[Hz\].
const AMPLITUDE: f64 = 0.8;
const WORK_HZ: f64 = 0.5;
/// Temperatures whose friction is drawn \[degC\].
const DRAWN: [f64; 4] = [28.0, 38.0, 48.0, 58.0];

/// Factors on viscous and Coulomb friction at `temperature`.
fn friction(temperature: f64) -> [f64; 2] {
    let warmer = temperature - AMBIENT;
    [(-warmer / VISCOUS_K).exp(), 1.0 - warmer / COULOMB_K]
}

/// Speed over that at work, which swells and falls by half every seven seconds, and its derivative \[1/s\].
fn pace(t: f64) -> [f64; 2] {
    let w = TAU / 7.0;
    let [level, rise] =
        [(SLOW_FROM, SLOW - 1.0), (SLOW_UNTIL, 1.0 - SLOW)].iter().fold([1.0, 0.0], |[level, rise], (at, step)| {
            // From one level to the other in four seconds, without a jump of the acceleration.
            let part = ((t - at) / 4.0).clamp(0.0, 1.0);
            [level + step * part * part * (3.0 - 2.0 * part), rise + step * 6.0 * part * (1.0 - part) / 4.0]
        });
    let swell = 1.0 + 0.5 * (w * t).sin();
    [level * swell, rise * swell + level * 0.5 * w * (w * t).cos()]
}

/// A joint that its own friction heats, second by second. Friction is relative to the cold joint's.
#[derive(Default)]
struct Heated {
    t: Vec<f64>,
    temperature: Vec<f64>,
    estimated: Vec<[f64; 2]>,
    truth: Vec<[f64; 2]>,
    /// What an exponential window can know of a parameter that moves: its mean over the window.
    lagged: Vec<[f64; 2]>,
}

fn heat(bench: &Bench, place: [usize; 2], seed: u64) -> Heated {
    let cold = place.map(|i| bench.truth[i]);
    let settings = Settings { window: Window::Exponential { seconds: WINDOW_S }, ..Settings::new(1, PERIOD_S) };
    let mut identifier = bench.identifier(&settings, &bench.truth);
    let still = [Swing { amplitude: 0.0, hz: 1.0, start_s: 0.0 }];
    let mut source = Source::new(bench, &still, 3.6523e-6, seed);
    let (mut temperature, mut phase, mut lagged) = (AMBIENT, 0.0_f64, [1.0; 2]);
    let mut out = Heated::default();
    for k in 0..(END / PERIOD_S) as usize {
        let t = k as f64 * PERIOD_S;
        let [speed, slope] = pace(t);
        let (rate, rise) = (TAU * WORK_HZ * speed, TAU * WORK_HZ * slope);
        phase = (phase + rate * PERIOD_S) % TAU;
        let (sin, cos) = phase.sin_cos();
        let state = [-cos, rate * sin, rate * rate * cos + rise * sin].map(|s| AMPLITUDE * s);
        let truth = friction(temperature);
        for ((&i, cold), factor) in place.iter().zip(cold).zip(truth) {
            source.x[i] = cold * factor;
        }
        for (part, s) in source.actual.iter_mut().zip(state) {
            part[0] = s;
        }
        source.measure();
        let power = state[1].abs() * (source.x[place[0]] * state[1].abs() + source.x[place[1]]);
        temperature += PERIOD_S / TIME_CONSTANT * (RESISTANCE * power - (temperature - AMBIENT));
        for (lagged, factor) in lagged.iter_mut().zip(truth) {
            *lagged += (factor - *lagged) * PERIOD_S / WINDOW_S;
        }
        identifier.push(&source.q, &source.tau, Some(Motion { q: &state[..1], qd: &state[1..2], qdd: &state[2..] }));
        if (k + 1) % 1000 == 0 && t > 3.0 * WINDOW_S {
            let x = identifier.estimate().values;
            out.t.push(t);
            out.temperature.push(temperature);
            out.estimated.push([x[place[0]] / cold[0], x[place[1]] / cold[1]]);
            out.truth.push(truth);
            out.lagged.push(lagged);
        }
    }
    out
}

impl Heated {
    /// Over time, one a ten seconds.
    fn over_time(&self, value: impl Fn(usize) -> f64) -> Vec<[f64; 2]> {
        (0..self.t.len()).step_by(10).map(|k| [self.t[k] / 60.0, value(k)]).collect()
    }

    /// What was estimated when the joint first had about this temperature.
    fn estimated_at(&self, temperature: f64) -> Option<[f64; 2]> {
        let at = self.temperature.iter().position(|t| *t >= temperature)?;
        Some(self.estimated[at])
    }

    /// Friction torque that the cold model and the estimate are wrong by at the rms speed of work, where it is hot.
    fn wrong_when_hot(&self, cold: [f64; 2]) -> [f64; 2] {
        let v = AMPLITUDE * TAU * WORK_HZ / 2.0_f64.sqrt();
        let torque = |[viscous, coulomb]: [f64; 2]| cold[0] * viscous * v + cold[1] * coulomb;
        let hot = || (0..self.t.len()).filter(|k| self.temperature[*k] > 50.0);
        let wrong = |model: &dyn Fn(usize) -> [f64; 2]| rms(hot().map(|k| torque(model(k)) - torque(self.truth[k])));
        [wrong(&|_| [1.0; 2]), wrong(&|k| self.estimated[k])]
    }
}

pub(super) fn temperature(repetitions: u64) -> Figure {
    let bench = Bench::geared_joint();
    let place = ["j1.viscous", "j1.coulomb"].map(|name| bench.place(name));
    let cold = place.map(|i| bench.truth[i]);
    let runs = repeat(repetitions, |seed| heat(&bench, place, seed));
    let speeds: Vec<f64> = (0..=50).map(|i| 0.05 * f64::from(i)).collect();
    let mut maps: Vec<Series> = Vec::new();
    for (colour, at) in DRAWN.into_iter().enumerate() {
        let torque = |[viscous, coulomb]: [f64; 2], v: f64| [v, cold[1] * coulomb + cold[0] * viscous * v];
        let truth = speeds.iter().map(|v| torque(friction(at), *v)).collect();
        maps.push(line(&format!("{at:.0} °C"), colour, truth));
        for seen in runs.iter().filter_map(|run| run.estimated_at(at)) {
            let points = speeds.iter().skip(3).step_by(6).map(|v| torque(seen, *v)).collect();
            maps.push(Series { label: "estimated".into(), colour, stroke: Stroke::Dots, points });
        }
    }
    let mut over_time = Vec::new();
    for (k, label) in ["viscous", "Coulomb"].into_iter().enumerate() {
        let estimates = runs.iter().map(|run| line(label, k, run.over_time(|i| run.estimated[i][k])));
        over_time.extend(estimates);
        over_time.push(dashes("true", 5, runs[0].over_time(|i| runs[0].truth[i][k])));
    }
    let hottest = runs.iter().flat_map(|run| &run.temperature).fold(0.0_f64, |m, t| m.max(*t));
    let falls = 1.0 - friction(60.0)[0];
    let ordered = runs.iter().all(|run| {
        let viscous = DRAWN.map(|at| run.estimated_at(at).map_or(f64::NAN, |seen| seen[0]));
        viscous.windows(2).all(|pair| pair[0] > pair[1])
    });
    let worst = |which: usize| {
        let errors = runs.iter().flat_map(|run| run.estimated.iter().zip(&run.lagged));
        errors.fold(0.0_f64, |m, (x, lagged)| m.max((x[which] / lagged[which] - 1.0).abs()))
    };
    let wrong: Vec<f64> = runs.iter().map(|run| run.wrong_when_hot(cold)).map(|[model, live]| model / live).collect();
    Figure {
        number: 3,
        title: "Friction against temperature and velocity".into(),
        caption: "Joint 1 of the geared Manutec r3, which its own friction heats (time constant ten minutes): twenty minutes at work, twenty \
                  slow, ten at work. Estimates of the daemon's default settings (a window of 10 s), no temperature sensor. Torque at the joint \
                  stands for the motor's current. First chart: lines are the true friction, dots what was estimated when the joint had that \
                  temperature."
            .into(),
        panels: vec![
            panel("friction torque by velocity and temperature", "velocity [rad/s]", "torque [N m]", None, maps),
            panel("temperature", "time [min]", "temperature [°C]", None, vec![line("", 4, runs[0].over_time(|k| runs[0].temperature[k]))]),
            panel("friction, estimated while working", "time [min]", "friction / cold friction", None, over_time),
        ],
        checks: vec![
            Check::near("viscous friction falls from 25 to 60 °C by", falls, 0.45, 0.15, Unit::Percent),
            Check::near("hottest the joint became", hottest, 59.0, 2.0, Unit::Celsius),
            Check::holds("estimated curves ordered by temperature", ordered),
            Check::most("largest error of Fv against the window's mean", worst(0), 0.05, Unit::Percent),
            Check::most("largest error of Fc against the window's mean", worst(1), 0.05, Unit::Percent),
            Check::least(
                "above 50 °C: torque error of the cold model over that of the estimate",
                wrong.into_iter().fold(f64::INFINITY, f64::min),
                2.0,
                Unit::Plain,
            ),
        ],
    }
}

/// Both models' windows \[s\], the disturbance of dry friction \[N·m\] and its period \[s\].
const DRIFT_WINDOW_S: f64 = 20.0;
const DISTURBANCE: f64 = 0.3;
const DISTURBANCE_S: f64 = 400.0;
const TEN_MINUTES: f64 = 600.0;

/// Sums of a pair of columns: correlation, and condition of the pair when each has unit length.
struct Alike {
    correlation: f64,
    condition: f64,
}

fn alike(pairs: impl Iterator<Item = [f64; 2]>) -> Alike {
    let [a, ab, b] = pairs.fold([0.0; 3], |[aa, ab, bb], [a, b]| [aa + a * a, ab + a * b, bb + b * b]);
    let correlation = ab / (a * b).sqrt();
    Alike { correlation, condition: ((1.0 + correlation) / (1.0 - correlation)).sqrt() }
}

pub(super) fn drift(repetitions: u64) -> Figure {
    let bench = Bench::direct_drive();
    let [fv, fc] = ["j1.viscous", "j1.coulomb"].map(|name| bench.place(name));
    // One frequency: joint 2 stands; its dead zone leaves out its rows, which say nothing.
    let swings = [Swing { amplitude: 1.2, hz: 0.8, start_s: 0.0 }, Swing { amplitude: 0.5, hz: 1.1, start_s: 1e9 }];
    let common = |kind: EstimatorKind| Settings {
        window: Window::Exponential { seconds: DRIFT_WINDOW_S },
        dead_zone: vec![0.0, 0.02],
        ..bench.paper(kind)
    };
    let energy = Settings { decimation: 10, ..common(EstimatorKind::RlsEnergy) };
    let torque =
        Settings { filtering: Filtering::Model, filter_hz: 10.0, decimation: 20, ..common(EstimatorKind::Rls) };
    let go = |settings: &Settings| -> Vec<Trace> {
        repeat(repetitions, |seed| {
            let mut identifier = bench.identifier(settings, &bench.truth);
            let mut source = Source::new(&bench, &swings, 4e-5, seed);
            let mut trace = Trace::default();
            for k in 0..(TEN_MINUTES / PERIOD_S) as usize {
                source.x[fc] = bench.truth[fc] + DISTURBANCE * (TAU * source.t / DISTURBANCE_S).sin();
                source.next();
                source.push(&mut identifier);
                // At the same place of every swing.
                if (k + 1) % 1250 == 0 {
                    trace.add(source.t, &identifier);
                }
            }
            trace
        })
    };
    let (integral, differential) = (go(&energy), go(&torque));
    // Largest departure from the truth after the first minute.
    let departure = |traces: &[Trace], at: usize| {
        let late = traces.iter().flat_map(|trace| trace.t.iter().zip(&trace.values[at])).filter(|(t, _)| **t > 60.0);
        late.fold(0.0_f64, |m, (_, v)| m.max((v / bench.truth[at] - 1.0).abs()))
    };
    let speed = |k: usize| swings[0].at(k as f64 * PERIOD_S)[1];
    let count = (TEN_MINUTES / PERIOD_S) as usize;
    let mut work = [0.0; 2];
    let works = alike((0..count).map(|k| {
        work = [work[0] + speed(k).powi(2) * PERIOD_S, work[1] + speed(k).abs() * PERIOD_S];
        work
    }));
    let torques = alike((0..count).map(|k| [speed(k), if speed(k) == 0.0 { 0.0 } else { speed(k).signum() }]));
    let drawn = |title: &str, traces: &[Trace]| {
        let mut series = Vec::new();
        for (colour, (at, label)) in [(fv, "viscous [N m s/rad]"), (fc, "Coulomb [N m]")].into_iter().enumerate() {
            series.extend(traces.iter().map(|trace| line(label, colour, trace.points(at, 1.0))));
            series.push(dashes(
                "true value, undisturbed",
                5,
                vec![[0.0, bench.truth[at]], [TEN_MINUTES, bench.truth[at]]],
            ));
        }
        panel(title, "time [s]", "friction", Some([0.0, 12.0]), series)
    };
    let (i_fv, i_fc) = (departure(&integral, fv), departure(&integral, fc));
    let (d_fv, d_fc) = (departure(&differential, fv), departure(&differential, fc));
    Figure {
        number: 16,
        title: "Two frictional parameters during 10 minutes".into(),
        caption: "Joint 1 alone at 0.8 Hz, least squares with a window of 20 s, started at the truth, noted once a swing; dry friction is disturbed by 0.3 N m with a \
                  period of 400 s. Work since the start makes viscous and dry friction all but one function: the integral model mistakes one \
                  for the other and wanders by many times the disturbance. The differential model sees the disturbance and no more."
            .into(),
        panels: vec![drawn("integral model", &integral), drawn("differential model", &differential)],
        checks: vec![
            Check::most("integral: 1 - correlation of the two columns", 1.0 - works.correlation, 1e-8, Unit::Plain),
            Check::least("integral: condition of the two columns", works.condition, 1e4, Unit::Plain),
            Check::near("differential: correlation of the two columns", torques.correlation, 0.9, 0.01, Unit::Plain),
            Check::near("differential: condition of the two columns", torques.condition, 4.4, 0.1, Unit::Plain),
            Check::least("integral: largest departure of Fv after 60 s", i_fv, 0.2, Unit::Percent),
            Check::least("integral: largest departure of Fc after 60 s", i_fc, 0.2, Unit::Percent),
            Check::most("differential: largest departure of Fv after 60 s", d_fv, 0.02, Unit::Percent),
            Check::most("differential: largest departure of Fc after 60 s, 4.2 % being the disturbance", d_fc, 0.07, Unit::Percent),
        ],
    }
}
