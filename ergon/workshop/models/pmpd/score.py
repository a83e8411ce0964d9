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
from ergon.workshop.models.page import RATE, Input, Line, Output, Page, gain_option, number_text
from ergon.workshop.models.pmpd.bang import first_bang
from ergon.workshop.models.pmpd.network import Link, Mass, Network, Port, Request
from ergon.workshop.models.pmpd.strings import Row, find_rows
from ergon.workshop.models.pmpd.tables import law_fields

_LENGTH_BOUND = 1e6  # bounds of a length beyond which pmpd's own default lies
_DISTANCE_MAX, _SPEED_MAX = 1e3, 1e6  # [m], [m/s] of a score
_IMPOSED_MASS = "1e9"  # mass of what is moved whatever pushes it
_CHANNELS_MAX = 99
_NON_WORD = re.compile(r"\W", re.ASCII)


@dataclass(slots=True)
class _ScoreDraft:
    network: Network
    inputs: Mapping[str, Input]
    names: Names = field(default_factory=Names)
    mass_modules: list[str] = field(default_factory=list)
    modules: list[Line] = field(default_factory=list)
    initial_forces: dict[int, float] = field(default_factory=dict)  # forces in the first sample
    imposed_by_mass: dict[int, Port] = field(
        default_factory=dict
    )  # masses that an inlet puts somewhere
    outputs: list[Output] = field(default_factory=list)
    ground: str = ""
    string_links: set[int] = field(default_factory=set)  # links within strings, by their places

    def add(self, wanted_name: str, text: str, comment: str = "") -> str:
        """Add a module; returns its name."""
        name = self.names.new(wanted_name)
        self.modules.append(Line(name, f"{{{text}}}", comment))
        return name


def score_text(network: Network, inputs: Mapping[str, Input], score_title: str) -> str:
    """The text of a score that moves as the object does. Raises ModelError with the line at fault.

    `inputs` are files by `in0`, `in1` …, the inlets of pmpd~.
    """
    draft = _ScoreDraft(network, inputs)
    if network.kind == "pmpd":
        draft.initial_forces = first_bang(network)
    else:
        draft.initial_forces = {
            mass_index: mass.f for mass_index, mass in enumerate(network.masses) if mass.f
        }
        for port in network.ports:
            if port.word == "inPos":
                draft.imposed_by_mass[port.mass] = port
    _add_masses(draft)
    for link_index, link in enumerate([*network.links, *network.nl_links]):
        if link_index not in draft.string_links:
            _add_link(draft, link_index, link)
    _add_forces(draft)
    _add_outputs(draft)
    return _page(draft, score_title).text()


# --- masses -------------------------------------------------------------------------------------


def _add_masses(draft: _ScoreDraft) -> None:
    class_sizes: dict[str, int] = {}
    for mass in draft.network.masses:
        class_sizes[mass.class_name] = class_sizes.get(mass.class_name, 0) + 1
    last_indices: dict[str, int] = {}
    string_by_first_mass = find_rows(
        draft.network,
        draft.imposed_by_mass,
        lambda link: link.K > 0.0 and _is_score_spring(draft, link, link.D),
    )
    for mass_index, mass in enumerate(draft.network.masses):
        index_in_class = last_indices[mass.class_name] = last_indices.get(mass.class_name, -1) + 1
        module_name = _NON_WORD.sub("_", mass.class_name)
        module_name = module_name if module_name[:1].isalpha() else f"m{module_name}"
        if mass_index in string_by_first_mass:
            _add_string(
                draft,
                string_by_first_mass[mass_index],
                mass,
                module_name if draft.network.kind == "pmpd" else "string",
            )
        if mass_index < len(draft.mass_modules):
            continue  # a member of a string
        if draft.network.kind == "pmpd~":
            module_name = f"m{mass_index}"
        elif class_sizes[mass.class_name] > 1:
            module_name = f"{module_name}{index_in_class}"
        draft.mass_modules.append(_add_mass(draft, mass_index, mass, module_name))
        if mass.air_damping and mass.is_mobile:
            _add_ground_damper(
                draft, f"{module_name}_air", draft.mass_modules[mass_index], mass.air_damping
            )


