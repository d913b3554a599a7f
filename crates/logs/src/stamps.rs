//! Whether rows were sampled when they are stamped, or evenly, so that only their stamps jitter.
//!
//! A row of an even source that is stamped by d too late has its position put off by speed times d; a row that was sampled when it is
//! stamped is off an even clock by as much. Third differences of positions over row numbers tell the two apart: what smooth motion leaves
//! in them has nothing to do with d, while those of speed times d are in them wholly (the stamps are right) or not at all (the rows are even).

use crate::log::{Log, Signals};

/// Stamps this close to an even clock \[steps, root mean square\] are on it.
const ON_CLOCK: f64 = 2e-4;
/// A step of so many usual ones begins a stretch with an even clock of its own.
const HOLE_STEPS: f64 = 10.0;
/// The usual step is the median over windows of so many rows: rows that come in bursts have no usual step from one to the next.
const WINDOW: usize = 50;
/// Steps are whole multiples of the usual one, rows missing, if all but this share are within so much of one.
const ODD: f64 = 1e-3;
const WHOLE: f64 = 0.3;
/// That is not so where rows come in bursts: their mean step is not so many single ones.
const MOST_MISSING: f64 = 3.0;
/// Otherwise rows are missing where a step is longer than so many, and stamps on either side are apart by so many beyond the rows.
const LONGER: f64 = 1.5;
const APART: f64 = 0.6;
/// Rows on either side of which the medians are compared: enough for their noise, and no more than so many.
const SIDE: (f64, f64) = (4.0, 100.0);
/// A clock that drifts is straight over so many rows.
const STRAIGHT: usize = 500;
/// It drifts if the medians of those are off a line by so much of the jitter.
const DRIFTS: f64 = 0.3;
/// Stamps whose distance from the even clock changes from row to row by less than this share of itself do not jitter: the rate changes.
const WANDERS: f64 = 0.3;
/// Speed is taken over so long on either side \[s\], and over two rows at the least: two stamps that jitter are no measure of it.
const SPEED_S: f64 = 0.03;
/// A joint moves that passes through so much \[rad\], in rows of so large a share of its mean square speed.
const MOVES: f64 = 0.02;
const FAST: f64 = 0.01;
/// Third differences beyond so many times the median of what is left are of readings that jump.
const JUMPS: f64 = 30.0;
/// What positions say in blocks of so many rows is independent, of at least so many blocks.
const BLOCK: usize = 50;
const BLOCKS: usize = 8;
/// Rows are even if positions follow the stamps by less than this, within so many deviations, ...
const FOLLOWED: f64 = 0.25;
const SURE: f64 = 3.0;
/// ... and are so many times as smooth, root mean square.
const SMOOTHER: f64 = 1.5;
/// What is missing to following wholly, or not at all, is jitter that is left from this on; measured logs with right stamps have 0.
const INEXACT: f64 = 2e-3;
/// Positions do not tell where what they follow is known no better than this, within so many deviations.
const VAGUE: f64 = 0.1;

/// What an even clock is to the stamps of a log.
struct Even {
    t: Vec<f64>,
    /// Row numbers, those that are missing counted.
    row: Vec<usize>,
    step_s: f64,
}

/// What positions say of the stamps.
struct Verdict {
    /// Share of the stamps' jitter that they follow, and its deviation.
    followed: f64,
    std: f64,
    /// Their roughness by the stamps over that by the even clock.
    smoother: f64,
}

