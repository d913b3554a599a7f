//! What an on-line run identified, for people and for programs.

use crate::as_found::{AsFound, as_found};
use crate::stream::Recording;
use crate::table::{Table, paragraph};
use rivet_analysis::coarse::{ROUNDED_ON_LINE, coarse_torque, that_matter};
use rivet_analysis::doubts::{missing_more, unexplained};
use rivet_analysis::evidence::{Compared, Distrust, Largest, OF_DELAYED, UNFOLLOWED, bias_json, bias_text};
use rivet_analysis::fault::Fault;
use rivet_analysis::kinematics::{another_arm, misread};
use rivet_analysis::reading::READING_NAME;
use rivet_analysis::runs;
use rivet_config::{Differentiator, EstimatorKind, Instruments, Robot};
use rivet_dynamics::{Parameter, ParameterGroup};
use rivet_estimation::offline::Bias;
use rivet_ipc_schema::{Health, InputFault, InstrumentSource, ParameterState, Parameters};
use rivet_monitor::faults_met;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::fmt;

/// Friction gives energy surely from so many standard deviations below zero.
const SURELY: f64 = 3.0;

/// One sample in so many that is refused leaves no stretch for signals to settle in, if it comes evenly.
const OFTEN: u64 = 50;

/// The last parameter set of a run over a log, with what it left of the torque.
pub(crate) struct Summary<'a> {
    robot: &'a Robot,
    parameters: &'a Parameters,
    health: &'a Health,
    samples: usize,
    /// Joints that do not follow the setpoints of the log.
    unfollowed: BTreeSet<usize>,
    /// Torque channels of the log that cannot be believed.
    distrusts: &'a [Distrust],
    /// Torques that come in steps of which the fit leaves little.
    coarse_torque: Vec<Distrust>,
    /// How its joints may have to be read, where that is another way.
    misread: Option<Distrust>,
    /// Why its positions are refused, where that is known.
    coarse: Option<&'a str>,
    /// What the last values leave of the last window; none where the arm stands still there.
    as_found: Option<AsFound>,
}

/// Why no parameters were published for a log of so many samples.
pub(crate) fn nothing(robot: &Robot, recording: &Recording, health: &Health) -> Fault {
    let (log, samples) = (recording.path().display(), recording.len());
    Fault::Data(match unused(health, samples, recording.coarse.as_deref()) {
        Some(why) => format!("{log}: nothing was identified: {why}"),
        None => format!(
            "{log}: {samples} samples are less than the first publication needs ([publish] every = {}): nothing was published",
            robot.config.publish.every
        ),
    })
}

/// What was wrong with samples of a log, and how many were not used; none where nothing was. That samples are missing in a log is
/// counted elsewhere. `coarse` is what the log says of readings that the daemon refuses.
fn unused(health: &Health, samples: usize, coarse: Option<&str>) -> Option<String> {
    let lost = InputFault::Lost as usize;
    let mut health = *health;
    health.input_faults[lost] = 0;
    let met = faults_met(&health);
    let times: u64 = met.iter().map(|(_, times)| times).sum();
    let met: Vec<String> = met.into_iter().map(|(what, times)| format!("{what} ({times})")).collect();
    let refused = health.refused_stale + health.refused_invalid + health.rejected_faults;
    let met = if met.is_empty() { String::new() } else { format!("met: {}", met.join(", ")) };
    let text = match (refused, met.is_empty()) {
        (0, true) => return None,
        (0, false) => format!("not all samples could be learnt from; {met}"),
        // Where all were refused there are no others, even if more was met (a publisher that was gone for a while).
        _ if times <= refused || refused >= samples as u64 => {
            format!("{refused} of {samples} samples were refused; {met}")
        }
        // What is met may as well have been looked at and not learnt from.
        _ => format!("{refused} of {samples} samples were refused, and not all others could be used; {met}"),
    };
    let of_positions = [InputFault::Frozen, InputFault::EncoderJump].map(|fault| health.input_faults[fault as usize]);
    let why = coarse.filter(|_| of_positions.iter().any(|times| *times > 0));
    Some(why.map_or_else(|| text.clone(), |why| format!("{text}. {why}")))
}

