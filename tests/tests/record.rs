//! `rivet record` beside a running rivetd: everything is in the file, also when the recorder is killed; the loop loses nothing.

use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rivet_ipc_schema::{Bus, BusConfig, Health, JointState, PrivateBus, Publisher, Setpoint, Subscriber};
use rivet_logs::{Log, ReadOptions, read};
use rivet_tests::process::{Process, eventually};
use rivet_tests::two_link::{name, running, sample};
use rivet_tests::{rivet, robot, succeed};

/// A robot controller and planner that publish every millisecond.
struct Robot {
    states: Publisher<JointState>,
    plans: Publisher<Setpoint>,
    health: Subscriber<Health>,
    /// Since when, and how many had been sent then.
    begin: (Instant, u64),
    sent: u64,
}

fn plan(seq: u64) -> Setpoint {
    let mut plan = Setpoint { seq, stamp_ns: seq * 1_000_000, joints: 2, ..Setpoint::default() };
    for joint in 0..2 {
        plan.q[joint] = sample(seq + 3).q[joint];
        plan.qdd[joint] = sample(seq).tau[joint];
    }
    plan
}

impl Robot {
    fn new(bus: &Bus) -> Robot {
        Robot {
            states: bus.joint_state_publisher().expect("a publisher"),
            plans: bus.setpoint_publisher().expect("a publisher"),
            health: bus.health_subscriber().expect("a subscriber"),
            begin: (Instant::now(), 0),
            sent: 0,
        }
    }

    /// Waits until so many listen to joint states and setpoints.
    fn wait_for(&mut self, listeners: usize) {
        let all = || (self.states.subscribers(), self.plans.subscribers()) == (listeners, listeners);
        eventually("all listen", || all().then_some(()));
        self.begin = (Instant::now(), self.sent);
    }

    fn send(&mut self) {
        self.sent += 1;
        self.plans.send(&plan(self.sent)).expect("sent");
        self.states.send(&sample(self.sent)).expect("sent");
        let (begin, before) = self.begin;
        let due = begin + Duration::from_millis(self.sent - before);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
    }

    /// What the daemon reports once it has had the last sample.
    fn health(&self) -> Health {
        eventually("the last sample is in", || {
            self.health.receive().expect("received").filter(|health| health.seq == self.sent)
        })
    }
}

fn record(config: &BusConfig, out: &Path) -> Command {
    let mut command = rivet();
    command.arg("record").arg(robot("dd2")).arg(out).args(["--json", "--prefix", &config.prefix]);
    command.arg("--root").arg(&config.root).stdout(Stdio::piped());
    command
}

/// That row `row` is sample `seq` with its setpoint, to the bit.
fn assert_row(log: &Log, row: usize, seq: u64) {
    let (state, plan) = (sample(seq), plan(seq));
    let [q_des, qdd_des] = [&log.q_des, &log.qdd_des].map(|signal| signal.as_ref().expect("a plan"));
    for joint in 0..2 {
        let found =
            [log.q[joint][row], log.torque().expect("torque")[joint][row], q_des[joint][row], qdd_des[joint][row]];
        assert_eq!(
            found,
            [state.q[joint], state.tau[joint], plan.q[joint], plan.qdd[joint]],
            "row {row}, sample {seq}"
        );
    }
}

#[test]
fn everything_is_recorded_and_the_loop_does_not_know_of_it() {
    let private = PrivateBus::new("record");
    let config = private.config();
    let bus = Bus::open(config, &name(), "test-robot").expect("the bus");
    let _daemon = running(config);
    let mut robot = Robot::new(&bus);
    robot.wait_for(1);
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run.mcap");
    let mut recorder = Process::start(&mut record(config, &out));
    robot.wait_for(2);
    for _ in 0..2500 {
        robot.send();
    }
    let health = robot.health();
    let status = recorder.end("-INT");
    assert!(status.success(), "{status}");
    let printed = std::io::read_to_string(recorder.0.stdout.take().expect("piped")).expect("text");
    let printed: serde_json::Value = serde_json::from_str(&printed).expect("JSON");
    let service = |name: &str, count: &str| -> u64 {
        let services = printed["services"].as_array().expect("services");
        services.iter().find(|s| s["service"] == name).and_then(|s| s[count].as_u64()).expect("a count")
    };
    for name in ["joint-state", "setpoint"] {
        let counts = ["messages", "missing", "dropped"].map(|count| service(name, count));
        assert_eq!(counts, [2500, 0, 0], "{name}: {printed}");
    }
    assert!(service("health", "messages") > 0 && service("parameters", "messages") > 0, "{printed}");
    assert_eq!((health.samples, health.lost, health.dropped_messages), (2500, 0, 0));
    let log = read(&out, &ReadOptions::new(2)).expect("a log");
    assert_eq!(log.len(), 2500);
    (0..2500).for_each(|row| assert_row(&log, row, row as u64 + 1));
    // A second recording of that name is refused, and the first stays.
    let again = record(config, &out).output().expect("it runs");
    let words = String::from_utf8_lossy(&again.stderr).into_owned();
    assert!(!again.status.success() && words.contains("replaces no file"), "{words}");
    converted(folder.path(), &out, &log);
}

