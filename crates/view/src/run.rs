//! The program: messages from the bus to the server until a signal, `--seconds` or a failure.

use std::path::Path;
use std::time::{Duration, Instant};

use rivet_config::Robot;
use rivet_files::StatusLine;
use rivet_ipc_schema::{Bus, BusConfig, RobotName};
use rivet_realtime::{Shutdown, now_ns};
use rivet_recording::{About, Content, Counter, Counts, Derived, Ports, Received, TOPICS, Topic, names, services};
use rivet_service::ViewOptions;
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::json;

use crate::channel::Channel;
use crate::error::Failure;
use crate::layout;
use crate::server::Server;
use crate::thinning::Thinning;

/// Time between two looks at the bus: its rings hold a thousand samples.
const TURN: Duration = Duration::from_millis(5);
/// Time between two counts on the bus's topic `view`, and two pictures of the status line.
const BETWEEN_COUNTS: Duration = Duration::from_secs(1);
/// Time without joint states after which the robot is waited for \[ns\].
const SILENCE_NS: u64 = 3_000_000_000;

/// What came from the bus, and what went to clients.
#[derive(Clone, Debug, Default, Serialize, JsonSchema)]
struct ViewCounts {
    /// When they were counted, `CLOCK_MONOTONIC` [ns].
    stamp_ns: u64,
    /// Clients that are connected.
    clients: usize,
    /// Messages of a second publisher of joint states, setpoints or second encoders; they are not sent.
    foreign: u64,
    /// One entry a topic.
    topics: Vec<TopicCounts>,
}

/// What came and went on one topic.
#[derive(Clone, Debug, Default, Serialize, JsonSchema)]
struct TopicCounts {
    /// Last part of its name, such as joint-state.
    topic: String,
    /// Messages that came from the bus, or follow from it.
    messages: u64,
    /// Numbers of the sequence that never came from the bus.
    missing: u64,
    /// Messages left out to keep to the rate.
    thinned: u64,
    /// Messages sent, each client by itself.
    sent: u64,
    /// Messages that a client was too slow for.
    dropped: u64,
}

/// Place of the counts among the topics: where a recording has the recorder's.
const COUNTS_PLACE: usize = 7;

/// The topic of this program's counts.
const fn view_topic() -> Topic {
    rivet_recording::other_topic::<ViewCounts>("view", "rivet.View.v1")
}

/// Whether clients that subscribe get the last message at once: those that come seldom.
fn is_kept(place: usize) -> bool {
    !matches!(TOPICS.get(place).map(|topic| topic.name), Some("joint-state" | "setpoint" | "link-state" | "residual"))
}

/// Whether messages are thinned to the rate.
fn is_thinned(content: &Content) -> bool {
    use Content::{JointState, LinkState, Parameters, Setpoint};
    matches!(content, JointState(_) | Setpoint(_) | LinkState(_) | Parameters(_))
}

/// Serves the messages of a robot until a signal, `--seconds` or a failure.
///
/// # Errors
/// Why it did not start, or ended.
pub fn run(options: &ViewOptions) -> Result<(), Failure> {
    if options.bridge.die_with_parent {
        rivet_realtime::die_with_parent()?;
    }
    let robot = rivet_config::load(&options.robot)?;
    if let Some(out) = &options.layout {
        return write_layout(&robot, out);
    }
    let name = &robot.config.name;
    let config = BusConfig {
        prefix: options.bridge.prefix.clone().unwrap_or_else(|| robot.config.bus.prefix.clone()),
        root: options.bridge.root.clone().unwrap_or_else(|| robot.config.bus.root.clone()),
    };
    let shutdown = Shutdown::on_signals()?;
    let about = About::new(&robot, now_ns());
    let mut all = TOPICS;
    all[COUNTS_PLACE] = view_topic();
    let channel = |(place, topic): (usize, &Topic)| Channel {
        topic: topic.full_name(name),
        schema_name: topic.kind.to_owned(),
        schema: topic.schema().to_string(),
        is_kept: is_kept(place),
    };
    let channels = all.iter().enumerate().map(channel).collect();
    let session = now_ns().saturating_add_signed(about.to_utc_ns).to_string();
    let server = Server::start(&options.host, options.port, &format!("rivet {name}"), &session, channels)?;
    let bus = Bus::open(&config, &RobotName::new(name)?, "rivet-view")?;
    let ports = Ports::open(&bus)?;
    let address = server.address();
    rivet_files::note(format_args!("rivet-view: {name} at ws://{address}"));
    if !address.ip().is_loopback() {
        rivet_files::note(format_args!(
            "rivet-view: there is no authentication; every host that reaches {address} can read"
        ));
    }
    let mut view = View {
        options,
        server,
        ports,
        derived: Derived::new(&robot, about.to_utc_ns)?,
        counter: Counter::new(services()),
        topics: all
            .iter()
            .map(|topic| Stream { name: topic.name, thinning: Thinning::new(options.rate), messages: 0, thinned: 0 })
            .collect(),
        joints: robot.dof(),
        to_utc_ns: about.to_utc_ns,
        state_ns: None,
        is_running: None,
        has_daemon: None,
    };
    let begin = Instant::now();
    let result = view.serve(&shutdown, name);
    let printed = view.finish(name, begin.elapsed().as_secs_f64());
    result.and(printed)
}

