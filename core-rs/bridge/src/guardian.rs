//! The guardian of a Haply: this very library, in a Python of its own.

use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::Once;

use ergon_live::device::guardian::{self, Program};
use pyo3::prelude::*;

use crate::error::said;

/// Loads the library from the file that its host has loaded, and nothing else: no site, no package.
const LOAD: &str = "\
import sys
from importlib.util import module_from_spec, spec_from_file_location
spec = spec_from_file_location('ergon._core', sys.argv[1])
core = module_from_spec(spec)
spec.loader.exec_module(core)
core.guard_haply()";

/// Be the guardian of a Haply whose host is at the other end of the standard input, until the host is gone.
#[pyfunction]
pub(crate) fn guard_haply(py: Python<'_>) -> PyResult<()> {
    py.detach(guardian::serve).map_err(said)
}

/// Say what starts a guardian, before a device is opened. Where Python is a part of another program there is none to
/// start, and a Haply is refused.
pub(crate) fn ready(py: Python<'_>) {
    static ONCE: Once = Once::new();
    if ONCE.is_completed() {
        return;
    }
    if let Some(program) = program(py) {
        ONCE.call_once(|| guardian::start_with(program));
    }
}

fn program(py: Python<'_>) -> Option<Program> {
    let sys = py.import("sys").ok()?;
    if sys.hasattr("frozen").ok()? {
        return None;
    }
    let path: PathBuf = sys.getattr("executable").ok()?.extract().ok()?;
    let core = py.import("ergon._core").ok()?.getattr("__file__").ok()?;
    let core: PathBuf = core.extract().ok()?;
    let mut arguments: Vec<OsString> = ["-I", "-S", "-c", LOAD].map(Into::into).into();
    arguments.push(core.into());
    path.is_file().then_some(Program { path, arguments })
}
