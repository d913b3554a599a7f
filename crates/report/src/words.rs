//! Figures and names as a person reads them.

use crate::document::{Document, Number, Parameter, is_contact, is_value};

pub use crate::terms::effect;

/// A share in percent, one digit after the point; a dash for what is not known.
pub fn percent(share: Number) -> String {
    share.map_or_else(|| "-".to_owned(), |x| format!("{:.1}", 100.0 * x))
}

/// `digits` significant digits, plain where that is short.
pub fn figure(x: f64, digits: i32) -> String {
    if x == 0.0 || !x.is_finite() {
        return if x == 0.0 { "0".to_owned() } else { "-".to_owned() };
    }
    let magnitude = x.abs().log10().floor() as i32;
    if (-3..5).contains(&magnitude) {
        let decimals = (digits - 1 - magnitude).max(0) as usize;
        format!("{x:.decimals$}")
    } else {
        format!("{x:.*e}", (digits - 1).max(0) as usize)
    }
}

/// The name of a member of a class, which says whether the model has it with a wrong value.
pub fn rival(name: &str) -> String {
    if is_value(name) { format!("a wrong value of {}", effect(name)) } else { effect(name) }
}

/// The verdict of a document in words: touch is nothing that a model lacks.
pub fn verdict_of(document: &Document) -> String {
    let mut missing = document.causes.iter().filter(|cause| !cause.is_value()).peekable();
    if document.verdict == "effect" && missing.peek().is_some() && missing.all(is_contact) {
        return "contact".to_owned();
    }
    verdict(&document.verdict)
}

/// A verdict, as it stands in JSON, in words.
pub fn verdict(name: &str) -> String {
    match name {
        "effect" => "missing effect".to_owned(),
        "several" => "several missing effects".to_owned(),
        "parameter" => "wrong values".to_owned(),
        other => other.replace('_', " "),
    }
}

/// Suffixes of magnitudes' names and the units that they stand for, longest first.
const UNITS: [(&str, &str); 20] = [
    ("_Nms3_rad3", "N m s\u{b3}/rad\u{b3}"),
    ("_Nms2_rad2", "N m s\u{b2}/rad\u{b2}"),
    ("_Nms_rad_K", "N m s/(rad K)"),
    ("_rad_Nm", "rad/(N m)"),
    ("_percent", "%"),
    ("_Nms_rad", "N m s/rad"),
    ("_Nm_rad", "N m/rad"),
    ("_Nm_K", "N m/K"),
    ("_kgm2", "kg m\u{b2}"),
    ("_rad_s", "rad/s"),
    ("_m_s2", "m/s\u{b2}"),
    ("_Nm", "N m"),
    ("_rad", "rad"),
    ("_kg", "kg"),
    ("_hz", "Hz"),
    ("_per_turn", "per turn"),
    ("_K", "K"),
    ("_N", "N"),
    ("_m", "m"),
    ("_s", "s"),
];

/// Name and unit of one of a cause's magnitudes: of joints that slide, torque is a force and an angle a length.
pub fn quantity_of(name: &str, joints: &[String], document: &Document) -> (String, String) {
    let (label, unit) = quantity(name, document);
    let parameters = || document.figures.iter().flat_map(|figures| &figures.parameters);
    if parameters().any(|p| p.name == name) {
        return (label, unit);
    }
    let slides = |joint: &String| {
        let at = document.gap.per_joint.iter().position(|gap| gap.joint == *joint);
        at.is_some_and(|at| parameters().any(|p| p.unit == "N" && p.name == format!("j{}.coulomb", at + 1)))
    };
    if joints.is_empty() || !joints.iter().all(slides) {
        return (label, unit);
    }
    (label.replace("angle", "position"), unit.replace("N m", "N").replace("rad", "m"))
}

/// Name and unit of a magnitude: `stiffness_Nm_rad` is "stiffness" in N m/rad; values of the model have their own.
pub fn quantity(name: &str, document: &Document) -> (String, String) {
    let parameters = document.figures.iter().flat_map(|f| &f.parameters);
    if let Some(parameter) = parameters.into_iter().find(|p| p.name == name) {
        return (value_label(parameter, document), printed_unit(&parameter.unit));
    }
    if let Some(way @ ("forwards" | "backwards")) = name.strip_suffix("_Nm") {
        return (format!("{way} more than the other way by"), "N m".to_owned());
    }
    for (suffix, unit) in UNITS {
        if let Some(stem) = name.strip_suffix(suffix) {
            return (crate::terms::effect(stem), unit.to_owned());
        }
    }
    if name == "ratio" {
        return ("friction over carried torque".to_owned(), String::new());
    }
    if name == "seconds" {
        return ("time".to_owned(), "s".to_owned());
    }
    (name.replace('_', " "), String::new())
}

/// A value of the model in words: the joint's name for a drive, "link 3 first moment x" for a body; its own name where the document does
/// not name the joint.
pub(crate) fn parameter_label(parameter: &Parameter, document: &Document) -> String {
    let own = parameter.name.as_str();
    let Some((place, entry)) = own.split_once('.') else { return own.to_owned() };
    let number = place.get(1..).and_then(|number| number.parse::<usize>().ok());
    let joint = number.and_then(|k| document.gap.per_joint.get(k.checked_sub(1)?));
    match (place.chars().next(), number, joint) {
        (Some('j'), Some(_), Some(joint)) => joint.joint.clone(),
        (Some('l'), Some(link), Some(_)) => {
            let what = match (entry, entry.strip_prefix("mc"), entry.strip_prefix('I')) {
                ("m", ..) => "mass".to_owned(),
                (_, Some(axis), _) => format!("first moment {axis}"),
                (_, _, Some(axes)) => format!("inertia {axes}"),
                _ => entry.to_owned(),
            };
            format!("link {link} {what}")
        }
        _ => own.to_owned(),
    }
}

