"""The takes by which a key is measured, after the ladder has found the force that it can take."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from . import excitation
from .gesture import TICKS_MIN
from .ladder import SAFETY_ENDS, TICK_RATE, Guide, Ladder, TakeEnded, gesture_of_take, push, settle
from .parameters import INDEX

if TYPE_CHECKING:
    from collections.abc import Callable

    from ergon import _core

    from .gesture import Floats, Gesture

KINDS = ("strikes", "rain", "held-out")
HELD_OUT_DURATION = 8.0  # s
_QUICK_SHARES = {"strikes": 0.5, "rain": 0.8}  # of the force: what is quick
_EXCURSION_RATIO_MIN, _EXCURSION_RATIO_TARGET = (
    0.4,
    0.5,
)  # of half the travel: enough, by the rough key too; what is aimed at
_RUNG_DURATION, _RUNGS_MAX = 1.0, 8  # s; until such a take is as strong as the key bears
_FORCE_SHARE_MAX = 0.9  # of the force
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
    return HELD_OUT_DURATION if path is None else len(path) / TICK_RATE


def record(
    ladder: Ladder,
    kind: str,
    duration: float,
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
    axis, takes, seconds_left = ladder.axis, [], duration
    guide = ladder.guide if ladder.needs_guide else ladder.guide.without_guide
    force = _bearable_force(ladder, kind, guide, seed, path)
    for part_number in range(1, _PARTS_MAX + 1):
        forces = _take_forces(ladder, kind, seconds_left, force, seed + part_number, path)
        forces_sent, n_still = excitation.with_still_beginning(forces, TICK_RATE)
        settle(axis, ladder.guide)
        excited = push(
            axis,
            forces_sent,
            guide,
            n_still,
            record_target(kind, part_number),
            accepts_safety_ends=True,
        )
        n_ticks = excited.sent().size
        if n_ticks >= max(TICKS_MIN, n_still + TICK_RATE) or excited.end == "done":
            takes.append(Take(kind, part_number, gesture_of_take(excited)))
            seconds_left -= (n_ticks - n_still) / TICK_RATE
        if excited.end not in SAFETY_ENDS or seconds_left < 1.0:
            break
        force *= _FORCE_REDUCTION
    settle(axis, ladder.guide)
    if not takes:
        raise TakeEnded(excited.end)
    return takes


def _bearable_force(
    ladder: Ladder, kind: str, guide: Guide, seed: int, path: Floats | None
) -> float:
    """The force of such a take that the key can take [N], found by rungs as on the ladder."""
    axis, force_max = ladder.axis, _FORCE_SHARE_MAX * ladder.axis.request_max
    force = min(force_max, 0.5 * ladder.force)
    for rung in range(_RUNGS_MAX):
        forces = _take_forces(ladder, kind, _RUNG_DURATION, force, seed + 100 + rung, path)
        settle(axis, ladder.guide)
        excited = push(axis, forces, guide, accepts_safety_ends=True)
        if excited.end != "done" or excited.braked().any():
            return _FORCE_REDUCTION * force
        excursion_ratio = (
            float(np.abs(excited.positions() - guide.centre).max()) / guide.half_travel
        )
        if excursion_ratio >= _EXCURSION_RATIO_MIN or force >= force_max:
            break
        force = min(
            force_max, force * min(2.0, _EXCURSION_RATIO_TARGET / max(excursion_ratio, 1e-6))
        )
    return force


def _take_forces(
    ladder: Ladder, kind: str, duration: float, force: float, seed: int, path: Floats | None
) -> Floats:
    """Forces of a take (n,) [N]."""
    n_ticks, rng, parameters = (
        round(duration * TICK_RATE),
        np.random.default_rng(seed),
        ladder.rough_parameters,
    )
    excursion_max = _EXCURSION_RATIO_MIN * ladder.guide.half_travel
    guided_parameters = parameters.copy()
    if ladder.needs_guide:
        stiffness, damping = ladder.guide.guide_spring_damper
        guided_parameters[INDEX["stiffness"]] += stiffness
        guided_parameters[INDEX["damping"]] += damping
    if kind == "held-out" and path is not None:
        path_positions = np.concatenate([path, np.full(max(0, n_ticks - len(path)), path[-1])])[
            :n_ticks
        ]
        forces = excitation.forces_along_path(
            path_positions, parameters, TICK_RATE, excursion_max, force
        )
    elif kind == "held-out":
        forces = excitation.knocks(parameters, TICK_RATE, duration, excursion_max, force)
    else:
        quick_forces = (
            excitation.rain(n_ticks, rng)
            if kind == "rain"
            else excitation.strikes(n_ticks, TICK_RATE, rng)
        )
        forces = force * excitation.mix_with_strokes(
            n_ticks, TICK_RATE, rng, quick_forces, _QUICK_SHARES[kind]
        )
    return excitation.scaled_to_reach(forces, TICK_RATE, guided_parameters, excursion_max)
