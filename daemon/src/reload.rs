//! A changed robot file while the daemon works: read and built on a thread of its own, swapped in between two samples.

use crate::core::Core;
use rivet_config::Robot;
use rivet_estimation::Reconfigured;
use rivet_ipc_schema::ControlStatus;
use rivet_realtime::{Hangup, Shutdown};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::mpsc::{Receiver, Sender};
use std::time::{Duration, Instant};

/// How often the thread looks for something to do.
const TURN: Duration = Duration::from_millis(10);
/// The loop swaps within a period; one that has not for this long is stuck, which the watchdog will say.
const PATIENCE: Duration = Duration::from_secs(5);

/// Whose a [`Swap`] is: one side takes it, or the other calls it back; never both.
const OFFERED: u8 = 0;
const TAKEN: u8 = 1;
const CALLED_BACK: u8 = 2;

/// A core on its way into the loop, and, with what it was changed for, out of it.
pub(crate) struct Swap {
    pub(crate) core: Box<Core>,
    ticket: Arc<AtomicU8>,
    /// What was kept, and the number of the last sample before the change.
    pub(crate) done: Option<(Reconfigured, u64)>,
}

/// The loop's end. Wait-free on both ways: what is replaced is dropped by the other end.
pub struct Incoming {
    fresh: rtrb::Consumer<Swap>,
    replaced: rtrb::Producer<Swap>,
}

impl Incoming {
    /// Nobody changes anything.
    pub fn none() -> Incoming {
        Incoming { fresh: rtrb::RingBuffer::new(1).1, replaced: rtrb::RingBuffer::new(1).0 }
    }

    /// Changes `core` if there is something to change it for. Real-time safe.
    pub(crate) fn apply(&mut self, core: &mut Core) {
        if let Ok(mut swap) = self.fresh.pop() {
            let mine = swap.ticket.compare_exchange(OFFERED, TAKEN, Ordering::AcqRel, Ordering::Relaxed).is_ok();
            swap.done = mine.then(|| (core.reconfigure(&mut swap.core), core.last_seq()));
            // There is room: the other end sends one at a time. If there were none, the loop would drop it.
            let _ = self.replaced.push(swap);
        }
    }
}

/// How a reload ended.
pub(crate) type Outcome = (ControlStatus, String);

/// Reads, builds and hands over.
pub(crate) struct Reloader {
    path: PathBuf,
    robot: Robot,
    patience: Duration,
    fresh: rtrb::Producer<Swap>,
    replaced: rtrb::Consumer<Swap>,
}

impl Reloader {
    /// For the robot in force; the other end is the loop's.
    pub(crate) fn new(path: &Path, robot: &Robot) -> (Reloader, Incoming) {
        let (fresh, fresh_end) = rtrb::RingBuffer::new(1);
        let (replaced_end, replaced) = rtrb::RingBuffer::new(1);
        let reloader = Reloader { path: path.to_owned(), robot: robot.clone(), patience: PATIENCE, fresh, replaced };
        (reloader, Incoming { fresh: fresh_end, replaced: replaced_end })
    }

    /// Serves requests and SIGHUP until shut down.
    pub(crate) fn run(
        mut self,
        hangup: &Hangup,
        requests: &Receiver<()>,
        outcomes: &Sender<Outcome>,
        shutdown: &Shutdown,
    ) {
        while !shutdown.is_requested() {
            let asked = requests.try_recv().is_ok();
            let by = if asked { "request" } else { "SIGHUP" };
            if asked || hangup.take() {
                let outcome = self.reload(shutdown);
                match outcome.0 {
                    ControlStatus::Done => log::info!(rivet_event = "reloaded"; "{by}: {}", outcome.1),
                    _ => log::error!(rivet_event = "reload-refused"; "{by}: nothing was changed: {}", outcome.1),
                }
                if asked {
                    // The bus thread is gone when the daemon is on its way out.
                    let _ = outcomes.send(outcome);
                }
            }
            std::thread::sleep(TURN);
        }
    }