fn write_layout(robot: &Robot, out: &Path) -> Result<(), Failure> {
    let joints: Vec<String> = robot.model.arm.joints.iter().map(|joint| joint.name.clone()).collect();
    let text = layout::text(&robot.config.name, &joints, &names(robot));
    rivet_files::write_whole(out, text).map_err(|why| Failure::File { path: out.display().to_string(), why })
}

/// One topic on its way.
struct Stream {
    name: &'static str,
    thinning: Thinning,
    messages: u64,
    thinned: u64,
}

struct View<'a> {
    options: &'a ViewOptions,
    server: Server,
    ports: Ports,
    derived: Derived,
    counter: Counter,
    topics: Vec<Stream>,
    joints: usize,
    to_utc_ns: i64,
    /// When the last joint state came \[ns\].
    state_ns: Option<u64>,
    /// What was noted last.
    is_running: Option<bool>,
    has_daemon: Option<bool>,
}

impl View<'_> {
    fn serve(&mut self, shutdown: &Shutdown, name: &str) -> Result<(), Failure> {
        let begin = Instant::now();
        let mut line = StatusLine::new(!self.options.bridge.json);
        let mut counted: Option<Instant> = None;
        let mut received = Vec::new();
        let is_over = || self.options.bridge.seconds.is_some_and(|seconds| begin.elapsed().as_secs_f64() >= seconds);
        while !shutdown.is_requested() && !is_over() {
            let now = now_ns();
            self.ports.take(now, &mut |message| received.push(message))?;
            for message in received.drain(..) {
                if matches!(message.content, Content::JointState(_)) {
                    self.state_ns = Some(now);
                }
                self.counter.count(message.content.place(), message.origin(), true);
                let mut follows = Vec::new();
                self.derived.take(&message, &mut |other| follows.push(other));
                pass(&self.server, &mut self.topics, self.joints, self.to_utc_ns, &message);
                for other in &follows {
                    pass(&self.server, &mut self.topics, self.joints, self.to_utc_ns, other);
                }
            }
            let (server, topics, joints, to_utc_ns) = (&self.server, &mut self.topics, self.joints, self.to_utc_ns);
            self.derived.turn(now, &mut |message| pass(server, topics, joints, to_utc_ns, &message));
            self.report(name, now, begin.elapsed(), &mut line);
            if counted.is_none_or(|counted| counted.elapsed() >= BETWEEN_COUNTS) {
                counted = Some(Instant::now());
                let counts = self.counts(now);
                self.publish_counts(&counts);
                line.draw(&status(name, self.is_running == Some(true), &counts));
            }
            std::thread::sleep(TURN);
        }
        line.remove();
        Ok(())
    }

    /// Notes when robot and daemon come and go.
    fn report(&mut self, name: &str, now: u64, elapsed: Duration, line: &mut StatusLine) {
        let is_running = self.state_ns.is_some_and(|at| now.saturating_sub(at) <= SILENCE_NS);
        // Who is there has time to say so before it is missed.
        let is_early = elapsed < BETWEEN_COUNTS;
        let mut note = |text: std::fmt::Arguments<'_>| {
            line.remove();
            rivet_files::note(format_args!("rivet-view: {text}"));
        };
        if self.is_running != Some(is_running) && (is_running || !is_early) {
            match (is_running, self.is_running) {
                (true, _) => note(format_args!("joint states of {name} come")),
                (false, None) => note(format_args!("waiting for joint states of {name}; start its robot controller")),
                (false, Some(_)) => note(format_args!("joint states of {name} have stopped; waiting")),
            }
            self.is_running = Some(is_running);
        }
        let has_daemon = self.derived.has_daemon();
        if self.has_daemon != Some(has_daemon) && (has_daemon || !is_early) {
            match (has_daemon, self.has_daemon) {
                (true, _) => note(format_args!("rivetd reports")),
                (false, None) => note(format_args!("waiting for rivetd of {name}")),
                (false, Some(_)) => note(format_args!("rivetd does not report any more; waiting")),
            }
            self.has_daemon = Some(has_daemon);
        }
    }

    fn counts(&self, now_ns: u64) -> ViewCounts {
        let of_bus: Counts = self.counter.counts(now_ns, self.ports.foreign());
        let one = |(place, stream): (usize, &Stream)| {
            let (sent, dropped) = self.server.counts(place);
            TopicCounts {
                topic: stream.name.to_owned(),
                messages: stream.messages,
                missing: of_bus.of_service(stream.name).map_or(0, |counts| counts.missing),
                thinned: stream.thinned,
                sent,
                dropped,
            }
        };
        ViewCounts {
            stamp_ns: now_ns,
            clients: self.server.clients().0,
            foreign: of_bus.foreign,
            topics: self.topics.iter().enumerate().map(one).collect(),
        }
    }

    fn publish_counts(&mut self, counts: &ViewCounts) {
        self.topics[COUNTS_PLACE].messages += 1;
        // Numbers and names have a JSON.
        if let Ok(payload) = serde_json::to_vec(counts) {
            self.server.publish(COUNTS_PLACE, counts.stamp_ns.saturating_add_signed(self.to_utc_ns), &payload);
        }
    }

    /// Prints the counts.
    fn finish(self, name: &str, seconds: f64) -> Result<(), Failure> {
        let counts = self.counts(now_ns());
        let (_, ever) = self.server.clients();
        if self.options.bridge.json {
            let value = json!({"robot": name, "address": self.server.address().to_string(), "seconds": seconds,
                               "clients": ever, "refused_connections": self.server.refused(),
                               "foreign": counts.foreign, "topics": counts.topics});
            let text = serde_json::to_string_pretty(&value).unwrap_or_default() + "\n";
            return rivet_files::print(&rivet_files::printable_json(text)).map_err(Failure::Output);
        }
        rivet_files::note(format_args!("rivet-view: {ever} clients, {}", totals(&counts)));
        Ok(())
    }
}

