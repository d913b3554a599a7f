//! Whoever looks on, and whoever floods the control service: the loop's work is what it is without them.

use rivet_ipc_schema::{Bus, BusConfig, ControlCommand, ControllerHealth, Health, PrivateBus};
use rivet_tests::process::{Process, eventually};
use rivet_tests::stretch::{Feed, Stretch, least, stall_limit};
use rivet_tests::two_link::{name, running};
use rivet_tests::{rivet, robot, succeed};
use std::io::Read as _;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Rounds of four stretches, one each alone, beside a stranger, watched and flooded, and samples of a stretch at least, at their own rate.
const ROUNDS: usize = 4;
const SAMPLES: u64 = 800;

fn monitor(config: &BusConfig, patience: &str) -> Command {
    let mut command = rivet();
    command.arg("monitor").arg(robot("dd2")).args(["--once", "--patience", patience, "--prefix", &config.prefix]);
    command.arg("--root").arg(&config.root);
    command
}

/// Looks until told to stop, at least once; how often.
fn watch(config: &BusConfig, stop: &AtomicBool) -> u64 {
    let mut looks = 0;
    while looks == 0 || !stop.load(Ordering::Relaxed) {
        let output = succeed(&mut monitor(config, "20"));
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
        looks += 1;
    }
    looks
}

/// Starts processes that do not know the bus until told to stop: what these do to processor and caches, a monitor may do.
fn strangers(stop: &AtomicBool) {
    while !stop.load(Ordering::Relaxed) {
        succeed(rivet().arg("check").arg(robot("dd2")));
    }
}

/// How many bins of the histogram, each twice the one before, `a` lies above `b`, both ends of bins \[ns\].
fn bins_above(a: u64, b: u64) -> u32 {
    a.max(1).ilog2().saturating_sub(b.max(1).ilog2())
}

/// Asks as fast as there are answers until told to stop; how often.
fn flood(config: &BusConfig, stop: &AtomicBool) -> u64 {
    let bus = Bus::open(config, &name(), "test-flood").expect("the bus");
    let client = bus.control_client().expect("a client");
    let mut requests = 0;
    while !stop.load(Ordering::Relaxed) {
        client.ask(ControlCommand::Resume, Duration::from_secs(30)).expect("asked").expect("an answer");
        requests += 1;
    }
    requests
}

#[test]
fn neither_monitors_nor_a_flood_of_requests_are_felt_by_the_loop() {
    let private = PrivateBus::new("monitor");
    let config = private.config();
    let bus = Bus::open(config, &name(), "test-robot").expect("the bus");
    let daemon = running(config);
    let mut feed = Feed::begin(&bus, &daemon, Duration::from_millis(1));
    let (mut alone, mut beside, mut watched, mut flooded) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let (mut looks, mut requests) = (0, 0);
    for _ in 0..ROUNDS {
        alone.push(feed.stretch(SAMPLES, |_| {}).0);
        beside.push(feed.stretch(SAMPLES, strangers).0);
        let (stretch, count) = feed.stretch(SAMPLES, |stop| watch(config, stop));
        watched.push(stretch);
        looks += count;
        let (stretch, count) = feed.stretch(SAMPLES, |stop| flood(config, stop));
        flooded.push(stretch);
        requests += count;
    }
    assert!(requests > 100, "{requests} requests, {looks} looks");
    let health = feed.health();
    assert_eq!((health.samples, health.lost, health.dropped_messages), (health.seq, 0, 0));
    // It waits for the next period, and for nothing else: who holds a lock that the loop wants makes it give its processor away
    // once more. One in a hundred is left to pages that are not there where memory could not be locked.
    for stretch in alone.iter().chain(&beside).chain(&watched).chain(&flooded) {
        let (periods, switches) = (stretch.periods, stretch.switches);
        assert!(switches <= periods + periods / 100, "{switches} waits in {periods} periods");
    }
    let median: fn(&Stretch) -> u64 = |stretch| stretch.work(0.5);
    let most: fn(&Stretch) -> u64 = |stretch| stretch.work(0.95);
    // What a stranger's processes cost the loop is the machine's doing, and no word on those that look at it.
    let without = |of: fn(&Stretch) -> u64| least(&alone, of).max(least(&beside, of));
    let [at_without, high_without] = [without(median), without(most)];
    for (what, stretches) in [("watched", &watched), ("flooded", &flooded)] {
        let [at, high, stall] = [least(stretches, median), least(stretches, most), least(stretches, Stretch::stall)];
        let limit = stall_limit(&alone, Stretch::stall);
        println!(
            "{what}: work {at} ns at the median, {high} ns at 95 %, held up {stall} ns; without {at_without}, {high_without}"
        );
        // A duration at the border of two bins reads as twice what it is; one more for caches that are shared.
        assert!(bins_above(at, at_without) <= 2, "{what}: {at} ns at the median, without {at_without} ns");
        // A bin more: without a priority the loop shares two processors with the neighbour, the daemon's own threads and this
        // test, and is turned out in some of its periods.
        assert!(bins_above(high, high_without) <= 3, "{what}: {high} ns at 95 %, without {high_without} ns");
        assert!(stall <= limit, "{what}: held up for {stall} ns in every stretch, {limit} ns are nothing unusual");
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
