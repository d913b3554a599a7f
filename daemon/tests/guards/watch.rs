//! Sees what a stretch of code does behind its back: allocations, system calls, page faults.

use std::sync::atomic::{AtomicU8, AtomicU32, Ordering};

use allocation_counter::{AllocationInfo, measure};

/// Read by the kernel at every system call of the watched thread: 1 has it raise SIGSYS instead (Syscall User Dispatch), unless
/// the call comes from between `rivet_watch_begin` and `rivet_watch_end`: what the handler itself calls. So the watch need not
/// be lifted for a call that is allowed, and what comes after one is seen too.
static SELECTOR: AtomicU8 = AtomicU8::new(ALLOW);
const ALLOW: u8 = 0;
const BLOCK: u8 = 1;
const PR_SET_SYSCALL_USER_DISPATCH: libc::c_int = 59;

/// How often each system call was made, by number; those beyond count as the last.
static CALLS: [AtomicU32; 512] = [const { AtomicU32::new(0) }; 512];

#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code, reason = "the few instructions that may call the kernel while it is watched")]
mod kernel {
    core::arch::global_asm!(
        ".globl rivet_watch_begin, rivet_watch_restore, rivet_watch_call, rivet_watch_end",
        "rivet_watch_begin:",
        "rivet_watch_restore:",
        "mov eax, 15",
        "syscall",
        "ud2",
        "rivet_watch_call:",
        "mov rax, [rdi]",
        "mov rsi, [rdi + 16]",
        "mov rdx, [rdi + 24]",
        "mov r10, [rdi + 32]",
        "mov r8, [rdi + 40]",
        "mov r9, [rdi + 48]",
        "mov rdi, [rdi + 8]",
        "syscall",
        "ret",
        "rivet_watch_end:",
    );

    unsafe extern "C" {
        pub(super) static rivet_watch_begin: u8;
        pub(super) static rivet_watch_end: u8;
        /// Where the handler returns to: `rt_sigreturn`.
        pub(super) fn rivet_watch_restore();
        /// Makes the call of these registers: number, six arguments. Returns what the kernel does.
        pub(super) fn rivet_watch_call(registers: *const [i64; 7]) -> i64;
    }

    /// The kernel's own `sigaction`: the C library would put its restorer in.
    #[repr(C)]
    pub(super) struct Action {
        pub(super) handler: usize,
        pub(super) flags: u64,
        pub(super) restorer: usize,
        pub(super) mask: u64,
    }
    pub(super) const SA_RESTORER: u64 = 0x0400_0000;
}

/// Notes the call and makes it after all.
#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code, reason = "a signal handler that looks at the registers of the interrupted code")]
extern "C" fn intercepted(_: libc::c_int, _: *mut libc::siginfo_t, context: *mut libc::c_void) {
    // SAFETY: the kernel passes a valid `ucontext_t` to a handler that was installed with SA_SIGINFO.
    let context = unsafe { &mut *context.cast::<libc::ucontext_t>() };
    let registers = &mut context.uc_mcontext.gregs;
    let order = [libc::REG_RAX, libc::REG_RDI, libc::REG_RSI, libc::REG_RDX, libc::REG_R10, libc::REG_R8, libc::REG_R9];
    let call = order.map(|register| registers[register as usize]);
    let number = usize::try_from(call[0]).unwrap_or(usize::MAX).min(CALLS.len() - 1);
    CALLS[number].fetch_add(1, Ordering::SeqCst);
    // SAFETY: the call that the interrupted code was about to make, with its own arguments.
    registers[libc::REG_RAX as usize] = unsafe { kernel::rivet_watch_call(&raw const call) };
}

/// Has the kernel watch the calling thread; false, said aloud, where it cannot.
#[allow(unsafe_code, reason = "signal handler and prctl have no safe wrapper")]
pub(crate) fn watch_this_thread() -> bool {
    #[cfg(target_arch = "x86_64")]
    {
        let action = kernel::Action {
            handler: intercepted as *const () as usize,
            flags: libc::SA_SIGINFO as u64 | kernel::SA_RESTORER,
            restorer: kernel::rivet_watch_restore as *const () as usize,
            mask: 0,
        };
        // SAFETY: `action` is the kernel's layout, whole, and outlives the call; its restorer returns from the signal, and the
        // handler is safe to run anywhere.
        let handled = unsafe {
            let no_old = std::ptr::null_mut::<kernel::Action>();
            libc::syscall(libc::SYS_rt_sigaction, libc::SIGSYS, &raw const action, no_old, 8_usize)
        } == 0;
        let on: libc::c_ulong = 1;
        let begin = &raw const kernel::rivet_watch_begin as usize;
        // The kernel looks at the address behind the instruction.
        let length = &raw const kernel::rivet_watch_end as usize - begin;
        // SAFETY: the selector is a static byte: it lives as long as the thread.
        let watched =
            handled && unsafe { libc::prctl(PR_SET_SYSCALL_USER_DISPATCH, on, begin, length, SELECTOR.as_ptr()) } == 0;
        if watched {
            return true;
        }
    }
    eprintln!("SKIPPED: this kernel or processor has no Syscall User Dispatch");
    false
}

/// What a stretch of code did that it may not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Seen {
    pub(crate) heap: AllocationInfo,
    /// A system call that is not allowed, by number, if there was one.
    pub(crate) call: Option<i32>,
    /// How many were made in all, allowed ones too.
    pub(crate) calls: u32,
}

/// Runs `work` under watch, in which the system calls with the numbers `allowed` may be made.
pub(crate) fn watched(allowed: &[i64], work: impl FnOnce()) -> Seen {
    for calls in &CALLS {
        calls.store(0, Ordering::SeqCst);
    }
    let heap = measure(|| {
        SELECTOR.store(BLOCK, Ordering::SeqCst);
        work();
        SELECTOR.store(ALLOW, Ordering::SeqCst);
    });
    let made = (0_i64..).zip(CALLS.iter().map(|calls| calls.load(Ordering::SeqCst)));
    let (mut calls, mut call) = (0, None);
    for (number, count) in made.filter(|(_, count)| *count > 0) {
        calls += count;
        if !allowed.contains(&number) && call.is_none() {
            call = Some(number as i32);
        }
    }
    Seen { heap, call, calls }
}
