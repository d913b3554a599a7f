//! `rivet bench-loop`: the daemon's loop and cyclictest's way of measuring, side by side on one processor at one priority.

use crate::doctor::latencies_json;
use crate::table::{show, show_json};
use anyhow::{Context, Result};
use rivet_config::{Robot, Trigger};
use rivet_daemon::{Channels, Core, Incoming, LoopSettings, Outbound, Progress, RealTimeLoop, Snapshots};
use rivet_dynamics::Workspace;
use rivet_ipc_schema::{
    Bus, BusConfig, Health, JointState, LoadLevel, LoopPhase, PHASES, PeriodCause, PrivateBus, RobotName, Setpoint,
    Timing,
};
use rivet_realtime::{Latencies, Overrun, PeriodTimer, RealTimeSettings, Scheduling, Shutdown, now_ns};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::ErrorKind;
use std::path::PathBuf;
use std::process::{Child, Command, ExitCode, Stdio};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

/// Arguments of `rivet bench-loop`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Robot file: the arm, the period, the scheduler.
    #[arg(value_name = "ROBOT.toml")]
    robot: PathBuf,
    /// Length of each measurement [s].
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    seconds: u64,
    /// Processor of both [default: the robot file's, else the last one].
    #[arg(long)]
    cpu: Option<usize>,
    /// Load on the machine during the measurement.
    #[arg(long, value_enum, default_values_t = [Load::Idle, Load::Stress])]
    load: Vec<Load>,
    /// Print the distributions as JSON (docs/operating.md).
    #[arg(long)]
    json: bool,
}

/// What runs beside.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Load {
    /// No additional load.
    Idle,
    /// stress-ng where it is installed, else two busy processes per processor.
    Stress,
}

