//! The command line of `rivet-view`, which is that of `rivet view`.

use std::path::PathBuf;

use crate::bridge_options::{BridgeOptions, within};

/// Shows a running robot in Foxglove: serves its messages, friction curves, residuals and states over WebSocket. Reads only.
#[derive(Clone, Debug, clap::Parser)]
#[command(
    name = "rivet-view",
    version,
    max_term_width = 100,
    after_help = "There is no authentication: who reaches the port can read. Ctrl-C ends it."
)]
pub struct ViewOptions {
    /// The robot file.
    #[arg(value_name = "ROBOT.toml")]
    pub robot: PathBuf,
    /// Address or name to listen at
    #[arg(long, value_name = "HOST", default_value = "127.0.0.1")]
    pub host: String,
    /// Port to listen at; 0 takes a free one
    #[arg(long, value_name = "PORT", default_value_t = 8765)]
    pub port: u16,
    /// Most messages a second of joint states, setpoints, second encoders and parameters each
    #[arg(long, value_name = "HZ", default_value_t = 100.0, value_parser = rate)]
    pub rate: f64,
    /// Write the Foxglove layout for this robot, and end
    #[arg(long, value_name = "OUT.json")]
    pub layout: Option<PathBuf>,
    /// What it shares with other bridges.
    #[command(flatten)]
    pub bridge: BridgeOptions,
}

fn rate(text: &str) -> Result<f64, String> {
    within(text, 0.1, 10_000.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::{CommandFactory as _, Parser as _};

    #[test]
    fn the_command_line_is_sound() {
        ViewOptions::command().debug_assert();
        let parse = |line: &str| ViewOptions::try_parse_from(line.split_whitespace());
        let options = parse("rivet-view robot.toml").expect("all have defaults");
        assert_eq!((options.host.as_str(), options.port, options.rate), ("127.0.0.1", 8765, 100.0));
        for wrong in ["--port 65536", "--rate 0", "--rate nan", "--seconds 0", "--seconds inf"] {
            assert!(parse(&format!("rivet-view robot.toml {wrong}")).is_err(), "{wrong}");
        }
    }
}
