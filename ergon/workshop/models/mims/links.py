"""Links of a model as modules of a score."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

from ergon.instruments.following import CONSTANTS_MAX
from ergon.notation.text.errors import quote
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.mims.kicks import InitialMotion, jump_force
from ergon.workshop.models.mims.laws import LINKS, Link, followable, law_name
from ergon.workshop.models.mims.masses import refuse_negative
from ergon.workshop.models.mims.model import Point, Statement
from ergon.workshop.models.mims.points import fixed_point, force_shares, targets_of_point
from ergon.workshop.models.mims.signals import Value, signal_field_text, value_of
from ergon.workshop.models.mims.writing import ScoreDraft
from ergon.workshop.models.naming import length_text
from ergon.workshop.models.refused import REFUSED

_ZERO_VALUE = Value("0", 0.0, 0.0, 0.0)


def add_link(
    draft: ScoreDraft, statement: Statement, mass_by_heard_link: Mapping[int, str]
) -> None:
    """Add a link; `mass_by_heard_link` gives the links whose force is heard, with the mass on which
    it is heard.
    """
    values = {name: value_of(draft, statement, name) for name in statement.values}
    link_law = _law(draft, statement, values)
    points_by_end = [targets_of_point(draft, statement, point) for point in statement.points]
    non_negative_fields = (
        ["K", "Z"] if link_law.kind != "LNL" else ["Q"] if "q*d*d" in link_law.law else []
    )
    non_negative_fields += [
        name for name in ("K", "Z", "lim") if name in values and values[name].linear
    ]
    for value_name in non_negative_fields:
        refuse_negative(values.get(value_name, _ZERO_VALUE), value_name, statement.line)
    if "scale" in values and values["scale"].value_min <= 0.0:
        raise ModelError(REFUSED["scale"].format(value=values["scale"].value_min), statement.line)
    is_doubled = draft.model.dialect == "v1" and statement.keyword == "nlSpring3"
    first_values = {name: value.first_value for name, value in values.items()}
    if link_law.damping or first_values.get("Z"):
        shares_by_end = [force_shares(draft, statement, point) for point in statement.points]
        a, b = (
            _initial_motion(draft, *end)
            for end in zip(statement.points, shares_by_end, strict=True)
        )
        force = jump_force(link_law, first_values, a, b)
        _add_initial_forces(draft, shares_by_end, 2.0 * force if is_doubled else force)
    if link_law.kind in ("LNL", "BUT"):
        paired_ends = zip(statement.points, points_by_end, strict=True)
        points_by_end = [
            [(1.0, fixed_point(draft, point, targets))] if len(targets) > 1 else targets
            for point, targets in paired_ends
        ]
    if max(map(len, points_by_end)) > 1:
        _add_pairwise_springs(
            draft, statement, link_law, points_by_end, mass_by_heard_link.get(id(statement), "")
        )
        return
    end_names = [targets[0][1] for targets in points_by_end]
    side_field = ""
    if (
        mass_by_heard_link.get(id(statement)) == statement.points[0].name
    ):  # its force on the first end is heard
        end_names.reverse()
        side_field = ", side: above" if link_law.kind == "BUT" else ""
        if not link_law.is_symmetric and link_law.kind != "BUT":
            message = REFUSED["both ends"].format(link=quote(statement.name))
            raise ModelError(message, statement.line)
    fields = [f"between: [{', '.join(end_names)}]"]
    for field_name, text in (("law", link_law.law), ("damping", link_law.damping)):
        fields += [f'{field_name}: "{text}"'] if text else []
    fields += _value_fields(draft, link_law, values, "2*" if is_doubled else "")
    if link_law.rest_name:
        fields += (
            [f"rest: {length_text(draft.text(statement, link_law.rest_name))}"]
            if link_law.rest_name in values
            else []
        )
    if link_law.kind == "BUT" and first_values.get("thresh"):
        fields.append("gap: " + length_text(f"-({draft.text(statement, 'thresh')})"))
    module_name = draft.names.new(statement.name)
    draft.links.append((statement, module_name))
    comment = "MIMS adds the force of its nlSpring3 twice" if is_doubled else ""
    draft.add(module_name, f"{link_law.kind}: {{{', '.join(fields)}{side_field}}}", comment)


def _law(draft: ScoreDraft, statement: Statement, values: Mapping[str, Value]) -> Link:
    """The law of a link; if signals lead its values, a law that can follow them. Raises
    ModelError.
    """
    following_values = [name for name, value in values.items() if value.linear]
    if not following_values:
        first_values = {name: value.first_value for name, value in values.items()}
        return LINKS[draft.laws][law_name(statement.keyword, first_values)]
    # The law is chosen by the highest values: a value that follows a signal is above 0 somewhere.
    greatest_values = {name: value.value_max for name, value in values.items()}
    if "smooth" in following_values:  # the valid law would change too
        message = REFUSED["signal"].format(name=quote(statement.values["smooth"]), value="smooth")
        raise ModelError(message, statement.line)
    if len(following_values) > CONSTANTS_MAX:
        message = REFUSED["many signals"].format(count=len(following_values), most=CONSTANTS_MAX)
        raise ModelError(message, statement.line)
    return followable(
        statement.keyword,
        LINKS[draft.laws][law_name(statement.keyword, greatest_values)],
        following_values,
    )


def _value_fields(
    draft: ScoreDraft, law: Link, values: Mapping[str, Value], factor_text: str
) -> list[str]:
    """The values of a link as fields: constants, and those that follow a signal."""
    fields, follows = [], []
    for field_letter, name in law.fields.items():
        field_value = values.get(name, _ZERO_VALUE)
        if field_value.linear:
            follows.append(f"{field_letter}: {signal_field_text(draft, field_value)}")
        else:
            fields.append(
                f"{field_letter}: {factor_text}({field_value.text})"
                if factor_text
                else f"{field_letter}: {field_value.text}"
            )
    return [*fields, f"follows: {{{', '.join(follows)}}}"] if follows else fields


def _add_pairwise_springs(
    draft: ScoreDraft,
    statement: Statement,
    link: Link,
    shares_by_end: list[list[tuple[float, str]]],
    audible_end: str,
) -> None:
    """Write a spring between points that lie between masses, as springs between any two of these
    masses.

    c_i is the share of mass i in the first point less its share in the second. The force K·Σcx
    is distributed by the same shares: -c_i·K·Σcx is the sum of springs -c_i·c_j·K, because the c
    add up to 0.
    """
    shares_by_mass: dict[str, float] = {}
    for sign, end_shares in zip((1.0, -1.0), shares_by_end, strict=True):
        for share, module in end_shares:
            shares_by_mass[module] = shares_by_mass.get(module, 0.0) + sign * share
    audible_module = draft.mass_modules.get(audible_end)
    comment = f"{statement.keyword} of {quote(statement.name)}, between masses"
    for (first_mass, first_share), (second_mass, second_share) in combinations(
        shares_by_mass.items(), 2
    ):
        end_names = [first_mass, second_mass]
        if first_mass == audible_module:
            end_names.reverse()  # a force is heard at the second end
        module_name = draft.names.new(statement.name)
        if not audible_end or audible_module in (first_mass, second_mass):
            draft.links.append((statement, module_name))
        module_fields = {
            field_name: f"{-first_share * second_share!r}*({draft.text(statement, field_name)})"
            for field_name in link.fields
        }
        field_texts = ", ".join(
            f"{field_name}: {text}" for field_name, text in module_fields.items()
        )
        kind = link.kind
        if (
            first_share * second_share > 0.0
        ):  # below 0, as no spring is by itself; all of them together are none
            kind = "LNL"
            law_by_field = {"K": 'law: "k*d"', "Z": 'damping: "z*v"'}
            laws = [law_by_field[field_name] for field_name in module_fields]
            field_texts = ", ".join(
                [
                    *laws,
                    *(
                        f"{field_name.lower()}: {text}"
                        for field_name, text in module_fields.items()
                    ),
                ]
            )
        draft.add(
            module_name, f"{kind}: {{between: [{', '.join(end_names)}], {field_texts}}}", comment
        )
        comment = ""


def _initial_motion(
    draft: ScoreDraft, point: Point, shares: list[tuple[float, str]]
) -> InitialMotion:
    """The start of a point in the first step. A point of a macro is felt to jump there from 0,
    whatever the macro's x0.
    """
    motion = draft.initial_motions[point.name]
    macro = draft.macros.get(point.name)
    if macro is None:
        return motion
    mobile_share = sum(share for share, module in shares if module not in draft.immobile)
    fixed_share = sum(share for share, target in shares if target in draft.immobile)
    position = mobile_share * motion.x + fixed_share * draft.value(macro.statement, "x0")
    step = mobile_share * motion.step
    return InitialMotion(position, step, position - step)


def _add_initial_forces(
    draft: ScoreDraft, shares_by_end: list[list[tuple[float, str]]], force: float
) -> None:
    """Strikes of a force on the first end of a link, and of its opposite on the second."""
    for signed_force, end_shares in zip((force, -force), shares_by_end, strict=True):
        for share, module in end_shares:
            if force and module not in draft.immobile:
                draft.initial_forces[module] = (
                    draft.initial_forces.get(module, 0.0) + signed_force * share
                )
