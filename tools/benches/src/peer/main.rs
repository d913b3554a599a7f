//! `rivet-peer`: rivet beside the same work in C++ (Pinocchio and Eigen) and Python (numpy and Pinocchio).
//!
//! Both sides run alternately, pinned to one core, within one run; only ratios are reported against goals. What is
//! missing on this machine is named, and the Rust side is measured all the same.

mod cpp;
mod offline;
mod problem;
mod table;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use clap::Parser;
use rivet_benches::{Kernel, Workload, kernel};
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

use table::{Item, markdown};

/// What a call costs beside the same work in C++ and Python.
#[derive(Parser)]
#[command(name = "rivet-peer")]
struct Args {
    /// Virtual environment with `pip install pin numpy scipy`; else the Python on the path.
    #[arg(long, value_name = "DIR")]
    venv: Option<PathBuf>,
    /// Eigen's headers.
    #[arg(long, value_name = "DIR", default_value = "/usr/include/eigen3")]
    eigen: PathBuf,
    /// Core that everything is pinned to.
    #[arg(long, default_value_t = 1)]
    cpu: usize,
    /// How often both sides run, one after the other; the median counts.
    #[arg(long, default_value_t = 5)]
    repeats: usize,
    /// Time for each kernel in each run [s].
    #[arg(long, default_value_t = 0.3)]
    seconds: f64,
    /// Leaves out the off-line identification.
    #[arg(long)]
    no_offline: bool,
    /// Leaves the problem files and the log here.
    #[arg(long, value_name = "DIR")]
    keep: Option<PathBuf>,
    /// Also writes what it prints.
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// Measures the Rust side alone, once, and prints it as lines of `name nanoseconds`.
    #[arg(long, hide = true)]
    measure: bool,
    /// With it: only the kernels named, as a profiler wants them.
    #[arg(long, hide = true, requires = "measure", value_name = "NAME")]
    only: Vec<String>,
    /// The same of the off-line fit, in milliseconds.
    #[arg(long, hide = true)]
    fit: bool,
}

/// Named figures of one run.
type Figures = BTreeMap<String, f64>;

fn main() -> Result<()> {
    let args = Args::parse();
    if args.measure {
        return measure(args.seconds, &args.only);
    }
    if args.fit {
        return offline::fit();
    }
    let workload = Workload::new()?;
    let temporary = tempfile::tempdir()?;
    let folder = args.keep.as_deref().unwrap_or(temporary.path());
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let problem = folder.join("problem.txt");
    problem::write(&workload, &problem)?;
    let arm = rivet_benches::workload::ROBOT;
    let mut text = format!("{arm}, {} base parameters; rust {}\n{}\n", workload.robot.base.len(), target(), machine());
    let peer = cpp::build(args.venv.as_deref(), &args.eigen);
    if let Err(why) = &peer {
        let _ = writeln!(text, "no C++ peer: {why:#}");
    }
    let own = std::env::current_exe().context("path of this program")?;
    let seconds = args.seconds.to_string();
    let all = sched_getaffinity(None).context("the cores to work on")?;
    let mut one = CpuSet::new();
    one.set(args.cpu);
    let (mut rust, mut other) = (Vec::new(), Vec::new());
    for _ in 0..args.repeats.max(1) {
        rust.push(run(Command::new(&own).args(["--measure", "--seconds", &seconds]), &one)?);
        if let Ok(peer) = &peer {
            other.push(run(Command::new(peer).arg(&problem).arg(&seconds), &one)?);
        }
    }
    let (rust, other) = (median(&rust), median(&other));
    let checks = problem::checks(&workload);
    for (name, value) in &checks {
        if let Some(theirs) = other.get(name)
            && (value - theirs).abs() > 1e-9 * value.abs()
        {
            bail!("the two sides did not do the same work: {name} is {value:e} here and {theirs:e} there");
        }
    }
    let _ = write!(text, "\n{}", markdown("item, ns", &items(&workload, &rust, &other)));
    if !args.no_offline {
        let items = offline::compare(args.venv.as_deref(), [&one, &all], args.repeats.min(3), folder)?;
        let _ = write!(text, "\n{}", markdown("60 s at 1 kHz, off line, ms", &items));
    }
    print!("{text}");
    args.markdown
        .map_or(Ok(()), |path| rivet_files::write_whole(&path, text).with_context(|| path.display().to_string()))
}

