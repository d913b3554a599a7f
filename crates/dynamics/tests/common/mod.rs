//! Shared by the integration tests: reference arms from outside the repository, random arms, comparison.
#![allow(dead_code, unreachable_pub, reason = "each test binary is a crate of its own and uses its part")]

use std::io::Write as _;
use std::path::PathBuf;

use rivet_dynamics::{Arm, Joint, JointKind, LinkParameters, body_from_com, body_in_frame};

pub const GRAVITY: [f64; 3] = [0.0, 0.0, -9.81];

/// The folder of reference robots beside the repository; `None`, said aloud, where it is not there.
pub fn robots() -> Option<PathBuf> {
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/robots"));
    if path.is_dir() {
        return Some(path);
    }
    // Past the test harness, which keeps what a passing test says through the macros to itself.
    let _ = writeln!(std::io::stderr(), "SKIPPED: {} is not there, nothing was compared", path.display());
    None
}

/// A reference arm, e.g. `"staubli-tx40/staubli-tx40.urdf"`; `None` where the folder is not there.
pub fn reference_arm(file: &str) -> Option<Arm> {
    let text = std::fs::read_to_string(robots()?.join(file)).expect("reference URDF");
    Some(Arm::from_urdf(&text, GRAVITY).unwrap_or_else(|e| panic!("{file}: {e}")))
}

/// The arms with a folder of their own, variants included.
pub const REFERENCE_ARMS: [&str; 10] = [
    "manutec-r3/manutec-r3.urdf",
    "manutec-r3/manutec-r3-load15.urdf",
    "manutec-r3-model2/manutec-r3-model2.urdf",
    "staubli-tx40/staubli-tx40.urdf",
    "ur10e/ur10e.urdf",
    "ur10/ur10.urdf",
    "ur5e/ur5e.urdf",
    "kuka-kr300-r2500/kuka-kr300-r2500.urdf",
    "dd2/dd2.urdf",
    "dd2/dd2-horizontal.urdf",
];

/// xorshift64*: enough for test states, and a seed says it all.
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Random {
        let mut random = Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
        for _ in 0..8 {
            random.unit();
        }
        random
    }

    pub fn unit(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    pub fn vector(&mut self, n: usize, reach: f64) -> Vec<f64> {
        (0..n).map(|_| self.between(-reach, reach)).collect()
    }

    pub fn vec3(&mut self, reach: f64) -> [f64; 3] {
        std::array::from_fn(|_| self.between(-reach, reach))
    }

    /// A unit vector, never near zero before it is scaled.
    pub fn direction(&mut self) -> [f64; 3] {
        loop {
            let v = self.vec3(1.0);
            let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
            if (0.1..1.0).contains(&length) {
                return v.map(|x| x / length);
            }
        }
    }

    /// A rotation by a random angle about a random axis (Rodrigues).
    pub fn rotation(&mut self) -> [[f64; 3]; 3] {
        let ([x, y, z], (s, c)) = (self.direction(), self.between(-3.0, 3.0).sin_cos());
        let v = 1.0 - c;
        [
            [c + x * x * v, x * y * v - z * s, x * z * v + y * s],
            [y * x * v + z * s, c + y * y * v, y * z * v - x * s],
            [z * x * v - y * s, z * y * v + x * s, c + z * z * v],
        ]
    }

    /// A body that can be: principal moments b+c, a+c, a+b of positive a, b, c.
    pub fn body(&mut self) -> LinkParameters {
        let [a, b, c] = [0; 3].map(|_| self.between(0.01, 0.5));
        let about_com = body_from_com(
            self.between(0.2, 8.0),
            &[0.0; 3],
            &[[b + c, 0.0, 0.0], [0.0, a + c, 0.0], [0.0, 0.0, a + b]],
        );
        let (r, com) = (self.rotation(), self.vec3(0.3));
        body_in_frame(&about_com, &r, &com)
    }

    /// An arm of `dof` joints, one in three prismatic, axes and placements without any special direction.
    pub fn arm(&mut self, dof: usize) -> Arm {
        let joint = |random: &mut Random, i: usize| Joint {
            name: format!("joint_{}", i + 1),
            kind: if random.unit() < 1.0 / 3.0 { JointKind::Prismatic } else { JointKind::Revolute },
            axis: random.direction(),
            rotation: random.rotation(),
            translation: random.vec3(0.5),
            lower: f64::NEG_INFINITY,
            upper: f64::INFINITY,
            velocity: f64::INFINITY,
            effort: f64::INFINITY,
            link: format!("link_{}", i + 1),
        };
        Arm {
            name: "random".to_owned(),
            joints: (0..dof).map(|i| joint(self, i)).collect(),
            links: (0..dof).map(|_| self.body()).collect(),
            gravity: self.vec3(10.0),
        }
    }
}

/// `a·b`.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// Row-major matrix times vector.
pub fn times(m: &[f64], x: &[f64]) -> Vec<f64> {
    m.chunks_exact(x.len()).map(|row| dot(row, x)).collect()
}

/// Largest magnitude.
pub fn largest(a: &[f64]) -> f64 {
    a.iter().fold(0.0, |m: f64, x| m.max(x.abs()))
}

/// Largest difference.
pub fn distance(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).fold(0.0, |m: f64, (x, y)| if (x - y).is_nan() { f64::NAN } else { m.max((x - y).abs()) })
}
