//! What each file format carries of a model, and the torque that it loses.

use rivet_dynamics::{EffectKind, KnownEffect, Parameter, ParameterGroup, Places};

/// Ratio of two residuals that three digits show.
const SHOWN_DIFFERENCE: f64 = 1.005;

/// A file that a model is written to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// `model.toml`, read by rivet.
    Model,
    /// `robot.urdf`.
    Urdf,
    /// `robot.xml`, for MuJoCo 3.3 and later.
    Mjcf,
}

impl Format {
    /// All of them.
    pub const ALL: [Format; 3] = [Format::Model, Format::Urdf, Format::Mjcf];

    /// The file's name.
    pub fn file(self) -> &'static str {
        match self {
            Format::Model => "model.toml",
            Format::Urdf => "robot.urdf",
            Format::Mjcf => "robot.xml",
        }
    }
}

/// How well a format holds something.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fidelity {
    /// As it is in the model.
    Exact,
    /// Not at all.
    Missing,
}

impl Fidelity {
    /// The word in reports.
    pub fn name(self) -> &'static str {
        match self {
            Fidelity::Exact => "exact",
            Fidelity::Missing => "missing",
        }
    }
}

/// One thing of the model in one format.
#[derive(Clone, Debug, PartialEq)]
pub struct FormatItem {
    /// What, for people.
    pub what: String,
    /// Whether people are to know that a format lacks it: effects, and rotor inertia, which outweighs the links of a geared joint.
    pub is_notable: bool,
    /// Whether the format has it.
    pub fidelity: Fidelity,
    /// Where it stands, or why it does not.
    pub place: String,
    /// Its torque over the runs of the diagnosis: root mean square of each joint \[N·m\]. What is missed without it.
    pub torque_rms: Vec<f64>,
}

/// One format.
#[derive(Clone, Debug, PartialEq)]
pub struct FormatReport {
    /// Which.
    pub format: Format,
    /// Everything the model has.
    pub items: Vec<FormatItem>,
    /// Torque that a reader of this file misses: root mean square of each joint \[N·m\].
    pub missed: Vec<f64>,
    /// Measured torque without what a reader of this file has: root mean square of each joint \[N·m\].
    pub gap: Vec<f64>,
    /// The same with the model as given, written in this format.
    pub gap_before: Vec<f64>,
    /// Joints where a reader of this file is further from the runs than one of the model as given, and than one of `model.toml`: what
    /// the file cannot hold goes with values that were found beside it.
    pub worse: Vec<usize>,
}

/// A part of the model with its torque, `[joint][row]`.
pub(crate) struct Part {
    pub(crate) what: String,
    pub(crate) kind: PartKind,
    pub(crate) torque: Vec<Vec<f64>>,
}

/// What a part is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum PartKind {
    Group(ParameterGroup),
    Coulomb,
    LoadFriction,
    ViscousQuadratic,
    Gravity,
    Effect(KnownEffect),
    /// Unconstrained values instead of bodies that can be built.
    Unconstrained,
}

impl PartKind {
    pub(crate) fn from_parameter(parameter: Parameter) -> PartKind {
        match parameter {
            Parameter::Coulomb(_) => PartKind::Coulomb,
            Parameter::LoadFriction(_) => PartKind::LoadFriction,
            Parameter::ViscousQuadratic(_) => PartKind::ViscousQuadratic,
            other => PartKind::Group(other.group()),
        }
    }

