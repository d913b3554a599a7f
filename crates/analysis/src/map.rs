//! Which channels of a recording are which, where the caller states it.

use anyhow::Result;
use rivet_config::{LogChannel, Origin, Robot, Value, keys};
use rivet_logs::ChannelMap;

use crate::fault::Fault;

/// Keys of a quantity behind its name.
const ENDS: [&str; 4] = ["_unit", "_sign", "_scale", "_zero"];
/// Keys of [log] that state no channel.
const OTHERS: [&str; 3] = ["joint_zero", "torque_from", "torque_is"];
/// Largest factor.
const MAX_SCALE: f64 = 1e9;

/// The robot with the channels of `entries` in the place of its file's.
///
/// * `entries`: `KEY=VALUE`, keys as those of `[log]` in the robot file
///
/// # Errors
/// An unknown key, or a value that breaks its rule.
pub fn apply(mut robot: Robot, entries: &[String]) -> Result<Robot> {
    for entry in entries {
        let joints = robot.dof();
        let (name, value) = set(&mut robot.config.log.channels, entry, joints)
            .map_err(|why| Fault::Usage(format!("--map {entry}: {why}")))?;
        // A model that is exported reads the same recordings.
        for resolved in robot.config.resolved.iter_mut().filter(|r| r.key.section == "log" && r.key.name == name) {
            (resolved.value, resolved.origin) = (value.clone(), Origin::Chosen);
        }
    }
    Ok(robot)
}

/// The channels that a robot file and the command line state.
pub(crate) fn channels(robot: &Robot) -> Result<ChannelMap> {
    let mut map = ChannelMap::default();
    for of in &robot.config.log.channels {
        let entry = map.entry(of.key).map_err(Fault::Config)?;
        entry.pattern.clone_from(&of.pattern);
        entry.unit.clone_from(&of.unit);
        entry.sign.clone_from(&of.sign);
        entry.scale.clone_from(&of.scale);
        entry.zero.clone_from(&of.zero);
    }
    Ok(map)
}

/// Sets one entry; returns its key in the robot file and the value.
fn set(channels: &mut Vec<LogChannel>, entry: &str, joints: usize) -> Result<(&'static str, Value), String> {
    let (name, value) = entry.split_once('=').ok_or("it must be KEY=VALUE")?;
    let (name, value) = (name.trim(), value.trim());
    let end = ENDS.into_iter().find(|end| name.ends_with(end));
    let quantity = end.map_or(name, |end| name.trim_end_matches(end));
    let declared = || keys::KEYS.iter().filter(|key| key.section == "log" && !OTHERS.contains(&key.name));
    let quantity = ChannelMap::KEYS.into_iter().find(|key| *key == quantity);
    let (Some(key), Some(quantity)) = (declared().find(|key| key.name == name), quantity) else {
        let names: Vec<&str> = declared().map(|key| key.name).collect();
        return Err(format!("{name} is no key; the keys are {}", names.join(", ")));
    };
    let place = channels.iter().position(|channel| channel.key == quantity).unwrap_or_else(|| {
        channels.push(LogChannel { key: quantity, pattern: None, unit: None, sign: None, scale: None, zero: None });
        channels.len() - 1
    });
    let channel = &mut channels[place];
    let list = |what: &str, fits: &dyn Fn(f64) -> bool| numbers(value, joints, fits).ok_or_else(|| rule(what, joints));
    let numbers = match end {
        None => {
            channel.pattern = Some(value.to_owned());
            return Ok((key.name, Value::Text(value.to_owned())));
        }
        Some("_unit") => {
            channel.unit = Some(value.to_owned());
            return Ok((key.name, Value::Text(value.to_owned())));
        }
        Some("_sign") => channel.sign.insert(list("1 or -1", &|x| x.abs() == 1.0)?),
        Some("_scale") => channel.scale.insert(list("a factor other than 0", &|x| x != 0.0 && x.abs() <= MAX_SCALE)?),
        _ => channel.zero.insert(list("a number", &|x: f64| x.is_finite())?),
    };
    Ok((key.name, Value::Numbers(numbers.clone())))
}

fn rule(what: &str, joints: usize) -> String {
    format!("the value must be {what}, once or {joints} times, separated by commas")
}

/// One number for all joints, or one a joint.
fn numbers(value: &str, joints: usize, fits: &dyn Fn(f64) -> bool) -> Option<Vec<f64>> {
    let numbers: Vec<f64> = value.split(',').map(|x| x.trim().parse().ok()).collect::<Option<_>>()?;
    let numbers = if let [one] = numbers[..] { vec![one; joints] } else { numbers };
    (numbers.len() == joints && numbers.iter().all(|x| x.is_finite() && fits(*x))).then_some(numbers)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_of_the_command_line_are_checked_and_replace_the_files() {
        let mut channels = Vec::new();
        for entry in ["q=/js/{joint}/position", "q_unit=deg", "tau_sign=-1", "q_scale=1,2", "tau_zero=0.5,-0.5"] {
            set(&mut channels, entry, 2).expect("sound");
        }
        assert_eq!((channels[0].key, channels[0].unit.as_deref()), ("q", Some("deg")));
        assert_eq!((&channels[0].scale, &channels[1].sign), (&Some(vec![1.0, 2.0]), &Some(vec![-1.0, -1.0])));
        for (entry, words) in [
            ("q", "KEY=VALUE"),
            ("effort=x", "effort is no key; the keys are time, time_unit, q, q_unit"),
            ("tau_sign=1,0.5", "must be 1 or -1, once or 2 times"),
            ("q_scale=1,2,3", "a factor other than 0"),
        ] {
            let why = set(&mut channels, entry, 2).expect_err("refused");
            assert!(why.contains(words), "{entry}: {why}");
        }
    }
}
