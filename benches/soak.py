"""A session that runs for long with a line every second: its memory, files, threads, journal.

`soak` is an hour of frames, computed as fast as possible. `soak_live` is `ergon repl` itself, by
the clock.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

from benches.measure import Row
from benches.repl import LINES
from ergon.repl.session.engine import SteppedEngine
from ergon.repl.session.journal import Journal
from ergon.repl.session.journal_content import SessionStart
from ergon.repl.session.session import Session
from ergon.repl.session.version import Version, piece_of
from ergon.scores.edits.texts import Texts

_SCORE = """\
ergon: 1
tempo: [{at: 1|1, bpm: 60}]
keys:
  k0: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}
  k1: {like: k0}
instruments:
  bells:
    modules:
      m0: {CEL: {M: 2g, f: 220Hz, t60: 1s}}
      m1: {CEL: {M: 2g, f: 331Hz, t60: 1s}}
      b0: {BUT: {between: [k0, m0], K: 900N/m, gap: 1mm}}
      b1: {BUT: {between: [k1, m1], K: 900N/m, gap: 1mm}}
    out: {SOX: [m0, m1]}
gestures:
  knock: 0mm@0 smooth 6mm@1/8 smooth 0mm@1/2
players:
  p0: {key: k0}
  p1: {key: k1}
