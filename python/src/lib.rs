//! Native module of the Python package: the analyses of `rivet-analysis` and the bus of `librivet`.
//!
//! Python sees `rivet` (`rivet/__init__.py`), which wraps these functions. Their results are JSON texts and numpy arrays; the classes
//! around them are Python's.

mod analyses;
mod arrays;
mod bus;
mod worker;

use pyo3::prelude::*;

#[pymodule]
mod _native {
    #[pymodule_export]
    use super::analyses::{
        Diagnosis, Identification, Inspection, Model, diagnose, identify, inspect, predict, robot_file, simulate,
    };
    #[pymodule_export]
    use super::arrays::write_log;
    #[pymodule_export]
    use super::bus::Bus;
    #[pymodule_export]
    use super::worker::panic_on_request;

    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
