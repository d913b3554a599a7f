//! A recording in another format: its signals under rivet's names, in SI units.

use std::path::Path;

use anyhow::Result;
use rivet_files::Content;
use rivet_logs::{LogFault, check_ending, list, read_as, time_unit_fault, write_log};

use crate::fault::Fault;
use crate::inspect::{Arm, NO_POSITIONS};
use crate::{runs, session};

/// A recording that was converted.
#[derive(Clone, Debug)]
pub struct Conversion {
    /// Format of the recording.
    pub from: &'static str,
    /// Rows written.
    pub rows: usize,
    /// Names of the joints, base to flange.
    pub joints: Vec<String>,
    /// Columns written, such as `t`, `q1`, `tau1`.
    pub columns: Vec<String>,
    /// How the channels were found, and what is wrong with the recording.
    pub notes: Vec<String>,
    /// Columns of the recording that are no signal that rivet uses.
    pub unused: Vec<String>,
    /// Signals for which the new format has no place.
    pub left_out: Vec<String>,
}

/// Reads `recording` as an analysis would, and writes its signals to `out`, whose ending decides the format. Rows stay as they are:
/// nothing is resampled, filtered or smoothed. The new file states that signs, zeros and units are the model's.
///
/// * `robot`: URDF or robot file of the arm; joints are then matched by name
/// * `entries`: channels that are stated, as [`crate::map::apply`] takes them
/// * `replaces`: whether a file of the name `out` is replaced
///
/// # Errors
/// The recording or the robot cannot be read, the ending is unknown, `out` is the recording or may not be replaced, or it cannot be
/// written.
pub fn convert(
    recording: &Path,
    out: &Path,
    robot: Option<&Path>,
    entries: &[String],
    replaces: bool,
) -> Result<Conversion> {
    // Before a long recording is read.
    let order = "the order is RECORDING OUT [URDF|ROBOT.toml]";
    let is_arm = |path: &Path| matches!(Content::of(path), Ok(Content::Urdf | Content::Xacro | Content::Toml));
    if is_arm(recording) && runs::wrong_order(recording, "").is_none() {
        let why = "describes the arm, where the recording is expected";
        return Err(Fault::Usage(format!("{}: {why}; {order}", recording.display())).into());
    }
    check_ending(out).map_err(|why| {
        if is_arm(out) { Fault::Usage(format!("{why}; {order}")).into() } else { anyhow::Error::from(why) }
    })?;
    if !recording.exists() {
        return Err(Fault::Usage(format!("{}: is not there; {order}", recording.display())).into());
    }
    if let (Ok(there), Ok(source)) = (out.canonicalize(), recording.canonicalize())
        && there == source
    {
        let why = "it is the recording itself, of which columns would be lost; give another name";
        return Err(Fault::Usage(format!("{}: {why}", out.display())).into());
    }
    if !replaces && out.exists() {
        let why = "it is there already; give another name, or --force to replace it";
        return Err(Fault::Usage(format!("{}: {why}", out.display())).into());
    }
    let listing = list(recording)?;
    let arm = Arm::find(&listing, robot, entries)?;
    // What is wrong with the recording may be why it is refused.
    let refused = |why: anyhow::Error| {
        for warning in &listing.warnings {
            session::note(format_args!("rivet: {}: {warning}", recording.display()));
        }
        why
    };
    if arm.count == 0 {
        return Err(refused(Fault::Data(format!("{}: {NO_POSITIONS}", recording.display())).into()));
    }
    let log = read_as(recording, &arm.options(), &arm.naming()).map_err(|why| refused(why.into()))?;
    // A log of one row in seconds is rare and no mistake; of a million it is.
    let mut notes = log.notes.clone();
    match time_unit_fault(&log.t) {
        Some(fault @ LogFault::TimeUnit { unit: "ms", .. }) => notes.push(fault.to_string()),
        Some(fault) => return Err(refused(Fault::Data(format!("{}: {fault}", recording.display())).into())),
        None => {}
    }
    let joints = arm.joint_names();
    let left_out = write_log(out, &log, &joints)?;
    Ok(Conversion {
        from: listing.format,
        rows: log.len(),
        joints,
        columns: log.columns().into_iter().map(|(name, _)| name.into_owned()).collect(),
        notes,
        unused: log.unused,
        left_out,
    })
}
