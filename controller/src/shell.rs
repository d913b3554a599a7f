//! What stands around [`Core`]: clock, bus, signals.

use crate::core::Core;
use crate::error::StartError;
use crate::gate::{Refusal, refusal_text};
use rivet_config::Robot;
use rivet_ipc_schema::{
    BlackboardWriter, Bus, BusConfig, BusError, Command, JointState, Listener, Parameters, RobotName, Setpoint,
    Subscriber,
};
use rivet_realtime::{RealTimeSettings, Shutdown, now_ns};
use std::path::PathBuf;
use std::time::Duration;

/// How the controller is to run, beside what the robot file says.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Options {
    /// The robot file (robot.toml, or model.toml of `rivet identify --export`).
    pub robot: PathBuf,
    /// Overrides `[bus] prefix`.
    #[arg(long)]
    pub prefix: Option<String>,
    /// Overrides `[bus] root`.
    #[arg(long)]
    pub root: Option<PathBuf>,
    /// Go on without real-time scheduling and locked memory where they are refused.
    #[arg(long)]
    pub best_effort: bool,
    /// Published parameters act from this sample number on; until then the robot file's values do.
    #[arg(long, value_name = "SEQ", default_value_t = 0)]
    pub adopt_from: u64,
    /// Published parameters never act: the robot file's values stay.
    #[arg(long)]
    pub nominal: bool,
    /// End with the process that started this one.
    #[arg(long, hide = true)]
    pub die_with_parent: bool,
}

/// Without samples the loop still turns this often, so that it can stop.
const PATIENCE: Duration = Duration::from_millis(20);

/// Parameter sets looked at per period; more would be an unbounded loop.
const PER_PERIOD: usize = 16;

struct Ports {
    states: Subscriber<JointState>,
    arrival: Listener,
    setpoints: Subscriber<Setpoint>,
    parameters: Subscriber<Parameters>,
    command: BlackboardWriter<Command>,
}

fn open(bus: &Bus) -> Result<Ports, BusError> {
    Ok(Ports {
        states: bus.joint_state_subscriber()?,
        arrival: bus.joint_state_listener()?,
        setpoints: bus.setpoint_subscriber()?,
        parameters: bus.parameters_subscriber()?,
        command: bus.command_writer()?,
    })
}

/// Runs until SIGTERM or SIGINT.
///
/// # Errors
/// Why it did not start.
pub fn run(options: &Options) -> Result<(), StartError> {
    let robot = rivet_config::load(&options.robot)?;
    let shutdown = Shutdown::on_signals().map_err(StartError::Signals)?;
    if options.die_with_parent {
        rivet_realtime::die_with_parent().map_err(StartError::Signals)?;
    }
    let name = RobotName::new(&robot.config.name)?;
    let config = BusConfig {
        prefix: options.prefix.clone().unwrap_or_else(|| robot.config.bus.prefix.clone()),
        root: options.root.clone().unwrap_or_else(|| robot.config.bus.root.clone()),
    };
    let mut core = Core::new(&robot, if options.nominal { u64::MAX } else { options.adopt_from })?;
    let bus = Bus::open(&config, &name, "rivet-controller")?;
    let mut ports = open(&bus)?;
    let granted = rivet_realtime::enter(&realtime(&robot, options))?;
    for refused in &granted.refused {
        eprintln!("rivet-controller: goes on without real time: {refused}");
    }
    eprintln!("rivet-controller: {name}: ready");
    let mut said = Refusal::None;
    while !shutdown.is_requested() {
        period(&mut core, &mut ports);
        let refusal = core.last_refusal();
        if refusal != said {
            said = refusal;
            eprintln!("rivet-controller: parameters: {}", refusal_text(refusal));
        }
    }
    let counts = core.counts();
    eprintln!(
        "rivet-controller: stopped after {} commands; {} parameter sets adopted, {} refused",
        counts.commands, counts.accepted, counts.refused
    );
    Ok(())
}

fn realtime(robot: &Robot, options: &Options) -> RealTimeSettings {
    let settings = &robot.config.realtime;
    RealTimeSettings {
        // Below the daemon's loop: the command only needs the newest sample, the estimator needs every one.
        priority: settings.priority.map(|p| p.saturating_sub(5).max(1)),
        cpu: settings.cpu,
        lock_memory: settings.lock_memory,
        required: settings.required && !options.best_effort,
    }
}

/// Waits for the next sample and answers it; a controller takes the newest.
fn period(core: &mut Core, ports: &mut Ports) {
    if ports.arrival.wait(PATIENCE).is_err() {
        // A listener that fails must not make the loop spin.
        std::thread::sleep(Duration::from_millis(1));
    }
    // A port that fails has no message; the robot's own watchdog acts when commands stay away.
    let Some(sample) = ports.states.receive_newest().ok().flatten() else {
        return;
    };
    if let Ok(Some(setpoint)) = ports.setpoints.receive_newest() {
        core.offer_setpoint(&setpoint);
    }
    for _ in 0..PER_PERIOD {
        match ports.parameters.receive() {
            Ok(Some(set)) => {
                core.offer_parameters(&set, &sample);
            }
            _ => break,
        }
    }
    if let Ok(mut command) = core.tick(&sample) {
        command.stamp_ns = now_ns();
        ports.command.write(&command);
    }
}
