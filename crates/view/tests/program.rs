//! The program and its server, with a client of the library's own: what goes wrong is said, and nothing waits for a slow client.

use std::io::{BufRead as _, BufReader};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use rivet_ipc_schema::{Bus, JointState, PrivateBus, RobotName};
use rivet_view::{Channel, Server};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};
use tungstenite::client::IntoClientRequest as _;
use tungstenite::http::HeaderValue;
use tungstenite::{Message, WebSocket};

/// Waits for something without asking how long it takes; only a hang fails.
fn eventually<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let begin = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(begin.elapsed() < Duration::from_secs(300), "never: {what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn robot(name: &str) -> PathBuf {
    root().join("robots").join(name).join("robot.toml")
}

fn view(words: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rivet-view"));
    command.args(words).stdin(Stdio::null());
    command
}

fn on_bus<'a>(command: &'a mut Command, bus: &PrivateBus) -> &'a mut Command {
    command.arg("--prefix").arg(&bus.config().prefix).arg("--root").arg(&bus.config().root).arg("--die-with-parent")
}

fn ended(output: &Output) -> (Option<i32>, String) {
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

/// The program, with the address that it reports.
struct Running {
    child: Child,
    address: String,
    lines: std::sync::mpsc::Receiver<String>,
}

impl Running {
    fn start(bus: &PrivateBus, words: &[&str]) -> Running {
        let mut command = view(&[]);
        command.arg(robot("dd2")).args(["--port", "0", "--json"]).args(words);
        on_bus(&mut command, bus).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().expect("it starts");
        let errors = BufReader::new(child.stderr.take().expect("a pipe"));
        let (give, lines) = std::sync::mpsc::channel();
        std::thread::spawn(move || errors.lines().map_while(Result::ok).try_for_each(|line| give.send(line)));
        let first = lines.recv_timeout(Duration::from_secs(300)).expect("it reports where it listens");
        let (_, address) = first.split_once("ws://").unwrap_or_else(|| panic!("{first}"));
        Running { address: address.to_owned(), child, lines }
    }

    /// Waits for a line of standard error.
    fn says(&self, part: &str) {
        loop {
            let line = self.lines.recv_timeout(Duration::from_secs(300)).unwrap_or_else(|_| panic!("never: {part}"));
            if line.contains(part) {
                return;
            }
        }
    }

    /// Ends it by a signal; its counts.
    fn finish(mut self, signal: Signal) -> Value {
        let pid = i32::try_from(self.child.id()).ok().and_then(Pid::from_raw).expect("a process");
        kill_process(pid, signal).expect("it runs");
        let text = std::io::read_to_string(self.child.stdout.take().expect("a pipe")).expect("text");
        assert_eq!(self.child.wait().expect("waited").code(), Some(0), "{text}");
        serde_json::from_str(&text).unwrap_or_else(|why| panic!("{why}: {text}"))
    }
}

/// A client, after the handshake.
fn connect(address: &str, protocol: &str) -> Result<WebSocket<TcpStream>, String> {
    let stream = TcpStream::connect(address).expect("it listens");
    let mut request = format!("ws://{address}/").into_client_request().expect("a request");
    request.headers_mut().insert("sec-websocket-protocol", HeaderValue::from_str(protocol).expect("a header"));
    tungstenite::client(request, stream).map(|(socket, _)| socket).map_err(|why| why.to_string())
}

/// The next text message of this operation.
fn text(socket: &mut WebSocket<TcpStream>, op: &str) -> Value {
    loop {
        if let Message::Text(text) = socket.read().expect("a message") {
            let value: Value = serde_json::from_str(&text).expect("JSON");
            if value["op"] == op {
                return value;
            }
        }
    }
}

/// The next message data: subscription, and payload.
fn data(socket: &mut WebSocket<TcpStream>) -> (u32, Vec<u8>) {
    loop {
        if let Message::Binary(data) = socket.read().expect("a message") {
            assert_eq!(data[0], 1, "message data");
            let id = u32::from_le_bytes(data[1..5].try_into().expect("four bytes"));
            return (id, data[13..].to_vec());
        }
    }
}

fn send(socket: &mut WebSocket<TcpStream>, value: &Value) {
    socket.send(Message::text(value.to_string())).expect("sent");
}

#[test]
fn the_shipped_layout_is_that_of_the_robot_of_the_demonstration() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("layout.json");
    let status = view(&[]).arg(robot("manutec-r3")).arg("--layout").arg(&out).status().expect("it runs");
    assert!(status.success());
    let made = std::fs::read_to_string(out).expect("written");
    let shipped = root().join("crates/view/layouts/rivet.json");
    let found = std::fs::read_to_string(&shipped).unwrap_or_default();
    assert!(made == found, "rivet view robots/manutec-r3/robot.toml --layout {} makes it anew", shipped.display());
    let nowhere = folder.path().join("no/folder.json");
    let output = view(&[]).arg(robot("manutec-r3")).arg("--layout").arg(&nowhere).output().expect("it runs");
    assert_eq!(ended(&output).0, Some(74), "{}", ended(&output).1);
}

