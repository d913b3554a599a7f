//! Every kind of instruments on the two-link direct-drive arm under a position controller that feeds encoder noise back into
//! torque: least squares shrinks the inertias, none of the instruments does.

use rivet_config::{Differentiator, Instruments, Supervision};
use rivet_estimation::{Identifier, Instrument, Motion, Sample, Settings, Window};
use rivet_simulation::motion::Trajectory;
use rivet_simulation::{
    Disturbances, FrictionLaw, Measurement, Plant, PlantSettings, Random, Sensors, SetpointRef, Truth, closed_loop,
};
use std::f64::consts::TAU;

const PERIOD: f64 = 1e-3;
/// White noise of either encoder of each joint \[rad\]: at 1 kHz it makes accelerations of 50 and 120 rad/s², the motion some
/// 15. More of it, and half a minute is too short for instruments that are as noisy as the regressor: their estimate is
/// then pulled by the chance correlation of both noises (2.7 % at 5e-5 rad, falling with the length of the run).
const NOISE: [f64; 2] = [2e-5, 5e-5];
const SECONDS: usize = 30;
const RUNS: u64 = 8;

/// Two tones a joint that repeat every 2.5 s.
struct Tones;

impl Trajectory for Tones {
    fn dof(&self) -> usize {
        2
    }

    fn sample(&self, t: f64, q: &mut [f64], qd: &mut [f64], qdd: &mut [f64]) {
        for (j, tones) in [[(0.8, 0.45), (2.0, 0.1)], [(1.2, 0.45), (2.8, 0.1)]].iter().enumerate() {
            (q[j], qd[j], qdd[j]) = (0.0, 0.0, 0.0);
            for (hz, a) in tones {
                let w = TAU * hz;
                // Starts at rest at the mean.
                let grow = 1.0 - (-t / 0.5_f64).exp();
                q[j] += grow * a * (w * t).sin();
                let slope = (-t / 0.5_f64).exp() / 0.5;
                qd[j] += grow * a * w * (w * t).cos() + slope * a * (w * t).sin();
                qdd[j] += -grow * a * w * w * (w * t).sin() + 2.0 * slope * a * w * (w * t).cos()
                    - slope / 0.5 * a * (w * t).sin();
            }
        }
    }
}

/// One run: what the encoders said, and the plan.
struct Run {
    q: Vec<[f64; 2]>,
    second: Vec<[f64; 2]>,
    tau: Vec<[f64; 2]>,
    plan: Vec<[[f64; 2]; 3]>,
}

struct Bench {
    robot: rivet_config::Robot,
    truth: Truth,
}

impl Bench {
    fn new() -> Bench {
        let robot = rivet_config::load(rivet_tests::robot("dd2")).expect("a robot of the project");
        let mut joints = robot.config.nominal_joints();
        // Dry friction's sign of a noisy velocity is another story than noise in the acceleration.
        joints.coulomb = vec![0.0; 2];
        let truth = Truth::new(&robot.model, &joints, &Disturbances { bodies: 1.25, ..Disturbances::default() });
        Bench { robot, truth }
    }

    fn run(&self, seed: u64) -> Run {
        let sensors = Sensors { resolution: vec![0.0; 2], position_noise: NOISE.to_vec(), torque_noise: vec![0.05; 2] };
        let settings = PlantSettings {
            friction: FrictionLaw::Stick,
            ..PlantSettings::new(PERIOD, &self.robot.config.drive.torque_limit)
        };
        let mut plant = Plant::new(&self.truth, &sensors, &settings, seed);
        plant.place(&[0.0; 2], &[0.0; 2]);
        let mut last = [0.0; 2];
        // A stiff loop without feed-forward: the arm is late by some 30 ms.
        let control = |measured: &Measurement, plan: &SetpointRef<'_>, tau: &mut [f64]| {
            for (j, (kp, kd)) in [(900.0, 60.0), (60.0, 4.0)].into_iter().enumerate() {
                let q = measured.q()[j];
                tau[j] = kp * (plan.q[j] - q) - kd * (q - last[j]) / PERIOD;
                last[j] = q;
            }
        };
        let mut random = Random::stream(seed, 9);
        let mut run = Run { q: vec![], second: vec![], tau: vec![], plan: vec![] };
        closed_loop(&mut plant, &Tones, control, SECONDS * 1000, |record| {
            let pair = |x: &[f64]| [x[0], x[1]];
            run.q.push(pair(record.measured.q()));
            run.second.push([0, 1].map(|j| record.q[j] + NOISE[j] * random.normal()));
            run.tau.push(pair(record.measured.tau()));
            run.plan.push([pair(record.setpoint.q), pair(record.setpoint.qd), pair(record.setpoint.qdd)]);
        });
        run
    }

    /// Relative errors of the inertia at each joint, by the estimator and by least squares beside it.
    fn identify(&self, run: &Run, instruments: Instruments, with_plan: bool) -> ([Vec<f64>; 2], Instrument) {
        let robot = &self.robot;
        let settings = Settings {
            differentiator: Differentiator::Central,
            filter_hz: 95.0,
            filter_order: 2,
            decimation: 2,
            dead_zone: vec![0.0; 2],
            window: Window::None,
            instruments,
            supervision: Supervision::Off,
            ..Settings::new(2, PERIOD)
        };
        let (model, base) = (robot.model.clone(), robot.base.clone());
        let mut identifier = Identifier::new(model, base, &robot.nominal_base, &settings).expect("sound settings");
        let (mut seen, mut last) = (0_u64, Instrument::None);
        for k in 0..run.q.len() {
            let [q, qd, qdd] = &run.plan[k];
            let setpoint = with_plan.then_some(Motion { q, qd, qdd });
            identifier.push_sample(Sample { q: &run.q[k], second: Some(&run.second[k]), tau: &run.tau[k], setpoint });
            last = identifier.estimate().instrument;
            seen += u64::from(last == Instrument::PreviousCycle);
        }
        if matches!(instruments, Instruments::PreviousCycle { .. }) {
            println!("previous cycle for {:.0} % of the samples", 100.0 * seen as f64 / run.q.len() as f64);
        }
        let real = self.real();
        let estimate = identifier.estimate();
        let error = |x: &[f64]| -> Vec<f64> {
            self.inertias(x).iter().zip(self.inertias(&real)).map(|(x, real)| x / real - 1.0).collect()
        };
        ([error(estimate.values), error(estimate.rls_values)], last)
    }

    /// What each joint feels of its own acceleration: the first's lies in one base parameter, the second's in two.
    fn inertias(&self, x: &[f64]) -> [f64; 2] {
        let (base, model) = (&self.robot.base, &self.robot.model);
        let of = |name: &str| (0..base.len()).find(|&i| base.name(model, i) == name).map_or(f64::NAN, |i| x[i]);
        [of("j1.rotor_inertia+"), of("j2.rotor_inertia") + of("l2.Izz")]
    }

    /// True base parameters.
    fn real(&self) -> Vec<f64> {
        let model = rivet_dynamics::Model::new(self.truth.arm.clone(), self.robot.model.structure);
        self.robot.base.from_standard(&model.nominal(&self.truth.joints))
    }
}

