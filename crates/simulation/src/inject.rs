//! Torque that a withheld effect would have added to a recorded run: the physics of the plant's kind, driven by the run's
//! own motion, so that a diagnosis can be asked what it would have found in this very log.
//!
//! Positions of the run stay as they are; what an effect changes is the torque that goes with them. An encoder that
//! deceives is the same thing seen from the other side: the arm was elsewhere than the log says, and its torque is that of
//! where it was.

use rivet_dynamics::{Arm, Model, Parameter, Workspace, inverse_dynamics, mass_matrix};

use crate::truth::Payload;

/// A recorded run, `[joint][sample]`, with the arm that it is of.
#[derive(Clone, Copy, Debug)]
pub struct Recorded<'a> {
    /// Kinematics, bodies, gravity.
    pub arm: &'a Arm,
    /// Drive inertia of each joint \[kg·m²\].
    pub rotor_inertia: &'a [f64],
    /// Coulomb friction of each joint \[N·m\].
    pub coulomb: &'a [f64],
    /// Viscous friction of each joint \[N·m·s/rad\].
    pub viscous: &'a [f64],
    /// Time between samples \[s\].
    pub period_s: f64,
    /// Measured positions \[rad\].
    pub q: &'a [Vec<f64>],
    /// Measured torque \[N·m\].
    pub tau: &'a [Vec<f64>],
}

impl<'a> Recorded<'a> {
    /// A run of `model` with the standard vector `x`.
    pub fn of(model: &'a Model, x: &'a [f64], period_s: f64, q: &'a [Vec<f64>], tau: &'a [Vec<f64>]) -> Recorded<'a> {
        let n = model.arm.dof();
        let drive = |first: Parameter| {
            let at = model.parameters.iter().position(|p| *p == first).unwrap_or(x.len() - n);
            &x[at..at + n]
        };
        Recorded {
            arm: &model.arm,
            rotor_inertia: drive(Parameter::RotorInertia(0)),
            coulomb: drive(Parameter::Coulomb(0)),
            viscous: drive(Parameter::Viscous(0)),
            period_s,
            q,
            tau,
        }
    }
}

/// An effect with its size.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(missing_docs, reason = "fields are the quantities of the sentence above them")]
pub enum Injected {
    /// Static friction above the sliding one, `excess·exp(−|v|/velocity)` \[N·m, rad/s\].
    Stribeck { joint: usize, excess: f64, velocity: f64 },
    /// Friction per transmitted torque.
    LoadFriction { joint: usize, ratio: f64 },
    /// So much more friction forwards and less backwards \[N·m\].
    FrictionAsymmetry { joint: usize, torque: f64 },
    /// Friction that grows with the cube of speed \[N·m·s³/rad³\].
    CubicFriction { joint: usize, coefficient: f64 },
    /// Friction that varies once a turn \[N·m\].
    PositionFriction { joint: usize, amplitude: f64 },
    /// Torque over the angle, cycles per turn \[N·m\].
    Ripple { joint: usize, amplitude: f64, order: f64 },
    /// Drive that gives this many times what it reports, less one.
    Gain { joint: usize, error: f64 },
    /// A spring about the joint's mean position \[N·m/rad\].
    Spring { joint: usize, stiffness: f64 },
    /// A spring between motor and link \[N·m/rad\], with play \[rad\].
    Gear { joint: usize, stiffness: f64, play: f64 },
    /// Bristles that give way before the joint slides \[rad\] (LuGre).
    Presliding { joint: usize, length: f64 },
    /// The encoder's zero is off \[rad\].
    EncoderOffset { joint: usize, offset: f64 },
    /// The encoder's reading varies once a turn \[rad\].
    EncoderEccentricity { joint: usize, amplitude: f64 },
    /// Torque acts later than it is logged \[s\].
    Delay { seconds: f64 },
    /// Torque follows what is logged as a first-order lag \[s\].
    Lag { seconds: f64 },
    /// The base is tilted about its x axis \[rad\].
    Tilt { angle: f64 },
    /// A ball at the flange \[kg\], a tenth of a metre out.
    Payload { mass: f64 },
}

