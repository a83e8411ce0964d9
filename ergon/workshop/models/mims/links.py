"""Links of a model as modules of a score."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

from ergon.instruments.following import CONSTANTS_MAX
from ergon.notation.text.errors import quote
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.mims.kicks import Begin, kick
from ergon.workshop.models.mims.laws import LINKS, Link, followable, which
from ergon.workshop.models.mims.masses import not_negative
from ergon.workshop.models.mims.model import Point, Statement
from ergon.workshop.models.mims.points import points, shares, still
from ergon.workshop.models.mims.signals import Value, following, value_of
from ergon.workshop.models.mims.writing import Writing
from ergon.workshop.models.naming import metres
from ergon.workshop.models.refused import REFUSED

_ZERO_VALUE = Value("0", 0.0, 0.0, 0.0)


def link(writing: Writing, statement: Statement, listened: Mapping[int, str]) -> None:
    """Add a link; `listened` gives the links whose force is heard, with the mass on which it is
    heard.
    """
    values = {name: value_of(writing, statement, name) for name in statement.values}
    link_law = _law(writing, statement, values)
    points_by_end = [points(writing, statement, point) for point in statement.points]
    non_negative_fields = (
        ["K", "Z"] if link_law.kind != "LNL" else ["Q"] if "q*d*d" in link_law.law else []
    )
    non_negative_fields += [
        name for name in ("K", "Z", "lim") if name in values and values[name].along
    ]
    for value_name in non_negative_fields:
        not_negative(values.get(value_name, _ZERO_VALUE), value_name, statement.line)
    if "scale" in values and values["scale"].least <= 0.0:
        raise ModelError(REFUSED["scale"].format(value=values["scale"].least), statement.line)
    is_doubled = writing.model.dialect == "v1" and statement.keyword == "nlSpring3"
    first_values = {name: value.first for name, value in values.items()}
    if link_law.damping or first_values.get("Z"):
        shares_by_end = [shares(writing, statement, point) for point in statement.points]
        a, b = (_begin(writing, *end) for end in zip(statement.points, shares_by_end, strict=True))
        force = kick(link_law, first_values, a, b)
        _strike(writing, shares_by_end, 2.0 * force if is_doubled else force)
    if link_law.kind in ("LNL", "BUT"):
        paired_ends = zip(statement.points, points_by_end, strict=True)
        points_by_end = [
            [(1.0, still(writing, point, targets))] if len(targets) > 1 else targets
            for point, targets in paired_ends
        ]
    if max(map(len, points_by_end)) > 1:
        _between(writing, statement, link_law, points_by_end, listened.get(id(statement), ""))
        return
    end_names = [targets[0][1] for targets in points_by_end]
    side_field = ""
    if (
        listened.get(id(statement)) == statement.points[0].name
    ):  # its force on the first end is heard
        end_names.reverse()
        side_field = ", side: above" if link_law.kind == "BUT" else ""
        if not link_law.turns and link_law.kind != "BUT":
            message = REFUSED["both ends"].format(link=quote(statement.name))
            raise ModelError(message, statement.line)
    written_fields = [f"between: [{', '.join(end_names)}]"]
    for field_name, text in (("law", link_law.law), ("damping", link_law.damping)):
        written_fields += [f'{field_name}: "{text}"'] if text else []
    written_fields += _fields(writing, link_law, values, "2*" if is_doubled else "")
    if link_law.rest:
        written_fields += (
            [f"rest: {metres(writing.text(statement, link_law.rest))}"]
            if link_law.rest in values
            else []
        )
    if link_law.kind == "BUT" and first_values.get("thresh"):
        written_fields.append("gap: " + metres(f"-({writing.text(statement, 'thresh')})"))
    module_name = writing.names.new(statement.name)
    writing.links.append((statement, module_name))
    comment = "MIMS adds the force of its nlSpring3 twice" if is_doubled else ""
    writing.add(
        module_name, f"{link_law.kind}: {{{', '.join(written_fields)}{side_field}}}", comment
    )


def _law(writing: Writing, statement: Statement, values: Mapping[str, Value]) -> Link:
    """The law of a link; if signals lead its values, a law that can follow them. Raises
    ModelError.
    """
    following_values = [name for name, value in values.items() if value.along]
    if not following_values:
        first_values = {name: value.first for name, value in values.items()}
        return LINKS[writing.laws][which(statement.keyword, first_values)]
    # The law is chosen by the highest values: a value that follows a signal is above 0 somewhere.
    greatest_values = {name: value.greatest for name, value in values.items()}
    if "smooth" in following_values:  # the valid law would change too
        message = REFUSED["signal"].format(name=quote(statement.values["smooth"]), value="smooth")
        raise ModelError(message, statement.line)
    if len(following_values) > CONSTANTS_MAX:
        message = REFUSED["many signals"].format(count=len(following_values), most=CONSTANTS_MAX)
        raise ModelError(message, statement.line)
    return followable(
        statement.keyword,
        LINKS[writing.laws][which(statement.keyword, greatest_values)],
        following_values,
    )


def _fields(
    writing: Writing, law: Link, values: Mapping[str, Value], factor_text: str
) -> list[str]:
    """The values of a link as fields: constants, and those that follow a signal."""
    written_fields, follows = [], []
    for field_letter, name in law.fields.items():
        value = values.get(name, _ZERO_VALUE)
        if value.along:
            follows.append(f"{field_letter}: {following(writing, value)}")
        else:
            written_fields.append(
                f"{field_letter}: {factor_text}({value.text})"
                if factor_text
                else f"{field_letter}: {value.text}"
            )
    return [*written_fields, f"follows: {{{', '.join(follows)}}}"] if follows else written_fields


def _between(
    writing: Writing,
    statement: Statement,
    link: Link,
    targets_by_end: list[list[tuple[float, str]]],
    listened: str,
) -> None:
    """Write a spring between points that lie between masses, as springs between any two of these
    masses.

    c_i is the share of mass i in the first point less its share in the second. The force K·Σcx
    is distributed by the same shares: -c_i·K·Σcx is the sum of springs -c_i·c_j·K, because the c
    add up to 0.
    """
    shares_by_mass: dict[str, float] = {}
    for sign, targets in zip((1.0, -1.0), targets_by_end, strict=True):
        for share, target in targets:
            shares_by_mass[target] = shares_by_mass.get(target, 0.0) + sign * share
    listened_target = writing.targets.get(listened)
    comment = f"{statement.keyword} of {quote(statement.name)}, between masses"
    for (first_target, first_share), (second_target, second_share) in combinations(
        shares_by_mass.items(), 2
    ):
        end_names = [first_target, second_target]
        if first_target == listened_target:
            end_names.reverse()  # a force is heard at the second end
        module_name = writing.names.new(statement.name)
        if not listened or listened_target in (first_target, second_target):
            writing.links.append((statement, module_name))
        module_fields = {
            field_name: f"{-first_share * second_share!r}*({writing.text(statement, field_name)})"
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
        writing.add(
            module_name,
            f"{kind}: {{between: [{', '.join(end_names)}], {field_texts}}}",
            comment,
        )
        comment = ""


def _begin(writing: Writing, point: Point, targets: list[tuple[float, str]]) -> Begin:
    """The start of a point in the first step. A point of a macro is felt to jump there from 0,
    whatever the macro's x0.
    """
    begin = writing.begins[point.name]
    macro = writing.macros.get(point.name)
    if macro is None:
        return begin
    mobile_share = sum(share for share, target in targets if target not in writing.held)
    fixed_share = sum(share for share, target in targets if target in writing.held)
    position = mobile_share * begin.x + fixed_share * writing.value(macro.statement, "x0")
    step = mobile_share * begin.step
    return Begin(position, step, position - step)


def _strike(writing: Writing, targets_by_end: list[list[tuple[float, str]]], force: float) -> None:
    """Strikes of a force on the first end of a link, and of its opposite on the second."""
    for signed_force, targets in zip((force, -force), targets_by_end, strict=True):
        for share, target in targets:
            if force and target not in writing.held:
                writing.kicks[target] = writing.kicks.get(target, 0.0) + signed_force * share
