//! An identification as text and as JSON.

use std::path::Path;

use rivet_config::{EstimatorKind, Instruments, Robot};
use rivet_estimation::offline::{Determined, InstrumentSource, Lag, Rows};
use serde_json::{Value, json};

use super::Findings;
use crate::delays;
use crate::evidence::{self, Compared, Largest};
use crate::open_keys::OpenKeys;
use crate::refine::{Refined, law_json};
use crate::rows::Run;
use crate::runs;
use crate::table::{Table, number, paragraph};

/// Why these instruments, in words.
fn instrument_text(robot: &Robot, run: &Run, rows: &Rows) -> String {
    match run.source {
        InstrumentSource::Desired => {
            let lags: Vec<f64> = rows.lags.iter().map(|lag| (1e3 * lag.seconds).round() + 0.0).collect();
            let each: Vec<String> = lags.iter().map(|lag| format!("{lag:.0}")).collect();
            let ahead = if lags.iter().any(|lag| *lag < 0.0) { " (negative: the joint is ahead of it)" } else { "" };
            let names: Vec<String> = robot.model.arm.joints.iter().map(|joint| joint.name.clone()).collect();
            let untold: Vec<usize> = (0..lags.len()).filter(|j| !rows.lags[*j].told).collect();
            let untold = match &untold[..] {
                [] => String::new(),
                all if all.len() == lags.len() => {
                    "; this motion determines it for no joint, so none is used".to_owned()
                }
                some => format!(
                    "; for {} this motion does not determine it, so that of the others is used",
                    delays::named(&names, some)
                ),
            };
            format!("desired trajectory, delayed by the tracking lag of {} ms{ahead}{untold}", each.join(" "))
        }
        InstrumentSource::SecondEncoder => "motion by second encoders".to_owned(),
        InstrumentSource::Delayed(seconds) => {
            let back = (seconds / run.piece.report.period_s).round();
            let grid = &run.piece.grid;
            let why = match robot.config.estimator.instruments {
                Instruments::Auto { .. } if grid.q_des.is_none() => "no desired trajectory in the log: ",
                Instruments::Auto { .. } => "desired trajectory not followed: ",
                Instruments::PreviousCycle { .. } => {
                    "\"previous-cycle\" acts on line only, off line no cycle is looked for: "
                }
                Instruments::Delayed { .. } => "as the robot file asks: ",
                Instruments::Setpoint | Instruments::SetpointThroughLoop | Instruments::SecondEncoder => {
                    "the log has not those of the robot file, and least squares ask for none; to compare with: "
                }
            };
            // On line "auto" takes them by itself.
            let second = match robot.config.estimator.instruments {
                Instruments::Auto { .. } if grid.q_link.iter().all(Option::is_some) => {
                    "; off line, q_link is taken only with instruments = \"second-encoder\""
                }
                _ => "",
            };
            format!("{why}delayed instruments, k = {back} samples ({seconds} s){second}")
        }
    }
}

