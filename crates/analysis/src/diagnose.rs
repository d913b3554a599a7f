//! Where a simulator differs from the arm, which effect causes it, how far the gap shrinks.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use rivet_config::Robot;
use rivet_diagnosis::{
    Diagnosis, Listener, LogFault, MotionBounds, Patch, Run, Verdict, diagnose_and_patch, of_one_clock,
};
use rivet_report::words::{effect, figure, percent};
use rivet_report::{Cause, Document, JointGap, LogFinding, Power, Score, SelfCheck, formats, page};

use crate::bodies::{BODIES_UNKNOWN, with_bodies};
use crate::evidence::{Distrust, TORQUE_STOOD_NAME};
use crate::frozen::Stood;
use crate::glitches::{JUMP_NAME, WRAPPED_NAME, bridged, refuse_most};
use crate::gravity_free::{GravityFree, confused_with_gravity};
use crate::passport::{Source, passport};
use crate::patched;
use crate::progress::DiagnosisProgress;
use crate::reading;
use crate::rollout::{rollout, undriven};
use crate::runs;
use crate::self_check::self_check;
use crate::session;
use crate::steps::count_line;
use crate::table::{Table, paragraph};

/// Effects that are values of the file.
const VALUES: [&str; 4] = ["link_inertia", "rotor_inertia", "coulomb_friction", "viscous_friction"];
/// Rows of values on a terminal: a body has ten.
const MOST_VALUES: usize = 24;
/// Names of two joints are both told where they are no longer together.
const JOINTS_WIDTH: usize = 24;

/// What a diagnosis is made of.
#[derive(Clone, Copy, Debug)]
pub struct Inputs<'a> {
    /// Robot file with the nominal model, from which the robot was loaded.
    pub robot_file: &'a Path,
    /// Logs of the arm. With several logs the last is held out; a single log is cut at 60 %.
    pub logs: &'a [PathBuf],
    /// Whether the last log is a window of the bus, with a clock of its own.
    pub is_last_live: bool,
    /// The program, whose digest the passport states.
    pub program: &'a Path,
    /// Whether the candidates that are considered are noted.
    pub is_verbose: bool,
}

/// A diagnosis as a document, with the model that was found.
pub struct Diagnosed {
    /// The robot as it was compared with the logs.
    robot: Robot,
    /// Where torques are without gravity: then so is `robot`.
    gravity_free: Option<GravityFree>,
    verdict: Verdict,
    document: Document,
    patch: Option<Patch>,
    /// The runs that were used, the held-out one last.
    used: Vec<Run>,
}

/// Steps of a diagnosis: as notes, else as progress.
struct Shown {
    progress: DiagnosisProgress,
    is_verbose: bool,
    /// Tenths of the present round that were noted.
    tenth: usize,
}

impl Listener for Shown {
    fn line(&mut self, text: &str) {
        if self.is_verbose {
            session::note(text);
        } else {
            self.progress.say(text);
        }
    }

    fn count(&mut self, done: usize, total: usize) {
        if !self.is_verbose {
            self.progress.count(done, total);
        } else if 10 * done / total.max(1) != self.tenth {
            self.tenth = 10 * done / total.max(1);
            session::note(count_line(done, total));
        }
    }
}

