//! A robot controller's side of the bus.

use std::sync::atomic::Ordering;
use std::sync::{Arc, PoisonError, mpsc};
use std::thread::{JoinHandle, Thread};
use std::time::{Duration, Instant};

use rivet_ipc_schema::{
    BlackboardReader, BusConfig, BusError, Command, ControllerHealth, Health, MAX_JOINTS, Parameters, RobotName,
};

use crate::clock::now_ns;
use crate::latest::{Taker, latest};
use crate::ports::{Channels, Outgoing, Ports, Shared};
use crate::sample::Sample;
use crate::status::Status;

/// Samples that may wait for the thread of the ports.
pub const QUEUE: usize = 1024;

/// Readers of the command that may wait to be taken, and to be dropped.
const READERS: usize = 4;

/// Time between two looks at the command while waiting for it.
const LOOK: Duration = Duration::from_micros(20);

/// Why a robot could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// The joint count breaks a rule.
    #[error("joints: {joints}; it must be the robot file's, 1 to {MAX_JOINTS}, or 0 for a program that only reads")]
    Joints {
        /// The count given.
        joints: u32,
    },
    /// The bus could not be opened, or another version is spoken on it.
    #[error("{0}")]
    Bus(#[from] BusError),
    /// The thread could not be started.
    #[error("the thread of librivet cannot be started: {0}")]
    Thread(std::io::Error),
}

impl OpenError {
    /// The status that a function of the C interface returns.
    pub fn status(&self) -> Status {
        match self {
            OpenError::Joints { .. }
            | OpenError::Bus(BusError::RobotName { .. } | BusError::Prefix { .. } | BusError::Root { .. }) => {
                Status::Argument
            }
            OpenError::Bus(BusError::Version(_)) => Status::Version,
            OpenError::Bus(_) => Status::Bus,
            OpenError::Thread(_) => Status::Internal,
        }
    }
}

/// How many samples went where.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct Counters {
    /// Samples published; also the sequence number of the last one.
    pub published: u64,
    /// Samples sent to the bus.
    pub sent: u64,
    /// Samples lost because the queue was full; the others see a gap in the sequence.
    pub lost: u64,
    /// Samples that the bus did not accept; rivet_error has the reason.
    pub failed: u64,
}

/// The robot's side of the bus: publishes samples, reads torque, parameters and health.
///
/// It may move to another thread, and is used by one thread at a time.
pub struct Robot {
    joints: u32,
    seq: u64,
    skipped: u64,
    lost: u64,
    opened_ns: u64,
    samples: rtrb::Producer<Outgoing>,
    command: Option<BlackboardReader<Command>>,
    readers: rtrb::Consumer<BlackboardReader<Command>>,
    retired: rtrb::Producer<BlackboardReader<Command>>,
    parameters: Taker<Parameters>,
    health: Taker<Health>,
    controller_health: Taker<ControllerHealth>,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
    wake: Thread,
}

impl std::fmt::Debug for Robot {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Robot of {} joints, {:?}", self.joints, self.counters())
    }
}

impl Robot {
    /// Joins the bus of the robot `name` with `joints` joints. Daemon and controller may start before or after.
    /// With 0 joints it only reads; [`publish`](Self::publish) then returns [`Status::Argument`].
    ///
    /// # Errors
    /// A value that breaks a rule; the bus cannot be opened; another version of a message is spoken on it.
    pub fn open(config: &BusConfig, name: &str, joints: u32) -> Result<Robot, OpenError> {
        if joints > MAX_JOINTS as u32 {
            return Err(OpenError::Joints { joints });
        }
        let robot = RobotName::new(name)?;
        let opened_ns = now_ns();
        let (samples, queued) = rtrb::RingBuffer::new(QUEUE);
        let (new_readers, readers) = rtrb::RingBuffer::new(READERS);
        // Room for all readers there can be, so that the cycle never has to drop one.
        let (retired, old_readers) = rtrb::RingBuffer::new(2 * READERS);
        let (give_parameters, parameters) = latest();
        let (give_health, health) = latest();
        let (give_controller_health, controller_health) = latest();
        let shared = Arc::new(Shared::default());
        let channels = Channels {
            samples: queued,
            readers: new_readers,
            retired: old_readers,
            parameters: give_parameters,
            health: give_health,
            controller_health: give_controller_health,
        };
        let thread = start(config.clone(), robot, joints > 0, channels, Arc::clone(&shared))?;
        let wake = thread.thread().clone();
        let mut opened = Robot {
            joints,
            seq: 0,
            skipped: 0,
            lost: 0,
            opened_ns,
            samples,
            command: None,
            readers,
            retired,
            parameters,
            health,
            controller_health,
            shared,
            thread: Some(thread),
            wake,
        };
        opened.renew_reader();
        Ok(opened)
    }

