//! MJCF: what MuJoCo can hold of an arm and its drives, written and read back.
//!
//! What MuJoCo 3 reads is written in its form. Damping with speed squared or cubed, and delays, need MuJoCo 4; the first
//! line of the file then names them.
//!
//! Joint torque τ that MuJoCo needs for a motion, as its file says it:
//!
//! ```text
//! τⱼ = rigid + armature·q̈ + d₁·q̇ + d₂·q̇|q̇| + d₃·q̇³ + frictionloss·sign(q̇) + stiffness·q − bias,   reported = τ/gain
//! ```

use std::fmt::Write as _;

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use crate::arm::{Arm, Joint, JointKind};
use crate::link::body_from_com;
use crate::model::friction_sign;
use crate::pseudo_inertia::com_from_body;
use crate::rigid::{Workspace, inverse_dynamics};
use crate::spatial::Mat3;

/// One joint with its drive.
#[derive(Clone, Debug, PartialEq)]
pub struct MjcfDrive {
    /// Rotor inertia at the joint \[kg·m²\].
    pub armature: f64,
    /// Friction with speed, its square and its cube \[N·m·s/rad, …\].
    pub damping: [f64; 3],
    /// Coulomb friction \[N·m\].
    pub frictionloss: f64,
    /// Spring to angle 0 \[N·m/rad\].
    pub stiffness: f64,
    /// Joint position at which the link is in its zero pose \[rad\].
    pub zero: f64,
    /// Torque given per torque commanded.
    pub gain: f64,
    /// Constant torque of the drive \[N·m\].
    pub bias: f64,
    /// Largest command \[N·m\].
    pub limit: f64,
    /// Time until a command acts \[s\].
    pub delay: f64,
    /// Time constant of the current loop \[s\]; 0 is none.
    pub lag: f64,
}

/// A motor that turns with two joints: a tendon over both.
#[derive(Clone, Debug, PartialEq)]
pub struct MjcfTendon {
    /// The two joints, from 0.
    pub joints: [usize; 2],
    /// Its inertia \[kg·m²\]; the joints' own armature is without it.
    pub armature: f64,
    /// \[N·m·s/rad\]
    pub damping: f64,
    /// \[N·m\]
    pub frictionloss: f64,
}

/// An arm as MJCF holds it.
#[derive(Clone, Debug, PartialEq)]
pub struct Mjcf {
    /// Kinematics, bodies, gravity.
    pub arm: Arm,
    /// Time step \[s\].
    pub period_s: f64,
    /// One a joint.
    pub drives: Vec<MjcfDrive>,
    /// Shared motors.
    pub tendons: Vec<MjcfTendon>,
}

/// Why a text is no arm as this module writes it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MjcfError {
    /// Not XML.
    #[error("is no XML: {0}")]
    Xml(String),
    /// Too deep, too many or too long for any arm.
    #[error("cannot be read: {0}")]
    Excess(#[from] crate::xml_limits::XmlExcess),
    /// An attribute that must be there.
    #[error("<{element}> has no usable `{attribute}`")]
    Attribute {
        /// Element.
        element: String,
        /// Its attribute.
        attribute: &'static str,
    },
    /// A name that is not a joint.
    #[error("\"{0}\" is no joint of the file")]
    UnknownJoint(String),
    /// Nothing moves.
    #[error("has no joint")]
    NoJoints,
}

