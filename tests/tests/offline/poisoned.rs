//! Parameter messages of every wrong kind, while an arm moves: no command beyond the limits, no step beyond the rate, and
//! the arm stays on its way.

use proptest::prelude::*;
use rivet_config::{Law, Robot};
use rivet_controller::Core;
use rivet_ipc_schema::{ControllerHealth, JointState, MAX_PARAMETERS, Parameters};
use rivet_simulation::motion::{Fourier, FourierSettings, MotionLimits, load_ratio};
use rivet_simulation::{Disturbances, Random};
use rivet_tests::closed::ClosedLoop;
use rivet_tests::robot;
use std::sync::LazyLock;

/// The true arm: heavier, with more friction than the file says.
fn disturbances() -> Disturbances {
    Disturbances { bodies: 1.15, friction: 1.4, ..Disturbances::default() }
}

/// What a run came to.
#[derive(Debug)]
struct Outcome {
    /// Largest command and largest step, in parts of what is permitted.
    torque: f64,
    step: f64,
    /// Largest distance from the plan \[rad\].
    error: f64,
    accepted: u64,
    refused: u64,
    /// Changes of the source of parameters.
    switches: u64,
}

/// Samples after which good sets may be judged: two seconds of motion.
const FIRST: u64 = 2000;

/// Five seconds of motion during which `attack` may replace each message of a daemon that knows the truth.
fn run(robot: &Robot, mut attack: impl FnMut(&Parameters, &JointState, &mut Vec<Parameters>)) -> Outcome {
    let n = robot.dof();
    let limits = MotionLimits::of(&robot.model.arm, 0.5);
    let mut load = load_ratio(&robot.model, &robot.nominal, &robot.config.drive.torque_limit);
    let settings = FourierSettings { base_hz: 0.25, ..FourierSettings::default() };
    let trajectory = Box::new(Fourier::new(&limits, &settings, &mut load));
    let mut controller = Core::new(robot, 0).expect("sound settings");
    let mut good = Parameters {
        model_hash: robot.hash,
        count: robot.base.len() as u32,
        joints: n as u32,
        sample_period_s: robot.config.sample_period_s,
        ..Parameters::default()
    };
    good.values[..robot.base.len()].copy_from_slice(&ClosedLoop::truth(robot, &disturbances()));
    let mut sent = Vec::new();
    let mut outcome = Outcome { torque: 0.0, step: 0.0, error: 0.0, accepted: 0, refused: 0, switches: 0 };
    let mut last = [0.0; 8];
    let limit = robot.config.drive.torque_limit.clone();
    let mut plant = ClosedLoop::new(robot, &disturbances(), trajectory, 3);
    plant.run(
        &mut controller,
        5.0,
        |controller, sample, _| {
            (good.seq, good.epoch) = (sample.seq, sample.seq);
            sent.clear();
            attack(&good, sample, &mut sent);
            for set in &sent {
                controller.offer_parameters(set, sample);
            }
        },
        |period| {
            for j in 0..n {
                let tau = period.command.tau[j];
                assert!(tau.is_finite());
                outcome.torque = outcome.torque.max(tau.abs() / limit[j]);
                outcome.step = outcome.step.max((tau - last[j]).abs() / (0.01 * limit[j]));
                outcome.error = outcome.error.max((period.setpoint.q[j] - period.q[j]).abs());
                last[j] = tau;
            }
        },
    );
    let counts = controller.counts();
    (outcome.accepted, outcome.refused) = (counts.accepted, counts.refused);
    let mut health = ControllerHealth::default();
    controller.write_health(&mut health);
    outcome.switches = health.switches;
    outcome
}

/// Largest distance from the plan with the robot file's parameters, and with the true ones.
fn references(robot: &Robot) -> (f64, f64) {
    let nominal = run(robot, |_, _, _| ());
    let truth = run(robot, |good, sample, out| {
        if sample.seq % 100 == 0 {
            out.push(*good);
        }
    });
    assert!(truth.accepted > 10, "{truth:?}");
    (nominal.error, truth.error)
}

/// Commands within limits and rate; and never further from the plan than the robot file's parameters lead, but for a
/// little: sets that predict as well as those in use may be anywhere between.
fn sound(outcome: &Outcome, nominal_error: f64) -> Result<(), String> {
    let fits = outcome.torque <= 1.0 && outcome.step <= 1.0 + 1e-9 && outcome.error <= 1.25 * nominal_error;
    if fits { Ok(()) } else { Err(format!("{outcome:?}; with the robot file's parameters {nominal_error} rad")) }
}

