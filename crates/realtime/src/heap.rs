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
