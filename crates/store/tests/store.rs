//! What is read is what was written, whatever happened to the files meanwhile.

use proptest::prelude::*;
use rivet_store::{Knowledge, Memory, Parameters, Problem, Store, Supervision};
use std::fs;
use std::path::Path;

const HASH: u64 = 0x1234_5678_9abc_def0;

fn knowledge(epoch: u64) -> Knowledge {
    let values: Vec<f64> = (0..58).map(|i| f64::from(i) * 0.1 - epoch as f64).collect();
    let std = values.iter().map(|x| 0.01 * x.abs()).collect();
    let supervision = Supervision {
        state: (0..58).map(|i| i % 3).collect(),
        excitation: (0..58).map(|i| f64::from(i) / 58.0).collect(),
    };
    let memory = Memory { fingerprint: 7 * epoch, numbers: vec![f64::INFINITY, epoch as f64, -0.0] };
    let parameters = Parameters { epoch, seq: 100 * epoch, values, std };
    Knowledge { model_hash: HASH, parameters, supervision: Some(supervision), memory: Some(memory) }
}

fn files(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> = fs::read_dir(folder)
        .expect("a folder")
        .flatten()
        .map(|e| e.file_name().to_string_lossy().into_owned())
        .collect();
    names.retain(|name| !name.ends_with(".lock"));
    names.sort();
    names
}

fn store(folder: &Path) -> Store {
    Store::open(folder, "ur10e").expect("the folder is there")
}

#[test]
fn two_generations_are_kept_and_the_newer_one_is_read() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut first = store(folder.path());
    assert_eq!(first.load(HASH).knowledge, None);
    for epoch in 1..=5 {
        first.save(&knowledge(epoch)).expect("written");
        assert_eq!(first.load(HASH).knowledge, Some(knowledge(epoch)));
    }
    assert_eq!(files(folder.path()), ["ur10e.0.state", "ur10e.1.state"]);
    // Another process goes on where the first ended, and not before.
    let refused = Store::open(folder.path(), "ur10e").expect_err("one writer").to_string();
    assert!(refused.contains("another process"), "{refused}");
    drop(first);
    let mut second = store(folder.path());
    for epoch in 6..=9 {
        second.save(&knowledge(epoch)).expect("written");
        assert_eq!(Store::reader(folder.path(), "ur10e").load(HASH).knowledge, Some(knowledge(epoch)));
    }
}

/// A damaged newest generation is reported, and the one before is read; then the damaged one is written over.
#[test]
fn a_damaged_generation_costs_only_itself() {
    let folder = tempfile::tempdir().expect("a folder");
    store(folder.path()).save(&knowledge(1)).expect("written");
    store(folder.path()).save(&knowledge(2)).expect("written");
    let newest = |epoch| {
        let found = files(folder.path()).into_iter().map(|name| folder.path().join(name));
        let encoded = |path: &Path| fs::read(path).expect("read");
        let wanted = (-f64::from(epoch)).to_le_bytes();
        found.into_iter().find(|path| encoded(path).windows(8).any(|w| w == wanted)).expect("one has the epoch's value")
    };
    let path = newest(2);
    let mut bytes = fs::read(&path).expect("read");
    bytes[100] ^= 0x10;
    fs::write(&path, &bytes).expect("written");
    let loaded = store(folder.path()).load(HASH);
    assert_eq!(loaded.knowledge, Some(knowledge(1)));
    assert_eq!(loaded.problems, [(path.clone(), Problem::Checksum)]);
    store(folder.path()).save(&knowledge(3)).expect("written");
    let loaded = store(folder.path()).load(HASH);
    assert_eq!((loaded.knowledge, loaded.problems.len()), (Some(knowledge(3)), 0));
}

