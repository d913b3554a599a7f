//! `rivet diagnose --export DIR`: model.toml, robot.urdf, robot.xml with what was found, and what each of them misses.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result};
use rivet_config::{Changes, Robot, write_changed, write_identified};
use rivet_diagnosis::{Fidelity, Format, FormatReport, Patch, SeparatingMotion, mjcf_coupling_fits};
use rivet_dynamics::{EffectKind, Mjcf, MjcfDrive, MjcfTendon, write_efforts, write_urdf};
use rivet_report::words::effect;

use crate::export::{bodies, description, place_load};
use crate::mujoco_forces;
use crate::runs;
use crate::session;
use crate::table::{number, paragraph};

/// Drive values that differ by a smaller share are the same.
const SAME: f64 = 0.02;

/// Start of a mesh in a URDF.
const MESH: &str = "<mesh";
const NO_MESHES: &str = "robot.xml has bodies and joints without the meshes of the URDF: it moves as the arm does, and cannot be seen or touched";

/// Writes the four files into `folder`. Gives the robot as model.toml says it.
pub(crate) fn export(robot: &Robot, patch: &Patch, folder: &Path) -> Result<Robot> {
    let named = |path: &Path| path.display().to_string();
    std::fs::create_dir_all(folder).with_context(|| named(folder))?;
    let [urdf, model, mjcf, notes] =
        ["robot.urdf", "model.toml", "robot.xml", "not-expressible.md"].map(|name| folder.join(name));
    let text = description(robot, folder)?;
    let mut moved = robot.clone();
    moved.config.urdf.clone_from(&urdf);
    place_load(&mut moved, robot, folder)?;
    // Where bodies and drives stay those given the URDF does; what fits the data is in [identified].
    let stay = patch.stays.as_given || patch.stays.bodies;
    let written = if stay { robot.config.nominal_joints() } else { patch.drives(&patch.written) };
    let urdf_text = if stay {
        text
    } else {
        let links = bodies(robot.dof(), &patch.written);
        let made = write_urdf(&text, &robot.config.urdf_options, &links, &written.viscous, &written.coulomb);
        made.with_context(|| named(&robot.config.urdf))?.text
    };
    let saturated = patch.model.effects().list().iter().filter(|e| e.kind == EffectKind::TorqueSaturation);
    let efforts: Vec<(&str, f64)> =
        saturated.map(|e| (robot.model.arm.joints[e.joint].name.as_str(), e.values[0])).collect();
    let urdf_text = write_efforts(&urdf_text, &efforts).with_context(|| named(&robot.config.urdf))?;
    rivet_files::write_whole(&urdf, &urdf_text).with_context(|| named(&urdf))?;
    let changes =
        Changes { drives: written, gravity: patch.model.arm.gravity, effects: patch.model.effects().list().to_vec() };
    let mut made = write_changed(&moved, &changes, &model).with_context(|| named(&model))?;
    if made.model.parameters == patch.model.parameters && !stay {
        let values = made.base.from_standard(&patch.standard);
        write_identified(&made, &values, &patch.std, &model).with_context(|| named(&model))?;
        made = rivet_config::load(&model)?;
    }
    rivet_files::write_whole(&mjcf, of_robot(&made).text()).with_context(|| named(&mjcf))?;
    let forces = mujoco_forces::module(&made);
    if let Some(forces) = &forces {
        let path = folder.join(mujoco_forces::FILE);
        rivet_files::write_whole(&path, forces).with_context(|| named(&path))?;
    }
    for (k, motion) in patch.motions.iter().enumerate() {
        let rivals = motion.rivals.iter().map(|r| effect(r.name())).collect::<Vec<_>>().join(", ");
        let cause = effect(motion.effect.name());
        if !motion.is_conclusive() {
            let text = format!(
                "no setpoints are written to separate {cause} from {rivals}: one joint alone, within its limits, is not expected to do it"
            );
            session::note(paragraph("rivet: ", &text).trim_end());
            continue;
        }
        let path = folder.join(format!("separating-{}.csv", k + 1));
        let text = setpoints(motion, &robot.config.log.joint_zero);
        rivet_files::write_whole(&path, &text).with_context(|| named(&path))?;
        session::note(format_args!("rivet: {} separates {cause} from {rivals}: {}", path.display(), motion.text));
    }
    rivet_files::write_whole(&notes, rivet_files::Printable(not_expressible(robot, patch)).to_string())
        .with_context(|| named(&notes))?;
    if urdf_text.contains(MESH) {
        session::note(paragraph("rivet: ", NO_MESHES).trim_end());
    }
    for line in staying(robot, patch) {
        session::note(paragraph("rivet: ", &format!("{line} (see {})", notes.display())).trim_end());
    }
    for report in &patch.formats {
        if let Some(missing) = missing_effects(report) {
            let adds = match (report.format, &forces) {
                (Format::Mjcf, Some(_)) => {
                    format!("; {} adds those that follow from position and velocity", mujoco_forces::FILE)
                }
                _ => String::new(),
            };
            let text = format!("{} has no place for {missing}{adds} (see {})", report.format.file(), notes.display());
            session::note(paragraph("rivet: ", &text).trim_end());
        }
        if let Some(joints) = worse(report, &runs::joint_names(robot)) {
            let text = format!(
                "{} has a larger residual than the nominal model on {joints}: its format cannot express what was found (see {})",
                folder.join(report.format.file()).display(),
                notes.display()
            );
            session::note(paragraph("rivet: ", &text).trim_end());
        }
    }
    Ok(made)
}

