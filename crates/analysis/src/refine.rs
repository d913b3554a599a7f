//! `rivet identify --refine`: the method and the law of friction that predict best what they have not seen.
//!
//! No single law of friction is right for all gears, and a term more always lowers the residual of the rows it is fitted
//! to. Instruments take away the bias of least squares, at a price in variance that a short or slow log may not pay for. Each candidate is therefore fitted to the logs without one part and judged on that part, every part in turn: whole
//! logs where there are several (another motion is the harder test), else four stretches of the one. Rows below the dead
//! zone are not fitted, but they are predicted.

use anyhow::{Result, anyhow};
use rivet_config::{FrictionLaw, Robot};
use rivet_logs::Log;
use serde_json::{Value, json};

use crate::fit;
use crate::left_out::{self, LeftOut};
use crate::rows;
use crate::table::Table;

/// Speeds over which friction turns about that are tried \[rad/s\].
const VELOCITIES: [f64; 5] = [0.001, 0.003, 0.01, 0.03, 0.1];
/// Presliding travels that are tried \[rad\].
const TRAVELS: [f64; 6] = [1e-5, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3];
/// A law with a parameter more is taken where it lowers the error by this share.
const WORTH: f64 = 0.01;
/// A choice other than the law of the robot file is better by so many standard errors: by chance in one of ten comparisons, one-sided. Parts
/// of logs of one kind of motion hardly show what another kind needs.
const MIN_GAIN_STANDARD_ERRORS: f64 = 1.28;

/// A law and what it left of the parts that it was not fitted to.
#[derive(Clone, Debug)]
pub(crate) struct Tried {
    pub(crate) law: FrictionLaw,
    pub(crate) instruments: bool,
    /// `100*|tau - D x|/|tau|` per joint \[%\]; NaN of a joint that never moves, of which nothing is found.
    pub(crate) joints: Vec<f64>,
    /// The same, block by block.
    left_out: LeftOut,
}

impl Tried {
    /// Root mean square over the joints \[%\].
    pub(crate) fn error(&self) -> f64 {
        let known: Vec<f64> = self.joints.iter().copied().filter(|e| !e.is_nan()).collect();
        (known.iter().map(|e| e * e).sum::<f64>() / known.len().max(1) as f64).sqrt()
    }
}

/// What was chosen.
pub struct Refined {
    /// The robot with the law that predicts left-out parts best.
    pub robot: Robot,
    /// Every law that was tried, in order; the first is the robot file's.
    tried: Vec<Tried>,
}

impl Refined {
    fn is_chosen(&self, tried: &Tried) -> bool {
        tried.law == self.robot.friction_law() && tried.instruments != self.robot.config.estimator.kind.least_squares()
    }

    /// Every law that was tried, as JSON.
    pub fn json(&self) -> Value {
        let as_json = |tried: &Tried| {
            json!({
                "estimator": if tried.instruments { "instrumental" } else { "least_squares" },
                "friction_law": law_json(&tried.law),
                "left_out_percent": tried.error(),
                "chosen": self.is_chosen(tried),
            })
        };
        self.tried.iter().map(as_json).collect()
    }

    /// The laws and their errors as a table.
    pub fn text(&self) -> String {
        let mut table = Table::new([
            "method",
            "friction_velocity",
            "presliding_travel",
            "quadratic",
            "load",
            "left-out error %",
            "",
        ]);
        for tried in &self.tried {
            let law = tried.law;
            let number = |x: f64| if x > 0.0 { format!("{x:.0e}") } else { "-".to_owned() };
            let yes = |x: bool| if x { "yes" } else { "-" }.to_owned();
            table.row([
                if tried.instruments { "IV" } else { "LS" }.to_owned(),
                if law.presliding_travel > 0.0 { "-".to_owned() } else { number(law.sign_velocity) },
                number(law.presliding_travel),
                yes(law.viscous_quadratic),
                yes(law.load_dependent),
                format!("{:.2}", tried.error()),
                if self.is_chosen(tried) { "chosen" } else { "" }.to_owned(),
            ]);
        }
        format!(
            "\nmethods and laws of friction, judged by parts of the logs that they were not fitted to\n{}",
            table.text()
        )
    }
}

/// A law of friction by the keys of the robot file: of a travel and a velocity only what it has.
pub(crate) fn law_json(law: &FrictionLaw) -> Value {
    let sliding = law.presliding_travel > 0.0;
    json!({
        "friction_velocity": if sliding { None } else { Some(law.sign_velocity) },
        "presliding_travel": if sliding { Some(law.presliding_travel) } else { None },
        "viscous_quadratic": law.viscous_quadratic,
        "load_dependent": law.load_dependent,
    })
}

