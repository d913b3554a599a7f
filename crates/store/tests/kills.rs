//! Writers that are killed, disks that are full, writes that are cut short: the newest file that was reported as stored is
//! there, or a newer one, and what is read is what was written.
//!
//! The writer is this very test program, started anew with `RIVET_STORE_WRITER` set.

use rivet_store::{Knowledge, Memory, Parameters, Store, Supervision};
use std::io::{Read as _, Write as _};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

const HASH: u64 = 0x5afe;
const ROBOT: &str = "arm";
/// SIGKILLs at random instants.
const KILLS: usize = 500;

/// Content that is a function of the epoch, so that any mixture of two is found out; as large as the largest arm's.
fn knowledge(epoch: u64) -> Knowledge {
    let n = 100 + epoch as usize % 29;
    let values: Vec<f64> = (0..n).map(|i| (epoch * 131 + i as u64) as f64).collect();
    let std = values.iter().map(|x| 0.5 * x + 1.0).collect();
    let supervision =
        Supervision { state: vec![(epoch % 3) as u8; n], excitation: vec![1.0 / (1.0 + epoch as f64); n] };
    let numbers = (0..500).map(|k| (epoch * 7 + k) as f64).collect();
    let memory = Memory { fingerprint: epoch, numbers };
    let parameters = Parameters { epoch, seq: 1000 * epoch, values, std };
    Knowledge { model_hash: HASH, parameters, supervision: Some(supervision), memory: Some(memory) }
}

/// What is stored, which must be something that was written.
fn stored(folder: &Path) -> Option<u64> {
    let found = Store::reader(folder, ROBOT).load(HASH).knowledge?;
    assert_eq!(found, knowledge(found.parameters.epoch), "something that nobody wrote");
    Some(found.parameters.epoch)
}

