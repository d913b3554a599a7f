//! Reads the sections, and tells what is wrong with them.

use std::path::PathBuf;

use rivet_dynamics::UrdfOptions;
use rivet_estimation::{Differentiator, EstimatorKind, Filtering, InputSignals, Instruments};

use super::{
    Bus, Controller, Coupling, Drive, Estimator, Friction, Law, Log, LogChannel, Overrun, Publish, Realtime, Scheduler,
    Signal, Simulation, StopReaction, TorqueMeaning, Trigger,
};
use crate::keys::{HIGHEST_FILTER_SHARE, HIGHEST_STATE_FILTER_SHARE};
use crate::number_text::short;
use crate::reader::Reader;

/// Most delayed rows that the estimator keeps.
const MAX_DELAY_ROWS: usize = 4096;

/// `value` of a choice; the reader has refused every other word.
fn chosen<T: Copy>(word: &str, choices: &[(&str, T)]) -> T {
    choices.iter().find(|(w, _)| *w == word).map_or(choices[0].1, |(_, t)| *t)
}

pub(crate) fn name(reader: &mut Reader<'_>) -> String {
    let name = reader.text("", "name");
    let fits = (1..=64).contains(&name.len())
        && name.bytes().all(|b| matches!(b, b'a'..=b'z' | b'0'..=b'9' | b'-' | b'_'))
        && name.starts_with(|c: char| c.is_ascii_alphanumeric());
    if !fits && reader.has("", "name") && reader.good(&[("", "name")]) {
        let rule = "must be 1 to 64 characters of a-z, 0-9, -, _, the first a letter or a digit";
        let lower: String =
            name.to_lowercase().chars().map(|c| if c.is_ascii_alphanumeric() || c == '_' { c } else { '-' }).collect();
        let lower = lower.trim_matches(['-', '_']).to_owned();
        let hint = if lower.is_empty() { "for example \"ur10e\"".into() } else { format!("for example \"{lower}\"") };
        reader.reject("", "name", rule, hint);
    }
    name
}

pub(crate) fn gravity(reader: &mut Reader<'_>) -> [f64; 3] {
    reader.numbers("", "gravity").try_into().unwrap_or([f64::NAN; 3])
}

/// How the URDF becomes a chain.
pub(crate) fn model(reader: &mut Reader<'_>) -> UrdfOptions {
    let tip = reader.text("model", "tip");
    let fixed = reader.joint_positions("model", "fixed");
    let project = reader.text("model", "impossible_inertia") == "project";
    UrdfOptions { tip: (!tip.is_empty()).then_some(tip), fixed, project }
}

pub(crate) fn drive(reader: &mut Reader<'_>) -> Drive {
    Drive {
        gear_ratio: reader.numbers("drive", "gear_ratio"),
        rotor_inertia: reader.numbers("drive", "rotor_inertia"),
        torque_limit: reader.numbers("drive", "torque_limit"),
        velocity_limit: reader.optional_numbers("drive", "velocity_limit"),
        encoder_resolution: reader.numbers("drive", "encoder_resolution"),
        drive_gain: reader.optional_numbers("drive", "drive_gain"),
    }
}

pub(crate) fn friction(reader: &mut Reader<'_>) -> Friction {
    Friction {
        coulomb: reader.numbers("friction", "coulomb"),
        viscous: reader.numbers("friction", "viscous"),
        offset: reader.numbers("friction", "offset"),
        load_dependent: reader.optional_numbers("friction", "load_dependent"),
        viscous_quadratic: reader.optional_numbers("friction", "viscous_quadratic"),
        presliding_travel: reader.number("friction", "presliding_travel"),
        load_urdf: None,
    }
}

pub(crate) fn coupling(reader: &mut Reader<'_>) -> Option<Coupling> {
    if !reader.has_section("coupling") {
        return None;
    }
    let (driving, driven) = (reader.joint("coupling", "driving"), reader.joint("coupling", "driven"));
    if driving.is_some() && driving == driven {
        reader.reject(
            "coupling",
            "driven",
            "must be another joint than `driving`",
            "on the TX40 driving is 5, driven is 6",
        );
    }
    let (rotor_inertia, viscous) = (reader.number("coupling", "rotor_inertia"), reader.number("coupling", "viscous"));
    let coulomb = reader.number("coupling", "coulomb");
    Some(Coupling { driving: driving?, driven: driven?, rotor_inertia, viscous, coulomb })
}

