//! Base parameters of a robot from whole logs.

mod report;

use std::collections::{BTreeMap, BTreeSet};
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use rivet_config::{Identified, Robot};
use rivet_estimation::consistency::{ConsistencyError, Projection, Reference, project};
use rivet_estimation::offline::{
    self, Bias, Delay, Equations, Fit, Method, OfflineError, Parts, Rows, bias, fit, friction_share, parts,
    torque_delay,
};
use rivet_logs::Log;
use serde_json::Value;

use crate::clock;
use crate::coarse::{NOT_ROUNDED_AGAIN, ROUNDED_AGAIN, coarse, coarse_torque, slow, that_matter, torque_steps};
use crate::compare::{self, Alone};
use crate::delays;
use crate::doubts;
use crate::evidence::{self, Distrust, Purpose};
use crate::export::export;
use crate::fault::Fault;
use crate::fit::{WEAKER_PRIOR, bounded, choose, fit_and_projection, method};
use crate::glitches::{bridged, screen};
use crate::gravity_free::GravityFree;
use crate::jitter;
use crate::kinematics;
use crate::left_out::{self, Sets};
use crate::not_excited::NotExcited;
use crate::open_keys::OpenKeys;
use crate::predict;
use crate::progress::Progress;
use crate::reading;
use crate::refine::{Refined, refine};
use crate::rounding;
use crate::rows::{Run, Taken, rows_of};
use crate::runs::{self, Piece};
use crate::session;

/// Options of an identification other than those of the fit.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Logs on which the result is evaluated.
    pub held_out: Vec<PathBuf>,
    /// Whether the method and the friction law are first chosen by cross-validation on parts of the logs.
    pub refine: bool,
}

/// Identified base parameters with all that is reported with them.
pub struct Identification {
    /// The robot with the keys that were chosen from the logs, and no identified values.
    robot: Robot,
    open: OpenKeys,
    refined: Option<Refined>,
    findings: Findings,
}

/// Identifies the base parameters of `robot` from `logs`. Filters start anew in each log.
///
/// # Errors
/// A log cannot be read or does not fit the robot, an energy model is asked for, or nothing moves.
pub fn identify(robot: &Robot, logs: &[PathBuf], options: &Options) -> Result<Identification> {
    let gravity_free = GravityFree::find(robot, logs.iter().chain(&options.held_out))?;
    let mut open = choose_keys(gravity_free.as_ref().map_or(robot, |found| &found.robot), logs)?;
    let mut robot = open.robot.clone();
    let mut refined = if options.refine { Some(refine(&robot, &read_logs(&robot, logs)?)?) } else { None };
    if let Some(refined) = &refined {
        robot = refined.robot.clone();
    }
    let mut findings = findings(&robot, logs, &options.held_out)?;
    if let Some(found) = gravity_free {
        // The fit was that of the arm without gravity. Its parameters are those of the arm.
        for robot in [&mut robot, &mut open.robot].into_iter().chain(refined.as_mut().map(|refined| &mut refined.robot))
        {
            *robot = found.restore(robot);
        }
        findings.distrusts.insert(0, found.finding);
    }
    Ok(Identification { robot, open, refined, findings })
}

/// Values of the keys that the robot file leaves to the logs.
fn choose_keys(robot: &Robot, logs: &[PathBuf]) -> Result<OpenKeys> {
    if robot.config.estimator.kind.energy() {
        return Err(Fault::Config(format!(
            "{}: [estimator] kind is an energy model, which learns sample by sample: use --online, rivet replay or rivetd, or set \
             kind to \"riv\" or \"rls\"",
            robot.config.path.display()
        ))
        .into());
    }
    OpenKeys::choose(robot, logs.iter().map(|path| runs::read_log(robot, path)))
}

impl Identification {
    /// The robot as it was identified: file, friction law and keys chosen from the logs.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// The fit that counts: by instruments, unless the robot file asks for least squares.
    pub fn fit(&self) -> &Fit {
        self.findings.chosen(&self.robot)
    }

