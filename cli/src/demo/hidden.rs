//! An effect that the true arm has and the robot file lacks, and what `rivet diagnose` makes of the recorded run.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use rivet_config::Robot;
use rivet_realtime::Shutdown;
use rivet_report::words::{effect, percent};
use rivet_report::{Cause, Document, is_value};
use rivet_simulation::process::Options;
use rivet_studies::hidden_effect::HiddenEffect;
use serde_json::{Value, json};

use crate::table::paragraph_within;
use rivet_analysis::fault::Fault;
use rivet_analysis::progress::DiagnosisProgress;

use super::{Files, output_file};

/// Columns of the smallest usual terminal.
const COLUMNS: usize = 80;
/// A diagnosis of this run takes some seconds; beyond this the machine is too slow or something hangs.
const LONGEST: Duration = Duration::from_secs(120);
/// Whether the true arm differs from the robot file in this: in a value that the file has, or by the payload.
fn differs(name: &str) -> bool {
    is_value(name) || name == "payload"
}

/// The effect in the true arm.
pub(crate) struct Hidden(HiddenEffect);

impl Hidden {
    /// Draws one that the robot file does not have and that the run will show.
    pub(crate) fn draw(robot: &Robot, file: &Path, seed: u64) -> Result<Hidden> {
        let motion = Options { seed: Some(seed), ..Options::new(file) }.trajectory(robot)?;
        HiddenEffect::draw(robot, &*motion, seed).map(Hidden).map_err(anyhow::Error::msg)
    }

    /// Writes the robot file of the true arm into `folder`.
    pub(crate) fn robot_file(&self, robot: &Robot, file: &Path, folder: &Path) -> Result<PathBuf> {
        let text = std::fs::read_to_string(file).with_context(|| file.display().to_string())?;
        let text = self.0.robot_file(robot, &text).map_err(anyhow::Error::msg)?;
        let path = folder.join("true-robot.toml");
        rivet_files::write_whole(&path, &text).with_context(|| path.display().to_string())?;
        Ok(path)
    }

    /// Whether a cause is this effect, or its class holds it, on this joint.
    fn is(&self, cause: &Cause) -> bool {
        let named =
            cause.effect == self.0.effect() || cause.indistinguishable_from.iter().any(|e| e == self.0.effect());
        named && (cause.joints.is_empty() || cause.joints.iter().any(|joint| joint == self.0.joint()))
    }

    /// Whether the diagnosis named the effect or put it into a class.
    pub(crate) fn is_found(&self, found: &Document) -> bool {
        found.causes.iter().any(|cause| self.is(cause))
    }

    /// What was hidden and what was named, as JSON.
    pub(crate) fn to_json(&self, found: &Document) -> Value {
        let causes = found.causes.iter().map(|cause| json!({ "effect": cause.effect, "joints": cause.joints }));
        json!({
            "effect": self.0.effect(), "joint": self.0.joint(), "size": self.0.size(), "is_named": self.is_found(found),
            "verdict": found.verdict, "causes": causes.collect::<Vec<_>>(),
        })
    }

    /// What was hidden and what was named.
    pub(crate) fn text(&self, found: &Document) -> String {
        let mut out = paragraph_within(
            COLUMNS,
            "  hidden       ",
            &format!("{} of {}: {}", effect(self.0.effect()), self.0.joint(), self.0.size()),
        );
        // On one screen of 24 rows there is no room for how often such names were right.
        let (actions, causes) = (found.actions(&[]), &found.causes);
        match causes.iter().zip(&actions).find(|(cause, _)| self.is(cause)) {
            Some((cause, action)) => {
                out += &paragraph_within(COLUMNS, "  named        ", action);
                let (predicted, measured) = (percent(cause.shrink.predicted), percent(cause.shrink.measured));
                out += &paragraph_within(
                    COLUMNS,
                    "  gap          ",
                    &format!("{predicted} % smaller with it predicted, {measured} % measured"),
                );
            }
            None => {
                out += &paragraph_within(COLUMNS, "  named        ", &format!("not found: verdict {}", found.verdict));
            }
        }
        let others = |is_true: bool| -> Vec<String> {
            let others = causes.iter().filter(|cause| !self.is(cause) && differs(&cause.effect) == is_true);
            others.map(|cause| effect(&cause.effect)).collect()
        };
        // What the file has wrong beside the hidden effect, then what it has right.
        for (is_true, head) in [(true, "  also wrong   "), (false, "  false name   ")] {
            let others = others(is_true);
            if !others.is_empty() {
                out += &paragraph_within(COLUMNS, head, &others.join(", "));
            }
        }
        if let Some(result) = found.result_line() {
            out += &paragraph_within(COLUMNS, "  result       ", &result);
        }
        let _ = write!(out, "hidden effect: {}", if self.is_found(found) { "named" } else { "NOT named" });
        out
    }
}

/// `rivet diagnose` of the recorded run, as a user would call it.
pub(super) fn diagnose(files: &Files, shutdown: &Shutdown) -> Result<Document> {
    // A file takes everything the child may write; a pipe that nobody empties would hold it up.
    let messages = files.folder.join("diagnose.log");
    let program = std::env::current_exe().context("cannot find this program's own file")?;
    let mut command = Command::new(program);
    command.arg("diagnose").args([&files.robot, &files.log]).arg("--json").arg(&files.verdict);
    // What it considers tells how far it is.
    command.arg("--export").arg(&files.patched).arg("--verbose");
    let mut child = command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(output_file(&messages)?)
        .spawn()
        .context("cannot start rivet diagnose")?;
    let mut progress = DiagnosisProgress::new("diagnosis");
    let mut lines = 0;
    let begin = Instant::now();
    let ended = loop {
        if let Some(status) = child.try_wait().context("rivet diagnose")? {
            break Ok(status);
        }
        if shutdown.is_requested() {
            break Err(Fault::Interrupted.into());
        }
        if begin.elapsed() > LONGEST {
            break Err(anyhow::anyhow!("no diagnosis after {} s: this machine is too busy", LONGEST.as_secs()));
        }
        let said = std::fs::read_to_string(&messages).unwrap_or_default();
        said.lines().skip(lines).for_each(|line| progress.say(line));
        lines = said.lines().count();
        progress.draw();
        std::thread::sleep(Duration::from_millis(100));
    };
    progress.done();
    let status = match ended {
        Ok(status) => status,
        Err(why) => {
            // Both fail only for a child that has ended.
            let _ = child.kill();
            let _ = child.wait();
            return Err(why);
        }
    };
    let Ok(text) = std::fs::read_to_string(&files.verdict) else {
        let output = std::fs::read_to_string(&messages).unwrap_or_default();
        let last = output.lines().last().unwrap_or_default();
        bail!("rivet diagnose ended without a verdict ({status}): {last}");
    };
    serde_json::from_str(&text).context("the verdict of rivet diagnose")
}
