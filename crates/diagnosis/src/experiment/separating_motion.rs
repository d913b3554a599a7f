//! Separating motions: a small library, and the choice of the one that separates the members of a class best.
//!
//! Two effects that explain the same logs differ in what they say of other motion. With y what the true one adds along
//! a motion, and D and Φ(θ) the columns of the model's values and of another member of the class,
//!
//! ```text
//! S = min over (x, c, θ) of |y_logs − D x − Φ(θ) c|² + |y_motion − D x − Φ(θ) c|² + |x/p|²  −  the same of the logs alone
//! ```
//!
//! in units of each joint's noise: twice the log evidence that the motion is expected to give against the other when that
//! may still bend all values of the model and its own. Nobody knows which member is true, so each is in turn, the rival as
//! large as it must be to look like what was chosen; the motion with the largest of the smallest S is taken.

use rivet_dynamics::{Model, Workspace};

use crate::effects::Effect;
use crate::effects::Form;
use crate::effects::physics::Physics;
use crate::effects::{counterbalance, link_inertia};
use crate::model::nominal::{Nominal, standard_columns};
use crate::model::rows::Chain;
use crate::model::run::{Motion, Run};
use crate::policy::POLICY;
use crate::screen::prepared::Prepared;
use crate::screen::torque_timing::SLOW_HZ;

use expected_evidence::{Duel, Record, duels};

mod expected_evidence;

/// A motion as setpoints, `[joint][sample]`.
#[derive(Clone, Debug, PartialEq)]
pub struct SeparatingMotion {
    /// Which cause it is for.
    pub effect: Effect,
    /// On which joints, from 0.
    pub joints: Vec<usize>,
    /// What it is told from.
    pub rivals: Vec<Effect>,
    /// What it does, for people.
    pub text: String,
    /// Expected evidence against the closest rival \[χ²\].
    pub separation: f64,
    /// Time between samples \[s\].
    pub period_s: f64,
    /// \[rad\]
    pub q: Vec<Vec<f64>>,
    /// \[rad/s\]
    pub qd: Vec<Vec<f64>>,
    /// \[rad/s²\]
    pub qdd: Vec<Vec<f64>>,
}

impl SeparatingMotion {
    /// Whether it is expected to tell: twice the log evidence by which a rival that is none has to be behind.
    pub fn is_conclusive(&self) -> bool {
        self.separation >= 2.0 * POLICY.adoption.rival_gap
    }
}

/// What the arm may do.
#[derive(Clone, Debug)]
pub struct MotionBounds {
    /// Lowest and highest position of each joint \[rad\].
    pub position: Vec<(f64, f64)>,
    /// Largest speed \[rad/s\].
    pub velocity: Vec<f64>,
    /// Largest torque \[N·m\].
    pub torque: Vec<f64>,
    /// Period of the setpoints \[s\].
    pub period_s: f64,
}

/// Furthest from where the logs were, whatever the range \[rad\]: as far as the joint goes only where less does not tell.
const FURTHEST: [f64; 2] = [1.6, std::f64::consts::PI];
/// Expected evidence \[χ²\] of which half leaves no doubt, beside what noise and other values may do to it.
const ENOUGH: f64 = 4.0 * POLICY.adoption.rival_gap;
/// Samples for the comparison of motions are this far apart \[s\].
const PLAN_SAMPLE_S: f64 = 0.004;

impl MotionBounds {
    /// From the limits of the arm's file and its drives, with margins.
    pub fn from_limits(model: &Model, torque_limit: &[f64], period_s: f64) -> MotionBounds {
        let joints = &model.arm.joints;
        let range = |j: &rivet_dynamics::Joint| {
            let (low, high) = (j.lower.max(-std::f64::consts::PI), j.upper.min(std::f64::consts::PI));
            let free = POLICY.motions.range_margin * (high - low);
            (low + free, high - free)
        };
        let rated = |j: &rivet_dynamics::Joint| {
            POLICY.motions.speed_share
                * if j.velocity.is_finite() && j.velocity > 0.0 {
                    j.velocity
                } else {
                    POLICY.motions.unrated_speed_rad_s
                }
        };
        MotionBounds {
            position: joints.iter().map(range).collect(),
            velocity: joints.iter().map(rated).collect(),
            torque: torque_limit.iter().map(|t| POLICY.motions.torque_share * t).collect(),
            period_s,
        }
    }
}

