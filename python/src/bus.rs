//! A robot on the bus: live parameters and health in; samples out, torque in.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use numpy::{PyArray1, PyReadonlyArray1, ToPyArray as _};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rivet::{BusConfig, ControllerHealth, Health, Parameters, Robot, Sample, sample_flags};
use rivet_analysis::fault::Kind;
use rivet_ipc_schema::{
    ControllerState, DaemonMode, InputFault, InstrumentSource, MAX_JOINTS, ParameterState, StopCause, parameter_flags,
    words,
};

use crate::worker::error;

/// One robot's side of the bus.
#[pyclass(frozen, module = "rivet._native")]
pub(crate) struct Bus {
    joints: usize,
    /// None after `close`.
    robot: Mutex<Option<Robot>>,
}

/// A numbered state in words; a number that this version does not know as it is.
fn named<T: TryFrom<u32> + std::fmt::Debug>(number: u32) -> String {
    T::try_from(number).map_or_else(|_| format!("number {number}"), words)
}

impl Bus {
    fn lock(&self) -> MutexGuard<'_, Option<Robot>> {
        self.robot.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Works with the robot on the bus.
    fn with_robot<T>(&self, py: Python<'_>, work: impl FnOnce(&mut Robot) -> T + Send) -> PyResult<T>
    where
        T: Send,
    {
        let done = py.detach(|| self.lock().as_mut().map(work));
        done.ok_or_else(|| error(py, "the robot is closed", Kind::Usage))
    }
}

#[pymethods]
impl Bus {
    /// Joins the bus of robot `name`; with `joints` above 0 as its robot controller, which publishes samples.
    #[new]
    fn new(py: Python<'_>, name: &str, joints: u32, prefix: Option<String>, root: Option<PathBuf>) -> PyResult<Bus> {
        let usual = BusConfig::default();
        let config = BusConfig { prefix: prefix.unwrap_or(usual.prefix), root: root.unwrap_or(usual.root) };
        let robot = py.detach(|| Robot::open(&config, name, joints));
        let robot = robot.map_err(|why| error(py, &why.to_string(), Kind::InputOutput))?;
        Ok(Bus { joints: joints as usize, robot: Mutex::new(Some(robot)) })
    }

    /// Leaves the bus.
    fn close(&self, py: Python<'_>) {
        py.detach(|| drop(self.lock().take()));
    }

    /// The latest parameter set of the daemon; none before the first.
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let set = self.with_robot(py, |robot| robot.parameters().copied())?;
        set.map(|set| parameters_dict(py, &set)).transpose()
    }

    /// The latest health of the daemon; none before the first.
    fn health<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let health = self.with_robot(py, |robot| robot.health().copied())?;
        health.map(|health| health_dict(py, &health)).transpose()
    }

    /// The latest health of the controller; none before the first.
    fn controller_health<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let health = self.with_robot(py, |robot| robot.controller_health().copied())?;
        health.map(|health| controller_dict(py, &health)).transpose()
    }

    /// Publishes the sample of one period; `planned` has desired positions, velocities and accelerations.
    fn publish(
        &self,
        py: Python<'_>,
        position: PyReadonlyArray1<'_, f64>,
        torque: PyReadonlyArray1<'_, f64>,
        planned: Option<[PyReadonlyArray1<'_, f64>; 3]>,
        stamp_ns: u64,
        faults: u32,
    ) -> PyResult<()> {
        let joints = |array: &PyReadonlyArray1<'_, f64>| -> PyResult<[f64; MAX_JOINTS]> {
            let array = array.as_array();
            if array.len() != self.joints {
                let why = format!("{} entries; the robot was opened with {} joints", array.len(), self.joints);
                return Err(error(py, &why, Kind::Usage));
            }
            Ok(std::array::from_fn(|j| array.get(j).copied().unwrap_or(0.0)))
        };
        let mut sample = Sample { stamp_ns, q: joints(&position)?, tau: joints(&torque)?, faults, ..Sample::default() };
        if let Some([q, qd, qdd]) = &planned {
            (sample.q_des, sample.qd_des, sample.qdd_des) = (joints(q)?, joints(qd)?, joints(qdd)?);
            sample.flags |= sample_flags::SETPOINT;
        }
        match self.with_robot(py, move |robot| robot.publish(&sample))? {
            rivet::Status::Ok => Ok(()),
            status => Err(error(py, &format!("the sample is lost: {}", words(status)), Kind::Other)),
        }
    }

    /// Torque \[N m\] and mode of the command that answers the last sample, waited for at most `timeout` \[s\]; else none.
    fn wait_command<'py>(&self, py: Python<'py>, timeout: f64) -> PyResult<Option<(Bound<'py, PyArray1<f64>>, u32)>> {
        let timeout = Duration::try_from_secs_f64(timeout).unwrap_or(Duration::ZERO);
        let command = self.with_robot(py, move |robot| robot.wait_for_command(timeout))?;
        let joints = self.joints;
        Ok(command.map(|command| (command.tau[..joints.min(MAX_JOINTS)].to_pyarray(py), command.mode)))
    }

    /// Samples published, sent, lost and not accepted.
    fn counters(&self, py: Python<'_>) -> PyResult<[u64; 4]> {
        let counters = self.with_robot(py, |robot| robot.counters())?;
        Ok([counters.published, counters.sent, counters.lost, counters.failed])
    }

    /// What failed last on the thread of the ports; empty if nothing did.
    fn problem(&self, py: Python<'_>) -> PyResult<String> {
        self.with_robot(py, |robot| robot.problem())
    }
}

