//! The functions of the control loop never touch the heap.
#![allow(unsafe_code, reason = "an allocator that counts is an unsafe trait")]

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use common::Random;
use rivet_dynamics::{
    BaseSet, Model, Structure, Workspace, WristCoupling, flange_pose, inverse_dynamics, mass_matrix, regressor,
};

struct Counting;

thread_local! {
    /// Per thread, so that the test harness's own threads do not count.
    static CALLS: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: every call goes to the system allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        CALLS.set(CALLS.get() + 1);
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        CALLS.set(CALLS.get() + 1);
        // SAFETY: the caller's promises are passed on.
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn nothing_allocates_in_the_loop() {
    let mut random = Random::new(7);
    let coupling = Some(WristCoupling { driving: 6, driven: 7 });
    let model =
        Model::new(random.arm(8), Structure { offset: true, coupling, sign_velocity: 0.02, ..Structure::default() });
    let (arm, dof, width) = (&model.arm, model.arm.dof(), model.len());
    let base = BaseSet::new(&model).expect("a base");
    let mut ws = Workspace::new(arm);
    let [q, qd, qdd] = [3.0, 2.0, 10.0].map(|reach| random.vector(dof, reach));
    let (mut tau, mut m, mut y) = (vec![0.0; dof], vec![0.0; dof * dof], vec![0.0; dof * 10 * dof]);
    let (mut y_full, mut y_base) = (vec![0.0; dof * width], vec![0.0; dof * base.len()]);

    let before = CALLS.get();
    for _ in 0..10 {
        inverse_dynamics(arm, &arm.links, &mut ws, &q, &qd, &qdd, &mut tau);
        mass_matrix(arm, &arm.links, &mut ws, &q, &mut m);
        regressor(arm, &mut ws, &q, &qd, &qdd, &mut y);
        model.regressor(&mut ws, &q, &qd, &qdd, &mut y_full);
        base.select(&y_full, width, &mut y_base);
        std::hint::black_box(flange_pose(arm, &q));
    }
    assert_eq!(CALLS.get() - before, 0, "heap calls in ten turns");
    // The counter works: a box is an allocation and a release.
    drop(std::hint::black_box(Box::new(1)));
    assert_eq!(CALLS.get() - before, 2);
}
