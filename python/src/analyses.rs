//! The analyses as functions of the module, each the same call as the command line's.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use clap::ValueEnum as _;
use numpy::{PyArray1, PyArray2, ToPyArray as _};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rivet_analysis::diagnose::{self as diagnosing, Diagnosed, Inputs};
use rivet_analysis::fault::{Kind, kind};
use rivet_analysis::identify::{self as identifying, Options};
use rivet_analysis::{inspect as inspecting, map, predict as predicting, robot_file as files};
use rivet_config::{Identified, Robot};
use rivet_simulation::process::{MotionKind, Options as SimulationOptions, Recording};

use crate::arrays::{samples_by_joints, square};
use crate::worker::{error, run};

/// An `anyhow` failure as `rivet.Error`.
fn raised(py: Python<'_>) -> impl FnOnce(anyhow::Error) -> PyErr + use<'_> {
    move |why| error(py, &format!("{why:#}"), kind(&why))
}

/// A robot with the parameters that predictions use.
#[pyclass(frozen, module = "rivet._native")]
pub(crate) struct Model {
    robot: Robot,
}

#[pymethods]
impl Model {
    /// Reads a robot file; `map` has channels of its logs as KEY=VALUE.
    #[new]
    fn new(py: Python<'_>, path: PathBuf, map: Vec<String>) -> PyResult<Model> {
        load(&path, &map).map(|robot| Model { robot }).map_err(raised(py))
    }

    #[getter]
    fn name(&self) -> &str {
        &self.robot.config.name
    }

    #[getter]
    fn path(&self) -> PathBuf {
        self.robot.config.path.clone()
    }

    #[getter]
    fn joints(&self) -> Vec<String> {
        rivet_analysis::runs::joint_names(&self.robot)
    }

    #[getter]
    fn sample_period(&self) -> f64 {
        self.robot.config.sample_period_s
    }

    #[getter]
    fn model_hash(&self) -> u64 {
        self.robot.hash
    }

    #[getter]
    fn is_identified(&self) -> bool {
        self.robot.identified.is_some()
    }

    /// Names of the base parameters.
    #[getter]
    fn names(&self) -> Vec<String> {
        (0..self.robot.base.len()).map(|i| self.robot.base.name(&self.robot.model, i)).collect()
    }

    /// Units of the base parameters.
    #[getter]
    fn units(&self) -> Vec<String> {
        let Robot { base, model, .. } = &self.robot;
        (0..base.len()).map(|i| base.parameter(model, i).unit(&model.arm).to_owned()).collect()
    }

    /// Base parameters that predictions use.
    #[getter]
    fn values<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.robot.base_parameters().to_pyarray(py)
    }

    /// Nominal base parameters.
    #[getter]
    fn nominal<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.robot.nominal_base.to_pyarray(py)
    }

    /// The model with other base parameters.
    fn with_values(&self, py: Python<'_>, values: Vec<f64>) -> PyResult<Model> {
        let expected = self.robot.base.len();
        if values.len() != expected {
            let why = format!("{} values; the model has {expected} base parameters", values.len());
            return Err(error(py, &why, Kind::Usage));
        }
        let std = vec![0.0; values.len()];
        Ok(Model { robot: Robot { identified: Some(Identified { values, std }), ..self.robot.clone() } })
    }

    fn text(&self) -> String {
        self.robot.describe()
    }
}

fn load(path: &Path, entries: &[String]) -> Result<Robot> {
    map::apply(rivet_config::load(path)?, entries)
}

/// Identified parameters and their report.
#[pyclass(frozen, module = "rivet._native")]
pub(crate) struct Identification {
    found: identifying::Identification,
}

/// Identifies base parameters; returns the identification and the notes.
#[pyfunction]
pub(crate) fn identify(
    py: Python<'_>,
    robot: PathBuf,
    logs: Vec<PathBuf>,
    held_out: Vec<PathBuf>,
    refine: bool,
    map: Vec<String>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Identification, Vec<String>)> {
    let (found, notes) = run(py, progress, move || {
        let robot = load(&robot, &map)?;
        identifying::identify(&robot, &logs, &Options { held_out, refine })
    })?;
    Ok((Identification { found }, notes))
}

#[pymethods]
impl Identification {
    fn json(&self) -> String {
        rivet_files::printable_json(format!("{:#}\n", self.found.to_json()))
    }

    fn text(&self) -> String {
        self.found.text()
    }

    /// The robot with the identified parameters.
    fn model(&self) -> Model {
        Model { robot: self.found.model() }
    }

