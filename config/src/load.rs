//! From a file to a [`Robot`]: configuration, model, base parameters, all checked.

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use rivet_dynamics::{
    Arm, BaseSet, Joints, KnownEffects, LinkParameters, Model, Proposal, Structure, UrdfArm, UrdfKey, UrdfNote,
    UrdfOptions, WristCoupling, guess_bodies, model_hash,
};
use rivet_files::Content;
use toml::de::DeTable;

use crate::error::{ConfigError, ConfigErrors, MOST_KEPT, Source};
use crate::reader::{RawParameter, Reader};
use crate::sections::{self, Bus, RobotConfig, read};
use crate::supervision::{supervision, workload};
use crate::toml_limits;

/// A robot file with the model it describes.
#[derive(Clone, Debug)]
pub struct Robot {
    /// The checked file.
    pub config: RobotConfig,
    /// Kinematics, bodies and the structure of the drives.
    pub model: Arc<Model>,
    /// The base parameters of the model.
    pub base: Arc<BaseSet>,
    /// What the base parameters mean: two processes with the same hash may exchange them.
    pub hash: u64,
    /// Nominal standard parameters: bodies of the URDF, drives and friction of the file.
    pub nominal: Vec<f64>,
    /// Nominal base parameters.
    pub nominal_base: Vec<f64>,
    /// Identified base parameters, where the file has them.
    pub identified: Option<Identified>,
    /// What the logs of the identified parameters did not excite, for people; empty where nothing is known.
    pub not_excited: String,
    /// What the URDF says beyond the model.
    pub description: Description,
}

/// What a URDF says beyond the model, and does not say.
#[derive(Clone, Debug, PartialEq)]
pub struct Description {
    /// Joints (from 0) whose bodies the URDF does not have: their nominal values are a guess.
    pub unknown_bodies: Vec<usize>,
    /// Tip and welded joints as they came out.
    pub chosen: Proposal,
    /// What a user should know.
    pub notes: Vec<UrdfNote>,
    /// Effort limits \[N·m or N\]; infinite where the URDF has none.
    pub effort: Vec<f64>,
    /// `[damping, friction]` of each `<dynamics>`.
    pub friction: Vec<Option<[f64; 2]>>,
}

/// Identified base parameters, in the order of [`Robot::base`].
#[derive(Clone, Debug, PartialEq)]
pub struct Identified {
    /// Values, in each parameter's unit.
    pub values: Vec<f64>,
    /// Standard deviations, in each parameter's unit.
    pub std: Vec<f64>,
}

impl Robot {
    /// Number of joints.
    pub fn dof(&self) -> usize {
        self.model.arm.dof()
    }

    /// The best base parameters the file knows: identified ones, else nominal.
    pub fn base_parameters(&self) -> &[f64] {
        self.identified.as_ref().map_or(&self.nominal_base, |i| &i.values)
    }
}

/// Reads a robot file and everything it refers to.
///
/// # Errors
/// Every mistake in the file, not only the first.
pub fn load(path: impl AsRef<Path>) -> Result<Robot, ConfigErrors> {
    let path = path.as_ref();
    text_of(path).and_then(|text| parse(path, &text)).map_err(|why| instead_of_robot_file(path).unwrap_or(why))
}

/// What to do with a xacro file.
const XACRO_MEND: &str = "`xacro FILE > robot.urdf` makes a URDF of it";

/// That a file of another kind stands where a robot file has to; none where it may be one.
fn instead_of_robot_file(path: &Path) -> Option<ConfigErrors> {
    let content = Content::of(path).ok()?;
    let shown = path.display();
    let hint = match content {
        Content::Toml | Content::Unknown => return None,
        Content::Empty => "`rivet new URDF LOG -o ROBOT.toml` writes one".to_owned(),
        Content::Urdf => format!("`rivet new {shown} LOG -o ROBOT.toml` writes one for this arm"),
        Content::Xacro => XACRO_MEND.to_owned(),
        Content::Table | Content::Recording(_) => "the robot file comes before recordings".to_owned(),
        _ => "give the path of a robot.toml".to_owned(),
    };
    Some(ConfigErrors::new(vec![ConfigError::of_file(path, format!("is {content}, not a robot file"), hint)]))
}