/// What MJCF holds of a robot: bodies, drives and those effects that it has a place for.
pub(crate) fn of_robot(robot: &Robot) -> Mjcf {
    let (config, joints) = (&robot.config, robot.config.nominal_joints());
    let mut mjcf = Mjcf {
        arm: robot.model.arm.clone(),
        period_s: config.sample_period_s,
        drives: (0..robot.dof())
            .map(|j| MjcfDrive {
                armature: joints.rotor_inertia[j],
                damping: [joints.viscous[j], joints.viscous_quadratic.get(j).copied().unwrap_or(0.0), 0.0],
                frictionloss: joints.coulomb[j],
                bias: -joints.offset[j],
                ..MjcfDrive::plain(config.drive.torque_limit[j])
            })
            .collect(),
        tendons: Vec::new(),
    };
    for effect in robot.model.effects().list() {
        let (j, [a, b, c, _]) = (effect.joint, effect.values);
        let drive = &mut mjcf.drives[j];
        match effect.kind {
            EffectKind::ViscousNonlinearity => {
                drive.damping[1] += a;
                drive.damping[2] += b;
            }
            EffectKind::TorqueConstant => drive.gain = 1.0 / (1.0 + a),
            EffectKind::JointSpring if a >= 0.0 => drive.stiffness = a,
            EffectKind::TorqueSaturation => drive.limit = drive.limit.min(a),
            EffectKind::EncoderOffset => drive.zero = -a,
            EffectKind::TransportDelay => mjcf.drives.iter_mut().for_each(|d| d.delay = a),
            EffectKind::CurrentLoopLag => mjcf.drives.iter_mut().for_each(|d| d.lag = a),
            EffectKind::JointCoupling if mjcf_coupling_fits(effect, |j| joints.rotor_inertia[j]) => {
                // The tendon's inertia adds to both joints' own.
                mjcf.drives[j].armature -= c;
                mjcf.drives[j - 1].armature -= c;
                mjcf.tendons.push(MjcfTendon { joints: [j - 1, j], armature: c, damping: b, frictionloss: a });
            }
            _ => {}
        }
    }
    mjcf
}

/// A motion as a log without torque: time, planned positions (as both `q` and `q_des`), speeds and accelerations.
fn setpoints(motion: &SeparatingMotion, joint_zero: &[f64]) -> String {
    let n = motion.q.len();
    let mut out = "t".to_owned();
    for kind in ["q", "q_des", "qd_des", "qdd_des"] {
        for j in 1..=n {
            let _ = write!(out, ",{kind}{j}");
        }
    }
    out.push('\n');
    for k in 0..motion.q[0].len() {
        // Writing to a String cannot fail.
        let _ = write!(out, "{}", (k as f64 * motion.period_s * 1e9).round() / 1e9);
        let positions = motion.q.iter().zip(joint_zero).map(|(q, zero)| q[k] - zero);
        let positions: Vec<f64> = positions.collect();
        let others = motion.qd.iter().chain(&motion.qdd).map(|s| s[k]);
        for value in positions.iter().chain(&positions).copied().chain(others) {
            let _ = write!(out, ",{value}");
        }
        out.push('\n');
    }
    out
}