impl Mjcf {
    /// The file's text.
    pub fn text(&self) -> String {
        let mut out = format!("<!-- written by rivet; beside it: not-expressible.md{} -->\n", self.version_note());
        let g = self.arm.gravity;
        // Writing to a String cannot fail. `{:?}` gives the shortest text that reads back as the same number.
        let _ = writeln!(out, "<mujoco model=\"{}\">", escaped(&self.arm.name));
        let _ = writeln!(out, "  <compiler angle=\"radian\" autolimits=\"true\"/>");
        let _ = writeln!(
            out,
            "  <option timestep=\"{:?}\" gravity=\"{:?} {:?} {:?}\" integrator=\"implicitfast\"/>",
            self.period_s, g[0], g[1], g[2]
        );
        out += "  <worldbody>\n";
        for (j, (joint, drive)) in self.arm.joints.iter().zip(&self.drives).enumerate() {
            self.body(&mut out, j, joint, drive);
        }
        for j in (0..self.drives.len()).rev() {
            let _ = writeln!(out, "{}</body>", "  ".repeat(j + 2));
        }
        out += "  </worldbody>\n";
        if !self.tendons.is_empty() {
            out += "  <tendon>\n";
            for t in &self.tendons {
                let [a, b] = t.joints.map(|j| escaped(&self.arm.joints[j].name));
                let _ = writeln!(
                    out,
                    "    <fixed name=\"{a}+{b}\" armature=\"{:?}\" damping=\"{:?}\" frictionloss=\"{:?}\">\n      <joint joint=\"{a}\" \
                     coef=\"1\"/>\n      <joint joint=\"{b}\" coef=\"1\"/>\n    </fixed>",
                    t.armature, t.damping, t.frictionloss
                );
            }
            out += "  </tendon>\n";
        }
        out += "  <actuator>\n";
        for (joint, d) in self.arm.joints.iter().zip(&self.drives) {
            let name = escaped(&joint.name);
            let _ = write!(out, "    <general name=\"{name}\" joint=\"{name}\" gainprm=\"{:?}\"", d.gain);
            if d.bias != 0.0 {
                let _ = write!(out, " biastype=\"affine\" biasprm=\"{:?} 0 0\"", d.bias);
            }
            if d.limit.is_finite() {
                let _ = write!(out, " ctrllimited=\"true\" ctrlrange=\"{:?} {:?}\"", -d.limit, d.limit);
            }
            if d.lag > 0.0 {
                let _ = write!(out, " dyntype=\"filter\" dynprm=\"{:?}\"", d.lag);
            }
            if d.delay > 0.0 {
                // Room for every step of the delay.
                let samples = (d.delay / self.period_s).ceil() as usize + 1;
                let _ = write!(out, " delay=\"{:?}\" nsample=\"{samples}\"", d.delay);
            }
            out += "/>\n";
        }
        out + "  </actuator>\n</mujoco>\n"
    }

