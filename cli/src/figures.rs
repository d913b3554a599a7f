//! `rivet figures`: the paper's figures, computed anew, on one page and as a table of what must hold.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result};
use rivet_studies::figures::{FIGURES, Figure, REPETITIONS, figure, markdown, page, to_json};

use crate::outputs::{Outputs, write_json};
use crate::table::{paragraph, show};
use rivet_analysis::fault::Fault;
use rivet_analysis::progress::Progress;

/// Arguments of `rivet figures`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Figure numbers of the paper [default: all].
    #[arg(value_name = "N")]
    numbers: Vec<u32>,
    /// File for the page.
    #[arg(long, value_name = "FILE.html", default_value = "figures.html")]
    out: PathBuf,
    /// Also write what must hold as a table in Markdown.
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// Also write the checks as JSON (docs/operating.md).
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Computes, writes the page, prints the table; fails if a number does not hold.
pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let mut numbers: Vec<u32> = Vec::new();
    for number in if args.numbers.is_empty() { &FIGURES[..] } else { &args.numbers } {
        if !numbers.contains(number) {
            numbers.push(*number);
        }
    }
    if let Some(unknown) = numbers.iter().find(|n| !FIGURES.contains(n)) {
        let there = FIGURES.map(|n| n.to_string()).join(", ");
        return Err(Fault::Usage(format!("figure {unknown} is not computed; there are {there}")).into());
    }
    let files = Outputs::given(Vec::new()).file("--out", Some(&args.out)).file("--json", args.json.as_ref());
    files.file("--markdown", args.markdown.as_ref()).check()?;
    let mut figures: Vec<Figure> = Vec::new();
    let mut progress = Progress::new("computing the figures", numbers.len());
    for (done, number) in numbers.iter().enumerate() {
        progress.set(done);
        let Some(figure) = figure(*number, REPETITIONS) else { continue };
        progress.done();
        show(&text(&figure))?;
        figures.push(figure);
    }
    rivet_files::write_whole(&args.out, page(&figures)).with_context(|| args.out.display().to_string())?;
    if let Some(path) = &args.markdown {
        rivet_files::write_whole(path, markdown(&figures)).with_context(|| path.display().to_string())?;
    }
    write_json(args.json.as_ref(), &to_json(&figures))?;
    show(&format!("page written to {}\n", args.out.display()))?;
    let holds = figures.iter().flat_map(|f| &f.checks).all(|c| c.pass);
    Ok(if holds { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn text(figure: &Figure) -> String {
    let mut out = paragraph(&format!("Figure {}  ", figure.number), &figure.title);
    for check in &figure.checks {
        let word = if check.pass { "pass" } else { "FAIL" };
        out += &paragraph(&format!("  {word}  "), &format!("{}: {} ({})", check.what, check.measured, check.limit));
    }
    out
}
