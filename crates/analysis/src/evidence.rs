//! What `rivet identify` says about its own result: is it biased, and can an arm be built like this?

use std::collections::BTreeSet;

use rivet_config::keys::Fallback;
use rivet_config::{Differentiator, Filtering, Instruments, Origin, Resolved, Robot, Value as Given};
use rivet_diagnosis::LogFault;
use rivet_estimation::Settings;
use rivet_estimation::consistency::{ConsistencyError, Projection};
use rivet_estimation::offline::{Bias, Fit, Rows, giving_friction, torque_sense};
use rivet_logs::ResampleReport;
use serde_json::{Value, json};

use crate::session;
use crate::table::{number, paragraph};

/// Below this probability, chance is no explanation.
const SIGNIFICANT: f64 = 0.01;

/// What the run says of its comparison beside the numbers.
pub struct Compared {
    /// What an on-line differentiator may do to it, and the remedy; none where derivatives are central differences.
    pub distorts: Option<&'static str>,
    /// Why ratios per joint are not known, where they are not.
    pub without_ratio: &'static str,
    /// The largest difference of the two, where there is one to tell.
    pub largest: Option<Largest>,
}

/// The parameter that least squares and instruments differ most in.
pub struct Largest {
    name: String,
    /// How many of its standard deviations.
    deviations: f64,
}

impl Largest {
    /// Of values by instruments, by least squares and standard deviations, of those that count.
    pub fn new(robot: &Robot, [iv, ls, std]: [&[f64]; 3], counts: impl Fn(usize) -> bool) -> Option<Largest> {
        let deviation = |i: usize| (i, (iv[i] - ls[i]).abs() / std[i].max(f64::MIN_POSITIVE));
        let known = (0..iv.len()).filter(|i| counts(*i)).map(deviation).filter(|(_, size)| size.is_finite());
        let (at, deviations) = known.max_by(|a, b| a.1.total_cmp(&b.1))?;
        Some(Largest { name: robot.base.name(&robot.model, at), deviations })
    }

    /// The parameter as JSON.
    pub fn json(&self) -> Value {
        json!({"parameter": self.name, "standard_deviations": self.deviations})
    }
}

/// Why the ratio of instruments to regressor is not known.
pub const OF_DELAYED: &str = "not known with delayed instruments, which differ from the regressor by motion";

/// What the comparison of least squares and instruments comes to.
#[derive(Clone, Copy, PartialEq)]
enum Verdict {
    /// Regressor and instruments are the same.
    Nothing,
    /// Chance sets them that far apart.
    NoSign,
    /// A bias as large would not show.
    CannotTell,
    /// More than chance does, but no parameter differs by what it is known to.
    Agree,
    /// More than chance does, and some parameter shows it.
    Differ,
}

impl Verdict {
    fn new(bias: &Bias, compared: &Compared) -> Verdict {
        let small = compared.largest.as_ref().is_some_and(|largest| largest.deviations < 1.0);
        match bias.p_value < SIGNIFICANT {
            _ if bias.degrees == 0 => Verdict::Nothing,
            true if small => Verdict::Agree,
            true => Verdict::Differ,
            false if bias.spread.is_infinite() || bias.blind() => Verdict::CannotTell,
            false => Verdict::NoSign,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Verdict::Nothing => "nothing_to_compare",
            Verdict::NoSign => "no_sign",
            Verdict::CannotTell => "cannot_tell",
            Verdict::Agree => "agree_for_use",
            Verdict::Differ => "differ",
        }
    }
}