    /// What in the file MuJoCo 3 does not read.
    fn version_note(&self) -> &'static str {
        let (damping, delay) =
            (self.drives.iter().any(MjcfDrive::has_nonlinear_damping), self.drives.iter().any(|d| d.delay > 0.0));
        match (damping, delay) {
            (false, false) => "",
            (true, false) => "; needs MuJoCo 4 for damping with several coefficients",
            (false, true) => "; needs MuJoCo 4 for delay",
            (true, true) => "; needs MuJoCo 4 for damping with several coefficients and for delay",
        }
    }

    fn body(&self, out: &mut String, j: usize, joint: &Joint, d: &MjcfDrive) {
        let indent = "  ".repeat(j + 2);
        let (p, a) = (joint.translation, joint.axis);
        let [w, x, y, z] = quaternion(&joint.rotation);
        let link = escaped(&joint.link);
        let _ = writeln!(
            out,
            "{indent}<body name=\"{link}\" pos=\"{:?} {:?} {:?}\" quat=\"{w:?} {x:?} {y:?} {z:?}\">",
            p[0], p[1], p[2]
        );
        let kind = if joint.kind == JointKind::Prismatic { "slide" } else { "hinge" };
        let name = escaped(&joint.name);
        let _ = write!(
            out,
            "{indent}  <joint name=\"{name}\" type=\"{kind}\" axis=\"{:?} {:?} {:?}\" armature=\"{:?}\" damping=\"{:?}",
            a[0], a[1], a[2], d.armature, d.damping[0]
        );
        if d.has_nonlinear_damping() {
            let _ = write!(out, " {:?} {:?}", d.damping[1], d.damping[2]);
        }
        let _ = write!(out, "\" frictionloss=\"{:?}\"", d.frictionloss);
        if d.stiffness != 0.0 {
            let _ = write!(out, " stiffness=\"{:?}\"", d.stiffness);
        }
        if d.zero != 0.0 {
            let _ = write!(out, " ref=\"{:?}\"", d.zero);
        }
        if joint.lower.is_finite() && joint.upper.is_finite() {
            let _ = write!(out, " range=\"{:?} {:?}\"", joint.lower, joint.upper);
        }
        out.push_str("/>\n");
        let (mass, c, i) = com_from_body(&self.arm.links[j]);
        let _ = writeln!(
            out,
            "{indent}  <inertial pos=\"{:?} {:?} {:?}\" mass=\"{mass:?}\" fullinertia=\"{:?} {:?} {:?} {:?} {:?} {:?}\"/>",
            c[0], c[1], c[2], i[0][0], i[1][1], i[2][2], i[0][1], i[0][2], i[1][2]
        );
    }

    /// Reads a text that [`text`](Self::text) wrote. What MuJoCo's format has beside that is not read.
    ///
    /// # Errors
    /// [`MjcfError`].
    pub fn read(text: &str) -> Result<Mjcf, MjcfError> {
        crate::xml_limits::ensure_bounded(text)?;
        let mut reader = Reader::from_str(text);
        let mut found = Mjcf {
            arm: Arm { name: String::new(), joints: Vec::new(), links: Vec::new(), gravity: [0.0; 3] },
            period_s: 0.0,
            drives: Vec::new(),
            tendons: Vec::new(),
        };
        loop {
            match reader.read_event().map_err(|why| MjcfError::Xml(why.to_string()))? {
                Event::Eof if found.drives.is_empty() => return Err(MjcfError::NoJoints),
                Event::Eof => return Ok(found),
                Event::Start(tag) | Event::Empty(tag) => found.element(&tag)?,
                _ => {}
            }
        }
    }

    fn element(&mut self, tag: &BytesStart<'_>) -> Result<(), MjcfError> {
        let element = Element::new(tag)?;
        match element.name.as_str() {
            "mujoco" => self.arm.name = element.text("model").unwrap_or_default(),
            "option" => {
                self.period_s = element.numbers::<1>("timestep")?[0];
                self.arm.gravity = element.numbers("gravity")?;
            }
            "body" => {
                self.arm.joints.push(Joint {
                    name: String::new(),
                    kind: JointKind::Revolute,
                    axis: [0.0; 3],
                    rotation: rotation(&element.numbers("quat")?),
                    translation: element.numbers("pos")?,
                    lower: f64::NEG_INFINITY,
                    upper: f64::INFINITY,
                    velocity: f64::INFINITY,
                    effort: f64::INFINITY,
                    link: element.text("name").unwrap_or_default(),
                });
            }
            "joint" if element.text("joint").is_some() => {
                let joint = self.joint_named(&element, "joint")?;
                if let Some(tendon) = self.tendons.last_mut() {
                    tendon.joints = [tendon.joints[1], joint];
                }
            }
            "joint" => {
                let Some(joint) = self.arm.joints.last_mut() else { return Err(MjcfError::NoJoints) };
                joint.name = element.text("name").unwrap_or_default();
                if element.text("type").as_deref() == Some("slide") {
                    joint.kind = JointKind::Prismatic;
                }
                joint.axis = element.numbers("axis")?;
                if element.text("range").is_some() {
                    [joint.lower, joint.upper] = element.numbers("range")?;
                }
                self.drives.push(MjcfDrive {
                    armature: element.numbers::<1>("armature")?[0],
                    damping: element.damping()?,
                    frictionloss: element.numbers::<1>("frictionloss")?[0],
                    stiffness: element.number_or("stiffness", 0.0)?,
                    zero: element.number_or("ref", 0.0)?,
                    gain: 1.0,
                    bias: 0.0,
                    limit: f64::INFINITY,
                    delay: 0.0,
                    lag: 0.0,
                });
            }
            "inertial" => {
                let [xx, yy, zz, xy, xz, yz] = element.numbers("fullinertia")?;
                let inertia = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
                let com = element.numbers("pos")?;
                self.arm.links.push(body_from_com(element.numbers::<1>("mass")?[0], &com, &inertia));
            }
            "fixed" => self.tendons.push(MjcfTendon {
                joints: [0, 0],
                armature: element.numbers::<1>("armature")?[0],
                damping: element.numbers::<1>("damping")?[0],
                frictionloss: element.numbers::<1>("frictionloss")?[0],
            }),
            "general" => {
                let joint = self.joint_named(&element, "joint")?;
                let drive = &mut self.drives[joint];
                drive.gain = element.numbers::<1>("gainprm")?[0];
                if element.text("biasprm").is_some() {
                    drive.bias = element.numbers::<3>("biasprm")?[0];
                }
                if element.text("ctrlrange").is_some() {
                    drive.limit = element.numbers::<2>("ctrlrange")?[1];
                }
                drive.lag = element.number_or("dynprm", 0.0)?;
                drive.delay = element.number_or("delay", 0.0)?;
            }
            _ => {}
        }
        Ok(())
    }

    fn joint_named(&self, element: &Element, attribute: &'static str) -> Result<usize, MjcfError> {
        let name = element.text(attribute).ok_or_else(|| element.lacks(attribute))?;
        self.arm.joints.iter().position(|j| j.name == name).ok_or(MjcfError::UnknownJoint(name))
    }

    /// Torque that the file's arm needs for a motion, as its drives report it \[N·m\]; delay and lag left out, Coulomb
    /// friction with the direction `tanh(v/v0)`. One entry a joint each.
    pub fn torque(&self, ws: &mut Workspace, v0: f64, q: &[f64], qd: &[f64], qdd: &[f64], tau: &mut [f64]) {
        let turned: Vec<f64> = q.iter().zip(&self.drives).map(|(q, d)| q - d.zero).collect();
        inverse_dynamics(&self.arm, &self.arm.links, ws, &turned, qd, qdd, tau);
        for (j, d) in self.drives.iter().enumerate() {
            let v = qd[j];
            let speed = d.damping[0] * v + d.damping[1] * v * v.abs() + d.damping[2] * v * v * v;
            tau[j] += d.armature * qdd[j] + speed + d.frictionloss * friction_sign(v, v0) + d.stiffness * q[j] - d.bias;
        }
        for t in &self.tendons {
            let sum = |x: &[f64]| x[t.joints[0]] + x[t.joints[1]];
            let v = sum(qd);
            let both = t.armature * sum(qdd) + t.damping * v + t.frictionloss * friction_sign(v, v0);
            t.joints.iter().for_each(|j| tau[*j] += both);
        }
        tau.iter_mut().zip(&self.drives).for_each(|(tau, d)| *tau /= d.gain);
    }
}

