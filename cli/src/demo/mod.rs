//! `rivet demo`: plant, daemon and controller as processes, one live screen, a diagnosis of the recorded run, the same arm on the
//! patched model, and a table at the end.

mod hidden;
mod screen;
mod table;

use crate::children::Children;
use crate::outputs::{Outputs, write_json};
use crate::table::show;
use anyhow::{Context, Result, bail};
use hidden::Hidden;
use rivet_analysis::fault::Fault;
use rivet_analysis::true_values::Reference;
use rivet_config::Robot;
use rivet_files::Draft;
use rivet_ipc_schema::{Bus, BusConfig, Health, JointState, Parameters, PrivateBus, RobotName, Setpoint, Subscriber};
use rivet_realtime::Shutdown;
use rivet_studies::phase_tracking::Tracking;
use screen::{Frame, Screen};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// Shows the whole loop and a diagnosis on this machine: no robot, no privileges, about a minute.
///
/// A simulated arm with wrong bodies, wrong friction, a payload and one effect that the robot file lacks, drawn by --seed.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Robot file [default: the built-in Manutec r3].
    robot: Option<PathBuf>,
    /// Seed of the true arm and the noise.
    #[arg(long, default_value_t = SEED)]
    seed: u64,
    /// Prints tracking joint by joint and every friction, rotor and offset parameter next to the true value.
    #[arg(long)]
    parameters: bool,
    /// Keep the working folder (logs of the processes, true values) here.
    #[arg(long, value_name = "DIR")]
    keep: Option<PathBuf>,
    /// Also write the result as JSON (docs/operating.md).
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

impl Default for Args {
    /// As `rivet demo` without a word has them.
    fn default() -> Args {
        Args { robot: None, seed: SEED, parameters: false, keep: None, json: None }
    }
}

/// Without `--seed`.
const SEED: u64 = 1;

/// Length of the phase on nominal and of the phase on identified parameters \[s of motion\]: one period of the
/// excitation each, so that both see the same motion.
const PHASE_S: f64 = 10.0;

/// Motion left out at the start of each phase \[s\]: the start from rest, and the change-over.
const SETTLE_S: f64 = 2.0;

/// From here on identified parameters act \[s of motion\].
const SWITCH_S: f64 = SETTLE_S + PHASE_S;

/// Beyond this the machine is too slow or something hangs.
const LONGEST: Duration = Duration::from_secs(58);

const BUILT_IN_ROBOT: &str = include_str!("../../../robots/manutec-r3/robot.toml");
const BUILT_IN_URDF: &str = include_str!("../../../robots/manutec-r3/robot.urdf");

struct Ports {
    states: Subscriber<JointState>,
    setpoints: Subscriber<Setpoint>,
    parameters: Subscriber<Parameters>,
    health: Subscriber<Health>,
}

impl Ports {
    fn open(robot: &Robot, private: &PrivateBus) -> Result<Ports> {
        let name = RobotName::new(&robot.config.name)?;
        let bus = Bus::open(private.config(), &name, "rivet-demo")?;
        Ok(Ports {
            states: bus.joint_state_subscriber()?,
            setpoints: bus.setpoint_subscriber()?,
            parameters: bus.parameters_subscriber()?,
            health: bus.health_subscriber()?,
        })
    }
}

/// Files of the run.
struct Files {
    /// What the daemon, the controller and the diagnosis know.
    robot: PathBuf,
    /// With the hidden effect.
    true_robot: PathBuf,
    /// True values.
    truth: PathBuf,
    /// What was published while the arm moved.
    log: PathBuf,
    /// What the diagnosis found.
    verdict: PathBuf,
    /// Folder of the patched model.
    patched: PathBuf,
    folder: PathBuf,
}

/// A run of the arm.
struct Run<'a> {
    robot: &'a Robot,
    ports: &'a Ports,
    /// True values, where errors of parameters are of interest.
    reference: Option<&'a Reference>,
    /// What acts in each phase, and when the measured part of the phase begins \[s of motion\]. The run ends with the last phase.
    phases: Vec<(Acting, f64)>,
}