    /// Publishes the sample of one period, its setpoint before its joint state, under the next sequence number, and wakes
    /// who waits for it.
    ///
    /// Real-time safe: no allocation; its only system call wakes the library's thread.
    pub fn publish(&mut self, sample: &Sample) -> Status {
        if self.joints == 0 {
            return Status::Argument;
        }
        self.seq += 1;
        let stamp_ns = if sample.stamp_ns == 0 { now_ns() } else { sample.stamp_ns };
        let setpoint = sample.setpoint(self.seq, stamp_ns, self.joints);
        let queued = self.samples.push((setpoint, sample.joint_state(self.seq, stamp_ns, self.joints)));
        if queued.is_err() {
            self.lost += 1;
            return if self.samples.is_abandoned() { Status::Ended } else { Status::Full };
        }
        self.wake.unpark();
        if self.samples.is_abandoned() { Status::Ended } else { Status::Ok }
    }

    /// Leaves out the sequence numbers of `periods` samples that never reached the caller, such as those of a network that
    /// lost them. The others count them as lost, and no velocity is computed across the hole.
    ///
    /// Real-time safe.
    pub fn skip(&mut self, periods: u64) {
        self.seq = self.seq.saturating_add(periods);
        self.skipped = self.skipped.saturating_add(periods);
    }

    /// The latest command that was written since this robot was opened. Its age is the caller's to judge.
    ///
    /// Real-time safe: no allocation, no system call.
    pub fn command(&mut self) -> Option<Command> {
        self.renew_reader();
        // A blackboard keeps the last value of a controller that has ended.
        self.command.as_ref()?.latest().filter(|command| command.stamp_ns >= self.opened_ns)
    }

    /// Waits for the command that answers the last published sample, at most `timeout`; `None` if there is none by then.
    ///
    /// Sleeps in short steps on the caller's thread; no allocation.
    pub fn wait_for_command(&mut self, timeout: Duration) -> Option<Command> {
        let begin = Instant::now();
        loop {
            let command = self.command();
            if command.is_some_and(|command| command.seq == self.seq) {
                return command;
            }
            let left = timeout.checked_sub(begin.elapsed()).filter(|left| !left.is_zero())?;
            std::thread::sleep(left.min(LOOK));
        }
    }

    /// The latest parameters of the daemon, with standard deviations and states; `None` before the first.
    ///
    /// Real-time safe: no allocation, no system call.
    pub fn parameters(&mut self) -> Option<&Parameters> {
        self.parameters.get()
    }

    /// The latest health of the daemon; `None` before the first. Real-time safe as [`parameters`](Self::parameters).
    pub fn health(&mut self) -> Option<&Health> {
        self.health.get()
    }

    /// The latest health of the controller; `None` before the first. Real-time safe as [`parameters`](Self::parameters).
    pub fn controller_health(&mut self) -> Option<&ControllerHealth> {
        self.controller_health.get()
    }

    /// How many samples went where; the sequence number of the last one is that of the published and the skipped. Real-time safe.
    pub fn counters(&self) -> Counters {
        Counters {
            published: self.seq - self.skipped,
            sent: self.shared.sent.load(Ordering::Relaxed),
            lost: self.lost,
            failed: self.shared.failed.load(Ordering::Relaxed),
        }
    }

    /// What failed last on the library's thread; empty if nothing did. Not for the cycle: it allocates.
    pub fn problem(&self) -> String {
        self.shared.problem.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Takes the reader of a new blackboard and gives back the old one.
    fn renew_reader(&mut self) {
        while self.retired.slots() > 0
            && let Ok(reader) = self.readers.pop()
        {
            if let Some(old) = self.command.replace(reader)
                && let Err(rtrb::PushError::Full(old)) = self.retired.push(old)
            {
                // Not reached: there was room. Dropping it here would work on files.
                std::mem::forget(old);
            }
        }
    }
}

impl Drop for Robot {
    /// Sends what is queued and leaves the bus.
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Release);
        self.wake.unpark();
        if let Some(thread) = self.thread.take() {
            // It can only have panicked, which was reported on standard error.
            let _ = thread.join();
        }
    }
}

/// Starts the thread of the ports and waits until they are open.
fn start(
    config: BusConfig,
    robot: RobotName,
    publishes: bool,
    channels: Channels,
    shared: Arc<Shared>,
) -> Result<JoinHandle<()>, OpenError> {
    let (report, opened) = mpsc::channel();
    let work = move || match Ports::open(&config, &robot, publishes, channels, shared) {
        Ok(ports) => {
            let _ = report.send(Ok(()));
            ports.run();
        }
        Err(why) => {
            let _ = report.send(Err(why));
        }
    };
    let thread = std::thread::Builder::new().name("librivet".to_owned()).spawn(work).map_err(OpenError::Thread)?;
    match opened.recv() {
        Ok(Ok(())) => Ok(thread),
        Ok(Err(why)) => Err(OpenError::Bus(why)),
        Err(_) => Err(OpenError::Thread(std::io::Error::other("it panicked"))),
    }
}
