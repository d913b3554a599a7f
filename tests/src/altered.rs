//! Measured logs and robot files with one thing changed, and what the commands say of them.

use std::path::{Path, PathBuf};
use std::process::Command;

use rivet_logs::{Log, ReadOptions, read, write_columns};

use crate::robot;

/// A measured log with its time and positions changed, row by row.
pub fn changed(arm: &str, log: &Path, folder: &Path, change: impl Fn(usize, &mut f64, &mut [f64])) -> PathBuf {
    let mut log = sound(arm, log);
    for row in 0..log.len() {
        let mut q: Vec<f64> = log.q.iter().map(|q| q[row]).collect();
        change(row, &mut log.t[row], &mut q);
        log.q.iter_mut().zip(q).for_each(|(signal, q)| signal[row] = q);
    }
    let tau = log.torque().expect("torque").clone();
    written(&log, &tau, folder)
}

/// A measured log with the torque of each joint (from 0) multiplied.
pub fn with_torque_times(arm: &str, log: &Path, folder: &Path, factor: impl Fn(usize) -> f64) -> PathBuf {
    let log = sound(arm, log);
    let mut tau = log.torque().expect("torque").clone();
    for (j, tau) in tau.iter_mut().enumerate() {
        for tau in tau.iter_mut() {
            *tau *= factor(j);
        }
    }
    written(&log, &tau, folder)
}

/// The log of an arm in `robots/`, currents with its drive gain.
pub fn sound(arm: &str, log: &Path) -> Log {
    let robot = rivet_config::load(robot(arm)).expect("a sound robot file");
    let options = ReadOptions { drive_gain: robot.config.drive.drive_gain.as_deref(), ..ReadOptions::new(robot.dof()) };
    read(log, &options).expect("a sound log")
}

/// The log with these torques, written into the folder.
pub fn written(log: &Log, tau: &[Vec<f64>], folder: &Path) -> PathBuf {
    let mut columns = vec![("t".to_owned(), &log.t[..])];
    for j in 0..tau.len() {
        columns.push((format!("q{}", j + 1), &log.q[j][..]));
        columns.push((format!("tau{}", j + 1), &tau[j][..]));
    }
    for (j, q) in log.q_des.iter().flatten().enumerate() {
        columns.push((format!("q_des{}", j + 1), &q[..]));
    }
    for (j, q) in log.q_link.iter().enumerate() {
        columns.extend(q.iter().map(|q| (format!("q_link{}", j + 1), &q[..])));
    }
    let path = folder.join("changed.parquet");
    write_columns(&path, &columns).expect("written");
    path
}

/// Exit code and everything said, on one line.
pub fn said(command: &mut Command) -> (Option<i32>, String) {
    let output = command.output().expect("the program starts");
    let text = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
    (output.status.code(), text.split_whitespace().collect::<Vec<_>>().join(" "))
}

/// A copy of a robot's folder whose robot file has one word changed; the path of that file.
pub fn robot_with(arm: &str, folder: &Path, from: &str, to: &str) -> PathBuf {
    let source = robot(arm);
    let text = std::fs::read_to_string(&source).expect("readable");
    assert!(text.contains(from), "{text}");
    std::fs::copy(source.with_file_name("robot.urdf"), folder.join("robot.urdf")).expect("copied");
    let file = folder.join("robot.toml");
    std::fs::write(&file, text.replacen(from, to, 1)).expect("written");
    file
}

/// What a program gave, with what it wrote as JSON.
pub fn result(command: &mut Command, folder: &Path) -> (String, serde_json::Value) {
    let (code, text, json) = answer(command, folder);
    assert_eq!(code, Some(0), "{text}");
    (text, json)
}

/// The same with its exit code, which is an answer of its own.
pub fn answer(command: &mut Command, folder: &Path) -> (Option<i32>, String, serde_json::Value) {
    let json = folder.join("result.json");
    let (code, text) = said(command.arg("--json").arg(&json));
    (code, text, serde_json::from_slice(&std::fs::read(&json).expect("a result")).expect("sound JSON"))
}

/// Numbers that look random and are the same every time.
pub struct Random(pub u64);

impl Random {
    /// Between -0.5 and 0.5.
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f64 / f64::from(1_u32 << 24) - 0.5
    }

    /// About normal, of standard deviation 1.
    pub fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum()
    }
}
