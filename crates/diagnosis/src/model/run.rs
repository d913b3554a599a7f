//! A run as it was logged, and its motion: position, velocity and acceleration.

use std::ops::Range;

use rivet_estimation::offline::{Trajectory, ZeroPhase};

use crate::model::history::Past;

/// One uniformly sampled run, `[joint][sample]`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Run {
    /// What messages call it.
    pub name: String,
    /// Time between samples \[s\].
    pub period_s: f64,
    /// Measured positions \[rad\].
    pub q: Vec<Vec<f64>>,
    /// Measured (or commanded) torque \[N·m\], joint side.
    pub tau: Vec<Vec<f64>>,
    /// Desired motion.
    pub desired: Option<Trajectory>,
    /// Motor temperatures \[°C\].
    pub temperature: Option<Vec<Vec<f64>>>,
    /// What the joints did before.
    pub past: Past,
    /// Samples (ascending) that no row of the log is near: interpolated over rows that are missing.
    pub interpolated: Vec<usize>,
}

impl Run {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.q.first().map_or(0, Vec::len)
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of joints.
    pub fn joints(&self) -> usize {
        self.q.len()
    }

    /// A stretch of it by another name. What the joints did before comes after what they do in it.
    pub(crate) fn part(&self, range: Range<usize>, name: String) -> Run {
        let cut = |s: &Vec<Vec<f64>>| s.iter().map(|s| s[range.clone()].to_vec()).collect();
        let past = if range.start == 0 {
            self.past.clone()
        } else {
            {
                let before = self.part(0..range.start, String::new());
                before.past.followed_by(&before.q, before.period_s, 0.0)
            }
        };
        let within = self.interpolated.iter().filter(|k| range.contains(k));
        let interpolated = within.map(|k| k - range.start).collect();
        Run { name, past, interpolated, ..self.each(self.period_s, cut) }
    }

    /// With all signals changed alike; samples may be other ones.
    pub(crate) fn each(&self, period_s: f64, of: impl Fn(&Vec<Vec<f64>>) -> Vec<Vec<f64>>) -> Run {
        Run {
            name: self.name.clone(),
            period_s,
            q: of(&self.q),
            tau: of(&self.tau),
            desired: self.desired.as_ref().map(|d| Trajectory { q: of(&d.q), qd: of(&d.qd), qdd: of(&d.qdd) }),
            temperature: self.temperature.as_ref().map(&of),
            past: self.past.clone(),
            interpolated: Vec::new(),
        }
    }

    /// Length \[s\].
    pub fn seconds(&self) -> f64 {
        self.len() as f64 * self.period_s
    }
}

/// Share of a single run that is trained on; the rest is held out.
pub const TRAINING_SHARE: f64 = 0.6;

/// Runs to look at and the run to seal.
pub(crate) fn split(mut runs: Vec<Run>) -> Option<(Vec<Run>, Run)> {
    let last = runs.pop()?;
    if !runs.is_empty() {
        return Some((runs, last));
    }
    let cut = (last.len() as f64 * TRAINING_SHARE) as usize;
    let first = last.part(0..cut, format!("{} (first part)", last.name));
    let rest = last.part(cut..last.len(), format!("{} (rest)", last.name));
    Some((vec![first], rest))
}

/// Cut-off of the positions' smoothing \[Hz\], where the rate allows it.
const MOTION_HZ: f64 = 80.0;

/// Smoothed positions and their derivatives at the rate of the log, `[joint][sample]`.
#[derive(Clone, Debug)]
pub(crate) struct Motion {
    /// Time between samples \[s\].
    pub(crate) period_s: f64,
    /// \[rad\]
    pub(crate) q: Vec<Vec<f64>>,
    /// \[rad/s\]
    pub(crate) qd: Vec<Vec<f64>>,
    /// \[rad/s²\]
    pub(crate) qdd: Vec<Vec<f64>>,
}

impl Motion {
    /// Zero-phase low-pass of the positions, then central differences: nothing lags.
    pub(crate) fn from_run(run: &Run) -> Motion {
        let smooth = ZeroPhase::new(MOTION_HZ, 4, run.period_s);
        let q: Vec<Vec<f64>> = run
            .q
            .iter()
            .map(|q| {
                let mut q = q.clone();
                smooth.apply(&mut q);
                q
            })
            .collect();
        let qd = q.iter().map(|q| derivative(q, run.period_s)).collect();
        let qdd = q.iter().map(|q| second_derivative(q, run.period_s)).collect();
        Motion { period_s: run.period_s, q, qd, qdd }
    }

    pub(crate) fn len(&self) -> usize {
        self.q.first().map_or(0, Vec::len)
    }

    pub(crate) fn joints(&self) -> usize {
        self.q.len()
    }

    /// State at sample `k`, written to three slices of one entry a joint.
    pub(crate) fn state(&self, k: usize, q: &mut [f64], qd: &mut [f64], qdd: &mut [f64]) {
        for (to, from) in [(q, &self.q), (qd, &self.qd), (qdd, &self.qdd)] {
            to.iter_mut().zip(from).for_each(|(to, from)| *to = from[k]);
        }
    }
}

/// Central differences; the ends repeat their neighbours.
pub(crate) fn derivative(x: &[f64], period_s: f64) -> Vec<f64> {
    differences(x, |before, _, after| (after - before) / (2.0 * period_s))
}

fn second_derivative(x: &[f64], period_s: f64) -> Vec<f64> {
    differences(x, |before, at, after| (after - 2.0 * at + before) / (period_s * period_s))
}

fn differences(x: &[f64], f: impl Fn(f64, f64, f64) -> f64) -> Vec<f64> {
    let last = x.len().saturating_sub(2).max(1);
    let at = |k: usize| {
        let k = k.clamp(1, last);
        f(x[k - 1], x[k], x[k + 1])
    };
    if x.len() < 3 { vec![0.0; x.len()] } else { (0..x.len()).map(at).collect() }
}
