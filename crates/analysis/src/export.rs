//! `--export DIR`: model.toml, robot.urdf and what the URDF cannot carry.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result};
use rivet_config::{Robot, write_consistent, write_identified};
use rivet_dynamics::{LinkParameters, Parameter, ParameterGroup, Places, WrittenUrdf, write_urdf};
use rivet_estimation::consistency::{ConsistencyError, Projection, Reference};
use rivet_estimation::offline::Fit;

use rivet_files::Printable;

use crate::table::number;
use crate::{mesh_paths, runs};

/// Writes `model.toml`, `robot.urdf` and `not-expressible.md` into `folder`; the model refers to the URDF beside it.
///
/// The URDF gets the physically consistent bodies and friction. The model keeps the values of `fit`: unconstrained base parameters, or
/// with `exports_consistent` those of the consistent set.
/// Without a consistent set the URDF keeps its nominal values, and `not-expressible.md` says so.
pub(crate) fn export(
    robot: &Robot,
    fit: &Fit,
    consistent: &Result<Projection, ConsistencyError>,
    exports_consistent: bool,
    reference: &Reference,
    folder: &Path,
) -> Result<()> {
    let named = |path: &Path| path.display().to_string();
    std::fs::create_dir_all(folder).with_context(|| named(folder))?;
    let (urdf, model, notes) =
        (folder.join("robot.urdf"), folder.join("model.toml"), folder.join("not-expressible.md"));
    let text = description(robot, folder)?;
    let mut moved = robot.clone();
    moved.config.urdf.clone_from(&urdf);
    place_load(&mut moved, robot, folder)?;
    match consistent {
        Ok(found) => {
            // What the model does not have, offsets mostly, stays as the file gives it.
            let drives = robot.model.drives(&found.standard, robot.config.nominal_joints());
            let links: Vec<LinkParameters> = bodies(robot.dof(), &found.standard);
            let written = write_urdf(&text, &robot.config.urdf_options, &links, &drives.viscous, &drives.coulomb)
                .with_context(|| named(&robot.config.urdf))?;
            rivet_files::write_whole(&urdf, &written.text).with_context(|| named(&urdf))?;
            let report = not_expressible(robot, found, &written, exports_consistent, reference);
            rivet_files::write_whole(&notes, Printable(&report).to_string()).with_context(|| named(&notes))?;
            write_consistent(&moved, &drives, [&fit.values, &fit.std], exports_consistent, &model)
                .with_context(|| named(&model))
        }
        Err(why) => {
            rivet_files::write_whole(&urdf, &text).with_context(|| named(&urdf))?;
            let report = format!(
                "# {}: what robot.urdf does not carry\n\nAll identified values: no physically consistent set was found \
                 ({why}), so robot.urdf has its nominal bodies. The identified base parameters are in model.toml.\n",
                robot.config.name
            );
            rivet_files::write_whole(&notes, Printable(&report).to_string()).with_context(|| named(&notes))?;
            write_identified(&moved, &fit.values, &fit.std, &model).with_context(|| named(&model))
        }
    }
}

/// The robot description as it is written into `folder`: paths of meshes lead to where they led.
pub(crate) fn description(robot: &Robot, folder: &Path) -> Result<String> {
    let urdf = &robot.config.urdf;
    let text = std::fs::read_to_string(urdf).with_context(|| urdf.display().to_string())?;
    Ok(mesh_paths::moved(&text, urdf.parent().unwrap_or(Path::new("")), folder))
}

/// The bodies that made the carried torque of load friction, as they were, beside the exported URDF, which gets others.
pub(crate) fn place_load(moved: &mut Robot, robot: &Robot, folder: &Path) -> Result<()> {
    if !robot.model.structure.load_friction {
        return Ok(());
    }
    let named = |path: &Path| path.display().to_string();
    let from = robot.config.friction.load_urdf.as_ref().unwrap_or(&robot.config.urdf);
    let load = folder.join("load.urdf");
    let bodies = std::fs::read_to_string(from).with_context(|| named(from))?;
    rivet_files::write_whole(&load, &bodies).with_context(|| named(&load))?;
    moved.config.friction.load_urdf = Some(load);
    Ok(())
}

/// The bodies of a standard vector of `joints` joints.
pub(crate) fn bodies(joints: usize, standard: &[f64]) -> Vec<LinkParameters> {
    let entry = |link: usize| std::array::from_fn(|k| standard[Places::link(link).start + k]);
    (0..joints).map(entry).collect()
}