parts: {p0: [{at: 1|1, play: knock, every: 1, times: 9999}]}
"""
_NAMES = {"a": "p0", "b": "p1", "g": "knock", "i": "bells"}
_STEADY = (
    "gain {i} -3dB",
    "{g} = 0@0 smooth 5@1/8 smooth 0@1/2",
    "? {g}",
    "mute {i}",
    "set bells.b0.K 800N/m",
    "unmute {i}",
    "undo",
    "{g} = 0@0 smooth 4@1/8 smooth 0@1/2",
    "set bells.b0.K 900N/m",
    "gain {i} 0dB",
)
"""Lines that do not lengthen a score; those of `repl` write music, which stays in the score."""
_TICK = 64  # frames
_LOOK = 40  # ticks between two looks of the session at its engine
_MEMORY_GROWTH = 0.05  # from the second quarter to the last


@dataclass(frozen=True, slots=True)
class Held:
    """Resources of a process: resident memory [MB], open files, threads, and its journal [kB]."""

    memory: float
    files: int
    threads: int
    journal: float


def held(process: int, journal: Path) -> Held:
    """The resources of a process now; Linux only."""
    proc = Path("/proc") / str(process)
    pages = int((proc / "statm").read_text().split()[1])
    size = journal.stat().st_size if journal.exists() else 0
    return Held(
        pages * os.sysconf("SC_PAGE_SIZE") / 1e6,
        len(list((proc / "fd").iterdir())),
        len(list((proc / "task").iterdir())),
        size / 1e3,
    )


def soak(steady: int = 3600, written: int = 600) -> list[Row]:
    """`steady` seconds of frames with a line every second that changes existing parts, then
    `written` seconds with lines that write music.

    The frames are computed as fast as possible.
    """
    rows = []
    kinds = (("change what is there", _STEADY, steady), ("write music", LINES, written))
    for what, typed, seconds in kinds:
        began = time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            looks, slowest, refused = _stepped(Path(folder), typed, seconds)
        took = time.perf_counter() - began
        text = f"{seconds:,} s of a line a second that {what}, computed in {took:.0f} s"
        row = _row(text, looks, is_by_frames=True)
        lines = f"the slowest line took {1e3 * slowest:.0f} ms, {refused} were refused"
        rows.append(replace(row, ours=f"{row.ours}; {lines}"))
    return rows


def soak_live(minutes: float = 10.0) -> list[Row]:
    """`ergon repl` with a line every second, by the clock, into silence."""
    with tempfile.TemporaryDirectory() as folder:
        looks, code = _typed(Path(folder), int(60 * minutes))
    what = f"`ergon repl --audio null`, a line a second for {minutes:g} min"
    row = _row(what, looks, is_by_frames=False)
    return [replace(row, ours=f"{row.ours}; it ended with {code}")]


def _stepped(folder: Path, typed: Sequence[str], seconds: int) -> tuple[list[Held], float, int]:
    path, journal = folder / "score.yaml", folder / "session.jsonl"
    path.write_text(_SCORE, encoding="utf-8")
    texts = Texts.read(path)
    version = Version(0, "", texts, piece_of(texts))
    written = Journal(journal)
    opening = SessionStart(texts, 0.0, version.faders, _TICK, 1.0, 1.0, None)
    written.append("session", **opening.fields())
    engines: list[SteppedEngine] = []

    def begin(stage):  # type: ignore[no-untyped-def]
        engines.append(SteppedEngine(stage, tick_frames=_TICK, highpass=None))
        return engines[0]

    looks, slowest, refused = [], 0.0, 0
    with closing(Session(version, begin, margin=0.0, journal=written)) as session:
        for line in ("play", "tempo 240 now"):
            assert session.submit(line).taken
        for number in range(seconds):
            line = typed[number % len(typed)].format(**_NAMES)
            began = time.perf_counter()
            reply = session.submit(line)
            slowest = max(slowest, time.perf_counter() - began)
            refused += not reply.taken
            left = int(session.schedule.rate)
            while left > 0:
                n = min(left, _LOOK * _TICK)
                session.do_once()
                engines[0].process(n)
                left -= n
            if number % 60 == 59:
                looks.append(held(os.getpid(), journal))
    return looks, slowest, refused


def _typed(folder: Path, seconds: int) -> tuple[list[Held], int]:
    score, journal = folder / "score.yaml", folder / "session.jsonl"
    score.write_text(_SCORE, encoding="utf-8")
    options = ["--audio", "null", "--gain", "0dB", "--plain", "--journal", str(journal)]
    command = [sys.executable, "-m", "ergon.cli", "repl", str(score), *options]
    looks = []
    with (
        (folder / "said.txt").open("wb") as text,
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=text, stderr=text) as repl,
    ):
        assert repl.stdin is not None

        def type_line(line: str) -> None:
            assert repl.stdin is not None
            repl.stdin.write(f"{line}\n".encode())
            repl.stdin.flush()

        for line in ("play", "tempo 240 now"):
            type_line(line)
        due = time.monotonic()
        for number in range(seconds):
            due += 1.0
            time.sleep(max(0.0, due - time.monotonic()))
            type_line(_STEADY[number % len(_STEADY)].format(**_NAMES))
            if number % 30 == 29:
                looks.append(held(repl.pid, journal))
        type_line("quit")
        repl.stdin.close()
        code = repl.wait(60)
    return looks, code


def _row(what: str, looks: Sequence[Held], *, is_by_frames: bool) -> Row:
    early, late = looks[len(looks) // 4], looks[-1]
    middle = looks[len(looks) // 2]
    grown = late.memory / early.memory - 1.0
    # Growth of the journal in the second half, compared with the first.
    first = middle.journal - looks[0].journal
    second = late.journal - middle.journal
    spans = [len(looks) // 2, len(looks) - 1 - len(looks) // 2]
    per_look = [
        grown_by / max(span, 1) for grown_by, span in zip((first, second), spans, strict=True)
    ]
    text = (
        f"memory {early.memory:.0f} MB after a quarter, {late.memory:.0f} MB at the end "
        f"({100 * grown:+.1f} %); {early.files} and {late.files} files, "
        f"{early.threads} and {late.threads} threads; journal {late.journal:.0f} kB, "
        f"{per_look[0]:.2f} and {per_look[1]:.2f} kB a look in its two halves"
    )
    values: dict[str, float | int | str] = {
        "memory_quarter_mb": early.memory,
        "memory_end_mb": late.memory,
        "files": late.files,
        "threads": late.threads,
        "journal_kb": late.journal,
    }
    target = (
        f"target: memory grows by at most {100 * _MEMORY_GROWTH:.0f} %, files and threads do not"
    )
    return Row(what, text, target, None, "by frames" if is_by_frames else "by the clock", values)