    /// The robot with the values that [`Identification::export`] writes as its identified parameters.
    pub fn model(&self) -> Robot {
        let fit = self.findings.exported(&self.robot);
        Robot { identified: Some(Identified { values: fit.values, std: fit.std }), ..self.annotated() }
    }

    /// Writes model.toml, robot.urdf and not-expressible.md into `folder`.
    ///
    /// # Errors
    /// A file cannot be written, or the URDF cannot be read again.
    pub fn export(&self, folder: &Path) -> Result<()> {
        let Findings { consistent, exports_consistent, reference, .. } = &self.findings;
        let fit = self.findings.exported(&self.robot);
        export(&self.annotated(), &fit, consistent, *exports_consistent, reference, folder)
    }

    /// The report as text.
    pub fn text(&self) -> String {
        let mut text = report::text(&self.robot, &self.findings, &self.open);
        if let Some(refined) = &self.refined {
            text += &refined.text();
        }
        text
    }

    /// The report as JSON.
    pub fn to_json(&self) -> Value {
        report::to_json(&self.robot, &self.findings, &self.open, self.refined.as_ref())
    }

    /// The robot with the parameters that the logs did not excite.
    fn annotated(&self) -> Robot {
        Robot { not_excited: self.findings.not_excited.text(), ..self.robot.clone() }
    }
}

/// Fits of single logs side by side.
pub struct Comparison {
    robot: Robot,
    alone: Vec<Alone>,
}

/// Identifies the parameters from each of `logs` as if it were the only one.
///
/// # Errors
/// As [`identify`].
pub fn identify_each(robot: &Robot, logs: &[PathBuf]) -> Result<Comparison> {
    let gravity_free = GravityFree::find(robot, logs)?;
    let robot = choose_keys(gravity_free.as_ref().map_or(robot, |found| &found.robot), logs)?.robot;
    let (mut alone, mut known) = (Vec::new(), Vec::<(u64, String)>::new());
    for path in logs {
        let name = runs::short_name(path);
        let found = findings(&robot, std::slice::from_ref(path), &[]).with_context(|| path.display().to_string())?;
        let fit = found.chosen(&robot).clone();
        let Findings { rows, mut distrusts, contents, .. } = found;
        let before = known.iter().find(|(content, _)| contents.contains(content));
        distrusts.extend(before.map(|(_, before)| evidence::repeated(name.clone(), before, Purpose::Comparing)));
        known.extend(contents.into_iter().map(|content| (content, name.clone())));
        let stated = gravity_free.as_ref().map(|found| found.finding.clone());
        let of_log = |d: Distrust| Distrust { log: Some(name.clone()), ..d };
        let distrusts = distrusts.into_iter().chain(stated.clone()).map(of_log).collect();
        alone.push(Alone { name, fit, rows, distrusts });
    }
    let robot = gravity_free.map_or(robot.clone(), |found| found.restore(&robot));
    Ok(Comparison { robot, alone })
}

impl Comparison {
    /// The comparison as text.
    ///
    /// # Errors
    /// Fewer than two logs.
    pub fn text(&self) -> Result<String> {
        compare::text(&self.robot, &self.alone)
    }

    /// The comparison as JSON.
    pub fn to_json(&self) -> Value {
        compare::to_json(&self.robot, &self.alone)
    }
}

/// Errors on a log that was not learnt from: `100*|tau-pred|/|tau|` per joint below the model filter's cut-off \[%\].
struct HeldOut {
    file: String,
    content: u64,
    nominal: Vec<f64>,
    identified: Vec<f64>,
    /// Those of the physically consistent set, where there is one.
    consistent: Option<Vec<f64>>,
}

