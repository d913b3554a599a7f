//! Friction beyond a viscous line and a sign: values worked out by hand on a pendulum.

use rivet_dynamics::{Arm, BaseSet, Joints, Model, Slip, State, Structure, Workspace, model_hash};

/// One link of 2 kg whose centre of mass is 0.5 m from a horizontal axis; at q = 0 it lies flat: 9.81 N m of gravity.
const PENDULUM: &str = r#"<robot name="p"><link name="b"/><link name="l"><inertial><origin xyz="0.5 0 0"/><mass value="2"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
<joint name="j" type="revolute"><parent link="b"/><child link="l"/><axis xyz="0 -1 0"/>
<limit lower="-3" upper="3" velocity="3" effort="50"/></joint></robot>"#;

fn model(structure: Structure) -> Model {
    Model::new(Arm::from_urdf(PENDULUM, [0.0, 0.0, -9.81]).expect("an arm"), structure)
}

#[test]
fn load_and_square_of_speed_have_their_columns() {
    let model = model(Structure { load_friction: true, viscous_quadratic: true, ..Structure::default() });
    let names: Vec<String> = model.parameters.iter().map(|p| p.name(&model.arm)).collect();
    assert_eq!(
        names[10..],
        ["j1.rotor_inertia", "j1.viscous", "j1.coulomb", "j1.load_friction", "j1.viscous_quadratic"]
    );
    let mut ws = Workspace::new(&model.arm);
    let mut y = vec![f64::NAN; model.len()];
    for (qd, sign) in [(0.5, 1.0), (-2.0, -1.0)] {
        model.regressor(&mut ws, &[0.0], &[qd], &[0.0], &mut y);
        assert!((y[13].abs() - 9.81).abs() < 1e-12 && y[13] * sign > 0.0, "weight the gear carries: {}", y[13]);
        assert_eq!(y[14], qd * f64::abs(qd));
    }
    let joints = Joints {
        rotor_inertia: vec![0.0],
        viscous: vec![1.0],
        coulomb: vec![2.0],
        load_friction: vec![0.1],
        viscous_quadratic: vec![-0.2],
        ..Joints::default()
    };
    let x = model.nominal(&joints);
    // And back; an offset, which this model has none of, stays the other's.
    let with_offset = Joints { offset: vec![0.7], ..Joints::zero(1) };
    assert_eq!(model.drives(&x, with_offset), Joints { offset: vec![0.7], ..joints });
    model.regressor(&mut ws, &[0.0], &[0.5], &[0.0], &mut y);
    let tau: f64 = y.iter().zip(&x).map(|(y, x)| y * x).sum();
    assert!((tau - (9.81 + 0.5 + 2.0 + 0.981 - 0.05)).abs() < 1e-12, "{tau}");
    // Other bodies for the load change that column alone, and what a parameter of it means.
    let mut heavier = model.arm.links.clone();
    heavier[0][1] *= 2.0;
    let other = model.clone().with_load(heavier);
    let mut z = vec![f64::NAN; model.len()];
    other.regressor(&mut ws, &[0.0], &[0.5], &[0.0], &mut z);
    assert!((z[13] - 2.0 * y[13]).abs() < 1e-12 && z[..13] == y[..13] && z[14] == y[14]);
    let hash = |m: &Model| model_hash(m, &BaseSet::new(m).expect("a base"));
    assert_ne!(hash(&model), hash(&other));
}

#[test]
fn friction_turns_over_its_travel_and_stays_at_rest() {
    let model = model(Structure { presliding_travel: 0.01, ..Structure::default() });
    let (mut ws, mut slip) = (Workspace::new(&model.arm), Slip::new(&model));
    let mut y = vec![0.0; model.len()];
    let mut at = |q: f64, qd: f64, slip: &mut Slip| {
        model.regressor_sliding(&mut ws, slip, &[q], &[qd], &[0.0], &mut y);
        y[12]
    };
    let close = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-12, "{found}, expected {expected}");
    close(at(0.0, 0.0, &mut slip), 0.0);
    close(at(0.005, 1.0, &mut slip), 0.5);
    close(at(0.3, 1.0, &mut slip), 1.0);
    close(at(0.3, 0.0, &mut slip), 1.0);
    // A speed that is only noise turns nothing; a reversal takes twice the travel.
    close(at(0.3, -0.1, &mut slip), 1.0);
    close(at(0.29, -1.0, &mut slip), 0.0);
    close(at(0.28, -1.0, &mut slip), -1.0);
    close(at(0.2, -1.0, &mut slip), -1.0);
    slip.restart();
    close(at(0.2, -1.0, &mut slip), 0.0);
}

#[test]
fn two_motions_side_by_side_keep_their_own_friction() {
    let model = model(Structure { presliding_travel: 0.01, ..Structure::default() });
    let mut ws = Workspace::new(&model.arm);
    let (mut pair, mut alone) = ([Slip::new(&model), Slip::new(&model)], [Slip::new(&model), Slip::new(&model)]);
    let (mut both, mut one) = (vec![[0.0; 2]; model.len()], vec![0.0; model.len()]);
    for k in 0..200 {
        let t = 0.01 * f64::from(k);
        let motion = [[(3.0 * t).sin(), 3.0 * (3.0 * t).cos()], [0.02 * (9.0 * t).sin(), 0.18 * (9.0 * t).cos()]];
        let states = [0, 1].map(|m: usize| State { q: &motion[m][..1], qd: &motion[m][1..], qdd: &[0.5] });
        model.regressor_pair_sliding(&mut ws, &mut pair, states, &mut both);
        for (lane, slip) in alone.iter_mut().enumerate() {
            model.regressor_sliding(&mut ws, slip, &motion[lane][..1], &motion[lane][1..], &[0.5], &mut one);
            assert_eq!(both.iter().map(|y| y[lane]).collect::<Vec<f64>>(), one, "step {k}, motion {lane}");
        }
    }
}
