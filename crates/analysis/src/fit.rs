//! The fit that counts: instruments or least squares as the robot file asks, with what no arm has taken out.

use anyhow::Result;
use rivet_config::{EstimatorKind, Robot};
use rivet_estimation::consistency::{Projection, project};
use rivet_estimation::offline::{Equations, Fit, Method, OfflineError, Rows, fit, solve};

use crate::bounds::Bounded;

/// The prior counts so many times weaker than on line: a whole record is at hand, and nominal values that are wrong (a
/// payload that the robot file does not know) must not pull for all of it. It settles what the motion leaves open.
pub(crate) const WEAKER_PRIOR: f64 = 10.0;

/// The fit that counts: instruments, unless the robot file asks for least squares.
pub(crate) fn choose<'a>(robot: &Robot, least_squares: &'a Fit, instrumental: &'a Fit) -> &'a Fit {
    match robot.config.estimator.kind {
        EstimatorKind::Riv | EstimatorKind::Energy => instrumental,
        EstimatorKind::Rls | EstimatorKind::RlsEnergy => least_squares,
    }
}

/// Takes out of the rows what comes out as no arm has it, by the fit that counts.
pub(crate) fn bounded(robot: &Robot, rows: &mut [Rows], prior: f64) -> Result<Bounded, OfflineError> {
    Bounded::new(robot, rows, |equations, nominal| solve(equations, nominal, prior, method(robot)))
}

/// The fit that counts and the physically consistent parameters near it, of rows.
pub(crate) fn fit_and_projection(robot: &Robot, mut rows: Vec<Rows>) -> Result<(Fit, Projection)> {
    let prior = WEAKER_PRIOR * robot.config.estimator.prior;
    let bounded = bounded(robot, &mut rows, prior)?;
    let equations = Equations::new(&rows);
    let mut fit = fit(&equations, &bounded.nominal, prior, method(robot))?;
    bounded.hold(&mut fit);
    let reference = equations.reference();
    let near = project(&robot.model, &robot.base, &fit.values, &fit.covariance, &robot.nominal, &reference)?;
    Ok((fit, near))
}

/// The values of the fit that counts, of rows.
pub(crate) fn values_of(robot: &Robot, rows: &mut [Rows]) -> Result<Vec<f64>> {
    let prior = WEAKER_PRIOR * robot.config.estimator.prior;
    let bounded = bounded(robot, rows, prior)?;
    match bounded.values {
        Some(values) => Ok(values),
        None => Ok(solve(&Equations::new(rows), &bounded.nominal, prior, method(robot))?),
    }
}

/// The method of the fit that counts.
pub(crate) fn method(robot: &Robot) -> Method {
    if robot.config.estimator.kind == EstimatorKind::Riv { Method::Instrumental } else { Method::LeastSquares }
}
