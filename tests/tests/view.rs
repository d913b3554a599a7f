//! `rivet view` beside a running rivetd, read by an independent client (`websockets` of Python); `rivet record` beside it.
//!
//! Values reach the client to the bit, every path of the layout resolves in what both programs give, and the loop loses nothing.
//! Python is that of `RIVET_PYTHON`; without its module `websockets` the test prints SKIPPED.

use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use rivet_ipc_schema::{
    Bus, BusConfig, ControllerHealth, Health, JointState, Parameters, PrivateBus, Publisher, Setpoint, Subscriber,
};
use rivet_tests::process::{Process, eventually};
use rivet_tests::two_link::{daemon, name, running, sample};
use rivet_tests::{rivet, rivet_view, robot, succeed};
use serde_json::Value;

/// Joint states of the main run, 1 ms apart.
const SAMPLES: u64 = 6000;

fn python() -> Option<PathBuf> {
    let python = PathBuf::from(std::env::var_os("RIVET_PYTHON").unwrap_or_else(|| "python3".into()));
    let found = Command::new(&python).args(["-c", "import websockets.sync.client"]).output();
    if found.is_ok_and(|output| output.status.success()) {
        return Some(python);
    }
    // Past the test harness, which keeps what a passing test says to itself.
    let _ = writeln!(std::io::stderr(), "SKIPPED: {} has no websockets; pip install websockets", python.display());
    None
}

/// Robot controller and planner that publish every millisecond, and what the daemon publishes.
struct Robot {
    states: Publisher<JointState>,
    plans: Publisher<Setpoint>,
    /// Reports in place of a controller's.
    controller: Publisher<ControllerHealth>,
    health: Subscriber<Health>,
    parameters: Subscriber<Parameters>,
    /// By epoch: a daemon that starts anew counts from 1 again.
    sets: BTreeMap<u64, Vec<Parameters>>,
    begin: (Instant, u64),
    sent: u64,
}

impl Robot {
    fn new(bus: &Bus) -> Robot {
        Robot {
            states: bus.joint_state_publisher().expect("a publisher"),
            plans: bus.setpoint_publisher().expect("a publisher"),
            controller: bus.controller_health_publisher().expect("a publisher"),
            health: bus.health_subscriber().expect("a subscriber"),
            parameters: bus.parameters_subscriber().expect("a subscriber"),
            sets: BTreeMap::new(),
            begin: (Instant::now(), 0),
            sent: 0,
        }
    }

    fn wait_for(&mut self, listeners: usize) {
        let all = || (self.states.subscribers(), self.plans.subscribers()) == (listeners, listeners);
        eventually("all listen", || all().then_some(()));
        self.begin = (Instant::now(), self.sent);
    }

    fn send(&mut self) {
        self.sent += 1;
        let state = sample(self.sent);
        let plan = Setpoint { seq: self.sent, stamp_ns: state.stamp_ns, q: state.q, joints: 2, ..Setpoint::default() };
        self.plans.send(&plan).expect("sent");
        self.states.send(&state).expect("sent");
        if self.sent.is_multiple_of(500) {
            let report = ControllerHealth { stamp_ns: state.stamp_ns, state: 2, ..ControllerHealth::default() };
            self.controller.send(&report).expect("sent");
        }
        self.take_parameters();
        let (begin, before) = self.begin;
        let due = begin + Duration::from_millis(self.sent - before);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
    }

    fn take_parameters(&mut self) {
        while let Some(set) = self.parameters.receive().expect("received") {
            self.sets.entry(set.epoch).or_default().push(set);
        }
    }

    /// Sends until something is so.
    fn send_until<T>(&mut self, what: &str, mut look: impl FnMut() -> Option<T>) -> T {
        eventually(what, || {
            self.send();
            look()
        })
    }

    /// What the daemon reports once it has had the last sample.
    fn health(&self) -> Health {
        eventually("the last sample is in", || {
            self.health.receive().expect("received").filter(|health| health.seq == self.sent)
        })
    }
}

fn on_bus(mut command: Command, config: &BusConfig, words: &[&str]) -> Command {
    command.args(words).args(["--json", "--prefix", &config.prefix]).arg("--root").arg(&config.root);
    command.stdout(Stdio::piped());
    command
}

