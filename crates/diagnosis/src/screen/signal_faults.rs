//! Faults of single signals: spikes, wraps, frozen channels and steps, with their repair, and estimates of noise and resolution.

use std::f64::consts::TAU;
use std::ops::Range;

use crate::model::log_fault::LogFault;
use crate::model::run::Run;
use crate::policy::POLICY;

/// Mends what can be mended and cuts what cannot.
pub(crate) fn mend(run: Run) -> (Run, Vec<(usize, LogFault)>) {
    let mut run = run;
    let mut found = Vec::new();
    if let Some((joints, samples, slower)) = at_own_rate(&run, &run.q) {
        let fault = LogFault::Held { samples, seconds: slower.period_s };
        found.extend(joints.first().map(|j| (*j, fault)));
        run = slower;
    }
    if let Some((joints, samples, slower)) = at_own_rate(&run, &run.tau) {
        let fault = LogFault::TorqueHeld { samples, seconds: slower.period_s };
        found.extend(joints.into_iter().map(|j| (j, fault)));
        run = slower;
    }
    let samples = run.len();
    // Where the run is cut in two, and whose fault it is.
    let mut cuts: Vec<Range<usize>> = Vec::new();
    for (j, stretch) in frozen(&run) {
        let [from, seconds] = [stretch.start, stretch.len()].map(|samples| samples as f64 * run.period_s);
        found.push((j, LogFault::Frozen { from, seconds }));
        cuts.push(stretch);
    }
    for j in 0..run.joints() {
        if let Some(size) = mend_spikes(&mut run.tau[j], run.period_s) {
            found.push((j, LogFault::Spikes { samples: size.0, torque: size.1 }));
        }
        let jumps = jumps(&run.q[j], &cuts);
        let (mut wraps, mut glitches) = (0, 0);
        for at in jumps {
            let q = &mut run.q[j];
            let turns = ((q[at] - q[at - 1]) / TAU).round();
            if turns != 0.0 && (q[at] - q[at - 1] - turns * TAU).abs() < POLICY.signal_faults.min_jump_rad.max(0.1) {
                q[at..].iter_mut().for_each(|q| *q -= turns * TAU);
                wraps += 1;
                continue;
            }
            let jump = q[at] - q[at - 1];
            let usual = |to: usize| (q[to] - q[at - 1]).abs() < 0.2 * jump.abs();
            if jump.abs() < POLICY.signal_faults.min_jump_rad {
                continue; // The way back of a glitch that is mended by now.
            }
            if let Some(back) =
                (at + 1..(at + 1 + POLICY.signal_faults.max_glitch_samples).min(samples)).find(|to| usual(*to))
            {
                let (from, to) = (q[at - 1], q[back]);
                let span = (back + 1 - at) as f64;
                for k in at..back {
                    q[k] = from + (to - from) * (k + 1 - at) as f64 / span;
                }
                glitches += 1;
            } else {
                found.push((j, LogFault::Jump { at: at as f64 * run.period_s, by: jump }));
                cuts.push(at..at);
            }
        }
        if wraps > 0 {
            found.push((j, LogFault::Wrapped(wraps)));
        }
        if glitches > 0 {
            found.push((j, LogFault::Glitches(glitches)));
        }
    }
    if cuts.is_empty() { (run, found) } else { (longest(run, cuts), found) }
}

/// The run at the rate at which these signals of it come, where each value is held for so many samples; of which joints, and how many.
fn at_own_rate(run: &Run, signals: &[Vec<f64>]) -> Option<(Vec<usize>, usize, Run)> {
    let holds: Vec<Option<(usize, usize)>> = signals.iter().map(|q| hold_period(q)).collect();
    let (first, every) = holds.iter().flatten().copied().next()?;
    let joints = (0..holds.len()).filter(|j| holds[*j].is_some()).collect();
    // Of one clock, or of none.
    let other = |h: &(usize, usize)| h.1 != every || h.0 % every != first % every;
    if holds.iter().flatten().any(other) {
        return None;
    }
    let decimated =
        |s: &Vec<Vec<f64>>| s.iter().map(|s| s.iter().skip(first % every).step_by(every).copied().collect()).collect();
    Some((joints, every, run.each(every as f64 * run.period_s, decimated)))
}

