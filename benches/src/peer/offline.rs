//! Off-line identification of a minute: `rivet identify` as a user runs it, beside numpy and Pinocchio.
//!
//! Twice: by the clock, both on all processors as they come (rivet shares records out, numpy its matrix products); and by
//! processor time on one of them, which other load on the machine leaves alone.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use rivet_benches::Workload;
use rivet_logs::write_columns;
use rustix::thread::CpuSet;

use crate::cpp::python;
use crate::table::Item;
use crate::{Figures, median, problem, run};

/// Length of the log [s].
const SECONDS: f64 = 60.0;

/// Runs both sides `repeats` times, one after the other.
pub(crate) fn compare(
    venv: Option<&Path>,
    [one, all]: [&CpuSet; 2],
    repeats: usize,
    folder: &Path,
) -> Result<Vec<Item>> {
    let workload = Workload::long(SECONDS)?;
    let (log, data) = (folder.join("log.parquet"), folder.join("long.txt"));
    write_log(&workload, &log)?;
    problem::write(&workload, &data)?;
    let script = rivet_benches::workload::project().join("benches/peer/offline.py");
    let robot = rivet_benches::workload::project().join(rivet_benches::workload::ROBOT);
    let rivet = rivet()?;
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    for _ in 0..repeats.max(1) {
        for (cpus, one) in [(one, true), (all, false)] {
            crate::pin(cpus)?;
            let (start, clock) = (children_ms()?, Instant::now());
            let output = Command::new(&rivet).arg("identify").arg(&robot).arg(&log).output()?;
            if !output.status.success() {
                bail!("rivet identify: {}", String::from_utf8_lossy(&output.stderr));
            }
            let passed = clock.elapsed().as_secs_f64() * 1e3;
            let (name, cost) = if one { ("one", children_ms()? - start) } else { ("all", passed) };
            ours.push(Figures::from([(name.to_owned(), cost)]));
            let threads = [("OPENBLAS_NUM_THREADS", "1"), ("OMP_NUM_THREADS", "1")];
            let threads = threads.into_iter().filter(|_| one);
            match run(Command::new(python(venv)).arg(&script).arg(&data).envs(threads), cpus) {
                Ok(figures) => theirs.push(named(&figures, one)),
                Err(why) => println!("no Python peer: {why:#}\n(pip install pin numpy scipy, then --venv)"),
            }
        }
    }
    let (ours, theirs) = (median(&ours), median(&theirs));
    let row = |name: &str, ours_as: &str, peer: &str, goal: Option<(f64, f64)>| Item {
        name: name.to_owned(),
        rivet: ours.get(ours_as).copied(),
        peer: theirs.get(peer).copied(),
        goal,
    };
    Ok(vec![
        row("by the clock / bare lstsq", "all", "bare-all", Some((15.0, 30.0))),
        row("by the clock / filtered lstsq", "all", "filtered-all", None),
        row("processor time / bare lstsq", "one", "bare-one", None),
        row("processor time / filtered lstsq", "one", "filtered-one", None),
    ])
}

/// The figures that belong to one processor, or to all of them.
fn named(figures: &Figures, one: bool) -> Figures {
    let pick = |(name, value): (&String, &f64)| match (name.strip_suffix("_passed"), one) {
        (None, true) => Some((format!("{name}-one"), *value)),
        (Some(job), false) => Some((format!("{job}-all"), *value)),
        _ => None,
    };
    figures.iter().filter_map(pick).collect()
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
