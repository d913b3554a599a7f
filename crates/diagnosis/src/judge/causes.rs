//! Which steps of the selection the held-out run upholds as causes, and the report of each.

use crate::effects::Form;
use crate::effects::external_force::Force;
use crate::effects::link_inertia::LinkScale;
use crate::effects::motion_advice;
use crate::effects::payload;
use crate::effects::{Effect, Kind};
use crate::fit::evidence::Solved;
use crate::fit::motion_gap::Sealed;
use crate::fit::prediction::Prediction;
use crate::fit::search::{Bursts, Search};
use crate::fit::stages::Stages;
use crate::judge::load_change::held_load;
use crate::judge::procedure::{Procedure, Step, is_drive};
use crate::judge::shrinkage;
use crate::judge::tool_drag::drag;
use crate::model::gap::Gap;
use crate::model::log_fault::{LogFault, LogFinding};
use crate::policy::POLICY;
use crate::report::curves::{self, Shown};
use crate::report::diagnosis::{BetweenRuns, Cause, DataUse, Diagnosis, JointGap, Scatter, Shrink, Verdict, pooled};
use crate::report::regimes;
use crate::report::repeatability;
use crate::report::shapley;
use crate::select::adopted::Adopted;
use crate::select::equivalence_class;
use crate::select::residual::Residue;

use verdict::verdict;

mod verdict;

/// Everything that is known when the sealed torque has been read.
pub(crate) struct Opened<'a> {
    pub(crate) procedure: &'a Procedure<'a>,
    pub(crate) search: &'a Search<'a>,
    pub(crate) steps: &'a [Step],
    pub(crate) prediction: &'a Prediction,
    /// The sealed run step by step.
    pub(crate) measured: &'a Stages,
    /// The runs looked at, step by step.
    pub(crate) seen: &'a [Stages],
    pub(crate) solved: &'a Solved,
    pub(crate) log: Vec<LogFinding>,
}

/// What the sealed run is asked.
struct Judge<'a> {
    sealed: Sealed<'a>,
    residue: Residue<'a>,
    gaps: Vec<Gap>,
    /// Beside how softly friction turns over.
    sliding: Vec<Gap>,
    names: Vec<String>,
    log: &'a [LogFinding],
    /// Whether the model as given misses nothing in motion, on the sealed run and on those looked at.
    sound: bool,
}

