//! The shapes of a run as it was given, and the errors of a diagnosis.

use crate::model::run::Run;

/// Why nothing could be diagnosed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DiagnosisError {
    /// No run was given.
    #[error("no run to diagnose")]
    NoRun,
    /// A run with another number of joints, or signals of different lengths.
    #[error("{run}: {what}")]
    Shape {
        /// The run's name.
        run: String,
        /// What is wrong with it.
        what: String,
    },
    /// The equations cannot be solved.
    #[error("the equations of the runs cannot be solved: is every signal finite and the nominal model physical?")]
    Singular,
}

/// Checks that a run has one signal of the same length for each joint.
///
/// # Errors
/// [`DiagnosisError::Shape`] where it has not.
pub(crate) fn check(run: &Run, joints: usize) -> Result<(), DiagnosisError> {
    let fault = |what: String| Err(DiagnosisError::Shape { run: run.name.clone(), what });
    let rows = run.len();
    let desired = run
        .desired
        .iter()
        .flat_map(|d| [(&d.q, "desired positions"), (&d.qd, "desired speeds"), (&d.qdd, "desired accelerations")]);
    for (signal, name) in [(&run.q, "positions"), (&run.tau, "torques")].into_iter().chain(desired) {
        if signal.len() != joints {
            return fault(format!("{name} of {} joints, the robot has {joints}", signal.len()));
        }
        if signal.iter().any(|s| s.len() != rows) {
            return fault(format!("{name} of different lengths"));
        }
    }
    Ok(())
}
