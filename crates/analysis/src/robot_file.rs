//! A robot file from a URDF and logs, with what nobody knows marked.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Result;
use rivet_dynamics::{Proposal, UrdfArm, UrdfError, UrdfMistakes, UrdfNote, UrdfOptions};
use rivet_estimation::offline::position_step;
use rivet_files::Content;
use rivet_logs::{ChannelMap, Log, Naming, ReadOptions, read_as};

use crate::fault::Fault;
use crate::runs;
use crate::table::number;

/// Steps towards a chain: each mends what the one before left.
const ATTEMPTS: usize = 4;
/// Sample period without a log \[s\].
const USUAL_PERIOD_S: f64 = 0.001;
/// Shortest and longest period that a robot file takes \[s\].
const PERIODS_S: [f64; 2] = [1e-4, 0.1];
/// Where a URDF has no effort and a log is there: so many times its largest torque.
const LOGGED_TORQUE_SHARE: f64 = 3.0;
/// Torque of an arm's first joints over the cube of its reach \[N m/m^3\], for a limit that no joint reaches: 25 to 200 are measured arms'.
const TORQUE_OVER_CUBE: f64 = 400.0;
/// No placeholder is below \[N m\].
const LEAST_LIMIT: f64 = 1.0;

/// A robot file that was made from a URDF and logs.
pub struct RobotFile {
    /// The file's text.
    pub text: String,
    /// What is unknown, a few words each; the text marks it.
    pub unknown: Vec<String>,
}

/// Makes a robot file for `folder` from a URDF, with what the logs show of the arm.
///
/// * `gravity`: in base axes \[m/s^2\]
///
/// # Errors
/// The URDF is no arm, or a log cannot be read.
pub fn robot_file(urdf: &Path, logs: &[PathBuf], gravity: &[f64], folder: &Path) -> Result<RobotFile> {
    let (arm, options) = described(urdf)?;
    let names: Vec<String> = arm.arm.joints.iter().map(|joint| joint.name.clone()).collect();
    let logs: Vec<Log> = logs
        .iter()
        .map(|path| {
            let naming = Naming { joints: &names, map: &ChannelMap::default() };
            let log = read_as(path, &ReadOptions::new(arm.arm.dof()), &naming)?;
            // There is no robot file yet that states a unit.
            runs::check_time(&log).map_err(|why| {
                Fault::Data(format!(
                    "{why}; first write it in seconds: rivet convert LOG OUT URDF --map time_unit=UNIT"
                ))
            })?;
            Ok(log)
        })
        .collect::<Result<_>>()?;
    let new = New { arm: &arm, options: &options, logs: &logs, gravity, urdf: place(urdf, folder) };
    Ok(RobotFile { text: new.text(), unknown: new.unknown() })
}

/// Refuses a file of another kind where a URDF is expected, before anything else is asked of the command line.
///
/// # Errors
/// The file is of another kind, or is not there.
pub fn ensure_urdf(urdf: &Path) -> Result<()> {
    if matches!(Content::of(urdf), Ok(Content::Urdf)) {
        return Ok(());
    }
    described(urdf).map(|_| ())
}

/// The robot file of a URDF in memory, with what a log says of the arm.
pub(crate) fn of_urdf(urdf: &Path, log: Option<&Log>) -> Result<rivet_config::Robot> {
    let (arm, options) = arm_of(urdf)?;
    let logs: Vec<Log> = log.into_iter().cloned().collect();
    let folder = urdf.parent().unwrap_or(Path::new(""));
    let new = New { arm: &arm, options: &options, logs: &logs, gravity: &[0.0, 0.0, -9.81], urdf: place(urdf, folder) };
    Ok(rivet_config::parse(&folder.join("robot.toml"), &new.text())?)
}

/// [`arm_of`], and a log in the URDF's place is called that.
fn described(urdf: &Path) -> Result<(UrdfArm, UrdfOptions)> {
    arm_of(urdf).map_err(|why| runs::wrong_order(urdf, "URDF LOG...").unwrap_or(why))
}

/// The arm of a URDF file, with the options that make it one.
fn arm_of(urdf: &Path) -> Result<(UrdfArm, UrdfOptions)> {
    let text = rivet_config::urdf_text(urdf).map_err(|why| match why.mend() {
        Some(mend) => Fault::Config(format!("{}: {why}; {mend}", urdf.display())).into(),
        None => anyhow::Error::new(why).context(urdf.display().to_string()),
    })?;
    Ok(chain(&text).map_err(|why| Fault::Config(refusal(urdf, &why)))?)
}

