//! What comes in: joint states, setpoints and second encoders, put together by their sequence numbers.

use rivet_ipc_schema::{Bus, BusError, JointState, LinkState, OneSource, Setpoint};
use std::time::Duration;

/// Silence of the publisher that is heard after which another one may take its place while it is still listed.
const SUCCESSION: Duration = Duration::from_secs(1);

/// Samples, with the setpoint and the second encoders of their period.
pub(crate) struct Streams {
    /// The arm's state.
    states: OneSource<JointState>,
    setpoints: OneSource<Setpoint>,
    links: OneSource<LinkState>,
    /// A setpoint, and second encoders, that came before their sample.
    pending: Option<Setpoint>,
    pending_link: Option<LinkState>,
}

impl Streams {
    /// Opens the ports on the calling thread, which is the one to read them.
    pub(crate) fn open(bus: &Bus) -> Result<Streams, BusError> {
        Ok(Streams {
            states: OneSource::new(bus.joint_state_subscriber()?, SUCCESSION),
            setpoints: OneSource::new(bus.setpoint_subscriber()?, SUCCESSION),
            links: OneSource::new(bus.link_state_subscriber()?, SUCCESSION),
            pending: None,
            pending_link: None,
        })
    }

    /// Publishers of joint states that are there at present.
    pub(crate) fn publishers(&self) -> usize {
        self.states.publishers()
    }

    /// The oldest sample not yet taken, and the setpoint and second encoders of its period if they have come. They are
    /// published before their sample, so they are there when the sample is. Bounded by their rings. Of each, one publisher is
    /// heard.
    pub(crate) fn next(&mut self, now_ns: u64) -> Option<(JointState, Option<Setpoint>, Option<LinkState>)> {
        let before = self.states.source();
        // A port that fails has no sample; the publisher's absence shows in the health message.
        let state = self.states.receive(now_ns).ok().flatten()?;
        if before.is_some() && before != self.states.source() {
            self.pending = None;
            self.pending_link = None;
        }
        Some(self.with_plan(state, now_ns))
    }

    /// Messages of second publishers so far.
    pub(crate) fn foreign(&self) -> u64 {
        self.states.foreign() + self.setpoints.foreign() + self.links.foreign()
    }

    fn with_plan(&mut self, state: JointState, now_ns: u64) -> (JointState, Option<Setpoint>, Option<LinkState>) {
        // Nothing is planned further ahead than a ring holds: such a number is of another run of the planner, or none, and
        // would stand in the way of all that follow.
        let near = |seq: u64, ring: usize| seq >= state.seq && seq - state.seq <= ring as u64;
        let rings = (self.setpoints.capacity(), self.links.capacity());
        self.pending = self.pending.filter(|setpoint| near(setpoint.seq, rings.0));
        self.pending_link = self.pending_link.filter(|link| near(link.seq, rings.1));
        for _ in 0..self.setpoints.capacity() {
            if self.pending.is_some_and(|setpoint| setpoint.seq >= state.seq) {
                break;
            }
            match self.setpoints.receive(now_ns) {
                Ok(Some(setpoint)) => self.pending = Some(setpoint),
                _ => break,
            }
        }
        for _ in 0..self.links.capacity() {
            if self.pending_link.is_some_and(|link| link.seq >= state.seq) {
                break;
            }
            match self.links.receive(now_ns) {
                Ok(Some(link)) => self.pending_link = Some(link),
                _ => break,
            }
        }
        let setpoint = self.pending.filter(|setpoint| setpoint.seq == state.seq);
        (state, setpoint, self.pending_link.filter(|link| link.seq == state.seq))
    }
}
