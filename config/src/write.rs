//! Writing a robot file with identified base parameters.

use std::fmt::Write as _;
use std::io;
use std::path::{Component, Path, PathBuf};

use rivet_dynamics::{Joints, KnownEffect};

use crate::load::Robot;
use crate::number_text::number_text;
use crate::reader::{Origin, Resolved, Value, value_text};

/// Writes `robot` with identified base parameters as a robot file that [`load`](crate::load) reads again.
///
/// Every value that the robot's own file gave is kept with all its digits (comments are not); `urdf` is rewritten so
/// that it is found from the new place. `values` and `std` are in the order of [`Robot::base`] and in its units.
/// [`Robot::not_excited`] is written beside them.
/// The file appears whole or not at all: it is written beside its place and renamed.
///
/// # Errors
/// If the lengths are not that of the base set, a value is not finite, a standard deviation is negative, or the file
/// cannot be written.
pub fn write_identified(robot: &Robot, values: &[f64], std: &[f64], path: &Path) -> io::Result<()> {
    write_with(robot, "", values, std, path)
}

/// As [`write_identified`], with the drives' values of a physically consistent set in the place of those that the
/// robot's own file gave; with its bodies in the URDF, the nominal values of the written file are that set. `[identified]`
/// holds the unconstrained base parameters or, with `consistent_values`, those of this set, and the file names which.
///
/// # Errors
/// As [`write_identified`].
pub fn write_consistent(
    robot: &Robot,
    drives: &Joints,
    [values, std]: [&[f64]; 2],
    consistent_values: bool,
    path: &Path,
) -> io::Result<()> {
    let mut changed = robot.clone();
    set_drives(&mut changed, drives);
    let which = if consistent_values {
        "[identified] holds the base parameters of this set: it predicts left-out rows better than the unconstrained one.\n"
    } else {
        "[identified] holds base parameters as the data gave them, without that constraint. rivet uses the latter.\n"
    };
    let set =
        "# URDF, [drive], [friction] and [coupling] hold the physically consistent set (bodies that can be built);\n# ";
    write_with(&changed, &format!("{set}{which}"), values, std, path)
}

/// What a diagnosis changes in a robot file, beside the bodies in its URDF.
#[derive(Clone, Debug)]
pub struct Changes {
    /// Drives, friction and coupling.
    pub drives: Joints,
    /// Gravity in base axes \[m/s²\].
    pub gravity: [f64; 3],
    /// All effects that the file shall have.
    pub effects: Vec<KnownEffect>,
}

/// Writes `robot` with other values and effects, and reads it again: its model is another one, so identified parameters
/// are not among what is written. The file appears whole or not at all.
///
/// # Errors
/// If the file cannot be written, or what was written cannot be read.
pub fn write_changed(robot: &Robot, changes: &Changes, path: &Path) -> io::Result<Robot> {
    let mut changed = robot.clone();
    set_drives(&mut changed, &changes.drives);
    let offsets = changes.drives.offset.iter().any(|x| *x != 0.0);
    let resolved = &mut changed.config.resolved;
    for r in resolved.iter_mut() {
        match r.key.path().as_str() {
            "gravity" => r.value = Value::Numbers(changes.gravity.to_vec()),
            "estimator.offsets" if offsets => r.value = Value::Bool(true),
            _ => {}
        }
    }
    resolved.retain(|r| !r.key.section.starts_with("effects."));
    resolved.extend(crate::effects::resolved(&changes.effects, robot.dof()));
    let note = "# Values and effects of a diagnosis; the URDF, [drive] and [friction] hold bodies that can be built.\n";
    let places = Places::of(robot, path)?;
    rivet_files::write_whole(path, model_text(&changed, note, &places))?;
    crate::load(path).map_err(|why| io::Error::new(io::ErrorKind::InvalidData, why.to_string()))
}

fn set_drives(changed: &mut Robot, drives: &Joints) {
    for r in &mut changed.config.resolved {
        let value = match (r.key.section, r.key.name) {
            ("drive", "rotor_inertia") => Value::Numbers(drives.rotor_inertia.clone()),
            ("friction", "viscous") => Value::Numbers(drives.viscous.clone()),
            ("friction", "coulomb") => Value::Numbers(drives.coulomb.clone()),
            ("friction", "offset") => Value::Numbers(drives.offset.clone()),
            ("friction", "load_dependent") => Value::Numbers(drives.load_friction.clone()),
            ("friction", "viscous_quadratic") => Value::Numbers(drives.viscous_quadratic.clone()),
            ("coupling", "rotor_inertia") => Value::Number(drives.coupling[0]),
            ("coupling", "viscous") => Value::Number(drives.coupling[1]),
            ("coupling", "coulomb") => Value::Number(drives.coupling[2]),
            _ => continue,
        };
        if r.value != Value::Absent {
            r.value = value;
        }
    }
}

