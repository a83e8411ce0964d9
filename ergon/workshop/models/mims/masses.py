"""Masses, macros and inputs of a model as modules of a score."""

from __future__ import annotations

from ergon.notation.text.errors import quote
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.mims import places
from ergon.workshop.models.mims.grammar import MESHES, STRINGS
from ergon.workshop.models.mims.kicks import InitialMotion
from ergon.workshop.models.mims.model import Statement
from ergon.workshop.models.mims.points import targets_of_point
from ergon.workshop.models.mims.proxies import signals_in
from ergon.workshop.models.mims.signals import Value, add_imposed_point, signal_field_text, value_of
from ergon.workshop.models.mims.writing import ScoreDraft
from ergon.workshop.models.naming import length_text
from ergon.workshop.models.page import RATE
from ergon.workshop.models.refused import REFUSED

_DISTANCE_MAX, _SPEED_MAX = 1e3, 1e6  # [m], [m/s] of a score


def add_force_input(draft: ScoreDraft, statement: Statement) -> None:
    """Apply a force from outside."""
    if statement.keyword != "frcInput":
        return
    for share, target in targets_of_point(draft, statement, statement.points[0]):
        if statement.name in draft.inputs:
            push_name = draft.names.new(f"{statement.name}_push")
            scale_field = "" if share == 1.0 else f", scale: {share!r}"
            start = draft.inputs[statement.name].start_field_text
            draft.add(
                push_name, f"ENF: {{to: {target}, from: {statement.name}{start}{scale_field}}}"
            )


def refuse_negative(checked_value: Value, name: str, line: int) -> None:
    """Refuse a value below 0, which would make energy. Raises ModelError."""
    if checked_value.value_min < 0.0:
        raise ModelError(REFUSED["negative"].format(name=name, value=checked_value.value_min), line)


# --- masses -------------------------------------------------------------------------------------


def _add_mass(draft: ScoreDraft, statement: Statement) -> None:
    mass_name = draft.mass_modules[statement.name] = draft.names.new(statement.name)
    if statement.keyword == "ground":
        x0 = draft.value(statement, "x0")
        _check_range(statement, "x0", x0, _DISTANCE_MAX)
        draft.initial_motions[statement.name] = InitialMotion(x0)
        draft.immobile.add(mass_name)
        draft.add(
            mass_name,
            f"SOL: {{X0: {length_text(draft.text(statement, 'x0'))}}}" if x0 else "SOL: {}",
        )
        return
    mass = _positive_mass(draft, statement)
    ground_constants = {
        constant_name: value_of(draft, statement, constant_name)
        for constant_name in ("K", "Z")
        if constant_name in statement.values
    }
    for constant_name, constant in ground_constants.items():
        refuse_negative(constant, constant_name, statement.line)
    follows_signals = any(constant.linear for constant in ground_constants.values())
    fields = [f"M: {mass.text}"]
    if mass.linear is not None:
        follows_signals = bool(ground_constants)  # a mass with ties has no poles of its own
        mass_min = mass.value_min
        fields = [
            f"M: {mass_min!r}",
            f"follows: {{M: {signal_field_text(draft, mass, is_ahead=True)}}}",
        ]
    if not follows_signals:
        fields += [
            f"{constant_name}: {constant.text}"
            for constant_name, constant in ground_constants.items()
        ]
    k, z = (
        ground_constants[constant_name].first_value if constant_name in ground_constants else 0.0
        for constant_name in ("K", "Z")
    )
    fields += [text for text in _start_fields(draft, statement, (mass.first_value, k, z)) if text]
    kind = "CEL" if ground_constants and not follows_signals else "MAS"
    draft.add(mass_name, f"{kind}: {{{', '.join(fields)}}}")
    if follows_signals:
        _tie_to_ground(draft, mass_name, ground_constants)
    if gravity := _gravity(draft, statement):
        weight_name = draft.names.new(f"{mass_name}_weight")
        draft.add(
            weight_name, f"ENF: {{to: {mass_name}, from: {-gravity!r}N}}", f"gravity {gravity:g}"
        )