impl Judge<'_> {
    fn is_unbelieved(&self, name: &String) -> bool {
        self.log.iter().any(|f| f.joint == *name && f.fault.spoils())
    }

    /// The verdict where nothing is missing in motion.
    fn without_gap(&self) -> Verdict {
        if self.names.iter().any(|name| self.is_unbelieved(name)) { Verdict::NotEvaluated } else { Verdict::NoGap }
    }

    /// Why it is not evaluated where some torques are not believed.
    fn untrusted_remark(&self) -> String {
        let untrusted: Vec<&str> =
            self.names.iter().filter(|name| self.is_unbelieved(name)).map(String::as_str).collect();
        format!("the torque of {} is untrusted; the other joints show no gap", untrusted.join(", "))
    }

    /// Joints on which step `step` is asked of the sealed run: a value on all of them, an effect where it acts.
    fn joints<'b>(&self, step: &'b Step) -> impl Iterator<Item = usize> + Clone + use<'b> {
        let everywhere = step.effect.kind() == Kind::Value || step.joints.is_empty();
        (0..self.names.len()).filter(move |j| everywhere || step.joints.contains(j))
    }

    /// Whether step `k` is upheld with that shrink.
    fn upholds(&self, k: usize, step: &Step, shrink: Shrink, solved: &Solved) -> bool {
        let value = step.effect.kind() == Kind::Value;
        let everywhere = step.joints.is_empty();
        let predictable = is_predictable(step);
        let on = self.joints(step);
        let transfers = !predictable
            || if value && !everywhere {
                self.sealed.misses(k, on.clone())
            } else {
                self.sealed.notices(k, on.clone()) && !(everywhere && self.sealed.spoils(k))
            };
        // Refined, it may have become as little as a stop is smeared by.
        let smeared = |a: &Adopted| a.form.is_like_smoothing() && !a.form.plausible(&a.coefficients(&solved.x));
        let enough = step.adopted.iter().all(|a| self.residue.upholds(a) && !smeared(a));
        // Where most joints stand a wrong value of one is told from its own motion, however little of the whole gap that is.
        let step_joints = || (0..self.names.len()).filter(|j| step.joints.is_empty() || step.joints.contains(j));
        let settled = || {
            step_joints()
                .all(|j| self.sealed.in_motion(j).is_none_or(|[_, after]| after <= POLICY.held_out.min_gap_in_motion))
        };
        let drive = is_drive(step.effect) && settled();
        let exact = !step.effect.about().is_inexact && step.adopted.iter().all(|a| !a.form.is_simulated());
        let most = !value && !everywhere && exact && self.sealed.takes_most(k, on.clone());
        let seen = self.sealed.is_plain(k, step_joints());
        let plain = seen && (!value || drive || self.sealed.mostly_stands());
        // Other joints' wrong gains make bodies wrong, and then the one that is right looks wrong.
        let given =
            |j: usize| self.sealed.in_motion(j).is_none_or(|[before, _]| before > POLICY.held_out.max_sound_gap);
        let right = step.effect.about().is_gain && !step_joints().any(given);
        let cut = step.effect.about().cuts_command;
        let needed = || !self.sound && self.sealed.is_helped(k, on);
        let helped = value || !predictable || cut || step.adopted.is_empty() || needed();
        let law = step.adopted.iter().any(|a| a.form.of_angle_alone());
        let needed_there = law && self.sealed.is_needed(k, step_joints());
        // What is on all joints may take most of what is missed in motion and nothing of the whole gap, which is mostly what joints hold at rest: a
        // tilt of 4 degrees, a delay of 8 ms. A load pulls there as well.
        let plain_everywhere = step.effect.about().is_judged_in_motion && !step.adopted.is_empty() && seen;
        // Two wrong values of a drive that make up for each other are each the worse for being right alone.
        let material = (drive && plain)
            || needed_there
            || plain_everywhere
            || is_material(step, shrink, plain || most, predictable);
        transfers && enough && material && helped && !right && self.is_believed(step) && !step.doubtful
    }

    /// Whether two laws of the angle stand on one joint: together they fit one that nobody knows.
    fn is_patched(steps: &[Step], step: &Step) -> bool {
        let laws = |j: usize| {
            let all = steps.iter().flat_map(|s| &s.adopted);
            let nameless = |form: &Form| form.is_nameless() && form.effect().about().balances_gravity;
            let law = |form: &Form| form.of_angle_alone() || nameless(form);
            all.filter(|a| law(&a.form) && a.form.joints() == [j]).count()
        };
        step.adopted.iter().any(|a| a.form.of_angle_alone() && a.form.joints().iter().any(|j| laws(*j) > 1))
    }

    /// Whether a thing without a name was taken up on a joint of the step: what else is there may be a part of it, unless it explains more
    /// and is `most` of the gap. Of a constant, which a signal has and not the arm, nothing is a part.
    fn is_beside_nameless(steps: &[Step], step: &Step, most: bool) -> bool {
        let part = |form: &Form| form.is_nameless() && !form.is_torque_zero();
        let nameless = steps.iter().flat_map(|s| &s.adopted).filter(|a| part(&a.form));
        // What the larger of two misses for a while looks like a touch.
        let touch = step.adopted.iter().find(|a| a.form.has_stretches());
        if let Some(touch) = touch {
            return nameless.into_iter().any(|a| a.gain > touch.gain);
        }
        let own = step.adopted.iter().map(|a| a.gain).fold(0.0, f64::max);
        let joints: Vec<usize> = nameless.filter(|a| !most || a.gain >= own).flat_map(|a| a.form.joints()).collect();
        step.effect.kind() == Kind::Structure && step.joints.iter().any(|j| joints.contains(j))
    }

    /// Whether a joint that the model as given fits is left with a gap: what fits the others is not what the arm has.
    fn is_spoilt(&self) -> bool {
        let times = (0..self.names.len()).filter_map(|j| self.sealed.in_motion(j));
        times
            .into_iter()
            .any(|[before, after]| before <= POLICY.held_out.max_sound_gap && after > POLICY.held_out.min_gap_in_motion)
    }

    /// What is said of joints whose torque cannot be believed is not worth saying.
    fn is_believed(&self, step: &Step) -> bool {
        let mut unbelieved = step.joints.iter().map(|j| self.is_unbelieved(&self.names[*j]));
        match step.effect.kind() {
            Kind::Structure => !unbelieved.any(|u| u),
            Kind::Value => step.joints.is_empty() || !unbelieved.all(|u| u),
        }
    }

    /// Whether so much is left beside `effects`, which are upheld, that they may be a part of what nobody knows: most of the gap in
    /// motion, everywhere. On a joint by itself an effect may be a form that goes on otherwise than it began.
    fn is_open<'b>(&self, effects: impl Iterator<Item = &'b Adopted>, faulty: bool) -> bool {
        let (mut any, mut all) = (false, true);
        for adopted in effects {
            any = true;
            // When contact comes again no motion tells.
            all &= !adopted.form.has_stretches();
        }
        let left_over = self.residue.any_noisy();
        !faulty
            && any
            && all
            && left_over
            && self.sealed.is_mostly_open()
            && self.sealed.left_in_motion() > POLICY.held_out.max_share_left
    }

    /// Figures of the joints.
    fn per_joint(&self, floors: &[f64], scatter: &[Option<Scatter>]) -> Vec<JointGap> {
        let (before, after) = (&self.gaps[0], &self.gaps[self.gaps.len() - 1]);
        let joint = |(j, name): (usize, &String)| JointGap {
            joint: name.clone(),
            before: before.per_joint[j],
            after: after.per_joint[j],
            noise_floor: floors[j],
            repeats: scatter[j],
            in_motion: self.sealed.in_motion(j),
        };
        self.names.iter().enumerate().map(joint).collect()
    }
}

