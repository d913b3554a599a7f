//! Every decision of the controller, with no clock, bus or thread in it.

use crate::gate::{Gate, Newest, Refusal};
use crate::law::{ControlLaw, Desired, Gains};
use crate::limits::SetpointLimits;
use crate::output::{Limits, Output};
use crate::recent::{Recent, Verdict};
use crate::source::{Sources, Values};
use crate::stop::{LastSeen, Stop};
use crate::velocity::VelocityFilter;
use rivet_config::Robot;
use rivet_dynamics::{EffectKind, MAX_JOINTS};
use rivet_estimation::SettingsError;
use rivet_ipc_schema::{
    Command, CommandMode, ControllerHealth, ControllerState, JointState, MAX_PARAMETERS, OldNumbers, ParameterSource,
    Parameters, REFUSALS, SampleClock, Setpoint, faults,
};
use std::sync::Arc;

/// Why a sample got no command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Skipped {
    /// Its sequence number is not newer than the last one.
    Stale,
    /// Fault bits, a wrong joint count or a position that is not finite: the arm's state is not known.
    Invalid,
    /// Samples come at another rate than the robot file says: velocities and rate limits would be wrong.
    WrongPeriod,
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
    /// Samples that came at another rate than the robot file says.
    pub wrong_period: u64,
    /// Parameter sets that passed the gate.
    pub accepted: u64,
    /// Parameter sets that did not.
    pub refused: u64,
    /// Commands in which the law gave a torque that is not finite.
    pub broken: u64,
    /// Commands in which a joint was at its torque limit.
    pub saturated: u64,
    /// Commands in which a joint was held back by its rate limit.
    pub rate_limited: u64,
    /// Setpoints beyond a joint's limits.
    pub setpoints_limited: u64,
    /// Times the stop reaction began.
    pub stops: u64,
    /// Times the arm was further from the plan than it may be.
    pub strayed: u64,
}

/// The controller's state between two periods.
pub struct Core {
    law: ControlLaw,
    gate: Gate,
    recent: Recent,
    sources: Sources,
    output: Output,
    clock: SampleClock,
    /// Whether the rate of the samples has been right at some time.
    confirmed: bool,
    velocity: VelocityFilter,
    limits: SetpointLimits,
    stop: Stop,
    dof: usize,
    count: usize,
    period_s: f64,
    /// Parameters that act now; they move towards those of the source, so that a switch is no torque step.
    acting: Values,
    blend: f64,
    newest: Newest,
    last_refusal: Refusal,
    refusals: [u64; REFUSALS],
    plan: Option<(u64, Desired)>,
    /// Whether the plan is followed; else the arm is held at `held`.
    following: bool,
    held: Option<[f64; MAX_JOINTS]>,
    adopt_from_seq: u64,
    last_seq: Option<u64>,
    observed_seq: Option<u64>,
    old: OldNumbers,
    stale_periods: u64,
    seen: LastSeen,
    joints: u32,
    /// The torque at which the stop reaction began, while it acts.
    stopping: Option<[f64; MAX_JOINTS]>,
    /// Periods without a usable sample that have had their command.
    missed: u64,
    /// The arm was further from the plan than it may be, and has not come to rest since.
    strayed: bool,
    tracking: [f64; MAX_JOINTS],
    counts: Counts,
}

/// Time constant with which acting parameters follow those of the source \[s\]: short beside the motion, long beside a
/// period.
const BLEND_S: f64 = 0.05;

/// A plan further than this from the arm is not joined \[rad\]: the way there is the planner's to plan.
const REJOIN: f64 = 0.2;

/// A plan that the arm has come further away from is left \[rad\]: with the drives at their limits feedback no longer brings
/// the arm back, it may even drive it on. The arm is braked instead, and joins the plan again where that comes near.
const STRAYED: f64 = 0.5;

/// Time constant with which an arm that has strayed is braked \[s\]: slow enough for the rate limit to follow.
const BRAKING_S: f64 = 0.1;

/// Speed below which an arm that has strayed counts as standing \[rad/s\].
const STANDING: f64 = 0.05;

/// Memory of the tracking error that is reported \[s\].
const TRACKING_S: f64 = 1.0;

/// What the drives take, less where it is known that they do not deliver it.
fn torque_limits(robot: &Robot) -> Vec<f64> {
    let mut limits = robot.config.drive.torque_limit.clone();
    for effect in robot.model.effects().list().iter().filter(|e| e.kind == EffectKind::TorqueSaturation) {
        limits[effect.joint] = limits[effect.joint].min(effect.values[0]);
    }
    limits
}

