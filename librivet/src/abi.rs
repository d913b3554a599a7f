//! The C interface. No panic crosses it: each function that does work catches what is thrown inside and returns
//! [`Status::Internal`].
#![allow(unsafe_code, reason = "functions that C calls have pointers as arguments, and exported names")]

use std::cell::RefCell;
use std::ffi::{CStr, CString, OsStr, c_char};
use std::os::unix::ffi::OsStrExt as _;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Duration;

use rivet_ipc_schema::{BusConfig, Command, ControllerHealth, Health, Parameters};

use crate::clock::now_ns;
use crate::robot::{Counters, Robot};
use crate::sample::Sample;
use crate::status::Status;

/// Version of this interface: functions, structs and the messages of rivet.h. The first argument of rivet_open.
pub const RIVET_ABI: u32 = 1;

/// A robot on the bus. One thread at a time may use it.
pub struct RivetRobot {
    robot: Robot,
    text: CString,
}

thread_local! {
    /// Why `rivet_open` failed last on this thread.
    static OPEN_ERROR: RefCell<CString> = RefCell::default();
}

/// Runs `work`; a panic in it becomes a status.
fn guarded(work: impl FnOnce() -> Status) -> Status {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or(Status::Internal)
}

/// Text for C; a zero byte ends it early.
fn c_text(text: &str) -> CString {
    CString::new(text.split('\0').next().unwrap_or_default()).unwrap_or_default()
}

fn refuse(status: Status, text: &str) -> Status {
    OPEN_ERROR.with(|error| *error.borrow_mut() = c_text(text));
    status
}

/// The robot behind a pointer.
///
/// # Safety
/// `robot` is NULL or came from `rivet_open` and was not closed; no other thread uses it.
unsafe fn opened<'a>(robot: *mut RivetRobot) -> Option<&'a mut RivetRobot> {
    // SAFETY: the caller's promise.
    unsafe { robot.as_mut() }
}

/// Copies a value to where the caller wants it.
///
/// # Safety
/// `output` is NULL or points to memory for a `T`, initialised or not.
unsafe fn give<T: Copy>(output: *mut T, value: Option<&T>) -> Status {
    match value {
        _ if output.is_null() => Status::Argument,
        None => Status::None,
        Some(value) => {
            // SAFETY: the caller's promise; it is not NULL.
            unsafe { output.write(*value) };
            Status::Ok
        }
    }
}

/// A string of the caller's.
///
/// # Safety
/// `text` is NULL or ends with a zero byte.
unsafe fn c_bytes<'a>(text: *const c_char) -> Option<&'a CStr> {
    // SAFETY: the caller's promise; it is not NULL.
    (!text.is_null()).then(|| unsafe { CStr::from_ptr(text) })
}

/// Returns version and interface of the library, for example "librivet 0.1.0, interface 1".
#[unsafe(no_mangle)]
pub extern "C" fn rivet_version() -> *const c_char {
    const TEXT: &str = concat!("librivet ", env!("CARGO_PKG_VERSION"), ", interface 1\0");
    const _: () = assert!(RIVET_ABI == 1, "the text has the number too");
    TEXT.as_ptr().cast()
}