/// Where a signal changes and after how many samples it changes again, if it is held for as many each time.
fn hold_period(q: &[f64]) -> Option<(usize, usize)> {
    let least = POLICY.signal_faults.min_change_in_steps * resolution(q);
    let changes: Vec<usize> = (1..q.len()).filter(|k| (q[*k] - q[*k - 1]).abs() > least).collect();
    let mut spans: Vec<usize> = changes.windows(2).map(|w| w[1] - w[0]).collect();
    spans.sort_unstable();
    let every = *spans.get(spans.len() / 2)?;
    let (agree, first) = (spans.iter().filter(|s| **s == every).count(), *changes.first()?);
    let plain = agree as f64 >= POLICY.signal_faults.min_held_share * spans.len() as f64;
    (every > 1 && spans.len() >= POLICY.signal_faults.min_held_changes && plain).then_some((first, every))
}

/// The longest stretch between cuts.
fn longest(run: Run, mut cuts: Vec<Range<usize>>) -> Run {
    cuts.sort_by_key(|cut| cut.start);
    let starts = std::iter::once(0).chain(cuts.iter().map(|cut| cut.end));
    let ends = cuts.iter().map(|cut| cut.start).chain([run.len()]);
    let stretch = starts.zip(ends).filter(|(a, b)| b > a).map(|(a, b)| a..b).max_by_key(ExactSizeIterator::len);
    let Some(stretch) = stretch else { return run };
    let (from, to) = (stretch.start as f64 * run.period_s, stretch.end as f64 * run.period_s);
    let name = format!("{} ({from:.1} to {to:.1} s)", run.name);
    run.part(stretch, name)
}

/// Replaces samples that stand out by the median around them: how many, and the farthest one's size. None if none does, or so
/// many that they are the signal.
fn mend_spikes(x: &mut [f64], period_s: f64) -> Option<(usize, f64)> {
    let half =
        ((POLICY.signal_faults.max_spike_s / period_s) as usize).clamp(1, POLICY.signal_faults.max_spike_samples);
    if x.len() < 100 * half {
        return None;
    }
    let usual = medians(x, half);
    let off: Vec<f64> = x.iter().zip(&usual).map(|(x, m)| (x - m).abs()).collect();
    let range =
        usual.iter().fold(f64::NEG_INFINITY, |m, x| m.max(*x)) - usual.iter().fold(f64::INFINITY, |m, x| m.min(*x));
    let outstanding = if half < POLICY.signal_faults.max_spike_samples {
        POLICY.signal_faults.min_spike_share_slow
    } else {
        POLICY.signal_faults.min_spike_share
    };
    let limit = f64::max(outstanding * range, POLICY.signal_faults.min_spike_ratio * quantile(&off, 0.5) / 0.6745);
    let outside: Vec<usize> = (0..x.len()).filter(|k| off[*k] > limit).collect();
    if limit <= 0.0
        || outside.is_empty()
        || outside.len() as f64 > POLICY.signal_faults.max_spike_samples_share * x.len() as f64
    {
        return None;
    }
    let farthest = outside.iter().map(|k| x[*k]).max_by(|a, b| a.abs().total_cmp(&b.abs()))?;
    for k in &outside {
        x[*k] = usual[*k];
    }
    Some((outside.len(), farthest))
}

/// Medians of what is around each sample.
fn medians(x: &[f64], half: usize) -> Vec<f64> {
    let around = |k: usize| {
        let mut near: Vec<f64> = x[k.saturating_sub(half)..(k + half + 1).min(x.len())].to_vec();
        near.sort_by(f64::total_cmp);
        near[near.len() / 2]
    };
    (0..x.len()).map(around).collect()
}

fn quantile(x: &[f64], share: f64) -> f64 {
    let mut x = x.to_vec();
    x.sort_by(f64::total_cmp);
    x.get((share * x.len() as f64) as usize).or(x.last()).copied().unwrap_or(0.0)
}

/// Samples to which a position jumps; what is cut out anyway is nobody's jump.
fn jumps(q: &[f64], cuts: &[Range<usize>]) -> Vec<usize> {
    let steps: Vec<f64> = q.windows(2).map(|w| (w[1] - w[0]).abs()).collect();
    let limit =
        f64::max(POLICY.signal_faults.min_jump_rad, POLICY.signal_faults.min_jump_ratio * quantile(&steps, 0.999));
    let cut = |k: &usize| cuts.iter().any(|cut| cut.start <= *k && *k <= cut.end);
    (1..q.len()).filter(|k| steps[*k - 1] > limit && !cut(k)).collect()
}

