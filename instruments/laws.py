"""Laws of LNL modules: names to expressions, and the checks that need no simulation."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from ergon import _core
from ergon.instruments import following
from ergon.instruments.model import Module
from ergon.instruments.transpose import transpose_law
from ergon.notation.tables.shapes import NAME
from ergon.notation.text.errors import Collector, quote
from ergon.notation.text.values import Place

_IDENTIFIER = re.compile(r"[^\W\d]\w*")
# Words of a law that are not constants.
_LAW_WORDS = {"d", "v", "where", "abs", "min", "max", "sqrt", "sign", "exp", "tanh", "noise"}


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


def with_law_text(
    law_module: Module,
    laws: Mapping[str, LawText],
    module_label: str,
    locate: Locate,
    collector: Collector,
) -> Module:
    """The module with named laws replaced by their expressions; reports texts that are not laws."""
    law_fields: dict[str, Any] = dict(law_module.fields)
    constants: dict[str, float] = {}
    for field_name in ("law", "damping"):
        law_text = law_fields[field_name]
        if (
            law_text is None
            or not NAME.fullmatch(law_text)
            or law_text in ("d", "v")
            or law_text in law_fields["constants"]
        ):
            continue
        named_law = laws.get(law_text)
        if named_law is None:
            message = f"{module_label}: no law is called {quote(law_text)}"
            law_place = locate(field_name, 0, len(law_text))
            collector.error("E301", message, law_place, word=law_text, names=tuple(laws))
            return law_module
        constants |= named_law.constants
        if field_name == "law":
            law_fields["law"] = named_law.law
            law_fields["damping"] = law_fields["damping"] or named_law.damping
        else:
            law_fields["damping"] = named_law.damping
    written_constants = law_fields["constants"]
    follows = following.followings(law_module)
    following_starts = {name: follow_rule.start for name, follow_rule in follows.items()}
    law_fields["constants"] = {**constants, **written_constants, **following_starts}
    interval = law_fields.pop("interval", None)
    used_words = (
        set(_IDENTIFIER.findall(f"{law_fields['law'] or ''} {law_fields['damping'] or ''}"))
        - _LAW_WORDS
    )
    fields_of_kind = [w for w in law_module.fields if w not in ("constants", "interval")]
    for field_name in (*written_constants, *follows):
        if field_name not in used_words:
            message = f"{module_label}: the law has no constant {quote(field_name)}"
            known_names = (*fields_of_kind, *sorted(used_words))
            law_place = law_module.places[
                field_name if field_name in written_constants else "follows"
            ]
            collector.error("E101", message, law_place, word=field_name, names=known_names)
            return law_module
    if compiles(law_fields, module_label, locate, collector):
        if interval is not None:
            transpose_law(law_fields, interval)
        return replace(law_module, fields=law_fields)
    return law_module


def compiles(
    law_fields: Mapping[str, Any], module_label: str, locate: Locate, collector: Collector
) -> bool:
    """Whether the core compiles the law; reports the characters at fault if not."""
    compile_law = getattr(_core, "Law", None)
    if compile_law is None:  # a core built without laws checks them when it makes the network
        return True
    try:
        compile_law(
            law_fields["law"],
            law_fields["damping"],
            law_fields["constants"],
            law_fields["points"],
        )
    except ValueError as error:
        name = error.args[1] if len(error.args) > 1 else "law"
        offset, length = getattr(error, "offset", 0), getattr(error, "length", 1)
        place = locate(name if law_fields[name] is not None else "law", offset, length)
        collector.error("E207", f"{module_label}: {error.args[0]}", place)
        return False
    return True