/// Three lines on bias, for people.
pub fn bias_text(bias: &Bias, compared: &Compared) -> String {
    let p = if bias.p_value < 1e-12 { "p < 1e-12".to_owned() } else { format!("p = {}", number(bias.p_value, 2)) };
    let meaning = match Verdict::new(bias, compared) {
        Verdict::Nothing => "regressor and instruments are the same: nothing to compare".to_owned(),
        Verdict::Agree => "LS and IV agree for use: no parameter differs by its standard deviation. The difference \
             is significant, but smaller than their standard deviations"
            .to_owned(),
        Verdict::Differ => {
            let distorts = compared.distorts.map_or_else(String::new, |how| format!(", or {how}"));
            format!(
                "LS and IV differ by more than torque noise and than standard deviations: position noise biases LS, \
                 or the model lacks an effect{distorts}"
            )
        }
        Verdict::CannotTell if bias.spread.is_infinite() => {
            "cannot tell: the data do not determine the parameters by least squares either".to_owned()
        }
        Verdict::CannotTell => format!(
            "cannot tell: IV is {} times as uncertain as LS (median of the directions compared), which hides a bias of LS as large",
            number(bias.spread, 2)
        ),
        Verdict::NoSign => "LS and IV differ by no more than torque noise: no sign of bias in LS".to_owned(),
    };
    let statistic =
        format!("{meaning} (Durbin-Wu-Hausman H = {}, {} free, {p})", number(bias.hausman, 3), bias.degrees);
    let same = bias.degrees == 0 || (!bias.ratio.is_empty() && bias.ratio.iter().all(|r| r.is_infinite()));
    let ratio = if same {
        "not known: what the instruments are made of (q_link, q_des) does not differ from q; is it a copy?".to_owned()
    } else if bias.ratio.is_empty() {
        compared.without_ratio.to_owned()
    } else {
        let one = |r: &f64| if r.is_finite() { number(*r, 2) } else { "-".to_owned() };
        let each: Vec<String> = bias.ratio.iter().map(one).collect();
        format!(
            "noise that biases LS, relative to the part that biases IV, per joint: \
             {} (below 3: tracking error outweighs the noise)",
            each.join(" ")
        )
    };
    let size = compared.largest.as_ref().map_or_else(String::new, |Largest { name, deviations }| {
        paragraph("largest difference IV - LS: ", &format!("{deviations:.1} standard deviations ({name})"))
    });
    paragraph("bias of LS: ", &statistic) + &size + &paragraph("bias of IV: ", &ratio)
}

/// The comparison of least squares and instruments as JSON.
pub fn bias_json(bias: &Bias, compared: &Compared) -> Value {
    // An infinite ratio, of instruments equal to the regressor, is null in JSON.
    json!({
        "hausman": bias.hausman,
        "degrees_of_freedom": bias.degrees,
        "p_value": bias.p_value,
        // Null while running, where it is not known, and where nothing was compared.
        "deviation_ratio": bias.spread,
        "cannot_tell": bias.p_value >= SIGNIFICANT && bias.blind(),
        "verdict": Verdict::new(bias, compared).name(),
        "instrument_ratio": bias.ratio,
        "largest_difference": compared.largest.as_ref().map(Largest::json),
    })
}

/// That signals are not made as the robot file says, where it says anything else than what is done when nothing is said.
pub(crate) fn signal_text(robot: &Robot) -> String {
    let signal = &robot.config.signal;
    let usual = Settings::new(robot.dof(), robot.config.sample_period_s);
    let mut unused = Vec::new();
    match signal.differentiator {
        Differentiator::Central => {}
        other if other == usual.differentiator => {}
        Differentiator::SavitzkyGolay { half_width } => unused.push(format!("half_width = {half_width}")),
        Differentiator::StateFilter { .. } => unused.push("differentiator = \"state-filter\"".to_owned()),
    }
    match signal.filtering {
        Filtering::Model => {}
        Filtering::Input(_) => unused.push("filtering = \"input\"".to_owned()),
        Filtering::None => unused.push("filtering = \"none\"".to_owned()),
    }
    if unused.is_empty() {
        return String::new();
    }
    let text = "central differences through the zero-phase model filter; the robot file's";
    let act = if unused.len() > 1 { "act" } else { "acts" };
    paragraph("  signals     ", &format!("off line, {text} {} {act} on line only", unused.join(" and ")))
}

