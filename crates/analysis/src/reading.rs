//! How a log has to be read, by all readings compared (`rivet-screening`): the same answer for every command.

use std::fmt::Write as _;

use rivet_config::Robot;
use rivet_logs::Log;
use rivet_screening::priors::REPORTED;
use rivet_screening::{ArmState, Fault, Of, Reading, RobotFile, Screening, Stretch, screen};

use crate::evidence::{Distrust, UNEXPLAINED_NAME};
use crate::glitches::{bridged, jumps};
use crate::runs;
use crate::table::number;

/// Name of the finding in JSON.
pub const READING_NAME: &str = "log_reading";

/// The readings of a log, compared; none where it has no torque, too little motion, or no stretch without a hole.
pub(crate) fn compare(robot: &Robot, log: &Log) -> Option<Screening> {
    log.torque().ok()?;
    let usual = log.median_step_s();
    // Rows that cannot be true say nothing of the reading: bridged where they are few, else the log is cut there.
    let mended = bridged(robot, log.clone()).ok().map(|(log, _)| log);
    let log = mended.as_ref().unwrap_or(log);
    let grids: Vec<Log> = log
        .split_without(&jumps(robot, log), runs::hole_s(usual))
        .into_iter()
        .filter_map(|piece| piece.resample(usual).ok().map(|(grid, _)| grid))
        .collect();
    let stretches: Vec<Stretch<'_>> = grids
        .iter()
        .filter_map(|grid| {
            let start_s = grid.t.first().copied()?;
            Some(Stretch { period_s: usual, start_s, q: &grid.q, tau: grid.torque().ok()? })
        })
        .collect();
    let file =
        RobotFile { model: &robot.model, nominal: &robot.nominal, torque_limit: &robot.config.drive.torque_limit };
    screen(&file, &stretches)
}

/// The reading of a log that is reported.
pub(crate) struct Found {
    /// The log's name.
    pub(crate) log: String,
    joint: Option<String>,
    /// What it is, its probability, what to do, alternatives.
    pub(crate) text: String,
    /// Whether causes of a diagnosis of this log mean nothing; not where the diagnosis itself deals with it (one joint that is not
    /// trusted, a mounting).
    pub(crate) spoils: bool,
    /// Whether friction changes while it is logged.
    pub(crate) drifts: bool,
    /// Posterior probability of this reading alone.
    probability: f64,
    /// Faults of the channels, each with the names of its joints; none where only the arm is otherwise.
    faults: Vec<(Fault, Vec<String>)>,
}

/// What a diagnosis has done about the channels of a log.
pub(crate) struct DealtWith<'a> {
    /// Effects that it found, each with its joints; no joints: the whole arm.
    pub(crate) effects: Vec<(&'a str, &'a [String])>,
    /// Joints whose torque it does not use.
    pub(crate) left_out: Vec<&'a str>,
    /// Joints whose torque it has shifted onto their motion; an empty name: all of them.
    pub(crate) aligned: Vec<&'a str>,
}

impl DealtWith<'_> {
    /// Whether it has dealt with `fault` of the joints `of` (none: all).
    fn covers(&self, fault: &Fault, of: &[String]) -> bool {
        let expressed = |(effect, joints): &(&str, &[String])| {
            fault.effects().contains(effect) && of.iter().all(|joint| joints.is_empty() || joints.contains(joint))
        };
        let among = |names: &[&str]| !of.is_empty() && of.iter().all(|joint| names.contains(&joint.as_str()));
        let aligned = |of: &[String]| {
            if of.is_empty() { !self.aligned.is_empty() } else { self.aligned.contains(&"") || among(&self.aligned) }
        };
        self.effects.iter().any(expressed)
            || fault.is_of_torque_alone() && among(&self.left_out)
            || matches!(fault, Fault::Late(..)) && aligned(of)
    }
}

impl Found {
    /// Whether a diagnosis has dealt with every fault, so that its causes mean something.
    pub(crate) fn is_dealt_with(&self, by: &DealtWith<'_>) -> bool {
        !self.faults.is_empty() && self.faults.iter().all(|(fault, of)| by.covers(fault, of))
    }

    /// Whether this reading by itself, without those like it, is probable enough to be reported.
    pub(crate) fn is_sure(&self) -> bool {
        self.probability >= REPORTED
    }

