//! The gap in motion: residuals of a run weighed by how sure the direction of friction is.
//!
//! A joint at rest holds whatever its stiction lets it, and that may be most of a gap that no model predicts.

use crate::fit::stages::Stages;
use crate::model::standstill::is_moved;
use crate::policy::POLICY;
use crate::screen::prepared::Prepared;

/// Faster than this friction has turned over, however softly it does \[rad/s\]: drag is felt there.
const MIN_SLIDING_SPEED_RAD_S: f64 = 0.1;

/// The sealed run under the models from the one given to the one with all causes.
pub(crate) struct Sealed<'a> {
    pub(crate) run: &'a Prepared,
    pub(crate) stages: &'a Stages,
    /// What is left of each joint's torque on the other runs with all that was found \[N·m\]: rows in doubt count little against it.
    pub(crate) noise: &'a [f64],
}

/// Sums over joints, each in units of its noise.
struct Missed {
    /// What is left without a step less what is left with it.
    by: f64,
    /// The step's own torque.
    due: f64,
    /// What is left without it, the floor taken off.
    of: f64,
}

impl Sealed<'_> {
    fn whole(&self) -> usize {
        self.stages.models.len() - 1
    }

    /// What a row of joint `j` counts: less where friction's direction is in doubt.
    fn weight(&self, j: usize, row: usize) -> f64 {
        1.0 / (1.0 + (self.run.doubt[j][row] / self.noise[j]).powi(2))
    }

    /// Mean square over the rows of joint `j`, weighed.
    fn mean_square(&self, j: usize, of: impl Fn(usize) -> f64) -> f64 {
        self.mean_square_in(j, |_| true, of)
    }

    /// The same over those rows that are `within`.
    fn mean_square_in(&self, j: usize, within: impl Fn(usize) -> bool, of: impl Fn(usize) -> f64) -> f64 {
        let (mut sum, mut total) = (0.0, 0.0);
        for row in (0..self.run.doubt[j].len()).filter(|row| within(*row)) {
            let weight = self.weight(j, row);
            sum += weight * of(row).powi(2);
            total += weight;
        }
        sum / f64::max(total, f64::MIN_POSITIVE)
    }

    fn residual(&self, stage: usize, j: usize) -> impl Fn(usize) -> f64 {
        let (tau, model) = (&self.stages.tau[j], &self.stages.models[stage][j]);
        // Of a joint that creeps, how softly friction turns over is most of the torque that is missed, and nobody's fault.
        let turned = self.stages.turned.get(j);
        move |row| tau[row] - model[row] - turned.map_or(0.0, |turned| turned[row])
    }

    /// Gap of joint `j` with the model as given and with all causes, over the noise of its torque signal; none where it stands.
    pub(crate) fn in_motion(&self, j: usize) -> Option<[f64; 2]> {
        let floor = self.run.floor[j].max(f64::MIN_POSITIVE);
        let over = |stage| self.mean_square(j, self.residual(stage, j)).sqrt() / floor;
        self.moves(j).then(|| [0, self.whole()].map(over))
    }

    /// Joints that keep a gap with all causes and come down to their noise times a factor, which is told: their torque is in another scale than
    /// on the runs looked at.
    pub(crate) fn other_scales(&self) -> Vec<(usize, f64)> {
        let scale = |j: usize| {
            let (tau, model) = (&self.stages.tau[j], &self.stages.models[self.whole()][j]);
            let sum = |of: &dyn Fn(usize) -> f64| (0..tau.len()).map(|row| self.weight(j, row) * of(row)).sum::<f64>();
            let scale = sum(&|row| tau[row] * model[row]) / sum(&|row| model[row].powi(2));
            let rescaled_rms = self.mean_square(j, |row| tau[row] - scale * model[row]).sqrt();
            let open = self.in_motion(j).is_some_and(|[_, after]| after > POLICY.held_out.min_gap_in_motion);
            let other = scale > 0.0
                && !(1.0 - POLICY.held_out.min_scale_error..1.0 / (1.0 - POLICY.held_out.min_scale_error))
                    .contains(&scale);
            (open && other && rescaled_rms <= POLICY.held_out.max_sound_gap * self.run.floor[j]).then_some((j, scale))
        };
        self.trusted().filter_map(scale).collect()
    }

    /// Whether joint `j` moves for a while.
    fn moves(&self, j: usize) -> bool {
        is_moved(&self.run.motion, &self.run.chain, j)
    }

    /// Whether half of the joints stand, or more.
    pub(crate) fn mostly_stands(&self) -> bool {
        2 * (0..self.noise.len()).filter(|j| self.moves(*j)).count() <= self.noise.len()
    }

    /// Joints whose torque says something of motion.
    fn trusted(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.noise.len()).filter(|j| self.run.silent[*j].is_none() && self.moves(*j))
    }

    /// Whether the model as given misses no joint in motion by more than a sound one is missed by.
    pub(crate) fn fits_as_given(&self) -> bool {
        let mut trusted = self.trusted().filter_map(|j| self.in_motion(j)).peekable();
        trusted.peek().is_some() && trusted.all(|[before, _]| before <= POLICY.held_out.max_sound_gap)
    }

    /// Whether most joints keep more than noise in motion with all causes.
    pub(crate) fn is_mostly_open(&self) -> bool {
        let times: Vec<[f64; 2]> = self.trusted().filter_map(|j| self.in_motion(j)).collect();
        2 * times.iter().filter(|times| times[1] > POLICY.held_out.min_gap_in_motion).count() > times.len()
    }

    /// Whether most joints keep more than noise in motion with all causes outside of these stretches \[s\].
    pub(crate) fn is_open_outside(&self, windows: &[(f64, f64)]) -> bool {
        let (period, samples) = (self.run.run.period_s, self.run.run.len());
        let sample = |t: f64| ((t / period).max(0.0) as usize).min(samples);
        let windows: Vec<_> =
            windows.iter().map(|(from, to)| self.run.chain.around(sample(*from)..sample(*to), samples).1).collect();
        let floor = |j: usize| self.run.floor[j].max(f64::MIN_POSITIVE);
        let times = |j: usize| {
            let speed = self.run.chain.sample(&self.run.motion.qd[j]);
            let outside = |row: usize| {
                speed[row].abs() > MIN_SLIDING_SPEED_RAD_S && !windows.iter().any(|rows| rows.contains(&row))
            };
            self.mean_square_in(j, outside, self.residual(self.whole(), j)).sqrt() / floor(j)
        };
        2 * self.trusted().filter(|j| times(*j) > POLICY.held_out.min_gap_in_motion).count() > self.trusted().count()
    }

    /// Share of the squared gap in motion above the noise that is left with all causes, each joint's torque scaled to rms 1.
    pub(crate) fn left_in_motion(&self) -> f64 {
        let [before, after] = self.trusted().fold([0.0; 2], |sum, j| {
            let torque = self.mean_square(j, |row| self.stages.tau[j][row]).max(f64::MIN_POSITIVE);
            let floor = self.run.floor[j].powi(2);
            let share = |stage| (self.mean_square(j, self.residual(stage, j)) - floor).max(0.0) / torque;
            [sum[0] + share(0), sum[1] + share(self.whole())]
        });
        if before > 0.0 { after / before } else { 0.0 }
    }

    fn missed(&self, k: usize, joints: impl Iterator<Item = usize>) -> Missed {
        let mut missed = Missed { by: 0.0, due: 0.0, of: 0.0 };
        for j in joints {
            let unit = self.noise[j].powi(2);
            let residual = self.residual(self.whole(), j);
            let step_torque = |row: usize| self.stages.models[k + 1][j][row] - self.stages.models[k][j][row];
            let square_with = self.mean_square(j, &residual);
            let without = self.mean_square(j, |row| residual(row) + step_torque(row));
            missed.by += (without - square_with) / unit;
            missed.due += self.mean_square(j, step_torque) / unit;
            missed.of += (without - self.run.floor[j].powi(2)).max(0.0) / unit;
        }
        missed
    }

    /// Whether the run misses step `k` where it is taken out of the whole model: by a part at least of the torque that it has
    /// on that motion, on the joints that it is named on. With what else is wrong in place, since a part of a curve alone may
    /// be worse than none.
    pub(crate) fn misses(&self, k: usize, joints: impl Iterator<Item = usize>) -> bool {
        let missed = self.missed(k, joints);
        missed.by >= POLICY.held_out.min_transfer_share * missed.due
    }

    /// The same of an effect, and whether it takes a part of what the others leave there, or would at the size that this run asks
    /// for: what goes on otherwise than it began may be far too small, and be it all the same.
    pub(crate) fn notices(&self, k: usize, joints: impl Iterator<Item = usize>) -> bool {
        let missed = self.missed(k, joints);
        // Of own torque a and what is left without it r: by = 2ar - a², so that the best multiple of a takes (ar)²/a².
        let along = 0.5 * (missed.by + missed.due);
        let takes = if missed.due > 0.0 { along * along / missed.due } else { missed.by };
        missed.by >= POLICY.held_out.min_transfer_share * missed.due
            && takes >= POLICY.held_out.min_noticed_share * missed.of
    }

    /// Whether step `k` takes some of what the others leave in motion on one of these joints, or as much as would be a gap.
    pub(crate) fn is_helped(&self, k: usize, mut joints: impl Iterator<Item = usize>) -> bool {
        let helped = |j: usize| {
            let square_with =
                self.mean_square(j, self.residual(self.whole(), j)) / self.run.floor[j].powi(2).max(f64::MIN_POSITIVE);
            let without = self.without(k, j).powi(2);
            let takes = without - square_with;
            let slight = self
                .in_motion(j)
                .is_some_and(|[given, _]| takes < (POLICY.held_out.min_taken_gap_share * given).powi(2));
            !slight
                && (square_with <= POLICY.held_out.max_helped_share * without
                    || takes > POLICY.held_out.min_gap_in_motion * POLICY.held_out.min_gap_in_motion)
        };
        joints.any(|j| self.moves(j) && helped(j))
    }

    /// What is left of joint `j` in motion without step `k`, over the noise of its torque signal.
    fn without(&self, k: usize, j: usize) -> f64 {
        let residual = self.residual(self.whole(), j);
        let step_torque = |row: usize| self.stages.models[k + 1][j][row] - self.stages.models[k][j][row];
        self.mean_square(j, |row| residual(row) + step_torque(row)).sqrt() / self.run.floor[j].max(f64::MIN_POSITIVE)
    }

    /// Whether its joints, which keep a gap in motion without step `k` and had one as given, come down to what sound ones have.
    pub(crate) fn is_needed(&self, k: usize, mut joints: impl Iterator<Item = usize>) -> bool {
        let settles = |j| {
            self.in_motion(j).is_some_and(|[given, after]| {
                given > POLICY.held_out.max_sound_gap && after <= POLICY.held_out.max_sound_gap
            })
        };
        joints.all(|j| self.without(k, j) > POLICY.held_out.min_gap_in_motion && settles(j))
    }

    /// Whether step `k` takes most of what the others leave in motion on its joints, and they come down to what sound ones have.
    pub(crate) fn takes_most(&self, k: usize, mut joints: impl Iterator<Item = usize> + Clone) -> bool {
        let missed = self.missed(k, joints.clone());
        let settles = |j| self.in_motion(j).is_none_or(|[_, after]| after <= POLICY.held_out.max_sound_gap);
        missed.by > POLICY.held_out.min_most_share * missed.of && joints.all(settles)
    }

    /// Whether the run shows step `k` plainly: it takes most of what the others leave on its joints, and that is more than noise.
    pub(crate) fn is_plain(&self, k: usize, mut joints: impl Iterator<Item = usize> + Clone) -> bool {
        let missed = self.missed(k, joints.clone());
        missed.by >= POLICY.held_out.min_plain_share * missed.of
            && joints.any(|j| self.without(k, j) > POLICY.held_out.min_plain_gap)
    }

    /// Whether step `k` leaves some joint clearly more than there is without it.
    pub(crate) fn spoils(&self, k: usize) -> bool {
        (0..self.noise.len()).filter(|j| self.run.silent[*j].is_none()).any(|j| {
            let residual = self.residual(self.whole(), j);
            let step_torque = |row: usize| self.stages.models[k + 1][j][row] - self.stages.models[k][j][row];
            let [with, without] =
                [self.mean_square(j, &residual), self.mean_square(j, |row| residual(row) + step_torque(row))];
            with.sqrt()
                > (1.0 + POLICY.held_out.min_spoilt_share)
                    * without.sqrt().max(POLICY.held_out.min_gap_in_motion * self.run.floor[j])
        })
    }

    /// Noise of the torque relative to it, by joint; not a number where the torque says nothing.
    pub(crate) fn floor(&self) -> Vec<f64> {
        let relative = |((floor, tau), silent): ((&f64, &Vec<f64>), &Option<_>)| {
            if silent.is_some() {
                return f64::NAN;
            }
            let square: f64 = tau.iter().map(|t| t * t).sum::<f64>() / tau.len().max(1) as f64;
            floor / square.sqrt().max(f64::MIN_POSITIVE)
        };
        self.run.floor.iter().zip(&self.run.tau).zip(&self.run.silent).map(relative).collect()
    }
}