/// Keys that the robot file sets to something else than their default and that nothing off line asks for; `delayed`: whether instruments
/// are delayed ones.
pub(crate) fn online_text(robot: &Robot, delayed: bool) -> String {
    let acts = |section: &str, name: &str| match section {
        "supervision" => true,
        "estimator" => {
            ["window", "window_s", "window_deviation", "longest_cycle_s"].contains(&name)
                || (name == "delay_s" && !delayed)
        }
        "signal" => name == "torque_noise",
        _ => false,
    };
    let set = |resolved: &&Resolved| {
        let default = match (resolved.key.fallback, &resolved.value) {
            (Fallback::Number(default), Given::Number(x)) => *x == default,
            (Fallback::Integer(default), Given::Integer(x)) => *x == default,
            (Fallback::Text(default), Given::Text(x)) => x == default,
            (_, value) => *value == Given::Absent,
        };
        matches!(resolved.origin, Origin::Line(_)) && !default && acts(resolved.key.section, resolved.key.name)
    };
    let names: Vec<String> = robot.config.resolved.iter().filter(set).map(|resolved| resolved.key.path()).collect();
    if names.is_empty() {
        return String::new();
    }
    paragraph("  on line only ", &names.join(", "))
}

/// Share of repeated rows, or of jitter in a step, that is worth a word.
const UNEVEN: f64 = 0.02;
/// Readings that stand for this many samples while the joint moves are frozen to the daemon: one that came and four that equal it.
const FROZEN_ROWS: f64 = 4.5;

/// For how many periods of the daemon a position of the log is held on average, where that looks frozen to it.
pub fn held_rows(report: &ResampleReport, period_s: f64) -> Option<f64> {
    let share = report.repeated.iter().fold(0.0_f64, |m, s| m.max(*s));
    let rows = report.median_step_s / (1.0 - share).max(0.01) / period_s;
    (share > UNEVEN && rows >= FROZEN_ROWS).then_some(rows)
}

/// What uneven sampling of the logs asks of the differentiator, for people; empty where there is none.
///
/// Off line nothing is to be chosen: held positions are drawn anew where they matter ([`HELD_NAME`]), the rest passes the model filter.
/// The daemon sees samples as they come: its window has to cover two of the longest steps, and what stands for more than four samples
/// while the joint moves is refused as frozen.
pub(crate) fn sampling_text<'a>(robot: &Robot, reports: impl Iterator<Item = &'a ResampleReport>) -> String {
    let period = robot.config.sample_period_s;
    let (mut reach, mut why, mut mended) = (0.0_f64, Vec::new(), None::<f64>);
    let mut frozen = false;
    for report in reports {
        let share = report.repeated.iter().fold(0.0_f64, |m, s| m.max(*s));
        let step = report.median_step_s;
        // A position that repeats with share s is held for 1/(1 - s) rows on average; a jittered row is off by as much.
        let held_s = step / (1.0 - share).max(0.01);
        frozen |= held_rows(report, period).is_some();
        if share > UNEVEN && !why.contains(&"stair-case positions") {
            why.push("stair-case positions");
        }
        if report.jitter_s > UNEVEN * step && !why.contains(&"jittered time stamps") {
            why.push("jittered time stamps");
        }
        mended = [mended, report.stamps_jitter_s].into_iter().flatten().reduce(f64::max);
        reach = reach.max(2.0 * held_s + 3.0 * report.jitter_s);
    }
    let mended = mended.map_or_else(String::new, |jitter_s| {
        let text = format!("time stamps jitter by {} ms; positions are even: taken as even", number(1e3 * jitter_s, 2));
        paragraph("sampling: ", &text)
    });
    if why.is_empty() {
        return mended;
    }
    let needed = (reach / period).ceil();
    let verdict = match robot.config.signal.differentiator {
        Differentiator::SavitzkyGolay { half_width } if half_width as f64 >= needed => {
            format!("half_width = {half_width} covers them")
        }
        Differentiator::StateFilter { hz } if hz * reach <= 1.0 => format!("state_filter_hz = {hz} covers them"),
        Differentiator::StateFilter { .. } => {
            format!("state_filter_hz of at most {} Hz would cover them", number(1.0 / reach, 2))
        }
        Differentiator::Central | Differentiator::SavitzkyGolay { .. } => {
            format!("savitzky-golay with half_width of at least {needed} would cover them")
        }
    };
    let verdict = if frozen {
        "positions that stand so long while the joint moves are refused as frozen: give the daemon the source's own rate".to_owned()
    } else {
        verdict
    };
    let text = format!("{}; on line (every {} ms), {verdict}", why.join(" and "), number(1e3 * period, 3));
    mended + &paragraph("sampling: ", &text)
}

