//! Ways in which a log may have to be read otherwise than the contract says.

use crate::priors::{POSITION_UNITS, SLIGHT_DELAY_S, TORQUE_UNITS};

/// One joint (from 0) or all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Of {
    /// One joint.
    Joint(usize),
    /// All joints.
    All,
}

/// What two joints have in each other's columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Columns {
    /// Torques.
    Torques,
    /// Positions.
    Positions,
    /// Both.
    Both,
}

/// A fault of a log's channels.
#[derive(Clone, Debug, PartialEq)]
pub enum Fault {
    /// Torque with the other sign.
    TorqueSign(Of),
    /// Position with the other sign.
    PositionSign(Of),
    /// Position and torque with the other sign: the joint counts the other way round.
    Reversed(usize),
    /// Positions in a unit, from 0 in [`POSITION_UNITS`].
    PositionUnit(Of, usize),
    /// All torques in a unit, from 0 in [`TORQUE_UNITS`].
    TorqueUnit(usize),
    /// The torque of a joint has to be multiplied by this.
    TorqueScale(usize, f64),
    /// Each torque has to be multiplied by its own factor: currents, shares of a rated torque.
    TorqueScales(Vec<f64>),
    /// Columns of two joints exchanged.
    Exchanged(usize, usize, Columns),
    /// Joints counted from the flange.
    BackToFront,
    /// Torque without that of gravity.
    WithoutGravity,
    /// Torque that a driver ascribes to forces from outside: the measured one without that of the driver's model of the arm.
    External,
    /// Gravity in base axes \[m/s²\].
    Mounting([f64; 3]),
    /// The zero of a joint is elsewhere: add this \[rad\].
    JointZero(usize, f64),
    /// Torque comes late by this \[s\].
    Late(Of, f64),
    /// Torque without its sign.
    Unsigned(Of),
    /// Torque of a joint (from 0) is what a controller asked for; the drive gives no more than this \[N m\].
    BeyondLimit(usize, f64),
}

/// Torque of the file's model that a driver has subtracted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Missing {
    /// None of it.
    Nothing,
    /// That of gravity.
    Gravity,
    /// All of it.
    Model,
}

/// How the columns of a log become motion and torque of the model's joints.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct View {
    pub(crate) motion: MotionView,
    pub(crate) torque_column: Vec<usize>,
    pub(crate) torque_factor: Vec<f64>,
    /// Delay of each joint's torque \[s\].
    pub(crate) delay_s: Vec<f64>,
    pub(crate) unsigned: Vec<bool>,
    /// Values of the arm whose torque gives unsigned torques their sign; empty: those of the file.
    pub(crate) sign_values: Vec<f64>,
    /// What of the file's model is missing from the torque.
    pub(crate) missing: Missing,
    /// Largest torque that each drive gives \[N m\]; infinite where the log says what it gave.
    pub(crate) ceiling: Vec<f64>,
}

/// The part of a view that the regressor depends on.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct MotionView {
    pub(crate) column: Vec<usize>,
    pub(crate) factor: Vec<f64>,
    pub(crate) shift: Vec<f64>,
    /// None: the file's.
    pub(crate) gravity: Option<[f64; 3]>,
}

impl View {
    /// The log as it is.
    pub(crate) fn new(joints: usize) -> View {
        let motion = MotionView {
            column: (0..joints).collect(),
            factor: vec![1.0; joints],
            shift: vec![0.0; joints],
            gravity: None,
        };
        View {
            motion,
            torque_column: (0..joints).collect(),
            torque_factor: vec![1.0; joints],
            delay_s: vec![0.0; joints],
            unsigned: vec![false; joints],
            sign_values: Vec::new(),
            missing: Missing::Nothing,
            ceiling: vec![f64::INFINITY; joints],
        }
    }