impl Core {
    /// Starts on the parameters of the robot file. `adopt_from_seq`: published parameters act only from that sample on
    /// (0: at once; `u64::MAX`: never, the robot file's stay).
    ///
    /// # Errors
    /// Settings of the signal chain that cannot be used with this arm.
    pub fn new(robot: &Robot, adopt_from_seq: u64) -> Result<Core, SettingsError> {
        let settings = &robot.config.controller;
        let dof = robot.dof();
        let start = robot.base_parameters();
        let count = start.len().min(MAX_PARAMETERS);
        let mut nominal = [0.0; MAX_PARAMETERS];
        nominal[..count].copy_from_slice(&start[..count]);
        let period_s = robot.config.sample_period_s;
        let gains = Gains::from_bandwidth(&settings.bandwidth_hz, settings.damping, settings.integral_hz);
        let (model, base) = (Arc::clone(&robot.model), Arc::clone(&robot.base));
        let mut law = ControlLaw::new(settings.law, model, base, start, gains, period_s);
        // Without a limit in the file: from nothing to full torque in a tenth of a second.
        let rates = settings.rate_limit.clone();
        let rates = rates.unwrap_or_else(|| robot.config.drive.torque_limit.iter().map(|limit| 10.0 * limit).collect());
        let step = rates.iter().map(|rate| rate * period_s).collect();
        let timeout = (settings.parameter_timeout_s / period_s).ceil() as u64;
        let recent = Recent::new(robot)?;
        let (row, apart) = (settings.return_after as u32, recent.periods_between());
        Ok(Core {
            gate: Gate::new(robot, &mut law),
            law,
            recent,
            sources: Sources::new(&nominal, timeout, row, apart, period_s),
            output: Output::new(Limits { torque: torque_limits(robot), step }),
            clock: SampleClock::new(period_s),
            confirmed: false,
            velocity: VelocityFilter::new(period_s, settings.velocity_filter_hz),
            limits: SetpointLimits::of(&robot.model.arm),
            stop: Stop { reaction: settings.stop_reaction, time_s: settings.stop_time_s },
            dof,
            count,
            period_s,
            acting: nominal,
            blend: 1.0 - (-period_s / BLEND_S).exp(),
            newest: Newest::default(),
            last_refusal: Refusal::None,
            refusals: [0; REFUSALS],
            plan: None,
            following: false,
            held: None,
            adopt_from_seq,
            last_seq: None,
            observed_seq: None,
            old: OldNumbers::default(),
            stale_periods: settings.stale_periods as u64,
            seen: LastSeen::default(),
            joints: dof as u32,
            stopping: None,
            missed: 0,
            strayed: false,
            tracking: [0.0; MAX_JOINTS],
            counts: Counts::default(),
        })
    }

    /// Before the first sample: starts on `values`, the last good parameters of an earlier run, instead of the robot
    /// file's.
    ///
    /// # Errors
    /// Why they may not act; the robot file's stay.
    pub fn recall(&mut self, values: &[f64]) -> Result<(), Refusal> {
        if values.len() != self.count {
            return Err(Refusal::WrongCount);
        }
        self.gate.check_physics(values, None, &mut self.law)?;
        let mut stored = [0.0; MAX_PARAMETERS];
        stored[..self.count].copy_from_slice(values);
        self.sources.recall(&stored);
        self.acting = stored;
        Ok(())
    }

    /// Takes in a setpoint; the newest with valid numbers stays.
    pub fn offer_setpoint(&mut self, setpoint: &Setpoint) {
        let n = self.dof;
        let finite = |values: &[f64; MAX_JOINTS]| values[..n].iter().all(|v| v.is_finite());
        let newer = !self.following || self.plan.is_none_or(|(seq, _)| setpoint.seq > seq);
        if newer && setpoint.count() == n && finite(&setpoint.q) && finite(&setpoint.qd) && finite(&setpoint.qdd) {
            let mut desired = Desired { q: setpoint.q, qd: setpoint.qd, qdd: setpoint.qdd };
            self.counts.setpoints_limited += u64::from(self.limits.apply(&mut desired));
            self.plan = Some((setpoint.seq, desired));
        }
    }

