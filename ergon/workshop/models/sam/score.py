"""A model of Synth-A-Modeler as a score under `units: ca`, which sounds the same."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ergon.notation.text.errors import quote
from ergon.notation.text.spelling import nearest
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.naming import Params, length_text
from ergon.workshop.models.page import Input, Line, number_text
from ergon.workshop.models.sam.expressions import parse_definitions
from ergon.workshop.models.sam.heard import add_channel, audible_names, force_signs
from ergon.workshop.models.sam.network import (
    T60_RATIO,
    InitialState,
    Link,
    Mass,
    Resonance,
    initial_state,
)
from ergon.workshop.models.sam.page import page
from ergon.workshop.models.sam.reading import Sheet, Statement
from ergon.workshop.models.sam.values import LIBRARY, Values
from ergon.workshop.models.sam.words import LINKS, MASSES, RATE
from ergon.workshop.models.sam.writing import (
    ScoreDraft,
    add_parameter,
    check_range,
    product_of,
    target_text,
    text_of,
    value_of,
    with_unit,
)

_DISTANCE_MAX, _SPEED_MAX = 1e3, 1e6  # [m], [m/s] of a score
_IMPOSED_MASS = "1e9"  # mass of what is moved whatever pushes it
_MODES_MAX = 500


def score_text(
    sheet: Sheet,
    inputs: Mapping[str, Input],
    overrides: Mapping[str, float],
    score_title: str,
) -> str:
    """The text of a score with the same sound as a model. Raises ModelError with the line at fault.

    `inputs` are files that drive ports, by their names; `overrides` are values of
    parameters.
    """
    faust_definitions = parse_definitions(sheet.code)
    statement_by_name = {statement.name: statement for statement in sheet.statements}
    for override_name in set(faust_definitions) & set(statement_by_name):
        message = (
            f"{quote(override_name)} is a name of a line of Faust too, line "
            f"{faust_definitions[override_name].line}"
        )
        raise ModelError(message, statement_by_name[override_name].line)
    for override_name in overrides:
        if override_name not in faust_definitions or faust_definitions[override_name].arguments:
            suggestion = nearest(override_name, faust_definitions)
            raise ModelError(f"the model has no parameter {quote(override_name)}", 0, suggestion)
    if "fs" in faust_definitions:
        message = f"fs is the rate of the library, {RATE:,} Hz; it has no other"
        raise ModelError(message, faust_definitions["fs"].line)
    values = Values({**LIBRARY, **faust_definitions}, audible_names(sheet.statements), overrides)
    t60_name = next(
        name
        for name in ("sixty", *(f"sixty{n}" for n in faust_definitions))
        if name not in faust_definitions
    )
    draft = ScoreDraft(
        sheet, inputs, values, Params(["fs", *faust_definitions, t60_name]), t60_parameter=t60_name
    )
    add_parameter(draft, "fs", str(RATE), "samples in a second")
    if not any(statement.word in (*MASSES, *LINKS) for statement in sheet.statements):
        raise ModelError("it has no mass and no link, of which a score is made")
    for statement in sheet.statements:
        draft.module_names[statement.name] = draft.names.new(statement.name)
    for statement in sheet.statements:
        if statement.word in MASSES:
            _read_mass(draft, statement)
    for statement in sheet.statements:
        if statement.word in LINKS:
            _read_link(draft, statement)
    start_state = initial_state(draft.masses, list(draft.links.values()))
    output_statements = [
        statement for statement in sheet.statements if statement.word == "audioout"
    ]
    sounds = [
        draft.values.mix(statement.values[0], statement.line) for statement in output_statements
    ]
    signs_by_link = force_signs(draft, output_statements, sounds)
    for statement in sheet.statements:
        if statement.word in MASSES:
            _MAKERS[statement.word](draft, statement, start_state)
        elif statement.word in LINKS:
            _add_link(draft, statement, signs_by_link.get(statement.name, 1.0))
    for channel, (statement, sound) in enumerate(zip(output_statements, sounds, strict=True), 1):
        add_channel(draft, statement, sound, channel)
    return page(draft, score_title, start_state, len(output_statements)).text()


# --- masses -------------------------------------------------------------------------------------


def _read_mass(draft: ScoreDraft, statement: Statement) -> None:
    """Compute the values of a mass."""
    if statement.word == "resonators":
        resonances = _resonances(draft, statement)
        mobility = sum(resonance.mobility for resonance in resonances)
        draft.masses[statement.name] = Mass(statement.word, 0.0, 0.0, mobility, len(resonances) > 1)
        return
    if statement.word == "port":
        source = draft.inputs.get(statement.name)
        draft.masses[statement.name] = Mass(
            statement.word, 0.0 if source is None else source.first_sample, 0.0, 0.0
        )
        return
    if statement.word == "ground":
        x0 = value_of(draft, statement, 0)
        check_range(statement, "x0", x0, _DISTANCE_MAX)
        draft.masses[statement.name] = Mass(statement.word, x0, 0.0, 0.0)
        return
    mass = value_of(draft, statement, 0)
    if mass <= 0.0:
        raise ModelError(f"m is {mass:g}: a mass is above 0", statement.line)
    mobility = 1.0 / (mass * RATE * RATE)
    draft.masses[statement.name] = Mass(
        statement.word,
        value_of(draft, statement, 1),
        value_of(draft, statement, 2),
        mobility,
    )


def _resonances(draft: ScoreDraft, statement: Statement) -> list[Resonance]:
    resonances = []
    for first_index in range(0, len(statement.values), 3):
        resonance = Resonance(
            *(value_of(draft, statement, first_index + offset) for offset in range(3))
        )
        if not 0.0 < resonance.f < RATE / 2:
            message = f"f is {resonance.f:g} Hz: a frequency lies between 0 and half of {RATE:,} Hz"
            raise ModelError(message, statement.line)
        for value_name, resonance_value in (("T60", resonance.T60), ("m", resonance.m)):
            if not 1e-9 < resonance_value < 1e9:
                raise ModelError(
                    f"{value_name} is {resonance_value:g}: it lies above 1e-9, below 1e9",
                    statement.line,
                )
        resonances.append(resonance)
    if len(resonances) > _MODES_MAX:
        raise ModelError(f"resonators have at most {_MODES_MAX} modes", statement.line)
    return resonances


def _start_fields(draft: ScoreDraft, statement: Statement, start_state: InitialState) -> list[str]:
    """X0 and V0; they stay expressions if no force acts in the first sample."""
    mass = draft.masses[statement.name]
    position, speed = (
        start_state.positions[statement.name],
        start_state.steps[statement.name] * RATE,
    )
    check_range(statement, "x0", position, _DISTANCE_MAX)
    check_range(statement, "the speed at the beginning", speed, _SPEED_MAX)
    is_as_written = statement.word == "mass" and start_state.steps[statement.name] == mass.v0 / RATE
    fields = []
    if position:
        text = with_unit(text_of(draft, statement, 1), "m") if is_as_written else f"{position!r}m"
        fields.append(f"X0: {text}")
    if speed:
        text = with_unit(text_of(draft, statement, 2), "m/s") if is_as_written else f"{speed!r}m/s"
        fields.append(f"V0: {text}")
    return fields


def _add_mass(draft: ScoreDraft, statement: Statement, start_state: InitialState) -> None:
    fields = [
        f"M: {product_of(text_of(draft, statement, 0), 'fs*fs')}",
        *_start_fields(draft, statement, start_state),
    ]
    draft.add(f"MAS: {{{', '.join(fields)}}}", statement)


def _add_ground(draft: ScoreDraft, statement: Statement, _: InitialState) -> None:
    x0 = draft.masses[statement.name].x0
    draft.add(
        f"SOL: {{X0: {with_unit(text_of(draft, statement, 0), 'm')}}}" if x0 else "SOL: {}",
        statement,
    )


def _add_port(draft: ScoreDraft, statement: Statement, _: InitialState) -> None:
    source, port_name = draft.inputs.get(statement.name), draft.module_names[statement.name]
    if source is None:
        draft.add("SOL: {}", statement, "a port, where a device was")
        return
    x0 = f", X0: {source.first_sample!r}m" if source.first_sample else ""
    draft.add(
        f"MAS: {{M: {_IMPOSED_MASS}{x0}}}",
        statement,
        "a port; its mass says nothing: its path is imposed",
    )
    path = draft.names.new(f"{port_name}_path")
    draft.modules.append(
        Line(path, f"{{ENX: {{to: {port_name}, from: {statement.name}{source.start_field_text}}}}}")
    )


def _add_resonators(draft: ScoreDraft, statement: Statement, start_state: InitialState) -> None:
    resonances = _resonances(draft, statement)
    t60_name = draft.params.names_in_score[draft.t60_parameter]
    if t60_name not in draft.parameters:
        comment = "60 dB are 6.907755 time constants, and T60 of the model 6.9078"
        add_parameter(draft, draft.t60_parameter, repr(T60_RATIO), comment, unit="s")
    first_indices = range(0, len(statement.values), 3)
    frequencies = [
        with_unit(text_of(draft, statement, first_index), "Hz") for first_index in first_indices
    ]
    decays = [
        product_of(text_of(draft, statement, first_index + 1), t60_name)
        for first_index in first_indices
    ]
    mass_field = (
        f"M: {product_of(text_of(draft, statement, 2), f'fs*fs*{resonances[0].mass_ratio!r}')}"
    )
    if len(resonances) == 1:
        fields = [
            mass_field,
            f"f: {frequencies[0]}",
            f"t60: {decays[0]}",
            *_start_fields(draft, statement, start_state),
        ]
        draft.add(f"CEL: {{{', '.join(fields)}}}", statement)
        return
    if start_state.positions[statement.name]:
        message = "an offset presses on these resonators before the first sample, and a MODES "
        raise ModelError(f"{message}begins at 0; write the offset into a ground", statement.line)
    levels = [math.sqrt(resonance.mobility / resonances[0].mobility) for resonance in resonances]
    levels_text = ", ".join(map(number_text, levels))
    mode_fields = f"f: [{', '.join(frequencies)}], t60: [{', '.join(decays)}]"
    draft.add(
        f"MODES: {{{mass_field}, {mode_fields}, places: {{point: [{levels_text}]}}}}", statement
    )


_MAKERS = {
    "mass": _add_mass,
    "ground": _add_ground,
    "port": _add_port,
    "resonators": _add_resonators,
}


# --- links --------------------------------------------------------------------------------------


def _read_link(draft: ScoreDraft, statement: Statement) -> None:
    """Compute the values of a link."""
    for mass_name in statement.ends:
        if mass_name not in draft.masses:
            suggestion = nearest(mass_name, draft.masses)
            raise ModelError(f"no mass is called {quote(mass_name)}", statement.line, suggestion)
    a, b = statement.ends
    if a == b:
        raise ModelError(f"it joins {quote(a)} to itself", statement.line)
    k, R, o = (value_of(draft, statement, value_index) for value_index in range(3))
    check_range(statement, "o", o, _DISTANCE_MAX)
    draft.links[statement.name] = Link(statement.word, a, b, k, R, o)


def _add_link(draft: ScoreDraft, statement: Statement, force_sign: float) -> None:
    """Add a link with its ends in order, or reversed if -F is heard."""
    link = draft.links[statement.name]
    ends = [target_text(draft, name) for name in statement.ends]
    k, R, o = (text_of(draft, statement, value_index) for value_index in range(3))
    is_touch, is_reversed = statement.word == "touch", force_sign < 0.0
    if is_reversed:
        ends.reverse()
    fields = [f"between: [{', '.join(ends)}]"]
    # d is x_b - x_a - rest in a score, and x_a - x_b - o in the language.
    rest = with_unit(
        o if is_reversed else number_text(-link.offset) if _is_literal(o) else f"-({o})", "m"
    )
    rest_field = [f"rest: {rest}"] if link.offset else []
    if link.k < 0.0 or link.R < 0.0:
        laws = ["k*d", "z*v"]
        if is_touch:
            condition = "d > 0" if is_reversed else "d < 0"
            laws = [f"where({condition}, {law}, 0)" for law in laws]
        fields += [f'law: "{laws[0]}", damping: "{laws[1]}"']
        fields += [
            f"k: {number_text(link.k)}, z: {number_text(link.R * RATE)}",
            *rest_field,
        ]
        draft.add(f"LNL: {{{', '.join(fields)}}}", statement, "below 0 it gives energy")
        return
    K, Z = f"K: {k}", f"Z: {product_of(R, 'fs')}"
    if is_touch:
        gap_field = [f"gap: {with_unit(o, 'm')}"] if link.offset else []
        fields += [
            K,
            *([Z] if link.R else []),
            *gap_field,
            *(["side: above"] if is_reversed else []),
        ]
        draft.add(f"BUT: {{{', '.join(fields)}}}", statement)
    elif link.k and link.R:
        draft.add(f"REF: {{{', '.join([*fields, K, Z, *rest_field])}}}", statement)
    elif link.R:
        draft.add(f"FRO: {{{', '.join([*fields, Z])}}}", statement)
    else:
        draft.add(f"RES: {{{', '.join([*fields, K, *rest_field])}}}", statement)


def _is_literal(text: str) -> bool:
    return length_text(text) == f"{text}m"
