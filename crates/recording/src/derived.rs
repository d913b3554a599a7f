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
                    give(Received::derived(at_ns, Content::Residual(Box::new(residual))));
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
            self.states.silence_daemon();
        }
        if is_silent(self.controller_ns) {
            self.states.silence_controller();
        }
        self.events.take_states(&self.states, now_ns);
        let mut give = |content| give(Received::derived(now_ns, content));
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

#[cfg(test)]
mod tests {
    use super::*;
    use rivet_ipc_schema::{ControllerHealth, Drift, Health, JointState, parameter_flags};

    const SECOND_NS: u64 = 1_000_000_000;

    fn derived() -> (Derived, u64, usize) {
        let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../robots/dd2/robot.toml");
        let robot = rivet_config::load(&file).expect("a robot file");
        (Derived::new(&robot, 0).expect("settings"), robot.hash, robot.base.len())
    }

    /// What follows from messages and turns, newest last.
    fn taken(derived: &mut Derived, at_ns: u64, content: Content) -> Vec<Content> {
        let mut found = Vec::new();
        derived.take(&Received::derived(at_ns, content), &mut |follows| found.push(follows.content));
        found
    }

    fn states(derived: &mut Derived, now_ns: u64) -> States {
        let mut latest = None;
        derived.turn(now_ns, &mut |follows| {
            if let Content::States(states) = follows.content {
                latest = Some(*states);
            }
        });
        latest.expect("states are due")
    }

    #[test]
    fn states_of_a_silent_process_are_null_and_a_new_one_is_shown_at_once() {
        let (mut derived, ..) = derived();
        taken(&mut derived, SECOND_NS, Content::Health(Box::new(Health { mode: 1, ..Health::default() })));
        taken(&mut derived, SECOND_NS, Content::Drift(Box::new(Drift { verdict: 1, ..Drift::default() })));
        let controller = ControllerHealth { state: 2, ..ControllerHealth::default() };
        taken(&mut derived, SECOND_NS, Content::ControllerHealth(Box::new(controller)));
        let shown = states(&mut derived, SECOND_NS);
        assert!(shown.drift.is_some() && shown.load.is_some() && shown.stops.is_some(), "{shown:?}");
        // The daemon dies, the controller goes on.
        taken(&mut derived, 20 * SECOND_NS, Content::ControllerHealth(Box::new(controller)));
        let shown = states(&mut derived, 20 * SECOND_NS);
        assert_eq!(
            (shown.daemon.as_str(), &shown.drift, &shown.load, shown.held_parameters),
            (SILENT, &None, &None, None)
        );
        assert!(shown.stops == Some(0) && shown.parameter_source.is_some(), "{shown:?}");
        let shown = states(&mut derived, 40 * SECOND_NS);
        assert_eq!((shown.controller.as_str(), shown.stops, &shown.parameter_source), (SILENT, None, &None));
        taken(&mut derived, 41 * SECOND_NS, Content::Health(Box::new(Health { mode: 1, ..Health::default() })));
        let shown = states(&mut derived, 41 * SECOND_NS);
        assert_eq!((shown.daemon.as_str(), shown.load.is_some(), &shown.drift), ("estimating", true, &None));
    }

    /// A daemon that begins publishes sets with too little data behind them: residuals keep the set before.
    #[test]
    fn residuals_use_no_provisional_parameters() {
        let (mut derived, model_hash, count) = derived();
        let count = u32::try_from(count).expect("a count");
        let mut seq = 0;
        // 0.4 s of motion; the last residual.
        let mut moved = |derived: &mut Derived| {
            let mut latest = None;
            for _ in 0..400 {
                seq += 1;
                let t = seq as f64 * 1e-3;
                let mut state = JointState { seq, stamp_ns: seq * 1_000_000, joints: 2, ..JointState::default() };
                (state.q[0], state.q[1]) = ((5.0 * t).sin(), (7.0 * t).cos());
                for follows in taken(derived, state.stamp_ns, Content::JointState(Box::new(state))) {
                    if let Content::Residual(residual) = follows {
                        latest = Some(*residual);
                    }
                }
            }
            latest.expect("residuals")
        };
        let set = |epoch, flags| {
            let set = Parameters { epoch, flags, model_hash, count, joints: 2, ..Parameters::default() };
            Content::Parameters(Box::new(set))
        };
        taken(&mut derived, 0, set(1, parameter_flags::PROVISIONAL));
        let residual = moved(&mut derived);
        assert!(residual.epoch == 0 && residual.predicted.iter().all(|torque| torque.is_nan()), "{residual:?}");
        assert!(residual.nominal_residual.iter().any(|torque| torque.is_finite()), "{residual:?}");
        taken(&mut derived, 0, set(40, parameter_flags::SUSPENDED));
        let residual = moved(&mut derived);
        assert!(residual.epoch == 40 && residual.predicted.iter().all(|torque| torque.is_finite()), "{residual:?}");
        taken(&mut derived, 0, set(1, parameter_flags::PROVISIONAL | parameter_flags::SUSPENDED));
        assert_eq!(moved(&mut derived).epoch, 40, "the set of the daemon before");
        taken(&mut derived, 0, set(2, 0));
        assert_eq!(moved(&mut derived).epoch, 2);
    }
}
