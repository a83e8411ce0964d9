"""Keys in real hands: moved live from a device, by a stand-in's gesture, or from a recording."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ergon import _core
from ergon.instruments.assemble import Assembly
from ergon.instruments.model import Module
from ergon.notation.clock.meter import SAME
from ergon.notation.text.errors import Collector, quote
from ergon.scores.reading.piece import Piece
from ergon.scores.reading.playing import Key, Player
from ergon.scores.staging.drives import add_drives
from ergon.scores.staging.hands import Hands, Window
from ergon.scores.staging.refusals import StageError
from ergon.scores.staging.takes import Takes

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon.scores.staging.tick_forces import TickForces

    # Players whose hands are real, with the position at every tick (n_ticks,) [m] if it is known.
    RealHands = Mapping[str, NDArray[np.float64] | None]

# How often a device is read unless its player has a `tick` [Hz].
TICK_HZ = 1000.0
_BLOCK_FRAMES = 4096  # frames
# The most positions of a hand that are known beforehand: 80 MB, held three times over.
MAX_TICKS = 10_000_000
# The most frames computed for the path of a key, an hour at 44.1 kHz: some 20 s of CPU time.
MAX_FRAMES = 160_000_000
# Time after which the position of a key no longer depends on what was played before [s].
_SETTLED_SECONDS = 5.0
# In a pause between gestures that is longer than this, a key at rest is not computed [s].
_PAUSE_SECONDS = 60.0
_REST_MOVEMENT_MAX = 1e-12  # largest movement of a key at rest [m]


@dataclass(frozen=True, slots=True)
class LiveHand:
    """A real hand on a key. `standin_path` (n_ticks,) [m] are the positions that play without a
    person.

    The player's part, or the stand-in, lasts `n_ticks`.
    """

    player: str
    key: str
    index: int  # among the hands of the engine
    mat: int
    tick_frames: int
    reach: float
    standin_path: NDArray[np.float64]
    n_ticks: int


def stand_in_players(piece: Piece) -> dict[str, None]:
    """Live players whose take moves the key as it was captured: they have no part, and their key no
    other player.
    """
    players = [
        player
        for player in piece.players.values()
        if player.hand == "live" and player.standin in piece.takes
    ]
    if not players:
        return {}
    players_with_part = {play.player for play in piece.parts}
    keys = [player.key for player in piece.players.values()]
    return {
        player.name: None
        for player in players
        if player.name not in players_with_part and keys.count(player.key) == 1
    }


def join_hands(
    piece: Piece,
    real_hands: RealHands,
    assembly: Assembly,
    timeline: _core.Timeline,
    collector: Collector,
    *,
    is_resting: bool = False,
) -> Iterator[LiveHand]:
    """Put every real hand on its key; without a person the player's part plays, or the key
    `is_resting`.
    """
    import numpy as np

    tick_frames = _tick_frames(piece, real_hands, collector)
    for player_name, positions_known in real_hands.items():
        player = piece.players[player_name]
        player_key = piece.keys[player.key]
        if not _check_alone(piece, player, real_hands, collector):
            continue
        standin_path = (
            np.zeros(2) if is_resting else standin_positions(piece, player, tick_frames, collector)
        )
        hand_positions = _with_standin(positions_known, standin_path)
        mat = assembly.mats[player_key.name, player_key.struck]
        hand_index = timeline.hand(mat, tick_frames, positions=hand_positions * player_key.reach)
        yield LiveHand(
            player_name,
            player_key.name,
            hand_index,
            mat,
            tick_frames,
            player_key.reach,
            hand_positions,
            len(standin_path),
        )


def _with_standin(
    recorded_positions: NDArray[np.float64] | None, standin_path: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The recorded positions of a hand; where they are NaN, before it was there, those of the
    stand-in.
    """
    import numpy as np

    if recorded_positions is None:
        return standin_path
    missing_ticks = np.flatnonzero(np.isnan(recorded_positions))
    if not len(missing_ticks):
        return recorded_positions
    return np.concatenate(
        [
            standin_path[np.minimum(missing_ticks, len(standin_path) - 1)],
            recorded_positions[len(missing_ticks) :],
        ]
    )


