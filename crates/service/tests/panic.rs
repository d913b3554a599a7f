//! A panic of the real-time thread: the other thread writes the record, then the process aborts; nothing is unwound.

use rivet_service::{Flight, Reason, abort_on_panic};
use std::os::unix::process::ExitStatusExt as _;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

const FOLDER: &str = "RIVET_TEST_FLIGHT";

/// Says so if it is ever dropped: that would be unwinding.
struct Witness(PathBuf);

impl Drop for Witness {
    fn drop(&mut self) {
        let _ = std::fs::write(&self.0, "unwound");
    }
}

fn flight(folder: &std::path::Path) -> Flight {
    Flight::new(folder, "arm.service", &[("q", 2), ("tau", 2), ("state", 1)])
}

/// Not a test: the process that panics. `RIVET_TEST_FLIGHT` says where; with `deaf` in its name nobody serves the record.
#[test]
#[ignore = "run by a test as a process of its own"]
fn service_that_panics() {
    let Some(folder) = std::env::var_os(FOLDER).map(PathBuf::from) else { return };
    let flight = Arc::new(flight(&folder));
    abort_on_panic(Some(Arc::clone(&flight)));
    if !folder.ends_with("deaf") {
        let flight = Arc::clone(&flight);
        std::thread::spawn(move || {
            loop {
                flight.serve();
                std::thread::sleep(Duration::from_millis(5));
            }
        });
    }
    let loop_thread = std::thread::spawn(move || {
        let _witness = Witness(folder.join("unwound"));
        for k in 1..=1500_u64 {
            let x = k as f64;
            flight.push(k * 1_000_000, k, 0, [x, -x, 10.0 * x, 0.5, 1.0]);
        }
        panic!("as was to be shown");
    });
    let _ = loop_thread.join();
}

fn panicking(folder: &std::path::Path) -> std::process::ExitStatus {
    std::fs::create_dir_all(folder).expect("a folder");
    let mut command = Command::new(std::env::current_exe().expect("a running test has a file"));
    command.args(["--ignored", "--exact", "service_that_panics"]).env(FOLDER, folder);
    command.stdout(Stdio::null()).stderr(Stdio::null()).status().expect("it starts")
}

#[test]
fn the_other_thread_writes_the_record_and_the_process_aborts() {
    let folder = tempfile::tempdir().expect("a folder");
    let status = panicking(folder.path());
    assert_eq!(status.signal(), Some(6), "SIGABRT: {status:?}");
    assert!(!folder.path().join("unwound").exists());
    let record = std::fs::read_to_string(folder.path().join("arm.service-panic.0.flight.csv")).expect("written");
    let lines: Vec<&str> = record.lines().collect();
    assert_eq!(lines[0], "# rivet: SI units, signs and zeros of the model");
    assert_eq!(lines[1], "t,seq,faults,q1,q2,tau1,tau2,state");
    assert_eq!(lines.len(), 1002, "the last thousand samples");
    assert_eq!(lines[2], "0.000000000,501,0,501,-501,5010,0.5,1");
    assert_eq!(*lines.last().expect("there is one"), "0.999000000,1500,0,1500,-1500,15000,0.5,1");
}

/// Whoever should write is stuck itself: the process ends all the same, and does not wait for ever.
#[test]
fn a_record_that_nobody_writes_holds_nobody() {
    let folder = tempfile::tempdir().expect("a folder");
    let begin = Instant::now();
    let status = panicking(&folder.path().join("deaf"));
    assert_eq!(status.signal(), Some(6), "SIGABRT: {status:?}");
    assert!(begin.elapsed() < Duration::from_secs(60), "only a hang fails");
    assert_eq!(std::fs::read_dir(folder.path().join("deaf")).expect("a folder").count(), 0);
}

/// Six faults within a moment: what began it and how it stands now.
#[test]
fn of_a_burst_of_faults_the_first_and_the_newest_record_are_kept() {
    let folder = tempfile::tempdir().expect("a folder");
    let flight = flight(folder.path());
    for k in 1..=6 {
        flight.push(k, k, 0, []);
        flight.ask(Reason::Fault);
        flight.serve();
        flight.serve();
    }
    flight.ask(Reason::Stop);
    flight.serve();
    let rows = |name: &str| {
        std::fs::read_to_string(folder.path().join(name)).map(|text| text.lines().count() - 2).map_err(|why| why.kind())
    };
    let faults: Vec<_> = (0..5).map(|k| rows(&format!("arm.service-fault.{k}.flight.csv"))).collect();
    let none = Err(std::io::ErrorKind::NotFound);
    assert_eq!(faults, [Ok(6), Ok(1), none, none, none]);
    assert_eq!(rows("arm.service-stop.0.flight.csv"), Ok(6));
}
