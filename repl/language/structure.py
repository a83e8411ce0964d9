"""Values of lines that add, join and remove instruments, links, keys and players."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from ergon.instruments.module_kinds import KINDS, LINK_KINDS
from ergon.instruments.transpose import parse_interval
from ergon.notation.tables.compound import Either
from ergon.notation.tables.shapes import Shape, Text
from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.spelling import nearest
from ergon.repl.language import values
from ergon.repl.language.scope import Scope, playable_instruments
from ergon.repl.language.values import Completion, CompletionContext, Value

_ABLETON_LINK_HINT = (
    "a link joins two modules; Ableton Link is not part of ergon, because its bindings contain "
    "code under the GPL (docs/midi.md); `ergon repl SCORE --midi-clock-to PORT` shares the tempo"
)
_FILE_AND_NAME_PATTERN = re.compile(r"[A-Za-z][\w-]*/[A-Za-z][\w-]*")
_END_FIELDS = ("to", "between")  # which a link of a line has already


def _module_names(scope: Scope) -> dict[str, str]:
    """Keys, and modules of the score."""
    hint_by_name = dict(scope.keys)
    for target in scope.targets:
        hint_by_name.setdefault(target.rpartition(".")[0], "module")
    return hint_by_name


def _end_names(scope: Scope) -> dict[str, str]:
    """Keys and modules that a link may join."""
    return {**_module_names(scope), **values.module_names(scope)}


def _read_end(end_text: str, scope: Scope, _: Mapping[str, Any]) -> str:
    if end_text in ("on", "off"):
        raise TextError(_ABLETON_LINK_HINT, length=len(end_text))
    part_name = end_text.partition(".")[0]
    # Only the part is checked here: the score knows members (`string.12`) and modules from files.
    if part_name not in scope.keys and part_name not in playable_instruments(scope):
        raise values.unknown_name_error(end_text, "a key or a module", _end_names(scope))
    return end_text


def _end_completions(context: CompletionContext) -> Iterator[Completion]:
    return values.complete_to_dot(context.typed_text, _end_names(context.scope))


def _read_kind(text: str, *_: Any) -> str:
    if text not in LINK_KINDS:
        raise values.unknown_name_error(text, "a kind of link", LINK_KINDS)
    return text


def field_pairs(text: str, text_offset: int = 0) -> Iterator[tuple[str, str, int]]:
    """The fields of `K=4kN/m gap=1mm`: name, value, and where the name begins."""
    for word_match in re.finditer(r"\S+", text):
        field_name, equals_sign, field_text = word_match.group().partition("=")
        if equals_sign and field_name and not field_text:
            message = f"'{field_name[:40]}' needs a value, such as K=4kN/m"
            raise TextError(
                message, offset=text_offset + word_match.start(), length=len(word_match.group())
            )
        if not (equals_sign and field_name):
            message = (
                f"{quote(word_match.group())} is not a field with its value: write one such as "
            )
            message += "K=4kN/m, or notes=C3..C5"
            raise TextError(
                message, offset=text_offset + word_match.start(), length=len(word_match.group())
            )
        yield field_name, field_text, text_offset + word_match.start()


def _read_fields(slot_text: str, scope: Scope, earlier_values: Mapping[str, Any]) -> dict[str, str]:
    field_table, module_fields = KINDS[earlier_values["kind"]].table, dict[str, str]()
    field_names = [field.name for field in field_table.fields if field.name not in _END_FIELDS]
    for field_name, field_text, field_offset in field_pairs(slot_text):
        if field_name not in field_names and field_table.free is None:
            suggestion = nearest(field_name, field_names)
            message = (
                f"{earlier_values['kind']} has no field {quote(field_name)}; it has "
                f"{', '.join(field_names)}"
            )
            raise TextError(
                message, offset=field_offset, length=len(field_name), suggestion=suggestion
            )
        shape: Shape | None = (
            field_table.by_name[field_name].shape if field_name in field_table.by_name else None
        )
        if isinstance(shape, Either):
            shape = shape.scalar  # a line has room for one value
        if isinstance(shape, Text):
            check_value(shape, field_text, field_offset + len(field_name) + 1)
        if field_name in module_fields:
            raise TextError(
                f"{quote(field_name)} is written twice", offset=field_offset, length=len(field_name)
            )
        module_fields[field_name] = field_text
    return module_fields


def check_value(shape: Text, value_text: str, value_offset: int) -> None:
    """Check that a value fits a shape. Raises TextError with its place."""
    try:
        shape.parse(value_text)
    except TextError as error:
        error.offset += value_offset
        raise


def _field_completions(context: CompletionContext) -> Iterator[Completion]:
    kind = context.fields.get("kind")
    if kind in KINDS and "=" not in context.typed_text:
        for field in KINDS[kind].table.fields:
            if field.name not in _END_FIELDS:
                yield Completion(f"{field.name}=", field.doc)


def _read_base(
    slot_text: str, scope: Scope, _: Mapping[str, Any]
) -> tuple[str, float, dict[str, str]]:
    placed_words = [(word.group(), word.start()) for word in re.finditer(r"\S+", slot_text)]
    base_name, _offset = placed_words[0]
    if base_name not in playable_instruments(scope) and not _FILE_AND_NAME_PATTERN.fullmatch(
        base_name
    ):
        known_bases = [*playable_instruments(scope), "bell/bell", "gong/plate"]
        raise values.unknown_name_error(
            base_name, "an instrument or a file and a name such as bell/bell", known_bases
        )
    semitones, changed_fields, word_index = 0.0, dict[str, str](), 1
    while word_index < len(placed_words):
        word_text, word_offset = placed_words[word_index]
        if word_text == "transpose":
            value_text, value_offset = (
                placed_words[word_index + 1]
                if word_index + 1 < len(placed_words)
                else ("", len(slot_text))
            )
            try:
                interval = parse_interval(value_text)
            except TextError as error:
                error.offset += value_offset
                raise
            if interval.cents is None:  # a score says it as it is typed
                changed_fields["transpose"] = value_text
            else:
                semitones = interval.cents / 100.0
            word_index += 2
            continue
        for name, value_text, _place in field_pairs(word_text, word_offset):
            changed_fields[name] = value_text
        word_index += 1
    return base_name, semitones, changed_fields


def _base_completions(context: CompletionContext) -> Iterator[Completion]:
    if not context.earlier_words:
        yield from values.name_completions(playable_instruments(context.scope))
        yield from _file_completions(context)
    elif context.earlier_words[-1] == "transpose":
        yield Completion("7st", "semitones, -14cents or x1.5")
    elif "transpose" not in context.earlier_words and not {"@", '"'} & {*context.earlier_words[0]}:
        yield Completion("transpose", "higher or lower, in semitones")


def _file_completions(context: CompletionContext) -> Iterator[Completion]:
    """Families; behind the slash, the instruments of one."""
    family, slash, _ = context.typed_text.partition("/")
    for family_name, members in context.scope.families.items():
        if not slash:
            yield Completion(f"{family_name}/", ", ".join(members) or "no instruments")
        elif family_name == family:
            for member, hint in members.items():
                yield Completion(f"{family_name}/{member}", hint or "an instrument")


def _read_new_part_name(part_name: str, scope: Scope, _: Mapping[str, Any]) -> str:
    for name_kind, known_names in (("gesture", scope.gestures), ("take", scope.takes)):
        if part_name in known_names:
            message = f"{quote(part_name)} is a {name_kind}: give the instrument another name"
            raise TextError(message, length=len(part_name))
    return values.check_new_name(part_name)


def _known_or_new_name(section_name: str) -> Value:
    def read_name(text: str, scope: Scope, _: Mapping[str, Any]) -> str:
        return text if text in getattr(scope, section_name) else values.check_new_name(text)

    def complete_name(context: CompletionContext) -> Iterator[Completion]:
        return values.name_completions(getattr(context.scope, section_name))

    return Value("a name", read_name, complete_name)


def _read_channels(slot_text: str, *_: Any) -> tuple[str, ...]:
    channel_words = slot_text.split()
    if channel_words == ["nearest"]:
        return ("nearest",)
    for word_match in re.finditer(r"\S+", slot_text):
        if not re.fullmatch(r"[1-9][0-9]{0,3}", word_match.group()):
            message = f"{quote(word_match.group())} is not a channel from 1, or nearest"
            raise TextError(message, offset=word_match.start(), length=len(word_match.group()))
    return tuple(channel_words)


def _channel_completions(context: CompletionContext) -> Iterator[Completion]:
    if all(word.isdigit() for word in context.earlier_words):
        yield Completion("1", "a channel")


def _removable_names(scope: Scope) -> dict[str, str]:
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
    return {
        **_module_names(scope),
        **{name: hint for section in sections for name, hint in section.items()},
    }


def _read_removed(text: str, scope: Scope, _: Mapping[str, Any]) -> str:
    if text not in (removable_names := _removable_names(scope)):
        raise values.unknown_name_error(text, "a name of this score", removable_names)
    return text


PART_NAME_VALUE = Value("a new name", _read_new_part_name, lambda _: ())
BASE_VALUE = Value(
    "an instrument, or a file and a name such as bell/bell", _read_base, _base_completions
)
LINK_END_VALUE = Value("a key or a module, such as k1 or bell.m", _read_end, _end_completions)
OTHER_END_VALUE = values.excluding_earlier(LINK_END_VALUE, "a")
LINK_KIND_VALUE = Value(
    "a kind of link, such as BUT or REF",
    _read_kind,
    lambda _: (Completion(kind, KINDS[kind].table.doc) for kind in LINK_KINDS),
)
LINK_FIELDS_VALUE = Value("fields, such as K=4kN/m gap=1mm", _read_fields, _field_completions)
PLAYER_NAME_VALUE = _known_or_new_name("players")
KEY_NAME_VALUE = _known_or_new_name("keys")
INSTRUMENT_VALUE = values.name_value("an instrument", "instruments", "available")
CHANNELS_VALUE = Value("channels, such as 3 or 3 4", _read_channels, _channel_completions)
REMOVABLE_VALUE = Value(
    "a name of this score",
    _read_removed,
    lambda context: values.name_completions(_removable_names(context.scope)),
)
RENAMED_VALUE = values.name_value(
    "a gesture, a phrase, a take, a player, a block, a key or an instrument",
    *("gestures", "paths", "phrases", "takes", "players", "blocks", "keys", "instruments"),
)
