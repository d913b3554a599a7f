//! The last rows that one thread wrote, for another to look at: a ring that overwrites its oldest row.

use std::sync::atomic::{AtomicU64, Ordering, fence};

/// A ring of rows of words. One thread writes and never waits; any other may copy what is there, even when the writer has
/// stopped in the middle of a row: that row, and one that is overwritten meanwhile, is left out.
#[derive(Debug)]
pub struct RecentRows {
    width: usize,
    /// Rows ever begun.
    written: AtomicU64,
    /// A row's stamp: twice its number, from 1 on, and one less while it is being written (Boehm 2012, Can seqlocks get along
    /// with programming language memory models?).
    stamps: Vec<AtomicU64>,
    words: Vec<AtomicU64>,
}

impl RecentRows {
    /// Room for `rows` rows (at least one) of `width` words; every page is touched.
    #[must_use]
    pub fn new(rows: usize, width: usize) -> RecentRows {
        let zeros = |count: usize| (0..count).map(|_| AtomicU64::new(0)).collect();
        RecentRows { width, written: AtomicU64::new(0), stamps: zeros(rows.max(1)), words: zeros(rows.max(1) * width) }
    }

    /// Words a row.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Writes a row over the oldest; words beyond the width are left out, missing ones are zero. One thread only. Wait-free.
    pub fn push(&self, row: impl IntoIterator<Item = u64>) {
        let number = self.written.load(Ordering::Relaxed);
        let slot = (number % self.stamps.len() as u64) as usize;
        self.stamps[slot].store(2 * number + 1, Ordering::Relaxed);
        fence(Ordering::Release);
        let mut words = row.into_iter();
        for word in &self.words[slot * self.width..(slot + 1) * self.width] {
            word.store(words.next().unwrap_or(0), Ordering::Relaxed);
        }
        self.stamps[slot].store(2 * number + 2, Ordering::Release);
        self.written.store(number + 1, Ordering::Release);
    }

    /// The last rows, at most `count`, the oldest first. With room for more than that the writer may go on meanwhile. Allocates.
    #[must_use]
    pub fn copy(&self, count: usize) -> Vec<Vec<u64>> {
        let end = self.written.load(Ordering::Acquire);
        let begin = end.saturating_sub(count.min(self.stamps.len()) as u64);
        (begin..end).filter_map(|number| self.row(number)).collect()
    }

    fn row(&self, number: u64) -> Option<Vec<u64>> {
        let slot = (number % self.stamps.len() as u64) as usize;
        let whole = 2 * number + 2;
        if self.stamps[slot].load(Ordering::Acquire) != whole {
            return None;
        }
        let words = &self.words[slot * self.width..(slot + 1) * self.width];
        let row = words.iter().map(|word| word.load(Ordering::Relaxed)).collect();
        fence(Ordering::Acquire);
        (self.stamps[slot].load(Ordering::Relaxed) == whole).then_some(row)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    #[test]
    fn the_last_rows_are_kept_in_order() {
        let ring = RecentRows::new(4, 3);
        assert!(ring.copy(4).is_empty());
        for k in 0..10 {
            ring.push([k, k + 100, k + 200, 7]);
        }
        assert_eq!(ring.copy(9), (6..10).map(|k| vec![k, k + 100, k + 200]).collect::<Vec<_>>());
        ring.push([1]);
        assert_eq!(ring.copy(9)[3], [1, 0, 0]);
        assert_eq!(ring.copy(2), [[9, 109, 209], [1, 0, 0]]);
    }

    /// Rows whose words all depend on their number, written as fast as can be: none that is copied is mixed of two.
    #[test]
    fn no_row_is_torn() {
        let ring = Arc::new(RecentRows::new(8, 16));
        let writer = {
            let ring = Arc::clone(&ring);
            std::thread::spawn(move || (0..400_000_u64).for_each(|k| ring.push((0..16).map(|w| k.wrapping_mul(w + 1)))))
        };
        let (mut seen, mut done) = (0, false);
        while !done {
            done = writer.is_finished();
            let rows = ring.copy(8);
            for row in &rows {
                assert!((0..16).all(|w| row[w as usize] == row[0].wrapping_mul(w + 1)), "{row:?}");
            }
            assert!(rows.windows(2).all(|pair| pair[0][0] < pair[1][0]));
            seen += rows.len();
        }
        writer.join().expect("no panic");
        assert!(seen >= 8 && ring.copy(8).len() == 8);
    }
}
