//! What follows from the messages of the bus: residual torque, friction curves, bands of parameters, states in words, a log.

use rivet_config::Robot;
use rivet_estimation::SettingsError;
use rivet_ipc_schema::Parameters;

use crate::bands::Bands;
use crate::events::Events;
use crate::friction::Friction;
use crate::message::{Content, Received};
use crate::residuals::Residuals;
use crate::states::{ABSENT, SILENT, States};

/// Time between two friction curves, and two bands, at least \[ns\].
const PARAMETERS_EVERY_NS: u64 = 500_000_000;
/// Time between two messages of states at least \[ns\].
const STATES_LEAST_NS: u64 = 100_000_000;
/// The same at most: states that stay are repeated.
const STATES_MOST_NS: u64 = 1_000_000_000;
/// Time without a report after which a process is silent, at least \[ns\].
const SILENCE_NS: u64 = 3_000_000_000;

/// Computes what follows from the messages of one robot.
#[derive(Debug)]
pub struct Derived {
    joints: Vec<String>,
    model_hash: u64,
    to_utc_ns: i64,
    residuals: Residuals,
    friction: Friction,
    bands: Bands,
    states: States,
    events: Events,
    /// The newest set of parameters that is not shown yet.
    waiting: Option<Box<Parameters>>,
    is_other_model: bool,
    silence_ns: u64,
    /// Times of the last messages \[ns\].
    shown_parameters_ns: Option<u64>,
    shown_states: Option<States>,
    health_ns: Option<u64>,
    controller_ns: Option<u64>,
}

impl Derived {
    /// Computes for `robot`; `to_utc_ns`: added to `CLOCK_MONOTONIC` \[ns\], to give nanoseconds since 1970.
    ///
    /// # Errors
    /// A setting of the estimator that cannot be used with this arm.
    pub fn new(robot: &Robot, to_utc_ns: i64) -> Result<Derived, SettingsError> {
        let between_s = robot.config.publish.health_every as f64 * robot.config.sample_period_s;
        Ok(Derived {
            joints: robot.model.arm.joints.iter().map(|joint| joint.name.clone()).collect(),
            model_hash: robot.hash,
            to_utc_ns,
            residuals: Residuals::new(robot)?,
            friction: Friction::new(robot),
            bands: Bands::new(robot),
            states: States::new(),
            events: Events::new(),
            waiting: None,
            is_other_model: false,
            silence_ns: SILENCE_NS.max((2.5e9 * between_s) as u64),
            shown_parameters_ns: None,
            shown_states: None,
            health_ns: None,
            controller_ns: None,
        })
    }

    /// Takes in a message; passes what follows from it to `give`.
    pub fn take(&mut self, received: &Received, give: &mut impl FnMut(Received)) {
        let at_ns = received.at_ns;
        match &received.content {
            Content::JointState(state) => {
                if let Some(residual) = self.residuals.take(state) {
                    give(Received { at_ns, content: Content::Residual(Box::new(residual)) });
                }
            }
            Content::Parameters(set) => {
                let is_other = set.model_hash != self.model_hash || set.len() != self.bands.len();
                if is_other && !self.is_other_model {
                    let text = "parameters are of another model than this robot file's, and not shown";
                    self.events.warn(text.to_owned());
                }
                self.is_other_model = is_other;
                if !is_other {
                    self.residuals.use_parameters(set);
                    self.waiting = Some(set.clone());
                }
            }
            Content::Health(health) => {
                self.health_ns = Some(at_ns);
                self.states.take_health(&self.joints, health);
            }
            Content::Drift(drift) => self.states.take_drift(&self.joints, drift),
            Content::ControllerHealth(health) => {
                self.controller_ns = Some(at_ns);
                self.states.take_controller(&self.joints, health);
                self.events.take_controller(&self.joints, health);
            }
            _ => {}
        }
    }

    /// Passes what is due at `now_ns` (`CLOCK_MONOTONIC` \[ns\]) to `give`: call it at each look at the bus.
    pub fn turn(&mut self, now_ns: u64, give: &mut impl FnMut(Received)) {
        let is_silent = |heard: Option<u64>| heard.is_some_and(|at| now_ns.saturating_sub(at) > self.silence_ns);
        if is_silent(self.health_ns) {
            SILENT.clone_into(&mut self.states.daemon);
        }
        if is_silent(self.controller_ns) {
            SILENT.clone_into(&mut self.states.controller);
        }
        self.events.take_states(&self.states);
        let mut give = |content| give(Received { at_ns: now_ns, content });
        for line in self.events.drain(now_ns.saturating_add_signed(self.to_utc_ns)) {
            give(Content::LogLine(Box::new(line), now_ns));
        }
        let is_due = |last: Option<u64>, every: u64| last.is_none_or(|last| now_ns.saturating_sub(last) >= every);
        if is_due(self.shown_parameters_ns, PARAMETERS_EVERY_NS)
            && let Some(set) = self.waiting.take()
        {
            self.shown_parameters_ns = Some(now_ns);
            give(Content::FrictionCurves(Box::new(self.friction.curves(&set))));
            give(Content::ParameterBands(Box::new(self.bands.bands(&set))));
        }
        let has_changed = self.shown_states.as_ref().is_none_or(|shown| !shown.is_same(&self.states));
        let every = if has_changed { STATES_LEAST_NS } else { STATES_MOST_NS };
        if is_due(self.shown_states.as_ref().map(|shown| shown.stamp_ns), every) {
            self.states.stamp_ns = now_ns;
            self.shown_states = Some(self.states.clone());
            give(Content::States(Box::new(self.states.clone())));
        }
    }

    /// Whether rivetd reports.
    pub fn has_daemon(&self) -> bool {
        ![ABSENT, SILENT].contains(&self.states.daemon.as_str())
    }
}
