"""Masses, macros and inputs of a model as modules of a score."""

from __future__ import annotations

from ergon.notation.text.errors import quote
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.mims import places
from ergon.workshop.models.mims.grammar import MESHES, STRINGS
from ergon.workshop.models.mims.kicks import Begin
from ergon.workshop.models.mims.model import Statement
from ergon.workshop.models.mims.points import points
from ergon.workshop.models.mims.signals import Value, fed, following, value_of
from ergon.workshop.models.mims.writing import Writing
from ergon.workshop.models.naming import metres
from ergon.workshop.models.page import RATE
from ergon.workshop.models.refused import REFUSED

_FARTHEST, _FASTEST = 1e3, 1e6  # [m], [m/s] of a score


def push(own: Writing, one: Statement) -> None:
    """Apply a force from outside."""
    if one.keyword != "frcInput":
        return
    for share, target in points(own, one, one.points[0]):
        if one.name in own.inputs:
            name = own.names.new(f"{one.name}_push")
            scale = "" if share == 1.0 else f", scale: {share!r}"
            start = own.inputs[one.name].start
            own.add(name, f"ENF: {{to: {target}, from: {one.name}{start}{scale}}}")


def not_negative(value: Value, name: str, line: int) -> None:
    """Refuse a value below 0, which would make energy. Raises ModelError."""
    if value.least < 0.0:
        raise ModelError(REFUSED["negative"].format(name=name, value=value.least), line)


# --- masses -------------------------------------------------------------------------------------


def _mass(own: Writing, one: Statement) -> None:
    name = own.targets[one.name] = own.names.new(one.name)
    if one.keyword == "ground":
        x0 = own.value(one, "x0")
        _within(one, "x0", x0, _FARTHEST)
        own.begins[one.name] = Begin(x0)
        own.held.add(name)
        own.add(name, f"SOL: {{X0: {metres(own.text(one, 'x0'))}}}" if x0 else "SOL: {}")
        return
    mass = _heavy(own, one)
    ties = {tie: value_of(own, one, tie) for tie in ("K", "Z") if tie in one.values}
    for tie, value in ties.items():
        not_negative(value, tie, one.line)
    follows = any(value.along for value in ties.values())
    fields = [f"M: {mass.text}"]
    if mass.along is not None:
        follows = bool(ties)  # what a mass of its own is tied by is no pole any more
        lightest = mass.least
        fields = [f"M: {lightest!r}", f"follows: {{M: {following(own, mass, is_ahead=True)}}}"]
    if not follows:
        fields += [f"{tie}: {value.text}" for tie, value in ties.items()]
    k, z = (ties[tie].first if tie in ties else 0.0 for tie in ("K", "Z"))
    fields += [text for text in _start(own, one, (mass.first, k, z)) if text]
    kind = "CEL" if ties and not follows else "MAS"
    own.add(name, f"{kind}: {{{', '.join(fields)}}}")
    if follows:
        _tie(own, name, ties)
    if gravity := _gravity(own, one):
        weight = own.names.new(f"{name}_weight")
        own.add(weight, f"ENF: {{to: {name}, from: {-gravity!r}N}}", f"gravity {gravity:g}")


def _tie(own: Writing, name: str, ties: dict[str, Value]) -> None:
    """Tie a mass to 0 by values that follow a signal, taken from the next sample."""
    ground = own.names.new(f"{name}_ground")
    own.add(ground, "SOL: {}")
    laws = {"K": 'law: "k*d"', "Z": 'damping: "z*v"'}
    said = [laws[tie] for tie in ties]
    said += [f"{tie.lower()}: {value.text}" for tie, value in ties.items() if not value.along]
    follows = {
        tie.lower(): following(own, value, is_ahead=True)
        for tie, value in ties.items()
        if value.along
    }
    if follows:
        said.append(_follows(follows))
    tie = own.names.new(f"{name}_tie")
    own.add(tie, f"LNL: {{between: [{ground}, {name}], {', '.join(said)}}}")


def _follows(values: dict[str, str]) -> str:
    return f"follows: {{{', '.join(f'{name}: {text}' for name, text in values.items())}}}"


def _start(own: Writing, one: Statement, numbers: tuple[float, float, float]) -> tuple[str, str]:
    """X0 and V0: a score begins where the model is after its first step, in which no link acts.

    `numbers` are M, K and Z of the mass in that step.
    """
    (mass, k, z), gravity = numbers, _gravity(own, one)
    x0 = own.value(one, "x0")
    before = x0 - own.value(one, "v0") / RATE
    if "before" in one.values:
        before = own.value(one, "before")
    first = (2.0 - (k + z) / mass) * x0 + (z / mass - 1.0) * before - gravity / mass
    _within(one, "x0", first, _FARTHEST)
    _within(one, "the first step", (first - x0) * RATE, _FASTEST)
    own.begins[one.name] = Begin(first, first - x0)
    if first == x0:
        return (f"X0: {metres(own.text(one, 'x0'))}" if x0 else ""), ""
    return (f"X0: {first!r}m" if first else ""), f"V0: {(first - x0) * RATE!r}m/s"