/// What robot.urdf cannot say and what it costs: torque that a reader of the URDF misses on the identified log.
fn not_expressible(
    robot: &Robot,
    found: &Projection,
    written: &WrittenUrdf,
    exports_consistent: bool,
    reference: &Reference,
) -> String {
    let (model, base) = (&robot.model, &robot.base);
    let cost = |lost: &dyn Fn(&Parameter) -> bool| {
        let values = model.parameters.iter().zip(&found.standard);
        let part: Vec<f64> = values.map(|(p, x)| if lost(p) { *x } else { 0.0 }).collect();
        reference.rms(&base.from_standard(&part))
    };
    let mut out = format!(
        "# {}: what robot.urdf does not carry\n\n\
         robot.urdf has the physically consistent set: masses, centres of mass and inertias of bodies that can be\n\
         built, nearest to what was identified, and viscous and Coulomb friction as `<dynamics damping friction>`.\n\
         model.toml has {which}\n\
         in `[identified]` (rivet uses these) and the drive values of the physically consistent set in `[drive]`,\n\
         `[friction]` and `[coupling]`.\n\n\
         Cost: torque that is missed, root mean square over the identified log after the model filter [N m; N for a\n\
         prismatic joint].\n\n| not in the URDF | where it is |",
        robot.config.name,
        which = if exports_consistent {
            "the base parameters of this set, which predicts left-out rows better than the unconstrained one,"
        } else {
            "the identified base parameters without that constraint"
        },
    );
    // Writing to a String cannot fail, here and below.
    for name in runs::joint_names(robot) {
        let _ = write!(out, " {name} |");
    }
    let _ = write!(out, "\n|---|---|{}\n", "---:|".repeat(robot.dof()));
    let mut row = |what: &str, place: &str, rms: &[f64]| {
        let cells: Vec<String> = rms.iter().map(|r| number(*r, 3)).collect();
        let _ = writeln!(out, "| {what} | {place} | {} |", cells.join(" | "));
    };
    use ParameterGroup::{Coupling, Friction, Offset, RotorInertia};
    row("rotor inertia behind the gear", "model.toml [drive]", &cost(&|p| p.group() == RotorInertia));
    if model.structure.offset {
        row("torque offset", "model.toml [friction]", &cost(&|p| p.group() == Offset));
    }
    let of_load = |p: &Parameter| matches!(p, Parameter::LoadFriction(_));
    let quadratic = |p: &Parameter| matches!(p, Parameter::ViscousQuadratic(_));
    if model.structure.load_friction {
        row("friction with load", "model.toml [friction]", &cost(&of_load));
    }
    if model.parameters.iter().any(quadratic) {
        row("friction with the square of speed", "model.toml [friction]", &cost(&quadratic));
    }
    if model.structure.coupling.is_some() {
        row("coupled wrist motor: inertia and friction", "model.toml [coupling]", &cost(&|p| p.group() == Coupling));
    }
    let all = |p: &Parameter| matches!(p.group(), RotorInertia | Offset | Coupling) || of_load(p) || quadratic(p);
    row("all of these", "", &cost(&all));
    row("all of these, for a reader that ignores `<dynamics>`", "", &cost(&|p| all(p) || p.group() == Friction));
    row("unconstrained instead of physically consistent values", "model.toml [identified]", &found.torque_rms);
    if model.structure.presliding_travel > 0.0 {
        let _ = write!(
            out,
            "\nCoulomb friction builds up over a travel of {} rad after each reversal in the model (presliding); in a URDF its law\n\
             near standstill is the reader's, and so is what the two differ by there.\n",
            model.structure.presliding_travel
        );
    } else if model.structure.sign_velocity > 0.0 {
        let _ = write!(
            out,
            "\nCoulomb friction changes sign as tanh(speed/{} rad/s) in the model; in a URDF its slope is the reader's.\n",
            model.structure.sign_velocity
        );
    }
    if !written.merged.is_empty() {
        out += "\nA torque determines only the mass of all that moves as one. So these links lost their own `<inertial>` to the\n\
                moving link that carries them:\n\n";
        for (link, carrier) in &written.merged {
            let _ = writeln!(out, "* `{link}` into `{carrier}`");
        }
    }
    out + "\nWhat torque does not determine (mass of the first link, splits between neighbouring links) comes from the nominal URDF.\n"
}
