"""Laws of LNL modules: names to expressions, and the checks that need no simulation."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from ergon import _core
from ergon.instruments import following
from ergon.instruments.model import Module
from ergon.instruments.transpose import law
from ergon.notation.tables.shapes import NAME
from ergon.notation.text.errors import Collector, quote
from ergon.notation.text.values import Place

_WORDS = re.compile(r"[^\W\d]\w*")
# Words of a law that are not constants.
_KNOWN = {"d", "v", "where", "abs", "min", "max", "sqrt", "sign", "exp", "tanh", "noise"}


@dataclass(frozen=True, slots=True)
class LawText:
    """A named law: its expressions and the defaults of its constants."""

    law: str | None
    damping: str | None
    constants: Mapping[str, float]


def is_name(text: str | None) -> bool:
    """Whether a text is the name of a law, not a law."""
    return text is not None and bool(NAME.fullmatch(text)) and text not in ("d", "v")


Locate = Callable[[str, int, int], Place]  # field, offset, length


def resolved(
    module: Module,
    laws: Mapping[str, LawText],
    who: str,
    locate: Locate,
    collector: Collector,
) -> Module:
    """The module with named laws replaced by their expressions; reports texts that are not laws."""
    fields: dict[str, Any] = dict(module.fields)
    constants: dict[str, float] = {}
    for name in ("law", "damping"):
        text = fields[name]
        if (
            text is None
            or not NAME.fullmatch(text)
            or text in ("d", "v")
            or text in fields["constants"]
        ):
            continue
        named = laws.get(text)
        if named is None:
            message = f"{who}: no law is called {quote(text)}"
            place = locate(name, 0, len(text))
            collector.error("E301", message, place, word=text, names=tuple(laws))
            return module
        constants |= named.constants
        if name == "law":
            fields["law"] = named.law
            fields["damping"] = fields["damping"] or named.damping
        else:
            fields["damping"] = named.damping
    written = fields["constants"]
    follows = following.followings(module)
    starts = {name: own.start for name, own in follows.items()}
    fields["constants"] = {**constants, **written, **starts}
    interval = fields.pop("interval", None)
    used = set(_WORDS.findall(f"{fields['law'] or ''} {fields['damping'] or ''}")) - _KNOWN
    fields_of_kind = [w for w in module.fields if w not in ("constants", "interval")]
    for name in (*written, *follows):
        if name not in used:
            message = f"{who}: the law has no constant {quote(name)}"
            names = (*fields_of_kind, *sorted(used))
            place = module.places[name if name in written else "follows"]
            collector.error("E101", message, place, word=name, names=names)
            return module
    if check(fields, who, locate, collector):
        if interval is not None:
            law(fields, interval)
        return replace(module, fields=fields)
    return module


def check(fields: Mapping[str, Any], who: str, locate: Locate, collector: Collector) -> bool:
    """Whether the core compiles the law; reports the characters at fault if not."""
    compile_law = getattr(_core, "Law", None)
    if compile_law is None:  # a core built without laws checks them when it makes the network
        return True
    try:
        compile_law(
            fields["law"],
            fields["damping"],
            fields["constants"],
            fields["points"],
        )
    except ValueError as error:
        name = error.args[1] if len(error.args) > 1 else "law"
        offset, length = getattr(error, "offset", 0), getattr(error, "length", 1)
        place = locate(name if fields[name] is not None else "law", offset, length)
        collector.error("E207", f"{who}: {error.args[0]}", place)
        return False
    return True
