//! Every decision of the controller, with no clock, bus or thread in it.

use crate::gate::{Gate, Refusal};
use crate::law::{ComputedTorque, Desired, Gains};
use crate::output::{Limits, Output};
use crate::velocity::VelocityFilter;
use rivet_config::Robot;
use rivet_dynamics::MAX_JOINTS;
use rivet_ipc_schema::{Command, CommandMode, JointState, MAX_PARAMETERS, Parameters, Setpoint, faults};
use std::sync::Arc;

/// Why a sample got no command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Skipped {
    /// Its sequence number is not newer than the last one.
    Stale,
    /// Fault bits, a wrong joint count or a position that is not finite: the arm's state is not known.
    Invalid,
}

/// What happened so far, for the log and the tests.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Counts {
    /// Commands made.
    pub commands: u64,
    /// Samples that were skipped over (the controller takes the newest).
    pub passed_over: u64,
    /// Stale samples.
    pub stale: u64,
    /// Invalid samples.
    pub invalid: u64,
    /// Parameter sets adopted.
    pub adopted: u64,
    /// Parameter sets refused.
    pub refused: u64,
    /// Commands in which the law gave a torque that is not finite.
    pub broken: u64,
}

/// The controller's state between two periods.
pub struct Core {
    law: ComputedTorque,
    gate: Gate,
    output: Output,
    velocity: VelocityFilter,
    dof: usize,
    count: usize,
    /// Parameters that act now; move towards `target` so that a switch is no torque step.
    acting: [f64; MAX_PARAMETERS],
    target: [f64; MAX_PARAMETERS],
    blend: f64,
    epoch: u64,
    parameters_seq: u64,
    last_refusal: Refusal,
    desired: Option<Desired>,
    desired_seq: u64,
    /// Whether `desired` is a planner's, not the place where the arm is held.
    following: bool,
    adopt_from_seq: u64,
    last_seq: Option<u64>,
    stale_run: u64,
    stale_periods: u64,
    counts: Counts,
}

/// Time constant with which acting parameters follow adopted ones \[s\]: short beside the motion, long beside a period.
const BLEND_S: f64 = 0.05;

/// Consecutive old samples after which the robot controller counts as restarted.
const RESTART_RUN: u64 = 100;

impl Core {
    /// Starts on the nominal parameters of the robot file. `adopt_from_seq`: published parameters act only from that
    /// sample on (0: at once; `u64::MAX`: never, the nominal model stays).
    pub fn new(robot: &Robot, adopt_from_seq: u64) -> Core {
        let settings = &robot.config.controller;
        let dof = robot.model.arm.dof();
        let gains = Gains::from_bandwidth(&settings.bandwidth_hz, settings.damping);
        let law = ComputedTorque::new(Arc::clone(&robot.model), Arc::clone(&robot.base), gains);
        let period = robot.config.sample_period_s;
        // Without a limit in the file: from nothing to full torque in a tenth of a second.
        let rates = settings.rate_limit.clone();
        let rates = rates.unwrap_or_else(|| robot.config.drive.torque_limit.iter().map(|limit| 10.0 * limit).collect());
        let step = rates.iter().map(|rate| rate * period).collect();
        let mut acting = [0.0; MAX_PARAMETERS];
        let start = robot.base_parameters();
        let count = start.len().min(MAX_PARAMETERS);
        acting[..count].copy_from_slice(&start[..count]);
        Core {
            law,
            gate: Gate::new(&robot.model, &robot.base.independent, robot.hash),
            output: Output::new(Limits { torque: robot.config.drive.torque_limit.clone(), step }),
            velocity: VelocityFilter::new(period, settings.velocity_filter_hz),
            dof,
            count,
            acting,
            target: acting,
            blend: 1.0 - (-period / BLEND_S).exp(),
            epoch: 0,
            parameters_seq: 0,
            last_refusal: Refusal::None,
            desired: None,
            desired_seq: 0,
            following: false,
            adopt_from_seq,
            last_seq: None,
            stale_run: 0,
            stale_periods: settings.stale_periods as u64,
            counts: Counts::default(),
        }
    }