def _tie_to_ground(draft: ScoreDraft, mass_name: str, ground_constants: dict[str, Value]) -> None:
    """Tie a mass to 0 by values that follow a signal, taken from the next sample."""
    ground_name = draft.names.new(f"{mass_name}_ground")
    draft.add(ground_name, "SOL: {}")
    law_by_value = {"K": 'law: "k*d"', "Z": 'damping: "z*v"'}
    fields = [law_by_value[tie_name] for tie_name in ground_constants]
    fields += [
        f"{tie_name.lower()}: {value.text}"
        for tie_name, value in ground_constants.items()
        if not value.linear
    ]
    followed_values = {
        tie_name.lower(): signal_field_text(draft, value, is_ahead=True)
        for tie_name, value in ground_constants.items()
        if value.linear
    }
    if followed_values:
        fields.append(_follows_field(followed_values))
    tie_name = draft.names.new(f"{mass_name}_tie")
    draft.add(tie_name, f"LNL: {{between: [{ground_name}, {mass_name}], {', '.join(fields)}}}")


def _follows_field(values: dict[str, str]) -> str:
    return f"follows: {{{', '.join(f'{name}: {text}' for name, text in values.items())}}}"


def _start_fields(
    draft: ScoreDraft, statement: Statement, mass_stiffness_viscosity: tuple[float, float, float]
) -> tuple[str, str]:
    """X0 and V0: a score begins where the model is after its first step, in which no link acts.

    `mass_stiffness_viscosity` are M, K and Z of the mass in that step.
    """
    (mass, stiffness, viscosity), gravity = mass_stiffness_viscosity, _gravity(draft, statement)
    x0 = draft.value(statement, "x0")
    previous_position = x0 - draft.value(statement, "v0") / RATE
    if "before" in statement.values:
        previous_position = draft.value(statement, "before")
    position = (
        (2.0 - (stiffness + viscosity) / mass) * x0
        + (viscosity / mass - 1.0) * previous_position
        - gravity / mass
    )
    _check_range(statement, "x0", position, _DISTANCE_MAX)
    _check_range(statement, "the first step", (position - x0) * RATE, _SPEED_MAX)
    draft.initial_motions[statement.name] = InitialMotion(position, position - x0)
    if position == x0:
        return (f"X0: {length_text(draft.text(statement, 'x0'))}" if x0 else ""), ""
    return (f"X0: {position!r}m" if position else ""), f"V0: {(position - x0) * RATE!r}m/s"


def _check_range(statement: Statement, name: str, range_value: float, value_max: float) -> None:
    if not abs(range_value) <= value_max:
        raise ModelError(
            REFUSED["far"].format(name=name, value=range_value, most=value_max), statement.line
        )


def _gravity(draft: ScoreDraft, statement: Statement) -> float:
    gravity_text = statement.values.get("gravity")
    if gravity_text is None or draft.model.dialect == "v1":
        return draft.value(statement, "gravity")
    # mi-gen appends its factor to the text, so of `a + b` it divides only b.
    draft.text(statement, "gravity")
    label = f"gravity of {quote(statement.name)}"
    return draft.model.number(f"{gravity_text}/{RATE}", label, statement.line)


def _positive_mass(draft: ScoreDraft, statement: Statement) -> Value:
    mass = value_of(draft, statement, "M")
    if mass.value_min <= 0.0:
        refusal = "silent mass" if signals_in(draft.model, statement.values["M"]) else "no mass"
        raise ModelError(REFUSED[refusal].format(value=mass.value_min), statement.line)
    return mass


# --- macros -------------------------------------------------------------------------------------


