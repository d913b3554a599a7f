//! `rivet identify`: base parameters of a robot from whole logs.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result};
use rivet_config::{EstimatorKind, Identified, Instruments, Robot};
use rivet_estimation::consistency::{ConsistencyError, Projection, Reference, project};
use rivet_estimation::offline::{
    Bias, Delay, Determined, Equations, Fit, InstrumentSource, Method, OfflineError, Rows, bias, fit, solve,
    torque_delay, unfollowed,
};
use rivet_logs::Log;
use rivet_studies::real::Found;
use serde_json::{Value, json};

use crate::compare::{self, Alone};
use crate::evidence::{self, Compared, Distrust};
use crate::exit::Fault;
use crate::export::export;
use crate::glitches::screen;
use crate::predict;
use crate::progress::Progress;
use crate::refine::refine;
use crate::runs::{self, Piece};
use crate::table::{Table, number, paragraph, show};

/// The prior counts so many times weaker than on line: a whole record is at hand, and nominal values that are wrong (a
/// payload that the robot file does not know) must not pull for all of it. It settles what the motion leaves open.
const WEAKER_PRIOR: f64 = 10.0;

/// Arguments of `rivet identify`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Robot file: kinematics, nominal parameters, [signal] and [estimator].
    #[arg(value_name = "ROBOT.toml")]
    robot: PathBuf,
    /// Logs with positions and torque or current (Parquet or CSV). Each keeps its own edges.
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,
    /// A log that is not learnt from, on which the result is judged; may be given several times.
    #[arg(long, value_name = "LOG", conflicts_with = "online")]
    hold_out: Vec<PathBuf>,
    /// Also write the result as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write model.toml (robot file with the identified parameters), robot.urdf (physically consistent bodies) and
    /// not-expressible.md into this folder.
    #[arg(long, value_name = "DIR")]
    export: Option<PathBuf>,
    /// Replay one log through the daemon's estimator instead, sample by sample: what `rivet replay` gives.
    #[arg(long, conflicts_with = "export")]
    online: bool,
    /// Choose instruments or least squares and the law of friction first: what predicts best the parts of the logs that it
    /// was not fitted to.
    #[arg(long, conflicts_with_all = ["online", "compare"])]
    refine: bool,
    /// Fit every log on its own and tell whether they agree within their standard deviations.
    #[arg(long, conflicts_with_all = ["export", "online"])]
    compare: bool,
    /// With --online: write every published parameter set (CSV).
    #[arg(long, value_name = "FILE", requires = "online")]
    stream: Option<PathBuf>,
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
    /// What sets least squares and instruments apart.
    bias: Bias,
    /// How late torque is behind position, per joint.
    delays: Vec<Delay>,
    /// All rows as sums.
    reference: Reference,
    /// Physically consistent parameters near those of the fit that counts.
    consistent: Result<Projection, ConsistencyError>,
    held_out: Vec<HeldOut>,
    /// Torques that cannot be believed.
    distrusts: Vec<Distrust>,
}

