//! What a log would have shown: effects made by the simulated plant's physics, added to a log of another program's arm in
//! which nothing is wrong.

use rivet_config::Robot;
use rivet_diagnosis::{Effect, Run, Silent, diagnose, probe};
use rivet_logs::{ReadOptions, read};
use rivet_simulation::{Injected, Injector, Recorded};
use rivet_tests::shared;

fn undisturbed() -> Option<(Robot, [Run; 2])> {
    let case = shared("data/practice")?.join("case-24");
    let robot = rivet_config::load(case.join("robot.toml")).expect("a sound robot file");
    let run = |name: &str| {
        let log = read(case.join(name), &ReadOptions::new(robot.dof())).expect("a log");
        let (log, report) = log.resample(0.001).expect("an even clock");
        let tau = log.torque().expect("torque").clone();
        Run {
            name: name.to_owned(),
            period_s: report.period_s,
            q: log.q,
            tau,
            temperature: log.temperature,
            ..Run::default()
        }
    };
    let runs = ["log-a.parquet", "log-b.parquet"].map(run);
    Some((robot, runs))
}

/// Strong effects are named on their joints, faint ones and none at all are not; what the probe names first, the whole
/// procedure names as well.
#[test]
fn the_probe_finds_what_the_diagnosis_finds() {
    let Some((robot, runs)) = undisturbed() else { return };
    let injectors = [0, 1]
        .map(|i| Injector::new(Recorded::of(&robot.model, &robot.nominal, runs[i].period_s, &runs[i].q, &runs[i].tau)));
    let added = |effect: Injected| -> Vec<Vec<Vec<f64>>> { injectors.iter().map(|i| i.torque(effect)).collect() };
    let load = |ratio: f64| added(Injected::LoadFriction { joint: 1, ratio });
    let delay = added(Injected::Delay { seconds: 0.006 });
    let asked = probe(&robot.model, &robot.nominal, runs.to_vec(), &mut Silent, |probe| {
        assert!(probe.found().is_empty(), "{:?}", probe.found());
        let first = probe.named_with(&load(0.2), None);
        let faint = probe.named_with(&load(1e-5), None);
        let late = probe.named_with(&delay, None);
        // Nothing of what was asked before is left behind.
        assert_eq!(probe.named_with(&load(0.2), None), first);
        (first, faint, late)
    })
    .expect("a sound log");
    let (first, faint, late) = asked;
    let first = first.expect("friction of a fifth of the load is found");
    let is = |effect: Effect| first.effect == effect || first.or.contains(&effect);
    assert!(is(Effect::LoadDependentFriction) && first.joints == [1], "{first:?}");
    assert_eq!(faint, None);
    assert_eq!(late.map(|n| n.effect), Some(Effect::TransportDelay));

    let mut disturbed = runs.to_vec();
    for (run, added) in disturbed.iter_mut().zip(load(0.2)) {
        for (tau, added) in run.tau.iter_mut().zip(added) {
            tau.iter_mut().zip(added).for_each(|(t, a)| *t += a);
        }
    }
    let whole = diagnose(&robot.model, &robot.nominal, disturbed, &mut Silent).expect("sound logs");
    let same = whole.causes.iter().any(|c| is(c.effect) && c.joints == [robot.model.arm.joints[1].name.clone()]);
    assert!(same, "{:?}", whole.causes);
}
