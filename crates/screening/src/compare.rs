//! All readings of one log, compared.

use rayon::prelude::*;
use rivet_dynamics::{JointKind, Parameter};

use crate::arm_state::{ArmState, FileUnit, RobotFile, ValuePrior};
use crate::candidates::{EachFactor, Scope};
use crate::fault::{Fault, Missing, View};
use crate::priors as p;
use crate::regression::{Design, Evidence, Sums, largest_gravity};
use crate::samples::{Samples, Stretch};

/// One reading of a log.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// Faults of the channels; empty where the log is as the contract says.
    pub faults: Vec<Fault>,
    /// What the arm is like.
    pub state: ArmState,
    /// Posterior probability among the readings compared.
    pub probability: f64,
    /// Rms residual over rms torque of each joint under this reading; NaN where the joint says nothing.
    pub residual: Vec<f64>,
}

/// How a log has to be read.
#[derive(Clone, Debug, PartialEq)]
pub struct Screening {
    /// Readings in the order of their probability, the improbable ones left out.
    pub readings: Vec<Reading>,
    /// Rms residual over rms torque of each joint, as the log is, with the best values of an arm of the file's kind.
    pub residual: Vec<f64>,
    /// The same with the values of the file.
    pub as_given: Vec<f64>,
    /// Readings that were compared.
    pub compared: usize,
}

impl Screening {
    /// The reading to report: other than the log as it is, probable, and explaining clearly more. Bodies of another arm are not
    /// reported as a reading: they are not distinguishable from very rough values of the file, with which the log is usable.
    #[must_use]
    pub fn finding(&self) -> Option<&Reading> {
        let best = self.readings.first()?;
        let is_usable = |r: &Reading| {
            // What a limit cuts off is an effect of the drive, of which a diagnosis says how large it is.
            let none = r.faults.iter().all(|fault| matches!(fault, Fault::BeyondLimit(..)) || fault.is_slight());
            none && (r.state.is_sound() || r.state == ArmState::OtherArm)
        };
        let unsound: f64 = self.readings.iter().filter(|r| !is_usable(r)).map(|r| r.probability).sum();
        // Another state of the arm shows in its values, which any prior that is wide enough would follow.
        // So does a torque without that of the model: an arm without mass would leave as little.
        let in_values =
            best.faults.contains(&Fault::External) || best.faults.is_empty() && best.state != ArmState::Drift;
        let before = if in_values { &self.as_given } else { &self.residual };
        // Of the joints that it is about: what the others keep says nothing of it.
        let about: Vec<usize> = best.faults.iter().flat_map(Fault::joints).collect();
        let counts =
            |j: &usize| about.is_empty() || best.faults.iter().any(|f| f.joints().is_empty()) || about.contains(j);
        let ratio = |j: usize| (best.residual[j] / before[j]).ln();
        let ratios: Vec<f64> = (0..before.len()).filter(counts).map(ratio).filter(|ratio| ratio.is_finite()).collect();
        let mean = (ratios.iter().sum::<f64>() / ratios.len().max(1) as f64).exp();
        (!is_usable(best) && unsound >= p::REPORTED && mean <= p::MAX_RESIDUAL_RATIO).then_some(best)
    }
}

