"""Checks whether gestures stay within the travel of their keys: paths exactly, throws by
rehearsal.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from ergon import _core
from ergon.instruments.assemble import Assembly
from ergon.notation.text.errors import Collector, quote
from ergon.notation.text.values import Place
from ergon.scores.reading.piece import Piece
from ergon.scores.reading.playing import Key
from ergon.scores.staging.hands import StagedGesture

_TRAVEL_TOLERANCE = 1e-9  # metres: a written point on the very end of the travel is inside
# Near a multiple of half the key's period the strike that meets the next point grows without bound:
# |sin ωΔt| of 0.2 takes five times the strike of a quarter period.
_AIM_SINE_MIN = 0.2
# A line's throws are rehearsed at most this often, each distinct occurrence once: chance and tempo
# may make every occurrence different.
_REHEARSALS_MAX = 64
_BLOCK_FRAMES = 4096  # frames computed at once: of a rehearsal nothing is kept but its extremes
# A rehearsal takes about this many frames at most, unless that leaves fewer than 64 in a period of
# the key, or fewer than 1000 in a second if the key is not one underdamped CEL.
_FRAMES_MAX = 1 << 21
_GESTURE_SECONDS_MAX = 24 * 3600.0  # [s]
_RATE_HZ_MIN, _STEPS_PER_PERIOD = 1000.0, 64.0


def check_travel(
    piece: Piece, timeline: _core.Timeline, gestures: Sequence[StagedGesture], collector: Collector
) -> None:
    """Report gestures that leave the travel (E307) and throws that can hardly be aimed (W312).

    Each distinct gesture is checked once, alone on its free key, up to 64 for a line with
    throws; each line of a part is reported once, for its farthest swing.
    """
    checked_keys: set[tuple[object, ...]] = set()
    rehearsal_counts: Counter[Place] = Counter()
    farthest_by_place: dict[Place, tuple[float, str, str]] = {}
    singular_places: set[Place] = set()
    limits = {name: _travel_limits(key) for name, key in piece.keys.items()}
    for gesture, (low_position, high_position) in zip(gestures, timeline.ranges(), strict=True):
        position_min, position_max = limits[gesture.key]
        if gesture.stop - gesture.start > _GESTURE_SECONDS_MAX:
            continue  # too long for a piece: reported elsewhere
        is_inside = (
            low_position >= position_min - _TRAVEL_TOLERANCE
            and high_position <= position_max + _TRAVEL_TOLERANCE
        )
        if gesture.is_layer or (is_inside and "throw" not in gesture.curves):
            continue
        player_key = piece.keys[gesture.key]
        if gesture.throw_indices and rehearsal_counts[gesture.place] == _REHEARSALS_MAX:
            continue
        points = zip(gesture.instants, gesture.positions, strict=True)
        relative_points = tuple((round(t - gesture.start, 9), x) for t, x in points)
        gesture_key = (
            gesture.key,
            gesture.name,
            relative_points,
            gesture.throw_indices,
            gesture.curves,
        )
        if gesture_key in checked_keys:
            continue
        checked_keys.add(gesture_key)
        rehearsal_counts[gesture.place] += 1
        if gesture.place not in singular_places and (message := _aim_warning(player_key, gesture)):
            singular_places.add(gesture.place)
            collector.error("W312", message, gesture.place)
        if player_key.travel is None:
            continue
        swing_text = ""
        if gesture.throw_indices:
            thrown_low, thrown_high, thrown_instant = _free_range(piece, player_key, gesture)
            if thrown_low < low_position or thrown_high > high_position:
                swing_text = f"between {_throw_bounds(gesture, thrown_instant)} the free key swings"
            low_position, high_position = (
                min(low_position, thrown_low),
                max(high_position, thrown_high),
            )
        excess = max(position_min - low_position, high_position - position_max)
        if excess > max(_TRAVEL_TOLERANCE, farthest_by_place.get(gesture.place, (0.0,))[0]):
            farthest_by_place[gesture.place] = (
                excess,
                *_travel_message(player_key, gesture, low_position, high_position, swing_text),
            )
    for place, (_, message, help_text) in farthest_by_place.items():
        collector.error("E307", message, place, help=help_text)


def _travel_limits(key: Key) -> tuple[float, float]:
    """Both ends of a key's travel as the piece sees them; infinite without a travel."""
    position_min, position_max = key.travel or (-math.inf, math.inf)
    return position_min * key.reach, position_max * key.reach


def _travel_message(
    player_key: Key,
    gesture: StagedGesture,
    low_position: float,
    high_position: float,
    swing_text: str,
) -> tuple[str, str]:
    assert player_key.travel is not None
    is_low = (
        player_key.travel[0] * player_key.reach - low_position
        > high_position - player_key.travel[1] * player_key.reach
    )
    farthest_position = (low_position if is_low else high_position) / player_key.reach
    travel_text = f"{player_key.travel[0] * 1e3:g}mm..{player_key.travel[1] * 1e3:g}mm"
    message = (
        f"{quote(gesture.name)}: {swing_text or 'its path goes'} to "
        f"{farthest_position * 1e3:.1f} mm, outside "
        f"the travel of key {quote(player_key.name)} ({travel_text})"
    )
    return message, _travel_advice(
        gesture,
        _travel_limits(player_key),
        (low_position, high_position),
        is_throw=bool(swing_text),
    )


