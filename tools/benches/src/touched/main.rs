//! `rivet-touched`: how much memory a period touches, which is what it waits for when the caches have gone cold.
//!
//! Runs itself under callgrind with a simulated last-level cache of 1 MiB that is emptied before every period: what it then
//! misses are the lines of 64 bytes that the period reads or writes, each counted once, where it is touched first. Everything
//! counts: the identifier, the model, the sample, the stack, constants.

mod requests;

use std::fmt::Write as _;
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use clap::Parser;
use rivet_benches::Workload;
use rivet_estimation::{
    EigenSettings, Identifier, Instruments, Observer, Phase, Sample, Settings, Supervision, TrackedSettings,
};

/// Bytes of the simulated cache, and of a line.
const CACHE: usize = 1 << 20;
const LINE: usize = 64;
/// Bytes of the stack that count where it is asked about.
const STACK: usize = 16 << 10;

/// What a period touches of memory [KiB], mean and largest.
#[derive(Parser)]
#[command(name = "rivet-touched")]
struct Args {
    /// Periods that are counted, once the window is full.
    #[arg(long, default_value_t = 600)]
    ticks: usize,
    /// Leaves out what lies on the stack.
    #[arg(long)]
    no_stack: bool,
    /// Also writes the table.
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// Runs one case, to be called under callgrind.
    #[arg(long, hide = true)]
    case: Option<usize>,
}

/// What is run: scheme, whether rows come at the robot file's decimation, sources of instruments.
struct Case {
    scheme: &'static str,
    supervision: Supervision,
    decimated: bool,
    source: Source,
}

/// Where instruments come from.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Source {
    /// Only setpoints can be.
    Setpoint,
    /// Everything is at the ready, and setpoints are published.
    AutoPlanned,
    /// The same without setpoints: the previous cycle is found and followed.
    AutoCycle,
}

impl Source {
    fn name(self) -> &'static str {
        match self {
            Source::Setpoint => "setpoint",
            Source::AutoPlanned => "auto, setpoints published",
            Source::AutoCycle => "auto, previous cycle",
        }
    }
}

fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for (scheme, supervision) in [
        ("eigen", Supervision::Eigen(EigenSettings::default())),
        ("tracked", Supervision::Tracked(TrackedSettings::default())),
    ] {
        for decimated in [true, false] {
            for source in [Source::Setpoint, Source::AutoPlanned, Source::AutoCycle] {
                cases.push(Case { scheme, supervision, decimated, source });
            }
        }
    }
    cases
}

fn main() -> Result<()> {
    let args = Args::parse();
    if let Some(case) = args.case {
        return run(&cases()[case], &args);
    }
    ensure!(cfg!(target_arch = "x86_64"), "valgrind is asked in the words of x86-64 only");
    if Command::new("valgrind").arg("--version").output().is_err() {
        bail!("valgrind is missing (Debian: apt-get install valgrind); without it nothing can be counted");
    }
    eprintln!(
        "lines of {LINE} bytes that a period touches, as KiB: mean of {} periods, largest, by first touch",
        args.ticks
    );
    let mut table = String::from(
        "| case | mean | largest | differentiation | regressors, filters | sums of a row | supervision | instructions |\n\
         |---|---|---|---|---|---|---|---|\n",
    );
    let temporary = tempfile::tempdir()?;
    for (at, case) in cases().iter().enumerate() {
        let counts = count(at, &args, temporary.path())?;
        let ticks: Vec<u64> = counts.iter().map(|tick| tick.lines.iter().sum()).collect();
        let kib = |lines: f64| lines * LINE as f64 / 1024.0;
        let mean =
            |of: &dyn Fn(&Tick) -> u64| counts.iter().map(|tick| of(tick) as f64).sum::<f64>() / counts.len() as f64;
        let rows = if case.decimated { "rows decimated" } else { "a row a period" };
        let mut line = format!(
            "| {}, {rows}, {} | {:.0} |",
            case.scheme,
            case.source.name(),
            kib(mean(&|tick| tick.lines.iter().sum()))
        );
        let _ = write!(line, " {:.0} |", kib(ticks.iter().copied().max().unwrap_or(0) as f64));
        for phase in 0..4 {
            let largest = counts.iter().map(|tick| tick.lines[phase]).max().unwrap_or(0);
            let _ = write!(line, " {:.0} ({:.0}) |", kib(mean(&|tick| tick.lines[phase])), kib(largest as f64));
        }
        let _ = write!(line, " {:.0} |", mean(&|tick| tick.instructions));
        println!("{line}");
        let _ = writeln!(table, "{line}");
    }
    args.markdown
        .map_or(Ok(()), |path| rivet_files::write_whole(&path, table).with_context(|| path.display().to_string()))
}

/// One period: lines that it touches, phase by phase, and its instructions.
#[derive(Default)]
struct Tick {
    lines: [u64; 4],
    instructions: u64,
}

