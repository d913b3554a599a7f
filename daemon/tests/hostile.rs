//! No message, however broken, brings the core down or makes what it publishes anything but numbers.

use rivet_daemon::Core;
use rivet_ipc_schema::{ControlCommand, Health, InputFault, JointState, LinkState, LoadLevel, Parameters, Setpoint};
use std::path::Path;

/// Numbers of a seed (xorshift).
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// Any bits at all, or numbers at the edges, or those that an arm has.
    fn number(&mut self, usual: f64) -> f64 {
        match self.bits() % 16 {
            0 => f64::from_bits(self.bits()),
            1 => [0.0, -0.0, f64::MIN_POSITIVE, f64::MAX, f64::MIN, f64::NAN, f64::INFINITY, 5e-324]
                [(self.bits() % 8) as usize],
            2 => usual * 1e3,
            _ => usual,
        }
    }

    fn whole(&mut self, usual: u64) -> u64 {
        match self.bits() % 64 {
            0 => self.bits(),
            1 => [0, 1, u64::MAX, u64::MAX - 1, u64::MAX / 2, 1 << 53][(self.bits() % 6) as usize],
            _ => usual,
        }
    }
}

#[test]
fn half_a_million_hostile_messages_cause_no_panic_and_no_number_that_is_none() {
    for (arm, seed) in [("dd2", 11), ("staubli-tx40", 12), ("kuka-kr300-r2500", 13)] {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots").join(arm).join("robot.toml");
        let robot = rivet_config::load(file).expect("the robot file is sound");
        let n = robot.dof();
        let mut core = Core::new(&robot).expect("sound settings");
        let mut random = Random(seed);
        let (mut parameters, mut health) = (Parameters::default(), Health::default());
        for k in 1..=150_000_u64 {
            let t = k as f64 * robot.config.sample_period_s;
            // Long quiet stretches between the storms, or nothing would ever be learnt that could be spoilt.
            let storm = k % 5000 > 4000;
            let mut state =
                JointState { seq: k, stamp_ns: (t * 1e9) as u64, joints: n as u32, ..JointState::default() };
            let mut plan = Setpoint { seq: k, stamp_ns: state.stamp_ns, joints: n as u32, ..Setpoint::default() };
            let mut link = LinkState { seq: k, joints: n as u32, ..LinkState::default() };
            for j in 0..n {
                let w = 1.0 + 0.7 * j as f64;
                let number = |random: &mut Random, usual: f64| if storm { random.number(usual) } else { usual };
                state.q[j] = number(&mut random, 0.3 * (w * t).sin());
                state.tau[j] = number(&mut random, 10.0 * (w * t + 0.3).cos());
                plan.q[j] = number(&mut random, 0.3 * (w * t).sin());
                plan.qd[j] = number(&mut random, 0.3 * w * (w * t).cos());
                plan.qdd[j] = number(&mut random, -0.3 * w * w * (w * t).sin());
                link.q[j] = number(&mut random, 0.3 * (w * t).sin());
            }
            if storm {
                state.seq = random.whole(k);
                state.stamp_ns = random.whole(state.stamp_ns);
                state.joints = random.whole(n as u64) as u32;
                state.faults = random.whole(0) as u32;
                plan.seq = random.whole(k);
                plan.joints = random.whole(n as u64) as u32;
                link.joints = random.whole(n as u64) as u32;
                match random.bits() % 500 {
                    0 => core.set_load([LoadLevel::Normal, LoadLevel::Decimate, LoadLevel::Hold][k as usize % 3]),
                    1 => core.note(InputFault::ClockSuspended, u64::MAX),
                    2 => drop(core.control(ControlCommand::Reset)),
                    3 => drop(core.control(ControlCommand::Freeze)),
                    4 => drop(core.control(ControlCommand::Resume)),
                    _ => {}
                }
            } else if k % 5000 == 1 {
                core.set_load(LoadLevel::Normal);
                core.control(ControlCommand::Resume);
            }
            core.tick_with_link(&state, Some(&plan), Some(&link));
            if k % 10 == 0 {
                core.write_parameters(&mut parameters);
                core.write_health(&mut health);
                assert!(parameters.values.iter().all(|x| x.is_finite()), "{arm}, period {k}, seed {seed}");
                assert!(parameters.std.iter().all(|x| x.is_finite() && *x >= 0.0), "{arm}, period {k}, seed {seed}");
            }
        }
        println!("{arm}: {:?}", core.counts());
        assert!(core.counts().samples > 50_000, "{:?}", core.counts());
    }
}
