"""Scala files as other programs write them, read by ours and by a few lines of Python."""

from __future__ import annotations

import random
import re
from fractions import Fraction

import pytest

from ergon.notation.tables.scala import parse_key_map, parse_scale

_COMMENTS = ["! a comment", "!", "!3/2", "! caf\x85 \x0c \u2028 12", "!! 5"]


def _joined(chance: random.Random, lines: list[str]) -> str:
    """The lines with comments between them, and the line ends of some system."""
    rows = []
    for line in lines:
        while chance.random() < 0.3:
            rows.append(chance.choice(_COMMENTS))
        rows.append(line)
    newline = chance.choice(["\n", "\r\n", "\r"])
    return newline.join(rows) + chance.choice(["", newline, newline * 2])


def _pitch(chance: random.Random) -> str:
    word = chance.choice([
        f"{chance.uniform(-100, 2400):.5f}", f"{chance.randrange(1, 1200)}.",
        f"{chance.randrange(1, 40)}/{chance.randrange(1, 40)}", f"{chance.randrange(1, 9)}",
        f"{chance.uniform(1, 1200):.3f} cents", f"{chance.randrange(1, 40)}/7 a comment",
        f"{2**chance.randrange(1, 40)}/{3**chance.randrange(1, 25)}",
    ])  # fmt: skip
    return chance.choice(["", " ", "  ", "\t"]) + word + chance.choice(["", " ", "\t! text"])


def _ratio(line: str) -> float:
    """By the format's rule: what has a period is cents, else a ratio."""
    word = line.split()[0]
    return 2.0 ** (float(word) / 1200) if "." in word else float(Fraction(word))


@pytest.mark.parametrize("seed", range(50))
def test_scales_of_other_programs(seed: int) -> None:
    chance = random.Random(seed)
    pitches = [_pitch(chance) for _ in range(chance.choice([1, 5, 7, 12, 53, 311]))]
    title = chance.choice(["", "A scale", "12", "Mean\x85tone by Grün", " 3/2 "])
    count = chance.choice(["{}", " {}", "{} notes", "\t{}"]).format(len(pitches))
    behind = chance.choice([[], ["! end"], ["text behind the last degree"]])
    text = _joined(chance, ["! x.scl", title, count, *pitches, *behind])
    scale = parse_scale(text)
    assert scale.title == title.strip()
    assert scale.ratios == pytest.approx([_ratio(line) for line in pitches], rel=1e-14)


@pytest.mark.parametrize("seed", range(50))
def test_keyboard_maps_of_other_programs(seed: int) -> None:
    chance = random.Random(seed)
    size, octave = chance.choice([0, 7, 12, 16]), chance.choice([0, 7, 12])
    cells = [chance.choice(["x", "X", str(i), f"{i} ! key"]) for i in range(size)]
    cells[:1] = ["0"] if size else []
    frequency = chance.choice(["440", "440.0", "261.625565", "432.000000"])
    reference = chance.choice([60, 60 + size, 60 - size])
    shown = cells[: len(cells) - chance.choice([0, 0, 2])] if size > 7 else cells
    lines = [f"{size}", "0", "127", "60", f"{reference} a comment", frequency, f"{octave}"]
    key_map = parse_key_map(_joined(chance, ["! x.kbm", *lines, *shown]))
    assert (key_map.middle, key_map.reference, key_map.octave) == (60, reference, octave)
    assert key_map.frequency == float(frequency)
    degrees = [int(match[0]) if (match := re.match(r"\d+", cell)) else None for cell in shown]
    assert list(key_map.degrees) == degrees + [None] * (size - len(shown))
