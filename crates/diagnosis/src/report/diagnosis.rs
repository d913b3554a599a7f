//! The report of a diagnosis: verdict, causes with their shrink and confidence, and the gap by joint.

use crate::effects::Effect;
use crate::model::log_fault::LogFinding;
use crate::policy::POLICY;
use crate::report::curves::Curve;
use crate::report::details::Details;
use crate::report::regimes::Cell;

/// The answer in one word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Nothing above the noise.
    NoGap,
    /// Wrong values of what the model has.
    Parameter,
    /// One thing that the model lacks.
    Effect,
    /// More than one.
    Several,
    /// A gap that no effect of the library explains.
    Unexplained,
    /// Too little motion or data.
    NotEvaluated,
}

impl Verdict {
    /// The name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Verdict::NoGap => "no_gap",
            Verdict::Parameter => "parameter",
            Verdict::Effect => "effect",
            Verdict::Several => "several",
            Verdict::Unexplained => "unexplained",
            Verdict::NotEvaluated => "not_evaluated",
        }
    }
}

/// How far the gap shrinks when a cause is added to those before it: `1 − after/before`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shrink {
    /// Before the sealed torque was looked at.
    pub predicted: f64,
    /// Lower end of the 90 % interval.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// On the sealed torque.
    pub measured: f64,
}

impl Shrink {
    /// With an interval that is wider by so much on either side.
    pub(crate) fn wider(self, by: f64) -> Shrink {
        Shrink { low: self.low - by, high: (self.high + by).min(1.0), ..self }
    }
}

/// One cause.
#[derive(Clone, Debug, PartialEq)]
pub struct Cause {
    /// What it is.
    pub effect: Effect,
    /// The joints' names; empty when it belongs to none or to all.
    pub joints: Vec<String>,
    /// Size, by name with unit.
    pub magnitude: Vec<(String, f64)>,
    /// 90 % interval of sizes, by the same names: over resampled blocks of the runs, over the posterior of the coefficients and along
    /// the profile of inner values (a velocity, a stiffness). Forces that come and go have none, nor has what the runs do not bound.
    pub intervals: Vec<(String, [f64; 2])>,
    /// How far the gap shrinks.
    pub shrink: Shrink,
    /// Of the squared gap on the runs looked at, whatever the order of causes (Shapley value of the explained variance); none for a hint.
    pub share: Option<f64>,
    /// How often the strongest of all candidates would look as strong in the residual with drawn signs of its blocks: of the
    /// effects that it was named for, the largest; none for values and contact.
    pub p_value: Option<f64>,
    /// 0 to 1.
    pub confidence: f64,
    /// Effects and values that these runs cannot tell from it.
    pub indistinguishable_from: Vec<Effect>,
    /// Principal angle between its torque and theirs \[rad\], beside all else that may change.
    pub angles: Vec<f64>,
    /// The motion that would.
    pub separating_motion: Option<String>,
    /// The sealed run with and without it, on the joints that it changes most.
    pub curves: Vec<Curve>,
    /// Of a hint whose size no arm has, or that motion does not tell from something else: why it is none.
    pub impossible: Option<String>,
}

impl Cause {
    /// Something that no step of the sealed run stands for.
    pub(crate) fn unmeasured(effect: Effect, joints: Vec<String>) -> Cause {
        Cause {
            effect,
            joints,
            magnitude: Vec::new(),
            intervals: Vec::new(),
            shrink: Shrink { predicted: f64::NAN, low: f64::NAN, high: f64::NAN, measured: f64::NAN },
            share: None,
            p_value: None,
            confidence: f64::NAN,
            indistinguishable_from: Vec::new(),
            angles: Vec::new(),
            separating_motion: None,
            curves: Vec::new(),
            impossible: None,
        }
    }
}

/// The gap of one joint, relative to its torque.
#[derive(Clone, Debug, PartialEq)]
pub struct JointGap {
    /// The joint's name.
    pub joint: String,
    /// With the model as given.
    pub before: f64,
    /// With all causes.
    pub after: f64,
    /// What noise leaves: that of the torque signal, or what torque differs by where motion is repeated, whichever is more.
    pub noise_floor: f64,
    /// Motion that the runs hold twice, where there is enough of it.
    pub repeats: Option<Scatter>,
    /// Where the direction of friction is known, as given and with all causes, over the noise of the torque signal: what a joint
    /// that stands holds by friction no model tells, so it has none.
    pub in_motion: Option<[f64; 2]>,
}

