//! Every decision of the daemon's loop, with no clock, bus or thread in it.

use crate::drift::DriftWatch;
use crate::fault_record::{FaultRecord, Met};
use rivet_config::Robot;
use rivet_dynamics::{JointKind, MAX_JOINTS};
use rivet_estimation::{
    Identifier, Instrument, LARGEST_EFFORT, LARGEST_MOTION, Motion, Observer, ParameterState as Estimated, Phase,
    Reconfigured, Row, Sample, SettingsError, Skip, Step,
};
use rivet_input_checks::{Fault, JointLimits, Reading, ReadingCheck, TorqueCheck};
use rivet_ipc_schema::{
    ControlCommand, DaemonMode, Drift, Health, InputFault, InstrumentSource, JointState, LinkState, LoadLevel,
    MAX_PARAMETERS, OldNumbers, ParameterState, Parameters, SampleClock, Setpoint, parameter_flags,
};
use std::sync::Arc;

/// Why a sample was not used. `Copy` and without text: it is made inside the real-time loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refused {
    /// Its sequence number is not newer than the last one.
    Stale,
    /// Wrong joint count, or a position or torque that is not finite.
    Invalid,
    /// The robot controller set fault bits.
    Fault,
    /// Samples come at another rate than the robot file says.
    Period,
    /// A reading cannot be true; the fault says why.
    Reading(InputFault),
}

/// What the shell is to do after a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Output {
    /// Publish parameters now ([`Core::write_parameters`]).
    pub publish: bool,
    /// What became of the sample.
    pub taken: Result<(), Refused>,
}

/// How many samples did what; all count from the start of the daemon.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Counts {
    /// Samples used.
    pub samples: u64,
    /// Samples that never came, by sequence number.
    pub lost: u64,
    /// Samples not newer than the last.
    pub stale: u64,
    /// Samples with a wrong joint count or numbers that are not finite.
    pub invalid: u64,
    /// Samples with fault bits.
    pub faults: u64,
    /// Times the signal chain had to start anew.
    pub gaps: u64,
    /// Samples used without the setpoint of their period although setpoints are flowing.
    pub setpoints_missing: u64,
    /// Samples not used because they came at another rate than the robot file says.
    pub wrong_period: u64,
    /// Times the robot controller began its sequence anew.
    pub restarts: u64,
    /// Samples not used because a reading cannot be true.
    pub unbelievable: u64,
    /// Sound samples that were left aside because there was no time for them.
    pub held: u64,
    /// Rows not learnt from because their torques are in doubt.
    pub doubted: u64,
}

/// Seconds of motion before which the estimate is called provisional: a controller should not act on it yet.
const PROVISIONAL_S: f64 = 2.0;

/// Publications of which one remains when less is published, and rows of which one remains when fewer are learnt from.
const PUBLISH_LESS: u64 = 8;
const DECIMATE: usize = 4;

/// The daemon between two samples. Everything is a function of the sample stream: a recorded run replays bit for bit.
pub struct Core {
    identifier: Identifier,
    clock: SampleClock,
    guard: ReadingCheck,
    watch: TorqueCheck,
    drift: DriftWatch,
    record: FaultRecord,
    load: LoadLevel,
    load_seq: u64,
    load_changes: u64,
    period_s: f64,
    dof: usize,
    row_period_s: f64,
    count: usize,
    hash: u64,
    publish_every: u64,
    since_publication: u64,
    epoch: u64,
    last_seq: Option<u64>,
    last_stamp_ns: u64,
    interrupted: bool,
    old: OldNumbers,
    setpoints_seen: bool,
    /// Numbers of the estimator's memory, and what they mean.
    memory: (usize, u64),
    /// Updates before which the estimate is called provisional.
    provisional_updates: u64,
    counts: Counts,
}

