//! Point-to-point moves between seeded poses: quintic rest-to-rest profiles with dwells, as a production robot moves.

use super::{LARGEST_LOAD, LoadRatio, MotionLimits, QUINTIC_PEAK_VELOCITY, Trajectory, quintic};
use crate::random::Random;
use rivet_dynamics::MAX_JOINTS;

/// What a chain of moves is made from.
#[derive(Clone, Debug)]
pub struct PointToPointSettings {
    /// Moves until the arm is back home and starts over.
    pub moves: usize,
    /// Rest after each move \[s\].
    pub dwell_s: f64,
    /// Slowest move as a share of the speed limit; each move draws its own share between this and 1.
    pub slowest: f64,
    /// Longest move \[s\]: a slow one becomes a short one.
    pub longest_s: f64,
    /// Decides poses and speeds.
    pub seed: u64,
}

impl Default for PointToPointSettings {
    fn default() -> Self {
        Self { moves: 40, dwell_s: 0.3, slowest: 0.08, longest_s: 3.0, seed: 1 }
    }
}

#[derive(Clone, Debug)]
struct Move {
    start_s: f64,
    duration_s: f64,
    from: [f64; MAX_JOINTS],
    to: [f64; MAX_JOINTS],
}

/// Moves all joints together from pose to pose, for ever.
#[derive(Clone, Debug)]
pub struct PointToPoint {
    dof: usize,
    moves: Vec<Move>,
    cycle_s: f64,
}

/// No move is shorter \[s\]: the profile's jerk grows with the inverse cube.
const SHORTEST_S: f64 = 0.3;

impl PointToPoint {
    /// Draws the poses; a move that needs too much of the nominal arm's torque (`load` is its torque ratio) takes longer.
    pub fn new(limits: &MotionLimits, settings: &PointToPointSettings, load: &mut LoadRatio<'_>) -> Self {
        let dof = limits.home.len();
        let mut random = Random::stream(settings.seed, 0x92);
        let mut home = [0.0; MAX_JOINTS];
        home[..dof].copy_from_slice(&limits.home);
        let mut chain = Self { dof, moves: Vec::with_capacity(settings.moves), cycle_s: 0.0 };
        let mut from = home;
        let count = settings.moves.max(2);
        for k in 0..count {
            let last = k + 1 == count;
            let speed = if last { 0.5 } else { random.uniform(settings.slowest, 1.0) };
            let mut to = home;
            if !last {
                for j in 0..dof {
                    to[j] = limits.home[j] + limits.reach[j] * random.uniform(-1.0, 1.0);
                }
            }
            let duration = |to: &[f64; MAX_JOINTS]| {
                (0..dof)
                    .map(|j| QUINTIC_PEAK_VELOCITY * (to[j] - from[j]).abs() / (speed * limits.velocity[j]))
                    .fold(0.0, f64::max)
            };
            let needed = duration(&to);
            // The way home keeps its length, or the chain would not close.
            if needed > settings.longest_s && !last {
                for j in 0..dof {
                    to[j] = from[j] + (to[j] - from[j]) * settings.longest_s / needed;
                }
            }
            let mut step = Move { start_s: chain.cycle_s, duration_s: duration(&to).max(SHORTEST_S), from, to };
            for _ in 0..20 {
                if worst_load(&step, dof, load) <= LARGEST_LOAD {
                    break;
                }
                step.duration_s *= 1.15;
            }
            chain.cycle_s += step.duration_s + settings.dwell_s;
            chain.moves.push(step);
            from = to;
        }
        chain
    }

    /// Time until the arm is back home and the moves repeat \[s\].
    pub fn cycle_s(&self) -> f64 {
        self.cycle_s
    }
}

fn worst_load(step: &Move, dof: usize, load: &mut LoadRatio<'_>) -> f64 {
    let (mut q, mut qd, mut qdd) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
    let mut worst = 0.0_f64;
    for k in 0..=32 {
        step.at(step.duration_s * f64::from(k) / 32.0, &mut q[..dof], &mut qd[..dof], &mut qdd[..dof]);
        worst = worst.max(load(&q[..dof], &qd[..dof], &qdd[..dof]));
    }
    worst
}

impl Move {
    fn at(&self, since_s: f64, q: &mut [f64], qd: &mut [f64], qdd: &mut [f64]) {
        let (s, ds, dds) = quintic(since_s / self.duration_s);
        for j in 0..q.len() {
            let way = self.to[j] - self.from[j];
            q[j] = self.from[j] + way * s;
            qd[j] = way * ds / self.duration_s;
            qdd[j] = way * dds / (self.duration_s * self.duration_s);
        }
    }
}

impl Trajectory for PointToPoint {
    fn dof(&self) -> usize {
        self.dof
    }

    fn sample(&self, t_s: f64, q: &mut [f64], qd: &mut [f64], qdd: &mut [f64]) {
        let t = t_s.rem_euclid(self.cycle_s);
        let next = self.moves.partition_point(|step| step.start_s <= t);
        let step = &self.moves[next.saturating_sub(1)];
        step.at(t - step.start_s, q, qd, qdd);
    }
}