    /// Values of the fit that counts, in each parameter's unit.
    #[getter]
    fn values<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.found.fit().values.to_pyarray(py)
    }

    /// Standard deviations, in each parameter's unit.
    #[getter]
    fn std<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.found.fit().std.to_pyarray(py)
    }

    /// Covariance of the values, (parameters, parameters).
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        square(py, &self.found.fit().covariance)
    }

    /// Writes model.toml and what belongs to it into a folder.
    fn export(&self, py: Python<'_>, folder: PathBuf) -> PyResult<()> {
        py.detach(|| self.found.export(&folder)).map_err(raised(py))
    }
}

/// Predicts the torque of a model along a log; returns the parts of the prediction, and the notes.
#[pyfunction]
pub(crate) fn predict<'py>(
    py: Python<'py>,
    model: Bound<'py, Model>,
    log: PathBuf,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Bound<'py, PyDict>, Vec<String>)> {
    let robot = model.get().robot.clone();
    let (found, notes) = run(py, progress, move || predicting::predict(&robot, &log))?;
    let rows = found.t.len();
    let parts = PyDict::new(py);
    parts.set_item("text", found.text())?;
    let errors = found.errors_percent();
    let errors = errors.map(|errors| (0..2).map(|k| errors.iter().map(|e| e[k]).collect()).collect::<Vec<Vec<f64>>>());
    let errors = errors.map(|errors| [errors[0].to_pyarray(py), errors[1].to_pyarray(py)]);
    parts.set_item("errors_percent", errors)?;
    parts.set_item("time", found.t.to_pyarray(py))?;
    parts.set_item("predicted", samples_by_joints(py, &found.tau, rows)?)?;
    let measured = found.measured.as_ref().map(|tau| samples_by_joints(py, tau, rows)).transpose()?;
    parts.set_item("measured", measured)?;
    parts.set_item("robot", found.robot)?;
    parts.set_item("joints", found.joints)?;
    parts.set_item("log", found.log)?;
    parts.set_item("is_identified", found.is_identified)?;
    Ok((parts, notes))
}

/// A diagnosis and its report.
#[pyclass(frozen, module = "rivet._native")]
pub(crate) struct Diagnosis {
    found: Diagnosed,
}

/// Diagnoses the gap between nominal model and arm; returns the diagnosis and the notes.
///
/// * `program`: file whose digest the passport states
#[pyfunction]
pub(crate) fn diagnose(
    py: Python<'_>,
    robot: PathBuf,
    logs: Vec<PathBuf>,
    self_check: bool,
    map: Vec<String>,
    program: PathBuf,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Diagnosis, Vec<String>)> {
    let (found, notes) = run(py, progress, move || {
        let loaded = load(&robot, &map)?;
        let inputs =
            Inputs { robot_file: &robot, logs: &logs, is_last_live: false, program: &program, is_verbose: false };
        let mut found = diagnosing::diagnose(&loaded, &inputs)?;
        if self_check {
            found.self_check()?;
        }
        Ok(found)
    })?;
    Ok((Diagnosis { found }, notes))
}

#[pymethods]
impl Diagnosis {
    fn json(&self, py: Python<'_>) -> PyResult<String> {
        self.found.json().map_err(raised(py))
    }

    fn text(&self, py: Python<'_>) -> PyResult<String> {
        self.found.text(true).map_err(raised(py))
    }

    /// The page of the diagnosis, without external parts.
    fn html(&self, py: Python<'_>) -> PyResult<String> {
        self.found.html().map_err(raised(py))
    }

    /// Writes the models that were found into a folder; returns whether there was one, and the notes.
    fn export(&self, py: Python<'_>, folder: PathBuf) -> PyResult<(bool, Vec<String>)> {
        let session = rivet_analysis::session::Session::new(|_, _| true);
        let (written, notes) = py.detach(|| session.run(|| self.found.export(&folder)));
        Ok((written.map_err(raised(py))?, notes))
    }
}

/// What a recording holds, and its report.
#[pyclass(frozen, module = "rivet._native")]
pub(crate) struct Inspection {
    found: inspecting::Inspection,
}

/// Inspects a recording; returns the inspection and the notes.
#[pyfunction]
pub(crate) fn inspect(
    py: Python<'_>,
    recording: PathBuf,
    robot: Option<PathBuf>,
    map: Vec<String>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Inspection, Vec<String>)> {
    let (found, notes) = run(py, progress, move || inspecting::inspect(&recording, robot.as_deref(), &map))?;
    Ok((Inspection { found }, notes))
}