/// One motion of the library.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Plan {
    /// Constant speeds, each in both directions.
    Speeds,
    /// Static poses over the range, from both sides.
    Poses,
    /// Reversals from tiny to large.
    Reversals,
    /// A chirp.
    Chirp,
    /// The whole range once slowly and once at twice the speed.
    Range,
    /// Fast moves over the whole range, while the joint before turns as well.
    Fast,
}

impl Plan {
    const ALL: [Plan; 5] = [Plan::Speeds, Plan::Poses, Plan::Reversals, Plan::Chirp, Plan::Range];

    fn text(self) -> &'static str {
        match self {
            Plan::Speeds => "constant speeds from very slow to fast, each in both directions",
            Plan::Poses => "static poses over the range, each reached from both sides",
            Plan::Reversals => "reversals from tiny to large",
            Plan::Chirp => "a chirp from 0.5 to 12 Hz",
            Plan::Range => "the whole range forth and back, slowly, then at twice the speed",
            Plan::Fast => "fast moves over the whole range, while the joint before turns,",
        }
    }

    /// The plans that tell this class. Its own link as a rival is asked as a scale of what the file has, which any motion refutes; as a
    /// body that is free it pulls like a counterbalance at rest and in slow moves, and only its inertia tells.
    fn for_class(class: &Class<'_>) -> &'static [Plan] {
        let is = |effect: Effect| move |form: &Form| form.effect() == effect;
        let has = |effect: Effect| is(effect)(class.form) || class.rivals.iter().any(is(effect));
        if class.is_of_time() {
            &[Plan::Chirp]
        } else if has(counterbalance::EFFECT) && has(link_inertia::EFFECT) {
            &[Plan::Fast]
        } else {
            &Plan::ALL
        }
    }

    /// Speeds over time of a joint that moves, from rest to rest \[rad/s\]: `low..high` is its range, `start` where it
    /// begins, `top` its speed limit.
    fn speeds(self, (low, high): (f64, f64), start: f64, top: f64, dt: f64) -> Vec<f64> {
        let mut v = Vec::new();
        let range = high - low;
        match self {
            Plan::Speeds => {
                for share in [0.01, 0.03, 0.1, 0.3, 0.7] {
                    let speed = share * top;
                    let way = (speed * 2.0).clamp(0.02 * range, 0.45 * range).min(high - start);
                    for direction in [1.0, -1.0] {
                        cruise(&mut v, direction * way, speed, dt);
                        rest(&mut v, 0.2, dt);
                    }
                }
            }
            Plan::Poses => {
                let speed = 0.25 * top;
                cruise(&mut v, low - start, speed, dt);
                let step = range / 8.0;
                for direction in [1.0, -1.0] {
                    for _ in 0..8 {
                        cruise(&mut v, direction * step, speed, dt);
                        rest(&mut v, 0.5, dt);
                    }
                }
                cruise(&mut v, start - low, speed, dt);
            }
            Plan::Reversals => {
                for k in 0..9 {
                    let way = (2e-4 * range * 2.0_f64.powi(k)).min(high - start);
                    for _ in 0..3 {
                        cruise(&mut v, way, (2.0 * way).min(0.5 * top), dt);
                        cruise(&mut v, -way, (2.0 * way).min(0.5 * top), dt);
                    }
                }
            }
            Plan::Chirp => {
                let (seconds, first, last) = (16.0, 0.5, 12.0_f64);
                let rate = (last / first).ln() / seconds;
                let samples = (seconds / dt) as usize;
                for k in 0..samples {
                    let t = k as f64 * dt;
                    let phase = std::f64::consts::TAU * first * ((rate * t).exp() - 1.0) / rate;
                    let window = (std::f64::consts::PI * t / seconds).sin().powi(2).min(0.25) * 4.0;
                    // Less speed at higher frequency: the same acceleration.
                    v.push(0.3 * top * window * phase.sin() * (-0.5 * rate * t).exp());
                }
            }
            Plan::Range => {
                for speed in [0.1 * top, 0.2 * top] {
                    cruise(&mut v, low - start, 0.3 * top, dt);
                    cruise(&mut v, range, speed, dt);
                    cruise(&mut v, -range, speed, dt);
                    cruise(&mut v, start - low, 0.3 * top, dt);
                }
            }
            Plan::Fast => {
                cruise(&mut v, low - start, 0.5 * top, dt);
                for _ in 0..8 {
                    cruise(&mut v, range, top, dt);
                    cruise(&mut v, -range, top, dt);
                }
                cruise(&mut v, start - low, 0.5 * top, dt);
            }
        }
        v
    }
}