/// Diagnoses the gap between the nominal model of `robot` and logs of the arm.
///
/// # Errors
/// A log cannot be read, does not fit the robot or is there twice.
pub fn diagnose(robot: &Robot, inputs: &Inputs<'_>) -> Result<Diagnosed> {
    let gravity_free = GravityFree::find(robot, inputs.logs)?;
    let robot = gravity_free.as_ref().map_or(robot, |found| &found.robot);
    let Sources { logs: sources, mut stood, spoilt } = Sources::read(robot, inputs.logs)?;
    stood.extend(gravity_free.as_ref().map(|found| found.finding.clone()));
    runs::check_distinct(sources.iter().map(|s| (s.path, &s.log)))?;
    let (robot, nothing_to_compare) = with_bodies(robot.clone(), &sources.iter().map(|s| &s.log).collect::<Vec<_>>())?;
    stood.extend(nothing_to_compare);
    let progress = DiagnosisProgress::new("diagnosing");
    let mut shown = Shown { progress, is_verbose: inputs.is_verbose, tenth: 0 };
    let live = inputs.is_last_live;
    let all = runs_of(&sources, live)?;
    let bounds =
        MotionBounds::from_limits(&robot.model, &robot.config.drive.torque_limit, robot.config.sample_period_s);
    let (found, patch) = diagnose_and_patch(&robot.model, &robot.nominal, all, &bounds, &mut shown)?;
    // Runs that were left out drive no simulator and show nothing.
    let used = found.used.iter();
    let mut given: Vec<Option<Run>> = runs_of(&sources, live)?.into_iter().map(Some).collect();
    let used: Vec<Run> = used.filter_map(|place| given.get_mut(*place)?.take()).collect();
    drop(given);
    let passport = passport(&robot, inputs.robot_file, inputs.program, &sources, &found.used)?;
    let mut document = Document::new(&robot.config.name, &found, Some(passport));
    document.log.splice(0..0, stood.into_iter().map(log_finding));
    let spoilt = spoilt.filter(|reading| is_void(reading, &found, &document)).map(|reading| reading.text);
    let spoilt = spoilt.or_else(|| gravity_free.as_ref().and_then(|_| confused_with_gravity(&found)));
    if let Some(why) = &spoilt {
        document.is_misread(why);
    }
    let patch = patch.filter(|_| spoilt.is_none());
    if let Some(patch) = &patch {
        document.export = formats(patch);
        document.tells_motions(patch, &runs::joint_names(&robot));
    }
    if let (Some(patch), Some(last), false) = (&patch, used.last(), found.causes.is_empty()) {
        shown.line("the simulator in closed loop");
        let unbelieved = found.log.iter().filter(|f| f.run == last.name && f.fault.spoils());
        let unbelieved: Vec<&str> = unbelieved.map(|f| f.joint.as_str()).collect();
        document.rollout =
            if unbelieved.is_empty() { rollout(&robot, patch, last) } else { Some(undriven(&unbelieved)) };
    }
    shown.progress.done();
    let verdict = if spoilt.is_some() { Verdict::NotEvaluated } else { found.verdict };
    Ok(Diagnosed { robot, gravity_free, verdict, document, patch, used })
}

/// Scores of this version on the cases with answers, as `rivet blind score --json` wrote them (`docs/validation.md`).
///
/// # Errors
/// The scores that are part of this program are damaged.
pub fn scores() -> Result<Vec<Score>> {
    serde_json::from_str(include_str!("scores.json")).context("the scores that are part of this program")
}

impl Diagnosed {
    /// The verdict: not evaluated where the log has to be read otherwise than it was.
    pub fn verdict(&self) -> Verdict {
        self.verdict
    }

    /// The diagnosis as a document.
    pub fn document(&self) -> &Document {
        &self.document
    }

