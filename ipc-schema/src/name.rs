//! Names of robots and of their services.

use core::fmt;

use crate::error::BusError;
use crate::service::Service;

/// The name of a robot: 1 to 64 of `a-z 0-9 - _`, starting with a letter or a digit.
///
/// It is part of service names and of a lock file's name, hence the small alphabet.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct RobotName(String);

impl RobotName {
    /// Longest name \[bytes\].
    pub const MAX_LEN: usize = 64;

    /// Checks a name.
    ///
    /// # Errors
    /// The rule it breaks.
    pub fn new(name: &str) -> Result<Self, BusError> {
        let refuse = |why| Err(BusError::RobotName { name: name.to_owned(), why });
        if name.is_empty() || name.len() > Self::MAX_LEN {
            return refuse("it must have 1 to 64 characters");
        }
        if !name.bytes().all(|b| matches!(b, b'a'..=b'z' | b'0'..=b'9' | b'-' | b'_')) {
            return refuse("only a-z, 0-9, - and _ are allowed");
        }
        if name.starts_with(['-', '_']) {
            return refuse("it must start with a letter or a digit");
        }
        Ok(Self(name.to_owned()))
    }

    /// The full name of a service: `rivet/ur10e/joint-state`.
    pub fn service_name(&self, service: Service) -> String {
        format!("rivet/{self}/{service}")
    }

    /// The name as text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for RobotName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}
