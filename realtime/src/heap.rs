//! What the allocator does with memory that was given back.

/// Sizes from which glibc maps an allocation by itself, and above which it hands what is free at the top back \[bytes\].
#[cfg(target_env = "gnu")]
const MAPPED_FROM: libc::c_int = 32 << 20;
#[cfg(target_env = "gnu")]
const KEPT_FREE: libc::c_int = 256 << 20;

/// Has the allocator keep what is freed, up to 256 MiB, for whoever asks next. For programs that work through logs: a signal takes some
/// hundred KiB and lives for one step, and glibc by itself hands each back to the kernel, which fills the next with zeros page by page (a
/// quarter of the processor time of a diagnosis). Does nothing with other allocators.
#[cfg_attr(target_env = "gnu", allow(unsafe_code, reason = "no safe wrapper of mallopt exists in the crates at hand"))]
pub fn keep_freed_memory() {
    #[cfg(target_env = "gnu")]
    // SAFETY: mallopt takes two integers and the allocator's own lock; what it refuses it leaves as it is.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, MAPPED_FROM);
        libc::mallopt(libc::M_TRIM_THRESHOLD, KEPT_FREE);
    }
}

#[cfg(all(test, target_env = "gnu"))]
mod tests {
    use crate::ThreadUsage;

    /// Page faults of sixteen signals of a MiB that live side by side, so many times.
    fn faults(times: usize) -> u64 {
        let before = ThreadUsage::now();
        for time in 0..times {
            let signals: Vec<Vec<usize>> = (0..16).map(|k| vec![k + time + 1; 1 << 17]).collect();
            std::hint::black_box(&signals);
        }
        ThreadUsage::now().faults - before.faults
    }

    #[test]
    fn the_next_signals_lie_where_the_last_ones_were() {
        super::keep_freed_memory();
        let once = faults(1);
        let again = faults(20);
        assert!(4 * again < once, "{once} page faults once, {again} in all of twenty times more");
    }
}