/// Other formats of it hold the same numbers.
fn converted(folder: &Path, recording: &Path, log: &Log) {
    let mut from = recording.to_owned();
    for name in ["run.csv", "run.parquet"] {
        let to = folder.join(name);
        let output = succeed(rivet().arg("convert").args([&from, &to]).arg("--json"));
        let printed: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
        assert_eq!(printed["rows"], log.len());
        let again = read(&to, &ReadOptions::new(2)).expect("a log");
        assert_eq!(
            (&again.t, &again.q, &again.tau, &again.qdd_des),
            (&log.t, &log.q, &log.tau, &log.qdd_des),
            "{name}"
        );
        from = to;
    }
    let again = rivet().arg("convert").args([recording, &from]).output().expect("it runs");
    let words = String::from_utf8_lossy(&again.stderr).into_owned();
    assert!(!again.status.success() && words.contains("--force"), "{words}");
    let itself = rivet().arg("convert").args([&from, &from]).arg("--force").output().expect("it runs");
    assert!(!itself.status.success() && read(&from, &ReadOptions::new(2)).is_ok());
    let refused = rivet().arg("convert").args([&from, &folder.join("run.bag")]).output().expect("it runs");
    let words = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(!refused.status.success() && words.contains("run.bag") && words.contains(".mcap"), "{words}");
}

/// Counts that could not be printed are a failure; the recording is there all the same.
#[test]
fn full_standard_output_is_a_failure() {
    let private = PrivateBus::new("record-full");
    let config = private.config();
    let bus = Bus::open(config, &name(), "test-robot").expect("the bus");
    let mut robot = Robot::new(&bus);
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run.mcap");
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full").expect("/dev/full");
    let mut recorder = Process::start(record(config, &out).stdout(full));
    robot.wait_for(1);
    (0..100).for_each(|_| robot.send());
    // What was sent is taken before a signal is looked at once more.
    std::thread::sleep(Duration::from_millis(200));
    assert_eq!(recorder.end("-INT").code(), Some(74));
    assert!(!read(&out, &ReadOptions::new(2)).expect("a log").is_empty());
}

/// Messages of joint states that Python's `mcap` reads before the file breaks off; none where Python lacks it.
fn read_by_python(path: &Path) -> Option<u64> {
    let script = "import sys\nfrom mcap.stream_reader import StreamReader\nfrom mcap.records import Channel, Message\n\
                  topics, count = {}, 0\n\
                  try:\n for r in StreamReader(open(sys.argv[1], 'rb')).records:\n\
                  \x20 if isinstance(r, Channel): topics[r.id] = r.topic\n\
                  \x20 if isinstance(r, Message) and topics[r.channel_id].endswith('joint-state'): count += 1\n\
                  except Exception: pass\nprint(count)";
    let python = std::env::var_os("RIVET_PYTHON").unwrap_or_else(|| "python3".into());
    let has_it = Command::new(&python).args(["-c", "import mcap"]).output().is_ok_and(|output| output.status.success());
    if !has_it {
        let _ = writeln!(std::io::stderr(), "SKIPPED: Python has no mcap to read the recording with");
        return None;
    }
    let output = Command::new(&python).args(["-c", script]).arg(path).output().expect("python runs");
    Some(String::from_utf8_lossy(&output.stdout).trim().parse().expect("a number"))
}

#[test]
fn a_killed_recorder_leaves_all_but_the_last_chunk() {
    let private = PrivateBus::new("record-killed");
    let config = private.config();
    let bus = Bus::open(config, &name(), "test-robot").expect("the bus");
    let mut robot = Robot::new(&bus);
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run.mcap");
    let mut recorder = Process::start(&mut record(config, &out));
    robot.wait_for(1);
    // Samples that had been sent whenever the file was seen to have grown: by what it makes at its beginning, then by a chunk each.
    let mut grown: Vec<u64> = Vec::new();
    let mut size = 0;
    while grown.len() < 5 {
        assert!(robot.sent < 100_000, "the file does not grow");
        robot.send();
        let now = std::fs::metadata(&out).map_or(0, |file| file.len());
        if now > size {
            size = now;
            grown.push(robot.sent);
        }
    }
    recorder.end("-KILL");
    let log = read(&out, &ReadOptions::new(2)).expect("a log");
    // The chunk before the last was written when the last but one was begun.
    assert!(log.len() as u64 >= grown[2], "{} of {} samples, the file grew at {grown:?}", log.len(), robot.sent);
    (0..log.len()).for_each(|row| assert_row(&log, row, row as u64 + 1));
    if let Some(count) = read_by_python(&out) {
        assert_eq!(count, log.len() as u64);
    }
}
