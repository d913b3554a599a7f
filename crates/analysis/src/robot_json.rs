//! A robot file with everything that follows from it, as JSON.

use rivet_config::{Origin, Robot, Value as Setting};
use serde_json::{Value, json};

/// What `rivet check` shows: values with their units and origins, joints, base parameters, notes and warnings.
///
/// Joint ranges are in rad (m) and speeds in rad/s (m/s); null where the URDF has none. A base parameter has the unit beside it.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let robot = rivet_config::load(concat!(env!("CARGO_MANIFEST_DIR"), "/../../robots/ur10e/robot.toml"))?;
/// let value = rivet_analysis::robot_json::to_json(&robot);
/// assert_eq!(value["robot"], "ur10e");
/// assert_eq!(value["joints"][1]["joint"], "shoulder_lift_joint");
/// # Ok(())
/// # }
/// ```
pub fn to_json(robot: &Robot) -> Value {
    let config = &robot.config;
    let joints = robot.model.arm.joints.iter().enumerate().map(|(j, joint)| {
        json!({
            "joint": joint.name, "kind": format!("{:?}", joint.kind).to_lowercase(),
            "lower": joint.lower, "upper": joint.upper, "speed": joint.velocity,
            "gear_ratio": config.drive.gear_ratio[j], "rotor_inertia": config.drive.rotor_inertia[j],
            "torque_limit": config.drive.torque_limit[j],
        })
    });
    let values = config.resolved.iter().map(|resolved| {
        json!({
            "section": resolved.key.section, "key": resolved.key.name, "unit": resolved.key.unit,
            "value": setting(&resolved.value), "origin": origin(resolved.origin),
        })
    });
    let parameters = (0..robot.base.len()).map(|i| {
        json!({
            "name": robot.base.name(&robot.model, i),
            "unit": robot.base.parameter(&robot.model, i).unit(&robot.model.arm),
            "nominal": robot.nominal_base[i],
            "identified": robot.identified.as_ref().map(|identified| identified.values[i]),
            "std": robot.identified.as_ref().map(|identified| identified.std[i]),
        })
    });
    let gap = &robot.base.gap;
    json!({
        "robot": config.name,
        "file": config.path.display().to_string(),
        "urdf": config.urdf.display().to_string(),
        "model_hash": format!("{:016x}", robot.hash),
        "standard_parameters": robot.model.len(),
        "rank_gap": { "ratio": gap.ratio(), "smallest_kept": gap.smallest_kept, "largest_dropped": gap.largest_dropped },
        "joints": joints.collect::<Vec<_>>(),
        "values": values.collect::<Vec<_>>(),
        "base_parameters": parameters.collect::<Vec<_>>(),
        "notes": robot.notes(),
        "warnings": robot.warnings(),
    })
}

fn setting(value: &Setting) -> Value {
    match value {
        Setting::Absent => Value::Null,
        Setting::Number(x) => json!(x),
        Setting::Integer(x) => json!(x),
        Setting::Bool(x) => json!(x),
        Setting::Text(x) => json!(x),
        Setting::Numbers(x) => json!(x),
        Setting::JointPositions(x) => x.iter().map(|(joint, position)| (joint.clone(), json!(position))).collect(),
    }
}

/// A line of the robot file, or what else a value is from.
fn origin(origin: Origin) -> Value {
    match origin {
        Origin::Line(line) => json!(line),
        Origin::Default => json!("default"),
        Origin::Chosen => json!("chosen"),
        Origin::Urdf => json!("urdf"),
    }
}