/// Steps after the sealed torque has been read.
struct Upholding {
    causes: Vec<Cause>,
    withdrawn: Vec<Cause>,
    /// By step.
    upheld: Vec<bool>,
}

/// Withdraws contact that takes a little of what most joints are missed by: it is one more thing that the model lacks. Whether there
/// was some.
fn withdraw_slight_contact(
    judge: &Judge<'_>,
    steps: &[Step],
    (causes, withdrawn): (&mut Vec<Cause>, &mut Vec<Cause>),
    upheld: &mut [bool],
) -> bool {
    let slight = |c: &Cause| {
        c.effect.about().is_intermittent
            && c.share.is_some_and(|share| share < POLICY.held_out.min_contact_share_open)
            && judge.sealed.is_mostly_open()
    };
    if !causes.iter().any(slight) {
        return false;
    }
    let (out, kept) = std::mem::take(causes).into_iter().partition(slight);
    *causes = kept;
    withdrawn.extend::<Vec<Cause>>(out);
    for (step, upheld) in steps.iter().zip(upheld) {
        *upheld &= !step.effect.about().is_intermittent;
    }
    true
}

impl Opened<'_> {
    /// The diagnosis, and which of the steps are upheld.
    pub(crate) fn diagnosis(self) -> (Diagnosis, Vec<bool>) {
        let Opened { procedure, search, steps, measured, seen, .. } = self;
        let names = procedure.names();
        let as_given = |(run, stages)| Sealed { run, stages, noise: &search.noise }.fits_as_given();
        let sealed = Sealed { run: procedure.sealed, stages: measured, noise: &search.noise };
        let [gaps, sliding] = measured.gaps();
        let judge = Judge {
            sound: sealed.fits_as_given() && procedure.look.iter().zip(seen).all(as_given),
            sealed,
            residue: Residue::from_search(search),
            gaps,
            sliding,
            names: names.clone(),
            log: &self.log,
        };
        let load = curves::load(procedure.sealed, procedure.nominal, &procedure.nominal.x);
        let Upholding { mut causes, mut withdrawn, mut upheld } = self.uphold(&judge, &load);
        let promises: Vec<Shrink> = causes.iter().map(|c: &Cause| c.shrink).collect();
        // A channel that went wrong on the sealed run says nothing against what the others say.
        let faulty = self.log.iter().any(|f| f.run == procedure.sealed.run.name && f.fault.spoils());
        let refuted = !faulty && (shrinkage::is_refuted(&judge.sliding, &promises) || judge.is_spoilt());
        let effects = steps.iter().zip(&upheld).filter(|(_, upheld)| **upheld).flat_map(|(s, _)| &s.adopted);
        let open = judge.is_open(effects, faulty);
        if refuted || open {
            withdrawn.append(&mut causes);
            upheld.fill(false);
        }
        share_out(&mut causes, &upheld, seen);
        if withdraw_slight_contact(&judge, steps, (&mut causes, &mut withdrawn), &mut upheld) {
            share_out(&mut causes, &upheld, seen);
        }
        let floors = judge.sealed.floor();
        let floor = pooled(&floors);
        // The seal is open: motion that it has in common with the others counts as well.
        let scatter = repeatability::scatter(&procedure.look.iter().chain([procedure.sealed]).collect::<Vec<_>>());
        let per_joint = judge.per_joint(&floors, &scatter);
        let (before, after) = (&judge.gaps[0], &judge.gaps[judge.gaps.len() - 1]);
        let unexplained_share = share_left(before, after, floor);
        let undone = open || refuted && shrinkage::is_plain(before.all, floor);
        let verdict = if undone {
            Verdict::Unexplained
        } else {
            let open = share_left(&judge.sliding[0], &judge.sliding[judge.sliding.len() - 1], floor);
            verdict(&judge, [&causes, &withdrawn], steps, &upheld, &per_joint, open)
        };
        // What was fitted may fail, or hold a joint that stands: where nothing is missing, nothing is unexplained.
        let nothing_missing = verdict == Verdict::Unexplained && !faulty && causes.is_empty() && judge.sound;
        let verdict = if nothing_missing { judge.without_gap() } else { verdict };
        let refuted = refuted && verdict == Verdict::Unexplained;
        let remark = (verdict == Verdict::NotEvaluated).then(|| judge.untrusted_remark());
        let between_runs = (verdict == Verdict::Unexplained)
            .then(|| BetweenRuns::from_gaps(refuted, judge.residue.at_floor(), &per_joint))
            .flatten();
        let scales = self.other_scales(&judge, between_runs);
        let diagnosis = Diagnosis {
            verdict,
            between_runs,
            before: before.all,
            after: after.all,
            noise_floor: floor,
            per_joint,
            place: regimes::cells(procedure.sealed, measured, &names),
            causes,
            withdrawn,
            unexplained_share,
            creeping_share: creeping_share(measured),
            data: DataUse { of_another_kind: self.prediction.of_another_kind, ..procedure.data },
            remark,
            left_out: Vec::new(),
            refuted,
            other_arm: Vec::new(),
            used: Vec::new(),
            unused: Vec::new(),
            details: None,
            log: self.log.iter().cloned().chain(scales).collect(),
        };
        (diagnosis, upheld)
    }

    /// What each step is worth on the sealed run: causes, those withdrawn, and which steps are upheld.
    fn uphold(&self, judge: &Judge<'_>, load: &[Vec<f64>]) -> Upholding {
        let Opened { steps, seen, .. } = *self;
        let names = &judge.names;
        let (mut causes, mut withdrawn, mut upheld) = (Vec::new(), Vec::new(), Vec::new());
        for (k, step) in steps.iter().enumerate() {
            let shrink = shrinkage::estimate(step.effect, k, self.prediction, seen, &judge.gaps);
            let most = shrink.measured > POLICY.held_out.min_refused_share;
            let alone = !Judge::is_patched(steps, step) && !Judge::is_beside_nameless(steps, step, most);
            let instead = self.instead_of_contact(k, step);
            let touch = !self.acts_throughout(step);
            let stands = alone && touch && instead.is_none() && judge.upholds(k, step, shrink, self.solved);
            upheld.push(stands);
            // Whether it is material goes by what was looked at; what is promised, by what that says of motion of another kind.
            let widened = shrink.wider(self.prediction.wider);
            let cause = Cause { impossible: instead, ..self.cause(k, step, widened, judge, load) };
            if stands { &mut causes } else { &mut withdrawn }.push(cause);
        }
        let refused: Vec<String> =
            withdrawn.iter().filter(|c| is_most(c)).flat_map(|c: &Cause| c.joints.clone()).collect();
        let shares_refused_joint = |c: &Cause| is_structure(c) && c.joints.iter().any(|j| refused.contains(j));
        if causes.iter().any(shares_refused_joint) {
            for (k, step) in steps.iter().enumerate() {
                let of_step =
                    |c: &Cause| c.effect == step.effect && step.joints.iter().map(|j| &names[*j]).eq(&c.joints);
                upheld[k] &= !causes.iter().any(|c| shares_refused_joint(c) && of_step(c));
            }
            let (out, kept) = causes.into_iter().partition(shares_refused_joint);
            causes = kept;
            withdrawn.extend::<Vec<Cause>>(out);
        }
        Upholding { causes, withdrawn, upheld }
    }

    /// Joints whose torque is in another scale than on the training runs, where the held-out log differs.
    fn other_scales(&self, judge: &Judge<'_>, between_runs: Option<BetweenRuns>) -> Vec<LogFinding> {
        let changed = between_runs == Some(BetweenRuns::SealedDiffers);
        let scales = if changed { judge.sealed.other_scales() } else { Vec::new() };
        let finding = |(j, scale): (usize, f64)| LogFinding {
            run: self.procedure.sealed.run.name.clone(),
            joint: judge.names[j].clone(),
            fault: LogFault::Scale(scale),
        };
        scales.into_iter().map(finding).collect()
    }

    /// Whether what looks like contact leaves most joints with a gap where nothing touches: drag at the tool is strongest in bursts.
    fn acts_throughout(&self, step: &Step) -> bool {
        let noise = &self.search.noise;
        let throughout = |windows: &Bursts| {
            let runs = self.procedure.look.iter().zip(self.seen).zip(windows);
            runs.into_iter().any(|((run, stages), own)| Sealed { run, stages, noise }.is_open_outside(own))
        };
        step.adopted.iter().any(|a| a.form.get().is_some_and(|Force { windows, .. }| throughout(windows)))
    }

    /// Of what looks like contact: why it is none, as a load that was picked up or put down during a run, or drag.
    fn instead_of_contact(&self, k: usize, step: &Step) -> Option<String> {
        let Force { windows, .. } = step.adopted.iter().find_map(|a| a.form.get())?;
        let runs = self.procedure.look.iter().zip(self.seen).zip(windows);
        let mut why = runs.filter_map(|((run, seen), own)| {
            let force = |j: usize, row: usize| seen.models[k + 1][j][row] - seen.models[k][j][row];
            let whole = seen.models.last().map_or(&seen.tau, |whole| whole);
            let missed = |j: usize, row: usize| seen.tau[j][row] - whole[j][row] + force(j, row);
            let load = held_load(run, own, force).map(|load| load.to_string());
            load.or_else(|| drag(run, self.procedure.nominal, missed).map(|drag| drag.to_string()))
        });
        why.next()
    }

    /// Whether the last link is heavier than a CAD model is wrong by: with what the flange carries it is one body, whose centre lies where it did.
    fn is_last_link_heavier(&self, step: &Step) -> bool {
        let last = self.procedure.names().len() - 1;
        step.adopted.iter().any(|a| {
            a.form.get().is_some_and(|LinkScale { link }| *link == last)
                && a.coefficients(&self.solved.x)[0] > POLICY.confidence.heavier_link
        })
    }

    /// Step `k` as it is told, whether it is upheld or not.
    fn cause(&self, k: usize, step: &Step, shrink: Shrink, judge: &Judge<'_>, load: &[Vec<f64>]) -> Cause {
        // What the others say of a drive whose torque is not believed in some run nothing has checked.
        let step = &step.on_drives(&self.procedure.nominal.model.parameters, |j| !judge.is_unbelieved(&judge.names[j]));
        let mut class = equivalence_class::effects(&step.adopted);
        let carries = self.is_last_link_heavier(step) && class.iter().all(|(effect, _)| *effect != payload::EFFECT);
        class.extend(carries.then_some((payload::EFFECT, 0.0)));
        let rivals: Vec<Effect> = class.iter().map(|(effect, _)| *effect).collect();
        let shown = Shown {
            effect: step.effect,
            joints: &step.joints,
            forms: step.adopted.iter().map(|a| &a.form).collect(),
            stage: k,
        };
        let mut confidence = confidence(step, shrink, rivals.len());
        let plain = judge.sealed.is_plain(k, judge.joints(step));
        if !step.adopted.is_empty() && is_predictable(step) && !plain {
            confidence *= POLICY.confidence.not_plain;
        }
        if step.adopted.iter().any(|a| a.another_law) {
            confidence *= POLICY.confidence.another_law;
        }
        let small = |a: &Adopted| {
            let gain = a.coefficients(&self.solved.x).first().copied().unwrap_or(0.0);
            a.form.is_gain() && gain.abs() < POLICY.confidence.small_gain
        };
        if step.adopted.iter().any(small) {
            confidence *= POLICY.confidence.may_be_bodies;
        }
        // A zero of the torque signal that is off looks the same in motion: it has no name in the list, but they are one class.
        if step.effect.about().is_like_torque_zero {
            confidence *= POLICY.confidence.first_of_class;
        }
        if step.effect.about().is_like_torque_zero && self.steps.iter().any(|s| is_load_on(s, &step.joints)) {
            confidence *= POLICY.confidence.beside_load;
        }
        // Where joints stand, what they hold may spoil a promise; an effect with which the run comes down to its noise in motion goes on.
        let goes_on = plain
            && judge
                .joints(step)
                .all(|j| judge.sealed.in_motion(j).is_none_or(|[_, after]| after <= POLICY.held_out.max_sound_gap));
        let broken = step.effect.kind() == Kind::Structure && shrink.measured < shrink.low && !goes_on;
        if is_predictable(step)
            && (broken
                || shrink.measured
                    > POLICY.held_out.max_surprise_ratio * shrink.high.max(POLICY.held_out.min_cause_shrink))
        {
            confidence *= POLICY.confidence.promise_broken;
        }
        Cause {
            effect: step.effect,
            curves: curves::curves(self.procedure.sealed, self.measured, load, &judge.names, &shown),
            joints: step.joints.iter().map(|j| judge.names[*j].clone()).collect(),
            magnitude: self.procedure.magnitude(self.search, step, &self.solved.x, &self.solved.stretches),
            intervals: Vec::new(),
            shrink,
            share: None,
            p_value: step.adopted.iter().filter_map(|a| a.p_value).reduce(f64::max),
            confidence,
            separating_motion: motion_advice::motion(step.effect, &rivals),
            indistinguishable_from: rivals,
            angles: class.iter().map(|(_, angle)| *angle).collect(),
            impossible: None,
        }
    }
}

