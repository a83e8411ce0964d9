"""kill -9 at random instants: what is on the disk is whole or known as cut; nothing is left over.

Nothing here is judged by a clock: the instants are drawn from a seed, and what a machine had done
by then is whatever it had done. Takes are compared with the packets that their device has counted.
"""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import time
import traceback
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from commands import ERGON

from ergon import _core
from ergon.repl.session.journal import JournalError
from ergon.repl.session.journal_content import read_journal
from ergon.repl.session.replay import resumed_state

SEED = 12
MANY = 1000
TICKS_LOST = 500  # half a second of 1 kHz
OPENING = 200  # packets that a device is sent before its first tick is recorded, at most

SCORE = """\
ergon: 1
title: Killed
tempo: [{at: 1|1, bpm: 120}]
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}}
instruments:
  bell:
    modules:
      m: {CEL: {M: 2g, f: A3, t60: 0.5s}}
      b: {BUT: {between: [k1, m], K: 900N/m, Z: 0.1Ns/m, gap: 1mm}}
    out: {SOX: m}
gestures:
  knock: 0mm@0 smooth 6mm@1/8 smooth 0mm@1/2
players: {ada: {key: k1}}
parts: {ada: [{at: 1|1, play: knock, every: 1, times: 4}]}
mix: {channels: 2, route: [{from: bell, to: [1, 2]}]}
render: {bits: 24, tail: TAIL}
"""
LIVE = SCORE.replace("{key: k1}", "{key: k1, hand: live}").replace("TAIL", "60s")


def environment(folder: Path) -> dict[str, str]:
    """Plans are kept in the folder."""
    return {**os.environ, "ERGON_CACHE": "on", "XDG_CACHE_HOME": str(folder / "cache")}


def start(folder: Path, *line: object, **more: object) -> subprocess.Popen[str]:
    pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    words = [*ERGON, *map(str, line)]
    return subprocess.Popen(
        words, cwd=folder, env=environment(folder), text=True, **{**pipes, **more}
    )


def ended(folder: Path, *line: object) -> tuple[int, str]:
    """A command to its end: exit code, and all it said."""
    with start(folder, *line) as process:
        out, err = process.communicate(timeout=300)
    assert "Traceback" not in err, err
    assert "internal error" not in err, err
    return process.returncode, out + err


def killed(process: subprocess.Popen[str], seconds: float) -> None:
    """After so long, whatever the process does then."""
    with process:
        try:
            process.wait(seconds)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
        process.communicate()