/// What delayed instruments leave out of standard deviations: docs/real-data.md has the figures.
const OF_THE_MOTION: &str = "delayed instruments depend on the measured motion, as effects that the model lacks do \
     (stiction): standard deviations do not include that. On simulated arms with stiction 40 to 80 % of the values \
     lie within two of them; publish a setpoint or a second encoder";

/// What the values of the robot file leave of each joint's torque \[%\].
fn nominal_percent(robot: &Robot, health: &Health) -> Vec<f64> {
    let torque = |j: usize| health.torque_rms[j].max(f64::MIN_POSITIVE);
    (0..robot.dof()).map(|j| 100.0 * health.nominal_residual_rms[j] / torque(j)).collect()
}

impl<'a> Summary<'a> {
    pub(crate) fn new(
        robot: &'a Robot,
        recording: &'a Recording,
        parameters: &'a Parameters,
        health: &'a Health,
    ) -> Self {
        let steps = that_matter(&recording.torque_steps, &parameters.residual_rms);
        let distrusts = &recording.distrusts;
        // It is asked off line, which not every log that was learnt from on line can be: then nobody knows.
        let misread = misread(robot, &[recording.path().to_owned()], &nominal_percent(robot, health));
        let learnt = [&parameters.values, &parameters.std].map(|values| &values[..parameters.len()]);
        Summary {
            robot,
            parameters,
            health,
            as_found: as_found(robot, recording.path(), learnt),
            samples: recording.len(),
            unfollowed: recording.unfollowed(),
            distrusts,
            coarse_torque: coarse_torque(robot, &steps, ROUNDED_ON_LINE),
            misread: misread.ok().flatten(),
            coarse: recording.coarse.as_deref(),
        }
    }

    /// Whether nothing is learnt for want of instruments.
    fn without(&self) -> bool {
        let none = InstrumentSource::try_from(self.parameters.instruments) == Ok(InstrumentSource::None);
        let kind = self.robot.config.estimator.kind;
        none && matches!(kind, EstimatorKind::Riv | EstimatorKind::Energy)
    }

