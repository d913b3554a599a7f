//! The flight recorder: what was measured, planned and commanded in the last second before a stop.

use crate::law::Desired;
use rivet_ipc_schema::{Command, JointState};
use std::collections::VecDeque;
use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

/// Pairs of sample and command that are kept.
pub const RECORDED: usize = 1000;

/// Flight records that are kept, the newest with number 0.
const FILES: usize = 4;

/// One answered sample.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    /// What was measured.
    pub sample: JointState,
    /// The plan that was followed, if any.
    pub plan: Option<Desired>,
    /// The answer.
    pub command: Command,
}

/// The last pairs, and where they go.
#[derive(Debug)]
pub struct Recorder {
    pairs: VecDeque<Pair>,
    folder: PathBuf,
    robot: String,
    joints: usize,
}

impl Recorder {
    /// Records of `robot` with `joints` joints go to `folder`.
    pub fn new(folder: &Path, robot: &str, joints: usize) -> Recorder {
        Recorder {
            pairs: VecDeque::with_capacity(RECORDED),
            folder: folder.to_owned(),
            robot: robot.to_owned(),
            joints,
        }
    }

    /// Takes in one pair; the oldest goes.
    pub fn push(&mut self, pair: &Pair) {
        if self.pairs.len() == RECORDED {
            self.pairs.pop_front();
        }
        self.pairs.push_back(*pair);
    }

    fn path(&self, number: usize) -> PathBuf {
        self.folder.join(format!("{}.{number}.flight.csv", self.robot))
    }

    /// Writes what is kept to a file of its own and returns its path; older records move up, the oldest goes. The file is a
    /// log as every other: `rivet identify`, `predict` and `replay` read it.
    ///
    /// # Errors
    /// It cannot be written; earlier records are as they were, under the same or the next number.
    pub fn write(&self) -> io::Result<PathBuf> {
        fs::create_dir_all(&self.folder)?;
        let temporary = self.folder.join(format!("{}.flight.tmp{}", self.robot, std::process::id()));
        let mut file = File::create(&temporary)?;
        file.write_all(self.text().as_bytes())?;
        file.sync_all()?;
        for number in (1..FILES).rev() {
            match fs::rename(self.path(number - 1), self.path(number)) {
                Err(why) if why.kind() != io::ErrorKind::NotFound => return Err(why),
                _ => {}
            }
        }
        fs::rename(&temporary, self.path(0))?;
        Ok(self.path(0))
    }

    fn text(&self) -> String {
        let n = self.joints;
        let columns = ["q", "tau", "q_des", "qd_des", "qdd_des", "command"];
        let mut text = String::from("t,seq,faults");
        for column in columns {
            for j in 1..=n {
                let _ = write!(text, ",{column}{j}");
            }
        }
        text.push('\n');
        let first = self.pairs.front().map_or(0, |pair| pair.sample.stamp_ns);
        for Pair { sample, plan, command } in &self.pairs {
            let t = sample.stamp_ns.saturating_sub(first) as f64 * 1e-9;
            let _ = write!(text, "{t:.9},{},{}", sample.seq, sample.faults);
            // Without a plan the arm was to stay where it was.
            let plan = plan.unwrap_or(Desired { q: sample.q, ..Desired::default() });
            for values in [&sample.q, &sample.tau, &plan.q, &plan.qd, &plan.qdd, &command.tau] {
                for value in &values[..n] {
                    let _ = write!(text, ",{value}");
                }
            }
            text.push('\n');
        }
        text
    }
}