impl HeldOut {
    /// How much more of the torque the consistent set misses than the free one, rms over joints \[points of %\]. Of torque that is not
    /// known nothing is missed.
    fn cost(&self) -> Option<f64> {
        let rms = |of: &[f64]| {
            let known: Vec<f64> = of.iter().copied().filter(|p| p.is_finite()).collect();
            (known.iter().map(|p| p * p).sum::<f64>() / known.len() as f64).sqrt()
        };
        let cost = rms(self.consistent.as_ref()?) - rms(&self.identified);
        cost.is_finite().then_some(cost)
    }
}

/// Everything that was found.
struct Findings {
    runs: Vec<Run>,
    /// Rows of each run.
    rows: Vec<Rows>,
    least_squares: Fit,
    instrumental: Fit,
    /// Residuals per joint \[%\]: nominal, least squares, instrumental.
    residuals: [Vec<f64>; 3],
    /// What values from some of the rows leave of the others.
    parts: Parts,
    /// What sets least squares and instruments apart.
    bias: Bias,
    /// How late torque is behind position, per joint.
    delays: Vec<Delay>,
    /// Share of dry friction in the torque, per joint.
    dry: Vec<f64>,
    /// All rows as sums.
    reference: Reference,
    /// Physically consistent parameters near those of the fit that counts.
    consistent: Result<Projection, ConsistencyError>,
    /// Errors of both sets on left-out parts of the logs; none where no part can be left out.
    sets: Option<Sets>,
    /// Whether the physically consistent parameters are exported.
    exports_consistent: bool,
    not_excited: NotExcited,
    held_out: Vec<HeldOut>,
    /// What stands for the contents of each log.
    contents: Vec<u64>,
    /// Torques that cannot be believed.
    distrusts: Vec<Distrust>,
}

impl Findings {
    /// The fit that counts: instruments, unless the robot file asks for least squares.
    fn chosen(&self, robot: &Robot) -> &Fit {
        choose(robot, &self.least_squares, &self.instrumental)
    }

    /// The fit with the values that are exported.
    fn exported(&self, robot: &Robot) -> Fit {
        let mut fit = self.chosen(robot).clone();
        if let Some(near) = self.consistent.as_ref().ok().filter(|_| self.exports_consistent) {
            fit.values.clone_from(&near.base);
        }
        fit
    }
}

fn read_logs(robot: &Robot, logs: &[PathBuf]) -> Result<Vec<Log>> {
    logs.iter().map(|path| runs::read_log(robot, path)).collect()
}

/// The stretches of every log and their rows, filtered, and what stands for the contents of each log.
fn read_rows(robot: &Robot, logs: &[PathBuf]) -> Result<Taken> {
    let mut progress = Progress::new("filtering logs", logs.len());
    let (mut all, mut still) = (Taken::default(), None);
    for (k, path) in logs.iter().enumerate() {
        progress.set(k);
        let log = runs::read_log(robot, path)?;
        all.contents.push(content(&log)?);
        let taken = match rows_of(robot, &log) {
            Err(why) if without_motion(&why) => {
                all.distrusts.push(evidence::left_out(runs::short_name(path), Purpose::Learning));
                still.get_or_insert(why);
                continue;
            }
            taken => taken?,
        };
        all.runs.extend(taken.runs);
        all.rows.extend(taken.rows);
        all.distrusts.extend(taken.distrusts);
        all.distrusts.extend(reading::distrust(robot, &log));
        all.torque_steps.extend(torque_steps(&log));
    }
    progress.done();
    match still {
        // Nothing else is there to learn from.
        Some(why) if all.rows.is_empty() => Err(why),
        _ => Ok(all),
    }
}

/// Whether a log is refused because no joint moves in it.
fn without_motion(why: &anyhow::Error) -> bool {
    matches!(why.downcast_ref::<OfflineError>(), Some(OfflineError::NoMotion { .. }))
}

