//! An effect that the true arm has and the robot file lacks, and what `rivet diagnose` makes of the recorded run.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use rivet_config::Robot;
use rivet_diagnosis::Effect;
use rivet_dynamics::JointKind;
use rivet_realtime::Shutdown;
use rivet_report::words::{effect, percent};
use rivet_report::{Cause, Document};
use rivet_simulation::Random;

use crate::table::paragraph_within;
use rivet_analysis::fault::Fault;
use rivet_analysis::progress::Progress;

use super::{Files, output_file};

/// Columns of the smallest usual terminal.
const COLUMNS: usize = 80;
/// Stream of the seed that draws effect, joint and size.
const STREAM: u64 = 0x61;
/// Sizes go by the joint's Coulomb friction; by this share of the drive's limit where the robot file has none.
const FRICTION_SHARE: f64 = 0.05;
/// Share of the speed limit at which friction that is not linear in speed has its size.
const SPEED_SHARE: f64 = 0.5;
/// A diagnosis of this run takes some seconds; beyond this the machine is too slow or something hangs.
const LONGEST: Duration = Duration::from_secs(120);
/// Time that it takes on a usual machine \[s\], for the progress line.
const USUAL_S: f64 = 8.0;

/// What can be hidden: name of the contract, keys with their sizes, and the words for them.
struct Kind {
    effect: &'static str,
    /// Keys of robot.toml with values, from the joint's scale of torque \[N·m\] and its speed limit \[rad/s\].
    values: fn(f64, f64) -> Vec<(&'static str, f64)>,
    /// Size in parts of the scale, from and to.
    size: (f64, f64),
    words: fn(f64, f64) -> String,
}

const KINDS: [Kind; 4] = [
    Kind {
        effect: "joint_spring",
        values: |torque, _| vec![("stiffness", torque)],
        size: (1.0, 2.0),
        words: |torque, _| format!("{torque:.3} N m/rad"),
    },
    Kind {
        effect: "stribeck_friction",
        values: |torque, speed| vec![("excess", torque), ("velocity", 0.05 * speed)],
        size: (0.5, 1.0),
        words: |torque, speed| format!("{torque:.3} N m more at standstill, falling within {:.3} rad/s", 0.05 * speed),
    },
    Kind {
        effect: "viscous_nonlinearity",
        values: |torque, speed| vec![("quadratic", torque / (SPEED_SHARE * speed).powi(2))],
        size: (0.5, 1.0),
        words: |torque, speed| format!("{torque:.3} N m at {:.3} rad/s", SPEED_SHARE * speed),
    },
    Kind {
        effect: "position_dependent_friction",
        values: |torque, _| vec![("cosine", torque), ("order", 1.0)],
        size: (0.4, 0.8),
        words: |torque, _| format!("{torque:.3} N m, once a turn"),
    },
];

/// Whether the true arm differs from the robot file in this: in a value that the file has, or by the payload.
fn differs(name: &str) -> bool {
    Effect::ALL.iter().any(|e| e.name() == name && (e.kind() == rivet_diagnosis::Kind::Value || name == "payload"))
}

/// The effect in the true arm.
pub(crate) struct Hidden {
    kind: &'static Kind,
    joint: usize,
    joint_name: String,
    torque: f64,
    speed: f64,
}

impl Hidden {
    /// Draws one that the robot file does not have.
    pub(crate) fn draw(robot: &Robot, seed: u64) -> Result<Hidden> {
        let known = robot.model.effects();
        let open: Vec<&Kind> =
            KINDS.iter().filter(|kind| known.list().iter().all(|e| e.kind.name() != kind.effect)).collect();
        if open.is_empty() {
            bail!("the robot file has every effect that the demonstration can hide; remove one from [effects]");
        }
        // Sizes are those of a joint that turns.
        let turning: Vec<usize> =
            (0..robot.dof()).filter(|j| robot.model.arm.joints[*j].kind == JointKind::Revolute).collect();
        if turning.is_empty() {
            bail!("no joint of this arm turns: the demonstration hides its effect in one that does");
        }
        let mut random = Random::stream(seed, STREAM);
        let mut pick = |count: usize| (random.uniform(0.0, count as f64) as usize).min(count - 1);
        let (kind, joint) = (open[pick(open.len())], turning[pick(turning.len())]);
        let (coulomb, limit) = (robot.config.friction.coulomb[joint], robot.config.drive.torque_limit[joint]);
        let scale = if coulomb > 0.0 { coulomb } else { FRICTION_SHARE * limit };
        let axis = &robot.model.arm.joints[joint];
        let speed = if axis.velocity.is_finite() && axis.velocity > 0.0 { axis.velocity } else { 1.0 };
        let torque = scale * random.uniform(kind.size.0, kind.size.1);
        Ok(Hidden { kind, joint, joint_name: axis.name.clone(), torque, speed })
    }

