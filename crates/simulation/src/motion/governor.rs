//! The planner's behaviour around the brakes: stand still while they hold, then run the motion in from the pose held.

use super::{QUINTIC_PEAK_VELOCITY, Trajectory, quintic};
use rivet_dynamics::MAX_JOINTS;

/// Runs a trajectory period by period with stops in between.
///
/// While halted the setpoint is the pose held. After a release the motion's clock starts from standstill and gathers speed
/// over a second while the distance between the pose held and the trajectory is closed by a quintic, so that position,
/// velocity and acceleration of the setpoint are continuous and start at rest whatever the trajectory does at that moment.
pub struct Governor {
    trajectory: Box<dyn Trajectory>,
    /// The motion's own clock \[s\]; slower than real time while running in.
    motion_s: f64,
    /// Time since the release \[s\].
    since_s: f64,
    run_in_s: f64,
    /// Pose held minus trajectory at the moment of release \[rad\].
    gap: [f64; MAX_JOINTS],
    halted: bool,
    q: [f64; MAX_JOINTS],
    qd: [f64; MAX_JOINTS],
    qdd: [f64; MAX_JOINTS],
}

/// Time in which the motion's clock reaches full speed \[s\].
const CLOCK_S: f64 = 1.0;
/// Speed at which the gap to the trajectory is closed \[rad/s\].
const GAP_SPEED: f64 = 0.5;

impl Governor {
    /// Halted at the trajectory's first pose.
    pub fn new(trajectory: Box<dyn Trajectory>) -> Self {
        let n = trajectory.dof();
        let (mut q, mut qd, mut qdd) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
        trajectory.sample(0.0, &mut q[..n], &mut qd[..n], &mut qdd[..n]);
        let rest = [0.0; MAX_JOINTS];
        Self {
            trajectory,
            motion_s: 0.0,
            since_s: 0.0,
            run_in_s: CLOCK_S,
            gap: rest,
            halted: true,
            q,
            qd: rest,
            qdd: rest,
        }
    }

    /// Whether the motion has come to its end, where it has one.
    pub fn is_over(&self) -> bool {
        self.trajectory.ends_s().is_some_and(|end| self.motion_s >= end)
    }

    /// Position of the setpoint of this period \[rad\].
    pub fn q(&self) -> &[f64] {
        &self.q[..self.trajectory.dof()]
    }

    /// Velocity of the setpoint of this period \[rad/s\].
    pub fn qd(&self) -> &[f64] {
        &self.qd[..self.trajectory.dof()]
    }

    /// Acceleration of the setpoint of this period \[rad/s²\].
    pub fn qdd(&self) -> &[f64] {
        &self.qdd[..self.trajectory.dof()]
    }

    /// Stops the motion's clock; the setpoint becomes `pose`, at rest.
    pub fn halt(&mut self, pose: &[f64]) {
        self.halted = true;
        self.q[..pose.len()].copy_from_slice(pose);
        self.qd.fill(0.0);
        self.qdd.fill(0.0);
    }

    /// Lets the motion run on, from the pose held. Does nothing while it runs.
    pub fn release(&mut self) {
        if !self.halted {
            return;
        }
        let n = self.trajectory.dof();
        let held = self.q;
        self.trajectory.sample(self.motion_s, &mut self.q[..n], &mut self.qd[..n], &mut self.qdd[..n]);
        let mut widest = 0.0_f64;
        for j in 0..n {
            self.gap[j] = held[j] - self.q[j];
            widest = widest.max(self.gap[j].abs());
        }
        self.q = held;
        self.qd.fill(0.0);
        self.qdd.fill(0.0);
        self.run_in_s = CLOCK_S.max(QUINTIC_PEAK_VELOCITY * widest / GAP_SPEED);
        self.since_s = 0.0;
        self.halted = false;
    }

    /// Goes on to the next period, `period_s` later.
    pub fn advance(&mut self, period_s: f64) {
        if self.halted {
            return;
        }
        let n = self.trajectory.dof();
        self.since_s += period_s;
        let run_in = self.run_in_s;
        // Clock rate r(t) rises as a quintic; the clock itself is its exact integral, T * (2.5 x^4 - 3 x^5 + x^6).
        let clock = |t: f64| {
            let x = (t / run_in).min(1.0);
            run_in * x.powi(4) * (2.5 - 3.0 * x + x * x) + (t - run_in).max(0.0)
        };
        self.motion_s += clock(self.since_s) - clock(self.since_s - period_s);
        let x = self.since_s / run_in;
        let (rate, rate_x, _) = quintic(x);
        let rate_t = rate_x / run_in;
        self.trajectory.sample(self.motion_s, &mut self.q[..n], &mut self.qd[..n], &mut self.qdd[..n]);
        let (s, ds, dds) = quintic(x);
        for j in 0..n {
            self.qdd[j] = self.qdd[j] * rate * rate + self.qd[j] * rate_t - self.gap[j] * dds / (run_in * run_in);
            self.qd[j] = self.qd[j] * rate - self.gap[j] * ds / run_in;
            self.q[j] += self.gap[j] * (1.0 - s);
        }
    }
}
