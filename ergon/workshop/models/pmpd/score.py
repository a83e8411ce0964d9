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

_FAR = 1e6  # bounds of a length beyond which pmpd's own default lies
_FARTHEST, _FASTEST = 1e3, 1e6  # [m], [m/s] of a score
_HELD = "1e9"  # mass of what is moved whatever pushes it
_MOST_CHANNELS = 99
_NO_LETTER = re.compile(r"\W", re.ASCII)


@dataclass(slots=True)
class _Writing:
    of: Network
    inputs: Mapping[str, Input]
    names: Names = field(default_factory=Names)
    masses: list[str] = field(default_factory=list)
    modules: list[Line] = field(default_factory=list)
    kicks: dict[int, float] = field(default_factory=dict)  # forces in the first sample
    moved: dict[int, Port] = field(default_factory=dict)  # masses that an inlet puts somewhere
    outs: list[Out] = field(default_factory=list)
    ground: str = ""
    joined: set[int] = field(default_factory=set)  # links within strings, by their places

    def add(self, wanted: str, text: str, comment: str = "") -> str:
        """Add a module; returns its name."""
        name = self.names.new(wanted)
        self.modules.append(Line(name, f"{{{text}}}", comment))
        return name


def written(network: Network, inputs: Mapping[str, Input], title: str) -> str:
    """The text of a score that moves as the object does. Raises ModelError with the line at fault.

    `inputs` are files by `in0`, `in1` …, the inlets of pmpd~.
    """
    own = _Writing(network, inputs)
    if network.kind == "pmpd":
        own.kicks = first_bang(network)
    else:
        own.kicks = {at: one.f for at, one in enumerate(network.masses) if one.f}
        for port in network.ports:
            if port.what == "inPos":
                own.moved[port.mass] = port
    _masses(own)
    for nth, link in enumerate([*network.links, *network.nl_links]):
        if nth not in own.joined:
            _link(own, nth, link)
    _feeds(own)
    _heard(own)
    return _page(own, title).written()


# --- masses -------------------------------------------------------------------------------------


def _masses(own: _Writing) -> None:
    counts: dict[str, int] = {}
    for one in own.of.masses:
        counts[one.of] = counts.get(one.of, 0) + 1
    seen: dict[str, int] = {}
    strings = rows(own.of, own.moved, lambda one: one.K > 0.0 and _is_plain(own, one, one.D))
    for at, one in enumerate(own.of.masses):
        nth = seen[one.of] = seen.get(one.of, -1) + 1
        word = _NO_LETTER.sub("_", one.of)
        word = word if word[:1].isalpha() else f"m{word}"
        if at in strings:
            _string(own, strings[at], one, word if own.of.kind == "pmpd" else "string")
        if at < len(own.masses):
            continue  # a member of a string
        if own.of.kind == "pmpd~":
            word = f"m{at}"
        elif counts[one.of] > 1:
            word = f"{word}{nth}"
        own.masses.append(_mass(own, at, one, word))
        if one.D and one.is_mobile:
            _damper(own, f"{word}_air", own.masses[at], one.D)


def _string(own: _Writing, row: Row, one: Mass, word: str) -> None:
    n = row.count
    _within(one)
    M = nudge_to_goal(n * one.M, lambda whole: whole / n, one.M)
    fields = [f"masses: {n}", "ends: free", f"M: {number(M)}", f"K: {number(row.link.K)}"]
    fields += [f"Z: {number(row.link.D)}", *_start(one)]
    name = own.add(word, f"STRING: {{{', '.join(fields)}}}", f"masses {row.first} and on")
    own.masses += [f"{name}.{member}" for member in range(n)]
    own.joined |= row.links


def _start(one: Mass) -> list[str]:
    x0 = [f"X0: {one.x!r}m"] if one.x else []
    return [*x0, f"V0: {one.v * RATE!r}m/s"] if one.v else x0


def _within(one: Mass) -> None:
    for name, value, most in (("x", one.x, _FARTHEST), ("the first step", one.v * RATE, _FASTEST)):
        if not abs(value) <= most:
            raise ModelError(f"{name} is {value:g}: a score holds up to {most:g}", one.line)


def _mass(own: _Writing, at: int, one: Mass, word: str) -> str:
    _within(one)
    if at in own.moved:
        return _moved(own, own.moved[at], one, word)
    if not one.is_mobile:
        return own.add(word, f"SOL: {{{''.join(_start(one))}}}")
    return own.add(word, f"MAS: {{{', '.join([f'M: {number(one.M)}', *_start(one)])}}}")


def _moved(own: _Writing, port: Port, one: Mass, word: str) -> str:
    if one.is_mobile:
        message = f"inlet {port.number} puts a mass somewhere that moves by itself too; "
        raise ModelError(f"{message}give mass {port.mass} a weight of 0", port.line)
    fed = own.inputs.get(f"in{port.number}")
    if fed is None:
        return own.add(word, "SOL: {}", "an inlet that nothing is connected to is 0")
    first = fed.first * port.gain
    x0 = f", X0: {first!r}m" if first else ""
    name = own.add(word, f"MAS: {{M: {_HELD}{x0}}}", "its mass says nothing: its path is imposed")
    scale = f", scale: {port.gain!r}" if port.gain != 1.0 else ""
    own.add(f"{word}_path", f"ENX: {{to: {name}, from: in{port.number}{fed.start}{scale}}}")
    return name


