//! Groups of columns whose names differ by the joint alone.

use std::collections::BTreeMap;

use crate::columns::Group;
use crate::guess;
use crate::listing::{Column, Listing};
use crate::units::split_unit;

/// What stands for the joint in a pattern: its name in the URDF, its number from 0 or from 1.
pub(crate) const JOINT: &str = "{joint}";
pub(crate) const NUMBER: &str = "{i}";
/// Most digits of a joint's number.
const MAX_DIGITS: usize = 3;

/// Columns of one quantity, one a joint.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Family {
    pub(crate) pattern: String,
    /// Columns of the listing, base to flange.
    pub(crate) columns: Vec<usize>,
    pub(crate) group: Option<Group>,
}

/// Every group of columns that has all joints. `joints`: their names, empty where they are unknown; `count`: their number.
pub(crate) fn families(listing: &Listing, joints: &[String], count: usize) -> Vec<Family> {
    let by_name = named(listing, joints);
    let numbered = numbered(listing);
    let mut found: Vec<Family> = Vec::new();
    for (pattern, members) in by_name {
        let columns: Option<Vec<usize>> = (0..count).map(|joint| members.get(&joint).copied()).collect();
        if let Some(columns) = columns.filter(|_| !joints.is_empty()) {
            found.push(Family { group: group(&pattern), pattern, columns });
        }
    }
    let numeric = |columns: &[usize]| columns.iter().all(|k| listing.columns[*k].text.is_none());
    found.retain(|family| numeric(&family.columns));
    for (pattern, members) in &numbered {
        let columns = order_by_text(listing, joints, &numbered, pattern, members).or_else(|| in_order(members, count));
        if let Some(columns) = columns.filter(|columns| numeric(columns))
            && !found.iter().any(|other| other.columns == columns)
        {
            found.push(Family { group: group(pattern), pattern: pattern.clone(), columns });
        }
    }
    found
}

/// Columns by pattern and joint.
type Groups = BTreeMap<String, BTreeMap<usize, usize>>;

fn named(listing: &Listing, joints: &[String]) -> Groups {
    let mut groups = Groups::new();
    for (k, column) in listing.columns.iter().enumerate() {
        let name = split_unit(&column.name).0;
        // The longest name wins: `arm_joint_1` is no `joint_1`.
        let longest = joints.iter().enumerate().filter_map(|(j, joint)| Some((j, joint, place(name, joint)?)));
        if let Some((j, joint, at)) = longest.max_by_key(|(_, joint, _)| joint.len()) {
            let pattern = format!("{}{JOINT}{}", &name[..at], &name[at + joint.len()..]);
            groups.entry(pattern).or_default().entry(j).or_insert(k);
        }
    }
    groups
}

/// Where a joint's name stands in a column's name: not within a word on its left, and with nothing of a word on its right but `_`
/// and what follows.
fn place(name: &str, joint: &str) -> Option<usize> {
    let ends = |at: usize| {
        let before = name[..at].chars().next_back();
        let behind = name[at + joint.len()..].chars().next();
        before.is_none_or(|c| !c.is_alphanumeric()) && behind.is_none_or(|c| !c.is_alphanumeric())
    };
    if joint.is_empty() {
        return None;
    }
    name.match_indices(joint).map(|(at, _)| at).filter(|at| ends(*at)).last()
}

fn numbered(listing: &Listing) -> Groups {
    let mut groups = Groups::new();
    for (k, column) in listing.columns.iter().enumerate() {
        let name = split_unit(&column.name).0;
        for (from, to) in digits(name) {
            if let Ok(number) = name[from..to].parse::<usize>() {
                let pattern = format!("{}{NUMBER}{}", &name[..from], &name[to..]);
                groups.entry(pattern).or_default().entry(number).or_insert(k);
            }
        }
    }
    groups
}

/// Runs of digits.
fn digits(name: &str) -> Vec<(usize, usize)> {
    let bytes = name.as_bytes();
    let mut runs = Vec::new();
    let mut from = None;
    for k in 0..=bytes.len() {
        match (from, bytes.get(k).is_some_and(u8::is_ascii_digit)) {
            (None, true) => from = Some(k),
            (Some(start), false) => {
                if k - start <= MAX_DIGITS {
                    runs.push((start, k));
                }
                from = None;
            }
            _ => {}
        }
    }
    runs
}

