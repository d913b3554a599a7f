//! How a URDF is read, and as lines of a robot file.

use std::fmt::Write as _;

/// How a URDF is to be read.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct UrdfOptions {
    /// The link that the arm ends with. Joints beside the way from the root to it are welded.
    pub tip: Option<String>,
    /// Joints that are welded, with their positions \[rad or m\].
    pub fixed: Vec<(String, f64)>,
    /// Project an inertia that no body has onto the nearest that one has, instead of refusing the file.
    pub project: bool,
}

/// Lines of a robot file that make an arm of a tree.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Proposal {
    /// The link that the arm ends with.
    pub tip: String,
    /// Joints that are welded, and where.
    pub fixed: Vec<(String, f64)>,
}

impl Proposal {
    /// The section `[model]` of a robot file.
    pub fn text(&self) -> String {
        let mut out = format!("[model]\ntip = {:?}\n", self.tip);
        if !self.fixed.is_empty() {
            let entries: Vec<String> =
                self.fixed.iter().map(|(joint, at)| format!("{} = {at:?}", toml_key(joint))).collect();
            // Writing to a String cannot fail.
            let _ = writeln!(out, "fixed = {{ {} }}", entries.join(", "));
        }
        out
    }

    pub(super) fn mend(&self, file: &str) -> String {
        if self.tip.is_empty() {
            return format!("correct it in {file}");
        }
        format!("add these lines at the end of the robot file:\n{}", self.text().trim_end())
    }
}

/// A name as a key of TOML: quoted where it needs to be.
pub fn toml_key(name: &str) -> String {
    let bare = !name.is_empty() && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'_');
    if bare { name.to_owned() } else { format!("{name:?}") }
}
