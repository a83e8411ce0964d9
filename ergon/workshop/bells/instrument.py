"""A bell as an instrument of the score language: a hammer, and a body that it strikes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ergon.common.errors import ErgonError
from ergon.notation.text.errors import quote
from ergon.workshop.bells import contact
from ergon.workshop.bells.bell import Bell
from ergon.workshop.bells.chain import build_chain

PLACE_MASS = 0.2  # [kg] of the place that is struck, beside a hammer of 8 g
_IMPULSE = (  # [N·s] of a hammer that jumps back without loss
    2.0
    * contact.HAMMER_MASS
    * PLACE_MASS
    / (contact.HAMMER_MASS + PLACE_MASS)
    * contact.HAMMER_SPEED
)
_FULL_SCALE_SPEED = 10.0  # [m/s] of a SOV, where a score gives no level
LISTENING_PLACE = "mic"
_FORMS = ("modes", "cels", "chain")
_LINE_WIDTH = 110


class FormError(ErgonError):
    """A bell that cannot be written in this form; the message says why, and which forms it can
    have.
    """


def text(bell: Bell, instrument_name: str = "bell", form: str = "modes") -> str:
    """The file of an instrument, with the measured figures in its comments. Raises FormError."""
    if form not in _FORMS:
        raise FormError(f"{quote(form)} is not a form of a bell; write modes, cels or chain")
    body = {"modes": _modes_lines, "cels": _cel_lines, "chain": _chain_lines}[form]
    header_lines = [f"# {line}".rstrip() for line in _header(bell, form)]
    yaml_lines = [
        "ergon: 1",
        "instruments:",
        f"  {instrument_name}:",
        f"    f: {_number(bell.pitch)}Hz",
    ]
    yaml_lines += ["    modules:", *_hammer_lines()]
    return "\n".join([*header_lines, *yaml_lines, *body(bell)]) + "\n"


def _header(bell: Bell, form: str) -> Iterator[str]:
    yield f"{len(bell.f)} modes, struck at {', '.join(bell.places)}."
    for stroke in bell.strokes:
        contact_text = "" if stroke.contact is None else f", contact {1e3 * stroke.contact:.2g} ms"
        explained_text = f"{100.0 * stroke.explained:.2f} % of its energy explained"
        impulse_text = f"impulse {stroke.impulse:.3g}{contact_text}"
        yield f"{stroke.name} at {stroke.place}: {impulse_text}, {explained_text}"
    yield "Masses are chosen, for a recording tells levels only."
    if form == "modes":
        loudness_text = f"{20.0 * np.log10(bell.reference):.1f} dBFS"
        loudness_note = " as in the recording" if bell.strokes else ""
        yield (
            f"A hammer at {contact.HAMMER_SPEED:g} m/s makes the loudest mode {loudness_text} "
            f"loud{loudness_note}."
        )
    yield "A key gives the hammer a push, and stops before `gap`:"
    yield "  {BUT: {between: [k1, bell.hammer], K: 4kN/m, Z: 2Ns/m}}"


def _hammer_lines() -> list[str]:
    """A hammer that hardly loses speed on its way, and lands on a rail when it comes back."""
    k, z = 4e4 * contact.HAMMER_MASS, 4e3 * contact.HAMMER_MASS
    return [
        f"      hammer: {{CEL: {{M: {contact.HAMMER_MASS * 1e3:g}g, f: 0.3Hz, t60: 10s}}}}",
        "      rail: {SOL: {}}",
        f"      check: {{BUT: {{between: [rail, hammer], K: {k:g}N/m, Z: {z:g}Ns/m}}}}",
    ]


def _modal_mass(bell: Bell) -> float:
    """The mass of a mode with level 1, chosen so that the first place is as heavy as wanted."""
    return PLACE_MASS * float(np.sum(bell.levels[:, 0] ** 2))


def _contact_line(bell: Bell, place_name: str, link_name: str = "felt") -> str:
    stiffness = contact.stiffness(bell.contact)
    return (
        f"      {link_name}: "
        f"{{BUT: {{between: [hammer, {place_name}], K: {stiffness:.4g}, exponent: 1.5, gap: "
        "7mm}}"
    )


def _modes_lines(bell: Bell) -> list[str]:
    levels_by_place = {name: bell.levels[:, i] for i, name in enumerate(bell.places)}
    # A push J of a mode M moves it at φ·J/M [m/s].
    levels_by_place[LISTENING_PLACE] = bell.listening_levels * (
        bell.reference * _FULL_SCALE_SPEED * _modal_mass(bell) / _IMPULSE
    )
    lines = ["      body:", "        MODES:", f"          M: {_number(_modal_mass(bell) * 1e3)}g"]
    lines += _wrapped_list("          f: ", [f"{_number(f)}Hz" for f in bell.f])
    lines += _wrapped_list("          t60: ", [f"{_number(t, 6)}s" for t in bell.t60])
    lines.append("          places:")
    for name, levels in levels_by_place.items():
        lines += _wrapped_list(f"            {name}: ", [_number(level, 6) for level in levels])
    lines.append(_contact_line(bell, f"body.{bell.places[0]}"))
    return [*lines, f"    out: {{SOV: body.{LISTENING_PLACE}}}"]


def _cel_lines(bell: Bell) -> list[str]:
    weights = np.abs(bell.levels[:, 0] * bell.listening_levels)
    total_mass = PLACE_MASS * float(np.sum(weights))
    mass_lines, contact_lines = [], []
    for i, (f, t60, weight) in enumerate(zip(bell.f, bell.t60, weights, strict=True), 1):
        mass_grams = _number(1e3 * total_mass / max(weight, 1e-9))
        mass_lines.append(
            f"      p{i}: {{CEL: {{M: {mass_grams}g, f: {_number(f)}Hz, t60: {_number(t60, 6)}s}}}}"
        )
        contact_lines.append(_contact_line(bell, f"p{i}", f"b{i}"))
    out_lines = _wrapped_list("    out: {SOV: ", [f"p{i}" for i in range(1, len(bell.f) + 1)])
    return [*mass_lines, *contact_lines, *out_lines[:-1], out_lines[-1] + "}"]


def _chain_lines(bell: Bell) -> list[str]:
    weights = np.abs(bell.levels[:, 0] * bell.listening_levels)
    try:
        built_chain = build_chain(bell.f, bell.t60, weights, PLACE_MASS)
    except ValueError as error:
        raise FormError(f"{error}; write the bell as modes") from None
    lines = ["      wall: {SOL: {}}"]
    n_masses = len(built_chain.masses)
    for i, (mass, damper) in enumerate(
        zip(built_chain.masses, built_chain.ground_dampers, strict=True), 1
    ):
        lines.append(f"      m{i}: {{MAS: {{M: {_number(mass * 1e3)}g}}}}")
        if damper > 0.0 and i < n_masses:
            lines.append(f"      z{i}: {{FRO: {{between: [wall, m{i}], Z: {_number(damper)}}}}}")
    for i, (spring, damper) in enumerate(
        zip(built_chain.springs, built_chain.dampers, strict=True), 1
    ):
        ends = f"[m{i}, m{i + 1}]" if i < n_masses else f"[m{i}, wall]"
        damper += built_chain.ground_dampers[-1] if i == n_masses else 0.0
        lines.append(
            f"      s{i}: {{REF: {{between: {ends}, K: {_number(spring)}, Z: {_number(damper)}}}}}"
        )
    return [*lines, _contact_line(bell, "m1"), "    out: {SOV: m1}"]


def _number(number: float, digits: int = 10) -> str:
    return f"{float(number):.{digits}g}"


def _wrapped_list(head: str, words: Sequence[str]) -> list[str]:
    """`head [a, b, …]`, broken into lines of limited width."""
    lines, line = [], head + "["
    for i, word in enumerate(words):
        word += "]" if i == len(words) - 1 else ","
        if len(line) + len(word) > _LINE_WIDTH:
            lines.append(line.rstrip())
            line = " " * (len(head) + 1)
        line += word if line.endswith("[") or not line.strip() else f" {word}"
    return [*lines, line]