/// Every mistake with its line and mend.
fn refusal(urdf: &Path, mistakes: &UrdfMistakes) -> String {
    let file = urdf.display().to_string();
    let line = |mistake: &rivet_dynamics::UrdfMistake| format!("{file}: {mistake}; {}", mistake.error.mend(&file));
    mistakes.all().iter().map(line).collect::<Vec<_>>().join("\n")
}

/// Reads a URDF with the options that make it an arm.
fn chain(text: &str) -> Result<(UrdfArm, UrdfOptions), UrdfMistakes> {
    let mut options = UrdfOptions::default();
    for _ in 0..ATTEMPTS {
        match UrdfArm::read(text, [0.0; 3], &options) {
            Ok(arm) => return Ok((arm, options)),
            Err(mistakes) => {
                let before = options.clone();
                for mistake in mistakes.all() {
                    mend(&mut options, &mistake.error);
                }
                if options == before {
                    return Err(mistakes);
                }
            }
        }
    }
    UrdfArm::read(text, [0.0; 3], &options).map(|arm| (arm, options))
}

fn mend(options: &mut UrdfOptions, error: &UrdfError) {
    match error {
        UrdfError::Branches { proposal, .. }
        | UrdfError::TooManyJoints { proposal, .. }
        | UrdfError::SeveralRoots { proposal, .. }
        | UrdfError::Mimic { proposal, .. } => {
            let Proposal { tip, fixed } = proposal.as_ref();
            options.tip = (!tip.is_empty()).then(|| tip.clone());
            options.fixed.clone_from(fixed);
        }
        UrdfError::UnsupportedJoint { joint, .. } => options.fixed.push((joint.clone(), 0.0)),
        UrdfError::BadMass { .. } | UrdfError::NotPositiveDefinite { .. } | UrdfError::TriangleInequality { .. } => {
            options.project = true;
        }
        _ => {}
    }
}

/// A file as seen from a folder: relative where one is below the other, else in full.
fn place(file: &Path, folder: &Path) -> String {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let found = file.canonicalize().ok().zip(folder.canonicalize().ok());
    let relative = found.as_ref().and_then(|(file, folder)| file.strip_prefix(folder).ok());
    let full = found.as_ref().map(|(file, _)| file.as_path());
    relative.or(full).unwrap_or(file).display().to_string()
}

/// A line's value, and where it comes from.
struct Line {
    key: &'static str,
    value: String,
    comment: String,
}

/// Everything that a robot file is made of.
struct New<'a> {
    arm: &'a UrdfArm,
    options: &'a UrdfOptions,
    logs: &'a [Log],
    gravity: &'a [f64],
    urdf: String,
}

