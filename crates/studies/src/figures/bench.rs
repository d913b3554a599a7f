//! What the figures are computed from: an arm, a motion, encoders that count, drives that are noisy, and an
//! [`Identifier`] that starts without information.
//!
//! Torques are those that the followed motion takes (inverse dynamics) plus white noise; positions are the followed
//! motion with a little white noise, rounded to the encoder. The followed motion is the desired one, late by a few
//! milliseconds, as a position loop leaves it.

use std::sync::Arc;

use rivet_dynamics::{Arm, BaseSet, Joints, Model, Structure, Workspace};
use rivet_estimation::{
    Differentiator, EstimatorKind, Filtering, Identifier, Instruments, Motion, Prior, Settings, Supervision, Window,
};
use rivet_simulation::Random;

/// The sample interval of the paper \[s\].
pub(crate) const PERIOD_S: f64 = 0.001;
/// What the followed motion is late by \[s\].
const LAG_S: f64 = 0.003;
/// White noise of positions before rounding, unless a figure wants more \[rad\].
pub(crate) const POSITION_NOISE: f64 = 1e-6;
/// Without information: the start is this share of the truth, and known to ten times the truth.
const START_SHARE: f64 = 0.01;
const START_STD: f64 = 1000.0;

/// The noise every joint's rows are said to have \[N·m\]: one weight for all, as in the paper, and nothing an outlier.
const UNWEIGHTED: f64 = 100.0;

/// One joint's harmonic motion `centre − amplitude·cos(2π·hz·(t − start))`, at rest before `start_s`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Swing {
    /// \[rad\]
    pub(crate) amplitude: f64,
    /// \[Hz\]
    pub(crate) hz: f64,
    /// \[s\]
    pub(crate) start_s: f64,
}

impl Swing {
    /// Position \[rad\], velocity and acceleration at `t`.
    pub(crate) fn at(&self, t: f64) -> [f64; 3] {
        let w = std::f64::consts::TAU * self.hz;
        if t < self.start_s {
            return [-self.amplitude, 0.0, 0.0];
        }
        let (sin, cos) = (w * (t - self.start_s)).sin_cos();
        [-self.amplitude * cos, self.amplitude * w * sin, self.amplitude * w * w * cos]
    }
}

/// The paper's motion: joint 1 at 0.8 Hz, joint 2 at 1.1 Hz.
pub(crate) const BOTH: [Swing; 2] =
    [Swing { amplitude: 1.2, hz: 0.8, start_s: 0.0 }, Swing { amplitude: 0.9, hz: 1.1, start_s: 0.0 }];

/// An arm whose parameters are known.
pub(crate) struct Bench {
    pub(crate) model: Arc<Model>,
    pub(crate) base: Arc<BaseSet>,
    /// True base parameters.
    pub(crate) truth: Vec<f64>,
    pub(crate) names: Vec<String>,
    /// White noise of the torques \[N·m\].
    pub(crate) torque_noise: Vec<f64>,
}

impl Bench {
    /// The two-link direct-drive arm, laid down: with gravity along its axes it has the paper's parameters, inertia and
    /// friction. (Upright, one frequency makes a pendulum's gravity and inertia all but the same function.)
    pub(crate) fn direct_drive() -> Bench {
        let urdf = include_str!("../../../../robots/dd2/robot.urdf");
        Bench::new(urdf, include_str!("../../../../robots/dd2/robot.toml"), 2, [-9.81, 0.0, 0.0])
    }

    /// The first joint of the geared Manutec r3, its axis upright: acceleration, dynamic and static friction.
    pub(crate) fn geared_joint() -> Bench {
        let urdf = include_str!("../../../../robots/manutec-r3/robot.urdf");
        Bench::new(urdf, include_str!("../../../../robots/manutec-r3/robot.toml"), 1, [0.0, 0.0, -9.81])
    }

