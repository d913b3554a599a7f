//! Files that `rivet-sim` leaves: the truth, the log, the summary. Each appears complete or not at all.

use std::io::{self, BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;

use serde::Serialize;

use super::SimError;
use crate::stand_in::{Counts, Sample, TrackingBlock};
use crate::truth::{Disturbances, Truth};
use rivet_config::Robot;
use rivet_files::CONVENTIONS_OF_THE_MODEL;

pub(super) fn fails(path: &Path) -> impl FnOnce(io::Error) -> SimError {
    let path = path.to_owned();
    move |source| SimError::File { path, source }
}

/// Writes `value` as JSON, atomically.
pub(super) fn json(path: &Path, value: &impl Serialize) -> Result<(), SimError> {
    let text = serde_json::to_string_pretty(value).map_err(io::Error::other).map_err(fails(path))?;
    rivet_files::write_whole(path, rivet_files::printable_json(text) + "\n").map_err(fails(path))
}

/// A parameter of the true arm beside what the robot file says.
#[derive(Clone, Debug, Serialize)]
pub struct TrueParameter {
    /// Its name.
    pub name: String,
    /// True value, in the parameter's unit.
    pub value: f64,
    /// Nominal value.
    pub nominal: f64,
}

/// Content of the file of `--truth-out`.
#[derive(Clone, Debug, Serialize)]
pub struct TruthFile {
    /// Robot's name.
    pub robot: String,
    /// Hash of the model that the base parameters belong to, 16 hexadecimal digits.
    pub model_hash: String,
    /// Seed of noise, motion and drawn disturbances.
    pub seed: u64,
    /// Standard parameters, in the model's order.
    pub standard: Vec<TrueParameter>,
    /// Base parameters, in the order of the base set.
    pub base: Vec<TrueParameter>,
}

impl TruthFile {
    pub(super) fn new(robot: &Robot, truth: &Truth, disturbances: &Disturbances) -> Self {
        let standard = truth.standard(&robot.model);
        let base = robot.base.from_standard(&standard);
        let row =
            |name: String, (value, nominal): (&f64, &f64)| TrueParameter { name, value: *value, nominal: *nominal };
        let names = robot.model.parameters.iter().map(|p| p.name(&robot.model.arm));
        Self {
            robot: robot.config.name.clone(),
            model_hash: format!("{:016x}", robot.hash),
            seed: disturbances.seed,
            standard: names.zip(standard.iter().zip(&robot.nominal)).map(|(n, v)| row(n, v)).collect(),
            base: (0..robot.base.len())
                .map(|i| robot.base.name(&robot.model, i))
                .zip(base.iter().zip(&robot.nominal_base))
                .map(|(n, v)| row(n, v))
                .collect(),
        }
    }
}

/// What a run came to; the file of `--summary-out` and the last line on standard output.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Robot's name.
    pub robot: String,
    /// Why it ended: `duration`, `setpoints` (the file is over) or `signal`.
    pub ended: &'static str,
    /// How often what happened.
    #[serde(flatten)]
    pub counts: Counts,
    /// Moving periods for which simulated time waited in vain (`--lockstep`).
    pub lockstep_timeouts: u64,
    /// Periods that the machine skipped: simulated time stood still.
    pub overruns: u64,
    /// Periods each drive spent at its torque limit.
    pub saturated: Vec<u64>,
    /// Tracking error by stretches of five seconds of motion.
    pub tracking: Vec<TrackingBlock>,
}

/// Writes the log on a thread of its own, so that a slow disk does not stop the arm.
pub(super) struct LogWriter {
    rows: Sender<Sample>,
    thread: JoinHandle<io::Result<()>>,
    path: PathBuf,
}

/// Ends of names that say that a file is no CSV.
const OTHER_FORMATS: [&str; 7] = ["parquet", "mcap", "db3", "h5", "hdf5", "npz", "json"];

impl LogWriter {
    /// The log has the numbers of the bus, and states this.
    pub(super) fn create(path: &Path, joints: usize) -> Result<Self, SimError> {
        // A reader would believe the name.
        if path.extension().is_some_and(|end| OTHER_FORMATS.iter().any(|other| end.eq_ignore_ascii_case(other))) {
            let mend = "--log-out writes CSV; name it .csv, and `rivet convert` writes other formats of it";
            return Err(SimError::Option(format!("{}: {mend}", path.display())));
        }
        rivet_files::writable(path).map_err(fails(path))?;
        let (rows, queue) = channel::<Sample>();
        let target = path.to_owned();
        let thread = std::thread::spawn(move || {
            rivet_files::fill_whole(&target, |part| {
                let mut file = BufWriter::new(part);
                write!(file, "# rivet: {CONVENTIONS_OF_THE_MODEL}\nt")?;
                for what in ["q", "tau", "q_des", "qd_des", "qdd_des"] {
                    for j in 1..=joints {
                        write!(file, ",{what}{j}")?;
                    }
                }
                writeln!(file)?;
                for s in queue {
                    // Rounded to nanoseconds: multiples of a period that is no binary fraction are not pretty otherwise.
                    write!(file, "{}", (s.t_s * 1e9).round() / 1e9)?;
                    for x in [s.q, s.tau, s.q_des, s.qd_des, s.qdd_des].iter().flat_map(|v| &v[..joints]) {
                        write!(file, ",{x}")?;
                    }
                    writeln!(file)?;
                }
                file.flush()
            })
        });
        Ok(Self { rows, thread, path: path.to_owned() })
    }

    pub(super) fn push(&self, sample: &Sample) {
        // The writer ends early only when the disk fails; that is reported at the end.
        let _ = self.rows.send(*sample);
    }

    pub(super) fn finish(self) -> Result<(), SimError> {
        drop(self.rows);
        let written = self.thread.join().unwrap_or_else(|_| Err(io::Error::other("the log's writer failed")));
        written.map_err(fails(&self.path))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_of_another_format_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let create = |name: &str| LogWriter::create(&folder.path().join(name), 6);
        let why = create("run.Parquet").err().expect("refused").to_string();
        assert!(why.contains("run.Parquet: --log-out writes CSV"), "{why}");
        create("run.csv").expect("CSV").finish().expect("written");
    }
}
