//! Sees what a stretch of code does behind its back: allocations, system calls, page faults.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::{AtomicI32, AtomicU8, AtomicU64, Ordering};

struct Counting;

thread_local! {
    static ARMED: Cell<bool> = const { Cell::new(false) };
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

fn note() {
    if ARMED.get() {
        COUNT.set(COUNT.get() + 1);
    }
}

#[allow(unsafe_code, reason = "a global allocator that counts can only be written so")]
// SAFETY: every call is handed to the system's allocator unchanged; counting touches only thread-local cells.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        note();
        // SAFETY: the caller's promise is the system allocator's.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        note();
        // SAFETY: the caller's promise is the system allocator's.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Read by the kernel at every system call of the watched thread: 1 has it raise SIGSYS instead (Syscall User Dispatch).
static SELECTOR: AtomicU8 = AtomicU8::new(ALLOW);
const ALLOW: u8 = 0;
const BLOCK: u8 = 1;
const PR_SET_SYSCALL_USER_DISPATCH: libc::c_int = 59;

static CALLS: AtomicU64 = AtomicU64::new(0);
static LAST_CALL: AtomicI32 = AtomicI32::new(-1);

/// Notes the call and makes it after all.
#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code, reason = "a signal handler that looks at the registers of the interrupted code")]
extern "C" fn intercepted(_: libc::c_int, _: *mut libc::siginfo_t, context: *mut libc::c_void) {
    // First: this handler's own calls, its return among them.
    SELECTOR.store(ALLOW, Ordering::SeqCst);
    // SAFETY: the kernel passes a valid `ucontext_t` to a handler that was installed with SA_SIGINFO.
    let context = unsafe { &mut *context.cast::<libc::ucontext_t>() };
    let registers = &mut context.uc_mcontext.gregs;
    let of = |register: libc::c_int| registers[register as usize];
    let number = of(libc::REG_RAX);
    CALLS.fetch_add(1, Ordering::SeqCst);
    LAST_CALL.store(number as i32, Ordering::SeqCst);
    // SAFETY: the call that the interrupted code was about to make, with its own arguments.
    let result = unsafe {
        libc::syscall(
            number,
            of(libc::REG_RDI),
            of(libc::REG_RSI),
            of(libc::REG_RDX),
            of(libc::REG_R10),
            of(libc::REG_R8),
            of(libc::REG_R9),
        )
    };
    let failed = -i64::from(std::io::Error::last_os_error().raw_os_error().unwrap_or(libc::EIO));
    registers[libc::REG_RAX as usize] = if result == -1 { failed } else { result };
}

/// Has the kernel watch the calling thread; false, said aloud, where it cannot.
#[allow(unsafe_code, reason = "signal handler and prctl have no safe wrapper")]
pub(crate) fn watch_this_thread() -> bool {
    #[cfg(target_arch = "x86_64")]
    {
        // SAFETY: all-zero bytes are a valid `sigaction`.
        let mut action: libc::sigaction = unsafe { std::mem::zeroed() };
        action.sa_sigaction = intercepted as *const () as usize;
        action.sa_flags = libc::SA_SIGINFO;
        // SAFETY: `action` is whole and outlives the call; the handler is safe to run anywhere.
        let handled = unsafe { libc::sigaction(libc::SIGSYS, &raw const action, std::ptr::null_mut()) } == 0;
        let on: libc::c_ulong = 1;
        // SAFETY: the selector is a static byte: it lives as long as the thread.
        let watched = handled
            && unsafe { libc::prctl(PR_SET_SYSCALL_USER_DISPATCH, on, 0_usize, 0_usize, SELECTOR.as_ptr()) } == 0;
        if watched {
            return true;
        }
    }
    eprintln!("SKIPPED: this kernel or processor has no Syscall User Dispatch");
    false
}

/// What a stretch of code did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Seen {
    pub(crate) allocations: u64,
    /// The first system call, by number, if there was one; what comes after it in the same stretch is not seen.
    pub(crate) call: Option<i32>,
}

/// Runs `work` under watch.
pub(crate) fn watched(work: impl FnOnce()) -> Seen {
    COUNT.set(0);
    CALLS.store(0, Ordering::SeqCst);
    ARMED.set(true);
    SELECTOR.store(BLOCK, Ordering::SeqCst);
    work();
    SELECTOR.store(ALLOW, Ordering::SeqCst);
    ARMED.set(false);
    let called = CALLS.load(Ordering::SeqCst) > 0;
    Seen { allocations: COUNT.get(), call: called.then(|| LAST_CALL.load(Ordering::SeqCst)) }
}
