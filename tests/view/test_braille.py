"""Pictures: the dots stand where the numbers say, and the same curves give the same text."""

import base64
import math
import re
import struct
import xml.etree.ElementTree as ET
import zlib

import numpy as np
import pytest

from ergon.view import braille, sound, svg
from ergon.view.curve import Curve, axis

T = [n / 200 for n in range(201)]
WAVE = Curve("asked", T, [math.sin(2 * math.pi * t) for t in T])


def dots(text: str) -> list[tuple[int, int]]:
    """(column, row) of every dot inside the axes, counted from the top left."""
    result = []
    rows = [line for line in text.splitlines() if "│" in line or "┤" in line]
    for y, line in enumerate(rows):
        body = re.split("[│┤]", line, maxsplit=1)[1]
        for x, character in enumerate(body):
            for bit, (dx, dy) in enumerate(
                [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2), (0, 3), (1, 3)]
            ):
                if 0x2800 <= ord(character) <= 0x28FF and (ord(character) - 0x2800) >> bit & 1:
                    result.append((2 * x + dx, 4 * y + dy))
    return result


def test_plot_sine_dots_at_values() -> None:
    text = braille.plot([WAVE], width=66, height=23)
    lines = text.splitlines()
    assert len(lines) == 23
    assert max(map(len, lines)) <= 66
    points = dots(text)
    across = max(x for x, _ in points)
    n_rows = 4 * 20 - 1
    by_column: dict[int, list[int]] = {}
    for x, y in points:
        by_column.setdefault(x, []).append(y)
    assert sorted(by_column) == list(range(across + 1))  # no gaps
    for x, ys in by_column.items():
        want = (1 - math.sin(2 * math.pi * x / across) / 1.08) / 2 * n_rows  # 4% of room
        assert min(ys) - 1.5 <= want <= max(ys) + 1.5


def test_plot_axes_with_round_numbers_and_units() -> None:
    text = braille.plot([WAVE], t_label="time [s]", x_label="position [mm]")
    assert "position [mm]" in text
    assert "time [s]" in text
    assert re.search(r"^ *1\.0 ┤", text, re.MULTILINE)
    assert re.search(r"^−1\.0 ┤", text, re.MULTILINE)


def test_plot_curves_distinct_without_colour() -> None:
    flat = [Curve(name, [0, 1], [0, 0]) for name in ("asked", "free", "done")]
    columns = [{x for x, _ in dots(braille.plot([curve]))} for curve in flat]
    assert columns[0] == columns[1] == columns[2]
    both = braille.plot([Curve("a", [0, 1], [0, 0]), Curve("b", [0, 1], [1, 1])])
    low = {x for x, y in dots(both) if y > 40}
    high = {x for x, y in dots(both) if y < 40}
    assert len(high) < 0.6 * len(low)
    assert "asked" in braille.plot(flat)
    assert "\x1b" not in both


def test_plot_curves_with_gaps_and_flat_curves() -> None:
    gap = Curve("a", [0, 1, 2, 3], [0, math.nan, 0, 1])
    columns = {x for x, _ in dots(braille.plot([gap]))}
    across = max(columns)
    assert not columns & set(range(2, int(across / 2)))
    assert dots(braille.plot([Curve("flat", [0, 1], [5, 5])]))
    assert braille.plot([Curve("none", [0, 1], [math.nan, math.inf])])
    assert braille.plot([Curve("none", [], [])])
    with pytest.raises(ValueError, match="1 to 3"):
        braille.plot([])


def test_plot_separate_strokes_not_joined() -> None:
    two_notes = Curve("notes", [0.0, 1.0, 1.0, 0.0, 1.0], [60.0, 60.0, math.nan, 72.0, 72.0])
    rows = {row for _, row in dots(braille.plot([two_notes], width=66, height=23))}
    assert len(rows) == 2


@pytest.mark.parametrize(
    ("low", "high", "ticks"),
    [(0, 10, (0, 2, 4, 6, 8, 10)), (-0.006, 0.0, 7), (98, 103, (98, 99, 100, 101, 102, 103))],
)
def test_axis_ticks_of_ranges(low: float, high: float, ticks: tuple[float, ...] | int) -> None:
    result = axis((low, high), 6)
    if isinstance(ticks, int):
        assert len(result.ticks) == ticks
        assert result.text(result.ticks[0]) == "−0.006"
    else:
        assert result.ticks == ticks
    assert result.low <= low
    assert result.high >= high