    fn new(urdf: &str, robot: &str, joints: usize, gravity: [f64; 3]) -> Bench {
        let robot: toml::Table = robot.parse().expect("a robot file of this project");
        let list = |section: &str, key: &str| -> Vec<f64> {
            let values = robot[section][key].as_array().expect("one value a joint");
            let number = |v: &toml::Value| v.as_float().or_else(|| v.as_integer().map(|i| i as f64));
            values.iter().take(joints).map(|v| number(v).expect("a number")).collect()
        };
        let mut arm = Arm::from_urdf(urdf, gravity).expect("a URDF of this project");
        arm.joints.truncate(joints);
        arm.links.truncate(joints);
        let model = Model::new(arm, Structure { sign_velocity: 0.004, ..Structure::default() });
        let base = BaseSet::new(&model).expect("clear rank");
        let drives = Joints {
            rotor_inertia: list("drive", "rotor_inertia"),
            viscous: list("friction", "viscous"),
            coulomb: list("friction", "coulomb"),
            ..Joints::default()
        };
        let truth = base.from_standard(&model.nominal(&drives));
        let names = (0..base.len()).map(|i| base.name(&model, i)).collect();
        let torque_noise = list("simulation", "torque_noise");
        Bench { model: Arc::new(model), base: Arc::new(base), truth, names, torque_noise }
    }

    pub(crate) fn dof(&self) -> usize {
        self.model.arm.dof()
    }

    /// Place of the base parameter `name`, whatever folds into it.
    pub(crate) fn place(&self, name: &str) -> usize {
        self.names.iter().position(|n| n.trim_end_matches('+') == name).expect("a base parameter of this arm")
    }

    /// Settings of the paper: differences of three samples, no filter, every sample an equation, all alike in weight,
    /// nothing forgotten, nothing supervised, instruments from the desired motion.
    pub(crate) fn paper(&self, estimator: EstimatorKind) -> Settings {
        Settings {
            differentiator: Differentiator::Central,
            filtering: Filtering::None,
            decimation: 1,
            estimator,
            window: Window::None,
            instruments: Instruments::Setpoint,
            supervision: Supervision::Off,
            energy_span_s: 0.0,
            dead_zone: vec![0.0; self.dof()],
            prior: Prior { relative_std: START_STD },
            // Energies come in one row at a time: there is nothing to weigh.
            torque_noise: (!estimator.energy()).then(|| vec![UNWEIGHTED; self.dof()]),
            ..Settings::new(self.dof(), PERIOD_S)
        }
    }

    /// Where identification without information starts.
    pub(crate) fn nothing(&self) -> Vec<f64> {
        self.truth.iter().map(|x| START_SHARE * x).collect()
    }

    /// An identifier that starts at `start`.
    pub(crate) fn identifier(&self, settings: &Settings, start: &[f64]) -> Identifier {
        Identifier::new(self.model.clone(), self.base.clone(), start, settings)
            .expect("settings of this study are sound")
    }
}

/// The arm at work: gives one sample after the other.
pub(crate) struct Source<'a> {
    bench: &'a Bench,
    swings: &'a [Swing],
    /// Encoder step of every joint \[rad\]; 0 measures exactly, torques included.
    quantum: f64,
    /// White noise of positions before rounding \[rad\]: rounding alone would repeat itself.
    pub(crate) position_noise: f64,
    random: Random,
    ws: Workspace,
    full: Vec<f64>,
    rows: Vec<f64>,
    k: u64,
    /// True parameters; may be changed from sample to sample.
    pub(crate) x: Vec<f64>,
    pub(crate) t: f64,
    pub(crate) q: Vec<f64>,
    pub(crate) tau: Vec<f64>,
    pub(crate) desired: [Vec<f64>; 3],
    pub(crate) actual: [Vec<f64>; 3],
}

impl<'a> Source<'a> {
    pub(crate) fn new(bench: &'a Bench, swings: &'a [Swing], quantum: f64, seed: u64) -> Source<'a> {
        let (dof, n) = (bench.dof(), bench.base.len());
        let zeros = || std::array::from_fn(|_| vec![0.0; dof]);
        Source {
            bench,
            swings,
            quantum,
            position_noise: POSITION_NOISE,
            random: Random::stream(seed, 0xf1),
            ws: Workspace::new(&bench.model.arm),
            full: vec![0.0; dof * bench.model.len()],
            rows: vec![0.0; dof * n],
            k: 0,
            x: bench.truth.clone(),
            t: 0.0,
            q: vec![0.0; dof],
            tau: vec![0.0; dof],
            desired: zeros(),
            actual: zeros(),
        }
    }

    /// Goes on by one sample.
    pub(crate) fn next(&mut self) {
        self.t = self.k as f64 * PERIOD_S;
        self.k += 1;
        for (j, swing) in self.swings.iter().enumerate() {
            let (planned, followed) = (swing.at(self.t), swing.at(self.t - LAG_S));
            for part in 0..3 {
                self.desired[part][j] = planned[part];
                self.actual[part][j] = followed[part];
            }
        }
        self.measure();
    }

    /// Torque and reading of `actual`.
    pub(crate) fn measure(&mut self) {
        let n = self.x.len();
        regressor_of(self.bench, &mut self.ws, &self.actual, &mut self.full, &mut self.rows);
        for (j, row) in self.rows.chunks_exact(n).enumerate() {
            self.tau[j] = row.iter().zip(&self.x).map(|(d, x)| d * x).sum();
            self.q[j] = self.actual[0][j];
            if self.quantum > 0.0 {
                self.tau[j] += self.bench.torque_noise[j] * self.random.normal();
                let noisy = self.q[j] + self.position_noise * self.random.normal();
                self.q[j] = (noisy / self.quantum).round() * self.quantum;
            }
        }
    }

    /// True rows of the regressor at this sample.
    pub(crate) fn true_rows(&self) -> &[f64] {
        &self.rows
    }

    /// Feeds the sample.
    pub(crate) fn push(&self, identifier: &mut Identifier) {
        let setpoint = Motion { q: &self.desired[0], qd: &self.desired[1], qdd: &self.desired[2] };
        identifier.push(&self.q, &self.tau, Some(setpoint));
    }
}

