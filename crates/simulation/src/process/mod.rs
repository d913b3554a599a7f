//! `rivet-sim`: the simulated arm behind the shared memory of a robot controller.

mod options;
mod output;
mod recording;

use std::io;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use rivet_config::ConfigErrors;
use rivet_ipc_schema::{
    BlackboardReader, Bus, BusConfig, BusError, Command, JointState, Notifier, PortError, Publisher, RobotName,
    Setpoint, faults,
};
use rivet_realtime::{PeriodTimer, Shutdown, die_with_parent, now_ns};

pub use options::{MotionKind, Options, nominal_joints};
pub use output::{Summary, TrueParameter, TruthFile};
pub use recording::Recording;

use crate::motion::Governor;
use crate::plant::Plant;
use crate::stand_in::{Sample, StandIn};
use crate::truth::Truth;
use output::LogWriter;

/// Why the simulation did not run.
#[derive(Debug, thiserror::Error)]
pub enum SimError {
    /// The robot file is wrong.
    #[error("{0}")]
    Config(#[from] ConfigErrors),
    /// The bus cannot be used.
    #[error("{0}")]
    Bus(#[from] BusError),
    /// A port failed while running.
    #[error("{0}")]
    Port(#[from] PortError),
    /// A file cannot be written.
    #[error("{}: {source}", path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The summary cannot be printed.
    #[error("{0}")]
    Output(io::Error),
    /// An option does not fit the robot.
    #[error("{0}")]
    Option(String),
    /// The system refused signal handling.
    #[error("signals cannot be handled: {0}")]
    Signals(io::Error),
    /// Nobody commanded the arm.
    #[error("no command within {0} s: is a controller running on the same bus (prefix, root, robot)?")]
    NoCommand(f64),
}

impl SimError {
    /// Exit code of the process.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Config(_) => 78,
            Self::Option(_) => 64,
            Self::File { .. } | Self::Output(_) => 73,
            Self::NoCommand(_) => 69,
            Self::Bus(_) | Self::Port(_) | Self::Signals(_) => 71,
        }
    }
}

/// How often a blackboard that is silent is looked for anew.
const SEARCH: Duration = Duration::from_millis(20);
/// Sleep between two looks at the blackboard while simulated time waits.
const LOOK: Duration = Duration::from_micros(20);

struct Ports {
    states: Publisher<JointState>,
    arrival: Notifier,
    setpoints: Publisher<Setpoint>,
    commands: BlackboardReader<Command>,
    /// Commands stamped earlier were meant for a run before this one.
    since_ns: u64,
}

impl Ports {
    fn open(bus: &Bus) -> Result<Self, BusError> {
        Ok(Self {
            states: bus.joint_state_publisher()?,
            arrival: bus.joint_state_notifier()?,
            setpoints: bus.setpoint_publisher()?,
            commands: bus.command_reader()?,
            since_ns: now_ns(),
        })
    }

    /// The plan first: whoever takes in the joint state then holds its setpoint.
    fn publish(&self, s: &Sample) -> Result<(), PortError> {
        // Stamps are those of the arm's own time: it may run faster or slower than the clock (lockstep), and its samples are
        // then still one period apart.
        let stamp_ns = self.since_ns + (s.t_s * 1e9).round() as u64;
        let joints = s.dof as u32;
        self.setpoints.send(&Setpoint {
            seq: s.seq,
            stamp_ns,
            q: s.q_des,
            qd: s.qd_des,
            qdd: s.qdd_des,
            joints,
            ..Setpoint::default()
        })?;
        let faults = if s.braked { faults::STOPPED } else { 0 };
        self.states.send(&JointState {
            seq: s.seq,
            stamp_ns,
            q: s.q,
            tau: s.tau,
            joints,
            faults,
            ..JointState::default()
        })?;
        self.arrival.notify()?;
        Ok(())
    }

    fn command(&self) -> Option<Command> {
        self.commands.latest().filter(|c| c.stamp_ns >= self.since_ns)
    }
}

/// Runs the simulation until its duration or its file of setpoints is over, or SIGINT, SIGTERM or SIGHUP arrives.
///
/// # Errors
/// Why it did not start or could not go on.
pub fn run(options: &Options) -> Result<Summary, SimError> {
    let shutdown = Shutdown::on_signals().map_err(SimError::Signals)?;
    if options.die_with_parent {
        die_with_parent().map_err(SimError::Signals)?;
    }
    run_until(options, &shutdown)
}

/// The whole process, for `rivet-sim` and `rivet sim`: the summary as one line of JSON on standard output, errors on standard
/// error.
pub fn main(options: &Options) -> ExitCode {
    let printed = run(options).and_then(|summary| {
        let line = serde_json::to_string(&summary)
            .map_err(|e| SimError::Option(format!("the summary cannot be written: {e}")))?;
        rivet_files::print(&rivet_files::printable_json(line + "\n")).map_err(SimError::Output)
    });
    match printed {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            rivet_files::note(format_args!("rivet-sim: {why}"));
            ExitCode::from(why.exit_code())
        }
    }
}