/// A torque or a position that cannot be believed.
#[derive(Clone)]
pub struct Distrust {
    /// The log it is in; none where all of them together say so.
    pub log: Option<String>,
    /// None where it is about the whole log.
    pub joint: Option<String>,
    /// Identifier of the finding in JSON.
    pub name: &'static str,
    /// The finding in words.
    pub text: String,
}

impl Distrust {
    /// A warning on standard error, for commands without a list of them.
    pub fn warn(&self) {
        let place: Vec<&str> = [&self.log, &self.joint].into_iter().flatten().map(String::as_str).collect();
        let place = if place.is_empty() { String::new() } else { format!("{}: ", place.join(", ")) };
        let text = paragraph("warning: ", &format!("{place}{}", self.text));
        session::note(format_args!("{}", text.trim_end()));
    }
}

/// A log in which no joint moves, which is therefore left out.
pub(crate) fn left_out(log: String, purpose: Purpose) -> Distrust {
    let what = match purpose {
        Purpose::Judging => "no error is reported for it",
        Purpose::Learning | Purpose::Comparing => "it is left out, the other logs are used",
    };
    let text = format!("no joint moves faster than its dead zone, beyond the ends that the filter colours: {what}");
    Distrust { log: Some(log), joint: None, name: "log_without_motion", text }
}

/// What a log that is there twice was given for.
#[derive(Clone, Copy)]
pub(crate) enum Purpose {
    Learning,
    Judging,
    Comparing,
}

/// A log whose samples are those of another one as well: given twice, or judged by what was learnt from.
pub(crate) fn repeated(log: String, of: &str, given: Purpose) -> Distrust {
    let (name, text) = match given {
        Purpose::Judging => (
            "hold_out_was_learnt_from",
            "held out, but also used for the fit: its errors are not those on another motion",
        ),
        Purpose::Learning => (
            "log_given_twice",
            "counts twice: it has too much weight, and standard deviations are too small, by up to the root of 2",
        ),
        Purpose::Comparing => ("log_given_twice", "a log always agrees with itself: this pair proves nothing"),
    };
    Distrust { log: Some(log), joint: None, name, text: format!("the same samples as {of}; {text}") }
}

/// Torques of the logs (names, rows) that cannot be believed, by the rules of `rivet diagnose` and by what was found.
pub(crate) fn distrusts<'a>(
    robot: &Robot,
    logs: impl Iterator<Item = (String, &'a Rows)>,
    fit: &Fit,
    rows: &[Rows],
) -> Vec<Distrust> {
    let (model, base) = (&robot.model, &robot.base);
    let joint = |j: usize| Some(model.arm.joints[j].name.clone());
    let mut found = of_torque(robot, logs);
    for (j, power, std) in giving_friction(model, base, fit, rows) {
        if found.iter().any(|d| d.joint == joint(j)) {
            continue;
        }
        let text = format!(
            "friction as found gives energy ({power:.2} +- {std:.2} of torque times speed, one std): the sign of this channel is \
             wrong, or values hold what the model lacks"
        );
        found.push(Distrust { log: None, joint: joint(j), name: "friction_gives_energy", text });
    }
    found
}

