//! What the arm stands on gives way. The plant is written here: a URDF with one more joint in front of the arm, which a spring
//! and a damper hold; the arm's joints move as prescribed, the base as the whole chain's dynamics say.

use std::f64::consts::TAU;
use std::path::Path;

use nalgebra::{DMatrix, DVector};
use rivet_config::Robot;
use rivet_diagnosis::{Cause, Diagnosis, Effect, Run, Verdict, diagnose};
use rivet_dynamics::{Arm, Workspace, friction_sign, inverse_dynamics, mass_matrix};
use rivet_logs::write_columns;
use rivet_simulation::{Disturbances, Random, Truth};
use rivet_tests::rivet;
use serde_json::Value;

/// Steps of the plant \[s\] and how many make a sample.
const STEP_S: f64 = 2.5e-4;
const STEPS: usize = 10;

/// A rotation that a spring holds.
#[derive(Clone, Copy)]
struct Spring {
    /// With all that it carries, as it is on average \[Hz\].
    hz: f64,
    damping: f64,
}

/// What the arm stands on.
#[derive(Clone, Copy)]
struct Base {
    spring: Spring,
    /// Its own inertia over the mean of the arm's.
    inertia: f64,
    /// Direction of the axis, from x \[rad\].
    heading: f64,
}

/// What gives way.
#[derive(Clone, Copy)]
enum Gives<'a> {
    /// From the floor up.
    Bases(&'a [Base]),
    /// The gear of a joint, its motor held.
    Gear(usize, Spring),
}

