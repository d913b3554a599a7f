//! `rivet doctor`: is this machine fit for real time, and what to change.

mod bus;

use crate::table::{paragraph, show, show_json};
use anyhow::Result;
use rivet_config::Robot;
use rivet_realtime::{Finding, Latencies, Machine, RealTimeSettings, Scheduling, Severity};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

/// Shared memory that the processes of one robot need, with some to spare \[bytes\].
const SHARED_MEMORY: u64 = 48 << 20;
/// Share of a period that all but one wake-up in a thousand must keep, and of wake-ups that may miss a whole period.
const LATE_SHARE: f64 = 0.2;
const MISSED_SHARE: f64 = 1e-3;

/// Arguments of `rivet doctor`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Robot file: its period, scheduler, processor and bus count; without it 1 ms, SCHED_FIFO 80, any processor, the default
    /// bus.
    #[arg(value_name = "ROBOT.toml")]
    robot: Option<PathBuf>,
    /// Duration of the wake-up measurement [s]; 0 skips it.
    #[arg(long, default_value_t = 5.0, value_parser = crate::number::seconds)]
    seconds: f64,
    /// Processor to check, instead of the robot file's.
    #[arg(long)]
    cpu: Option<usize>,
    /// Overrides `[bus] prefix`.
    #[arg(long)]
    prefix: Option<String>,
    /// Overrides `[bus] root`.
    #[arg(long)]
    root: Option<PathBuf>,
    /// First free what dead processes left on the bus. If no process uses the bus, remove all its files.
    #[arg(long)]
    clean: bool,
    /// Print the findings as JSON.
    #[arg(long)]
    json: bool,
}

/// Prints every finding with the line to change. Exit code 0: nothing worse than a note; 1: a warning; 2: a failure.
pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let robot = args.robot.as_ref().map(rivet_config::load).transpose()?;
    let period_s = robot.as_ref().map_or(1e-3, |robot| robot.config.sample_period_s);
    let wish = wish(robot.as_ref(), args.cpu);
    let mut findings = Machine::default().findings(&wish);
    findings.push(shared_memory());
    findings.extend(bus::findings(robot.as_ref(), args));
    let granted = grant(&wish);
    let allowed = granted.severity < Severity::Failure;
    findings.push(granted);
    let measured = (args.seconds > 0.0).then(|| {
        let (period, duration) = (Duration::from_secs_f64(period_s), Duration::from_secs_f64(args.seconds));
        // With what is granted: a refusal is a finding of its own.
        in_thread(move || {
            let _granted = rivet_realtime::enter(&RealTimeSettings { required: false, ..wish });
            rivet_realtime::measure_wakeups(period, duration)
        })
    });
    if let Some(latencies) = &measured {
        findings.push(judge(latencies, period_s, allowed));
    }
    let worst = findings.iter().map(|finding| finding.severity).max().unwrap_or(Severity::Ok);
    if args.json {
        show_json(&as_json(&findings, measured.as_ref(), worst))?;
    } else {
        show(&as_text(&findings, worst))?;
    }
    Ok(ExitCode::from(match worst {
        Severity::Ok | Severity::Note => 0,
        Severity::Warning => 1,
        Severity::Failure => 2,
    }))
}

fn wish(robot: Option<&Robot>, cpu: Option<usize>) -> RealTimeSettings {
    let settings = robot.map(|robot| (&robot.config.realtime, robot.config.sample_period_s));
    RealTimeSettings {
        scheduling: settings
            .map_or(Some(Scheduling::Fifo(80)), |(realtime, period)| rivet_daemon::shell::scheduling(realtime, period)),
        cpu: cpu.or_else(|| settings.and_then(|(realtime, _)| realtime.cpu)),
        lock_memory: settings.is_none_or(|(realtime, _)| realtime.lock_memory),
        required: true,
    }
}