/// Gives each cause its share of the squared gap on the runs looked at.
fn share_out(causes: &mut [Cause], upheld: &[bool], seen: &[Stages]) {
    let players: Vec<usize> = (0..upheld.len()).filter(|k| upheld[*k]).collect();
    for (cause, share) in causes.iter_mut().zip(shapley::shares(seen, &players).into_iter().flatten()) {
        cause.share = Some(share);
    }
}

fn is_structure(cause: &Cause) -> bool {
    cause.effect.kind() == Kind::Structure
}

/// Whether a step is friction with load on one of these joints.
fn is_load_on(step: &Step, joints: &[usize]) -> bool {
    step.effect.about().grows_with_load && step.joints.iter().any(|j| joints.contains(j))
}

/// Whether an effect takes most of the gap, whatever it is called.
fn is_most(cause: &Cause) -> bool {
    is_structure(cause) && !cause.joints.is_empty() && cause.shrink.measured > POLICY.held_out.min_refused_share
}

/// Whether the motion tells of it.
fn is_predictable(step: &Step) -> bool {
    step.adopted.iter().all(|a| a.form.is_predictable())
}

/// Share of the squared gap that is left with all causes which is how softly friction turns over.
pub(crate) fn creeping_share(stages: &Stages) -> f64 {
    let gap_after = stages.gaps().map(|gaps| gaps.last().map_or(f64::NAN, |gap| gap.all));
    1.0 - (gap_after[1] / gap_after[0]).powi(2)
}

