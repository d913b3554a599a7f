//! Prints what the functions of the control loop take on this machine, for 2 to 8 revolute axes.
//!
//! `cargo run --release -p rivet-dynamics --example regressor_time`

use std::hint::black_box;
use std::time::Instant;

use rivet_dynamics::{
    Arm, BaseSet, Joint, JointKind, Model, State, Structure, Workspace, inverse_dynamics, mass_matrix, regressor,
};

/// A chain of like links on alternating axes, none of them special.
fn arm(dof: usize) -> Arm {
    let joint = |i: usize| {
        let (s, c) = (0.5 + i as f64).sin_cos();
        Joint {
            name: String::new(),
            kind: JointKind::Revolute,
            axis: [0.0, 0.0, 1.0],
            rotation: [[c, 0.0, s], [s, 0.0, -c], [0.0, 1.0, 0.0]],
            translation: [0.1, 0.2 + 0.05 * i as f64, -0.15],
            lower: f64::NEG_INFINITY,
            upper: f64::INFINITY,
            velocity: f64::INFINITY,
            effort: f64::INFINITY,
            link: String::new(),
        }
    };
    let links = vec![[4.0, 0.4, 0.1, -0.3, 0.3, 0.01, 0.3, 0.02, -0.03, 0.2]; dof];
    Arm { name: String::new(), joints: (0..dof).map(joint).collect(), links, gravity: [0.0, 0.0, -9.81] }
}

/// Median over batches of the time of one call \[ns\].
fn time(mut call: impl FnMut()) -> f64 {
    let mut batches: Vec<f64> = (0..61)
        .map(|_| {
            let start = Instant::now();
            (0..2000).for_each(|_| call());
            start.elapsed().as_secs_f64() / 2000.0 * 1e9
        })
        .collect();
    batches.sort_by(f64::total_cmp);
    batches[30]
}

fn main() {
    println!("ns a call   inverse_dynamics  mass_matrix  regressor  Model::regressor  pair  select");
    for dof in [2, 6, 7, 8] {
        let model = Model::new(arm(dof), Structure { offset: true, ..Structure::default() });
        let base = BaseSet::new(&model).expect("a chain of general axes has a clear base");
        let (arm, width) = (&model.arm, model.len());
        let mut ws = Workspace::new(arm);
        let [q, qd, qdd] = [0.3, 1.1, -4.0].map(|v| (0..dof).map(|j| v + 0.1 * j as f64).collect::<Vec<f64>>());
        let (mut tau, mut m, mut y) = (vec![0.0; dof], vec![0.0; dof * dof], vec![0.0; dof * 10 * dof]);
        let (mut y_full, mut y_base) = (vec![0.0; dof * width], vec![0.0; dof * base.len()]);
        let state = State { q: &q, qd: &qd, qdd: &qdd };
        let mut y_pair = vec![[0.0; 2]; dof * width];
        println!(
            "{dof} joints    {:16.0}  {:11.0}  {:9.0}  {:16.0}  {:4.0}  {:6.0}",
            time(|| inverse_dynamics(arm, &arm.links, &mut ws, black_box(&q), &qd, &qdd, black_box(&mut tau))),
            time(|| mass_matrix(arm, &arm.links, &mut ws, black_box(&q), black_box(&mut m))),
            time(|| regressor(arm, &mut ws, black_box(&q), &qd, &qdd, black_box(&mut y))),
            time(|| model.regressor(&mut ws, black_box(&q), &qd, &qdd, black_box(&mut y_full))),
            time(|| model.regressor_pair(&mut ws, black_box([state; 2]), black_box(&mut y_pair))),
            time(|| base.select(black_box(&y_full), width, black_box(&mut y_base))),
        );
    }
}