fn write_with(robot: &Robot, note: &str, values: &[f64], std: &[f64], path: &Path) -> io::Result<()> {
    let invalid = |why: String| Err(io::Error::new(io::ErrorKind::InvalidInput, why));
    let wanted = robot.base.len();
    if values.len() != wanted || std.len() != wanted {
        return invalid(format!(
            "{} values and {} standard deviations for {wanted} base parameters",
            values.len(),
            std.len()
        ));
    }
    for i in 0..wanted {
        if !values[i].is_finite() || !std[i].is_finite() || std[i] < 0.0 {
            let name = robot.base.name(&robot.model, i);
            return invalid(format!("{name} is {} with standard deviation {}", values[i], std[i]));
        }
    }
    let mut text = model_text(robot, note, &Places::of(robot, path)?);
    identified_text(&mut text, robot, values, std);
    rivet_files::write_whole(path, &text)
}

/// Where a robot's other files are, as seen from a new place.
struct Places {
    urdf: PathBuf,
    load_urdf: Option<PathBuf>,
}

impl Places {
    fn of(robot: &Robot, path: &Path) -> io::Result<Places> {
        let folder = match path.parent() {
            Some(p) if !p.as_os_str().is_empty() => p,
            _ => Path::new("."),
        };
        let load = robot.config.friction.load_urdf.as_ref();
        Ok(Places {
            urdf: relative(&robot.config.urdf, folder)?,
            load_urdf: load.map(|load| relative(load, folder)).transpose()?,
        })
    }
}

fn model_text(robot: &Robot, note: &str, places: &Places) -> String {
    let load_urdf = places.load_urdf.as_deref();
    let mut out =
        format!("# {} with values from data; written by rivet. Keys: docs/robot-toml.md.\n", robot.config.name);
    out += note;
    let mut section = "";
    // The file's own place of the bodies of load friction is set by who writes; it stands in the order of the keys.
    let quoted = |path: &Path| format!("{:?}", path.display().to_string());
    let load = |r: &&Resolved| r.key.path() == "friction.load_urdf" && load_urdf.is_some();
    let given = robot.config.resolved.iter().filter(|r| {
        load(r) || r.origin != Origin::Default && r.key.section != "identified" && r.value != Value::Absent
    });
    for r in given {
        // Writing to a String cannot fail, here and below.
        if r.key.section != section {
            section = r.key.section;
            let _ = write!(out, "\n[{section}]\n");
        }
        let text = match r.key.path().as_str() {
            "urdf" => quoted(&places.urdf),
            "friction.load_urdf" => load_urdf.map_or_else(String::new, quoted),
            _ => value_text(&r.value),
        };
        let unit = if r.key.unit.is_empty() { String::new() } else { format!("  # {}", r.key.unit) };
        let _ = writeln!(out, "{} = {text}{unit}", r.key.name);
    }
    out
}

fn identified_text(out: &mut String, robot: &Robot, values: &[f64], std: &[f64]) {
    let _ = write!(out, "\n[identified]\nhash = \"{:016x}\"\nparameters = [\n", robot.hash);
    for i in 0..values.len() {
        let name = robot.base.name(&robot.model, i);
        let unit = robot.base.parameter(&robot.model, i).unit(&robot.model.arm);
        let (value, std) = (number_text(values[i]), number_text(std[i]));
        let _ = writeln!(out, "  {{ name = \"{name}\", value = {value}, std = {std} }},  # {unit}");
    }
    out.push_str("]\n");
    if !robot.not_excited.is_empty() {
        // A TOML string of the kind that Rust writes.
        let _ = writeln!(out, "not_excited = {:?}", robot.not_excited);
    }
}

/// `target` as seen from `folder`; absolute if they have no common root.
fn relative(target: &Path, folder: &Path) -> io::Result<PathBuf> {
    let (target, folder) = (target.canonicalize()?, folder.canonicalize()?);
    let (to, from): (Vec<_>, Vec<_>) = (target.components().collect(), folder.components().collect());
    let common = to.iter().zip(&from).take_while(|(a, b)| a == b).count();
    if !to[..common].iter().any(|c| matches!(c, Component::Normal(_))) {
        return Ok(target);
    }
    let up = from[common..].iter().map(|_| Component::ParentDir);
    Ok(up.chain(to[common..].iter().copied()).collect())
}