    /// Writes the robot file of the true arm into `folder`.
    pub(crate) fn robot_file(&self, robot: &Robot, file: &Path, folder: &Path) -> Result<PathBuf> {
        let text = std::fs::read_to_string(file).with_context(|| file.display().to_string())?;
        let mut table: toml::Table = toml::from_str(&text).with_context(|| file.display().to_string())?;
        let urdf = std::path::absolute(&robot.config.urdf).context("the path of the URDF")?;
        table.insert("urdf".to_owned(), urdf.to_string_lossy().into_owned().into());
        let mut section = toml::Table::new();
        for (key, value) in (self.kind.values)(self.torque, self.speed) {
            let each = (0..robot.dof()).map(|j| if j == self.joint { value } else { 0.0 });
            section.insert(key.to_owned(), toml::Value::Array(each.map(toml::Value::Float).collect()));
        }
        let effects = table.entry("effects").or_insert_with(|| toml::Table::new().into());
        let effects = effects.as_table_mut().context("[effects] is a table")?;
        effects.insert(self.kind.effect.to_owned(), section.into());
        let path = folder.join("true-robot.toml");
        rivet_files::write_whole(&path, &toml::to_string(&table)?).with_context(|| path.display().to_string())?;
        Ok(path)
    }

    /// Whether a cause is this effect, or its class holds it, on this joint.
    fn is(&self, cause: &Cause) -> bool {
        let named =
            cause.effect == self.kind.effect || cause.indistinguishable_from.iter().any(|e| e == self.kind.effect);
        named && (cause.joints.is_empty() || cause.joints.contains(&self.joint_name))
    }

    /// Whether the diagnosis named the effect or put it into a class.
    pub(crate) fn is_found(&self, found: &Document) -> bool {
        found.causes.iter().any(|cause| self.is(cause))
    }

    /// What was hidden and what was named.
    pub(crate) fn text(&self, found: &Document) -> Result<String> {
        let size = (self.kind.words)(self.torque, self.speed);
        let mut out = paragraph_within(
            COLUMNS,
            "  hidden       ",
            &format!("{} of {}: {size}", effect(self.kind.effect), self.joint_name),
        );
        let scores = rivet_analysis::diagnose::scores()?;
        let (actions, causes) = (found.actions(&scores), &found.causes);
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
        for (is_true, note) in [(true, "the true arm differs in these, too"), (false, "not in the true arm")] {
            let others = others(is_true);
            if !others.is_empty() {
                out += &paragraph_within(COLUMNS, "  also named   ", &format!("{} ({note})", others.join(", ")));
            }
        }
        if let Some(result) = found.result_line() {
            out += &paragraph_within(COLUMNS, "  result       ", &result);
        }
        let _ = write!(out, "hidden effect: {}", if self.is_found(found) { "named" } else { "NOT named" });
        Ok(out)
    }
}

/// `rivet diagnose` of the recorded run, as a user would call it.
pub(super) fn diagnose(files: &Files, shutdown: &Shutdown) -> Result<Document> {
    // A file takes everything the child may write; a pipe that nobody empties would hold it up.
    let messages = files.folder.join("diagnose.log");
    let program = std::env::current_exe().context("cannot find this program's own file")?;
    let mut command = Command::new(program);
    command.arg("diagnose").args([&files.robot, &files.log]).arg("--json").arg(&files.verdict);
    command.arg("--export").arg(&files.patched);
    let mut child = command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(output_file(&messages)?)
        .spawn()
        .context("cannot start rivet diagnose")?;
    let mut progress = Progress::new("diagnosing the recorded run", 1000);
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
        progress.set((1000.0 * (1.0 - (-begin.elapsed().as_secs_f64() / USUAL_S).exp())) as usize);
        std::thread::sleep(Duration::from_millis(20));
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
        bail!("rivet diagnose ended without a verdict ({status}): {}", output.trim());
    };
    serde_json::from_str(&text).context("the verdict of rivet diagnose")
}
