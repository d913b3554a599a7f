//! Every decision of the controller, with no clock, bus or thread in it.

use crate::gate::{Gate, Newest, Refusal};
use crate::governor::Governor;
use crate::history::{History, Moment};
use crate::law::{ControlLaw, Desired, Gains};
use crate::limits::SetpointLimits;
use crate::output::{Limits, Output};
use crate::plan::{PlanCheck, RefusedPlan};
use crate::recent::{Recent, Verdict};
use crate::source::{Sources, Values};
use crate::stop::{FEEDBACK, Stop, Stopping};
use crate::velocity::VelocityFilter;
use crate::watch::{Watch, Wrong};
use rivet_config::Robot;
use rivet_dynamics::{EffectKind, MAX_JOINTS};
use rivet_estimation::SettingsError;
use rivet_ipc_schema::{
    Command, CommandMode, ControllerHealth, ControllerState, JointState, MAX_PARAMETERS, OldNumbers, ParameterSource,
    Parameters, REFUSALS, STOP_CAUSES, SampleClock, Setpoint, StopCause,
};
use std::sync::Arc;

mod stopping;

/// Why a sample got no command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Skipped {
    /// Its sequence number is not newer than the last one.
    Stale,
    /// Fault bits, a wrong joint count, or a reading that cannot be true: the arm's state is not known.
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
    /// Setpoints that were refused.
    pub setpoints_refused: u64,
    /// Times the plan was followed again after a stop.
    pub resumed: u64,
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
    plan_check: PlanCheck,
    governor: Governor,
    /// Why the last setpoint was refused, and the number of the first one refused in a row.
    plan_refused: Option<(RefusedPlan, u64)>,
    last_plan_refused: RefusedPlan,
    /// Whether the plan is followed; else the arm is held at `held`.
    following: bool,
    held: Option<Held>,
    /// Positions of the plan with that \[rad\]: those that the arm is to keep to, whatever the reference does.
    planned: [f64; MAX_JOINTS],
    /// What is added to the plan since it was joined: position and velocity \[rad, rad/s\].
    joining: [[f64; MAX_JOINTS]; 2],
    /// Stored parameters that have not passed the gate yet.
    stored: Option<Values>,
    /// How often in a row they have, and how often they have to.
    stored_row: u32,
    return_after: u32,
    adopt_from_seq: u64,
    last_seq: Option<u64>,
    /// The last sample screened, and what was wrong with it.
    screened: Option<(u64, Option<Wrong>)>,
    old: OldNumbers,
    stale_periods: u64,
    /// Periods with wrong samples, or with a refused plan, after which the arm is stopped.
    bridged: u64,
    watch: Watch,
    /// What is wrong with the samples since the last one that was used, and how many of them there were.
    wrong: Option<Wrong>,
    wrong_samples: u64,
    /// Something was wrong with a sample that was passed over.
    passed_wrong: Option<Wrong>,
    history: History,
    mass: Vec<f64>,
    joints: u32,
    /// The stop that is in force.
    stopping: Option<Stopping>,
    last_stop: (StopCause, u32),
    stop_causes: [u64; STOP_CAUSES],
    resume_after: u64,
    /// The arm is to follow its plan again as soon as a sample is valid.
    asked: bool,
    /// The sample at which a stop ended by itself.
    resumed_seq: Option<u64>,
    /// Periods without a usable sample that have had their command.
    missed: u64,
    tracking: [f64; MAX_JOINTS],
    counts: Counts,
}

/// Where and how fast the arm was when nothing was left to follow, and the sample's number.
#[derive(Clone, Copy, Debug)]
struct Held {
    q: [f64; MAX_JOINTS],
    qd: [f64; MAX_JOINTS],
    since: u64,
    /// It has come to rest there.
    resting: bool,
}

/// Time constant with which acting parameters follow those of the source \[s\]: short beside the motion, long beside a
/// period.
const BLEND_S: f64 = 0.05;

/// A plan further than this from the arm is not joined \[rad\]: the way there is the planner's to plan.
const REJOIN: f64 = 0.2;

/// Bandwidth with which a plan is joined \[rad/s\], critically damped: 0.2 rad away, the arm accelerates by 5 rad/s² at first.
const JOINING: f64 = 5.0;