#[test]
fn another_model_is_set_aside_and_another_robot_is_not_read() {
    let folder = tempfile::tempdir().expect("a folder");
    store(folder.path()).save(&knowledge(1)).expect("written");
    let loaded = store(folder.path()).load(7);
    assert_eq!(loaded.knowledge, None);
    assert!(matches!(loaded.problems[0].1, Problem::OtherModel { found: HASH, expected: 7 }));
    let aside = store(folder.path()).set_others_aside(7).expect("renamed");
    assert_eq!(aside.len(), 1);
    assert!(aside[0].to_string_lossy().ends_with("state-of-123456789abcdef0"), "{aside:?}");
    assert_eq!(files(folder.path()).len(), 1, "kept");
    assert!(store(folder.path()).take_back(7).expect("nothing to do").is_empty());
    // The robot file is changed back: what was learnt with it is there again, and what is newer stays where it is.
    assert_eq!(store(folder.path()).take_back(HASH).expect("renamed").len(), 1);
    assert_eq!(store(folder.path()).load(HASH).knowledge, Some(knowledge(1)));
    store(folder.path()).save(&knowledge(3)).expect("written");
    assert!(store(folder.path()).take_back(HASH).expect("nothing to do").is_empty());
    assert_eq!(store(folder.path()).load(HASH).knowledge, Some(knowledge(3)));
    // What is forgotten does not come back by that way either.
    assert_eq!(store(folder.path()).set_others_aside(7).expect("renamed").len(), 2);
    assert_eq!(store(folder.path()).set_aside(HASH).expect("renamed").len(), 2);
    assert!(store(folder.path()).take_back(HASH).expect("nothing to do").is_empty());
    for name in files(folder.path()) {
        fs::remove_file(folder.path().join(name)).expect("removed");
    }

    store(folder.path()).save(&knowledge(2)).expect("written");
    let name = files(folder.path()).into_iter().find(|name| name.ends_with(".state")).expect("just written");
    fs::rename(folder.path().join(&name), folder.path().join(name.replace("ur10e", "tx40"))).expect("renamed");
    let loaded = Store::reader(folder.path(), "tx40").load(HASH);
    assert_eq!(loaded.knowledge, None);
    assert_eq!(loaded.problems[0].1, Problem::OtherRobot("ur10e".to_owned()));
}

/// A folder that cannot be taken at the start is taken by the first save that can, which writes over no other model's file.
#[test]
fn a_folder_that_can_be_written_later_keeps_what_is_in_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let (state, away) = (folder.path().join("state"), folder.path().join("away"));
    store(&state).save(&knowledge(1)).expect("written");
    fs::rename(&state, &away).and_then(|()| fs::write(&state, "in its place")).expect("moved");
    let mut late = store(&state);
    let other = Knowledge { model_hash: HASH + 1, ..knowledge(2) };
    assert!(late.refused().is_some() && late.save(&other).is_err());
    fs::remove_file(&state).and_then(|()| fs::rename(&away, &state)).expect("moved back");
    late.save(&other).expect("written");
    assert!(
        late.refused().is_none() && files(&state).iter().any(|name| name.contains("state-of-")),
        "{:?}",
        files(&state)
    );
    assert_eq!(late.load(HASH + 1).knowledge, Some(other));
}

/// A disk that takes nothing: the error says which file, and what was there is still there.
#[test]
fn what_cannot_be_written_changes_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut store = store(folder.path());
    store.save(&knowledge(1)).expect("written");
    // A folder in the place of the older generation: not even root can write over it.
    for slot in [0, 1] {
        let path = folder.path().join(format!("ur10e.{slot}.state"));
        if !path.exists() {
            fs::create_dir(path).expect("made");
        }
    }
    let error = store.save(&knowledge(2)).expect_err("nothing can be written").to_string();
    assert!(error.contains("ur10e."), "{error}");
    assert_eq!(store.load(HASH).knowledge, Some(knowledge(1)));
}

