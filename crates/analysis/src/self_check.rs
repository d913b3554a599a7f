//! `rivet diagnose --self-check`: what these very logs would have shown. Effects of graded strength, made by the physics of
//! the simulated plant along the logs' own motion, are added to the measured torque; the diagnosis is asked what it finds.

use std::num::NonZero;
use std::thread;

use anyhow::{Result, bail};
use rivet_config::Robot;
use rivet_diagnosis::{Effect, Named, Probe, Run, Silent, probe};
use rivet_dynamics::{Workspace, mass_matrix};
use rivet_report::{Power, SelfCheck};
use rivet_simulation::{Injected, Injector, Random, Recorded};

/// More of the logs than this \[s\] is not looked at: two minutes are what a person waits.
const LONGEST_S: f64 = 60.0;
/// Strengths of each effect, each twice the one before.
const LEVELS: i32 = 6;
/// Resamplings of the residual, in which nothing was added.
const RESAMPLINGS: usize = 40;

/// Effects that are added, as functions of joint and strength: strength 1 is large.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Stribeck,
    LoadFriction,
    Asymmetry,
    Cubic,
    PositionFriction,
    Ripple,
    Gain,
    Spring,
    Elasticity,
    Backlash,
    Presliding,
    EncoderOffset,
    EncoderEccentricity,
    Delay,
    Lag,
    Tilt,
    Payload,
}

/// Those that act on one joint, and those that act on the whole arm.
const ON_JOINTS: [Kind; 13] = [
    Kind::Stribeck,
    Kind::LoadFriction,
    Kind::Asymmetry,
    Kind::Cubic,
    Kind::PositionFriction,
    Kind::Ripple,
    Kind::Gain,
    Kind::Spring,
    Kind::Elasticity,
    Kind::Backlash,
    Kind::Presliding,
    Kind::EncoderOffset,
    Kind::EncoderEccentricity,
];
const ON_ARM: [Kind; 4] = [Kind::Delay, Kind::Lag, Kind::Tilt, Kind::Payload];

/// What strengths are measured by on one joint.
struct Typical {
    torque: f64,
    speed: f64,
    angle: f64,
    inertia: f64,
    order: f64,
}

impl Kind {
    fn effect(self) -> Effect {
        match self {
            Kind::Stribeck => Effect::StribeckFriction,
            Kind::LoadFriction => Effect::LoadDependentFriction,
            Kind::Asymmetry => Effect::FrictionAsymmetry,
            Kind::Cubic => Effect::ViscousNonlinearity,
            Kind::PositionFriction => Effect::PositionDependentFriction,
            Kind::Ripple => Effect::TorqueRipple,
            Kind::Gain => Effect::TorqueConstant,
            Kind::Spring => Effect::JointSpring,
            Kind::Elasticity => Effect::JointElasticity,
            Kind::Backlash => Effect::Backlash,
            Kind::Presliding => Effect::PreslidingFriction,
            Kind::EncoderOffset => Effect::EncoderOffset,
            Kind::EncoderEccentricity => Effect::EncoderEccentricity,
            Kind::Delay => Effect::TransportDelay,
            Kind::Lag => Effect::CurrentLoopLag,
            Kind::Tilt => Effect::GravityDirection,
            Kind::Payload => Effect::Payload,
        }
    }

    /// The effect at a strength of at most 1, its size and the unit of the size.
    fn at(self, strength: f64, joint: usize, t: &Typical) -> (Injected, f64, &'static str) {
        let s = strength;
        let torque = 0.5 * s * t.torque;
        match self {
            Kind::Stribeck => (Injected::Stribeck { joint, excess: torque, velocity: 0.05 * t.speed }, torque, "N m"),
            Kind::LoadFriction => (Injected::LoadFriction { joint, ratio: 0.4 * s }, 0.4 * s, "N m/N m"),
            Kind::Asymmetry => (Injected::FrictionAsymmetry { joint, torque }, torque, "N m"),
            Kind::Cubic => {
                let coefficient = torque / t.speed.powi(3);
                (Injected::CubicFriction { joint, coefficient }, coefficient, "N m s^3/rad^3")
            }
            Kind::PositionFriction => (Injected::PositionFriction { joint, amplitude: torque }, torque, "N m"),
            Kind::Ripple => (Injected::Ripple { joint, amplitude: torque, order: t.order }, torque, "N m"),
            Kind::Gain => (Injected::Gain { joint, error: 0.4 * s }, 0.4 * s, "of 1"),
            Kind::Spring => {
                let stiffness = torque / t.angle;
                (Injected::Spring { joint, stiffness }, stiffness, "N m/rad")
            }
            Kind::Elasticity => {
                // 4 Hz at strength 1, and so many times stiffer as the strength is smaller.
                let stiffness = t.inertia * (std::f64::consts::TAU * 4.0).powi(2) / s;
                (Injected::Gear { joint, stiffness, play: 0.0 }, stiffness, "N m/rad")
            }
            Kind::Backlash => {
                let play = 0.016 * s;
                let stiffness = t.inertia * (std::f64::consts::TAU * 40.0).powi(2);
                (Injected::Gear { joint, stiffness, play }, play, "rad")
            }
            Kind::Presliding => (Injected::Presliding { joint, length: 0.1 * s }, 0.1 * s, "rad"),
            Kind::EncoderOffset => (Injected::EncoderOffset { joint, offset: 0.1 * s }, 0.1 * s, "rad"),
            Kind::EncoderEccentricity => {
                (Injected::EncoderEccentricity { joint, amplitude: 0.05 * s }, 0.05 * s, "rad")
            }
            Kind::Delay => (Injected::Delay { seconds: 0.012 * s }, 0.012 * s, "s"),
            Kind::Lag => (Injected::Lag { seconds: 0.012 * s }, 0.012 * s, "s"),
            Kind::Tilt => (Injected::Tilt { angle: 0.1 * s }, 0.1 * s, "rad"),
            Kind::Payload => (Injected::Payload { mass: 8.0 * s }, 8.0 * s, "kg"),
        }
    }

