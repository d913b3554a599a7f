//! Motions that tell effects apart: a small library, and which of them separates a class best.
//!
//! Two effects that explain the same logs differ in what they say of other motion. With y what the chosen one adds along
//! a motion, and D and Φ the columns of the model's values and of a rival,
//!
//! ```text
//! S = min over (x, c) of |y_logs − D x − Φ c|² + |y_motion − D x − Φ c|² + |x/p|²  −  the same of the logs alone
//! ```
//!
//! in units of each joint's noise: twice the log evidence that the motion is expected to give against the rival when it
//! may still bend all values of the model.

use nalgebra::{Cholesky, DMatrix, DVector};
use rivet_dynamics::{Model, Workspace};

use crate::background::{Nominal, standard_columns};
use crate::design::Prepared;
use crate::effect::Effect;
use crate::form::Form;
use crate::physics::Physics;
use crate::rows::{Chain, Column};
use crate::run::{Motion, Run};

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

/// Share of a joint's range that stays free at either end, of its rated speed and of its torque that motions use.
const MARGIN: f64 = 0.08;
const SPEED: f64 = 0.5;
const TORQUE: f64 = 0.75;
/// Furthest from where the logs were, whatever the range \[rad\].
const FURTHEST: f64 = 1.6;
/// Speed of a joint that states none \[rad/s\].
const WALKING: f64 = 1.0;
/// Samples for the comparison of motions are this far apart \[s\].
const COARSE_S: f64 = 0.004;

impl MotionBounds {
    /// From the limits of the arm's file and its drives, with margins.
    pub fn of(model: &Model, torque_limit: &[f64], period_s: f64) -> MotionBounds {
        let joints = &model.arm.joints;
        let range = |j: &rivet_dynamics::Joint| {
            let (low, high) = (j.lower.max(-std::f64::consts::PI), j.upper.min(std::f64::consts::PI));
            let free = MARGIN * (high - low);
            (low + free, high - free)
        };
        let rated = |j: &rivet_dynamics::Joint| {
            SPEED * if j.velocity.is_finite() && j.velocity > 0.0 { j.velocity } else { WALKING }
        };
        MotionBounds {
            position: joints.iter().map(range).collect(),
            velocity: joints.iter().map(rated).collect(),
            torque: torque_limit.iter().map(|t| TORQUE * t).collect(),
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
        }
    }

    /// Speeds over time of the one joint that moves, from rest to rest \[rad/s\]: `low..high` is its range, `start` where it
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

/// Setpoints of a plan of joint `joint` from the pose `home`, sampled every `dt`; slower by `slower`.
fn setpoints(
    plan: Plan,
    joint: usize,
    home: &[f64],
    bounds: &MotionBounds,
    slower: f64,
    dt: f64,
) -> [Vec<Vec<f64>>; 3] {
    let (low, high) = bounds.position[joint];
    let (low, high) = (low.max(home[joint] - FURTHEST), high.min(home[joint] + FURTHEST));
    let mut v = Vec::new();
    rest(&mut v, 0.5, dt);
    v.extend(plan.speeds((low, high), home[joint], slower * bounds.velocity[joint], dt));
    rest(&mut v, 0.5, dt);
    let still = |value: f64| vec![value; v.len()];
    let mut q: Vec<Vec<f64>> = home.iter().map(|h| still(*h)).collect();
    let mut qd: Vec<Vec<f64>> = home.iter().map(|_| still(0.0)).collect();
    let mut qdd = qd.clone();
    let mut at = home[joint];
    for k in 0..v.len() {
        let before = if k > 0 { v[k - 1] } else { 0.0 };
        at += dt * 0.5 * (v[k] + before);
        q[joint][k] = at;
        qd[joint][k] = v[k];
        let after = v.get(k + 1).copied().unwrap_or(0.0);
        qdd[joint][k] = (after - before) / (2.0 * dt);
    }
    [q, qd, qdd]
}

/// A class: what was chosen with its coefficients, and its rivals' forms.
pub(crate) struct Class<'a> {
    pub(crate) form: &'a Form,
    pub(crate) coefficients: Vec<f64>,
    pub(crate) rivals: &'a [Form],
}

