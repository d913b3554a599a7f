//! What an arm is to do in one period.

use rivet_dynamics::MAX_JOINTS;

/// A desired state: positions \[rad\], velocities \[rad/s\] and accelerations \[rad/s²\], one entry a joint.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Desired {
    /// Desired positions.
    pub q: [f64; MAX_JOINTS],
    /// Desired velocities.
    pub qd: [f64; MAX_JOINTS],
    /// Desired accelerations.
    pub qdd: [f64; MAX_JOINTS],
}
