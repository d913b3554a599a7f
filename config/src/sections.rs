//! The sections of a robot file as checked values.

pub(crate) mod read;

use std::path::PathBuf;

use rivet_dynamics::{Joints, KnownEffect, UrdfOptions};
use rivet_estimation::{
    Differentiator, EstimatorKind, Filtering, Instruments, Prior, ReferenceWorkload, Settings, Supervision, Window,
};

use crate::reader::Resolved;

/// A robot file, checked. Per-joint vectors have one entry per joint of the URDF, base to flange.
#[derive(Clone, Debug)]
pub struct RobotConfig {
    /// The file this was read from.
    pub path: PathBuf,
    /// Robot's name, part of every service name.
    pub name: String,
    /// The URDF, resolved against the robot file's directory.
    pub urdf: PathBuf,
    /// `[model]`: how the URDF becomes a chain.
    pub urdf_options: UrdfOptions,
    /// Time between samples \[s\].
    pub sample_period_s: f64,
    /// Gravity in base axes \[m/s²\].
    pub gravity: [f64; 3],
    /// `[drive]`
    pub drive: Drive,
    /// `[friction]`
    pub friction: Friction,
    /// `[coupling]`, for arms with a coupled wrist.
    pub coupling: Option<Coupling>,
    /// `[effects.<name>]`, also part of the model.
    pub effects: Vec<KnownEffect>,
    /// `[log]`
    pub log: Log,
    /// `[signal]`
    pub signal: Signal,
    /// `[estimator]`
    pub estimator: Estimator,
    /// `[supervision]`
    pub supervision: Supervision,
    /// `supervision.workload`
    pub workload: ReferenceWorkload,
    /// `[publish]`
    pub publish: Publish,
    /// `[realtime]`
    pub realtime: Realtime,
    /// `[controller]`
    pub controller: Controller,
    /// `[simulation]`
    pub simulation: Simulation,
    /// `[bus]`
    pub bus: Bus,
    /// Every key with its value and where it came from, in the order of reading.
    pub resolved: Vec<Resolved>,
}

impl RobotConfig {
    /// Nominal drive values, friction and coupling, as [`Model::nominal`](rivet_dynamics::Model::nominal) takes them.
    pub fn nominal_joints(&self) -> Joints {
        Joints {
            rotor_inertia: self.drive.rotor_inertia.clone(),
            viscous: self.friction.viscous.clone(),
            coulomb: self.friction.coulomb.clone(),
            offset: self.friction.offset.clone(),
            load_friction: self.friction.load_dependent.clone().unwrap_or_default(),
            viscous_quadratic: self.friction.viscous_quadratic.clone().unwrap_or_default(),
            coupling: self.coupling.as_ref().map_or([0.0; 3], |c| [c.rotor_inertia, c.viscous, c.coulomb]),
        }
    }

    /// The settings of the estimator, as the sections `[signal]`, `[estimator]` and `[supervision]` say.
    pub fn estimation_settings(&self) -> Settings {
        Settings {
            sample_period_s: self.sample_period_s,
            differentiator: self.signal.differentiator,
            filtering: self.signal.filtering,
            filter_hz: self.signal.model_filter_hz,
            filter_order: self.signal.model_filter_order,
            decimation: self.signal.decimation,
            dead_zone: self.signal.dead_zone.clone(),
            torque_noise: self.signal.torque_noise.clone(),
            estimator: self.estimator.kind,
            energy_span_s: self.estimator.energy_span_s,
            window: match (self.estimator.window_s, self.estimator.window_deviation) {
                (None, _) => Window::None,
                (Some(seconds), None) => Window::Exponential { seconds },
                (Some(shortest_s), Some(deviation)) => Window::ConstantTrace { shortest_s, deviation },
            },
            instruments: self.estimator.instruments,
            supervision: self.supervision,
            workload: self.workload,
            prior: Prior { relative_std: self.estimator.prior },
        }
    }
}

/// `[drive]`: joint side of the gear.
#[derive(Clone, Debug, PartialEq)]
pub struct Drive {
    /// Motor angle over joint angle, signed.
    pub gear_ratio: Vec<f64>,
    /// Reflected rotor inertia J_m·N² \[kg m²\].
    pub rotor_inertia: Vec<f64>,
    /// Largest torque \[N m\].
    pub torque_limit: Vec<f64>,
    /// Largest speed \[rad/s, or m/s\]; `None` where that of the description holds.
    pub velocity_limit: Option<Vec<f64>>,
    /// Smallest position step \[rad\]; 0 is not quantised.
    pub encoder_resolution: Vec<f64>,
    /// Torque per ampere \[N m/A\], where logs carry currents.
    pub drive_gain: Option<Vec<f64>>,
}