impl Reading {
    /// Whether the log may be used as it is, with the file as it is.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        self.faults.is_empty() && self.state.is_sound()
    }

    /// The name in reports: of the first fault, or of the state of the arm.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match (self.faults.first(), self.state) {
            (Some(fault), _) => fault.name(),
            (None, ArmState::Nominal | ArmState::Accurate) => "as_it_is",
            (None, ArmState::RoughDrives | ArmState::Rough) => "rough_values",
            (None, ArmState::Payload) => "payload",
            (None, ArmState::Offsets) => "torque_offsets",
            (None, ArmState::Counterbalance(_)) => "counterbalance",
            (None, ArmState::Drift) => "friction_drifts",
            (None, ArmState::LinkSide) => "link_side_sensor",
            (None, ArmState::Computed | ArmState::Commanded) => "torque_computed",
            (None, ArmState::OtherArm) => "another_arm",
            (None, ArmState::FileUnit(_)) => "file_unit",
        }
    }

    /// What it is, for people, with the joints' names.
    #[must_use]
    pub fn text(&self, names: &[String]) -> String {
        let faults: Vec<String> = self.faults.iter().map(|fault| fault.words(names)[0].clone()).collect();
        let state = state_words(self.state, names);
        match (faults.is_empty(), self.state) {
            (false, ArmState::Nominal | ArmState::Accurate | ArmState::RoughDrives | ArmState::Rough) => {
                faults.join("; ")
            }
            (false, _) => format!("{}; {}", faults.join("; "), state[0]),
            (true, _) => state[0].clone(),
        }
    }

    /// What to do.
    #[must_use]
    pub fn mend(&self, names: &[String]) -> String {
        let mends: Vec<String> = self.faults.iter().map(|fault| fault.words(names)[1].clone()).collect();
        if mends.is_empty() { state_words(self.state, names)[1].clone() } else { mends.join("; ") }
    }

    /// What would decide between this reading and another one.
    #[must_use]
    pub fn decided_by(&self, other: &Reading) -> &'static str {
        let is = |name: &str| self.name() == name || other.name() == name;
        if is("payload") || is("another_arm") || is("file_unit") {
            "weigh the tool and compare the type plate with the robot file"
        } else if is("torque_offsets") || is("counterbalance") || is("mounting") || is("torque_without_gravity") {
            "log the arm at rest in two poses half a turn apart, for each joint that gravity loads"
        } else if is("joint_zero") || is("positions_exchanged") || is("joints_exchanged") || is("joints_back_to_front")
        {
            "move one joint at a time and look at which column changes, from which zero and in which sense"
        } else if is("torque_late") {
            "log a motion with sharp reversals: friction's step shows the delay"
        } else if is("friction_drifts") || is("rough_values") || is("link_side_sensor") {
            "log the same slow motion at the start and at the end: friction is the half difference of both directions"
        } else {
            "move one joint at a time, there and back at constant speed, and compare its columns with the display of the robot"
        }
    }
}

fn state_words(state: ArmState, names: &[String]) -> [String; 2] {
    let [what, mend] = match state {
        ArmState::Nominal | ArmState::Accurate => ["the log as it is", "nothing"],
        ArmState::RoughDrives => {
            ["the log as it is, friction and rotor inertia of the robot file rough", "identify the values"]
        }
        ArmState::Rough => ["the log as it is, values of the robot file rough", "identify the values"],
        ArmState::Payload => {
            ["a payload or tool that the robot file does not have, or has too much", "state the tool in the URDF"]
        }
        ArmState::Offsets => ["constant torques (offsets)", "identify with offsets"],
        ArmState::Counterbalance(j) => {
            return [format!("a spring or counterbalance at {}", names[j]), "add it to robot.toml".to_owned()];
        }
        ArmState::Drift => [
            "something changed during the run: friction changes while it is logged",
            "log after a warm-up, or with temperature1..N",
        ],
        ArmState::LinkSide => [
            "torque measured behind the gears (friction and rotor inertia about 0)",
            "set friction and rotor_inertia of robot.toml to 0, or log the motor torque",
        ],
        ArmState::Computed => ["torque computed by a model, not measured", "log the measured torque or current"],
        ArmState::Commanded => [
            "torque computed by the robot file's own model (commanded or fed forward), not measured",
            "log the measured torque or current",
        ],
        ArmState::OtherArm => {
            ["bodies of another arm than the robot file's", "give the robot file and URDF of this arm"]
        }
        ArmState::FileUnit(unit) => unit.words(),
    };
    [what.to_owned(), mend.to_owned()]
}

