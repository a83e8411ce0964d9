"""What two pieces have in common whatever their text: digests of values, and their comparison."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any

from ergon.common.regular import file_digest
from ergon.instruments.model import Instrument, Layout, Module, Target
from ergon.instruments.module_kinds import HASH_OMITS_DEFAULTS
from ergon.notation.clock.positions import Position
from ergon.notation.tables.strengths import Level, Levels
from ergon.notation.text.document import Scalar
from ergon.notation.text.values import Place, Point
from ergon.scores.gesture.transforms import Transform
from ergon.scores.reading.automation import Automation
from ergon.scores.reading.outputs import RenderSpec
from ergon.scores.reading.piece import Hit, Piece, Strikes
from ergon.scores.reading.playing import Gesture, Key, Play, PlayingOptions, TakeFile
from ergon.scores.reading.rhythms import Rhythm


def is_same_network(piece: Piece, other_piece: Piece) -> bool:
    """Whether two pieces have the same modules, heard in the same way, whatever is played on them.

    Text, comments and places do not count, as in `digest_of`; comparing digests would take
    ten times as long.
    """
    return is_same(_network_fields(piece), _network_fields(other_piece))


def is_same(first_value: Any, second_value: Any) -> bool:
    """Whether two values of pieces have the same digest.

    Fast, because most parts of two versions are the same object.
    """
    if first_value is second_value or first_value == second_value:
        return True
    if type(first_value) is not type(second_value):
        return False
    if isinstance(first_value, (tuple, list)):
        return len(first_value) == len(second_value) and all(
            map(is_same, first_value, second_value)
        )
    if isinstance(first_value, Mapping):
        return first_value.keys() == second_value.keys() and all(
            is_same(first_value[key], second_value[key]) for key in first_value
        )
    if isinstance(first_value, (Key, Instrument)):
        field_names = [
            f.name
            for f in fields(first_value)
            if f.name not in _UNHASHED_FIELDS.get(type(first_value), ())
        ]
        return all(
            is_same(getattr(first_value, name), getattr(second_value, name)) for name in field_names
        )
    return [*_hash_chunks(first_value)] == [*_hash_chunks(second_value)]


_network_fields = attrgetter("rate", "seed", "keys", "instruments", "duet", "mix")


def digest_of(digested_value: Any) -> str:
    """SHA-256 of a piece or of a value of one: of values, not of text, comments, order of names,
    places or paths.

    A file that is read while rendering counts by its content.
    """
    sha256 = hashlib.sha256()
    for chunk in _hash_chunks(digested_value):
        sha256.update(chunk)
    return sha256.hexdigest()


_UNHASHED_FIELDS = {  # places and texts do not count
    Point: ("offset", "length"),
    Transform: ("offset", "length"),
    Gesture: ("bar_checks", "written"),
    Module: ("places",),
    TakeFile: ("places",),
    Position: ("text",),
    Target: ("text",),
    Hit: ("struck_text",),
    Instrument: ("pitch", "acts", "loudness"),  # what they say is in strikes and routes
    Layout: ("is_equidistant", "title", "outputs"),  # the file that is hashed by its path
    Key: ("measured_constants",),
    # Fields that follow from the others, or that do not change what is computed.
    Piece: (
        *("tempo_map", "starts", "blocks", "families", "phrases", "available", "used"),
        *("tuning", "tunings"),
    ),
    Rhythm: ("tuning",),
    RenderSpec: ("file",),
}


# Type names in a digest do not change, because recordings and frozen parts carry digests of earlier
# versions.
_HASHED_TYPE_NAMES: Mapping[type, str] = {PlayingOptions: "Manner"}
# Nor do names and values of fields: how strongly something is struck was a pair of impulses.
_HASHED_FIELD_NAMES: Mapping[tuple[type, str], str] = {
    (Strikes, "levels"): "impulse",
    (Hit, "level"): "impulse",
    (Hit, "impulse_range"): "reach",
    (Hit, "duration"): "lasting",
    (Strikes, "impulse_ranges"): "reaches",
    (Automation, "begin_place"): "at_place",
    (Automation, "strikes_name"): "struck",
    (Play, "begin_place"): "at_place",
    (Play, "played_text"): "what",
    (Play, "options"): "manner",
    (Gesture, "options"): "manner",
    (Rhythm, "first_cycle"): "first",
}


def _hashed_levels(hashed_value: Any) -> Any:
    """What a digest has in place of levels: a pair of impulses, where that is what they are."""
    if isinstance(hashed_value, Levels) and len(hashed_value.steps) == 1:
        hashed_value = hashed_value.steps[0]
    if isinstance(hashed_value, Level) and not hashed_value.is_strength:
        return hashed_value.low, hashed_value.high
    return hashed_value


def _fields_hashed(field_values: Any) -> Any:
    """The fields of a module, without fields that were added later and have their defaults."""
    if not isinstance(field_values, Mapping):
        return field_values
    return {
        name: field_value
        for name, field_value in field_values.items()
        if name not in HASH_OMITS_DEFAULTS or field_value != HASH_OMITS_DEFAULTS[name]
    }


def _hash_chunks(hashed_value: Any) -> Iterator[bytes]:
    """A value as unambiguous bytes: every item says its type, every group its size."""
    if is_dataclass(hashed_value) and not isinstance(hashed_value, type):
        if isinstance(hashed_value, (Place, Scalar)):
            return
        skipped_fields = _UNHASHED_FIELDS.get(type(hashed_value), ())
        yield (
            b"{" + _HASHED_TYPE_NAMES.get(type(hashed_value), type(hashed_value).__name__).encode()
        )
        for value_field in fields(hashed_value):
            field_content = getattr(hashed_value, value_field.name)
            is_omitted = (value_field.metadata.get("hash_omits_empty") and not field_content) or (
                value_field.metadata.get("hash_omits_none") and field_content is None
            )
            if value_field.name not in skipped_fields and not is_omitted:
                field_name = _HASHED_FIELD_NAMES.get((type(hashed_value), value_field.name))
                yield f".{field_name or value_field.name}=".encode()
                if field_name:
                    field_content = _hashed_levels(field_content)
                yield from _hash_chunks(
                    _fields_hashed(field_content)
                    if isinstance(hashed_value, Module)
                    else field_content
                )
        yield b"}"
    elif isinstance(hashed_value, Mapping):
        yield b"m%d" % len(hashed_value)
        for key in sorted(hashed_value):
            yield from _hash_chunks(key)
            yield from _hash_chunks(hashed_value[key])
    elif isinstance(hashed_value, (tuple, list)):
        yield b"l%d" % len(hashed_value)
        for hashed_item in hashed_value:
            yield from _hash_chunks(hashed_item)
    elif isinstance(hashed_value, Path):
        yield b"p" + (
            file_digest(hashed_value) if hashed_value.is_file() else hashlib.sha256().digest()
        )
    elif isinstance(hashed_value, float):
        yield b"f" + (hashed_value + 0.0).hex().encode()  # -0.0 and 0.0 are one value
    else:
        value_bytes = str(hashed_value).encode("utf-8", "surrogatepass")
        type_name = "s" if isinstance(hashed_value, str) else type(hashed_value).__name__
        yield f"{type_name}{len(value_bytes)}:".encode()
        yield value_bytes
