"""Journals that strangers wrote and lines that they type, read by whole sessions."""

from __future__ import annotations

import contextlib
import os
import random
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from corrupted import corrupted
from one_bell import SCORE as BELL
from sessions import Stepped
from spoken import OTHERS, SESSION

from tests.repl.test_journal_hostile import Sandbox, hostile, played
from tests.repl.test_repl_hostile import hostile as hostile_line

LINES = (
    *(line for line, _ in SESSION + OTHERS),
    *("play", "panic", "undo", "hush", "ada plays knock every 1", "ada rest", "tempo 72"),
    *("set bell.m.M x1.5", "set k1.K 90N/m", "nudge 0.1", "damp 1s", "solo bell", "mute bell"),
    *("knock = 0@0 throw 3@1/4 0@1", "set bell.m.f 1e9Hz", "tempo 1 -> 999 over 1bar", "quant 0"),
    *("play from 9|1", "stop", "undo", "set bell.b.gap 1e-12m", "couple k1 bell.m 100N/m 1Ns/m"),
)


@cache
def _sandbox() -> tuple[Sandbox, tempfile.TemporaryDirectory[str]]:
    folder = tempfile.TemporaryDirectory(prefix="ergon-fuzz-")
    return Sandbox(Path(folder.name)), folder


def journal(chance: random.Random) -> bytes:
    """A journal of a session, with fields that are hostile or bytes that are damaged."""
    box, _ = _sandbox()
    if chance.random() < 0.7:
        return hostile(chance, box)
    complete = b"".join(_bytes(event) for event in box.events)
    return next(corrupted(complete, 1, chance.randrange(1 << 30)))


def _bytes(event: object) -> bytes:
    import json

    return json.dumps(event).encode() + b"\n"


def read_journal(data: bytes, _: Path) -> list[str]:
    """Render its beginning, go on from it and save it, as a stranger's."""
    box, _folder = _sandbox()
    path = box.inside / "session.jsonl"
    path.write_bytes(data)
    try:
        with contextlib.chdir(box.inside):
            return played(path)
    finally:
        box.clear()


def typed(chance: random.Random) -> list[str]:
    """Lines of a session, some of which mean something."""
    lines = []
    for _ in range(chance.randrange(1, 7)):
        line = hostile_line(chance) if chance.random() < 0.5 else chance.choice(LINES)
        if chance.random() < 0.3:
            line = line.replace("1", chance.choice(("0", "1e9", "-1", "1e-9", "99999")))
        lines.append(line)
    # What Python makes of a line is Python's; files are the journals' and takes' own targets.
    single = ("py", "load", "record", "save", "keep", "reload", "quit")
    return [line for line in lines if not any(word in line for word in single)]


def read_typed(lines: list[str], folder: Path) -> Iterator[str]:
    """Type them into a session that is stepped by hand."""
    before = os.getcwd()
    os.chdir(folder)
    stepped = Stepped(BELL, folder, journal=False, keeps=False)
    try:
        for line in lines:
            reply = stepped.type(line)
            yield reply.text
            yield from reply.lines
            stepped.run(0.05)
        yield from stepped.session.messages()
    finally:
        stepped.session.close()
        os.chdir(before)
