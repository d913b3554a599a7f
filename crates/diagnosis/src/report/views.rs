//! The gap by travel since reversal, load, power, torque, time, pose and frequency.
//!
//! Rows count where the joint moves and the direction of friction is sure: what a joint that stands holds by friction no model
//! tells, and a division that follows its stops would find little else. Standing is a cell of its own; bands of frequency are of all rows.

use std::f64::consts::TAU;

use crate::fit::stages::Stages;
use crate::policy::POLICY;
use crate::report::regimes::Cell;
use crate::screen::prepared::Prepared;

/// Ways to divide the rows of a joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Axis {
    /// Way since the last reversal: bristles and gears bend before they slide.
    Travel,
    /// Size of the torque that the bodies put on the gear by the nominal model.
    Load,
    /// Whether the drive puts energy in or takes it out.
    Power,
    /// Size of the measured torque.
    Torque,
    /// Time since the run began: joints warm up.
    Time,
    /// Position of the joint.
    Pose,
    /// Frequency of what is missed.
    Frequency,
}

impl Axis {
    /// All of them.
    pub const ALL: [Axis; 7] =
        [Axis::Travel, Axis::Load, Axis::Power, Axis::Torque, Axis::Time, Axis::Pose, Axis::Frequency];

    /// The name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Axis::Travel => "travel",
            Axis::Load => "load",
            Axis::Power => "power",
            Axis::Torque => "torque",
            Axis::Time => "time",
            Axis::Pose => "pose",
            Axis::Frequency => "frequency",
        }
    }

    /// Names of its parts in reports, in order.
    pub fn parts(self) -> &'static [&'static str] {
        match self {
            Axis::Travel => &["presliding", "beyond"],
            Axis::Power => &["driving", "driven", "standing"],
            Axis::Load | Axis::Torque => &["low", "middle", "high"],
            Axis::Time => &["first", "second", "third"],
            Axis::Pose => &["lower", "middle", "upper"],
            Axis::Frequency => &["below_1_hz", "1_to_5_hz", "above_5_hz"],
        }
    }

    /// Unit of the parts' ends; empty where they have none.
    pub fn unit(self) -> &'static str {
        match self {
            Axis::Travel | Axis::Pose => "rad",
            Axis::Load | Axis::Torque => "N m",
            Axis::Power => "",
            Axis::Time => "s",
            Axis::Frequency => "Hz",
        }
    }

    /// Parts that may be held against each other. What is missed goes with motion, which is slow: that one band has more of it than
    /// another says nothing. Nor does standing.
    fn comparable(self) -> usize {
        match self {
            Axis::Power => 2,
            Axis::Frequency => 0,
            _ => self.parts().len(),
        }
    }
}

/// Half a degree of the joint: by then gears have wound up and bristles bent.
const PRESLIDING: f64 = 0.0087;
/// A reversal is a way back of this many deviations of the position's noise, and at least so far \[rad\].
const BACK: (f64, f64) = (6.0, 2e-5);
/// A joint stands below this share of its top speed, and below this speed \[rad/s\].
const STANDS: (f64, f64) = (0.005, 1e-3);
/// Bands of frequency \[Hz\].
const BANDS: [f64; 2] = [1.0, 5.0];
/// Length of a segment of the spectrum \[s\]: five periods of the lowest bound.
const VIEW_SEGMENT_S: f64 = 5.12;

/// A part of a joint's rows.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// The joint's name.
    pub joint: String,
    /// What its rows are divided by.
    pub axis: Axis,
    /// Which part, of [`Axis::parts`].
    pub part: &'static str,
    /// Where the part begins and ends, in [`Axis::unit`].
    pub ends: Option<[f64; 2]>,
    /// How many rows.
    pub rows: usize,
    /// How long \[s\].
    pub seconds: f64,
    /// Stretches of half a second that have some of them.
    pub stretches: usize,
    /// Whether these are enough to say anything.
    pub known: bool,
    /// Root mean square of the residual of the nominal model there \[N·m\].
    pub before_nm: f64,
    /// With all causes.
    pub after_nm: f64,
    /// Noise of the joint's torque \[N·m\].
    pub floor_nm: f64,
}

