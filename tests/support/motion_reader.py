"""A reader of motion files written from docs/motion.md alone, in numpy: the reference for the
engine's.
"""

import json
import struct
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAGIC, FORMATS = b"ERGM", (2, 3)
MANIFEST, POINTS, FLIGHTS, FRAMES, ERGONS, CONTACTS, LEVELS, HANDS = range(1, 9)
STATE, INDEX, LINKS, SHAPES, NAMES, PEAKS, BROKEN, MAKER, BUNDLE = range(10, 19)
FLIGHT = np.dtype([("number", "<u4"), ("a", "<f4"), ("b", "<f4")])
ERGON = np.dtype(
    [("dt", "<f4"), ("point", "<u4"), ("impulse", "<f4"), ("speed", "<f4"), ("source", "<u4")]
)
CONTACT = np.dtype([("dt", "<f4"), ("contact", "<u4"), ("force", "<f4")])
BREAK = np.dtype([("dt", "<f4"), ("link", "<u4")])
HAND = np.dtype([("key", "<u4"), ("position", "<f4"), ("asked", "<f4")])

Chunk = tuple[int, float, bytes, int]  # kind, seconds, payload, byte at which it begins


def chunks(data: bytes) -> Iterator[Chunk]:
    """All chunks of a whole file; those of a bundle in its place."""
    assert data[:4] == MAGIC
    assert data[4] in FORMATS
    assert data[5:8] == bytes(3)
    position = 8
    while position < len(data):
        kind, version, length, seconds = struct.unpack_from("<HHId", data, position)
        assert version == 2
        end = position + 16 + length
        assert struct.unpack_from("<I", data, end) == (zlib.crc32(data[position:end]),)
        payload = data[position + 16 : end]
        if kind == BUNDLE:
            yield from ((*one, position) for one in bundled(payload))
        else:
            yield kind, seconds, payload, position
        position = end + 4


def bundled(payload: bytes) -> Iterator[tuple[int, float, bytes]]:
    """The chunks of a bundle: kind, seconds, payload."""
    data = zlib.decompress(payload[4:])
    assert struct.unpack_from("<I", payload) == (len(data),)
    position = 0

    def records(length: int, width: int) -> bytes:
        nonlocal position
        part = np.frombuffer(data, "u1", length, position)
        position += length
        full = length - length % width
        rows = part[:full].reshape(width, -1).T.ravel() if full else part[:0]
        return rows.tobytes() + part[full:].tobytes()

    while position < len(data):
        kind, width, count = struct.unpack_from("<HHI", data, position)
        position += 8
        instants = struct.unpack(f"<{count}d", records(8 * count, 8))
        lengths = struct.unpack(f"<{count}I", records(4 * count, 4))
        payloads = records(sum(lengths), width)
        for seconds, length in zip(instants, lengths, strict=True):
            yield kind, seconds, payloads[:length]
            payloads = payloads[length:]


class Bits:
    """A range coder's bits: the chance of a 0 is learnt."""

    def __init__(self, data: bytes) -> None:
        self.data, self.next = data, 5
        self.range, self.code = 2**32 - 1, int.from_bytes(data[1:5], "big")

    def plain(self, chance: int) -> int:
        """A bit of a known chance in steps of 2**-15."""
        bound = (self.range >> 15) * chance
        bit = int(self.code >= bound)
        if bit:
            self.code, self.range = self.code - bound, self.range - bound
        else:
            self.range = bound
        while self.range < 1 << 24:
            self.range <<= 8
            self.code = self.code << 8 | self.data[self.next]
            self.next += 1
        return bit

    def learn(self, chances: list[int], i: int) -> int:
        """A bit of a chance that moves by a sixteenth of the way."""
        bit = self.plain(chances[i])
        chances[i] += -(chances[i] >> 4) if bit else (32768 - chances[i]) >> 4
        return bit

    def number(self, lengths: list[int], firsts: list[int]) -> int:
        """A number >= 0: its length in ones, then its bits."""
        length = 0
        while self.learn(lengths, min(length, 20)):
            length += 1
        number = 1
        for place in range(length):
            bit = self.plain(16384) if place else self.learn(firsts, min(length, 20))
            number = 2 * number + bit
        return number - 1


