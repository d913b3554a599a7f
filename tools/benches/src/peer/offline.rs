//! Off-line identification of a minute: `rivet identify` as a user runs it, beside numpy and Pinocchio.
//!
//! Beside the whole command, what the peer does of it alone: samples in memory to base parameters. Beside that, whole against whole: the command
//! and a script that starts, reads the samples, fits them and ends.
//!
//! Everything twice: by the clock, both on all processors as they come (rivet shares records out, numpy its matrix products); and by
//! processor time on one of them, which other load on the machine leaves alone.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use rivet_benches::Workload;
use rivet_estimation::offline::{
    Equations, InstrumentSource, Method, OfflineSettings, Record, Rows, Trajectory, solve,
};
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
    let [log, model, samples] = ["log.parquet", "model.txt", "samples.f64"].map(|name| folder.join(name));
    write_log(&workload, &log)?;
    problem::write_apart(&workload, &model, &samples)?;
    let script = rivet_benches::workload::project().join("tools/benches/peer/offline.py");
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
            let fits = run(Command::new(std::env::current_exe().context("path of this program")?).arg("--fit"), cpus)?;
            ours.push(named(&fits, one));
            let threads = [("OPENBLAS_NUM_THREADS", "1"), ("OMP_NUM_THREADS", "1")];
            let threads = threads.into_iter().filter(|_| one);
            let mut peer = Command::new(python(venv));
            peer.arg(&script).args([&model, &samples]).envs(threads);
            match run(&mut peer, cpus) {
                Ok(figures) => theirs.push(named(&figures, one)),
                Err(why) => {
                    println!("no Python peer: {why:#}\n(pip install pin numpy scipy, then --venv)");
                    continue;
                }
            }
            // The whole script, the quicker of its jobs alone.
            let (start, clock) = (children_ms()?, Instant::now());
            run(peer.arg("bare"), cpus)?;
            let passed = clock.elapsed().as_secs_f64() * 1e3;
            let (name, cost) = if one { ("script-one", children_ms()? - start) } else { ("script-all", passed) };
            theirs.push(Figures::from([(name.to_owned(), cost)]));
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
        row("command / whole script", "all", "script-all", Some((15.0, 30.0))),
        row("command / bare lstsq", "all", "bare-all", Some((15.0, 30.0))),
        row("command / filtered lstsq", "all", "filtered-all", None),
        row("command, one cpu / whole script", "one", "script-one", None),
        row("command, one cpu / bare", "one", "bare-one", None),
        row("command, one cpu / filtered", "one", "filtered-one", None),
        row("least squares / bare lstsq", "least_squares-all", "bare-all", Some((15.0, 30.0))),
        row("instruments / bare lstsq", "instrumental-all", "bare-all", None),
        row("least squares, one cpu / bare", "least_squares-one", "bare-one", None),
        row("instruments, one cpu / bare", "instrumental-one", "bare-one", None),
    ])
}

/// What the peer does, done here: samples in memory to base parameters; prints `JOB MILLISECONDS` of processor time and `JOB_passed
/// MILLISECONDS` by the clock, as the peer does.
pub(crate) fn fit() -> Result<()> {
    let workload = Workload::long(SECONDS)?;
    let jobs = [("least_squares", Method::LeastSquares), ("instrumental", Method::Instrumental)];
    for (name, method) in jobs {
        let signals = signals(&workload);
        let (start, clock) = (own_ms(), Instant::now());
        let values = estimate(&workload, signals, method)?;
        println!("{name} {}\n{name}_passed {}", own_ms() - start, clock.elapsed().as_secs_f64() * 1e3);
        if values.iter().any(|x| !x.is_finite()) {
            bail!("{name}: a value is not a number");
        }
    }
    Ok(())
}

/// Signals of the log, joint by joint.
struct Signals {
    q: Vec<Vec<f64>>,
    tau: Vec<Vec<f64>>,
    desired: Trajectory,
}

fn signals(workload: &Workload) -> Signals {
    let n = workload.robot.dof();
    let of = |signal: &[f64]| (0..n).map(|j| signal.iter().skip(j).step_by(n).copied().collect()).collect();
    let s = &workload.samples;
    let desired = Trajectory { q: of(&s.q_des), qd: of(&s.qd_des), qdd: of(&s.qdd_des) };
    Signals { q: of(&s.q), tau: of(&s.tau), desired }
}

/// Differences, rows and their solution. Least squares alone need no second motion: their instruments are never used, and made of the
/// motion that is there.
fn estimate(workload: &Workload, signals: Signals, method: Method) -> Result<Vec<f64>> {
    let (robot, signal) = (&workload.robot, &workload.robot.config.signal);
    let period_s = robot.config.sample_period_s;
    let settings = OfflineSettings {
        filter_hz: signal.model_filter_hz,
        filter_order: signal.model_filter_order,
        row_period_s: period_s * signal.decimation as f64,
        dead_zone: signal.dead_zone.clone(),
        instrument: match method {
            Method::Instrumental => InstrumentSource::Desired,
            Method::LeastSquares => InstrumentSource::Delayed(period_s),
        },
    };
    let Signals { q, tau, desired } = signals;
    let measured = Trajectory::from_positions(&q, period_s);
    let record = Record { period_s, measured, tau, desired: Some(desired), second: None };
    let rows = [Rows::new(&robot.model, &robot.base, &settings, &record)?];
    Ok(solve(&Equations::new(&rows), &robot.nominal_base, robot.config.estimator.prior, method)?)
}

/// Processor time of this process [ms].
fn own_ms() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
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
