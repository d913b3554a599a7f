//! What the loop hands over for publication.

use rivet_ipc_schema::{Drift, Health, Parameters, Timing};

/// A message on its way to the publishing thread.
#[expect(clippy::large_enum_variant, reason = "all live in a preallocated ring; boxing would allocate in the loop")]
#[derive(Debug)]
pub enum Outbound {
    /// A parameter set.
    Parameters(Parameters),
    /// A health message.
    Health(Health),
    /// Whether the arm has left the accepted model.
    Drift(Drift),
    /// Where the time goes.
    Timing(Timing),
}