/// The axis along which the gap of a joint is most uneven.
#[derive(Clone, Debug, PartialEq)]
pub struct Contrast {
    /// The joint's name.
    pub joint: String,
    /// What its rows are divided by.
    pub axis: Axis,
    /// The part that is missed most.
    pub more: &'static str,
    /// The part that is missed least.
    pub less: &'static str,
    /// Root mean square of what the model as given leaves in the one over that in the other, the noise at least.
    pub ratio: f64,
}

/// All of them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Views {
    /// By joint, axis, part. A joint whose load or pose hardly changes has no cells of it, one that says nothing has none at all.
    pub cells: Vec<View>,
    /// The most uneven division of what the model as given leaves; none where all are about even.
    pub contrast: Option<Contrast>,
}

/// Of the sealed run. `load[joint][row]`: torque of the bodies; `noise`: what the model with its values refitted leaves of each
/// joint's torque \[N·m\], to measure doubt about friction by.
pub(crate) fn tabulate(run: &Prepared, stages: &Stages, load: &[Vec<f64>], noise: &[f64], names: &[String]) -> Views {
    let (given, full) = (&stages.models[0], &stages.models[stages.models.len() - 1]);
    let residual =
        |j: usize, model: &[f64]| -> Vec<f64> { stages.tau[j].iter().zip(model).map(|(t, m)| t - m).collect() };
    let trusted: Vec<usize> = (0..names.len()).filter(|j| run.silent[*j].is_none()).collect();
    let joints: Vec<Joint> = trusted
        .iter()
        .map(|&j| {
            let speed = run.chain.sample(&run.motion.qd[j]);
            let top = speed.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            let stands = (STANDS.0 * top).max(STANDS.1).max(run.blur[j]);
            let back = (BACK.0 * run.position_noise[j]).max(BACK.1);
            Joint {
                before: residual(j, &given[j]),
                after: residual(j, &full[j]),
                floor: run.floor[j],
                row_s: run.chain.row_period_s,
                highest_hz: run.chain.cutoff_hz(),
                stands: speed.iter().map(|v| v.abs() < stands).collect(),
                sure: run.doubt[j].iter().map(|doubt| *doubt <= noise[j]).collect(),
                position: run.chain.sample(&run.motion.q[j]),
                travel: run.chain.sample(&travel(&run.motion.q[j], back)),
                load: load[j].iter().map(|t| t.abs()).collect(),
                tau: stages.tau[j].clone(),
                speed,
            }
        })
        .collect();
    let gaps: Vec<f64> = joints.iter().map(|j| square(&j.before) / square(&j.tau).max(f64::MIN_POSITIVE)).collect();
    let total = gaps.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    let mut views = Views::default();
    for ((joint, j), gap) in joints.iter().zip(trusted).zip(gaps) {
        for axis in Axis::ALL {
            let parts = joint.parts(axis);
            let uneven = contrast(axis, &parts, joint.floor).filter(|_| gap >= POLICY.views.min_gap_share * total);
            if let Some((more, less, ratio)) = uneven
                && views.contrast.as_ref().is_none_or(|c| ratio > c.ratio)
            {
                let [more, less] = [more, less].map(|p| axis.parts()[p]);
                views.contrast = Some(Contrast { joint: names[j].clone(), axis, more, less, ratio });
            }
            views.cells.extend(parts.iter().zip(axis.parts()).map(|(part, name)| View {
                joint: names[j].clone(),
                axis,
                part: name,
                ends: part.ends,
                rows: part.rows,
                seconds: part.rows as f64 * joint.row_s,
                stretches: part.stretches,
                known: part.known,
                before_nm: part.before.sqrt(),
                after_nm: part.after.sqrt(),
                floor_nm: joint.floor,
            }));
        }
    }
    views
}