impl Core {
    /// Allocates everything the loop will need.
    ///
    /// # Errors
    /// Settings of the robot file that the estimator cannot work with.
    pub fn new(robot: &Robot) -> Result<Core, SettingsError> {
        let settings = robot.config.estimation_settings();
        let identifier =
            Identifier::new(Arc::clone(&robot.model), Arc::clone(&robot.base), &robot.nominal_base, &settings)?;
        Ok(Core {
            memory: (identifier.memory_len(), identifier.memory_fingerprint()),
            identifier,
            clock: SampleClock::new(robot.config.sample_period_s),
            guard: ReadingCheck::new(&joint_limits(robot), robot.config.sample_period_s),
            watch: TorqueCheck::new(robot.model.arm.dof(), robot.config.sample_period_s),
            drift: DriftWatch::new(robot, settings.row_period_s()),
            record: FaultRecord::NONE,
            load: LoadLevel::Normal,
            load_seq: 0,
            load_changes: 0,
            period_s: robot.config.sample_period_s,
            dof: robot.model.arm.dof(),
            row_period_s: settings.row_period_s(),
            count: robot.base.len().min(MAX_PARAMETERS),
            hash: robot.hash,
            publish_every: robot.config.publish.every as u64,
            since_publication: 0,
            epoch: 0,
            last_seq: None,
            last_stamp_ns: 0,
            interrupted: false,
            old: OldNumbers::default(),
            setpoints_seen: false,
            provisional_updates: (PROVISIONAL_S / settings.row_period_s()).ceil() as u64,
            counts: Counts::default(),
        })
    }

    /// Advances by one sample. `setpoint` is the one of the same period, if there is one; one of another period is not
    /// used. Time comes only from the sample.
    ///
    /// Real-time safe: bounded work; no allocation, lock, system call or panic.
    pub fn tick(&mut self, sample: &JointState, setpoint: Option<&Setpoint>) -> Output {
        self.tick_with_link(sample, setpoint, None)
    }

    /// Like [`tick`](Self::tick), with what the second encoders saw in the same period, if there are some.
    pub fn tick_with_link(
        &mut self,
        sample: &JointState,
        setpoint: Option<&Setpoint>,
        link: Option<&LinkState>,
    ) -> Output {
        self.tick_timed(sample, setpoint, link, |_| {})
    }

    /// Like [`tick_with_link`](Self::tick_with_link); `done` is told when a phase of the work is over. The core has no clock:
    /// what it does never depends on when that is.
    pub fn tick_timed(
        &mut self,
        sample: &JointState,
        setpoint: Option<&Setpoint>,
        link: Option<&LinkState>,
        done: impl FnMut(Phase),
    ) -> Output {
        let taken = self.take(sample, setpoint, link, done);
        let mut publish = false;
        if taken.is_ok() {
            self.since_publication += 1;
            let less = if self.load == LoadLevel::Normal { 1 } else { PUBLISH_LESS };
            publish = self.since_publication >= less * self.publish_every;
            if publish {
                self.since_publication = 0;
                self.epoch += 1;
            }
        }
        Output { publish, taken }
    }

    fn take(
        &mut self,
        sample: &JointState,
        setpoint: Option<&Setpoint>,
        link: Option<&LinkState>,
        done: impl FnMut(Phase),
    ) -> Result<(), Refused> {
        let n = self.dof;
        self.take_stamp(sample)?;
        self.check_values(sample)?;
        let finite = |values: &[f64; MAX_JOINTS]| values[..n].iter().all(|v| v.is_finite());
        let setpoint = setpoint
            .filter(|s| s.seq == sample.seq && s.count() == n && finite(&s.q) && finite(&s.qd) && finite(&s.qdd));
        self.setpoints_seen |= setpoint.is_some();
        if self.setpoints_seen && setpoint.is_none() {
            self.counts.setpoints_missing += 1;
        }
        let reading = Reading { seq: sample.seq, q: &sample.q[..n], tau: &sample.tau[..n] };
        if let Some(found) = self.guard.check(&reading, setpoint.map(|s| &s.q[..n])) {
            self.counts.unbelievable += 1;
            let fault = input_fault(found.fault);
            return Err(self.refuse(fault, found.joints, Refused::Reading(fault)));
        }
        if self.load == LoadLevel::Hold {
            // The signals begin anew when learning does: nothing of a fault is in them.
            self.interrupted = true;
            self.counts.held += 1;
            self.record.good(true);
            return Ok(());
        }
        // Differences across a hole would be wrong velocities: the signal chain starts anew, the information stays.
        if self.interrupted {
            self.interrupted = false;
            self.counts.gaps += 1;
            self.identifier.restart_signals();
            self.watch.restart();
        }
        let estimate = self.identifier.estimate();
        self.watch.read(&estimate, estimate.updates >= self.provisional_updates);
        let (wrong, ended) = self.watch.sample(&sample.tau[..n], &self.guard);
        if ended {
            self.counts.gaps += 1;
            self.identifier.restart_signals();
            self.watch.restart();
        }
        let desired = setpoint.map(|s| Motion { q: &s.q[..n], qd: &s.qd[..n], qdd: &s.qdd[..n] });
        let second = link.filter(|l| l.seq == sample.seq && l.count() == n).map(|l| &l.q[..n]);
        let sample = Sample { q: &sample.q[..n], second, tau: &sample.tau[..n], setpoint: desired };
        let (watch, drift, seq) = (&mut self.watch, &mut self.drift, self.last_seq.unwrap_or(0));
        let mut onlooker = Onlooker { watch, drift, seq, guard: &self.guard, done };
        let step = self.identifier.push_observed(sample, &mut onlooker);
        if let Step::Refused(_) = step {
            self.counts.invalid += 1;
            return Err(self.refuse(InputFault::Implausible, 0, Refused::Invalid));
        }
        self.counts.samples += 1;
        self.counts.doubted += u64::from(step == Step::Skipped(Skip::NotAdmitted));
        match wrong {
            Some(found) => self.record.interrupt(Met { fault: input_fault(found.fault), joints: found.joints }, 1),
            None => self.record.good(step != Step::WarmingUp),
        }
        Ok(())
    }

