//! Which published parameters act, and when: the gate, the chain of sources, switches without a step.

mod common;

use common::{Moving, core, largest_step, place, published, robot, robot_of, robot_with, state};
use rivet_controller::Core;
use rivet_controller::gate::Refusal;
use rivet_ipc_schema::{CommandMode, ControllerHealth, ParameterSource, Parameters, SourceReason, parameter_flags};

fn health(core: &Core) -> ControllerHealth {
    let mut health = ControllerHealth::default();
    core.write_health(&mut health);
    health
}

fn reason(core: &Core) -> SourceReason {
    SourceReason::try_from(health(core).source_reason).expect("a known reason")
}

/// Half the friction and 10 % more of everything else: what a daemon might find.
fn other(robot: &rivet_config::Robot) -> Vec<f64> {
    let name = |i| robot.base.name(&robot.model, i);
    let factor = |i| if name(i).contains("viscous") || name(i).contains("coulomb") { 0.5 } else { 1.1 };
    robot.nominal_base.iter().enumerate().map(|(i, x)| factor(i) * x).collect()
}

fn with(mut set: Parameters, values: &[f64]) -> Parameters {
    set.values[..values.len()].copy_from_slice(values);
    set
}

/// One message per rule; the arm moves as the robot file says, so the robot file's values are the right ones.
#[test]
fn every_published_set_has_to_pass_the_gate() {
    let robot = robot();
    let good = published(&robot, 2400);
    let better = with(good, &robot.nominal_base.iter().map(|x| 1.0001 * x).collect::<Vec<_>>());
    let mut cases = vec![(good, Refusal::None), (better, Refusal::None)];
    let mut spoil = |why, change: &dyn Fn(&mut Parameters)| {
        let mut set = good;
        change(&mut set);
        cases.push((set, why));
    };
    spoil(Refusal::OtherModel, &|set| set.model_hash ^= 1);
    spoil(Refusal::OtherPeriod, &|set| set.sample_period_s *= 2.0);
    spoil(Refusal::OtherPeriod, &|set| set.sample_period_s = f64::NAN);
    spoil(Refusal::WrongCount, &|set| set.count -= 1);
    spoil(Refusal::WrongCount, &|set| set.count = u32::MAX);
    spoil(Refusal::Future, &|set| set.seq = 2501);
    spoil(Refusal::Stale, &|set| set.seq = 1499);
    spoil(Refusal::EpochBack, &|set| set.epoch = 0);
    spoil(Refusal::Provisional, &|set| set.flags |= parameter_flags::PROVISIONAL);
    spoil(Refusal::NotFinite, &|set| set.values[3] = f64::NAN);
    spoil(Refusal::NotFinite, &|set| set.values[30] = f64::INFINITY);
    let viscous = place(&robot, "viscous");
    spoil(Refusal::DrivingFriction, &|set| set.values[viscous] = -20.0);
    let coulomb = place(&robot, "coulomb");
    spoil(Refusal::DrivingFriction, &|set| set.values[coulomb] = -0.01);
    spoil(Refusal::InertiaNotPositive, &|set| set.values[place(&robot, "j6.rotor")] = -0.1);
    spoil(Refusal::TorqueChange, &|set| set.values[place(&robot, "l6.m+")] += 200.0);
    spoil(Refusal::PredictsWorse, &|set| set.values[coulomb] *= 1.5);
    spoil(Refusal::PredictsWorse, &|set| set.values.swap(coulomb, coulomb + 1));
    for (set, why) in cases {
        let mut core = core(&robot);
        Moving::new(&robot, &robot.nominal_base).run(&mut core, 2500, |_, _| ());
        let (sample, _) = Moving { seq: 2499, ..Moving::new(&robot, &robot.nominal_base) }.next();
        assert_eq!(core.offer_parameters(&set, &sample), why);
        assert_eq!(core.epoch(), if why == Refusal::None { set.epoch } else { 0 });
        assert_eq!(health(&core).refusals[u32::from(why) as usize], 1);
        if why == Refusal::None {
            assert_eq!(core.offer_parameters(&set, &sample), Refusal::Old, "the same message again");
            let replayed = Parameters { seq: 2450, epoch: set.epoch, ..set };
            assert_eq!(core.offer_parameters(&replayed, &sample), Refusal::EpochBack, "an epoch that was there before");
        }
    }
}

