//! The program beside a real `rivetd`, with a robot that speaks by another DDS: Cyclone DDS from Python (peer.py).
//!
//! Bridge and robot are in two network namespaces with a cable between them where the machine allows that, else on loopback. Python is
//! that of `RIVET_PYTHON`; without its module `cyclonedds` the tests are skipped, and say so.

mod common;

use common::{Peer, Stage, eventually};
use rivet_ipc_schema::{Health, Parameters};
use rustix::process::Signal;
use serde_json::Value;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Joint states of a run; 30 000 are a minute.
fn samples() -> u64 {
    std::env::var("RIVET_ROS2_SAMPLES").ok().and_then(|text| text.parse().ok()).unwrap_or(4000)
}

/// Joint states that the daemon has seen of the stream, whatever it did with them.
fn seen(health: &Health) -> u64 {
    health.samples + health.refused_stale + health.refused_invalid + health.rejected_faults + health.samples_held
}

fn number(value: &Value) -> u64 {
    value.as_u64().unwrap_or_else(|| panic!("{value} is no count"))
}

/// A number of Python's `float.hex`.
fn from_hex(text: &str) -> f64 {
    let (sign, rest) = text.strip_prefix('-').map_or((1.0, text), |rest| (-1.0, rest));
    let Some(rest) = rest.strip_prefix("0x") else { return sign * rest.parse::<f64>().expect("inf or nan") };
    let (mantissa, exponent) = rest.split_once('p').expect("an exponent");
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let digits = u64::from_str_radix(&format!("{whole}{fraction}"), 16).expect("hexadecimal");
    let exponent: i32 = exponent.parse().expect("a number");
    // Exact: the digits have 53 bits at most. In two steps, for numbers below the smallest normal one.
    let scale = exponent - 4 * i32::try_from(fraction.len()).expect("short");
    sign * digits as f64 * 2.0_f64.powi(scale / 2) * 2.0_f64.powi(scale - scale / 2)
}

#[test]
fn hexadecimal_numbers_are_read_to_the_bit() {
    for (text, value) in
        [("0x1.999999999999ap-4", 0.1_f64), ("-0x1.8000000000000p+1", -3.0), ("0x0.0p+0", 0.0), ("-0x0.0p+0", -0.0)]
    {
        assert_eq!(from_hex(text).to_bits(), value.to_bits(), "{text}");
    }
    assert_eq!(from_hex("0x0.0000000000001p-1022").to_bits(), 1);
    assert!(from_hex("nan").is_nan() && from_hex("-inf") < 0.0);
}

/// Every joint state with its setpoint reaches the daemon; the parameters come back as they are in shared memory.
#[test]
fn no_sample_is_lost_and_parameters_are_equal_to_the_bit() {
    let Some(stage) = Stage::new("whole") else { return };
    let samples = samples();
    let daemon = stage.daemon();
    let bus = stage.join();
    let (parameters, health) = (bus.parameters_subscriber().expect("a port"), bus.health_subscriber().expect("a port"));
    let bridge =
        stage.bridge(&["--setpoint", "/joint_trajectory_controller/controller_state", "--patience-ms", "1000"]);
    let peer = Peer::start(&stage, &[&samples.to_string()]);
    let mut sets: BTreeMap<u64, Parameters> = BTreeMap::new();
    let mut last = Health::default();
    let mut take = || {
        while let Some(set) = parameters.receive().expect("received") {
            sets.insert(set.epoch, set);
        }
        last = health.receive_newest().expect("received").unwrap_or(last);
        last
    };
    eventually("the daemon has the last sample", || Some(take()).filter(|health| health.seq >= samples));
    let got = peer.finish(&mut || {
        take();
    });
    let summary = bridge.finish();
    drop(daemon);
    let (joint_states, setpoints) = (&summary["joint_states"], &summary["setpoints"]);
    println!("{}: {summary}", stage.place());
    assert_eq!([&joint_states["received"], &joint_states["on_bus"]].map(number), [samples; 2], "{summary}");
    for counter in ["lost", "refused", "faulty", "foreign", "bus_lost"] {
        assert_eq!(number(&joint_states[counter]), 0, "{counter}: {summary}");
    }
    assert_eq!([&setpoints["received"], &setpoints["on_bus"]].map(number), [samples; 2], "{summary}");
    // The daemon's counters are those of an arm that is connected without a network.
    assert_eq!((seen(&last), last.lost, last.setpoints_missing, last.gaps), (samples, 0, 0, 0), "{last:?}");
    assert_eq!((last.refused_stale, last.refused_invalid, last.rejected_faults), (0, 0, 0), "{last:?}");
    assert_eq!((last.dropped_messages, last.polls), (0, 0), "{last:?}");
    println!("daemon: {} samples, {} periods, {} overruns", last.samples, last.periods, last.overruns);
    // From the first set that came on: all, and each to the bit.
    let came: BTreeMap<u64, Vec<f64>> = got["parameters"]
        .as_array()
        .expect("a list")
        .iter()
        .map(|set| {
            let values = set[1].as_array().expect("a list").iter();
            (number(&set[0]), values.map(|value| from_hex(value.as_str().expect("a text"))).collect())
        })
        .collect();
    let first = *came.keys().next().expect("parameters came");
    let expected: Vec<u64> = sets.keys().copied().filter(|epoch| *epoch >= first).collect();
    assert_eq!(came.keys().copied().collect::<Vec<_>>(), expected, "epochs");
    assert!(came.len() as u64 >= samples / 500, "{} sets", came.len());
    for (epoch, values) in &came {
        let set = &sets[epoch];
        let sent = (0..set.len()).flat_map(|i| [set.values[i], set.std[i], set.excitation[i], f64::from(set.state[i])]);
        let bits = |values: Vec<f64>| values.into_iter().map(f64::to_bits).collect::<Vec<_>>();
        assert_eq!(bits(values.clone()), bits(sent.collect()), "epoch {epoch}");
    }
    println!("{} sets of parameters equal to the bit", came.len());
    // The true arm: inertia, viscous and Coulomb friction, first moment.
    let last_set = &sets[expected.last().expect("sets")];
    for (i, truth) in [0.9, 1.5, 2.0, 1.5].into_iter().enumerate() {
        let error = (last_set.values[i] - truth).abs();
        assert!(error < 0.05 * truth, "parameter {}: {} of {truth}", i + 1, last_set.values[i]);
    }
    // The other messages.
    let urdf = got["urdf"].as_str().expect("a text");
    assert!(urdf.contains("<robot name=\"example-arm\">") && urdf.contains("<dynamics damping="), "{urdf}");
    assert!(number(&got["wrenches"]) > 0 && got["wrench"][0] == "link_1", "{}", got["wrench"]);
    let status = got["moving"].as_object().expect("parts");
    for part in ["ROS 2", "rivetd", "parameters"] {
        let status = &status[&format!("rivet example-arm: {part}")];
        assert_eq!(number(&status["level"]), 0, "{part}: {status}");
    }
}

