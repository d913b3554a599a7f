//! The live screen: redrawn in place on a terminal, a line now and then elsewhere.

use super::Acting;
use crate::table::{show_picture, show_to_reader};
use ratatui::crossterm::terminal;
use rivet_analysis::true_values::GROUPS;
use rivet_config::Robot;
use rivet_ipc_schema::Health;
use rivet_realtime::LogHistogram;
use rivet_studies::phase_tracking::Tracking;
use std::fmt::Write as _;
use std::io::{self, IsTerminal};
use std::time::{Duration, Instant};

/// What one look shows.
pub(crate) struct Frame<'a> {
    pub(crate) motion_s: f64,
    pub(crate) total_s: f64,
    /// What the controller computes torques from.
    pub(crate) acting: Acting,
    /// Torque error of each parameter group and of all, once parameters were published and where the true values are those of
    /// this model.
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

/// Columns and rows of a terminal whose size is unknown.
const USUAL_SIZE: (u16, u16) = (80, 24);

/// Columns of the names in front of a row's cells.
const LABEL_WIDTH: usize = 21;

/// Narrowest and widest cell of a joint \[columns\].
const CELL_WIDTH: (usize, usize) = (7, 11);

/// Shortest and longest bar \[columns\].
const BAR_WIDTH: (usize, usize) = (10, 40);

/// Columns of a bar's line without the bar: its name and its two numbers.
const BAR_TEXT_WIDTH: usize = 46;

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

    /// Draws, if it is time for that. A terminal that is gone is no error: the demonstration still has its exit code.
    ///
    /// # Errors
    /// The output cannot be written for another reason, or is a pipe whose reader is gone.
    pub(crate) fn draw_if_due(&mut self, frame: &Frame<'_>) -> io::Result<()> {
        if Instant::now() < self.next {
            return Ok(());
        }
        let pause = if self.terminal { 150 } else { 3000 };
        self.next = Instant::now() + Duration::from_millis(pause);
        if self.first.is_none() {
            self.first.clone_from(&frame.errors);
        }
        let text = if self.terminal { self.fitted(frame, terminal::size().unwrap_or(USUAL_SIZE)) } else { line(frame) };
        if !self.terminal {
            return show_to_reader(&text);
        }
        let redrawn = redrawn(&text, self.lines);
        self.lines = text.lines().count();
        show_picture(&redrawn)
    }

    /// Takes the picture away, so that what follows has the screen.
    ///
    /// # Errors
    /// As of [`draw_if_due`](Self::draw_if_due).
    pub(crate) fn end(&mut self) -> io::Result<()> {
        let up = std::mem::take(&mut self.lines);
        if up > 0 { show_picture(&format!("\x1b[{up}A\x1b[J")) } else { Ok(()) }
    }

    /// The picture in at most `columns` by `rows`: a line that wraps would not be drawn over by the next picture.
    fn fitted(&self, frame: &Frame<'_>, (columns, rows): (u16, u16)) -> String {
        // A terminal wraps, or waits with it, when the last column is filled; the cursor stands below the last row.
        let (columns, rows) = (usize::from(columns).max(2) - 1, usize::from(rows).max(2) - 1);
        let mut text = String::new();
        for line in self.draw(frame, columns).lines().take(rows) {
            text.extend(rivet_files::printable(line).chars().take(columns));
            text.push('\n');
        }
        text
    }

    fn draw(&self, frame: &Frame<'_>, columns: usize) -> String {
        let mut out = Vec::new();
        out.push(format!("rivet demo · {} · {:4.1} of {:.0} s of motion", self.robot, frame.motion_s, frame.total_s));
        out.push(format!("the controller uses the {} model", frame.acting.name()));
        out.push(String::new());
        if frame.acting != Acting::Patched {
            self.draw_errors(frame, columns, &mut out);
        }
        self.draw_joints(frame, columns, &mut out);
        out.push(frame.health.map_or_else(|| "waiting for rivetd".to_owned(), timing));
        let mut text = out.join("\n");
        text.push('\n');
        text
    }

    /// A bar for each group of parameters.
    fn draw_errors(&self, frame: &Frame<'_>, columns: usize, out: &mut Vec<String>) {
        out.push("torque error caused by wrong parameters [% of the torque limits]".to_owned());
        let bar_width = columns.saturating_sub(BAR_TEXT_WIDTH).clamp(BAR_WIDTH.0, BAR_WIDTH.1);
        match (&frame.errors, &self.first) {
            (Some(errors), Some(first)) => {
                for (g, (_, name)) in GROUPS.iter().enumerate().filter(|(g, _)| first[*g] > 0.0) {
                    out.push(bar(name, errors[g], first[g], bar_width));
                }
                let all = errors.len() - 1;
                out.push(bar("all together", errors[all], first[all], bar_width));
            }
            _ => out.push("  waiting for the first parameter set".to_owned()),
        }
        out.push(String::new());
    }

    /// Residual and tracking error of each joint.
    fn draw_joints(&self, frame: &Frame<'_>, columns: usize, out: &mut Vec<String>) {
        let cell_width = columns.saturating_sub(LABEL_WIDTH) / self.joints.len().max(1);
        let cell_width = cell_width.clamp(CELL_WIDTH.0, CELL_WIDTH.1);
        // One column stays free between two names.
        let mut names: Vec<String> =
            self.joints.iter().map(|joint| joint.chars().take(cell_width - 1).collect()).collect();
        if names.iter().enumerate().any(|(j, name)| names[..j].contains(name)) {
            names = (1..=names.len()).map(|j| format!("joint {j}")).collect();
        }
        out.push(format!("{:<LABEL_WIDTH$}{}", "", cells(names.into_iter(), cell_width)));
        if let Some(health) = frame.health {
            let row = |what: &str, values: &[f64]| {
                let cells = cells(values[..self.joints.len()].iter().map(|v| format!("{v:.3}")), cell_width);
                format!("{what:<LABEL_WIDTH$}{cells}")
            };
            out.push(row("residual nominal [Nm]", &health.nominal_residual_rms));
            out.push(row("residual now     [Nm]", &health.residual_rms));
        }
        let errors = (0..self.joints.len()).map(|j| mrad(frame.tracking.now.rms(j)));
        out.push(format!("{:<LABEL_WIDTH$}{}", "tracking error [mrad]", cells(errors, cell_width)));
        out.push(String::new());
    }
}