fn text_of(path: &Path) -> Result<String, ConfigErrors> {
    let whole = |why: &str, hint: &str| ConfigErrors::new(vec![ConfigError::of_file(path, why, hint)]);
    let bytes = rivet_files::read_whole(path, MAX_FILE_BYTES)
        .map_err(|e| whole(&format!("cannot be read ({e})"), "give the path of a robot.toml"))?;
    String::from_utf8(bytes).map_err(|_| whole("is not UTF-8 text", "save it as UTF-8"))
}

/// Where the daemon of a robot file is found, whatever else is wrong with the file: who asks a daemon that runs to read it anew,
/// to save or to freeze is not to be kept from that by a mistake somewhere in it.
///
/// # Errors
/// Every mistake in the file, where name or bus cannot be read.
pub fn address(path: impl AsRef<Path>) -> Result<(String, Bus), ConfigErrors> {
    let path = path.as_ref();
    address_in(path).map_err(|why| instead_of_robot_file(path).unwrap_or(why))
}

fn address_in(path: &Path) -> Result<(String, Bus), ConfigErrors> {
    let text = text_of(path)?;
    if toml_limits::ensure_bounded(&text).is_err() {
        return parse(path, &text).map(|robot| (robot.config.name, robot.config.bus));
    }
    let (root, _) = DeTable::parse_recoverable(&text);
    let mut reader = Reader::new(Source::new(path, &text), &root, Vec::new());
    let found = (read::name(&mut reader), read::bus(&mut reader));
    if reader.is_sound("", "name") && reader.good(&[("bus", "prefix"), ("bus", "root")]) {
        return Ok(found);
    }
    parse(path, &text).map(|robot| (robot.config.name, robot.config.bus))
}

/// Robot files and URDFs of more bytes are refused.
pub const MAX_FILE_BYTES: u64 = 16 << 20;

