//! `rivet blind score`: verdicts against answers.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use rivet_report::{Outcome, Score};
use serde::Deserialize;

use crate::runs::write_whole;
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
    /// Write the scores as JSON. Several sets in one array are what `rivet diagnose --html` shows.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// What the set is called; the name of its folder otherwise.
    #[arg(long, value_name = "NAME")]
    name: Option<String>,
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

#[derive(Deserialize)]
struct Found {
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

pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let said: BTreeMap<String, serde_json::Value> = read(&args.verdicts)?;
    // A diagnosis that failed names nothing, which must not pass for a right answer.
    let failed: Vec<&String> = said.iter().filter(|(_, v)| v.get("error").is_some()).map(|(name, _)| name).collect();
    if !failed.is_empty() {
        bail!("{}: the diagnosis of {failed:?} failed; there is nothing to score", args.verdicts.display());
    }
    let verdicts: BTreeMap<String, Found> = read(&args.verdicts)?;
    let answers: BTreeMap<String, Answer> = read(&args.answers)?;
    let missing: Vec<&String> = answers.keys().filter(|name| !verdicts.contains_key(*name)).collect();
    if !missing.is_empty() {
        bail!("{}: no verdict on {missing:?}", args.verdicts.display());
    }
    let folder = args.answers.parent().and_then(Path::file_name).map(|n| n.to_string_lossy().into_owned());
    let mut tally = Tally(Score {
        set: args.name.clone().or(folder).unwrap_or_default(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        cases: answers.len(),
        ..Score::default()
    });
    let mut table = Table::new(["case", "truth", "verdict", "named", ""]);
    for (name, answer) in &answers {
        let found = &verdicts[name];
        let mark = tally.add(answer, found);
        let truth: Vec<&str> = answer.effects.iter().map(|e| e.effect.as_str()).collect();
        let named: Vec<&str> = found.causes.iter().filter(|c| counts(answer, c)).map(|c| c.effect.as_str()).collect();
        table.row([name.clone(), or_dash(&truth), found.verdict.clone(), or_dash(&named), mark]);
    }
    tally.0.outcomes.sort_by(|a, b| a.truth.cmp(&b.truth));
    if let Some(path) = &args.json {
        let text = serde_json::to_string_pretty(&tally.0)? + "\n";
        write_whole(path, &text).with_context(|| path.display().to_string())?;
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

/// Scores in the making.
struct Tally(Score);

impl Tally {
    /// Adds a case; returns a word on it.
    fn add(&mut self, answer: &Answer, found: &Found) -> String {
        for shrink in found.causes.iter().map(|c| &c.shrink) {
            let (Some(predicted), Some(measured)) = (shrink.predicted, shrink.measured) else { continue };
            self.0.predictions += 1;
            self.0.close += usize::from((predicted - measured).abs() <= CLOSE);
            let inside = shrink.low.is_some_and(|l| l <= measured) && shrink.high.is_some_and(|h| measured <= h);
            self.0.covered += usize::from(inside);
        }
        let names: Vec<&Cause> = found.causes.iter().filter(|c| counts(answer, c)).collect();
        let outside = answer.effects.iter().any(|e| e.effect == "outside");
        if answer.effects.is_empty() || outside {
            self.outcome(if outside { "outside" } else { "nothing" }, names.is_empty(), false, found, &names);
            return match (names.is_empty(), outside) {
                (true, _) => String::new(),
                (false, true) => "misnamed".to_owned(),
                (false, false) => "false alarm".to_owned(),
            };
        }
        if answer.torque_change_over_noise.iter().fold(0.0_f64, |m, t| m.max(*t)) <= VISIBLE {
            self.0.invisible += answer.effects.len();
            return "not visible".to_owned();
        }
        let mut words = Vec::new();
        let place = |name: &String| found.gap.per_joint.iter().position(|j| j.joint == *name);
        for truth in &answer.effects {
            let named = names.iter().find(|c| c.effect == truth.effect);
            let in_class = names.iter().find(|c| c.indistinguishable_from.contains(&truth.effect));
            self.outcome(&truth.effect, named.is_some(), in_class.is_some(), found, &names);
            let Some(cause) = named.or(in_class) else {
                words.push("missed");
                continue;
            };
            let joints: Vec<usize> = cause.joints.iter().filter_map(place).collect();
            // An effect of the whole arm, or of the flange, needs no joint.
            let whole = cause.joints.is_empty() || truth.joints.len() == found.gap.per_joint.len();
            let right = whole || truth.joints.iter().all(|j| joints.contains(j));
            self.0.right_joint += usize::from(right);
            if !right {
                words.push("wrong joint");
            }
        }
        let known = |c: &&Cause| {
            answer.effects.iter().any(|t| c.effect == t.effect || c.indistinguishable_from.contains(&t.effect))
        };
        let beside = names.iter().filter(|c| !known(c)).count();
        self.0.beside += beside;
        if beside > 0 {
            words.push("and more");
        }
        words.join(", ")
    }

    /// Counts what was said of one truth.
    fn outcome(&mut self, truth: &str, right: bool, in_class: bool, found: &Found, names: &[&Cause]) {
        let place = self.0.outcomes.iter().position(|o| o.truth == truth).unwrap_or_else(|| {
            self.0.outcomes.push(Outcome { truth: truth.to_owned(), ..Outcome::default() });
            self.0.outcomes.len() - 1
        });
        let outcome = &mut self.0.outcomes[place];
        outcome.cases += 1;
        match () {
            () if right => outcome.right += 1,
            () if in_class => outcome.in_class += 1,
            () if !names.is_empty() => {
                outcome.wrong += 1;
                outcome.said_instead.extend(names.iter().map(|c| c.effect.clone()));
            }
            () if found.verdict == "unexplained" => outcome.unexplained += 1,
            () => outcome.missed += 1,
        }
    }

    fn text(&self) -> String {
        let score = &self.0;
        let share = |part: usize, whole: usize| {
            if whole == 0 { "none".to_owned() } else { format!("{part} of {whole}") }
        };
        let named_though =
            |truth: &str| score.outcome(truth).map_or_else(|| "none".to_owned(), |o| share(o.cases - o.right, o.cases));
        let lines = [
            format!("visible effects named, or in a class that holds them: {}", share(score.named(), score.visible())),
            format!("right joint, of those: {}", share(score.right_joint, score.named())),
            format!("names beside the truth: {}", score.beside),
            format!("named on nothing wrong: {}", named_though("nothing")),
            format!("outside the library, misnamed: {}", named_though("outside")),
            format!("shrink predicted within 5 points: {}", share(score.close, score.predictions)),
            format!("shrink within its 90 % interval: {}", share(score.covered, score.predictions)),
        ];
        lines.iter().map(|line| paragraph("  ", line)).collect()
    }
}