    /// Takes in a setpoint; the newest with valid numbers stays.
    pub fn offer_setpoint(&mut self, setpoint: &Setpoint) {
        let n = self.dof;
        let finite = |values: &[f64; MAX_JOINTS]| values[..n].iter().all(|v| v.is_finite());
        let newer = !self.following || setpoint.seq > self.desired_seq;
        if newer && finite(&setpoint.q) && finite(&setpoint.qd) && finite(&setpoint.qdd) {
            self.desired = Some(Desired { q: setpoint.q, qd: setpoint.qd, qdd: setpoint.qdd });
            self.desired_seq = setpoint.seq;
            self.following = true;
        }
    }

    /// Takes in a published parameter set, which is used if it passes the gate at the pose of `sample`.
    pub fn offer_parameters(&mut self, set: &Parameters, sample: &JointState) -> Refusal {
        if sample.seq < self.adopt_from_seq {
            return Refusal::None;
        }
        let refusal = self.gate.check(set, self.parameters_seq, &sample.q[..self.dof], &mut self.law);
        if refusal == Refusal::None {
            self.target[..self.count].copy_from_slice(&set.values[..self.count]);
            self.epoch = set.epoch;
            self.parameters_seq = set.seq;
            self.counts.adopted += 1;
        } else {
            self.counts.refused += 1;
        }
        self.last_refusal = refusal;
        refusal
    }

    /// Answers one sample. Without any setpoint so far the arm is held where it is.
    ///
    /// # Errors
    /// Why there is no command for this sample; the robot's own watchdog acts if that goes on.
    pub fn tick(&mut self, sample: &JointState) -> Result<Command, Skipped> {
        let n = self.dof;
        if self.last_seq.is_some_and(|last| sample.seq <= last) {
            self.counts.stale += 1;
            self.stale_run += 1;
            if self.stale_run < RESTART_RUN {
                return Err(Skipped::Stale);
            }
            // So long a run of old numbers is a robot controller that was started anew.
            self.last_seq = None;
            self.parameters_seq = 0;
            self.desired = None;
            self.following = false;
        }
        self.stale_run = 0;
        // An arm that stands in its brakes is answered: the brakes open when there is a command.
        let faults = sample.faults & !faults::STOPPED;
        if faults != 0 || sample.count() != n || !sample.q[..n].iter().all(|q| q.is_finite()) {
            self.counts.invalid += 1;
            return Err(Skipped::Invalid);
        }
        let periods = self.last_seq.map_or(1, |last| sample.seq - last);
        self.counts.passed_over += periods - 1;
        self.last_seq = Some(sample.seq);
        if periods > self.stale_periods {
            // The robot's own watchdog has stopped the arm meanwhile: start as at first, from zero torque.
            self.output.restart();
            self.velocity.restart();
        }
        if self.following && self.desired_seq.saturating_add(self.stale_periods) < sample.seq {
            // Nobody plans any more: the arm is held where it is.
            self.desired = None;
            self.following = false;
        }

        let qd = *self.velocity.update(&sample.q[..n], periods);
        let desired = *self.desired.get_or_insert(Desired { q: sample.q, ..Desired::default() });
        for i in 0..self.count {
            self.acting[i] += self.blend * (self.target[i] - self.acting[i]);
        }
        let mut tau = [0.0; MAX_JOINTS];
        self.law.torque(&sample.q[..n], &qd[..n], &desired, &self.acting[..self.count], &mut tau[..n]);
        if self.output.apply(&mut tau[..n]) {
            self.counts.broken += 1;
        }
        self.counts.commands += 1;
        let mode =
            if self.epoch > 0 || self.counts.adopted > 0 { CommandMode::Identified } else { CommandMode::Nominal };
        Ok(Command { seq: sample.seq, stamp_ns: sample.stamp_ns, tau, joints: sample.joints, mode: mode.into() })
    }

    /// What happened so far.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// The outcome of the last parameter set offered.
    pub fn last_refusal(&self) -> Refusal {
        self.last_refusal
    }

    /// Epoch of the set adopted last; 0 while the nominal values act.
    pub fn epoch(&self) -> u64 {
        self.epoch
    }
}
