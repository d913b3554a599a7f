//! `rivet identify`: base parameters of a robot from whole logs.

pub(crate) mod left_out;
mod not_excited;
pub(crate) mod open_keys;
mod rows;
mod said;

use std::collections::{BTreeMap, BTreeSet};
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result};
use rivet_config::{EstimatorKind, Identified, Robot};
use rivet_estimation::consistency::{ConsistencyError, Projection, Reference, project};
use rivet_estimation::offline::{
    self, Bias, Delay, Equations, Fit, InstrumentSource, Method, OfflineError, Parts, Rows, bias, fit, friction_share,
    parts, solve, torque_delay,
};
use rivet_logs::Log;
use rivet_studies::real::Found;

use crate::bounds::Bounded;
use crate::clock;
use crate::coarse::{
    NOT_ROUNDED_AGAIN, ROUNDED_AGAIN, TorqueSteps, coarse, coarse_torque, slow, that_matter, torque_steps,
};
use crate::compare::{self, Alone};
use crate::delays;
use crate::doubts;
use crate::evidence::{self, Distrust, Purpose};
use crate::exit::Fault;
use crate::export::export;
use crate::glitches::{bridged, screen};
use crate::jitter;
use crate::kinematics;
use crate::map::MapArgs;
use crate::outputs::Outputs;
use crate::predict;
use crate::progress::Progress;
use crate::reading;
use crate::refine::refine;
use crate::rounding;
use crate::runs::{self, Piece};
use crate::table::show;
use left_out::Sets;
use not_excited::NotExcited;
use open_keys::OpenKeys;

pub(crate) use rows::{rows_everywhere, rows_of, rows_without_plan};

/// The prior counts so many times weaker than on line: a whole record is at hand, and nominal values that are wrong (a
/// payload that the robot file does not know) must not pull for all of it. It settles what the motion leaves open.
pub(crate) const WEAKER_PRIOR: f64 = 10.0;

/// Arguments of `rivet identify`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Robot file: kinematics, nominal parameters, [signal] and [estimator].
    #[arg(value_name = "ROBOT.toml")]
    robot: PathBuf,
    /// Logs with positions and torque or current (docs/logs.md). Filters start anew in each.
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,
    /// Held-out log, on which the result is evaluated; may be given several times.
    #[arg(long, value_name = "LOG", conflicts_with_all = ["online", "compare"])]
    hold_out: Vec<PathBuf>,
    /// Also write the result as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write model.toml (robot file with the identified parameters), robot.urdf (physically consistent bodies) and
    /// not-expressible.md into this folder.
    #[arg(long, value_name = "DIR")]
    export: Option<PathBuf>,
    /// Run one log through the daemon's estimator, sample by sample, as `rivet replay` does.
    #[arg(long, conflicts_with = "export")]
    online: bool,
    /// First choose instruments or least squares and the friction law by cross-validation on parts of the logs.
    #[arg(long, conflicts_with_all = ["online", "compare"])]
    refine: bool,
    /// Fit every log separately and report whether they agree within their standard deviations.
    #[arg(long, conflicts_with_all = ["export", "online"])]
    compare: bool,
    /// With --online: write every published parameter set (CSV).
    #[arg(long, value_name = "FILE", requires = "online")]
    stream: Option<PathBuf>,
    #[command(flatten)]
    map: MapArgs,
}

/// What is taken of logs.
#[derive(Default)]
pub(crate) struct Taken {
    /// Stretches, and the rows of each.
    runs: Vec<Run>,
    pub(crate) rows: Vec<Rows>,
    /// What stands for the contents of each log.
    contents: Vec<u64>,
    /// Readings that were not taken.
    distrusts: Vec<Distrust>,
    /// Torques in steps.
    torque_steps: Vec<TorqueSteps>,
}