/// The rows of each log, of runs in the order of the logs.
fn by_log(runs: &[Run], rows: &[Rows]) -> Vec<Vec<Rows>> {
    let mut found = Vec::<(&Path, Vec<Rows>)>::new();
    for (run, rows) in runs.iter().zip(rows) {
        let path = run.piece.grid.path.as_path();
        match found.last_mut() {
            Some((before, all)) if *before == path => all.push(rows.clone()),
            _ => found.push((path, vec![rows.clone()])),
        }
    }
    found.into_iter().map(|(_, rows)| rows).collect()
}

/// Two logs of the same positions and torques have the same, whatever they are called.
fn content(log: &Log) -> Result<u64> {
    let mut hasher = DefaultHasher::new();
    for signal in log.q.iter().chain(log.torque()?) {
        signal.len().hash(&mut hasher);
        for x in signal {
            x.to_bits().hash(&mut hasher);
        }
    }
    Ok(hasher.finish())
}

/// Logs that are there twice, among those learnt from or as one held out.
fn repeated(logs: &[PathBuf], contents: &[u64], held_out: &[HeldOut]) -> Vec<Distrust> {
    let name = |k: usize| runs::short_name(&logs[k]);
    let first = |content: &u64| contents.iter().position(|c| c == content);
    let again = contents.iter().enumerate().filter_map(|(k, content)| Some((k, first(content).filter(|f| *f < k)?)));
    let mut found: Vec<Distrust> =
        again.map(|(k, before)| evidence::repeated(name(k), &name(before), Purpose::Learning)).collect();
    let learnt = held_out.iter().filter_map(|held| Some((held, first(&held.content)?)));
    found.extend(
        learnt.map(|(held, k)| evidence::repeated(runs::short_name(Path::new(&held.file)), &name(k), Purpose::Judging)),
    );
    found
}

