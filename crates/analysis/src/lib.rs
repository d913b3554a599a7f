//! Analyses of whole logs: what the command line and the Python package compute.
//!
//! | function | result |
//! |---|---|
//! | [`identify::identify`] | base parameters with standard deviations |
//! | [`diagnose::diagnose`] | causes of the gap between nominal model and arm |
//! | [`predict::predict`] | torque along a log |
//! | [`convert::convert`] | a recording in another format |
//! | [`inspect::inspect`] | what a recording holds, and how it would be read |
//! | [`robot_file::robot_file`] | a robot file from a URDF and logs |
//!
//! Each result has its report as text and as JSON. Notes and progress go to the [`session`] of the thread.

mod bodies;
mod bounds;
pub mod channels;
mod clock;
pub mod coarse;
mod compare;
pub mod convert;
mod delays;
pub mod diagnose;
pub mod doubts;
pub mod evidence;
mod export;
pub mod fault;
mod fit;
mod frozen;
mod glitches;
pub mod gravity_free;
pub mod identify;
pub mod inspect;
mod jitter;
pub mod kinematics;
mod left_out;
pub mod map;
mod mesh_paths;
mod mujoco_forces;
mod not_excited;
pub mod open_keys;
pub mod passport;
mod patched;
pub mod predict;
pub mod progress;
mod publishers;
pub mod reading;
pub mod refine;
pub mod robot_file;
pub mod robot_json;
mod rollout;
mod rounding;
mod rows;
pub mod runs;
mod self_check;
pub mod session;
pub mod sound;
mod stairs;
mod steps;
pub mod table;
pub mod true_values;
