//! Prints what is known about a robot file: `cargo run -p rivet-config --example describe -- robots/ur10e/robot.toml`.

use std::process::ExitCode;

fn main() -> ExitCode {
    for path in std::env::args_os().skip(1) {
        match rivet_config::load(&path) {
            Ok(robot) => println!("{}", robot.describe()),
            Err(mistakes) => {
                eprintln!("{mistakes}");
                return ExitCode::FAILURE;
            }
        }
    }
    ExitCode::SUCCESS
}