/// One stretch of a log.
struct Run {
    piece: Piece,
    source: InstrumentSource,
    /// Joints (from 0) that do not follow the log's desired motion.
    unfollowed: Vec<usize>,
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

fn choose<'a>(robot: &Robot, least_squares: &'a Fit, instrumental: &'a Fit) -> &'a Fit {
    match robot.config.estimator.kind {
        EstimatorKind::Riv | EstimatorKind::Energy => instrumental,
        EstimatorKind::Rls | EstimatorKind::RlsEnergy => least_squares,
    }
}

/// Identifies, prints, exports.
pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let robot = args.map.apply(rivet_config::load(&args.robot)?)?;
    let outputs = Outputs::beside(&robot, &args.robot, args.logs.iter().chain(&args.hold_out));
    let outputs = outputs.file("--json", args.json.as_ref()).file("--stream", args.stream.as_ref());
    outputs.export(args.export.as_ref()).check()?;
    if args.online {
        let [log] = args.logs.as_slice() else {
            return Err(Fault::Usage(format!("--online takes one log; {} are given", args.logs.len())).into());
        };
        return crate::online::run(&robot, log, args.stream.as_deref(), args.json.as_deref());
    }
    if robot.config.estimator.kind.energy() {
        return Err(Fault::Config(format!(
            "{}: [estimator] kind is an energy model, which learns sample by sample: use --online, rivet replay or rivetd, or set \
             kind to \"riv\" or \"rls\"",
            robot.config.path.display()
        ))
        .into());
    }
    let open = OpenKeys::choose(&robot, args.logs.iter().map(|path| runs::read_log(&robot, path)))?;
    let robot = open.robot.clone();
    if args.compare {
        return compare(&robot, args);
    }
    let refined = if args.refine { Some(refine(&robot, &read_logs(&robot, &args.logs)?)?) } else { None };
    let robot = refined.as_ref().map_or(robot, |refined| refined.robot.clone());
    let result = identify(&robot, &args.logs, &args.hold_out)?;
    show(&said::text(&robot, &result, &open))?;
    if let Some(refined) = &refined {
        show(&refined.text())?;
    }
    if let Some(path) = &args.json {
        let text =
            rivet_files::printable_json(format!("{:#}\n", said::to_json(&robot, &result, &open, refined.as_ref())));
        rivet_files::write_whole(path, &text).with_context(|| path.display().to_string())?;
        show(&format!("result written to {}\n", path.display()))?;
    }
    if let Some(folder) = &args.export {
        let fit = result.exported(&robot);
        let robot = Robot { not_excited: result.not_excited.text(), ..robot };
        export(&robot, &fit, &result.consistent, result.exports_consistent, &result.reference, folder)?;
        show(&format!("model written to {}\n", folder.join("model.toml").display()))?;
    }
    Ok(ExitCode::SUCCESS)
}

fn read_logs(robot: &Robot, logs: &[PathBuf]) -> Result<Vec<Log>> {
    logs.iter().map(|path| runs::read_log(robot, path)).collect()
}

