//! What `rivet identify` says about its own result: is it biased, and can an arm be built like this?

use rivet_config::{Differentiator, Robot};
use rivet_diagnosis::LogFault;
use rivet_estimation::consistency::{ConsistencyError, Projection};
use rivet_estimation::offline::{Bias, Delay, Fit, Rows, giving_friction, torque_sense};
use rivet_logs::ResampleReport;
use serde_json::{Value, json};

use crate::table::{number, paragraph};

/// Below this probability, chance is no explanation.
const SIGNIFICANT: f64 = 0.01;

/// Two lines on bias, for people.
pub(crate) fn bias_text(bias: &Bias) -> String {
    let p = if bias.p_value < 1e-12 { "p < 1e-12".to_owned() } else { format!("p = {}", number(bias.p_value, 2)) };
    let meaning = if bias.degrees == 0 {
        "regressor and instruments are the same: nothing to compare"
    } else if bias.p_value < SIGNIFICANT {
        "LS and IV differ by more than torque noise: position noise pulls LS, or the model lacks an effect"
    } else {
        "LS and IV differ by no more than torque noise: no sign of bias in LS"
    };
    let statistic =
        format!("{meaning} (Durbin-Wu-Hausman H = {}, {} free, {p})", number(bias.hausman, 3), bias.degrees);
    let ratio = if bias.ratio.is_empty() {
        "not known with delayed instruments, which differ from the regressor by motion".to_owned()
    } else {
        let each: Vec<String> = bias.ratio.iter().map(|r| number(*r, 2)).collect();
        format!(
            "noise that pulls LS over what IV keeps of it, per joint: {} (below 3: tracking error outweighs the noise)",
            each.join(" ")
        )
    };
    paragraph("bias of LS: ", &statistic) + &paragraph("bias left in IV: ", &ratio)
}

pub(crate) fn bias_json(bias: &Bias) -> Value {
    // An infinite ratio, of instruments equal to the regressor, is null in JSON.
    json!({
        "hausman": bias.hausman,
        "degrees_of_freedom": bias.degrees,
        "p_value": bias.p_value,
        "instrument_ratio": bias.ratio,
    })
}

/// Share of repeated rows, or of jitter in a step, that is worth a word.
const UNEVEN: f64 = 0.02;
/// Jitter of this share of a step is worth a warning: the measured arm with the most has 0.12.
const LARGE_JITTER: f64 = 0.2;

/// What uneven sampling of the logs asks of the differentiator, for people; empty where there is none.
///
/// Off line nothing is to be chosen: differences pass the model filter with every column. The daemon sees samples as they
/// come, and its window has to cover two of the longest steps.
pub(crate) fn sampling_text<'a>(robot: &Robot, reports: impl Iterator<Item = &'a ResampleReport>) -> String {
    let period = robot.config.sample_period_s;
    let (mut reach, mut why, mut worst_jitter) = (0.0_f64, Vec::new(), None::<(f64, f64)>);
    for report in reports {
        let share = report.repeated.iter().fold(0.0_f64, |m, s| m.max(*s));
        let step = report.median_step_s;
        // A position that repeats with share s is held for 1/(1 - s) rows on average; a jittered row is off by as much.
        let held = step / (1.0 - share).max(0.01);
        if share > UNEVEN && !why.contains(&"stair-case positions") {
            why.push("stair-case positions");
        }
        if report.jitter_s > UNEVEN * step && !why.contains(&"jittered time stamps") {
            why.push("jittered time stamps");
        }
        let most = worst_jitter.map_or(LARGE_JITTER, |(jitter, step)| jitter / step);
        if report.jitter_s > most * step {
            worst_jitter = Some((report.jitter_s, step));
        }
        reach = reach.max(2.0 * held + 3.0 * report.jitter_s);
    }
    if why.is_empty() {
        return String::new();
    }
    let worst = worst_jitter.map_or_else(String::new, |(jitter_s, step_s)| {
        paragraph(
            "warning: ",
            &format!(
                "time stamps jitter by {} ms, {:.0} % of a step: if the samples were taken evenly, positions are put at wrong times, \
                 speed and acceleration are wrong, and so are values and residuals by IV and LS, more than their standard deviations \
                 say (delayed instruments jitter as well); take t from the robot's own clock, not from when a row arrived",
                number(1e3 * jitter_s, 2),
                100.0 * jitter_s / step_s
            ),
        )
    });
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
    let text = format!("{}; on line (every {} ms), {verdict}", why.join(" and "), number(1e3 * period, 3));
    paragraph("sampling: ", &text) + &worst
}

/// A torque or a position that cannot be believed.
pub(crate) struct Distrust {
    /// The log it is in; none where all of them together say so.
    pub(crate) log: Option<String>,
    pub(crate) joint: String,
    pub(crate) name: &'static str,
    pub(crate) text: String,
}

/// Torques of the logs (names, rows) that cannot be believed, by the rules of `rivet diagnose` and by what was found.
pub(crate) fn distrusts<'a>(
    robot: &Robot,
    logs: impl Iterator<Item = (String, &'a Rows)>,
    fit: &Fit,
    rows: &[Rows],
) -> Vec<Distrust> {
    let (model, base) = (&robot.model, &robot.base);
    let joint = |j: usize| model.arm.joints[j].name.clone();
    let mut found = Vec::new();
    for (log, rows) in logs {
        for (j, sense) in torque_sense(model, base, &robot.nominal_base, rows).into_iter().enumerate() {
            let Some(sense) = sense else { continue };
            let fault = LogFault::of_torque(sense.dissipates, sense.alike, sense.scale)
                .or_else(|| LogFault::of_silence(sense.varies, sense.due, sense.follows));
            if let Some(fault) = fault {
                // What is identified takes up a factor on a joint that carries little, so it may be the file's as well.
                let or = match fault {
                    LogFault::Scale(_) => " Or are the values in the file as wrong as that?",
                    _ => "",
                };
                let (log, name, joint) = (Some(log.clone()), fault.name(), joint(j));
                // Once for the pieces of a log.
                if !found.iter().any(|d: &Distrust| d.log == log && d.joint == joint && d.name == name) {
                    found.push(Distrust { log, joint, name, text: fault.text() + or });
                }
            }
        }
    }
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

/// For people; empty where all can be believed.
pub(crate) fn distrust_text(found: &[Distrust]) -> String {
    let of = |d: &Distrust| {
        let log = d.log.as_ref().map_or_else(String::new, |log| format!("{log}, "));
        paragraph("warning: ", &format!("{log}{}: {}", d.joint, d.text))
    };
    found.iter().map(of).collect()
}

pub(crate) fn distrust_json(found: &[Distrust]) -> Value {
    let of = |d: &Distrust| json!({"log": d.log, "joint": d.joint, "fault": d.name, "text": d.text});
    found.iter().map(of).collect()
}

/// How late torque is behind position, for people.
pub(crate) fn delay_text(delays: &[Delay]) -> String {
    let of = |d: &Delay| match d.doubt {
        None => format!("{:.1}+-{:.1}", 1e3 * d.seconds, 1e3 * d.std),
        Some(doubt) => format!("({doubt})"),
    };
    let each: Vec<String> = delays.iter().map(of).collect();
    paragraph("torque behind position: ", &format!("{} ms (one std)", each.join("  ")))
}

/// The same for one joint; null where the data do not tell.
pub(crate) fn delay_json(delay: &Delay) -> Value {
    match delay.doubt {
        None => json!({"value": delay.seconds, "std": delay.std}),
        Some(doubt) => json!({"value": null, "std": null, "doubt": doubt.to_string()}),
    }
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
