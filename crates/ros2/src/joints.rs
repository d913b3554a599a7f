//! Joints by name.

use rivet_files::printable;

/// Why a message's joints are not those of the arm.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum JointsError {
    /// Joints of the arm that the message does not have.
    #[error("{} missing; the message has {}", list(.missing), list(.found))]
    Missing {
        /// Joints of the robot file.
        missing: Vec<String>,
        /// Joints of the message.
        found: Vec<String>,
    },
    /// A joint of the arm is there more than once.
    #[error("joint {name} is there more than once; the message has {}", list(.found))]
    Twice {
        /// The joint.
        name: String,
        /// Joints of the message.
        found: Vec<String>,
    },
}

/// Names of a message that are shown.
const MOST_SHOWN: usize = 12;
/// Longest part of a name that is shown \[characters\].
const MOST_CHARACTERS: usize = 48;

/// A name of the graph as it may be printed: one line, and short.
pub(crate) fn shown(name: &str) -> String {
    one_line(name, MOST_CHARACTERS)
}

/// The first `most` characters of a text of the graph, on one line.
pub(crate) fn one_line(text: &str, most: usize) -> String {
    let short: String = text.chars().take(most).collect();
    printable(&short).replace(['\n', '\r'], "?")
}

/// Some of the names, separated by commas.
pub(crate) fn listed(names: &[String]) -> String {
    let first: Vec<String> = names.iter().take(MOST_SHOWN).map(|name| shown(name)).collect();
    let more = names.len().saturating_sub(MOST_SHOWN);
    if more > 0 { format!("{} and {more} more", first.join(", ")) } else { first.join(", ") }
}

fn list(names: &[String]) -> String {
    match names.len() {
        0 => "no joint".to_owned(),
        1 => format!("joint {}", listed(names)),
        _ => format!("joints {}", listed(names)),
    }
}

/// Where a message has the joints of an arm.
#[derive(Clone, Debug)]
pub struct Joints {
    names: Vec<String>,
    /// Names of the message before, and where it had each joint.
    seen: Vec<String>,
    places: Vec<usize>,
}

impl Joints {
    /// `names`: joints of the arm, base to flange.
    pub fn new(names: Vec<String>) -> Joints {
        Joints { names, seen: Vec::new(), places: Vec::new() }
    }

    /// How many joints the arm has.
    pub fn count(&self) -> usize {
        self.names.len()
    }

    /// The place in the message of each joint of the arm, base to flange. Further joints of the message are left out.
    ///
    /// # Errors
    /// A joint is missing or there twice.
    pub fn places(&mut self, found: &[String]) -> Result<&[usize], JointsError> {
        if self.places.is_empty() || self.seen != found {
            self.places = places(&self.names, found)?;
            self.seen = found.to_vec();
        }
        Ok(&self.places)
    }
}

fn places(names: &[String], found: &[String]) -> Result<Vec<usize>, JointsError> {
    let missing: Vec<String> = names.iter().filter(|name| !found.contains(name)).cloned().collect();
    if !missing.is_empty() {
        return Err(JointsError::Missing { missing, found: found.to_vec() });
    }
    if let Some(name) = names.iter().find(|name| found.iter().filter(|other| other == name).count() > 1) {
        return Err(JointsError::Twice { name: name.clone(), found: found.to_vec() });
    }
    Ok(names.iter().filter_map(|name| found.iter().position(|other| other == name)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_the_graph_cannot_begin_a_line_or_fill_the_journal() {
        let names = vec!["a\nrivet-ros2: ok".to_owned(), "b".repeat(20_000)];
        let text = listed(&names);
        assert!(!text.contains('\n') && text.len() < 200, "{text}");
        assert!(listed(&vec!["c".to_owned(); 30]).ends_with("and 18 more"));
    }

    fn names(text: &str) -> Vec<String> {
        text.split_whitespace().map(str::to_owned).collect()
    }

    #[test]
    fn finds_joints_in_any_order_among_others() {
        let mut joints = Joints::new(names("a b c"));
        assert_eq!(joints.places(&names("b finger c a")), Ok(&[3, 0, 2][..]));
        assert_eq!(joints.places(&names("a b c")), Ok(&[0, 1, 2][..]), "another message has another order");
    }

    #[test]
    fn names_what_is_missing_and_what_was_found() {
        let mut joints = Joints::new(names("a b c"));
        let why = joints.places(&names("c finger")).expect_err("two are missing").to_string();
        assert_eq!(why, "joints a, b missing; the message has joints c, finger");
        let why = joints.places(&[]).expect_err("all are missing").to_string();
        assert_eq!(why, "joints a, b, c missing; the message has no joint");
    }

    #[test]
    fn refuses_a_joint_that_is_there_twice_but_not_another_robots() {
        let mut joints = Joints::new(names("a b"));
        assert!(matches!(joints.places(&names("a b a")), Err(JointsError::Twice { name, .. }) if name == "a"));
        assert_eq!(joints.places(&names("finger a finger b")), Ok(&[1, 3][..]));
    }
}