/// Lines of a child's pipe.
fn lines(pipe: impl std::io::Read + Send + 'static) -> Receiver<String> {
    let (give, lines) = channel();
    std::thread::spawn(move || BufReader::new(pipe).lines().map_while(Result::ok).try_for_each(|line| give.send(line)));
    lines
}

/// A step of a path behind its topic.
#[derive(Debug, PartialEq)]
enum Step {
    Field(String),
    Place(usize),
    All,
}

/// Topic and steps of a message path: `"a/b".field[3].other[:]`.
fn parse(path: &str) -> (String, Vec<Step>) {
    let (topic, mut rest) = path.strip_prefix('"').and_then(|path| path.split_once('"')).expect("a topic in quotes");
    let mut steps = Vec::new();
    while !rest.is_empty() {
        if let Some(field) = rest.strip_prefix('.') {
            let end = field.find(['.', '[']).unwrap_or(field.len());
            let is_name = |c: char| c.is_ascii_alphanumeric() || c == '_';
            assert!(end > 0 && field[..end].chars().all(is_name), "{path}");
            steps.push(Step::Field(field[..end].to_owned()));
            rest = &field[end..];
        } else {
            let (place, after) = rest.strip_prefix('[').and_then(|rest| rest.split_once(']')).expect("a place");
            steps.push(if place == ":" { Step::All } else { Step::Place(place.parse().expect("a number")) });
            rest = after;
        }
    }
    (topic.to_owned(), steps)
}

/// What a path leads to in a message; none where a field or a place is missing, or a value is null.
fn resolve<'a>(message: &'a Value, steps: &[Step]) -> Vec<&'a Value> {
    let mut found = vec![message];
    for step in steps {
        found = found
            .into_iter()
            .flat_map(|value| match step {
                Step::Field(name) => value.get(name).into_iter().collect::<Vec<_>>(),
                Step::Place(place) => value.get(place).into_iter().collect(),
                Step::All => value.as_array().map(|list| list.iter().collect()).unwrap_or_default(),
            })
            .collect();
    }
    found.into_iter().filter(|value| !value.is_null()).collect()
}

/// What kind of value a panel shows.
#[derive(Clone, Copy, Debug)]
enum Shown {
    Numbers,
    Text,
    Anything,
}

/// All paths of a layout, with what their panels show.
fn paths(layout: &Value) -> Vec<(String, Shown)> {
    let mut found = Vec::new();
    for (id, panel) in layout["configById"].as_object().expect("panels") {
        let shown = match id.split('!').next() {
            Some("Plot") => Shown::Numbers,
            Some("StateTransitions") => Shown::Text,
            _ => Shown::Anything,
        };
        let text = |value: &Value| value.as_str().unwrap_or_else(|| panic!("{id}: {value}")).to_owned();
        for path in panel["paths"].as_array().into_iter().flatten() {
            found.push((text(&path["value"]), shown));
        }
        for key in ["topicPath", "topicToRender"] {
            if let Some(path) = panel.get(key) {
                // The log panel takes a topic's name as it is.
                let path = if key == "topicPath" { text(path) } else { format!("\"{}\"", text(path)) };
                found.push((path, Shown::Anything));
            }
        }
        if let Some(path) = panel.get("xAxisPath") {
            found.push((text(&path["value"]), Shown::Numbers));
        }
    }
    found
}

/// That every path of the layout leads to a value in a message of its topic.
fn assert_resolves(layout: &Value, messages: &BTreeMap<String, Vec<Value>>, of: &str) {
    let paths = paths(layout);
    assert!(paths.len() > 60, "{} paths", paths.len());
    for (path, shown) in &paths {
        let (topic, steps) = parse(path);
        let of_topic = messages.get(&topic).unwrap_or_else(|| panic!("{of}: no message of {topic}"));
        let fits = |value: &&Value| match shown {
            Shown::Numbers => value.is_number(),
            Shown::Text => value.is_string(),
            Shown::Anything => true,
        };
        let count = |message: &Value| {
            let found = resolve(message, &steps);
            if found.iter().all(fits) { found.len() } else { 0 }
        };
        let most = of_topic.iter().map(count).max().unwrap_or(0);
        // A curve has the same number of points on both axes.
        let expected = if steps.contains(&Step::All) { 61 } else { 1 };
        assert_eq!(most, expected, "{of}: {path}: {:?}", of_topic.last());
    }
    println!("{of}: {} paths resolve", paths.len());
}

