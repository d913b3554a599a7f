//! Logs of generated arms, read wrongly in every way that is compared: other joints, rates, noises, motions and bodies each time.

use std::f64::consts::TAU;

use rayon::prelude::*;
use rivet_dynamics::{Arm, Joints, Model, Parameter, Structure, Workspace};
use rivet_screening::{Reading, RobotFile, Screening, Stretch, screen, second_publisher};

/// Uniform numbers, the same ones for a seed.
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as f64) / f64::from(1_u32 << 31)
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.unit()).sum::<f64>() - 6.0
    }

    fn below(&mut self, count: usize) -> usize {
        (self.unit() * count as f64) as usize
    }
}

#[derive(Clone)]
struct Robot {
    model: Model,
    nominal: Vec<f64>,
    limit: Vec<f64>,
}

impl Robot {
    /// A UR5e or UR10e with drives of about its kind.
    fn new(random: &mut Random) -> Robot {
        let name = ["ur5e", "ur10e"][random.below(2)];
        Robot::named(name, Some(vec![150.0, 150.0, 150.0, 28.0, 28.0, 28.0]))
    }

    /// An arm of the project with drives of its size.
    fn any(random: &mut Random) -> Robot {
        Robot::named(["ur5e", "ur10e", "ur10", "staubli-tx40", "manutec-r3", "kuka-kr300-r2500"][random.below(6)], None)
    }

    /// `limit`: torque limits \[N m\] in the place of the URDF's.
    fn named(name: &str, limit: Option<Vec<f64>>) -> Robot {
        let path = format!("{}/../../robots/{name}/robot.urdf", env!("CARGO_MANIFEST_DIR"));
        let text = std::fs::read_to_string(path).expect("a robot of the project");
        let arm = Arm::from_urdf(&text, [0.0, 0.0, -9.81]).expect("a sound URDF");
        let limit = limit.unwrap_or_else(|| arm.joints.iter().map(|j| j.effort).collect());
        let of = |share: f64| limit.iter().map(|l| share * l).collect::<Vec<f64>>();
        let joints = Joints { coulomb: of(0.045), viscous: of(0.065), rotor_inertia: of(0.009), ..Joints::zero(6) };
        let model = Model::new(arm, Structure { offset: true, sign_velocity: 0.005, ..Structure::default() });
        let nominal = model.nominal(&joints);
        Robot { model, nominal, limit }
    }

    fn screen(&self, log: &Log) -> Option<Screening> {
        let file = RobotFile { model: &self.model, nominal: &self.nominal, torque_limit: &self.limit };
        screen(&file, &[Stretch { period_s: log.period_s, start_s: 0.0, q: &log.q, tau: &log.tau }])
    }

    /// Values that are wrong by as much as those of a robot file are.
    fn off(&self, random: &mut Random) -> Vec<f64> {
        let bodies = 60;
        let off =
            |(i, x): (usize, &f64)| x * (1.0 + if i < bodies { 0.05 } else { 0.2 } * random.normal().clamp(-2.0, 2.0));
        self.nominal.iter().enumerate().map(off).collect()
    }
}

#[derive(Clone)]
struct Log {
    period_s: f64,
    q: Vec<Vec<f64>>,
    tau: Vec<Vec<f64>>,
}

