"""kill -9 of a session that gets a line every 50 ms: no line whose answer was seen is lost.

The instants are drawn by a seed; half of the kills wait for the first answer. What was answered
until then stays in the pipe or the socket and is compared with the journal. Nothing here depends
on how busy the machine is.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import random
import re
import subprocess
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from subprocess import DEVNULL, PIPE
from typing import Any

import numpy as np
import pytest
from commands import PATIENT
from patience import PATIENCE, until
from sessions import Stepped

from ergon.common.terminal import clean
from ergon.repl.session.journal import JournalError, read_events
from ergon.repl.session.journal_content import read_journal
from ergon.repl.session.replay import ReplayedSession, resumed_state
from ergon.repl.session.version import Version
from ergon.repl.wire import local_socket
from ergon.repl.wire.protocol import encode

SEED = 9
MANY = 300
PERIOD = 0.05  # [s] from line to line
SECONDS = 1.5  # [s] in which a kill comes, from the start of the program or from its first prompt
EARLY = 5  # one kill in so many comes while the program starts
SLOW_RESUME = 10  # one session in so many is resumed by the command, the others in this process

SCORE = """\
ergon: 1
title: Killed
rates: {audio: 8kHz}
tempo: [{at: 1|1, bpm: 120}]
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m, travel: -15mm..15mm}}
instruments:
  bell:
    modules:
      m: {CEL: {M: 2g, f: A3, t60: 0.5s}}
      b: {BUT: {between: [k1, m], K: 900N/m, Z: 0.1Ns/m, gap: 1mm}}
    out: {SOX: m}
