//! Figures 12 and 13: filtering the input of the model against filtering the model.

use super::bench::{Bench, PERIOD_S, Source, Swing, Trace, mean_and_spread, repeat, rms, run};
use super::{Check, Figure, Unit, dashes, line, panel};
use rivet_dynamics::friction_sign;
use rivet_estimation::differentiate::Weights;
use rivet_estimation::filter::{Bank, Butterworth};
use rivet_estimation::{Differentiator, EstimatorKind, Filtering, InputSignals, Settings};

/// Six times the motion's frequency.
const CUTOFF_HZ: f64 = 5.0;
const ORDER: usize = 4;
const SWING: [Swing; 1] = [Swing { amplitude: 0.5, hz: 0.8, start_s: 0.0 }];
const SECONDS: f64 = 10.0;

/// Acceleration, velocity and sign of velocity of the joint: of filtered input, and filtered themselves.
struct Functions {
    t: Vec<f64>,
    input: [Vec<f64>; 3],
    model: [Vec<f64>; 3],
}

impl Functions {
    fn new(cutoff_hz: f64) -> Functions {
        let bench = Bench::geared_joint();
        let v0 = bench.model.structure.sign_velocity;
        let mut source = Source::new(&bench, &SWING, 4e-6, 1);
        let weights = Weights::new(Differentiator::Central, PERIOD_S);
        let low_pass = || Bank::new(Butterworth::low_pass(ORDER, cutoff_hz, 1.0 / PERIOD_S), 3);
        let (mut of_input, mut of_model) = (low_pass(), low_pass());
        let mut window = [0.0; 3];
        let mut out = Functions { t: Vec::new(), input: Default::default(), model: Default::default() };
        for k in 0..2500 {
            source.next();
            window.rotate_left(1);
            window[2] = source.q[0];
            if k < 2 {
                continue;
            }
            let of = |w: &[f64]| w.iter().zip(&window).map(|(w, q)| w * q).sum::<f64>();
            let (v, a) = (of(&weights.velocity), of(&weights.acceleration));
            let (mut input, mut model) = ([a, v, 0.0], [a, v, friction_sign(v, v0)]);
            of_input.step(&mut input);
            of_model.step(&mut model);
            input[2] = friction_sign(input[1], v0);
            out.t.push(source.t);
            for (to, value) in out.input.iter_mut().chain(&mut out.model).zip(input.into_iter().chain(model)) {
                to.push(value);
            }
        }
        out
    }

    /// Rms difference of the two signs over the rms of the sign.
    fn difference(&self) -> f64 {
        let [input, model] = [&self.input[2], &self.model[2]];
        rms(input.iter().zip(model).map(|(a, b)| a - b)) / rms(input.iter().copied())
    }
}

pub(super) fn functions() -> Figure {
    let functions = Functions::new(CUTOFF_HZ);
    let rounded = |s: &[f64]| s.iter().filter(|s| s.abs() < 0.9).count() as f64 / s.len() as f64;
    let points = |y: &[f64], from: f64, to: f64| {
        let both = functions.t.iter().zip(y).map(|(t, y)| [*t, *y]);
        both.filter(|[t, _]| (from..to).contains(t)).collect::<Vec<_>>()
    };
    let drawn = |title: &str, y: &str, which: usize, from: f64, to: f64| {
        let series = vec![
            line("input filtering", 1, points(&functions.input[which], from, to)),
            dashes("model filtering", 0, points(&functions.model[which], from, to)),
        ];
        panel(title, "time [s]", y, None, series)
    };
    Figure {
        number: 12,
        title: "Model functions with input and with model filtering".into(),
        caption: format!(
            "One geared joint (Manutec r3, joint 1) at 0.8 Hz, low-pass of {CUTOFF_HZ} Hz. Linear functions do not care where the filter \
             is; the sign does: of filtered input it is still a square wave, filtered itself it is rounded. (A low-pass of 10 Hz rounds \
             less: there the two signs differ by {:.0} %.)",
            100.0 * Functions::new(10.0).difference()
        ),
        panels: vec![
            drawn("acceleration (inertia)", "acceleration [rad/s²]", 0, 0.0, 2.5),
            drawn("velocity (dynamic friction)", "velocity [rad/s]", 1, 0.0, 2.5),
            drawn("sign of velocity (static friction)", "sign [-]", 2, 0.0, 2.5),
            drawn("sign of velocity, a reversal", "sign [-]", 2, 1.2, 1.6),
        ],
        checks: vec![
            Check::least("sign: rms difference over rms", functions.difference(), 0.2, Unit::Percent),
            Check::most(
                "sign, input filtering: share of samples below 0.9",
                rounded(&functions.input[2]),
                0.02,
                Unit::Percent,
            ),
            Check::least(
                "sign, model filtering: share of samples below 0.9",
                rounded(&functions.model[2]),
                0.05,
                Unit::Percent,
            ),
        ],
    }
}

