//! Plant, trajectory and control law in one loop, without processes: what tests of estimators and controllers drive.

use crate::mechanics::Vector;
use crate::motion::Trajectory;
use crate::plant::Plant;
use crate::sensors::Measurement;
use rivet_dynamics::MAX_JOINTS;

/// The motion planned for one period.
#[derive(Clone, Copy, Debug)]
pub struct SetpointRef<'a> {
    /// Positions \[rad\].
    pub q: &'a [f64],
    /// Velocities \[rad/s\].
    pub qd: &'a [f64],
    /// Accelerations \[rad/s²\].
    pub qdd: &'a [f64],
}

/// One period as measured and as it really was.
#[derive(Clone, Copy, Debug)]
pub struct Record<'a> {
    /// What the controller got.
    pub measured: &'a Measurement,
    /// What it was to do.
    pub setpoint: SetpointRef<'a>,
    /// True positions at the latch \[rad\].
    pub q: &'a [f64],
    /// True velocities \[rad/s\].
    pub qd: &'a [f64],
    /// True accelerations under `tau` \[rad/s²\].
    pub qdd: &'a [f64],
    /// Torque in force at the latch \[N·m\].
    pub tau: &'a [f64],
}

/// Runs `samples` periods. `control` writes the command for the measurement and setpoint it is given; `record` sees each
/// period after the command was computed and before it acts. Place the plant at the trajectory's start first.
pub fn closed_loop(
    plant: &mut Plant,
    trajectory: &dyn Trajectory,
    mut control: impl FnMut(&Measurement, &SetpointRef<'_>, &mut [f64]),
    samples: usize,
    mut record: impl FnMut(&Record<'_>),
) {
    let n = plant.dof();
    let (mut q, mut qd, mut qdd): (Vector, Vector, Vector) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
    let mut command = [0.0; MAX_JOINTS];
    let start_s = plant.time_s();
    for _ in 0..samples {
        trajectory.sample(plant.time_s() - start_s, &mut q[..n], &mut qd[..n], &mut qdd[..n]);
        let setpoint = SetpointRef { q: &q[..n], qd: &qd[..n], qdd: &qdd[..n] };
        let measured = plant.measure();
        control(&measured, &setpoint, &mut command[..n]);
        let acceleration = plant.qdd();
        record(&Record {
            measured: &measured,
            setpoint,
            q: plant.q(),
            qd: plant.qd(),
            qdd: &acceleration[..n],
            tau: plant.applied(),
        });
        plant.step(&command[..n]);
    }
}