impl JointGap {
    /// Whether repeated motion says more of noise than the torque signal does.
    pub fn is_floor_from_repeats(&self) -> bool {
        self.repeats.is_some_and(|repeats| repeats.decides)
    }

    /// Whether there is more than noise in motion, as given or with all causes.
    pub(crate) fn is_open(&self) -> bool {
        self.in_motion.iter().flatten().any(|times| *times > POLICY.held_out.min_gap_in_motion)
    }

    /// Whether more than noise is left in motion with all causes.
    pub(crate) fn is_left(&self) -> bool {
        self.in_motion.is_some_and(|[_, after]| after > POLICY.held_out.min_gap_in_motion)
    }
}

/// What one joint's torque differs by where its motion does not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scatter {
    /// Root mean square in one of two runs \[N·m\].
    pub torque: f64,
    /// How much motion was seen twice \[s\].
    pub seconds: f64,
    /// Whether it is more than the noise of the torque signal.
    pub decides: bool,
}

/// Which data were used for what.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DataUse {
    /// Runs, the sealed one included.
    pub runs: usize,
    /// Whether they are two parts of one run.
    pub cut: bool,
    /// Looked at.
    pub fit_seconds: f64,
    /// Sealed.
    pub sealed_seconds: f64,
    /// Share of the time for which joints go at speeds on the sealed motion at which they are less often on what was looked at, where that
    /// is so much that intervals are wider for it.
    pub of_another_kind: Option<f64>,
}

/// How the sealed run differs from those looked at where no cause that these show explains it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BetweenRuns {
    /// They fit to their noise, and it does not.
    SealedDiffers,
    /// What fits them does not hold there, and the model as given fits it to its noise.
    SealedAsGiven,
    /// Values of what the model has fit all of them to their noise, and those looked at alone do not show these values.
    ValuesUnseen,
}

impl BetweenRuns {
    /// The name in reports.
    pub fn name(self) -> &'static str {
        match self {
            BetweenRuns::SealedDiffers => "sealed_differs",
            BetweenRuns::SealedAsGiven => "sealed_as_given",
            BetweenRuns::ValuesUnseen => "values_unseen",
        }
    }

    /// `looked_at_fit`: whether nothing is left on the runs looked at.
    pub(crate) fn from_gaps(refuted: bool, looked_at_fit: bool, sealed: &[JointGap]) -> Option<BetweenRuns> {
        let open = |at: usize| {
            sealed.iter().any(|gap| gap.in_motion.is_some_and(|times| times[at] > POLICY.held_out.min_gap_in_motion))
        };
        match (refuted, open(0), open(1)) {
            (true, false, _) => Some(BetweenRuns::SealedAsGiven),
            (_, true, true) if looked_at_fit => Some(BetweenRuns::SealedDiffers),
            _ => None,
        }
    }
}

/// The whole answer.
#[derive(Clone, Debug, PartialEq)]
pub struct Diagnosis {
    /// In one word.
    pub verdict: Verdict,
    /// Gap of the model as given, on the sealed motion, all joints.
    pub before: f64,
    /// With all causes.
    pub after: f64,
    /// Of noise, as by joint.
    pub noise_floor: f64,
    /// By joint.
    pub per_joint: Vec<JointGap>,
    /// Where the gap of the model as given lies, largest share first.
    pub place: Vec<Cell>,
    /// In the order of adoption.
    pub causes: Vec<Cause>,
    /// Effects that were considered and not upheld; hints, not names.
    pub withdrawn: Vec<Cause>,
    /// Faults of the log itself.
    pub log: Vec<LogFinding>,
    /// Share of the squared gap above the floor that is left.
    pub unexplained_share: f64,
    /// Share of what is left of the squared gap with all causes which is that friction turns over more softly than the model has it: a joint
    /// that creeps shows it, and no file that is handed on holds it. Below 0 where it would be more without.
    pub creeping_share: f64,
    /// What was used.
    pub data: DataUse,
    /// Why nothing was evaluated.
    pub remark: Option<String>,
    /// Steps whose equations had no solution; everything else stands without them.
    pub left_out: Vec<String>,
    /// Whether the sealed run said that what fits the others is nothing that holds: then no cause is named.
    pub refuted: bool,
    /// What sets the sealed run apart from those looked at.
    pub between_runs: Option<BetweenRuns>,
    /// Joints whose bodies and rotors are off by more than a data sheet ever is, where that is most of them: then no cause is named.
    pub other_arm: Vec<String>,
    /// Places of the runs that were used among those given, the sealed one last.
    pub used: Vec<usize>,
    /// Names of the others, whose torque says nothing.
    pub unused: Vec<String>,
    /// What stands behind the figures; absent when nothing was evaluated.
    pub details: Option<Details>,
}

