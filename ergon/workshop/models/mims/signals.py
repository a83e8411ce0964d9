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
    most: float
    along: Along | None = None


def value_of(own: Writing, one: Statement, name: str) -> Value:
    """A value that may follow a signal; a constant if that signal has no file. Raises
    ModelError.
    """
    text = one.values.get(name, "0")
    if not signals_in(own.model, text):
        number = own.value(one, name)
        return Value(own.text(one, name), number, number, number)
    side = straight(own.model, text, f"{name} of {quote(one.name)}", one.line)
    source = own.inputs.get(own.model.signals[side.signal]) if side.signal else None
    if source is None or source.least == source.most:
        signal = 0.0 if source is None else source.first
        number = side.start + side.slope * signal
        return Value(repr(number), number, number, number)
    at = [side.start + side.slope * s for s in (source.first, source.least, source.most)]
    return Value("", at[0], min(at[1:]), max(at[1:]), side)


def following(own: Writing, value: Value, *, is_ahead: bool = False) -> str:
    """How a value follows a signal, as the field of a module; with `is_ahead` it follows the next
    sample.

    The value is that of the model while the signal stays within the range of its file.
    """
    side = value.along
    if side is None or side.signal is None:
        raise AssertionError("a constant follows nothing")
    source = own.inputs[own.model.signals[side.signal]]
    low, high = (side.start + side.slope * signal for signal in (source.least, source.most))
    mat = guide(own, side.signal, is_ahead=is_ahead)
    span = source.most - source.least
    offset = "" if source.least == 0.0 else f", offset: {-source.least!r}m"
    return f"{{of: {mat}, from: {low!r}, to: {high!r}{offset}, span: {span!r}m}}"


def guide(own: Writing, signal: str, *, is_ahead: bool = False) -> str:
    """The name of the point that has the values of a signal, or those of its next sample."""
    source = own.model.signals[signal]
    # The next sample of OSC is not known yet.
    is_ahead &= source in own.inputs and own.inputs[source].file is not None
    known = f"{signal} ahead" if is_ahead else signal
    if known not in own.guides:
        if is_ahead:
            own.ahead[source] = _next(own, source)
            own.guides[known] = fed(own, f"{signal}_ahead", own.ahead[source])
        else:
            own.guides[known] = fed(own, signal, source)
    return own.guides[known]


def _next(own: Writing, source: str) -> str:
    """The name of a take that is one sample ahead of an input's take."""
    if source not in own.ahead:
        fed = own.inputs[source]
        stop = f"{(fed.n_frames - 1) / RATE!r}s"
        name = own.ahead[source] = f"{source}_ahead"
        trim = f"{1 / RATE!r}s..{stop}"
        own.takes[name] = replace(fed, first=fed.second, trim=trim)
    return own.ahead[source]


def fed(own: Writing, wanted: str, source: str) -> str:
    """Add a point that has the values of an input or a take; returns its name."""
    takes: dict[str, Input] = {**own.inputs, **own.takes}
    found, name = takes.get(source), own.names.new(wanted)
    if found is None:
        own.add(name, "SOL: {}", "an input that nothing is connected to is 0")
        return name
    x0 = "" if found.first == 0.0 else f", X0: {found.first!r}m"
    own.add(name, f"MAS: {{M: {_HELD}{x0}}}", "its mass says nothing, for its path is imposed")
    path = own.names.new(f"{name}_path")
    own.add(path, f"ENX: {{to: {name}, from: {source}{found.start}}}")
    return name
