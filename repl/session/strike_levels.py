"""Levels of strikes in a session: the ratio that scales the impulses of each, 0 in silence."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ergon.repl.session.journal import JournalEvent
    from ergon.scores.reading.piece import Piece

_NUMBERED_PATTERN = re.compile(r"(.+)-[0-9]+")  # name of strikes that continue others: NAME-NUMBER


@dataclass(frozen=True, slots=True)
class StrikeLevels:
    """Gains as ratios, and which strikes are muted or on solo, by the names of strikes."""

    gains: Mapping[str, float] = field(default_factory=dict)
    muted: frozenset[str] = frozenset()
    solo: frozenset[str] = frozenset()

    def __bool__(self) -> bool:
        """Whether any strikes have a level of their own."""
        return bool(self.gains or self.muted or self.solo)

    def level_key(self, strikes_name: str) -> str:
        """The name under which strikes have their level: that of the first of a numbered row."""
        base_name = unnumbered(strikes_name)
        return (
            base_name
            if not self._has_level(strikes_name) and self._has_level(base_name)
            else strikes_name
        )

    def ratio(self, strikes_name: str) -> float:
        """The ratio that scales impulses."""
        level_key = self.level_key(strikes_name)
        is_heard = level_key not in self.muted and (not self.solo or level_key in self.solo)
        return self.gains.get(level_key, 1.0) if is_heard else 0.0

    def scaled(self, piece: Piece) -> Piece:
        """The piece whose strikes have these levels; the same object if none has one."""
        if not self:
            return piece
        ratios = [self.ratio(strikes.name) for strikes in piece.strikes]
        scaled_strikes = tuple(
            strikes if ratio == 1.0 else replace(strikes, session_gain=ratio)
            for strikes, ratio in zip(piece.strikes, ratios, strict=True)
        )
        return replace(piece, strikes=scaled_strikes)

    def _has_level(self, strikes_name: str) -> bool:
        return strikes_name in self.gains or strikes_name in self.muted or strikes_name in self.solo


def unnumbered(name: str) -> str:
    """The name without the number that a session adds: `rain` for `rain-2`."""
    number_match = _NUMBERED_PATTERN.fullmatch(name)
    return name if number_match is None else number_match[1]


def levels_fields(strike_levels: StrikeLevels) -> dict[str, object]:
    """The journal fields for levels; none if there are no levels."""
    if not strike_levels:
        return {}
    return {
        "strike_gains": dict(strike_levels.gains),
        "muted_strikes": sorted(strike_levels.muted),
        "solo_strikes": sorted(strike_levels.solo),
    }


def read_levels(event: JournalEvent) -> StrikeLevels:
    """The levels in a journal's event. Raises JournalError."""
    muted_strikes, solo_strikes = event.name_set("muted_strikes"), event.name_set("solo_strikes")
    return StrikeLevels(event.mapping("strike_gains", float), muted_strikes, solo_strikes)
