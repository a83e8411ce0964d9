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
from ergon.workshop.models.sam.heard import hear, heard_names, sides_of
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

_FARTHEST, _FASTEST = 1e3, 1e6  # [m], [m/s] of a score
_HELD = "1e9"  # mass of what is moved whatever pushes it
_MOST_MODES = 500


def written(
    sheet: Sheet, inputs: Mapping[str, Input], given: Mapping[str, float], title: str
) -> str:
    """The text of a score with the same sound as a model. Raises ModelError with the line at fault.

    `inputs` are files that drive ports, by their names; `given` are values of parameters.
    """
    code = definitions(sheet.code)
    ids = {one.name: one for one in sheet.statements}
    for name in set(code) & set(ids):
        message = f"{quote(name)} is a name of a line of Faust too, line {code[name].line}"
        raise ModelError(message, ids[name].line)
    for name in given:
        if name not in code or code[name].arguments:
            near = nearest(name, code)
            raise ModelError(f"the model has no parameter {quote(name)}", 0, near)
    if "fs" in code:
        message = f"fs is the rate of the library, {RATE:,} Hz; it has no other"
        raise ModelError(message, code["fs"].line)
    values = Values({**LIBRARY, **code}, heard_names(sheet.statements), given)
    sixty = next(name for name in ("sixty", *(f"sixty{n}" for n in code)) if name not in code)
    own = Writing(sheet, inputs, values, Params(["fs", *code, sixty]), sixty=sixty)
    let(own, "fs", str(RATE), "samples in a second")
    if not any(one.word in (*MASSES, *LINKS) for one in sheet.statements):
        raise ModelError("it has no mass and no link, of which a score is made")
    for one in sheet.statements:
        own.targets[one.name] = own.names.new(one.name)
    for one in sheet.statements:
        if one.word in MASSES:
            _count(own, one)
    for one in sheet.statements:
        if one.word in LINKS:
            _join(own, one)
    begin = start(own.masses, list(own.links.values()))
    outputs = [one for one in sheet.statements if one.word == "audioout"]
    sounds = [own.values.sound(one.values[0], one.line) for one in outputs]
    sides = sides_of(own, outputs, sounds)
    for one in sheet.statements:
        if one.word in MASSES:
            _MAKERS[one.word](own, one, begin)
        elif one.word in LINKS:
            _link(own, one, sides.get(one.name, 1.0))
    for channel, (one, sound) in enumerate(zip(outputs, sounds, strict=True), 1):
        hear(own, one, sound, channel)
    return page(own, title, begin, len(outputs)).written()


# --- masses -------------------------------------------------------------------------------------


def _count(own: Writing, one: Statement) -> None:
    """Compute the values of a mass."""
    if one.word == "resonators":
        found = _resonances(own, one)
        mobility = sum(each.mobility for each in found)
        own.masses[one.name] = Mass(one.word, 0.0, 0.0, mobility, len(found) > 1)
        return
    if one.word == "port":
        fed = own.inputs.get(one.name)
        own.masses[one.name] = Mass(one.word, 0.0 if fed is None else fed.first, 0.0, 0.0)
        return
    if one.word == "ground":
        x0 = value_of(own, one, 0)
        within(one, "x0", x0, _FARTHEST)
        own.masses[one.name] = Mass(one.word, x0, 0.0, 0.0)
        return
    m = value_of(own, one, 0)
    if m <= 0.0:
        raise ModelError(f"m is {m:g}: a mass is above 0", one.line)
    mobility = 1.0 / (m * RATE * RATE)
    own.masses[one.name] = Mass(one.word, value_of(own, one, 1), value_of(own, one, 2), mobility)


def _resonances(own: Writing, one: Statement) -> list[Resonance]:
    found = []
    for at in range(0, len(one.values), 3):
        each = Resonance(*(value_of(own, one, at + nth) for nth in range(3)))
        if not 0.0 < each.f < RATE / 2:
            message = f"f is {each.f:g} Hz: a frequency lies between 0 and half of {RATE:,} Hz"
            raise ModelError(message, one.line)
        for name, value in (("T60", each.T60), ("m", each.m)):
            if not 1e-9 < value < 1e9:
                raise ModelError(f"{name} is {value:g}: it lies above 1e-9, below 1e9", one.line)
        found.append(each)
    if len(found) > _MOST_MODES:
        raise ModelError(f"resonators have at most {_MOST_MODES} modes", one.line)
    return found


def _begin(own: Writing, one: Statement, begin: Start) -> list[str]:
    """X0 and V0; they stay expressions if no force acts in the first sample."""
    mass = own.masses[one.name]
    x, v = begin.places[one.name], begin.steps[one.name] * RATE
    within(one, "x0", x, _FARTHEST)
    within(one, "the speed at the beginning", v, _FASTEST)
    is_free = one.word == "mass" and begin.steps[one.name] == mass.v0 / RATE
    fields = []
    if x:
        fields.append(f"X0: {unit_of(text_of(own, one, 1), 'm') if is_free else f'{x!r}m'}")
    if v:
        fields.append(f"V0: {unit_of(text_of(own, one, 2), 'm/s') if is_free else f'{v!r}m/s'}")
    return fields


