//! What is taken from the bus.

use std::time::Duration;

use rivet_ipc_schema::{
    Bus, BusError, ControllerHealth, Drift, Health, JointState, LinkState, Message, OneSource, Parameters, PortError,
    Setpoint, Subscriber,
};

use crate::message::{Content, Received};

/// Silence of a publisher after which another one is heard in its place.
const SUCCESSION: Duration = Duration::from_secs(1);

/// Subscriptions to everything that is recorded.
#[derive(Debug)]
pub struct Ports {
    joint_states: OneSource<JointState>,
    setpoints: OneSource<Setpoint>,
    link_states: OneSource<LinkState>,
    parameters: Subscriber<Parameters>,
    health: Subscriber<Health>,
    drift: Subscriber<Drift>,
    controller: Subscriber<ControllerHealth>,
}

impl Ports {
    /// Subscribes.
    ///
    /// # Errors
    /// A service is there with other settings or another version, or cannot be opened.
    pub fn open(bus: &Bus) -> Result<Ports, BusError> {
        // Joint states last: who sees them taken finds everything else taken too.
        let setpoints = OneSource::new(bus.setpoint_subscriber()?, SUCCESSION);
        let link_states = OneSource::new(bus.link_state_subscriber()?, SUCCESSION);
        Ok(Ports {
            setpoints,
            link_states,
            parameters: bus.parameters_subscriber()?,
            health: bus.health_subscriber()?,
            drift: bus.drift_subscriber()?,
            controller: bus.controller_health_subscriber()?,
            joint_states: OneSource::new(bus.joint_state_subscriber()?, SUCCESSION),
        })
    }

    /// Passes everything that has come to `take`, at most a ring of each service; `now_ns`: `CLOCK_MONOTONIC` \[ns\].
    /// Setpoints and second encoders come before the joint states of their period, as they are published.
    ///
    /// # Errors
    /// A port's.
    pub fn take(&mut self, now_ns: u64, take: &mut impl FnMut(Received)) -> Result<(), PortError> {
        one_source(&mut self.setpoints, now_ns, Content::Setpoint, take)?;
        one_source(&mut self.link_states, now_ns, Content::LinkState, take)?;
        one_source(&mut self.joint_states, now_ns, Content::JointState, take)?;
        any_source(&self.parameters, now_ns, Content::Parameters, take)?;
        any_source(&self.health, now_ns, Content::Health, take)?;
        any_source(&self.drift, now_ns, Content::Drift, take)?;
        any_source(&self.controller, now_ns, Content::ControllerHealth, take)
    }

    /// Messages of a second publisher, which are left out.
    pub fn foreign(&self) -> u64 {
        self.joint_states.foreign() + self.setpoints.foreign() + self.link_states.foreign()
    }
}

fn one_source<T: Message>(
    port: &mut OneSource<T>,
    at_ns: u64,
    content: fn(Box<T>) -> Content,
    take: &mut impl FnMut(Received),
) -> Result<(), PortError> {
    for _ in 0..port.capacity() {
        let Some(message) = port.receive(at_ns)? else { break };
        take(Received { at_ns, publisher: port.source(), content: content(Box::new(message)) });
    }
    Ok(())
}

fn any_source<T: Message>(
    port: &Subscriber<T>,
    at_ns: u64,
    content: fn(Box<T>) -> Content,
    take: &mut impl FnMut(Received),
) -> Result<(), PortError> {
    for _ in 0..port.capacity() {
        let Some((message, publisher)) = port.receive_from()? else { break };
        take(Received { at_ns, publisher: Some(publisher), content: content(Box::new(message)) });
    }
    Ok(())
}
