//! Whether a joint stands or moves.

use crate::rows::Chain;
use crate::run::Motion;

/// Speed below which a joint stands still \[rad/s\].
pub(crate) const STILL: f64 = 0.02;
/// A joint that moves does so for at least so long \[s\].
const IN_MOTION_S: f64 = 0.5;

/// Whether joint `j` stands still throughout.
pub(crate) fn is_still(motion: &Motion, j: usize) -> bool {
    top_speed(motion, j) < STILL
}

/// Whether joint `j` moves for a while.
pub(crate) fn is_moved(motion: &Motion, chain: &Chain, j: usize) -> bool {
    let rows = chain.sample(&motion.qd[j]).iter().filter(|v| v.abs() > STILL).count();
    rows as f64 * chain.row_period_s >= IN_MOTION_S
}

/// Largest speed of joint `j` \[rad/s\].
pub(crate) fn top_speed(motion: &Motion, j: usize) -> f64 {
    motion.qd[j].iter().fold(0.0_f64, |m, v| m.max(v.abs()))
}