    fn reload(&mut self, shutdown: &Shutdown) -> Outcome {
        let robot = match rivet_config::load(&self.path) {
            Ok(robot) => robot,
            Err(why) => return (ControlStatus::Refused, why.to_string()),
        };
        if let Some(what) = needs_restart(&self.robot, &robot) {
            return (
                ControlStatus::Refused,
                format!("{}: {what} has changed; that takes a restart", self.path.display()),
            );
        }
        let core = match Core::new(&robot) {
            Ok(core) => Box::new(core),
            Err(why) => return (ControlStatus::Refused, format!("the estimator refuses the settings: {why}")),
        };
        // One that came back after its time was up has nothing to say any more.
        while self.replaced.pop().is_ok() {}
        let ticket = Arc::new(AtomicU8::new(OFFERED));
        if self.fresh.push(Swap { core, ticket: Arc::clone(&ticket), done: None }).is_err() {
            return (ControlStatus::Failed, "the loop has not taken the last one".to_owned());
        }
        let begin = Instant::now();
        while !shutdown.is_requested() {
            if let Ok(Swap { done: Some((kept, seq)), .. }) = self.replaced.pop() {
                let text = reload_report(&self.path, &self.robot, &robot, kept, seq);
                self.robot = robot;
                return (ControlStatus::Done, text);
            }
            // What the loop has taken by now it is about to hand back; what it has not, it will leave.
            let late = begin.elapsed() >= self.patience;
            if late && ticket.compare_exchange(OFFERED, CALLED_BACK, Ordering::AcqRel, Ordering::Relaxed).is_ok() {
                break;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        (ControlStatus::Failed, "the loop did not take it in time and will not take it later".to_owned())
    }
}

/// What cannot change under a running loop.
fn needs_restart(old: &Robot, new: &Robot) -> Option<&'static str> {
    [
        (old.config.name != new.config.name, "the robot's name"),
        (old.hash != new.hash, "the model (kinematics, gravity, structure of the drives)"),
        (old.config.sample_period_s != new.config.sample_period_s, "sample_period_s"),
        (old.config.bus != new.config.bus, "[bus]"),
    ]
    .into_iter()
    .find_map(|(changed, what)| changed.then_some(what))
}

fn reload_report(path: &Path, old: &Robot, new: &Robot, kept: Reconfigured, seq: u64) -> String {
    let mut text = format!("{} is in force after sample {seq}; parameters stay", path.display());
    text += match (kept.window, kept.signals) {
        (true, true) => ", so do the window and the filters' states",
        (true, false) => ", so does the window; the filters settle anew",
        (false, _) => "; the window begins anew",
    };
    let (a, b) = (&old.config, &new.config);
    let later: Vec<&str> = [
        (a.realtime != b.realtime, "[realtime]"),
        (a.publish.health_every != b.publish.health_every, "[publish] health_every"),
        (a.publish.consistent_hz != b.publish.consistent_hz, "[publish] consistent_hz"),
        (a.controller != b.controller, "[controller] (rivet-controller reads it)"),
    ]
    .into_iter()
    .filter_map(|(changed, what)| changed.then_some(what))
    .collect();
    if !later.is_empty() {
        text += "; only at the next start: ";
        text += &later.join(", ");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A loop that is stuck for longer than the request waits must not change later what was told to stay.
    #[test]
    fn what_came_too_late_is_not_taken_later() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/dd2/robot.toml");
        let robot = rivet_config::load(&file).expect("the robot file is sound");
        let mut core = Core::new(&robot).expect("sound settings");
        let (mut reloader, mut incoming) = Reloader::new(&file, &robot);
        reloader.patience = Duration::from_millis(5);
        let shutdown = Shutdown::new();
        let (status, text) = reloader.reload(&shutdown);
        assert_eq!(status, ControlStatus::Failed, "{text}");
        assert_eq!(reloader.reload(&shutdown).0, ControlStatus::Failed, "nor is there room for another one");
        incoming.apply(&mut core);
        let late = reloader.replaced.pop().expect("handed back, to be dropped here");
        assert!(late.done.is_none(), "not applied");
        // In time it is.
        reloader.patience = PATIENCE;
        let loop_thread = std::thread::spawn(move || {
            while incoming.fresh.is_empty() {
                std::thread::sleep(Duration::from_millis(1));
            }
            incoming.apply(&mut core);
        });
        assert_eq!(reloader.reload(&shutdown).0, ControlStatus::Done);
        loop_thread.join().expect("no panic");
    }
}