/// Effects and rotor inertia that a file does not hold, in words.
fn missing_effects(report: &FormatReport) -> Option<String> {
    let missing = report.items.iter().filter(|item| item.is_notable && item.fidelity == Fidelity::Missing);
    let names: Vec<&str> = missing.map(|item| item.what.as_str()).collect();
    (!names.is_empty()).then(|| names.join(", "))
}

/// Names of the joints on which a file is worse than the model as given.
fn worse(report: &FormatReport, names: &[String]) -> Option<String> {
    let joints: Vec<&str> = report.worse.iter().map(|j| names[*j].as_str()).collect();
    (!joints.is_empty()).then(|| joints.join(", "))
}

/// Drive values that the data gave and those written, where they differ.
fn by_joint(robot: &Robot, patch: &Patch) -> String {
    let (free, written) = (patch.drives(&patch.standard), patch.drives(&patch.written));
    let given = robot.config.nominal_joints();
    let mut out = String::new();
    for (what, free, written, given) in [
        ("rotor inertia", &free.rotor_inertia, &written.rotor_inertia, &given.rotor_inertia),
        ("viscous friction", &free.viscous, &written.viscous, &given.viscous),
        ("Coulomb friction", &free.coulomb, &written.coulomb, &given.coulomb),
    ] {
        for (j, name) in runs::joint_names(robot).iter().enumerate() {
            if (free[j] - written[j]).abs() > SAME * written[j].abs().max(given[j].abs()) {
                let [free, written, given] = [free[j], written[j], given[j]].map(|v| number(v, 3));
                // Writing to a String cannot fail.
                let _ = writeln!(out, "| {what} of {name} | {free} | {written} | {given} |");
            }
        }
    }
    if out.is_empty() {
        return out;
    }
    format!(
        "\nDrive values whose size in the diagnosis (and `[identified]`) is not the one of an arm that can be built:\n\n\
         | | as the data gave it | written | given |\n|---|---:|---:|---:|\n{out}"
    )
}

/// What of the files is as given, though something else was found, and why.
fn staying(robot: &Robot, patch: &Patch) -> Vec<String> {
    let (stays, all) = (&patch.stays, runs::joint_names(robot));
    let names = |joints: &[usize]| joints.iter().map(|j| all[*j].as_str()).collect::<Vec<_>>().join(", ");
    let mut lines = Vec::new();
    if stays.as_given {
        lines.push("all files hold the nominal model: the corrected one has a larger residual".to_owned());
        return lines;
    }
    if !stays.worse.is_empty() {
        lines.push(format!(
            "in the files {} has up to a quarter more residual than in the nominal model, and the other joints have much less",
            names(&stays.worse)
        ));
    }
    match (&patch.consistent, stays.bodies) {
        (Err(why), _) => lines.push(format!(
            "bodies and drives of all files are those given: no arm that can be built is near the values found ({why})"
        )),
        (Ok(_), true) => lines.push(
            "bodies and drives of all files stay nominal: the nearest consistent arm has a larger residual".to_owned(),
        ),
        (Ok(_), false) if !stays.joints.is_empty() => lines.push(format!(
            "drive values of {} stay nominal: with those of the nearest consistent arm their residual is larger",
            names(&stays.joints)
        )),
        _ => {}
    }
    if !stays.bodies && !stays.unheard.is_empty() {
        lines.push(format!("drive values of {} stay nominal: their torque is untrusted", names(&stays.unheard)));
    }
    lines
}

