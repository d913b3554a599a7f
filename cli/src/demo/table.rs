//! The table at the end: what was identified, and what it was good for.

use super::reference::{GROUPS, Reference};
use super::tracking::Tracking;
use rivet_config::Robot;
use rivet_dynamics::ParameterGroup;
use rivet_ipc_schema::{Health, ParameterState, Parameters};
use std::fmt::{self, Write as _};

/// Everything the demonstration promises, and whether it held.
pub(crate) struct Table<'a> {
    robot: &'a Robot,
    reference: &'a Reference,
    tracking: &'a Tracking,
    parameters: Option<&'a Parameters>,
    health: Option<&'a Health>,
}

impl<'a> Table<'a> {
    pub(crate) fn new(
        robot: &'a Robot,
        reference: &'a Reference,
        tracking: &'a Tracking,
        parameters: Option<&'a Parameters>,
        health: Option<&'a Health>,
    ) -> Table<'a> {
        Table { robot, reference, tracking, parameters, health }
    }

    /// Torque residual of all joints, each in units of its torque limit: with nominal and with identified parameters.
    fn torque(&self) -> Option<(f64, f64)> {
        let health = self.health?;
        let limits = &self.robot.config.drive.torque_limit;
        let over = |rms: &[f64]| {
            let square: f64 = rms.iter().zip(limits).map(|(r, limit)| (r / limit).powi(2)).sum();
            100.0 * (square / limits.len() as f64).sqrt()
        };
        Some((over(&health.nominal_residual_rms), over(&health.residual_rms)))
    }

    fn tracking_rms(&self) -> (f64, f64) {
        let dof = self.tracking.dof;
        (1e3 * self.tracking.nominal.rms_all(dof), 1e3 * self.tracking.identified.rms_all(dof))
    }

    fn parameter_errors(&self) -> Option<(f64, f64)> {
        let p = self.parameters?;
        let before = *self.reference.errors(&self.robot.nominal_base).last()?;
        let after = *self.reference.errors(&p.values[..p.len()]).last()?;
        Some((before, after))
    }

    /// Whether torque error, tracking error and parameter error all became smaller, and no sample was lost. A figure
    /// that is missing or not a number is a failure.
    pub(crate) fn improved(&self) -> bool {
        let smaller = |pair: Option<(f64, f64)>| pair.is_some_and(|(before, after)| after < before);
        smaller(self.torque())
            && smaller(Some(self.tracking_rms()))
            && smaller(self.parameter_errors())
            && self.health.is_some_and(|health| health.lost == 0)
    }

    /// Tracking error of each joint, then every friction, rotor and offset parameter: robot file, truth, estimate and its standard
    /// deviation.
    pub(crate) fn details(&self) -> String {
        let mut text = String::new();
        // Writing to a string cannot fail, here and below.
        let _ = writeln!(text, "{:<34} {:>12} {:>12}", "tracking error, rms [mrad]", "robot file", "identified");
        for (j, joint) in self.robot.model.arm.joints.iter().enumerate() {
            let (before, after) = (1e3 * self.tracking.nominal.rms(j), 1e3 * self.tracking.identified.rms(j));
            let _ = writeln!(text, "  {:<32} {before:>12.3} {after:>12.3}", joint.name);
        }
        let _ = self.write_parameters(&mut text);
        text
    }

    fn write_parameters(&self, f: &mut impl fmt::Write) -> fmt::Result {
        let Some(p) = self.parameters else {
            return writeln!(f, "rivetd published no parameters");
        };
        let (model, base) = (&self.robot.model, &self.robot.base);
        writeln!(
            f,
            "{:<18} {:>10} {:>9} {:>10} {:>8} {:>5}  unit",
            "parameter", "robot file", "truth", "identified", "std", "off/σ"
        )?;
        for i in 0..p.len() {
            let parameter = base.parameter(model, i);
            if parameter.group() == ParameterGroup::Inertial {
                continue;
            }
            let (truth, value, std) = (self.reference.truth[i], p.values[i], p.std[i]);
            let is_held = ParameterState::try_from(p.state[i]) != Ok(ParameterState::Active);
            writeln!(
                f,
                "{:<18} {:>10.4} {:>9.4} {:>10.4} {:>8.4} {:>5.1}  {}{}",
                base.name(model, i),
                self.robot.nominal_base[i],
                truth,
                value,
                std,
                (value - truth) / std,
                parameter.unit(&model.arm),
                if is_held { ", held" } else { "" }
            )?;
        }
        Ok(())
    }

    /// One line: how many identified parameters lie within their stated deviation of the truth.
    fn write_coverage(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(p) = self.parameters else {
            return writeln!(f, "rivetd published no parameters");
        };
        let active = (0..p.len()).filter(|&i| ParameterState::try_from(p.state[i]) == Ok(ParameterState::Active));
        let (mut within, mut all) = (0, 0);
        for i in active {
            all += 1;
            within += usize::from((p.values[i] - self.reference.truth[i]).abs() <= 2.0 * p.std[i]);
        }
        writeln!(f, "{within} of {all} active base parameters lie within 2 standard deviations of the truth")
    }
}

impl fmt::Display for Table<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(p) = self.parameters {
            writeln!(f, "{:<34} {:>12} {:>12}", "torque error from parameters [%]", "robot file", "identified")?;
            let (before, after) =
                (self.reference.errors(&self.robot.nominal_base), self.reference.errors(&p.values[..p.len()]));
            for (g, (_, name)) in GROUPS.iter().enumerate().filter(|(g, _)| self.reference.has(*g)) {
                writeln!(f, "  {:<32} {:>12.3} {:>12.3}", name, before[g], after[g])?;
            }
            let all = before.len() - 1;
            writeln!(f, "  {:<32} {:>12.3} {:>12.3}", "all together", before[all], after[all])?;
        }
        writeln!(f, "{:<34} {:>12} {:>12} {:>8}", "with", "robot file", "identified", "ratio")?;
        let mut row = |what: &str, pair: Option<(f64, f64)>| match pair {
            Some((before, after)) => writeln!(f, "{what:<34} {before:>12.3} {after:>12.3} {:>8.3}", after / before),
            None => writeln!(f, "{what:<34} not measured"),
        };
        row("torque error, rms [% of limits]", self.torque())?;
        row("tracking error, rms [mrad]", Some(self.tracking_rms()))?;
        self.write_coverage(f)?;
        let verdict = if self.improved() { "improved" } else { "NOT improved" };
        write!(f, "torque error, tracking error and parameter error: {verdict}")
    }
}
