//! A log as the robot controller would have sent it, and a parameter stream as a file.

use crate::table::number;
use anyhow::{Context, Result};
use rivet_analysis::coarse::{TorqueSteps, torque_steps};
use rivet_analysis::doubts::doubted;
use rivet_analysis::evidence::{self, Distrust};
use rivet_analysis::fault::Fault;
use rivet_analysis::reading;
use rivet_analysis::runs::{hole_s, not_derived, read_log, short_name};
use rivet_config::Robot;
use rivet_dynamics::Joint;
use rivet_estimation::offline::{Trajectory, position_step, unfollowed};
use rivet_ipc_schema::{JointState, LinkState, MAX_JOINTS, Parameters, Setpoint};
use rivet_logs::{Log, ResampleReport};
use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};

/// One period of a log: what the robot measured and, when the log has it, what it was asked to do.
pub(crate) struct Period {
    pub(crate) state: JointState,
    pub(crate) setpoint: Option<Setpoint>,
    /// Where the log has a second encoder of every joint.
    pub(crate) link: Option<LinkState>,
}

/// A log on the grid of the robot's sample period. Where its time has a hole, sequence numbers are missing, as they would
/// be from a robot controller that was silent: nothing is made up.
pub(crate) struct Recording {
    path: PathBuf,
    pieces: Vec<Stretch>,
    joints: usize,
    /// What resampling did to the log.
    pub(crate) report: ResampleReport,
    period_s: f64,
    /// Torque channels that cannot be believed.
    pub(crate) distrusts: Vec<Distrust>,
    /// Torques in steps.
    pub(crate) torque_steps: Vec<TorqueSteps>,
    /// What of the positions the daemon takes for jumps or frozen readings, whatever it says of them.
    pub(crate) coarse: Option<String>,
}

/// Rows without a hole: how many rows come before, and the first sequence number.
struct Stretch {
    log: Log,
    before: usize,
    first_seq: u64,
}

impl Recording {
    /// Reads `path` as a log of `robot`, with torque, and puts it on the grid of its sample period.
    pub(crate) fn read(robot: &Robot, path: &Path) -> Result<Recording> {
        let config = &robot.config;
        let joints = robot.model.arm.dof();
        let log = read_log(robot, path)?;
        let mut distrusts = doubted(robot, &log)?;
        distrusts.extend(reading::distrust(robot, &log));
        let period_s = config.sample_period_s;
        let begin = log.t.first().copied().unwrap_or(0.0);
        let mut pieces: Vec<Stretch> = Vec::new();
        let mut first_report = None;
        for piece in log.split_at_gaps(hole_s(log.median_step_s())) {
            let (grid, report) = piece.resample(period_s)?;
            let (before, least) = pieces.last().map_or((0, 1), |last| {
                // A hole leaves out one number at the least.
                (last.before + last.log.len(), last.first_seq + last.log.len() as u64 + 1)
            });
            let first_seq = ((piece.t[0] - begin) / period_s).round() as u64 + 1;
            pieces.push(Stretch { log: grid, before, first_seq: first_seq.max(least) });
            first_report.get_or_insert(report);
        }
        let underived = pieces.iter().flat_map(|piece| not_derived(&piece.log, period_s)).collect();
        distrusts.extend(evidence::underived(robot, &short_name(path), &underived));
        reading::first(&mut distrusts);
        let report = first_report
            .ok_or_else(|| Fault::Data(format!("{}: no ten rows without a hole in time", path.display())))?;
        let (coarse, torque_steps) = (coarse(robot, &log, &report), torque_steps(&log));
        Ok(Recording { path: path.to_owned(), pieces, joints, report, period_s, distrusts, torque_steps, coarse })
    }

    /// The log's file.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Number of periods.
    pub(crate) fn len(&self) -> usize {
        self.pieces.last().map_or(0, |last| last.before + last.log.len())
    }

    /// Sequence number of the last period.
    pub(crate) fn last_seq(&self) -> u64 {
        self.pieces.last().map_or(0, |last| last.first_seq + last.log.len() as u64 - 1)
    }

    /// Periods that the log's holes leave out.
    pub(crate) fn missing(&self) -> u64 {
        self.last_seq() - self.len() as u64
    }

    /// The joints that move and do not follow the setpoints sent with them.
    pub(crate) fn unfollowed(&self) -> BTreeSet<usize> {
        let unfollowed_in = |Stretch { log, .. }: &Stretch| match &log.q_des {
            Some(plan) => {
                let [measured, desired] = [&log.q, plan].map(|q| Trajectory::from_positions(q, self.period_s));
                unfollowed(&measured, &desired, self.period_s)
            }
            None => Vec::new(),
        };
        self.pieces.iter().flat_map(unfollowed_in).collect()
    }