fn not_expressible(robot: &Robot, patch: &Patch) -> String {
    let mut out = format!(
        "# {}: what the files of this folder do not carry\n\n\
         model.toml has what was found, but for what the end of this file names: values in robot.urdf, `[drive]` and `[friction]`, base parameters as the\n\
         data gave them in `[identified]`, missing effects in `[effects.<name>]`. `rivet predict` uses all of it but what it\n\
         names. robot.urdf and robot.xml have the nearest bodies that can be built.\n\n\
         Figures: torque that is missed, root mean square over the logs of the diagnosis after its filter [N m; N for a\n\
         prismatic joint].\n",
        robot.config.name
    );
    let names = runs::joint_names(robot);
    let cells = |rms: &[f64]| rms.iter().map(|r| number(*r, 3)).collect::<Vec<_>>().join(" | ");
    for report in &patch.formats {
        // Writing to a String cannot fail, here and below.
        let _ = write!(out, "\n## {}\n\n| | | where, or why not | {} |\n", report.format.file(), names.join(" | "));
        let _ = writeln!(out, "|---|---|---|{}", "---:|".repeat(names.len()));
        for item in &report.items {
            let cost = match item.fidelity {
                Fidelity::Exact => "0 | ".repeat(names.len()).trim_end_matches(" | ").to_owned(),
                Fidelity::Missing => cells(&item.torque_rms),
            };
            let _ = writeln!(out, "| {} | {} | {} | {cost} |", item.what, item.fidelity.name(), item.place);
        }
        let _ = writeln!(out, "| **all that is missing together** | | | {} |", cells(&report.missed));
        let _ = writeln!(out, "| **gap of a reader of this file** | | | {} |", cells(&report.gap));
        let _ = writeln!(out, "| gap of the nominal model, in this format | | | {} |", cells(&report.gap_before));
        if let Some(joints) = worse(report, &names) {
            let _ = writeln!(
                out,
                "\n**Worse than the nominal model on {joints}**: the values found belong to effects that this file \
                 cannot hold."
            );
        }
    }
    let plain = |rms: &[f64]| cells(rms).replace(" | ", " ");
    let _ = writeln!(out, "\nMeasured torque: {} N m rms.", plain(&patch.torque_rms));
    // Every fit has half a sample of time free, whatever is named beside it, and that may have the other sign.
    let shifts_time = patch
        .model
        .effects()
        .list()
        .iter()
        .any(|e| matches!(e.kind, EffectKind::TransportDelay | EffectKind::CurrentLoopLag));
    let _ = writeln!(
        out,
        "\n{} {} ms {} position in the logs ({} N m rms): a property of the recording, in none of the files.",
        if shifts_time { "In addition to the delay or lag of the model, torque is" } else { "Torque is" },
        number(1e3 * patch.timing_s.abs(), 2),
        if patch.timing_s < 0.0 { "after" } else { "before" },
        plain(&patch.timing_rms)
    );
    match &patch.consistent {
        Ok(found) if !found.thickened.is_empty() => {
            let _ = writeln!(out, "\nBodies without extent in some direction got one: {}.", found.thickened.join(", "));
        }
        _ => {}
    }
    let mut stay = staying(robot, patch);
    let stays = &patch.stays;
    if !stays.bodies && !stays.as_given && !stays.unpinned.is_empty() {
        stay.push(format!("nominal, since the logs do not determine them: {}", stays.unpinned.join(", ")));
    }
    if stays.free {
        stay.push(
            "values free of that bound are in no file: over all logs they are no nearer than those written".to_owned(),
        );
    }
    if !stay.is_empty() {
        out += "\nWhat is not written though it was found, or is written and does not help everywhere:\n\n";
        for line in stay {
            let _ = writeln!(out, "* {line}");
        }
    }
    out += &by_joint(robot, patch);
    if !patch.left_out.is_empty() {
        out += "\nNamed by the diagnosis, and in no file:\n\n";
        for (effect, why) in &patch.left_out {
            let _ = writeln!(out, "* {effect}: {why}");
        }
    }
    let not_here: Vec<(&str, &str)> =
        patch.model.effects().list().iter().filter_map(|e| Some((e.kind.name(), e.kind.not_instant()?))).collect();
    if !not_here.is_empty() {
        out += "\nIn model.toml, and not used by the estimator of rivetd and by rivet-controller, which report it at \
                their start:\n\n";
        for (name, why) in not_here {
            let _ = writeln!(out, "* `[effects.{name}]`: {why}");
        }
    }
    out
}
