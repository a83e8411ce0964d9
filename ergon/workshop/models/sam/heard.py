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
    signs_by_port: dict[str, dict[str, float]] = {}
    for statement in statements:
        if statement.word in LINKS:
            for end, sign in zip(statement.ends, (-1.0, 1.0), strict=True):
                signs_by_port.setdefault(end, {})[statement.name] = sign
    for statement in statements:
        if statement.word == "port":
            sound_by_name[statement.name] = Sound(signs_by_port.get(statement.name, {}))
        elif statement.word in LINKS or statement.word in (
            "mass",
            "resonators",
            "ground",
        ):
            sound_by_name[statement.name] = Sound({statement.name: 1.0})
    return sound_by_name


def sides_of(
    writing: Writing, statements: Sequence[Statement], sounds: Iterable[Sound]
) -> dict[str, float]:
    """The sign with which the force of each link is heard. Raises ModelError if it is heard with
    both.
    """
    sides_by_link: dict[str, float] = {}
    for statement, sound in zip(statements, sounds, strict=True):
        for link_name, factor in sound.terms.items():
            if link_name not in writing.links or factor == 0.0:
                continue
            if sides_by_link.setdefault(link_name, math.copysign(1.0, factor)) != math.copysign(
                1.0, factor
            ):
                message = (
                    f"the force of {quote(link_name)} is heard with both signs, which is not built"
                )
                raise ModelError(message, statement.line)
    return sides_by_link


def hear(writing: Writing, statement: Statement, sound: Sound, channel_number: int) -> None:
    """Add the outputs and routes of a channel. Raises ModelError."""
    if channel_number > _CHANNELS_MAX:
        raise ModelError(f"more than {_CHANNELS_MAX:,} outputs", statement.line)
    factors = {name: factor for name, factor in sound.terms.items() if factor != 0.0}
    ground_names = [
        name for name in factors if name in writing.masses and writing.masses[name].kind == "ground"
    ]
    constant = sound.constant + sum(
        factors.pop(name) * writing.masses[name].x0 for name in ground_names
    )
    if constant != 0.0 and not any(sound_filter.order for sound_filter in sound.filters):
        raise ModelError(f"a constant of {constant:g} is not a sound; leave it out", statement.line)
    highpass, comment = _filter(sound)
    for nth, (name, factor) in enumerate(factors.items(), 1):
        out_name = writing.targets[statement.name]
        if len(factors) > 1:
            out_name = writing.names.new(f"{out_name}_{nth}")
        factor_size = abs(factor)
        if name in writing.links:
            module_text, writing.hears_forces = _force(writing, writing.targets[name]), True
        elif factor > 0.0:
            module_text = f"SOX: {target(writing, name)}"
        else:
            module_text, factor_size = _force(writing, _ear(writing, name)), factor_size / _EAR
        remark = "; ".join(
            remark_part
            for remark_part in (comment, statement.behind if nth == 1 else "")
            if remark_part
        )
        route_options = gain(factor_size)
        if highpass is not None:
            route_options += f", highpass: {number(highpass)}Hz"
        writing.outs.append(Out(out_name, module_text, channel_number, route_options, remark))


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


def _filter(sound: Sound) -> tuple[float | None, str]:
    """The high-pass of a route, of second order, and a comment on it."""
    highpasses = [highpass for highpass in sound.filters if highpass.order]
    filter_texts = [f"highpass({highpass.order}, {highpass.cutoff:g})" for highpass in highpasses]
    remarks = ["the model's limiter is left out"] if len(highpasses) < len(sound.filters) else []
    if not highpasses:
        return None, "; ".join(remarks)
    filter_order = sum(highpass.order for highpass in highpasses)
    weighted_log_cutoffs = sum(
        highpass.order * math.log(highpass.cutoff) for highpass in highpasses
    )
    cutoff = (
        highpasses[0].cutoff
        if len(highpasses) == 1
        else round(math.exp(weighted_log_cutoffs / filter_order), 3)
    )
    if not (len(highpasses) == 1 and filter_order == 2):
        remarks.insert(0, f"{' : '.join(filter_texts)} in the model; a route has one of order 2")
    return cutoff, "; ".join(remarks)