/// Steps in which factors and values, or signs and values, are found in turn.
const FACTOR_STEPS: usize = 4;
const SIGN_STEPS: usize = 4;

/// States with the widest priors: where a fault explains nothing with these, it explains nothing with the others.
fn is_widest(state: ArmState) -> bool {
    matches!(state, ArmState::Rough | ArmState::OtherArm)
}

/// A reading with its unnormalised log posterior.
struct Weighed {
    faults: Vec<Fault>,
    state: ArmState,
    log: f64,
    evidence: Evidence,
}

/// What all comparisons of one log share.
struct Comparison<'a> {
    file: RobotFile<'a>,
    samples: Samples,
    limit: Vec<f64>,
}

/// Compares the readings of a log; none where it has too little motion or torque to say anything.
#[must_use]
pub fn screen(file: &RobotFile<'_>, stretches: &[Stretch<'_>]) -> Option<Screening> {
    let delays: Vec<f64> = std::iter::once(0.0).chain(p::DELAYS_S).collect();
    let samples = Samples::new(stretches, &delays)?;
    let joints = file.joints();
    let largest = p::LIMIT_OVER_GRAVITY * largest_gravity(file);
    let most = if largest > 0.0 { largest } else { f64::INFINITY };
    let limit = (0..joints).map(|j| finite_limit(file.torque_limit[j].min(most), &samples, j)).collect();
    let comparison = Comparison { file: *file, samples, limit };
    let view = View::new(joints);
    let design = Design::new(file, &comparison.samples, &view.motion);
    let sums = comparison.sums(&design, &view, None);
    if sums.is_empty() {
        return None;
    }
    let mut states = ArmState::all(joints);
    let is_computed = |state: ArmState| matches!(state, ArmState::Computed | ArmState::Commanded);
    states.retain(|(state, _)| !is_computed(*state) || comparison.samples.noise < p::MAX_COMPUTED_NOISE);
    // Bodies that are too heavy by their unit need more torque than there is.
    let is_too_heavy = sums.load(file.nominal, &comparison.limit).iter().any(|load| *load > 1.0);
    let is_heavy_unit = |state: ArmState| matches!(state, ArmState::FileUnit(FileUnit::MassGram | FileUnit::CentreMm));
    states.retain(|(state, _)| is_too_heavy || !is_heavy_unit(*state));
    let mut pool = comparison.states(&design, &sums, &states, (&[], 0.0));
    let sound = |w: &&Weighed| w.state.is_sound();
    let as_given = sums.residual(file.nominal);
    // Values of the file that are beyond all measure have no solution.
    let best_sound = pool.iter().filter(sound).max_by(|a, b| a.log.total_cmp(&b.log));
    let residual = best_sound.map_or_else(|| as_given.clone(), |w| w.evidence.residual.clone());
    let gain = best(&pool)?.evidence.possible_gain;
    // No fault is more probable than this; where it could not win it is not asked.
    let likeliest = p::LATE.ln();
    if gain + likeliest > p::LISTED.ln() {
        comparison.add_faults(&mut pool, (&view, &design, &sums))?;
    }
    Some(ranked(pool, residual, as_given))
}

/// A joint's torque limit, or where it has none what its torque reaches.
fn finite_limit(limit: f64, samples: &Samples, j: usize) -> f64 {
    let largest = samples.tau[0].iter().fold(0.0_f64, |m, row| m.max(row[j].abs()));
    if limit.is_finite() && limit > 0.0 { limit } else { largest.max(f64::MIN_POSITIVE) }
}

fn best(pool: &[Weighed]) -> Option<&Weighed> {
    pool.iter().max_by(|a, b| a.log.total_cmp(&b.log))
}