/// A value of the model and what it is of: "wrist_1_joint Coulomb", "wrist_1_joint rotor inertia", "link 3 first moment x"; its own name
/// where the document does not name the joint.
pub fn value_label(parameter: &Parameter, document: &Document) -> String {
    let (own, label) = (parameter.name.as_str(), parameter_label(parameter, document));
    match own.split_once('.') {
        Some((_, entry)) if own.starts_with('j') && label != own => format!("{label} {}", effect(entry)),
        _ => label,
    }
}

/// A unit as it is printed: `kg m^2` is "kg m²".
pub(crate) fn printed_unit(unit: &str) -> String {
    unit.replace("^2", "\u{b2}").replace("^3", "\u{b3}")
}

/// "a", "a and b", "a, b and c".
pub fn list(words: &[String]) -> String {
    match words {
        [] => String::new(),
        [one] => one.clone(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

/// Joints of a cause in a heading.
pub fn joints(names: &[String], all: usize) -> String {
    match names.len() {
        0 => "the whole arm".to_owned(),
        1 => list(names),
        n if n == all => "all joints".to_owned(),
        _ => list(names),
    }
}

/// Joints of a cause in a sentence: counted where they are many.
pub fn joints_in_short(names: &[String], all: usize) -> String {
    if names.len() > 2 && names.len() < all { format!("{} of {all} joints", names.len()) } else { joints(names, all) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_class_tells_values_from_effects() {
        assert_eq!(rival("coulomb_friction"), "a wrong value of Coulomb friction");
        assert_eq!(rival("joint_elasticity"), "joint elasticity");
        // Of a later version, perhaps.
        assert_eq!(rival("some_name"), "some name");
    }

    #[test]
    fn friction_of_one_direction_is_told_beside_the_others() {
        let document = serde_json::from_str(crate::document::CONTRACT).expect("a document");
        let [label, unit] = <[String; 2]>::from(quantity("backwards_Nm", &document));
        assert_eq!((label.as_str(), unit.as_str()), ("backwards more than the other way by", "N m"));
        assert_eq!(quantity("coulomb_Nm", &document).0, "Coulomb");
    }

    #[test]
    fn a_value_of_the_model_is_told_with_its_joint() {
        let mut document: Document = serde_json::from_str(crate::document::CONTRACT).expect("a document");
        let joint =
            serde_json::json!({"joint": "wrist", "before": 0.1, "after": 0.1, "noise_floor": 0.1, "in_motion": []});
        document.gap.per_joint = vec![serde_json::from_value(joint).expect("a joint")];
        let label = |name: &str| {
            let parameter = serde_json::json!({"name": name, "unit": "N m", "joint": 1, "given": 0.0, "found": 1.0, "low": 0.0, "high": 2.0,
                "state": "pinned", "wrong": true});
            value_label(&serde_json::from_value(parameter).expect("a parameter"), &document)
        };
        let labels = ["j1.coulomb", "j1.rotor_inertia", "l1.mcx", "j9.coulomb"].map(label);
        assert_eq!(labels, ["wrist Coulomb", "wrist rotor inertia", "link 1 first moment x", "j9.coulomb"]);
    }

    /// Every size in the tables of the manual's pages has the unit of its name.
    #[test]
    fn units_are_those_of_the_manual() {
        let document = serde_json::from_str(crate::document::CONTRACT).expect("a document");
        let pages = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/effects");
        let mut compared = 0;
        for page in std::fs::read_dir(pages).expect("pages of effects") {
            let text = std::fs::read_to_string(page.expect("a page").path()).expect("text");
            let table = text.lines().skip_while(|line| !line.starts_with("| in JSON")).skip(2);
            for line in table.take_while(|line| line.starts_with('|')) {
                let cells: Vec<&str> = line.split('|').map(str::trim).collect();
                let names = cells[1].split('`').skip(1).step_by(2).filter(|name| !name.contains('.'));
                let names: Vec<&str> = names.collect();
                let units: Vec<&str> = cells[3].split(", ").collect();
                for (k, name) in names.iter().enumerate() {
                    let unit = match *units.get(k).unwrap_or(&units[0]) {
                        "1" => "",
                        "1/turn" => "per turn",
                        unit => unit,
                    };
                    assert_eq!(quantity(name, &document).1, unit, "{name}");
                    compared += 1;
                }
            }
        }
        assert!(compared > 50, "{compared}");
    }

    #[test]
    fn figures_are_short_and_keep_their_digits() {
        for (x, text) in [(0.0, "0"), (9.1545, "9.15"), (-0.012345, "-0.0123"), (2345.6, "2346"), (3.2e-6, "3.20e-6")] {
            assert_eq!(figure(x, 3), text);
        }
        assert_eq!(percent(None), "-");
        assert_eq!(percent(Some(0.1234)), "12.3");
    }

    #[test]
    fn lists_read_as_spoken() {
        let words = ["a", "b", "c"].map(str::to_owned);
        assert_eq!([list(&words[..1]), list(&words[..2]), list(&words)], ["a", "a and b", "a, b and c"]);
    }
}