def _within(one: Statement, name: str, value: float, most: float) -> None:
    if not abs(value) <= most:
        raise ModelError(REFUSED["far"].format(name=name, value=value, most=most), one.line)


def _gravity(own: Writing, one: Statement) -> float:
    text = one.values.get("gravity")
    if text is None or own.model.dialect == "v1":
        return own.value(one, "gravity")
    # mi-gen appends its factor to the text, so of `a + b` it divides only b.
    own.text(one, "gravity")
    what = f"gravity of {quote(one.name)}"
    return own.model.number(f"{text}/{RATE}", what, one.line)


def _heavy(own: Writing, one: Statement) -> Value:
    mass = value_of(own, one, "M")
    if mass.least <= 0.0:
        of = "silent mass" if mass.text != own.params.written(one.values["M"]) else "no mass"
        raise ModelError(REFUSED[of].format(value=mass.least), one.line)
    return mass


# --- macros -------------------------------------------------------------------------------------


def _macro(own: Writing, one: Statement) -> None:
    values = {name: value_of(own, one, name) for name in ("M", "K", "K2", "Z", "Zo")}
    values = {name: value for name, value in values.items() if name in one.values}
    _heavy(own, one)
    for name, value in values.items():
        if name != "M":
            not_negative(value, name, one.line)
        if value.along and not (name in ("K", "Z") and one.keyword in ("string", "chain")):
            message = REFUSED["signal"].format(name=quote(one.values[name]), value=name)
            raise ModelError(message, one.line)
    rows, columns = places.size(one)
    name = own.names.new(one.name)
    x0 = own.value(one, "x0")
    _within(one, "x0", x0, _FARTHEST)
    air = values["Zo"].first if "Zo" in values else 0.0
    macro = own.macros[one.name] = places.Macro(
        one,
        name,
        rows,
        columns,
        {value: "0" if own_value.along else own_value.text for value, own_value in values.items()},
        _start(own, one, (values["M"].first, 0.0, air)),
        own.text(one, "x0") if x0 else "0",
        own.names.new(f"{name}_edge"),
    )
    own.held.add(macro.edge)
    places.build(macro, own.laws == "2019")
    _change(own, macro, {name: value for name, value in values.items() if value.along})
    for nth, (module, text) in enumerate(macro.modules):
        own.names.taken.add(module)
        own.add(module, text, "" if nth else f"{one.keyword} of {rows * columns} points")
    if one.keyword in ("string", "stiffString") and own.value(one, "v0"):
        _pull(own, macro, values["Z"])


def _change(own: Writing, macro: places.Macro, values: dict[str, Value]) -> None:
    """Add links between neighbours of a row, for values that follow a signal."""
    if not values:
        return
    laws = {"K": 'law: "k*d"', "Z": 'damping: "z*v"'}
    said = [laws[name] for name in values]
    said.append(_follows({name.lower(): following(own, one) for name, one in values.items()}))
    for nth, (a, b) in enumerate(macro.neighbours()):
        name = f"{macro.name}_led{nth or ''}"
        macro.modules.append((name, f"LNL: {{between: [{a}, {b}], {', '.join(said)}}}"))


def _pull(own: Writing, macro: places.Macro, z: Value) -> None:
    """Add the force of a string's dampers on its fixed ends: with a v0 these do not move, but the
    dampers feel a constant speed.
    """
    if z.along:
        raise ModelError(REFUSED["pulling string"], macro.of.line)
    force = z.first * own.value(macro.of, "v0") / RATE
    ends = macro.at(0, 1), macro.at(0, macro.columns - 2)
    for nth, end in enumerate(ends):
        if force:
            name = own.names.new(f"{macro.name}_pull{nth or ''}")
            comment = "its fixed ends have a speed, which dampers feel" if nth == 0 else ""
            own.add(name, f"ENF: {{to: {end}, from: {force!r}N}}", comment)


# --- inputs -------------------------------------------------------------------------------------


def _input(own: Writing, one: Statement) -> None:
    if one.keyword == "frcInput":
        return
    source = own.inputs.get(one.name)
    name = own.targets[one.name] = fed(own, one.name, one.name)
    first = 0.0 if source is None else source.first
    own.held.add(name)
    own.begins[one.name] = Begin(first, jump=first - own.value(one, "x0"))


MAKERS = {
    **dict.fromkeys(("ground", "mass", "massG", "osc"), _mass),
    **dict.fromkeys(STRINGS + MESHES, _macro),
    **dict.fromkeys(("posInput", "frcInput"), _input),
}
