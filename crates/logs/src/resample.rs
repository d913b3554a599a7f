//! Uneven or foreign rates to a uniform grid, all signals treated alike, and a report of what was done.

use std::fmt;

use crate::columns::Group;
use crate::error::{LogError, LogFault};
use crate::log::Log;
use crate::signal::{Decimator, linear, spline};

/// A step longer than this many usual steps is a gap.
const GAP_STEPS: f64 = 2.5;
/// A step within this share of a usual one of two of them or more lacks rows, and is no jitter.
const WHOLE: f64 = 0.1;
/// Most rows that are made between two of the log, on average, and in all: a day at 1 kHz. What asks for more has its time in
/// another unit.
const MOST_ROWS_EACH: f64 = 1000.0;
const MOST_ROWS: f64 = 1e8;
/// A time stamp off the uniform grid by less than this share of a step is on it.
const GRID_TOLERANCE: f64 = 0.01;

/// How the new rows came about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// The log was on the wanted grid.
    AsLogged,
    /// Interpolated: cubic spline (temperature: straight lines).
    Interpolated,
    /// The log was uniform: zero-phase low-pass, then every `factor`-th row.
    Decimated {
        /// Rows of the log a new row.
        factor: usize,
    },
    /// Interpolated to `factor` times the wanted rate, then low-pass and every `factor`-th row.
    InterpolatedAndDecimated {
        /// Interpolated rows a new row.
        factor: usize,
    },
}

/// A step of time much longer than the others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gap {
    /// The row after the gap, from 1.
    pub row: usize,
    /// Time before the gap \[s\].
    pub from_s: f64,
    /// Its length \[s\].
    pub length_s: f64,
}

/// What the log's time axis was like and what resampling did.
#[derive(Clone, Debug, PartialEq)]
pub struct ResampleReport {
    /// Rows of the log.
    pub rows_in: usize,
    /// Rows of the result.
    pub rows_out: usize,
    /// Rows per second of the log, over its whole length.
    pub mean_rate_hz: f64,
    /// The usual (median) step \[s\].
    pub median_step_s: f64,
    /// Root mean square of step minus usual step \[s\], gaps and steps that lack rows left out.
    pub jitter_s: f64,
    /// Root mean square of the stamps' distance from the even clock that was taken for them \[s\]; none where the stamps were taken.
    pub stamps_jitter_s: Option<f64>,
    /// What is left of jitter in the time of the rows \[s\], root mean square and at most, by what positions say.
    pub off_s: f64,
    /// Rows that are not there: steps of whole multiples of the usual one.
    pub missing: usize,
    /// Rows that came right after another and were taken together with it, in the whole file.
    pub crowded: usize,
    /// Steps longer than 2.5 usual ones.
    pub gaps: Vec<Gap>,
    /// Per joint: share of the rows in motion at which the position repeats the row before (stair-case encoders).
    pub repeated: Vec<f64>,
    /// Step of the result \[s\].
    pub period_s: f64,
    /// How the new rows came about.
    pub method: Method,
}

