//! Drawn arms: simulated logs of arms that differ from their robot files, with those files as a new user writes them.

use std::path::{Path, PathBuf};

use rivet_logs::{Log, TorqueSource};
use rivet_simulation::two_mass::Recording;

use super::{Outcome, Task, outcome, without_tuned_keys};
use crate::blind;
use crate::real::Engine;

/// Arms that are drawn from, below `robots/`.
pub(crate) const ARMS: [&str; 6] = ["ur10e", "staubli-tx40", "manutec-r3", "ur5e", "kuka-kr300-r2500", "ur10"];
/// Rates of the logs \[Hz\].
pub(crate) const RATES_HZ: [f64; 3] = [100.0, 250.0, 1000.0];
/// Shortest time between samples of the errors \[s\].
const MIN_ERROR_PERIOD_S: f64 = 0.002;

/// Identifies `count` drawn arms from one log each and compares the prediction of another log with plain least squares; those that
/// failed with the reason.
///
/// Case `k` has seed `seed + k`, arm `k` of the list and rate `k` of 100, 250 and 1000 Hz, in turns. The file's bodies, drives and friction are
/// wrong in half of the cases, and most arms have an effect that the model lacks (see [`blind`]). Logs have no desired motion.
///
/// * `root`: the checkout, with `robots/`
pub fn run(root: &Path, count: usize, seed: u64, engine: &Engine<'_>) -> (Vec<Outcome>, Vec<String>) {
    let (mut outcomes, mut failed) = (Vec::new(), Vec::new());
    for k in 0..count {
        let (arm, rate_hz) = (ARMS[k % ARMS.len()], RATES_HZ[k % RATES_HZ.len()]);
        let seed = seed.wrapping_add(k as u64);
        match task(root, arm, rate_hz, seed).and_then(|task| outcome(&task, engine)) {
            Ok(outcome) => outcomes.push(outcome),
            Err(why) => failed.push(format!("drawn {arm}, seed {seed}: {why}")),
        }
    }
    (outcomes, failed)
}

fn task(root: &Path, arm: &str, rate_hz: f64, seed: u64) -> Result<Task, String> {
    let tuned = rivet_config::load(root.join("robots").join(arm).join("robot.toml")).map_err(|e| e.to_string())?;
    let case = blind::case(&tuned, seed).ok_or("no drawn arm follows its motion")?;
    let step = (1.0 / (rate_hz * blind::PERIOD_S)).round().max(1.0) as usize;
    let period_s = step as f64 * blind::PERIOD_S;
    let robot = without_tuned_keys(&tuned, period_s, root)?;
    let effects: Vec<&str> = case.effects.iter().map(|effect| effect.effect).collect();
    let file = if case.nominal_error.is_some() { "wrong file" } else { "true file" };
    let effects = if effects.is_empty() { "no effect".to_owned() } else { effects.join(" and ") };
    let [train, test] = case.runs.each_ref().map(|run| vec![log(run, step)]);
    Ok(Task {
        name: format!("{arm}, seed {seed}, {rate_hz} Hz, {file}, {effects}"),
        judged: (0..robot.dof()).collect(),
        period_s: period_s.max(MIN_ERROR_PERIOD_S),
        cutoff_hz: tuned.config.signal.model_filter_hz,
        robot,
        train,
        test,
    })
}

/// Every `step`-th row of a recording, positions and torques.
pub(crate) fn log(run: &Recording, step: usize) -> Log {
    let thinned = |signal: &Vec<f64>| signal.iter().step_by(step).copied().collect::<Vec<f64>>();
    Log {
        path: PathBuf::from("drawn"),
        t: thinned(&run.t),
        q: run.q.iter().map(thinned).collect(),
        tau: Some((TorqueSource::Logged, run.tau.iter().map(thinned).collect())),
        qd: None,
        q_des: None,
        qd_des: None,
        qdd_des: None,
        temperature: None,
        current: None,
        q_link: vec![None; run.q.len()],
        unused: Vec::new(),
        stamps: None,
        off_s: 0.0,
        crowded: 0,
        damaged_t: Vec::new(),
        notes: Vec::new(),
    }
}
