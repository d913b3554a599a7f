//! Tracking error by phase, from what the bus carries.

use rivet_ipc_schema::{JointState, MAX_JOINTS, Setpoint};
use std::collections::VecDeque;
use std::ops::Range;

/// Mean square of desired minus measured position \[rad²\].
#[derive(Clone, Debug, Default)]
pub(crate) struct Square {
    sum: [f64; MAX_JOINTS],
    count: u64,
}

impl Square {
    fn add(&mut self, desired: &[f64; MAX_JOINTS], measured: &[f64; MAX_JOINTS]) {
        for j in 0..MAX_JOINTS {
            self.sum[j] += (desired[j] - measured[j]).powi(2);
        }
        self.count += 1;
    }

    /// Root mean square of joint `j` \[rad\]; not a number before the first sample.
    pub(crate) fn rms(&self, j: usize) -> f64 {
        (self.sum[j] / self.count as f64).sqrt()
    }

    /// Over all of `dof` joints.
    pub(crate) fn rms_all(&self, dof: usize) -> f64 {
        (self.sum[..dof].iter().sum::<f64>() / (dof as f64 * self.count as f64)).sqrt()
    }
}

/// Pairs setpoints with samples and adds up their difference phase by phase.
pub(crate) struct Tracking {
    pub(crate) dof: usize,
    /// Samples of each phase that is measured, and the difference in it.
    phases: Vec<(Range<u64>, Square)>,
    /// Of the last second.
    pub(crate) now: Square,
    pending: VecDeque<Setpoint>,
}

/// Samples after which [`Tracking::now`] starts anew.
const RECENT: u64 = 1000;

/// Setpoints that may wait for their sample.
const PENDING: usize = 4096;

impl Tracking {
    /// `phases`: samples that are measured, a range each.
    pub(crate) fn new(dof: usize, phases: Vec<Range<u64>>) -> Tracking {
        let phases = phases.into_iter().map(|samples| (samples, Square::default())).collect();
        Tracking { dof, phases, now: Square::default(), pending: VecDeque::new() }
    }

    /// Root mean square of joint `j` in a phase \[rad\]; not a number where there was none.
    pub(crate) fn rms(&self, phase: usize, j: usize) -> f64 {
        self.phases.get(phase).map_or(f64::NAN, |(_, square)| square.rms(j))
    }

    /// The same over all joints.
    pub(crate) fn rms_all(&self, phase: usize) -> f64 {
        self.phases.get(phase).map_or(f64::NAN, |(_, square)| square.rms_all(self.dof))
    }

    pub(crate) fn setpoint(&mut self, setpoint: &Setpoint) {
        if self.pending.len() < PENDING {
            self.pending.push_back(*setpoint);
        }
    }

    pub(crate) fn state(&mut self, state: &JointState) {
        while self.pending.front().is_some_and(|setpoint| setpoint.seq < state.seq) {
            self.pending.pop_front();
        }
        let Some(setpoint) = self.pending.front().filter(|setpoint| setpoint.seq == state.seq) else {
            return;
        };
        for (samples, square) in &mut self.phases {
            if samples.contains(&state.seq) {
                square.add(&setpoint.q, &state.q);
            }
        }
        if state.seq.is_multiple_of(RECENT) {
            self.now = Square::default();
        }
        self.now.add(&setpoint.q, &state.q);
    }
}
