"""Motion files whose check sums are right and whose contents are not."""

from __future__ import annotations

import contextlib
import io
import json
import random
import struct
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from corrupted import corrupted
from motions import MANIFEST, Piece, chunk

from ergon import _core
from ergon.cli.console import Console
from ergon.cli.motion_info import motion as told
from ergon.cli.outcome import Refused
from ergon.exchange.gltf import gltf
from ergon.exchange.motion import csv_rows, instants, write_npz
from ergon.exchange.motion_space import NotMotionError
from tests.fuzz.harness import Target
from tests.fuzz.texts import damaged

Chunk = tuple[int, int, float, bytes]
MAGIC = 8  # bytes before the chunks
WORDS = ('"kind":', '"free"', '"modal"', '"modes":', '"parts":', "null", "[", "]", "{", "}", "1e99")


@cache
def _whole() -> tuple[bytes, tuple[Chunk, ...]]:
    """The first bytes of a file, and the kind, version, instant and payload of its chunks."""
    data = Piece().bytes()
    found: list[Chunk] = []
    at = MAGIC
    while at < len(data):
        kind, version, length, seconds = struct.unpack_from("<HHId", data, at)
        found.append((kind, version, seconds, data[at + 16 : at + 16 + length]))
        at += 20 + length
    return data[:MAGIC], tuple(found)


def _case(chance: random.Random) -> bytes:
    magic, chunks = _whole()
    # A file of the first second, in which each chunk is likely to be met.
    made = list(chunks[:30])
    for _ in range(chance.choice((1, 1, 2, 4))):
        at = chance.randrange(len(made))
        kind, version, seconds, payload = made[at]
        if kind == MANIFEST and chance.random() < 0.8:
            payload = damaged(payload.decode(), chance, WORDS).encode(errors="replace")
        elif chance.random() < 0.9:
            payload = next(corrupted(payload, 1, chance.randrange(1 << 30)))
        if chance.random() < 0.1:
            seconds = chance.choice((-1.0, 1e300, float("nan"), float("inf"), 0.0))
        if chance.random() < 0.05:
            kind = chance.randrange(20)
        made[at] = kind, version, seconds, payload
    if chance.random() < 0.2:
        del made[chance.randrange(len(made))]
    return magic + b"".join(chunk(kind, t, data, version) for kind, version, t, data in made)


def _read(data: bytes, folder: Path) -> Iterator[str]:
    """What `info` and `motion export` make of it."""
    path = folder / "a.motion"
    path.write_bytes(data)
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        told(Console(json=True), path)
    yield said.getvalue()
    found: Any = _core.read_motion(path)
    at = instants(found, None)[:5]
    write_npz(io.BytesIO(), found, at)
    yield from csv_rows(found, at)
    json.loads(gltf(found, at, None))


TARGETS = (
    Target("motion", _case, _read, (Refused, NotMotionError, _core.EngineError), 40, 10_000),
)