def _add_string(draft: _ScoreDraft, row: Row, mass: Mass, wanted_name: str) -> None:
    count = row.n_masses
    _check_start(mass)
    total_mass = nudge_to_goal(count * mass.M, lambda mass_to_try: mass_to_try / count, mass.M)
    fields = [
        f"masses: {count}",
        "ends: free",
        f"M: {number_text(total_mass)}",
        f"K: {number_text(row.link.K)}",
    ]
    fields += [f"Z: {number_text(row.link.D)}", *_start_fields(mass)]
    name = draft.add(
        wanted_name, f"STRING: {{{', '.join(fields)}}}", f"masses {row.first_mass} and on"
    )
    draft.mass_modules += [f"{name}.{member}" for member in range(count)]
    draft.string_links |= row.links


def _start_fields(mass: Mass) -> list[str]:
    x0 = [f"X0: {mass.x!r}m"] if mass.x else []
    return [*x0, f"V0: {mass.v * RATE!r}m/s"] if mass.v else x0


def _check_start(mass: Mass) -> None:
    for name, start_value, limit in (
        ("x", mass.x, _DISTANCE_MAX),
        ("the first step", mass.v * RATE, _SPEED_MAX),
    ):
        if not abs(start_value) <= limit:
            raise ModelError(f"{name} is {start_value:g}: a score holds up to {limit:g}", mass.line)


def _add_mass(draft: _ScoreDraft, mass_index: int, mass: Mass, wanted_name: str) -> str:
    _check_start(mass)
    if mass_index in draft.imposed_by_mass:
        return _add_imposed_mass(draft, draft.imposed_by_mass[mass_index], mass, wanted_name)
    if not mass.is_mobile:
        return draft.add(wanted_name, f"SOL: {{{''.join(_start_fields(mass))}}}")
    return draft.add(
        wanted_name, f"MAS: {{{', '.join([f'M: {number_text(mass.M)}', *_start_fields(mass)])}}}"
    )


def _add_imposed_mass(draft: _ScoreDraft, port: Port, mass: Mass, wanted_name: str) -> str:
    if mass.is_mobile:
        message = f"inlet {port.number} puts a mass somewhere that moves by itself too; "
        raise ModelError(f"{message}give mass {port.mass} a weight of 0", port.line)
    source = draft.inputs.get(f"in{port.number}")
    if source is None:
        return draft.add(wanted_name, "SOL: {}", "an inlet that nothing is connected to is 0")
    first_position = source.first_sample * port.gain
    x0 = f", X0: {first_position!r}m" if first_position else ""
    name = draft.add(
        wanted_name,
        f"MAS: {{M: {_IMPOSED_MASS}{x0}}}",
        "its mass says nothing: its path is imposed",
    )
    scale = f", scale: {port.gain!r}" if port.gain != 1.0 else ""
    draft.add(
        f"{wanted_name}_path",
        f"ENX: {{to: {name}, from: in{port.number}{source.start_field_text}{scale}}}",
    )
    return name


def _add_ground_damper(
    draft: _ScoreDraft, wanted_name: str, mass_name: str, viscosity: float
) -> None:
    """Add a viscosity against the ground."""
    draft.ground = draft.ground or draft.add("ground", "SOL: {}", "what stands still")
    ends = f"between: [{draft.ground}, {mass_name}]"
    if viscosity >= 0.0:
        draft.add(wanted_name, f"FRO: {{{ends}, Z: {number_text(viscosity)}}}")
    else:
        draft.add(wanted_name, f'LNL: {{{ends}, damping: "z*v", z: {number_text(viscosity)}}}')


# --- links --------------------------------------------------------------------------------------


