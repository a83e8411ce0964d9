"""Pictures of structures: points stand where the numbers say, and no label lies on another."""

import re
import xml.etree.ElementTree as ET
from itertools import combinations
from math import pi, sin

import pytest

from ergon.view import structure
from ergon.view.curve import Curve
from ergon.view.structure import PitchedMode, Shape

SVG = "{http://www.w3.org/2000/svg}"
_LETTER = 6.8  # pixels of a wide letter of 12 pixels; few are


def boxes(picture: str) -> list[tuple[str, float, float, float, float]]:
    """Words of a picture, and the box (left, top, right, bottom) that they take."""
    result = []
    for item in ET.fromstring(picture).iter(f"{SVG}text"):
        words, x, y = item.text or "", float(item.get("x", "0")), float(item.get("y", "0"))
        long = _LETTER * len(words)
        left = x - {"start": 0.0, "middle": long / 2, "end": long}[item.get("text-anchor", "start")]
        if item.get("transform"):  # upwards, about its own place
            result.append((words, x - 10, y - long / 2, x + 3, y + long / 2))
        else:
            result.append((words, left, y - 10, left + long, y + 3))
    return result


def labels_are_apart(picture: str) -> None:
    page = ET.fromstring(picture)
    width, height = float(page.get("width", "0")), float(page.get("height", "0"))
    result = boxes(picture)
    for words, left, top, right, bottom in result:
        assert min(left, top, width - right, height - bottom) >= 0, words
    for (a, *item), (b, *other) in combinations(result, 2):
        is_apart = (
            item[0] >= other[2] or other[0] >= item[2] or item[1] >= other[3] or other[1] >= item[3]
        )
        assert is_apart, f"'{a}' lies on '{b}'"


@pytest.mark.parametrize("span", [(20.0, 5000.0), (0.01, 20000.0), (430.0, 460.0), (90.0, 130.0)])
@pytest.mark.parametrize("names", [1, 3])
def test_admittance_picture_labels_and_curves(span: tuple[float, float], names: int):
    f = [span[0] * (span[1] / span[0]) ** (i / 50) for i in range(51)]
    curves = [
        Curve(f"velocity of a-long-name.of-a-mass.{i}", f, [i - x / 9 for x in f])
        for i in range(names)
    ]
    picture = structure.admittance(
        curves, title="Admittance: force at bell.string.centre of it all"
    )
    labels_are_apart(picture)
    assert picture.count("<path") == names
    ticks = [words for words, *_ in boxes(picture) if re.fullmatch(r"[\d.]+k?", words)]
    assert len(ticks) >= 3
    with pytest.raises(ValueError, match="1 to 3 curves"):
        structure.admittance([], title="none")


@pytest.mark.parametrize("count", [0, 1, 5, 60, 90])
def test_stave_picture_of_mode_counts(count: int):
    modes = [
        PitchedMode(110.0 * (1 + i * 0.03), (7.0 * i) % 100 - 50, f"{i + 1}  Eb4 −12.3  12.5 s")
        for i in range(count)
    ]
    picture = structure.stave(
        [("bell", modes), ("other-bell", modes[:2])], title="Modes of bells.yaml"
    )
    labels_are_apart(picture)
    assert ("bell: none of its modes is a note" in picture) == (count == 0)
    circles = list(ET.fromstring(picture).iter(f"{SVG}circle"))
    assert len(circles) == min(count, 60) + min(count, 2)
    assert ("the first 60 of 90 modes" in picture) == (count == 90)


def test_stave_picture_dot_position():
    modes = [PitchedMode(440.0, 0.0, "A4"), PitchedMode(440.0 * 2 ** (0.25 / 12), 25.0, "A4 +25")]
    picture = structure.stave([("a", modes)], title="")
    (x0, y0), (x1, y1) = sorted(
        (float(c.get("cx", "0")), float(c.get("cy", "0")))
        for c in ET.fromstring(picture).iter(f"{SVG}circle")
    )
    frame = next(r for r in ET.fromstring(picture).iter(f"{SVG}rect") if r.get("fill") == "none")
    left, width = float(frame.get("x", "0")), float(frame.get("width", "0"))
    top, height = float(frame.get("y", "0")), float(frame.get("height", "0"))
    assert x0 == pytest.approx(left + width / 2, abs=0.1)
    assert x1 == pytest.approx(left + 80 / 110 * width, abs=0.1)
    assert y0 == pytest.approx(top + height * (1 - 9 / 12), abs=0.1)  # A above C4, in one octave
    assert y0 - y1 == pytest.approx(height * 0.25 / 12, abs=0.11)


def test_shape_pictures_of_row_and_plate():
    n = 24
    row = [
        Shape(
            f"{k}  D4 +0.0  T60 2.33 s and more words",
            range(n),
            [0.0] * n,
            [sin(pi * k * (i + 1) / (n + 1)) for i in range(n)],
        )
        for k in range(1, 15)
    ]
    places = [(x, y) for x in range(9) for y in range(5)]
    plate = [
        Shape(
            "1  C3", [x for x, _ in places], [y for _, y in places], [x - 4.0 for x, _ in places]
        ),
        Shape("2  one mass", [1.0], [2.0], [0.0]),
    ]
    picture = structure.shapes([("wire", row), ("plate", plate)], title="Shapes")
    labels_are_apart(picture)
    assert "the first 12 of 14 modes" in picture
    circles = list(ET.fromstring(picture).iter(f"{SVG}circle"))
    assert len([c for c in circles if c.get("stroke")]) == 20  # downwards: hollow
    for item in circles:
        assert 0 <= float(item.get("cx", "0")) <= 800
