"""Real hands that are led: along what another player's part does with its key, as it goes on."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ergon._core import EngineError
from ergon.live.perform import GUIDE
from ergon.repl.session.engine import Led
from ergon.repl.session.version import Lead, NotTakenError
from ergon.scores.staging.live import leading

if TYPE_CHECKING:
    from ergon.repl.language.commands import Guide
    from ergon.repl.session.commits import Commits
    from ergon.repl.session.running import Running

# A path is made for so long, and made again when half of it is left [s]: some hundredths of a
# second of work.
_PATH = 6.0
# A hand is let go where nothing is played for longer than this [s], and taken up before it is.
_REST = 1.0
_BEFORE = 0.2
# What the first path may take to make; later ones take what the slowest of the last took [s].
_MAKING = 0.1
_FORGET = 0.8


def lead_of(command: Guide) -> Lead:
    """What a line asks for, as shares of what every key is known to bear. Raises NotTakenError."""
    assert command.by is not None
    stiffest, thickest = GUIDE
    stiffness = stiffest if command.stiffness is None else command.stiffness
    if stiffness > stiffest:
        raise NotTakenError(f"a hand is led by {stiffest:g}N/m at most: it can hold against that")
    share = stiffness / stiffest
    viscosity = share * thickest if command.viscosity is None else command.viscosity
    if viscosity > thickest:
        raise NotTakenError(f"a hand is led through {thickest:g}Ns/m at most")
    return Lead(command.by, share, viscosity / thickest)


def allow(command: Guide, commits: Commits) -> None:
    """Refuse a lead of or by who is not there. Raises NotTakenError."""
    player, by = command.player, command.by
    if player not in commits.real:
        raise NotTakenError(f"{player}'s hand is not real here: --live puts one on its key")
    if by is None:
        return
    if by in commits.real:
        raise NotTakenError(f"{by}'s hand is real: a written part leads")
    if player in commits.engine.look().away:
        raise NotTakenError(f"{player}'s key is not there: it can be led when it is back")


@dataclass(slots=True)
class Leads:
    """Keeps the engine told of where the hands of the version that plays are led."""

    commits: Commits
    _on: Running | None = None  # what the paths are of
    _again: int = 0  # the frame at which they are made again
    _led: frozenset[str] = frozenset()
    _ticket: int | None = None
    _took: float = field(default=_MAKING)

    def due(self) -> tuple[int, Mapping[str, Led]] | None:
        """From which frame on which hands are led otherwise than before; None: as before."""
        running, commits = self.commits.running, self.commits
        players = running.version.piece.players
        leads = {
            player: lead
            for player, lead in running.version.leads.items()
            if player in commits.real and {player, lead.by} <= players.keys()
        }
        is_over = bool(leads) and commits.engine.frame >= self._again
        if running is self._on and not is_over:
            return None
        self._on = running
        if not leads and not self._led:
            return None
        began = time.perf_counter()
        at, rate, every = commits.first(2.0 * self._took), commits.rate, commits.engine.every
        ticks = range(at // every, at // every + int(_PATH * rate) // every)
        made = dict(self._let_go(leads))
        made |= {
            player: _led(running, player, lead, ticks, every) for player, lead in leads.items()
        }
        self._again = at + int(_PATH / 2 * rate)
        self._led = frozenset(leads)
        self._took = max(time.perf_counter() - began, _FORGET * self._took)
        return at, made

    def _let_go(self, leads: Mapping[str, Lead]) -> Iterator[tuple[str, Led]]:
        import numpy as np

        for player in self._led - leads.keys():
            yield player, Led(np.zeros(1), ((0, 0.0, 0.0),))

    def hand(self, at: int, made: Mapping[str, Led]) -> None:
        """Tell the engine; where it hears too much at once it is told again."""
        try:
            self._ticket = self.commits.engine.lead(at, made)
        except EngineError:
            self._on = None

    def late(self, ticket: int) -> None:
        """A ticket came too late: what it was for is made again."""
        if ticket == self._ticket:
            self._on = None


def _led(running: Running, player: str, lead: Lead, ticks: range, every: int) -> Led:
    """Where a player is led in the next ticks: no farther than its own key goes."""
    import numpy as np

    piece, period = running.version.piece, every / running.stage.rate
    path, plays = leading(piece, lead.by, running.spans, every, ticks)
    travel = piece.keys[piece.players[player].key].travel
    if travel is not None:
        np.clip(path, *travel, out=path)
    begins = ticks.start * period
    spans = [
        (round((start - _BEFORE - begins) / period), round((stop - begins) / period))
        for start, stop in _joined(plays)
    ]
    shares = lead.stiffness, lead.viscosity
    # Where no other path comes in time it ends.
    steps = [(0, 0.0, 0.0), *_steps(spans, shares), (len(path), 0.0, 0.0)]
    first = sum(at <= 0 for at, *_ in steps) - 1
    now = (0, *steps[first][1:])
    return Led(path, (now, *(step for step in steps[first + 1 :] if step[0] <= len(path))))


def _joined(plays: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Stretches with no long rest in them."""
    found: list[tuple[float, float]] = []
    for start, stop in sorted(plays):
        if found and start - found[-1][1] <= _REST:
            found[-1] = found[-1][0], max(stop, found[-1][1])
        else:
            found.append((start, stop))
    return found


def _steps(
    spans: Sequence[tuple[int, int]], shares: tuple[float, float]
) -> Iterator[tuple[int, float, float]]:
    for start, stop in spans:
        yield start, *shares
        yield stop, 0.0, 0.0
