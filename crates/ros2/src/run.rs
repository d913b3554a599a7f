//! The program: inputs from the graph to the bus on this thread, outputs on another one.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use rivet_files::StatusLine;
use rivet_ipc_schema::BusConfig;
use rivet_realtime::{Shutdown, now_ns};
use rivet_service::{Ros2Options, SetpointType};
use rustdds::mio1::{Events, Interest, Poll, Token};
use serde::de::DeserializeOwned;
use serde_json::json;

use crate::error::Failure;
use crate::graph::{Graph, Input};
use crate::intake::{Counts, Intake, guid_text};
use crate::messages::{JointState, JointTrajectoryControllerState, JointTrajectoryPoint, Text, Time};
use crate::model;
use crate::outputs::{Outputs, Shared, Start, Topics, wall_ns};
use crate::problems::Problem;
use crate::source::Guid;

/// Longest sleep: signals and setpoints that do not come are looked for.
const TURN: Duration = Duration::from_millis(20);
/// The same while a joint state waits for its setpoint.
const SHORT_TURN: Duration = Duration::from_millis(1);
/// Messages of a topic that are taken at once.
const MOST: usize = 1024;
/// Time between two pictures of the status line, and two handovers of the counts.
const BETWEEN_COUNTS: Duration = Duration::from_millis(500);
/// How long joint states may come without the joints of the arm: a gripper may be heard first.
const MISFIT: Duration = Duration::from_secs(3);
/// Joint states in that time, at least: one message of a gripper that starts first ends nothing.
const MISFIT_MESSAGES: u64 = 5;

const JOINT_STATES: Token = Token(0);
const SETPOINTS: Token = Token(1);
const DESCRIPTION: Token = Token(2);

/// Setpoints of one of two types.
enum Setpoints {
    ControllerState(Input<JointTrajectoryControllerState>),
    Point(Input<JointTrajectoryPoint>),
}

/// Everything that comes from the graph.
struct Inputs {
    graph: Graph,
    /// Whether a participant was lost without a goodbye.
    has_lost_a_peer: bool,
    poll: Poll,
    joint_states: Input<JointState>,
    setpoints: Option<Setpoints>,
    description: Input<Text>,
}

fn register<M: DeserializeOwned>(poll: &Poll, input: &mut Input<M>, token: Token) -> Result<(), Failure> {
    poll.registry().register(input.wakeup(), token, Interest::READABLE).map_err(Failure::System)
}

/// Follows a topic's publishers; gives those that have left.
fn follow<M: DeserializeOwned>(
    poll: &Poll,
    input: &mut Input<M>,
    token: Token,
    renewed: &mut dyn FnMut(),
) -> Result<Vec<Guid>, Failure> {
    let changes = input.changes()?;
    if changes.renewed {
        register(poll, input, token)?;
        renewed();
    }
    Ok(changes.departed)
}

impl Inputs {
    fn open(graph: Graph, options: &Ros2Options) -> Result<Inputs, Failure> {
        let poll = Poll::new()?;
        let mut joint_states = graph.input(&options.joint_states, false)?;
        register(&poll, &mut joint_states, JOINT_STATES)?;
        let setpoints = match (&options.setpoint, options.setpoint_type) {
            (None, _) => None,
            (Some(topic), SetpointType::ControllerState) => {
                let mut input = graph.input(topic, false)?;
                register(&poll, &mut input, SETPOINTS)?;
                Some(Setpoints::ControllerState(input))
            }
            (Some(topic), SetpointType::Point) => {
                let mut input = graph.input(topic, false)?;
                register(&poll, &mut input, SETPOINTS)?;
                Some(Setpoints::Point(input))
            }
        };
        let mut description = graph.input(&options.robot_description, true)?;
        register(&poll, &mut description, DESCRIPTION)?;
        Ok(Inputs { graph, has_lost_a_peer: false, poll, joint_states, setpoints, description })
    }

