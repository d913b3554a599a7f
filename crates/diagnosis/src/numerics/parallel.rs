//! Parallel maps with results in the order of the items, so that nothing depends on the number of threads.
//!
//! Threads of their own, not a pool's: work may make a signal that others wait for (`OnceLock`) and share that out in turn. A
//! pool's worker would meanwhile take up other work, which may wait for the very signal that it is making.

use std::num::NonZero;
use std::sync::atomic::{AtomicUsize, Ordering};

/// More threads than this gain nothing: memory is the bound.
const MAX_THREADS: usize = 8;
/// Samples that a thread takes at a time.
const CHUNK: usize = 2048;

/// `f` of every item.
pub(crate) fn map<T: Sync, R: Send>(items: &[T], f: impl Fn(&T) -> R + Sync) -> Vec<R> {
    map_counted(items, f, |_| ())
}

/// As [`map`]; `count` gets the number of items that are done, on this thread, after each item that this thread did.
pub(crate) fn map_counted<T: Sync, R: Send>(
    items: &[T],
    f: impl Fn(&T) -> R + Sync,
    mut count: impl FnMut(usize),
) -> Vec<R> {
    let workers = std::thread::available_parallelism().map_or(1, NonZero::get).min(MAX_THREADS).min(items.len()).max(1);
    let finished = AtomicUsize::new(0);
    let one = |item: &T| (f(item), finished.fetch_add(1, Ordering::Relaxed) + 1);
    // Neighbours cost alike: each worker takes every so manieth.
    let share = |w: usize| items.iter().skip(w).step_by(workers).map(&one);
    let done: Vec<Vec<R>> = std::thread::scope(|scope| {
        let start = |w: usize| scope.spawn(move || share(w).map(|(result, _)| result).collect());
        let running: Vec<_> = (1..workers).map(start).collect();
        let counted = |(result, done)| {
            count(done);
            result
        };
        let first: Vec<R> = share(0).map(counted).collect();
        let others = running.into_iter().map(|r| r.join().unwrap_or_else(|why| std::panic::resume_unwind(why)));
        std::iter::once(first).chain(others).collect()
    });
    let mut parts: Vec<_> = done.into_iter().map(Vec::into_iter).collect();
    (0..items.len()).filter_map(|i| parts[i % workers].next()).collect()
}

/// Stretches of samples: from and to.
pub(crate) fn chunks(samples: usize) -> Vec<(usize, usize)> {
    (0..samples).step_by(CHUNK).map(|from| (from, (from + CHUNK).min(samples))).collect()
}

/// Signals of successive chunks, one behind the other.
pub(crate) fn joined(chunks: Vec<Vec<Vec<f64>>>, signals: usize) -> Vec<Vec<f64>> {
    let mut all = vec![Vec::with_capacity(chunks.iter().filter_map(|c| c.first()).map(Vec::len).sum()); signals];
    for chunk in chunks {
        all.iter_mut().zip(chunk).for_each(|(to, from)| to.extend(from));
    }
    all
}

#[cfg(test)]
mod tests {
    #[test]
    fn results_stand_in_the_order_of_items() {
        for count in [0_usize, 1, 2, 7, 100] {
            let items: Vec<usize> = (0..count).collect();
            let mut counts = Vec::new();
            let squares = super::map_counted(&items, |i| i * i, |done| counts.push(done));
            assert_eq!(squares, items.iter().map(|i| i * i).collect::<Vec<_>>());
            assert!(counts.is_sorted() && counts.iter().all(|done| (1..=count).contains(done)), "{counts:?}");
            assert_eq!(counts.is_empty(), count == 0);
        }
    }
}
