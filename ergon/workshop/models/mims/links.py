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


def link(writing: Writing, model_statement: Statement, listened: Mapping[int, str]) -> None:
    """Add a link; `listened` gives the links whose force is heard, with the mass on which it is
    heard.
    """
    model_values = {
        name: value_of(writing, model_statement, name) for name in model_statement.values
    }
    link_law = _law(writing, model_statement, model_values)
    ends_of = [points(writing, model_statement, point) for point in model_statement.points]
    signed = ["K", "Z"] if link_law.kind != "LNL" else ["Q"] if "q*d*d" in link_law.law else []
    signed += [
        name for name in ("K", "Z", "lim") if name in model_values and model_values[name].along
    ]
    for link_name in signed:
        not_negative(model_values.get(link_name, _ZERO_VALUE), link_name, model_statement.line)
    if "scale" in model_values and model_values["scale"].least <= 0.0:
        raise ModelError(
            REFUSED["scale"].format(value=model_values["scale"].least), model_statement.line
        )
    is_halved = writing.model.dialect == "v1" and model_statement.keyword == "nlSpring3"
    firsts = {name: value.first for name, value in model_values.items()}
    if link_law.damping or firsts.get("Z"):
        end_shares = [shares(writing, model_statement, point) for point in model_statement.points]
        a, b = (
            _begin(writing, *end) for end in zip(model_statement.points, end_shares, strict=True)
        )
        force = kick(link_law, firsts, a, b)
        _strike(writing, end_shares, 2.0 * force if is_halved else force)
    if link_law.kind in ("LNL", "BUT"):
        point_ends = zip(model_statement.points, ends_of, strict=True)
        ends_of = [
            [(1.0, still(writing, point, shared))] if len(shared) > 1 else shared
            for point, shared in point_ends
        ]
    if max(map(len, ends_of)) > 1:
        _between(writing, model_statement, link_law, ends_of, listened.get(id(model_statement), ""))
        return
    end_points = [targets[0][1] for targets in ends_of]
    side_text = ""
    if (
        listened.get(id(model_statement)) == model_statement.points[0].name
    ):  # its force on the first end is heard
        end_points.reverse()
        side_text = ", side: above" if link_law.kind == "BUT" else ""
        if not link_law.turns and link_law.kind != "BUT":
            message = REFUSED["both ends"].format(link=quote(model_statement.name))
            raise ModelError(message, model_statement.line)
    written_fields = [f"between: [{', '.join(end_points)}]"]
    for word, text in (("law", link_law.law), ("damping", link_law.damping)):
        written_fields += [f'{word}: "{text}"'] if text else []
    written_fields += _fields(writing, link_law, model_values, "2*" if is_halved else "")
    if link_law.rest:
        written_fields += (
            [f"rest: {metres(writing.text(model_statement, link_law.rest))}"]
            if link_law.rest in model_values
            else []
        )
    if link_law.kind == "BUT" and firsts.get("thresh"):
        written_fields.append("gap: " + metres(f"-({writing.text(model_statement, 'thresh')})"))
    link_name = writing.names.new(model_statement.name)
    writing.links.append((model_statement, link_name))
    comment = "MIMS adds the force of its nlSpring3 twice" if is_halved else ""
    writing.add(link_name, f"{link_law.kind}: {{{', '.join(written_fields)}{side_text}}}", comment)


def _law(writing: Writing, model_statement: Statement, model_values: Mapping[str, Value]) -> Link:
    """The law of a link; if signals lead its values, a law that can follow them. Raises
    ModelError.
    """
    led = [name for name, value in model_values.items() if value.along]
    if not led:
        firsts = {name: value.first for name, value in model_values.items()}
        return LINKS[writing.laws][which(model_statement.keyword, firsts)]
    # The law is chosen by the highest values: a value that follows a signal is above 0 somewhere.
    upper_values = {name: value.greatest for name, value in model_values.items()}
    if "smooth" in led:  # the valid law would change too
        message = REFUSED["signal"].format(
            name=quote(model_statement.values["smooth"]), value="smooth"
        )
        raise ModelError(message, model_statement.line)
    if len(led) > CONSTANTS_MAX:
        message = REFUSED["many signals"].format(count=len(led), most=CONSTANTS_MAX)
        raise ModelError(message, model_statement.line)
    return followable(
        model_statement.keyword,
        LINKS[writing.laws][which(model_statement.keyword, upper_values)],
        led,
    )