#[test]
fn a_port_in_use_a_foreign_host_and_a_missing_robot_are_named() {
    let bus = PrivateBus::new("viewport");
    let taken = TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = taken.local_addr().expect("an address").port().to_string();
    let run = |words: &[&str]| ended(&on_bus(view(&[]).arg(robot("dd2")).args(words), &bus).output().expect("it runs"));
    let (code, text) = run(&["--port", &port]);
    assert_eq!(code, Some(69), "{text}");
    assert!(text.contains(&format!("127.0.0.1:{port} is in use")) && text.contains("--port"), "{text}");
    // An address of documentation (RFC 5737), and a name that no resolver has (RFC 6761).
    for host in ["192.0.2.7", "no-such-host.invalid"] {
        let (code, text) = run(&["--port", "0", "--host", host]);
        assert_eq!(code, Some(69), "{text}");
        assert!(text.contains(host) && text.contains("--host must be an address of this machine"), "{text}");
    }
    // An address of IPv6 as it stands in a URL.
    if TcpListener::bind("[::1]:0").is_ok() {
        let (code, text) = run(&["--port", "0", "--host", "[::1]", "--seconds", "0.1"]);
        assert_eq!(code, Some(0), "{text}");
        assert!(text.contains("ws://[::1]:"), "{text}");
    }
    let output = view(&["no-robot.toml"]).output().expect("it runs");
    assert_eq!(ended(&output).0, Some(78), "{}", ended(&output).1);
    let output = view(&["robot.toml", "--rate", "-1"]).output().expect("it runs");
    assert_eq!(ended(&output).0, Some(64), "{}", ended(&output).1);
}