def _damper(own: _Writing, word: str, mass: str, D: float) -> None:
    """Add a viscosity against the ground."""
    own.ground = own.ground or own.add("ground", "SOL: {}", "what stands still")
    ends = f"between: [{own.ground}, {mass}]"
    if D >= 0.0:
        own.add(word, f"FRO: {{{ends}, Z: {number(D)}}}")
    else:
        own.add(word, f'LNL: {{{ends}, damping: "z*v", z: {number(D)}}}')


# --- links --------------------------------------------------------------------------------------


def _link(own: _Writing, nth: int, link: Link) -> None:
    of = own.of.masses
    word = _NO_LETTER.sub("_", link.of)
    word = f"{word if word[:1].isalpha() else 'link'}{nth}"
    still = [at in own.moved or not of[at].is_mobile for at in (link.a, link.b)]
    if all(still):
        return  # nothing of it moves
    D = link.D
    # d is x_b - x_a in a score, and pmpd's length is x1 - x2.
    ends = f"between: [{own.masses[link.b]}, {own.masses[link.a]}]"
    mobile = own.masses[link.b if still[0] else link.a]
    if D and any(at in own.moved for at in (link.a, link.b)):
        # In pmpd~ a mass that an inlet moves has no speed.
        if link.form == "NLlink~" and not _is_open(link):
            message = "viscosity within bounds, on a mass that an inlet moves, is not built yet"
            raise ModelError(message, link.line)
        _damper(own, f"{word}_air", mobile, D)
        D = 0.0
    if link.tables is not None:
        for text in springs(own.of.arrays, link):
            own.add(word, f"LNL: {{{ends}, {text}}}")
        return
    rest = f", rest: {link.L!r}m" if link.L else ""
    if abs(link.L) > _FARTHEST:
        raise ModelError(f"its length is {link.L:g}: a score holds up to 1000", link.line)
    if _is_plain(own, link, D):
        kind = "REF" if D else "RES"
        z = f", Z: {number(D)}" if D else ""
        own.add(word, f"{kind}: {{{ends}, K: {number(link.K)}{z}{rest}}}")
    elif _is_straight(own, link):
        law = f'law: "k*d", damping: "z*v", k: {number(link.K)}, z: {number(D)}'
        own.add(word, f"LNL: {{{ends}, {law}{rest}}}")
    else:
        own.add(word, f"LNL: {{{ends}, {_law(link, D)}}}")


def _is_plain(own: _Writing, link: Link, D: float) -> bool:
    """Whether a score can write the link as a spring with a damper."""
    return _is_straight(own, link) and link.K >= 0.0 and D >= 0.0


def _is_straight(own: _Writing, link: Link) -> bool:
    a, b = own.of.masses[link.a], own.of.masses[link.b]
    begins_as_one = link.form == "link" and link.L != 0.0 and a.x == b.x
    is_linear = link.tables is None and link.Pow == 1.0 and _is_open(link)
    return is_linear and not begins_as_one


def _is_open(link: Link) -> bool:
    return link.Lmin <= -_FAR and link.Lmax >= _FAR


def _law(link: Link, D: float) -> str:
    """K times a power of the length beyond the rest length, within bounds of the length."""
    is_audio = link.form == "NLlink~"
    # Bounds of pmpd~ are for the length beyond the rest length, those of pmpd for the whole length.
    d = "d" if is_audio or not link.L else "(d - l)"
    values = {"k": link.K, **({"p": link.Pow} if link.Pow != 1.0 else {})}
    law = f"k*{d}" if link.Pow == 1.0 else f"where({d} < 0, -k*abs({d})**p, k*abs({d})**p)"
    if not is_audio and link.L:
        values["l"] = link.L
    is_within = []
    if not _is_open(link):
        is_within = [f"(d {'>' if is_audio else '>='} lo)", "(d < hi)"]
        values |= {"lo": link.Lmin, "hi": link.Lmax}
    if not is_audio:
        is_within.append("(d != 0)")
    damping = "z*v"
    if is_within:
        law, damping = (f"where({'*'.join(is_within)}, {one}, 0)" for one in (law, damping))
    if link.Pow < 1.0:
        # The slope of this law is infinite at rest. A law without a bound on its slope has no
        # certificate, but dry friction has one.
        said = [f'damping: "{law}{f" + {damping}" if D else ""}"']
    else:
        said = [f'law: "{law}"', *([f'damping: "{damping}"'] if D else [])]
    if D:
        values["z"] = D
    said += [f"{name}: {number(value)}" for name, value in values.items()]
    if is_audio and link.L:
        said.append(f"rest: {link.L!r}m")
    return ", ".join(said)


# --- what is fed and heard ----------------------------------------------------------------------