impl Log {
    /// Brings the log to the uniform period `period_s`.
    ///
    /// * A finer or uneven grid: cubic splines through every signal (straight lines for temperature), so that no signal
    ///   lags or loses amplitude against another.
    /// * A coarser grid: first the spline to a whole multiple of the wanted rate (nothing to do when the log is on it),
    ///   then one linear-phase low-pass over every signal and every k-th row. Half the filter is lost at either end.
    ///
    /// Stairs of a position that updates more slowly than the log are left in it: where they are short, their ripple lies at the
    /// log's rate, which the low-pass removes when rows are dropped; `repeated` says how many there are. Longer ones are taken out
    /// before ([`Log::without_stairs`]).
    pub fn resample(&self, period_s: f64) -> Result<(Log, ResampleReport), LogError> {
        if !(period_s.is_finite() && period_s > 0.0) {
            return Err(LogFault::Period(period_s).at(&self.path));
        }
        let mut report = self.describe_time(period_s);
        let ratio = (period_s / report.median_step_s).max(1.0);
        let wanted = ratio.ceil() * (self.duration_s() / period_s + 1.0);
        if !(wanted <= MOST_ROWS && wanted <= MOST_ROWS_EACH * self.len() as f64) {
            let (rows, duration_s) = (self.len(), self.duration_s());
            return Err(LogFault::TooManyRows { rows, duration_s, wanted, period_s, most: MOST_ROWS }.at(&self.path));
        }
        let factor = whole_factor(ratio);
        let fine_step = period_s / factor as f64;
        let on_grid = self.is_on_grid(fine_step);
        let start = self.t[0];
        let count = ((self.duration_s() / fine_step) * (1.0 + 1e-12) + 1e-6).floor() as usize + 1;
        let last = self.t[self.len() - 1];
        let grid: Vec<f64> = (0..count).map(|k| (start + k as f64 * fine_step).min(last)).collect();
        let interpolated = if on_grid {
            let t = (0..self.len()).map(|k| start + k as f64 * fine_step).collect();
            self.map(t, |_, signal| signal.to_vec())
        } else {
            self.map(grid.clone(), |group, signal| match group {
                Group::Temperature => linear(&self.t, signal, &grid),
                _ => spline(&self.t, signal, &grid),
            })
        };
        let result = if factor == 1 {
            interpolated
        } else {
            let least = 2 * Decimator::EDGE * factor + 1;
            if interpolated.len() < least {
                let purpose = "for the low-pass before rows are dropped";
                return Err(LogFault::TooFewRows { rows: interpolated.len(), least, purpose }.at(&self.path));
            }
            let low_pass = Decimator::new(factor);
            let centre = |k: usize| start + (k + Decimator::EDGE) as f64 * period_s;
            let rows = low_pass.apply(&interpolated.t).len();
            interpolated.map((0..rows).map(centre).collect(), |_, signal| low_pass.apply(signal))
        };
        report.rows_out = result.len();
        report.method = match (on_grid, factor) {
            (true, 1) => Method::AsLogged,
            (false, 1) => Method::Interpolated,
            (true, factor) => Method::Decimated { factor },
            (false, factor) => Method::InterpolatedAndDecimated { factor },
        };
        Ok((result, report))
    }

    /// The usual (median) step of time \[s\]. Zero for a log of one row.
    pub fn median_step_s(&self) -> f64 {
        let mut steps: Vec<f64> = self.t.windows(2).map(|w| w[1] - w[0]).collect();
        let middle = steps.len() / 2;
        if steps.is_empty() { 0.0 } else { *steps.select_nth_unstable_by(middle, f64::total_cmp).1 }
    }

    fn is_on_grid(&self, step: f64) -> bool {
        let on = |(k, t): (usize, &f64)| (t - self.t[0] - k as f64 * step).abs() <= GRID_TOLERANCE * step;
        self.t.iter().enumerate().all(on)
    }

    fn describe_time(&self, period_s: f64) -> ResampleReport {
        let median_step_s = self.median_step_s();
        let (mut gaps, mut missing, mut square, mut regular) = (Vec::new(), 0, 0.0, 0_usize);
        for (k, w) in self.t.windows(2).enumerate() {
            let step = w[1] - w[0];
            let steps = (step / median_step_s).round();
            let lacks = steps >= 2.0 && (step / median_step_s - steps).abs() < WHOLE;
            missing += if lacks { steps as usize - 1 } else { 0 };
            if step > GAP_STEPS * median_step_s {
                gaps.push(Gap { row: k + 2, from_s: w[0], length_s: step });
            } else if !lacks {
                square += (step - median_step_s).powi(2);
                regular += 1;
            }
        }
        ResampleReport {
            rows_in: self.len(),
            rows_out: self.len(),
            mean_rate_hz: (self.len() - 1) as f64 / self.duration_s(),
            median_step_s,
            jitter_s: (square / regular.max(1) as f64).sqrt(),
            stamps_jitter_s: self.stamps_jitter_s(),
            off_s: self.off_s,
            missing,
            crowded: self.crowded,
            gaps,
            repeated: self.q.iter().map(|q| repeated_share(q)).collect(),
            period_s,
            method: Method::AsLogged,
        }
    }
}

