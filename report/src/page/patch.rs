//! What each target format can hold of what was found.

use std::fmt::Write as _;

use super::html::{Table, escape};
use crate::document::Document;
use crate::words::{effect, figure};

/// What a simulator's file can hold of an effect: URDF, MJCF. A URDF knows rigid bodies, one viscous and one Coulomb
/// level a joint; MJCF knows drive inertia and the lag of an actuator besides.
const FORMATS: [(&str, &str, &str); 28] = [
    ("link_inertia", "exact", "exact"),
    ("payload", "exact", "exact"),
    ("gravity_direction", "cannot: turn the base", "exact"),
    ("rotor_inertia", "cannot", "exact: armature"),
    ("coulomb_friction", "exact: dynamics friction", "exact: frictionloss"),
    ("viscous_friction", "exact: dynamics damping", "exact: damping"),
    ("friction_asymmetry", "cannot", "cannot"),
    ("stribeck_friction", "cannot", "cannot"),
    ("viscous_nonlinearity", "cannot", "cannot"),
    ("load_dependent_friction", "cannot", "cannot"),
    ("temperature_dependent_friction", "cannot: level at one temperature", "cannot: level at one temperature"),
    ("presliding_friction", "cannot", "cannot"),
    ("position_dependent_friction", "cannot: mean level only", "cannot: mean level only"),
    ("torque_constant", "cannot", "exact: gear of the actuator"),
    ("torque_ripple", "cannot", "cannot"),
    ("transmission_error", "cannot", "cannot"),
    ("backlash", "cannot", "two joints and a limit"),
    ("joint_elasticity", "cannot", "two joints and a stiffness"),
    ("base_flexibility", "cannot", "a joint at the base with a stiffness"),
    ("joint_spring", "cannot", "exact: stiffness, springref"),
    ("counterbalance", "cannot", "a tendon with a stiffness"),
    ("joint_coupling", "cannot", "an equality or a tendon"),
    ("transport_delay", "cannot", "delay of the actuator"),
    ("current_loop_lag", "cannot", "exact: filter of the actuator"),
    ("torque_saturation", "effort limit, which few readers obey", "exact: forcerange"),
    ("encoder_offset", "exact: joint origin", "exact: ref"),
    ("encoder_eccentricity", "cannot", "cannot"),
    ("external_force", "no part of an arm", "no part of an arm"),
];

pub(super) fn patch(document: &Document) -> String {
    if document.export.is_empty() { expected(document) } else { measured(document) }
}

/// What the formats do with the causes, without costs.
fn expected(document: &Document) -> String {
    if document.causes.is_empty() {
        return String::new();
    }
    let mut table = Table::new("What a file format can hold of the causes", &["Cause", "URDF", "MJCF", "model.toml"]);
    for cause in &document.causes {
        let held = FORMATS.iter().find(|f| f.0 == cause.effect);
        let (urdf, mjcf) = held.map_or(("cannot", "cannot"), |f| (f.1, f.2));
        table.row(&[effect(&cause.effect), urdf.to_owned(), mjcf.to_owned(), "the side-car keeps it".to_owned()]);
    }
    table.html()
}

/// What each file written holds, and what it costs where it does not.
fn measured(document: &Document) -> String {
    let mut out = String::from(
        "<p>What the files of <code>rivet diagnose --export</code> hold of the model that was found, and the torque that a \
         reader misses where they do not.</p>\n",
    );
    let joints = &document.gap.per_joint;
    for format in &document.export {
        let mut head = vec!["What", "Fidelity", "Where it stands, or why not"];
        head.extend(joints.iter().map(|j| j.joint.as_str()));
        let mut table = Table::new(&format!("{}: torque of each thing, rms [N m]", format.file), &head);
        let numbers = |values: &[f64]| -> String {
            values.iter().fold(String::new(), |mut row, v| {
                // Writing to a String cannot fail, here and below.
                let _ = write!(row, "<td>{}</td>", figure(*v, 2));
                row
            })
        };
        for item in &format.items {
            table.raw(format!(
                "<th scope=\"row\">{}</th><td class=\"state\">{}</td><td class=\"text\">{}</td>{}",
                escape(&item.what),
                escape(&item.fidelity),
                escape(&item.place),
                numbers(&item.torque_rms_nm)
            ));
        }
        table.raw(format!("<th scope=\"row\">missed by a reader</th><td></td><td></td>{}", numbers(&format.missed_nm)));
        let exact = format.items.iter().filter(|i| i.fidelity == "exact").count();
        let _ = writeln!(
            out,
            "<details><summary>{}: {exact} of {} things exact</summary>{}</details>",
            escape(&format.file),
            format.items.len(),
            table.html()
        );
    }
    out
}