#[test]
fn joint_states_arrive_to_the_bit_and_at_most_at_the_rate() {
    let bus = PrivateBus::new("viewrate");
    let running = Running::start(&bus, &["--rate", "50"]);
    running.says("waiting for joint states of dd2");
    let mut socket = connect(&running.address, "foxglove.websocket.v1").expect("connected");
    assert_eq!(text(&mut socket, "serverInfo")["name"], "rivet dd2");
    let channels = text(&mut socket, "advertise")["channels"].clone();
    let channel = |name: &str| {
        let topic = format!("rivet/dd2/{name}");
        let found = channels.as_array().expect("channels").iter().find(|channel| channel["topic"] == topic.as_str());
        found.unwrap_or_else(|| panic!("{topic}: {channels}")).clone()
    };
    let schema: Value = serde_json::from_str(channel("joint-state")["schema"].as_str().expect("a text")).expect("JSON");
    assert!(schema["properties"]["q"]["description"].is_string(), "{schema}");
    let wanted = json!([{"id": 7, "channelId": channel("joint-state")["id"]}, {"id": 8, "channelId": 99}]);
    send(&mut socket, &json!({"op": "subscribe", "subscriptions": wanted}));
    assert_eq!(text(&mut socket, "status")["message"], "there is no channel 99");
    // Nothing is refused in silence, and nothing is written to the bus.
    send(&mut socket, &json!({"op": "advertise", "channels": []}));
    assert!(text(&mut socket, "status")["message"].as_str().is_some_and(|text| text.contains("never writes")));
    let parties = Bus::open(bus.config(), &RobotName::new("dd2").expect("a name"), "test").expect("the bus");
    let states = parties.joint_state_publisher().expect("a port");
    eventually("it listens", || (states.subscribers() == 1).then_some(()));
    let q = |seq: u64| (seq as f64 / std::f64::consts::PI).sin() / 3.0;
    for seq in 1..=1000 {
        let state = JointState { seq, stamp_ns: seq * 1_000_000, joints: 2, q: [q(seq); 8], ..JointState::default() };
        states.send(&state).expect("sent");
        if seq % 100 == 0 {
            std::thread::sleep(Duration::from_millis(20));
        }
    }
    // The first, and each 20th after it: 50 of the second.
    for expected in (0..50).map(|k| 1 + 20 * k) {
        let (id, payload) = data(&mut socket);
        let value: Value = serde_json::from_slice(&payload).expect("JSON");
        assert_eq!((id, value["seq"].as_u64()), (7, Some(expected)));
        let bits: Vec<u64> =
            value["q"].as_array().expect("a list").iter().map(|q| q.as_f64().expect("q").to_bits()).collect();
        assert_eq!(bits, [q(expected).to_bits(); 2], "{value}");
    }
    running.says("joint states of dd2 come");
    let counts = running.finish(Signal::INT);
    let topic = |name: &str| {
        counts["topics"].as_array().expect("topics").iter().find(|topic| topic["topic"] == name).expect("it").clone()
    };
    let states = topic("joint-state");
    let numbers = ["messages", "thinned", "sent", "dropped", "missing"].map(|key| states[key].as_u64());
    assert_eq!(numbers, [Some(1000), Some(950), Some(50), Some(0), Some(0)], "{counts}");
    assert_eq!(counts["clients"], 1, "{counts}");
}

#[test]
fn a_signal_ends_it_with_clients_and_another_protocol_is_refused() {
    let bus = PrivateBus::new("viewend");
    let running = Running::start(&bus, &[]);
    let why = connect(&running.address, "foxglove.sdk.v9").expect_err("refused");
    assert!(why.contains("400"), "{why}");
    let mut socket = connect(&running.address, "x, foxglove.sdk.v1").expect("connected");
    assert_eq!(text(&mut socket, "serverInfo")["capabilities"], json!([]));
    let counts = running.finish(Signal::TERM);
    assert_eq!((&counts["clients"], &counts["refused_connections"]), (&json!(1), &json!(1)), "{counts}");
    // The connection is closed in order.
    loop {
        match socket.read() {
            Ok(Message::Close(_)) => break,
            Ok(_) => {}
            Err(why) => panic!("{why}"),
        }
    }
}

/// A client that reads nothing loses the oldest messages, counted; another one gets all of its own.
#[test]
fn a_slow_client_loses_messages_and_holds_up_nobody() {
    let channel = |topic: &str, is_kept| Channel {
        topic: topic.to_owned(),
        schema_name: "S".to_owned(),
        schema: "{}".to_owned(),
        is_kept,
    };
    let channels = vec![channel("fast", false), channel("kept", true)];
    let server = Server::start("127.0.0.1", 0, "test", "1", channels).expect("it listens");
    let address = server.address().to_string();
    let subscribe =
        |id: u32, channel: u32| json!({"op": "subscribe", "subscriptions": [{"id": id, "channelId": channel}]});
    server.publish(1, 5, b"[1]");
    assert!(!server.wants(0) && server.wants(1));
    let mut slow = connect(&address, "foxglove.sdk.v1").expect("connected");
    send(&mut slow, &subscribe(1, 0));
    eventually("it has subscribed", || server.wants(0).then_some(()));
    let mut quick = connect(&address, "foxglove.sdk.v1").expect("connected");
    send(&mut quick, &subscribe(4, 1));
    assert_eq!(data(&mut quick), (4, b"[1]".to_vec()), "the last message at once");
    // More than sockets and queue hold together.
    let payload = vec![b' '; 64 << 10];
    let dropped = eventually("messages are dropped", || {
        server.publish(0, 6, &payload);
        Some(server.counts(0).1).filter(|dropped| *dropped > 100)
    });
    server.publish(1, 7, b"[2]");
    assert_eq!(data(&mut quick), (4, b"[2]".to_vec()));
    println!("{} sent, {dropped} dropped", server.counts(0).0);
    send(&mut quick, &json!({"op": "unsubscribe", "subscriptionIds": [4, 5]}));
    assert_eq!(text(&mut quick, "status")["message"], "there is no subscription 5");
    drop(slow);
    eventually("it has left", || (server.clients() == (1, 2)).then_some(()));
    assert!(!server.wants(0));
}