impl Findings {
    /// The fit that counts: instruments, unless the robot file asks for least squares.
    fn chosen(&self, robot: &Robot) -> &Fit {
        choose(robot, &self.least_squares, &self.instrumental)
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
    let robot = rivet_config::load(&args.robot)?;
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
    if args.compare {
        return compare(&robot, args);
    }
    let refined = if args.refine { Some(refine(&robot, &read_logs(&robot, &args.logs)?)?) } else { None };
    let robot = refined.as_ref().map_or(robot, |refined| refined.robot.clone());
    let result = identify(&robot, &args.logs, &args.hold_out)?;
    show(&text(&robot, &result))?;
    if let Some(refined) = &refined {
        show(&refined.text())?;
    }
    if let Some(path) = &args.json {
        let text = format!("{:#}\n", to_json(&robot, &result));
        runs::write_whole(path, &text).with_context(|| path.display().to_string())?;
        show(&format!("result written to {}\n", path.display()))?;
    }
    if let Some(folder) = &args.export {
        export(&robot, result.chosen(&robot), &result.consistent, &result.reference, folder)?;
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
    let mut all = Taken::default();
    for (k, path) in logs.iter().enumerate() {
        progress.set(k);
        let log = runs::read_log(robot, path)?;
        let taken = rows_of(robot, &log)?;
        all.contents.push(content(&log)?);
        all.runs.extend(taken.runs);
        all.rows.extend(taken.rows);
        all.distrusts.extend(taken.distrusts);
    }
    progress.done();
    Ok(all)
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
    let mut found: Vec<Distrust> = again.map(|(k, before)| evidence::repeated(name(k), &name(before), false)).collect();
    let learnt = held_out.iter().filter_map(|held| Some((held, first(&held.content)?)));
    found.extend(learnt.map(|(held, k)| evidence::repeated(runs::short_name(Path::new(&held.file)), &name(k), true)));
    found
}

fn identify(robot: &Robot, logs: &[PathBuf], hold_out: &[PathBuf]) -> Result<Findings> {
    let Taken { runs, rows, contents, mut distrusts } = read_rows(robot, logs)?;
    let prior = WEAKER_PRIOR * robot.config.estimator.prior;
    let equations = Equations::new(&rows);
    let by = |method| fit(&equations, &robot.nominal_base, prior, method);
    let (least_squares, instrumental) = rayon::join(|| by(Method::LeastSquares), || by(Method::Instrumental));
    let (least_squares, instrumental) = (least_squares?, instrumental?);
    let residuals =
        [&robot.nominal_base, &least_squares.values, &instrumental.values].map(|x| equations.residual_percent(x));
    let chosen = choose(robot, &least_squares, &instrumental);
    let reference = equations.reference();
    let ((bias, delays), consistent) = rayon::join(
        || {
            let nominal = &robot.nominal_base;
            (bias(&equations, nominal, prior, chosen), torque_delay(&equations, nominal, prior, chosen))
        },
        || project(&robot.model, &robot.base, &chosen.values, &chosen.covariance, &robot.nominal, &reference),
    );
    let (bias, delays) = (bias?, delays?);
    let held_out = held_out(robot, &chosen.values, hold_out, &mut distrusts)?;
    let named = runs.iter().map(|run| runs::short_name(&run.piece.grid.path)).zip(&rows);
    distrusts.extend(repeated(logs, &contents, &held_out));
    for (path, joints) in unfollowed_of(&runs) {
        distrusts.extend(evidence::unfollowed(robot, &runs::short_name(path), &joints));
    }
    distrusts.extend(evidence::distrusts(robot, named, chosen, &rows));
    Ok(Findings {
        runs,
        rows,
        least_squares,
        instrumental,
        residuals,
        bias,
        delays,
        reference,
        consistent,
        held_out,
        distrusts,
    })
}

/// Joints that do not follow the desired motion, log by log, over all pieces of each.
fn unfollowed_of(runs: &[Run]) -> BTreeMap<&Path, BTreeSet<usize>> {
    let mut found = BTreeMap::<&Path, BTreeSet<usize>>::new();
    for run in runs {
        found.entry(&run.piece.grid.path).or_default().extend(&run.unfollowed);
    }
    found
}

/// Fits every log on its own.
fn compare(robot: &Robot, args: &Args) -> Result<ExitCode> {
    let prior = WEAKER_PRIOR * robot.config.estimator.prior;
    let mut alone = Vec::new();
    for path in &args.logs {
        let Taken { rows, distrusts, .. } = read_rows(robot, std::slice::from_ref(path))?;
        let fit = fit(&Equations::new(&rows), &robot.nominal_base, prior, method(robot))
            .with_context(|| path.display().to_string())?;
        alone.push(Alone { name: runs::short_name(path), fit, rows, distrusts });
    }
    show(&compare::text(robot, &alone)?)?;
    if let Some(path) = &args.json {
        let text = format!("{:#}\n", compare::to_json(robot, &alone));
        runs::write_whole(path, &text).with_context(|| path.display().to_string())?;
        show(&format!("result written to {}\n", path.display()))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// The stretches of a log and their rows.
pub(crate) fn rows_of(robot: &Robot, log: &Log) -> Result<Taken> {
    log.torque()?;
    let settings = runs::settings(robot, log.q_des.is_some());
    if settings.instrument == InstrumentSource::Desired && log.q_des.is_none() {
        return Err(Fault::Data(format!(
            "{}: no q_des columns, but [estimator] instruments in {} ask for them; \"auto\" takes delayed ones",
            log.path.display(),
            robot.config.path.display()
        ))
        .into());
    }
    if settings.instrument == InstrumentSource::SecondEncoder && log.q_link.iter().any(Option::is_none) {
        return Err(Fault::Data(format!(
            "{}: q_link columns are missing, but [estimator] instruments = \"second-encoder\" in {}; it needs one of every \
             joint",
            log.path.display(),
            robot.config.path.display()
        ))
        .into());
    }
    let sound = screen(robot, log)?;
    let (mut found, mut all_rows, mut still) = (Vec::new(), Vec::new(), None);
    let why = || {
        sound.reason().map_or_else(|| log.path.display().to_string(), |why| format!("{}: {why}", log.path.display()))
    };
    for piece in runs::pieces_without(&sound.left_out, &sound.log, robot.config.sample_period_s).with_context(why)? {
        let record = runs::record(&piece)?;
        let mut settings = settings.clone();
        let unfollowed = match (&record.desired, settings.instrument) {
            (Some(desired), InstrumentSource::Desired) => unfollowed(&record.measured, desired, record.period_s),
            _ => Vec::new(),
        };
        if let (false, Instruments::Auto { delay_s, .. }) = (unfollowed.is_empty(), robot.config.estimator.instruments)
        {
            settings.instrument = InstrumentSource::Delayed(delay_s);
        }
        match Rows::new(&robot.model, &robot.base, &settings, &record) {
            Ok(rows) => {
                found.push(Run { piece, source: settings.instrument, unfollowed });
                all_rows.push(rows);
            }
            Err(why @ OfflineError::NoMotion { .. }) => still = Some(why),
            Err(why) => return Err(why).with_context(|| log.path.display().to_string()),
        }
    }
    match still.filter(|_| found.is_empty()) {
        Some(still) => Err(still).with_context(why),
        None => Ok(Taken { runs: found, rows: all_rows, contents: Vec::new(), distrusts: sound.found }),
    }
}

/// The fit that counts and the consistent parameters near it, of logs that were read already.
pub(crate) fn found(robot: &Robot, logs: &[Log]) -> Result<Found> {
    let (fit, near) = fit_and_projection(robot, logs)?;
    Ok(Found { values: fit.values, consistent: near.base, condition: fit.condition })
}

/// Physically consistent standard parameters near the fit that counts, of logs that were read already.
pub(crate) fn consistent(robot: &Robot, logs: &[Log]) -> Result<Vec<f64>> {
    Ok(fit_and_projection(robot, logs)?.1.standard)
}

fn fit_and_projection(robot: &Robot, logs: &[Log]) -> Result<(Fit, Projection)> {
    let mut rows = Vec::new();
    for log in logs {
        rows.extend(rows_of(robot, log)?.rows);
    }
    let prior = WEAKER_PRIOR * robot.config.estimator.prior;
    let equations = Equations::new(&rows);
    let fit = fit(&equations, &robot.nominal_base, prior, method(robot))?;
    let reference = equations.reference();
    let near = project(&robot.model, &robot.base, &fit.values, &fit.covariance, &robot.nominal, &reference)?;
    Ok((fit, near))
}

/// The values of the fit that counts, of rows.
pub(crate) fn values_of(robot: &Robot, rows: &[Rows]) -> Result<Vec<f64>> {
    let prior = WEAKER_PRIOR * robot.config.estimator.prior;
    Ok(solve(&Equations::new(rows), &robot.nominal_base, prior, method(robot))?)
}

fn method(robot: &Robot) -> Method {
    if robot.config.estimator.kind == EstimatorKind::Riv { Method::Instrumental } else { Method::LeastSquares }
}

/// Errors of the identified parameters on logs that had no part in them.
fn held_out(robot: &Robot, values: &[f64], logs: &[PathBuf], distrusts: &mut Vec<Distrust>) -> Result<Vec<HeldOut>> {
    let mut trained = robot.clone();
    trained.identified = Some(Identified { values: values.to_vec(), std: vec![0.0; values.len()] });
    let mut nominal = robot.clone();
    nominal.identified = None;
    let of = |path: &PathBuf| {
        let log = runs::read_log(robot, path)?;
        let sound = screen(robot, &log)?;
        let errors = |robot: &Robot| predict::errors(robot, &sound);
        let (file, content) = (path.display().to_string(), content(&log)?);
        let held = HeldOut { file, content, nominal: errors(&nominal)?, identified: errors(&trained)? };
        distrusts.extend(sound.found);
        Ok(held)
    };
    logs.iter().map(of).collect()
}

/// Why these instruments, in words.
fn instrument_text(robot: &Robot, run: &Run, rows: &Rows) -> String {
    match run.source {
        InstrumentSource::Desired => {
            let lags: Vec<String> = rows.lag_s.iter().map(|lag| format!("{:.0}", 1e3 * lag)).collect();
            format!("desired trajectory, delayed by the tracking lag of {} ms", lags.join(" "))
        }
        InstrumentSource::SecondEncoder => "motion by second encoders".to_owned(),
        InstrumentSource::Delayed(seconds) => {
            let back = (seconds / run.piece.report.period_s).round();
            let grid = &run.piece.grid;
            let why = match robot.config.estimator.instruments {
                Instruments::Auto { .. } if grid.q_des.is_none() => "no desired trajectory in the log: ",
                Instruments::Auto { .. } => "desired trajectory not followed: ",
                Instruments::PreviousCycle { .. } => {
                    "\"previous-cycle\" acts on line only, off line no cycle is looked for: "
                }
                _ => "as the robot file asks: ",
            };
            // On line "auto" takes them by itself.
            let second = match robot.config.estimator.instruments {
                Instruments::Auto { .. } if grid.q_link.iter().all(Option::is_some) => {
                    "; off line, q_link is taken only with instruments = \"second-encoder\""
                }
                _ => "",
            };
            format!("{why}delayed instruments, k = {back} samples ({seconds} s){second}")
        }
    }
}

fn text(robot: &Robot, result: &Findings) -> String {
    let (model, base) = (&robot.model, &robot.base);
    let chosen = result.chosen(robot);
    let signal = &robot.config.signal;
    let mut out = format!(
        "identify {}: {} joints, {} base parameters, model filter {} Hz (zero-phase)\n",
        robot.config.name,
        robot.dof(),
        base.len(),
        signal.model_filter_hz
    );
    for (run, rows) in result.runs.iter().zip(&result.rows) {
        let (grid, range) = (&run.piece.grid, &rows.moving);
        out += &paragraph("  log         ", &format!("{}: {}", runs::short_name(&grid.path), run.piece.report));
        let left_out: Vec<String> = rows.left_out.iter().map(|share| format!("{:.0}", 100.0 * share)).collect();
        let counts: Vec<String> = (0..robot.dof()).map(|j| rows.count(j).to_string()).collect();
        out += &paragraph(
            "  motion      ",
            &format!(
                "{:.2} s to {:.2} s; rows per joint {}, left out below the dead zone {} %",
                grid.t[range.start],
                grid.t[range.end - 1],
                counts.join(" "),
                left_out.join(" ")
            ),
        );
        out += &paragraph("  instruments ", &instrument_text(robot, run, rows));
    }
    out += &evidence::signal_text(robot);
    out += &evidence::distrust_text(&result.distrusts);
    out += "\nresidual 100*|tau - D x|/|tau| on these rows\n";
    let mut table = Table::new(["joint", "nominal %", "LS %", "IV %", "noise N m", "rows a free row"]);
    for (j, name) in runs::joint_names(robot).into_iter().enumerate() {
        let percent = |k: usize| format!("{:.1}", result.residuals[k][j]);
        let (noise, correlation) = (number(chosen.noise[j], 3), format!("{:.1}", chosen.correlation[j]));
        table.row([name, percent(0), percent(1), percent(2), noise, correlation]);
    }
    out += &table.text();
    for held in &result.held_out {
        out +=
            &paragraph("\n", &format!("held out, 100*|tau-pred|/|tau| on {}", runs::short_name(Path::new(&held.file))));
        let mut table = Table::new(["joint", "nominal %", "identified %"]);
        for (j, name) in runs::joint_names(robot).into_iter().enumerate() {
            table.row([name, format!("{:.1}", held.nominal[j]), format!("{:.1}", held.identified[j])]);
        }
        out += &table.text();
    }
    let by_prior = chosen.determined.iter().filter(|d| **d == Determined::ByPrior).count();
    let (shift, at) = largest_shift(result);
    // Writing to a String cannot fail, here and below.
    let _ = writeln!(
        out,
        "\nrank {} of {}, condition {}; {} parameters decided by the data, {} by the prior (nominal)",
        chosen.rank,
        base.len(),
        number(chosen.condition, 2),
        base.len() - by_prior,
        by_prior
    );
    let _ = writeln!(out, "largest difference IV - LS: {shift:.1} standard deviations ({})", base.name(model, at));
    out += &evidence::bias_text(&result.bias, &Compared::OFFLINE);
    out += &evidence::delay_text(&result.delays);
    out += &evidence::sampling_text(robot, result.runs.iter().map(|run| &run.piece.report));
    out += &evidence::consistency_text(&result.consistent);
    out.push('\n');
    let which = if robot.config.estimator.kind == EstimatorKind::Riv { "IV" } else { "LS" };
    let mut table = Table::new(["parameter", which, "std", "decided by", "LS", "nominal", "unit"]);
    for i in 0..base.len() {
        let decided = match chosen.determined[i] {
            Determined::ByData => "data",
            Determined::ByPrior => "prior",
        };
        table.row([
            base.name(model, i),
            number(chosen.values[i], 4),
            number(chosen.std[i], 2),
            decided.to_owned(),
            number(result.least_squares.values[i], 4),
            number(robot.nominal_base[i], 4),
            base.parameter(model, i).unit(&model.arm).to_owned(),
        ]);
    }
    out + &table.text()
}

/// The largest |IV - LS| over its standard deviation and the parameter it belongs to: noise in the regressor shows here.
fn largest_shift(result: &Findings) -> (f64, usize) {
    let (iv, ls) = (&result.instrumental, &result.least_squares);
    let shift = |i: usize| (iv.values[i] - ls.values[i]).abs() / iv.std[i].max(f64::MIN_POSITIVE);
    (0..iv.values.len()).map(|i| (shift(i), i)).max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((0.0, 0))
}

fn to_json(robot: &Robot, result: &Findings) -> Value {
    let (model, base) = (&robot.model, &robot.base);
    let chosen = result.chosen(robot);
    let parameter = |i: usize| {
        let regrouped: Vec<Value> = base
            .regrouping(i)
            .into_iter()
            .map(|(k, factor)| json!({"name": model.parameters[k].name(&model.arm), "factor": factor}))
            .collect();
        json!({
            "name": base.name(model, i),
            "unit": base.parameter(model, i).unit(&model.arm),
            "value": chosen.values[i],
            "std": chosen.std[i],
            "decided_by": if chosen.determined[i] == Determined::ByData { "data" } else { "prior" },
            "instrumental": result.instrumental.values[i],
            "least_squares": result.least_squares.values[i],
            "nominal": robot.nominal_base[i],
            "regrouped": regrouped,
        })
    };
    let log = |(run, rows): (&Run, &Rows)| {
        let report = &run.piece.report;
        let range = &rows.moving;
        json!({
            "file": run.piece.grid.path.display().to_string(),
            "rows": report.rows_in,
            "mean_rate_hz": report.mean_rate_hz,
            "jitter_s": report.jitter_s,
            "gaps": report.gaps.len(),
            "period_s": report.period_s,
            "resampling": report.to_string(),
            "motion_s": [run.piece.grid.t[range.start], run.piece.grid.t[range.end - 1]],
            "rows_per_joint": (0..robot.dof()).map(|j| rows.count(j)).collect::<Vec<_>>(),
            "left_out": rows.left_out,
            "instruments": match run.source {
                InstrumentSource::Desired => json!({"kind": "desired", "lag_s": rows.lag_s}),
                InstrumentSource::SecondEncoder => json!({"kind": "second_encoder"}),
                InstrumentSource::Delayed(delay_s) => json!({"kind": "delayed", "delay_s": delay_s}),
            },
        })
    };
    let delays = evidence::delay_json(&result.delays);
    let per_joint = |j: usize| {
        json!({
            "joint": model.arm.joints[j].name,
            "residual_percent": {
                "nominal": result.residuals[0][j],
                "least_squares": result.residuals[1][j],
                "instrumental": result.residuals[2][j],
            },
            "torque_delay_s": delays[j],
            "noise": chosen.noise[j],
            "rows_per_free_row": chosen.correlation[j],
        })
    };
    let (shift, at) = largest_shift(result);
    json!({
        "robot": robot.config.name,
        "model_hash": format!("{:016x}", robot.hash),
        "estimator": if robot.config.estimator.kind == EstimatorKind::Riv { "instrumental" } else { "least_squares" },
        "logs": result.runs.iter().zip(&result.rows).map(log).collect::<Vec<_>>(),
        "joints": (0..robot.dof()).map(per_joint).collect::<Vec<_>>(),
        "warnings": evidence::distrust_json(&result.distrusts),
        "rank": chosen.rank,
        "base_parameters": base.len(),
        "condition": chosen.condition,
        "largest_shift": {"parameter": base.name(model, at), "standard_deviations": shift},
        "bias": evidence::bias_json(&result.bias),
        "consistent": evidence::consistency_json(robot, &result.consistent),
        "held_out": result.held_out.iter().map(|held| json!({
            "file": held.file,
            "nominal_percent": held.nominal,
            "identified_percent": held.identified,
        })).collect::<Vec<_>>(),
        "parameters": (0..base.len()).map(parameter).collect::<Vec<_>>(),
    })
}