/// An element's name and attributes.
struct Element {
    name: String,
    attributes: Vec<(String, String)>,
}

impl Element {
    fn new(tag: &BytesStart<'_>) -> Result<Element, MjcfError> {
        let mut attributes = Vec::new();
        for attribute in tag.attributes() {
            let attribute = attribute.map_err(|why| MjcfError::Xml(why.to_string()))?;
            let value = quick_xml::escape::unescape(&attribute.value)
                .map_err(|why| MjcfError::Xml(why.to_string()))?
                .into_owned();
            attributes.push((attribute.key.as_ref().to_owned(), value));
        }
        Ok(Element { name: tag.name().as_ref().to_owned(), attributes })
    }

    fn text(&self, attribute: &str) -> Option<String> {
        self.attributes.iter().find(|(name, _)| name == attribute).map(|(_, value)| value.clone())
    }

    fn lacks(&self, attribute: &'static str) -> MjcfError {
        MjcfError::Attribute { element: self.name.clone(), attribute }
    }

    fn numbers<const N: usize>(&self, attribute: &'static str) -> Result<[f64; N], MjcfError> {
        let text = self.text(attribute).ok_or_else(|| self.lacks(attribute))?;
        let numbers: Result<Vec<f64>, _> = text.split_whitespace().map(str::parse).collect();
        numbers.ok().and_then(|n| n.try_into().ok()).ok_or_else(|| self.lacks(attribute))
    }

    /// One coefficient (MuJoCo 3) or three.
    fn damping(&self) -> Result<[f64; 3], MjcfError> {
        let single = self.numbers::<1>("damping").map(|[linear]| [linear, 0.0, 0.0]);
        single.or_else(|_| self.numbers::<3>("damping"))
    }

    fn number_or(&self, attribute: &'static str, default: f64) -> Result<f64, MjcfError> {
        if self.text(attribute).is_none() { Ok(default) } else { Ok(self.numbers::<1>(attribute)?[0]) }
    }
}

pub(crate) fn escaped(text: &str) -> String {
    quick_xml::escape::escape(text).into_owned()
}

/// Unit quaternion `[w, x, y, z]` of a rotation (Shepperd 1978: the largest of the four first).
fn quaternion(r: &Mat3) -> [f64; 4] {
    let trace = r[0][0] + r[1][1] + r[2][2];
    let squares = [trace, r[0][0], r[1][1], r[2][2]];
    let largest = (0..4).max_by(|a, b| squares[*a].total_cmp(&squares[*b])).unwrap_or(0);
    let q = if largest == 0 {
        [1.0 + trace, r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]]
    } else {
        let i = largest - 1;
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        let mut q = [0.0; 4];
        q[0] = r[k][j] - r[j][k];
        q[1 + i] = 1.0 + r[i][i] - r[j][j] - r[k][k];
        q[1 + j] = r[j][i] + r[i][j];
        q[1 + k] = r[k][i] + r[i][k];
        q
    };
    let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    q.map(|x| x / norm)
}

fn rotation([w, x, y, z]: &[f64; 4]) -> Mat3 {
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

impl MjcfDrive {
    /// Whether damping has a term of second or third order in speed.
    fn has_nonlinear_damping(&self) -> bool {
        self.damping[1] != 0.0 || self.damping[2] != 0.0
    }

    /// A drive that only gives its torque.
    pub fn plain(limit: f64) -> MjcfDrive {
        MjcfDrive {
            armature: 0.0,
            damping: [0.0; 3],
            frictionloss: 0.0,
            stiffness: 0.0,
            zero: 0.0,
            gain: 1.0,
            bias: 0.0,
            limit,
            delay: 0.0,
            lag: 0.0,
        }
    }
}
