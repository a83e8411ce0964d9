"""The takes by which a key is measured, after the ladder has found the force that it can take."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from . import excitation
from .gesture import TICKS_MIN
from .ladder import DOUBTS, TICK_RATE, Guide, Ladder, TakeEnded, gesture, push, settle
from .parameters import INDEX

if TYPE_CHECKING:
    from collections.abc import Callable

    from ergon import _core

    from .gesture import Floats, Gesture

KINDS = ("strikes", "rain", "held-out")
HELD_OUT = 8.0  # s
_SHARES = {"strikes": 0.5, "rain": 0.8}  # of the force: what is quick
_AMPLITUDE_SHARE, _TARGET_SHARE = (
    0.4,
    0.5,
)  # of half the travel: enough, by the rough key too; what is aimed at
_RUNG, _RUNGS_MAX = 1.0, 8  # s; until such a take is as strong as the key bears
_FORCE_SHARE = 0.9  # of the force
_FORCE_REDUCTION = 0.7  # after a safety stage held the axis at zero
_PARTS_MAX = 6


@dataclass(frozen=True, slots=True)
class Take:
    """A take: its kind, its number if a safety stage cut it into parts, its gesture."""

    kind: str
    part: int
    gesture: Gesture


def held_out_duration(path: Floats | None) -> float:
    """The duration of a held-out gesture [s], along a path by ticks or with knocks."""
    return HELD_OUT if path is None else len(path) / TICK_RATE


def record(
    ladder: Ladder,
    kind: str,
    seconds: float,
    record_target: Callable[[str, int], _core.RecordTarget | None],
    seed: int = 0,
    path: Floats | None = None,
) -> list[Take]:
    """Takes of a kind that last so long [s] in all; `record_target` returns the file of each, or
    None.

    `path` (n,) [m], by ticks, replaces the knocks of a held-out gesture.

    If a safety stage holds the axis at zero, the part recorded so far counts, and a weaker part
    follows.
    Raises TakeEnded.
    """
    device_axis, takes, seconds_left = ladder.axis, [], seconds
    guide = ladder.guide if ladder.needs_guide else ladder.guide.off
    force = _bearable_force(ladder, kind, guide, seed, path)
    for part_number in range(1, _PARTS_MAX + 1):
        forces = _stream(ladder, kind, seconds_left, force, seed + part_number, path)
        framed_forces, still_ticks = excitation.framed(forces, TICK_RATE)
        settle(device_axis, ladder.guide)
        excited = push(
            device_axis,
            framed_forces,
            guide,
            still_ticks,
            record_target(kind, part_number),
            forgiven=True,
        )
        n = excited.sent().size
        if n >= max(TICKS_MIN, still_ticks + TICK_RATE) or excited.end == "done":
            takes.append(Take(kind, part_number, gesture(excited)))
            seconds_left -= (n - still_ticks) / TICK_RATE
        if excited.end not in DOUBTS or seconds_left < 1.0:
            break
        force *= _FORCE_REDUCTION
    settle(device_axis, ladder.guide)
    if not takes:
        raise TakeEnded(excited.end)
    return takes


def _bearable_force(
    ladder: Ladder, take_kind: str, guide: Guide, seed: int, path: Floats | None
) -> float:
    """The force of such a take that the key can take [N], found by rungs as on the ladder."""
    axis, force_limit = ladder.axis, _FORCE_SHARE * ladder.axis.request_max
    force = min(force_limit, 0.5 * ladder.force)
    for rung in range(_RUNGS_MAX):
        forces = _stream(ladder, take_kind, _RUNG, force, seed + 100 + rung, path)
        settle(axis, ladder.guide)
        excited = push(axis, forces, guide, forgiven=True)
        if excited.end != "done" or excited.braked().any():
            return _FORCE_REDUCTION * force
        travel_share = float(np.abs(excited.positions() - guide.centre).max()) / guide.half
        if travel_share >= _AMPLITUDE_SHARE or force >= force_limit:
            break
        force = min(force_limit, force * min(2.0, _TARGET_SHARE / max(travel_share, 1e-6)))
    return force


def _stream(
    ladder: Ladder,
    take_kind: str,
    take_seconds: float,
    push_force: float,
    seed: int,
    path: Floats | None,
) -> Floats:
    """Forces of a take (n,) [N]."""
    n, chance, key_row = round(take_seconds * TICK_RATE), np.random.default_rng(seed), ladder.rough
    reach_metres = _AMPLITUDE_SHARE * ladder.guide.half
    guided_row = key_row.copy()
    if ladder.needs_guide:
        stiffness, damping = ladder.guide.guide
        guided_row[INDEX["stiffness"]] += stiffness
        guided_row[INDEX["damping"]] += damping
    if take_kind == "held-out" and path is not None:
        path_positions = np.concatenate([path, np.full(max(0, n - len(path)), path[-1])])[:n]
        stream = excitation.forces_along_path(
            path_positions, key_row, TICK_RATE, reach_metres, push_force
        )
    elif take_kind == "held-out":
        stream = excitation.knocks(key_row, TICK_RATE, take_seconds, reach_metres, push_force)
    else:
        quick = (
            excitation.rain(n, chance)
            if take_kind == "rain"
            else excitation.strikes(n, TICK_RATE, chance)
        )
        stream = push_force * excitation.mixed(n, TICK_RATE, chance, quick, _SHARES[take_kind])
    return excitation.scaled_to_reach(stream, TICK_RATE, guided_row, reach_metres)
