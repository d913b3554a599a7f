//! Cross-validation on parts of the logs: what values found from some parts leave of the others.

use anyhow::{Result, anyhow};
use rayon::prelude::*;
use rivet_config::Robot;
use rivet_estimation::consistency::project;
use rivet_estimation::offline::{Equations, Rows, fit, residual_squares};

use crate::fit::{WEAKER_PRIOR, bounded, method};

/// Parts of a single log.
pub(crate) const STRETCHES: usize = 4;
/// The free set is exported where it is better by so many standard errors.
const MIN_GAIN_STANDARD_ERRORS: f64 = 1.0;
/// Blocks that a part is divided into where errors are compared.
const BLOCKS: usize = 4;

/// Errors on left-out parts: `[|tau - D x|^2, |tau|^2]` of every block and joint.
#[derive(Clone, Debug, Default)]
pub(crate) struct LeftOut {
    blocks: Vec<Vec<[f64; 2]>>,
}

impl LeftOut {
    /// Adds a part by values `x` that were found without it.
    pub(crate) fn add(&mut self, part: &[Rows], x: &[f64]) {
        for block in 0..BLOCKS {
            let rows: Vec<Rows> = part.iter().map(|rows| rows.part(block, BLOCKS)).collect();
            self.blocks.push(residual_squares(&rows, x));
        }
    }

    /// Whether nothing was left out.
    pub(crate) fn is_empty(&self) -> bool {
        self.blocks.iter().flatten().all(|[_, torque]| *torque == 0.0)
    }

    /// `100*|tau - D x|/|tau|` per joint \[%\].
    pub(crate) fn percent(&self) -> Vec<f64> {
        let percent = |[error, torque]: [f64; 2]| 100.0 * (error / torque.max(f64::MIN_POSITIVE)).sqrt();
        self.sums(None).into_iter().map(percent).collect()
    }

    /// Sums over all blocks but one, joint by joint.
    fn sums(&self, without: Option<usize>) -> Vec<[f64; 2]> {
        let mut sums = vec![[0.0; 2]; self.blocks.first().map_or(0, Vec::len)];
        for (_, block) in self.blocks.iter().enumerate().filter(|(k, _)| Some(*k) != without) {
            for (sum, [error, torque]) in sums.iter_mut().zip(block) {
                sum[0] += error;
                sum[1] += torque;
            }
        }
        sums
    }

    /// Mean over joints of ln(error over the error of `other`), and its standard error by leaving out one block after the other.
    /// Both have the same blocks.
    pub(crate) fn log_ratio(&self, other: &LeftOut) -> [f64; 2] {
        let mean = |without: Option<usize>| {
            let (ours, theirs) = (self.sums(without), other.sums(without));
            let ratios = ours.iter().zip(&theirs).filter(|(a, b)| a[0] > 0.0 && b[0] > 0.0);
            let logs: Vec<f64> = ratios.map(|(a, b)| 0.5 * (a[0] / b[0]).ln()).collect();
            logs.iter().sum::<f64>() / logs.len().max(1) as f64
        };
        let count = self.blocks.len();
        let each: Vec<f64> = (0..count).map(|block| mean(Some(block))).collect();
        let middle = each.iter().sum::<f64>() / count.max(1) as f64;
        let squares: f64 = each.iter().map(|x| (x - middle).powi(2)).sum();
        let share = (count as f64 - 1.0).max(0.0) / count.max(1) as f64;
        [mean(None), (share * squares).sqrt()]
    }
}

/// Rows of each log as parts: whole logs, or four stretches of a single one.
pub(crate) fn parts(logs: Vec<Vec<Rows>>) -> Vec<Vec<Rows>> {
    match logs.as_slice() {
        [log] => {
            let stretch = |part: usize| log.iter().map(|rows| rows.part(part, STRETCHES)).collect();
            (0..STRETCHES).map(stretch).collect()
        }
        _ => logs,
    }
}

/// Joints (from 0) with rows in any of the parts.
fn moving(parts: &[&[Rows]], dof: usize) -> Vec<usize> {
    (0..dof).filter(|j| parts.iter().any(|part| part.iter().any(|rows| rows.count(*j) > 0))).collect()
}

/// Rows of all parts but one, if every joint that moves anywhere moves there.
pub(crate) fn rest(parts: &[Vec<Rows>], out: usize, dof: usize) -> Option<Vec<Rows>> {
    let all: Vec<&[Rows]> = parts.iter().map(Vec::as_slice).collect();
    let others: Vec<&[Rows]> =
        parts.iter().enumerate().filter(|(k, _)| *k != out).map(|(_, part)| part.as_slice()).collect();
    (moving(&all, dof) == moving(&others, dof)).then(|| others.into_iter().flatten().cloned().collect())
}

/// Errors of free and of physically consistent parameters on left-out parts.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sets {
    free: LeftOut,
    consistent: LeftOut,
}

impl Sets {
    /// Fits all parts but one by the robot's method, each in turn.
    ///
    /// # Errors
    /// When no part can be left out.
    pub(crate) fn fit(robot: &Robot, parts: &[Vec<Rows>]) -> Result<Sets> {
        let prior = WEAKER_PRIOR * robot.config.estimator.prior;
        let both = |out: usize| -> Option<[Vec<f64>; 2]> {
            let mut rows = rest(parts, out, robot.dof())?;
            let bounded = bounded(robot, &mut rows, prior).ok()?;
            let equations = Equations::new(&rows);
            let mut found = fit(&equations, &bounded.nominal, prior, method(robot)).ok()?;
            bounded.hold(&mut found);
            let (model, base, reference) = (&robot.model, &robot.base, equations.reference());
            let near = project(model, base, &found.values, &found.covariance, &robot.nominal, &reference).ok()?;
            Some([found.values, near.base])
        };
        let found: Vec<Option<[Vec<f64>; 2]>> = (0..parts.len()).into_par_iter().map(both).collect();
        let mut sets = Sets::default();
        for (part, found) in parts.iter().zip(&found) {
            if let Some([free, consistent]) = found {
                sets.free.add(part, free);
                sets.consistent.add(part, consistent);
            }
        }
        if sets.free.is_empty() { Err(anyhow!("no part of the logs can be left out")) } else { Ok(sets) }
    }

    /// Whether the consistent parameters predict left-out rows better, or worse by less than the comparison's own standard error: an arm has
    /// consistent ones.
    pub(crate) fn prefers_consistent(&self) -> bool {
        let [gain, standard_error] = self.consistent.log_ratio(&self.free);
        gain < MIN_GAIN_STANDARD_ERRORS * standard_error
    }

    /// Errors of free and consistent parameters, root mean square over the joints \[%\].
    pub(crate) fn percents(&self) -> [f64; 2] {
        [&self.free, &self.consistent].map(|left_out| {
            let squares: Vec<f64> = left_out.percent().into_iter().filter(|p| p.is_finite()).map(|p| p * p).collect();
            (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn standard_error_of_a_ratio_grows_with_the_spread_of_blocks() {
        let left_out = |errors: &[f64]| LeftOut { blocks: errors.iter().map(|e| vec![[*e, 1.0]]).collect() };
        let even = left_out(&[1.0; 8]).log_ratio(&left_out(&[4.0; 8]));
        assert!((even[0] + std::f64::consts::LN_2).abs() < 1e-12 && even[1] < 1e-12, "{even:?}");
        let noisy = left_out(&[0.1, 3.0, 0.2, 2.5, 0.1, 2.0, 0.3, 0.8]).log_ratio(&left_out(&[1.0; 8]));
        assert!(noisy[1] > noisy[0].abs(), "{noisy:?}");
    }
}
