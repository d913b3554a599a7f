//! `rivet blind scores`: how good this version was on sets of cases.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context as _, Result};
use rivet_analysis::diagnose::scores;

use crate::outputs::Outputs;
use crate::table::show;

/// Arguments of `rivet blind scores`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Also write the tables as Markdown.
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
}

pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    Outputs::given(Vec::new()).file("--markdown", args.markdown.as_ref()).check()?;
    let text = rivet_report::scores_markdown(&scores()?);
    if let Some(path) = &args.markdown {
        rivet_files::write_whole(path, &text).with_context(|| path.display().to_string())?;
    }
    show(&text)?;
    Ok(ExitCode::SUCCESS)
}
