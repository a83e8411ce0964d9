//! Emulated devices, served until their time is over or Ctrl-C is pressed.

use std::cell::RefCell;
use std::time::Duration;

use ergon_engine::key_model::KeyModel;
use ergon_engine::simulation::KeyMotor;
use ergon_live::emulate::{
    BoardConfig, EmulatedHand, EmulationOptions, KeyConstants, Protocol, ServeEvent, ServeSummary, Transport, serve,
};
use numpy::PyReadonlyArray1;
use pyo3::prelude::*;

use crate::error::{module_error, parse_choice};
use crate::network::Network;
use crate::words::WordTable;

pub(crate) const PROTOCOLS: WordTable<Protocol> = &[
    ("firefader", Protocol::FireFader),
    ("frame", Protocol::Frame),
    ("haply", Protocol::Haply),
];
const TRANSPORTS: WordTable<fn(u16) -> Transport> = &[
    ("pty", |_| Transport::Terminal),
    ("udp", Transport::Udp),
    ("ws", Transport::WebSocket),
];

/// Emulate a device until Ctrl-C or for `seconds` [s], and report to `tell`; at the end the periods, packets and the
/// hash of all positions.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
#[pyo3(signature = (protocol, transport, tell, *, port=0, paths, hand, axes, mass, stiffness, damping, travel,
    force_max, resolution, rate, lockstep, touch_gate, watchdog, model=None, network=None, noise=0.0, force_step=0.0, seed=0,
    seconds=None, once=false))]
pub(crate) fn emulate(
    py: Python<'_>,
    protocol: &str,
    transport: &str,
    tell: Py<PyAny>,
    port: u16,
    paths: Vec<PyReadonlyArray1<'_, f64>>,
    hand: (f64, f64),
    axes: usize,
    mass: f64,
    stiffness: f64,
    damping: f64,
    travel: f64,
    force_max: f64,
    resolution: f64,
    rate: f64,
    lockstep: bool,
    touch_gate: bool,
    watchdog: f64,
    model: Option<PyReadonlyArray1<'_, f64>>,
    network: Option<(PyRef<'_, Network>, usize, f64, f64)>,
    noise: f64,
    force_step: f64,
    seed: u64,
    seconds: Option<f64>,
    once: bool,
) -> PyResult<()> {
    let model = model.map(|row| KeyModel::from_row(&row.as_array().to_vec()));
    let model = model.transpose().map_err(|error| module_error("emulate", error))?;
    let watchdog = Duration::try_from_secs_f64(watchdog);
    let key = KeyConstants {
        mass,
        stiffness,
        damping,
        range: [-0.5 * travel, 0.5 * travel],
    };
    let options = EmulationOptions {
        board: BoardConfig {
            protocol: parse_choice("protocol", protocol, PROTOCOLS)?,
            lockstep,
            touch_gate,
            force_max,
            resolution,
            noise,
            seed,
            force_step,
            watchdog: watchdog.map_err(|_| module_error("watchdog", "must be a time of at least zero"))?,
            reported_constants: [mass, damping],
            range: key.range,
        },
        transport: parse_choice("transport", transport, TRANSPORTS)?(port),
        axes,
        key,
        model,
        network: network.map(|(network, struck_mat, constant_force, delay)| {
            (network.0.clone(), struck_mat, KeyMotor { delay, constant_force })
        }),
        rate,
        hands: paths.iter().map(|path| hand_on_path(path, hand)).collect(),
        seconds,
        ends_with_host: once,
    };
    run(py, options, &tell)
}

/// The hand that follows `path`; an empty path is a resting finger.
fn hand_on_path(path: &PyReadonlyArray1<'_, f64>, (stiffness, damping): (f64, f64)) -> EmulatedHand {
    let path = path.as_array().to_vec();
    if path.is_empty() {
        return EmulatedHand::Resting;
    }
    EmulatedHand::OnPath {
        path,
        stiffness,
        damping,
    }
}

fn run(py: Python<'_>, options: EmulationOptions, tell: &Py<PyAny>) -> PyResult<()> {
    let (serve_result, error) = py.detach(|| {
        // A signal handler's exception appears at the next run of Python code: a call of `tell`, or `check_signals`.
        // The first one is kept.
        let error = RefCell::new(None);
        let run_python = |call: &dyn Fn(Python<'_>) -> PyResult<()>| {
            if error.borrow().is_none() {
                *error.borrow_mut() = Python::attach(call).err();
            }
            error.borrow().is_none()
        };
        let mut report_event = |event: ServeEvent| {
            let event_words = match event {
                ServeEvent::Ready(address) => ("ready", address),
                ServeEvent::LetGo => ("let-go", String::new()),
                ServeEvent::HostGone => ("host-gone", String::new()),
            };
            run_python(&|py| tell.call1(py, event_words.clone()).map(drop));
        };
        let serve_result = serve(options, &mut report_event, &mut || run_python(&|py| py.check_signals()));
        (serve_result, error.into_inner())
    });
    let ServeSummary { periods, packets, hash } = serve_result.map_err(|error| module_error("emulate", error))?;
    // The summary is also sent after Ctrl-C.
    let summary_line = format!("{periods} {packets} {hash:016x}");
    tell.call1(py, ("over", summary_line))?;
    error.map_or(Ok(()), Err)
}
