//! `rivet`: on-line identification and control of geared robot arms, and all that goes with it.

// Texts pass `table::show` or `rivet_files::note`, which escape what a terminal would act on.
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod as_found;
mod bench_loop;
mod blind;
mod changes;
mod check;
mod children;
mod control;
mod convert;
mod demo;
mod diagnose;
mod doctor;
mod documents;
mod exit;
mod figures;
mod fleet;
mod generate;
mod identify;
mod inspect;
mod live;
mod map;
mod monitor;
mod new;
mod number;
mod online;
mod optional_program;
mod outputs;
mod predict;
mod record;
mod replay;
mod robot;
mod stream;
mod study;
mod summary;
mod table;

use clap::{CommandFactory as _, Parser, Subcommand};
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
    /// Run a simulated arm, the daemon and the controller on this machine, for about a minute
    Demo(demo::Args),
    /// Play a log through shared memory into rivetd
    Replay(replay::Args),
    /// Identify base parameters from logs
    Identify(identify::Args),
    /// Diagnose the gap between simulator and arm: joint, effect, shrink of the gap
    Diagnose(diagnose::Args),
    /// Compare two diagnoses
    Compare(changes::Args),
    /// Draw, diagnose and score simulated cases whose answers are withheld
    Blind(blind::Args),
    /// Show what a recording holds and how it would be read
    Inspect(inspect::Args),
    /// Write a recording in another format, with its signals under the names that rivet reads
    Convert(convert::Args),
    /// Record what robot, rivetd and rivet-controller publish, as MCAP
    Record(record::Args),
    /// Read a robot by its own protocol, and publish its samples for rivetd
    #[command(subcommand, arg_required_else_help = true)]
    Robot(robot::Args),
    /// Predict the torque of a log
    Predict(predict::Args),
    /// Compute the figures of the paper, with the numbers that must hold
    Figures(figures::Args),
    /// Write a robot file from a URDF and logs; unknown values are marked
    New(new::Args),
    /// Check a robot file and print its values
    Check(check::Args),
    /// Show the state of a running rivetd and rivet-controller, live or once
    Monitor(monitor::Args),
    /// Send a command to a running rivetd: freeze, resume, reset, save, reload
    Control(control::Args),
    /// Connect an arm that speaks ROS 2 to rivetd, by DDS; the program rivet-ros2
    Ros2(Box<rivet_service::Ros2Options>),
    /// Show a running robot in Foxglove, over WebSocket; the program rivet-view
    View(Box<rivet_service::ViewOptions>),
    /// Check this machine for real time, and print what to change
    Doctor(doctor::Args),
    /// Measure what the daemon's loop adds to the wake-up latency of cyclictest
    BenchLoop(bench_loop::Args),
    /// Compute tables from seeds and measured logs
    #[command(subcommand)]
    Study(study::Args),
    /// Run the daemon, as rivetd
    Daemon(rivet_daemon::Options),
    /// Run the controller, as rivet-controller
    Controller(rivet_controller::Options),
    /// Write man pages and the completions of bash, zsh and fish
    Generate(generate::Args),
    /// Run a simulated robot, as rivet-sim
    Sim(Box<rivet_simulation::process::Options>),
}

impl Command {
    /// Whether this is arithmetic over whole logs, and no process of the loop.
    fn works_through_logs(&self) -> bool {
        matches!(
            self,
            Command::Identify(_)
                | Command::Convert(_)
                | Command::Inspect(_)
                | Command::Diagnose(_)
                | Command::Blind(_)
                | Command::Predict(_)
                | Command::Study(_)
        )
    }
}

fn main() -> ExitCode {
    let arguments: Arguments = match rivet_service::command_line() {
        Ok(arguments) => arguments,
        Err(code) => return code,
    };
    let command = arguments.command.unwrap_or_else(|| Command::Demo(demo::Args::default()));
    table::fit_terminal();
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
        Command::Inspect(args) => inspect::run(args),
        Command::Convert(args) => convert::run(args),
        Command::Record(args) => record::run(args),
        Command::Robot(args) => robot::run(args),
        Command::Predict(args) => predict::run(args),
        Command::Figures(args) => figures::run(args),
        Command::New(args) => new::run(args),
        Command::Check(args) => check::run(args),
        Command::Monitor(args) => monitor::run(args),
        Command::Control(args) => control::run(args),
        Command::Ros2(_) => optional_program::ROS2.run(),
        Command::View(_) => optional_program::VIEW.run(),
        Command::Doctor(args) => doctor::run(args),
        Command::BenchLoop(args) => bench_loop::run(args),
        Command::Study(args) => study::run(args),
        Command::Generate(args) => generate::run(args, Arguments::command()),
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
        table::show_failure(&why);
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