/// A robot controller that is killed and comes back is used again within two seconds of its first message.
#[test]
fn a_peer_that_is_killed_and_comes_back_is_used_again() {
    let Some(stage) = Stage::new("back") else { return };
    let _daemon = stage.daemon();
    let bus = stage.join();
    let states = bus.joint_state_subscriber().expect("a port");
    let health = bus.health_subscriber().expect("a port");
    let bridge = stage.bridge(&[]);
    let peer = Peer::start(&stage, &["1000000", "no-setpoints"]);
    let before = eventually("samples", || states.receive_newest().expect("received").filter(|state| state.seq > 500));
    peer.kill();
    let peer = Peer::start(&stage, &["1000000", "no-setpoints", "no-wait"]);
    while states.receive_newest().expect("received").is_some() {}
    let back = Instant::now();
    let after = eventually("samples", || states.receive_newest().expect("received"));
    let took = back.elapsed();
    println!("used again {:.3} s after its first message", took.as_secs_f64());
    assert!(took < Duration::from_secs(2), "{took:?}");
    assert!(after.seq > before.seq + 1, "the pause is a hole: {} after {}", after.seq, before.seq);
    eventually("more samples", || {
        states.receive_newest().expect("received").filter(|state| state.seq > after.seq + 500)
    });
    peer.kill();
    let health =
        eventually("health", || health.receive_newest().expect("received").filter(|h| h.seq > after.seq + 400));
    assert_eq!((health.refused_stale, health.refused_invalid, health.dropped_messages), (0, 0, 0), "{health:?}");
    let summary = bridge.finish_by(Signal::INT);
    assert_eq!(number(&summary["joint_states"]["lost"]), 0, "{summary}");
}

/// The program is killed and started again while the robot goes on: the daemon gets samples again.
#[test]
fn a_bridge_that_is_killed_and_comes_back_feeds_the_daemon_again() {
    let Some(stage) = Stage::new("again") else { return };
    let _daemon = stage.daemon();
    let bus = stage.join();
    let health = bus.health_subscriber().expect("a port");
    let newest = |samples: u64| {
        eventually("health", || health.receive_newest().expect("received").filter(|health| health.samples > samples))
    };
    let bridge = stage.bridge(&[]);
    let peer = Peer::start(&stage, &["1000000", "no-setpoints"]);
    let before = newest(500);
    bridge.kill();
    let bridge = stage.bridge(&[]);
    let after = newest(before.samples + 1500);
    let summary = bridge.finish();
    drop(peer);
    assert_eq!((after.refused_invalid, after.dropped_messages), (0, 0), "{summary} {after:?}");
    assert_eq!(number(&summary["joint_states"]["lost"]), 0, "{summary}");
}

