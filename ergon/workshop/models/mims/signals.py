"""Values of a model that follow a signal, and the points of a score that have its values."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ergon.notation.text.errors import quote
from ergon.workshop.models.mims.model import Statement
from ergon.workshop.models.mims.proxies import Along, signals_in, straight
from ergon.workshop.models.mims.writing import Writing
from ergon.workshop.models.page import RATE, Input

_HELD = "1e9"  # mass of what is moved whatever pushes it: no link is too stiff for it


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


def value_of(writing: Writing, statement: Statement, name: str) -> Value:
    """A value that may follow a signal; a constant if that signal has no file. Raises
    ModelError.
    """
    text = statement.values.get(name, "0")
    if not signals_in(writing.model, text):
        number = writing.value(statement, name)
        return Value(writing.text(statement, name), number, number, number)
    side = straight(writing.model, text, f"{name} of {quote(statement.name)}", statement.line)
    source = writing.inputs.get(writing.model.signals[side.signal]) if side.signal else None
    if source is None or source.least == source.greatest:
        signal = 0.0 if source is None else source.first
        number = side.start + side.slope * signal
        return Value(repr(number), number, number, number)
    positions = [side.start + side.slope * s for s in (source.first, source.least, source.greatest)]
    return Value("", positions[0], min(positions[1:]), max(positions[1:]), side)


def following(writing: Writing, value: Value, *, is_ahead: bool = False) -> str:
    """How a value follows a signal, as the field of a module; with `is_ahead` it follows the next
    sample.

    The value is that of the model while the signal stays within the range of its file.
    """
    side = value.along
    if side is None or side.signal is None:
        raise AssertionError("a constant follows nothing")
    source = writing.inputs[writing.model.signals[side.signal]]
    low, high = (side.start + side.slope * signal for signal in (source.least, source.greatest))
    mat = guide(writing, side.signal, is_ahead=is_ahead)
    span = source.greatest - source.least
    offset = "" if source.least == 0.0 else f", offset: {-source.least!r}m"
    return f"{{of: {mat}, from: {low!r}, to: {high!r}{offset}, span: {span!r}m}}"


def guide(writing: Writing, signal: str, *, is_ahead: bool = False) -> str:
    """The name of the point that has the values of a signal, or those of its next sample."""
    source = writing.model.signals[signal]
    # The next sample of OSC is not known yet.
    is_ahead &= source in writing.inputs and writing.inputs[source].file is not None
    signal_text = f"{signal} ahead" if is_ahead else signal
    if signal_text not in writing.guides:
        if is_ahead:
            writing.ahead[source] = _next(writing, source)
            writing.guides[signal_text] = fed(writing, f"{signal}_ahead", writing.ahead[source])
        else:
            writing.guides[signal_text] = fed(writing, signal, source)
    return writing.guides[signal_text]


def _next(writing: Writing, source: str) -> str:
    """The name of a take that is one sample ahead of an input's take."""
    if source not in writing.ahead:
        fed = writing.inputs[source]
        stop = f"{(fed.n_frames - 1) / RATE!r}s"
        name = writing.ahead[source] = f"{source}_ahead"
        trim = f"{1 / RATE!r}s..{stop}"
        writing.takes[name] = replace(fed, first=fed.second, trim=trim)
    return writing.ahead[source]


def fed(writing: Writing, take_name: str, source: str) -> str:
    """Add a point that has the values of an input or a take; returns its name."""
    takes: dict[str, Input] = {**writing.inputs, **writing.takes}
    take, name = takes.get(source), writing.names.new(take_name)
    if take is None:
        writing.add(name, "SOL: {}", "an input that nothing is connected to is 0")
        return name
    x0 = "" if take.first == 0.0 else f", X0: {take.first!r}m"
    writing.add(name, f"MAS: {{M: {_HELD}{x0}}}", "its mass says nothing, for its path is imposed")
    path = writing.names.new(f"{name}_path")
    writing.add(path, f"ENX: {{to: {name}, from: {source}{take.start}}}")
    return name