def _add_macro(draft: ScoreDraft, statement: Statement) -> None:
    values = {name: value_of(draft, statement, name) for name in ("M", "K", "K2", "Z", "Zo")}
    values = {name: value for name, value in values.items() if name in statement.values}
    _positive_mass(draft, statement)
    for name, macro_value in values.items():
        if name != "M":
            refuse_negative(macro_value, name, statement.line)
        if macro_value.linear and not (
            name in ("K", "Z") and statement.keyword in ("string", "chain")
        ):
            message = REFUSED["signal"].format(name=quote(statement.values[name]), value=name)
            raise ModelError(message, statement.line)
    n_rows, n_columns = places.dimensions(statement)
    name = draft.names.new(statement.name)
    x0 = draft.value(statement, "x0")
    _check_range(statement, "x0", x0, _DISTANCE_MAX)
    air_viscosity = values["Zo"].first_value if "Zo" in values else 0.0
    macro = draft.macros[statement.name] = places.Macro(
        statement,
        name,
        n_rows,
        n_columns,
        {
            value: "0" if macro_value.linear else macro_value.text
            for value, macro_value in values.items()
        },
        _start_fields(draft, statement, (values["M"].first_value, 0.0, air_viscosity)),
        draft.text(statement, "x0") if x0 else "0",
        draft.names.new(f"{name}_edge"),
    )
    draft.immobile.add(macro.edge_name)
    places.add_modules(macro, draft.laws == "2019")
    _add_signal_links(draft, macro, {name: value for name, value in values.items() if value.linear})
    for module_index, (module_name, module_text) in enumerate(macro.modules):
        draft.names.used_names.add(module_name)
        draft.add(
            module_name,
            module_text,
            "" if module_index else f"{statement.keyword} of {n_rows * n_columns} points",
        )
    if statement.keyword in ("string", "stiffString") and draft.value(statement, "v0"):
        _add_end_forces(draft, macro, values["Z"])


def _add_signal_links(draft: ScoreDraft, macro: places.Macro, values: dict[str, Value]) -> None:
    """Add links between neighbours of a row, for values that follow a signal."""
    if not values:
        return
    law_by_value = {"K": 'law: "k*d"', "Z": 'damping: "z*v"'}
    fields = [law_by_value[name] for name in values]
    fields.append(
        _follows_field(
            {name.lower(): signal_field_text(draft, value) for name, value in values.items()}
        )
    )
    for nth, (a, b) in enumerate(macro.neighbours()):
        name = f"{macro.name}_led{nth or ''}"
        macro.modules.append((name, f"LNL: {{between: [{a}, {b}], {', '.join(fields)}}}"))


def _add_end_forces(draft: ScoreDraft, macro: places.Macro, viscosity: Value) -> None:
    """Add the force of a string's dampers on its fixed ends: with a v0 these do not move, but the
    dampers feel a constant speed.
    """
    if viscosity.linear:
        raise ModelError(REFUSED["pulling string"], macro.statement.line)
    damper_force = viscosity.first_value * draft.value(macro.statement, "v0") / RATE
    end_masses = macro.point_name(0, 1), macro.point_name(0, macro.columns - 2)
    for nth, end_mass in enumerate(end_masses):
        if damper_force:
            name = draft.names.new(f"{macro.name}_pull{nth or ''}")
            comment = "its fixed ends have a speed, which dampers feel" if nth == 0 else ""
            draft.add(name, f"ENF: {{to: {end_mass}, from: {damper_force!r}N}}", comment)


# --- inputs -------------------------------------------------------------------------------------


def _add_input(draft: ScoreDraft, statement: Statement) -> None:
    if statement.keyword == "frcInput":
        return
    source = draft.inputs.get(statement.name)
    target = draft.mass_modules[statement.name] = add_imposed_point(
        draft, statement.name, statement.name
    )
    position = 0.0 if source is None else source.first_sample
    draft.immobile.add(target)
    draft.initial_motions[statement.name] = InitialMotion(
        position, jump=position - draft.value(statement, "x0")
    )


MAKERS = {
    **dict.fromkeys(("ground", "mass", "massG", "osc"), _add_mass),
    **dict.fromkeys(STRINGS + MESHES, _add_macro),
    **dict.fromkeys(("posInput", "frcInput"), _add_input),
}