pub(super) fn text(robot: &Robot, result: &Findings, open: &OpenKeys) -> String {
    let (model, base) = (&robot.model, &robot.base);
    let chosen = result.chosen(robot);
    let signal = &robot.config.signal;
    let model_size = format!(
        "{} joints, {} base parameters, model filter {} Hz (zero-phase)",
        robot.dof(),
        base.len(),
        signal.model_filter_hz
    );
    let mut out = paragraph(&format!("identify {}: ", robot.config.name), &model_size);
    out += &open.text();
    for (run, rows) in result.runs.iter().zip(&result.rows) {
        let (grid, range) = (&run.piece.grid, &rows.moving);
        out += &paragraph("  log         ", &format!("{}: {}", runs::short_name(&grid.path), run.piece.report));
        let left_out: Vec<String> = rows.left_out.iter().map(|share| format!("{:.0}", 100.0 * share)).collect();
        let counts: Vec<String> = (0..robot.dof()).map(|j| rows.count(j).to_string()).collect();
        out += &paragraph(
            "  motion      ",
            &format!(
                "{:.2} s to {:.2} s; rows per joint {}, left out below the dead zone {} %",
                grid.t[range.start],
                grid.t[range.end - 1],
                counts.join(" "),
                left_out.join(" ")
            ),
        );
        out += &paragraph("  instruments ", &instrument_text(robot, run, rows));
    }
    out += &evidence::signal_text(robot);
    let delayed = result.runs.iter().any(|run| matches!(run.source, InstrumentSource::Delayed(_)));
    out += &evidence::online_text(robot, delayed);
    out += &evidence::distrust_text(&result.distrusts);
    let residual = "100*|tau - D x|/|tau| on these rows; left out: on quarters, by values of the others";
    out += &paragraph("\nresidual ", residual);
    let mut table = Table::new(["joint", "nominal %", "LS %", "IV %", "left out %", "noise N m", "rows a free row"]);
    for (j, name) in runs::joint_names(robot).into_iter().enumerate() {
        // Of a joint that never moves nothing is known.
        let known = |text: String| if chosen.noise[j].is_nan() { "-".to_owned() } else { text };
        let percent = |k: usize| known(format!("{:.1}", result.residuals[k][j]));
        let (noise, correlation) = (known(number(chosen.noise[j], 3)), known(format!("{:.1}", chosen.correlation[j])));
        let left_out = result.parts.left_out[j];
        let left_out = if left_out.is_nan() { "-".to_owned() } else { format!("{left_out:.1}") };
        table.row([name, percent(0), percent(1), percent(2), left_out, noise, correlation]);
    }
    out += &table.text();
    out += &evidence::beside_text(&runs::joint_names(robot), chosen);
    for held in &result.held_out {
        out +=
            &paragraph("\n", &format!("held out, 100*|tau-pred|/|tau| on {}", runs::short_name(Path::new(&held.file))));
        let mut table = Table::new(["joint", "nominal %", "identified %", "consistent %"]);
        for (j, name) in runs::joint_names(robot).into_iter().enumerate() {
            let consistent = held.consistent.as_ref().map_or_else(|| "-".to_owned(), |of| format!("{:.1}", of[j]));
            table.row([name, format!("{:.1}", held.nominal[j]), format!("{:.1}", held.identified[j]), consistent]);
        }
        out += &table.text();
        if let Some(cost) = held.cost() {
            let more = if cost < 0.0 { "less" } else { "more" };
            let text =
                format!("what can be built misses {:.1} points {more} of the torque, rms over joints", cost.abs());
            out += &paragraph("  ", &text);
        }
    }
    let count = |by: Determined| chosen.determined.iter().filter(|d| **d == by).count();
    let held_text = match count(Determined::ByBound) {
        0 => String::new(),
        count => format!(", {count} held"),
    };
    let known = format!(
        "{} of {}, condition {}; {} parameters decided by the data, {} by the prior (nominal){held_text}",
        chosen.rank,
        base.len(),
        number(chosen.condition, 2),
        count(Determined::ByData),
        count(Determined::ByPrior)
    );
    out += "\n";
    out += &paragraph("rank ", &known);
    let not_excited = result.not_excited.text();
    if !not_excited.is_empty() {
        out += &paragraph("not excited: ", &not_excited);
    }
    out += &evidence::bias_text(&result.bias, &compared(robot, result));
    out += &delays::text(&runs::joint_names(robot), &result.delays, &result.dry);
    out += &evidence::sampling_text(robot, result.runs.iter().map(|run| &run.piece.report));
    out += &evidence::consistency_text(&result.consistent);
    out += &exported_text(result);
    out.push('\n');
    let (which, other, others) = if robot.config.estimator.kind == EstimatorKind::Riv {
        ("IV", "LS", &result.least_squares)
    } else {
        ("LS", "IV", &result.instrumental)
    };
    let mut table = Table::new(["parameter", which, "std", "decided by", other, "nominal", "unit"]);
    for i in 0..base.len() {
        let decided = decided(chosen.determined[i]);
        let std = if chosen.determined[i] == Determined::ByBound { "-".to_owned() } else { number(chosen.std[i], 2) };
        table.row([
            base.name(model, i),
            number(chosen.values[i], 4),
            std,
            decided.to_owned(),
            number(others.values[i], 4),
            number(robot.nominal_base[i], 4),
            base.parameter(model, i).unit(&model.arm).to_owned(),
        ]);
    }
    out + &table.text()
}

/// Which set is exported, and why.
fn exported_text(result: &Findings) -> String {
    let Some(sets) = &result.sets else { return String::new() };
    let [free, consistent] = sets.percents().map(|percent| number(percent, 3));
    let which = if result.exports_consistent { "physically consistent" } else { "unconstrained" };
    let why = format!(
        "left-out parts of the logs: {free} % of the torque missed unconstrained, {consistent} % consistent, rms over joints"
    );
    paragraph("exported set: ", &format!("{which} ({why})"))
}

fn decided(by: Determined) -> &'static str {
    match by {
        Determined::ByData => "data",
        Determined::ByPrior => "prior",
        Determined::ByBound => "bound",
    }
}

/// What the comparison of the methods rests on, off line: central differences, whatever the robot file asks for.
fn compared(robot: &Robot, result: &Findings) -> Compared {
    let (iv, ls) = (&result.instrumental, &result.least_squares);
    // Of what either is sure of, the less.
    let std: Vec<f64> = iv.std.iter().zip(&ls.std).map(|(iv, ls)| iv.min(*ls)).collect();
    let largest = Largest::new(robot, [&iv.values, &ls.values, &std], |_| true);
    Compared { distorts: None, without_ratio: evidence::OF_DELAYED, largest }
}