impl Log {
    /// The log by the clock that its positions were sampled by: even where its stamps jitter and its positions do not (`stamps` keeps
    /// what was logged), as stamped otherwise. What jitter remains as far as positions tell is `off_s`.
    #[must_use]
    pub fn by_its_positions(mut self) -> Log {
        if on_a_line(&self.t) {
            return self;
        }
        let Some(even) = even_clock(&self.t) else { return self };
        let off: Vec<f64> = self.t.iter().zip(&even.t).map(|(t, even)| t - even).collect();
        let size = rms(off.iter().copied());
        if size <= ON_CLOCK * even.step_s {
            return self;
        }
        let Some(verdict) = positions_say(&self.q, &self.t, &even, &off) else { return self };
        let jitters = rms(off.windows(2).map(|w| w[1] - w[0])) > WANDERS * size;
        let within = SURE * verdict.std;
        // Of white noise the third difference has twenty times the mean square.
        let sharp = rms(even.thirds(&off)) / 20.0_f64.sqrt();
        let remains = |share: f64| match share {
            // It may be all of it.
            _ if within > VAGUE => sharp,
            share if share - within > INEXACT => share.min(1.0).sqrt() * sharp,
            _ => 0.0,
        };
        if jitters && verdict.followed + within < FOLLOWED && verdict.smoother > SMOOTHER {
            self.off_s = remains(verdict.followed);
            self.stamps = Some(std::mem::replace(&mut self.t, even.t));
        } else {
            self.off_s = remains(1.0 - verdict.followed);
        }
        self
    }

    /// Time of the rows as in the file \[s\].
    pub fn logged_t(&self) -> &[f64] {
        self.stamps.as_deref().unwrap_or(&self.t)
    }

    /// Root mean square of what the stamps are off the even clock that was taken for them \[s\], but for what they all are.
    pub fn stamps_jitter_s(&self) -> Option<f64> {
        let off = || self.stamps.iter().flatten().zip(&self.t).map(|(stamp, t)| stamp - t);
        let mean = off().sum::<f64>() / self.len() as f64;
        self.stamps.is_some().then(|| rms(off().map(|off| off - mean)))
    }
}

impl Even {
    /// Third differences of a signal, where no row is missing.
    fn thirds<'a>(&'a self, x: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        self.whole().map(|k| third(x, k))
    }

    /// Rows whose three next are there.
    fn whole(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.row.len().saturating_sub(3)).filter(|k| self.row[k + 3] - self.row[*k] == 3)
    }
}

fn third(x: &[f64], k: usize) -> f64 {
    x[k + 3] - 3.0 * (x[k + 2] - x[k + 1]) - x[k]
}

/// Third differences of one row and its three next.
#[derive(Clone, Copy)]
struct Thirds {
    even: f64,
    by_stamps: f64,
    /// Of speed times what the stamps are off.
    shifted: f64,
}

/// Weights of the divided difference of four rows, of the same noise as those of even ones.
fn by_stamps(t: &[f64]) -> [f64; 4] {
    let mut weights = [1.0; 4];
    for (i, weight) in weights.iter_mut().enumerate() {
        *weight = (0..4).filter(|j| *j != i).map(|j| t[i] - t[j]).product::<f64>().recip();
    }
    let size: f64 = weights.iter().map(|weight| weight.abs()).sum();
    weights.map(|weight| 8.0 * weight / size)
}