/// As [`load`], with the text of the file given; `path` names it and anchors relative paths.
///
/// # Errors
/// Every mistake in the text, not only the first.
pub fn parse(path: &Path, text: &str) -> Result<Robot, ConfigErrors> {
    let source = Source::new(path, text);
    if let Err((at, rule)) = toml_limits::ensure_bounded(text) {
        let hint = "give the path of a robot.toml";
        return Err(ConfigErrors::new(vec![ConfigError::at(&source, &(at..at + 1), "", "", rule, hint)]));
    }
    let (root, syntax) = DeTable::parse_recoverable(text);
    let syntax = syntax.iter().take(MOST_KEPT).map(|e| syntax_error(&source, e)).collect();
    let mut reader = Reader::new(source, &root, syntax);
    if reader.is_foreign() {
        let hint = "`rivet new URDF LOG -o ROBOT.toml` writes one";
        let why = "is a TOML file without a key of a robot file";
        return Err(ConfigErrors::new(vec![ConfigError::of_file(path, why, hint)]));
    }

    let name = read::name(&mut reader);
    let written_urdf = reader.text("", "urdf");
    if written_urdf.is_empty() && reader.is_sound("", "urdf") {
        reader.reject("", "urdf", "must name a file", "give the path of the arm's URDF, from this file's folder");
    }
    let urdf = path.parent().unwrap_or(Path::new("")).join(&written_urdf);
    let sample_period_s = reader.number("", "sample_period_s");
    let gravity = read::gravity(&mut reader);
    let options = read::model(&mut reader);
    let how = Reading { gravity, options: &options };
    let described =
        if written_urdf.is_empty() { None } else { read_urdf(&mut reader, ("", "urdf"), &urdf, &written_urdf, &how) };
    if let Some(described) = &described {
        reader.set_joints(described.arm.joints.iter().map(|j| j.name.clone()).collect());
        friction_of_urdf(&mut reader, described);
    }
    let arm = described.as_ref().map(|described| described.arm.clone());
    let drive = read::drive(&mut reader);
    let mut friction = read::friction(&mut reader);
    let load = load_bodies(&mut reader, &mut friction, path, &how, arm.as_ref());
    let coupling = read::coupling(&mut reader);
    let effects = crate::effects::read(&mut reader, arm.as_ref().map_or(0, Arm::dof));
    let log = read::log(&mut reader, drive.drive_gain.as_deref());
    let signal = read::signal(&mut reader, sample_period_s);
    let estimator = read::estimator(&mut reader, sample_period_s, signal.decimation, &friction);
    let supervision = supervision(&mut reader);
    let workload = workload(&mut reader);
    let publish = read::publish(&mut reader, sample_period_s);
    let realtime = read::realtime(&mut reader);
    let controller = read::controller(&mut reader, sample_period_s, publish.every);
    let simulation = read::simulation(&mut reader);
    let bus = read::bus(&mut reader);
    let given = reader.has_section("identified").then(|| {
        let hash = reader.text("identified", "hash");
        (hash, reader.parameters("identified", "parameters"))
    });
    let not_excited = if given.is_some() { reader.text("identified", "not_excited") } else { String::new() };

    // The model is only made from values without a mistake; its own mistakes join the list.
    let built = match (arm, &described) {
        (Some(mut arm), Some(described)) if reader.clean() => {
            let structure = Structure {
                offset: estimator.offsets,
                coupling: coupling.as_ref().map(|c| WristCoupling { driving: c.driving, driven: c.driven }),
                sign_velocity: signal.friction_velocity,
                presliding_travel: friction.presliding_travel,
                load_friction: friction.load_dependent.is_some(),
                viscous_quadratic: friction.viscous_quadratic.is_some(),
            };
            // The drive decides what the joint can do, whatever the URDF says of it, or does not.
            for (joint, limit) in arm.joints.iter_mut().zip(&drive.torque_limit) {
                joint.effort = *limit;
            }
            for (joint, limit) in arm.joints.iter_mut().zip(drive.velocity_limit.iter().flatten()) {
                joint.velocity = *limit;
            }
            let unknown = guess_bodies(&mut arm, &described.unknown, &drive.torque_limit, described.tip_length);
            let model = Model::new(arm, structure).with_unknown_bodies(unknown);
            let model = match load {
                Some(bodies) => model.with_load(bodies),
                None => model,
            };
            let drives = Joints {
                rotor_inertia: drive.rotor_inertia.clone(),
                viscous: friction.viscous.clone(),
                ..Joints::default()
            };
            let model = model.with_effects(KnownEffects::new(effects.clone(), &drives));
            let base = BaseSet::new(&model);
            if let Err(why) = &base {
                reader.reject("", "urdf", why.to_string(), format!("correct it in {written_urdf}"));
            }
            base.ok().map(|base| (model, base))
        }
        _ => None,
    };
    let hash = built.as_ref().map_or(0, |(model, base)| model_hash(model, base));
    let identified = match (&built, given) {
        (Some((model, base)), Some((written, parameters))) => {
            identified(&mut reader, model, base, hash, &written, &parameters)
        }
        _ => None,
    };

    let (resolved, errors) = reader.finish();
    let (Some((model, base)), Some(described)) = (built.filter(|_| errors.is_empty()), described) else {
        return Err(ConfigErrors::new(errors));
    };
    let description = description(described);
    let config = RobotConfig {
        path: path.to_path_buf(),
        name,
        urdf,
        urdf_options: options,
        sample_period_s,
        gravity,
        drive,
        friction,
        coupling,
        effects,
        log,
        signal,
        estimator,
        supervision,
        workload,
        publish,
        realtime,
        controller,
        simulation,
        bus,
        resolved,
    };
    let nominal = model.nominal(&config.nominal_joints());
    let nominal_base = base.from_standard(&nominal);
    Ok(Robot {
        config,
        model: Arc::new(model),
        base: Arc::new(base),
        hash,
        nominal,
        nominal_base,
        identified,
        not_excited,
        description,
    })
}

fn description(of: UrdfArm) -> Description {
    let unknown_bodies = (0..of.unknown.len()).filter(|&j| of.unknown[j]).collect();
    let effort = of.arm.joints.iter().map(|joint| joint.effort).collect();
    Description { unknown_bodies, chosen: of.chosen, notes: of.notes, effort, friction: of.friction }
}

