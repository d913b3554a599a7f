//! MJCF: what is written is read back, in the form that MuJoCo 3 reads where it can hold the drives.

use rivet_dynamics::{Arm, Mjcf, MjcfDrive};

const PENDULUM: &str = r#"<robot name="p">
  <link name="base"/>
  <joint name="j1" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" velocity="2" effort="3"/></joint>
  <link name="a"><inertial><origin xyz="0 0 0.2"/><mass value="2"/>
    <inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>"#;

fn file(drive: MjcfDrive) -> Mjcf {
    let arm = Arm::from_urdf(PENDULUM, [0.0, 0.0, -9.81]).expect("an arm");
    Mjcf { arm, period_s: 0.001, drives: vec![drive], tendons: Vec::new() }
}

/// The value of the joint's attribute `damping`.
fn damping(text: &str) -> &str {
    text.split("damping=\"").nth(1).and_then(|rest| rest.split('"').next()).expect("a joint with damping")
}

#[test]
fn linear_damping_is_one_number_for_mujoco_3() {
    let drive = MjcfDrive { damping: [0.7, 0.0, 0.0], frictionloss: 1.5, ..MjcfDrive::plain(3.0) };
    let written = file(drive.clone());
    let text = written.text();
    assert_eq!(damping(&text), "0.7");
    assert!(!text.contains("MuJoCo 4"), "{text}");
    assert_eq!(Mjcf::read(&text).expect("it reads").drives, [drive]);
}

#[test]
fn what_mujoco_3_cannot_read_is_named_in_the_first_line() {
    for (drive, named) in [
        (MjcfDrive { damping: [0.7, 0.2, 0.0], ..MjcfDrive::plain(3.0) }, "damping with several coefficients"),
        (MjcfDrive { delay: 0.004, ..MjcfDrive::plain(3.0) }, "delay"),
    ] {
        let text = file(drive.clone()).text();
        let first = text.lines().next().expect("a line");
        assert!(first.contains("needs MuJoCo 4") && first.contains(named), "{first}");
        assert_eq!(Mjcf::read(&text).expect("it reads").drives, [drive]);
    }
}