/// Which clock third differences of positions are those of.
fn positions_say(q: &Signals, t: &[f64], even: &Even, off: &[f64]) -> Option<Verdict> {
    let n = off.len();
    let reach = ((SPEED_S / even.step_s).round() as usize).max(2);
    let rows: Vec<usize> = even.whole().filter(|k| *k >= reach && k + 3 + reach < n).collect();
    if rows.len() < BLOCK * BLOCKS {
        return None;
    }
    let weights: Vec<[f64; 4]> = rows.iter().map(|k| by_stamps(&t[*k..k + 4])).collect();
    // Sums over blocks of rows and joints, each joint by what its noise is. What the clocks differ by is taken where speed times what the
    // stamps are off has it: noise of the positions is not in that.
    let mut blocks = vec![(0.0, 0.0); rows.len().div_ceil(BLOCK)];
    let (mut stamped, mut evenly) = (0.0, 0.0);
    for q in q {
        let (low, high) = q.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), q| (l.min(*q), h.max(*q)));
        if high - low < MOVES {
            continue;
        }
        let speed = |k: usize| (q[k + reach] - q[k - reach]) / (even.t[k + reach] - even.t[k - reach]);
        let shift = |k: usize| speed(k) * off[k];
        let least = FAST * rows.iter().map(|k| speed(k + 1).powi(2)).sum::<f64>() / rows.len() as f64;
        let mut found: Vec<Option<Thirds>> = rows
            .iter()
            .zip(&weights)
            .map(|(k, weights)| {
                let by_stamps = weights.iter().zip(&q[*k..]).map(|(weight, q)| weight * q).sum();
                let shifted = shift(k + 3) - 3.0 * (shift(k + 2) - shift(k + 1)) - shift(*k);
                (speed(k + 1).powi(2) > least).then(|| Thirds { even: third(q, *k), by_stamps, shifted })
            })
            .collect();
        let left = |found: &Thirds| found.even.abs().min(found.by_stamps.abs());
        let most = JUMPS * median(found.iter().flatten().map(left).collect());
        if most > 0.0 {
            for found in &mut found {
                *found = found.filter(|found| left(found) <= most);
            }
        }
        let mean = |of: &dyn Fn(&Thirds) -> f64| found.iter().flatten().map(of).map(|x| x * x).sum::<f64>();
        let (as_stamped, as_even) = (mean(&|found| found.by_stamps), mean(&|found| found.even));
        let weight = as_stamped.min(as_even).recip();
        if !weight.is_finite() {
            continue;
        }
        stamped += weight * as_stamped;
        evenly += weight * as_even;
        for (block, found) in blocks.iter_mut().zip(found.chunks(BLOCK)) {
            for Thirds { even, by_stamps, shifted } in found.iter().flatten() {
                block.0 += weight * shifted * (even - by_stamps);
                block.1 += weight * shifted * even;
            }
        }
    }
    let (all, follows) = blocks.iter().fold((0.0, 0.0), |sum, block| (sum.0 + block.0, sum.1 + block.1));
    if !(all > 0.0 && evenly > 0.0) {
        return None;
    }
    let followed = follows / all;
    let spread = blocks.iter().map(|(differ, even)| (even - followed * differ).powi(2)).sum::<f64>();
    Some(Verdict { followed, std: spread.sqrt() / all, smoother: (stamped / evenly).sqrt() })
}

/// Whether all stamps are those of an even clock without a row missing, by far: then there is nothing to look for.
fn on_a_line(t: &[f64]) -> bool {
    let [first, .., last] = t else { return false };
    let step_s = (last - first) / (t.len() - 1) as f64;
    t.iter().enumerate().all(|(k, t)| (t - first - k as f64 * step_s).abs() <= 0.01 * ON_CLOCK * step_s)
}

/// The even clock of stamps; none where there are too few, or no even clock is like them.
fn even_clock(t: &[f64]) -> Option<Even> {
    if t.len() < BLOCK * BLOCKS {
        return None;
    }
    let (step_s, row, starts) = number_rows(t)?;
    let mut even = Vec::with_capacity(t.len());
    for (k, from) in starts.iter().enumerate() {
        let to = starts.get(k + 1).copied().unwrap_or(t.len());
        even.extend(straight(&t[*from..to], &row[*from..to], step_s));
    }
    even.windows(2).all(|w| w[1] > w[0]).then_some(Even { t: even, row, step_s })
}