    /// Sequence number and stamp: lost and old samples, another publisher, jumps of time.
    fn take_stamp(&mut self, sample: &JointState) -> Result<(), Refused> {
        if let Some(last) = self.last_seq {
            if sample.seq <= last {
                self.counts.stale += 1;
                if !self.old.take(sample.seq) {
                    let again = if sample.seq == last { InputFault::Duplicate } else { InputFault::Reordered };
                    self.record.count(again, 1);
                    return Err(Refused::Stale);
                }
                self.counts.restarts += 1;
                self.interrupted = true;
                self.guard.restart();
                self.watch.forget();
                self.record.interrupt(Met { fault: InputFault::PublisherRestarted, joints: 0 }, 1);
            } else {
                let lost = sample.seq - last - 1;
                self.counts.lost = self.counts.lost.saturating_add(lost);
                if lost > 0 {
                    self.interrupted = true;
                    self.record.interrupt(Met { fault: InputFault::Lost, joints: 0 }, lost);
                }
                if !self.guard.stamps_fit(lost, self.last_stamp_ns, sample.stamp_ns) {
                    // The rate is looked at anew; the signals know only sequence numbers.
                    self.clock.begin();
                    self.record.count(InputFault::TimeJump, 1);
                }
            }
        }
        // Old samples one after the other, then new ones: numbers that happen to go on hide a hole in time.
        self.interrupted |= self.old.end() > 1;
        self.last_seq = Some(sample.seq);
        self.last_stamp_ns = sample.stamp_ns;
        Ok(())
    }

    /// Rate, fault bits, shape, finite values within what any arm does.
    fn check_values(&mut self, sample: &JointState) -> Result<(), Refused> {
        let n = self.dof;
        // Velocities and filters reckoned with a wrong period are wrong without looking so.
        if !self.clock.take(sample.seq, sample.stamp_ns) {
            self.counts.wrong_period += 1;
            return Err(self.refuse(InputFault::WrongPeriod, 0, Refused::Period));
        }
        if sample.faults != 0 {
            self.counts.faults += 1;
            return Err(self.refuse(InputFault::RobotFault, 0, Refused::Fault));
        }
        let finite = |values: &[f64; MAX_JOINTS]| values[..n].iter().all(|v| v.is_finite());
        if sample.joints as usize != n {
            self.counts.invalid += 1;
            return Err(self.refuse(InputFault::WrongShape, 0, Refused::Invalid));
        }
        if !finite(&sample.q) || !finite(&sample.tau) {
            self.counts.invalid += 1;
            let bad = (0..n).filter(|&j| !sample.q[j].is_finite() || !sample.tau[j].is_finite());
            return Err(self.refuse(InputFault::NotFinite, bad.fold(0, |bits, j| bits | 1 << j), Refused::Invalid));
        }
        // Before anything is reckoned with them: differences of such numbers are no differences any more.
        let wild = |j: &usize| sample.q[*j].abs() > LARGEST_MOTION || sample.tau[*j].abs() > LARGEST_EFFORT;
        let bits = (0..n).filter(wild).fold(0, |bits, j| bits | 1 << j);
        if bits != 0 {
            self.counts.invalid += 1;
            return Err(self.refuse(InputFault::Implausible, bits, Refused::Invalid));
        }
        Ok(())
    }

