"""The load of a session that plays the bundled drum-machine and four more voices, by blocks."""

from __future__ import annotations

import tempfile
import time
from contextlib import closing
from pathlib import Path

from benches.measure import Row
from ergon.repl.session.engine import SteppedEngine
from ergon.repl.session.session import Session
from ergon.repl.session.version import Version, piece_of
from ergon.scores.edits.texts import Texts
from ergon.scores.staging.stage import Stage

_LIBRARY = Path(__file__).parent.parent / "scores" / "library"
_BLOCK = 128  # frames
_WARM_SECONDS = 3.0
# What a performer types into it: four instruments that the piece has not.
_LINES = (
    "use strings",
    "use plucked",
    'first = "piano*8"',
    "second strikes dulcimer every 1/4 mf",
    'third = "guitar*4"',
    'fourth = "marimba*8"',
)
# An engine without matter to speak of: what blocks cost by themselves.
_BARE = """\
ergon: 1
instruments: {bar: {CEL: {M: 1g, f: A4, t60: 50ms}, out: {SOX: bar}}}
mix: {channels: 2, route: [{from: bar, to: [1, 2]}]}
"""


def live_drums(minutes: float) -> list[Row]:
    """Processor and wall time of blocks of 128 frames, beside those of a session of one cell."""
    drums = (_LIBRARY / "drum-machine.yaml").read_text(encoding="utf-8")
    drums_load = _load(drums, _LINES, 60.0 * minutes, _LIBRARY)
    bare_load = _load(_BARE, (), 60.0 * minutes)
    return [
        Row(
            "drum-machine and four more voices in a session",
            f"load {drums_load['load']:.3f} in blocks of {_BLOCK} frames, "
            f"{drums_load['late']} of {drums_load['n_blocks']} late",
            f"a session of one cell: load {bare_load['load']:.4f}, {bare_load['late']} late",
            drums_load["load"] / bare_load["load"],
            "by processor time",
            {
                **drums_load,
                "bare_load": bare_load["load"],
                "bare_late": bare_load["late"],
            },
        )
    ]


def _load(
    text: str, lines: tuple[str, ...], seconds: float, folder: Path | None = None
) -> dict[str, float]:
    """Processor time over duration, and how many blocks took longer than they last."""
    engines: list[SteppedEngine] = []

    def begin(stage: Stage) -> SteppedEngine:
        engines.append(SteppedEngine(stage, tick_frames=_BLOCK, highpass=None))
        return engines[-1]

    with tempfile.TemporaryDirectory() as temporary:
        texts = Texts(str((folder or Path(temporary)) / "typed.yaml"), text).complete()
        with closing(Session(Version(0, "", texts, piece_of(texts)), begin, margin=0.0)) as session:
            for line in ("play", *lines):
                reply = session.submit(line)
                assert reply.taken, f"{line}: {reply.text}"
            rate = session.schedule.rate
            for _ in range(int(_WARM_SECONDS * rate / _BLOCK)):
                session.do_once()
                engines[-1].process(_BLOCK)
            cpu_seconds, late, n_blocks = 0.0, 0, int(seconds * rate / _BLOCK)
            for _ in range(n_blocks):
                session.do_once()
                cpu_start, start = time.process_time(), time.perf_counter()
                engines[-1].process(_BLOCK)
                cpu_seconds += time.process_time() - cpu_start
                late += time.perf_counter() - start > _BLOCK / rate
    return {"load": cpu_seconds / (n_blocks * _BLOCK / rate), "late": late, "n_blocks": n_blocks}
