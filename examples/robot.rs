//! A simulated arm of one joint as a robot controller, at 1 kHz: publishes samples and applies the commanded torque.
//!   cargo run --release -p librivet --example robot [SAMPLES [PREFIX ROOT]]

use rivet::{BusConfig, OpenError, Robot, Sample, Status, now_ns, sample_flags};
use std::time::Duration;

/// The true arm; arm/robot.toml has other values. Position \[rad\], velocity \[rad/s\], torque \[N m\].
#[derive(Default)]
struct Arm {
    q: f64,
    qd: f64,
    tau: f64,
}

impl Arm {
    /// Moves for 1 ms. The drive brings its torque to `commanded` within the period.
    fn step(&mut self, commanded: f64) {
        for i in 0..10 {
            let torque = self.tau + (commanded - self.tau) * (f64::from(i) + 0.5) / 10.0;
            let friction = 1.5 * self.qd + 2.0 * (self.qd / 0.1).tanh();
            self.qd += 1e-4 * (torque - 1.5 * 9.81 * self.q.sin() - friction) / 0.9;
            self.q += 1e-4 * self.qd;
        }
        self.tau = commanded;
    }
}

fn main() -> Result<(), OpenError> {
    let arguments: Vec<String> = std::env::args().collect();
    let samples = arguments.get(1).and_then(|samples| samples.parse().ok()).unwrap_or(10_000_u32);
    let config = match arguments.get(2..4) {
        Some([prefix, root]) => BusConfig { prefix: prefix.clone(), root: root.into() },
        _ => BusConfig::default(),
    };
    let mut robot = Robot::open(&config, "example-arm", 1)?;
    let (mut arm, mut answered, mut missed, mut wake_ns) = (Arm::default(), 0, 100, now_ns());
    for k in 0..samples {
        let (t, a, b) = (1e-3 * f64::from(k), 3.0_f64, 8.0_f64); // two sines, from rest
        let mut sample = Sample { flags: sample_flags::SETPOINT, stamp_ns: wake_ns, ..Sample::default() };
        (sample.q[0], sample.tau[0]) = (arm.q, arm.tau);
        sample.q_des[0] = 0.5 * (1.0 - (a * t).cos()) + 0.2 * (1.0 - (b * t).cos());
        sample.qd_des[0] = 0.5 * a * (a * t).sin() + 0.2 * b * (b * t).sin();
        sample.qdd_des[0] = 0.5 * a * a * (a * t).cos() + 0.2 * b * b * (b * t).cos();
        assert_eq!(robot.publish(&sample), Status::Ok);
        let command = robot.wait_for_command(Duration::from_micros(800)).filter(|command| command.mode != 0);
        answered += u32::from(command.is_some());
        missed = if command.is_some() { 0 } else { missed + 1 };
        let own = 100.0 * (sample.q_des[0] - arm.q) + 10.0 * (sample.qd_des[0] - arm.qd); // the arm's own controller
        arm.step(command.map_or(if missed < 20 { arm.tau } else { own }, |command| command.tau[0]));
        wake_ns += 1_000_000;
        std::thread::sleep(Duration::from_nanos(wake_ns.saturating_sub(now_ns())));
    }
    println!("published {}, lost {}, answered {answered}", robot.counters().published, robot.counters().lost);
    if let Some(set) = robot.parameters() {
        for i in 0..set.len() {
            println!("parameter {}: {:9.4} +- {:.4}, state {}", i + 1, set.values[i], set.std[i], set.state[i]);
        }
    }
    Ok(())
}