    /// Takes in a published parameter set at the pose of `sample`; whether it passes the gate is returned and counted.
    ///
    /// Real-time safe: bounded work.
    pub fn offer_parameters(&mut self, set: &Parameters, sample: &JointState) -> Refusal {
        if sample.seq < self.adopt_from_seq {
            return Refusal::None;
        }
        let refusal = self.judge(set, sample).err().unwrap_or(Refusal::None);
        if refusal == Refusal::None {
            let mut values = [0.0; MAX_PARAMETERS];
            values[..self.count].copy_from_slice(&set.values[..self.count]);
            self.sources.accept(&values);
            self.newest = Newest { epoch: set.epoch, seq: set.seq, alive: true };
            self.counts.accepted += 1;
        } else {
            self.sources.refuse();
            self.counts.refused += 1;
        }
        if let Some(count) = self.refusals.get_mut(u32::from(refusal) as usize) {
            *count += 1;
        }
        self.last_refusal = refusal;
        refusal
    }

    fn judge(&mut self, set: &Parameters, sample: &JointState) -> Result<(), Refusal> {
        let n = self.dof;
        if !self.clock.fits() {
            return Err(Refusal::OtherPeriod);
        }
        let newest = Newest { alive: self.sources.alive(), ..self.newest };
        self.gate.check_message(set, newest, sample.seq)?;
        let q = &sample.q[..n];
        if sample.count() != n || !q.iter().all(|q| q.is_finite()) {
            return Err(Refusal::NotJudged);
        }
        let values = &set.values[..self.count];
        self.gate.check_physics(values, Some(q), &mut self.law)?;
        let target = self.sources.target();
        let same = values == &target[..self.count];
        let desired = match self.plan.filter(|_| self.following) {
            Some((_, desired)) => desired,
            None => Desired { q: sample.q, ..Desired::default() },
        };
        self.gate.check_change(values, &target[..self.count], &desired, &mut self.law)?;
        if same {
            // A daemon that holds says the same again and again: nothing to judge, and no reason to mistrust it.
            return Ok(());
        }
        let candidate = self.recent.predict(values);
        // Where the robot file's values are poor, much is no worse than they are: what comes after a good set is measured by
        // that, although it does not act yet.
        let (kept, waiting) = (self.sources.last_good(), self.sources.waiting());
        for reference in [Some(target), kept, waiting, Some(self.sources.nominal())].into_iter().flatten() {
            match self.recent.compare(&candidate, &self.recent.predict(&reference[..self.count])) {
                Verdict::NoWorse => {}
                Verdict::Worse => return Err(Refusal::PredictsWorse),
                Verdict::Unknown => return Err(Refusal::NotJudged),
            }
        }
        Ok(())
    }

    /// Takes in a sample that will not be answered, because a newer one is at hand: the torques in it are still worth
    /// remembering.
    pub fn observe(&mut self, sample: &JointState) {
        let n = self.dof;
        if self.sound(sample) && sample.faults == 0 {
            if self.observed_seq.is_some_and(|last| last.checked_add(1) != Some(sample.seq)) {
                self.recent.restart_signals();
            }
            if self.recent.push(&sample.q[..n], &sample.tau[..n]) {
                self.reconsider(&sample.q[..n]);
            }
        }
        self.observed_seq = Some(sample.seq);
    }

    /// Asks the pose and recent torques whether the right parameters act.
    fn reconsider(&mut self, q: &[f64]) {
        let judged = self.sources.source() != ParameterSource::Nominal;
        if judged && !self.gate.has_inertia(&self.sources.target()[..self.count], q, &mut self.law) {
            let kept = self.sources.last_good().copied();
            let sound = kept.is_some_and(|x| self.gate.has_inertia(&x[..self.count], q, &mut self.law));
            self.sources.distrust(sound);
        }
        let periods = self.recent.periods_between();
        let of = |values: &Values| self.recent.predict(&values[..self.count]);
        let (acting, nominal) = (of(self.sources.target()), of(self.sources.nominal()));
        let last_good = self.sources.last_good().map(of);
        let change = match (self.sources.source(), &last_good) {
            (ParameterSource::Nominal, Some(stored)) => self.recent.compare(&nominal, stored) == Verdict::Worse,
            (ParameterSource::Nominal, None) => false,
            _ => self.recent.compare(&acting, &nominal) == Verdict::Worse,
        };
        // What every new set is measured by must not get worse in small steps.
        let proven = last_good.is_none_or(|stored| self.recent.as_good(&acting, &stored))
            && self.recent.compare(&acting, &nominal) == Verdict::NoWorse;
        if proven {
            self.sources.keep();
        }
        self.sources.compare(change, periods);
    }