#[test]
fn paths_are_parsed_and_resolved() {
    let (topic, steps) = parse("\"rivet/a-b/c\".d[1].e_2[:]");
    assert_eq!(topic, "rivet/a-b/c");
    assert_eq!(steps, [Step::Field("d".into()), Step::Place(1), Step::Field("e_2".into()), Step::All]);
    let message = serde_json::json!({"d": [{}, {"e_2": [1, null, 3]}]});
    assert_eq!(resolve(&message, &steps).len(), 2);
    assert!(resolve(&serde_json::json!({"d": [{"e_2": [1]}]}), &steps).is_empty());
}

fn bits(values: &Value) -> Vec<u64> {
    let each = |text: &Value| u64::from_str_radix(text.as_str().expect("a text"), 16).expect("hexadecimal");
    values.as_array().expect("a list").iter().map(each).collect()
}

fn messages(of_topics: &Value) -> BTreeMap<String, Vec<Value>> {
    let each = |(topic, list): (&String, &Value)| (topic.clone(), list.as_array().expect("a list").clone());
    of_topics.as_object().expect("topics").iter().map(each).collect()
}

fn recorded(path: &Path) -> BTreeMap<String, Vec<Value>> {
    let bytes = std::fs::read(path).expect("a recording");
    let mut found: BTreeMap<String, Vec<Value>> = BTreeMap::new();
    for message in mcap::MessageStream::new(&bytes).expect("MCAP") {
        let message = message.expect("a message");
        let value = serde_json::from_slice(&message.data).expect("JSON");
        found.entry(message.channel.topic.clone()).or_default().push(value);
    }
    found
}