/// Not a test of its own: the process that the others kill. Writes one epoch after the other and reports each that is done.
#[test]
fn writer() {
    let Some(folder) = std::env::var_os("RIVET_STORE_WRITER") else { return };
    let folder = Path::new(&folder);
    let mut store = Store::open(folder, ROBOT).expect("the last writer is dead");
    let mut epoch = stored(folder).unwrap_or(0);
    let mut out = std::io::stderr();
    // The start is reported as well: a kill before it shows the time that starting takes, not a write.
    out.write_all(&epoch.to_le_bytes()).expect("reported");
    loop {
        epoch += 1;
        if store.save(&knowledge(epoch)).is_ok() {
            out.write_all(&epoch.to_le_bytes()).expect("reported");
        } else {
            // A full disk: a daemon tries again with a newer set.
            epoch -= 1;
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

fn start(folder: &Path) -> Child {
    let program = std::env::current_exe().expect("a running test has a file");
    let mut command = Command::new(program);
    command.args(["--exact", "writer", "--nocapture"]).env("RIVET_STORE_WRITER", folder);
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("the writer starts")
}

#[test]
fn a_writer_killed_at_any_instant_loses_no_more_than_it_was_writing() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut random = 0x2545_f491_4f6c_dd1d_u64;
    let (mut last, mut mid_write) = (0, 0);
    // Some writes fit before the kill, however slow the disk is.
    let begun = Instant::now();
    let file = folder.path().join("probe");
    for _ in 0..4 {
        std::fs::File::create(&file).and_then(|probe| probe.sync_all()).expect("a file on disk");
    }
    std::fs::remove_file(&file).expect("gone");
    let latest = u64::try_from(begun.elapsed().as_nanos()).expect("short").max(8_000_000);
    for kill in 0..KILLS {
        let mut child = start(folder.path());
        let mut pipe = child.stderr.take().expect("a pipe");
        let mut word = [0; 8];
        pipe.read_exact(&mut word).expect("the writer has begun");
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        std::thread::sleep(Duration::from_nanos(random % latest));
        child.kill().expect("killed");
        child.wait().expect("dead");
        let mut rest = Vec::new();
        pipe.read_to_end(&mut rest).expect("what it still said");
        let whole = rest.len() / 8 * 8;
        let reported = rest[..whole].chunks_exact(8).next_back().map_or(word, |c| c.try_into().expect("eight bytes"));
        let reported = u64::from_le_bytes(reported);
        let found = stored(folder.path()).unwrap_or(0);
        assert!(found >= reported && found <= reported + 1, "kill {kill}: {reported} was reported, {found} is there");
        assert!(found >= last, "kill {kill}: {found} after {last}");
        mid_write += usize::from(leftovers(folder.path()) > 0);
        last = found;
    }
    assert!(last > KILLS as u64 / 10, "the writers wrote: {last}");
    // Else the instants were not random enough to show anything.
    assert!(mid_write > KILLS / 50, "{mid_write} of {KILLS} kills fell into a write");
    drop(Store::open(folder.path(), ROBOT).expect("free again"));
    assert_eq!(leftovers(folder.path()), 0, "the next writer clears up");
}

fn leftovers(folder: &Path) -> usize {
    let entries = std::fs::read_dir(folder).expect("a folder").flatten();
    entries.filter(|entry| entry.file_name().to_string_lossy().ends_with(".part")).count()
}

/// A file may grow to every length short of its own: the kernel cuts the write there and refuses the rest, as on a full disk.
#[test]
fn a_write_cut_short_anywhere_changes_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    Store::open(folder.path(), ROBOT).expect("a folder").save(&knowledge(1)).expect("written");
    let length =
        std::fs::read_dir(folder.path()).expect("a folder").flatten().map(|e| e.metadata().map_or(0, |m| m.len()));
    let length = length.max().expect("a file");
    assert!(length > 2000);
    for limit in (0..length).step_by(97) {
        let program = std::env::current_exe().expect("a running test has a file");
        // SIGXFSZ is ignored, so that the write fails instead of the process.
        let script = format!("trap '' XFSZ; exec prlimit --fsize={limit} \"$0\" --exact one_save --nocapture");
        let mut command = Command::new("bash");
        command.args(["-c", &script]).arg(program).env("RIVET_STORE_ONE", folder.path());
        let output = command.output().expect("bash runs");
        assert!(output.status.success(), "{limit}: {}", String::from_utf8_lossy(&output.stderr));
        assert_eq!(stored(folder.path()), Some(1), "{limit}");
        assert_eq!(leftovers(folder.path()), 0, "{limit}: nothing half written is left");
    }
}

/// Not a test of its own: a save that must fail, in a process that may write only so much.
#[test]
fn one_save() {
    let Some(folder) = std::env::var_os("RIVET_STORE_ONE") else { return };
    let mut store = Store::open(Path::new(&folder), ROBOT).expect("opened");
    store.save(&knowledge(2)).expect_err("the file may not be as long");
}

/// A disk with no room left, and with room again. Needs root to mount one.
#[test]
fn a_full_disk_costs_only_the_time_that_it_is_full() {
    let folder = tempfile::tempdir().expect("a folder");
    let disk = folder.path().join("disk");
    std::fs::create_dir(&disk).expect("made");
    let mount = Command::new("mount").args(["-t", "tmpfs", "-o", "size=64k", "tmpfs"]).arg(&disk).output();
    if !mount.is_ok_and(|output| output.status.success()) {
        let _ = writeln!(std::io::stderr(), "SKIPPED: no disk can be mounted: this needs root");
        return;
    }
    let result = std::panic::catch_unwind(|| {
        let mut store = Store::open(&disk, ROBOT).expect("a folder");
        store.save(&knowledge(1)).expect("written");
        store.save(&knowledge(2)).expect("written");
        // Fill what is left, byte by byte in the end.
        let mut ballast = std::fs::File::create(disk.join("ballast")).expect("made");
        while ballast.write(&[7; 512]).is_ok_and(|n| n > 0) {}
        for epoch in 3..20 {
            let why = store.save(&knowledge(epoch)).expect_err("no room").to_string();
            assert!(why.contains("arm.") && why.contains("space"), "{why}");
            assert_eq!(stored(&disk), Some(2));
        }
        drop(ballast);
        std::fs::remove_file(disk.join("ballast")).expect("removed");
        // The file system counts what it has per processor: room that was freed is there after a moment.
        let again = (0..1000).any(|_| {
            let saved = store.save(&knowledge(20)).is_ok();
            if !saved {
                std::thread::sleep(Duration::from_millis(10));
            }
            saved
        });
        assert!(again, "room again");
        assert_eq!(stored(&disk), Some(20));
    });
    let unmounted = Command::new("umount").arg(&disk).status().expect("umount runs");
    assert!(unmounted.success());
    if let Err(panic) = result {
        std::panic::resume_unwind(panic);
    }
}
