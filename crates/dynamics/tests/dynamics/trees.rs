//! Trees, missing and impossible bodies: what is taken as a chain, and what it then is. URDFs are generated, seeded.

use std::fmt::Write as _;

use crate::common::{GRAVITY, Random, distance, largest};
use rivet_dynamics::{
    Arm, UrdfArm, UrdfError, UrdfNote, UrdfOptions, Workspace, guess_bodies, inverse_dynamics, mass_matrix,
    smallest_eigenvalue, write_urdf,
};

fn vector(v: &[f64]) -> String {
    v.iter().map(|x| format!("{x:?}")).collect::<Vec<_>>().join(" ")
}

/// A link with a body of a box of random size.
fn link(name: &str, random: &mut Random) -> String {
    let m = random.between(0.2, 3.0);
    let [a, b, c] = [0; 3].map(|_| random.between(0.05, 0.3_f64).powi(2) * m / 12.0);
    let (xyz, rpy) = (random.vec3(0.1), random.vec3(1.5));
    format!(
        "<link name=\"{name}\"><inertial><origin xyz=\"{}\" rpy=\"{}\"/><mass value=\"{m:?}\"/>\n<inertia ixx=\"{:?}\" ixy=\"0\" ixz=\"0\" iyy=\"{:?}\" iyz=\"0\" \
         izz=\"{:?}\"/></inertial></link>\n",
        vector(&xyz),
        vector(&rpy),
        b + c,
        a + c,
        a + b
    )
}

struct Place {
    xyz: [f64; 3],
    rpy: [f64; 3],
}

impl Place {
    fn random(random: &mut Random) -> Place {
        Place { xyz: random.vec3(0.4), rpy: random.vec3(1.5) }
    }

    fn text(&self) -> String {
        format!("<origin xyz=\"{}\" rpy=\"{}\"/>", vector(&self.xyz), vector(&self.rpy))
    }
}

fn joint(name: &str, kind: &str, [parent, child]: [&str; 2], origin: &str, more: &str) -> String {
    format!(
        "<joint name=\"{name}\" type=\"{kind}\"><parent link=\"{parent}\"/><child link=\"{child}\"/>{origin}<axis xyz=\"0 0 1\"/>{more}</joint>\n"
    )
}

const LIMIT: &str = r#"<limit lower="-2" upper="2" effort="50" velocity="3"/>"#;

/// An arm of `n` joints `j1..`, links `l1..` on a base, and the places of its joints.
fn chain(n: usize, random: &mut Random) -> String {
    let mut text = "<link name=\"base\"/>\n".to_owned();
    for i in 1..=n {
        let parent = if i == 1 { "base".to_owned() } else { format!("l{}", i - 1) };
        let child = format!("l{i}");
        text += &link(&child, random);
        text += &joint(&format!("j{i}"), "revolute", [&parent, &child], &Place::random(random).text(), LIMIT);
    }
    text
}

fn robot(rest: &str) -> String {
    format!("<robot name=\"r\">\n{rest}</robot>\n")
}

fn read(text: &str, options: &UrdfOptions) -> UrdfArm {
    UrdfArm::read(text, GRAVITY, options).unwrap_or_else(|e| panic!("{e}\n{text}"))
}

fn refused(text: &str) -> Vec<(usize, UrdfError)> {
    let mistakes = UrdfArm::read(text, GRAVITY, &UrdfOptions::default()).expect_err("a refusal");
    mistakes.all().iter().map(|mistake| (mistake.line, mistake.error.clone())).collect()
}

/// The lines that the refusal of a tree proposes, as options.
fn proposed(text: &str) -> UrdfOptions {
    let refused = refused(text);
    let proposal = refused.iter().find_map(|(_, error)| match error {
        UrdfError::Branches { proposal, .. }
        | UrdfError::Mimic { proposal, .. }
        | UrdfError::SeveralRoots { proposal, .. }
        | UrdfError::TooManyJoints { proposal, .. } => Some(proposal.clone()),
        _ => None,
    });
    let proposal = proposal.unwrap_or_else(|| panic!("no proposal: {refused:?}"));
    UrdfOptions { tip: Some(proposal.tip.clone()), fixed: proposal.fixed.clone(), project: false }
}

