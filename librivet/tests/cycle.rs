//! What the C interface promises to a real-time thread: the functions of the cycle neither allocate nor wait.

#[path = "../../daemon/tests/guards/watch.rs"]
mod watch;

use allocation_counter::AllocationInfo;
use rivet::abi::{
    RIVET_ABI, RivetRobot, rivet_close, rivet_open, rivet_publish, rivet_read_command, rivet_read_controller_health,
    rivet_read_counters, rivet_read_health, rivet_read_parameters, rivet_wait_command,
};
use rivet::{Counters, Sample, Status, now_ns, sample_flags};
use rivet_ipc_schema::{Bus, Command, ControllerHealth, Health, Parameters, PrivateBus, RobotName};
use std::ffi::CString;
use std::os::unix::ffi::OsStrExt as _;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use watch::{Seen, watch_this_thread, watched};

const CYCLES: u64 = 2000;

/// Wakes the library's thread, and never waits: `std::thread::Thread::unpark`.
const PUBLISH: &[i64] = &[libc::SYS_futex];
/// The sleep between two looks.
const WAIT: &[i64] = &[libc::SYS_clock_nanosleep, libc::SYS_nanosleep];

/// A daemon and a controller that publish; the controller starts late and is followed by another one.
fn others(private: &PrivateBus, stop: &AtomicBool) {
    let bus = Bus::open(private.config(), &RobotName::new("arm").expect("a name"), "others").expect("the bus opens");
    let parameters = bus.parameters_publisher().expect("a port");
    let health = bus.health_publisher().expect("a port");
    let controller_health = bus.controller_health_publisher().expect("a port");
    let states = bus.joint_state_subscriber().expect("a port");
    while !stop.load(Ordering::Relaxed) {
        let command = bus.command_writer().expect("no other writer");
        for epoch in 1..300 {
            parameters.send(&Parameters { epoch, ..Parameters::default() }).expect("sent");
            health.send(&Health { seq: epoch, ..Health::default() }).expect("sent");
            controller_health.send(&ControllerHealth { seq: epoch, ..ControllerHealth::default() }).expect("sent");
            if let Some(state) = states.receive_newest().expect("received") {
                command.write(&Command { seq: state.seq, stamp_ns: now_ns(), ..Command::default() });
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

#[allow(unsafe_code, reason = "calls the C interface")]
fn open(private: &PrivateBus) -> *mut RivetRobot {
    let text = |bytes: &[u8]| CString::new(bytes).expect("no zero byte");
    let (name, prefix) = (text(b"arm"), text(private.config().prefix.as_bytes()));
    let root = text(private.config().root.as_os_str().as_bytes());
    let mut robot = std::ptr::null_mut();
    // SAFETY: strings that end with a zero byte, and a place for a pointer.
    let status = unsafe { rivet_open(RIVET_ABI, name.as_ptr(), prefix.as_ptr(), root.as_ptr(), 6, &raw mut robot) };
    assert_eq!(status, Status::Ok);
    robot
}

#[test]
#[allow(unsafe_code, reason = "calls the C interface")]
fn the_cycle_neither_allocates_nor_waits() {
    let private = PrivateBus::new("cycle");
    let stop = AtomicBool::new(false);
    let robot = open(&private);
    let watches = watch_this_thread();
    let clean = |what: &str, cycle: u64, most: u32, seen: Seen| {
        assert_eq!((seen.heap, seen.call), (AllocationInfo::default(), None), "{what} in cycle {cycle}");
        assert!(seen.calls <= most, "{what} in cycle {cycle}: {} system calls", seen.calls);
    };
    let sample = Sample { flags: sample_flags::SETPOINT, ..Sample::default() };
    let (mut command, mut parameters, mut health) = (Command::default(), Parameters::default(), Health::default());
    let (mut controller_health, mut counters) = (ControllerHealth::default(), Counters::default());
    let mut seen = [0_u64; 5];
    std::thread::scope(|scope| {
        scope.spawn(|| others(&private, &stop));
        for cycle in 0..CYCLES {
            // SAFETY, here and below: an open robot, used by this thread only, and values of the right types.
            let mut status = Status::Internal;
            let publishing = watched(PUBLISH, || status = unsafe { rivet_publish(robot, &raw const sample) });
            assert_eq!(status, Status::Ok);
            clean("rivet_publish", cycle, 1, publishing);
            let mut read = [Status::Internal; 5];
            let reading = watched(&[], || {
                read = unsafe {
                    [
                        rivet_read_command(robot, 1_000_000, &raw mut command),
                        rivet_read_parameters(robot, &raw mut parameters),
                        rivet_read_health(robot, &raw mut health),
                        rivet_read_controller_health(robot, &raw mut controller_health),
                        rivet_read_counters(robot, &raw mut counters),
                    ]
                };
            });
            clean("reading", cycle, 0, reading);
            for (count, status) in seen.iter_mut().zip(read) {
                *count += u64::from(status == Status::Ok);
            }
            let waiting = watched(WAIT, || {
                let _ = unsafe { rivet_wait_command(robot, 500, &raw mut command) };
            });
            clean("rivet_wait_command", cycle, u32::MAX, waiting);
        }
        stop.store(true, Ordering::Relaxed);
    });
    // The guard sees what it has to see.
    let allocation = watched(&[], || drop(std::hint::black_box(Box::new(1))));
    assert_eq!(allocation.heap.count_total, 1);
    let sleep = watched(&[], || std::thread::sleep(Duration::from_micros(1)));
    assert!(!watches || sleep.call.is_some(), "{sleep:?}");
    // What was watched was the work: all of it arrived.
    assert!(seen.iter().all(|count| *count > CYCLES / 4), "{seen:?}");
    assert!(parameters.epoch > 0 && health.seq > 0 && controller_health.seq > 0, "they have values");
    assert_eq!((counters.published, counters.lost, counters.failed), (CYCLES, 0, 0));
    // SAFETY: opened above, and not used again.
    unsafe { rivet_close(robot) };
}