impl New<'_> {
    fn text(&self) -> String {
        let arm = &self.arm.arm;
        let joints: Vec<&str> = arm.joints.iter().map(|joint| joint.name.as_str()).collect();
        let name = robot_name(&arm.name);
        let mut out = format!(
            "# Robot file of {name}, written by `rivet new`. Lines marked UNKNOWN hold an initial value: replace it where you know a better one.\n\
             # Keys: docs/robot-toml.md. One value per joint, base to flange, at the joint side of the gear, SI:\n#   {}\n",
            rivet_files::printable(&joints.join(", "))
        );
        let lists = |lines: &[Line]| {
            let mut text = String::new();
            for Line { key, value, comment } in lines {
                // Writing to a String cannot fail.
                let _ = writeln!(text, "{key} = {value}  # {}", rivet_files::printable(comment));
            }
            text
        };
        let _ = writeln!(out, "name = {name:?}\nurdf = {:?}", self.urdf);
        out += &lists(&[self.period(), self.gravity()]);
        out += &self.model();
        out += "\n[drive]\n";
        out += &lists(&[self.gear(), self.rotor(), self.limit(), self.encoder()]);
        out += &self.gain();
        out += "\n[friction]\n";
        out += &lists(&self.friction());
        out
    }

    /// What is unknown, a few words each.
    fn unknown(&self) -> Vec<String> {
        let lines = [self.period(), self.gear(), self.rotor(), self.limit(), self.encoder()];
        let friction = self.friction();
        let marked = lines.iter().chain(&friction).filter(|line| line.comment.contains("UNKNOWN"));
        let mut unknown: Vec<String> = marked.map(|line| line.key.to_owned()).collect();
        let links = self.links_without_body();
        if !links.is_empty() {
            unknown.push(format!("bodies of {}", links.join(", ")));
        }
        unknown
    }

    fn links_without_body(&self) -> Vec<&str> {
        let UrdfArm { arm, unknown, .. } = self.arm;
        arm.joints.iter().zip(unknown).filter(|(_, unknown)| **unknown).map(|(joint, _)| joint.link.as_str()).collect()
    }

    fn period(&self) -> Line {
        let mut steps: Vec<f64> = self.logs.iter().map(Log::median_step_s).filter(|step| step.is_finite()).collect();
        steps.sort_by(f64::total_cmp);
        let (value, comment) = match steps.first() {
            Some(step) => {
                let period = rounded(step.clamp(PERIODS_S[0], PERIODS_S[1]));
                (period, format!("s, from the log: {} Hz", number(1.0 / period, 4)))
            }
            None => (USUAL_PERIOD_S, "s, UNKNOWN: time between samples of controller, daemon and logs".to_owned()),
        };
        Line { key: "sample_period_s", value: format!("{value:?}"), comment }
    }

    fn gravity(&self) -> Line {
        let comment = "m/s^2, free fall in base axes; this is for an arm that stands upright".to_owned();
        let given = self.gravity != [0.0, 0.0, -9.81];
        let comment = if given { "m/s^2, free fall in base axes".to_owned() } else { comment };
        Line { key: "gravity", value: format!("{:?}", self.gravity), comment }
    }

    fn model(&self) -> String {
        let mut out = String::new();
        let links = self.links_without_body();
        if !links.is_empty() {
            let _ = write!(
                out,
                "\n# UNKNOWN: the URDF has no <inertial> of {}. These bodies have a wide prior.\n",
                rivet_files::printable(&links.join(", "))
            );
        }
        let UrdfOptions { tip, fixed, project } = self.options;
        if tip.is_none() && fixed.is_empty() && !project {
            return out;
        }
        out += "\n";
        if tip.is_some() || !fixed.is_empty() {
            out += "# The URDF is a tree: the arm ends at `tip`, the joints of `fixed` are welded [rad or m].\n";
        }
        let _ = writeln!(out, "[model]");
        if let Some(tip) = tip {
            let _ = writeln!(out, "tip = {tip:?}");
        }
        if !fixed.is_empty() {
            let text = Proposal { tip: String::new(), fixed: fixed.clone() }.text();
            out += text.lines().last().unwrap_or_default();
            out += "\n";
        }
        if *project {
            out += "impossible_inertia = \"project\"  # no body can have these inertias:\n";
            for note in self.arm.notes.iter().filter(|note| matches!(note, UrdfNote::Projected { .. })) {
                let _ = writeln!(out, "#   {}", rivet_files::printable(&note.to_string()));
            }
        }
        out
    }

    fn gear(&self) -> Line {
        let value = list(&vec![1.0; self.arm.arm.dof()]);
        let comment = "-, UNKNOWN: motor angle over joint angle; used for motor harmonics in reports only".to_owned();
        Line { key: "gear_ratio", value, comment }
    }

    fn rotor(&self) -> Line {
        let value = list(&vec![0.0; self.arm.arm.dof()]);
        let comment = "kg m^2, UNKNOWN: rotor inertia times gear_ratio^2; identified, starting from 0".to_owned();
        Line { key: "rotor_inertia", value, comment }
    }

    fn limit(&self) -> Line {
        let arm = &self.arm.arm;
        let missing: Vec<usize> = (0..arm.dof()).filter(|&j| !arm.joints[j].effort.is_finite()).collect();
        let limit = |j: usize| if missing.contains(&j) { self.placeholder(j) } else { arm.joints[j].effort };
        let value = list(&(0..arm.dof()).map(limit).collect::<Vec<f64>>());
        let names: Vec<&str> = missing.iter().map(|&j| arm.joints[j].name.as_str()).collect();
        let whose = if names.len() == arm.dof() { "all joints".to_owned() } else { names.join(", ") };
        let comment = match (missing.is_empty(), self.torques().is_some()) {
            (true, _) => "N m, effort of the URDF".to_owned(),
            (false, true) => {
                format!("N m, UNKNOWN of {whose}: {LOGGED_TORQUE_SHARE} times the largest torque of the log")
            }
            (false, false) => {
                format!("N m, UNKNOWN of {whose}: a placeholder from the arm's size, probably too large")
            }
        };
        Line { key: "torque_limit", value, comment }
    }

    /// Largest torque of each joint in the logs, without the rarest thousandth of the rows.
    fn torques(&self) -> Option<Vec<f64>> {
        let logged: Vec<_> = self.logs.iter().filter_map(|log| log.torque().ok()).collect();
        let largest = |j: usize| {
            let mut all: Vec<f64> = logged.iter().flat_map(|tau| tau[j].iter().map(|x| x.abs())).collect();
            all.sort_by(f64::total_cmp);
            all.get((all.len() * 999 / 1000).min(all.len().saturating_sub(1))).copied().unwrap_or(0.0)
        };
        (!logged.is_empty()).then(|| (0..self.arm.arm.dof()).map(largest).collect())
    }

    /// A torque limit where the URDF has none.
    fn placeholder(&self, j: usize) -> f64 {
        if let Some(torques) = self.torques() {
            return rounded_up((LOGGED_TORQUE_SHARE * torques[j]).max(LEAST_LIMIT));
        }
        let beyond = |from: usize| -> f64 { self.arm.arm.reach(from) + self.arm.tip_length };
        let (whole, from_here) = (beyond(0), beyond(j + 1));
        let share = if whole > 0.0 { (from_here / whole).max(0.1) } else { 1.0 };
        rounded_up((TORQUE_OVER_CUBE * whole.powi(3) * share).max(LEAST_LIMIT))
    }

    fn encoder(&self) -> Line {
        let dof = self.arm.arm.dof();
        let step = |j: usize| self.logs.iter().filter_map(|log| position_step(&log.q[j])).fold(f64::INFINITY, f64::min);
        let steps: Vec<f64> = (0..dof).map(step).collect();
        let found = steps.iter().filter(|step| step.is_finite()).count();
        let value = list(&steps.iter().map(|s| if s.is_finite() { rounded(*s) } else { 0.0 }).collect::<Vec<f64>>());
        let comment = match found {
            0 => "rad, UNKNOWN: smallest step of a joint position; 0 disables its use".to_owned(),
            n if n == dof => "rad, steps of the log's positions".to_owned(),
            _ => "rad, steps of the log's positions; UNKNOWN where 0".to_owned(),
        };
        Line { key: "encoder_resolution", value, comment }
    }

    /// What a log of currents alone asks for.
    fn gain(&self) -> String {
        let only_current = self.logs.iter().any(|log| log.tau.is_none() && log.current.is_some());
        if !only_current {
            return String::new();
        }
        let ones = list(&vec![1.0; self.arm.arm.dof()]);
        format!(
            "# UNKNOWN: the log has currents and no torques. Uncomment the line and give torque constant times gear_ratio.\n\
             # drive_gain = {ones}  # N m/A\n"
        )
    }

    fn friction(&self) -> [Line; 3] {
        let dof = self.arm.arm.dof();
        let of_urdf = |k: usize| -> Vec<f64> {
            let value = |dynamics: &Option<[f64; 2]>| dynamics.map_or(0.0, |dynamics| dynamics[k]);
            self.arm.friction.iter().map(value).map(|x| if x.is_finite() && x > 0.0 { x } else { 0.0 }).collect()
        };
        let line = |key, k: usize, unit: &str, attribute: &str| {
            let values = of_urdf(k);
            let comment = if values.iter().any(|x| *x > 0.0) {
                format!("{unit}, <dynamics {attribute}> of the URDF")
            } else {
                format!("{unit}, UNKNOWN: identified, starting from 0")
            };
            Line { key, value: list(&values), comment }
        };
        let offset = Line {
            key: "offset",
            value: list(&vec![0.0; dof]),
            comment: "N m, UNKNOWN: constant torque; identified, starting from 0".to_owned(),
        };
        [line("coulomb", 1, "N m", "friction"), line("viscous", 0, "N m s/rad", "damping"), offset]
    }
}