/// Whether step `step` takes enough to be a cause.
fn is_material(step: &Step, shrink: Shrink, plain: bool, predictable: bool) -> bool {
    let Shrink { predicted, low, high, measured } = shrink;
    if step.adopted.is_empty() {
        // A value that may as well take nothing from motion it has not seen is not worth a name, nor is one that took nothing.
        return measured > 0.0
            && (plain
                || low > 0.0
                    && (predicted >= POLICY.held_out.min_cause_shrink
                        || measured >= POLICY.held_out.min_cause_shrink));
    }
    let value = step.effect.kind() == Kind::Value;
    let everywhere = step.joints.is_empty();
    // An effect that the motion tells of takes something, before the sealed torque was looked at or after, or is none.
    let about = step.effect.about();
    let takes = match () {
        () if about.is_intermittent => true,
        // A command need not be cut again, but where it is the rest must fit.
        () if about.cuts_command => {
            measured > -POLICY.held_out.min_effect_shrink
                && predicted.max(measured) > POLICY.held_out.min_saturation_shrink
        }
        // Lengths of the arm that are off look like a little of one, which promises nothing on motion that was not seen.
        () if step.adopted.iter().any(|a| a.form.of_angle_alone()) => {
            low > 0.0 && measured > POLICY.held_out.min_effect_shrink
        }
        // A load pulls in every pose: one that may as well take nothing is none.
        () if about.acts_in_every_pose => measured > 0.0 && low > 0.0,
        // A tilt or a load is on every joint: what it gains on some it must not lose on others, unless it is plain in motion.
        () if value && everywhere => measured > 0.0,
        () if value || !everywhere && plain => predicted.max(measured) > 0.0,
        () => predicted.min(measured) > POLICY.held_out.min_effect_shrink,
    };
    // Where nothing was promised, far more than was thought possible is no confirmation.
    takes && (value || !predictable || low > 0.0 || measured <= POLICY.held_out.max_surprise_ratio * high)
}

