"""A small moving piece, and its `.motion` file, both written here from closed forms.

Five parts of different kinds: a galaxy of free cells, a string and a disc of sampled masses, a
plate of modes, keys; 24 loudspeakers in three rings; ergons of both signs; a
contact.
"""

from __future__ import annotations

import json
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
SECONDS, FPS = 4.0, 60.0
NONE = 2**32 - 1
(MANIFEST, POINTS, FLIGHTS, FRAMES, ERGONS, CONTACTS, LEVELS, HANDS) = range(1, 9)
(STATE, INDEX, LINKS, SHAPES, NAMES, PEAKS, BROKEN, MAKER, BUNDLE) = range(10, 19)
CELLS, WIRE, DISC, PLATE, KEYS = 200, 40, 60, 50, 2
MODES = 6


def chunk(kind: int, seconds: float, payload: bytes, version: int = 2) -> bytes:
    head = struct.pack("<HHId", kind, version, len(payload), seconds)
    return head + payload + struct.pack("<I", zlib.crc32(payload, zlib.crc32(head)))


def columns(records: bytes, width: int) -> bytes:
    """All first bytes of records, then all second ones; what is left over comes last."""
    full = len(records) - len(records) % width
    rows = np.frombuffer(records[:full], "u1").reshape(-1, width)
    return rows.T.tobytes() + records[full:]


def group(kind: int, width: int, members: list[tuple[float, bytes]]) -> bytes:
    """Chunks of a kind in a bundle."""
    seconds = np.array([t for t, _ in members], "<f8").tobytes()
    lengths = np.array([len(payload) for _, payload in members], "<u4").tobytes()
    payloads = columns(b"".join(payload for _, payload in members), width)
    head = struct.pack("<HHI", kind, width, len(members))
    return head + columns(seconds, 8) + columns(lengths, 4) + payloads


def bundle(groups: bytes) -> bytes:
    """The payload of a bundle."""
    return struct.pack("<I", len(groups)) + zlib.compress(groups)


def bundled(data: bytes) -> bytes:
    """A file of format 2 as one of format 3: all but frames and index in bundles."""
    widths = {FLIGHTS: 12, STATE: 12, ERGONS: 20, CONTACTS: 12, LEVELS: 96, POINTS: 4}
    out, position = b"ERGM\x03\0\0\0", 8
    held: dict[int, list[tuple[float, bytes]]] = {}
    while position < len(data):
        kind, _, length, seconds = struct.unpack_from("<HHId", data, position)
        payload = data[position + 16 : position + 16 + length]
        if held and kind in (STATE, INDEX):
            groups = b"".join(group(k, widths.get(k, 1), one) for k, one in held.items())
            out += chunk(BUNDLE, seconds, bundle(groups))
            held = {}
        if kind in (FRAMES, INDEX):
            out += data[position : position + 20 + length]
        else:
            held.setdefault(kind, []).append((seconds, payload))
        position += 20 + length
    return out


def dome() -> list[dict[str, object]]:
    """12 at 0°, 8 at 35°, 4 at 70°, 3 m away."""
    speakers = []
    for n, el in ((12, 0.0), (8, 35.0), (4, 70.0)):
        for k in range(n):
            az, up = np.radians(360 * k / n), np.radians(el)
            xyz = 3 * np.array([-np.sin(az) * np.cos(up), np.cos(az) * np.cos(up), np.sin(up)])
            speakers.append(
                {
                    "name": f"S{len(speakers) + 1}",
                    "channel": len(speakers),
                    "az": 360 * k / n,
                    "el": el,
                    "r": 3.0,
                    "xyz": xyz.tolist(),
                }
            )
    return speakers


@dataclass(frozen=True)
class Ergon:
    """One strike: its instant [s], its point, its impulse [N·s], and where it was written."""

    t: float
    point: int
    impulse: float
    source: int