impl Log {
    /// A motion of sines about a pose, and the torque of an arm of values `x` with noise.
    fn new(robot: &Robot, x: &[f64], random: &mut Random) -> Log {
        let period_s = [0.002, 0.004, 0.008, 0.01][random.below(4)];
        let rows = (random.between(20.0, 35.0) / period_s) as usize;
        let waves: Vec<[f64; 7]> = (0..6)
            .map(|_| {
                let mut wave = [0.0; 7];
                wave[0] = random.between(-1.2, 1.2);
                for k in 0..3 {
                    wave[1 + 2 * k] = random.between(0.2, 0.5);
                    wave[2 + 2 * k] = random.between(0.0, TAU);
                }
                wave
            })
            .collect();
        let base = random.between(0.08, 0.14);
        let at = |t: f64, w: &[f64; 7]| {
            let mut sums = [w[0], 0.0, 0.0];
            for k in 0..3 {
                let rate = TAU * base * (k + 1) as f64;
                let (size, phase) = (w[1 + 2 * k], rate * t + w[2 + 2 * k]);
                sums[0] += size * phase.sin();
                sums[1] += size * rate * phase.cos();
                sums[2] -= size * rate * rate * phase.sin();
            }
            sums
        };
        let noise = random.between(0.002, 0.01);
        let mut workspace = Workspace::new(&robot.model.arm);
        let size = robot.model.len();
        let mut y = vec![0.0; 6 * size];
        let mut log = Log { period_s, q: vec![Vec::new(); 6], tau: vec![Vec::new(); 6] };
        for k in 0..rows {
            let states: Vec<[f64; 3]> = waves.iter().map(|w| at(k as f64 * period_s, w)).collect();
            let part = |i: usize| states.iter().map(|s| s[i]).collect::<Vec<f64>>();
            robot.model.regressor(&mut workspace, &part(0), &part(1), &part(2), &mut y);
            for j in 0..6 {
                let tau: f64 = y[j * size..(j + 1) * size].iter().zip(x).map(|(y, x)| y * x).sum();
                log.tau[j].push(tau + noise * robot.limit[j] * random.normal());
                log.q[j].push((states[j][0] / 1e-5).round() * 1e-5);
            }
        }
        log
    }

    fn scale(signal: &mut [f64], factor: f64) {
        for x in signal {
            *x *= factor;
        }
    }

    /// Friction that is larger near standstill, which no model of the file has.
    fn add_stribeck(&mut self, robot: &Robot, random: &mut Random) {
        for j in 0..robot.limit.len() {
            let (size, speed) = (random.between(0.3, 0.8) * 0.045 * robot.limit[j], random.between(0.02, 0.1));
            for k in 1..self.q[j].len() {
                let rate = (self.q[j][k] - self.q[j][k - 1]) / self.period_s;
                self.tau[j][k] += size * (rate / 0.005).tanh() * (-(rate / speed).powi(2)).exp();
            }
        }
    }

    fn delay(&mut self, j: usize, seconds: f64) {
        let samples = (seconds / self.period_s).round() as usize;
        let first = self.tau[j][0];
        let rows = self.tau[j].len();
        self.tau[j].rotate_right(samples.min(rows));
        self.tau[j][..samples].fill(first);
    }
}

fn words(found: &Screening) -> Vec<(String, f64)> {
    let names: Vec<String> = (1..=6).map(|j| format!("joint{j}")).collect();
    found.readings.iter().map(|r| (r.text(&names), (1e3 * r.probability).round() / 1e3)).collect()
}