    /// Joins once more where the publisher of joint states was lost without a goodbye; whether it did.
    fn rejoin_if_lost(&mut self, options: &Ros2Options) -> Result<bool, Failure> {
        self.has_lost_a_peer |= self.graph.has_lost_a_peer();
        let rejoins = self.has_lost_a_peer && self.joint_states.publishers() == 0;
        if rejoins {
            *self = Inputs::open(self.graph.rejoin()?, options)?;
        }
        Ok(rejoins)
    }

    /// Sleeps until something comes.
    fn wait(&mut self, events: &mut Events, most: Duration) -> Result<(), Failure> {
        match self.poll.poll(events, Some(most)) {
            Err(why) if why.kind() != std::io::ErrorKind::Interrupted => Err(Failure::System(why)),
            _ => Ok(()),
        }
    }

    /// Takes everything in that has come.
    fn take(&mut self, intake: &mut Intake, options: &Ros2Options) -> Result<(), Failure> {
        let (now, wall) = (now_ns(), wall_ns());
        let mut best_effort = Vec::new();
        let joint_states = &options.joint_states;
        let mut departed =
            follow(&self.poll, &mut self.joint_states, JOINT_STATES, &mut || best_effort.push(joint_states.clone()))?;
        let mut malformed = Vec::new();
        let found = self.joint_states.take(MOST, now, wall, &mut |arrived| intake.joint_state(&arrived));
        malformed.push((joint_states.clone(), found));
        if let (Some(setpoints), Some(topic)) = (&mut self.setpoints, &options.setpoint) {
            let mut renewed = || best_effort.push(topic.clone());
            let found = match setpoints {
                Setpoints::ControllerState(input) => {
                    departed.extend(follow(&self.poll, input, SETPOINTS, &mut renewed)?);
                    input.take(MOST, now, wall, &mut |arrived| intake.controller_state(&arrived))
                }
                Setpoints::Point(input) => {
                    departed.extend(follow(&self.poll, input, SETPOINTS, &mut renewed)?);
                    input.take(MOST, now, wall, &mut |arrived| intake.point(&arrived))
                }
            };
            malformed.push((topic.clone(), found));
        }
        for guid in departed {
            intake.publisher_left(guid);
        }
        for topic in best_effort {
            intake.problems().count(Problem::BestEffort, 1, now, || {
                format!("{topic}: the publisher offers best effort only, so that lost messages are not sent again")
            });
        }
        for (topic, found) in malformed {
            if found > 0 {
                intake.problems().count(Problem::Malformed, found, now, || {
                    format!("{topic}: a message is not of its type; its publisher may be of another version")
                });
            }
        }
        Ok(())
    }

    /// The description that came last, if one came.
    fn description(&mut self) -> Result<Option<String>, Failure> {
        follow(&self.poll, &mut self.description, DESCRIPTION, &mut || {})?;
        let mut latest = None;
        self.description.take(MOST, now_ns(), wall_ns(), &mut |arrived| latest = Some(arrived.message.data));
        Ok(latest)
    }
}