def _travel_advice(
    gesture: StagedGesture,
    travel_limits: tuple[float, float],
    reached_positions: tuple[float, float],
    *,
    is_throw: bool,
) -> str:
    if is_throw:
        return "write `smooth` instead of `throw` to keep the key on a path"
    position_min, position_max = travel_limits
    if (
        gesture.positions
        and min(gesture.positions) >= position_min - _TRAVEL_TOLERANCE
        and max(gesture.positions) <= position_max + _TRAVEL_TOLERANCE
    ):
        return (
            "write a `hold` at the turning point, or more time, "
            "against the overshoot of the smooth path"
        )
    # A take, or points that lie outside themselves.
    limits_and_reached = zip(travel_limits, reached_positions, strict=True)
    factors = [limit / x for limit, x in limits_and_reached if x != 0.0 and abs(x) > abs(limit)]
    factor = math.floor(100.0 * min(factors, default=0.0)) / 100.0
    if 0.0 < factor < 1.0:
        return f"write `do: [scale {factor:g}]`, or a key with more `travel`"
    return "write positions within the travel, or a key with more `travel`"


def _free_range(
    piece: Piece, player_key: Key, gesture: StagedGesture
) -> tuple[float, float, float]:
    """Lowest and highest position of the free key, and the instant of the farthest one [s after the
    start].

    A long gesture is rehearsed at a lower rate, because every frame of it is computed.
    """
    duration = gesture.stop - gesture.start
    rate = min(piece.rate, max(_FRAMES_MAX / max(duration, 1.0), _rehearsal_rate(player_key)))
    while rate < piece.rate:
        try:
            return _rehearsed_range(player_key, gesture, rate, piece.seed)
        except _core.EngineError:  # too low for the key, or for another throw of the gesture
            rate = min(piece.rate, 2.0 * rate)
    return _rehearsed_range(player_key, gesture, piece.rate, piece.seed)


def _rehearsal_rate(key: Key) -> float:
    natural_frequency = _natural_frequency(key)
    return (
        _RATE_HZ_MIN
        if natural_frequency is None
        else _STEPS_PER_PERIOD * natural_frequency / (2.0 * math.pi)
    )


def _rehearsed_range(
    player_key: Key, gesture: StagedGesture, rate: float, seed: int
) -> tuple[float, float, float]:
    import numpy as np

    assembly = Assembly(seed=seed)
    assembly.add_part(player_key.name, player_key.modules, reach=player_key.reach)
    assembly.add_links(player_key.name, player_key.modules, reach=player_key.reach)
    network, struck_mat = assembly.network, assembly.mats[player_key.name, player_key.struck]
    network.listen("key", positions=[(struck_mat, 1, 1.0)])
    timeline = _core.Timeline(network, rate)
    key_index = timeline.key(player_key.name, struck_mat)
    # Time to reach the first point, wherever it is.
    lead_seconds = 0.05
    instants = [instant - gesture.start + lead_seconds for instant in gesture.instants]
    timeline.gesture(key_index, instants, list(gesture.positions), gesture.curves)
    simulation = _core.Simulation(network, timeline)
    start_frame, stop_frame = int(lead_seconds * rate), int(instants[-1] * rate) + 1
    simulation.process(np.zeros((start_frame, 1)))
    lowest, highest = (math.inf, 0), (-math.inf, 0)
    for first_frame in range(start_frame, stop_frame, _BLOCK_FRAMES):
        frame_block = np.zeros((min(_BLOCK_FRAMES, stop_frame - first_frame), 1))
        simulation.process(frame_block)
        lowest_index, highest_index = int(frame_block.argmin()), int(frame_block.argmax())
        lowest = min(
            lowest, (float(frame_block[lowest_index, 0]), first_frame + lowest_index - start_frame)
        )
        if frame_block[highest_index, 0] > highest[0]:
            highest = (
                float(frame_block[highest_index, 0]),
                first_frame + highest_index - start_frame,
            )
    farthest = highest if highest[0] > -lowest[0] else lowest
    return lowest[0], highest[0], farthest[1] / rate


def _throw_bounds(gesture: StagedGesture, instant: float) -> str:
    """The two points of the throw during which an instant falls: `0.125 s and 0.375 s`."""
    for throw_index in gesture.throw_indices:
        begin, end = (
            gesture.instants[point_index] - gesture.start
            for point_index in (throw_index - 1, throw_index)
        )
        if begin <= instant <= end + 1e-3:
            return f"{begin:.3f} s and {end:.3f} s"
    return "its points"


def _aim_warning(player_key: Key, gesture: StagedGesture) -> str | None:
    natural_frequency = _natural_frequency(player_key)
    if natural_frequency is None:
        return None
    for throw_index in gesture.throw_indices:
        throw_seconds = gesture.instants[throw_index] - gesture.instants[throw_index - 1]
        if (
            abs(math.sin(natural_frequency * throw_seconds)) < _AIM_SINE_MIN
            and natural_frequency * throw_seconds > math.pi / 2
        ):
            half_period = math.pi / natural_frequency
            return (
                f"{quote(gesture.name)}: a throw (one strike, then free "
                f"motion) of {throw_seconds:.3f} s on key "
                f"{quote(player_key.name)} lasts nearly a multiple of half the period of the key "
                f"({half_period:.3f} s), so the strike would be very strong; write a shorter "
                "or longer "
                "throw"
            )
    return None


def _natural_frequency(player_key: Key) -> float | None:
    """ω of a key that is one underdamped CEL [rad/s], used in a warning only, so its last bit does
    not matter.
    """
    if len(player_key.modules) != 1 or player_key.modules[0].kind != "CEL":
        return None
    cel_fields = player_key.modules[0].fields
    if cel_fields.get("f"):
        return 2.0 * math.pi * float(cel_fields["f"])
    k, z, m = (
        float(cel_fields.get("K") or 0.0),
        float(cel_fields.get("Z") or 0.0),
        float(cel_fields["M"]),
    )
    frequency_squared = k / m - (z / (2.0 * m)) ** 2
    return math.sqrt(frequency_squared) if frequency_squared > 0.0 else None