/// The best motion for a class. `model` and `x` are what is known of the arm, `noise` the joints' torque noise \[N·m\],
/// `deviations` how far values of the model may still be off.
pub(crate) fn best(
    class: &Class<'_>,
    model: &Model,
    x: &[f64],
    deviations: &[f64],
    runs: &[&Prepared],
    noise: &[f64],
    bounds: &MotionBounds,
) -> Option<SeparatingMotion> {
    let exact = Nominal::exact(model, x);
    let joints = class.form.joints();
    let joint = joints.first().copied().unwrap_or(0);
    let first = runs.first()?;
    // Where the logs were: an arm that was there before can be there again.
    let home: Vec<f64> = (0..bounds.velocity.len())
        .map(|j| {
            let q = &first.motion.q[j];
            let middle = q.iter().sum::<f64>() / q.len().max(1) as f64;
            middle.clamp(bounds.position[j].0, bounds.position[j].1)
        })
        .collect();
    let logs: Vec<Sums> = class
        .rivals
        .iter()
        .map(|rival| {
            let mut sums = Sums::new(x.len(), rival, deviations);
            for (i, run) in runs.iter().enumerate() {
                let physics = Physics::new(&run.run, &run.motion, &exact, x, Some(i));
                sums.add(class, rival, &physics, &run.standard, &run.chain, noise);
            }
            sums
        })
        .collect();
    let without: Vec<f64> = logs.iter().map(Sums::left).collect::<Option<_>>()?;
    let mut found: Option<(f64, Plan, f64)> = None;
    for plan in Plan::ALL {
        let Some(slower) = admissible(plan, joint, &home, bounds, model, x) else { continue };
        let [q, ..] = setpoints(plan, joint, &home, bounds, slower, COARSE_S);
        let tau = vec![vec![0.0; q[0].len()]; q.len()];
        let run = Run { name: String::new(), period_s: COARSE_S, q, tau, temperature: None };
        let motion = Motion::of(&run);
        let chain = Chain::new(COARSE_S);
        let standard = standard_columns(model, &motion, &chain);
        let physics = Physics::new(&run, &motion, &exact, x, Some(runs.len()));
        let mut least = f64::INFINITY;
        for ((sums, rival), without) in logs.iter().zip(class.rivals).zip(&without) {
            let mut sums = sums.clone();
            sums.add(class, rival, &physics, &standard, &chain, noise);
            least = least.min(sums.left()? - without);
        }
        if found.is_none_or(|(most, ..)| least > most) {
            found = Some((least, plan, slower));
        }
    }
    let (separation, plan, slower) = found?;
    let [q, qd, qdd] = setpoints(plan, joint, &home, bounds, slower, bounds.period_s);
    let mut rivals: Vec<Effect> = class.rivals.iter().map(Form::effect).collect();
    rivals.dedup();
    let text = format!("{} of joint {}, the others still", plan.text(), joint + 1);
    Some(SeparatingMotion {
        effect: class.form.effect(),
        joints,
        rivals,
        text,
        separation,
        period_s: bounds.period_s,
        q,
        qd,
        qdd,
    })
}

/// The largest share of the speed limit at which the plan needs no more torque than it may; none if it never does.
fn admissible(plan: Plan, joint: usize, home: &[f64], bounds: &MotionBounds, model: &Model, x: &[f64]) -> Option<f64> {
    let (n, width) = (home.len(), x.len());
    let mut ws = Workspace::new(&model.arm);
    let mut y = vec![0.0; n * width];
    let mut slower = 1.0;
    for _ in 0..8 {
        let [q, qd, qdd] = setpoints(plan, joint, home, bounds, slower, COARSE_S);
        let fits = (0..q[0].len()).step_by(5).all(|k| {
            let of = |s: &[Vec<f64>]| -> Vec<f64> { s.iter().map(|s| s[k]).collect() };
            let (q, qd, qdd) = (of(&q), of(&qd), of(&qdd));
            model.regressor(&mut ws, &q, &qd, &qdd, &mut y);
            let mut tau: Vec<f64> =
                y.chunks_exact(width).map(|row| row.iter().zip(x).map(|(y, x)| y * x).sum()).collect();
            model.add_effects(&mut ws, &q, &qd, &qdd, &mut tau);
            tau.iter().zip(&bounds.torque).all(|(tau, most)| tau.abs() <= *most)
        });
        if fits {
            return Some(slower);
        }
        slower *= 0.7;
    }
    None
}

/// Sums of products of the model's columns and a rival's, and of what the chosen effect adds.
#[derive(Clone)]
struct Sums {
    gram: DMatrix<f64>,
    product: DVector<f64>,
    square: f64,
}

impl Sums {
    fn new(width: usize, rival: &Form, deviations: &[f64]) -> Sums {
        // Coefficients of the rival are free, but not without end.
        let columns = rival.coefficients();
        let mut gram = DMatrix::zeros(width + columns, width + columns);
        for (i, deviation) in deviations.iter().take(width).enumerate() {
            gram[(i, i)] = 1.0 / deviation.max(1e-9).powi(2);
        }
        for c in width..width + columns {
            gram[(c, c)] = 1e-9;
        }
        Sums { gram, product: DVector::zeros(width + columns), square: 0.0 }
    }

    fn add(
        &mut self,
        class: &Class<'_>,
        rival: &Form,
        physics: &Physics<'_>,
        standard: &[Column],
        chain: &Chain,
        noise: &[f64],
    ) {
        let rows_of = |form: &Form| -> Vec<Column> {
            form.columns(physics).into_iter().map(|full| crate::rows::column(chain, full)).collect()
        };
        let (own, other) = (rows_of(class.form), rows_of(rival));
        let size = self.product.len();
        for (j, noise) in noise.iter().enumerate() {
            let Some(rows) = standard.iter().find_map(|c| c[j].as_ref()).map(Vec::len) else { continue };
            let mut target = vec![0.0; rows];
            for (column, c) in own.iter().zip(&class.coefficients) {
                if let Some(values) = &column[j] {
                    target.iter_mut().zip(values).for_each(|(t, v)| *t += c * v);
                }
            }
            if target.iter().all(|t| *t == 0.0) && other.iter().all(|c| c[j].is_none()) {
                continue;
            }
            let mut d = DMatrix::zeros(rows, size);
            for (c, column) in standard.iter().chain(&other).enumerate() {
                if let Some(values) = &column[j] {
                    d.column_mut(c).copy_from_slice(values);
                }
            }
            let w = 1.0 / (noise * noise);
            let target = DVector::from_vec(target);
            self.gram.gemm_tr(w, &d, &d, 1.0);
            self.product.gemv_tr(w, &d, &target, 1.0);
            self.square += w * target.norm_squared();
        }
    }

    /// What is left of the chosen effect when values and rival do their best.
    fn left(&self) -> Option<f64> {
        let factor = Cholesky::new(self.gram.clone())?;
        Some(self.square - self.product.dot(&factor.solve(&self.product)))
    }
}
