//! What to do about a diagnosis, cause by cause, and what it brings.

use rivet_diagnosis::{Effect, Kind};

use crate::document::{Cause, Document, JointGap, Parameter, is_contact};
use crate::scores::{Bin, Score};
use crate::words::{effect, figure, joints_in_short, printed_unit, quantity_of, rival};

/// Values of the model in one line; the table of parameters has all.
const VALUES: usize = 3;
/// Sizes that are factors on values of the file, and the words for them.
const FACTORS: [(&str, &str); 2] = [("mass_gain", "mass and inertia"), ("inertia_gain", "inertia")];
/// Residual in motion over the noise from which another joint is named beside the worst one.
const KEEPS: f64 = 2.0;
/// A simulator further from the arm than this has lost it \[rad\]: no joint follows its plan any more.
const LOST: f64 = 1.0;
/// Confidence in words, on blind cases, needs so many names of that confidence.
const FEWEST_NAMES: usize = 20;

impl Document {
    /// One line a cause: what to do, with number, unit, interval and confidence. `scores` are those of cases whose answers are known.
    pub fn actions(&self, scores: &[Score]) -> Vec<String> {
        self.causes.iter().map(|cause| self.action(cause, scores)).collect()
    }

    fn action(&self, cause: &Cause, scores: &[Score]) -> String {
        let sizes = self.action_sizes(cause);
        let sizes = if sizes.is_empty() { String::new() } else { format!(": {}", sizes.join(", ")) };
        let rivals: Vec<String> = cause.indistinguishable_from.iter().map(|name| rival(name)).collect();
        let or = if rivals.is_empty() {
            String::new()
        } else {
            format!(" These logs do not separate it from {}.", rivals.join(" or "))
        };
        format!("{}{sizes}.{}{or}", self.deed(cause), confidence(cause, scores))
    }

    /// Verb, effect and joints.
    fn deed(&self, cause: &Cause) -> String {
        let (what, on) = (effect(&cause.effect), joints_in_short(&cause.joints, self.gap.per_joint.len()));
        let of = if cause.joints.is_empty() { String::new() } else { format!(" of {on}") };
        match cause.effect.as_str() {
            _ if is_contact(cause) => format!("Keep away what touched {on}"),
            "payload" => "Add a payload at the flange".to_owned(),
            "encoder_offset" => format!("Correct joint_zero{of}"),
            name if Effect::ALL.iter().any(|e| e.name() == name && e.kind() == Kind::Value) => {
                format!("Set {what}{of}")
            }
            _ if cause.joints.is_empty() => format!("Add {what}"),
            _ => format!("Add {what} to {on}"),
        }
    }

    /// Sizes with units: values of the model from the file's to the one found, with interval; the clearest changes first.
    fn action_sizes(&self, cause: &Cause) -> Vec<String> {
        let figures = self.figures.iter().flat_map(|figures| &figures.parameters);
        let mut values: Vec<&Parameter> = figures
            .filter(|p| cause.magnitude.contains_key(&p.name) && p.found.is_some() && p.found != p.given)
            .collect();
        values.sort_by(|a, b| b.clearness().total_cmp(&a.clearness()));
        if values.is_empty() {
            let known = cause.magnitude.iter().filter_map(|(name, value)| Some((name, (*value)?)));
            // Masses before where they are.
            let (masses, others): (Vec<_>, Vec<_>) = known.partition(|(name, _)| name.as_str() == "mass_kg");
            let one = |(name, value): (&String, f64)| {
                let value = figure(value, 3);
                if let Some(what) = FACTORS.iter().find_map(|(factor, what)| (factor == name).then_some(what)) {
                    return format!("{what} {value} times the file's");
                }
                let (name, unit) = quantity_of(name, &cause.joints, self);
                format!("{name} {value} {unit}").trim_end().to_owned()
            };
            return masses.into_iter().chain(others).map(one).collect();
        }
        let more = values.len().saturating_sub(VALUES);
        let one = |p: &&Parameter| {
            let given = p.given.map_or_else(String::new, |given| format!("{} \u{2192} ", figure(given, 3)));
            let ends = p.low.zip(p.high).filter(|(low, high)| low < high);
            let ends = ends.map_or_else(String::new, |(low, high)| interval(low, high));
            format!("{} {given}{}{ends} {}", p.name, figure(p.found.unwrap_or(f64::NAN), 3), printed_unit(&p.unit))
                .trim_end()
                .to_owned()
        };
        let listed = values.iter().take(VALUES).map(one);
        listed.chain((more > 0).then(|| format!("{more} more in the table of parameters"))).collect()
    }