/// The stretches of every log and their rows, filtered, and what stands for the contents of each log.
fn read_rows(robot: &Robot, logs: &[PathBuf]) -> Result<Taken> {
    let mut progress = Progress::new("identify: filtering", logs.len());
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

fn identify(robot: &Robot, logs: &[PathBuf], hold_out: &[PathBuf]) -> Result<Findings> {
    let Taken { runs, mut rows, contents, mut distrusts, torque_steps } = read_rows(robot, logs)?;
    enough(robot, &rows, logs)?;
    let prior = WEAKER_PRIOR * robot.config.estimator.prior;
    // Before a column is taken out that the robot file has a value for.
    let whole =
        robot.model.structure.load_friction.then(|| Equations::new(&rows).residual_percent(&robot.nominal_base));
    let of_logs = || logs.iter().map(|path| runs::short_name(path)).collect::<Vec<_>>().join(", ");
    // Whichever set predicts left-out rows better is exported; the held-out logs have no part in that.
    let sets = Sets::of(robot, &left_out::parts(by_log(&runs, &rows))).ok();
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
    let left = if method(robot) == Method::Instrumental { &residuals[2] } else { &residuals[1] };
    // Of a torque that is not believed anyway it is no news.
    let news = |d: &Distrust, said: &[Distrust]| !said.iter().any(|other| other.joint == d.joint);
    let unexplained: Vec<Distrust> =
        doubts::unexplained(&runs::joint_names(robot), left).into_iter().filter(|d| news(d, &distrusts)).collect();
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
    distrusts.extend(bounded.said(robot).filter(|d| !hardly.contains(&d.joint)));
    distrusts.extend(delays::distrust(&runs::joint_names(robot), &delays, &dry, rows_apart_s(&runs)));
    // A torque that is not believed has no arm either, but may be that of another joint; so may one that is not explained.
    let believed = !distrusts.iter().any(|d| ["torque_sign", "torque_scale"].contains(&d.name));
    if believed && distrusts.iter().all(|d| d.name != evidence::UNEXPLAINED_NAME) {
        distrusts.extend(doubts::far(consistent.as_ref().ok()));
    }
    let misread = kinematics::misread(robot, logs, &residuals[0])?;
    distrusts.extend(misread.or_else(|| kinematics::another_arm(robot, &residuals[0]).filter(|_| believed)));
    let pieces: Vec<&Piece> = runs.iter().map(|run| &run.piece).collect();
    distrusts.extend(jitter::warnings(robot, &chosen.values, left, &pieces)?);
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

/// Takes out of the rows what comes out as no arm has it, by the fit that counts.
fn bounded(robot: &Robot, rows: &mut [Rows], prior: f64) -> Result<Bounded, OfflineError> {
    Bounded::new(robot, rows, |equations, nominal| solve(equations, nominal, prior, method(robot)))
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

/// Fits every log on its own, and looks at each as if it were the only one.
fn compare(robot: &Robot, args: &Args) -> Result<ExitCode> {
    let (mut alone, mut known) = (Vec::new(), Vec::<(u64, String)>::new());
    for path in &args.logs {
        let name = runs::short_name(path);
        let found = identify(robot, std::slice::from_ref(path), &[]).with_context(|| path.display().to_string())?;
        let fit = found.chosen(robot).clone();
        let Findings { rows, mut distrusts, contents, .. } = found;
        let before = known.iter().find(|(content, _)| contents.contains(content));
        distrusts.extend(before.map(|(_, before)| evidence::repeated(name.clone(), before, Purpose::Comparing)));
        known.extend(contents.into_iter().map(|content| (content, name.clone())));
        let of_log = |d: Distrust| Distrust { log: Some(name.clone()), ..d };
        let distrusts = distrusts.into_iter().map(of_log).collect();
        alone.push(Alone { name, fit, rows, distrusts });
    }
    show(&compare::text(robot, &alone)?)?;
    if let Some(path) = &args.json {
        let text = rivet_files::printable_json(format!("{:#}\n", compare::to_json(robot, &alone)));
        rivet_files::write_whole(path, &text).with_context(|| path.display().to_string())?;
        show(&format!("result written to {}\n", path.display()))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// The fit that counts and the consistent parameters near it, of logs that were read already.
pub(crate) fn found(robot: &Robot, logs: &[Log]) -> Result<Found> {
    let robot = OpenKeys::choose(robot, logs.iter().map(|log| Ok(log.clone())))?.robot;
    let by_log: Vec<Vec<Rows>> = logs.iter().map(|log| Ok(rows_of(&robot, log)?.rows)).collect::<Result<_>>()?;
    let (fit, near) = fit_and_projection(&robot, by_log.iter().flatten().cloned().collect())?;
    let sets = Sets::of(&robot, &left_out::parts(by_log)).ok();
    Ok(Found {
        values: fit.values,
        consistent: near.base,
        exports_consistent: sets.is_some_and(|sets| sets.prefers_consistent()),
        condition: fit.condition,
        robot,
    })
}

/// Physically consistent standard parameters near the fit that counts, of logs that were read already.
pub(crate) fn consistent(robot: &Robot, logs: &[Log]) -> Result<Vec<f64>> {
    let mut rows = Vec::new();
    for log in logs {
        rows.extend(rows_of(robot, log)?.rows);
    }
    Ok(fit_and_projection(robot, rows)?.1.standard)
}

fn fit_and_projection(robot: &Robot, mut rows: Vec<Rows>) -> Result<(Fit, Projection)> {
    let prior = WEAKER_PRIOR * robot.config.estimator.prior;
    let bounded = bounded(robot, &mut rows, prior)?;
    let equations = Equations::new(&rows);
    let mut fit = fit(&equations, &bounded.nominal, prior, method(robot))?;
    bounded.hold(&mut fit);
    let reference = equations.reference();
    let near = project(&robot.model, &robot.base, &fit.values, &fit.covariance, &robot.nominal, &reference)?;
    Ok((fit, near))
}

/// The values of the fit that counts, of rows.
pub(crate) fn values_of(robot: &Robot, rows: &mut [Rows]) -> Result<Vec<f64>> {
    let prior = WEAKER_PRIOR * robot.config.estimator.prior;
    let bounded = bounded(robot, rows, prior)?;
    match bounded.values {
        Some(values) => Ok(values),
        None => Ok(solve(&Equations::new(rows), &bounded.nominal, prior, method(robot))?),
    }
}

fn method(robot: &Robot) -> Method {
    if robot.config.estimator.kind == EstimatorKind::Riv { Method::Instrumental } else { Method::LeastSquares }
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
    let with = |values: Option<&[f64]>| {
        let of = |values: &[f64]| Identified { values: values.to_vec(), std: vec![0.0; values.len()] };
        Robot { identified: values.map(of), ..robot.clone() }
    };
    let (nominal, trained, near) = (with(None), with(Some(values)), consistent.map(|values| with(Some(values))));
    let mut of = |path: &PathBuf| -> Result<Option<HeldOut>> {
        let log = runs::read_log(robot, path)?;
        let sound = screen(robot, &log)?;
        let errors = |robot: &Robot| predict::errors(robot, &sound);
        let (file, content) = (path.display().to_string(), content(&log)?);
        let [Some(nominal), Some(identified)] = [errors(&nominal)?, errors(&trained)?] else {
            distrusts.push(evidence::left_out(runs::short_name(path), Purpose::Judging));
            return Ok(None);
        };
        let consistent = near.as_ref().map(errors).transpose()?.flatten();
        let held = HeldOut { file, content, nominal, identified, consistent };
        distrusts.extend(sound.found);
        distrusts.extend(clock::off(robot, &sound.log));
        distrusts.extend(slow(robot, &sound.log));
        distrusts.extend(coarse(robot, &sound.log).iter().flat_map(|coarse| coarse.said(robot)));
        Ok(Some(held))
    };
    logs.iter().filter_map(|path| of(path).transpose()).collect()
}
