//! `rivet replay`: a log through shared memory into rivetd, as if live.

use crate::children::Children;
use crate::map::MapArgs;
use crate::outputs::Outputs;
use crate::stream::{Recording, write_stream};
use crate::summary::{Summary, nothing};
use crate::table::{paragraph, show};
use anyhow::{Context, Result, bail};
use rivet_config::Robot;
use rivet_ipc_schema::{Bus, BusConfig, Health, Notifier, Parameters, PrivateBus, Publisher, RobotName, Subscriber};
use rivet_ipc_schema::{JointState, LinkState, Setpoint};
use rivet_realtime::Shutdown;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// Sends a log to a daemon of its own, or to a running one, and shows what that identified.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The robot file.
    robot: PathBuf,
    /// The log (docs/logs.md), with positions and torque.
    log: PathBuf,
    /// Speed-up over the recording, or max: as fast as the daemon accepts samples.
    #[arg(long, default_value = "max", value_parser = parse_speed)]
    speed: Speed,
    /// Write every published parameter set to this CSV file.
    #[arg(long, value_name = "FILE")]
    stream: Option<PathBuf>,
    /// Write the last parameter set and the counts to this JSON file.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Send to the rivetd that already runs on the robot's bus instead of starting one.
    #[arg(long)]
    attach: bool,
    #[command(flatten)]
    map: MapArgs,
}

/// Pace of a replay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Speed {
    Factor(f64),
    Max,
}

fn parse_speed(word: &str) -> Result<Speed, String> {
    match word {
        "max" => Ok(Speed::Max),
        _ => match word.parse() {
            Ok(factor) if factor > 0.0 && factor <= 1000.0 => Ok(Speed::Factor(factor)),
            _ => Err("it must be max, or a number above 0 and up to 1000".to_owned()),
        },
    }
}

/// Samples that may be on the way: a quarter of the daemon's ring, so that none is ever overwritten.
const IN_FLIGHT: usize = 256;

/// Without any progress for this long, the daemon counts as dead.
const PATIENCE: Duration = Duration::from_secs(10);

struct Ports {
    states: Publisher<JointState>,
    arrival: Notifier,
    setpoints: Publisher<Setpoint>,
    links: Publisher<LinkState>,
    parameters: Subscriber<Parameters>,
    health: Subscriber<Health>,
}

/// What came back from the daemon.
#[derive(Default)]
struct Received {
    stream: Vec<Parameters>,
    health: Option<Health>,
}

pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let robot = args.map.load(&args.robot)?;
    let outputs = Outputs::for_logs(&robot, &args.robot, [&args.log]).file("--stream", args.stream.as_ref());
    outputs.file("--json", args.json.as_ref()).check()?;
    let recording = Recording::read(&robot, &args.log)?;
    let shutdown = Shutdown::on_signals().context("signals cannot be handled")?;
    rivet_files::note(paragraph("log: ", &recording.report.to_string()).trim_end());

    // Declared in this order, so that children end before their bus is swept away.
    let private = (!args.attach).then(|| PrivateBus::new("replay"));
    let mut children = Children::default();
    let config = match &private {
        Some(private) => private.config().clone(),
        None => BusConfig { prefix: robot.config.bus.prefix.clone(), root: robot.config.bus.root.clone() },
    };
    let name = RobotName::new(&robot.config.name)?;
    let bus = Bus::open(&config, &name, "rivet-replay")?;
    let ports = Ports {
        states: bus.joint_state_publisher()?,
        arrival: bus.joint_state_notifier()?,
        setpoints: bus.setpoint_publisher()?,
        links: bus.link_state_publisher()?,
        parameters: bus.parameters_subscriber()?,
        health: bus.health_subscriber()?,
    };
    if !args.attach {
        children.start(&daemon_words(args, &config), Some(own_stderr()?))?;
    }
    wait_for_daemon(&ports, &mut children, &shutdown)?;
    let received = play(&recording, args.speed, &ports, &mut children, &shutdown)?;
    children.end();
    report(args, &robot, &recording, &received)
}

fn daemon_words(args: &Args, config: &BusConfig) -> Vec<String> {
    let text = |path: &std::path::Path| path.to_string_lossy().into_owned();
    ["daemon", &text(&args.robot), "--best-effort", "--prefix", &config.prefix, "--root", &text(&config.root)]
        .map(str::to_owned)
        .to_vec()
}

/// A second handle on this program's standard error.
pub(crate) fn own_stderr() -> Result<std::fs::File> {
    use std::os::fd::AsFd;
    let copy = std::io::stderr().as_fd().try_clone_to_owned().context("standard error cannot be shared")?;
    Ok(std::fs::File::from(copy))
}