/// As [`run`], until `shutdown` asks for the end.
///
/// # Errors
/// Why it did not start or could not go on.
pub fn run_until(options: &Options, shutdown: &Shutdown) -> Result<Summary, SimError> {
    let robot = rivet_config::load(&options.robot)?;
    if !(1..=robot.dof()).contains(&options.joint) {
        let why = format!("--joint {} must lie in 1..={} for {}", options.joint, robot.dof(), robot.config.name);
        return Err(SimError::Option(why));
    }
    let disturbances = options.disturbances(&robot);
    let truth = Truth::new(&robot.model, &nominal_joints(&robot), &disturbances);
    for line in truth.left_out() {
        rivet_files::note(format_args!("rivet-sim: {line}"));
    }
    // A bus that cannot be joined leaves no file behind.
    let name = RobotName::new(&robot.config.name)?;
    let bus = Bus::open(
        &BusConfig {
            prefix: options.prefix.clone().unwrap_or_else(|| robot.config.bus.prefix.clone()),
            root: options.root.clone().unwrap_or_else(|| robot.config.bus.root.clone()),
        },
        &name,
        "rivet-sim",
    )?;
    if let Some(path) = &options.truth_out {
        output::json(path, &TruthFile::new(&robot, &truth, &disturbances))?;
    }
    let log = options.log_out.as_deref().map(|path| LogWriter::create(path, robot.dof())).transpose()?;
    let (period_s, seed) = (robot.config.sample_period_s, options.seed(&robot));
    let plant = Plant::new(&truth, &options.sensors(&robot), &options.plant(&robot), seed);
    let governor = Governor::new(options.trajectory(&robot)?);
    let stand_in = StandIn::new(plant, governor, period_s, options.stale_periods, seed);

    let ports = Ports::open(&bus)?;
    rivet_files::note(format_args!("rivet-sim: {name}: ready, brakes closed until commands come"));
    let summary = exchange(stand_in, ports, log.as_ref(), options, shutdown, period_s);
    // Written also when the bus failed: what was seen until then is worth having.
    let logged = log.map_or(Ok(()), LogWriter::finish);
    let mut summary = summary?;
    logged?;
    summary.robot.clone_from(&robot.config.name);
    if let Some(path) = &options.summary_out {
        output::json(path, &summary)?;
    }
    Ok(summary)
}

fn exchange(
    mut stand_in: StandIn,
    mut ports: Ports,
    log: Option<&LogWriter>,
    options: &Options,
    shutdown: &Shutdown,
    period_s: f64,
) -> Result<Summary, SimError> {
    let period = Duration::from_secs_f64(period_s);
    let mut timer = PeriodTimer::new(period);
    let begin_ns = now_ns();
    let (mut lockstep_timeouts, mut overruns) = (0, 0);
    let ended = loop {
        if shutdown.is_requested() {
            break "signal";
        }
        if options.duration.is_some_and(|duration| stand_in.motion_s() >= duration - 0.5 * period_s) {
            break "duration";
        }
        if options.duration.is_none() && stand_in.is_over() {
            break "setpoints";
        }
        let waited_s = (now_ns() - begin_ns) as f64 * 1e-9;
        if options.patience > 0.0 && !stand_in.commanded() && waited_s > options.patience {
            return Err(SimError::NoCommand(options.patience));
        }
        // A braked arm has nobody to wait for, and an arm in lockstep may go faster than its clock.
        if stand_in.braked() || !options.unpaced {
            overruns += timer.wait().missed;
        }
        let sample = stand_in.latch();
        ports.publish(&sample)?;
        if let (Some(log), false) = (log, sample.braked) {
            log.push(&sample);
        }
        let patience = match options.lockstep {
            Some(ms) if !stand_in.braked() => Duration::from_secs_f64(ms * 1e-3),
            // The torque changes half a period after the latch: what has come by then acts.
            _ => period / 2,
        };
        let answered = wait_for_answer(&stand_in, &ports, patience, shutdown);
        if options.lockstep.is_some() && !answered && !stand_in.braked() {
            lockstep_timeouts += 1;
        }
        if !answered {
            ports.commands.reopen_if_stale(now_ns(), SEARCH.max(4 * period))?;
        }
        stand_in.advance(ports.command().as_ref());
    };
    let counts = stand_in.counts();
    let (tracking, saturated) = stand_in.finish();
    Ok(Summary { robot: String::new(), ended, counts, lockstep_timeouts, overruns, saturated, tracking })
}

/// Waits until the sample last published is answered, at most `patience`.
fn wait_for_answer(stand_in: &StandIn, ports: &Ports, patience: Duration, shutdown: &Shutdown) -> bool {
    let begin_ns = now_ns();
    loop {
        if ports.command().is_some_and(|c| stand_in.is_answer(&c)) {
            return true;
        }
        if u128::from(now_ns() - begin_ns) >= patience.as_nanos() || shutdown.is_requested() {
            return false;
        }
        std::thread::sleep(LOOK);
    }
}
