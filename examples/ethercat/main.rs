//! An arm of EtherCAT drives (CiA 402) as a robot controller, at 1 kHz. Here its bus is simulated, with the arm of the other
//! examples: no EtherCAT is spoken. `bus.rs` states where a master goes.
//!   cargo run --release -p librivet --example ethercat -- examples/ethercat/arm.toml [SAMPLES [PREFIX ROOT]]

mod arguments;
mod arm;
mod bus;
mod drive;
mod scaling;

use arm::Arm;
use bus::SimulatedBus;
use rivet::{Robot, Status, now_ns, sample_flags};
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

/// Waits for the beginning of the next period of 1 ms, and returns it.
fn periods() -> impl FnMut() -> u64 {
    let mut wake_ns = now_ns();
    move || {
        wake_ns += 1_000_000;
        std::thread::sleep(Duration::from_nanos(wake_ns.saturating_sub(now_ns())));
        wake_ns
    }
}

fn run(arguments: &[String]) -> Result<(), Box<dyn std::error::Error>> {
    let arguments = arguments::parse(arguments)?;
    let table = scaling::read(Path::new(&arguments.table))?;
    let joints = table.joints.len();
    let slaves: Vec<usize> = table.joints.iter().map(|joint| joint.slave).collect();
    let mut robot = Robot::open(&arguments.bus, "example-arm", u32::try_from(joints)?)?;
    let mut arm = Arm::enable(SimulatedBus::new(&slaves)?, table, periods())?; // dropped, it switches the drives off
    let (mut answered, mut missed, mut start, mut last) = (0, 100, None, [0.0; 8]);
    for k in 0..arguments.samples {
        let Some(mut sample) = arm.exchange() else {
            robot.skip(1); // the drives go on with what they have
            continue;
        };
        let (t, a, b) = (1e-3 * f64::from(k), 3.0_f64, 8.0_f64); // two sines, from rest where the arm is
        let start = start.get_or_insert(sample.q);
        for j in 0..joints {
            sample.q_des[j] = start[j] + 0.5 * (1.0 - (a * t).cos()) + 0.2 * (1.0 - (b * t).cos());
            sample.qd_des[j] = 0.5 * a * (a * t).sin() + 0.2 * b * (b * t).sin();
            sample.qdd_des[j] = 0.5 * a * a * (a * t).cos() + 0.2 * b * b * (b * t).cos();
        }
        sample.flags = sample_flags::SETPOINT;
        if robot.publish(&sample) != Status::Ok {
            return Err(format!("sample {}: {}", k + 1, robot.problem()).into());
        }
        let command = robot.wait_for_command(Duration::from_micros(800)).filter(|command| command.mode != 0);
        answered += u32::from(command.is_some());
        missed = if command.is_some() { 0 } else { missed + 1 };
        for j in 0..joints {
            // The arm's own controller.
            let feedback = 100.0 * (sample.q_des[j] - sample.q[j]) + 10.0 * (sample.qd_des[j] - arm.velocity(j));
            last[j] = command.map_or(if missed < 20 { last[j] } else { feedback }, |command| command.tau[j]);
        }
        arm.command(&sample.q_des, &last);
    }
    println!("published {}, lost {}, answered {answered}", robot.counters().published, robot.counters().lost);
    if let Some(set) = robot.parameters() {
        for i in 0..set.len() {
            println!("parameter {}: {:9.4} +- {:.4}, state {}", i + 1, set.values[i], set.std[i], set.state[i]);
        }
    }
    Ok(())
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if ["-h", "--help"].contains(&arguments.first().map_or("", String::as_str)) {
        println!("{}", arguments::USAGE);
        return ExitCode::SUCCESS;
    }
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("ethercat: {why}");
            ExitCode::FAILURE
        }
    }
}
