//! The engine's errors as Python exceptions with attributes that locate the fault.

use std::fmt::Display;

use ergon_engine::gesture::error::GestureError;
use ergon_engine::law;
use ergon_engine::network;
use ergon_engine::simulation::Fault;
use ergon_engine::units::Rate;
use pyo3::create_exception;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

create_exception!(
    ergon._core,
    EngineError,
    PyValueError,
    "A network, law or timeline that the engine will not run; `module` names the module."
);
create_exception!(
    ergon._core,
    LawError,
    EngineError,
    "A law that cannot be compiled; `offset` and `length` mark the characters."
);

create_exception!(
    ergon._core,
    UnsureError,
    EngineError,
    "An axis whose direction could not be measured."
);

/// `error` with `module`, an empty `refusals`, no `index`, the whole message as `sentence`, and whatever `attributes`
/// sets: the attributes that the stub declares.
pub(crate) fn with_attributes(
    error: PyErr,
    module: Option<&str>,
    attributes: impl FnOnce(&Bound<'_, PyAny>) -> PyResult<()>,
) -> PyErr {
    let set_result = Python::attach(|py| {
        let error_object = error.value(py).as_any();
        error_object.setattr("module", module)?;
        error_object.setattr("refusals", Vec::<PyErr>::new())?;
        error_object.setattr("index", None::<usize>)?;
        error_object.setattr("sentence", error_object.to_string())?;
        attributes(error_object)
    });
    // If an attribute cannot be set (out of memory), that error is returned instead.
    set_result.err().unwrap_or(error)
}

/// LawError(message, which), with `offset`, `length` and `suggestion`.
pub(crate) fn from_law(error: law::LawError) -> PyErr {
    let python_error = LawError::new_err((error.message, error.field.as_str()));
    with_attributes(python_error, None, |python_error| {
        python_error.setattr("offset", error.offset)?;
        python_error.setattr("length", error.length)?;
        python_error.setattr("suggestion", error.suggestion)
    })
}

create_exception!(
    ergon._core,
    UnstableError,
    EngineError,
    "The scheme would diverge at this rate; `module` moves most."
);
create_exception!(
    ergon._core,
    DivergedError,
    EngineError,
    "A part went non-finite while it ran; `frame` is the sample index."
);

/// EngineError about a module or an argument.
pub(crate) fn module_error(module: &str, message: impl Display) -> PyErr {
    indexed_error(module, message, None)
}

/// The same about one element of it, such as a point of a gesture; `index` counts from 0.
fn indexed_error(module: &str, message: impl Display, index: Option<usize>) -> PyErr {
    let python_error = EngineError::new_err(format!("{module}: {message}"));
    with_attributes(python_error, Some(module), |python_error| {
        python_error.setattr("index", index)?;
        python_error.setattr("sentence", message.to_string())
    })
}

/// EngineError with a sentence about one hand; `index` is its number, which Python replaces by the name of its player.
pub(crate) fn hand_error(sentence: impl Display, hand: usize) -> PyErr {
    let python_error = EngineError::new_err(sentence.to_string());
    with_attributes(python_error, None, |python_error| python_error.setattr("index", hand))
}

/// EngineError about a gesture; `index` is that of the point at fault, if one is.
pub(crate) fn from_gesture(argument: &str, error: &GestureError) -> PyErr {
    indexed_error(argument, error, error.point())
}

/// EngineError or UnstableError that names the module; for several faults, an EngineError with each fault in
/// `refusals`.
pub(crate) fn from_engine(error: network::Error) -> PyErr {
    let (message, sentence) = (error.to_string(), error.sentence());
    let (python_error, module) = match &error {
        network::Error::Refused { module, .. } => (EngineError::new_err(message), Some(module)),
        network::Error::Unstable { module, .. } => (UnstableError::new_err(message), Some(module)),
        network::Error::Several(_) => (EngineError::new_err(message), None),
    };
    let python_error = with_attributes(python_error, module.map(String::as_str), |python_error| {
        python_error.setattr("sentence", sentence)
    });
    let network::Error::Several(inner_errors) = error else {
        return python_error;
    };
    let refusals: Vec<PyErr> = inner_errors.into_iter().map(from_engine).collect();
    Python::attach(|py| python_error.value(py).setattr("refusals", refusals).err()).unwrap_or(python_error)
}

/// DivergedError that names the module and the frame.
pub(crate) fn from_fault(fault: Fault) -> PyErr {
    let python_error = DivergedError::new_err(fault.to_string());
    with_attributes(python_error, Some(&fault.module), |python_error| {
        python_error.setattr("frame", fault.frame)
    })
}

/// EngineError for a file that cannot be written; its `module` is "record".
pub(crate) fn unwritten(sentence: impl Display) -> PyErr {
    let python_error = EngineError::new_err(sentence.to_string());
    with_attributes(python_error, Some("record"), |_| Ok(()))
}

/// The value of a word in the table `words`; EngineError that lists the known words.
pub(crate) fn parse_choice<T: Copy>(argument: &str, word_text: &str, words: &[(&str, T)]) -> PyResult<T> {
    let matched = words
        .iter()
        .find(|(word, _)| *word == word_text)
        .map(|(_, value)| *value);
    matched.ok_or_else(|| {
        let known_words: Vec<&str> = words.iter().map(|(word, _)| *word).collect();
        module_error(argument, format!("'{word_text}' is none of {}", known_words.join(", ")))
    })
}

/// A rate; EngineError if `rate` is not a possible rate [Hz].
pub(crate) fn hertz(rate: f64) -> PyResult<Rate> {
    Rate::new(rate).map_err(|error| module_error("rate", error))
}

/// EngineError with a sentence and without a module.
pub(crate) fn plain_error(sentence: impl Display) -> PyErr {
    with_attributes(EngineError::new_err(sentence.to_string()), None, |_| Ok(()))
}
