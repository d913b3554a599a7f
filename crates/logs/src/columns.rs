//! Column names of the contract, and the raw numbers of a file before they are checked.

use std::collections::BTreeMap;

use crate::units::Quantity;

/// A group of columns, one a joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Group {
    Position,
    Torque,
    Current,
    Velocity,
    DesiredPosition,
    DesiredVelocity,
    DesiredAcceleration,
    Temperature,
    LinkPosition,
}

impl Group {
    pub(crate) const ALL: [Group; 9] = [
        Group::Position,
        Group::Torque,
        Group::Current,
        Group::Velocity,
        Group::DesiredPosition,
        Group::DesiredVelocity,
        Group::DesiredAcceleration,
        Group::Temperature,
        Group::LinkPosition,
    ];

    /// What it measures.
    pub(crate) fn quantity(self) -> Quantity {
        match self {
            Group::Position | Group::DesiredPosition | Group::LinkPosition => Quantity::Position,
            Group::Torque => Quantity::Torque,
            Group::Current => Quantity::Current,
            Group::Velocity | Group::DesiredVelocity => Quantity::Velocity,
            Group::DesiredAcceleration => Quantity::Acceleration,
            Group::Temperature => Quantity::Temperature,
        }
    }

    /// What stands before the joint number in a column's name.
    pub(crate) fn prefix(self) -> &'static str {
        match self {
            Group::Position => "q",
            Group::Torque => "tau",
            Group::Current => "current",
            Group::Velocity => "qd",
            Group::DesiredPosition => "q_des",
            Group::DesiredVelocity => "qd_des",
            Group::DesiredAcceleration => "qdd_des",
            Group::Temperature => "temperature",
            Group::LinkPosition => "q_link",
        }
    }

    /// Name of the column of joint `joint` (from 0).
    pub(crate) fn column(self, joint: usize) -> String {
        format!("{}{}", self.prefix(), joint + 1)
    }

    /// Reads a column's name: its group and joint (from 0).
    pub(crate) fn parse(name: &str) -> Option<(Group, usize)> {
        let digits = name.find(|c: char| c.is_ascii_digit())?;
        let (prefix, number) = name.split_at(digits);
        if number.starts_with('0') {
            return None;
        }
        let joint = number.parse::<usize>().ok()?;
        Group::ALL.into_iter().find(|g| g.prefix() == prefix).map(|g| (g, joint - 1))
    }
}

/// Whether a column is one of the contract and worth decoding.
pub(crate) fn is_known(name: &str) -> bool {
    name == "t" || Group::parse(name).is_some()
}

/// Picks columns by name.
pub(crate) type Wanted<'a> = &'a dyn Fn(&str) -> bool;

/// Whole numbers beyond this have no `f64` of their own: a column that begins with one counts from it.
pub(crate) const EXACT: u64 = 1 << 53;

/// The columns of a file as they stand in it; an empty cell is NaN.
#[derive(Debug, Default)]
pub(crate) struct Table {
    pub(crate) columns: BTreeMap<String, Vec<f64>>,
    /// Names of columns outside the contract, in the order of the file.
    pub(crate) unused: Vec<String>,
    /// What is wrong with the file, although it was read.
    pub(crate) warnings: Vec<String>,
}

impl Table {
    /// Names of all columns, those outside the contract first.
    pub(crate) fn names(&self) -> Vec<String> {
        self.unused.iter().chain(self.columns.keys()).cloned().collect()
    }

    /// The first column that belongs to a joint beyond `joints`.
    pub(crate) fn beyond(&self, joints: usize) -> Option<&str> {
        self.columns
            .keys()
            .find(|name| Group::parse(name).is_some_and(|(_, joint)| joint >= joints))
            .map(String::as_str)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_the_contract_are_known_and_others_are_not() {
        for name in ["t", "q1", "q12", "tau6", "q_des3", "qdd_des7", "q_link2", "temperature1", "current5"] {
            assert!(is_known(name), "{name}");
        }
        for name in ["q", "q0", "q01", "tau_motor1", "time", "qx1", "1", "load_abs", "q1_raw", "tau_ff1"] {
            assert!(!is_known(name), "{name}");
        }
    }
}
