"""BVH and TRC files as other programs write them, beside positions computed by scipy and numpy."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ergon.scores.gesture import bvh_file, trc_file


class _Skeleton:
    """A random skeleton, its words as a file has them, and its places by scipy."""

    def __init__(self, seed: int) -> None:
        self.chance = random.Random(seed)
        self.words: list[str] = ["HIERARCHY"]
        self.joints: list[tuple[int | None, np.ndarray, list[str], int]] = []
        self.n_channels = 0
        for _ in range(self.chance.choice([1, 1, 2])):
            self._joint(None, 0)

    def _case(self, word: str) -> str:
        return (
            word if self.chance.random() < 0.8 else self.chance.choice([word.upper(), word.lower()])
        )

    def _offset(self) -> list[str]:
        forms = ["{:.6f}", "{:g}", "{:.3e}", "{:.0f}."]
        return [self.chance.choice(forms).format(self.chance.uniform(-20, 20)) for _ in range(3)]

    def _joint(self, parent: int | None, depth: int) -> None:
        chance, number = self.chance, len(self.joints)
        name = chance.choice(["Hips", "left arm", "mixamorig:Spine", "a.b"])
        self.words += [self._case("ROOT" if parent is None else "JOINT"), *name.split(), "{"]
        offset = self._offset()
        self.words += [self._case("OFFSET"), *offset]
        axes = chance.sample(
            ["Xrotation", "Yrotation", "Zrotation"], chance.choice([0, 1, 3, 3, 3])
        )
        places = ["Xposition", "Yposition", "Zposition"]
        named = [*(places if parent is None or chance.random() < 0.2 else []), *axes]
        if chance.random() < 0.2:
            named = [*axes, *named[: len(named) - len(axes)]]
        self.words += [self._case("CHANNELS"), str(len(named)), *map(self._case, named)]
        self.joints.append((parent, np.array(offset, float), named, self.n_channels))
        self.n_channels += len(named)
        if depth < 3:
            for _ in range(chance.randrange(3)):
                self._joint(number, depth + 1)
        if chance.random() < 0.6:
            end = self._offset()
            self.words += [
                self._case("End"),
                self._case("Site"),
                "{",
                self._case("OFFSET"),
                *end,
                "}",
            ]
            self.joints.append((number, np.array(end, float), [], self.n_channels))
        self.words.append("}")

    def text(self, rows: np.ndarray, period: float) -> str:
        """The words in lines of some writer."""
        chance = self.chance
        newline = chance.choice(["\n", "\r\n"])
        text = ""
        for word in self.words:
            starts = word.upper() in ("JOINT", "OFFSET", "CHANNELS", "END", "}", "ROOT")
            brace = word == "{" and chance.random() < 0.7
            text += newline + chance.choice(["", "\t", "  "]) if starts or brace else " "
            text += word
        label = chance.choice(["Frame Time:", "Frame Time: ", "Frame Time:\t", "FRAME TIME: "])
        frames = chance.choice(["Frames: ", "Frames:", "Frames:\t"])
        text += f"{newline}MOTION{newline}{frames}{len(rows)}{newline}{label}{period:.7f}{newline}"
        for row in rows:
            text += chance.choice([" ", "\t"]).join(f"{value:.6f}" for value in row)
            text += chance.choice(["", " "]) + newline
        return text.strip() if chance.random() < 0.3 else text

    def places(self, rows: np.ndarray) -> np.ndarray:
        """Positions (n, joints, 3), each joint turned about its parent."""
        positions = np.zeros((len(rows), len(self.joints), 3))
        for frame, row in enumerate(rows):
            turns: list[Rotation] = []
            for number, (parent, offset, named, first) in enumerate(self.joints):
                turn, place = Rotation.identity(), offset.copy()
                for column, name in enumerate(named, first):
                    axis = "XYZ".index(name[0])
                    if name.endswith("position"):
                        place[axis] = row[column]
                    else:
                        turn *= Rotation.from_euler(name[0].lower(), row[column], degrees=True)
                if parent is None:
                    positions[frame, number] = place
                else:
                    positions[frame, number] = positions[frame, parent] + turns[parent].apply(place)
                    turn = turns[parent] * turn
                turns.append(turn)
        return positions


@pytest.mark.parametrize("seed", range(40))
def test_bvh_files_of_other_programs(seed: int, tmp_path: Path) -> None:
    skeleton = _Skeleton(seed)
    rows = np.random.default_rng(seed).uniform(-170, 170, (seed % 7 + 1, skeleton.n_channels))
    rows = rows.round(6)
    path = tmp_path / "x.bvh"
    path.write_bytes(skeleton.text(rows, 1 / 120).encode())
    motion = bvh_file.read(path)
    assert motion.rate == pytest.approx(120.0, rel=1e-5)
    assert motion.note is None
    ours = np.concatenate([*motion.blocks()])
    np.testing.assert_allclose(ours, skeleton.places(rows), atol=1e-9, rtol=1e-9)


def _trc(seed: int) -> tuple[str, np.ndarray, float]:
    """The text of a TRC file, its places, and the length of 1 [m]."""
    chance = random.Random(seed)
    n, n_markers = chance.randrange(2, 30), chance.randrange(1, 6)
    places = np.random.default_rng(seed).uniform(-900, 900, (n, n_markers, 3)).round(5)
    places[np.random.default_rng(seed + 1).uniform(size=(n, n_markers)) < 0.15] = np.nan
    newline = chance.choice(["\n", "\r\n"])
    unit, metres = chance.choice(
        [("mm", 1e-3), ("m", 1.0), ("cm", 1e-2), ("MM", 1e-3), ("meters", 1.0)]
    )
    names = [f"{chance.choice(['R.ASIS', 'V_Sacral', 'C7 left'])}{i}" for i in range(n_markers)]
    fields = ["DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units"]
    values = ["120.00", "120", f"{n}", f"{n_markers}", unit]
    if chance.random() < 0.7:
        fields += ["OrigDataRate", "OrigDataStartFrame", "OrigNumFrames"]
        values += ["120", "1", f"{n}"]
    tail = chance.choice(["", "\t"])
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{chance.choice(['x.trc', 'C:/a b/x.trc', ''])}{tail}",
        "\t".join(fields) + tail,
        "\t".join(values) + tail,
        "Frame#\tTime\t" + "\t\t\t".join(names) + chance.choice(["", "\t\t", "\t\t\t"]),
        "\t\t" + "\t".join(f"{axis}{i + 1}" for i in range(n_markers) for axis in "XYZ") + tail,
    ]
    lines += [""] if chance.random() < 0.6 else []
    is_short = chance.random() < 0.4  # an editor has cut the blanks at the ends of lines
    for frame, row in enumerate(places):
        cells = ["" if np.isnan(value) else f"{value:.5f}" for value in row.ravel()]
        line = "\t".join([f"{frame + 1}", f"{frame / 120:.6f}", *cells]) + tail
        lines.append(line.rstrip() if is_short else line)
    return newline.join(lines) + chance.choice(["", newline, newline * 2]), places, metres


@pytest.mark.parametrize("seed", range(40))
def test_trc_files_of_other_programs(seed: int, tmp_path: Path) -> None:
    text, places, metres = _trc(seed)
    path = tmp_path / "x.trc"
    path.write_bytes(text.encode())
    motion = trc_file.read(path)
    assert motion.rate == pytest.approx(120.0)
    assert motion.unit_metres == pytest.approx(metres)
    np.testing.assert_array_equal(np.concatenate([*motion.blocks()]), places)