#[test]
fn an_independent_client_gets_everything_and_the_loop_does_not_know_of_it() {
    let Some(python) = python() else { return };
    let private = PrivateBus::new("view");
    let config = private.config();
    let bus = Bus::open(config, &name(), "test-robot").expect("the bus");
    let folder = tempfile::tempdir().expect("a folder");
    let layout = folder.path().join("layout.json");
    succeed(rivet_view().arg(robot("dd2")).arg("--layout").arg(&layout));
    let layout: Value = serde_json::from_str(&std::fs::read_to_string(layout).expect("text")).expect("JSON");

    let mut rivetd = running(config);
    let mut robot_side = Robot::new(&bus);
    robot_side.wait_for(1);
    let toml = robot("dd2");
    let toml = toml.to_str().expect("a path");
    let mut command = on_bus(rivet_view(), config, &[toml, "--port", "0"]);
    let mut view = Process::start(command.stderr(Stdio::piped()));
    let stderr = lines(view.0.stderr.take().expect("a pipe"));
    let first = stderr.recv_timeout(Duration::from_secs(300)).expect("it reports where it listens");
    let address = first.split_once("ws://").unwrap_or_else(|| panic!("{first}")).1.to_owned();
    let out = folder.path().join("run.mcap");
    let mut record = on_bus(rivet(), config, &["record", toml, out.to_str().expect("a path")]);
    let mut record = Process::start(&mut record);

    let client = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/view_client.py");
    let mut command = Command::new(python);
    command.arg("-B").arg(client).arg(format!("ws://{address}")).stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut client = Process::start(&mut command);
    let news = lines(client.0.stdout.take().expect("a pipe"));
    assert_eq!(news.recv_timeout(Duration::from_secs(300)).expect("it subscribes"), "subscribed");
    robot_side.wait_for(3);

    // The main run: daemon, view, recorder and client side by side.
    for _ in 0..SAMPLES {
        robot_side.send();
    }
    let health = robot_side.health();
    assert_eq!((health.samples, health.lost, health.gaps), (SAMPLES, 0, 0));
    assert_eq!((health.refused_stale, health.refused_invalid), (0, 0));
    // These depend on what else the machine does: five processes share its processors here, without real time.
    println!("daemon: {} overruns, {} messages dropped", health.overruns, health.dropped_messages);
    assert!(record.end("-INT").success());

    // The daemon is killed: its state becomes silent. A new one is shown as the first one was.
    let state = |wanted: &str| {
        let wanted = format!("daemon {wanted}");
        let news = &news;
        move || news.try_iter().any(|line| line == wanted).then_some(())
    };
    let _ = state("estimating")();
    rivetd.end("-KILL");
    robot_side.send_until("silence is shown", state("silent"));
    let _again = Process::start(&mut daemon(config));
    robot_side.send_until("the new daemon is shown", state("estimating"));
    eventually("parameters of both daemons", || {
        robot_side.send();
        robot_side.sets.values().any(|sets| sets.len() == 2).then_some(())
    });
    for _ in 0..500 {
        robot_side.send();
    }

    // The client ends when its input does.
    drop(client.0.stdin.take());
    let last = eventually("its result", || news.try_iter().find(|line| line.starts_with('{')));
    assert!(client.ends().success());
    let got: Value = serde_json::from_str(&last).expect("JSON");
    let status = view.end("-INT");
    assert!(status.success(), "{status}");
    let counts = std::io::read_to_string(view.0.stdout.take().expect("piped")).expect("text");
    let counts: Value = serde_json::from_str(&counts).expect("JSON");
    println!("{counts:#}");

    assert_eq!(got["subprotocol"], "foxglove.sdk.v1");
    assert_eq!((&got["info"]["name"], &got["info"]["capabilities"]), (&"rivet dd2".into(), &serde_json::json!([])));
    let topics = got["channels"].as_array().expect("channels");
    assert_eq!(topics.len(), 13, "{topics:?}");
    let log = topics.iter().find(|channel| channel["topic"] == "rivet/dd2/log").expect("a log");
    assert_eq!((&log["schemaName"], &log["encoding"]), (&"foxglove.Log".into(), &"json".into()));
    // Joint states: 100 Hz of 1 kHz, each to the bit.
    let states = got["joint_states"].as_object().expect("states");
    assert!(states.len() as u64 >= SAMPLES / 10, "{} states", states.len());
    for (seq, values) in states {
        let state = sample(seq.parse().expect("a number"));
        let expected: Vec<u64> = state.q[..2].iter().chain(&state.tau[..2]).map(|value| value.to_bits()).collect();
        assert_eq!(bits(values), expected, "joint state {seq}");
    }
    // Parameters of both daemons, each to the bit.
    robot_side.take_parameters();
    let sets = got["parameters"].as_object().expect("parameters");
    let mut compared = 0;
    for (epoch, values) in sets {
        let known = &robot_side.sets[&epoch.parse().expect("a number")];
        let expected = |set: &Parameters| -> Vec<u64> {
            let values = set.values[..set.len()].iter().chain(&set.std[..set.len()]);
            values.map(|value| value.to_bits()).collect()
        };
        assert!(known.iter().any(|set| expected(set) == bits(values)), "epoch {epoch}: {values} of {known:?}");
        compared += 1;
    }
    assert!(compared >= 20, "{compared} sets");
    println!("{} joint states and {compared} parameter sets equal to the bit", states.len());
    for topic in counts["topics"].as_array().expect("topics") {
        assert_eq!(topic["dropped"], 0, "{topic}");
        let is_whole = topic["topic"] == "joint-state" || topic["topic"] == "setpoint";
        if is_whole {
            let [all, thinned] = ["messages", "thinned"].map(|key| topic[key].as_u64().expect("a count"));
            assert_eq!((all, topic["missing"].as_u64()), (robot_side.sent, Some(0)), "{topic}");
            assert!(all - thinned <= robot_side.sent / 10 + 1, "{topic}");
        }
    }
    let messages = messages(&got["messages"]);
    // What the killed daemon had reported is null while it is silent; the controller goes on.
    let silent = messages["rivet/dd2/state"].iter().filter(|states| states["daemon"] == "silent");
    let silent: Vec<&Value> = silent.collect();
    assert!(!silent.is_empty());
    for states in silent {
        for field in ["input_fault", "input_joints", "load", "instruments", "active_parameters", "drift", "left_joints"]
        {
            assert!(states[field].is_null(), "{field}: {states}");
        }
        assert_eq!(states["stop_cause"], "none", "{states}");
    }
    assert_resolves(&layout, &messages, "rivet view");
    assert_resolves(&layout, &recorded(&out), "rivet record");
}
