"""A session that goes on for long, with a line every second: its memory, files, threads, journal.

`soak` is an hour of frames, computed as fast as they go. `soak_live` is `ergon repl` itself, by the
clock.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from benches.measure import Row
from benches.repl import LINES, hundred
from ergon.repl.session.engine import SteppedEngine
from ergon.repl.session.journal import Journal
from ergon.repl.session.journal_content import SessionStart
from ergon.repl.session.session import Session
from ergon.repl.session.version import Version, piece_of
from ergon.scores.edits.texts import Texts

_NAMES = {"a": "p0", "b": "p1", "g": "knock", "i": "bells"}
_TICK = 64  # frames
_LOOK = 40  # ticks between two looks of the session at its engine
_MEMORY_GROWTH = 0.05  # from the second quarter to the last


@dataclass(frozen=True, slots=True)
class Held:
    """What a process holds: resident memory [MB], open files, threads, and its journal [kB]."""

    memory: float
    files: int
    threads: int
    journal: float


def held(process: int, journal: Path) -> Held:
    """What a process holds now; Linux."""
    proc = Path("/proc") / str(process)
    pages = int((proc / "statm").read_text().split()[1])
    size = journal.stat().st_size if journal.exists() else 0
    return Held(
        pages * os.sysconf("SC_PAGE_SIZE") / 1e6,
        len(list((proc / "fd").iterdir())),
        len(list((proc / "task").iterdir())),
        size / 1e3,
    )


def soak(lines: int = 3600) -> list[Row]:
    """An hour of a line every second, in the time of the frames."""
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        looks = list(_stepped(Path(folder), lines))
    what = f"a line a second for {lines:,} s, computed in {time.perf_counter() - began:.0f} s"
    return [_row(what, looks, lines)]


def soak_live(minutes: float = 10.0) -> list[Row]:
    """`ergon repl` with a line every second, by the clock, into silence."""
    with tempfile.TemporaryDirectory() as folder:
        looks, code = _typed(Path(folder), int(60 * minutes))
    row = _row(f"`ergon repl --audio null`, a line a second for {minutes:g} min", looks, None)
    return [Row(row.scene, f"{row.ours}; it ended with {code}", *_rest(row))]


def _rest(row: Row) -> tuple[str, float | None, str]:
    return row.reference, row.ratio, row.sense


def _stepped(folder: Path, lines: int) -> list[Held]:
    path, journal = folder / "score.yaml", folder / "session.jsonl"
    path.write_text(hundred(), encoding="utf-8")
    texts = Texts.read(path)
    version = Version(0, "", texts, piece_of(texts))
    written = Journal(journal)
    opening = SessionStart(texts, 0.0, version.faders, _TICK, 1.0, 1.0, None)
    written.tell("session", **opening.fields())
    engines: list[SteppedEngine] = []

    def begin(stage):  # type: ignore[no-untyped-def]
        engines.append(SteppedEngine(stage, tick_frames=_TICK, highpass=None))
        return engines[0]

    looks = []
    with closing(Session(version, begin, margin=0.0, journal=written)) as session:
        for line in ("play", "tempo 240 now"):
            assert session.submit(line).taken
        for number in range(lines):
            line = LINES[number % len(LINES)].format(**_NAMES)
            reply = session.submit(line)
            assert reply.taken, f"{line}: {reply.text}"
            left = int(session.commits.rate)
            while left > 0:
                n = min(left, _LOOK * _TICK)
                session.pump()
                engines[0].process(n)
                left -= n
            if number % 60 == 59:
                looks.append(held(os.getpid(), journal))
    return looks


def _typed(folder: Path, seconds: int) -> tuple[list[Held], int]:
    score, journal = folder / "score.yaml", folder / "session.jsonl"
    score.write_text(hundred(), encoding="utf-8")
    options = ["--audio", "null", "--gain", "0dB", "--plain", "--journal", str(journal)]
    command = [sys.executable, "-m", "ergon.cli", "repl", str(score), *options]
    looks = []
    with (
        (folder / "said.txt").open("wb") as said,
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=said, stderr=said) as repl,
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
            type_line(LINES[number % len(LINES)].format(**_NAMES))
            if number % 30 == 29:
                looks.append(held(repl.pid, journal))
        type_line("quit")
        repl.stdin.close()
        code = repl.wait(60)
    return looks, code


def _row(what: str, looks: Sequence[Held], lines: int | None) -> Row:
    early, late = looks[len(looks) // 4], looks[-1]
    middle = looks[len(looks) // 2]
    grown = late.memory / early.memory - 1.0
    # The journal in the second half, beside what it took in the first.
    first = middle.journal - looks[0].journal
    second = late.journal - middle.journal
    spans = [len(looks) // 2, len(looks) - 1 - len(looks) // 2]
    per_look = [
        grown_by / max(span, 1) for grown_by, span in zip((first, second), spans, strict=True)
    ]
    said = (
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
    return Row(what, said, target, None, "in frames" if lines else "by the clock", values)
