//! Whether a joint stands or moves.

use crate::model::rows::Chain;
use crate::model::run::Motion;
use crate::policy::POLICY;

/// Whether joint `j` stands still throughout.
pub(crate) fn is_still(motion: &Motion, j: usize) -> bool {
    top_speed(motion, j) < POLICY.signal_faults.max_still_speed_rad_s
}

/// Whether joint `j` moves for a while.
pub(crate) fn is_moved(motion: &Motion, chain: &Chain, j: usize) -> bool {
    let rows =
        chain.sample(&motion.qd[j]).iter().filter(|v| v.abs() > POLICY.signal_faults.max_still_speed_rad_s).count();
    rows as f64 * chain.row_period_s >= POLICY.signal_faults.min_motion_s
}

/// Largest speed of joint `j` \[rad/s\].
pub(crate) fn top_speed(motion: &Motion, j: usize) -> f64 {
    motion.qd[j].iter().fold(0.0_f64, |m, v| m.max(v.abs()))
}
