//! `rivet study friction`: the ladder of friction laws on logs of one arm, each judged by what it was not fitted to.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result};
use rivet_config::Robot;
use rivet_diagnosis::{Ladder, Run, Rung, friction_ladder};
use serde_json::{Value, json};

use crate::outputs::{Outputs, write_json};
use crate::table::{Table, show};
use rivet_analysis::fault::Fault;
use rivet_analysis::progress::Progress;
use rivet_analysis::runs::{load_robot, pieces, read_log, runs};

/// Standard errors by which a law must differ from Coulomb and viscous friction to be called better or worse.
const SURE: f64 = 2.0;

/// Arguments.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The robot file
    robot: PathBuf,
    /// Logs of one fold, separated by commas, for example of one gain, load or motion; two or more folds
    #[arg(long = "fold", value_name = "LOG,LOG...", value_parser = parse_fold, required = true)]
    folds: Vec<Fold>,
    /// Also write the figures as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Also write the table as Markdown
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
}

/// Logs that are left out together.
#[derive(Clone)]
struct Fold(Vec<PathBuf>);

fn parse_fold(text: &str) -> Result<Fold, String> {
    let logs: Vec<PathBuf> = text.split(',').map(PathBuf::from).collect();
    if logs.iter().any(|log| log.as_os_str().is_empty()) {
        return Err("logs with commas between them".to_owned());
    }
    Ok(Fold(logs))
}

/// Runs the study.
pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    if args.folds.len() < 2 {
        return Err(Fault::Usage("one --fold leaves nothing to fit to: give two or more".to_owned()).into());
    }
    let robot = load_robot(&args.robot, &[])?;
    let logs = args.folds.iter().flat_map(|fold| &fold.0);
    let outputs = Outputs::for_logs(&robot, &args.robot, logs).file("--json", args.json.as_ref());
    outputs.file("--markdown", args.markdown.as_ref()).check()?;
    let folds: Vec<Vec<Run>> = args
        .folds
        .iter()
        .map(|fold| fold.0.iter().map(|log| read(&robot, log)).collect::<Result<Vec<_>>>().map(|logs| logs.concat()))
        .collect::<Result<_>>()?;
    let mut line = Progress::new("fitting laws of friction", 1);
    let ladder =
        friction_ladder(&robot.model, &robot.nominal, &folds, robot.config.signal.model_filter_hz, &mut |done, of| {
            line.set_of(done, of);
        });
    line.done();
    let ladder = ladder?;
    show(&text(&robot, &ladder))?;
    write_json(args.json.as_ref(), &to_json(&robot, &args.folds, &ladder))?;
    if let Some(path) = &args.markdown {
        rivet_files::write_whole(path, markdown(&robot, &ladder)).with_context(|| path.display().to_string())?;
    }
    Ok(ExitCode::SUCCESS)
}

fn read(robot: &Robot, path: &Path) -> Result<Vec<Run>> {
    let log = read_log(robot, path)?;
    runs(path, &pieces(&log, robot.config.sample_period_s)?).with_context(|| path.display().to_string())
}

/// Rungs by what they leave, the best first.
fn ranked(ladder: &Ladder) -> Vec<&Rung> {
    let mut ranked: Vec<&Rung> = ladder.rungs.iter().collect();
    ranked.sort_by(|a, b| a.error.total_cmp(&b.error));
    ranked
}

fn verdict(rung: &Rung) -> &'static str {
    let (change, error) = rung.change;
    match change {
        0.0 => "",
        c if c < -SURE * error => "better",
        c if c > SURE * error => "worse",
        _ => "not distinguishable",
    }
}

fn text(robot: &Robot, ladder: &Ladder) -> String {
    let joints = (1..=robot.dof()).map(|j| format!("j{j}"));
    let head = ["law, best first".to_owned()].into_iter().chain(joints);
    let mut table = Table::new(head.chain(["all".to_owned(), "change".to_owned(), String::new()]));
    let percent = |share: &f64| format!("{:.1}", 100.0 * share);
    for rung in ranked(ladder) {
        let cells = [rung.name.to_owned()].into_iter().chain(rung.joints.iter().map(percent));
        table.row(cells.chain([percent(&rung.error), change(rung), verdict(rung).to_owned()]));
    }
    format!(
        "{}: residual on the left-out folds, in % of their torque, and the change of its\nsquare against coulomb + \
         viscous. Torque was shifted by {:+.1} ms.\n\n{}",
        robot.config.name,
        -1e3 * ladder.delay_s,
        table.text()
    )
}

/// Change of the squared residual and its standard error \[%\]; nothing of the law that others are compared with.
fn change(rung: &Rung) -> String {
    let (change, error) = rung.change;
    if change == 0.0 { String::new() } else { format!("{:+.1} +- {:.1}", 100.0 * change, 100.0 * error) }
}

fn markdown(robot: &Robot, ladder: &Ladder) -> String {
    let mut out =
        format!("| {}, best first | residual, % | change of its square, % | |\n|---|---|---|---|\n", robot.config.name);
    for rung in ranked(ladder) {
        // Writing to a String cannot fail.
        let _ = writeln!(out, "| {} | {:.1} | {} | {} |", rung.name, 100.0 * rung.error, change(rung), verdict(rung));
    }
    out
}

fn to_json(robot: &Robot, folds: &[Fold], ladder: &Ladder) -> Value {
    let rung = |rung: &&Rung| {
        json!({
            "law": rung.name, "error": rung.error, "joints": rung.joints, "folds": rung.folds,
            "change": rung.change.0, "change_std": rung.change.1, "verdict": verdict(rung),
        })
    };
    let names = |fold: &Fold| fold.0.iter().map(|log| log.display().to_string()).collect::<Vec<_>>();
    json!({
        "robot": robot.config.name,
        "delay_s": ladder.delay_s,
        "folds": folds.iter().map(names).collect::<Vec<_>>(),
        "laws": ranked(ladder).iter().map(rung).collect::<Vec<_>>(),
    })
}
