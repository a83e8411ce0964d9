"""Outputs of a model of Synth-A-Modeler: outputs as sums, and their routes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from ergon.notation.text.errors import quote
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.page import Line, Output, gain_option, number_text
from ergon.workshop.models.sam.reading import Statement
from ergon.workshop.models.sam.values import Mix
from ergon.workshop.models.sam.words import LINKS
from ergon.workshop.models.sam.writing import ScoreDraft, target_text

_CHANNELS_MAX = 1_024
# A spring so weak [N/m] that its force on the mass is lost in rounding.
_SENSING_STIFFNESS = 1e-12


def audible_names(statements: Sequence[Statement]) -> dict[str, Mix]:
    """The names that an expression of an output may use; the name of a port stands for the force on
    it.
    """
    mix_by_name = {}
    signs_by_port: dict[str, dict[str, float]] = {}
    for statement in statements:
        if statement.word in LINKS:
            for end, sign in zip(statement.ends, (-1.0, 1.0), strict=True):
                signs_by_port.setdefault(end, {})[statement.name] = sign
    for statement in statements:
        if statement.word == "port":
            mix_by_name[statement.name] = Mix(signs_by_port.get(statement.name, {}))
        elif statement.word in LINKS or statement.word in (
            "mass",
            "resonators",
            "ground",
        ):
            mix_by_name[statement.name] = Mix({statement.name: 1.0})
    return mix_by_name


def force_signs(
    draft: ScoreDraft, statements: Sequence[Statement], sounds: Iterable[Mix]
) -> dict[str, float]:
    """The sign with which the force of each link is heard. Raises ModelError if it is heard with
    both.
    """
    sign_by_link: dict[str, float] = {}
    for statement, sound in zip(statements, sounds, strict=True):
        for link_name, factor in sound.terms.items():
            if link_name not in draft.links or factor == 0.0:
                continue
            if sign_by_link.setdefault(link_name, math.copysign(1.0, factor)) != math.copysign(
                1.0, factor
            ):
                message = (
                    f"the force of {quote(link_name)} is heard with both signs, which is not built"
                )
                raise ModelError(message, statement.line)
    return sign_by_link


def add_channel(draft: ScoreDraft, statement: Statement, sound: Mix, channel: int) -> None:
    """Add the outputs and routes of a channel. Raises ModelError."""
    if channel > _CHANNELS_MAX:
        raise ModelError(f"more than {_CHANNELS_MAX:,} outputs", statement.line)
    factor_by_name = {name: factor for name, factor in sound.terms.items() if factor != 0.0}
    ground_names = [
        name
        for name in factor_by_name
        if name in draft.masses and draft.masses[name].kind == "ground"
    ]
    constant = sound.constant + sum(
        factor_by_name.pop(name) * draft.masses[name].x0 for name in ground_names
    )
    if constant != 0.0 and not any(sound_filter.order for sound_filter in sound.filters):
        raise ModelError(f"a constant of {constant:g} is not a sound; leave it out", statement.line)
    highpass, comment = _highpass(sound)
    for output_number, (name, factor) in enumerate(factor_by_name.items(), 1):
        out_name = draft.module_names[statement.name]
        if len(factor_by_name) > 1:
            out_name = draft.names.new(f"{out_name}_{output_number}")
        gain = abs(factor)
        if name in draft.links:
            module_text, draft.hears_forces = _force(draft, draft.module_names[name]), True
        elif factor > 0.0:
            module_text = f"SOX: {target_text(draft, name)}"
        else:
            module_text, gain = (
                _force(draft, _sensing_spring(draft, name)),
                gain / _SENSING_STIFFNESS,
            )
        remark = "; ".join(
            remark_part
            for remark_part in (comment, statement.comment if output_number == 1 else "")
            if remark_part
        )
        route_options = gain_option(gain)
        if highpass is not None:
            route_options += f", highpass: {number_text(highpass)}Hz"
        draft.outputs.append(Output(out_name, module_text, channel, route_options, remark))


def _force(draft: ScoreDraft, name: str) -> str:
    kind = next(module.kind for module in draft.modules if module.name == name)
    return f"SOF: {{{kind}: {name}}}"


def _sensing_spring(draft: ScoreDraft, mass_name: str) -> str:
    """Add a spring whose force is a position with a negative factor, which a route cannot have;
    returns its name.
    """
    if mass_name in draft.position_springs:
        return draft.position_springs[mass_name]
    if "" not in draft.position_springs:
        draft.position_springs[""] = draft.names.new("still")
        draft.modules.append(Line(draft.position_springs[""], "{SOL: {}}"))
    spring = draft.position_springs[mass_name] = draft.names.new(
        f"{draft.module_names[mass_name]}_ear"
    )
    ends = f"{draft.position_springs['']}, {target_text(draft, mass_name)}"
    text = f"{{RES: {{between: [{ends}], K: {_SENSING_STIFFNESS}}}}}"
    comment = "too weak to be felt: it is heard, for a factor below 0"
    draft.modules.append(Line(spring, text, comment))
    return spring


def _highpass(sound: Mix) -> tuple[float | None, str]:
    """The high-pass of a route, of second order, and a comment on it."""
    filters = [stage for stage in sound.filters if stage.order]
    filter_texts = [f"highpass({highpass.order}, {highpass.cutoff:g})" for highpass in filters]
    remarks = ["the model's limiter is left out"] if len(filters) < len(sound.filters) else []
    if not filters:
        return None, "; ".join(remarks)
    order = sum(highpass.order for highpass in filters)
    weighted_log_cutoffs = sum(highpass.order * math.log(highpass.cutoff) for highpass in filters)
    cutoff = (
        filters[0].cutoff if len(filters) == 1 else round(math.exp(weighted_log_cutoffs / order), 3)
    )
    if not (len(filters) == 1 and order == 2):
        remarks.insert(0, f"{' : '.join(filter_texts)} in the model; a route has one of order 2")
    return cutoff, "; ".join(remarks)
