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
    for model_mass in writing.network.masses:
        counts_by_class[model_mass.class_name] = counts_by_class.get(model_mass.class_name, 0) + 1
    line_by_mass: dict[str, int] = {}
    string_rows = rows(
        writing.network,
        writing.moved,
        lambda mass: mass.K > 0.0 and _is_plain(writing, mass, mass.D),
    )
    for mass_index, model_mass in enumerate(writing.network.masses):
        nth = line_by_mass[model_mass.class_name] = line_by_mass.get(model_mass.class_name, -1) + 1
        class_word = _NO_LETTER.sub("_", model_mass.class_name)
        class_word = class_word if class_word[:1].isalpha() else f"m{class_word}"
        if mass_index in string_rows:
            _string(
                writing,
                string_rows[mass_index],
                model_mass,
                class_word if writing.network.kind == "pmpd" else "string",
            )
        if mass_index < len(writing.masses):
            continue  # a member of a string
        if writing.network.kind == "pmpd~":
            class_word = f"m{mass_index}"
        elif counts_by_class[model_mass.class_name] > 1:
            class_word = f"{class_word}{nth}"
        writing.masses.append(_mass(writing, mass_index, model_mass, class_word))
        if model_mass.D and model_mass.is_mobile:
            _damper(writing, f"{class_word}_air", writing.masses[mass_index], model_mass.D)


def _string(writing: _Writing, string_row: Row, string_mass: Mass, string_word: str) -> None:
    n = string_row.count
    _within(string_mass)
    M = nudge_to_goal(n * string_mass.M, lambda total_mass: total_mass / n, string_mass.M)
    string_fields = [
        f"masses: {n}",
        "ends: free",
        f"M: {number(M)}",
        f"K: {number(string_row.link.K)}",
    ]
    string_fields += [f"Z: {number(string_row.link.D)}", *_start(string_mass)]
    string_name = writing.add(
        string_word, f"STRING: {{{', '.join(string_fields)}}}", f"masses {string_row.first} and on"
    )
    writing.masses += [f"{string_name}.{member}" for member in range(n)]
    writing.joined |= string_row.links


def _start(mass: Mass) -> list[str]:
    x0 = [f"X0: {mass.x!r}m"] if mass.x else []
    return [*x0, f"V0: {mass.v * RATE!r}m/s"] if mass.v else x0


def _within(bounded_mass: Mass) -> None:
    for bound_name, bound_value, limit in (
        ("x", bounded_mass.x, _DISTANCE_MAX),
        ("the first step", bounded_mass.v * RATE, _SPEED_MAX),
    ):
        if not abs(bound_value) <= limit:
            raise ModelError(
                f"{bound_name} is {bound_value:g}: a score holds up to {limit:g}", bounded_mass.line
            )


def _mass(writing: _Writing, mass_index: int, model_mass: Mass, mass_word: str) -> str:
    _within(model_mass)
    if mass_index in writing.moved:
        return _moved(writing, writing.moved[mass_index], model_mass, mass_word)
    if not model_mass.is_mobile:
        return writing.add(mass_word, f"SOL: {{{''.join(_start(model_mass))}}}")
    return writing.add(
        mass_word, f"MAS: {{{', '.join([f'M: {number(model_mass.M)}', *_start(model_mass)])}}}"
    )


def _moved(writing: _Writing, port: Port, mass: Mass, class_word: str) -> str:
    if mass.is_mobile:
        message = f"inlet {port.number} puts a mass somewhere that moves by itself too; "
        raise ModelError(f"{message}give mass {port.mass} a weight of 0", port.line)
    fed = writing.inputs.get(f"in{port.number}")
    if fed is None:
        return writing.add(class_word, "SOL: {}", "an inlet that nothing is connected to is 0")
    first_position = fed.first * port.gain
    x0 = f", X0: {first_position!r}m" if first_position else ""
    moved_name = writing.add(
        class_word, f"MAS: {{M: {_IMPOSED_MASS}{x0}}}", "its mass says nothing: its path is imposed"
    )
    scale = f", scale: {port.gain!r}" if port.gain != 1.0 else ""
    writing.add(
        f"{class_word}_path", f"ENX: {{to: {moved_name}, from: in{port.number}{fed.start}{scale}}}"
    )
    return moved_name


