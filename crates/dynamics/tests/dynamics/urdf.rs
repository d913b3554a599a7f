//! Reading URDFs: merging of fixed joints, limits, and one bad file per rule.

use crate::common::GRAVITY;
use rivet_dynamics::{Arm, JointKind, UrdfError, body_from_com, body_in_frame};

const BODY: &str = r#"<inertial><origin xyz="0.1 0 0"/><mass value="2"/>
    <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial>"#;

/// A robot of `<base/>` and what is given.
fn robot(rest: &str) -> String {
    format!(r#"<robot name="r"><link name="base"/>{rest}</robot>"#)
}

fn link(name: &str, inside: &str) -> String {
    format!(r#"<link name="{name}">{inside}</link>"#)
}

fn joint(name: &str, kind: &str, parent: &str, child: &str, inside: &str) -> String {
    format!(
        r#"<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><axis xyz="0 0 1"/>{inside}</joint>"#
    )
}

fn turning(name: &str, parent: &str, child: &str) -> String {
    joint(name, "continuous", parent, child, "")
}

fn refusal(urdf: &str) -> UrdfError {
    Arm::from_urdf(urdf, GRAVITY).expect_err("a refusal")
}

/// The refusal of `urdf` is of this kind and says these words.
macro_rules! assert_refused {
    ($urdf:expr, $kind:pat, $($word:expr),+) => {
        let why = refusal(&$urdf);
        assert!(matches!(why, $kind), "{why:?}");
        $(assert!(why.to_string().contains($word), "\"{why}\" does not say {:?}", $word);)+
    };
}

/// One good joint and link under `base`.
fn good() -> String {
    link("a", BODY) + &turning("ja", "base", "a")
}

#[test]
fn what_is_not_a_urdf_is_refused_with_line_value_and_rule() {
    assert_refused!("<robot name='r'><link", UrdfError::Unreadable(_), "cannot be read as a URDF", "line 1");
    assert_refused!("# not xml", UrdfError::Unreadable(_), "cannot be read", "no <robot> element");
    assert_refused!("<mujoco/>", UrdfError::Unreadable(_), "one <robot> element");
    assert_refused!("<robot>\n<link name='a'>", UrdfError::Unreadable(_), "line 2", "ends inside an element");
    assert_refused!(robot("\n\n<link/>"), UrdfError::Unreadable(_), "line 3", "<link> has no name");
    assert_refused!(robot("<xacro:macro name=\"m\"/>"), UrdfError::Unreadable(_), "xacro FILE > robot.urdf");
    let changed = |from: &str, to: &str| robot(&good()).replacen(from, to, 1);
    let heavy = changed(r#"value="2""#, r#"value="heavy""#);
    assert_refused!(heavy, UrdfError::Unreadable(_), "value of <mass> is \"heavy\"", "has to be a number");
    let short = changed(r#"xyz="0 0 1""#, r#"xyz="0 1""#);
    assert_refused!(short, UrdfError::Unreadable(_), "xyz of <axis> is \"0 1\"", "3 numbers");
    let words = changed(r#"xyz="0.1 0 0""#, r#"xyz="0.1 0 0 mm""#);
    assert_refused!(words, UrdfError::Unreadable(_), "xyz of <origin> is \"0.1 0 0 mm\"", "3 numbers");
    assert_refused!(changed("continuous", "sliding"), UrdfError::Unreadable(_), "\"ja\" has type \"sliding\"", "fixed");
    assert_refused!(changed(" ixy=\"0\"", ""), UrdfError::Unreadable(_), "line 2", "<inertia> has no ixy");
    assert_refused!(changed("<mass value=\"2\"/>", ""), UrdfError::Unreadable(_), "link \"a\" has no <mass>");
    assert_refused!(changed("<child link=\"a\"/>", ""), UrdfError::Unreadable(_), "joint \"ja\" has no <child");
    let twice = changed("<mass value=\"2\"/>", "<mass value=\"2\"/><mass value=\"3\"/>");
    assert_refused!(twice, UrdfError::Unreadable(_), "second <mass>");
    assert_refused!(robot("<link name=\"a\" name=\"b\"/>"), UrdfError::Unreadable(_), "line 1");
}

#[test]
fn newer_versions_of_the_format_are_read() {
    let versioned = |version: &str, origin: &str, limit: &str| {
        let inside = format!("<origin {origin}/><limit {limit}/>");
        let text = robot(&(link("a", BODY) + &joint("ja", "revolute", "base", "a", &inside)));
        text.replacen("<robot", &format!("<robot version=\"{version}\""), 1)
    };
    // A quarter turn about z, of any length; versions before 1.1 have no quaternions.
    let turned = Arm::from_urdf(&versioned("1.1", "quat_xyzw=\"0 0 3 3\"", "velocity=\"1\""), GRAVITY).expect("an arm");
    let old = Arm::from_urdf(&versioned("1.0", "quat_xyzw=\"0 0 3 3\"", "velocity=\"1\""), GRAVITY).expect("an arm");
    assert!((turned.joints[0].rotation[1][0] - 1.0).abs() < 1e-12, "{:?}", turned.joints[0].rotation);
    assert_eq!(old.joints[0].rotation[0][0], 1.0);
    let both = versioned("1.1", "rpy=\"0 0 0\" quat_xyzw=\"0 0 0 1\"", "velocity=\"1\"");
    assert_refused!(both, UrdfError::Unreadable(_), "both rpy and quat_xyzw");
    // What is not written has no limit since 1.2; a lower limit alone leaves the upper one free.
    let half = Arm::from_urdf(&versioned("1.2", "xyz=\"0 0 1\"", "lower=\"-1\""), GRAVITY).expect("an arm");
    let joint = &half.joints[0];
    assert_eq!(
        (joint.lower, joint.upper, joint.velocity, joint.effort),
        (-1.0, f64::INFINITY, f64::INFINITY, f64::INFINITY)
    );
}

/// Stack of the smallest thread that reads robot files here \[bytes\]. Threads of Rust have 2 MiB.
const SMALL_STACK_BYTES: usize = 128 << 10;

#[test]
fn deepest_and_longest_accepted_text_is_read_on_a_small_stack() {
    // 64 elements inside each other are accepted: <robot>, <link>, and 62.
    let depth = 62;
    let nested = format!("{}{}", "<x>".repeat(depth), "</x>".repeat(depth));
    let chain: String = (0..9_000)
        .map(|i| {
            let above = if i == 0 { "a".to_owned() } else { format!("f{}", i - 1) };
            link(&format!("f{i}"), "") + &joint(&format!("m{i}"), "fixed", &above, &format!("f{i}"), "")
        })
        .collect();
    let text = robot(&(link("a", &format!("{BODY}{nested}")) + &turning("ja", "base", "a") + &chain));
    let deeper = text.replacen("<x>", "<x><x>", 1).replacen("</x>", "</x></x>", 1);
    let small = std::thread::Builder::new().stack_size(SMALL_STACK_BYTES);
    let read = small.spawn(move || (Arm::from_urdf(&text, GRAVITY), Arm::from_urdf(&deeper, GRAVITY)));
    let (read, refused) = read.expect("a thread").join().expect("it ends");
    assert_eq!(read.expect("an arm").dof(), 1);
    assert!(matches!(refused, Err(UrdfError::Excess(_))), "{refused:?}");
}

#[test]
fn the_number_of_joints_is_checked() {
    assert_refused!(robot(""), UrdfError::NoJoints, "no revolute, continuous or prismatic joint");
    let fixed = link("a", BODY) + &joint("ja", "fixed", "base", "a", "");
    assert_refused!(robot(&fixed), UrdfError::NoJoints, "no revolute");
    let chain = |n: usize| -> String {
        let name = |i: usize| if i == 0 { "base".to_owned() } else { format!("l{i}") };
        let part = |i: usize| link(&name(i), BODY) + &turning(&format!("j{i}"), &name(i - 1), &name(i));
        robot(&(1..=n).map(part).collect::<String>())
    };
    assert_eq!(Arm::from_urdf(&chain(8), GRAVITY).expect("eight are allowed").dof(), 8);
    assert_refused!(chain(9), UrdfError::TooManyJoints { count: 9 }, "9 moving joints", "at most 8");
}

#[test]
fn only_chains_are_arms() {
    let tree = good() + &link("b", BODY) + &turning("jb", "base", "b");
    assert_refused!(robot(&tree), UrdfError::Branches { .. }, "\"base\"", "\"ja\"", "\"jb\"");
    // Also when the second branch starts on a link fixed to the first's carrier.
    let behind = good()
        + &link("tool", "")
        + &joint("mount", "fixed", "a", "tool", "")
        + &link("b", BODY)
        + &turning("jb", "tool", "b")
        + &link("c", BODY)
        + &turning("jc", "a", "c");
    assert_refused!(robot(&behind), UrdfError::Branches { .. }, "\"a\"", "\"jb\"", "\"jc\"");

    let second_parent = good() + &link("b", BODY) + &turning("jb", "a", "b") + &turning("jc", "base", "b");
    assert_refused!(robot(&second_parent), UrdfError::SecondParent { .. }, "\"b\"", "\"jb\"", "\"jc\"", "loops");
    let ring = good() + &link("b", BODY) + &link("c", BODY) + &turning("jb", "c", "b") + &turning("jc", "b", "c");
    assert_refused!(robot(&ring), UrdfError::Loop { .. }, "\"b\"", "loops");
    assert_refused!(robot(&(good() + &link("b", BODY))), UrdfError::SeveralRoots { .. }, "\"base\"", "\"b\"");

    let twice = good() + &link("a", BODY);
    assert_refused!(robot(&twice), UrdfError::Duplicate { what: "link", .. }, "\"a\"", "twice");
    let twice = good() + &link("b", BODY) + &turning("ja", "a", "b");
    assert_refused!(robot(&twice), UrdfError::Duplicate { what: "joint", .. }, "\"ja\"", "twice");
    let nowhere = good() + &turning("jb", "a", "ghost");
    assert_refused!(robot(&nowhere), UrdfError::UnknownLink { .. }, "\"jb\"", "\"ghost\"");
}

#[test]
fn only_one_axis_joints_are_supported() {
    for kind in ["floating", "planar", "spherical"] {
        let urdf = robot(&(link("a", BODY) + &joint("ja", kind, "base", "a", "")));
        assert_refused!(urdf, UrdfError::UnsupportedJoint { .. }, "\"ja\"", kind);
    }
    let mimic = good() + &link("b", BODY) + &joint("jb", "continuous", "a", "b", r#"<mimic joint="ja"/>"#);
    assert_refused!(robot(&mimic), UrdfError::Mimic { .. }, "\"jb\"", "\"ja\"");
    let no_axis = robot(&good()).replace("0 0 1", "0 0 0");
    assert_refused!(no_axis, UrdfError::ZeroAxis { .. }, "\"ja\"", "0 0 0");
}

#[test]
fn limits_are_checked() {
    let limited = |limit: &str| {
        let limit = format!("<limit {limit}/>");
        robot(&(link("a", BODY) + &joint("ja", "revolute", "base", "a", &limit)))
    };
    assert_refused!(
        limited(r#"lower="1" upper="-1" velocity="2" effort="3""#),
        UrdfError::Limits { .. },
        "\"ja\"",
        "lower limit 1 above upper limit -1"
    );
    assert_refused!(
        limited(r#"lower="-1" upper="1" velocity="-2" effort="3""#),
        UrdfError::NegativeLimit { .. },
        "velocity limit -2"
    );
    assert_refused!(limited(r#"velocity="2" effort="-3""#), UrdfError::NegativeLimit { .. }, "effort limit -3");
    assert_refused!(
        limited(r#"lower="nan" upper="1" velocity="2" effort="3""#),
        UrdfError::NotFinite { .. },
        "lower limit is NaN"
    );
    assert_refused!(limited(r#"velocity="nan" effort="3""#), UrdfError::NotFinite { .. }, "velocity is NaN");

    let given = Arm::from_urdf(&limited(r#"lower="-1" upper="2" velocity="3" effort="4""#), GRAVITY).expect("an arm");
    let Some(j) = given.joints.first() else { panic!("no joint") };
    assert_eq!((j.lower, j.upper, j.velocity, j.effort), (-1.0, 2.0, 3.0, 4.0));
    let free = Arm::from_urdf(&robot(&good()), GRAVITY).expect("an arm");
    let Some(j) = free.joints.first() else { panic!("no joint") };
    let inf = f64::INFINITY;
    assert_eq!((j.lower, j.upper, j.velocity, j.effort), (-inf, inf, inf, inf));
}

#[test]
fn bodies_must_be_possible() {
    let with = |body: &str| robot(&(link("a", body) + &turning("ja", "base", "a")));
    let body = |mass: &str, moments: [&str; 3]| {
        let [x, y, z] = moments;
        with(&format!(
            r#"<inertial><mass value="{mass}"/><inertia ixx="{x}" ixy="0" ixz="0" iyy="{y}" iyz="0" izz="{z}"/></inertial>"#
        ))
    };
    assert_refused!(with(""), UrdfError::NoMass { .. }, "\"a\"", "no mass");
    assert_refused!(body("0", ["0", "0", "0"]), UrdfError::NoMass { .. }, "\"a\"");
    assert_refused!(body("0", ["1", "1", "1"]), UrdfError::BadMass { .. }, "\"a\"", "mass 0 kg");
    assert_refused!(body("-2", ["1", "1", "1"]), UrdfError::BadMass { .. }, "\"a\"", "mass -2 kg");
    assert_refused!(body("2", ["1", "-0.5", "1"]), UrdfError::NotPositiveDefinite { .. }, "\"a\"", "-5e-1");
    assert_refused!(body("2", ["0", "0", "0"]), UrdfError::NotPositiveDefinite { .. }, "\"a\"", "positive definite");
    assert_refused!(body("2", ["1", "1", "3"]), UrdfError::TriangleInequality { .. }, "\"a\"", "3e0", "triangle");
    // A plate whose moments were rounded to three digits.
    assert!(Arm::from_urdf(&body("2", ["1.23", "1.24", "2.472"]), GRAVITY).is_ok());

    assert_refused!(body("inf", ["1", "1", "1"]), UrdfError::NotFinite { .. }, "link \"a\"", "mass is inf");
    assert_refused!(body("2", ["1", "nan", "1"]), UrdfError::NotFinite { .. }, "link \"a\"", "inertia is NaN");
    let urdf = robot(&good());
    assert_refused!(urdf.replace("0.1 0 0", "nan 0 0"), UrdfError::NotFinite { .. }, "link \"a\"", "origin xyz");
    assert_refused!(urdf.replace("0 0 1", "0 inf 1"), UrdfError::NotFinite { .. }, "joint \"ja\"", "axis is inf");
    let origin = joint("ja", "continuous", "base", "a", r#"<origin rpy="0 nan 0"/>"#);
    assert_refused!(robot(&(link("a", BODY) + &origin)), UrdfError::NotFinite { .. }, "joint \"ja\"", "origin rpy");
}

/// Turns by 90 degrees about x, y and z, row-major.
const ABOUT_X: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]];
const ABOUT_Z: [[f64; 3]; 3] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
const QUARTER: &str = "1.5707963267948966";

fn assert_close(a: &[f64], b: &[f64]) {
    assert!(crate::common::distance(a, b) <= 1e-15 * (1.0 + crate::common::largest(b)), "{a:?} vs {b:?}");
}

/// A base plate, a massless moving link that carries a bracket that carries a tool, a joint on the bracket: all equal
/// to what merging by hand gives.
#[test]
fn fixed_links_merge_into_their_carrier() {
    let plate = link("plate", BODY) + &joint("floor", "fixed", "base", "plate", r#"<origin xyz="0 0 0.5"/>"#);
    let first = link("a", "") + &turning("ja", "plate", "a");
    let on_bracket = format!(r#"<origin xyz="0.2 0 0.3" rpy="{QUARTER} 0 0"/>"#);
    let bracket = link("bracket", BODY) + &joint("fix1", "fixed", "a", "bracket", &on_bracket);
    let on_tool = format!(r#"<origin xyz="0 0.4 0" rpy="0 0 {QUARTER}"/>"#);
    let tool = link("tool", BODY) + &joint("fix2", "fixed", "bracket", "tool", &on_tool);
    let next = r#"<origin xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="9"/>"#;
    let second = link("b", BODY) + &joint("jb", "prismatic", "bracket", "b", next);
    // Order in the file does not matter.
    let arm = Arm::from_urdf(&robot(&(second + &tool + &bracket + &first + &plate)), GRAVITY).expect("an arm");

    assert_eq!((arm.dof(), arm.name.as_str()), (2, "r"));
    let [ja, jb] = &arm.joints[..] else { panic!("two joints") };
    assert_eq!((ja.name.as_str(), ja.link.as_str(), ja.kind), ("ja", "a", JointKind::Revolute));
    assert_eq!((jb.name.as_str(), jb.link.as_str(), jb.kind), ("jb", "b", JointKind::Prismatic));
    assert_close(&ja.translation, &[0.0, 0.0, 0.5]);
    // (0, 0, 1) in the bracket is (0, -1, 0) in a.
    assert_close(&jb.translation, &[0.2, -1.0, 0.3]);
    assert_close(jb.rotation.as_flattened(), ABOUT_X.as_flattened());

    let part = body_from_com(2.0, &[0.1, 0.0, 0.0], &[[0.02, 0.0, 0.0], [0.0, 0.02, 0.0], [0.0, 0.0, 0.02]]);
    let in_bracket = body_in_frame(&part, &ABOUT_Z, &[0.0, 0.4, 0.0]);
    let both: [f64; 10] = std::array::from_fn(|k| part[k] + in_bracket[k]);
    assert_close(&arm.links[0], &body_in_frame(&both, &ABOUT_X, &[0.2, 0.0, 0.3]));
    // By hand: masses at (0.3, 0, 0.3) and (0.2, 0, 0.8): the tool's 0.5 along the bracket's y is a's z.
    assert_close(&arm.links[0][..4], &[4.0, 2.0 * 0.5, 0.0, 2.0 * 1.1]);
    let ixx = 2.0 * 0.02 + 2.0 * (0.09 + 0.64);
    let ixz = -2.0 * (0.3 * 0.3 + 0.2 * 0.8);
    assert_close(&[arm.links[0][4], arm.links[0][7]], &[ixx, ixz]);
    assert_close(&arm.links[1], &part);
}

/// An inertia turned against its link: a rod along x becomes one along y; products of inertia keep their sign.
#[test]
fn turned_inertias_are_turned_back() {
    let body = format!(
        r#"<inertial><origin xyz="0 0 0" rpy="0 0 {QUARTER}"/><mass value="1"/>
        <inertia ixx="0.1" ixy="0.01" ixz="0.02" iyy="0.4" iyz="0.03" izz="0.45"/></inertial>"#
    );
    let arm = Arm::from_urdf(&robot(&(link("a", &body) + &turning("ja", "base", "a"))), GRAVITY).expect("an arm");
    // x' = y, y' = -x: Ixx and Iyy change places, Ixy its sign, (Ixz, Iyz) become (-Iyz, Ixz).
    assert_close(&arm.links[0], &[1.0, 0.0, 0.0, 0.0, 0.4, -0.01, 0.1, -0.03, 0.02, 0.45]);
}

/// A first axis along gravity has none of its torque, up or down, whatever frames the URDF has before it.
#[test]
fn an_arm_is_upright_where_its_first_axis_is_along_gravity() {
    let urdf = include_str!("../../../../robots/manutec-r3/robot.urdf");
    let along = |gravity| Arm::from_urdf(urdf, gravity).expect("an arm").is_upright();
    assert_eq!([[9.81, 0.0, 0.0], [0.0, 9.81, 0.0], [0.0, 0.0, 9.81]].map(along), [false, false, true]);
    let tilted = |angle: f64| along([9.81 * angle.sin(), 0.0, -9.81 * angle.cos()]);
    assert_eq!([0.0, 0.1, 0.3].map(tilted), [true, true, false]);
    assert!(!along([0.0; 3]), "without gravity there is no up");
}
