//! The guardian process of a Haply: this library, run by a separate Python interpreter.

use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::Once;

use ergon_live::device::guardian::{self, GuardianProgram};
use pyo3::prelude::*;

use crate::error::plain_error;

/// Loads only the library file that the host process uses, without `site` and without the package.
const LOAD_SCRIPT: &str = "\
import sys
from importlib.util import module_from_spec, spec_from_file_location
spec = spec_from_file_location('ergon._core', sys.argv[1])
core = module_from_spec(spec)
spec.loader.exec_module(core)
core.guard_haply()";

/// Run as the guardian process of a Haply, until the host at the standard input is gone.
#[pyfunction]
pub(crate) fn guard_haply(py: Python<'_>) -> PyResult<()> {
    py.detach(guardian::serve).map_err(plain_error)
}

/// Register the command that starts a guardian, before a device is opened. If Python is embedded in another program, no
/// guardian can be started, and a Haply is refused.
pub(crate) fn register_guardian(py: Python<'_>) {
    static ONCE: Once = Once::new();
    if ONCE.is_completed() {
        return;
    }
    if let Some(program) = guardian_program(py) {
        ONCE.call_once(|| guardian::register_program(program));
    }
}

fn guardian_program(py: Python<'_>) -> Option<GuardianProgram> {
    let sys_module = py.import("sys").ok()?;
    if sys_module.hasattr("frozen").ok()? {
        return None;
    }
    let path: PathBuf = sys_module.getattr("executable").ok()?.extract().ok()?;
    let core_file = py.import("ergon._core").ok()?.getattr("__file__").ok()?;
    let core_file: PathBuf = core_file.extract().ok()?;
    let mut arguments: Vec<OsString> = ["-I", "-S", "-c", LOAD_SCRIPT].map(Into::into).into();
    arguments.push(core_file.into());
    path.is_file().then_some(GuardianProgram { path, arguments })
}
