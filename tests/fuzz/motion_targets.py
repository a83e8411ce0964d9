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
from motions import BUNDLE, FRAMES, MANIFEST, Piece, bundle, chunk, group

from ergon import _core
from ergon.cli.console import Console
from ergon.cli.motion_info import motion as motion_info
from ergon.cli.outcome import Refused
from ergon.exchange.gltf import gltf_text
from ergon.exchange.motion import csv_rows, instants, write_npz
from ergon.exchange.motion_space import NotMotionError
from tests.fuzz.harness import Target
from tests.fuzz.texts import damaged

Chunk = tuple[int, int, float, bytes]
MAGIC = 8  # bytes before the chunks
WORDS = ('"kind":', '"free"', '"modal"', '"modes":', '"parts":', "null", "[", "]", "{", "}", "1e99")


@cache
def _complete_file() -> tuple[bytes, tuple[Chunk, ...]]:
    """The first bytes of a file, and the kind, version, instant and payload of its chunks."""
    data = Piece().bytes()
    result: list[Chunk] = []
    position = MAGIC
    while position < len(data):
        kind, version, length, seconds = struct.unpack_from("<HHId", data, position)
        result.append((kind, version, seconds, data[position + 16 : position + 16 + length]))
        position += 20 + length
    return data[:MAGIC], tuple(result)


def _case(chance: random.Random) -> bytes:
    magic, chunks = _complete_file()
    # A file of the first second, in which each chunk is likely to be met.
    built = list(chunks[:30])
    for _ in range(chance.choice((1, 1, 2, 4))):
        index = chance.randrange(len(built))
        kind, version, seconds, payload = built[index]
        if kind == MANIFEST and chance.random() < 0.8:
            payload = damaged(payload.decode(errors="replace"), chance, WORDS).encode(
                errors="replace"
            )
        elif chance.random() < 0.9:
            payload = next(corrupted(payload, 1, chance.randrange(1 << 30)))
        if chance.random() < 0.1:
            seconds = chance.choice((-1.0, 1e300, float("nan"), float("inf"), 0.0))
        if chance.random() < 0.05:
            kind = chance.randrange(20)
        built[index] = kind, version, seconds, payload
    if chance.random() < 0.2:
        del built[chance.randrange(len(built))]
    if chance.random() < 0.5:
        built = _bundled(built, chance)
    return magic + b"".join(chunk(kind, t, data, version) for kind, version, t, data in built)


def _bundled(built: list[Chunk], chance: random.Random) -> list[Chunk]:
    """All but the frames in a bundle, which is right, or damaged before or after it is deflated."""
    frames = [one for one in built if one[0] == FRAMES]
    groups = b"".join(
        group(kind, chance.choice((1, 2, 4, 12, 999)), [(seconds, payload)])
        for kind, _, seconds, payload in built
        if kind != FRAMES
    )
    if chance.random() < 0.3:
        groups = next(corrupted(groups, 1, chance.randrange(1 << 30)))
    payload = bundle(groups)
    if chance.random() < 0.3:
        payload = next(corrupted(payload, 1, chance.randrange(1 << 30)))
    return [(BUNDLE, 2, 0.0, payload), *frames]


def _read(data: bytes, folder: Path) -> Iterator[str]:
    """What `info` and `motion export` make of it."""
    path = folder / "a.motion"
    path.write_bytes(data)
    output = io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
        motion_info(Console(json=True), path)
    yield output.getvalue()
    result: Any = _core.read_motion(path)
    position = instants(result, None)[:5]
    write_npz(io.BytesIO(), result, position)
    yield from csv_rows(result, position)
    json.loads(gltf_text(result, position, None))


TARGETS = (
    Target("motion", _case, _read, (Refused, NotMotionError, _core.EngineError), 40, 10_000),
)