fn findings(robot: &Robot, logs: &[PathBuf], hold_out: &[PathBuf]) -> Result<Findings> {
    let Taken { runs, mut rows, contents, mut distrusts, torque_steps } = read_rows(robot, logs)?;
    enough(robot, &rows, logs)?;
    session::checkpoint("identify: fitting", 0.0);
    let prior = WEAKER_PRIOR * robot.config.estimator.prior;
    // Before a column is taken out that the robot file has a value for.
    let whole =
        robot.model.structure.load_friction.then(|| Equations::new(&rows).residual_percent(&robot.nominal_base));
    let of_logs = || logs.iter().map(|path| runs::short_name(path)).collect::<Vec<_>>().join(", ");
    // Whichever set predicts left-out rows better is exported; the held-out logs have no part in that.
    let sets = Sets::fit(robot, &left_out::parts(by_log(&runs, &rows))).ok();
    session::checkpoint("identify: fitting", 0.2);
    let bounded = bounded(robot, &mut rows, prior).with_context(of_logs)?;
    let nominal = &bounded.nominal;
    let equations = Equations::new(&rows);
    let by = |method| {
        let mut found = fit(&equations, nominal, prior, method)?;
        bounded.hold(&mut found);
        Ok::<Fit, OfflineError>(found)
    };
    let (least_squares, instrumental) = rayon::join(|| by(Method::LeastSquares), || by(Method::Instrumental));
    let mut least_squares = least_squares.with_context(of_logs)?;
    let mut instrumental = instrumental.with_context(of_logs)?;
    let chosen = choose(robot, &least_squares, &instrumental);
    session::checkpoint("identify: fitting", 0.4);
    let torque_steps = that_matter(&torque_steps, &chosen.noise);
    // Where the torque of rounded rows cannot be predicted, nobody knows.
    let moved = rounding::moved(robot, logs, &torque_steps, &chosen.values);
    let known = if moved.is_ok() { ROUNDED_AGAIN } else { NOT_ROUNDED_AGAIN };
    let moved = moved.unwrap_or_default();
    for fit in [&mut least_squares, &mut instrumental] {
        fit.add_errors(&moved);
    }
    let [by_least_squares, by_instruments] =
        [&least_squares, &instrumental].map(|fit| equations.residual_percent(&fit.values));
    let as_given = whole.unwrap_or_else(|| equations.residual_percent(nominal));
    let mut residuals = [as_given, by_least_squares, by_instruments];
    let still = still(&rows);
    for percent in &mut residuals {
        for &j in still.iter().chain(&offline::brief(&rows)) {
            percent[j] = f64::NAN;
        }
    }
    let chosen = choose(robot, &least_squares, &instrumental);
    let reference = equations.reference();
    // Weak instruments bend with each part of the motion: whether the arm is another one least squares tell.
    let plainly = (method(robot) == Method::Instrumental).then_some(&least_squares);
    let ((bias, delays), (consistent, (parts, plain_parts))) = rayon::join(
        || (bias(&equations, nominal, prior, chosen), torque_delay(&equations, nominal, prior, chosen)),
        || {
            rayon::join(
                || project(&robot.model, &robot.base, &chosen.values, &chosen.covariance, &robot.nominal, &reference),
                || {
                    let of_plain = |fit| parts(&equations, nominal, prior, fit, Method::LeastSquares);
                    (parts(&equations, nominal, prior, chosen, method(robot)), plainly.map(of_plain))
                },
            )
        },
    );
    let (bias, delays) = (bias?, delays?);
    session::checkpoint("identify: fitting", 0.6);
    let dry = friction_share(&robot.model, &robot.base, chosen, &rows);
    let near = consistent.as_ref().ok().map(|projection| projection.base.as_slice());
    // Logs in which joints stand do not determine those joints' torque, and no row shows it.
    let unseen: Vec<&PathBuf> = if still.is_empty() { Vec::new() } else { logs.iter().collect() };
    let excessive = |values: &[f64], logs: &[&PathBuf]| excessive(robot, values, logs);
    let exports_consistent = match near {
        Some(_) if sets.as_ref().is_some_and(Sets::prefers_consistent) => true,
        Some(near) if !unseen.is_empty() => {
            !excessive(&chosen.values, &unseen)?.is_empty() && excessive(near, &unseen)?.is_empty()
        }
        _ => false,
    };
    let exported = near.filter(|_| exports_consistent).unwrap_or(&chosen.values);
    let judged: Vec<&PathBuf> = unseen.into_iter().chain(hold_out).collect();
    distrusts.extend(excessive(exported, &judged)?);
    let held_out = held_out(robot, &chosen.values, near, hold_out, &mut distrusts)?;
    let named = runs.iter().map(|run| runs::short_name(&run.piece.grid.path)).zip(&rows);
    distrusts.extend(repeated(logs, &contents, &held_out));
    for (path, joints) in unfollowed_of(&runs) {
        distrusts.extend(evidence::unfollowed(robot, &runs::short_name(path), &joints));
    }
    distrusts.extend(doubts::still(robot, &still));
    let not_excited = NotExcited::new(robot, chosen, &still);
    distrusts.extend(doubts::brief(robot, &rows));
    distrusts.extend(doubts::short(robot, &rows));
    distrusts.extend(evidence::distrusts(robot, named, chosen, &rows));
    let residual = if method(robot) == Method::Instrumental { &residuals[2] } else { &residuals[1] };
    // Of a torque that is not believed anyway it is no news.
    let news = |d: &Distrust, said: &[Distrust]| !said.iter().any(|other| other.joint == d.joint);
    let unexplained: Vec<Distrust> =
        doubts::unexplained(&runs::joint_names(robot), residual).into_iter().filter(|d| news(d, &distrusts)).collect();
    distrusts.extend(unexplained);
    distrusts.extend(doubts::carries_not_over(&runs::joint_names(robot), &residuals[0], &parts.left_out));
    let constant: Vec<Distrust> = doubts::constant(robot, (&rows, &equations), nominal, prior, chosen)?
        .into_iter()
        .filter(|d| news(d, &distrusts))
        .collect();
    // Said before halves are compared: each follows its own rounding, and that is no other arm.
    distrusts.extend(coarse_torque(robot, &torque_steps, known));
    let changed = doubts::changed(&runs::joint_names(robot), plain_parts.as_ref().unwrap_or(&parts), &distrusts);
    distrusts.extend(changed);
    distrusts.extend(constant);
    if method(robot) == Method::Instrumental {
        distrusts.extend(doubts::misled(&runs::joint_names(robot), &residuals));
    }
    let hardly: Vec<Option<String>> = doubts::brief(robot, &rows).into_iter().map(|d| d.joint).collect();
    distrusts.extend(bounded.distrusts(robot).filter(|d| !hardly.contains(&d.joint)));
    distrusts.extend(delays::distrust(&runs::joint_names(robot), &delays, &dry, rows_apart_s(&runs)));
    // A torque that is not believed has no arm either, but may be that of another joint; so may one that is not explained.
    let believed = !distrusts.iter().any(|d| ["torque_sign", "torque_scale"].contains(&d.name));
    if believed && distrusts.iter().all(|d| d.name != evidence::UNEXPLAINED_NAME) {
        distrusts.extend(doubts::far(consistent.as_ref().ok()));
    }
    session::checkpoint("identify: comparing readings", 0.8);
    let misread = kinematics::misread(robot, logs, &residuals[0])?;
    distrusts.extend(misread.or_else(|| kinematics::another_arm(robot, &residuals[0]).filter(|_| believed)));
    let pieces: Vec<&Piece> = runs.iter().map(|run| &run.piece).collect();
    distrusts.extend(jitter::warnings(robot, &chosen.values, residual, &pieces)?);
    reading::first(&mut distrusts);
    Ok(Findings {
        runs,
        rows,
        least_squares,
        instrumental,
        residuals,
        parts,
        bias,
        delays,
        dry,
        reference,
        consistent,
        sets,
        exports_consistent,
        not_excited,
        held_out,
        contents,
        distrusts,
    })
}

