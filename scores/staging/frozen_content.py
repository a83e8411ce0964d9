"""Everything that determines the sound of an instrument: a frozen part is valid while it is the
same.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from typing import Any

from ergon.instruments.model import Instrument, Module, Target
from ergon.scores.reading.piece import Piece, Strikes
from ergon.scores.staging.listening import audible_outputs


def connected_parts(piece: Piece, instrument_name: str) -> set[str]:
    """The keys and instruments that links connect to an instrument, directly or not, with itself.

    Links to fixed points count too: a larger group than needed does no harm.
    """
    neighbours: dict[str, set[str]] = {}
    for first_part, second_part in _linked_pairs(piece):
        neighbours.setdefault(first_part, set()).add(second_part)
        neighbours.setdefault(second_part, set()).add(first_part)
    connected_names, unvisited_names = {instrument_name}, [instrument_name]
    while unvisited_names:
        next_parts = neighbours.get(unvisited_names.pop(), set()) - connected_names
        connected_names |= next_parts
        unvisited_names += next_parts
    return connected_names


def frozen_content(piece: Piece, instrument_name: str) -> tuple[Any, ...]:
    """The values of a piece that determine the outputs of an instrument.

    Processing between its outputs and the loudspeakers is not included.
    """
    joined_parts = connected_parts(piece, instrument_name)
    players = {name: entry for name, entry in piece.players.items() if entry.key in joined_parts}
    played_parts = tuple(part_play for part_play in piece.parts if part_play.player in players)
    strikes = tuple(entry for entry in piece.strikes if _strikes_any(entry, joined_parts))
    part_modules = [
        module for module_part, module in piece.modules() if module_part in joined_parts
    ]
    played_names = {name for part_play in played_parts for name in part_play.names}
    played_names |= {player.standin for player in players.values() if player.standin}
    played_names |= {
        str(module.fields["from"]) for module in part_modules if "from" in module.fields
    }
    routes = {
        (output.name, route.to == "nearest")
        for route, output in _outputs_of(piece, instrument_name)
    }
    file_meters = (piece.file_meters,) if piece.file_meters else ()
    return (
        (piece.seed, piece.rate, piece.tempo, piece.marks, piece.mix.layout, *file_meters),
        {name: key for name, key in piece.keys.items() if name in joined_parts},
        {name: entry for name, entry in piece.instruments.items() if name in joined_parts},
        players,
        played_parts,
        strikes,
        {name: gesture for name, gesture in piece.gestures.items() if name in played_names},
        {name: take for name, take in piece.takes.items() if name in played_names},
        tuple(entry for entry in piece.duet if {entry.a.part, entry.b.part} & joined_parts),
        tuple(
            entry
            for entry in piece.automation
            if any(part in joined_parts for part, _ in entry.modules)
        ),
        tuple(sorted(routes)),
    )


def _outputs_of(piece: Piece, part_name: str) -> Iterator[tuple[Any, Any]]:
    return (
        (route, output)
        for route, instrument, output in audible_outputs(piece)
        if instrument.name == part_name
    )


def _strikes_any(strikes: Strikes, parts: Collection[str]) -> bool:
    return not strikes.parts.isdisjoint(parts)


def _linked_pairs(piece: Piece) -> Iterator[tuple[str, str]]:
    """Pairs of parts that a link joins, or of which one listens to the other."""
    for part, module in piece.modules():
        yield from ((part, target.part) for target in _module_targets(module))
    for coupling in piece.duet:
        yield coupling.a.part, coupling.b.part
    for instrument in piece.instruments.values():
        yield from ((instrument.name, target.part) for target in _listened_targets(instrument))


def _module_targets(module: Module) -> Iterator[Target]:
    for value in module.fields.values():
        values: Iterable[Any] = value if isinstance(value, (tuple, list)) else (value,)
        yield from (target for target in values if isinstance(target, Target))


def _listened_targets(instrument: Instrument) -> Iterator[Target]:
    for output in instrument.outputs:
        yield from output.targets
