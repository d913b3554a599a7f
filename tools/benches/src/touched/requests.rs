//! What a program may ask of the callgrind it runs under (valgrind's client requests); outside it they do nothing.
#![allow(unsafe_code, reason = "a request is a sequence of instructions that only valgrind knows")]

use std::ffi::CStr;

/// First request of callgrind: 'C', 'T'.
const BASE: usize = 0x4354_0000;

/// Counts from now on.
pub(crate) fn count() {
    ask(BASE + 4, 0);
}

/// Forgets the counts so far; what the simulated caches hold stays.
pub(crate) fn zero() {
    ask(BASE + 1, 0);
}

/// Writes the counts so far under a name, and zeroes them.
pub(crate) fn dump(name: &CStr) {
    ask(BASE + 3, name.as_ptr() as usize);
}

#[cfg(target_arch = "x86_64")]
fn ask(request: usize, argument: usize) {
    let words = [request, argument, 0, 0, 0, 0];
    // SAFETY: rdi is rotated by 128 places in all and rbx exchanged with itself, so on a bare machine nothing changes;
    // valgrind reads the words that rax points to and answers in rdx.
    unsafe {
        std::arch::asm!(
            "rol rdi, 3",
            "rol rdi, 13",
            "rol rdi, 61",
            "rol rdi, 51",
            "xchg rbx, rbx",
            in("rax") words.as_ptr(),
            inout("rdx") 0_usize => _,
            options(nostack),
        );
    }
}

#[cfg(not(target_arch = "x86_64"))]
fn ask(_: usize, _: usize) {}