fn wait_for_daemon(ports: &Ports, children: &mut Children, shutdown: &Shutdown) -> Result<()> {
    let deadline = Instant::now() + PATIENCE;
    while ports.states.subscribers() == 0 || ports.setpoints.subscribers() == 0 || ports.links.subscribers() == 0 {
        check_alive(children, shutdown)?;
        if Instant::now() > deadline {
            bail!("no rivetd listens on this bus");
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    Ok(())
}

fn check_alive(children: &mut Children, shutdown: &Shutdown) -> Result<()> {
    if shutdown.is_requested() {
        bail!("interrupted");
    }
    match children.ended() {
        Some((name, status)) => bail!("rivet {name} ended early ({status})"),
        None => Ok(()),
    }
}

impl Received {
    /// Takes in what has come; returns whether anything had.
    fn drain(&mut self, ports: &Ports) -> Result<bool> {
        let mut any = false;
        while let Some(parameters) = ports.parameters.receive()? {
            self.stream.push(parameters);
            any = true;
        }
        while let Some(health) = ports.health.receive()? {
            self.health = Some(health);
            any = true;
        }
        Ok(any)
    }

    /// Number of the last sample that the daemon has reported.
    fn seq(&self) -> u64 {
        self.health.map_or(0, |health| health.seq)
    }
}

fn play(
    recording: &Recording,
    speed: Speed,
    ports: &Ports,
    children: &mut Children,
    shutdown: &Shutdown,
) -> Result<Received> {
    let mut received = Received::default();
    let begin = Instant::now();
    let mut progress = rivet_analysis::progress::Progress::new("replaying samples", recording.len());
    for k in 0..recording.len() {
        let period = recording.period(k);
        if let Speed::Factor(factor) = speed {
            let due = begin + Duration::from_nanos((period.state.stamp_ns as f64 / factor) as u64);
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
        }
        let oldest = recording.seq(k.saturating_sub(IN_FLIGHT));
        wait_until(&mut received, ports, children, shutdown, |received| k < IN_FLIGHT || oldest <= received.seq())?;
        if let Some(setpoint) = &period.setpoint {
            ports.setpoints.send(setpoint)?;
        }
        if let Some(link) = &period.link {
            ports.links.send(link)?;
        }
        ports.states.send(&period.state)?;
        ports.arrival.notify()?;
        progress.set(k + 1);
    }
    let last = recording.last_seq();
    wait_until(&mut received, ports, children, shutdown, |received| received.seq() >= last)?;
    progress.done();
    Ok(received)
}

fn wait_until(
    received: &mut Received,
    ports: &Ports,
    children: &mut Children,
    shutdown: &Shutdown,
    done: impl Fn(&Received) -> bool,
) -> Result<()> {
    let mut moved = Instant::now();
    loop {
        if received.drain(ports)? {
            moved = Instant::now();
        }
        if done(received) {
            return Ok(());
        }
        check_alive(children, shutdown)?;
        if moved.elapsed() > PATIENCE {
            bail!("rivetd has not reported anything for {} s", PATIENCE.as_secs());
        }
        std::thread::sleep(Duration::from_micros(500));
    }
}

fn report(args: &Args, robot: &Robot, recording: &Recording, received: &Received) -> Result<ExitCode> {
    let health = received.health.context("rivetd reported nothing")?;
    if let Some(path) = &args.stream {
        write_stream(path, robot, &received.stream)?;
    }
    let Some(last) = received.stream.last() else { return Err(nothing(robot, recording, &health).into()) };
    let summary = Summary::new(robot, recording, last, &health);
    show(&format!("{summary}\n"))?;
    if let Some(path) = &args.json {
        rivet_files::write_whole(path, summary.json().to_string())
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    let skipped = received.stream.windows(2).any(|pair| pair[1].epoch != pair[0].epoch + 1);
    let taken = health.samples + health.samples_held + health.refused_invalid + health.rejected_faults;
    let lost = (recording.len() as u64).saturating_sub(taken + health.refused_stale);
    let missing = recording.missing();
    if health.lost != missing || lost > 0 || skipped || health.dropped_messages > 0 {
        rivet_files::note(format_args!(
            "rivet replay: {} samples lost, {lost} unaccounted for, {} messages dropped: this run does not count",
            health.lost.abs_diff(missing),
            health.dropped_messages
        ));
        return Ok(ExitCode::FAILURE);
    }
    Ok(ExitCode::SUCCESS)
}
