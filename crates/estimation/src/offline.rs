//! Identification from whole records: zero-phase model filter, λ = 1, least squares and instrumental variables.
//!
//! The equations are those of the on-line estimator (same regressor, same filter over every column of regressor,
//! instruments and torque); knowing the whole record, they are filtered forwards and backwards, so that nothing lags,
//! and solved at once. Every record keeps its own edges; records are never joined.
//!
//! ```text
//! D_j x = τ_j + e_j                        rows of joint j, filtered and thinned out
//! LS:  x = (Σ w DᵀD + P⁻¹)⁻¹ (Σ w Dᵀτ + P⁻¹ x₀)
//! IV:  x = (Σ w ZᵀD + P⁻¹)⁻¹ (Σ w Zᵀτ + P⁻¹ x₀)      Z: the regressor on motion without the position noise
//! ```
//!
//! w: one over the variance of what an independent row of the joint leaves; rows beside a stop count less where friction sticks.
//! P is the weak prior around the nominal parameters x₀: it decides only what the motion leaves open.

mod bias;
mod constant;
mod covariance;
mod delay;
mod fit;
mod glitches;
mod held;
mod lag;
mod parts;
mod pass;
mod record;
mod rows;
mod sense;
mod setpoint;
mod shifts;
mod smoothing;
mod steps;
mod sums;
mod trust;
mod undetermined;
mod zero_phase;

pub use bias::{Bias, bias};
pub use constant::{Constant, constant_torque};
pub use delay::{Delay, DelayDoubt, torque_delay};
pub use fit::{Determined, Fit, Method, fit, residual_percent, residual_squares, solve, torque_percent};
pub use glitches::{Jumps, MOST_LEFT_OUT, Reach, beyond, dropouts, unwrap};
pub use lag::Lag;
pub use parts::{Cut, Parts, parts};
pub use record::{OfflineError, Record, Trajectory, predict};
pub use rows::{InstrumentSource, OfflineSettings, Rows, moving_range};
pub use sense::{TorqueSense, friction_share, giving_friction, one_way, torque_sense};
pub use setpoint::{underived, unfollowed};
pub use shifts::REACH_S;
pub use smoothing::{Smoothing, predict_smoothed};
pub use steps::{position_noise, position_step, told_up_to_hz, white_noise, white_noise_without};
pub use sums::{Equations, brief};
pub use zero_phase::ZeroPhase;