/// `drive_gain`: that of `[drive]`.
pub(crate) fn log(reader: &mut Reader<'_>, drive_gain: Option<&[f64]>) -> Log {
    let joint_zero = reader.numbers("log", "joint_zero");
    let torque_from_current = reader.text("log", "torque_from") == "current";
    if torque_from_current && drive_gain.is_none() && reader.good(&[("drive", "drive_gain")]) {
        let rule = "\"current\" needs [drive] drive_gain".to_owned();
        reader.reject("log", "torque_from", rule, "give drive_gain in N m/A, one number a joint".to_owned());
    }
    let torque_is = match reader.text("log", "torque_is").as_str() {
        "torque" => TorqueMeaning::Torque,
        "gravity_free" => TorqueMeaning::GravityFree,
        _ => TorqueMeaning::Auto,
    };
    Log { joint_zero, torque_from_current, torque_is, channels: channels(reader) }
}

/// A quantity of a recording with its keys: pattern, unit, sign, scale, zero.
type ChannelKeys = (&'static str, [Option<&'static str>; 4]);

const CHANNELS: [ChannelKeys; 6] = [
    ("time", [Some("time_unit"), None, None, None]),
    ("q", [Some("q_unit"), Some("q_sign"), Some("q_scale"), None]),
    ("tau", [Some("tau_unit"), Some("tau_sign"), Some("tau_scale"), Some("tau_zero")]),
    ("current", [Some("current_unit"), Some("current_sign"), Some("current_scale"), Some("current_zero")]),
    ("q_des", [None; 4]),
    ("temperature", [Some("temperature_unit"), None, None, None]),
];

/// The quantities of which something is stated.
fn channels(reader: &mut Reader<'_>) -> Vec<LogChannel> {
    let mut channels = Vec::new();
    for (key, [unit, sign, scale, zero]) in CHANNELS {
        let mut text = |name: Option<&'static str>| Some(reader.text("log", name?)).filter(|text| !text.is_empty());
        let (pattern, unit) = (text(Some(key)), text(unit));
        let mut numbers = |name: Option<&'static str>| reader.optional_numbers("log", name?);
        let (sign_values, scale, zero) = (numbers(sign), numbers(scale), numbers(zero));
        if let (Some(name), Some(place)) =
            (sign, sign_values.as_ref().and_then(|s| s.iter().position(|s| s.abs() != 1.0)))
        {
            let (rule, hint) =
                ("must be 1 or -1".to_owned(), "give a factor by the key that ends on _scale".to_owned());
            reader.reject_entry("log", name, place, rule, hint);
        }
        if pattern.is_some() || unit.is_some() || sign_values.is_some() || scale.is_some() || zero.is_some() {
            channels.push(LogChannel { key, pattern, unit, sign: sign_values, scale, zero });
        }
    }
    channels
}

