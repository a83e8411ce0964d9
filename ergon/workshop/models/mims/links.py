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

_NONE = Value("0", 0.0, 0.0, 0.0)


def link(writing: Writing, statement: Statement, listened: Mapping[int, str]) -> None:
    """Add a link; `listened` gives the links whose force is heard, with the mass on which it is
    heard.
    """
    values = {name: value_of(writing, statement, name) for name in statement.values}
    law = _law(writing, statement, values)
    ends_of = [points(writing, statement, point) for point in statement.points]
    signed = ["K", "Z"] if law.kind != "LNL" else ["Q"] if "q*d*d" in law.law else []
    signed += [name for name in ("K", "Z", "lim") if name in values and values[name].along]
    for name in signed:
        not_negative(values.get(name, _NONE), name, statement.line)
    if "scale" in values and values["scale"].least <= 0.0:
        raise ModelError(REFUSED["scale"].format(value=values["scale"].least), statement.line)
    twice = writing.model.dialect == "v1" and statement.keyword == "nlSpring3"
    firsts = {name: value.first for name, value in values.items()}
    if law.damping or firsts.get("Z"):
        end_shares = [shares(writing, statement, point) for point in statement.points]
        a, b = (_begin(writing, *end) for end in zip(statement.points, end_shares, strict=True))
        force = kick(law, firsts, a, b)
        _strike(writing, end_shares, 2.0 * force if twice else force)
    if law.kind in ("LNL", "BUT"):
        both = zip(statement.points, ends_of, strict=True)
        ends_of = [
            [(1.0, still(writing, point, shared))] if len(shared) > 1 else shared
            for point, shared in both
        ]
    if max(map(len, ends_of)) > 1:
        _between(writing, statement, law, ends_of, listened.get(id(statement), ""))
        return
    end_points = [targets[0][1] for targets in ends_of]
    side = ""
    if (
        listened.get(id(statement)) == statement.points[0].name
    ):  # its force on the first end is heard
        end_points.reverse()
        side = ", side: above" if law.kind == "BUT" else ""
        if not law.turns and law.kind != "BUT":
            message = REFUSED["both ends"].format(link=quote(statement.name))
            raise ModelError(message, statement.line)
    written_fields = [f"between: [{', '.join(end_points)}]"]
    for word, text in (("law", law.law), ("damping", law.damping)):
        written_fields += [f'{word}: "{text}"'] if text else []
    written_fields += _fields(writing, law, values, "2*" if twice else "")
    if law.rest:
        written_fields += (
            [f"rest: {metres(writing.text(statement, law.rest))}"] if law.rest in values else []
        )
    if law.kind == "BUT" and firsts.get("thresh"):
        written_fields.append("gap: " + metres(f"-({writing.text(statement, 'thresh')})"))
    name = writing.names.new(statement.name)
    writing.links.append((statement, name))
    comment = "MIMS adds the force of its nlSpring3 twice" if twice else ""
    writing.add(name, f"{law.kind}: {{{', '.join(written_fields)}{side}}}", comment)


def _law(writing: Writing, statement: Statement, values: Mapping[str, Value]) -> Link:
    """The law of a link; if signals lead its values, a law that can follow them. Raises
    ModelError.
    """
    led = [name for name, value in values.items() if value.along]
    if not led:
        firsts = {name: value.first for name, value in values.items()}
        return LINKS[writing.laws][which(statement.keyword, firsts)]
    # The law is chosen by the highest values: a value that follows a signal is above 0 somewhere.
    upper_values = {name: value.greatest for name, value in values.items()}
    if "smooth" in led:  # which law holds would change too
        message = REFUSED["signal"].format(name=quote(statement.values["smooth"]), value="smooth")
        raise ModelError(message, statement.line)
    if len(led) > CONSTANTS_MAX:
        message = REFUSED["many signals"].format(count=len(led), most=CONSTANTS_MAX)
        raise ModelError(message, statement.line)
    return followable(
        statement.keyword, LINKS[writing.laws][which(statement.keyword, upper_values)], led
    )


def _fields(writing: Writing, law: Link, values: Mapping[str, Value], share: str) -> list[str]:
    """The values of a link as fields: constants, and those that follow a signal."""
    written_fields, follows = [], []
    for letter, name in law.fields.items():
        value = values.get(name, _NONE)
        if value.along:
            follows.append(f"{letter}: {following(writing, value)}")
        else:
            written_fields.append(
                f"{letter}: {share}({value.text})" if share else f"{letter}: {value.text}"
            )
    return [*written_fields, f"follows: {{{', '.join(follows)}}}"] if follows else written_fields


def _between(
    writing: Writing,
    statement: Statement,
    law: Link,
    points: list[list[tuple[float, str]]],
    listened: str,
) -> None:
    """Write a spring between points that lie between masses, as springs between any two of these
    masses.

    c_i is the share of mass i in the first point less its share in the second. The force K·Σcx
    is distributed by the same shares: -c_i·K·Σcx is the sum of springs -c_i·c_j·K, because the c
    add up to 0.
    """
    shares: dict[str, float] = {}
    for sign, targets in zip((1.0, -1.0), points, strict=True):
        for share, target in targets:
            shares[target] = shares.get(target, 0.0) + sign * share
    whose = writing.targets.get(listened)
    comment = f"{statement.keyword} of {quote(statement.name)}, between masses"
    for (p, a), (q, b) in combinations(shares.items(), 2):
        end_points = [q, p] if p == whose else [p, q]  # a force is heard at the second end
        name = writing.names.new(statement.name)
        if not listened or whose in (p, q):
            writing.links.append((statement, name))
        fields = {tie: f"{-a * b!r}*({writing.text(statement, tie)})" for tie in law.fields}
        tie_texts = ", ".join(f"{tie}: {text}" for tie, text in fields.items())
        kind = law.kind
        if a * b > 0.0:  # below 0, as no spring is by itself; all of them together are none
            kind = "LNL"
            law_of = {"K": 'law: "k*d"', "Z": 'damping: "z*v"'}
            laws = [law_of[tie] for tie in fields]
            tie_texts = ", ".join(
                [*laws, *(f"{tie.lower()}: {text}" for tie, text in fields.items())]
            )
        writing.add(name, f"{kind}: {{between: [{', '.join(end_points)}], {tie_texts}}}", comment)
        comment = ""


def _begin(writing: Writing, point: Point, targets: list[tuple[float, str]]) -> Begin:
    """The start of a point in the first step. A point of a macro is felt to jump there from 0,
    whatever the macro's x0.
    """
    begin = writing.begins[point.name]
    macro = writing.macros.get(point.name)
    if macro is None:
        return begin
    moving = sum(share for share, target in targets if target not in writing.held)
    still = sum(share for share, target in targets if target in writing.held)
    x = moving * begin.x + still * writing.value(macro.statement, "x0")
    step = moving * begin.step
    return Begin(x, step, x - step)


def _strike(writing: Writing, points: list[list[tuple[float, str]]], force: float) -> None:
    """Strikes of a force on the first end of a link, and of its opposite on the second."""
    for sign, targets in zip((force, -force), points, strict=True):
        for share, target in targets:
            if force and target not in writing.held:
                writing.kicks[target] = writing.kicks.get(target, 0.0) + sign * share