/// Every period of a case.
fn count(case: usize, args: &Args, folder: &Path) -> Result<Vec<Tick>> {
    let out = folder.join(format!("case{case}"));
    let own = std::env::current_exe().context("path of this program")?;
    let mut command = Command::new("valgrind");
    command.args(["-q", "--tool=callgrind", "--instr-atstart=no", "--cache-sim=yes", "--combine-dumps=yes"]);
    command.args(["--I1=32768,8,64", "--D1=32768,8,64", &format!("--LL={CACHE},32,{LINE}")]);
    command.arg(format!("--callgrind-out-file={}", out.display()));
    command.arg(own).args(["--case", &case.to_string(), "--ticks", &args.ticks.to_string()]);
    if args.no_stack {
        command.arg("--no-stack");
    }
    let done = command.output().context("valgrind")?;
    ensure!(done.status.success(), "valgrind: {}", String::from_utf8_lossy(&done.stderr));
    let counts = std::fs::read_to_string(&out).with_context(|| out.display().to_string())?;
    std::fs::remove_file(&out)?;
    let counts = parse(&counts)?;
    ensure!(counts.len() == args.ticks, "{} periods counted instead of {}", counts.len(), args.ticks);
    Ok(counts)
}

/// Instructions and the last-level cache's misses by data, from the dumps of callgrind.
fn parse(dumps: &str) -> Result<Vec<Tick>> {
    let (mut ticks, mut phase, mut columns) = (Vec::<Tick>::new(), None, [None; 3]);
    for line in dumps.lines() {
        if let Some(name) = line.strip_prefix("desc: Trigger: Client Request: ") {
            phase = name.parse::<usize>().ok().filter(|phase| *phase < 4);
        } else if let Some(events) = line.strip_prefix("events: ") {
            columns = ["DLmr", "DLmw", "Ir"].map(|wanted| events.split_whitespace().position(|event| event == wanted));
        } else if let Some(totals) = line.strip_prefix("summary: ") {
            let totals: Vec<u64> = totals.split_whitespace().map(str::parse).collect::<Result<_, _>>()?;
            let Some(phase) = phase.take() else { continue };
            // Zeros at the end are left out.
            let [read, written, instructions] =
                columns.map(|at| at.and_then(|at| totals.get(at)).copied().unwrap_or(0));
            if phase == 0 {
                ticks.push(Tick::default());
            }
            let tick = ticks.last_mut().context("a period begins with its first phase")?;
            tick.lines[phase] = read + written;
            tick.instructions += instructions;
        }
    }
    Ok(ticks)
}

/// One dump a phase.
struct Phases;

impl Observer for Phases {
    fn done(&mut self, phase: Phase) {
        requests::dump(match phase {
            Phase::Differentiate => c"0",
            Phase::Model => c"1",
            Phase::Estimate => c"2",
            Phase::Supervise => c"3",
        });
    }
}

/// Runs a case to its steady state, then counts.
fn run(case: &Case, args: &Args) -> Result<()> {
    let workload = Workload::new()?;
    let robot = &workload.robot;
    let decimation = if case.decimated { robot.config.signal.decimation } else { 1 };
    let settings = workload.settings(decimation);
    let instruments = match case.source {
        Source::Setpoint => Instruments::Setpoint,
        Source::AutoPlanned | Source::AutoCycle => Instruments::Auto { delay_s: 0.02, longest_cycle_s: 20.0 },
    };
    let settings = Settings { supervision: case.supervision, instruments, ..settings };
    let mut identifier =
        Identifier::new(Arc::clone(&robot.model), Arc::clone(&robot.base), &robot.nominal_base, &settings)
            .context("settings of the case")?;
    let sample = |k: usize| {
        let k = k % workload.len;
        let setpoint = (case.source != Source::AutoCycle).then(|| workload.planned(k));
        Sample {
            q: workload.row(&workload.samples.q, k),
            second: None,
            tau: workload.row(&workload.samples.tau, k),
            setpoint,
        }
    };
    // The history of a cycle is full after its longest length.
    let seconds = if case.source == Source::AutoCycle { 22.0 } else { 8.0 };
    let warm = (seconds / settings.sample_period_s) as usize;
    for k in 0..warm {
        identifier.push_sample(sample(k));
    }
    if case.source == Source::AutoCycle {
        ensure!(identifier.estimate().cycle_s.is_some(), "the motion's cycle was not found");
    }
    let others = vec![1_u64; CACHE / 8];
    requests::count();
    for k in warm..warm + args.ticks {
        let sample = sample(k);
        evict(&others);
        if args.no_stack {
            descend();
        }
        requests::zero();
        black_box(identifier.push_observed(sample, &mut Phases));
    }
    Ok(())
}

/// Fills the simulated cache with something else.
#[inline(never)]
fn evict(others: &[u64]) {
    let mut sum = 0;
    for line in others.chunks_exact(LINE / 8) {
        sum += black_box(line[0]);
    }
    black_box(sum);
}

/// Touches the stack that the period will use.
#[inline(never)]
fn descend() {
    let mut room = [0_u8; STACK];
    black_box(&mut room);
}
