"""The network of a piece's modules, with its couplings and its outputs."""

from __future__ import annotations

import math
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass, replace

from ergon import _core
from ergon.instruments.assemble import Assembly
from ergon.instruments.module_kinds import member_count
from ergon.notation.clock.shifted import OffsetTempoMap
from ergon.scores.reading.digest import is_same_network
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.late_keys import links_on_keys
from ergon.scores.staging.listening import Listening, fade_curves, make_listening

COUPLING_ENDED_SECONDS = -math.inf  # the end of a coupling that acts no longer


@dataclass(frozen=True, slots=True)
class BuiltNetwork:
    """The modules of a piece as a network, the LIA of each coupling, and the outputs."""

    piece: Piece
    assembly: Assembly
    coupling_links: Sequence[int]
    listening: Listening

    @property
    def network(self) -> _core.Network:
        """The network that the modules make."""
        return self.assembly.network

    def points_in_space(self) -> Iterator[list[int]]:
        """The coordinates of each point in space, as MATs, axis by axis."""
        for name, instrument in self.piece.instruments.items():
            for part_module in instrument.modules:
                first_mats = self.assembly.points.get((name, part_module.name))
                if first_mats is not None:
                    for member_index in range(member_count(part_module.kind, part_module.fields)):
                        yield [first_mat + member_index for first_mat in first_mats]

    def for_piece(self, piece: Piece, silent: Container[str] = ()) -> BuiltNetwork | None:
        """This network for another piece, if its modules and how they are heard are the same; else
        None.

        `silent` are the instruments that are not listened to.
        """
        if silent != self.listening.silent_instruments:
            return None
        if not is_same_network(self.piece, piece) or fade_curves(self.piece) != fade_curves(piece):
            return None  # fades depend on the tempo
        return replace(self, piece=piece)


def build_network(piece: Piece, silent_instruments: Container[str]) -> BuiltNetwork:
    """The network of a piece; the `silent_instruments` instruments are not listened to.

    Raises EngineError for the first refused module; if several are refused, its `refusals` has
    one error for each.
    """
    refusals: list[_core.EngineError] = []
    assembly = Assembly(seed=piece.seed, refusals=refusals)
    couplings = add_parts(piece, assembly)
    if len(refusals) == 1:
        raise refusals[0]
    if refusals:
        error = _core.EngineError("\n".join(map(str, refusals)))
        error.module, error.refusals = None, refusals
        raise error
    return BuiltNetwork(
        piece, assembly, couplings, make_listening(piece, assembly, silent_instruments)
    )


def add_parts(piece: Piece, assembly: Assembly) -> list[int]:
    """Add keys, instruments and couplings; returns the LIA of each coupling."""
    # Links reach the <M> points of other parts, so all of these are added first.
    for part_name, player_key in piece.keys.items():
        assembly.add_part(
            part_name, player_key.modules, reach=player_key.reach, every=player_key.every
        )
    for part_name in dict.fromkeys(end.part for _, end, _ in links_on_keys(piece)):
        player_key = piece.keys[part_name]
        if player_key.delay and (part_name, player_key.struck) in assembly.mats:
            struck_module = next(
                module for module in player_key.modules if module.name == player_key.struck
            )
            assembly.add_port(
                part_name, player_key.struck, player_key.reach * struck_module.fields["X0"]
            )
    for part_name, instrument in piece.instruments.items():
        assembly.add_part(
            part_name,
            instrument.modules,
            ca_rate=instrument.ca_rate,
            every=instrument.every,
            space=instrument.space,
        )
    for part_name, instrument in piece.instruments.items():
        assembly.add_followers(part_name, instrument.modules, ca_rate=instrument.ca_rate)
    for part_name, player_key in piece.keys.items():
        assembly.add_links(part_name, player_key.modules, reach=player_key.reach)
    for part_name, instrument in piece.instruments.items():
        assembly.add_links(part_name, instrument.modules, ca_rate=instrument.ca_rate)
    if assembly.refusals:
        return []  # the ends of a coupling may be left out
    if piece.duet:
        assembly.network.part("duet")
    return [
        assembly.add_link("duet", coupling.link, coupling.a, coupling.b) for coupling in piece.duet
    ]


def coupling_spans(piece: Piece) -> Iterator[tuple[float, float | None]]:
    """When each coupling begins and ends to act [s].

    The end is `COUPLING_ENDED_SECONDS` if it is over.
    """
    tempo = piece.tempo_map
    for coupling in piece.duet:
        end = None if coupling.until is None else tempo.seconds(tempo.resolve(coupling.until))
        begin = max(0.0, tempo.seconds(tempo.resolve(coupling.at)))
        has_ended = end is not None and end <= begin and isinstance(tempo, OffsetTempoMap)
        yield begin, COUPLING_ENDED_SECONDS if has_ended else end
