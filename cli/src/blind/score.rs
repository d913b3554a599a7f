//! `rivet blind score`: verdicts against answers.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, Result, bail};
use rivet_analysis::fault::Fault;
use rivet_report::{Answer, Found, Score, Tally};
use serde::de::DeserializeOwned;

use crate::documents::read_document;
use crate::outputs::{Outputs, write_json};
use crate::table::{Table, paragraph, show};

/// Arguments of `rivet blind score`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Verdicts of `rivet blind run`.
    #[arg(value_name = "VERDICTS.json")]
    verdicts: PathBuf,
    /// Answers of `rivet blind make`.
    #[arg(value_name = "ANSWERS.json")]
    answers: PathBuf,
    /// Write the scores as JSON. The page of `rivet diagnose --html` shows an array of several sets.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the figures as a table in Markdown.
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// Name of the set [default: name of its folder].
    #[arg(long, value_name = "NAME")]
    name: Option<String>,
}

pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    Outputs::given(vec![&args.verdicts, &args.answers])
        .file("--json", args.json.as_ref())
        .file("--markdown", args.markdown.as_ref())
        .check()?;
    let verdicts: BTreeMap<String, serde_json::Value> = read(&args.verdicts)?;
    let is_answer = |case: &serde_json::Value| case.get("verdict").is_none() && case.get("effects").is_some();
    if !verdicts.is_empty() && verdicts.values().all(is_answer) {
        let why = "are answers, where the verdicts are expected; the order is VERDICTS.json ANSWERS.json";
        return Err(Fault::Usage(format!("{}: {why}", args.verdicts.display())).into());
    }
    // A diagnosis that failed names nothing, which must not pass for a right answer.
    let failed: Vec<&String> =
        verdicts.iter().filter(|(_, v)| v.get("error").is_some()).map(|(name, _)| name).collect();
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
    let set = args.name.clone().or(folder).unwrap_or_default();
    let mut tally = Tally::new(set, env!("CARGO_PKG_VERSION"), answers.len());
    let mut table = Table::new(["case", "truth", "verdict", "named", ""]);
    for (name, answer) in &answers {
        let found = &verdicts[name];
        let mark = tally.add(answer, found);
        let (truth, named) = (or_dash(&answer.effects()), or_dash(&found.names(answer)));
        table.row([name.clone(), truth, found.verdict().to_owned(), named, mark]);
    }
    let score = tally.finish();
    write_json(args.json.as_ref(), &score)?;
    if let Some(path) = &args.markdown {
        rivet_files::write_whole(path, score.markdown()).with_context(|| path.display().to_string())?;
    }
    show(&table.text())?;
    show(&as_text(&score))?;
    Ok(ExitCode::SUCCESS)
}

fn read<T: DeserializeOwned>(path: &Path) -> Result<T> {
    read_document(path, "a list of cases", "rivet blind")
}

fn or_dash(names: &[&str]) -> String {
    if names.is_empty() { "-".to_owned() } else { names.join(" ") }
}

fn as_text(score: &Score) -> String {
    let summary = score.summary();
    let mut out: String =
        summary.iter().map(|(figure, value)| paragraph("  ", &format!("{figure}: {value}"))).collect();
    let mut table = Table::new(["nominal", "effects", "cases", "visible", "named", "right joint", "false names", "F1"]);
    for g in &score.groups {
        table.row([
            if g.wrong_nominal { "wrong" } else { "exact" }.to_owned(),
            g.effects.to_string(),
            g.cases.to_string(),
            g.visible.to_string(),
            g.named.to_string(),
            g.right_joint.to_string(),
            g.beside.to_string(),
            if g.effects == 0 { "-".to_owned() } else { format!("{:.2}", g.f1()) },
        ]);
    }
    out += &table.text();
    let mut table = Table::new(["torque over noise", "effects", "named"]);
    for bin in score.strength.iter().filter(|bin| bin.count > 0) {
        let to = if bin.to < 1e9 { bin.to.to_string() } else { "more".to_owned() };
        table.row([format!("{} to {to}", bin.from), bin.count.to_string(), bin.right.to_string()]);
    }
    out += &table.text();
    let mut table = Table::new(["confidence", "causes", "right", "share"]);
    for bin in score.confidence.iter().filter(|bin| bin.count > 0) {
        let share = bin.right as f64 / bin.count as f64;
        table.row([format!("{:.2}", bin.mean), bin.count.to_string(), bin.right.to_string(), format!("{share:.2}")]);
    }
    out + &table.text()
}
