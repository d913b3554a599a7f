//! What the crate promises to a real-time thread: receiving and the blackboard never allocate.
#![allow(unsafe_code, reason = "a counting allocator has to implement an unsafe trait")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use rivet_ipc_schema::{Bus, Command, Health, JointState, Parameters, PrivateBus, RobotName, Setpoint};

struct Counting;

thread_local! {
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

fn count() {
    COUNT.with(|count| count.set(count.get() + 1));
}

// SAFETY: every call goes to the system's allocator unchanged; counting touches a thread-local cell only,
// which is const-initialised and has no destructor, so it neither allocates nor outlives its thread.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller's contract is passed on.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count();
        // SAFETY: the caller's contract is passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Allocations and deallocations of this thread while `work` runs.
fn allocations(work: impl FnOnce()) -> u64 {
    let before = COUNT.with(Cell::get);
    work();
    COUNT.with(Cell::get) - before
}

#[test]
fn the_counter_counts() {
    assert_eq!(allocations(|| drop(std::hint::black_box(Box::new(1)))), 2);
}

#[test]
fn receiving_and_the_blackboard_do_not_allocate() {
    let private = PrivateBus::new("alloc");
    let bus = Bus::open(private.config(), &RobotName::new("arm").unwrap(), "test").unwrap();
    let (states, state_publisher) = (bus.joint_state_subscriber().unwrap(), bus.joint_state_publisher().unwrap());
    let (setpoints, setpoint_publisher) = (bus.setpoint_subscriber().unwrap(), bus.setpoint_publisher().unwrap());
    let (parameters, parameter_publisher) = (bus.parameters_subscriber().unwrap(), bus.parameters_publisher().unwrap());
    let (healths, health_publisher) = (bus.health_subscriber().unwrap(), bus.health_publisher().unwrap());
    let (writer, reader) = (bus.command_writer().unwrap(), bus.command_reader().unwrap());
    let (latest_writer, latest) = (bus.latest_parameters_writer().unwrap(), bus.latest_parameters_reader().unwrap());
    let mut seen = 0_u64;
    for round in 0..300_u64 {
        state_publisher.send(&JointState { seq: round, ..JointState::default() }).unwrap();
        setpoint_publisher.send(&Setpoint { seq: round, ..Setpoint::default() }).unwrap();
        parameter_publisher.send(&Parameters { epoch: round, ..Parameters::default() }).unwrap();
        health_publisher.send(&Health { seq: round, ..Health::default() }).unwrap();
        let count = allocations(|| {
            seen += u64::from(states.receive().unwrap().is_some());
            seen += u64::from(setpoints.receive().unwrap().is_some());
            seen += u64::from(parameters.receive_with(|message| message.epoch == round).unwrap() == Some(true));
            seen += u64::from(healths.receive_newest().unwrap().is_some());
            assert!(states.receive().unwrap().is_none());
            writer.write(&Command { seq: round, stamp_ns: round + 1, ..Command::default() });
            seen += u64::from(reader.latest().is_some_and(|command| command.seq == round));
            latest_writer.write(&Parameters { epoch: round, stamp_ns: round + 1, ..Parameters::default() });
            seen += u64::from(latest.latest().is_some_and(|parameters| parameters.epoch == round));
        });
        // The first round meets the publishers, which maps their memory.
        assert!(count == 0 || round == 0, "round {round}: {count} allocations");
    }
    assert_eq!(seen, 300 * 6);
}