/// Prints the distributions under each load.
pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let robot = rivet_config::load(&args.robot)?;
    let processors = thread::available_parallelism().map_or(1, usize::from);
    let cpu = args.cpu.or(robot.config.realtime.cpu).unwrap_or(processors - 1);
    let settings = RealTimeSettings {
        scheduling: Some(Scheduling::Fifo(robot.config.realtime.priority.unwrap_or(80))),
        cpu: Some(cpu),
        lock_memory: true,
        required: false,
    };
    let mut all = Vec::new();
    for load in &args.load {
        let stress = Stress::start(*load, processors, args.seconds)?;
        let measured = measure(&robot, &settings, Duration::from_secs(args.seconds))?;
        if args.json {
            all.push(as_json(&stress.what, &measured));
        } else {
            show(&report(&robot, &stress.what, &settings, &measured))?;
        }
    }
    if args.json {
        let period_us = robot.config.sample_period_s * 1e6;
        let (name, scheduling) = (&robot.config.name, settings.scheduling.map(|s| s.to_string()));
        show_json(
            &json!({ "robot": name, "scheduling": scheduling, "cpu": cpu, "period_us": period_us, "measurements": all }),
        )?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Children that keep the processors busy; they end with this.
struct Stress {
    children: Vec<Child>,
    /// What runs beside the measurement, in words.
    what: String,
}

impl Stress {
    fn start(load: Load, processors: usize, seconds: u64) -> Result<Stress> {
        if load == Load::Idle {
            // What others do is theirs, and said.
            let average = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
            let average =
                average.split_whitespace().next().map_or_else(String::new, |one| format!(" (load average {one})"));
            return Ok(Stress { children: Vec::new(), what: format!("no additional load{average}") });
        }
        let quiet = |command: &mut Command| command.stdout(Stdio::null()).stderr(Stdio::null()).spawn();
        let timeout = format!("{}s", seconds + 30);
        let load = format!("--cpu {processors} --vm 1 --vm-bytes 64M --io 1");
        match quiet(Command::new("stress-ng").args(load.split(' ')).args(["--timeout", &timeout])) {
            Ok(child) => return Ok(Stress { children: vec![child], what: format!("stress-ng {load}") }),
            Err(why) if why.kind() == ErrorKind::NotFound => {}
            Err(why) => return Err(why).context("stress-ng cannot be started"),
        }
        // `timeout`, so that none is left over even if this process is killed.
        let busy = || quiet(Command::new("timeout").args([&timeout, "sh", "-c", "while :; do :; done"]));
        let count = 2 * processors;
        let children: std::io::Result<Vec<_>> = (0..count).map(|_| busy()).collect();
        let children = children.context("busy processes cannot be started")?;
        let what = format!("{count} busy processes (stress-ng is not on this machine: apt install stress-ng)");
        Ok(Stress { children, what })
    }
}

impl Drop for Stress {
    fn drop(&mut self) {
        for child in &mut self.children {
            // SIGTERM: stress-ng and timeout then end their own children.
            let pid = rustix::process::Pid::from_child(child);
            let _ = rustix::process::kill_process(pid, rustix::process::Signal::TERM);
            let _ = child.wait();
        }
    }
}

/// What both threads saw.
struct Measured {
    plain: Latencies,
    woken: Latencies,
    /// Own work of a period.
    work: Latencies,
    /// From when a period was due to the end of its work.
    done: Latencies,
    health: Health,
    timing: Timing,
    refused: Vec<String>,
}

fn measure(robot: &Robot, settings: &RealTimeSettings, duration: Duration) -> Result<Measured> {
    let private = PrivateBus::new("bench");
    let name = RobotName::new(&robot.config.name)?;
    let period = Duration::from_secs_f64(robot.config.sample_period_s);
    let shutdown = Shutdown::new();
    // Not real-time, on any processor: the robot.
    let feeder = {
        let (robot, config, name, shutdown) = (robot.clone(), private.config().clone(), name.clone(), shutdown.clone());
        thread::spawn(move || feed(&robot, &config, &name, period, &shutdown))
    };
    // Half a period apart: two threads of one priority do not preempt each other, but one must wait for the other.
    let plain = {
        let settings = settings.clone();
        thread::spawn(move || {
            let granted = rivet_realtime::enter(&settings);
            thread::sleep(period / 2);
            (rivet_realtime::measure_wakeups(period, duration), granted.err())
        })
    };
    let turning = {
        let (robot, config, settings) = (robot.clone(), private.config().clone(), settings.clone());
        thread::spawn(move || turn(&robot, &config, &name, &settings, period, duration))
    };
    let gone = |_| anyhow::anyhow!("a thread of the measurement panicked");
    let (plain, _) = plain.join().map_err(gone)?;
    let turned = turning.join().map_err(gone)?;
    shutdown.request();
    feeder.join().map_err(gone)??;
    let mut measured = turned?;
    measured.plain = plain;
    Ok(measured)
}

/// The daemon's loop, with its messages taken by nobody.
fn turn(
    robot: &Robot,
    config: &BusConfig,
    name: &RobotName,
    realtime: &RealTimeSettings,
    period: Duration,
    duration: Duration,
) -> Result<Measured> {
    let core = Core::new(robot)?;
    let settings = LoopSettings {
        period,
        trigger: Trigger::Timer,
        overrun: Overrun::Skip,
        catch_up: robot.config.realtime.catch_up,
        health_every: robot.config.publish.health_every as u64,
        stale_ns: u64::MAX,
        realtime: realtime.clone(),
    };
    let (outbound, mut inbox) = rtrb::RingBuffer::new(64);
    let (_requests, commands) = rtrb::RingBuffer::new(1);
    let progress = Arc::new(Progress::default());
    let channels =
        Channels { outbound, commands, reload: Incoming::none(), snapshots: Snapshots::none(), progress, flight: None };
    let mut turning = RealTimeLoop::open(core, &settings, config, name, channels)?;
    let (mut woken, mut work, mut done) = (Latencies::default(), Latencies::default(), Latencies::default());
    let (mut health, mut timing) = (Health::default(), Timing::default());
    let granted = rivet_realtime::enter(realtime)?;
    let end = now_ns() + duration.as_nanos() as u64;
    while now_ns() < end {
        let wake = turning.wait();
        let begin = now_ns();
        turning.work(wake);
        let work_ns = now_ns() - begin;
        woken.record(wake.lateness_ns);
        work.record(work_ns);
        done.record(wake.lateness_ns + work_ns);
        while let Ok(message) = inbox.pop() {
            match message {
                Outbound::Health(message) => health = message,
                Outbound::Timing(message) => timing = message,
                Outbound::Parameters(_) | Outbound::Drift(_) => {}
            }
        }
    }
    let refused = granted.refused.iter().map(ToString::to_string).collect();
    Ok(Measured { plain: Latencies::default(), woken, work, done, health, timing, refused })
}

/// A robot that moves all joints on sines, with the torque of the nominal model.
fn feed(robot: &Robot, config: &BusConfig, name: &RobotName, period: Duration, shutdown: &Shutdown) -> Result<()> {
    let bus = Bus::open(config, name, "bench-robot")?;
    let (states, setpoints) = (bus.joint_state_publisher()?, bus.setpoint_publisher()?);
    let (dof, columns) = (robot.dof(), robot.model.len());
    let mut workspace = Workspace::new(&robot.model.arm);
    let mut rows = vec![0.0; dof * columns];
    // Late or not, every sample is sent, with the stamp of when it was due: a robot controller's.
    let mut timer = PeriodTimer::new(period).with_overrun(Overrun::CatchUp);
    let (begin, period_ns) = (now_ns(), period.as_nanos() as u64);
    for seq in 1.. {
        if shutdown.is_requested() {
            break;
        }
        timer.wait();
        let t = seq as f64 * period.as_secs_f64();
        let mut state =
            JointState { seq, stamp_ns: begin + seq * period_ns, joints: dof as u32, ..JointState::default() };
        let mut plan = Setpoint { seq, stamp_ns: state.stamp_ns, joints: dof as u32, ..Setpoint::default() };
        for j in 0..dof {
            let w = 1.0 + 0.6 * j as f64;
            (plan.q[j], plan.qd[j], plan.qdd[j]) =
                (0.3 * (w * t).sin(), 0.3 * w * (w * t).cos(), -0.3 * w * w * (w * t).sin());
        }
        robot.model.regressor(&mut workspace, &plan.q[..dof], &plan.qd[..dof], &plan.qdd[..dof], &mut rows);
        state.q = plan.q;
        for (tau, row) in state.tau.iter_mut().zip(rows.chunks_exact(columns)) {
            *tau = row.iter().zip(&robot.nominal).map(|(y, x)| y * x).sum();
        }
        setpoints.send(&plan)?;
        states.send(&state)?;
    }
    Ok(())
}

/// Counts in bins that double, from the first that has one to the last.
fn distributions(text: &mut String, rows: &[(&str, &Latencies)]) {
    let edges: Vec<u64> = (0..15).map(|k| 1000 << k).collect();
    let bins = |latencies: &Latencies| -> Vec<u64> {
        let reached: Vec<u64> = edges.iter().map(|&edge| latencies.at_least(edge)).collect();
        let mut bins = vec![latencies.total() - reached[0]];
        bins.extend(reached.windows(2).map(|pair| pair[0] - pair[1]));
        bins.push(reached[reached.len() - 1]);
        bins
    };
    let all: Vec<Vec<u64>> = rows.iter().map(|(_, latencies)| bins(latencies)).collect();
    let used = |k: &usize| all.iter().any(|bins| bins[*k] > 0);
    let (Some(first), Some(last)) = ((0..=edges.len()).find(used), (0..=edges.len()).rev().find(used)) else { return };
    let _ = write!(text, "  {:<34}", "periods with less than [us]");
    for k in first..=last {
        let edge = edges.get(k).map_or_else(|| "more".to_owned(), |edge| (edge / 1000).to_string());
        let _ = write!(text, " {edge:>6}");
    }
    text.push('\n');
    for ((label, _), bins) in rows.iter().zip(&all) {
        let _ = write!(text, "  {label:<34}");
        for count in &bins[first..=last] {
            let _ = write!(text, " {count:>6}");
        }
        text.push('\n');
    }
}

fn as_json(load: &str, measured: &Measured) -> Value {
    let Measured { plain, woken, work, done, health, refused, .. } = measured;
    let [plain, woken, work, done] = [plain, woken, work, done].map(latencies_json);
    json!({
        "load": load, "refused": refused, "plain_wake_up": plain, "wake_up": woken, "work": work, "due_to_done": done,
        "samples": health.samples, "lost": health.lost, "overruns": health.overruns, "load_level": health.load_level,
    })
}

fn report(robot: &Robot, what: &str, settings: &RealTimeSettings, measured: &Measured) -> String {
    let mut text = String::new();
    let period_ns = (robot.config.sample_period_s * 1e9) as u64;
    let scheduling = settings.scheduling.map_or_else(String::new, |s| s.to_string());
    let cpu = settings.cpu.unwrap_or(0);
    let _ = writeln!(text, "{}: {scheduling}, processor {cpu}, {} us; {what}", robot.config.name, period_ns / 1000);
    for refused in &measured.refused {
        let _ = writeln!(text, "  without real time: {refused}");
    }
    let _ = writeln!(
        text,
        "  {:<34} {:>8} {:>8} {:>8} {:>8} {:>9} {:>8}",
        "us", "periods", "50 %", "99 %", "99.9 %", "worst", "missed"
    );
    let rows = [
        ("wake-up, as cyclictest measures", &measured.plain),
        ("wake-up of the loop", &measured.woken),
        ("own work of a period", &measured.work),
        ("due to done", &measured.done),
    ];
    for (label, latencies) in rows {
        let q = |p| latencies.quantile_us(p);
        let _ = writeln!(
            text,
            "  {label:<34} {:>8} {:>8.0} {:>8.0} {:>8.0} {:>9.0} {:>8}",
            latencies.total(),
            q(0.5),
            q(0.99),
            q(0.999),
            latencies.max_ns() as f64 * 1e-3,
            latencies.at_least(period_ns)
        );
    }
    distributions(&mut text, &rows);
    let added = [0.5, 0.99, 0.999].map(|p| format!("{:.0}", measured.work.quantile_us(p)));
    let _ = writeln!(
        text,
        "  added by rivet, its own work of a period: {} us at 50, 99 and 99.9 %; the rest is this machine's wake-up",
        added.join(", ")
    );
    let health = &measured.health;
    let level = LoadLevel::try_from(health.load_level).map_or_else(|e| e.to_string(), |level| format!("{level:?}"));
    let _ = writeln!(
        text,
        "  {} samples, {} lost, {} periods left out, load level {level}",
        health.samples, health.lost, health.overruns
    );
    let phases = [
        LoopPhase::Wait,
        LoopPhase::Read,
        LoopPhase::Differentiate,
        LoopPhase::Model,
        LoopPhase::Estimate,
        LoopPhase::Supervise,
        LoopPhase::Publish,
    ];
    let _ = writeln!(text, "  worst periods [us]: cause, then {}", phases.map(|p| format!("{p:?}")).join(", "));
    let timing = &measured.timing;
    for k in 0..(timing.count as usize).min(5) {
        let cause = PeriodCause::try_from(timing.worst_cause[k]).map_or_else(|e| e.to_string(), |c| format!("{c:?}"));
        let split = &timing.worst_phase_ns[k * PHASES..(k + 1) * PHASES];
        let split: Vec<_> = split.iter().map(|ns| format!("{:.0}", f64::from(*ns) * 1e-3)).collect();
        let _ = writeln!(text, "    {cause:<20} {}", split.join(", "));
    }
    text
}