/// What the controller computes torques from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Acting {
    /// The robot file's values.
    RobotFile,
    /// Parameters that rivetd publishes.
    Identified,
    /// The robot file with the values and effects that the diagnosis found.
    Patched,
}

impl Acting {
    fn name(self) -> &'static str {
        match self {
            Acting::RobotFile => "robot file",
            Acting::Identified => "identified",
            Acting::Patched => "patched",
        }
    }
}

/// What has been heard so far.
struct Received {
    tracking: Tracking,
    parameters: Option<Parameters>,
    health: Option<Health>,
    samples: u64,
}

/// The folder for the run's files: gone with the bus, unless it is to be kept.
fn folder(keep: Option<&Path>, private: &PrivateBus) -> Result<PathBuf> {
    let Some(path) = keep else { return Ok(private.folder()?) };
    std::fs::create_dir_all(path).with_context(|| format!("cannot make {}", path.display()))?;
    Ok(path.to_owned())
}

pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    Outputs::given(args.robot.iter().map(PathBuf::as_path).collect()).file("--json", args.json.as_ref()).check()?;
    match demonstrate(args) {
        Err(why) if is_reader_gone(&why) => Ok(ExitCode::from(READER_GONE)),
        ended => ended,
    }
}

/// Exit code where the reader of standard output has seen enough (`| head`), as a shell counts SIGPIPE.
const READER_GONE: u8 = 141;

fn is_reader_gone(why: &anyhow::Error) -> bool {
    why.downcast_ref::<std::io::Error>().is_some_and(|why| why.kind() == std::io::ErrorKind::BrokenPipe)
}

