//! Bodies that a URDF does not have, from logs: what a diagnosis starts with where there is no nominal model of them.

use anyhow::Result;
use rivet_config::Robot;
use rivet_diagnosis::TRAINING_SHARE;
use rivet_dynamics::{LINK_PARAMETERS, Parameter};
use rivet_estimation::consistency::project;
use rivet_estimation::offline::{Equations, Method, fit};
use rivet_logs::Log;

use crate::evidence::Distrust;
use crate::fit::WEAKER_PRIOR;
use crate::rows::rows_without_plan;

/// The robot with bodies from the logs in the place of those that its URDF does not have; the robot as it is where none is missing.
///
/// Only what a diagnosis looks at is learnt from: all logs but the last, or the first part of a single one.
pub(crate) fn with_bodies(robot: Robot, logs: &[&Log]) -> Result<(Robot, Option<Distrust>)> {
    let unknown = robot.description.unknown_bodies.clone();
    if unknown.is_empty() || logs.is_empty() {
        return Ok((robot, None));
    }
    let cut;
    let training: Vec<&Log> = match logs {
        [log] => {
            cut = log.slice(0..(TRAINING_SHARE * log.len() as f64) as usize);
            vec![&cut]
        }
        [training @ .., _] => training.to_vec(),
        [] => Vec::new(),
    };
    let mut rows = Vec::new();
    for log in training {
        rows.extend(rows_without_plan(&robot, log)?.rows);
    }
    let equations = Equations::new(&rows);
    let prior = WEAKER_PRIOR * robot.config.estimator.prior;
    let found = fit(&equations, &robot.nominal_base, prior, Method::LeastSquares)?;
    let reference = equations.reference();
    let (model, base) = (&robot.model, &robot.base);
    let made = project(model, base, &found.values, &found.covariance, &robot.nominal, &reference);
    let mut learnt = robot.clone();
    let how = match made {
        Ok(made) => {
            for (k, parameter) in model.parameters.iter().enumerate() {
                if matches!(parameter, Parameter::Link { link, .. } if unknown.contains(link)) {
                    learnt.nominal[k] = made.standard[k];
                }
            }
            let model = std::sync::Arc::make_mut(&mut learnt.model);
            for &j in &unknown {
                let at = LINK_PARAMETERS * j;
                model.arm.links[j].copy_from_slice(&learnt.nominal[at..at + LINK_PARAMETERS]);
            }
            learnt.nominal_base = learnt.base.from_standard(&learnt.nominal);
            "they are identified from the logs before the comparison".to_owned()
        }
        Err(why) => {
            format!("the logs do not determine them ({why}), so values from link lengths and torque limits are used")
        }
    };
    let links: Vec<&str> = unknown.iter().map(|&j| robot.model.arm.joints[j].link.as_str()).collect();
    let text = format!(
        "the URDF has no <inertial> of {}: there is nothing to compare these bodies with; {how}. Causes refer to drives and friction, not to \
         these bodies",
        links.join(", ")
    );
    Ok((learnt, Some(Distrust { log: None, joint: None, name: BODIES_UNKNOWN, text })))
}

/// Name of the finding that bodies are unknown.
pub(crate) const BODIES_UNKNOWN: &str = "bodies_unknown";
