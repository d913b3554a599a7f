//! Nothing allocates in the loop's own code: good and hostile samples, setpoints and parameter sets, stops, health.

mod common;

use common::{Moving, core, published, robot_of};
use rivet_ipc_schema::{ControllerHealth, Parameters};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

struct Counting;

thread_local! {
    static ARMED: Cell<bool> = const { Cell::new(false) };
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

fn note() {
    if ARMED.get() {
        COUNT.set(COUNT.get() + 1);
    }
}

#[allow(unsafe_code, reason = "a global allocator that counts can only be written so")]
// SAFETY: every call is handed to the system's allocator unchanged; counting touches only thread-local cells.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        note();
        // SAFETY: the caller's promise is the system allocator's.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        note();
        // SAFETY: the caller's promise is the system allocator's.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn ten_thousand_periods_with_everything_that_can_come_do_not_allocate() {
    let robot = robot_of("staubli-tx40");
    let mut core = core(&robot);
    let mut moving = Moving::new(&robot, &robot.nominal_base);
    let mut health = ControllerHealth::default();
    let (mut answered, mut accepted) = (0, 0);
    for k in 1..=10_000_u64 {
        let (mut sample, mut setpoint) = moving.next();
        // Every kind of message that a broken robot controller, planner or daemon can send.
        match k % 101 {
            1 => sample.q[0] = f64::NAN,
            2 => sample.tau[5] = f64::INFINITY,
            3 => sample.joints = u32::MAX,
            4 => sample.faults = 1,
            5 => sample.seq = 0,
            6 => sample.q = [1e300; 8],
            7 => setpoint.qdd[2] = f64::NAN,
            8 => setpoint.q = [1e300; 8],
            9 => setpoint.joints = 0,
            _ => {}
        }
        let mut set = published(&robot, sample.seq);
        set.epoch = k;
        match k % 13 {
            1 => set.values[2] = f64::NAN,
            2 => set.count = u32::MAX,
            3 => set.values = [f64::MAX; 128],
            4 => set = Parameters::default(),
            5 => set.values[3] *= 1.5,
            _ => {}
        }
        ARMED.set(true);
        core.offer_setpoint(&setpoint);
        core.offer_parameters(&set, &sample);
        answered += u64::from(core.tick(&sample).is_ok());
        if k % 500 > 480 {
            core.observe(&sample);
            let _ = core.missing(k % 500 - 470);
        }
        if k.is_multiple_of(100) {
            core.write_health(&mut health);
        }
        ARMED.set(false);
        accepted = core.counts().accepted;
    }
    assert_eq!(COUNT.get(), 0, "calls of the allocator");
    assert!(answered > 9000 && accepted > 1000, "{answered} answered, {accepted} accepted");
    assert!(health.stops > 0 && health.largest_step.iter().all(|step| step.is_finite()));
}