/// Refuses fewer rows than parameters: whatever solves them leaves nothing, and means nothing.
fn enough(robot: &Robot, rows: &[Rows], logs: &[PathBuf]) -> Result<()> {
    let count: usize = rows.iter().map(|r| (0..robot.dof()).map(|j| r.count(j)).sum::<usize>()).sum();
    if count >= robot.base.len() {
        return Ok(());
    }
    let names: Vec<String> = logs.iter().map(|log| log.display().to_string()).collect();
    Err(Fault::Data(format!(
        "{}: {count} rows of torque in motion for {} parameters: almost nothing moves, so nothing is learnt",
        names.join(", "),
        robot.base.len()
    ))
    .into())
}

/// Joints (from 0) that do not move in any of the rows.
fn still(rows: &[Rows]) -> Vec<usize> {
    let joints = rows.first().map_or(0, |r| r.left_out.len());
    (0..joints).filter(|j| rows.iter().all(|r| r.count(*j) == 0)).collect()
}

/// The longest usual step of the logs \[s\].
fn rows_apart_s(runs: &[Run]) -> f64 {
    runs.iter().map(|run| run.piece.report.median_step_s).fold(0.0, f64::max)
}

/// Joints that do not follow the desired motion, log by log, over all pieces of each.
fn unfollowed_of(runs: &[Run]) -> BTreeMap<&Path, BTreeSet<usize>> {
    let mut found = BTreeMap::<&Path, BTreeSet<usize>>::new();
    for run in runs {
        found.entry(&run.piece.grid.path).or_default().extend(&run.unfollowed);
    }
    found
}

/// The fit that counts of logs that were read before, with the consistent parameters near it.
pub struct LogFit {
    /// The robot with the keys that were chosen from the logs.
    pub robot: Robot,
    /// Base parameters of the fit.
    pub values: Vec<f64>,
    /// Base parameters of the physically consistent set.
    pub consistent: Vec<f64>,
    /// Whether the consistent set predicts left-out parts of the logs better.
    pub exports_consistent: bool,
    /// Condition number of the fit.
    pub condition: f64,
}

