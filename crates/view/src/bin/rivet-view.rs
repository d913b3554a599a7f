//! `rivet-view ROBOT.toml`: a robot's bus for Foxglove.

use std::process::ExitCode;

fn main() -> ExitCode {
    let options: rivet_service::ViewOptions = match rivet_service::command_line() {
        Ok(options) => options,
        Err(code) => return code,
    };
    match rivet_view::run(&options) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            rivet_files::note(format_args!("rivet-view: {why}"));
            ExitCode::from(why.exit_code())
        }
    }
}