/// Tries methods and laws of friction on `logs`.
pub fn refine(robot: &Robot, logs: &[Log]) -> Result<Refined> {
    let first = judge(robot, !robot.config.estimator.kind.least_squares(), robot.friction_law(), logs)?;
    let mut search = Search { robot, logs, best: first.clone(), tried: vec![first] };
    search.other_method()?;
    let law = search.best.law;
    let plain = FrictionLaw { presliding_travel: 0.0, load_dependent: false, viscous_quadratic: false, ..law };
    let soft = VELOCITIES.map(|sign_velocity| FrictionLaw { sign_velocity, ..plain });
    let sliding = TRAVELS.map(|presliding_travel| FrictionLaw { presliding_travel, ..plain });
    // One number for another: whatever is better.
    let laws: Vec<FrictionLaw> = soft.into_iter().chain(sliding).collect();
    search.step(&laws, 0.0)?;
    let law = search.best.law;
    search.step(&[FrictionLaw { viscous_quadratic: true, ..law }], WORTH)?;
    let law = search.best.law;
    search.step(&[FrictionLaw { load_dependent: true, ..law }], WORTH)?;
    search.other_method()?;
    let Search { best, tried, .. } = search;
    let best = if is_better(&best, &tried[0]) { best } else { tried[0].clone() };
    Ok(Refined { robot: robot.with_instruments(best.instruments).with_friction_law(best.law)?, tried })
}

/// Whether a candidate predicts left-out blocks better than the default by more than noise.
fn is_better(candidate: &Tried, default: &Tried) -> bool {
    let [gain, standard_error] = candidate.left_out.log_ratio(&default.left_out);
    gain < -MIN_GAIN_STANDARD_ERRORS * standard_error
}

/// What has been tried so far.
struct Search<'a> {
    robot: &'a Robot,
    logs: &'a [Log],
    best: Tried,
    tried: Vec<Tried>,
}

impl Search<'_> {
    /// Takes the best of `laws`, if it lowers the error by the share `worth`.
    fn step(&mut self, laws: &[FrictionLaw], worth: f64) -> Result<()> {
        let before = self.best.error();
        for law in laws {
            let found = judge(self.robot, self.best.instruments, *law, self.logs)?;
            self.take(found, (1.0 - worth) * before);
        }
        Ok(())
    }

    /// Instruments instead of least squares, or the reverse.
    fn other_method(&mut self) -> Result<()> {
        let (before, best) = (self.best.error(), &self.best);
        let found = judge(self.robot, !best.instruments, best.law, self.logs)?;
        self.take(found, (1.0 - WORTH) * before);
        Ok(())
    }

    fn take(&mut self, found: Tried, below: f64) {
        if found.error() < self.best.error().min(below) {
            self.best = found.clone();
        }
        self.tried.push(found);
    }
}

/// Fits a law to all logs but one part, each part in turn, and adds up what is left of the parts.
fn judge(robot: &Robot, instruments: bool, law: FrictionLaw, logs: &[Log]) -> Result<Tried> {
    let robot = robot.with_instruments(instruments).with_friction_law(law)?;
    let fitted = logs.iter().map(|log| Ok(rows::rows_of(&robot, log)?.rows)).collect::<Result<_>>()?;
    let judged = logs.iter().map(|log| Ok(rows::rows_everywhere(&robot, log)?.rows)).collect::<Result<_>>()?;
    let (fitted, judged) = (left_out::parts(fitted), left_out::parts(judged));
    let moves = |j: &usize| fitted.iter().flatten().any(|rows| rows.count(*j) > 0);
    let moving: Vec<usize> = (0..robot.dof()).filter(moves).collect();
    let mut found = LeftOut::default();
    let mut failed = None;
    for (out, judged) in judged.iter().enumerate() {
        let Some(mut rest) = left_out::rest(&fitted, out, robot.dof()) else {
            failed = Some(anyhow!("every part moves a joint that no other part moves"));
            continue;
        };
        match fit::values_of(&robot, &mut rest) {
            Ok(x) => found.add(judged, &x),
            Err(why) => failed = Some(why),
        }
    }
    if found.is_empty() {
        return Err(failed.unwrap_or_else(|| anyhow!("no logs")).context("no part of the logs can be left out"));
    }
    let percent = found.percent();
    let joints = (0..percent.len()).map(|j| if moving.contains(&j) { percent[j] } else { f64::NAN }).collect();
    Ok(Tried { law, instruments, joints, left_out: found })
}