def check_players(piece: Piece, real_hands: RealHands, collector: Collector) -> None:
    """Raise StageError if a real hand plays for a player that the piece does not have."""
    for name in real_hands:
        if name not in piece.players:
            message = f"{quote(name)} plays on a device, and this score has no player of that name"
            collector.error("E308", message, piece.place)
    if collector.has_errors():
        raise StageError(collector.finish())


def with_reduced_keys(piece: Piece, real_hands: RealHands) -> Piece:
    """The piece with the keys in real hands reduced to their struck MAT.

    The real key has its own modes, friction and delay, so those that were measured are left out.
    """
    reduced_keys = {
        name: replace(key, modules=struck_modules, delay=0.0)
        for name in dict.fromkeys(piece.players[player].key for player in real_hands)
        for key in [piece.keys[name]]
        if len(struck_modules := _struck_modules(key)) < len(key.modules) or key.delay
    }
    return replace(piece, keys={**piece.keys, **reduced_keys}) if reduced_keys else piece


def _struck_modules(key: Key) -> tuple[Module, ...]:
    """The modules of a key in a real hand: the CEL of a measured key, or all that are written."""
    is_measured = key.struck == ""  # then the module of the CEL has no name
    return tuple(module for module in key.modules if not is_measured or module.name == "")


def _tick_frames(piece: Piece, real_hands: RealHands, collector: Collector) -> int:
    """Frames in a tick: all hands share one rate."""
    players_by_rate = {
        piece.players[name].tick or TICK_HZ: piece.players[name] for name in real_hands
    }
    if len(players_by_rate) > 1:
        player = [*players_by_rate.values()][-1]
        message = f"{quote(player.name)}: live hands have different ticks; write one `tick` for all"
        collector.error("E308", message, player.place)
    return max(1, round(piece.rate / next(iter(players_by_rate), TICK_HZ)))


def _check_alone(piece: Piece, player: Player, real_hands: RealHands, collector: Collector) -> bool:
    playing_players = {play.player for play in piece.parts}
    for other_player in piece.players.values():
        is_playing = other_player.name in playing_players
        if (
            other_player is player
            or other_player.key != player.key
            or not (is_playing or other_player.name in real_hands)
        ):
            continue
        message = (
            f"{quote(other_player.name)} plays key {quote(player.key)} too, which the real hand of "
            f"{quote(player.name)} moves; give {quote(other_player.name)} another key"
        )
        collector.error("E308", message, other_player.place)
        return False
    return True


def standin_positions(
    piece: Piece, player: Player, tick_frames: int, collector: Collector
) -> NDArray[np.float64]:
    """Positions of the key at every tick if the player's part, or its stand-in, plays alone [m]."""
    import numpy as np

    network, hands = solo_hands(piece, player, collector)
    # A part that is shifted to before the beginning has ended when the piece begins.
    end = max([0.0, *(gesture.stop for gesture in hands.gestures)])
    n_ticks = int(end * piece.rate) // tick_frames + 2
    if n_ticks > MAX_TICKS:
        duration_max = MAX_TICKS * tick_frames / piece.rate
        message = (
            f"{quote(player.name)}: the part that plays in place "
            f"of a real hand lasts {end:,.0f} s; "
            f"with ticks of {piece.rate / tick_frames:g} Hz the maximum is {duration_max:,.0f} s"
        )
        help_text = "write a lower `tick` or a shorter part"
        collector.error("E308", message, player.place, help=help_text)
        return np.zeros(2)
    positions = _sparse_tick_positions(network, hands, tick_frames, n_ticks)
    if positions is None:
        message = (
            f"{quote(player.name)}: the part that plays in place of a real hand moves its key "
            f"for more than {MAX_FRAMES / piece.rate:,.0f} s; that is the maximum, and pauses of "
            f"more than {_PAUSE_SECONDS:g} s in which the key is at rest do not count"
        )
        collector.error("E308", message, player.place, help="write a shorter part")
        return np.zeros(2)
    return positions


