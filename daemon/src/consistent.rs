//! Physically consistent parameters beside the estimated ones: a thread that is not real-time.

use crate::context::ThreadContext;
use rivet_config::Robot;
use rivet_dynamics::{BaseSet, Model};
use rivet_estimation::consistency::{ConsistencyError, Reference, project_torque};
use rivet_ipc_schema::{BODY_VALUES, Bus, ConsistentParameters, Parameters};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// The latest estimated set, from the bus thread to this one; neither is real-time.
#[derive(Debug, Default)]
pub(crate) struct Waiting(Mutex<Option<Parameters>>);

impl Waiting {
    pub(crate) fn put(&self, set: &Parameters) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(*set);
    }

    fn take(&self) -> Option<Parameters> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

/// Finds the arm that can be built nearest to an estimated set: the one that makes nearly the same torque on the arm's
/// reference workload. A pure function of the set.
#[derive(Clone, Debug)]
pub struct Projector {
    model: Arc<Model>,
    base: Arc<BaseSet>,
    nominal: Vec<f64>,
    reference: Reference,
}

impl Projector {
    /// Evaluates the reference workload.
    #[must_use]
    pub fn new(robot: &Robot) -> Projector {
        Projector {
            model: Arc::clone(&robot.model),
            base: Arc::clone(&robot.base),
            nominal: robot.nominal.clone(),
            reference: Reference::workload(&robot.model, &robot.base, &robot.nominal_base),
        }
    }

    /// Projects one set.
    ///
    /// # Errors
    /// A set of another size, or without an arm near it; see [`ConsistencyError`].
    pub fn project(&self, set: &Parameters) -> Result<ConsistentParameters, ConsistencyError> {
        let values = &set.values[..set.len()];
        let reference = self.reference.clone().with_torque_of(values);
        let found = project_torque(&self.model, &self.base, values, &self.nominal, &reference)?;
        let mut out = ConsistentParameters::of(set);
        out.values[..found.base.len()].copy_from_slice(&found.base);
        let dof = self.model.arm.dof();
        let bodies = self.model.places().bodies().end.min(BODY_VALUES);
        out.bodies[..bodies].copy_from_slice(&found.standard[..bodies]);
        out.torque_rms[..dof].copy_from_slice(&found.torque_rms);
        out.torque_percent = found.torque_percent;
        out.smallest_eigenvalue = found.smallest_eigenvalue;
        Ok(out)
    }
}

/// Subscribers that join are served at least this often.
const REFRESH: Duration = Duration::from_millis(10);

/// Projects the latest set every `period` and publishes the result, until shut down.
pub(crate) fn run(context: &ThreadContext, projector: &Projector, period: Duration, waiting: &Waiting) {
    let opened = Bus::open(&context.bus, &context.name, "rivetd-consistent")
        .and_then(|bus| bus.consistent_parameters_publisher().map(|publisher| (bus, publisher)));
    let (_bus, publisher) = match opened {
        Ok(opened) => {
            context.report_ready();
            opened
        }
        Err(why) => {
            context.report_failure(why);
            return;
        }
    };
    let mut complained = false;
    let mut next = Instant::now();
    while !context.shutdown.is_requested() {
        let now = Instant::now();
        let mut result = publisher.refresh().map_err(|e| e.to_string());
        if now >= next
            && let Some(set) = waiting.take()
        {
            // What could not be kept up with is left out, never made up for.
            next = now + period;
            result = match projector.project(&set) {
                Ok(found) => publisher.send(&found).map(|_| ()).map_err(|e| e.to_string()),
                Err(why) => Err(why.to_string()),
            };
        }
        if let Err(why) = result
            && !complained
        {
            complained = true;
            log::warn!("no physically consistent parameters: {why} (reported once)");
        }
        std::thread::sleep(REFRESH);
    }
}
