//! The service manager: readiness and watchdog.

use sd_notify::NotifyState;
use std::time::{Duration, Instant};

/// How often the manager hears from a service that it does not watch.
const UNWATCHED: Duration = Duration::from_millis(500);

/// Talks to the service manager that started this process, if one did.
///
/// The watchdog is fed only while a counter of the real-time loop moves: a process whose loop is stuck is ended and started
/// anew, however well its other threads are.
#[derive(Debug)]
pub struct Manager {
    patience: Duration,
    next: Instant,
    seen: Option<u64>,
    ready: bool,
}

impl Default for Manager {
    fn default() -> Self {
        Self::new()
    }
}

impl Manager {
    /// Asks the environment what the manager expects.
    #[must_use]
    pub fn new() -> Manager {
        let patience = sd_notify::watchdog_enabled().map_or(UNWATCHED, |watchdog| watchdog / 3);
        Manager { patience, next: Instant::now(), seen: None, ready: false }
    }

    /// Says once that the service does its work.
    pub fn ready(&mut self) {
        if !std::mem::replace(&mut self.ready, true) {
            say(&[NotifyState::Ready]);
        }
    }

    /// Call it often. Where it is time, tells `status` and, if `progress` has moved since the last time, that the loop is
    /// alive.
    pub fn turn(&mut self, progress: u64, status: impl FnOnce() -> String) {
        let now = Instant::now();
        if now < self.next {
            return;
        }
        self.next = now + self.patience;
        say(&[NotifyState::Status(&status())]);
        if self.seen != Some(progress) {
            self.seen = Some(progress);
            say(&[NotifyState::Watchdog]);
        }
    }

    /// Says that the service is on its way out.
    pub fn stopping(&self) {
        say(&[NotifyState::Stopping]);
    }
}

/// Without a manager this does nothing; a manager that is gone is not the service's concern.
fn say(state: &[NotifyState<'_>]) {
    let _ = sd_notify::notify(state);
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::net::UnixDatagram;

    /// The one test of this crate that sets the environment, so that none runs beside it.
    #[test]
    #[allow(unsafe_code, reason = "the environment is how a manager is found")]
    fn a_loop_that_stands_still_is_not_reported_alive() {
        let path = std::env::temp_dir().join(format!("rivet-notify-{}", std::process::id()));
        let socket = UnixDatagram::bind(&path).expect("a socket");
        socket.set_nonblocking(true).expect("a socket");
        // SAFETY: no other thread of this test program reads or writes the environment.
        unsafe {
            std::env::set_var("NOTIFY_SOCKET", &path);
            std::env::set_var("WATCHDOG_USEC", "30000");
        }
        let mut manager = Manager::new();
        let mut turn = |progress| {
            std::thread::sleep(Duration::from_millis(11));
            manager.turn(progress, || "at work".to_owned());
        };
        for progress in [1, 1, 1, 2] {
            turn(progress);
        }
        manager.ready();
        manager.ready();
        let mut heard = Vec::new();
        let mut buffer = [0; 512];
        while let Ok(length) = socket.recv(&mut buffer) {
            heard.extend(String::from_utf8_lossy(&buffer[..length]).lines().map(str::to_owned));
        }
        let _ = std::fs::remove_file(&path);
        let times = |what: &str| heard.iter().filter(|line| *line == what).count();
        assert_eq!((times("WATCHDOG=1"), times("STATUS=at work"), times("READY=1")), (2, 4, 1), "{heard:?}");
    }
}
