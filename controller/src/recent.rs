//! Recent torques, and how well parameter sets predict them.

use rivet_config::Robot;
use rivet_dynamics::MAX_JOINTS;
use rivet_estimation::{SettingsError, TorqueRows};
use std::sync::Arc;

/// Instants kept.
const INSTANTS: usize = 64;
/// Time they cover \[s\].
const SPAN_S: f64 = 2.0;
/// Highest cut-off of the filter over rows and torques \[Hz\].
const HIGHEST_FILTER_HZ: f64 = 20.0;
/// Instants at which a joint moved before its prediction counts.
const FEWEST: u32 = 12;
/// A set that is this much worse (rms) is no worse: two sets that differ by less than noise differ by chance.
const SLACK: f64 = 1.05;
/// A single joint may get this much worse (rms) while all together do not.
const JOINT_SLACK: f64 = 1.5;
/// Errors below this share of the torque limit (rms) do not count.
const FLOOR: f64 = 0.003;

/// Filtered rows and torques of about the last two seconds of motion.
pub(crate) struct Recent {
    chain: TorqueRows,
    /// Rows that come between two that are kept.
    spacing: usize,
    since: usize,
    between: u64,
    dof: usize,
    count: usize,
    rows: Vec<f64>,
    tau: Vec<[f64; MAX_JOINTS]>,
    used: Vec<[bool; MAX_JOINTS]>,
    next: usize,
    filled: usize,
    floor: [f64; MAX_JOINTS],
}

/// What one set makes of the recent torques.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Prediction {
    /// Root mean square error of each joint \[N·m\]; NaN for joints that did not move enough.
    pub(crate) rms: [f64; MAX_JOINTS],
    /// The same of the torque itself.
    torque: [f64; MAX_JOINTS],
}

/// How a set compares with others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// At least as good.
    NoWorse,
    /// Worse.
    Worse,
    /// Too little motion to tell.
    Unknown,
}

impl Recent {
    pub(crate) fn new(robot: &Robot) -> Result<Recent, SettingsError> {
        let mut settings = robot.config.estimation_settings();
        // A set is not to be blamed for noise in the acceleration that it is multiplied with: where the estimator is told to
        // live with such noise, this comparison is not.
        settings.filter_hz = settings.filter_hz.min(HIGHEST_FILTER_HZ);
        settings.filter_order = settings.filter_order.max(4);
        let (dof, count) = (robot.dof(), robot.base.len());
        let mut floor = [0.0; MAX_JOINTS];
        for (floor, limit) in floor.iter_mut().zip(&robot.config.drive.torque_limit) {
            *floor = FLOOR * limit;
        }
        let spacing = (SPAN_S / INSTANTS as f64 / settings.row_period_s()).round().max(1.0) as usize;
        Ok(Recent {
            chain: TorqueRows::new(Arc::clone(&robot.model), &robot.base, &settings)?,
            spacing,
            since: 0,
            between: (spacing * settings.decimation) as u64,
            dof,
            count,
            rows: vec![0.0; INSTANTS * dof * count],
            tau: vec![[0.0; MAX_JOINTS]; INSTANTS],
            used: vec![[false; MAX_JOINTS]; INSTANTS],
            next: 0,
            filled: 0,
            floor,
        })
    }

    /// Takes in a sample's positions and torques; true when an instant of it was kept. Real-time safe.
    pub(crate) fn push(&mut self, q: &[f64], tau: &[f64]) -> bool {
        if !self.chain.push(q, tau) || !self.chain.used().contains(&true) {
            return false;
        }
        self.since += 1;
        if self.since < self.spacing {
            return false;
        }
        self.since = 0;
        let (k, size) = (self.next, self.dof * self.count);
        self.rows[k * size..(k + 1) * size].copy_from_slice(self.chain.rows());
        self.tau[k][..self.dof].copy_from_slice(self.chain.tau());
        self.used[k][..self.dof].copy_from_slice(self.chain.used());
        self.next = if k + 1 == INSTANTS { 0 } else { k + 1 };
        self.filled = (self.filled + 1).min(INSTANTS);
        true
    }

    /// Samples between two instants that are kept, as long as joints move.
    pub(crate) fn periods_between(&self) -> u64 {
        self.between
    }

    /// The signal chain starts anew after lost samples; what was kept stays.
    pub(crate) fn restart_signals(&mut self) {
        self.chain.restart();
    }

    /// Forgets everything: the arm may have become another one meanwhile.
    pub(crate) fn restart(&mut self) {
        self.chain.restart();
        (self.next, self.filled, self.since) = (0, 0, 0);
    }

    /// How well `x` predicts. Real-time safe: bounded work.
    pub(crate) fn predict(&self, x: &[f64]) -> Prediction {
        let (mut square, mut torque, mut rows) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS], [0_u32; MAX_JOINTS]);
        let instants = self.rows.chunks_exact(self.dof * self.count).zip(&self.tau).zip(&self.used);
        for ((instant, tau), used) in instants.take(self.filled) {
            for (j, row) in instant.chunks_exact(self.count).enumerate().filter(|(j, _)| used[*j]) {
                let model: f64 = row.iter().zip(x).map(|(y, x)| y * x).sum();
                square[j] += (tau[j] - model).powi(2);
                torque[j] += tau[j] * tau[j];
                rows[j] += 1;
            }
        }
        let rms = |sum: f64, rows: u32| if rows >= FEWEST { (sum / f64::from(rows)).sqrt() } else { f64::NAN };
        let mut prediction = Prediction { rms: [f64::NAN; MAX_JOINTS], torque: [f64::NAN; MAX_JOINTS] };
        for j in 0..self.dof {
            prediction.rms[j] = rms(square[j], rows[j]);
            prediction.torque[j] = rms(torque[j], rows[j]);
        }
        prediction
    }

    /// Whether `candidate` predicts no worse than `reference`: over all joints, each by the rms of its torque, and joint by
    /// joint with more room.
    pub(crate) fn compare(&self, candidate: &Prediction, reference: &Prediction) -> Verdict {
        let (mut new, mut old, mut joints) = (0.0, 0.0, 0);
        let mut worse = false;
        for j in 0..self.dof {
            let (c, r, floor) = (candidate.rms[j], reference.rms[j], self.floor[j]);
            if c.is_nan() && !r.is_nan() {
                return Verdict::Worse; // its torques are beyond numbers
            }
            if r.is_nan() {
                continue;
            }
            joints += 1;
            let scale = reference.torque[j].max(10.0 * floor);
            new += (c / scale).powi(2);
            old += ((SLACK * r).hypot(floor) / scale).powi(2);
            worse |= c > (JOINT_SLACK * r).hypot(2.0 * floor);
        }
        match (joints, worse || new > old) {
            (0, _) => Verdict::Unknown,
            (_, true) => Verdict::Worse,
            (_, false) => Verdict::NoWorse,
        }
    }

    /// Whether `candidate` predicts as well as `reference` or better over all joints, with no room at all: by what passes
    /// [`compare`](Self::compare) again and again a long row of sets can get worse step by step, by this it cannot.
    pub(crate) fn as_good(&self, candidate: &Prediction, reference: &Prediction) -> bool {
        let joints = (0..self.dof).filter(|&j| !reference.rms[j].is_nan());
        let (mut new, mut old) = (0.0, 0.0);
        for j in joints {
            let scale = reference.torque[j].max(10.0 * self.floor[j]);
            new += (candidate.rms[j] / scale).powi(2);
            old += (reference.rms[j] / scale).powi(2);
        }
        new <= old // false for NaN
    }
}
