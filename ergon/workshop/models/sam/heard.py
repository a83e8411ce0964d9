"""Outputs of a model of Synth-A-Modeler: outputs as sums, and their routes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from ergon.notation.text.errors import quote
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.page import Line, Out, gain, number
from ergon.workshop.models.sam.reading import Statement
from ergon.workshop.models.sam.values import Sound
from ergon.workshop.models.sam.words import LINKS
from ergon.workshop.models.sam.writing import Writing, target

_CHANNELS_MAX = 1_024
# A spring so weak [N/m] that its force on the mass is lost in rounding.
_EAR = 1e-12


def audible_names(statements: Sequence[Statement]) -> dict[str, Sound]:
    """The names that an expression of an output may use; the name of a port stands for the force on
    it.
    """
    sound_by_name = {}
    forces_by_port: dict[str, dict[str, float]] = {}
    for model_statement in statements:
        if model_statement.word in LINKS:
            for end, sign in zip(model_statement.ends, (-1.0, 1.0), strict=True):
                forces_by_port.setdefault(end, {})[model_statement.name] = sign
    for model_statement in statements:
        if model_statement.word == "port":
            sound_by_name[model_statement.name] = Sound(
                forces_by_port.get(model_statement.name, {})
            )
        elif model_statement.word in LINKS or model_statement.word in (
            "mass",
            "resonators",
            "ground",
        ):
            sound_by_name[model_statement.name] = Sound({model_statement.name: 1.0})
    return sound_by_name


def sides_of(
    writing: Writing, output_statements: Sequence[Statement], sounds: Iterable[Sound]
) -> dict[str, float]:
    """The sign with which the force of each link is heard. Raises ModelError if it is heard with
    both.
    """
    sides_by_link: dict[str, float] = {}
    for output_statement, sound in zip(output_statements, sounds, strict=True):
        for term_name, factor in sound.terms.items():
            if term_name not in writing.links or factor == 0.0:
                continue
            if sides_by_link.setdefault(term_name, math.copysign(1.0, factor)) != math.copysign(
                1.0, factor
            ):
                message = (
                    f"the force of {quote(term_name)} is heard with both signs, which is not built"
                )
                raise ModelError(message, output_statement.line)
    return sides_by_link


def hear(
    writing: Writing, model_statement: Statement, output_sound: Sound, channel_number: int
) -> None:
    """Add the outputs and routes of a channel. Raises ModelError."""
    if channel_number > _CHANNELS_MAX:
        raise ModelError(f"more than {_CHANNELS_MAX:,} outputs", model_statement.line)
    signal_factors = {name: factor for name, factor in output_sound.terms.items() if factor != 0.0}
    fixed_masses = [
        name
        for name in signal_factors
        if name in writing.masses and writing.masses[name].kind == "ground"
    ]
    constant = output_sound.constant + sum(
        signal_factors.pop(name) * writing.masses[name].x0 for name in fixed_masses
    )
    if constant != 0.0 and not any(sound_filter.order for sound_filter in output_sound.filters):
        raise ModelError(
            f"a constant of {constant:g} is not a sound; leave it out", model_statement.line
        )
    highpass, comment = _filter(output_sound)
    for nth, (signal_name, signal_factor) in enumerate(signal_factors.items(), 1):
        out = writing.targets[model_statement.name]
        if len(signal_factors) > 1:
            out = writing.names.new(f"{out}_{nth}")
        loudness = abs(signal_factor)
        if signal_name in writing.links:
            output_text, writing.hears_forces = _force(writing, writing.targets[signal_name]), True
        elif signal_factor > 0.0:
            output_text = f"SOX: {target(writing, signal_name)}"
        else:
            output_text, loudness = _force(writing, _ear(writing, signal_name)), loudness / _EAR
        output_note = "; ".join(
            word for word in (comment, model_statement.behind if nth == 1 else "") if word
        )
        route_options = gain(loudness)
        if highpass is not None:
            route_options += f", highpass: {number(highpass)}Hz"
        writing.outs.append(Out(out, output_text, channel_number, route_options, output_note))


def _force(writing: Writing, name: str) -> str:
    kind = next(module.kind for module in writing.modules if module.name == name)
    return f"SOF: {{{kind}: {name}}}"


def _ear(writing: Writing, mass_name: str) -> str:
    """Add a spring whose force is a position with a negative factor, which a route cannot have;
    returns its name.
    """
    if mass_name in writing.ears:
        return writing.ears[mass_name]
    if "" not in writing.ears:
        writing.ears[""] = writing.names.new("still")
        writing.modules.append(Line(writing.ears[""], "{SOL: {}}"))
    ear = writing.ears[mass_name] = writing.names.new(f"{writing.targets[mass_name]}_ear")
    text = f"{{RES: {{between: [{writing.ears['']}, {target(writing, mass_name)}], K: {_EAR}}}}}"
    comment = "too weak to be felt: it is heard, for a factor below 0"
    writing.modules.append(Line(ear, text, comment))
    return ear


def _filter(output_sound: Sound) -> tuple[float | None, str]:
    """The high-pass of a route, of second order, and a comment on it."""
    highs = [highpass for highpass in output_sound.filters if highpass.order]
    filter_texts = [f"highpass({highpass.order}, {highpass.cutoff:g})" for highpass in highs]
    limited = ["the model's limiter is left out"] if len(highs) < len(output_sound.filters) else []
    if not highs:
        return None, "; ".join(limited)
    filter_order = sum(highpass.order for highpass in highs)
    logs = sum(highpass.order * math.log(highpass.cutoff) for highpass in highs)
    cutoff = highs[0].cutoff if len(highs) == 1 else round(math.exp(logs / filter_order), 3)
    if not (len(highs) == 1 and filter_order == 2):
        limited.insert(0, f"{' : '.join(filter_texts)} in the model; a route has one of order 2")
    return cutoff, "; ".join(limited)