    /// Whether its torque repeats with an order of the joint's angle that has to be looked for.
    fn is_periodic(self) -> bool {
        self == Kind::Ripple
    }
}

/// What one worker found: powers with their places, false alarms.
type Part = (Vec<(usize, Power)>, usize);

/// The power of these runs, by effect and joint.
pub(crate) fn self_check(robot: &Robot, runs: Vec<Run>) -> Result<SelfCheck> {
    let runs = shortened(runs);
    let seconds: f64 = runs.iter().map(Run::seconds).sum();
    let joints = robot.dof();
    let mut pairs: Vec<(Kind, Option<usize>)> = ON_ARM.iter().map(|k| (*k, None)).collect();
    pairs.extend(ON_JOINTS.iter().flat_map(|k| (0..joints).map(move |j| (*k, Some(j)))));
    let workers = thread::available_parallelism().map_or(1, NonZero::get).clamp(1, 4);
    let work = |worker: usize| -> Result<Part> {
        let done = probe(&robot.model, &robot.nominal, runs.clone(), &mut Silent, |probe| {
            let recorded: Vec<Injector<'_>> = runs
                .iter()
                .map(|run| Injector::new(Recorded::of(&robot.model, &robot.nominal, run.period_s, &run.q, &run.tau)))
                .collect();
            let typical: Vec<Typical> = (0..joints).map(|j| Typical::new(robot, &runs, j)).collect();
            let mine = pairs.iter().enumerate().skip(worker).step_by(workers);
            let powers = mine.map(|(i, (kind, joint))| (i, power(robot, probe, &recorded, &typical, *kind, *joint)));
            let powers: Vec<(usize, Power)> = powers.collect();
            let alarms = (worker..RESAMPLINGS).step_by(workers).filter(|i| false_alarm(probe, *i)).count();
            (powers, alarms)
        })?;
        Ok(done)
    };
    let done: Vec<Result<Part>> = thread::scope(|scope| {
        let handles: Vec<_> = (0..workers).map(|worker| scope.spawn(move || work(worker))).collect();
        let joined = handles.into_iter().map(thread::ScopedJoinHandle::join);
        joined.map(|r| r.unwrap_or_else(|_| bail!("the self-check stopped half-way"))).collect()
    });
    let (mut powers, mut alarms) = (Vec::new(), 0);
    for part in done {
        let (own, false_ones) = part?;
        powers.extend(own);
        alarms += false_ones;
    }
    powers.sort_by_key(|p| p.0);
    Ok(SelfCheck {
        seconds,
        resamplings: RESAMPLINGS,
        false_alarms: alarms,
        powers: powers.into_iter().map(|p| p.1).collect(),
    })
}

/// The beginning of the runs, as much as is looked at.
fn shortened(runs: Vec<Run>) -> Vec<Run> {
    let mut remaining_s = LONGEST_S;
    let mut out = Vec::new();
    for mut run in runs {
        let samples = ((remaining_s / run.period_s) as usize).min(run.len());
        remaining_s -= samples as f64 * run.period_s;
        for signals in [Some(&mut run.q), Some(&mut run.tau), run.temperature.as_mut()].into_iter().flatten() {
            for signal in signals {
                signal.truncate(samples);
            }
        }
        if samples as f64 * run.period_s >= 1.0 {
            out.push(run);
        }
    }
    out
}