def _add_link(draft: _ScoreDraft, link_index: int, link: Link) -> None:
    masses = draft.network.masses
    name = _NON_WORD.sub("_", link.class_name)
    name = f"{name if name[:1].isalpha() else 'link'}{link_index}"
    are_fixed = [
        mass_index in draft.imposed_by_mass or not masses[mass_index].is_mobile
        for mass_index in (link.a, link.b)
    ]
    if all(are_fixed):
        return  # nothing of it moves
    D = link.D
    # d is x_b - x_a in a score, and pmpd's length is x1 - x2.
    ends = f"between: [{draft.mass_modules[link.b]}, {draft.mass_modules[link.a]}]"
    mobile_module = draft.mass_modules[link.b if are_fixed[0] else link.a]
    if D and any(mass_index in draft.imposed_by_mass for mass_index in (link.a, link.b)):
        # In pmpd~ a mass that an inlet moves has no speed.
        if link.form == "NLlink~" and not _is_unbounded(link):
            message = "viscosity within bounds, on a mass that an inlet moves, is not built yet"
            raise ModelError(message, link.line)
        _add_ground_damper(draft, f"{name}_air", mobile_module, D)
        D = 0.0
    if link.tables is not None:
        for text in law_fields(draft.network.arrays, link):
            draft.add(name, f"LNL: {{{ends}, {text}}}")
        return
    rest_field = f", rest: {link.L!r}m" if link.L else ""
    if abs(link.L) > _DISTANCE_MAX:
        raise ModelError(f"its length is {link.L:g}: a score holds up to 1000", link.line)
    if _is_score_spring(draft, link, D):
        kind = "REF" if D else "RES"
        damping_field = f", Z: {number_text(D)}" if D else ""
        draft.add(name, f"{kind}: {{{ends}, K: {number_text(link.K)}{damping_field}{rest_field}}}")
    elif _is_linear(draft, link):
        law = f'law: "k*d", damping: "z*v", k: {number_text(link.K)}, z: {number_text(D)}'
        draft.add(name, f"LNL: {{{ends}, {law}{rest_field}}}")
    else:
        draft.add(name, f"LNL: {{{ends}, {_law_fields(link, D)}}}")


def _is_score_spring(draft: _ScoreDraft, link: Link, D: float) -> bool:
    """Whether a score can write the link as a spring with a damper."""
    return _is_linear(draft, link) and link.K >= 0.0 and D >= 0.0


def _is_linear(draft: _ScoreDraft, link: Link) -> bool:
    a, b = draft.network.masses[link.a], draft.network.masses[link.b]
    begins_at_zero_length = link.form == "link" and link.L != 0.0 and a.x == b.x
    has_linear_law = link.tables is None and link.Pow == 1.0 and _is_unbounded(link)
    return has_linear_law and not begins_at_zero_length


def _is_unbounded(link: Link) -> bool:
    return link.Lmin <= -_LENGTH_BOUND and link.Lmax >= _LENGTH_BOUND


def _law_fields(link: Link, D: float) -> str:
    """K times a power of the length beyond the rest length, within bounds of the length."""
    is_audio = link.form == "NLlink~"
    # Bounds of pmpd~ are for the length beyond the rest length, those of pmpd for the whole length.
    elongation = "d" if is_audio or not link.L else "(d - l)"
    constants = {"k": link.K, **({"p": link.Pow} if link.Pow != 1.0 else {})}
    elastic = (
        f"k*{elongation}"
        if link.Pow == 1.0
        else f"where({elongation} < 0, -k*abs({elongation})**p, k*abs({elongation})**p)"
    )
    if not is_audio and link.L:
        constants["l"] = link.L
    conditions = []
    if not _is_unbounded(link):
        conditions = [f"(d {'>' if is_audio else '>='} lo)", "(d < hi)"]
        constants |= {"lo": link.Lmin, "hi": link.Lmax}
    if not is_audio:
        conditions.append("(d != 0)")
    damping = "z*v"
    if conditions:
        elastic, damping = (
            f"where({'*'.join(conditions)}, {expression}, 0)" for expression in (elastic, damping)
        )
    if link.Pow < 1.0:
        # The slope of this law is infinite at rest. A law without a bound on its slope has no
        # certificate, but dry friction has one.
        law_fields = [f'damping: "{elastic}{f" + {damping}" if D else ""}"']
    else:
        law_fields = [f'law: "{elastic}"', *([f'damping: "{damping}"'] if D else [])]
    if D:
        constants["z"] = D
    law_fields += [f"{name}: {number_text(value)}" for name, value in constants.items()]
    if is_audio and link.L:
        law_fields.append(f"rest: {link.L!r}m")
    return ", ".join(law_fields)


# --- what is fed and heard ----------------------------------------------------------------------


def _add_forces(draft: _ScoreDraft) -> None:
    for port in draft.network.ports:
        source = draft.inputs.get(f"in{port.number}")
        if port.word != "inForce" or source is None:
            continue
        if not draft.network.masses[port.mass].is_mobile:
            continue  # a fixed mass is not moved by forces
        if source.file is None and any(
            _imposes_position(other_port, port.number) for other_port in draft.network.ports
        ):
            message = f"inlet {port.number} moves one mass and pushes another, which a file can do"
            raise ModelError(f"{message} and osc cannot", port.line)
        scale = f", scale: {port.gain!r}" if port.gain != 1.0 else ""
        mass_name = draft.mass_modules[port.mass]
        text = f"ENF: {{to: {mass_name}, from: in{port.number}{source.start_field_text}{scale}}}"
        draft.add(f"{_NON_WORD.sub('_', mass_name)}_push", text)


