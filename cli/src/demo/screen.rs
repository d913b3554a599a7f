//! The live screen: redrawn in place on a terminal, a line now and then elsewhere.

use super::reference::GROUPS;
use super::tracking::Tracking;
use rivet_config::Robot;
use rivet_ipc_schema::Health;
use rivet_realtime::LogHistogram;
use std::fmt::Write as _;
use std::io::{IsTerminal, Write as _};
use std::time::{Duration, Instant};

/// What one look shows.
pub(crate) struct Frame<'a> {
    pub(crate) motion_s: f64,
    pub(crate) total_s: f64,
    /// Whether identified parameters act.
    pub(crate) identified: bool,
    /// Torque error of each parameter group and of all, once parameters were published.
    pub(crate) errors: Option<Vec<f64>>,
    pub(crate) health: Option<&'a Health>,
    pub(crate) tracking: &'a Tracking,
}

pub(crate) struct Screen {
    robot: String,
    joints: Vec<String>,
    /// Torque error of the groups in the first published set: what the bars are drawn against.
    first: Option<Vec<f64>>,
    terminal: bool,
    lines: usize,
    next: Instant,
}

const WIDTH: usize = 40;

impl Screen {
    pub(crate) fn new(robot: &Robot) -> Screen {
        Screen {
            robot: robot.config.name.clone(),
            joints: robot.model.arm.joints.iter().map(|joint| joint.name.clone()).collect(),
            first: None,
            terminal: std::io::stdout().is_terminal(),
            lines: 0,
            next: Instant::now(),
        }
    }

    pub(crate) fn show(&mut self, frame: &Frame<'_>) {
        if Instant::now() < self.next {
            return;
        }
        let pause = if self.terminal { 150 } else { 3000 };
        self.next = Instant::now() + Duration::from_millis(pause);
        if self.first.is_none() {
            self.first.clone_from(&frame.errors);
        }
        let text = if self.terminal { self.draw(frame) } else { line(frame) };
        let up = if self.lines > 0 { format!("\x1b[{}A\x1b[J", self.lines) } else { String::new() };
        self.lines = if self.terminal { text.lines().count() } else { 0 };
        print!("{up}{text}");
        // A terminal that is gone does not stop the demonstration's exit code from being made.
        let _ = std::io::stdout().flush();
    }

    pub(crate) fn end(&mut self) {
        if self.lines > 0 {
            println!();
        }
        self.lines = 0;
    }

    fn draw(&self, frame: &Frame<'_>) -> String {
        let mut out = Vec::new();
        let phase = if frame.identified { "IDENTIFIED parameters" } else { "NOMINAL parameters (the daemon listens)" };
        out.push(format!(
            "rivet demo · {} · {:4.1} of {:.0} s of motion · the controller uses {phase}",
            self.robot, frame.motion_s, frame.total_s
        ));
        out.push(String::new());
        out.push("torque error caused by wrong parameters [% of the torque limits]".to_owned());
        match (&frame.errors, &self.first) {
            (Some(errors), Some(first)) => {
                for (g, (_, name)) in GROUPS.iter().enumerate().filter(|(g, _)| first[*g] > 0.0) {
                    out.push(bar(name, errors[g], first[g]));
                }
                let all = errors.len() - 1;
                out.push(bar("all together", errors[all], first[all]));
            }
            _ => out.push("  waiting for the first parameter set".to_owned()),
        }
        out.push(String::new());
        out.push(format!("{:<22}{}", "", cells(self.joints.iter().map(|joint| shorten(joint)))));
        if let Some(health) = frame.health {
            let row = |what: &str, values: &[f64]| {
                let cells = cells(values[..self.joints.len()].iter().map(|v| format!("{v:.3}")));
                format!("{what:<22}{cells}")
            };
            out.push(row("residual nominal [Nm]", &health.nominal_residual_rms));
            out.push(row("residual now     [Nm]", &health.residual_rms));
        }
        let tracking: String = cells((0..self.joints.len()).map(|j| format!("{:.3}", 1e3 * frame.tracking.now.rms(j))));
        out.push(format!("{:<22}{tracking}", "tracking error [mrad]"));
        out.push(String::new());
        out.push(frame.health.map_or_else(|| "waiting for rivetd".to_owned(), timing));
        let mut text = out.join("\n");
        text.push('\n');
        text
    }
}

/// One right-aligned cell a joint.
fn cells(values: impl Iterator<Item = String>) -> String {
    let mut line = String::new();
    for value in values {
        // Writing to a string cannot fail.
        let _ = write!(line, "{value:>11}");
    }
    line
}

fn shorten(joint: &str) -> String {
    joint.chars().take(10).collect()
}

fn bar(name: &str, now: f64, first: f64) -> String {
    let share = (now / first).clamp(0.0, 1.0);
    let full = (share * WIDTH as f64).round() as usize;
    format!("  {name:<16} {}{} {now:7.3}  (was {first:.3})", "█".repeat(full), "·".repeat(WIDTH - full))
}

fn timing(health: &Health) -> String {
    let micro = |ns: u64| ns as f64 / 1e3;
    let wake = LogHistogram::from_counts(health.wake_histogram, health.worst_wake_ns);
    let work = LogHistogram::from_counts(health.work_histogram, health.worst_work_ns);
    format!(
        "rivetd: {} samples, {} lost · {} of {} directions active\n\
         work per period p50 {:.0} us, p99 {:.0} us, worst {:.0} us · wake-up late p50 {:.0} us, p99 {:.0} us",
        health.samples,
        health.lost,
        health.active,
        health.active + health.held,
        micro(work.quantile(0.5)),
        micro(work.quantile(0.99)),
        micro(work.max()),
        micro(wake.quantile(0.5)),
        micro(wake.quantile(0.99)),
    )
}

fn line(frame: &Frame<'_>) -> String {
    let all = frame.errors.as_ref().and_then(|errors| errors.last().copied());
    let all =
        all.map_or_else(|| "no parameters yet".to_owned(), |e| format!("parameter error {e:.3} % of torque limits"));
    let tracking = 1e3 * frame.tracking.now.rms_all(frame.tracking.dof);
    let phase = if frame.identified { "identified" } else { "nominal" };
    format!("{:5.1} s  {phase:<10}  {all}  tracking error {tracking:.3} mrad rms\n", frame.motion_s)
}