    fn refuse(&mut self, fault: InputFault, joints: u32, why: Refused) -> Refused {
        self.interrupted = true;
        self.record.interrupt(Met { fault, joints }, 1);
        why
    }

    /// Something that the shell has seen: publishers that come and go, a machine that was suspended.
    pub fn note(&mut self, fault: InputFault, times: u64) {
        match fault {
            // Time has gone by that no stamp tells of.
            InputFault::ClockSuspended => {
                self.refuse(fault, 0, Refused::Stale);
                self.guard.restart();
            }
            _ => self.record.count(fault, times),
        }
    }

    /// Leaves out work from the next sample on, or takes it up again. What was decided when is published with the
    /// parameters ([`parameter_flags::LOAD_SHIFT`]): a replay that is told the same does the same.
    pub fn set_load(&mut self, level: LoadLevel) {
        if level == self.load {
            return;
        }
        self.load = level;
        self.load_changes += 1;
        self.load_seq = self.last_seq.map_or(0, |seq| seq.saturating_add(1));
        let thin = matches!(level, LoadLevel::Decimate | LoadLevel::Hold);
        self.identifier.thin(if thin { DECIMATE } else { 1 });
    }

    /// What is left out now.
    pub fn load_level(&self) -> LoadLevel {
        self.load
    }

    /// What is wrong with the samples now; it stays until the signals have settled after the last faulty one.
    pub fn input_fault(&self) -> InputFault {
        self.record.now
    }

    /// Times that a fault was met.
    pub fn fault_count(&self, fault: InputFault) -> u64 {
        self.record.counts.get(fault as usize).copied().unwrap_or(0)
    }

    /// From the last faulty sample to the first after which the signals had settled, of the last fault that is over \[s\].
    pub fn recovery_s(&self) -> Option<f64> {
        self.record.recovery.map(|samples| samples as f64 * self.period_s)
    }

    /// Goes on from stored base parameters; false, and nothing changed, if they do not fit the model.
    pub fn load(&mut self, values: &[f64]) -> bool {
        self.identifier.load(values)
    }

    /// As [`load`](Self::load), knowing also how well (standard deviations, in each parameter's unit) those are known that had
    /// been `identified`.
    pub fn recall(&mut self, values: &[f64], std: &[f64], identified: &[bool]) -> bool {
        self.identifier.recall(values, std, identified)
    }

    /// Numbers that [`write_memory`](Self::write_memory) writes.
    pub fn memory_len(&self) -> usize {
        self.memory.0
    }

    /// Says what those numbers mean: [`Identifier::memory_fingerprint`].
    pub fn memory_fingerprint(&self) -> u64 {
        self.memory.1
    }

    /// Writes all that the estimator has learnt; false if `room` is not of as many numbers. Real-time safe.
    pub fn write_memory(&mut self, room: &mut [f64]) -> bool {
        self.identifier.remember_all(room)
    }

    /// Goes on from what a core with the same fingerprint wrote; false, and nothing changed, if it cannot be of such a one.
    pub fn resume(&mut self, memory: &[f64]) -> bool {
        self.identifier.resume_from(memory)
    }

    /// Goes on with the settings of `fresh`, made for the same model: filters, window, thresholds, rate of publication. No
    /// sample is lost and no parameter steps; see [`Identifier::reconfigure`]. What is replaced is left in `fresh`.
    ///
    /// Real-time safe: bounded work; no allocation, lock, system call or panic.
    pub fn reconfigure(&mut self, fresh: &mut Core) -> Reconfigured {
        self.publish_every = fresh.publish_every;
        self.row_period_s = fresh.row_period_s;
        self.provisional_updates = fresh.provisional_updates;
        self.memory = fresh.memory;
        self.guard.adopt_limits(&fresh.guard);
        // The robot file that was read anew is what is accepted from now on.
        self.drift.clone_from(&fresh.drift);
        let kept = self.identifier.reconfigure(&mut fresh.identifier);
        if !kept.window {
            // It judges torques by what the window knew.
            self.watch.forget();
        }
        kept
    }

