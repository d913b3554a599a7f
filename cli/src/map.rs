//! `--map`: which channels of a recording are which, on the command line.

use std::path::Path;

use anyhow::Result;
use rivet_analysis::runs::load_robot;
use rivet_config::Robot;

/// What logs are read by, where their names do not decide.
#[derive(Clone, Debug, Default, clap::Args)]
pub(crate) struct MapArgs {
    /// Channel of the logs, as a key of [log] in the robot file: q=/joint_states/{joint}/position, tau_sign=1,-1; may be repeated.
    #[arg(long = "map", value_name = "KEY=VALUE")]
    pub(crate) entries: Vec<String>,
}

impl MapArgs {
    /// The robot of a file that logs follow, with the channels of the command line in the place of the file's.
    ///
    /// # Errors
    /// As of [`load_robot`].
    pub(crate) fn load(&self, robot: &Path) -> Result<Robot> {
        load_robot(robot, &self.entries)
    }
}