    /// Why there are none, and what to set instead; empty where there are some.
    fn advice(&self) -> &'static str {
        if !self.without() {
            return "";
        }
        match self.robot.config.estimator.instruments {
            Instruments::Setpoint | Instruments::SetpointThroughLoop => {
                "instruments = \"setpoint\" needs q_des of every joint; \"auto\" takes what the log has"
            }
            Instruments::SecondEncoder => {
                "instruments = \"second-encoder\" needs q_link of every joint, which moves as q does; \"auto\" takes what the log has"
            }
            Instruments::Auto { .. } | Instruments::Delayed { .. } | Instruments::PreviousCycle { .. } => {
                if OFTEN * self.health.refused_invalid > self.samples as u64 {
                    "samples were refused so often (below) that the signals never settled in between"
                } else {
                    "no joint has moved for long enough yet; kind = \"rls\" learns without instruments"
                }
            }
        }
    }

    fn instruments(&self) -> &'static str {
        let asked = matches!(self.robot.config.estimator.instruments, Instruments::PreviousCycle { .. });
        match InstrumentSource::try_from(self.parameters.instruments) {
            Ok(InstrumentSource::Setpoint) => "setpoint (the log has the desired motion)",
            Ok(InstrumentSource::SetpointThroughLoop) => "setpoint through the identified closed loop",
            Ok(InstrumentSource::SecondEncoder) => "second encoders (q_link of the log)",
            Ok(InstrumentSource::PreviousCycle) if asked => "previous cycle (the motion repeats)",
            Ok(InstrumentSource::PreviousCycle) => {
                "previous cycle (the motion repeats, and the log has no desired motion)"
            }
            Ok(InstrumentSource::Delayed) => match self.robot.config.estimator.instruments {
                Instruments::PreviousCycle { .. } => {
                    "delayed (no cycle is found in the last motion: the measured regressor some time ago)"
                }
                Instruments::Delayed { .. } => "delayed, as the robot file asks (the measured regressor some time ago)",
                _ => "delayed (no desired motion: the measured regressor some time ago)",
            },
            Ok(InstrumentSource::None) if self.without() => "none: nothing is learnt from this log",
            Ok(InstrumentSource::None) => "none (least squares)",
            Err(_) => "unknown",
        }
    }

    /// What of the torque cannot be believed, by the log alone and by what was found.
    fn doubts(&self) -> Vec<String> {
        let (p, model, base) = (self.parameters, &self.robot.model, &self.robot.base);
        let place = |of: Parameter| (0..p.len()).find(|i| base.parameter(model, *i) == of);
        // In standard deviations; an open value is not one by one.
        let size = |of| place(of).filter(|i| self.state(*i) != "open").map(|i| p.values[i] / p.std[i]);
        // A reading of the whole arm explains what its joints show.
        let is_misread = self.distrusts.iter().any(|d| d.name == READING_NAME && d.joint.is_none());
        let joint = |(j, joint): (usize, &rivet_dynamics::Joint)| {
            let name = &joint.name;
            if self.distrusts.iter().any(|d| d.joint.as_ref() == Some(name)) {
                return None;
            }
            // Without a row in the window both are 0.
            if self.health.torque_rms[j] == 0.0 && self.health.nominal_residual_rms[j] > 0.0 {
                return Some(format!("torque of {name} is 0: the channel is dead or was not recorded"));
            }
            let friction = [size(Parameter::Coulomb(j))?, size(Parameter::Viscous(j))?];
            let gives = friction.iter().all(|s| *s < 0.0) && friction.iter().any(|s| *s < -SURELY);
            (gives && !is_misread).then(|| {
                format!(
                    "friction of {name} as found gives energy: the sign of its torque is wrong, or values hold what the model lacks"
                )
            })
        };
        let setpoint = [InstrumentSource::Setpoint, InstrumentSource::SetpointThroughLoop];
        let planned = InstrumentSource::try_from(p.instruments).is_ok_and(|source| setpoint.contains(&source));
        let unfollowed: Vec<&str> = self.unfollowed.iter().map(|j| model.arm.joints[*j].name.as_str()).collect();
        let strays = (planned && !unfollowed.is_empty()).then(|| {
            format!(
                "{}: {UNFOLLOWED}, and instruments are made of it; leave its columns out, or set instruments",
                unfollowed.join(", ")
            )
        });
        let found = self.distrusts.iter().map(|d| match &d.joint {
            Some(joint) => format!("{joint}: {}", d.text),
            None => d.text.clone(),
        });
        // Often it is all joints.
        let coarse = self.coarse_torque.chunk_by(|a, b| a.text == b.text).map(|of| {
            let joints: Vec<&str> = of.iter().filter_map(|d| d.joint.as_deref()).collect();
            format!("{}: {}", joints.join(", "), of[0].text)
        });
        // What is told one step ahead holds how values came about, and what they leave of the last window, what joints hold that stand.
        let last = |j: usize| self.as_found.as_ref().map_or(f64::INFINITY, |last| last.found[j]);
        // Nothing is left of no torque.
        let residual = |j: usize| self.residual_percent(j).map_or(0.0, |percent| percent.min(last(j)));
        let residuals: Vec<f64> = (0..model.arm.dof()).map(residual).collect();
        let mut unexplained = unexplained(&runs::joint_names(self.robot), &residuals);
        unexplained.retain(|_| !is_misread);
        let joints: Vec<&str> = unexplained.iter().filter_map(|d| d.joint.as_deref()).collect();
        let unexplained = unexplained.first().map(|d| format!("{}: {}", joints.join(", "), d.text));
        let nominal = nominal_percent(self.robot, self.health);
        let more =
            self.as_found.as_ref().map(|last| missing_more(&runs::joint_names(self.robot), &last.given, &last.found));
        let more = more.filter(|more| !more.is_empty()).map(|more| {
            format!("values as found miss more of the last torque than those of the robot file ({})", more.join(", "))
        });
        // A torque that is not believed anyway has no arm either.
        let another = || another_arm(self.robot, &nominal).filter(|_| self.distrusts.is_empty());
        let another = self.misread.as_ref().map(|d| d.text.clone()).or_else(|| another().map(|d| d.text));
        let delayed = InstrumentSource::try_from(p.instruments).is_ok_and(|source| source == InstrumentSource::Delayed);
        let delayed = delayed.then(|| OF_THE_MOTION.to_owned());
        strays
            .into_iter()
            .chain(delayed)
            .chain(found)
            .chain(coarse)
            .chain(unexplained)
            .chain(more)
            .chain(another)
            .chain(model.arm.joints.iter().enumerate().filter_map(joint))
            .collect()
    }

    /// What was not explained one step ahead of joint `j`'s torque \[%\]; none without a row in the window.
    fn residual_percent(&self, j: usize) -> Option<f64> {
        let torque = self.health.torque_rms[j];
        (torque > 0.0).then(|| 100.0 * self.parameters.residual_rms[j] / torque)
    }

    fn state(&self, i: usize) -> &'static str {
        match ParameterState::try_from(self.parameters.state[i]) {
            Ok(ParameterState::Active) => "active",
            Ok(ParameterState::Held) => "held",
            Ok(ParameterState::Unidentified) => "open",
            Err(_) => "unknown",
        }
    }

    /// Least squares against the instruments in the last window, once it has been compared.
    fn bias(&self) -> Option<Bias> {
        if self.robot.config.estimator.kind.least_squares() {
            return None;
        }
        let health = self.health;
        let ratio = &health.instrument_ratio[..self.robot.model.arm.dof()];
        health.hausman.is_finite().then(|| Bias {
            hausman: health.hausman,
            degrees: health.hausman_degrees as usize,
            spread: f64::NAN,
            p_value: health.hausman_p_value,
            ratio: if ratio.iter().any(|r| r.is_nan()) { Vec::new() } else { ratio.to_vec() },
        })
    }

    /// What this run's comparison rests on.
    fn compared(&self) -> Compared {
        let distorts = match self.robot.config.signal.differentiator {
            Differentiator::Central => None,
            Differentiator::SavitzkyGolay { .. } => Some(
                "the differentiator rounds off what reverses within its window, as friction does (try a shorter half_width, or \
                 differentiator = \"central\")",
            ),
            Differentiator::StateFilter { .. } => Some(
                "the differentiator rounds off fast reversals, as of friction (try a higher state_filter_hz, or differentiator = \
                 \"central\")",
            ),
        };
        let without_ratio = match self.robot.config.estimator.kind {
            EstimatorKind::Energy | EstimatorKind::RlsEnergy => "not known: a row of energies belongs to no joint",
            _ => OF_DELAYED,
        };
        // What is held is not what the instruments say.
        let p = self.parameters;
        let [values, reference, std] = [&p.values, &p.reference, &p.std].map(|x| &x[..p.len()]);
        let largest = Largest::new(self.robot, [values, reference, std], |i| self.state(i) == "active");
        Compared { distorts, without_ratio, largest }
    }

    /// Everything, under the same names as the text.
    pub(crate) fn json(&self) -> Value {
        let p = self.parameters;
        let names = (0..p.len()).map(|i| self.robot.base.name(&self.robot.model, i));
        let parameters: Vec<Value> = names
            .enumerate()
            .map(|(i, name)| {
                json!({
                    "name": name, "value": p.values[i], "std": p.std[i], "state": self.state(i),
                    "least_squares": p.reference[i], "nominal": self.robot.nominal_base[i],
                    "excitation": p.excitation[i],
                })
            })
            .collect();
        let joints: Vec<Value> = self
            .robot
            .model
            .arm
            .joints
            .iter()
            .enumerate()
            .map(|(j, joint)| {
                json!({
                    "joint": joint.name, "residual_rms": p.residual_rms[j],
                    "nominal_residual_rms": self.health.nominal_residual_rms[j], "torque_rms": self.health.torque_rms[j],
                    "torque_noise": p.torque_noise[j],
                    "as_found_percent": self.as_found.as_ref().map(|last| last.found[j]),
                    "as_given_percent": self.as_found.as_ref().map(|last| last.given[j]),
                })
            })
            .collect();
        json!({
            "robot": self.robot.config.name, "samples": self.samples, "used": self.health.samples,
            "lost": self.health.lost,
            "input_faults": faults_met(self.health).into_iter().collect::<std::collections::BTreeMap<_, _>>(), "epoch": p.epoch, "seq": p.seq, "model_hash": format!("{:016x}", p.model_hash),
            "instruments": self.instruments(), "advice": self.advice(), "warnings": self.doubts(), "parameters": parameters, "joints": joints,
            "bias": self.bias().map(|bias| bias_json(&bias, &self.compared())),
        })
    }
}