/// `text` over the picture of `lines` lines above the cursor. Each line is erased as it is written, and the rest at the end:
/// erasing all from the first line on makes some terminals keep every picture in their history.
fn redrawn(text: &str, lines: usize) -> String {
    let up = if lines > 0 { format!("\x1b[{lines}A") } else { String::new() };
    format!("{up}{}\x1b[J", text.replace('\n', "\x1b[K\n"))
}

/// Milliradians of an angle \[rad\]; a dash before the first sample.
fn mrad(angle: f64) -> String {
    if angle.is_nan() { "-".to_owned() } else { format!("{:.3}", 1e3 * angle) }
}

/// One right-aligned cell a joint.
fn cells(values: impl Iterator<Item = String>, width: usize) -> String {
    let mut line = String::new();
    for value in values {
        // Writing to a string cannot fail.
        let _ = write!(line, "{value:>width$}");
    }
    line
}

fn bar(name: &str, now: f64, first: f64, width: usize) -> String {
    let share = (now / first).clamp(0.0, 1.0);
    let full = (share * width as f64).round() as usize;
    format!("  {name:<18} {}{} {now:7.3}  (was {first:.3})", "█".repeat(full), "·".repeat(width - full))
}

fn timing(health: &Health) -> String {
    let micro = |ns: u64| ns as f64 / 1e3;
    let wake = LogHistogram::from_counts(health.wake_histogram, health.worst_wake_ns);
    let work = LogHistogram::from_counts(health.work_histogram, health.worst_work_ns);
    format!(
        "rivetd: {} samples, {} lost · {} of {} directions active\n\
         work per period p50 {:.0} us, p99 {:.0} us, worst {:.0} us\n\
         wake-up late p50 {:.0} us, p99 {:.0} us",
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
    let all = match (all, frame.acting) {
        (Some(error), _) => format!("parameter error {error:.3} % of limits"),
        (None, Acting::Patched) => "model with the effects found".to_owned(),
        (None, _) => "no parameters yet".to_owned(),
    };
    let tracking = mrad(frame.tracking.now.rms_all(frame.tracking.dof));
    format!("{:5.1} s  {:<10}  {all}  tracking {tracking} mrad rms\n", frame.motion_s, frame.acting.name())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A line that wraps leaves its rest behind when the next picture is drawn over it, and so floods the terminal.
    #[test]
    fn picture_fits_the_terminal() {
        let folder = tempfile::tempdir().expect("a folder");
        let robot = crate::demo::unpack(folder.path()).expect("the built-in robot");
        let robot = rivet_config::load(&robot).expect("it is sound");
        let screen = Screen { first: Some(vec![1.0; GROUPS.len() + 1]), ..Screen::new(&robot) };
        let (health, tracking) = (Health::default(), Tracking::new(6, vec![0..10, 10..20]));
        let errors = Some(vec![100.0; GROUPS.len() + 1]);
        let frame = Frame {
            motion_s: 1.0,
            total_s: 24.0,
            acting: Acting::RobotFile,
            errors,
            health: Some(&health),
            tracking: &tracking,
        };
        for (columns, rows) in [(80, 24), (100, 30), (60, 24), (40, 10), (1, 1)] {
            let text = screen.fitted(&frame, (columns, rows));
            let widest = text.lines().map(|line| line.chars().count()).max().unwrap_or(0);
            assert!(widest < usize::from(columns).max(2), "{columns} columns:\n{text}");
            assert!(text.lines().count() < usize::from(rows).max(2), "{rows} rows:\n{text}");
        }
        // Only the rest below the last line is erased as a whole.
        let again = redrawn(&screen.fitted(&frame, USUAL_SIZE), 5);
        assert!(again.starts_with("\x1b[5A") && again.find("\x1b[J") == Some(again.len() - 3), "{again:?}");
        // Nothing is cut off on the usual terminal.
        let usual = screen.fitted(&frame, USUAL_SIZE);
        assert_eq!(usual.trim_end(), screen.draw(&frame, usize::from(USUAL_SIZE.0) - 1).trim_end());
        assert!(usual.contains("wake-up late"), "{usual}");
    }
}
