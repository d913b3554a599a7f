//! `rivet blind score`: verdicts against answers.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use serde::Deserialize;

use crate::table::{Table, paragraph, show};

/// Effects with less torque than this, in units of the torque noise, nobody can see.
const VISIBLE: f64 = 0.5;
/// A prediction is good within so much of the measured shrink.
const CLOSE: f64 = 0.05;
/// Wrong values that are right to name, but no answer, where the nominal model is wrong throughout.
const VALUES: [&str; 4] = ["link_inertia", "rotor_inertia", "coulomb_friction", "viscous_friction"];

/// Arguments of `rivet blind score`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Written by `rivet blind run`.
    #[arg(value_name = "VERDICTS.json")]
    verdicts: PathBuf,
    /// The sealed answers.
    #[arg(value_name = "ANSWERS.json")]
    answers: PathBuf,
}

#[derive(Deserialize)]
struct Answer {
    effects: Vec<True>,
    torque_change_over_noise: Vec<f64>,
    /// Present where every value of the nominal model is wrong.
    nominal_error: Option<f64>,
}

#[derive(Deserialize)]
struct True {
    effect: String,
    joints: Vec<usize>,
}

#[derive(Deserialize, Default)]
struct Found {
    #[serde(default)]
    verdict: String,
    #[serde(default)]
    causes: Vec<Cause>,
    #[serde(default)]
    gap: GapOf,
}

#[derive(Deserialize, Default)]
struct GapOf {
    #[serde(default)]
    per_joint: Vec<Joint>,
}

#[derive(Deserialize)]
struct Joint {
    joint: String,
}

#[derive(Deserialize)]
struct Cause {
    effect: String,
    joints: Vec<String>,
    shrink: Shrink,
    indistinguishable_from: Vec<String>,
}

#[derive(Deserialize)]
struct Shrink {
    predicted: Option<f64>,
    low: Option<f64>,
    high: Option<f64>,
    measured: Option<f64>,
}

/// Counts over all cases.
#[derive(Default)]
struct Tally {
    visible: usize,
    named: usize,
    joint: usize,
    beside: usize,
    nothing: usize,
    false_alarms: usize,
    outside: usize,
    misnamed: usize,
    predictions: usize,
    close: usize,
    covered: usize,
}

pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let verdicts: BTreeMap<String, Found> = read(&args.verdicts)?;
    let answers: BTreeMap<String, Answer> = read(&args.answers)?;
    let missing: Vec<&String> = answers.keys().filter(|name| !verdicts.contains_key(*name)).collect();
    if !missing.is_empty() {
        bail!("{}: no verdict on {missing:?}", args.verdicts.display());
    }
    let mut tally = Tally::default();
    let mut table = Table::new(["case", "truth", "verdict", "named", ""]);
    for (name, answer) in &answers {
        let found = &verdicts[name];
        let mark = tally.add(answer, found);
        let truth: Vec<&str> = answer.effects.iter().map(|e| e.effect.as_str()).collect();
        let named: Vec<&str> = found.causes.iter().filter(|c| counts(answer, c)).map(|c| c.effect.as_str()).collect();
        table.row([name.clone(), or_dash(&truth), found.verdict.clone(), or_dash(&named), mark]);
    }
    show(&table.text())?;
    show(&tally.text())?;
    Ok(ExitCode::SUCCESS)
}

fn read<T: for<'de> Deserialize<'de>>(path: &Path) -> Result<T> {
    let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
    serde_json::from_str(&text).with_context(|| path.display().to_string())
}

fn or_dash(names: &[&str]) -> String {
    if names.is_empty() { "-".to_owned() } else { names.join(" ") }
}

/// Whether a cause counts as a name: wrong values do not where all values are wrong.
fn counts(answer: &Answer, cause: &Cause) -> bool {
    answer.nominal_error.is_none() || !VALUES.contains(&cause.effect.as_str())
}

impl Tally {
    /// Adds a case; returns a word on it.
    fn add(&mut self, answer: &Answer, found: &Found) -> String {
        for shrink in found.causes.iter().map(|c| &c.shrink) {
            let (Some(predicted), Some(measured)) = (shrink.predicted, shrink.measured) else { continue };
            self.predictions += 1;
            self.close += usize::from((predicted - measured).abs() <= CLOSE);
            let inside = shrink.low.is_some_and(|l| l <= measured) && shrink.high.is_some_and(|h| measured <= h);
            self.covered += usize::from(inside);
        }
        let names: Vec<&Cause> = found.causes.iter().filter(|c| counts(answer, c)).collect();
        if answer.effects.is_empty() {
            self.nothing += 1;
            self.false_alarms += usize::from(!names.is_empty());
            return if names.is_empty() { String::new() } else { "false alarm".to_owned() };
        }
        if answer.effects.iter().any(|e| e.effect == "outside") {
            self.outside += 1;
            self.misnamed += usize::from(!names.is_empty());
            return if names.is_empty() { String::new() } else { "misnamed".to_owned() };
        }
        if answer.torque_change_over_noise.iter().fold(0.0_f64, |m, t| m.max(*t)) <= VISIBLE {
            return "not visible".to_owned();
        }
        let mut words = Vec::new();
        let place = |name: &String| found.gap.per_joint.iter().position(|j| j.joint == *name);
        for truth in &answer.effects {
            self.visible += 1;
            let is = |c: &&&Cause| c.effect == truth.effect || c.indistinguishable_from.contains(&truth.effect);
            let Some(cause) = names.iter().find(is) else {
                words.push("missed");
                continue;
            };
            self.named += 1;
            let joints: Vec<usize> = cause.joints.iter().filter_map(place).collect();
            // An effect of the whole arm, or of the flange, needs no joint.
            let whole = cause.joints.is_empty() || truth.joints.len() == found.gap.per_joint.len();
            let right = whole || truth.joints.iter().all(|j| joints.contains(j));
            self.joint += usize::from(right);
            if !right {
                words.push("wrong joint");
            }
        }
        let known = |c: &&Cause| {
            answer.effects.iter().any(|t| c.effect == t.effect || c.indistinguishable_from.contains(&t.effect))
        };
        let beside = names.iter().filter(|c| !known(c)).count();
        self.beside += beside;
        if beside > 0 {
            words.push("and more");
        }
        words.join(", ")
    }

    fn text(&self) -> String {
        let share = |part: usize, whole: usize| {
            if whole == 0 { "none".to_owned() } else { format!("{part} of {whole}") }
        };
        let lines = [
            format!("visible effects named, or in a class that holds them: {}", share(self.named, self.visible)),
            format!("right joint, of those: {}", share(self.joint, self.named)),
            format!("names beside the truth: {}", self.beside),
            format!("named on nothing wrong: {}", share(self.false_alarms, self.nothing)),
            format!("outside the library, misnamed: {}", share(self.misnamed, self.outside)),
            format!("shrink predicted within 5 points: {}", share(self.close, self.predictions)),
            format!("shrink within its 90 % interval: {}", share(self.covered, self.predictions)),
        ];
        lines.iter().map(|line| paragraph("  ", line)).collect()
    }
}
