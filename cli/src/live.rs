//! A window of what an arm says on the bus, as a log.

use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use rivet_config::Robot;
use rivet_ipc_schema::{Bus, BusConfig, JointState, OneSource, RobotName};
use rivet_logs::write_model_columns;
use rivet_realtime::{Shutdown, now_ns};

use rivet_analysis::fault::Fault;
use rivet_analysis::progress::Progress;

/// Time between two looks at the bus: the ring holds a thousand samples.
const TURN: Duration = Duration::from_millis(5);
/// Time without a sample after which nobody is taken to be there.
const SILENCE: Duration = Duration::from_secs(2);

/// Listens for `seconds` of samples and writes them to `path`, in the model's conventions. Samples that cannot be used
/// (a fault bit, a number that is none, a stamp that jumps) and samples that never came are holes in time; a second robot
/// controller is not listened to.
pub(crate) fn record(robot: &Robot, config: &BusConfig, seconds: f64, path: &Path) -> Result<()> {
    if !(seconds.is_finite() && seconds > 0.0) {
        return Err(Fault::Usage(format!("--live {seconds}: seconds of motion, more than none")).into());
    }
    let bus = Bus::open(config, &RobotName::new(&robot.config.name)?, "rivet-diagnose")?;
    let mut states = OneSource::new(bus.joint_state_subscriber()?, SILENCE / 2);
    let shutdown = Shutdown::on_signals()?;
    let mut progress = Progress::new("seconds recorded", seconds.ceil() as usize);
    let mut recorded = Recorded::new(robot);
    let mut last = Instant::now();
    while recorded.seconds() < seconds && !shutdown.is_requested() {
        while let Some(state) = states.receive(now_ns())? {
            if recorded.take(&state) {
                last = Instant::now();
            }
        }
        if last.elapsed() > SILENCE {
            break;
        }
        progress.set(recorded.seconds() as usize);
        std::thread::sleep(TURN);
    }
    progress.done();
    if states.foreign() > 0 {
        rivet_files::note(format_args!(
            "rivet: {} samples of another publisher of joint states were ignored",
            states.foreign()
        ));
    }
    if recorded.unusable > 0 {
        rivet_files::note(format_args!(
            "rivet: {} samples could not be used (fault bits, no numbers, or stamps that jump)",
            recorded.unusable
        ));
    }
    if recorded.t.len() < 2 {
        bail!("no joint states of {} on this bus for {} s that could be used", robot.config.name, SILENCE.as_secs());
    }
    let short = seconds - recorded.seconds();
    if short > 0.1 * seconds {
        rivet_files::note(format_args!(
            "rivet: the samples ended {short:.1} s before the {seconds} s that were asked for"
        ));
    }
    recorded.write(path)
}

/// Samples as columns.
struct Recorded {
    first_ns: Option<u64>,
    t: Vec<f64>,
    q: Vec<Vec<f64>>,
    tau: Vec<Vec<f64>>,
    temperature: Vec<Vec<f64>>,
    /// Samples that were left out.
    unusable: u64,
}

impl Recorded {
    fn new(robot: &Robot) -> Recorded {
        let signals = || vec![Vec::new(); robot.dof()];
        Recorded { first_ns: None, t: Vec::new(), q: signals(), tau: signals(), temperature: signals(), unusable: 0 }
    }

    fn seconds(&self) -> f64 {
        self.t.last().copied().unwrap_or(0.0)
    }

    /// Whether the sample could be used.
    fn take(&mut self, state: &JointState) -> bool {
        let taken = self.try_take(state).is_some();
        self.unusable += u64::from(!taken);
        taken
    }

    fn try_take(&mut self, state: &JointState) -> Option<()> {
        let n = self.q.len();
        if state.faults != 0 || state.count() != n {
            return None;
        }
        if !state.q[..n].iter().chain(&state.tau[..n]).all(|x| x.is_finite()) {
            return None;
        }
        let first = *self.first_ns.get_or_insert(state.stamp_ns);
        let t = state.stamp_ns.checked_sub(first)? as f64 * 1e-9;
        // Who is silent for longer is not waited for, so such a stamp is none of this stream.
        if self.t.last().is_some_and(|last| t <= *last || t > *last + 2.0 * SILENCE.as_secs_f64()) {
            return None;
        }
        self.t.push(t);
        for j in 0..n {
            self.q[j].push(state.q[j]);
            self.tau[j].push(state.tau[j]);
            self.temperature[j].push(state.temperature[j]);
        }
        Some(())
    }

    fn write(&self, path: &Path) -> Result<()> {
        let mut named: Vec<(String, &[f64])> = vec![("t".to_owned(), &self.t)];
        let warm = self.temperature.iter().flatten().all(|t| t.is_finite());
        let signals = [("q", &self.q, true), ("tau", &self.tau, true), ("temperature", &self.temperature, warm)];
        for (kind, signals, _) in signals.into_iter().filter(|(.., there)| *there) {
            named.extend(signals.iter().enumerate().map(|(j, s)| (format!("{kind}{}", j + 1), s.as_slice())));
        }
        write_model_columns(path, &named)?;
        Ok(())
    }
}
