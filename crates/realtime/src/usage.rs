//! What the kernel did to this thread.

/// Counters of the calling thread; they only grow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ThreadUsage {
    /// Page faults, minor and major.
    pub faults: u64,
    /// Times the processor was taken from the thread.
    pub involuntary: u64,
    /// The processor it runs on.
    pub cpu: u32,
}

impl ThreadUsage {
    /// Asks the kernel: one system call.
    #[allow(unsafe_code, reason = "no safe wrapper of getrusage for a thread exists in the crates at hand")]
    pub fn now() -> Self {
        // SAFETY: all-zero bytes are a valid `rusage`, which has only integers.
        let mut usage: libc::rusage = unsafe { std::mem::zeroed() };
        // SAFETY: `usage` is writable and outlives the call.
        if unsafe { libc::getrusage(libc::RUSAGE_THREAD, &raw mut usage) } != 0 {
            return Self::default();
        }
        let count = |n: libc::c_long| u64::try_from(n).unwrap_or(0);
        let cpu = u32::try_from(rustix::thread::sched_getcpu()).unwrap_or(0);
        Self { faults: count(usage.ru_minflt) + count(usage.ru_majflt), involuntary: count(usage.ru_nivcsw), cpu }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn touching_new_memory_shows() {
        let before = ThreadUsage::now();
        let mut memory = vec![0_u8; 4 << 20];
        for page in memory.chunks_mut(4096) {
            page[0] = 1;
        }
        std::hint::black_box(&memory);
        let after = ThreadUsage::now();
        assert!(after.faults > before.faults && after.involuntary >= before.involuntary);
    }
}
