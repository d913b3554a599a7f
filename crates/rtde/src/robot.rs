//! What the outputs of a Universal Robots arm mean.

use std::fmt;

use crate::recipe::{FieldType, Recipe, Values};

/// Joints of such an arm.
pub const JOINTS: usize = 6;

/// Fields that are asked for; which of them a controller knows depends on its software.
pub const CANDIDATES: [&str; 13] = [
    "timestamp",
    "actual_q",
    "target_q",
    "target_qd",
    "target_qdd",
    CONVERTED,
    CURRENT,
    "joint_control_output",
    "target_moment",
    "joint_temperatures",
    "robot_mode",
    "safety_status",
    "safety_mode",
];

/// The measured currents as torques \[N m\], converted by the controller. PolyScope 5.23 and PolyScope X 10.11 or later.
const CONVERTED: &str = "actual_current_as_torque";
/// The measured currents \[A\].
const CURRENT: &str = "actual_current";

/// Where the torque of a joint comes from.
///
/// * `actual_current_as_torque` \[N m\]: measured currents, converted by the controller.
/// * `actual_current` \[A\]: measured currents. The torque is `drive_gain` times that.
///
/// `target_moment` \[N m\] is computed from the controller's model of the arm, and `target_current` from that.
/// `joint_control_output` \[A\] is what the joint's control asks for. None of them is measured, and none is ever used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Torque {
    /// `actual_current_as_torque`.
    Converted,
    /// `actual_current`, times these gains \[N m/A\].
    Current {
        /// Torque of each joint per ampere \[N m/A\].
        gain: [f64; JOINTS],
    },
}

impl Torque {
    /// Chooses the field, from those that the controller knows, the robot file's `drive_gain` and its
    /// `[log] torque_from = "current"`. This is the one place where that is decided.
    ///
    /// # Errors
    /// No field is a measured torque, or the gain for it is missing.
    pub fn choose(known: &Recipe, gain: Option<[f64; JOINTS]>, from_current: bool) -> Result<Torque, NoTorque> {
        let knows = |name| known.type_of(name) == Some(FieldType::Vector6);
        match gain {
            Some(gain) if knows(CURRENT) && (from_current || !knows(CONVERTED)) => Ok(Torque::Current { gain }),
            _ if knows(CONVERTED) => Ok(Torque::Converted),
            _ if knows(CURRENT) => Err(NoTorque::Gain),
            _ => Err(NoTorque::Field),
        }
    }

    /// Name of the field.
    pub fn field(&self) -> &'static str {
        match self {
            Torque::Converted => CONVERTED,
            Torque::Current { .. } => CURRENT,
        }
    }

    /// Torque \[N m\] for the field's value.
    fn torque(&self, value: [f64; JOINTS]) -> [f64; JOINTS] {
        match self {
            Torque::Converted => value,
            Torque::Current { gain } => std::array::from_fn(|j| gain[j] * value[j]),
        }
    }
}

impl fmt::Display for Torque {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Torque::Converted => "actual_current_as_torque [N m], measured currents converted by the controller",
            Torque::Current { .. } => "actual_current [A], measured, times drive_gain of the robot file [N m/A]",
        })
    }
}

/// Why there is no torque.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoTorque {
    /// The controller has currents alone and the robot file has no gain.
    #[error(
        "the controller has currents and no torques (actual_current_as_torque came with PolyScope 5.23 and 10.11), and \
         drive_gain is not set; set [drive] drive_gain (N m/A, one per joint) in the robot file"
    )]
    Gain,
    /// The controller has neither.
    #[error("the controller has neither actual_current_as_torque nor actual_current; update its software")]
    Field,
}

