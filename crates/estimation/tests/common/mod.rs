//! Arms, motions and noise shared by the tests of this crate.
#![allow(dead_code, unreachable_pub, reason = "each test file uses its own part")]

use rivet_dynamics::{Arm, BaseSet, Joints, Model, Structure, Workspace, WristCoupling};
use rivet_dynamics::{LINK_PARAMETERS, body_from_com};
use rivet_estimation::{Correlation, EstimatorKind, EstimatorSettings, Motion, Prior, Supervision};
use std::io::Write as _;
use std::path::PathBuf;
use std::sync::Arc;

/// Settings for white rows whose noise is known, a hundred in the window.
pub fn known_noise(kind: EstimatorKind, supervision: Supervision) -> EstimatorSettings {
    EstimatorSettings {
        kind,
        forgetting: 0.99,
        deviation: None,
        supervision,
        prior: Prior { relative_std: 1.0 },
        noise_known: true,
        noise_memory: 100.0,
        outlier: f64::INFINITY,
        residual_memory: 100.0,
        change_row_s: None,
        correlation: Correlation { factor: 1.0, neighbour: 0.0 },
        block: 100,
    }
}

/// A model with true and nominal base parameters.
pub struct Bench {
    pub model: Arc<Model>,
    pub base: Arc<BaseSet>,
    pub truth: Vec<f64>,
    pub nominal: Vec<f64>,
    ws: Workspace,
    full: Vec<f64>,
    row: Vec<f64>,
}

/// The arm's URDF from `robots/`, else from the data beside the project; `None` (said aloud) when there is neither.
pub fn urdf(arm: &str) -> Option<String> {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..");
    let places =
        [root.join(format!("robots/{arm}/robot.urdf")), root.join(format!("../shared/robots/{arm}/{arm}.urdf"))];
    let text = places.iter().find_map(|place| std::fs::read_to_string(place).ok());
    if text.is_none() {
        // Past the test harness, which keeps what a passing test says through the macros to itself.
        let _ = writeln!(std::io::stderr(), "SKIPPED: no URDF of {arm} in robots/ or ../shared/robots/");
    }
    text
}

impl Bench {
    /// `arm` with drives like its own in size; nominal parameters are off by up to a third, alternating.
    pub fn new(arm: &str) -> Option<Bench> {
        let arm = Arm::from_urdf(&urdf(arm)?, [0.0, 0.0, -9.81]).expect("a sound URDF");
        let coupling =
            (arm.name.contains("tx40") || arm.name.contains("TX40")).then_some(WristCoupling { driving: 4, driven: 5 });
        Some(Bench::of(arm, Structure { offset: true, coupling, sign_velocity: 0.05, ..Structure::default() }))
    }

    pub fn of(arm: Arm, structure: Structure) -> Bench {
        let dof = arm.dof();
        let model = Model::new(arm, structure);
        let base = BaseSet::new(&model).expect("clear rank");
        let sized = |tip: f64, root: f64| -> Vec<f64> {
            (0..dof).map(|j| root * (tip / root).powf(j as f64 / (dof.max(2) - 1) as f64)).collect()
        };
        let joints = Joints {
            rotor_inertia: sized(0.05, 2.0),
            viscous: sized(0.6, 12.0),
            coulomb: sized(0.8, 15.0),
            offset: sized(0.1, 0.8),
            coupling: [0.02, 0.3, 0.5],
            ..Joints::default()
        };
        let truth = base.from_standard(&model.nominal(&joints));
        let nominal = truth.iter().enumerate().map(|(i, x)| x * [0.7, 1.3, 0.85, 1.1][i % 4]).collect();
        let (dof, full, n) = (model.arm.dof(), model.len(), base.len());
        let ws = Workspace::new(&model.arm);
        Bench {
            model: Arc::new(model),
            base: Arc::new(base),
            truth,
            nominal,
            ws,
            full: vec![0.0; dof * full],
            row: vec![0.0; dof * n],
        }
    }