/// `<dynamics>` of the URDF are the nominal friction where the file has none.
fn friction_of_urdf(reader: &mut Reader<'_>, described: &UrdfArm) {
    if described.friction.iter().all(Option::is_none) {
        reader.derive("friction", "viscous", 0.0);
        reader.derive("friction", "coulomb", 0.0);
        return;
    }
    for (k, name, written) in [(0, "viscous", "damping"), (1, "coulomb", "friction")] {
        let values: Vec<f64> = described.friction.iter().map(|of| of.map_or(0.0, |of| of[k])).collect();
        let wrong = values.iter().position(|x| !(x.is_finite() && *x >= 0.0));
        if let (Some(j), false) = (wrong, reader.has("friction", name)) {
            let joint = &described.arm.joints[j].name;
            let rule = format!("joint \"{joint}\" has {written} {} in <dynamics>, which is no friction", values[j]);
            reader.reject("", "urdf", rule, format!("correct it, or write `{name} = ...` below `[friction]`"));
        }
        reader.derive_from_urdf("friction", name, values);
    }
}

/// The bodies of `friction.load_urdf`, where it is given: those of the same arm.
fn load_bodies(
    reader: &mut Reader<'_>,
    friction: &mut sections::Friction,
    path: &Path,
    how: &Reading<'_>,
    arm: Option<&Arm>,
) -> Option<Vec<LinkParameters>> {
    const KEY: (&str, &str) = ("friction", "load_urdf");
    let written = reader.text(KEY.0, KEY.1);
    if written.is_empty() {
        return None;
    }
    let urdf = path.parent().unwrap_or(Path::new("")).join(&written);
    let other = read_urdf(reader, KEY, &urdf, &written, how)?.arm;
    friction.load_urdf = Some(urdf);
    let arm = arm?;
    if other.joints != arm.joints {
        let hint = "only bodies may differ: take a copy of `urdf` and change its <inertial> elements";
        reader.reject(KEY.0, KEY.1, "must have the joints of `urdf`, with the same names and places", hint);
        return None;
    }
    Some(other.links)
}

/// Why a file cannot be a URDF. `Display` gives the rule: `is a TOML file, not a URDF`.
#[derive(Debug)]
pub enum NoUrdf {
    /// It cannot be read.
    Io(std::io::Error),
    /// It holds something else.
    Other(Content),
}

impl NoUrdf {
    /// What to do about it; none where the file is not there or cannot be read.
    pub fn mend(&self) -> Option<&'static str> {
        Some(match self {
            NoUrdf::Io(_) => return None,
            NoUrdf::Other(Content::Toml) => "give the URDF; a robot file names it in `urdf`",
            NoUrdf::Other(Content::Xacro) => XACRO_MEND,
            NoUrdf::Other(Content::Mjcf | Content::Sdf) => "export the arm as URDF: only that is read",
            NoUrdf::Other(_) => "give the URDF of the arm",
        })
    }
}

impl fmt::Display for NoUrdf {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            NoUrdf::Io(why) => write!(f, "cannot be read ({why})"),
            NoUrdf::Other(content) => write!(f, "is {content}, not a URDF"),
        }
    }
}

impl std::error::Error for NoUrdf {}

/// The text of a URDF, which may still be wrong; what is certainly none is refused by what it is.
///
/// # Errors
/// It cannot be read, has more than [`MAX_FILE_BYTES`], or holds something else.
pub fn urdf_text(path: &Path) -> Result<String, NoUrdf> {
    match Content::of(path).map_err(NoUrdf::Io)? {
        Content::Urdf | Content::Xml | Content::Unknown => {}
        other => return Err(NoUrdf::Other(other)),
    }
    rivet_files::read_text(path, MAX_FILE_BYTES).map_err(NoUrdf::Io)
}

/// How URDFs are read.
struct Reading<'a> {
    gravity: [f64; 3],
    options: &'a UrdfOptions,
}

