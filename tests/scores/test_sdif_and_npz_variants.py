"""SDIF and npz files as other programs write them, beside the numbers that were written."""

from __future__ import annotations

import io
import random
import struct
import zipfile
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from numpy.lib import format as npy

from ergon.scores.gesture import sdif_file
from ergon.scores.gesture.npz import open_npz
from ergon.scores.gesture.summary import summary
from ergon.scores.gesture.take_file import Floats, TakeError

# The code of a type of numbers in a matrix, and its form.
_NUMBERS = {0x004: ">f4", 0x008: ">f8", 0x101: "i1", 0x102: ">i2", 0x104: ">i4", 0x108: ">i8"}
_NUMBERS |= {0x201: "u1", 0x202: ">u2", 0x204: ">u4", 0x208: ">u8"}


class SdifWriter:
    """A file of random frames, and the values of each stream, row and column of its matrices."""

    def __init__(self, seed: int) -> None:
        self.chance = random.Random(seed)
        self.n_columns = self.chance.randrange(1, 4)
        self.n_rows = self.chance.randrange(1, 3)
        self.streams = self.chance.sample([0, 1, 2, 7, -4], self.chance.randrange(1, 3))
        self.kind = self.chance.choice([*_NUMBERS])
        self.titles = self.chance.choice([[], ["x", "y", "z"][: self.n_columns], ["Index"]])
        self.times: dict[int, list[float]] = {stream: [] for stream in self.streams}
        self.others: Counter[str] = Counter()  # what has no columns
        self.values: dict[int, list[Floats]] = {stream: [] for stream in self.streams}

    def _padded(self, data: bytes) -> bytes:
        """Some writers leave old bytes in the padding."""
        return data + self.chance.choice([b"\0", b"\xa5"]) * (-len(data) % 8)

    def _matrix(self, name: bytes, kind: int, rows: int, columns: int, data: bytes) -> bytes:
        return self._padded(struct.pack(">4sIII", name, kind, rows, columns) + data)

    def _frame(self, name: bytes, t: float, stream: int, matrices: list[bytes]) -> bytes:
        body = struct.pack(">dii", t, stream, len(matrices)) + b"".join(matrices)
        return name + struct.pack(">I", len(body)) + body

    def _text(self, name: bytes, text: str) -> bytes:
        """A text of the file's head: bare, as earlier libraries write it, or in a matrix."""
        data = text.encode("latin-1")
        if self.chance.random() < 0.5:
            data = self._padded(data)
            return name + struct.pack(">I", len(data)) + data
        return self._frame(name, -np.inf, -2, [self._matrix(name, 0x301, len(data), 1, data)])

    def _head(self) -> bytes:
        version = self.chance.choice([(3, 1), (1, 1), (3, 4)])
        more = self.chance.choice([b"", bytes(8)])
        head = b"SDIF" + struct.pack(">III", 8 + len(more), *version) + more
        if self.chance.random() < 0.6:
            head += self._text(b"1NVT", "{\nAuthor\tGrün;\nDate\ttoday;\n}\n")
            self.others["frame 1NVT without columns"] += 1
        gap = self.chance.choice([" ", "\n", ""])
        types = f"1FTD XMOV {{ XPOS position; }}{gap}"
        if self.titles:
            types += f"1MTD  XPOS{gap}{{{gap}{f',{gap}'.join(self.titles)}{gap}}}"
        if self.titles or self.chance.random() < 0.5:
            head += self._text(b"1TYP", f"{{{types}}}")
        return head

    def _row(self) -> Floats:
        integers = [
            self.chance.randrange(0 if self.kind >> 8 == 2 else -100, 100)
            for _ in range(self.n_rows * self.n_columns)
        ]
        scale = 0.25 if self.kind < 0x100 else 1.0
        return np.array(integers, float).reshape(self.n_rows, self.n_columns) * scale

    def written(self) -> bytes:
        """The bytes of the file."""
        data, t = self._head(), self.chance.choice([0.0, -0.5, 3.25])
        for _ in range(self.chance.randrange(2, 30)):
            t += self.chance.choice([0.01, 0.02, 0.005])
            for stream in self.streams:
                row = self._row()
                content = row.astype(_NUMBERS[self.kind]).tobytes()
                matrices = [self._matrix(b"XPOS", self.kind, *row.shape, content)]
                if self.chance.random() < 0.3:  # a text, or a matrix without rows, beside it
                    other = [(b"XTXT", 0x301, 3, 1, b"abc"), (b"XNIL", 8, 0, 3, b"")]
                    chosen = self.chance.choice(other)
                    matrices.insert(self.chance.randrange(2), self._matrix(*chosen))
                    self.others[f"matrix {chosen[0].decode()} without numbers"] += 1
                data += self._frame(b"XMOV", t, stream, matrices)
                self.times[stream].append(t)
                self.values[stream].append(row)
            if self.chance.random() < 0.1:
                data += self._frame(b"XEMP", t, 0, [])
        return data

    def name(self, stream: int, row: int, column: int) -> str:
        """The channel of a value."""
        title = self.titles[column] if column < len(self.titles) else str(column + 1)
        word = f"XPOS.{title}"
        word += f" stream {stream}" if len(self.streams) > 1 else ""
        return word + (f" row {row + 1}" if self.n_rows > 1 else "")


