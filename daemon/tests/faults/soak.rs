//! Every fault, mixed at random, a million periods long, beside the undisturbed run and one that merely lost the samples.

use crate::bench::{ALL, Arm, Fault, Random, Spoiler, parameters, sigmas};
use rivet_daemon::Core;
use rivet_estimation::{Estimate, Identifier, Motion, Observer, Row, Sample};
use rivet_ipc_schema::{InputFault, JointState, Parameters, Setpoint};
use std::sync::Arc;

/// Differences to another run \[standard deviations\].
#[derive(Default)]
struct Differences {
    count: u64,
    squares: f64,
    worst: f64,
}

impl Differences {
    fn add(&mut self, disturbed: &Parameters, other: &Parameters) {
        self.count_in(sigmas(disturbed, other));
    }

    fn count_in(&mut self, off: f64) {
        self.count += 1;
        self.squares += off * off;
        self.worst = self.worst.max(off);
    }

    fn rms(&self) -> f64 {
        (self.squares / self.count as f64).sqrt()
    }
}

/// Learns from the same rows as the disturbed run, made of sound samples: what sets the two apart is what faulty numbers have
/// done, and nothing else.
struct Shadow {
    identifier: Identifier,
    gaps: u64,
    doubted: u64,
    /// The last two sound samples: some come the wrong way round.
    sound: [Option<(JointState, Setpoint)>; 2],
}

/// Admits rows that the disturbed run has admitted.
struct Admitted(bool);

impl Observer for Admitted {
    fn admits(&mut self, _row: &Row) -> bool {
        self.0
    }
}

impl Shadow {
    fn new(arm: &Arm) -> Shadow {
        let robot = &arm.robot;
        let settings = robot.config.estimation_settings();
        let identifier =
            Identifier::new(Arc::clone(&robot.model), Arc::clone(&robot.base), &robot.nominal_base, &settings);
        Shadow { identifier: identifier.expect("sound settings"), gaps: 0, doubted: 0, sound: [None, None] }
    }

    fn sound(&mut self, state: JointState, setpoint: Setpoint) {
        self.sound = [Some((state, setpoint)), self.sound[0]];
    }

    /// The disturbed run `core` has taken what came of sound sample `k`, or refused it.
    fn follow(&mut self, k: u64, taken: bool, core: &Core) {
        let counts = core.counts();
        if std::mem::replace(&mut self.gaps, counts.gaps) != counts.gaps {
            self.identifier.restart_signals();
        }
        let admitted = Admitted(std::mem::replace(&mut self.doubted, counts.doubted) == counts.doubted);
        if !taken {
            return;
        }
        let sound = self.sound.iter().flatten().find(|(state, _)| state.seq == k).expect("one of the last two");
        let (state, plan) = sound;
        let setpoint = Some(Motion { q: &plan.q[..2], qd: &plan.qd[..2], qdd: &plan.qdd[..2] });
        let sample = Sample { q: &state.q[..2], second: None, tau: &state.tau[..2], setpoint };
        self.identifier.push_observed(sample, &mut { admitted });
    }

    fn off(&self, disturbed: &Parameters) -> f64 {
        let Estimate { values, .. } = self.identifier.estimate();
        (0..disturbed.len())
            .map(|i| (disturbed.values[i] - values[i]).abs() / disturbed.std[i].max(f64::MIN_POSITIVE))
            .fold(0.0, f64::max)
    }
}

/// A fault about every two seconds, 0.15 s long in the mean; with the time in which signals settle again a quarter of all
/// samples is not learnt from. What that alone does to estimates of a window of five seconds is seen beside: the third run
/// gets sound samples only, and none while a fault lasts. What the faulty numbers themselves do is seen by a fourth, which
/// learns from the same rows as the disturbed one.
fn soak(periods: u64, seed: u64) {
    let (mut arm, mut random) = (Arm::new(3), Random::new(seed));
    let mut cores = [(); 3].map(|()| Core::new(&arm.robot).expect("sound settings"));
    let mut spoiler = Spoiler::new(&arm.robot);
    let (mut fault, mut until) = (None, 10_000);
    let mut met = [0_u32; ALL.len()];
    let [mut to_undisturbed, mut to_lost, mut to_shadow] = [(); 3].map(|()| Differences::default());
    let mut shadow = Shadow::new(&arm);
    for k in 1..=periods {
        if k >= until {
            fault = if fault.is_none() {
                spoiler.vary(&mut random);
                until = k + if random.share() < 0.3 { random.within(1, 5) } else { random.within(5, 300) };
                let which = random.within(0, ALL.len() as u64) as usize;
                met[which] += 1;
                Some(ALL[which])
            } else {
                until = k + random.within(200, 3500);
                None
            };
        }
        let (state, setpoint) = arm.at(k);
        let [whole, lost, core] = &mut cores;
        whole.tick(&state, Some(&setpoint));
        if matches!(fault, None | Some(Fault::Duplicated | Fault::TimeJump)) {
            lost.tick(&state, Some(&setpoint));
        }
        shadow.sound(state, setpoint);
        for (state, setpoint) in spoiler.pass(fault, state, setpoint) {
            let taken = core.tick(&state, Some(&setpoint)).taken.is_ok();
            shadow.follow(state.seq + spoiler.seq_behind, taken, core);
        }
        let recovered = core.input_fault() == InputFault::None && lost.input_fault() == InputFault::None;
        if k > 10_000 && k % 100 == 0 && fault.is_none() && recovered {
            let set = parameters(core);
            to_undisturbed.add(&set, &parameters(whole));
            to_lost.add(&set, &parameters(lost));
            to_shadow.count_in(shadow.off(&set));
        }
    }
    let [whole, _, core] = &cores;
    println!("seed {seed}: {} compared; met {met:?}", to_lost.count);
    println!("to the undisturbed run: rms {:.3}, worst {:.3}", to_undisturbed.rms(), to_undisturbed.worst);
    println!("to the run that lost them: rms {:.3}, worst {:.3}", to_lost.rms(), to_lost.worst);
    println!(
        "to the run that learnt from the same rows, all of them sound: rms {:.3}, worst {:.3}",
        to_shadow.rms(),
        to_shadow.worst
    );
    println!("{:?}", core.counts());
    assert!(met.iter().all(|&times| u64::from(times) > periods / 50_000), "every fault occurs: {met:?}");
    assert_eq!((core.changes(), whole.changes()), (0, 0), "seed {seed}: a fault passed for a payload");
    // What was not seen to be faulty has moved no parameter by as much as it is said to be uncertain.
    assert!(to_shadow.worst <= 1.0, "seed {seed}: harmed by {:.2} standard deviations", to_shadow.worst);
    // Each comparison is the largest of ten parameters, each of them an estimate from other rows of the same noise: what rows
    // are used differs by when signals settle. An estimate that was harmed is off by far more, and for the whole window.
    assert!(
        to_lost.rms() <= 0.5 && to_lost.worst <= 2.5,
        "seed {seed}: worst {:.2} standard deviations",
        to_lost.worst
    );
    assert!(to_undisturbed.rms() <= 1.0 && to_undisturbed.worst <= 3.0, "seed {seed}: {:.2}", to_undisturbed.worst);
}

#[test]
fn a_million_periods_of_mixed_faults_leave_the_estimate_where_it_is() {
    soak(1_000_000, 20_261_121);
}

#[test]
#[ignore = "two minutes: cargo test --release -p rivet-daemon --test faults -- --ignored"]
fn nor_do_ten_million() {
    for seed in 1..=10 {
        soak(1_000_000, seed);
    }
}