def _damper(writing: _Writing, class_word: str, mass_name: str, D: float) -> None:
    """Add a viscosity against the ground."""
    writing.ground = writing.ground or writing.add("ground", "SOL: {}", "what stands still")
    between_text = f"between: [{writing.ground}, {mass_name}]"
    if D >= 0.0:
        writing.add(class_word, f"FRO: {{{between_text}, Z: {number(D)}}}")
    else:
        writing.add(class_word, f'LNL: {{{between_text}, damping: "z*v", z: {number(D)}}}')


# --- links --------------------------------------------------------------------------------------


def _link(writing: _Writing, nth: int, model_link: Link) -> None:
    masses = writing.network.masses
    class_word = _NO_LETTER.sub("_", model_link.class_name)
    class_word = f"{class_word if class_word[:1].isalpha() else 'link'}{nth}"
    fixed_masses = [
        mass_index in writing.moved or not masses[mass_index].is_mobile
        for mass_index in (model_link.a, model_link.b)
    ]
    if all(fixed_masses):
        return  # nothing of it moves
    D = model_link.D
    # d is x_b - x_a in a score, and pmpd's length is x1 - x2.
    between_text = f"between: [{writing.masses[model_link.b]}, {writing.masses[model_link.a]}]"
    mobile = writing.masses[model_link.b if fixed_masses[0] else model_link.a]
    if D and any(mass_index in writing.moved for mass_index in (model_link.a, model_link.b)):
        # In pmpd~ a mass that an inlet moves has no speed.
        if model_link.form == "NLlink~" and not _is_open(model_link):
            message = "viscosity within bounds, on a mass that an inlet moves, is not built yet"
            raise ModelError(message, model_link.line)
        _damper(writing, f"{class_word}_air", mobile, D)
        D = 0.0
    if model_link.tables is not None:
        for text in springs(writing.network.arrays, model_link):
            writing.add(class_word, f"LNL: {{{between_text}, {text}}}")
        return
    rest_text = f", rest: {model_link.L!r}m" if model_link.L else ""
    if abs(model_link.L) > _DISTANCE_MAX:
        raise ModelError(
            f"its length is {model_link.L:g}: a score holds up to 1000", model_link.line
        )
    if _is_plain(writing, model_link, D):
        kind = "REF" if D else "RES"
        z = f", Z: {number(D)}" if D else ""
        writing.add(
            class_word, f"{kind}: {{{between_text}, K: {number(model_link.K)}{z}{rest_text}}}"
        )
    elif _is_straight(writing, model_link):
        law = f'law: "k*d", damping: "z*v", k: {number(model_link.K)}, z: {number(D)}'
        writing.add(class_word, f"LNL: {{{between_text}, {law}{rest_text}}}")
    else:
        writing.add(class_word, f"LNL: {{{between_text}, {_law(model_link, D)}}}")


def _is_plain(writing: _Writing, link: Link, D: float) -> bool:
    """Whether a score can write the link as a spring with a damper."""
    return _is_straight(writing, link) and link.K >= 0.0 and D >= 0.0


def _is_straight(writing: _Writing, model_link: Link) -> bool:
    a, b = writing.network.masses[model_link.a], writing.network.masses[model_link.b]
    begins_as_one = model_link.form == "link" and model_link.L != 0.0 and a.x == b.x
    is_linear = model_link.tables is None and model_link.Pow == 1.0 and _is_open(model_link)
    return is_linear and not begins_as_one


def _is_open(link: Link) -> bool:
    return link.Lmin <= -_LENGTH_BOUND and link.Lmax >= _LENGTH_BOUND


