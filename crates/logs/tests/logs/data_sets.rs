//! HDF5 files as other people have them, and damaged ones.

use std::path::Path;

use hdf5_writer::{DatasetBuilder, Hdf5Builder, WriteOptions};
use rivet_logs::{ChannelMap, Log, LogError, Naming, ReadOptions, list, read_as};

fn wave(k: usize) -> f64 {
    (k as f64 / 9.0).sin()
}

fn floats(name: &str, shape: &[u64], value: impl Fn(usize) -> f64) -> DatasetBuilder {
    let count: u64 = shape.iter().product();
    let values: Vec<f64> = (0..count as usize).map(value).collect();
    DatasetBuilder::typed_data(name, shape, &values).expect("a data set")
}

fn bytes(sets: Vec<DatasetBuilder>) -> Vec<u8> {
    let file = sets.into_iter().fold(Hdf5Builder::new(), Hdf5Builder::dataset);
    file.into_plan().expect("a plan").encode(WriteOptions::default()).expect("a file")
}

fn read_file(path: &Path) -> Result<Log, LogError> {
    let joints = ["a".to_owned(), "b".to_owned()];
    read_as(path, &ReadOptions::new(2), &Naming { joints: &joints, map: &ChannelMap::default() })
}

fn read_back(sets: Vec<DatasetBuilder>) -> Result<Log, LogError> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.h5");
    std::fs::write(&path, bytes(sets)).expect("written");
    read_file(&path)
}

/// Position, torque and time of a group.
fn signals(group: &str, rows: u64) -> Vec<DatasetBuilder> {
    let name = |set: &str| format!("{group}/{set}");
    vec![
        floats(&name("timestamp"), &[rows], |k| 3.0 + 0.02 * k as f64),
        floats(&name("position"), &[rows, 2], wave),
        floats(&name("effort"), &[2, rows], |k| 2.0 * wave(k)),
    ]
}

#[test]
fn episodes_are_one_log_in_the_order_of_their_numbers() {
    let episodes = [("demo_10", 70), ("demo_2", 60), ("demo_1", 50)];
    let sets = episodes.iter().flat_map(|(name, rows)| signals(&format!("data/{name}/obs"), *rows)).collect();
    let log = read_back(sets).expect("a log");
    assert_eq!(log.len(), 180);
    assert!(log.notes.iter().any(|note| note.contains("3 episodes are read as one log")), "{:?}", log.notes);
    let (_, tau) = log.tau.as_ref().expect("torques");
    // Rows of each episode begin anew, and turned arrays have the length of their own episode.
    for (start, rows) in [(0, 50), (50, 60), (110, 70)] {
        for row in 0..rows {
            assert_eq!(log.q[1][start + row], wave(2 * row + 1), "{start} {row}");
            assert_eq!(tau[1][start + row], 2.0 * wave(rows + row), "{start} {row}");
        }
    }
    assert!(log.t.windows(2).all(|t| t[1] > t[0]));
    assert!((log.t[50] - log.t[49] - 10.0).abs() < 1e-9, "{}", log.t[50] - log.t[49]);
}

#[test]
fn of_several_sets_of_episodes_the_largest_is_read_and_the_others_are_listed() {
    let sets = [("test/demo_0", 60), ("train/demo_0", 200), ("train/demo_1", 100), ("train/demo_2", 0), ("notes", 5)];
    let log = read_back(sets.iter().flat_map(|(name, rows)| signals(name, *rows)).collect()).expect("a log");
    assert_eq!(log.len(), 300);
    let notes = log.notes.join("\n");
    assert!(notes.contains("test/demo_*") && notes.contains("notes/effort"), "{notes}");
    assert!(notes.contains("1 episodes of train/demo_ have no rows"), "{notes}");
}

#[test]
fn runs_of_a_calibration_do_not_hide_the_log_beside_them() {
    let sets = [("robot", 1000), ("calib/run_0", 300), ("calib/run_1", 300)];
    let log = read_back(sets.iter().flat_map(|(name, rows)| signals(name, *rows)).collect()).expect("a log");
    assert_eq!(log.len(), 1000);
    assert!(log.notes.join("\n").contains("calib/run_*"), "{:?}", log.notes);
}

