//! A log as the robot controller would have sent it, and a parameter stream as a file.

use anyhow::{Context, Result};
use rivet_config::Robot;
use rivet_ipc_schema::{JointState, MAX_JOINTS, Parameters, Setpoint};
use rivet_logs::{Log, ReadOptions, ResampleReport};
use std::io::Write;
use std::path::Path;

/// One period of a log: what the robot measured and, when the log has it, what it was asked to do.
pub(crate) struct Period {
    pub(crate) state: JointState,
    pub(crate) setpoint: Option<Setpoint>,
}

/// A log on the grid of the robot's sample period.
pub(crate) struct Recording {
    log: Log,
    joints: usize,
    /// What resampling did to the log.
    pub(crate) report: ResampleReport,
    period_s: f64,
}

impl Recording {
    /// Reads `path` as a log of `robot`, with torque, and puts it on the grid of its sample period.
    pub(crate) fn read(robot: &Robot, path: &Path) -> Result<Recording> {
        let config = &robot.config;
        let joints = robot.model.arm.dof();
        let options = ReadOptions {
            joints,
            drive_gain: config.drive.drive_gain.as_deref(),
            joint_zero: Some(&config.log.joint_zero),
        };
        let log = rivet_logs::read(path, &options)?;
        log.torque()?;
        let (log, report) = log.resample(config.sample_period_s)?;
        Ok(Recording { log, joints, report, period_s: config.sample_period_s })
    }

    /// Number of periods.
    pub(crate) fn len(&self) -> usize {
        self.log.len()
    }

    /// Period `k`. Stamps count from the log's start, so that two replays send the same bytes.
    pub(crate) fn period(&self, k: usize) -> Period {
        let seq = k as u64 + 1;
        let stamp_ns = (k as f64 * self.period_s * 1e9).round() as u64;
        let at = |signals: &Vec<Vec<f64>>| {
            let mut row = [0.0; MAX_JOINTS];
            for (out, signal) in row.iter_mut().zip(signals) {
                *out = signal[k];
            }
            row
        };
        let mut state = JointState { seq, stamp_ns, joints: self.joints as u32, ..JointState::default() };
        state.q = at(&self.log.q);
        if let Some((_, tau)) = &self.log.tau {
            state.tau = at(tau);
        }
        if let Some(temperature) = &self.log.temperature {
            state.temperature[..self.joints].copy_from_slice(&at(temperature)[..self.joints]);
        }
        let setpoint = match (&self.log.q_des, &self.log.qd_des, &self.log.qdd_des) {
            (Some(q), Some(qd), Some(qdd)) => Some(Setpoint {
                seq,
                stamp_ns,
                q: at(q),
                qd: at(qd),
                qdd: at(qdd),
                joints: self.joints as u32,
                ..Setpoint::default()
            }),
            _ => None,
        };
        Period { state, setpoint }
    }
}

/// Writes a parameter stream as CSV: `epoch, seq`, then value and standard deviation of every base parameter.
///
/// Numbers are written with as many digits as it takes to read the same bits back: two equal files are equal streams.
pub(crate) fn write_stream(path: &Path, robot: &Robot, stream: &[Parameters]) -> Result<()> {
    let mut text = Vec::new();
    write!(text, "epoch,seq")?;
    for i in 0..robot.base.len() {
        let name = robot.base.name(&robot.model, i);
        write!(text, ",{name},{name}.std")?;
    }
    writeln!(text)?;
    for p in stream {
        write!(text, "{},{}", p.epoch, p.seq)?;
        for (value, std) in p.values[..p.len()].iter().zip(&p.std) {
            write!(text, ",{value},{std}")?;
        }
        writeln!(text)?;
    }
    write_atomically(path, &text)
}

/// Replaces `path` by `bytes`, or leaves it as it was.
pub(crate) fn write_atomically(path: &Path, bytes: &[u8]) -> Result<()> {
    let mut name = path.file_name().context("a file name is missing")?.to_owned();
    name.push(format!(".{}.tmp", std::process::id()));
    let temporary = path.with_file_name(name);
    let result = std::fs::write(&temporary, bytes).and_then(|()| std::fs::rename(&temporary, path));
    if result.is_err() {
        // The first error is the one to report; what is left of the temporary file goes.
        let _ = std::fs::remove_file(&temporary);
    }
    result.with_context(|| format!("cannot write {}", path.display()))
}
