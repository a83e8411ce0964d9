"""Tables and layouts as other programs write them, beside the modules of Python."""

from __future__ import annotations

import csv
import io
import json
import random
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

from ergon.exchange.layout_files import FORMS
from ergon.scores.gesture.summary import summary
from ergon.scores.gesture.take_file import TakeError
from ergon.scores.gesture.takes import read


@pytest.mark.parametrize("seed", range(40))
def test_tables_of_other_programs(seed: int, tmp_path: Path) -> None:
    chance = random.Random(seed)
    n, width = chance.randrange(1, 50), chance.randrange(1, 5)
    values = np.random.default_rng(seed).uniform(-1e3, 1e3, (n, width))
    separator = chance.choice([",", ";", "\t"])
    comma = separator != "," and chance.random() < 0.5
    form = chance.choice(["{:.6f}", "{:g}", "{:.3e}", "{:.0f}"])
    names = ["t [s]", *(f"x{i} [{chance.choice(['mm', 'N', 'm'])}]" for i in range(width))]
    if chance.random() < 0.3:
        names[1] = 'left, "the hand" [mm]'
    quoting = chance.choice([csv.QUOTE_MINIMAL, csv.QUOTE_ALL])
    written = io.StringIO()
    writer = csv.writer(
        written, delimiter=separator, quoting=quoting, lineterminator=chance.choice(["\n", "\r\n"])
    )
    writer.writerow(names)
    for row, line in enumerate(values):
        cells = [f"{row / 100:.2f}", *(form.format(value) for value in line)]
        writer.writerow([cell.replace(".", ",") if comma else cell for cell in cells])
    mark = "\ufeff" if chance.random() < 0.3 else ""
    comment = chance.choice(["", "# exported\n"])
    path = tmp_path / chance.choice(["a.csv", "a.tsv"])
    path.write_bytes((mark + comment + written.getvalue()).encode())
    table = summary(path)
    rows = [*csv.reader(io.StringIO(written.getvalue()), delimiter=separator)]
    numbers = np.array([[float(cell.replace(",", ".")) for cell in row] for row in rows[1:]])
    assert table.n_rows == n
    assert [column.name for column in table.columns] == rows[0]
    for column, expected in zip(table.columns, numbers.T, strict=True):
        assert (column.low_value, column.high_value) == (expected.min(), expected.max())
        assert (column.first_value, column.last_value) == (expected[0], expected[-1])


def _speakers(chance: random.Random) -> list[tuple[int, float, float, float]]:
    """Outputs from 1, with gaps and in any order, azimuths, elevations, distances."""
    outputs = chance.sample(range(1, 40), chance.randrange(1, 12))
    return [
        (output, round(chance.uniform(-180, 180), 3), round(chance.uniform(-30, 89), 3),
         round(chance.uniform(0.5, 6), 3)) for output in outputs
    ]  # fmt: skip


def _check(form: str, data: bytes, expected: dict[int, tuple[float, float, float]]) -> None:
    layout = FORMS[form].read(data)
    assert layout.outputs == sorted(expected)
    for output, seen in zip(layout.outputs, layout.speakers, strict=True):
        assert seen == pytest.approx(expected[output], abs=1e-3)


@pytest.mark.parametrize("seed", range(30))
def test_iem_layouts_of_other_programs(seed: int) -> None:
    chance = random.Random(seed)
    rows = [
        {"Azimuth": az, "Elevation": el, "Radius": r, "IsImaginary": False, "Channel": output,
         "Gain": chance.choice([1, 0.5])} for output, az, el, r in _speakers(chance)
    ]  # fmt: skip
    rows += [{"Azimuth": 0, "Elevation": -90, "Radius": 1, "IsImaginary": True, "Channel": -1}]
    chance.shuffle(rows)
    file = {"Name": "x", "LoudspeakerLayout": {"Name": "y", "Loudspeakers": rows}}
    if chance.random() < 0.5:
        file["Decoder"] = {"Matrix": [[0.5]]}
    data = json.dumps(file, indent=chance.choice([None, 4])).encode()
    real = [row for row in json.loads(data)["LoudspeakerLayout"]["Loudspeakers"]
            if not row["IsImaginary"]]  # fmt: skip
    _check("iem", data, {
        row["Channel"]: (row["Azimuth"], row["Elevation"], row["Radius"]) for row in real
    })  # fmt: skip


@pytest.mark.parametrize("seed", range(30))
def test_ear_layouts_of_other_programs(seed: int) -> None:
    chance = random.Random(seed)
    rows: list[dict] = [
        {"channel": output - 1, "names": chance.choice(["M+030", ["U+045", "left"]]),
         "position": {"az": az, "el": el, "r": r}} for output, az, el, r in _speakers(chance)
    ]  # fmt: skip
    rows.append({"channel": 50, "names": chance.choice(["LFE1", ["LFE2"]]), "position": {"az": 0}})
    file = chance.choice([rows, {"speakers": rows}, {"screen": None, "speakers": rows}])
    data = yaml.safe_dump(file, default_flow_style=chance.choice([None, True, False])).encode()
    again = yaml.safe_load(data)
    rows = again if isinstance(again, list) else again["speakers"]
    _check("ear", data, {
        row["channel"] + 1: tuple(row["position"].values()) for row in rows[:-1]
    })  # fmt: skip