/// Half width of the window in which positions are a parabola \[s\].
const SMOOTH_S: f64 = 0.012;
/// Speed below which friction's direction is not decided \[rad/s\].
const TURNS: f64 = 0.002;
/// Steps of a two-mass joint in a second.
const GEAR_RATE: f64 = 10_000.0;
/// Damping ratio of a gear's spring.
const GEAR_DAMPING: f64 = 0.07;
/// Damping of bristles over their stiffness \[s\].
const BRISTLE_DAMPING_S: f64 = 1e-3;

/// Motion of a run, smoothed.
struct Path {
    q: Vec<Vec<f64>>,
    qd: Vec<Vec<f64>>,
    qdd: Vec<Vec<f64>>,
}

/// What drives the injections of one run: its motion and the torque of its rigid links, computed once.
pub struct Injector<'a> {
    run: Recorded<'a>,
    path: Path,
    rigid: Vec<Vec<f64>>,
}

impl<'a> Injector<'a> {
    /// Prepares a run.
    pub fn new(run: Recorded<'a>) -> Injector<'a> {
        let half = ((SMOOTH_S / run.period_s).round() as usize).max(2);
        let fitted: Vec<[Vec<f64>; 3]> = run.q.iter().map(|q| parabola(q, half, run.period_s)).collect();
        let take = |k: usize| fitted.iter().map(|f| f[k].clone()).collect();
        let path = Path { q: take(0), qd: take(1), qdd: take(2) };
        let rigid = rigid(run.arm, &path.q, &path.qd, &path.qdd);
        Injector { run, path, rigid }
    }

    /// Torque to add to the run's, `[joint][sample]` \[N·m\].
    pub fn torque(&self, effect: Injected) -> Vec<Vec<f64>> {
        let (run, path) = (&self.run, &self.path);
        let (joints, samples) = (run.q.len(), run.q.first().map_or(0, Vec::len));
        let mut added = vec![vec![0.0; samples]; joints];
        let direction = |v: f64| (v / TURNS).tanh();
        let on = |joint: usize, added: &mut Vec<Vec<f64>>, f: &dyn Fn(usize) -> f64| {
            added[joint].iter_mut().enumerate().for_each(|(k, t)| *t = f(k));
        };
        match effect {
            Injected::Stribeck { joint: j, excess, velocity } => on(j, &mut added, &|k| {
                let v = path.qd[j][k];
                excess * direction(v) * (-v.abs() / velocity).exp()
            }),
            Injected::LoadFriction { joint: j, ratio } => {
                on(j, &mut added, &|k| ratio * self.rigid[j][k].abs() * direction(path.qd[j][k]));
            }
            Injected::FrictionAsymmetry { joint: j, torque } => {
                on(j, &mut added, &|k| torque * direction(path.qd[j][k]).abs());
            }
            Injected::CubicFriction { joint: j, coefficient } => {
                on(j, &mut added, &|k| coefficient * path.qd[j][k].powi(3));
            }
            Injected::PositionFriction { joint: j, amplitude } => {
                on(j, &mut added, &|k| amplitude * (path.q[j][k] + 0.7).sin() * direction(path.qd[j][k]));
            }
            Injected::Ripple { joint: j, amplitude, order } => {
                on(j, &mut added, &|k| amplitude * (order * path.q[j][k] + 0.4).sin());
            }
            Injected::Gain { joint: j, error } => on(j, &mut added, &|k| -error / (1.0 + error) * run.tau[j][k]),
            Injected::Spring { joint: j, stiffness } => {
                let mean = path.q[j].iter().sum::<f64>() / samples.max(1) as f64;
                on(j, &mut added, &|k| stiffness * (path.q[j][k] - mean));
            }
            Injected::Gear { joint, stiffness, play } => return self.gear(joint, stiffness, play),
            Injected::Presliding { joint: j, length } => {
                let z = bristles(&path.q[j], &path.qd[j], length, run.period_s);
                on(j, &mut added, &|k| run.coulomb[j].abs() * (z[k] - direction(path.qd[j][k])));
            }
            Injected::EncoderOffset { joint, offset } => return self.deceived(joint, |_| [offset, 0.0, 0.0]),
            Injected::EncoderEccentricity { joint: j, amplitude } => {
                return self.deceived(j, |k| {
                    let (s, c) = (path.q[j][k] + 0.3).sin_cos();
                    let (v, a) = (path.qd[j][k], path.qdd[j][k]);
                    [amplitude * s, amplitude * c * v, amplitude * (c * a - s * v * v)]
                });
            }
            Injected::Delay { seconds } => {
                for (to, tau) in added.iter_mut().zip(run.tau) {
                    on_time(to, tau, seconds / run.period_s);
                }
            }
            Injected::Lag { seconds } => {
                let half = ((SMOOTH_S / run.period_s).round() as usize).max(2);
                for (to, tau) in added.iter_mut().zip(run.tau) {
                    let [_, rate, _] = parabola(tau, half, run.period_s);
                    to.iter_mut().zip(rate).for_each(|(t, r)| *t = seconds * r);
                }
            }
            Injected::Tilt { angle } => {
                let mut arm = run.arm.clone();
                let [x, y, z] = arm.gravity;
                arm.gravity = [x, y * angle.cos() - z * angle.sin(), y * angle.sin() + z * angle.cos()];
                return difference(&rigid(&arm, &path.q, &path.qd, &path.qdd), &self.rigid);
            }
            Injected::Payload { mass } => {
                let mut arm = run.arm.clone();
                let ball = Payload { mass, com: [0.03, 0.0, 0.1] }.body();
                if let Some(last) = arm.links.last_mut() {
                    last.iter_mut().zip(ball).for_each(|(l, b)| *l += b);
                }
                return difference(&rigid(&arm, &path.q, &path.qd, &path.qdd), &self.rigid);
            }
        }
        added
    }

    /// The arm was at the logged position less `error(sample)`, position, speed and acceleration; drive and friction were
    /// there too.
    fn deceived(&self, joint: usize, error: impl Fn(usize) -> [f64; 3]) -> Vec<Vec<f64>> {
        let (mut q, mut qd, mut qdd) = (self.path.q.clone(), self.path.qd.clone(), self.path.qdd.clone());
        let samples = q[joint].len();
        let mut drive = vec![0.0; samples];
        for k in 0..samples {
            let [e, ed, edd] = error(k);
            q[joint][k] -= e;
            qd[joint][k] -= ed;
            qdd[joint][k] -= edd;
            drive[k] = -self.run.rotor_inertia[joint] * edd - self.run.viscous[joint] * ed;
        }
        let mut added = difference(&rigid(self.run.arm, &q, &qd, &qdd), &self.rigid);
        added[joint].iter_mut().zip(drive).for_each(|(t, d)| *t += d);
        added
    }

    /// The link of a joint behind a spring, at 10 kHz: all other joints and the motor move as logged.
    fn gear(&self, joint: usize, stiffness: f64, play: f64) -> Vec<Vec<f64>> {
        let (run, path) = (&self.run, &self.path);
        let (n, samples) = (run.q.len(), path.q[joint].len());
        let mut added = vec![vec![0.0; samples]; n];
        let mut ws = Workspace::new(run.arm);
        let (mut q, mut qd, mut qdd) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        let (mut tau, mut m) = (vec![0.0; n], vec![0.0; n * n]);
        let steps = (run.period_s * GEAR_RATE).ceil().max(1.0) as usize;
        let h = run.period_s / steps as f64;
        let half = 0.5 * play;
        let mut place = None;
        for k in 0..samples {
            let next = (k + 1).min(samples - 1);
            let (mut link, mut speed) = place.unwrap_or_else(|| {
                // At rest under the first load.
                let load = self.rigid[joint][0];
                (path.q[joint][0] - load / stiffness - half * load.signum(), path.qd[joint][0])
            });
            for j in 0..n {
                q[j] = path.q[j][k];
            }
            q[joint] = link;
            mass_matrix(run.arm, &run.arm.links, &mut ws, &q, &mut m);
            let inertia = m[joint * n + joint].max(1e-9);
            let damping = 2.0 * GEAR_DAMPING * (stiffness * inertia).sqrt();
            for step in 0..steps {
                let share = step as f64 / steps as f64;
                let between = |x: &[Vec<f64>], j: usize| x[j][k] * (1.0 - share) + x[j][next] * share;
                for j in 0..n {
                    q[j] = between(&path.q, j);
                    qd[j] = between(&path.qd, j);
                    qdd[j] = between(&path.qdd, j);
                }
                let (motor, motor_speed) = (q[joint], qd[joint]);
                (q[joint], qd[joint], qdd[joint]) = (link, speed, 0.0);
                inverse_dynamics(run.arm, &run.arm.links, &mut ws, &q, &qd, &qdd, &mut tau);
                let wound = motor - link;
                let stretch = wound - wound.clamp(-half, half);
                let pushed = stiffness * stretch + damping * (motor_speed - speed);
                // Flanks with play between them push; they do not pull.
                let push = if half > 0.0 && pushed * stretch <= 0.0 { 0.0 } else { pushed };
                let accel = (push - tau[joint]) / inertia;
                if step == 0 {
                    // The sample itself: what the motor carries, and what the others feel.
                    qdd[joint] = accel;
                    inverse_dynamics(run.arm, &run.arm.links, &mut ws, &q, &qd, &qdd, &mut tau);
                    for j in 0..n {
                        let now = if j == joint { push } else { tau[j] };
                        added[j][k] = now - self.rigid[j][k];
                    }
                }
                speed += h * accel;
                link += h * speed;
            }
            place = Some((link, speed));
        }
        added
    }
}

/// Position, speed and acceleration of the parabola through a window around each sample (Savitzky & Golay 1964).
fn parabola(x: &[f64], half: usize, period_s: f64) -> [Vec<f64>; 3] {
    let n = x.len();
    let m = half as f64;
    // Sums of squares and fourth powers of -half..=half.
    let s0 = 2.0 * m + 1.0;
    let s2 = m * (m + 1.0) * (2.0 * m + 1.0) / 3.0;
    let s4 = s2 * (3.0 * m * m + 3.0 * m - 1.0) / 5.0;
    let scale = s0 * s4 - s2 * s2;
    let mut out = [vec![0.0; n], vec![0.0; n], vec![0.0; n]];
    if n < 2 * half + 1 {
        out[0].copy_from_slice(x);
        return out;
    }
    for k in 0..n {
        let centre = k.clamp(half, n - 1 - half);
        let (mut a, mut b, mut c) = (0.0, 0.0, 0.0);
        for i in 0..=2 * half {
            let t = i as f64 - m;
            let v = x[centre - half + i];
            a += v;
            b += t * v;
            c += t * t * v;
        }
        let (level, slope, bend) = ((s4 * a - s2 * c) / scale, b / s2, (s0 * c - s2 * a) / scale);
        // At the ends the parabola of the last whole window goes on.
        let t = k as f64 - centre as f64;
        out[0][k] = level + slope * t + bend * t * t;
        out[1][k] = (slope + 2.0 * bend * t) / period_s;
        out[2][k] = 2.0 * bend / (period_s * period_s);
    }
    out
}

/// Torque of the rigid links along a motion.
fn rigid(arm: &Arm, q: &[Vec<f64>], qd: &[Vec<f64>], qdd: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let (n, samples) = (q.len(), q.first().map_or(0, Vec::len));
    let mut ws = Workspace::new(arm);
    let (mut a, mut b, mut c, mut tau) = (vec![0.0; n], vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let mut out = vec![vec![0.0; samples]; n];
    for k in 0..samples {
        for j in 0..n {
            (a[j], b[j], c[j]) = (q[j][k], qd[j][k], qdd[j][k]);
        }
        inverse_dynamics(arm, &arm.links, &mut ws, &a, &b, &c, &mut tau);
        for j in 0..n {
            out[j][k] = tau[j];
        }
    }
    out
}

fn difference(a: &[Vec<f64>], b: &[Vec<f64>]) -> Vec<Vec<f64>> {
    a.iter().zip(b).map(|(a, b)| a.iter().zip(b).map(|(a, b)| a - b).collect()).collect()
}

/// What has to be logged earlier by `samples` to act in time.
fn on_time(to: &mut [f64], tau: &[f64], samples: f64) {
    let last = tau.len().saturating_sub(1);
    for (k, to) in to.iter_mut().enumerate() {
        let place = (k as f64 + samples).min(last as f64);
        let (at, share) = (place as usize, place.fract());
        *to = tau[at] * (1.0 - share) + tau[(at + 1).min(last)] * share - tau[k];
    }
}

/// State of LuGre's bristles with their damping, in units of the sliding friction (Canudas de Wit 1995), four steps a
/// sample.
fn bristles(q: &[f64], qd: &[f64], length: f64, period_s: f64) -> Vec<f64> {
    const STEPS: usize = 4;
    let mut z = 0.0;
    (0..q.len())
        .map(|k| {
            let mut rate = 0.0;
            for _ in 0..STEPS {
                let v = qd[k];
                // dz = (v - |v| z) / length, the step implicit in z so that a short length stays stable.
                let h = period_s / STEPS as f64;
                let before = z;
                z = (z + h * v / length) / (1.0 + h * v.abs() / length);
                rate = (z - before) / h;
            }
            z + BRISTLE_DAMPING_S * rate
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const URDF: &str = r#"<robot name="one"><link name="base"/><link name="arm"><inertial><origin xyz="0.3 0 0"/>
        <mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
        <limit lower="-3" upper="3" velocity="5" effort="100"/></joint></robot>"#;

    fn injected(effect: Injected) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
        let arm = Arm::from_urdf(URDF, [0.0, 0.0, -9.81]).expect("a sound arm");
        let q: Vec<f64> = (0..4000).map(|k| 0.6 * (2.0e-3 * f64::from(k)).sin()).collect();
        let tau = vec![q.iter().map(|q| 3.0 * q).collect::<Vec<f64>>()];
        let q = vec![q];
        let run = Recorded {
            arm: &arm,
            rotor_inertia: &[0.5],
            coulomb: &[2.0],
            viscous: &[1.0],
            period_s: 1e-3,
            q: &q,
            tau: &tau,
        };
        let injector = Injector::new(run);
        let added = injector.torque(effect).remove(0);
        (added, injector.rigid[0].clone(), q[0].clone())
    }

    /// A pendulum `-m g l cos q` about the y axis: the derivative by hand.
    #[test]
    fn an_encoder_that_is_off_shows_the_torque_of_where_the_arm_was() {
        let offset = 0.01;
        let (added, _, q) = injected(Injected::EncoderOffset { joint: 0, offset });
        for k in (500..3500).step_by(100) {
            let gravity = |q: f64| -2.0 * 9.81 * 0.3 * q.cos();
            let expected = gravity(q[k] - offset) - gravity(q[k]);
            assert!((added[k] - expected).abs() < 1e-6, "{} {expected}", added[k]);
        }
    }

    #[test]
    fn a_stiff_gear_adds_nothing_and_a_soft_one_does() {
        let size = |x: &[f64]| (x[500..3500].iter().map(|v| v * v).sum::<f64>() / 3000.0).sqrt();
        let of = |stiffness| injected(Injected::Gear { joint: 0, stiffness, play: 0.0 });
        let (stiff, rigid, q) = of(3e4);
        let (soft, ..) = of(3e2);
        assert!(size(&stiff) < 2e-3 * size(&rigid), "{} {}", size(&stiff), size(&rigid));
        // Slow motion in the gravity field: the link sags by load over stiffness, and the load changes with its angle.
        let sagged: Vec<f64> = q.iter().zip(&rigid).map(|(q, load)| 2.0 * 9.81 * 0.3 * q.sin() * load / 3e2).collect();
        assert!((size(&soft) / size(&sagged) - 1.0).abs() < 0.1, "{} {}", size(&soft), size(&sagged));
    }

    #[test]
    fn delayed_torque_is_logged_early() {
        let (added, _, q) = injected(Injected::Delay { seconds: 0.0025 });
        let expected = 3.0 * (0.5 * (q[1002] + q[1003]) - q[1000]);
        assert!((added[1000] - expected).abs() < 1e-12, "{} {expected}", added[1000]);
    }

    #[test]
    fn a_parabola_is_its_own_fit() {
        let x: Vec<f64> =
            (0..60).map(|k| 1.0 + 2.0 * f64::from(k) * 0.01 + 3.0 * (f64::from(k) * 0.01).powi(2)).collect();
        let [level, speed, accel] = parabola(&x, 5, 0.01);
        for k in 0..60 {
            let t = k as f64 * 0.01;
            assert!(
                (level[k] - x[k]).abs() < 1e-10
                    && (speed[k] - 2.0 - 6.0 * t).abs() < 1e-8
                    && (accel[k] - 6.0).abs() < 1e-6
            );
        }
    }
}