def _feeds(own: _Writing) -> None:
    for port in own.of.ports:
        fed = own.inputs.get(f"in{port.number}")
        if port.what != "inForce" or fed is None:
            continue
        if not own.of.masses[port.mass].is_mobile:
            continue  # a fixed mass is not moved by forces
        if fed.file is None and any(_moves(other, port.number) for other in own.of.ports):
            message = f"inlet {port.number} moves one mass and pushes another, which a file can do"
            raise ModelError(f"{message} and osc cannot", port.line)
        scale = f", scale: {port.gain!r}" if port.gain != 1.0 else ""
        to = own.masses[port.mass]
        text = f"ENF: {{to: {to}, from: in{port.number}{fed.start}{scale}}}"
        own.add(f"{_NO_LETTER.sub('_', to)}_push", text)


def _moves(port: Port, number: int) -> bool:
    return port.what == "inPos" and port.number == number


def _heard(own: _Writing) -> None:
    for port in own.of.ports:
        if not port.what.startswith("out") or port.gain == 0.0:
            continue
        if port.gain < 0.0:
            raise ModelError(f"a gain of {port.gain:g}: a score has none below 0", port.line)
        if port.mass in own.moved:
            message = f"mass {port.mass} is moved by an inlet, which is heard one sample before all"
            raise ModelError(f"{message} else; leave its outlet out", port.line)
        _out(own, [port.mass], port.what == "outSpeed", port.number + 1, port.gain)
    asked = own.of.asked
    if own.of.kind == "pmpd" and not asked:
        mobile = tuple(at for at, one in enumerate(own.of.masses) if one.is_mobile)
        asked = [Asked("massPosMean", mobile, 0)]
    channel = 0
    for one in asked:
        is_mean, is_speed = one.word.endswith("Mean"), one.word.startswith("massSpeed")
        groups = [list(one.masses)] if is_mean else [[at] for at in one.masses]
        for group in filter(None, groups):
            channel += 1
            if channel > _MOST_CHANNELS:
                message = f"more than {_MOST_CHANNELS} masses are asked for; name fewer"
                raise ModelError(f"{message}, or write massPosMean CLASS", one.line)
            _out(own, group, is_speed, channel, 1.0 / len(group))


def _out(own: _Writing, masses: Sequence[int], is_speed: bool, channel: int, factor: float) -> None:
    name = f"out{len(own.outs) + 1}"
    heard = ", ".join(_ranges([own.masses[at] for at in masses]))
    heard = heard if len(masses) == 1 else f"[{heard}]"
    kind, factor = ("SOV", factor / RATE) if is_speed else ("SOX", factor)
    own.outs.append(Out(name, f"{kind}: {heard}", channel, gain(factor)))


def _ranges(names: Sequence[str]) -> Iterator[str]:
    """Members of strings one behind the other as a range: `string.3..8`."""
    first = 0
    while first < len(names):
        body, dot, member = names[first].partition(".")
        last = first
        while dot and last + 1 < len(names):
            if names[last + 1] != f"{body}.{int(member) + last + 1 - first}":
                break
            last += 1
        more = f"..{int(member) + last - first}" if last > first else ""
        yield f"{names[first]}{more}"
        first = last + 1


# --- text ---------------------------------------------------------------------------------------


def _page(own: _Writing, title: str) -> Page:
    pushes = {f"in{port.number}" for port in own.of.ports if port.what == "inForce"}
    ports = {f"in{port.number}" for port in own.of.ports if port.what.startswith("in")}
    return Page(
        head=_head(own, title),
        inputs={name: own.inputs[name] for name in sorted(ports) if name in own.inputs},
        pushes=pushes,
        modules=own.modules,
        outs=own.outs,
        strikes=list(_kicks(own)),
    )


def _head(own: _Writing, title: str) -> Iterator[str]:
    kind = own.of.kind
    yield f"From {title or 'a list'}, messages to an object [{kind}] of Pure Data."
    step = f"A bang is a sample of 1/{RATE} s" if kind == "pmpd" else f"One sample is 1/{RATE} s"
    yield f"{step}; the numbers are those of the discrete network."
    if kind == "pmpd~":
        yield "The first sample is what the object begins with; its own first sample follows."
    if any(out.what.startswith("SOV") for out in own.outs):
        yield "Speeds are those in the middle of a step, heard 7.5 samples late."
    if kind == "pmpd" and not own.of.asked:
        yield "Nothing is asked for: the mean of all masses that move is heard."


def _kicks(own: _Writing) -> Iterator[Line]:
    """Forces in the first sample, as strikes."""
    what = "damping of what was put elsewhere" if own.of.kind == "pmpd" else "a force"
    for at, force in own.kicks.items():
        if not own.of.masses[at].is_mobile:
            continue
        to = own.masses[at]
        name = own.names.new(f"{_NO_LETTER.sub('_', to)}_kick")
        text = f"{{to: model.{to}, at: 0s, impulse: {force / RATE!r}Ns}}"
        yield Line(name, text, f"{what}, one sample")
