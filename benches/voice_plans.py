"""Voices of an instrument in the engine: one score, one plan, one thread, and the mix."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benches.voice_cost import Voices, counted, evenness
from benches.voice_page import method
from benches.voice_scores import Instrument, score
from ergon.rendering.level import HIGHPASS_HZ
from ergon.scores.reading.load import load
from ergon.scores.staging.stage import Stage, stage

BLOCK = 256
_LENGTH, _START, _COUNTED = 3, 1.0, 2.0  # seconds of a score, before what is counted, and of that
_MAX_VOICES, _MAX_SHARE = 8, 0.5  # in a score, and the share of a core that these may take
_PLACE = Path(__file__).parent.parent / "scores" / "library" / "voices.yaml"


class Player:
    """Voices of a staged score. `times` holds the least processor time of each block [s]."""

    def __init__(self, staged: Stage, count: int) -> None:
        self._simulation, self._mixer = staged.simulation, staged.mixer(highpass=HIGHPASS_HZ)
        self._block = np.zeros((BLOCK, self._simulation.n_out))
        self._mixed = np.zeros((BLOCK, staged.n_channels))
        self._count, self._rate = count, staged.rate
        start, n_blocks = (int(part * staged.rate) // BLOCK for part in (_START, _COUNTED))
        self.times = np.full(start, np.inf)
        self._play()
        assert self._mixed.any(), "nothing sounds"
        self._begun = self._simulation.snapshot()
        self.times = np.full(n_blocks, np.inf)

    def _play(self) -> None:
        for i in range(len(self.times)):
            before = time.process_time()
            self._simulation.process(self._block)
            self._mixer.process(self._block, self._mixed)
            self.times[i] = min(self.times[i], time.process_time() - before)

    @property
    def voices(self) -> Voices:
        """What is counted."""
        run = counted(self._play, lambda: self._simulation.restore(self._begun))
        return Voices(self._count, len(self.times) * BLOCK / self._rate, run)

    def evenness(self) -> float:
        """The mean cost over that of the busiest tenth of a second."""
        return evenness(self.times, BLOCK / self._rate)


@dataclass(frozen=True, slots=True)
class Planned:
    """Voices of an instrument; modules and computed oscillators of one, and the method."""

    player: Player
    modules: int
    oscillators: int
    method: str


def plan(instrument: Instrument) -> Planned:
    """Plan as many voices as take half a core by the table of costs, at least one and at most
    eight.
    """
    single = _staged(instrument, 1)
    rows = single.plan.rows() if single.plan else []
    stated = sum(row.cost for row in rows)
    count = max(1, min(_MAX_VOICES, int(_MAX_SHARE / max(stated, 1e-9))))
    staged = single if count == 1 else _staged(instrument, count)
    moving = sum(row.n_mat for row in rows if row.what not in ("still", "unheard"))
    return Planned(
        Player(staged, count),
        single.network.n_mat + single.network.n_lia,
        moving - instrument.has_hammer,
        method(staged.plan.rows() if staged.plan else []),
    )


def stated_cost(instrument: Instrument) -> float:
    """What the plan of one voice states, as a share of a core of the reference machine."""
    planned = _staged(instrument, 1).plan
    return sum(row.cost for row in planned.rows()) if planned else 0.0


def _staged(instrument: Instrument, count: int) -> Stage:
    loaded = load(_PLACE, text=score(instrument, count, _LENGTH))
    assert loaded.piece is not None, f"{instrument.name}: {loaded.diagnostics}"
    return stage(loaded.piece, planned=True)