    /// What the causes bring: residual in motion over the noise, of the joint that was furthest off, and the simulator's error; none
    /// where nothing is known of the motion.
    #[must_use]
    pub fn result_line(&self) -> Option<String> {
        let both = |j: &JointGap| Some((j.joint.clone(), (*j.in_motion.first()?)?, (*j.in_motion.get(1)?)?));
        let joints: Vec<(String, f64, f64)> = self.gap.per_joint.iter().filter_map(both).collect();
        let (joint, before, after) = joints.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let kept =
            joints.iter().max_by(|a, b| a.2.total_cmp(&b.2)).filter(|(name, _, most)| name != joint && *most > KEEPS);
        let kept = kept.map_or_else(String::new, |(name, _, most)| format!("; {name} keeps {}", figure(*most, 2)));
        let motion = format!(
            "Residual in motion over the noise, {joint}: {} \u{2192} {}{kept}.",
            figure(*before, 2),
            figure(*after, 2)
        );
        let end = self.rollout.as_ref().and_then(|rollout| rollout.points.last());
        let simulator = end.map_or_else(String::new, |end| {
            format!(
                " Simulator in closed loop after {} s: {} \u{2192} {} mrad.",
                end.horizon_s,
                distance(end.position_before_rad),
                distance(end.position_after_rad)
            )
        });
        Some(motion + &simulator)
    }

    /// Residual in motion over the noise of the worst joint: nominal model, all causes.
    pub(crate) fn in_motion(&self) -> Option<(f64, f64)> {
        let most = |at: usize| self.gap.per_joint.iter().filter_map(|j| *j.in_motion.get(at)?).reduce(f64::max);
        most(0).zip(most(1))
    }
}

/// Distance of a simulator from the arm \[mrad\]: beyond [`LOST`] the figure means nothing.
fn distance(rad: f64) -> String {
    if rad > LOST { format!("more than {:.0}", 1e3 * LOST) } else { figure(1e3 * rad, 3) }
}

/// The 90 % interval behind a figure.
fn interval(low: f64, high: f64) -> String {
    format!(" [{}, {}]", figure(low, 3), figure(high, 3))
}

