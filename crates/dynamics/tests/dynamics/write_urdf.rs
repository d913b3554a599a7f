//! New values in a URDF's text: read back exactly, everything else untouched.

use rivet_dynamics::{Arm, UrdfError, UrdfOptions, body_from_com, write_efforts, write_urdf};

/// A chain with a mass fixed to the root, a moving link without `<inertial>`, a flange fixed to the tip, comments that
/// look like elements, and a transmission that names a joint.
const TEXT: &str = r#"<?xml version="1.0"?>
<robot name="r">
  <!-- <link name="a"><inertial><mass value="9"/></inertial></link> -->
  <link name="base"/>
  <link name="pedestal"><inertial><mass value="50"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="bolts" type="fixed"><parent link="base"/><child link="pedestal"/></joint>
  <joint name="j1" type="revolute">
    <parent link="base"/><child link="a"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="2" effort="3"/>
    <dynamics damping="1" friction="2"/>
  </joint>
  <link name='a'/>
  <joint name="shell" type="fixed"><origin xyz="0 0 0.2" rpy="0.1 0 0"/><parent link="a"/><child link="casing"/></joint>
  <link name="casing">
    <visual><geometry><box size="1 1 1"/></geometry></visual>
    <inertial><origin xyz="0.1 0 0"/><mass value="2"/>
      <inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="j2" type="continuous"><parent link="a"/><child link="b"/><origin xyz="0.3 0 0"/><axis xyz="0 1 0"/></joint>
  <link name="b">
    <inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <transmission name="t"><joint name="j2"><dynamics damping="7"/></joint></transmission>
</robot>
"#;

fn bodies() -> Vec<[f64; 10]> {
    let inertia = [[0.021, 0.001, -0.002], [0.001, 0.033, 0.0005], [-0.002, 0.0005, 0.027]];
    vec![body_from_com(2.7, &[0.11, -0.02, 0.19], &inertia), body_from_com(0.9, &[-0.01, 0.02, 0.03], &inertia)]
}

#[test]
fn efforts_go_down_and_the_rest_stays() {
    let written = write_efforts(TEXT, &[("j1", 2.5), ("j2", 1.0)]).expect("written");
    let limit = "<limit lower=\"-1\" upper=\"1\" velocity=\"2\" effort=\"3\"/>";
    let lower = "<limit lower=\"-1\" upper=\"1\" velocity=\"2\" effort=\"2.5\"/>";
    assert_eq!(written, TEXT.replace(limit, lower), "j2 has no <limit>");
    assert_eq!(write_efforts(TEXT, &[("j1", 4.0)]).expect("written"), TEXT, "the limit is lower already");
}

#[test]
fn values_read_back_and_the_rest_stays() {
    let (links, gravity) = (bodies(), [0.0, 0.0, -9.81]);
    let before = Arm::from_urdf(TEXT, gravity).expect("an arm");
    let written = write_urdf(TEXT, &UrdfOptions::default(), &links, &[1.25, 0.5], &[3.5, 0.75]).expect("written");
    let after = Arm::from_urdf(&written.text, gravity).expect("an arm again");
    for (new, wanted) in after.links.iter().flatten().zip(links.iter().flatten()) {
        // To the centre of mass and back: a few roundings of numbers below 3.
        assert!((new - wanted).abs() < 1e-14, "{new} {wanted}");
    }
    assert_eq!(Arm { links: before.links.clone(), ..after.clone() }, before, "kinematics and limits are as before");
    assert_eq!(written.merged, [("casing".to_owned(), "a".to_owned())]);
    for dynamics in ["<dynamics damping=\"1.25\" friction=\"3.5\"/>", "<dynamics damping=\"0.5\" friction=\"0.75\"/>"] {
        assert_eq!(written.text.matches(dynamics).count(), 1, "{dynamics} in\n{}", written.text);
    }
    for kept in ["<mass value=\"50\"/>", "<box size=\"1 1 1\"/>", "<mass value=\"9\"/>", "<dynamics damping=\"7\"/>"] {
        assert!(written.text.contains(kept), "{kept} in\n{}", written.text);
    }
    let again =
        write_urdf(&written.text, &UrdfOptions::default(), &links, &[1.25, 0.5], &[3.5, 0.75]).expect("written");
    assert!(again.merged.is_empty(), "nothing is left to merge");
}

#[test]
fn a_body_without_mass_is_refused_by_name() {
    let mut links = bodies();
    links[1] = [0.0; 10];
    match write_urdf(TEXT, &UrdfOptions::default(), &links, &[0.0; 2], &[0.0; 2]) {
        Err(UrdfError::NoMass { link }) => assert_eq!(link, "b"),
        other => panic!("{other:?}"),
    }
}
