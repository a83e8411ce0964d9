"""Files of motion capture, written by hand from the specifications of their formats."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
PROCESSORS = {"intel": 84, "dec": 85, "mips": 86}


def curve(n: int = 12, points: int = 2) -> Floats:
    """Positions (n, points, 3) [mm], multiples of a sixteenth, which 32-bit floats hold exactly."""
    t = np.arange(n)[:, None, None] + 5 * np.arange(points)[:, None] + 0.5 * np.arange(3)
    return np.round(16 * 40 * np.sin(t / 3)) / 16


# --- TRC ------------------------------------------------------------------------------------------


def trc(
    places: Floats,
    names: Sequence[str] = ("RWRI", "LWRI"),
    unit: str = "mm",
    rate: float = 100.0,
    *,
    blank: bool = True,
    last_tab: bool = False,
    end: str = "\n",
    step: float | None = None,
) -> bytes:
    """A TRC file of positions (n, points, 3), with empty cells where a point is hidden."""
    n, n_points = places.shape[:2]
    fields = "DataRate CameraRate NumFrames NumMarkers Units OrigDataRate OrigDataStartFrame "
    values = [f"{rate:g}", f"{rate:g}", n, n_points, unit, f"{rate:g}", 1, n]
    axes = "\t".join(f"X{i}\tY{i}\tZ{i}" for i in range(1, n_points + 1))
    text = ["PathFileType\t4\t(X/Y/Z)\twalk.trc", *["\t".join([*fields.split(), "OrigNumFrames"])]]
    text += ["\t".join(map(str, values)), "Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t"]
    text += ["\t\t" + axes, *[""] * blank]
    for i, frame in enumerate(places):
        cells = ["" if np.isnan(x) else repr(float(x)) for x in frame.ravel()]
        row = [str(i + 1), f"{i * (step or 1 / rate):.5f}", *cells, *[""] * last_tab]
        text.append("\t".join(row))
    return (end.join(text) + end).encode()


# --- C3D ------------------------------------------------------------------------------------------


class _Numbers:
    def __init__(self, processor: str) -> None:
        self.order = ">" if processor == "mips" else "<"
        self.is_dec = processor == "dec"

    def word(self, value: int) -> bytes:
        return struct.pack(f"{self.order}H", value & 0xFFFF)

    def real(self, value: float) -> bytes:
        if not self.is_dec:
            return struct.pack(f"{self.order}f", value)
        # VAX F: sign, exponent with a bias of 129, fraction after a hidden half; high half first.
        if value == 0:
            return bytes(4)
        fraction, exponent = np.frexp(abs(value))
        bits = (value < 0) << 31 | (int(exponent) + 128) << 23 | round(fraction * 2**24) - 2**23
        return struct.pack("<HH", bits >> 16, bits & 0xFFFF)


def c3d(
    places: Floats,
    names: Sequence[str] = ("RWRI", "LWRI"),
    processor: str = "intel",
    scale: float = -1.0,
    unit: str | None = "mm",
    rate: float = 100.0,
    analog: int = 0,
    parameters: Sequence[tuple[int, str, int, tuple[int, ...], bytes]] = (),
    last: int | None = None,
    stated_analog: int | None = None,
    stated_points: int | None = None,
    samples: int = 1,
) -> bytes:
    """A C3D file of positions (n, points, 3), NaN where a point is hidden.

    A positive `scale` writes 16 bits a number; `analog` words follow each frame, in `samples`. The
    header states `stated_points` and `stated_analog` if they are not the true numbers.
    """
    single, n, points = _Numbers(processor), len(places), places.shape[1]
    groups = [(-1, "POINT"), (-2, "TRIAL"), (-3, "ANALOG")]
    width = max(map(len, names), default=1)
    labels = "".join(name.ljust(width) for name in names).encode()
    each = [
        (1, "USED", 2, (), single.word(points)),
        (1, "SCALE", 4, (), single.real(scale)),
        (1, "RATE", 4, (), single.real(rate)),
        (1, "LABELS", -1, (width, len(names)), labels),
        *parameters,
    ]
    if unit is not None:
        each.append((1, "UNITS", -1, (len(unit),), unit.encode()))
    body = bytes((0, 0, 1, PROCESSORS[processor]))
    for number, name in groups:
        rest = b"\0"
        body += struct.pack("bb", len(name), number) + name.encode()
        body += single.word(2 + len(rest)) + rest
    for group, name, kind, dimensions, data in each:
        rest = struct.pack("bB", kind, len(dimensions)) + bytes(dimensions) + data + b"\0"
        body += struct.pack("bb", len(name), group) + name.encode()
        body += single.word(2 + len(rest)) + rest
    body = body.ljust(512, b"\0")
    assert len(body) == 512
    head = bytes((2, 0x50)) + single.word(points if stated_points is None else stated_points)
    head += single.word(analog if stated_analog is None else stated_analog) + single.word(1)
    head += (
        single.word(min(n if last is None else last, 0xFFFF)) + single.word(10) + single.real(scale)
    )
    head += single.word(3) + single.word(samples) + single.real(rate)
    data = b""
    for frame in places:
        for place in frame:
            hidden = np.isnan(place).any()
            values = np.where(hidden, 0.0, place)
            if scale < 0:
                data += b"".join(single.real(float(x)) for x in (*values, -1.0 if hidden else 0.0))
            else:
                words = [round(float(x) / scale) for x in values]
                data += b"".join(single.word(w) for w in (*words, -1 if hidden else 0))
        data += (single.real(7.0) if scale < 0 else single.word(7)) * analog
    return head.ljust(512, b"\0") + body + data


# --- BVH ------------------------------------------------------------------------------------------

SKELETON = """HIERARCHY
ROOT hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT arm
  {
    OFFSET 0 10 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    JOINT hand {
      OFFSET 20 0 0
      CHANNELS 3 Zrotation Yrotation Xrotation
      End Site
      {
        OFFSET 5 0 0
      }
    }
  }
}
"""


def bvh(rows: Floats, period: float = 0.01, skeleton: str = SKELETON) -> bytes:
    """A BVH file of frames (n, channels)."""
    lines = "".join(" ".join(f"{x:.9g}" for x in row) + "\n" for row in rows)
    head = f"MOTION\nFrames: {len(rows)}\nFrame Time: {period:.9g}\n"
    return f"{skeleton}{head}{lines}".encode()


# --- TSV of QTM -----------------------------------------------------------------------------------


def qtm(
    places: Floats,
    names: Sequence[str] = ("RWRI", "LWRI"),
    rate: str = "100",
    titles: bool = False,
    hidden: str = "0.000",
    leading: int = 0,
) -> bytes:
    """A file of QTM of positions (n, points, 3) [mm]; `leading` columns: frame, time."""
    head = f"NO_OF_FRAMES\t{len(places)}\nNO_OF_CAMERAS\t8\nNO_OF_MARKERS\t{len(names)}\n"
    head += f"FREQUENCY\t{rate}\nNO_OF_ANALOG\t0\nANALOG_FREQUENCY\t0\nDESCRIPTION\t--\n"
    head += "TIME_STAMP\t2026-11-22, 04:00:00.000\t12.5\nDATA_INCLUDED\t3D\n"
    head += "MARKER_NAMES\t" + "\t".join(names) + "\n"
    head += "TRAJECTORY_TYPES\t" + "\t".join(["Measured"] * len(names)) + "\n"
    if titles:
        item = [f"{name} {axis}" for name in names for axis in "XYZ"]
        head += "\t".join([*("Frame", "Time")[:leading], *item]) + "\n"
    for i, frame in enumerate(places):
        cells = [str(i + 1), f"{i / 100:.5f}"][:leading]
        cells += [hidden if np.isnan(x) else f"{x:.4f}" for x in frame.ravel()]
        head += "\t".join(cells) + "\n"
    return head.encode()


def qtm_bodies(
    places: Floats,
    names: Sequence[str] = ("RWRI", "LWRI"),
    titles: bool = True,
    leading: int = 2,
) -> bytes:
    """A 6D file of QTM of bodies at positions (n, bodies, 3) [mm], which turn."""
    head = f"NO_OF_FRAMES\t{len(places)}\nNO_OF_CAMERAS\t4\nNO_OF_BODIES\t{len(names)}\n"
    head += "FREQUENCY\t100\nNO_OF_ANALOG\t0\nANALOG_FREQUENCY\t0\nDESCRIPTION\t--\n"
    head += "TIME_STAMP\t2026-11-22, 04:00:00\t12.5\nDATA_INCLUDED\t6D\n"
    head += "BODY_NAMES\t" + "\t".join(names) + "\n"
    if titles:
        turns = ["Roll", "Pitch", "Yaw", "Residual", *(f"Rot[{i}]" for i in range(9))]
        item = [title for name in names for title in (f"{name} X", "Y", "Z", *turns)]
        head += "\t".join([*("Frame", "Time")[:leading], *item]) + "\n"
    for i, frame in enumerate(places):
        cells = [str(i + 1), f"{i / 100:.5f}"][:leading]
        for place in frame:
            is_seen = np.isfinite(place).all()
            angle = 0.01 * i
            spin = [math.cos(angle), math.sin(angle), 0, -math.sin(angle), math.cos(angle), 0, 0, 0]
            turn = [0.0, 0.0, math.degrees(angle), 1.5, *spin, 1]
            values = [*place, *turn] if is_seen else [0.0] * 16
            cells += [f"{value:.5f}" for value in values]
        head += "\t".join(cells) + "\n"
    return head.encode()


# --- CSV of Motive --------------------------------------------------------------------------------


def optitrack(
    places: Floats,
    names: Sequence[str] = ("Hand:RWRI", "Hand:LWRI"),
    head: str = "",
    version: float = 1.25,
    unit: str = "Millimeters",
    timed: bool = False,
) -> bytes:
    """A file of Motive of markers at positions (n, points, 3), after a rigid body that turns;
    those before 1.2 have no words before their rows, `timed` ones a column of time codes."""
    is_old = version < 1.2
    words = iter(("", "") if is_old else ("Type", "Name", "ID", "Parent"))
    code = ("",) * timed
    head = head or f"Export Frame Rate,100.000000,Total Exported Frames,{len(places)}"
    first = f'Format Version,{version},Take Name,"a, b",{head},Rotation Type,Quaternion'
    rows = [f"{first},Length Units,{unit},Coordinate Space,Global", ""]
    body = "XYZWXYZ"

    def row(own: str, each: Sequence[str]) -> None:
        cells = ["", next(words, ""), *code, *[own] * len(body)]
        rows.append(",".join([*cells, *(cell for cell in each for _ in "XYZ")]))

    row("Rigid Body", ["Marker"] * len(names))
    row('"Board 1"', names)
    row("7", [str(i) for i in range(len(names))])
    if not is_old:
        row("", ["Hand"] * len(names))
    components = ["Rotation"] * 4 + ["Position"] * 3 * (1 + len(names))
    rows.append(",".join(["", "", *code, *components]))
    axes = body + "XYZ" * len(names)
    rows.append(",".join(["Frame", "Time (Seconds)", *("Timecode",) * timed, *axes]))
    for i, frame in enumerate(places):
        cells = [str(i), f"{i / 100:.6f}", *("15:26:46:12.02",) * timed, "0", "0", "0", "1"]
        cells += [f"{i}.5", "0", "7"]
        cells += ["" if np.isnan(x) else f"{x:.6f}" for x in frame.ravel()]
        rows.append(",".join(cells))
    return ("\r\n".join(rows) + "\r\n").encode()


# --- SDIF -----------------------------------------------------------------------------------------


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % 8)


def matrix(name: bytes, values: Floats, kind: int = 8) -> bytes:
    """A matrix of SDIF: 8 is f64, 4 is f32, 0x104 is i32."""
    form = {8: ">f8", 4: ">f4", 0x104: ">i4"}[kind]
    head = struct.pack(">4sIII", name, kind, *values.shape)
    return _padded(head + values.astype(form).tobytes())


def frame(name: bytes, t: float, *matrices: bytes, stream: int = 0) -> bytes:
    """A frame of SDIF."""
    body = struct.pack(">dii", t, stream, len(matrices)) + b"".join(matrices)
    return name + struct.pack(">I", len(body)) + body


def declared(text: str) -> bytes:
    """A frame of SDIF that names the columns."""
    data = text.encode()
    single = _padded(struct.pack(">4sIII", b"1TYP", 0x301, len(data), 1) + data)
    return frame(b"1TYP", -np.inf, single, stream=-2)


def sdif(*frames: bytes) -> bytes:
    """A file of SDIF."""
    return b"SDIF" + struct.pack(">III", 8, 3, 1) + b"".join(frames)


def moving(t: Floats, x: Floats, stream: int = 0) -> bytes:
    """Frames XMOV with a matrix XPOS of a row x, (n, columns)."""
    single = (
        frame(b"XMOV", position, matrix(b"XPOS", row[None]), stream=stream)
        for position, row in zip(t, x, strict=True)
    )
    return b"".join(single)