/// Priority and processor stay with the thread.
fn in_thread<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> T {
    let thread = std::thread::spawn(work);
    thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

/// Whether the kernel grants what the daemon will ask for.
fn grant(wish: &RealTimeSettings) -> Finding {
    let check = "real time";
    let wish = wish.clone();
    match in_thread(move || rivet_realtime::enter(&wish)) {
        Ok(granted) => {
            let scheduling = granted.scheduling.map_or_else(|| "time-sharing, as asked".to_owned(), |s| s.to_string());
            let memory = if granted.memory_locked { ", memory locked" } else { "" };
            Finding::fine(check, Severity::Ok, format!("granted: {scheduling}{memory}"))
        }
        Err(why) => {
            let found = format!("refused: {why}");
            Finding::change(check, Severity::Failure, found, "as above; or, without real time: rivetd --best-effort")
        }
    }
}

fn shared_memory() -> Finding {
    let check = "/dev/shm";
    match rustix::fs::statvfs("/dev/shm") {
        Ok(file_system) => {
            let free = file_system.f_bavail.saturating_mul(file_system.f_frsize);
            if free >= SHARED_MEMORY {
                return Finding::fine(check, Severity::Ok, format!("{} MiB free", free >> 20));
            }
            Finding::change(
                check,
                Severity::Failure,
                format!("{} MiB free, {} are needed for a robot", free >> 20, SHARED_MEMORY >> 20),
                "mount -o remount,size=256M /dev/shm   # permanently: the size= of /dev/shm in /etc/fstab",
            )
        }
        Err(why) => Finding::change(check, Severity::Failure, why.to_string(), "mount -t tmpfs tmpfs /dev/shm"),
    }
}

fn judge(latencies: &Latencies, period_s: f64, real_time: bool) -> Finding {
    let period_us = period_s * 1e6;
    let (p50, p999) = (latencies.quantile_us(0.5), latencies.quantile_us(0.999));
    let needed = LATE_SHARE * period_us;
    let missed = latencies.at_least((period_s * 1e9) as u64);
    let found = format!(
        "{} wake-ups, late by 50 % {p50:.0}, 99 % {:.0}, 99.9 % {p999:.0}, worst {:.0} us; needed: 99.9 % within \
         {needed:.0} us ({:.0} % of the period), and a whole period missed by at most one in {:.0}: {missed} were",
        latencies.total(),
        latencies.quantile_us(0.99),
        latencies.max_ns() as f64 * 1e-3,
        LATE_SHARE * 100.0,
        1.0 / MISSED_SHARE,
    );
    let check = "wake-up latency";
    let change = if real_time { "the warnings above, from the top" } else { "the failures above, from the top" };
    if missed as f64 > MISSED_SHARE * latencies.total() as f64 {
        Finding::change(check, Severity::Failure, found, change)
    } else if p999 > needed {
        Finding::change(check, Severity::Warning, found, change)
    } else {
        Finding::fine(check, Severity::Ok, found)
    }
}

fn as_text(findings: &[Finding], worst: Severity) -> String {
    let mut text = String::new();
    for finding in findings {
        text += &paragraph(&format!("{:<8} {:<20} ", finding.severity, finding.check), &finding.found);
        if let Some(change) = &finding.change {
            text += &paragraph(&format!("{:29} -> ", ""), change);
        }
    }
    let count = |severity| findings.iter().filter(|finding| finding.severity == severity).count();
    let _ = writeln!(
        text,
        "\n{}: {} failures, {} warnings",
        match worst {
            Severity::Ok | Severity::Note => "fit for real time",
            Severity::Warning => "real time with late wake-ups",
            Severity::Failure => "not fit for real time",
        },
        count(Severity::Failure),
        count(Severity::Warning)
    );
    text
}

fn as_json(findings: &[Finding], measured: Option<&Latencies>, worst: Severity) -> Value {
    let list: Vec<_> = findings
        .iter()
        .map(|finding| {
            json!({
                "check": finding.check, "severity": finding.severity.to_string(), "found": finding.found,
                "change": finding.change,
            })
        })
        .collect();
    json!({ "severity": worst.to_string(), "findings": list, "wake_ups": measured.map(latencies_json) })
}

/// How many latencies there are, three quantiles and the largest.
pub(crate) fn latencies_json(latencies: &Latencies) -> Value {
    json!({
        "count": latencies.total(), "p50_us": latencies.quantile_us(0.5), "p99_us": latencies.quantile_us(0.99),
        "p999_us": latencies.quantile_us(0.999), "max_us": latencies.max_ns() as f64 * 1e-3,
    })
}