/// Stretches over which every channel repeats itself though a joint moved before, and that joint.
fn frozen(run: &Run) -> Vec<(usize, Range<usize>)> {
    let least =
        POLICY.signal_faults.min_frozen_samples.max((POLICY.signal_faults.min_frozen_s / run.period_s).ceil() as usize);
    let channels = || run.q.iter().chain(&run.tau);
    let repeats: Vec<bool> = (1..run.len()).map(|k| channels().all(|c| c[k] == c[k - 1])).collect();
    let (mut at, mut found) = (0, Vec::new());
    for stretch in repeats.chunk_by(|a, b| a == b) {
        let (from, to) = (at + 1, at + 1 + stretch.len());
        at += stretch.len();
        if !stretch[0] || stretch.len() < least || from < 3 {
            continue;
        }
        // Over two steps, so that one step of a coarse encoder is not taken for motion.
        let speed = |q: &Vec<f64>| {
            f64::min((q[from - 1] - q[from - 2]).abs(), (q[from - 2] - q[from - 3]).abs()) / run.period_s
        };
        let fastest = run.q.iter().map(speed).enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
        found.extend(
            fastest
                .filter(|(_, speed)| *speed > POLICY.signal_faults.min_speed_before_frozen_rad_s)
                .map(|(j, _)| (j, from..to)),
        );
    }
    found
}

/// Standard deviation of white noise on a smooth signal: sixth differences leave nothing but it.
pub(crate) fn white_noise(x: &[f64]) -> f64 {
    white_noise_without(x, &[])
}

/// The same by differences that meet none of the rows that were interpolated (ascending).
pub(crate) fn white_noise_without(x: &[f64], interpolated: &[usize]) -> f64 {
    rivet_estimation::offline::white_noise_without(x, 6, interpolated)
}

/// Standard deviation of what a position's steps or noise add to it \[rad\].
pub(crate) fn position_noise(q: &[f64], period_s: f64) -> f64 {
    /// Below this rate motion itself has what white noise has \[s\].
    const MAX_WHITE_NOISE_PERIOD_S: f64 = 0.0021;
    let steps = resolution(q) / 12.0_f64.sqrt();
    if period_s > MAX_WHITE_NOISE_PERIOD_S { steps } else { steps.max(white_noise(q)) }
}