/// Columns numbered from 0 or from 1, and no other.
fn in_order(members: &BTreeMap<usize, usize>, count: usize) -> Option<Vec<usize>> {
    let first = *members.keys().next()?;
    let last = *members.keys().next_back()?;
    let is_all = members.len() == count && first <= 1 && last + 1 - first == count;
    is_all.then(|| members.values().copied().collect())
}

/// Columns in the order of the joints, where columns of text beside them hold the joints' names (`field.name0`, `field.position0`).
fn order_by_text(
    listing: &Listing,
    joints: &[String],
    groups: &Groups,
    pattern: &str,
    members: &BTreeMap<usize, usize>,
) -> Option<Vec<usize>> {
    let stem = stem(pattern)?;
    let text = |column: &usize| listing.columns[*column].text.as_deref();
    let names = groups.iter().filter(|(other, _)| self::stem(other) == Some(stem)).map(|(_, names)| names);
    let mut places = names.filter_map(|names| {
        let place =
            |joint: &String| names.iter().find(|(_, column)| text(column) == Some(joint)).map(|(number, _)| *number);
        joints.iter().map(place).collect::<Option<Vec<usize>>>().filter(|places| !places.is_empty())
    });
    let places = places.next_back()?;
    places.iter().map(|number| members.get(number).copied()).collect()
}

/// What stands before the last part of a numbered name.
fn stem(pattern: &str) -> Option<&str> {
    pattern.split(NUMBER).next()?.rsplit_once(['.', '/']).map(|(stem, _)| stem)
}

/// Names of channels that say what they are, as the drivers of Universal Robots (RTDE), Franka (libfranka) and rivet write them.
const CHANNELS: &[(&str, Option<Group>)] = &[
    ("q", Some(Group::Position)),
    ("qd", Some(Group::Velocity)),
    ("tau", Some(Group::Torque)),
    ("current", Some(Group::Current)),
    ("temperature", Some(Group::Temperature)),
    ("q_des", Some(Group::DesiredPosition)),
    ("qd_des", Some(Group::DesiredVelocity)),
    ("qdd_des", Some(Group::DesiredAcceleration)),
    ("q_link", None),
    ("tau_des", None),
    ("tau_ff", None),
    ("actual_q", Some(Group::Position)),
    ("actual_qd", Some(Group::Velocity)),
    ("target_q", Some(Group::DesiredPosition)),
    ("target_qd", Some(Group::DesiredVelocity)),
    ("target_qdd", Some(Group::DesiredAcceleration)),
    ("actual_current", Some(Group::Current)),
    ("actual_current_as_torque", Some(Group::Torque)),
    ("target_current", None),
    ("actual_current_window", None),
    ("target_moment", None),
    ("joint_control_output", None),
    ("joint_temperatures", Some(Group::Temperature)),
    ("dq", Some(Group::Velocity)),
    ("q_d", Some(Group::DesiredPosition)),
    ("dq_d", Some(Group::DesiredVelocity)),
    ("ddq_d", Some(Group::DesiredAcceleration)),
    ("tau_j", Some(Group::Torque)),
    ("tau_j_d", None),
    ("dtau_j", None),
    ("tau_ext_hat_filtered", None),
    ("theta", None),
    ("dtheta", None),
];

/// Words of channels that are commanded and not measured.
const DESIRED: &[&str] = &[
    "des",
    "desired",
    "command",
    "commanded",
    "commands",
    "cmd",
    "reference",
    "ref",
    "goal",
    "setpoint",
    "target",
    "action",
];
/// Words of channels that are none of the quantities.
const OTHERS: &[&str] = &["error", "err", "voltage", "limit", "limits", "external", "ext", "window"];

/// What a pattern's name says that it is.
pub(crate) fn group(pattern: &str) -> Option<Group> {
    let bare = pattern.replace(JOINT, "").replace(NUMBER, "").to_lowercase();
    let part = bare.rsplit(['/', '.']).find(|part| part.chars().any(char::is_alphabetic)).unwrap_or("");
    let part = part.trim_matches(|c: char| !c.is_alphanumeric());
    if let Some((_, group)) = CHANNELS.iter().find(|(name, _)| *name == part) {
        return *group;
    }
    let has = |words: &[&str]| bare.split(|c: char| !c.is_alphanumeric()).any(|word| words.contains(&word));
    if has(OTHERS) {
        return None;
    }
    let is_desired = has(DESIRED);
    if has(&["temperature", "temperatures", "temp"]) {
        return Some(Group::Temperature).filter(|_| !is_desired);
    }
    if has(&["acceleration", "accelerations", "accel"]) {
        return Some(Group::DesiredAcceleration).filter(|_| is_desired);
    }
    match (guess::word(part), is_desired) {
        (Some("positions"), false) => Some(Group::Position),
        (Some("positions"), true) => Some(Group::DesiredPosition),
        (Some("velocities"), false) => Some(Group::Velocity),
        (Some("velocities"), true) => Some(Group::DesiredVelocity),
        (Some("torques"), false) => Some(Group::Torque),
        (Some("currents"), false) => Some(Group::Current),
        // The vectors of a LeRobot data set, where their entries carry the joints' names alone.
        (None, false) if part == "state" && bare.contains("observation") => Some(Group::Position),
        (None, true) if part == "action" => Some(Group::DesiredPosition),
        _ => None,
    }
}