impl Typical {
    fn new(robot: &Robot, runs: &[Run], joint: usize) -> Typical {
        let rms = |values: &mut dyn Iterator<Item = f64>| {
            let (square, n) = values.fold((0.0, 0.0), |(s, n), v| (s + v * v, n + 1.0));
            f64::sqrt(square / f64::max(n, 1.0)).max(1e-6)
        };
        let torque = rms(&mut runs.iter().flat_map(|r| r.tau[joint].iter().copied()));
        let angles = || runs.iter().flat_map(|r| r.q[joint].iter().copied());
        let mean = angles().sum::<f64>() / angles().count().max(1) as f64;
        // Over a hundredth of a second: quantised positions have no speed from one sample to the next.
        let speed = runs
            .iter()
            .flat_map(|r| {
                let step = ((0.01 / r.period_s) as usize).max(1);
                r.q[joint].windows(step + 1).map(move |w| (w[step] - w[0]).abs() / (step as f64 * r.period_s))
            })
            .fold(1e-3, f64::max);
        let ratio = robot.config.drive.gear_ratio.get(joint).copied().unwrap_or(1.0).abs();
        Typical {
            torque,
            speed,
            angle: rms(&mut angles().map(|q| q - mean)),
            inertia: link_inertia(robot, runs, joint),
            // Once a turn of the motor, or of a small gear where that turns too fast to be seen.
            order: if ratio > 4.0 { ratio.min(60.0) } else { 12.0 },
        }
    }
}

/// What a joint moves beyond its gear, in the middle of the runs \[kg·m²\].
fn link_inertia(robot: &Robot, runs: &[Run], joint: usize) -> f64 {
    let (arm, n) = (&robot.model.arm, robot.dof());
    let Some(run) = runs.first() else { return 1.0 };
    let q: Vec<f64> = run.q.iter().map(|q| q.get(q.len() / 2).copied().unwrap_or(0.0)).collect();
    let mut m = vec![0.0; n * n];
    mass_matrix(arm, &arm.links, &mut Workspace::new(arm), &q, &mut m);
    m[joint * n + joint].max(1e-4)
}

/// The smallest strength of an effect that is found.
fn power(
    robot: &Robot,
    probe: &mut Probe<'_>,
    runs: &[Injector<'_>],
    typical: &[Typical],
    kind: Kind,
    joint: Option<usize>,
) -> Power {
    let on = joint.unwrap_or(0);
    let effect = kind.effect();
    let is = |named: &Named| {
        let place = joint.is_none_or(|j| named.joints.is_empty() || named.joints.contains(&j));
        place && (named.effect == effect || named.or.contains(&effect))
    };
    let name = |j: usize| robot.model.arm.joints[j].name.clone();
    let strength = |level: i32| 2.0_f64.powi(level + 1 - LEVELS);
    let (_, strongest, unit) = kind.at(1.0, on, &typical[on]);
    let mut result = Power {
        effect: effect.name().to_owned(),
        joint: joint.map(name),
        unit: unit.to_owned(),
        smallest: None,
        torque_nm: None,
        over_noise: None,
        strongest,
        instead: None,
        named_already: probe.found().iter().any(is),
    };
    if result.named_already {
        return result;
    }
    // Bisection: a stronger effect is found where a weaker one is.
    let (mut missed, mut found) = (-1, LEVELS);
    while found - missed > 1 {
        let level = i32::midpoint(found, missed);
        let (injected, size, _) = kind.at(strength(level), on, &typical[on]);
        let added: Vec<Vec<Vec<f64>>> = runs.iter().map(|r| r.torque(injected)).collect();
        let named = probe.named_with(&added, joint.filter(|_| kind.is_periodic()));
        if named.as_ref().is_some_and(is) {
            found = level;
            // On the joint where it is largest, in units of what the model leaves there.
            let rms = |j: usize| {
                let (square, n) = added.iter().flat_map(|r| &r[j]).fold((0.0, 0.0), |(s, n), v| (s + v * v, n + 1.0));
                f64::sqrt(square / f64::max(n, 1.0))
            };
            let over = (0..typical.len()).map(|j| (rms(j), rms(j) / probe.residual_rms()[j].max(1e-9)));
            let most = over.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or_default();
            result.smallest = Some(size);
            (result.torque_nm, result.over_noise) = (Some(most.0), Some(most.1));
        } else {
            missed = level;
            result.instead = named.map(|n| n.effect.name().to_owned());
        }
    }
    if result.smallest.is_some() {
        result.instead = None;
    }
    result
}

fn false_alarm(probe: &mut Probe<'_>, seed: usize) -> bool {
    let mut random = Random::new(seed as u64 + 1);
    probe.false_alarm(|_| random.uniform(0.0, 1.0) < 0.5).is_some()
}