/// Joins bus and graph, and hands messages on until a signal, `--seconds` or a failure.
///
/// # Errors
/// Why it did not start, or ended.
pub fn run(options: &Ros2Options) -> Result<(), Failure> {
    if options.bridge.die_with_parent {
        rivet_realtime::die_with_parent()?;
    }
    let variable = std::env::var("ROS_DOMAIN_ID").ok();
    let domain = options.domain_or(variable.as_deref()).map_err(Failure::Usage)?;
    let robot = Arc::new(rivet_config::load(&options.robot)?);
    let urdf = std::fs::read_to_string(&robot.config.urdf)
        .map_err(|why| Failure::File { path: robot.config.urdf.display().to_string(), why })?;
    let config = BusConfig {
        prefix: options.bridge.prefix.clone().unwrap_or_else(|| robot.config.bus.prefix.clone()),
        root: options.bridge.root.clone().unwrap_or_else(|| robot.config.bus.root.clone()),
    };
    let shutdown = Shutdown::on_signals()?;
    let mut sender = rivet::Robot::open(&config, &robot.config.name, robot.model.arm.dof() as u32)?;
    let graph = Graph::join(domain, &options.interface)?;
    let topics = Topics::new(&robot.config.name);
    let shared = Arc::new(Shared::default());
    let mut inputs = Inputs::open(Graph::join(domain, &options.interface)?, options)?;
    let start = Start {
        robot: Arc::clone(&robot),
        urdf,
        config: &config,
        graph,
        topics: topics.clone(),
        shared: Arc::clone(&shared),
    };
    let thread = Outputs::start(start, &shutdown)?;
    let joints = robot.model.arm.joints.iter().map(|joint| joint.name.clone()).collect();
    let setpoint = options.setpoint.as_deref().unwrap_or("setpoints");
    let patience_s = options.patience_ms * 1e-3;
    let mut intake = Intake::new(joints, robot.config.sample_period_s, patience_s, &options.joint_states, setpoint);
    rivet_files::note(format_args!(
        "rivet-ros2: {} on domain {domain}, joint states of {}",
        robot.config.name, options.joint_states
    ));
    let mut turns = Turns { options, robot: &robot, shared: &shared, shutdown: &shutdown };
    let result = turns.all(&mut inputs, &mut intake, &mut sender);
    shutdown.request();
    // It can only have panicked, which was reported on standard error.
    let _ = thread.join();
    let lost = bus_lost(&sender);
    let summary = summary(options, domain, &topics, &mut intake, &shared, lost);
    if options.bridge.json {
        let text = serde_json::to_string_pretty(&summary).unwrap_or_default() + "\n";
        let printed = rivet_files::print(&rivet_files::printable_json(text)).map_err(Failure::Output);
        return result.and(printed);
    }
    rivet_files::note(format_args!("rivet-ros2: {}", line(&intake.counts(), lost)));
    result
}

/// Samples that did not reach the bus.
fn bus_lost(sender: &rivet::Robot) -> u64 {
    let counters = sender.counters();
    counters.lost + counters.failed
}

struct Turns<'a> {
    options: &'a Ros2Options,
    robot: &'a rivet_config::Robot,
    shared: &'a Shared,
    shutdown: &'a Shutdown,
}

impl Turns<'_> {
    /// Hands messages on until the end.
    fn all(&mut self, inputs: &mut Inputs, intake: &mut Intake, sender: &mut rivet::Robot) -> Result<(), Failure> {
        let begin = Instant::now();
        let mut events = Events::with_capacity(16);
        let mut status_line = StatusLine::new(!self.options.bridge.json);
        let mut counted: Option<Instant> = None;
        // Since when, and how many joint states had been refused then.
        let mut misfit: Option<(Instant, u64)> = None;
        let is_over = || self.options.bridge.seconds.is_some_and(|seconds| begin.elapsed().as_secs_f64() >= seconds);
        while !self.shutdown.is_requested() && !is_over() {
            inputs.wait(&mut events, if intake.waits() { SHORT_TURN } else { TURN })?;
            inputs.take(intake, self.options)?;
            if inputs.rejoin_if_lost(self.options)? {
                self.shared.rejoined.fetch_add(1, Ordering::Relaxed);
            }
            let mut last_ns = None;
            while let Some(out) = intake.next(now_ns()) {
                sender.skip(out.skip);
                // What the bus does not take is counted there.
                let _ = sender.publish(&out.sample);
                last_ns = Some(out.sample.stamp_ns);
            }
            if let Some(last_ns) = last_ns {
                let age_ns = now_ns().saturating_sub(last_ns).cast_signed();
                self.shared.measured().position = Some((intake.positions(), Time::from_ns(wall_ns() - age_ns)));
            }
            if let Some(text) = inputs.description()? {
                self.compare(&text, intake);
            }
            match (intake.misfit(), misfit) {
                (Some(why), Some((since, before)))
                    if since.elapsed() >= MISFIT && intake.counts().refused >= before + MISFIT_MESSAGES =>
                {
                    status_line.remove();
                    return Err(Failure::Joints { topic: self.options.joint_states.clone(), why: why.clone() });
                }
                (Some(_), None) => misfit = Some((Instant::now(), intake.counts().refused)),
                (Some(_), Some(_)) => {}
                (None, _) => misfit = None,
            }
            if counted.is_none_or(|counted| counted.elapsed() >= BETWEEN_COUNTS) {
                counted = Some(Instant::now());
                self.count(inputs, intake, sender, &mut status_line);
            }
        }
        status_line.remove();
        Ok(())
    }

    /// Reports news, hands the counts to the outputs, shows the status line.
    fn count(&self, inputs: &Inputs, intake: &mut Intake, sender: &rivet::Robot, status_line: &mut StatusLine) {
        let (now, lost) = (now_ns(), bus_lost(sender));
        let more = lost.saturating_sub(intake.problems().times(Problem::Bus));
        if more > 0 {
            let why = sender.problem();
            intake.problems().count(Problem::Bus, more, now, || format!("the bus did not take {more} samples: {why}"));
        }
        for text in intake.problems().news() {
            status_line.remove();
            rivet_files::note(format_args!("rivet-ros2: {text} (reported once)"));
        }
        let counts = intake.counts();
        {
            let mut measured = self.shared.measured();
            measured.bridge.counts = counts;
            measured.bridge.bus_lost = lost;
            measured.bridge.publishers = inputs.joint_states.publishers();
            measured.bridge.problems =
                intake.problems().present(now).map(|(problem, met)| (problem.is_serious(), met.text.clone())).collect();
        }
        status_line.draw(&status(&self.robot.config.name, &counts, lost));
    }

    fn compare(&self, text: &str, intake: &mut Intake) {
        let differences = model::differences(self.robot, text);
        if differences.is_empty() {
            return;
        }
        let topic = &self.options.robot_description;
        intake.problems().count(Problem::OtherArm, 1, now_ns(), || {
            format!(
                "{topic} is another arm than {}: {}; use the URDF of the robot that runs",
                self.robot.config.urdf.display(),
                differences.join("; ")
            )
        });
    }
}