impl Diagnosis {
    /// Takes what repeated motion says of noise into what is told. No name is decided by it: between two runs load may differ, and
    /// friction with it, which is no noise.
    pub(crate) fn know_repeats(&mut self, tau: &[Vec<f64>]) {
        for (j, gap) in self.per_joint.iter_mut().enumerate() {
            let Some(scatter) = gap.repeats.take().filter(|_| gap.noise_floor.is_finite()) else { continue };
            let rms = (tau[j].iter().map(|t| t * t).sum::<f64>() / tau[j].len().max(1) as f64).sqrt();
            let relative = scatter.torque / rms.max(f64::MIN_POSITIVE);
            let decides = relative > gap.noise_floor;
            gap.repeats = Some(Scatter { decides, ..scatter });
            if decides {
                gap.noise_floor = relative;
                self.details
                    .iter_mut()
                    .filter_map(|d| d.ledger.get_mut(j))
                    .for_each(|line| line.floor = scatter.torque);
            }
        }
        if self.per_joint.iter().any(JointGap::is_floor_from_repeats) {
            self.noise_floor = pooled(&self.per_joint.iter().map(|gap| gap.noise_floor).collect::<Vec<_>>());
        }
    }

    /// Of most joints, these, the values are so far off that nothing said of them is worth a name.
    pub(crate) fn is_of_another_arm(&mut self, joints: Vec<String>) {
        self.verdict = Verdict::Unexplained;
        self.other_arm = joints;
        self.withdrawn.append(&mut self.causes);
        self.withdrawn.iter_mut().for_each(|hint| hint.share = None);
    }

    /// No run is left whose torque says something, and `why`.
    pub(crate) fn unheard(log: Vec<LogFinding>, why: &str) -> Diagnosis {
        let data = DataUse { runs: 0, cut: false, fit_seconds: 0.0, sealed_seconds: 0.0, of_another_kind: None };
        Diagnosis { log, ..Diagnosis::not_evaluated(data, why) }
    }

    pub(crate) fn not_evaluated(data: DataUse, why: &str) -> Diagnosis {
        Diagnosis {
            verdict: Verdict::NotEvaluated,
            before: f64::NAN,
            after: f64::NAN,
            noise_floor: f64::NAN,
            per_joint: Vec::new(),
            place: Vec::new(),
            causes: Vec::new(),
            withdrawn: Vec::new(),
            log: Vec::new(),
            unexplained_share: f64::NAN,
            creeping_share: f64::NAN,
            data,
            remark: Some(why.to_owned()),
            left_out: Vec::new(),
            refuted: false,
            between_runs: None,
            other_arm: Vec::new(),
            used: Vec::new(),
            unused: Vec::new(),
            details: None,
        }
    }
}

/// Root mean square of what is known.
pub(crate) fn pooled(relative: &[f64]) -> f64 {
    let finite: Vec<f64> = relative.iter().copied().filter(|r| r.is_finite()).collect();
    (finite.iter().map(|r| r * r).sum::<f64>() / finite.len().max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_sets_the_sealed_run_apart_is_asked_of_motion() {
        let joint = |in_motion: [f64; 2]| JointGap {
            joint: "j".into(),
            before: 0.0,
            after: 0.0,
            noise_floor: 0.01,
            repeats: None,
            in_motion: Some(in_motion),
        };
        let of = |refuted, fit, times| BetweenRuns::from_gaps(refuted, fit, &[joint([1.0, 1.0]), joint(times)]);
        assert_eq!(of(false, true, [20.0, 18.0]), Some(BetweenRuns::SealedDiffers));
        assert_eq!(of(true, true, [20.0, 18.0]), Some(BetweenRuns::SealedDiffers), "neither fits there");
        assert_eq!(of(true, true, [1.1, 18.0]), Some(BetweenRuns::SealedAsGiven));
        assert_eq!(of(false, false, [20.0, 18.0]), None, "the runs looked at are not understood either");
        assert_eq!(of(false, true, [20.0, 1.1]), None);
    }
}