/// A welded gripper is the same as one whose joints are fixed at those positions: by the origin of a `fixed` joint, for slides along and
/// turns about z.
#[test]
fn welding_equals_a_fixed_joint_at_that_position() {
    for seed in 0..20 {
        let mut random = Random::new(seed);
        let n = 3 + seed as usize % 4;
        let arm = chain(n, &mut random);
        let tip = format!("l{n}");
        let (slide, turn) = (random.between(-0.1, 0.1), random.between(-1.0, 1.0));
        let [hand, left, right] = ["hand", "left", "right"].map(|name| link(name, &mut random));
        let at = Place::random(&mut random);
        let mount = joint("mount", "fixed", [&tip, "hand"], &at.text(), "");
        let moving = |kind: &str, name: &str, child: &str| joint(name, kind, ["hand", child], "", LIMIT);
        let tree = robot(&format!(
            "{arm}{hand}{left}{right}{mount}{}{}",
            moving("prismatic", "slide", "left"),
            moving("revolute", "turn", "right")
        ));
        let fixed = |name: &str, child: &str, origin: String| joint(name, "fixed", ["hand", child], &origin, "");
        let welded = robot(&format!(
            "{arm}{hand}{left}{right}{mount}{}{}",
            fixed("slide", "left", format!("<origin xyz=\"0 0 {slide:?}\"/>")),
            fixed("turn", "right", format!("<origin rpy=\"0 0 {turn:?}\"/>"))
        ));
        let options = UrdfOptions {
            tip: Some("hand".to_owned()),
            fixed: vec![("slide".to_owned(), slide), ("turn".to_owned(), turn)],
            project: false,
        };
        let (by_weld, by_file) = (read(&tree, &options).arm, Arm::from_urdf(&welded, GRAVITY).expect("a chain"));
        assert_eq!(by_weld.joints, by_file.joints);
        for (a, b) in by_weld.links.iter().zip(&by_file.links) {
            assert!(distance(a, b) <= 1e-14 * largest(b), "seed {seed}: {a:?} {b:?}");
        }
        // Without a place they are at 0.
        let options = UrdfOptions { tip: Some("hand".to_owned()), ..UrdfOptions::default() };
        let at_zero = read(&tree, &options);
        assert_eq!(at_zero.notes.iter().filter(|note| matches!(note, UrdfNote::Welded { at: 0.0, .. })).count(), 2);
        let proposal = proposed(&tree);
        assert_eq!(read(&tree, &proposal).arm, at_zero.arm, "what is proposed is the arm with its gripper at 0");
    }
}

/// What is modelled of a tree moves as the tree does: kinetic energy and gravity of all its bodies, summed over the bodies one by one.
#[test]
fn a_welded_tree_has_the_energy_of_its_bodies() {
    let mut random = Random::new(3);
    let arm = chain(4, &mut random);
    let parts: Vec<String> = (0..3).map(|k| link(&format!("p{k}"), &mut random)).collect();
    let mut text = arm + &parts.concat();
    for (k, parent) in ["l2", "p0", "l4"].iter().enumerate() {
        text +=
            &joint(&format!("s{k}"), "continuous", [parent, &format!("p{k}")], &Place::random(&mut random).text(), "");
    }
    let fixed: Vec<(String, f64)> = (0..3).map(|k| (format!("s{k}"), random.between(-2.0, 2.0))).collect();
    let options = UrdfOptions { tip: Some("l4".to_owned()), fixed: fixed.clone(), project: false };
    let whole = read(&robot(&text), &options).arm;
    // Each body alone: all other links without mass.
    let bodies = ["l1", "l2", "l3", "l4", "p0", "p1", "p2"];
    let n = whole.dof();
    let (q, qd, qdd) = (random.vector(n, 2.0), random.vector(n, 2.0), random.vector(n, 3.0));
    let torque = |arm: &Arm| {
        let mut tau = vec![0.0; n];
        inverse_dynamics(arm, &arm.links, &mut Workspace::new(arm), &q, &qd, &qdd, &mut tau);
        tau
    };
    let mut sum = vec![0.0; n];
    for body in bodies {
        let mut one = text.clone();
        for other in bodies.iter().filter(|other| **other != body) {
            let start = one.find(&format!("<link name=\"{other}\">")).expect("in the text");
            let end = start + one[start..].find("</link>").expect("closed");
            one.replace_range(start..end, &format!("<link name=\"{other}\">"));
        }
        let alone = read(&robot(&one), &options).arm;
        sum.iter_mut().zip(torque(&alone)).for_each(|(sum, part)| *sum += part);
    }
    assert!(distance(&sum, &torque(&whole)) < 1e-12 * largest(&sum), "{sum:?}");
}