/// A way to spoil a message.
#[derive(Clone, Debug)]
enum Poison {
    NotFinite { at: usize, which: u8 },
    SignFlip { at: usize },
    AllFlipped,
    SwappedJoints { a: usize, b: usize },
    Scaled { factor: f64 },
    Perturbed { seed: u64, size: f64 },
    Epoch { epoch: u64 },
    Replayed { age: u64 },
    Future { ahead: u64 },
    Count { count: u32 },
    OtherModel,
    OtherPeriod { factor: f64 },
    Std { value: f64 },
}

impl Poison {
    fn apply(&self, robot: &Robot, good: &Parameters) -> Parameters {
        let n = robot.base.len();
        let mut set = *good;
        match *self {
            Poison::NotFinite { at, which } => {
                set.values[at % n] = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX][which as usize % 4];
            }
            Poison::SignFlip { at } => set.values[at % n] = -set.values[at % n],
            Poison::AllFlipped => set.values.iter_mut().for_each(|x| *x = -*x),
            Poison::SwappedJoints { a, b } => {
                let (a, b) = (a % robot.dof(), b % robot.dof());
                for word in ["viscous", "coulomb", "rotor_inertia"] {
                    let joint = |j: usize| format!("j{}.{word}", j + 1);
                    let at = |j| (0..n).find(|&i| robot.base.name(&robot.model, i).starts_with(&joint(j)));
                    if let (Some(a), Some(b)) = (at(a), at(b)) {
                        set.values.swap(a, b);
                    }
                }
            }
            Poison::Scaled { factor } => set.values.iter_mut().for_each(|x| *x *= factor),
            Poison::Perturbed { seed, size } => perturb(&mut set.values[..n], &mut Random::new(seed), size),
            Poison::Epoch { epoch } => set.epoch = epoch,
            Poison::Replayed { age } => {
                set.seq = set.seq.saturating_sub(age);
                set.epoch = set.epoch.saturating_sub(age);
            }
            Poison::Future { ahead } => set.seq = set.seq.saturating_add(ahead),
            Poison::Count { count } => set.count = count,
            Poison::OtherPeriod { factor } => set.sample_period_s *= factor,
            Poison::OtherModel => set.model_hash ^= 1 << 40,
            Poison::Std { value } => set.std = [value; MAX_PARAMETERS],
        }
        set
    }
}

/// Every value by a random share of itself, and of the typical size of all.
fn perturb(values: &mut [f64], random: &mut Random, size: f64) {
    let typical = values.iter().map(|x| x.abs()).sum::<f64>() / values.len() as f64;
    for x in values {
        *x += size * (random.normal() * x.abs() + 0.1 * random.normal() * typical);
    }
}

fn poison() -> impl Strategy<Value = Poison> {
    let any_place = 0_usize..128;
    prop_oneof![
        (any_place.clone(), any::<u8>()).prop_map(|(at, which)| Poison::NotFinite { at, which }),
        any_place.prop_map(|at| Poison::SignFlip { at }),
        Just(Poison::AllFlipped),
        (0_usize..8, 0_usize..8).prop_map(|(a, b)| Poison::SwappedJoints { a, b }),
        (-3.0..3.0_f64).prop_map(|x| Poison::Scaled { factor: 10_f64.powf(x) }),
        (any::<u64>(), -4.0..2.0_f64).prop_map(|(seed, x)| Poison::Perturbed { seed, size: 10_f64.powf(x) }),
        prop_oneof![Just(0), Just(u64::MAX), any::<u64>()].prop_map(|epoch| Poison::Epoch { epoch }),
        (0_u64..5000).prop_map(|age| Poison::Replayed { age }),
        prop_oneof![1_u64..100, Just(u64::MAX)].prop_map(|ahead| Poison::Future { ahead }),
        prop_oneof![0_u32..200, Just(u32::MAX)].prop_map(|count| Poison::Count { count }),
        Just(Poison::OtherModel),
        prop_oneof![Just(f64::NAN), Just(0.0), 0.1..10.0_f64].prop_map(|factor| Poison::OtherPeriod { factor }),
        prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(-1.0)].prop_map(|value| Poison::Std { value }),
    ]
}