    /// Where it stands in a format, or why it does not. `standard`: values that the file gets, of `joints` joints.
    fn place(&self, format: Format, standard: &[f64], joints: usize) -> Result<String, String> {
        use ParameterGroup as Group;
        let (yes, no) = (|text: &str| Ok(text.to_owned()), |text: &str| Err(text.to_owned()));
        match (self, format) {
            (PartKind::Unconstrained, Format::Model) => yes("[identified]"),
            (PartKind::Unconstrained, _) => no("bodies in this file can be built"),
            (PartKind::Effect(e), Format::Model) => Ok(format!("[effects.{}]", e.kind.name())),
            (PartKind::Gravity, Format::Model) => yes("gravity"),
            (_, Format::Model) => yes("robot.urdf, [drive], [friction], [coupling]"),
            (PartKind::Group(Group::Inertial), _) => yes("<inertial>"),
            (PartKind::Coulomb, Format::Urdf) => yes("<dynamics friction>; its slope at standstill is the reader's"),
            (PartKind::Group(Group::Friction), Format::Urdf) => yes("<dynamics damping>"),
            (PartKind::Effect(e), Format::Urdf) if e.kind == EffectKind::TorqueSaturation => {
                yes("<limit effort> of a joint that has a <limit>; the reader has to enforce it")
            }
            (_, Format::Urdf) => no("a URDF has no place for it"),
            (PartKind::Coulomb, Format::Mjcf) => yes("joint frictionloss; soft within solreffriction at standstill"),
            (PartKind::Group(Group::Friction), Format::Mjcf) => yes("joint damping"),
            (PartKind::Group(Group::RotorInertia), Format::Mjcf) => yes("joint armature"),
            (PartKind::Group(Group::Offset), Format::Mjcf) => yes("general actuator with constant bias"),
            (PartKind::Group(Group::Coupling), Format::Mjcf) => no("not written"),
            (PartKind::ViscousQuadratic, Format::Mjcf) => yes("second coefficient of joint damping"),
            (PartKind::LoadFriction, Format::Mjcf) => no("MuJoCo's friction does not know the load"),
            (PartKind::Gravity, Format::Mjcf) => yes("option gravity"),
            (PartKind::Effect(e), Format::Mjcf) => mjcf_place(e, standard, joints),
        }
    }
}

/// Where an effect stands in MJCF.
fn mjcf_place(e: &KnownEffect, standard: &[f64], joints: usize) -> Result<String, String> {
    let place = match e.kind {
        EffectKind::ViscousNonlinearity => "further coefficients of joint damping",
        EffectKind::TorqueConstant => "gain of the motor",
        EffectKind::JointSpring if e.values[0] >= 0.0 => "joint stiffness",
        EffectKind::TransportDelay => "delay of the motor",
        EffectKind::CurrentLoopLag => "dyntype filter of the motor",
        EffectKind::TorqueSaturation => "ctrlrange of the motor",
        EffectKind::EncoderOffset => "joint ref",
        EffectKind::JointCoupling => {
            let rotor = |j: usize| standard[Places::new(joints).rotor_inertia(j)];
            return if mjcf_coupling_fits(e, rotor) {
                Ok("fixed tendon with armature, damping and frictionloss".to_owned())
            } else {
                Err("a tendon's armature, damping and friction must not be negative, nor larger than the rotors'"
                    .to_owned())
            };
        }
        EffectKind::Backlash | EffectKind::JointElasticity => {
            return Err("a body behind the gear is not written".into());
        }
        EffectKind::BaseFlexibility => return Err("a body under the arm is not written".into()),
        _ => return Err("MuJoCo has no such force".to_owned()),
    };
    Ok(place.to_owned())
}

/// Whether a tendon over the two joints can stand for a shared motor: its armature adds to both joints' own as well.
pub fn mjcf_coupling_fits(effect: &KnownEffect, rotor_inertia: impl Fn(usize) -> f64) -> bool {
    let [coulomb, viscous, inertia, _] = effect.values;
    let room = effect.joint > 0 && [effect.joint - 1, effect.joint].iter().all(|j| rotor_inertia(*j) >= inertia);
    room && coulomb >= 0.0 && viscous >= 0.0 && inertia >= 0.0
}

/// A model to be written.
pub(crate) struct Carrying<'a> {
    pub(crate) parts: &'a [Part],
    /// Standard parameters that the file gets.
    pub(crate) values: &'a [f64],
}

impl Carrying<'_> {
    /// `measured` without what a reader of the format has.
    fn residual(&self, format: Format, measured: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let mut residual = measured.to_vec();
        for part in self.parts {
            let is_expressible = part.kind.place(format, self.values, measured.len()).is_ok();
            let sign = match part.kind {
                // Bodies are told under the gravity that was found: where it cannot be written, the change is not there.
                PartKind::Gravity if is_expressible => continue,
                PartKind::Gravity => 1.0,
                _ if is_expressible => -1.0,
                _ => continue,
            };
            for (residual, torque) in residual.iter_mut().zip(&part.torque) {
                residual.iter_mut().zip(torque).for_each(|(residual, v)| *residual += sign * v);
            }
        }
        residual
    }
}

/// Root mean square of each joint.
pub(crate) fn rms(torque: &[Vec<f64>]) -> Vec<f64> {
    torque.iter().map(|t| (t.iter().map(|v| v * v).sum::<f64>() / t.len().max(1) as f64).sqrt()).collect()
}