    /// Writes model.toml, robot.urdf, robot.xml, not-expressible.md and separating motions into `folder`; notes why, where there is
    /// nothing to export. Returns whether it was written.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn export(&self, folder: &Path) -> Result<bool> {
        if let Some(patch) = &self.patch {
            if let Some(found) = &self.gravity_free {
                let mut patch = patch.clone();
                patch.model.arm.gravity = found.gravity();
                patched::export(&found.restore(&self.robot), &patch, folder)?;
            } else {
                patched::export(&self.robot, patch, folder)?;
            }
            if let Some(joints) = self.document.worse_joints() {
                let text = format!(
                    "on the held-out log the corrected model has a larger residual in motion than the nominal one: {joints}"
                );
                session::note(paragraph("rivet: ", &text).trim_end());
            }
            return Ok(true);
        }
        let why = if self.document.remark.is_some() { "nothing was evaluated" } else { "gravity comes first" };
        session::note(format_args!("rivet: {why}, so nothing is exported"));
        Ok(false)
    }

    /// Adds effects of graded strength to the logs (at most the first minute), and which of them are found to the document. Does nothing
    /// where nothing was evaluated.
    ///
    /// # Errors
    /// The logs are too short.
    pub fn self_check(&mut self) -> Result<()> {
        if self.document.remark.is_none() {
            self.document.self_check = Some(self_check(&self.robot, std::mem::take(&mut self.used))?);
        }
        Ok(())
    }

    /// The JSON of the document.
    ///
    /// # Errors
    /// A number that JSON does not have.
    pub fn json(&self) -> Result<String> {
        Ok(rivet_files::printable_json(serde_json::to_string_pretty(&self.document)? + "\n"))
    }

    /// The document as an HTML page without external parts.
    ///
    /// # Errors
    /// As [`scores`].
    pub fn html(&self) -> Result<String> {
        Ok(page(&self.document, &scores()?))
    }

    /// The verdict on one screen: what to do, what it brings, what is open, what is wrong with the logs. `details` adds the gap, its place
    /// and the tables.
    ///
    /// # Errors
    /// As [`scores`].
    pub fn text(&self, details: bool) -> Result<String> {
        let mut text = as_text(&self.document, &scores()?, details);
        for finding in self.document.log.iter().filter(|finding| finding.fault == BODIES_UNKNOWN) {
            text += &paragraph("  Bodies       ", &finding.text);
        }
        if !details && self.document.remark.is_none() {
            text += &paragraph("  More         ", "--details: gap, place and tables. --html FILE: all as a page.");
        }
        Ok(text)
    }
}

/// The logs of a diagnosis, and what was found while they were read.
struct Sources<'a> {
    logs: Vec<Source<'a>>,
    stood: Vec<Distrust>,
    /// The first reading other than the log as it is, with which causes may mean nothing.
    spoilt: Option<reading::Found>,
}

impl Sources<'_> {
    fn read<'a>(robot: &Robot, logs: &'a [PathBuf]) -> Result<Sources<'a>> {
        let mut all = Sources { logs: Vec::new(), stood: Vec::new(), spoilt: None };
        for path in logs {
            let (log, mended) = bridged(robot, runs::read_log(robot, path)?)?;
            all.stood.extend(mended);
            let reading = reading::find(robot, &log);
            all.stood.extend(reading.iter().map(reading::Found::distrust));
            all.spoilt = all.spoilt.or(reading.filter(|found| found.spoils || found.drifts));
            // A torque that stands while its joint moves says nothing of the arm.
            let Stood { found, rows } = Stood::find(robot, &log);
            refuse_most(&log, &rows, &found)?;
            all.stood.extend(found);
            let pieces = runs::pieces_without(&rows, &log, log.median_step_s())?;
            all.logs.push(Source { path, log, pieces });
        }
        Ok(all)
    }
}

/// Whether a reading makes the diagnosis void: causes mean something where the diagnosis deals with every fault of it.
fn is_void(reading: &reading::Found, found: &Diagnosis, document: &Document) -> bool {
    if reading.drifts {
        // Friction that drifts looks like laws of friction and limits of torque, unless it follows a temperature.
        let laws = document.causes.iter().any(|c| !VALUES.contains(&c.effect.as_str()));
        return laws && !document.causes.iter().any(|c| c.effect == "temperature_dependent_friction");
    }
    if !document.other_arm.is_empty() && !reading.is_sure() {
        return false;
    }
    let of_this_log =
        |run: &str| run.strip_prefix(reading.log.as_str()).is_some_and(|rest| rest.is_empty() || rest.starts_with(' '));
    // It refuses by itself, for a channel that it names.
    if found.verdict == Verdict::NotEvaluated && found.log.iter().any(|f| f.fault.spoils()) {
        return false;
    }
    let findings: Vec<&rivet_diagnosis::LogFinding> = found.log.iter().filter(|f| of_this_log(&f.run)).collect();
    let joints = |of: &dyn Fn(&LogFault) -> bool| -> Vec<&str> {
        findings.iter().filter(|f| of(&f.fault)).map(|f| f.joint.as_str()).collect()
    };
    let dealt_with = reading::DealtWith {
        effects: document.causes.iter().map(|c| (c.effect.as_str(), c.joints.as_slice())).collect(),
        left_out: joints(&|fault| fault.spoils()),
        aligned: joints(&|fault| matches!(fault, LogFault::Late(_))),
    };
    !reading.is_dealt_with(&dealt_with)
}