#[pymethods]
impl Inspection {
    fn json(&self, py: Python<'_>) -> PyResult<String> {
        let text = serde_json::to_string_pretty(&self.found.to_json()).context("the inspection as JSON");
        Ok(rivet_files::printable_json(text.map_err(raised(py))? + "\n"))
    }

    fn text(&self) -> String {
        self.found.text()
    }

    #[getter]
    fn is_doubtful(&self) -> bool {
        self.found.is_doubtful()
    }

    /// Time \[s\], position \[rad\] and torque \[N m\] as read, in the conventions of a log; none where the recording is refused.
    #[allow(clippy::type_complexity, reason = "three arrays")]
    fn signals<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<Option<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>, Option<Bound<'py, PyArray2<f64>>>)>>
    {
        let Some(log) = self.found.log() else { return Ok(None) };
        let tau = log.tau.as_ref().map(|(_, tau)| samples_by_joints(py, tau, log.len())).transpose()?;
        Ok(Some((log.t.to_pyarray(py), samples_by_joints(py, &log.q, log.len())?, tau)))
    }
}

/// The text of a robot file made from a URDF and logs for a folder, and what is unknown in it.
#[pyfunction]
pub(crate) fn robot_file(
    py: Python<'_>,
    urdf: PathBuf,
    logs: Vec<PathBuf>,
    gravity: [f64; 3],
    folder: PathBuf,
) -> PyResult<(String, Vec<String>)> {
    let made = py.detach(|| files::robot_file(&urdf, &logs, &gravity, &folder)).map_err(raised(py))?;
    Ok((made.text, made.unknown))
}

/// Simulates a robot; returns time, signals and true parameters.
#[pyfunction]
pub(crate) fn simulate<'py>(
    py: Python<'py>,
    robot: PathBuf,
    seconds: f64,
    seed: u64,
    motion: &str,
    speed: f64,
    noise: f64,
    factors: [f64; 3],
    payload: Option<(f64, [f64; 3])>,
) -> PyResult<Bound<'py, PyDict>> {
    let motion = MotionKind::from_str(motion, true)
        .map_err(|_| error(py, &format!("motion {motion:?}: it must be one of {}", motions()), Kind::Usage))?;
    if !(seconds > 0.0 && seconds <= MAX_SIMULATED_S) {
        let why = format!("seconds {seconds}: must be above 0 and at most {MAX_SIMULATED_S}");
        return Err(error(py, &why, Kind::Usage));
    }
    if !(speed > 0.0 && speed <= 1.0) {
        return Err(error(py, &format!("speed {speed}: must be above 0 and at most 1"), Kind::Usage));
    }
    let (recording, _) = run(py, None, move || {
        let loaded = rivet_config::load(&robot)?;
        let [bodies, rotor_inertia, friction] = factors;
        let (payload, payload_com) = payload.map_or((None, [0.0; 3]), |(mass, com)| (Some(mass), com));
        let options = SimulationOptions {
            duration: Some(seconds),
            seed: Some(seed),
            motion,
            velocity: speed,
            bodies,
            rotor_inertia,
            friction,
            payload,
            payload_com,
            noise,
            ..SimulationOptions::new(&robot)
        };
        let mut recording = Recording::new(&loaded, &options)?;
        // A log has the zero of the robot's encoders.
        for positions in [&mut recording.q].into_iter().chain(recording.planned.first_mut()) {
            for (q, zero) in positions.iter_mut().zip(&loaded.config.log.joint_zero) {
                for position in q {
                    *position -= zero;
                }
            }
        }
        Ok(recording)
    })?;
    let rows = recording.t.len();
    let parts = PyDict::new(py);
    parts.set_item("time", recording.t.to_pyarray(py))?;
    let [q_des, qd_des, qdd_des] = &recording.planned;
    let signals =
        [("q", &recording.q), ("tau", &recording.tau), ("q_des", q_des), ("qd_des", qd_des), ("qdd_des", qdd_des)];
    for (name, signal) in signals {
        parts.set_item(name, samples_by_joints(py, signal, rows)?)?;
    }
    for (name, parameters) in [("standard", &recording.truth.standard), ("base", &recording.truth.base)] {
        let truth = PyDict::new(py);
        for parameter in parameters {
            truth.set_item(&parameter.name, parameter.value)?;
        }
        parts.set_item(name, truth)?;
    }
    Ok(parts)
}

/// Longest simulation \[s\]: what fits into memory.
const MAX_SIMULATED_S: f64 = 600.0;

fn motions() -> String {
    let names =
        MotionKind::value_variants().iter().filter_map(|kind| Some(kind.to_possible_value()?.get_name().to_owned()));
    names.collect::<Vec<_>>().join(", ")
}
