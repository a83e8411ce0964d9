"""Links of a model as modules of a score."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

from ergon.instruments.following import MOST
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


def link(own: Writing, one: Statement, heard: Mapping[int, str]) -> None:
    """Add a link; `heard` gives the links whose force is heard, with the mass on which it is
    heard.
    """
    values = {name: value_of(own, one, name) for name in one.values}
    law = _law(own, one, values)
    ends_of = [points(own, one, point) for point in one.points]
    signed = ["K", "Z"] if law.kind != "LNL" else ["Q"] if "q*d*d" in law.law else []
    signed += [name for name in ("K", "Z", "lim") if name in values and values[name].along]
    for name in signed:
        not_negative(values.get(name, _NONE), name, one.line)
    if "scale" in values and values["scale"].least <= 0.0:
        raise ModelError(REFUSED["scale"].format(value=values["scale"].least), one.line)
    twice = own.model.dialect == "v1" and one.keyword == "nlSpring3"
    firsts = {name: value.first for name, value in values.items()}
    if law.damping or firsts.get("Z"):
        felt = [shares(own, one, point) for point in one.points]
        a, b = (_begin(own, *end) for end in zip(one.points, felt, strict=True))
        force = kick(law, firsts, a, b)
        _strike(own, felt, 2.0 * force if twice else force)
    if law.kind in ("LNL", "BUT"):
        both = zip(one.points, ends_of, strict=True)
        ends_of = [
            [(1.0, still(own, point, shared))] if len(shared) > 1 else shared
            for point, shared in both
        ]
    if max(map(len, ends_of)) > 1:
        _between(own, one, law, ends_of, heard.get(id(one), ""))
        return
    ends = [targets[0][1] for targets in ends_of]
    side = ""
    if heard.get(id(one)) == one.points[0].name:  # its force on the first end is heard
        ends.reverse()
        side = ", side: above" if law.kind == "BUT" else ""
        if not law.turns and law.kind != "BUT":
            message = REFUSED["both ends"].format(link=quote(one.name))
            raise ModelError(message, one.line)
    said = [f"between: [{', '.join(ends)}]"]
    for word, text in (("law", law.law), ("damping", law.damping)):
        said += [f'{word}: "{text}"'] if text else []
    said += _fields(own, law, values, "2*" if twice else "")
    if law.rest:
        said += [f"rest: {metres(own.text(one, law.rest))}"] if law.rest in values else []
    if law.kind == "BUT" and firsts.get("thresh"):
        said.append("gap: " + metres(f"-({own.text(one, 'thresh')})"))
    name = own.names.new(one.name)
    own.links.append((one, name))
    comment = "MIMS adds the force of its nlSpring3 twice" if twice else ""
    own.add(name, f"{law.kind}: {{{', '.join(said)}{side}}}", comment)


def _law(own: Writing, one: Statement, values: Mapping[str, Value]) -> Link:
    """The law of a link; if signals lead its values, a law that can follow them. Raises
    ModelError.
    """
    led = [name for name, value in values.items() if value.along]
    if not led:
        firsts = {name: value.first for name, value in values.items()}
        return LINKS[own.laws][which(one.keyword, firsts)]
    # The law is chosen by the highest values: a value that follows a signal is above 0 somewhere.
    most = {name: value.most for name, value in values.items()}
    if "smooth" in led:  # which law holds would change too
        message = REFUSED["signal"].format(name=quote(one.values["smooth"]), value="smooth")
        raise ModelError(message, one.line)
    if len(led) > MOST:
        message = REFUSED["many signals"].format(count=len(led), most=MOST)
        raise ModelError(message, one.line)
    return followable(one.keyword, LINKS[own.laws][which(one.keyword, most)], led)


def _fields(own: Writing, law: Link, values: Mapping[str, Value], share: str) -> list[str]:
    """The values of a link as fields: constants, and those that follow a signal."""
    said, follows = [], []
    for letter, name in law.fields.items():
        value = values.get(name, _NONE)
        if value.along:
            follows.append(f"{letter}: {following(own, value)}")
        else:
            said.append(f"{letter}: {share}({value.text})" if share else f"{letter}: {value.text}")
    return [*said, f"follows: {{{', '.join(follows)}}}"] if follows else said


def _between(
    own: Writing, one: Statement, law: Link, points: list[list[tuple[float, str]]], heard: str
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
    whose = own.targets.get(heard)
    comment = f"{one.keyword} of {quote(one.name)}, between masses"
    for (p, a), (q, b) in combinations(shares.items(), 2):
        ends = [q, p] if p == whose else [p, q]  # a force is heard at the second end
        name = own.names.new(one.name)
        if not heard or whose in (p, q):
            own.links.append((one, name))
        fields = {tie: f"{-a * b!r}*({own.text(one, tie)})" for tie in law.fields}
        said = ", ".join(f"{tie}: {text}" for tie, text in fields.items())
        kind = law.kind
        if a * b > 0.0:  # below 0, as no spring is by itself; all of them together are none
            kind = "LNL"
            law_of = {"K": 'law: "k*d"', "Z": 'damping: "z*v"'}
            laws = [law_of[tie] for tie in fields]
            said = ", ".join([*laws, *(f"{tie.lower()}: {text}" for tie, text in fields.items())])
        own.add(name, f"{kind}: {{between: [{', '.join(ends)}], {said}}}", comment)
        comment = ""


def _begin(own: Writing, point: Point, targets: list[tuple[float, str]]) -> Begin:
    """The start of a point in the first step. A point of a macro is felt to jump there from 0,
    whatever the macro's x0.
    """
    begin = own.begins[point.name]
    macro = own.macros.get(point.name)
    if macro is None:
        return begin
    moving = sum(share for share, target in targets if target not in own.held)
    still = sum(share for share, target in targets if target in own.held)
    x = moving * begin.x + still * own.value(macro.of, "x0")
    step = moving * begin.step
    return Begin(x, step, x - step)


def _strike(own: Writing, points: list[list[tuple[float, str]]], force: float) -> None:
    """Strikes of a force on the first end of a link, and of its opposite on the second."""
    for sign, targets in zip((force, -force), points, strict=True):
        for share, target in targets:
            if force and target not in own.held:
                own.kicks[target] = own.kicks.get(target, 0.0) + sign * share
