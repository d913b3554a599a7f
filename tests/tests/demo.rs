//! The demonstration, as a user on a fresh machine runs it.

use rivet_tests::rivet;
use rustix::pty::OpenptFlags;
use std::fs::File;
use std::io::Read as _;
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

/// Without a word, as the README starts it: that is the demonstration with its documented defaults.
#[test]
fn it_improves_and_leaves_nothing_behind() {
    let _alone = WHOLE_RUN.lock().unwrap_or_else(PoisonError::into_inner);
    let child = rivet().stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts");
    let pid = child.id();
    let output = child.wait_with_output().expect("it ends");
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{text}\n{}", String::from_utf8_lossy(&output.stderr));
    assert!(text.contains("compared with the robot file: torque, tracking and parameter error improved"), "{text}");
    assert!(text.contains("\npatched compared with identified: torque error "), "{text}");
    assert!(text.contains("\nhidden effect: named"), "{text}");
    let end: Vec<&str> = text.lines().skip_while(|line| !line.starts_with("torque error from parameters")).collect();
    assert!((10..24).contains(&end.len()), "the end on one screen of 24 rows:\n{text}");
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
fn ends_at_its_next_line_when_nobody_reads_its_output() {
    let mut child = rivet().arg("demo").stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts");
    let pid = child.id();
    drop(child.stdout.take());
    let output = child.wait_with_output().expect("it ends");
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(141), "as a shell counts SIGPIPE: {text}");
    assert!(text.is_empty(), "{text}");
    assert_eq!(traces(pid), Vec::<String>::new());
}

/// A terminal of 80 by 24: pictures that fit, drawn one over the other, and no control sequence shown as text.
#[test]
fn draws_pictures_that_fit_a_terminal() {
    let (columns, rows) = (80, 24);
    let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY;
    let terminal = rustix::pty::openpt(flags).expect("a terminal");
    rustix::pty::grantpt(&terminal).and_then(|()| rustix::pty::unlockpt(&terminal)).expect("its other side");
    let name = rustix::pty::ptsname(&terminal, Vec::new()).expect("its name");
    let size = rustix::termios::Winsize { ws_col: columns, ws_row: rows, ws_xpixel: 0, ws_ypixel: 0 };
    rustix::termios::tcsetwinsize(&terminal, size).expect("a size");
    let side = File::options().read(true).write(true).open(name.to_str().expect("a path")).expect("opened");
    let mut demo = rivet().arg("demo").stdout(side).stderr(Stdio::null()).spawn().expect("it starts");
    let (mut shown, mut terminal) = (Vec::new(), File::from(terminal));
    // A picture begins by erasing to its end the one before.
    let pictures = |shown: &[u8]| String::from_utf8_lossy(shown).matches("\u{1b}[J").count();
    let mut part = [0; 4096];
    while pictures(&shown) < 6 {
        let read = terminal.read(&mut part).expect("the demonstration draws");
        shown.extend_from_slice(&part[..read]);
    }
    assert!(Command::new("kill").args(["-INT", &demo.id().to_string()]).status().expect("kill runs").success());
    // A terminal that nobody reads would hold it up.
    std::thread::spawn(move || std::io::copy(&mut terminal, &mut std::io::sink()));
    demo.wait().expect("it ends");
    let text = String::from_utf8(shown).expect("text");
    assert!(!text.contains("u{1b}"), "{text}");
    for picture in text.split("\u{1b}[J") {
        let lines: Vec<&str> = picture.lines().collect();
        assert!(lines.len() <= usize::from(rows), "{picture}");
        for line in lines {
            let mut shown = 0;
            let mut characters = line.chars();
            while let Some(c) = characters.next() {
                if c == '\u{1b}' {
                    // A sequence ends with its letter.
                    let _ = characters.by_ref().find(char::is_ascii_alphabetic);
                } else {
                    shown += usize::from(!c.is_control());
                }
            }
            assert!(shown <= usize::from(columns), "{line}");
        }
    }
}
