//! Tracking error by phase, from what the bus carries.

use rivet_ipc_schema::{JointState, MAX_JOINTS, Setpoint};
use std::collections::VecDeque;
use std::ops::Range;

/// Mean square of desired minus measured position \[rad²\].
#[derive(Clone, Debug, Default)]
pub struct Square {
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
    pub fn rms(&self, j: usize) -> f64 {
        (self.sum[j] / self.count as f64).sqrt()
    }

    /// Root mean square over all of `dof` joints \[rad\]; not a number before the first sample.
    pub fn rms_all(&self, dof: usize) -> f64 {
        (self.sum[..dof].iter().sum::<f64>() / (dof as f64 * self.count as f64)).sqrt()
    }
}

/// Pairs setpoints with samples and adds up their difference phase by phase.
pub struct Tracking {
    /// Number of joints.
    pub dof: usize,
    /// Samples of each phase that is measured, and the difference in it.
    phases: Vec<(Range<u64>, Square)>,
    /// Of the last second.
    pub now: Square,
    pending: VecDeque<Setpoint>,
}

/// Samples after which [`Tracking::now`] starts anew.
const RECENT: u64 = 1000;

/// Setpoints that may wait for their sample.
const PENDING: usize = 4096;

impl Tracking {
    /// `phases`: samples that are measured, a range each.
    pub fn new(dof: usize, phases: Vec<Range<u64>>) -> Tracking {
        let phases = phases.into_iter().map(|samples| (samples, Square::default())).collect();
        Tracking { dof, phases, now: Square::default(), pending: VecDeque::new() }
    }

    /// Root mean square of joint `j` in a phase \[rad\]; not a number where there was none.
    pub fn rms(&self, phase: usize, j: usize) -> f64 {
        self.phases.get(phase).map_or(f64::NAN, |(_, square)| square.rms(j))
    }

    /// Root mean square over all joints in a phase \[rad\]; not a number where there was none.
    pub fn rms_all(&self, phase: usize) -> f64 {
        self.phases.get(phase).map_or(f64::NAN, |(_, square)| square.rms_all(self.dof))
    }

    /// Takes what is desired; it waits for its sample.
    pub fn setpoint(&mut self, setpoint: &Setpoint) {
        if self.pending.len() < PENDING {
            self.pending.push_back(*setpoint);
        }
    }

    /// Takes a sample, and adds the difference to its setpoint where that has come.
    pub fn state(&mut self, state: &JointState) {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn adds_the_difference_of_setpoint_and_sample_in_its_phase() {
        let mut tracking = Tracking::new(2, vec![1..3, 3..5]);
        for (seq, error) in [(1, 0.1), (2, 0.1), (3, 0.5), (4, 0.5), (9, 7.0)] {
            let mut setpoint = Setpoint { seq, ..Setpoint::default() };
            setpoint.q[0] = error;
            // A setpoint whose sample never comes is passed over.
            tracking.setpoint(&Setpoint { seq: seq - 1, ..setpoint });
            tracking.setpoint(&setpoint);
            tracking.state(&JointState { seq, ..JointState::default() });
        }
        assert!((tracking.rms(0, 0) - 0.1).abs() < 1e-12 && (tracking.rms(1, 0) - 0.5).abs() < 1e-12);
        assert!((tracking.rms_all(1) - 0.5 / 2_f64.sqrt()).abs() < 1e-12);
        assert!(tracking.rms(2, 0).is_nan());
    }
}