/// Without motion nothing tells right from wrong: another set has to wait, the same one is as good as ever.
#[test]
fn an_arm_that_stands_adopts_nothing_new() {
    let robot = robot();
    let mut core = core(&robot);
    let q = [0.3, -0.4, 0.8, 0.2, -0.7, 0.1];
    for seq in 1..=1000 {
        core.tick(&state(seq, &q)).expect("a sound sample");
    }
    let mut set = published(&robot, 990);
    assert_eq!(core.offer_parameters(&set, &state(1000, &q)), Refusal::None);
    set.seq = 1000;
    set.epoch += 1;
    set.values[0] *= 1.01;
    assert_eq!(core.offer_parameters(&set, &state(1000, &q)), Refusal::NotJudged);
}

#[test]
fn published_sets_wait_for_the_sample_from_which_they_may_act() {
    let robot = robot();
    let mut core = Core::new(&robot, 500).expect("sound settings");
    let q = [0.0; 6];
    core.offer_parameters(&published(&robot, 400), &state(499, &q));
    assert_eq!(core.counts().accepted, 0);
    core.offer_parameters(&published(&robot, 400), &state(500, &q));
    assert_eq!(core.counts().accepted, 1);
}

/// The whole chain on one run: nominal, live after a row of acceptable sets, last good when the daemon falls silent, live
/// again. The commands are those of an undisturbed run but for the rounding of a switch: no step that motion does not make.
#[test]
fn the_chain_of_sources_is_walked_without_a_step() {
    // Friction that turns over smoothly: the jump of Coulomb's law at every reversal would hide all others.
    let robot = robot_with("manutec-r3", &[("[signal]\n", "[signal]\nfriction_velocity = 0.6\n")]);
    let truth = other(&robot);
    let mut core = core(&robot);
    let mut moving = Moving::new(&robot, &truth);
    let publish = |core: &mut Core, sample: &rivet_ipc_schema::JointState| {
        if sample.seq.is_multiple_of(100) {
            core.offer_parameters(&with(published(&robot, sample.seq), &truth), sample);
        }
    };
    let nominal = moving.run(&mut core, 2500, |_, _| ());
    assert_eq!((core.source(), reason(&core)), (ParameterSource::Nominal, SourceReason::Start));
    let adopting = moving.run(&mut core, 410, publish);
    assert_eq!(core.source(), ParameterSource::Nominal, "four sets are not enough");
    let live = moving.run(&mut core, 2090, publish);
    assert_eq!((core.source(), reason(&core)), (ParameterSource::Live, SourceReason::Adopted));
    assert_eq!(CommandMode::try_from(live[2000].mode), Ok(CommandMode::Identified));
    let difference = core.acting().iter().zip(&truth).map(|(a, x)| (a - x).abs()).fold(0.0, f64::max);
    assert!(difference < 1e-9, "{difference}");
    let silent = moving.run(&mut core, 2000, |_, _| ());
    assert_eq!((core.source(), reason(&core)), (ParameterSource::LastGood, SourceReason::Silent));
    let again = moving.run(&mut core, 1000, |core, sample| {
        if sample.seq.is_multiple_of(100) {
            // A daemon that was started anew counts its epochs from 1.
            let epoch = (sample.seq - 7000) / 100 + 1;
            core.offer_parameters(&with(Parameters { epoch, ..published(&robot, sample.seq) }, &truth), sample);
        }
    });
    assert_eq!((core.source(), reason(&core)), (ParameterSource::Live, SourceReason::Adopted));

    let all: Vec<_> = [&nominal[1000..], &adopting, &live, &silent, &again].into_iter().flatten().copied().collect();
    let disturbed = largest_step(&robot, &all);
    let undisturbed = largest_step(&robot, &nominal[1000..]);
    assert!(disturbed < 1.0, "{disturbed} of the rate limit");
    assert!(disturbed < 1.3 * undisturbed, "{disturbed} against {undisturbed} of an undisturbed run");
    assert_eq!(health(&core).switches, 3);
}

/// While the daemon is silent the arm changes so that the last good parameters are worse than the robot file's.
#[test]
fn last_good_parameters_that_are_wrong_give_way_to_the_robot_files() {
    let robot = robot();
    let stored = other(&robot);
    let mut core = core(&robot);
    core.recall(&stored).expect("they describe an arm");
    assert_eq!(
        (core.source(), reason(&core)),
        (ParameterSource::Nominal, SourceReason::Start),
        "they wait for the gate"
    );
    let mut moving = Moving::new(&robot, &stored);
    moving.run(&mut core, 6000, |_, _| ());
    assert_eq!((core.source(), reason(&core)), (ParameterSource::LastGood, SourceReason::Stored));
    moving.x = robot.nominal_base.clone();
    moving.run(&mut core, 6000, |_, _| ());
    assert_eq!((core.source(), reason(&core)), (ParameterSource::Nominal, SourceReason::WorseThanNominal));
    moving.x = stored;
    moving.run(&mut core, 6000, |_, _| ());
    assert_eq!((core.source(), reason(&core)), (ParameterSource::LastGood, SourceReason::BetterThanNominal));
}

