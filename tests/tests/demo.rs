//! The demonstration, as a user on a fresh machine runs it.

use rivet_tests::rivet;
use std::process::{Command, Stdio};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// Held by a demonstration that has to keep its pace to the end: two at a time are too much for two processors.
static WHOLE_RUN: Mutex<()> = Mutex::new(());

/// What the demonstration with process number `pid` has in shared memory, in working folders and as other processes: all
/// of these carry its number.
fn traces(pid: u32) -> Vec<String> {
    let mut found = Vec::new();
    let (prefix, folders) = (format!("rvt_{pid}_"), [format!("rivet-demo{pid}_"), format!("rivet-demo-{pid}")]);
    for place in ["/dev/shm".into(), "/tmp".into(), std::env::temp_dir()] {
        for entry in std::fs::read_dir(&place).expect("a folder").flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            if name.starts_with(&prefix) || folders.iter().any(|folder| name.starts_with(folder)) {
                found.push(format!("{}/{name}", place.display()));
            }
        }
    }
    for entry in std::fs::read_dir("/proc").expect("a folder").flatten() {
        let words = std::fs::read(entry.path().join("cmdline")).unwrap_or_default();
        let words = String::from_utf8_lossy(&words).replace('\0', " ");
        if words.contains(&prefix) {
            found.push(words);
        }
    }
    found
}

#[test]
fn it_improves_and_leaves_nothing_behind() {
    let _alone = WHOLE_RUN.lock().unwrap_or_else(PoisonError::into_inner);
    let child = rivet().arg("demo").stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts");
    let pid = child.id();
    let output = child.wait_with_output().expect("it ends");
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{text}\n{}", String::from_utf8_lossy(&output.stderr));
    assert!(text.contains("torque error, tracking error and parameter error: improved"), "{text}");
    assert!(text.lines().all(|line| line.chars().count() <= 80), "lines of at most 80 columns:\n{text}");
    assert_eq!(traces(pid), Vec::<String>::new());
}

#[test]
fn interrupted_it_ends_everything_it_started() {
    let mut child = rivet().arg("demo").stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("it starts");
    let pid = child.id();
    // Until plant, daemon and controller run.
    while traces(pid).iter().filter(|trace| trace.contains("--prefix")).count() < 3 {
        assert!(child.try_wait().expect("asked").is_none(), "it ended by itself");
        std::thread::sleep(Duration::from_millis(10));
    }
    std::thread::sleep(Duration::from_secs(1));
    assert!(Command::new("kill").args(["-INT", &pid.to_string()]).status().expect("kill runs").success());
    assert_eq!(child.wait().expect("it ends").code(), Some(130), "the code of a command that Ctrl-C ended");
    assert_eq!(traces(pid), Vec::<String>::new());
}

/// As in `rivet demo | head -1`.
#[test]
fn goes_on_to_its_exit_code_when_nobody_reads_its_output() {
    let _alone = WHOLE_RUN.lock().unwrap_or_else(PoisonError::into_inner);
    let mut child = rivet().arg("demo").stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts");
    let pid = child.id();
    drop(child.stdout.take());
    let output = child.wait_with_output().expect("it ends");
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{:?}: {text}", output.status);
    assert!(!text.contains("panicked"), "{text}");
    assert_eq!(traces(pid), Vec::<String>::new());
}
