//! The clock of all stamps.

use rustix::time::{ClockId, clock_gettime};

/// `CLOCK_MONOTONIC` \[ns\], the clock of all stamps.
pub fn now_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec.unsigned_abs() * 1_000_000_000 + now.tv_nsec.unsigned_abs()
}