pub(super) fn estimates(repetitions: u64) -> Figure {
    let bench = Bench::geared_joint();
    let start = bench.nothing();
    let names = ["j1.rotor_inertia", "j1.viscous", "j1.coulomb"];
    let experiment = |filtering: Filtering| -> Vec<Trace> {
        let settings =
            Settings { filtering, filter_hz: CUTOFF_HZ, filter_order: ORDER, ..bench.paper(EstimatorKind::Rls) };
        repeat(repetitions, |seed| {
            run(&bench, &settings, &start, &mut Source::new(&bench, &SWING, 4e-6, seed), SECONDS, 20)
        })
    };
    let errors = |traces: &[Trace]| {
        names.map(|name| {
            let at = bench.place(name);
            let values: Vec<f64> = traces.iter().map(|t| t.last(at) / bench.truth[at] - 1.0).collect();
            mean_and_spread(&values).0
        })
    };
    let inertia = bench.place(names[0]);
    let drawn = |title: &str, traces: &[Trace]| {
        let mut series: Vec<_> = traces.iter().map(|t| line("inertia", 0, t.points(inertia, 1.0))).collect();
        series.push(dashes("true value", 5, vec![[0.0, bench.truth[inertia]], [SECONDS, bench.truth[inertia]]]));
        let range = Some([0.7 * bench.truth[inertia], 1.3 * bench.truth[inertia]]);
        panel(title, "time [s]", "inertia [kg m²]", range, series)
    };
    let mut panels = Vec::new();
    let mut checks = Vec::new();
    for (signals, what) in [
        (InputSignals::Motion, "input filter on the motion, torque unfiltered"),
        (InputSignals::All, "input filter on motion and torque"),
        (InputSignals::Acceleration, "input filter on the acceleration alone"),
    ] {
        let traces = experiment(Filtering::Input(signals));
        let [j, fv, fc] = errors(&traces);
        let percent = |v: f64| format!("{:+.1} %", 100.0 * v);
        let what = format!("{what}: largest error (J {}, Fv {}, Fc {})", percent(j), percent(fv), percent(fc));
        checks.push(Check::least(what, j.abs().max(fv.abs()).max(fc.abs()), 0.05, Unit::Percent));
        if signals == InputSignals::Motion {
            panels.push(drawn("input filtering", &traces));
        }
    }
    let traces = experiment(Filtering::Model);
    checks.push(Check::most("model filter: error of J", errors(&traces)[0].abs(), 0.01, Unit::Percent));
    panels.push(drawn("model filtering", &traces));
    Figure {
        number: 13,
        title: "Estimates with input and with model filtering".into(),
        caption: "The joint of figure 12, least squares, six repetitions. Left, the measured motion is filtered and the torque is not; right, \
                  every function of the model and the torque are."
            .into(),
        panels,
        checks,
    }
}