/// What a joint did and what two models leave of its torque, row by row.
struct Joint {
    before: Vec<f64>,
    after: Vec<f64>,
    floor: f64,
    row_s: f64,
    /// Above this nothing is left of the rows \[Hz\].
    highest_hz: f64,
    stands: Vec<bool>,
    /// Whether the direction of friction is.
    sure: Vec<bool>,
    speed: Vec<f64>,
    position: Vec<f64>,
    /// Not a number before the first reversal, as long as it may be near.
    travel: Vec<f64>,
    load: Vec<f64>,
    tau: Vec<f64>,
}

/// Rows of one part; mean squares \[N²·m²\].
#[derive(Clone, Debug, Default)]
struct Part {
    ends: Option<[f64; 2]>,
    rows: usize,
    stretches: usize,
    known: bool,
    before: f64,
    after: f64,
    /// Of the measured torque.
    torque: f64,
    /// Relative standard deviation of `before`, from stretch to stretch.
    unsure: f64,
}

impl Joint {
    /// In the order of [`Axis::parts`]; none where there is nothing to divide by.
    fn parts(&self, axis: Axis) -> Vec<Part> {
        match axis {
            Axis::Travel => {
                let farthest = self.moving(&self.travel).fold(0.0, f64::max);
                let bounds = [0.0, PRESLIDING, farthest.max(PRESLIDING)];
                self.by(&bounds, &self.travel)
            }
            Axis::Load => self.thirds(&self.load, POLICY.views.min_spread * self.floor),
            Axis::Torque => {
                let size: Vec<f64> = self.tau.iter().map(|t| t.abs()).collect();
                self.thirds(&size, POLICY.views.min_spread * self.floor)
            }
            Axis::Pose => self.thirds(&self.position, POLICY.views.min_range_rad),
            Axis::Time => {
                let time: Vec<f64> = (0..self.before.len()).map(|k| k as f64 * self.row_s).collect();
                let end = self.before.len() as f64 * self.row_s;
                self.by(&[0.0, end / 3.0, end / 1.5, end], &time)
            }
            Axis::Power => {
                let part = |k: usize| match self.tau[k] * self.speed[k] {
                    _ if self.stands[k] => Some(2),
                    _ if !self.sure[k] => None,
                    power if power > 0.0 => Some(0),
                    power if power < 0.0 => Some(1),
                    _ => None,
                };
                (0..3).map(|p| self.part(|k| part(k) == Some(p), None)).collect()
            }
            Axis::Frequency => self.bands(),
        }
    }

    fn moves(&self, k: usize) -> bool {
        !self.stands[k] && self.sure[k]
    }