fn log_finding(of: Distrust) -> LogFinding {
    let [run, joint] = [of.log, of.joint].map(Option::unwrap_or_default);
    LogFinding { run, joint, fault: of.name.to_owned(), value: None, text: of.text }
}

/// Every stretch of every log as a run; `live`: the last is the window of `--live`.
fn runs_of(sources: &[Source<'_>], live: bool) -> Result<Vec<Run>> {
    let mut all = Vec::new();
    for source in sources {
        all.push((runs::runs(source.path, &source.pieces)?, runs::starts(&source.pieces)));
    }
    Ok(on_their_clocks(all, live))
}

/// Runs of several logs with the times \[s\] at which they began, on one clock as far as they may be. The time of a live window
/// is its own, from 0 on: no log of a file was just before or after it.
fn on_their_clocks(logs: Vec<(Vec<Run>, Vec<f64>)>, live: bool) -> Vec<Run> {
    let files = logs.len() - usize::from(live && !logs.is_empty());
    let shared: usize = logs[..files].iter().map(|(runs, _)| runs.len()).sum();
    let starts: Vec<f64> = logs.iter().flat_map(|(_, starts)| starts.iter().copied()).collect();
    let mut all: Vec<Run> = logs.into_iter().flat_map(|(runs, _)| runs).collect();
    of_one_clock(&mut all[..shared], &starts[..shared]);
    all
}

/// The verdict, with details below.
fn as_text(found: &Document, scores: &[Score], details: bool) -> String {
    let mut out = paragraph("", &format!("diagnose {}: {}", found.robot, rivet_report::words::verdict_of(found)));
    for line in found.lines(scores).iter().filter(|line| details || !line.detail) {
        out += &paragraph(&format!("  {:<12} ", line.head), &line.text);
    }
    for input in found.passport.iter().flat_map(|passport| &passport.inputs) {
        if let Some(off) = input.clock.as_ref().and_then(|clock| clock.off.as_ref()) {
            out += &paragraph("  clock        ", &format!("{}: {}", input.name, off.text));
        }
        if let Some(jitter_s) = input.clock.as_ref().and_then(|clock| clock.stamps_jitter_s) {
            let ms = figure(1e3 * jitter_s, 2);
            let text = format!("time stamps of {} jitter by {ms} ms; positions are even: taken as even", input.name);
            out += &paragraph("  sampling     ", &text);
        }
    }
    for stood in found.log.iter().filter(|finding| finding.fault == TORQUE_STOOD_NAME) {
        out += &paragraph("  torque       ", &format!("of {} in {}: {}", stood.joint, stood.run, stood.text));
    }
    for mended in found.log.iter().filter(|finding| [JUMP_NAME, WRAPPED_NAME].contains(&finding.fault.as_str())) {
        out += &paragraph("  position     ", &format!("of {} in {}: {}", mended.joint, mended.run, mended.text));
    }
    for reading in found.log.iter().filter(|finding| finding.fault == reading::READING_NAME) {
        out += &paragraph("  reading      ", &format!("of {}: {}", reading.run, reading.text));
    }
    if let Some(rollout) = found.rollout.as_ref().filter(|rollout| details || rollout.points.is_empty()) {
        out += &paragraph("  simulator    ", &rollout.text());
    }
    if found.verdict == "unexplained" && !found.hints.is_empty() {
        let mut hints: Vec<String> = found.hints.iter().map(Cause::word).collect();
        hints.dedup();
        out += &paragraph("  Considered   ", &format!("not supported: {}", hints.join(", ")));
    }
    if details {
        out += &tables(found);
    }
    if let Some(check) = &found.self_check {
        out += &power(found, check);
    }
    out
}

/// The tables of causes, parameters and joints.
fn tables(found: &Document) -> String {
    let mut out = String::new();
    if !found.causes.is_empty() {
        let mut table = Table::new(["cause", "joints", "shrink %", "90 %", "measured", "share %", "confidence"]);
        for c in &found.causes {
            table.row([
                effect(&c.effect),
                match c.joints.as_slice() {
                    joints if joints.is_empty() || joints.len() == found.gap.per_joint.len() => "all".to_owned(),
                    [one] => one.clone(),
                    [first, second] if first.len() + second.len() < JOINTS_WIDTH => format!("{first} {second}"),
                    joints => format!("{} +{}", joints[0], joints.len() - 1),
                },
                percent(c.shrink.predicted),
                format!("{}..{}", percent(c.shrink.low), percent(c.shrink.high)),
                percent(c.shrink.measured),
                percent(c.share),
                c.confidence.map_or_else(|| "-".to_owned(), |sure| format!("{sure:.2}")),
            ]);
        }
        out += &table.text();
        out += &values(found);
    }
    if found.gap.per_joint.is_empty() {
        return out;
    }
    let heads = ["gap by joint [%]", "nominal", "with causes", "noise", "in motion, nominal [x noise]", "with causes"];
    let mut table = Table::new(heads);
    let times = |j: &JointGap, at: usize| match j.in_motion.get(at) {
        Some(Some(times)) => figure(*times, 2),
        _ => "-".to_owned(),
    };
    for j in &found.gap.per_joint {
        let [before, after] = [0, 1].map(|at| times(j, at));
        table.row([j.joint.clone(), percent(j.before), percent(j.after), percent(j.noise_floor), before, after]);
    }
    out + &table.text()
}

/// The table of values, where the lines above have not all.
fn values(found: &Document) -> String {
    let rows = found.value_rows();
    if rows.is_empty() {
        return String::new();
    }
    let mut table = Table::new(["parameters", "file", "found", "90 %", "unit"]);
    for row in rows.iter().take(MOST_VALUES) {
        table.row(row.clone());
    }
    let more = rows.len().saturating_sub(MOST_VALUES);
    let rest = if more > 0 { format!("  and {more} more: --json and --html have all\n") } else { String::new() };
    table.text() + &rest
}

/// The weakest effects that these logs would have shown.
fn power(found: &Document, check: &SelfCheck) -> String {
    let mut out = paragraph(
        "  ",
        &format!(
            "weakest effect that {:.0} s of these logs would have shown (a dash: not even the strongest tried; \
             \"found\": in them as they are); {} false alarms in {} resamplings",
            check.seconds, check.false_alarms, check.resamplings
        ),
    );
    let smallest_found = |power: &Power| match (power.named_already, power.smallest) {
        (true, _) => "found".to_owned(),
        (false, Some(size)) => figure(size, 2),
        (false, None) => "-".to_owned(),
    };
    let joints = found.gap.per_joint.len();
    let heads = ["effect", "unit", "arm"].map(str::to_owned).into_iter();
    let heads = heads.chain((1..=joints).map(|j| format!("joint {j}")));
    let mut table = Table::new(heads);
    for chunk in check.powers.chunk_by(|a, b| a.effect == b.effect) {
        let mut cells = vec![effect(&chunk[0].effect), chunk[0].unit.clone()];
        // What acts on the whole arm stands before what acts on joints.
        cells.extend(chunk[0].joint.is_some().then(String::new));
        cells.extend(chunk.iter().map(&smallest_found));
        table.row(cells);
    }
    out += &table.text();
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use rivet_diagnosis::Past;

    /// A log that began at 4 s of its clock seems to follow a window of 3 s that began at 0 of another.
    #[test]
    fn a_live_window_is_not_on_the_clock_of_logs() {
        let run = || Run {
            name: String::new(),
            period_s: 1e-2,
            q: vec![(0..300).map(|k| 1e-2 * f64::from(k)).collect()],
            tau: vec![vec![0.0; 300]],
            ..Run::default()
        };
        let logs = || vec![(vec![run()], vec![4.0]), (vec![run()], vec![8.0]), (vec![run()], vec![0.0])];
        let apart = on_their_clocks(logs(), true);
        assert!(apart[0].past == Past::default() && apart[2].past == Past::default());
        assert_ne!(apart[1].past, Past::default(), "logs of one clock know each other");
        assert_ne!(on_their_clocks(logs(), false)[0].past, Past::default(), "as a file it would be before them");
    }
}