/// A program on the graph takes nothing any more: the daemon gets every sample all the same.
#[test]
fn a_subscriber_that_hangs_holds_nothing_up() {
    let Some(stage) = Stage::new("hang") else { return };
    let _daemon = stage.daemon();
    let bus = stage.join();
    let health = bus.health_subscriber().expect("a port");
    let newest = |seq: u64| {
        eventually("health", || health.receive_newest().expect("received").filter(|health| health.seq >= seq))
    };
    let bridge = stage.bridge(&[]);
    let listener = Peer::start(&stage, &["0", "listen"]);
    listener.hang();
    let samples = samples();
    let peer = Peer::start(&stage, &[&samples.to_string(), "no-setpoints"]);
    let health = newest(samples);
    assert_eq!((seen(&health), health.lost, health.dropped_messages), (samples, 0, 0), "{health:?}");
    peer.finish(&mut || {});
    let summary = bridge.finish();
    assert_eq!(number(&summary["joint_states"]["on_bus"]), samples, "{summary}");
    println!("sent and not sent: {}", summary["sent"]);
}

/// Joint states of other joints end the program with what was found; best effort is read, and reported.
#[test]
fn other_joints_are_listed_and_best_effort_is_read() {
    let Some(stage) = Stage::new("names") else { return };
    let bridge = stage.bridge(&[]);
    let peer = Peer::start(&stage, &["1000000", "no-setpoints", "names=elbow,wrist"]);
    let (code, stderr) = bridge.ended();
    peer.kill();
    assert_eq!(code, Some(65), "{stderr}");
    assert!(stderr.contains("/joint_states: joint joint_1 missing; the message has joints elbow, wrist"), "{stderr}");
    let bus = stage.join();
    let states = bus.joint_state_subscriber().expect("a port");
    let bridge = stage.bridge(&[]);
    let peer = Peer::start(&stage, &["1000000", "no-setpoints", "best-effort", "other-arm", "malformed"]);
    eventually("samples", || states.receive_newest().expect("received").filter(|state| state.seq > 500));
    // A second one beside it.
    let other = Peer::start(&stage, &["1000000", "no-setpoints", "best-effort"]);
    std::thread::sleep(Duration::from_secs(1));
    let summary = bridge.finish();
    drop((peer, other));
    let problems = summary["problems"].to_string();
    assert!(problems.contains("the publisher offers best effort only"), "{problems}");
    assert!(problems.contains("a message is not of its type"), "{problems}");
    assert!(problems.contains("its joints are elbow, the robot file's joint_1"), "{problems}");
    let joint_states = &summary["joint_states"];
    assert!(number(&joint_states["foreign"]) > 0, "{summary}");
    let named = joint_states["other_publishers"][0].as_str().expect("a publisher").to_owned();
    assert!(problems.contains(&named), "{problems}");
}

/// The link between robot and bridge is cut for seconds, `RIVET_ROS2_CUT_S`: what was lost is counted on both sides of the bridge, samples and
/// reports come again.
#[test]
fn a_link_that_is_cut_and_comes_back_is_used_again() {
    let Some(stage) = Stage::new("cut") else { return };
    let _daemon = stage.daemon();
    let bus = stage.join();
    let health = bus.health_subscriber().expect("a port");
    let states = bus.joint_state_subscriber().expect("a port");
    let newest = |samples: u64| {
        eventually("health", || health.receive_newest().expect("received").filter(|health| health.samples > samples))
    };
    let bridge = stage.bridge(&[]);
    let cut_s = std::env::var("RIVET_ROS2_CUT_S").ok().and_then(|text| text.parse().ok()).unwrap_or(3);
    // DDS has to find the other side again after a cut of more than ten seconds.
    let samples = 4000 + 500 * cut_s * if cut_s > 5 { 3 } else { 1 };
    let peer = Peer::start(&stage, &[&samples.to_string(), "no-setpoints"]);
    newest(500);
    if !stage.cut(true) {
        return;
    }
    std::thread::sleep(Duration::from_secs(cut_s));
    while states.receive_newest().expect("received").is_some() {}
    stage.cut(false);
    let back = Instant::now();
    eventually("samples", || states.receive_newest().expect("received"));
    println!("used again {:.3} s after a cut of {cut_s} s", back.elapsed().as_secs_f64());
    let reports_before = newest(1000);
    let got = peer.finish(&mut || {});
    let health = newest(reports_before.samples + 500);
    let summary = bridge.finish();
    let [received, lost] = ["received", "lost"].map(|key| number(&summary["joint_states"][key]));
    assert!(lost > 0, "{summary}");
    assert_eq!(received + lost, samples, "{summary}");
    assert_eq!((seen(&health), health.lost), (received, lost), "{health:?}");
    assert_eq!((health.refused_invalid, health.dropped_messages), (0, 0), "{health:?}");
    let status = &got["status"]["rivet example-arm: ROS 2"];
    assert_eq!(status["values"]["joint states lost"], lost.to_string().as_str(), "the report after the cut: {status}");
}

/// Domains separate graphs.
#[test]
fn another_domain_is_another_graph() {
    let Some(stage) = Stage::new("domain") else { return };
    let bridge = stage.bridge_on(stage.domain() + 1, &["--seconds", "3"]);
    let peer = Peer::spawn(&stage, &["1000000", "no-setpoints"]);
    let summary = bridge.wait();
    drop(peer);
    assert_eq!(number(&summary["joint_states"]["received"]), 0, "{summary}");
}