    fn sound(&self, sample: &JointState) -> bool {
        // An arm that stands in its brakes is answered: the brakes open when there is a command.
        sample.faults & !faults::STOPPED == 0
            && sample.count() == self.dof
            && sample.q[..self.dof].iter().all(|q| q.is_finite())
    }

    /// Answers one sample. Without a plan near the arm, that is held where it is.
    ///
    /// Real-time safe: bounded work; no allocation, lock, system call or panic.
    ///
    /// # Errors
    /// Why there is no command for this sample; the stop reaction follows if that goes on ([`missing`](Self::missing)).
    pub fn tick(&mut self, sample: &JointState) -> Result<Command, Skipped> {
        let n = self.dof;
        if self.last_seq.is_some_and(|last| sample.seq <= last) {
            self.counts.stale += 1;
            if !self.old.take(sample.seq) {
                return Err(Skipped::Stale);
            }
            self.last_seq = None;
            self.newest = Newest::default();
            self.plan = None;
            self.recent.restart();
            self.begin_anew();
        }
        self.old.end();
        if !self.clock.take(sample.seq, sample.stamp_ns) {
            self.counts.wrong_period += 1;
            return Err(Skipped::WrongPeriod);
        }
        self.confirmed |= self.clock.confirmed();
        if !self.sound(sample) {
            self.counts.invalid += 1;
            return Err(Skipped::Invalid);
        }
        self.observe(sample);
        let periods = self.last_seq.map_or(1, |last| sample.seq - last);
        self.counts.passed_over += periods - 1;
        self.last_seq = Some(sample.seq);
        self.missed = 0;
        if self.stopping.take().is_some() || periods > self.stale_periods {
            self.begin_anew();
        }
        self.sources.advance(periods);

        let qd = *self.velocity.update(&sample.q[..n], periods);
        self.seen = LastSeen { q: sample.q, qd };
        let desired = self.desired(sample, &qd);
        self.blend_parameters();
        let mut tau = [0.0; MAX_JOINTS];
        self.law.torque(&sample.q[..n], &qd[..n], &desired, &self.acting[..self.count], &mut tau[..n]);
        let memory = self.period_s / TRACKING_S;
        for j in 0..n {
            self.tracking[j] += memory * ((desired.q[j] - sample.q[j]).powi(2) - self.tracking[j]);
        }
        Ok(self.give(sample.seq, sample.stamp_ns, tau, true))
    }

    /// No usable sample has come for `periods` periods. From the configured number on the stop reaction acts: one command
    /// for each period, however often it is asked for, with the number of the last sample answered.
    ///
    /// Real-time safe as [`tick`](Self::tick) is.
    pub fn missing(&mut self, periods: u64) -> Option<Command> {
        let seq = self.last_seq?;
        if !self.clock.fits() && !self.confirmed {
            // Nothing that was commanded so far was right: the brakes are to stay closed, or to close.
            return None;
        }
        if periods < self.stale_periods || periods <= self.missed {
            return None;
        }
        self.missed = periods;
        let n = self.dof;
        if self.stopping.is_none() {
            self.counts.stops += 1;
            self.stopping = Some(*self.output.last());
        }
        self.sources.advance(1);
        self.blend_parameters();
        let last = self.stopping.unwrap_or_default();
        let (since, stopping) = (periods as f64, (periods - self.stale_periods + 1) as f64);
        let mut tau = [0.0; MAX_JOINTS];
        self.stop.torque(
            &mut self.law,
            &self.acting[..self.count],
            &self.seen,
            &last[..n],
            since * self.period_s,
            stopping * self.period_s,
            &mut tau[..n],
        );
        Some(self.give(seq, 0, tau, false))
    }

    /// The arm was not under control meanwhile: velocity, integral and plan are those of another time. The output goes on
    /// from the last command, so that even this is no step.
    fn begin_anew(&mut self) {
        self.velocity.restart();
        self.law.restart();
        self.following = false;
        self.held = None;
    }

    /// What the arm is to do now: the plan if there is one of about this period near by, else stand where it is.
    fn desired(&mut self, sample: &JointState, qd: &[f64; MAX_JOINTS]) -> Desired {
        let n = self.dof;
        // A plan of the future is one of another time, too: a robot controller that was started anew counts from 1.
        let Some((_, plan)) = self.plan.filter(|(seq, _)| seq.abs_diff(sample.seq) <= self.stale_periods) else {
            self.following = false;
            return self.hold(sample, qd);
        };
        let distance = (0..n).map(|j| (plan.q[j] - sample.q[j]).abs()).fold(0.0, f64::max);
        if self.following && distance > STRAYED {
            self.counts.strayed += 1;
            (self.following, self.strayed, self.held) = (false, true, None);
        } else if !self.following && !self.strayed && distance <= REJOIN {
            (self.following, self.held) = (true, None);
        }
        if self.following { plan } else { self.hold(sample, qd) }
    }

