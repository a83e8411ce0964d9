//! `ergon._core`: the only interface between Python and the engine.
//!
//! A function here does three things: check shapes, release the GIL, call the engine. Computations that may take long
//! run inside `work::computing`, which ends them on Ctrl-C. Anything more belongs in `ergon-engine`.

mod arrays;
mod audio;
mod chance;
mod curve;
mod derivative;
mod device;
mod emulator;
mod error;
mod excitation;
mod faults;
mod fold;
mod frames;
mod guardian;
mod key_model;
mod law;
mod lead;
mod limiter;
mod maths;
mod meter;
mod mixer;
mod motion;
mod named;
mod network;
mod pcm;
mod perform;
mod plan;
mod recording;
mod silence_detector;
mod simulation;
mod status;
mod stop;
mod take;
mod timeline;
mod view_server;
mod waveform;
mod words;
mod work;

use pyo3::prelude::*;

/// The compiled core of ergon.
#[pymodule(gil_used = false)]
mod _core {
    use pyo3::prelude::*;

    #[pymodule_export]
    use super::audio::{AudioBackend, AudioEvent, AudioInfo, AudioOut, JackCapture};
    #[pymodule_export]
    use super::audio::{play_frames, survey_audio};
    #[pymodule_export]
    use super::chance::Chance;
    #[pymodule_export]
    use super::curve::path_values;
    #[pymodule_export]
    use super::derivative::Derivatives;
    #[pymodule_export]
    use super::device::{Checkup, Device, SerialPort, UsbBoard};
    #[pymodule_export]
    use super::device::{checkup, serial_identity, serial_ports};
    #[pymodule_export]
    use super::emulator::emulate;
    #[pymodule_export]
    use super::error::{DivergedError, EngineError, LawError, UnstableError, UnsureError};
    #[pymodule_export]
    use super::excitation::{ExcitationRecord, emulated_device, excite};
    #[pymodule_export]
    use super::faults::{FaultMeasurement, measure_faults};
    #[pymodule_export]
    use super::fold::Fold;
    #[pymodule_export]
    use super::guardian::guard_haply;
    #[pymodule_export]
    use super::key_model::{key_force_derivatives, key_path};
    #[pymodule_export]
    use super::law::{Law, law_functions};
    #[pymodule_export]
    use super::lead::{Lead, even_path};
    #[pymodule_export]
    use super::limiter::Limiter;
    #[pymodule_export]
    use super::maths::{atan2, cos, decibels, exp, ln, pow, sin};
    #[pymodule_export]
    #[pymodule_export]
    use super::meter::{LevelSteps, Meter, TruePeak};
    #[pymodule_export]
    use super::mixer::{FrozenOutputs, Mixer};
    #[pymodule_export]
    use super::motion::{Motion, MotionLook, MotionRecorder, Window, motion_bound, read_motion};
    #[pymodule_export]
    use super::network::{Certificate, Network, ReachableNetwork};
    #[pymodule_export]
    use super::pcm::{crc32, packed, pcm, single};
    #[pymodule_export]
    use super::perform::{AudioRecorded, Performance};
    #[pymodule_export]
    use super::plan::{Plan, PlanRow};
    #[pymodule_export]
    use super::recording::{Recording, read_recording};
    #[pymodule_export]
    use super::silence_detector::SilenceDetector;
    #[pymodule_export]
    use super::simulation::{Energy, IslandStretch, Report, Simulation, Snapshot, StorableIsland};
    #[pymodule_export]
    use super::status::{HandLimit, HandStatus, Status};
    #[pymodule_export]
    use super::stop::{begin_again, has_let_go, let_go, stop_on_signals};
    #[pymodule_export]
    use super::take::Take;
    #[pymodule_export]
    use super::timeline::Timeline;
    #[pymodule_export]
    use super::view_server::ViewServer;
    #[pymodule_export]
    use super::waveform::waveform_errors;
    #[pymodule_export]
    use super::work::{StoppedError, Work, poll};
    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        super::named::register(module)
    }
    #[pymodule_export]
    const FADE: f64 = ergon_engine::timeline::FADE_SECONDS;
    #[pymodule_export]
    const FORCE_FALL_TIME: f64 = ergon_live::perform::FALL_SECONDS;
    #[pymodule_export]
    const FORCE_SCALE_MIN: f64 = ergon_live::perform::FORCE_SCALE_MIN;
    #[pymodule_export]
    const GRID: u64 = ergon_engine::timeline::GRID_FRAMES;
    #[pymodule_export]
    const INAUDIBLE_ERROR_DB: f64 = ergon_engine::plan::INAUDIBLE_ERROR_DB;
    #[pymodule_export]
    const JUST_NOTICEABLE: (f64, f64, f64, f64, f64, f64) = {
        let [cents, t60, level, first, later, stroke] = ergon_engine::hearing::JUST_NOTICEABLE;
        (cents, t60, level, first, later, stroke)
    };
    #[pymodule_export]
    const MAX_MODAL: usize = ergon_engine::generator::MAX_MODAL;
    #[pymodule_export]
    const MAX_PLACES: usize = ergon_engine::generator::MAX_PLACES;
    #[pymodule_export]
    const SPECTRUM_NOISE_DB: f64 = ergon_engine::plan::SPECTRUM_NOISE_DB;
    #[pymodule_export]
    #[allow(non_upper_case_globals)]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