/// The most probable tip: grippers of several kinds at the end of arms of several lengths, whatever they are called.
#[test]
fn a_gripper_is_welded_and_the_arm_is_not() {
    let slide = |name: &str, child: &str, more: &str| {
        let limit = r#"<limit lower="0.01" upper="0.05" effort="5" velocity="1"/>"#;
        joint(name, "prismatic", ["hand", child], "", &format!("{limit}{more}"))
    };
    let mimic = r#"<mimic joint="a" multiplier="-1" offset="0.002"/>"#;
    for n in 3..=7 {
        let mut random = Random::new(n as u64);
        let arm = chain(n, &mut random);
        let mount = joint("mount", "fixed", [&format!("l{n}"), "hand"], "", "");
        let links = ["hand", "x", "y", "z"].map(|name| link(name, &mut random)).concat();
        let two = slide("a", "x", "") + &slide("b", "y", "") + &joint("c", "revolute", ["y", "z"], "", LIMIT);
        let follower = slide("a", "x", "") + &slide("b", "y", mimic) + &joint("c", "fixed", ["y", "z"], "", "");
        let fingers = joint("left_finger", "revolute", ["hand", "x"], "", LIMIT)
            + &joint("left_finger_tip", "revolute", ["x", "y"], "", LIMIT)
            + &joint("camera", "continuous", ["hand", "z"], "", "");
        for (gripper, welded) in [
            (
                slide("a", "x", "") + &slide("b", "y", "") + &joint("c", "fixed", ["y", "z"], "", ""),
                vec![("a", 0.01), ("b", 0.01)],
            ),
            (follower, vec![("a", 0.01), ("b", -0.008)]),
            (fingers, vec![("left_finger", 0.0), ("left_finger_tip", 0.0), ("camera", 0.0)]),
        ] {
            let text = robot(&format!("{arm}{links}{mount}{gripper}"));
            let options = proposed(&text);
            let fixed: Vec<(&str, f64)> = options.fixed.iter().map(|(name, at)| (name.as_str(), *at)).collect();
            assert_eq!(fixed, welded, "{n} joints");
            assert_eq!(read(&text, &options).arm.dof(), n);
        }
        // A longer branch with nothing of a gripper in its names goes on with the arm.
        let options = proposed(&robot(&format!("{arm}{links}{mount}{two}")));
        assert!(read(&robot(&format!("{arm}{links}{mount}{two}")), &options).arm.dof() >= n);
    }
}

