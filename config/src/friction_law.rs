//! The same robot with another law of friction, or another estimator: what data may choose.

use std::sync::Arc;

use rivet_dynamics::{BaseError, BaseSet, Model, Structure, model_hash};
use rivet_estimation::EstimatorKind;

use crate::load::Robot;
use crate::reader::{Origin, Value};
use crate::sections::RobotConfig;

/// Which friction the model of a robot has, beyond a Coulomb and a viscous parameter each joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrictionLaw {
    /// `signal.friction_velocity` \[rad/s\]; without meaning where there is a presliding travel.
    pub sign_velocity: f64,
    /// `friction.presliding_travel` \[rad\]; 0 is friction without memory.
    pub presliding_travel: f64,
    /// Whether there is `friction.load_dependent`.
    pub load_dependent: bool,
    /// Whether there is `friction.viscous_quadratic`.
    pub viscous_quadratic: bool,
}

impl Robot {
    /// The robot with instrumental variables or with least squares, on torques.
    #[must_use]
    pub fn with_instruments(&self, instruments: bool) -> Robot {
        let mut robot = self.clone();
        let (kind, text) = if instruments { (EstimatorKind::Riv, "riv") } else { (EstimatorKind::Rls, "rls") };
        robot.config.estimator.kind = kind;
        let value = Value::Text(text.to_owned());
        for resolved in robot.config.resolved.iter_mut().filter(|r| r.key.path() == "estimator.kind") {
            if resolved.value != value {
                (resolved.value, resolved.origin) = (value.clone(), Origin::Chosen);
            }
        }
        robot
    }

    /// The law of friction of this robot's model.
    pub fn friction_law(&self) -> FrictionLaw {
        let structure = &self.model.structure;
        FrictionLaw {
            sign_velocity: structure.sign_velocity,
            presliding_travel: structure.presliding_travel,
            load_dependent: structure.load_friction,
            viscous_quadratic: structure.viscous_quadratic,
        }
    }

    /// The robot with another law; values that the file has no opinion on are zero, identified parameters are dropped.
    ///
    /// # Errors
    /// When the regressor of the new model is not finite.
    pub fn with_friction_law(&self, law: FrictionLaw) -> Result<Robot, BaseError> {
        let mut config = self.config.clone();
        let zeros = || vec![0.0; self.dof()];
        config.signal.friction_velocity = law.sign_velocity;
        let friction = &mut config.friction;
        friction.presliding_travel = law.presliding_travel;
        friction.load_dependent = law.load_dependent.then(|| friction.load_dependent.take().unwrap_or_else(zeros));
        friction.viscous_quadratic =
            law.viscous_quadratic.then(|| friction.viscous_quadratic.take().unwrap_or_else(zeros));
        let numbers = |given: &Option<Vec<f64>>| given.clone().map_or(Value::Absent, Value::Numbers);
        for resolved in &mut config.resolved {
            let value = match resolved.key.path().as_str() {
                "signal.friction_velocity" => Value::Number(law.sign_velocity),
                "friction.presliding_travel" => Value::Number(law.presliding_travel),
                "friction.load_dependent" => numbers(&friction.load_dependent),
                "friction.viscous_quadratic" => numbers(&friction.viscous_quadratic),
                _ => continue,
            };
            if resolved.value != value {
                (resolved.value, resolved.origin) = (value, Origin::Chosen);
            }
        }
        let structure = Structure {
            sign_velocity: law.sign_velocity,
            presliding_travel: law.presliding_travel,
            load_friction: law.load_dependent,
            viscous_quadratic: law.viscous_quadratic,
            ..self.model.structure
        };
        self.rebuilt(config, structure)
    }

    /// The robot with another structure of its drives; `config` agrees with it. Identified parameters are dropped. Base parameters are
    /// those of the file's gravity, also of an arm that is compared with torque without gravity.
    pub(crate) fn rebuilt(&self, config: RobotConfig, structure: Structure) -> Result<Robot, BaseError> {
        let mut arm = self.model.arm.clone();
        let gravity = arm.gravity;
        if gravity == [0.0; 3] {
            arm.gravity = config.gravity;
        }
        let mut model = Model::new(arm, structure)
            .with_load(self.model.load().to_vec())
            .with_unknown_bodies(self.model.unknown_bodies().to_vec())
            .with_effects(self.model.effects().clone());
        let base = BaseSet::new(&model)?;
        let hash = model_hash(&model, &base);
        model.arm.gravity = gravity;
        let nominal = model.nominal(&config.nominal_joints());
        let nominal_base = base.from_standard(&nominal);
        Ok(Robot {
            config,
            model: Arc::new(model),
            base: Arc::new(base),
            hash,
            nominal,
            nominal_base,
            identified: None,
            not_excited: String::new(),
            description: self.description.clone(),
        })
    }
}