fn line(counts: &Counts, bus_lost: u64) -> String {
    format!(
        "{} joint states, {} on the bus, {} lost, {} refused; {} of {} setpoints",
        counts.joint_states,
        counts.published - bus_lost.min(counts.published),
        counts.lost + bus_lost,
        counts.refused,
        counts.setpoints_published,
        counts.setpoints
    )
}

fn summary(
    options: &Ros2Options,
    domain: u16,
    topics: &Topics,
    intake: &mut Intake,
    shared: &Shared,
    bus_lost: u64,
) -> serde_json::Value {
    let counts = intake.counts();
    let source = intake.source();
    let used = source.current().map(guid_text);
    let others: Vec<String> = source.others().iter().copied().map(guid_text).collect();
    let problems: Vec<_> = intake
        .problems()
        .met()
        .map(|(problem, met)| json!({"problem": format!("{problem:?}"), "count": met.count, "text": met.text}))
        .collect();
    let sent = |counter: &std::sync::atomic::AtomicU64| counter.load(Ordering::Relaxed);
    json!({
        "domain": domain,
        "joint_states": {
            "topic": options.joint_states, "received": counts.joint_states, "on_bus": counts.published, "lost": counts.lost,
            "refused": counts.refused, "faulty": counts.faulty, "foreign": counts.foreign, "other_joints": counts.other_joints,
            "bus_lost": bus_lost, "publisher": used, "other_publishers": others,
        },
        "setpoints": {"topic": options.setpoint, "received": counts.setpoints, "on_bus": counts.setpoints_published},
        "sent": {
            topics.parameters.clone(): sent(&shared.parameters), topics.payload.clone(): sent(&shared.wrenches),
            topics.description.clone(): sent(&shared.urdfs), topics.diagnostics.clone(): sent(&shared.reports),
            "not_sent": sent(&shared.not_sent),
        },
        "rejoined": sent(&shared.rejoined),
        "problems": problems,
    })
}

/// What the status line shows.
fn status(robot: &str, counts: &Counts, bus_lost: u64) -> String {
    match counts.joint_states {
        0 => format!("waiting for joint states of {robot}; Ctrl-C ends"),
        _ => line(counts, bus_lost) + "; Ctrl-C ends",
    }
}