/// How often such a name is that of the effect itself.
fn confidence(step: &Step, shrink: Shrink, rivals: usize) -> f64 {
    let agreement = (shrink.predicted - shrink.measured).abs();
    let agreement_confidence = if agreement < 0.1 { 0.97 } else { 0.85 };
    let gains = step.adopted.iter().map(|a| a.gain);
    let value = if is_drive(step.effect) && step.joints.len() >= POLICY.confidence.several_drives {
        POLICY.confidence.values_of_drives
    } else {
        POLICY.confidence.refitted_value
    };
    let strong =
        gains.reduce(f64::max).map_or(value, |gain| (1.0 - (-gain / 20.0).exp()).max(POLICY.confidence.adopted_form));
    agreement_confidence * strong * POLICY.confidence.first_of_class.powi(i32::try_from(rivals).unwrap_or(i32::MAX))
}

/// Share of the squared gap above the floor that is left.
pub(crate) fn share_left(before: &Gap, after: &Gap, floor: f64) -> f64 {
    let (first, left) = (before.all.powi(2) - floor * floor, after.all.powi(2) - floor * floor);
    if first <= 0.0 { 0.0 } else { (left / first).clamp(0.0, 1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::counterbalance::Counterbalance;
    use crate::effects::friction_asymmetry::Constant;
    use crate::effects::presliding_friction::Hysteresis;
    use crate::effects::torque_constant::TorqueLaw;
    use crate::effects::torque_ripple::Ripple;
    use crate::effects::torque_saturation::Saturation;
    use crate::effects::{coulomb_friction, link_inertia, rotor_inertia};

    fn step(form: impl Into<Form>) -> Step {
        let form = form.into();
        let (effect, joints) = (form.effect(), form.joints());
        Step { effect, joints, columns: Vec::new(), adopted: vec![Adopted::alone(form)], doubtful: false }
    }

    /// Values of drives on three joints are a file that is off; one alone may be part of something else, and so may links.
    #[test]
    fn drives_that_are_off_together_are_surer_than_one() {
        let said = |effect: Effect, joints: usize| {
            let joints = (0..joints).collect();
            let step = Step { effect, joints, columns: Vec::new(), adopted: Vec::new(), doubtful: false };
            confidence(&step, Shrink { predicted: 0.3, low: 0.2, high: 0.4, measured: 0.3 }, 0)
        };
        assert!(said(coulomb_friction::EFFECT, 3) > 0.9 && said(rotor_inertia::EFFECT, 5) > 0.9);
        assert!(said(coulomb_friction::EFFECT, 2) < 0.5 && said(link_inertia::EFFECT, 4) < 0.5);
    }

    /// What is beside a hose may be a part of it; what is beside a signal whose zero is off is not.
    #[test]
    fn a_constant_hides_no_effect_of_its_joint() {
        let ripple = |joint: usize| step(Ripple { joint, order: 25.0 });
        let beside =
            |form: Form, joint: usize| Judge::is_beside_nameless(&[step(form), ripple(joint)], &ripple(joint), false);
        assert!(beside(Hysteresis { joint: 2, length: 0.02 }.into(), 2));
        assert!(!beside(Hysteresis { joint: 2, length: 0.02 }.into(), 1));
        assert!(!beside(Constant { joint: 2 }.into(), 2));
    }

    /// A drive that loses torque when it brings much (gain 306) was contact for half a second (43).
    #[test]
    fn what_a_larger_thing_without_a_name_misses_is_no_contact() {
        let with = |form: Form, gain: f64| {
            let mut step = step(form);
            step.adopted.iter_mut().for_each(|a| a.gain = gain);
            step
        };
        let touch = |gain: f64| with(Force { windows: vec![vec![(6.9, 7.4)]], moment: false }.into(), gain);
        let law = || with(TorqueLaw { joint: 1 }.into(), 306.0);
        assert!(Judge::is_beside_nameless(&[law(), touch(43.0)], &touch(43.0), true));
        assert!(!Judge::is_beside_nameless(&[law(), touch(400.0)], &touch(400.0), true));
        assert!(!Judge::is_beside_nameless(&[touch(43.0)], &touch(43.0), true));
    }

    /// A limit that took 81 % of the sealed gap (gain 5000) beside a law of the torque of gain 133; 7 % may be a part of that law.
    #[test]
    fn what_takes_most_of_the_gap_is_no_part_of_a_smaller_thing_without_a_name() {
        let with = |form: Form, gain: f64| {
            let mut step = step(form);
            step.adopted.iter_mut().for_each(|a| a.gain = gain);
            step
        };
        let limit = |gain: f64| with(Saturation { joint: 1, limit: 4.6 }.into(), gain);
        let law = || with(TorqueLaw { joint: 1 }.into(), 133.0);
        let beside = |gain: f64, most: bool| Judge::is_beside_nameless(&[limit(gain), law()], &limit(gain), most);
        assert!(!beside(5000.0, true));
        assert!(beside(5000.0, false) && beside(100.0, true));
    }

    #[test]
    fn a_limit_that_neither_promises_nor_takes_anything_is_none() {
        let limit = step(Saturation { joint: 1, limit: 198.0 });
        let is = |predicted: f64, measured: f64| {
            is_material(&limit, Shrink { predicted, low: -0.1, high: 1.0, measured }, true, false)
        };
        assert!(!is(0.003, 0.0) && !is(0.012, 0.0) && !is(0.5, -0.008), "nothing taken, or spoilt");
        assert!(is(0.674, 0.0), "a command need not be cut again");
        assert!(is(-0.011, 0.054));
    }

    /// Lengths of the arm that were off by 2 to 10 % were a counterbalance (0.87 to 0.93) which took 2 % of the sealed gap and promised none.
    #[test]
    fn a_law_of_the_angle_that_promises_nothing_is_none() {
        let lever = || step(Counterbalance { joint: 1, arm: 0.3, phase: 0.0 });
        let took = |low: f64| Shrink { predicted: 0.1, low, high: 0.3, measured: 0.12 };
        assert!(!is_material(&lever(), took(-0.03), true, true));
        assert!(is_material(&lever(), took(0.02), true, true));
        // What turns with the motion needs no promise.
        assert!(is_material(&step(Ripple { joint: 1, order: 25.0 }), took(-0.03), true, true));
    }
}
