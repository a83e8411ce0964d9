"""Checks fields of one module on one axis against each other, with a sentence for each mistake."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from ergon.instruments import following, proxies
from ergon.notation.tables.fields import Values
from ergon.notation.text.errors import with_article

_Check = Callable[[str, Values], None]


def check(kind: str, values: Values) -> None:
    """Report fields that contradict each other, or that a module lacks."""
    for own in _CHECKS.get(kind, ()):
        own(kind, values)


def _needs(*names: str) -> _Check:
    def check(kind: str, values: Values) -> None:
        if not values.written(*names):
            alternatives = " or ".join(names)
            values.error(
                "E103", f"{values.context.of('')}: {with_article(kind)} needs {alternatives}"
            )

    return check


def _cel(kind: str, values: Values) -> None:
    tuned, plain = values.written("f", "t60"), values.written("K", "Z")
    if tuned and plain:
        message = f"{values.context.of(tuned[0])}: {plain[0]} is written too; "
        message += "a CEL has K and Z, or f and t60"
        values.error("E111", message, tuned[0])
    elif not values.written("f", "K"):
        values.error("E103", f"{values.context.of('')}: a CEL needs K (and Z), or f (and t60)")


def _but(kind: str, values: Values) -> None:
    magic = values["contact"] == "magic"
    if magic and (extra := values.written("K", "Z")):
        message = f"{values.context.of(extra[0])}: a magic contact has no K and Z; remove it"
        values.error("E111", message, extra[0])
    if not magic:
        _needs("K")(kind, values)
        if extra := values.written("restitution", "steps"):
            message = f"{values.context.of(extra[0])}: only a magic contact has this field"
            values.error("E111", message, extra[0])
    if magic and values["clamp"] and values["restitution"] < 1:
        message = (
            f"{values.context.of('clamp')}: a magic contact with "
            "restitution < 1 must pull, so clamp must be false"
        )
        values.error("E111", message, "clamp")


def _lnl(kind: str, values: Values) -> None:
    if values.written("law") and values.written("points"):
        message = f"{values.context.of('points')}: `law` is written too; keep one of the two"
        values.error("E111", message, "points")


def _bristle(kind: str, values: Values) -> None:
    level, static = values["Fc"], values["Fs"]
    if isinstance(level, float) and isinstance(static, float) and static < level:
        message = f"{values.context.of('Fs')}: Fs is below Fc; friction falls from Fs to Fc"
        values.error("E111", message, "Fs")


def _dry(kind: str, values: Values) -> None:
    ends = values.written("to", "between")
    if len(ends) == 2:
        message = f"{values.context.of('between')}: `to` is written too; keep one of the two"
        values.error("E111", message, "between")
    elif not ends and values.record.by_name.keys() >= {"to"}:
        values.error("E103", f"{values.context.of('')}: a DRY needs to or between")
    level, static = values["F"], values["static"]
    is_below = isinstance(level, float) and isinstance(static, float) and static < level
    if is_below and values["K"] is not None:
        message = f"{values.context.of('static')}: static is below F; with K the level falls from "
        message += "static to F"
        values.error("E111", message, "static")
    if values.written("speed") and not values.written("static"):
        message = f"{values.context.of('speed')}: only a DRY with static has this field"
        values.error("E111", message, "speed")


def _links(kind: str, values: Values) -> None:
    """Check that a body has either f and t60, or, in a discrete network, K and Z of its links."""
    if "K" not in values.record.by_name:
        return
    tuned, plain = values.written("f", "t60", "inharmonicity", "bending"), values.written("K", "Z")
    if tuned and plain:
        message = f"{values.context.of(tuned[0])}: {plain[0]} is written too; "
        message += f"a {kind} has K and Z of its links, or f and t60"
        values.error("E111", message, tuned[0])
    elif not values.written("f", "K"):
        values.error("E103", f"{values.context.of('')}: a {kind} needs f (and t60), or K (and Z)")


def _string(kind: str, values: Values) -> None:
    if values.written("inharmonicity") and values.written("stiffness"):
        message = (
            f"{values.context.of('stiffness')}: `inharmonicity` is written too; keep "
            "`inharmonicity`, which raises high partials as bending does"
        )
        values.error("E111", message, "stiffness")


def _plate(kind: str, values: Values) -> None:
    shape = values["shape"]
    needed, other = ("sides", "radius") if shape == "rectangle" else ("radius", "sides")
    if not values.written(needed):
        example = {"sides": "sides: [40, 25]", "radius": "radius: 12"}[needed]
        message = f"{values.context.of('')}: a PLATE of shape {shape} needs {example}"
        values.error("E103", message)
    if values.written(other):
        message = f"{values.context.of(other)}: a PLATE of shape {shape} has no {other}; remove it"
        values.error("E111", message, other)


_CHECKS: Mapping[str, tuple[_Check, ...]] = {
    "RES": (_needs("K"),),
    "FRO": (_needs("Z"),),
    "REF": (_needs("K", "Z"),),
    "MAS": (following.check,),
    "CEL": (_cel,),
    "BUT": (_but,),
    "LNL": (_lnl, following.check),
    "BRISTLE": (_bristle,),
    "DRY": (_dry,),
    "PROXY": (proxies.check,),
    "STRING": (_links, _string),
    "PLATE": (_links, _plate),
}