    /// As one of a list of warnings.
    pub(crate) fn distrust(&self) -> Distrust {
        Distrust { log: Some(self.log.clone()), joint: self.joint.clone(), name: READING_NAME, text: self.text.clone() }
    }
}

/// How a log has to be read, where that is surely otherwise than as it is.
pub(crate) fn find(robot: &Robot, log: &Log) -> Option<Found> {
    let found = compare(robot, log)?;
    let reading = found.finding()?;
    let names = runs::joint_names(robot);
    let joints_of = |fault: &Fault| fault.joints().into_iter().map(|j| names[j].clone()).collect();
    Some(Found {
        log: runs::short_name(&log.path),
        joint: joint(robot, reading),
        text: text(robot, &found, reading),
        spoils: spoils(reading),
        drifts: wrong(reading).next().is_none() && reading.state == ArmState::Drift,
        probability: reading.probability,
        faults: wrong(reading).map(|fault| (fault.clone(), joints_of(fault))).collect(),
    })
}

/// The same for a list of warnings.
pub fn distrust(robot: &Robot, log: &Log) -> Option<Distrust> {
    find(robot, log).map(|found| found.distrust())
}

/// Faults that analyses do not deal with by themselves.
fn wrong(reading: &Reading) -> impl Iterator<Item = &Fault> {
    reading.faults.iter().filter(|fault| !fault.is_slight())
}

fn joint(robot: &Robot, reading: &Reading) -> Option<String> {
    let faults: Vec<&Fault> = wrong(reading).collect();
    match faults.as_slice() {
        [one] if one.joints().len() == 1 => Some(robot.model.arm.joints[one.joints()[0]].name.clone()),
        _ => None,
    }
}

/// Most probable reading, probability, what to do, alternatives, what would decide.
fn text(robot: &Robot, found: &Screening, reading: &Reading) -> String {
    let names = runs::joint_names(robot);
    let percent = |residual: &[f64]| {
        let known: Vec<f64> = residual.iter().copied().filter(|r| r.is_finite()).collect();
        number(100.0 * (known.iter().map(|r| r * r).sum::<f64>() / known.len().max(1) as f64).sqrt(), 2)
    };
    let mut text = format!(
        "most probable reading (probability {:.2}): {}; {}. Read so, values within their priors leave {} % of the torque, as logged {} %",
        reading.probability,
        reading.text(&names),
        reading.mend(&names),
        percent(&reading.residual),
        percent(if reading.faults.is_empty() { &found.as_given } else { &found.residual })
    );
    // Residuals of joints that say nothing are no numbers, and equal to none.
    let is_other = |r: &&Reading| r.faults != reading.faults || r.state != reading.state;
    let others: Vec<&Reading> = found.readings.iter().filter(is_other).collect();
    if let Some(next) = others.first() {
        let listed: Vec<String> = others.iter().map(|r| format!("{} ({:.2})", r.text(&names), r.probability)).collect();
        let _ = write!(text, ". Alternatives: {}; to decide, {}", listed.join(", "), reading.decided_by(next));
    }
    text
}

fn spoils(reading: &Reading) -> bool {
    use Fault::{BeyondLimit, Mounting, TorqueScale, TorqueSign};
    let of_all =
        |fault: &Fault| !matches!(fault, TorqueSign(Of::Joint(_)) | TorqueScale(..) | Mounting(_) | BeyondLimit(..));
    if wrong(reading).next().is_some() {
        return wrong(reading).any(of_all);
    }
    matches!(reading.state, ArmState::FileUnit(_) | ArmState::Computed | ArmState::Commanded)
}

/// Warnings of single joints that one reading of all of them explains.
const EXPLAINED: [&str; 5] = ["torque_sign", "torque_scale", "friction_gives_energy", "another_arm", UNEXPLAINED_NAME];