/// A change of a log, and the reading that is right: name and joints.
type Kind = (&'static str, fn(&mut Log, &Robot, &mut Random) -> Vec<usize>);

const KINDS: [Kind; 17] = [
    ("torque_sign", |log, _, random| {
        let j = random.below(6);
        Log::scale(&mut log.tau[j], -1.0);
        vec![j]
    }),
    ("torque_sign", |log, _, _| {
        for t in &mut log.tau {
            Log::scale(t, -1.0);
        }
        vec![]
    }),
    ("joint_reversed", |log, _, random| {
        let j = 1 + random.below(3);
        Log::scale(&mut log.tau[j], -1.0);
        Log::scale(&mut log.q[j], -1.0);
        vec![j]
    }),
    ("position_unit", |log, _, _| {
        for q in &mut log.q {
            Log::scale(q, 1.0 / TAU);
        }
        vec![]
    }),
    ("position_unit", |log, _, random| {
        let factor = [0.5, 1e3, 360.0 / TAU][random.below(3)];
        for q in &mut log.q {
            Log::scale(q, factor);
        }
        vec![]
    }),
    ("position_unit", |log, _, random| {
        let j = 1 + random.below(4);
        Log::scale(&mut log.q[j], [1.0 / TAU, 0.5, 360.0 / TAU][random.below(3)]);
        vec![j]
    }),
    ("torque_unit", |log, _, random| {
        let factor = [1e3, 100.0, 1.0 / 9.80665][random.below(3)];
        for t in &mut log.tau {
            Log::scale(t, factor);
        }
        vec![]
    }),
    ("torque_unit", |log, _, random| {
        let j = random.below(6);
        Log::scale(&mut log.tau[j], [1e-3, 0.1, 30.0][random.below(3)]);
        vec![j]
    }),
    ("torque_unit_per_joint", |log, robot, random| {
        for (tau, limit) in log.tau.iter_mut().zip(&robot.limit) {
            Log::scale(tau, random.between(0.7, 1.4) * 1000.0 / limit);
        }
        vec![]
    }),
    ("torque_exchanged", |log, _, random| {
        let a = random.below(5);
        log.tau.swap(a, a + 1);
        vec![a, a + 1]
    }),
    ("joints_exchanged", |log, _, random| {
        let a = random.below(5);
        log.tau.swap(a, a + 1);
        log.q.swap(a, a + 1);
        vec![a, a + 1]
    }),
    ("joints_back_to_front", |log, _, _| {
        log.tau.reverse();
        log.q.reverse();
        vec![]
    }),
    ("torque_late", |log, _, random| {
        let seconds = random.between(0.025, 0.16);
        (0..6).for_each(|j| log.delay(j, seconds));
        vec![]
    }),
    ("torque_late", |log, _, random| {
        let j = random.below(6);
        log.delay(j, random.between(0.05, 0.16));
        vec![j]
    }),
    ("torque_unsigned", |log, _, _| {
        log.tau.iter_mut().flatten().for_each(|t| *t = t.abs());
        vec![]
    }),
    ("torque_unsigned", |log, _, random| {
        let j = random.below(6);
        log.tau[j].iter_mut().for_each(|t| *t = t.abs());
        vec![j]
    }),
    ("joint_zero", |log, _, random| {
        let j = 1 + random.below(3);
        let angle = [0.25, -0.25, 0.5][random.below(3)] * TAU;
        log.q[j].iter_mut().for_each(|q| *q += angle);
        vec![j]
    }),
];

/// What became of faults of each kind: right names and joints, silent, something else; `draw`: arm, its values and the file.
fn outcomes(
    seeds: std::ops::Range<u64>,
    draw: impl Fn(u64, &mut Random) -> (Robot, Vec<f64>, Robot),
) -> Vec<(&'static str, [usize; 3])> {
    let mut all = Vec::new();
    for (place, (name, change)) in KINDS.iter().enumerate() {
        let mut counts = [0; 3];
        for seed in seeds.clone() {
            let mut random = Random(1 + 1000 * place as u64 + seed);
            let (robot, x, file) = draw(seed, &mut random);
            let mut log = Log::new(&robot, &x, &mut random);
            let joints = change(&mut log, &robot, &mut random);
            let found = file.screen(&log).expect("motion");
            let is_right = |r: &Reading| r.faults.len() == 1 && r.name() == *name && r.faults[0].joints() == joints;
            let outcome = found.finding().map_or(1, |reading| if is_right(reading) { 0 } else { 2 });
            counts[outcome] += 1;
            if outcome > 0 {
                println!("{name} {joints:?}, seed {seed}: {:?}", words(&found));
            }
        }
        println!("{name}: {} right, {} silent, {} other", counts[0], counts[1], counts[2]);
        all.push((*name, counts));
    }
    all
}

/// Every kind, on several arms, motions, rates, noises and joints each: right names and joints, and how often something else.
#[test]
fn names_each_fault_of_the_channels_with_its_joints() {
    let all = outcomes(0..2, |_, random| {
        let robot = Robot::new(random);
        let x = robot.off(random);
        (robot.clone(), x, robot)
    });
    let sum = |outcome: usize| all.iter().map(|(_, counts)| counts[outcome]).sum::<usize>();
    let [right, silent, wrong] = [0, 1, 2].map(sum);
    println!("{right} right, {silent} silent, {wrong} other");
    // An exchange or a sign about axes that the motion hardly loads has several readings; another one is never certain.
    assert!(wrong <= 1 && right >= 28, "{right} right, {silent} silent, {wrong} other of 34");
}

/// The same on six arms with files that nobody tuned: what is not certain is not reported.
#[test]
fn reports_no_other_fault_where_the_file_is_mistuned_as_well() {
    let all = outcomes(10..14, |seed, random| {
        let robot = Robot::any(random);
        let (x, file) = mistuned((seed as usize + random.below(MISTUNED.len())) % MISTUNED.len(), &robot, random);
        (robot, x, file)
    });
    let sum = |outcome: usize| all.iter().map(|(_, counts)| counts[outcome]).sum::<usize>();
    let [right, silent, wrong] = [0, 1, 2].map(sum);
    println!("{right} right, {silent} silent, {wrong} other");
    assert!(wrong * 20 <= right + silent + wrong && right * 3 >= 2 * (right + silent), "{right}, {silent}, {wrong}");
}

/// A file as a new user writes it, and what its arm has beside it.
const MISTUNED: [&str; 10] = [
    "sound file",
    "friction 0",
    "rotor inertia 0",
    "friction and rotor inertia 0",
    "payload missing",
    "large offsets",
    "friction and rotor inertia 0, payload missing, offsets",
    "worn drives",
    "last body too much",
    "rough bodies and Stribeck friction",
];

/// The arm's values and the file of one kind of [`MISTUNED`].
fn mistuned(kind: usize, robot: &Robot, random: &mut Random) -> (Vec<f64>, Robot) {
    let mut x = robot.off(random);
    let mut file = robot.clone();
    let joints = robot.limit.len();
    let of = |is: fn(&Parameter) -> bool| {
        let all = robot.model.parameters.iter().enumerate().filter(move |(_, p)| is(p));
        all.map(|(at, _)| at).collect::<Vec<usize>>()
    };
    let friction = of(|p| matches!(p, Parameter::Coulomb(_) | Parameter::Viscous(_)));
    let rotors = of(|p| matches!(p, Parameter::RotorInertia(_)));
    let offsets = of(|p| matches!(p, Parameter::Offset(_)));
    if [1, 3, 6].contains(&kind) {
        for at in &friction {
            file.nominal[*at] = 0.0;
        }
    }
    if [2, 3, 6].contains(&kind) {
        for at in &rotors {
            file.nominal[*at] = 0.0;
        }
    }
    if [4, 6].contains(&kind) {
        let mass: f64 = (0..joints).map(|j| robot.nominal[10 * j]).sum();
        let mass = random.between(0.03, 0.1) * mass;
        let c = [random.between(-0.05, 0.05), random.between(-0.05, 0.05), random.between(0.05, 0.15)];
        let square: f64 = c.iter().map(|c| c * c).sum();
        let last = &mut x[10 * (joints - 1)..10 * joints];
        last[0] += mass;
        (0..3).for_each(|k| last[1 + k] += mass * c[k]);
        for (at, (a, b)) in [(0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)].into_iter().enumerate() {
            last[4 + at] += mass * (f64::from(u8::from(a == b)) * square - c[a] * c[b]);
        }
    }
    if [5, 6].contains(&kind) {
        offsets.iter().enumerate().for_each(|(j, at)| x[*at] += 0.03 * robot.limit[j] * random.normal());
    }
    if kind == 7 {
        friction.iter().chain(&rotors).for_each(|at| x[*at] *= random.between(0.5, 2.0));
    }
    if kind == 8 {
        x[10 * (joints - 1)..10 * joints].iter_mut().for_each(|x| *x *= 0.2);
    }
    if kind == 9 {
        for body in x[..10 * joints].chunks_exact_mut(10) {
            let factor = random.between(0.7, 1.3);
            for x in body {
                *x *= factor;
            }
        }
    }
    (x, file)
}

/// Values of the arm that a log shows are not faults of its channels: sound logs of arms with files that nobody tuned.
#[test]
fn reports_nothing_of_sound_logs_with_mistuned_files() {
    let case = |seed: u64| {
        let mut random = Random(7700 + 13 * seed);
        let kind = seed as usize % MISTUNED.len();
        let robot = Robot::any(&mut random);
        let (x, file) = mistuned(kind, &robot, &mut random);
        let mut log = Log::new(&robot, &x, &mut random);
        if kind == 9 {
            log.add_stribeck(&robot, &mut random);
        }
        let found = file.screen(&log).expect("motion");
        found.finding().map(|_| (seed, MISTUNED[kind], words(&found)))
    };
    let said: Vec<_> = (0..100_u64).into_par_iter().filter_map(case).collect();
    println!("{} of 100 are reported", said.len());
    assert!(said.is_empty(), "{said:#?}");
}

/// The whole-arm explanations are named among the readings: friction that drifts, a sensor behind the gear, a load.
#[test]
fn names_what_the_arm_is_like() {
    let top = |robot: &Robot, log: &Log| -> Reading { robot.screen(log).expect("motion").readings.remove(0) };
    for seed in 0..4 {
        let mut random = Random(500 + seed);
        let robot = Robot::new(&mut random);
        let mut x = robot.off(&mut random);
        let at_motor = Log::new(&robot, &x, &mut random);
        let found = top(&robot, &at_motor);
        assert!(found.is_sound(), "{seed}: {found:?}");
        x[60..78].fill(0.0);
        let behind_gear = Log::new(&robot, &x, &mut random);
        let found = top(&robot, &behind_gear);
        assert_eq!(found.name(), "link_side_sensor", "{seed}: {found:?}");
    }
}

/// A driver's external torque is what its model of the arm misses.
#[test]
fn names_torque_that_the_model_is_subtracted_from() {
    for seed in 0..4 {
        let mut random = Random(4100 + seed);
        let robot = Robot::new(&mut random);
        let x = robot.off(&mut random);
        let missed: Vec<f64> = x.iter().zip(&robot.nominal).map(|(x, nominal)| x - nominal).collect();
        let log = Log::new(&robot, &missed, &mut random);
        let found = robot.screen(&log).expect("motion");
        assert_eq!(found.finding().map(Reading::name), Some("external_torque"), "{seed}: {:?}", words(&found));
        let whole = Log::new(&robot, &x, &mut random);
        assert_eq!(robot.screen(&whole).expect("motion").finding(), None, "{seed}");
    }
}

/// A controller's integrators wind up while the drive gives its limit: the log's torque is many times what acts.
#[test]
fn commands_beyond_the_limit_are_no_other_unit() {
    for seed in 0..6 {
        let mut random = Random(310 + seed);
        let mut robot = Robot::new(&mut random);
        let x = robot.off(&mut random);
        let mut log = Log::new(&robot, &x, &mut random);
        let j = 1 + random.below(3);
        let largest = log.tau[j].iter().fold(0.0_f64, |m, tau| m.max(tau.abs()));
        // Drives may give less than their file says.
        let given = 0.85 * largest;
        robot.limit[j] = given / random.between(0.3, 1.0);
        let windup = random.between(5.0, 12.0);
        for tau in &mut log.tau[j] {
            if tau.abs() > given {
                *tau = tau.signum() * (windup * (tau.abs() - given) + 4.0 * largest);
            }
        }
        let found = robot.screen(&log).expect("motion");
        println!("{seed}: {:?}", words(&found));
        assert_eq!(found.finding(), None, "{:?}", words(&found));
        assert_eq!(found.readings[0].name(), "torque_beyond_limit", "{:?}", words(&found));
    }
}

/// A channel of noise has nothing of the arm, so that it has no unit of it either.
#[test]
fn reads_no_unit_from_noise() {
    for seed in 0..6 {
        let mut random = Random(610 + seed);
        let robot = Robot::new(&mut random);
        let x = robot.off(&mut random);
        let mut log = Log::new(&robot, &x, &mut random);
        let (j, size) = (random.below(3), random.between(0.03, 0.4));
        log.tau[j].iter_mut().for_each(|tau| *tau = size * robot.limit[j] * random.normal());
        let found = robot.screen(&log).expect("motion");
        let units = found.readings.iter().filter(|r| r.name() == "torque_unit").map(|r| r.probability);
        assert!(units.sum::<f64>() < 0.5, "{seed}: {:?}", words(&found));
    }
}

/// Bodies that the URDF does not have are a guess; a log that shows others is no log to be read otherwise.
#[test]
fn bodies_that_are_unknown_are_no_other_reading() {
    for seed in 0..6 {
        let mut random = Random(810 + seed);
        let robot = Robot::new(&mut random);
        let x = robot.off(&mut random);
        let log = Log::new(&robot, &x, &mut random);
        let mut file = robot.clone();
        let (of, factor) = (random.below(3), random.between(0.1, 0.4));
        let mut std = vec![0.0; file.nominal.len()];
        for at in 10 * (2 + of)..60 {
            std[at] = 2.0 * file.nominal[10 * (at / 10)] * [1.0, 0.3, 0.3, 0.3, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1][at % 10];
            file.nominal[at] *= factor;
        }
        file.model = file.model.with_unknown_bodies(std);
        let found = file.screen(&log).expect("motion");
        assert_eq!(found.finding(), None, "{:?}", words(&found));
    }
}

#[test]
fn names_a_unit_of_the_urdf() {
    for seed in 0..2 {
        let mut random = Random(900 + seed);
        let mut robot = Robot::new(&mut random);
        let x = robot.off(&mut random);
        let log = Log::new(&robot, &x, &mut random);
        // About the centre of mass a URDF's inertia is what is left of that about the joint.
        for body in robot.nominal[..60].chunks_exact_mut(10) {
            let centre = [body[1] / body[0], body[2] / body[0], body[3] / body[0]];
            let square: f64 = centre.iter().map(|c| c * c).sum();
            for (at, (a, b)) in [(0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)].into_iter().enumerate() {
                let steiner = body[0] * (f64::from(u8::from(a == b)) * square - centre[a] * centre[b]);
                body[4 + at] = steiner + 1e9 * (body[4 + at] - steiner);
            }
        }
        let found = robot.screen(&log).expect("motion");
        assert_eq!(found.finding().map(Reading::name), Some("file_unit"), "{:?}", words(&found));
    }
}

#[test]
fn finds_rows_of_a_second_publisher_and_none_in_a_sound_log() {
    for seed in 0..10 {
        let mut random = Random(40 + seed);
        let robot = Robot::new(&mut random);
        let x = robot.off(&mut random);
        let mut log = Log::new(&robot, &x, &mut random);
        assert!(second_publisher(&log.q).is_empty());
        let rows = log.q[0].len();
        let pose: Vec<f64> = (0..6).map(|_| if seed % 2 == 0 { 0.0 } else { random.between(-2.0, 2.0) }).collect();
        let share = random.between(0.01, 0.4);
        let foreign: Vec<usize> = (0..rows).filter(|_| random.unit() < share).collect();
        for k in &foreign {
            (0..6).for_each(|j| log.q[j][*k] = pose[j]);
        }
        let found = second_publisher(&log.q);
        assert_eq!(found, foreign, "share {share:.2}");
    }
}
