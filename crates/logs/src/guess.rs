//! What the columns of a file that is no log yet may be: for the message that refuses it.

use crate::columns::is_known;

/// Names that are listed of each kind.
const MOST_LISTED: usize = 3;
/// Columns whose kind nobody knows that are listed.
const MOST_OTHERS: usize = 6;
/// Longest part of a name that is shown \[characters\].
const MOST_SHOWN: usize = 48;

/// Kinds of columns, in the order in which they are asked for: the contract's name, words in names, whole names.
const KINDS: [(&str, &str, &[&str], &[&str]); 5] = [
    ("time", "t", &["time", "stamp", "duration", "clock"], &["t", "sec", "secs", "seconds", "s"]),
    ("velocities", "qd1..N", &["velocity", "speed", "qd", "dq"], &["v"]),
    ("torques", "tau1..N", &["torque", "effort", "tau", "moment"], &[]),
    ("currents", "current1..N", &["current"], &["i"]),
    ("positions", "q1..N", &["position", "angle", "joint_pos", "actual_q", "target_q", "q["], &["q", "pos"]),
];

/// The kind of a column by its name, as a place in [`KINDS`].
fn kind(name: &str) -> Option<usize> {
    let lower = name.to_lowercase();
    // Of a path the last part says what it is, but for numbers and units.
    let part = lower.rsplit(['/', '.']).find(|part| part.chars().any(char::is_alphabetic)).unwrap_or("");
    let bare: String = part.split(['[', '(', ' ']).next().unwrap_or("").chars().filter(|c| c.is_alphabetic()).collect();
    let whole = |names: &[&str]| names.contains(&bare.as_str());
    KINDS.iter().position(|(_, _, words, names)| whole(names) || words.iter().any(|word| part.contains(word)))
}

/// The kind of a column by its name, in a word: time, velocities, torques, currents, positions.
pub(crate) fn word(name: &str) -> Option<&'static str> {
    kind(name).map(|place| KINDS[place].0)
}

/// Some of the columns that look like positions.
pub(crate) fn positions(names: &[String]) -> Option<String> {
    let found: Vec<&str> = names.iter().map(String::as_str).filter(|name| word(name) == Some("positions")).collect();
    (!found.is_empty()).then(|| listed(&found, MOST_OTHERS))
}

/// What was found among the names, as one sentence: what looks like time, positions, torques, and what the contract calls them.
pub(crate) fn sentence(names: &[String]) -> String {
    if names.is_empty() {
        return "It has no columns".to_owned();
    }
    let of = |place: Option<usize>| names.iter().filter(move |name| kind(name) == place).map(String::as_str);
    let mut parts: Vec<String> = Vec::new();
    for (place, (what, call, ..)) in KINDS.iter().enumerate() {
        let found: Vec<&str> = of(Some(place)).collect();
        if !found.is_empty() {
            let [verb, them] = match (found.len(), *call) {
                (1, _) => ["looks", "it"],
                (_, "t") => ["look", "one of them"],
                _ => ["look", "them"],
            };
            let call =
                if found.iter().all(|name| is_known(name)) { String::new() } else { format!(" (name {them} {call})") };
            parts.push(format!("{} {verb} like {what}{call}", listed(&found, MOST_LISTED)));
        }
    }
    let others: Vec<&str> = of(None).collect();
    if parts.is_empty() {
        return format!("None of its columns looks like time, positions or torques: {}", listed(&others, MOST_OTHERS));
    }
    format!("Of its {} columns {}", names.len(), parts.join("; "))
}

fn listed(names: &[&str], most: usize) -> String {
    let shown =
        |name: &&str| name.chars().take(MOST_SHOWN).map(|c| if c.is_control() { '?' } else { c }).collect::<String>();
    if names.len() <= most {
        return names.iter().map(shown).collect::<Vec<_>>().join(" ");
    }
    let first: Vec<String> = names.iter().take(most - 1).map(shown).collect();
    let last = names.last().map(shown).unwrap_or_default();
    format!("{} .. {last}", first.join(" "))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(names: &[&str]) -> String {
        sentence(&names.iter().map(|n| (*n).to_owned()).collect::<Vec<_>>())
    }

    #[test]
    fn names_of_other_programs_are_recognised() {
        let time = ["__time", "%time", "timestamp", "T", "t [s]", "/joint_states/header/stamp", "duration", "time_ns"];
        for name in time {
            assert_eq!(kind(name), Some(0), "{name}");
        }
        let positions = [
            "field.position0",
            "/joint_states/elbow_joint/position",
            "actual_q_0",
            "robot_state.q[0]",
            "Q1",
            "q1 [rad]",
            "angle_3",
        ];
        for name in positions {
            assert_eq!(kind(name), Some(4), "{name}");
        }
        let torques = [
            "field.effort0",
            "robot_state.tau_J[0]",
            "TAU6",
            "tau1 [Nm]",
            "/joint_states/elbow_joint/effort",
            "torque_2",
        ];
        for name in torques {
            assert_eq!(kind(name), Some(2), "{name}");
        }
        assert_eq!(kind("actual_current_3"), Some(3));
        assert_eq!(kind("field.velocity4"), Some(1));
        assert_eq!(kind("frame_id"), None);
    }

    #[test]
    fn the_sentence_names_each_kind_and_what_to_call_it() {
        let said = of(&["__time", "a/position", "b/position", "a/effort", "b/effort", "note"]);
        assert!(said.contains("__time looks like time (name it t)"), "{said}");
        assert!(said.contains("a/position b/position look like positions (name them q1..N)"), "{said}");
        assert!(said.contains("a/effort b/effort look like torques"), "{said}");
        let said = of(&["%time", "header.stamp", "q1"]);
        assert!(said.contains("%time header.stamp look like time (name one of them t)"), "{said}");
        let said = of(&["x", "y"]);
        assert!(said.contains("None") && said.contains("x y"), "{said}");
    }
}