    fn moving<'a>(&'a self, of: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        (0..of.len()).filter(|k| self.moves(*k)).map(|k| of[k])
    }

    /// Three parts of the range of `of` in motion, if that is at least so wide.
    fn thirds(&self, of: &[f64], least: f64) -> Vec<Part> {
        let (low, high) = self.moving(of).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        let third = (high - low) / 3.0;
        // Of no row at all the width is no number.
        if high - low >= least { self.by(&[low, low + third, high - third, high], of) } else { Vec::new() }
    }

    /// Rows in motion between bounds of `of`.
    fn by(&self, bounds: &[f64], of: &[f64]) -> Vec<Part> {
        let last = bounds.len() - 2;
        let within = |p: usize, v: f64| (p == 0 || v >= bounds[p]) && (p == last || v < bounds[p + 1]) && !v.is_nan();
        let ends = |p: usize| Some([bounds[p], bounds[p + 1]]);
        (0..=last).map(|p| self.part(|k| self.moves(k) && within(p, of[k]), ends(p))).collect()
    }

    fn part(&self, is_in: impl Fn(usize) -> bool, ends: Option<[f64; 2]>) -> Part {
        let length = (POLICY.views.independent_rows_s / self.row_s).round().max(1.0) as usize;
        let count = self.before.len();
        // Rows and sums of squares by stretch.
        let mut sums: Vec<[f64; 4]> = Vec::new();
        for from in (0..count).step_by(length) {
            let inside = (from..(from + length).min(count)).filter(|k| is_in(*k));
            let mut sum = [0.0; 4];
            for k in inside {
                let row = [1.0, self.before[k].powi(2), self.after[k].powi(2), self.tau[k].powi(2)];
                sum.iter_mut().zip(row).for_each(|(s, v)| *s += v);
            }
            if sum[0] > 0.0 {
                sums.push(sum);
            }
        }
        let [rows, before, after, torque] = [0, 1, 2, 3].map(|of| sums.iter().map(|s| s[of]).sum::<f64>());
        let mean = before / f64::max(rows, 1.0);
        let n = sums.len() as f64;
        let scatter = sums.iter().map(|s| (s[1] - mean * s[0]).powi(2)).sum::<f64>() * n / (n - 1.0).max(1.0);
        Part {
            ends,
            rows: rows as usize,
            stretches: sums.len(),
            known: sums.len() >= POLICY.views.min_stretches && rows * self.row_s >= Cell::MIN_REGIME_TIME_S,
            before: mean,
            after: after / f64::max(rows, 1.0),
            torque: torque / f64::max(rows, 1.0),
            unsure: scatter.sqrt() / before.max(f64::MIN_POSITIVE),
        }
    }

    /// What is missed, by frequency, of all rows.
    fn bands(&self) -> Vec<Part> {
        let whole = self.part(|_| true, None);
        let [before, after] = [&self.before, &self.after].map(|x| shares(x, self.row_s));
        let long = self.before.len() as f64 * self.row_s >= VIEW_SEGMENT_S;
        let bounds = [0.0, BANDS[0], BANDS[1], 0.5 / self.row_s];
        (0..3)
            .map(|b| Part {
                ends: Some([bounds[b], bounds[b + 1].max(bounds[b])]),
                known: whole.known && long && self.highest_hz > bounds[b],
                before: whole.before * before[b],
                after: whole.after * after[b],
                ..whole.clone()
            })
            .collect()
    }
}

fn square(x: &[f64]) -> f64 {
    x.iter().map(|v| v * v).sum()
}

/// Shares of the power below, between and above [`BANDS`]: Hann windows, half overlapped (Welch 1967). What is above comes by
/// Parseval's theorem from the rest, so that only low frequencies are looked up.
fn shares(x: &[f64], row_s: f64) -> [f64; 3] {
    let n = ((VIEW_SEGMENT_S / row_s).round() as usize).min(x.len());
    if n < 16 {
        return [0.0; 3];
    }
    let window: Vec<f64> = (0..n).map(|k| 0.5 - 0.5 * (TAU * (k as f64 + 0.5) / n as f64).cos()).collect();
    let step_hz = 1.0 / (n as f64 * row_s);
    let bins = ((BANDS[1] / step_hz).ceil() as usize).min(n / 2);
    let turns: Vec<(f64, f64)> = (0..n).map(|k| (TAU * k as f64 / n as f64).sin_cos()).collect();
    let mut power = [0.0; 2];
    let mut total = 0.0;
    for from in (0..=x.len() - n).step_by((n / 2).max(1)) {
        let cut: Vec<f64> = x[from..from + n].iter().zip(&window).map(|(x, w)| x * w).collect();
        total += n as f64 * square(&cut);
        for bin in 0..bins {
            let (mut re, mut im) = (0.0, 0.0);
            for (k, v) in cut.iter().enumerate() {
                let (s, c) = turns[k * bin % n];
                re += v * c;
                im += v * s;
            }
            let sides = if bin == 0 { 1.0 } else { 2.0 };
            power[usize::from(bin as f64 * step_hz >= BANDS[0])] += sides * (re * re + im * im);
        }
    }
    let [low, middle] = power.map(|p| p / f64::max(total, f64::MIN_POSITIVE));
    [low, middle, if total > 0.0 { (1.0 - low - middle).max(0.0) } else { 0.0 }]
}

