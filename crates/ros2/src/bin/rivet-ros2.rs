//! `rivet-ros2 ROBOT.toml`: an arm that speaks ROS 2 on rivet's bus.

use std::process::ExitCode;

fn main() -> ExitCode {
    let options: rivet_service::Ros2Options = match rivet_service::command_line() {
        Ok(options) => options,
        Err(code) => return code,
    };
    match rivet_ros2::run(&options) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            rivet_files::note(format_args!("rivet-ros2: {why}"));
            ExitCode::from(why.exit_code())
        }
    }
}