/// From rest to rest over `way` at `speed`, with smooth ramps.
fn cruise(v: &mut Vec<f64>, way: f64, speed: f64, dt: f64) {
    if way == 0.0 || speed <= 0.0 {
        return;
    }
    let ramp = (0.5 * way.abs() / speed).min(0.3);
    let total = way.abs() / speed + ramp;
    let samples = (total / dt).ceil() as usize;
    let rise = |t: f64| {
        let s = (t / ramp).clamp(0.0, 1.0);
        s * s * (3.0 - 2.0 * s)
    };
    let from = v.len();
    v.extend((0..samples).map(|k| {
        let t = (k as f64 + 0.5) * dt;
        rise(t).min(rise(total - t))
    }));
    // Whatever the sampling made of the profile, the way is right.
    let sum: f64 = v[from..].iter().sum::<f64>() * dt;
    v[from..].iter_mut().for_each(|v| *v *= way / sum);
}

fn rest(v: &mut Vec<f64>, seconds: f64, dt: f64) {
    v.extend(std::iter::repeat_n(0.0, (seconds / dt) as usize));
}

/// How much of a plan the arm can do: how far from where it begins \[rad\], and at what share of the joint's speed.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Extent {
    reach: f64,
    speed: f64,
}

/// Setpoints of a plan of joint `joint` from the pose `home`, sampled every `dt`.
fn setpoints(
    plan: Plan,
    joint: usize,
    home: &[f64],
    bounds: &MotionBounds,
    extent: Extent,
    dt: f64,
) -> [Vec<Vec<f64>>; 3] {
    let speeds = |joint: usize| {
        let (low, high) = bounds.position[joint];
        let (low, high) = (low.max(home[joint] - extent.reach), high.min(home[joint] + extent.reach));
        let mut v = Vec::new();
        rest(&mut v, 0.5, dt);
        v.extend(plan.speeds((low, high), home[joint], extent.speed * bounds.velocity[joint], dt));
        rest(&mut v, 0.5, dt);
        v
    };
    let moves = |other: usize| other == joint || plan == Plan::Fast && other + 1 == joint;
    let all: Vec<Vec<f64>> = (0..home.len()).map(|j| if moves(j) { speeds(j) } else { Vec::new() }).collect();
    let samples = all.iter().map(Vec::len).max().unwrap_or(0);
    let still = |value: f64| vec![value; samples];
    let mut q: Vec<Vec<f64>> = home.iter().map(|h| still(*h)).collect();
    let mut qd: Vec<Vec<f64>> = home.iter().map(|_| still(0.0)).collect();
    let mut qdd = qd.clone();
    for (j, v) in all.iter().enumerate().filter(|(_, v)| !v.is_empty()) {
        let mut at = home[j];
        for k in 0..samples {
            let speed = |k: usize| v.get(k).copied().unwrap_or(0.0);
            let before = if k > 0 { speed(k - 1) } else { 0.0 };
            at += dt * 0.5 * (speed(k) + before);
            q[j][k] = at;
            qd[j][k] = speed(k);
            qdd[j][k] = (speed(k + 1) - before) / (2.0 * dt);
        }
    }
    [q, qd, qdd]
}

/// A class: what was chosen with its coefficients, and its rivals' forms.
#[derive(Clone)]
pub(crate) struct Class<'a> {
    pub(crate) form: &'a Form,
    pub(crate) coefficients: Vec<f64>,
    pub(crate) rivals: Vec<Form>,
}

impl Class<'_> {
    /// Whether all of it moves torque in time.
    fn is_of_time(&self) -> bool {
        let mut all = std::iter::once(self.form).chain(&self.rivals);
        all.all(Form::shifts_time)
    }
}

