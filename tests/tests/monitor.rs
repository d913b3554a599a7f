//! Whoever looks on, and whoever floods the control service: the loop's work is what it is without them.

use rivet_ipc_schema::{Bus, BusConfig, ControlCommand, ControllerHealth, Health, PrivateBus};
use rivet_realtime::LogHistogram;
use rivet_tests::process::{Process, eventually};
use rivet_tests::two_link::{name, running, sample};
use rivet_tests::{rivet, robot, succeed};
use std::io::Read as _;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Samples at their own rate, four seconds of them.
const SAMPLES: u64 = 4000;

fn monitor(config: &BusConfig, patience: &str) -> Command {
    let mut command = rivet();
    command.arg("monitor").arg(robot("dd2")).args(["--once", "--patience", patience, "--prefix", &config.prefix]);
    command.arg("--root").arg(&config.root);
    command
}

/// The daemon's last report after the samples, with `beside` at work next to it until told to stop.
fn run(beside: impl FnOnce(BusConfig, Arc<AtomicBool>) + Send + 'static) -> Health {
    let private = PrivateBus::new("monitor");
    let config = private.config().clone();
    let bus = Bus::open(&config, &name(), "test-robot").expect("the bus");
    let states = bus.joint_state_publisher().expect("a publisher");
    let health = bus.health_subscriber().expect("a subscriber");
    let _daemon = running(&config);
    eventually("rivetd listens", || (states.subscribers() > 0).then_some(()));
    let stop = Arc::new(AtomicBool::new(false));
    let neighbour = std::thread::spawn({
        let (config, stop) = (config.clone(), Arc::clone(&stop));
        move || beside(config, stop)
    });
    let begin = Instant::now();
    for seq in 1..=SAMPLES {
        states.send(&sample(seq)).expect("sent");
        std::thread::sleep((begin + Duration::from_millis(seq)).saturating_duration_since(Instant::now()));
    }
    let last = loop {
        assert!(begin.elapsed() < Duration::from_secs(60), "rivetd has not taken all samples");
        match health.receive().expect("received") {
            Some(health) if health.seq == SAMPLES => break health,
            _ => std::thread::sleep(Duration::from_millis(1)),
        }
    };
    stop.store(true, Ordering::Relaxed);
    neighbour.join().expect("no panic");
    last
}

fn median(health: &Health) -> u64 {
    LogHistogram::from_counts(health.work_histogram, health.worst_work_ns).quantile(0.5)
}

#[test]
fn neither_monitors_nor_a_flood_of_requests_are_felt_by_the_loop() {
    let alone = run(|_, _| {});
    let looks = Arc::new(AtomicU64::new(0));
    let watched = run({
        let looks = Arc::clone(&looks);
        move |config, stop| {
            while !stop.load(Ordering::Relaxed) {
                let output = succeed(&mut monitor(&config, "20"));
                let text = String::from_utf8_lossy(&output.stdout).into_owned();
                for line in [
                    "daemon ",
                    "faults ",
                    "input ",
                    "load ",
                    "phases ",
                    "worst ",
                    "drops ",
                    "wake ",
                    "work ",
                    "supervision ",
                    "joints ",
                    "parameters ",
                ] {
                    assert!(text.lines().any(|found| found.starts_with(line)), "{line}:\n{text}");
                }
                looks.fetch_add(1, Ordering::Relaxed);
            }
        }
    });
    let requests = Arc::new(AtomicU64::new(0));
    let flooded = run({
        let requests = Arc::clone(&requests);
        move |config, stop| {
            let bus = Bus::open(&config, &name(), "test-flood").expect("the bus");
            let client = bus.control_client().expect("a client");
            while !stop.load(Ordering::Relaxed) {
                client.ask(ControlCommand::Resume, Duration::from_secs(30)).expect("asked").expect("an answer");
                requests.fetch_add(1, Ordering::Relaxed);
            }
        }
    });
    let counts = (looks.load(Ordering::Relaxed), requests.load(Ordering::Relaxed));
    assert!(counts.0 >= 1 && counts.1 > 100, "{counts:?} looks and requests");
    for (what, health) in [("alone", &alone), ("watched", &watched), ("flooded", &flooded)] {
        println!("{what}: work of a period {} ns at the median; bins {:?}", median(health), health.work_histogram);
        assert_eq!((health.samples, health.lost, health.dropped_messages), (SAMPLES, 0, 0), "{what}");
        // Bins double: the same to within the neighbouring ones, whatever else this machine does.
        // Bins double, and other programs share the processors: what must not happen is work of another order.
        assert!(median(health) <= 16 * median(&alone), "{what}: {} ns, alone {} ns", median(health), median(&alone));
    }
}