@pytest.mark.parametrize("seed", range(60))
def test_sdif_files_of_other_programs(seed: int, tmp_path: Path) -> None:
    writer, path = SdifWriter(seed), tmp_path / "x.sdif"
    path.write_bytes(writer.written())
    others: Counter[str] = Counter()
    columns = sdif_file.read_columns(path, others)
    assert others == writer.others
    expected = {
        writer.name(stream, row, column): (stream, row, column)
        for stream in writer.streams
        for row in range(writer.n_rows)
        for column in range(writer.n_columns)
    }
    assert set(columns) == set(expected)
    for name, (stream, row, column) in expected.items():
        np.testing.assert_array_equal(columns[name].instants, writer.times[stream])
        values = [each[row, column] for each in writer.values[stream]]
        np.testing.assert_array_equal(columns[name].values, values)


def _matrix(name: bytes = b"XPOS", kind: int = 8, rows: int = 1, columns: int = 1,
            data: bytes = struct.pack(">d", 5.0)) -> bytes:  # fmt: skip
    data = struct.pack(">4sIII", name, kind, rows, columns) + data
    return data + bytes(-len(data) % 8)


def _frame(t: float, *matrices: bytes, count: int | None = None, size: int | None = None) -> bytes:
    count = len(matrices) if count is None else count
    body = struct.pack(">dii", t, 1, count) + b"".join(matrices)
    return b"XMOV" + struct.pack(">I", len(body) if size is None else size) + body


_HEAD = b"SDIF" + struct.pack(">III", 8, 3, 1)
_FIRST, _LAST = _frame(0.0, _matrix()), _frame(1.0, _matrix())
_MORE = _matrix(b"XTRA")
_ODD: dict[str, tuple[bytes, str]] = {
    "a frame of -1 matrices": (_frame(0.5, _matrix(), count=-1), "a frame with -1 matrices"),
    "a frame of more matrices": (_frame(0.5, _matrix(), count=2), "too short for its matrices"),
    "a frame of 0 matrices": (_frame(0.5, _matrix(), count=0), "rest of a frame behind"),
    "a frame of fewer matrices": (_frame(0.5, _MORE, _matrix(), count=1), "rest of a frame"),
    "a frame of -1 bytes": (_frame(0.5, size=2**32 - 1), "ends within a frame"),
    "a frame of 0 bytes": (b"XMOV" + bytes(4), "frame XMOV without columns"),
    "a frame without an instant": (_frame(np.nan, _matrix()), "without an instant"),
    "the instant of IRCAM's library": (_frame(-np.finfo(float).max, _MORE), "without an instant"),
    "an instant of ages": (_frame(1e300, _MORE), "without an instant"),
    "a matrix of 2**62 values": (_frame(0.5, _matrix(rows=2**31, columns=2**31)), "longer than"),
    "a matrix of no rows": (_frame(0.5, _matrix(rows=0, data=b"")), "matrix XPOS without numbers"),
    "a matrix of no type": (_frame(0.5, _matrix(kind=0, data=b"")), "matrix XPOS without numbers"),
    "a second head": (_HEAD, "frame SDIF without columns"),
    "an instant twice": (_FIRST, "the instants of 'XPOS.1' do not rise"),
    "an instant before": (_frame(-1.0, _matrix()), "the instants of 'XPOS.1' do not rise"),
    "a matrix twice": (_frame(0.5, _matrix(), _matrix()), "do not rise"),
    "zeros": (bytes(64), "without columns"),
}


