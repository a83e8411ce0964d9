"""Results that successive stages of nearly the same piece share, so that past events cost
little.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from ergon import _core
from ergon.notation.clock.meter import Meter
from ergon.notation.clock.tempo import TempoMap
from ergon.notation.text.errors import TextError
from ergon.scores.reading.piece import Piece, Strikes
from ergon.scores.staging.hands import LineAndBeats
from ergon.scores.staging.known_automation import KnownAutomation
from ergon.scores.staging.not_over import UnfinishedLines

_OVER_MARGIN_BEATS = 1e-6  # margin [beats] for strikes to count as over


@dataclass(slots=True)
class KnownStrikes:
    """Keeps the strikes that are not over."""

    _meters: list[tuple[float, int, Meter]] = field(default_factory=list)
    _unfinished_strikes: UnfinishedLines[tuple[Strikes]] = field(default_factory=UnfinishedLines)

    def unfinished(self, piece: Piece, beat: float) -> Sequence[Strikes]:
        """The strikes of a piece that may fall on a beat or later."""
        tempo = piece.tempo_map
        if beat == -math.inf:
            return piece.strikes
        if (meters := tempo.bars.changes()) != self._meters:  # the end beats depend on the meters
            self._meters = meters
            self._unfinished_strikes.forget()
        beat_before = beat - _OVER_MARGIN_BEATS
        strikes_left, _ = self._unfinished_strikes.select(
            (piece.strikes,),
            beat_before,
            lambda line: _end_beat(line[0], tempo) < beat_before,
            lambda _: None,
        )
        return [strikes for (strikes,) in strikes_left]


def _end_beat(strikes: Strikes, tempo: TempoMap) -> float:
    """The beat before which strikes fall; infinite where it is not written in bars and beats."""
    until_position = strikes.until
    if (
        until_position is None
        or until_position.mark is not None
        or until_position.plus.seconds
        or strikes.has_rounds
    ):
        return math.inf  # a round may begin before this beat and end after it
    try:
        return tempo.resolve(until_position)
    except TextError:
        return math.inf


@dataclass(slots=True)
class StageMemory:
    """The memory of a chain of stages, each of which takes over from the one before.

    `plan` is the last plan, of which the next reuses what it found about bodies and contacts.
    """

    automation: KnownAutomation = field(default_factory=KnownAutomation)
    strikes: KnownStrikes = field(default_factory=KnownStrikes)
    unfinished_lines: UnfinishedLines[LineAndBeats] = field(default_factory=UnfinishedLines)
    plan: _core.Plan | None = None
