"""The cost of a line late in an evening: two thousand lines over four hours, in virtual time."""

from __future__ import annotations

import gc
import itertools
import os
import random
import tempfile
from collections.abc import Iterator
from contextlib import closing
from itertools import islice
from pathlib import Path
from statistics import median

from benches.measure import Row
from benches.repl import hundred
from benches.typed_session import TICK, TypedSession
from ergon.repl.session.engine import EngineEvent, SteppedEngine

_LINES = 2_000
_SECONDS = 4 * 3600.0
# Between two looks of the session at its engine [s]: a line is handed over 0.3 s before it is due.
_LOOK = 0.25
_APART = 9.0  # [s] between measured lines: each has taken effect before the next
_TARGET = 1.3  # ratio of costs
_ROUNDS = 9  # of the measured lines
_ALONE = ("rest all", "p0 plays knock every 1")
# What is typed again and again: `m` and `n` are modules, `p` is a player, `k` a small number.
_EVENING = (
    "p{p} plays knock every {k}",
    "set bells.m{n}.K x1.{p}5 over 1bar",
    "gain bells -{k}dB",
    "p{p} plays knock every {k} do scale 0.9",
    "lfo bells.m{m}.K 0.8..1.2 period {k}bar",
    "rain strikes bells.m3 euclid 5 8 impulse 0.1mNs..0.3mNs",
    "set bells.b{m}.K x1.0{k}",
    "p{p} plays knock (knock knock) ~ every 1/2",
    "lfo bells.m{m}.K off",
    "rest rain",
    "bells.m1 notes A3 C4 E4 euclid 5 8",
    "link k3 bells.m{m} REF K=40N/m",
    "rest bells-m1",
    "set bells.m{n}.f x1.0{k} over 2bar",
    "rest p3",
    "remove {link}",
)
_OFTEN = 6  # rounds of these between those that are typed seldom
_SELDOM = ("keep 2bar as verse{i}", "scene verse{i} over 1bar", "tempo {t}")
_MEASURED = (
    "gain bells -3dB",
    "set bells.b7.K x1.01",
    "p1 plays knock every 2",
    "lfo bells.m49.K 0.8..1.2 period 1bar",
    "lfo bells.m49.K off",
    "link k3 bells.m48 REF K=40N/m",
    "remove {link}",
)


class _CountingEngine(SteppedEngine):
    """An engine that counts frames and takes changes, but computes no sample."""

    def pass_frames(self, n_frames: int) -> None:
        """Let frames pass."""
        stop = self.frame + n_frames
        while self._changes and self._changes[0][1].frame <= stop:
            ticket, change = self._changes.pop(0)
            self.frame = max(self.frame, change.frame)
            self._simulation = change.stage.simulation
            self._events.append(EngineEvent(self.frame, ticket))
        self.frame = stop


class _Evening(TypedSession[_CountingEngine]):
    """A session in virtual time, and what its lines cost."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, hundred(), _CountingEngine, margin=0.0)

    def typed(self, line: str) -> float:
        """Type a line; returns the processor time until its answer [ms]."""
        return self.answered(line.format(link=self._last_link()) if "{link}" in line else line)

    def _last_link(self) -> str:
        links = self.session.schedule.head.piece.instruments["links"]
        return f"links.{links.modules[-1].name}"

    def passes(self, seconds: float) -> None:
        """Let virtual time pass, as the session's own thread looks at it, only less often."""
        ticks = int(_LOOK * self.session.schedule.rate) // TICK
        for _ in range(round(seconds / _LOOK)):
            self.session.do_once()
            _ = self.session.scope
            self.engine.pass_frames(ticks * TICK)

    def size(self) -> tuple[int, int]:
        """Bytes of the journal, and of memory."""
        gc.collect()
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        return self.journal.stat().st_size, pages * os.sysconf("SC_PAGE_SIZE")


def _lines() -> Iterator[str]:
    """The lines of an evening without end."""
    drawn = random.Random(1)
    for number in itertools.count():
        m, n = drawn.randrange(20, 40), drawn.randrange(8, 20)
        for line in (*_EVENING, *(_SELDOM if number % _OFTEN == _OFTEN - 1 else ())):
            p, k, t = drawn.randrange(4), drawn.randint(1, 4), drawn.randint(60, 90)
            yield line if "{link}" in line else line.format(m=m, n=n, p=p, k=k, t=t, i=number)


def evening(count: int = _LINES, seconds: float = _SECONDS) -> list[Row]:
    """Processor time of the same lines at the end of an evening and in a fresh session, in turns;
    and what a line adds to the journal and to memory.
    """
    with tempfile.TemporaryDirectory() as late, tempfile.TemporaryDirectory() as early:
        old, fresh = _Evening(Path(late)), _Evening(Path(early))
        with closing(old.session), closing(fresh.session):
            old.typed("play")
            sizes = [old.size()]
            for number, line in enumerate(islice(_lines(), count), start=1):
                old.typed(line)
                old.passes(seconds / count)
                if number % (count // 4) == 0:
                    sizes.append(old.size())
            fresh.typed("play")
            first, last = _measured(fresh, old)
    what = f"of {count:,} lines over {seconds / 3600:g} virtual hours"
    return [_costs(what, first, last), _growth(what, sizes, count // 4)]


def _measured(fresh: _Evening, old: _Evening) -> tuple[dict[str, float], dict[str, float]]:
    """The median cost of each measured line in two sessions [ms], while one player plays. The
    sessions take turns, so that other load on the machine affects both alike.
    """
    sessions = (fresh, old)
    for line in _ALONE:
        for item in sessions:
            item.typed(line)
            item.passes(_APART)
    gc.collect()
    taken: tuple[dict[str, list[float]], dict[str, list[float]]] = ({}, {})
    for _ in range(_ROUNDS):
        for line in _MEASURED:
            for item, times in zip(sessions, taken, strict=True):
                item.passes(_APART)
                times.setdefault(line, []).append(item.typed(line))
    early, late = ({line: median(t) for line, t in times.items()} for times in taken)
    return early, late


def _costs(what: str, first: dict[str, float], last: dict[str, float]) -> Row:
    early, late = sum(first.values()) / len(first), sum(last.values()) / len(last)
    each = ", ".join(f"{line.split()[0]} {first[line]:.1f} and {last[line]:.1f}" for line in first)
    return Row(
        f"the same lines at the end of an evening {what} (target at most {_TARGET:g})",
        f"{late:.1f} ms of CPU time a line; in a fresh session and at the end: {each} ms",
        f"in a fresh session: {early:.1f} ms",
        late / early,
        "of the time in a fresh session",
        {"first_ms": early, "last_ms": late},
    )


def _growth(what: str, sizes: list[tuple[int, int]], n_lines: int) -> Row:
    (journal, memory), (last_journal, last_memory) = (
        [(b - a) / n_lines for a, b in zip(*pair, strict=True)] for pair in (sizes[:2], sizes[-2:])
    )
    return Row(
        f"what a line adds in an evening {what}",
        f"journal {last_journal:.0f} bytes, memory {last_memory / 1e3:.1f} kB in the last quarter",
        f"in the first quarter: {journal:.0f} bytes, {memory / 1e3:.1f} kB",
        None,
        "by what is resident",
        {"journal_bytes": last_journal, "memory_bytes": last_memory},
    )