impl Comparison<'_> {
    fn sums(&self, design: &Design, view: &View, like: Option<(&Sums, &View)>) -> Sums {
        Sums::new((design, &self.samples), view, self.file.nominal, &self.limit, like)
    }

    /// The states of the arm beside some faults of that log prior.
    fn states(
        &self,
        design: &Design,
        sums: &Sums,
        states: &[(ArmState, f64)],
        (faults, log_prior): (&[Fault], f64),
    ) -> Vec<Weighed> {
        let weigh = |(state, probability): &(ArmState, f64)| {
            let prior = ValuePrior::new(&self.file, *state, &self.limit, &design.motion);
            let evidence = sums.evidence(&prior)?;
            let log = log_prior + probability.ln() + evidence.log;
            Some(Weighed { faults: faults.to_vec(), state: *state, log, evidence })
        };
        states.par_iter().filter_map(weigh).collect()
    }

    /// One fault more at a time, as long as that explains more.
    fn add_faults(&self, pool: &mut Vec<Weighed>, (view, design, sums): (&View, &Design, &Sums)) -> Option<()> {
        let mut faults: Vec<Fault> = Vec::new();
        let mut base = View::clone(view);
        let mut log_prior = 0.0;
        for count in 0..p::MAX_FAULTS {
            let (own_design, own_sums);
            let (design, sums) = if count == 0 {
                (design, sums)
            } else {
                own_design = Design::new(&self.file, &self.samples, &base.motion);
                own_sums = self.sums(&own_design, &base, None);
                (&own_design, &own_sums)
            };
            let before = best(pool)?.log;
            let is_wide = |w: &&Weighed| w.faults == faults && is_widest(w.state);
            let widest = pool.iter().filter(is_wide).map(|w| w.log).fold(f64::NEG_INFINITY, f64::max);
            let list = self.list((&base, design, sums), &faults);
            // A state that is rare beside faults, and explains the log best so far, is compared with them.
            let is_rare = |state: ArmState| matches!(state, ArmState::Counterbalance(_) | ArmState::Drift);
            let likely = best(pool).map(|w| w.state).filter(|state| is_rare(*state));
            let likely =
                likely.and_then(|state| ArmState::all(self.file.joints()).into_iter().find(|(of, _)| *of == state));
            let found: Vec<(Vec<Weighed>, f64)> = list
                .par_iter()
                .map(|(fault, probability)| {
                    let log_prior = log_prior + probability.ln();
                    (self.with_fault((&base, design, sums), &faults, fault, [log_prior, widest], likely), log_prior)
                })
                .collect();
            let of_best =
                found.iter().filter_map(|(some, prior)| best(some).map(|b| (b.log, b.faults.clone(), *prior)));
            let next = of_best.max_by(|a, b| a.0.total_cmp(&b.0));
            pool.extend(found.into_iter().flat_map(|(some, _)| some));
            let Some((log, with, prior)) = next.filter(|(log, ..)| *log > before) else { break };
            if log - before < 1.0 {
                break;
            }
            (faults, log_prior) = (with, prior);
            base = faults.iter().fold(View::new(self.file.joints()), |view, fault| view.with(fault));
            base = self.with_signs(&Design::new(&self.file, &self.samples, &base.motion), base);
        }
        Some(())
    }

    fn list(&self, (base, design, sums): (&View, &Design, &Sums), before: &[Fault]) -> Vec<(Fault, f64)> {
        let joints = &self.file.model.arm.joints;
        let revolute: Vec<bool> = joints.iter().map(|j| j.kind == JointKind::Revolute).collect();
        let factors = sums.factors(self.file.nominal);
        let each_factor = self.each_factor((base, design, sums));
        let exceeded: Vec<Option<f64>> = (0..joints.len()).map(|j| self.exceeded(j)).collect();
        let scope = Scope {
            joints: joints.len(),
            revolute: &revolute,
            has_scale: !before
                .iter()
                .any(|b| matches!(b, Fault::External | Fault::TorqueScales(_) | Fault::TorqueUnit(_))),
            touches: &self.samples.touches,
            has_gravity: !before.iter().any(|b| matches!(b, Fault::WithoutGravity | Fault::External)),
            gravity: self.file.model.arm.gravity,
            one_signed: &self.samples.one_signed,
            factors: &factors,
            each_factor: &each_factor,
            limit: &self.limit,
            exceeded: &exceeded,
        };
        // A driver subtracts its model at its own positions: with it zeros, scales and signs of positions cannot be checked.
        let is_external = before.contains(&Fault::External);
        let is_unchecked = |fault: &Fault| {
            is_external && matches!(fault, Fault::JointZero(..) | Fault::PositionUnit(..) | Fault::PositionSign(_))
        };
        scope
            .faults()
            .into_iter()
            .filter(|(fault, _)| !is_unchecked(fault))
            .filter(|(fault, _)| {
                !before
                    .iter()
                    .any(|b| b.name() == fault.name() && (b.joints() == fault.joints() || b.joints().is_empty()))
            })
            .collect()
    }

    fn values(&self, design: &Design, sums: &Sums) -> Option<Vec<f64>> {
        let prior = ValuePrior::new(&self.file, ArmState::Rough, &self.limit, &design.motion);
        sums.evidence(&prior).map(|found| found.values)
    }

    /// Values of the file with friction of a usual size where it has none.
    fn with_friction(&self) -> Vec<f64> {
        let values =
            self.file.nominal.iter().zip(&self.file.model.parameters).map(|(value, parameter)| match parameter {
                Parameter::Coulomb(j) if *value == 0.0 => 0.5 * p::UNKNOWN_FRICTION_OVER_LIMIT * self.limit[*j],
                _ => *value,
            });
        values.collect()
    }

    /// Factors of all torques and values of the arm, in turns; none where a torque shows nothing.
    fn each_factor(&self, (base, design, like): (&View, &Design, &Sums)) -> EachFactor {
        let mut factors = like.size_ratios(&self.with_friction());
        let mut gains = vec![0.0; factors.len()];
        for _ in 0..FACTOR_STEPS {
            let all: Vec<f64> = factors.iter().map(|f| f.filter(|f| *f > 0.0).unwrap_or(1.0)).collect();
            let sums = self.sums(design, &base.with(&Fault::TorqueScales(all)), Some((like, base)));
            let Some(values) = self.values(design, &sums) else { break };
            gains = sums.factor_gains(&values);
            for (factor, step) in factors.iter_mut().zip(sums.free_factors(&values)) {
                *factor = factor.zip(step).map(|(factor, step)| factor * step).or(*factor);
            }
        }
        EachFactor { factors, gains }
    }

    /// The view with values whose torque gives unsigned torques their sign: values and signs in turns, from two starts.
    fn with_signs(&self, design: &Design, view: View) -> View {
        if !view.unsigned.contains(&true) {
            return view;
        }
        let prior = ValuePrior::new(&self.file, ArmState::Rough, &self.limit, &design.motion);
        let mut found: Option<(f64, View)> = None;
        for start in [self.file.nominal.to_vec(), self.with_friction()] {
            let mut trial = View { sign_values: start, ..view.clone() };
            for _ in 0..SIGN_STEPS {
                let Some(evidence) = self.sums(design, &trial, None).evidence(&prior) else { break };
                if found.as_ref().is_none_or(|(log, _)| evidence.log > *log) {
                    found = Some((evidence.log, trial.clone()));
                }
                trial.sign_values = evidence.values;
            }
        }
        found.map_or(view, |(_, view)| view)
    }

    /// The limit of a torque that exceeds it.
    fn exceeded(&self, j: usize) -> Option<f64> {
        let limit = self.file.torque_limit[j];
        let beyond = self.samples.tau[0].iter().any(|row| row[j].abs() > limit);
        (limit > 0.0 && beyond).then_some(limit)
    }

    fn with_fault(
        &self,
        (base, design, like): (&View, &Design, &Sums),
        faults: &[Fault],
        fault: &Fault,
        [log_prior, widest_before]: [f64; 2],
        likely: Option<(ArmState, f64)>,
    ) -> Vec<Weighed> {
        let view = base.with(fault);
        let all: Vec<Fault> = faults.iter().chain([fault]).cloned().collect();
        let of = |design: &Design| {
            let view = self.with_signs(design, view.clone());
            let sums = self.sums(design, &view, Some((like, base)));
            // The driver's model is the file's: then the file is not that of another arm.
            let is_external = view.missing == Missing::Model;
            let (widest, mut others): (Vec<_>, Vec<_>) = ArmState::beside_faults()
                .into_iter()
                .filter(|(state, _)| !is_external || *state != ArmState::OtherArm)
                .partition(|(state, _)| is_widest(*state));
            others.extend(likely);
            let mut found = self.states(design, &sums, &widest, (&all, log_prior));
            if best(&found).is_some_and(|w| w.log > widest_before - p::FAR_BEHIND) {
                found.extend(self.states(design, &sums, &others, (&all, log_prior)));
            }
            found
        };
        let of_exact_gravity = if view.motion == base.motion {
            of(design)
        } else {
            of(&Design::new(&self.file, &self.samples, &view.motion))
        };
        if *fault != Fault::WithoutGravity {
            return of_exact_gravity;
        }
        // The driver's gravity may be that of the file, and wrong: what it misses is in the torque.
        let view = View { missing: Missing::Gravity, ..base.clone() };
        let sums = self.sums(design, &view, None);
        // Of a load that the driver does not know gravity would stay.
        let states: Vec<(ArmState, f64)> =
            ArmState::beside_faults().into_iter().filter(|(state, _)| *state != ArmState::Payload).collect();
        let mut found = self.states(design, &sums, &states, (&all, log_prior));
        found.extend(of_exact_gravity);
        // The two models of gravity share the prior.
        for weighed in &mut found {
            weighed.log -= std::f64::consts::LN_2;
        }
        found
    }
}