def contents(folder: Path) -> dict[str, bytes]:
    """All files of a folder, hidden ones as well."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def names(folder: Path) -> list[str]:
    """Files of a folder, without the plans that are kept."""
    return sorted(name for name in contents(folder) if not name.startswith("cache/"))


# What a command makes: whole, in a folder of its own, and how long it takes to make it.
@dataclass
class CompleteRun:
    files: dict[str, bytes]
    seconds: float


@cache
def complete_run(line: tuple[str, ...], tail: str) -> CompleteRun:
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "score.yaml").write_text(SCORE.replace("TAIL", tail))
        began = time.monotonic()
        code, text = ended(folder, *line)
        seconds = time.monotonic() - began
        assert code == 0, text
        return CompleteRun(contents(folder), seconds)


def _makes(line: tuple[str, ...], folder: Path, chance: random.Random) -> None:
    """A command that writes files: each is the old one or the new one; the next start is clean."""
    built = complete_run(line, "20s")
    old = complete_run(line, "1s")
    over = chance.random() < 0.5  # over what an earlier run made, of another score
    if over:
        for name, data in old.files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(data)
    (folder / "score.yaml").write_bytes(built.files["score.yaml"])
    again = (*line, "-f") if over and line[0] == "render" else line
    killed(start(folder, *again), chance.uniform(0.2, 1.1) * built.seconds)
    left = contents(folder)
    for name, data in left.items():
        if not name.endswith(".part"):
            assert data in (built.files.get(name), old.files.get(name) if over else None), name
    if "frozen/frozen.json" in left:
        code, text = ended(
            folder, "play", "score.yaml", "--frozen", "frozen", "--audio", "null:fast"
        )
        parts = {name for name in left if name.startswith("frozen/") and not name.endswith(".part")}
        is_new = all(left[name] == built.files.get(name) for name in parts)
        assert code == (0 if is_new else 2), text
    code, text = ended(folder, *again)
    assert code == 0, text
    after = contents(folder)
    assert not [name for name in after if name.endswith(".part")], "litter"
    for name, data in built.files.items():
        assert after[name] == data, name


def render(folder: Path, chance: random.Random) -> None:
    _makes(("render", "score.yaml", "-o", "x.wav", "--stems", "stems"), folder, chance)


def freeze(folder: Path, chance: random.Random) -> None:
    _makes(("render", "score.yaml", "--freeze", "bell", "-o", "frozen"), folder, chance)


def plan(folder: Path, chance: random.Random) -> None:
    _makes(("plan", "score.yaml"), folder, chance)


def _recorded(folder: Path, chance: random.Random, *line: str, live: str) -> None:
    """A take holds every tick of which its device knows but the last half second."""
    (folder / "score.yaml").write_text(LIVE)
    with start(folder, "emulate", "frame", "--udp", "0", "--json") as device:
        assert device.stdout is not None
        url = json.loads(device.stdout.readline())["url"]
        killed(
            start(folder, *line, "--live", live + url, "--json", stdout=subprocess.DEVNULL),
            chance.uniform(0.3, 3.0),
        )
        device.send_signal(signal.SIGINT)
        out, _ = device.communicate(timeout=60)
    over = json.loads(out.splitlines()[-1])
    assert over["event"] == "over"
    take = folder / "a.take"
    if not take.exists():
        assert over["packets"] < TICKS_LOST + OPENING
        return
    if take.stat().st_size == 0:  # killed between its name and its first bytes
        assert over["packets"] < TICKS_LOST + OPENING
        return
    result = _core.read_recording(take)
    assert not result.finished, "what was cut is called whole"
    ticks = result.ticks()
    assert list(ticks) == list(range(len(ticks)))
    assert over["packets"] - len(ticks) <= TICKS_LOST + OPENING
    code, text = ended(folder, "take", "info", "a.take")
    assert code == (0 if len(ticks) else code)
    assert "never finished" in text or code == 2, text
    assert names(folder) == ["a.take", "score.yaml"]


def take_record(folder: Path, chance: random.Random) -> None:
    _recorded(folder, chance, "take", "record", "-o", "a.take", live="")


def duet(folder: Path, chance: random.Random) -> None:
    where = ("--audio", "null", "--gain", "0dB", "--unchecked", "--plain")
    _recorded(folder, chance, "duet", "score.yaml", "--record", "a.take", *where, live="ada=")


LINES = ("play", "ada plays knock every 1", "gain bell -3dB", "tempo 90", "knock = 0@0 2@1/8 0@1/2")


def repl(folder: Path, chance: random.Random) -> None:
    """Every line of which `ok` was seen is in the journal, and `--resume` has done it."""
    (folder / "score.yaml").write_text(SCORE.replace("TAIL", "1s"))
    line = ("repl", "score.yaml", "--audio", "null", "--gain", "0dB", "--plain")
    process = start(folder, *line, stdin=subprocess.PIPE, stderr=subprocess.STDOUT)
    assert process.stdin is not None
    assert process.stdout is not None
    accepted = 0
    until = chance.randrange(len(LINES) + 1)
    with process:
        for text in LINES[:until]:
            process.stdin.write(text + "\n")
            process.stdin.flush()
            while "ok" not in (output := process.stdout.readline()):
                assert output, "it ended"
            accepted += 1
        for text in LINES[until:]:
            process.stdin.write(text + "\n")
        process.stdin.flush()
        time.sleep(chance.uniform(0.0, 0.02) if until else chance.uniform(0.0, 1.5))
        process.kill()
        out, _ = process.communicate()
    accepted += sum(
        ": ok" in row or row.startswith("ok") or "> ok" in row for row in out.split("\n")
    )
    journal = folder / "session.jsonl"
    try:
        result = read_journal(journal, resumes=True, score=str(folder / "score.yaml"))
    except JournalError:
        assert not accepted
        return
    events = [event.fields["line"] for _, event in sorted(result.lines.items())]
    assert events == list(LINES[: len(events)])
    assert len(events) >= accepted
    text = resumed_state(result)[0].texts.text
    assert ("every: 1, until: 999|1" in text) == (len(events) > 1)
    assert ("2@1/8" in text) == (len(events) == len(LINES))
    code, output = ended(folder, *line, "--resume", "session.jsonl")
    assert code == 0, output
    assert names(folder) == ["score.yaml", "session-2.jsonl", "session.jsonl"]


WAYS: tuple[Callable[[Path, random.Random], None], ...] = (
    render, take_record, duet, repl, freeze, plan,
)  # fmt: skip


def kill(number: int) -> str:
    """One kill; what was wrong, if anything."""
    method = WAYS[number % len(WAYS)]
    with TemporaryDirectory(prefix="ergon-kill-") as name:
        try:
            method(Path(name), random.Random(f"{SEED} {number}"))
        except Exception:
            return f"kill {number}, {method.__name__}: {traceback.format_exc()}"
    return ""


def kill_all(numbers: range) -> None:
    with ThreadPoolExecutor(min(4, os.cpu_count() or 1)) as pool:
        wrong = [found for found in pool.map(kill, numbers) if found]
    assert not wrong, f"{len(wrong)} of {len(numbers)}\n" + "\n".join(wrong[:5])


def test_recordings_valid_after_three_kills() -> None:
    kill_all(range(3))


@pytest.mark.slow
def test_recordings_valid_after_thousand_kills() -> None:
    kill_all(range(MANY))