#[test]
fn a_newer_format_is_told_apart_from_damage() {
    let folder = tempfile::tempdir().expect("a folder");
    store(folder.path()).save(&knowledge(1)).expect("written");
    let path = folder.path().join(&files(folder.path())[0]);
    let mut bytes = fs::read(&path).expect("read");
    bytes[8] = 9;
    let end = bytes.len() - 4;
    let checksum = crc32(&bytes[..end]);
    bytes[end..].copy_from_slice(&checksum.to_le_bytes());
    fs::write(&path, bytes).expect("written");
    assert_eq!(store(folder.path()).load(HASH).problems[0].1, Problem::Version { found: 9, known: 1 });
    // A program that is older than its state does not write over it.
    let aside = store(folder.path()).set_others_aside(HASH).expect("renamed");
    assert!(aside.len() == 1 && aside[0].to_string_lossy().ends_with("state-of-version-9"), "{aside:?}");
    (4..7).for_each(|epoch| store(folder.path()).save(&knowledge(epoch)).expect("written"));
    assert!(aside[0].is_file());
    assert!(store(folder.path()).take_back(HASH).expect("nothing of this version").is_empty());
}

/// CRC-32 (IEEE 802.3), bit by bit, apart from the library that the store uses.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0_u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| if crc & 1 == 1 { (crc >> 1) ^ 0xedb8_8320 } else { crc >> 1 })
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever bytes lie in both files: nothing panics, and nothing is believed that was not written.
    #[test]
    fn no_bytes_are_believed_that_were_not_written(
        cut in 0_usize..1200, flips in proptest::collection::vec((0_usize..1200, 1_u8..), 1..6),
        noise in proptest::collection::vec(any::<u8>(), 0..300),
    ) {
        let folder = tempfile::tempdir().expect("a folder");
        store(folder.path()).save(&knowledge(3)).expect("written");
        let written = folder.path().join(&files(folder.path())[0]);
        let whole = fs::read(&written).expect("read");
        let mut bytes = whole.clone();
        for (at, change) in flips {
            let at = at % bytes.len();
            bytes[at] ^= change;
        }
        bytes.truncate(cut);
        fs::write(&written, &bytes).expect("written");
        fs::write(folder.path().join("ur10e.0.state"), noise).expect("written");
        let loaded = store(folder.path()).load(HASH);
        if bytes != whole {
            prop_assert_eq!(loaded.knowledge, None);
            prop_assert_eq!(loaded.problems.len(), 2);
        }
    }
}

/// A folder of another user, or one in which others write, is no place for parameters. Needs root to be two users.
#[test]
fn a_folder_that_others_control_is_refused() {
    use std::os::unix::fs::{PermissionsExt as _, chown};
    let folder = tempfile::tempdir().expect("a folder");
    let mode = |mode| fs::set_permissions(folder.path(), fs::Permissions::from_mode(mode)).expect("changed");
    let why = |store: Result<Store, rivet_store::StoreError>| store.map(|_| ()).expect_err("refused").to_string();
    mode(0o777);
    let refused = why(Store::open(folder.path(), "arm"));
    assert!(refused.contains("mode 777") && refused.contains("chmod o-w"), "{refused}");
    mode(0o1777);
    drop(Store::open(folder.path(), "arm").expect("under the sticky bit"));
    mode(0o775);
    drop(Store::open(folder.path(), "arm").expect("a group of this user"));
    if chown(folder.path(), Some(4242), None).is_ok() {
        mode(0o755);
        let refused = why(Store::open(folder.path(), "arm"));
        assert!(refused.contains("user 4242"), "{refused}");
    }
}

/// A link in the place of the lock is named with its owner and what to do.
#[test]
fn a_link_in_the_place_of_the_lock_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let lock = folder.path().join("arm.lock");
    std::os::unix::fs::symlink("elsewhere", &lock).expect("a link");
    let why = Store::open(folder.path(), "arm").map(|_| ()).expect_err("refused").to_string();
    let me = fs::symlink_metadata(&lock).map(|there| std::os::unix::fs::MetadataExt::uid(&there)).expect("there");
    assert!(why.contains(&format!("symbolic link of user {me}")) && why.contains("rm "), "{why}");
    assert!(!folder.path().join("elsewhere").exists());
}