@pytest.mark.parametrize("name", _ODD)
def test_odd_sdif_content_is_named(name: str, tmp_path: Path) -> None:
    """Nothing is left out in silence: it is named, or the file is refused."""
    data, words = _ODD[name]
    path = tmp_path / "x.sdif"
    path.write_bytes(_HEAD + _FIRST + data + _LAST)
    assert any(words in sentence for sentence in _sentences(path))


def _sentences(path: Path) -> tuple[str, ...]:
    """What a summary says beside the columns, or why there is none."""
    try:
        table = summary(path)
    except TakeError as error:
        return (error.message,)
    return table.note or "", *table.unread


def test_names_in_damaged_sdif_are_few(tmp_path: Path) -> None:
    """A name for each of 2000 frames was a line for each."""
    frames = (b"A%03d" % (i % 1000) + _frame(np.nan)[4:] for i in range(2000))
    path = tmp_path / "x.sdif"
    path.write_bytes(_HEAD + _FIRST + b"".join(frames) + _LAST)
    passed_over = summary(path).unread
    assert len(passed_over) == 65
    assert passed_over[-1] == "anything else, 1872 times"


# --- npz ------------------------------------------------------------------------------------------

_FORMS = ["<f8", ">f8", "<f4", ">f4", "<f2", "<i4", ">i2", "u1", "<u8", "i1"]


def member(array: np.ndarray, version: tuple[int, int] | None) -> bytes:
    """The bytes of an array."""
    file = io.BytesIO()
    npy.write_array(file, array, version=version)
    return file.getvalue()


@pytest.mark.parametrize("seed", range(60))
def test_npz_files_of_other_programs(seed: int, tmp_path: Path) -> None:
    chance, values = random.Random(seed), np.random.default_rng(seed)
    n = chance.choice([1, 2, 7, 300, 131_073])
    rows: dict[str, np.ndarray] = {}
    for name in chance.sample(
        ["t", "x", "hand.y", "x [mm]", "Grün", "a/b"], chance.randrange(1, 5)
    ):
        form = np.dtype(chance.choice(_FORMS))
        low = 0 if form.kind == "u" else -100
        rows[name] = values.integers(low, 100, n).astype(form)
        if chance.random() < 0.2:  # every other value of a longer array
            rows[name] = np.repeat(rows[name], 2)[::2]
    others: dict[str, np.ndarray] = {
        "rate": np.array(44100.0),
        "units": np.array(["m", "mm"]),
        "places": np.zeros((4, 3), order="F"),
        "is_seen": np.ones(n, bool),
        "turns": np.ones(2, complex),
    }
    arrays = rows | {name: others[name] for name in chance.sample([*others], chance.randrange(5))}
    path = tmp_path / "x.npz"
    match chance.randrange(3):
        case 0:
            np.savez(path, **arrays)
        case 1:
            np.savez_compressed(path, **arrays)
        case _:
            with zipfile.ZipFile(path, "w", chance.choice([0, zipfile.ZIP_DEFLATED])) as archive:
                archive.comment = b"by another program" * chance.randrange(2)
                for name, array in arrays.items():
                    ending = chance.choice([".npy", ".npy", ""])
                    version = chance.choice([None, (1, 0), (2, 0), (3, 0)])
                    is_long = chance.random() < 0.3
                    with archive.open(name + ending, "w", force_zip64=is_long) as file:
                        file.write(member(array, version))
    with open_npz(path) as read:
        assert read.names == [*arrays]
        for index, name in enumerate(read.names):
            row = read.row(index)
            assert (row is None) == (name not in rows)
            if row is not None:
                np.testing.assert_array_equal(read.array(row), rows[name].astype(float))