/// Reports of all formats.
///
/// * `found`, `given`: the model to be written, and the one that was given
/// * `measured`: torque of the runs, `[joint][row]` \[N·m\]
pub(crate) fn reports(found: &Carrying<'_>, given: &Carrying<'_>, measured: &[Vec<f64>]) -> Vec<FormatReport> {
    let joints = measured.len();
    let whole = rms(&found.residual(Format::Model, measured));
    Format::ALL
        .iter()
        .map(|format| {
            let mut items = Vec::new();
            let mut missed: Option<Vec<Vec<f64>>> = None;
            for part in found.parts {
                let place = part.kind.place(*format, found.values, joints);
                if place.is_err() {
                    let sum = missed.get_or_insert_with(|| part.torque.iter().map(|t| vec![0.0; t.len()]).collect());
                    for (to, from) in sum.iter_mut().zip(&part.torque) {
                        to.iter_mut().zip(from).for_each(|(to, v)| *to += v);
                    }
                }
                items.push(FormatItem {
                    what: part.what.clone(),
                    is_notable: matches!(
                        part.kind,
                        PartKind::Effect(_)
                            | PartKind::LoadFriction
                            | PartKind::ViscousQuadratic
                            | PartKind::Group(ParameterGroup::RotorInertia)
                    ),
                    fidelity: if place.is_ok() { Fidelity::Exact } else { Fidelity::Missing },
                    place: place.unwrap_or_else(|why| why),
                    torque_rms: rms(&part.torque),
                });
            }
            let (gap, gap_before) = (rms(&found.residual(*format, measured)), rms(&given.residual(*format, measured)));
            let worse = |j: &usize| gap[*j] > SHOWN_DIFFERENCE * gap_before[*j].max(whole[*j]);
            FormatReport {
                worse: (0..joints).filter(worse).collect(),
                format: *format,
                items,
                missed: missed.map_or(vec![0.0; joints], |sum| rms(&sum)),
                gap,
                gap_before,
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use rivet_dynamics::{EffectKind, KnownEffect, ParameterGroup};

    use super::{Carrying, Format, Part, PartKind, reports};

    fn part(kind: PartKind, torque: f64) -> Part {
        Part { what: String::new(), kind, torque: vec![vec![torque, -torque]] }
    }

    /// Friction of 5 N m that was split into 3 and 2 which follow temperature: only model.toml can hold the 2, and what was
    /// found leaves 2 N m to readers of the others, where the model as given left nothing.
    #[test]
    fn a_file_that_is_worse_than_what_was_given_says_so() {
        let warm = KnownEffect::new(EffectKind::TemperatureDependentFriction, 0, &[]);
        let found = [part(PartKind::Coulomb, 3.0), part(PartKind::Effect(warm), 2.0)];
        let given = [part(PartKind::Coulomb, 5.0)];
        let values = [0.0; 20];
        let carrying = |parts| Carrying { parts, values: &values };
        for report in reports(&carrying(&found), &carrying(&given), &[vec![5.0, -5.0]]) {
            let left = if report.format == Format::Model { 0.0 } else { 2.0 };
            assert!((report.gap[0] - left).abs() < 1e-12 && report.gap_before[0] < 1e-12, "{report:?}");
            assert_eq!(report.worse.len(), usize::from(report.format != Format::Model), "{report:?}");
        }
    }

    /// Bodies that make 4 N m under the gravity that was found, 1 more than under the one given: a URDF holds the 3.
    #[test]
    fn bodies_of_a_file_without_gravity_hang_as_given() {
        let found = [part(PartKind::Group(ParameterGroup::Inertial), 4.0), part(PartKind::Gravity, 1.0)];
        let values = [0.0; 20];
        let carrying = |parts| Carrying { parts, values: &values };
        let given = [part(PartKind::Group(ParameterGroup::Inertial), 3.0)];
        for report in reports(&carrying(&found), &carrying(&given), &[vec![4.0, -4.0]]) {
            let left = if report.format == Format::Urdf { 1.0 } else { 0.0 };
            assert!((report.gap[0] - left).abs() < 1e-12 && (report.gap_before[0] - 1.0).abs() < 1e-12, "{report:?}");
            assert_eq!(report.worse.len(), 0, "{report:?}");
        }
    }
}
