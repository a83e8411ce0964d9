"""The hardest strike on each MAT that a session may strike. The plan tries it, to choose how finely
contacts are computed.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from ergon import _core
    from ergon.instruments.assemble import Assembly
    from ergon.instruments.model import Target
    from ergon.scores.reading.piece import Piece, Strikes


class _Strike(NamedTuple):
    """An impulse [N·s] on a target, and how long it lasts [s]; None: as long as the engine says."""

    target: Target
    impulse: float
    contact_seconds: float | None


def put_trial_strikes(piece: Piece, assembly: Assembly, timeline: _core.Timeline) -> None:
    """Declare the hardest strikes of a piece to an open timeline: those that instruments say, or
    harder ones of the score.

    Parts that are bowed or pressed have none: a trial of strikes says nothing of friction.
    """
    hardest_by_mat: dict[int, _Strike] = {}
    for strike in _strikes(piece):
        if (strike.target.part, strike.target.module) not in assembly.mats:
            continue
        for mat in assembly.members(strike.target):
            if mat not in hardest_by_mat or abs(strike.impulse) > abs(hardest_by_mat[mat].impulse):
                hardest_by_mat[mat] = strike
    for mat, strike in hardest_by_mat.items():
        timeline.trial_strike(mat, strike.impulse, lasts=strike.contact_seconds)


def _strikes(piece: Piece) -> Iterator[_Strike]:
    drawn_names = {
        name
        for name, instrument in piece.instruments.items()
        if any(act.is_drawn for act in instrument.acts)
    }
    durations: dict[tuple[str, str], float | None] = {}
    for name, instrument in piece.instruments.items():
        for act in () if name in drawn_names else instrument.acts:
            for target in act.targets:
                durations[target.part, target.module] = act.lasts
                yield _Strike(target, act.reach.hard, act.lasts)
    for strikes in piece.strikes:
        for target, impulse in _impulses(strikes):
            if target.part not in drawn_names:
                act_lasts = durations.get((target.part, target.module))
                contact_seconds = act_lasts if strikes.lasts is None else strikes.lasts
                yield _Strike(target, impulse, contact_seconds)


def _impulses(strikes: Strikes) -> Iterator[tuple[Target, float]]:
    """The hardest impulse [N·s] of strikes on each of their targets."""
    gain = max(1.0, strikes.session_gain or 1.0)
    for hit in strikes.hits:
        for target in hit.to:
            yield target, gain * hit.level.impulse(hit.impulse_range, max)
    if strikes.levels is not None:
        for target in strikes.to:
            impulse_range = strikes.impulse_ranges.get(target.part)
            for level in strikes.levels.steps:
                if impulse_range is not None or not level.is_strength:
                    yield target, gain * level.impulse(impulse_range, max)
    if strikes.mass is not None and strikes.speed is not None:
        for target in strikes.to:
            yield target, gain * strikes.mass * strikes.speed
