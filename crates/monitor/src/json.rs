//! One look as JSON, for programs. Counts and figures have the names of the bus's messages (`docs/connect.md`).

use rivet_ipc_schema::{ControllerHealth, Health, Parameters, parameter_flags};
use rivet_realtime::LogHistogram;
use serde_json::{Value, json};

use crate::snapshot::{
    Snapshot, WORK, faults_met, input_state, instruments, load, parameter_state, phase_quantiles_us, refusals, source,
    state_folder,
};

/// One look as JSON; `docs/operating.md` has the fields. A number that is not known is null. Durations have their unit in their
/// name. Residuals and torques are in N m (N of a prismatic joint), tracking errors in rad (m), both root mean squares.
pub fn as_json(s: &Snapshot) -> Value {
    json!({
        "robot": s.robot,
        "bus": s.bus,
        "daemon": s.health.map(|report| daemon(s, &report.message, report.rate)),
        "controller": s.controller.map(|report| controller(s, &report.message)),
        "joints": (0..s.joints.len()).map(|j| joint(s, j)).collect::<Vec<_>>(),
        "parameters": s.parameters.as_ref().map(|set| parameters(s, set)),
    })
}

fn age_s(s: &Snapshot, stamp_ns: u64) -> f64 {
    s.now_ns.saturating_sub(stamp_ns) as f64 * 1e-9
}

fn daemon(s: &Snapshot, h: &Health, rate: f64) -> Value {
    let phases_us = s.timing.as_ref().map(|timing| {
        let each = WORK.iter().zip(phase_quantiles_us(timing));
        each.map(|(name, us)| ((*name).to_owned(), json!(us))).collect::<serde_json::Map<_, _>>()
    });
    json!({
        "state": s.mode(), "age_s": age_s(s, h.stamp_ns), "samples": h.samples, "samples_per_s": rate,
        "lost": h.lost, "refused_stale": h.refused_stale, "refused_invalid": h.refused_invalid,
        "rejected_faults": h.rejected_faults, "gaps": h.gaps, "setpoints_missing": h.setpoints_missing,
        "overruns": h.overruns, "catch_up_limited": h.catch_up_limited, "dropped_messages": h.dropped_messages,
        "input": input_state(s, h), "input_faults": counts(faults_met(h)),
        "load": load(h), "load_level": h.load_level, "state_folder": state_folder(h.state_folder),
        "polls": h.polls != 0, "periods": h.periods,
        "wake_us": quantiles_us(&h.wake_histogram, h.worst_wake_ns),
        "work_us": quantiles_us(&h.work_histogram, h.worst_work_ns),
        "phases_p99_us": phases_us,
        "active": h.active, "held": h.held, "window_s": h.window_s, "instruments": instruments(h.instruments),
        "accepted": s.accepted(), "hausman_p_value": h.hausman_p_value,
    })
}

fn controller(s: &Snapshot, c: &ControllerHealth) -> Value {
    json!({
        "state": s.state(), "age_s": age_s(s, c.stamp_ns), "commands": c.commands, "parameters": source(c),
        "accepted": c.accepted, "refusals": counts(refusals(c)), "stops": c.stops, "stop": s.stops(c),
        "resumed": c.resumed, "strayed": c.strayed, "setpoints_refused": c.setpoints_refused,
        "refused_plan": s.refused_plan(c), "broken": c.broken, "refused_stale": c.refused_stale,
        "refused_invalid": c.refused_invalid, "passed_over": c.passed_over, "saturated": c.saturated,
        "rate_limited": c.rate_limited, "setpoints_limited": c.setpoints_limited,
        "foreign_joint_states": c.foreign_joint_states, "foreign_setpoints": c.foreign_setpoints,
        "foreign_parameters": c.foreign_parameters, "state_folder": state_folder(c.state_folder),
        "polls": c.polls != 0,
    })
}