/// A script sees from the exit code that the daemon is not there, though the controller is.
#[test]
fn a_look_without_the_daemon_ends_with_a_code_of_its_own() {
    let private = PrivateBus::new("alone");
    let bus = Bus::open(private.config(), &name(), "test-parties").expect("the bus");
    let controller = bus.controller_health_publisher().expect("a publisher");
    let daemon = bus.health_publisher().expect("a publisher");
    let look = |with_daemon: bool, patience: &str| {
        let mut look = Process::start(monitor(private.config(), patience).stdout(Stdio::piped()));
        let status = eventually("it ends", || {
            controller.send(&ControllerHealth::default()).expect("sent");
            if with_daemon {
                daemon.send(&Health::default()).expect("sent");
            }
            look.0.try_wait().expect("a child")
        });
        let mut text = String::new();
        look.0.stdout.take().expect("piped").read_to_string(&mut text).expect("text");
        (status.code(), text)
    };
    let (code, text) = look(false, "3");
    assert!(code == Some(1) && text.contains("daemon       not on the bus"), "{code:?}: {text}");
    let (code, text) = look(true, "20");
    assert!(code == Some(0) && !text.contains("not on the bus"), "{code:?}: {text}");
}

/// Processes whose parent is `pid`, by the fourth word of their `stat`.
fn children(pid: u32) -> Vec<u32> {
    let stat = |entry: std::fs::DirEntry| {
        let pid: u32 = entry.file_name().to_str()?.parse().ok()?;
        let stat = std::fs::read_to_string(entry.path().join("stat")).ok()?;
        let words: Vec<String> = stat.rsplit_once(')')?.1.split_whitespace().map(str::to_owned).collect();
        Some((pid, words))
    };
    let all = std::fs::read_dir("/proc").expect("processes").flatten().filter_map(stat);
    all.filter(|(_, words)| words[1] == pid.to_string()).map(|(pid, _)| pid).collect()
}

/// State and processor time \[ticks\]; `None` once it is gone.
fn state(pid: u32) -> Option<(String, u64)> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    let words: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    Some((words[0].to_owned(), words[11].parse::<u64>().ok()? + words[12].parse::<u64>().ok()?))
}

/// The live view on a terminal whose other end is closed: it ends, and has not been busy before.
#[test]
fn a_monitor_whose_terminal_has_vanished_ends() {
    let private = PrivateBus::new("vanished");
    let config = private.config();
    let line = format!(
        "stty rows 30 cols 100; exec {} monitor {} --prefix {} --root {}",
        rivet().get_program().to_string_lossy(),
        robot("dd2").display(),
        config.prefix,
        config.root.display()
    );
    let folder = tempfile::tempdir().expect("a folder");
    let screen = folder.path().join("screen");
    let output = std::fs::File::create(&screen).expect("a file");
    let mut command = Command::new("script");
    command.args(["-qfc", &line, "/dev/null"]).env("TERM", "xterm").env("SHELL", "/bin/sh").stdout(output);
    command.stdin(Stdio::piped());
    let Ok(terminal) = command.spawn() else {
        eprintln!("SKIPPED: no script(1) to give a terminal");
        return;
    };
    let mut terminal = Process(terminal);
    let begin = Instant::now();
    let mut monitor = None;
    while monitor.is_none() {
        assert!(begin.elapsed() < Duration::from_secs(60), "the monitor shows nothing");
        std::thread::sleep(Duration::from_millis(20));
        let drawn = String::from_utf8_lossy(&std::fs::read(&screen).expect("the screen")).contains("rivet monitor");
        monitor = children(terminal.0.id()).first().copied().filter(|_| drawn);
    }
    let monitor = monitor.expect("found");
    let before = state(monitor).expect("it runs").1;
    std::thread::sleep(Duration::from_secs(2));
    let used = state(monitor).expect("it runs").1 - before;
    assert!(used < 60, "{used} ticks of a hundredth of a second in two seconds");
    terminal.0.kill().expect("killed");
    terminal.0.wait().expect("gone");
    let begin = Instant::now();
    while state(monitor).is_some_and(|(state, _)| state != "Z") {
        assert!(begin.elapsed() < Duration::from_secs(60), "it goes on without a terminal: {:?}", state(monitor));
        std::thread::sleep(Duration::from_millis(20));
    }
}