def _law(model_link: Link, D: float) -> str:
    """K times a power of the length beyond the rest length, within bounds of the length."""
    is_audio = model_link.form == "NLlink~"
    # Bounds of pmpd~ are for the length beyond the rest length, those of pmpd for the whole length.
    d = "d" if is_audio or not model_link.L else "(d - l)"
    law_values = {"k": model_link.K, **({"p": model_link.Pow} if model_link.Pow != 1.0 else {})}
    law_text = (
        f"k*{d}" if model_link.Pow == 1.0 else f"where({d} < 0, -k*abs({d})**p, k*abs({d})**p)"
    )
    if not is_audio and model_link.L:
        law_values["l"] = model_link.L
    is_within = []
    if not _is_open(model_link):
        is_within = [f"(d {'>' if is_audio else '>='} lo)", "(d < hi)"]
        law_values |= {"lo": model_link.Lmin, "hi": model_link.Lmax}
    if not is_audio:
        is_within.append("(d != 0)")
    damping = "z*v"
    if is_within:
        law_text, damping = (
            f"where({'*'.join(is_within)}, {expression}, 0)" for expression in (law_text, damping)
        )
    if model_link.Pow < 1.0:
        # The slope of this law is infinite at rest. A law without a bound on its slope has no
        # certificate, but dry friction has one.
        damping_field = [f'damping: "{law_text}{f" + {damping}" if D else ""}"']
    else:
        damping_field = [f'law: "{law_text}"', *([f'damping: "{damping}"'] if D else [])]
    if D:
        law_values["z"] = D
    damping_field += [f"{name}: {number(value)}" for name, value in law_values.items()]
    if is_audio and model_link.L:
        damping_field.append(f"rest: {model_link.L!r}m")
    return ", ".join(damping_field)


# --- what is fed and heard ----------------------------------------------------------------------


def _feeds(writing: _Writing) -> None:
    for port in writing.network.ports:
        fed = writing.inputs.get(f"in{port.number}")
        if port.what != "inForce" or fed is None:
            continue
        if not writing.network.masses[port.mass].is_mobile:
            continue  # a fixed mass is not moved by forces
        if fed.file is None and any(
            _moves(other_port, port.number) for other_port in writing.network.ports
        ):
            message = f"inlet {port.number} moves one mass and pushes another, which a file can do"
            raise ModelError(f"{message} and osc cannot", port.line)
        scale = f", scale: {port.gain!r}" if port.gain != 1.0 else ""
        mass_name = writing.masses[port.mass]
        text = f"ENF: {{to: {mass_name}, from: in{port.number}{fed.start}{scale}}}"
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
    outputs_asked = writing.network.asked
    if writing.network.kind == "pmpd" and not outputs_asked:
        mobile = tuple(
            mass_index for mass_index, mass in enumerate(writing.network.masses) if mass.is_mobile
        )
        outputs_asked = [Asked("massPosMean", mobile, 0)]
    channel_number = 0
    for output_mass in outputs_asked:
        is_mean, is_speed = (
            output_mass.word.endswith("Mean"),
            output_mass.word.startswith("massSpeed"),
        )
        output_groups = (
            [list(output_mass.masses)]
            if is_mean
            else [[mass_index] for mass_index in output_mass.masses]
        )
        for output_group in filter(None, output_groups):
            channel_number += 1
            if channel_number > _CHANNELS_MAX:
                message = f"more than {_CHANNELS_MAX} masses are asked for; name fewer"
                raise ModelError(f"{message}, or write massPosMean CLASS", output_mass.line)
            _out(writing, output_group, is_speed, channel_number, 1.0 / len(output_group))


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
        body, dot, member_index = member_names[first_index].partition(".")
        last_index = first_index
        while dot and last_index + 1 < len(member_names):
            if (
                member_names[last_index + 1]
                != f"{body}.{int(member_index) + last_index + 1 - first_index}"
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