fn joint(s: &Snapshot, j: usize) -> Value {
    // A message has room for so many joints, and an arm may have more.
    let of_daemon = |values: fn(&Health) -> &[f64]| s.health.as_ref().and_then(|r| values(&r.message).get(j).copied());
    let of_controller = |values: fn(&ControllerHealth) -> &[f64]| {
        s.controller.as_ref().and_then(|r| values(&r.message).get(j).copied())
    };
    json!({
        "joint": s.joints[j],
        "torque_rms": of_daemon(|h| &h.torque_rms), "residual_rms": of_daemon(|h| &h.residual_rms),
        "nominal_residual_rms": of_daemon(|h| &h.nominal_residual_rms),
        "prediction_rms": of_controller(|c| &c.prediction_rms), "tracking_rms": of_controller(|c| &c.tracking_rms),
    })
}

fn parameters(s: &Snapshot, set: &Parameters) -> Value {
    let nominal = |i: usize| s.same_model().then(|| s.nominal.get(i).copied()).flatten();
    let values = (0..set.len()).map(|i| {
        json!({
            "name": s.name(i), "value": set.values[i], "std": set.std[i], "nominal": nominal(i),
            "excitation": set.excitation[i], "state": parameter_state(set.state[i]),
        })
    });
    json!({
        "epoch": set.epoch, "seq": set.seq, "model_hash": format!("{:016x}", set.model_hash),
        "same_model": s.same_model(), "late": set.flags & parameter_flags::LATE != 0,
        "frozen": set.flags & parameter_flags::FROZEN != 0, "suspended": set.flags & parameter_flags::SUSPENDED != 0,
        "provisional": set.flags & parameter_flags::PROVISIONAL != 0,
        "bad_input": set.flags & parameter_flags::BAD_INPUT != 0,
        "values": values.collect::<Vec<_>>(),
    })
}

fn counts(counts: Vec<(String, u64)>) -> serde_json::Map<String, Value> {
    counts.into_iter().map(|(name, count)| (name, json!(count))).collect()
}

fn quantiles_us(counts: &[u32; LogHistogram::BINS], worst_ns: u64) -> Value {
    let histogram = LogHistogram::from_counts(*counts, worst_ns);
    let at = |p| histogram.quantile(p) as f64 * 1e-3;
    json!({ "p50": at(0.5), "p99": at(0.99), "p999": at(0.999), "worst": worst_ns as f64 * 1e-3 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rivet_ipc_schema::BusConfig;
    use std::path::Path;

    #[test]
    fn states_numbers_and_names_are_in_it() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../robots/ur10e/robot.toml");
        let mut s = Snapshot::new(&rivet_config::load(file).expect("the arm is there"), &BusConfig::default());
        let empty = as_json(&s);
        assert!(empty["daemon"].is_null() && empty["controller"].is_null() && empty["parameters"].is_null());
        let mut health = Health { mode: 1, samples: 1000, lost: 3, window_s: f64::INFINITY, ..Health::default() };
        health.stamp_ns = s.now_ns;
        health.wake_histogram[14] = 100;
        health.worst_wake_ns = 40_000;
        health.residual_rms[1] = 0.25;
        s.take_health(&health);
        s.take_controller(&ControllerHealth { state: 2, source: 2, stamp_ns: s.now_ns, ..ControllerHealth::default() });
        let mut set = Parameters { count: s.names.len() as u32, model_hash: s.hash, epoch: 5, ..Parameters::default() };
        set.values[0] = 1.5;
        s.parameters = Some(set);
        let value = as_json(&s);
        assert_eq!(value["daemon"]["state"], "estimating");
        assert_eq!((&value["daemon"]["lost"], &value["daemon"]["wake_us"]["worst"]), (&json!(3), &json!(40.0)));
        assert!(value["daemon"]["window_s"].is_null(), "an endless window has no length");
        assert_eq!(value["joints"][1]["residual_rms"], 0.25);
        assert_eq!(value["joints"].as_array().map(Vec::len), Some(s.joints.len()));
        assert_eq!(value["parameters"]["values"][0]["name"], s.names[0]);
        assert_eq!(value["parameters"]["values"][0]["value"], 1.5);
        assert_eq!(value["controller"]["state"], "following");
    }
}
