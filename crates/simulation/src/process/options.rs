//! What the user of `rivet-sim` may choose.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use clap::{Args, Parser as _, ValueEnum};

use super::SimError;
use crate::friction::FrictionLaw;
use crate::motion::{
    Fourier, FourierSettings, MotionLimits, PaperMotion, PointToPoint, PointToPointSettings, Recorded, Standstill,
    Trajectory, load_ratio,
};
use crate::plant::PlantSettings;
use crate::sensors::Sensors;
use crate::truth::{Disturbances, Payload};
use rivet_config::Robot;
use rivet_dynamics::Joints;
use rivet_logs::ReadOptions;

/// Motions of the setpoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum MotionKind {
    /// Fourier series of all joints
    Fourier,
    /// Quintic moves between random poses, with dwells
    PointToPoint,
    /// 0.8 Hz on joint 1 and 1.1 Hz on joint 2, the others still
    Paper,
    /// Fourier series of one joint (--joint), the others still
    SingleJoint,
    /// No motion
    Standstill,
}

/// Options of `rivet-sim` and `rivet sim`.
#[derive(Clone, Debug, Args)]
pub struct Options {
    /// Robot file
    pub robot: PathBuf,
    /// Prefix of the bus, instead of the robot file's
    #[arg(long)]
    pub prefix: Option<String>,
    /// Root directory of the bus, instead of the robot file's
    #[arg(long)]
    pub root: Option<PathBuf>,

    /// Seconds of motion, counted from the opening of the brakes; without it until the end of --setpoints, SIGINT or SIGTERM
    #[arg(long, value_name = "S", value_parser = positive)]
    pub duration: Option<f64>,
    /// Seconds to wait for the first command before giving up; 0 waits for ever
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = not_negative)]
    pub patience: f64,
    /// Simulated time waits up to this long for the command that answers the last sample (ms); without it time goes on
    #[arg(long, value_name = "MS", value_parser = positive)]
    pub lockstep: Option<f64>,
    /// With --lockstep: go on as soon as the answer is there instead of keeping the sample rate
    #[arg(long, requires = "lockstep")]
    pub unpaced: bool,
    /// Periods without a command after which the brakes close; they open after 0.2 s of commands
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..))]
    pub stale_periods: u64,

    /// Seed of noise, motion and drawn disturbances; the robot file's without it
    #[arg(long)]
    pub seed: Option<u64>,
    /// Motion of the setpoint
    #[arg(long, value_enum, default_value_t = MotionKind::Fourier)]
    pub motion: MotionKind,
    /// Setpoints to follow instead of a motion: a log with q_des, qd_des and qdd_des, such as `rivet diagnose --export` writes
    #[arg(long, value_name = "FILE", conflicts_with = "motion")]
    pub setpoints: Option<PathBuf>,
    /// The joint that moves in single-joint motion, from 1
    #[arg(long, default_value_t = 1)]
    pub joint: usize,
    /// Share of the arm's speed limits that the motion may use, 0..1
    #[arg(long, value_name = "SHARE", default_value_t = 0.8, value_parser = share)]
    pub velocity: f64,
    /// Base frequency of the Fourier series (Hz)
    #[arg(long, value_name = "HZ", default_value_t = FourierSettings::default().base_hz, value_parser = positive)]
    pub base_hz: f64,
    /// Harmonics of the Fourier series
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..=100))]
    pub harmonics: u64,

    /// Factor on mass, first moment and inertia of every true body
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = positive)]
    pub bodies: f64,
    /// Factor on every true rotor inertia
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = not_negative)]
    pub rotor_inertia: f64,
    /// Factor on all true friction
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = not_negative)]
    pub friction: f64,
    /// Relative spread of a further random factor for each body
    #[arg(long, value_name = "STD", default_value_t = 0.0, value_parser = not_negative)]
    pub bodies_spread: f64,
    /// Relative spread of a further random factor for each rotor inertia
    #[arg(long, value_name = "STD", default_value_t = 0.0, value_parser = not_negative)]
    pub rotor_inertia_spread: f64,
    /// Relative spread of a further random factor for each friction value
    #[arg(long, value_name = "STD", default_value_t = 0.0, value_parser = not_negative)]
    pub friction_spread: f64,
    /// Mass carried by the last link (kg)
    #[arg(long, value_name = "KG", value_parser = positive)]
    pub payload: Option<f64>,
    /// Centre of the payload in the frame of the last joint (m)
    #[arg(long, value_name = "X,Y,Z", default_value = "0,0,0.1", value_parser = point, allow_hyphen_values = true)]
    pub payload_com: [f64; 3],
    /// Factor on the measurement noise of the robot file; 0 switches it off (encoders still count whole steps)
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = not_negative)]
    pub noise: f64,
    /// Friction as tanh(v/V) with this V (rad/s), instead of Coulomb's law with exact sticking
    #[arg(long, value_name = "V", value_parser = positive)]
    pub friction_velocity: Option<f64>,

    /// Writes the true parameters to this file (JSON)
    #[arg(long, value_name = "FILE")]
    pub truth_out: Option<PathBuf>,
    /// Writes what was published while the arm moved to this file (CSV)
    #[arg(long, value_name = "FILE")]
    pub log_out: Option<PathBuf>,
    /// Writes the summary to this file (JSON)
    #[arg(long, value_name = "FILE")]
    pub summary_out: Option<PathBuf>,
    /// Ends when the process that started this one does
    #[arg(long, hide = true)]
    pub die_with_parent: bool,
}

