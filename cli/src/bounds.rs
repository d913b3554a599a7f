//! Friction with load is a share of the torque that the gear carries: a value that no gear has is something else, and is taken out.
//!
//! Where a joint carries next to nothing, the column is as small, and what it is fitted to is what the model lacks: a wrist of a UR10e
//! came out with 84 N m of friction per N m carried (its other joints: 0.02 to 0.12), which predicts as well as none on motion alike
//! and is wrong by all of it under the first payload.

use std::ops::RangeInclusive;

use rivet_config::Robot;
use rivet_dynamics::Parameter;
use rivet_estimation::offline::{Equations, Fit, OfflineError, Rows};

use crate::evidence::Distrust;
use crate::table::number;

/// What friction over torque carried can be.
const SHARE: RangeInclusive<f64> = 0.0..=1.0;

/// What is left to be found of rows.
pub(crate) struct Bounded {
    /// Base parameters before, 0 where they were taken out.
    pub(crate) nominal: Vec<f64>,
    /// Solution of the equations that are left; none where the model has no such bound.
    pub(crate) values: Option<Vec<f64>>,
    held: Vec<Held>,
}

/// A value that was taken out.
struct Held {
    column: usize,
    joint: usize,
    found: f64,
}

impl Bounded {
    /// Takes friction with load out of the rows of joints on which `solve` finds what cannot be, until there is none.
    pub(crate) fn new(
        robot: &Robot,
        rows: &mut [Rows],
        solve: impl Fn(&Equations<'_>, &[f64]) -> Result<Vec<f64>, OfflineError>,
    ) -> Result<Bounded, OfflineError> {
        let mut left = Bounded { nominal: robot.nominal_base.clone(), values: None, held: Vec::new() };
        if !robot.model.structure.load_friction {
            return Ok(left);
        }
        loop {
            let values = solve(&Equations::new(rows), &left.nominal)?;
            let beyond = |column: usize| match robot.base.parameter(&robot.model, column) {
                // What is said of a joint that stands, the robot file says.
                Parameter::LoadFriction(joint) if rows.iter().any(|r| r.count(joint) > 0) => {
                    let found = values[column];
                    (!SHARE.contains(&found)).then_some(Held { column, joint, found })
                }
                _ => None,
            };
            let beyond: Vec<Held> = (0..values.len()).filter_map(beyond).collect();
            if beyond.is_empty() {
                left.values = Some(values);
                return Ok(left);
            }
            let columns: Vec<usize> = beyond.iter().map(|held| held.column).collect();
            for rows in rows.iter_mut() {
                rows.take_out(&columns);
            }
            for &column in &columns {
                left.nominal[column] = 0.0;
            }
            left.held.extend(beyond);
        }
    }

    /// Says so of a fit.
    pub(crate) fn hold(&self, fit: &mut Fit) {
        fit.hold(&self.held.iter().map(|held| held.column).collect::<Vec<_>>());
    }

    /// Says so to people.
    pub(crate) fn said(&self, robot: &Robot) -> impl Iterator<Item = Distrust> {
        let of = |held: &Held| Distrust {
            log: None,
            joint: Some(robot.model.arm.joints[held.joint].name.clone()),
            name: "load_friction_impossible",
            text: format!(
                "friction with load came out as {} N m per N m carried, and can be 0 to 1 only: these logs do not tell it (a joint that \
                 carries next to nothing shows none), and it would hold what the model lacks; it is held at 0 there and all else is \
                 found without it",
                number(held.found, 3)
            ),
        };
        self.held.iter().map(of)
    }
}