pub(super) fn to_json(robot: &Robot, result: &Findings, open: &OpenKeys, refined: Option<&Refined>) -> Value {
    let (model, base) = (&robot.model, &robot.base);
    let chosen = result.chosen(robot);
    let parameter = |i: usize| {
        let regrouped: Vec<Value> = base
            .regrouping(i)
            .into_iter()
            .map(|(k, factor)| json!({"name": model.parameters[k].name(&model.arm), "factor": factor}))
            .collect();
        json!({
            "name": base.name(model, i),
            "unit": base.parameter(model, i).unit(&model.arm),
            "value": chosen.values[i],
            "std": if chosen.determined[i] == Determined::ByBound { None } else { Some(chosen.std[i]) },
            "decided_by": decided(chosen.determined[i]),
            "instrumental": result.instrumental.values[i],
            "least_squares": result.least_squares.values[i],
            "nominal": robot.nominal_base[i],
            "regrouped": regrouped,
        })
    };
    let log = |(run, rows): (&Run, &Rows)| {
        let report = &run.piece.report;
        let range = &rows.moving;
        json!({
            "file": run.piece.grid.path.display().to_string(),
            "rows": report.rows_in,
            "mean_rate_hz": report.mean_rate_hz,
            "jitter_s": report.jitter_s,
            "stamps_jitter_s": report.stamps_jitter_s,
            "taken_as_even": report.stamps_jitter_s.is_some(),
            "gaps": report.gaps.len(),
            "missing_rows": report.missing,
            "period_s": report.period_s,
            "resampling": report.to_string(),
            "motion_s": [run.piece.grid.t[range.start], run.piece.grid.t[range.end - 1]],
            "rows_per_joint": (0..robot.dof()).map(|j| rows.count(j)).collect::<Vec<_>>(),
            "left_out": rows.left_out,
            "instruments": match run.source {
                InstrumentSource::Desired => {
                    let [lag, std] = [|lag: &Lag| lag.seconds, |lag: &Lag| lag.std_s]
                        .map(|of| rows.lags.iter().map(of).collect::<Vec<f64>>());
                    json!({"kind": "desired", "lag_s": lag, "lag_std_s": std})
                }
                InstrumentSource::SecondEncoder => json!({"kind": "second_encoder"}),
                InstrumentSource::Delayed(delay_s) => json!({"kind": "delayed", "delay_s": delay_s}),
            },
        })
    };
    let late = delays::json(&result.delays, &result.dry);
    let per_joint = |j: usize| {
        json!({
            "joint": model.arm.joints[j].name,
            "residual_percent": {
                "nominal": result.residuals[0][j],
                "least_squares": result.residuals[1][j],
                "instrumental": result.residuals[2][j],
            },
            "left_out_percent": result.parts.left_out[j],
            "torque_delay_s": late[j],
            "noise": chosen.noise[j],
            "rows_per_free_row": if chosen.noise[j].is_nan() { None } else { Some(chosen.correlation[j]) },
            "beside_stop": evidence::beside_json(chosen, j),
        })
    };
    let compared = compared(robot, result);
    json!({
        "robot": robot.config.name,
        "model_hash": format!("{:016x}", robot.hash),
        "estimator": if robot.config.estimator.kind == EstimatorKind::Riv { "instrumental" } else { "least_squares" },
        // What the values of friction belong to.
        "friction_law": law_json(&robot.friction_law()),
        "refined": refined.map(Refined::json),
        "chosen_from_logs": open.json(),
        "exported": if result.exports_consistent { "consistent" } else { "unconstrained" },
        "left_out_percent": result.sets.as_ref().map(|sets| {
            let [unconstrained, consistent] = sets.percents();
            json!({"unconstrained": unconstrained, "consistent": consistent})
        }),
        "logs": result.runs.iter().zip(&result.rows).map(log).collect::<Vec<_>>(),
        "joints": (0..robot.dof()).map(per_joint).collect::<Vec<_>>(),
        "not_excited": result.not_excited.json(),
        "warnings": evidence::distrust_json(&result.distrusts),
        "rank": chosen.rank,
        "base_parameters": base.len(),
        "condition": chosen.condition,
        "largest_shift": compared.largest.as_ref().map(Largest::json),
        "bias": evidence::bias_json(&result.bias, &compared),
        "consistent": evidence::consistency_json(robot, &result.consistent),
        "held_out": result.held_out.iter().map(|held| json!({
            "file": held.file,
            "nominal_percent": held.nominal,
            "identified_percent": held.identified,
            "consistent_percent": held.consistent,
            "consistent_cost_points": held.cost(),
        })).collect::<Vec<_>>(),
        "parameters": (0..base.len()).map(parameter).collect::<Vec<_>>(),
    })
}
