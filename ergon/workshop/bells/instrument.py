"""A bell as an instrument of the score language: a hammer, and a body that it strikes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ergon.common.errors import ErgonError
from ergon.notation.text.errors import quote
from ergon.workshop.bells import contact
from ergon.workshop.bells.bell import Bell
from ergon.workshop.bells.chain import chain

PLACE_MASS = 0.2  # [kg] of the place that is struck, beside a hammer of 8 g
_IMPULSE = (  # [N·s] of a hammer that jumps back without loss
    2.0 * contact.HAMMER * PLACE_MASS / (contact.HAMMER + PLACE_MASS) * contact.SPEED
)
_FULL_SCALE = 10.0  # [m/s] of a SOV, where a score gives no level
LISTENED = "mic"
_FORMS = ("modes", "cels", "chain")
_WIDTH = 110


class FormError(ErgonError):
    """A bell that cannot be written in this form; the message says why, and which forms it can
    have.
    """


def text(bell: Bell, instrument_name: str = "bell", form: str = "modes") -> str:
    """The file of an instrument, with the measured figures in its comments. Raises FormError."""
    if form not in _FORMS:
        raise FormError(f"{quote(form)} is not a form of a bell; write modes, cels or chain")
    body = {"modes": _modes, "cels": _cels, "chain": _chain}[form]
    header_lines = [f"# {line}".rstrip() for line in _head(bell, form)]
    yaml_lines = [
        "ergon: 1",
        "instruments:",
        f"  {instrument_name}:",
        f"    f: {_number(bell.pitch)}Hz",
    ]
    yaml_lines += [
        "    modules:",
        *_hammer(),
    ]
    return "\n".join([*header_lines, *yaml_lines, *body(bell)]) + "\n"


def _head(bell: Bell, network_form: str) -> Iterator[str]:
    yield f"{len(bell.f)} modes, struck at {', '.join(bell.places)}."
    for stroke in bell.strokes:
        length = "" if stroke.contact is None else f", contact {1e3 * stroke.contact:.2g} ms"
        share = f"{100.0 * stroke.explained:.2f} % of its energy explained"
        yield f"{stroke.name} at {stroke.place}: impulse {stroke.impulse:.3g}{length}, {share}"
    yield "Masses are chosen, for a recording tells levels only."
    if network_form == "modes":
        loud = f"{20.0 * np.log10(bell.reference):.1f} dBFS"
        loudness_note = " as in the recording" if bell.strokes else ""
        yield (
            f"A hammer at {contact.SPEED:g} m/s makes the loudest mode {loud} loud{loudness_note}."
        )
    yield "A key gives the hammer a push, and stops before `gap`:"
    yield "  {BUT: {between: [k1, bell.hammer], K: 4kN/m, Z: 2Ns/m}}"


def _hammer() -> list[str]:
    """A hammer that hardly loses speed on its way, and lands on a rail when it comes back."""
    k, z = 4e4 * contact.HAMMER, 4e3 * contact.HAMMER
    return [
        f"      hammer: {{CEL: {{M: {contact.HAMMER * 1e3:g}g, f: 0.3Hz, t60: 10s}}}}",
        "      rail: {SOL: {}}",
        f"      check: {{BUT: {{between: [rail, hammer], K: {k:g}N/m, Z: {z:g}Ns/m}}}}",
    ]


def _mass(bell: Bell) -> float:
    """The mass of a mode with level 1, chosen so that the first place is as heavy as wanted."""
    return PLACE_MASS * float(np.sum(bell.levels[:, 0] ** 2))


def _contact_line(bell: Bell, place_name: str, instrument_name: str = "felt") -> str:
    k = contact.stiffness(bell.contact)
    return (
        f"      {instrument_name}: "
        f"{{BUT: {{between: [hammer, {place_name}], K: {k:.4g}, exponent: 1.5, gap: "
        "7mm}}"
    )


def _modes(bell: Bell) -> list[str]:
    levels_by_place = {name: bell.levels[:, i] for i, name in enumerate(bell.places)}
    # A push J of a mode M moves it at φ·J/M [m/s].
    levels_by_place[LISTENED] = bell.listened * (
        bell.reference * _FULL_SCALE * _mass(bell) / _IMPULSE
    )
    yaml_rows = ["      body:", "        MODES:", f"          M: {_number(_mass(bell) * 1e3)}g"]
    yaml_rows += _list("          f: ", [f"{_number(f)}Hz" for f in bell.f])
    yaml_rows += _list("          t60: ", [f"{_number(t, 6)}s" for t in bell.t60])
    yaml_rows.append("          places:")
    for name, levels in levels_by_place.items():
        yaml_rows += _list(f"            {name}: ", [_number(level, 6) for level in levels])
    yaml_rows.append(_contact_line(bell, f"body.{bell.places[0]}"))
    return [*yaml_rows, f"    out: {{SOV: body.{LISTENED}}}"]


def _cels(bell: Bell) -> list[str]:
    weight = np.abs(bell.levels[:, 0] * bell.listened)
    cel_mass = PLACE_MASS * float(np.sum(weight))
    yaml_rows, link_rows = [], []
    for i, (f, t60, modal_weight) in enumerate(zip(bell.f, bell.t60, weight, strict=True), 1):
        grams = _number(1e3 * cel_mass / max(modal_weight, 1e-9))
        yaml_rows.append(
            f"      p{i}: {{CEL: {{M: {grams}g, f: {_number(f)}Hz, t60: {_number(t60, 6)}s}}}}"
        )
        link_rows.append(_contact_line(bell, f"p{i}", f"b{i}"))
    names = _list("    out: {SOV: ", [f"p{i}" for i in range(1, len(bell.f) + 1)])
    return [*yaml_rows, *link_rows, *names[:-1], names[-1] + "}"]


def _chain(bell: Bell) -> list[str]:
    weight = np.abs(bell.levels[:, 0] * bell.listened)
    try:
        built_chain = chain(bell.f, bell.t60, weight, PLACE_MASS)
    except ValueError as error:
        raise FormError(f"{error}; write the bell as modes") from None
    yaml_rows = ["      wall: {SOL: {}}"]
    last_mass = len(built_chain.masses)
    for i, (m, z) in enumerate(zip(built_chain.masses, built_chain.grounds, strict=True), 1):
        yaml_rows.append(f"      m{i}: {{MAS: {{M: {_number(m * 1e3)}g}}}}")
        if z > 0.0 and i < last_mass:
            yaml_rows.append(f"      z{i}: {{FRO: {{between: [wall, m{i}], Z: {_number(z)}}}}}")
    for i, (k, z) in enumerate(zip(built_chain.springs, built_chain.dampers, strict=True), 1):
        end_names = f"[m{i}, m{i + 1}]" if i < last_mass else f"[m{i}, wall]"
        z += built_chain.grounds[-1] if i == last_mass else 0.0
        yaml_rows.append(
            f"      s{i}: {{REF: {{between: {end_names}, K: {_number(k)}, Z: {_number(z)}}}}}"
        )
    return [*yaml_rows, _contact_line(bell, "m1"), "    out: {SOV: m1}"]


def _number(value: float, digits: int = 10) -> str:
    return f"{float(value):.{digits}g}"


def _list(line_head: str, list_words: Sequence[str]) -> list[str]:
    """`head [a, b, …]`, broken into lines of limited width."""
    yaml_lines, yaml_line = [], line_head + "["
    for i, list_word in enumerate(list_words):
        list_word += "]" if i == len(list_words) - 1 else ","
        if len(yaml_line) + len(list_word) > _WIDTH:
            yaml_lines.append(yaml_line.rstrip())
            yaml_line = " " * (len(line_head) + 1)
        yaml_line += (
            list_word if yaml_line.endswith("[") or not yaml_line.strip() else f" {list_word}"
        )
    return [*yaml_lines, yaml_line]
