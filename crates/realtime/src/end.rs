//! An orderly end: on a signal, and when the parent dies.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use rustix::process::{Signal, getppid, set_parent_process_death_signal};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;

/// The wish to end, shared by all threads; set by a signal or by the program itself.
#[derive(Clone, Debug, Default)]
pub struct Shutdown {
    requested: Arc<AtomicBool>,
}

impl Shutdown {
    /// A flag that only [`request`](Self::request) sets.
    pub fn new() -> Self {
        Self::default()
    }

    /// A flag that SIGINT, SIGTERM and SIGHUP set. The same signal again ends the program at once (exit code
    /// 1), should it hang on its way out.
    ///
    /// # Errors
    /// The system refused a signal handler.
    pub fn on_signals() -> io::Result<Self> {
        Self::on(&[SIGINT, SIGTERM, SIGHUP])
    }

    /// As [`on_signals`](Self::on_signals), for a service: SIGHUP does not end it ([`Hangup`] is told of it).
    ///
    /// # Errors
    /// The system refused a signal handler.
    pub fn on_termination() -> io::Result<Self> {
        Self::on(&[SIGINT, SIGTERM])
    }

    fn on(signals: &[i32]) -> io::Result<Self> {
        let shutdown = Self::new();
        for &signal in signals {
            // In this order: the first signal finds the flag unset, sets it, and only the second one exits.
            flag::register_conditional_shutdown(signal, 1, Arc::clone(&shutdown.requested))?;
            flag::register(signal, Arc::clone(&shutdown.requested))?;
        }
        Ok(shutdown)
    }

    /// Whether it is time to end. Real-time safe.
    pub fn is_requested(&self) -> bool {
        self.requested.load(Ordering::Relaxed)
    }

    /// Asks all threads to end.
    pub fn request(&self) {
        self.requested.store(true, Ordering::Relaxed);
    }
}

/// Whether a service was sent SIGHUP: read the configuration anew.
#[derive(Clone, Debug)]
pub struct Hangup {
    seen: Arc<AtomicBool>,
}

impl Hangup {
    /// From now on SIGHUP does not end the program.
    ///
    /// # Errors
    /// The system refused a signal handler.
    pub fn listen() -> io::Result<Self> {
        let seen = Arc::new(AtomicBool::new(false));
        flag::register(SIGHUP, Arc::clone(&seen))?;
        Ok(Self { seen })
    }

    /// Whether SIGHUP has come since the last call.
    pub fn take(&self) -> bool {
        self.seen.swap(false, Ordering::Relaxed)
    }
}

/// Environment variable by which a program names itself, as the number of its process, to children that are to end with it.
pub const PARENT_VARIABLE: &str = "RIVET_PARENT_PID";

/// Has the kernel send this process SIGTERM when its parent dies, so that a killed demonstration leaves no
/// children. Call it first thing in the child.
///
/// The kernel means the *thread* that started the child: start children from a thread that lives as long as
/// the program. A parent that dies before this is called is noticed only where it named itself by [`PARENT_VARIABLE`]: the child belongs to
/// another process by then.
///
/// # Errors
/// The system refused, or the parent has ended.
pub fn die_with_parent() -> io::Result<()> {
    let named: Option<i32> = std::env::var(PARENT_VARIABLE).ok().and_then(|pid| pid.parse().ok());
    let parent = named.unwrap_or_else(pid_of_parent);
    set_parent_process_death_signal(Some(Signal::TERM))?;
    // Asked after arming: a parent that died before would never be noticed.
    if pid_of_parent() == parent {
        Ok(())
    } else {
        Err(io::Error::new(io::ErrorKind::NotFound, "the parent process has ended"))
    }
}

/// 0 where the parent is in another namespace.
fn pid_of_parent() -> i32 {
    getppid().map_or(0, |pid| pid.as_raw_nonzero().get())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signal_asks_every_clone_to_end() {
        let shutdown = Shutdown::on_signals().expect("handlers");
        let clone = shutdown.clone();
        assert!(!clone.is_requested());
        signal_hook::low_level::raise(SIGTERM).expect("raise");
        assert!(clone.is_requested() && shutdown.is_requested());
    }

    #[test]
    fn a_program_may_ask_itself() {
        let shutdown = Shutdown::new();
        shutdown.clone().request();
        assert!(shutdown.is_requested());
    }

    #[test]
    fn the_kernel_accepts_the_wish_to_die_with_the_parent() {
        die_with_parent().expect("prctl");
        assert_eq!(rustix::process::parent_process_death_signal().expect("prctl"), Some(Signal::TERM));
        set_parent_process_death_signal(None).expect("prctl");
    }
}
