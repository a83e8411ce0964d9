"""Values of a model that follow a signal, and the points of a score that have its values."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ergon.notation.text.errors import quote
from ergon.workshop.models.mims.model import Statement
from ergon.workshop.models.mims.proxies import Along, signals_in, straight
from ergon.workshop.models.mims.writing import Writing
from ergon.workshop.models.page import RATE, Input

_IMPOSED_MASS = "1e9"  # mass of what is moved whatever pushes it: no link is too stiff for it


@dataclass(frozen=True, slots=True)
class Value:
    """A value of a statement: an expression, or a linear function of a signal, with its least and
    most.

    `first` is its value in the first step.
    """

    text: str
    first: float
    least: float
    greatest: float
    along: Along | None = None


def value_of(writing: Writing, model_statement: Statement, value_name: str) -> Value:
    """A value that may follow a signal; a constant if that signal has no file. Raises
    ModelError.
    """
    value_text = model_statement.values.get(value_name, "0")
    if not signals_in(writing.model, value_text):
        constant_number = writing.value(model_statement, value_name)
        return Value(
            writing.text(model_statement, value_name),
            constant_number,
            constant_number,
            constant_number,
        )
    linear_side = straight(
        writing.model,
        value_text,
        f"{value_name} of {quote(model_statement.name)}",
        model_statement.line,
    )
    signal_source = (
        writing.inputs.get(writing.model.signals[linear_side.signal])
        if linear_side.signal
        else None
    )
    if signal_source is None or signal_source.least == signal_source.greatest:
        signal = 0.0 if signal_source is None else signal_source.first
        constant_number = linear_side.start + linear_side.slope * signal
        return Value(repr(constant_number), constant_number, constant_number, constant_number)
    signal_positions = [
        linear_side.start + linear_side.slope * s
        for s in (signal_source.first, signal_source.least, signal_source.greatest)
    ]
    return Value(
        "", signal_positions[0], min(signal_positions[1:]), max(signal_positions[1:]), linear_side
    )


def following(writing: Writing, led_value: Value, *, is_ahead: bool = False) -> str:
    """How a value follows a signal, as the field of a module; with `is_ahead` it follows the next
    sample.

    The value is that of the model while the signal stays within the range of its file.
    """
    side = led_value.along
    if side is None or side.signal is None:
        raise AssertionError("a constant follows nothing")
    input_source = writing.inputs[writing.model.signals[side.signal]]
    low_value, high_value = (
        side.start + side.slope * signal for signal in (input_source.least, input_source.greatest)
    )
    mat = guide(writing, side.signal, is_ahead=is_ahead)
    span = input_source.greatest - input_source.least
    offset = "" if input_source.least == 0.0 else f", offset: {-input_source.least!r}m"
    return f"{{of: {mat}, from: {low_value!r}, to: {high_value!r}{offset}, span: {span!r}m}}"


def guide(writing: Writing, signal_name: str, *, is_ahead: bool = False) -> str:
    """The name of the point that has the values of a signal, or those of its next sample."""
    signal_source = writing.model.signals[signal_name]
    # The next sample of OSC is not known yet.
    is_ahead &= signal_source in writing.inputs and writing.inputs[signal_source].file is not None
    signal_text = f"{signal_name} ahead" if is_ahead else signal_name
    if signal_text not in writing.guides:
        if is_ahead:
            writing.ahead[signal_source] = _next(writing, signal_source)
            writing.guides[signal_text] = fed(
                writing, f"{signal_name}_ahead", writing.ahead[signal_source]
            )
        else:
            writing.guides[signal_text] = fed(writing, signal_name, signal_source)
    return writing.guides[signal_text]


def _next(writing: Writing, input_name: str) -> str:
    """The name of a take that is one sample ahead of an input's take."""
    if input_name not in writing.ahead:
        fed = writing.inputs[input_name]
        stop = f"{(fed.n_frames - 1) / RATE!r}s"
        name = writing.ahead[input_name] = f"{input_name}_ahead"
        trim = f"{1 / RATE!r}s..{stop}"
        writing.takes[name] = replace(fed, first=fed.second, trim=trim)
    return writing.ahead[input_name]


def fed(writing: Writing, take_name: str, take_source: str) -> str:
    """Add a point that has the values of an input or a take; returns its name."""
    takes: dict[str, Input] = {**writing.inputs, **writing.takes}
    take, point_name = takes.get(take_source), writing.names.new(take_name)
    if take is None:
        writing.add(point_name, "SOL: {}", "an input that nothing is connected to is 0")
        return point_name
    x0 = "" if take.first == 0.0 else f", X0: {take.first!r}m"
    writing.add(
        point_name,
        f"MAS: {{M: {_IMPOSED_MASS}{x0}}}",
        "its mass says nothing, for its path is imposed",
    )
    path = writing.names.new(f"{point_name}_path")
    writing.add(path, f"ENX: {{to: {point_name}, from: {take_source}{take.start}}}")
    return point_name
