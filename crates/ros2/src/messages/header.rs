//! `std_msgs/Header`, with `builtin_interfaces/Time` and `builtin_interfaces/Duration`.

use serde::{Deserialize, Serialize};

/// Nanoseconds of a second.
const NS: i64 = 1_000_000_000;

/// `builtin_interfaces/Time`: since the epoch, or since the start of a simulation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Time {
    /// \[s\]
    pub sec: i32,
    /// \[ns\], below 1e9
    pub nanosec: u32,
}

impl Time {
    /// The same as one number \[ns\].
    pub fn as_ns(self) -> i64 {
        i64::from(self.sec) * NS + i64::from(self.nanosec)
    }

    /// Of one number \[ns\]; what the message cannot hold becomes its last second.
    pub fn from_ns(ns: i64) -> Time {
        let sec = i32::try_from(ns.div_euclid(NS)).unwrap_or(if ns < 0 { i32::MIN } else { i32::MAX });
        Time { sec, nanosec: u32::try_from(ns.rem_euclid(NS)).unwrap_or(0) }
    }
}

/// `builtin_interfaces/Duration`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Duration {
    /// \[s\]
    pub sec: i32,
    /// \[ns\], below 1e9
    pub nanosec: u32,
}

/// `std_msgs/Header`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// When the values were measured.
    pub stamp: Time,
    /// The frame that they are in.
    pub frame_id: String,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_is_one_number_and_back() {
        for ns in [0, 1, 999_999_999, 1_000_000_000, -1, 1_764_000_000_123_456_789] {
            assert_eq!(Time::from_ns(ns).as_ns(), ns);
        }
        assert_eq!(Time::from_ns(-1), Time { sec: -1, nanosec: 999_999_999 });
        assert_eq!(Time::from_ns(i64::MAX).sec, i32::MAX);
    }
}
