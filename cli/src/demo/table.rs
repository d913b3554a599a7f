//! The table at the end: what was identified, and what it was good for.

use super::Received;
use rivet_analysis::true_values::{GROUPS, Reference};
use rivet_config::Robot;
use rivet_dynamics::ParameterGroup;
use rivet_ipc_schema::{Health, ParameterState};
use serde_json::{Value, json};
use std::fmt::{self, Write as _};

/// Everything the demonstration promises, and whether it held.
pub(crate) struct Table<'a> {
    pub(crate) robot: &'a Robot,
    pub(crate) reference: &'a Reference,
    /// Of the run on the robot file and on identified parameters.
    pub(crate) first: &'a Received,
    /// Of the run on the patched model; none where nothing was patched.
    pub(crate) adopted: Option<&'a Received>,
}

impl Table<'_> {
    /// Torque residual of all joints, each in units of its torque limit \[%\]: with the robot file, identified, patched. A figure
    /// that is missing is not a number.
    fn torque(&self) -> [f64; 3] {
        let limits = &self.robot.config.drive.torque_limit;
        let over = |rms: &[f64]| {
            let square: f64 = rms.iter().zip(limits).map(|(r, limit)| (r / limit).powi(2)).sum();
            100.0 * (square / limits.len() as f64).sqrt()
        };
        let share = |health: Option<&Health>, rms: fn(&Health) -> &[f64]| health.map_or(f64::NAN, |h| over(rms(h)));
        let (first, adopted) = (self.first.health.as_ref(), self.adopted.and_then(|run| run.health.as_ref()));
        // The values of the patched file are the nominal ones of its own run.
        [
            share(first, |h| &h.nominal_residual_rms),
            share(first, |h| &h.residual_rms),
            share(adopted, |h| &h.nominal_residual_rms),
        ]
    }

    /// Tracking error of all joints \[mrad\], as [`torque`](Self::torque).
    fn tracking(&self) -> [f64; 3] {
        let patched = self.adopted.map_or(f64::NAN, |run| run.tracking.rms_all(0));
        [self.first.tracking.rms_all(0), self.first.tracking.rms_all(1), patched].map(|rms| 1e3 * rms)
    }

    fn parameter_errors(&self) -> Option<(f64, f64)> {
        let p = self.first.parameters.as_ref()?;
        let before = *self.reference.errors(&self.robot.nominal_base).last()?;
        let after = *self.reference.errors(&p.values[..p.len()]).last()?;
        Some((before, after))
    }

    /// Whether the identified values bring torque error and parameter error down, the patched model torque error and tracking error,
    /// and no sample was lost. A figure that is missing is a failure.
    pub(crate) fn improved(&self) -> bool {
        let [torque, torque_identified, torque_patched] = self.torque();
        let [tracking, _, tracking_patched] = self.tracking();
        torque_identified < torque
            && torque_patched < torque
            && tracking_patched < tracking
            && self.parameter_errors().is_some_and(|(before, after)| after < before)
            && self.first.health.is_some_and(|health| health.lost == 0)
    }

    /// The figures of the table as JSON; null where a run is missing.
    pub(crate) fn to_json(&self) -> Value {
        let models = |[robot_file, identified, patched]: [f64; 3]| json!({ "robot_file": robot_file, "identified": identified, "patched": patched });
        let parameters = self
            .parameter_errors()
            .map(|(robot_file, identified)| json!({ "robot_file": robot_file, "identified": identified }));
        json!({
            "robot": self.robot.config.name, "torque_error_percent": models(self.torque()),
            "tracking_error_mrad": models(self.tracking()), "parameter_error_percent": parameters,
            "lost": self.first.health.map(|health| health.lost), "is_improved": self.improved(),
        })
    }

    /// Tracking error of each joint, then every friction, rotor and offset parameter: robot file, truth, estimate and its standard
    /// deviation.
    pub(crate) fn details(&self) -> String {
        let mut text = String::new();
        // Writing to a string cannot fail, here and below.
        let _ = writeln!(
            text,
            "{:<34} {:>12} {:>12} {:>12}",
            "tracking error, rms [mrad]", "robot file", "identified", "patched"
        );
        for (j, joint) in self.robot.model.arm.joints.iter().enumerate() {
            let [before, after] = [0, 1].map(|phase| 1e3 * self.first.tracking.rms(phase, j));
            let patched = self.adopted.map_or(f64::NAN, |run| 1e3 * run.tracking.rms(0, j));
            let _ = writeln!(text, "  {:<32} {before:>12.3} {after:>12.3} {patched:>12.3}", joint.name);
        }
        let _ = self.write_parameters(&mut text);
        text
    }

    fn write_parameters(&self, f: &mut impl fmt::Write) -> fmt::Result {
        let Some(p) = &self.first.parameters else {
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
        let Some(p) = &self.first.parameters else {
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

/// By how much the first is more than the second \[%\].
fn more(first: f64, second: f64) -> f64 {
    100.0 * (first / second - 1.0)
}

impl fmt::Display for Table<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(p) = &self.first.parameters {
            writeln!(f, "{:<34} {:>12} {:>12}", "torque error from parameters [%]", "robot file", "identified")?;
            let (before, after) =
                (self.reference.errors(&self.robot.nominal_base), self.reference.errors(&p.values[..p.len()]));
            for (g, (_, name)) in GROUPS.iter().enumerate().filter(|(g, _)| self.reference.has(*g)) {
                writeln!(f, "  {:<32} {:>12.3} {:>12.3}", name, before[g], after[g])?;
            }
            let all = before.len() - 1;
            writeln!(f, "  {:<32} {:>12.3} {:>12.3}", "all together", before[all], after[all])?;
        }
        writeln!(f, "{:<34} {:>12} {:>12} {:>12}", "with", "robot file", "identified", "patched")?;
        for (what, figures) in
            [("torque error, rms [% of limits]", self.torque()), ("tracking error, rms [mrad]", self.tracking())]
        {
            write!(f, "{what:<34}")?;
            for figure in figures {
                let text = if figure.is_finite() { format!("{figure:.3}") } else { "-".to_owned() };
                write!(f, " {text:>12}")?;
            }
            writeln!(f)?;
        }
        self.write_coverage(f)?;
        let verdict = if self.improved() { "improved" } else { "NOT improved" };
        write!(f, "compared with the robot file: torque, tracking and parameter error {verdict}")?;
        if self.adopted.is_some() {
            let [torque, tracking] =
                [self.torque(), self.tracking()].map(|[_, identified, patched]| more(patched, identified));
            write!(
                f,
                "\npatched compared with identified: torque error {torque:+.0} %, tracking error {tracking:+.0} %"
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rivet_ipc_schema::{JointState, Setpoint};
    use rivet_studies::phase_tracking::Tracking;

    /// A run whose phases have these tracking errors \[rad\] and whose residuals are these \[N m\], nominal and now.
    fn run(dof: usize, errors: &[f64], [nominal, now]: [f64; 2]) -> Received {
        let mut tracking = Tracking::new(dof, (1..=errors.len() as u64).map(|k| k..k + 1).collect());
        for (seq, error) in (1..).zip(errors) {
            let mut setpoint = Setpoint { seq, ..Setpoint::default() };
            setpoint.q[..dof].fill(*error);
            tracking.setpoint(&setpoint);
            tracking.state(&JointState { seq, ..JointState::default() });
        }
        let mut health = Health::default();
        health.nominal_residual_rms.fill(nominal);
        health.residual_rms.fill(now);
        Received { tracking, parameters: None, health: Some(health), samples: 0 }
    }

    #[test]
    fn says_what_is_compared_with_what() {
        let folder = tempfile::tempdir().expect("a folder");
        let robot = rivet_config::load(crate::demo::unpack(folder.path()).expect("the built-in robot")).expect("sound");
        let reference = Reference::new(&robot, robot.nominal_base.clone());
        let first = run(robot.dof(), &[8e-3, 2e-3], [10.0, 1.0]);
        let adopted = run(robot.dof(), &[2.5e-3], [0.5, 0.1]);
        let table = Table { robot: &robot, reference: &reference, first: &first, adopted: Some(&adopted) };
        let text = table.to_string();
        assert!(
            text.contains("compared with the robot file: torque, tracking and parameter error NOT improved"),
            "{text}"
        );
        assert!(
            text.ends_with("patched compared with identified: torque error -50 %, tracking error +25 %"),
            "a patched model that tracks worse is called that:\n{text}"
        );
        let value = table.to_json();
        assert!((value["tracking_error_mrad"]["patched"].as_f64().expect("a number") - 2.5).abs() < 1e-9, "{value}");
        assert_eq!((&value["is_improved"], &value["parameter_error_percent"]), (&false.into(), &Value::Null));
        let alone = Table { adopted: None, ..table };
        assert!(
            !alone.to_string().contains("patched compared")
                && alone.to_json()["torque_error_percent"]["patched"].is_null()
        );
    }
}
