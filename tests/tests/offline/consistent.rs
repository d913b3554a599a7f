//! Physically consistent parameters of disturbed sets: of arms that can be built, at little torque.

use rivet_config::Robot;
use rivet_daemon::Projector;
use rivet_dynamics::{LinkParameters, Workspace, mass_matrix, smallest_eigenvalue};
use rivet_ipc_schema::Parameters;
use rivet_tests::robot;

/// SplitMix64 on (-1, 1).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

/// Base parameters as an estimator may give them: the nominal ones, each off by up to `share` of itself and by up to
/// `share` of the largest of its unit, which no body need have.
fn disturbed(robot: &Robot, share: f64, random: &mut Random) -> Parameters {
    let count = robot.base.len();
    let mut set = Parameters { count: count as u32, joints: robot.dof() as u32, epoch: 7, ..Parameters::default() };
    let unit = |i: usize| robot.base.parameter(&robot.model, i).unit(&robot.model.arm);
    for i in 0..count {
        let x = robot.nominal_base[i];
        let alike = (0..count).filter(|k| unit(*k) == unit(i)).map(|k| robot.nominal_base[k].abs());
        let scale = 0.01 * alike.fold(0.0, f64::max);
        set.values[i] = x + share * (x.abs() + scale) * random.next();
    }
    set
}

/// Whether the mass matrix of these bodies, rotors included, is positive definite.
fn positive(robot: &Robot, bodies: &[LinkParameters], rotors: &[f64], ws: &mut Workspace, q: &[f64]) -> bool {
    let n = robot.dof();
    let mut m = vec![0.0; n * n];
    mass_matrix(&robot.model.arm, bodies, ws, q, &mut m);
    for j in 0..n {
        m[j * n + j] += rotors[j];
    }
    nalgebra::DMatrix::from_row_slice(n, n, &m).cholesky().is_some()
}

#[test]
fn disturbed_sets_become_arms_that_can_be_built() {
    let mut random = Random(5);
    let (mut poses, mut unphysical) = (0, 0);
    for arm in ["manutec-r3", "staubli-tx40", "ur10e", "ur5e", "kuka-kr300-r2500", "dd2"] {
        let robot = rivet_config::load(robot(arm)).expect("a sound robot file");
        let (n, projector) = (robot.dof(), Projector::new(&robot));
        let mut ws = Workspace::new(&robot.model.arm);
        let zero = vec![0.0; n];
        for round in 0..4 {
            let set = disturbed(&robot, [0.01, 0.03, 0.06, 0.1][round], &mut random);
            let found = projector.project(&set).expect("a projection");
            println!(
                "{arm} round {round}: {:.3} % of torque, smallest eigenvalue {:.1e}",
                found.torque_percent, found.smallest_eigenvalue
            );
            assert_eq!((found.epoch, found.count), (7, set.count));
            assert!(found.torque_percent <= 2.0, "{arm}: {} %", found.torque_percent);
            let bodies: Vec<LinkParameters> = found.bodies.as_chunks::<10>().0[..n].to_vec();
            assert!(bodies.iter().all(|b| smallest_eigenvalue(b) > 0.0) && found.smallest_eigenvalue > 0.0, "{arm}");
            // The message's two halves say the same: what its base parameters alone make a body move.
            for _ in 0..500 {
                let q: Vec<f64> = (0..n).map(|_| std::f64::consts::PI * random.next()).collect();
                assert!(positive(&robot, &bodies, &zero, &mut ws, &q), "{arm} at {q:?}");
                poses += 1;
            }
            unphysical += usize::from(found.torque_percent > 0.05);
        }
    }
    assert!(poses >= 10_000, "{poses} poses");
    assert!(unphysical > 0, "no set needed a projection: the test shows nothing");
}
