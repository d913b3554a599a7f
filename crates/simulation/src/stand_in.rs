//! The robot controller's decisions, period by period: brakes, planner, plant. No clock, bus or file.

use crate::mechanics::Vector;
use crate::motion::Governor;
use crate::plant::Plant;
use rivet_dynamics::MAX_JOINTS;
use rivet_ipc_schema::{Command, CommandMode};
use serde::Serialize;

/// What is published of one period.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Counts from 1.
    pub seq: u64,
    /// Simulated time \[s\].
    pub t_s: f64,
    /// The brakes are closed and the drives off.
    pub braked: bool,
    /// Joint count.
    pub dof: usize,
    /// Measured positions \[rad\].
    pub q: Vector,
    /// Measured torques \[N·m\].
    pub tau: Vector,
    /// Planned positions \[rad\].
    pub q_des: Vector,
    /// Planned velocities \[rad/s\].
    pub qd_des: Vector,
    /// Planned accelerations \[rad/s²\].
    pub qdd_des: Vector,
}

/// How often what happened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Periods simulated.
    pub samples: u64,
    /// Of these, with the brakes open when the sensors were latched.
    pub moving: u64,
    /// Moving periods without an answer to their own sample; an earlier command acted on.
    pub late_commands: u64,
    /// Times the brakes closed because commands stayed away.
    pub brake_engagements: u64,
    /// Commands refused: wrong joint count, not finite, or for a sample that does not exist.
    pub refused_commands: u64,
}

/// Tracking error over a stretch of time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TrackingBlock {
    /// Motion time at its start \[s\].
    pub from_s: f64,
    /// Motion time at its end \[s\].
    pub to_s: f64,
    /// Share of its commands that were computed with identified parameters, 0..1.
    pub identified_share: f64,
    /// Root mean square of planned minus true position, per joint \[rad\].
    pub rms: Vec<f64>,
}

/// Time for which commands must have come before the brakes open \[s\]: the torque builds up against closed brakes, as in a
/// real drive. A controller that ramps its torque up, or takes its time to start, has then reached the same state whenever
/// it appeared, and the run repeats bit for bit.
pub const BUILD_UP_S: f64 = 0.2;

/// Length of a tracking block \[s\].
pub const BLOCK_S: f64 = 5.0;

#[derive(Debug, Default)]
struct OpenBlock {
    periods: u64,
    identified: u64,
    squares: Vector,
}

/// Plays the robot controller: `latch` a sample, publish it, `advance` with the command found.
pub struct StandIn {
    plant: Plant,
    governor: Governor,
    period_s: f64,
    /// Periods without a command after which the brakes close.
    stale_periods: u64,
    /// Periods with commands after which they open, and how many there were in a row.
    build_up: u64,
    alive_for: u64,
    seed: u64,
    seq: u64,
    command: Vector,
    answered: u64,
    counts: Counts,
    open: OpenBlock,
    blocks: Vec<TrackingBlock>,
}

impl StandIn {
    /// The arm stands braked at the motion's start. Until the brakes first open every sample has the same noise, the first of
    /// `seed`: how long the controller took to appear then makes no difference to the run, which repeats bit for bit.
    pub fn new(mut plant: Plant, governor: Governor, period_s: f64, stale_periods: u64, seed: u64) -> Self {
        let home = governor.q().to_vec();
        plant.place(&home, &[0.0; MAX_JOINTS]);
        plant.set_brake(true);
        Self {
            plant,
            governor,
            period_s,
            stale_periods: stale_periods.max(1),
            build_up: (BUILD_UP_S / period_s).ceil() as u64,
            alive_for: 0,
            seed,
            seq: 1,
            command: [0.0; MAX_JOINTS],
            answered: 0,
            counts: Counts::default(),
            open: OpenBlock::default(),
            blocks: Vec::new(),
        }
    }

    /// Latches the sensors. Once a period.
    pub fn latch(&mut self) -> Sample {
        if self.plant.braked() && self.counts.moving == 0 {
            self.plant.reseed(self.seed);
        }
        let measured = self.plant.measure();
        let all = |values: &[f64]| {
            let mut vector = [0.0; MAX_JOINTS];
            vector[..values.len()].copy_from_slice(values);
            vector
        };
        Sample {
            seq: self.seq,
            t_s: (self.seq - 1) as f64 * self.period_s,
            braked: self.plant.braked(),
            dof: self.plant.dof(),
            q: all(measured.q()),
            tau: all(measured.tau()),
            q_des: all(self.governor.q()),
            qd_des: all(self.governor.qd()),
            qdd_des: all(self.governor.qdd()),
        }
    }