/// Base rows of a motion, `full` being scratch.
pub(crate) fn regressor_of(
    bench: &Bench,
    ws: &mut Workspace,
    motion: &[Vec<f64>; 3],
    full: &mut [f64],
    rows: &mut [f64],
) {
    bench.model.regressor(ws, &motion[0], &motion[1], &motion[2], full);
    bench.base.select(full, bench.model.len(), rows);
}

/// Estimates over time: `values[parameter][instant]`.
#[derive(Clone, Debug, Default)]
pub(crate) struct Trace {
    pub(crate) t: Vec<f64>,
    pub(crate) values: Vec<Vec<f64>>,
    /// Torque residual's deviation that rows were weighted by in the end \[N·m\].
    pub(crate) torque_noise: Vec<f64>,
}

impl Trace {
    pub(crate) fn last(&self, parameter: usize) -> f64 {
        self.values[parameter].last().copied().unwrap_or(f64::NAN)
    }

    /// Points of a parameter over `scale`.
    pub(crate) fn points(&self, parameter: usize, scale: f64) -> Vec<[f64; 2]> {
        self.t.iter().zip(&self.values[parameter]).map(|(t, v)| [*t, v / scale]).collect()
    }

    /// Adds what is known now.
    pub(crate) fn add(&mut self, t: f64, identifier: &Identifier) {
        let values = identifier.estimate().values;
        self.values.resize(values.len(), Vec::new());
        self.t.push(t);
        for (trace, v) in self.values.iter_mut().zip(values) {
            trace.push(*v);
        }
    }
}

/// One repetition of an experiment, the estimate noted every `every` samples.
pub(crate) fn run(
    bench: &Bench,
    settings: &Settings,
    start: &[f64],
    source: &mut Source<'_>,
    seconds: f64,
    every: usize,
) -> Trace {
    let mut identifier = bench.identifier(settings, start);
    let mut trace = Trace::default();
    for k in 0..(seconds / PERIOD_S) as usize {
        source.next();
        source.push(&mut identifier);
        if (k + 1) % every == 0 {
            trace.add(source.t, &identifier);
        }
    }
    trace.torque_noise = identifier.estimate().torque_noise.to_vec();
    trace
}

/// The same with `count` seeds, on two threads.
pub(crate) fn repeat<T: Send>(count: u64, one: impl Fn(u64) -> T + Sync) -> Vec<T> {
    std::thread::scope(|scope| {
        let one = &one;
        let half = |odd: u64| scope.spawn(move || (0..count).filter(|s| s % 2 == odd).map(one).collect::<Vec<T>>());
        let (even, odd) = (half(0), half(1));
        let mut odd = odd.join().expect("a study does not panic").into_iter();
        let mut all = Vec::new();
        for value in even.join().expect("a study does not panic") {
            all.push(value);
            all.extend(odd.next());
        }
        all
    })
}

/// Mean and standard deviation over repetitions.
pub(crate) fn mean_and_spread(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let square = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    (mean, square.sqrt())
}

/// The largest of values that are not negative.
pub(crate) fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, f64::max)
}

/// Root mean square.
pub(crate) fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for v in values {
        sum += v * v;
        count += 1.0;
    }
    f64::sqrt(sum / f64::max(count, 1.0))
}