/// Puts readings of logs first, and takes out what one of the whole arm explains: one fault is said once.
pub fn first(warnings: &mut Vec<Distrust>) {
    let (mut ordered, mut others): (Vec<_>, Vec<_>) = warnings.drain(..).partition(|d| d.name == READING_NAME);
    let is_explained = |d: &Distrust| EXPLAINED.contains(&d.name);
    if ordered.iter().any(|reading| reading.joint.is_none()) {
        others.retain(|d| !is_explained(d));
    }
    ordered.retain(|r| r.joint.is_none() || !others.iter().any(|d| d.joint == r.joint && is_explained(d)));
    ordered.extend(others);
    *warnings = ordered;
}

/// Says how a log has to be read, for commands without a list of warnings.
pub(crate) fn warn(robot: &Robot, log: &Log) {
    if let Some(said) = distrust(robot, log) {
        said.warn();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(faults: Vec<(Fault, Vec<String>)>) -> Found {
        Found {
            log: "run.csv".to_owned(),
            joint: None,
            text: String::new(),
            spoils: true,
            drifts: false,
            probability: 1.0,
            faults,
        }
    }

    fn names(of: &[&str]) -> Vec<String> {
        of.iter().map(|name| (*name).to_owned()).collect()
    }

    #[test]
    fn every_fault_has_to_be_dealt_with() {
        let zero = (Fault::JointZero(1, 0.5), names(&["elbow"]));
        let sign = (Fault::TorqueSign(Of::Joint(0)), names(&["base"]));
        let elbow = names(&["elbow"]);
        let by = |effect: bool, left_out: bool| DealtWith {
            effects: if effect { vec![("encoder_offset", elbow.as_slice())] } else { Vec::new() },
            left_out: if left_out { vec!["base"] } else { Vec::new() },
            aligned: Vec::new(),
        };
        for (effect, left_out) in [(true, true), (true, false), (false, true), (false, false)] {
            let both = found(vec![zero.clone(), sign.clone()]);
            assert_eq!(both.is_dealt_with(&by(effect, left_out)), effect && left_out);
            assert_eq!(found(vec![zero.clone()]).is_dealt_with(&by(effect, left_out)), effect);
            assert_eq!(found(vec![sign.clone()]).is_dealt_with(&by(effect, left_out)), left_out);
        }
        assert!(!found(Vec::new()).is_dealt_with(&by(true, true)), "a state of the arm is no fault of a channel");
    }

    #[test]
    fn a_position_is_not_dealt_with_by_leaving_out_its_torque() {
        let by = DealtWith { effects: Vec::new(), left_out: vec!["base"], aligned: Vec::new() };
        assert!(!found(vec![(Fault::PositionSign(Of::Joint(0)), names(&["base"]))]).is_dealt_with(&by));
        assert!(found(vec![(Fault::TorqueScale(0, 2.0), names(&["base"]))]).is_dealt_with(&by));
        assert!(!found(vec![(Fault::TorqueScale(0, 2.0), names(&["elbow"]))]).is_dealt_with(&by));
    }

    #[test]
    fn a_delay_of_about_a_sample_beside_others_asks_for_nothing() {
        let reading = |faults: &[Fault]| Reading {
            faults: faults.to_vec(),
            state: ArmState::Nominal,
            probability: 1.0,
            residual: Vec::new(),
        };
        let (slight, long) = (Fault::Late(Of::Joint(5), 0.012), Fault::Late(Of::Joint(5), 0.045));
        let mounting = Fault::Mounting([0.0, 0.0, 9.81]);
        assert!(!spoils(&reading(&[mounting.clone(), slight.clone()])));
        assert!(spoils(&reading(&[mounting.clone(), long])));
        assert_eq!(wrong(&reading(&[mounting.clone(), slight])).collect::<Vec<_>>(), [&mounting]);
    }

    #[test]
    fn torque_that_is_late_is_dealt_with_where_it_was_shifted() {
        let by = |aligned| DealtWith { effects: Vec::new(), left_out: Vec::new(), aligned };
        let all = found(vec![(Fault::Late(Of::All, 0.05), Vec::new())]);
        let one = found(vec![(Fault::Late(Of::Joint(0), 0.05), names(&["base"]))]);
        assert!(all.is_dealt_with(&by(vec!["elbow"])) && !all.is_dealt_with(&by(Vec::new())));
        assert!(one.is_dealt_with(&by(vec!["base"])) && !one.is_dealt_with(&by(vec!["elbow"])));
        assert!(one.is_dealt_with(&by(vec![""])));
    }
}