@pytest.mark.parametrize("version", ["3", "4"])
@pytest.mark.parametrize("seed", range(20))
def test_spatgris_layouts_of_other_programs(seed: int, version: str) -> None:
    chance = random.Random(seed)
    root = ElementTree.Element("SPEAKER_SETUP", VERSION=f"{version}.1.0", SPAT_MODE="Dome")
    group = ElementTree.SubElement(root, "SPEAKER_GROUP") if version == "4" else root
    expected = {}
    for output, az, el, r in _speakers(chance):
        turn, up = np.radians([az, el])
        x, y, z = -r * np.cos(up) * np.sin(turn), r * np.cos(up) * np.cos(turn), r * np.sin(up)
        direct = chance.choice(["0", "0", "1"])
        if version == "4":
            ElementTree.SubElement(
                group, "SPEAKER", SPEAKER_PATCH_ID=f"{output}", DIRECT_OUT_ONLY=direct, STATE="0",
                CARTESIAN_POSITION=f"({x:.8f}, {y:.8f}, {z:.8f})", GAIN="0.0",
            )  # fmt: skip
        else:
            row = ElementTree.SubElement(group, f"SPEAKER_{output}", DIRECT_OUT_ONLY=direct)
            ElementTree.SubElement(row, "POSITION", X=f"{x:.8f}", Y=f"{y:.8f}", Z=f"{z:.8f}")
            ElementTree.SubElement(row, "HIGHPASS", FREQ="60.0")
        if direct == "0":
            expected[output] = (az, el, r)
    if expected:
        _check("spatgris", ElementTree.tostring(root), expected)


NUMBERS = "t [s];x [mm]\n0,0;1,0\n0,1;2,5\n0,2;4,0\n"
TABLES = {
    "Excel says the separator": b"sep=;\r\n" + NUMBERS.replace("\n", "\r\n").encode(),
    "UTF-16 of Excel": NUMBERS.replace(";", "\t").encode("utf-16"),
    "decimal commas in quotes": b'"t [s]","x [mm]"\n"0,0","1,0"\n"0,1","2,5"\n"0,2","4,0"\n',
    "units in parentheses": b"t (s),x (mm)\n0,1\n0.1,2.5\n0.2,4\n",
    "units in a row": b"t,x\ns,mm\n0,1\n0.1,2.5\n0.2,4\n",
    "units in a row, in brackets": b"t,x\n[s],[mm]\n0,1\n0.1,2.5\n0.2,4\n",
    "time by its name": b"Time (s),x [mm]\n0,1\n0.1,2.5\n0.2,4\n",
    "separators at the ends of lines": b"t [s],x [mm],\n0,1,\n0.1,2.5,\n0.2,4,\n",
    "empty rows of a spreadsheet": b"t [s],x [mm]\n,\n0,1\n0.1,2.5\n0.2,4\n,\n,,,\n",
}


@pytest.mark.parametrize("name", TABLES)
def test_tables_of_spreadsheets_hold_one_curve(name: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(TABLES[name])
    assert [column.name for column in summary(path).columns] == ["t [s]", "x [mm]"]
    samples = read(path)
    np.testing.assert_allclose(samples.t, [0.0, 0.1, 0.2])
    np.testing.assert_allclose(samples.x, [1e-3, 2.5e-3, 4e-3])


def test_table_of_other_names_in_latin_1(tmp_path: Path) -> None:
    """Parentheses that hold no unit are part of a name."""
    path = tmp_path / "a.csv"
    path.write_bytes("t [s];Größe (links);x_mm\n0;1;2\n1;2;3\n".encode("latin-1"))
    names = [column.name for column in summary(path).columns]
    assert names == ["t [s]", "Größe (links)", "x_mm"]


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"0;1,5\n0,1;2,5\n", ":1: this line is numbers"),
        (b't [s],x [mm]\n0,"1,250"\n', "may divide thousands or be a decimal comma"),
        (b"t [s],x [mm]\n0,\0\n", "this is not text"),
    ],
)
def test_tables_of_two_meanings_are_refused(data: bytes, words: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(data)
    with pytest.raises(TakeError, match=words):
        summary(path)


def test_joint_of_bvh_named_in_latin_1(tmp_path: Path) -> None:
    path = tmp_path / "a.bvh"
    text = "HIERARCHY ROOT Füße { OFFSET 0 0 0 CHANNELS 3 Xposition Yposition Zposition "
    text += "End Site { OFFSET 0 1 0 } } MOTION Frames: 2 Frame Time: 0.01\n0 0 0\n1 1 1\n"
    path.write_bytes(text.encode("latin-1"))
    assert summary(path).columns[1].name == "Füße.x"


def test_layout_gains_filters_and_states_are_named() -> None:
    place = {"az": 30, "el": 0, "r": 1}
    ear = [{"channel": 0, "names": "M+030", "position": place, "gain_linear": 0.5}]
    iem = {"LoudspeakerLayout": {"Loudspeakers": [{"Azimuth": 3, "Elevation": 0, "Gain": 2.0}]}}
    spatgris = (
        '<SPEAKER_SETUP><SPEAKER_3 STATE="silenced" GAIN="-3.0"><POSITION X="0" Y="1" Z="0"/>'
        '<HIGHPASS FREQ="80.0"/></SPEAKER_3></SPEAKER_SETUP>'
    )
    assert FORMS["ear"].read(yaml.safe_dump(ear).encode()).left_out == [
        "the gain of output 1 is not kept"
    ]
    assert FORMS["iem"].read(json.dumps(iem).encode()).left_out == [
        "the gain of output 1 is not kept"
    ]
    assert FORMS["spatgris"].read(spatgris.encode()).left_out == [
        "the gain of output 3 is not kept",
        "the high-pass filter of output 3 is not kept",
        "output 3 is silenced there; it sounds here",
    ]
