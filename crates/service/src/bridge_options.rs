//! Options of the programs that connect a robot's bus with something else.

use std::path::PathBuf;

/// When it ends, what it prints, and which bus it is on.
#[derive(Clone, Debug, clap::Args)]
pub struct BridgeOptions {
    /// End after so many seconds
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub seconds: Option<f64>,
    /// Print the counts at the end as JSON
    #[arg(long)]
    pub json: bool,
    /// Override `[bus] prefix`
    #[arg(long)]
    pub prefix: Option<String>,
    /// Override `[bus] root`
    #[arg(long)]
    pub root: Option<PathBuf>,
    /// End when the process that started this one ends
    #[arg(long, hide = true)]
    pub die_with_parent: bool,
}

/// The number in `text`, if it lies in `least` to `most`.
///
/// # Errors
/// It is no number, or does not lie there.
pub fn within(text: &str, least: f64, most: f64) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "no number".to_owned())?;
    if (least..=most).contains(&value) { Ok(value) } else { Err(format!("it must lie in {least} to {most}")) }
}

fn seconds(text: &str) -> Result<f64, String> {
    within(text, 1e-3, 1e9)
}