    /// The true parameters with a ball of `mass` \[kg\] and 10 cm radius at `centre` \[m\] of the last link's frame.
    pub fn with_load(&self, mass: f64, centre: [f64; 3]) -> Vec<f64> {
        let own = 0.4 * mass * 0.1_f64.powi(2);
        let ball = [[own, 0.0, 0.0], [0.0, own, 0.0], [0.0, 0.0, own]];
        let mut load = vec![0.0; self.model.len()];
        let last = LINK_PARAMETERS * (self.dof() - 1);
        load[last..last + LINK_PARAMETERS].copy_from_slice(&body_from_com(mass, &centre, &ball));
        self.truth.iter().zip(self.base.from_standard(&load)).map(|(x, load)| x + load).collect()
    }

    pub fn dof(&self) -> usize {
        self.model.arm.dof()
    }

    pub fn len(&self) -> usize {
        self.base.len()
    }

    /// Regressor of `motion` in base parameters, a row a joint.
    pub fn rows(&mut self, motion: Motion<'_>) -> &[f64] {
        self.model.regressor(&mut self.ws, motion.q, motion.qd, motion.qdd, &mut self.full);
        self.base.select(&self.full, self.model.len(), &mut self.row);
        &self.row
    }

    /// Torque of parameters `x` in `motion`.
    pub fn torque(&mut self, motion: Motion<'_>, x: &[f64]) -> Vec<f64> {
        self.rows(motion).chunks_exact(x.len()).map(|row| row.iter().zip(x).map(|(a, b)| a * b).sum()).collect()
    }

    /// Rms torque error of `x` on the reference workload, as a share of the torque, each joint weighted by its own.
    pub fn torque_error(&self, x: &[f64]) -> f64 {
        let scales = rivet_estimation::Scales::of_model(&self.model, &self.base, &self.truth, None);
        let n = x.len();
        let square = |x: &[f64]| -> f64 {
            let row = |i: usize| -> f64 { (0..n).map(|j| scales.workload[i * n + j] * scales.column[j] * x[j]).sum() };
            (0..n).map(|i| scales.column[i] * x[i] * row(i)).sum()
        };
        let off: Vec<f64> = x.iter().zip(&self.truth).map(|(x, t)| x - t).collect();
        (square(&off) / square(&self.truth)).sqrt()
    }

    /// Largest error of `x` [share of the parameter, or of what makes a twentieth of the largest parameter's torque].
    pub fn error(&self, x: &[f64]) -> f64 {
        let scales = rivet_estimation::Scales::of_model(&self.model, &self.base, &self.truth, None);
        let size: Vec<f64> = self.truth.iter().zip(&scales.column).map(|(x, c)| (x * c).abs()).collect();
        let least = 1e-3 * scales.torque;
        x.iter()
            .zip(&self.truth)
            .zip(&scales.column)
            .zip(&size)
            .map(|(((x, t), c), size)| (x - t).abs() * c / size.max(least))
            .fold(0.0, f64::max)
    }
}

/// Analytic motion of all joints: sums of three sinusoids.
pub struct Wave {
    pub q: Vec<f64>,
    pub qd: Vec<f64>,
    pub qdd: Vec<f64>,
    scale: f64,
}

impl Wave {
    /// `speed`: 1 moves joints by up to about 1 rad at up to 3 rad/s.
    pub fn new(dof: usize, speed: f64) -> Wave {
        Wave { q: vec![0.0; dof], qd: vec![0.0; dof], qdd: vec![0.0; dof], scale: speed }
    }

    pub fn at(&mut self, t: f64) -> Motion<'_> {
        for j in 0..self.q.len() {
            (self.q[j], self.qd[j], self.qdd[j]) = (0.0, 0.0, 0.0);
            for (i, hz) in [0.23, 0.61, 1.13].iter().enumerate() {
                let w = std::f64::consts::TAU * hz * (1.0 + 0.071 * j as f64) * self.scale;
                let phase = w * t + (3 * i + 2 * j) as f64;
                let a = [0.5, 0.3, 0.2][i];
                self.q[j] += a * phase.sin();
                self.qd[j] += a * w * phase.cos();
                self.qdd[j] -= a * w * w * phase.sin();
            }
        }
        Motion { q: &self.q, qd: &self.qd, qdd: &self.qdd }
    }
}

/// SplitMix64 with normal numbers.
pub struct Random(pub u64);

impl Random {
    pub fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.unit()).cos()
    }
}