    /// Whether the brakes are closed.
    pub fn braked(&self) -> bool {
        self.plant.braked()
    }

    /// Whether any command has come so far.
    pub fn commanded(&self) -> bool {
        self.answered > 0
    }

    /// Whether `command` answers the sample last latched.
    pub fn is_answer(&self, command: &Command) -> bool {
        command.seq == self.seq && command.mode != u32::from(CommandMode::None)
    }

    /// Ends the period: the newest `command` acts, the plan and the plant go on.
    ///
    /// A command may be older than the sample (it then counts as late) by less than the stale periods; without one that new
    /// the brakes close, and stay closed until commands have come again for [`BUILD_UP_S`].
    pub fn advance(&mut self, command: Option<&Command>) {
        let fresh = command.filter(|c| self.acceptable(c));
        if let Some(c) = fresh
            && c.seq > self.answered
        {
            self.answered = c.seq;
            self.command = c.tau;
        }
        let identified = fresh.is_some_and(|c| c.mode == u32::from(CommandMode::Identified));
        // Counted as its sample was published: in the period of the release the sample still says braked.
        let moved = !self.plant.braked();
        let alive = self.answered > 0 && self.seq - self.answered < self.stale_periods;
        self.alive_for = if alive { self.alive_for + 1 } else { 0 };
        if self.plant.braked() && self.alive_for > self.build_up {
            self.plant.set_brake(false);
            self.governor.release();
        } else if !alive && !self.plant.braked() {
            self.counts.brake_engagements += 1;
            self.plant.set_brake(true);
        }
        self.counts.samples += 1;
        if moved {
            self.counts.moving += 1;
            self.counts.late_commands += u64::from(self.answered != self.seq);
            self.track(identified);
        }
        let n = self.plant.dof();
        self.plant.step(&self.command[..n]);
        if self.plant.braked() {
            self.governor.halt(self.plant.q());
        }
        self.governor.advance(self.period_s);
        self.seq += 1;
    }

    fn acceptable(&mut self, c: &Command) -> bool {
        if c.mode == u32::from(CommandMode::None) {
            return false;
        }
        let n = self.plant.dof();
        let sound = c.joints as usize == n && c.tau[..n].iter().all(|tau| tau.is_finite()) && c.seq <= self.seq;
        self.counts.refused_commands += u64::from(!sound);
        sound
    }

    fn track(&mut self, identified: bool) {
        for (j, (planned, true_q)) in self.governor.q().iter().zip(self.plant.q()).enumerate() {
            self.open.squares[j] += (planned - true_q) * (planned - true_q);
        }
        self.open.periods += 1;
        self.open.identified += u64::from(identified);
        if self.open.periods as f64 * self.period_s >= BLOCK_S - 0.5 * self.period_s {
            self.close_block();
        }
    }

    fn close_block(&mut self) {
        let block = core::mem::take(&mut self.open);
        if block.periods == 0 {
            return;
        }
        let periods = block.periods as f64;
        let to_s = self.counts.moving as f64 * self.period_s;
        self.blocks.push(TrackingBlock {
            from_s: to_s - periods * self.period_s,
            to_s,
            identified_share: block.identified as f64 / periods,
            rms: block.squares[..self.plant.dof()].iter().map(|sum| (sum / periods).sqrt()).collect(),
        });
    }

    /// Motion time \[s\]: periods with the brakes open.
    pub fn motion_s(&self) -> f64 {
        self.counts.moving as f64 * self.period_s
    }

    /// Whether the motion has come to its end, where it has one.
    pub fn is_over(&self) -> bool {
        self.governor.is_over()
    }

    /// What happened so far.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Tracking errors in blocks of five seconds, the last one shorter; and periods each drive spent at its limit.
    pub fn finish(mut self) -> (Vec<TrackingBlock>, Vec<u64>) {
        self.close_block();
        (self.blocks, self.plant.saturated().to_vec())
    }
}
