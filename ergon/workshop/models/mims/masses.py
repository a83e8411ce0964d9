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


def push(writing: Writing, model_statement: Statement) -> None:
    """Apply a force from outside."""
    if model_statement.keyword != "frcInput":
        return
    for target_share, mass_target in points(writing, model_statement, model_statement.points[0]):
        if model_statement.name in writing.inputs:
            push_name = writing.names.new(f"{model_statement.name}_push")
            scale = "" if target_share == 1.0 else f", scale: {target_share!r}"
            start = writing.inputs[model_statement.name].start
            writing.add(
                push_name, f"ENF: {{to: {mass_target}, from: {model_statement.name}{start}{scale}}}"
            )


def not_negative(value: Value, name: str, line: int) -> None:
    """Refuse a value below 0, which would make energy. Raises ModelError."""
    if value.least < 0.0:
        raise ModelError(REFUSED["negative"].format(name=name, value=value.least), line)


# --- masses -------------------------------------------------------------------------------------


def _mass(writing: Writing, model_statement: Statement) -> None:
    mass_name = writing.targets[model_statement.name] = writing.names.new(model_statement.name)
    if model_statement.keyword == "ground":
        x0 = writing.value(model_statement, "x0")
        _within(model_statement, "x0", x0, _DISTANCE_MAX)
        writing.begins[model_statement.name] = Begin(x0)
        writing.held.add(mass_name)
        writing.add(
            mass_name,
            f"SOL: {{X0: {metres(writing.text(model_statement, 'x0'))}}}" if x0 else "SOL: {}",
        )
        return
    mass_amount = _heavy(writing, model_statement)
    ties = {
        tie: value_of(writing, model_statement, tie)
        for tie in ("K", "Z")
        if tie in model_statement.values
    }
    for tie, value in ties.items():
        not_negative(value, tie, model_statement.line)
    follows = any(value.along for value in ties.values())
    module_fields = [f"M: {mass_amount.text}"]
    if mass_amount.along is not None:
        follows = bool(ties)  # a mass with ties has no poles of its own
        lightest = mass_amount.least
        module_fields = [
            f"M: {lightest!r}",
            f"follows: {{M: {following(writing, mass_amount, is_ahead=True)}}}",
        ]
    if not follows:
        module_fields += [f"{tie}: {value.text}" for tie, value in ties.items()]
    k, z = (ties[tie].first if tie in ties else 0.0 for tie in ("K", "Z"))
    module_fields += [
        text for text in _start(writing, model_statement, (mass_amount.first, k, z)) if text
    ]
    kind = "CEL" if ties and not follows else "MAS"
    writing.add(mass_name, f"{kind}: {{{', '.join(module_fields)}}}")
    if follows:
        _tie(writing, mass_name, ties)
    if gravity := _gravity(writing, model_statement):
        weight = writing.names.new(f"{mass_name}_weight")
        writing.add(
            weight, f"ENF: {{to: {mass_name}, from: {-gravity!r}N}}", f"gravity {gravity:g}"
        )


def _tie(writing: Writing, mass_name: str, ties: dict[str, Value]) -> None:
    """Tie a mass to 0 by values that follow a signal, taken from the next sample."""
    ground = writing.names.new(f"{mass_name}_ground")
    writing.add(ground, "SOL: {}")
    laws = {"K": 'law: "k*d"', "Z": 'damping: "z*v"'}
    written_fields = [laws[tie] for tie in ties]
    written_fields += [
        f"{tie.lower()}: {value.text}" for tie, value in ties.items() if not value.along
    ]
    follows = {
        tie.lower(): following(writing, value, is_ahead=True)
        for tie, value in ties.items()
        if value.along
    }
    if follows:
        written_fields.append(_follows(follows))
    tie = writing.names.new(f"{mass_name}_tie")
    writing.add(tie, f"LNL: {{between: [{ground}, {mass_name}], {', '.join(written_fields)}}}")


def _follows(values: dict[str, str]) -> str:
    return f"follows: {{{', '.join(f'{name}: {text}' for name, text in values.items())}}}"


def _start(
    writing: Writing, model_statement: Statement, mass_numbers: tuple[float, float, float]
) -> tuple[str, str]:
    """X0 and V0: a score begins where the model is after its first step, in which no link acts.

    `mass_numbers` are M, K and Z of the mass in that step.
    """
    (mass_number, k, z), gravity = mass_numbers, _gravity(writing, model_statement)
    x0 = writing.value(model_statement, "x0")
    position_before = x0 - writing.value(model_statement, "v0") / RATE
    if "before" in model_statement.values:
        position_before = writing.value(model_statement, "before")
    first_position = (
        (2.0 - (k + z) / mass_number) * x0
        + (z / mass_number - 1.0) * position_before
        - gravity / mass_number
    )
    _within(model_statement, "x0", first_position, _DISTANCE_MAX)
    _within(model_statement, "the first step", (first_position - x0) * RATE, _SPEED_MAX)
    writing.begins[model_statement.name] = Begin(first_position, first_position - x0)
    if first_position == x0:
        return (f"X0: {metres(writing.text(model_statement, 'x0'))}" if x0 else ""), ""
    return (
        f"X0: {first_position!r}m" if first_position else ""
    ), f"V0: {(first_position - x0) * RATE!r}m/s"


def _within(statement: Statement, value_name: str, bound_value: float, value_max: float) -> None:
    if not abs(bound_value) <= value_max:
        raise ModelError(
            REFUSED["far"].format(name=value_name, value=bound_value, most=value_max),
            statement.line,
        )