impl fmt::Display for Summary<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (p, model, base) = (self.parameters, &self.robot.model, &self.robot.base);
        writeln!(
            f,
            "{}: {} samples, {} lost, epoch {}",
            self.robot.config.name, self.samples, self.health.lost, p.epoch
        )?;
        writeln!(f, "instruments: {}", self.instruments())?;
        if self.without() {
            write!(f, "{}", paragraph("warning: ", self.advice()))?;
        }
        if let Some(why) = unused(self.health, self.samples, self.coarse) {
            write!(f, "{}", paragraph("warning: ", &why))?;
        }
        for doubt in self.doubts() {
            write!(f, "{}", paragraph("warning: ", &doubt))?;
        }
        let count = |state: &str| (0..p.len()).filter(|&i| self.state(i) == state).count();
        let counts = format!(
            "{}, of them {} active, {} held, {} open (not identified one by one)",
            p.len(),
            count("active"),
            count("held"),
            count("open")
        );
        writeln!(f, "{}", paragraph("base parameters: ", &counts))?;
        let mut table = Table::new(["parameter", "value", "std", "least sq.", "nominal", "state", "unit"]);
        for i in 0..p.len() {
            let parameter = model.parameters[base.independent[i]];
            if parameter.group() == ParameterGroup::Inertial {
                continue;
            }
            let numbers = [p.values[i], p.std[i], p.reference[i], self.robot.nominal_base[i]];
            let words = [self.state(i).to_owned(), parameter.unit(&model.arm).to_owned()];
            let name = [base.name(model, i)];
            table.row(name.into_iter().chain(numbers.map(|x| format!("{x:.5}"))).chain(words));
        }
        write!(f, "{}", table.text())?;
        let inertial =
            (0..p.len()).filter(|&i| model.parameters[base.independent[i]].group() == ParameterGroup::Inertial);
        writeln!(f, "and {} inertial base parameters (--json and --stream have all)\n", inertial.count())?;
        let heads = ["joint", "residual [N m]", "nominal [N m]", "torque [N m]", "left [%]", "as found [%]"];
        let mut table = Table::new(heads);
        let percent = |x: Option<f64>| x.map_or_else(|| "-".to_owned(), |x| format!("{x:.1}"));
        for (j, joint) in model.arm.joints.iter().enumerate() {
            let (residual, nominal) = (p.residual_rms[j], self.health.nominal_residual_rms[j]);
            let numbers = [residual, nominal, self.health.torque_rms[j]].map(|x| format!("{x:.3}"));
            let found = self.as_found.as_ref().filter(|_| self.residual_percent(j).is_some()).map(|last| last.found[j]);
            let name = [joint.name.clone()];
            table.row(name.into_iter().chain(numbers).chain([percent(self.residual_percent(j)), percent(found)]));
        }
        write!(f, "{}", table.text())?;
        let meaning = "model-filtered torque not explained one step ahead, rms over the window";
        write!(f, "{}", paragraph("residual and left: ", meaning))?;
        let meaning = "what the values above leave of the last window, rows near standstill included";
        writeln!(f, "{}", paragraph("as found: ", meaning))?;
        match self.bias() {
            Some(bias) => write!(f, "{}", bias_text(&bias, &self.compared()).trim_end()),
            None if self.robot.config.estimator.kind.least_squares() => {
                write!(f, "bias of LS: nothing to compare: least squares alone, without instruments")
            }
            None => write!(f, "bias of LS: the last window has too few rows to compare it with the instruments"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A publisher that is gone for a while beside samples that are all refused, or beside others that may have been learnt from.
    #[test]
    fn where_all_samples_were_refused_there_are_no_others() {
        let mut health = Health { rejected_faults: 30, ..Health::default() };
        health.input_faults[InputFault::Implausible as usize] = 30;
        health.input_faults[InputFault::PublisherGone as usize] = 1;
        let text = |samples| unused(&health, samples, None).expect("something was wrong");
        assert!(text(30).starts_with("30 of 30 samples were refused; met: "), "{}", text(30));
        assert!(text(40).contains("not all others could be used"), "{}", text(40));
    }
}
