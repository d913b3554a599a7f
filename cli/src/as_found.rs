//! What the values at the end of an on-line run leave of the torque that they were found from, beside those of the robot file.
//!
//! The residual that the estimator tells is one step ahead, by the values of each time: it holds how they came about as well.

use rivet_analysis::predict::errors;
use rivet_analysis::runs::read_log;
use rivet_analysis::sound::Sound;
use rivet_config::{Identified, Robot};
use std::borrow::Cow;
use std::path::Path;

/// What is looked at where nothing is forgotten \[s\].
const LAST_S: f64 = 10.0;

/// Errors in the last window, per joint \[%\].
pub(crate) struct AsFound {
    pub(crate) found: Vec<f64>,
    pub(crate) given: Vec<f64>,
}

/// Of base parameters `values` and `std` on the end of a log; none where the arm stands still there.
pub(crate) fn as_found(robot: &Robot, path: &Path, [values, std]: [&[f64]; 2]) -> Option<AsFound> {
    let log = read_log(robot, path).ok()?;
    let begin = log.t.last()? - robot.config.estimator.window_s.unwrap_or(LAST_S);
    let log = log.slice(log.t.partition_point(|t| *t < begin)..log.len());
    let sound = Sound { log: Cow::Owned(log), left_out: Vec::new(), repeated: None, found: Vec::new() };
    let identified = Identified { values: values.to_vec(), std: std.to_vec() };
    let found = Robot { identified: Some(identified), ..robot.clone() };
    Some(AsFound { found: errors(&found, &sound).ok()??, given: errors(robot, &sound).ok()?? })
}
