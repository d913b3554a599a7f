//! Values that the rows cannot tell, or that no arm has: they are taken out before the rest is found.
//!
//! Friction with load is a share of the torque that the gear carries: a value that no gear has is something else, and is taken out.
//!
//! Where a joint carries next to nothing, the column is as small, and what it is fitted to is what the model lacks: a wrist of a UR10e
//! came out with 84 N m of friction per N m carried (its other joints: 0.02 to 0.12), which predicts as well as none on motion alike
//! and is wrong by all of it under the first payload.
//!
//! A joint that turns one way only has its Coulomb friction and a constant torque in the same rows. What tells them apart there is how
//! friction turns over near standstill, which the model knows worst: a wrist came out with 3.7 +- 0.5 N m of offset and -1.2 of
//! friction for 0 and 2.5, which misses another motion by three quarters of its torque. The offset stays as the file has it.

use std::ops::RangeInclusive;

use rivet_config::Robot;
use rivet_dynamics::Parameter;
use rivet_estimation::offline::{Equations, Fit, OfflineError, Rows, one_way};

use crate::evidence::{Distrust, ONE_WAY_NAME};
use crate::table::number;

/// What friction over torque carried can be.
const SHARE: RangeInclusive<f64> = 0.0..=1.0;

/// What is left to be found of rows.
pub(crate) struct Bounded {
    /// Base parameters before, 0 where they were taken out.
    pub(crate) nominal: Vec<f64>,
    /// Solution of the equations that are left; none where it was not asked for.
    pub(crate) values: Option<Vec<f64>>,
    held: Vec<Held>,
}

/// A value that was taken out.
struct Held {
    column: usize,
    joint: usize,
    /// What it stays at.
    value: f64,
    why: Why,
}

enum Why {
    /// It came out as this, as no gear has it.
    Impossible(f64),
    /// An offset of a joint that turns one way.
    OneWay,
}

impl Bounded {
    /// Takes offsets of joints that turn one way out of the rows, then friction with load of joints on which `solve` finds what cannot be,
    /// until there is none.
    pub(crate) fn new(
        robot: &Robot,
        rows: &mut [Rows],
        solve: impl Fn(&Equations<'_>, &[f64]) -> Result<Vec<f64>, OfflineError>,
    ) -> Result<Bounded, OfflineError> {
        let mut bounded = Bounded { nominal: robot.nominal_base.clone(), values: None, held: Vec::new() };
        let turns = one_way(&robot.model, &robot.base, rows);
        for (column, value) in bounded.nominal.iter().enumerate() {
            if let Parameter::Offset(joint) = robot.base.parameter(&robot.model, column)
                && turns[joint]
            {
                bounded.held.push(Held { column, joint, value: *value, why: Why::OneWay });
            }
        }
        let offsets = bounded.columns();
        for rows in rows.iter_mut() {
            rows.take_out(&offsets);
        }
        if !robot.model.structure.load_friction {
            return Ok(bounded);
        }
        loop {
            let values = solve(&Equations::new(rows), &bounded.nominal)?;
            let beyond = |column: usize| match robot.base.parameter(&robot.model, column) {
                // What is said of a joint that stands, the robot file says.
                Parameter::LoadFriction(joint)
                    if rows.iter().any(|r| r.count(joint) > 0)
                        && bounded.held.iter().all(|held| held.column != column) =>
                {
                    let found = values[column];
                    let hold = Held { column, joint, value: 0.0, why: Why::Impossible(found) };
                    (!SHARE.contains(&found)).then_some(hold)
                }
                _ => None,
            };
            let beyond: Vec<Held> = (0..values.len()).filter_map(beyond).collect();
            if beyond.is_empty() {
                let mut values = values;
                bounded.columns().into_iter().for_each(|(column, value)| values[column] = value);
                bounded.values = Some(values);
                return Ok(bounded);
            }
            let columns: Vec<(usize, f64)> = beyond.iter().map(|held| (held.column, held.value)).collect();
            for rows in rows.iter_mut() {
                rows.take_out(&columns);
            }
            for &(column, value) in &columns {
                bounded.nominal[column] = value;
            }
            bounded.held.extend(beyond);
        }
    }

    fn columns(&self) -> Vec<(usize, f64)> {
        self.held.iter().map(|held| (held.column, held.value)).collect()
    }

    /// Says so of a fit.
    pub(crate) fn hold(&self, fit: &mut Fit) {
        fit.hold(&self.columns());
    }

    /// Says so to people.
    pub(crate) fn distrusts(&self, robot: &Robot) -> impl Iterator<Item = Distrust> {
        let distrust_of = |held: &Held| {
            let (name, text) = match held.why {
                Why::Impossible(found) => (
                    "load_friction_impossible",
                    format!(
                        "friction with load was estimated as {} N m per N m carried, outside of 0 to 1: these logs \
                         do not identify it (a joint with hardly any load shows none). It is fixed at 0, and \
                         everything else is estimated without it",
                        number(found, 3)
                    ),
                ),
                Why::OneWay => (
                    ONE_WAY_NAME,
                    "turns one way only, so Coulomb friction and a constant torque are confounded: the offset stays \
                     nominal, and the Coulomb friction includes it. Record motion in both directions to separate them"
                        .to_owned(),
                ),
            };
            Distrust { log: None, joint: Some(robot.model.arm.joints[held.joint].name.clone()), name, text }
        };
        self.held.iter().map(distrust_of)
    }
}
