//! The examples, built as a user builds them, beside a real `rivetd` and a real `rivet-controller`.

#[path = "common/mod.rs"]
mod common;

use common::{Bus, Programs, SAMPLES};
use rivet_ipc_schema::Health;
use std::process::{Command, Stdio};

/// Base parameters of the true arm of the examples, in the model's order: inertia, viscous and Coulomb friction, first moments.
const TRUTH: [f64; 5] = [0.9, 1.5, 2.0, 1.5, 0.0];

/// Joint states that the daemon has seen of the stream, whatever it did with them.
fn seen(health: &Health) -> u64 {
    health.samples + health.refused_stale + health.refused_invalid + health.rejected_faults + health.samples_held
}

/// Runs an example as the robot: none of its samples is lost, most are answered, the parameters are the true arm's.
fn drives(label: &str, example: impl FnOnce(&Bus) -> Command) {
    let _turn = common::turn();
    let bus = Bus::new(label);
    let programs = Programs::start(&bus);
    let mut robot = example(&bus);
    let printed = common::succeed(robot.arg(SAMPLES.to_string()).arg(bus.prefix()).arg(bus.root()));
    println!("{label}: {printed}");
    assert!(printed.starts_with(&format!("published {SAMPLES}, lost 0, ")), "{printed}");
    let health = programs.health_of_sample(SAMPLES);
    assert_eq!((health.lost, health.setpoints_missing), (0, 0), "{health:?}");
    assert_eq!(seen(&health), SAMPLES, "{health:?}");
    let controller = programs.controller_health_of_sample(SAMPLES);
    println!("{label}: controller answered {} of {SAMPLES}", controller.commands);
    assert!(controller.commands > SAMPLES / 2, "{controller:?}");
    assert_eq!((health.polls, controller.polls), (0, 0), "the wake-up event comes with each sample");
    let parameters = programs.parameters();
    for (i, truth) in TRUTH.into_iter().enumerate() {
        let error = (parameters.values[i] - truth).abs();
        assert!(error < 0.01 * truth.abs().max(1.0), "parameter {}: {} of {truth}", i + 1, parameters.values[i]);
    }
}

/// Compiles an example with `compiler`; `None`, said aloud, where there is no such compiler.
fn compiled(compiler: &str, source: &str, standard: &str, bus: &Bus) -> Option<Command> {
    let program = bus.folder().join(source.replace('.', "-"));
    let library = common::library_folder(bus.folder());
    let mut compile = Command::new(compiler);
    compile.args([standard, "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]);
    compile.arg(common::root().join("examples").join(source)).arg("-o").arg(&program);
    for folder in ["librivet/include", "ipc-schema/include"] {
        compile.arg("-I").arg(common::root().join(folder));
    }
    compile.arg("-L").arg(&library).args(["-lrivet", "-lm"]).arg(format!("-Wl,-rpath,{}", library.display()));
    if Command::new(compiler).arg("--version").stdout(Stdio::null()).status().is_err() {
        common::skipped(&format!("there is no compiler {compiler}"));
        return None;
    }
    common::succeed(&mut compile);
    Some(Command::new(program))
}

fn python(script: &str, bus: &Bus) -> Command {
    let mut python = Command::new("python3");
    let folders = ["librivet/python", "ipc-schema/python"].map(|folder| common::root().join(folder));
    python.env("PYTHONPATH", std::env::join_paths(folders).expect("folders"));
    python.env("RIVET_LIBRARY", common::library_folder(bus.folder()).join("librivet.so.1"));
    python.arg("-B").arg(common::root().join("examples").join(script));
    python
}

#[test]
fn robot_in_c_loses_no_sample_and_is_identified() {
    if !common::runs("cc") {
        return;
    }
    drives("c", |bus| compiled("cc", "robot.c", "-std=c11", bus).expect("a compiler"));
}

#[test]
fn robot_in_cpp_loses_no_sample_and_is_identified() {
    if !common::runs("c++") {
        return;
    }
    drives("cpp", |bus| compiled("c++", "robot.cpp", "-std=c++17", bus).expect("a compiler"));
}

#[test]
fn robot_in_python_loses_no_sample_and_is_identified() {
    if !common::runs("python3") {
        return;
    }
    drives("python", |bus| python("robot.py", bus));
}

#[test]
fn robot_in_rust_loses_no_sample_and_is_identified() {
    // Cargo builds the examples of a package before its tests.
    let example = common::profile_folder().join("examples/robot");
    drives("rust", |_| Command::new(&example));
}

/// Drives of CiA 402 on a simulated bus: what rivet sees went through their increments and per mille.
#[test]
fn robot_of_ethercat_drives_loses_no_sample_and_is_identified() {
    let mut example = Command::new(common::profile_folder().join("examples/ethercat"));
    example.arg(common::root().join("examples/ethercat/arm.toml"));
    drives("ethercat", |_| example);
}

/// The tables of two subscribers, while a robot moves.
#[test]
fn subscribers_print_the_parameters() {
    let _turn = common::turn();
    let bus = Bus::new("subscribe");
    let _programs = Programs::start(&bus);
    let mut robot = Command::new(common::profile_folder().join("examples/robot"));
    robot.arg("1000000").arg(bus.prefix()).arg(bus.root()).stdout(Stdio::null());
    let _robot = common::Process(robot.spawn().expect("the example starts"));
    let subscribers = [
        compiled("cc", "subscribe.c", "-std=c11", &bus),
        common::runs("python3").then(|| python("subscribe.py", &bus)),
    ];
    for mut subscriber in subscribers.into_iter().flatten() {
        subscriber.args([common::ROBOT, "2"]).arg(bus.prefix()).arg(bus.root());
        let printed = common::succeed(&mut subscriber);
        assert_eq!(printed.matches("epoch ").count(), 2, "{printed}");
        assert_eq!(printed.matches(" +- ").count(), 2 * TRUTH.len(), "{printed}");
        assert!(printed.contains("active"), "{printed}");
        assert!(printed.contains(", lost 0\n"), "{printed}");
    }
}
