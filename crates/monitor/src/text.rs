//! One look as text, for scripts: a word at the beginning of each line says what it is about.

use crate::snapshot::{
    POLLS, Snapshot, controller_faults, drops, figure, flags, input_faults, input_state, instruments, load,
    parameter_state, phases, quantiles, refusals, source, state_folder, worst,
};
use rivet_ipc_schema::Health;
use std::fmt::Write as _;

/// One look as text.
pub fn as_text(s: &Snapshot) -> String {
    let mut out = String::new();
    // Writing to a string does not fail.
    let _ = write(&mut out, s);
    out
}

fn write(out: &mut String, s: &Snapshot) -> std::fmt::Result {
    writeln!(out, "robot        {}, bus {}", s.robot, s.bus)?;
    match s.health.map(|report| report.message) {
        None => writeln!(out, "daemon       not on the bus")?,
        Some(h) => {
            let mode = s.mode().unwrap_or_default();
            writeln!(out, "daemon       {mode}; {} samples, reported {} ago", h.samples, s.age(h.stamp_ns))?;
            writeln!(out, "faults       {}", input_faults(&h))?;
            writeln!(out, "input        {}", input_state(s, &h))?;
            writeln!(out, "load         {}", load(&h))?;
            writeln!(out, "drops        {}", drops(&h))?;
            writeln!(out, "state        {}", state_folder(h.state_folder))?;
            if h.polls != 0 {
                writeln!(out, "wake-up      {POLLS}")?;
            }
            writeln!(out, "periods      {}", h.periods)?;
            writeln!(out, "wake         {}", quantiles(&h.wake_histogram, h.worst_wake_ns))?;
            writeln!(out, "work         {}", quantiles(&h.work_histogram, h.worst_work_ns))?;
            if let Some(timing) = &s.timing {
                writeln!(out, "phases       p99 [us]: {}", phases(timing))?;
                writeln!(out, "worst        {}", worst(timing))?;
            }
            let window = if h.window_s.is_finite() { format!("{:.1} s", h.window_s) } else { "endless".to_owned() };
            let source = instruments(h.instruments);
            writeln!(out, "supervision  {} move, {} held; window {window}; instruments {source}", h.active, h.held)?;
            if let Some(accepted) = s.accepted() {
                writeln!(out, "model        accepted: {accepted}")?;
            }
            if h.hausman_p_value.is_finite() {
                writeln!(out, "bias         {}", bias(&h))?;
                if let Some(ratio) = bias_ratio(&h, s.joints.len()) {
                    writeln!(out, "bias-ratio   {ratio}")?;
                }
            }
        }
    }
    match s.controller.map(|report| report.message) {
        None => writeln!(out, "controller   not on the bus")?,
        Some(c) => {
            let state = s.state().unwrap_or_default();
            let ago = s.age(c.stamp_ns);
            writeln!(
                out,
                "controller   {state}; parameters {}; {} commands, reported {ago} ago",
                source(&c),
                c.commands
            )?;
            writeln!(out, "c-faults     {}", controller_faults(&c))?;
            if let Some(stops) = s.stops(&c) {
                writeln!(out, "c-stops      {stops}")?;
            }
            if let Some(refused) = s.refused_plan(&c) {
                writeln!(out, "c-plan       {refused}")?;
            }
            writeln!(out, "c-state      {}", state_folder(c.state_folder))?;
            if c.polls != 0 {
                writeln!(out, "c-wake-up    {POLLS}")?;
            }
            let refused: Vec<_> = refusals(&c).into_iter().map(|(why, count)| format!("{count} {why}")).collect();
            let refused = if refused.is_empty() { "none".to_owned() } else { refused.join(", ") };
            writeln!(out, "gate         {} sets accepted, refused: {refused}", c.accepted)?;
        }
    }
    write_joints(out, s)?;
    let Some(set) = &s.parameters else { return writeln!(out, "parameters   none yet") };
    let model = if s.same_model() { "" } else { "; of another model than this robot file's" };
    writeln!(out, "parameters   {}, epoch {}, sample {}{}{model}", set.len(), set.epoch, set.seq, flags(set))?;
    writeln!(
        out,
        "{:<34} {:>12} {:>12} {:>12} {:>12} {:>10}",
        "", "value", "sigma", "robot file", "excitation", "state"
    )?;
    for i in 0..set.len() {
        let nominal = if s.same_model() { s.nominal.get(i).map_or(f64::NAN, |x| *x) } else { f64::NAN };
        let state = parameter_state(set.state[i]);
        let [value, std, nominal, excitation] = [set.values[i], set.std[i], nominal, set.excitation[i]].map(figure);
        let name = s.name(i);
        writeln!(out, "  {name:<32} {value:>12} {std:>12} {nominal:>12} {excitation:>12} {state:>10}")?;
    }
    Ok(())
}