/// Reads a URDF; whatever is wrong with it is a mistake of `key`, or of `[model]`.
fn read_urdf(
    reader: &mut Reader<'_>,
    key: (&'static str, &'static str),
    urdf: &Path,
    written: &str,
    how: &Reading<'_>,
) -> Option<UrdfArm> {
    let text = match urdf_text(urdf) {
        Ok(text) => text,
        Err(why) => {
            let looked = || format!("the path is relative to this file; looked for {}", urdf.display());
            reader.reject(key.0, key.1, why.to_string(), why.mend().map_or_else(looked, str::to_owned));
            return None;
        }
    };
    // A wrong gravity is a mistake of its own; the arm is still wanted for its joint count.
    let gravity = if how.gravity.iter().all(|g| g.is_finite()) { how.gravity } else { [0.0; 3] };
    match UrdfArm::read(&text, gravity, how.options) {
        Ok(arm) => Some(arm),
        Err(mistakes) => {
            for mistake in mistakes.all() {
                let (section, name) = match mistake.error.key() {
                    UrdfKey::File => key,
                    UrdfKey::Tip => ("model", "tip"),
                    UrdfKey::Fixed => ("model", "fixed"),
                };
                reader.reject(section, name, mistake.to_string(), mistake.error.mend(written));
            }
            None
        }
    }
}

/// Puts the entries of `[identified]` into the order of the base parameters.
fn identified(
    reader: &mut Reader<'_>,
    model: &Model,
    base: &BaseSet,
    hash: u64,
    written: &str,
    parameters: &[RawParameter],
) -> Option<Identified> {
    if u64::from_str_radix(written, 16) != Ok(hash) || written.len() != 16 {
        let rule = format!("must be the hash of this model, {hash:016x}");
        let hint =
            "the values belong to other kinematics, gravity or structure: identify again, or remove [identified]";
        reader.reject("identified", "hash", rule, hint);
        return None;
    }
    let names: Vec<String> = (0..base.len()).map(|i| base.name(model, i)).collect();
    let mut found: Vec<Option<(f64, f64)>> = vec![None; names.len()];
    for raw in parameters {
        let Some(i) = names.iter().position(|n| *n == raw.name) else {
            let near = crate::error::nearest(&raw.name, names.iter().map(String::as_str));
            let hint = near.map_or("see `rivet check` for the names".into(), |n| format!("did you mean \"{n}\"?"));
            let rule = format!("\"{}\" is no base parameter of this model", raw.name);
            reader.reject_at("identified", "parameters", &raw.span, rule, hint);
            return None;
        };
        if found[i].replace((raw.value, raw.std)).is_some() {
            let rule = format!("\"{}\" is given twice", raw.name);
            reader.reject_at("identified", "parameters", &raw.span, rule, "keep one of the two");
            return None;
        }
    }
    if let Some(i) = found.iter().position(Option::is_none) {
        let rule = format!("has {} values, the model has {} base parameters", parameters.len(), names.len());
        reader.reject("identified", "parameters", rule, format!("\"{}\" is missing", names[i]));
        return None;
    }
    let (values, std) = found.into_iter().flatten().unzip();
    Some(Identified { values, std })
}

/// A mistake of the TOML itself.
fn syntax_error(source: &Source<'_>, error: &toml::de::Error) -> ConfigError {
    let text = source.text;
    let span = error.span().unwrap_or(0..0);
    let start = span.start.min(text.len());
    let line = text[..start].rfind('\n').map_or(0, |i| i + 1);
    let end = text[start..].find('\n').map_or(text.len(), |i| start + i);
    let (key, value) = match text[line..end].split_once('=') {
        Some((key, value)) => (key.trim(), value.trim()),
        None => ("", text[line..end].trim()),
    };
    let hint = match error.message() {
        m if m.contains("duplicate") => "remove one of the two",
        m if m.contains("quoted") => "put text in double quotes; separate values with commas",
        m if m.contains("string") => "close the text with a double quote",
        m if m.contains("array") => "separate the values with commas and close the bracket",
        _ => "the file is TOML: `key = value` lines below `[section]` lines",
    };
    ConfigError::at(source, &span, key, value, error.message(), hint)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// None of these is waited for, or read into memory for ever.
    #[test]
    fn what_is_no_file_is_refused_at_once() {
        let folder = tempfile::tempdir().expect("a folder");
        let large = folder.path().join("large.toml");
        std::fs::write(&large, "#\n".repeat(MAX_FILE_BYTES as usize / 2 + 1)).expect("written");
        for (path, why) in
            [(Path::new("/dev/zero"), "a pipe or a device"), (folder.path(), "a folder"), (&large, "bytes")]
        {
            let said = load(path).expect_err("no robot file").to_string();
            assert!(said.contains(why), "{said}");
        }
    }
}