/// Confidence, and how often names of such confidence were right on blind cases, where there are enough of them.
fn confidence(cause: &Cause, scores: &[Score]) -> String {
    let Some(sure) = cause.confidence else { return String::new() };
    let alike = |bin: &&Bin| bin.from <= sure && sure < bin.to;
    let bins = scores.iter().flat_map(|score| score.confidence.iter().filter(alike));
    let (right, all) = bins.fold((0, 0), |(right, all), bin| (right + bin.right, all + bin.count));
    let known = if all < FEWEST_NAMES {
        String::new()
    } else {
        format!(" (names of such confidence were right in {right} of {all} blind cases)")
    };
    format!(" Confidence {sure:.2}{known}.")
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::verdict::tests::{cause, document};

    fn of(effect: &str, joints: &[&str], magnitude: &Value) -> Value {
        let mut cause = cause(effect, magnitude);
        cause["joints"] = json!(joints);
        cause
    }

    fn actions(causes: &[Value], more: &[(&str, Value)], scores: &[Score]) -> Vec<String> {
        let mut fields = more.to_vec();
        fields.push(("causes", json!(causes)));
        document(&fields).actions(scores)
    }

    #[test]
    fn an_effect_is_added_with_its_sizes_and_how_often_such_names_were_right() {
        let friction = of("stribeck_friction", &["elbow"], &json!({"strength_Nm": 1.47, "velocity_rad_s": 0.081}));
        let bin = |count: usize, right: usize| Bin { from: 0.9, to: 0.97, count, right, mean: 0.93 };
        let scores = |count, right| vec![Score { confidence: vec![bin(count, right)], ..Score::default() }; 2];
        let said = |count, right| actions(std::slice::from_ref(&friction), &[], &scores(count, right)).concat();
        let known = said(30, 29);
        assert!(
            known.starts_with("Add stribeck friction to elbow: strength 1.47 N m, velocity 0.0810 rad/s."),
            "{known}"
        );
        assert!(
            known.contains("Confidence 0.90 (names of such confidence were right in 58 of 60 blind cases)."),
            "{known}"
        );
        assert!(said(4, 4).ends_with("Confidence 0.90."), "eight names are no frequency: {}", said(4, 4));
    }

    #[test]
    fn a_value_goes_from_the_files_to_the_one_found() {
        let parameter = json!({"name": "j4.rotor_inertia", "unit": "kg m²", "joint": 4, "given": 0.5, "found": 0.65, "low": 0.63,
            "high": 0.67, "state": "pinned", "wrong": true});
        let figures =
            json!({"floor": [], "stages": [], "parameters": [parameter], "excerpts": [], "left": [], "power": []});
        let rotor = of("rotor_inertia", &["wrist"], &json!({"j4.rotor_inertia": 0.65}));
        let said = actions(&[rotor], &[("figures", figures)], &[]).concat();
        assert!(
            said.starts_with("Set rotor inertia of wrist: j4.rotor_inertia 0.500 → 0.650 [0.630, 0.670] kg m²."),
            "{said}"
        );
    }

    #[test]
    fn a_factor_is_said_to_be_one() {
        let rotor = of("rotor_inertia", &["wrist"], &json!({"inertia_gain": 1.63}));
        let said = actions(&[rotor], &[], &[]).concat();
        assert!(said.starts_with("Set rotor inertia of wrist: inertia 1.63 times the file's."), "{said}");
    }

    #[test]
    fn a_contact_is_kept_away_and_a_class_is_said() {
        let touch = of("external_force", &[], &json!({"largest_N": 39.5}));
        assert!(actions(&[touch], &[], &[]).concat().starts_with("Keep away what touched the whole arm"));
        let mut asymmetry = of("friction_asymmetry", &["j"], &json!({"difference_Nm": 1.0}));
        asymmetry["indistinguishable_from"] = json!(["torque_ripple"]);
        let said = actions(&[asymmetry], &[], &[]).concat();
        assert!(said.ends_with("These logs do not separate it from torque ripple."), "{said}");
    }

    #[test]
    fn what_the_causes_bring_is_in_motion_and_in_closed_loop() {
        let joint = |name: &str, before: f64, after: f64| json!({"joint": name, "before": 0.3, "after": 0.1, "noise_floor": 0.05, "in_motion": [before, after]});
        let gap = json!({"before": 0.3, "after": 0.1, "noise_floor": 0.05, "per_joint": [joint("a", 14.0, 1.1), joint("b", 3.0, 2.4)]});
        let rollout = json!({"closer": true, "starts": 12, "not_simulated": [], "points": [{"horizon_s": 1.0,
            "position_before_rad": 0.141, "position_after_rad": 0.00037, "torque_before": 0.1, "torque_after": 0.01}]});
        let found = document(&[("gap", gap), ("rollout", rollout)]);
        let line = found.result_line().expect("a line");
        assert_eq!(
            line,
            "Residual in motion over the noise, a: 14 → 1.1; b keeps 2.4. Simulator in closed loop after 1 s: 141 → 0.370 mrad."
        );
    }
}