/// What is known of the arm.
#[derive(Clone, Copy)]
pub(crate) struct IdentifiedArm<'a> {
    pub(crate) model: &'a Model,
    /// Standard vector.
    pub(crate) x: &'a [f64],
    /// How far its values may still be off, one standard deviation each.
    pub(crate) deviations: &'a [f64],
    /// Torque noise by joint \[N·m\].
    pub(crate) noise: &'a [f64],
}

/// The best motion for a class within the bounds; `runs`: the training runs.
pub(crate) fn best(
    class: &Class<'_>,
    arm: IdentifiedArm<'_>,
    runs: &[&Prepared],
    bounds: &MotionBounds,
) -> Option<SeparatingMotion> {
    let IdentifiedArm { model, x, deviations, noise } = arm;
    let exact = Nominal::exact(model, x);
    // Delay and lag are told apart by slow signals alone, so no motion may be said to tell them by its fast ones.
    let is_slow = class.is_of_time();
    let slow: Vec<Prepared> =
        if is_slow { runs.iter().map(|run| run.up_to(SLOW_HZ, &exact)).collect() } else { Vec::new() };
    let runs: Vec<&Prepared> = if is_slow { slow.iter().collect() } else { runs.to_vec() };
    let chain = if is_slow { Chain::up_to(SLOW_HZ, PLAN_SAMPLE_S) } else { Chain::new(PLAN_SAMPLE_S) };
    let first = runs.first()?;
    // Where the logs were: an arm that was there before can be there again.
    let home: Vec<f64> = (0..bounds.velocity.len())
        .map(|j| {
            let q = &first.motion.q[j];
            let middle = q.iter().sum::<f64>() / q.len().max(1) as f64;
            middle.clamp(bounds.position[j].0, bounds.position[j].1)
        })
        .collect();
    let physics: Vec<Physics<'_>> = runs.iter().map(|run| Physics::new(&run.run, &run.motion, &exact, x)).collect();
    let logs: Vec<Record> = runs.iter().map(|run| Record::new(&run.standard, &run.chain, noise)).collect();
    let logs: Vec<(&Record, &Physics<'_>)> = logs.iter().zip(&physics).collect();
    let duels = duels(class, &logs, deviations)?;
    let mut found: Option<Planned> = None;
    for furthest in FURTHEST {
        for joint in movers(class, home.len()) {
            for plan in Plan::for_class(class) {
                let Some(extent) = admissible(*plan, joint, &home, bounds, (model, x), furthest) else { continue };
                let run = planned(*plan, joint, &home, bounds, extent);
                let motion = Motion::from_run(&run);
                let record = Record::new(&standard_columns(model, &motion, &chain), &chain, noise);
                let physics = Physics::new(&run, &motion, &exact, x);
                let most = found.as_ref().map_or(0.0, |found| found.separation);
                let separation = separation(&duels, &record, &physics, most)?;
                if found.is_none() || separation > most {
                    found = Some(Planned { separation, plan: *plan, joint, extent });
                }
            }
        }
        // A chirp goes no further however far it may.
        if is_slow || found.as_ref().is_some_and(|found| found.separation >= ENOUGH) {
            break;
        }
    }
    let Planned { separation, plan, joint, extent } = found?;
    let [q, qd, qdd] = setpoints(plan, joint, &home, bounds, extent, bounds.period_s);
    let mut rivals: Vec<Effect> = class.rivals.iter().map(Form::effect).collect();
    rivals.dedup();
    Some(SeparatingMotion {
        effect: class.form.effect(),
        joints: class.form.joints(),
        rivals,
        text: format!("{} of joint {}, the others still", plan.text(), joint + 1),
        separation,
        period_s: bounds.period_s,
        q,
        qd,
        qdd,
    })
}

/// One motion of the library that the arm can do, and what it is expected to say.
struct Planned {
    separation: f64,
    plan: Plan,
    joint: usize,
    extent: Extent,
}

/// The smallest evidence of all duels, with imitations at their best; those that are below `least` anyhow are not looked at closer.
fn separation(duels: &[Duel<'_>], record: &Record<'_>, physics: &Physics<'_>, least: f64) -> Option<f64> {
    let mut smallest = f64::INFINITY;
    let mut imitations = Vec::new();
    for duel in duels {
        let (evidence, form) = duel.separation(record, physics)?;
        smallest = smallest.min(evidence);
        imitations.push((duel, form));
    }
    for (duel, form) in imitations {
        if smallest <= least {
            break;
        }
        smallest = smallest.min(duel.at_best(form, record, physics)?);
    }
    Some(smallest)
}

/// A plan as a run without torque.
fn planned(plan: Plan, joint: usize, home: &[f64], bounds: &MotionBounds, extent: Extent) -> Run {
    let [q, ..] = setpoints(plan, joint, home, bounds, extent, PLAN_SAMPLE_S);
    let tau = vec![vec![0.0; q[0].len()]; q.len()];
    Run { name: String::new(), period_s: PLAN_SAMPLE_S, q, tau, ..Run::default() }
}

/// Joints to move: those that the class is about, or every one where it is about the whole arm.
fn movers(class: &Class<'_>, joints: usize) -> Vec<usize> {
    let mut movers: Vec<usize> = std::iter::once(class.form).chain(&class.rivals).flat_map(Form::joints).collect();
    movers.sort_unstable();
    movers.dedup();
    if movers.is_empty() { (0..joints).collect() } else { movers }
}

/// The furthest, then the fastest, that the plan can be done without more torque than the joints may use; none if it never can.
fn admissible(
    plan: Plan,
    joint: usize,
    home: &[f64],
    bounds: &MotionBounds,
    (model, x): (&Model, &[f64]),
    furthest: f64,
) -> Option<Extent> {
    let (n, width) = (home.len(), x.len());
    let mut ws = Workspace::new(&model.arm);
    let mut y = vec![0.0; n * width];
    let mut fits = |extent: Extent| {
        let [q, qd, qdd] = setpoints(plan, joint, home, bounds, extent, PLAN_SAMPLE_S);
        (0..q[0].len()).step_by(5).all(|k| {
            let state = |s: &[Vec<f64>]| -> Vec<f64> { s.iter().map(|s| s[k]).collect() };
            let (q, qd, qdd) = (state(&q), state(&qd), state(&qdd));
            model.regressor(&mut ws, &q, &qd, &qdd, &mut y);
            let mut tau: Vec<f64> =
                y.chunks_exact(width).map(|row| row.iter().zip(x).map(|(y, x)| y * x).sum()).collect();
            model.add_effects(&mut ws, &q, &qd, &qdd, &mut tau);
            tau.iter().zip(&bounds.torque).all(|(tau, most)| tau.abs() <= *most)
        })
    };
    let speeds = || (0..8).map(|k| 0.7_f64.powi(k));
    // A spring may need more torque at the end of the range than there is.
    let extents = [1.0, 0.7, 0.5, 0.35, 0.25]
        .into_iter()
        .flat_map(|share| speeds().map(move |speed| Extent { reach: share * furthest, speed }));
    extents.into_iter().find(|extent| fits(*extent))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The joint and the one before go to and fro within their bounds, and both end where and as they began.
    #[test]
    fn fast_moves_turn_the_joint_before_as_well() {
        let bounds = MotionBounds {
            position: vec![(-2.0, 2.0), (-1.0, 1.5), (-2.0, 2.0)],
            velocity: vec![1.0, 1.5, 2.0],
            torque: vec![1.0; 3],
            period_s: 0.004,
        };
        let home = [0.3, 0.2, -0.4];
        let extent = Extent { reach: 0.8, speed: 0.8 };
        let [q, qd, _] = setpoints(Plan::Fast, 1, &home, &bounds, extent, 0.004);
        for j in 0..3 {
            let fastest = qd[j].iter().fold(0.0_f64, |most, v| most.max(v.abs()));
            let far = q[j].iter().map(|q| (q - home[j]).abs()).fold(0.0, f64::max);
            if j == 2 {
                assert_eq!((fastest, far), (0.0, 0.0));
                continue;
            }
            let top = 0.8 * bounds.velocity[j];
            assert!((0.9 * top..1.02 * top).contains(&fastest) && far > 0.75 && far < 0.81, "{j}: {fastest} {far}");
            let last = q[j].len() - 1;
            assert!((q[j][last] - home[j]).abs() < 1e-9 && qd[j][last] == 0.0, "{}", q[j][last]);
        }
    }
}