    fn hold(&mut self, sample: &JointState, qd: &[f64; MAX_JOINTS]) -> Desired {
        if self.strayed {
            self.strayed = qd[..self.dof].iter().any(|qd| qd.abs() > STANDING);
            return Desired { q: sample.q, qd: *qd, qdd: qd.map(|qd| -qd / BRAKING_S) };
        }
        Desired { q: *self.held.get_or_insert(sample.q), ..Desired::default() }
    }

    fn blend_parameters(&mut self) {
        let target = self.sources.target();
        for i in 0..self.count {
            self.acting[i] += self.blend * (target[i] - self.acting[i]);
        }
    }

    fn give(&mut self, seq: u64, stamp_ns: u64, mut tau: [f64; MAX_JOINTS], integrate: bool) -> Command {
        let n = self.dof;
        let applied = self.output.apply(&mut tau[..n]);
        if integrate {
            self.law.integrate(&applied.limited[..n]);
        }
        self.counts.broken += u64::from(applied.broken);
        self.counts.saturated += u64::from(applied.saturated);
        self.counts.rate_limited += u64::from(applied.rate_limited);
        self.counts.commands += 1;
        let mode = match self.sources.source() {
            ParameterSource::Nominal => CommandMode::Nominal,
            ParameterSource::LastGood | ParameterSource::Live => CommandMode::Identified,
        };
        Command { seq, stamp_ns, tau, joints: self.joints, mode: mode.into() }
    }

    /// Writes the core's health; the shell stamps it.
    pub fn write_health(&self, out: &mut ControllerHealth) {
        let n = self.dof;
        let c = &self.counts;
        *out = ControllerHealth {
            seq: self.last_seq.unwrap_or(0),
            commands: c.commands,
            passed_over: c.passed_over,
            refused_stale: c.stale,
            refused_invalid: c.invalid + c.wrong_period,
            stops: c.stops,
            broken: c.broken,
            saturated: c.saturated,
            rate_limited: c.rate_limited,
            setpoints_limited: c.setpoints_limited,
            accepted: c.accepted,
            switches: self.sources.switches(),
            epoch: self.newest.epoch,
            parameters_seq: self.newest.seq,
            refusals: self.refusals,
            source: self.sources.source().into(),
            source_reason: self.sources.reason().into(),
            last_refusal: self.last_refusal.into(),
            state: self.state().into(),
            joints: self.joints,
            largest_step: *self.output.largest_step(),
            ..ControllerHealth::default()
        };
        for (out, square) in out.tracking_rms[..n].iter_mut().zip(&self.tracking) {
            *out = square.sqrt();
        }
        out.prediction_rms = self.recent.predict(&self.sources.target()[..self.count]).rms;
        out.nominal_prediction_rms = self.recent.predict(&self.sources.nominal()[..self.count]).rms;
    }

    fn state(&self) -> ControllerState {
        if !self.clock.fits() {
            return ControllerState::WrongPeriod;
        }
        match (self.last_seq, self.stopping.is_some(), self.following) {
            (None, ..) => ControllerState::Waiting,
            (_, true, _) => ControllerState::Stopping,
            (_, _, true) => ControllerState::Following,
            _ if self.strayed => ControllerState::Strayed,
            _ => ControllerState::Holding,
        }
    }

    /// What happened so far.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// The outcome of the last parameter set offered.
    pub fn last_refusal(&self) -> Refusal {
        self.last_refusal
    }

    /// Whose parameters act.
    pub fn source(&self) -> ParameterSource {
        self.sources.source()
    }

    /// Base parameters that act in this period.
    pub fn acting(&self) -> &[f64] {
        &self.acting[..self.count]
    }

    /// Epoch of the set accepted last; 0 before the first.
    pub fn epoch(&self) -> u64 {
        self.newest.epoch
    }

    /// The setpoint that the last sample was answered with, if the plan was followed.
    pub fn plan(&self) -> Option<&Desired> {
        self.plan.as_ref().filter(|_| self.following).map(|(_, desired)| desired)
    }
}
