//! Which channels of a recording are which quantities, as a user states it.

use std::collections::BTreeMap;

use crate::columns::Group;

/// How one quantity is found in a recording, and how its numbers become SI values:
/// `value = sign * scale * unit(number) + zero`, one sign, scale and zero a joint.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Channel {
    /// Names of its columns: `{joint}` stands for the joint's name in the URDF, `{i}` for its number from 0 or from 1; or one name a
    /// joint, separated by commas. None: the names decide.
    pub pattern: Option<String>,
    /// Unit of the numbers, where it is not the SI unit or the one that the recording states.
    pub unit: Option<String>,
    /// 1 or -1, one a joint.
    pub sign: Option<Vec<f64>>,
    /// Factor, one a joint.
    pub scale: Option<Vec<f64>>,
    /// Added behind sign, scale and unit, in the SI unit, one a joint.
    pub zero: Option<Vec<f64>>,
}

/// The channels of a recording by the key of their quantity.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChannelMap {
    channels: BTreeMap<String, Channel>,
}

/// Key of time.
pub(crate) const TIME: &str = "time";

impl ChannelMap {
    /// Keys of the quantities that can be mapped.
    pub const KEYS: [&'static str; 6] = [TIME, "q", "tau", "current", "q_des", "temperature"];

    /// The entry of a quantity.
    ///
    /// # Errors
    /// The key, where it is none of [`ChannelMap::KEYS`].
    pub fn entry(&mut self, key: &str) -> Result<&mut Channel, String> {
        if !Self::KEYS.contains(&key) {
            return Err(format!("{key} is no quantity; the keys are {}", Self::KEYS.join(", ")));
        }
        Ok(self.channels.entry(key.to_owned()).or_default())
    }

    /// What is stated of a quantity.
    pub fn get(&self, key: &str) -> Option<&Channel> {
        self.channels.get(key)
    }

    /// What is stated of a group of columns. Desired positions are written as the positions are, unless it is stated otherwise.
    pub(crate) fn of_group(&self, group: Group) -> Channel {
        let stated = self.get(group.prefix()).cloned().unwrap_or_default();
        if group != Group::DesiredPosition {
            return stated;
        }
        let q = self.get(Group::Position.prefix()).cloned().unwrap_or_default();
        Channel {
            pattern: stated.pattern,
            unit: stated.unit.or(q.unit),
            sign: stated.sign.or(q.sign),
            scale: stated.scale.or(q.scale),
            zero: stated.zero.or(q.zero),
        }
    }
}