/// Mean and standard deviation over runs, joint by joint.
fn statistics(errors: &[Vec<f64>]) -> [[f64; 2]; 2] {
    let count = errors.len() as f64;
    let mean = [0, 1].map(|j| errors.iter().map(|e| e[j]).sum::<f64>() / count);
    let spread = [0, 1].map(|j| (errors.iter().map(|e| (e[j] - mean[j]).powi(2)).sum::<f64>() / (count - 1.0)).sqrt());
    [mean, spread]
}

#[test]
fn every_kind_is_consistent_where_least_squares_is_not() {
    let bench = Bench::new();
    let runs: Vec<Run> = (1..=RUNS).map(|seed| bench.run(seed)).collect();
    let (delay_s, longest_cycle_s) = (0.03, 5.0);
    let mut spreads = Vec::new();
    for (instruments, with_plan, expected) in [
        (Instruments::Setpoint, true, Instrument::Setpoint),
        (Instruments::SetpointThroughLoop, true, Instrument::SetpointThroughLoop),
        (Instruments::SecondEncoder, false, Instrument::SecondEncoder),
        (Instruments::PreviousCycle { delay_s, longest_cycle_s }, false, Instrument::PreviousCycle),
        (Instruments::Delayed { delay_s }, false, Instrument::Delayed),
    ] {
        let found: Vec<_> = runs.iter().map(|run| bench.identify(run, instruments, with_plan)).collect();
        assert!(found.iter().all(|(_, used)| *used == expected), "{instruments:?}");
        let [iv, ls] = [0, 1].map(|k| found.iter().map(|(errors, _)| errors[k].clone()).collect::<Vec<_>>());
        let ([mean, spread], [pulled, _]) = (statistics(&iv), statistics(&ls));
        println!("{expected:?}: inertias off by {mean:.4?} +- {spread:.4?} a run, least squares by {pulled:.2?}");
        spreads.push(spread);
        // Noise that the controller feeds back into torque pulls the other way than noise alone.
        assert!(pulled.iter().all(|e| e.abs() >= 0.2), "{pulled:?}");
        assert!(mean.iter().all(|e| e.abs() <= 0.01), "{expected:?}: {mean:?}");
    }
    for j in 0..2 {
        assert!(spreads[1][j] <= spreads[0][j], "through the loop {:?}, raw {:?}", spreads[1], spreads[0]);
    }
}

#[test]
fn auto_takes_the_best_at_hand() {
    let bench = Bench::new();
    let run = bench.run(7);
    let auto = Instruments::Auto { delay_s: 0.03, longest_cycle_s: 5.0 };
    assert_eq!(bench.identify(&run, auto, true).1, Instrument::SetpointThroughLoop);
    assert_eq!(bench.identify(&run, auto, false).1, Instrument::SecondEncoder);
    let without = Run { second: vec![[f64::NAN; 2]; run.q.len()], ..run };
    assert_eq!(bench.identify(&without, auto, false).1, Instrument::PreviousCycle);
    // A cycle that is longer than what is looked for.
    let short = Instruments::Auto { delay_s: 0.03, longest_cycle_s: 1.5 };
    assert_eq!(bench.identify(&without, short, false).1, Instrument::Delayed);
    // What is asked for acts, whatever else is at hand.
    let cycle = Instruments::PreviousCycle { delay_s: 0.03, longest_cycle_s: 5.0 };
    assert_eq!(bench.identify(&without, cycle, true).1, Instrument::PreviousCycle);
    // What is asked for and is not there: nothing is learnt, rather than something else.
    assert_eq!(bench.identify(&without, Instruments::SecondEncoder, true).1, Instrument::None);
    assert_eq!(bench.identify(&without, Instruments::SetpointThroughLoop, false).1, Instrument::None);
}