/// The usual step, the number of each row and the rows at which stretches begin.
fn number_rows(t: &[f64]) -> Option<(f64, Vec<usize>, Vec<usize>)> {
    let single = median(t.windows(2).map(|w| w[1] - w[0]).collect());
    let whole = |step: f64| (step / single).round().max(1.0);
    let (mut odd, mut lacks) = (0_usize, false);
    for w in t.windows(2) {
        let step = w[1] - w[0];
        odd += usize::from((step / single - whole(step)).abs() > WHOLE);
        lacks |= whole(step) > 1.0;
    }
    let over_rows = median((WINDOW..t.len()).map(|k| (t[k] - t[k - WINDOW]) / WINDOW as f64).collect());
    // Where many rows are missing and stamps jitter little, every step says how many.
    let clear = lacks && odd as f64 <= ODD * t.len() as f64 && over_rows < MOST_MISSING * single;
    let step_s = if clear { single } else { over_rows };
    if step_s <= 0.0 {
        return None;
    }
    let late: Vec<f64> = t.iter().enumerate().map(|(k, t)| (t - k as f64 * step_s) / step_s).collect();
    let jitter = 1.5 * jitter(&late);
    // So that the difference of two medians is known to a sixth of what it has to be.
    let side = (1.8 * 6.0 * jitter / APART).powi(2).ceil().clamp(SIDE.0, SIDE.1) as usize;
    let (mut row, mut starts) = (vec![0], vec![0]);
    for k in 1..t.len() {
        let steps = (t[k] - t[k - 1]) / step_s;
        let missing = if steps > HOLE_STEPS {
            // How many does not matter: it is a clock of its own.
            starts.push(k);
            HOLE_STEPS as usize
        } else if clear {
            whole(t[k] - t[k - 1]) as usize - 1
        } else if steps > LONGER {
            missing_before(&late, k, side)
        } else {
            0
        };
        row.push(row[k - 1] + 1 + missing);
    }
    Some((step_s, row, starts))
}

/// Rows that are missing before row `k`: the rows after it are later than those before for good, and no step nearby is longer.
fn missing_before(late: &[f64], k: usize, side: usize) -> usize {
    let (from, to) = (k.saturating_sub(side), (k + side).min(late.len()));
    let by = |k: usize| late[k] - late[k - 1];
    if (from.max(1)..to).any(|other| by(other) > by(k) && by(other) <= HOLE_STEPS - 1.0) {
        return 0;
    }
    let apart = median(late[k..to].to_vec()) - median(late[from..k].to_vec());
    if apart > APART { apart.round() as usize } else { 0 }
}

/// The even clock of a stretch: a line, bent every so many rows where the stamps drift off it.
fn straight(t: &[f64], row: &[usize], step_s: f64) -> Vec<f64> {
    let half = t.len() / 2;
    let slope = |k: usize| (t[k + half] - t[k]) / (row[k + half] - row[k]) as f64;
    let rate = if t.len() < WINDOW { step_s } else { median((0..t.len() - half).map(slope).collect()) };
    let along: Vec<f64> = row.iter().map(|k| (k - row[0]) as f64 * rate).collect();
    let mut late: Vec<f64> = t.iter().zip(&along).map(|(t, along)| t - along).collect();
    let start = median(late.clone());
    for late in &mut late {
        *late -= start;
    }
    let parts = t.len() / STRAIGHT;
    let bounds: Vec<usize> = (0..=parts).map(|k| k * t.len() / parts.max(1)).collect();
    let knots: Vec<(f64, f64)> =
        bounds.windows(2).map(|w| (0.5 * (along[w[0]] + along[w[1] - 1]), median(late[w[0]..w[1]].to_vec()))).collect();
    let most = knots.iter().map(|(_, late)| late.abs()).fold(0.0, f64::max);
    if knots.len() < 2 || most <= DRIFTS * 1.5 * jitter(&late) {
        return along.iter().map(|along| start + along).collect();
    }
    let bent = |along: &f64| {
        let after = knots.partition_point(|(at, _)| at < along).clamp(1, knots.len() - 1);
        let ((a, from), (b, to)) = (knots[after - 1], knots[after]);
        start + along + from + (to - from) * (along - a) / (b - a)
    };
    along.iter().map(bent).collect()
}

/// Median distance from the median of the rows nearby.
fn jitter(late: &[f64]) -> f64 {
    let off = |block: &[f64]| {
        let middle = median(block.to_vec());
        block.iter().map(|late| (late - middle).abs()).collect::<Vec<f64>>()
    };
    median(late.chunks(WINDOW).flat_map(off).collect())
}

fn median(mut of: Vec<f64>) -> f64 {
    let middle = of.len() / 2;
    if of.is_empty() { 0.0 } else { *of.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

fn rms(of: impl Iterator<Item = f64>) -> f64 {
    let (count, sum) = of.fold((0_usize, 0.0), |(count, sum), x| (count + 1, sum + x * x));
    (sum / count.max(1) as f64).sqrt()
}