/// Rows of the fine grid a new row, for a wanted step of `ratio` usual steps: the whole number nearby, else the next one
/// (interpolating upwards loses nothing). A step up to 10 % longer than the log's is still the log's own rate: nothing
/// folds back that matters.
fn whole_factor(ratio: f64) -> usize {
    let near = ratio.round();
    let factor = if ratio <= 1.1 || (ratio - near).abs() < 0.01 * ratio { near } else { ratio.ceil() };
    (factor as usize).max(1)
}

/// Share of the rows in motion whose position equals the one before. In motion: over ten rows either side the position
/// moves by more than four of its smallest steps, so that a slow joint's coarse encoder is not called a stair-case.
pub(crate) fn repeated_share(q: &[f64]) -> f64 {
    const REACH: usize = 10;
    let steps = q.windows(2).map(|w| (w[1] - w[0]).abs()).filter(|step| *step > 0.0);
    let quantum = steps.fold(f64::INFINITY, f64::min);
    let (mut moving, mut repeated) = (0_usize, 0_usize);
    for k in REACH..q.len().saturating_sub(REACH) {
        let travel = (q[k + REACH] - q[k - REACH]).abs();
        if travel > (2 * REACH) as f64 * 4.0 * quantum {
            moving += 1;
            repeated += usize::from(q[k] == q[k - 1]);
        }
    }
    if moving == 0 { 0.0 } else { repeated as f64 / moving as f64 }
}

impl fmt::Display for ResampleReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} rows at {:.1} Hz (usual step {:.3} ms, jitter {:.3} ms rms)",
            self.rows_in,
            self.mean_rate_hz,
            1e3 * self.median_step_s,
            1e3 * self.jitter_s
        )?;
        if let Some(jitter_s) = self.stamps_jitter_s {
            let ms = 1e3 * jitter_s;
            write!(f, ", time stamps jitter by {ms:.3} ms rms and positions are even: taken as even")?;
        }
        if self.missing > 0 {
            write!(
                f,
                ", {} missing",
                if self.missing == 1 { "1 row".to_owned() } else { format!("{} rows", self.missing) }
            )?;
        }
        if self.crowded > 0 {
            let rows = if self.crowded == 1 { "1 row".to_owned() } else { format!("{} rows", self.crowded) };
            write!(f, ", {rows} right after another taken together with it")?;
        }
        let longest = self.gaps.iter().max_by(|a, b| a.length_s.total_cmp(&b.length_s));
        if let Some(longest) = longest {
            let (count, ms) = (self.gaps.len(), 1e3 * longest.length_s);
            let ending = if count == 1 { "" } else { "s" };
            write!(f, ", {count} gap{ending}, the longest {ms:.1} ms before row {}", longest.row)?;
        }
        let rate = 1.0 / self.period_s;
        match self.method {
            Method::AsLogged => write!(f, "; used as logged")?,
            Method::Interpolated => write!(f, "; cubic splines to {rate:.1} Hz")?,
            Method::Decimated { factor } => {
                write!(f, "; zero-phase low-pass on every signal, then every {factor}. row ({rate:.1} Hz)")?;
            }
            Method::InterpolatedAndDecimated { factor } => write!(
                f,
                "; cubic splines to {:.1} Hz, zero-phase low-pass on every signal, every {factor}. row ({rate:.1} Hz)",
                rate * factor as f64
            )?,
        }
        write!(f, "; {} rows", self.rows_out)?;
        if self.repeated.iter().any(|share| *share > 0.02) {
            let shares: Vec<String> = self.repeated.iter().map(|s| format!("{:.0}", 100.0 * s)).collect();
            write!(f, "; stair-case positions, {} % of the rows in motion repeat", shares.join(" "))?;
        }
        Ok(())
    }
}
