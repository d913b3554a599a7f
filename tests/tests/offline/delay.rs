//! Measured logs whose torque was made late or early by a known time: the delay that `rivet identify` tells.

use std::path::Path;

use rivet_config::{Instruments, Robot};
use rivet_estimation::offline::{
    Delay, Equations, InstrumentSource, Method, OfflineSettings, Record, Rows, Trajectory, fit, torque_delay,
};
use rivet_logs::{ReadOptions, read};
use rivet_tests::shared;

/// What `rivet identify` takes its nominal values for: see its prior.
const WEAKER_PRIOR: f64 = 10.0;

/// The log of an arm on its own grid, with torque as drives that are `late` seconds behind would have told it.
fn record(robot: &Robot, log: &Path, late: f64) -> Record {
    let config = &robot.config;
    let options = ReadOptions {
        joints: robot.dof(),
        drive_gain: config.drive.drive_gain.as_deref(),
        torque_from_current: config.log.torque_from_current,
        joint_zero: Some(&config.log.joint_zero),
    };
    let log = read(log, &options).expect("a sound log");
    let usual = log.median_step_s();
    let period = if usual > 1.1 * config.sample_period_s { usual } else { config.sample_period_s };
    let (grid, _) = log.resample(period).expect("a uniform log");
    let shift = |tau: &Vec<f64>| -> Vec<f64> {
        let at = |k: usize| {
            let place = (k as f64 - late / period).clamp(0.0, (tau.len() - 1) as f64);
            let (whole, share) = (place.floor() as usize, place.fract());
            tau[whole] + share * (tau[(whole + 1).min(tau.len() - 1)] - tau[whole])
        };
        (0..tau.len()).map(at).collect()
    };
    let desired = match (&grid.q_des, &grid.qd_des, &grid.qdd_des) {
        (Some(q), Some(qd), Some(qdd)) => Some(Trajectory { q: q.clone(), qd: qd.clone(), qdd: qdd.clone() }),
        _ => None,
    };
    let tau = grid.torque().expect("torque").iter().map(shift).collect();
    Record { period_s: period, measured: Trajectory::from_positions(&grid.q, period), tau, desired, second: None }
}

fn delays(robot: &Robot, record: &Record) -> Vec<Delay> {
    let (config, signal) = (&robot.config, &robot.config.signal);
    let Instruments::Auto { delay_s, .. } = config.estimator.instruments else { panic!("as the robot is shipped") };
    let settings = OfflineSettings {
        filter_hz: signal.model_filter_hz,
        filter_order: signal.model_filter_order,
        row_period_s: config.sample_period_s * signal.decimation as f64,
        dead_zone: signal.dead_zone.clone(),
        instrument: record.desired.as_ref().map_or(InstrumentSource::Delayed(delay_s), |_| InstrumentSource::Desired),
    };
    let rows = [Rows::new(&robot.model, &robot.base, &settings, record).expect("rows")];
    let (equations, prior) = (Equations::new(&rows), WEAKER_PRIOR * config.estimator.prior);
    let found = fit(&equations, &robot.nominal_base, prior, Method::Instrumental).expect("a solution");
    torque_delay(&equations, &robot.nominal_base, prior, &found).expect("delays")
}

/// Every joint's delay moves as the torque was moved, or is said to be unknown; never is a wrong one told.
fn follows(arm: &str, log: &str, lates: &[f64], told: usize) {
    let Some(log) = shared(log) else { return };
    let robot = rivet_config::load(rivet_tests::robot(arm)).expect("a sound robot file");
    let logged = delays(&robot, &record(&robot, &log, 0.0));
    for late in lates {
        let found = delays(&robot, &record(&robot, &log, *late));
        let mut count = 0;
        for (j, (before, after)) in logged.iter().zip(&found).enumerate() {
            let (moved, std) = (after.seconds - before.seconds, before.std.hypot(after.std));
            println!(
                "{arm} {:+.0} ms joint {}: {:.1} -> {:.1} +- {:.1} ms {:?}",
                1e3 * late,
                j + 1,
                1e3 * before.seconds,
                1e3 * after.seconds,
                1e3 * after.std,
                after.doubt
            );
            count += usize::from(after.doubt.is_none());
            // What least squares and instruments tell of the KUKA's joint 2 as logged is apart by 3.1 deviations.
            if after.doubt.is_none() && before.doubt.is_none() {
                assert!((moved - late).abs() < f64::max(3.0 * std, 0.15 * late.abs()), "{arm} joint {}", j + 1);
            }
        }
        assert!(count >= told, "{arm} {late}: {count}");
    }
}

#[test]
fn tx40_torque_made_late_by_up_to_a_tenth_of_a_second_is_told_so() {
    follows(
        "staubli-tx40",
        "data/real/staubli_tx40/exciting_0.0-5.5s.parquet",
        &[0.0, 0.005, 0.03, -0.02, 0.06, -0.06, 0.1, -0.1],
        4,
    );
}

#[test]
fn kuka_torque_made_late_by_up_to_a_tenth_of_a_second_is_told_so() {
    follows("kuka-kr300-r2500", "data/real/kuka_kr300/traj_A_10s.parquet", &[0.0, 0.01, 0.04, -0.04, 0.1, -0.1], 4);
}

#[test]
fn ur10e_torque_made_late_by_up_to_a_tenth_of_a_second_is_told_so() {
    follows(
        "ur10e",
        "data/real/ur10e_innopolis/20_02_10-30sec_12harm.parquet",
        &[0.0, 0.02, 0.05, -0.05, 0.1, -0.1],
        4,
    );
}
