"""Values of lines that add, join and remove instruments, links, keys and players."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from ergon.instruments.module_kinds import KINDS, LINKS
from ergon.instruments.transpose import parse_interval
from ergon.notation.tables.compound import Either
from ergon.notation.tables.shapes import Shape, Text
from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.spelling import nearest
from ergon.repl.language import values as v
from ergon.repl.language.scope import Scope, playable
from ergon.repl.language.values import Completion, CompletionContext, Value

_ABLETON_LINK_HINT = (
    "a link joins two modules; Ableton Link is not part of ergon, because its bindings contain "
    "code under the GPL (docs/midi.md); `ergon repl SCORE --midi-clock-to PORT` shares the tempo"
)
_FILE_AND_NAME = re.compile(r"[A-Za-z][\w-]*/[A-Za-z][\w-]*")
_ENDS = ("to", "between")  # which a link of a line has already


def _modules(scope: Scope) -> dict[str, str]:
    """Keys, and modules of the score."""
    names = dict(scope.keys)
    for target in scope.targets:
        names.setdefault(target.rpartition(".")[0], "module")
    return names


def _end_names(scope: Scope) -> dict[str, str]:
    """Keys and modules that a link may join."""
    return {**_modules(scope), **v.module_names(scope)}


def _end(text: str, scope: Scope, _: Mapping[str, Any]) -> str:
    if text in ("on", "off"):
        raise TextError(_ABLETON_LINK_HINT, length=len(text))
    part = text.partition(".")[0]
    # Only the part is checked here: the score knows members (`string.12`) and modules from files.
    if part not in scope.keys and part not in playable(scope):
        raise v.unknown_name(text, "a key or a module", _end_names(scope))
    return text


def _ends(context: CompletionContext) -> Iterator[Completion]:
    return v.up_to_dot(context.typed, _end_names(context.scope))


def _kind(text: str, *_: Any) -> str:
    if text not in LINKS:
        raise v.unknown_name(text, "a kind of link", LINKS)
    return text


def pairs(text: str, offset: int = 0) -> Iterator[tuple[str, str, int]]:
    """The fields of `K=4kN/m gap=1mm`: name, value, and where the name begins."""
    for word in re.finditer(r"\S+", text):
        name, equals, value = word.group().partition("=")
        if equals and name and not value:
            message = f"'{name[:40]}' needs a value, such as K=4kN/m"
            raise TextError(message, offset=offset + word.start(), length=len(word.group()))
        if not (equals and name):
            message = f"{quote(word.group())} is not a field with its value: write one such as "
            message += "K=4kN/m, or notes=C3..C5"
            raise TextError(message, offset=offset + word.start(), length=len(word.group()))
        yield name, value, offset + word.start()


def _fields(text: str, scope: Scope, slots_read: Mapping[str, Any]) -> dict[str, str]:
    table, fields = KINDS[slots_read["kind"]].table, dict[str, str]()
    names = [field.name for field in table.fields if field.name not in _ENDS]
    for name, value, offset in pairs(text):
        if name not in names and table.free is None:
            near = nearest(name, names)
            message = f"{slots_read['kind']} has no field {quote(name)}; it has {', '.join(names)}"
            raise TextError(message, offset=offset, length=len(name), suggestion=near)
        shape: Shape | None = table.by_name[name].shape if name in table.by_name else None
        if isinstance(shape, Either):
            shape = shape.scalar  # a line has room for one value
        if isinstance(shape, Text):
            check_value(shape, value, offset + len(name) + 1)
        if name in fields:
            raise TextError(f"{quote(name)} is written twice", offset=offset, length=len(name))
        fields[name] = value
    return fields


def check_value(shape: Text, value: str, offset: int) -> None:
    """Check that a value fits a shape. Raises TextError with its place."""
    try:
        shape.parse(value)
    except TextError as error:
        error.offset += offset
        raise


def _field_offers(context: CompletionContext) -> Iterator[Completion]:
    kind = context.fields.get("kind")
    if kind in KINDS and "=" not in context.typed:
        for field in KINDS[kind].table.fields:
            if field.name not in _ENDS:
                yield Completion(f"{field.name}=", field.doc)


def _base(text: str, scope: Scope, _: Mapping[str, Any]) -> tuple[str, float, dict[str, str]]:
    words = [(word.group(), word.start()) for word in re.finditer(r"\S+", text)]
    base, _offset = words[0]
    if base not in playable(scope) and not _FILE_AND_NAME.fullmatch(base):
        known = [*playable(scope), "bell/bell", "gong/plate"]
        raise v.unknown_name(base, "an instrument or a file and a name such as bell/bell", known)
    semitones, fields, i = 0.0, dict[str, str](), 1
    while i < len(words):
        word, offset = words[i]
        if word == "transpose":
            value, place = words[i + 1] if i + 1 < len(words) else ("", len(text))
            try:
                interval = parse_interval(value)
            except TextError as error:
                error.offset += place
                raise
            if interval.cents is None:  # a score says it as it is typed
                fields["transpose"] = value
            else:
                semitones = interval.cents / 100.0
            i += 2
            continue
        for name, value, _place in pairs(word, offset):
            fields[name] = value
        i += 1
    return base, semitones, fields


def _bases(context: CompletionContext) -> Iterator[Completion]:
    if not context.before:
        yield from v.name_completions(playable(context.scope))
        yield from _file_offers(context)
    elif context.before[-1] == "transpose":
        yield Completion("7st", "semitones, -14cents or x1.5")
    elif "transpose" not in context.before and not {"@", '"'} & {*context.before[0]}:
        yield Completion("transpose", "higher or lower, in semitones")


def _file_offers(context: CompletionContext) -> Iterator[Completion]:
    """Families; behind the slash, the instruments of one."""
    family, slash, _ = context.typed.partition("/")
    for name, members in context.scope.families.items():
        if not slash:
            yield Completion(f"{name}/", ", ".join(members) or "no instruments")
        elif name == family:
            for member, about in members.items():
                yield Completion(f"{name}/{member}", about or "an instrument")


def _new_part(text: str, scope: Scope, _: Mapping[str, Any]) -> str:
    for what, known in (("gesture", scope.gestures), ("take", scope.takes)):
        if text in known:
            message = f"{quote(text)} is a {what}: give the instrument another name"
            raise TextError(message, length=len(text))
    return v.check_new_name(text)


def _known_or_new(section: str) -> Value:
    def read(text: str, scope: Scope, _: Mapping[str, Any]) -> str:
        return text if text in getattr(scope, section) else v.check_new_name(text)

    def offers(context: CompletionContext) -> Iterator[Completion]:
        return v.name_completions(getattr(context.scope, section))

    return Value("a name", read, offers)


def _channels(text: str, *_: Any) -> tuple[str, ...]:
    words = text.split()
    if words == ["nearest"]:
        return ("nearest",)
    for word in re.finditer(r"\S+", text):
        if not re.fullmatch(r"[1-9][0-9]{0,3}", word.group()):
            message = f"{quote(word.group())} is not a channel from 1, or nearest"
            raise TextError(message, offset=word.start(), length=len(word.group()))
    return tuple(words)


def _channel_offers(context: CompletionContext) -> Iterator[Completion]:
    if all(word.isdigit() for word in context.before):
        yield Completion("1", "a channel")


def _removable(scope: Scope) -> dict[str, str]:
    sections = (
        scope.players,
        scope.gestures,
        scope.paths,
        scope.takes,
        scope.instruments,
        scope.marks,
        scope.blocks,
        scope.phrases,
        scope.strikes,
    )
    return {**_modules(scope), **{name: hint for some in sections for name, hint in some.items()}}


def _removed(text: str, scope: Scope, _: Mapping[str, Any]) -> str:
    if text not in (known := _removable(scope)):
        raise v.unknown_name(text, "a name of this score", known)
    return text


PART_NAME = Value("a new name", _new_part, lambda _: ())
BASE = Value("an instrument, or a file and a name such as bell/bell", _base, _bases)
LINK_END = Value("a key or a module, such as k1 or bell.m", _end, _ends)
OTHER_END = v.other_than(LINK_END, "a")
LINK_KIND = Value(
    "a kind of link, such as BUT or REF",
    _kind,
    lambda _: (Completion(kind, KINDS[kind].table.doc) for kind in LINKS),
)
LINK_FIELDS = Value("fields, such as K=4kN/m gap=1mm", _fields, _field_offers)
PLAYER_NAME = _known_or_new("players")
KEY_NAME = _known_or_new("keys")
INSTRUMENT = v.name_value("an instrument", "instruments", "available")
CHANNELS = Value("channels, such as 3 or 3 4", _channels, _channel_offers)
REMOVABLE = Value(
    "a name of this score", _removed, lambda context: v.name_completions(_removable(context.scope))
)
RENAMED = v.name_value(
    "a gesture, a phrase, a take, a player, a block, a key or an instrument",
    *("gestures", "paths", "phrases", "takes", "players", "blocks", "keys", "instruments"),
)
