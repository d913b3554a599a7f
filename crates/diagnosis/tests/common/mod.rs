//! A small arm and noise for tests that make their own logs.

use rivet_dynamics::Arm;

/// A waist, a shoulder and an elbow.
const URDF: &str = r#"<robot name="three"><link name="base"/>
    <link name="a"><inertial><origin xyz="0 0 0.2"/><mass value="8"/><inertia ixx="0.2" iyy="0.2" izz="0.1" ixy="0" ixz="0"
    iyz="0"/></inertial></link>
    <link name="b"><inertial><origin xyz="0.2 0 0"/><mass value="5"/><inertia ixx="0.02" iyy="0.1" izz="0.1" ixy="0" ixz="0"
    iyz="0"/></inertial></link>
    <link name="c"><inertial><origin xyz="0.15 0 0.02"/><mass value="3"/><inertia ixx="0.01" iyy="0.05" izz="0.05" ixy="0"
    ixz="0" iyz="0"/></inertial></link>
    <joint name="1" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" velocity="3" effort="200"/></joint>
    <joint name="2" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.1 0 0.4"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" velocity="3" effort="200"/></joint>
    <joint name="3" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" velocity="3" effort="100"/></joint></robot>"#;

/// The arm, upright.
pub(crate) fn arm() -> Arm {
    Arm::from_urdf(URDF, [0.0, 0.0, -9.81]).expect("a sound arm")
}

/// Nearly normal noise of standard deviation 1, the same each time.
pub(crate) struct Noise(pub(crate) u64);

impl Noise {
    pub(crate) fn draw(&mut self) -> f64 {
        // xorshift64*; a sum of four even draws is near enough to a normal one.
        let mut even = || {
            self.0 ^= self.0 >> 12;
            self.0 ^= self.0 << 25;
            self.0 ^= self.0 >> 27;
            (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        (0..4).map(|_| even()).sum::<f64>() * 3.0_f64.sqrt()
    }
}