pub(crate) fn signal(reader: &mut Reader<'_>, sample_period_s: f64) -> Signal {
    // Defaults are for a geared arm at 1 kHz and scale with the sample period, so that any contract-only file works.
    let period = if sample_period_s.is_finite() { sample_period_s } else { 1e-3 };
    reader.derive("signal", "half_width", (0.01 / period).round().max(2.0));
    reader.derive("signal", "model_filter_hz", (0.2 / period).min(20.0));
    let word = reader.text("signal", "differentiator");
    let half_width = reader.count("signal", "half_width");
    reader.derive("signal", "state_filter_hz", (HIGHEST_STATE_FILTER_SHARE / period).min(60.0));
    let state_filter_hz = reader.number("signal", "state_filter_hz");
    let differentiator = chosen(
        &word,
        &[
            ("savitzky-golay", Differentiator::SavitzkyGolay { half_width }),
            ("central", Differentiator::Central),
            ("state-filter", Differentiator::StateFilter { hz: state_filter_hz }),
        ],
    );
    let highest = HIGHEST_STATE_FILTER_SHARE / sample_period_s;
    if reader.good(&[("signal", "state_filter_hz"), ("", "sample_period_s")])
        && state_filter_hz > highest * (1.0 + 1e-9)
    {
        let rule = format!("must be at most 0.2 of the sample rate, here {} Hz", short(highest));
        reader.reject("signal", "state_filter_hz", rule, "without the key it is 60 Hz, at most 0.2 of the sample rate");
    }
    let word = reader.text("signal", "filtering");
    let signals = chosen(
        &reader.text("signal", "input_signals"),
        &[("all", InputSignals::All), ("motion", InputSignals::Motion), ("acceleration", InputSignals::Acceleration)],
    );
    let filtering =
        chosen(&word, &[("model", Filtering::Model), ("input", Filtering::Input(signals)), ("none", Filtering::None)]);
    let model_filter_hz = reader.number("signal", "model_filter_hz");
    let model_filter_order = reader.count("signal", "model_filter_order");
    let cut_off = if model_filter_hz.is_finite() { model_filter_hz } else { 20.0 };
    reader.derive("signal", "decimation", (1.0 / (5.0 * period * cut_off)).clamp(1.0, 1000.0).round());
    let decimation = reader.count("signal", "decimation");
    if model_filter_order % 2 == 1 && reader.good(&[("signal", "model_filter_order")]) {
        let hint = format!("use {} or {}", (model_filter_order - 1).max(2), model_filter_order + 1);
        reader.reject("signal", "model_filter_order", "must be even", hint);
    }
    let highest = HIGHEST_FILTER_SHARE / (sample_period_s * decimation as f64);
    if reader.good(&[("signal", "model_filter_hz"), ("signal", "decimation"), ("", "sample_period_s")])
        && model_filter_hz > highest
    {
        let rate = 1.0 / (sample_period_s * decimation as f64);
        let rule =
            format!("model_filter_hz must be at most 0.45 of the rate after decimation, here {} Hz", short(highest));
        let fits = (HIGHEST_FILTER_SHARE / (sample_period_s * model_filter_hz)).floor();
        if fits >= 1.0 && reader.has("signal", "decimation") {
            let hint =
                format!("the rate is {} Hz; set decimation to {fits} or less for {model_filter_hz} Hz", short(rate));
            reader.reject("signal", "decimation", rule, hint);
        } else {
            reader.reject(
                "signal",
                "model_filter_hz",
                rule,
                format!("the rate is {} Hz; lower the cut-off", short(rate)),
            );
        }
    }
    Signal {
        differentiator,
        filtering,
        model_filter_hz,
        model_filter_order,
        decimation,
        friction_velocity: reader.number("signal", "friction_velocity"),
        dead_zone: reader.numbers("signal", "dead_zone"),
        torque_noise: reader.optional_numbers("signal", "torque_noise"),
    }
}

pub(crate) fn estimator(
    reader: &mut Reader<'_>,
    sample_period_s: f64,
    decimation: usize,
    friction: &Friction,
) -> Estimator {
    let kind = chosen(
        &reader.text("estimator", "kind"),
        &[
            ("riv", EstimatorKind::Riv),
            ("rls", EstimatorKind::Rls),
            ("energy", EstimatorKind::Energy),
            ("rls-energy", EstimatorKind::RlsEnergy),
        ],
    );
    let energy_span_s = reader.number("estimator", "energy_span_s");
    let longest = MAX_DELAY_ROWS as f64 * sample_period_s * decimation as f64;
    let keys = [("estimator", "energy_span_s"), ("", "sample_period_s"), ("signal", "decimation")];
    if kind.energy() && reader.good(&keys) && energy_span_s > longest {
        let rule = format!("must be at most {MAX_DELAY_ROWS} samples after decimation, here {} s", short(longest));
        reader.reject("estimator", "energy_span_s", rule, "shorten the span or raise signal.decimation");
    }
    let has_offset = friction.offset.iter().any(|x| *x != 0.0);
    reader.derive("estimator", "offsets", f64::from(u8::from(has_offset)));
    let offsets = reader.switch("estimator", "offsets");
    if !offsets && has_offset && reader.good(&[("estimator", "offsets")]) {
        let rule = "must be true while friction.offset is not all 0: the model would leave that torque out";
        reader.reject("estimator", "offsets", rule, "set it to true, or friction.offset to 0");
    }
    let window = reader.text("estimator", "window");
    let forgets = window != "none";
    let window_deviation = reader.number("estimator", "window_deviation");
    let window_deviation = (window == "constant-trace").then_some(window_deviation);
    let window_s = reader.number("estimator", "window_s");
    let keys = [("estimator", "window_s"), ("", "sample_period_s"), ("signal", "decimation")];
    let shortest = 20.0 * sample_period_s * decimation as f64;
    if forgets && reader.good(&keys) && window_s < shortest {
        let rule = format!("must hold at least 20 samples after decimation, here {} s", short(shortest));
        reader.reject("estimator", "window_s", rule, "lengthen the window or lower signal.decimation");
    }
    let word = reader.text("estimator", "instruments");
    reader.derive("estimator", "delay_s", (2.0 * sample_period_s).max(0.02));
    let delay_s = reader.number("estimator", "delay_s");
    if reader.good(&[("estimator", "delay_s"), ("", "sample_period_s")]) && delay_s < sample_period_s {
        let rule = format!("must be at least one sample period, here {sample_period_s} s");
        reader.reject("estimator", "delay_s", rule, "longer than the noise is correlated, shorter than the motion");
    }
    if reader.good(&[("estimator", "delay_s"), ("", "sample_period_s"), ("signal", "decimation")]) && delay_s > longest
    {
        let rule = format!("must be at most {MAX_DELAY_ROWS} samples after decimation, here {} s", short(longest));
        reader.reject("estimator", "delay_s", rule, "shorten the delay or raise signal.decimation");
    }
    let longest_cycle_s = reader.number("estimator", "longest_cycle_s");
    let instruments = chosen(
        &word,
        &[
            ("auto", Instruments::Auto { delay_s, longest_cycle_s }),
            ("setpoint-through-loop", Instruments::SetpointThroughLoop),
            ("setpoint", Instruments::Setpoint),
            ("second-encoder", Instruments::SecondEncoder),
            ("previous-cycle", Instruments::PreviousCycle { delay_s, longest_cycle_s }),
            ("delayed", Instruments::Delayed { delay_s }),
        ],
    );
    let prior = reader.number("estimator", "prior");
    let window_s = forgets.then_some(window_s);
    Estimator { kind, energy_span_s, offsets, window_s, window_deviation, instruments, prior }
}