/// Wrong samples in a row for this long stop the arm \[s\]: a single one is bridged by the last command.
const BRIDGED_S: f64 = 0.012;

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
        let step: Vec<f64> = rates.iter().map(|rate| rate * period_s).collect();
        let timeout = (settings.parameter_timeout_s / period_s).ceil() as u64;
        let recent = Recent::new(robot)?;
        let (row, apart) = (settings.return_after as u32, recent.periods_between());
        let limits = SetpointLimits::of(&robot.model.arm);
        let output = Limits { torque: torque_limits(robot), step };
        let stale_periods = settings.stale_periods as u64;
        let plan_check = PlanCheck::new(&law, &limits, &output.torque, period_s, stale_periods);
        let bounds = |j: usize| [settings.tracking_error[j], plan_check.corner(j)];
        let bounds: Vec<[f64; 2]> = (0..dof).map(bounds).collect();
        let periods = |seconds: f64| (seconds / period_s).ceil() as u64;
        Ok(Core {
            gate: Gate::new(robot, &mut law),
            plan_check,
            watch: Watch::new(robot, &law, &limits, &output.torque, &rates),
            law,
            recent,
            sources: Sources::new(&nominal, timeout, row, apart, period_s),
            governor: Governor::new(&output, &bounds, period_s),
            output: Output::new(output, (1e-3 * settings.saturation_ms / period_s) as u32, period_s),
            clock: SampleClock::new(period_s),
            confirmed: false,
            velocity: VelocityFilter::new(period_s, settings.velocity_filter_hz),
            limits,
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
            plan_refused: None,
            last_plan_refused: (StopCause::None, 0),
            following: false,
            held: None,
            planned: [0.0; MAX_JOINTS],
            joining: [[0.0; MAX_JOINTS]; 2],
            stored: None,
            stored_row: 0,
            return_after: row,
            adopt_from_seq,
            last_seq: None,
            screened: None,
            old: OldNumbers::default(),
            stale_periods,
            bridged: periods(BRIDGED_S).max(2),
            wrong: None,
            wrong_samples: 0,
            passed_wrong: None,
            history: History::new(),
            mass: vec![0.0; dof * dof],
            joints: dof as u32,
            stopping: None,
            last_stop: (StopCause::None, 0),
            stop_causes: [0; STOP_CAUSES],
            resume_after: settings.resume_after as u64,
            asked: false,
            resumed_seq: None,
            missed: 0,
            tracking: [0.0; MAX_JOINTS],
            counts: Counts::default(),
        })
    }

    /// Before the first sample: takes `values`, the last good parameters of an earlier run, for later. They act instead of the robot
    /// file's once they have passed the gate that published ones have to pass; recent torques decide last.
    ///
    /// # Errors
    /// Why they may not act.
    pub fn recall(&mut self, values: &[f64]) -> Result<(), Refusal> {
        if values.len() != self.count {
            return Err(Refusal::WrongCount);
        }
        self.gate.check_physics(values, None, &mut self.law)?;
        let mut stored = [0.0; MAX_PARAMETERS];
        stored[..self.count].copy_from_slice(values);
        self.stored = Some(stored);
        Ok(())
    }

    /// Asks the gate again whether stored parameters may act, at the pose `q`: in as many rows of torques as published ones have to pass.
    fn judge_stored(&mut self, q: &[f64]) {
        let Some(stored) = self.stored else { return };
        if self.sources.source() != ParameterSource::Nominal || self.sources.last_good().is_some() {
            // Published ones were quicker.
            self.stored = None;
            return;
        }
        match self.judge_values(&stored[..self.count], q) {
            Ok(()) => {
                self.stored_row += 1;
                if self.stored_row >= self.return_after {
                    self.stored = None;
                    self.sources.recall(&stored);
                }
            }
            // Later torques, or another setpoint, decide.
            Err(Refusal::NotJudged | Refusal::TorqueChange) => self.stored_row = 0,
            Err(why) => {
                self.stored = None;
                self.refused(why);
            }
        }
    }

    fn refused(&mut self, refusal: Refusal) {
        if let Some(count) = self.refusals.get_mut(u32::from(refusal) as usize) {
            *count += 1;
        }
        self.last_refusal = refusal;
    }

    /// Takes in a setpoint; the newest that the arm can follow stays.
    ///
    /// Real-time safe.
    pub fn offer_setpoint(&mut self, setpoint: &Setpoint) {
        let n = self.dof;
        let newer = !self.following || self.plan.is_none_or(|(seq, _)| setpoint.seq > seq);
        if !newer {
            return;
        }
        let mut desired = Desired { q: setpoint.q, qd: setpoint.qd, qdd: setpoint.qdd };
        let shape = if setpoint.count() == n && setpoint.joints as usize == n {
            Ok(())
        } else {
            Err((StopCause::PlanNotFinite, 0))
        };
        let checked = shape.and_then(|()| self.plan_check.check_numbers(&desired)).and_then(|()| {
            self.counts.setpoints_limited += u64::from(self.limits.apply(&mut desired));
            if self.following && self.plan_check.is_apart(setpoint.seq) {
                // Numbers that leap hide a jump: it is joined anew, from where the arm is.
                self.following = false;
            }
            if !self.following {
                // What is not followed yet may begin anywhere.
                self.plan_check.restart();
            }
            self.plan_check.check(setpoint.seq, &desired, &mut self.law, &self.acting[..self.count])
        });
        match checked {
            Ok(()) => {
                self.plan = Some((setpoint.seq, desired));
                self.plan_refused = None;
            }
            Err(why) => {
                self.counts.setpoints_refused += 1;
                self.last_plan_refused = why;
                self.plan_refused.get_or_insert((why, setpoint.seq));
            }
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
        self.refused(refusal);
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
        self.judge_values(&set.values[..self.count], q)
    }

    /// Whether base parameters may act, at the pose `q` and by recent torques.
    fn judge_values(&mut self, values: &[f64], q: &[f64]) -> Result<(), Refusal> {
        self.gate.check_physics(values, Some(q), &mut self.law)?;
        let target = self.sources.target();
        let same = values == &target[..self.count];
        let desired = if let Some((_, desired)) = self.plan.filter(|_| self.following) {
            desired
        } else {
            let mut here = Desired::default();
            here.q[..self.dof].copy_from_slice(q);
            here
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

    /// Takes in a sample that will not be answered, because a newer one is at hand: its torques are worth remembering, and what is
    /// wrong with it is wrong with the arm.
    pub fn observe(&mut self, sample: &JointState) {
        // One that comes twice, or after a newer one, says nothing that is new.
        if self.screened.is_some_and(|(seen, _)| sample.seq <= seen) {
            return;
        }
        if let Some(wrong) = self.watch.numbers(sample).or_else(|| self.screen(sample)) {
            self.passed_wrong = Some(wrong);
        }
    }

    /// Checks a sample whose numbers are valid, and remembers its torques if nothing is wrong with it.
    fn screen(&mut self, sample: &JointState) -> Option<Wrong> {
        // One that comes twice is what it was: a check of differences would find nothing in it.
        if let Some((_, found)) = self.screened.filter(|(seen, _)| *seen == sample.seq) {
            return found;
        }
        let n = self.dof;
        let plan = self.plan.filter(|_| self.following).map(|(_, plan)| plan);
        let command = *self.output.last();
        let wrong = self.watch.readings(sample, &command, plan.as_ref());
        // What brakes do is no answer to a torque. A joint that is too fast may answer it all the same.
        let is_compared = sample.faults == 0 && wrong.is_none_or(|wrong| wrong.cause == StopCause::TooFast);
        let wrong = wrong.or(if is_compared { self.answers() } else { None });
        if wrong.is_none() && sample.faults == 0 {
            if self.screened.is_some_and(|(last, _)| last.checked_add(1) != Some(sample.seq)) {
                self.recent.restart_signals();
            }
            if self.recent.push(&sample.q[..n], &sample.tau[..n]) {
                self.reconsider(&sample.q[..n]);
            }
        }
        self.screened = Some((sample.seq, wrong));
        wrong
    }

    /// Whether the arm answers its torque, and feedback is not held back.
    fn answers(&mut self) -> Option<Wrong> {
        let unanswered = self.watch.response(&mut self.law, &self.acting[..self.count]);
        match self.stopping.map(|stopping| stopping.cause) {
            None => {
                let joints = self.output.held_back();
                let late = Wrong { cause: StopCause::Saturated, joints, lasting: true };
                unanswered.or((joints != 0).then_some(late))
            }
            // These stops use readings because they have been answers.
            Some(StopCause::TooFast | StopCause::TrackingError) => unanswered,
            Some(_) => None,
        }
    }

    /// Asks the pose and recent torques whether the right parameters act.
    fn reconsider(&mut self, q: &[f64]) {
        self.judge_stored(q);
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

    /// Answers one sample. Without a plan near the arm, that is held where it is. While the arm is stopped, the answer is that of the
    /// stop reaction.
    ///
    /// Real-time safe: bounded work; no allocation, lock, system call or panic.
    ///
    /// # Errors
    /// Why there is no command for this sample; the stop reaction follows if that goes on ([`missing`](Self::missing)).
    pub fn tick(&mut self, sample: &JointState) -> Result<Command, Skipped> {
        if self.last_seq.is_some_and(|last| sample.seq <= last) {
            self.counts.stale += 1;
            if !self.old.take(sample.seq) {
                self.wrong.get_or_insert(Wrong { cause: StopCause::OldSamples, joints: 0, lasting: false });
                return Err(Skipped::Stale);
            }
            (self.last_seq, self.screened) = (None, None);
            self.newest = Newest::default();
            self.plan = None;
            self.recent.restart();
            self.watch.restart();
            self.history.restart();
            self.begin_anew();
        }
        self.old.end();
        if !self.clock.take(sample.seq, sample.stamp_ns) {
            self.counts.wrong_period += 1;
            let wrong = Wrong { cause: StopCause::WrongPeriod, joints: 0, lasting: false };
            return self.answer_wrong(sample, wrong, Skipped::WrongPeriod);
        }
        self.confirmed |= self.clock.confirmed();
        if let Some(wrong) = self.watch.numbers(sample) {
            self.counts.invalid += 1;
            return self.answer_wrong(sample, wrong, Skipped::Invalid);
        }
        let found = self.screen(sample).or(self.passed_wrong.take());
        if let Some(wrong) = found {
            self.counts.invalid += 1;
            if self.stopping.is_none() {
                return self.answer_wrong(sample, wrong, Skipped::Invalid);
            }
        }
        let periods = self.last_seq.map_or(1, |last| sample.seq - last);
        self.counts.passed_over += (periods - 1).saturating_sub(self.wrong_samples);
        let stop_periods = periods.saturating_sub(self.missed).max(1);
        self.last_seq = Some(sample.seq);
        (self.missed, self.wrong, self.wrong_samples) = (0, None, 0);
        if periods > self.stale_periods {
            if self.stopping.is_none() {
                self.begin_anew();
            } else {
                // What the arm did in between is not known.
                self.velocity.restart();
            }
        }
        self.sources.advance(periods);
        let qd = *self.velocity.update(&sample.q[..self.dof], periods);
        self.blend_parameters();
        if self.stopping.is_some() && !self.resumes(sample, found) {
            return Ok(self.stopped(sample.seq, sample.stamp_ns, stop_periods, Some([&sample.q, &qd])));
        }
        let desired = self.desired(sample, &qd, periods);
        if let Some(wrong) = self.strayed(sample) {
            self.begin_stop(wrong, 0);
            return Ok(self.stopped(sample.seq, sample.stamp_ns, 1, Some([&sample.q, &qd])));
        }
        Ok(self.follow(sample, &qd, &desired))
    }

    /// The law's answer to a valid sample.
    fn follow(&mut self, sample: &JointState, qd: &[f64; MAX_JOINTS], desired: &Desired) -> Command {
        let n = self.dof;
        let mut tau = [0.0; MAX_JOINTS];
        let friction = self.law.torque(&sample.q[..n], &qd[..n], desired, &self.acting[..self.count], &mut tau[..n]);
        let memory = self.period_s / TRACKING_S;
        for j in 0..n {
            self.tracking[j] += memory * ((desired.q[j] - sample.q[j]).powi(2) - self.tracking[j]);
        }
        let command = self.give(sample.seq, sample.stamp_ns, tau, Some(&friction));
        self.history.push(&Moment { q: sample.q, qd: *qd, tau: command.tau });
        command
    }

    /// The answer to a sample with which something is wrong: none at first, since a single one may be; then the stop reaction.
    fn answer_wrong(&mut self, sample: &JointState, wrong: Wrong, skipped: Skipped) -> Result<Command, Skipped> {
        self.wrong_samples += 1;
        self.wrong.get_or_insert(wrong);
        let Some(last) = self.last_seq else { return Err(skipped) };
        let periods = sample.seq - last;
        if self.stopping.is_none() {
            let due = wrong.lasting || periods >= self.bridged;
            if !due || !self.may_stop() {
                return Err(skipped);
            }
            self.begin_stop(wrong, periods);
        }
        let elapsed = periods.saturating_sub(self.missed).max(1);
        // This period has had its command.
        self.missed = periods;
        Ok(self.stopped(sample.seq, sample.stamp_ns, elapsed, None))
    }

    /// No usable sample has come for `periods` periods. From the configured number on the stop reaction acts: one command
    /// for each period, however often it is asked for, with the number of the last sample answered.
    ///
    /// Real-time safe as [`tick`](Self::tick) is.
    pub fn missing(&mut self, periods: u64) -> Option<Command> {
        let seq = self.last_seq?;
        let most = if self.wrong.is_some() { self.bridged.min(self.stale_periods) } else { self.stale_periods };
        if !self.may_stop() || periods < most || periods <= self.missed {
            return None;
        }
        let elapsed = periods - self.missed;
        self.missed = periods;
        if self.stopping.is_none() {
            let silence = Wrong { cause: StopCause::Silence, joints: 0, lasting: true };
            self.begin_stop(self.wrong.unwrap_or(silence), periods);
        }
        self.sources.advance(1);
        self.blend_parameters();
        Some(self.stopped(seq, 0, elapsed, None))
    }

    /// The arm was not under control meanwhile: velocity, integral and plan are those of another time. The output goes on
    /// from the last command, so that even this is no step.
    fn begin_anew(&mut self) {
        self.velocity.restart();
        self.law.restart();
        self.following = false;
        self.held = None;
    }

    fn distance(&self, plan: &Desired, sample: &JointState) -> f64 {
        (0..self.dof).map(|j| (plan.q[j] - sample.q[j]).abs()).fold(0.0, f64::max)
    }

    /// What the arm is to do now: the plan if there is one of about this period near by, else stand where it is.
    fn desired(&mut self, sample: &JointState, qd: &[f64; MAX_JOINTS], periods: u64) -> Desired {
        // A plan of the future is one of another time, too: a robot controller that was started anew counts from 1.
        let Some((_, plan)) = self.plan.filter(|(seq, _)| seq.abs_diff(sample.seq) <= self.stale_periods) else {
            self.following = false;
            return self.hold(sample, qd);
        };
        if !self.following && self.distance(&plan, sample) <= REJOIN {
            let near = self.is_near(&plan, sample, qd);
            // How fast the arm moves decides how it joins; until that is known it is held.
            if near || self.velocity.is_known() {
                (self.following, self.held) = (true, None);
                self.join(&plan, sample, qd, near);
            }
        }
        if !self.following {
            return self.hold(sample, qd);
        }
        let mut desired = plan;
        let [offset, speed] = &mut self.joining;
        for j in 0..self.dof {
            let acceleration = -JOINING * (JOINING * offset[j] + 2.0 * speed[j]);
            desired.q[j] += offset[j];
            desired.qd[j] += speed[j];
            desired.qdd[j] += acceleration;
            speed[j] += acceleration * self.period_s;
            offset[j] += speed[j] * self.period_s;
        }
        self.planned = desired.q;
        let x = &self.acting[..self.count];
        self.governor.apply(&mut desired, &mut self.law, x, &mut self.mass, periods);
        // The reference stays within the joints' ranges, too.
        let _ = self.limits.apply(&mut desired);
        desired
    }

    /// Whether feedback alone brings the arm to `plan`.
    fn is_near(&self, plan: &Desired, sample: &JointState, qd: &[f64; MAX_JOINTS]) -> bool {
        (0..self.dof).all(|j| {
            let (position, velocity) = self.law.gains(j);
            let (offset, speed) = ((sample.q[j] - plan.q[j]).abs(), (qd[j] - plan.qd[j]).abs());
            let jump = self.plan_check.jump(j);
            offset <= jump && speed * velocity <= jump * position
        })
    }

    /// Begins to follow `plan`: from where the arm is, if that is not near.
    fn join(&mut self, plan: &Desired, sample: &JointState, qd: &[f64; MAX_JOINTS], near: bool) {
        self.joining = [[0.0; MAX_JOINTS]; 2];
        self.governor.restart();
        if !near {
            for j in 0..self.dof {
                self.joining[0][j] = sample.q[j] - plan.q[j];
                self.joining[1][j] = qd[j] - plan.qd[j];
            }
        }
    }

    /// Whether the arm has left its plan, or its planner plans what the arm cannot follow.
    fn strayed(&self, sample: &JointState) -> Option<Wrong> {
        if !self.following {
            return None;
        }
        // Before the last plan that was good is too old to be followed.
        let bridged = self.bridged.min(self.stale_periods.saturating_sub(1)).max(1);
        let refused = self.plan_refused.filter(|(_, first)| sample.seq.saturating_sub(*first) >= bridged);
        let refused = refused.map(|((cause, joints), _)| Wrong { cause, joints, lasting: true });
        let behind = || {
            let (joints, is_planned) = self.governor.beyond();
            let cause = if is_planned { StopCause::PlanAcceleration } else { StopCause::Saturated };
            (joints != 0).then_some(Wrong { cause, joints, lasting: true })
        };
        refused.or_else(behind).or_else(|| self.watch.tracking(&sample.q, &self.planned))
    }

    /// The arm is held where it is. One in motion is first brought to rest as `damp` does it, with feedback that the rate limit of the
    /// torque does not turn into a swing.
    fn hold(&mut self, sample: &JointState, qd: &[f64; MAX_JOINTS]) -> Desired {
        if self.held.is_none() {
            let here = Desired { q: sample.q, ..Desired::default() };
            let resting = self.is_near(&here, sample, qd);
            self.held = Some(Held { q: sample.q, qd: *qd, since: sample.seq, resting });
        }
        let Some(held) = &mut self.held else { return Desired::default() };
        let elapsed_s = sample.seq.saturating_sub(held.since) as f64 * self.period_s;
        if !held.resting && elapsed_s >= self.stop.time_s {
            *held = Held { q: sample.q, qd: [0.0; MAX_JOINTS], since: sample.seq, resting: true };
        }
        if held.resting {
            return Desired { q: held.q, ..Desired::default() };
        }
        let time_s = self.stop.decay_s();
        let rest = (-elapsed_s / time_s).exp();
        let mut desired = Desired { q: sample.q, qd: *qd, qdd: [0.0; MAX_JOINTS] };
        for j in 0..self.dof {
            let (position, velocity) = self.law.gains(j);
            let planned = held.qd[j] * rest;
            desired.q[j] +=
                FEEDBACK * FEEDBACK / position * (held.q[j] + time_s * (held.qd[j] - planned) - sample.q[j]);
            desired.qd[j] += 2.0 * FEEDBACK / velocity * (planned - qd[j]);
            desired.qdd[j] = -planned / time_s;
        }
        desired
    }

    fn blend_parameters(&mut self) {
        let target = self.sources.target();
        for i in 0..self.count {
            self.acting[i] += self.blend * (target[i] - self.acting[i]);
        }
    }

    /// `friction` is that in the torque of the law \[N·m\]; none where it is a torque of the stop reaction.
    fn give(
        &mut self,
        seq: u64,
        stamp_ns: u64,
        mut tau: [f64; MAX_JOINTS],
        friction: Option<&[f64; MAX_JOINTS]>,
    ) -> Command {
        let n = self.dof;
        let applied = self.output.apply(&mut tau[..n], friction.unwrap_or(&[0.0; MAX_JOINTS]));
        if friction.is_some() {
            self.law.integrate(&applied.limited[..n]);
            self.governor.hedge(&applied.lacking);
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
            strayed: c.strayed,
            setpoints_refused: c.setpoints_refused,
            resumed: c.resumed,
            stop_causes: self.stop_causes,
            stop_cause: self.last_stop.0.into(),
            stop_joints: self.last_stop.1,
            plan_refusal: self.last_plan_refused.0.into(),
            plan_joints: self.last_plan_refused.1,
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

    /// What the controller is doing.
    pub fn state(&self) -> ControllerState {
        if !self.clock.fits() {
            return ControllerState::WrongPeriod;
        }
        match (self.last_seq, self.stopping.map(|stopping| stopping.cause), self.following) {
            (None, ..) => ControllerState::Waiting,
            (_, Some(StopCause::TrackingError), _) => ControllerState::Strayed,
            (_, Some(_), _) => ControllerState::Stopping,
            (_, None, true) => ControllerState::Following,
            (_, None, false) => ControllerState::Holding,
        }
    }

    /// Why the stop reaction acts, and on which joints, bit 0 the base's; `None` while it does not.
    pub fn stop_cause(&self) -> Option<(StopCause, u32)> {
        self.stopping.map(|stopping| (stopping.cause, stopping.joints))
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