gestures: {knock: 0mm@0 smooth 6mm@1/8 smooth 0mm@1/2}
players: {ada: {key: k1}}
parts: {ada: []}
mix: {channels: 2, route: [{from: bell, to: [1, 2]}]}
"""


def lines() -> Iterator[str]:
    """Lines of every kind; most have a number by which their effect is known."""
    yield "route bell 1 2"
    yield "play"
    for n in itertools.count(1):
        yield f"g{n} = 0@0 smooth {1 + n % 9}@1/8 smooth 0@1/2"
        yield f"ada plays g{n} every 2"
        yield f"set bell.b.K {900 + n}N/m now"
        yield f"gain bell -{n}dB"
        yield f"ada plays nobody{n}"
        yield f"tempo {100 + n} now"
        yield f"def b{n}:\nset bell.b.Z x1.01\nend"
        if n % 3 == 0:
            yield "stop"
            yield "play"


@dataclass
class Killed:
    """The lines that a session got until it was killed. Each answer says whether its line was
    taken, and has the first line of the reply.
    """

    sent: list[str] = field(default_factory=list)
    answers: list[tuple[bool, str]] = field(default_factory=list)

    def feed(self, enter: Callable[[str], object], seconds: float) -> None:
        """Enter lines for some time."""
        end = time.monotonic() + seconds
        for line in lines():
            if time.monotonic() >= end:
                return
            enter(line)
            self.sent.append(line)
            time.sleep(PERIOD)


def _repl(folder: Path, *words: str, **pipes: int) -> subprocess.Popen[bytes]:
    command = [*PATIENT, "repl", "score.yaml", "--gain", "0dB", *words]
    return subprocess.Popen(command, cwd=folder, stderr=DEVNULL, bufsize=0, **pipes)


def by_pipe(folder: Path, chance: random.Random, is_early: bool) -> Killed:
    """A session that gets its lines through a pipe."""
    killed, output, waits = Killed(), b"", not is_early and chance.random() < 0.5
    audio = chance.choice(("null", "null:fast"))
    with _repl(folder, "--plain", "--audio", audio, stdin=PIPE, stdout=PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        source = process.stdin
        while not (is_early or output.endswith(b" > ")):
            output += (more := process.stdout.read(1))
            assert more, "the session ended"
        killed.feed(lambda line: source.write(f"{line}\n".encode()), chance.uniform(0.0, SECONDS))
        while (
            killed.sent and waits and not re.search(b"^(ok|not taken:) .*\n", output, re.MULTILINE)
        ):
            output += (more := os.read(process.stdout.fileno(), 1 << 16))
            assert more, "the session ended"
        process.kill()
        output += process.stdout.read()
    for row in output.decode().split("\n")[:-1]:
        if row.startswith(("ok ", "not taken: ")):
            killed.answers.append((row.startswith("ok "), row.removeprefix("not taken: ")))
    return killed


def by_socket(folder: Path, chance: random.Random, is_early: bool) -> Killed:
    """A session that gets its lines at its socket."""
    killed, output, waits = Killed(), b"", chance.random() < 0.5
    words = ("--audio", "null", "--engine", "--socket", "s")
    with (
        _repl(folder, *words, stdin=DEVNULL, stdout=DEVNULL) as process,
        contextlib.ExitStack() as stack,
    ):
        stack.callback(process.kill)
        if is_early:
            time.sleep(chance.uniform(0.0, SECONDS))
            process.kill()
            return killed

        def is_there() -> bool:
            assert process.poll() is None, "the session ended"
            with contextlib.suppress(local_socket.NoSessionError):
                local_socket.connect(folder / "s")[0].close()
                return True
            return False

        until(is_there, "a session")
        prompt = stack.enter_context(local_socket.connect(folder / "s")[0])
        prompt.settimeout(PATIENCE)
        killed.feed(
            lambda line: prompt.sendall(encode(id=len(killed.sent), do="submit", text=line)),
            chance.uniform(0.0, SECONDS),
        )
        while killed.sent and waits and b'{"id":' not in output:
            output += prompt.recv(1 << 16)
        process.kill()
        with contextlib.suppress(ConnectionResetError):  # after the last byte that it wrote
            while more := prompt.recv(1 << 16):
                output += more
    for row in map(json.loads, output.split(b"\n")[:-1]):
        if "id" in row:
            assert row["id"] == len(killed.answers)
            killed.answers.append((row["is"]["taken"], _first(row["is"]["text"])))
    return killed


def _first(reply: str) -> str:
    return clean(reply).split("\n")[0]


def check(folder: Path, killed: Killed, *, by_command: bool) -> None:
    """What was answered is in the journal, which can be rendered and resumed."""
    path = folder / "session.jsonl"
    try:
        content = read_journal(path, resumes=True, score=str(folder / "score.yaml"))
    except JournalError:
        if killed.answers:
            raise
        return  # it had not begun
    events = [(event.name, event.fields) for event in read_events(path)]
    assert [fields["n"] for _, fields in events] == list(range(1, len(events) + 1))
    output = [fields for name, fields in events if name == "said"]
    assert [answer["line"] for answer in output] == killed.sent[: len(output)]
    replies = [(answer["taken"], _first(answer["reply"])) for answer in output]
    assert replies[: len(killed.answers)] == killed.answers
    noted = [fields["line"] for name, fields in events if name == "line"]
    taken = [answer["line"] for answer in output if answer["taken"]]
    # The last line may be noted before its answer.
    assert noted in (taken, taken + killed.sent[len(output) : len(output) + 1])
    again = ReplayedSession(read_journal(path))
    sound = np.zeros((again.n_frames, again.n_channels))
    if again.n_frames:
        again.process(sound)
    assert np.isfinite(sound).all()
    has_effects(resumed_state(content)[0], events)
    resumes(path, by_command=by_command)


def has_effects(version: Version, events: Sequence[tuple[str, Mapping[str, Any]]]) -> None:
    """A version is what the lines of a journal make of it, in the order of their effects."""
    lines = {fields["number"]: fields["line"] for name, fields in events if name == "line"}
    for name, fields in events:
        if name == "dropped":
            del lines[fields["number"]]
    done = [fields["number"] for name, fields in events if name == "commit"]
    last: dict[str, set[str]] = {}  # by verb, the values of which one is the last
    for number in (*done, *(number for number in lines if number not in done)):
        line = lines[number]
        if match := re.match(r"(g\d+) = ", line):
            assert match[1] in version.piece.gestures
        elif match := re.match(r"def (b\d+):", line):
            assert match[1] in version.piece.blocks
        elif match := re.match(r"(ada plays|set|gain|tempo) (?:bell\S* )?(\S+)", line):
            others = last.get(match[1], set()) if number not in done else set()
            last[match[1]] = {*others, match[2]}
    text = version.texts.text
    if values := last.get("ada plays"):
        assert any(f"play: {value}," in text for value in values)
    if values := last.get("set"):
        assert any(f"K: {value}" in text for value in values)
    if values := last.get("tempo"):
        assert any(f"bpm: {value}}}" in text for value in values)
    if values := last.get("gain"):
        ratios = [10 ** (float(value[:-2]) / 20) for value in values]
        assert any(version.faders.gains["bell"] == pytest.approx(ratio) for ratio in ratios)


def resumes(path: Path, *, by_command: bool) -> None:
    """A session goes on from the end of a journal."""
    if by_command:
        with _repl(
            path.parent, "--resume", path.name, "--audio", "null", "--plain", "--strict",
            stdin=PIPE, stdout=PIPE,
        ) as process:  # fmt: skip
            output, _ = process.communicate(b"play\nlast = 0@0 smooth 1@1/2\n", timeout=PATIENCE)
        assert process.returncode == 0, output
        return
    resumed = Stepped.resumed(path)
    resumed.ok("play")
    resumed.ok("last = 0@0 smooth 1@1/2")
    resumed.run(0.1)
    resumed.close()


DOORS = (by_pipe, by_socket)


def kill(number: int) -> str:
    """One kill; what was wrong, if anything."""
    chance = random.Random(f"{SEED} {number}")
    door = DOORS[number % len(DOORS)]
    with tempfile.TemporaryDirectory(prefix="ergon-") as name:
        folder = Path(name)
        (folder / "score.yaml").write_text(SCORE)
        try:
            killed = door(folder, chance, number % EARLY == EARLY - 1)
            check(folder, killed, by_command=number % SLOW_RESUME == SLOW_RESUME - 1)
        except Exception:
            return f"kill {number}, {door.__name__}: {traceback.format_exc()}"
    return ""


def kill_all(numbers: range) -> None:
    with ThreadPoolExecutor(2) as pool:
        wrong = [report for report in pool.map(kill, numbers) if report]
    assert not wrong, f"{len(wrong)} of {len(numbers)}\n" + "\n".join(wrong[:5])


def test_session_lines_preserved_after_six_kills() -> None:
    kill_all(range(6))


@pytest.mark.slow
def test_session_lines_preserved_after_300_kills() -> None:
    kill_all(range(MANY))