pub(crate) fn publish(reader: &mut Reader<'_>, sample_period_s: f64) -> Publish {
    // Whoever looks on judges by time, not by samples, whether a process is still there.
    reader.derive("publish", "health_every", (1.0 / sample_period_s).round());
    Publish {
        every: reader.count("publish", "every"),
        consistent_hz: reader.number("publish", "consistent_hz"),
        health_every: reader.count("publish", "health_every"),
    }
}

pub(crate) fn realtime(reader: &mut Reader<'_>) -> Realtime {
    let trigger =
        chosen(&reader.text("realtime", "trigger"), &[("timer", Trigger::Timer), ("sample", Trigger::Sample)]);
    let priority = reader.optional_integer("realtime", "priority").and_then(|p| u8::try_from(p).ok());
    let cpu = reader.optional_integer("realtime", "cpu").and_then(|c| usize::try_from(c).ok());
    let overrun =
        chosen(&reader.text("realtime", "overrun"), &[("skip", Overrun::Skip), ("catch-up", Overrun::CatchUp)]);
    let scheduler =
        chosen(&reader.text("realtime", "scheduler"), &[("fifo", Scheduler::Fifo), ("deadline", Scheduler::Deadline)]);
    if scheduler == Scheduler::Deadline && cpu.is_some() {
        reader.reject(
            "realtime",
            "cpu",
            "it must not be given with scheduler = \"deadline\"",
            "the kernel places such threads itself; leave the key out, or give a cpuset to the unit (AllowedCPUs=)",
        );
    }
    Realtime {
        trigger,
        overrun,
        scheduler,
        deadline_share: reader.number("realtime", "deadline_share"),
        priority: priority.filter(|p| *p > 0),
        cpu,
        lock_memory: reader.switch("realtime", "lock_memory"),
        required: reader.switch("realtime", "required"),
        catch_up: reader.count("realtime", "catch_up"),
        stale_periods: reader.count("realtime", "stale_periods"),
    }
}