def _imposes_position(port: Port, number: int) -> bool:
    return port.word == "inPos" and port.number == number


def _add_outputs(draft: _ScoreDraft) -> None:
    for port in draft.network.ports:
        if not port.word.startswith("out") or port.gain == 0.0:
            continue
        if port.gain < 0.0:
            raise ModelError(f"a gain of {port.gain:g}: a score has none below 0", port.line)
        if port.mass in draft.imposed_by_mass:
            message = f"mass {port.mass} is moved by an inlet, which is heard one sample before all"
            raise ModelError(f"{message} else; leave its outlet out", port.line)
        _add_output(draft, [port.mass], port.word == "outSpeed", port.number + 1, port.gain)
    requests = draft.network.requests
    if draft.network.kind == "pmpd" and not requests:
        mobile_masses = tuple(
            mass_index for mass_index, mass in enumerate(draft.network.masses) if mass.is_mobile
        )
        requests = [Request("massPosMean", mobile_masses, 0)]
    channel = 0
    for request in requests:
        is_mean, is_speed = (request.word.endswith("Mean"), request.word.startswith("massSpeed"))
        groups = (
            [list(request.masses)] if is_mean else [[mass_index] for mass_index in request.masses]
        )
        for group in filter(None, groups):
            channel += 1
            if channel > _CHANNELS_MAX:
                message = f"more than {_CHANNELS_MAX} masses are asked for; name fewer"
                raise ModelError(f"{message}, or write massPosMean CLASS", request.line)
            _add_output(draft, group, is_speed, channel, 1.0 / len(group))


def _add_output(
    draft: _ScoreDraft, masses: Sequence[int], is_speed: bool, channel: int, factor: float
) -> None:
    output_name = f"out{len(draft.outputs) + 1}"
    targets = ", ".join(_ranges([draft.mass_modules[mass_index] for mass_index in masses]))
    targets = targets if len(masses) == 1 else f"[{targets}]"
    kind, factor = ("SOV", factor / RATE) if is_speed else ("SOX", factor)
    draft.outputs.append(Output(output_name, f"{kind}: {targets}", channel, gain_option(factor)))


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


def _page(draft: _ScoreDraft, score_title: str) -> Page:
    pushes = {f"in{port.number}" for port in draft.network.ports if port.word == "inForce"}
    ports = {f"in{port.number}" for port in draft.network.ports if port.word.startswith("in")}
    return Page(
        header=_header(draft, score_title),
        inputs={name: draft.inputs[name] for name in sorted(ports) if name in draft.inputs},
        force_inputs=pushes,
        modules=draft.modules,
        outputs=draft.outputs,
        strikes=list(_strikes(draft)),
    )


def _header(draft: _ScoreDraft, title: str) -> Iterator[str]:
    object_kind = draft.network.kind
    yield f"From {title or 'a list'}, messages to an object [{object_kind}] of Pure Data."
    step_text = (
        f"A bang is a sample of 1/{RATE} s"
        if object_kind == "pmpd"
        else f"One sample is 1/{RATE} s"
    )
    yield f"{step_text}; the numbers are those of the discrete network."
    if object_kind == "pmpd~":
        yield "The first sample is what the object begins with; its own first sample follows."
    if any(out.source.startswith("SOV") for out in draft.outputs):
        yield "Speeds are those in the middle of a step, heard 7.5 samples late."
    if object_kind == "pmpd" and not draft.network.requests:
        yield "Nothing is asked for: the mean of all masses that move is heard."


def _strikes(draft: _ScoreDraft) -> Iterator[Line]:
    """Forces in the first sample, as strikes."""
    cause = "damping of what was put elsewhere" if draft.network.kind == "pmpd" else "a force"
    for mass_index, force in draft.initial_forces.items():
        if not draft.network.masses[mass_index].is_mobile:
            continue
        mass_name = draft.mass_modules[mass_index]
        name = draft.names.new(f"{_NON_WORD.sub('_', mass_name)}_kick")
        text = f"{{to: model.{mass_name}, at: 0s, impulse: {force / RATE!r}Ns}}"
        yield Line(name, text, f"{cause}, one sample")
