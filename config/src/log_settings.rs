//! The same robot with what its file leaves open, chosen from a log: torque offsets and the model filter.

use rivet_dynamics::{BaseError, Structure};

use crate::load::Robot;
use crate::reader::{Origin, Value};

impl Robot {
    /// Whether the robot file has the key at `path`, such as `"signal.model_filter_hz"`.
    pub fn has_key(&self, path: &str) -> bool {
        self.config.resolved.iter().any(|r| r.key.path() == path && matches!(r.origin, Origin::Line(_)))
    }

    /// The robot with a constant torque per joint among its parameters. Values that the file does not give are 0; identified
    /// parameters are dropped.
    ///
    /// # Errors
    /// When the regressor of the new model is not finite.
    pub fn with_offsets(&self) -> Result<Robot, BaseError> {
        let mut config = self.config.clone();
        config.estimator.offsets = true;
        let structure = Structure { offset: true, ..self.model.structure };
        let mut robot = self.rebuilt(config, structure)?;
        robot.choose("estimator.offsets", &Value::Bool(true));
        Ok(robot)
    }

    /// The robot with another model filter.
    ///
    /// * `cutoff_hz`: `signal.model_filter_hz` \[Hz\]
    /// * `decimation`: `signal.decimation`, in samples of the robot file
    #[must_use]
    pub fn with_model_filter(&self, cutoff_hz: f64, decimation: usize) -> Robot {
        let mut robot = self.clone();
        robot.config.signal.model_filter_hz = cutoff_hz;
        robot.config.signal.decimation = decimation;
        robot.choose("signal.model_filter_hz", &Value::Number(cutoff_hz));
        robot.choose("signal.decimation", &Value::Integer(i64::try_from(decimation).unwrap_or(i64::MAX)));
        robot
    }

    fn choose(&mut self, path: &str, value: &Value) {
        for resolved in self.config.resolved.iter_mut().filter(|r| r.key.path() == path) {
            if resolved.value != *value {
                (resolved.value, resolved.origin) = (value.clone(), Origin::Chosen);
            }
        }
    }
}