pub(crate) fn controller(reader: &mut Reader<'_>, sample_period_s: f64, publish_every: usize) -> Controller {
    let law = chosen(
        &reader.text("controller", "law"),
        &[("computed-torque", Law::ComputedTorque), ("feed-forward-pd", Law::FeedForwardPd)],
    );
    reader.derive("controller", "bandwidth_hz", (0.02 / sample_period_s).min(5.0));
    reader.derive("controller", "velocity_filter_hz", (0.2 / sample_period_s).min(100.0));
    let bandwidth_hz = reader.numbers("controller", "bandwidth_hz");
    let velocity_filter_hz = reader.number("controller", "velocity_filter_hz");
    if reader.good(&[("", "sample_period_s")]) {
        // A sampled loop whose bandwidth nears a tenth of its rate has no phase left for differentiation and delay.
        let highest = 0.1 / sample_period_s;
        let rule = format!("must be at most a tenth of the sample rate, here {} Hz", short(highest));
        if let Some(i) = bandwidth_hz.iter().position(|b| *b > highest) {
            reader.reject_entry("controller", "bandwidth_hz", i, rule, "lower the bandwidth".into());
        }
        let highest = HIGHEST_FILTER_SHARE / sample_period_s;
        if reader.good(&[("controller", "velocity_filter_hz")]) && velocity_filter_hz > highest {
            let rule = format!("must be at most 0.45 of the sample rate, here {} Hz", short(highest));
            reader.reject("controller", "velocity_filter_hz", rule, "lower the cut-off");
        }
    }
    let damping = reader.number("controller", "damping");
    let integral_hz = reader.number("controller", "integral_hz");
    let slowest = bandwidth_hz.iter().copied().fold(f64::INFINITY, f64::min);
    // s³ + 2ζω·s² + ω²·s + ω²·ωi is stable for ωi < 2ζω (Routh); half of that keeps some damping.
    let keys = [("controller", "integral_hz"), ("controller", "bandwidth_hz"), ("controller", "damping")];
    if reader.good(&keys) && integral_hz > damping * slowest {
        let rule = format!("must be at most damping times the lowest bandwidth, here {} Hz", short(damping * slowest));
        reader.reject(
            "controller",
            "integral_hz",
            rule,
            "the closed loop would swing; a tenth of the bandwidth is usual",
        );
    }
    let rate_limit = reader.optional_numbers("controller", "rate_limit");
    reader.derive("controller", "stale_periods", (0.02 / sample_period_s + 1e-9).floor().clamp(2.0, 10.0));
    let stale_periods = reader.count("controller", "stale_periods");
    let stop_reaction = chosen(
        &reader.text("controller", "stop_reaction"),
        &[("damp", StopReaction::Damp), ("hold", StopReaction::Hold), ("ramp", StopReaction::Ramp)],
    );
    let stop_time_s = reader.number("controller", "stop_time_s");
    reader.derive("controller", "resume_after", (0.2 / sample_period_s).ceil().clamp(1.0, 1e6));
    let resume_after = reader.count("controller", "resume_after");
    let tracking_error = reader.numbers("controller", "tracking_error");
    let saturation_ms = reader.number("controller", "saturation_ms");
    let unmodelled_torque = reader.numbers("controller", "unmodelled_torque");
    let torque_change = reader.number("controller", "torque_change");
    let between = sample_period_s * publish_every as f64;
    reader.derive("controller", "parameter_timeout_s", (5.0 * between).max(1.0));
    let parameter_timeout_s = reader.number("controller", "parameter_timeout_s");
    let keys = [("controller", "parameter_timeout_s"), ("publish", "every"), ("", "sample_period_s")];
    if reader.good(&keys) && parameter_timeout_s < 2.0 * between {
        let rule = format!("must be at least two publications, here {} s", short(2.0 * between));
        reader.reject("controller", "parameter_timeout_s", rule, "lengthen it or lower publish.every");
    }
    let return_after = reader.count("controller", "return_after");
    Controller {
        law,
        bandwidth_hz,
        damping,
        integral_hz,
        velocity_filter_hz,
        rate_limit,
        stale_periods,
        stop_reaction,
        stop_time_s,
        resume_after,
        tracking_error,
        saturation_ms,
        unmodelled_torque,
        torque_change,
        parameter_timeout_s,
        return_after,
    }
}

pub(crate) fn simulation(reader: &mut Reader<'_>) -> Simulation {
    Simulation {
        torque_noise: reader.numbers("simulation", "torque_noise"),
        position_noise: reader.numbers("simulation", "position_noise"),
        seed: reader.optional_integer("simulation", "seed").map_or(0, i64::unsigned_abs),
    }
}

pub(crate) fn bus(reader: &mut Reader<'_>) -> Bus {
    let prefix = reader.text("bus", "prefix");
    let fits = (3..=32).contains(&prefix.len())
        && prefix.bytes().all(|b| b.is_ascii_alphanumeric() || matches!(b, b'-' | b'_'));
    if !fits && reader.good(&[("bus", "prefix")]) {
        reader.reject("bus", "prefix", "must be 3 to 32 characters of a-z, A-Z, 0-9, -, _", "for example \"rivet_\"");
    }
    let root = PathBuf::from(reader.text("bus", "root"));
    // Longer paths do not leave room for the bus's own file names within the system's limits.
    let fits = root.is_absolute() && root.parent().is_some() && root.as_os_str().len() <= 120;
    if !fits && reader.good(&[("bus", "root")]) {
        let rule = "must be an absolute path below /, of at most 120 bytes";
        let hint = "all processes must agree, wherever they were started: for example \"/run/rivet/<robot>\"";
        reader.reject("bus", "root", rule, hint);
    }
    Bus { prefix, root }
}