/// `[friction]`: nominal values.
#[derive(Clone, Debug, PartialEq)]
pub struct Friction {
    /// Coulomb friction \[N m\].
    pub coulomb: Vec<f64>,
    /// Viscous friction \[N m s/rad\].
    pub viscous: Vec<f64>,
    /// Constant torque \[N m\].
    pub offset: Vec<f64>,
    /// Coulomb friction per carried torque \[-\]; `None` leaves the term out of the model.
    pub load_dependent: Option<Vec<f64>>,
    /// Friction with the square of the speed \[N m s²/rad²\]; `None` leaves the term out of the model.
    pub viscous_quadratic: Option<Vec<f64>>,
    /// Travel in which friction builds up after a reversal \[rad\]; 0 is friction without memory.
    pub presliding_travel: f64,
    /// URDF whose bodies make the carried torque, resolved; `None` is the robot's own.
    pub load_urdf: Option<PathBuf>,
}

/// `[coupling]`: the motor of `driven` turns with q_driving + q_driven.
#[derive(Clone, Debug, PartialEq)]
pub struct Coupling {
    /// Joint index, from 0.
    pub driving: usize,
    /// Joint index, from 0.
    pub driven: usize,
    /// Ia_m \[kg m²\].
    pub rotor_inertia: f64,
    /// Fv_m \[N m s/rad\].
    pub viscous: f64,
    /// Fc_m \[N m\].
    pub coulomb: f64,
}

/// What the torque of log files is (`[log] torque_is`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TorqueMeaning {
    /// What physics says of the log.
    #[default]
    Auto,
    /// All of the drive's torque.
    Torque,
    /// The drive's torque without that of gravity.
    GravityFree,
}

/// `[log]`
#[derive(Clone, Debug, PartialEq)]
pub struct Log {
    /// Added to the position columns of log files \[rad\].
    pub joint_zero: Vec<f64>,
    /// Torque is drive gain times current, even where a log has torque columns.
    pub torque_from_current: bool,
    /// What the torque of log files is.
    pub torque_is: TorqueMeaning,
    /// Channels that are stated, by quantity: `time`, `q`, `tau`, `current`, `q_des`, `temperature`.
    pub channels: Vec<LogChannel>,
}

/// Which columns of a recording are a quantity, and how their numbers become SI values: `sign * scale * unit(number) + zero`.
#[derive(Clone, Debug, PartialEq)]
pub struct LogChannel {
    /// The quantity.
    pub key: &'static str,
    /// Its columns, as a pattern of their names.
    pub pattern: Option<String>,
    /// Its unit.
    pub unit: Option<String>,
    /// 1 or -1, one a joint.
    pub sign: Option<Vec<f64>>,
    /// Factor, one a joint.
    pub scale: Option<Vec<f64>>,
    /// Added last, in the SI unit, one a joint.
    pub zero: Option<Vec<f64>>,
}

/// `[signal]`
#[derive(Clone, Debug, PartialEq)]
pub struct Signal {
    /// How velocity and acceleration come from positions.
    pub differentiator: Differentiator,
    /// What the low-pass is applied to.
    pub filtering: Filtering,
    /// Cut-off of the model filter \[Hz\].
    pub model_filter_hz: f64,
    /// Order of the model filter, even.
    pub model_filter_order: usize,
    /// Samples per estimator update.
    pub decimation: usize,
    /// v0 of tanh(qd/v0) \[rad/s\]; 0 is a hard sign.
    pub friction_velocity: f64,
    /// A joint's equation is left out below this speed \[rad/s\].
    pub dead_zone: Vec<f64>,
    /// Standard deviation of the filtered torque residual \[N m\]; `None` is estimated while running.
    pub torque_noise: Option<Vec<f64>>,
}

/// `[estimator]`
#[derive(Clone, Debug, PartialEq)]
pub struct Estimator {
    /// Which estimator.
    pub kind: EstimatorKind,
    /// Time that an energy row covers \[s\]; 0 counts from the start.
    pub energy_span_s: f64,
    /// Whether a constant torque per joint is identified.
    pub offsets: bool,
    /// Time constant of the exponential window, or the shortest of one of constant trace \[s\]; `None` never forgets.
    pub window_s: Option<f64>,
    /// With a window of constant trace: what it keeps \[torque-noise sigma\].
    pub window_deviation: Option<f64>,
    /// Where instruments come from.
    pub instruments: Instruments,
    /// Relative standard deviation of the nominal parameters.
    pub prior: f64,
}