    /// The same with one fault more.
    pub(crate) fn with(&self, fault: &Fault) -> View {
        let mut view = self.clone();
        let joints = view.torque_column.len();
        let of = |of: Of| match of {
            Of::Joint(j) => j..j + 1,
            Of::All => 0..joints,
        };
        match fault {
            Fault::TorqueSign(which) => view.torque_factor[of(*which)].iter_mut().for_each(|f| *f = -*f),
            Fault::PositionSign(which) => view.motion.factor[of(*which)].iter_mut().for_each(|f| *f = -*f),
            Fault::Reversed(j) => {
                view.motion.factor[*j] *= -1.0;
                view.torque_factor[*j] *= -1.0;
            }
            Fault::PositionUnit(which, unit) => {
                view.motion.factor[of(*which)].iter_mut().for_each(|f| *f *= POSITION_UNITS[*unit].0);
            }
            Fault::TorqueUnit(unit) => view.torque_factor.iter_mut().for_each(|f| *f *= TORQUE_UNITS[*unit].0),
            Fault::TorqueScale(j, factor) => view.torque_factor[*j] *= factor,
            Fault::TorqueScales(factors) => {
                view.torque_factor.iter_mut().zip(factors).for_each(|(f, factor)| *f *= factor);
            }
            Fault::Exchanged(a, b, columns) => {
                if *columns != Columns::Positions {
                    view.torque_column.swap(*a, *b);
                    view.delay_s.swap(*a, *b);
                }
                if *columns != Columns::Torques {
                    view.motion.column.swap(*a, *b);
                }
            }
            Fault::BackToFront => {
                view.torque_column.reverse();
                view.motion.column.reverse();
            }
            Fault::WithoutGravity => view.motion.gravity = Some([0.0; 3]),
            Fault::External => view.missing = Missing::Model,
            Fault::Mounting(gravity) => view.motion.gravity = Some(*gravity),
            Fault::JointZero(j, angle) => view.motion.shift[*j] += angle,
            Fault::Late(which, seconds) => view.delay_s[of(*which)].fill(*seconds),
            Fault::Unsigned(which) => view.unsigned[of(*which)].fill(true),
            Fault::BeyondLimit(j, limit) => view.ceiling[*j] = *limit,
        }
        view
    }
}