/// Passes a message to the server, unless it is one too many.
fn pass(server: &Server, topics: &mut [Stream], joints: usize, to_utc_ns: i64, message: &Received) {
    let content = &message.content;
    let place = content.place();
    let stream = &mut topics[place];
    stream.messages += 1;
    if is_thinned(content) && !stream.thinning.passes(content.stamp_ns()) {
        stream.thinned += 1;
        return;
    }
    if !server.wants(place) {
        return;
    }
    // Numbers and names have a JSON.
    if let Ok(payload) = content.to_json(joints) {
        server.publish(place, message.at_ns.saturating_add_signed(to_utc_ns), &payload);
    }
}

fn totals(counts: &ViewCounts) -> String {
    let sum = |count: fn(&TopicCounts) -> u64| counts.topics.iter().map(count).sum::<u64>();
    format!(
        "{} messages sent, {} thinned, {} dropped, {} missing",
        sum(|topic| topic.sent),
        sum(|topic| topic.thinned),
        sum(|topic| topic.dropped),
        // Planners that do not plan every period leave out numbers.
        sum(|topic| if topic.topic == "setpoint" { 0 } else { topic.missing })
    )
}

/// What the status line shows.
fn status(robot: &str, is_running: bool, counts: &ViewCounts) -> String {
    let robot = if is_running { String::new() } else { format!("waiting for joint states of {robot}; ") };
    format!("{robot}{} clients, {}; Ctrl-C ends", counts.clients, totals(counts))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_counts_take_the_place_of_the_recorder() {
        assert_eq!(TOPICS[COUNTS_PLACE].name, "recorder");
        assert_eq!(Content::from(Counts::default()).place(), COUNTS_PLACE);
    }
}
