//! Logs of robots: recordings of many formats in (Parquet, MCAP, rosbag2, LeRobot, text tables), uniform records out.
//!
//! A log is one row a sample. Columns (N joints, counted from 1):
//!
//! | column | unit | |
//! |---|---|---|
//! | `t` | s | increasing; any origin |
//! | `q1..N` | rad | measured joint position |
//! | `tau1..N` | N m | measured torque at the joint side of the gear |
//! | `current1..N` | A | motor current; gives `tau` when there is none and the drive gain \[N m/A\] is known |
//! | `qd1..N` | rad/s | optional: measured velocity |
//! | `q_des1..N`, `qd_des1..N`, `qdd_des1..N` | rad, rad/s, rad/s² | optional: commanded motion |
//! | `temperature1..N` | degC | optional |
//! | `q_link1..N` | rad | optional, joint by joint: encoder on the load side |
//!
//! Other columns are left alone and listed, and so are optional ones in which no cell is filled. Positions of a log become positions of the model by adding the robot file's
//! `joint_zero`.
//!
//! ```
//! use rivet_logs::{ReadOptions, read, write_columns};
//! let file = std::env::temp_dir().join(format!("rivet-logs-doc-{}.parquet", std::process::id()));
//! let t: Vec<f64> = (0..100).map(|k| 0.01 * f64::from(k)).collect();
//! let q: Vec<f64> = t.iter().map(|t| t.sin()).collect();
//! write_columns(&file, &[("t", &t), ("q1", &q), ("tau1", &q)])?;
//! let log = read(&file, &ReadOptions::new(1))?;
//! let (uniform, report) = log.resample(0.005)?;
//! assert_eq!(uniform.len(), 199);
//! assert!((report.mean_rate_hz - 100.0).abs() < 1e-9);
//! # std::fs::remove_file(&file).ok();
//! # Ok::<(), rivet_logs::LogError>(())
//! ```

mod arrays;
mod channel_map;
mod clock;
mod columns;
mod crowded;
mod csv_dialect;
mod csv_file;
mod damaged;
mod episodes;
mod error;
mod families;
mod frozen;
mod guess;
mod hdf5_file;
mod holds;
mod joint_state;
mod lerobot;
mod listing;
mod log;
mod lzf;
mod mcap_file;
mod messages;
mod npy;
mod npz_file;
mod numbers;
mod overlap;
mod own_recording;
mod parquet_file;
mod parquet_limits;
mod plan;
mod readers;
mod resample;
mod rosbag2;
mod signal;
mod stairs;
mod stamps;
mod survey;
mod thrift;
mod time_unit;
mod units;
mod writers;

pub use channel_map::{Channel, ChannelMap};
pub use clock::{ClockRate, OtherClock};
pub use error::{LogError, LogFault};
pub use frozen::Frozen;
pub use holds::Holds;
pub use listing::{Column, Conventions, Listing, Topic};
pub use log::{Log, ReadOptions, Signals, TorqueSource, read, read_as, read_columns};
pub use parquet_file::{write_columns, write_model_columns};
pub use plan::Naming;
pub use readers::{is_recording_folder, list, recognized_format};
pub use resample::{Gap, Method, ResampleReport};
pub use signal::interpolate;
pub use stairs::Stairs;
pub use survey::{channels_by_name, clocks, numbered_joints, recorded_joints};
pub use time_unit::{time_unit_fault, unit_of_step};
pub use writers::{check_ending, check_table_ending, write_log, write_table};