/// Torques of the logs (names, rows) that the model as given does not believe, by the rules of `rivet diagnose`.
pub(crate) fn of_torque<'a>(robot: &Robot, logs: impl Iterator<Item = (String, &'a Rows)>) -> Vec<Distrust> {
    let (model, base) = (&robot.model, &robot.base);
    let mut found = Vec::new();
    let mut pieces = Vec::<(String, Vec<&Rows>)>::new();
    for (log, rows) in logs {
        match pieces.iter_mut().find(|(name, _)| *name == log) {
            Some((_, pieces)) => pieces.push(rows),
            None => pieces.push((log, vec![rows])),
        }
    }
    for (log, pieces) in pieces {
        for (j, sense) in torque_sense(model, base, &robot.nominal_base, &pieces).into_iter().enumerate() {
            let Some(sense) = sense else { continue };
            let fault = LogFault::of_torque(sense.dissipates, sense.alike, sense.scale)
                .or_else(|| LogFault::of_silence(sense.varies, sense.due, sense.follows));
            if let Some(fault) = fault {
                // What is identified takes up a factor on a joint that carries little, so it may be the file's as well.
                let or = match fault {
                    LogFault::Scale(_) => " Or are the values in the file as wrong as that?",
                    _ => "",
                };
                let (log, name, joint) = (Some(log.clone()), fault.name(), Some(model.arm.joints[j].name.clone()));
                found.push(Distrust { log, joint, name, text: fault.text() + or });
            }
        }
    }
    found
}

/// Joints of a log whose desired motion is not the one they followed, or whose second encoder sees another.
pub(crate) fn unfollowed(robot: &Robot, log: &str, joints: &BTreeSet<usize>) -> Vec<Distrust> {
    let nevertheless = "instruments are made of it nevertheless, as the robot file asks";
    let (what, taken) = match robot.config.estimator.instruments {
        Instruments::Auto { .. } => (UNFOLLOWED, "delayed instruments are taken in its place".to_owned()),
        Instruments::SecondEncoder => (UNSEEN, nevertheless.to_owned()),
        _ => (UNFOLLOWED, format!("{nevertheless}: \"auto\" would take delayed ones")),
    };
    let distrust_of = |j: &usize| Distrust {
        log: Some(log.to_owned()),
        joint: Some(robot.model.arm.joints[*j].name.clone()),
        name: if what == UNSEEN { UNSEEN_NAME } else { UNFOLLOWED_NAME },
        text: format!("{what}; {taken}"),
    };
    joints.iter().map(distrust_of).collect()
}

/// Joints of a log whose setpoints give other velocities or accelerations than their positions have.
pub fn underived(robot: &Robot, log: &str, joints: &BTreeSet<usize>) -> Vec<Distrust> {
    let distrust_of = |j: &usize| Distrust {
        log: Some(log.to_owned()),
        joint: Some(robot.model.arm.joints[*j].name.clone()),
        name: UNDERIVED_NAME,
        text: "qd_des or qdd_des is not the derivative of q_des (0, another unit, another joint); both are computed \
               from q_des"
            .to_owned(),
    };
    joints.iter().map(distrust_of).collect()
}

/// Positions in steps that matter.
pub(crate) const COARSE_NAME: &str = "coarse_positions";
/// Torque in steps that matter.
pub(crate) const TORQUE_STEPS_NAME: &str = "torque_coarse";
/// Positions with noise that matters.
pub(crate) const NOISY_NAME: &str = "noisy_positions";
/// Positions that are held over rows.
pub(crate) const HELD_NAME: &str = "positions_held";
/// Joints that turn one way only.
pub(crate) const ONE_WAY_NAME: &str = "turns_one_way";
/// A desired motion that is held over rows.
pub(crate) const PLAN_HELD_NAME: &str = "desired_motion_held";
/// Positions that stood for a few rows while their joint moved.
pub(crate) const STOOD_NAME: &str = "positions_stood";
/// Torque that stood while its joint moved.
pub(crate) const TORQUE_STOOD_NAME: &str = "torque_stood";
const UNFOLLOWED_NAME: &str = "desired_motion_not_followed";
const UNDERIVED_NAME: &str = "setpoint_not_derived";
const UNSEEN_NAME: &str = "second_encoder_sees_another_motion";
pub(crate) const UNEXPLAINED_NAME: &str = "torque_unexplained";
pub(crate) const STILL_NAME: &str = "joint_stands";
pub(crate) const BRIEF_NAME: &str = "joint_hardly_moves";
/// What is wrong with a desired motion that is not the one the arm followed.
pub const UNFOLLOWED: &str = "q does not follow q_des, which was not recorded or is that of another motion";

