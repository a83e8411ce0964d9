"""C3D files as other programs write them, read by ours and by ezc3d."""

from __future__ import annotations

import random
import struct
from pathlib import Path

import ezc3d
import numpy as np
import pytest

from ergon.scores.gesture import c3d_file

_CODES = {"intel": 84, "dec": 85, "mips": 86}


class _Writer:
    """Numbers of one processor."""

    def __init__(self, processor: str) -> None:
        self.order, self.is_dec = (">" if processor == "mips" else "<"), processor == "dec"

    def word(self, value: int) -> bytes:
        return struct.pack(f"{self.order}H", value & 0xFFFF)

    def reals(self, values: object) -> bytes:
        each = np.ascontiguousarray(values, f"{self.order}f4")
        if not self.is_dec:
            return each.tobytes()
        halves = np.frombuffer((each * 4).astype("<f4").tobytes(), "<u2").reshape(-1, 2)
        return halves[:, ::-1].tobytes()


def _parameters(
    chance: random.Random, numbers: _Writer, rows: list[tuple], *, is_odd: bool
) -> bytes:
    """Groups and parameters, in any order of groups, with and without descriptions, some locked."""
    groups = {name: number for number, name in enumerate(dict.fromkeys(row[0] for row in rows), 1)}
    entries = [(name, -number, b"") for name, number in groups.items()]
    for group, name, kind, dimensions, content in rows:
        body = struct.pack("bB", kind, len(dimensions)) + bytes(dimensions) + content
        entries.append((name, groups[group], body))
    out = b""
    for number, (name, group, body) in enumerate(entries):
        description = b"text of it" if chance.random() < 0.5 else b""
        body += bytes([len(description)]) + description
        written = name.lower() if is_odd and chance.random() < 0.2 else name
        length = -len(written) if is_odd and chance.random() < 0.2 else len(written)
        is_last = number == len(entries) - 1
        after = numbers.word(0 if is_last else len(body) + 2)
        out += struct.pack("bb", length, group) + written.encode() + after + body
    return out + bytes(2)


def _labels(names: list[str]) -> tuple[int, tuple[int, ...], bytes]:
    width = max(map(len, names))
    return -1, (width, len(names)), "".join(name.ljust(width) for name in names).encode()


