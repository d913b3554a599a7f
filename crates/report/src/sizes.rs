//! How large a cause is, in a line.

use std::fmt::Write as _;

use crate::document::{Cause, Document, Parameter};
use crate::words::{figure, quantity_of};

impl Document {
    /// The main sizes of a cause with their units, as many as fit into `columns`; none where it has no size. A value of the model stands beside
    /// the file's; bodies, which have ten each, go by how clear a change is.
    pub fn sizes(&self, cause: &Cause, columns: usize) -> Option<String> {
        let mut known: Vec<(&str, f64, Option<&Parameter>)> = cause
            .magnitude
            .iter()
            .filter_map(|(name, value)| Some((name.as_str(), (*value)?, self.parameter(name))))
            .filter(|(_, value, parameter)| parameter.is_none_or(|p| p.given != Some(*value)))
            .collect();
        // What weighs most with a reader comes first: masses before where they are and how they turn.
        known.sort_by_key(|(name, ..)| !(*name == "mass_kg" || name.ends_with(".m")));
        if known.iter().all(|(.., parameter)| parameter.is_some_and(Parameter::is_of_a_body)) {
            let clear = |(.., parameter): &(&str, f64, Option<&Parameter>)| parameter.map_or(0.0, Parameter::clearness);
            known.sort_by(|a, b| clear(b).total_cmp(&clear(a)));
        }
        let mut text = String::new();
        for (k, (name, value, parameter)) in known.iter().enumerate() {
            let (name, unit) = quantity_of(name, &cause.joints, self);
            let one = format!("{name} {} {unit}", figure(*value, 3));
            let given = parameter.and_then(|p| p.given).map(|given| format!(" (file {})", figure(given, 3)));
            let one = format!("{}{}", one.trim_end(), given.unwrap_or_default());
            let comma = if k > 0 { ", " } else { "" };
            let left = known.len() - k - 1;
            let rest = if left > 0 { format!(" and {left} more") } else { String::new() };
            if k > 0 && (text.chars().count() + 2 + one.chars().count() + rest.chars().count()) > columns {
                let _ = write!(text, " and {} more", left + 1);
                break;
            }
            text += comma;
            text += &one;
        }
        (!known.is_empty()).then_some(text)
    }

    fn parameter(&self, name: &str) -> Option<&Parameter> {
        self.figures.iter().flat_map(|figures| &figures.parameters).find(|parameter| parameter.name == name)
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use crate::verdict::tests::{cause, document};

    #[test]
    fn the_main_size_comes_first_and_the_line_is_short() {
        let load = json!({"com_x_m": -0.0389, "com_y_m": -0.0161, "com_z_m": 0.0649, "mass_kg": 4.7033});
        let found = document(&[("causes", json!([cause("payload", &load)]))]);
        let whole = found.sizes(&found.causes[0], 90).expect("sizes");
        assert_eq!(whole, "mass 4.70 kg, com x -0.0389 m, com y -0.0161 m, com z 0.0649 m");
        assert_eq!(found.sizes(&found.causes[0], 40).as_deref(), Some("mass 4.70 kg, com x -0.0389 m and 2 more"));
    }

    #[test]
    fn values_stand_beside_the_files_and_of_bodies_the_clearest_change_comes_first() {
        let value = |name: &str, given: f64, found: f64, width: f64| {
            json!({"name": name, "unit": "kg", "joint": 2, "given": given, "found": found, "low": found - width / 2.0,
                "high": found + width / 2.0, "state": "pinned", "wrong": true})
        };
        let parameters = json!([
            value("l2.m", 5.0, 5.0, 0.0),
            value("l2.mcx", 1.0, 1.5, 0.5),
            value("l2.mcy", 1.0, 3.0, 0.5),
            value("j1.coulomb", 2.0, 3.0, 0.1),
            value("j2.coulomb", 2.0, 8.0, 0.1)
        ]);
        let figures =
            json!({"floor": [], "stages": [], "parameters": parameters, "excerpts": [], "left": [], "power": []});
        let of = |sizes: Value| {
            let found = document(&[("figures", figures.clone()), ("causes", json!([cause("link_inertia", &sizes)]))]);
            found.sizes(&found.causes[0], 90).expect("sizes")
        };
        let bodies = of(json!({"l2.m": 5.0, "l2.mcx": 1.5, "l2.mcy": 3.0}));
        assert_eq!(bodies, "l2.mcy 3.00 kg (file 1.00), l2.mcx 1.50 kg (file 1.00)");
        let friction = of(json!({"j1.coulomb": 3.0, "j2.coulomb": 8.0}));
        assert_eq!(friction, "j1.coulomb 3.00 kg (file 2.00), j2.coulomb 8.00 kg (file 2.00)");
    }

    #[test]
    fn a_spring_of_a_joint_that_slides_is_in_newtons_and_metres() {
        let value = |unit: &str| {
            json!({"name": "j1.coulomb", "unit": unit, "joint": 1, "given": 1.0, "found": 1.0, "low": 1.0, "high": 1.0,
                "state": "pinned", "wrong": false})
        };
        let said = |unit: &str| {
            let mut spring = cause("joint_spring", &json!({"rest_angle_rad": 0.1, "stiffness_Nm_rad": 150.0}));
            spring["joints"] = json!(["j"]);
            let figures = json!({"floor": [], "stages": [], "parameters": [value(unit)], "excerpts": [], "left": [], "power": []});
            let found = document(&[("figures", figures), ("causes", json!([spring]))]);
            found.sizes(&found.causes[0], 90).expect("sizes")
        };
        assert_eq!(said("N m"), "rest angle 0.100 rad, stiffness 150 N m/rad");
        assert_eq!(said("N"), "rest position 0.100 m, stiffness 150 N/m");
    }
}
