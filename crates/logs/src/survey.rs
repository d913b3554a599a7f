//! What the names of a recording say, for who looks at it before it is read.

use crate::columns::Group;
use crate::error::LogFault;
use crate::families::{families, is_time};
use crate::joint_state::FIELDS;
use crate::listing::Listing;
use crate::plan::{Naming, Plan};

/// Most joints of an arm.
const MAX_ARM_JOINTS: usize = 8;

/// Channels by their names, as keys and patterns of `[log]`; empty where the recording has the columns of the contract.
///
/// # Errors
/// As [`crate::read_as`], as far as names are concerned.
pub fn channels_by_name(
    listing: &Listing,
    naming: &Naming<'_>,
    joints: usize,
) -> Result<Vec<(&'static str, String)>, LogFault> {
    Plan::find(listing, naming, joints, false).map(Plan::named)
}

/// Names of the joints in a recording's topics or in its vectors, in the order of the recording; empty where it has numbers.
pub fn recorded_joints(listing: &Listing) -> Vec<String> {
    let mut joints: Vec<String> = Vec::new();
    for column in &listing.columns {
        let of_topic = column.name.strip_prefix(&column.topic).filter(|_| !column.topic.is_empty());
        let of_topic = of_topic.and_then(|rest| rest.strip_prefix('/')?.strip_suffix(FIELDS[0])?.strip_suffix('/'));
        let of_vector =
            column.name.strip_prefix("observation.state/").map(|entry| entry.strip_suffix(".pos").unwrap_or(entry));
        if let Some(joint) = of_topic.or(of_vector)
            && !joints.iter().any(|known| known == joint)
        {
            joints.push(joint.to_owned());
        }
    }
    joints
}

/// Number of joints of a recording whose columns are numbered; 0 where no group of columns looks like positions.
pub fn numbered_joints(listing: &Listing) -> usize {
    let is_position = |count: &usize| families(listing, &[], *count).iter().any(|f| f.group == Some(Group::Position));
    (1..=MAX_ARM_JOINTS).rev().find(is_position).unwrap_or(0)
}

/// Columns that look like time.
pub fn clocks(listing: &Listing) -> Vec<String> {
    listing.columns.iter().filter(|column| is_time(column)).map(|column| column.name.clone()).collect()
}