def _gravity(writing: Writing, model_statement: Statement) -> float:
    gravity_text = model_statement.values.get("gravity")
    if gravity_text is None or writing.model.dialect == "v1":
        return writing.value(model_statement, "gravity")
    # mi-gen appends its factor to the text, so of `a + b` it divides only b.
    writing.text(model_statement, "gravity")
    label = f"gravity of {quote(model_statement.name)}"
    return writing.model.number(f"{gravity_text}/{RATE}", label, model_statement.line)


def _heavy(writing: Writing, model_statement: Statement) -> Value:
    mass_amount = value_of(writing, model_statement, "M")
    if mass_amount.least <= 0.0:
        refusal = (
            "silent mass"
            if mass_amount.text != writing.params.written(model_statement.values["M"])
            else "no mass"
        )
        raise ModelError(REFUSED[refusal].format(value=mass_amount.least), model_statement.line)
    return mass_amount


# --- macros -------------------------------------------------------------------------------------


def _macro(writing: Writing, model_statement: Statement) -> None:
    model_values = {
        name: value_of(writing, model_statement, name) for name in ("M", "K", "K2", "Z", "Zo")
    }
    model_values = {
        name: value for name, value in model_values.items() if name in model_statement.values
    }
    _heavy(writing, model_statement)
    for macro_name, macro_value in model_values.items():
        if macro_name != "M":
            not_negative(macro_value, macro_name, model_statement.line)
        if macro_value.along and not (
            macro_name in ("K", "Z") and model_statement.keyword in ("string", "chain")
        ):
            message = REFUSED["signal"].format(
                name=quote(model_statement.values[macro_name]), value=macro_name
            )
            raise ModelError(message, model_statement.line)
    row_count, column_count = places.size(model_statement)
    macro_name = writing.names.new(model_statement.name)
    x0 = writing.value(model_statement, "x0")
    _within(model_statement, "x0", x0, _DISTANCE_MAX)
    air = model_values["Zo"].first if "Zo" in model_values else 0.0
    macro = writing.macros[model_statement.name] = places.Macro(
        model_statement,
        macro_name,
        row_count,
        column_count,
        {
            value: "0" if macro_value.along else macro_value.text
            for value, macro_value in model_values.items()
        },
        _start(writing, model_statement, (model_values["M"].first, 0.0, air)),
        writing.text(model_statement, "x0") if x0 else "0",
        writing.names.new(f"{macro_name}_edge"),
    )
    writing.held.add(macro.edge)
    places.build(macro, writing.laws == "2019")
    _change(writing, macro, {name: value for name, value in model_values.items() if value.along})
    for nth, (macro_module, module_text) in enumerate(macro.modules):
        writing.names.taken.add(macro_module)
        writing.add(
            macro_module,
            module_text,
            "" if nth else f"{model_statement.keyword} of {row_count * column_count} points",
        )
    if model_statement.keyword in ("string", "stiffString") and writing.value(
        model_statement, "v0"
    ):
        _pull(writing, macro, model_values["Z"])


def _change(writing: Writing, macro: places.Macro, model_values: dict[str, Value]) -> None:
    """Add links between neighbours of a row, for values that follow a signal."""
    if not model_values:
        return
    laws = {"K": 'law: "k*d"', "Z": 'damping: "z*v"'}
    written_fields = [laws[name] for name in model_values]
    written_fields.append(
        _follows(
            {
                name.lower(): following(writing, parameter)
                for name, parameter in model_values.items()
            }
        )
    )
    for nth, (a, b) in enumerate(macro.neighbours()):
        name = f"{macro.name}_led{nth or ''}"
        macro.modules.append((name, f"LNL: {{between: [{a}, {b}], {', '.join(written_fields)}}}"))


def _pull(writing: Writing, macro: places.Macro, z: Value) -> None:
    """Add the force of a string's dampers on its fixed ends: with a v0 these do not move, but the
    dampers feel a constant speed.
    """
    if z.along:
        raise ModelError(REFUSED["pulling string"], macro.statement.line)
    damper_force = z.first * writing.value(macro.statement, "v0") / RATE
    corners = macro.point_name(0, 1), macro.point_name(0, macro.columns - 2)
    for nth, corner_mass in enumerate(corners):
        if damper_force:
            name = writing.names.new(f"{macro.name}_pull{nth or ''}")
            comment = "its fixed ends have a speed, which dampers feel" if nth == 0 else ""
            writing.add(name, f"ENF: {{to: {corner_mass}, from: {damper_force!r}N}}", comment)


# --- inputs -------------------------------------------------------------------------------------


def _input(writing: Writing, model_statement: Statement) -> None:
    if model_statement.keyword == "frcInput":
        return
    input_source = writing.inputs.get(model_statement.name)
    input_name = writing.targets[model_statement.name] = fed(
        writing, model_statement.name, model_statement.name
    )
    first_value = 0.0 if input_source is None else input_source.first
    writing.held.add(input_name)
    writing.begins[model_statement.name] = Begin(
        first_value, jump=first_value - writing.value(model_statement, "x0")
    )


MAKERS = {
    **dict.fromkeys(("ground", "mass", "massG", "osc"), _mass),
    **dict.fromkeys(STRINGS + MESHES, _macro),
    **dict.fromkeys(("posInput", "frcInput"), _input),
}
