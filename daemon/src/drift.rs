//! Whether the arm has left the model that was accepted: what that model leaves of the torque now against what it left first.
//!
//! How much a model leaves depends on how the joint moves, so squares of residuals are kept by regime. The first
//! [`REFERENCE_S`] seconds in a regime after acceptance are its reference; later ones are forgotten with [`MEMORY_S`]. A joint's
//! ratio compares both over the regimes it was in lately, so that another motion is not another arm.

use rivet_config::Robot;
use rivet_dynamics::MAX_JOINTS;
use rivet_estimation::Row;
use rivet_ipc_schema::{DRIFT_REGIMES, Drift, DriftRegime, DriftVerdict};

/// Motion in a regime that makes its reference \[s\].
const REFERENCE_S: f64 = 8.0;
/// Memory of what is left now \[s of motion\].
const MEMORY_S: f64 = 6.0;
/// Motion in a regime after its reference from which on it counts \[s\].
const LEAST_S: f64 = 1.0;
/// Time for which the ratio must hold \[s of motion\].
const DWELL_S: f64 = 3.0;
/// Ratio of mean squares from which on the arm has left the model, and below which it is back.
const LEFT: f64 = 3.0;
const BACK: f64 = 1.8;
/// Least growth of the mean square, as a share of that of the torque: less harms nobody.
const MATERIAL: f64 = 2e-3;
/// Share of the joint's late motion whose regimes must have a reference.
const COVERED: f64 = 0.5;
/// Slow is less than this share of the speed limit; of a joint without one, of 1 rad/s.
const SLOW: f64 = 0.1;
/// A joint accelerates when its speed changes by itself within this time \[s\].
const QUICK_S: f64 = 0.25;

#[derive(Clone, Copy, Debug, Default)]
struct Regime {
    /// Mean square of the first rows \[N²m²\], and how many they are.
    reference: f64,
    reference_rows: f64,
    /// Of the last rows.
    now: f64,
    rows: f64,
    /// Share of the joint's last rows.
    share: f64,
}

#[derive(Clone, Copy, Debug)]
struct Joint {
    regimes: [Regime; DRIFT_REGIMES],
    slow: f64,
    /// Mean square of the torque.
    torque: f64,
    torque_rows: f64,
    verdict: DriftVerdict,
    since_seq: u64,
    ratio: f64,
    /// Rows in a row that speak for the other verdict.
    against: f64,
}

/// Compares what the accepted model leaves with what it left.
#[derive(Clone, Debug)]
pub(crate) struct DriftWatch {
    dof: usize,
    joints: [Joint; MAX_JOINTS],
    /// Rows in a second.
    rate: f64,
}

impl DriftWatch {
    pub(crate) fn new(robot: &Robot, row_period_s: f64) -> DriftWatch {
        let limits = &robot.model.arm.joints;
        let joint = |j: usize| {
            let limit = limits.get(j).map_or(1.0, |joint| joint.velocity);
            let slow = SLOW * if limit.is_finite() && limit > 0.0 { limit } else { 1.0 };
            Joint {
                regimes: [Regime::default(); DRIFT_REGIMES],
                slow,
                torque: 0.0,
                torque_rows: 0.0,
                verdict: DriftVerdict::Unresolved,
                since_seq: 0,
                ratio: f64::NAN,
                against: 0.0,
            }
        };
        DriftWatch { dof: limits.len(), joints: std::array::from_fn(joint), rate: 1.0 / row_period_s }
    }

    /// Takes in a row whose torques are believed. Fixed work, no allocation.
    pub(crate) fn row(&mut self, row: &Row, seq: u64) {
        for j in (0..self.dof).filter(|j| row.moving[*j]) {
            self.joints[j].row(row.tau[j], row.accepted[j], row.speed[j], row.accel[j], self.rate, seq);
        }
    }

    pub(crate) fn write(&self, out: &mut Drift) {
        out.joints = self.dof as u32;
        let mut worst = DriftVerdict::Within;
        for (j, joint) in self.joints.iter().enumerate().take(self.dof) {
            out.joint_verdict[j] = joint.verdict.into();
            out.since_seq[j] = joint.since_seq;
            out.ratio[j] = joint.ratio.sqrt();
            for (r, regime) in joint.regimes.iter().enumerate() {
                let root = |square: f64, rows: f64| if rows > 0.0 { square.sqrt() } else { f64::NAN };
                out.residual_rms[r * MAX_JOINTS + j] = root(regime.now, regime.rows);
                out.reference_rms[r * MAX_JOINTS + j] = root(regime.reference, regime.reference_rows);
            }
            worst = match (worst, joint.verdict) {
                (DriftVerdict::Left, _) | (_, DriftVerdict::Left) => DriftVerdict::Left,
                (DriftVerdict::Unresolved, _) | (_, DriftVerdict::Unresolved) => DriftVerdict::Unresolved,
                _ => DriftVerdict::Within,
            };
        }
        out.verdict = worst.into();
    }
}

impl Joint {
    fn row(&mut self, tau: f64, accepted: f64, speed: f64, accel: f64, rate: f64, seq: u64) {
        let memory = MEMORY_S * rate;
        self.torque_rows += 1.0;
        self.torque += (tau * tau - self.torque) / self.torque_rows.min(10.0 * memory);
        let square = (tau - accepted).powi(2);
        let current = regime(speed, accel, self.slow) as usize;
        for (r, regime) in self.regimes.iter_mut().enumerate() {
            let here = f64::from(u8::from(r == current));
            regime.share += (here - regime.share) / memory.min(self.torque_rows);
            if r != current {
                continue;
            }
            if regime.reference_rows < REFERENCE_S * rate {
                regime.reference_rows += 1.0;
                regime.reference += (square - regime.reference) / regime.reference_rows;
            } else {
                regime.rows += 1.0;
                regime.now += (square - regime.now) / regime.rows.min(memory);
            }
        }
        self.judge(rate, seq);
    }

    fn judge(&mut self, rate: f64, seq: u64) {
        let (mut now, mut then, mut covered) = (0.0, 0.0, 0.0);
        for regime in &self.regimes {
            if regime.rows >= LEAST_S * rate {
                now += regime.share * regime.now;
                then += regime.share * regime.reference;
                covered += regime.share;
            }
        }
        if covered < COVERED {
            // What was found stays found until the joint moves as it did.
            self.against = 0.0;
            return;
        }
        self.ratio = now / then.max(f64::MIN_POSITIVE);
        let material = now - then > covered * MATERIAL * self.torque;
        let says = match self.verdict {
            DriftVerdict::Left if self.ratio > BACK && material => DriftVerdict::Left,
            _ if self.ratio > LEFT && material => DriftVerdict::Left,
            _ => DriftVerdict::Within,
        };
        self.against = if says == self.verdict { 0.0 } else { self.against + 1.0 };
        if self.against > DWELL_S * rate {
            self.verdict = says;
            self.since_seq = seq;
            self.against = 0.0;
        }
    }
}

fn regime(speed: f64, accel: f64, slow: f64) -> DriftRegime {
    match (speed.abs() < slow, accel.abs() * QUICK_S > speed.abs()) {
        (true, true) => DriftRegime::Reversal,
        (true, false) => DriftRegime::Slow,
        (false, false) => DriftRegime::Cruise,
        (false, true) => DriftRegime::Accelerating,
    }
}