/// The step of which all changes of a position are multiples \[rad\]; 0 without one.
pub(crate) fn resolution(q: &[f64]) -> f64 {
    /// Smaller steps are those of the numbers themselves.
    const MIN_RESOLUTION: f64 = 1e-7;
    /// How near to a multiple, in steps; and of how many changes.
    const MAX_MULTIPLE_ERROR: f64 = 0.02;
    const MIN_MULTIPLE_SHARE: f64 = 0.99;
    let changes: Vec<f64> = q.windows(2).map(|w| (w[1] - w[0]).abs()).filter(|d| *d > MIN_RESOLUTION).collect();
    let step = changes.iter().copied().fold(f64::INFINITY, f64::min);
    // Far multiples tell nothing: the step is not known so well.
    let near: Vec<f64> = changes.iter().map(|d| d / step).filter(|m| *m < 30.0).collect();
    let whole = near.iter().filter(|m| (*m - m.round()).abs() < MAX_MULTIPLE_ERROR).count();
    let enough = near.len() >= 20 && whole as f64 >= MIN_MULTIPLE_SHARE * near.len() as f64;
    if step.is_finite() && enough { step } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_S: f64 = 1e-3;

    fn swing(samples: i32) -> Vec<f64> {
        (0..samples).map(|k| 1.0 - (PERIOD_S * f64::from(k)).cos()).collect()
    }

    /// A joint that swings with 1 rad/s at most, and its torque with noise that no two samples share.
    fn run() -> Run {
        let torque = |k: i32| 5.0 * (PERIOD_S * f64::from(k)).cos() + 0.01 * f64::from(k * 7919 % 101);
        Run {
            name: "swing".to_owned(),
            period_s: PERIOD_S,
            q: vec![swing(8000)],
            tau: vec![(0..8000).map(torque).collect()],
            ..Run::default()
        }
    }

    fn farthest(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).fold(0.0, |m, (a, b)| f64::max(m, (a - b).abs()))
    }

    #[test]
    fn a_sound_run_stays_as_it_is() {
        let (mended, found) = mend(run());
        assert_eq!(mended, run());
        assert!(found.is_empty(), "{found:?}");
        // A step of friction is no spike, nor is a cut command.
        let mut stuck = run();
        stuck.tau[0].iter_mut().enumerate().for_each(|(k, t)| *t = if k % 900 < 450 { 8.0 } else { -8.0 });
        assert_eq!(mend(stuck.clone()), (stuck, Vec::new()));
    }

    #[test]
    fn spikes_are_replaced_and_counted() {
        let mut spiked = run();
        for (at, torque) in [(700, 90.0), (701, 80.0), (5000, -200.0)] {
            spiked.tau[0][at] = torque;
        }
        let (mended, found) = mend(spiked);
        assert_eq!(found, [(0, LogFault::Spikes { samples: 3, torque: -200.0 })]);
        assert!(farthest(&mended.tau[0], &run().tau[0]) < 1.1, "within the noise");
        // What comes again and again is a signal.
        let mut busy = run();
        busy.tau[0].iter_mut().step_by(50).for_each(|t| *t = 90.0);
        assert!(mend(busy).1.is_empty());
    }

    #[test]
    fn wraps_are_unwrapped_and_glitches_bridged() {
        let mut wrapped = run();
        wrapped.q[0].iter_mut().for_each(|q| *q = (*q - 1.5).rem_euclid(TAU));
        let (mended, found) = mend(wrapped);
        let whole = found.iter().all(|(_, fault)| matches!(fault, LogFault::Wrapped(_)));
        assert!(found.len() == 1 && whole, "{found:?}");
        let offset: Vec<f64> = run().q[0].iter().map(|q| q - 1.5 + TAU).collect();
        assert!(farthest(&mended.q[0], &offset) < 1e-9);

        let mut glitched = run();
        glitched.q[0][3000..3003].iter_mut().for_each(|q| *q += 0.05);
        let (mended, found) = mend(glitched);
        assert_eq!(found, [(0, LogFault::Glitches(1))]);
        assert!(farthest(&mended.q[0], &run().q[0]) < 1e-5);
    }

    #[test]
    fn the_longest_part_is_kept_where_a_position_jumps_or_the_log_stands_still() {
        let mut jumped = run();
        jumped.q[0][5000..].iter_mut().for_each(|q| *q += 0.3);
        let (mended, found) = mend(jumped);
        assert!(matches!(found[..], [(0, LogFault::Jump { .. })]), "{found:?}");
        assert_eq!(mended.q[0], run().q[0][..5000]);

        let mut frozen = run();
        for from in [2000, 3000] {
            let (q, tau) = (frozen.q[0][from], frozen.tau[0][from]);
            frozen.q[0][from..from + 400].fill(q);
            frozen.tau[0][from..from + 400].fill(tau);
        }
        let (mended, found) = mend(frozen);
        assert!(matches!(found[..2], [(0, LogFault::Frozen { .. }), (0, LogFault::Frozen { .. })]), "{found:?}");
        assert_eq!(mended.q[0], run().q[0][3400..]);
        // A joint that stands may repeat itself for as long as it likes.
        let mut resting = run();
        resting.q[0].fill(0.3);
        resting.tau[0].fill(2.0);
        assert_eq!(mend(resting.clone()), (resting, Vec::new()));
    }

    #[test]
    fn a_run_whose_positions_are_held_is_looked_at_as_often_as_they_come() {
        let mut held = run();
        let q = held.q[0].clone();
        held.q[0].iter_mut().enumerate().for_each(|(k, held)| *held = q[k / 8 * 8]);
        let (mended, found) = mend(held);
        assert_eq!(found, [(0, LogFault::Held { samples: 8, seconds: 8.0 * PERIOD_S })]);
        assert_eq!((mended.period_s, mended.len()), (8.0 * PERIOD_S, 1000));
        assert_eq!(mended.q[0][..3], [q[0], q[8], q[16]]);
    }

    #[test]
    fn the_step_of_an_encoder_is_found_and_a_smooth_position_has_none() {
        let smooth = swing(8000);
        assert_eq!(resolution(&smooth), 0.0);
        let coarse: Vec<f64> = smooth.iter().map(|q| (q / 1e-4).round() * 1e-4).collect();
        assert!((resolution(&coarse) / 1e-4 - 1.0).abs() < 1e-6);
        assert!((position_noise(&coarse, 2.2 * PERIOD_S) / 2.887e-5 - 1.0).abs() < 1e-3);
        // Steps alone are no positions that are held.
        assert_eq!(hold_period(&coarse), None);
    }
}