fn list(values: &[f64]) -> String {
    format!("[{}]", values.iter().map(|x| format!("{x:?}")).collect::<Vec<_>>().join(", "))
}

/// Six digits.
fn rounded(x: f64) -> f64 {
    format!("{x:.5e}").parse().unwrap_or(x)
}

/// Two digits, not below.
fn rounded_up(x: f64) -> f64 {
    let unit = 10.0_f64.powf(x.log10().floor() - 1.0);
    rounded((x / unit).ceil() * unit)
}

/// A name that a robot file takes.
fn robot_name(name: &str) -> String {
    let letters = name.to_lowercase();
    let kept = letters.chars().map(|c| if c.is_ascii_alphanumeric() || c == '_' { c } else { '-' });
    let kept: String = kept.take(64).collect();
    let kept = kept.trim_matches(['-', '_']);
    if kept.is_empty() { "arm".to_owned() } else { kept.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_a_robot_file_takes() {
        for (name, taken) in [("UR10e", "ur10e"), ("Piper single", "piper-single"), ("", "arm"), ("_x/", "x")] {
            assert_eq!(robot_name(name), taken);
        }
    }

    #[test]
    fn limits_are_rounded_up() {
        for (x, up) in [(101.0, 110.0), (1.0, 1.0), (0.123, 0.13), (99.1, 100.0)] {
            assert!((rounded_up(x) - up).abs() < 1e-9 * up, "{x}: {}", rounded_up(x));
        }
    }
}
