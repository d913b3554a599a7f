//! `rivet diagnose`: where a simulator differs from the arm, which effect causes it, how far the gap shrinks.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result};
use rivet_diagnosis::{Diagnosis, Run, Verdict, diagnose};
use serde_json::{Map, Value, json};

use crate::runs;
use crate::table::{Table, paragraph, show};

/// Arguments of `rivet diagnose`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Robot file: what the simulator knows.
    #[arg(value_name = "ROBOT.toml")]
    robot: PathBuf,
    /// What the arm did. With several logs the last stays sealed until it is predicted; a single one is cut.
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,
    /// Write the verdict as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Tell what is considered.
    #[arg(long, short)]
    verbose: bool,
}

/// Exit codes: 0 no gap, 1 a cause named, 2 unexplained, 3 not evaluated.
pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let robot = rivet_config::load(&args.robot)?;
    let mut all = Vec::new();
    for path in &args.logs {
        let log = runs::read_log(&robot, path)?;
        for piece in runs::pieces(&log, log.median_step_s())? {
            all.push(Run {
                name: runs::short_name(path),
                period_s: piece.report.period_s,
                q: piece.grid.q.clone(),
                tau: piece.grid.torque()?.clone(),
                temperature: piece.grid.temperature.clone(),
            });
        }
    }
    let mut say = |line: &str| {
        if args.verbose {
            eprintln!("{line}");
        }
    };
    let found = diagnose(&robot.model, &robot.nominal, all, &mut say)?;
    if let Some(path) = &args.json {
        let text = serde_json::to_string_pretty(&as_json(&found))? + "\n";
        runs::write_whole(path, &text).with_context(|| path.display().to_string())?;
    }
    show(&as_text(&robot.config.name, &found))?;
    Ok(ExitCode::from(match found.verdict {
        Verdict::NoGap => 0,
        Verdict::Parameter | Verdict::Effect | Verdict::Several => 1,
        Verdict::Unexplained => 2,
        Verdict::NotEvaluated => 3,
    }))
}

/// A number, or null for what JSON has no number for.
fn number(x: f64) -> Value {
    if x.is_finite() { json!((x * 1e9).round() / 1e9) } else { Value::Null }
}

fn as_json(found: &Diagnosis) -> Value {
    let cause = |c: &rivet_diagnosis::Cause| {
        let magnitude: Map<String, Value> = c.magnitude.iter().map(|(n, v)| (n.clone(), number(*v))).collect();
        json!({
            "effect": c.effect.name(),
            "joints": c.joints,
            "magnitude": magnitude,
            "shrink": {
                "predicted": number(c.shrink.predicted),
                "low": number(c.shrink.low),
                "high": number(c.shrink.high),
                "measured": number(c.shrink.measured),
            },
            "confidence": number(c.confidence),
            "indistinguishable_from": c.indistinguishable_from.iter().map(|e| e.name()).collect::<Vec<_>>(),
            "separating_motion": c.separating_motion,
        })
    };
    let joints: Vec<Value> = found
        .per_joint
        .iter()
        .map(|j| {
            json!({"joint": j.joint, "before": number(j.before), "after": number(j.after), "noise_floor": number(j.noise_floor)})
        })
        .collect();
    let place: Vec<Value> = found
        .place
        .iter()
        .map(|c| json!({"joint": c.joint, "regime": c.regime.name(), "share": number(c.share), "seconds": number(c.seconds)}))
        .collect();
    json!({
        "schema": "rivet.diagnosis.v1",
        "verdict": found.verdict.name(),
        "gap": {
            "before": number(found.before),
            "after": number(found.after),
            "noise_floor": number(found.noise_floor),
            "per_joint": joints,
        },
        "where": place,
        "causes": found.causes.iter().map(cause).collect::<Vec<_>>(),
        "log": found
            .log
            .iter()
            .map(|f| json!({"run": f.run, "joint": f.joint, "fault": f.fault.name(), "value": number(f.fault.value()), "text": f.fault.text()}))
            .collect::<Vec<_>>(),
        "hints": found.withdrawn.iter().map(cause).collect::<Vec<_>>(),
        "unexplained_share": number(found.unexplained_share),
        "data": {
            "runs": found.data.runs,
            "fit_seconds": number(found.data.fit_seconds),
            "sealed_seconds": number(found.data.sealed_seconds),
        },
        "remark": found.remark,
    })
}

fn as_text(robot: &str, found: &Diagnosis) -> String {
    let mut out = paragraph("", &format!("diagnose {robot}: {}", found.verdict.name()));
    if let Some(remark) = &found.remark {
        return out + &paragraph("  ", remark);
    }
    let percent = |x: f64| if x.is_finite() { format!("{:.1}", 100.0 * x) } else { "-".to_owned() };
    let data = &found.data;
    out += &paragraph(
        "  ",
        &format!(
            "gap on {:.0} s of motion that was sealed: {} % of the torque as given, {} % with the causes below \
             (noise {} %); {:.0} s were looked at",
            data.sealed_seconds,
            percent(found.before),
            percent(found.after),
            percent(found.noise_floor),
            data.fit_seconds
        ),
    );
    for finding in &found.log {
        out += &paragraph("  ", &format!("{}: {} {}", finding.run, finding.joint, finding.fault.text()));
    }
    if !found.causes.is_empty() {
        let mut table = Table::new(["cause", "joints", "predicted", "90 %", "measured [%]", "sure"]);
        for c in &found.causes {
            table.row([
                c.effect.to_string(),
                match c.joints.as_slice() {
                    joints if joints.is_empty() || joints.len() == found.per_joint.len() => "all".to_owned(),
                    [first, _, _, ..] => format!("{first} and {} more", c.joints.len() - 1),
                    few => few.join(" "),
                },
                percent(c.shrink.predicted),
                format!("{}..{}", percent(c.shrink.low), percent(c.shrink.high)),
                percent(c.shrink.measured),
                format!("{:.2}", c.confidence),
            ]);
        }
        out += &table.text();
    }
    for c in &found.causes {
        if let Some(motion) = &c.separating_motion {
            let rivals: Vec<&str> = c.indistinguishable_from.iter().map(|e| e.name()).collect();
            let text = format!(
                "{} cannot be told from {} on these logs; this motion would: {motion}",
                c.effect,
                rivals.join(", ")
            );
            out += &paragraph("  ", &text);
        }
    }
    if found.verdict == Verdict::Unexplained && !found.withdrawn.is_empty() {
        let hints: Vec<&str> = found.withdrawn.iter().map(|c| c.effect.name()).collect();
        out += &paragraph("  ", &format!("considered and not upheld: {}", hints.join(", ")));
    }
    let mut table = Table::new(["gap by joint [%]", "as given", "with causes", "noise"]);
    for j in &found.per_joint {
        table.row([j.joint.clone(), percent(j.before), percent(j.after), percent(j.noise_floor)]);
    }
    out += &table.text();
    let places: Vec<String> =
        found.place.iter().take(4).map(|c| format!("{} {} {} %", c.joint, c.regime.name(), percent(c.share))).collect();
    out + &paragraph("  ", &format!("where: {}", places.join(", ")))
}