def test_svg_plot_well_formed_with_curve() -> None:
    text = svg.plot([WAVE, Curve("done <3>", T, T)], title="lean & mirror", x_label="position [mm]")
    root = ET.fromstring(text)
    space = "{http://www.w3.org/2000/svg}"
    words = [element.text for element in root.iter(f"{space}text")]
    assert {"asked", "done <3>", "lean & mirror", "position [mm]", "time [s]"} <= set(words)
    path = next(root.iter(f"{space}path")).attrib["d"]
    points = [tuple(map(float, p.split())) for p in re.findall(r"[ML]([\d. ]+)", path)]
    assert len(points) == 201
    assert min(points, key=lambda p: p[1])[0] == pytest.approx(points[50][0])
    assert text == svg.plot(
        [WAVE, Curve("done <3>", T, T)], title="lean & mirror", x_label="position [mm]"
    )


def unpacked(data: bytes) -> np.ndarray:
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    position, body, size = 8, b"", (0, 0)
    while position < len(data):
        (length,) = struct.unpack(">I", data[position : position + 4])
        name, content = (
            data[position + 4 : position + 8],
            data[position + 8 : position + 8 + length],
        )
        assert struct.unpack(">I", data[position + 8 + length : position + 12 + length])[
            0
        ] == zlib.crc32(name + content)
        if name == b"IHDR":
            size = struct.unpack(">II", content[:8])
        elif name == b"IDAT":
            body += content
        position += 12 + length
    rows = np.frombuffer(zlib.decompress(body), np.uint8).reshape(size[1], -1)
    assert not rows[:, 0].any()
    return rows[:, 1:].reshape(size[1], size[0], 3)


def test_spectrogram_tone_position() -> None:
    rate, n_frames, tone = 44_100, 22_050, 1000.0
    t = np.arange(n_frames) / rate
    block = np.sin(2 * np.pi * tone * t)[:, None] * np.ones(2)
    text = sound.picture([block[:10_000], block[10_000:]], n_frames, rate, "a tone")
    root = ET.fromstring(text)
    image = next(root.iter("{http://www.w3.org/2000/svg}image"))
    pixels = unpacked(base64.b64decode(image.attrib["href"].split(",")[1]))
    darkest = pixels[:, pixels.shape[1] // 2].astype(int).sum(axis=1).argmin()
    frequency = np.geomspace(rate / 2, 20, len(pixels) + 1)[darkest]
    assert frequency == pytest.approx(tone, rel=0.05)
    assert {"20", "1k", "10k"} <= {e.text for e in root.iter("{http://www.w3.org/2000/svg}text")}


def test_spectrogram_of_silence() -> None:
    ET.fromstring(sound.picture([np.zeros((100, 1))], 100, 44_100, "nothing"))


def test_plot_panels_with_common_time_axis():
    """Each as a plot by itself draws it, over the longest time and beside the widest label."""
    t = [i / 100 for i in range(201)]
    slow = Curve("slow", t, [math.sin(3 * x) for x in t])
    late = Curve("late", t[100:], [1000 * x for x in t[100:]])
    text = braille.panels([("a", [slow]), ("b", [late])], width=60, heights=[6, 8])
    lines = text.splitlines()
    assert len(lines) == 6 + 8 + 2
    assert lines[0].startswith("a")
    assert lines[6].startswith("b")
    assert lines[-1].endswith("time [s]")
    (edge,) = {re.search("[│┤]", line).start() for line in lines[1:6]}  # type: ignore[union-attr]
    assert all(line[edge] in "│┤" for line in (*lines[1:6], *lines[7:14]))
    # The later curve begins in the middle.
    middle = edge + 1 + (60 - edge - 1) // 2
    assert all(set(line[edge + 1 : middle - 1]) <= {"\u2800"} for line in lines[7:14])
    assert any(set(line[middle + 1 :]) - {"\u2800"} for line in lines[7:14])
