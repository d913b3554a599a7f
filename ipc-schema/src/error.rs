//! Why the bus did not do what was asked.

use std::path::PathBuf;

use crate::service::Service;

/// Why a bus or a port could not be opened. Made at start-up, for the person who can act on it.
#[derive(Debug, thiserror::Error)]
pub enum BusError {
    /// A robot's name breaks a rule.
    #[error("robot name \"{name}\": {why}")]
    RobotName {
        /// The name given.
        name: String,
        /// The rule.
        why: &'static str,
    },
    /// The prefix of the bus breaks a rule.
    #[error("bus prefix \"{prefix}\": it must have 3 to 32 characters of a-z, A-Z, 0-9, - and _")]
    Prefix {
        /// The prefix given.
        prefix: String,
    },
    /// The root path of the bus breaks a rule.
    #[error("bus root {}: {why}", root.display())]
    Root {
        /// The path given.
        root: PathBuf,
        /// The rule.
        why: &'static str,
    },
    /// Shared memory has too little room: to write beyond it would end the process without a word.
    #[error(
        "/dev/shm has {} KiB free and {} are needed: free some, or make it larger (mount -o remount,size=256M /dev/shm)",
        free >> 10,
        needed >> 10
    )]
    SharedMemoryFull {
        /// What is free \[bytes\].
        free: u64,
        /// What is needed \[bytes\].
        needed: u64,
    },
    /// The bus itself could not be joined.
    #[error(
        "cannot join the bus (prefix {prefix}, root {}): {why}; all processes of one robot must run as one user, \
         and that user must be able to write there and to /dev/shm",
        root.display()
    )]
    Join {
        /// Prefix of the bus.
        prefix: String,
        /// Root path of the bus.
        root: PathBuf,
        /// What the bus said.
        why: String,
    },
    /// The bus is another user's, or something of another user's is in the way.
    #[error(
        "{} belongs to the user {owner}, and this program runs as {me}; all processes of one robot run as \
         one user: {change}",
        path.display()
    )]
    OtherUser {
        /// The bus's directory, or what is in the way.
        path: PathBuf,
        /// Whose it is.
        owner: String,
        /// The user of this process.
        me: String,
        /// The command to use.
        change: String,
    },
    /// Other users could replace what is in the bus's directory.
    #[error("{}: {why}, so another user could replace the files of the bus {}; {change}", path.display(), root.display())]
    Exposed {
        /// The bus's directory or one above it.
        path: PathBuf,
        /// Root path of the bus.
        root: PathBuf,
        /// What makes it so.
        why: String,
        /// What to do.
        change: String,
    },
    /// Another version of the message is spoken on the service.
    #[error("{0}")]
    Version(VersionMismatch),
    /// A service exists with settings that are too small for rivet's programs: another program created it.
    #[error(
        "service {service} has {found}, and rivet needs {needed}: end the program that created it, start rivetd, then that program; \
         or use librivet there, which creates services with these settings"
    )]
    Settings {
        /// Full name of the service.
        service: String,
        /// The settings that it has.
        found: String,
        /// The settings that all parties ask for.
        needed: String,
    },
    /// A service could not be opened, or a port of it could not be made.
    #[error("service {service}: cannot open {role}: {why}")]
    Open {
        /// Full name of the service.
        service: String,
        /// The port that was wanted: `subscriber`.
        role: &'static str,
        /// What the bus said.
        why: String,
    },
    /// A blackboard has one writer, and it is alive.
    #[error("service {service}: another program is its writer (it holds {})", lock.display())]
    WriterAlive {
        /// Full name of the service.
        service: String,
        /// The lock file that the other program holds.
        lock: PathBuf,
    },
    /// The files of the bus are gone: parties that come from now on do not find those that are there.
    #[error(
        "the files of the bus below {} or in /dev/shm were removed while this process used them: nobody finds it any more; \
         start all processes of the robot anew",
        root.display()
    )]
    Torn {
        /// Root path of the bus.
        root: PathBuf,
    },
    /// Leftovers were not removed because someone still uses them.
    #[error("the bus (prefix {prefix}) is in use by {nodes} node(s); stop their processes first")]
    InUse {
        /// Prefix of the bus.
        prefix: String,
        /// Live nodes found.
        nodes: usize,
    },
    /// A file could not be made, locked or removed.
    #[error("{}: {source}", path.display())]
    File {
        /// The file or directory.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}

/// Two programs that speak different versions of a message met on a service.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VersionMismatch {
    /// Full name of the service.
    pub service: String,
    /// Type name that the service carries: `rivet.JointState.v2`.
    pub carried: String,
    /// Type name that this program speaks.
    pub spoken: &'static str,
    /// Who has to act.
    pub verdict: Verdict,
}

/// Which of two programs is behind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// This program speaks the lower version.
    ThisIsOlder,
    /// The program that made the service speaks the lower version.
    OtherIsOlder,
    /// The same version, but another size: one side was built from a changed definition under the old name.
    SameVersionOtherLayout,
    /// The service carries something that is no version of this message.
    OtherMessage,
}

impl core::fmt::Display for VersionMismatch {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Self { service, carried, spoken, verdict } = self;
        write!(f, "service {service} carries {carried} but this program speaks ")?;
        let version = spoken.rsplit('.').next().unwrap_or(spoken);
        match verdict {
            Verdict::ThisIsOlder => write!(f, "{version}: this program is the older side; update it"),
            Verdict::OtherIsOlder => {
                write!(f, "{version}: the program that created the service is the older side; update and restart it")
            }
            Verdict::SameVersionOtherLayout => write!(
                f,
                "{version} of another size: one side was built from a changed message under the same name; \
                 rebuild both from one source"
            ),
            Verdict::OtherMessage => write!(f, "{spoken}: the service was created by a foreign program"),
        }
    }
}

/// Why a port failed while running: small and without text of its own, as it may be made in a real-time loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{service}: {what}: {why}")]
pub struct PortError {
    /// The service.
    pub service: Service,
    /// What was tried: `receive`.
    pub what: &'static str,
    /// What went wrong.
    pub why: &'static str,
}