    /// Number of the last sample; 0 before the first.
    pub fn last_seq(&self) -> u64 {
        self.last_seq.unwrap_or(0)
    }

    /// Executes a request of the control service; returns whether this core knows it.
    pub fn control(&mut self, command: ControlCommand) -> bool {
        match command {
            ControlCommand::Freeze => self.identifier.freeze(),
            ControlCommand::Resume => self.identifier.resume(),
            ControlCommand::Reset => {
                self.identifier.reset();
                self.watch.forget();
                self.guard.restart();
            }
            ControlCommand::Save | ControlCommand::Load | ControlCommand::Reload | ControlCommand::Follow => {
                return false;
            }
        }
        true
    }

    /// Writes the current estimate, stamped with the last sample's time: equal streams give equal messages.
    pub fn write_parameters(&self, out: &mut Parameters) {
        let estimate = self.identifier.estimate();
        let (n, m) = (self.count, self.dof);
        *out = Parameters::default();
        out.epoch = self.epoch;
        out.seq = self.last_seq.unwrap_or(0);
        out.stamp_ns = self.last_stamp_ns;
        out.model_hash = self.hash;
        out.count = n as u32;
        out.joints = m as u32;
        out.sample_period_s = self.period_s;
        out.instruments = source(estimate.instrument).into();
        out.values[..n].copy_from_slice(&estimate.values[..n]);
        out.std[..n].copy_from_slice(&estimate.std[..n]);
        out.excitation[..n].copy_from_slice(&estimate.excitation[..n]);
        out.reference[..n].copy_from_slice(&estimate.rls_values[..n]);
        for (state, s) in out.state[..n].iter_mut().zip(estimate.state) {
            *state = match s {
                Estimated::Active => ParameterState::Active,
                Estimated::Held => ParameterState::Held,
                Estimated::Unidentified => ParameterState::Unidentified,
            }
            .into();
        }
        out.torque_noise[..m].copy_from_slice(&estimate.torque_noise[..m]);
        out.residual_rms[..m].copy_from_slice(&estimate.residual_rms[..m]);
        let flag = |set: bool, bit: u32| if set { bit } else { 0 };
        out.flags = flag(estimate.verdict.suspended, parameter_flags::SUSPENDED)
            | flag(estimate.frozen, parameter_flags::FROZEN)
            | flag(estimate.updates < self.provisional_updates, parameter_flags::PROVISIONAL)
            | flag(self.record.now != InputFault::None, parameter_flags::BAD_INPUT)
            | (self.load as u32) << parameter_flags::LOAD_SHIFT;
    }

    /// Writes the core's part of the health message; the shell adds its timing.
    pub fn write_health(&self, out: &mut Health) {
        let estimate = self.identifier.estimate();
        let m = self.dof;
        out.seq = self.last_seq.unwrap_or(0);
        out.stamp_ns = self.last_stamp_ns;
        out.samples = self.counts.samples;
        out.lost = self.counts.lost;
        out.refused_stale = self.counts.stale;
        out.refused_invalid = self.counts.invalid + self.counts.unbelievable + self.counts.wrong_period;
        out.rejected_faults = self.counts.faults;
        out.gaps = self.counts.gaps;
        out.samples_held = self.counts.held;
        out.rows_doubted = self.counts.doubted;
        out.setpoints_missing = self.counts.setpoints_missing;
        out.active = estimate.state.iter().filter(|s| **s == Estimated::Active).count() as u32;
        out.held = self.count as u32 - out.active;
        out.instruments = source(estimate.instrument).into();
        out.residual_rms[..m].copy_from_slice(&estimate.residual_rms[..m]);
        out.nominal_residual_rms[..m].copy_from_slice(&estimate.nominal_residual_rms[..m]);
        out.torque_rms[..m].copy_from_slice(&estimate.torque_rms[..m]);
        for (lag, found) in out.loop_lag_s[..m].iter_mut().zip(estimate.loop_lag_s) {
            *lag = *found;
        }
        out.window_s = estimate.window_rows * self.row_period_s;
        out.cycle_s = estimate.cycle_s.unwrap_or(f64::NAN);
        let compared = self.identifier.hausman();
        out.hausman = compared.map_or(f64::NAN, |found| found.statistic);
        out.hausman_p_value = compared.map_or(f64::NAN, |found| found.p_value());
        out.hausman_degrees = compared.map_or(0, |found| found.degrees as u32);
        for (j, ratio) in out.instrument_ratio[..m].iter_mut().enumerate() {
            *ratio = self.identifier.instrument_ratio(j);
        }
        out.input_fault = self.record.now.into();
        out.input_joints = self.record.joints;
        out.last_input_fault = self.record.last.into();
        out.input_faults = self.record.counts;
        out.recovery_s = self.recovery_s().unwrap_or(f64::NAN);
        out.load_level = self.load.into();
        out.load_changes = self.load_changes;
        out.load_seq = self.load_seq;
        out.mode = if !self.clock.fits() {
            DaemonMode::WrongPeriod
        } else if self.record.now != InputFault::None {
            DaemonMode::BadInput
        } else if estimate.frozen {
            DaemonMode::Frozen
        } else if self.counts.samples == 0 {
            DaemonMode::Starting
        } else if estimate.verdict.suspended || self.load == LoadLevel::Hold {
            DaemonMode::Suspended
        } else {
            DaemonMode::Estimating
        }
        .into();
    }

