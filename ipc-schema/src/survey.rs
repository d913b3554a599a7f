//! Who is on a bus, and what lies there that should not: looked at without touching what lives.

use iceoryx2::node::{Node, NodeState, NodeView as _};
use iceoryx2::prelude::{CallbackProgression, ServiceName, ipc};

use crate::bus_config::BusConfig;
use crate::cleanup::remove_half_made_memory;
use crate::error::{BusError, VersionMismatch};
use crate::messages::{
    ConsistentParameters, ControllerHealth, Drift, Health, JointState, LinkState, Message, Parameters, Setpoint, Timing,
};
use crate::name::RobotName;
use crate::owner::cannot_join;
use crate::service::Service;
use crate::version;

/// What was found.
#[derive(Debug, Default)]
pub struct Survey {
    /// Parties that are alive, by the names that they gave.
    pub alive: Vec<String>,
    /// Parties that died and left their resources.
    pub dead: usize,
    /// Parties of another user.
    pub inaccessible: usize,
    /// Services of the robot's that carry what another program, or another version, means by their name.
    pub foreign: Vec<VersionMismatch>,
}

/// Looks at the bus of `robot`. Nothing is opened, and nothing removed but memory whose maker was killed on the way: who reads the
/// description of its service would wait for it for ever.
///
/// # Errors
/// Values that break a rule, or a bus that cannot be listed.
pub fn survey(config: &BusConfig, robot: &RobotName) -> Result<Survey, BusError> {
    let iceoryx = config.iceoryx()?;
    let mut found = Survey::default();
    let listed = Node::<ipc::Service>::list(&iceoryx, |state| {
        match state {
            NodeState::Alive(view) => {
                let name = view.details().as_ref().map(|details| details.name().to_string());
                found.alive.push(name.unwrap_or_else(|| "?".to_owned()));
            }
            NodeState::Dead(_) => found.dead += 1,
            NodeState::Inaccessible(_) => found.inaccessible += 1,
            NodeState::Undefined(_) => {}
        }
        CallbackProgression::Continue
    });
    listed.map_err(|e| cannot_join(config, &e))?;
    if remove_half_made_memory(config).is_err() {
        // Another user's: his next process removes it.
        return Ok(found);
    }
    let mut look = |service: Service, mismatch: &dyn Fn(&str, &str) -> VersionMismatch, expected: &str| {
        let name = robot.service_name(service);
        if let Ok(full) = ServiceName::new(&name)
            && let Some(carried) = version::pubsub_type(&iceoryx, &full)
            && carried != expected
        {
            found.foreign.push(mismatch(&name, &carried));
        }
    };
    look(Service::JointState, &version::mismatch::<JointState>, JointState::TYPE_NAME);
    look(Service::Setpoint, &version::mismatch::<Setpoint>, Setpoint::TYPE_NAME);
    look(Service::LinkState, &version::mismatch::<LinkState>, LinkState::TYPE_NAME);
    look(Service::Parameters, &version::mismatch::<Parameters>, Parameters::TYPE_NAME);
    look(Service::ParametersConsistent, &version::mismatch::<ConsistentParameters>, ConsistentParameters::TYPE_NAME);
    look(Service::Health, &version::mismatch::<Health>, Health::TYPE_NAME);
    look(Service::Timing, &version::mismatch::<Timing>, Timing::TYPE_NAME);
    look(Service::Drift, &version::mismatch::<Drift>, Drift::TYPE_NAME);
    look(Service::ControllerHealth, &version::mismatch::<ControllerHealth>, ControllerHealth::TYPE_NAME);
    Ok(found)
}
