//! Archives of arrays as other people have them, and damaged ones.

use std::io::Write as _;
use std::path::Path;

use rivet_logs::{Log, LogError, ReadOptions, list, read};

/// Numbers of a type with their shape.
struct Array<'a> {
    name: &'a str,
    description: &'a str,
    shape: &'a [usize],
    bytes: Vec<u8>,
}

fn floats<'a>(name: &'a str, shape: &'a [usize], value: impl Fn(usize) -> f64) -> Array<'a> {
    let count: usize = shape.iter().product();
    Array { name, description: "<f8", shape, bytes: (0..count).flat_map(|k| value(k).to_le_bytes()).collect() }
}

/// An archive by hand: headers as NumPy writes them.
fn archive(path: &Path, arrays: &[Array<'_>], method: zip::CompressionMethod) {
    let mut zip = zip::ZipWriter::new(std::fs::File::create(path).expect("made"));
    let options = zip::write::SimpleFileOptions::default().compression_method(method);
    for Array { name, description, shape, bytes } in arrays {
        zip.start_file(format!("{name}.npy"), options).expect("begun");
        let shape: Vec<String> = shape.iter().map(usize::to_string).collect();
        let header =
            format!("{{'descr': '{description}', 'fortran_order': False, 'shape': ({},), }}\n", shape.join(","));
        zip.write_all(b"\x93NUMPY\x01\x00").expect("written");
        zip.write_all(&(header.len() as u16).to_le_bytes()).expect("written");
        zip.write_all(header.as_bytes()).expect("written");
        zip.write_all(bytes).expect("written");
    }
    zip.finish().expect("written");
}

const ROWS: usize = 200;

fn wave(k: usize) -> f64 {
    (k as f64 / 9.0).sin()
}

fn read_back(arrays: &[Array<'_>]) -> Result<Log, LogError> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.npz");
    archive(&path, arrays, zip::CompressionMethod::Deflated);
    read(&path, &ReadOptions::new(2))
}

fn signals() -> Vec<Array<'static>> {
    let time = floats("time", &[ROWS], |k| 0.005 * k as f64);
    vec![time, floats("q", &[ROWS, 2], wave), floats("tau", &[ROWS, 2], |k| 2.0 * wave(k))]
}

#[test]
fn time_decides_which_arrays_are_samples() {
    let limits = ["q_min", "q_max", "tau_max", "gains"].map(|name| floats(name, &[2], wave));
    let longer = floats("q_next", &[ROWS + 1, 2], wave);
    let log = read_back(&signals().into_iter().chain(limits).chain([longer]).collect::<Vec<_>>()).expect("a log");
    assert_eq!((log.len(), log.q[1][3]), (ROWS, wave(7)));
    assert!(log.notes.iter().any(|note| note.contains("q_next") && note.contains("[201, 2]")), "{:?}", log.notes);
}

#[test]
fn whole_nanoseconds_are_no_seconds_whatever_they_are_called() {
    for (name, description) in [("t", "<i8"), ("time", "<i8"), ("t", "<M8[ns]"), ("stamp", "<m8[ns]")] {
        let stamps = (0..ROWS as u64).flat_map(|k| (1_700_000_000_000_000_000 + 5_000_000 * k).to_le_bytes()).collect();
        let mut arrays = signals();
        arrays[0] = Array { name, description, shape: &[ROWS], bytes: stamps };
        let log = read_back(&arrays).expect("a log");
        assert!((log.median_step_s() - 0.005).abs() < 1e-12, "{name} {description}: {}", log.median_step_s());
    }
}

#[test]
fn damaged_bytes_are_no_numbers() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.npz");
    archive(&path, &signals(), zip::CompressionMethod::Stored);
    let sound = std::fs::read(&path).expect("read");
    assert!(read(&path, &ReadOptions::new(2)).is_ok());
    let begin = sound.windows(6).rposition(|bytes| bytes == b"\x93NUMPY").expect("an array");
    for at in (begin + 200..begin + 3000).step_by(277) {
        let mut damaged = sound.clone();
        damaged[at] ^= 4;
        std::fs::write(&path, damaged).expect("written");
        let why = read(&path, &ReadOptions::new(2)).expect_err("damaged").to_string();
        assert!(why.contains("array tau") && why.contains("run.npz"), "{at}: {why}");
    }
}

#[test]
fn arrays_claim_no_more_together_than_their_bytes_may_stand_for() {
    let names: Vec<String> = (0..40).map(|k| format!("q{}", k + 1)).collect();
    let zeros = |name: &'static str| floats(name, &[400_000], |_| 0.0);
    let mut arrays = vec![Array { name: "t", ..zeros("t") }];
    arrays.extend(names.iter().map(|name| Array { name, ..zeros("q") }));
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("zeros.npz");
    archive(&path, &arrays, zip::CompressionMethod::Deflated);
    assert!(std::fs::metadata(&path).expect("there").len() < 200_000);
    assert!(list(&path).is_ok());
    let why = read(&path, &ReadOptions::new(40)).expect_err("too many").to_string();
    assert!(why.contains("may stand for"), "{why}");
}

#[test]
fn cut_archives_and_odd_types_are_refused_by_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("cut.npz");
    archive(&path, &signals(), zip::CompressionMethod::Stored);
    let sound = std::fs::read(&path).expect("read");
    for length in [10, 300, sound.len() / 2, sound.len() - 3] {
        std::fs::write(&path, &sound[..length]).expect("written");
        let why = read(&path, &ReadOptions::new(2)).expect_err("cut").to_string();
        assert!(why.contains("cut.npz") && why.contains("cut off"), "{length}: {why}");
    }
    let mut arrays = signals();
    arrays[1] = Array { name: "q", description: "<f2", shape: &[ROWS, 2], bytes: vec![0; 4 * ROWS] };
    assert!(read_back(&arrays).is_err());
}
