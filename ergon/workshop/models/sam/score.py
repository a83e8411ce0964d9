"""A model of Synth-A-Modeler as a score under `units: ca`, which sounds the same."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ergon.notation.text.errors import quote
from ergon.notation.text.spelling import nearest
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.naming import Params, metres
from ergon.workshop.models.page import Input, Line, number
from ergon.workshop.models.sam.expressions import definitions
from ergon.workshop.models.sam.heard import audible_names, hear, sides_of
from ergon.workshop.models.sam.network import SIXTY, Link, Mass, Resonance, Start, start
from ergon.workshop.models.sam.page import page
from ergon.workshop.models.sam.reading import Sheet, Statement
from ergon.workshop.models.sam.values import LIBRARY, Values
from ergon.workshop.models.sam.words import LINKS, MASSES, RATE
from ergon.workshop.models.sam.writing import (
    Writing,
    let,
    target,
    text_of,
    times,
    unit_of,
    value_of,
    within,
)

_DISTANCE_MAX, _SPEED_MAX = 1e3, 1e6  # [m], [m/s] of a score
_IMPOSED_MASS = "1e9"  # mass of what is moved whatever pushes it
_MODES_MAX = 500


def written(
    sheet: Sheet,
    inputs_by_name: Mapping[str, Input],
    overrides: Mapping[str, float],
    score_title: str,
) -> str:
    """The text of a score with the same sound as a model. Raises ModelError with the line at fault.

    `inputs_by_name` are files that drive ports, by their names; `overrides` are values of
    parameters.
    """
    code = definitions(sheet.code)
    ids = {statement.name: statement for statement in sheet.statements}
    for override_name in set(code) & set(ids):
        message = (
            f"{quote(override_name)} is a name of a line of Faust too, line "
            f"{code[override_name].line}"
        )
        raise ModelError(message, ids[override_name].line)
    for override_name in overrides:
        if override_name not in code or code[override_name].arguments:
            suggestion = nearest(override_name, code)
            raise ModelError(f"the model has no parameter {quote(override_name)}", 0, suggestion)
    if "fs" in code:
        message = f"fs is the rate of the library, {RATE:,} Hz; it has no other"
        raise ModelError(message, code["fs"].line)
    values = Values({**LIBRARY, **code}, audible_names(sheet.statements), overrides)
    sixty = next(name for name in ("sixty", *(f"sixty{n}" for n in code)) if name not in code)
    writing = Writing(sheet, inputs_by_name, values, Params(["fs", *code, sixty]), sixty=sixty)
    let(writing, "fs", str(RATE), "samples in a second")
    if not any(statement.word in (*MASSES, *LINKS) for statement in sheet.statements):
        raise ModelError("it has no mass and no link, of which a score is made")
    for model_statement in sheet.statements:
        writing.targets[model_statement.name] = writing.names.new(model_statement.name)
    for model_statement in sheet.statements:
        if model_statement.word in MASSES:
            _count(writing, model_statement)
    for model_statement in sheet.statements:
        if model_statement.word in LINKS:
            _join(writing, model_statement)
    start_state = start(writing.masses, list(writing.links.values()))
    output_statements = [
        statement for statement in sheet.statements if statement.word == "audioout"
    ]
    sounds = [
        writing.values.sound(statement.values[0], statement.line) for statement in output_statements
    ]
    sides = sides_of(writing, output_statements, sounds)
    for model_statement in sheet.statements:
        if model_statement.word in MASSES:
            _MAKERS[model_statement.word](writing, model_statement, start_state)
        elif model_statement.word in LINKS:
            _link(writing, model_statement, sides.get(model_statement.name, 1.0))
    for channel, (model_statement, output_sound) in enumerate(
        zip(output_statements, sounds, strict=True), 1
    ):
        hear(writing, model_statement, output_sound, channel)
    return page(writing, score_title, start_state, len(output_statements)).written()


# --- masses -------------------------------------------------------------------------------------


def _count(writing: Writing, model_statement: Statement) -> None:
    """Compute the values of a mass."""
    if model_statement.word == "resonators":
        resonances = _resonances(writing, model_statement)
        mobility = sum(resonance.mobility for resonance in resonances)
        writing.masses[model_statement.name] = Mass(
            model_statement.word, 0.0, 0.0, mobility, len(resonances) > 1
        )
        return
    if model_statement.word == "port":
        fed = writing.inputs.get(model_statement.name)
        writing.masses[model_statement.name] = Mass(
            model_statement.word, 0.0 if fed is None else fed.first, 0.0, 0.0
        )
        return
    if model_statement.word == "ground":
        x0 = value_of(writing, model_statement, 0)
        within(model_statement, "x0", x0, _DISTANCE_MAX)
        writing.masses[model_statement.name] = Mass(model_statement.word, x0, 0.0, 0.0)
        return
    m = value_of(writing, model_statement, 0)
    if m <= 0.0:
        raise ModelError(f"m is {m:g}: a mass is above 0", model_statement.line)
    mobility = 1.0 / (m * RATE * RATE)
    writing.masses[model_statement.name] = Mass(
        model_statement.word,
        value_of(writing, model_statement, 1),
        value_of(writing, model_statement, 2),
        mobility,
    )


def _resonances(writing: Writing, model_statement: Statement) -> list[Resonance]:
    resonances = []
    for first_value in range(0, len(model_statement.values), 3):
        resonance = Resonance(
            *(value_of(writing, model_statement, first_value + nth) for nth in range(3))
        )
        if not 0.0 < resonance.f < RATE / 2:
            message = f"f is {resonance.f:g} Hz: a frequency lies between 0 and half of {RATE:,} Hz"
            raise ModelError(message, model_statement.line)
        for value_name, resonance_value in (("T60", resonance.T60), ("m", resonance.m)):
            if not 1e-9 < resonance_value < 1e9:
                raise ModelError(
                    f"{value_name} is {resonance_value:g}: it lies above 1e-9, below 1e9",
                    model_statement.line,
                )
        resonances.append(resonance)
    if len(resonances) > _MODES_MAX:
        raise ModelError(f"resonators have at most {_MODES_MAX} modes", model_statement.line)
    return resonances


def _begin(writing: Writing, model_statement: Statement, start_state: Start) -> list[str]:
    """X0 and V0; they stay expressions if no force acts in the first sample."""
    model_mass = writing.masses[model_statement.name]
    x, v = start_state.places[model_statement.name], start_state.steps[model_statement.name] * RATE
    within(model_statement, "x0", x, _DISTANCE_MAX)
    within(model_statement, "the speed at the beginning", v, _SPEED_MAX)
    is_free = (
        model_statement.word == "mass"
        and start_state.steps[model_statement.name] == model_mass.v0 / RATE
    )
    module_fields = []
    if x:
        module_fields.append(
            f"X0: {unit_of(text_of(writing, model_statement, 1), 'm') if is_free else f'{x!r}m'}"
        )
    if v:
        module_fields.append(
            "V0: "
            f"{unit_of(text_of(writing, model_statement, 2), 'm/s') if is_free else f'{v!r}m/s'}"
        )
    return module_fields


def _mass(writing: Writing, statement: Statement, start_state: Start) -> None:
    mass_fields = [
        f"M: {times(text_of(writing, statement, 0), 'fs*fs')}",
        *_begin(writing, statement, start_state),
    ]
    writing.add(f"MAS: {{{', '.join(mass_fields)}}}", statement)


def _ground(writing: Writing, statement: Statement, _: Start) -> None:
    x0 = writing.masses[statement.name].x0
    writing.add(
        f"SOL: {{X0: {unit_of(text_of(writing, statement, 0), 'm')}}}" if x0 else "SOL: {}",
        statement,
    )


def _port(writing: Writing, model_statement: Statement, _: Start) -> None:
    fed, port_name = writing.inputs.get(model_statement.name), writing.targets[model_statement.name]
    if fed is None:
        writing.add("SOL: {}", model_statement, "a port, where a device was")
        return
    x0 = f", X0: {fed.first!r}m" if fed.first else ""
    writing.add(
        f"MAS: {{M: {_IMPOSED_MASS}{x0}}}",
        model_statement,
        "a port; its mass says nothing: its path is imposed",
    )
    path = writing.names.new(f"{port_name}_path")
    writing.modules.append(
        Line(path, f"{{ENX: {{to: {port_name}, from: {model_statement.name}{fed.start}}}}}")
    )


def _resonators(writing: Writing, model_statement: Statement, start_state: Start) -> None:
    resonances = _resonances(writing, model_statement)
    sixty = writing.params.new_names[writing.sixty]
    if sixty not in writing.parameters:
        comment = "60 dB are 6.907755 time constants, and T60 of the model 6.9078"
        let(writing, writing.sixty, repr(SIXTY), comment, unit_name="s")
    value_indices = range(0, len(model_statement.values), 3)
    pitches = [
        unit_of(text_of(writing, model_statement, value_index), "Hz")
        for value_index in value_indices
    ]
    decays = [
        times(text_of(writing, model_statement, value_index + 1), sixty)
        for value_index in value_indices
    ]
    mass_text = (
        f"M: {times(text_of(writing, model_statement, 2), f'fs*fs*{resonances[0].heavier!r}')}"
    )
    if len(resonances) == 1:
        cel_fields = [
            mass_text,
            f"f: {pitches[0]}",
            f"t60: {decays[0]}",
            *_begin(writing, model_statement, start_state),
        ]
        writing.add(f"CEL: {{{', '.join(cel_fields)}}}", model_statement)
        return
    if start_state.places[model_statement.name]:
        message = "an offset presses on these resonators before the first sample, and a MODES "
        raise ModelError(
            f"{message}begins at 0; write the offset into a ground", model_statement.line
        )
    levels = [math.sqrt(resonance.mobility / resonances[0].mobility) for resonance in resonances]
    shape = ", ".join(map(number, levels))
    body = f"f: [{', '.join(pitches)}], t60: [{', '.join(decays)}]"
    writing.add(f"MODES: {{{mass_text}, {body}, places: {{point: [{shape}]}}}}", model_statement)


_MAKERS = {"mass": _mass, "ground": _ground, "port": _port, "resonators": _resonators}


# --- links --------------------------------------------------------------------------------------


def _join(writing: Writing, model_statement: Statement) -> None:
    """Compute the values of a link."""
    for link_end in model_statement.ends:
        if link_end not in writing.masses:
            suggestion = nearest(link_end, writing.masses)
            raise ModelError(
                f"no mass is called {quote(link_end)}", model_statement.line, suggestion
            )
    a, b = model_statement.ends
    if a == b:
        raise ModelError(f"it joins {quote(a)} to itself", model_statement.line)
    k, R, o = (value_of(writing, model_statement, value_index) for value_index in range(3))
    within(model_statement, "o", o, _DISTANCE_MAX)
    writing.links[model_statement.name] = Link(model_statement.word, a, b, k, R, o)


def _link(writing: Writing, model_statement: Statement, side: float) -> None:
    """Add a link with its ends in order, or reversed if -F is heard."""
    model_link = writing.links[model_statement.name]
    end_names = [target(writing, name) for name in model_statement.ends]
    k, R, o = (text_of(writing, model_statement, value_index) for value_index in range(3))
    is_touch, is_turned = model_statement.word == "touch", side < 0.0
    if is_turned:
        end_names.reverse()
    written_fields = [f"between: [{', '.join(end_names)}]"]
    # d is x_b - x_a - rest in a score, and x_a - x_b - o in the language.
    rest_text = unit_of(
        o if is_turned else number(-model_link.o) if _is_literal(o) else f"-({o})", "m"
    )
    rest_field = [f"rest: {rest_text}"] if model_link.o else []
    if model_link.k < 0.0 or model_link.R < 0.0:
        laws = ["k*d", "z*v"]
        if is_touch:
            reached = "d > 0" if is_turned else "d < 0"
            laws = [f"where({reached}, {law}, 0)" for law in laws]
        written_fields += [f'law: "{laws[0]}", damping: "{laws[1]}"']
        written_fields += [
            f"k: {number(model_link.k)}, z: {number(model_link.R * RATE)}",
            *rest_field,
        ]
        writing.add(
            f"LNL: {{{', '.join(written_fields)}}}", model_statement, "below 0 it gives energy"
        )
        return
    K, Z = f"K: {k}", f"Z: {times(R, 'fs')}"
    if is_touch:
        gap = [f"gap: {unit_of(o, 'm')}"] if model_link.o else []
        written_fields += [
            K,
            *([Z] if model_link.R else []),
            *gap,
            *(["side: above"] if is_turned else []),
        ]
        writing.add(f"BUT: {{{', '.join(written_fields)}}}", model_statement)
    elif model_link.k and model_link.R:
        writing.add(f"REF: {{{', '.join([*written_fields, K, Z, *rest_field])}}}", model_statement)
    elif model_link.R:
        writing.add(f"FRO: {{{', '.join([*written_fields, Z])}}}", model_statement)
    else:
        writing.add(f"RES: {{{', '.join([*written_fields, K, *rest_field])}}}", model_statement)


def _is_literal(text: str) -> bool:
    return metres(text) == f"{text}m"