/// A balancing cylinder that follows the shoulder, beside the arm from its second link on.
#[test]
fn the_longest_chain_is_the_arm() {
    let mut random = Random::new(9);
    let text = chain(6, &mut random)
        + &["cylinder", "piston"].map(|name| link(name, &mut random)).concat()
        + &joint("cyl", "revolute", ["l1", "cylinder"], "", r#"<mimic joint="j2" multiplier="-0.25" offset="0.1"/>"#)
        + &joint("pis", "prismatic", ["cylinder", "piston"], "", r#"<mimic joint="j2" multiplier="0.15"/>"#);
    let options = proposed(&robot(&text));
    assert_eq!(options.tip.as_deref(), Some("l6"));
    assert_eq!(options.fixed, [("cyl".to_owned(), 0.1), ("pis".to_owned(), 0.0)]);
    let tip_alone = UrdfOptions { tip: options.tip, ..UrdfOptions::default() };
    let read = read(&robot(&text), &tip_alone);
    assert_eq!(read.arm.dof(), 6);
    let follows = |note: &&UrdfNote| matches!(note, UrdfNote::Welded { follows: Some(of), .. } if of == "j2");
    assert_eq!(read.notes.iter().filter(follows).count(), 2, "{:?}", read.notes);
}

/// Rails and trunks before an arm, a follower in its middle, a stray link: each refusal's lines make an arm.
#[test]
fn other_trees_are_mended_by_their_lines() {
    let mut random = Random::new(21);
    let long = robot(&chain(11, &mut random));
    let options = proposed(&long);
    let fixed: Vec<&str> = options.fixed.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(fixed, ["j1", "j2", "j3"]);
    assert_eq!(read(&long, &options).arm.dof(), 8);

    let follower = robot(&chain(5, &mut random))
        .replace("<parent link=\"l2\"/>", "<mimic joint=\"j2\" multiplier=\"-1\" offset=\"0\"/><parent link=\"l2\"/>");
    let options = proposed(&follower);
    assert_eq!(options.fixed, [("j3".to_owned(), 0.0)]);
    assert_eq!(read(&follower, &options).arm.dof(), 4);

    let stray = robot(&(chain(4, &mut random) + "<link name=\"world\"/>"));
    let options = proposed(&stray);
    assert_eq!(read(&stray, &options).arm.dof(), 4);

    let floating = robot(&chain(3, &mut random)).replacen("type=\"revolute\"", "type=\"floating\"", 1);
    let [(_, UrdfError::UnsupportedJoint { joint, .. })] = &refused(&floating)[..] else {
        panic!("{:?}", refused(&floating))
    };
    let options = UrdfOptions { fixed: vec![(joint.clone(), 0.0)], ..UrdfOptions::default() };
    assert_eq!(read(&floating, &options).arm.dof(), 2);
}

/// A wrist that carries the gripper's body is the arm's, and so is one that leads a follower on the way to the flange.
#[test]
fn wrists_belong_to_the_arm() {
    let mut random = Random::new(77);
    let body = |name: &str, random: &mut Random| link(name, random);
    let wrist = chain(4, &mut random)
        + &["gripper_link", "left_finger", "right_finger"].map(|name| body(name, &mut random)).concat()
        + &joint("wrist_rotate", "revolute", ["l4", "gripper_link"], "", LIMIT)
        + &joint("left", "prismatic", ["gripper_link", "left_finger"], "", LIMIT)
        + &joint("right", "prismatic", ["gripper_link", "right_finger"], "", "<mimic joint=\"left\"/>");
    let options = proposed(&robot(&wrist));
    assert_eq!(options.tip.as_deref(), Some("gripper_link"));
    assert_eq!(read(&robot(&wrist), &options).arm.dof(), 5);

    let hollow = chain(4, &mut random)
        + &["l5", "l5b", "l6"].map(|name| body(name, &mut random)).concat()
        + &joint("j5", "revolute", ["l4", "l5"], "", LIMIT)
        + &joint("j5b", "revolute", ["l5", "l5b"], "", "<mimic joint=\"j5\" multiplier=\"-1\"/>")
        + &joint("j6", "revolute", ["l5b", "l6"], "", LIMIT);
    let options = proposed(&robot(&hollow));
    assert_eq!((options.tip.as_deref(), &options.fixed[..]), (Some("l6"), &[("j5b".to_owned(), 0.0)][..]));
    let read = read(&robot(&hollow), &options);
    assert_eq!(read.arm.dof(), 6);
    let follows = |note: &UrdfNote| matches!(note, UrdfNote::Welded { follows: Some(of), .. } if of == "j5");
    assert!(read.notes.iter().any(follows), "the model lacks a motion: {:?}", read.notes);
}

/// Thousands of followers that follow each other end in a refusal with few mistakes, not in hours.
#[test]
fn long_chains_of_followers_are_refused_at_once() {
    let count = 4000;
    let mut text = "<link name=\"l0\"/>".to_owned();
    for i in 1..=count {
        let (parent, child) = (format!("l{}", i - 1), format!("l{i}"));
        let mimic = format!("<mimic joint=\"j{}\"/>", if i == 1 { count } else { i - 1 });
        let _ = write!(text, "<link name=\"{child}\"/>");
        text += &joint(&format!("j{i}"), "revolute", [&parent, &child], "", &mimic);
    }
    let mistakes = refused(&robot(&text));
    assert!((1..100).contains(&mistakes.len()), "{}", mistakes.len());
    let options = UrdfOptions { fixed: vec![("none".to_owned(), 0.0)], ..UrdfOptions::default() };
    let said = UrdfArm::read(&robot(&text), GRAVITY, &options).expect_err("no such joint").to_string();
    assert!(said.len() < 1_000_000, "{}", said.len());
}

/// All mistakes come at once, each with the line of its link or joint, and what never moves is none.
#[test]
fn every_mistake_is_named_with_its_line() {
    let mut random = Random::new(4);
    let text = robot(&chain(4, &mut random));
    let line = |needle: &str| text.lines().position(|line| line.contains(needle)).map_or(0, |k| k + 1);
    let bad = |text: &str, link: &str, what: &str, new: &str| {
        let start = text.find(&format!("<link name=\"{link}\">")).expect("in the text");
        let at = start + text[start..].find(&format!("{what}=\"")).expect("in the link") + what.len() + 2;
        let end = at + text[at..].find('"').expect("closed");
        format!("{}{new}{}", &text[..at], &text[end..])
    };
    let mut broken = text.clone();
    broken = bad(&broken, "l1", "mass value", "-2");
    broken = bad(&broken, "l2", "ixx", "9");
    broken = bad(&broken, "l3", "izz", "two");
    let j4 = broken.find("<joint name=\"j4\"").expect("in the text");
    broken = format!("{}{}", &broken[..j4], broken[j4..].replacen("effort=\"50\"", "effort=\"much\"", 1));
    let found: Vec<(usize, &str)> = refused(&broken)
        .iter()
        .map(|(line, error)| {
            let kind = match error {
                UrdfError::BadMass { .. } => "mass",
                UrdfError::TriangleInequality { .. } => "triangle",
                UrdfError::NoNumber { .. } => "number",
                other => panic!("{other:?}"),
            };
            (*line, kind)
        })
        .collect();
    let l3 = line("<link name=\"l3\">") + 1;
    let expected = [
        (line("<link name=\"l1\">"), "mass"),
        (line("<link name=\"l2\">"), "triangle"),
        (l3, "number"),
        (line("name=\"j4\""), "number"),
    ];
    assert_eq!(found, expected, "{broken}");

    // The same bodies on links that do not move are no mistake.
    let root = text.replacen("<joint name=\"j1\" type=\"revolute\">", "<joint name=\"j1\" type=\"fixed\">", 1);
    let (root, sound) = (bad(&bad(&root, "l1", "mass value", "0"), "l1", "ixx", "nan"), root);
    let (with, without) =
        (Arm::from_urdf(&root, GRAVITY).expect("taken"), Arm::from_urdf(&sound, GRAVITY).expect("a chain"));
    assert_eq!(with, without);
}

/// An impossible inertia is projected on request, and said; the rest of the arm stays as it is.
#[test]
fn projection_is_asked_for_and_said() {
    let mut random = Random::new(8);
    let text = robot(&chain(3, &mut random));
    let at = text.find("<link name=\"l2\">").expect("in the text");
    let at = at + text[at..].find("izz=\"").expect("an inertia") + 5;
    let end = at + text[at..].find('"').expect("closed");
    let options = UrdfOptions { project: true, ..UrdfOptions::default() };
    for value in ["0.9", "-0.01", "0"] {
        let broken = format!("{}{value}{}", &text[..at], &text[end..]);
        assert_eq!(refused(&broken).len(), 1, "{value}");
        let read = read(&broken, &options);
        assert!(read.arm.links.iter().all(|link| smallest_eigenvalue(link) > 0.0), "{value}");
        let projected = read.notes.iter().filter(|note| matches!(note, UrdfNote::Projected { .. })).count();
        assert_eq!(projected, 1, "{value}: {:?}", read.notes);
        let sound = Arm::from_urdf(&text, GRAVITY).expect("a chain");
        assert_eq!((&read.arm.links[0], &read.arm.links[2]), (&sound.links[0], &sound.links[2]));
        // Mass and first moment have nothing to do with it.
        assert!(distance(&read.arm.links[1][..4], &sound.links[1][..4]) < 1e-15);
    }
    assert_eq!(read(&text, &options), read(&text, &UrdfOptions::default()), "a sound file is read alike");
}

/// Bodies that the file does not have are guessed: physical, of the size of the arm, with a deviation that holds the true ones.
#[test]
fn missing_bodies_are_a_guess_with_a_wide_prior() {
    for name in ["ur10e", "ur5e", "manutec-r3", "staubli-tx40", "kuka-kr300-r2500"] {
        let path = format!("{}/../../robots/{name}/robot.urdf", env!("CARGO_MANIFEST_DIR"));
        let text = std::fs::read_to_string(&path).expect("a URDF of this project");
        let truth = Arm::from_urdf(&text, GRAVITY).expect("a chain");
        let mut bare = String::new();
        let mut rest = text.as_str();
        while let Some(start) = rest.find("<inertial>") {
            let end = start + rest[start..].find("</inertial>").expect("closed") + "</inertial>".len();
            let _ = write!(bare, "{}", &rest[..start]);
            rest = &rest[end..];
        }
        bare += rest;
        assert!(matches!(Arm::from_urdf(&bare, GRAVITY), Err(UrdfError::NoMass { .. })));
        let mut read = read(&bare, &UrdfOptions::default());
        assert!(read.unknown.iter().all(|unknown| *unknown) && read.arm.joints == truth.joints);
        let limits: Vec<f64> = read.arm.joints.iter().map(|joint| joint.effort).collect();
        let std = guess_bodies(&mut read.arm, &read.unknown.clone(), &limits, read.tip_length);
        let mass = |arm: &Arm| arm.links.iter().skip(1).map(|link| link[0]).sum::<f64>();
        let ratio = mass(&read.arm) / mass(&truth);
        println!("{name}: guessed {:.1} kg for {:.1}", mass(&read.arm), mass(&truth));
        assert!((0.2..5.0).contains(&ratio), "{name}: {ratio}");
        assert!(read.arm.links.iter().all(|link| smallest_eigenvalue(link) > 0.0));
        let (n, q) = (read.arm.dof(), vec![0.3; read.arm.dof()]);
        let mut m = vec![0.0; n * n];
        mass_matrix(&read.arm, &read.arm.links, &mut Workspace::new(&read.arm), &q, &mut m);
        assert!((0..n).all(|j| m[j * n + j] > 0.0));
        let off = |(k, true_value): (usize, f64)| (true_value - read.arm.links.concat()[k]).abs() / std[k];
        let worst = truth.links.concat().into_iter().enumerate().map(off).fold(0.0, f64::max);
        assert!(worst < 10.0, "{name}: {worst} deviations off");
    }
}

/// Values go back into a tree's text, and what is welded loses its own mass to the link that carries it.
#[test]
fn bodies_of_a_tree_are_written_back() {
    let mut random = Random::new(31);
    let text = robot(
        &(chain(4, &mut random)
            + &link("left", &mut random)
            + &link("right", &mut random)
            + &joint("a", "prismatic", ["l4", "left"], "", LIMIT)
            + &joint("b", "prismatic", ["l4", "right"], "", LIMIT)),
    );
    let options = proposed(&text);
    let before = read(&text, &options).arm;
    let written = write_urdf(&text, &options, &before.links, &[0.5; 4], &[1.5; 4]).expect("written");
    let after = read(&written.text, &options);
    for (a, b) in after.arm.links.iter().zip(&before.links) {
        assert!(distance(a, b) < 1e-13 * largest(b));
    }
    let merged: Vec<(&str, &str)> = written.merged.iter().map(|(a, b)| (a.as_str(), b.as_str())).collect();
    assert_eq!(merged, [("left", "l4"), ("right", "l4")]);
    assert_eq!(after.friction, [Some([0.5, 1.5]); 4]);
}

/// What is taken out of the text before urdf-rs reads it changes no number of the files of this project.
#[test]
fn numbers_are_those_of_the_whole_text() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../robots");
    let mut seen = 0;
    for entry in std::fs::read_dir(folder).expect("robots/").flatten() {
        let Ok(text) = std::fs::read_to_string(entry.path().join("robot.urdf")) else { continue };
        let other = urdf_rs::read_from_string(&text).expect("a URDF");
        let read = read(&text, &UrdfOptions::default());
        assert_eq!(read.arm.name, other.name);
        for (k, joint) in read.arm.joints.iter().enumerate() {
            let twin = other.joints.iter().find(|j| j.name == joint.name).expect("the same joints");
            let axis = twin.axis.xyz.0;
            let size = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
            assert!(distance(&joint.axis, &axis.map(|x| x / size)) < 1e-15);
            assert_eq!((joint.velocity, joint.effort), (twin.limit.velocity, twin.limit.effort));
            let friction = twin.dynamics.as_ref().map(|d| [d.damping, d.friction]);
            assert_eq!(read.friction[k], friction);
        }
        let mass: f64 = read.arm.links.iter().map(|link| link[0]).sum();
        let moving = |link: &&urdf_rs::Link| other.joints.iter().any(|j| j.child.link == link.name);
        let theirs: f64 = other.links.iter().filter(moving).map(|link| link.inertial.mass.value).sum();
        assert!((mass - theirs).abs() < 1e-12 * theirs, "{}: {mass} {theirs}", read.arm.name);
        seen += 1;
    }
    assert!(seen >= 7);
}