/// Joins the bus of a robot. Daemon and controller may start before or after. Not for the cycle.
///
/// abi: RIVET_ABI. robot: `name` of the robot file. prefix, root: as --prefix and --root of rivetd; NULL: the default.
/// joints: 1 to 8, as in the robot file; 0: only read. opened: where the robot is returned.
///
/// Returns RIVET_STATUS_OK, or an error: rivet_error(NULL) has the reason. The library's thread gets the scheduling of the
/// calling thread.
///
/// # Safety
/// Strings are NULL or end with a zero byte; `opened` is NULL or points to memory for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rivet_open(
    abi: u32,
    robot: *const c_char,
    prefix: *const c_char,
    root: *const c_char,
    joints: u32,
    opened: *mut *mut RivetRobot,
) -> Status {
    // SAFETY: the caller's promise.
    let (robot, prefix, root) = unsafe { (c_bytes(robot), c_bytes(prefix), c_bytes(root)) };
    guarded(|| {
        if abi != RIVET_ABI {
            let older = if abi < RIVET_ABI { "the program is the older side" } else { "the library is the older side" };
            let why = format!("the program was compiled for interface {abi}, librivet has {RIVET_ABI}: {older}");
            return refuse(Status::Version, &format!("{why}; use header and library of one version"));
        }
        let (Some(robot), false) = (robot, opened.is_null()) else {
            return refuse(Status::Argument, "rivet_open: robot and opened must not be NULL");
        };
        let mut config = BusConfig::default();
        if let Some(prefix) = prefix {
            config.prefix = prefix.to_string_lossy().into_owned();
        }
        if let Some(root) = root {
            config.root = OsStr::from_bytes(root.to_bytes()).into();
        }
        match Robot::open(&config, &robot.to_string_lossy(), joints) {
            Ok(robot) => {
                let robot = Box::new(RivetRobot { robot, text: CString::default() });
                // SAFETY: the caller's promise; it is not NULL.
                unsafe { opened.write(Box::into_raw(robot)) };
                Status::Ok
            }
            Err(why) => refuse(why.status(), &why.to_string()),
        }
    })
}

/// Sends what is queued, leaves the bus and frees the robot. NULL is allowed. Not for the cycle.
///
/// # Safety
/// `robot` is NULL or came from rivet_open and was not closed before.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rivet_close(robot: *mut RivetRobot) {
    if !robot.is_null() {
        guarded(|| {
            // SAFETY: the caller's promise; `rivet_open` made it as a box.
            drop(unsafe { Box::from_raw(robot) });
            Status::Ok
        });
    }
}

/// Publishes the sample of one period: setpoint first, then joint state, then the wake-up event. Call it once in each
/// control period. The sequence number is one more at each call.
///
/// Real-time safe: no allocation, no blocking; one system call wakes the library's thread.
/// Returns RIVET_STATUS_OK, RIVET_STATUS_FULL (the sample is lost) or RIVET_STATUS_ENDED.
///
/// # Safety
/// `robot` as in rivet_close; `sample` is NULL or points to a sample.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rivet_publish(robot: *mut RivetRobot, sample: *const Sample) -> Status {
    // SAFETY: the caller's promise.
    let (robot, sample) = unsafe { (opened(robot), sample.as_ref()) };
    guarded(|| match (robot, sample) {
        (Some(robot), Some(sample)) => robot.robot.publish(sample),
        _ => Status::Argument,
    })
}

/// Waits for the command that answers the last published sample, at most timeout_us [us].
///
/// Sleeps in steps of 20 us; no allocation. Returns RIVET_STATUS_OK with the answer, or RIVET_STATUS_NONE and leaves
/// command unchanged.
///
/// # Safety
/// `robot` as in rivet_close; `command` is NULL or points to memory for a command.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rivet_wait_command(robot: *mut RivetRobot, timeout_us: u32, command: *mut Command) -> Status {
    // SAFETY: the caller's promise.
    let robot = unsafe { opened(robot) };
    guarded(|| {
        let (Some(robot), false) = (robot, command.is_null()) else { return Status::Argument };
        let answer = robot.robot.wait_for_command(Duration::from_micros(timeout_us.into()));
        // SAFETY: the caller's promise.
        unsafe { give(command, answer.as_ref()) }
    })
}

/// Reads the latest command without waiting.
///
/// Returns RIVET_STATUS_OK if it was computed at most max_age_us [us] ago, RIVET_STATUS_STALE if earlier, and
/// RIVET_STATUS_NONE if there is none since rivet_open. The field seq has the sample that it answers.
/// Real-time safe: no allocation, no system call.
///
/// # Safety
/// As rivet_wait_command.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rivet_read_command(robot: *mut RivetRobot, max_age_us: u32, command: *mut Command) -> Status {
    // SAFETY: the caller's promise.
    let robot = unsafe { opened(robot) };
    guarded(|| {
        let Some(robot) = robot else { return Status::Argument };
        let latest = robot.robot.command();
        // SAFETY: the caller's promise.
        let status = unsafe { give(command, latest.as_ref()) };
        let age_ns = latest.map_or(0, |latest| now_ns().saturating_sub(latest.stamp_ns));
        let stale = status == Status::Ok && age_ns > u64::from(max_age_us) * 1000;
        if stale { Status::Stale } else { status }
    })
}

