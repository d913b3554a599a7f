//! What the flight record holds of a sample, and when the loop asks for one.

use crate::core::Core;
use rivet_config::Robot;
use rivet_dynamics::MAX_JOINTS;
use rivet_ipc_schema::{InputFault, JointState, MAX_PARAMETERS, Setpoint};
use rivet_service::{Flight, RECORDED, Reason};
use std::path::Path;
use std::sync::Arc;

/// Samples after which a fault that has begun is recorded: what led to it and what it looks like.
const FAULT_SAMPLES: u64 = RECORDED as u64 / 2;
/// Samples between two records of faults: what keeps coming back must not wear out the disk.
const REST_SAMPLES: u64 = 60_000;

/// The record of the daemon of `robot`, in `folder`.
pub(crate) fn flight(folder: &Path, robot: &Robot) -> Flight {
    let n = robot.dof();
    let columns = [
        ("q", n),
        ("tau", n),
        ("q_des", n),
        ("qd_des", n),
        ("qdd_des", n),
        ("input_fault", 1),
        ("load_level", 1),
        ("updates", 1),
        ("residual_rms", n),
        ("parameter", robot.base.len().min(MAX_PARAMETERS)),
    ];
    Flight::new(folder, &format!("{}.rivetd", robot.config.name), &columns)
}

/// The loop's side of the record.
#[derive(Debug)]
pub(crate) struct Recorder {
    flight: Option<Arc<Flight>>,
    joints: usize,
    before: InputFault,
    /// Samples until what has begun is recorded.
    due: Option<u64>,
    /// Samples since the last record of a fault.
    since: u64,
}

impl Recorder {
    pub(crate) fn new(flight: Option<Arc<Flight>>, joints: usize) -> Recorder {
        Recorder { flight, joints, before: InputFault::None, due: None, since: REST_SAMPLES }
    }

    /// Takes in a sample, whatever became of it, and what `core` knows after it. Real-time safe.
    pub(crate) fn sample(&mut self, core: &Core, sample: &JointState, setpoint: Option<&Setpoint>) {
        let Some(flight) = &self.flight else { return };
        let fault = core.input_fault();
        let estimate = core.estimate();
        // Without a plan the arm was to stay where it was.
        let still = [0.0; MAX_JOINTS];
        let plan = setpoint.map_or([&sample.q, &still, &still], |plan| [&plan.q, &plan.qd, &plan.qdd]);
        let state = [f64::from(fault as u32), f64::from(core.load_level() as u32), estimate.updates as f64];
        let measured = [&sample.q, &sample.tau, plan[0], plan[1], plan[2]];
        let numbers = measured.into_iter().flat_map(|values| &values[..self.joints]).chain(&state);
        let known = estimate.residual_rms.iter().chain(estimate.values);
        flight.push(sample.stamp_ns, sample.seq, sample.faults, numbers.chain(known).copied());
        self.since = self.since.saturating_add(1);
        if fault != InputFault::None && self.before == InputFault::None && self.since >= REST_SAMPLES {
            self.due = Some(FAULT_SAMPLES);
            self.since = 0;
        }
        self.before = fault;
        if let Some(due) = &mut self.due {
            *due -= 1;
            if *due == 0 {
                self.due = None;
                flight.ask(Reason::Fault);
            }
        }
    }

    /// The samples have stopped. Real-time safe.
    pub(crate) fn gone(&mut self) {
        if let Some(flight) = &self.flight
            && (self.due.take().is_some() || self.since >= REST_SAMPLES)
        {
            self.since = 0;
            flight.ask(Reason::Fault);
        }
    }
}
