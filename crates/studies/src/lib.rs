//! Studies of the estimators: the paper's figures, supervision schemes side by side, measured arms; and blind cases for
//! the diagnosis. Each is a command of `rivet` that computes everything anew from seeds or logs and prints what it found;
//! none runs in the daemon.

pub mod batch;
pub mod blind;
pub mod figures;
pub mod hidden_effect;
pub mod phase_tracking;
pub mod real;
pub mod recordings;
pub mod strangers;
pub mod supervision;
pub mod tracking;
pub mod withheld;
