//! `examples/franka.py` with franky-sim in place of the arm: the diagnosis names what the simulator's MJCF has and the URDF lacks.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::net::TcpStream;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use rivet_tests::process::{Process, eventually};
use rivet_tests::{rivet, root, succeed};
use serde_json::Value;

/// Damping \[N m s/rad\], armature \[kg m²\] and friction loss \[N m\] of each joint of the simulator, and the path of its URDF.
const TRUTH: &str = "
import json, pathlib, franky_sim
from franky_sim.mujoco_simulator import MujocoSimulator
sim = MujocoSimulator()
robot = sim.add_robot()
sim._start()
values = lambda name: [float(getattr(sim.model, 'dof_' + name)[i]) for i in robot._dof_addrs]
urdf = pathlib.Path(franky_sim.__file__).parent / 'assets' / 'fr3.urdf'
print(json.dumps([str(urdf), *map(values, ['damping', 'armature', 'frictionloss'])]))
";

fn python() -> Command {
    Command::new(std::env::var_os("RIVET_PYTHON").unwrap_or_else(|| "python3".into()))
}

fn list(value: &Value) -> Vec<f64> {
    value.as_array().expect("numbers").iter().map(|x| x.as_f64().expect("a number")).collect()
}

/// Values of the diagnosis by joint, from 0. The file's values are in the URDF: a change adds to `nominal`.
fn found(diagnosis: &Value, effect: &str, key: &str, nominal: f64) -> BTreeMap<usize, f64> {
    let causes = diagnosis["causes"].as_array().expect("causes");
    let cause =
        causes.iter().find(|cause| cause["effect"] == effect).unwrap_or_else(|| panic!("{effect}: {causes:#?}"));
    let magnitude = cause["magnitude"].as_object().expect("magnitudes");
    magnitude
        .iter()
        .filter_map(|(name, value)| {
            let value = value.as_f64().expect("a number");
            let (head, tail) = name.split_once('.')?;
            let number = head.trim_start_matches("fr3_joint").trim_start_matches('j').parse::<usize>().ok()?;
            match tail {
                tail if tail == key => Some((number - 1, value)),
                tail if tail.starts_with("change") => Some((number - 1, nominal + value)),
                _ => None,
            }
        })
        .collect()
}

/// Each value is within 5 % of the simulator's.
fn assert_near(effect: &str, found: &BTreeMap<usize, f64>, truth: &[f64]) {
    for (joint, value) in found {
        let error = value / truth[*joint] - 1.0;
        println!("{effect} of joint {}: {value:.4}, {:+.1} %", joint + 1, 100.0 * error);
        assert!(error.abs() < 0.05, "{effect} of joint {}: {value} instead of {}", joint + 1, truth[*joint]);
    }
}

#[test]
fn the_diagnosis_names_what_the_simulator_has_and_the_urdf_lacks() {
    let modules = "import pylibfranka, franky_sim, mujoco";
    if !python().args(["-c", modules]).output().is_ok_and(|output| output.status.success()) {
        // Past the test harness, which keeps what a passing test prints to itself.
        let _ = writeln!(std::io::stderr(), "SKIPPED: Python lacks a module; pip install pylibfranka franky-sim");
        return;
    }
    let truth: Value = serde_json::from_slice(&succeed(python().args(["-c", TRUTH])).stdout).expect("JSON");
    let urdf = Path::new(truth[0].as_str().expect("a path"));
    let [damping, armature, friction] = [1, 2, 3].map(|i| list(&truth[i]));
    let folder = tempfile::tempdir().expect("a folder");
    let [log, file, json] = ["log.csv", "robot.toml", "diagnosis.json"].map(|name| folder.path().join(name));

    let pid = std::process::id();
    let host = format!("127.{}.{}.{}", 1 + (pid >> 16) % 200, (pid >> 8) & 0xff, 1 + (pid & 0xff) % 200);
    let mut simulator = python();
    simulator.args(["-m", "franky_sim.run_server", "--simulator", "mujoco", "--hostname", &host]);
    let _simulator = Process::start(simulator.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()));
    let address = format!("{host}:1337").parse().expect("an address");
    // It serves one client, and takes the next when that is gone.
    eventually("the simulator listens", || TcpStream::connect_timeout(&address, Duration::from_secs(1)).ok().map(drop));
    succeed(python().arg("-B").arg(root().join("examples/franka.py")).arg(&host).arg(&log).args(["40", "1"]));

    succeed(rivet().arg("new").arg(urdf).arg(&log).arg("-o").arg(&file));
    let output = rivet().arg("diagnose").arg(&file).arg(&log).arg("--json").arg(&json).output().expect("it runs");
    println!("{}", String::from_utf8_lossy(&output.stdout));
    assert_eq!(output.status.code(), Some(1), "causes are named: {}", String::from_utf8_lossy(&output.stderr));
    let diagnosis: Value = serde_json::from_slice(&std::fs::read(&json).expect("a file")).expect("JSON");
    assert_eq!(diagnosis["verdict"], "parameter");

    let all: Vec<usize> = (0..7).collect();
    let coulomb = found(&diagnosis, "coulomb_friction", "coulomb", 0.2);
    assert_eq!(coulomb.keys().copied().collect::<Vec<_>>(), all, "friction loss of each joint");
    assert_near("friction loss", &coulomb, &friction);
    let viscous = found(&diagnosis, "viscous_friction", "viscous", 0.003);
    assert_eq!(viscous.keys().copied().collect::<Vec<_>>(), all, "damping of each joint");
    assert_near("damping", &viscous, &damping);
    // The armature of joints 2 to 4 is not separable from the inertia of the links behind them by this motion.
    let rotors = found(&diagnosis, "rotor_inertia", "rotor_inertia", 0.0);
    for joint in [0, 4, 5, 6] {
        assert!(rotors.contains_key(&joint), "armature of joint {}: {rotors:?}", joint + 1);
    }
    assert_near("armature", &rotors, &armature);
}
