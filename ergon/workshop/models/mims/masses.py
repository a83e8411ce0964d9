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

_DISTANCE_MAX, _SPEED_MAX = 1e3, 1e6  # [m], [m/s] of a score


def push(writing: Writing, statement: Statement) -> None:
    """Apply a force from outside."""
    if statement.keyword != "frcInput":
        return
    for share, target in points(writing, statement, statement.points[0]):
        if statement.name in writing.inputs:
            push_name = writing.names.new(f"{statement.name}_push")
            scale_field = "" if share == 1.0 else f", scale: {share!r}"
            start = writing.inputs[statement.name].start
            writing.add(
                push_name, f"ENF: {{to: {target}, from: {statement.name}{start}{scale_field}}}"
            )


def not_negative(value: Value, name: str, line: int) -> None:
    """Refuse a value below 0, which would make energy. Raises ModelError."""
    if value.least < 0.0:
        raise ModelError(REFUSED["negative"].format(name=name, value=value.least), line)


# --- masses -------------------------------------------------------------------------------------


def _mass(writing: Writing, statement: Statement) -> None:
    mass_name = writing.targets[statement.name] = writing.names.new(statement.name)
    if statement.keyword == "ground":
        x0 = writing.value(statement, "x0")
        _within(statement, "x0", x0, _DISTANCE_MAX)
        writing.begins[statement.name] = Begin(x0)
        writing.held.add(mass_name)
        writing.add(
            mass_name,
            f"SOL: {{X0: {metres(writing.text(statement, 'x0'))}}}" if x0 else "SOL: {}",
        )
        return
    mass = _heavy(writing, statement)
    ties = {tie: value_of(writing, statement, tie) for tie in ("K", "Z") if tie in statement.values}
    for tie, value in ties.items():
        not_negative(value, tie, statement.line)
    follows = any(value.along for value in ties.values())
    fields = [f"M: {mass.text}"]
    if mass.along is not None:
        follows = bool(ties)  # a mass with ties has no poles of its own
        lightest = mass.least
        fields = [
            f"M: {lightest!r}",
            f"follows: {{M: {following(writing, mass, is_ahead=True)}}}",
        ]
    if not follows:
        fields += [f"{tie}: {value.text}" for tie, value in ties.items()]
    k, z = (ties[tie].first if tie in ties else 0.0 for tie in ("K", "Z"))
    fields += [text for text in _start(writing, statement, (mass.first, k, z)) if text]
    kind = "CEL" if ties and not follows else "MAS"
    writing.add(mass_name, f"{kind}: {{{', '.join(fields)}}}")
    if follows:
        _tie(writing, mass_name, ties)
    if gravity := _gravity(writing, statement):
        weight_name = writing.names.new(f"{mass_name}_weight")
        writing.add(
            weight_name, f"ENF: {{to: {mass_name}, from: {-gravity!r}N}}", f"gravity {gravity:g}"
        )


def _tie(writing: Writing, mass_name: str, ties: dict[str, Value]) -> None:
    """Tie a mass to 0 by values that follow a signal, taken from the next sample."""
    ground_name = writing.names.new(f"{mass_name}_ground")
    writing.add(ground_name, "SOL: {}")
    law_by_value = {"K": 'law: "k*d"', "Z": 'damping: "z*v"'}
    fields = [law_by_value[tie_name] for tie_name in ties]
    fields += [
        f"{tie_name.lower()}: {value.text}" for tie_name, value in ties.items() if not value.along
    ]
    followed_values = {
        tie_name.lower(): following(writing, value, is_ahead=True)
        for tie_name, value in ties.items()
        if value.along
    }
    if followed_values:
        fields.append(_follows(followed_values))
    tie_name = writing.names.new(f"{mass_name}_tie")
    writing.add(tie_name, f"LNL: {{between: [{ground_name}, {mass_name}], {', '.join(fields)}}}")


def _follows(values: dict[str, str]) -> str:
    return f"follows: {{{', '.join(f'{name}: {text}' for name, text in values.items())}}}"


def _start(
    writing: Writing, statement: Statement, mass_values: tuple[float, float, float]
) -> tuple[str, str]:
    """X0 and V0: a score begins where the model is after its first step, in which no link acts.

    `mass_values` are M, K and Z of the mass in that step.
    """
    (mass, stiffness, viscosity), gravity = mass_values, _gravity(writing, statement)
    x0 = writing.value(statement, "x0")
    position_before = x0 - writing.value(statement, "v0") / RATE
    if "before" in statement.values:
        position_before = writing.value(statement, "before")
    first_position = (
        (2.0 - (stiffness + viscosity) / mass) * x0
        + (viscosity / mass - 1.0) * position_before
        - gravity / mass
    )
    _within(statement, "x0", first_position, _DISTANCE_MAX)
    _within(statement, "the first step", (first_position - x0) * RATE, _SPEED_MAX)
    writing.begins[statement.name] = Begin(first_position, first_position - x0)
    if first_position == x0:
        return (f"X0: {metres(writing.text(statement, 'x0'))}" if x0 else ""), ""
    return (
        f"X0: {first_position!r}m" if first_position else ""
    ), f"V0: {(first_position - x0) * RATE!r}m/s"


