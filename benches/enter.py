"""From Enter to effect: the processor time of a line, and the ticks until it is heard."""

from __future__ import annotations

import gc
import json
import math
import tempfile
import time
from contextlib import closing
from pathlib import Path
from statistics import median

from benches.measure import Row
from benches.repl import hundred
from benches.typed_session import TICK, TypedSession
from ergon.repl.session.engine import SteppedEngine
from ergon.repl.session.version import piece_of
from ergon.scores.edits.texts import Texts
from ergon.scores.staging.stage import stage

_MARGIN = 0.006  # [s] as `ergon repl` has it
_ROUNDS = 7
_BETWEEN = 0.5  # [s] of sound between two lines
# A line of each kind, with what undoes it.
_FADERS = ("gain bells -3dB now", "mute bells now", "unmute bells now", "hush now")
_VALUES = (
    "set bells.b7.K x1.01 now",
    "set bells.m3.f x1.001 now",
    "tempo 61 now",
    "tempo 60 now",
)
_STRUCTURE = (
    "p1 plays knock every 2 now",
    "link k3 bells.m48 REF K=40N/m now",
    "remove links.ref-1 now",
    "new = bells transpose 2st now",
    "remove new now",
)
_KINDS = {
    "a level or an end (gain, mute, hush)": (_FADERS, 5.0),
    "a value (set, tempo)": (_VALUES, 5.0),
    "structure (plays, link, an instrument of 100 modules)": (_STRUCTURE, 15.0),
}


class _Typed(TypedSession[SteppedEngine]):
    """A session in virtual time that plays; it measures each line."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, hundred(), SteppedEngine, margin=_MARGIN)

    def passes(self, seconds: float) -> None:
        """Let virtual time pass, tick by tick, as the threads of a session see it."""
        for _ in range(math.ceil(seconds * self.session.schedule.rate / TICK)):
            self.session.do_once()
            _ = self.session.scope
            self.engine.process(TICK)

    def typed(self, line: str) -> tuple[float, float]:
        """The processor time until the answer [ms], and the ticks until the line takes effect."""
        frame = self.engine.frame
        spent = self.answered(line)
        self.passes(_BETWEEN)
        rows = [json.loads(row) for row in self.journal.read_text("utf-8").splitlines()]
        (commit,) = [row for row in rows if row["event"] == "commit"][-1:]
        return spent, (commit["frame"] - frame) / TICK


def _full_stage_ms() -> float:
    """The processor time of reading and staging the whole piece [ms], which each line once took."""
    texts = Texts("enter.yaml", hundred())
    begun = time.thread_time()
    stage(piece_of(texts), planned=True)
    return 1e3 * (time.thread_time() - begun)


def enter() -> list[Row]:
    """Lines that act now, in a piece of a hundred modules that plays; beside them the whole piece
    read and staged.
    """
    costs: dict[str, list[float]] = {kind: [] for kind in _KINDS}
    ticks: dict[str, list[float]] = {kind: [] for kind in _KINDS}
    complete: list[float] = []
    with tempfile.TemporaryDirectory() as name:
        typed = _Typed(Path(name))
        with closing(typed.session) as session:
            for line in ("play", "p0 plays knock every 1"):
                session.submit(line)
            typed.passes(1.0)
            gc.collect()
            gc.freeze()
            for number in range(_ROUNDS):
                complete.append(_full_stage_ms())
                for kind, (lines, _) in _KINDS.items():
                    for line in lines:
                        spent, until = typed.typed(line)
                        if number:  # the first round warms up
                            costs[kind].append(spent)
                            ticks[kind].append(until)
            gc.unfreeze()
    reference = median(complete)
    return [
        Row(
            f"from Enter to effect: {kind}, in 100 modules",
            f"{median(costs[kind]):.1f} ms of CPU time, at most {max(costs[kind]):.1f} ms; in "
            f"effect after at most {max(ticks[kind]):.0f} ticks of {TICK} frames",
            f"the whole piece read and staged: {reference:.1f} ms (target: {target:g} ms)",
            median(costs[kind]) / reference,
            "of the time of the whole piece",
            {
                "p50_ms": median(costs[kind]),
                "max_ms": max(costs[kind]),
                "most_ticks": max(ticks[kind]),
                "whole_ms": reference,
            },
        )
        for kind, (_, target) in _KINDS.items()
    ]
