"""Masses and links of pmpd as a score under `units: ca`: a bang of pmpd, or a sample of pmpd~, is a
sample of the score.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.exact_numbers import nudge_to_goal
from ergon.workshop.models.naming import Names
from ergon.workshop.models.page import RATE, Input, Line, Out, Page, gain, number
from ergon.workshop.models.pmpd.bang import first_bang
from ergon.workshop.models.pmpd.network import Asked, Link, Mass, Network, Port
from ergon.workshop.models.pmpd.strings import Row, rows
from ergon.workshop.models.pmpd.tables import springs

_LENGTH_BOUND = 1e6  # bounds of a length beyond which pmpd's own default lies
_DISTANCE_MAX, _SPEED_MAX = 1e3, 1e6  # [m], [m/s] of a score
_IMPOSED_MASS = "1e9"  # mass of what is moved whatever pushes it
_CHANNELS_MAX = 99
_NO_LETTER = re.compile(r"\W", re.ASCII)


@dataclass(slots=True)
class _Writing:
    network: Network
    inputs: Mapping[str, Input]
    names: Names = field(default_factory=Names)
    masses: list[str] = field(default_factory=list)
    modules: list[Line] = field(default_factory=list)
    kicks: dict[int, float] = field(default_factory=dict)  # forces in the first sample
    moved: dict[int, Port] = field(default_factory=dict)  # masses that an inlet puts somewhere
    outs: list[Out] = field(default_factory=list)
    ground: str = ""
    joined: set[int] = field(default_factory=set)  # links within strings, by their places

    def add(self, name_wanted: str, text: str, comment: str = "") -> str:
        """Add a module; returns its name."""
        name = self.names.new(name_wanted)
        self.modules.append(Line(name, f"{{{text}}}", comment))
        return name


def written(network: Network, inputs_by_name: Mapping[str, Input], score_title: str) -> str:
    """The text of a score that moves as the object does. Raises ModelError with the line at fault.

    `inputs_by_name` are files by `in0`, `in1` …, the inlets of pmpd~.
    """
    writing = _Writing(network, inputs_by_name)
    if network.kind == "pmpd":
        writing.kicks = first_bang(network)
    else:
        writing.kicks = {
            mass_index: mass.f for mass_index, mass in enumerate(network.masses) if mass.f
        }
        for port in network.ports:
            if port.what == "inPos":
                writing.moved[port.mass] = port
    _masses(writing)
    for nth, link in enumerate([*network.links, *network.nl_links]):
        if nth not in writing.joined:
            _link(writing, nth, link)
    _feeds(writing)
    _outputs(writing)
    return _page(writing, score_title).written()


# --- masses -------------------------------------------------------------------------------------


def _masses(writing: _Writing) -> None:
    counts_by_class: dict[str, int] = {}
    for mass in writing.network.masses:
        counts_by_class[mass.class_name] = counts_by_class.get(mass.class_name, 0) + 1
    last_index_by_class: dict[str, int] = {}
    string_rows = rows(
        writing.network,
        writing.moved,
        lambda link: link.K > 0.0 and _is_plain(writing, link, link.D),
    )
    for mass_index, mass in enumerate(writing.network.masses):
        index_in_class = last_index_by_class[mass.class_name] = (
            last_index_by_class.get(mass.class_name, -1) + 1
        )
        class_word = _NO_LETTER.sub("_", mass.class_name)
        class_word = class_word if class_word[:1].isalpha() else f"m{class_word}"
        if mass_index in string_rows:
            _string(
                writing,
                string_rows[mass_index],
                mass,
                class_word if writing.network.kind == "pmpd" else "string",
            )
        if mass_index < len(writing.masses):
            continue  # a member of a string
        if writing.network.kind == "pmpd~":
            class_word = f"m{mass_index}"
        elif counts_by_class[mass.class_name] > 1:
            class_word = f"{class_word}{index_in_class}"
        writing.masses.append(_mass(writing, mass_index, mass, class_word))
        if mass.D and mass.is_mobile:
            _damper(writing, f"{class_word}_air", writing.masses[mass_index], mass.D)


def _string(writing: _Writing, row: Row, mass: Mass, word: str) -> None:
    count = row.count
    _within(mass)
    total_mass = nudge_to_goal(count * mass.M, lambda mass_to_try: mass_to_try / count, mass.M)
    fields = [
        f"masses: {count}",
        "ends: free",
        f"M: {number(total_mass)}",
        f"K: {number(row.link.K)}",
    ]
    fields += [f"Z: {number(row.link.D)}", *_start(mass)]
    name = writing.add(word, f"STRING: {{{', '.join(fields)}}}", f"masses {row.first} and on")
    writing.masses += [f"{name}.{member}" for member in range(count)]
    writing.joined |= row.links


def _start(mass: Mass) -> list[str]:
    x0 = [f"X0: {mass.x!r}m"] if mass.x else []
    return [*x0, f"V0: {mass.v * RATE!r}m/s"] if mass.v else x0


def _within(mass: Mass) -> None:
    for name, value, limit in (
        ("x", mass.x, _DISTANCE_MAX),
        ("the first step", mass.v * RATE, _SPEED_MAX),
    ):
        if not abs(value) <= limit:
            raise ModelError(f"{name} is {value:g}: a score holds up to {limit:g}", mass.line)


def _mass(writing: _Writing, mass_index: int, mass: Mass, word: str) -> str:
    _within(mass)
    if mass_index in writing.moved:
        return _moved(writing, writing.moved[mass_index], mass, word)
    if not mass.is_mobile:
        return writing.add(word, f"SOL: {{{''.join(_start(mass))}}}")
    return writing.add(word, f"MAS: {{{', '.join([f'M: {number(mass.M)}', *_start(mass)])}}}")


def _moved(writing: _Writing, port: Port, mass: Mass, word: str) -> str:
    if mass.is_mobile:
        message = f"inlet {port.number} puts a mass somewhere that moves by itself too; "
        raise ModelError(f"{message}give mass {port.mass} a weight of 0", port.line)
    source = writing.inputs.get(f"in{port.number}")
    if source is None:
        return writing.add(word, "SOL: {}", "an inlet that nothing is connected to is 0")
    first_position = source.first * port.gain
    x0 = f", X0: {first_position!r}m" if first_position else ""
    name = writing.add(
        word, f"MAS: {{M: {_IMPOSED_MASS}{x0}}}", "its mass says nothing: its path is imposed"
    )
    scale = f", scale: {port.gain!r}" if port.gain != 1.0 else ""
    writing.add(f"{word}_path", f"ENX: {{to: {name}, from: in{port.number}{source.start}{scale}}}")
    return name


def _damper(writing: _Writing, word: str, mass_name: str, D: float) -> None:
    """Add a viscosity against the ground."""
    writing.ground = writing.ground or writing.add("ground", "SOL: {}", "what stands still")
    ends = f"between: [{writing.ground}, {mass_name}]"
    if D >= 0.0:
        writing.add(word, f"FRO: {{{ends}, Z: {number(D)}}}")
    else:
        writing.add(word, f'LNL: {{{ends}, damping: "z*v", z: {number(D)}}}')


# --- links --------------------------------------------------------------------------------------


def _link(writing: _Writing, nth: int, link: Link) -> None:
    masses = writing.network.masses
    name = _NO_LETTER.sub("_", link.class_name)
    name = f"{name if name[:1].isalpha() else 'link'}{nth}"
    is_end_fixed = [
        mass_index in writing.moved or not masses[mass_index].is_mobile
        for mass_index in (link.a, link.b)
    ]
    if all(is_end_fixed):
        return  # nothing of it moves
    D = link.D
    # d is x_b - x_a in a score, and pmpd's length is x1 - x2.
    ends = f"between: [{writing.masses[link.b]}, {writing.masses[link.a]}]"
    mobile_name = writing.masses[link.b if is_end_fixed[0] else link.a]
    if D and any(mass_index in writing.moved for mass_index in (link.a, link.b)):
        # In pmpd~ a mass that an inlet moves has no speed.
        if link.form == "NLlink~" and not _is_open(link):
            message = "viscosity within bounds, on a mass that an inlet moves, is not built yet"
            raise ModelError(message, link.line)
        _damper(writing, f"{name}_air", mobile_name, D)
        D = 0.0
    if link.tables is not None:
        for text in springs(writing.network.arrays, link):
            writing.add(name, f"LNL: {{{ends}, {text}}}")
        return
    rest_field = f", rest: {link.L!r}m" if link.L else ""
    if abs(link.L) > _DISTANCE_MAX:
        raise ModelError(f"its length is {link.L:g}: a score holds up to 1000", link.line)
    if _is_plain(writing, link, D):
        kind = "REF" if D else "RES"
        damping_field = f", Z: {number(D)}" if D else ""
        writing.add(name, f"{kind}: {{{ends}, K: {number(link.K)}{damping_field}{rest_field}}}")
    elif _is_straight(writing, link):
        law = f'law: "k*d", damping: "z*v", k: {number(link.K)}, z: {number(D)}'
        writing.add(name, f"LNL: {{{ends}, {law}{rest_field}}}")
    else:
        writing.add(name, f"LNL: {{{ends}, {_law(link, D)}}}")


def _is_plain(writing: _Writing, link: Link, D: float) -> bool:
    """Whether a score can write the link as a spring with a damper."""
    return _is_straight(writing, link) and link.K >= 0.0 and D >= 0.0


def _is_straight(writing: _Writing, link: Link) -> bool:
    a, b = writing.network.masses[link.a], writing.network.masses[link.b]
    begins_at_zero_length = link.form == "link" and link.L != 0.0 and a.x == b.x
    is_linear = link.tables is None and link.Pow == 1.0 and _is_open(link)
    return is_linear and not begins_at_zero_length


def _is_open(link: Link) -> bool:
    return link.Lmin <= -_LENGTH_BOUND and link.Lmax >= _LENGTH_BOUND


def _law(link: Link, D: float) -> str:
    """K times a power of the length beyond the rest length, within bounds of the length."""
    is_audio = link.form == "NLlink~"
    # Bounds of pmpd~ are for the length beyond the rest length, those of pmpd for the whole length.
    elongation = "d" if is_audio or not link.L else "(d - l)"
    constants = {"k": link.K, **({"p": link.Pow} if link.Pow != 1.0 else {})}
    law_text = (
        f"k*{elongation}"
        if link.Pow == 1.0
        else f"where({elongation} < 0, -k*abs({elongation})**p, k*abs({elongation})**p)"
    )
    if not is_audio and link.L:
        constants["l"] = link.L
    conditions = []
    if not _is_open(link):
        conditions = [f"(d {'>' if is_audio else '>='} lo)", "(d < hi)"]
        constants |= {"lo": link.Lmin, "hi": link.Lmax}
    if not is_audio:
        conditions.append("(d != 0)")
    damping = "z*v"
    if conditions:
        law_text, damping = (
            f"where({'*'.join(conditions)}, {expression}, 0)" for expression in (law_text, damping)
        )
    if link.Pow < 1.0:
        # The slope of this law is infinite at rest. A law without a bound on its slope has no
        # certificate, but dry friction has one.
        law_fields = [f'damping: "{law_text}{f" + {damping}" if D else ""}"']
    else:
        law_fields = [f'law: "{law_text}"', *([f'damping: "{damping}"'] if D else [])]
    if D:
        constants["z"] = D
    law_fields += [f"{name}: {number(value)}" for name, value in constants.items()]
    if is_audio and link.L:
        law_fields.append(f"rest: {link.L!r}m")
    return ", ".join(law_fields)


# --- what is fed and heard ----------------------------------------------------------------------


def _feeds(writing: _Writing) -> None:
    for port in writing.network.ports:
        source = writing.inputs.get(f"in{port.number}")
        if port.what != "inForce" or source is None:
            continue
        if not writing.network.masses[port.mass].is_mobile:
            continue  # a fixed mass is not moved by forces
        if source.file is None and any(
            _moves(other_port, port.number) for other_port in writing.network.ports
        ):
            message = f"inlet {port.number} moves one mass and pushes another, which a file can do"
            raise ModelError(f"{message} and osc cannot", port.line)
        scale = f", scale: {port.gain!r}" if port.gain != 1.0 else ""
        mass_name = writing.masses[port.mass]
        text = f"ENF: {{to: {mass_name}, from: in{port.number}{source.start}{scale}}}"
        writing.add(f"{_NO_LETTER.sub('_', mass_name)}_push", text)


def _moves(port: Port, number: int) -> bool:
    return port.what == "inPos" and port.number == number


def _outputs(writing: _Writing) -> None:
    for port in writing.network.ports:
        if not port.what.startswith("out") or port.gain == 0.0:
            continue
        if port.gain < 0.0:
            raise ModelError(f"a gain of {port.gain:g}: a score has none below 0", port.line)
        if port.mass in writing.moved:
            message = f"mass {port.mass} is moved by an inlet, which is heard one sample before all"
            raise ModelError(f"{message} else; leave its outlet out", port.line)
        _out(writing, [port.mass], port.what == "outSpeed", port.number + 1, port.gain)
    requests = writing.network.asked
    if writing.network.kind == "pmpd" and not requests:
        mobile = tuple(
            mass_index for mass_index, mass in enumerate(writing.network.masses) if mass.is_mobile
        )
        requests = [Asked("massPosMean", mobile, 0)]
    channel_number = 0
    for request in requests:
        is_mean, is_speed = (
            request.word.endswith("Mean"),
            request.word.startswith("massSpeed"),
        )
        groups = (
            [list(request.masses)] if is_mean else [[mass_index] for mass_index in request.masses]
        )
        for group in filter(None, groups):
            channel_number += 1
            if channel_number > _CHANNELS_MAX:
                message = f"more than {_CHANNELS_MAX} masses are asked for; name fewer"
                raise ModelError(f"{message}, or write massPosMean CLASS", request.line)
            _out(writing, group, is_speed, channel_number, 1.0 / len(group))


def _out(
    writing: _Writing, masses: Sequence[int], is_speed: bool, channel: int, signal_factor: float
) -> None:
    output_name = f"out{len(writing.outs) + 1}"
    mass_ranges = ", ".join(_ranges([writing.masses[mass_index] for mass_index in masses]))
    mass_ranges = mass_ranges if len(masses) == 1 else f"[{mass_ranges}]"
    kind, signal_factor = ("SOV", signal_factor / RATE) if is_speed else ("SOX", signal_factor)
    writing.outs.append(Out(output_name, f"{kind}: {mass_ranges}", channel, gain(signal_factor)))


def _ranges(member_names: Sequence[str]) -> Iterator[str]:
    """Members of strings one behind the other as a range: `string.3..8`."""
    first_index = 0
    while first_index < len(member_names):
        body_name, dot, member_index = member_names[first_index].partition(".")
        last_index = first_index
        while dot and last_index + 1 < len(member_names):
            if (
                member_names[last_index + 1]
                != f"{body_name}.{int(member_index) + last_index + 1 - first_index}"
            ):
                break
            last_index += 1
        range_text = (
            f"..{int(member_index) + last_index - first_index}" if last_index > first_index else ""
        )
        yield f"{member_names[first_index]}{range_text}"
        first_index = last_index + 1


# --- text ---------------------------------------------------------------------------------------


def _page(writing: _Writing, score_title: str) -> Page:
    pushes = {f"in{port.number}" for port in writing.network.ports if port.what == "inForce"}
    ports = {f"in{port.number}" for port in writing.network.ports if port.what.startswith("in")}
    return Page(
        head=_head(writing, score_title),
        inputs={name: writing.inputs[name] for name in sorted(ports) if name in writing.inputs},
        pushes=pushes,
        modules=writing.modules,
        outs=writing.outs,
        strikes=list(_kicks(writing)),
    )


def _head(writing: _Writing, title: str) -> Iterator[str]:
    object_kind = writing.network.kind
    yield f"From {title or 'a list'}, messages to an object [{object_kind}] of Pure Data."
    step_text = (
        f"A bang is a sample of 1/{RATE} s"
        if object_kind == "pmpd"
        else f"One sample is 1/{RATE} s"
    )
    yield f"{step_text}; the numbers are those of the discrete network."
    if object_kind == "pmpd~":
        yield "The first sample is what the object begins with; its own first sample follows."
    if any(out.what.startswith("SOV") for out in writing.outs):
        yield "Speeds are those in the middle of a step, heard 7.5 samples late."
    if object_kind == "pmpd" and not writing.network.asked:
        yield "Nothing is asked for: the mean of all masses that move is heard."


def _kicks(writing: _Writing) -> Iterator[Line]:
    """Forces in the first sample, as strikes."""
    cause = "damping of what was put elsewhere" if writing.network.kind == "pmpd" else "a force"
    for mass_index, kick_force in writing.kicks.items():
        if not writing.network.masses[mass_index].is_mobile:
            continue
        mass_name = writing.masses[mass_index]
        name = writing.names.new(f"{_NO_LETTER.sub('_', mass_name)}_kick")
        text = f"{{to: model.{mass_name}, at: 0s, impulse: {kick_force / RATE!r}Ns}}"
        yield Line(name, text, f"{cause}, one sample")