/// Parts that are missed most and least, and the ratio; none where it is not surely above `POLICY.views.min_contrast` or all is next to noise.
fn contrast(axis: Axis, parts: &[Part], floor: f64) -> Option<(usize, usize, f64)> {
    let known = || (0..axis.comparable().min(parts.len())).filter(|p| parts[*p].known);
    let most = known().max_by(|a, b| parts[*a].before.total_cmp(&parts[*b].before))?;
    let least = known().min_by(|a, b| parts[*a].before.total_cmp(&parts[*b].before))?;
    let (more, less) = (&parts[most], &parts[least]);
    let ratio = (more.before / less.before.max(floor * floor).max(f64::MIN_POSITIVE)).sqrt();
    // A root's relative deviation is half of its square's.
    let unsure = 0.5 * more.unsure.hypot(less.unsure);
    // Of torque itself what is missed is a part: a share of it that is everywhere the same is even.
    let due =
        if axis == Axis::Torque { (more.torque / less.torque.max(f64::MIN_POSITIVE)).sqrt().max(1.0) } else { 1.0 };
    let sure = (ratio / due).ln() - POLICY.views.min_contrast_sigmas * unsure > POLICY.views.min_contrast.ln();
    (most != least && sure && more.before.sqrt() > POLICY.held_out.min_gap_in_motion * floor)
        .then_some((most, least, ratio))
}

