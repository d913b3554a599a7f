//! What the studies on measured arms have in common: where the data are, and where their table goes.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use rivet_files::{writable, write_whole};
use serde_json::Value;

use crate::outputs::write_json;
use crate::table::show;
use rivet_analysis::fault::Fault;

/// Arguments of `rivet study real` and `rivet study withheld`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder with one folder per data set.
    #[arg(long, value_name = "DIR", default_value = "../shared/data/real")]
    pub(crate) data: PathBuf,
    /// Checkout whose robots/ and tests/robots/ are used.
    #[arg(long, value_name = "DIR", default_value = ".")]
    pub(crate) root: PathBuf,
    /// Also write the figures as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Also write the table as Markdown.
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
}

impl Args {
    /// That the folders are there and the files can be written: asked before what takes long.
    pub(crate) fn check(&self) -> Result<()> {
        self.check_without_data()?;
        if !self.data.is_dir() {
            return Err(
                Fault::Usage(format!("{}: no such folder of data: give --data DIR", self.data.display())).into()
            );
        }
        Ok(())
    }

    /// The same of a study that needs no data.
    pub(crate) fn check_without_data(&self) -> Result<()> {
        if !self.root.join("robots").is_dir() {
            let root = self.root.display();
            return Err(Fault::Usage(format!(
                "{root}: no robots/ there: the robot files of a checkout are needed; run it in one, or give --root DIR"
            ))
            .into());
        }
        for path in self.json.iter().chain(&self.markdown) {
            writable(path).with_context(|| path.display().to_string())?;
        }
        Ok(())
    }
}

/// What came of a study.
pub(crate) struct Findings {
    /// Markdown; none when no set was there or all failed.
    pub(crate) table: Option<String>,
    /// The same, whole.
    pub(crate) json: Value,
    /// Sets whose data are not there.
    pub(crate) skipped: Vec<&'static str>,
    /// Sets that failed, with the reason.
    pub(crate) failed: Vec<String>,
}

impl Args {
    /// Shows the findings and writes the files that were asked for.
    pub(crate) fn tell(&self, findings: &Findings) -> Result<ExitCode> {
        // Files of an earlier run stay where nothing came of this one.
        let Some(table) = findings.table.as_deref() else {
            if findings.failed.is_empty() {
                bail!("{}: none of the data sets is there", self.data.display());
            }
            bail!("{}", findings.failed.join("\n"));
        };
        show(table)?;
        for name in &findings.skipped {
            show(&format!("skipped, no data: {name}\n"))?;
        }
        if let Some(path) = &self.markdown {
            write_whole(path, table).with_context(|| path.display().to_string())?;
        }
        write_json(self.json.as_ref(), &findings.json)?;
        if !findings.failed.is_empty() {
            bail!("{}", findings.failed.join("\n"));
        }
        Ok(ExitCode::SUCCESS)
    }
}