fn number(text: &str, rule: &str, fits: impl Fn(f64) -> bool) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "must be a number".to_owned())?;
    if value.is_finite() && fits(value) { Ok(value) } else { Err(rule.to_owned()) }
}

fn positive(text: &str) -> Result<f64, String> {
    number(text, "must be above 0", |x| x > 0.0)
}

fn not_negative(text: &str) -> Result<f64, String> {
    number(text, "must not be negative", |x| x >= 0.0)
}

fn share(text: &str) -> Result<f64, String> {
    number(text, "must lie above 0 and at most at 1", |x| x > 0.0 && x <= 1.0)
}

fn point(text: &str) -> Result<[f64; 3], String> {
    let values: Result<Vec<f64>, String> =
        text.split(',').map(|x| number(x.trim(), "must be finite", |_| true)).collect();
    values?.try_into().map_err(|v: Vec<f64>| format!("must be three numbers with commas between them, not {}", v.len()))
}

/// Nominal drive values of a robot file.
pub fn nominal_joints(robot: &Robot) -> Joints {
    robot.config.nominal_joints()
}

/// A command line of these options.
#[derive(clap::Parser)]
struct Line {
    #[command(flatten)]
    options: Options,
}

impl Options {
    /// The options of a command line that only names the robot file.
    pub fn new(robot: &Path) -> Options {
        Line::parse_from([OsStr::new("rivet-sim"), OsStr::new("--"), robot.as_os_str()]).options
    }

    /// The seed in force.
    pub fn seed(&self, robot: &Robot) -> u64 {
        self.seed.unwrap_or(robot.config.simulation.seed)
    }

    pub(super) fn disturbances(&self, robot: &Robot) -> Disturbances {
        Disturbances {
            bodies: self.bodies,
            rotor_inertia: self.rotor_inertia,
            friction: self.friction,
            bodies_spread: self.bodies_spread,
            rotor_inertia_spread: self.rotor_inertia_spread,
            friction_spread: self.friction_spread,
            payload: self.payload.map(|mass| Payload { mass, com: self.payload_com }),
            seed: self.seed(robot),
        }
    }

    pub(super) fn sensors(&self, robot: &Robot) -> Sensors {
        let simulation = &robot.config.simulation;
        Sensors {
            resolution: robot.config.drive.encoder_resolution.clone(),
            position_noise: simulation.position_noise.clone(),
            torque_noise: simulation.torque_noise.clone(),
        }
        .with_noise(self.noise)
    }

    pub(super) fn plant(&self, robot: &Robot) -> PlantSettings {
        let mut settings = PlantSettings::new(robot.config.sample_period_s, &robot.config.drive.torque_limit);
        if let Some(velocity) = self.friction_velocity {
            settings.friction = FrictionLaw::Smooth { velocity };
        }
        settings
    }

    /// The motion, made for the nominal arm: the planner does not know the true one.
    ///
    /// # Errors
    /// If the file of setpoints cannot be read or has not all of them.
    pub fn trajectory(&self, robot: &Robot) -> Result<Box<dyn Trajectory>, SimError> {
        if let Some(path) = &self.setpoints {
            return Ok(Box::new(recorded(robot, path)?));
        }
        let limits = MotionLimits::of(&robot.model.arm, self.velocity);
        let mut load = load_ratio(&robot.model, &robot.nominal, &robot.config.drive.torque_limit);
        let fourier = FourierSettings {
            base_hz: self.base_hz,
            harmonics: self.harmonics as usize,
            seed: self.seed(robot),
            only: (self.motion == MotionKind::SingleJoint).then(|| self.joint - 1),
            ..FourierSettings::default()
        };
        let made: Box<dyn Trajectory> = match self.motion {
            MotionKind::Fourier | MotionKind::SingleJoint => Box::new(Fourier::new(&limits, &fourier, &mut load)),
            MotionKind::PointToPoint => {
                let settings = PointToPointSettings { seed: self.seed(robot), ..PointToPointSettings::default() };
                Box::new(PointToPoint::new(&limits, &settings, &mut load))
            }
            MotionKind::Paper => Box::new(PaperMotion::new(&limits, &mut load)),
            MotionKind::Standstill => Box::new(Standstill { pose: limits.home }),
        };
        Ok(made)
    }
}

fn recorded(robot: &Robot, path: &Path) -> Result<Recorded, SimError> {
    let options = ReadOptions { joint_zero: Some(&robot.config.log.joint_zero), ..ReadOptions::new(robot.dof()) };
    let refuse = |why: String| SimError::Option(format!("--setpoints {}: {why}", path.display()));
    let log = rivet_logs::read(path, &options).map_err(|why| refuse(why.to_string()))?;
    let (log, _) = log.resample(robot.config.sample_period_s).map_err(|why| refuse(why.to_string()))?;
    match (log.q_des, log.qd_des, log.qdd_des) {
        (Some(q), Some(qd), Some(qdd)) => Ok(Recorded { period_s: robot.config.sample_period_s, q, qd, qdd }),
        _ => Err(refuse("needs columns q_des, qd_des and qdd_des of every joint".to_owned())),
    }
}