/// The two-link arm under either law, and its largest distance from the plan with the robot file's parameters.
fn two_links(law: Law) -> &'static (Robot, f64) {
    static BOTH: LazyLock<[(Robot, f64); 2]> = LazyLock::new(|| {
        [Law::ComputedTorque, Law::FeedForwardPd].map(|law| {
            let mut robot = rivet_config::load(robot("dd2")).expect("sound");
            robot.config.controller.law = law;
            let (nominal, _) = references(&robot);
            (robot, nominal)
        })
    });
    &BOTH[usize::from(law == Law::FeedForwardPd)]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, failure_persistence: None, ..ProptestConfig::default() })]

    /// Bursts of poison among good messages. Each burst is `(start, length)` in periods; within it every period brings one.
    #[test]
    fn no_message_hurts(
        bursts in proptest::collection::vec((poison(), 0_u64..5000, 1_u64..400), 1..12),
        law in prop_oneof![Just(Law::ComputedTorque), Just(Law::FeedForwardPd)],
    ) {
        let (robot, nominal) = two_links(law);
        let outcome = run(robot, |good, sample, out| {
            if sample.seq % 100 == 0 {
                out.push(*good);
            }
            for (poison, start, length) in &bursts {
                if (*start..start + length).contains(&sample.seq) {
                    out.push(poison.apply(robot, good));
                }
            }
        });
        prop_assert!(sound(&outcome, *nominal).is_ok(), "{}", sound(&outcome, *nominal).unwrap_err());
    }
}

/// Two random sets a period, of every size from a ten-thousandth to ten times the values: 10^4 in five seconds of a six-axis
/// arm. Once good sets act, and with a good one now and then or none at all from then on.
#[test]
fn ten_thousand_random_sets_do_not_move_the_arm_off_its_way() {
    let robot = rivet_config::load(robot("manutec-r3")).expect("sound");
    let (nominal, truth) = references(&robot);
    for honest in [true, false] {
        let mut random = Random::new(17);
        let (mut sent, mut good_sent) = (0, 0);
        let outcome = run(&robot, |good, sample, out| {
            // Enough in a row for live parameters, then one in ten periods.
            let trusted = sample.seq > FIRST && good_sent > robot.config.controller.return_after + 10;
            if !trusted {
                if sample.seq > FIRST && sample.seq % 10 == 0 {
                    out.push(Parameters { epoch: 4 * sample.seq, ..*good });
                    good_sent += 1;
                }
                return;
            }
            for part in 1..=4 {
                let mut set = *good;
                set.epoch = 4 * sample.seq + part;
                let size = 10_f64.powf(random.uniform(-4.0, 1.0));
                perturb(&mut set.values[..robot.base.len()], &mut random, size);
                out.push(set);
                sent += 1;
            }
            if honest && sample.seq % 100 == 0 {
                out.push(Parameters { epoch: 4 * sample.seq + 4, ..*good });
            }
        });
        assert!(sent >= 10_000, "{sent}");
        assert!(outcome.refused > sent / 2, "{outcome:?}");
        assert!(outcome.switches > 0, "live parameters were in use: {outcome:?}");
        sound(&outcome, nominal).unwrap_or_else(|why| panic!("{why}"));
        println!(
            "{} accepted, {} refused, {} switches; largest error {:.2e} rad, nominal {nominal:.2e}, truth {truth:.2e}; \
             torque {:.2}, step {:.2} of what is permitted",
            outcome.accepted, outcome.refused, outcome.switches, outcome.error, outcome.torque, outcome.step
        );
    }
}

/// Sets with one wrong sign, seven in seven periods, while good ones were kept from acting: the first seconds of motion do not
/// show every sign beside the friction that the robot file has wrong.
#[test]
fn a_row_of_one_wrong_sign_does_not_act_before_it_is_seen() {
    for law in [Law::ComputedTorque, Law::FeedForwardPd] {
        let (robot, nominal) = two_links(law);
        for (start, at) in [1401, 1501].into_iter().flat_map(|start| (0..robot.base.len()).map(move |at| (start, at))) {
            let outcome = run(robot, |good, sample, out| {
                if sample.seq % 100 == 0 {
                    out.push(*good);
                } else if (start - 300..start).contains(&sample.seq) && sample.seq % 50 == 20 {
                    out.push(Poison::OtherModel.apply(robot, good));
                } else if (start..start + 7).contains(&sample.seq) {
                    out.push(Poison::SignFlip { at }.apply(robot, good));
                }
            });
            sound(&outcome, *nominal).unwrap_or_else(|why| panic!("{law:?}, parameter {at} from {start} on: {why}"));
            assert!(outcome.switches > 0, "good ones act in the end: {outcome:?}");
        }
    }
}
