//! `--map`: which channels of a recording are which, on the command line.

use anyhow::Result;
use rivet_config::Robot;

/// What logs are read by, where their names do not decide.
#[derive(Clone, Debug, Default, clap::Args)]
pub(crate) struct MapArgs {
    /// Channel of the logs, as a key of [log] in the robot file: q=/joint_states/{joint}/position, tau_sign=1,-1; may be repeated.
    #[arg(long = "map", value_name = "KEY=VALUE")]
    pub(crate) entries: Vec<String>,
}

impl MapArgs {
    /// The robot with the channels of the command line in the place of its file's.
    ///
    /// # Errors
    /// An unknown key, or a value that breaks its rule.
    pub(crate) fn apply(&self, robot: Robot) -> Result<Robot> {
        rivet_analysis::map::apply(robot, &self.entries)
    }
}