def _fields(
    writing: Writing, law: Link, law_values: Mapping[str, Value], share_text: str
) -> list[str]:
    """The values of a link as fields: constants, and those that follow a signal."""
    written_fields, follows = [], []
    for field_letter, name in law.fields.items():
        field_value = law_values.get(name, _ZERO_VALUE)
        if field_value.along:
            follows.append(f"{field_letter}: {following(writing, field_value)}")
        else:
            written_fields.append(
                f"{field_letter}: {share_text}({field_value.text})"
                if share_text
                else f"{field_letter}: {field_value.text}"
            )
    return [*written_fields, f"follows: {{{', '.join(follows)}}}"] if follows else written_fields


def _between(
    writing: Writing,
    model_statement: Statement,
    link_law: Link,
    points: list[list[tuple[float, str]]],
    listened: str,
) -> None:
    """Write a spring between points that lie between masses, as springs between any two of these
    masses.

    c_i is the share of mass i in the first point less its share in the second. The force K·Σcx
    is distributed by the same shares: -c_i·K·Σcx is the sum of springs -c_i·c_j·K, because the c
    add up to 0.
    """
    shares_by_mass: dict[str, float] = {}
    for sign, targets in zip((1.0, -1.0), points, strict=True):
        for share, target in targets:
            shares_by_mass[target] = shares_by_mass.get(target, 0.0) + sign * share
    target_names = writing.targets.get(listened)
    comment = f"{model_statement.keyword} of {quote(model_statement.name)}, between masses"
    for (p, first_share), (q, second_share) in combinations(shares_by_mass.items(), 2):
        end_points = [q, p] if p == target_names else [p, q]  # a force is heard at the second end
        module_name = writing.names.new(model_statement.name)
        if not listened or target_names in (p, q):
            writing.links.append((model_statement, module_name))
        module_fields = {
            tie: f"{-first_share * second_share!r}*({writing.text(model_statement, tie)})"
            for tie in link_law.fields
        }
        tie_texts = ", ".join(f"{tie}: {text}" for tie, text in module_fields.items())
        link_kind = link_law.kind
        if (
            first_share * second_share > 0.0
        ):  # below 0, as no spring is by itself; all of them together are none
            link_kind = "LNL"
            law_of = {"K": 'law: "k*d"', "Z": 'damping: "z*v"'}
            laws = [law_of[tie] for tie in module_fields]
            tie_texts = ", ".join(
                [*laws, *(f"{tie.lower()}: {text}" for tie, text in module_fields.items())]
            )
        writing.add(
            module_name,
            f"{link_kind}: {{between: [{', '.join(end_points)}], {tie_texts}}}",
            comment,
        )
        comment = ""


def _begin(writing: Writing, link_point: Point, mass_targets: list[tuple[float, str]]) -> Begin:
    """The start of a point in the first step. A point of a macro is felt to jump there from 0,
    whatever the macro's x0.
    """
    point_begin = writing.begins[link_point.name]
    macro = writing.macros.get(link_point.name)
    if macro is None:
        return point_begin
    moving = sum(share for share, target in mass_targets if target not in writing.held)
    fixed_share = sum(share for share, target in mass_targets if target in writing.held)
    x = moving * point_begin.x + fixed_share * writing.value(macro.statement, "x0")
    step = moving * point_begin.step
    return Begin(x, step, x - step)


def _strike(writing: Writing, points: list[list[tuple[float, str]]], kick_force: float) -> None:
    """Strikes of a force on the first end of a link, and of its opposite on the second."""
    for force_sign, targets in zip((kick_force, -kick_force), points, strict=True):
        for share, target in targets:
            if kick_force and target not in writing.held:
                writing.kicks[target] = writing.kicks.get(target, 0.0) + force_sign * share
