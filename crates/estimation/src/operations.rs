//! How many multiply-adds the inner loops do, and how many entries are written beside them: counted in this crate's tests,
//! nothing elsewhere. Counts say what the loops were asked for, so they are the same on every machine.

#[cfg(test)]
thread_local! {
    static COUNTS: std::cell::Cell<[usize; 2]> = const { std::cell::Cell::new([0; 2]) };
}

#[cfg(test)]
fn add(more: [usize; 2]) {
    COUNTS.with(|counts| {
        let [a, b] = counts.get();
        counts.set([a + more[0], b + more[1]]);
    });
}

/// `count` multiply-adds are done.
#[inline(always)]
pub(crate) fn multiply_adds(count: usize) {
    #[cfg(test)]
    add([count, 0]);
    #[cfg(not(test))]
    let _ = count;
}

/// `count` entries are written because of what the data say.
#[inline(always)]
pub(crate) fn writes(count: usize) {
    #[cfg(test)]
    add([0, count]);
    #[cfg(not(test))]
    let _ = count;
}

/// What `work` asks for on this thread: multiply-adds, and entries written because of what the data say.
#[cfg(test)]
pub(crate) fn counted(work: impl FnOnce()) -> [usize; 2] {
    let before = COUNTS.with(std::cell::Cell::get);
    work();
    let after = COUNTS.with(std::cell::Cell::get);
    [after[0] - before[0], after[1] - before[1]]
}
