//! Who looks on while a sample is worked at: when each part is done, and whether a row may be learnt from.

use rivet_dynamics::MAX_JOINTS;

/// A part of the work on one sample, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Velocities and accelerations.
    Differentiate,
    /// Regressors, instruments, model filter.
    Model,
    /// Sums of the window, least squares, residuals.
    Estimate,
    /// What may move, the solution, standard deviations.
    Supervise,
}

/// One row a joint, before it is learnt from. Entries beyond the joints are zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Measured torque after the model filter \[N·m\].
    pub tau: [f64; MAX_JOINTS],
    /// What the values of now make of the motion \[N·m\].
    pub predicted: [f64; MAX_JOINTS],
    /// What the nominal values make of it \[N·m\]: those that the estimator began with.
    pub accepted: [f64; MAX_JOINTS],
    /// Speed and acceleration, newer than the row by what the model filter lags \[rad/s, rad/s²\].
    pub speed: [f64; MAX_JOINTS],
    /// See [`speed`](Self::speed).
    pub accel: [f64; MAX_JOINTS],
    /// Whether the joint moved.
    pub moving: [bool; MAX_JOINTS],
}

/// Looks on. The estimator has no clock: an observer may have one, and what the estimator does never depends on it, except
/// that a row which is not admitted is not learnt from.
pub trait Observer {
    /// A part of the work is done.
    fn done(&mut self, _phase: Phase) {}

    /// Whether the row may be learnt from. Must be a function of the samples so far, or replays differ.
    fn admits(&mut self, _row: &Row) -> bool {
        true
    }
}

/// Nobody looks on; costs nothing.
impl Observer for () {}