/// Way since the joint last turned back by more than `back` \[rad\]; steps and noise of a position are no reversals. Before the
/// first one it is not a number until it must be beyond what counts as near.
fn travel(q: &[f64], back: f64) -> Vec<f64> {
    let first = q.first().copied().unwrap_or(0.0);
    let (mut low, mut high) = (first, first);
    // Where it turned, and whether it goes up since.
    let mut turned: Option<(f64, bool)> = None;
    let mut began: Option<bool> = None;
    q.iter()
        .map(|now| {
            low = low.min(*now);
            high = high.max(*now);
            let up = turned.map(|(_, up)| up).or(began);
            match up {
                None if high - low > back => began = Some(*now >= high),
                Some(true) if high - now > back => {
                    turned = Some((high, false));
                    low = *now;
                }
                Some(false) if now - low > back => {
                    turned = Some((low, true));
                    high = *now;
                }
                _ => {}
            }
            let way = (now - turned.map_or(first, |(at, _)| at)).abs();
            if turned.is_none() && way < PRESLIDING { f64::NAN } else { way }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROW_S: f64 = 0.01;

    /// A joint that swings ±1 rad once in 4 s for a minute, carried by friction of 5 N m and pulled by 20 N m along cos of its angle, and
    /// what is missed of it.
    fn joint(missed: impl Fn(f64, f64, f64) -> f64) -> Joint {
        let time: Vec<f64> = (0..6000).map(|k| f64::from(k) * ROW_S).collect();
        let turn = TAU / 4.0;
        let position: Vec<f64> = time.iter().map(|t| (turn * t).sin()).collect();
        let speed: Vec<f64> = time.iter().map(|t| turn * (turn * t).cos()).collect();
        let tau: Vec<f64> = position.iter().zip(&speed).map(|(q, v)| 5.0 * v.signum() + 20.0 * q.sin()).collect();
        // Noise whose sign no division follows.
        let noise = |k: usize| if (k * 7919) % 13 < 6 { 0.01 } else { -0.01 };
        let before = (0..time.len()).map(|k| missed(time[k], tau[k], speed[k]) + noise(k)).collect();
        Joint {
            before,
            after: (0..time.len()).map(noise).collect(),
            floor: 0.01,
            row_s: ROW_S,
            highest_hz: 30.0,
            stands: speed.iter().map(|v| v.abs() < 0.01).collect(),
            sure: vec![true; time.len()],
            load: position.iter().map(|q| 20.0 * q.sin().abs()).collect(),
            travel: travel(&position, 1e-4),
            speed,
            position,
            tau,
        }
    }

    fn rms(parts: &[Part]) -> Vec<f64> {
        parts.iter().map(|p| p.before.sqrt()).collect()
    }

    /// 2 N m that are missed whenever the load drives the joint, and then only.
    #[test]
    fn what_is_missed_when_driven_lies_in_that_cell_only() {
        let joint = joint(|_, tau, speed| if tau * speed < 0.0 { 2.0 } else { 0.0 });
        let parts = joint.parts(Axis::Power);
        let [driving, driven, _] = rms(&parts)[..] else { panic!("three parts") };
        assert!((driven - 2.0).abs() < 0.02 && driving < 0.02, "{driving} {driven}");
        assert!(parts[..2].iter().all(|p| p.known && p.after.sqrt() < 0.02));
        // It stands for two moments of each swing.
        assert!(parts[2].rows > 0 && parts.iter().map(|p| p.rows).sum::<usize>() == 6000);
        let (more, less, ratio) = contrast(Axis::Power, &parts, joint.floor).expect("a contrast");
        assert_eq!((more, less), (1, 0));
        assert!((ratio - driven / driving.max(joint.floor)).abs() < 1e-9, "{ratio}");
        // Thirds of the run have the same swings.
        let thirds = rms(&joint.parts(Axis::Time));
        assert!(thirds.iter().all(|t| (t / thirds[0] - 1.0).abs() < 0.02), "{thirds:?}");
        assert_eq!(contrast(Axis::Time, &joint.parts(Axis::Time), joint.floor), None);
    }

    /// A joint whose misfit grows along with the run, 1 N m then 2 then 3: half of that is left of each with the causes.
    #[test]
    fn warming_lies_in_thirds_of_the_run() {
        let third = |t: f64| (t / 20.0).floor() + 1.0;
        let mut joint = joint(|t, _, _| third(t));
        joint.after = joint.before.iter().map(|b| 0.5 * b).collect();
        let parts = joint.parts(Axis::Time);
        for (k, part) in parts.iter().enumerate() {
            assert!((part.before.sqrt() - (k as f64 + 1.0)).abs() < 0.01, "{part:?}");
            assert!((part.after / part.before - 0.25).abs() < 1e-9);
        }
        assert!(contrast(Axis::Time, &parts, joint.floor).is_some_and(|(more, less, _)| (more, less) == (2, 0)));
        // What is four times the noise at most is no contrast, whatever its division.
        assert_eq!(contrast(Axis::Time, &parts, 0.8), None);
    }

    #[test]
    fn load_torque_and_pose_are_thirds_of_their_ranges_in_motion() {
        let joint = joint(|_, tau, _| if tau > 14.0 { 1.0 } else { 0.0 });
        for axis in [Axis::Load, Axis::Torque, Axis::Pose] {
            let parts = joint.parts(axis);
            assert_eq!(parts.len(), axis.parts().len());
            let ends: Vec<[f64; 2]> = parts.iter().filter_map(|p| p.ends).collect();
            assert!(ends.windows(2).all(|w| (w[0][1] - w[1][0]).abs() < 1e-12 && w[0][0] < w[1][0]), "{ends:?}");
            assert_eq!(parts.iter().map(|p| p.rows).sum::<usize>(), joint.stands.iter().filter(|s| !**s).count());
        }
        let upper = rms(&joint.parts(Axis::Pose));
        assert!(upper[2] > 0.5 && upper[0] < 0.02, "{upper:?}");
        // A vertical axis has no load to divide by, and one that hardly turns no pose.
        assert!(Joint { load: vec![0.02; 6000], ..joint }.parts(Axis::Load).is_empty());
    }

    /// The sine's 3 Hz and its 12 N m amplitude: all of its power, 72 N²m², is between 1 and 5 Hz.
    #[test]
    fn a_sine_lies_in_its_band_of_frequency() {
        let joint = joint(|t, _, _| 12.0 * (TAU * 3.0 * t).sin());
        let parts = joint.parts(Axis::Frequency);
        let of = |b: usize| parts[b].before;
        assert!((of(1) - 72.0).abs() < 0.1 && of(0) < 1e-3 && of(2) < 0.1, "{parts:?}");
        assert!(parts.iter().all(|p| p.known));
        // A constant is below 1 Hz, and white noise spreads as the bands are wide.
        let [low, middle, high] = shares(&vec![3.0; 6000], ROW_S);
        assert!(low > 1.0 - 1e-6 && middle < 1e-6 && high < 1e-6);
        assert_eq!(contrast(Axis::Frequency, &parts, joint.floor), None);
        // Rows of 4 a second hold nothing above 2 Hz.
        let slow = Joint { row_s: 0.25, highest_hz: 2.0, ..joint };
        assert!(slow.parts(Axis::Frequency).iter().map(|p| p.known).eq([true, true, false]));
    }

    /// A tenth of the torque is missed more where there is more torque, which says nothing; its cube is missed unevenly.
    #[test]
    fn a_share_of_the_torque_is_no_contrast_between_torques() {
        let axis = Axis::Torque;
        let share = joint(|_, tau, _| 0.1 * tau);
        assert!(rms(&share.parts(axis))[2] > 2.0 * rms(&share.parts(axis))[0]);
        assert_eq!(contrast(axis, &share.parts(axis), share.floor), None);
        let cube = joint(|_, tau, _| 1e-3 * tau.powi(3));
        assert!(contrast(axis, &cube.parts(axis), cube.floor).is_some_and(|(more, less, _)| (more, less) == (2, 0)));
    }

    /// Rows of a second are long enough, but of two stretches only.
    #[test]
    fn too_few_stretches_say_nothing() {
        let joint = joint(|t, _, _| if t < 1.0 { 5.0 } else { 0.0 });
        let first = joint.part(|k| k < 100, None);
        assert!(!first.known && first.rows == 100 && first.stretches == 2 && first.before > 20.0);
        let rest = joint.part(|k| k >= 100, None);
        assert!(rest.known && rest.stretches == 118);
        assert_eq!(contrast(Axis::Time, &[first, rest.clone(), rest], joint.floor), None);
        assert!(!joint.part(|_| false, None).known);
    }

    /// Up by 1, back by 0.4 with a step that is no reversal, up again.
    #[test]
    fn way_begins_anew_where_the_joint_turns_back_and_noise_is_no_reversal() {
        let found = travel(&[0.0, 0.001, 0.5, 0.4999, 1.0, 0.8, 0.8001, 0.6, 0.7], 2e-4);
        assert!(found[0].is_nan() && found[1].is_nan(), "near the beginning nobody knows");
        for (found, due) in found[2..].iter().zip([0.5, 0.4999, 1.0, 0.2, 0.1999, 0.4, 0.1]) {
            assert!((found - due).abs() < 1e-12, "{found} {due}");
        }
        // A swing has gone 0.0087 rad of its 2 when it is arccos(1 - 0.0087) beyond its turn, 0.084 s.
        let joint = joint(|_, _, _| 0.0);
        let parts = joint.parts(Axis::Travel);
        let near = parts[0].rows as f64 * ROW_S / 30.0;
        assert!((near - 0.084).abs() < 0.02 && parts[0].known, "{near}");
    }
}
