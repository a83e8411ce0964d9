"""`include:` plays another score from a position on, with a prefix for its names."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from ergon.instruments.model import Target
from ergon.instruments.transpose import INTERVAL, Interval
from ergon.notation.clock.positions import Length, Position
from ergon.notation.clock.tempo import TempoMap
from ergon.notation.tables import value_kinds as k
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.shapes import Reference
from ergon.notation.text.errors import Collector, quote
from ergon.notation.text.values import Place
from ergon.scores.pattern.order import Group, Leaf
from ergon.scores.reading.automation import Automation
from ergon.scores.reading.piece import Coupling, Piece, Play, Player, Strikes
from ergon.scores.reading.rhythms import retargeted

MAX_INCLUDED = 200_000  # lines of parts, strikes, automation and couplings of a piece
# Sections of an included file that are ignored: those of the including score hold.
YIELDING = ("tempo", "rates")

INCLUDE = Record(
    "include",
    "what another score plays, with all that it names",
    (
        Field("file", k.PATH, "the score, relative to this one", required=True),
        Field("at", k.WHEN, "where its beginning is", shown="the beginning"),
        Field("as", Reference("a prefix for its names, such as v2"), "prefix of its names"),
        Field("transpose", INTERVAL, "how much higher its instruments sound; needs `as`"),
    ),
    meant={"score": "file"},
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
class Played:
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
    found = []
    for v in score["include"] or ():
        if not isinstance(v, Values):
            continue
        if v.written("transpose") and not v.written("as"):
            message = "transpose of include: instruments of this score would move too; write `as`, "
            v.error("E103", message + "a prefix for the names of the file", "transpose")
            continue
        found.append(Include(v["file"], v["at"] or Position(), str(v["as"] or ""), v))
    return found


def transposed(values: Any, include: Include) -> Any:
    """An instrument moved by the `transpose` of an include, after its own `transpose`."""
    interval: Interval | None = include.values["transpose"]
    if interval is None or not isinstance(values, Values):
        return values
    own = values["transpose"] if "transpose" in values.given else None
    given = {**values.given, "transpose": own.then(interval) if own else interval}
    nodes = {**values.nodes, "transpose": include.values.nodes["transpose"]}
    return replace(values, given=given, nodes=nodes)


def played(piece: Piece, include: Include, first_link: int, collector: Collector) -> Played:
    """What a piece plays, from the position of an include on and under its prefix.

    `first_link` is the number of couplings before. Reports pitches that cannot be transposed.
    """
    _check_pitches(piece, include, collector)
    named = _named(include.prefix)
    moved = _moved(include.at, piece.tempo_map)
    until = _or_none(moved)

    def target(own: Target) -> Target:
        return replace(own, part=named(own.part), text=named(own.text))

    def targets(own: tuple[Target, ...]) -> tuple[Target, ...]:
        return tuple(map(target, own))

    players = {
        named(one.name): replace(
            one,
            name=named(one.name),
            key=named(one.key),
            standin=None if one.standin is None else named(one.standin),
        )
        for one in piece.players.values()
    }
    parts = tuple(
        replace(
            one,
            player=named(one.player),
            what=named(one.what) if one.pattern is None else one.what,
            at=moved(one.at),
            until=until(one.until),
            pattern=None
            if one.pattern is None
            else replace(one.pattern, order=_renamed(one.pattern.order, named)),
        )
        for one in piece.parts
    )
    strikes = tuple(
        replace(
            one,
            name=named(one.name),
            to=targets(one.to),
            at=moved(one.at),
            until=until(one.until),
            voices={word: targets(own) for word, own in one.voices.items()},
            rhythm=one.rhythm and retargeted(one.rhythm, target),
            reaches={named(part): reach for part, reach in one.reaches.items()},
            glides=tuple(replace(g, target=target(g.target)) for g in one.glides),
            hits=tuple(
                replace(
                    hit,
                    at=moved(hit.at) if isinstance(hit.at, Position) else hit.at,
                    to=targets(hit.to),
                )
                for hit in one.hits
            ),
        )
        for one in piece.strikes
    )
    automation = tuple(
        replace(
            one,
            target=target(one.target),
            other_notes=tuple(map(target, one.other_notes)),
            at=moved(one.at),
            until=until(one.until),
        )
        for one in piece.automation
    )
    duet = tuple(
        replace(
            one,
            link=replace(one.link, name=f"duet{number}"),
            a=target(one.a),
            b=target(one.b),
            at=moved(one.at),
            until=until(one.until),
        )
        for number, one in enumerate(piece.duet, first_link)
    )
    return Played(players, parts, strikes, automation, duet)


def _check_pitches(piece: Piece, include: Include, collector: Collector) -> None:
    """Report E304 if a piece sets pitches that do not move with its instruments."""
    if include.values["transpose"] is None:
        return
    place = include.values.place_of("transpose")
    fixed = [
        f"automation of {quote(one.name)}"
        for one in piece.automation
        if one.parameter == "f"
        and not all(
            amount.is_factor
            for amount in (
                *one.amounts.values(),
                *(point.amount for point in one.points),
                *(amount for _, amount in one.moves),
                *((one.swing.low, one.swing.high) if one.swing else ()),
            )
        )
    ]
    fixed += [f"strikes {quote(one.name)}" for one in piece.strikes if one.notes]
    for what in fixed:
        message = f"transpose of include: {what} in {include.file} sets pitches, which stay"
        help = "write its values as factors, such as x1.5, or leave `transpose` out"
        collector.error("E304", message, place, help=help)


def _named(prefix: str) -> Callable[[str], str]:
    return (lambda name: f"{prefix}.{name}") if prefix else lambda name: name


def _moved(start: Position, tempo: TempoMap) -> Callable[[Position], Position]:
    """A function from positions of a file, in its own bars and marks, to beats and seconds after
    `start`.
    """

    def moved(own: Position) -> Position:
        seconds = own.plus.seconds
        beats = tempo.resolve(replace(own, plus=replace(own.plus, seconds=0.0)))
        plus = start.plus
        later = Length(plus.bars, plus.beats + beats, plus.seconds + seconds)
        return replace(start, plus=later, text=own.text)

    return moved


def _or_none(moved: Callable[[Position], Position]) -> Callable[[Position | None], Position | None]:
    return lambda own: None if own is None else moved(own)


def _renamed(order: Group, named: Callable[[str], str]) -> Group:
    items = tuple(
        _renamed(item, named)
        if isinstance(item, Group)
        else item
        if item.name is None
        else Leaf(named(item.name), item.span, item.places)
        for item in order.items
    )
    return replace(order, items=items)