/// Whether a column may be time.
pub(crate) fn is_time(column: &Column) -> bool {
    column.text.is_none() && guess::word(split_unit(&column.name).0) == Some("time")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn listing(columns: &[&str]) -> Listing {
        let column = |name: &&str| Column { name: (*name).to_owned(), ..Column::default() };
        Listing { columns: columns.iter().map(column).collect(), ..Listing::default() }
    }

    fn joints(names: &[&str]) -> Vec<String> {
        names.iter().map(|name| (*name).to_owned()).collect()
    }

    #[test]
    fn names_decide_the_order_of_the_joints() {
        let columns = ["/js/elbow/position", "/js/base/position", "/js/gripper/position", "/js/elbow/effort"];
        let found = families(&listing(&columns), &joints(&["base", "elbow"]), 2);
        let wanted =
            Family { pattern: "/js/{joint}/position".into(), columns: vec![1, 0], group: Some(Group::Position) };
        assert_eq!(found, [wanted]);
    }

    #[test]
    fn prefixes_and_longer_names_are_kept_apart() {
        let columns = ["l_joint_1.q", "l_joint_10.q", "r_joint_1.q", "r_joint_10.q"];
        let found = families(&listing(&columns), &joints(&["joint_1", "joint_10"]), 2);
        let patterns: Vec<&str> = found.iter().map(|f| f.pattern.as_str()).collect();
        assert_eq!(patterns, ["l_{joint}.q", "r_{joint}.q"]);
        assert_eq!(found[0].columns, [0, 1]);
    }

    #[test]
    fn numbers_count_from_zero_or_one_and_have_to_be_all() {
        let of =
            |columns: &[&str]| families(&listing(columns), &[], 2).into_iter().map(|f| f.columns).collect::<Vec<_>>();
        assert_eq!(of(&["q[1]", "q[0]"]), [[1, 0]]);
        assert_eq!(of(&["Q1", "Q2"]), [[0, 1]]);
        assert!(of(&["q0", "q1", "q2"]).is_empty());
        assert!(of(&["q2", "q3"]).is_empty());
    }

    #[test]
    fn columns_of_text_give_the_order() {
        let mut of = listing(&["f.name0", "f.name1", "f.position0", "f.position1"]);
        for (k, name) in ["elbow", "base"].into_iter().enumerate() {
            of.columns[k].text = Some(name.to_owned());
        }
        let found = families(&of, &joints(&["base", "elbow"]), 2);
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!(found[0].columns, [3, 2]);
    }

    #[test]
    fn names_of_drivers_say_what_they_are() {
        for (pattern, expected) in [
            ("actual_q_{i}", Some(Group::Position)),
            ("target_q_{i}", Some(Group::DesiredPosition)),
            ("actual_current_{i}", Some(Group::Current)),
            ("target_moment_{i}", None),
            ("robot_state.q_d[{i}]", Some(Group::DesiredPosition)),
            ("robot_state.tau_J[{i}]", Some(Group::Torque)),
            ("robot_state.tau_J_d[{i}]", None),
            ("robot_state.tau_ext_hat_filtered[{i}]", None),
            ("robot_state.dq[{i}]", Some(Group::Velocity)),
            ("/joint_states/{joint}/effort", Some(Group::Torque)),
            ("/desired/{joint}/position", Some(Group::DesiredPosition)),
            ("observation.state[{i}]", Some(Group::Position)),
            ("observation.state/{joint}.pos", Some(Group::Position)),
            ("action/{joint}.pos", Some(Group::DesiredPosition)),
            ("TAU{i}", Some(Group::Torque)),
            ("Axis {i} torque", Some(Group::Torque)),
            ("joint{i}/temperature", Some(Group::Temperature)),
        ] {
            assert_eq!(group(pattern), expected, "{pattern}");
        }
    }
}