    /// What the estimator knows now.
    pub fn estimate(&self) -> rivet_estimation::Estimate<'_> {
        self.identifier.estimate()
    }

    /// Joints of the arm.
    pub fn dof(&self) -> usize {
        self.dof
    }

    /// Writes what the accepted model leaves and whether the arm has left it, but for the stamp.
    pub fn write_drift(&self, out: &mut Drift) {
        *out = Drift::default();
        out.seq = self.last_seq();
        out.model_hash = self.hash;
        self.drift.write(out);
    }

    /// What happened so far.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// The period at which samples come \[s\], if that is not the robot file's.
    pub fn wrong_period_s(&self) -> Option<f64> {
        self.clock.measured_s().filter(|_| !self.clock.fits())
    }

    /// How often the arm was seen to change: a payload grasped or let go of.
    pub fn changes(&self) -> u64 {
        self.identifier.estimate().changes
    }

    /// Number of the last publication; 0 before the first.
    pub fn epoch(&self) -> u64 {
        self.epoch
    }
}

/// What the robot file says of each joint.
fn joint_limits(robot: &Robot) -> Vec<JointLimits> {
    let drive = &robot.config.drive;
    let limits = |(j, joint): (usize, &rivet_dynamics::Joint)| JointLimits {
        resolution: drive.encoder_resolution[j],
        torque: drive.torque_limit[j],
        revolute: joint.kind == JointKind::Revolute,
        // What does not answer its setpoint is not learnt from, whatever holds it.
        breakaway: 0.0,
    };
    robot.model.arm.joints.iter().enumerate().map(limits).collect()
}

/// The number that health reports a fault under.
fn input_fault(fault: Fault) -> InputFault {
    match fault {
        Fault::Frozen => InputFault::Frozen,
        Fault::EncoderJump => InputFault::EncoderJump,
        Fault::Saturated => InputFault::Saturated,
        Fault::SignFlipped => InputFault::SignFlipped,
        Fault::TorqueStuck => InputFault::TorqueStuck,
        // Of the commanded torque: the daemon does not ask for these.
        Fault::TooFast | Fault::NoResponse | Fault::CommandSaturated => InputFault::Implausible,
    }
}

struct Onlooker<'a, F> {
    watch: &'a mut TorqueCheck,
    drift: &'a mut DriftWatch,
    seq: u64,
    guard: &'a ReadingCheck,
    done: F,
}

impl<F: FnMut(Phase)> Observer for Onlooker<'_, F> {
    fn done(&mut self, phase: Phase) {
        (self.done)(phase);
    }

    fn admits(&mut self, row: &Row) -> bool {
        let admitted = self.watch.admits(row, self.guard);
        if admitted {
            self.drift.row(row, self.seq);
        }
        admitted
    }
}

fn source(kind: Instrument) -> InstrumentSource {
    match kind {
        Instrument::None | Instrument::Regressor => InstrumentSource::None,
        Instrument::Setpoint => InstrumentSource::Setpoint,
        Instrument::SetpointThroughLoop => InstrumentSource::SetpointThroughLoop,
        Instrument::SecondEncoder => InstrumentSource::SecondEncoder,
        Instrument::PreviousCycle => InstrumentSource::PreviousCycle,
        Instrument::Delayed => InstrumentSource::Delayed,
    }
}
