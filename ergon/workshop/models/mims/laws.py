"""The links of a model as links of a score, by the laws of 2019 and of today.

d is x2 - x1 in a score and x1 - x2 in a model: odd laws are the same in both. A field has the
letter of the law as its name and an expression of the model as its value.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Literal

Laws = Literal["2019", "head"]


@dataclass(frozen=True, slots=True)
class Link:
    """A kind of link: its fields, each an expression of the model's values.

    `is_symmetric`: whether the link is the same with its ends exchanged.
    """

    kind: str
    fields: Mapping[str, str]  # field -> value of the statement
    law: str = ""
    damping: str = ""
    rest_name: str = ""  # name of the value that counts as d = 0
    is_symmetric: bool = True


def _lnl(
    law: str, damping: str, constants: str, rest_name: str = "", is_symmetric: bool = True
) -> Link:
    fields = {name.lower(): name for name in constants.split()}
    return Link("LNL", fields, law, damping, rest_name, is_symmetric)


_CUBIC = "where(abs(d) <= sqrt((lim - k)/q), d*(k + q*d*d), lim*d)"
_PLUCK = "where(abs(d) < {tip}, -{inner}*d, where(abs(d) < scale, {outer}*d - sign(d)*{top}, 0))"
_BOW = "where(abs(v) < scale/3, {inner}*v, where(abs(v) < scale, sign(v)*z*scale/3 - {outer}*v, 0))"

_REF = Link("REF", {"K": "K", "Z": "Z"})
_HEAD = {
    "spring": Link("RES", {"K": "K"}),
    "damped spring": _REF,
    "damper": Link("FRO", {"Z": "Z"}),
    "springDamper": _REF,
    "contact": Link("BUT", {"K": "K", "Z": "Z"}, is_symmetric=False),
    "nlSpring2": _lnl("k*d + q*d*abs(d)", "z*v", "K Q Z"),
    "nlSpring3": _lnl("k*d + q*d**3", "z*v", "K Q Z"),
    "nlSpringDamper": _lnl(
        _CUBIC, "where(abs(d) <= sqrt((lim - k)/q), z*v, (z + 0.3*lim)*v)", "K Q lim Z"
    ),
    "stiff nlSpringDamper": _lnl("lim*d", "z*v", "lim Z"),
    "linear nlSpringDamper": _lnl("k*d", "z*v", "K Z"),
    "nlContact": _lnl(
        f"where(d < 0, {_CUBIC}, 0)", "where(d < 0, z*v, 0)", "K Q lim Z", "thresh", False
    ),
    "linear nlContact": Link("BUT", {"K": "K", "Z": "Z"}, is_symmetric=False),
    "nlPluck": _lnl(
        _PLUCK.format(tip="scale/10", inner="(k - k/10)", outer="k/10", top="scale/10*k"),
        "",
        "K scale",
    ),
    "damped nlPluck": _lnl(
        _PLUCK.format(tip="scale/10", inner="(k - k/10)", outer="k/10", top="scale/10*k"),
        "where(abs(d) < scale/10, 0, where(abs(d) < scale, z*v, 0))",
        "K scale Z",
    ),
    "nlBow": _lnl("", _BOW.format(inner="(z - z/3)", outer="z/3"), "Z scale"),
    "smooth nlBow": _lnl("", "0.63*z*v*exp(0.5 - 4*(v/scale)**2)", "Z scale"),
}
_2019 = {
    "contact": _lnl(
        "where(-d > thresh, k*d, 0)", "where(-d > thresh, z*v, 0)", "K Z thresh", is_symmetric=False
    ),
    "nlPluck": _lnl(
        _PLUCK.format(tip="scale/10", inner="(10*k - k)", outer="k", top="scale/10*10*k"),
        "",
        "K scale",
    ),
    "nlBow": _lnl("", _BOW.format(inner="z", outer="0.25*z"), "Z scale"),
}
# Laws that 2019 did not have are those of today.
LINKS: Mapping[Laws, Mapping[str, Link]] = {
    "head": _HEAD,
    "2019": {**_HEAD, **_2019, "damped nlPluck": _2019["nlPluck"], "smooth nlBow": _2019["nlBow"]},
}


_SPRING_FIELDS, _DAMPER_FIELDS = {"k": "K"}, {"z": "Z"}
_FOLLOWABLE = {
    "RES": Link("LNL", _SPRING_FIELDS, "k*d"),
    "FRO": Link("LNL", _DAMPER_FIELDS, damping="z*v"),
    "REF": Link("LNL", {**_SPRING_FIELDS, **_DAMPER_FIELDS}, "k*d", "z*v"),
    "BUT": Link(
        "LNL",
        {**_SPRING_FIELDS, **_DAMPER_FIELDS},
        "where(d < 0, k*d, 0)",
        "where(d < 0, z*v, 0)",
        "thresh",
        is_symmetric=False,
    ),
}


# Words whose K, Q and lim choose the law: all of their laws in one, which chooses at each moment.
_UNIFIED_LAWS = {
    "nlSpringDamper": _lnl(
        "where(q*d*d <= where(q > 0, lim - k, 0), d*(k + q*d*d), lim*d)",
        "where(q*d*d <= lim - k, z*v, where(lim > k, (z + 0.3*lim)*v, z*v))",
        "K Q lim Z",
    ),
    "nlContact": _lnl(
        "where(d < 0, where(q*d*d <= max(lim - k, 0), d*(k + q*d*d), max(k, lim)*d), 0)",
        "where(d < 0, z*v, 0)",
        "K Q lim Z",
        "thresh",
        False,
    ),
}
_ELONGATION = re.compile(r"\bd\b")


def followable(keyword: str, link: Link, signal_values: Collection[str]) -> Link:
    """The same link, with a law whose values named in `signal_values` may follow a signal."""
    link = _FOLLOWABLE.get(link.kind, link)
    if keyword in _UNIFIED_LAWS and not {"K", "Q", "lim"}.isdisjoint(signal_values):
        link = _UNIFIED_LAWS[keyword]
    if link.rest_name in signal_values:
        fields = {**link.fields, link.rest_name: link.rest_name}
        law_text, damping = (
            _ELONGATION.sub(f"(d - {link.rest_name})", text) for text in (link.law, link.damping)
        )
        link = replace(link, fields=fields, law=law_text, damping=damping, rest_name="")
    return link


def law_name(keyword: str, values: Mapping[str, float]) -> str:
    """Which law of a word holds for these values."""
    q, k, lim = values.get("Q", 0.0), values.get("K", 0.0), values.get("lim", 0.0)
    if keyword == "spring" and "Z" in values:
        return "damped spring"
    if keyword == "detent":  # a contact in mi_faust
        return "contact"
    if keyword == "nlSpring":
        return "nlSpring2"
    if keyword == "nlSpringDamper" and (q == 0.0 or k >= lim):
        return "linear nlSpringDamper" if q == 0.0 else "stiff nlSpringDamper"
    if keyword == "nlContact" and (q == 0.0 or k >= lim):
        return "linear nlContact"
    if keyword == "nlPluck" and values.get("Z"):
        return "damped nlPluck"
    if keyword == "nlBow" and values.get("smooth", 0.0) >= 1.0:
        return "smooth nlBow"
    return keyword