def solo_hands(piece: Piece, player: Player, collector: Collector) -> tuple[_core.Network, Hands]:
    """The network of a player's key, its position as output, and the part or stand-in on it."""
    solo_piece = _solo_piece(piece, player)
    network, hands = _network_and_hands(solo_piece, player, collector)
    hands.play_parts(solo_piece)
    if not solo_piece.parts and player.standin:
        hands.play_standin(player)
    return network, hands


def leading_positions(
    piece: Piece,
    player_name: str,
    spans: Sequence[tuple[Piece, Window]],
    tick_frames: int,
    ticks: range,
    forces: TickForces | None = None,
) -> tuple[NDArray[np.float64], list[tuple[float, float]]]:
    """Positions of a player's key while stretches of this and other pieces play, its part alone.

    At each of the `ticks` (n_ticks,) [m], with the start and end [s] of each gesture. The mean
    `forces` of its ergons in these ticks are added.
    """
    collector = Collector()
    settling_tick = max(0, ticks.start - int(_SETTLED_SECONDS * piece.rate) // tick_frames)
    network, hands = _network_and_hands(
        _solo_piece(piece, piece.players[player_name]), piece.players[player_name], collector
    )
    hands.timeline.open()
    settling_start, end = (tick * tick_frames / piece.rate for tick in (settling_tick, ticks.stop))
    for span_piece, window in spans:
        if player_name not in span_piece.players:
            continue
        solo_piece = _solo_piece(span_piece, span_piece.players[player_name])
        until_beat = min(window.until_beat, span_piece.tempo_map.beats(end) + SAME)
        span_hands = hands.for_piece(
            solo_piece, window._replace(until_beat=until_beat, after_instant=settling_start)
        )
        span_hands.play_parts(solo_piece)
    start = settling_tick * tick_frames
    simulation = _core.Simulation(
        network, hands.timeline, start=start, record=forces is not None, on_fault="mute"
    )
    positions = _tick_positions(simulation, tick_frames, ticks.stop - settling_tick)[
        ticks.start - settling_tick :
    ]
    if forces is not None:
        _tick_positions(simulation, tick_frames, forces.n_late_ticks)
        forces.add(simulation)
    return positions, [(gesture.start, gesture.stop) for gesture in hands.gestures]


def _network_and_hands(
    piece: Piece, player: Player, collector: Collector
) -> tuple[_core.Network, Hands]:
    """The network of a player's key, with its position as output, and hands on it."""
    key = piece.keys[player.key]
    assembly = Assembly(seed=piece.seed)
    for add_modules in (assembly.add_part, assembly.add_links):
        add_modules(key.name, key.modules, ca_rate=None, reach=1.0)
    struck_mat = assembly.mats[key.name, key.struck]
    assembly.network.listen("key", positions=[(struck_mat, 1, 1.0)])
    timeline = _core.Timeline(assembly.network, piece.rate)
    hands = Hands(piece, timeline, Takes(piece, collector), collector)
    add_drives(replace(piece, instruments={}), assembly, hands, {})
    hands.add_key(key.name, struck_mat)
    return assembly.network, hands


def _tick_positions(
    simulation: _core.Simulation, tick_frames: int, n_ticks: int
) -> NDArray[np.float64]:
    """The position at each of the next ticks (n_ticks,) [m]."""
    import numpy as np

    block_ticks = max(1, _BLOCK_FRAMES // tick_frames)
    tick_positions = np.zeros(n_ticks)
    for first_tick in range(0, n_ticks, block_ticks):
        n_block_ticks = min(block_ticks, n_ticks - first_tick)
        frames = np.zeros((n_block_ticks * tick_frames, 1))
        simulation.process(frames)
        tick_positions[first_tick : first_tick + n_block_ticks] = frames[::tick_frames, 0]
    return tick_positions


def _sparse_tick_positions(
    network: _core.Network, hands: Hands, tick_frames: int, n_ticks: int
) -> NDArray[np.float64] | None:
    """Positions of a key at every tick (n_ticks,) [m]; long pauses at rest are not computed.

    None if more than `MAX_FRAMES` would have to be computed.
    """
    import numpy as np

    rate = hands.piece.rate
    block_ticks = max(1, _BLOCK_FRAMES // tick_frames)
    n_moving_max = MAX_FRAMES // tick_frames
    pauses = [*_pauses(hands, tick_frames, n_ticks)]
    n_moving = n_ticks - sum(pause_end - pause_start for pause_start, pause_end in pauses)
    if n_moving > n_moving_max:
        return None
    tick_positions = np.zeros(n_ticks)
    simulation, first_tick = _core.Simulation(network, hands.timeline), 0
    for pause_start, pause_end in pauses:
        tick_positions[first_tick:pause_start] = _tick_positions(
            simulation, tick_frames, pause_start - first_tick
        )
        first_tick, resumed_tick = pause_start, pause_end - round(rate) // tick_frames
        later_simulation = _core.Simulation(
            network, hands.timeline, start=resumed_tick * tick_frames
        )
        resting_positions = _tick_positions(later_simulation, tick_frames, 2)
        # A new simulation that does not start at rest cannot replace the one that has come to rest.
        if np.ptp(resting_positions) > _REST_MOVEMENT_MAX:
            n_moving += pause_end - pause_start
        while first_tick < resumed_tick and np.ptp(resting_positions) <= _REST_MOVEMENT_MAX:
            n_block_ticks = min(block_ticks, resumed_tick - first_tick)
            n_moving += n_block_ticks
            if n_moving > n_moving_max:
                return None
            block_positions = tick_positions[first_tick : first_tick + n_block_ticks] = (
                _tick_positions(simulation, tick_frames, n_block_ticks)
            )
            first_tick += n_block_ticks
            if np.abs(block_positions - resting_positions[0]).max() <= _REST_MOVEMENT_MAX:
                tick_positions[first_tick : resumed_tick + 2] = resting_positions[0]
                simulation, first_tick = later_simulation, resumed_tick + 2
    if n_moving > n_moving_max:
        return None
    tick_positions[first_tick:] = _tick_positions(simulation, tick_frames, n_ticks - first_tick)
    return tick_positions


def _pauses(hands: Hands, tick_frames: int, n_ticks: int) -> Iterator[tuple[int, int]]:
    """Long pauses without gestures, as the tick after the last one and the tick of the next."""
    rate, last_stop = hands.piece.rate, 0.0
    for gesture in sorted(hands.gestures, key=lambda gesture: gesture.start):
        if gesture.start > last_stop + _PAUSE_SECONDS:
            # A throw may move a key beyond the end of its gesture.
            yield (
                int(last_stop * rate) // tick_frames + 1,
                min(n_ticks, int(gesture.start * rate) // tick_frames),
            )
        last_stop = max(last_stop, gesture.stop)


def _solo_piece(piece: Piece, player: Player) -> Piece:
    """The piece reduced to one player's part, on a key without a lever."""
    player_plays = [
        play_and_starts
        for play_and_starts in zip(piece.parts, piece.starts, strict=True)
        if play_and_starts[0].player == player.name
    ]
    direct_key: Key = replace(piece.keys[player.key], reach=1.0)
    return replace(
        piece,
        keys={direct_key.name: direct_key},
        players={player.name: player},
        parts=tuple(play for play, _ in player_plays),
        starts=tuple(starts for _, starts in player_plays),
    )
