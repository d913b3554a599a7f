//! `rivet`: on-line identification and control of geared robot arms, and all that goes with it.

// Texts pass `table::show` or `rivet_files::note`, which escape what a terminal would act on.
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod as_found;
mod bench_loop;
mod blind;
mod bounds;
mod changes;
mod channels;
mod check;
mod children;
mod clock;
mod coarse;
mod compare;
mod control;
mod delays;
mod demo;
mod diagnose;
mod doctor;
mod doubts;
mod evidence;
mod exit;
mod export;
mod figures;
mod frozen;
mod glitches;
mod identify;
mod jitter;
mod kinematics;
mod live;
mod monitor;
mod number;
mod online;
mod outputs;
mod passport;
mod patched;
mod predict;
mod progress;
mod refine;
mod replay;
mod rollout;
mod rounding;
mod runs;
mod self_check;
mod stairs;
mod stream;
mod study;
mod summary;
mod table;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// Identifies a geared robot arm while it works, and shows what its simulator gets wrong.
#[derive(Parser)]
#[command(version, max_term_width = 100, after_help = "Without a command: rivet demo")]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Subcommand)]
enum Command {
    /// Plant, daemon and controller at work on this machine, half a minute
    Demo(demo::Args),
    /// A log through shared memory into rivetd, as if live
    Replay(replay::Args),
    /// Base parameters from logs
    Identify(identify::Args),
    /// Where the simulator differs from the arm, which effect causes it, how far the gap shrinks
    Diagnose(diagnose::Args),
    /// What changed between two diagnoses
    Compare(changes::Args),
    /// Diagnoses of cases whose answers are withheld, and how good they were
    Blind(blind::Args),
    /// Torque that a model predicts for a log
    Predict(predict::Args),
    /// The paper's figures, computed anew, with the numbers that must hold
    Figures(figures::Args),
    /// Whether a robot file is sound, and what it says
    Check(check::Args),
    /// What a running rivetd and rivet-controller say of themselves, live or once
    Monitor(monitor::Args),
    /// Asks a running rivetd: freeze, resume, reset, save, reload
    Control(control::Args),
    /// Whether this machine is fit for real time, and what to change
    Doctor(doctor::Args),
    /// What the daemon's loop adds to wake-ups as cyclictest measures them
    BenchLoop(bench_loop::Args),
    /// Tables computed anew from seeds
    #[command(subcommand)]
    Study(study::Args),
    /// The daemon, as rivetd
    Daemon(rivet_daemon::Options),
    /// The controller, as rivet-controller
    Controller(rivet_controller::Options),
    /// A simulated robot, as rivet-sim
    Sim(Box<rivet_simulation::process::Options>),
}

impl Command {
    /// Whether this is arithmetic over whole logs, and no process of the loop.
    fn works_through_logs(&self) -> bool {
        matches!(
            self,
            Command::Identify(_) | Command::Diagnose(_) | Command::Blind(_) | Command::Predict(_) | Command::Study(_)
        )
    }
}

fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(why) => {
            // Help and version go to standard output and are no error. A terminal that is gone changes nothing here.
            if rivet_files::arguments_are_printable() {
                let _ = why.print();
            } else {
                rivet_files::note(why.render());
            }
            return if why.use_stderr() { ExitCode::from(exit::USAGE) } else { ExitCode::SUCCESS };
        }
    };
    let command = arguments.command.unwrap_or_else(|| Command::Demo(demo::Args::default()));
    if command.works_through_logs() {
        rivet_realtime::keep_freed_memory();
    }
    let result = match &command {
        Command::Demo(args) => demo::run(args),
        Command::Replay(args) => replay::run(args),
        Command::Identify(args) => identify::run(args),
        Command::Diagnose(args) => diagnose::run(args),
        Command::Compare(args) => changes::run(args),
        Command::Blind(args) => blind::run(args),
        Command::Predict(args) => predict::run(args),
        Command::Figures(args) => figures::run(args),
        Command::Check(args) => check::run(args),
        Command::Monitor(args) => monitor::run(args),
        Command::Control(args) => control::run(args),
        Command::Doctor(args) => doctor::run(args),
        Command::BenchLoop(args) => bench_loop::run(args),
        Command::Study(args) => study::run(args),
        Command::Daemon(options) => {
            return ended(rivet_daemon::run(options), rivet_daemon::StartError::exit_code);
        }
        Command::Controller(options) => {
            let result = rivet_controller::run(options);
            return ended(result, rivet_controller::StartError::exit_code);
        }
        Command::Sim(options) => return rivet_simulation::process::main(options),
    };
    result.unwrap_or_else(|why| {
        rivet_files::note(format_args!("rivet: {why:#}"));
        // A robot file that cannot be used is told apart, as by the daemon; so is a log.
        ExitCode::from(exit::code(&why))
    })
}

fn ended<E: std::fmt::Display>(result: Result<(), E>, code: impl Fn(&E) -> u8) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            let code = code(&why);
            log::error!(rivet_event = "failed", exit_code = code; "{why}");
            ExitCode::from(code)
        }
    }
}
