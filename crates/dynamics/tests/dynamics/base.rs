//! Base parameters: published counts, and the law that they lose nothing.

use crate::common::{GRAVITY, Random, distance, largest, times};
use rivet_dynamics::{
    Arm, BaseError, BaseSet, Joints, Model, Parameter, ParameterGroup, Structure, Workspace, WristCoupling, model_hash,
};

const ARMS: [&str; 7] = ["manutec-r3", "staubli-tx40", "ur10e", "ur10", "ur5e", "kuka-kr300-r2500", "dd2"];
const TX40_WRIST: Option<WristCoupling> = Some(WristCoupling { driving: 4, driven: 5 });

/// An arm of this repository.
fn arm(name: &str) -> Arm {
    let path = format!("{}/../../robots/{name}/robot.urdf", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{path}: {e}"));
    Arm::from_urdf(&text, GRAVITY).unwrap_or_else(|e| panic!("{path}: {e}"))
}

fn model(name: &str, offset: bool, coupling: Option<WristCoupling>) -> Model {
    Model::new(arm(name), Structure { offset, coupling, ..Structure::default() })
}

fn base_of(model: &Model) -> BaseSet {
    BaseSet::new(model).unwrap_or_else(|e| panic!("{}: {e}", model.arm.name))
}

fn count(model: &Model, base: &BaseSet, groups: &[ParameterGroup]) -> usize {
    (0..base.len()).filter(|&i| groups.contains(&base.parameter(model, i).group())).count()
}

/// Y·x = Y_b·x_b on states and parameters that the base has not seen.
fn assert_nothing_is_lost(model: &Model, base: &BaseSet, random: &mut Random) {
    let (dof, width) = (model.arm.dof(), model.len());
    let mut ws = Workspace::new(&model.arm);
    let (mut y, mut y_base) = (vec![0.0; dof * width], vec![0.0; dof * base.len()]);
    for _ in 0..50 {
        let [q, qd, qdd] = [6.0, 5.0, 20.0].map(|reach| random.vector(dof, reach));
        // Any vector will do, physical or not: the identity is one of columns.
        let x = random.vector(width, 3.0);
        model.regressor(&mut ws, &q, &qd, &qdd, &mut y);
        base.select(&y, width, &mut y_base);
        let x_base = base.from_standard(&x);
        let (full, reduced) = (times(&y, &x), times(&y_base, &x_base));
        // Relative to the largest term of the sum: a column that nearly depends on others makes large terms cancel.
        let term = y_base.chunks_exact(base.len()).flat_map(|row| row.iter().zip(&x_base).map(|(a, b)| a * b));
        let scale = largest(&term.collect::<Vec<f64>>());
        let difference = distance(&full, &reduced);
        assert!(difference <= 1e-10 * scale, "{}: {difference:e} of {full:?}", model.arm.name);
    }
}

/// The published counts of the TX40: 52 with friction (40 inertial with rotors, 12 friction), 6 more with offsets.
/// The coupled wrist adds three columns, and none of them depends on the others.
#[test]
fn tx40_has_the_published_count() {
    use ParameterGroup::{Coupling, Friction, Inertial, Offset, RotorInertia};
    for (offset, coupling, expected) in
        [(false, None, 52), (true, None, 58), (false, TX40_WRIST, 55), (true, TX40_WRIST, 61)]
    {
        let model = model("staubli-tx40", offset, coupling);
        let base = base_of(&model);
        assert_eq!(base.len(), expected, "offset {offset}, coupling {coupling:?}");
        assert_eq!(count(&model, &base, &[Inertial, RotorInertia]), 40);
        assert_eq!(count(&model, &base, &[Friction]), 12);
        assert_eq!(count(&model, &base, &[Offset]), if offset { 6 } else { 0 });
        assert_eq!(count(&model, &base, &[Coupling]), if coupling.is_some() { 3 } else { 0 });
        assert!(base.gap.ratio() > 1e6, "{:?}", base.gap);
    }
}

/// A planar two-link arm has ZZ1, ZZ2, MX2, MY2 and, against gravity, MX1 and MY1; the second drive's inertia is one
/// more, the first's is the same as ZZ1. Without drives and with MY = 0 the closed form is left: three parameters in
/// the horizontal plane; four in the vertical one, where its five have t5 = t2·g/l1 between them.
#[test]
fn two_link_arm_has_its_textbook_count() {
    use ParameterGroup::{Friction, Inertial, RotorInertia};
    let vertical = model("dd2", false, None);
    let horizontal = {
        let mut arm = vertical.arm.clone();
        arm.gravity = [-9.81, 0.0, 0.0]; // along the axes
        Model::new(arm, vertical.structure)
    };
    for (model, inertial, not_zero) in [(vertical, 6 + 1, 4), (horizontal, 4 + 1, 3)] {
        let base = base_of(&model);
        assert_eq!(count(&model, &base, &[Inertial, RotorInertia]), inertial);
        assert_eq!(count(&model, &base, &[Friction]), 4);
        let zero = vec![0.0; 2];
        let drives = Joints { rotor_inertia: zero.clone(), viscous: zero.clone(), coulomb: zero, ..Joints::default() };
        let x = base.from_standard(&model.nominal(&drives));
        assert_eq!(x.iter().filter(|v| v.abs() > 1e-9).count(), not_zero, "{x:?}");
    }
}

#[test]
fn reference_arms_lose_nothing() {
    for name in ARMS {
        let coupling = if name == "staubli-tx40" { TX40_WRIST } else { None };
        for offset in [false, true] {
            let model = model(name, offset, coupling);
            let base = base_of(&model);
            println!("{name}: {} of {} columns, gap {:?}", base.len(), model.len(), base.gap);
            assert_nothing_is_lost(&model, &base, &mut Random::new(3));
        }
    }
}

/// Axes and placements without any special relation. Seeds are fixed: a random arm can come close to a special one,
/// and then refusing it is right.
#[test]
fn random_arms_lose_nothing() {
    for seed in 0..64 {
        let mut random = Random::new(seed);
        let dof = 1 + (seed as usize % 8);
        let coupling = (dof > 1).then(|| WristCoupling { driving: dof - 2, driven: dof - 1 });
        let structure = Structure { offset: seed % 2 == 0, coupling, ..Structure::default() };
        let model = Model::new(random.arm(dof), structure);
        let base = BaseSet::new(&model).unwrap_or_else(|e| panic!("seed {seed}: {e}"));
        println!("seed {seed}: {dof} joints, {} of {} columns, gap {:?}", base.len(), model.len(), base.gap);
        assert_nothing_is_lost(&model, &base, &mut random);
    }
}

/// The wrist axes of the Kinova Gen3 pass each other at 0.35 mm. Kept at their turn, differences of its masses stood for inertias with
/// factors of 3e7, and base parameters of 9e4 were the nominal ones: no prior and no double can hold such a set.
#[test]
fn axes_that_almost_meet_do_not_spoil_the_base() {
    let mut random = Random::new(11);
    let model = model("../tests/robots/kinova-gen3", true, None);
    let base = base_of(&model);
    let factors = (0..base.len()).flat_map(|i| base.regrouping(i)).map(|(_, factor)| factor);
    let furthest = factors.fold(0.0_f64, |most, factor| most.max(factor.abs()));
    println!("{} base parameters, {:?}, largest factor {furthest:.1}", base.len(), base.gap);
    assert_eq!(base.len(), 69, "what can hardly be told is told all the same");
    assert!(furthest < 1e4, "{furthest}");
    assert_nothing_is_lost(&model, &base, &mut random);
}

/// The standard vector's order, as `parameters` states it, and readable names.
#[test]
fn parameters_are_named_in_order() {
    let model = model("staubli-tx40", true, TX40_WRIST);
    assert_eq!(model.len(), 60 + 4 * 6 + 3);
    let name = |k: usize| model.parameters[k].name(&model.arm);
    let unit = |k: usize| model.parameters[k].unit(&model.arm);
    for (k, expected, in_unit) in [
        (0, "l1.m", "kg"),
        (11, "l2.mcx", "kg m"),
        (26, "l3.Iyy", "kg m^2"),
        (59, "l6.Izz", "kg m^2"),
        (60, "j1.rotor_inertia", "kg m^2"),
        (71, "j6.viscous", "N m s/rad"),
        (72, "j1.coulomb", "N m"),
        (83, "j6.offset", "N m"),
        (84, "coupling.rotor_inertia", "kg m^2"),
        (86, "coupling.coulomb", "N m"),
    ] {
        assert_eq!((name(k).as_str(), unit(k)), (expected, in_unit));
    }
    let base = base_of(&model);
    assert_eq!(base.name(&model, 0), "j1.rotor_inertia+", "the first axis' inertias all turn with its rotor");
    assert!(base.regrouping(0).iter().any(|&(c, factor)| c == 9 && (factor - 1.0).abs() < 1e-9), "l1.Izz folds in");
    assert_eq!(base.parameter(&model, 6), Parameter::Viscous(0));
}

/// Two computations of one base are the same to the last bit; a hash tells meanings apart, not values.
#[test]
fn the_hash_says_what_the_numbers_mean() {
    let hash = |model: &Model| model_hash(model, &base_of(model));
    let tx40 = model("staubli-tx40", true, TX40_WRIST);
    assert_eq!(base_of(&tx40), base_of(&tx40.clone()));
    // Fixed for good: a change of this number makes old parameter files foreign.
    assert_eq!(hash(&tx40), 14566539596966098573);

    let mut heavier = tx40.clone();
    heavier.arm.links[3][0] *= 2.0;
    heavier.arm.joints[2].name = "elbow".to_owned();
    assert_eq!(hash(&tx40), hash(&heavier));

    let changed = |change: &dyn Fn(&mut Model)| {
        let mut other = tx40.clone();
        change(&mut other);
        hash(&Model::new(other.arm, other.structure))
    };
    let others = [
        changed(&|m| m.arm.joints[1].translation[0] += 1e-6),
        changed(&|m| m.arm.joints[4].axis = [0.0, 0.0, -1.0]),
        changed(&|m| m.arm.gravity[2] = -9.80665),
        changed(&|m| m.structure.offset = false),
        changed(&|m| m.structure.coupling = None),
        changed(&|m| m.structure.sign_velocity = 0.01),
    ];
    for (i, other) in others.iter().enumerate() {
        assert!(*other != hash(&tx40) && !others[..i].contains(other), "change {i}");
    }
}

/// Two axes by `angle` \[rad\] from parallel.
fn nearly_parallel(angle: f64) -> Model {
    let mut arm = arm("dd2");
    let (s, c) = angle.sin_cos();
    arm.joints[1].rotation = [[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]];
    Model::new(arm, Structure::default())
}

/// The largest torque that the base loses of a vector of parameters that count alike in their columns, over that which they make.
fn lost(model: &Model, base: &BaseSet, random: &mut Random) -> f64 {
    let (dof, width) = (model.arm.dof(), model.len());
    let mut ws = Workspace::new(&model.arm);
    let (mut y, mut y_base) = (vec![0.0; dof * width], vec![0.0; dof * base.len()]);
    let (mut worst, mut made) = (0.0_f64, 0.0_f64);
    for _ in 0..50 {
        let [q, qd, qdd] = [3.0, 2.0, 10.0].map(|reach| random.vector(dof, reach));
        let x = random.vector(width, 1.0);
        model.regressor(&mut ws, &q, &qd, &qdd, &mut y);
        base.select(&y, width, &mut y_base);
        let (full, reduced) = (times(&y, &x), times(&y_base, &base.from_standard(&x)));
        worst = worst.max(distance(&full, &reduced));
        made = made.max(largest(&full));
    }
    worst / made
}

/// Whether two axes are parallel decides the base. Rounding in the file is seen through; what is between is kept, as what it is: hardly
/// separated, and no torque is lost.
#[test]
fn nearly_parallel_axes_are_kept_with_their_condition() {
    let parallel = base_of(&nearly_parallel(0.0));
    assert_eq!(base_of(&nearly_parallel(3.7e-6)).independent, parallel.independent, "1.5708 for a right angle");
    assert!(parallel.is_clear() && parallel.hardly_separated().next().is_none());
    assert!(base_of(&nearly_parallel(0.2)).len() > parallel.len());

    let model = nearly_parallel(2e-3);
    let base = base_of(&model);
    assert!(!base.is_clear(), "{:?}", base.gap);
    assert!(base.hardly_separated().count() > 0);
    assert_eq!(base.residuals.len(), base.len());
    assert!(lost(&model, &base, &mut Random::new(5)) < 1e-5);

    let mut broken = arm("dd2");
    broken.gravity[1] = f64::NAN;
    assert_eq!(BaseSet::new(&Model::new(broken, Structure::default())), Err(BaseError::NotFinite));
}

/// An arm as its maker's calibration has it: every axis and origin is off by a little. Seeded, at every size of angle.
fn calibrated(name: &str, angle: f64, random: &mut Random) -> Model {
    let mut arm = arm(name);
    for joint in &mut arm.joints {
        let [a, b, c] = [0; 3].map(|_| random.vector(1, angle)[0]);
        let turn = [[1.0, -c, b], [c, 1.0, -a], [-b, a, 1.0]];
        let rows = joint.rotation;
        // To first order a rotation, made one by Gram-Schmidt.
        let mut r: [[f64; 3]; 3] =
            std::array::from_fn(|i| std::array::from_fn(|k| (0..3).map(|m| rows[i][m] * turn[m][k]).sum()));
        for i in 0..3 {
            for before in 0..i {
                let along: f64 = (0..3).map(|k| r[i][k] * r[before][k]).sum();
                for k in 0..3 {
                    r[i][k] -= along * r[before][k];
                }
            }
            let size = r[i].iter().map(|x| x * x).sum::<f64>().sqrt();
            r[i].iter_mut().for_each(|x| *x /= size);
        }
        joint.rotation = r;
        joint.translation.iter_mut().for_each(|x| *x += random.vector(1, angle)[0]);
    }
    Model::new(arm, Structure { offset: true, ..Structure::default() })
}

/// Base parameters of calibrated arms lose no torque, stay of a size that a double holds, and are the same when computed again.
#[test]
fn calibrated_arms_keep_a_base() {
    for (name, angle) in [("ur10e", 1e-3), ("ur10e", 1e-4), ("ur10e", 3e-5), ("ur5e", 5e-4), ("kuka-kr300-r2500", 1e-4)]
    {
        for seed in 0..3 {
            let mut random = Random::new(seed);
            let model = calibrated(name, angle, &mut random);
            let base = base_of(&model);
            let loss = lost(&model, &base, &mut random);
            let factors = (0..base.len()).flat_map(|i| base.regrouping(i)).map(|(_, factor)| factor.abs());
            let furthest = factors.fold(0.0_f64, f64::max);
            let least = base.residuals.iter().copied().fold(f64::INFINITY, f64::min);
            println!(
                "{name} {angle:e} seed {seed}: {} columns, least {least:.1e}, factor {furthest:.1e}, lost {loss:.1e}",
                base.len()
            );
            assert!(loss < 1e-4, "{name} {angle:e}: {loss:e}");
            assert!(furthest < 1e4, "{name} {angle:e}: {furthest:e}");
            assert_eq!(base, base_of(&model));
        }
    }
}
