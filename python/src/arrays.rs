//! numpy arrays in and out.

use std::collections::BTreeMap;
use std::path::PathBuf;

use numpy::{PyArray1, PyArray2, PyArrayMethods as _, PyReadonlyArray1, PyReadonlyArray2, ToPyArray as _};
use pyo3::prelude::*;
use rivet_analysis::fault::Kind;

use crate::worker::error;

/// Writes arrays as a log in Parquet, which is then read as every log is.
///
/// * `time`: \[s\]
/// * `signals`: `(samples, joints)` by name: q, tau, q_des, ... as in `docs/logs.md`
#[pyfunction]
pub(crate) fn write_log(
    py: Python<'_>,
    path: PathBuf,
    time: PyReadonlyArray1<'_, f64>,
    signals: BTreeMap<String, PyReadonlyArray2<'_, f64>>,
) -> PyResult<()> {
    let mut columns = vec![("t".to_owned(), time.as_array().to_vec())];
    for (name, signal) in &signals {
        let joints = signal.as_array();
        let joints = joints.columns().into_iter().enumerate();
        columns.extend(joints.map(|(j, column)| (format!("{name}{}", j + 1), column.to_vec())));
    }
    let columns: Vec<(&str, &[f64])> =
        columns.iter().map(|(name, column)| (name.as_str(), column.as_slice())).collect();
    rivet_logs::write_columns(&path, &columns).map_err(|why| error(py, &why.to_string(), Kind::InputOutput))
}

/// `signals[joint][row]` as an array of (rows, joints).
pub(crate) fn samples_by_joints<'py>(
    py: Python<'py>,
    signals: &[Vec<f64>],
    rows: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let flat: Vec<f64> = (0..rows).flat_map(|k| signals.iter().map(move |signal| signal[k])).collect();
    PyArray1::from_vec(py, flat).reshape([rows, signals.len()])
}

/// A row-major square matrix.
pub(crate) fn square<'py>(py: Python<'py>, entries: &[f64]) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let side = entries.len().isqrt();
    entries.to_pyarray(py).reshape([side, side])
}