/// A field without which nothing can be published.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the controller does not have the field {0}; it is needed, so update its software")]
pub struct Missing(pub &'static str);

/// Places of the fields in use.
#[derive(Clone, Debug, PartialEq)]
pub struct Fields {
    torque: Torque,
    timestamp: usize,
    q: usize,
    tau: usize,
    plan: Option<[usize; 3]>,
    temperature: Option<usize>,
    robot_mode: Option<usize>,
    safety: Option<usize>,
}

impl Fields {
    /// Names to ask for, given which of [`CANDIDATES`] the controller knows.
    pub fn names(known: &Recipe, torque: &Torque) -> Vec<&'static str> {
        let has = |name: &str| known.type_of(name).is_some();
        let plan = ["target_q", "target_qd", "target_qdd"];
        let mut names = vec!["timestamp", "actual_q", torque.field()];
        if plan.iter().all(|name| has(name)) {
            names.extend(plan);
        }
        names.extend(["joint_temperatures", "robot_mode"].into_iter().filter(|name| has(name)));
        names.extend(["safety_status", "safety_mode"].into_iter().find(|name| has(name)));
        names
    }

    /// Places in the agreed recipe.
    ///
    /// # Errors
    /// A field that is needed is missing, or has another type than in the description.
    pub fn new(recipe: &Recipe, torque: Torque) -> Result<Fields, Missing> {
        let need = |name, of| recipe.place(name, of).ok_or(Missing(name));
        let vector = |name| recipe.place(name, FieldType::Vector6);
        Ok(Fields {
            torque,
            timestamp: need("timestamp", FieldType::Double)?,
            q: need("actual_q", FieldType::Vector6)?,
            tau: need(torque.field(), FieldType::Vector6)?,
            plan: (|| Some([vector("target_q")?, vector("target_qd")?, vector("target_qdd")?]))(),
            temperature: vector("joint_temperatures"),
            robot_mode: recipe.place("robot_mode", FieldType::Int32),
            safety: ["safety_status", "safety_mode"].iter().find_map(|name| recipe.place(name, FieldType::Int32)),
        })
    }

    /// Whether the plan (target positions, velocities and accelerations) is among them.
    pub fn has_plan(&self) -> bool {
        self.plan.is_some()
    }

    /// The values of a data package.
    pub fn read(&self, values: &Values<'_>) -> Reading {
        Reading {
            timestamp_s: values.double(self.timestamp),
            q: values.vector6(self.q),
            tau: self.torque.torque(values.vector6(self.tau)),
            plan: self.plan.map(|places| places.map(|place| values.vector6(place))),
            temperature: self.temperature.map(|place| values.vector6(place)),
            robot_mode: self.robot_mode.map(|place| RobotMode(values.int32(place))),
            safety: self.safety.map(|place| SafetyMode(values.int32(place))),
        }
    }
}

/// One sample of the arm. Joints run from base to flange.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Time since the controller was started \[s\].
    pub timestamp_s: f64,
    /// Measured positions \[rad\].
    pub q: [f64; JOINTS],
    /// Torque of each drive on its joint \[N m\].
    pub tau: [f64; JOINTS],
    /// Target positions \[rad\], velocities \[rad/s\] and accelerations \[rad/s²\].
    pub plan: Option<[[f64; JOINTS]; 3]>,
    /// Temperatures \[degC\].
    pub temperature: Option<[f64; JOINTS]>,
    /// State of the arm.
    pub robot_mode: Option<RobotMode>,
    /// State of the safety system.
    pub safety: Option<SafetyMode>,
}

/// `robot_mode`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RobotMode(pub i32);

impl RobotMode {
    /// The drives are on and the brakes open.
    pub fn is_running(self) -> bool {
        self.0 == 7
    }
}

impl fmt::Display for RobotMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.0 {
            -1 => "no controller",
            0 => "disconnected",
            1 => "confirm safety",
            2 => "booting",
            3 => "power off",
            4 => "power on",
            5 => "idle",
            6 => "backdrive",
            7 => "running",
            8 => "updating firmware",
            other => return write!(f, "mode {other}"),
        })
    }
}

/// `safety_status`, or `safety_mode` of older software.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SafetyMode(pub i32);