def _within(statement: Statement, name: str, value: float, value_max: float) -> None:
    if not abs(value) <= value_max:
        raise ModelError(
            REFUSED["far"].format(name=name, value=value, most=value_max),
            statement.line,
        )


def _gravity(writing: Writing, statement: Statement) -> float:
    gravity_text = statement.values.get("gravity")
    if gravity_text is None or writing.model.dialect == "v1":
        return writing.value(statement, "gravity")
    # mi-gen appends its factor to the text, so of `a + b` it divides only b.
    writing.text(statement, "gravity")
    label = f"gravity of {quote(statement.name)}"
    return writing.model.number(f"{gravity_text}/{RATE}", label, statement.line)


def _heavy(writing: Writing, statement: Statement) -> Value:
    mass = value_of(writing, statement, "M")
    if mass.least <= 0.0:
        refusal = (
            "silent mass"
            if mass.text != writing.params.written(statement.values["M"])
            else "no mass"
        )
        raise ModelError(REFUSED[refusal].format(value=mass.least), statement.line)
    return mass


# --- macros -------------------------------------------------------------------------------------


def _macro(writing: Writing, statement: Statement) -> None:
    values = {name: value_of(writing, statement, name) for name in ("M", "K", "K2", "Z", "Zo")}
    values = {name: value for name, value in values.items() if name in statement.values}
    _heavy(writing, statement)
    for macro_name, macro_value in values.items():
        if macro_name != "M":
            not_negative(macro_value, macro_name, statement.line)
        if macro_value.along and not (
            macro_name in ("K", "Z") and statement.keyword in ("string", "chain")
        ):
            message = REFUSED["signal"].format(
                name=quote(statement.values[macro_name]), value=macro_name
            )
            raise ModelError(message, statement.line)
    row_count, column_count = places.size(statement)
    macro_name = writing.names.new(statement.name)
    x0 = writing.value(statement, "x0")
    _within(statement, "x0", x0, _DISTANCE_MAX)
    air_viscosity = values["Zo"].first if "Zo" in values else 0.0
    macro = writing.macros[statement.name] = places.Macro(
        statement,
        macro_name,
        row_count,
        column_count,
        {
            value: "0" if macro_value.along else macro_value.text
            for value, macro_value in values.items()
        },
        _start(writing, statement, (values["M"].first, 0.0, air_viscosity)),
        writing.text(statement, "x0") if x0 else "0",
        writing.names.new(f"{macro_name}_edge"),
    )
    writing.held.add(macro.edge)
    places.build(macro, writing.laws == "2019")
    _change(writing, macro, {name: value for name, value in values.items() if value.along})
    for nth, (module_name, module_text) in enumerate(macro.modules):
        writing.names.taken.add(module_name)
        writing.add(
            module_name,
            module_text,
            "" if nth else f"{statement.keyword} of {row_count * column_count} points",
        )
    if statement.keyword in ("string", "stiffString") and writing.value(statement, "v0"):
        _pull(writing, macro, values["Z"])


def _change(writing: Writing, macro: places.Macro, values: dict[str, Value]) -> None:
    """Add links between neighbours of a row, for values that follow a signal."""
    if not values:
        return
    law_by_value = {"K": 'law: "k*d"', "Z": 'damping: "z*v"'}
    fields = [law_by_value[name] for name in values]
    fields.append(
        _follows({name.lower(): following(writing, value) for name, value in values.items()})
    )
    for nth, (a, b) in enumerate(macro.neighbours()):
        name = f"{macro.name}_led{nth or ''}"
        macro.modules.append((name, f"LNL: {{between: [{a}, {b}], {', '.join(fields)}}}"))


def _pull(writing: Writing, macro: places.Macro, viscosity: Value) -> None:
    """Add the force of a string's dampers on its fixed ends: with a v0 these do not move, but the
    dampers feel a constant speed.
    """
    if viscosity.along:
        raise ModelError(REFUSED["pulling string"], macro.statement.line)
    damper_force = viscosity.first * writing.value(macro.statement, "v0") / RATE
    end_masses = macro.point_name(0, 1), macro.point_name(0, macro.columns - 2)
    for nth, end_mass in enumerate(end_masses):
        if damper_force:
            name = writing.names.new(f"{macro.name}_pull{nth or ''}")
            comment = "its fixed ends have a speed, which dampers feel" if nth == 0 else ""
            writing.add(name, f"ENF: {{to: {end_mass}, from: {damper_force!r}N}}", comment)


# --- inputs -------------------------------------------------------------------------------------


def _input(writing: Writing, statement: Statement) -> None:
    if statement.keyword == "frcInput":
        return
    source = writing.inputs.get(statement.name)
    target = writing.targets[statement.name] = fed(writing, statement.name, statement.name)
    first_value = 0.0 if source is None else source.first
    writing.held.add(target)
    writing.begins[statement.name] = Begin(
        first_value, jump=first_value - writing.value(statement, "x0")
    )


MAKERS = {
    **dict.fromkeys(("ground", "mass", "massG", "osc"), _mass),
    **dict.fromkeys(STRINGS + MESHES, _macro),
    **dict.fromkeys(("posInput", "frcInput"), _input),
}
