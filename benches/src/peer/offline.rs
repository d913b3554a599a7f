//! Off-line identification of a minute: `rivet identify` as a user runs it, beside numpy and Pinocchio.
//!
//! Both work on one thread; what counts is processor time, which other load on the machine leaves alone.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};
use rivet_benches::Workload;
use rivet_logs::write_columns;

use crate::cpp::python;
use crate::table::Item;
use crate::{Figures, median, problem, run};

/// Length of the log [s].
const SECONDS: f64 = 60.0;

/// Runs both sides `repeats` times, one after the other.
pub(crate) fn compare(venv: Option<&Path>, cpu: usize, repeats: usize, folder: &Path) -> Result<Vec<Item>> {
    let workload = Workload::long(SECONDS)?;
    let (log, data) = (folder.join("log.parquet"), folder.join("long.txt"));
    write_log(&workload, &log)?;
    problem::write(&workload, &data)?;
    let script = rivet_benches::workload::project().join("benches/peer/offline.py");
    let robot = rivet_benches::workload::project().join(rivet_benches::workload::ROBOT);
    let rivet = rivet()?;
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    for _ in 0..repeats.max(1) {
        crate::pin(cpu)?;
        let start = children_ms()?;
        let output = Command::new(&rivet).arg("identify").arg(&robot).arg(&log).output()?;
        if !output.status.success() {
            bail!("rivet identify: {}", String::from_utf8_lossy(&output.stderr));
        }
        ours.push(Figures::from([("identify".to_owned(), children_ms()? - start)]));
        let threads = [("OPENBLAS_NUM_THREADS", "1"), ("OMP_NUM_THREADS", "1")];
        match run(Command::new(python(venv)).arg(&script).arg(&data).envs(threads), cpu) {
            Ok(figures) => theirs.push(figures),
            Err(why) => println!("no Python peer: {why:#}\n(pip install pin numpy scipy, then --venv)"),
        }
    }
    let (ours, theirs) = (median(&ours), median(&theirs));
    let identify = ours.get("identify").copied();
    let row = |name: &str, peer: &str, goal: Option<(f64, f64)>| Item {
        name: name.to_owned(),
        rivet: identify,
        peer: theirs.get(peer).copied(),
        goal,
    };
    Ok(vec![
        row("rivet identify / bare lstsq", "bare", Some((15.0, 30.0))),
        row("rivet identify / filtered lstsq", "filtered", None),
    ])
}

/// Processor time of all children that have ended [ms], in the kernel's ticks of 10 ms.
fn children_ms() -> Result<f64> {
    let text = std::fs::read_to_string("/proc/self/stat").context("/proc/self/stat")?;
    // After the name in brackets: state is field 3, cutime and cstime are fields 16 and 17 (proc(5)).
    let fields = text.rsplit(')').next().unwrap_or_default().split_whitespace().skip(13).take(2);
    let ticks: f64 = fields.filter_map(|field| field.parse::<f64>().ok()).sum();
    Ok(ticks * 1e3 / rustix::param::clock_ticks_per_second() as f64)
}

/// The command line beside this program.
fn rivet() -> Result<PathBuf> {
    let own = std::env::current_exe().context("path of this program")?;
    let rivet = own.with_file_name("rivet");
    if !rivet.is_file() {
        bail!("{} is not there: `cargo build --release` first", rivet.display());
    }
    Ok(rivet)
}

/// The log as the robot would have written it.
fn write_log(workload: &Workload, path: &Path) -> Result<()> {
    let (n, len) = (workload.robot.dof(), workload.len);
    let zero = &workload.robot.config.log.joint_zero;
    let period = workload.robot.config.sample_period_s;
    let s = &workload.samples;
    let mut columns = vec![("t".to_owned(), (0..len).map(|k| k as f64 * period).collect::<Vec<f64>>())];
    for (name, signal, shift) in [
        ("q", &s.q, true),
        ("tau", &s.tau, false),
        ("q_des", &s.q_des, true),
        ("qd_des", &s.qd_des, false),
        ("qdd_des", &s.qdd_des, false),
    ] {
        for j in 0..n {
            let by = if shift { zero.get(j).copied().unwrap_or(0.0) } else { 0.0 };
            columns.push((format!("{name}{}", j + 1), (0..len).map(|k| signal[k * n + j] - by).collect()));
        }
    }
    let slices: Vec<(&str, &[f64])> = columns.iter().map(|(name, values)| (name.as_str(), &values[..])).collect();
    Ok(write_columns(path, &slices)?)
}