impl SafetyMode {
    /// No stop is in force: normal, reduced or recovery.
    pub fn is_free(self) -> bool {
        matches!(self.0, 1 | 2 | 4)
    }
}

impl fmt::Display for SafetyMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.0 {
            1 => "normal",
            2 => "reduced",
            3 => "protective stop",
            4 => "recovery",
            5 => "safeguard stop",
            6 => "system emergency stop",
            7 => "robot emergency stop",
            8 => "violation",
            9 => "fault",
            10 => "validate joint id",
            11 => "undefined",
            12 => "automatic mode safeguard stop",
            13 => "system three-position enabling stop",
            other => return write!(f, "mode {other}"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GAIN: [f64; 6] = [10.0; 6];

    fn known(absent: &[&str]) -> Recipe {
        let types = CANDIDATES.map(|name| match name {
            name if absent.contains(&name) => "NOT_FOUND",
            "timestamp" => "DOUBLE",
            "robot_mode" | "safety_mode" | "safety_status" => "INT32",
            _ => "VECTOR6D",
        });
        Recipe::decode(&CANDIDATES, format!("\u{1}{}", types.join(",")).as_bytes()).expect("sound")
    }

    #[test]
    fn torque_is_a_measured_field_or_none() {
        let choose = |absent: &[&str], gain, from_current| Torque::choose(&known(absent), gain, from_current);
        assert_eq!(choose(&[], None, false), Ok(Torque::Converted));
        assert_eq!(choose(&[], Some(GAIN), false), Ok(Torque::Converted));
        assert_eq!(choose(&[], Some(GAIN), true), Ok(Torque::Current { gain: GAIN }));
        assert_eq!(choose(&[CONVERTED], Some(GAIN), false), Ok(Torque::Current { gain: GAIN }));
        assert_eq!(choose(&[CONVERTED], None, false), Err(NoTorque::Gain));
        // target_moment and joint_control_output are there, and are no measurement.
        assert_eq!(choose(&[CONVERTED, CURRENT], Some(GAIN), false), Err(NoTorque::Field));
    }

    #[test]
    fn only_what_the_controller_knows_is_asked_for() {
        let all = Fields::names(&known(&[]), &Torque::Converted);
        assert!(all.contains(&"safety_status") && !all.contains(&"safety_mode") && !all.contains(&"target_moment"));
        let old = Fields::names(&known(&["safety_status", "target_qdd"]), &Torque::Current { gain: GAIN });
        assert_eq!(old, ["timestamp", "actual_q", "actual_current", "joint_temperatures", "robot_mode", "safety_mode"]);
    }

    #[test]
    fn a_needed_field_of_another_type_is_missing() {
        let names = ["timestamp", "actual_q", CONVERTED];
        let recipe = Recipe::decode(&names, b"\x01DOUBLE,VECTOR3D,VECTOR6D").expect("sound");
        assert_eq!(Fields::new(&recipe, Torque::Converted), Err(Missing("actual_q")));
    }

    #[test]
    fn currents_become_torques() {
        let names = ["timestamp", "actual_q", CURRENT];
        let recipe = Recipe::decode(&names, b"\x01DOUBLE,VECTOR6D,VECTOR6D").expect("sound");
        let fields =
            Fields::new(&recipe, Torque::Current { gain: [1.0, 2.0, 3.0, 4.0, 5.0, -6.0] }).expect("all there");
        let mut payload = vec![1];
        [[0.5_f64; 1].as_slice(), &[0.1; 6], &[2.0; 6]].concat().iter().for_each(|x| payload.extend(x.to_be_bytes()));
        let reading = fields.read(&recipe.values(&payload).expect("sound").expect("of this recipe"));
        assert_eq!((reading.timestamp_s, reading.q), (0.5, [0.1; 6]));
        assert_eq!(reading.tau, [2.0, 4.0, 6.0, 8.0, 10.0, -12.0]);
        assert_eq!((reading.plan, reading.temperature, reading.robot_mode), (None, None, None));
    }
}
