//! Diagnoses of many robots and logs, a process each, in one Parquet table that the same call continues (`docs/fleet.md`).
//!
//! | function | result |
//! |---|---|
//! | [`robots`], [`recordings`], [`pairs`] | which logs belong to which robot, and which make up one diagnosis |
//! | [`list`] | what would be done with each pair |
//! | [`diagnose`] | the table |

mod collector;
mod columns;
mod fingerprint;
mod journal;
mod pairs;
mod plan;
mod progress;
mod row;
mod run;
mod summary;
mod table;
mod worker;

pub use pairs::{FleetRobot, GroupBy, Pair, pairs, recordings, robots};
pub use progress::Progress;
pub use run::{Settings, diagnose, list};
pub use summary::{State, Summary, states_json, states_text};
