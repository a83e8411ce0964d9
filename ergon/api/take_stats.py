"""Statistics of what hands did in a recording: movement, lost ticks, force and work."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from .errors import OptionError
from .parts import frequency_option

if TYPE_CHECKING:
    from ergon import _core
    from ergon.scores.gesture.movement import MovementStats

_NEW_POSITION_FLAG = 1  # bit in a recording's flags


@dataclass(frozen=True, slots=True, kw_only=True)
class TakeStatsOptions:
    """Which hands are described; without names, all.

    Speed and acceleration are those below the frequency `cutoff`, a number [Hz] or a text such
    as "20Hz".
    """

    hands: Sequence[str] = ()
    cutoff: float | str = 20.0


@dataclass(frozen=True, slots=True)
class ForceStats:
    """Forces [N] that a key felt from the piece, and the energy [J] that went through the hand.

    `given` is the energy from the hand to the piece, `taken` that from the piece to the hand,
    each added up tick by tick; `sent` is the greatest force that was sent to the device.
    """

    peak: float
    rms: float
    given: float
    taken: float
    sent: float


@dataclass(frozen=True, slots=True)
class HandStats:
    """Figures of one hand of a recording.

    `n_ticks` counts the ticks in the recording, `n_lost` those that are missing in between,
    `n_held` those without a new position; None if the recording does not say. `movement` is None
    with less than two ticks, `force` if no force was felt or sent.
    """

    hand: str
    n_ticks: int
    n_lost: int
    n_held: int | None
    movement: MovementStats | None
    force: ForceStats | None


def take_stats(path: str | Path, options: TakeStatsOptions | None = None) -> tuple[HandStats, ...]:
    """Statistics of the hands of a recording, a .take file. Of a damaged file the intact part
    counts.

    Raises TakeError where it cannot be read, and OptionError.
    """
    from ergon import _core
    from ergon.scores.gesture.take_file import TakeError

    options = options or TakeStatsOptions()
    cutoff = frequency_option("cutoff", options.cutoff)
    try:
        recording = _core.read_recording(Path(path))
    except OSError as error:
        raise TakeError(error.strerror or str(error), Path(path)) from None
    except _core.EngineError as error:
        raise TakeError(str(error), Path(path)) from None
    axis_names = recording.names
    for name in options.hands:
        if name not in axis_names:
            raise OptionError(
                "hands", f"there is no hand {name!r}; there are {', '.join(axis_names)}"
            )
    hand_names = options.hands or axis_names
    return tuple(_hand_stats(recording, axis_names.index(name), cutoff) for name in hand_names)


def _hand_stats(recording: _core.Recording, axis_index: int, cutoff: float) -> HandStats:
    from ergon.exchange.recording import instants
    from ergon.scores.gesture.movement import movement_stats

    ticks = recording.ticks()
    n_ticks = len(ticks)
    has_new_position = recording.flags()[:, axis_index] & _NEW_POSITION_FLAG != 0
    return HandStats(
        recording.names[axis_index],
        n_ticks,
        int(ticks[-1] - ticks[0]) + 1 - n_ticks if n_ticks else 0,
        int((~has_new_position).sum()) if has_new_position.any() else None,
        movement_stats(instants(recording), recording.positions()[:, axis_index], cutoff)
        if n_ticks >= 2
        else None,
        _force_stats(recording, axis_index),
    )


def _force_stats(recording: _core.Recording, axis_index: int) -> ForceStats | None:
    import numpy as np

    positions, tick_forces = recording.positions()[:, axis_index], recording.forces()[:, axis_index]
    sent_forces = np.abs(recording.sent()[:, axis_index].astype(float))
    if not tick_forces.any() and not sent_forces.any():
        return None
    # The hand gives energy where it moves against the force of the piece.
    energy_steps = -0.5 * (tick_forces[1:] + tick_forces[:-1]) * np.diff(positions)
    return ForceStats(
        float(np.abs(tick_forces).max()),
        float(np.sqrt(np.mean(tick_forces**2))),
        float(energy_steps[energy_steps > 0].sum()),
        float(np.abs(energy_steps[energy_steps < 0]).sum()),
        float(sent_forces.max()),
    )