/// Whether two sets of faults are one reading: a slight delay beside others is no other one.
fn is_same(a: &[Fault], b: &[Fault]) -> bool {
    let wrong = |faults: &[Fault]| faults.iter().filter(|fault| !fault.is_slight()).cloned().collect::<Vec<Fault>>();
    let alike = |a: &[Fault], b: &[Fault]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.is_alike(b));
    let (wrong_a, wrong_b) = (wrong(a), wrong(b));
    alike(a, b) || !wrong_a.is_empty() && alike(&wrong_a, &wrong_b)
}

/// Probabilities of all, summed over the states of the arm beside each set of faults; the log as it is stays apart by state.
fn ranked(pool: Vec<Weighed>, residual: Vec<f64>, as_given: Vec<f64>) -> Screening {
    let compared = pool.len();
    let most = pool.iter().fold(f64::NEG_INFINITY, |m, w| m.max(w.log));
    let total: f64 = pool.iter().map(|w| (w.log - most).exp()).sum();
    let mut readings: Vec<Reading> = Vec::new();
    let mut order: Vec<Weighed> = pool;
    order.sort_by(|a, b| b.log.total_cmp(&a.log));
    for weighed in order {
        let probability = (weighed.log - most).exp() / total;
        let same = |r: &&mut Reading| !weighed.faults.is_empty() && is_same(&r.faults, &weighed.faults);
        if let Some(reading) = readings.iter_mut().find(same) {
            reading.probability += probability;
            continue;
        }
        let Weighed { faults, state, evidence, .. } = weighed;
        readings.push(Reading { faults, state, probability, residual: evidence.residual });
    }
    readings.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    readings.retain(|r| r.probability >= p::LISTED);
    readings.truncate(p::MAX_LISTED);
    Screening { readings, residual, as_given, compared }
}