    /// The stretch of period `k`, and its row there.
    fn place(&self, k: usize) -> (&Stretch, usize) {
        let piece = self.pieces.partition_point(|piece| piece.before <= k).saturating_sub(1);
        (&self.pieces[piece], k - self.pieces[piece].before)
    }

    /// Sequence number of period `k`.
    pub(crate) fn seq(&self, k: usize) -> u64 {
        let (stretch, row) = self.place(k);
        stretch.first_seq + row as u64
    }

    /// Period `k`. Stamps count from the log's start, so that two replays send the same bytes.
    pub(crate) fn period(&self, k: usize) -> Period {
        let seq = self.seq(k);
        let (Stretch { log, .. }, k) = self.place(k);
        let stamp_ns = ((seq - 1) as f64 * self.period_s * 1e9).round() as u64;
        let at = |signals: &Vec<Vec<f64>>| {
            let mut row = [0.0; MAX_JOINTS];
            for (out, signal) in row.iter_mut().zip(signals) {
                *out = signal[k];
            }
            row
        };
        let mut state = JointState { seq, stamp_ns, joints: self.joints as u32, ..JointState::default() };
        state.q = at(&log.q);
        if let Some((_, tau)) = &log.tau {
            state.tau = at(tau);
        }
        if let Some(temperature) = &log.temperature {
            state.temperature[..self.joints].copy_from_slice(&at(temperature)[..self.joints]);
        }
        // Derivatives that a log lacks are left at 0: the daemon then makes both of the positions.
        let rate = |signals: &Option<Vec<Vec<f64>>>| signals.as_ref().map_or([0.0; MAX_JOINTS], at);
        let setpoint = log.q_des.as_ref().map(|q| Setpoint {
            seq,
            stamp_ns,
            q: at(q),
            qd: rate(&log.qd_des),
            qdd: rate(&log.qdd_des),
            joints: self.joints as u32,
            ..Setpoint::default()
        });
        let mut link = LinkState { seq, stamp_ns, joints: self.joints as u32, ..LinkState::default() };
        for (out, signal) in link.q.iter_mut().zip(&log.q_link) {
            *out = signal.as_ref().map_or(f64::NAN, |signal| signal[k]);
        }
        let link = link.q[..self.joints].iter().all(|q| q.is_finite()).then_some(link);
        Period { state, setpoint, link }
    }
}

/// A position whose steps are so many times those of the robot file is of another encoder.
const COARSER: f64 = 2.0;
/// A step is a jump to the daemon beyond this acceleration \[rad/s²\], and a reading that stands between two is frozen to it for four
/// samples at this speed \[rad/s\].
const JUMPS: f64 = 500.0;
const STANDS: f64 = 4.0 * 0.2;

/// Why sound readings of a log look frozen to the daemon, or as if they jumped: each is held over samples, or comes in larger steps than the
/// robot file says.
fn coarse(robot: &Robot, log: &Log, report: &ResampleReport) -> Option<String> {
    let period_s = robot.config.sample_period_s;
    if let Some(samples) = evidence::held_rows(report, period_s) {
        return Some(format!(
            "each position is held for {samples:.0} samples of {} ms, as by a source of {} Hz, and what stands for more than four is refused as \
             frozen: give the daemon the source's own rate",
            number(1e3 * period_s, 3),
            number(1.0 / (samples * period_s), 3),
        ));
    }
    let coarse_step = |(q, (joint, resolution)): (&Vec<f64>, (&Joint, &f64))| {
        let least = (JUMPS * period_s * period_s).min(STANDS * period_s);
        let step = position_step(q).filter(|step| *step > least.max(COARSER * resolution))?;
        Some(format!("{} {} for {}", joint.name, number(step, 2), number(*resolution, 2)))
    };
    let joints = robot.model.arm.joints.iter().zip(&robot.config.drive.encoder_resolution);
    let coarser: Vec<String> = log.q.iter().zip(joints).filter_map(coarse_step).collect();
    (!coarser.is_empty()).then(|| {
        format!(
            "positions come in larger steps than [drive] encoder_resolution ({} rad): a step looks like a jump, and \
             the rows between two like a frozen reading. Set it to the steps",
            coarser.join(", ")
        )
    })
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
    rivet_files::write_whole(path, &text).with_context(|| format!("cannot write {}", path.display()))
}
