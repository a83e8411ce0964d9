"""`include:` plays another score from a position on, with a prefix for its names."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from ergon.instruments.model import Target
from ergon.instruments.transpose import INTERVAL_SHAPE, Interval
from ergon.notation.clock.positions import Length, Position
from ergon.notation.clock.tempo import TempoMap
from ergon.notation.tables import value_kinds
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.shapes import Reference
from ergon.notation.text.errors import Collector, quote
from ergon.notation.text.values import Place
from ergon.scores.pattern.order import Group, Leaf
from ergon.scores.reading.automation import Automation
from ergon.scores.reading.piece import Piece, Strikes
from ergon.scores.reading.playing import Coupling, Play, Player
from ergon.scores.reading.rhythms import retargeted

MAX_INCLUDED = 200_000  # lines of parts, strikes, automation and couplings of a piece
# Sections of an included file that are ignored: those of the including score hold.
OVERRIDDEN_SECTIONS = ("tempo", "rates")

INCLUDE_RECORD = Record(
    "include",
    "what another score plays, with all that it names",
    (
        Field("file", value_kinds.PATH, "the score, relative to this one", required=True),
        Field("at", value_kinds.WHEN, "where its beginning is", shown="the beginning"),
        Field("as", Reference("a prefix for its names, such as v2"), "prefix of its names"),
        Field("transpose", INTERVAL_SHAPE, "how much higher its instruments sound; needs `as`"),
    ),
    synonyms={"score": "file"},
    value_pattern_by_field={"file": r"(\S+\.ya?ml)"},
)


@dataclass(frozen=True, slots=True)
class Include:
    """One line of `include:`, as read."""

    file: str
    at: Position
    prefix: str
    values: Values

    @property
    def place(self) -> Place:
        """Where its file is written."""
        return self.values.place_of("file")


@dataclass(frozen=True, slots=True)
class IncludedPlay:
    """What a score plays."""

    players: dict[str, Player]
    parts: tuple[Play, ...]
    strikes: tuple[Strikes, ...]
    automation: tuple[Automation, ...]
    duet: tuple[Coupling, ...]

    def __len__(self) -> int:
        """Number of lines."""
        return sum(map(len, (self.parts, self.strikes, self.automation, self.duet)))


def includes(score: Values) -> list[Include]:
    """The lines of `include:`; reports a transposition without a prefix."""
    include_lines = []
    for include_values in score["include"] or ():
        if not isinstance(include_values, Values):
            continue
        if include_values.written("transpose") and not include_values.written("as"):
            message = "transpose of include: instruments of this score would move too; write `as`, "
            include_values.error(
                "E103", message + "a prefix for the names of the file", "transpose"
            )
            continue
        include_lines.append(
            Include(
                include_values["file"],
                include_values["at"] or Position(),
                str(include_values["as"] or ""),
                include_values,
            )
        )
    return include_lines


def transposed_values(part_values: Any, include: Include) -> Any:
    """An instrument moved by the `transpose` of an include, after its own `transpose`."""
    interval: Interval | None = include.values["transpose"]
    if interval is None or not isinstance(part_values, Values):
        return part_values
    part_interval = part_values["transpose"] if "transpose" in part_values.by_name else None
    transposed_fields = {
        **part_values.by_name,
        "transpose": part_interval.plus(interval) if part_interval else interval,
    }
    nodes = {**part_values.nodes, "transpose": include.values.nodes["transpose"]}
    return replace(part_values, by_name=transposed_fields, nodes=nodes)


def included_play(
    piece: Piece, include: Include, n_links_before: int, collector: Collector
) -> IncludedPlay:
    """What a piece plays, from the position of an include on and under its prefix.

    `n_links_before` is the number of couplings before. Reports pitches that cannot be transposed.
    """
    _check_pitches(piece, include, collector)
    prefixed = _prefixer(include.prefix)
    moved = _position_mover(include.at, piece.tempo_map)
    moved_or_none = _optional_mover(moved)

    include_copy = _IncludedCopy(prefixed, moved, moved_or_none)
    players = {
        prefixed(item.name): replace(
            item,
            name=prefixed(item.name),
            key=prefixed(item.key),
            standin=None if item.standin is None else prefixed(item.standin),
        )
        for item in piece.players.values()
    }
    played_parts = tuple(
        replace(
            item,
            player=prefixed(item.player),
            played_text=prefixed(item.played_text) if item.pattern is None else item.played_text,
            at=moved(item.at),
            until=moved_or_none(item.until),
            pattern=None
            if item.pattern is None
            else replace(item.pattern, order=_renamed_order(item.pattern.order, prefixed)),
        )
        for item in piece.parts
    )
    strikes = tuple(map(include_copy.copy_strikes, piece.strikes))
    automation = tuple(
        replace(
            item,
            target=include_copy.copy_target(item.target),
            other_notes=tuple(map(include_copy.copy_target, item.other_notes)),
            at=moved(item.at),
            until=moved_or_none(item.until),
        )
        for item in piece.automation
    )
    duet = tuple(
        replace(
            item,
            link=replace(item.link, name=f"duet{number}"),
            a=include_copy.copy_target(item.a),
            b=include_copy.copy_target(item.b),
            at=moved(item.at),
            until=moved_or_none(item.until),
        )
        for number, item in enumerate(piece.duet, n_links_before)
    )
    return IncludedPlay(players, played_parts, strikes, automation, duet)


class _IncludedCopy(NamedTuple):
    """How what an included piece plays is renamed and moved."""

    prefixed: Callable[[str], str]
    moved: Callable[[Position], Position]
    moved_end: Callable[[Position | None], Position | None]

    def copy_target(self, target: Target) -> Target:
        return replace(target, part=self.prefixed(target.part), text=self.prefixed(target.text))

    def copy_targets(self, targets: tuple[Target, ...]) -> tuple[Target, ...]:
        return tuple(map(self.copy_target, targets))

    def copy_strikes(self, item: Strikes) -> Strikes:
        prefixed, moved = self.prefixed, self.moved
        return replace(
            item,
            name=prefixed(item.name),
            to=self.copy_targets(item.to),
            at=moved(item.at),
            until=self.moved_end(item.until),
            voices={word: self.copy_targets(names) for word, names in item.voices.items()},
            rhythm=item.rhythm and retargeted(item.rhythm, self.copy_target),
            impulse_ranges={
                prefixed(part): impulse_range for part, impulse_range in item.impulse_ranges.items()
            },
            glides=tuple(
                replace(glide, target=self.copy_target(glide.target)) for glide in item.glides
            ),
            hits=tuple(
                replace(
                    hit,
                    at=moved(hit.at) if isinstance(hit.at, Position) else hit.at,
                    to=self.copy_targets(hit.to),
                )
                for hit in item.hits
            ),
        )


def _check_pitches(piece: Piece, include: Include, collector: Collector) -> None:
    """Report E304 if a piece sets pitches that do not move with its instruments."""
    if include.values["transpose"] is None:
        return
    transpose_place = include.values.place_of("transpose")
    fixed_pitches = [
        f"automation of {quote(entry.name)}"
        for entry in piece.automation
        if entry.parameter == "f"
        and not all(
            amount.is_factor
            for amount in (
                *entry.amounts.values(),
                *(point.amount for point in entry.points),
                *(amount for _, amount in entry.moves),
                *((entry.swing.low, entry.swing.high) if entry.swing else ()),
            )
        )
    ]
    fixed_pitches += [f"strikes {quote(entry.name)}" for entry in piece.strikes if entry.notes]
    for fixed_pitch in fixed_pitches:
        message = f"transpose of include: {fixed_pitch} in {include.file} sets pitches, which stay"
        help = "write its values as factors, such as x1.5, or leave `transpose` out"
        collector.error("E304", message, transpose_place, help=help)


def _prefixer(prefix: str) -> Callable[[str], str]:
    return (lambda name: f"{prefix}.{name}") if prefix else lambda name: name


def _position_mover(start_position: Position, tempo: TempoMap) -> Callable[[Position], Position]:
    """A function from positions of a file, in its own bars and marks, to beats and seconds after
    `start_position`.
    """

    def moved(written_position: Position) -> Position:
        plus_seconds = written_position.plus.seconds
        beats = tempo.resolve(
            replace(written_position, plus=replace(written_position.plus, seconds=0.0))
        )
        start_offset = start_position.plus
        moved_length = Length(
            start_offset.bars, start_offset.beats + beats, start_offset.seconds + plus_seconds
        )
        return replace(start_position, plus=moved_length, text=written_position.text)

    return moved


def _optional_mover(
    moved: Callable[[Position], Position],
) -> Callable[[Position | None], Position | None]:
    return lambda value: None if value is None else moved(value)


def _renamed_order(pattern_order: Group, prefixed: Callable[[str], str]) -> Group:
    renamed_items = tuple(
        _renamed_order(item, prefixed)
        if isinstance(item, Group)
        else item
        if item.name is None
        else Leaf(prefixed(item.name), item.span, item.places)
        for item in pattern_order.items
    )
    return replace(pattern_order, items=renamed_items)