fn parameters_dict<'py>(py: Python<'py>, set: &Parameters) -> PyResult<Bound<'py, PyDict>> {
    let count = (set.count as usize).min(set.values.len());
    let joints = (set.joints as usize).min(MAX_JOINTS);
    let state = |state: &u8| match ParameterState::try_from(*state) {
        Ok(ParameterState::Active) => "active",
        Ok(ParameterState::Held) => "held",
        Ok(ParameterState::Unidentified) => "unidentified",
        Err(_) => "unknown",
    };
    let out = PyDict::new(py);
    out.set_item("epoch", set.epoch)?;
    out.set_item("sequence", set.seq)?;
    out.set_item("stamp_ns", set.stamp_ns)?;
    out.set_item("model_hash", set.model_hash)?;
    out.set_item("instruments", named::<InstrumentSource>(set.instruments))?;
    let flags = [
        (parameter_flags::SUSPENDED, "suspended"),
        (parameter_flags::FROZEN, "frozen"),
        (parameter_flags::PROVISIONAL, "provisional"),
        (parameter_flags::BAD_INPUT, "bad input"),
        (parameter_flags::LATE, "late"),
    ];
    let flags: Vec<&str> = flags.iter().filter_map(|(bit, word)| (set.flags & bit != 0).then_some(*word)).collect();
    out.set_item("flags", flags)?;
    out.set_item("values", set.values[..count].to_pyarray(py))?;
    out.set_item("std", set.std[..count].to_pyarray(py))?;
    out.set_item("excitation", set.excitation[..count].to_pyarray(py))?;
    out.set_item("least_squares", set.reference[..count].to_pyarray(py))?;
    out.set_item("state", set.state[..count].iter().map(state).collect::<Vec<_>>())?;
    out.set_item("torque_noise", set.torque_noise[..joints].to_pyarray(py))?;
    out.set_item("residual_rms", set.residual_rms[..joints].to_pyarray(py))?;
    out.set_item("sample_period", set.sample_period_s)?;
    Ok(out)
}

fn health_dict<'py>(py: Python<'py>, health: &Health) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    out.set_item("mode", named::<DaemonMode>(health.mode))?;
    out.set_item("stamp_ns", health.stamp_ns)?;
    out.set_item("samples", health.samples)?;
    out.set_item("lost", health.lost)?;
    out.set_item("gaps", health.gaps)?;
    out.set_item("overruns", health.overruns)?;
    out.set_item("active", health.active)?;
    out.set_item("held", health.held)?;
    out.set_item("instruments", named::<InstrumentSource>(health.instruments))?;
    let fault = (health.input_fault != 0).then(|| named::<InputFault>(health.input_fault));
    out.set_item("input_fault", fault)?;
    out.set_item("residual_rms", health.residual_rms.to_pyarray(py))?;
    out.set_item("nominal_residual_rms", health.nominal_residual_rms.to_pyarray(py))?;
    out.set_item("torque_rms", health.torque_rms.to_pyarray(py))?;
    out.set_item("worst_wake_s", health.worst_wake_ns as f64 * 1e-9)?;
    out.set_item("worst_work_s", health.worst_work_ns as f64 * 1e-9)?;
    out.set_item("window_s", health.window_s)?;
    out.set_item("bias_p_value", health.hausman_p_value)?;
    Ok(out)
}

fn controller_dict<'py>(py: Python<'py>, health: &ControllerHealth) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    out.set_item("state", named::<ControllerState>(health.state))?;
    out.set_item("stamp_ns", health.stamp_ns)?;
    out.set_item("commands", health.commands)?;
    out.set_item("parameter_source", named::<rivet_ipc_schema::ParameterSource>(health.source))?;
    out.set_item("stops", health.stops)?;
    let cause = (health.stops > 0).then(|| named::<StopCause>(health.stop_cause));
    out.set_item("stop_cause", cause)?;
    let joints = (0..MAX_JOINTS).filter(|j| health.stop_joints >> j & 1 == 1);
    out.set_item("stop_joints", joints.collect::<Vec<_>>())?;
    Ok(out)
}
