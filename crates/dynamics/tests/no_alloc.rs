//! The functions of the control loop never touch the heap.

mod common;

use allocation_counter::{AllocationInfo, measure};
use common::Random;
use rivet_dynamics::{
    BaseSet, Model, Structure, Workspace, WristCoupling, flange_pose, inverse_dynamics, mass_matrix, regressor,
};

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

    let seen = measure(|| {
        for _ in 0..10 {
            inverse_dynamics(arm, &arm.links, &mut ws, &q, &qd, &qdd, &mut tau);
            mass_matrix(arm, &arm.links, &mut ws, &q, &mut m);
            regressor(arm, &mut ws, &q, &qd, &qdd, &mut y);
            model.regressor(&mut ws, &q, &qd, &qdd, &mut y_full);
            base.select(&y_full, width, &mut y_base);
            std::hint::black_box(flange_pose(arm, &q));
        }
    });
    assert_eq!(seen, AllocationInfo::default(), "heap calls in ten turns");
    // The counter works, and sees what is only released.
    assert_eq!(measure(|| drop(std::hint::black_box(Box::new(1)))).count_total, 1);
    let made = std::hint::black_box(Box::new(1));
    assert_ne!(measure(|| drop(made)), AllocationInfo::default());
}