/// Least squares against the instruments.
fn bias(h: &Health) -> String {
    let p = match h.hausman_p_value {
        p if p < 1e-3 => "p < 0.001".to_owned(),
        p => format!("p = {p:.3}"),
    };
    format!("least squares and instruments differ by chance with {p}")
}

/// Noise in the regressors of least squares over what the instruments keep of it, where that is known.
fn bias_ratio(h: &Health, joints: usize) -> Option<String> {
    let ratio = &h.instrument_ratio[..joints.min(h.instrument_ratio.len())];
    let each: Vec<String> = ratio.iter().map(|r| figure(*r)).collect();
    (!ratio.iter().all(|r| r.is_nan())).then(|| format!("noise, LS over IV, by joint: {}", each.join(" ")))
}

fn write_joints(out: &mut String, s: &Snapshot) -> std::fmt::Result {
    writeln!(
        out,
        "{:<26} {:>10} {:>10} {:>10} {:>10} {:>10}",
        "joints       rms [N m]", "torque", "residual", "nominal's", "in use's", "tracking"
    )?;
    for (j, name) in s.joints.iter().enumerate() {
        // A message has room for so many joints, and an arm may have more.
        let at = |values: &[f64]| values.get(j).copied().unwrap_or(f64::NAN);
        let daemon = s.health.map_or([f64::NAN; 3], |report| {
            let h = &report.message;
            [at(&h.torque_rms), at(&h.residual_rms), at(&h.nominal_residual_rms)]
        });
        let controller = s
            .controller
            .map_or([f64::NAN; 2], |report| [at(&report.message.prediction_rms), at(&report.message.tracking_rms)]);
        write!(out, "  {name:<24}")?;
        for x in daemon.into_iter().chain(controller) {
            write!(out, " {:>10}", figure(x))?;
        }
        writeln!(out)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_test_of_bias_reads_as_a_sentence() {
        let mut h = Health { hausman_p_value: 4e-9, ..Health::default() };
        assert_eq!(bias(&h), "least squares and instruments differ by chance with p < 0.001");
        h.instrument_ratio.fill(f64::NAN);
        assert_eq!(bias_ratio(&h, 2), None);
        h.hausman_p_value = 0.25;
        h.instrument_ratio[..2].copy_from_slice(&[3.0, 120.0]);
        assert!(bias(&h).ends_with("p = 0.250"), "{}", bias(&h));
        assert_eq!(bias_ratio(&h, 2).as_deref(), Some("noise, LS over IV, by joint: 3.0000 120.0"));
    }

    #[test]
    fn a_torque_against_the_model_is_not_called_a_flipped_sign_alone() {
        let mut h = Health::default();
        h.input_faults[rivet_ipc_schema::InputFault::SignFlipped as usize] = 350;
        let met = crate::snapshot::faults_met(&h);
        assert_eq!(met, [("torque opposite to the model's: sign flipped or model wrong".to_owned(), 350)]);
    }
}