fn kept_channel() -> Vec<Channel> {
    let [topic, schema_name, schema] = ["kept", "S", "{}"].map(str::to_owned);
    vec![Channel { topic, schema_name, schema, is_kept: true }]
}

/// The last message goes to the subscription that is new, once; the next one to all.
#[test]
fn a_kept_message_goes_to_each_new_subscription_once() {
    let server = Server::start("127.0.0.1", 0, "test", "1", kept_channel()).expect("it listens");
    server.publish(0, 5, b"[1]");
    let mut socket = connect(&server.address().to_string(), "foxglove.sdk.v1").expect("connected");
    for id in [1, 2] {
        send(&mut socket, &json!({"op": "subscribe", "subscriptions": [{"id": id, "channelId": 0}]}));
        assert_eq!(data(&mut socket), (id, b"[1]".to_vec()));
    }
    server.publish(0, 6, b"[2]");
    assert_eq!([data(&mut socket), data(&mut socket)], [(1, b"[2]".to_vec()), (2, b"[2]".to_vec())]);
}

/// Neither a client that subscribes to much and takes nothing, nor one that never ends its handshake, holds up the end.
#[test]
fn clients_that_stand_still_do_not_hold_up_the_end() {
    let server = Server::start("127.0.0.1", 0, "test", "1", kept_channel()).expect("it listens");
    let address = server.address().to_string();
    server.publish(0, 5, &vec![b' '; 64 << 10]);
    let mut greedy = connect(&address, "foxglove.sdk.v1").expect("connected");
    let wanted: Vec<Value> = (0..1024).map(|id| json!({"id": id, "channelId": 0})).collect();
    send(&mut greedy, &json!({"op": "subscribe", "subscriptions": wanted}));
    let half_open = TcpStream::connect(&address).expect("connected");
    eventually("it takes nothing more", || {
        let before = server.counts(0).0;
        std::thread::sleep(Duration::from_millis(300));
        (before > 0 && server.counts(0).0 == before).then_some(())
    });
    let ending = std::thread::spawn(move || drop(server));
    eventually("the server has ended", || ending.is_finished().then_some(()));
    drop((greedy, half_open));
}

/// Who connects while all places are taken is refused; a place that is free again is used.
#[test]
fn one_client_too_many_is_refused() {
    let server = Server::start("127.0.0.1", 0, "test", "1", Vec::new()).expect("it listens");
    let address = server.address().to_string();
    let mut all: Vec<_> = (0..16).map(|_| connect(&address, "foxglove.sdk.v1").expect("connected")).collect();
    connect(&address, "foxglove.sdk.v1").expect_err("one too many");
    assert_eq!(server.refused(), 1);
    drop(all.pop());
    eventually("a place is free", || connect(&address, "foxglove.sdk.v1").ok());
}

/// Counts that could not be printed are a failure: who reads them would take their absence for success.
#[test]
fn full_standard_output_is_a_failure() {
    let bus = PrivateBus::new("view-full");
    let mut command = view(&[]);
    command.arg(robot("dd2")).args(["--port", "0", "--json", "--seconds", "0.2"]);
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full").expect("/dev/full");
    let output = on_bus(&mut command, &bus).stdout(full).output().expect("it runs");
    let (code, stderr) = ended(&output);
    assert!(code == Some(74) && stderr.contains("standard output cannot be written"), "{code:?} {stderr}");
}
