//! The thread that owns every port that may allocate or wait.

use crate::consistent::Waiting;
use crate::error::StartError;
use crate::keeper::Latest;
use crate::progress::Progress;
use rivet_ipc_schema::{Bus, BusConfig, BusError, ControlCommand, ControlStatus, Health, Parameters, RobotName};
use rivet_realtime::Shutdown;
use std::sync::mpsc::Sender;
use std::time::Duration;

/// What the loop hands over for publication.
#[expect(clippy::large_enum_variant, reason = "both live in a preallocated ring; boxing would allocate in the loop")]
pub(crate) enum Outbound {
    /// A parameter set.
    Parameters(Parameters),
    /// A health message.
    Health(Health),
}

/// How often the queue is looked at; parameters change over seconds, so a millisecond costs nothing.
const TURN: Duration = Duration::from_millis(1);

/// Turns between looks for subscribers that joined: a late one has the latest parameters within this many milliseconds.
const TURNS_PER_REFRESH: u32 = 5;

struct Ports {
    parameters: rivet_ipc_schema::Publisher<Parameters>,
    latest: rivet_ipc_schema::BlackboardWriter<Parameters>,
    health: rivet_ipc_schema::Publisher<Health>,
    control: rivet_ipc_schema::ControlServer,
}

fn open(bus: &Bus) -> Result<Ports, BusError> {
    Ok(Ports {
        parameters: bus.parameters_publisher()?,
        latest: bus.latest_parameters_writer()?,
        health: bus.health_publisher()?,
        control: bus.control_server()?,
    })
}

/// Publishes until shut down, then what is left in the queue.
pub(crate) fn run(
    config: &BusConfig,
    name: &RobotName,
    mut outbound: rtrb::Consumer<Outbound>,
    mut commands: rtrb::Producer<ControlCommand>,
    kept: Option<&Latest>,
    waiting: &Waiting,
    progress: &Progress,
    shutdown: &Shutdown,
    ready: &Sender<Result<(), StartError>>,
) {
    let opened = Bus::open(config, name, "rivetd-bus").and_then(|bus| open(&bus).map(|ports| (bus, ports)));
    let (_bus, ports) = match opened {
        Ok(opened) => {
            // A receiver that is gone means that start-up failed elsewhere; the shutdown flag says so too.
            let _ = ready.send(Ok(()));
            opened
        }
        Err(why) => {
            let _ = ready.send(Err(why.into()));
            return;
        }
    };
    let mut turns = 0_u32;
    let mut complained = false;
    loop {
        let stopping = shutdown.is_requested();
        let refresh = turns.is_multiple_of(TURNS_PER_REFRESH);
        let result = turn(&ports, &mut outbound, &mut commands, kept, waiting, progress, refresh);
        if let Err(why) = result
            && !complained
        {
            complained = true;
            eprintln!("rivetd: {why} (said once)");
        }
        if stopping {
            return;
        }
        turns = turns.wrapping_add(1);
        std::thread::sleep(TURN);
    }
}

fn turn(
    ports: &Ports,
    outbound: &mut rtrb::Consumer<Outbound>,
    commands: &mut rtrb::Producer<ControlCommand>,
    kept: Option<&Latest>,
    waiting: &Waiting,
    progress: &Progress,
    refresh: bool,
) -> Result<(), rivet_ipc_schema::PortError> {
    while let Ok(message) = outbound.pop() {
        match message {
            Outbound::Parameters(parameters) => {
                if let Some(kept) = kept {
                    kept.offer(&parameters);
                }
                ports.latest.write(&parameters);
                waiting.put(&parameters);
                ports.parameters.send(&parameters)?;
            }
            Outbound::Health(health) => {
                ports.health.send(&health)?;
            }
        }
    }
    if refresh {
        ports.parameters.refresh()?;
        ports.health.refresh()?;
    }
    while ports.control.serve(|command| (hand_over(commands, kept, command), progress.read().epoch))? {}
    Ok(())
}

/// The loop executes a request at its next period; the reply says that it is on its way.
fn hand_over(
    commands: &mut rtrb::Producer<ControlCommand>,
    kept: Option<&Latest>,
    command: ControlCommand,
) -> ControlStatus {
    match (command, kept) {
        (ControlCommand::Save, Some(kept)) if kept.save_now() => ControlStatus::Done,
        // No store, nothing worth storing yet; and what is stored is taken up at the start only.
        (ControlCommand::Save | ControlCommand::Load, _) => ControlStatus::Refused,
        (ControlCommand::Freeze | ControlCommand::Resume | ControlCommand::Reset, _) => {
            if commands.push(command).is_ok() { ControlStatus::Done } else { ControlStatus::Failed }
        }
    }
}
