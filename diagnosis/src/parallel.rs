//! Samples shared out between processors; nothing depends on how many there are.

use rayon::prelude::*;

/// Samples that a thread takes at a time.
const CHUNK: usize = 2048;

/// `f` of every item.
pub(crate) fn map<T: Sync, R: Send>(items: &[T], f: impl Fn(&T) -> R + Sync + Send) -> Vec<R> {
    items.par_iter().map(f).collect()
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
