//! `[effects.<name>]`: effects of known size, one value a joint.

use rivet_dynamics::{EffectKind, KnownEffect};

use crate::keys::{self, Key, SECTIONS};
use crate::reader::{Origin, Reader, Resolved, Value};

/// The section of an effect.
fn section(kind: EffectKind) -> &'static str {
    let is = |s: &&str| s.strip_prefix("effects.") == Some(kind.name());
    SECTIONS.iter().map(|(s, _)| *s).find(is).expect("every effect has a section: a test reads them all")
}

/// Inner values that must be above 0 where the effect acts.
const ABOVE_ZERO: [&str; 5] = ["velocity", "length", "order", "stiffness", "arm"];

/// What friction that changes with warmth is relative to ...
const REFERENCE: &str = "reference";
/// ... is a temperature, or the friction power where joints warm up by their work: least, most, unit.
const TEMPERATURE_C: (f64, f64, &str) = (-1e3, 1e3, "degC");
const POWER_W: (f64, f64, &str) = (0.0, 1e6, "W");

/// All effects that the file has, of a robot with `joints` joints.
pub(crate) fn read(reader: &mut Reader<'_>, joints: usize) -> Vec<KnownEffect> {
    let mut effects = Vec::new();
    for kind in EffectKind::ALL {
        let section = section(*kind);
        if !reader.has_section(section) {
            continue;
        }
        let values: Vec<Vec<f64>> = kind
            .keys()
            .iter()
            .map(|key| if kind.is_global() { vec![reader.number(section, key)] } else { reader.numbers(section, key) })
            .collect();
        for joint in 0..if kind.is_global() { 1 } else { joints } {
            let own: Vec<f64> = values.iter().filter_map(|v| v.get(joint).copied()).collect();
            let effect = KnownEffect::new(*kind, joint, &own);
            if own.len() < values.len() || !effect.acts() {
                continue;
            }
            for (key, value) in kind.keys().iter().zip(&own).skip(kind.sizes()) {
                if ABOVE_ZERO.contains(key) && *value <= 0.0 && reader.good(&[(section, key)]) {
                    let rule = "must be above 0 where the effect has a size".to_owned();
                    let hint = format!("`{}` of this joint is {}", kind.keys()[0], own[0]);
                    reader.reject_entry(section, key, joint, rule, hint);
                }
            }
            if *kind == EffectKind::TemperatureDependentFriction && reader.good(&[(section, REFERENCE)]) {
                let [_, _, reference, time_s] = effect.values;
                let (low, high, unit) = if time_s > 0.0 { POWER_W } else { TEMPERATURE_C };
                if !(low..=high).contains(&reference) {
                    let rule = format!("must keep {low} <= x <= {high:e} {unit}");
                    let hint = format!("`time_constant` of this joint is {time_s}");
                    reader.reject_entry(section, REFERENCE, joint, rule, hint);
                }
            }
            if *kind == EffectKind::JointCoupling && joint == 0 {
                let rule = "must be 0 for the first joint: there is none before it".to_owned();
                reader.reject_entry(section, kind.keys()[0], 0, rule, "give it at the later of the two joints".into());
            }
            effects.push(effect);
        }
    }
    effects
}

/// The effects as values of a file, in its order.
pub(crate) fn resolved(effects: &[KnownEffect], joints: usize) -> Vec<Resolved> {
    let mut out = Vec::new();
    for kind in EffectKind::ALL {
        let own: Vec<&KnownEffect> = effects.iter().filter(|e| e.kind == *kind && e.acts()).collect();
        if own.is_empty() {
            continue;
        }
        for (k, name) in kind.keys().iter().enumerate() {
            let key: &'static Key = keys::find(section(*kind), name).expect("declared: a test reads them all");
            let value = if kind.is_global() {
                Value::Number(own[0].values[k])
            } else {
                let at = |joint: usize| own.iter().find(|e| e.joint == joint).map_or(0.0, |e| e.values[k]);
                Value::Numbers((0..joints).map(at).collect())
            };
            out.push(Resolved { key, value, origin: Origin::Chosen });
        }
    }
    out
}
