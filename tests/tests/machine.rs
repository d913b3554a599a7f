//! `rivet doctor` and `rivet bench-loop` on the machine at hand, whatever it is.

use rivet_ipc_schema::{Bus, BusConfig, JointState, PrivateBus, RobotName};
use rivet_tests::process::eventually;
use rivet_tests::{rivet, robot, succeed};
use std::process::{Command, Stdio};

/// Not a test: a party of the bus that is killed.
#[test]
#[ignore = "run by a test as a process of its own"]
fn party_that_is_killed() {
    let Ok(prefix) = std::env::var("RIVET_TEST_PREFIX") else { return };
    let root = std::env::var("RIVET_TEST_ROOT").expect("set together").into();
    rivet_realtime::die_with_parent().expect("the test lives");
    let config = BusConfig { prefix, root };
    let bus = Bus::open(&config, &RobotName::new("dd2").expect("a name"), "test-party").expect("the bus opens");
    let _states = bus.joint_state_publisher().expect("a publisher");
    println!("here");
    std::thread::sleep(std::time::Duration::from_secs(600));
}

/// A party that was killed, and has left what it had.
fn killed_party(config: &BusConfig) {
    let mut command = Command::new(std::env::current_exe().expect("a running test has a file"));
    command.args(["--ignored", "--exact", "--nocapture", "party_that_is_killed"]).stderr(Stdio::null());
    command.env("RIVET_TEST_PREFIX", &config.prefix).env("RIVET_TEST_ROOT", &config.root);
    let mut party = command.stdout(Stdio::piped()).spawn().expect("it starts");
    let said = std::io::BufReader::new(party.stdout.take().expect("piped"));
    let mut lines = std::io::BufRead::lines(said);
    eventually("the party is there", || {
        let line = lines.next()?.expect("a line");
        line.contains("here").then_some(())
    });
    let alive = look(config, &[], "stale shared memory");
    assert_eq!(alive["severity"], "ok", "{alive}");
    party.kill().expect("killed");
    party.wait().expect("it ends");
}

/// What the doctor says of `check`.
fn look(config: &BusConfig, options: &[&str], check: &str) -> serde_json::Value {
    let mut doctor = rivet();
    doctor.args(["doctor", "--seconds", "0", "--json", "--prefix", &config.prefix, "--root"]).arg(&config.root);
    let output = doctor.args(options).arg(robot("dd2")).output().expect("it starts");
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let finding = found["findings"].as_array().expect("a list").iter().find(|finding| finding["check"] == check);
    finding.expect("looked at").clone()
}

/// What a killed process leaves in shared memory is seen by the doctor, with what to do about it; who joins next frees it.
#[test]
fn the_doctor_sees_what_the_dead_have_left() {
    let private = PrivateBus::new("doctor");
    let stale = || look(private.config(), &[], "stale shared memory");
    assert_eq!(stale()["severity"], "ok", "nobody was here");
    killed_party(private.config());
    let left = stale();
    assert_eq!(left["severity"], "warning", "{left}");
    assert_eq!(left["found"], "1 dead processes left theirs", "{left}");
    assert!(left["change"].as_str().expect("a line to change").contains(&private.config().clean_command()), "{left}");
    drop(Bus::open(private.config(), &RobotName::new("dd2").expect("a name"), "test-next").expect("the bus opens"));
    rivet_ipc_schema::cleanup(private.config()).expect("cleaned");
    assert_eq!(stale()["severity"], "ok", "freed");
}

/// Following the doctor's advice takes nothing from a party at work, and everything from an empty bus.
#[test]
fn the_doctor_clears_away_only_what_nobody_uses() {
    let private = PrivateBus::new("clean");
    let config = private.config();
    let bus = Bus::open(config, &RobotName::new("dd2").expect("a name"), "test-alive").expect("the bus opens");
    let states = bus.joint_state_publisher().expect("a publisher");
    killed_party(config);
    let advice = look(config, &[], "stale shared memory");
    let change = advice["change"].as_str().expect("a line to change");
    assert!(change.contains("no program has to stop") && change.contains(&config.clean_command()), "{advice}");
    let cleaned = look(config, &["--clean"], "clean");
    assert_eq!(cleaned["severity"], "ok", "{cleaned}");
    assert_eq!(cleaned["found"], "1 dead parties freed, 0 files removed", "{cleaned}");
    let after = look(config, &[], "stale shared memory");
    assert_eq!(after["found"], "none; 1 parties alive", "{after}");
    // The party at work can still be joined, and heard.
    let onlooker = Bus::open(config, bus.robot(), "test-onlooker").expect("the bus opens");
    let heard = onlooker.joint_state_subscriber().expect("a subscriber");
    assert_eq!(states.send(&JointState { seq: 1, ..JointState::default() }).expect("sent"), 1);
    assert_eq!(heard.receive().expect("received").map(|state| state.seq), Some(1));
    drop((heard, onlooker, states, bus));
    let cleaned = look(config, &["--clean"], "clean");
    assert_eq!(cleaned["severity"], "ok", "{cleaned}");
    assert!(!config.root.exists(), "{cleaned}");
}

/// Both distributions are printed, side by side, with the loop's own work; no figure is judged here.
#[test]
fn the_loop_and_plain_wake_ups_are_measured_side_by_side() {
    let output = succeed(rivet().args(["bench-loop", "--seconds", "2", "--load", "idle"]).arg(robot("dd2")));
    let text = String::from_utf8(output.stdout).expect("text");
    println!("{text}");
    // Each row: periods, then quantiles in order.
    for row in ["wake-up, as cyclictest measures", "wake-up of the loop", "own work of a period", "due to done"] {
        let line = text.lines().find_map(|line| line.trim().strip_prefix(row)).expect(row);
        let figures: Vec<f64> = line.split_whitespace().map(|word| word.parse().expect("a number")).collect();
        assert!(figures[0] > 500.0, "{row}: two seconds at 1 kHz, less what this machine lost: {line}");
        assert!(figures[1..5].windows(2).all(|pair| pair[0] <= pair[1]), "{row}: {line}");
    }
}
