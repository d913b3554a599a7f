//! `rivet robot`: robots that are read by their own protocols.

use std::process::ExitCode;

use anyhow::{Result, bail};
use rivet_analysis::fault::Fault;
use rivet_realtime::Shutdown;
use rivet_robots::ur::{self, Settings, Summary, UrError};
use serde_json::json;

use crate::control::OnBus;
use crate::table::{number, show, show_json};

/// Which robot.
#[derive(clap::Subcommand)]
pub(crate) enum Args {
    /// Universal Robots, CB3, e-Series and later, by RTDE
    Ur(UrArgs),
}

/// Arguments of `rivet robot ur`.
#[derive(clap::Args)]
#[command(
    after_help = "Ctrl-C ends it. It connects again whenever the controller returns. docs/connect.md: fields, units, rates."
)]
pub(crate) struct UrArgs {
    #[command(flatten)]
    bus: OnBus,
    /// Name or address of the controller.
    #[arg(long)]
    host: String,
    /// TCP port of RTDE.
    #[arg(long, default_value_t = 30004)]
    port: u16,
    /// Samples a second; 1 / sample_period_s of the robot file.
    #[arg(long, value_name = "HZ", value_parser = |text: &str| crate::number::within(text, 1.0..=500.0))]
    rate: Option<f64>,
    /// End after so many seconds of samples.
    #[arg(long, value_name = "S", value_parser = crate::number::seconds)]
    seconds: Option<f64>,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
    /// End with the process that started this one.
    #[arg(long, hide = true)]
    die_with_parent: bool,
}

pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    match args {
        Args::Ur(args) => universal_robots(args),
    }
}

fn universal_robots(args: &UrArgs) -> Result<ExitCode> {
    let robot = rivet_config::load(&args.bus.robot)?;
    let settings = Settings {
        bus: args.bus.config(&robot.config.bus),
        host: args.host.clone(),
        port: args.port,
        rate_hz: args.rate,
        seconds: args.seconds,
        draws_status: !args.json,
    };
    let shutdown = Shutdown::on_signals()?;
    if args.die_with_parent {
        rivet_realtime::die_with_parent()?;
    }
    let summary = ur::run(&robot, &settings, &shutdown).map_err(|why| match why {
        UrError::Settings(why) => Fault::Usage(why).into(),
        UrError::RobotFile(why) => Fault::Config(why).into(),
        why => anyhow::Error::new(why),
    })?;
    let (name, period_s) = (&robot.config.name, robot.config.sample_period_s);
    let Summary { connections, restarts, samples, lost, repeated, with_fault_bit, not_sent, texts, .. } = summary;
    let seconds = samples as f64 * period_s;
    if args.json {
        let value = json!({"robot": name, "host": args.host, "port": args.port, "controller": summary.controller,
            "torque_field": summary.torque_field, "period_s": period_s, "seconds": seconds, "samples": samples,
            "lost": lost, "repeated": repeated, "with_fault_bit": with_fault_bit, "not_sent": not_sent,
            "connections": connections, "restarts": restarts, "texts": texts});
        show_json(&value)?;
    } else {
        show(&format!(
            "{name}: {samples} samples in {} s, {lost} lost, {not_sent} not sent, {with_fault_bit} with a fault bit, \
             {connections} connections\n",
            number(seconds, 4)
        ))?;
    }
    if samples == 0 {
        bail!("no sample came from {}:{}", args.host, args.port);
    }
    Ok(ExitCode::SUCCESS)
}