/// Rows of the table: what is compared with what, and the goal of the ratio.
fn items(workload: &Workload, rust: &Figures, other: &Figures) -> Vec<Item> {
    let decimation = workload.robot.config.signal.decimation as f64;
    let peer = |name: &str| other.get(name).copied();
    let mean = |slow: &str| Some(peer("front")? + (peer(slow)? - peer("front")?) / decimation);
    let row = |name: &str, kernel: Kernel, peer: Option<f64>, goal: Option<(f64, f64)>| Item {
        name: name.to_owned(),
        rivet: rust.get(kernel.name()).copied(),
        peer,
        goal,
    };
    vec![
        row("regressor", Kernel::Regressor, peer("regressor"), Some((3.0, 5.0))),
        row("model filter, one period", Kernel::Filter, peer("filter"), None),
        row("period without rows", Kernel::Front, peer("front"), None),
        row("period, unsupervised", Kernel::Plain, peer("plain"), None),
        row("period, supervised", Kernel::Supervised, peer("supervised"), Some((5.0, 10.0))),
        row(&format!("the same, rows 1 in {decimation}"), Kernel::Default, mean("supervised"), None),
        row("period, eigen (sliced)", Kernel::Eigen, peer("supervised"), None),
        row("period, tracked", Kernel::Tracked, peer("supervised"), Some((5.0, 10.0))),
        row("period, columns", Kernel::Columns, None, None),
        row("period, least squares (UD)", Kernel::LeastSquares, None, None),
        row("inverse dynamics", Kernel::InverseDynamics, None, None),
    ]
}

/// Prints the median time of every kernel, or of those named.
fn measure(seconds: f64, only: &[String]) -> Result<()> {
    let workload = Workload::new()?;
    for item in Kernel::ALL.into_iter().filter(|item| only.is_empty() || only.iter().any(|name| name == item.name())) {
        let mut call = kernel(&workload, item)?;
        println!("{} {:.6}", item.name(), time(seconds, &mut call));
    }
    Ok(())
}

/// Median over batches of at least 0.5 ms of the time of one call [ns].
fn time(seconds: f64, call: &mut dyn FnMut()) -> f64 {
    let mut count = 1_u32;
    let batch = |count: u32, call: &mut dyn FnMut()| {
        let start = Instant::now();
        (0..count).for_each(|_| call());
        start.elapsed().as_secs_f64()
    };
    let mut once = batch(count, call);
    while once < 5e-4 {
        count *= 2;
        once = batch(count, call);
    }
    let batches = ((seconds / once) as usize).max(11);
    let mut times: Vec<f64> = (0..batches).map(|_| batch(count, call) / f64::from(count) * 1e9).collect();
    times.sort_by(f64::total_cmp);
    times[batches / 2]
}

/// Runs a side on some cores and reads its figures.
fn run(command: &mut Command, cpus: &CpuSet) -> Result<Figures> {
    pin(cpus)?;
    let output = command.output().with_context(|| format!("{}", command.get_program().display()))?;
    if !output.status.success() {
        let name = command.get_program().display();
        bail!("{name}: {}\n{}", output.status, String::from_utf8_lossy(&output.stderr));
    }
    let text = String::from_utf8(output.stdout)?;
    let figure = |line: &str| -> Option<(String, f64)> {
        let (name, value) = line.rsplit_once(' ')?;
        Some((name.to_owned(), value.parse().ok()?))
    };
    Ok(text.lines().filter_map(figure).collect())
}

/// This process, and those it starts, on some cores.
fn pin(cpus: &CpuSet) -> Result<()> {
    sched_setaffinity(None, cpus).context("the cores to work on")
}

fn median(runs: &[Figures]) -> Figures {
    let each = |name: &String| {
        let mut values: Vec<f64> = runs.iter().filter_map(|run| run.get(name).copied()).collect();
        values.sort_by(f64::total_cmp);
        (name.clone(), values[values.len() / 2])
    };
    runs.iter().flat_map(BTreeMap::keys).map(each).collect()
}

fn target() -> &'static str {
    if cfg!(target_feature = "avx512f") {
        "built for AVX-512"
    } else if cfg!(target_feature = "avx2") {
        "built for AVX2"
    } else {
        "built for the default target"
    }
}

/// Processor and load, in one line.
fn machine() -> String {
    let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
    let info = read("/proc/cpuinfo");
    let field = |name: &str| {
        let line = info.lines().find(|line| line.starts_with(name)).and_then(|line| line.split(':').nth(1));
        line.unwrap_or("?").trim().to_owned()
    };
    let load = read("/proc/loadavg");
    format!(
        "{} (family {}, model {}), load {}",
        field("model name"),
        field("cpu family"),
        field("model\t"),
        load.split(' ').next().unwrap_or("?")
    )
}