/// Inertia that suffices at the stored poses and not between them: stored parameters with it never act once the arm has come there.
#[test]
fn inertia_is_asked_again_where_the_arm_comes() {
    // Drives that are strong beside the difference: the arm of this test does not move as the torque says.
    let robot = robot_with("dd2", &[("torque_limit = [150, 15]", "torque_limit = [1500, 150]")]);
    // What couples the two links, most where the arm is stretched.
    let size = |i: &usize| robot.nominal_base[*i].abs();
    let moments = (0..robot.base.len()).filter(|i| robot.base.name(&robot.model, *i).starts_with("l2.mc"));
    let moment = moments.max_by(|a, b| size(a).total_cmp(&size(b))).expect("a first moment");
    let scaled = |factor: f64| {
        let mut x = robot.nominal_base.clone();
        x[moment] *= factor;
        x
    };
    let (mut passes, mut fails) = (1.0, 10.0);
    for _ in 0..50 {
        let factor = 0.5 * (passes + fails);
        let sound = core(&robot).recall(&scaled(factor)).is_ok();
        *(if sound { &mut passes } else { &mut fails }) = factor;
    }
    assert!(fails < 9.0, "the stored poses refuse a large one: {fails}");
    for (factor, outcome) in [(0.9 * passes, (ParameterSource::LastGood, 0)), (passes, (ParameterSource::Nominal, 1))] {
        let mut core = core(&robot);
        core.recall(&scaled(factor)).expect("sound at the stored poses");
        Moving::new(&robot, &scaled(factor)).run(&mut core, 4000, |_, _| ());
        let refused = health(&core).refusals[u32::from(Refusal::InertiaNotPositive) as usize];
        assert_eq!((core.source(), refused), outcome, "{factor} times the nominal moment");
    }
}

/// Sets that get worse in steps too small to be refused by their neighbours: each is measured by the best that was in use.
#[test]
fn a_row_of_sets_that_get_worse_step_by_step_comes_to_nothing() {
    let robot = robot();
    let truth = other(&robot);
    let mut core = core(&robot);
    let mut moving = Moving::new(&robot, &truth);
    // Half way back to the robot file's values, which are wrong, within 40 s.
    let walk = |seq: u64| -> Vec<f64> {
        let share = 0.5 * (seq.saturating_sub(5000) as f64 / 40_000.0).min(1.0);
        truth.iter().zip(&robot.nominal_base).map(|(t, n)| t + share * (n - t)).collect()
    };
    moving.run(&mut core, 45_000, |core, sample| {
        if sample.seq > 2500 && sample.seq.is_multiple_of(100) {
            core.offer_parameters(&with(published(&robot, sample.seq), &walk(sample.seq)), sample);
        }
    });
    assert_eq!(core.source(), ParameterSource::LastGood, "what is refused for long is not live");
    let refused = health(&core).refusals[u32::from(Refusal::PredictsWorse) as usize];
    assert!(refused > 300, "{refused} of 425 refused");
    // Where the walk was stopped: a share of what the robot file is wrong by.
    let acting = core.acting();
    let off = |x: &[f64]| (0..truth.len()).map(|i| (x[i] - truth[i]).powi(2)).sum::<f64>().sqrt();
    let share = off(acting) / off(&robot.nominal_base);
    println!("{refused} refused, the walk came {:.1} % of the way", 100.0 * share);
    assert!(share < 0.05, "{share}");
}

#[test]
fn stored_parameters_that_describe_no_arm_are_not_recalled() {
    let robot = robot();
    let mut core = core(&robot);
    let mut values = robot.nominal_base.clone();
    values[place(&robot, "j1.coulomb")] = -5.0;
    assert_eq!(core.recall(&values), Err(Refusal::DrivingFriction));
    assert_eq!(core.recall(&values[1..]), Err(Refusal::WrongCount));
    assert_eq!(core.source(), ParameterSource::Nominal);
}

/// A coupled motor may have a negative coefficient in one joint as long as the pair loses energy in every motion.
#[test]
fn friction_of_a_coupled_wrist_is_judged_as_a_pair() {
    let robot = robot_of("staubli-tx40");
    let mut core = core(&robot);
    let coupled = place(&robot, "coupling.viscous");
    let mut values = robot.nominal_base.clone();
    values[coupled] = 0.9;
    core.recall(&values).expect("0.9^2 < 1.6 * 0.69");
    values[coupled] = 1.6;
    values[place(&robot, "coupling.coulomb")] = 0.0;
    assert_eq!(core.recall(&values), Err(Refusal::DrivingFriction));
}