/// The robot's URDF with joints in front of it.
fn on_bases(arm: &str, bases: &[Base]) -> Arm {
    let file = rivet_tests::root().join("robots").join(arm).join("robot.urdf");
    let mut text = std::fs::read_to_string(file).expect("a URDF");
    // A body that moves must be one: taken out again below.
    let body = r#"<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>"#;
    if !bases.is_empty() {
        text = text.replace(r#"<link name="base_link">"#, &format!(r#"<link name="base_link">{body}"#));
    }
    let mut child = "base_link".to_owned();
    for (i, base) in bases.iter().enumerate().rev() {
        let (sin, cos) = base.heading.sin_cos();
        let joint = format!(
            r#"<link name="floor{i}">{body}</link><joint name="tilt{i}" type="revolute"><parent link="floor{i}"/><child link="{child}"/>
            <axis xyz="{cos} {sin} 0"/><limit lower="-1" upper="1" velocity="9" effort="1e6"/></joint></robot>"#
        );
        text = text.replace("</robot>", &joint);
        child = format!("floor{i}");
    }
    let mut arm = Arm::from_urdf(&text, [0.0, 0.0, -9.81]).expect("a chain");
    arm.links[..bases.len()].fill([0.0; 10]);
    arm
}

/// Moves one after the other, each joint by its own clock: speed up, go on, slow down. `pace` 1 is as hard as such arms go.
struct Moves {
    random: Random,
    pace: f64,
    state: Vec<[f64; 3]>,
    centre: Vec<f64>,
    /// Of the move of each joint: acceleration, time to speed up, whole time, time since it began.
    under_way: Vec<[f64; 4]>,
}

impl Moves {
    fn new(centre: &[f64], pace: f64, seed: u64) -> Moves {
        let state = centre.iter().map(|q| [*q, 0.0, 0.0]).collect();
        let n = centre.len();
        Moves { random: Random::new(seed), pace, state, centre: centre.to_vec(), under_way: vec![[0.0; 4]; n] }
    }

    fn step(&mut self) {
        for (j, [accel, up, whole, time]) in self.under_way.iter_mut().enumerate() {
            let [q, v, a] = &mut self.state[j];
            if *time >= *whole {
                let mut uniform = || 0.5 + 0.5 * (self.random.normal() * 1.3).tanh();
                let (far, how) = (0.15 + 0.65 * uniform(), uniform());
                let side = if *q > self.centre[j] { -1.0 } else { 1.0 };
                *whole = ((0.55 + 0.5 * how) / self.pace / STEP_S).round() * STEP_S;
                *up = (0.3 * *whole / STEP_S).round() * STEP_S;
                *accel = side * far / (*up * (*whole - *up));
                *time = 0.0;
                *v = 0.0;
            }
            let phase = |from: f64, to: f64| {
                // Torque of a drive rises in some 20 ms.
                let soft = |t: f64| (t / 0.02).clamp(0.0, 1.0);
                soft(*time - from) * soft(to - *time)
            };
            let next = *accel * (phase(0.0, *up) - phase(*whole - *up, *whole));
            let before = (*v, *a);
            *a = next;
            *v += 0.5 * STEP_S * (before.1 + *a);
            *q += 0.5 * STEP_S * (before.0 + *v);
            *time += STEP_S;
        }
    }
}

/// One joint of a chain that a spring holds instead of a drive.
struct Held {
    at: usize,
    stiffness: f64,
    damping: f64,
    angle: f64,
    rate: f64,
    accel: f64,
}

/// A chain of which some joints are held by springs.
struct Chain {
    arm: Arm,
    ws: Workspace,
    held: Vec<Held>,
    state: [Vec<f64>; 3],
    tau: Vec<f64>,
    mass: Vec<f64>,
}

impl Chain {
    fn new(arm: Arm) -> Chain {
        let n = arm.dof();
        let [q, qd, qdd, tau] = [(); 4].map(|()| vec![0.0; n]);
        Chain { ws: Workspace::new(&arm), arm, held: Vec::new(), state: [q, qd, qdd], tau, mass: vec![0.0; n * n] }
    }

    fn mass(&mut self) {
        mass_matrix(&self.arm, &self.arm.links, &mut self.ws, &self.state[0], &mut self.mass);
    }

    fn torque(&mut self) {
        let [q, qd, qdd] = &self.state;
        inverse_dynamics(&self.arm, &self.arm.links, &mut self.ws, q, qd, qdd, &mut self.tau);
    }

    /// Takes in where the last joints are and accelerates those that are held so that each carries its spring's torque.
    fn follow(&mut self, moves: &Moves) {
        let n = self.tau.len();
        let first = n - moves.state.len();
        let motor = |at: usize, i: usize| at.checked_sub(first).map_or(0.0, |j| moves.state[j][i]);
        for at in 0..n {
            for i in 0..3 {
                self.state[i][at] = motor(at, i);
            }
        }
        for h in &self.held {
            self.state[0][h.at] += h.angle;
            self.state[1][h.at] += h.rate;
        }
        self.torque();
        self.mass();
        let lacks = |h: &Held| -h.stiffness * h.angle - h.damping * h.rate - self.tau[h.at];
        let right = DVector::from_iterator(self.held.len(), self.held.iter().map(lacks));
        let own = |i: usize, j: usize| self.mass[self.held[i].at * n + self.held[j].at];
        let accels = DMatrix::from_fn(right.len(), right.len(), own).lu().solve(&right).expect("inertia");
        for (h, accel) in self.held.iter_mut().zip(&accels) {
            h.accel = *accel;
            self.state[2][h.at] += accel;
        }
        self.torque();
    }
}

/// `seconds` of work of a robot of which something gives way.
fn log(name: &str, gives: Gives<'_>, seconds: f64, pace: f64, seed: u64) -> (Robot, Run) {
    let robot = rivet_config::load(rivet_tests::robot(name)).expect("a sound robot file");
    let n = robot.dof();
    let bases = if let Gives::Bases(bases) = gives { bases } else { &[] };
    let mut chain = Chain::new(on_bases(name, bases));
    let springs: Vec<(usize, Spring)> = match gives {
        Gives::Bases(bases) => bases.iter().map(|b| b.spring).enumerate().collect(),
        Gives::Gear(joint, spring) => vec![(joint, spring)],
    };
    let centre: Vec<f64> = [0.3, -1.1, 1.2, -0.6, 0.8, 0.2][..n].to_vec();
    // The same moves once before: what the springs carry on average.
    let mut moves = Moves::new(&centre, pace, seed);
    let mut carried = vec![0.0; springs.len()];
    let size = chain.tau.len();
    let steps = (seconds / STEP_S) as usize;
    for k in 0..steps {
        moves.step();
        if k % 100 == 0 {
            chain.state[0][bases.len()..].copy_from_slice(&moves.state.iter().map(|s| s[0]).collect::<Vec<_>>());
            chain.mass();
            for (sum, (at, _)) in carried.iter_mut().zip(&springs) {
                *sum += chain.mass[at * size + at] / steps.div_ceil(100) as f64;
            }
        }
    }
    for (i, base) in bases.iter().enumerate() {
        // Inertia beside the arm's, of each axis alone: that of the last link that turns about it, without the others' axes.
        let (sin, cos) = base.heading.sin_cos();
        let own = base.inertia * carried[i];
        for (e, part) in [(4, cos * cos), (5, sin * cos), (6, sin * sin)] {
            chain.arm.links[i][e] += own * part;
        }
        carried[i] += own;
    }
    for ((at, spring), inertia) in springs.iter().zip(&carried) {
        let omega = TAU * spring.hz;
        chain.held.push(Held {
            at: *at,
            stiffness: inertia * omega * omega,
            damping: 2.0 * spring.damping * inertia * omega,
            angle: 0.0,
            rate: 0.0,
            accel: 0.0,
        });
    }
    let mut moves = Moves::new(&centre, pace, seed);
    chain.follow(&moves);
    // At rest under the first load.
    chain.state[2].fill(0.0);
    chain.torque();
    for h in &mut chain.held {
        h.angle = -chain.tau[h.at] / h.stiffness;
    }
    let mut random = Random::new(seed + 1000);
    let (mut q, mut tau) = (vec![Vec::new(); n], vec![Vec::new(); n]);
    let v0 = robot.model.structure.sign_velocity;
    for k in 0..steps {
        chain.follow(&moves);
        if k % STEPS == 0 {
            for j in 0..n {
                let [angle, speed, accel] = moves.state[j];
                let [rotor, viscous, coulomb] = [10, 11, 12].map(|i| robot.nominal[i * n + j]);
                let drive = rotor * accel + viscous * speed + coulomb * friction_sign(speed, v0);
                let noise = robot.config.simulation.torque_noise[j] * random.normal();
                tau[j].push(chain.tau[bases.len() + j] + drive + noise);
                q[j].push(((angle + 1e-6 * random.normal()) / 3e-6).round() * 3e-6);
            }
        }
        // Semi-implicit Euler: at 0.25 ms the frequency is right within 1e-4.
        for h in &mut chain.held {
            h.rate += STEP_S * h.accel;
            h.angle += STEP_S * h.rate;
        }
        moves.step();
    }
    let period_s = STEP_S * STEPS as f64;
    (robot, Run { name: "log".into(), period_s, q, tau, ..Run::default() })
}

fn found(robot: &Robot, run: Run) -> Diagnosis {
    found_beside(robot, &robot.nominal, run)
}

fn found_beside(robot: &Robot, nominal: &[f64], run: Run) -> Diagnosis {
    diagnose(&robot.model, nominal, vec![run], &mut rivet_diagnosis::Silent).expect("sound runs")
}

/// What is named, with the joints.
fn named(found: &Diagnosis) -> Vec<(Effect, Vec<&str>)> {
    found.causes.iter().map(|c| (c.effect, c.joints.iter().map(String::as_str).collect())).collect()
}

fn considered(found: &Diagnosis) -> bool {
    found.causes.iter().chain(&found.withdrawn).any(|c| c.effect == Effect::BaseFlexibility)
}

fn size(cause: &Cause, name: &str) -> f64 {
    cause.magnitude.iter().find(|(n, _)| n == name).unwrap_or_else(|| panic!("{name} in {:?}", cause.magnitude)).1
}

fn check(found: &Diagnosis, base: Base) {
    assert_eq!(named(found), [(Effect::BaseFlexibility, vec![])], "{:?}", found.causes);
    assert_eq!(found.verdict, Verdict::Effect);
    is_it(&found.causes[0], base);
    assert!(found.causes[0].shrink.measured > 0.5, "{:?}", found.causes[0].shrink);
}

fn is_it(cause: &Cause, base: Base) {
    println!("{} Hz at {}: {:.3?} {:.3?}", base.spring.hz, base.heading, cause.magnitude, cause.shrink);
    let hz = size(cause, "frequency_hz");
    assert!((hz / base.spring.hz - 1.0).abs() < 0.1, "{:?}", cause.magnitude);
    let apart = (size(cause, "axis_heading_rad") - base.heading).rem_euclid(TAU / 2.0);
    assert!(apart.min(TAU / 2.0 - apart) < 0.15, "{:?}", cause.magnitude);
    assert!((cause.shrink.predicted - cause.shrink.measured).abs() < 0.05, "{:?}", cause.shrink);
}

/// A table as heavy as the arm, and a pedestal that is lighter.
#[test]
fn a_base_that_gives_way_is_named_with_its_frequency() {
    let table = Base { spring: Spring { hz: 9.0, damping: 0.03 }, inertia: 1.5, heading: 0.5 };
    let (robot, run) = log("ur10e", Gives::Bases(&[table]), 40.0, 1.0, 1);
    check(&found(&robot, run), table);
    let pedestal = Base { spring: Spring { hz: 16.0, damping: 0.015 }, inertia: 0.6, heading: 2.0 };
    let (robot, run) = log("manutec-r3", Gives::Bases(&[pedestal]), 40.0, 1.0, 2);
    check(&found(&robot, run), pedestal);
}

/// A table that sways about both axes, at frequencies of their own.
#[test]
fn two_axes_are_two_causes() {
    let spring = |hz: f64| Spring { hz, damping: 0.03 };
    let bases = [
        Base { spring: spring(8.0), inertia: 1.0, heading: 0.2 },
        Base { spring: spring(13.0), inertia: 1.0, heading: 0.2 + 0.25 * TAU },
    ];
    let (robot, run) = log("ur10e", Gives::Bases(&bases), 40.0, 1.0, 12);
    let found = found(&robot, run);
    let both = [(Effect::BaseFlexibility, vec![]), (Effect::BaseFlexibility, vec![])];
    assert_eq!(named(&found), both, "{:?}", found.causes);
    let mut causes: Vec<&Cause> = found.causes.iter().collect();
    causes.sort_by(|a, b| size(a, "frequency_hz").total_cmp(&size(b, "frequency_hz")));
    for (cause, base) in causes.into_iter().zip(bases) {
        is_it(cause, base);
    }
}

/// Every value of the file is wrong as well: bodies by 6 %, rotors by 9 %, friction by 18 %.
#[test]
fn wrong_values_do_not_hide_a_base_that_gives_way() {
    let table = Base { spring: Spring { hz: 12.0, damping: 0.02 }, inertia: 1.0, heading: 1.2 };
    let (robot, run) = log("ur10e", Gives::Bases(&[table]), 40.0, 1.0, 9);
    let n = robot.dof();
    let mut random = Random::new(10);
    let mut nominal = robot.nominal.clone();
    for link in nominal[..10 * n].chunks_mut(10) {
        let factor = 1.0 + 0.06 * random.normal();
        for e in link {
            *e *= factor;
        }
    }
    for (k, wrong) in [0.09, 0.18, 0.18].into_iter().enumerate() {
        for e in &mut nominal[(10 + k) * n..(11 + k) * n] {
            *e *= 1.0 + wrong * random.normal();
        }
    }
    let found = found_beside(&robot, &nominal, run);
    let structure = |c: &&Cause| c.effect.kind() == rivet_diagnosis::Kind::Structure;
    let causes: Vec<&Cause> = found.causes.iter().filter(structure).collect();
    assert_eq!(causes.iter().map(|c| c.effect).collect::<Vec<_>>(), [Effect::BaseFlexibility], "{:?}", found.causes);
    let hz = size(causes[0], "frequency_hz");
    assert!((hz / table.spring.hz - 1.0).abs() < 0.1, "{:?}", causes[0].magnitude);
    assert!((causes[0].shrink.predicted - causes[0].shrink.measured).abs() < 0.05, "{:?}", causes[0].shrink);
}

/// The same arm, the same moves, a base a thousand times as stiff.
#[test]
fn a_stiff_base_is_not_named() {
    for (arm, seed) in [("ur10e", 3), ("manutec-r3", 4)] {
        let stiff = Base { spring: Spring { hz: 300.0, damping: 0.03 }, inertia: 1.5, heading: 0.5 };
        let (robot, run) = log(arm, Gives::Bases(&[stiff]), 40.0, 1.0, seed);
        let found = found(&robot, run);
        assert_eq!((found.verdict, considered(&found)), (Verdict::NoGap, false), "{:?}", found.causes);
    }
}

/// One joint's gear is a spring: its neighbours feel it too, but not as they feel a base.
#[test]
fn an_elastic_joint_is_no_base() {
    for (joint, hz, seed) in [(1, 9.0, 5), (2, 14.0, 6)] {
        let (robot, run) = log("ur10e", Gives::Gear(joint, Spring { hz, damping: 0.05 }), 40.0, 1.0, seed);
        let name = robot.model.arm.joints[joint].name.clone();
        let found = found(&robot, run);
        assert_eq!(named(&found), [(Effect::JointElasticity, vec![name.as_str()])], "{:?}", found.causes);
        assert!(!considered(&found));
    }
}

/// A log of 20 samples a second does not pass a mode, and slow moves do not tell one: it is not considered.
#[test]
fn what_a_log_cannot_show_is_not_considered() {
    let table = Base { spring: Spring { hz: 9.0, damping: 0.03 }, inertia: 1.5, heading: 0.5 };
    let (robot, mut run) = log("ur10e", Gives::Bases(&[table]), 60.0, 1.0, 7);
    for signal in run.q.iter_mut().chain(&mut run.tau) {
        *signal = signal.iter().step_by(20).copied().collect();
    }
    run.period_s *= 20.0;
    let coarse = found(&robot, run);
    assert!(!considered(&coarse), "{:?}", coarse.causes);
    let (robot, run) = log("ur10e", Gives::Bases(&[table]), 60.0, 0.06, 8);
    let slow = found(&robot, run);
    assert!(!considered(&slow), "{:?}", slow.causes);
}

/// The file with what was found predicts the log it was found in, says who leaves the base out, and nothing is left to name.
#[test]
fn what_is_handed_on_sways_along_a_log() {
    let table = Base { spring: Spring { hz: 9.0, damping: 0.03 }, inertia: 1.5, heading: 0.5 };
    let (robot, run) = log("ur10e", Gives::Bases(&[table]), 40.0, 1.0, 1);
    let folder = tempfile::tempdir().expect("a folder");
    let place = |name: &str| folder.path().join(name);
    let t: Vec<f64> = (0..run.len()).map(|k| k as f64 * run.period_s).collect();
    let names: Vec<String> =
        ["q", "tau"].iter().flat_map(|s| (1..=robot.dof()).map(move |j| format!("{s}{j}"))).collect();
    let signals = run.q.iter().chain(&run.tau).map(Vec::as_slice);
    let columns: Vec<(&str, &[f64])> =
        [("t", t.as_slice())].into_iter().chain(names.iter().map(String::as_str).zip(signals)).collect();
    write_columns(&place("log.parquet"), &columns).expect("written");
    let of_file = |file: &Path, export: bool| -> Value {
        let mut command = rivet();
        command.arg("diagnose").arg(file).arg(place("log.parquet")).arg("--json").arg(place("found.json"));
        if export {
            command.arg("--export").arg(place("found"));
        }
        let output = command.output().expect("the program starts");
        let text = std::fs::read_to_string(place("found.json"))
            .unwrap_or_else(|why| panic!("{why}\n{}", String::from_utf8_lossy(&output.stderr)));
        serde_json::from_str(&text).expect("JSON")
    };
    let first = of_file(&rivet_tests::robot("ur10e"), true);
    assert_eq!(first["causes"][0]["effect"], "base_flexibility", "{first:#}");
    let notes = std::fs::read_to_string(place("found/not-expressible.md")).expect("notes");
    for line in [
        "| base flexibility of all joints | missing | a body under the arm is not written |",
        "| base flexibility of all joints | missing | a URDF has no place for it |",
        "* `[effects.base_flexibility]`: the base has a state of its own",
    ] {
        assert!(notes.contains(line), "{line}\n{notes}");
    }
    let file = place("found/model.toml");
    let model = rivet_config::load(&file).unwrap_or_else(|why| panic!("{why}"));
    // What rivetd and rivet-controller say when they start, and the plant.
    for said in [
        model.model.effects_left_out(),
        Truth::new(&model.model, &model.config.nominal_joints(), &Disturbances::default()).left_out(),
    ] {
        assert!(said.iter().any(|s| s.starts_with("[effects.base_flexibility] of all joints is ")), "{said:?}");
    }
    let mut predict = rivet();
    predict.arg("predict").arg(&file).arg(place("log.parquet")).arg("--out").arg(place("predicted.parquet"));
    let output = rivet_tests::succeed(&mut predict);
    assert!(!String::from_utf8_lossy(&output.stderr).contains("left out"), "{output:?}");
    let again = of_file(&file, false);
    let causes = again["causes"].as_array().expect("causes");
    assert!(causes.iter().all(|c| c["effect"] != "base_flexibility"), "{again:#}");
    let gap = |of: &Value, name: &str| of["gap"][name].as_f64().expect("a gap");
    let (before, after) = (gap(&first, "before"), gap(&first, "after"));
    assert!(gap(&again, "before") < 1.3 * after && after < 0.5 * before, "{before} {after} {}", gap(&again, "before"));
}