fn demonstrate(args: &Args) -> Result<ExitCode> {
    let shutdown = Shutdown::on_signals().context("signals cannot be handled")?;
    rivet_ipc_schema::sweep_private();
    // Declared in this order, so that children end before their bus is swept away.
    let private = PrivateBus::new("demo");
    let mut children = Children::default();
    let folder = folder(args.keep.as_deref(), &private)?;
    let robot_file = match &args.robot {
        Some(path) => path.clone(),
        None => unpack(&folder)?,
    };
    let robot = rivet_config::load(&robot_file)?;
    let ports = Ports::open(&robot, &private)?;
    let [truth, log, verdict] = ["truth.json", "run.csv", "diagnosis.json"].map(|name| folder.join(name));
    let patched = folder.join("patched");
    let model = patched.join("model.toml");
    remove_old([&truth, &log, &verdict, &model])?;
    let hidden = Hidden::draw(&robot, &robot_file, args.seed)?;
    let true_robot = hidden.robot_file(&robot, &robot_file, &folder)?;
    let files = Files { robot: robot_file, true_robot, truth, log, verdict, patched, folder };
    let bus = private.config();
    if args.keep.is_some() {
        let [robot, root] = [&files.robot, &bus.root].map(|path| path.display().to_string());
        show(&format!("watch it with: rivet monitor {robot} --prefix {} --root {root}\n", bus.prefix))?;
    }
    let mut sim = sim(args, &files, bus);
    let [truth, run] = [&files.truth, &files.log].map(|path| path.to_string_lossy().into_owned());
    sim.extend(["--truth-out", &truth, "--log-out", &run].map(str::to_owned));
    // On the robot file first, on identified parameters later.
    let switch = (SWITCH_S / robot.config.sample_period_s).round().to_string();
    start(&mut children, &files, (&files.robot, ""), bus, &["--adopt-from", &switch], sim)?;

    let truth = wait_for_truth(&files.truth, &robot, &mut children, &shutdown)?;
    let reference = Reference::new(&robot, truth);
    let phases = vec![(Acting::RobotFile, SETTLE_S), (Acting::Identified, SWITCH_S + SETTLE_S)];
    let received =
        watch(&Run { robot: &robot, ports: &ports, reference: Some(&reference), phases }, &mut children, &shutdown)?;
    children.end();
    let found = hidden::diagnose(&files, &shutdown)?;
    let adopted = if model.exists() { Some(adopt(args, &model, &files, &shutdown)?) } else { None };
    let result = table::Table { robot: &robot, reference: &reference, first: &received, adopted: adopted.as_ref() };
    let mut value = result.to_json();
    (value["seed"], value["hidden"]) = (args.seed.into(), hidden.to_json(&found));
    write_json(args.json.as_ref(), &value)?;
    if args.parameters {
        show(&result.details())?;
    }
    show(&format!("{result}\n\ndiagnosis of the recorded run\n{}\n", hidden.text(&found)))?;
    Ok(if result.improved() && hidden.is_found(&found) { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Removes what an earlier run left in a kept folder: none of it may be taken for this run's.
fn remove_old(files: [&Path; 4]) -> Result<()> {
    for file in files {
        match std::fs::remove_file(file) {
            Err(why) if why.kind() != std::io::ErrorKind::NotFound => {
                return Err(why).with_context(|| format!("cannot remove {}", file.display()));
            }
            _ => {}
        }
    }
    Ok(())
}

fn unpack(folder: &Path) -> Result<PathBuf> {
    let robot = folder.join("robot.toml");
    rivet_files::write_whole(&robot, BUILT_IN_ROBOT)
        .and_then(|()| rivet_files::write_whole(&folder.join("robot.urdf"), BUILT_IN_URDF))
        .with_context(|| format!("cannot write to {}", folder.display()))?;
    Ok(robot)
}

/// A new file for what a child writes.
fn output_file(path: &Path) -> Result<File> {
    Draft::new(path).and_then(Draft::publish).with_context(|| format!("cannot write {}", path.display()))
}

/// Robot file and bus of one of the programs, as words.
fn words(command: &str, robot: &Path, bus: &BusConfig) -> Vec<String> {
    let [robot, root] = [robot, &bus.root].map(|path| path.to_string_lossy().into_owned());
    [command, &robot, "--prefix", &bus.prefix, "--root", &root].map(str::to_owned).to_vec()
}

/// The true arm differs from the robot file: every body and friction value by a factor of its own, a payload, the hidden effect.
fn sim(args: &Args, files: &Files, bus: &BusConfig) -> Vec<String> {
    let mut sim = words("sim", &files.true_robot, bus);
    let seed = args.seed.to_string();
    sim.extend(["--motion", "fourier", "--lockstep", "20", "--seed", &seed].map(str::to_owned));
    sim.extend(
        ["--friction", "1.6", "--bodies-spread", "0.2", "--friction-spread", "0.15", "--rotor-inertia-spread", "0.1"]
            .map(str::to_owned),
    );
    sim.extend(["--payload", "1.0"].map(str::to_owned));
    sim
}

/// Starts daemon and controller on `model`, and the true arm. `label` is in the names of their messages' files.
fn start(
    children: &mut Children,
    files: &Files,
    (model, label): (&Path, &str),
    bus: &BusConfig,
    controller_words: &[&str],
    sim: Vec<String>,
) -> Result<()> {
    let mut daemon = words("daemon", model, bus);
    daemon.push("--best-effort".to_owned());
    let mut controller = words("controller", model, bus);
    controller.extend(["--best-effort", "--lockstep"].iter().chain(controller_words).map(|word| (*word).to_owned()));
    for (name, words) in [("daemon", daemon), ("controller", controller), ("sim", sim)] {
        children.start(&words, Some(output_file(&files.folder.join(format!("{name}{label}.log")))?))?;
    }
    Ok(())
}

/// The same arm and motion on the patched model, which acts from the start. No parameter is identified for the controller.
fn adopt(args: &Args, model: &Path, files: &Files, shutdown: &Shutdown) -> Result<Received> {
    let private = PrivateBus::new("demo");
    let mut children = Children::default();
    let robot = rivet_config::load(model)?;
    let ports = Ports::open(&robot, &private)?;
    let bus = private.config();
    start(&mut children, files, (model, "-patched"), bus, &["--nominal"], sim(args, files, bus))?;
    let phases = vec![(Acting::Patched, SETTLE_S)];
    let received = watch(&Run { robot: &robot, ports: &ports, reference: None, phases }, &mut children, shutdown)?;
    children.end();
    Ok(received)
}

fn check(children: &mut Children, shutdown: &Shutdown, begin: Instant) -> Result<()> {
    if shutdown.is_requested() {
        return Err(Fault::Interrupted.into());
    }
    if let Some((name, status)) = children.ended() {
        bail!("rivet {name} ended early ({status}); --keep DIR keeps its output");
    }
    if begin.elapsed() > LONGEST {
        bail!("not finished after {} s: this machine is too busy for the demonstration", LONGEST.as_secs());
    }
    Ok(())
}

/// True base parameters, as the plant wrote them.
fn wait_for_truth(file: &Path, robot: &Robot, children: &mut Children, shutdown: &Shutdown) -> Result<Vec<f64>> {
    let begin = Instant::now();
    while !file.exists() {
        check(children, shutdown, begin)?;
        std::thread::sleep(Duration::from_millis(10));
    }
    let text = std::fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
    let value: serde_json::Value = serde_json::from_str(&text).context("the plant's truth file is not JSON")?;
    let base: Option<Vec<f64>> =
        value["base"].as_array().and_then(|entries| entries.iter().map(|entry| entry["value"].as_f64()).collect());
    let base = base.context("the truth file lacks base parameters")?;
    if base.len() != robot.base.len() {
        bail!("the plant has {} base parameters, the model {}", base.len(), robot.base.len());
    }
    Ok(base)
}

fn watch(run: &Run<'_>, children: &mut Children, shutdown: &Shutdown) -> Result<Received> {
    let period = run.robot.config.sample_period_s;
    let sample = |seconds: f64| (seconds / period).round() as u64;
    let measured = run.phases.iter().map(|(_, from)| sample(*from)..sample(from + PHASE_S)).collect();
    let total_s = run.phases.last().map_or(0.0, |(_, from)| from + PHASE_S);
    let tracking = Tracking::new(run.robot.model.arm.dof(), measured);
    let mut received = Received { tracking, parameters: None, health: None, samples: 0 };
    let mut screen = Screen::new(run.robot);
    let begin = Instant::now();
    while received.samples < sample(total_s) {
        std::thread::sleep(Duration::from_millis(20));
        check(children, shutdown, begin)?;
        received.take(run.ports)?;
        let motion_s = received.samples as f64 * period;
        let acting = run.phases.iter().find(|(_, from)| motion_s < from + PHASE_S).or(run.phases.last());
        let errors = run.reference.zip(received.parameters.as_ref());
        screen.draw_if_due(&Frame {
            motion_s,
            total_s,
            acting: acting.map_or(Acting::RobotFile, |(acting, _)| *acting),
            errors: errors.map(|(reference, p)| reference.errors(&p.values[..p.len()])),
            health: received.health.as_ref(),
            tracking: &received.tracking,
        })?;
    }
    screen.end()?;
    Ok(received)
}

impl Received {
    fn take(&mut self, ports: &Ports) -> Result<()> {
        while let Some(setpoint) = ports.setpoints.receive()? {
            self.tracking.setpoint(&setpoint);
        }
        while let Some(state) = ports.states.receive()? {
            self.samples = state.seq;
            self.tracking.state(&state);
        }
        while let Some(parameters) = ports.parameters.receive()? {
            self.parameters = Some(parameters);
        }
        while let Some(health) = ports.health.receive()? {
            self.health = Some(health);
        }
        Ok(())
    }
}
