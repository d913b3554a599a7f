//! Stretches of one run, with and without a neighbour at work: what the daemon's loop needed in each.
//!
//! They are to alternate. This machine's other work comes and goes, and hits both kinds alike; what a neighbour does to the
//! loop it does in every stretch of its own, so the least of those tells it from noise.

use crate::process::{Process, eventually};
use crate::two_link::sample;
use rivet_ipc_schema::{Bus, Health, JointState, Publisher, Subscriber};
use rivet_realtime::LogHistogram;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// A stall that counts on any machine \[ns\]: after 20 periods the loop's input is stale. The end of the histogram's bin.
const STALL: u64 = (32 << 20) - 1;

/// The two-link arm's samples into its daemon.
pub struct Feed<'a> {
    states: Publisher<JointState>,
    health: Subscriber<Health>,
    daemon: &'a Process,
    pause: Duration,
    last: Health,
}

/// What the loop needed in one stretch, and whoever fed it.
#[derive(Clone, Debug)]
pub struct Stretch {
    /// Work of each period \[ns\].
    work: LogHistogram,
    /// Lateness of each wake-up \[ns\].
    wake: LogHistogram,
    /// Periods.
    pub periods: u64,
    /// Periods that had passed when the loop came to them.
    pub missed: u64,
    /// Times that the loop's thread gave its processor away: it has to once a period, to wait for the next.
    pub switches: u64,
    /// Longest time that sending a sample took.
    pub longest_send: Duration,
}

impl Stretch {
    /// The work \[ns\] that a share `p` of the periods does not exceed.
    pub fn work(&self, p: f64) -> u64 {
        self.work.quantile(p)
    }

    /// How long the loop was held up at most \[ns\], while it worked or when it was to begin.
    pub fn stall(&self) -> u64 {
        self.work.quantile(1.0).max(self.wake.quantile(1.0))
    }
}

/// The least of something over these stretches.
pub fn least(stretches: &[Stretch], of: impl Fn(&Stretch) -> u64) -> u64 {
    stretches.iter().map(of).min().expect("there are some")
}

/// A stall \[ns\] that is none of `alone`, the stretches without a neighbour: four times as long as all of those, two bins.
pub fn stall_limit(alone: &[Stretch], of: impl Fn(&Stretch) -> u64) -> u64 {
    alone.iter().map(of).max().expect("there are some").saturating_mul(4).max(STALL)
}

impl<'a> Feed<'a> {
    /// Begins with a stretch of no neighbour, after which everything is in its place. `pause`: time between samples.
    pub fn begin(bus: &Bus, daemon: &'a Process, pause: Duration) -> Feed<'a> {
        let states = bus.joint_state_publisher().expect("a publisher");
        let health = bus.health_subscriber().expect("a subscriber");
        eventually("rivetd listens", || (states.subscribers() > 0).then_some(()));
        let mut feed = Feed { states, health, daemon, pause, last: Health::default() };
        feed.stretch(500, |_| {});
        feed
    }

    /// What the daemon said last; all samples so far are in it.
    pub fn health(&self) -> &Health {
        &self.last
    }

    /// Sends at least so many samples, and on until `beside` has ended: it is told to by its argument.
    pub fn stretch<R: Send>(&mut self, samples: u64, beside: impl FnOnce(&AtomicBool) -> R + Send) -> (Stretch, R) {
        let before = self.last;
        let switched = self.switches();
        let stop = AtomicBool::new(false);
        let mut longest_send = Duration::ZERO;
        let mut seq = before.seq;
        let said = std::thread::scope(|scope| {
            let neighbour = scope.spawn(|| beside(&stop));
            let begin = Instant::now();
            while seq < before.seq + samples || !neighbour.is_finished() {
                seq += 1;
                let sent = Instant::now();
                assert_eq!(self.states.send(&sample(seq)).expect("sent"), 1, "the daemon, and nobody else, has it");
                longest_send = longest_send.max(sent.elapsed());
                stop.store(seq >= before.seq + samples, Ordering::Relaxed);
                let due = begin + self.pause * (seq - before.seq) as u32;
                std::thread::sleep(due.saturating_duration_since(Instant::now()));
            }
            neighbour.join().expect("no panic")
        });
        // Before the report, so that what is counted here is counted there.
        let switches = self.switches() - switched;
        let heard = || self.health.receive().expect("received").filter(|health| health.seq == seq);
        let now = eventually("the last sample is in", heard);
        let stretch = Stretch {
            work: between(&before.work_histogram, &now.work_histogram),
            wake: between(&before.wake_histogram, &now.wake_histogram),
            periods: now.periods - before.periods,
            missed: now.overruns - before.overruns,
            switches,
            longest_send,
        };
        self.last = now;
        (stretch, said)
    }

    /// How often the loop's thread has given its processor away; 0 where the kernel does not say.
    fn switches(&self) -> u64 {
        let tasks = std::fs::read_dir(format!("/proc/{}/task", self.daemon.0.id())).expect("the daemon's threads");
        let of = |path: &Path| -> Option<u64> {
            let name = std::fs::read_to_string(path.join("comm")).ok()?;
            let status = std::fs::read_to_string(path.join("status")).ok().filter(|_| name.trim() == "rivetd-loop")?;
            status.lines().find_map(|line| line.strip_prefix("voluntary_ctxt_switches:"))?.trim().parse().ok()
        };
        tasks.flatten().find_map(|task| of(&task.path())).unwrap_or(0)
    }
}

/// What came into a histogram between two reports. Its largest value is not known but for the bin.
fn between(before: &[u32; LogHistogram::BINS], now: &[u32; LogHistogram::BINS]) -> LogHistogram {
    LogHistogram::from_counts(std::array::from_fn(|bin| now[bin].saturating_sub(before[bin])), u64::MAX)
}