/// Fits the base parameters to logs that were read before.
///
/// # Errors
/// A log has no torque or no motion, or no consistent set is found.
pub fn fit_logs(robot: &Robot, logs: &[Log]) -> Result<LogFit> {
    let robot = OpenKeys::choose(robot, logs.iter().map(|log| Ok(log.clone())))?.robot;
    let by_log: Vec<Vec<Rows>> = logs.iter().map(|log| Ok(rows_of(&robot, log)?.rows)).collect::<Result<_>>()?;
    let (fit, near) = fit_and_projection(&robot, by_log.iter().flatten().cloned().collect())?;
    let sets = Sets::fit(&robot, &left_out::parts(by_log)).ok();
    Ok(LogFit {
        values: fit.values,
        consistent: near.base,
        exports_consistent: sets.is_some_and(|sets| sets.prefers_consistent()),
        condition: fit.condition,
        robot,
    })
}

/// Physically consistent standard parameters near the fit that counts, of logs that were read already.
///
/// # Errors
/// As [`fit_logs`].
pub fn consistent(robot: &Robot, logs: &[Log]) -> Result<Vec<f64>> {
    let mut rows = Vec::new();
    for log in logs {
        rows.extend(rows_of(robot, log)?.rows);
    }
    Ok(fit_and_projection(robot, rows)?.1.standard)
}

/// Warnings of joints whose predicted torque no drive gives, on whole logs with their rows at standstill.
fn excessive(robot: &Robot, values: &[f64], logs: &[&PathBuf]) -> Result<Vec<Distrust>> {
    let identified = Identified { values: values.to_vec(), std: vec![0.0; values.len()] };
    let robot = Robot { identified: Some(identified), ..robot.clone() };
    let mut found = Vec::new();
    for path in logs {
        let log = runs::read_log(&robot, path)?;
        let (log, _) = bridged(&robot, log)?;
        found.extend(predict::excessive(&robot, &log, &predict::along(&robot, &log)?));
    }
    Ok(found)
}

/// Errors of the identified parameters, and of the consistent ones, on logs that had no part in them.
fn held_out(
    robot: &Robot,
    values: &[f64],
    consistent: Option<&[f64]>,
    logs: &[PathBuf],
    distrusts: &mut Vec<Distrust>,
) -> Result<Vec<HeldOut>> {
    let with_values = |values: Option<&[f64]>| {
        let identified_by = |values: &[f64]| Identified { values: values.to_vec(), std: vec![0.0; values.len()] };
        Robot { identified: values.map(identified_by), ..robot.clone() }
    };
    let (nominal, trained, near) =
        (with_values(None), with_values(Some(values)), consistent.map(|values| with_values(Some(values))));
    let mut errors_on = |path: &PathBuf| -> Result<Option<HeldOut>> {
        let log = runs::read_log(robot, path)?;
        let sound = screen(robot, &log)?;
        let errors = |robot: &Robot| predict::errors(robot, &sound);
        let (file, content) = (path.display().to_string(), content(&log)?);
        let [Some(nominal), Some(identified)] = [errors(&nominal)?, errors(&trained)?] else {
            distrusts.push(evidence::left_out(runs::short_name(path), Purpose::Judging));
            return Ok(None);
        };
        let consistent = near.as_ref().map(errors).transpose()?.flatten();
        let log_errors = HeldOut { file, content, nominal, identified, consistent };
        distrusts.extend(sound.found);
        distrusts.extend(clock::off(robot, &sound.log));
        distrusts.extend(slow(robot, &sound.log));
        distrusts.extend(coarse(robot, &sound.log).iter().flat_map(|coarse| coarse.distrusts(robot)));
        Ok(Some(log_errors))
    };
    logs.iter().filter_map(|path| errors_on(path).transpose()).collect()
}
