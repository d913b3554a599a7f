//! `cargo run --release -p rivet-fuzz -- TARGET... --seconds N`: searches for bytes that break something.

use anyhow::{Context as _, Result, bail};
use clap::Parser;
use rivet_fuzz::{TARGETS, search, seeds};
use std::time::Duration;

#[derive(Parser)]
#[command(
    version,
    about = "Searches for bytes that break something; an input that does is written to the working directory"
)]
struct Arguments {
    /// Targets; all, one after the other, without any
    targets: Vec<String>,
    /// Seconds for each
    #[arg(long, default_value_t = 60)]
    seconds: u64,
    /// Seed of the search
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    for name in &arguments.targets {
        if !TARGETS.iter().any(|target| target.name == name) {
            bail!("{name}: no such target; there are {}", TARGETS.map(|target| target.name).join(", "));
        }
    }
    // What a panic says is told with the input that made it; those that are caught further down are nobody's concern.
    std::panic::set_hook(Box::new(|_| {}));
    let mut broken = 0;
    for target in &TARGETS {
        if !arguments.targets.is_empty() && !arguments.targets.iter().any(|name| name == target.name) {
            continue;
        }
        let seeds = seeds(target).with_context(|| format!("the corpus of {}", target.name))?;
        let found = search(target, seeds, Duration::from_secs(arguments.seconds), arguments.seed);
        println!("{:<16} {:>9} inputs, {:>5} signatures", target.name, found.inputs, found.signatures);
        if let Some((input, said)) = found.broken {
            let path = format!("broken-{}.bin", target.name);
            std::fs::write(&path, input).with_context(|| path.clone())?;
            println!("{:<16} BROKEN: {said} ({path})", target.name);
            broken += 1;
        }
    }
    if broken > 0 {
        bail!("{broken} targets broke");
    }
    Ok(())
}
