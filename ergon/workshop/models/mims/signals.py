"""Values of a model that follow a signal, and the points of a score that have its values."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ergon.notation.text.errors import quote
from ergon.workshop.models.mims.model import Statement
from ergon.workshop.models.mims.proxies import Linear, linear_in_signal, signals_in
from ergon.workshop.models.mims.writing import ScoreDraft
from ergon.workshop.models.page import RATE, Input

_IMPOSED_MASS = "1e9"  # mass of what is moved whatever pushes it: no link is too stiff for it


@dataclass(frozen=True, slots=True)
class Value:
    """A value of a statement: an expression, or a linear function of a signal, with its least and
    most.

    `first_value` is its value in the first step.
    """

    text: str
    first_value: float
    value_min: float
    value_max: float
    linear: Linear | None = None


def value_of(draft: ScoreDraft, statement: Statement, name: str) -> Value:
    """A value that may follow a signal; a constant if that signal has no file. Raises
    ModelError.
    """
    text = statement.values.get(name, "0")
    if not signals_in(draft.model, text):
        constant = draft.value(statement, name)
        return Value(
            draft.text(statement, name),
            constant,
            constant,
            constant,
        )
    linear = linear_in_signal(
        draft.model,
        text,
        f"{name} of {quote(statement.name)}",
        statement.line,
    )
    source = draft.inputs.get(draft.model.signals[linear.signal]) if linear.signal else None
    if source is None or source.sample_min == source.sample_max:
        signal_value = 0.0 if source is None else source.first_sample
        constant = linear.offset + linear.slope * signal_value
        return Value(repr(constant), constant, constant, constant)
    values = [
        linear.offset + linear.slope * signal_value
        for signal_value in (source.first_sample, source.sample_min, source.sample_max)
    ]
    return Value("", values[0], min(values[1:]), max(values[1:]), linear)


def signal_field_text(draft: ScoreDraft, value: Value, *, is_ahead: bool = False) -> str:
    """How a value follows a signal, as the field of a module; with `is_ahead` it follows the next
    sample.

    The value is that of the model while the signal stays within the range of its file.
    """
    linear = value.linear
    if linear is None or linear.signal is None:
        raise AssertionError("a constant follows nothing")
    source = draft.inputs[draft.model.signals[linear.signal]]
    value_at_min, value_at_max = (
        linear.offset + linear.slope * signal_value
        for signal_value in (source.sample_min, source.sample_max)
    )
    guide_name = guide_of_signal(draft, linear.signal, is_ahead=is_ahead)
    span = source.sample_max - source.sample_min
    offset = "" if source.sample_min == 0.0 else f", offset: {-source.sample_min!r}m"
    value_range = f"from: {value_at_min!r}, to: {value_at_max!r}"
    return f"{{of: {guide_name}, {value_range}{offset}, span: {span!r}m}}"


def guide_of_signal(draft: ScoreDraft, signal_name: str, *, is_ahead: bool = False) -> str:
    """The name of the point that has the values of a signal, or those of its next sample."""
    input_name = draft.model.signals[signal_name]
    # The next sample of OSC is not known yet.
    is_ahead &= input_name in draft.inputs and draft.inputs[input_name].file is not None
    key = f"{signal_name} ahead" if is_ahead else signal_name
    if key not in draft.guides:
        if is_ahead:
            draft.takes_ahead[input_name] = _take_ahead(draft, input_name)
            draft.guides[key] = add_imposed_point(
                draft, f"{signal_name}_ahead", draft.takes_ahead[input_name]
            )
        else:
            draft.guides[key] = add_imposed_point(draft, signal_name, input_name)
    return draft.guides[key]


def _take_ahead(draft: ScoreDraft, input_name: str) -> str:
    """The name of a take that is one sample ahead of an input's take."""
    if input_name not in draft.takes_ahead:
        source = draft.inputs[input_name]
        end = f"{(source.n_frames - 1) / RATE!r}s"
        name = draft.takes_ahead[input_name] = f"{input_name}_ahead"
        trim = f"{1 / RATE!r}s..{end}"
        draft.takes[name] = replace(source, first_sample=source.second_sample, trim=trim)
    return draft.takes_ahead[input_name]


def add_imposed_point(draft: ScoreDraft, name: str, take_name: str) -> str:
    """Add a point that has the values of an input or a take; returns its name."""
    takes: dict[str, Input] = {**draft.inputs, **draft.takes}
    take, point_name = takes.get(take_name), draft.names.new(name)
    if take is None:
        draft.add(point_name, "SOL: {}", "an input that nothing is connected to is 0")
        return point_name
    x0 = "" if take.first_sample == 0.0 else f", X0: {take.first_sample!r}m"
    draft.add(
        point_name,
        f"MAS: {{M: {_IMPOSED_MASS}{x0}}}",
        "its mass says nothing, for its path is imposed",
    )
    path_name = draft.names.new(f"{point_name}_path")
    draft.add(path_name, f"ENX: {{to: {point_name}, from: {take_name}{take.start_field_text}}}")
    return point_name