/// Reads the latest parameters: values, standard deviations, states. Their field epoch is one more at each publication.
///
/// Returns RIVET_STATUS_OK, or RIVET_STATUS_NONE before the first. Real-time safe: no allocation, no system call.
///
/// # Safety
/// `robot` as in rivet_close; `parameters` is NULL or points to memory for parameters.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rivet_read_parameters(robot: *mut RivetRobot, parameters: *mut Parameters) -> Status {
    // SAFETY: the caller's promise.
    unsafe { read(robot, parameters, Robot::parameters) }
}

/// Reads the latest health of the daemon. As rivet_read_parameters.
///
/// # Safety
/// `robot` as in rivet_close; `health` is NULL or points to memory for a health message.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rivet_read_health(robot: *mut RivetRobot, health: *mut Health) -> Status {
    // SAFETY: the caller's promise.
    unsafe { read(robot, health, Robot::health) }
}

/// Reads the latest health of the controller. As rivet_read_parameters.
///
/// # Safety
/// `robot` as in rivet_close; `health` is NULL or points to memory for a health message of the controller.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rivet_read_controller_health(robot: *mut RivetRobot, health: *mut ControllerHealth) -> Status {
    // SAFETY: the caller's promise.
    unsafe { read(robot, health, Robot::controller_health) }
}

/// # Safety
/// As the functions that call it.
unsafe fn read<T: Copy>(robot: *mut RivetRobot, output: *mut T, latest: fn(&mut Robot) -> Option<&T>) -> Status {
    // SAFETY: the caller's promise.
    let robot = unsafe { opened(robot) };
    guarded(|| {
        let Some(robot) = robot else { return Status::Argument };
        // SAFETY: the caller's promise.
        unsafe { give(output, latest(&mut robot.robot)) }
    })
}

/// Reads how many samples were published, sent and lost. Real-time safe: no allocation, no system call.
///
/// # Safety
/// `robot` as in rivet_close; `counters` is NULL or points to memory for counters.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rivet_read_counters(robot: *mut RivetRobot, counters: *mut Counters) -> Status {
    // SAFETY: the caller's promise.
    let robot = unsafe { opened(robot) };
    guarded(|| {
        let Some(robot) = robot else { return Status::Argument };
        // SAFETY: the caller's promise.
        unsafe { give(counters, Some(&robot.robot.counters())) }
    })
}

/// Returns what failed last on the library's thread, or with NULL why rivet_open failed last on this thread; "" if nothing did.
///
/// The text is valid until the next call of this function or of rivet_open on this thread. Not for the cycle.
///
/// # Safety
/// `robot` as in rivet_close.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rivet_error(robot: *mut RivetRobot) -> *const c_char {
    // SAFETY: the caller's promise.
    let robot = unsafe { opened(robot) };
    let text = catch_unwind(AssertUnwindSafe(|| match robot {
        Some(robot) => {
            robot.text = c_text(&robot.robot.problem());
            robot.text.as_ptr()
        }
        None => OPEN_ERROR.with(|error| error.borrow().as_ptr()),
    }));
    text.unwrap_or(c"".as_ptr())
}

/// Returns a sentence about a status, never NULL. Real-time safe.
#[unsafe(no_mangle)]
pub extern "C" fn rivet_status_text(status: i32) -> *const c_char {
    Status::from_number(status).map_or(c"no status of librivet", Status::text).as_ptr()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_becomes_a_status() {
        assert_eq!(guarded(|| panic!("made by a test")), Status::Internal);
        assert_eq!(guarded(|| Status::Stale), Status::Stale);
    }
}
