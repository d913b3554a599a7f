//! `cargo xtask`: what is done with the built workspace.

mod install;

use clap::{Parser, Subcommand};

#[derive(Parser)]
#[command(version, about = "What is done with the built workspace")]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Builds the programs and puts them, their units and what goes with them where the system looks for them
    Install(install::Args),
}

fn main() -> anyhow::Result<()> {
    match Arguments::parse().command {
        Command::Install(args) => install::run(&args),
    }
}