class Piece:
    """The motion as formulas; `write` puts it into a file."""

    def __init__(self, seed: int = 5) -> None:
        rng = np.random.default_rng(seed)
        # A galaxy: radius by pitch; omega [rad/s], sigma [1/s].
        f = 20.0 * 500.0 ** rng.random(CELLS)
        radius = 0.3 + 0.7 * np.log(10_000 / f) / np.log(500)
        angle = 2 * np.pi * rng.random(CELLS)
        self.omega = 2 * np.pi * f
        self.sigma = np.log(1000) / (0.5 + 2 * rng.random(CELLS))
        sky = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * f])
        wire = np.stack([np.linspace(-1, 1, WIRE), np.full(WIRE, -1.3), np.zeros(WIRE)])
        turn = np.arange(DISC) * 2.399963
        disc = 0.4 * np.sqrt((np.arange(DISC) + 0.5) / DISC) * [np.cos(turn), np.sin(turn)]
        disc = np.stack([disc[0] - 1.2, disc[1] - 0.6, np.full(DISC, 0.5)])
        plate = np.stack([np.linspace(0.9, 1.7, PLATE), np.full(PLATE, -0.6), np.full(PLATE, 0.3)])
        keys = np.stack([[-0.1, 0.1], [-1.8, -1.8], [0.0, 0.0]])
        self.xyz = np.concatenate([sky, wire, disc, plate, keys], axis=1)
        self.rest = np.zeros(self.n)
        self.rest[-1] = 0.02
        self.mode_omega = 2 * np.pi * 70.0 * np.arange(1, MODES + 1)
        self.mode_sigma = 1.0 + 0.5 * np.arange(MODES)
        x = np.linspace(0, np.pi, PLATE)[:, None]
        # Rounded as half-precision numbers.
        self.shapes = np.sin(x * np.arange(1, MODES + 1)).astype("<f2").astype(float)
        # Each cell is struck a few times; each strike begins a new flight.
        self.ergons: list[Ergon] = []
        for cell in range(CELLS):
            for t in np.sort(rng.uniform(0.3, SECONDS - 0.2, 3)):
                self.ergons.append(Ergon(float(t), cell, float(rng.choice([-1, 1]) * 4e-6), 0))
        self.ergons.append(Ergon(1.5, self.first("plate") + 25, 2e-3, 1))
        self.ergons.sort(key=lambda e: e.t)
        self._flights = self._fly()

    @property
    def n(self) -> int:
        return self.xyz.shape[1]

    def first(self, part: str) -> int:
        names = ["sky", "wire", "disc", "plate", "keys"]
        return sum((CELLS, WIRE, DISC, PLATE, KEYS)[: names.index(part)])

    def _fly(self) -> list[tuple[float, int, float, float]]:
        """(t0, number, a, b): each strike adds impulse / mass (1 g) to the velocity."""
        all_: list[tuple[float, int, float, float]] = []
        last: dict[int, tuple[float, float, float]] = {}
        for e in self.ergons:
            if e.point >= CELLS:
                all_ += [(e.t, self.n + m, 0.0, 1e-3 / (m + 1)) for m in range(MODES)]
                continue
            x, v = 0.0, 0.0
            w, s = self.omega[e.point], self.sigma[e.point]
            if e.point in last:
                t0, a, b = last[e.point]
                d = e.t - t0
                fall, c, si = np.exp(-s * d), np.cos(w * d), np.sin(w * d)
                x = fall * (a * c + b * si)
                v = -s * x + fall * w * (b * c - a * si)
            v += e.impulse / 1e-3
            # Rounded as a file stores them.
            a, b = (float(np.float32(q)) for q in (x, (v + s * x) / w))
            last[e.point] = (e.t, a, b)
            all_.append((e.t, e.point, a, b))
        return sorted(all_)

    def _free(self, number: int, omega: float, sigma: float, t: float) -> float:
        begun = [f for f in self._flights if f[1] == number and f[0] <= t]
        if not begun:
            return 0.0
        t0, _, a, b = begun[-1]
        d = t - t0
        return float(np.exp(-sigma * d) * (a * np.cos(omega * d) + b * np.sin(omega * d)))

    def displacement(self, t: float) -> Floats:
        """Of each point [m]."""
        z = np.zeros(self.n)
        for p in range(CELLS):
            z[p] = self._free(p, self.omega[p], self.sigma[p], t)
        q = [
            self._free(self.n + m, self.mode_omega[m], self.mode_sigma[m], t) for m in range(MODES)
        ]
        position = self.first("plate")
        z[position : position + PLATE] = self.shapes @ np.array(q)
        for part in ("wire", "disc", "keys"):
            sampled = self.sampled(part, t)
            z[self.first(part) : self.first(part) + len(sampled)] = sampled
        return z

    def sampled(self, part: str, t: float) -> Floats:
        """Displacements of a part; the motion is slow enough for linear interpolation between
        frames.
        """
        if part == "wire":
            return 1e-3 * np.sin(np.linspace(0, np.pi, WIRE)) * np.cos(2 * np.pi * t)
        if part == "disc":
            return 2e-3 * np.linspace(-1, 1, DISC) * np.sin(2 * np.pi * 1.5 * t)
        return np.array([4e-3 * np.sin(2 * np.pi * 0.5 * t), 0.0])

    def level(self, i: int, t: float) -> float:
        return 0.5 * 10 ** (-i / 20) * (1 + 0.5 * np.sin(t))

    def manifest(self) -> dict[str, object]:
        def part(name: str, count: int, kind: str, layout: str) -> dict[str, object]:
            return {
                "name": name,
                "first": self.first(name),
                "count": count,
                "kind": kind,
                "layout": layout,
                "why": None,
                "modes": {"first": 0, "count": MODES, "of": MODES} if kind == "modal" else None,
                "exaggeration": None,
            }

        key = self.first("keys")
        return {
            "made_by": "made by ergon 0.0.0",
            "format": 2,
            "title": "Example",
            "rate": 44100.0,
            "fps": FPS,
            "duration": SECONDS,
            "points": self.n,
            "modes": MODES,
            "parts": [
                part("sky", CELLS, "free", "bank"),
                part("wire", WIRE, "sampled", "string"),
                part("disc", DISC, "sampled", "plate"),
                part("plate", PLATE, "modal", "plate"),
                part("keys", KEYS, "sampled", "key"),
            ],
            "keys": [
                {"name": "k1", "point": key, "player": "ada", "hand": False},
                {"name": "k2", "point": key + 1, "player": "ada", "hand": True},
            ],
            "contacts": [{"name": "beater", "a": key, "b": self.first("plate") + 25}],
            "speakers": dome(),
            "sources": [
                {"name": "rain", "file": "example.yaml", "line": 12},
                {"name": "roll", "file": "example.yaml", "line": 14},
            ],
            "marks": [{"name": "A", "seconds": 0.0}, {"name": "B", "seconds": 2.0}],
        }

    def bytes(self) -> bytes:
        """The whole file."""
        out = b"ERGM\x02\0\0\0" + chunk(MANIFEST, 0, json.dumps(self.manifest()).encode())
        rows = np.concatenate([self.xyz, self.rest[None]]).astype("<f4")
        rates = np.zeros((2, self.n))
        rates[:, :CELLS] = self.omega, self.sigma
        out += chunk(POINTS, 0, struct.pack("<I", self.n) + rows.tobytes() + rates.tobytes())
        out += chunk(NAMES, 0, "".join(f"{self.name(p)}\n" for p in range(self.n)).encode())
        wire = self.first("wire") + np.arange(WIRE - 1)
        links = np.stack([wire, wire + 1], axis=1).astype("<u4")
        out += chunk(LINKS, 0, struct.pack("<I", len(links)) + links.tobytes())
        shapes = struct.pack("<HHIII", 3, 0, 0, MODES, PLATE)
        shapes += np.stack([self.mode_omega, self.mode_sigma]).astype("<f8").tobytes()
        out += chunk(SHAPES, 0, shapes + self.shapes.astype("<f2").tobytes())
        segments = []
        for second in range(int(SECONDS)):
            segments.append((float(second), len(out)))
            out += self._segment(second)
        peaks = self.peaks().astype("<f4").tobytes()
        index = struct.pack("<IId", len(segments), 5, SECONDS) + peaks
        index += b"".join(struct.pack("<dQ", *s) for s in segments) + struct.pack("<Q", len(out))
        return out + chunk(INDEX, SECONDS, index)

    def write(self, path: Path) -> Path:
        path.write_bytes(self.bytes())
        return path

    def name(self, point: int) -> str:
        starts = [(n, self.first(n)) for n in ("sky", "wire", "disc", "plate", "keys")]
        part, first = [s for s in starts if s[1] <= point][-1]
        return f"{part}.{point - first}"

    def peaks(self) -> Floats:
        largest = max(float(np.hypot(a, b)) for _, i, a, b in self._flights if i < CELLS)
        return np.array([largest, 1e-3, 2e-3, 2e-3, 4e-3])

    def _segment(self, second: int) -> bytes:
        state = b""
        for number in sorted({f[1] for f in self._flights if f[0] <= second}):
            t0, _, a, b = [f for f in self._flights if f[1] == number and f[0] <= second][-1]
            omega, sigma = (
                (self.omega[number], self.sigma[number])
                if number < self.n
                else (self.mode_omega[number - self.n], self.mode_sigma[number - self.n])
            )
            d = second - t0
            fall, c, s = np.exp(-sigma * d), np.cos(omega * d), np.sin(omega * d)
            state += struct.pack("<Iff", number, fall * (a * c + b * s), fall * (b * c - a * s))
        out = chunk(STATE, second, state)
        out += chunk(PEAKS, second, self.peaks().astype("<f4").tobytes())
        for part, name in ((1, "wire"), (2, "disc"), (4, "keys")):
            out += self._frames(part, name, second)
        for f in self._flights:
            if second <= f[0] < second + 1:
                out += chunk(FLIGHTS, f[0], struct.pack("<Iff", *f[1:]))
        for e in self.ergons:
            output = max(0.0, e.t - 1)
            if second <= output < second + 1:
                row = struct.pack("<fIffI", e.t - output, e.point, e.impulse, np.nan, e.source)
                out += chunk(ERGONS, output, row)
        for k in range(int(FPS)):
            t = second + k / FPS
            row = [self.level(i, t) for i in range(24)]
            out += chunk(LEVELS, t, np.array(row, "<f4").tobytes())
        if second == 1:
            out += chunk(CONTACTS, 1.5, struct.pack("<fIf", 0.0, 0, 12.0))
        return out

    def _frames(self, part: int, name: str, second: int) -> bytes:
        n = int(FPS)
        rows = np.array([self.sampled(name, second + k / FPS) for k in range(n)])
        head = struct.pack("<HBBId", part, 0, 0, n, 1 / FPS)
        return chunk(FRAMES, second, head + rows.astype("<f4").tobytes())