def _variant(
    seed: int, *, is_odd: bool = True
) -> tuple[bytes, np.ndarray, list[str], dict[str, object]]:
    """The bytes of a file, its positions (n, points, 3), its names, and what it states."""
    chance = random.Random(seed)
    processor = [*_CODES][seed % 3]
    numbers, is_real = _Writer(processor), chance.random() < 0.5
    n, n_points, n_analog = (
        chance.randrange(1, 60),
        chance.randrange(1, 6),
        chance.choice([0, 0, 2]),
    )
    per_frame = chance.choice([1, 4]) if n_analog else 0
    first, rate = chance.choice([1, 1, 17, 300]), chance.choice([50.0, 100.0, 120.0])
    scale = float(np.float32(chance.choice([0.0625, 0.1, 0.5])))
    random_places = np.random.default_rng(seed)
    words = random_places.integers(-9000, 9000, (n, n_points, 3))
    places = (words * np.float32(scale)).astype("f4") if is_real else words
    hidden = random_places.uniform(size=(n, n_points)) < 0.1
    units = chance.choice(["mm", "m", "cm", "mm  "])
    names = [f"M{i}" for i in range(n_points)]
    data = b""
    for frame in range(n):
        fourth = np.where(hidden[frame], -1, 0)
        row = np.concatenate([places[frame], fourth[:, None]], axis=1)
        analog = np.zeros(n_analog * per_frame)
        if is_real:
            data += numbers.reals(row) + numbers.reals(analog)
        else:
            data += np.concatenate([row.ravel(), analog]).astype(f"{numbers.order}i2").tobytes()
    stated = -scale if is_real else scale
    rows: list[tuple] = [
        ("POINT", "USED", 2, (), numbers.word(n_points)),
        ("POINT", "SCALE", 4, (), numbers.reals([stated])),
        ("POINT", "RATE", 4, (), numbers.reals([rate])),
        ("POINT", "FRAMES", 2, (), numbers.word(n)),
        ("POINT", "DATA_START", 2, (), numbers.word(0)),
        ("POINT", "LABELS", *_labels(names)),
        ("POINT", "UNITS", -1, (len(units),), units.encode()),
        ("ANALOG", "USED", 2, (), numbers.word(n_analog)),
        ("ANALOG", "RATE", 4, (), numbers.reals([rate * per_frame])),
    ]
    if n_analog:
        rows += [("ANALOG", "LABELS", *_labels(["f", "g"])),
                 ("ANALOG", "SCALE", 4, (2,), numbers.reals([1.0, 1.0])),
                 ("ANALOG", "OFFSET", 2, (2,), numbers.word(0) * 2),
                 ("ANALOG", "GEN_SCALE", 4, (), numbers.reals([1.0])),
                 ("ANALOG", "UNITS", *_labels(["N", "N"]))]  # fmt: skip
    rows += chance.sample(
        [("SUBJECTS", "NAMES", -1, (3, 1), b"Ada"), ("TRIAL", "DATE", -1, (4,), b"2004"),
         ("EVENT", "USED", 2, (), numbers.word(0)), ("FORCE", "USED", 2, (), numbers.word(0))],
        chance.randrange(5),
    )  # fmt: skip
    section = _parameters(chance, numbers, rows, is_odd=is_odd)
    sectors = -(-(len(section) + 4) // 512) + (chance.choice([0, 1]) if is_odd else 0)
    start = 2 + sectors
    head_of_section = bytes([chance.choice([0, 1]), chance.choice([0, 80]), sectors])
    section = (head_of_section + bytes([_CODES[processor]]) + section).ljust(512 * sectors, b"\0")
    head = bytes([2, 80]) + numbers.word(n_points) + numbers.word(n_analog * per_frame)
    head += (
        numbers.word(first)
        + numbers.word(first + n - 1)
        + numbers.word(0)
        + numbers.reals([stated])
    )
    head += numbers.word(start) + numbers.word(per_frame) + numbers.reals([rate])
    file = head.ljust(512, b"\0") + section + data
    if chance.random() < 0.5:
        file += bytes(-len(file) % 512)
    real = places.astype(float) * (1.0 if is_real else scale)
    real = np.where(hidden[:, :, None], np.nan, real)
    return file, real, names, {"rate": rate, "units": units, "processor": processor}


@pytest.mark.parametrize("seed", range(60))
def test_c3d_files_of_other_programs(seed: int, tmp_path: Path) -> None:
    data, places, names, stated = _variant(seed)
    path = tmp_path / "x.c3d"
    path.write_bytes(data)
    motion = c3d_file.read(path)
    ours = np.concatenate([*motion.blocks()])
    assert motion.points == tuple(names)
    assert motion.rate == pytest.approx(stated["rate"])
    assert motion.unit_metres == pytest.approx(
        {"mm": 1e-3, "cm": 1e-2, "m": 1.0}[stated["units"].strip()]
    )
    np.testing.assert_allclose(ours, places, rtol=1e-6, atol=1e-9)


# ezc3d reads no numbers of MIPS, and crashes on parameters that are locked or in small letters.
@pytest.mark.parametrize("seed", [seed for seed in range(60) if seed % 3 != 2])
def test_c3d_files_beside_ezc3d(seed: int, tmp_path: Path) -> None:
    data, _, names, _ = _variant(seed, is_odd=False)
    path = tmp_path / "x.c3d"
    path.write_bytes(data)
    ours = np.concatenate([*c3d_file.read(path).blocks()])
    theirs = ezc3d.c3d(str(path))
    points = theirs["data"]["points"].transpose(2, 1, 0)
    assert np.array_equal(np.isnan(ours[:, :, 0]), np.isnan(points[:, :, 0]))
    np.testing.assert_allclose(ours, points[:, :, :3], rtol=1e-6)
    assert theirs["parameters"]["POINT"]["LABELS"]["value"] == names