/// The same of a second encoder.
const UNSEEN: &str =
    "q_link is not the motion of q: it was not recorded, has another sign, or is that of another joint";

/// For people; empty where all can be believed. Joints without a plan share a paragraph, and those with the same encoder: often it is all
/// of them.
pub(crate) fn distrust_text(found: &[Distrust]) -> String {
    let shared = |d: &Distrust| {
        [
            UNFOLLOWED_NAME,
            UNDERIVED_NAME,
            UNSEEN_NAME,
            COARSE_NAME,
            TORQUE_STEPS_NAME,
            NOISY_NAME,
            HELD_NAME,
            PLAN_HELD_NAME,
            STOOD_NAME,
            UNEXPLAINED_NAME,
            STILL_NAME,
            ONE_WAY_NAME,
        ]
        .contains(&d.name)
    };
    let alike = |a: &Distrust, b: &Distrust| shared(a) && (&a.log, a.name, &a.text) == (&b.log, b.name, &b.text);
    let warning = |group: &[Distrust]| {
        let of_what: Vec<&str> =
            group[0].log.iter().chain(group.iter().filter_map(|d| d.joint.as_ref())).map(String::as_str).collect();
        let of_what = if of_what.is_empty() { String::new() } else { of_what.join(", ") + ": " };
        paragraph("warning: ", &(of_what + &group[0].text))
    };
    found.chunk_by(alike).map(warning).collect()
}

pub(crate) fn distrust_json(found: &[Distrust]) -> Value {
    let as_json = |d: &Distrust| json!({"log": d.log, "joint": d.joint, "fault": d.name, "text": d.text});
    found.iter().map(as_json).collect()
}

/// Rows that count less than others are worth a word where they take so much away from all that a joint's rows count.
const LESS: f64 = 0.01;

/// Whether rows beside a stop count noticeably less than others, joint by joint.
fn doubted(fit: &Fit, j: usize) -> bool {
    fit.beside[j] * (1.0 - fit.trust[j]) > LESS
}

/// What rows beside a stop count, for people; empty where they count like any other.
pub(crate) fn beside_text(names: &[String], fit: &Fit) -> String {
    let weight_text = |(j, name): (usize, &String)| {
        let (share, trust) = (100.0 * fit.beside[j], number(fit.trust[j], 2));
        doubted(fit, j).then(|| format!("{name} {share:.0} % of its rows, {trust} of another's weight each"))
    };
    let each: Vec<String> = names.iter().enumerate().filter_map(weight_text).collect();
    if each.is_empty() {
        return String::new();
    }
    let why = "their residual is larger than that of others, as with stiction: they are weighted by their residual";
    paragraph("rows next to a stop: ", &format!("{} ({why})", each.join("; ")))
}

/// The same of one joint; null where they count like any other.
pub(crate) fn beside_json(fit: &Fit, j: usize) -> Value {
    if doubted(fit, j) { json!({"share": fit.beside[j], "weight": fit.trust[j]}) } else { Value::Null }
}

/// What physical consistency costs, for people.
pub(crate) fn consistency_text(consistent: &Result<Projection, ConsistencyError>) -> String {
    let text = match consistent {
        Ok(found) => {
            let each: Vec<String> = found.torque_rms.iter().map(|rms| number(*rms, 2)).collect();
            let mut text = format!(
                "nearest arm that can be built changes torque by {} % rms ({} N m per joint)",
                number(found.torque_percent, 2),
                each.join(" ")
            );
            if found.distance > 1.0 {
                text += "; more than the noise explains, so effects the model lacks are in the values";
            }
            if !found.thickened.is_empty() {
                text += "; nominal bodies without extent in some direction were given one: ";
                text += &found.thickened.join(", ");
            }
            text
        }
        Err(why) => format!("no physically consistent set: {why}"),
    };
    paragraph("physical consistency: ", &text)
}

