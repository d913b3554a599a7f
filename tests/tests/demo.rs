//! The demonstration, as a user on a fresh machine runs it.

use rivet_tests::rivet;
use std::process::{Command, Stdio};
use std::time::Duration;

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
    let child = rivet().arg("demo").stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts");
    let pid = child.id();
    let output = child.wait_with_output().expect("it ends");
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{text}\n{}", String::from_utf8_lossy(&output.stderr));
    assert!(text.contains("torque error, tracking error and parameter error: improved"), "{text}");
    assert!(text.lines().all(|line| line.chars().count() <= 100), "lines of at most 100 columns:\n{text}");
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
    assert!(!child.wait().expect("it ends").success(), "an interrupted demonstration is no success");
    assert_eq!(traces(pid), Vec::<String>::new());
}
