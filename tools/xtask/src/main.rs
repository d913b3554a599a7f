//! `cargo xtask`: what is done with the workspace as a whole.

mod deb;
mod fuzz;
mod golden;
mod install;
mod licences;
mod mirrors;
mod sbom;
mod tables;

use clap::{Parser, Subcommand};

#[derive(Parser)]
#[command(version, about = "What is done with the workspace as a whole")]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Builds the programs and puts them, their units and what goes with them where the system looks for them
    Install(install::Args),
    /// Builds a Debian package of what `install --prefix /usr` installs; needs cargo-deb
    Deb(deb::Args),
    /// Lists the crates in each program, with versions and licences, as CycloneDX; needs cargo-cyclonedx
    Sbom(sbom::Args),
    /// Searches for bytes that break something, steered by coverage (libFuzzer)
    Fuzz(fuzz::Args),
    /// Hashes diagnoses and exports of a fixed set of cases, or compares them with the stored hashes (--check)
    Golden(golden::Args),
    /// Puts the tables of docs/tables, which commands wrote, into the pages that show them
    Tables(tables::Args),
    /// Writes the C header and the Python module from the messages, or compares them (--check)
    Mirrors(mirrors::Args),
}

fn main() -> anyhow::Result<()> {
    match Arguments::parse().command {
        Command::Install(args) => install::run(&args),
        Command::Deb(args) => deb::run(&args),
        Command::Sbom(args) => sbom::run(&args),
        Command::Fuzz(args) => fuzz::run(&args),
        Command::Golden(args) => golden::run(&args),
        Command::Tables(args) => tables::run(&args),
        Command::Mirrors(args) => mirrors::run(&args),
    }
}
