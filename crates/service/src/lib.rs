//! What a service owes its manager and its operator: when it is ready, that it is alive, a log whose entries carry
//! fields, and a record of its last second. Nothing here is for a real-time thread but [`Flight::push`] and [`Flight::ask`].
//!
//! Without a service manager every call to it does nothing, and the log is plain text on standard error.
//!
//! It also defines the command lines of `rivet-ros2` and `rivet-view`: `rivet` describes them without containing those programs.

mod bridge_options;
mod command_line;
mod flight;
mod journal;
mod manager;
mod ros2_options;
mod state_folder;
mod view_options;

pub use bridge_options::{BridgeOptions, within};
pub use command_line::{USAGE, command_line};
pub use flight::{Flight, RECORDED, Reason, abort_on_panic};
pub use journal::log_as;
pub use manager::Manager;
pub use ros2_options::{Ros2Options, SetpointType, check_ros_topic};
pub use state_folder::{StateFolder, Storage};
pub use view_options::ViewOptions;

/// The warning of a process that polls for samples, since the robot controller does not send the wake-up event.
pub const NOT_NOTIFIED: &str = "joint states arrive without the wake-up event, so this process polls for them; the robot controller is to \
                                notify the event service rivet/<robot>/joint-state after each joint state";