pub(crate) fn consistency_json(robot: &Robot, consistent: &Result<Projection, ConsistencyError>) -> Value {
    let (model, base) = (&robot.model, &robot.base);
    match consistent {
        Ok(found) => {
            let named = |(i, value): (usize, &f64)| json!({"name": base.name(model, i), "value": value});
            let standard = |(p, value): (&rivet_dynamics::Parameter, &f64)| json!({"name": p.name(&model.arm), "unit": p.unit(&model.arm), "value": value});
            json!({
                "torque_percent": found.torque_percent,
                "torque_rms": found.torque_rms,
                "distance": found.distance,
                "smallest_eigenvalue": found.smallest_eigenvalue,
                "iterations": found.iterations,
                "gamma": found.gamma,
                "thickened": found.thickened,
                "base": found.base.iter().enumerate().map(named).collect::<Vec<_>>(),
                "standard": model.parameters.iter().zip(&found.standard).map(standard).collect::<Vec<_>>(),
            })
        }
        Err(why) => json!({"error": why.to_string()}),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bias(spread: f64, p_value: f64, ratio: &[f64]) -> Bias {
        Bias { hausman: 0.6, degrees: 52, spread, p_value, ratio: ratio.to_vec() }
    }

    const ALONE: Compared = Compared { distorts: None, without_ratio: OF_DELAYED, largest: None };

    #[test]
    fn a_bias_has_a_size_beside_its_significance() {
        let of = |deviations: f64, p_value: f64| {
            let compared = Compared { largest: Some(Largest { name: "j2.coulomb".to_owned(), deviations }), ..ALONE };
            let bias = bias(1.5, p_value, &[8.0]);
            assert_eq!(bias_json(&bias, &compared)["largest_difference"]["standard_deviations"], deviations);
            bias_text(&bias, &compared).split_whitespace().collect::<Vec<_>>().join(" ")
        };
        let small = of(0.4, 1e-20);
        assert!(small.contains("LS and IV agree for use") && small.contains("significant"), "{small}");
        assert!(!small.contains("lacks an effect"), "nothing to search for: {small}");
        assert!(small.contains("largest difference IV - LS: 0.4 standard deviations (j2.coulomb)"), "{small}");
        let large = of(3.0, 1e-20);
        assert!(large.contains("position noise biases LS, or the model lacks an effect"), "{large}");
        assert!(!of(0.4, 0.5).contains("for use"));
    }

    #[test]
    fn no_sign_of_bias_is_not_said_where_none_would_show() {
        let text = |bias: &Bias| bias_text(bias, &ALONE).split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(text(&bias(1.5, 0.4, &[8.0])).contains("no sign of bias in LS"));
        let weak = bias(200.0, 1.0, &[8.0]);
        assert!(text(&weak).contains("cannot tell: IV is 200 times as uncertain"), "{}", text(&weak));
        assert_eq!(bias_json(&weak, &ALONE)["cannot_tell"], true);
        assert!(text(&bias(200.0, 1e-9, &[8.0])).contains("position noise biases LS"), "what is seen is seen");
        assert!(
            text(&bias(f64::INFINITY, 1.0, &[8.0]))
                .contains("the data do not determine the parameters by least squares either")
        );
        // Not known while running.
        assert!(text(&bias(f64::NAN, 0.4, &[8.0])).contains("no sign of bias in LS"));
    }

    #[test]
    fn a_copy_of_the_positions_is_called_one() {
        let same = bias_text(&Bias { degrees: 0, ..bias(f64::NAN, 1.0, &[f64::INFINITY; 2]) }, &ALONE);
        assert!(same.contains("does not differ from q") && !same.contains("inf"), "{same}");
    }

    #[test]
    fn the_differentiator_is_named_where_it_may_be_the_cause() {
        let compared = Compared { distorts: Some("it rounds off"), without_ratio: "no joint's", largest: None };
        let text = bias_text(&bias(f64::NAN, 1e-9, &[]), &compared);
        assert!(text.contains("or it rounds off") && text.contains("no joint's"), "{text}");
    }
}
