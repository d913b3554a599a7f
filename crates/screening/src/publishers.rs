//! Rows of a second publisher between those of the arm.

/// A publisher that stands still sends the same position of every joint; from this share of the rows on it is one, below it the
/// rows are glitches.
const MIN_SHARE: f64 = 0.002;
/// It comes and goes at least so often: what happens once is a start or an end.
const MIN_RUNS: usize = 3;
/// Its rows are off from those around by this many times what those differ ...
const FAR: f64 = 20.0;
/// ... and by this \[rad\], on some joint.
const MIN_JUMP: f64 = 0.02;

/// Poses that are tried.
const MOST_TRIED: usize = 50;

/// Rows (ascending) whose positions are one and the same vector, far from the rows around, again and again: a second publisher
/// that knows nothing of the arm (zeros, a pose of its own). `q` is `[joint][row]`. Empty where there is none.
#[must_use]
pub fn second_publisher(q: &[Vec<f64>]) -> Vec<usize> {
    let rows = q.iter().map(Vec::len).min().unwrap_or(0);
    if rows < 3 || q.is_empty() {
        return Vec::new();
    }
    let usual: Vec<f64> = q.iter().map(|q| usual_step(q)).collect();
    let far_step = |k: usize| {
        q.iter().zip(&usual).any(|(q, usual)| {
            let step = (q[k] - q[k - 1]).abs();
            step > MIN_JUMP && step > FAR * usual
        })
    };
    let same = |a: usize, b: usize| q.iter().all(|q| q[a] == q[b]);
    let leaves: Vec<usize> = (1..rows).filter(|k| far_step(*k)).collect();
    // The pose that most of the far steps lead to.
    let runs_to = |pose: &usize| leaves.iter().filter(|other| same(*pose, **other)).count();
    let Some(pose) = leaves.iter().take(MOST_TRIED).copied().max_by_key(runs_to) else { return Vec::new() };
    let found: Vec<usize> = (0..rows).filter(|k| same(*k, pose)).collect();
    let enough = runs_to(&pose) >= MIN_RUNS && found.len() as f64 >= MIN_SHARE * rows as f64 && found.len() * 2 <= rows;
    // Where the arm itself rests it also arrives in small steps.
    let arrives = found.iter().any(|k| *k > 0 && !same(*k - 1, pose) && !far_step(*k));
    if enough && !arrives { found } else { Vec::new() }
}

/// A step of the arm: of three in ten of the changes, which is one between its own rows even where others are between most of them.
fn usual_step(q: &[f64]) -> f64 {
    let mut steps: Vec<f64> = q.windows(2).map(|w| (w[1] - w[0]).abs()).filter(|step| *step > 0.0).collect();
    let at = steps.len() * 3 / 10;
    if steps.is_empty() { 0.0 } else { *steps.select_nth_unstable_by(at, f64::total_cmp).1 }
}
