//! `rivet record`: what robot, rivetd and rivet-controller publish, as an MCAP file.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use rivet_analysis::fault::Fault;
use rivet_files::StatusLine;
use rivet_ipc_schema::{Bus, RobotName};
use rivet_realtime::{Shutdown, now_ns};
use rivet_recording::{About, Content, Counts, Derived, Ports, Received, Recorder, RecordingFile};
use serde_json::json;

use crate::control::OnBus;
use crate::table::{Table, number, show, show_json};

/// Time between two looks at the bus: its rings hold a thousand samples.
const TURN: Duration = Duration::from_millis(5);
/// Time between two counts in the recording, and between two pictures of the status line.
const BETWEEN_COUNTS: Duration = Duration::from_secs(1);

/// Arguments of `rivet record`.
#[derive(clap::Args)]
#[command(after_help = "Ctrl-C ends the recording. A second of messages is lost at most where the process is killed.")]
pub(crate) struct Args {
    #[command(flatten)]
    bus: OnBus,
    /// File to make; there must be none of that name.
    #[arg(value_name = "OUT.mcap")]
    out: PathBuf,
    /// End after so many seconds of joint states.
    #[arg(long, value_name = "S", value_parser = more_than_none)]
    seconds: Option<f64>,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

/// A duration above 0 and of at most a day \[s\].
fn more_than_none(text: &str) -> Result<f64, String> {
    crate::number::seconds(text)
        .and_then(|seconds| if seconds > 0.0 { Ok(seconds) } else { Err("it must be more than 0".to_owned()) })
}

pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let is_mcap = |path: &Path| path.extension().is_some_and(|ext| ext.eq_ignore_ascii_case("mcap"));
    if is_mcap(&args.bus.robot) && !is_mcap(&args.out) {
        let why = format!("{}: the robot file comes first: rivet record ROBOT.toml OUT.mcap", args.bus.robot.display());
        return Err(Fault::Usage(why).into());
    }
    if !is_mcap(&args.out) {
        let why = "a recording is MCAP: give a name that ends with .mcap; rivet convert makes other formats of it";
        return Err(Fault::Usage(format!("{}: {why}", args.out.display())).into());
    }
    let robot = rivet_config::load(&args.bus.robot)?;
    let bus = Bus::open(&args.bus.config(&robot.config.bus), &RobotName::new(&robot.config.name)?, "rivet-record")?;
    let mut ports = Ports::open(&bus)?;
    let shutdown = Shutdown::on_signals()?;
    let about = About::new(&robot, now_ns());
    let mut derived = Derived::new(&robot, about.to_utc_ns)?;
    let mut recorder = Recorder::start(RecordingFile::create(&args.out, &about)?);
    let mut line = StatusLine::new(!args.json);
    // Of the joint states: stamps of the first and the last \[ns\].
    let mut span: Option<(u64, u64)> = None;
    let seconds = |span: Option<(u64, u64)>| span.map_or(0.0, |(first, last)| last.saturating_sub(first) as f64 * 1e-9);
    let mut counted = Instant::now();
    line.draw(&status(&robot.config.name, 0.0, &recorder.counts(now_ns(), 0)));
    let mut taken = Ok(());
    while !shutdown.is_requested() && !recorder.has_failed() && args.seconds.is_none_or(|most| seconds(span) < most) {
        taken = ports.take(now_ns(), &mut |received: Received| {
            if let Content::JointState(state) = &received.content {
                span = Some((span.map_or(state.stamp_ns, |(first, _)| first), state.stamp_ns));
            }
            derived.take(&received, &mut |follows| recorder.take(follows));
            recorder.take(received);
        });
        if taken.is_err() {
            break;
        }
        derived.turn(now_ns(), &mut |follows| recorder.take(follows));
        if counted.elapsed() >= BETWEEN_COUNTS {
            counted = Instant::now();
            let counts = recorder.counts(now_ns(), ports.foreign());
            line.draw(&status(&robot.config.name, seconds(span), &counts));
            recorder.take(Received::derived(counts.stamp_ns, counts.into()));
        }
        std::thread::sleep(TURN);
    }
    let counts = recorder.counts(now_ns(), ports.foreign());
    line.remove();
    recorder.finish(counts.clone())?;
    taken?;
    let bytes = std::fs::metadata(&args.out).map_or(0, |file| file.len());
    if args.json {
        let value = json!({"file": args.out.display().to_string(), "seconds": seconds(span), "bytes": bytes,
                           "foreign": counts.foreign, "services": counts.services});
        show_json(&value)?;
    } else {
        show(&report(args, seconds(span), bytes, &counts))?;
    }
    if span.is_none() {
        bail!("no joint state of {} came on this bus; the recording has what else there was", robot.config.name);
    }
    Ok(ExitCode::SUCCESS)
}

/// Length, size, and what was recorded of each service.
fn report(args: &Args, seconds: f64, bytes: u64, counts: &Counts) -> String {
    let mut table = Table::new(["service", "messages", "missing", "dropped"]);
    for service in &counts.services {
        let numbers = [service.messages, service.missing, service.dropped].map(|count| count.to_string());
        table.row(std::iter::once(service.service.clone()).chain(numbers));
    }
    let megabytes = number(bytes as f64 * 1e-6, 3);
    let mut out = format!("{}: {} s, {megabytes} MB\n", args.out.display(), number(seconds, 4));
    out += &table.text();
    if counts.foreign > 0 {
        out.push_str(&counts.foreign.to_string());
        out.push_str(" messages of a second publisher are left out\n");
    }
    out
}

/// What the status line shows.
fn status(robot: &str, seconds: f64, counts: &Counts) -> String {
    match counts.of_service("joint-state").map_or(0, |counts| counts.messages) {
        0 => format!("waiting for joint states of {robot}; Ctrl-C ends"),
        states => format!("{seconds:.0} s, {states} joint states, {} lost; Ctrl-C ends", counts.lost()),
    }
}
