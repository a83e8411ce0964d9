"""A piece under the names by which its keys and instruments sound: the names they had first."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from typing import Any

from ergon.instruments.model import Act, Hold, Instrument, Module, Output, Target
from ergon.scores.reading.automation import Automation
from ergon.scores.reading.outputs import Mix, Route
from ergon.scores.reading.piece import Hit, Piece, Strikes
from ergon.scores.reading.playing import Coupling, Key, Player
from ergon.scores.reading.rhythms import Rhythm, renamed

# Types of which a field may hold a target or the name of a part.
_TYPES_WITH_NAMES = (
    *(Automation, Coupling, Hit, Instrument, Key, Mix, Module, Output, Player, Route, Strikes),
    *(Rhythm, Act, Hold),
)
_NAME_FIELDS = {Target: ("part", "text"), Route: ("part",), Player: ("key",)}
_NAME_FIELDS |= {Key: ("name",), Instrument: ("name",)}


class SoundingNames:
    """The names by which the parts of a piece sound, if they differ from their own.

    `names` are those of parts that were renamed. If another part takes a name that a renamed
    part still sounds by, that other part sounds by a new name.
    """

    def __init__(self, names: Mapping[str, str] | None = None) -> None:
        """Keep the names that differ."""
        self.names = {
            name_now: sounding_name
            for name_now, sounding_name in (names or {}).items()
            if name_now != sounding_name
        }
        self._renamed_by_id: dict[
            int, tuple[Any, Any]
        ] = {}  # by id, with the original, which keeps its id

    def __eq__(self, other: object) -> bool:
        """Whether the names are the same."""
        return isinstance(other, SoundingNames) and self.names == other.names

    __hash__ = None  # type: ignore[assignment]

    def sounding_name(self, shown_name: str) -> str:
        """The name by which a part, or something reached through it (`bell.m`), sounds."""
        if not self.names:
            return shown_name
        part_name, dot, path_rest = shown_name.partition(".")
        return f"{self._name_for(part_name)}{dot}{path_rest}"

    def _name_for(self, part_name: str) -> str:
        if part_name in self.names:
            return self.names[part_name]
        used_names = self.names.values()
        suffix, unique_name = 2, part_name
        while unique_name in used_names:
            suffix, unique_name = suffix + 1, f"{part_name}-{suffix}"
        return unique_name

    def shown_name(self, name: str, part_names: Iterable[str]) -> str:
        """The own name, among `part_names`, of the part that sounds by `name`."""
        if not self.names:
            return name
        return next(
            (name_now for name_now in part_names if self.sounding_name(name_now) == name), name
        )

    def with_renamed_part(self, old_name: str, new_name: str) -> SoundingNames:
        """The names after a part was renamed."""
        remaining_names = {
            name_now: name for name_now, name in self.names.items() if name_now != old_name
        }
        return SoundingNames({**remaining_names, new_name: self._name_for(old_name)})

    def sounding_piece(self, piece: Piece) -> Piece:
        """The piece with all names replaced by those by which its parts sound."""
        if not self.names:
            return piece
        old_by_id, self._renamed_by_id = self._renamed_by_id, {}
        sections = {
            name: self._renamed(getattr(piece, name), old_by_id)
            for name in ("keys", "instruments", "strikes", "players", "duet", "mix", "automation")
        }
        families = {
            self.sounding_name(name): tuple(map(self.sounding_name, members))
            for name, members in piece.families.items()
        }
        tunings = {self.sounding_name(name): tuned for name, tuned in piece.tunings.items()}
        parts_by_name = {
            section: {part.name: part for part in sections[section].values()}
            for section in ("keys", "instruments")
        }
        return replace(piece, **{**sections, **parts_by_name}, families=families, tunings=tunings)

    def _renamed(self, record: Any, old_by_id: dict[int, tuple[Any, Any]]) -> Any:
        """A value with its names replaced; the value itself if there are none."""
        if isinstance(record, (tuple, list)):
            renamed_items = [self._renamed(entry, old_by_id) for entry in record]
            is_same = all(a is b for a, b in zip(renamed_items, record, strict=True))
            return record if is_same else type(record)(renamed_items)
        if isinstance(record, Mapping):
            entries = {name: self._renamed(entry, old_by_id) for name, entry in record.items()}
            return record if all(entries[name] is record[name] for name in record) else entries
        if not isinstance(record, (Target, *_TYPES_WITH_NAMES)):
            return record
        value_and_renamed = (
            old_by_id.get(id(record))
            or self._renamed_by_id.get(id(record))
            or (record, self._with_new_names(record, old_by_id))
        )
        self._renamed_by_id[id(record)] = value_and_renamed
        return value_and_renamed[1]

    def _with_new_names(self, record: Any, old_by_id: dict[int, tuple[Any, Any]]) -> Any:
        if isinstance(record, Rhythm):
            record = renamed(record, self.sounding_name)
        name_fields = _NAME_FIELDS.get(type(record), ())
        changed_fields: dict[str, object] = {}
        for value_field in fields(record):
            field_value = getattr(record, value_field.name)
            new_value = (
                self.sounding_name(field_value)
                if value_field.name in name_fields
                else self._renamed(field_value, old_by_id)
            )
            if new_value is not field_value and new_value != field_value:
                changed_fields[value_field.name] = new_value
        return replace(record, **changed_fields) if changed_fields else record
