//! Nothing allocates in the loop's own code: ticks with good and hostile samples, messages written.

use rivet_daemon::Core;
use rivet_ipc_schema::{Health, JointState, Parameters, Setpoint};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::path::Path;

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
fn a_hundred_thousand_ticks_do_not_allocate() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/staubli-tx40/robot.toml");
    let robot = rivet_config::load(file).expect("the robot file is sound");
    let mut core = Core::new(&robot).expect("sound settings");
    let (mut parameters, mut health) = (Parameters::default(), Health::default());
    let mut published = 0;
    // Other filters, another window, another scheme: as built outside the loop.
    let mut changed = robot.clone();
    changed.config.signal.model_filter_hz *= 0.8;
    changed.config.estimator.window_s = Some(3.0);
    let mut fresh = Core::new(&changed).expect("sound settings");
    ARMED.set(true);
    for seq in 1..=100_000_u64 {
        let t = seq as f64 * 0.001;
        let mut state = JointState { seq, joints: 6, ..JointState::default() };
        let mut setpoint = Setpoint { seq, joints: 6, ..Setpoint::default() };
        for j in 0..6 {
            let w = 1.0 + j as f64;
            state.q[j] = 0.3 * (w * t).sin();
            state.tau[j] = 10.0 * (w * t + 0.3).cos();
            (setpoint.q[j], setpoint.qd[j], setpoint.qdd[j]) =
                (state.q[j], 0.3 * w * (w * t).cos(), -0.3 * w * w * (w * t).sin());
        }
        // Every kind of sample that a broken robot controller can send.
        match seq % 1009 {
            1 => state.q[0] = f64::NAN,
            2 => state.tau[5] = f64::INFINITY,
            3 => state.joints = u32::MAX,
            4 => state.faults = 1,
            5 => state.seq = 0,
            6 => state.q = [1e300; 8],
            7 => state.tau = [f64::MIN_POSITIVE / 2.0; 8],
            8 => setpoint.qdd[2] = f64::NAN,
            9 => state.seq = u64::MAX / 2,
            _ => {}
        }
        if seq % 10_000 == 0 {
            core.reconfigure(&mut fresh);
        }
        let output = core.tick(&state, (seq % 7 != 0).then_some(&setpoint));
        if output.publish {
            core.write_parameters(&mut parameters);
            core.write_health(&mut health);
            published += 1;
        }
    }
    ARMED.set(false);
    assert_eq!(COUNT.get(), 0, "calls of the allocator");
    assert!(published > 100, "{published} publications");
    assert!(parameters.values.iter().all(|x| x.is_finite()));
}