def unpacked(data: bytes, count: int, n: int) -> NDArray[np.float64]:
    """Frames in the coding of a file (count, n) [m]."""

    def context() -> tuple[list[int], list[int]]:
        return [16384] * 21, [16384] * 21

    def signed(size: int) -> int:
        return -size if size and bits.plain(16384) else size

    unit, fine = struct.unpack_from("<dH", data)
    bits = Bits(data[10:])
    steps, firsts, differences = context(), context(), [context() for _ in range(15)]
    modes = [[16384] * 8 for _ in range(5)]
    code = mode = last = before_last = 0
    values = np.zeros((n + 2, count), dtype=np.int64)  # after two points that never move
    for point in range(2, n + 2):
        z = bits.number(*steps)
        code += -(z + 1) // 2 if z % 2 else z // 2
        x, (beside, second) = values[point], (values[point - 1], values[point - 2])
        for t in range(count):
            if t % 20 == 0:
                number = 1
                for _ in range(3):
                    number = 2 * number + bits.learn(modes[mode], number)
                mode = number - 8
                which = code if mode else fine
                step = 4 + which % 4 << which // 4
            if t == 0:
                x[0] = step * signed(bits.number(*firsts))
                continue
            level = min(14, ((2 * last + before_last + 1) // 2).bit_length())
            last, before_last = bits.number(*differences[level]), last
            by = (
                0,
                0,
                x[t - 1] - x[max(0, t - 2)],
                beside[t] - beside[t - 1],
                2 * (beside[t] - beside[t - 1]) - (second[t] - second[t - 1]),
            )[mode]
            x[t] = x[t - 1] + by + step * signed(last)
    assert bits.next == len(bits.data)
    return values[2:].T * unit


class Replica:
    """The positions of everything, as a page knows them."""

    def __init__(self, data: bytes) -> None:
        self.chunks = list(chunks(data))
        self.manifest: dict[str, Any] = json.loads(self.single_payload(MANIFEST))
        n, m = self.manifest["points"], self.manifest["modes"]
        table = self.single_payload(POINTS)
        assert struct.unpack_from("<I", table) == (n,)
        self.places = np.frombuffer(table, "<f4", 4 * n, 4).reshape(4, n).astype(float)
        self.omega, self.sigma = np.zeros(n + m), np.zeros(n + m)
        self.omega[:n] = np.frombuffer(table, "<f8", n, 4 + 16 * n)
        self.sigma[:n] = np.frombuffer(table, "<f8", n, 4 + 24 * n)
        self.names = self.single_payload(NAMES).decode().splitlines()
        self.shapes: dict[int, NDArray[np.float64]] = {}
        for kind, _, payload, _ in self.chunks:
            if kind == SHAPES:
                part, _, first, count, points = struct.unpack_from("<HHIII", payload)
                rates = np.frombuffer(payload, "<f8", 2 * count, 16)
                self.omega[n + first : n + first + count] = rates[:count]
                self.sigma[n + first : n + first + count] = rates[count:]
                shape = np.frombuffer(payload, "<f2", points * count, 16 + 16 * count)
                known = self.shapes.get(part, np.zeros((points, 0)))
                self.shapes[part] = np.hstack([known, shape.reshape(points, count)])

    def single_payload(self, kind: int) -> bytes:
        """The only payload of a kind."""
        (payload,) = (payload for own, _, payload, _ in self.chunks if own == kind)
        return payload

    def records(self, kind: int, dtype: np.dtype[Any]) -> list[tuple[float, NDArray[Any]]]:
        """All records of a kind, with the seconds of their chunks."""
        return [(t, np.frombuffer(p, dtype)) for own, t, p, _ in self.chunks if own == kind]

    def displacements(self, instants: NDArray[np.float64]) -> NDArray[np.float64]:
        """Displacements at rising instants (n, n_points); for sampled points those of the last
        frame.
        """
        n, m = self.manifest["points"], self.manifest["modes"]
        a, b, since = np.zeros(n + m), np.zeros(n + m), np.zeros(n + m)
        message = [(t, kind, p) for kind, t, p, _ in self.chunks if kind in (FLIGHTS, STATE)]
        frames = self.frames()
        out = np.full((len(instants), n), np.nan)
        next_told = 0
        for row, t in zip(out, instants, strict=True):
            while next_told < len(message) and message[next_told][0] <= t:
                t0, kind, payload = message[next_told]
                if kind == STATE:
                    a[:], b[:] = 0.0, 0.0
                rec = np.frombuffer(payload, FLIGHT)
                a[rec["number"]], b[rec["number"]], since[rec["number"]] = rec["a"], rec["b"], t0
                next_told += 1
            s = t - since
            swing = a * np.cos(self.omega * s) + np.where(
                self.omega == 0.0, b * s, b * np.sin(self.omega * s)
            )
            x = np.exp(-self.sigma * s) * swing
            for number, part in enumerate(self.manifest["parts"]):
                single = slice(part["first"], part["first"] + part["count"])
                if part["kind"] == "free":
                    row[single] = x[single]
                elif part["kind"] == "modal":
                    first = n + part["modes"]["first"]
                    row[single] = self.shapes[number] @ x[first : first + part["modes"]["count"]]
                elif part["kind"] == "sampled":
                    times, values = frames[number]
                    row[single] = values[np.searchsorted(times, t + 1e-9) - 1]
        return out

    def frames(self) -> dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """For each sampled part: instants (n,) and displacements (n, n_points)."""
        times: dict[int, list[float]] = {}
        rows: dict[int, list[NDArray[np.float64]]] = {}
        for kind, t, payload, _ in self.chunks:
            if kind != FRAMES:
                continue
            part, coding, _, count, hop = struct.unpack_from("<HBBId", payload)
            n = self.manifest["parts"][part]["count"]
            if coding == 0:
                values = np.frombuffer(payload, "<f4", count * n, 16).reshape(count, n)
            else:
                values = unpacked(payload[16:], count, n)
            times.setdefault(part, []).extend(t + hop * np.arange(count))
            rows.setdefault(part, []).append(values.astype(float))
        return {part: (np.array(times[part]), np.vstack(rows[part])) for part in times}