impl Fault {
    /// The name in reports.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Fault::TorqueSign(_) => "torque_sign",
            Fault::PositionSign(_) => "position_sign",
            Fault::Reversed(_) => "joint_reversed",
            Fault::PositionUnit(..) => "position_unit",
            Fault::TorqueUnit(_) | Fault::TorqueScale(..) => "torque_unit",
            Fault::TorqueScales(_) => "torque_unit_per_joint",
            Fault::Exchanged(_, _, Columns::Torques) => "torque_exchanged",
            Fault::Exchanged(_, _, Columns::Positions) => "positions_exchanged",
            Fault::Exchanged(_, _, Columns::Both) => "joints_exchanged",
            Fault::BackToFront => "joints_back_to_front",
            Fault::WithoutGravity => "torque_without_gravity",
            Fault::External => "external_torque",
            Fault::Mounting(_) => "mounting",
            Fault::JointZero(..) => "joint_zero",
            Fault::Late(..) => "torque_late",
            Fault::Unsigned(_) => "torque_unsigned",
            Fault::BeyondLimit(..) => "torque_beyond_limit",
        }
    }

    /// Whether it is the same fault of the same channels, whatever its delay or factor is.
    #[must_use]
    pub fn is_alike(&self, other: &Fault) -> bool {
        match (self, other) {
            (Fault::Late(a, _), Fault::Late(b, _)) => a == b,
            (Fault::TorqueScale(a, _), Fault::TorqueScale(b, _))
            | (Fault::BeyondLimit(a, _), Fault::BeyondLimit(b, _)) => a == b,
            (Fault::TorqueScales(_), Fault::TorqueScales(_)) => true,
            _ => self == other,
        }
    }

    /// The joints (from 0) it is about; empty where it is all.
    #[must_use]
    pub fn joints(&self) -> Vec<usize> {
        match self {
            Fault::TorqueSign(Of::Joint(j))
            | Fault::PositionSign(Of::Joint(j))
            | Fault::Reversed(j)
            | Fault::PositionUnit(Of::Joint(j), _)
            | Fault::TorqueScale(j, _)
            | Fault::JointZero(j, _)
            | Fault::Late(Of::Joint(j), _)
            | Fault::BeyondLimit(j, _)
            | Fault::Unsigned(Of::Joint(j)) => vec![*j],
            Fault::Exchanged(a, b, _) => vec![*a, *b],
            _ => Vec::new(),
        }
    }

    /// Whether only torques of single joints are wrong: without them the rest of the log is right.
    #[must_use]
    pub fn is_of_torque_alone(&self) -> bool {
        matches!(
            self,
            Fault::TorqueSign(Of::Joint(_))
                | Fault::TorqueScale(..)
                | Fault::Exchanged(_, _, Columns::Torques)
                | Fault::Unsigned(Of::Joint(_))
                | Fault::Late(Of::Joint(_), _)
                | Fault::BeyondLimit(..)
        )
    }

    /// Whether analyses deal with it by themselves, so that it is no other meaning of a channel: a delay of about a sample.
    #[must_use]
    pub fn is_slight(&self) -> bool {
        matches!(self, Fault::Late(_, seconds) if *seconds <= SLIGHT_DELAY_S)
    }

    /// Effects of a model that predict the same: with one of them in the model, the log may stay as it is. Empty where none does.
    #[must_use]
    pub fn effects(&self) -> &'static [&'static str] {
        match self {
            Fault::JointZero(..) => &["encoder_offset"],
            Fault::Mounting(_) => &["gravity_direction"],
            Fault::Late(..) => &["transport_delay", "current_loop_lag"],
            _ => &[],
        }
    }

    /// What it is, for people: `[what, what to do]`.
    pub(crate) fn words(&self, names: &[String]) -> [String; 2] {
        let columns = |what: &str, of: Of| match of {
            Of::Joint(j) => format!("{what}{} ({})", j + 1, names[j]),
            Of::All => format!("{what}1..{}", names.len()),
        };
        match self {
            Fault::TorqueSign(of) => {
                let column = columns("tau", *of);
                [format!("{column} with the other sign"), format!("multiply {column} by -1")]
            }
            Fault::PositionSign(of) => {
                let column = columns("q", *of);
                [format!("{column} with the other sign"), format!("multiply {column} by -1")]
            }
            Fault::Reversed(j) => {
                [format!("{} counts the other way round", names[*j]), format!("multiply q{0} and tau{0} by -1", j + 1)]
            }
            Fault::PositionUnit(of, unit) => {
                let ((factor, name), column) = (POSITION_UNITS[*unit], columns("q", *of));
                [format!("{column} {name}"), format!("positions are in radians: multiply {column} by {factor:.6}")]
            }
            Fault::TorqueUnit(unit) => {
                let ((factor, name), column) = (TORQUE_UNITS[*unit], columns("tau", Of::All));
                [format!("{column} {name}"), format!("torques are in N m at the joint: multiply {column} by {factor}")]
            }
            Fault::TorqueScale(j, factor) => {
                let column = columns("tau", Of::Joint(*j));
                let what = format!("{column} in another unit or scale (true torque is {factor:.3} times)");
                [what, format!("check unit, gain and gear ratio of {column}; torques are in N m at the joint")]
            }
            Fault::TorqueScales(factors) => {
                let factors: Vec<String> = factors.iter().map(|f| format!("{f:.3}")).collect();
                let what = format!("{} in a unit of each joint's own (currents, per mille)", columns("tau", Of::All));
                let mend = "name currents current1..N with drive_gain in robot.toml, or multiply the columns by about";
                [what, format!("{mend} {}", factors.join(" "))]
            }
            Fault::Exchanged(a, b, of) => {
                let name = match of {
                    Columns::Torques => "torques",
                    Columns::Positions => "positions",
                    Columns::Both => "columns",
                };
                let what = format!("{name} of {} and {} in each other's place", names[*a], names[*b]);
                [what, format!("exchange the {name} {} and {}", a + 1, b + 1)]
            }
            Fault::BackToFront => {
                ["joints counted from the flange to the base".to_owned(), "number the columns from the base".to_owned()]
            }
            Fault::WithoutGravity => [
                "torque without that of gravity".to_owned(),
                "set [log] torque_is = \"gravity_free\", or log the whole torque".to_owned(),
            ],
            Fault::External => [
                "torque of forces from outside: that of the arm is subtracted".to_owned(),
                "log the measured torque or current".to_owned(),
            ],
            Fault::Mounting(g) => {
                let g: Vec<String> = g.iter().map(|g| format!("{g:.2}")).collect();
                let g = g.join(", ");
                [format!("gravity along [{g}] in base axes"), format!("set gravity = [{g}] in robot.toml")]
            }
            Fault::JointZero(j, angle) => {
                let text = format!("{:+.0} deg added to q{} ({})", angle.to_degrees(), j + 1, names[*j]);
                [text, format!("set joint_zero of joint {} to {angle:.4} rad more in [log] of robot.toml", j + 1)]
            }
            Fault::Late(of, seconds) => {
                let column = columns("tau", *of);
                let what = format!("{column} about {:.0} ms later than its motion", 1e3 * seconds);
                [what, format!("stamp {column} by the clock of the positions, or shift it by that time")]
            }
            Fault::Unsigned(of) => {
                let column = columns("tau", *of);
                [format!("{column} without its sign"), format!("log {column} with its sign")]
            }
            Fault::BeyondLimit(j, limit) => {
                let column = columns("tau", Of::Joint(*j));
                let what = format!("{column} as commanded, beyond the {limit:.0} N m that the drive gives");
                [what, format!("log {column} as the drive gives it")]
            }
        }
    }
}