def _mass(own: Writing, one: Statement, begin: Start) -> None:
    fields = [f"M: {times(text_of(own, one, 0), 'fs*fs')}", *_begin(own, one, begin)]
    own.add(f"MAS: {{{', '.join(fields)}}}", one)


def _ground(own: Writing, one: Statement, _: Start) -> None:
    x0 = own.masses[one.name].x0
    own.add(f"SOL: {{X0: {unit_of(text_of(own, one, 0), 'm')}}}" if x0 else "SOL: {}", one)


def _port(own: Writing, one: Statement, _: Start) -> None:
    fed, name = own.inputs.get(one.name), own.targets[one.name]
    if fed is None:
        own.add("SOL: {}", one, "a port, where a device was")
        return
    x0 = f", X0: {fed.first!r}m" if fed.first else ""
    own.add(f"MAS: {{M: {_HELD}{x0}}}", one, "a port; its mass says nothing: its path is imposed")
    path = own.names.new(f"{name}_path")
    own.modules.append(Line(path, f"{{ENX: {{to: {name}, from: {one.name}{fed.start}}}}}"))


def _resonators(own: Writing, one: Statement, begin: Start) -> None:
    found = _resonances(own, one)
    sixty = own.params.of[own.sixty]
    if sixty not in own.parameters:
        comment = "60 dB are 6.907755 time constants, and T60 of the model 6.9078"
        let(own, own.sixty, repr(SIXTY), comment, unit="s")
    values = range(0, len(one.values), 3)
    pitches = [unit_of(text_of(own, one, at), "Hz") for at in values]
    decays = [times(text_of(own, one, at + 1), sixty) for at in values]
    mass = f"M: {times(text_of(own, one, 2), f'fs*fs*{found[0].heavier!r}')}"
    if len(found) == 1:
        fields = [mass, f"f: {pitches[0]}", f"t60: {decays[0]}", *_begin(own, one, begin)]
        own.add(f"CEL: {{{', '.join(fields)}}}", one)
        return
    if begin.places[one.name]:
        message = "an offset presses on these resonators before the first sample, and a MODES "
        raise ModelError(f"{message}begins at 0; write the offset into a ground", one.line)
    levels = [math.sqrt(each.mobility / found[0].mobility) for each in found]
    shape = ", ".join(map(number, levels))
    body = f"f: [{', '.join(pitches)}], t60: [{', '.join(decays)}]"
    own.add(f"MODES: {{{mass}, {body}, places: {{point: [{shape}]}}}}", one)


_MAKERS = {"mass": _mass, "ground": _ground, "port": _port, "resonators": _resonators}


# --- links --------------------------------------------------------------------------------------


def _join(own: Writing, one: Statement) -> None:
    """Compute the values of a link."""
    for end in one.ends:
        if end not in own.masses:
            near = nearest(end, own.masses)
            raise ModelError(f"no mass is called {quote(end)}", one.line, near)
    a, b = one.ends
    if a == b:
        raise ModelError(f"it joins {quote(a)} to itself", one.line)
    k, R, o = (value_of(own, one, at) for at in range(3))
    within(one, "o", o, _FARTHEST)
    own.links[one.name] = Link(one.word, a, b, k, R, o)


def _link(own: Writing, one: Statement, side: float) -> None:
    """Add a link with its ends in order, or reversed if -F is heard."""
    link = own.links[one.name]
    ends = [target(own, name) for name in one.ends]
    k, R, o = (text_of(own, one, at) for at in range(3))
    is_touch, is_turned = one.word == "touch", side < 0.0
    if is_turned:
        ends.reverse()
    said = [f"between: [{', '.join(ends)}]"]
    # d is x_b - x_a - rest in a score, and x_a - x_b - o in the language.
    rest = unit_of(o if is_turned else number(-link.o) if _is_literal(o) else f"-({o})", "m")
    at_rest = [f"rest: {rest}"] if link.o else []
    if link.k < 0.0 or link.R < 0.0:
        laws = ["k*d", "z*v"]
        if is_touch:
            reached = "d > 0" if is_turned else "d < 0"
            laws = [f"where({reached}, {law}, 0)" for law in laws]
        said += [f'law: "{laws[0]}", damping: "{laws[1]}"']
        said += [f"k: {number(link.k)}, z: {number(link.R * RATE)}", *at_rest]
        own.add(f"LNL: {{{', '.join(said)}}}", one, "below 0 it gives energy")
        return
    K, Z = f"K: {k}", f"Z: {times(R, 'fs')}"
    if is_touch:
        gap = [f"gap: {unit_of(o, 'm')}"] if link.o else []
        said += [K, *([Z] if link.R else []), *gap, *(["side: above"] if is_turned else [])]
        own.add(f"BUT: {{{', '.join(said)}}}", one)
    elif link.k and link.R:
        own.add(f"REF: {{{', '.join([*said, K, Z, *at_rest])}}}", one)
    elif link.R:
        own.add(f"FRO: {{{', '.join([*said, Z])}}}", one)
    else:
        own.add(f"RES: {{{', '.join([*said, K, *at_rest])}}}", one)


def _is_literal(text: str) -> bool:
    return metres(text) == f"{text}m"