#[test]
fn numbers_of_one_byte_count_as_what_they_become() {
    let deflate = hdf5_writer::FilterDescription { id: hdf5_writer::FILTER_DEFLATE, name: None, client_data: vec![9] };
    let zeros = |name: &str, width: u64| {
        let set = DatasetBuilder::typed_data(name, vec![2_000_000, width], &vec![0_u8; 2_000_000 * width as usize]);
        set.expect("a data set").chunked([1_000_000, width]).filter(deflate.clone())
    };
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("claim.h5");
    std::fs::write(&path, bytes(vec![zeros("time", 1), zeros("position", 8), zeros("effort", 8)])).expect("written");
    let joints: Vec<String> = (0..8).map(|k| format!("j{k}")).collect();
    let naming = Naming { joints: &joints, map: &ChannelMap::default() };
    let why = read_as(&path, &ReadOptions::new(8), &naming).expect_err("too much").to_string();
    assert!(why.contains("may stand for"), "{why}");
}

#[test]
fn a_file_behind_a_block_of_its_writer_is_found() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mat");
    let sound = bytes(signals("robot", 200));
    std::fs::write(&path, [&b"MATLAB 7.3 MAT-file"[..], &[0; 1024 - 19], &sound].concat()).expect("written");
    assert_eq!(read_file(&path).expect("a log").len(), 200);
}

#[test]
fn groups_of_joints_are_no_episodes() {
    let one = |name: &str| {
        let set = |quantity: &str| format!("{name}/{quantity}");
        vec![floats(&set("position"), &[200], wave), floats(&set("effort"), &[200], wave)]
    };
    let sets = ["joint_1", "joint_2"].iter().flat_map(|name| one(name)).collect::<Vec<_>>();
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.h5");
    let time = floats("time", &[200], |k| 0.01 * k as f64);
    std::fs::write(&path, bytes(sets.into_iter().chain([time]).collect())).expect("written");
    let columns: Vec<String> = list(&path).expect("listed").columns.into_iter().map(|column| column.name).collect();
    assert_eq!(columns, ["joint_1/effort", "joint_1/position", "joint_2/effort", "joint_2/position", "time"]);
}

#[test]
fn other_data_sets_are_left_out_by_name() {
    let mut sets = signals("robot", 200);
    sets.push(floats("camera/image", &[20, 4, 4, 3], wave));
    sets.push(floats("limits", &[2], wave));
    sets.push(DatasetBuilder::fixed_string_data("words", vec![1], &["x"]).expect("words"));
    let log = read_back(sets).expect("a log");
    assert_eq!(log.len(), 200);
    let notes = log.notes.join("\n");
    assert!(notes.contains("camera/image") && notes.contains("limits") && notes.contains("words"), "{notes}");
}

#[test]
fn damaged_files_end_in_an_error_or_in_finite_work() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.h5");
    let sound = bytes(signals("robot", 200));
    // A linear congruence: the same places in each run.
    let mut state = 7_u64;
    let mut draw = |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    let mut errors = 0;
    for _ in 0..400 {
        let mut damaged = sound.clone();
        damaged.truncate(sound.len() - draw(3) * draw(sound.len() / 3));
        for _ in 0..=draw(8) {
            let at = draw(damaged.len());
            damaged[at] = draw(256) as u8;
        }
        std::fs::write(&path, &damaged).expect("written");
        if let Err(why) = read_file(&path) {
            errors += 1;
            assert!(why.to_string().contains("run.h5"), "{why}");
        }
    }
    assert!(errors > 100, "{errors}");
}

#[test]
fn a_file_that_claims_more_than_its_bytes_may_stand_for_is_refused() {
    // Chunks of zeros, compressed: few bytes for many numbers.
    let deflate = hdf5_writer::FilterDescription { id: hdf5_writer::FILTER_DEFLATE, name: None, client_data: vec![9] };
    let zeros = |name: &str, width: u64| {
        floats(name, &[400_000, width], |_| 0.0).chunked([100_000, width]).filter(deflate.clone())
    };
    let sets = vec![floats("timestamp", &[400_000], |k| 0.01 * k as f64), zeros("position", 20), zeros("effort", 20)];
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("claim.h5");
    let all = bytes(sets);
    std::fs::write(&path, &all).expect("written");
    let joints: Vec<String> = (0..20).map(|k| format!("j{k}")).collect();
    let naming = Naming { joints: &joints, map: &ChannelMap::default() };
    assert!(read_as(&path, &ReadOptions::new(20), &naming).is_ok(), "3.2 MB of time stand for all of it");
    let sets = vec![zeros("timestamp", 1), zeros("position", 20), zeros("effort", 20)];
    let all = bytes(sets);
    assert!(all.len() < 200_000, "{}", all.len());
    std::fs::write(&path, &all).expect("written");
    let why = read_as(&path, &ReadOptions::new(20), &naming).expect_err("too much").to_string();
    assert!(why.contains("claim.h5") && why.contains("may stand for"), "{why}");
}