/// `[publish]`
#[derive(Clone, Debug, PartialEq)]
pub struct Publish {
    /// Samples between parameter messages.
    pub every: usize,
    /// Projections onto a consistent arm per second; 0 switches them off.
    pub consistent_hz: f64,
    /// Samples between health messages.
    pub health_every: usize,
}

/// `[realtime] trigger`
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trigger {
    /// Absolute timer.
    Timer,
    /// Arrival of a sample.
    Sample,
}

/// `[realtime] overrun`
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Overrun {
    /// Periods that have passed are left out.
    Skip,
    /// Periods that have passed are run at once.
    CatchUp,
}

/// `[realtime] scheduler`
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scheduler {
    /// SCHED_FIFO.
    Fifo,
    /// SCHED_DEADLINE.
    Deadline,
}

/// `[realtime]`
#[derive(Clone, Debug, PartialEq)]
pub struct Realtime {
    /// What starts a period.
    pub trigger: Trigger,
    /// What becomes of periods that have passed.
    pub overrun: Overrun,
    /// Which real-time scheduler.
    pub scheduler: Scheduler,
    /// Share of the sample period that SCHED_DEADLINE grants.
    pub deadline_share: f64,
    /// SCHED_FIFO priority; `None` leaves the scheduler alone.
    pub priority: Option<u8>,
    /// Processor of the thread; `None` lets the system choose.
    pub cpu: Option<usize>,
    /// Lock all memory.
    pub lock_memory: bool,
    /// Refuse to start without the above.
    pub required: bool,
    /// Most queued samples taken in one period.
    pub catch_up: usize,
    /// Periods without a sample until the input counts as stale.
    pub stale_periods: usize,
}

/// `[controller] law`
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Law {
    /// Feedback linearisation: feedback acts through the inertia matrix.
    ComputedTorque,
    /// Feed-forward of the planned motion with constant PD gains.
    FeedForwardPd,
}

/// `[controller] stop_reaction`
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopReaction {
    /// The torque that holds the last known pose.
    Hold,
    /// The last torque, going to zero.
    Ramp,
    /// The torque that brakes the last known motion, then holds.
    Damp,
}

/// `[controller]`
#[derive(Clone, Debug, PartialEq)]
pub struct Controller {
    /// Which control law.
    pub law: Law,
    /// Bandwidth of the closed position loop \[Hz\].
    pub bandwidth_hz: Vec<f64>,
    /// Damping ratio.
    pub damping: f64,
    /// Corner of the integral action \[Hz\]; 0 switches it off.
    pub integral_hz: f64,
    /// Cut-off of the velocity's low-pass \[Hz\].
    pub velocity_filter_hz: f64,
    /// Fastest change of the torque \[N m/s\].
    pub rate_limit: Option<Vec<f64>>,
    /// Periods without a sample until the stop reaction, and without a setpoint until the arm is held.
    pub stale_periods: usize,
    /// What happens when joint states stop.
    pub stop_reaction: StopReaction,
    /// How long ramp and damp take \[s\].
    pub stop_time_s: f64,
    /// Valid samples in a row after which a stopped arm follows its plan again; 0: only on request.
    pub resume_after: usize,
    /// Largest distance of each joint from its plan \[rad, or m\].
    pub tracking_error: Vec<f64>,
    /// Longest time for which a commanded torque may be at its limit \[ms\].
    pub saturation_ms: f64,
    /// Largest torque on each joint of loads and contacts that the model does not have, as a share of the torque limit.
    pub unmodelled_torque: Vec<f64>,
    /// Largest change of the present torque by a new parameter set, as a share of the torque limit.
    pub torque_change: f64,
    /// Without an acceptable parameter set for this long, published parameters give way to the last good ones \[s\].
    pub parameter_timeout_s: f64,
    /// Acceptable sets in a row after which published parameters act again.
    pub return_after: usize,
}

/// `[simulation]`
#[derive(Clone, Debug, PartialEq)]
pub struct Simulation {
    /// Standard deviation of the published torque's noise \[N m\].
    pub torque_noise: Vec<f64>,
    /// Standard deviation of the position's noise \[rad\], before it is quantised.
    pub position_noise: Vec<f64>,
    /// Seed of the noise.
    pub seed: u64,
}

/// `[bus]`
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Bus {
    /// Beginning of every shared-memory name.
    pub prefix: String,
    /// Directory of the management files.
    pub root: PathBuf,
}
